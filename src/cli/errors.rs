//! `errors`: projection and parallax error surfaces.

use super::options::parse_size;
use super::progress::Bar;
use super::{print, print_json};
use crate::error::{Error, Result};
use crate::picture::output;
use crate::study::error_surface::figure::{FIGURES, Figure};
use crate::study::error_surface::grid::{self, Extreme, Grid, Plane, Precision, Range, Request, Summary};
use crate::study::error_surface::solve::{Demand, Solution, solve};
use crate::study::error_surface::unit::{Frame, Unit, Viewer};
use crate::study::error_surface::{Alignment, Component, Form, Point, Quantity, Setting, printed};
use clap::Args;
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

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

/// Longest plot axis, in samples: more than the picture shows.
const PLOT_SAMPLES: u32 = 201;

impl ErrorsArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
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
        if output.is_some() && output == self.plot.as_deref() {
            return Err(Error::Usage("-o and --plot name the same file".into()));
        }
        if output == Some(stdout) && (self.json || self.solve.is_some()) {
            return Err(Error::Usage("the CSV and --json or --solve cannot both go to standard output".into()));
        }

        let summaries = grid.map(|grid| self.write(&request, &grid, output)).transpose()?.unwrap_or_default();
        let answer = question.map(Question::answer);
        if self.json {
            print_json(&report(&request, &summaries, answer.as_ref()))?;
        } else if let Some(answer) = answer {
            print(&answer.words())?;
        }
        Ok(0)
    }

    /// Writes what was asked for of a surface; returns what its columns hold, where it was computed for CSV or JSON.
    fn write(&self, request: &Request, grid: &Grid, output: Option<&Path>) -> Result<Vec<Summary>> {
        let plot = self.plot.as_deref().map(|path| Ok((path, plot(path, request, grid)?))).transpose()?;
        let bar = Bar::new("computing", false);
        let mut summaries = Vec::new();
        if let Some(path) = output {
            let mut failed = None;
            let written = output::write_file(path, |out| {
                summaries = grid::write_csv(request, grid, out, &bar)?;
                // The plot before the CSV has its name: both or none.
                failed = plot.as_ref().and_then(|(path, bytes)| output::write_bytes(path, bytes).err());
                if failed.is_some() { Err(io::ErrorKind::Other.into()) } else { Ok(()) }
            });
            match (failed, written) {
                (Some(error), _) => return Err(error),
                // Whoever reads no further (`| head`) has what they wanted.
                (None, Err(error)) if path != Path::new("-") || !is_broken_pipe(&error) => return Err(error),
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

    fn figure(&self) -> Result<Option<&'static Figure>> {
        let Some(text) = &self.figure else { return Ok(None) };
        let numbers: Vec<String> = FIGURES.iter().map(|figure| figure.number.to_string()).collect();
        let figure = text.parse().ok().and_then(Figure::of);
        let figure = figure.ok_or_else(|| {
            Error::Usage(format!("--figure {text}: the figures of error surfaces are {}", numbers.join(", ")))
        })?;
        let plane = match figure.plane {
            Plane::Xz { .. } => "xz",
            Plane::Xy { .. } => "xy",
        };
        let shown = [
            ("--of", &self.of, figure.quantity.name()),
            ("--component", &self.component, figure.component.name()),
            ("--vary", &self.vary, plane),
        ];
        for (option, given, shown) in shown {
            if let Some(given) = given.as_ref().filter(|given| *given != shown) {
                let number = figure.number;
                return Err(Error::Usage(format!("{option} {given}: figure {number} has {option} {shown}")));
            }
        }
        Ok(Some(figure))
    }

    fn grid(&self, figure: Option<&Figure>) -> Result<Grid> {
        let plane = match (figure, self.vary.as_deref()) {
            (Some(figure), _) => figure.plane,
            (None, None | Some("xz")) => Plane::Xz { y: 0.0 },
            (None, Some("xy")) => Plane::Xy { z: 0.0 },
            (None, Some(other)) => return Err(unknown("--vary", other, &["xz", "xy"])),
        };
        let default = Grid::default_for(plane);
        let x = range("--x", self.x.as_deref(), default.x)?;
        let (second, plane) = match plane {
            Plane::Xz { y } => {
                (range("--z", self.z.as_deref(), default.second)?, Plane::Xz { y: fixed("--y", &self.y, y)? })
            }
            Plane::Xy { z } => {
                (range("--y", self.y.as_deref(), default.second)?, Plane::Xy { z: fixed("--z", &self.z, z)? })
            }
        };
        Ok(Grid { x, second, plane })
    }

    fn request(&self, figure: Option<&Figure>) -> Result<Request> {
        let default = figure.map(Figure::setting).unwrap_or_default();
        let precision = match self.precision.as_deref() {
            None | Some("f64") => Precision::F64,
            Some("f32") => Precision::F32,
            Some(other) => return Err(unknown("--precision", other, &["f64", "f32"])),
        };
        let setting = Setting {
            quantity: named("--of", self.of.as_deref(), Quantity::ALL, Quantity::name, default.quantity)?,
            component: named("--component", self.component.as_deref(), Component::ALL, Component::name, {
                default.component
            })?,
            alignments: self.between.as_deref().map_or(Ok(default.alignments), parse_between)?,
            point: self.point.as_deref().map_or(Ok(default.point), parse_point)?,
            radius: length("--radius", &self.radius, default.radius, precision)?,
            near: length("--near", &self.near, default.near, precision)?,
            interocular: match self.interocular.as_deref().map(|text| number("--interocular", text)).transpose()? {
                // Two eyes in one place see no parallax: a limit, not a mistake.
                Some(0.0) => 0.0,
                _ => length("--interocular", &self.interocular, default.interocular, precision)?,
            },
        };
        let mut forms = Vec::new();
        for name in &self.form {
            let form = named("--form", Some(name), Form::ALL, Form::name, Form::Closed)?;
            if forms.contains(&form) {
                return Err(Error::Usage(format!("--form {name}: given twice")));
            }
            forms.push(form);
        }
        if forms.contains(&Form::Printed) && !printed::covers(&setting) {
            return Err(Error::Usage(
                "--form printed: the paper prints formulas for --point right-edge and --between viewplane,viewpoint only"
                    .into(),
            ));
        }
        if forms.is_empty() {
            forms.push(Form::Closed);
            if figure.is_some() && printed::covers(&setting) {
                forms.push(Form::Printed);
            }
        }
        Ok(Request { setting, forms, precision, unit: self.unit()? })
    }

    fn frame(&self) -> Result<Frame> {
        let text = self.fov_y_deg.as_deref().unwrap_or("40");
        let degrees = number("--fov-y-deg", text)?;
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(Error::Usage(format!("--fov-y-deg {text}: allowed: more than 0 and less than 180 degrees")));
        }
        let size = self.size.as_deref().map_or(Ok([1024, 768]), parse_size)?;
        if size.contains(&0) {
            return Err(Error::Usage(format!("--size {}x{}: both must be at least 1", size[0], size[1])));
        }
        Ok(Frame { fov_y: degrees.to_radians(), size })
    }

    fn viewer(&self) -> Result<Viewer> {
        let needed = |option: &str, text: &Option<String>| match text {
            Some(_) => length(option, text, 1.0, Precision::F64),
            None => Err(Error::Usage(format!("arc minutes need a viewer: {option} is missing"))),
        };
        Ok(Viewer {
            distance_m: needed("--viewer-distance", &self.viewer_distance)?,
            screen_width_m: needed("--screen-width", &self.screen_width)?,
        })
    }

    fn unit(&self) -> Result<Unit> {
        self.unit_named(self.unit.as_deref().unwrap_or(UNITS[0]))
            .unwrap_or_else(|| Err(unknown("--unit", self.unit.as_deref().unwrap_or_default(), UNITS)))
    }

    /// The unit of that name; `None` if there is none.
    fn unit_named(&self, name: &str) -> Option<Result<Unit>> {
        Some(match name {
            "length" => Ok(Unit::Length),
            "px" => self.frame().map(Unit::Pixels),
            "arcmin" => self.frame().and_then(|frame| Ok(Unit::ArcMinutes(frame, self.viewer()?))),
            _ => return None,
        })
    }

    fn question(&self, text: &str, request: &Request) -> Result<Question> {
        let wrong = |message: String| Error::Usage(format!("--solve {text}: {message}"));
        let Some(tolerance) = text.strip_prefix("tolerance=") else {
            return Err(wrong(
                "allowed: tolerance=NUMBER with px, arcmin or nothing after it, e.g. tolerance=0.5px".into(),
            ));
        };
        let split =
            tolerance.find(|c: char| c.is_ascii_alphabetic() && c != 'e' && c != 'E').unwrap_or(tolerance.len());
        let (value, name) = tolerance.split_at(split);
        let name = if name.is_empty() { UNITS[0] } else { name };
        let unit = self.unit_named(name).unwrap_or_else(|| {
            Err(wrong(format!("unknown unit `{name}`; allowed: px, arcmin, or none for a length on the view plane")))
        })?;
        let value: f64 = value.trim().parse().unwrap_or(f64::NAN);
        let near = request.setting.near;
        let tolerance = unit.to_length(value, near) / near;
        if !(tolerance > 0.0 && tolerance.is_finite()) {
            return Err(wrong("the tolerance must be a positive number, and less than half a turn".into()));
        }
        if request.setting.quantity == Quantity::Parallax {
            return Err(wrong(
                "it is solved for the projection error; the parallax error is at most twice that, one for each eye"
                    .into(),
            ));
        }
        if self.point.is_some() {
            return Err(wrong("it is about every point of the billboards; leave --point out".into()));
        }
        let depth = match self.z.as_deref() {
            Some(text) if !text.contains(':') => Some(-number("--z", text)?),
            _ => None,
        };
        let wanted = match depth {
            Some(_) if self.radius.is_some() => {
                return Err(wrong(
                    "give --radius to ask for the distance, or a single --z to ask for the radius".into(),
                ));
            }
            Some(depth) if depth > 0.0 => Wanted::Radius { depth },
            Some(depth) => {
                return Err(wrong(format!("--z {}: behind the eye; C_z is negative in front of it", -depth)));
            }
            None => Wanted::Distance { radius: request.setting.radius },
        };
        let component = self.component.is_some().then_some(request.setting.component);
        let demand = Demand { alignments: request.setting.alignments, component, frame: self.frame()?, tolerance };
        Ok(Question { demand, value, unit, wanted })
    }
}

