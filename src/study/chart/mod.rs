//! Time against error of every method on a scene.
//!
//! A point is a scene, a method with one value of its main parameter, and what was measured of it:
//! - its time: the median over frames of the scene's views, the camera moved a little before each ([`timing`]);
//! - its errors against the `reference` integrator, in both eyes, at the camera's own place; in large pictures at a random
//!   sample of pixels, the same for every method.
//!
//! Pictures have one sample for each pixel, whatever the scene says: with more of them every method would be slower alike,
//! and errors average out.
//!
//! | file | question |
//! |---|---|
//! | [`candidates`] | which points there are |
//! | [`sample`] | at which pixels errors are measured |
//! | [`truth`] | what is true there |
//! | [`errors`] | how far off the pictures are |
//! | [`enlarge`] | how a picture of a part of the resolution is drawn |
//! | [`front`] | which points no other beats |
//! | [`table`] | the points as CSV |
//! | [`figure`] | the points as a picture |
//! | `digest` | what measures depend on, as a short key |

pub mod candidates;
mod digest;
pub mod enlarge;
pub mod errors;
pub mod figure;
pub mod front;
pub mod sample;
pub mod table;
pub mod truth;

pub use candidates::{CANDIDATES, Candidate};
pub use errors::Errors;
pub use sample::Sample;
pub use table::Row;
pub use truth::Truth;

use std::time::{Duration, Instant};

use crate::error::Result;
use crate::picture::Film;
use crate::render::cpu::simd::Level;
use crate::render::{Device, Progress, Rendering, Session, Settings, Statistics};
use crate::scene::Scene;
use crate::study::timing::{self, Timing};

/// Frames that are drawn before any is measured.
const WARMUP: u32 = 2;
/// Fewest and most frames that are measured.
const FRAMES: [u32; 2] = [5, 1000];

/// A scene that is charted.
pub struct Subject {
    scene: Scene,
    settings: Settings,
    sample: Sample,
    /// Key of the scene's content, of the sample and of the version of this crate.
    content: String,
    /// Threads and vector instructions that frames are timed with.
    machine: (usize, &'static str),
    /// As [`Subject::warning`].
    warning: Option<String>,
}

/// Draws a candidate, frame after frame.
struct Painter {
    /// As [`Candidate::enlargement`].
    enlargement: u32,
    /// Enlarged pictures; none without enlargement.
    large: Vec<Film>,
    /// The frame that was drawn last.
    last: Option<Rendering>,
}

impl Painter {
    fn draw(&mut self, session: &mut Session, scene: &mut Scene) -> Result<Statistics> {
        if let Some(last) = self.last.take() {
            session.recycle(last);
        }
        let n = self.enlargement;
        if n == 1 {
            return self.keep(session, scene);
        }
        let camera = scene.camera.clone();
        scene.camera = enlarge::smaller(&camera, n);
        let drawn = self.keep(session, scene);
        scene.camera = camera;
        let mut statistics = drawn?;
        let start = Instant::now();
        let small = self.last.iter().flat_map(|last| &last.films);
        let pairs: Vec<_> = small.zip(&mut self.large).collect();
        session.install(|| pairs.into_iter().for_each(|(film, out)| enlarge::enlarge(film, n, out)));
        let took = start.elapsed();
        statistics.stages.push(("enlarge", took));
        statistics.total += took;
        Ok(statistics)
    }

    fn keep(&mut self, session: &mut Session, scene: &Scene) -> Result<Statistics> {
        let mut rendering = session.draw(scene, &())?;
        let statistics = std::mem::take(&mut rendering.statistics);
        self.last = Some(rendering);
        Ok(statistics)
    }
}

impl Subject {
    /// A scene with its settings, of which method and tolerance count for nothing. Errors are measured at no more than `pixels`
    /// pixels of each view, at least 1. Supersampling is turned off.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn new(mut scene: Scene, settings: &Settings, pixels: usize) -> Result<Self> {
        scene.camera.samples = 1;
        let sample = Sample::new(scene.camera.size, pixels);
        let content = digest::digest(&(env!("CARGO_PKG_VERSION"), &scene, sample.pixels.len()));
        let session = Session::new(settings)?;
        let level = settings.simd.unwrap_or_else(Level::best);
        let machine = (session.threads(), level.name());
        Ok(Self { scene, settings: settings.clone(), sample, content, machine, warning: None })
    }

