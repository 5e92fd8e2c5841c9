//! Which pixels errors are measured at.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The pixels of one view, the same in every view and for every method.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Width and height of a view.
    pub size: [u32; 2],
    /// Row-major indices, ascending.
    pub pixels: Vec<u32>,
    /// How many pixels each stands for, at least 1; together all of them.
    pub weights: Vec<f64>,
}

/// Decides which pixels a large picture is judged by.
const SEED: u64 = 20_050;

impl Sample {
    /// At most `most` pixels, at least one: all of them where they are no more, else one at random (ChaCha8) from each cell of
    /// a grid over the picture.
    pub fn new(size: [u32; 2], most: usize) -> Self {
        let [width, height] = size.map(|length| length as usize);
        if width * height <= most {
            return Self { size, pixels: (0..size[0] * size[1]).collect(), weights: vec![1.0; width * height] };
        }
        let most = most.max(1);
        let rows = ((most as f64 * height as f64 / width as f64).sqrt() as usize).clamp(1, height.min(most));
        let columns = (most / rows).clamp(1, width);
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut cells = Vec::with_capacity(rows * columns);
        for row in 0..rows {
            let y = row * height / rows..(row + 1) * height / rows;
            for column in 0..columns {
                let x = column * width / columns..(column + 1) * width / columns;
                let count = x.len() * y.len();
                // The bias of the remainder is below 2^-32.
                let chosen = (random.next_u64() % count as u64) as usize;
                let pixel = (y.start + chosen / x.len()) * width + x.start + chosen % x.len();
                cells.push((pixel as u32, count as f64));
            }
        }
        cells.sort_unstable_by_key(|cell| cell.0);
        let (pixels, weights) = cells.into_iter().unzip();
        Self { size, pixels, weights }
    }

    /// Whether it is every pixel.
    pub fn is_whole(&self) -> bool {
        self.pixels.len() as u64 == self.all()
    }

    /// Number of pixels in a view.
    pub fn all(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }
}