const UNITS: &[&str] = &["length", "px", "arcmin"];

/// What is solved for.
#[derive(Clone, Copy)]
enum Wanted {
    /// The smallest distance, for a radius.
    Distance { radius: f64 },
    /// The largest radius, at a depth.
    Radius { depth: f64 },
}

/// An inverse question.
struct Question {
    demand: Demand,
    /// The tolerance as it was given.
    value: f64,
    unit: Unit,
    wanted: Wanted,
}

impl Question {
    fn answer(self) -> Answer {
        let solution = solve(&self.demand);
        let (radius, distance) = match self.wanted {
            Wanted::Distance { radius } => (radius, radius / solution.ratio),
            Wanted::Radius { depth } => (solution.ratio * depth, depth),
        };
        Answer { question: self, solution, radius, distance }
    }
}

/// Its answer.
struct Answer {
    question: Question,
    solution: Solution,
    radius: f64,
    distance: f64,
}

impl Answer {
    fn words(&self) -> String {
        let Self { question: Question { demand, value, unit, wanted }, solution, radius, distance } = self;
        let Frame { fov_y, size } = demand.frame;
        let what = match demand.component {
            None => String::new(),
            Some(component) => format!(" in {}", component.name()),
        };
        let found = match wanted {
            Wanted::Distance { .. } => format!("from distance {distance:.6} on, for radius {radius}"),
            Wanted::Radius { .. } => format!("up to radius {radius:.6}, at distance {distance}"),
        };
        let [x, y] = solution.worst.map(|tangent| tangent * distance);
        format!(
            "{} stays within {value} {} of {}{what} {found}\n  in the whole frame of {} degrees, {}x{}; radius over distance \
             {:.6}\n  reached first by the corner away from the axis of the billboard at ({x:.6}, {y:.6}, {:.6})\n",
            demand.alignments[0].name(),
            unit.label(),
            demand.alignments[1].name(),
            fov_y.to_degrees(),
            size[0],
            size[1],
            solution.ratio,
            -distance,
        )
    }

