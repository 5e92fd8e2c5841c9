//! WHO ASKS: one file per command.
//!
//! A command is what was typed ([`clap`] arguments), turned into validated arguments, turned into a library call. Nothing
//! below this room prints, knows a terminal or ends the process.

pub mod bench;
pub mod chart;
pub mod compare;
pub mod compose;
mod contents;
pub mod devices;
pub mod errors;
mod options;
mod progress;
pub mod render;
pub mod scene;
mod verification;

use crate::error::Result;
use crate::render::Method;
use crate::scene::Scene;
use clap::{Parser, Subcommand};
use serde_json::{Map, Value};
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Offscreen stereo images of gas: fog, cloud, smoke as particles, left and right views, anaglyphs, side-by-side pictures.
#[derive(Parser)]
#[command(name = "stereomist", version, about, max_term_width = 110)]
#[command(after_help = "Exit codes: 0 done; 1 a comparison or limit asked for was exceeded; 2 wrong use or input; \
                        3 no usable device.")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene file to left, right, anaglyph and side-by-side pictures
    Render(render::RenderArgs),
    /// Make an anaglyph or side-by-side picture from two existing pictures
    Compose(compose::ComposeArgs),
    /// Projection and parallax error surfaces of billboards: CSV, plots, and the distance from which on they do not matter
    Errors(Box<errors::ErrorsArgs>),
    /// Difference of two pictures, or of two left-right pairs
    Compare(compare::CompareArgs),
    /// Time per stereo frame of a scene, by stage, without files
    Bench(bench::BenchArgs),
    /// Time against error of every method on some scenes: CSV, SVG and PNG
    Chart(chart::ChartArgs),
    /// What a scene file holds and how it would be rendered, or what is in a file of particles, a volume or a mesh
    Scene(scene::SceneArgs),
    /// Devices that can render, and which would be used
    Devices(devices::DevicesArgs),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match &cli.command {
        Command::Render(args) => args.run(),
        Command::Compose(args) => args.run(),
        Command::Errors(args) => args.run(),
        Command::Compare(args) => args.run(),
        Command::Bench(args) => args.run(),
        Command::Chart(args) => args.run(),
        Command::Scene(args) => args.run(),
        Command::Devices(args) => args.run(),
    };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            // A closed stderr is no reason to panic.
            let _ = writeln!(io::stderr(), "error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

/// Prints to stdout; a reader that has gone away (`| head`) is not an error of ours.
fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(crate::Error::Output { path: "stdout".into(), message: error.to_string() })
        }
        _ => Ok(()),
    }
}

/// Says on stderr, in a line, what was done otherwise than was asked for. A closed stderr changes nothing.
fn warn(text: &str) {
    let _ = writeln!(io::stderr(), "warning: {text}");
}

/// Prints one JSON object.
fn print_json(value: &Value) -> Result<()> {
    print(&format!("{value:#}\n"))
}

/// The parameters in force of a method, as an object.
fn parameters(method: Method, scene: &Scene) -> Map<String, Value> {
    method.parameters(scene).into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Whether two paths name the same file, which need not be there.
fn same_file(a: &Path, b: &Path) -> bool {
    // What is not there yet has the folder where it will be.
    let resolve = |path: &Path| {
        path.canonicalize().ok().or_else(|| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(folder.canonicalize().ok()?.join(path.file_name()?))
        })
    };
    a == b || resolve(a).is_some_and(|a| resolve(b) == Some(a))
}

/// Milliseconds.
fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
