//! Which of its paths a GPU draws billboards by: measured once for an adapter and its driver, and kept in a file.
//!
//! Neither path is the faster one everywhere: blending 32-bit floats is slow on some GPUs, and tile lists are slow where
//! loads through a list are. Both draw the same small fog in stereo, larger and larger until the time can be told; the path
//! that took less is taken from then on. That takes a fraction of a second, of which most is the shaders' compilation.

use super::cpu::engine::Memory;
use super::gpu::Gpu;
use super::{Frame, GpuPath, GpuRenderer, Method, Options};
use crate::error::Result;
use crate::picture::{Film, output};
use crate::scene::{Attribute, Camera, Kernel, ParticleSet, Scene, Stereo, StereoMode};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

/// Wall times of the same frame by both paths, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Speeds {
    /// By [`GpuPath::Compute`].
    pub compute_ms: f64,
    /// By [`GpuPath::Raster`].
    pub raster_ms: f64,
}

impl Speeds {
    /// The faster path.
    pub fn path(&self) -> GpuPath {
        if self.raster_ms < self.compute_ms { GpuPath::Raster } else { GpuPath::Compute }
    }

    /// What was measured, in words.
    pub fn words(&self) -> String {
        let Self { compute_ms, raster_ms } = self;
        format!("a test frame took {compute_ms:.1} ms by compute and {raster_ms:.1} ms by raster")
    }

    fn is_plausible(&self) -> bool {
        [self.compute_ms, self.raster_ms].iter().all(|ms| ms.is_finite() && *ms > 0.0)
    }
}

/// Most bytes of the file that are read: thousands of adapters.
const MOST_BYTES: u64 = 1 << 20;
/// Sizes of the test frames; larger ones are drawn while the time spent is less than [`ENOUGH`].
const SIZES: [[u32; 2]; 4] = [[128, 96], [256, 192], [512, 384], [1024, 768]];
const ENOUGH: Duration = Duration::from_millis(50);
/// Particles of the test frames: those of a walk through fog.
const PARTICLES: usize = 1000;

/// What is known of an adapter by its description ([`super::gpu::adapter::Candidate::describe`]).
pub fn known(file: &Path, adapter: &str) -> Option<Speeds> {
    read(file).get(&key(adapter)).copied().filter(Speeds::is_plausible)
}

/// The speeds of a GPU that has both paths: those it is known by, or measured now and written to the file, where there is one. What
/// cannot be read is measured anew, and what cannot be written is not.
///
/// # Errors
/// Those of the GPU.
pub fn speeds(gpu: &mut Gpu, file: Option<&Path>, options: &Options) -> Result<Speeds> {
    let known = gpu.speeds.or_else(|| known(file?, gpu.describe()));
    let speeds = match known {
        Some(speeds) => speeds,
        None => {
            let speeds = measure(gpu, options)?;
            if let Some(file) = file {
                let mut all = read(file);
                all.insert(key(gpu.describe()), speeds);
                if let Ok(text) = serde_json::to_string_pretty(&all) {
                    // A folder that nobody may write to costs the next run its time, and nothing else.
                    let _ = output::write_bytes(file, format!("{text}\n").as_bytes());
                }
            }
            speeds
        }
    };
    gpu.speeds = Some(speeds);
    Ok(speeds)
}

/// Another driver or another version of this program may be faster or slower.
fn key(adapter: &str) -> String {
    format!("{adapter}; {} {}", env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))
}

/// All that the file holds; nothing where it cannot be read.
fn read(file: &Path) -> BTreeMap<String, Speeds> {
    // What is no file (a pipe) could be waited for without end.
    if !fs::metadata(file).is_ok_and(|what| what.is_file()) {
        return BTreeMap::new();
    }
    let mut bytes = Vec::new();
    let read = File::open(file).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut bytes));
    read.ok().and_then(|_| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

fn measure(gpu: &mut Gpu, options: &Options) -> Result<Speeds> {
    let renderer = Method::Perspective.renderer();
    let options = Options { error_map: false, ..*options };
    let start = Instant::now();
    let mut speeds = Speeds { compute_ms: f64::MAX, raster_ms: f64::MAX };
    let Some(on_gpu) = renderer.on_gpu() else { return Ok(speeds) };
    let mut draw = |size, path| frame(on_gpu, gpu, path, &fog(size), &options);
    for path in [GpuPath::Compute, GpuPath::Raster] {
        // Shaders are compiled.
        draw(SIZES[0], path)?;
    }
    let compiled = start.elapsed();
    for size in SIZES {
        // The faster of two, in turns: what else the machine does hits both.
        let mut ms = [f64::MAX; 2];
        for _ in 0..2 {
            for (ms, path) in ms.iter_mut().zip([GpuPath::Compute, GpuPath::Raster]) {
                *ms = ms.min(draw(size, path)?.as_secs_f64() * 1e3);
            }
        }
        speeds = Speeds { compute_ms: ms[0], raster_ms: ms[1] };
        if start.elapsed() - compiled > ENOUGH {
            break;
        }
    }
    Ok(speeds)
}

/// Draws a scene and tells how long that took.
fn frame(on_gpu: &dyn GpuRenderer, gpu: &mut Gpu, path: GpuPath, scene: &Scene, options: &Options) -> Result<Duration> {
    let views = scene.views();
    let mut films: Vec<Film> = views.iter().map(|view| Film::new(view.size)).collect();
    let opaque: Vec<_> = views.iter().map(|_| None).collect();
    let mut memory = Memory::default();
    let start = Instant::now();
    let frame = Frame {
        scene,
        views: &views,
        opaque: &opaque,
        options,
        films: &mut films,
        encoded: &mut [],
        memory: &mut memory,
    };
    on_gpu.draw(gpu, path, frame, &())?;
    Ok(start.elapsed())
}

/// A fog around the eyes' path, in stereo.
fn fog(size: [u32; 2]) -> Scene {
    // An additive recurrence (Roberts 2018, R3): evenly spread, and the same everywhere.
    let place = |i: usize, ratio: f64, half: f64| (2.0 * (i as f64 * ratio).fract() - 1.0) * half;
    let places = |ratio, half| (0..PARTICLES).map(|i| place(i, ratio, half)).collect();
    let gas = ParticleSet {
        kernel: Kernel::Gaussian,
        x: places(0.819_172_513_396_164_4, 3.0),
        y: places(0.671_043_606_703_789_2, 1.5),
        z: places(0.549_700_477_901_970_1, 3.0),
        radius: Attribute::Uniform(0.4),
        opacity: Attribute::Uniform(0.3),
        color: Attribute::Each((0..PARTICLES).map(|i| [0.5 + (i % 2) as f32 * 0.3, 0.6, 0.7]).collect()),
    };
    Scene {
        camera: Camera {
            position: DVec3::new(0.0, 0.0, 5.0),
            look_at: DVec3::ZERO,
            up: DVec3::Y,
            fov_y: 0.7,
            size,
            near: 0.01,
            samples: 1,
        },
        stereo: Some(Stereo { interocular: 0.065, convergence: Some(5.0), mode: StereoMode::Parallel }),
        background: [0.2; 3],
        particles: vec![gas],
        meshes: Vec::new(),
    }
}
