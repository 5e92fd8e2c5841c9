//! Meshes from PLY files: vertices with normals, colours and texture coordinates, and faces.
//!
//! Vertex properties: x y z; nx ny nz; red green blue, r g b or diffuse_red ... (uchar: sRGB-encoded, else linear light);
//! s t, u v or texture_u texture_v, with v up and the picture that a comment `TextureFile` names. Faces: the list
//! vertex_indices or vertex_index, polygons of any number of corners.

use super::faces::Faces;
use super::header::{Element, Header};
use super::rows::read_rows;
use crate::error::{Error, Result};
use crate::input::columns::{Column, ReadError, quote, reserve};
use crate::input::file::{find, open};
use crate::input::mesh::{Budget, Outcome};
use crate::input::polygon::Triangulator;
use crate::input::scalar::Scalar;
use crate::input::source::Source;
use crate::input::texture::{MOST_TEXELS, read_texture};
use crate::picture::color::decode_u8;
use crate::scene::Rgb;
use crate::scene::mesh::{Material, Mesh, Texture, Wrap};
use glam::{DVec2, DVec3};
use std::path::Path;

/// The element that has the faces.
pub(super) const FACE: &str = "face";
/// The element that has triangle strips instead.
const STRIPS: &str = "tristrips";

const POSITION: [&str; 3] = ["x", "y", "z"];
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
const COLORS: &[[&str; 3]] =
    &[["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
const COORDINATES: &[[&str; 2]] = &[["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
/// Texture coordinates of the corners of a face.
const CORNER_COORDINATES: &str = "texcoord";

/// Bytes of a triangle in [`Mesh`].
const TRIANGLE_BYTES: u64 = 12 + 4;

/// Reads the faces of a PLY file. `color` is the linear-light colour of what has none in the file. What is left out is
/// appended to `notes`.
///
/// # Errors
/// [`Error::Input`], naming the file, the line or byte, and what is allowed.
pub fn read(path: &Path, color: Rgb, notes: &mut Vec<String>) -> Result<Mesh> {
    let fail = |message: String| Error::input(path, message);
    let (mut reader, size) = open(path).map_err(fail)?;
    let mut note = |what: &str| notes.push(format!("{}: {what}", path.display()));
    let mut source = Source::new(&mut reader);
    let mut mesh = read_mesh(&mut source, size, path, color, &mut note).map_err(|e| fail(e.to_string()))?;
    mesh.name = path.display().to_string();
    Ok(mesh)
}

fn read_mesh(
    source: &mut Source,
    size: u64,
    path: &Path,
    color: Rgb,
    note: &mut dyn FnMut(&str),
) -> Result<Mesh, ReadError> {
    let header = Header::read(source)?;
    let start = source.byte;
    header.check_size(start, Some(size))?;
    let (before, vertex) = header.vertex()?;
    let behind = header.elements.get(before.len() + 1..).unwrap_or_default();
    let find = |elements: &[Element], name| elements.iter().position(|e| e.name == name && e.count > 0);
    let strips = find(&header.elements, STRIPS).is_some();
    let Some(at) = find(behind, FACE) else {
        return Err(ReadError::content(if find(before, FACE).is_some() {
            "the element `face` stands before the element `vertex`; allowed: after it"
        } else if strips {
            "its triangle strips (element `tristrips`) are not supported; allowed: an element `face`"
        } else {
            "holds no faces, so it is no mesh: use it under [[particles]]"
        }));
    };
    let (between, rest) = behind.split_at(at);
    let face = rest.first().map_or_else(|| Err(ReadError::content("no element `face`")), Ok)?;
    let faces = Faces::new(face, vertex.count)?;
    if strips {
        note("triangle strips (element `tristrips`) are left out");
    }
    if face.properties.iter().any(|property| property.name == CORNER_COORDINATES) {
        note("texture coordinates of faces (`texcoord`) are left out; allowed: of vertices (s t, u v)");
    }
    if COLORS.iter().any(|names| face.has_scalars(names)) {
        note("colours of faces are left out; allowed: of vertices");
    }

    let budget = Budget::new(size);
    let texture = texture(&header, vertex, path, note).map_err(ReadError::content)?;
    let mut mesh = Mesh::default();
    let mut loader = Loader { mesh: &mut mesh, budget };
    before.iter().try_for_each(|element| element.skip(source, header.format))?;
    loader.vertices(source, &header, vertex, texture.is_some())?;
    between.iter().try_for_each(|element| element.skip(source, header.format))?;

    let mesh = &mut *loader.mesh;
    // No more than fit into the file: a count that lies allocates nothing.
    let room = face.count.min(size / faces.smallest(header.format));
    loader.budget.spend(room, TRIANGLE_BYTES).map_err(ReadError::content)?;
    let room = usize::try_from(room).map_err(|_| ReadError::content("has too many faces"))?;
    reserve(&mut mesh.corners, room)?;
    let mut triangulator = Triangulator::new();
    let mut points = Vec::new();
    let mut small = 0_u64;
    faces.read(source, header.format, |corners| {
        if let &[a, b, c] = corners {
            mesh.corners.push([a, b, c]);
            return Ok(());
        }
        if corners.len() < 3 {
            small += 1;
            return Ok(());
        }
        // The first of its triangles has been paid for as a face.
        loader.budget.spend(corners.len() as u64 - 3, TRIANGLE_BYTES).map_err(ReadError::content)?;
        points.clear();
        points.extend(corners.iter().filter_map(|&corner| mesh.positions.get(corner as usize).copied()));
        triangulator.triangulate(&points, |triangle| mesh.corners.push(triangle.map(|i| corners[i])));
        Ok(())
    })?;
    if mesh.corners.is_empty() {
        return Err(ReadError::content("none of its faces has three corners"));
    }
    if small > 0 {
        note(&format!("{small} faces of less than three corners are left out"));
    }
    if triangulator.given_up > 0 {
        let count = triangulator.given_up;
        note(&format!("{count} polygons have too many corners to be cut properly and became fans"));
    }
    let count = mesh.corners.len();
    reserve(&mut mesh.triangle_materials, count)?;
    mesh.triangle_materials.resize(count, 0);
    let own = texture.is_some() || !mesh.colors.is_empty();
    mesh.textures.extend(texture);
    let texture = if mesh.textures.is_empty() { None } else { Some(0) };
    mesh.materials.push(Material { color: if own { [1.0; 3] } else { color }, texture, unlit: false });
    Ok(std::mem::take(mesh))
}

/// The picture that a comment names, if it is there and the vertices have coordinates for it.
fn texture(header: &Header, vertex: &Element, path: &Path, note: &mut dyn FnMut(&str)) -> Outcome<Option<Texture>> {
    let Some(name) = header.textures.first() else { return Ok(None) };
    if coordinate_names(vertex).is_none() {
        note("a texture is left out where its texture coordinates are missing");
        return Ok(None);
    }
    if header.textures.len() > 1 {
        note(&format!("of {} textures the first is used", header.textures.len()));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    match find(name, std::iter::once(folder)) {
        Some(path) => read_texture(&path, [Wrap::Repeat; 2], MOST_TEXELS).map(Some),
        None => {
            note(&format!("there is no texture {}", quote(name.as_bytes())));
            Ok(None)
        }
    }
}

fn coordinate_names(vertex: &Element) -> Option<[&'static str; 2]> {
    COORDINATES.iter().copied().find(|names| vertex.has_scalars(names))
}

struct Loader<'a> {
    mesh: &'a mut Mesh,
    budget: Budget,
}

impl Loader<'_> {
    fn vertices(
        &mut self,
        source: &mut Source,
        header: &Header,
        vertex: &Element,
        textured: bool,
    ) -> Result<(), ReadError> {
        if !vertex.has_scalars(&POSITION) {
            let names: Vec<String> = vertex.scalars().map(|(name, _)| format!("`{name}`")).collect();
            let found = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            return Err(ReadError::content(format!("the vertices have no x, y and z; their properties: {found}")));
        }
        let normals = Some(NORMAL).filter(|names| vertex.has_scalars(names));
        let colors = COLORS.iter().copied().find(|names| vertex.has_scalars(names));
        let coordinates = coordinate_names(vertex).filter(|_| textured);
        let mesh = &mut *self.mesh;
        let too_many = |_| ReadError::content("has too many vertices");
        let count = usize::try_from(vertex.count).map_err(too_many)?;
        let mut spend = |wanted: bool, bytes| {
            if wanted { self.budget.spend(vertex.count, bytes).map_err(ReadError::content) } else { Ok(()) }
        };
        spend(true, 24)?;
        reserve(&mut mesh.positions, count)?;
        spend(normals.is_some(), 24)?;
        reserve(&mut mesh.normals, if normals.is_some() { count } else { 0 })?;
        spend(colors.is_some(), 12)?;
        reserve(&mut mesh.colors, if colors.is_some() { count } else { 0 })?;
        spend(coordinates.is_some(), 16)?;
        reserve(&mut mesh.texture_coordinates, if coordinates.is_some() { count } else { 0 })?;

        let names = POSITION.iter().chain(normals.iter().flatten()).chain(colors.iter().flatten());
        let wanted: Vec<&str> = names.chain(coordinates.iter().flatten()).copied().collect();
        let mut columns: Vec<Column> = vertex
            .scalars()
            .filter(|(name, _)| wanted.contains(name))
            .map(|(name, scalar)| Column { name: name.to_owned(), values: Vec::new(), byte: scalar == Scalar::U8 })
            .collect();
        let index = |name: &str| columns.iter().position(|column| column.name == name).unwrap_or_default();
        let position = POSITION.map(index);
        let normals = normals.map(|names| names.map(index));
        let coordinates = coordinates.map(|names| names.map(index));
        let colors = colors.map(|names| names.map(index));
        read_rows(vertex, header.format, source, &mut columns, false, &mut |columns, rows| {
            let rows_here = (rows.end - rows.start) as usize;
            let value = |column: usize, row: usize| columns[column].values[row];
            let vector = |names: [usize; 3], row| DVec3::from_array(names.map(|column| value(column, row)));
            mesh.positions.extend((0..rows_here).map(|row| vector(position, row)));
            if let Some(names) = normals {
                // The zero vector, which stands for the triangle's own normal, where there is no direction.
                mesh.normals.extend((0..rows_here).map(|row| vector(names, row).normalize_or_zero()));
            }
            if let Some([u, v]) = coordinates {
                mesh.texture_coordinates
                    .extend((0..rows_here).map(|row| DVec2::new(value(u, row), 1.0 - value(v, row))));
            }
            if let Some(names) = colors {
                for row in 0..rows_here {
                    let color = names.map(|column| {
                        let number = value(column, row);
                        if columns[column].byte { decode_u8(number as u8) } else { number as f32 }
                    });
                    if !color.iter().all(|channel| channel.is_finite()) {
                        let index = rows.start + row as u64;
                        return Err(ReadError::content(format!("the colour of vertex {index} is too large")));
                    }
                    mesh.colors.push(color);
                }
            }
            columns.iter_mut().for_each(|column| column.values.clear());
            Ok(())
        })
    }
}
