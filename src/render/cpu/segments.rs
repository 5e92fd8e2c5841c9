//! Pre-integrated kernel segments: what of a kernel lies between planes across its ball, seen along their normal.
//!
//! Tabulated is S(y, t), the integral of the density from the ball's front to the signed distance t from its middle, over
//! the integral through the centre. At distance u from the centre half the chord is w = sqrt(1 - u^2), and
//! y = 1 - sqrt(1 - w): at the rim y goes as w, where S has a vertical tangent in u, and at the centre 1 - y goes as u, where
//! S may have a cusp in w. The piece between two planes is the difference of two values, for every width and radius; pieces
//! add up to the whole footprint.

use super::simd::Simd;
use crate::scene::Kernel;
use rayon::prelude::*;

/// How the table is read along t.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lookup {
    /// At the nearest of the planes between the segments (Mueller & Crawfis).
    Nearest,
    /// Interpolated between the planes (Beliaev & Zaytseva).
    #[default]
    Interpolated,
}

impl Lookup {
    /// Both ways.
    pub const ALL: &[Self] = &[Self::Nearest, Self::Interpolated];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Interpolated => "interpolated",
        }
    }
}

/// Intervals of y from 0 to 1.
const INTERVALS: usize = 256;

/// Entries of a line of the table: one more than the ends of the intervals, so that interpolation at y = 1 stays inside.
pub const LINE: usize = INTERVALS + 2;

/// The segments of one kernel.
pub struct Segments {
    /// A line of S over y for each plane from t = -1 to 1, and the last one again.
    values: Vec<f32>,
    count: usize,
    lookup: Lookup,
}

impl Segments {
    /// Integrates `count` >= 1 segments of a kernel.
    pub fn new(kernel: &Kernel, count: u32, lookup: Lookup) -> Self {
        let count = count as usize;
        let whole = kernel.chord(0.0);
        let mut values = vec![0.0; (count + 2) * LINE];
        values.par_chunks_mut(LINE).enumerate().for_each(|(plane, line)| {
            let t = 2.0 * plane.min(count) as f64 / count as f64 - 1.0;
            for (i, value) in line.iter_mut().enumerate() {
                let rest = 1.0 - i.min(INTERVALS) as f64 / INTERVALS as f64;
                // 1 - w = (1 - y)^2, u^2 = (1 - w) (1 + w).
                let u = rest * (2.0 - rest * rest).sqrt();
                *value = (kernel.segment(u, -1.0, t) / whole) as f32;
            }
        });
        Self { values, count, lookup }
    }

    /// Lines of [`LINE`] values of S over y, one for each plane from t = -1 to 1, and the last one again.
    pub fn entries(&self) -> &[f32] {
        &self.values
    }

    /// `factor` times S at distance `t` from the middle, over y.
    pub fn line(&self, t: f64, factor: f32) -> [f32; LINE] {
        let at = (0.5 * (t.clamp(-1.0, 1.0) + 1.0)) * self.count as f64;
        let (plane, fraction) = match self.lookup {
            Lookup::Nearest => (at.round_ties_even(), 0.0),
            Lookup::Interpolated => (at.floor(), at - at.floor()),
        };
        let lines = &self.values[plane as usize * LINE..][..2 * LINE];
        let (low, high) = lines.split_at(LINE);
        let fraction = fraction as f32;
        let mut line = [0.0; LINE];
        for (value, (low, high)) in line.iter_mut().zip(low.iter().zip(high)) {
            *value = factor * (low + fraction * (high - low));
        }
        line
    }

    /// S at places `y` and distances `t` from the middle, in [-1, 1].
    #[inline(always)]
    pub fn values<S: Simd>(&self, s: S, y: Place<S::F>, t: S::F) -> S::F {
        let half_count = s.splat(0.5 * self.count as f32);
        let at = s.mul_add(t, half_count, half_count);
        let plane = match self.lookup {
            Lookup::Nearest => s.round(at),
            Lookup::Interpolated => s.max(s.round(s.sub(at, s.splat(0.5))), s.splat(0.0)),
        };
        let index = s.mul_add(plane, s.splat(LINE as f32), y.whole);
        let low = read(s, &self.values, index, y.fraction);
        match self.lookup {
            Lookup::Nearest => low,
            Lookup::Interpolated => {
                let high = read(s, &self.values, s.add(index, s.splat(LINE as f32)), y.fraction);
                s.mul_add(s.sub(at, plane), s.sub(high, low), low)
            }
        }
    }
}

/// A place y between two entries of a line.
#[derive(Clone, Copy)]
pub struct Place<F> {
    whole: F,
    fraction: F,
}

impl<F: Copy> Place<F> {
    /// The place for u^2 >= 0; y = 0, where S is 0, beyond the ball.
    #[inline(always)]
    pub fn new<S: Simd<F = F>>(s: S, square: F) -> Self {
        let one = s.splat(1.0);
        let half = s.sqrt(s.max(s.sub(one, square), s.splat(0.0)));
        let y = s.sub(one, s.sqrt(s.sub(one, half)));
        let at = s.mul(y, s.splat(INTERVALS as f32));
        let whole = s.max(s.round(s.sub(at, s.splat(0.5))), s.splat(0.0));
        Self { whole, fraction: s.sub(at, whole) }
    }

    /// The value of a line here.
    #[inline(always)]
    pub fn of<S: Simd<F = F>>(self, s: S, line: &[f32; LINE]) -> F {
        read(s, line, self.whole, self.fraction)
    }
}

#[inline(always)]
fn read<S: Simd>(s: S, values: &[f32], index: S::F, fraction: S::F) -> S::F {
    let low = s.lookup(values, index);
    let high = s.lookup(values, s.add(index, s.splat(1.0)));
    s.mul_add(fraction, s.sub(high, low), low)
}