    fn json(&self) -> Value {
        let [x, y] = self.solution.worst.map(|tangent| tangent * self.distance);
        json!({
            "tolerance": self.question.value,
            "unit": self.question.unit.label(),
            "component": self.question.demand.component.map(Component::name),
            "radius": self.radius,
            "distance": self.distance,
            "ratio": self.solution.ratio,
            "worst": [x, y, -self.distance],
        })
    }
}

/// The plot in the format of its file's extension.
fn plot(path: &Path, request: &Request, grid: &Grid) -> Result<Vec<u8>> {
    let _ = (path, request, grid, PLOT_SAMPLES);
    Err(Error::Usage("--plot: not built yet".into()))
}

/// Whether an output error means that the reader has gone away.
fn is_broken_pipe(error: &Error) -> bool {
    matches!(error, Error::Output { message, .. } if message.starts_with("Broken pipe"))
}

/// Says on stderr how many cells are empty, and why.
fn report_empty(summaries: &[Summary], grid: &Grid) {
    for summary in summaries.iter().filter(|summary| summary.empty > 0) {
        let mut line = format!(
            "{}: {} of {} cells are empty: at or past its pole, or not in front of the eye",
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
        "of": setting.quantity.name(), "component": setting.component.name(),
        "between": setting.alignments.map(Alignment::name), "point": [setting.point.a, setting.point.b],
        "radius": setting.radius, "near": setting.near, "interocular": setting.interocular,
        "unit": request.unit.label(), "forms": forms,
        "solve": answer.map(Answer::json),
    })
}

