//! A frame: particles ordered, prepared and listed by tile on the CPU, composited on the GPU, read back.

use super::Gpu;
use super::bin::{self, TILE};
use super::device::{Growing, READ, WRITE};
use super::layout::{self, finite};
use super::shader;
use super::splat::{Anchor, Shaded};
use crate::error::Result;
use crate::render::cpu::engine::Job;
use crate::render::cpu::order::{Key, Order};
use crate::render::cpu::splat::{Bounds, Lens};
use crate::render::cpu::tile::{stop_transmittance, survey};
use crate::render::opaque::OpaqueLayer;
use crate::render::{Frame, Progress, Statistics};
use crate::scene::{Rgb, View, stereo};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::{Duration, Instant};
use wgpu::{BufferBindingType, BufferUsages};

/// Particles that are prepared at once, at the most.
const MOST_SPLATS: u64 = 1 << 20;
/// Pairs of particle and tile in one submission, at the most: short enough that no system takes the device for stuck.
pub(super) const MOST_PAIRS: u64 = 1 << 23;
/// Those of `shaders/bindings.wgsl`.
pub(super) const BINDINGS: [BufferBindingType; 8] =
    [BufferBindingType::Uniform, READ, READ, READ, READ, READ, WRITE, WRITE];
/// Bytes of a pixel of the film or of the opaque layer.
const PIXEL: u64 = 16;

/// Buffers that are kept from frame to frame.
#[derive(Default)]
pub struct Memory {
    pub(super) views: Vec<Buffers>,
    pub(super) tables: Growing,
    times: Option<(wgpu::QuerySet, wgpu::Buffer)>,
}

/// The buffers of one view.
#[derive(Default)]
pub(super) struct Buffers {
    view: Growing,
    splats: Growing,
    starts: Growing,
    list: Growing,
    surfaces: Growing,
    film: Growing,
    tally: Growing,
    back: Growing,
}

/// Wall times of the stages; that of `compute` is the device's own where it has a clock.
#[derive(Default)]
pub(super) struct Times {
    pub prepare: Duration,
    pub order: Duration,
    pub transform: Duration,
    pub bin: Duration,
    pub upload: Duration,
    pub compute: Duration,
    pub back: Duration,
}

impl Times {
    /// As statistics have them.
    pub fn stages(&self) -> Vec<(&'static str, Duration)> {
        vec![
            ("prepare", self.prepare),
            ("order", self.order),
            ("transform", self.transform),
            ("bin", self.bin),
            ("upload", self.upload),
            ("compute", self.compute),
            ("read back", self.back),
        ]
    }
}

/// The particles of a view that are still to be drawn in a stretch of rows.
struct Source<'a, A: Shaded> {
    alignment: A,
    lens: Lens<'a>,
    rows: Range<u32>,
    ids: &'a [u32],
    /// Prepared and not yet drawn; bounds count from the first row of the stretch.
    splats: Vec<layout::Splat>,
    bounds: Vec<Bounds>,
    used: usize,
}

/// A batch of particles with their lists.
struct Load {
    splats: Range<usize>,
    lists: bin::Lists,
}

