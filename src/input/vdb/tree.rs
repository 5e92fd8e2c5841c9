//! The tree of a grid: a root, nodes of 32^3 children or tiles, nodes of 16^3 children or tiles, leaves of 8^3 voxels.
//! A tile is a cube of voxels that all have one value.
//!
//! The file has the topology first, with the values of tiles, then the values of the leaves.

use super::super::columns::ReadError;
use super::bytes::Input;
use super::values::{Scratch, Stored, Values, bits, is_on, ones};
use rayon::prelude::*;
use std::sync::mpsc::sync_channel;

/// Voxels along the side of a leaf, and bits of an index coordinate within it.
pub const LEAF: i32 = 1 << LEAF_BITS;
const LEAF_BITS: u32 = 3;
/// Voxels along the side of a node of leaves, and bits of a child's coordinate within it.
pub const LOWER: i32 = LEAF << LOWER_BITS;
const LOWER_BITS: u32 = 4;
/// Voxels along the side of a node of nodes, and bits of a child's coordinate within it.
pub const UPPER: i32 = LOWER << UPPER_BITS;
const UPPER_BITS: u32 = 5;
/// Words in the masks of leaves and nodes.
pub const LEAF_WORDS: usize = 1 << (3 * LEAF_BITS - 6);
const LOWER_WORDS: usize = 1 << (3 * LOWER_BITS - 6);
const UPPER_WORDS: usize = 1 << (3 * UPPER_BITS - 6);

/// A cube of voxels that all have one value.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    /// Smallest index coordinates.
    pub origin: [i32; 3],
    /// Voxels along its side.
    pub side: i32,
    /// The value of each.
    pub value: f64,
}

/// What a tree holds, known before the first value of a leaf is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Census {
    /// Leaves.
    pub leaves: u64,
    /// Active voxels in leaves.
    pub leaf_voxels: u64,
    /// Nodes of leaves.
    pub lower_nodes: u64,
    /// Active tiles as large as a leaf, a node of leaves and a node of nodes.
    pub tiles: [u64; 3],
    /// Nodes that hold such tiles, of the two first sizes.
    pub tile_nodes: [u64; 2],
}

impl Census {
    /// The sides of the three sizes of tiles.
    pub const SIDES: [i32; 3] = [LEAF, LOWER, UPPER];

    /// Active voxels in tiles.
    pub fn tile_voxels(&self) -> u128 {
        let tiles = self.tiles.iter().zip(Self::SIDES);
        tiles.map(|(&count, side)| u128::from(count) * u128::from(side.unsigned_abs()).pow(3)).sum()
    }

    /// All active voxels.
    pub fn voxels(&self) -> u128 {
        self.tile_voxels() + u128::from(self.leaf_voxels)
    }
}

/// What becomes of a tree that is read.
pub trait Sink: Send {
    /// Takes the active tiles of a node, or one of the root.
    fn tiles(&mut self, node: &Tiles, input: &Input) -> Result<(), ReadError>;
    /// The topology is complete, and the file large enough for the leaves, which follow.
    fn begin(&mut self, census: &Census, input: &Input) -> Result<(), ReadError>;
    /// Takes the active voxels of a leaf: its smallest index coordinates, which voxels, and the value of each.
    fn leaf(&mut self, origin: [i32; 3], mask: &[u64; LEAF_WORDS], values: &[f64]) -> Result<(), ReadError>;
}

/// The active tiles of a node.
pub struct Tiles<'a> {
    /// Smallest index coordinates of the node.
    pub origin: [i32; 3],
    /// Voxels along the node's side.
    pub side: i32,
    /// The tiles.
    pub tiles: &'a [Tile],
}

/// A leaf of which the topology is known.
struct Leaf {
    origin: [i32; 3],
    active: u16,
}

/// Leaves that are read one after the other, unpacked on all threads and then handed over in their order.
const LEAVES_AT_ONCE: usize = 1024;
/// Leaves that one task decodes: less is mostly waiting.
const LEAVES_PER_TASK: usize = 64;

/// A leaf that has been read.
struct Fetched {
    mask: [u64; LEAF_WORDS],
    stored: Stored,
    /// Byte of the file where it ends.
    end: u64,
    /// The values of its active voxels, once they are decoded.
    values: Vec<f64>,
}

