//! `devices`: what can render here, and which would be used.

use super::options::calibration_file;
use super::{print, print_json};
use crate::error::Result;
use crate::render::cpu::simd::Level;
use crate::render::gpu::NO_BLENDING;
use crate::render::gpu::adapter::{self, Candidate, Class, INSTALL};
use crate::render::{GpuPath, Method, calibration};
use clap::Args;
use serde_json::json;
use std::path::Path;

/// Arguments of `devices`.
#[derive(Args)]
pub struct DevicesArgs {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// When `auto` takes a GPU, for people.
const RULE: &str = "auto uses the CPU unless a hardware GPU is there, the method is one that a GPU draws, and the frame is \
                    predicted to take the CPU a second or more";

/// How `--gpu-path auto` draws billboards on an adapter, as far as that is known, and why.
fn path(found: &Candidate, file: Option<&Path>) -> (Option<GpuPath>, String) {
    if !found.blends {
        return (Some(GpuPath::Compute), format!("it {NO_BLENDING}"));
    }
    match file.and_then(|file| calibration::known(file, &found.describe())) {
        Some(speeds) => (Some(speeds.path()), speeds.words()),
        None => (None, "measured when it first draws them".into()),
    }
}

impl DevicesArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        let levels: Vec<_> = Level::available().into_iter().map(Level::name).collect();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let adapters = adapter::adapters();
        let hardware = adapters.iter().find(|found| found.class != Class::Software && found.lacks.is_none());
        let why_no_gpu = match (hardware, adapters.is_empty()) {
            (Some(_), _) => None,
            (None, true) => Some(adapter::why_none()),
            (None, false) => Some(format!(
                "only software drivers or adapters that lack something; a software driver is used by name alone, for \
                 example --device gpu:{}. {INSTALL}",
                adapters[0].name.split_whitespace().next().unwrap_or_default()
            )),
        };
        let methods: Vec<_> =
            Method::ALL.iter().filter(|method| method.check_gpu(None).is_ok()).map(|method| method.name()).collect();
        let file = calibration_file();
        let paths: Vec<(Option<GpuPath>, String)> = adapters.iter().map(|found| path(found, file.as_deref())).collect();
        if self.json {
            let gpus: Vec<_> = adapters
                .iter()
                .zip(&paths)
                .map(|(found, (path, why))| {
                    json!({
                        "name": found.name,
                        "class": found.class.name(),
                        "backend": found.backend,
                        "driver": found.driver,
                        "lacks": found.lacks,
                        "gpu_path": path.map(GpuPath::name),
                        "gpu_path_why": why,
                    })
                })
                .collect();
            print_json(&json!({
                "used": "cpu",
                "gpu": hardware.map(|found| found.name.clone()),
                "rule": RULE,
                "cpu": { "threads": threads, "simd": levels, "simd_used": Level::best().name() },
                "gpus": gpus,
                "gpu_methods": methods,
                "why_no_gpu": why_no_gpu,
            }))?;
        } else {
            let mut text = format!(
                "* cpu  {threads} threads, vector instructions: {} (uses {})\n",
                levels.join(", "),
                Level::best()
            );
            for (found, (path, why)) in adapters.iter().zip(&paths) {
                let mark = if hardware.is_some_and(|used| std::ptr::eq(used, found)) { "+" } else { " " };
                let lacks = found.lacks.as_ref().map_or_else(String::new, |what| format!("; lacks {what}"));
                text += &format!("{mark} gpu  {}{lacks}\n", found.describe());
                let path = path.map_or("compute or raster", GpuPath::name);
                text += &format!("       draws billboards by {path}: {why}\n");
            }
            match &why_no_gpu {
                Some(why) => text += &format!("no GPU: {why}\n"),
                None => text += "+ is what --device gpu uses\n",
            }
            text +=
                &format!("* is what --device auto uses; {RULE}\nmethods that a GPU draws: {}\n", methods.join(", "));
            print(&text)?;
        }
        Ok(0)
    }
}
