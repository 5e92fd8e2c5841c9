//! `errors`: projection and parallax error surfaces.
//!
//! | file | does |
//! |---|---|
//! | `mod.rs` | the command: what is written where |
//! | `request.rs` | what was typed, as a grid and what is asked of it |
//! | `question.rs` | the inverse question and its answer |
//! | `chart.rs` | a surface as a plot |

mod chart;
mod question;
mod request;

use super::progress::Bar;
use super::{print, print_json, same_file};
use crate::error::{Error, Result};
use crate::picture::output;
use crate::study::error_surface::Alignment;
use crate::study::error_surface::grid::{self, Extreme, Grid, Plane, Request, Summary};
use clap::Args;
use question::{Answer, Question};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// How far a billboard's points lie from where another alignment shows them.
///
/// Johnson & McAllister (2005), section 3: camera space, the eye at the origin looking down -z, the view plane at distance N.
/// A billboard with its centre at C is parallel to the view plane or faces the eye; a point of it is projected both ways and
/// subtracted. Parallax error: right eye minus left eye. Without -o, --plot, --solve and --json the CSV goes to stdout.
#[derive(Args)]
pub struct ErrorsArgs {
    /// CSV to write: cx,cy,cz and a column for each form; cells at or past the form's own pole are empty
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,

    /// Which error: projection or parallax [default: projection]
    #[arg(long, value_name = "ERROR")]
    of: Option<String>,

    /// Which component: x or y [default: x; with --solve the length of both]
    #[arg(long, value_name = "x|y")]
    component: Option<String>,

    /// Which coordinates of C vary: xz or xy [default: xz]
    #[arg(long, value_name = "xz|xy")]
    vary: Option<String>,

    /// C_x, both ends included [default: -2:2:81]
    #[arg(long, value_name = "MIN:MAX:COUNT", allow_hyphen_values = true)]
    x: Option<String>,

    /// C_y: a range where it varies [default: -2:2:81], else a number [default: 0]
    #[arg(long, value_name = "Y", allow_hyphen_values = true)]
    y: Option<String>,

    /// C_z, negative in front of the eye: a range where it varies [default: -6:-1:81], else a number [default: 0]
    #[arg(long, value_name = "Z", allow_hyphen_values = true)]
    z: Option<String>,

    /// Radius r of the billboard: half its side [default: 0.5]
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    radius: Option<String>,

    /// Distance N of the view plane [default: 1]
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    near: Option<String>,

    /// Interocular distance I, for the parallax error [default: 0.065]
    #[arg(long, value_name = "I", allow_hyphen_values = true)]
    interocular: Option<String>,

    /// How to compute it: numeric (from the definitions), closed (what follows from them), printed (as in the paper)
    /// [default: closed; with --figure closed,printed]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    form: Vec<String>,

    /// Precision of inputs, arithmetic and result: f64 or f32 [default: f64]
    #[arg(long, value_name = "f64|f32")]
    precision: Option<String>,

    /// Point of the billboard: right-edge, left-edge, top-edge, bottom-edge, corner, or A,B from -1 to 1 (offsets over r)
    /// [default: right-edge]
    #[arg(long, value_name = "POINT", allow_hyphen_values = true)]
    point: Option<String>,

    /// The first's place minus the second's: viewplane, viewpoint, perspective (the exact projection)
    /// [default: viewplane,viewpoint]
    #[arg(long, value_name = "A,B")]
    between: Option<String>,

    /// A figure of the paper: 4, 5, 8, 9 (projection error), 10, 11, 12, 13 (parallax error)
    #[arg(long, value_name = "NUMBER")]
    figure: Option<String>,

    /// Draw each form as a 3D surface and as a heat map with contour lines
    #[arg(long, value_name = "OUT.svg|png")]
    plot: Option<PathBuf>,

    /// Solve for the smallest distance (for --radius) or, with a single --z, the largest radius at which the error stays
    /// within the tolerance at every point of every billboard in the frame: tolerance=0.5px, 1arcmin, or a length
    #[arg(long, value_name = "tolerance=T", allow_hyphen_values = true)]
    solve: Option<String>,

    /// What errors are measured in: length (on the view plane), px or arcmin [default: length]
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,

    /// Vertical field of view of the frame in degrees, for px, arcmin and --solve [default: 40]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    fov_y_deg: Option<String>,

    /// Width and height of the frame in pixels [default: 1024x768]
    #[arg(long, value_name = "WxH")]
    size: Option<String>,

    /// Distance of the viewer from the screen in metres, for arcmin
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    viewer_distance: Option<String>,

    /// Width of the picture on the screen in metres, for arcmin
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    screen_width: Option<String>,

    /// Print one JSON object: what each form held, and what --solve found
    #[arg(long)]
    json: bool,
}

