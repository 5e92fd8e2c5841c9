//! The table of what is charted: methods, each with some values of its main parameter.

use crate::render::method::sheet::{self, Lookup};
use crate::render::method::{slab, spherical};
use crate::render::{DEFAULT_TOLERANCE, Method, Settings};
use crate::scene::Scene;

/// A point of the chart: a method and one value of its main parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Name of the method in tables, legends and `--methods`; rows of one name stand together.
    pub method: &'static str,
    /// Its main parameter.
    pub parameter: &'static str,
    /// The parameter's value.
    pub value: &'static str,
    /// The tolerance of early termination.
    pub tolerance: f64,
    /// How it is drawn.
    pub drawing: Drawing,
}

/// How a candidate is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drawing {
    /// By the method as it stands.
    Plain(Method),
    /// By `sheet`, with slices of this share of the median radius.
    Sheet(f64),
    /// By the method at one n-th of the resolution, enlarged to the full one ([`super::enlarge`]).
    Enlarged(Method, u32),
}

impl Candidate {
    /// Its name: method and value.
    pub fn label(&self) -> String {
        format!("{} {}", self.method, self.value)
    }

    /// The settings that it is drawn with; whatever a candidate does not decide is taken from `settings`.
    pub fn settings(&self, scene: &Scene, settings: &Settings) -> Settings {
        let method = match self.drawing {
            Drawing::Plain(method) | Drawing::Enlarged(method, _) => method,
            Drawing::Sheet(share) => {
                // Left alone, the width is half the median radius.
                let width = 2.0 * share * sheet::Parameters::DEFAULT.width(scene);
                Method::Sheet(sheet::Parameters { slice_width: Some(width), lookup: Lookup::Nearest, ..SHEET })
            }
        };
        Settings { method, tolerance: self.tolerance, error_map: false, ..settings.clone() }
    }

    /// By how much the picture is enlarged in each direction; 1: not at all.
    pub fn enlargement(&self) -> u32 {
        match self.drawing {
            Drawing::Plain(_) | Drawing::Sheet(_) => 1,
            Drawing::Enlarged(_, n) => n,
        }
    }
}

const SHEET: sheet::Parameters = sheet::Parameters::DEFAULT;

const fn tolerance(method: Method, name: &'static str, value: &'static str, tolerance: f64) -> Candidate {
    Candidate { method: name, parameter: "tolerance", value, tolerance, drawing: Drawing::Plain(method) }
}

const fn falloff(falloff: spherical::Falloff, value: &'static str) -> Candidate {
    let parameters = spherical::Parameters {
        falloff,
        rays: spherical::Rays::Perspective,
        quad: spherical::Parameters::DEFAULT.quad,
    };
    let drawing = Drawing::Plain(Method::Spherical(parameters));
    Candidate { method: "spherical", parameter: "falloff", value, tolerance: DEFAULT_TOLERANCE, drawing }
}

const fn slices(share: f64, value: &'static str) -> Candidate {
    let drawing = Drawing::Sheet(share);
    Candidate { method: "sheet", parameter: "slice_width/radius", value, tolerance: DEFAULT_TOLERANCE, drawing }
}

const fn slabs(slabs: u32, richardson: bool, value: &'static str) -> Candidate {
    let drawing = Drawing::Plain(Method::Slab(slab::Parameters { slabs: Some(slabs), richardson }));
    Candidate { method: "slab", parameter: "slabs", value, tolerance: DEFAULT_TOLERANCE, drawing }
}

const fn enlarged(method: &'static str, n: u32, value: &'static str) -> Candidate {
    let drawing = Drawing::Enlarged(Method::Perspective, n);
    Candidate { method, parameter: "resolution", value, tolerance: DEFAULT_TOLERANCE, drawing }
}

/// Every candidate, in the order of tables and legends. A new one is one row.
///
/// Early termination is the parameter of methods that have no other; elsewhere it is the default. `spherical` has its rays
/// through the eye, `sheet` looks its segments up at the nearest place, as its authors do. `half`, `quarter` and `eighth` are
/// `perspective` at that part of the resolution, as Umenhoffer, Szirmay-Kalos & Szijarto draw all gas.
#[rustfmt::skip]
pub const CANDIDATES: &[Candidate] = &[
    tolerance(Method::Viewplane, "viewplane", "0", 0.0),
    tolerance(Method::Viewplane, "viewplane", "1/255", 1.0 / 255.0),
    tolerance(Method::Viewplane, "viewplane", "0.02", 0.02),
    tolerance(Method::Viewpoint, "viewpoint", "0", 0.0),
    tolerance(Method::Viewpoint, "viewpoint", "1/255", 1.0 / 255.0),
    tolerance(Method::Viewpoint, "viewpoint", "0.02", 0.02),
    tolerance(Method::Perspective, "perspective", "0", 0.0),
    tolerance(Method::Perspective, "perspective", "1/255", 1.0 / 255.0),
    tolerance(Method::Perspective, "perspective", "0.02", 0.02),
    falloff(spherical::Falloff::Printed, "printed"),
    falloff(spherical::Falloff::Integrated, "integrated"),
    slices(1.0, "1"),
    slices(0.5, "0.5"),
    slices(0.25, "0.25"),
    slabs(1, false, "1"),
    slabs(4, false, "4"),
    slabs(16, false, "16"),
    slabs(64, false, "64"),
    slabs(256, false, "256"),
    slabs(16, true, "16 richardson"),
    slabs(64, true, "64 richardson"),
    enlarged("half", 2, "1/2"),
    enlarged("quarter", 4, "1/4"),
    enlarged("eighth", 8, "1/8"),
    tolerance(Method::Auto, "auto", "0.02", 0.02),
    tolerance(Method::Auto, "auto", "1/255", 1.0 / 255.0),
    tolerance(Method::Auto, "auto", "1/1023", 1.0 / 1023.0),
];

/// The names in [`CANDIDATES`], each once, in their order.
pub fn methods() -> Vec<&'static str> {
    let mut names: Vec<&str> = CANDIDATES.iter().map(|candidate| candidate.method).collect();
    names.dedup();
    names
}
