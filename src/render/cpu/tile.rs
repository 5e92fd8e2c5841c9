//! The tile rasteriser: one horizontal band of tiles of one view, all instructions of one level.
//!
//! Particles of a tile come in the order of the scene's, nearest first, in chunks of [`CHUNK`]. For a chunk, everything that
//! depends on the column or the row alone is put into tables that stay in the L1 cache; then each register block of the tile
//! walks the chunk's particles that touch it (a bit mask tells which) with its state in registers. Where one colour makes a tile
//! opaque, the dense middles of its particles come first ([`super::dense`]).

use super::composite::Composite;
use super::dense::{self, Outline, Part};
use super::develop::{Backdrop, Develop, Done};
use super::lists::TileLists;
use super::rim::Rim;
use super::simd::{Level, Simd, WithSimd, dispatch};
use super::splat::{Alignment, Bounds, Constants, Fragment, Frame, Item, Kind, Lens, Pixel};
use crate::picture::Plane;
use crate::render::opaque::OpaqueLayer;
use crate::scene::{Rgb, View};
use std::marker::PhantomData;
use std::ops::Range;
use std::time::Instant;

/// Particles whose tables are built at once; finer chunks end a full tile earlier, coarser ones cost fewer passes.
pub const CHUNK: usize = 16;

/// Side of a tile in pixels.
pub const TILE: usize = 64;

/// Tiles side by side that are composited before their rows are written, each row through all of them: memory is written fastest in
/// long runs. Their states take a megabyte at the most, read once and in order.
pub const RUN: usize = 16;

/// Blocks of a tile that a particle's bounds touch, at the least, for its outline to be asked which of them it touches itself: of fewer
/// none or next to none is spared.
const RIMMED: usize = 24;

/// The same for affine footprints, whose fragments are cheaper.
const AFFINE_RIMMED: usize = 96;

/// A number whose last bits are those of the whole number that is added to it: vectors of f32 add up bit masks.
const NO_HITS: f32 = (1 << 23) as f32;
const _: () = assert!(CHUNK <= 23, "a bit mask has no room in an f32");

/// Most register blocks in a tile: 4 lanes by 2 rows.
const MAX_BLOCKS: usize = TILE / 4 * (TILE / 2);

/// What a tile knows between batches.
#[derive(Clone)]
pub struct Status {
    /// Nothing more can be seen: its pixels are on the film.
    pub finished: bool,
    /// Blocks that are opaque enough.
    done: [u64; MAX_BLOCKS / 64],
    done_count: usize,
}

impl Status {
    /// A tile on which nothing is drawn yet.
    pub const NEW: Self = Self { finished: false, done: [0; MAX_BLOCKS / 64], done_count: 0 };

    #[inline(always)]
    fn is_done(&self, block: usize) -> bool {
        self.done[block / 64] >> (block % 64) & 1 != 0
    }

    #[inline(always)]
    fn set_done(&mut self, block: usize) {
        self.done[block / 64] |= 1 << (block % 64);
        self.done_count += 1;
    }
}

/// What is the same for all bands and views of a batch.
pub struct Batch<'a> {
    /// Vector instructions of the job.
    pub level: Level,
    /// Footprint tables.
    pub tables: &'a [f32],
    /// Colour behind everything.
    pub background: [f32; 3],
    /// The particles' one colour, where they have one.
    pub color: [f32; 3],
    /// Least and greatest value of each channel over all particles.
    pub color_range: [[f32; 2]; 3],
    /// Whether tiles are likely to become opaque by cores ([`dense`]).
    pub dense: bool,
    /// Whether this batch is the first, so that states must be started.
    pub first: bool,
    /// Whether no batch follows, so that every tile goes to the film.
    pub last: bool,
}

/// A batch as a view sees it.
pub struct Prospect<'a, T> {
    /// The view.
    pub view: &'a View,
    /// Prepared particles, nearest first; of those that cover nothing, anything.
    pub items: &'a [Item<T>],
    /// The pixels each of them covers.
    pub bounds: &'a [Bounds],
    /// Opaque surfaces of the view.
    pub opaque: Option<&'a OpaqueLayer>,
    /// Whether some of the Gaussians may be drawn by affine footprints.
    pub affine: bool,
    /// Absolute error allowed per channel.
    pub tolerance: f32,
}

