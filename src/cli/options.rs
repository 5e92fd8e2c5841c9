//! Options that `render`, `bench`, `chart` and `scene` share, and what follows from them: a scene with settings.

use super::progress::Bar;
use crate::error::{Error, Result};
use crate::input::init::{self, InitOptions};
use crate::input::scene_file::SceneFile;
use crate::input::{self, Content, Kind, Reader, SceneInput, VolumeOptions};
use crate::render::cpu::simd::Level;
use crate::render::gpu::adapter;
use crate::render::{Device, GpuPath, Method, Progress};
use clap::Args;
use etcetera::BaseStrategy;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The scene and how to render it.
#[derive(Args)]
pub struct SceneOptions {
    /// Scene file (TOML), or a file of particles, a volume or a mesh, for which a scene is made
    pub scene: PathBuf,

    /// How to render gas; see `stereomist devices` for the machine and the README for the methods
    #[arg(long, value_name = "NAME")]
    method: Option<String>,

    /// Absolute error allowed per channel in linear light at every pixel; 0 turns every saving off [default: 1/255]
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    tolerance: Option<String>,

    #[command(flatten)]
    common: CommonOptions,
}

/// How to render a scene, whatever the method.
#[derive(Args, Clone)]
pub struct CommonOptions {
    /// Where to render: auto, cpu, gpu, or gpu:NAME with a part of an adapter's name
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: String,

    /// How a GPU draws: compute, raster, raster-f16 (16 bits per channel, which loses thin gas), or auto: compute or raster,
    /// whichever was measured to be faster on that GPU
    #[arg(long, value_name = "PATH", default_value = "auto")]
    gpu_path: String,

    /// Width and height of one view in pixels, instead of the scene's
    #[arg(long, value_name = "WxH")]
    size: Option<String>,

    /// Number of threads; the picture does not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    /// Vector instructions: portable, sse2, avx2 or avx512 [default: the widest the machine has]
    #[arg(long, value_name = "LEVEL")]
    simd: Option<String>,

    /// Set any key of the scene file, e.g. `--set stereo.interocular=0.1`; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Grid of a volume given instead of a scene file [default: the only one, or `density`]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,

    /// Voxels along each side of the block that becomes one particle, for a volume given instead of a scene file
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    downsample: Option<u32>,
}

impl SceneOptions {
    /// A scene with options that say nothing of method and tolerance.
    pub fn of(scene: PathBuf, common: CommonOptions) -> Self {
        Self { scene, method: None, tolerance: None, common }
    }

    /// Reads the scene file with the settings of the command line applied, and everything it refers to. `silent`: shows no
    /// sign of life while it does.
    pub fn load(&self, silent: bool) -> Result<SceneInput> {
        self.load_changed(silent, |_| Ok(()))
    }

    /// As [`Self::load`], with a change of the scene file before anything that it refers to is read.
    pub fn load_changed(&self, silent: bool, change: impl FnOnce(&mut SceneFile) -> Result<()>) -> Result<SceneInput> {
        let common = &self.common;
        let gpu_path = GpuPath::from_name(&common.gpu_path)?;
        let device = check_device(&common.device)?;
        // What is wrong on the command line is said before anything big is read.
        let method = self.method.as_deref().map(parse_method).transpose()?;
        let tolerance = self.tolerance.as_deref().map(parse_tolerance).transpose()?;
        let size = common.size.as_deref().map(parse_size).transpose()?;
        let simd = common.simd.as_deref().map(parse_simd).transpose()?;
        let bar = Bar::new("reading", silent);
        let mut file = match self.kind()? {
            Kind::Scene => input::scene_file::load(&self.scene, &common.set)?,
            Kind::Particles(_) | Kind::Mesh(_) => {
                let text = self.made_scene(size, &bar)?;
                let name = format!("the scene made for {}", self.scene.display());
                let mut file =
                    input::scene_file::parse(&name, &text, Path::new(""), &common.set).map_err(Error::Scene)?;
                file.notes.insert(0, format!("{name}: `stereomist scene --init` prints it"));
                file
            }
        };
        if let Some(size) = size {
            file.camera.size = size;
            check_size(size, file.camera.samples)?;
        }
        // The same method keeps the parameters that the scene gives it.
        if let Some(method) = method.filter(|method| method.name() != file.settings.method.name()) {
            file.settings.method = method;
        }
        if let Some(tolerance) = tolerance {
            file.settings.tolerance = tolerance;
        }
        file.settings.device = device;
        file.settings.gpu_path = gpu_path;
        file.settings.calibration = calibration_file();
        file.settings.threads = common.threads.map(usize::from);
        file.settings.simd = simd;
        change(&mut file)?;
        input::load_scene(file, &bar)
    }
}

