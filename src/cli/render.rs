//! `render`: a scene file to pictures, and a JSON object beside them.

use super::options::SceneOptions;
use super::progress::{Bar, Waiting};
use super::{ms, parameters, print, same_file, verification, warn};
use crate::error::{Error, Result};
use crate::input::SceneInput;
use crate::picture::output::{self, Content, Job, Writer};
use crate::picture::packing::{self, Packed, Packing};
use crate::picture::provenance::{self, Provenance};
use crate::picture::{Film, Picture, Plane};
use crate::render::gpu::raster;
use crate::render::{GpuPath, Method, Rendering, Session, Settings, plan};
use crate::scene::Scene;
use crate::study::verify::verify;
use clap::Args;
use rayon::prelude::*;
use serde_json::json;
use std::borrow::Cow;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `render`.
#[derive(Args)]
pub struct RenderArgs {
    #[command(flatten)]
    options: SceneOptions,

    /// Folder for the pictures; created if missing
    #[arg(short = 'o', long = "output", value_name = "DIR", default_value = "out")]
    output: PathBuf,

    /// Stereo formats to write, comma separated: left, right, anaglyph, sbs [default: all four; without stereo: mono]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    format: Vec<String>,

    /// Image format: png, png16, exr or jpg
    #[arg(long, value_name = "NAME", default_value = "png")]
    image: String,

    /// Write the method's own estimate of its error (an estimate, not a bound) at every pixel: FILE.exr as it is, FILE.png with
    /// white for the largest; two views as FILE.left.exr and FILE.right.exr. Method slab has one
    #[arg(long, value_name = "FILE")]
    error_map: Option<PathBuf>,

    /// Measure the error of the pictures against the reference at N pixels per eye (all: every pixel), half of them where
    /// errors hide, and exit with 1 if red, green or blue is off by more than --tolerance anywhere. Without N: 4096. Methods
    /// other than auto and reference promise no error: with them --tolerance bounds nothing but early ends
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "4096", allow_negative_numbers = true)]
    verify: Option<String>,

    /// No progress bar and no list of files
    #[arg(long)]
    quiet: bool,

    /// Print the JSON object instead of the list of files
    #[arg(long)]
    json: bool,
}

/// The name of the one format of a scene without stereo.
const MONO: &str = "mono";

