//! Gas on as few rays and slabs as a tolerance allows: the engine of method `auto`.
//!
//! Where nothing cuts it, the light of gas and its transmittance are smooth from pixel to pixel. They are computed on the
//! nodes of a grid, every 16th pixel along both axes, by the slabs of [`super::slab`], and a cubic B-spline takes them to
//! the pixels. Each tile of the picture asks whether its nodes are near enough to each other: every node is compared with what its
//! neighbours of twice the distance would have made of it. Tiles for which that differs too much go on to a grid twice as fine, and in the
//! end to their own pixels; those in which a particle is small against the distance of the nodes, or in which an opaque surface cuts gas, do
//! so from the start. Gas of one colour needs one slab; of several, the number of slabs grows until the slabs' own
//! estimate is content on the first grid.
//!
//! What a tile and a slab are asked is an estimate, not a bound. It errs on the safe side: a smooth picture is better by two orders of
//! magnitude on the grid that is used than on the one of twice the distance, and the rim of a ball, where the
//! density of most kernels has a kink, by the square root of 2.

use super::engine;
use super::simd::{Level, Simd, WithSimd, dispatch};
use super::slab::{Canvas, Cut, Gas, Mask, Ordered, Prepared, Work};
use super::tile::{self, TILE};
use crate::picture::Film;
use crate::render::opaque::OpaqueLayer;
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Kernel, Rgb, Scene, View, stereo};
use glam::DVec2;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Distances of the nodes in pixels, from grid to grid.
const SPACINGS: [usize; 4] = [16, 8, 4, 2];

/// What of the tolerance may be lost by ending early, by the slabs, and from node to pixel.
const EARLY: f64 = 0.1;
const SLABS: f64 = 0.3;
const NODES: f64 = 0.6;

/// Least radius of a particle in distances of nodes: less might slip through between them.
const LEAST_RADIUS: f64 = 3.0;

/// Density at the rim, as a share of that at the centre, from which the rim is a step that no grid follows.
const STEP: f64 = 0.05;

/// First and greatest number of slabs.
const FIRST_SLABS: u32 = 16;
const MOST_SLABS: u32 = 1024;

/// Rows of nodes that a task draws.
const BAND: usize = 16;

/// Nodes beyond the picture on every side: the spline reaches two cells and its coefficients one more.
const MARGIN: usize = 2;

/// A grid of nodes over the picture of a view.
struct Grid {
    spacing: usize,
    /// Columns and rows of nodes.
    size: [usize; 2],
    /// Picture coordinates of the node (MARGIN, MARGIN); at most 0.
    origin: [f64; 2],
}

impl Grid {
    fn new(view: &View, spacing: usize) -> Self {
        let picture = view.size.map(|n| n as usize);
        let cells = picture.map(|n| n.div_ceil(spacing));
        Self {
            spacing,
            size: cells.map(|n| n + 2 * MARGIN + 1),
            // Centred, so that the nodes are the pixels of a view with the same axis.
            origin: [0, 1].map(|axis| (picture[axis] as f64 - (cells[axis] * spacing) as f64) / 2.0),
        }
    }

    /// The view whose pixels are the nodes.
    fn view(&self, view: &View) -> View {
        let [x, y] = [0, 1].map(|axis| (self.size[axis] * self.spacing) as f64 / f64::from(view.size[axis]));
        View { half_extent: view.half_extent * DVec2::new(x, y), size: self.size.map(|n| n as u32), ..view.clone() }
    }

    /// The node before a pixel's centre along an axis.
    fn cell(&self, axis: usize, pixel: usize) -> usize {
        ((pixel as f64 + 0.5 - self.origin[axis]) / self.spacing as f64) as usize + MARGIN
    }

    /// The first pixel whose centre is not before a node.
    fn first_pixel(&self, axis: usize, node: usize) -> isize {
        (node as isize - MARGIN as isize) * self.spacing as isize + (self.origin[axis] - 0.5).ceil() as isize
    }

