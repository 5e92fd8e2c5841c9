//! Difference of two pictures: maximum, RMSE, PSNR, SSIM.
//!
//! Pictures of integers are compared as they stand in their files, encoded, 0..1; where one of the two is float, both in
//! linear light. Colour alone counts; alpha is measured beside it.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::picture::color::LUMINANCE;
use crate::picture::read::{Image, Samples};

/// How two pictures of one size differ. Differences are absolute, 1 = full scale.
#[derive(Clone, Debug)]
pub struct Difference {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// What was compared.
    pub scale: Scale,
    /// The largest difference of any sample; infinity where a sample is NaN, or infinite in one picture.
    pub max: f64,
    /// Column and row of the first pixel with the largest difference.
    pub max_at: [u32; 2],
    /// Channel of that difference: 0, 1, 2 for red, green, blue.
    pub max_channel: usize,
    /// Root of the mean squared difference over all samples; infinity with `max`.
    pub rmse: f64,
    /// `-20 log10(rmse)` in decibels, peak 1; infinity for equal pictures.
    pub psnr: f64,
    /// Structural similarity of the luminance, at most 1 (equal pictures); NaN where samples are not finite. See [`ssim`].
    pub ssim: f64,
    /// Samples (of `3 * pixels`) that differ at all.
    pub differing: u64,
    /// Samples whose difference is infinite.
    pub not_finite: u64,
    /// Largest difference of alpha, where both pictures have it. It is no part of the other figures.
    pub alpha_max: Option<f64>,
    /// Largest difference of the three channels of each pixel, row-major; infinite as `max`.
    pub map: Vec<f32>,
}

/// The values that were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// sRGB-encoded, 0..1.
    Encoded,
    /// Linear light.
    Linear,
}

impl Scale {
    /// `encoded` or `linear`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Encoded => "encoded",
            Self::Linear => "linear",
        }
    }
}

/// Compares two pictures. [`Error::Usage`] if their sizes differ.
pub fn compare(a: &Image, b: &Image) -> Result<Difference> {
    if a.picture.size != b.picture.size {
        let [[aw, ah], [bw, bh]] = [a.picture.size, b.picture.size];
        return Err(Error::Usage(format!(
            "pictures of different sizes cannot be compared: {aw} x {ah} and {bw} x {bh}"
        )));
    }
    let alpha_max = match (&a.picture.alpha, &b.picture.alpha) {
        (Some(a), Some(b)) => Some(a.iter().zip(b).map(|(&a, &b)| distance(a.into(), b.into())).fold(0.0, f64::max)),
        _ => None,
    };
    let mut difference = match (codes(&a.samples), codes(&b.samples)) {
        (Some(a_codes), Some(b_codes)) => {
            // Codes are subtracted as integers: one 8-bit step is then exactly 1/255, not nearly.
            let difference = |i: usize, c: usize| f64::from(a_codes(3 * i + c).abs_diff(b_codes(3 * i + c))) / 65535.0;
            let luma = |codes: &(dyn Fn(usize) -> u16 + Sync), i: usize| -> f64 {
                (0..3).map(|c| LUMINANCE[c] * f64::from(codes(3 * i + c)) / 65535.0).sum()
            };
            measure(a.picture.size, Scale::Encoded, difference, |i| luma(&a_codes, i), |i| luma(&b_codes, i))
        }
        _ => {
            let value = |image: &Image, i: usize, c: usize| f64::from(image.picture.color[c][i]);
            let luminance =
                |image: &Image, i: usize| -> f64 { (0..3).map(|c| LUMINANCE[c] * value(image, i, c)).sum() };
            let difference = |i: usize, c: usize| distance(value(a, i, c), value(b, i, c));
            measure(a.picture.size, Scale::Linear, difference, |i| luminance(a, i), |i| luminance(b, i))
        }
    };
    difference.alpha_max = alpha_max;
    Ok(difference)
}

/// The figures of several differences as of one picture: largest maximum, RMSE over all samples, mean SSIM by pixels.
/// Returns (max, rmse, psnr, ssim). Empty input is an exact match.
pub fn pooled(parts: &[Difference]) -> (f64, f64, f64, f64) {
    let pixels = |d: &Difference| f64::from(d.size[0]) * f64::from(d.size[1]);
    let total: f64 = parts.iter().map(pixels).sum();
    if total == 0.0 {
        return (0.0, 0.0, f64::INFINITY, 1.0);
    }
    let max = parts.iter().map(|d| d.max).fold(0.0, f64::max);
    let rmse = (parts.iter().map(|d| d.rmse * d.rmse * pixels(d)).sum::<f64>() / total).sqrt();
    let ssim = parts.iter().map(|d| d.ssim * pixels(d)).sum::<f64>() / total;
    (max, rmse, -20.0 * rmse.log10(), ssim)
}

