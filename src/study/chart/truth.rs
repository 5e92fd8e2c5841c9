//! What is true at the pixels of a [`Sample`], by the `reference` integrator, and the file that keeps it.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::sample::Sample;
use crate::render::reference::{Radiance, Reference};
use crate::render::{Progress, opaque};
use crate::scene::{Scene, StereoMode, View};
use crate::study::inconsistency::Place;

/// The true rays of a scene's views.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// For each view pixels, ascending, with what they show: those of the sample, in the left view also those that show the
    /// same points as the right view's.
    views: Vec<Vec<(u32, Radiance)>>,
    /// As [`Self::disparity`]; empty where there is none.
    disparity: Vec<f64>,
}

/// Header of the file.
const HEADER: &str = "view,pixel,r,g,b,transmittance,error,disparity";

impl Truth {
    /// Computes it on the current threads. The camera must have one sample for each pixel.
    pub fn new(scene: &Scene, sample: &Sample, progress: &dyn Progress) -> Self {
        let views = scene.views();
        let layers: Vec<_> = views.iter().map(|view| opaque::draw(scene, view)).collect();
        let references: Vec<Reference> =
            views.iter().zip(&layers).map(|(view, layer)| Reference::new(scene, view, layer.as_ref())).collect();
        let parallel = scene.stereo.as_ref().is_some_and(|stereo| stereo.mode == StereoMode::Parallel);
        // The left view's further pixels are about twice as many as the sample's.
        let count = sample.pixels.len() as u64;
        let total = match (parallel, sample.is_whole()) {
            (false, _) => count * views.len() as u64,
            (true, true) => 3 * count,
            (true, false) => 5 * count,
        };
        let done = AtomicU64::new(0);
        let tell = || {
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(64) {
                progress.update(done.min(total), total);
            }
        };
        let mut disparity = Vec::new();
        if let ([left, right], true) = (&views[..], parallel) {
            let apart = left.eye_from_point(right.position);
            let pixels = sample.pixels.par_iter();
            disparity = pixels
                .map(|&pixel| {
                    let [x, y] = centre(pixel, right);
                    let depth = references[1].mean_depth(x, y);
                    tell();
                    let seen = left.project(depth * right.direction(x, y) + apart).x;
                    if depth.is_finite() { seen - x } else { f64::NAN }
                })
                .collect();
        }
        let extra = partners(sample, &disparity);
        let views = views.iter().enumerate().map(|(number, view)| {
            let mut pixels: BTreeSet<u32> = sample.pixels.iter().copied().collect();
            if number == 0 {
                pixels.extend(&extra);
            }
            let pixels: Vec<u32> = pixels.into_iter().collect();
            let rays = pixels.par_iter().map(|&pixel| {
                let [x, y] = centre(pixel, view);
                let radiance = references[number].radiance(x, y);
                tell();
                (pixel, radiance)
            });
            rays.collect()
        });
        Self { views: views.collect(), disparity }
    }

    /// What a view shows at a pixel; `None` where it was not asked.
    pub fn ray(&self, view: usize, pixel: u32) -> Option<&Radiance> {
        let rays = &self.views[view];
        rays.binary_search_by_key(&pixel, |ray| ray.0).ok().map(|i| &rays[i].1)
    }

    /// For each pixel of the sample how many pixels to its right in the right view the left view shows the same point; NaN
    /// where it shows the background alone. Absent without two views with parallel axes.
    pub fn disparity(&self) -> Option<&[f64]> {
        (!self.disparity.is_empty()).then_some(&self.disparity)
    }

    /// Largest bound of the error of any ray.
    pub fn error(&self) -> f64 {
        self.views.iter().flatten().map(|(_, ray)| ray.error).fold(0.0, f64::max)
    }

    /// CSV with the shortest digits that read back exactly: view, pixel, colour, transmittance, bound of the error, and for
    /// the right view's pixels the disparity.
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for (number, rays) in self.views.iter().enumerate() {
            for (i, (pixel, ray)) in rays.iter().enumerate() {
                let ([r, g, b], t, e) = (ray.color, ray.transmittance, ray.error);
                let _ = write!(text, "{number},{pixel},{r:e},{g:e},{b:e},{t:e},{e:e},");
                if number == 1 && !self.disparity.is_empty() {
                    let _ = write!(text, "{:e}", self.disparity[i]);
                }
                text.push('\n');
            }
        }
        text
    }

    /// Reads what [`Self::to_csv`] wrote for this sample and so many views; `None` for anything else.
    pub fn from_csv(text: &str, sample: &Sample, views: usize) -> Option<Self> {
        let mut lines = text.strip_prefix(HEADER)?.strip_prefix('\n')?.strip_suffix('\n')?.split('\n');
        let mut truth = Self { views: vec![Vec::new(); views], disparity: Vec::new() };
        lines.try_for_each(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            let [view, pixel, numbers @ .., disparity] = &cells[..] else { return None };
            let numbers: Vec<f64> = numbers.iter().map(|cell| cell.parse().ok()).collect::<Option<_>>()?;
            let [r, g, b, transmittance, error] = numbers[..] else { return None };
            let view = truth.views.get_mut(view.parse::<usize>().ok()?)?;
            view.push((pixel.parse().ok()?, Radiance { color: [r, g, b], transmittance, error }));
            if !disparity.is_empty() {
                truth.disparity.push(disparity.parse().ok()?);
            }
            Some(())
        })?;
        // The pixels have to be those of the sample and their partners, no more and no less.
        let known = truth.disparity.is_empty() || truth.disparity.len() == sample.pixels.len();
        let extra = if known { partners(sample, &truth.disparity) } else { return None };
        let fits = truth.views.iter().enumerate().all(|(number, rays)| {
            let mut pixels: BTreeSet<u32> = sample.pixels.iter().copied().collect();
            if number == 0 {
                pixels.extend(&extra);
            }
            rays.iter().map(|ray| ray.0).eq(pixels)
        });
        fits.then_some(truth)
    }
}

/// The pixels of the left view that show what the sample's pixels of the right view show.
fn partners(sample: &Sample, disparity: &[f64]) -> BTreeSet<u32> {
    let width = sample.size[0] as usize;
    let mut found = BTreeSet::new();
    for (&pixel, &d) in sample.pixels.iter().zip(disparity) {
        let column = pixel as usize % width;
        if let Some(place) = Place::new(column, d, width) {
            // Asked for an error that is the pixel itself, it tells which it asks.
            place.between(|other| {
                found.insert((pixel as usize - column + other) as u32);
                0.0
            });
        }
    }
    found
}

/// Picture coordinates of a pixel's centre.
fn centre(pixel: u32, view: &View) -> [f64; 2] {
    let width = view.size[0];
    [f64::from(pixel % width) + 0.5, f64::from(pixel / width) + 0.5]
}
