//! HOW: renderers, from a scene and its views to films.
//!
//! [`Session`] renders scenes with given [`Settings`] and keeps threads and memory from frame to frame; [`draw`] renders
//! one. Every method is a [`Renderer`]; all of them share the opaque layer, the films and the views.

pub mod calibration;
pub mod cpu;
pub mod device;
pub mod gpu;
pub mod method;
pub mod opaque;
pub mod plan;
pub mod reference;

pub use device::{Device, GpuPath};
pub use method::Method;

use crate::error::{Error, Result};
use crate::picture::{Film, Plane, Rgba8};
use crate::scene::{Eye, Scene, View, stereo};
use cpu::encode;
use cpu::engine::Memory;
use cpu::simd::Level;
use gpu::raster::Precision;
use gpu::{Gpu, Grade};
use opaque::OpaqueLayer;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How a particle's opacity follows from its footprint F in the three billboard methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OpacityModel {
    /// alpha = 1 - (1 - rho)^F: the optical depth is proportional to the footprint.
    #[default]
    Exponential,
    /// alpha = rho F, as Johnson & McAllister (2005) print it.
    Linear,
}

impl OpacityModel {
    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exponential => "exponential",
            Self::Linear => "linear",
        }
    }
}

/// What pixels are.
///
/// Frames for a display, one after the other:
///
/// ```no_run
/// use stereomist::input;
/// use stereomist::render::{Pixels, Session, Settings};
///
/// # fn main() -> stereomist::Result<()> {
/// let file = input::scene_file::load("fog.toml".as_ref(), &[])?;
/// let input = input::load_scene(file, &())?;
/// let mut session = Session::new(&Settings { pixels: Pixels::Srgb8, ..input.settings })?;
/// let frame = session.draw(&input.scene, &())?;
/// for (eye, picture) in frame.eyes.iter().zip(&frame.encoded) {
///     println!("{}: {} pixels", eye.name(), picture.pixels.len());
/// }
/// // The next frame is written into the same memory.
/// session.recycle(frame);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pixels {
    /// [`Film`]s: f32 in linear light, with transmittance and depth. What packings take.
    #[default]
    Linear,
    /// [`Rgba8`]: 8-bit sRGB for a display or an encoder of video. `auto` and billboards are drawn so; else
    /// they are made of films.
    Srgb8,
}

impl Pixels {
    /// Every kind.
    pub const ALL: &[Self] = &[Self::Linear, Self::Srgb8];

    /// The name that `--pixels` uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb8 => "srgb8",
        }
    }
}

/// The default tolerance: one step of an 8-bit channel.
pub const DEFAULT_TOLERANCE: f64 = 1.0 / 255.0;

/// How to render, independent of what.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The method.
    pub method: Method,
    /// Opacity model of the billboard methods.
    pub opacity_model: OpacityModel,
    /// Absolute error allowed per channel in linear light at every pixel, >= 0; 0 turns every saving off.
    pub tolerance: f64,
    /// Where to render.
    pub device: Device,
    /// How a GPU draws; absent: the faster way of those that lose nothing, see [`calibration`].
    pub gpu_path: Option<GpuPath>,
    /// File that keeps which way that was; absent: measured by every session that needs it.
    pub calibration: Option<PathBuf>,
    /// Number of threads; absent: one per core. The picture does not depend on it.
    pub threads: Option<usize>,
    /// Vector instructions of the CPU path; absent: the widest that the machine has.
    pub simd: Option<Level>,
    /// Whether films carry the method's own estimate of its error, where it has one ([`Method::estimates_error`]).
    pub error_map: bool,
    /// What is drawn. Rounding to 8 bits comes on top of the tolerance.
    pub pixels: Pixels,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            opacity_model: OpacityModel::default(),
            tolerance: DEFAULT_TOLERANCE,
            device: Device::default(),
            gpu_path: None,
            calibration: None,
            threads: None,
            simd: None,
            error_map: false,
            pixels: Pixels::default(),
        }
    }
}

/// Told how far the work is; called from any thread.
pub trait Progress: Sync {
    /// `done` of `total` units of work are done.
    fn update(&self, done: u64, total: u64);
}

/// Nobody wants to know.
impl Progress for () {
    fn update(&self, _: u64, _: u64) {}
}

