//! Slabs of depth that hold optical depth: the engine of method `slab` and, with planes of each block's own, of `auto`.
//!
//! Planes of constant depth cut the gas into slabs. A block of pixels goes through the particles that touch it in the order
//! of the first slab that each reaches, nearest first (a counting sort; within a slab by index), and adds to every slab the
//! optical depth of the ray's segment in it, and that times the colour. Slabs that no later particle reaches are composited
//! at once, so that only those in use stay in the cache, and a block whose transmittance is nothing ends.
//!
//! Where the particles of a tile have few colours, a slab holds the optical depth of each colour instead, one number per
//! fragment and slab in place of four; where they have one, there is nothing to keep apart and one slab is exact.
//!
//! | file | does |
//! |---|---|
//! | `block.rs` | blocks of rays: which particles they meet, and what the film gets |
//! | `fragment.rs` | the optical depth of one particle in the slabs before a block |
//! | `composite.rs` | what slabs hold, and how equidistant ones are composited |
//! | `local.rs` | planes of depth for one block, where colours overlap |
//! | `light.rs` | how a block's own slabs are composited |

mod block;
mod composite;
mod fragment;
mod light;
mod local;

use self::block::{BandJob, Picture, bands};
use super::engine;
use super::lists::bin_bands;
use super::primitive::{self, Shape, Shell};
use super::simd::{Level, dispatch};
use super::splat::{Bounds, Lens};
use super::tile::TILE;
use crate::picture::{Film, Plane};
use crate::render::opaque::OpaqueLayer;
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Attribute, Kernel, ParticleSet, Rgb, Scene, View, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::LN_2;
use std::time::{Duration, Instant};

/// Rows of a block: many, because each particle costs a block something whatever its rows. (With 4, a frame takes 15 % longer
/// at 16 lanes and 25 % at 8.)
pub const ROWS: usize = 8;

/// How the gas is cut.
#[derive(Clone, Copy, Debug)]
pub enum Cut {
    /// By planes at the same distance from each other, from the nearest to the farthest gas.
    Equidistant {
        /// Number of slabs, 1 to 2^15.
        slabs: u32,
        /// Whether the picture is the extrapolation (4 L_K - L_K/2) / 3.
        richardson: bool,
    },
    /// By planes of each block's own, where different colours overlap (`local.rs`).
    Local,
}

/// Slabs of equal thickness by whose number balls are brought into the order of depth where each block has its own planes.
const BINS: u32 = 1024;

/// Depths at which a particle begins and ends behind the near plane, seen along the axis of a view; `None` before it.
#[inline]
pub fn reach(view: &View, point: DVec3, radius: f64) -> Option<[f64; 2]> {
    let depth = -view.eye_from_world.row(2).dot(point - view.position);
    (depth + radius > view.near).then_some([(depth - radius).max(view.near), depth + radius])
}

/// The nearest and the farthest depth of gas behind the near plane of a view; nothing without any. All of the gas counts,
/// seen or not: planes that depended on what is seen would jump when a particle leaves the picture.
pub fn extent(scene: &Scene, view: &View) -> Option<[f64; 2]> {
    let mut extent: Option<[f64; 2]> = None;
    for set in &scene.particles {
        for i in 0..set.len() {
            let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
            if set.opacity.get(i) > 0.0
                && let Some([near, far]) = reach(view, point, set.radius.get(i))
            {
                let [first, last] = extent.unwrap_or([near, far]);
                extent = Some([first.min(near), last.max(far)]);
            }
        }
    }
    extent
}

/// Equidistant planes of depth.
#[derive(Clone, Copy)]
struct Planes {
    /// Depth of the first plane, and the distance of the planes.
    first: f64,
    step: f64,
    slabs: usize,
}

impl Planes {
    fn new([near, far]: [f64; 2], slabs: u32) -> Self {
        Self { first: near, step: (far - near) / f64::from(slabs), slabs: slabs as usize }
    }

    /// Depth of the plane behind a slab.
    fn behind(&self, slab: usize) -> f64 {
        self.first + self.step * (slab + 1) as f64
    }

    /// The slab that holds a depth.
    fn slab(&self, depth: f64) -> usize {
        // The conversion truncates, and takes care of what is negative or no number.
        (((depth - self.first) / self.step) as usize).min(self.slabs - 1)
    }
}

