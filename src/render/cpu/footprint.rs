//! Footprints in f32 vectors: the twins of [`crate::scene::kernel`]'s f64 definitions.

use super::simd::{Simd, TINY};
use crate::scene::Kernel;
use rayon::prelude::*;

/// 4.5 log2(e): the Gaussian's exponent in powers of two.
pub const GAUSSIAN_LOG2: f32 = (4.5 * std::f64::consts::LOG2_E) as f32;

/// The integral of exp(-4.5 u^2) along a line through a ball's centre.
pub const GAUSSIAN_CENTRE: f32 = 0.833_287;

/// Mean of the Gaussian ball's footprint over its disc.
pub const GAUSSIAN_MEAN: f64 = 0.216_297;

/// F of the Gaussian ball is sqrt(w) P(w), w = 1 - u^2, with P entire (e^(x^2) erf(x) is x times a power series in x^2).
/// Minimax on [0, 1] for sqrt(w) P(w): 5.6e-6, 5.8e-6 as evaluated in f32.
const GAUSSIAN_BALL: [f32; 8] =
    [0.026_570_583, 0.084_207_185, 0.088_091_515, 0.514_775, -0.829_822_8, 1.872_605, -1.459_054_5, 0.702_622_23];

/// The root of P for the least relative error, which sums of many rims need; P is off by 1.06e-4 as evaluated in f32.
const GAUSSIAN_SUMS: [f32; 6] =
    [0.163_279_73, 0.245_689_26, 0.247_019_95, 0.228_327_66, -0.000_844_719_9, 0.116_475_49];

/// What [`gaussian_quick`] is off, at the most, as a share: the root's estimate by 2^-13, the polynomial by 1.06e-4.
pub const QUICK: f64 = 2.3e-4;

/// F(u) of the Gaussian ball from w = 1 - u^2, within 6e-6 and, but for that, 2^-13 of it; 0, or below 1e-16, for w <= 0. Several
/// rows at a time, so that each coefficient is loaded once for all.
#[inline(always)]
pub fn gaussian_ball<S: Simd, const R: usize>(s: S, mut w: [S::F; R]) -> [S::F; R] {
    let mut p = polynomial(s, &mut w, &GAUSSIAN_BALL);
    for (p, &w) in p.iter_mut().zip(&w) {
        *p = s.mul(*p, s.sqrt_fast(w));
    }
    p
}

/// The same within [`QUICK`] of it, however small it is.
#[inline(always)]
pub fn gaussian_quick<S: Simd, const R: usize>(s: S, mut w: [S::F; R]) -> [S::F; R] {
    let mut p = polynomial(s, &mut w, &GAUSSIAN_SUMS);
    for (p, &w) in p.iter_mut().zip(&w) {
        *p = s.mul(s.mul(*p, *p), s.sqrt_fast(w));
    }
    p
}

/// A polynomial of w, which is clamped to what has a root.
#[inline(always)]
fn polynomial<S: Simd, const R: usize, const N: usize>(s: S, w: &mut [S::F; R], coefficients: &[f32; N]) -> [S::F; R] {
    let mut p = [s.splat(coefficients[N - 1]); R];
    for w in &mut *w {
        *w = s.max(*w, s.splat(TINY));
    }
    for i in (0..N - 1).rev() {
        let coefficient = s.splat(coefficients[i]);
        for (p, &w) in p.iter_mut().zip(&*w) {
            *p = s.mul_add(*p, w, coefficient);
        }
    }
    p
}

/// The eighth root of exp(-4.5 v), minimax for its eighth power on [0, 2]: 6.5e-7 as evaluated in f32.
const GAUSSIAN_CARD: [f32; 6] = [1.0, -0.562_498_3, 0.158_179_75, -0.029_560_74, 0.003_987_490_7, -0.000_325_970_82];

/// exp(-4.5 v) on a square card, 0 <= v <= 2, within 6.5e-7; anything beyond. Several rows at a time, as [`gaussian_ball`].
#[inline(always)]
pub fn gaussian_card<S: Simd, const R: usize>(s: S, v: [S::F; R]) -> [S::F; R] {
    let mut p = [s.splat(GAUSSIAN_CARD[5]); R];
    for coefficient in GAUSSIAN_CARD[..5].iter().rev() {
        let coefficient = s.splat(*coefficient);
        for (p, &v) in p.iter_mut().zip(&v) {
            *p = s.mul_add(*p, v, coefficient);
        }
    }
    for _ in 0..3 {
        for p in &mut p {
            *p = s.mul(*p, *p);
        }
    }
    p
}

/// Intervals of a footprint table; the largest numbers are for profiles with steps, whose footprint has vertical tangents.
const INTERVALS: [usize; 4] = [1 << 10, 1 << 12, 1 << 14, 1 << 16];

/// Error of interpolation that a table should keep, in units of F.
const TABLE_ERROR: f64 = 2e-5;

/// The place of a kernel's footprint table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Table {
    /// First entry.
    start: u32,
    /// Number of intervals between u = 0 and u = 1; 0 for the Gaussian, which has a formula instead of a table.
    intervals: f32,
}

impl Table {
    /// Whether the kernel has a formula instead.
    #[inline(always)]
    pub fn is_gaussian(self) -> bool {
        self.intervals == 0.0
    }

