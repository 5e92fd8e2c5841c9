//! Rows of a tile's pixels within one cell of its grid, along which the spline is one cubic.

use super::enlarge::spline;

/// Rows of pixels, one after the other, of one cell of a grid.
///
/// With u the distance of a row from the middle of them, in halves of their height, the weights of the four rows of the grid around them
/// are a + b u + c u^2 + d u^3.
pub struct Stretch {
    /// The first of them in the tile.
    pub first: usize,
    /// How many.
    pub count: usize,
    /// a, b, c and d, of each of the four weights.
    pub terms: [[f32; 4]; 4],
    /// u and its square of the last row, the last but one and so on, down to the middle, as shares of 2^15. The first rows have the same
    /// with the other sign.
    pub distances: Vec<[i16; 2]>,
}

impl Stretch {
    /// `count` rows from number `first` of a tile on, which is a share `share` of the way from the second to the third row of the grid, each
    /// `step` further.
    pub fn new(first: usize, count: usize, share: f64, step: f64) -> Self {
        let half = 0.5 * count as f64;
        let middle = share + (half - 0.5) * step;
        let distances = (0..count.div_ceil(2)).map(|row| {
            let u = (half - 0.5 - row as f64) / half;
            [u, u * u].map(|u| (u * 32_768.0).round() as i16)
        });
        let mut unit = 1.0;
        let terms = derivatives(middle).map(|weights| {
            let term = weights.map(|weight| (weight * unit) as f32);
            unit *= half * step;
            term
        });
        Self { first, count, terms, distances: distances.collect() }
    }
}

/// The weights of [`spline`] at `t`, their first derivatives, half of the second and a sixth of the third.
fn derivatives(t: f64) -> [[f64; 4]; 4] {
    let u = 1.0 - t;
    [
        spline(t),
        [-0.5 * u * u, (1.5 * t - 2.0) * t, (2.0 - 1.5 * u) * u, 0.5 * t * t],
        [0.5 * u, 1.5 * t - 1.0, 1.5 * u - 1.0, 0.5 * t],
        [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The terms are the weights of every row.
    #[test]
    fn terms_are_the_weights_of_the_rows() {
        for (spacing, count) in [(16, 16), (16, 8), (16, 5), (8, 8), (4, 4), (4, 3), (2, 2), (2, 1)] {
            let step = 1.0 / f64::from(spacing);
            let stretch = Stretch::new(0, count, 0.5 * step, step);
            for row in 0..count {
                // The last rows first, the first with the other sign.
                let end = row.max(count - 1 - row);
                let [distance, square] = stretch.distances[count - 1 - end].map(|share| f64::from(share) / 32_768.0);
                let distance = if row == end { distance } else { -distance };
                let want = spline((row as f64 + 0.5) * step);
                for (i, want) in want.into_iter().enumerate() {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|k| f64::from(stretch.terms[k][i]));
                    let got = a + c * square + (b + d * square) * distance;
                    assert!((got - want).abs() < 3e-5, "row {row} of {count}, {spacing}: {got} for {want}");
                }
            }
        }
    }

    /// Values of nodes in [-1, 1] give terms of at most 1, so that places within half of 16 bits have terms within them.
    #[test]
    fn terms_are_within_bounds() {
        for share in 0..8 {
            let stretch = Stretch::new(0, 16 - share, (share as f64 + 0.5) / 16.0, 1.0 / 16.0);
            let [a, b, c, d] = stretch.terms.map(|weights| weights.iter().map(|weight| weight.abs()).sum::<f32>());
            assert!(a <= 1.000_001 && b <= 0.751 && c <= 0.313 && d <= 0.167, "{a} {b} {c} {d}");
        }
    }
}