/// A particle of one view.
#[derive(Clone, Copy, Default)]
struct Ball {
    /// Eye-space centre over radius.
    center: DVec3,
    /// Depth of the centre in two parts.
    depth: [f32; 2],
    inverse_radius: f32,
    /// Depth of the near plane from the centre, in radii.
    near: f32,
    /// Least and greatest depth.
    depths: [f32; 2],
    /// Depth of the plane behind the first slab from the centre, and the distance of the planes, in radii.
    plane: f32,
    step: f32,
    /// First and last slab.
    slabs: [u16; 2],
    /// Optical depth in powers of two per unit of the kernel's integral.
    amplitude: f32,
    /// Bound of the optical depth of any line through it.
    peak: f32,
    /// How wide its density is, against that of a Gaussian, in radii: at most 1.
    width: f32,
    color: Rgb,
    shape: Shape,
}

impl Ball {
    /// The planes between two depths from the centre, in radii: how many of `count` are before them, and how many before or
    /// between.
    #[inline(always)]
    fn span(&self, [low, high]: [f32; 2], count: usize) -> [usize; 2] {
        // Planes before the rays reach the ball, and behind it, part nothing.
        let low = low.max(self.near).min(high);
        let [low, high] = [low, high].map(|z| (z - self.plane) / self.step);
        // Conversions truncate, and make 0 of what is negative.
        let skipped = (low as usize + usize::from(low > 0.0)).min(count);
        [skipped, (high as usize + usize::from(high > 0.0)).clamp(skipped, count)]
    }
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw(cut: Cut, frame: Frame, progress: &dyn Progress) -> Statistics {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let gas = Gas::new(scene, cut, options.faintest, options.tolerance as f32, engine::colors(scene).range);
    let mut work = Work::default();
    let prepare = start.elapsed();
    let [mut order, mut transform] = [Duration::ZERO; 2];
    let shared = stereo::share_depth(views);
    let mut ordered = Ordered::default();
    for (v, view) in views.iter().enumerate() {
        let start = Instant::now();
        if v == 0 || !shared {
            ordered = gas.order(view);
        }
        order += start.elapsed();
        let film = &mut films[v];
        film.error = options.error_map.then(|| Plane::new(film.transmittance.len()));
        let canvas = Canvas { film, opaque: opaque[v].as_ref(), band: TILE, mask: None, bare: false, error: 0.0 };
        let start = Instant::now();
        let prepared = gas.prepare(view, &ordered);
        transform += start.elapsed();
        work.add(&gas.draw(view, &prepared, canvas, options.level));
        progress.update(v as u64 + 1, views.len() as u64);
    }
    Statistics {
        stages: vec![
            ("prepare", prepare),
            ("order", order),
            ("transform", transform),
            ("bin", work.bin),
            ("raster", work.raster),
        ],
        fragments: work.fragments,
        prepared: work.prepared,
        ..Statistics::default()
    }
}

/// What a view is drawn on.
pub struct Canvas<'a> {
    /// Of the view's size. Its plane of errors, if there is one, is filled.
    pub film: &'a mut Film,
    /// Opaque surfaces of the view.
    pub opaque: Option<&'a OpaqueLayer>,
    /// Rows of a band, which is what a task does: a multiple of [`ROWS`].
    pub band: usize,
    /// Which pixels are drawn; without it all are.
    pub mask: Option<&'a Mask>,
    /// Whether there is nothing behind the gas: the colours are its own light alone.
    pub bare: bool,
    /// With [`Cut::Local`], what a channel may be off by each block's slabs, by their estimate.
    pub error: f32,
}

/// Which blocks of [`Mask::BLOCK`] pixels of a picture are drawn.
pub struct Mask {
    columns: usize,
    blocks: Vec<bool>,
}

impl Mask {
    /// Width and height of a block in pixels.
    pub const BLOCK: [usize; 2] = [16, ROWS];

    /// Nothing of a picture of that size.
    pub fn new(size: [usize; 2]) -> Self {
        let [columns, rows] = [0, 1].map(|axis| size[axis].div_ceil(Self::BLOCK[axis]));
        Self { columns, blocks: vec![false; columns * rows] }
    }

