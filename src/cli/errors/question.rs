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
            return Err(wrong(
                "it is solved for the projection error; the parallax error is at most twice that, one for each eye"
                    .into(),
            ));
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
        let component = self.component.is_some().then_some(request.setting.component);
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
    /// Solves it.
    pub fn answer(self) -> Answer {
        let solution = solve(&self.demand);
        let (radius, distance) = match self.wanted {
            Wanted::Distance { radius } => (radius, radius / solution.ratio),
            Wanted::Radius { depth } => (solution.ratio * depth, depth),
        };
        Answer { question: self, solution, radius, distance }
    }
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
            "worst": [x, y, -self.distance],
        })
    }
}