impl<A: Shaded> Source<'_, A> {
    fn is_exhausted(&self) -> bool {
        self.ids.is_empty() && self.used == self.splats.len()
    }

    /// The next batch, as many particles as `most` bytes allow in a buffer.
    fn next(
        &mut self,
        job: &Job,
        [most, longest]: [u64; 2],
        across: u32,
        times: &mut Times,
        statistics: &mut Statistics,
    ) -> Load {
        let start = Instant::now();
        while self.used == self.splats.len() && !self.ids.is_empty() {
            let count = MOST_SPLATS.min(longest).min(most / size_of::<layout::Splat>() as u64) as usize;
            let (now, later) = self.ids.split_at(count.min(self.ids.len()));
            self.ids = later;
            (self.splats, self.bounds) = now.par_iter().filter_map(|&id| self.prepare(job, id)).unzip();
            self.used = 0;
            statistics.prepared += now.len() as u64;
        }
        let prepared = Instant::now();
        let allowed = MOST_PAIRS.min(most / 4);
        let mut pairs = 0;
        let fitting = self.bounds[self.used..].iter().take_while(|bounds| {
            pairs += bin::tiles_of(bounds);
            pairs <= allowed
        });
        // A particle alone always fits: there are fewer tiles than a stretch has bytes.
        let count = fitting.count().max(1).min(self.splats.len() - self.used);
        let splats = self.used..self.used + count;
        self.used = splats.end;
        let down = self.rows.len().div_ceil(TILE as usize) as u32;
        let lists = bin::lists(&self.bounds[splats.clone()], [across, down]);
        times.transform += prepared - start;
        times.bin += prepared.elapsed();
        Load { splats, lists }
    }

    fn prepare(&self, job: &Job, id: u32) -> Option<(layout::Splat, Bounds)> {
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
        Some((splat, Bounds { x: bounds.x, y: rows.map(|y| y - self.rows.start) }))
    }
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw<A: Shaded>(alignment: A, gpu: &mut Gpu, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, memory } = frame;
    let job = Job::new::<A>(scene, options, memory);
    let pipeline = gpu.pipeline(&shader::tile(A::SHADER, job.model), &BINDINGS)?;
    let tables = job.tables.values();
    let table_bytes: &[u8] = bytemuck::cast_slice(tables);
    if table_bytes.len() as u64 > gpu.most_bytes() {
        return Err(gpu.error("cannot hold the footprint tables of so many kernels"));
    }
    let mut buffers = std::mem::take(&mut gpu.memory);
    buffers.views.resize_with(views.len(), Buffers::default);
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let table_buffer = buffers.tables.room(&gpu.device, table_bytes.len() as u64, storage);
    gpu.queue.write_buffer(&table_buffer, 0, table_bytes);
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut statistics = Statistics::default();

    let start = Instant::now();
    let shared = A::KEY == Key::Depth && stereo::share_depth(views);
    let step = if shared { views.len() } else { 1 };
    let orders: Vec<Vec<u32>> = (0..views.len())
        .step_by(step)
        .map(|first| {
            let views = &views[first..first + step];
            let mut order =
                Order::new(scene, &job.index, views, A::KEY, A::VOLUMETRIC, options.level, &mut memory.order);
            let mut ids = Vec::new();
            order.next_batch(usize::MAX, &mut ids);
            order.recycle(&mut memory.order);
            ids
        })
        .collect();
    times.order = start.elapsed();

    let [width, height] = views[0].size;
    let across = width.div_ceil(TILE);
    let most = gpu.most_bytes();
    for stretch in stretches(most, [width, height]) {
        let first_row = stretch.start;
        let mut sources: Vec<Source<A>> = views
            .iter()
            .enumerate()
            .map(|(v, view)| Source {
                alignment,
                lens: Lens::new(view),
                rows: stretch.clone(),
                ids: &orders[v / step],
                splats: Vec::new(),
                bounds: Vec::new(),
                used: 0,
            })
            .collect();
        let part = Part {
            gpu,
            pipeline: &pipeline,
            views,
            opaque,
            background: scene.background,
            tolerance: options.tolerance,
            range: job.colors.range,
            rows: stretch,
            across,
        };
        part.start(&mut buffers, A::opaque_limit, &mut times);
        let mut submissions = 0;
        loop {
            let loads: Vec<Load> = sources
                .iter_mut()
                .map(|source| source.next(&job, [most, gpu.longest_list()], across, &mut times, &mut statistics))
                .collect();
            let last = sources.iter().all(Source::is_exhausted);
            let tables = (&table_buffer, table_bytes.len().max(4) as u64);
            let uploads: Vec<Upload> = sources
                .iter()
                .zip(&loads)
                .map(|(source, load)| Upload {
                    particles: bytemuck::cast_slice(&source.splats[load.splats.clone()]),
                    starts: &load.lists.starts,
                    list: &load.lists.list,
                })
                .collect();
            part.submit(&mut buffers, &uploads, tables, [submissions == 0, last], [0; 3], &mut times);
            submissions += 1;
            progress.update(u64::from(first_row), u64::from(height));
            if last {
                break;
            }
        }
        let (finished, composited) = part.finish(&mut buffers, films, &mut times)?;
        part.check(finished, submissions)?;
        // Whole tiles at a time, as the CPU counts whole blocks.
        statistics.fragments += composited * u64::from(TILE * TILE);
    }
    progress.update(1, 1);
    gpu.memory = buffers;
    job.recycle(memory);
    statistics.stages = times.stages();
    Ok(statistics)
}

/// Stretches of whole rows of tiles whose films fit into `most` bytes, or of one row of tiles.
pub(super) fn stretches(most: u64, [width, height]: [u32; 2]) -> Vec<Range<u32>> {
    let rows = (most / PIXEL / u64::from(width) / u64::from(TILE)).clamp(1, 1 << 20) as u32 * TILE;
    (0..height).step_by(rows as usize).map(|first| first..height.min(first + rows)).collect()
}

/// A stretch of rows of all views.
pub(super) struct Part<'a> {
    pub gpu: &'a Gpu,
    pub pipeline: &'a wgpu::ComputePipeline,
    pub views: &'a [View],
    pub opaque: &'a [Option<OpaqueLayer>],
    pub background: Rgb,
    /// What may be lost by ending early, and the range of the gas's colours.
    pub tolerance: f64,
    pub range: [[f32; 2]; 3],
    pub rows: Range<u32>,
    pub across: u32,
}

