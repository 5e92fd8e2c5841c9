//! Wavefront OBJ with its material libraries (Alias|Wavefront, *Advanced Visualizer* manual, appendix B1, *Object files*).
//!
//! Taken are `v` (x y z, with a weight, which is ignored, or with a linear-light colour r g b), `vt`, `vn`, `f` with any
//! number of corners, `usemtl` and `mtllib`. Groups, names and smoothing (`g`, `o`, `s`) change nothing in a picture:
//! faces without normals are flat. Points, lines, curves and surfaces are left out with a note.
//!
//! A material library or a texture that is not there is noted, and the entry's colour is shown instead: such files
//! travel without their companions. One that is there and broken is an error.
//!
//! Why an own reader: the errors of `tobj` 4.0 name no line, and it triangulates only polygons that are fans.

mod mtl;
mod statements;

use super::columns::{number, quote};
use super::file::{find, open};
use super::mesh::{Budget, Outcome, VERTEX_BYTES};
use super::polygon::Triangulator;
use super::texture::{MOST_TEXELS, read_texture};
use crate::error::{Error, Result};
use crate::picture::color::decode;
use crate::scene::Rgb;
use crate::scene::mesh::{Material, Mesh, Wrap};
use glam::{DVec2, DVec3};
use statements::{Statement, Statements, fields, uncommented};
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::io::BufRead;
use std::path::{Path, PathBuf};

/// Most bytes in all material libraries of a file.
const LIBRARY_BYTES: u64 = 1 << 24;

/// Bytes of an entry of the table of vertices, which is up to twice as large as what is in it.
const TABLE_BYTES: u64 = 2 * (16 + 4 + 1);

/// Bytes of a triangle in [`Mesh`].
const TRIANGLE_BYTES: u64 = 12 + 4;

/// No texture coordinate, or no normal.
const NONE: u32 = u32::MAX;

/// Statements that change nothing in a picture.
const IGNORED: &[&[u8]] = &[
    b"o",
    b"g",
    b"s",
    b"mg",
    b"lod",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"shadow_obj",
    b"trace_obj",
    b"usemap",
    b"maplib",
    b"vp",
];

/// Free-form curves and surfaces: their statements, of which the first three make something.
const CURVES: &[&[u8]] = &[
    b"curv", b"curv2", b"surf", b"cstype", b"deg", b"bmat", b"step", b"parm", b"trim", b"hole", b"scrv", b"sp", b"end",
    b"con", b"ctech", b"stech", b"bsp", b"bzp", b"cdc", b"cdp", b"res", b"call", b"csh",
];

/// Reads all faces of an OBJ file. `color` is the linear-light colour of what has none in the file. What is left out
/// is appended to `notes`.
///
/// # Errors
/// [`Error::Input`], naming the file, the line, what stands there, and what is allowed.
pub fn read(path: &Path, color: Rgb, notes: &mut Vec<String>) -> Result<Mesh> {
    read_file_at(path, color, notes).map_err(|message| Error::input(path, message))
}

fn read_file_at(path: &Path, color: Rgb, notes: &mut Vec<String>) -> Outcome<Mesh> {
    let (mut reader, size) = open(path)?;
    let mut loader = Loader {
        folder: path.parent().unwrap_or(Path::new("")),
        color,
        notes,
        positions: Vec::new(),
        colors: Vec::new(),
        coordinates: Vec::new(),
        normals: Vec::new(),
        vertices: HashMap::new(),
        mesh: Mesh { name: path.display().to_string(), ..Mesh::default() },
        budget: Budget::new(size),
        triangulator: Triangulator::new(),
        corners: Vec::new(),
        points: Vec::new(),
        libraries: Libraries::default(),
        used: Vec::new(),
        used_names: HashMap::new(),
        current: None,
        materials: HashMap::new(),
        textures: HashMap::new(),
        texels: MOST_TEXELS,
        left_out: LeftOut::default(),
    };
    loader.read(&mut reader)?;
    loader.finish()
}

