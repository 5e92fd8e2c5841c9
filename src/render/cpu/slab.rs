//! Slabs of depth that hold optical depth: the engine of method `slab`.
//!
//! Planes of constant depth cut the gas into slabs. A block of pixels goes through the particles that touch it in the order
//! of the first slab that each reaches, nearest first (a counting sort; within a slab by index), and adds to every slab the
//! optical depth of the ray's segment in it, and that times the colour. Slabs that no later particle reaches are composited
//! at once, so that only those in use stay in the cache, and a block whose transmittance is nothing ends.
//!
//! Where the particles of a tile have few colours, a slab holds the optical depth of each colour instead, one number per
//! fragment and slab in place of four; where they have one, there is nothing to keep apart and one slab is exact.

use super::engine;
use super::nearby::{Beam, Hit, Nearby};
use super::primitive::{self, BELIAEV, Constant, GAUSSIAN, Leg, Poly, Primitive, Shape, Shell, Shells, Thick};
use super::simd::{Level, Simd, WithSimd, dispatch, exp2_neg};
use super::splat::{Bounds, Lens};
use super::tile::{self, TILE, bin_bands, stop_transmittance, survey};
use crate::picture::Film;
use crate::render::opaque::OpaqueLayer;
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Attribute, Rgb, Scene, View, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How the gas is cut.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    /// Number of slabs, 1 to 2^15.
    pub slabs: u32,
    /// Whether the picture is the extrapolation (4 L_K - L_K/2) / 3.
    pub richardson: bool,
}

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
    color: Rgb,
    shape: Shape,
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw(cut: Cut, frame: Frame, progress: &dyn Progress) -> Statistics {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let gas = Gas::new(scene, cut, options.tolerance as f32);
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
        film.error = options.error_map.then(|| vec![0.0; film.transmittance.len()]);
        let canvas = Canvas { film, opaque: opaque[v].as_ref(), band: TILE, mask: None, bare: false };
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
}

impl Work {
    /// Adds another's.
    pub fn add(&mut self, other: &Self) {
        self.bin += other.bin;
        self.raster += other.raster;
        self.fragments += other.fragments;
        self.prepared += other.prepared;
    }
}

/// The gas of a scene, cut: what is the same for all views.
pub struct Gas<'a> {
    scene: &'a Scene,
    cut: Cut,
    shells: Vec<Shell>,
    /// One per set.
    shapes: Vec<Shape>,
    /// The kernels' integrals through the centre, one per set, and the amplitudes of sets whose particles have the same.
    centres: Vec<f64>,
    amplitudes: Vec<Option<f32>>,
    range: [[f32; 2]; 3],
    tolerance: f32,
}

/// Optical depth in powers of two per unit of a kernel's integral, which is `centre` through its centre.
pub fn amplitude(opacity: f64, centre: f64) -> f32 {
    (-(-opacity).ln_1p() * std::f64::consts::LOG2_E / centre) as f32
}

/// The particles behind the near plane in the order in which blocks go through them.
#[derive(Default)]
pub struct Ordered {
    /// Set and place in the set.
    places: Vec<(u32, u32)>,
    planes: Option<Planes>,
    slabs: usize,
}

impl<'a> Gas<'a> {
    /// Cuts the gas; `tolerance` is what may be lost by ending early, absolute per channel.
    pub fn new(scene: &'a Scene, cut: Cut, tolerance: f32) -> Self {
        let mut shells = Vec::new();
        let shapes = scene.particles.iter().map(|set| Shape::new(&set.kernel, &mut shells)).collect();
        // What is left of the colours counts up to 5/3 of itself in the extrapolation.
        let tolerance = tolerance * if cut.richardson { 0.6 } else { 1.0 };
        let centres: Vec<f64> = scene.particles.iter().map(|set| primitive::centre(&set.kernel)).collect();
        let amplitudes = scene.particles.iter().zip(&centres).map(|(set, &centre)| match &set.opacity {
            Attribute::Uniform(opacity) => Some(amplitude(*opacity, centre)),
            Attribute::Each(_) => None,
        });
        let amplitudes = amplitudes.collect();
        Self { scene, cut, shells, shapes, centres, amplitudes, range: engine::colors(scene).range, tolerance }
    }

