//! `chart`: time against error of every method on some scenes.

use super::options::{CommonOptions, SceneOptions};
use super::progress::Bar;
use super::{print, print_json, same_file, warn};
use crate::error::{Error, Result};
use crate::input::SceneInput;
use crate::picture::output::{self, Content, Job};
use crate::render::{OpacityModel, Progress};
use crate::study::chart::{CANDIDATES, Candidate, Row, Sample, Subject, Truth, candidates, figure, table};
use clap::Args;
use serde_json::{Map, Value, json};
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `chart`.
#[derive(Args)]
#[command(
    after_help = "Draws each scene with every method at some values of its main parameter, measures the time of a frame \
                        as `bench` does and the error against `reference` in both eyes, and writes DIR/SCENE.csv, .svg and \
                        .png with the front of those points that no other beats in both.\n\n\
                        The CSV is saved after every point; what it holds already for the same scene, size, settings, threads \
                        and version is not measured again. The reference is kept too, as DIR/SCENE.reference-KEY.csv.\n\n\
                        Scenes are charted with one sample for each pixel. Methods draw with a tolerance of 1/255 where \
                        that is not what varies."
)]
pub struct ChartArgs {
    /// Scene files (TOML), or files of particles, volumes or meshes; no two of one name
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,

    /// Folder for tables and pictures; created if missing
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,

    /// Measure these alone, comma separated: viewplane, viewpoint, perspective, spherical, sheet, slab, half, quarter, eighth
    /// (perspective at a part of the resolution, enlarged), auto [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    methods: Vec<String>,

    /// Seconds of measured frames for each scene, shared out among its points; each has five frames at least
    #[arg(long, value_name = "SECONDS", default_value = "60", allow_hyphen_values = true)]
    budget: String,

    /// Pixels of each eye that errors are measured at; pictures with more are judged by so many, chosen at random
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=1 << 28))]
    sample: u32,

    /// Measure all points again
    #[arg(long)]
    fresh: bool,

    #[command(flatten)]
    common: CommonOptions,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A scene to chart, with the names of its files.
struct Task {
    scene: PathBuf,
    subject: Subject,
    notes: Vec<String>,
    csv: PathBuf,
    svg: PathBuf,
    png: PathBuf,
    /// Rows that are there already.
    known: Vec<Row>,
}

/// What became of a scene.
struct Outcome {
    /// One row or none for each of [`CANDIDATES`].
    rows: Vec<Option<Row>>,
    /// How many of them were measured now.
    measured: usize,
    /// Largest bound of the reference's own error; absent where nothing was measured.
    reference_error: Option<f64>,
    notes: Vec<String>,
}

