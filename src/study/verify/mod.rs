//! Verification: the error of a drawn picture, measured against the reference on a sample of its pixels.
//!
//! What is measured is the film, before anything is packed or encoded. The truth of a pixel is what the reference integrator
//! sees along its ray, with supersampling the mean over the rays of its samples; the layer of opaque surfaces is drawn anew.
//! A sample finds what is wrong in many places or where [`sample`] looks, but not every lone pixel; all pixels do.

pub mod sample;

pub use sample::{Places, Sample, places};

use crate::error::{Error, Result};
use crate::picture::Film;
use crate::render::reference::Reference;
use crate::render::{Progress, opaque};
use crate::scene::{Scene, View};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Verification {
    /// Pixels measured in each view, at least 1.
    pub pixels: u64,
    /// Whether these are all.
    pub all: bool,
    /// The largest error of red, green and blue; of equals the first view's, there the evenly spread ones' first.
    pub largest: Deviation,
    /// The largest error of the transmittance, which no tolerance counts.
    pub transmittance: Deviation,
    /// Root of the mean squared error of red, green and blue, over the evenly spread pixels of all views: an estimate of
    /// that of the whole pictures. Infinite where a value is not finite.
    pub rmse: f64,
    /// What the largest error of the three channels does not exceed at 99 of 100 of the same pixels.
    pub quantile_99: f64,
    /// Absolute error allowed per channel, linear light.
    pub tolerance: f64,
    /// The largest bound of the error of the truth itself at a measured pixel. It is not part of the other figures.
    pub reference_bound: f64,
    /// The largest error that was predicted before drawing; absent where nothing was.
    pub predicted_error: Option<f64>,
    /// Wall time of the measuring.
    pub time: Duration,
}

impl Verification {
    /// Whether no measured pixel is off by more than the tolerance.
    pub fn held(&self) -> bool {
        self.largest.error <= self.tolerance
    }
}

/// A value of a film beside the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Absolute difference, linear light; infinite where the drawn value is not finite.
    pub error: f64,
    /// Index of the view.
    pub view: usize,
    /// Column and row.
    pub pixel: [u32; 2],
    /// 0, 1, 2 for red, green, blue; 3 for transmittance.
    pub channel: usize,
    /// As drawn.
    pub drawn: f64,
    /// As it is.
    pub truth: f64,
}

/// Pixels of one task.
const CHUNK: usize = 32;

