//! The sheet buffer: slices parallel to the image, the particles' segments added within each, the slices composited.
//!
//! Every tile goes through the slices from front to back on its own, with one slice's sums in memory at a time. A tile is
//! left when what lies behind can change no channel by more than the tolerance. No decision depends on the number of
//! threads.

use super::lists::bin_bands;
use super::segments::{LINE, Lookup, Place, Segments};
use super::simd::{Simd, WithSimd, dispatch};
use super::splat::{Bounds, Card, Frame as TileFrame, Lens};
use super::tile::{self, OpaqueTile, TILE, stop_transmittance, survey};
use super::{engine, order::Index};
use crate::render::opaque::OpaqueLayer;
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Kernel, Rgb, Scene, View};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Mutex;
use std::time::Instant;

/// How the gas is cut into slices.
#[derive(Clone, Copy, Debug)]
pub struct Slicing {
    /// Width of a slice, scene units, > 0. Slice k holds the depths from near + k width to near + (k + 1) width.
    pub width: f64,
    /// Number of pre-integrated segments of a kernel.
    pub segments: u32,
    /// How they are looked up.
    pub lookup: Lookup,
}

/// A particle before one eye.
pub struct Item {
    /// Where its disc stands.
    pub card: Card,
    /// Depth of its centre, scene units.
    pub depth: f64,
    /// Scene units.
    pub radius: f64,
    /// Optical depth through the centre.
    pub thickness: f32,
    /// Linear-light colour.
    pub color: Rgb,
    /// Number of the kernel's table.
    pub table: u32,
    /// First and last slice, whole numbers >= 0.
    pub slices: [f64; 2],
    /// The pixels that it covers, not empty.
    pub bounds: Bounds,
}

/// What is the same for all bands of a view.
struct Job<'a> {
    view: &'a View,
    opaque: Option<&'a OpaqueLayer>,
    background: Rgb,
    slicing: Slicing,
    tables: &'a [Segments],
    /// By first slice, then by index.
    items: &'a [Item],
    color_range: [[f32; 2]; 3],
    tolerance: f32,
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw(slicing: Slicing, frame: Frame, progress: &dyn Progress) -> Statistics {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let (numbers, tables) = tables(scene, slicing);
    let color_range = engine::colors(scene).range;
    let prepared = Instant::now();

    let items: Vec<Vec<Item>> =
        views.iter().map(|view| items(scene, &Lens::new(view), slicing.width, &numbers)).collect();
    let sorted = Instant::now();

    let down = (views[0].size[1] as usize).div_ceil(TILE);
    let lists: Vec<Vec<Vec<u32>>> = items
        .iter()
        .map(|items| {
            let bounds: Vec<Bounds> = items.iter().map(|item| item.bounds).collect();
            let mut lists = vec![Vec::new(); down];
            bin_bands(&[&bounds], 0..bounds.len(), TILE, &mut lists);
            lists
        })
        .collect();
    let jobs: Vec<Job> = views
        .iter()
        .zip(opaque)
        .zip(&items)
        .map(|((view, opaque), items)| Job {
            view,
            opaque: opaque.as_ref(),
            background: scene.background,
            slicing,
            tables: &tables,
            items,
            color_range,
            tolerance: options.tolerance as f32,
        })
        .collect();
    let binned = Instant::now();

    let mut bands = Vec::new();
    for ((film, job), lists) in films.iter_mut().zip(&jobs).zip(&lists) {
        let planes = tile::bands(film.size[0], TILE, &mut film.color, &mut film.transmittance);
        for ((number, list), planes) in lists.iter().enumerate().zip(planes) {
            bands.push(Band { job, list, y: number * TILE, film: planes });
        }
    }
    let total = bands.len() as u64;
    let done = Mutex::new((0, 0));
    bands.into_par_iter().for_each(|band| {
        let fragments = dispatch(options.level, band);
        // Told while the lock is held, so that what is told only grows. A panic elsewhere is no reason for another.
        let mut done = done.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *done = (done.0 + 1, done.1 + fragments);
        progress.update(done.0, total);
    });
    let (_, fragments) = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    Statistics {
        stages: vec![
            ("prepare", prepared - start),
            ("order", sorted - prepared),
            ("bin", binned - sorted),
            ("raster", binned.elapsed()),
        ],
        fragments,
        prepared: items.iter().map(|items| items.len() as u64).sum(),
        ..Statistics::default()
    }
}