impl SceneOptions {
    /// What the file is, and whether the options fit it.
    pub fn kind(&self) -> Result<Kind> {
        let kind = input::kind(&self.scene)?;
        match kind {
            Kind::Particles(Reader { content: Content::Volume(_), .. }) => {}
            Kind::Particles(_) | Kind::Mesh(_) | Kind::Scene
                if self.common.grid.is_none() && self.common.downsample.is_none() => {}
            Kind::Particles(_) | Kind::Mesh(_) | Kind::Scene => {
                return Err(Error::Usage(format!(
                    "--grid and --downsample are for a volume, which {} is not; a scene file has them as keys of its \
                     [[particles]]",
                    self.scene.display()
                )));
            }
        }
        Ok(kind)
    }

    /// What to read of a volume.
    pub fn volume(&self) -> VolumeOptions {
        VolumeOptions { grid: self.common.grid.clone(), downsample: self.common.downsample.unwrap_or(1) }
    }

    /// The text of a scene made for a file that is none. Options that change a scene have no place in it.
    pub fn init(&self, progress: &dyn Progress) -> Result<String> {
        let given = [("--set", !self.common.set.is_empty()), ("--method", self.method.is_some())];
        let given = given.into_iter().chain([("--tolerance", self.tolerance.is_some())]);
        if let Some((name, _)) = given.into_iter().find(|(_, given)| *given) {
            return Err(Error::Usage(format!("--init and {name}: change the scene that is printed instead")));
        }
        self.made_scene(self.common.size.as_deref().map(parse_size).transpose()?, progress)
    }

    fn made_scene(&self, size: Option<[u32; 2]>, progress: &dyn Progress) -> Result<String> {
        if let Some(size) = size {
            check_size(size, 1)?;
        }
        init::scene_text(&self.scene, &InitOptions { size, volume: self.volume() }, progress)
    }
}

/// Whether a picture of this size can be.
pub fn check_size(size: [u32; 2], samples: u32) -> Result<()> {
    input::scene_file::check_size(size, samples)
        .map_err(|message| Error::Usage(format!("--size {}x{}: {message}", size[0], size[1])))
}

fn parse_method(name: &str) -> Result<Method> {
    let names: Vec<_> = Method::ALL.iter().map(|method| method.name()).collect();
    Method::from_name(name)
        .ok_or_else(|| Error::Usage(format!("--method {name}: unknown; allowed: {}", names.join(", "))))
}

fn parse_tolerance(text: &str) -> Result<f64> {
    // A fraction is how people think of it: 1/255.
    let value = match text.split_once('/') {
        Some((above, below)) => {
            f64::from_str(above.trim()).ok().zip(f64::from_str(below.trim()).ok()).map(|(a, b)| a / b)
        }
        None => f64::from_str(text).ok(),
    };
    match value {
        Some(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err(Error::Usage(format!(
            "--tolerance {text}: allowed: a number of at least 0, or a fraction such as 1/255"
        ))),
    }
}

/// WIDTHxHEIGHT.
pub fn parse_size(text: &str) -> Result<[u32; 2]> {
    let size = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    size.ok_or_else(|| Error::Usage(format!("--size {text}: allowed: WIDTHxHEIGHT in pixels, e.g. 1024x768")))
}

fn parse_simd(name: &str) -> Result<Level> {
    let names: Vec<_> = Level::ALL.iter().map(|level| level.name()).collect();
    Level::from_name(name).ok_or_else(|| Error::Usage(format!("--simd {name}: unknown; allowed: {}", names.join(", "))))
}

/// Where speeds of GPUs are kept: in the user's folder for what can be made again, where there is one.
pub fn calibration_file() -> Option<PathBuf> {
    let folders = etcetera::choose_base_strategy().ok()?;
    Some(folders.cache_dir().join(env!("CARGO_PKG_NAME")).join("gpu-paths.json"))
}

/// Where to render; an adapter that is asked for is there.
fn check_device(text: &str) -> Result<Device> {
    let device = Device::from_name(text)?;
    match &device {
        Device::Auto | Device::Cpu => {}
        Device::Gpu(name) => {
            adapter::choose(name.as_deref())?;
        }
    }
    Ok(device)
}