fn unknown(option: &str, given: &str, allowed: &[&str]) -> Error {
    Error::Usage(format!("{option} {given}: unknown; allowed: {}", allowed.join(", ")))
}

/// The thing of that name, or the default.
fn named<T: Copy>(option: &str, given: Option<&str>, all: &[T], name: fn(T) -> &'static str, default: T) -> Result<T> {
    let Some(given) = given else { return Ok(default) };
    all.iter().copied().find(|&thing| name(thing) == given).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|&thing| name(thing)).collect();
        unknown(option, given, &names)
    })
}

/// Any finite number of which the square can be held.
fn number(option: &str, text: &str) -> Result<f64> {
    match f64::from_str(text.trim()) {
        Ok(value) if value.abs() <= LARGEST => Ok(value),
        Ok(value) if value.is_finite() => {
            Err(Error::Usage(format!("{option} {text}: too large; at most {LARGEST:e} is allowed")))
        }
        _ => Err(Error::Usage(format!("{option} {text}: a finite number is needed"))),
    }
}

/// Largest coordinates and lengths, and one over the smallest lengths: squares and products of two stay finite.
const LARGEST: f64 = 1e100;
/// The same in single precision.
const LARGEST_F32: f64 = 1e12;

/// A length above 0.
fn length(option: &str, given: &Option<String>, default: f64, precision: Precision) -> Result<f64> {
    let Some(text) = given else { return Ok(default) };
    let value = number(option, text)?;
    let largest = match precision {
        Precision::F64 => LARGEST,
        Precision::F32 => LARGEST_F32,
    };
    if value <= 0.0 {
        return Err(Error::Usage(format!("{option} {text}: must be above 0")));
    }
    if !(1.0 / largest..=largest).contains(&value) {
        return Err(Error::Usage(format!("{option} {text}: allowed: {:e} to {largest:e}", 1.0 / largest)));
    }
    Ok(value)
}

fn fixed(option: &str, given: &Option<String>, default: f64) -> Result<f64> {
    match given.as_deref() {
        None => Ok(default),
        Some(text) if text.contains(':') => {
            Err(Error::Usage(format!("{option} {text}: does not vary (see --vary): a single number is needed")))
        }
        Some(text) => number(option, text),
    }
}

fn range(option: &str, given: Option<&str>, default: Range) -> Result<Range> {
    let Some(text) = given else { return Ok(default) };
    let wrong = |message: &str| Error::Usage(format!("{option} {text}: {message}"));
    let parts: Vec<&str> = text.split(':').collect();
    let &[min, max, count] = &parts[..] else {
        return Err(wrong("varies: allowed: MIN:MAX:COUNT, both ends included"));
    };
    let (min, max) = (number(option, min)?, number(option, max)?);
    let most = Range::LONGEST;
    let count = count.trim().parse().ok().filter(|count| (1..=most).contains(count));
    let Some(count) = count else { return Err(wrong(&format!("the count must be a whole number from 1 to {most}"))) };
    if min > max {
        return Err(wrong("MIN must not be above MAX"));
    }
    if (min == max) != (count == 1) {
        return Err(wrong("a count of 1 is for MIN equal to MAX, a greater one for different ends"));
    }
    Ok(Range { min, max, count })
}

fn parse_point(text: &str) -> Result<Point> {
    if let Some(&(_, point)) = Point::NAMED.iter().find(|(name, _)| *name == text) {
        return Ok(point);
    }
    let offset = |text: &str| f64::from_str(text.trim()).ok().filter(|value| (-1.0..=1.0).contains(value));
    let point = text.split_once(',').and_then(|(a, b)| Some(Point { a: offset(a)?, b: offset(b)? }));
    point.ok_or_else(|| {
        let names: Vec<_> = Point::NAMED.iter().map(|(name, _)| *name).collect();
        Error::Usage(format!("--point {text}: allowed: {}, or A,B with both from -1 to 1", names.join(", ")))
    })
}

fn parse_between(text: &str) -> Result<[Alignment; 2]> {
    let names: Vec<_> = Alignment::ALL.iter().map(|alignment| alignment.name()).collect();
    let alignment = |name: &str| Alignment::ALL.iter().copied().find(|alignment| alignment.name() == name);
    match text.split_once(',').map(|(a, b)| (alignment(a.trim()), alignment(b.trim()))) {
        Some((Some(a), Some(b))) if a != b => Ok([a, b]),
        _ => Err(Error::Usage(format!("--between {text}: two different ones of {} are needed", names.join(", ")))),
    }
}
