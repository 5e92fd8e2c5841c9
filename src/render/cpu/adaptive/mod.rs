//! Gas on as few rays and slabs as a tolerance allows: the engine of method `auto`.
//!
//! Where nothing cuts it, the light of gas and its transmittance are smooth from pixel to pixel. They are computed on the
//! nodes of a grid, every 16th pixel along both axes where particles are large enough, by the slabs of [`super::slab`], and a
//! cubic B-spline takes them to the pixels; one colour needs no slabs, and its optical depth is added ball by ball
//! ([`super::additive`]). Each tile of the picture asks whether its nodes are near enough to each other: every node is compared
//! with what its neighbours of twice the distance would have made of it. Tiles for which that differs too much go on to a grid
//! twice as fine, and in the end to their own pixels; those near which a particle is small against the distance of the nodes, or
//! in which an opaque surface cuts gas, do so from the start. Of several colours, each block of nodes or pixels has slabs of its
//! own, where colours overlap, as thin as its own estimate of the error asks for (`slab/local.rs`). What of the tolerance is for which of
//! them is what is predicted to take the least time (`split.rs`).
//!
//! Where nothing cuts the gas and the order of the balls is of no account, or of little by a bound ([`super::mixing`]), billboards
//! are as good, and drawn where that is cheaper ([`super::forecast`]): many small particles. Where those are thin, by a bound too
//! ([`super::thin`]), each is a product of a column's and a row's factors.
//!
//! Particles that are too faint even all together are left out by a bound ([`super::faint`]). Frames of 8 bits are drawn from the
//! same nodes without films (`codes.rs`).
//!
//! What a tile and a slab are asked is an estimate, not a bound. It errs on the safe side: a smooth picture is better by two
//! orders of magnitude on the grid that is used than on the one of twice the distance, and the rim of a ball, where the
//! density of most kernels has a kink, by the square root of 2. Rims in which a density ends by a step have a bound of their own
//! (`rims.rs`).

mod codes;
mod cost;
mod enlarge;
mod extent;
mod grid;
mod misfit;
mod refine;
mod rims;
mod spare;
mod split;
mod stretch;

use self::grid::Grid;
use self::misfit::Trust;
use self::rims::Rims;
pub use self::spare::Spare;
use super::additive::{Ball, Nodes, Plane};
use super::cover::Cover;
use super::engine;
use super::faint::{self, Faint};
use super::footprint::QUICK;
use super::forecast::{self, Sample};
use super::laps::Laps;
use super::mixing;
use super::sight::{BATCH, Seen, Sight};
use super::simd::Level;
use super::slab::{Canvas, Cut, Gas, Mask, Ordered, Work};
use super::splat::{Alignment, Lens};
use super::tile::TILE;
use crate::picture::{Film, Rgba8};
use crate::render::opaque::{OpaqueLayer, wider};
use crate::render::{Frame, OpacityModel, Options, Progress, Statistics};
use crate::scene::{Rgb, Scene, View, stereo};
use rayon::prelude::*;
use std::ops::{Range, RangeInclusive};
use std::sync::OnceLock;
use std::time::Instant;

/// Distances of the nodes in pixels, from grid to grid.
const SPACINGS: [usize; 4] = [16, 8, 4, 2];

/// What of the tolerance may be lost by ending early; slabs and nodes share the rest (`split.rs`).
const EARLY: f64 = 0.1;

/// What of the tolerance may be lost with particles that are left out.
const FAINT: f64 = 0.1;

/// What of the tolerance may be lost where balls are drawn one behind the other that should mix.
const MIXING: f64 = 0.6;

/// What of what that leaves may be lost by affine footprints.
const AFFINE: f64 = 0.8;

/// How far from a pixel nodes have a say in it, in distances of nodes.
const REACH: f64 = 4.0;

/// Pieces in which particles are surveyed, and those of one colour added up.
const CHUNKS: usize = 4;

