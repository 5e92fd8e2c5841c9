//! The tile engine: order, batches, preparation, bands. Generic over the method ([`Alignment`]).
//!
//! Particles are taken nearest first in batches; a batch is prepared for every view that shares the order, then every
//! band of tiles rasterises it. When all tiles are opaque enough, the remaining batches are never looked at. The picture
//! does not depend on the number of threads: no decision does.

use super::composite::{Composite, Many, OneExponential, OneLinear};
use super::footprint::{Table, Tables};
use super::opaque::OpaqueLayer;
use super::order::{Index, Key, Order, Storage};
use super::simd::{Level, dispatch};
use super::splat::{Alignment, Bounds, Item};
use super::tile::{Band, BandJob, Batch, Counts, MAX_TILE, Status};
use crate::picture::Film;
use crate::render::{OpacityModel, Progress};
use crate::scene::{Attribute, Kernel, Rgb, Scene, View, stereo};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Particles in the first batch; later ones grow.
const FIRST_BATCH: usize = 1 << 14;

/// How to draw.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Opacity model of the fragments.
    pub opacity_model: OpacityModel,
    /// Absolute error allowed per channel by ending early.
    pub tolerance: f64,
    /// Vector instructions.
    pub level: Level,
}

/// Where the time went and how much was done.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Keys and sorting.
    pub order: Duration,
    /// From world space to the picture.
    pub transform: Duration,
    /// Lists of particles per tile (share of the wall time of the bands).
    pub bin: Duration,
    /// Fragments and film (share of the wall time of the bands).
    pub raster: Duration,
    /// Fragments computed, whole register blocks at a time.
    pub fragments: u64,
    /// Particles prepared, over all views; what lies behind opaque gas is not.
    pub prepared: u64,
}

/// Memory that is kept from frame to frame.
#[derive(Default)]
pub struct Memory {
    order: Storage,
    state: Vec<f32>,
    ids: Vec<u32>,
    bounds: Vec<Vec<Bounds>>,
}

/// Draws the particles of a scene over its background and opaque layers into `films`, one per view.
pub fn draw<A: Alignment>(
    _: A,
    scene: &Scene,
    views: &[View],
    opaque: &[Option<OpaqueLayer>],
    options: &Options,
    films: &mut [Film],
    memory: &mut Memory,
    progress: &dyn Progress,
) -> Statistics {
    let job = Job { scene, opaque, options, index: Index::new(scene), tables: Tables::default() };
    let mut statistics = Statistics::default();
    let shared = A::KEY == Key::Depth && stereo::share_depth(views);
    let group = if shared { views.len() } else { 1 };
    for first in (0..views.len()).step_by(group) {
        let films = &mut films[first..first + group];
        let span = Span { first: first as u64, group: group as u64, views: views.len() as u64, progress };
        job.clone().group::<A>(first, &views[first..first + group], films, memory, &mut statistics, &span);
    }
    statistics
}

/// Which part of the whole work a group is.
struct Span<'a> {
    first: u64,
    group: u64,
    views: u64,
    progress: &'a dyn Progress,
}

impl Span<'_> {
    fn update(&self, done: usize, total: usize) {
        let total = total.max(1) as u64;
        self.progress.update(self.first * total + self.group * done as u64, self.views * total);
    }
}

#[derive(Clone)]
struct Job<'a> {
    scene: &'a Scene,
    opaque: &'a [Option<OpaqueLayer>],
    options: &'a Options,
    index: Index,
    tables: Tables,
}