impl ErrorsArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        // What was typed stands in messages, which are one line whatever it holds.
        self.execute().map_err(|error| match error {
            Error::Usage(message) => Error::Usage(escape_controls(&message)),
            other => other,
        })
    }

    fn execute(&self) -> Result<u8> {
        let figure = self.figure()?;
        let request = self.request(figure)?;
        let question = self.solve.as_deref().map(|text| self.question(text, &request)).transpose()?;
        let stdout = Path::new("-");
        let output = match &self.output {
            Some(path) => Some(path.as_path()),
            None if self.plot.is_none() && self.solve.is_none() && !self.json => Some(stdout),
            None => None,
        };
        // An inverse question alone has no surface, and a single C_z there may stand for the depth.
        let surface = output.is_some() || self.plot.is_some() || self.solve.is_none();
        let grid = surface.then(|| self.grid(figure)).transpose()?;
        if output.zip(self.plot.as_deref()).is_some_and(|(csv, plot)| same_file(csv, plot)) {
            return Err(Error::Usage("-o and --plot name the same file".into()));
        }
        if output == Some(stdout) && (self.json || self.solve.is_some()) {
            return Err(Error::Usage("the CSV and --json or --solve cannot both go to standard output".into()));
        }

        // First what may still be refused, then what is written.
        let answer = question.map(Question::answer).transpose()?;
        let summaries = grid.map(|grid| self.write(&request, &grid, output)).transpose()?.unwrap_or_default();
        if self.json {
            print_json(&report(&request, &summaries, answer.as_ref()))?;
        } else if let Some(answer) = answer {
            print(&answer.words())?;
        }
        Ok(0)
    }

    /// Writes what was asked for of a surface; returns what its columns hold, where it was computed for CSV or JSON.
    fn write(&self, request: &Request, grid: &Grid, output: Option<&Path>) -> Result<Vec<Summary>> {
        let plot = self.plot.as_deref().map(|path| Ok((path, chart::encode(path, request, grid)?))).transpose()?;
        let bar = Bar::new("computing", false);
        let mut summaries = Vec::new();
        if let Some(path) = output {
            let (mut failed, mut left) = (None, false);
            let written = output::write_file(path, |out| {
                let csv = grid::write_csv(request, grid, out, &bar).and_then(|all| out.flush().map(|()| all));
                left = csv.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::BrokenPipe);
                summaries = csv?;
                // The plot before the CSV has its name: both or none.
                failed = plot.as_ref().and_then(|(path, bytes)| output::write_bytes(path, bytes).err());
                if failed.is_some() { Err(io::ErrorKind::Other.into()) } else { Ok(()) }
            });
            match (failed, written) {
                (Some(error), _) => return Err(error),
                // Whoever reads no further (`| head`) has what they wanted.
                (None, Err(error)) if path != Path::new("-") || !left => return Err(error),
                (None, Ok(()) | Err(_)) => {}
            }
        } else {
            if let Some((path, bytes)) = &plot {
                output::write_bytes(path, bytes)?;
            }
            if self.json {
                // Nothing can go wrong with writing nowhere.
                summaries = grid::write_csv(request, grid, &mut io::sink(), &bar).unwrap_or_default();
            }
        }
        drop(bar);
        report_empty(&summaries, grid);
        Ok(summaries)
    }
}

fn escape_controls(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { c.escape_debug().to_string() } else { c.to_string() }).collect()
}

/// Says on stderr how many cells are empty, and why.
fn report_empty(summaries: &[Summary], grid: &Grid) {
    for summary in summaries.iter().filter(|summary| summary.empty > 0) {
        let mut line = format!(
            "{}: {} of {} cells are empty: at or past its pole, not in front of the eye, or beyond what the precision holds",
            summary.form.name(),
            summary.empty,
            grid.cells()
        );
        if let (true, Plane::Xy { z }) = (summary.empty == grid.cells(), grid.plane)
            && z >= 0.0
        {
            line += &format!(" (C_z is {z}: give --z below 0)");
        }
        // A closed stderr changes nothing about the result.
        let _ = writeln!(io::stderr(), "{line}");
    }
}

fn report(request: &Request, summaries: &[Summary], answer: Option<&Answer>) -> Value {
    let setting = &request.setting;
    let extreme =
        |extreme: Option<Extreme>| extreme.map(|e| json!({ "value": e.value, "center": e.center.to_array() }));
    let forms: Vec<Value> = summaries
        .iter()
        .map(|summary| {
            json!({
                "form": summary.form.name(), "cells": summary.cells, "empty": summary.empty,
                "least": extreme(summary.least), "greatest": extreme(summary.greatest),
            })
        })
        .collect();
    json!({
        "of": setting.quantity.name(),
        // An inverse question alone is about every point, and says its component itself.
        "component": (!forms.is_empty()).then(|| setting.component.name()),
        "point": (!forms.is_empty()).then_some([setting.point.a, setting.point.b]),
        "between": setting.alignments.map(Alignment::name),
        "radius": setting.radius, "near": setting.near, "interocular": setting.interocular,
        "unit": request.unit.label(), "forms": forms,
        "solve": answer.map(Answer::json),
    })
}