impl RenderArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        self.run_on(Session::new)
    }

    /// As [`Self::run`], in a session that `open` makes of the settings.
    pub fn run_on(&self, open: impl FnOnce(&Settings) -> Result<Session>) -> Result<u8> {
        let start = Instant::now();
        let writer = output::writer(&self.image)?;
        let asked = self.format.iter().map(|name| Format::named(name.trim())).collect::<Result<Vec<_>>>()?;
        let sample = self.verify.as_deref().map(verification::parse).transpose()?;
        let silent = self.quiet || self.json;
        let map_writer = self.error_map.as_deref().map(map_writer).transpose()?;
        let mut input = self.options.load(silent)?;
        if map_writer.is_some() {
            input.settings.error_map = true;
            let method = input.settings.method;
            if !method.estimates_error() {
                let able: Vec<_> =
                    Method::ALL.iter().filter(|method| method.estimates_error()).map(|method| method.name()).collect();
                let (name, able) = (method.name(), able.join(", "));
                return Err(Error::Usage(format!(
                    "--error-map: method `{name}` has no estimate of its error; methods that have one: {able}"
                )));
            }
        }
        let input = input;
        let formats = formats(asked, &input.scene)?;
        // A name need not be Unicode.
        let stem = self.options.scene.file_stem().unwrap_or_default();
        let path = |ending: &str| {
            let mut name = stem.to_os_string();
            name.push(ending);
            self.output.join(name)
        };
        let record_path = path(".json");
        // What cannot be written is said before the work, not after it. A scene may have any extension, the record's too.
        if same_file(&record_path, &self.options.scene) {
            return Err(Error::output(&record_path, "it is the scene file; choose another folder with -o"));
        }
        for format in &formats {
            let [width, height] = format.size(input.scene.camera.size);
            if width.max(height) > writer.longest {
                return Err(Error::Usage(format!(
                    "--image {}: the {} picture has {width}x{height} pixels; the format holds {} at most",
                    writer.name,
                    format.name(),
                    writer.longest
                )));
            }
        }
        create_folder(&self.output)?;
        let loaded = start.elapsed();

        let bar = Bar::new("rendering", silent);
        let mut session = open(&input.settings)?;
        let mut rendering = session.draw(&input.scene, &bar)?;
        drop(bar);
        if let Some(warning) = &rendering.warning {
            warn(warning);
        }

        // What is measured is what was drawn, before it is packed and encoded.
        let verified = match sample {
            Some(sample) => {
                let bar = Bar::new("verifying", silent);
                let (scene, films, tolerance) = (&input.scene, &rendering.films, input.settings.tolerance);
                let mut found = session.install(|| verify(scene, &scene.views(), films, sample, tolerance, &bar))?;
                found.predicted_error = rendering.statistics.predicted_error;
                Some(found)
            }
            None => None,
        };

        let waiting = Waiting::new("packing and writing", silent);
        let packing_start = Instant::now();
        // An estimate goes into files of its own; what goes along with the picture, as channel E and in the record, is a bound.
        let maps: Vec<Plane<f32>> = match self.error_map {
            Some(_) => rendering.films.iter_mut().filter_map(|film| film.error.take()).collect(),
            None => Vec::new(),
        };
        let known: Vec<Known> = rendering.films.iter().map(Known::of).collect();
        let pictures: Vec<Picture> = rendering.films.drain(..).map(Picture::from_film).collect();
        // On the threads that were asked for, no others.
        let pack = || formats.par_iter().map(|format| format.pack(&pictures)).collect::<Result<Vec<_>>>();
        let packed = session.install(pack)?;
        let packing_time = packing_start.elapsed();

        let paths: Vec<PathBuf> =
            formats.iter().map(|format| path(&format!(".{}.{}", format.name(), writer.extension))).collect();
        let mut record = self.record(&input, &rendering, &known);
        if pictures.iter().any(|picture| picture.disparity.is_some()) && writer.name != "exr" {
            record.notes.push("the disparity is kept by --image exr alone".into());
        }
        record.timings_ms =
            rendering.statistics.stages.iter().map(|(name, time)| (name.to_string(), ms(*time))).collect();
        record.timings_ms.insert(0, ("load".into(), ms(loaded)));
        if let Some(verified) = &verified {
            record.timings_ms.push(("verify".into(), ms(verified.time)));
            record.verification = verification::object(verified, input.settings.method, rendering.eyes);
        }
        record.timings_ms.push(("pack".into(), ms(packing_time)));
        record.pictures = paths
            .iter()
            .zip(&formats)
            .zip(&packed)
            .map(|((path, format), packed)| provenance::PictureFile {
                file: path.display().to_string(),
                format: format.name().into(),
                image: writer.name.into(),
                size: packed.picture.size,
                clipped: packed.clipped,
            })
            .collect();
        let map_pictures = match (&self.error_map, map_writer) {
            (Some(path), Some(writer)) => error_maps(path, writer, &maps, &rendering, &input.scene, &mut record),
            _ => Vec::new(),
        };
        // Writing itself cannot be part of the record that is written with it: the total ends before it.
        record.timings_ms.push(("total_before_writing".into(), ms(start.elapsed())));
        let text = record.to_json();
        let mut jobs: Vec<Job> = paths
            .iter()
            .zip(&packed)
            .map(|(path, packed)| Job { path, content: Content::Picture(&packed.picture, writer) })
            .collect();
        let map_jobs =
            map_pictures.iter().map(|(path, picture, writer)| Job { path, content: Content::Picture(picture, writer) });
        jobs.extend(map_jobs);
        jobs.push(Job { path: &record_path, content: Content::Bytes(text.as_bytes()) });
        session.install(|| output::write_all(&jobs))?;
        drop(waiting);

        let verdict = verified.as_ref().map(|v| verification::sentence(v, input.settings.method, rendering.eyes));
        let failed = verified.is_some_and(|verified| !verified.held());
        if self.json {
            print(&text)?;
        } else if !self.quiet {
            let mut text = String::new();
            for path in paths.iter().chain(map_pictures.iter().map(|(path, ..)| path)) {
                text += &format!("{}\n", path.display());
            }
            text += &format!(
                "{} particles, {}, {:.0} ms drawing, {:.0} ms in all\n",
                input.scene.particle_count(),
                rendering.method.name(),
                ms(rendering.statistics.total),
                ms(start.elapsed())
            );
            for note in &record.notes {
                text += &format!("note: {note}\n");
            }
            if let Some(verdict) = &verdict {
                text += &format!("{verdict}\n");
            }
            print(&text)?;
        }
        if let Some(verdict) = verdict.filter(|_| self.quiet && failed) {
            // The verdict is the exit code's too; a closed stderr does not change it.
            let _ = writeln!(std::io::stderr(), "{verdict}");
        }
        Ok(u8::from(failed))
    }

    /// Everything that should be known about this run, but for times and files.
    fn record(&self, input: &SceneInput, rendering: &Rendering, known: &[Known]) -> Provenance {
        let scene = &input.scene;
        let settings = &input.settings;
        let mut record = Provenance::new();
        record.settings = json!({
            "scene": self.options.scene.display().to_string(),
            "method": rendering.method.name(),
            "method_asked": settings.method.name(),
            "parameters": parameters(rendering.method, scene),
            "opacity_model": settings.opacity_model.name(),
            "tolerance": settings.tolerance,
            "gpu_path": rendering.gpu_path.map(GpuPath::name),
            "gpu_path_asked": settings.gpu_path.map_or("auto", GpuPath::name),
            "threads": rendering.threads,
            "simd": rendering.level.name(),
            "camera": {
                "position": scene.camera.position.to_array(),
                "look_at": scene.camera.look_at.to_array(),
                "up": scene.camera.up.to_array(),
                "fov_y_deg": scene.camera.fov_y.to_degrees(),
                "size": scene.camera.size,
                "near": scene.camera.near,
                "samples": scene.camera.samples,
            },
            "stereo": scene.stereo.as_ref().map(|stereo| json!({
                "interocular": stereo.interocular,
                "convergence": stereo.convergence,
                "mode": stereo.mode.name(),
            })),
            "background": scene.background.map(shortest),
            "particles": scene.particle_count(),
            "triangles": scene.meshes.iter().map(|mesh| mesh.corners.len()).sum::<usize>(),
            "fragments": rendering.statistics.fragments,
            "particles_prepared": rendering.statistics.prepared,
            "predicted_error": rendering.statistics.predicted_error,
            "predicted_ms": rendering.statistics.predicted_time.map(ms),
        });
        record.device.clone_from(&rendering.device);
        record.plan = plan::words(&input.scene, &input.settings);
        record.plan.extend(rendering.statistics.plan.iter().cloned());
        record.views = rendering
            .eyes
            .iter()
            .zip(scene.views())
            .zip(known)
            .map(|((eye, view), known)| provenance::View {
                name: eye.name().into(),
                eye: view.position.to_array(),
                details: json!({
                    "frustum_shear": view.shear,
                    "opaque_surfaces": known.opaque,
                    "largest_error_bound": known.error,
                }),
            })
            .collect();
        record.notes.clone_from(&input.notes);
        record.notes.extend(rendering.warning.clone());
        if rendering.gpu_path == Some(GpuPath::RasterF16) {
            record.notes.push(raster::LOSS.into());
        }
        record
    }
}

