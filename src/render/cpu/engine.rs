//! The tile engine: order, batches, preparation, bands. Generic over the method ([`Alignment`]).
//!
//! Particles are taken nearest first, of one colour about so, in batches; a batch is prepared for every view that shares the
//! order, then every band of tiles rasterises it. When all tiles are opaque enough, the remaining batches are never looked at. The picture
//! does not depend on the number of threads: no decision does.

use super::adaptive::Spare;
use super::composite::{Composite, Many, OneExponential, OneLinear};
use super::dense;
use super::footprint::{Table, Tables};
use super::laps::Laps;
use super::lists::{self, Lists, are_common, list_bands};
use super::order::{Index, Key, Order, Storage};
use super::simd::{Level, dispatch};
use super::splat::{Alignment, Bounds, Item, Kind, Lens};
use super::thin::{self, Thin};
use super::tile::{self, Band, BandJob, Batch, Counts, Prospect, Status, TILE, spread, stop_transmittance};
use crate::picture::Film;
use crate::render::opaque::{NO_RANGE, OpaqueLayer};
use crate::render::{Frame, OpacityModel, Options, Progress, Statistics};
use crate::scene::{Attribute, Kernel, Rgb, Scene, View, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::any::Any;
use std::marker::PhantomData;
use std::time::{Duration, Instant};

/// Particles in the first batch; later ones grow, up to [`LARGEST_BATCH`].
const FIRST_BATCH: usize = 1 << 14;
/// Particles that are prepared at once, at the most: about 50 MB for each view that shares their order.
const LARGEST_BATCH: usize = 1 << 19;
/// Particles up to which gas is asked where it is thin, for which all are prepared at once: more no longer fit into caches, which costs
/// as much as it returns.
const THIN_BATCH: usize = 1 << 17;

/// Wall times of the stages. Lists of tiles and fragments are made by the same tasks: the wall time of those is shared out by what each
/// took of them, waiting for lists that another makes included.
#[derive(Default)]
struct Times {
    prepare: Duration,
    order: Duration,
    transform: Duration,
    bin: Duration,
    raster: Duration,
}

/// Memory that is kept from frame to frame, so that frames after the first touch no new pages.
#[derive(Default)]
pub struct Memory {
    pub(in crate::render) order: Storage,
    tables: Tables,
    state: Vec<f32>,
    ids: Vec<u32>,
    bounds: Vec<Vec<Bounds>>,
    lists: lists::Storage,
    /// `Vec<Vec<Item<_>>>` of the method that drew last.
    items: Option<Box<dyn Any + Send>>,
    /// Of [`super::adaptive`].
    pub(super) nodes: Spare,
}

impl Memory {
    fn take_items<T: Send + 'static>(&mut self) -> Vec<Vec<Item<T>>> {
        self.items.take().and_then(|items| items.downcast().ok()).map_or_else(Vec::new, |items| *items)
    }
}