    /// The nodes that the pixels from `first` to `last` are compared by or made of, along an axis.
    fn nodes(&self, axis: usize, first: usize, last: usize) -> [usize; 2] {
        [self.cell(axis, first).saturating_sub(3), (self.cell(axis, last) + 4).min(self.size[axis] - 1)]
    }
}

/// How a tile of the picture is drawn.
#[derive(Clone, Copy)]
struct Tile {
    /// Least radius of a particle in pixels.
    radius: f64,
    /// Greatest depth of gas.
    far: f32,
    /// The grid, as a place in [`SPACINGS`]; beyond it are the pixels themselves.
    grid: usize,
    /// Whether the grid is good enough.
    decided: bool,
}

/// A view and what is known of it.
struct Part<'a> {
    view: &'a View,
    opaque: Option<&'a OpaqueLayer>,
    tiles: Vec<Tile>,
    /// Tiles in a row.
    across: usize,
    /// One per grid that was drawn.
    nodes: Vec<Option<(Grid, Film)>>,
    work: Work,
    transform: Duration,
}

/// What is the same for all views.
struct Job<'a> {
    scene: &'a Scene,
    gas: Gas<'a>,
    one: Option<Rgb>,
    level: Level,
    tolerance: f64,
    /// Least and greatest of what a channel can be.
    range: [[f32; 2]; 3],
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw(frame: Frame, progress: &dyn Progress) -> Statistics {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let colors = engine::colors(scene);
    let tolerance = options.tolerance;
    let mut range = colors.range;
    for (channel, range) in range.iter_mut().enumerate() {
        let behind = opaque.iter().flatten().flat_map(|layer| &layer.color).map(|color| color[channel]);
        for value in behind.chain([scene.background[channel]]) {
            *range = [range[0].min(value), range[1].max(value)];
        }
    }
    let shared = stereo::share_depth(views);
    let mut slabs = if colors.one.is_some() { 1 } else { FIRST_SLABS };
    let prepare = start.elapsed();

    // The first grid tells how many slabs are needed.
    let start = Instant::now();
    let (job, ordered, mut parts) = loop {
        let cut = Cut { slabs, richardson: slabs > 1 };
        let gas = Gas::new(scene, cut, (EARLY * tolerance) as f32);
        let ordered: Vec<Ordered> =
            if shared { &views[..1] } else { views }.iter().map(|view| gas.order(view)).collect();
        let job = Job { scene, gas, one: colors.one, level: options.level, tolerance, range };
        let parts: Vec<Part> = views
            .par_iter()
            .zip(opaque)
            .enumerate()
            .map(|(v, (view, opaque))| job.begin(view, opaque.as_ref(), &ordered[if shared { 0 } else { v }]))
            .collect();
        let estimate = parts.iter().flat_map(Part::estimates).fold(0.0f32, f32::max);
        let off = f64::from(estimate) / (SLABS * tolerance);
        if off <= 1.0 || slabs == 1 || slabs >= MOST_SLABS {
            break (job, ordered, parts);
        }
        // Of at least the second order, mostly of the fourth.
        let more = (1.1 * off.cbrt()).clamp(1.25, 3.0) * f64::from(slabs);
        slabs = ((more / 4.0).ceil() as u32 * 4).min(MOST_SLABS);
    };
    let plan = start.elapsed();

    let start = Instant::now();
    parts.par_iter_mut().enumerate().for_each(|(v, part)| {
        let ordered = &ordered[if shared { 0 } else { v }];
        for grid in 0..SPACINGS.len() {
            job.refine(part, grid, ordered);
        }
    });
    let nodes = start.elapsed();

    let start = Instant::now();
    let mut raster = Duration::ZERO;
    for (v, (part, film)) in parts.iter_mut().zip(films.iter_mut()).enumerate() {
        job.enlarge(part, film);
        let start = Instant::now();
        job.pixels(part, film, &ordered[if shared { 0 } else { v }]);
        raster += start.elapsed();
        progress.update(v as u64 + 1, views.len() as u64);
    }
    let enlarge = start.elapsed() - raster;

    let mut work = Work::default();
    for part in &parts {
        work.add(&part.work);
    }
    Statistics {
        stages: vec![
            ("prepare", prepare),
            ("probe", plan),
            ("nodes", nodes),
            ("enlarge", enlarge),
            ("raster", raster),
        ],
        fragments: work.fragments,
        prepared: work.prepared,
        ..Statistics::default()
    }
}

