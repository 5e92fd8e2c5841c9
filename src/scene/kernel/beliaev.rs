//! `beliaev`: k(q) = exp(-8 q^2), from G(x) = 0.446 exp(-2 x^2) (Beliaev & Zaytseva, Modeling of fuzzy natural phenomena
//! with particle system, eq. 6). The paper does not print the support; we assume x = 2, so that q = x/2. The factor
//! 0.446 cancels, since a particle's opacity is given through its centre.
//!
//! K(u) = sqrt(pi/8) exp(-8 u^2) erf(sqrt(8 (1 - u^2))).

use super::gaussian::{bell, bell_chord, bell_content, bell_segment};

/// The rate a of exp(-a q^2).
const RATE: f64 = 8.0;

/// K(0) = sqrt(pi/8) erf(sqrt 8).
pub const CENTRE: f64 = 0.626_617_374_642_614_2;

/// exp(-8 q^2), for q < 1.
pub fn density(q: f64) -> f64 {
    bell(RATE, q)
}

/// K(u), for u in [0, 1].
pub fn chord(u: f64) -> f64 {
    bell_chord(RATE, u)
}

/// Integral from `u0` to `u1` at distance `b`, within the ball, u0 < u1.
pub fn segment(b: f64, u0: f64, u1: f64) -> f64 {
    bell_segment(RATE, b, u0, u1)
}

/// Integral over the ball.
pub fn content() -> f64 {
    bell_content(RATE)
}