/// The settings that a method draws by, all of them decided.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Opacity model of the fragments.
    pub opacity_model: OpacityModel,
    /// Absolute error allowed per channel by ending early.
    pub tolerance: f64,
    /// Opacity up to which particles are left out.
    pub faintest: f64,
    /// Vector instructions.
    pub level: Level,
    /// Whether to fill [`Film::error`], where the method can.
    pub error_map: bool,
}

/// Everything a method needs to draw one frame: all views at once, so that it can share what they share.
pub struct Frame<'a> {
    /// What is rendered.
    pub scene: &'a Scene,
    /// From where; the same number as `opaque` and `films`.
    pub views: &'a [View],
    /// Opaque surfaces of each view; `None` without meshes.
    pub opaque: &'a [Option<OpaqueLayer>],
    /// How.
    pub options: &'a Options,
    /// What the method writes, every value of every plane.
    pub films: &'a mut [Film],
    /// Frames of 8 bits, one per view, or none where they are not wanted: a method that can may write them instead of the
    /// films, which hold nothing of use then, and say so ([`Statistics::encoded`]).
    pub encoded: &'a mut [Rgba8],
    /// Memory kept from frame to frame.
    pub memory: &'a mut Memory,
}

/// A method that draws.
pub trait Renderer: Sync {
    /// Whether it can render the scene; the error names the object that it cannot and the methods that can.
    fn supports(&self, scene: &Scene) -> Result<()>;
    /// Draws a frame; the statistics are of the method's own stages.
    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics;
    /// The same on a GPU, where the method has it.
    fn on_gpu(&self) -> Option<&dyn GpuRenderer> {
        None
    }
}

/// A method that draws on a GPU.
pub trait GpuRenderer: Sync {
    /// The ways it can be drawn.
    fn paths(&self) -> &'static [GpuPath];
    /// Draws a frame, one of those ways. After an error ([`Error::Device`]) the films hold nothing of use.
    fn draw(&self, gpu: &mut Gpu, path: GpuPath, frame: Frame, progress: &dyn Progress) -> Result<Statistics>;
}

/// Where the time of a frame went, and how much was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Wall time by stage, in the order in which the stages run.
    pub stages: Vec<(&'static str, Duration)>,
    /// Wall time of the whole frame.
    pub total: Duration,
    /// Fragments (one particle at one pixel) computed, whole register blocks at a time.
    pub fragments: u64,
    /// Particles prepared, summed over the views; what no view can show or what lies behind opaque gas is not.
    pub prepared: u64,
    /// Whether the method wrote the frames of 8 bits that were wanted.
    pub encoded: bool,
    /// What the method decided for this frame, one sentence each; empty where it decides nothing.
    pub plan: Vec<String>,
    /// The largest error of a channel that the method predicts from its estimates, where it does.
    pub predicted_error: Option<f64>,
    /// Wall time of its stages for all views that the method foretells by its plan, not by what drawing took, where it does: within a
    /// factor of about 1.5 for half of all scenes, of 3 to 4 for nine in ten.
    pub predicted_time: Option<Duration>,
}

/// The result of a frame.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The eyes, in the order of the films.
    pub eyes: &'static [Eye],
    /// One film per view of the scene, at the camera's size; none with [`Pixels::Srgb8`].
    pub films: Vec<Film>,
    /// One frame per view of the scene, at the camera's size, with [`Pixels::Srgb8`].
    pub encoded: Vec<Rgba8>,
    /// The method that drew it.
    pub method: Method,
    /// Vector instructions used.
    pub level: Level,
    /// Number of threads used.
    pub threads: usize,
    /// What drew it, for people: the CPU with threads and instructions, or the GPU with its driver.
    pub device: String,
    /// The way that a GPU drew it; none on the CPU.
    pub gpu_path: Option<GpuPath>,
    /// Why the CPU drew it though a GPU was wanted first.
    pub warning: Option<String>,
    /// Where the time went.
    pub statistics: Statistics,
}

/// Threads, memory and films that are kept from frame to frame.
pub struct Session {
    settings: Settings,
    level: Level,
    pool: Arc<rayon::ThreadPool>,
    memory: Memory,
    gpu: Choice,
    /// What the next frame may write into: films of samples and, with supersampling, of the pixels that are made of them, frames of 8
    /// bits, and opaque layers.
    spare: Vec<Film>,
    spare_pixels: Vec<Film>,
    spare_encoded: Vec<Rgba8>,
    spare_opaque: Vec<OpaqueLayer>,
}

/// The GPU of a session.
enum Choice {
    /// Decided by the first frame.
    Later,
    /// The CPU draws; why, where that is not what was asked for first.
    None(Option<String>),
    /// This one draws.
    Some(Box<Gpu>),
}

