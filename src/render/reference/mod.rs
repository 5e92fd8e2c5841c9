//! `reference`: the truth by adaptive quadrature in f64, with a bound of the error of every pixel.
//!
//! Along a ray the extinction is sigma = sum of tau_i k_i, the emission j = sum of tau_i k_i c_i, and what is seen is
//! L = integral of j exp(-s) + T x background, s the optical depth from the near plane and T = exp(-s) at the ray's end. It
//! shares no code with any other method; the kernels' densities and segment integrals, in f64, and the layer of opaque
//! surfaces are the scene's own.
//!
//! # Algorithm
//! - Every ball that the ray meets gives a *chord*, cut at the near plane (a depth) and at the opaque surface. T follows from
//!   the closed segment integrals of all chords, in a compensated sum.
//! - Gas of one colour c from transmittance T_a to T_b shows c (T_a - T_b): exact, nothing to integrate.
//! - Else the ray is cut at both ends of every chord and where a density has a kink (the closest point of `linear` and
//!   `table`, the rows of a table), and a sweep from cut to cut keeps the set of chords around it. When a chord ends, its
//!   whole closed form takes the place of what was summed on the way, so that nothing drifts.
//! - Between two cuts everything is analytic. With S the optical depth and C the mean colour of the gas in between, weighted
//!   by extinction, both from closed forms, L = T_a [C (1 - exp(-S)) + integral of (j - C sigma) exp(-s)]: quadrature has
//!   to resolve nothing but the variation of colour. The last integral is taken by ten Gauss-Legendre nodes, s at the nodes
//!   from the polynomial through sigma there, and the interval is halved until its error is below its share of [`TARGET`],
//!   given out by absorption and by length. A panel may span an optical depth of 3, so that no decay hides between nodes.
//! - Where what is left of the transmittance can change nothing any more, the sweep stops.
//!
//! # Error
//! The bound is a sum of
//! - quadrature: from the two highest Legendre coefficients (degrees 8 and 9) of the integrand and of sigma, to the power of
//!   3/2, for an error that falls as the interval's 20th power; and in full the differences between the rule's and the closed
//!   optical depth and light. Never more than the spread of the colours times what the interval absorbs;
//! - rounding: 16 ulp of the distance from the eye for where a ball stands, through the steepness of its kernel (with a
//!   constant ball that the ray grazes that is much), 16 ulp of each optical depth, times the transmittance in front;
//! - in a film, rounding to f32, and that of the average over samples.
//!
//! The eyes' positions, directions and the opaque layer are taken as exact.
//!
//! # Disparity
//! If asked, the mean depth of each ray, weighted with -dT, gives the point that a sample shows, and that point's projection
//! by the other eye how far apart the two pictures of it are. Axes must be parallel: a vertical part is not kept.
//!
//! # Cost
//! A hierarchy of spheres finds the balls of a tile. A ray of one colour costs a segment integral per ball; else each pair
//! of cuts costs at least ten densities for each ball around. Disparity costs as much again.

mod integrator;
mod medium;
mod rule;
mod tree;

use super::opaque::OpaqueLayer;
use super::{Frame, Progress, Renderer, Statistics};
use crate::error::{Error, Result};
use crate::picture::{Disparity, Film, Plane, Side};
use crate::scene::{Rgb, Scene, StereoMode, View};
use glam::DVec3;
use integrator::{Integrator, Ray};
use medium::Medium;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tree::{Ball, Cone, Tree};

/// Absolute error that quadrature aims at, relative to the range of the scene's colours with black: far below what f32 and
/// every method can tell, and far enough above the rounding of f64 for 10^4 terms.
pub const TARGET: f64 = 1e-10;

/// Width and height of a tile, whose rays share a list of balls.
const TILE: [usize; 2] = [8, 4];

/// What is asked of the method beside the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Whether films get a [`Disparity`].
    pub disparity: bool,
}

impl Parameters {
    /// The picture and its error alone.
    pub const DEFAULT: Self = Self { disparity: false };

