//! Sums over the cells of a picture of what the particles that touch them hold, however many cells each touches: a particle costs
//! four additions and no loop whose end would have to be guessed.

/// Sums of `N` amounts for each cell of a grid.
#[derive(Clone, Debug)]
pub struct Cover<const N: usize> {
    /// Cells along x and y, and one more.
    counts: [usize; 2],
    /// By how much a cell holds more than the one before it in its row, and that more than in the row before: four numbers for a
    /// particle.
    rises: Vec<[f64; N]>,
    /// The sums of all amounts.
    all: [f64; N],
}

impl<const N: usize> Cover<N> {
    /// Of so many cells along x and y.
    pub fn new(cells: [usize; 2]) -> Self {
        let counts = cells.map(|count| count + 1);
        Self { counts, rises: vec![[0.0; N]; counts[0] * counts[1]], all: [0.0; N] }
    }

    /// Adds to an amount of the cells from the first to the last column and row; amounts are not negative.
    #[inline]
    pub fn add(&mut self, [columns, rows]: [[usize; 2]; 2], number: usize, amount: f64) {
        self.all[number] += amount;
        let ([x0, x1], [y0, y1], across) = (columns, rows, self.counts[0]);
        for (x, y, sign) in [(x0, y0, 1.0), (x1 + 1, y0, -1.0), (x0, y1 + 1, -1.0), (x1 + 1, y1 + 1, 1.0)] {
            self.rises[y * across + x][number] += sign * amount;
        }
    }

    /// Adds another's of as many cells.
    pub fn merge(&mut self, other: &Self) {
        self.all.iter_mut().zip(other.all).for_each(|(sum, all)| *sum += all);
        self.rises.as_flattened_mut().iter_mut().zip(other.rises.as_flattened()).for_each(|(sum, rise)| *sum += rise);
    }

    /// What any sum of each amount may be rounded by: they are made of differences of sums of all.
    pub fn rounding(&self) -> [f64; N] {
        self.all.map(|all| 1e-11 * all)
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
        let mut covers = [Cover::<2>::new([13, 12]), Cover::<2>::new([13, 12])];
        let mut want = vec![[0.0; 2]; 13 * 12];
        for i in 0..200 {
            let at = |k: usize, n: usize| [i * k % n, (i * k % n + i * 7 % 5).min(n - 1)];
            let (columns, rows, number, amount) = (at(37, 13), at(11, 12), i / 2 % 2, (i % 9) as f64);
            covers[i % 2].add([columns, rows], number, amount);
            for y in rows[0]..=rows[1] {
                for x in columns[0]..=columns[1] {
                    want[y * 13 + x][number] += amount;
                }
            }
        }
        let [mut cover, other] = covers;
        cover.merge(&other);
        let mut found = Vec::new();
        cover.sums(|sums| found.push(sums));
        assert_eq!(found.len(), want.len());
        for (found, want) in found.iter().zip(&want) {
            let off = found.iter().zip(want).map(|(found, want)| (found - want).abs());
            assert!(off.zip(cover.rounding()).all(|(off, rounding)| off < rounding), "{found:?} {want:?}");
        }
    }
}