/// One band: the film's rows and the states of its tiles.
pub struct Band<'a> {
    /// First row of pixels.
    pub y: u32,
    /// Rows of the film: red, green, blue, transmittance; `height * width` values each.
    pub film: [&'a mut [f32]; 4],
    /// As many pixels of 8 bits, written instead of the film; empty if they are not wanted.
    pub bytes: &'a mut [[u8; 4]],
    /// States between batches, tile by tile; empty when one batch is all.
    pub state: &'a mut [f32],
    /// One per tile of the band.
    pub tiles: &'a mut [Status],
    /// Counted up.
    pub counts: Counts,
}

/// What a band counts while it works.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Fragments computed, whole register blocks at a time.
    pub fragments: u64,
    /// Nanoseconds spent on lists of particles per tile.
    pub bin_ns: u64,
    /// Nanoseconds spent on everything else.
    pub raster_ns: u64,
}

impl Counts {
    /// Adds another band's.
    pub fn add(&mut self, other: &Self) {
        self.fragments += other.fragments;
        self.bin_ns += other.bin_ns;
        self.raster_ns += other.raster_ns;
    }
}

/// The job of rasterising a batch into a band of a view; `R` rows per register block.
pub struct BandJob<'a, 'b, A: Alignment, C: Composite, const R: usize> {
    /// The batch.
    pub batch: &'a Batch<'a>,
    /// What the view sees of it.
    pub prospect: &'a Prospect<'a, A::Splat>,
    /// The band's particles.
    pub lists: &'a TileLists,
    /// The band.
    pub band: &'a mut Band<'b>,
    /// The variant of compositing.
    pub composite: PhantomData<C>,
}

type Columns<F> = [[F; 3]; CHUNK];
type Rows<const R: usize> = [[[f32; R]; 3]; CHUNK];

/// The tables and masks of a chunk: particles of one kind.
struct Chunk<S: Simd, const R: usize> {
    columns: Vec<Columns<S::F>>,
    rows: Vec<Rows<R>>,
    /// The particles that touch each block, column by column: [`NO_HITS`] and powers of two.
    hits: [[f32; TILE / 2]; TILE / 4],
    constants: [Constants; CHUNK],
    len: usize,
    kind: Kind,
    /// Whether particles with affine footprints are drawn by exact ones.
    is_exact: bool,
    /// Whether fragments may be behind an opaque surface or behind the eye.
    cut: bool,
}

/// Memory of one band's work, all of it small enough for the L1 or L2 cache.
struct Scratch<S: Simd, const R: usize> {
    chunk: Chunk<S, R>,
    pixels: Vec<[Pixel<S::F>; R]>,
    state: Vec<f32>,
    /// The particles of a tile, those of a kind after each other.
    list: Vec<u32>,
}

impl<A: Alignment, C: Composite, const R: usize> WithSimd for BandJob<'_, '_, A, C, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let Self { batch, prospect, lists, band, .. } = self;
        let start = Instant::now();
        let zero = s.splat(0.0);
        let (across, down) = (TILE / S::LANES, TILE / R);
        let Batch { background, color, .. } = *batch;
        let backdrop = Backdrop { width: prospect.view.size[0] as usize, opaque: prospect.opaque, background, color };
        let mut scratch = Scratch::<S, R> {
            chunk: Chunk {
                columns: vec![[[zero; 3]; CHUNK]; across],
                rows: vec![[[[0.0; R]; 3]; CHUNK]; down],
                hits: [[NO_HITS; TILE / 2]; TILE / 4],
                constants: [Constants::default(); CHUNK],
                len: 0,
                kind: Kind::Gauss,
                is_exact: false,
                cut: false,
            },
            // Without weights and opaque surfaces nothing is written here, and nothing is ever cut.
            pixels: vec![[Pixel { weight: zero, limit: s.splat(f32::INFINITY) }; R]; across * down],
            state: if band.state.is_empty() {
                vec![0.0; RUN.min(band.tiles.len()) * TILE * TILE * C::PLANES]
            } else {
                vec![]
            },
            list: Vec::new(),
        };
        let count = band.tiles.len();
        for first in (0..count).step_by(RUN) {
            let mut done = [None; RUN];
            for i in first..count.min(first + RUN) {
                if !band.tiles[i].finished {
                    done[i - first] = tile::<S, A, C, R>(s, batch, prospect, band, i, lists.tile(i), &mut scratch);
                }
            }
            let own = &scratch.state;
            dispatch(batch.level, Develop::<C, R> { backdrop, band, first, done: &done, own, composite: PhantomData });
        }
        band.counts.raster_ns += start.elapsed().as_nanos() as u64;
    }
}

