//! Front-to-back order in batches: only as much is sorted as the picture needs.
//!
//! Keys are bucketed by one counting pass; a batch is the next buckets, sorted when it is asked for. When everything in
//! front has become opaque, what lies behind is never sorted. Order is total: by the exact f64 key, then by index, the
//! lower index farther (drawn first).

use crate::scene::{Scene, View};
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

    /// Set and position within the set of particle `id`.
    #[inline]
    pub fn locate(&self, id: u32) -> (usize, usize) {
        let set = if self.starts.len() == 2 { 0 } else { self.starts.partition_point(|&start| start <= id) - 1 };
        (set, (id - self.starts[set]) as usize)
    }
}

/// Measures keys for one view (or for two views with parallel axes).
#[derive(Clone, Copy)]
struct Ruler {
    key: Key,
    eye: DVec3,
    /// World-space direction of increasing depth.
    forward: DVec3,
    near: f64,
}

impl Ruler {
    /// The exact key, negative infinity for a particle that is not drawn.
    #[inline]
    fn measure(&self, x: f64, y: f64, z: f64) -> f64 {
        let offset = DVec3::new(x, y, z) - self.eye;
        let depth = self.forward.dot(offset);
        if depth <= self.near {
            return f64::NEG_INFINITY;
        }
        match self.key {
            Key::Depth => depth,
            Key::Distance => offset.length_squared(),
        }
    }
}

/// The order of a scene's particles seen from one view, or from all views that share it.
pub struct Order<'a> {
    scene: &'a Scene,
    index: &'a Index,
    ruler: Ruler,
    /// Key (as the bits of a positive f32) in the high half, the complement of the particle's index in the low half:
    /// ascending order is nearest first and, among equals, the higher index first.
    entries: Vec<u64>,
    /// End of each bucket in `entries`.
    ends: Vec<u32>,
    next: usize,
    done: usize,
}

/// Particles per task of the counting passes.
const CHUNK: usize = 1 << 14;
const MAX_BUCKETS: usize = 1 << 13;

impl<'a> Order<'a> {
    /// Measures and buckets all particles in front of the near plane of `view`. `storage` is scratch memory, reused.
    pub fn new(scene: &'a Scene, index: &'a Index, view: &View, key: Key, storage: &mut Storage) -> Self {
        let forward = -view.eye_from_world.row(2);
        let ruler = Ruler { key, eye: view.position, forward, near: view.near };
        let mut keys = std::mem::take(&mut storage.keys);
        let mut entries = std::mem::take(&mut storage.entries);
        let count = scene.particle_count();
        keys.resize(count, 0);
        // Distances are measured squared; so are their keys. f32 overflows only beyond 1e19 scene units.
        let mut rest = keys.as_mut_slice();
        let mut pieces = Vec::new();
        for set in &scene.particles {
            let (mine, others) = rest.split_at_mut(set.len());
            rest = others;
            let (xs, ys, zs) = (set.x.chunks(CHUNK), set.y.chunks(CHUNK), set.z.chunks(CHUNK));
            pieces.extend(mine.chunks_mut(CHUNK).zip(xs.zip(ys.zip(zs))));
        }
        let (low, high) = pieces
            .into_par_iter()
            .map(|(keys, (xs, (ys, zs)))| {
                let (mut low, mut high) = (u32::MAX, 0);
                for (key, (x, (y, z))) in keys.iter_mut().zip(xs.iter().zip(ys.iter().zip(zs))) {
                    let exact = ruler.measure(*x, *y, *z);
                    *key = if exact < 0.0 { DROPPED } else { (exact as f32).to_bits() };
                    if *key != DROPPED {
                        low = low.min(*key);
                        high = high.max(*key);
                    }
                }
                (low, high)
            })
            .reduce(|| (u32::MAX, 0), |a, b| (a.0.min(b.0), a.1.max(b.1)));

        // Counting sort into buckets of equal key width, stable and independent of the number of threads.
        let buckets = (count / 64).clamp(1, MAX_BUCKETS);
        let span = u64::from(high.saturating_sub(low)) + 1;
        let bucket = |key: u32| (u64::from(key - low) * buckets as u64 / span) as usize;
        let counts: Vec<Vec<u32>> = keys
            .par_chunks(CHUNK * 4)
            .map(|keys| {
                let mut counts = vec![0; buckets];
                for &key in keys.iter().filter(|&&key| key != DROPPED) {
                    counts[bucket(key)] += 1;
                }
                counts
            })
            .collect();
        let mut ends = vec![0u32; buckets];
        for counts in &counts {
            for (end, count) in ends.iter_mut().zip(counts) {
                *end += count;
            }
        }
        let mut total = 0;
        for end in &mut ends {
            total += *end;
            *end = total;
        }
        entries.clear();
        entries.resize(total as usize, 0);
        let mut place: Vec<u32> = std::iter::once(0).chain(ends.iter().copied()).take(buckets).collect();
        for (id, &key) in keys.iter().enumerate() {
            if key != DROPPED {
                let place = &mut place[bucket(key)];
                entries[*place as usize] = u64::from(key) << 32 | u64::from(!(id as u32));
                *place += 1;
            }
        }
        storage.keys = keys;
        Self { scene, index, ruler, entries, ends, next: 0, done: 0 }
    }