/// Which affine footprints were drawn ([`thin`]).
#[derive(Clone, Copy, Debug, Default)]
pub struct Affine {
    /// How many, over all views.
    pub count: u64,
    /// What a channel is off by that at the most.
    pub error: f64,
    /// Their share of the pixels that all particles cover, each for itself.
    pub share: f64,
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw<A: Alignment>(alignment: A, frame: Frame, progress: &dyn Progress) -> Statistics {
    draw_within(alignment, 0.0, frame, progress).0
}

/// The same with affine footprints, where the method has them and that takes no more than a share of the tolerance. Nothing may cut the
/// gas.
pub fn draw_within<A: Alignment>(
    alignment: A,
    affine_share: f64,
    frame: Frame,
    progress: &dyn Progress,
) -> (Statistics, Affine) {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, encoded, memory } = frame;
    debug_assert!(affine_share == 0.0 || opaque.iter().all(Option::is_none), "affine footprints are never cut");
    let mut encoded: Vec<&mut [[u8; 4]]> = encoded.iter_mut().map(|frame| &mut frame.pixels[..]).collect();
    let is_encoded = !encoded.is_empty();
    encoded.resize_with(views.len(), Default::default);
    let job = Job::new::<A>(scene, options, memory);
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let most = affine_share * options.tolerance / job.spread();
    let thin = job.thin_cells(alignment, &views[0], most).map(|cells| (cells, most));
    let mut affine = Vec::new();
    let mut statistics = Statistics::default();
    let shared = job.key::<A>() == Key::Depth && stereo::share_depth(views);
    let size = if shared { views.len() } else { 1 };
    for first in (0..views.len()).step_by(size) {
        let mut group = Group {
            views: &views[first..first + size],
            opaque: &opaque[first..first + size],
            films: &mut films[first..first + size],
            encoded: &mut encoded[first..first + size],
            thin,
            affine: &mut affine,
            memory,
            times: &mut times,
            statistics: &mut statistics,
            before: (first, views.len()),
            progress,
        };
        let one = job.colors.one.is_some();
        if A::VOLUMETRIC || job.model == OpacityModel::Exponential {
            if one {
                job.draw::<A, OneExponential, 4>(alignment, &mut group);
            } else {
                job.draw_many::<A, true>(alignment, &mut group);
            }
        } else if !A::VOLUMETRIC {
            if one {
                job.draw::<A, OneLinear, 4>(alignment, &mut group);
            } else {
                job.draw_many::<A, false>(alignment, &mut group);
            }
        }
    }
    job.recycle(memory);
    statistics.encoded = is_encoded;
    let Times { prepare, order, transform, bin, raster } = times;
    statistics.stages =
        vec![("prepare", prepare), ("order", order), ("transform", transform), ("bin", bin), ("raster", raster)];
    let mut sum = Affine::default();
    for of_view in &affine {
        sum.count += of_view.count;
        sum.error = sum.error.max(of_view.error);
        sum.share += of_view.share / views.len() as f64;
    }
    (statistics, sum)
}

/// Views that share an order, and where they are drawn.
struct Group<'a, 'b> {
    views: &'a [View],
    opaque: &'a [Option<OpaqueLayer>],
    films: &'a mut [Film],
    /// Pixels of 8 bits, or nothing, for each.
    encoded: &'a mut [&'b mut [[u8; 4]]],
    /// Where affine footprints are likely to be worth it: pixels of the cells by which gas is found to be thin, and what optical depth
    /// may be off.
    thin: Option<([usize; 2], f64)>,
    /// Those that were drawn, by view.
    affine: &'a mut Vec<Affine>,
    memory: &'a mut Memory,
    times: &'a mut Times,
    statistics: &'a mut Statistics,
    /// Views that are drawn already, and all views.
    before: (usize, usize),
    progress: &'a dyn Progress,
}

impl Group<'_, '_> {
    fn tell(&self, done: usize, total: usize) {
        let total = total.max(1);
        let (before, all) = self.before;
        self.progress.update((before * total + self.views.len() * done) as u64, (all * total) as u64);
    }
}

/// What is the same for all groups of a frame. The GPU path prepares its particles by it too.
pub(in crate::render) struct Job<'a> {
    pub scene: &'a Scene,
    pub options: &'a Options,
    /// Opacity model in force.
    pub model: OpacityModel,
    pub index: Index,
    pub colors: Colors,
    /// One per set.
    footprints: Vec<Table>,
    /// One per set; absent where the particles of the set have opacities of their own.
    amplitudes: Vec<Option<[f32; 2]>>,
    pub tables: Tables,
}

impl<'a> Job<'a> {
    /// What a method needs of a scene.
    pub fn new<A: Alignment>(scene: &'a Scene, options: &'a Options, memory: &mut Memory) -> Self {
        // Footprint tables stay from frame to frame.
        let mut tables = std::mem::take(&mut memory.tables);
        let model = if A::VOLUMETRIC { OpacityModel::Exponential } else { options.opacity_model };
        Self {
            scene,
            options,
            model,
            index: Index::new(scene),
            colors: colors(scene),
            footprints: scene
                .particles
                .iter()
                .map(|set| if A::KERNELS { tables.table(&set.kernel) } else { Table::default() })
                .collect(),
            amplitudes: scene
                .particles
                .iter()
                .map(|set| match set.opacity {
                    Attribute::Uniform(opacity) => Some(amplitude(opacity, model)),
                    Attribute::Each(_) => None,
                })
                .collect(),
            tables,
        }
    }

    /// What particles are ordered by. Products of transmittances do not ask for an order: of one colour it is that which eyes share.
    pub fn key<A: Alignment>(&self) -> Key {
        if self.colors.one.is_some() { Key::Depth } else { A::KEY }
    }