/// Whether a GPU can do what the settings ask for.
fn check_gpu(settings: &Settings) -> Result<()> {
    settings.method.check_gpu(settings.gpu_path)
}

/// Whether this GPU can go the way that the settings ask for.
fn check_path(gpu: &Gpu, settings: &Settings) -> Result<()> {
    match settings.gpu_path {
        Some(GpuPath::Raster) => gpu.check_blending(Precision::Single),
        Some(GpuPath::RasterF16) => gpu.check_blending(Precision::Half),
        Some(GpuPath::Compute) | None => Ok(()),
    }
}

/// What became of a frame whose GPU failed.
fn fallen_back(error: &Error) -> String {
    format!("drawn on the CPU: {error}")
}

/// The faster way of those that lose nothing, and why, where there is a choice.
fn choose_path(
    on_gpu: &dyn GpuRenderer,
    gpu: &mut Gpu,
    file: Option<&Path>,
    options: &Options,
) -> Result<(GpuPath, Option<String>)> {
    if !on_gpu.paths().contains(&GpuPath::Raster) {
        return Ok((GpuPath::Compute, None));
    }
    if gpu.check_blending(Precision::Single).is_err() {
        let why = format!("Drawn by compute: {} {}.", gpu.describe(), gpu::NO_BLENDING);
        return Ok((GpuPath::Compute, Some(why)));
    }
    let speeds = calibration::speeds(gpu, file, options)?;
    let path = speeds.path();
    Ok((path, Some(format!("Drawn by {}: {}.", path.name(), speeds.words()))))
}

impl Session {
    /// Starts the threads, and the GPU where one is asked for. Fails where the settings ask for instructions or a device that
    /// the machine does not have, or for a GPU with a method that none draws.
    pub fn new(settings: &Settings) -> Result<Self> {
        let gpu = match &settings.device {
            Device::Cpu => Choice::None(None),
            Device::Auto => Choice::Later,
            Device::Gpu(name) => {
                check_gpu(settings)?;
                let gpu = Gpu::named(name.as_deref())?;
                check_path(&gpu, settings)?;
                Choice::Some(Box::new(gpu))
            }
        };
        Self::with(settings, gpu)
    }

    /// As [`Session::new`], with a GPU that is open already.
    pub fn on(settings: &Settings, gpu: Gpu) -> Result<Self> {
        check_gpu(settings)?;
        check_path(&gpu, settings)?;
        Self::with(settings, Choice::Some(Box::new(gpu)))
    }

    /// The GPU, where one draws.
    pub fn gpu(&mut self) -> Option<&mut Gpu> {
        match &mut self.gpu {
            Choice::Some(gpu) => Some(gpu),
            Choice::Later | Choice::None(_) => None,
        }
    }

    /// Gives the GPU up, for another session.
    pub fn into_gpu(self) -> Option<Gpu> {
        match self.gpu {
            Choice::Some(gpu) => Some(*gpu),
            Choice::Later | Choice::None(_) => None,
        }
    }