    /// Bytes of each sample of a film beside colour and transmittance: the error and, if asked, the disparity.
    pub(super) fn sample_bytes(self) -> usize {
        if self.disparity { 8 } else { 4 }
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What a ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radiance {
    /// Linear-light red, green and blue, background included.
    pub color: [f64; 3],
    /// Transmittance to the background, in [0, 1]; 0 where an opaque surface stops the ray.
    pub transmittance: f64,
    /// Bound of the absolute error of each of these four.
    pub error: f64,
}

/// The truth as one view sees it, ray by ray.
pub struct Reference<'a> {
    view: &'a View,
    opaque: Option<&'a OpaqueLayer>,
    background: Rgb,
    media: Vec<Medium<'a>>,
    tree: Tree,
    /// Range of all colours and black.
    range: f64,
}

impl<'a> Reference<'a> {
    /// Arranges the particles of a scene before a view; `opaque` is the view's layer, absent without meshes.
    pub fn new(scene: &'a Scene, view: &'a View, opaque: Option<&'a OpaqueLayer>) -> Self {
        let media: Vec<Medium> = scene.particles.iter().map(|set| Medium::new(&set.kernel)).collect();
        let mut balls = Vec::with_capacity(scene.particle_count());
        let mut range = [0.0f64; 2];
        let mut include = |color: Rgb| {
            for value in color.map(f64::from) {
                range = [range[0].min(value), range[1].max(value)];
            }
        };
        include(scene.background);
        for (number, (set, medium)) in scene.particles.iter().zip(&media).enumerate() {
            for i in 0..set.len() {
                let depth = -(-set.opacity.get(i)).ln_1p();
                if depth > 0.0 {
                    let center = view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
                    let color = set.color.get(i);
                    include(color);
                    let strength = depth / medium.centre;
                    balls.push(Ball { center, radius: set.radius.get(i), strength, color, set: number as u32 });
                }
            }
        }
        if let Some(layer) = opaque {
            layer.color.iter().zip(&layer.depth).filter(|(_, depth)| depth.is_finite()).for_each(|(c, _)| include(*c));
        }
        let range = range[1] - range[0];
        Self { view, opaque, background: scene.background, media, tree: Tree::new(balls), range }
    }

    /// What the ray through picture coordinates `x`, `y` sees (in samples, y down, within the picture). The opaque surface is
    /// that of the sample the point lies in.
    pub fn radiance(&self, x: f64, y: f64) -> Radiance {
        let (ray, balls) = self.aim(x, y);
        close(&ray, Integrator::new(&self.media).radiance(&balls, &ray))
    }

    /// Mean depth of what the ray through `x`, `y` sees: the integral of depth x (-dT) over 1 - T, an opaque surface
    /// included with the transmittance up to it, to about 1e-8 of the gas' extent. Infinite where the ray sees nothing but
    /// the background.
    pub fn mean_depth(&self, x: f64, y: f64) -> f64 {
        let (ray, balls) = self.aim(x, y);
        Integrator::new(&self.media).mean_depth(&balls, &ray)
    }

    fn aim(&self, x: f64, y: f64) -> (Ray, Vec<Ball>) {
        let ray = self.ray(x, y);
        let mut balls = Vec::new();
        self.tree.collect(&Cone::around(&[ray.direction]), &mut balls);
        (ray, balls)
    }

