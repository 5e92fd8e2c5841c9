//! Slabs of optical depth on the GPU: no order, the particles of each tile listed by eight slabs.
//!
//! What the CPU's engine of the same method does ([`crate::render::cpu::slab`]), pixel by pixel: one workgroup takes a tile
//! through the groups of slabs, front to back, and ends where nothing is seen any more. A submission holds as many groups as
//! its buffers allow; light and transmittance wait on the device for the next.

use super::Gpu;
use super::bin::{self, TILE};
use super::compute::{BINDINGS, Upload};
use super::layout::{self, finite};
use super::part::{Part, Times, stretches};
use super::shader;
use super::source::MOST_PAIRS;
use super::splat::Anchor;
use crate::error::Result;
use crate::render::cpu::engine::colors;
use crate::render::cpu::primitive::{self, Shape, Shell};
use crate::render::cpu::slab::{amplitude, extent};
use crate::render::cpu::splat::{Bounds, Lens};
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Scene, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Slabs that the shader holds in registers.
const SLABS: usize = 8;

/// A particle, the pixels it covers, counted from the first row of the stretch, and the first and last group of its slabs.
struct Seen {
    ball: layout::Ball,
    bounds: Bounds,
    groups: [usize; 2],
}

/// The particles of some groups of slabs, with their lists one group after the other.
#[derive(Default)]
struct Load {
    balls: Vec<layout::Ball>,
    starts: Vec<u32>,
    list: Vec<u32>,
}

/// Draws the particles of a scene cut into `slabs` slabs over its background and opaque layers into the films.
pub fn draw(slabs: u32, gpu: &mut Gpu, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let pipeline = gpu.pipeline(&shader::SLABS, &BINDINGS)?;
    let mut shells: Vec<Shell> = Vec::new();
    let shapes: Vec<Shape> = scene.particles.iter().map(|set| Shape::new(&set.kernel, &mut shells)).collect();
    let tables: Vec<[f32; 4]> = shells.iter().map(Shell::numbers).collect();
    let mut buffers = std::mem::take(&mut gpu.memory);
    buffers.views.resize_with(views.len(), Default::default);
    let tables = buffers.upload_tables(gpu, bytemuck::cast_slice(&tables))?;
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut statistics = Statistics::default();

    let start = Instant::now();
    // As the CPU does: with parallel axes the first view's planes are everybody's.
    let shared = stereo::share_depth(views);
    let first = extent(scene, &views[0]);
    let extents: Vec<Option<[f64; 2]>> =
        views.iter().map(|view| if shared { first } else { extent(scene, view) }).collect();
    times.order = start.elapsed();
    let groups = (slabs as usize).div_ceil(SLABS);

    let [width, height] = views[0].size;
    let color_range = colors(scene).range;
    let most = gpu.most_bytes();
    for rows in stretches(most, [width, height], u32::MAX) {
        let start = Instant::now();
        let seen: Vec<Vec<Seen>> = views
            .iter()
            .zip(&extents)
            .map(|(view, extent)| match extent {
                Some(extent) => prepare(scene, &shapes, &Lens::new(view), *extent, slabs, &rows),
                None => Vec::new(),
            })
            .collect();
        statistics.prepared += seen.iter().map(|seen| seen.len() as u64).sum::<u64>();
        times.transform += start.elapsed();
        let part = Part::new(gpu, (scene, views, opaque), options.tolerance, color_range, rows.clone());
        part.start(&mut buffers, |depth, _| depth, &mut times);
        let start = Instant::now();
        let ranges: Vec<Range<usize>> = cut(&seen, groups, most, gpu.longest_list());
        times.bin += start.elapsed();
        for range in &ranges {
            let start = Instant::now();
            let loads: Vec<Load> = seen.iter().map(|seen| load(seen, range, part.grid())).collect();
            times.bin += start.elapsed();
            for load in &loads {
                let largest =
                    (load.balls.len() * size_of::<layout::Ball>()).max(4 * load.list.len().max(load.starts.len()));
                if largest as u64 > most {
                    gpu.memory = buffers;
                    return Err(gpu.error("cannot hold the particles of eight slabs: more slabs would help"));
                }
            }
            let uploads: Vec<Upload> = loads
                .iter()
                .map(|load| Upload {
                    particles: bytemuck::cast_slice(&load.balls),
                    starts: &load.starts,
                    list: &load.list,
                })
                .collect();
            let ends = [range.start == 0, range.end == groups];
            part.submit(
                &pipeline,
                &mut buffers,
                &uploads,
                &tables,
                ends,
                [range.start as u32, range.len() as u32, slabs],
                &mut times,
            );
            progress.update(u64::from(rows.start), u64::from(height));
        }
        let (finished, composited) = part.finish(&mut buffers, films, &mut times)?;
        part.check(finished, ranges.len() as u64)?;
        statistics.fragments += composited * u64::from(TILE * TILE);
    }
    progress.update(1, 1);
    gpu.memory = buffers;
    statistics.stages = times.stages("compute");
    Ok(statistics)
}