/// The material libraries.
#[derive(Default)]
struct Libraries {
    /// By their names in the file, before anything is known of them.
    materials: HashMap<Vec<u8>, mtl::Material>,
    /// Those read, or found to be missing.
    met: HashSet<PathBuf>,
    /// Folders to look for textures in, besides that of the OBJ file.
    folders: Vec<PathBuf>,
    bytes: u64,
}

/// How often something was met that will be noted, and the first of it.
#[derive(Default)]
struct Tally {
    count: u64,
    first: String,
}

impl Tally {
    fn add(&mut self, first: impl FnOnce() -> String) {
        if self.count == 0 {
            self.first = first();
        }
        self.count += 1;
    }

    /// The note, if there is something to note: its beginning for one and for several, what the first is called
    /// between them, and the end.
    fn note(&self, one: &str, several: &str, end: &str) -> Option<String> {
        let Self { count, first } = self;
        match count {
            0 => None,
            1 => Some(format!("{one} {first}{end}")),
            _ => Some(format!("{count} {several} {first}{end}")),
        }
    }
}

/// What is left out, noted at the end so that a large file has few notes.
#[derive(Default)]
struct LeftOut {
    points_and_lines: Tally,
    curves: Tally,
    small_faces: Tally,
    unknown: Tally,
    libraries: Tally,
    materials: Tally,
    textures: Tally,
    black: Tally,
    /// Whether a face shows no texture because it has no texture coordinates.
    coordinates: bool,
}

/// A material that faces use.
struct Used {
    /// Linear-light colour without a texture, if the library gives one that is to be used.
    plain: Option<Rgb>,
    /// Linear-light factor of the texture.
    tint: Rgb,
    texture: Option<UsedTexture>,
}

#[derive(Clone, Copy)]
struct UsedTexture {
    /// Index into the mesh's textures.
    index: u32,
    scale: DVec2,
    offset: DVec2,
}

/// A material of the mesh: one of those used (none: no material), and what the face makes of it.
#[derive(PartialEq, Eq, Hash)]
struct MaterialKey {
    used: Option<usize>,
    /// A face without texture coordinates shows no texture.
    textured: bool,
    /// A face with vertex colours and no colour of its own is not given the entry's colour.
    colored: bool,
}

/// What tells vertices of the mesh apart: position, texture coordinate, normal, and the material that changes the
/// texture coordinate.
type VertexKey = [u32; 4];

struct Loader<'a> {
    folder: &'a Path,
    /// For what has no colour in the file.
    color: Rgb,
    notes: &'a mut Vec<String>,
    positions: Vec<DVec3>,
    /// Of the positions up to the last that has one, NaN for those that have none.
    colors: Vec<Rgb>,
    coordinates: Vec<DVec2>,
    normals: Vec<DVec3>,
    vertices: HashMap<VertexKey, u32>,
    mesh: Mesh,
    budget: Budget,
    triangulator: Triangulator,
    /// Of the face that is being read.
    corners: Vec<[u32; 3]>,
    points: Vec<DVec3>,
    libraries: Libraries,
    used: Vec<Used>,
    /// By the names that the file uses, also those that no library has.
    used_names: HashMap<Vec<u8>, Option<usize>>,
    current: Option<usize>,
    materials: HashMap<MaterialKey, u32>,
    /// By file and whether the edge goes on.
    textures: HashMap<(PathBuf, bool), u32>,
    /// Texels that the mesh may still have.
    texels: u64,
    left_out: LeftOut,
}