/// Density at the rim as a share of that at the centre or, if that is greater, anywhere.
fn rim(kernel: &Kernel) -> f64 {
    match kernel {
        Kernel::Constant => 1.0,
        Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Poly => 0.0,
        Kernel::Table(profile) => {
            let densities = profile.densities();
            // A profile may have steps anywhere.
            let most = densities.iter().copied().fold(0.0, f64::max);
            let steps = densities.windows(2).zip(profile.q().windows(2)).map(|(density, q)| {
                if q[1] - q[0] < 1.0 / 16.0 { (density[1] - density[0]).abs() } else { 0.0 }
            });
            let last = densities.last().copied().unwrap_or(0.0);
            steps.fold(last, f64::max) / most
        }
    }
}

impl<'a> Job<'a> {
    /// Draws the nodes of the first grid, and finds what tiles hold.
    fn begin(&self, view: &'a View, opaque: Option<&'a OpaqueLayer>, ordered: &Ordered) -> Part<'a> {
        let [across, down] = view.size.map(|n| (n as usize).div_ceil(TILE));
        let empty = Tile { radius: f64::INFINITY, far: 0.0, grid: 0, decided: false };
        let mut part = Part {
            view,
            opaque,
            tiles: vec![empty; across * down],
            across,
            nodes: Vec::new(),
            work: Work::default(),
            transform: Duration::ZERO,
        };
        let grid = Grid::new(view, SPACINGS[0]);
        let start = Instant::now();
        let coarse = grid.view(view);
        let prepared = self.gas.prepare(&coarse, ordered);
        part.transform += start.elapsed();
        part.survey(self.scene, &grid, &prepared);
        part.nodes.push(Some(self.draw_nodes(&mut part.work, grid, &coarse, &prepared, None)));
        part
    }

    /// Draws nodes.
    fn draw_nodes(
        &self,
        work: &mut Work,
        grid: Grid,
        view: &View,
        prepared: &Prepared,
        mask: Option<&Mask>,
    ) -> (Grid, Film) {
        let mut film = Film::new(view.size);
        film.error = self.one.is_none().then(|| vec![0.0; film.transmittance.len()]);
        let canvas = Canvas { film: &mut film, opaque: None, band: BAND, mask, bare: true };
        work.add(&self.gas.draw(view, prepared, canvas, self.level));
        (grid, film)
    }

    /// Draws the nodes of a grid for the tiles that need it, and decides which of them are content.
    fn refine(&self, part: &mut Part, number: usize, ordered: &Ordered) {
        let spacing = SPACINGS[number];
        let view = part.view;
        let wanted: Vec<usize> = (0..part.tiles.len())
            .filter(|&i| !part.tiles[i].decided && part.tiles[i].grid <= number)
            .filter(|&i| part.tiles[i].radius >= LEAST_RADIUS * spacing as f64)
            .collect();
        if number > 0 {
            if wanted.is_empty() {
                part.nodes.push(None);
            } else {
                let grid = Grid::new(view, spacing);
                let mut mask = Mask::new(grid.size);
                for &i in &wanted {
                    let [x, y] = part.pixels(i);
                    let ([x0, x1], [y0, y1]) = (grid.nodes(0, x[0], x[1]), grid.nodes(1, y[0], y[1]));
                    mask.add([x0, y0], [x1, y1]);
                }
                let start = Instant::now();
                let fine = grid.view(view);
                let prepared = self.gas.prepare(&fine, ordered);
                part.transform += start.elapsed();
                let nodes = self.draw_nodes(&mut part.work, grid, &fine, &prepared, Some(&mask));
                part.nodes.push(Some(nodes));
            }
        }
        let misfit = part.nodes[number].as_ref().map(|(grid, film)| self.misfit(part, grid, film));
        for i in wanted {
            let (Some((grid, _)), Some(misfit)) = (&part.nodes[number], &misfit) else {
                continue;
            };
            let [x, y] = part.pixels(i);
            let columns = grid.cell(0, x[0])..=grid.cell(0, x[1]) + 1;
            let rows = grid.cell(1, y[0])..=grid.cell(1, y[1]) + 1;
            let worst = rows
                .flat_map(|row| &misfit[row * grid.size[0]..][columns.clone()])
                .fold(0.0f32, |worst, &value| worst.max(value));
            part.tiles[i].decided = f64::from(worst) <= NODES * self.tolerance;
            part.tiles[i].grid = if part.tiles[i].decided { number } else { number + 1 };
        }
    }

    /// By how much each node differs from what its neighbours of twice the distance would make of it: the largest over
    /// the channels in front of what is behind, and the transmittance.
    fn misfit(&self, part: &Part, grid: &Grid, film: &Film) -> Vec<f32> {
        let background = self.scene.background;
        let mut planes: Vec<Vec<f32>> = Vec::new();
        if let (Some(color), None) = (self.one, part.opaque) {
            // Everything follows from the transmittance.
            let spread = (0..3).map(|c| (color[c] - background[c]).abs()).fold(1.0, f32::max);
            planes.push(film.transmittance.iter().map(|&through| spread * through).collect());
        } else {
            for channel in 0..3 {
                let [low, high] = self.range[channel];
                for behind in if part.opaque.is_some() { vec![low, high] } else { vec![background[channel]] } {
                    let seen = film.color[channel].iter().zip(&film.transmittance);
                    planes.push(seen.map(|(&light, &through)| light + through * behind).collect());
                }
            }
            planes.push(film.transmittance.clone());
        }
        let mut misfit = vec![0.0; grid.size[0] * grid.size[1]];
        dispatch(self.level, Misfit { planes: &planes, width: grid.size[0], out: &mut misfit });
        misfit
    }

    /// Takes the nodes of the tiles that are content with a grid to their pixels.
    fn enlarge(&self, part: &Part, film: &mut Film) {
        let coefficients: Vec<Option<[Vec<f32>; 4]>> = part
            .nodes
            .iter()
            .enumerate()
            .map(|(number, nodes)| {
                let used = part.tiles.iter().any(|tile| tile.decided && tile.grid == number);
                let (grid, film) = nodes.as_ref().filter(|_| used)?;
                let [red, green, blue] = &film.color;
                let planes = [red, green, blue, &film.transmittance];
                let count = if self.one.is_some() { 3..4 } else { 0..4 };
                let mut out: [Vec<f32>; 4] = Default::default();
                out[count.clone()].par_iter_mut().zip(&planes[count]).for_each(|(out, plane)| {
                    *out = spline_coefficients(plane, grid.size);
                });
                Some(out)
            })
            .collect();
        let weights: Vec<[Vec<f32>; 4]> = part
            .nodes
            .iter()
            .map(|nodes| nodes.as_ref().map_or_else(Default::default, |(grid, _)| weights(grid)))
            .collect();
        let width = film.size[0];
        let bands: Vec<_> = tile::bands(width, TILE, &mut film.color, &mut film.transmittance).collect();
        bands.into_par_iter().enumerate().for_each(|(row, planes)| {
            let band = Enlarge { job: self, part, coefficients: &coefficients, weights: &weights, row, planes };
            dispatch(self.level, band);
        });
    }

    /// Draws the pixels of the tiles that are content with no grid.
    fn pixels(&self, part: &mut Part, film: &mut Film, ordered: &Ordered) {
        let mut mask = Mask::new(part.view.size.map(|n| n as usize));
        let mut any = false;
        for i in (0..part.tiles.len()).filter(|&i| !part.tiles[i].decided) {
            let [x, y] = part.pixels(i);
            mask.add([x[0], y[0]], [x[1], y[1]]);
            any = true;
        }
        if any {
            let prepared = self.gas.prepare(part.view, ordered);
            let canvas = Canvas { film, opaque: part.opaque, band: TILE, mask: Some(&mask), bare: false };
            part.work.add(&self.gas.draw(part.view, &prepared, canvas, self.level));
        }
    }
}