/// What the record says about a film.
struct Known {
    /// Whether there are opaque surfaces.
    opaque: bool,
    /// The largest bound of a pixel's error, where the method knows one.
    error: Option<f32>,
}

impl Known {
    fn of(film: &Film) -> Self {
        let error = film.error.as_ref().map(|plane| plane.iter().copied().fold(0.0, f32::max));
        Self { opaque: film.depth.is_some(), error }
    }
}

/// The pictures of the views' error maps, with their files and writer; the record is told of them.
fn error_maps(
    path: &Path,
    writer: &'static Writer,
    maps: &[Plane<f32>],
    rendering: &Rendering,
    scene: &Scene,
    record: &mut Provenance,
) -> Vec<(PathBuf, Picture, &'static Writer)> {
    let top = maps.iter().flatten().fold(0.0f32, |top, &value| top.max(value));
    let count = maps.iter().map(|map| map.len()).sum::<usize>().max(1);
    let mean = maps.iter().flatten().map(|&value| f64::from(value)).sum::<f64>() / count as f64;
    record.settings["error_estimate"] = json!({ "mean": mean, "largest": top });
    let scale = if writer.extension == "exr" || top == 0.0 { 1.0 } else { 1.0 / top };
    let mut pictures = Vec::with_capacity(maps.len());
    for (map, eye) in maps.iter().zip(rendering.eyes) {
        let mut picture = Picture::new(scene.camera.size);
        for plane in &mut picture.color {
            plane.iter_mut().zip(map).for_each(|(out, &value)| *out = value * scale);
        }
        let path = if maps.len() == 1 {
            path.to_path_buf()
        } else {
            path.with_extension(format!("{}.{}", eye.name(), writer.extension))
        };
        record.pictures.push(provenance::PictureFile {
            file: path.display().to_string(),
            format: "error".into(),
            image: writer.name.into(),
            size: picture.size,
            clipped: 0,
        });
        pictures.push((path, picture, writer));
    }
    pictures
}

