//! `bench`: time per stereo frame by stage, without files.

use super::options::SceneOptions;
use super::{ms, parameters, print, print_json};
use crate::error::Result;
use crate::render::{Session, Statistics};
use clap::Args;
use serde_json::{Map, json};
use std::time::Duration;

/// Arguments of `bench`.
#[derive(Args)]
pub struct BenchArgs {
    #[command(flatten)]
    options: SceneOptions,

    /// Frames that are measured
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,

    /// Frames before them that are not
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    warmup: u32,

    /// Render one view from the middle instead of two
    #[arg(long)]
    mono: bool,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl BenchArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        let mut input = self.options.load(self.json)?;
        if self.mono {
            input.scene.stereo = None;
        }
        let scene = &mut input.scene;
        let forward = (scene.camera.look_at - scene.camera.position).normalize() * 1e-4;
        let mut session = Session::new(&input.settings)?;
        let mut frames: Vec<Statistics> = Vec::new();
        let mut drawn = None;
        for frame in 0..self.warmup + self.repeat {
            // A step forward, so that nothing can be kept from the frame before.
            scene.camera.position += forward;
            scene.camera.look_at += forward;
            let mut rendering = session.draw(scene, &())?;
            if frame >= self.warmup {
                frames.push(std::mem::take(&mut rendering.statistics));
            }
            drawn = Some((rendering.method, rendering.level, rendering.threads));
            session.recycle(rendering);
        }
        let totals: Vec<Duration> = frames.iter().map(|frame| frame.total).collect();
        let (median, min) = (ms(median(&totals)), ms(totals.iter().copied().min().unwrap_or_default()));
        let spread = ms(quantile(&totals, 0.75)) - ms(quantile(&totals, 0.25));
        let stages: Vec<(&str, f64)> = frames[0]
            .stages
            .iter()
            .enumerate()
            .map(|(i, &(name, _))| {
                let times: Vec<Duration> = frames.iter().map(|frame| frame.stages[i].1).collect();
                (name, ms(self::median(&times)))
            })
            .collect();
        let fragments = frames[frames.len() - 1].fragments;
        let (method, level, threads) = drawn.expect("at least one frame is drawn");
        let views = if scene.stereo.is_some() { 2 } else { 1 };
        let [width, height] = scene.camera.size;
        if self.json {
            let stages: Map<_, _> = stages.iter().map(|&(name, time)| (name.to_string(), json!(time))).collect();
            print_json(&json!({
                "scene": self.options.scene.display().to_string(),
                "particles": scene.particle_count(),
                "size": [width, height],
                "views": views,
                "method": method.name(),
                "parameters": parameters(method, scene),
                "tolerance": input.settings.tolerance,
                "simd": level.name(),
                "threads": threads,
                "repeat": self.repeat,
                "warmup": self.warmup,
                "median_ms": median,
                "min_ms": min,
                "spread_ms": spread,
                "stages": stages,
                "fragments": fragments,
            }))?;
        } else {
            let mut text = format!(
                "{}: {} particles, {views} x {width}x{height}, {}, {level}, {threads} threads\n\
                 median {median:.3} ms, fastest {min:.3} ms, middle half within {spread:.3} ms, {} frames after {} for warming up\n",
                self.options.scene.display(),
                scene.particle_count(),
                method.name(),
                self.repeat,
                self.warmup
            );
            for (name, time) in &stages {
                text += &format!("  {name:<10}{time:>10.3} ms\n");
            }
            text += &format!(
                "  {:.1} million fragments, {:.2} per nanosecond\n",
                fragments as f64 / 1e6,
                fragments as f64 / median / 1e6
            );
            print(&text)?;
        }
        Ok(0)
    }
}

fn median(times: &[Duration]) -> Duration {
    quantile(times, 0.5)
}

/// The value at a share of the sorted times; `times` is not empty.
fn quantile(times: &[Duration], share: f64) -> Duration {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}
