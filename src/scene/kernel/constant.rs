//! `constant`: k(q) = 1, the homogeneous ball. K(u) = 2 sqrt(1 - u^2).

use super::half_chord;

/// K(0).
pub const CENTRE: f64 = 2.0;
/// Volume of the unit ball.
pub const CONTENT: f64 = 4.0 * std::f64::consts::PI / 3.0;

/// 1, for q < 1.
pub fn density(_: f64) -> f64 {
    1.0
}

/// K(u), for u in [0, 1].
pub fn chord(u: f64) -> f64 {
    2.0 * half_chord(u)
}

/// Integral from `u0` to `u1`, within the ball.
pub fn segment(u0: f64, u1: f64) -> f64 {
    u1 - u0
}