/// What a view uploads for a submission.
pub(super) struct Upload<'a> {
    /// Particles, as the shader reads them.
    pub particles: &'a [u8],
    /// As in [`bin::Lists`].
    pub starts: &'a [u32],
    /// As in [`bin::Lists`].
    pub list: &'a [u32],
}

/// Bytes of what a view gives back beside its film: two counts.
const TALLY: u64 = 8;

impl Part<'_> {
    fn pixels(&self) -> u64 {
        u64::from(self.views[0].size[0]) * self.rows.len() as u64
    }

    /// Uploads what all batches share.
    pub fn start(&self, buffers: &mut Memory, limit: fn(f64, f64) -> f64, times: &mut Times) {
        let start = Instant::now();
        let device = &self.gpu.device;
        for ((view, layer), buffers) in self.views.iter().zip(self.opaque).zip(&mut buffers.views) {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            buffers.film.room(device, self.pixels() * PIXEL, usage);
            let tally = buffers.tally.room(device, TALLY, usage);
            self.gpu.queue.write_buffer(&tally, 0, &[0; TALLY as usize]);
            if let Some(layer) = layer {
                let surfaces = buffers.surfaces.room(device, self.pixels() * PIXEL, usage);
                let values = surfaces_of(view, layer, self.background, limit, &self.rows);
                self.gpu.queue.write_buffer(&surfaces, 0, bytemuck::cast_slice(&values));
            }
        }
        times.upload += start.elapsed();
    }

    /// Uploads a batch of each view and has it composited. `slabs`: the first group of slabs, the number of groups and that of
    /// all slabs.
    pub fn submit(
        &self,
        memory: &mut Memory,
        loads: &[Upload],
        tables: (&wgpu::Buffer, u64),
        [first, last]: [bool; 2],
        slabs: [u32; 3],
        times: &mut Times,
    ) {
        let start = Instant::now();
        let Gpu { device, queue, .. } = self.gpu;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let mut groups = Vec::with_capacity(loads.len());
        for (v, (load, buffers)) in loads.iter().zip(&mut memory.views).enumerate() {
            let upload = |buffer: &mut Growing, bytes: &[u8], usage| {
                let buffer = buffer.room(device, bytes.len() as u64, usage);
                queue.write_buffer(&buffer, 0, bytes);
                (buffer, (bytes.len() as u64).max(256))
            };
            let view = self.view(v, first, last, slabs);
            let view =
                upload(&mut buffers.view, bytemuck::bytes_of(&view), BufferUsages::UNIFORM | BufferUsages::COPY_DST);
            let splats = upload(&mut buffers.splats, load.particles, storage);
            let starts = upload(&mut buffers.starts, bytemuck::cast_slice(load.starts), storage);
            let list = upload(&mut buffers.list, bytemuck::cast_slice(load.list), storage);
            let film_size = self.pixels() * PIXEL;
            let usage = storage | BufferUsages::COPY_SRC;
            let film = buffers.film.room(device, film_size, usage);
            let tally = buffers.tally.room(device, TALLY, usage);
            let surfaces_size = if self.opaque[v].is_some() { film_size } else { PIXEL };
            let surfaces = buffers.surfaces.room(device, surfaces_size, usage);
            let group = self.gpu.bind(
                self.pipeline,
                &[
                    (&view.0, size_of::<layout::View>() as u64),
                    (&splats.0, splats.1),
                    (&starts.0, starts.1),
                    (&list.0, list.1),
                    (tables.0, tables.1.max(16)),
                    (&surfaces, surfaces_size),
                    (&film, film_size),
                    (&tally, TALLY),
                ],
            );
            groups.push(group);
        }
        let mut encoder = device.create_command_encoder(&Default::default());
        if self.gpu.clock.is_some() && memory.times.is_none() {
            let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
            let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
            memory.times = Some((device.create_query_set(&descriptor), self.gpu.buffer(16, usage)));
        }
        let timestamp_writes =
            memory.times.as_ref().filter(|_| first || last).map(|(query_set, _)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: first.then_some(0),
                end_of_pass_write_index: last.then_some(1),
            });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        pass.set_pipeline(self.pipeline);
        for group in &groups {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(self.across, (self.rows.len() as u32).div_ceil(TILE), 1);
        }
        drop(pass);
        queue.submit([encoder.finish()]);
        times.upload += start.elapsed();
    }

    /// Waits for the films and copies them; returns the number of tiles finished and that of particles composited, summed
    /// over tiles.
    pub fn finish(
        &self,
        memory: &mut Memory,
        films: &mut [crate::picture::Film],
        times: &mut Times,
    ) -> Result<(u64, u64)> {
        let start = Instant::now();
        let Gpu { device, queue, clock, .. } = self.gpu;
        self.gpu.wait()?;
        let computed = Instant::now();
        let film_size = self.pixels() * PIXEL;
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut backs = Vec::with_capacity(films.len());
        // Film, counts, and the device's two times.
        let size = film_size + TALLY + 16;
        for buffers in &mut memory.views {
            let back = buffers.back.room(device, size, usage);
            let source = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            encoder.copy_buffer_to_buffer(&buffers.film.room(device, film_size, source), 0, &back, 0, film_size);
            encoder.copy_buffer_to_buffer(&buffers.tally.room(device, TALLY, source), 0, &back, film_size, TALLY);
            backs.push(back);
        }
        if let (Some(_), Some((queries, resolved))) = (clock, &memory.times) {
            encoder.resolve_query_set(queries, 0..2, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, &backs[0], film_size + TALLY, 16);
        }
        queue.submit([encoder.finish()]);
        let width = self.views[0].size[0] as usize;
        let place = self.rows.start as usize * width..self.rows.end as usize * width;
        let (mut finished, mut composited) = (0, 0);
        let mut ticks = [0u64; 2];
        for (v, (film, back)) in films.iter_mut().zip(&backs).enumerate() {
            self.gpu.read(back, size, |bytes| {
                let (pixels, rest) = bytes.split_at(film_size as usize);
                let [red, green, blue] = &mut film.color;
                let planes = [red, green, blue, &mut film.transmittance];
                planes.into_par_iter().enumerate().for_each(|(channel, plane)| {
                    let values = pixels[4 * channel..].chunks(PIXEL as usize);
                    for (value, bytes) in plane[place.clone()].iter_mut().zip(values) {
                        *value = f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                    }
                });
                let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&rest[..TALLY as usize]);
                finished += u64::from(counts[0]);
                composited += u64::from(counts[1]);
                if v == 0 {
                    ticks.copy_from_slice(&bytemuck::pod_collect_to_vec::<u8, u64>(&rest[TALLY as usize..]));
                }
            })?;
        }
        let waited = computed - start;
        times.compute += match clock {
            Some(period) => {
                Duration::from_nanos((ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(*period)) as u64)
            }
            None => waited,
        };
        times.back += computed.elapsed();
        Ok((finished, composited))
    }

    /// An error unless every tile went through its list in every submission.
    pub fn check(&self, finished: u64, submissions: u64) -> Result<()> {
        let tiles = u64::from(self.across) * u64::from((self.rows.len() as u32).div_ceil(TILE));
        let expected = self.views.len() as u64 * tiles * submissions;
        if finished == expected {
            return Ok(());
        }
        Err(self.gpu.error(&format!("went through {finished} lists of {expected}: it stops long work, or fails")))
    }

    /// What the shader knows of a view.
    fn view(&self, v: usize, first: bool, last: bool, [first_group, groups, slabs]: [u32; 3]) -> layout::View {
        let view = &self.views[v];
        let [width, height] = view.size.map(|size| size as usize);
        let direction = view.direction(0.5, 0.5);
        let focal = view.focal_px();
        let opaque = self.opaque[v].as_ref();
        let range = opaque.map(|layer| survey(layer, self.background, width, [0, 0], [width, height]));
        let mut flags = 0;
        for (bit, set) in [(layout::View::FIRST, first), (layout::View::LAST, last)] {
            flags |= if set { bit } else { 0 };
        }
        if opaque.is_some() {
            flags |= layout::View::SURFACES;
        }
        layout::View {
            size: [view.size[0], self.rows.len() as u32],
            first_row: self.rows.start,
            across: self.across,
            tangent: [direction.x as f32, direction.y as f32],
            step: [(1.0 / focal.x) as f32, (-1.0 / focal.y) as f32],
            background: self.background,
            stop: stop_transmittance(self.tolerance as f32, &self.range, self.background, range.as_ref()),
            flags,
            first_group,
            groups,
            slabs,
        }
    }
}

/// Colour of what is behind the gas and its depth in the method's measure, for some rows.
fn surfaces_of(
    view: &View,
    layer: &OpaqueLayer,
    background: Rgb,
    limit: fn(f64, f64) -> f64,
    rows: &Range<u32>,
) -> Vec<[f32; 4]> {
    let width = view.size[0] as usize;
    let place = rows.start as usize * width..rows.end as usize * width;
    let pixels = layer.depth[place.clone()].par_iter().zip(&layer.color[place.clone()]);
    pixels
        .enumerate()
        .map(|(i, (&depth, &color))| {
            if depth == f64::INFINITY {
                return [background[0], background[1], background[2], f32::MAX];
            }
            let (x, y) = ((place.start + i) % width, (place.start + i) / width);
            let direction = view.direction(x as f64 + 0.5, y as f64 + 0.5);
            // Deeper than anything that is told from "no surface".
            let limit = finite(limit(depth, direction.length_squared())).min(1e38);
            [color[0], color[1], color[2], limit]
        })
        .collect()
}