    /// Draws a view.
    pub fn draw(&self, view: &View, prepared: &Prepared, canvas: Canvas, level: Level) -> Work {
        let Canvas { film, opaque, band, mask, bare } = canvas;
        let Prepared { balls, bounds, slabs } = prepared;
        let start = Instant::now();
        let mut lists = vec![Vec::new(); (view.size[1] as usize).div_ceil(band)];
        bin_bands(bounds, band, &mut lists);
        let bin = start.elapsed();
        let prepared = bounds.iter().filter(|bounds| !bounds.is_empty()).count() as u64;
        let start = Instant::now();
        let background = if bare { [0.0; 3] } else { self.scene.background };
        let picture = Picture { gas: self, view, opaque, balls, bounds, slabs: *slabs, mask, background };
        let fragments = AtomicU64::new(0);
        bands(film, band).into_par_iter().zip(&lists).for_each(|(band, list)| {
            let done = dispatch(level, BandJob { picture: &picture, list, band });
            fragments.fetch_add(done, Ordering::Relaxed);
        });
        Work { bin, raster: start.elapsed(), fragments: fragments.into_inner(), prepared }
    }

    /// The kernel of a set, and what its shells are of.
    pub fn kernel(&self, set: usize) -> (Shape, &[Shell]) {
        (self.shapes[set], &self.shells)
    }

    /// Optical depth in powers of two, per unit of the kernel's integral, of a particle of a set that has that opacity.
    pub fn amplitude(&self, set: usize, opacity: f64) -> f32 {
        self.amplitudes[set].unwrap_or_else(|| amplitude(opacity, self.centres[set]))
    }

    /// The order of a view: a counting sort by the first slab; within a slab by index.
    pub fn order(&self, view: &View) -> Ordered {
        let Some(extent) = extent(self.scene, view) else {
            return Ordered { slabs: 1, ..Ordered::default() };
        };
        let planes = Planes::new(extent, self.cut.slabs);
        let mut firsts = Vec::with_capacity(self.scene.particle_count());
        for (number, set) in self.scene.particles.iter().enumerate() {
            for i in 0..set.len() {
                let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
                if set.opacity.get(i) > 0.0
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
        Ordered { places, planes: Some(planes), slabs: planes.slabs }
    }

    /// The particles as a view sees them.
    pub fn prepare(&self, view: &View, ordered: &Ordered) -> Prepared {
        let Some(planes) = ordered.planes else {
            return Prepared { balls: Vec::new(), bounds: Vec::new(), slabs: ordered.slabs };
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
            let behind_first = planes.first + planes.step * (slabs[0] + 1) as f64;
            let ball = Ball {
                center: center / radius,
                depth: [depth as f32, (depth - f64::from(depth as f32)) as f32],
                inverse_radius: (1.0 / radius) as f32,
                near: ((view.near - depth) / radius) as f32,
                depths: depths.map(|depth| depth as f32),
                plane: ((behind_first - depth) / radius) as f32,
                step: (planes.step / radius) as f32,
                slabs: slabs.map(|slab| slab as u16),
                amplitude: self.amplitude(number as usize, set.opacity.get(i)),
                color: set.color.get(i),
                shape: self.shapes[number as usize],
            };
            (ball, bounds)
        });
        let (balls, bounds) = prepared.unzip();
        Prepared { balls, bounds, slabs: ordered.slabs }
    }
}

impl Ordered {
    /// Thickness of a slab; 0 without gas.
    pub fn thickness(&self) -> f64 {
        self.planes.map_or(0.0, |planes| planes.step)
    }
}

/// The particles of a view in order of the first slab, and the pixels they may cover.
pub struct Prepared {
    balls: Vec<Ball>,
    bounds: Vec<Bounds>,
    slabs: usize,
}

/// What is the same for all bands of a view.
struct Picture<'a> {
    gas: &'a Gas<'a>,
    view: &'a View,
    opaque: Option<&'a OpaqueLayer>,
    /// In order of the first slab.
    balls: &'a [Ball],
    bounds: &'a [Bounds],
    slabs: usize,
    mask: Option<&'a Mask>,
    background: Rgb,
}

/// A band of tiles: rows of the film.
struct Band<'a> {
    y: usize,
    /// Red, green, blue, transmittance.
    planes: [&'a mut [f32]; 4],
    error: Option<&'a mut [f32]>,
}