impl Loader<'_> {
    fn read(&mut self, reader: &mut dyn BufRead) -> Outcome<()> {
        let mut statements = Statements::new(reader);
        while let Some(Statement { line, keyword, rest }) = statements.next()? {
            let done = match keyword {
                b"v" => self.position(rest),
                b"vt" => self.coordinate(rest),
                b"vn" => self.normal(rest),
                // The second is what the first was called before version 3.0.
                b"f" | b"fo" => self.face(rest, line),
                b"usemtl" => self.use_material(rest),
                b"mtllib" => self.library(rest),
                b"p" | b"l" => {
                    self.left_out.points_and_lines.add(|| at_line(line));
                    Ok(())
                }
                _ if IGNORED.contains(&keyword) => Ok(()),
                _ if CURVES.contains(&keyword) => {
                    if CURVES[..3].contains(&keyword) {
                        self.left_out.curves.add(|| at_line(line));
                    }
                    Ok(())
                }
                _ => {
                    self.left_out.unknown.add(|| format!("{} {}", quote(keyword), at_line(line)));
                    Ok(())
                }
            };
            done.map_err(|problem| format!("line {line}: {problem}"))?;
        }
        Ok(())
    }

    fn note(&mut self, what: &str) {
        let note = format!("{}: {what}", self.mesh.name);
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    fn position(&mut self, rest: &[u8]) -> Outcome<()> {
        const ALLOWED: &str = "v x y z, with a weight or a colour r g b";
        let (values, count) = numbers::<6>(rest, ALLOWED)?;
        let [x, y, z, r, g, b] = values;
        match count {
            // The weight is that of rational curves.
            3 | 4 => {}
            6 => {
                // As the programs that write them do: encoded as on a screen, from 0 to 1, by some to 255.
                let most = if [r, g, b].iter().any(|&value| value > 1.0) { 255.0 } else { 1.0 };
                if [r, g, b].iter().any(|value| !(0.0..=most).contains(value)) {
                    return Err(format!("the colour {r} {g} {b}; allowed: three numbers from 0 to 1, or to 255"));
                }
                let color = [r, g, b].map(|value| decode(value / most) as f32);
                self.colors.resize(self.positions.len(), [f32::NAN; 3]);
                self.colors.push(color);
            }
            _ => return Err(format!("`v` with {count} numbers; allowed: {ALLOWED}")),
        }
        self.positions.push(DVec3::new(x, y, z));
        Ok(())
    }

    fn coordinate(&mut self, rest: &[u8]) -> Outcome<()> {
        const ALLOWED: &str = "vt u [v [w]]";
        let (values, count) = numbers::<3>(rest, ALLOWED)?;
        if count == 0 {
            return Err(format!("`vt` without a number; allowed: {ALLOWED}"));
        }
        // Missing ones are 0.
        self.coordinates.push(DVec2::new(values[0], values[1]));
        Ok(())
    }

    fn normal(&mut self, rest: &[u8]) -> Outcome<()> {
        const ALLOWED: &str = "vn x y z";
        match numbers::<3>(rest, ALLOWED)? {
            (values, 3) => {
                // The zero vector, which stands for the triangle's own normal, where there is no direction.
                self.normals.push(DVec3::from_array(values).normalize_or_zero());
                Ok(())
            }
            (_, count) => Err(format!("`vn` with {count} numbers; allowed: {ALLOWED}")),
        }
    }

    fn face(&mut self, rest: &[u8], line: u64) -> Outcome<()> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for field in fields(rest) {
            corners.push(self.corner(field)?);
        }
        let result = if corners.len() < 3 {
            self.left_out.small_faces.add(|| at_line(line));
            Ok(())
        } else {
            self.polygon(&mut corners)
        };
        self.corners = corners;
        result
    }

    /// Position, texture coordinate and normal of v, v/vt, v//vn or v/vt/vn.
    fn corner(&self, field: &[u8]) -> Outcome<[u32; 3]> {
        let counts = [
            ("position", self.positions.len()),
            ("texture coordinate", self.coordinates.len()),
            ("normal", self.normals.len()),
        ];
        let mut corner = [NONE; 3];
        let mut parts = field.split(|&byte| byte == b'/');
        for ((i, slot), (what, count)) in corner.iter_mut().enumerate().zip(counts) {
            match parts.next() {
                None => break,
                Some(b"") if i > 0 => {}
                Some(part) => {
                    let index = std::str::from_utf8(part).ok().and_then(|part| part.parse::<i64>().ok());
                    let index = index.ok_or_else(|| {
                        format!("{} is no corner; allowed: v, v/vt, v//vn, v/vt/vn, each an integer", quote(field))
                    })?;
                    *slot = resolve(index, count).ok_or_else(|| {
                        format!(
                            "{} asks for {what} {index}, and there are {count} up to here; allowed: {}",
                            quote(field),
                            if count == 0 { "none".to_owned() } else { format!("1 to {count}, or -{count} to -1") }
                        )
                    })?;
                }
            }
        }
        if parts.next().is_some() {
            return Err(format!("{} has too many parts; allowed: v, v/vt, v//vn, v/vt/vn", quote(field)));
        }
        Ok(corner)
    }

    /// Adds a polygon of at least three corners.
    fn polygon(&mut self, corners: &mut [[u32; 3]]) -> Outcome<()> {
        self.budget.spend(corners.len() as u64 - 2, TRIANGLE_BYTES)?;
        let texture = self.current.and_then(|used| self.used.get(used)?.texture);
        let textured = texture.is_some() && corners.iter().all(|corner| corner[1] != NONE);
        self.left_out.coordinates |= texture.is_some() && !textured;
        // Where the texture coordinates do not change they are not told apart by the material.
        let changes = |t: &UsedTexture| t.scale != DVec2::ONE || t.offset != DVec2::ZERO;
        let mapping = match (texture.filter(changes), self.current) {
            (Some(_), Some(used)) if textured => u32::try_from(used).map_err(|_| "too many materials".to_owned())?,
            _ => NONE,
        };
        let has_color = |corner: &[u32; 3]| self.colors.get(corner[0] as usize).is_some_and(|color| !color[0].is_nan());
        let colored = !self.colors.is_empty() && corners.iter().any(has_color);
        let material = self.material(MaterialKey { used: self.current, textured, colored })?;

        self.points.clear();
        for corner in corners.iter_mut() {
            let [position, coordinate, normal] = *corner;
            let Some(&point) = self.positions.get(position as usize) else { continue };
            self.points.push(point);
            let key = [position, if textured { coordinate } else { NONE }, normal, mapping];
            // The corner's first number is now that of the mesh's vertex.
            corner[0] = self.vertex(key, point, texture)?;
        }
        let mesh = &mut self.mesh;
        self.triangulator.triangulate(&self.points, |triangle| {
            mesh.corners.push(triangle.map(|i| corners[i][0]));
            mesh.triangle_materials.push(material);
        });
        Ok(())
    }

    /// The mesh's vertex for what the file has told apart.
    fn vertex(&mut self, key: VertexKey, point: DVec3, texture: Option<UsedTexture>) -> Outcome<u32> {
        let entry = match self.vertices.entry(key) {
            Entry::Occupied(entry) => return Ok(*entry.get()),
            Entry::Vacant(entry) => entry,
        };
        self.budget.spend(1, VERTEX_BYTES + TABLE_BYTES)?;
        let mesh = &mut self.mesh;
        let old = mesh.positions.len();
        let index = u32::try_from(old).map_err(|_| "has too many vertices".to_owned())?;
        let [position, coordinate, normal, _] = key.map(|i| i as usize);
        mesh.positions.push(point);
        // Arrays stay empty until something is to be in them.
        let normal = self.normals.get(normal).copied();
        if normal.is_some() || !mesh.normals.is_empty() {
            mesh.normals.resize(old, DVec3::ZERO);
            mesh.normals.push(normal.unwrap_or(DVec3::ZERO));
        }
        let coordinate = match (self.coordinates.get(coordinate), texture) {
            (Some(&uv), Some(texture)) => {
                let uv = uv * texture.scale + texture.offset;
                // v points up in the file.
                let uv = DVec2::new(uv.x, 1.0 - uv.y);
                if !uv.is_finite() {
                    return Err("a texture coordinate is too large".to_owned());
                }
                Some(uv)
            }
            _ => None,
        };
        if coordinate.is_some() || !mesh.texture_coordinates.is_empty() {
            mesh.texture_coordinates.resize(old, DVec2::ZERO);
            mesh.texture_coordinates.push(coordinate.unwrap_or(DVec2::ZERO));
        }
        let color = self.colors.get(position).copied().filter(|color| !color[0].is_nan());
        if color.is_some() || !mesh.colors.is_empty() {
            mesh.colors.resize(old, [1.0; 3]);
            mesh.colors.push(color.unwrap_or([1.0; 3]));
        }
        Ok(*entry.insert(index))
    }

    fn material(&mut self, key: MaterialKey) -> Outcome<u32> {
        if let Some(&material) = self.materials.get(&key) {
            return Ok(material);
        }
        let absent = if key.colored { [1.0; 3] } else { self.color };
        let material = match key.used.and_then(|used| self.used.get(used)) {
            Some(Used { tint, texture: Some(texture), .. }) if key.textured => {
                Material { color: *tint, texture: Some(texture.index), unlit: false }
            }
            Some(used) => Material { color: used.plain.unwrap_or(absent), texture: None, unlit: false },
            None => Material { color: absent, texture: None, unlit: false },
        };
        let index = u32::try_from(self.mesh.materials.len()).map_err(|_| "has too many materials".to_owned())?;
        self.mesh.materials.push(material);
        self.materials.insert(key, index);
        Ok(index)
    }

    fn use_material(&mut self, rest: &[u8]) -> Outcome<()> {
        if let Some(&known) = self.used_names.get(rest) {
            self.current = known;
            return Ok(());
        }
        let materials = &self.libraries.materials;
        // A name may hold what looks like a comment.
        let name = if materials.contains_key(rest) { rest } else { uncommented(rest) };
        self.current = match materials.get(name) {
            None => {
                // Missing libraries have been noted; every material would be missing too.
                if !materials.is_empty() {
                    self.left_out.materials.add(|| quote(name));
                }
                None
            }
            Some(material) => {
                let plain = material.color;
                let map = material.map.as_ref().map(|map| (map.file.clone(), map.scale, map.offset, map.clamp));
                let used = match map {
                    None => Used { plain, tint: [1.0; 3], texture: None },
                    Some((file, scale, offset, clamp)) => {
                        let texture = self.texture(&file, clamp, name)?;
                        if texture.is_some() && plain == Some([0.0; 3]) {
                            self.left_out.black.add(|| quote(name));
                        }
                        // Beside a texture, the colour is but a factor: white says nothing.
                        let plain = if texture.is_some() { plain } else { None };
                        let texture = texture.map(|index| UsedTexture { index, scale, offset });
                        Used { plain, tint: plain.unwrap_or([1.0; 3]), texture }
                    }
                };
                self.used.push(used);
                Some(self.used.len() - 1)
            }
        };
        self.used_names.insert(rest.to_vec(), self.current);
        Ok(())
    }

    /// The mesh's texture from that file; none, with a note, if it is not there.
    fn texture(&mut self, file: &str, clamp: bool, material: &[u8]) -> Outcome<Option<u32>> {
        let folders = std::iter::once(self.folder).chain(self.libraries.folders.iter().map(PathBuf::as_path));
        let Some(path) = find(file, folders) else {
            let what = || format!("{} of material {}", quote(file.as_bytes()), quote(material));
            self.left_out.textures.add(what);
            return Ok(None);
        };
        let key = (path, clamp);
        if let Some(&texture) = self.textures.get(&key) {
            return Ok(Some(texture));
        }
        let wrap = [if clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
        let texture = read_texture(&key.0, wrap, self.texels)?;
        self.texels = self.texels.saturating_sub(texture.texels.len() as u64);
        let index = u32::try_from(self.mesh.textures.len()).map_err(|_| "has too many textures".to_owned())?;
        self.mesh.textures.push(texture);
        self.textures.insert(key, index);
        Ok(Some(index))
    }

    fn library(&mut self, rest: &[u8]) -> Outcome<()> {
        let all = String::from_utf8_lossy(uncommented(rest)).into_owned();
        if all.is_empty() {
            return Err("`mtllib` without a name; allowed: mtllib FILE.mtl".to_owned());
        }
        // One name with spaces in it, if there is such a file; else several names, each with its extension.
        let names = if find(&all, std::iter::once(self.folder)).is_some() { vec![all] } else { library_names(&all) };
        for name in names {
            let path = find(&name, std::iter::once(self.folder)).unwrap_or_else(|| self.folder.join(&name));
            if !self.libraries.met.insert(path.clone()) {
                continue;
            }
            if !path.exists() {
                self.left_out.libraries.add(|| quote(name.as_bytes()));
                continue;
            }
            let fail = |e: String| format!("material library {}: {e}", path.display());
            let (mut reader, size) = open(&path).map_err(fail)?;
            self.libraries.bytes = self.libraries.bytes.saturating_add(size);
            if self.libraries.bytes > LIBRARY_BYTES {
                return Err(fail(format!("is too large; allowed: {LIBRARY_BYTES} bytes in all libraries of the file")));
            }
            let mut notes = Vec::new();
            let note = |what: &str| {
                if !notes.iter().any(|known| known == what) {
                    notes.push(what.to_owned());
                }
            };
            mtl::read(&mut reader, &mut self.libraries.materials, note).map_err(fail)?;
            notes.iter().for_each(|what| self.note(what));
            if let Some(folder) = path.parent()
                && folder != self.folder
                && !self.libraries.folders.iter().any(|known| known == folder)
            {
                self.libraries.folders.push(folder.to_owned());
            }
        }
        Ok(())
    }

    fn finish(mut self) -> Outcome<Mesh> {
        let left_out = std::mem::take(&mut self.left_out);
        if self.mesh.corners.is_empty() {
            return Err(if left_out.unknown.count > 0 {
                format!("holds no faces (`f`), and what no OBJ file has: {}", left_out.unknown.first)
            } else if left_out.points_and_lines.count + left_out.curves.count > 0 {
                "holds no faces (`f`); points, lines, curves and surfaces are not shown".to_owned()
            } else {
                "holds no faces (`f`)".to_owned()
            });
        }
        const ENTRY: &str = ": the entry's colour is used";
        let LeftOut { points_and_lines, curves, small_faces, unknown, libraries, materials, textures, .. } = &left_out;
        let notes = [
            points_and_lines.note(
                "one statement of points or lines is left out,",
                "statements of points or lines are left out, the first",
                "",
            ),
            curves.note(
                "one free-form curve or surface is left out,",
                "free-form curves and surfaces are left out, the first",
                "",
            ),
            small_faces.note(
                "one face of less than three corners is left out,",
                "faces of less than three corners are left out, the first",
                "",
            ),
            unknown.note("one unknown statement is left out:", "unknown statements are left out, the first:", ""),
            libraries.note("there is no material library", "material libraries are not there, the first:", ENTRY),
            materials.note("there is no material", "materials are in no library, the first:", ENTRY),
            textures.note("there is no texture", "textures are not there, the first:", ENTRY),
            left_out.black.note(
                "a black Kd makes the texture black of material",
                "materials have a black Kd, which makes their textures black, the first:",
                "",
            ),
        ];
        notes.iter().flatten().for_each(|what| self.note(what));
        if left_out.coordinates {
            self.note("a texture is left out where its texture coordinates are missing");
        }
        if self.triangulator.given_up > 0 {
            let count = self.triangulator.given_up;
            self.note(&format!("{count} polygons have too many corners to be cut properly and became fans"));
        }
        Ok(self.mesh)
    }
}

