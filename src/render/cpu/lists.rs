//! Which particles touch which tiles, nearest first: by band, then by tile.
//!
//! Views that share an order have parallel axes and see most particles in the same bands and, where particles are wide, in the same tiles:
//! then they have lists in common, made once. A particle of such a list need not touch the tile in each of them.

use super::dense;
use super::splat::Bounds;
use super::tile::{Batch, Prospect, Status, TILE, meets, stop_transmittance, within};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// Parts of a batch whose particles are listed by band side by side.
const PARTS: usize = 4;

/// Memory that is kept from batch to batch and from frame to frame.
#[derive(Default)]
pub struct Storage {
    /// One for each set of views with lists in common.
    bands: Vec<Parts>,
    /// Unused ones.
    of_tiles: Mutex<Vec<TileLists>>,
}

impl Storage {
    /// What [`list_bands`] fills for each of so many views of so many bands.
    pub fn of_views(&mut self, views: usize, bands: usize) -> &mut [Parts] {
        self.bands.resize_with(views.max(self.bands.len()), Default::default);
        for lists in self.bands.iter_mut().flatten() {
            lists.resize(bands, Vec::new());
        }
        &mut self.bands[..views]
    }
}

/// The particles of each band, top to bottom, for each part of a batch.
pub type Parts = [Vec<Vec<u32>>; PARTS];