    /// Gives the tables back for the next frame.
    pub fn recycle(self, memory: &mut Memory) {
        memory.tables = self.tables;
    }
}

impl Job<'_> {
    /// Four planes of state: as many rows per register block as the registers hold.
    fn draw_many<A: Alignment, const EXPONENTIAL: bool>(&self, alignment: A, group: &mut Group) {
        if self.options.level == Level::Avx512 {
            self.draw::<A, Many<EXPONENTIAL>, 4>(alignment, group);
        } else {
            self.draw::<A, Many<EXPONENTIAL>, 2>(alignment, group);
        }
    }

    /// Draws a group with one variant of compositing and `R` rows per register block.
    fn draw<A: Alignment, C: Composite, const R: usize>(&self, alignment: A, group: &mut Group) {
        let start = Instant::now();
        let views = group.views;
        let level = self.options.level;
        let mut order =
            Order::new(self.scene, &self.index, views, self.key::<A>(), A::VOLUMETRIC, level, &mut group.memory.order);
        if self.colors.one.is_some() {
            order.any();
        }
        group.times.order += start.elapsed();
        let [width, height] = views[0].size.map(|size| size as usize);
        let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut tiles = vec![Status::NEW; views.len() * across * down];
        // To know where gas is thin all of it is prepared at once.
        let mut wanted = if group.thin.is_some() { THIN_BATCH } else { FIRST_BATCH };
        // What one batch draws goes straight to the film; else states wait for the next batch.
        let band_state = if order.len() <= wanted { 0 } else { across * TILE * TILE * C::PLANES };
        let mut state = std::mem::take(&mut group.memory.state);
        // An older frame's states are overwritten by the first batch. New memory comes as zeros, untouched.
        if state.len() < views.len() * down * band_state + 16 {
            state = vec![0.0; views.len() * down * band_state + 16];
        }
        let aligned = state.as_ptr().align_offset(64).min(16);
        let mut items = group.memory.take_items::<A::Splat>();
        items.resize(views.len(), Vec::new());
        let mut bounds = std::mem::take(&mut group.memory.bounds);
        bounds.resize(views.len(), Vec::new());
        let mut storage = std::mem::take(&mut group.memory.lists);
        let mut ids = std::mem::take(&mut group.memory.ids);

        let (mut first, mut dense) = (true, false);
        let mut given = 0;
        loop {
            let start = Instant::now();
            ids.clear();
            order.next_batch(wanted, &mut ids);
            if first && C::DEPTH.is_some() {
                // What is left of balls after a batch is drawn before the next: better one batch that makes the picture opaque.
                let missing = self.missing::<A, C>(alignment, &views[0], &ids);
                dense = missing.is_some();
                order.next_batch(missing.unwrap_or(0), &mut ids);
            }
            given += ids.len();
            let last = order.is_exhausted();
            debug_assert!(last || group.thin.is_none(), "what may be off is spent by one batch");
            let sorted = Instant::now();
            let common = if self.are_common(alignment, views, &ids) { views.len() } else { 1 };
            let prepared: Vec<(Laps<2>, Affine)> = items
                .par_iter_mut()
                .zip(bounds.par_iter_mut())
                .zip(storage.of_views(views.len(), down).par_iter_mut())
                .zip(views)
                .zip(tiles.par_chunks(across * down))
                .map(|((((items, bounds), bands), view), status)| {
                    let mut laps = Laps::default();
                    let tiles = Tiles { status, across };
                    let affine = laps.time(0, || {
                        self.prepare(alignment, view, &ids, &tiles, items, bounds);
                        let (items, bounds) = (&mut items[..ids.len()], &bounds[..ids.len()]);
                        group.thin.map_or(Affine::default(), |thin| self.flatten::<A>(view.size, thin, items, bounds))
                    });
                    if common == 1 {
                        laps.time(1, || list_bands(&[&bounds[..ids.len()]], bands));
                    }
                    (laps, affine)
                })
                .collect();
            let transformed = Instant::now();
            let (laps, affine): (Vec<_>, Vec<_>) = prepared.into_iter().unzip();
            let [transform, own_bands] = Laps::shares(&laps, transformed - sorted);
            let batch = Batch {
                level,
                tables: self.tables.values(),
                background: self.scene.background,
                color: self.colors.one.unwrap_or_default(),
                color_range: self.colors.range,
                dense,
                first,
                last,
            };
            let prospects: Vec<Prospect<A::Splat>> = views
                .iter()
                .enumerate()
                .map(|(v, view)| Prospect {
                    view,
                    items: &items[v][..ids.len()],
                    bounds: &bounds[v][..ids.len()],
                    opaque: group.opaque[v].as_ref(),
                    affine: affine[v].count > 0,
                    tolerance: (self.options.tolerance - affine[v].error) as f32,
                })
                .collect();
            if first {
                group.affine.extend(&affine);
            }
            let lists = Lists::new(&batch, (&prospects, common), &tiles, [across, down], C::DEPTH, &mut storage);
            let listed = Instant::now();
            let bands =
                split(group.films, group.encoded, &mut state[aligned..], &mut tiles, [across, down], band_state);
            let mut jobs = Vec::with_capacity(views.len() * down);
            for (view, mut bands) in bands.into_iter().enumerate() {
                // Of two views with lists in common each begins at another end, so that they seldom wait for each other's.
                if view % lists.common() == 1 {
                    bands.reverse();
                }
                jobs.extend(bands.into_iter().map(|band| (view, band)));
            }
            let drawn = jobs.into_par_iter().map(|(view, mut band)| {
                let start = Instant::now();
                lists.with(view, band.y as usize / TILE, |lists| {
                    band.counts.bin_ns += start.elapsed().as_nanos() as u64;
                    let (batch, prospect, band) = (&batch, &prospects[view], &mut band);
                    dispatch(level, BandJob::<A, C, R> { batch, prospect, lists, band, composite: PhantomData });
                });
                band.counts
            });
            let counts = drawn.reduce(Counts::default, |mut sum, counts| {
                sum.add(&counts);
                sum
            });
            lists.recycle();
            let wall = listed.elapsed();
            let bin = wall.mul_f64(counts.bin_ns as f64 / (counts.bin_ns + counts.raster_ns).max(1) as f64);
            let times = &mut *group.times;
            times.order += sorted - start;
            times.transform += transform;
            times.bin += own_bands + (listed - transformed) + bin;
            times.raster += wall - bin;
            group.statistics.fragments += counts.fragments;
            group.statistics.prepared += (ids.len() * views.len()) as u64;
            group.tell(given, order.len());
            if last || tiles.iter().all(|tile| tile.finished) {
                break;
            }
            first = false;
            wanted = (wanted + wanted / 2).min(LARGEST_BATCH);
        }
        group.tell(1, 1);
        order.recycle(&mut group.memory.order);
        group.memory.state = state;
        group.memory.items = Some(Box::new(items));
        group.memory.bounds = bounds;
        group.memory.lists = storage;
        group.memory.ids = ids;
    }

    /// Whether views of a batch are better off with lists in common ([`are_common`]), by a sample.
    fn are_common<A: Alignment>(&self, alignment: A, views: &[View], ids: &[u32]) -> bool {
        const SAMPLE: usize = 64;
        if views.len() == 1 {
            return false;
        }
        let stride = ids.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<Vec<Bounds>> = views
            .iter()
            .map(|view| {
                let lens = Lens::new(view);
                let bounds = |&id| self.prepare_id(alignment, &lens, id).map_or(Bounds::EMPTY, |(_, bounds)| bounds);
                ids.iter().step_by(stride).map(bounds).collect()
            })
            .collect();
        are_common(&sample, stride)
    }

    /// How many particles beside the first ones are likely to make a picture opaque by their cores ([`dense`]), if they are like them;
    /// `None` if they are more than three times as many. A sample tells.
    fn missing<A: Alignment, C: Composite>(&self, alignment: A, view: &View, ids: &[u32]) -> Option<usize> {
        let depth_of_one = C::DEPTH?;
        const SAMPLE: usize = 256;
        const MISSING: f32 = 3.0;
        let lens = Lens::new(view);
        let stride = ids.len().div_ceil(SAMPLE).max(1);
        let depth = |&id: &u32| {
            let (item, bounds) = self.prepare_id(alignment, &lens, id)?;
            Some(depth_of_one * item.amplitude * bounds.pixels() as f32)
        };
        let sum: f32 = ids.iter().step_by(stride).filter_map(depth).sum::<f32>() * stride as f32;
        let stop = stop_transmittance(self.options.tolerance as f32, &self.colors.range, self.scene.background, None);
        let pixels = view.size.map(|size| size as usize).iter().product();
        // Infinite, or no number, where nothing hides anything.
        let missing = (dense::goal(pixels, -stop.log2()) / sum - 1.0).max(0.0);
        (missing < MISSING).then_some((missing * ids.len() as f32) as usize)
    }

    /// The most that a channel may change with the optical depth where no opaque surface is seen.
    fn spread(&self) -> f64 {
        spread(&self.colors.range, self.scene.background, None).into()
    }

    /// Pixels of the cells by which gas is found to be thin, if it is likely to be worth it: by a sample. `most`: what optical depth may
    /// be off.
    fn thin_cells<A: Alignment>(&self, alignment: A, view: &View, most: f64) -> Option<[usize; 2]> {
        /// Parts of the picture, along x and y.
        const PARTS: [usize; 2] = [4, 3];
        /// Where the mean over a part of what balls may be off is more than this share of what they may, little of it is thin.
        const CROWDED: f64 = 0.7;
        /// Share of the balls that are to be where gas is thin.
        const WORTH: f64 = 0.3;
        /// Pixels along a side of a ball, in the mean, below which its fragments are too few to be worth it.
        const SMALL: f64 = 16.0;
        if most <= 0.0 || self.scene.particle_count() > THIN_BATCH || self.model != OpacityModel::Exponential {
            return None;
        }
        let lens = Lens::new(view);
        let (stride, sample) = self.index.sample();
        // How many balls there are in each part, what they are off in its mean, and how many pixels they cover.
        let mut parts = [[0.0; 3]; PARTS[0] * PARTS[1]];
        let share = (stride * parts.len()) as f64 / view.size.map(f64::from).iter().product::<f64>();
        let mut seen = 0.0;
        for (number, i) in sample {
            let set = &self.scene.particles[number];
            let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
            if -view.eye_from_point(point).z <= view.near {
                continue;
            }
            let Some((item, bounds)) = self.prepare_one(alignment, &lens, number, i, point) else { continue };
            seen += 1.0;
            let (error, pixels) = (Self::affine_error::<A>(&item, &bounds), bounds.pixels() as f64);
            if thin::is_small(error, most) {
                let at = |[first, last]: [u32; 2], axis: usize| {
                    (first + last) as usize * PARTS[axis] / (2 * view.size[axis] as usize)
                };
                let part = &mut parts[at(bounds.y, 1) * PARTS[0] + at(bounds.x, 0)];
                // As cells see it, which are no smaller than blocks.
                let [wide, high] = [(bounds.x, 15), (bounds.y, 3)].map(|([first, last], more)| last + 1 - first + more);
                let more = [1.0, error * f64::from(wide) * f64::from(high) * share, pixels];
                part.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
            }
        }
        let thin = parts.iter().filter(|[_, off, _]| *off <= CROWDED * most);
        let [count, area] = thin.fold([0.0; 2], |[count, area], part| [count + part[0], area + part[2]]);
        let side = (area / count).sqrt();
        (count > WORTH * seen && side >= SMALL).then(|| thin::sides(side, view.size))
    }

    /// Has prepared particles drawn by affine footprints where those are off by at most `most` together, in optical depth; `cells`: pixels
    /// of the cells by which that is found.
    fn flatten<A: Alignment>(
        &self,
        size: [u32; 2],
        (cells, most): ([usize; 2], f64),
        items: &mut [Item<A::Splat>],
        bounds: &[Bounds],
    ) -> Affine {
        const PIECE: usize = 1 << 12;
        let pieces = items.par_chunks(PIECE).zip(bounds.par_chunks(PIECE));
        let errors: Vec<f64> = pieces
            .flat_map_iter(|(items, bounds)| {
                items.iter().zip(bounds).map(|(item, bounds)| Self::affine_error::<A>(item, bounds))
            })
            .collect();
        let thin = Thin::new(size, cells, most, bounds.iter().copied().zip(errors.iter().copied()));
        let pieces = items.par_chunks_mut(PIECE).zip(bounds.par_chunks(PIECE)).zip(errors.par_chunks(PIECE));
        let counts = pieces.map(|((items, bounds), errors)| {
            // How many are taken, their pixels, and those of all.
            let mut counts = [0u64; 3];
            for ((item, bounds), &error) in items.iter_mut().zip(bounds).zip(errors) {
                if bounds.is_empty() {
                    continue;
                }
                let pixels = bounds.pixels() as u64;
                counts[2] += pixels;
                if thin.takes(bounds, error) {
                    item.kind = Kind::Affine;
                    counts[0] += 1;
                    counts[1] += pixels;
                }
            }
            counts
        });
        let [count, taken, all] = counts.reduce(|| [0; 3], |a, b| std::array::from_fn(|i| a[i] + b[i]));
        if count == 0 {
            return Affine::default();
        }
        Affine { count, error: thin.error * self.spread(), share: taken as f64 / all as f64 }
    }

    /// What the affine footprint of a prepared particle may be off, in optical depth; infinite where it has none.
    #[inline]
    fn affine_error<A: Alignment>(item: &Item<A::Splat>, bounds: &Bounds) -> f64 {
        /// Pixels of a particle below which it is of no use, and the series no longer short.
        const TINY: usize = 64;
        if item.kind == Kind::Gauss && !bounds.is_empty() && bounds.pixels() >= TINY {
            f64::from(item.amplitude) * std::f64::consts::LN_2 * A::affine_error(&item.splat)
        } else {
            f64::INFINITY
        }
    }

    /// Prepares a batch for a view, item by item; particles that cover no unfinished pixel get empty bounds. The arrays
    /// may stay longer than the batch.
    fn prepare<A: Alignment>(
        &self,
        alignment: A,
        view: &View,
        ids: &[u32],
        tiles: &Tiles,
        items: &mut Vec<Item<A::Splat>>,
        bounds: &mut Vec<Bounds>,
    ) {
        const PIECE: usize = 256;
        let lens = Lens::new(view);
        if items.len() < ids.len() {
            items.resize(ids.len(), Item::default());
            bounds.resize(ids.len(), Bounds::EMPTY);
        }
        let pieces = ids.par_chunks(PIECE).zip(items.par_chunks_mut(PIECE).zip(bounds.par_chunks_mut(PIECE)));
        pieces.for_each(|(ids, (items, bounds))| {
            // Particles in drawing order lie anywhere in memory: a loop that does nothing but fetch them lets the machine
            // wait for many at a time.
            let mut places = [(0, 0, DVec3::ZERO); PIECE];
            for (place, &id) in places.iter_mut().zip(ids) {
                let (number, i) = self.index.locate(id);
                let set = &self.scene.particles[number];
                *place = (number, i, DVec3::new(set.x[i], set.y[i], set.z[i]));
            }
            for ((&(number, i, point), item), bounds) in places[..ids.len()].iter().zip(items).zip(bounds) {
                *bounds = match self.prepare_one(alignment, &lens, number, i, point) {
                    Some((prepared, pixels)) if !tiles.are_finished(&pixels) => {
                        *item = prepared;
                        pixels
                    }
                    _ => Bounds::EMPTY,
                };
            }
        });
    }

    /// Factor of the footprint of a particle of a set, of that opacity, and the footprint's greatest value, as in [`Item`].
    #[inline]
    pub fn factor(&self, set_number: usize, opacity: f64) -> [f32; 2] {
        match &self.amplitudes[set_number] {
            Some(of_all) => *of_all,
            None => amplitude(opacity, self.model),
        }
    }

    /// The footprint table of a set.
    pub fn table(&self, set_number: usize) -> Table {
        self.footprints[set_number]
    }

    /// Prepares a particle by its number over all sets, as [`Job::prepare_one`].
    fn prepare_id<A: Alignment>(&self, alignment: A, lens: &Lens, id: u32) -> Option<(Item<A::Splat>, Bounds)> {
        let (number, i) = self.index.locate(id);
        let set = &self.scene.particles[number];
        self.prepare_one(alignment, lens, number, i, DVec3::new(set.x[i], set.y[i], set.z[i]))
    }

    /// Prepares particle `i` of a set; `None` where it shows nothing.
    #[inline]
    pub fn prepare_one<A: Alignment>(
        &self,
        alignment: A,
        lens: &Lens,
        set_number: usize,
        i: usize,
        point: DVec3,
    ) -> Option<(Item<A::Splat>, Bounds)> {
        let set = &self.scene.particles[set_number];
        let opacity = set.opacity.get(i);
        if opacity <= self.options.faintest {
            return None;
        }
        let center = lens.view.eye_from_point(point);
        let prepared = alignment.prepare(lens, center, set.radius.get(i), set.kernel == Kernel::Gaussian)?;
        if prepared.bounds.is_empty() {
            return None;
        }
        let [amplitude, most] = self.factor(set_number, opacity);
        let item = Item {
            splat: prepared.splat,
            amplitude,
            color: set.color.get(i),
            kind: if self.footprints[set_number].is_gaussian() { Kind::Gauss } else { Kind::Radial },
            table: self.footprints[set_number],
            most,
            depths: prepared.depths.map(|depth| depth as f32),
            front: prepared.front,
        };
        Some((item, prepared.bounds))
    }
}

