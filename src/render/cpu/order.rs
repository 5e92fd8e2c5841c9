//! Front-to-back order in batches: only as much is sorted as the picture needs.
//!
//! Keys are bucketed by one counting pass; a batch is the next buckets, sorted when it is asked for. When everything in
//! front has become opaque, what lies behind is never sorted. Order is total: by the exact f64 key, then by index, the
//! lower index farther (drawn first).

use super::simd::{Level, Simd, WithSimd, dispatch};
use crate::scene::{Attribute, ParticleSet, Scene, View};
use glam::DVec3;
use rayon::prelude::*;

/// What particles are ordered by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Depth, the same for both eyes when their axes are parallel.
    Depth,
    /// Distance from the view's own eye.
    Distance,
}

/// A particle's place in the scene: which set, and where in it. Indices count through the sets in scene order.
#[derive(Clone, Debug)]
pub struct Index {
    starts: Vec<u32>,
}

impl Index {
    /// The index of a scene. The scene has at most 2^32 - 1 particles.
    pub fn new(scene: &Scene) -> Self {
        let mut starts = vec![0u32];
        for set in &scene.particles {
            starts.push(starts[starts.len() - 1] + set.len() as u32);
        }
        Self { starts }
    }

    /// Every so many of all particles, at most 256 of them: how many each stands for, and their sets and positions within.
    pub fn sample(&self) -> (usize, impl Iterator<Item = (usize, usize)>) {
        const MOST: u32 = 256;
        let all = self.starts[self.starts.len() - 1];
        let stride = all.div_ceil(MOST).max(1) as usize;
        (stride, (0..all).step_by(stride).map(|id| self.locate(id)))
    }

    /// Set and position within the set of particle `id`.
    #[inline]
    pub fn locate(&self, id: u32) -> (usize, usize) {
        let set = if self.starts.len() == 2 { 0 } else { self.starts.partition_point(|&start| start <= id) - 1 };
        (set, (id - self.starts[set]) as usize)
    }
}

/// Measures keys for the views that share an order.
#[derive(Clone, Copy)]
struct Ruler {
    key: Key,
    eye: DVec3,
    /// World-space directions of eye-space x and y and of depth.
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    near: f64,
    /// How many radii before the near plane a centre may be: 1 where balls are clipped by it, 0 where they are dropped.
    reach: f64,
    /// Least and greatest x over depth that any of the views shows, and how far their eyes stand from `eye` along x.
    x: [f64; 2],
    shift: [f64; 2],
    /// Greatest y over depth.
    y: f64,
    /// No part of a splat is farther than this times its radius outside a side of the frustum that its centre is outside
    /// of: sqrt(2) for the corner of a square billboard, and the slope of the side, along which the distance is measured.
    margin: f64,
}

impl Ruler {
    fn new(views: &[View], key: Key, reach: f64) -> Self {
        let first = &views[0];
        let [right, up, back] = [0, 1, 2].map(|axis| first.eye_from_world.row(axis));
        let mut ruler = Self {
            key,
            eye: first.position,
            right,
            up,
            forward: -back,
            near: first.near,
            reach,
            x: [f64::INFINITY, f64::NEG_INFINITY],
            shift: [0.0; 2],
            y: first.half_extent.y,
            margin: 0.0,
        };
        for view in views {
            let shift = right.dot(view.position - first.position);
            ruler.shift = [ruler.shift[0].min(shift), ruler.shift[1].max(shift)];
            ruler.x[0] = ruler.x[0].min(view.shear - view.half_extent.x);
            ruler.x[1] = ruler.x[1].max(view.shear + view.half_extent.x);
        }
        let steepest = ruler.x[0].abs().max(ruler.x[1].abs()).max(ruler.y);
        ruler.margin = std::f64::consts::SQRT_2 * (1.0 + steepest * steepest).sqrt();
        ruler
    }

    /// The exact key of a point.
    #[inline(always)]
    fn measure(&self, point: DVec3) -> f64 {
        let offset = point - self.eye;
        match self.key {
            Key::Depth => self.forward.dot(offset),
            // Squared, which orders the same.
            Key::Distance => offset.length_squared(),
        }
    }

    /// The ascending bits of the key in single precision, or [`DROPPED`] for a particle that no view shows.
    #[inline(always)]
    fn coarse(&self, point: DVec3, radius: f64) -> u32 {
        let offset = point - self.eye;
        let depth = self.forward.dot(offset);
        let (x, y) = (self.right.dot(offset), self.up.dot(offset));
        let margin = radius * self.margin;
        let seen = (depth + radius * self.reach > self.near)
            & (x + margin >= depth * self.x[0] + self.shift[0])
            & (x - margin <= depth * self.x[1] + self.shift[1])
            & (y.abs() - margin <= depth * self.y);
        // f32 overflows for squared distances beyond 1e19 scene units: those share a key and are told apart exactly.
        if seen { ascending(self.measure(point) as f32) } else { DROPPED }
    }
}