impl Part<'_> {
    /// First and last pixel of a tile, along both axes.
    fn pixels(&self, tile: usize) -> [[usize; 2]; 2] {
        let at = [tile % self.across, tile / self.across];
        [0, 1].map(|axis| [at[axis] * TILE, (at[axis] * TILE + TILE).min(self.view.size[axis] as usize) - 1])
    }

    /// The slabs' estimates of their errors at the nodes of the first grid.
    fn estimates(&self) -> impl Iterator<Item = f32> {
        self.nodes.first().into_iter().flatten().flat_map(|(_, film)| film.error.iter().flatten().copied())
    }

    /// Finds the least particle and the farthest gas of each tile; where that is cut by an opaque surface, the tile is left to
    /// its pixels.
    fn survey(&mut self, scene: &Scene, grid: &Grid, prepared: &Prepared) {
        let focal = self.view.focal_px().min_element();
        let steps: Vec<bool> = scene.particles.iter().map(|set| rim(&set.kernel) > STEP).collect();
        let down = self.tiles.len() / self.across;
        for seen in prepared.seen() {
            let radius = if steps[seen.set as usize] { 0.0 } else { seen.radius * focal };
            // A node stands for the pixels up to the next ones on either side.
            let tiles = |axis: usize, [first, last]: [u32; 2], count: usize| {
                let low = grid.first_pixel(axis, (first as usize).max(1) - 1).max(0) as usize / TILE;
                let high = grid.first_pixel(axis, last as usize + 1).max(0) as usize / TILE;
                low..=high.min(count - 1)
            };
            for y in tiles(1, seen.bounds.y, down) {
                for x in tiles(0, seen.bounds.x, self.across) {
                    let tile = &mut self.tiles[y * self.across + x];
                    tile.radius = tile.radius.min(radius);
                    tile.far = tile.far.max(seen.far);
                }
            }
        }
        let Some(layer) = self.opaque else { return };
        let width = self.view.size[0] as usize;
        for i in 0..self.tiles.len() {
            let [x, y] = self.pixels(i);
            let mut rows = (y[0]..=y[1]).map(|row| &layer.depth[row * width + x[0]..=row * width + x[1]]);
            let far = f64::from(self.tiles[i].far);
            if rows.any(|row| row.iter().any(|&depth| depth <= far)) {
                self.tiles[i].radius = 0.0;
            }
        }
    }
}

