//! `gaussian`: k(q) = exp(-4.5 q^2), the Gaussian over [-3, 3] sigma with sigma = r/3 (Johnson & McAllister, Real-time
//! stereo imaging of gaseous phenomena, Electronic Imaging 2005, eq. 1 and 4).
//!
//! K(u) = sqrt(2 pi)/3 exp(-4.5 u^2) erf(3 sqrt((1 - u^2)/2)). The truncated bell of any width is here: with rate a,
//! k = exp(-a q^2), the integral over u is exp(-a b^2) sqrt(pi / 4a) [erf(sqrt(a) u1) - erf(sqrt(a) u0)].

use super::{gauss_8, half_chord};
use std::f64::consts::PI;

/// The rate a of exp(-a q^2): three standard deviations reach the rim.
const RATE: f64 = 4.5;

/// K(0) = sqrt(2 pi)/3 erf(3/sqrt 2).
pub const CENTRE: f64 = 0.833_286_963_161_031_7;

/// exp(-4.5 q^2), for q < 1.
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

/// The billboard of Johnson & McAllister: the integral over [-3, 3] sigma everywhere, so that the chord factor is
/// constant and the footprint is separable, on the square |a|, |b| < 1 with a step of exp(-4.5) at its edge.
pub fn billboard(a: f64, b: f64) -> f64 {
    if a.abs() < 1.0 && b.abs() < 1.0 { (-RATE * (a * a + b * b)).exp() } else { 0.0 }
}

/// exp(-rate q^2).
pub(super) fn bell(rate: f64, q: f64) -> f64 {
    (-rate * q * q).exp()
}

/// Integral of exp(-rate q^2) over the unit ball, by parts from that of 4 pi q^2 exp(-rate q^2).
pub(super) fn bell_content(rate: f64) -> f64 {
    (PI / rate).powf(1.5) * libm::erf(rate.sqrt()) - 2.0 * PI / rate * (-rate).exp()
}

/// Integral of exp(-rate q^2) along the whole chord at distance `u`.
pub(super) fn bell_chord(rate: f64, u: f64) -> f64 {
    (PI / rate).sqrt() * bell(rate, u) * libm::erf(rate.sqrt() * half_chord(u))
}

/// Integral of exp(-rate q^2) from `u0` to `u1` at distance `b`, u0 < u1.
pub(super) fn bell_segment(rate: f64, b: f64, u0: f64, u1: f64) -> f64 {
    let root = rate.sqrt();
    let along = if root * (u1 - u0) < 0.75 {
        // The difference of two error functions would cancel; the rule is exact to 1e-16 on so short a stretch.
        gauss_8(u0, u1, |u| bell(rate, u))
    } else {
        let (x0, x1) = (root * u0, root * u1);
        let difference = if x0 > 0.0 {
            libm::erfc(x0) - libm::erfc(x1)
        } else if x1 < 0.0 {
            libm::erfc(-x1) - libm::erfc(-x0)
        } else {
            libm::erf(x1) - libm::erf(x0)
        };
        0.5 * (PI / rate).sqrt() * difference
    };
    bell(rate, b) * along
}