fn bands(film: &mut Film, rows: usize) -> Vec<Band<'_>> {
    let mut error = film.error.as_mut().map(|plane| plane.chunks_mut(film.size[0] as usize * rows));
    tile::bands(film.size[0], rows, &mut film.color, &mut film.transmittance)
        .enumerate()
        .map(|(number, planes)| Band { y: number * rows, planes, error: error.as_mut().and_then(Iterator::next) })
        .collect()
}

/// Rows of a block: many, because each particle costs a block something whatever its rows. (With 4, a frame takes 15 % longer
/// at 16 lanes and 25 % at 8.)
pub const ROWS: usize = 8;

struct BandJob<'a, 'b> {
    picture: &'a Picture<'a>,
    /// The particles that touch the band.
    list: &'a [u32],
    band: Band<'b>,
}

/// What a slab holds of a block: per row the optical depth in powers of two and that times the colour, or the optical
/// depth of each of up to four colours.
type Slot<F, const R: usize> = [[F; 4]; R];

/// The rays of a block of [`Simd::LANES`] x `R` pixels.
struct Rays<F, const R: usize> {
    /// Tangents.
    x: F,
    y: [f32; R],
    /// |dir| with dir.z = -1, its inverse and the square of that.
    length: [F; R],
    inverse: [F; R],
    weight: [F; R],
    /// Opaque depth in two parts.
    wall: [[F; 2]; R],
    /// 0, 1, 2, ...
    ramp: F,
}

/// What composites a block so far.
struct Sums<F, const R: usize> {
    /// Optical depth in powers of two, and the transmittance.
    depth: [F; R],
    through: [F; R],
    /// Light of L_K, L_K/2 and L_K/4.
    light: [[[F; 3]; R]; 3],
    /// Transmittance where the open merged slabs begin, for L_K/2 and L_K/4.
    begin: [[F; R]; 2],
}

/// Memory of a band's work.
struct Scratch<S: Simd, const R: usize> {
    slots: Vec<Slot<S::F, R>>,
    legs: Vec<Leg<S::F, R>>,
    nearby: Nearby,
}

/// Most colours that have planes of their own.
const FEW: usize = 4;

/// A tile's particles and colours.
struct Tile {
    at: [usize; 2],
    size: [usize; 2],
    /// The colours, if they are few.
    palette: Option<([Rgb; FEW], usize)>,
    /// Nearest opaque depth; infinite if there is none.
    nearest: f32,
    /// Transmittance below which nothing behind can change a channel by more than the tolerance.
    stop: f32,
}

impl WithSimd for BandJob<'_, '_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> u64 {
        self.run::<S, ROWS>(s)
    }
}

impl BandJob<'_, '_> {
    /// Draws the band in blocks of `R` rows; returns the fragments.
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, s: S) -> u64 {
        let Self { picture, list, mut band } = self;
        let width = picture.view.size[0] as usize;
        let rows = band.planes[0].len() / width;
        let band_y = band.y;
        let mut scratch = Scratch::<S, R> {
            slots: vec![[[s.splat(0.0); 4]; R]; picture.slabs],
            legs: Vec::new(),
            nearby: Nearby::default(),
        };
        let mut fragments = 0;
        for left in (0..width).step_by(TILE) {
            let size = [TILE.min(width - left), rows];
            let drawn = |x: usize, y: usize| picture.mask.is_none_or(|mask| mask.get(left + x, band_y + y));
            let [across, down] = Mask::BLOCK;
            if (0..rows).step_by(down).all(|y| (0..size[0]).step_by(across).all(|x| !drawn(x, y))) {
                continue;
            }
            let tile = picture.tile([left, band.y], size, list, &mut scratch.nearby);
            for y in (0..rows).step_by(R) {
                for x in (0..size[0]).step_by(S::LANES) {
                    if drawn(x, y) {
                        fragments += picture.block(s, &tile, [x, y], &mut scratch, &mut band);
                    }
                }
            }
        }
        fragments
    }
}