    fn with(settings: &Settings, gpu: Choice) -> Result<Self> {
        let level = settings.simd.unwrap_or_else(Level::best);
        if !level.is_available() {
            let names: Vec<_> = Level::available().into_iter().map(Level::name).collect();
            return Err(Error::Usage(format!("this machine has no {level}; it has: {}", names.join(", "))));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(settings.threads.unwrap_or(0))
            .build()
            .map_err(|error| Error::Usage(format!("cannot start the threads: {error}")))?;
        let pool = Arc::new(pool);
        Ok(Self {
            settings: settings.clone(),
            level,
            pool,
            memory: Memory::default(),
            gpu,
            spare: Vec::new(),
            spare_pixels: Vec::new(),
            spare_encoded: Vec::new(),
            spare_opaque: Vec::new(),
        })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Does other work, such as packing and encoding, on the threads of the session.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }

    /// Does work with the session on one of its threads: frame after frame drawn there is spared the way from the caller's thread and
    /// back, which counts where a frame takes a millisecond.
    pub fn on_threads<R: Send>(&mut self, work: impl FnOnce(&mut Self) -> R + Send) -> R {
        let pool = Arc::clone(&self.pool);
        pool.install(|| work(self))
    }

    /// Renders all views of a scene. Films of a frame given back with [`Session::recycle`] are used again.
    pub fn draw(&mut self, scene: &Scene, progress: &dyn Progress) -> Result<Rendering> {
        let start = Instant::now();
        let method = self.settings.method;
        let renderer = method.renderer();
        renderer.supports(scene)?;
        if scene.particle_count() >= u32::MAX as usize {
            return Err(Error::Usage(format!("{} particles; at most {} fit", scene.particle_count(), u32::MAX - 1)));
        }
        let views = scene.views();
        let options = Options {
            opacity_model: self.settings.opacity_model,
            tolerance: self.settings.tolerance,
            faintest: 0.0,
            level: self.level,
            error_map: self.settings.error_map,
        };
        let mut films = self.films(&views, scene)?;
        let mut encoded = match self.settings.pixels {
            Pixels::Linear => Vec::new(),
            Pixels::Srgb8 => self.encoded(views.len(), scene),
        };
        let samples = scene.camera.samples;
        let mut stages = vec![("plan", start.elapsed())];

        let meshes = Instant::now();
        let opaque: Vec<Option<OpaqueLayer>> = if scene.meshes.is_empty() {
            vec![None; views.len()]
        } else {
            let (level, spare) = (self.level, &mut self.spare_opaque);
            let draw = |view| opaque::draw_into(scene, view, level, spare.pop().unwrap_or_default());
            self.pool.install(|| views.iter().map(draw).collect())
        };
        stages.push(("meshes", meshes.elapsed()));

        let memory = &mut self.memory;
        let asked = self.settings.gpu_path;
        let on_gpu = renderer.on_gpu().filter(|on_gpu| asked.is_none_or(|path| on_gpu.paths().contains(&path)));
        if let Choice::Later = self.gpu {
            // No driver is loaded where nothing is to be gained.
            let threads = self.pool.current_num_threads();
            let gain = || device::gain_is_likely(scene, &views, threads);
            self.gpu = if on_gpu.is_some() && self.pool.install(gain) {
                match gpu::adapter::choose(None).map(|candidate| Gpu::open(candidate, Grade::Full)) {
                    Ok(Ok(gpu)) => Choice::Some(Box::new(gpu)),
                    Ok(Err(error)) => Choice::None(Some(fallen_back(&error))),
                    // Nothing was promised: a machine without a GPU is no reason to warn.
                    Err(_) => Choice::None(None),
                }
            } else {
                Choice::None(None)
            };
        }
        let mut drawn = None;
        let mut gpu_path = None;
        if let (Choice::Some(gpu), Some(on_gpu)) = (&mut self.gpu, on_gpu) {
            let films = &mut films;
            let memory = &mut *memory;
            let encoded = &mut [];
            let frame = Frame { scene, views: &views, opaque: &opaque, options: &options, films, encoded, memory };
            let file = self.settings.calibration.as_deref();
            let draw = || {
                let (path, why) = match asked {
                    Some(path) => (path, None),
                    None => choose_path(on_gpu, gpu, file, &options)?,
                };
                let mut statistics = on_gpu.draw(gpu, path, frame, progress)?;
                statistics.plan.extend(why);
                Ok((path, statistics))
            };
            match self.pool.install(draw) {
                Ok((path, statistics)) => {
                    drawn = Some(statistics);
                    gpu_path = Some(path);
                }
                Err(error) if self.settings.device == Device::Auto => {
                    self.gpu = Choice::None(Some(fallen_back(&error)));
                }
                Err(error) => return Err(error),
            }
        }
        let drawn = drawn.unwrap_or_else(|| {
            let films = &mut films;
            // Samples are averaged before they are encoded.
            let encoded = if samples > 1 { &mut [] } else { &mut encoded[..] };
            let frame = Frame { scene, views: &views, opaque: &opaque, options: &options, films, encoded, memory };
            self.pool.install(|| renderer.draw(frame, progress))
        });
        stages.extend(drawn.stages);

        let finish = Instant::now();
        for (film, layer) in films.iter_mut().zip(&opaque).filter(|_| encoded.is_empty()) {
            film.depth = layer.as_ref().map(|layer| self.pool.install(|| depths(layer, film.depth.take())));
        }
        self.spare_opaque = opaque.into_iter().flatten().collect();
        if samples > 1 {
            let spare = &mut self.spare_pixels;
            let reduce = |film: &Film| film.downsample_into(samples, spare.pop().unwrap_or_else(|| Film::new([0, 0])));
            let pixels = self.pool.install(|| films.iter().map(reduce).collect());
            self.spare.extend(std::mem::replace(&mut films, pixels));
        }
        stages.push(("finish", finish.elapsed()));
        if !encoded.is_empty() {
            if !drawn.encoded {
                let start = Instant::now();
                let encode =
                    || films.iter().zip(&mut encoded).for_each(|(film, out)| encode::film(film, out, self.level));
                self.pool.install(encode);
                stages.push(("encode", start.elapsed()));
            }
            self.spare.append(&mut films);
        }
        let total = start.elapsed();
        let (device, warning) = match &self.gpu {
            Choice::Some(gpu) => (format!("GPU, {}", gpu.describe()), None),
            Choice::Later | Choice::None(None) => (format!("CPU, {} threads, {}", self.threads(), self.level), None),
            Choice::None(warning) => (format!("CPU, {} threads, {}", self.threads(), self.level), warning.clone()),
        };
        Ok(Rendering {
            eyes: stereo::eyes(scene.stereo.as_ref()),
            films,
            encoded,
            method,
            level: self.level,
            threads: self.threads(),
            device,
            gpu_path,
            warning,
            statistics: Statistics { stages, total, ..drawn },
        })
    }

    /// A film for each view, spare ones first; of the others those of the pixels are kept for them. Whether the memory of a frame can be
    /// had is asked only where it is not there from the frame before.
    fn films(&mut self, views: &[View], scene: &Scene) -> Result<Vec<Film>> {
        let size = views[0].size;
        let (mut films, others): (Vec<Film>, _) = self.spare.drain(..).partition(|film| film.size == size);
        self.spare_pixels.extend(others.into_iter().filter(|film| film.size == scene.camera.size));
        self.spare_pixels.truncate(views.len());
        if films.len() < views.len() {
            let more = match self.settings.method {
                Method::Reference(parameters) => parameters.sample_bytes(),
                Method::Auto
                | Method::Viewplane
                | Method::Viewpoint
                | Method::Perspective
                | Method::Spherical(_)
                | Method::Sheet(_)
                | Method::Slab(_) => 0,
            };
            let more = more + if self.settings.pixels == Pixels::Srgb8 { 4 } else { 0 };
            check_memory(views, scene, more)?;
        }
        films.resize_with(views.len(), || Film::new(size));
        Ok(films)
    }

    /// Takes films back, so that the next frame writes into memory that is there already.
    pub fn recycle(&mut self, rendering: Rendering) {
        self.spare.extend(rendering.films);
        self.spare_encoded.extend(rendering.encoded);
    }

    /// A frame of 8 bits for each view, spare ones first.
    fn encoded(&mut self, views: usize, scene: &Scene) -> Vec<Rgba8> {
        let size = scene.camera.size;
        let mut frames = std::mem::take(&mut self.spare_encoded);
        frames.retain(|frame| frame.size == size);
        frames.resize_with(views, || Rgba8::new(size));
        frames
    }
}

/// The depths of a layer in single precision, in memory that may be there already.
fn depths(layer: &OpaqueLayer, spare: Option<Plane<f32>>) -> Plane<f32> {
    const PIECE: usize = 1 << 16;
    let count = layer.depth.len();
    let mut depths = spare.filter(|plane| plane.len() == count).unwrap_or_else(|| Plane::new(count));
    depths.par_chunks_mut(PIECE).zip(layer.depth.par_chunks(PIECE)).for_each(|(out, depths)| {
        out.iter_mut().zip(depths).for_each(|(out, &depth)| *out = depth as f32);
    });
    depths
}

/// Asks for the memory of a frame once, so that a picture that cannot fit is an error and does not end the process.
/// `more`: bytes that the method needs for each sample beside what all need.
fn check_memory(views: &[View], scene: &Scene, more: usize) -> Result<()> {
    // Film and state of a sample: four f32 each; opaque layer: depth in f64 and colour in three f32.
    let sample = 32 + more + if scene.meshes.is_empty() { 0 } else { 20 };
    let [width, height] = views[0].size;
    let bytes = (width as usize).saturating_mul(height as usize).saturating_mul(views.len() * sample);
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| {
        let gigabytes = bytes as f64 / 1e9;
        Error::Usage(format!("{} views of {width}x{height} samples need {gigabytes:.1} GB of memory", views.len()))
    })
}

/// Renders one frame of a scene: [`Session::new`] and [`Session::draw`].
pub fn draw(scene: &Scene, settings: &Settings, progress: &dyn Progress) -> Result<Rendering> {
    Session::new(settings)?.draw(scene, progress)
}