/// Cuts the planes of a film (red, green, blue, transmittance), `width` pixels wide, into bands of `rows` rows.
pub fn bands<'a>(
    width: u32,
    rows: usize,
    color: &'a mut [Plane<f32>; 3],
    transmittance: &'a mut [f32],
) -> impl Iterator<Item = [&'a mut [f32]; 4]> {
    let rows = width as usize * rows;
    let [red, green, blue] = color;
    let mut planes = [red, green, blue, transmittance].map(|plane| plane.chunks_mut(rows));
    std::iter::from_fn(move || {
        let [red, green, blue, transmittance] = planes.each_mut().map(Iterator::next);
        Some([red?, green?, blue?, transmittance?])
    })
}

/// The opaque surfaces within a tile, in single precision.
pub struct OpaqueTile {
    /// Depth of the nearest; infinite where there is none.
    pub nearest: f32,
    /// Infinite unless every pixel is opaque.
    pub farthest: f32,
    /// Least and greatest value of each channel, the background's included.
    pub range: [[f32; 2]; 3],
}

/// Draws a batch's particles into one tile; returns it if nothing more is to be drawn.
#[inline(always)]
fn tile<S: Simd, A: Alignment, C: Composite, const R: usize>(
    s: S,
    batch: &Batch,
    prospect: &Prospect<A::Splat>,
    band: &mut Band,
    number: usize,
    (mut first, mut others): (&[u32], &[u32]),
    scratch: &mut Scratch<S, R>,
) -> Option<Done> {
    let width = prospect.view.size[0] as usize;
    let at = [number * TILE, band.y as usize];
    let size = [TILE.min(width - at[0]), TILE.min(band.film[0].len() / width)];
    let (frame, lens) = (Frame::new(prospect.view, at[0] as u32, band.y), Lens::new(prospect.view));
    let opaque = prospect.opaque.map(|layer| survey(layer, batch.background, width, at, size));
    let all_blocks = TILE / S::LANES * (TILE / R);

    let Band { state, tiles, counts, .. } = band;
    let status = &mut tiles[number];
    let Scratch { chunk, pixels, state: own, list: of_kinds } = scratch;
    let state =
        if state.is_empty() { &mut own[place_of::<C>(number % RUN)] } else { &mut state[place_of::<C>(number)] };
    if batch.first {
        start::<S, C, R>(s, size, state, status);
    }
    if !(first.is_empty() && others.is_empty()) && (A::WEIGHTED || opaque.is_some()) {
        prepare_pixels::<S, A, R>(s, prospect, &frame, opaque.as_ref(), at, size, pixels);
    }
    let stop = stop_transmittance(prospect.tolerance, &batch.color_range, batch.background, opaque.as_ref());
    let depths = opaque.as_ref().map_or([f32::INFINITY; 2], |opaque| [opaque.nearest, opaque.farthest]);

    // Of particles that another view's tile lists nothing is known.
    let is_affine = |i: u32| prospect.items[i as usize].kind == Kind::Affine;
    let is_seen = |i: u32| meets(&prospect.bounds[i as usize], at);
    let is_mixed = prospect.affine && {
        let mut kinds = [0usize; 2];
        for &i in first.iter().chain(others).filter(|&&i| is_seen(i)) {
            kinds[usize::from(is_affine(i))] += 1;
        }
        !kinds.contains(&0)
    };
    // In order, kinds would alternate: all balls are exact instead.
    chunk.is_exact = is_mixed && C::DEPTH.is_none();
    if is_mixed && C::DEPTH.is_some() {
        // Chunks are of one kind.
        of_kinds.clear();
        for list in [first, others] {
            of_kinds.extend(list.iter().filter(|&&i| !is_affine(i)));
            of_kinds.extend(list.iter().filter(|&&i| is_affine(i)));
        }
        (first, others) = of_kinds.split_at(first.len());
    }
    for (part, mut rest) in [(Part::Core, first), (Part::Rest, first), (Part::Whole, others)] {
        while !rest.is_empty() && status.done_count < all_blocks {
            rest = &rest[chunk.fill::<A>(s, prospect, at, (&frame, &lens), depths, part, rest)..];
            let tables = batch.tables;
            counts.fragments += match (chunk.kind, chunk.cut) {
                (Kind::Affine, is_cut) => {
                    debug_assert!(!is_cut, "affine footprints are never cut");
                    blocks::<S, A::Splat, A::Affine, C, R, false>(s, chunk, pixels, tables, stop, state, status)
                }
                (Kind::Radial, false) if A::KERNELS => {
                    blocks::<S, A::Splat, A::Radial, C, R, false>(s, chunk, pixels, tables, stop, state, status)
                }
                (Kind::Radial, true) if A::KERNELS => {
                    blocks::<S, A::Splat, A::Radial, C, R, true>(s, chunk, pixels, tables, stop, state, status)
                }
                (Kind::Gauss | Kind::Radial, false) => {
                    blocks::<S, A::Splat, A::Gauss, C, R, false>(s, chunk, pixels, tables, stop, state, status)
                }
                (Kind::Gauss | Kind::Radial, true) => {
                    blocks::<S, A::Splat, A::Gauss, C, R, true>(s, chunk, pixels, tables, stop, state, status)
                }
            };
        }
    }

    status.finished = batch.last || status.done_count == all_blocks;
    status.finished.then_some(Done { walls: depths[0] < f32::INFINITY })
}