    /// Adds the blocks of the pixels from `first` to `last`, both included.
    pub fn add(&mut self, first: [usize; 2], last: [usize; 2]) {
        let [x, y] = [0, 1].map(|axis| [first[axis] / Self::BLOCK[axis], last[axis] / Self::BLOCK[axis]]);
        for row in y[0]..=y[1] {
            self.blocks[row * self.columns + x[0]..=row * self.columns + x[1]].fill(true);
        }
    }

    /// Whether the block of a pixel is drawn.
    fn get(&self, x: usize, y: usize) -> bool {
        self.blocks[y / Self::BLOCK[1] * self.columns + x / Self::BLOCK[0]]
    }
}

/// What drawing took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Wall time for listing them by bands.
    pub bin: Duration,
    /// Wall time for the pixels.
    pub raster: Duration,
    /// Fragments computed.
    pub fragments: u64,
    /// Particles prepared that the view may show.
    pub prepared: u64,
    /// The largest error that blocks' own slabs leave, by their estimate.
    pub error: f32,
}

impl Work {
    /// Adds another's.
    pub fn add(&mut self, other: &Self) {
        self.bin += other.bin;
        self.raster += other.raster;
        self.fragments += other.fragments;
        self.prepared += other.prepared;
        self.error = self.error.max(other.error);
    }
}

/// The gas of a scene, cut: what is the same for all views.
pub struct Gas<'a> {
    scene: &'a Scene,
    cut: Cut,
    /// Opacity up to which particles are left out.
    faintest: f64,
    shells: Vec<Shell>,
    /// One per set.
    shapes: Vec<Shape>,
    /// The kernels' integrals through the centre, one per set, and the amplitudes of sets whose particles have the same.
    centres: Vec<f64>,
    amplitudes: Vec<Option<f32>>,
    /// Bounds of optical depths over amplitudes, and widths, one per set.
    peaks: Vec<f32>,
    widths: Vec<f32>,
    range: [[f32; 2]; 3],
    tolerance: f32,
    quick: bool,
}

/// Optical depth in powers of two per unit of a kernel's integral, which is `centre` through its centre.
pub fn amplitude(opacity: f64, centre: f64) -> f32 {
    (-(-opacity).ln_1p() * std::f64::consts::LOG2_E / centre) as f32
}

/// How wide a density is along a radius, against a Gaussian's: its integral over its maximum; at most 1.
pub fn width(kernel: &Kernel) -> f32 {
    match kernel {
        Kernel::Gaussian | Kernel::Beliaev | Kernel::Constant | Kernel::Linear | Kernel::Poly => 1.0,
        Kernel::Table(profile) => {
            let (q, densities) = (profile.q(), profile.densities());
            let most = densities.iter().copied().fold(0.0, f64::max);
            let areas = q.windows(2).zip(densities.windows(2)).map(|(q, d)| 0.5 * (q[1] - q[0]) * (d[0] + d[1]));
            // A Gaussian's is 0.42.
            (areas.sum::<f64>() / most.max(f64::MIN_POSITIVE) / 0.42).clamp(0.02, 1.0) as f32
        }
    }
}

/// The particles behind the near plane in the order in which blocks go through them.
#[derive(Default)]
pub struct Ordered {
    /// Set and place in the set.
    places: Vec<(u32, u32)>,
    planes: Option<Planes>,
}

impl<'a> Gas<'a> {
    /// Cuts the gas, but for particles of an opacity up to `faintest`; `tolerance` is what may be lost by ending early, absolute
    /// per channel, `range` the least and the greatest of what is seen.
    pub fn new(scene: &'a Scene, cut: Cut, faintest: f64, tolerance: f32, range: [[f32; 2]; 3]) -> Self {
        let mut shells = Vec::new();
        let shapes = scene.particles.iter().map(|set| Shape::new(&set.kernel, &mut shells)).collect();
        // What is left of the colours counts up to 5/3 of itself in the extrapolation.
        let tolerance = tolerance * if let Cut::Equidistant { richardson: false, .. } = cut { 1.0 } else { 0.6 };
        let centres: Vec<f64> = scene.particles.iter().map(|set| primitive::centre(&set.kernel)).collect();
        let amplitudes = scene.particles.iter().zip(&centres).map(|(set, &centre)| match &set.opacity {
            Attribute::Uniform(opacity) => Some(amplitude(*opacity, centre)),
            Attribute::Each(_) => None,
        });
        let amplitudes = amplitudes.collect();
        let peak = |(set, &centre): (&ParticleSet, &f64)| (centre * LN_2 * set.kernel.excess()) as f32;
        let peaks = scene.particles.iter().zip(&centres).map(peak).collect();
        let widths = scene.particles.iter().map(|set| width(&set.kernel)).collect();
        let quick = false;
        Self { scene, cut, faintest, shells, shapes, centres, amplitudes, peaks, widths, range, tolerance, quick }
    }

