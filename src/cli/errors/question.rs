//! The inverse question: the distance or the radius at which an error stays within a tolerance.

use super::ErrorsArgs;
use super::request::{LARGEST, UNITS, number};
use crate::error::{Error, Result};
use crate::study::error_surface::grid::Request;
use crate::study::error_surface::solve::{Demand, Solution, solve};
use crate::study::error_surface::unit::{Frame, Unit};
use crate::study::error_surface::{Component, Quantity};
use serde_json::{Value, json};

impl ErrorsArgs {
    /// What `--solve` asks.
    pub(super) fn question(&self, text: &str, request: &Request) -> Result<Question> {
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
            return Err(wrong("it is solved for the projection error of one eye; leave --of parallax out".into()));
        }
        if self.point.is_some() {
            return Err(wrong("it is about every point of the billboards; leave --point out".into()));
        }
        let depth = match self.z.as_deref() {
            Some(text) if !text.contains(':') => Some(-number("--z", text, LARGEST)?),
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
        let named = self.component.is_some() || self.figure.is_some();
        let component = named.then_some(request.setting.component);
        let demand = Demand { alignments: request.setting.alignments, component, frame: self.frame()?, tolerance };
        Ok(Question { demand, value, unit, wanted })
    }
}

/// What is solved for.
#[derive(Clone, Copy)]
enum Wanted {
    /// The smallest distance, for a radius.
    Distance { radius: f64 },
    /// The largest radius, at a depth.
    Radius { depth: f64 },
}

/// An inverse question.
pub struct Question {
    demand: Demand,
    /// The tolerance as it was given.
    value: f64,
    unit: Unit,
    wanted: Wanted,
}

impl Question {
    /// Solves it. [`Error::Usage`] where the answer is beyond what can be held.
    pub fn answer(self) -> Result<Answer> {
        let solution = solve(&self.demand);
        let (radius, distance) = match self.wanted {
            Wanted::Distance { radius } => (radius, radius / solution.ratio),
            Wanted::Radius { depth } => (solution.ratio * depth, depth),
        };
        if [radius, distance].iter().any(|length| !length.is_normal()) {
            return Err(Error::Usage("--solve: the answer is beyond what a number can hold".into()));
        }
        Ok(Answer { question: self, solution, radius, distance })
    }
}

/// Six digits, with an exponent where there would be many zeros.
fn digits(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".into();
    }
    if !(1e-4..1e9).contains(&size) {
        return format!("{value:.5e}");
    }
    let before = size.log10().floor() as i32 + 1;
    format!("{value:.*}", usize::try_from(6 - before).unwrap_or_default())
}

/// Its answer.
pub struct Answer {
    question: Question,
    solution: Solution,
    radius: f64,
    distance: f64,
}

impl Answer {
    /// In words.
    pub fn words(&self) -> String {
        let Self { question: Question { demand, value, unit, wanted }, solution, radius, distance } = self;
        let Frame { fov_y, size } = demand.frame;
        let what = match demand.component {
            None => String::new(),
            Some(component) => format!(" in {}", component.name()),
        };
        let found = match wanted {
            Wanted::Distance { .. } => format!("from distance {} on, for radius {radius:?}", digits(*distance)),
            Wanted::Radius { .. } => format!("up to radius {}, at distance {distance:?}", digits(*radius)),
        };
        let [x, y] = solution.worst.map(|tangent| digits(tangent * distance));
        // Where it is found to fewer digits than are shown, that is said.
        let within = match solution.precision {
            precision if precision > 1e-6 => format!(" (to {precision:.0e} of it, on the safe side)"),
            _ => String::new(),
        };
        format!(
            "{} stays within {value:?} {} of {}{what} {found}{within}\n  in the whole frame of {} degrees, {}x{}; radius over \
             distance {}\n  reached first by the corner away from the axis of the billboard at ({x}, {y}, {})\n",
            demand.alignments[0].name(),
            unit.label(),
            demand.alignments[1].name(),
            digits(fov_y.to_degrees()),
            size[0],
            size[1],
            digits(solution.ratio),
            digits(-distance),
        )
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let [x, y] = self.solution.worst.map(|tangent| tangent * self.distance);
        json!({
            "tolerance": self.question.value,
            "unit": self.question.unit.label(),
            "component": self.question.demand.component.map(Component::name),
            "radius": self.radius,
            "distance": self.distance,
            "ratio": self.solution.ratio,
            "precision": self.solution.precision,
            "worst": [x, y, -self.distance],
        })
    }
}