/// The 16-bit codes of a file of integers; 8-bit ones times 257, which is exact.
fn codes(samples: &Samples) -> Option<Box<dyn Fn(usize) -> u16 + Sync + '_>> {
    match samples {
        Samples::U8(v) => Some(Box::new(|i| 257 * u16::from(v[i]))),
        Samples::U16(v) => Some(Box::new(|i| v[i])),
        Samples::Float => None,
    }
}

/// Absolute difference; infinity where either is NaN or just one infinite, so that no such sample passes a limit.
fn distance(a: f64, b: f64) -> f64 {
    if a == b {
        return 0.0;
    }
    let d = (a - b).abs();
    if d.is_nan() { f64::INFINITY } else { d }
}

fn measure(
    size: [u32; 2],
    scale: Scale,
    difference: impl Fn(usize, usize) -> f64 + Sync,
    luminance_a: impl Fn(usize) -> f64 + Sync,
    luminance_b: impl Fn(usize) -> f64 + Sync,
) -> Difference {
    let width = size[0] as usize;
    let n = width * size[1] as usize;
    let mut map = Vec::with_capacity(n);
    let (mut max, mut at, mut max_channel) = (0.0, 0, 0);
    let (mut differing, mut not_finite) = (0, 0);
    let mut squares = 0.0;
    for i in 0..n {
        let mut largest: f64 = 0.0;
        for c in 0..3 {
            let d = difference(i, c);
            squares += d * d;
            differing += u64::from(d > 0.0);
            not_finite += u64::from(d.is_infinite());
            largest = largest.max(d);
            if d > max {
                (max, at, max_channel) = (d, i, c);
            }
        }
        map.push(largest as f32);
    }
    let rmse = (squares / (3 * n) as f64).sqrt();
    let plane = |f: &(dyn Fn(usize) -> f64 + Sync)| -> Vec<f64> { (0..n).into_par_iter().map(f).collect() };
    Difference {
        size,
        scale,
        max,
        max_at: [(at % width) as u32, (at / width) as u32],
        max_channel,
        rmse,
        psnr: -20.0 * rmse.log10(),
        ssim: ssim(&plane(&luminance_a), &plane(&luminance_b), width),
        differing,
        not_finite,
        alpha_max: None,
        map,
    }
}

/// Side of the window, pixels (Wang et al. 2004, section III-C).
const WINDOW: usize = 11;
/// Standard deviation of the window's Gaussian, pixels (as above).
const SIGMA: f64 = 1.5;
/// `(K1 L)^2` and `(K2 L)^2` with K1 = 0.01, K2 = 0.03 and L = 1 (as above).
const C: [f64; 2] = [0.01 * 0.01, 0.03 * 0.03];

/// Mean structural similarity of two planes of equal length, rows of `width` values, range 0..1.
///
/// Z. Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004: an 11 x 11 Gaussian
/// window of sigma 1.5 at every position where it fits wholly. In a direction with fewer than 11 pixels the one window
/// is the Gaussian over those there are.
pub fn ssim(a: &[f64], b: &[f64], width: usize) -> f64 {
    let height = a.len() / width;
    let (across, down) = (window(width), window(height));
    let (columns, rows) = (width - across.len() + 1, height - down.len() + 1);
    // Row sums are collected in order before they are added, so that the figure does not depend on the threads.
    let sums: Vec<f64> = (0..rows)
        .into_par_iter()
        .map(|row| {
            // Weighted down the window first: means of a, b, a a, b b, a b for each column.
            let mut means = vec![[0.0; 5]; width];
            for (k, &w) in down.iter().enumerate() {
                let first = (row + k) * width;
                for ((m, &x), &y) in means.iter_mut().zip(&a[first..first + width]).zip(&b[first..first + width]) {
                    for (m, v) in m.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                        *m += w * v;
                    }
                }
            }
            (0..columns)
                .map(|column| {
                    let mut m = [0.0; 5];
                    for (&w, part) in across.iter().zip(&means[column..]) {
                        for (m, v) in m.iter_mut().zip(part) {
                            *m += w * v;
                        }
                    }
                    let [mean_a, mean_b, square_a, square_b, product] = m;
                    let (variance_a, variance_b) = (square_a - mean_a * mean_a, square_b - mean_b * mean_b);
                    let covariance = product - mean_a * mean_b;
                    (2.0 * mean_a * mean_b + C[0]) * (2.0 * covariance + C[1])
                        / ((mean_a * mean_a + mean_b * mean_b + C[0]) * (variance_a + variance_b + C[1]))
                })
                .sum()
        })
        .collect();
    sums.iter().sum::<f64>() / (rows * columns) as f64
}

/// The Gaussian over at most [`WINDOW`] of `n` pixels, summing to 1.
fn window(n: usize) -> Vec<f64> {
    let n = n.min(WINDOW);
    let middle = (n as f64 - 1.0) / 2.0;
    let weights: Vec<f64> = (0..n).map(|i| (-0.5 * ((i as f64 - middle) / SIGMA).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}
