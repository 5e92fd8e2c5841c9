//! Which values a plot shows: all, unless a few near a pole would flatten the rest.

use super::ticks::Ticks;

/// The span of values that a plot shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lowest value shown.
    pub lo: f64,
    /// Highest value shown, above `lo`.
    pub hi: f64,
    /// Whether there are values below `lo`.
    pub below: bool,
    /// Whether there are values above `hi`.
    pub above: bool,
}

/// Where a pole is looked for: this part of the magnitudes is taken to be no part of it.
const NO_POLE: f64 = 0.98;
/// How many times the magnitude there the largest may be without being one.
const GROWTH: f64 = 4.0;
/// The part of the magnitudes that is shown of values with a pole.
const SHOWN: f64 = 0.95;
/// A sign that reaches less than this part of the other's magnitude is taken for zero.
const NO_SIGN: f64 = 1e-3;
/// Values that differ by less than this part of their magnitude are constant.
const CONSTANT: f64 = 1e-9;

impl Range {
    /// The range of values, magnitudes 0 or from 1e-300 to 1e300; `None` of none.
    ///
    /// Let M be the largest magnitude. Where M is more than 4 times the 98th percentile of the magnitudes, the range ends at
    /// their 95th percentile (at the 98th if that is 0), else at M; it is then widened to multiples of half the distance of
    /// its ticks (at most 7). Values that grow as 1/t towards a pole have medians far below any percentile that the pole
    /// reaches: at the 98th they would all look like zero. A sign that
    /// reaches less than a thousandth of the other's magnitude is not given a side of its own. Constant values get the range
    /// from 0 to twice their value, zeros that from -1 to 1.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut magnitudes: Vec<f64> = Vec::new();
        for v in values {
            (lowest, highest) = (lowest.min(v), highest.max(v));
            magnitudes.push(v.abs());
        }
        magnitudes.sort_unstable_by(f64::total_cmp);
        let percentile = |part: f64| {
            let at = (magnitudes.len() as f64 * part).ceil() as usize;
            at.checked_sub(1).and_then(|at| magnitudes.get(at)).copied()
        };
        let (largest, no_pole, shown) = (*magnitudes.last()?, percentile(NO_POLE)?, percentile(SHOWN)?);
        let limit = match (no_pole > 0.0 && largest > GROWTH * no_pole, shown > 0.0) {
            (false, _) => largest,
            (true, false) => no_pole,
            (true, true) => shown,
        };
        let (mut lo, mut hi) = (lowest.max(-limit), highest.min(limit));
        if hi - lo <= CONSTANT * limit {
            (lo, hi) = if limit == 0.0 { (-1.0, 1.0) } else { ((2.0 * hi).min(0.0), (2.0 * hi).max(0.0)) };
        } else {
            if lo < 0.0 && -lo < NO_SIGN * hi {
                lo = 0.0;
            }
            if hi > 0.0 && hi < NO_SIGN * -lo {
                hi = 0.0;
            }
            let grain = 0.5 * Ticks::new(lo, hi, 7).step;
            // An end that stands on a multiple already must not be moved by a rounding.
            lo = grain * (lo / grain + 1e-9).floor();
            hi = grain * (hi / grain - 1e-9).ceil();
        }
        let slack = NO_SIGN * (hi - lo);
        Some(Self { lo, hi, below: lowest < lo - slack, above: highest > hi + slack })
    }

    /// Whether both signs are shown.
    pub fn signed(&self) -> bool {
        self.lo < 0.0 && self.hi > 0.0
    }

    /// Where in the range a value stands: 0 at `lo`, 1 at `hi`, beyond them where it is beyond, but at most 1e6.
    pub fn part(&self, value: f64) -> f64 {
        ((value - self.lo) / (self.hi - self.lo)).clamp(-1e6, 1e6)
    }
}