/// Compares nodes with their neighbours.
struct Misfit<'a> {
    planes: &'a [Vec<f32>],
    width: usize,
    out: &'a mut [f32],
}

impl WithSimd for Misfit<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let width = self.width;
        let rows = self.out.len() / width;
        let (near, far) = (s.splat(9.0 / 16.0), s.splat(1.0 / 16.0));
        for plane in self.planes {
            // Along x, then along y: distances in memory of one node.
            for (step, across, down) in [(1, 3..width.max(6) - 3, 0..rows), (width, 0..width, 3..rows.max(6) - 3)] {
                for y in down.clone() {
                    let mut x = across.start;
                    while x < across.end {
                        // The last vector overlaps the one before it; short rows are filled up.
                        let at = if across.len() >= S::LANES { x.min(across.end - S::LANES) } else { x };
                        let first = y * width + at;
                        let load = |offset: isize| {
                            let from = first.wrapping_add_signed(offset * step as isize);
                            let mut lanes = [0.0f32; 16];
                            let count = S::LANES.min(across.end - at);
                            if count == S::LANES {
                                return s.load(&plane[from..]);
                            }
                            lanes[..count].copy_from_slice(&plane[from..from + count]);
                            s.load(&lanes)
                        };
                        let inner = s.mul(s.add(load(-1), load(1)), near);
                        let expected = s.neg_mul_add(s.add(load(-3), load(3)), far, inner);
                        let off = s.sub(load(0), expected);
                        let mut lanes = [0.0f32; 16];
                        s.store(s.max(off, s.sub(s.splat(0.0), off)), &mut lanes);
                        for (out, &lane) in self.out[first..].iter_mut().zip(&lanes[..S::LANES.min(across.end - at)]) {
                            *out = out.max(lane);
                        }
                        x += S::LANES;
                    }
                }
            }
        }
    }
}