/// Nodes beyond the picture on every side: the neighbours by which the outermost are asked.
const MARGIN: usize = 3;

/// How a tile of the picture is drawn.
#[derive(Clone, Copy)]
struct Tile {
    /// The coarsest grid that no particle near it is too small for, as a place in [`SPACINGS`].
    coarsest: usize,
    /// Whether there is no gas in it.
    is_empty: bool,
    /// Greatest depth of gas, where an opaque surface may cut it.
    far: f32,
    /// The grid, or the one after the last that was asked, as a place in [`SPACINGS`]; beyond it are the pixels themselves.
    grid: usize,
    /// Whether the grid is good enough.
    decided: bool,
    /// By how much the nodes of the last grid that was asked differ from what their neighbours make of them.
    misfit: f32,
    /// What the last grid that was asked may lose.
    loss: f64,
    /// Whether an opaque surface cuts its gas.
    cut: bool,
    /// The colours of what may be seen in it or has a say in its pixels.
    hue: Hue,
}

/// Colours of some gas.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Hue {
    #[default]
    Nothing,
    One(Rgb),
    Several,
}

impl Hue {
    /// With another's.
    fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Nothing, hue) | (hue, Self::Nothing) => hue,
            (Self::One(a), Self::One(b)) if a == b => self,
            (Self::One(_) | Self::Several, Self::One(_) | Self::Several) => Self::Several,
        }
    }
}

impl Tile {
    /// Whether there is gas for which no grid is good enough yet.
    fn is_open(&self) -> bool {
        !self.decided && !self.is_empty
    }
}

/// A view and what is known of it.
struct Part<'a> {
    view: &'a View,
    opaque: Option<&'a OpaqueLayer>,
    tiles: Vec<Tile>,
    /// Tiles in a row.
    across: usize,
    rims: Rims,
    /// Of each grid that was asked for, if it was drawn.
    grids: Vec<Option<(Grid, Film)>>,
    /// What the slabs of each grid may lose, by their estimate, and those of the pixels.
    slabs: [f32; SPACINGS.len() + 1],
    /// What slabs of each grid, and those of the pixels, may lose, as shares of the tolerance; 0 without slabs.
    shares: [f64; SPACINGS.len() + 1],
    work: Work,
}

