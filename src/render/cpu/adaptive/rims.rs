//! What the rims of balls cost on a grid.
//!
//! Where the density of a ball ends in a step s, as that of a truncated Gaussian does, its footprint ends as a sqrt(1 - u^2), a = 2 s
//! over the integral through the centre: a vertical tangent that no spline follows. Between nodes h apart it is off by up to [`KINK`] a
//! sqrt(2 h / R) of the optical depth, R being the radius that is seen, wherever the rim lies among the nodes; but a rim that lies
//! badly shows in nodes and their neighbours by less than half of that. So rims are not left to what nodes tell: each tile adds up
//! those that cross it, weighted with the transmittance in front of them.

use super::{SPACINGS, touched};
use crate::render::cpu::cover::Cover;
use crate::render::cpu::splat::Lens;
use crate::render::cpu::tile::TILE;
use crate::scene::{Kernel, Scene};
use glam::DVec3;
use std::ops::{Range, RangeInclusive};

/// The largest error of the cubic B-spline of [`super::enlarge`] between nodes, for sqrt(x - x0), x > x0, with nodes at the whole
/// numbers and any x0.
const KINK: f64 = 0.35;

/// Layers of depth in which rims of several colours are told apart.
const LAYERS: usize = 24;

/// Rims are added by powers of the square of what each costs, these for one colour and for several, and the root of the sum is taken
/// for so much more. Of one colour that is how errors that are independent add up. Of several most rims are hidden, and of many nodes
/// do tell: little more than the strongest counts. Measured (`analysis/auto/rims.py`).
const POWERS: [f64; 2] = [1.0, 4.0];
const MORE: f64 = 1.1;

/// Transmittance that a tile is taken to have in front of most of its gas, at the least: what is behind all hides nothing in front.
const LEAST_THROUGH: f64 = 1e-6;

/// Rims that meet somewhere in a tile, if it has as many.
const FEW: f64 = 4.0;

/// What a rim may cost of the tolerance on the widest grid and count wherever its ball is near, and the side of the fields in which
/// such rims are added up, in tiles: many balls have a rim that hardly counts, and touch many tiles.
const WEAK: f64 = 0.15;
const FIELD: usize = 4;

/// Particles that tell the depths of a view, at the most about.
const SAMPLE: usize = 1024;

/// The largest step of a kernel's density, in the kernel's own unit.
pub fn step(kernel: &Kernel) -> f64 {
    let rim = kernel.density(1.0f64.next_down());
    match kernel {
        Kernel::Constant | Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Poly => rim,
        Kernel::Table(profile) => {
            // A profile may have steps anywhere.
            let rows = profile.densities().windows(2).zip(profile.q().windows(2));
            rows.map(|(density, q)| if q[1] - q[0] < 1.0 / 16.0 { (density[1] - density[0]).abs() } else { 0.0 })
                .fold(rim, f64::max)
        }
    }
}

/// The greatest density of a kernel, in the kernel's own unit.
pub fn peak(kernel: &Kernel) -> f64 {
    match kernel {
        Kernel::Constant | Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Poly => kernel.density(0.0),
        Kernel::Table(profile) => profile.densities().iter().copied().fold(0.0, f64::max),
    }
}

/// What is the same for all balls of a view.
#[derive(Clone, Debug)]
pub struct Balls {
    /// For each set: by what its amplitude grows to the slope a, and to the optical depth through the centre.
    factors: Vec<[f32; 2]>,
    /// Nearest depth, and layers per unit of depth.
    depths: [f64; 2],
    /// 1 if all gas has one colour: then an error in front is seen through all of it, as one behind is. 0 if no kernel has a step.
    layers: usize,
    /// The square of the slope times 2 / R of a rim that costs [`WEAK`] of the tolerance on the widest grid.
    unit: f64,
    tolerance: f64,
}