/// The coefficients of a cubic B-spline through nodes, to the fourth order and from next neighbours alone, so that nodes that were not
/// drawn are not asked.
fn spline_coefficients(nodes: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    // c = v - v''/6, along x and then along y; at the edges, which no pixel needs, the nodes themselves.
    let mut across = nodes.to_vec();
    for (out, row) in across.chunks_exact_mut(width).zip(nodes.chunks_exact(width)) {
        for (out, three) in out[1..].iter_mut().zip(row.windows(3)) {
            *out = (8.0 * three[1] - three[0] - three[2]) / 6.0;
        }
    }
    let mut out = across.clone();
    for y in 1..height - 1 {
        let [above, here, below] = [y - 1, y, y + 1].map(|y| &across[y * width..(y + 1) * width]);
        for (out, ((&above, &here), &below)) in out[y * width..].iter_mut().zip(above.iter().zip(here).zip(below)) {
            *out = (8.0 * here - above - below) / 6.0;
        }
    }
    out
}

/// Weights of the four nodes around a point at a share `t` of the way from the second to the third.
fn spline(t: f64) -> [f64; 4] {
    let u = 1.0 - t;
    [u * u * u / 6.0, (3.0 * t - 6.0) * t * t / 6.0 + 4.0 / 6.0, (3.0 * u - 6.0) * u * u / 6.0 + 4.0 / 6.0, t * t * t / 6.0]
}

/// The weights along x of the pixels from the first of a cell on, as many as a tile and a cell have.
fn weights(grid: &Grid) -> [Vec<f32>; 4] {
    let first = (grid.origin[0] - 0.5).ceil() + 0.5 - grid.origin[0];
    let mut out: [Vec<f32>; 4] = Default::default();
    for pixel in 0..TILE + grid.spacing + 16 {
        let weights = spline((first + (pixel % grid.spacing) as f64) / grid.spacing as f64);
        for (out, weight) in out.iter_mut().zip(weights) {
            out.push(weight as f32);
        }
    }
    out
}

/// Writes the pixels of a row of tiles from their grids.
struct Enlarge<'a, 'b> {
    job: &'a Job<'a>,
    part: &'a Part<'a>,
    coefficients: &'a [Option<[Vec<f32>; 4]>],
    weights: &'a [[Vec<f32>; 4]],
    row: usize,
    planes: [&'b mut [f32]; 4],
}

impl WithSimd for Enlarge<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, s: S) {
        // A row of coefficients, each as often as a cell has pixels.
        let mut spread = [[0.0f32; 2 * TILE + 4 * SPACINGS[0] + 16]; 4];
        for column in 0..self.part.across {
            let tile = &self.part.tiles[self.row * self.part.across + column];
            if !tile.decided {
                continue;
            }
            if let (Some((grid, _)), Some(coefficients)) =
                (&self.part.nodes[tile.grid], &self.coefficients[tile.grid])
            {
                let weights = &self.weights[tile.grid];
                self.tile(s, column, grid, coefficients, weights, &mut spread);
            }
        }
    }
}