impl Picture<'_> {
    /// Tangents of the ray through the centre of a pixel.
    fn corner(&self, pixel: [usize; 2]) -> [f64; 2] {
        let [x, y] = pixel.map(|number| number as f64 + 0.5);
        let direction = self.view.direction(x, y);
        [direction.x, direction.y]
    }

    /// Tangents from pixel to pixel.
    fn step(&self) -> [f64; 2] {
        let focal = self.view.focal_px();
        [1.0 / focal.x, -1.0 / focal.y]
    }

    /// Lists the particles of a tile and finds their colours.
    fn tile(&self, at: [usize; 2], size: [usize; 2], list: &[u32], nearby: &mut Nearby) -> Tile {
        let width = self.view.size[0] as usize;
        let background = self.background;
        let opaque = self.opaque.map(|layer| survey(layer, background, width, at, size));
        // Rounded outwards: a particle that the surface may touch is cut by it.
        let [nearest, farthest] = opaque
            .as_ref()
            .map_or([f32::INFINITY; 2], |opaque| [opaque.nearest.next_down(), opaque.farthest.next_up()]);
        let [x0, x1] = [at[0] as u32, (at[0] + size[0]) as u32];
        let mut palette = [[0.0; 3]; FEW];
        let mut colors = 0;
        nearby.clear();
        let corner = self.corner(at);
        for &i in list {
            let (ball, bounds) = (&self.balls[i as usize], &self.bounds[i as usize]);
            if bounds.x[0] < x1 && bounds.x[1] >= x0 && ball.depths[0] <= farthest {
                let known = palette[..colors.min(FEW)].iter().position(|&color| color == ball.color);
                let color = known.unwrap_or_else(|| {
                    if colors < FEW {
                        palette[colors] = ball.color;
                    }
                    colors += 1;
                    colors - 1
                });
                nearby.push(i, color.min(FEW) as u8, ball.center, corner);
                colors = colors.min(FEW + 1);
            }
        }
        nearby.pad();
        Tile {
            at,
            size,
            palette: (colors <= FEW).then_some((palette, colors)),
            nearest,
            stop: stop_transmittance(self.gas.tolerance, &self.gas.range, background, opaque.as_ref()),
        }
    }

    /// The rays of the block at `at` of a tile.
    #[inline(always)]
    fn rays<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        corner: [f64; 2],
        step: [f64; 2],
    ) -> Rays<S::F, R> {
        let zero = s.splat(0.0);
        let ramp = s.ramp();
        let x = s.mul_add(ramp, s.splat(step[0] as f32), s.splat(corner[0] as f32));
        let square = s.mul_add(x, x, s.splat(1.0));
        let infinite = [s.splat(f32::INFINITY), zero];
        let mut rays = Rays {
            x,
            y: [0.0; R],
            length: [zero; R],
            inverse: [zero; R],
            weight: [zero; R],
            wall: [infinite; R],
            ramp,
        };
        for r in 0..R {
            let y = (corner[1] + r as f64 * step[1]) as f32;
            let square = s.add(square, s.splat(y * y));
            rays.y[r] = y;
            rays.length[r] = s.sqrt(square);
            rays.inverse[r] = s.div(s.splat(1.0), rays.length[r]);
            rays.weight[r] = s.div(s.splat(1.0), square);
            if let Some(layer) = self.opaque
                && at[1] + r < tile.size[1]
                && tile.nearest < f32::INFINITY
            {
                let mut parts = [[f32::INFINITY; 16], [0.0; 16]];
                let row = (tile.at[1] + at[1] + r) * self.view.size[0] as usize + tile.at[0] + at[0];
                let depths = &layer.depth[row..row + S::LANES.min(tile.size[0] - at[0])];
                for (lane, &depth) in depths.iter().enumerate() {
                    if depth < f64::INFINITY {
                        parts[0][lane] = depth as f32;
                        parts[1][lane] = (depth - f64::from(depth as f32)) as f32;
                    }
                }
                rays.wall[r] = [s.load(&parts[0]), s.load(&parts[1])];
            }
        }
        rays
    }

    /// Draws a block of pixels; returns the fragments.
    #[inline(always)]
    fn block<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        scratch: &mut Scratch<S, R>,
        band: &mut Band,
    ) -> u64 {
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let step = self.step();
        let corner = self.corner([tile.at[0] + at[0], tile.at[1] + at[1]]);
        let rays = self.rays(s, tile, at, corner, step);
        let merge = self.merges(band);
        // One colour needs one slab.
        let split = tile.palette.is_none_or(|(_, colors)| colors > 1) && self.slabs > 1;
        let mut sums = Sums { depth: [zero; R], through: [one; R], light: [[[zero; 3]; R]; 3], begin: [[one; R]; 2] };
        let Scratch { slots, legs, nearby } = scratch;
        // Slabs before `done` are composited; from `filled` on they are empty.
        let (mut done, mut filled) = (0, 0);
        // Behind this slab nothing is seen, by what is in the slabs already.
        let mut seen = self.slabs - 1;
        let mut hits = 0u64;
        let beam = Beam::new(self.corner(tile.at), step, at, [S::LANES, R]);
        let mut met = [Hit::default(); 16];
        'gas: for start in (0..nearby.count()).step_by(S::LANES) {
            let count = nearby.meet(s, start, &beam, &mut met);
            for hit in &met[..count] {
                let ball = &self.balls[hit.ball as usize];
                let [mut first, mut last] = ball.slabs.map(usize::from);
                if !split {
                    [first, last] = [0, 0];
                    if hits % 16 == 15 {
                        let mut least = slots[0][0][0];
                        for row in &slots[0][1..] {
                            least = s.min(least, row[0]);
                        }
                        if s.reduce_min(least) >= -tile.stop.log2() {
                            break 'gas;
                        }
                    }
                }
                if first > seen {
                    break 'gas;
                }
                // Slabs are merged by four.
                let ready = if merge { first & !3 } else { first };
                if ready > done {
                    let end = ready.min(filled.max(done));
                    composite(s, tile, merge, &mut slots[done..end], done, &mut sums);
                    done = ready;
                    if let Some(last) = last_seen(s, tile, &slots[done..filled.max(done)], &sums) {
                        let last = done + last;
                        seen = seen.min(if merge { last | 3 } else { last });
                        if first > seen {
                            break 'gas;
                        }
                    }
                }
                let cut = last > seen;
                last = last.min(seen);
                filled = filled.max(last + 1);
                hits += 1;
                let wall = ball.depths[1] >= tile.nearest;
                let thick = !merge && ball.step >= THICK;
                let fragment = Fragment { ball, rays: &rays, corner, step, depths: hit.depths, wall, cut, thick };
                let slots = &mut slots[first..=last];
                if tile.palette.is_some() {
                    fragment.shape::<S, true>(s, hit.color, &self.gas.shells, slots, legs);
                } else {
                    fragment.shape::<S, false>(s, hit.color, &self.gas.shells, slots, legs);
                }
            }
        }
        let end = filled.min(seen + 1);
        if done < end {
            composite(s, tile, merge, &mut slots[done..end], done, &mut sums);
        }
        if end < filled {
            slots[end.max(done)..filled].fill([[zero; 4]; R]);
        }
        self.develop(s, tile, at, &sums, band);
        hits * (S::LANES * R) as u64
    }

    /// Whether the pictures of fewer slabs are wanted too.
    fn merges(&self, band: &Band) -> bool {
        self.gas.cut.richardson || band.error.is_some()
    }

    /// Writes a block's pixels to the film: light over what is behind, and transmittance to the background.
    #[inline(always)]
    fn develop<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        sums: &Sums<S::F, R>,
        band: &mut Band,
    ) {
        let width = self.view.size[0] as usize;
        let background = self.background;
        let lanes = S::LANES.min(tile.size[0] - at[0]);
        let plain = lanes == S::LANES && tile.nearest == f32::INFINITY && !self.merges(band);
        for r in 0..R.min(tile.size[1] - at[1]) {
            let line = (at[1] + r) * width + tile.at[0] + at[0];
            if plain {
                let [color @ .., transmittance] = &mut band.planes;
                for ((plane, &behind), &light) in color.iter_mut().zip(&background).zip(&sums.light[0][r]) {
                    s.store(s.mul_add(sums.through[r], s.splat(behind), light), &mut plane[line..]);
                }
                s.store(sums.through[r], &mut transmittance[line..]);
                continue;
            }
            let layer = self.opaque.map(|layer| (layer, line + band.y * width));
            let mut through = [0.0f32; 16];
            s.store(sums.through[r], &mut through);
            let mut light = [[[0.0f32; 16]; 3]; 3];
            for (light, sums) in light.iter_mut().zip(&sums.light) {
                for (light, &sum) in light.iter_mut().zip(&sums[r]) {
                    s.store(sum, light);
                }
            }
            for lane in 0..lanes {
                let hit = layer.filter(|(layer, first)| layer.depth[first + lane] < f64::INFINITY);
                let behind = hit.map_or(background, |(layer, first)| layer.color[first + lane]);
                let mut most = 0.0f32;
                for channel in 0..3 {
                    let [full, half, quarter] = [0, 1, 2].map(|level| light[level][channel][lane]);
                    // By how much the extrapolation differs.
                    let [step, coarse] = [(full - half) / 3.0, (half - quarter) / 3.0];
                    let (value, error) = if self.gas.cut.richardson {
                        // Of the extrapolations from K and K/2 the second order has gone: a quarter of their difference
                        // would be left if nothing were smooth, a sixteenth if everything is.
                        (full + step, ((full + step) - (half + coarse)) / 15.0)
                    } else {
                        (full, step)
                    };
                    most = most.max(error.abs());
                    band.planes[channel][line + lane] = through[lane] * behind[channel] + value;
                }
                if let Some(error) = &mut band.error {
                    error[line + lane] = most;
                }
                band.planes[3][line + lane] = if hit.is_some() { 0.0 } else { through[lane] };
            }
        }
    }
}