/// Factor of a particle's footprint and the footprint's greatest value, as in [`Item`].
fn amplitude(opacity: f64, model: OpacityModel) -> [f32; 2] {
    match model {
        OpacityModel::Exponential => [(-(-opacity).ln_1p() * std::f64::consts::LOG2_E) as f32, f32::INFINITY],
        OpacityModel::Linear => {
            let (opacity, most) = (opacity as f32, (1.0 / opacity) as f32);
            // Rounded so that the product never exceeds 1.
            [opacity, if opacity * most > 1.0 { most.next_down() } else { most }]
        }
    }
}

/// The tiles of one view.
struct Tiles<'a> {
    status: &'a [Status],
    across: usize,
}

impl Tiles<'_> {
    /// Whether pixels lie in finished tiles alone. Says no without looking where that would be many tiles.
    #[inline]
    fn are_finished(&self, pixels: &Bounds) -> bool {
        let [x0, x1] = pixels.x.map(|x| x as usize / TILE);
        let [y0, y1] = pixels.y.map(|y| y as usize / TILE);
        if (x1 - x0 + 1) * (y1 - y0 + 1) > 6 {
            return false;
        }
        (y0..=y1).all(|y| self.status[y * self.across + x0..=y * self.across + x1].iter().all(|tile| tile.finished))
    }
}

