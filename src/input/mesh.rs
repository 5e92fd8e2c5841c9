//! Meshes as a scene file describes them.

use crate::scene::Rgb;
use glam::DVec3;
use std::path::PathBuf;

/// One `[[mesh]]` entry.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshEntry {
    /// The mesh file.
    pub file: PathBuf,
    /// Translation, applied last.
    pub position: DVec3,
    /// Rotation about x, y and z, degrees.
    pub rotation_deg: DVec3,
    /// Scale factor, > 0.
    pub scale: f64,
    /// Linear-light colour where the file has none.
    pub color: Rgb,
}
