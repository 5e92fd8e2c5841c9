//! Sums over the cells of a picture of what the particles that touch them hold, however many cells each touches.

use super::splat::Bounds;

/// Sums of `N` amounts for each cell of a grid.
pub struct Cover<const N: usize> {
    /// Pixels of a cell along x and y.
    sides: [usize; 2],
    /// Cells along x and y, and one more.
    counts: [usize; 2],
    /// By how much a cell holds more than the one before it in its row, and that more than in the row before: four numbers for a
    /// particle.
    rises: Vec<[f64; N]>,
    /// The sum of all amounts.
    all: f64,
}

impl<const N: usize> Cover<N> {
    /// Of a picture in cells of so many pixels along x and y.
    pub fn new(size: [u32; 2], sides: [usize; 2]) -> Self {
        let counts = [0, 1].map(|axis| (size[axis] as usize).div_ceil(sides[axis]) + 1);
        Self { sides, counts, rises: vec![[0.0; N]; counts[0] * counts[1]], all: 0.0 }
    }

    /// Adds to an amount of the cells that pixels within the picture touch; amounts are not negative.
    #[inline]
    pub fn add(&mut self, pixels: &Bounds, number: usize, amount: f64) {
        self.all += amount;
        let across = self.counts[0];
        let [[x0, x1], [y0, y1]] = [(pixels.x, self.sides[0]), (pixels.y, self.sides[1])]
            .map(|(range, side)| range.map(|at| at as usize / side));
        for (x, y, sign) in [(x0, y0, 1.0), (x1 + 1, y0, -1.0), (x0, y1 + 1, -1.0), (x1 + 1, y1 + 1, 1.0)] {
            self.rises[y * across + x][number] += sign * amount;
        }
    }

    /// What any sum may be rounded by: each is made of differences of sums of all.
    pub fn rounding(&self) -> f64 {
        1e-11 * self.all
    }

    /// Calls with the sums of each cell, row by row.
    pub fn sums(&self, mut tell: impl FnMut([f64; N])) {
        let [across, down] = self.counts;
        let mut above = vec![[0.0; N]; across];
        for row in self.rises.chunks_exact(across).take(down - 1) {
            let mut left = [0.0; N];
            for (x, (rise, above)) in row.iter().zip(&mut above).enumerate() {
                for ((left, above), rise) in left.iter_mut().zip(&mut *above).zip(rise) {
                    *left += rise;
                    *above += *left;
                }
                if x + 1 < across {
                    tell(*above);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_hold_what_touches_them() {
        let mut cover = Cover::<2>::new([100, 50], [8, 4]);
        let mut want = vec![[0.0; 2]; 13 * 13];
        for i in 0..200u32 {
            let at = |k: u32, n: u32| [i * k % n, (i * k % n + i * 7 % 30).min(n - 1)];
            let (bounds, number, amount) = (Bounds { x: at(37, 100), y: at(11, 50) }, i as usize % 2, f64::from(i % 9));
            cover.add(&bounds, number, amount);
            for y in bounds.y[0] / 4..=bounds.y[1] / 4 {
                for x in bounds.x[0] / 8..=bounds.x[1] / 8 {
                    want[(y * 13 + x) as usize][number] += amount;
                }
            }
        }
        let mut found = Vec::new();
        cover.sums(|sums| found.push(sums));
        assert_eq!(found.len(), want.len());
        for (found, want) in found.iter().zip(&want) {
            assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < cover.rounding()), "{found:?} {want:?}");
        }
    }
}
