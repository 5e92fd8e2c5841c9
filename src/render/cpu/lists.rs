//! Which particles touch which tiles, nearest first: by band, then by tile.
//!
//! Views whose axes are parallel see most particles in the same bands and, where particles are wide, in the same tiles: then they have
//! lists in common, made once. A particle of such a list need not touch the tile in each of them.

use super::dense;
use super::splat::Bounds;
use super::tile::{Batch, Prospect, Status, TILE, meets, stop_transmittance, within};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Parts of a batch whose particles are listed by band side by side.
const PARTS: usize = 4;

/// Memory that is kept from batch to batch and from frame to frame.
#[derive(Default)]
pub struct Storage {
    /// For each set of views with lists in common and each part of the batch, the particles of each band, top to bottom.
    bands: Vec<[Vec<Vec<u32>>; PARTS]>,
    of_tiles: Mutex<Vec<TileLists>>,
}

/// The lists of a batch.
pub struct Lists<'a, T> {
    batch: &'a Batch<'a>,
    prospects: &'a [Prospect<'a, T>],
    /// [`super::composite::Composite::DEPTH`].
    depth: Option<f32>,
    /// Views that have lists in common.
    common: usize,
    /// Tiles side by side, and bands.
    size: [usize; 2],
    /// Of each set of views, whether a tile is unfinished in some of them.
    is_open: Vec<bool>,
    storage: &'a Storage,
    /// Made by whoever needs them first.
    of_bands: Vec<OnceLock<TileLists>>,
}

/// The lists of a band's tiles.
#[derive(Default)]
pub struct TileLists(Vec<List>);

#[derive(Default)]
struct List {
    ids: Vec<u32>,
    /// How many of the first of them are drawn by their cores first ([`dense`]).
    enough: usize,
}

impl<'a, T: Sync> Lists<'a, T> {
    /// Lists the particles of each band. `tiles`: all tiles of each view after each other; `size`: how many of them side by side, and
    /// bands; `depth`: [`super::composite::Composite::DEPTH`].
    pub fn new(
        batch: &'a Batch<'a>,
        prospects: &'a [Prospect<'a, T>],
        tiles: &[Status],
        size: [usize; 2],
        depth: Option<f32>,
        storage: &'a mut Storage,
    ) -> Self {
        let bounds: Vec<&[Bounds]> = prospects.iter().map(|prospect| prospect.bounds).collect();
        let common = if are_wide(&bounds) { prospects.len() } else { 1 };
        let [across, down] = size;
        let sets = prospects.len().div_ceil(common);
        storage.bands.resize_with(sets.max(storage.bands.len()), Default::default);
        for lists in storage.bands.iter_mut().flatten() {
            lists.resize(down, Vec::new());
        }
        let count = bounds[0].len();
        storage.bands.par_iter_mut().zip(bounds.par_chunks(common)).for_each(|(parts, bounds)| {
            parts.par_iter_mut().enumerate().for_each(|(part, bands)| {
                let [first, end] = [part, part + 1].map(|part| part * count / PARTS);
                bin_bands(bounds, first..end, TILE, bands);
            });
        });
        let mut is_open = vec![false; sets * across * down];
        for (is_open, tiles) in is_open.chunks_mut(across * down).zip(tiles.chunks(common * across * down)) {
            for (i, tile) in tiles.iter().enumerate() {
                is_open[i % (across * down)] |= !tile.finished;
            }
        }
        let of_bands = (0..sets * down).map(|_| OnceLock::new()).collect();
        Self { batch, prospects, depth, common, size, is_open, storage, of_bands }
    }

    /// Views that have lists in common, one after the other.
    pub fn common(&self) -> usize {
        self.common
    }

    /// The lists of the tiles of a view's band.
    pub fn band(&self, view: usize, band: usize) -> &TileLists {
        let [across, down] = self.size;
        let set = view / self.common;
        let place = set * down + band;
        self.of_bands[place].get_or_init(|| {
            // Nothing that is left half done there does harm.
            let spare = &self.storage.of_tiles;
            let mut lists = spare.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
            let prospects = &self.prospects[set * self.common..][..self.common];
            let particles = self.storage.bands[set].iter().flat_map(|bands| &bands[band]).copied();
            lists.fill(prospects, particles, &self.is_open[place * across..][..across]);
            if let (Some(depth), true) = (self.depth, self.batch.dense) {
                lists.find_enough(self.batch, &prospects[0], band * TILE, depth);
            }
            lists
        })
    }

    /// Gives the memory back.
    pub fn recycle(self) {
        let mut spare = self.storage.of_tiles.lock().unwrap_or_else(PoisonError::into_inner);
        spare.extend(self.of_bands.into_iter().filter_map(OnceLock::into_inner));
    }
}

