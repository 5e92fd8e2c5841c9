//! Footprints in f32 vectors: the twins of [`crate::scene::kernel`]'s f64 definitions.

use super::simd::{Simd, exp2_neg};
use crate::scene::Kernel;

/// 4.5 log2(e): the Gaussian's exponent in powers of two.
pub const GAUSSIAN_LOG2: f32 = (4.5 * std::f64::consts::LOG2_E) as f32;

/// F of the Gaussian ball is sqrt(w) P(w), w = 1 - u^2, with P entire (e^(x^2) erf(x) is x times a power series in x^2).
/// Minimax on [0, 1] for sqrt(w) P(w): 6.5e-7, 9e-7 as evaluated in f32.
const GAUSSIAN_BALL: [f32; 9] = [
    0.026_675_193,
    0.079_291_88,
    0.155_723_45,
    0.095_721_565,
    0.550_227_3,
    -0.710_128_6,
    1.297_642_8,
    -0.860_416_05,
    0.365_261_8,
];

/// F(u) of the Gaussian ball from v = u^2 >= 0; 0 for v >= 1.
#[inline(always)]
pub fn gaussian_ball<S: Simd>(s: S, v: S::F) -> S::F {
    let w = s.max(s.sub(s.splat(1.0), v), s.splat(0.0));
    let mut p = s.splat(GAUSSIAN_BALL[8]);
    for i in (0..8).rev() {
        p = s.mul_add(p, w, s.splat(GAUSSIAN_BALL[i]));
    }
    s.mul(p, s.sqrt(w))
}

/// exp(-4.5 v) for v >= 0.
#[inline(always)]
pub fn gaussian<S: Simd>(s: S, v: S::F) -> S::F {
    exp2_neg(s, s.mul(v, s.splat(GAUSSIAN_LOG2)))
}

/// Intervals of a footprint table.
const INTERVALS: usize = 1024;
/// Entries of a table: both ends, and one more so that an interpolation at the very end stays inside.
const STRIDE: usize = INTERVALS + 2;

/// Footprint tables of all kernels of a scene that have no formula in vectors. Tabulated is F(u) / sqrt(1 - u^2), which is
/// smooth up to the rim where F itself has a vertical tangent.
#[derive(Clone, Debug, Default)]
pub struct Tables {
    values: Vec<f32>,
    kernels: Vec<Kernel>,
}

impl Tables {
    /// Start of the table of a kernel, made when it is new; negative for the Gaussian.
    pub fn start(&mut self, kernel: &Kernel) -> f32 {
        if *kernel == Kernel::Gaussian {
            return -1.0;
        }
        let position = self.kernels.iter().position(|k| k == kernel).unwrap_or_else(|| {
            self.kernels.push(kernel.clone());
            self.values.extend((0..STRIDE).map(|i| {
                // At the rim itself the quotient is 0/0: its limit is taken just inside.
                let u = (i as f64 / INTERVALS as f64).min(1.0 - 1e-7);
                (kernel.footprint(u) / (1.0 - u * u).sqrt()) as f32
            }));
            self.kernels.len() - 1
        });
        (position * STRIDE) as f32
    }

    /// All tables, one after the other.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

/// F(u) from v = u^2 >= 0 by linear interpolation in the table that starts at `start`; 0 for v >= 1.
#[inline(always)]
pub fn tabulated<S: Simd>(s: S, v: S::F, start: f32, tables: &[f32]) -> S::F {
    let v = s.min(v, s.splat(1.0));
    let chord = s.sqrt(s.sub(s.splat(1.0), v));
    let at = s.mul(s.sqrt(v), s.splat(INTERVALS as f32));
    // Truncation would do, but this needs no conversion; at a whole number either neighbour gives the same value.
    let whole = s.max(s.round(s.sub(at, s.splat(0.5))), s.splat(0.0));
    let fraction = s.sub(at, whole);
    let index = s.add(whole, s.splat(start));
    let low = s.lookup(tables, index);
    let high = s.lookup(tables, s.add(index, s.splat(1.0)));
    s.mul(chord, s.mul_add(fraction, s.sub(high, low), low))
}
