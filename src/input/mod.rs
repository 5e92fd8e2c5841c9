//! FROM WHERE: scene files, particle files, mesh files.

pub mod gltf;
pub mod mesh;