impl TileLists {
    /// Lists those of some particles that touch each tile that is open in any view.
    fn fill<T>(&mut self, prospects: &[Prospect<T>], particles: impl Iterator<Item = u32>, is_open: &[bool]) {
        self.0.resize_with(is_open.len(), List::default);
        for list in &mut self.0 {
            list.ids.clear();
            list.enough = 0;
        }
        if is_open.iter().all(|is_open| !is_open) {
            return;
        }
        for i in particles {
            let columns = in_any(prospects.iter().map(|prospect| prospect.bounds[i as usize].x));
            let [first, last] = columns.map(|x| x as usize / TILE);
            for (list, is_open) in self.0[first..=last].iter_mut().zip(&is_open[first..=last]) {
                if *is_open {
                    list.ids.push(i);
                }
            }
        }
    }

    /// Finds how many of a tile's particles are drawn by their cores first: what one view asks for is near enough for those beside it.
    /// `y`: the band's first row.
    fn find_enough<T>(&mut self, batch: &Batch, prospect: &Prospect<T>, y: usize, depth: f32) {
        let Prospect { view, items, bounds, tolerance, .. } = *prospect;
        let stop = stop_transmittance(tolerance, &batch.color_range, batch.background, None);
        for (number, list) in self.0.iter_mut().enumerate() {
            let at = [number * TILE, y];
            let area = [0, 1].map(|axis| TILE.min(view.size[axis] as usize - at[axis])).into_iter().product();
            let depths = list.ids.iter().map(|&i| {
                let bounds = &bounds[i as usize];
                if !meets(bounds, at) {
                    return (0.0, 0);
                }
                let [x, y] = within(bounds, at);
                (depth * items[i as usize].amplitude, (x[1] + 1 - x[0]) * (y[1] + 1 - y[0]))
            });
            list.enough = dense::enough(depths, area, -stop.log2()).unwrap_or(0);
        }
    }

    /// The particles of a tile: those that are drawn by their cores first, and the others.
    pub fn tile(&self, number: usize) -> (&[u32], &[u32]) {
        let List { ids, enough } = &self.0[number];
        ids.split_at(*enough)
    }
}

/// Whether particles are so wide that most of those that touch a tile in one view do so in all; `bounds`: those of each view.
fn are_wide(bounds: &[&[Bounds]]) -> bool {
    /// Particles of lists in common beside those of a view's own, at the most, as a share of these.
    const MORE: f64 = 0.12;
    const SAMPLE: usize = 256;
    // Tiles that particles touch on their way across the picture are about as many as that, times their width.
    let width = |[first, last]: [u32; 2]| f64::from(last - first) + TILE as f64;
    let (mut own, mut common) = (0.0, 0.0);
    for i in (0..bounds[0].len()).step_by(bounds[0].len().div_ceil(SAMPLE).max(1)) {
        let seen =
            || bounds.iter().map(|of_view| of_view[i]).filter(|bounds| !bounds.is_empty()).map(|bounds| bounds.x);
        own += seen().map(width).sum::<f64>() / bounds.len() as f64;
        let all = in_any(seen());
        common += if all[0] <= all[1] { width(all) } else { 0.0 };
    }
    common <= (1.0 + MORE) * own
}

/// First and last of what is in any of several ranges; such a range is empty where the first is beyond the last.
#[inline(always)]
fn in_any(ranges: impl Iterator<Item = [u32; 2]>) -> [u32; 2] {
    let mut all = [u32::MAX, 0];
    for [first, last] in ranges {
        if first <= last {
            all = [all[0].min(first), all[1].max(last)];
        }
    }
    all
}

