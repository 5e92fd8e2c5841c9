//! `devices`: what can render here, and which would be used.

use super::options::NO_GPU;
use super::{print, print_json};
use crate::error::Result;
use crate::render::cpu::simd::Level;
use clap::Args;
use serde_json::json;

/// Arguments of `devices`.
#[derive(Args)]
pub struct DevicesArgs {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl DevicesArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        let levels: Vec<_> = Level::available().into_iter().map(Level::name).collect();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        if self.json {
            print_json(&json!({
                "used": "cpu",
                "cpu": { "threads": threads, "simd": levels, "simd_used": Level::best().name() },
                "gpus": [],
                "why_no_gpu": NO_GPU,
            }))?;
        } else {
            print(&format!(
                "* cpu  {threads} threads, vector instructions: {} (uses {})\n  gpu  none: {NO_GPU}\n\
                 * is what --device auto uses\n",
                levels.join(", "),
                Level::best()
            ))?;
        }
        Ok(0)
    }
}
