//! The film: what a renderer writes for one view.

use super::{Disparity, Plane};
use rayon::prelude::*;

/// One view's result in linear light: colour over the background, transmittance to the background and opaque depth.
///
/// Planes are row-major f32, row 0 on top, `width * height` values each. Colour is not clamped.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Linear-light red, green and blue of everything the ray sees, background included.
    pub color: [Plane<f32>; 3],
    /// Transmittance to the background, in [0, 1]; 0 where an opaque surface stops the ray.
    pub transmittance: Plane<f32>,
    /// Depth of the opaque surface in scene units, infinity where there is none; absent without opaque surfaces.
    pub depth: Option<Plane<f32>>,
    /// Absolute error of each pixel, the largest over colour and transmittance: a bound, rounding to f32 included, or an
    /// estimate, as the method says; absent where it says nothing.
    pub error: Option<Plane<f32>>,
    /// Where each pixel's point stands in the other eye's picture; absent without one and where the method was not asked.
    pub disparity: Option<Disparity>,
}

impl Film {
    /// A film of zeros without depth, error and disparity.
    pub fn new(size: [u32; 2]) -> Self {
        let n = size[0] as usize * size[1] as usize;
        Self {
            size,
            color: [Plane::new(n), Plane::new(n), Plane::new(n)],
            transmittance: Plane::new(n),
            depth: None,
            error: None,
            disparity: None,
        }
    }

    /// Averages `n` x `n` samples into each pixel; depth becomes the nearest of them, and the error has the rounding of the
    /// averages added. The disparity, in pixels of the result, is the mean of the samples that have one, weighted with
    /// 1 - transmittance. The size must be divisible by `n`.
    pub fn downsample(&self, n: u32) -> Self {
        self.downsample_into(n, Self::new([0, 0]))
    }

    /// As [`Film::downsample`], into the memory of a film that is no longer needed, where that is as large.
    pub fn downsample_into(&self, n: u32, spare: Self) -> Self {
        if n == 1 {
            return self.clone();
        }
        let [width, height] = self.size.map(|s| (s / n) as usize);
        let n = n as usize;
        let size = [width, height, n];
        let mean = |plane: &[f32], spare: Plane<f32>| {
            let share = 1.0 / (n * n) as f32;
            reduce(plane, size, spare, 0.0, |a, b| a + b, |sum| sum * share)
        };
        let planes = [&self.color[0], &self.color[1], &self.color[2], &self.transmittance];
        let error = self.error.as_ref().map(|plane| {
            // n^2 additions, each to half an ulp of no more than the sum of the sizes, and a product: over n^2, less than
            // an ulp of that sum. The bound's own mean is rounded in the same way.
            let mut rounding = vec![0.0f32; width * height];
            for plane in planes {
                let sums = reduce(plane, size, Plane::new(0), 0.0, |a, b| a + b.abs(), |sum| sum);
                rounding.iter_mut().zip(&sums).for_each(|(most, sum)| *most = most.max(sum * f32::EPSILON));
            }
            let grown = 1.0 + 2.0 * (n * n) as f32 * f32::EPSILON;
            mean(plane, Plane::new(0)).iter().zip(rounding).map(|(mean, rounding)| (mean + rounding) * grown).collect()
        });
        let Self { color: [red, green, blue], transmittance, depth, .. } = spare;
        Self {
            size: [width as u32, height as u32],
            color: [mean(planes[0], red), mean(planes[1], green), mean(planes[2], blue)],
            transmittance: mean(planes[3], transmittance),
            depth: self.depth.as_ref().map(|plane| {
                let spare = depth.unwrap_or_else(|| Plane::new(0));
                reduce(plane, size, spare, f32::INFINITY, f32::min, |least| least)
            }),
            error,
            disparity: self.disparity.as_ref().map(|disparity| Disparity {
                side: disparity.side,
                x: mean_disparity(&disparity.x, &self.transmittance, size),
            }),
        }
    }
}

/// The disparity of blocks of `n` x `n` samples, in pixels of `n` samples; NaN where no sample has one.
fn mean_disparity(x: &[f32], transmittance: &[f32], [width, height, n]: [usize; 3]) -> Plane<f32> {
    let mut sums = vec![[0.0; 2]; width * height];
    for (i, (&x, &transmittance)) in x.iter().zip(transmittance).enumerate() {
        if !x.is_nan() {
            // Gas too thin for 1 - T in f32 still has its say where there is no other.
            let weight = f64::from(1.0 - transmittance) + f64::from(f32::MIN_POSITIVE);
            let [sum, weights] = &mut sums[i / (width * n) / n * width + i % (width * n) / n];
            *sum += weight * f64::from(x);
            *weights += weight;
        }
    }
    // No weights: 0 / 0 is NaN.
    sums.into_iter().map(|[sum, weights]| (sum / weights / n as f64) as f32).collect()
}

/// Folds each block of `n` x `n` samples, row by row and from left to right, and finishes; `width` x `height` values, in the memory of
/// `spare` where that is as large.
fn reduce(
    plane: &[f32],
    [width, height, n]: [usize; 3],
    spare: Plane<f32>,
    start: f32,
    fold: impl Fn(f32, f32) -> f32 + Copy + Sync,
    finish: impl Fn(f32) -> f32 + Sync,
) -> Plane<f32> {
    let mut out = if spare.len() == width * height { spare } else { Plane::new(width * height) };
    out.par_chunks_mut(width).zip(plane.par_chunks_exact(width * n * n)).for_each(|(row, samples)| {
        row.fill(start);
        // One row of samples at a time, as they lie in memory; numbers that the compiler knows it makes vectors of.
        for samples in samples.chunks_exact(width * n) {
            match n {
                2 => fold_row::<2>(row, samples, fold),
                3 => fold_row::<3>(row, samples, fold),
                4 => fold_row::<4>(row, samples, fold),
                _ => row.iter_mut().zip(samples.chunks_exact(n)).for_each(|(value, block)| {
                    *value = block.iter().fold(*value, |a, &b| fold(a, b));
                }),
            }
        }
        row.iter_mut().for_each(|value| *value = finish(*value));
    });
    out
}

/// Folds `N` samples into each value of a row.
#[inline]
fn fold_row<const N: usize>(row: &mut [f32], samples: &[f32], fold: impl Fn(f32, f32) -> f32) {
    for (value, block) in row.iter_mut().zip(samples.as_chunks::<N>().0) {
        *value = block.iter().fold(*value, |a, &b| fold(a, b));
    }
}
