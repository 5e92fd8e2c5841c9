//! Opaque meshes: one layer of colour and depth per view, sampled at pixel centres in f64.

use crate::scene::{Rgb, Scene, View};

/// Colour and depth of the nearest opaque surface per pixel of one view. Shared by every method, device and reference.
#[derive(Clone, Debug, Default)]
pub struct OpaqueLayer {
    /// Row-major depths in scene units, infinity where the ray meets no surface.
    pub depth: Vec<f64>,
    /// Row-major linear-light colours; meaningless where depth is infinite.
    pub color: Vec<Rgb>,
}
