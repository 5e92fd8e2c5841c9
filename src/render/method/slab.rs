//! `slab`: slabs of depth that hold optical depth. Ours.
//!
//! Planes of constant depth, the same for both eyes, cut the gas into K slabs of equal thickness. Slab k holds, for every
//! ray, the optical depth of its gas from the closed forms, tau_k = sum_i tau_ik, and the colour-weighted q_k = sum_i
//! tau_ik c_i, each particle's segment clipped to its ball, the near plane and the opaque surface. Within a slab everything
//! mixes: it has the colour q_k / tau_k. Front to back, with T_k = exp(-(tau_0 + ... + tau_(k-1))),
//!
//! L = sum_k (T_k - T_(k+1)) q_k / tau_k + T_K background.
//!
//! No order of particles is asked for, nothing pops, and overlapping particles mix.
//!
//! Error: none in the transmittance, whatever K. That of the colour is of second order in the thickness once slabs are
//! thinner than the kernels' standard deviation; with one colour it is 0 for K = 1. Slabs merge by adding: the same pass gives
//! the picture of K/2 slabs, and |L_K - L_K/2| / 3 estimates the error of L_K at every pixel. It is an estimate and no bound.
//! `richardson` shows (4 L_K - L_K/2) / 3 instead, of higher order where densities are smooth and slabs thin. It may leave
//! the range of the colours by its error. Its own estimate is the difference of the extrapolations from K and K/2 and from
//! K/2 and K/4, over 15.

use crate::error::Result;
use crate::render::cpu::slab::{self, Cut};
use crate::render::gpu::{self, Gpu};
use crate::render::{Frame, GpuPath, GpuRenderer, Progress, Renderer, Statistics};
use crate::scene::{Scene, stereo};

/// How the gas is cut into slabs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Number of slabs K, 1 to [`Parameters::MAX_SLABS`]; absent: see [`Parameters::count`].
    pub slabs: Option<u32>,
    /// Whether the picture is the extrapolation from K and K/2 slabs.
    pub richardson: bool,
}

impl Parameters {
    /// As many slabs as the gas asks for, no extrapolation.
    pub const DEFAULT: Self = Self { slabs: None, richardson: false };

    /// Most slabs.
    pub const MAX_SLABS: u32 = 4096;

    /// Least and greatest number of slabs that is chosen.
    const CHOSEN: [f64; 2] = [8.0, 512.0];

    /// The number of slabs: as given, or so many that a slab is no thicker than a sixth of the median radius (half the
    /// standard deviation of a Gaussian particle), from 8 to 512.
    pub fn count(&self, scene: &Scene) -> u32 {
        self.slabs.unwrap_or_else(|| {
            // Along the axis between the eyes, so that both have the same number.
            let cyclopean = &stereo::views(&scene.camera, None)[0];
            let count = match (slab::extent(scene, cyclopean), super::median_radius(scene)) {
                (Some([near, far]), Some(radius)) => 6.0 * (far - near) / radius,
                (None, _) | (_, None) => 1.0,
            };
            count.ceil().clamp(Self::CHOSEN[0], Self::CHOSEN[1]) as u32
        })
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Renderer for Parameters {
    fn supports(&self, _: &Scene) -> Result<()> {
        Ok(())
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        let cut = Cut::Equidistant { slabs: self.count(frame.scene), richardson: self.richardson };
        slab::draw(cut, frame, progress)
    }

    fn on_gpu(&self) -> Option<&dyn GpuRenderer> {
        Some(self)
    }
}

impl GpuRenderer for Parameters {
    fn paths(&self) -> &'static [GpuPath] {
        &[GpuPath::Compute]
    }

    fn draw(&self, gpu: &mut Gpu, _: GpuPath, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
        gpu::slab::draw(self.count(frame.scene), self.richardson, gpu, frame, progress)
    }
}