/// Reads trees.
pub struct Reader<'a, 'b> {
    /// Where from.
    input: &'a mut Input<'b>,
    /// How nodes store their values.
    values: Values,
    /// What messages call the grid.
    name: &'a str,
    /// Whether a value that is no finite number is read as NaN.
    lenient: bool,
    /// Memory for the values of nodes.
    data: Vec<u8>,
    scratch: Scratch,
}

/// What messages call the values.
const NODE_VALUES: &str = "the values of a node";
const LEAF_VALUES: &str = "the values of a leaf";

/// The masks of a node.
struct Node<const WORDS: usize> {
    children: Box<[u64]>,
    active: Box<[u64]>,
}

impl<const WORDS: usize> Node<WORDS> {
    fn new() -> Self {
        Self { children: vec![0; WORDS].into(), active: vec![0; WORDS].into() }
    }
}

/// The index coordinates of item `item` in a node of (2^bits)^3 items with sides of `step` voxels.
fn place(origin: [i32; 3], item: usize, bits: u32, step: i32) -> [i32; 3] {
    let mask = (1 << bits) - 1;
    let [x, y, z] = [item >> (2 * bits), item >> bits, item].map(|coordinate| (coordinate & mask) as i32 * step);
    // A node's origin is a multiple of its side, so that no sum is larger than the largest coordinate.
    [origin[0] + x, origin[1] + y, origin[2] + z]
}

impl<'a, 'b> Reader<'a, 'b> {
    /// Reads from `input` a tree of the grid called `name`, whose values are stored so. `lenient`: what is no finite
    /// number is read as NaN.
    pub fn new(input: &'a mut Input<'b>, values: Values, name: &'a str, lenient: bool) -> Self {
        Self { input, values, name, lenient, data: Vec::new(), scratch: Scratch::default() }
    }

    /// Reads a tree into `sink` and returns what it holds.
    pub fn read(&mut self, sink: &mut dyn Sink) -> Result<Census, ReadError> {
        let mut census = Census::default();
        let leaves = self.topology(&mut census, sink)?;
        // What follows at least: for each leaf its mask and, in old files, where it lies and its number of buffers.
        let leaf_bytes = 8 * LEAF_WORDS as u64 + if self.values.is_old() { 3 * 4 + 1 } else { 1 };
        let bytes = census.leaves * leaf_bytes + self.values.smallest(census.leaf_voxels);
        self.input.need(bytes, &format!("the leaves of grid `{}`", self.name))?;
        sink.begin(&census, self.input)?;
        self.leaves(&leaves, sink)?;
        Ok(census)
    }

    /// Reads the leaves. While some are read and unpacked, those before them are handed over.
    fn leaves(&mut self, leaves: &[Leaf], sink: &mut dyn Sink) -> Result<(), ReadError> {
        let (name, lenient) = (self.name, self.lenient);
        std::thread::scope(|scope| {
            // One batch waits while another is handed over and a third is read.
            let (sender, receiver) = sync_channel::<(&[Leaf], Vec<Fetched>)>(1);
            let handing_over = scope.spawn(move || {
                for (leaves, mut fetched) in receiver {
                    for (&Leaf { origin, .. }, leaf) in leaves.iter().zip(&mut fetched) {
                        let Fetched { mask, values, end, .. } = leaf;
                        let voxel =
                            |index: usize| place(origin, bits(&*mask).nth(index).unwrap_or_default(), LEAF_BITS, 1);
                        check(values, voxel, 1, *end, name, lenient)?;
                        sink.leaf(origin, mask, values)?;
                    }
                }
                Ok(())
            });
            let mut reading = Ok(());
            for leaves in leaves.chunks(LEAVES_AT_ONCE) {
                match self.batch(leaves) {
                    Ok(fetched) => {
                        // The other thread stops receiving at its first error.
                        if sender.send((leaves, fetched)).is_err() {
                            break;
                        }
                    }
                    Err(error) => {
                        reading = Err(error);
                        break;
                    }
                }
            }
            drop(sender);
            // What was handed over stands before what could not be read.
            let handed_over = handing_over.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            handed_over.and(reading)
        })
    }

