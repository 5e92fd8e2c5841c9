//! Opaque triangle meshes, in world space.

use glam::{DVec2, DVec3};

/// An opaque triangle mesh. Invariants: `corners` are three per triangle; every index is in range; numbers are finite.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// The name that messages use, usually the file's.
    pub name: String,
    /// World-space vertex positions.
    pub positions: Vec<DVec3>,
    /// World-space unit normals, one per vertex, or empty: each triangle then has its own. A triangle with a zero vector
    /// at one of its corners has its own too.
    pub normals: Vec<DVec3>,
    /// Texture coordinates, one per vertex, or empty. (0, 0) is the top left corner of the texture, as in glTF.
    pub texture_coordinates: Vec<DVec2>,
    /// Linear-light vertex colours, one per vertex, or empty: white.
    pub colors: Vec<[f32; 3]>,
    /// Vertex indices, three per triangle.
    pub corners: Vec<[u32; 3]>,
    /// Material of each triangle, an index into `materials`.
    pub triangle_materials: Vec<u32>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Textures the materials refer to.
    pub textures: Vec<Texture>,
}

/// How a surface is coloured: base colour x vertex colour x texture, then Lambert |n.l| unless `unlit`.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear-light base colour.
    pub color: [f32; 3],
    /// Index into [`Mesh::textures`].
    pub texture: Option<u32>,
    /// Shown as it is, without the cosine (glTF's `KHR_materials_unlit`).
    pub unlit: bool,
}

/// A picture on a surface, looked up with bilinear filtering in linear light.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Width in texels, > 0.
    pub width: u32,
    /// Height in texels, > 0.
    pub height: u32,
    /// Row-major linear-light texels, row 0 on top, `width * height` of them.
    pub texels: Vec<[f32; 3]>,
    /// Behaviour outside [0, 1] in u and in v.
    pub wrap: [Wrap; 2],
}

/// What a texture shows outside [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The texture again.
    Repeat,
    /// The texture mirrored.
    Mirror,
    /// The texture's edge.
    Clamp,
}
