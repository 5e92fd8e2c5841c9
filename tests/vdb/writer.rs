//! Writes OpenVDB files, after OpenVDB's own way of writing: what the reader is tested with.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use half::f16;
use std::collections::BTreeMap;
use std::io::Write;

pub const ZIP: u32 = 1;
pub const ACTIVE_MASK: u32 = 2;
pub const BLOSC: u32 = 4;

/// How Blosc containers are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blosc {
    /// 1 lz4, 3 zlib; others are only said to be so.
    pub codec: u8,
    pub type_size: usize,
    pub shuffle: bool,
    /// Blocks are split where Blosc would.
    pub split: bool,
    /// Bytes of a block; 0: one block.
    pub block: usize,
}

impl Blosc {
    /// What OpenVDB writes.
    pub const USUAL: Self = Self { codec: 1, type_size: 4, shuffle: true, split: false, block: 0 };
}

#[derive(Clone, Debug)]
pub enum Map {
    Scale([f64; 3]),
    UniformScale(f64),
    Translation([f64; 3]),
    ScaleTranslate([f64; 3], [f64; 3]),
    UniformScaleTranslate(f64, [f64; 3]),
    /// Images of the index axes and of the origin.
    Affine([[f64; 3]; 4]),
    Unitary([[f64; 3]; 4]),
    Named(&'static str),
}

impl Map {
    /// Where the map takes an index.
    pub fn apply(&self, i: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| match self {
            Self::Scale(s) => i[a] * s[a],
            Self::UniformScale(s) => i[a] * s,
            Self::Translation(t) => i[a] + t[a],
            Self::ScaleTranslate(s, t) => i[a] * s[a] + t[a],
            Self::UniformScaleTranslate(s, t) => i[a] * s + t[a],
            Self::Affine(m) | Self::Unitary(m) => i[0] * m[0][a] + i[1] * m[1][a] + i[2] * m[2][a] + m[3][a],
            Self::Named(_) => i[a],
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        let scale = |s: [f64; 3]| {
            [s, s.map(f64::abs), s.map(|s| 1.0 / s), s.map(|s| 1.0 / (s * s)), s.map(|s| 0.5 / s)].concat()
        };
        let matrix = |m: &[[f64; 3]; 4]| {
            m.iter().enumerate().flat_map(|(r, row)| [row[0], row[1], row[2], f64::from(u8::from(r == 3))]).collect()
        };
        let (name, numbers): (&str, Vec<f64>) = match self {
            Self::Scale(s) => ("ScaleMap", scale(*s)),
            Self::UniformScale(s) => ("UniformScaleMap", scale([*s; 3])),
            Self::Translation(t) => ("TranslationMap", t.to_vec()),
            Self::ScaleTranslate(s, t) => ("ScaleTranslateMap", [t.to_vec(), scale(*s)].concat()),
            Self::UniformScaleTranslate(s, t) => ("UniformScaleTranslateMap", [t.to_vec(), scale([*s; 3])].concat()),
            Self::Affine(m) => ("AffineMap", matrix(m)),
            Self::Unitary(m) => ("UnitaryMap", matrix(m)),
            Self::Named(name) => (name, vec![1.0; 40]),
        };
        text(out, name);
        for number in numbers {
            out.extend_from_slice(&number.to_le_bytes());
        }
    }
}

/// A leaf: 512 voxels, each with a value and whether it is active.
#[derive(Clone, Debug)]
pub struct Leaf(pub Vec<(f64, bool)>);

#[derive(Clone, Debug)]
pub struct Grid {
    pub name: String,
    /// Type with its suffix.
    pub kind: String,
    pub parent: String,
    pub metadata: Vec<(String, String, Vec<u8>)>,
    pub map: Map,
    pub compression: u32,
    pub blosc: Blosc,
    pub background: f64,
    /// Tiles of 4096^3, 128^3 and 8^3 voxels by their places: value, active.
    pub tiles: [BTreeMap<[i32; 3], (f64, bool)>; 3],
    pub leaves: BTreeMap<[i32; 3], Leaf>,
}

/// A text as metadata.
pub fn string(name: &str, value: &str) -> (String, String, Vec<u8>) {
    (name.to_owned(), "string".to_owned(), value.as_bytes().to_vec())
}

impl Grid {
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            kind: "Tree_float_5_4_3".to_owned(),
            parent: String::new(),
            metadata: vec![string("class", "fog volume")],
            map: Map::UniformScale(1.0),
            compression: 0,
            blosc: Blosc::USUAL,
            background: 0.0,
            tiles: Default::default(),
            leaves: BTreeMap::new(),
        }
    }