impl Balls {
    /// Of a scene seen through a lens.
    pub fn new(scene: &Scene, lens: &Lens, one: bool, tolerance: f64) -> Self {
        // What is measured in it must stay finite.
        let tolerance = tolerance.max(1e-9);
        let factors: Vec<[f32; 2]> = scene
            .particles
            .iter()
            .map(|set| {
                [2.0 * step(&set.kernel), set.kernel.chord(0.0)].map(|factor| (factor * std::f64::consts::LN_2) as f32)
            })
            .collect();
        let layers = if factors.iter().all(|factor| factor[0] == 0.0) {
            0
        } else if one {
            1
        } else {
            LAYERS
        };
        let mut depths = [0.0, 0.0];
        if layers > 1 {
            let stride = scene.particle_count().div_ceil(SAMPLE).max(1);
            let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
            for set in &scene.particles {
                for i in (0..set.len()).step_by(stride) {
                    let depth = -lens.view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i])).z;
                    if depth > lens.view.near {
                        (near, far) = (near.min(depth), far.max(depth));
                    }
                }
            }
            if near < far {
                depths = [near, layers as f64 / (far - near)];
            }
        }
        let unit = (WEAK * tolerance / KINK).powi(2) / SPACINGS[0] as f64;
        Self { factors, depths, layers, unit, tolerance }
    }

    /// The rim of a ball of a set, by its centre in eye space and its least apparent radius in pixels.
    #[inline]
    pub fn rim(&self, lens: &Lens, set: usize, amplitude: f32, center: DVec3, apparent: f64) -> Rim {
        let [slope, depth] = self.factors[set].map(|factor| factor * amplitude);
        // What is so far beyond all tolerance is no worse for being farther, and stays finite.
        let square = if slope > 0.0 { (slope * slope * (2.0 / (apparent * self.unit)) as f32).min(1e8) } else { 0.0 };
        let strong = square > 1.0;
        let mut rim = Rim { strong, ..Rim::default() };
        if self.layers > 1 {
            // Of a field that it touches it covers so much, in the mean over where it may be.
            let covered = apparent / (apparent + (FIELD * TILE / 2) as f64);
            rim.depth = depth * (covered * covered) as f32;
            // The conversion truncates, and makes 0 of what is negative.
            rim.layer = (((-center.z - self.depths[0]) * self.depths[1]) as usize).min(self.layers - 1);
        }
        rim.power = if self.layers > 1 { square.powi(4) } else { square };
        if strong && center.z < 0.0 {
            // The square in the disc of the least apparent radius, but for the pixels in which nodes beyond the rim have a say that counts.
            let half = apparent * std::f64::consts::FRAC_1_SQRT_2 - (2 * SPACINGS[0]) as f64;
            let at = lens.picture(center.x / -center.z, center.y / -center.z).to_array();
            rim.within = at.map(|at| {
                let [first, end] = [at - half, at + half].map(|at| (at / TILE as f64).max(0.0));
                first.ceil() as usize..end as usize
            });
            if rim.within.iter().any(Range::is_empty) {
                rim.within = [0..0, 0..0];
            }
        }
        rim
    }
}

/// The rim of a ball.
#[derive(Clone, Debug, Default)]
pub struct Rim {
    /// Whether it costs more than [`WEAK`] of the tolerance: then it counts where it runs.
    pub strong: bool,
    /// The square of its slope times 2 / R in units of [`Balls::unit`] to a power.
    power: f32,
    /// Optical depth through the centre of the ball, times the share of a field that it covers; with several layers alone.
    depth: f32,
    layer: usize,
    /// Columns and lines of tiles that it does not cross.
    within: [Range<usize>; 2],
}

/// The rims that cross the tiles of a view.
#[derive(Clone, Debug, Default)]
pub struct Rims {
    /// Tiles, and how many of them are in a row.
    tiles: usize,
    across: usize,
    /// Fields of [`FIELD`] tiles along both axes.
    fields: [usize; 2],
    layers: usize,
    /// What rims cost on the widest grid that cost one unit.
    unit: f64,
    /// For each layer and tile, the sum over the strong rims that may cross it, and the strongest; empty without any.
    strong: Vec<[f32; 2]>,
    /// For each layer the sums over the weak rims of the balls that touch a field and, with several layers alone, over their depths.
    touched: Vec<Cover<2>>,
    /// These sums, for each layer and field, once all balls are in.
    sums: Vec<[f64; 2]>,
}

impl Rims {
    /// No rims in so many tiles along x and y.
    pub fn new(balls: &Balls, tiles: [usize; 2]) -> Self {
        let layers = balls.layers;
        let fields = tiles.map(|count| count.div_ceil(FIELD));
        Self {
            tiles: tiles[0] * tiles[1],
            across: tiles[0],
            fields,
            layers,
            unit: WEAK * balls.tolerance,
            strong: Vec::new(),
            touched: vec![Cover::new(fields); layers],
            sums: Vec::new(),
        }
    }

    /// Adds a ball that covers intervals of picture coordinates to the fields that it touches; a strong rim is left to
    /// [`Rims::cross`].
    #[inline]
    pub fn touch(&mut self, rim: &Rim, [x, y]: [[f64; 2]; 2]) {
        if self.layers == 0 {
            return;
        }
        // Nodes beyond a rim have a say in pixels beside them.
        let grown = [x, y].map(|[low, high]| [low - SPACINGS[0] as f64, high + SPACINGS[0] as f64]);
        let fields = touched(grown, self.fields, FIELD * TILE);
        if !rim.strong {
            self.touched[rim.layer].add(fields, 0, f64::from(rim.power));
        }
        if self.layers > 1 {
            self.touched[rim.layer].add(fields, 1, f64::from(rim.depth));
        }
    }