/// Lists the particles of a batch that touch each band of tiles in any view; `bounds`: those of each.
pub fn list_bands(bounds: &[&[Bounds]], parts: &mut Parts) {
    let count = bounds[0].len();
    parts.par_iter_mut().enumerate().for_each(|(part, bands)| {
        let [first, end] = [part, part + 1].map(|part| part * count / PARTS);
        bin_bands(bounds, first..end, TILE, bands);
    });
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
    /// Those in common, made by whoever needs them first.
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
    /// Those of views, all of which have lists in common, whose bands are listed here, or each its own, whose bands are listed in the storage
    /// already ([`list_bands`]); `common`: how many have them in common. `tiles`: all tiles of each view after each other; `size`: how many
    /// of them side by side, and bands; `depth`: [`super::composite::Composite::DEPTH`].
    pub fn new(
        batch: &'a Batch<'a>,
        (prospects, common): (&'a [Prospect<'a, T>], usize),
        tiles: &[Status],
        size: [usize; 2],
        depth: Option<f32>,
        storage: &'a mut Storage,
    ) -> Self {
        let [across, down] = size;
        let sets = prospects.len().div_ceil(common);
        if common > 1 {
            let bounds: Vec<&[Bounds]> = prospects.iter().map(|prospect| prospect.bounds).collect();
            list_bands(&bounds, &mut storage.of_views(1, down)[0]);
        }
        let mut is_open = vec![false; sets * across * down];
        for (is_open, tiles) in is_open.chunks_mut(across * down).zip(tiles.chunks(common * across * down)) {
            for (i, tile) in tiles.iter().enumerate() {
                is_open[i % (across * down)] |= !tile.finished;
            }
        }
        // All views are one set then.
        let of_bands = (0..if common > 1 { down } else { 0 }).map(|_| OnceLock::new()).collect();
        Self { batch, prospects, depth, common, size, is_open, storage, of_bands }
    }

    /// Views that have lists in common, one after the other.
    pub fn common(&self) -> usize {
        self.common
    }

    /// Does some work with the lists of the tiles of a view's band.
    pub fn with<R>(&self, view: usize, band: usize, work: impl FnOnce(&TileLists) -> R) -> R {
        if self.common > 1 {
            // Making them uses no other threads: one that waits for them must not be lent to that.
            return work(self.of_bands[band].get_or_init(|| self.make(0, band)));
        }
        let lists = self.make(view, band);
        let result = work(&lists);
        self.spare().push(lists);
        result
    }

    /// Those of a set of views.
    fn make(&self, set: usize, band: usize) -> TileLists {
        let [across, down] = self.size;
        let mut lists = self.spare().pop().unwrap_or_default();
        let prospects = &self.prospects[set * self.common..][..self.common];
        let particles = self.storage.bands[set].iter().flat_map(|bands| &bands[band]).copied();
        lists.fill(prospects, particles, &self.is_open[(set * down + band) * across..][..across]);
        if let (Some(depth), true) = (self.depth, self.batch.dense) {
            lists.find_enough(self.batch, prospects, band * TILE, depth);
        }
        lists
    }

    fn spare(&self) -> MutexGuard<'_, Vec<TileLists>> {
        // No work is done while it is held that might leave it half done.
        self.storage.of_tiles.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives the memory back.
    pub fn recycle(mut self) {
        let used = std::mem::take(&mut self.of_bands);
        self.spare().extend(used.into_iter().filter_map(OnceLock::into_inner));
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

    /// Finds how many of a tile's particles are drawn by their cores first: what one view asks for is near enough for those beside it. Only
    /// work depends on it, so that opaque surfaces, which ask for more where they are brighter than 1, are left out of account. `y`: the
    /// band's first row.
    fn find_enough<T>(&mut self, batch: &Batch, prospects: &[Prospect<T>], y: usize, depth: f32) {
        let Prospect { view, tolerance, .. } = prospects[0];
        let stop = stop_transmittance(tolerance, &batch.color_range, batch.background, None);
        for (number, list) in self.0.iter_mut().enumerate() {
            let at = [number * TILE, y];
            let area = [0, 1].map(|axis| TILE.min(view.size[axis] as usize - at[axis])).into_iter().product();
            let depths = list.ids.iter().map(|&i| {
                let i = i as usize;
                // Where a view's tile is finished it may see none of them.
                let Some(prospect) = prospects.iter().find(|prospect| meets(&prospect.bounds[i], at)) else {
                    return (0.0, 0);
                };
                let [x, y] = within(&prospect.bounds[i], at);
                (depth * prospect.items[i].amplitude, (x[1] + 1 - x[0]) * (y[1] + 1 - y[0]))
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

/// Whether views are better off with lists in common: particles are so wide that most of those that touch a tile in one view do so in all,
/// and the lists of all bands, of which none goes before all are drawn, are not too large. `sample`: bounds of every `stride`th particle, in
/// each view.
pub fn are_common(sample: &[Vec<Bounds>], stride: usize) -> bool {
    /// Particles of lists in common beside those of a view's own, at the most, as a share of these.
    const MORE: f64 = 0.12;
    /// Particles of all lists, at the most: 64 MB.
    const MOST: f64 = (1 << 24) as f64;
    // Tiles that particles touch along an axis are as many as that, over the side of a tile.
    let length = |[first, last]: [u32; 2]| if first <= last { f64::from(last - first) + TILE as f64 } else { 0.0 };
    let [mut own, mut common, mut tiles] = [0.0; 3];
    for i in 0..sample[0].len() {
        let [x, y] = [|bounds: &Bounds| bounds.x, |bounds: &Bounds| bounds.y]
            .map(|along| length(in_any(sample.iter().map(|of_view| along(&of_view[i])))));
        own += sample.iter().map(|of_view| length(of_view[i].x)).sum::<f64>() / sample.len() as f64;
        common += x;
        tiles += x * y / (TILE * TILE) as f64;
    }
    sample.len() > 1 && common <= (1.0 + MORE) * own && tiles * stride as f64 <= MOST
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

    /// The lists of two views as the engine makes them.
    fn lists<'a>(
        batch: &'a Batch<'a>,
        prospects: &'a [Prospect<'a, ()>; 2],
        tiles: &[Status],
        depth: Option<f32>,
        storage: &'a mut Storage,
    ) -> Lists<'a, ()> {
        let sample = prospects.each_ref().map(|prospect| prospect.bounds.to_vec());
        let common = if are_common(&sample, 1) { 2 } else { 1 };
        if common == 1 {
            for (prospect, parts) in prospects.iter().zip(storage.of_views(2, TILES[1])) {
                list_bands(&[prospect.bounds], parts);
            }
        }
        Lists::new(batch, (prospects, common), tiles, TILES, depth, storage)
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
            let lists = lists(&batch, &prospects, &tiles, None, &mut storage);
            commons.push(lists.common());
            let mut finished = 0;
            for (set, views) in [0, 1].chunks(lists.common()).enumerate() {
                for (y, x) in (0..TILES[1]).flat_map(|y| (0..TILES[0]).map(move |x| (y, x))) {
                    let listed = lists.with(set * lists.common(), y, |band| {
                        assert!(band.tile(x).0.is_empty());
                        band.tile(x).1.to_vec()
                    });
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
            assert!(finished > 0);
            lists.recycle();
        }
        assert_eq!(commons, [2, 1, 2, 1]);
    }

    /// Balls of 64 pixels in each of two views, side by side or a picture apart.
    fn pair(apart: u32) -> [Vec<Bounds>; 2] {
        [0, apart].map(|x| (0..200).map(|_| Bounds { x: [x, x + 63], y: [64, 127] }).collect())
    }

    /// What views have in common is made once, and what a view has by itself is given back at once; nothing that would be too large is in
    /// common.
    #[test]
    fn lists_are_in_common_where_that_is_worth_it() {
        let view = view();
        let items = vec![Item::default(); 200];
        let tiles = [const { Status::NEW }; 2 * TILES[0] * TILES[1]];
        for (apart, common) in [(0, 2), (5, 2), (100, 1)] {
            let bounds = pair(apart);
            let prospects = bounds.each_ref().map(|bounds| prospect(&view, &items, bounds));
            let batch = batch(false);
            let mut storage = Storage::default();
            let lists = lists(&batch, &prospects, &tiles, None, &mut storage);
            assert_eq!(lists.common(), common);
            let (sender, made) = std::sync::mpsc::channel();
            (0..2 * TILES[1]).into_par_iter().for_each_with(sender, |sender, i| {
                lists.with(i / TILES[1], i % TILES[1], |band| sender.send(std::ptr::from_ref(band) as usize).unwrap());
            });
            let mut made: Vec<usize> = made.into_iter().collect();
            made.sort_unstable();
            made.dedup();
            assert!(common == 1 || made.len() == TILES[1]);
            lists.recycle();
            let spare = storage.of_tiles.lock().unwrap().len();
            assert!(if common == 1 { (1..=made.len()).contains(&spare) } else { spare == TILES[1] }, "{spare}");
        }
        let [wide, _] = pair(0);
        assert!(are_common(&[wide.clone(), wide.clone()], 1) && !are_common(&[wide], 1));
        // 2^24 particles in all lists.
        let many = vec![Bounds { x: [0, 16_319], y: [0, 16_319] }; 64];
        assert!(are_common(&[many.clone(), many.clone()], 4) && !are_common(&[many.clone(), many], 5));
    }

    /// Where gas is dense, so many balls are drawn by their cores first as any view's tile asks for; elsewhere none.
    #[test]
    fn cores_come_first_where_gas_is_dense() {
        let view = view();
        let items = vec![Item { amplitude: 1.0, ..Item::default() }; 200];
        let tiles = [const { Status::NEW }; 2 * TILES[0] * TILES[1]];
        let seen = vec![Bounds { x: [0, 299], y: [0, 199] }; 200];
        // Half of them by one eye alone, as where the other's tile is finished.
        let half: Vec<Bounds> = (0..200).map(|i| if i % 2 == 0 { seen[i] } else { Bounds::EMPTY }).collect();
        let mut found = Vec::new();
        for (bounds, dense) in [([&seen, &seen], true), ([&half, &seen], true), ([&seen, &seen], false)] {
            let prospects = bounds.map(|bounds| prospect(&view, &items, bounds));
            let batch = batch(dense);
            let mut storage = Storage::default();
            let lists = lists(&batch, &prospects, &tiles, Some(1.0), &mut storage);
            found.push(
                [0, 1].map(|v| lists.with(v, 0, |band| (0..TILES[0]).map(|x| band.tile(x).0.len()).sum::<usize>())),
            );
        }
        // The last column of tiles is no wider than the picture.
        let least = dense::goal(TILE * TILE, 6.7) / (TILE * TILE) as f32;
        assert!(found[0][1] > TILES[0] * least as usize && found[0][1] < TILES[0] * 100, "{found:?}");
        assert_eq!(found[0][0], found[0][1]);
        assert_eq!(found[1][1], found[0][1]);
        assert_eq!(found[2], [0, 0]);
    }
}
