//! Projection error and parallax error of billboards (Johnson & McAllister 2005, section 3): how far a point of a
//! billboard parallel to the view plane lies, on the view plane, from the same point of a billboard that faces the
//! viewpoint, and how much that differs between the eyes.
//!
//! Camera space: the eye V at the origin, looking down -z, the view plane at distance N. A billboard has its centre at C
//! with C_z < 0 and radius r; its points have offsets (a, b) in [-1, 1]^2 over r. With d = -C_z, s = sqrt(C_x^2 + C_z^2)
//! and L = |C|:
//! - *viewplane*: P = C + r (a, b, 0);
//! - *viewpoint*: P = C + r (a u + b v), u = (0, 1, 0) x (V - C) normalised = (d, 0, C_x) / s (camera x where s = 0),
//!   n = (V - C) / L, v = n x u = (-C_x C_y, s^2, C_y d) / (s L).
//!
//! A point's projection is P* = (N P_x / -P_z, N P_y / -P_z); the *projection error* is e = P*_viewplane - P*_viewpoint,
//! the *parallax error* that of the right eye minus that of the left, e(C_x - I/2) - e(C_x + I/2).
//!
//! Three forms of the same quantity, which are never made from one another:
//! - [`numeric`]: both billboards built from their definitions with vectors, projected, subtracted, in f64 and in f32;
//! - [`closed`]: what follows from the definitions, written so that nothing cancels but the error's own zeros;
//! - [`printed`]: equations (9) to (12) as the paper prints them, which do not follow from its definitions.

pub mod closed;
pub mod numeric;
pub mod printed;
mod slope;

/// Which error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Projection error of one eye.
    Projection,
    /// Projection error of the right eye minus that of the left.
    Parallax,
}

/// Which component of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// To the right in the picture.
    X,
    /// Up in the picture.
    Y,
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
}

/// What an error is asked of, but for the centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Which error.
    pub quantity: Quantity,
    /// Which component of it.
    pub component: Component,
    /// Which point of the billboard.
    pub point: Point,
    /// Radius r of the billboard, > 0.
    pub radius: f64,
    /// Distance N of the view plane, > 0.
    pub near: f64,
    /// Interocular distance I, > 0; matters for the parallax error alone.
    pub interocular: f64,
}
