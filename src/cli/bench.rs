//! `bench`: time per stereo frame by stage, without files.

use super::options::SceneOptions;
use super::{ms, parameters, print, print_json, warn};
use crate::error::{Error, Result};
use crate::input::SceneInput;
use crate::input::particles::MAX_BOX_COUNT;
use crate::input::population::populate;
use crate::render::cpu::simd::Level;
use crate::render::{Device, GpuPath, Method, Pixels, Rendering, Session, Settings, Statistics};
use crate::scene::{Scene, Stereo};
use crate::study::timing::{self, Timing};
use clap::Args;
use serde_json::{Map, Value, json};

/// Arguments of `bench`.
#[derive(Args)]
pub struct BenchArgs {
    #[command(flatten)]
    options: SceneOptions,

    /// Frames that are measured
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,

    /// Frames before them that are not, and more until they took 20 ms; 0: none
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    warmup: u32,

    /// Render one view from the middle instead of two
    #[arg(long)]
    mono: bool,

    /// Measure with each of these numbers of threads, two views and one
    #[arg(long, value_name = "N,N", value_delimiter = ',', conflicts_with = "threads",
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    sweep_threads: Vec<u16>,

    /// Measure with each of these numbers of particles in the scene's boxes, their radii changed with the cube root so that
    /// as much of space is filled; two views and one. Not for particles from files
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(1..=MAX_BOX_COUNT))]
    sweep_particles: Vec<u64>,

    /// What is drawn: linear (f32 films) or srgb8 (8 bits per channel, for a display)
    #[arg(long, value_name = "KIND", default_value = "linear", value_parser = pixels)]
    pixels: Pixels,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The kind of pixels of that name.
fn pixels(name: &str) -> std::result::Result<Pixels, String> {
    let kinds = || Pixels::ALL.iter().copied();
    kinds().find(|kind| kind.name() == name).ok_or_else(|| {
        let names: Vec<_> = kinds().map(Pixels::name).collect();
        format!("allowed: {}", names.join(", "))
    })
}

/// Turns in which frames of two views and of one are measured, at the most, and frames of one in a turn, at the least.
const TURNS: u32 = 5;
const LEAST_FRAMES: u32 = 4;

/// Frames that were timed, and how they were drawn.
struct Measured {
    timing: Timing,
    method: Method,
    level: Level,
    threads: usize,
    device: String,
    gpu_path: Option<GpuPath>,
    views: usize,
}