/// Cuts films, states and tiles of views into bands, top to bottom: those of each view.
fn split<'a>(
    films: &'a mut [Film],
    encoded: &'a mut [&mut [[u8; 4]]],
    mut state: &'a mut [f32],
    mut tiles: &'a mut [Status],
    [across, down]: [usize; 2],
    band_state: usize,
) -> Vec<Vec<Band<'a>>> {
    let mut views = Vec::with_capacity(films.len());
    for (film, encoded) in films.iter_mut().zip(encoded) {
        let mut bands = Vec::with_capacity(down);
        let mut encoded = encoded.chunks_mut(film.size[0] as usize * TILE);
        let planes = tile::bands(film.size[0], TILE, &mut film.color, &mut film.transmittance);
        for (number, film) in planes.enumerate() {
            let (own_state, other_state) = std::mem::take(&mut state).split_at_mut(band_state);
            let (own_tiles, other_tiles) = std::mem::take(&mut tiles).split_at_mut(across);
            (state, tiles) = (other_state, other_tiles);
            let y = (number * TILE) as u32;
            let bytes = encoded.next().unwrap_or_default();
            bands.push(Band { y, film, bytes, state: own_state, tiles: own_tiles, counts: Counts::default() });
        }
        views.push(bands);
    }
    views
}

/// The colours of all particles that can be seen at all.
pub(in crate::render) struct Colors {
    /// The one colour, where there is one.
    pub one: Option<Rgb>,
    /// Least and greatest value per channel.
    pub range: [[f32; 2]; 3],
}

pub(in crate::render) fn colors(scene: &Scene) -> Colors {
    let mut one = None;
    let mut many = false;
    let mut range = NO_RANGE;
    for set in scene.particles.iter().filter(|set| !set.is_empty()) {
        let values = set.color.values();
        let first = *one.get_or_insert(values[0]);
        many |= values.iter().any(|&color| color != first);
        for color in values {
            for (range, &value) in range.iter_mut().zip(color) {
                *range = [range[0].min(value), range[1].max(value)];
            }
        }
    }
    if many || one.is_none() { Colors { one: None, range } } else { Colors { one, range } }
}