/// Lists those of some particles that touch each band of `rows` rows in any view, nearest first; `bounds`: those of each view.
pub fn bin_bands(bounds: &[&[Bounds]], particles: Range<usize>, rows: usize, bands: &mut [Vec<u32>]) {
    let rows = rows as u32;
    for band in &mut *bands {
        band.clear();
    }
    for i in particles {
        let [first, last] = in_any(bounds.iter().map(|of_view| of_view[i].y));
        if first <= last {
            for band in &mut bands[(first / rows) as usize..=(last / rows) as usize] {
                band.push(i as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::random::Random;
    use crate::render::cpu::simd::Level;
    use crate::render::cpu::splat::Item;
    use crate::scene::{Camera, View, stereo};

    const SIZE: [u32; 2] = [300, 200];
    const TILES: [usize; 2] = [5, 4];

    /// Particles so many pixels wide in two views, the second a few pixels off; some are seen in one view alone or in none.
    fn bounds(random: &mut Random, width: f64, count: usize) -> [Vec<Bounds>; 2] {
        let mut views = [Vec::new(), Vec::new()];
        for _ in 0..count {
            let at = SIZE.map(|size| random.uniform(0.0, f64::from(size)));
            let half = random.uniform(0.0, width);
            let shift = random.uniform(-25.0, 25.0);
            let lost = random.uniform(0.0, 40.0) as usize;
            for (view, bounds) in views.iter_mut().enumerate() {
                let x = at[0] + shift * view as f64;
                let seen = Bounds::from_intervals([x - half, x + half], [at[1] - half, at[1] + half], SIZE);
                bounds.push(if lost == view || lost == 2 { Bounds::EMPTY } else { seen });
            }
        }
        views
    }

    fn batch(dense: bool) -> Batch<'static> {
        Batch {
            level: Level::Portable,
            tables: &[],
            background: [0.0; 3],
            color: [1.0; 3],
            color_range: [[1.0; 2]; 3],
            dense,
            first: true,
            last: true,
        }
    }

    fn view() -> View {
        stereo::views(&Camera::for_tests(SIZE), None).remove(0)
    }

    fn prospect<'a>(view: &'a View, items: &'a [Item<()>], bounds: &'a [Bounds]) -> Prospect<'a, ()> {
        Prospect { view, items, bounds, opaque: None, affine: false, tolerance: 0.01 }
    }

    /// Every open tile lists, in order, all particles that touch it in a view that the list is of, and of those that touch none no more
    /// than the way from one view to the other asks for; finished tiles list nothing. From one memory, whatever was in it.
    #[test]
    fn tiles_list_what_touches_them() {
        let mut random = Random(7);
        let view = view();
        let mut storage = Storage::default();
        let mut commons = Vec::new();
        for (round, width) in [120.0, 4.0, 150.0, 2.0].into_iter().enumerate() {
            let bounds = bounds(&mut random, width, 100 + 30 * round);
            let items = vec![Item::default(); bounds[0].len()];
            let prospects = bounds.each_ref().map(|bounds| prospect(&view, &items, bounds));
            let mut tiles = vec![Status::NEW; 2 * TILES[0] * TILES[1]];
            for tile in &mut tiles {
                tile.finished = random.uniform(0.0, 1.0) < 0.5;
            }
            let batch = batch(false);
            let lists = Lists::new(&batch, &prospects, &tiles, TILES, None, &mut storage);
            commons.push(lists.common());
            let mut finished = 0;
            for (set, views) in [0, 1].chunks(lists.common()).enumerate() {
                for y in 0..TILES[1] {
                    let band = lists.band(set * lists.common(), y);
                    for x in 0..TILES[0] {
                        let (cores, listed) = band.tile(x);
                        assert!(cores.is_empty());
                        let at = [x * TILE, y * TILE];
                        if views.iter().all(|view| tiles[(view * TILES[1] + y) * TILES[0] + x].finished) {
                            assert!(listed.is_empty());
                            finished += 1;
                            continue;
                        }
                        let touches = |i: usize| views.iter().any(|&view: &usize| meets(&bounds[view][i], at));
                        let want: Vec<u32> = (0..items.len()).filter(|&i| touches(i)).map(|i| i as u32).collect();
                        let seen: Vec<u32> = listed.iter().copied().filter(|&i| touches(i as usize)).collect();
                        assert_eq!(seen, want, "round {round}, tile {x} {y}");
                        assert!(listed.is_sorted() && listed.len() <= want.len() + 1, "round {round}, tile {x} {y}");
                    }
                }
            }
            assert!(finished > 0);
            lists.recycle();
        }
        assert_eq!(commons, [2, 1, 2, 1]);
    }

    /// The views of a pair ask for the same memory from many threads: each list is made once.
    #[test]
    fn lists_are_made_once() {
        let view = view();
        let bounds = vec![Bounds { x: [0, 299], y: [0, 199] }; 50];
        let items = vec![Item::default(); 50];
        let prospects = [0; 2].map(|_| prospect(&view, &items, &bounds));
        let batch = batch(false);
        let mut storage = Storage::default();
        let lists = Lists::new(
            &batch,
            &prospects,
            &[const { Status::NEW }; 2 * TILES[0] * TILES[1]],
            TILES,
            None,
            &mut storage,
        );
        let addresses: Vec<[usize; 2]> = (0..2 * TILES[1])
            .into_par_iter()
            .map(|i| [i % TILES[1], std::ptr::from_ref(lists.band(i / TILES[1], i % TILES[1])) as usize])
            .collect();
        let (left, right) = addresses.split_at(TILES[1]);
        assert_eq!(left, right);
        lists.recycle();
        assert_eq!(storage.of_tiles.lock().unwrap().len(), TILES[1]);
    }

    /// Of many deep balls all over a tile the first are drawn by their cores, so many in each view; of no dense batch any.
    #[test]
    fn cores_come_first_where_gas_is_dense() {
        let view = view();
        let bounds = vec![Bounds { x: [0, 299], y: [0, 199] }; 200];
        let items = vec![Item { amplitude: 1.0, ..Item::default() }; 200];
        let prospects = [0; 2].map(|_| prospect(&view, &items, &bounds));
        for dense in [true, false] {
            let batch = batch(dense);
            let mut storage = Storage::default();
            let tiles = [const { Status::NEW }; 2 * TILES[0] * TILES[1]];
            let lists = Lists::new(&batch, &prospects, &tiles, TILES, Some(1.0), &mut storage);
            for x in 0..TILES[0] {
                let (cores, others) = lists.band(1, 0).tile(x);
                assert_eq!(cores.len() + others.len(), 200);
                assert_eq!(!cores.is_empty(), dense, "{}", cores.len());
                assert!(cores.len() < 100, "{}", cores.len());
            }
        }
    }
}