/// Bits that ascend with the value, negative ones (depths behind the eye) included.
#[inline(always)]
fn ascending(value: f32) -> u32 {
    let bits = value.to_bits();
    bits ^ ((bits as i32 >> 31) as u32 | 1 << 31)
}

/// The pass over a stretch of particles that fills in their coarse keys. Its loops have no branches, so that the compiler
/// turns them into the vector instructions of the level it is dispatched to.
struct Measure<'a> {
    ruler: Ruler,
    set: &'a ParticleSet,
    first: usize,
    keys: &'a mut [u32],
}

impl WithSimd for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ruler, set, first, keys } = self;
        let range = first..first + keys.len();
        let points = set.x[range.clone()].iter().zip(&set.y[range.clone()]).zip(&set.z[range.clone()]);
        match &set.radius {
            Attribute::Uniform(radius) => {
                for (key, ((&x, &y), &z)) in keys.iter_mut().zip(points) {
                    *key = ruler.coarse(DVec3::new(x, y, z), *radius);
                }
            }
            Attribute::Each(radii) => {
                for ((key, ((&x, &y), &z)), radius) in keys.iter_mut().zip(points).zip(&radii[range]) {
                    *key = ruler.coarse(DVec3::new(x, y, z), *radius);
                }
            }
        }
    }
}

/// The order of a scene's particles seen from one view, or from all views that share it.
pub struct Order<'a> {
    scene: &'a Scene,
    index: &'a Index,
    ruler: Ruler,
    /// Key of every particle, bits that ascend with it, or [`DROPPED`].
    keys: Vec<u32>,
    buckets: Buckets,
    /// Number of particles in each bucket.
    counts: Vec<u32>,
    /// Particles of the buckets from `next` to `fetched`, in bucket order: key in the high half, the complement of the
    /// particle's index in the low half. Ascending order is nearest first and, among equals, the higher index first.
    entries: Vec<u64>,
    /// The next bucket to be given, and where it starts in `entries`.
    next: usize,
    next_entry: usize,
    /// End of the buckets that `entries` holds.
    fetched: usize,
    total: usize,
    given: usize,
    /// Whether particles of a bucket are sorted.
    exact: bool,
}

/// Buckets of equal width in the bits of the keys, a power of two.
#[derive(Clone, Copy)]
struct Buckets {
    low: u32,
    shift: u32,
    count: usize,
}

impl Buckets {
    #[inline]
    fn of(self, key: u32) -> usize {
        ((key - self.low) >> self.shift) as usize
    }
}

/// Particles per task of the passes over all particles.
const CHUNK: usize = 1 << 14;
const MAX_BUCKETS: usize = 1 << 13;
/// Least number of particles that are fetched from the keys at once; later fetches are as large as all before them.
const FETCH: usize = 1 << 15;

impl<'a> Order<'a> {
    /// Measures and counts all particles that `views`, which share the order, may show; `clips`: also those that only
    /// reach beyond the near plane. `storage` is scratch memory, reused.
    pub fn new(
        scene: &'a Scene,
        index: &'a Index,
        views: &[View],
        key: Key,
        clips: bool,
        level: Level,
        storage: &mut Storage,
    ) -> Self {
        let ruler = Ruler::new(views, key, if clips { 1.0 } else { 0.0 });
        let mut keys = std::mem::take(&mut storage.keys);
        let mut entries = std::mem::take(&mut storage.entries);
        entries.clear();
        keys.resize(scene.particle_count(), 0);
        let mut rest = keys.as_mut_slice();
        let mut pieces = Vec::new();
        for set in &scene.particles {
            let (mine, others) = rest.split_at_mut(set.len());
            rest = others;
            pieces.extend(mine.chunks_mut(CHUNK).enumerate().map(|(chunk, keys)| (set, chunk * CHUNK, keys)));
        }
        let (low, high) = pieces
            .into_par_iter()
            .map(|(set, first, keys)| {
                dispatch(level, Measure { ruler, set, first, keys: &mut *keys });
                let seen = keys.iter().copied().filter(|&key| key != DROPPED);
                seen.fold((u32::MAX, 0), |(low, high), key| (low.min(key), high.max(key)))
            })
            .reduce(|| (u32::MAX, 0), |a, b| (a.0.min(b.0), a.1.max(b.1)));

        let most = (keys.len() / 64).clamp(1, MAX_BUCKETS) as u32;
        let span = high.saturating_sub(low);
        let shift = (0..32).find(|shift| span >> shift < most).unwrap_or(31);
        let count = (span >> shift) as usize + 1;
        let buckets = Buckets { low, shift, count };
        let counts = keys
            .par_chunks(CHUNK * 4)
            .map(|keys| {
                let mut counts = vec![0; count];
                for &key in keys.iter().filter(|&&key| key != DROPPED) {
                    counts[buckets.of(key)] += 1;
                }
                counts
            })
            .reduce(
                || vec![0; count],
                |mut sum, counts| {
                    sum.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
                    sum
                },
            );
        let total = counts.iter().map(|&count| count as usize).sum();
        Self {
            scene,
            index,
            ruler,
            keys,
            buckets,
            counts,
            entries,
            next: 0,
            next_entry: 0,
            fetched: 0,
            total,
            given: 0,
            exact: true,
        }
    }

