//! The particles of a view in its order, prepared in batches that fit into buffers.

use super::bin::{Stairs, TILE};
use super::layout::{self, finite};
use super::part::Times;
use super::splat::{Anchor, Shaded};
use crate::render::Statistics;
use crate::render::cpu::engine::{Job, Memory};
use crate::render::cpu::order::{Key, Order};
use crate::render::cpu::rim::Rim;
use crate::render::cpu::splat::{Bounds, Lens};
use crate::scene::{View, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Particles that are prepared at once, at the most.
const MOST_SPLATS: u64 = 1 << 20;
/// Pairs of particle and tile in one submission, at the most: short enough that no system takes the device for stuck.
pub(super) const MOST_PAIRS: u64 = 1 << 23;

/// Indices of the particles of each view, nearest first; views that share their order share the list.
pub(super) struct Orders {
    lists: Vec<Vec<u32>>,
    /// Views for each list.
    step: usize,
}

impl Orders {
    /// Orders the particles by the method's key, those that some view may show.
    pub fn new<A: Shaded>(job: &Job, views: &[View], memory: &mut Memory) -> Self {
        let shared = A::KEY == Key::Depth && stereo::share_depth(views);
        let step = if shared { views.len() } else { 1 };
        let of_some = |first: usize| {
            let views = &views[first..first + step];
            let (scene, level) = (job.scene, job.options.level);
            let mut order = Order::new(scene, &job.index, views, A::KEY, A::VOLUMETRIC, level, &mut memory.order);
            let mut ids = Vec::new();
            order.next_batch(usize::MAX, &mut ids);
            order.recycle(&mut memory.order);
            ids
        };
        Self { lists: (0..views.len()).step_by(step).map(of_some).collect(), step }
    }
}

/// The particles of a view that are still to be drawn in a stretch of rows.
pub(super) struct Source<'a, A: Shaded> {
    alignment: A,
    lens: Lens<'a>,
    rows: Range<u32>,
    ids: &'a [u32],
    /// Prepared and not yet drawn; bounds count from the first row of the stretch.
    pub splats: Vec<layout::Splat>,
    /// The pixels that each of them covers, and what it shows nothing beyond.
    pub covered: Vec<(Bounds, Rim)>,
    used: usize,
}

impl<'a, A: Shaded> Source<'a, A> {
    /// The sources of all views for a stretch of rows.
    pub fn of_all(alignment: A, views: &'a [View], orders: &'a Orders, rows: &Range<u32>) -> Vec<Self> {
        let of_one = |(v, view): (usize, &'a View)| Self {
            alignment,
            lens: Lens::new(view),
            rows: rows.clone(),
            ids: &orders.lists[v / orders.step][..],
            splats: Vec::new(),
            covered: Vec::new(),
            used: 0,
        };
        views.iter().enumerate().map(of_one).collect()
    }

    /// Whether all particles were in a batch.
    pub fn is_exhausted(&self) -> bool {
        self.ids.is_empty() && self.used == self.splats.len()
    }

    /// The next batch, a range of [`Source::splats`]: as many particles as `most` bytes allow in a buffer, and `longest`.
    pub fn next(
        &mut self,
        job: &Job,
        [most, longest]: [u64; 2],
        times: &mut Times,
        statistics: &mut Statistics,
    ) -> Range<usize> {
        let start = Instant::now();
        while self.used == self.splats.len() && !self.ids.is_empty() {
            let count = MOST_SPLATS.min(longest).min(most / size_of::<layout::Splat>() as u64) as usize;
            let (now, later) = self.ids.split_at(count.min(self.ids.len()));
            self.ids = later;
            (self.splats, self.covered) = now.par_iter().filter_map(|&id| self.prepare(job, id)).unzip();
            self.used = 0;
            statistics.prepared += now.len() as u64;
        }
        let allowed = MOST_PAIRS.min(most / 4);
        let mut pairs = 0;
        // As if it had no rim: no fewer than there are.
        let tiles = |[first, last]: [u32; 2]| u64::from(last / TILE - first / TILE + 1);
        let fitting = self.covered[self.used..].iter().take_while(|(bounds, _)| {
            pairs += tiles(bounds.x) * tiles(bounds.y);
            pairs <= allowed
        });
        // A particle alone always fits: there are fewer tiles than a stretch has bytes.
        let count = fitting.count().max(1).min(self.splats.len() - self.used);
        let splats = self.used..self.used + count;
        self.used = splats.end;
        times.transform += start.elapsed();
        splats
    }

    /// The tiles of the stretch that prepared particles reach into.
    pub fn stairs(&self, splats: Range<usize>) -> Vec<Stairs> {
        self.covered[splats].par_iter().map(|(bounds, rim)| Stairs::new(bounds, rim, self.rows.start)).collect()
    }

    fn prepare(&self, job: &Job, id: u32) -> Option<(layout::Splat, (Bounds, Rim))> {
        let (number, i) = job.index.locate(id);
        let set = &job.scene.particles[number];
        let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
        let (item, bounds) = job.prepare_one(self.alignment, &self.lens, number, i, point)?;
        let rows = [bounds.y[0].max(self.rows.start), bounds.y[1].min(self.rows.end - 1)];
        if rows[0] > rows[1] {
            return None;
        }
        let anchor = Anchor::new(&self.lens, &Bounds { x: bounds.x, y: rows });
        let forms = A::forms(&item.splat, &anchor);
        let splat = layout::Splat {
            x: forms.x.map(finite),
            y: forms.y.map(finite),
            both: forms.both.map(finite),
            own: finite(forms.own),
            ahead: forms.ahead.map(finite),
            front: finite(item.front.into()),
            color: item.color,
            amplitude: item.amplitude,
            anchor: anchor.pixel.map(|at| at as f32),
            most: finite(item.most.into()),
            intervals: item.table.intervals(),
            table: item.table.start(),
            inverse: finite(forms.inverse),
            padding: [0; 2],
        };
        let rim = A::rim(&item.splat, &self.lens, item.table.intervals() == 0.0);
        Some((splat, (Bounds { x: bounds.x, y: rows.map(|y| y - self.rows.start) }, rim)))
    }
}