impl ChartArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        let wanted = self.wanted()?;
        let budget = self.budget()?;
        for (i, scene) in self.scenes.iter().enumerate() {
            if let Some(other) = self.scenes[..i].iter().find(|other| other.file_stem() == scene.file_stem()) {
                let (a, b, stem) = (other.display(), scene.display(), Path::new(stem(scene)).display());
                return Err(Error::Usage(format!(
                    "{a} and {b} would both be written as {stem}.csv; chart one at a time"
                )));
            }
        }
        // All that can be wrong is said before the first frame.
        let tasks = self.scenes.iter().map(|scene| self.task(scene)).collect::<Result<Vec<_>>>()?;
        check_folder(&self.output)?;
        let mut reports = Vec::new();
        for mut task in tasks {
            let outcome = self.chart(&mut task, &wanted, budget)?;
            if self.json {
                reports.push(report(&task, &outcome));
            } else {
                print(&words(&task, &outcome))?;
            }
        }
        if self.json {
            print_json(&json!({ "scenes": reports }))?;
        }
        Ok(0)
    }

    /// Whether each of [`CANDIDATES`] is asked for.
    fn wanted(&self) -> Result<Vec<bool>> {
        let all = candidates::methods();
        let asked: Vec<&str> = self.methods.iter().map(|name| name.trim()).collect();
        if let Some(name) = asked.iter().find(|name| !all.contains(name)) {
            return Err(Error::Usage(format!("--methods {name}: unknown; allowed: {}", all.join(", "))));
        }
        Ok(CANDIDATES.iter().map(|candidate| asked.is_empty() || asked.contains(&candidate.method)).collect())
    }

    fn budget(&self) -> Result<Duration> {
        let seconds = self.budget.parse().ok().filter(|seconds| (0.0..=1e6).contains(seconds));
        seconds.map(Duration::from_secs_f64).ok_or_else(|| {
            Error::Usage(format!("--budget {}: allowed: a number of seconds from 0 to 1000000", self.budget))
        })
    }

    /// Reads a scene and what is known of it.
    fn task(&self, scene: &Path) -> Result<Task> {
        let path = |ending: &str| {
            let mut name = stem(scene).to_os_string();
            name.push(ending);
            self.output.join(name)
        };
        let [csv, svg, png] = [".csv", ".svg", ".png"].map(path);
        for file in [&csv, &svg, &png] {
            if same_file(file, scene) {
                return Err(Error::output(file, "it is what is to be charted; choose another folder with -o"));
            }
        }
        // Data often lie beside a scene under its name: only a table of this command is ever replaced.
        let known = match fs::read(&csv) {
            Ok(bytes) => table::from_csv(&String::from_utf8_lossy(&bytes)).ok_or_else(|| {
                Error::output(&csv, "a file that is no table of `chart` is there; choose another folder with -o")
            })?,
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Vec::new(),
            Err(error) => return Err(Error::output(&csv, format!("cannot be looked at: {}", output::reason(&error)))),
        };
        let input = SceneOptions::of(scene.to_path_buf(), self.common.clone()).load(self.json)?;
        let notes = notes(&input);
        let subject = Subject::new(input.scene, &input.settings, self.sample as usize)?;
        Ok(Task { scene: scene.to_path_buf(), subject, notes, csv, svg, png, known })
    }

    /// Measures what is asked for and not known, and writes table and pictures.
    fn chart(&self, task: &mut Task, wanted: &[bool], budget: Duration) -> Result<Outcome> {
        let keys: Vec<String> = CANDIDATES.iter().map(|candidate| task.subject.key(candidate)).collect();
        let known = |key: &String| task.known.iter().find(|row| row.key == *key).cloned();
        let mut rows: Vec<Option<Row>> = keys.iter().map(known).collect();
        let mut notes = task.notes.clone();
        notes.extend(sampling(task.subject.sample()));
        let dropped = task.known.iter().filter(|row| !keys.contains(&row.key)).count();
        if dropped > 0 {
            let name = task.csv.display();
            notes.push(format!("{dropped} points in {name} were of another scene, size, setting or version: left out"));
        }
        let todo: Vec<usize> =
            (0..CANDIDATES.len()).filter(|&i| wanted[i] && (self.fresh || rows[i].is_none())).collect();
        let mut measured = 0;
        let mut reference_error = None;
        if !todo.is_empty() {
            let truth = self.truth(task)?;
            reference_error = Some(truth.error());
            let bar = Bar::new("measuring", self.json);
            let end = Instant::now() + budget;
            for (done, &i) in todo.iter().enumerate() {
                bar.update(done as u64, todo.len() as u64);
                let left = end.saturating_duration_since(Instant::now());
                let candidate: &Candidate = &CANDIDATES[i];
                match task.subject.measure(candidate, &truth, left / (todo.len() - done) as u32) {
                    Ok(row) => {
                        rows[i] = Some(row);
                        if let Some(warning) = task.subject.warning() {
                            warn(warning);
                            notes.push(format!("{}: {warning}", candidate.label()));
                        }
                        measured += 1;
                    }
                    // The other methods may well be able to.
                    Err(error) => {
                        rows[i] = None;
                        notes.push(format!("{} is left out: {error}", candidate.label()));
                        continue;
                    }
                }
                output::write_bytes(&task.csv, table::to_csv(&present(&rows)).as_bytes())?;
            }
        }
        let present = present(&rows);
        let csv = table::to_csv(&present);
        let name = Path::new(stem(&task.scene)).display().to_string();
        let drawing = figure::draw(&format!("{name}: time against error"), &subtitle(&task.subject), &present);
        let png = drawing.png().map_err(|message| Error::output(&task.png, message))?;
        output::write_all(&[
            Job { path: &task.csv, content: Content::Bytes(csv.as_bytes()) },
            Job { path: &task.svg, content: Content::Bytes(drawing.svg().as_bytes()) },
            Job { path: &task.png, content: Content::Bytes(&png) },
        ])?;
        Ok(Outcome { rows, measured, reference_error, notes })
    }

    /// The truth, from its file if that is there and whole.
    fn truth(&self, task: &Task) -> Result<Truth> {
        let subject = &task.subject;
        let mut name = stem(&task.scene).to_os_string();
        name.push(format!(".reference-{}.csv", subject.truth_key()));
        let path = self.output.join(name);
        let views = subject.scene().views().len();
        let kept = fs::read_to_string(&path).ok().and_then(|text| Truth::from_csv(&text, subject.sample(), views));
        if let Some(truth) = kept {
            return Ok(truth);
        }
        let truth = subject.truth(&Bar::new("computing the reference", self.json))?;
        output::write_bytes(&path, truth.to_csv().as_bytes())?;
        Ok(truth)
    }
}

/// A scene's name; a path that ends in none has been refused by the time it matters.
fn stem(scene: &Path) -> &OsStr {
    scene.file_stem().unwrap_or_default()
}

fn present(rows: &[Option<Row>]) -> Vec<Row> {
    rows.iter().flatten().cloned().collect()
}