    /// Gives the particles in about that order: nearer buckets first, within a bucket by index. It is as total and as independent of
    /// threads.
    pub fn any(&mut self) {
        self.exact = false;
    }

    /// Number of particles that may be seen.
    pub fn len(&self) -> usize {
        self.total
    }

    /// Whether no particle may be seen.
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// The next particles, nearest first, at least `wanted` of them unless fewer are left; appended to `ids` as global
    /// indices. Nothing is appended when all have been given.
    pub fn next_batch(&mut self, wanted: usize, ids: &mut Vec<u32>) {
        let mut still = wanted.min(self.total - self.given);
        while still > 0 {
            if self.next == self.fetched {
                self.fetch(still);
            }
            let first = self.next_entry;
            let mut lengths = Vec::new();
            let mut taken = 0;
            while self.next < self.fetched && taken < still {
                let length = self.counts[self.next] as usize;
                self.next += 1;
                taken += length;
                lengths.push(length);
            }
            self.next_entry += taken;
            if self.exact {
                let mut rest = &mut self.entries[first..first + taken];
                let mut pieces = Vec::with_capacity(lengths.len());
                for length in lengths {
                    let (piece, others) = rest.split_at_mut(length);
                    pieces.push(piece);
                    rest = others;
                }
                let (scene, index, ruler) = (self.scene, self.index, self.ruler);
                pieces.into_par_iter().for_each(|piece| sort_exactly(piece, scene, index, ruler));
            }
            ids.extend(self.entries[first..first + taken].iter().map(|&entry| !(entry as u32)));
            self.given += taken;
            still = still.saturating_sub(taken);
        }
    }

    /// Collects the particles of the next buckets, at least `wanted` and [`FETCH`] unless fewer are left: a counting sort
    /// whose result does not depend on the number of threads.
    fn fetch(&mut self, wanted: usize) {
        let first = self.fetched;
        let mut starts = Vec::new();
        let mut total = 0;
        while self.fetched < self.buckets.count && total < wanted.max(FETCH).max(self.given) {
            starts.push(total);
            total += self.counts[self.fetched] as usize;
            self.fetched += 1;
        }
        let (buckets, range) = (self.buckets, first..self.fetched);
        let pieces: Vec<Vec<u64>> = self
            .keys
            .par_chunks(CHUNK * 4)
            .enumerate()
            .map(|(chunk, keys)| {
                let first_id = (chunk * CHUNK * 4) as u32;
                let mut entries = Vec::new();
                for (id, &key) in (first_id..).zip(keys) {
                    if key != DROPPED && range.contains(&buckets.of(key)) {
                        entries.push(u64::from(key) << 32 | u64::from(!id));
                    }
                }
                entries
            })
            .collect();
        self.entries.resize(total, 0);
        for &entry in pieces.iter().flatten() {
            let place = &mut starts[buckets.of((entry >> 32) as u32) - first];
            self.entries[*place] = entry;
            *place += 1;
        }
        self.next_entry = 0;
    }

    /// Whether every particle has been given.
    pub fn is_exhausted(&self) -> bool {
        self.given == self.total
    }

    /// Gives the memory back for the next order.
    pub fn recycle(self, storage: &mut Storage) {
        storage.entries = self.entries;
        storage.keys = self.keys;
    }
}

/// No bits of a finite positive f32.
const DROPPED: u32 = u32::MAX;

/// Scratch memory of [`Order`], kept from frame to frame.
#[derive(Default)]
pub struct Storage {
    keys: Vec<u32>,
    entries: Vec<u64>,
}