fn at_line(line: u64) -> String {
    format!("in line {line}")
}

/// Up to N numbers, and how many there are; an error for more.
fn numbers<const N: usize>(rest: &[u8], allowed: &str) -> Outcome<([f64; N], usize)> {
    let mut values = [0.0; N];
    let mut count = 0;
    for field in fields(rest) {
        let slot = values.get_mut(count).ok_or_else(|| format!("more than {N} numbers; allowed: {allowed}"))?;
        *slot = number(field)?;
        count += 1;
    }
    Ok((values, count))
}

/// An index from 0, of one from 1 or, counting backwards, from -1.
fn resolve(index: i64, count: usize) -> Option<u32> {
    let index = if index < 0 { i64::try_from(count).ok()?.checked_add(index)? } else { index - 1 };
    let found = usize::try_from(index).ok().filter(|&index| index < count)?;
    // The last number is none.
    u32::try_from(found).ok().filter(|&index| index != NONE)
}

/// `a.mtl b c.mtl` as `a.mtl` and `b c.mtl`.
fn library_names(all: &str) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let mut open = false;
    for word in all.split_ascii_whitespace() {
        match names.last_mut().filter(|_| open) {
            Some(name) => {
                name.push(' ');
                name.push_str(word);
            }
            None => names.push(word.to_owned()),
        }
        open = !word.to_ascii_lowercase().ends_with(".mtl");
    }
    names
}
