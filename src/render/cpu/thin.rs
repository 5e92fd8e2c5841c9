//! Where gas is so thin that affine footprints are exact enough: a bound.
//!
//! An affine footprint ([`super::splat::Kind::Affine`]) is a sum of products of a column's and a row's factors: cheaper than the exact
//! one, and off by a small share of the ball's optical depth, which the method knows. Optical depth that is off by so much changes what
//! a ray sees by at most as much of what channels can differ. Balls that meet at a pixel are off by at most the sum of what each may
//! be, and that by the sum over all that touch its cell of a grid. Where no cell that a ball touches holds more than is allowed, it is
//! drawn so: at a pixel that any such ball covers, all of them are within the bound.

use super::cover::Cover;
use super::splat::Bounds;

/// Pixels along a side of a cell, at the least and at the most.
const SIDES: [usize; 2] = [4, 64];

/// Cells along a ball, about.
const CELLS: f64 = 4.0;

/// What a single ball may be off, as a share of what all may: dense ones would crowd their cells.
const EACH: f64 = 0.125;

/// An affine footprint reaches beyond the ball's outline by this share of its size at the most, and a pixel for rounding.
const BEYOND: f64 = 0.05;

/// What of a picture is thin.
pub struct Thin {
    side: usize,
    /// Cells of a row, and one more.
    across: usize,
    /// How many cells above and to the left hold too much.
    crowded: Vec<u32>,
    each: f64,
    /// The most that balls in thin cells may be off together.
    pub error: f64,
    /// Share of what all balls may be off that lies in thin cells.
    pub share: f64,
}

/// Whether a ball may be drawn by an affine footprint that is off by so much, if all may be off by `most`.
#[inline]
pub fn is_small(error: f64, most: f64) -> bool {
    error <= EACH * most
}

/// A power of two of pixels that fits a few times into balls of a size in pixels.
pub fn side(size: f64) -> usize {
    let [least, most] = SIDES;
    let mut side = least;
    while side < most && (2 * side) as f64 * CELLS <= size {
        side *= 2;
    }
    side
}

impl Thin {
    /// Where balls, given by the pixels that they may cover and what they may be off, are off by at most `most` together; cells of so
    /// many pixels a side.
    pub fn new(size: [u32; 2], side: usize, most: f64, balls: impl Iterator<Item = (Bounds, f64)>) -> Self {
        let mut cover = Cover::<1>::new(size, side);
        for (bounds, error) in balls.filter(|&(_, error)| is_small(error, most)) {
            cover.add(&grown(&bounds, size), 0, error);
        }
        let across = (size[0] as usize).div_ceil(side) + 1;
        let mut crowded = vec![0; across];
        let (mut worst, mut thin, mut all, mut row) = (0.0f64, 0.0, 0.0, 0);
        cover.sums(|[sum]| {
            if crowded.len().is_multiple_of(across) {
                crowded.push(0);
                row = 0;
            }
            // Room for what sums round.
            let sum = sum.max(0.0) + 1e-9 * most;
            row += u32::from(sum > most);
            crowded.push(crowded[crowded.len() - across] + row);
            all += sum;
            if sum <= most {
                worst = worst.max(sum);
                thin += sum;
            }
        });
        Self { side, across, crowded, each: EACH * most, error: worst, share: thin / all }
    }

    /// Whether a ball is drawn by its affine footprint, which may be off by `error`.
    #[inline]
    pub fn takes(&self, bounds: &Bounds, error: f64, size: [u32; 2]) -> bool {
        if error > self.each {
            return false;
        }
        let bounds = grown(bounds, size);
        let [[x0, x1], [y0, y1]] = [bounds.x, bounds.y].map(|[first, last]| {
            let cell = |at: u32| at as usize / self.side;
            [cell(first), cell(last) + 1]
        });
        let before = |x: usize, y: usize| self.crowded[y * self.across + x];
        before(x1, y1) + before(x0, y0) == before(x0, y1) + before(x1, y0)
    }
}

/// The pixels that an affine footprint may cover, of a ball that covers so many.
#[inline]
fn grown(bounds: &Bounds, size: [u32; 2]) -> Bounds {
    let of = |[first, last]: [u32; 2], size: u32| {
        let more = 1 + (BEYOND * f64::from(last + 1 - first)) as u32 + 1;
        [first.saturating_sub(more), (last + more).min(size - 1)]
    };
    Bounds { x: of(bounds.x, size[0]), y: of(bounds.y, size[1]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [203, 101];

    fn balls() -> Vec<(Bounds, f64)> {
        (0..400u32)
            .map(|i| {
                // Crowded in one corner, and now and then one that is too dense by itself.
                let at = |k: u32, n: u32| {
                    let first = (i * k % n) * (i * k % n) / n;
                    [first, (first + 3 + i % 17).min(n - 1)]
                };
                let error = if i % 40 == 39 { 0.2 } else { 0.01 * f64::from(1 + i % 3) };
                (Bounds { x: at(37, SIZE[0]), y: at(59, SIZE[1]) }, error)
            })
            .collect()
    }

    /// At no pixel are balls that are taken off by more than is allowed, summed pixel by pixel; and most of what could be taken is.
    #[test]
    fn what_is_taken_keeps_the_bound() {
        let (balls, most) = (balls(), 0.4);
        for side in [4, 8, 16] {
            let thin = Thin::new(SIZE, side, most, balls.iter().copied());
            let mut sums = vec![0.0; (SIZE[0] * SIZE[1]) as usize];
            let mut taken = 0;
            for (bounds, error) in balls.iter().filter(|(bounds, error)| thin.takes(bounds, *error, SIZE)) {
                taken += 1;
                for y in bounds.y[0]..=bounds.y[1] {
                    for x in bounds.x[0]..=bounds.x[1] {
                        sums[(y * SIZE[0] + x) as usize] += error;
                    }
                }
            }
            let worst = sums.iter().copied().fold(0.0, f64::max);
            assert!(worst <= thin.error && thin.error <= most, "{side}: {worst} {}", thin.error);
            assert!((100..380).contains(&taken), "{side}: {taken}");
            assert!(thin.share > 0.1 && thin.share < 0.9, "{side}: {}", thin.share);
            assert!(balls.iter().all(|(bounds, error)| *error < 0.1 || !thin.takes(bounds, *error, SIZE)));
        }
        // None where nothing may be off, all where much may.
        let none = Thin::new(SIZE, 8, 0.0, balls.iter().copied());
        assert!(!balls.iter().any(|(bounds, error)| none.takes(bounds, *error, SIZE)));
        let all = Thin::new(SIZE, 8, 100.0, balls.iter().copied());
        assert!(balls.iter().all(|(bounds, error)| all.takes(bounds, *error, SIZE)) && all.share > 0.999);
    }

    #[test]
    fn cells_are_finer_than_balls() {
        assert_eq!([0.5, 31.0, 32.0, 64.0, 1e5].map(side), [4, 4, 8, 16, 64]);
    }
}