/// Sorts a bucket by f32 key and index, then every run of equal f32 keys by the exact key.
fn sort_exactly(entries: &mut [u64], scene: &Scene, index: &Index, ruler: Ruler) {
    entries.sort_unstable();
    let mut start = 0;
    while start < entries.len() {
        let key = entries[start] >> 32;
        let length = entries[start..].iter().take_while(|&&entry| entry >> 32 == key).count();
        if length > 1 {
            let exact = |&entry: &u64| {
                let (set, i) = index.locate(!(entry as u32));
                let set = &scene.particles[set];
                ruler.measure(DVec3::new(set.x[i], set.y[i], set.z[i]))
            };
            // Stable: among equal exact keys the index order of the first sort stays.
            entries[start..start + length].sort_by(|a, b| exact(a).total_cmp(&exact(b)));
        }
        start += length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Kernel};

    fn scene(points: &[[f64; 3]]) -> Scene {
        let set = ParticleSet {
            kernel: Kernel::Gaussian,
            x: points.iter().map(|p| p[0]).collect(),
            y: points.iter().map(|p| p[1]).collect(),
            z: points.iter().map(|p| p[2]).collect(),
            radius: Attribute::Uniform(10.0),
            opacity: Attribute::Uniform(0.5),
            color: Attribute::Uniform([1.0; 3]),
        };
        let camera = Camera::for_tests([8, 8]);
        // Two sets, so that indices count through them.
        let (mut a, mut b) = (set.clone(), set);
        for axis in [&mut a.x, &mut a.y, &mut a.z] {
            axis.truncate(points.len() / 3);
        }
        for axis in [&mut b.x, &mut b.y, &mut b.z] {
            axis.drain(..points.len() / 3);
        }
        Scene { camera, stereo: None, background: [0.0; 3], particles: vec![a, b], meshes: vec![] }
    }

    fn ordered(points: &[[f64; 3]], key: Key, clips: bool, batch: usize) -> Vec<u32> {
        let scene = scene(points);
        let index = Index::new(&scene);
        let mut order = Order::new(&scene, &index, &scene.views(), key, clips, Level::best(), &mut Storage::default());
        let mut ids = Vec::new();
        while !order.is_exhausted() {
            order.next_batch(batch, &mut ids);
        }
        ids
    }

    #[test]
    fn buckets_alone_are_as_complete_and_nearly_as_well_ordered() {
        let depth = |i: usize| 5.0 + ((i * 7919) % 3000) as f64 * 1e-3;
        let points: Vec<[f64; 3]> = (0..3000).map(|i| [0.0, 0.0, -depth(i)]).collect();
        let scene = scene(&points);
        let index = Index::new(&scene);
        let given = |batch: usize| {
            let mut storage = Storage::default();
            let mut order = Order::new(&scene, &index, &scene.views(), Key::Depth, false, Level::best(), &mut storage);
            order.any();
            let mut ids = Vec::new();
            while !order.is_exhausted() {
                order.next_batch(batch, &mut ids);
            }
            ids
        };
        let ids = given(100_000);
        assert_eq!(ids, given(100));
        let mut sorted = ids.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..3000));
        // Not in order, and out of it by a bucket at the most: 3 over the least number of them, half of 3000 / 64.
        let depths: Vec<f64> = ids.iter().map(|&i| depth(i as usize)).collect();
        let steps = depths.windows(2).map(|pair| pair[0] - pair[1]).fold(0.0, f64::max);
        assert!(steps > 0.0 && steps < 3.0 / 23.0, "{steps}");
    }

    #[test]
    fn order_is_exact_total_and_independent_of_batches() {
        // Depths that differ by less than an f32 can tell, exact ties, and particles behind the near plane.
        let points: Vec<[f64; 3]> = (0..3000)
            .map(|i| {
                let i = f64::from(i);
                [(i * 0.7).sin(), (i * 1.3).cos(), -5.0 - (i * 0.37).sin() * if i < 1500.0 { 1e-9 } else { 6.0 }]
            })
            .chain((0..50).map(|i| [f64::from(i) * 0.01, 0.0, -3.0]))
            .collect();
        for key in [Key::Depth, Key::Distance] {
            let measure = |i: u32| {
                let [x, y, z] = points[i as usize];
                if key == Key::Depth { -z } else { x * x + y * y + z * z }
            };
            // All radii are 10: a ball that is clipped may lie with its centre up to 9.9 behind the eye.
            for (clips, nearest) in [(false, 0.1), (true, -9.9)] {
                let mut expected: Vec<u32> =
                    (0..points.len() as u32).filter(|&i| -points[i as usize][2] > nearest).collect();
                expected.sort_by(|&a, &b| measure(a).total_cmp(&measure(b)).then(b.cmp(&a)));
                for batch in [1, 100, 100_000] {
                    assert_eq!(ordered(&points, key, clips, batch), expected, "{key:?}, {clips}, batches of {batch}");
                }
            }
        }
    }
}