    /// Number of particles in front of the near plane.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// The next particles, nearest first, at least `wanted` of them unless fewer are left; appended to `ids` as global
    /// indices. Nothing is appended when all have been given.
    pub fn next_batch(&mut self, wanted: usize, ids: &mut Vec<u32>) {
        let first = self.done;
        let mut bounds = Vec::new();
        while self.next < self.ends.len() && self.done - first < wanted {
            let end = self.ends[self.next] as usize;
            self.next += 1;
            if end > self.done {
                bounds.push(end - self.done);
                self.done = end;
            }
        }
        let mut rest = &mut self.entries[first..self.done];
        let mut pieces = Vec::with_capacity(bounds.len());
        for length in bounds {
            let (piece, others) = rest.split_at_mut(length);
            pieces.push(piece);
            rest = others;
        }
        let (scene, index, ruler) = (self.scene, self.index, self.ruler);
        pieces.into_par_iter().for_each(|piece| sort_exactly(piece, scene, index, ruler));
        ids.extend(self.entries[first..self.done].iter().map(|&entry| !(entry as u32)));
    }

    /// Whether every particle has been given.
    pub fn is_exhausted(&self) -> bool {
        self.done == self.entries.len()
    }

    /// Gives the memory back for the next order.
    pub fn recycle(self, storage: &mut Storage) {
        storage.entries = self.entries;
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
                ruler.measure(set.x[i], set.y[i], set.z[i])
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
    use crate::scene::{Attribute, Camera, Kernel, ParticleSet};

    fn scene(points: &[[f64; 3]]) -> Scene {
        let set = ParticleSet {
            kernel: Kernel::Gaussian,
            x: points.iter().map(|p| p[0]).collect(),
            y: points.iter().map(|p| p[1]).collect(),
            z: points.iter().map(|p| p[2]).collect(),
            radius: Attribute::Uniform(1.0),
            opacity: Attribute::Uniform(0.5),
            color: Attribute::Uniform([1.0; 3]),
        };
        let camera = Camera {
            position: DVec3::ZERO,
            look_at: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y: 1.0,
            size: [8, 8],
            near: 0.1,
            samples: 1,
        };
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

    fn ordered(points: &[[f64; 3]], key: Key, batch: usize) -> Vec<u32> {
        let scene = scene(points);
        let index = Index::new(&scene);
        let mut order = Order::new(&scene, &index, &scene.views()[0], key, &mut Storage::default());
        let mut ids = Vec::new();
        while !order.is_exhausted() {
            order.next_batch(batch, &mut ids);
        }
        ids
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
            let mut expected: Vec<u32> = (0..points.len() as u32).filter(|&i| -points[i as usize][2] > 0.1).collect();
            expected.sort_by(|&a, &b| measure(a).total_cmp(&measure(b)).then(b.cmp(&a)));
            for batch in [1, 100, 100_000] {
                assert_eq!(ordered(&points, key, batch), expected, "{key:?}, batches of {batch}");
            }
        }
    }
}