/// What is the same for all views.
struct Job<'a> {
    scene: &'a Scene,
    gas: Gas<'a>,
    /// Views whose planes of depth differ, with the order of the particles for slabs, once it is needed.
    ordered: Vec<(&'a View, OnceLock<Ordered>)>,
    /// How far nodes are trusted with the particles of each set.
    trust: &'a [Trust],
    /// The most that may be lost from node to pixel with any that a grid is drawn of, as in [`Trust`].
    loss: f64,
    /// What a sample tells of the particles.
    sample: Sample,
    one: Option<Rgb>,
    spare: &'a Spare,
    /// The grid that gas of one colour is added to ball by ball, as a place in [`SPACINGS`].
    first: usize,
    level: Level,
    tolerance: f64,
    /// What of the tolerance is left to slabs and nodes.
    left: f64,
    /// Least and greatest of what a channel can be.
    range: [[f32; 2]; 3],
    /// The largest change of a channel with the transmittance, with that itself and without.
    spreads: [f64; 2],
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view. `balls`: billboards that
/// are exact where one colour is seen and nothing cuts it.
pub fn draw<A: Alignment>(balls: A, frame: Frame, progress: &dyn Progress) -> Statistics {
    let start = Instant::now();
    let Frame { scene, views, opaque, options, films, encoded, memory } = frame;
    let colors = engine::colors(scene);
    let tolerance = options.tolerance;
    let shared = stereo::share_depth(views);
    // Views whose planes of depth differ.
    let planes = if shared { &views[..1] } else { views };
    let behind = opaque.iter().flatten().map(|layer| layer.range);
    let background = scene.background.map(|value| [value; 2]);
    let range = behind.chain([background]).fold(colors.range, wider);
    // What a channel changes with the optical depth, and the transmittance.
    let contrast = range.iter().map(|[low, high]| f64::from(*high) - f64::from(*low)).fold(0.0, f64::max);
    let spread = contrast.max(1.0);
    let faint = faint::faint(scene, views, FAINT * tolerance / spread);
    let lost = faint.depth * spread;
    let trust = Trust::of_sets(scene);
    let bare = opaque.iter().all(Option::is_none);
    let least: Vec<f64> = trust.iter().map(|trust| trust.least_radius).collect();
    let forecast = forecast::forecast(scene, &views[0], colors.one.is_some(), tolerance, &SPACINGS, &least);
    let particles = scene.particle_count();
    if bare
        && forecast.billboards
        && !planes.iter().any(|view| forecast::cuts(scene, view))
        && let Some(mixing) = mixing(scene, views, colors.one, MIXING * tolerance)
    {
        // Nothing cuts the gas, and it hardly matters in which order it is composited: the billboards of balls are the truth.
        let pixels = views[0].size.map(f64::from).iter().product();
        let prepare = start.elapsed();
        let options = Options {
            opacity_model: OpacityModel::Exponential,
            tolerance: 0.9 * tolerance - mixing - lost,
            faintest: faint.opacity,
            error_map: false,
            ..*options
        };
        memory.nodes.finish();
        let frame = Frame { scene, views, opaque, options: &options, films, encoded, memory };
        let (mut statistics, affine) = engine::draw_within(balls, AFFINE, frame, progress);
        let time = cost::billboards(&forecast.sample, particles, views.len(), pixels, affine.share, options.level);
        let why = if colors.one.is_some() {
            "The gas has one colour, nothing cuts it, and its particles are many or small".into()
        } else {
            format!(
                "Nothing cuts the gas, and particles of different colours that overlap change no channel by more than {mixing:.2e}"
            )
        };
        statistics.plan = left_out(&faint, lost);
        let but = if affine.count > 0 { ", but for small ones in thin gas" } else { "" };
        statistics.plan.push(format!("{why}: each ball is projected exactly{but}."));
        if affine.count > 0 {
            statistics.plan.push(format!(
                "Those are {} of {}, over all views: their rays are taken for parallel, which changes no channel by more than {:.2e}.",
                affine.count, statistics.prepared, affine.error
            ));
        }
        statistics.predicted_error = Some(0.9 * tolerance);
        statistics.predicted_time = Some(time);
        statistics.stages.insert(0, ("forecast", prepare));
        return statistics;
    }
    let prepare = start.elapsed();

    let start = Instant::now();
    // One colour needs one slab.
    let cut = match colors.one {
        Some(_) => Cut::Equidistant { slabs: 1, richardson: false },
        None => Cut::Local,
    };
    // Of an optical depth D at most 1/e of that is seen: D exp(-D). What is kept for early ends has room for that: where gas is deep
    // enough for them, next to nothing of it is seen.
    let quick = spread * QUICK * (-1.0f64).exp() < EARLY * tolerance;
    let gas = Gas::new(scene, cut, faint.opacity, (EARLY * tolerance) as f32, range).quick(quick);
    let ordered = planes.iter().map(|view| (view, OnceLock::new())).collect();
    // Planes of the finest grid, one for each chunk of the particles, would be as large as films.
    let wide = &SPACINGS[..SPACINGS.len() - 1];
    let first = wide.iter().position(|&spacing| forecast.spacing == Some(spacing)).unwrap_or(0);
    let trusted = scene.particles.iter().zip(&trust);
    let trusted = trusted.filter(|(set, trust)| !set.is_empty() && trust.least_radius.is_finite());
    let loss = trusted.fold(0.0, |most, (_, trust)| trust.loss.max(most));
    let job = Job {
        scene,
        gas,
        ordered,
        trust: &trust,
        loss,
        sample: forecast.sample,
        one: colors.one,
        spare: &memory.nodes,
        first,
        level: options.level,
        tolerance,
        left: tolerance * (1.0 - EARLY) - lost,
        range,
        spreads: [spread, contrast],
    };
    let begun = start.elapsed();
    let start = Instant::now();
    let is_encoded = !encoded.is_empty();
    let mut bytes: Vec<Option<&mut Rgba8>> = encoded.iter_mut().map(Some).collect();
    bytes.resize_with(films.len(), || None);
    // Views have nothing to wait for in each other but the order of the particles, where that is the same.
    let all = views.par_iter().zip(opaque).zip(films.par_iter_mut()).zip(bytes).enumerate();
    let drawn = all.map(|(v, (((view, opaque), film), bytes))| {
        let mut laps = Laps::<4>::default();
        let order = || job.order(if shared { 0 } else { v });
        let mut part = laps.time(0, || job.begin(view, opaque.as_ref()));
        laps.time(1, || (0..SPACINGS.len()).for_each(|grid| job.refine(&mut part, grid, order)));
        laps.time(2, || job.pixels(&mut part, film, order));
        laps.time(3, || job.enlarge(&part, film, bytes));
        film.error = None;
        (part, laps)
    });
    let (parts, laps): (Vec<Part>, Vec<_>) = drawn.unzip();
    progress.update(views.len() as u64, views.len() as u64);
    let [survey, nodes, raster, enlarge] = Laps::shares(&laps, start.elapsed());
    let first_grid = colors.one.map(|_| first);
    let time = cost::grids(&forecast.sample, particles, &parts, first_grid, is_encoded, options.level);

    let mut work = Work::default();
    for part in &parts {
        work.add(&part.work);
    }
    let plan = [left_out(&faint, lost), words(&parts, colors.one.is_some())].concat();
    let predicted_error = EARLY * tolerance + lost + predicted(&parts);
    let films = parts.into_iter().flat_map(|part| part.grids).flatten();
    job.spare.give(films.flat_map(|(_, film)| film.color.into_iter().chain([film.transmittance])));
    memory.nodes.finish();
    Statistics {
        stages: vec![
            ("prepare", prepare),
            ("survey", begun + survey),
            ("nodes", nodes),
            ("raster", raster),
            ("enlarge", enlarge),
        ],
        fragments: work.fragments,
        prepared: work.prepared,
        plan,
        encoded: is_encoded,
        predicted_error: Some(predicted_error),
        predicted_time: Some(time),
        ..Statistics::default()
    }
}

/// By how much gas that does not mix may differ, over all views: nothing with one colour; `None` if it may be more than `most`.
fn mixing(scene: &Scene, views: &[View], one: Option<Rgb>, most: f64) -> Option<f64> {
    if one.is_some() {
        return Some(0.0);
    }
    views.iter().try_fold(0.0f64, |worst, view| Some(worst.max(mixing::bound(scene, view, most)?)))
}

/// The error that the estimates predict, but for early ends: that of the slabs, and the nodes' own.
fn predicted(parts: &[Part]) -> f64 {
    let of = |part: &Part| {
        let nodes = part.tiles.iter().filter(|tile| tile.decided);
        let nodes = nodes.map(|tile| f64::from(part.slabs[tile.grid]) + tile.loss);
        nodes.fold(f64::from(part.slabs[SPACINGS.len()]), f64::max)
    };
    parts.iter().map(of).fold(0.0, f64::max)
}

/// What is said of particles that are left out.
fn left_out(faint: &Faint, lost: f64) -> Vec<String> {
    let words = || {
        format!(
            "{} particles are left out, the faintest: together they change no channel by more than {lost:.2e}.",
            faint.count
        )
    };
    (faint.count > 0).then(words).into_iter().collect()
}

/// What was decided, one sentence each.
fn words(parts: &[Part], one: bool) -> Vec<String> {
    let slabs = if one {
        "The gas has one colour: no order in depth and no slabs are needed."
    } else {
        "Slabs of depth where balls of different colours overlap, as many as their own estimate of the error asks for."
    };
    let mut words = vec![slabs.into()];
    let tiles: Vec<&Tile> = parts.iter().flat_map(|part| &part.tiles).collect();
    let mut shares = Vec::new();
    for (number, spacing) in SPACINGS.iter().enumerate() {
        let count = tiles.iter().filter(|tile| tile.decided && tile.grid == number).count();
        if count > 0 {
            shares.push(format!("{count} from every {spacing}th pixel of every {spacing}th row"));
        }
    }
    let empty = tiles.iter().filter(|tile| tile.is_empty).count();
    if empty > 0 {
        shares.push(format!("{empty} without gas"));
    }
    let pixels = tiles.iter().filter(|tile| tile.is_open()).count();
    if pixels > 0 {
        let cut = tiles.iter().filter(|tile| tile.is_open() && tile.cut).count();
        shares.push(format!("{pixels} pixel by pixel ({cut} of them because opaque surfaces cut gas)"));
    }
    words.push(format!("Of {} tiles of {TILE} x {TILE} pixels, {}.", tiles.len(), shares.join(", ")));
    // Of views that differ in it, the most.
    let share = |number: usize| parts.iter().map(|part| part.shares[number]).fold(0.0, f64::max);
    let of_grid = |number: usize| (share(number), format!("of nodes {} pixels apart", SPACINGS[number]));
    let shares = (0..SPACINGS.len()).map(of_grid).chain([(share(SPACINGS.len()), "of single pixels".into())]);
    let shares = shares.filter(|(share, _)| *share > 0.0).map(|(share, of)| format!("{share} to slabs {of}"));
    let shares: Vec<String> = shares.collect();
    if !shares.is_empty() {
        words.push(format!(
            "Of the tolerance {EARLY} goes to rays that end early, up to {}, and what is left to nodes, as it is predicted to take the least time.",
            shares.join(", ")
        ));
    }
    words
}

impl<'a> Job<'a> {
    /// The order of the particles for slabs. It uses no other threads: one that waits for it here must not be lent to it.
    fn order(&self, number: usize) -> &Ordered {
        let (view, ordered) = &self.ordered[number];
        ordered.get_or_init(|| self.gas.order(view))
    }

    /// Finds what tiles hold; of one colour, draws the nodes of a grid on the way.
    fn begin(&self, view: &'a View, opaque: Option<&'a OpaqueLayer>) -> Part<'a> {
        let [across, down] = view.size.map(|n| (n as usize).div_ceil(TILE));
        let empty = Tile {
            coarsest: 0,
            is_empty: true,
            far: 0.0,
            grid: 0,
            decided: false,
            misfit: 0.0,
            loss: 0.0,
            cut: false,
            hue: Hue::Nothing,
        };
        let mut part = Part {
            view,
            opaque,
            tiles: vec![empty; across * down],
            across,
            rims: Rims::default(),
            grids: Vec::new(),
            slabs: [0.0; SPACINGS.len() + 1],
            shares: [0.0; SPACINGS.len() + 1],
            work: Work::default(),
        };
        let grid = Grid::new(view, SPACINGS[self.first]);
        let coarse = grid.view(view);
        let nodes = self.one.map(|_| Nodes::new(&coarse));
        if let Some(depths) = self.survey(&mut part, &grid, nodes.as_ref()) {
            let film = Film { size: coarse.size, transmittance: depths.into(), ..Film::new([0, 0]) };
            part.grids.resize_with(self.first, || None);
            part.grids.push(Some((grid, film)));
        }
        part
    }

    /// Finds the least particle of each tile and, where there are opaque surfaces, its farthest gas; where that is cut by one, the tile
    /// is left to its pixels. What is just beyond the picture counts for the tile beside it, whose nodes may show it. With `nodes`, draws
    /// them ball by ball on the way.
    fn survey(&self, part: &mut Part, grid: &Grid, nodes: Option<&Nodes>) -> Option<Vec<f32>> {
        let count = self.scene.particle_count();
        // Their number is the same whatever that of the threads, and so are the sums.
        let balls = rims::Balls::new(self.scene, &Lens::new(part.view), self.one.is_some(), self.tolerance);
        part.rims = Rims::new(&balls, part.counts());
        let chunks: Vec<Chunk> = (0..CHUNKS)
            .into_par_iter()
            .map(|i| self.chunk(part, &balls, grid, nodes, i * count / CHUNKS..(i + 1) * count / CHUNKS))
            .collect();
        let mut touched = Cover::<1>::new(part.counts());
        for chunk in &chunks {
            part.rims.merge(&chunk.rims);
            touched.merge(&chunk.touched);
            for (tile, &coarsest) in part.tiles.iter_mut().zip(&chunk.coarsest) {
                tile.coarsest = tile.coarsest.max(coarsest);
            }
            for (tile, &far) in part.tiles.iter_mut().zip(&chunk.far) {
                tile.far = tile.far.max(far);
            }
            for (tile, &hue) in part.tiles.iter_mut().zip(&chunk.hues) {
                tile.hue = tile.hue.and(hue);
            }
        }
        let mut tiles = part.tiles.iter_mut();
        // Numbers of balls, which are exact.
        touched.sums(|[count]| tiles.next().into_iter().for_each(|tile| tile.is_empty = count == 0.0));
        part.rims.finish();
        part.find_walls();
        let nodes = nodes?;
        for chunk in &chunks {
            part.work.add(&Work { fragments: chunk.fragments, prepared: chunk.prepared, ..Work::default() });
        }
        Some(nodes.transmittances(chunks.iter().map(|chunk| &chunk.depth), self.level))
    }

    /// What a few of the particles, by their numbers over all sets, add to nodes and tiles.
    fn chunk(
        &self,
        part: &Part,
        balls: &rims::Balls,
        grid: &Grid,
        nodes: Option<&Nodes>,
        numbers: Range<usize>,
    ) -> Chunk {
        let view = part.view;
        let lens = Lens::new(view);
        let tiles = part.counts();
        let [width, height] = view.size.map(f64::from);
        let pad = REACH * SPACINGS[0] as f64;
        let mut chunk = Chunk {
            depth: nodes.map_or_else(Plane::default, Nodes::plane),
            coarsest: vec![0; part.tiles.len()],
            rims: Rims::new(balls, tiles),
            touched: Cover::new(tiles),
            far: vec![0.0; if part.opaque.is_some() { part.tiles.len() } else { 0 }],
            hues: vec![Hue::Nothing; if self.one.is_some() { 0 } else { part.tiles.len() }],
            fragments: 0,
            prepared: 0,
        };
        let mut sight = Sight::default();
        let mut start = 0;
        for (number, (set, &trust)) in self.scene.particles.iter().zip(self.trust).enumerate() {
            let (shape, shells) = self.gas.kernel(number);
            let of = |at: usize| at.clamp(start, start + set.len()) - start;
            let numbers = of(numbers.start)..of(numbers.end);
            // Most are added; of very many this is room to begin with.
            let mut added = Vec::with_capacity(if nodes.is_some() { numbers.len().min(1 << 12) } else { 0 });
            for (place, i) in numbers.clone().enumerate() {
                if place % BATCH == 0 {
                    sight.look(set, i..numbers.end.min(i + BATCH), &lens, self.level);
                }
                let Seen { center, radius, intervals: [x, y], mut apparent } = sight.ball(place % BATCH, &lens);
                let opacity = set.opacity.get(i);
                if opacity <= self.gas.faintest() || radius - center.z <= view.near {
                    continue;
                }
                if x[0] > width + pad || x[1] < -pad || y[0] > height + pad || y[1] < -pad {
                    continue;
                }
                chunk.prepared += 1;
                let cut = (view.near + center.z) / radius;
                if cut > 0.0 {
                    // No more than a cap is seen, whose base lies on the near plane.
                    let cap = radius * (1.0 - cut * cut).max(0.0).sqrt();
                    apparent = apparent.min(lens.focal.min_element() * cap / view.near);
                }
                let near = |reach: f64| {
                    let grown = [x, y].map(|[low, high]| [low - reach, high + reach]);
                    rows(touched(grown, tiles, TILE), part.across)
                };
                let amplitude = self.gas.amplitude(number, opacity);
                let rim = balls.rim(&lens, number, amplitude, center, apparent);
                chunk.touched.add(touched([x, y], tiles, TILE), 0, 1.0);
                if part.opaque.is_some() {
                    let far = (-center.z + radius) as f32;
                    for row in near(0.0) {
                        chunk.far[row].iter_mut().for_each(|most| *most = extent::more(far, *most));
                    }
                }
                chunk.rims.touch(&rim, [x, y]);
                if rim.strong {
                    near(SPACINGS[0] as f64).for_each(|row| chunk.rims.cross(&rim, row));
                }
                if self.one.is_none() {
                    let hue = Hue::One(set.color.get(i));
                    for row in near(REACH * SPACINGS[0] as f64) {
                        chunk.hues[row].iter_mut().for_each(|own| *own = own.and(hue));
                    }
                }
                // Nodes that lie outside a tile have a say in its pixels, and no neighbour may tell that they hold a small one.
                for (number, spacing) in SPACINGS.iter().map(|&spacing| spacing as f64).enumerate() {
                    if apparent >= trust.least_radius * spacing {
                        break;
                    }
                    for row in near(REACH * spacing) {
                        chunk.coarsest[row].iter_mut().for_each(|coarsest| *coarsest = (*coarsest).max(number + 1));
                    }
                }
                // Tiles that a small one touches do not take their pixels from this grid, and the others are without it.
                if nodes.is_some()
                    && apparent >= trust.least_radius * grid.spacing as f64
                    && let (Some(x), Some(y)) = (grid.covered(0, x), grid.covered(1, y))
                {
                    let (center, near) = (center * (1.0 / radius), cut as f32);
                    added.push(Ball { center, amplitude, shape, near, nodes: [x, y] });
                }
            }
            if let Some(nodes) = nodes {
                chunk.fragments += nodes.add(&added, shells, self.gas.is_quick(), self.level, &mut chunk.depth);
            }
            start += set.len();
        }
        chunk
    }

    /// Draws the pixels of the tiles that are content with no grid.
    fn pixels<'b>(&self, part: &mut Part, film: &mut Film, ordered: impl FnOnce() -> &'b Ordered) {
        let mut mask = Mask::new(part.view.size.map(|n| n as usize));
        let mut any = false;
        for i in (0..part.tiles.len()).filter(|&i| part.tiles[i].is_open()) {
            let [x, y] = part.pixels(i);
            mask.add([x[0], y[0]], [x[1], y[1]]);
            any = true;
        }
        if any {
            let prepared = self.gas.prepare(part.view, ordered());
            // There are no nodes that lose anything.
            let error = (split::MOST * self.tolerance) as f32;
            if self.one.is_none() {
                part.shares[SPACINGS.len()] = split::MOST;
            }
            let canvas = Canvas { film, opaque: part.opaque, band: TILE, mask: Some(&mask), bare: false, error };
            let work = self.gas.draw(part.view, &prepared, canvas, self.level);
            part.slabs[SPACINGS.len()] = work.error;
            part.work.add(&work);
        }
    }
}