    /// The scene, with one sample for each pixel.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The settings it was given.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Where errors are measured.
    pub fn sample(&self) -> &Sample {
        &self.sample
    }

    /// Number of threads and name of the vector instructions that frames are timed with.
    pub fn machine(&self) -> (usize, &'static str) {
        self.machine
    }

    /// Why the CPU drew the last candidate though a GPU was wanted first.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// 16 hexadecimal digits that stand for all that the truth depends on.
    pub fn truth_key(&self) -> &str {
        &self.content
    }

    /// 16 hexadecimal digits that stand for all that a candidate's measures depend on, but for the machine's speed.
    pub fn key(&self, candidate: &Candidate) -> String {
        let Settings { method, opacity_model, tolerance, .. } = candidate.settings(&self.scene, &self.settings);
        let drawing = (method, opacity_model, tolerance, candidate.enlargement());
        let device = &self.settings.device;
        match device {
            Device::Auto | Device::Cpu => digest::digest(&(&self.content, drawing, self.machine)),
            Device::Gpu(_) => digest::digest(&(&self.content, drawing, self.machine, device, self.settings.gpu_path)),
        }
    }

    /// Computes what is true at the sample's pixels.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn truth(&self, progress: &dyn Progress) -> Result<Truth> {
        Ok(Session::new(&self.settings)?.install(|| Truth::new(&self.scene, &self.sample, progress)))
    }

    /// Measures a candidate: after some frames to warm up at least five, and more while they do not take longer than
    /// `share` in all.
    ///
    /// # Errors
    /// As [`Session::draw`], for a scene that the method cannot render.
    pub fn measure(&mut self, candidate: &Candidate, truth: &Truth, share: Duration) -> Result<Row> {
        let settings = candidate.settings(&self.scene, &self.settings);
        let enlargement = candidate.enlargement();
        let views = if enlargement == 1 { 0 } else { self.scene.views().len() };
        let large = vec![Film::new(self.scene.camera.size); views];
        let mut session = Session::new(&settings)?;
        let mut painter = Painter { enlargement, large, last: None };
        let enough = |frames, spent| frames >= FRAMES[0] && (frames >= FRAMES[1] || spent >= share);
        let scene = &mut self.scene;
        let measured = session.on_threads(|session| {
            let measured = timing::frames(scene, WARMUP, enough, |scene| painter.draw(session, scene))?;
            painter.draw(session, scene).map(|_| measured)
        })?;
        let timing = Timing::new(&measured);
        self.warning = painter.last.as_ref().and_then(|last| last.warning.clone());
        let (method, films) =
            painter.last.as_ref().map_or((settings.method, &[][..]), |last| (last.method, &last.films));
        let films = if enlargement == 1 { films } else { &painter.large };
        let errors = Errors::new(films, truth, &self.sample);
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        Ok(Row {
            key: self.key(candidate),
            method: candidate.method.into(),
            parameter: candidate.parameter.into(),
            value: candidate.value.into(),
            tolerance: candidate.tolerance,
            drawn: method.name().into(),
            frames: timing.frames,
            median_ms: ms(timing.median),
            min_ms: ms(timing.min),
            spread_ms: ms(timing.spread),
            fragments: timing.fragments,
            rmse: errors.rmse,
            rmse_se: errors.rmse_se,
            max: errors.max,
            q99: errors.q99,
            transmittance_max: errors.transmittance_max,
            inconsistency_rmse: errors.inconsistency.map(|it| it.rmse),
            inconsistency_max: errors.inconsistency.map(|it| it.max),
            stages: timing.stages.iter().map(|&(name, time)| (name.to_owned(), ms(time))).collect(),
        })
    }
}