/// Whether results can be written there; the folder is made.
fn check_folder(folder: &Path) -> Result<()> {
    if folder.exists() && !folder.is_dir() {
        return Err(Error::output(folder, "it is a file; -o names the folder that tables and pictures go to"));
    }
    let made = fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder));
    made.map(drop).map_err(|error| Error::output(folder, output::reason(&error)))
}

/// What the reader of a scene's chart should know.
fn notes(input: &SceneInput) -> Vec<String> {
    let mut notes = input.notes.clone();
    let samples = input.scene.camera.samples;
    if samples > 1 {
        notes.push(format!("camera.samples = {samples} is charted as 1: one sample for each pixel"));
    }
    match input.settings.opacity_model {
        OpacityModel::Linear => notes.push(
            "opacity_model = \"linear\" is what viewplane, viewpoint, perspective, half, quarter and eighth draw; the reference \
             means optical depth, and the difference counts as their error"
                .into(),
        ),
        OpacityModel::Exponential => {}
    }
    notes
}

/// What errors at a part of the pixels mean.
fn sampling(sample: &Sample) -> Option<String> {
    (!sample.is_whole()).then(|| {
        format!(
            "errors are those of {} of {} pixels of each view, chosen at random, one in each cell of a grid: the largest is \
             that of the sample, rmse_se the standard error of rmse",
            sample.pixels.len(),
            sample.all()
        )
    })
}

fn subtitle(subject: &Subject) -> String {
    let (scene, sample, (threads, simd)) = (subject.scene(), subject.sample(), subject.machine());
    let [width, height] = scene.camera.size;
    let views = scene.views().len();
    let pixels =
        if sample.is_whole() { "every pixel".into() } else { format!("{} pixels per view", sample.pixels.len()) };
    let particles = scene.particle_count();
    let threads = if threads == 1 { "1 thread".into() } else { format!("{threads} threads") };
    format!("{particles} particles, {views} x {width}x{height}, {threads}, {simd}; errors at {pixels}")
}

fn words(task: &Task, outcome: &Outcome) -> String {
    let rows = present(&outcome.rows);
    let mut text = String::new();
    for path in [&task.csv, &task.svg, &task.png] {
        text += &format!("{}\n", path.display());
    }
    text += &format!("{}: {}\n", task.scene.display(), subtitle(&task.subject));
    let (all, known) = (rows.len(), rows.len() - outcome.measured);
    text += &format!("{all} points, {known} of them known before; those that no other beats in both time and RMSE:\n");
    let on_front = table::on_front(&rows);
    let mut front: Vec<&Row> = rows.iter().zip(on_front).filter(|(_, front)| *front).map(|(row, _)| row).collect();
    front.sort_by(|a, b| a.median_ms.total_cmp(&b.median_ms));
    for row in front {
        let name = format!("{} {}", row.method, row.value);
        text += &format!(
            "  {name:<20}{:>10.3} ms  RMSE {:.2e}  99 % {:.2e}  max {:.2e}\n",
            row.median_ms, row.rmse, row.q99, row.max
        );
    }
    for note in &outcome.notes {
        text += &format!("note: {note}\n");
    }
    text
}

fn report(task: &Task, outcome: &Outcome) -> Value {
    let subject = &task.subject;
    let (scene, sample, (threads, simd)) = (subject.scene(), subject.sample(), subject.machine());
    let rows = present(&outcome.rows);
    let points = rows.iter().zip(table::on_front(&rows)).map(|(row, front)| {
        let stages: Map<_, _> = row.stages.iter().map(|(name, ms)| (name.clone(), json!(ms))).collect();
        // Infinities become null.
        json!({
            "key": row.key, "method": row.method, "parameter": row.parameter, "value": row.value,
            "tolerance": row.tolerance, "drawn": row.drawn, "frames": row.frames, "median_ms": row.median_ms,
            "min_ms": row.min_ms, "spread_ms": row.spread_ms, "fragments": row.fragments, "rmse": row.rmse,
            "rmse_se": row.rmse_se, "max": row.max, "q99": row.q99, "transmittance_max": row.transmittance_max,
            "inconsistency_rmse": row.inconsistency_rmse, "inconsistency_max": row.inconsistency_max,
            "front": front, "stages": stages,
        })
    });
    json!({
        "scene": task.scene.display().to_string(),
        "csv": task.csv.display().to_string(),
        "svg": task.svg.display().to_string(),
        "png": task.png.display().to_string(),
        "particles": scene.particle_count(),
        "size": scene.camera.size,
        "views": scene.views().len(),
        "threads": threads,
        "simd": simd,
        "opacity_model": subject.settings().opacity_model.name(),
        "pixels": sample.pixels.len(),
        "pixels_of": sample.all(),
        "measured": outcome.measured,
        "reference_error": outcome.reference_error,
        "points": points.collect::<Vec<_>>(),
        "notes": outcome.notes,
    })
}