    fn ray(&self, x: f64, y: f64) -> Ray {
        let mut ray = Ray {
            direction: self.view.direction(x, y),
            depths: [self.view.near, f64::INFINITY],
            end: self.background,
            range: self.range,
        };
        if let Some(layer) = self.opaque {
            let [width, height] = self.view.size.map(|n| n as usize);
            // The casts saturate at 0.
            let sample = (y as usize).min(height - 1) * width + (x as usize).min(width - 1);
            let depth = layer.depth[sample];
            if depth.is_finite() {
                (ray.depths[1], ray.end) = (depth, layer.color[sample]);
            }
        }
        ray
    }
}

/// No background is seen through an opaque surface.
fn close(ray: &Ray, radiance: Radiance) -> Radiance {
    if ray.depths[1].is_finite() { Radiance { transmittance: 0.0, ..radiance } } else { radiance }
}

/// The method: a [`Reference`] for every pixel.
pub struct Quadrature(pub Parameters);

impl Renderer for Quadrature {
    fn supports(&self, scene: &Scene) -> Result<()> {
        // Gas of every kernel, opaque meshes and a background are all that a scene can hold so far.
        if !self.0.disparity {
            return Ok(());
        }
        let reason = match scene.stereo.as_ref().map(|stereo| stereo.mode) {
            Some(StereoMode::Parallel) => return Ok(()),
            Some(StereoMode::ToeIn) => {
                "stereo.mode \"toe-in\" has vertical disparity too, which is not kept; allowed: stereo.mode \"parallel\""
            }
            None => "a scene without [stereo] has no other eye; allowed: a [stereo] section",
        };
        Err(Error::Usage(format!("method `reference`: disparity = true: {reason}; or disparity = false")))
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        let mut statistics = Statistics::default();
        let samples: u64 = frame.views.iter().map(|view| u64::from(view.size[0]) * u64::from(view.size[1])).sum();
        let total = if self.0.disparity { 2 * samples } else { samples };
        let done = AtomicU64::new(0);
        let tell = |samples: u64| progress.update(done.fetch_add(samples, Ordering::Relaxed) + samples, total);
        let (mut prepare, mut rays, mut depths) = (Duration::ZERO, Duration::ZERO, Duration::ZERO);
        for (number, (opaque, film)) in frame.opaque.iter().zip(&mut *frame.films).enumerate() {
            let view = &frame.views[number];
            let start = Instant::now();
            let reference = Reference::new(frame.scene, view, opaque.as_ref());
            let prepared = Instant::now();
            statistics.fragments += reference.draw(film, &tell);
            statistics.prepared += reference.tree.len() as u64;
            let drawn = Instant::now();
            if self.0.disparity
                && let Some((&side, other)) = Side::ALL.get(number).zip(frame.views.iter().rev().nth(number))
            {
                reference.draw_disparity(film, side, other, &tell);
            }
            prepare += prepared - start;
            rays += drawn - prepared;
            depths += drawn.elapsed();
        }
        statistics.stages = vec![("prepare", prepare), ("rays", rays)];
        if self.0.disparity {
            statistics.stages.push(("disparity", depths));
        }
        statistics
    }
}

impl Reference<'_> {
    /// Draws every sample into the film, of the view's size; gives the number of chords. `tell` is told of finished samples.
    fn draw(&self, film: &mut Film, tell: &(impl Fn(u64) + Sync)) -> u64 {
        let band = film.size[0] as usize * TILE[1];
        let [red, green, blue] = film.color.each_mut();
        let error = film.error.get_or_insert_with(|| Plane::new(red.len()));
        debug_assert_eq!(error.len(), red.len(), "a film's planes are as large as the film");
        let planes = red.par_chunks_mut(band).zip(green.par_chunks_mut(band)).zip(blue.par_chunks_mut(band));
        let planes = planes.zip(film.transmittance.par_chunks_mut(band)).zip(error.par_chunks_mut(band));
        planes
            .enumerate()
            .map(|(band, ((((red, green), blue), transmittance), error))| {
                let mut integrator = Integrator::new(&self.media);
                let mut chords = 0;
                self.each_ray(band, |i, ray, balls, _| {
                    let radiance = close(ray, integrator.radiance(balls, ray));
                    chords += integrator.chords() as u64;
                    let values = [radiance.color[0], radiance.color[1], radiance.color[2], radiance.transmittance];
                    [red[i], green[i], blue[i], transmittance[i]] = values.map(|value| value as f32);
                    let stored = [red[i], green[i], blue[i], transmittance[i]];
                    let cast = values.iter().zip(stored).map(|(a, b)| (a - f64::from(b)).abs());
                    error[i] = above(cast.fold(0.0, f64::max) + radiance.error);
                });
                tell(error.len() as u64);
                chords
            })
            .sum()
    }

    /// Writes the disparity to the view of the `other` eye, whose axes are parallel, into the film, in samples.
    fn draw_disparity(&self, film: &mut Film, side: Side, other: &View, tell: &(impl Fn(u64) + Sync)) {
        // Memory of the frame before.
        let mut plane =
            film.disparity.take().map_or_else(|| Plane::new(film.transmittance.len()), |disparity| disparity.x);
        // Between the eyes, so that a scene far from the world's origin loses no digits.
        let apart = other.eye_from_point(self.view.position);
        plane.par_chunks_mut(film.size[0] as usize * TILE[1]).enumerate().for_each(|(band, plane)| {
            let mut integrator = Integrator::new(&self.media);
            self.each_ray(band, |i, ray, balls, x| {
                let depth = integrator.mean_depth(balls, ray);
                let seen = other.project(depth * ray.direction + apart).x;
                plane[i] = if depth.is_finite() { (seen - x) as f32 } else { f32::NAN };
            });
            tell(plane.len() as u64);
        });
        film.disparity = Some(Disparity { side, x: plane });
    }

    /// Calls `each` for every sample of a band, [`TILE`]'s height of rows of the picture: with its place in the band, its ray,
    /// the balls that the ray may meet and the x of the sample's centre.
    fn each_ray(&self, band: usize, mut each: impl FnMut(usize, &Ray, &[Ball], f64)) {
        let [width, height] = self.view.size.map(|n| n as usize);
        let rows = band * TILE[1]..((band + 1) * TILE[1]).min(height);
        let mut balls = Vec::new();
        for left in (0..width).step_by(TILE[0]) {
            let columns = left..(left + TILE[0]).min(width);
            let corner = |x: usize, y: usize| self.view.direction(x as f64, y as f64);
            let corners = [
                corner(columns.start, rows.start),
                corner(columns.end, rows.start),
                corner(columns.start, rows.end),
                corner(columns.end, rows.end),
            ];
            self.tree.collect(&Cone::around(&corners), &mut balls);
            for row in rows.clone() {
                for column in columns.clone() {
                    let x = column as f64 + 0.5;
                    let ray = self.ray(x, row as f64 + 0.5);
                    each((row - rows.start) * width + column, &ray, &balls, x);
                }
            }
        }
    }
}

/// The nearest f32 that is not less.
fn above(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}