/// The number of the slab, among those not yet composited, behind which nothing is seen, by what they hold so far: more can
/// only come.
#[inline(always)]
fn last_seen<S: Simd, const R: usize>(
    s: S,
    tile: &Tile,
    slots: &[Slot<S::F, R>],
    sums: &Sums<S::F, R>,
) -> Option<usize> {
    let colors = tile.palette.map_or(1, |(_, colors)| colors);
    let enough = -tile.stop.log2();
    let mut depth = sums.depth;
    // Not even the first, if what is before it is enough already.
    slots.iter().position(|slot| {
        let mut least = s.splat(f32::INFINITY);
        for (depth, row) in depth.iter_mut().zip(slot) {
            for &content in &row[..colors] {
                *depth = s.add(*depth, content);
            }
            least = s.min(least, *depth);
        }
        s.reduce_min(least) >= enough
    })
}

/// Composites slabs, the first of which has number `first`, front to back, and empties them. With `merge`, `first` is a
/// multiple of 4.
#[inline(always)]
fn composite<S: Simd, const R: usize>(
    s: S,
    tile: &Tile,
    merge: bool,
    slots: &mut [Slot<S::F, R>],
    first: usize,
    sums: &mut Sums<S::F, R>,
) {
    debug_assert!(!merge || first.is_multiple_of(4));
    let zero = s.splat(0.0);
    let count = slots.len();
    // Optical depth and colour of the open merged slabs.
    let mut open = [[[zero; 4]; R]; 2];
    for (i, slot) in slots.iter_mut().enumerate() {
        for r in 0..R {
            let mut content = slot[r];
            if let Some((palette, colors)) = &tile.palette {
                content = [zero; 4];
                for (&depth, color) in slot[r].iter().zip(&palette[..*colors]) {
                    content[0] = s.add(content[0], depth);
                    for (sum, &value) in content[1..].iter_mut().zip(color) {
                        *sum = s.mul_add(depth, s.splat(value), *sum);
                    }
                }
            }
            sums.depth[r] = s.add(sums.depth[r], content[0]);
            let before = sums.through[r];
            let after = exp2_neg(s, sums.depth[r]);
            sums.through[r] = after;
            emit(s, &content, before, after, &mut sums.light[0][r]);
            if merge {
                for (level, open) in open.iter_mut().enumerate() {
                    for (sum, &value) in open[r].iter_mut().zip(&content) {
                        *sum = s.add(*sum, value);
                    }
                    if (i + 1).is_multiple_of(2 << level) || i + 1 == count {
                        emit(s, &open[r], sums.begin[level][r], after, &mut sums.light[level + 1][r]);
                        sums.begin[level][r] = after;
                        open[r] = [zero; 4];
                    }
                }
            }
        }
        *slot = [[zero; 4]; R];
    }
}