impl Enlarge<'_, '_> {
    #[inline(always)]
    fn tile<S: Simd>(
        &mut self,
        s: S,
        column: usize,
        grid: &Grid,
        coefficients: &[Vec<f32>; 4],
        weights: &[Vec<f32>; 4],
        spread: &mut [[f32; 2 * TILE + 4 * SPACINGS[0] + 16]; 4],
    ) {
        let [x, y] = self.part.pixels(self.row * self.part.across + column);
        let width = self.part.view.size[0] as usize;
        let spacing = grid.spacing;
        let cell = grid.cell(0, x[0]);
        let skipped = (x[0] as isize - grid.first_pixel(0, cell)) as usize;
        let nodes = grid.cell(0, x[1]) - cell + 4;
        let background = self.job.scene.background;
        let used = if self.job.one.is_some() { 3..4 } else { 0..4 };
        for row in y[0]..=y[1] {
            let at = grid.cell(1, row);
            let share = (row as f64 + 0.5 - grid.origin[1]) / spacing as f64 - (at - MARGIN) as f64;
            let down = spline(share).map(|weight| weight as f32);
            for (plane, spread) in coefficients[used.clone()].iter().zip(&mut spread[used.clone()]) {
                let rows: [&[f32]; 4] =
                    std::array::from_fn(|i| &plane[(at - 1 + i) * grid.size[0] + cell - 1..][..nodes]);
                for node in 0..nodes {
                    let value: f32 = (0..4).map(|i| down[i] * rows[i][node]).sum();
                    spread[node * spacing..(node + 1) * spacing].fill(value);
                }
            }
            let line = row * width + x[0];
            let film = (row - y[0]) * width + x[0];
            let count = x[1] - x[0] + 1;
            for first in (0..count).step_by(S::LANES) {
                let from = skipped + first;
                let weight: [S::F; 4] = std::array::from_fn(|i| s.load(&weights[i][from..]));
                let mut values = [s.splat(0.0); 4];
                for (value, spread) in values[used.clone()].iter_mut().zip(&spread[used.clone()]) {
                    let mut sum = s.mul(weight[0], s.load(&spread[from..]));
                    for (i, &weight) in weight.iter().enumerate().skip(1) {
                        sum = s.mul_add(weight, s.load(&spread[from + i * spacing..]), sum);
                    }
                    *value = sum;
                }
                let through = s.min(s.max(values[3], s.splat(0.0)), s.splat(1.0));
                if let Some(color) = self.job.one {
                    let gas = s.sub(s.splat(1.0), through);
                    for (value, color) in values.iter_mut().zip(color) {
                        *value = s.mul(gas, s.splat(color));
                    }
                }
                let lanes = S::LANES.min(count - first);
                if lanes < S::LANES || self.part.opaque.is_some() {
                    self.some(s, &values, through, line + first, film + first, lanes);
                    continue;
                }
                for channel in 0..3 {
                    let [low, high] = self.job.range[channel];
                    let value = s.mul_add(through, s.splat(background[channel]), values[channel]);
                    let value = s.min(s.max(value, s.splat(low)), s.splat(high));
                    s.store(value, &mut self.planes[channel][film + first..]);
                }
                s.store(through, &mut self.planes[3][film + first..]);
            }
        }
    }

    /// Writes fewer pixels than a vector has lanes, or pixels that opaque surfaces may be behind.
    #[inline(always)]
    fn some<S: Simd>(&mut self, s: S, values: &[S::F; 4], through: S::F, line: usize, film: usize, lanes: usize) {
        let mut stored = [[0.0f32; 16]; 4];
        for (stored, &value) in stored.iter_mut().zip(&[values[0], values[1], values[2], through]) {
            s.store(value, stored);
        }
        for lane in 0..lanes {
            let hit = self.part.opaque.filter(|layer| layer.depth[line + lane] < f64::INFINITY);
            let behind = hit.map_or(self.job.scene.background, |layer| layer.color[line + lane]);
            let through = stored[3][lane];
            for channel in 0..3 {
                let [low, high] = self.job.range[channel];
                let value = stored[channel][lane] + through * behind[channel];
                self.planes[channel][film + lane] = value.max(low).min(high);
            }
            self.planes[3][film + lane] = if hit.is_some() { 0.0 } else { through };
        }
    }
}