    pub fn is_half(&self) -> bool {
        self.kind.ends_with("_HalfFloat")
    }

    pub fn is_double(&self) -> bool {
        self.kind.contains("double")
    }

    /// Makes a voxel active.
    pub fn set(&mut self, voxel: [i32; 3], value: f64) {
        self.put(voxel, value, true);
    }

    pub fn put(&mut self, voxel: [i32; 3], value: f64, active: bool) {
        let background = self.background;
        let leaf = self.leaves.entry(floor(voxel, 8)).or_insert_with(|| Leaf(vec![(background, false); 512]));
        let [x, y, z] = voxel.map(|c| c.rem_euclid(8) as usize);
        leaf.0[64 * x + 8 * y + z] = (value, active);
    }

    /// A value as the file holds it.
    pub fn stored(&self, value: f64) -> f64 {
        match (self.is_half(), self.is_double()) {
            (true, _) => f16::from_f32(value as f32).to_f64(),
            (_, true) => value,
            _ => f64::from(value as f32),
        }
    }

    /// Every active voxel with its value in the order of the tree; tiles of up to `largest` voxels' side are among
    /// them. Tiles of the root are stored in full precision.
    pub fn voxels(&self, largest: i32) -> Vec<([i32; 3], f64)> {
        let mut found = Vec::new();
        let mut tile = |origin: [i32; 3], side: i32, value: f64| {
            assert!(side <= largest);
            for x in 0..side {
                for y in 0..side {
                    found.extend((0..side).map(|z| ([origin[0] + x, origin[1] + y, origin[2] + z], value)));
                }
            }
        };
        for (&origin, &(value, active)) in &self.tiles[0] {
            if active {
                tile(origin, 4096, if self.is_double() { value } else { f64::from(value as f32) });
            }
        }
        for upper in self.uppers() {
            let own = |origin: &[i32; 3]| floor(*origin, 4096) == upper;
            for (&origin, &(value, active)) in self.tiles[1].iter().filter(|(origin, _)| own(origin)) {
                if active {
                    tile(origin, 128, self.stored(value));
                }
            }
            // By nodes, not by places.
            let mut small: Vec<_> = self.tiles[2].iter().filter(|(origin, _)| own(origin)).collect();
            small.sort_by_key(|(origin, _)| (floor(**origin, 128), **origin));
            for (&origin, &(value, active)) in small {
                if active {
                    tile(origin, 8, self.stored(value));
                }
            }
        }
        let mut leaves: Vec<_> = self.leaves.iter().collect();
        leaves.sort_by_key(|(origin, _)| (floor(**origin, 4096), floor(**origin, 128), **origin));
        for (origin, leaf) in leaves {
            for (i, &(value, active)) in leaf.0.iter().enumerate() {
                if active {
                    let [x, y, z] = [i >> 6, i >> 3 & 7, i & 7].map(|c| c as i32);
                    found.push(([origin[0] + x, origin[1] + y, origin[2] + z], self.stored(value)));
                }
            }
        }
        found
    }

    fn below(&self) -> impl Iterator<Item = [i32; 3]> {
        self.tiles[2].keys().chain(self.leaves.keys()).copied()
    }

    /// Places of the nodes below the root, sorted.
    fn uppers(&self) -> Vec<[i32; 3]> {
        let mut places: Vec<_> = self.below().chain(self.tiles[1].keys().copied()).map(|p| floor(p, 4096)).collect();
        places.sort_unstable();
        places.dedup();
        places
    }
}

