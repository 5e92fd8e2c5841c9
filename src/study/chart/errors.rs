//! How wrong the pictures of a method are, at the pixels of a sample.

use super::sample::Sample;
use super::truth::Truth;
use crate::picture::Film;
use crate::study::inconsistency::Place;

/// Errors in linear light, both eyes together. What is not finite counts as an infinite error.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// Root mean square over pixels, eyes and channels.
    pub rmse: f64,
    /// Standard error of `rmse` as an estimate of that of all pixels, from the scatter among the sample's, as if they were
    /// drawn without regard to place, which overstates it; 0 where the sample is every pixel.
    pub rmse_se: f64,
    /// Largest of any channel, eye and pixel of the sample.
    pub max: f64,
    /// What 99 % of the pixels stay within in every channel.
    pub q99: f64,
    /// Largest of the transmittance.
    pub transmittance_max: f64,
    /// Left-right inconsistency; absent without two views with parallel axes, and where no pixel of the right view shows
    /// anything that the left view holds too.
    pub inconsistency: Option<Inconsistency>,
}

/// The right eye's error less the left eye's error at the same place in space ([`crate::study::inconsistency`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inconsistency {
    /// Root mean square over pixels and channels.
    pub rmse: f64,
    /// Largest of any channel.
    pub max: f64,
}

impl Errors {
    /// Measures the films of the views that the truth was computed for.
    pub fn new(films: &[Film], truth: &Truth, sample: &Sample) -> Self {
        let error = |view: usize, pixel: u32, channel: usize| {
            // The truth holds every pixel that is asked for.
            let ray = truth.ray(view, pixel).map_or(f64::NAN, |ray| ray.color[channel]);
            f64::from(films[view].color[channel][pixel as usize]) - ray
        };
        let (mut max, mut transmittance_max) = (0.0_f64, 0.0_f64);
        // Of each pixel the mean square over eyes and channels; of each pixel of each eye the largest of its channels.
        let (mut squares, mut largest) = (Vec::new(), Vec::new());
        for (&pixel, &weight) in sample.pixels.iter().zip(&sample.weights) {
            let mut square = 0.0;
            for (view, film) in films.iter().enumerate() {
                let errors = [0, 1, 2].map(|channel| size(error(view, pixel, channel)));
                let most = errors.into_iter().fold(0.0, f64::max);
                square += errors.iter().map(|error| error * error).sum::<f64>();
                largest.push((most, weight));
                max = max.max(most);
                let truth = truth.ray(view, pixel).map_or(f64::NAN, |ray| ray.transmittance);
                transmittance_max = transmittance_max.max(size(f64::from(film.transmittance[pixel as usize]) - truth));
            }
            squares.push((square / (3 * films.len()) as f64, weight));
        }
        let rmse = mean(&squares).sqrt();
        let inconsistency = truth.disparity().and_then(|disparity| {
            let width = sample.size[0] as usize;
            let (mut squares, mut max) = (Vec::new(), 0.0_f64);
            for ((&pixel, &weight), &d) in sample.pixels.iter().zip(&sample.weights).zip(disparity) {
                let column = pixel as usize % width;
                let Some(place) = Place::new(column, d, width) else { continue };
                let row = pixel as usize - column;
                let errors = [0, 1, 2].map(|channel| {
                    let there = place.between(|column| error(0, (row + column) as u32, channel));
                    size(error(1, pixel, channel) - there)
                });
                squares.push((errors.iter().map(|error| error * error).sum::<f64>() / 3.0, weight));
                max = errors.into_iter().fold(max, f64::max);
            }
            (!squares.is_empty()).then(|| Inconsistency { rmse: mean(&squares).sqrt(), max })
        });
        let rmse_se = if sample.is_whole() { 0.0 } else { standard_error(&squares, rmse, sample) };
        Self { rmse, rmse_se, max, q99: quantile(largest, 0.99), transmittance_max, inconsistency }
    }
}

/// Absolute value; infinity for NaN.
fn size(value: f64) -> f64 {
    if value.is_nan() { f64::INFINITY } else { value.abs() }
}

/// Mean of values with weights.
fn mean(values: &[(f64, f64)]) -> f64 {
    let weights: f64 = values.iter().map(|value| value.1).sum();
    values.iter().map(|(value, weight)| value * weight).sum::<f64>() / weights
}

/// The standard error of the root of a mean of squares, to first order.
fn standard_error(squares: &[(f64, f64)], rmse: f64, sample: &Sample) -> f64 {
    if rmse == 0.0 {
        return 0.0;
    }
    let (n, all) = (squares.len() as f64, sample.all() as f64);
    let scatter: f64 = squares.iter().map(|(value, weight)| (weight * (value - rmse * rmse)).powi(2)).sum();
    // A sample that leaves few pixels out leaves little to chance.
    let variance = scatter / (all * all) * n / (n - 1.0) * (1.0 - n / all);
    let error = variance.sqrt() / (2.0 * rmse);
    if error.is_nan() { f64::INFINITY } else { error }
}

/// The least value that this share of the weight does not exceed.
fn quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let target = share * values.iter().map(|value| value.1).sum::<f64>();
    let mut sum = 0.0;
    let found = values.iter().find(|value| {
        sum += value.1;
        sum >= target
    });
    found.or(values.last()).map_or(0.0, |value| value.0)
}
