//! Projection error and parallax error of billboards (Johnson & McAllister 2005, section 3): how far a point of a
//! billboard lies, on the view plane, from where another alignment shows it, and how much that differs between the eyes.
//!
//! Camera space: the eye V at the origin, looking down -z, the view plane at distance N. A billboard has its centre at C
//! with C_z < 0 and radius r; its points have offsets (a, b) in [-1, 1]^2 over r. With d = -C_z, s = sqrt(C_x^2 + C_z^2)
//! and L = |C|:
//! - *viewplane*: P = C + r (a, b, 0);
//! - *viewpoint*: P = C + r (a u + b v), u = (0, 1, 0) x (V - C) normalised = (d, 0, C_x) / s (camera x where s = 0),
//!   n = (V - C) / L, v = n x u = (-C_x C_y, s^2, C_y d) / (s L);
//! - *perspective*, the exact projection of the kernel: the ray in the plane of C and the viewpoint billboard's P whose
//!   perpendicular distance from C is the offset's length rho = r sqrt(a^2 + b^2), so that sin theta = rho / L where the
//!   viewpoint billboard has tan theta = rho / L.
//!
//! A point's projection is P* = (N P_x / -P_z, N P_y / -P_z); the *projection error* is the difference of two alignments',
//! e = P*_viewplane - P*_viewpoint in the paper; the *parallax error* that of the right eye minus that of the left,
//! e(C_x - I/2) - e(C_x + I/2).
//!
//! Three forms of the same quantity, which are never made from one another:
//! - [`numeric`]: both points built from their definitions with vectors, projected, subtracted;
//! - [`closed`]: what follows from the definitions, written so that nothing cancels but the error's own zeros;
//! - [`printed`]: equations (9) to (12) as the paper prints them, which do not follow from its definitions.
//!
//! | file | does |
//! |---|---|
//! | `numeric.rs`, `closed.rs`, `printed.rs` | one form each, in f64 and in f32 |
//! | `slope.rs` | divided differences |
//! | `unit.rs` | lengths on the view plane as pixels or arc minutes |
//! | `grid.rs` | surfaces over a grid of centres: cells, CSV, charts |
//! | `figure.rs` | the paper's figures |
//! | `solve.rs` | the distance or radius at which an error stays within a tolerance |

pub mod closed;
pub mod figure;
pub mod grid;
pub mod numeric;
pub mod printed;
mod slope;
pub mod solve;
pub mod unit;

use glam::{DVec3, Vec3};

/// Which error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Projection error of one eye.
    Projection,
    /// Projection error of the right eye minus that of the left.
    Parallax,
}

impl Quantity {
    /// Both.
    pub const ALL: &[Self] = &[Self::Projection, Self::Parallax];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Projection => "projection",
            Self::Parallax => "parallax",
        }
    }
}

/// Which component of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// To the right in the picture.
    X,
    /// Up in the picture.
    Y,
}

impl Component {
    /// Both.
    pub const ALL: &[Self] = &[Self::X, Self::Y];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
        }
    }
}

/// How a point of a particle comes to its place in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Alignment {
    /// Billboard parallel to the view plane.
    Viewplane,
    /// Billboard that faces the eye.
    Viewpoint,
    /// The exact projection of the kernel.
    Perspective,
}

impl Alignment {
    /// Every alignment.
    pub const ALL: &[Self] = &[Self::Viewplane, Self::Viewpoint, Self::Perspective];

    /// The name on the command line, that of the method.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viewplane => "viewplane",
            Self::Viewpoint => "viewpoint",
            Self::Perspective => "perspective",
        }
    }
}

/// A point of a billboard: offsets from its centre over its radius, to the right and up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// To the right, in [-1, 1].
    pub a: f64,
    /// Up, in [-1, 1].
    pub b: f64,
}

impl Point {
    /// The middle of the right edge, E in the paper.
    pub const RIGHT_EDGE: Self = Self { a: 1.0, b: 0.0 };
    /// The middle of the left edge.
    pub const LEFT_EDGE: Self = Self { a: -1.0, b: 0.0 };
    /// The middle of the top edge.
    pub const TOP_EDGE: Self = Self { a: 0.0, b: 1.0 };
    /// The middle of the bottom edge.
    pub const BOTTOM_EDGE: Self = Self { a: 0.0, b: -1.0 };
    /// The upper right corner.
    pub const CORNER: Self = Self { a: 1.0, b: 1.0 };

    /// The points that have names.
    pub const NAMED: &[(&str, Self)] = &[
        ("right-edge", Self::RIGHT_EDGE),
        ("left-edge", Self::LEFT_EDGE),
        ("top-edge", Self::TOP_EDGE),
        ("bottom-edge", Self::BOTTOM_EDGE),
        ("corner", Self::CORNER),
    ];
}

/// What an error is asked of, but for the centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Which error.
    pub quantity: Quantity,
    /// Which component of it.
    pub component: Component,
    /// The error is the first's place minus the second's; viewplane and viewpoint in the paper.
    pub alignments: [Alignment; 2],
    /// Which point of the billboard.
    pub point: Point,
    /// Radius r of the billboard, > 0.
    pub radius: f64,
    /// Distance N of the view plane, > 0.
    pub near: f64,
    /// Interocular distance I, >= 0; matters for the parallax error alone.
    pub interocular: f64,
}

impl Default for Setting {
    /// The horizontal projection error of the paper at its E; radius 0.5, N = 1, I = 0.065.
    fn default() -> Self {
        Self {
            quantity: Quantity::Projection,
            component: Component::X,
            alignments: [Alignment::Viewplane, Alignment::Viewpoint],
            point: Point::RIGHT_EDGE,
            radius: 0.5,
            near: 1.0,
            interocular: 0.065,
        }
    }
}

/// How an error is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// From the definitions: [`numeric`].
    Numeric,
    /// What follows from them: [`closed`].
    Closed,
    /// As the paper prints it: [`printed`].
    Printed,
}

impl Form {
    /// Every form.
    pub const ALL: &[Self] = &[Self::Numeric, Self::Closed, Self::Printed];

    /// The name on the command line and of the CSV's column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Numeric => "numeric",
            Self::Closed => "closed",
            Self::Printed => "printed",
        }
    }

    /// The error at a billboard with its centre at `c`, camera space of the cyclopean eye, in units of the view plane;
    /// `None` at and past the form's own poles.
    pub fn error(self, setting: &Setting, c: DVec3) -> Option<f64> {
        match self {
            Self::Numeric => numeric::error(setting, c),
            Self::Closed => closed::error(setting, c),
            Self::Printed => printed::error(setting, c),
        }
    }

    /// [`Form::error`] in single precision throughout.
    pub fn error_f32(self, setting: &Setting, c: Vec3) -> Option<f32> {
        match self {
            Self::Numeric => numeric::error_f32(setting, c),
            Self::Closed => closed::error_f32(setting, c),
            Self::Printed => printed::error_f32(setting, c),
        }
    }
}