impl Part<'_> {
    /// Tiles along x and y.
    fn counts(&self) -> [usize; 2] {
        [self.across, self.tiles.len() / self.across]
    }

    /// First and last pixel of a tile, along both axes.
    fn pixels(&self, tile: usize) -> [[usize; 2]; 2] {
        let at = [tile % self.across, tile / self.across];
        [0, 1].map(|axis| [at[axis] * TILE, (at[axis] * TILE + TILE).min(self.view.size[axis] as usize) - 1])
    }

    /// First and last node of a grid that the pixels of a tile are compared by or made of, along both axes.
    fn nodes(&self, grid: &Grid, tile: usize) -> [[usize; 2]; 2] {
        let [x, y] = self.pixels(tile);
        [grid.nodes(0, x[0], x[1]), grid.nodes(1, y[0], y[1])]
    }

    /// The nodes of some tiles.
    fn mask(&self, grid: &Grid, tiles: &[usize]) -> Mask {
        let mut mask = Mask::new(grid.size);
        for &i in tiles {
            let [[left, right], [top, bottom]] = self.nodes(grid, i);
            mask.add([left, top], [right, bottom]);
        }
        mask
    }

    /// Which nodes of each row of a grid the pixels of some tiles are compared by or made of, from the first to the last.
    fn spans(&self, grid: &Grid, tiles: impl IntoIterator<Item = usize>) -> Vec<Range<usize>> {
        let mut spans = vec![0..0; grid.size[1]];
        for i in tiles {
            let [[x0, x1], [y0, y1]] = self.nodes(grid, i);
            for span in &mut spans[y0..=y1] {
                *span = if span.end == 0 { x0..x1 + 1 } else { span.start.min(x0)..span.end.max(x1 + 1) };
            }
        }
        spans
    }

    /// Leaves the tiles in which an opaque surface cuts gas to their pixels.
    fn find_walls(&mut self) {
        let Some(layer) = self.opaque else { return };
        let width = self.view.size[0] as usize;
        for i in (0..self.tiles.len()).filter(|&i| !self.tiles[i].is_empty).collect::<Vec<_>>() {
            let [x, y] = self.pixels(i);
            let mut rows = (y[0]..=y[1]).map(|row| &layer.depth[row * width + x[0]..=row * width + x[1]]);
            let far = f64::from(self.tiles[i].far);
            if rows.any(|row| row.iter().any(|&depth| depth <= far)) {
                self.tiles[i].coarsest = SPACINGS.len();
                self.tiles[i].cut = true;
            }
        }
    }
}