/// The cube of that side that holds a voxel.
pub fn floor(voxel: [i32; 3], side: i32) -> [i32; 3] {
    voxel.map(|c| c.div_euclid(side) * side)
}

pub fn text(out: &mut Vec<u8>, text: &str) {
    out.extend_from_slice(&(text.len() as u32).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
}

fn metadata(out: &mut Vec<u8>, entries: &[(String, String, Vec<u8>)]) {
    out.extend_from_slice(&(entries.len() as u32).to_le_bytes());
    for (name, kind, value) in entries {
        text(out, name);
        text(out, kind);
        out.extend_from_slice(&(value.len() as u32).to_le_bytes());
        out.extend_from_slice(value);
    }
}

/// A file and how it is written.
#[derive(Clone, Debug)]
pub struct File {
    pub version: u32,
    pub offsets: bool,
    pub metadata: Vec<(String, String, Vec<u8>)>,
    pub grids: Vec<Grid>,
    /// What the values of nodes said of their inactive ones when the file was written.
    pub codes: Vec<u8>,
}

impl File {
    pub fn new(version: u32, grids: Vec<Grid>) -> Self {
        let kinds: [(&str, &[u8]); 14] = [
            ("string", b"Houdini"),
            ("int32", &[1; 4]),
            ("int64", &[1; 8]),
            ("float", &[1; 4]),
            ("double", &[1; 8]),
            ("bool", &[1]),
            ("vec2i", &[1; 8]),
            ("vec2s", &[1; 8]),
            ("vec2d", &[1; 16]),
            ("vec3i", &[1; 12]),
            ("vec3s", &[1; 12]),
            ("vec3d", &[1; 24]),
            ("mat4s", &[1; 64]),
            ("a type of tomorrow", &[7; 1500]),
        ];
        let metadata = kinds.iter().map(|(kind, value)| (format!("a {kind}"), (*kind).to_owned(), value.to_vec()));
        Self { version, offsets: true, metadata: metadata.collect(), grids, codes: Vec::new() }
    }

    pub fn bytes(&mut self) -> Vec<u8> {
        let mut out = b" BDV\0\0\0\0".to_vec();
        for number in [self.version, 6, 2] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        out.push(self.offsets.into());
        if self.version < 222 {
            out.push(u8::from(self.grids.iter().any(|grid| grid.compression & ZIP != 0)));
        }
        out.extend_from_slice(b"ccdc3148-65bc-4c7c-b180-025f050f8dc1");
        metadata(&mut out, &self.metadata);
        out.extend_from_slice(&(self.grids.len() as u32).to_le_bytes());
        for grid in self.grids.clone() {
            text(&mut out, &grid.name);
            text(&mut out, &grid.kind);
            text(&mut out, &grid.parent);
            let offsets = out.len();
            out.extend_from_slice(&[0; 24]);
            let start = out.len();
            if self.version >= 222 {
                out.extend_from_slice(&grid.compression.to_le_bytes());
            }
            metadata(&mut out, &grid.metadata);
            grid.map.write(&mut out);
            let mut blocks = 0;
            if grid.parent.is_empty() {
                let mut node = Nodes { version: self.version, grid: &grid, codes: &mut self.codes, out: &mut out };
                blocks = node.write();
            }
            if self.offsets {
                for (i, position) in [start, blocks, out.len()].into_iter().enumerate() {
                    out[offsets + 8 * i..offsets + 8 * i + 8].copy_from_slice(&(position as u64).to_le_bytes());
                }
            }
        }
        out
    }
}

struct Nodes<'a> {
    version: u32,
    grid: &'a Grid,
    codes: &'a mut Vec<u8>,
    out: &'a mut Vec<u8>,
}