    /// First entry in [`Tables::values`].
    pub fn start(self) -> u32 {
        self.start
    }

    /// Number of intervals between u = 0 and u = 1, a whole number; 0 for the Gaussian.
    pub fn intervals(self) -> f32 {
        self.intervals
    }
}

/// Footprint tables of all kernels of a scene that have no formula in vectors. Tabulated is F(u) / sqrt(1 - u^2), which is
/// smooth up to the rim where F itself has a vertical tangent.
#[derive(Clone, Debug, Default)]
pub struct Tables {
    values: Vec<f32>,
    kernels: Vec<(Kernel, Table)>,
}

impl Tables {
    /// The table of a kernel, made when it is new.
    pub fn table(&mut self, kernel: &Kernel) -> Table {
        if *kernel == Kernel::Gaussian {
            return Table::default();
        }
        if let Some((_, table)) = self.kernels.iter().find(|(other, _)| other == kernel) {
            return *table;
        }
        // At the rim itself the quotient is 0/0: its limit is taken just inside.
        let quotient = |u: f64| {
            let u = u.min(1.0 - 1e-7);
            kernel.footprint(u) / (1.0 - u * u).sqrt()
        };
        let mut values: Vec<f64> = Vec::new();
        for n in INTERVALS {
            values = (0..=n).into_par_iter().map(|i| quotient(i as f64 / n as f64)).collect();
            // Where interpolation is good, it is good half way.
            let good = values.par_windows(2).enumerate().all(|(i, ends)| {
                let u = (i as f64 + 0.5) / n as f64;
                (0.5 * (ends[0] + ends[1]) - quotient(u)).abs() * (1.0 - u * u).sqrt() <= TABLE_ERROR
            });
            if good {
                break;
            }
        }
        let table = Table { start: self.values.len() as u32, intervals: (values.len() - 1) as f32 };
        // One entry more, so that an interpolation at the very end stays inside.
        let last = values[values.len() - 1];
        self.values.extend(values.into_iter().chain([last]).map(|value| value as f32));
        self.kernels.push((kernel.clone(), table));
        table
    }

    /// All tables, one after the other.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

/// F(u) from v = u^2 >= 0 by linear interpolation, at most `most`; 0 for v >= 1.
#[inline(always)]
pub fn tabulated<S: Simd>(s: S, v: S::F, table: Table, most: f32, values: &[f32]) -> S::F {
    let v = s.min(v, s.splat(1.0));
    let chord = s.sqrt(s.sub(s.splat(1.0), v));
    let at = s.mul(s.sqrt(v), s.splat(table.intervals));
    // Rounding half an interval down; at a whole number either neighbour gives the same value.
    let whole = s.max(s.round(s.sub(at, s.splat(0.5))), s.splat(0.0));
    let fraction = s.sub(at, whole);
    let values = &values[table.start as usize..];
    let low = s.lookup(values, whole);
    let high = s.lookup(values, s.add(whole, s.splat(1.0)));
    s.min(s.mul(chord, s.mul_add(fraction, s.sub(high, low), low)), s.splat(most))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::simd::{Level, WithSimd, dispatch};

    /// A footprint's value: of a card, or of a ball that is quick.
    struct Value<const CARD: bool>(f32);

    impl<const CARD: bool> WithSimd for Value<CARD> {
        type Output = f32;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> f32 {
            let mut lanes = [0.0; 16];
            let at = [s.splat(self.0)];
            let [value] = if CARD { gaussian_card(s, at) } else { gaussian_quick(s, at) };
            s.store(value, &mut lanes);
            lanes[0]
        }
    }

    #[test]
    fn quick_footprints_are_off_by_a_share_of_themselves() {
        for level in Level::available() {
            let mut worst = 0.0f64;
            for i in 1..=20_000 {
                // As many near the rim as anywhere.
                let w = (f64::from(i) / 20_000.0).powi(3) as f32;
                let want = Kernel::Gaussian.footprint((1.0 - f64::from(w)).sqrt());
                let got = f64::from(dispatch(level, Value::<false>(w)));
                worst = worst.max((got / want - 1.0).abs());
            }
            assert!(worst < QUICK, "{level}: {worst:e}");
            assert!(dispatch(level, Value::<false>(-0.5)).abs() < 1e-15);
        }
    }

    #[test]
    fn cards_are_gaussians() {
        for level in Level::available() {
            for i in 0..=20_000 {
                let v = 1e-4 * i as f32;
                let off = f64::from(dispatch(level, Value::<true>(v))) - (-4.5 * f64::from(v)).exp();
                assert!(off.abs() < 6.5e-7, "{level}, {v}: {off:e}");
            }
        }
    }

    #[test]
    fn the_centre_is_that_of_the_kernel() {
        assert!((f64::from(GAUSSIAN_CENTRE) / Kernel::Gaussian.chord(0.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_mean_is_that_of_the_disc() {
        // Rings of equal area.
        let ring = |i: u32| Kernel::Gaussian.footprint((f64::from(2 * i + 1) / 20_000.0).sqrt());
        let mean = (0..10_000).map(ring).sum::<f64>() / 10_000.0;
        assert!((GAUSSIAN_MEAN / mean - 1.0).abs() < 1e-5, "{mean}");
    }
}