/// The tables of a scene's kernels, each once, and for every set the number of its own.
pub fn tables(scene: &Scene, slicing: Slicing) -> (Vec<u32>, Vec<Segments>) {
    let mut kernels: Vec<&Kernel> = Vec::new();
    let numbers = scene.particles.iter().map(|set| {
        let known = kernels.iter().position(|kernel| *kernel == &set.kernel);
        known.unwrap_or_else(|| {
            kernels.push(&set.kernel);
            kernels.len() - 1
        }) as u32
    });
    let numbers = numbers.collect();
    let tables = kernels.into_iter().map(|kernel| Segments::new(kernel, slicing.segments, slicing.lookup)).collect();
    (numbers, tables)
}

/// The particles that a view shows, by first slice, then by index; slices are `width` > 0 wide, and `numbers` holds the table
/// of each set.
pub fn items(scene: &Scene, lens: &Lens, width: f64, numbers: &[u32]) -> Vec<Item> {
    let index = Index::new(scene);
    let mut items: Vec<Item> = (0..scene.particle_count() as u32)
        .into_par_iter()
        .filter_map(|id| {
            let (number, i) = index.locate(id);
            let set = &scene.particles[number];
            let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
            let opacity = set.opacity.get(i);
            let thickness = -(-opacity).ln_1p();
            let item = prepare(lens, lens.view.eye_from_point(point), set.radius.get(i), width)?;
            (opacity > 0.0).then_some(Item {
                thickness: thickness as f32,
                color: set.color.get(i),
                table: numbers[number],
                ..item
            })
        })
        .collect();
    // Stable: in the order of their indices within a slice, whatever the threads did.
    items.par_sort_by(|a, b| a.slices[0].total_cmp(&b.slices[0]));
    items
}

/// Where a particle stands; `None` where it shows nothing. Opacity, colour and table are the caller's.
fn prepare(lens: &Lens, center: DVec3, radius: f64, width: f64) -> Option<Item> {
    let (depth, near) = (-center.z, lens.view.near);
    if depth + radius <= near {
        return None;
    }
    // A billboard nearer than the near plane would grow beyond all bounds: it stands there.
    let (card, bounds) = Card::new(lens, center, radius, depth.max(near));
    let slice = |depth: f64| ((depth - near) / width).floor();
    let slices = [slice((depth - radius).max(near)), slice(depth + radius)];
    (!bounds.is_empty()).then_some(Item {
        card,
        depth,
        radius,
        thickness: 0.0,
        color: [0.0; 3],
        table: 0,
        slices,
        bounds,
    })
}

/// One band of tiles.
struct Band<'a> {
    job: &'a Job<'a>,
    /// Items that touch it, in their order.
    list: &'a [u32],
    /// First row of pixels.
    y: usize,
    film: [&'a mut [f32]; 4],
}

/// Samples of a tile.
const AREA: usize = TILE * TILE;

/// A tile at work: planes of [`AREA`] values, rows of [`TILE`].
struct Tile {
    /// Sums of the slice: colour weighted with opacity, then opacity.
    sums: [Vec<f32>; 4],
    /// Colour so far and transmittance.
    state: [Vec<f32>; 4],
    /// Depth of the opaque surface.
    limit: Vec<f32>,
}

impl WithSimd for Band<'_> {
    /// Fragments computed.
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, s: S) -> u64 {
        let width = self.job.view.size[0] as usize;
        let mut lists = vec![Vec::new(); width.div_ceil(TILE)];
        for &i in self.list {
            let [first, last] = self.job.items[i as usize].bounds.x.map(|x| x as usize / TILE);
            for list in &mut lists[first..=last] {
                list.push(i);
            }
        }
        let planes = || [0; 4].map(|_| vec![0.0f32; AREA]);
        let mut tile = Tile { sums: planes(), state: planes(), limit: vec![f32::INFINITY; AREA] };
        let mut fragments = 0;
        for (number, list) in lists.iter().enumerate() {
            fragments += self.draw(s, &mut tile, number * TILE, list);
        }
        fragments
    }
}