/// First and last column and row of the tiles of a side in pixels, so many along x and y, that intervals of picture coordinates touch.
#[inline]
fn touched(intervals: [[f64; 2]; 2], counts: [usize; 2], side: usize) -> [[usize; 2]; 2] {
    // A hair more, for rounding. Conversions truncate, and make 0 of what is negative.
    let tile = |at: f64, count: usize| ((at / side as f64) as usize).min(count - 1);
    [0, 1].map(|axis| {
        let [low, high] = intervals[axis];
        [tile(low - 1e-3, counts[axis]), tile(high + 1e-3, counts[axis])]
    })
}

/// The numbers of these tiles, row by row, if so many are in a row of all.
#[inline]
fn rows([columns, rows]: [[usize; 2]; 2], across: usize) -> impl Iterator<Item = RangeInclusive<usize>> {
    (rows[0]..=rows[1]).map(move |row| row * across + columns[0]..=row * across + columns[1])
}

/// What a few particles add.
struct Chunk {
    /// Optical depth on the nodes, in powers of two.
    depth: Plane,
    /// As in [`Tile`].
    coarsest: Vec<usize>,
    /// Empty without an opaque layer.
    far: Vec<f32>,
    /// How many of them touch each tile.
    touched: Cover<1>,
    rims: Rims,
    /// Empty where all gas has one colour.
    hues: Vec<Hue>,
    fragments: u64,
    prepared: u64,
}