/// Where the state of a tile lies among those of several.
#[inline(always)]
pub fn place_of<C: Composite>(number: usize) -> Range<usize> {
    let size = TILE * TILE * C::PLANES;
    number * size..(number + 1) * size
}

/// Sets a tile's state to "nothing drawn", and marks the blocks beyond the picture's edge as done: they are never hit and
/// would keep the tile waiting for them.
#[inline(always)]
fn start<S: Simd, C: Composite, const R: usize>(s: S, size: [usize; 2], state: &mut [f32], status: &mut Status) {
    let across = TILE / S::LANES;
    for (number, block) in state.chunks_exact_mut(C::PLANES * R * S::LANES).enumerate() {
        for (i, row) in block.chunks_exact_mut(S::LANES).enumerate() {
            s.store(s.splat(if i % C::PLANES == 0 { C::START } else { 0.0 }), row);
        }
        if number % across * S::LANES >= size[0] || number / across * R >= size[1] {
            status.set_done(number);
        }
    }
}

impl<S: Simd, const R: usize> Chunk<S, R> {
    /// Fills the tables with the next particles of one kind; returns how many of `list` that took. `depths` are those of
    /// the nearest and the farthest opaque surface in the tile at `at`.
    #[inline(always)]
    fn fill<A: Alignment>(
        &mut self,
        s: S,
        prospect: &Prospect<A::Splat>,
        at: [usize; 2],
        (frame, lens): (&Frame, &Lens),
        depths: [f32; 2],
        part: Part,
        list: &[u32],
    ) -> usize {
        let is_exact = self.is_exact;
        let kind_of = |kind: Kind| if is_exact && kind == Kind::Affine { Kind::Gauss } else { kind };
        self.hits = [[NO_HITS; TILE / 2]; TILE / 4];
        self.len = 0;
        self.cut = false;
        for (taken, &i) in list.iter().enumerate() {
            if self.len == CHUNK {
                return taken;
            }
            let (item, bounds) = (&prospect.items[i as usize], &prospect.bounds[i as usize]);
            if meets(bounds, at) && item.depths[0] <= depths[1] {
                if self.len > 0 && kind_of(item.kind) != self.kind {
                    return taken;
                }
                self.kind = kind_of(item.kind);
                let mut pixels = within(bounds, at);
                let mut core = None;
                if part != Part::Whole {
                    let inner = dense::bounds(bounds, prospect.view.size);
                    // Of small ones all is core: of few blocks next to none would be spared.
                    let is_small = bounds.pixels() < RIMMED * S::LANES * R;
                    let is_near = !is_small && meets(&inner, at);
                    let is_elsewhere = if part == Part::Core { !is_small && !is_near } else { is_small };
                    if is_elsewhere {
                        continue;
                    }
                    if is_near {
                        let rim = dense::rim::<A>(item, lens, (bounds, &inner));
                        core = Some((within(&inner, at), rim));
                    }
                }
                let (outline, except) = match (part, core) {
                    (Part::Core, Some((own, rim))) => {
                        // Nothing else of it is needed.
                        pixels = own;
                        (Outline { rim, blocks: Self::touched(own) }, None)
                    }
                    (_, core) => {
                        let blocks = Self::touched(pixels);
                        let count = blocks.map(|[first, last]| last + 1 - first).into_iter().product::<usize>();
                        let least = if self.kind == Kind::Affine { AFFINE_RIMMED } else { RIMMED };
                        let rim = if count >= least {
                            A::rim(&item.splat, lens, self.kind != Kind::Radial)
                        } else {
                            Rim::NONE
                        };
                        let mut except = None;
                        if let Some((own, rim)) = core {
                            except = Some(Outline { rim, blocks: Self::touched(own) });
                        }
                        (Outline { rim, blocks }, except)
                    }
                };
                self.mark(s, &outline, except.as_ref(), frame);
                self.cut |= item.front > f32::NEG_INFINITY || item.depths[1] >= depths[0];
                match self.kind {
                    Kind::Gauss => self.add::<A::Splat, A::Gauss>(s, item, pixels, frame),
                    Kind::Radial => self.add::<A::Splat, A::Radial>(s, item, pixels, frame),
                    Kind::Affine => self.add::<A::Splat, A::Affine>(s, item, pixels, frame),
                }
                self.constants[self.len] = Constants {
                    amplitude: item.amplitude,
                    table: item.table,
                    most: item.most,
                    front: item.front,
                    own: A::constants(&item.splat),
                    color: item.color,
                };
                self.len += 1;
            }
        }
        list.len()
    }