/// Adds the light of a slab between two transmittances: their difference times the slab's mean colour. Differences of
/// transmittances add up to that of the whole, however many slabs there are.
#[inline(always)]
fn emit<S: Simd>(s: S, content: &[S::F; 4], before: S::F, after: S::F, light: &mut [S::F; 3]) {
    // Next to nothing has no reliable colour, but for rounding no light either.
    let least = s.splat(1e-12);
    let share = s.div(s.sub(before, after), s.max(content[0], least));
    let share = s.keep(s.less(least, content[0]), share);
    for (light, &value) in light.iter_mut().zip(&content[1..]) {
        *light = s.mul_add(share, value, *light);
    }
}

/// A particle before a block.
struct Fragment<'a, F, const R: usize> {
    ball: &'a Ball,
    rays: &'a Rays<F, R>,
    /// Tangents of the first pixel's ray, and from pixel to pixel.
    corner: [f64; 2],
    step: [f64; 2],
    /// Depths from its centre, in radii, between which rays may be in it.
    depths: [f32; 2],
    /// Whether opaque surfaces may cut it.
    wall: bool,
    /// Whether it goes on behind the last slab.
    cut: bool,
    /// Whether slabs are thick for it.
    thick: bool,
}

/// Thickness of a slab, in radii, from which a Gaussian's shares of the slabs may be less exact ([`Thick`]): the error of the
/// slabs is a hundred times as large.
const THICK: f32 = 0.25;

