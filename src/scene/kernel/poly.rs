//! `poly`: k(q) = (1 - q^2)^2, which joins zero smoothly at the rim.
//!
//! Along a line k = (L^2 - u^2)^2 with L^2 = 1 - b^2, whose primitive is L^4 u - 2 L^2 u^3/3 + u^5/5;
//! K(u) = 16/15 (1 - u^2)^(5/2).

use super::half_chord;

/// K(0).
pub const CENTRE: f64 = 16.0 / 15.0;
/// Integral of (1 - q^2)^2 over the unit ball: 4 pi (1/3 - 2/5 + 1/7).
pub const CONTENT: f64 = 32.0 * std::f64::consts::PI / 105.0;

/// sup |dF/du| = max of 5 u (1 - u^2)^(3/2), at u = 1/2; rounded up.
pub const SLOPE: f64 = 1.623_797_632_095_823;

/// (1 - q^2)^2, for q < 1.
pub fn density(q: f64) -> f64 {
    let fall = (1.0 - q) * (1.0 + q);
    fall * fall
}

/// K(u), for u in [0, 1].
pub fn chord(u: f64) -> f64 {
    CENTRE * half_chord(u).powi(5)
}

/// Integral from `u0` to `u1` at distance `b`, within the ball.
pub fn segment(b: f64, u0: f64, u1: f64) -> f64 {
    // The Gauss-Legendre rule of 3 points is exact for this polynomial of degree 4 and adds positive terms alone, where
    // the primitive would cancel.
    const NODE: f64 = 0.774_596_669_241_483_4; // sqrt(3/5)
    let half2 = (1.0 - b) * (1.0 + b);
    let density = |u: f64| (half2 - u * u).powi(2);
    let (middle, half) = (0.5 * (u0 + u1), 0.5 * (u1 - u0));
    half * (5.0 * (density(middle - half * NODE) + density(middle + half * NODE)) + 8.0 * density(middle)) / 9.0
}
