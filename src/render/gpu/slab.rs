//! Slabs of optical depth on the GPU: no order, the particles of each tile listed by eight slabs.
//!
//! What the CPU's engine of the same method does ([`crate::render::cpu::slab`]), pixel by pixel: one workgroup takes a tile
//! through the groups of slabs, front to back, and ends where nothing is seen any more. A submission holds as many groups as
//! its buffers allow; light and transmittance wait on the device for the next.

use super::Gpu;
use super::bin::{Stairs, TILE};
use super::compute::BINDINGS;
use super::device::WRITE;
use super::groups::{self, GROUP, Seen};
use super::layout::{self, finite};
use super::part::{Memory, Part, Times, stretches};
use super::shader;
use super::splat::Anchor;
use crate::error::Result;
use crate::picture::Plane;
use crate::render::cpu::engine::colors;
use crate::render::cpu::primitive::{self, Shape, Shell};
use crate::render::cpu::rim::Rim;
use crate::render::cpu::slab::{amplitude, extent};
use crate::render::cpu::splat::{Bounds, Lens};
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Scene, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Draws the particles of a scene cut into `slabs` slabs over its background and opaque layers into the films; `richardson`: the
/// extrapolation from that many and half as many. Where it is asked for, films get the estimate of their error.
pub fn draw(slabs: u32, richardson: bool, gpu: &mut Gpu, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
    gpu.with_memory(|gpu, buffers| draw_in(slabs, richardson, gpu, buffers, frame, progress))
}

fn draw_in(
    slabs: u32,
    richardson: bool,
    gpu: &mut Gpu,
    buffers: &mut Memory,
    frame: Frame,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, .. } = frame;
    let estimates = options.error_map;
    let bindings: Vec<_> = BINDINGS.into_iter().chain(estimates.then_some(WRITE)).collect();
    let pipeline = gpu.pipeline(&shader::slabs(richardson, estimates), &bindings)?;
    for film in &mut *films {
        film.error = estimates.then(|| Plane::new(film.transmittance.len()));
    }
    let mut shells: Vec<Shell> = Vec::new();
    let shapes: Vec<Shape> = scene.particles.iter().map(|set| Shape::new(&set.kernel, &mut shells)).collect();
    let tables: Vec<[f32; 4]> = shells.iter().map(Shell::numbers).collect();
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
    let groups = slabs.div_ceil(GROUP as u32);

    let height = views[0].size[1];
    let color_range = colors(scene).range;
    // What is left of the colours counts up to 5/3 of itself in the extrapolation.
    let tolerance = options.tolerance * if richardson { 0.6 } else { 1.0 };
    for rows in stretches(gpu.most_bytes(), views[0].size, u32::MAX) {
        let start = Instant::now();
        let seen: Vec<Vec<Seen<layout::Ball>>> = views
            .iter()
            .zip(&extents)
            .map(|(view, extent)| match extent {
                Some(extent) => prepare(scene, &shapes, &Lens::new(view), *extent, slabs, &rows),
                None => Vec::new(),
            })
            .collect();
        statistics.prepared += seen.iter().map(|seen| seen.len() as u64).sum::<u64>();
        times.transform += start.elapsed();
        let part = Part::new(gpu, (scene, views, opaque), tolerance, color_range, rows.clone());
        let part = Part { estimates, ..part };
        part.start(buffers, |depth, _| depth, &mut times);
        let submissions =
            groups::submit(&part, &pipeline, buffers, &tables, &seen, [groups, slabs], &mut times, progress)?;
        let (finished, composited) = part.finish(buffers, films, &mut times)?;
        part.check(finished, submissions)?;
        statistics.fragments += composited * u64::from(TILE * TILE);
        progress.update(u64::from(rows.end), u64::from(height));
    }
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
) -> Vec<Seen<layout::Ball>> {
    let view = lens.view;
    let step = (far - near) / f64::from(slabs);
    let group = |depth: f64| (((depth - near) / step) as usize).min(slabs as usize - 1) / GROUP;
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
            let bounds = Bounds { x: bounds.x, y: y.map(|y| y - rows.start) };
            let stairs = Stairs::new(&bounds, &Rim::ball(lens, c, 1.0), rows.start);
            Some(Seen { particle: ball, stairs, groups })
        };
        seen.par_extend((0..set.len()).into_par_iter().filter_map(one));
    }
    seen
}