impl Nodes<'_> {
    fn single(&mut self, value: f64) {
        if self.grid.is_double() {
            self.out.extend_from_slice(&value.to_le_bytes());
        } else {
            self.out.extend_from_slice(&(value as f32).to_le_bytes());
        }
    }

    fn place(&mut self, place: [i32; 3]) {
        for c in place {
            self.out.extend_from_slice(&c.to_le_bytes());
        }
    }

    fn mask(&mut self, mask: &[bool]) {
        for byte in mask.chunks(8) {
            self.out.push(byte.iter().enumerate().map(|(i, &on)| u8::from(on) << i).sum());
        }
    }

    /// Writes topology and values; returns where the values begin.
    fn write(&mut self) -> usize {
        let grid = self.grid;
        self.out.extend_from_slice(&1u32.to_le_bytes());
        self.single(grid.background);
        let uppers = grid.uppers();
        self.out.extend_from_slice(&(grid.tiles[0].len() as u32).to_le_bytes());
        self.out.extend_from_slice(&(uppers.len() as u32).to_le_bytes());
        for (&place, &(value, active)) in &grid.tiles[0] {
            self.place(place);
            self.single(value);
            self.out.push(active.into());
        }
        let mut leaves = Vec::new();
        for upper in uppers {
            self.place(upper);
            let lowers: Vec<_> = grid.below().filter(|&p| floor(p, 4096) == upper).map(|p| floor(p, 128)).collect();
            for lower in self.node(upper, 32, 128, &lowers, &grid.tiles[1]) {
                let own: Vec<_> = grid.leaves.keys().copied().filter(|&p| floor(p, 128) == lower).collect();
                for leaf in self.node(lower, 16, 8, &own, &grid.tiles[2]) {
                    let active: Vec<bool> = grid.leaves[&leaf].0.iter().map(|voxel| voxel.1).collect();
                    self.mask(&active);
                    leaves.push(leaf);
                }
            }
        }
        let start = self.out.len();
        for place in leaves {
            let (values, active): (Vec<f64>, Vec<bool>) = grid.leaves[&place].0.iter().copied().unzip();
            self.mask(&active);
            if self.version < 222 {
                self.place(place);
                // Two buffers, of which the second is not for us.
                self.out.push(2);
            }
            self.values(&values, &active, &[false; 512]);
            if self.version < 222 {
                self.chunk(&[7.0; 512]);
            }
        }
        start
    }

    /// Writes a node and returns the places of its children.
    fn node(
        &mut self,
        place: [i32; 3],
        side: i32,
        step: i32,
        children: &[[i32; 3]],
        tiles: &BTreeMap<[i32; 3], (f64, bool)>,
    ) -> Vec<[i32; 3]> {
        let count = side.pow(3) as usize;
        let item = |child: &[i32; 3]| {
            let [x, y, z]: [i32; 3] = std::array::from_fn(|a| (child[a] - place[a]) / step);
            ((x * side + y) * side + z) as usize
        };
        let mut is_child = vec![false; count];
        let mut sorted: Vec<_> = children.to_vec();
        sorted.sort_by_key(item);
        sorted.dedup();
        sorted.iter().for_each(|child| is_child[item(child)] = true);
        let mut values = vec![self.grid.background; count];
        let mut active = vec![false; count];
        for (tile, &(value, on)) in tiles.iter().filter(|(tile, _)| floor(**tile, side * step) == place) {
            (values[item(tile)], active[item(tile)]) = (value, on);
        }
        self.mask(&is_child);
        self.mask(&active);
        self.values(&values, &active, &is_child);
        sorted
    }

    /// Writes the values of a node, without those that can be told from few.
    fn values(&mut self, values: &[f64], active: &[bool], children: &[bool]) {
        if self.version < 222 {
            let kept = values.iter().zip(children).filter(|(_, child)| !**child);
            return self.chunk(&kept.map(|(value, _)| *value).collect::<Vec<_>>());
        }
        if self.grid.compression & ACTIVE_MASK == 0 {
            self.out.push(6);
            self.codes.push(6);
            return self.chunk(values);
        }
        let mut inactive: Vec<f64> = Vec::new();
        for ((value, on), child) in values.iter().zip(active).zip(children) {
            if !on && !child && !inactive.contains(value) {
                inactive.push(*value);
            }
        }
        let background = self.grid.background;
        // Where two values are known, the mask chooses the second.
        let (code, written, second): (u8, Vec<f64>, Option<f64>) = match inactive[..] {
            [] => (0, vec![], None),
            [a] if a == background => (0, vec![], None),
            [a] if a == -background => (1, vec![], None),
            [a] => (2, vec![a], None),
            [a, b] if a == background && b == -background => (3, vec![], Some(a)),
            [a, b] if b == background && a == -background => (3, vec![], Some(b)),
            [a, b] if b == background => (4, vec![a], Some(b)),
            [a, b] if a == background => (4, vec![b], Some(a)),
            [a, b] => (5, vec![a, b], Some(b)),
            _ => (6, vec![], None),
        };
        self.out.push(code);
        self.codes.push(code);
        written.into_iter().for_each(|value| self.single(value));
        if let Some(second) = second {
            let mask: Vec<bool> = values.iter().zip(active).map(|(value, on)| !on && *value == second).collect();
            self.mask(&mask);
        }
        if code == 6 {
            self.chunk(values);
        } else {
            let kept = values.iter().zip(active).filter(|(_, on)| **on);
            self.chunk(&kept.map(|(value, _)| *value).collect::<Vec<_>>());
        }
    }

    fn chunk(&mut self, values: &[f64]) {
        let grid = self.grid;
        let bytes: Vec<u8> = match (grid.is_half(), grid.is_double()) {
            (true, _) if values.is_empty() => return,
            (true, _) => values.iter().flat_map(|&v| f16::from_f32(v as f32).to_le_bytes()).collect(),
            (_, true) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            _ => values.iter().flat_map(|&v| (v as f32).to_le_bytes()).collect(),
        };
        let packed = if self.version >= 223 && grid.compression & BLOSC != 0 {
            Some(blosc(&bytes, grid.blosc))
        } else if grid.compression & ZIP != 0 {
            let packed = zlib(&bytes);
            Some(if packed.len() < bytes.len() { packed } else { Vec::new() })
        } else {
            None
        };
        match packed {
            None => self.out.extend_from_slice(&bytes),
            Some(packed) if packed.is_empty() => {
                self.out.extend_from_slice(&(-(bytes.len() as i64)).to_le_bytes());
                self.out.extend_from_slice(&bytes);
            }
            Some(packed) => {
                self.out.extend_from_slice(&(packed.len() as i64).to_le_bytes());
                self.out.extend_from_slice(&packed);
            }
        }
    }
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A Blosc 1 container.
pub fn blosc(bytes: &[u8], how: Blosc) -> Vec<u8> {
    let size = how.type_size;
    let stored = bytes.len() < 128;
    let flags = u8::from(how.shuffle) | u8::from(stored) << 1 | u8::from(!how.split) << 4 | how.codec << 5;
    let block = if how.block == 0 { bytes.len() / size * size } else { how.block };
    let mut out = vec![2, 1, flags, size as u8];
    out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(&(block.max(1) as u32).to_le_bytes());
    out.extend_from_slice(&[0; 4]);
    if stored {
        out.extend_from_slice(bytes);
    } else {
        let blocks: Vec<&[u8]> = bytes.chunks(block).collect();
        let starts = out.len();
        out.resize(starts + 4 * blocks.len(), 0);
        for (i, plain) in blocks.into_iter().enumerate() {
            let start = out.len() as u32;
            out[starts + 4 * i..starts + 4 * i + 4].copy_from_slice(&start.to_le_bytes());
            let mut shuffled = plain.to_vec();
            if how.shuffle {
                let count = plain.len() / size;
                for (j, &byte) in plain[..count * size].iter().enumerate() {
                    shuffled[j % size * count + j / size] = byte;
                }
            }
            let splits = how.split && size <= 16 && block / size >= 128 && plain.len() == block;
            for part in shuffled.chunks(if splits { block / size } else { plain.len() }) {
                let mut packed = if how.codec == 3 { zlib(part) } else { lz4_flex::block::compress(part) };
                if packed.len() >= part.len() {
                    packed = part.to_vec();
                }
                out.extend_from_slice(&(packed.len() as u32).to_le_bytes());
                out.extend_from_slice(&packed);
            }
        }
    }
    let length = out.len() as u32;
    out[12..16].copy_from_slice(&length.to_le_bytes());
    out
}
