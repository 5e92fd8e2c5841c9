//! Where to render, and when a GPU is worth asking for.

use super::cpu::splat::Lens;
use crate::error::{Error, Result};
use crate::scene::{Scene, View};
use rayon::prelude::*;

/// Where to render.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// A hardware GPU where it is predicted faster, start-up included, else the CPU. See [`gain_is_likely`].
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A hardware GPU, or the adapter that has the text in its name, in any case; a software driver only so.
    Gpu(Option<String>),
}

impl Device {
    /// Reads `auto`, `cpu`, `gpu` or `gpu:NAME`, in any case.
    pub fn from_name(text: &str) -> Result<Self> {
        let (kind, name) = text.split_once(':').map_or((text, None), |(kind, name)| (kind, Some(name.trim())));
        match (kind.to_lowercase().as_str(), name) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("gpu", name) => Ok(Self::Gpu(name.filter(|name| !name.is_empty()).map(str::to_owned))),
            _ => Err(Error::Usage(format!("--device {text}: unknown; allowed: auto, cpu, gpu, gpu:NAME"))),
        }
    }
}

/// How a GPU draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuPath {
    /// Compute shaders go through lists of particles, tile by tile.
    Compute,
    /// Billboards are drawn and blended with 32 bits per channel; not on every adapter.
    Raster,
    /// The same with 16 bits: thin gas is lost. Used only where it is asked for.
    RasterF16,
}

impl GpuPath {
    /// All of them.
    pub const ALL: &[Self] = &[Self::Compute, Self::Raster, Self::RasterF16];

    /// The name that `--gpu-path` uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Compute => "compute",
            Self::Raster => "raster",
            Self::RasterF16 => "raster-f16",
        }
    }

    /// Reads a name, in any case; none for `auto`.
    pub fn from_name(text: &str) -> Result<Option<Self>> {
        let name = text.to_lowercase();
        let path = Self::ALL.iter().copied().find(|path| path.name() == name);
        if path.is_none() && name != "auto" {
            let names: Vec<_> = Self::ALL.iter().map(|path| path.name()).collect();
            return Err(Error::Usage(format!("--gpu-path {text}: unknown; allowed: auto, {}", names.join(", "))));
        }
        Ok(path)
    }
}

/// Seconds that the CPU must be predicted to take for a frame before a GPU is looked for: loading drivers and compiling
/// shaders take up to half of that, and what is prepared on the CPU for the GPU takes its time there too.
const LEAST_SECONDS: f64 = 1.0;
/// Fragments that a thread of a slow machine computes in a second (a fast one: more than 6e9).
const FRAGMENTS_PER_SECOND: f64 = 1e9;
/// Optical depth behind which nothing is seen: 2^-8 of the light comes through.
const OPAQUE: f64 = 5.5;
/// Mean of a footprint over its disc, about that of a Gaussian.
const MEAN_FOOTPRINT: f64 = 0.25;

/// Whether a GPU would likely save time for a method that counts fragments, with drivers loaded for one frame. The rule is
/// simple and errs towards the CPU: the pixels that the particles' discs cover, less what gas in front hides if it is
/// spread evenly, at a rate of 10^9 in a second and thread, must take a second.
pub fn gain_is_likely(scene: &Scene, views: &[View], threads: usize) -> bool {
    let pixels: f64 = views.iter().map(|view| f64::from(view.size[0]) * f64::from(view.size[1])).sum();
    let mut fragments = 0.0;
    let mut depth = 0.0;
    for view in views {
        let lens = Lens::new(view);
        let all = f64::from(view.size[0]) * f64::from(view.size[1]);
        for set in &scene.particles {
            let of_one = |i: usize| {
                let center = view.eye_from_point(glam::DVec3::new(set.x[i], set.y[i], set.z[i]));
                let distance = -center.z;
                if distance <= view.near {
                    return [0.0; 2];
                }
                let radius = set.radius.get(i) / distance * lens.focal.y;
                let at = lens.picture(center.x / distance, center.y / distance);
                let seen = |at: f64, size: u32| at + radius > 0.0 && at - radius < f64::from(size);
                if !seen(at.x, view.size[0]) || !seen(at.y, view.size[1]) {
                    return [0.0; 2];
                }
                let area = (std::f64::consts::PI * radius * radius).min(all);
                [area, -area * (-set.opacity.get(i)).ln_1p()]
            };
            // Chunks of one length, summed in order: the same on any number of threads.
            let sums: Vec<[f64; 2]> = (0..set.len().div_ceil(CHUNK))
                .into_par_iter()
                .map(|chunk| {
                    let range = chunk * CHUNK..set.len().min((chunk + 1) * CHUNK);
                    range.map(of_one).fold([0.0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]])
                })
                .collect();
            for [area, weighted] in sums {
                fragments += area;
                depth += weighted * MEAN_FOOTPRINT;
            }
        }
    }
    let hidden = if depth > 0.0 { (OPAQUE * pixels / depth).min(1.0) } else { 1.0 };
    fragments * hidden >= LEAST_SECONDS * FRAGMENTS_PER_SECOND * threads as f64
}

/// Particles per task.
const CHUNK: usize = 1 << 14;
