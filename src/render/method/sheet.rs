//! `sheet`: the image-aligned sheet buffer (Beliaev & Zaytseva, Modeling of fuzzy natural phenomena with particle system,
//! after Mueller & Crawfis, Eliminating popping artifacts in sheet buffer-based splatting, IEEE Visualization 1998).
//!
//! Space is cut into slices parallel to the image, the first of them at the near plane, the same for both eyes with parallel
//! axes. What of a particle lies in a slice, its segment, comes from a table of pre-integrated segments of its kernel. Within
//! a slice segments mix: the opacity of one is T0 times its share of the integral through the centre, opacities are added,
//! and colours weighted with them. A sum above 1 becomes 1, its colour scaled with it. Slices are composited. What is before
//! the near plane or behind an opaque surface is cut off, as finely as the table is read.
//!
//! A segment is a splat: a disc parallel to the image at the depth of the particle's centre (of the near plane where that is
//! farther), integrated along z. The paper's table holds the segments for one ratio of slice and radius; this one holds them
//! between planes through the ball, so that one table serves every radius and width.
//!
//! Error: of first order in the width of a slice, from opacity taken for optical depth and from segments that mix where one
//! is behind the other. Particles no longer swap places at once (colour popping), but when they move through the slices
//! their segments do, by little. Off the optical axis and close by, footprint and parallax err as `viewplane`'s do.

use crate::error::{Error, Result};
use crate::render::cpu::sheet::{self, Slicing};
use crate::render::gpu::{self, Gpu};
use crate::render::{Frame, GpuPath, GpuRenderer, Progress, Renderer, Statistics};
use crate::scene::Scene;

pub use crate::render::cpu::segments::Lookup;

/// Most slices that a particle may span, and to the farthest one from the near plane.
const MOST_OF_A_PARTICLE: f64 = 65_536.0;
const MOST_IN_ALL: f64 = 4_503_599_627_370_496.0;

/// How the gas is sliced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Width of a slice in scene units, > 0; absent: half the median radius, as in Beliaev & Zaytseva.
    pub slice_width: Option<f64>,
    /// Number of pre-integrated kernel segments, 2 to [`Parameters::MAX_SEGMENTS`].
    pub segments: u32,
    /// How a segment is looked up.
    pub lookup: Lookup,
}

impl Parameters {
    /// Beliaev & Zaytseva's.
    pub const DEFAULT: Self = Self { slice_width: None, segments: 128, lookup: Lookup::Interpolated };

    /// Most segments of the table.
    pub const MAX_SEGMENTS: u32 = 4096;

    /// The width of a slice in scene units, > 0: as given, or half the median radius of the scene's particles (of an even
    /// number the upper of the two in the middle); 1 without particles.
    pub fn width(&self, scene: &Scene) -> f64 {
        self.slice_width.unwrap_or_else(|| super::median_radius(scene).map_or(1.0, |radius| 0.5 * radius))
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The method.
pub(super) struct Sheet(pub Parameters);

impl Sheet {
    fn slicing(&self, scene: &Scene) -> Slicing {
        let Parameters { segments, lookup, .. } = self.0;
        Slicing { width: self.0.width(scene), segments, lookup }
    }
}

impl Renderer for Sheet {
    fn supports(&self, scene: &Scene) -> Result<()> {
        let width = self.0.width(scene);
        let refuse = |set: usize, i: usize, least: f64| {
            Err(Error::Usage(format!(
                "method `sheet`: particle {i} of set {} would need more slices of width {width} than can be drawn; \
                 allowed for this scene: a slice_width of at least {least:.3e}",
                set + 1
            )))
        };
        // The width that every particle can be drawn with, and the one that asks most.
        let camera = &scene.camera;
        let mut worst = (0.0, 0, 0);
        for (number, set) in scene.particles.iter().enumerate() {
            for i in 0..set.len() {
                let radius = set.radius.get(i);
                // No depth, from whichever eye, is greater than the distance from the camera and half the eyes'.
                let distance = (glam::DVec3::new(set.x[i], set.y[i], set.z[i]) - camera.position).length();
                let far = distance + radius + scene.stereo.as_ref().map_or(0.0, |stereo| stereo.interocular);
                let least = f64::max(2.0 * radius / MOST_OF_A_PARTICLE, far / MOST_IN_ALL);
                if least > worst.0 {
                    worst = (least, number, i);
                }
            }
        }
        if width < worst.0 { refuse(worst.1, worst.2, worst.0) } else { Ok(()) }
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        sheet::draw(self.slicing(frame.scene), frame, progress)
    }

    fn on_gpu(&self) -> Option<&dyn GpuRenderer> {
        Some(self)
    }
}

impl GpuRenderer for Sheet {
    fn paths(&self) -> &'static [GpuPath] {
        &[GpuPath::Compute]
    }

    fn draw(&self, gpu: &mut Gpu, _: GpuPath, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
        gpu::sheet::draw(self.slicing(frame.scene), gpu, frame, progress)
    }
}