impl Job<'_> {
    /// Draws the views that share an order.
    fn group<A: Alignment>(
        mut self,
        first_view: usize,
        views: &[View],
        films: &mut [Film],
        memory: &mut Memory,
        statistics: &mut Statistics,
        span: &Span,
    ) {
        let colors = colors(self.scene);
        let footprints: Vec<Table> = self.scene.particles.iter().map(|set| self.tables.table(&set.kernel)).collect();
        match (colors.one, self.options.opacity_model) {
            (Some(_), OpacityModel::Exponential) => {
                self.batches::<A, _, 4>(
                    OneExponential,
                    first_view,
                    views,
                    films,
                    memory,
                    statistics,
                    span,
                    &colors,
                    &footprints,
                );
            }
            (Some(_), OpacityModel::Linear) => {
                self.batches::<A, _, 4>(
                    OneLinear,
                    first_view,
                    views,
                    films,
                    memory,
                    statistics,
                    span,
                    &colors,
                    &footprints,
                );
            }
            (None, OpacityModel::Exponential) => {
                self.many::<A, true>(first_view, views, films, memory, statistics, span, &colors, &footprints);
            }
            (None, OpacityModel::Linear) => {
                self.many::<A, false>(first_view, views, films, memory, statistics, span, &colors, &footprints);
            }
        }
    }

    /// Four planes of state: as many rows per register block as the registers hold.
    fn many<A: Alignment, const EXPONENTIAL: bool>(
        &self,
        first_view: usize,
        views: &[View],
        films: &mut [Film],
        memory: &mut Memory,
        statistics: &mut Statistics,
        span: &Span,
        colors: &Colors,
        footprints: &[Table],
    ) {
        let composite = Many::<EXPONENTIAL>;
        if self.options.level == Level::Avx512 {
            self.batches::<A, _, 4>(composite, first_view, views, films, memory, statistics, span, colors, footprints);
        } else {
            self.batches::<A, _, 2>(composite, first_view, views, films, memory, statistics, span, colors, footprints);
        }
    }

    fn batches<A: Alignment, C: Composite, const R: usize>(
        &self,
        composite: C,
        first_view: usize,
        views: &[View],
        films: &mut [Film],
        memory: &mut Memory,
        statistics: &mut Statistics,
        span: &Span,
        colors: &Colors,
        footprints: &[Table],
    ) {
        let start = Instant::now();
        let mut order = Order::new(self.scene, &self.index, &views[0], A::KEY, &mut memory.order);
        statistics.order += start.elapsed();
        let tile = MAX_TILE;
        let [width, height] = views[0].size.map(|size| size as usize);
        let (across, down) = (width.div_ceil(tile), height.div_ceil(tile));
        let mut tiles = vec![Status::NEW; views.len() * across * down];
        let one_batch = order.len() <= FIRST_BATCH;
        let band_state = if one_batch { 0 } else { across * tile * tile * C::PLANES };
        let mut state = std::mem::take(&mut memory.state);
        // Growing from zero gets untouched pages; what is left of an earlier frame is overwritten by the first batch.
        if state.len() < views.len() * down * band_state + 16 {
            state = vec![0.0; views.len() * down * band_state + 16];
        }
        let aligned = state.as_ptr().align_offset(64).min(16);

        let mut wanted = FIRST_BATCH;
        let mut first = true;
        memory.bounds.resize(views.len(), Vec::new());
        let mut items: Vec<Vec<Item<A::Splat>>> = views.iter().map(|_| Vec::new()).collect();
        let mut given = 0;
        loop {
            let start = Instant::now();
            memory.ids.clear();
            order.next_batch(wanted, &mut memory.ids);
            given += memory.ids.len();
            let last = order.is_exhausted();
            let sorted = Instant::now();
            for ((view, items), bounds) in views.iter().zip(&mut items).zip(&mut memory.bounds) {
                self.prepare::<A>(view, &memory.ids, footprints, items, bounds);
            }
            let prepared = Instant::now();
            let batches: Vec<Batch<A::Splat>> = views
                .iter()
                .enumerate()
                .map(|(v, view)| Batch {
                    view,
                    items: &items[v],
                    bounds: &memory.bounds[v],
                    tables: self.tables.values(),
                    opaque: self.opaque[first_view + v].as_ref(),
                    background: self.scene.background,
                    color: colors.one.unwrap_or_default(),
                    color_range: colors.range,
                    tolerance: self.options.tolerance as f32,
                    tile,
                    first,
                    last,
                })
                .collect();
            let mut bands = split(films, &mut state[aligned..], &mut tiles, [across, down], tile, band_state);
            bands.par_iter_mut().for_each(|(view, band)| {
                dispatch(self.options.level, BandJob::<A, C, R> { batch: &batches[*view], band, composite });
            });
            let mut counts = Counts::default();
            for (_, band) in &bands {
                counts.fragments += band.counts.fragments;
                counts.bin_ns += band.counts.bin_ns;
                counts.raster_ns += band.counts.raster_ns;
            }
            drop(bands);
            let wall = prepared.elapsed();
            let bin = wall.mul_f64(counts.bin_ns as f64 / (counts.bin_ns + counts.raster_ns).max(1) as f64);
            statistics.order += sorted - start;
            statistics.transform += prepared - sorted;
            statistics.bin += bin;
            statistics.raster += wall - bin;
            statistics.fragments += counts.fragments;
            statistics.prepared += (memory.ids.len() * views.len()) as u64;
            span.update(given, order.len());
            if last || tiles.iter().all(|tile| tile.finished) {
                break;
            }
            first = false;
            wanted += wanted / 2;
        }
        span.update(1, 1);
        memory.state = state;
        order.recycle(&mut memory.order);
    }

    /// Prepares a batch for a view; particles that cover no pixel get empty bounds.
    fn prepare<A: Alignment>(
        &self,
        view: &View,
        ids: &[u32],
        footprints: &[Table],
        items: &mut Vec<Item<A::Splat>>,
        bounds: &mut Vec<Bounds>,
    ) {
        let pieces: Vec<(Vec<Item<A::Splat>>, Vec<Bounds>)> = ids
            .par_chunks(1024)
            .map(|ids| {
                let mut items = Vec::with_capacity(ids.len());
                let mut bounds = Vec::with_capacity(ids.len());
                for &id in ids {
                    if let Some((item, pixels)) = self.prepare_one::<A>(view, id, footprints) {
                        items.push(item);
                        bounds.push(pixels);
                    }
                }
                (items, bounds)
            })
            .collect();
        items.clear();
        bounds.clear();
        for (mut some_items, mut some_bounds) in pieces {
            items.append(&mut some_items);
            bounds.append(&mut some_bounds);
        }
    }

    #[inline]
    fn prepare_one<A: Alignment>(
        &self,
        view: &View,
        id: u32,
        footprints: &[Table],
    ) -> Option<(Item<A::Splat>, Bounds)> {
        let (set_number, i) = self.index.locate(id);
        let set = &self.scene.particles[set_number];
        let opacity = set.opacity.get(i);
        if opacity == 0.0 {
            return None;
        }
        let center = view.eye_from_point(glam::DVec3::new(set.x[i], set.y[i], set.z[i]));
        let prepared = A::prepare(view, center, set.radius.get(i), set.kernel == Kernel::Gaussian)?;
        if prepared.bounds.is_empty() {
            return None;
        }
        let (amplitude, most) = match self.options.opacity_model {
            OpacityModel::Exponential => (-(-opacity).ln_1p() * std::f64::consts::LOG2_E, f64::INFINITY),
            OpacityModel::Linear => (opacity, 1.0 / opacity),
        };
        let item = Item {
            splat: prepared.splat,
            amplitude: amplitude as f32,
            color: set.color.get(i),
            table: footprints[set_number],
            most: most as f32,
            depths: prepared.depths.map(|depth| depth as f32),
            front: prepared.front,
        };
        Some((item, prepared.bounds))
    }
}