impl<F: Copy, const R: usize> Fragment<'_, F, R> {
    /// Adds the particle, whatever its kernel.
    #[inline(always)]
    fn shape<S: Simd<F = F>, const FEW: bool>(
        &self,
        s: S,
        plane: u8,
        shells: &[Shell],
        slots: &mut [Slot<F, R>],
        legs: &mut Vec<Leg<F, R>>,
    ) {
        match self.ball.shape {
            Shape::Gaussian if self.thick => self.add::<S, _, FEW>(s, Thick, plane, slots, legs),
            Shape::Gaussian => self.add::<S, _, FEW>(s, GAUSSIAN, plane, slots, legs),
            Shape::Beliaev => self.add::<S, _, FEW>(s, BELIAEV, plane, slots, legs),
            Shape::Constant => self.add::<S, _, FEW>(s, Constant, plane, slots, legs),
            Shape::Poly => self.add::<S, _, FEW>(s, Poly, plane, slots, legs),
            Shape::Shells(first, count) => {
                self.add::<S, _, FEW>(s, Shells::new(shells, first, count), plane, slots, legs);
            }
        }
    }

    /// Adds the optical depths of the particle's slabs: with `FEW` to plane `plane`, else with the colour.
    ///
    /// With c the centre over the radius, d its depth and dir = (X, Y, -1), the offsets of the ray from the centre at the
    /// centre's depth are A = d Y - c_y, B = c_x - d X, both small where the ray meets the ball, and
    /// c x dir = (A, B, A X + B Y): b^2 = |c x dir|^2 / |dir|^2. The point nearest the centre is o = (X B - Y A)/|dir|
    /// beyond the ray's point at the centre's depth, so that a plane z farther than the centre is met at u = z |dir| - o.
    #[inline(always)]
    // Rows of many arrays at once.
    #[allow(clippy::needless_range_loop)]
    fn add<S: Simd<F = F>, P: Primitive, const FEW: bool>(
        &self,
        s: S,
        kernel: P,
        plane: u8,
        slots: &mut [Slot<F, R>],
        legs: &mut Vec<Leg<F, R>>,
    ) {
        let Self { ball, rays, corner, step, depths: [low, high], wall, cut, .. } = self;
        let c = ball.center;
        // Planes before the rays reach the ball, and behind it, part nothing.
        let low = low.max(ball.near).min(*high);
        let [skipped, end] = self.planes([low, *high], slots.len() - usize::from(!cut));
        if skipped == slots.len() {
            return;
        }
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let b = s.mul_add(rays.ramp, s.splat((c.z * step[0]) as f32), s.splat((c.x + c.z * corner[0]) as f32));
        let b_square = s.mul(b, b);
        let (a_first, a_step) = ((-c.z * corner[1] - c.y) as f32, (-c.z * step[1]) as f32);
        let [mut square, mut half] = [[zero; R]; 2];
        for r in 0..R {
            let a = a_first + r as f32 * a_step;
            let twist = s.mul_add(b, s.splat(rays.y[r]), s.mul(rays.x, s.splat(a)));
            let cross = s.mul_add(twist, twist, s.add(b_square, s.splat(a * a)));
            square[r] = s.min(s.mul(cross, rays.weight[r]), one);
            half[r] = s.sqrt_near(s.sub(one, square[r]));
        }
        kernel.prepare(s, &square, legs);
        let amplitude = s.splat(ball.amplitude);
        let clipped = *wall || ball.near > -1.0;
        let whole = kernel.end(s, &square, legs, &half);
        if !clipped && skipped == end {
            let twice = s.add(amplitude, amplitude);
            for r in 0..R {
                put::<S, R, FEW>(s, &mut slots[end], r, s.mul(whole[r], twice), plane, &ball.color);
            }
            return;
        }
        let along_x = s.mul(rays.x, b);
        let [mut offset, mut from] = [half; 2];
        let mut to = half;
        for r in 0..R {
            let a = a_first + r as f32 * a_step;
            offset[r] = s.mul(s.sub(along_x, s.splat(rays.y[r] * a)), rays.inverse[r]);
            from[r] = s.sub(zero, half[r]);
        }
        if clipped {
            for r in 0..R {
                let near = s.mul_add(s.splat(ball.near), rays.length[r], s.sub(zero, offset[r]));
                if *wall {
                    let [high, low] = rays.wall[r];
                    let depth = s.add(s.sub(high, s.splat(ball.depth[0])), s.sub(low, s.splat(ball.depth[1])));
                    let limit = s.mul(s.mul(depth, s.splat(ball.inverse_radius)), rays.length[r]);
                    to[r] = s.min(to[r], s.sub(limit, offset[r]));
                }
                from[r] = s.min(s.max(from[r], near), half[r]);
                to[r] = s.max(to[r], from[r]);
            }
        }
        let mut factor = square;
        if clipped {
            // Where something cuts the chord, the whole depends on the factor too.
            for factor in &mut factor {
                *factor = s.mul(kernel.factor(s, *factor), amplitude);
            }
        } else {
            for factor in &mut factor {
                *factor = s.mul(kernel.factor_between(s, *factor), amplitude);
            }
        }
        // Where the ray enters and leaves the gas.
        let [mut enter, mut leave] = [whole; 2];
        if clipped {
            enter = kernel.at(s, &square, legs, &from);
            leave = kernel.at(s, &square, legs, &to);
            for r in 0..R {
                enter[r] = s.mul(enter[r], factor[r]);
                leave[r] = s.mul(leave[r], factor[r]);
            }
        } else {
            for r in 0..R {
                leave[r] = s.mul(whole[r], amplitude);
                enter[r] = s.sub(zero, leave[r]);
            }
        }
        let mut before = enter;
        for (i, slot) in slots[skipped..end].iter_mut().enumerate() {
            let z = s.splat(ball.plane + (skipped + i) as f32 * ball.step);
            let mut u = to;
            for r in 0..R {
                let plane = s.mul_add(z, rays.length[r], s.sub(zero, offset[r]));
                u[r] = s.min(s.max(plane, from[r]), to[r]);
            }
            let after = kernel.between(s, &square, legs, &u);
            for r in 0..R {
                let after = s.mul(after[r], factor[r]);
                put::<S, R, FEW>(s, slot, r, s.sub(after, before[r]), plane, &ball.color);
                before[r] = after;
            }
        }
        if let Some(slot) = slots.get_mut(end) {
            for r in 0..R {
                put::<S, R, FEW>(s, slot, r, s.sub(leave[r], before[r]), plane, &ball.color);
            }
        }
    }

    /// The planes between two depths from the centre: how many of `count` are before them, and how many before or between.
    #[inline(always)]
    fn planes(&self, depths: [f32; 2], count: usize) -> [usize; 2] {
        let [low, high] = depths.map(|z| (z - self.ball.plane) / self.ball.step);
        // Conversions truncate, and make 0 of what is negative.
        let skipped = (low as usize + usize::from(low > 0.0)).min(count);
        [skipped, (high as usize + usize::from(high > 0.0)).clamp(skipped, count)]
    }
}

/// Adds optical depth to row `r` of a slab: with `FEW` to plane `plane`, else with the colour.
#[inline(always)]
fn put<S: Simd, const R: usize, const FEW: bool>(
    s: S,
    slot: &mut Slot<S::F, R>,
    r: usize,
    depth: S::F,
    plane: u8,
    color: &Rgb,
) {
    let row = &mut slot[r];
    if FEW {
        let plane = usize::from(plane & 3);
        row[plane] = s.add(row[plane], depth);
    } else {
        row[0] = s.add(row[0], depth);
        for (sum, &value) in row[1..].iter_mut().zip(color) {
            *sum = s.mul_add(depth, s.splat(value), *sum);
        }
    }
}