    /// With Gaussians of one colour in one slab off by up to [`super::footprint::QUICK`] of the optical depth, if that is quicker.
    pub fn quick(self, quick: bool) -> Self {
        Self { quick, ..self }
    }

    /// Whether Gaussians of one colour may be off by that.
    pub fn is_quick(&self) -> bool {
        self.quick
    }

    /// Draws a view.
    pub fn draw(&self, view: &View, prepared: &Prepared, canvas: Canvas, level: Level) -> Work {
        let Canvas { film, opaque, band, mask, bare, error } = canvas;
        let Prepared { balls, bounds, planes } = prepared;
        let start = Instant::now();
        let mut lists = vec![Vec::new(); (view.size[1] as usize).div_ceil(band)];
        bin_bands(&[bounds], 0..bounds.len(), band, &mut lists);
        let bin = start.elapsed();
        let prepared = bounds.iter().filter(|bounds| !bounds.is_empty()).count() as u64;
        let start = Instant::now();
        let background = if bare { [0.0; 3] } else { self.scene.background };
        let picture = Picture { gas: self, view, opaque, balls, bounds, planes, mask, background, error };
        let (fragments, error) = bands(film, band)
            .into_par_iter()
            .zip(&lists)
            .map(|(band, list)| dispatch(level, BandJob { picture: &picture, list, band }))
            .reduce(|| (0, 0.0), |a, b| (a.0 + b.0, a.1.max(b.1)));
        Work { bin, raster: start.elapsed(), fragments, prepared, error }
    }

    /// The kernel of a set, and what its shells are of.
    pub fn kernel(&self, set: usize) -> (Shape, &[Shell]) {
        (self.shapes[set], &self.shells)
    }

    /// Opacity up to which particles are left out.
    pub fn faintest(&self) -> f64 {
        self.faintest
    }

    /// Optical depth in powers of two, per unit of the kernel's integral, of a particle of a set that has that opacity.
    pub fn amplitude(&self, set: usize, opacity: f64) -> f32 {
        self.amplitudes[set].unwrap_or_else(|| amplitude(opacity, self.centres[set]))
    }

    /// The order of a view: a counting sort by the first slab; within a slab by index.
    pub fn order(&self, view: &View) -> Ordered {
        let Some(extent) = extent(self.scene, view) else {
            return Ordered::default();
        };
        let slabs = match self.cut {
            Cut::Equidistant { slabs, .. } => slabs,
            Cut::Local => BINS,
        };
        let planes = Planes::new(extent, slabs);
        let mut firsts = Vec::with_capacity(self.scene.particle_count());
        for (number, set) in self.scene.particles.iter().enumerate() {
            for i in 0..set.len() {
                let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
                if set.opacity.get(i) > self.faintest
                    && let Some([near, _]) = reach(view, point, set.radius.get(i))
                {
                    firsts.push((planes.slab(near) as u32, (number as u32, i as u32)));
                }
            }
        }
        let mut starts = vec![0; planes.slabs + 1];
        for (first, _) in &firsts {
            starts[*first as usize + 1] += 1;
        }
        for slab in 0..planes.slabs {
            starts[slab + 1] += starts[slab];
        }
        let mut places = vec![(0, 0); firsts.len()];
        for (first, place) in firsts {
            let next = &mut starts[first as usize];
            places[*next] = place;
            *next += 1;
        }
        Ordered { places, planes: Some(planes) }
    }