    /// Reads and decodes leaves.
    fn batch(&mut self, leaves: &[Leaf]) -> Result<Vec<Fetched>, ReadError> {
        let mut data = std::mem::take(&mut self.data);
        data.clear();
        let mut fetched = Vec::with_capacity(leaves.len());
        for leaf in leaves {
            fetched.push(self.fetch(leaf, &mut data)?);
        }
        let values = self.values;
        let decode = |scratch: &mut Scratch, leaf: &mut Fetched| {
            values.decode(&leaf.stored, &data, &leaf.mask, None, scratch, &mut leaf.values, LEAF_VALUES)
        };
        if values.is_compressed() {
            let leaves = fetched.par_iter_mut().with_min_len(LEAVES_PER_TASK);
            leaves.map_init(Scratch::default, decode).collect::<Result<(), _>>()?;
        } else {
            fetched.iter_mut().try_for_each(|leaf| decode(&mut self.scratch, leaf))?;
        }
        self.data = data;
        Ok(fetched)
    }

    fn topology(&mut self, census: &mut Census, sink: &mut dyn Sink) -> Result<Vec<Leaf>, ReadError> {
        const WHAT: &str = "the root of a tree";
        // The number of buffers, of which only the first has been used for long.
        self.input.skip(4, WHAT)?;
        // Inactive values are not read: neither is the background.
        self.values.single(self.input, WHAT)?;
        let tiles = self.input.u32("the number of tiles")?;
        let children = self.input.u32("the number of nodes")?;
        let tile_bytes = 3 * 4 + self.values.single_size() + 1;
        let child_bytes = 3 * 4 + 2 * 8 * UPPER_WORDS as u64;
        let bytes = u64::from(tiles) * tile_bytes + u64::from(children) * child_bytes;
        self.input.need(bytes, &format!("{tiles} tiles and {children} nodes"))?;

        let mut origins = Vec::new();
        for _ in 0..tiles {
            let origin = self.root_origin()?;
            origins.push(origin);
            let mut value = [self.values.single(self.input, WHAT)?];
            if self.input.u8(WHAT)? != 0 {
                check(&mut value, |_| origin, UPPER, self.input.position(), self.name, self.lenient)?;
                let tile = Tile { origin, side: UPPER, value: value[0] };
                census.tiles[2] += 1;
                sink.tiles(&Tiles { origin, side: UPPER, tiles: &[tile] }, self.input)?;
            }
        }
        let mut leaves = Vec::new();
        // The first leaf of each node, by the node's place.
        let mut nodes = Vec::new();
        let mut upper = Node::<UPPER_WORDS>::new();
        let mut lower = Node::<LOWER_WORDS>::new();
        for _ in 0..children {
            let origin = self.root_origin()?;
            origins.push(origin);
            let first = leaves.len();
            self.node(&mut upper, origin, UPPER_BITS, LOWER, census, sink)?;
            for child in bits(&upper.children) {
                let origin = place(origin, child, UPPER_BITS, LOWER);
                self.node(&mut lower, origin, LOWER_BITS, LEAF, census, sink)?;
                census.lower_nodes += 1;
                for child in bits(&lower.children) {
                    let mut mask = [0; LEAF_WORDS];
                    self.input.mask(&mut mask, "the mask of a leaf")?;
                    let active = ones(&mask);
                    census.leaves += 1;
                    census.leaf_voxels += active as u64;
                    leaves.push(Leaf { origin: place(origin, child, LOWER_BITS, LEAF), active: active as u16 });
                }
            }
            nodes.push((origin, first..leaves.len()));
        }
        origins.sort_unstable();
        if let Some(pair) = origins.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(self.input.wrong(format_args!("two tiles or nodes of the root lie at {:?}", pair[0])));
        }
        // OpenVDB keeps them sorted: so it writes them, and so it would read the leaves of a file that does not.
        if nodes.is_sorted_by_key(|node| node.0) {
            return Ok(leaves);
        }
        nodes.sort_unstable_by_key(|node| node.0);
        let sorted = nodes.into_iter().flat_map(|(_, range)| leaves.get(range).unwrap_or_default());
        Ok(sorted.map(|&Leaf { origin, active }| Leaf { origin, active }).collect())
    }

    /// The place of what is directly below the root.
    fn root_origin(&mut self) -> Result<[i32; 3], ReadError> {
        let origin = self.input.coordinates("the place of a tile or node of the root")?;
        if origin.iter().any(|coordinate| coordinate % UPPER != 0) {
            let message = format!("a tile or node of the root lies at {origin:?}; allowed: multiples of {UPPER}");
            return Err(self.input.wrong(message));
        }
        Ok(origin)
    }

    /// Reads the masks and tiles of a node with (2^bits)^3 items of `step` voxels' side.
    fn node<const WORDS: usize>(
        &mut self,
        node: &mut Node<WORDS>,
        origin: [i32; 3],
        bits_of_item: u32,
        step: i32,
        census: &mut Census,
        sink: &mut dyn Sink,
    ) -> Result<(), ReadError> {
        self.input.mask(&mut node.children, "the child mask of a node")?;
        self.input.mask(&mut node.active, "the value mask of a node")?;
        let mut values = Vec::new();
        let (active, children) = (&node.active, Some(&*node.children));
        self.data.clear();
        let stored = self.values.fetch(self.input, active, children, &mut self.data, NODE_VALUES)?;
        self.values.decode(&stored, &self.data, active, children, &mut self.scratch, &mut values, NODE_VALUES)?;
        if values.is_empty() {
            return Ok(());
        }
        let items: Vec<usize> = bits(&node.active).filter(|&item| !is_on(&node.children, item)).collect();
        let origin_of = |item: usize| place(origin, item, bits_of_item, step);
        let place_of = |index: usize| origin_of(items.get(index).copied().unwrap_or_default());
        check(&mut values, place_of, step, self.input.position(), self.name, self.lenient)?;
        let tile = |(&item, &value): (&usize, &f64)| Tile { origin: origin_of(item), side: step, value };
        let tiles: Vec<Tile> = items.iter().zip(&values).map(tile).collect();
        let size = usize::from(step == LOWER);
        census.tiles[size] += tiles.len() as u64;
        census.tile_nodes[size] += 1;
        sink.tiles(&Tiles { origin, side: step << bits_of_item, tiles: &tiles }, self.input)
    }

    /// Reads a leaf, its values into `data`.
    fn fetch(&mut self, leaf: &Leaf, data: &mut Vec<u8>) -> Result<Fetched, ReadError> {
        const VOXELS: usize = 64 * LEAF_WORDS;
        let mut mask = [0; LEAF_WORDS];
        self.input.mask(&mut mask, LEAF_VALUES)?;
        let origin = leaf.origin;
        if ones(&mask) != usize::from(leaf.active) {
            return Err(self.input.wrong(format_args!(
                "the leaf at {origin:?} has {} active voxels with its values and {} in the topology; allowed: the same",
                ones(&mask),
                leaf.active
            )));
        }
        let mut buffers = 1;
        if self.values.is_old() {
            self.input.coordinates(LEAF_VALUES)?;
            buffers = self.input.u8(LEAF_VALUES)?;
        }
        let stored = self.values.fetch(self.input, &mask, None, data, LEAF_VALUES)?;
        for _ in 1..buffers {
            // Of no use, and of no known length but by reading it.
            self.data.clear();
            self.values.fetch_count(self.input, VOXELS, &mut self.data, LEAF_VALUES)?;
        }
        Ok(Fetched { mask, stored, end: self.input.position(), values: Vec::new() })
    }
}

/// Refuses values that are no finite numbers, or makes them NaN. `origin` gives the place of the value of an index,
/// `side` is that of the cube it stands for; `end` is the byte after the values, `name` the grid's.
fn check(
    values: &mut [f64],
    origin: impl Fn(usize) -> [i32; 3],
    side: i32,
    end: u64,
    name: &str,
    lenient: bool,
) -> Result<(), ReadError> {
    // Without a way out in the middle this is a matter of few instructions.
    if values.iter().fold(true, |all, value| all & value.is_finite()) {
        return Ok(());
    }
    for (index, value) in values.iter_mut().enumerate().filter(|(_, value)| !value.is_finite()) {
        if !lenient {
            let [x, y, z] = origin(index);
            let what = if side == 1 { "voxel".to_owned() } else { format!("the tile of {side}^3 voxels from") };
            return Err(ReadError::content(format!(
                "byte {end}: {what} ({x}, {y}, {z}) of grid `{name}` is {value}; allowed: a finite number"
            )));
        }
        *value = f64::NAN;
    }
    Ok(())
}
