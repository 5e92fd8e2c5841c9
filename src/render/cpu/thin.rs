//! Where gas is so thin that affine footprints are exact enough: a bound.
//!
//! An affine footprint ([`super::splat::Kind::Affine`]) is a sum of products of a column's and a row's factors: cheaper than the exact
//! one, and off by a small share of the ball's optical depth, which the method knows. Optical depth that is off by so much changes what
//! a ray sees by at most as much of what channels can differ. Balls that meet at a pixel are off by at most the sum of what each may
//! be, and that by the sum over all that touch its cell of a grid. Where no cell that a ball touches holds more than is allowed, it is
//! drawn so: at a pixel of any such ball, all of them together are within the bound. Cells hold whole register blocks, so that no pixel
//! that is drawn lies beyond those that a ball touches.

use super::cover::Cover;
use super::splat::Bounds;

/// Pixels of a register block at the most, along x and y: the least cell. Tiles begin with one.
const BLOCK: [usize; 2] = [16, 4];

/// Pixels along a side of a cell, at the most.
const LARGEST: usize = 64;

/// Cells along a ball, about.
const CELLS: f64 = 4.0;

/// Cells of a picture, at the most about.
const ALL_CELLS: usize = 1 << 17;

/// What a single ball may be off, as a share of what all may: dense ones would crowd their cells.
const EACH: f64 = 0.125;

/// What of a picture is thin.
pub struct Thin {
    sides: [usize; 2],
    /// Cells of a row, and one more.
    across: usize,
    /// How many cells above and to the left hold too much.
    crowded: Vec<u32>,
    most: f64,
    /// The most optical depth that balls in thin cells may be off together.
    pub error: f64,
}

/// Whether a ball may be drawn by an affine footprint that is off by so much, if all may be off by `most`.
#[inline]
pub fn is_small(error: f64, most: f64) -> bool {
    error <= EACH * most
}

/// Pixels along x and y of cells that fit a few times into balls of a size in pixels; powers of two.
pub fn sides(ball: f64, size: [u32; 2]) -> [usize; 2] {
    let mut side = BLOCK[1];
    while side < LARGEST && (2 * side) as f64 * CELLS <= ball {
        side *= 2;
    }
    let mut sides = [side.max(BLOCK[0]), side];
    while size.iter().zip(sides).map(|(&size, side)| (size as usize).div_ceil(side)).product::<usize>() > ALL_CELLS {
        sides = sides.map(|side| 2 * side);
    }
    sides
}

impl Thin {
    /// Where balls, given by the pixels that they may cover and what they may be off, are off by at most `most` together, in optical
    /// depth; cells as [`sides`] says.
    pub fn new(size: [u32; 2], sides: [usize; 2], most: f64, balls: impl Iterator<Item = (Bounds, f64)>) -> Self {
        let cells = [0, 1].map(|axis| (size[axis] as usize).div_ceil(sides[axis]));
        let mut cover = Cover::<1>::new(cells);
        for (bounds, error) in balls.filter(|&(_, error)| is_small(error, most)) {
            cover.add(bounds.cells(sides), 0, error);
        }
        let [room] = cover.rounding();
        let across = cells[0] + 1;
        let mut crowded = vec![0; across];
        let (mut worst, mut row) = (0.0f64, 0);
        cover.sums(|[sum]| {
            if crowded.len().is_multiple_of(across) {
                crowded.push(0);
                row = 0;
            }
            let sum = sum + room;
            if sum <= most {
                worst = worst.max(sum);
            } else {
                row += 1;
            }
            crowded.push(crowded[crowded.len() - across] + row);
        });
        Self { sides, across, crowded, most, error: worst }
    }

    /// Whether a ball is drawn by its affine footprint, which may be off by `error`.
    #[inline]
    pub fn takes(&self, bounds: &Bounds, error: f64) -> bool {
        if !is_small(error, self.most) {
            return false;
        }
        let [[x0, x1], [y0, y1]] = bounds.cells(self.sides);
        let before = |x: usize, y: usize| self.crowded[y * self.across + x];
        before(x1 + 1, y1 + 1) + before(x0, y0) == before(x0, y1 + 1) + before(x1 + 1, y0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [203, 101];

    fn balls() -> Vec<(Bounds, f64)> {
        (0..400u32)
            .map(|i| {
                // Crowded in one corner, cut by the edges, and now and then one that is too dense by itself.
                let at = |k: u32, n: u32| {
                    let first = (i * k % n) * (i * k % n) / n;
                    [first, (first + i % 17).min(n - 1)]
                };
                let error = if i % 40 == 39 { 0.2 } else { 0.01 * f64::from(1 + i % 3) };
                (Bounds { x: at(37, SIZE[0]), y: at(59, SIZE[1]) }, error)
            })
            .collect()
    }

    /// At no pixel of the blocks that are drawn are balls that are taken off by more than is allowed, summed pixel by pixel; and much of
    /// what could be taken is.
    #[test]
    fn what_is_taken_keeps_the_bound() {
        let (balls, most) = (balls(), 0.4);
        for sides in [[16, 4], [16, 8], [32, 32]] {
            let thin = Thin::new(SIZE, sides, most, balls.iter().copied());
            let mut sums = vec![0.0; (SIZE[0] * SIZE[1]) as usize];
            let mut taken = 0;
            for (Bounds { x, y }, error) in balls.iter().filter(|(bounds, error)| thin.takes(bounds, *error)) {
                taken += 1;
                for row in y[0] & !3..=(y[1] | 3).min(SIZE[1] - 1) {
                    for column in x[0] & !15..=(x[1] | 15).min(SIZE[0] - 1) {
                        sums[(row * SIZE[0] + column) as usize] += error;
                    }
                }
            }
            let worst = sums.iter().copied().fold(0.0, f64::max);
            assert!(worst <= thin.error && thin.error <= most, "{sides:?}: {worst} {}", thin.error);
            assert!((60..380).contains(&taken), "{sides:?}: {taken}");
            assert!(worst > 0.2 * most, "{sides:?}: {worst}");
            assert!(balls.iter().all(|(bounds, error)| *error < 0.1 || !thin.takes(bounds, *error)));
            assert!(!thin.takes(&balls[0].0, f64::NAN));
        }
        // None where nothing may be off, all where much may.
        let none = Thin::new(SIZE, [16, 8], 0.0, balls.iter().copied());
        assert!(!balls.iter().any(|(bounds, error)| none.takes(bounds, *error)));
        let all = Thin::new(SIZE, [16, 8], 100.0, balls.iter().copied());
        assert!(balls.iter().all(|(bounds, error)| all.takes(bounds, *error)));
    }

    #[test]
    fn cells_are_finer_than_balls_and_hold_blocks() {
        let of = |ball| sides(ball, [1024, 768]);
        assert_eq!([0.5, 31.0, 32.0, 64.0, 1e5].map(of), [[16, 4], [16, 4], [16, 8], [16, 16], [64, 64]]);
        let [x, y] = sides(1.0, [32768, 8192]);
        assert!((32768 / x) * (8192 / y) <= ALL_CELLS && x == 4 * y, "{x} {y}");
    }
}
