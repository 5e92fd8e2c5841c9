//! Mesh files: which reader reads which file, and where the mesh stands in the world.

use crate::error::{Error, Result};
use crate::scene::{Mesh, Rgb};
use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};

/// A mesh as a scene asks for it: a file and a place in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshEntry {
    /// The file, as it can be opened from here; its extension names the format.
    pub file: PathBuf,
    /// World-space position of the file's origin.
    pub position: DVec3,
    /// Rotation about the world's x axis, then y, then z, degrees.
    pub rotation_deg: DVec3,
    /// Uniform scale, applied before the rotation.
    pub scale: f64,
    /// Linear-light colour of what has none in the file.
    pub color: Rgb,
}

impl MeshEntry {
    /// The file at the world's origin, as large as it says, grey where it has no colour.
    pub fn new(file: impl Into<PathBuf>) -> Self {
        Self { file: file.into(), position: DVec3::ZERO, rotation_deg: DVec3::ZERO, scale: 1.0, color: [0.6; 3] }
    }

    /// The rotation R = Rz Ry Rx of `rotation_deg`.
    pub fn rotation(&self) -> DMat3 {
        let [x, y, z] = self.rotation_deg.to_array().map(f64::to_radians);
        DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x)
    }
}

/// A mesh format.
#[derive(Debug)]
pub struct MeshReader {
    /// Name of the format in messages.
    pub name: &'static str,
    /// Extensions without the dot, lower case.
    pub extensions: &'static [&'static str],
    /// One line for `--help`.
    pub help: &'static str,
    /// Reads a file into the file's own space. The colour is for what has none in the file; what is left out is noted.
    pub read: fn(&Path, Rgb, &mut Vec<String>) -> Result<Mesh>,
}

/// Every mesh format there is.
pub const MESH_READERS: &[MeshReader] = &[
    MeshReader {
        name: "glTF",
        extensions: &["gltf", "glb"],
        help: "glTF 2.0, .gltf with its .bin and pictures or .glb: triangles, base colours and textures",
        read: super::gltf::read,
    },
    MeshReader {
        name: "OBJ",
        extensions: &["obj"],
        help: "Wavefront OBJ with its .mtl and pictures: polygons, diffuse colours and textures, vertex colours",
        read: super::obj::read,
    },
    MeshReader {
        name: "PLY",
        extensions: &["ply"],
        help: "PLY with faces, ascii or binary: polygons, vertex colours and a texture",
        read: super::ply::read_mesh,
    },
];

/// A result whose error says what is wrong; the caller adds the file.
pub(super) type Outcome<T> = std::result::Result<T, String>;

/// Bytes of a vertex with all its attributes in [`Mesh`].
pub(super) const VERTEX_BYTES: u64 = 24 + 24 + 16 + 12;

/// Bytes that a mesh of any file may take. A file can show the same vertices again and again, so that its size alone
/// bounds nothing; a larger file may take [`GROWTH`] times its size.
const MESH_BYTES: u64 = 384 << 20;

/// How many times the size of its file a mesh may take. Vertices of three floats that are used once take at most
/// 76 / 12 times.
const GROWTH: u64 = 8;

/// What the mesh of one file may still take of the memory.
pub(super) struct Budget {
    left: u64,
}

impl Budget {
    /// For a file of that many bytes.
    pub(super) fn new(bytes: u64) -> Self {
        Self { left: MESH_BYTES.max(bytes.saturating_mul(GROWTH)) }
    }

    /// Takes room for `count` things of `each` bytes.
    pub(super) fn spend(&mut self, count: u64, each: u64) -> Outcome<()> {
        let left = count.checked_mul(each).and_then(|bytes| self.left.checked_sub(bytes));
        self.left = left.ok_or_else(|| {
            format!("is too large: {count} more vertices or indices would exceed the memory allowed for this file")
        })?;
        Ok(())
    }
}

/// Coordinates beyond this are refused: products of three of them must stay finite in f64.
const LARGEST_COORDINATE: f64 = 1e75;

/// Reads a mesh and puts it into the world, p_world = R (scale p) + position. See [`load_mesh_noting`].
pub fn load_mesh(entry: &MeshEntry) -> Result<Mesh> {
    load_mesh_noting(entry, &mut Vec::new())
}

/// Reads a mesh and puts it into the world, p_world = R (scale p) + position; appends a note for everything in the
/// file that is left out.
///
/// # Errors
/// [`Error::Input`] for an unknown extension, a file that cannot be read or understood, or a mesh that ends up outside
/// of the numbers that can be rendered.
pub fn load_mesh_noting(entry: &MeshEntry, notes: &mut Vec<String>) -> Result<Mesh> {
    let path = entry.file.as_path();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let Some(reader) = MESH_READERS.iter().find(|reader| reader.extensions.contains(&extension.as_str())) else {
        let known: Vec<String> =
            MESH_READERS.iter().flat_map(|reader| reader.extensions).map(|extension| format!(".{extension}")).collect();
        return Err(Error::input(path, format!("not a known mesh format; known: {}", known.join(", "))));
    };
    let mut mesh = (reader.read)(path, entry.color, notes)?;
    let rotation = entry.rotation();
    for point in &mut mesh.positions {
        *point = rotation * (*point * entry.scale) + entry.position;
    }
    for normal in &mut mesh.normals {
        *normal = rotation * *normal;
    }
    let outside = |p: &DVec3| !p.is_finite() || p.abs().max_element() > LARGEST_COORDINATE;
    if let Some(i) = mesh.positions.iter().position(outside) {
        return Err(Error::input(
            path,
            format!(
                "vertex {i} stands at {} in the world; allowed: coordinates within +-{LARGEST_COORDINATE:e}",
                mesh.positions[i]
            ),
        ));
    }
    Ok(mesh)
}