    /// Adds a strong rim to the tiles of a row near which it may run: to all but those well within the ball.
    pub fn cross(&mut self, rim: &Rim, row: RangeInclusive<usize>) {
        self.strong.resize(self.tiles * self.layers, [0.0; 2]);
        let (start, end, line) = (*row.start(), *row.end() + 1, *row.start() / self.across);
        let [columns, lines] = &rim.within;
        let [from, to] = if lines.contains(&line) {
            [columns.start, columns.end].map(|column| (line * self.across + column).clamp(start, end))
        } else {
            [end; 2]
        };
        let powers = &mut self.strong[rim.layer * self.tiles..(rim.layer + 1) * self.tiles];
        for part in [start..from, to..end] {
            powers[part].iter_mut().for_each(|[sum, most]| (*sum, *most) = (*sum + rim.power, most.max(rim.power)));
        }
    }

    /// Adds those of other balls.
    pub fn merge(&mut self, other: &Self) {
        self.strong.resize(self.strong.len().max(other.strong.len()), [0.0; 2]);
        for ([sum, most], other) in self.strong.iter_mut().zip(&other.strong) {
            (*sum, *most) = (*sum + other[0], most.max(other[1]));
        }
        self.touched.iter_mut().zip(&other.touched).for_each(|(sums, other)| sums.merge(other));
    }

    /// Adds up what touches each field, once all balls are in.
    pub fn finish(&mut self) {
        self.sums.clear();
        for layer in &self.touched {
            let [_, rounding] = layer.rounding();
            // Nothing may be a little more or less, for rounding. More weak rims, and less depth in front of others, err on the safe side.
            layer.sums(|[weak, depth]| self.sums.push([weak.max(0.0), if depth > rounding { depth } else { 0.0 }]));
        }
    }

    /// The error that rims cause in a tile, nodes being so many pixels apart. `through`: the greatest transmittance in the tile;
    /// `spread`: the largest change of a channel with the transmittance, and that itself; `contrast`: without that itself.
    ///
    /// Of several colours, the transmittance in front of a rim is found as if all of the optical depth was spread in depth as the
    /// balls are.
    pub fn loss(&self, tile: usize, spacing: usize, through: f32, [spread, contrast]: [f64; 2]) -> f64 {
        let [columns, lines] = self.fields;
        let field = tile / self.across / FIELD * columns + tile % self.across / FIELD;
        let strong =
            |layer: usize| self.strong.get(layer * self.tiles + tile).map_or([0.0; 2], |both| both.map(f64::from));
        let touched = |layer: usize| self.sums[layer * columns * lines + field];
        let several = usize::from(self.layers > 1);
        let exponent = POWERS[several];
        let widest = SPACINGS[0] as f64;
        let root = |sum: f64| if self.layers > 1 { sum.powf(1.0 / exponent) } else { sum };
        let cost = |sum: f64| MORE * self.unit * (root(sum) * spacing as f64 / widest).sqrt();
        let through = f64::from(through);
        // Nodes so far apart on both sides of a rim are off: that share of the rims in a tile meet at a pixel; few do in any case.
        let share = 2.0 * spacing as f64 / TILE as f64;
        // All rims, the strong ones and the strongest.
        let rims = |layer: usize| {
            let [sum, most] = strong(layer);
            [sum + touched(layer)[0], sum, most]
        };
        let and = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2].max(b[2])];
        let meet = |[all, strong, most]: [f64; 3]| cost((share * all).max(strong.min(FEW * most)));
        let seen = spread * through * meet((0..self.layers).map(rims).fold([0.0; 3], and));
        if self.layers < 2 {
            return seen;
        }
        let total: f64 = (0..self.layers).map(|layer| touched(layer)[1]).sum();
        // The powers' own, per unit of mass in front.
        let exponent = 2.0 * exponent as f32 * through.max(LEAST_THROUGH).log2() as f32 / total as f32;
        let (mut front, mut found) = (0.0, [0.0; 3]);
        for layer in 0..self.layers {
            let rims = rims(layer);
            if rims != [0.0; 3] {
                // In f32: a twentieth of the time of a power in f64.
                let clear = if front > 0.0 { f64::from((exponent * front as f32).exp2()) } else { 1.0 };
                found = and(found, rims.map(|power| power * clear));
            }
            front += touched(layer)[1];
        }
        seen.max(contrast * meet(found))
    }
}

#[cfg(test)]
mod tests {
    use super::super::enlarge::spline;
    use super::super::rows;
    use super::*;
    use crate::scene::{Attribute, Camera, ParticleSet};