impl Band<'_> {
    /// Draws the tile whose first column is `x`.
    #[inline(always)]
    fn draw<S: Simd>(&mut self, s: S, tile: &mut Tile, x: usize, list: &[u32]) -> u64 {
        let job = self.job;
        let width = job.view.size[0] as usize;
        let at = [x, self.y];
        let size = [TILE.min(width - x), self.film[0].len() / width];
        let frame = TileFrame::new(job.view, x as u32, self.y as u32);
        let opaque = job.opaque.map(|layer| survey(layer, job.background, width, at, size));
        for plane in &mut tile.state[..3] {
            plane.fill(0.0);
        }
        // What lies beyond the picture's edge is full from the start, so that no tile waits for it.
        tile.state[3].fill(0.0);
        tile.limit.fill(f32::INFINITY);
        for y in 0..size[1] {
            tile.state[3][y * TILE..][..size[0]].fill(1.0);
            if let Some(layer) = job.opaque {
                let depths = &layer.depth[(self.y + y) * width + x..][..size[0]];
                for (limit, &depth) in tile.limit[y * TILE..].iter_mut().zip(depths) {
                    *limit = depth as f32;
                }
            }
        }
        let fragments = self.slices(s, tile, at, &frame, opaque.as_ref(), list);
        self.develop(tile, at, size);
        fragments
    }

    /// Goes through the slices of a tile.
    #[inline(always)]
    fn slices<S: Simd>(
        &self,
        s: S,
        tile: &mut Tile,
        at: [usize; 2],
        frame: &TileFrame,
        opaque: Option<&OpaqueTile>,
        list: &[u32],
    ) -> u64 {
        let job = self.job;
        let stop = stop_transmittance(job.tolerance, &job.color_range, job.background, opaque);
        let [nearest, farthest] = opaque.map_or([f32::INFINITY; 2], |opaque| [opaque.nearest, opaque.farthest]);
        let Slicing { width, .. } = job.slicing;
        let mut fragments = 0;
        let mut waiting = list.iter().map(|&i| &job.items[i as usize]).peekable();
        let mut active: Vec<&Item> = Vec::new();
        let mut slice = 0.0f64;
        loop {
            active.retain(|item| item.slices[1] >= slice);
            if active.is_empty() {
                // On to the next slice that holds anything.
                let Some(next) = waiting.peek() else { break };
                slice = slice.max(next.slices[0]);
            }
            while let Some(item) = waiting.next_if(|item| item.slices[0] <= slice) {
                active.push(item);
            }
            let ends = [slice, slice + 1.0].map(|k| job.view.near + k * width);
            if ends[0] as f32 >= farthest {
                break;
            }
            let cut = ends[1] as f32 >= nearest;
            let mut touched = Touched::default();
            for item in &active {
                let [from, to] = ends.map(|depth| (depth - item.depth) / item.radius);
                let segments = &job.tables[item.table as usize];
                let start = segments.line(from, item.thickness);
                let area = Area::new::<S>(item, at);
                if cut {
                    let piece = Cut { segments, start: &start, ends: [from, to], limit: &tile.limit };
                    add(s, item, frame, &area, &piece, &mut tile.sums);
                } else {
                    let mut line = segments.line(to, item.thickness);
                    for (value, start) in line.iter_mut().zip(start) {
                        *value -= start;
                    }
                    add(s, item, frame, &area, &line, &mut tile.sums);
                }
                touched.add(&area);
                fragments += area.count() as u64;
            }
            composite(s, tile, &touched);
            if tile.state[3].iter().all(|&through| through <= stop) {
                break;
            }
            slice += 1.0;
        }
        fragments
    }

    /// Writes a tile to the film: colour over what is behind, and transmittance to the background.
    fn develop(&mut self, tile: &Tile, at: [usize; 2], size: [usize; 2]) {
        let width = self.job.view.size[0] as usize;
        for y in 0..size[1] {
            for x in 0..size[0] {
                let (from, to) = (y * TILE + x, y * width + at[0] + x);
                let through = tile.state[3][from];
                let surface = self.job.opaque.and_then(|layer| {
                    let place = (at[1] + y) * width + at[0] + x;
                    (layer.depth[place] < f64::INFINITY).then(|| layer.color[place])
                });
                let behind = surface.unwrap_or(self.job.background);
                for (channel, behind) in behind.into_iter().enumerate() {
                    self.film[channel][to] = tile.state[channel][from] + through * behind;
                }
                self.film[3][to] = if surface.is_some() { 0.0 } else { through };
            }
        }
    }
}

/// The rows of a tile that a particle covers, and the columns in whole vectors; ends are exclusive.
struct Area {
    x: [usize; 2],
    y: [usize; 2],
}

impl Area {
    fn new<S: Simd>(item: &Item, at: [usize; 2]) -> Self {
        let inside = |[first, last]: [u32; 2], origin: usize| {
            [(first as usize).saturating_sub(origin), (last as usize - origin).min(TILE - 1) + 1]
        };
        let (x, y) = (inside(item.bounds.x, at[0]), inside(item.bounds.y, at[1]));
        Self { x: [x[0] / S::LANES * S::LANES, x[1].next_multiple_of(S::LANES)], y }
    }

    fn count(&self) -> usize {
        (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])
    }
}

/// What of a tile a slice has touched.
struct Touched(Area);