/// The particles that some rows of a view may show, in order of their index.
fn prepare(
    scene: &Scene,
    shapes: &[Shape],
    lens: &Lens,
    [near, far]: [f64; 2],
    slabs: u32,
    rows: &Range<u32>,
) -> Vec<Seen> {
    let view = lens.view;
    let step = (far - near) / f64::from(slabs);
    let group = |depth: f64| (((depth - near) / step) as usize).min(slabs as usize - 1) / SLABS;
    let mut seen = Vec::new();
    for (set, shape) in scene.particles.iter().zip(shapes) {
        let [kind, shell, shells] = shape.numbers();
        let centre = primitive::centre(&set.kernel);
        let one = |i: usize| {
            let (radius, opacity) = (set.radius.get(i), set.opacity.get(i));
            let center = view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
            let depth = -center.z;
            if opacity == 0.0 || depth + radius <= view.near {
                return None;
            }
            let bounds = lens.ball_bounds(center, radius);
            if bounds.is_empty() {
                return None;
            }
            let y = [bounds.y[0].max(rows.start), bounds.y[1].min(rows.end - 1)];
            if y[0] > y[1] {
                return None;
            }
            let anchor = Anchor::new(lens, &Bounds { x: bounds.x, y });
            let c = center / radius;
            let [across, x_step, _] = anchor.form([c.z, 0.0], c.x);
            let [along, _, y_step] = anchor.form([0.0, -c.z], -c.y);
            let ball = layout::Ball {
                x: [across, x_step].map(finite),
                y: [along, y_step].map(finite),
                both: anchor.form([-c.y, c.x], 0.0).map(finite),
                plane: finite((near - depth) / radius),
                color: set.color.get(i),
                amplitude: amplitude(opacity, centre),
                anchor: anchor.pixel.map(|at| at as f32),
                step: finite(step / radius),
                near: finite((view.near - depth) / radius),
                depth: finite(depth),
                inverse: finite(1.0 / radius),
                shape: kind,
                shell,
                shells,
                padding: [0; 3],
            };
            // A hair more on both sides: rounding must not part a group from a plane that the shader finds in it.
            let slack = 1e-3 * step;
            let groups = [group((depth - radius - slack).max(view.near)), group(depth + radius + slack)];
            Some(Seen { ball, bounds: Bounds { x: bounds.x, y: y.map(|y| y - rows.start) }, groups })
        };
        seen.par_extend((0..set.len()).into_par_iter().filter_map(one));
    }
    seen
}

/// Cuts the groups into stretches whose particles and lists fit into buffers, as far as one group does.
fn cut(seen: &[Vec<Seen>], groups: usize, most: u64, longest: u64) -> Vec<Range<usize>> {
    // Of the view that has more; particles that go through several groups count in each.
    let mut balls = vec![0u64; groups];
    let mut pairs = vec![0u64; groups];
    for view in seen {
        let (mut own_balls, mut own_pairs) = (vec![0u64; groups], vec![0u64; groups]);
        for one in view {
            for group in one.groups[0]..=one.groups[1] {
                own_balls[group] += 1;
                own_pairs[group] += bin::tiles_of(&one.bounds);
            }
        }
        for (most, own) in balls.iter_mut().zip(own_balls).chain(pairs.iter_mut().zip(own_pairs)) {
            *most = (*most).max(own);
        }
    }
    let most_balls = longest.min(most / size_of::<layout::Ball>() as u64);
    let most_pairs = MOST_PAIRS.min(most / 4);
    let mut stretches = Vec::new();
    let mut start = 0;
    let mut sums = [0, 0];
    for group in 0..groups {
        let next = [sums[0] + balls[group], sums[1] + pairs[group]];
        if group > start && (next[0] > most_balls || next[1] > most_pairs) {
            stretches.push(start..group);
            start = group;
            sums = [balls[group], pairs[group]];
        } else {
            sums = next;
        }
    }
    stretches.push(start..groups);
    stretches
}

/// The particles and lists of some groups.
fn load(seen: &[Seen], groups: &Range<usize>, size: [u32; 2]) -> Load {
    let inside: Vec<&Seen> =
        seen.iter().filter(|one| one.groups[0] < groups.end && one.groups[1] >= groups.start).collect();
    let lists: Vec<(Vec<u32>, bin::Lists)> = groups
        .clone()
        .into_par_iter()
        .map(|group| {
            let ids: Vec<u32> = (0..)
                .zip(&inside)
                .filter(|(_, one)| one.groups[0] <= group && group <= one.groups[1])
                .map(|(id, _)| id)
                .collect();
            let bounds: Vec<Bounds> = ids.iter().map(|&id| inside[id as usize].bounds).collect();
            (ids, bin::lists(&bounds, size))
        })
        .collect();
    let mut load = Load { balls: inside.iter().map(|one| one.ball).collect(), ..Load::default() };
    for (ids, lists) in lists {
        let base = load.list.len() as u32;
        load.starts.extend(lists.starts.iter().map(|start| base + start));
        load.list.extend(lists.list.iter().map(|&i| ids[i as usize]));
    }
    load
}