    #[test]
    fn the_spline_misses_a_root_by_what_is_said() {
        let mut worst = 0.0f64;
        for place in 0..=100 {
            let root = |x: f64| (x - f64::from(place) / 100.0).max(0.0).sqrt();
            let node = |i: i32| f64::from(i);
            let both = |i: i32, n: i32| root(node(i - n)) + root(node(i + n));
            let coefficient = |i: i32| (54.0 * root(node(i)) - 10.0 * both(i, 1) + both(i, 2)) / 36.0;
            for cell in -3..5 {
                for t in (0..100).map(|i| f64::from(i) / 100.0) {
                    let sum: f64 = (cell - 1..cell + 3).zip(spline(t)).map(|(i, weight)| weight * coefficient(i)).sum();
                    worst = worst.max((sum - root(node(cell) + t)).abs());
                }
            }
        }
        assert!(worst <= KINK && worst > 0.95 * KINK, "{worst}");
    }

    #[test]
    fn footprints_end_by_the_slope_that_is_said() {
        let table = Kernel::table(vec![0.0, 0.5, 1.0], vec![1.0, 0.7, 0.03]).unwrap();
        for kernel in [Kernel::Gaussian, Kernel::Beliaev, Kernel::Constant, table] {
            let slope = 2.0 * step(&kernel) / kernel.chord(0.0);
            let u = 1.0 - 1e-9f64;
            let found = kernel.footprint(u) / (1.0 - u * u).sqrt();
            assert!((found / slope - 1.0).abs() < 1e-2, "{}: {found} for {slope}", kernel.name());
        }
        for kernel in [Kernel::Linear, Kernel::Poly] {
            assert!(step(&kernel) < 1e-12, "{}", kernel.name());
        }
    }

    /// The rim of one ball, in the middle of a picture of 16 x 16 tiles.
    fn one(radius: f64, amplitude: f32, one: bool) -> Rims {
        let scene = Scene {
            camera: Camera::for_tests([1024, 1024]),
            stereo: None,
            background: [0.0; 3],
            particles: vec![ParticleSet {
                kernel: Kernel::Gaussian,
                x: vec![0.0],
                y: vec![0.0],
                z: vec![-10.0],
                radius: Attribute::Uniform(radius),
                opacity: Attribute::Uniform(0.5),
                color: Attribute::Uniform([1.0; 3]),
            }],
            meshes: Vec::new(),
        };
        let views = scene.views();
        let lens = Lens::new(&views[0]);
        let balls = Balls::new(&scene, &lens, one, 1.0 / 255.0);
        let mut rims = Rims::new(&balls, [16, 16]);
        let center = DVec3::new(0.0, 0.0, -10.0);
        let rim = balls.rim(&lens, 0, amplitude, center, lens.least_radius(center, radius));
        let intervals = lens.ball_intervals(center, radius);
        rims.touch(&rim, intervals);
        if rim.strong {
            rows(touched(intervals, [16, 16], TILE), 16).for_each(|row| rims.cross(&rim, row));
        }
        rims.finish();
        rims
    }

    #[test]
    fn a_rim_costs_what_it_is_off_where_it_runs() {
        for colors in [1, 3] {
            let rims = one(3.0, 1.0, colors == 1);
            let loss = |tile: usize, spacing| rims.loss(tile, spacing, 1.0, [1.0, 1.0]);
            let lens_radius = 3.0 / 10.0 * 512.0 / (0.5 * Camera::for_tests([1024, 1024]).fov_y).tan();
            let slope = 2.0 * step(&Kernel::Gaussian) * std::f64::consts::LN_2;
            let expected = KINK * slope * (2.0 * 16.0 / lens_radius).sqrt() * MORE;
            // The ball's leftmost point, its middle, and a corner of the picture.
            let column = ((512.0 - lens_radius) / TILE as f64) as usize;
            let [rim, middle, corner] = [8 * 16 + column, 8 * 16 + 8, 0].map(|tile| loss(tile, 16));
            assert!((rim / expected - 1.0).abs() < 1e-3, "{colors} colours: {rim} for {expected}");
            assert_eq!([middle, corner], [0.0; 2], "{colors} colours");
            assert!((loss(8 * 16 + column, 4) / rim - 0.5).abs() < 1e-6, "{colors} colours");
        }
    }

    #[test]
    fn weak_rims_count_in_all_of_their_field() {
        let rims = one(1.0, 1e-3, true);
        assert!(rims.strong.is_empty());
        let loss = |tile| rims.loss(tile, 16, 0.5, [1.0, 1.0]);
        // The ball covers columns 6 to 9; its fields, 4 to 11.
        assert!(loss(8 * 16 + 8) > 0.0 && loss(8 * 16 + 4) > 0.0 && loss(8 * 16 + 12) == 0.0);
        let clear = rims.loss(8 * 16 + 8, 16, 1.0, [1.0, 1.0]);
        assert!((loss(8 * 16 + 8) / clear - 0.5).abs() < 1e-9);
    }
}