    /// First and last block of some pixels of the tile, along x and y.
    #[inline(always)]
    fn touched([x, y]: [[usize; 2]; 2]) -> [[usize; 2]; 2] {
        [x.map(|x| x / S::LANES), y.map(|y| y / R)]
    }

    /// Writes a particle's columns and rows at place `len`; it covers these pixels of the tile.
    #[inline(always)]
    fn add<T: Copy, P: Fragment<T>>(&mut self, s: S, item: &Item<T>, [x, y]: [[usize; 2]; 2], frame: &Frame) {
        // The remainder proves to the compiler that it is in range.
        let place = self.len % CHUNK;
        // A copy: what is written does not alias it, so that what depends on the particle alone is computed once.
        let item = &{ *item };
        for block in x[0] / S::LANES..=x[1] / S::LANES {
            let centre = s.add(s.ramp(), s.splat((block * S::LANES) as f32 + 0.5));
            let planes = P::column(s, item, frame, centre);
            self.columns[block][place][..P::PLANES[0]].copy_from_slice(&planes[..P::PLANES[0]]);
        }
        for group in y[0] / S::LANES..=y[1] / S::LANES {
            let centre = s.add(s.ramp(), s.splat((group * S::LANES) as f32 + 0.5));
            let planes = P::row(s, item, frame, centre);
            let blocks = &mut self.rows[group * (S::LANES / R)..][..S::LANES / R];
            for (plane, values) in planes.into_iter().enumerate().take(P::PLANES[1]) {
                let mut lanes = [0.0f32; 16];
                s.store(values, &mut lanes);
                for (block, lanes) in blocks.iter_mut().zip(lanes.chunks_exact(R)) {
                    block[place][plane].copy_from_slice(lanes);
                }
            }
        }
    }

    /// Marks the blocks that an outline touches, but for those that another one within it does, for the particle at place `len`.
    #[inline(always)]
    fn mark(&mut self, s: S, outline: &Outline, except: Option<&Outline>, frame: &Frame) {
        let bit = s.splat((1 << self.len) as f32);
        let Outline { rim, blocks: [[left, right], [top, bottom]] } = *outline;
        for group in top / S::LANES..=bottom / S::LANES {
            let first = group * S::LANES;
            let row = s.add(s.ramp(), s.splat(first as f32));
            let outer = Span::new::<R>(s, &rim, [top, bottom], row, frame.corner);
            // Without a closure, which might be called with vectors in memory.
            let mut excepted = None;
            if let Some(Outline { rim, blocks: [columns, rows] }) = except {
                excepted = Some((*columns, Span::new::<R>(s, rim, *rows, row, frame.corner)));
            }
            for block in left..=right {
                let is_outer = outer.meets(s, block);
                let mut bits = s.keep(is_outer, bit);
                if let Some(([left, right], inner)) = &excepted
                    && (*left..=*right).contains(&block)
                {
                    bits = s.sub(bits, s.keep(s.and(is_outer, inner.meets(s, block)), bit));
                }
                let hits = &mut self.hits[block][first..];
                s.store(s.add(s.load(hits), bits), hits);
            }
        }
    }
}

