//! The sheet buffer on the GPU: slices parallel to the image, the particles of each tile listed by eight slices.
//!
//! What the CPU's engine of the same method does ([`crate::render::cpu::sheet`]), pixel by pixel: one workgroup takes a tile
//! through the slices, front to back, and ends where nothing is seen any more. Groups of slices that hold nothing are left out.

use super::Gpu;
use super::bin::{Stairs, TILE};
use super::compute::BINDINGS;
use super::groups::{self, GROUP, Seen};
use super::layout::{self, finite};
use super::part::{Memory, Part, Times, stretches};
use super::shader;
use super::splat::Anchor;
use crate::error::Result;
use crate::render::cpu::engine::colors;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::segments::Segments;
use crate::render::cpu::sheet::{Item, Slicing, items, tables};
use crate::render::cpu::splat::{Bounds, Lens};
use crate::render::{Frame, Progress, Statistics};
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Most groups of slices: their numbers take memory on the CPU.
const MOST_GROUPS: u64 = 1 << 20;

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw(slicing: Slicing, gpu: &mut Gpu, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
    gpu.with_memory(|gpu, buffers| draw_in(slicing, gpu, buffers, frame, progress))
}

fn draw_in(
    slicing: Slicing,
    gpu: &mut Gpu,
    buffers: &mut Memory,
    frame: Frame,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let pipeline = gpu.pipeline(&shader::slices(slicing.lookup), &BINDINGS)?;
    let (numbers, segments) = tables(scene, slicing);
    let entries: Vec<f32> = segments.iter().flat_map(Segments::entries).copied().collect();
    buffers.views.resize_with(views.len(), Default::default);
    let tables = buffers.upload_tables(gpu, bytemuck::cast_slice(&entries))?;
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut statistics = Statistics::default();

    let start = Instant::now();
    let lenses: Vec<Lens> = views.iter().map(Lens::new).collect();
    let items: Vec<Vec<Item>> = lenses.iter().map(|lens| items(scene, lens, slicing.width, &numbers)).collect();
    let occupied = Occupied::new(items.iter().flatten());
    if occupied.count > MOST_GROUPS {
        return Err(gpu.error("cannot hold so many slices: a greater slice_width would help"));
    }
    // Without gas the background is still to be shown.
    let count = occupied.count.max(1) as u32;
    statistics.prepared = items.iter().map(|items| items.len() as u64).sum();
    times.order = start.elapsed();

    let color_range = colors(scene).range;
    let height = views[0].size[1];
    for rows in stretches(gpu.most_bytes(), views[0].size, u32::MAX) {
        let start = Instant::now();
        let first = |item: &Item| (item.table as usize * segments[item.table as usize].entries().len()) as u32;
        let one = |lens: &Lens, item: &Item| disc(lens, item, slicing, first(item), &occupied, &rows);
        let seen: Vec<Vec<Seen<layout::Disc>>> = lenses
            .iter()
            .zip(&items)
            .map(|(lens, items)| items.par_iter().filter_map(|item| one(lens, item)).collect())
            .collect();
        times.transform += start.elapsed();
        let part = Part::new(gpu, (scene, views, opaque), options.tolerance, color_range, rows.clone());
        part.start(buffers, |depth, _| depth, &mut times);
        let submissions = groups::submit(&part, &pipeline, buffers, &tables, &seen, [count, 0], &mut times, progress)?;
        let (finished, composited) = part.finish(buffers, films, &mut times)?;
        part.check(finished, submissions)?;
        statistics.fragments += composited * u64::from(TILE * TILE);
        progress.update(u64::from(rows.end), u64::from(height));
    }
    statistics.stages = times.stages("compute");
    Ok(statistics)
}

/// A particle as the shader reads it; `None` where it covers nothing of the rows.
fn disc(
    lens: &Lens,
    item: &Item,
    slicing: Slicing,
    table: u32,
    occupied: &Occupied,
    rows: &Range<u32>,
) -> Option<Seen<layout::Disc>> {
    let y = [item.bounds.y[0].max(rows.start), item.bounds.y[1].min(rows.end - 1)];
    if y[0] > y[1] {
        return None;
    }
    let anchor = Anchor::new(lens, &Bounds { x: item.bounds.x, y });
    let forms = item.card.offsets(anchor.center());
    let near = lens.view.near;
    let slices = item.slices.map(|slice| slice as u64);
    let groups = slices.map(|slice| occupied.number(slice / GROUP as u64));
    let from_center = |depth: f64| finite((depth - item.depth) / item.radius);
    let disc = layout::Disc {
        x: forms[0].map(finite),
        y: forms[1].map(finite),
        color: item.color,
        thickness: item.thickness,
        anchor: anchor.pixel.map(|at| at as f32),
        plane: from_center(near + (item.slices[0] + 1.0) * slicing.width),
        step: finite(slicing.width / item.radius),
        start: from_center(near).max(-1.0),
        depth: finite(item.depth),
        inverse: finite(1.0 / item.radius),
        segments: slicing.segments as f32,
        table,
        first: (groups[0] * GROUP) as u32 + (slices[0] % GROUP as u64) as u32,
        padding: [0; 2],
    };
    let bounds = Bounds { x: item.bounds.x, y: y.map(|y| y - rows.start) };
    let stairs = Stairs::new(&bounds, &Rim::card(lens, &item.card), rows.start);
    Some(Seen { particle: disc, stairs, groups })
}

/// The groups of slices that hold anything, numbered front to back: thin slices far away are many, and most of them empty.
struct Occupied {
    /// Stretches without a gap: first group, the one after the last, and the number of those before.
    stretches: Vec<[u64; 3]>,
    count: u64,
}

impl Occupied {
    fn new<'a>(items: impl Iterator<Item = &'a Item>) -> Self {
        let mut spans: Vec<[u64; 2]> = items.map(|item| item.slices.map(|slice| slice as u64 / GROUP as u64)).collect();
        spans.par_sort_unstable();
        let mut stretches: Vec<[u64; 3]> = Vec::new();
        let mut count = 0;
        for [first, last] in spans {
            match stretches.last_mut() {
                Some([_, end, _]) if first <= *end => {
                    count += (last + 1).saturating_sub(*end);
                    *end = (*end).max(last + 1);
                }
                Some(_) | None => {
                    stretches.push([first, last + 1, count]);
                    count += last + 1 - first;
                }
            }
        }
        Self { stretches, count }
    }

    /// The number of an occupied group.
    fn number(&self, group: u64) -> usize {
        let stretch = self.stretches.partition_point(|[first, ..]| *first <= group).saturating_sub(1);
        let [first, _, before] = self.stretches[stretch];
        (before + group.saturating_sub(first)) as usize
    }
}