    /// The particles as a view sees them.
    pub fn prepare(&self, view: &View, ordered: &Ordered) -> Prepared {
        let Some(planes) = ordered.planes else {
            return Prepared { balls: Vec::new(), bounds: Vec::new(), planes: vec![0.0] };
        };
        let lens = Lens::new(view);
        let prepared = ordered.places.par_iter().with_min_len(64).map(|&(number, i)| {
            let (set, i) = (&self.scene.particles[number as usize], i as usize);
            let radius = set.radius.get(i);
            let center = view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
            let depth = -center.z;
            let depths = [depth - radius, depth + radius];
            let bounds = lens.ball_bounds(center, radius);
            let slabs = [planes.slab(depths[0].max(view.near)), planes.slab(depths[1])];
            let behind_first = planes.behind(slabs[0]);
            let amplitude = self.amplitude(number as usize, set.opacity.get(i));
            let ball = Ball {
                center: center / radius,
                depth: [depth as f32, (depth - f64::from(depth as f32)) as f32],
                inverse_radius: (1.0 / radius) as f32,
                near: ((view.near - depth) / radius) as f32,
                depths: depths.map(|depth| depth as f32),
                plane: ((behind_first - depth) / radius) as f32,
                step: (planes.step / radius) as f32,
                slabs: slabs.map(|slab| slab as u16),
                amplitude,
                peak: amplitude * self.peaks[number as usize],
                width: self.widths[number as usize],
                color: set.color.get(i),
                shape: self.shapes[number as usize],
            };
            (ball, bounds)
        });
        let (balls, bounds) = prepared.unzip();
        let planes = match self.cut {
            Cut::Equidistant { .. } => (0..planes.slabs).map(|slab| planes.behind(slab) as f32).collect(),
            Cut::Local => Vec::new(),
        };
        Prepared { balls, bounds, planes }
    }
}

/// The particles of a view in order of the first slab, and the pixels they may cover.
pub struct Prepared {
    balls: Vec<Ball>,
    bounds: Vec<Bounds>,
    /// Depth of the plane behind each slab; none where each block has its own.
    planes: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;

    /// A profile that is constant between two distances from the centre, and nothing elsewhere.
    fn shell(from: f64, to: f64) -> Kernel {
        let step = 1e-6;
        Kernel::table(vec![0.0, from, from + step, to - step, to, 1.0], vec![0.0, 0.0, 7.0, 7.0, 0.0, 0.0]).unwrap()
    }

    /// Slabs are as thin as what is narrow in a profile asks for, wherever in the ball that is.
    #[test]
    fn profiles_are_as_wide_as_what_they_hold() {
        let gaussian = 0.5 * Kernel::Gaussian.chord(0.0);
        for (from, to) in [(0.97, 0.995), (0.5, 0.6), (0.1, 0.3), (0.2, 0.55)] {
            let (found, truth) = (f64::from(width(&shell(from, to))), (to - from) / gaussian);
            assert!((found / truth - 1.0).abs() < 0.02, "from {from} to {to}: {found} for {truth}");
        }
        let q: Vec<f64> = (0..=100).map(|i| 0.01 * f64::from(i)).map(|q: f64| q.min(1.0)).collect();
        for kernel in [Kernel::Gaussian, Kernel::Constant] {
            let densities = q.iter().map(|&q| 40.0 * kernel.density(q)).collect();
            let found = width(&Kernel::table(q.clone(), densities).unwrap());
            assert!(found > 0.98 && found <= 1.0, "{kernel:?}: {found}");
        }
        // Never so thin that slabs are without number.
        assert_eq!(width(&shell(0.9, 0.9001)), 0.02);
    }

    #[test]
    fn balls_know_the_width_of_their_profile() {
        let set = |kernel: Kernel, z: f64| ParticleSet {
            kernel,
            x: vec![0.0],
            y: vec![0.0],
            z: vec![z],
            radius: Attribute::Uniform(0.5),
            opacity: Attribute::Uniform(0.3),
            color: Attribute::Uniform([1.0; 3]),
        };
        let camera = Camera::for_tests([8, 8]);
        let particles = vec![set(Kernel::Gaussian, -9.0), set(shell(0.9, 0.95), -6.0), set(shell(0.0001, 0.1), -3.0)];
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles, meshes: Vec::new() };
        let gas = Gas::new(&scene, Cut::Local, 0.0, 1e-3, [[0.0, 1.0]; 3]);
        let view = &scene.views()[0];
        let widths: Vec<f32> = gas.prepare(view, &gas.order(view)).balls.iter().map(|ball| ball.width).collect();
        assert_eq!(widths, [width(&shell(0.0001, 0.1)), width(&shell(0.9, 0.95)), 1.0]);
        assert!(widths[0] < 0.25 && widths[1] < 0.13, "{widths:?}");
    }
}