/// Where an outline meets rows of blocks, a row in each lane.
struct Span<S: Simd> {
    ends: [S::F; 2],
    is_met: S::M,
}

impl<S: Simd> Span<S> {
    /// That of an outline, within the rows from `top` to `bottom`; blocks have `R` rows of pixels, counted from a corner.
    #[inline(always)]
    fn new<const R: usize>(s: S, rim: &Rim, [top, bottom]: [usize; 2], row: S::F, corner: [f64; 2]) -> Self {
        let is_met = s.and(s.less(s.splat(top as f32 - 0.5), row), s.less(row, s.splat(bottom as f32 + 0.5)));
        if rim.is_none() {
            return Self { ends: [s.splat(f32::NEG_INFINITY), s.splat(f32::INFINITY)], is_met };
        }
        let tops = s.mul_add(row, s.splat(R as f32), s.splat(0.5));
        let (ends, is_within) = rim.spans(s, corner, tops, (R - 1) as f32);
        Self { ends, is_met: s.and(is_met, is_within) }
    }

    /// Whether it meets a block of each row, by its number in it.
    #[inline(always)]
    fn meets(&self, s: S, block: usize) -> S::M {
        let pixel = (block * S::LANES) as f32 + 0.5;
        let last = s.splat(pixel + (S::LANES - 1) as f32);
        s.and(self.is_met, s.and(s.less(self.ends[0], last), s.less(s.splat(pixel), self.ends[1])))
    }
}

/// Whether bounds hold pixels of the tile at `at`.
#[inline(always)]
pub fn meets(bounds: &Bounds, at: [usize; 2]) -> bool {
    let along = |[first, last]: [u32; 2], at: usize| ((first as usize) < at + TILE) & (last as usize >= at);
    along(bounds.x, at[0]) & along(bounds.y, at[1]) & !bounds.is_empty()
}

/// The pixels of the tile at `at`, by number in it, that are within bounds.
#[inline(always)]
pub fn within(bounds: &Bounds, at: [usize; 2]) -> [[usize; 2]; 2] {
    let inside = |[first, last]: [u32; 2], origin: usize| {
        [(first as usize).saturating_sub(origin), (last as usize - origin).min(TILE - 1)]
    };
    [inside(bounds.x, at[0]), inside(bounds.y, at[1])]
}

/// Composites a chunk into every block of a tile; returns the fragments computed.
#[inline(always)]
fn blocks<S: Simd, T, P: Fragment<T>, C: Composite, const R: usize, const CUT: bool>(
    s: S,
    chunk: &Chunk<S, R>,
    pixels: &[[Pixel<S::F>; R]],
    tables: &[f32],
    stop: f32,
    state: &mut [f32],
    status: &mut Status,
) -> u64 {
    let across = chunk.columns.len();
    let block_size = C::PLANES * R * S::LANES;
    let mut hits_total = 0;
    for (down, rows) in chunk.rows.iter().enumerate() {
        for (over, (columns, hits)) in chunk.columns.iter().zip(&chunk.hits).enumerate() {
            let mut hits = hits[down].to_bits() & ((1 << CHUNK) - 1);
            let number = down * across + over;
            if hits == 0 || status.is_done(number) {
                continue;
            }
            hits_total += u64::from(hits.count_ones());
            let memory = &mut state[number * block_size..(number + 1) * block_size];
            let pixels = &pixels[number];
            let mut registers = [[s.splat(0.0); 4]; R];
            for (row, memory) in registers.iter_mut().zip(memory.chunks_exact(C::PLANES * S::LANES)) {
                for (value, memory) in row.iter_mut().zip(memory.chunks_exact(S::LANES)) {
                    *value = s.load(memory);
                }
            }
            while hits != 0 {
                // The mask proves to the compiler that the index is in range.
                let k = hits.trailing_zeros() as usize & (CHUNK - 1);
                hits &= hits - 1;
                let (column, row, constants) = (&columns[k], &rows[k], &chunk.constants[k]);
                let values = P::values::<S, R, CUT>(s, column, row, constants, pixels, tables);
                C::blend(s, &mut registers, &values, &constants.color);
            }
            for (row, memory) in registers.iter().zip(memory.chunks_exact_mut(C::PLANES * S::LANES)) {
                for (&value, memory) in row.iter().zip(memory.chunks_exact_mut(S::LANES)) {
                    s.store(value, memory);
                }
            }
            if C::is_done(s, &registers, stop) {
                status.set_done(number);
            }
        }
    }
    hits_total * (R * S::LANES) as u64
}