/// Measures films, one for each view of the scene, against the reference, and holds the errors against a tolerance (absolute,
/// per channel, linear light). On the threads of the pool it is called from, with the same result on any number of them.
/// [`Error::Usage`] where films and views do not fit.
pub fn verify(
    scene: &Scene,
    views: &[View],
    films: &[Film],
    sample: Sample,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Verification> {
    let start = Instant::now();
    check(scene, views, films)?;
    let places = places(films, sample);
    let pixels = (places.even.len() + places.drawn.len()) as u64;
    let total = pixels * views.len() as u64;
    let done = AtomicU64::new(0);
    let mut whole = Part::default();
    let mut even_errors = Vec::with_capacity(places.even.len() * views.len());
    let mut even_squares = 0.0;
    for (number, (view, film)) in views.iter().zip(films).enumerate() {
        let layer = opaque::draw(scene, view);
        let reference = Reference::new(scene, view, layer.as_ref());
        let measure = |pixels: &[usize]| {
            let mut part = Part::default();
            for &pixel in pixels {
                part.measure(&reference, scene.camera.samples, film, number, pixel);
            }
            let before = done.fetch_add(pixels.len() as u64, Ordering::Relaxed);
            progress.update(before + pixels.len() as u64, total);
            part
        };
        // Collected before they are added up, so that no figure depends on the threads.
        let even: Vec<Part> = places.even.par_chunks(CHUNK).map(measure).collect();
        let drawn: Vec<Part> = places.drawn.par_chunks(CHUNK).map(measure).collect();
        for part in even {
            even_squares += part.squares;
            even_errors.extend_from_slice(&part.errors);
            whole.add(&part);
        }
        drawn.iter().for_each(|part| whole.add(part));
    }
    let (Some(largest), Some(transmittance)) = (whole.largest, whole.transmittance) else {
        return Err(Error::Usage("there is no pixel to verify".into()));
    };
    let count = even_errors.len();
    let rank = (99 * count).div_ceil(100).max(1) - 1;
    let (_, &mut quantile_99, _) = even_errors.select_nth_unstable_by(rank, f64::total_cmp);
    Ok(Verification {
        pixels,
        all: places.drawn.is_empty() && places.even.len() == films[0].transmittance.len(),
        largest,
        transmittance,
        rmse: (even_squares / (3 * count) as f64).sqrt(),
        quantile_99,
        tolerance,
        reference_bound: whole.bound,
        predicted_error: None,
        time: start.elapsed(),
    })
}

/// Whether there is a film of the camera's size for each view.
fn check(scene: &Scene, views: &[View], films: &[Film]) -> Result<()> {
    let [width, height] = scene.camera.size;
    let samples = [width, height].map(|n| n.saturating_mul(scene.camera.samples));
    if views.len() != films.len() || views.iter().any(|view| view.size != samples) {
        return Err(Error::Usage(format!("{} films do not fit the {} views", films.len(), views.len())));
    }
    let pixels = width as usize * height as usize;
    for film in films {
        let planes = film.color.iter().chain([&film.transmittance]).chain(&film.depth);
        if film.size != scene.camera.size || planes.into_iter().any(|plane| plane.len() != pixels) {
            let [w, h] = film.size;
            return Err(Error::Usage(format!("a film of {w} x {h} pixels is not of the camera's {width} x {height}")));
        }
    }
    Ok(())
}

/// What some pixels say.
#[derive(Default)]
struct Part {
    largest: Option<Deviation>,
    transmittance: Option<Deviation>,
    /// Sum of the squared errors of the three colour channels.
    squares: f64,
    /// Largest error of each pixel's three.
    errors: Vec<f64>,
    /// Largest bound of the truth's own error.
    bound: f64,
}

impl Part {
    /// Measures a pixel.
    fn measure(&mut self, reference: &Reference, samples: u32, film: &Film, view: usize, pixel: usize) {
        let width = film.size[0] as usize;
        let place = [(pixel % width) as u32, (pixel / width) as u32];
        let (truth, bound) = truth(reference, samples, place);
        self.bound = self.bound.max(bound);
        let planes = [&film.color[0], &film.color[1], &film.color[2], &film.transmittance];
        let mut error = 0.0f64;
        for (channel, (plane, truth)) in planes.into_iter().zip(truth).enumerate() {
            let drawn = f64::from(plane[pixel]);
            let off = (drawn - truth).abs();
            // What is no number passes no tolerance.
            let off = if off.is_nan() { f64::INFINITY } else { off };
            let deviation = Deviation { error: off, view, pixel: place, channel, drawn, truth };
            if channel < 3 {
                self.squares += off * off;
                error = error.max(off);
                keep(&mut self.largest, deviation);
            } else {
                keep(&mut self.transmittance, deviation);
            }
        }
        self.errors.push(error);
    }

    /// Adds the extremes of another part.
    fn add(&mut self, other: &Self) {
        if let Some(deviation) = other.largest {
            keep(&mut self.largest, deviation);
        }
        if let Some(deviation) = other.transmittance {
            keep(&mut self.transmittance, deviation);
        }
        self.bound = self.bound.max(other.bound);
    }
}

/// Keeps the larger of the two, of equals the one that is there.
fn keep(largest: &mut Option<Deviation>, deviation: Deviation) {
    if largest.is_none_or(|known| deviation.error > known.error) {
        *largest = Some(deviation);
    }
}

/// The true red, green, blue and transmittance of a pixel, the mean over its `samples` x `samples` rays, and a bound of the
/// error of each.
fn truth(reference: &Reference, samples: u32, [column, row]: [u32; 2]) -> ([f64; 4], f64) {
    let (mut sum, mut sizes, mut error) = ([0.0; 4], [0.0; 4], 0.0);
    for y in 0..samples {
        for x in 0..samples {
            let at = |pixel: u32, sample: u32| f64::from(pixel) * f64::from(samples) + f64::from(sample) + 0.5;
            let seen = reference.radiance(at(column, x), at(row, y));
            let [red, green, blue] = seen.color;
            for (i, value) in [red, green, blue, seen.transmittance].into_iter().enumerate() {
                sum[i] += value;
                sizes[i] += value.abs();
            }
            error += seen.error;
        }
    }
    let count = f64::from(samples) * f64::from(samples);
    // Each addition and the division round to half an ulp of no more than the sum of the sizes.
    let rounding = if samples > 1 { sizes.into_iter().fold(0.0, f64::max) * f64::EPSILON } else { 0.0 };
    (sum.map(|sum| sum / count), error / count + rounding)
}
