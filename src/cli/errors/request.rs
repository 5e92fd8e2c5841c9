//! What was typed, as a grid and what is asked of it.

use super::ErrorsArgs;
use crate::cli::options::{check_size, parse_size};
use crate::error::{Error, Result};
use crate::study::error_surface::figure::{FIGURES, Figure};
use crate::study::error_surface::grid::{Grid, Plane, Precision, Range, Request};
use crate::study::error_surface::unit::{Frame, Unit, Viewer};
use crate::study::error_surface::{Alignment, Component, Form, Point, Quantity, Setting, printed};
use std::str::FromStr;

/// Units on the command line; the first is the default.
pub const UNITS: &[&str] = &["length", "px", "arcmin"];

impl ErrorsArgs {
    /// The figure that is asked for.
    pub(super) fn figure(&self) -> Result<Option<&'static Figure>> {
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

    /// Where the error is asked for.
    pub(super) fn grid(&self, figure: Option<&Figure>) -> Result<Grid> {
        let plane = match (figure, self.vary.as_deref()) {
            (Some(figure), _) => figure.plane,
            (None, None | Some("xz")) => Plane::Xz { y: 0.0 },
            (None, Some("xy")) => Plane::Xy { z: 0.0 },
            (None, Some(other)) => return Err(unknown("--vary", other, &["xz", "xy"])),
        };
        let default = Grid::default_for(plane);
        let largest = largest(self.precision()?);
        let x = range("--x", self.x.as_deref(), default.x, largest)?;
        let (second, plane) = match plane {
            Plane::Xz { y } => (
                range("--z", self.z.as_deref(), default.second, largest)?,
                Plane::Xz { y: fixed("--y", &self.y, y, largest)? },
            ),
            Plane::Xy { z } => (
                range("--y", self.y.as_deref(), default.second, largest)?,
                Plane::Xy { z: fixed("--z", &self.z, z, largest)? },
            ),
        };
        Ok(Grid { x, second, plane })
    }

    fn precision(&self) -> Result<Precision> {
        match self.precision.as_deref() {
            None | Some("f64") => Ok(Precision::F64),
            Some("f32") => Ok(Precision::F32),
            Some(other) => Err(unknown("--precision", other, &["f64", "f32"])),
        }
    }

    /// What is asked of every centre.
    pub(super) fn request(&self, figure: Option<&Figure>) -> Result<Request> {
        let default = figure.map(Figure::setting).unwrap_or_default();
        let precision = self.precision()?;
        let largest = largest(precision);
        let setting = Setting {
            quantity: named("--of", self.of.as_deref(), Quantity::ALL, Quantity::name, default.quantity)?,
            component: named("--component", self.component.as_deref(), Component::ALL, Component::name, {
                default.component
            })?,
            alignments: self.between.as_deref().map_or(Ok(default.alignments), parse_between)?,
            point: self.point.as_deref().map_or(Ok(default.point), parse_point)?,
            radius: length("--radius", &self.radius, default.radius, largest)?,
            near: length("--near", &self.near, default.near, largest)?,
            interocular: match self.interocular.as_deref() {
                None => default.interocular,
                // Two eyes in one place see no parallax: a limit, not a mistake.
                Some(text) => match number("--interocular", text, largest)? {
                    value if value >= 0.0 => value,
                    _ => return Err(Error::Usage(format!("--interocular {text}: must be at least 0"))),
                },
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

    /// The picture that pixels and the whole frame mean.
    pub(super) fn frame(&self) -> Result<Frame> {
        let text = self.fov_y_deg.as_deref().unwrap_or("40");
        let degrees = number("--fov-y-deg", text, LARGEST)?;
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(Error::Usage(format!("--fov-y-deg {text}: allowed: more than 0 and less than 180 degrees")));
        }
        let size = self.size.as_deref().map_or(Ok([1024, 768]), parse_size)?;
        check_size(size, 1)?;
        Ok(Frame { fov_y: degrees.to_radians(), size })
    }

    fn viewer(&self) -> Result<Viewer> {
        let needed = |option: &str, text: &Option<String>| match text {
            Some(_) => length(option, text, 1.0, LARGEST),
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
    pub(super) fn unit_named(&self, name: &str) -> Option<Result<Unit>> {
        Some(match name {
            "length" => Ok(Unit::Length),
            "px" => self.frame().map(Unit::Pixels),
            "arcmin" => self.frame().and_then(|frame| Ok(Unit::ArcMinutes(frame, self.viewer()?))),
            _ => return None,
        })
    }
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
pub fn number(option: &str, text: &str, largest: f64) -> Result<f64> {
    match f64::from_str(text.trim()) {
        Ok(value) if value.abs() <= largest => Ok(value),
        Ok(value) if value.is_finite() => {
            Err(Error::Usage(format!("{option} {text}: too large; at most {largest:e} is allowed")))
        }
        _ => Err(Error::Usage(format!("{option} {text}: a finite number is needed"))),
    }
}

/// Largest coordinates and lengths, and one over the smallest lengths: squares and products of two stay finite.
pub const LARGEST: f64 = 1e100;
/// The same in single precision.
const LARGEST_F32: f64 = 1e15;

/// What the precision allows.
fn largest(precision: Precision) -> f64 {
    match precision {
        Precision::F64 => LARGEST,
        Precision::F32 => LARGEST_F32,
    }
}

/// A length above 0.
fn length(option: &str, given: &Option<String>, default: f64, largest: f64) -> Result<f64> {
    let Some(text) = given else { return Ok(default) };
    let value = number(option, text, largest)?;
    if value <= 0.0 {
        return Err(Error::Usage(format!("{option} {text}: must be above 0")));
    }
    if !(1.0 / largest..=largest).contains(&value) {
        return Err(Error::Usage(format!("{option} {text}: allowed: {:e} to {largest:e}", 1.0 / largest)));
    }
    Ok(value)
}

fn fixed(option: &str, given: &Option<String>, default: f64, largest: f64) -> Result<f64> {
    match given.as_deref() {
        None => Ok(default),
        Some(text) if text.contains(':') => {
            Err(Error::Usage(format!("{option} {text}: does not vary (see --vary): a single number is needed")))
        }
        Some(text) => number(option, text, largest),
    }
}

fn range(option: &str, given: Option<&str>, default: Range, largest: f64) -> Result<Range> {
    let Some(text) = given else { return Ok(default) };
    let wrong = |message: &str| Error::Usage(format!("{option} {text}: {message}"));
    let parts: Vec<&str> = text.split(':').collect();
    let &[min, max, count] = &parts[..] else {
        return Err(wrong("varies: allowed: MIN:MAX:COUNT, both ends included"));
    };
    let (min, max) = (number(option, min, largest)?, number(option, max, largest)?);
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