/// Cuts films, states and tiles into bands, view by view and top to bottom.
fn split<'a>(
    films: &'a mut [Film],
    mut state: &'a mut [f32],
    mut tiles: &'a mut [Status],
    [across, down]: [usize; 2],
    tile: usize,
    band_state: usize,
) -> Vec<(usize, Band<'a>)> {
    let mut bands = Vec::with_capacity(films.len() * down);
    for (view, film) in films.iter_mut().enumerate() {
        let rows = film.size[0] as usize * tile;
        let [red, green, blue] = &mut film.color;
        let mut planes = [red, green, blue, &mut film.transmittance].map(|plane| plane.chunks_mut(rows));
        for number in 0..down {
            let film = planes.each_mut().map(|plane| plane.next().unwrap_or_default());
            let (own_state, other_state) = std::mem::take(&mut state).split_at_mut(band_state);
            let (own_tiles, other_tiles) = std::mem::take(&mut tiles).split_at_mut(across);
            (state, tiles) = (other_state, other_tiles);
            let y = (number * tile) as u32;
            let band = Band { y, film, state: own_state, tiles: own_tiles, counts: Counts::default() };
            bands.push((view, band));
        }
    }
    bands
}

/// The colours of all particles that can be seen at all.
struct Colors {
    /// The one colour, where there is one.
    one: Option<Rgb>,
    /// Least and greatest value per channel.
    range: [[f32; 2]; 3],
}

fn colors(scene: &Scene) -> Colors {
    let mut one = None;
    let mut many = false;
    let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
    for set in scene.particles.iter().filter(|set| !set.is_empty()) {
        let values: &[Rgb] = match &set.color {
            Attribute::Uniform(color) => std::slice::from_ref(color),
            Attribute::Each(colors) => colors,
        };
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
