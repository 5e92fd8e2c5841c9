//! `bench`: time per stereo frame by stage, without files.

use super::options::SceneOptions;
use super::{ms, parameters, print, print_json};
use crate::error::Result;
use crate::render::Session;
use crate::study::timing;
use clap::Args;
use serde_json::{Map, json};

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
        let mut session = Session::new(&input.settings)?;
        let mut drawn = None;
        let timing = timing::frames(
            scene,
            self.warmup,
            |frames, _| frames >= self.repeat,
            |scene| {
                let mut rendering = session.draw(scene, &())?;
                let statistics = std::mem::take(&mut rendering.statistics);
                drawn = Some((rendering.method, rendering.level, rendering.threads));
                session.recycle(rendering);
                Ok(statistics)
            },
        )?;
        let (median, min, spread) = (ms(timing.median), ms(timing.min), ms(timing.spread));
        let stages: Vec<(&str, f64)> = timing.stages.iter().map(|&(name, time)| (name, ms(time))).collect();
        let fragments = timing.fragments;
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