impl BenchArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        if !self.sweep_threads.is_empty() || !self.sweep_particles.is_empty() {
            return self.sweep();
        }
        let mut input = self.options.load(self.json)?;
        input.settings.pixels = self.pixels;
        if self.mono {
            input.scene.stereo = None;
        }
        let scene = &mut input.scene;
        let rigs = [scene.stereo.clone()];
        let measured = self.measure(scene, &input.settings, &rigs)?;
        let Some(Measured { timing, method, level, threads, device, gpu_path, views }) = measured.first() else {
            return Ok(0);
        };
        let path = gpu_path.map(GpuPath::name);
        let [width, height] = scene.camera.size;
        if self.json {
            let mut report = json!({
                "scene": self.options.scene.display().to_string(),
                "particles": scene.particle_count(),
                "size": [width, height],
                "views": views,
                "method": method.name(),
                "parameters": parameters(*method, scene),
                "tolerance": input.settings.tolerance,
                "simd": level.name(),
                "threads": threads,
                "device": device,
                "gpu_path": path,
                "pixels": self.pixels.name(),
                "repeat": self.repeat,
                "warmup": self.warmup,
            });
            if let (Value::Object(report), Value::Object(times)) = (&mut report, times(timing)) {
                report.extend(times);
            }
            print_json(&report)?;
        } else {
            let median = ms(timing.median);
            let mut text = format!(
                "{}: {} particles, {views} x {width}x{height}, {}, {device}{}\n\
                 median {median:.3} ms, fastest {:.3} ms, middle half within {:.3} ms, {} frames after {} for warming up\n",
                self.options.scene.display(),
                scene.particle_count(),
                method.name(),
                path.map_or_else(String::new, |path| format!(", {path}")),
                ms(timing.min),
                ms(timing.spread),
                self.repeat,
                self.warmed()
            );
            for (name, time) in &timing.stages {
                text += &format!("  {name:<10}{:>10.3} ms\n", ms(*time));
            }
            text += &format!(
                "  {:.1} million fragments, {:.2} per nanosecond\n",
                timing.fragments as f64 / 1e6,
                timing.fragments as f64 / median / 1e6
            );
            print(&text)?;
        }
        Ok(0)
    }

    /// How many frames warm up, in words.
    fn warmed(&self) -> String {
        let count = self.warmup;
        if count == 0 { "none".into() } else { format!("{count}, and {} ms,", timing::SETTLE.as_millis()) }
    }

    /// Measures a scene with each of some stereo rigs, or none, in turns: what disturbs the machine disturbs all of them.
    fn measure(&self, scene: &mut Scene, settings: &Settings, rigs: &[Option<Stereo>]) -> Result<Vec<Measured>> {
        #[derive(Default)]
        struct Subject {
            session: Option<Session>,
            frames: Vec<Statistics>,
            last: Option<Rendering>,
        }
        let mut subjects: Vec<Subject> = rigs.iter().map(|_| Subject::default()).collect();
        let kept = scene.stereo.take();
        // A GPU's memory is not asked for twice.
        let in_turns = rigs.len() > 1 && !matches!(settings.device, Device::Gpu(_));
        let turns = if in_turns { (self.repeat / LEAST_FRAMES).clamp(1, TURNS) } else { 1 };
        for turn in 0..turns {
            let wanted = self.repeat * (turn + 1) / turns - self.repeat * turn / turns;
            // The caches hold what was drawn in between.
            let warmup = if turn == 0 { self.warmup } else { self.warmup.min(2) };
            for (Subject { session, frames, last }, rig) in subjects.iter_mut().zip(rigs) {
                scene.stereo.clone_from(rig);
                let own = match session {
                    Some(own) => own,
                    None => session.insert(Session::new(settings)?),
                };
                let draw = |session: &mut Session| {
                    let enough = |frames, _| frames >= wanted;
                    timing::frames(scene, warmup, enough, |scene| {
                        last.take().into_iter().for_each(|last| session.recycle(last));
                        let mut rendering = session.draw(scene, &())?;
                        let statistics = std::mem::take(&mut rendering.statistics);
                        *last = Some(rendering);
                        Ok(statistics)
                    })
                };
                frames.extend(own.on_threads(draw)?);
                if turn + 1 == turns {
                    *session = None;
                }
            }
        }
        scene.stereo = kept;
        let mut measured = Vec::new();
        for Subject { frames, last, .. } in subjects {
            let Some(Rendering { eyes, method, level, threads, device, gpu_path, warning, .. }) = last else {
                continue;
            };
            if let Some(warning) = warning {
                warn(&warning);
            }
            measured.push(Measured {
                timing: Timing::new(&frames),
                method,
                level,
                threads,
                device,
                gpu_path,
                views: eyes.len(),
            });
        }
        Ok(measured)
    }

    /// Measures with every number of particles and threads asked for.
    fn sweep(&self) -> Result<u8> {
        let counts: Vec<Option<u64>> = if self.sweep_particles.is_empty() {
            vec![None]
        } else {
            self.sweep_particles.iter().copied().map(Some).collect()
        };
        let threads: Vec<Option<u16>> = if self.sweep_threads.is_empty() {
            vec![None]
        } else {
            self.sweep_threads.iter().copied().map(Some).collect()
        };
        let load = |count: Option<u64>| {
            self.options.load_changed(self.json, |file| match count {
                Some(count) => populate(&mut file.particles, count)
                    .map_err(|message| Error::Usage(format!("--sweep-particles: {message}"))),
                None => Ok(()),
            })
        };
        let mut rows: Vec<(usize, Vec<Measured>)> = Vec::new();
        let mut last = None;
        for count in counts {
            let mut input: SceneInput = load(count)?;
            input.settings.pixels = self.pixels;
            for &threads in &threads {
                if let Some(threads) = threads {
                    input.settings.threads = Some(threads.into());
                }
                let both = [input.scene.stereo.clone(), None];
                let rigs = if both[0].is_some() && !self.mono { &both[..] } else { &both[1..] };
                let measured = self.measure(&mut input.scene, &input.settings, rigs)?;
                rows.push((input.scene.particle_count(), measured));
            }
            last = Some((input.scene.camera.size, input.settings.tolerance));
        }
        let Some(([width, height], tolerance)) = last else { return Ok(0) };
        if self.json {
            let row = |(particles, measured): &(usize, Vec<Measured>)| {
                let of = |views: usize| measured.iter().find(|m| m.views == views).map(|m| times(&m.timing));
                let first = &measured[0];
                json!({
                    "particles": particles, "threads": first.threads, "device": first.device,
                    "gpu_path": first.gpu_path.map(GpuPath::name), "method": first.method.name(),
                    "simd": first.level.name(), "stereo": of(2), "mono": of(1),
                })
            };
            print_json(&json!({
                "scene": self.options.scene.display().to_string(),
                "size": [width, height],
                "tolerance": tolerance,
                "pixels": self.pixels.name(),
                "repeat": self.repeat,
                "warmup": self.warmup,
                "rows": rows.iter().map(row).collect::<Vec<_>>(),
            }))?;
        } else {
            let mut text = format!(
                "{}: {width}x{height}, {} frames after {} for warming up, times in ms\n\
                 {:>11} {:>7} {:>5}  {:<11} {:>10} {:>10} {:>9} {:>12}  stages\n",
                self.options.scene.display(),
                self.repeat,
                self.warmed(),
                "particles",
                "threads",
                "views",
                "method",
                "median",
                "fastest",
                "spread",
                "fragments"
            );
            for (particles, measured) in &rows {
                for Measured { timing, method, threads, views, .. } in measured {
                    let stages: Vec<String> =
                        timing.stages.iter().map(|(name, time)| format!("{name} {:.3}", ms(*time))).collect();
                    text += &format!(
                        "{particles:>11} {threads:>7} {views:>5}  {:<11} {:>10.3} {:>10.3} {:>9.3} {:>12}  {}\n",
                        method.name(),
                        ms(timing.median),
                        ms(timing.min),
                        ms(timing.spread),
                        timing.fragments,
                        stages.join(", ")
                    );
                }
            }
            print(&text)?;
        }
        Ok(0)
    }
}

/// Times in milliseconds and fragments, as an object.
fn times(timing: &Timing) -> Value {
    let stages: Map<_, _> = timing.stages.iter().map(|(name, time)| ((*name).to_owned(), json!(ms(*time)))).collect();
    json!({
        "median_ms": ms(timing.median),
        "min_ms": ms(timing.min),
        "spread_ms": ms(timing.spread),
        "stages": stages,
        "fragments": timing.fragments,
        "predicted_ms": timing.predicted.map(ms),
    })
}