/// The transmittance below which nothing behind can change a channel, or the transmittance, by more than the tolerance.
/// What is left out is a mean of the colours still to come, weighted with at most this.
pub fn stop_transmittance(
    tolerance: f32,
    color_range: &[[f32; 2]; 3],
    background: Rgb,
    opaque: Option<&OpaqueTile>,
) -> f32 {
    // A twentieth is kept for rounding. No tolerance, and none that is a number, ends nothing.
    (0.95 * tolerance / spread(color_range, background, opaque)).max(0.0)
}

/// The most that a channel, or the transmittance, may change with the optical depth.
pub fn spread(color_range: &[[f32; 2]; 3], background: Rgb, opaque: Option<&OpaqueTile>) -> f32 {
    let mut spread = 1.0f32;
    for channel in 0..3 {
        let [mut low, mut high] = color_range[channel];
        let behind = opaque.map_or([background[channel]; 2], |opaque| opaque.range[channel]);
        low = low.min(behind[0]);
        high = high.max(behind[1]);
        spread = spread.max(high - low);
    }
    spread
}

/// Depth and colour extents of the opaque surfaces in a rectangle.
pub fn survey(layer: &OpaqueLayer, background: [f32; 3], width: usize, at: [usize; 2], size: [usize; 2]) -> OpaqueTile {
    let mut tile =
        OpaqueTile { nearest: f32::INFINITY, farthest: f32::NEG_INFINITY, range: background.map(|value| [value; 2]) };
    for y in at[1]..at[1] + size[1] {
        let row = y * width + at[0]..y * width + at[0] + size[0];
        for (&depth, color) in layer.depth[row.clone()].iter().zip(&layer.color[row]) {
            let depth = depth as f32;
            tile.nearest = tile.nearest.min(depth);
            tile.farthest = tile.farthest.max(depth);
            if depth < f32::INFINITY {
                for (range, &value) in tile.range.iter_mut().zip(color) {
                    *range = [range[0].min(value), range[1].max(value)];
                }
            }
        }
    }
    tile
}

/// Computes what fragments need of each pixel of a tile.
#[inline(always)]
fn prepare_pixels<S: Simd, A: Alignment, const R: usize>(
    s: S,
    prospect: &Prospect<A::Splat>,
    frame: &Frame,
    opaque: Option<&OpaqueTile>,
    at: [usize; 2],
    size: [usize; 2],
    pixels: &mut [[Pixel<S::F>; R]],
) {
    let across = TILE / S::LANES;
    let layer = prospect.opaque.filter(|_| opaque.is_some_and(|opaque| opaque.nearest < f32::INFINITY));
    let width = prospect.view.size[0] as usize;
    for (number, block) in pixels.iter_mut().enumerate() {
        let (down, over) = (number / across, number % across);
        let x = s.add(s.ramp(), s.splat((over * S::LANES) as f32 + 0.5));
        let tangent = s.mul_add(x, s.splat(frame.step[0] as f32), s.splat(frame.tangent[0] as f32));
        let square = s.mul_add(tangent, tangent, s.splat(1.0));
        for (r, pixel) in block.iter_mut().enumerate() {
            let y = (down * R + r) as f64 + 0.5;
            let tangent_y = frame.tangent[1] + y * frame.step[1];
            let length_squared = s.add(square, s.splat((tangent_y * tangent_y) as f32));
            pixel.weight = s.div(s.splat(1.0), length_squared);
            let mut limits = [f32::INFINITY; 16];
            let row = down * R + r;
            if let Some(layer) = layer
                && row < size[1]
            {
                for (lane, limit) in limits[..S::LANES].iter_mut().enumerate() {
                    let column = over * S::LANES + lane;
                    if column < size[0] {
                        let tangent_x = frame.tangent[0] + (column as f64 + 0.5) * frame.step[0];
                        let depth = layer.depth[(at[1] + row) * width + at[0] + column];
                        let square = tangent_x * tangent_x + tangent_y * tangent_y + 1.0;
                        *limit = A::opaque_limit(depth, square) as f32;
                    }
                }
            }
            pixel.limit = s.load(&limits);
        }
    }
}