/// The writer of an error map, by its name's extension.
fn map_writer(path: &Path) -> Result<&'static Writer> {
    match path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).as_deref() {
        Some("exr" | "png") => output::writer_for(path),
        Some(_) | None => {
            Err(Error::Usage(format!("--error-map {}: allowed: a name that ends in .exr or .png", path.display())))
        }
    }
}

/// One picture to write.
enum Format {
    Mono,
    Packing(&'static Packing),
}

impl Format {
    fn named(name: &str) -> Result<Self> {
        if name == MONO { Ok(Self::Mono) } else { packing::packing(name).map(Self::Packing) }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Mono => MONO,
            Self::Packing(packing) => packing.name,
        }
    }

    /// The picture of the format.
    fn pack<'a>(&self, views: &'a [Picture]) -> Result<Packed<'a>> {
        match self {
            Self::Mono => Ok(Packed { picture: Cow::Borrowed(&views[0]), clipped: 0 }),
            Self::Packing(packing) => (packing.pack)(&views[0], &views[1], &packing::Options::default()),
        }
    }

    /// Width and height of the format's picture, from those of a view.
    fn size(&self, view: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Mono => view,
            Self::Packing(packing) => (packing.size)(view),
        }
    }
}

/// The formats asked for, or all that the scene can have; each once.
fn formats(asked: Vec<Format>, scene: &Scene) -> Result<Vec<Format>> {
    if asked.is_empty() {
        return Ok(match scene.stereo {
            Some(_) => packing::PACKINGS.iter().map(Format::Packing).collect(),
            None => vec![Format::Mono],
        });
    }
    let mut formats: Vec<Format> = Vec::new();
    for format in asked {
        if matches!(format, Format::Mono) == scene.stereo.is_some() {
            let message = match scene.stereo {
                Some(_) => {
                    "--format mono: the scene has a [stereo] section; allowed: left, right, anaglyph, sbs".into()
                }
                None => format!("--format {}: the scene has no [stereo] section; allowed: mono", format.name()),
            };
            return Err(Error::Usage(message));
        }
        if formats.iter().all(|other| other.name() != format.name()) {
            formats.push(format);
        }
    }
    Ok(formats)
}

/// The f64 that reads as a person wrote the f32: 0.4, not 0.4000000059604645.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| value.into())
}

fn create_folder(path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        return Err(Error::output(path, "it is a file; -o names the folder that the pictures go to"));
    }
    std::fs::create_dir_all(path)
        .map_err(|error| Error::output(path, format!("cannot create the folder: {}", output::reason(&error))))
}