impl Default for Touched {
    fn default() -> Self {
        Self(Area { x: [TILE, 0], y: [TILE, 0] })
    }
}

impl Touched {
    fn add(&mut self, area: &Area) {
        for (own, other) in [(&mut self.0.x, area.x), (&mut self.0.y, area.y)] {
            *own = [own[0].min(other[0]), own[1].max(other[1])];
        }
    }
}

/// The opacity of a segment over a particle's disc.
trait Piece {
    /// Of the samples of the tile from number `sample`, which stand at `place` in the table.
    fn opacity<S: Simd>(&self, s: S, item: &Item, sample: usize, place: Place<S::F>) -> S::F;
}

/// A whole segment, over the table's y.
impl Piece for [f32; LINE] {
    #[inline(always)]
    fn opacity<S: Simd>(&self, s: S, _: &Item, _: usize, place: Place<S::F>) -> S::F {
        place.of(s, self)
    }
}

/// A segment that opaque surfaces may cut.
struct Cut<'a> {
    segments: &'a Segments,
    /// What lies before the segment.
    start: &'a [f32; LINE],
    /// Its ends, signed distances from the centre over the radius.
    ends: [f64; 2],
    limit: &'a [f32],
}

impl Piece for Cut<'_> {
    #[inline(always)]
    fn opacity<S: Simd>(&self, s: S, item: &Item, sample: usize, place: Place<S::F>) -> S::F {
        let [from, to] = self.ends.map(|end| s.splat(end.clamp(-1.0, 1.0) as f32));
        let limit = s.sub(s.load(&self.limit[sample..]), s.splat(item.depth as f32));
        let end = s.max(s.min(s.mul(limit, s.splat((1.0 / item.radius) as f32)), to), from);
        let whole = s.mul(self.segments.values(s, place, end), s.splat(item.thickness));
        // Where the surface stands before the segment, the difference is rounding.
        let value = s.max(s.sub(whole, place.of(s, self.start)), s.splat(0.0));
        s.keep(s.less(from, end), value)
    }
}

/// Adds a particle's segment to the slice.
#[inline(always)]
fn add<S: Simd>(s: S, item: &Item, frame: &TileFrame, area: &Area, piece: &impl Piece, sums: &mut [Vec<f32>; 4]) {
    let (mut columns, mut rows) = ([0.0f32; TILE], [0.0f32; TILE]);
    for (axis, squares) in [&mut columns, &mut rows].into_iter().enumerate() {
        for (block, squares) in squares.chunks_exact_mut(S::LANES).enumerate() {
            let centre = s.add(s.ramp(), s.splat((block * S::LANES) as f32 + 0.5));
            s.store(item.card.offset_squared(s, frame, axis, centre), squares);
        }
    }
    let color = item.color.map(|value| s.splat(value));
    let [red, green, blue, opacity] = sums;
    for (y, &row) in rows.iter().enumerate().take(area.y[1]).skip(area.y[0]).filter(|(_, row)| **row < 1.0) {
        for x in (area.x[0]..area.x[1]).step_by(S::LANES) {
            let place = y * TILE + x;
            let square = s.add(s.load(&columns[x..]), s.splat(row));
            let value = piece.opacity(s, item, place, Place::new(s, square));
            for (plane, color) in [&mut *red, &mut *green, &mut *blue].into_iter().zip(color) {
                let sum = s.mul_add(value, color, s.load(&plane[place..]));
                s.store(sum, &mut plane[place..]);
            }
            let sum = s.add(value, s.load(&opacity[place..]));
            s.store(sum, &mut opacity[place..]);
        }
    }
}

/// Composites the slice behind those before it and clears it. An opacity above 1 becomes 1, and the colour is scaled with it.
#[inline(always)]
fn composite<S: Simd>(s: S, tile: &mut Tile, touched: &Touched) {
    let Touched(Area { x, y }) = touched;
    let one = s.splat(1.0);
    for y in y[0]..y[1] {
        for x in (x[0]..x[1]).step_by(S::LANES) {
            let place = y * TILE + x;
            let sum = s.load(&tile.sums[3][place..]);
            let through = s.load(&tile.state[3][place..]);
            let scale = s.div(through, s.max(sum, one));
            for channel in 0..3 {
                let light = s.load(&tile.sums[channel][place..]);
                let state = s.mul_add(light, scale, s.load(&tile.state[channel][place..]));
                s.store(state, &mut tile.state[channel][place..]);
            }
            s.store(s.neg_mul_add(through, s.min(sum, one), through), &mut tile.state[3][place..]);
            for plane in &mut tile.sums {
                s.store(s.splat(0.0), &mut plane[place..]);
            }
        }
    }
}
