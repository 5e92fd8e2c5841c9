//! `linear`: k(q) = 1 - q, the cone.
//!
//! K(u) = L - u^2 asinh(L/u) with L = sqrt(1 - u^2), 1 at u = 0 (from the primitive
//! u - [u sqrt(u^2 + b^2) + b^2 asinh(u/b)] / 2). dK/du = -2 u asinh(L/u).

use super::{distance_integral, gauss_8, half_chord};

/// K(0).
pub const CENTRE: f64 = 1.0;
/// Integral of 1 - q over the unit ball.
pub const CONTENT: f64 = std::f64::consts::PI / 3.0;

/// sup |dF/du| = max of 2 u acosh(1/u), where acosh(1/u) = 1/sqrt(1 - u^2), near u = 0.5524; rounded up.
pub const SLOPE: f64 = 1.325_486_838_698_364;

/// 1 - q, for q < 1.
pub fn density(q: f64) -> f64 {
    1.0 - q
}

/// K(u), for u in [0, 1].
pub fn chord(u: f64) -> f64 {
    let half = half_chord(u);
    segment(u, -half, half)
}

/// Integral from `u0` to `u1` at distance `b`, within the ball, u0 < u1.
pub fn segment(b: f64, u0: f64, u1: f64) -> f64 {
    if u1 - u0 < 0.4 * b {
        // Far from the kink of the cone, at u = +-ib, the rule is exact to 1e-16; and 1 - q = (1 - q^2)/(1 + q) keeps
        // its digits at the rim, where the closed form loses them.
        let half2 = (1.0 - b) * (1.0 + b);
        gauss_8(u0, u1, |u| (half2 - u * u) / (1.0 + (b * b + u * u).sqrt()))
    } else {
        (u1 - u0) - distance_integral(b, u0, u1)
    }
}
