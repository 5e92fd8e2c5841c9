//! A frame of billboards: listed by tile on the device or on the CPU, composited tile by tile on the device.

use super::bin::{self, TILE};
use super::device::{READ, UNIFORM, WRITE, bytes};
use super::layout;
use super::lists::{self, Lister};
use super::part::{Memory, PIXEL, Part, TALLY, Times, stretches};
use super::shader;
use super::source::{Orders, Source};
use super::splat::Shaded;
use super::steps::{Slice, filled};
use super::{Gpu, Lists};
use crate::error::Result;
use crate::render::cpu::engine::Job;
use crate::render::{Frame, Progress, Statistics};
use std::ops::Range;
use std::time::Instant;
use wgpu::{BindingType, BufferUsages};

/// Those of `shaders/bindings.wgsl`.
pub(super) const BINDINGS: [BindingType; 8] = [UNIFORM, READ, READ, READ, READ, READ, WRITE, WRITE];

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
pub fn draw<A: Shaded>(alignment: A, gpu: &mut Gpu, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
    gpu.with_memory(|gpu, buffers| draw_in(alignment, gpu, buffers, frame, progress))
}

fn draw_in<A: Shaded>(
    alignment: A,
    gpu: &mut Gpu,
    buffers: &mut Memory,
    frame: Frame,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, memory, .. } = frame;
    let job = Job::new::<A>(scene, options, memory);
    let pipeline = gpu.pipeline(&shader::tile(A::SHADER, job.model), &BINDINGS)?;
    buffers.views.resize_with(views.len(), Default::default);
    let tables = buffers.upload_tables(gpu, bytemuck::cast_slice(job.tables.values()))?;
    let mut refused = None;
    let lister = match gpu.lists() {
        Lists::Gpu if scene.particle_count() > 0 => {
            Lister::new(alignment, gpu, &job, views, &mut buffers.lists)?.map_err(|why| refused = Some(why)).ok()
        }
        Lists::Gpu | Lists::Cpu => None,
    };
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut list_times = lists::Times::default();
    let mut statistics = Statistics::default();
    let mut orders = None;
    // Stretches of rows, and those whose particles the device could not list.
    let mut counts = [0, 0];

    let [width, height] = views[0].size;
    for rows in stretches(gpu.most_bytes(), [width, height], u32::MAX) {
        let part = Part::new(gpu, (scene, views, opaque), options.tolerance, job.colors.range, rows.clone());
        part.start(buffers, A::opaque_limit, &mut times);
        progress.update(u64::from(rows.start), u64::from(height));
        let listed = match &lister {
            Some(lister) => lister
                .list(&part, &mut buffers.lists, &mut list_times)?
                .map_err(|why| {
                    refused = Some(why);
                    counts[1] += 1;
                })
                .ok()
                .map(|listed| (lister, listed)),
            None => None,
        };
        counts[0] += 1;
        let submissions = match &listed {
            Some((_, listed)) => {
                let inputs: Vec<Input> = listed
                    .starts
                    .iter()
                    .map(|starts| Input { particles: &listed.splats, starts, list: &listed.list })
                    .collect();
                part.composite(&pipeline, buffers, &inputs, &tables, [true, true], [0; 3], &mut times);
                statistics.prepared += listed.seen;
                1
            }
            None => {
                let orders = orders.get_or_insert_with(|| {
                    let start = Instant::now();
                    let orders = Orders::new::<A>(&job, views, memory);
                    times.order += start.elapsed();
                    orders
                });
                let sources = Source::of_all(alignment, views, orders, &rows);
                submit_all(sources, &job, &part, &pipeline, buffers, &tables, &mut times, &mut statistics)
            }
        };
        let (finished, composited) = part.finish(buffers, films, &mut times)?;
        part.check(finished, submissions)?;
        if let Some((lister, _)) = listed {
            lister.finish(gpu, &mut buffers.lists, &mut list_times)?;
        }
        // Whole tiles at a time, as the CPU counts whole blocks.
        statistics.fragments += composited * u64::from(TILE * TILE);
    }
    progress.update(1, 1);
    job.recycle(memory);
    if let Some(why) = refused {
        let some = match counts {
            [all, some] if 0 < some && some < all => format!(" for {some} of {all} stretches of rows"),
            _ => String::new(),
        };
        statistics.plan.push(format!("Particles listed on the CPU{some}: {why}."));
    }
    times.order += list_times.order;
    times.bin += list_times.bin;
    statistics.stages = times.stages("compute");
    if lister.is_some() {
        // Where the CPU has `transform`.
        let place = statistics.stages.iter().position(|(name, _)| *name == "order").unwrap_or_default();
        statistics.stages.insert(place, ("project", list_times.project));
    }
    Ok(statistics)
}

/// Prepares and lists particles on the CPU and has them composited, batch by batch; returns the number of submissions.
fn submit_all<A: Shaded>(
    mut sources: Vec<Source<A>>,
    job: &Job,
    part: &Part,
    pipeline: &wgpu::ComputePipeline,
    buffers: &mut Memory,
    tables: &(wgpu::Buffer, u64),
    times: &mut Times,
    statistics: &mut Statistics,
) -> u64 {
    let limits = [part.gpu.most_bytes(), part.gpu.longest_list()];
    let mut submissions = 0;
    loop {
        let loads: Vec<(Range<usize>, bin::Lists)> = sources
            .iter_mut()
            .map(|source| {
                let splats = source.next(job, limits, times, statistics);
                let start = Instant::now();
                let lists = bin::lists(&source.stairs(splats.clone()), part.grid());
                times.bin += start.elapsed();
                (splats, lists)
            })
            .collect();
        let last = sources.iter().all(Source::is_exhausted);
        let uploads: Vec<Upload> = sources
            .iter()
            .zip(&loads)
            .map(|(source, (splats, lists))| Upload {
                particles: bytemuck::cast_slice(&source.splats[splats.clone()]),
                starts: &lists.starts,
                list: &lists.list,
            })
            .collect();
        part.submit(pipeline, buffers, &uploads, tables, [submissions == 0, last], [0; 3], times);
        submissions += 1;
        if last {
            return submissions;
        }
    }
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

/// What a view reads of a submission, on the device already.
pub(super) struct Input<'a> {
    /// Particles, as the shader reads them.
    pub particles: &'a Slice,
    /// As in [`bin::Lists`]; what comes before the list of the first tile is skipped.
    pub starts: &'a Slice,
    /// As in [`bin::Lists`].
    pub list: &'a Slice,
}

impl Part<'_> {
    /// Uploads a batch of each view and has it composited. `slabs`: the first group of slabs, the number of groups and that of
    /// all slabs.
    pub fn submit(
        &self,
        pipeline: &wgpu::ComputePipeline,
        memory: &mut Memory,
        loads: &[Upload],
        tables: &(wgpu::Buffer, u64),
        [first, last]: [bool; 2],
        slabs: [u32; 3],
        times: &mut Times,
    ) {
        let start = Instant::now();
        let uploaded: Vec<[Slice; 3]> = loads
            .iter()
            .zip(&mut memory.views)
            .map(|(load, buffers)| {
                [
                    filled(&mut buffers.splats, self.gpu, load.particles),
                    filled(&mut buffers.starts, self.gpu, bytemuck::cast_slice(load.starts)),
                    filled(&mut buffers.list, self.gpu, bytemuck::cast_slice(load.list)),
                ]
            })
            .collect();
        times.upload += start.elapsed();
        let inputs: Vec<Input> =
            uploaded.iter().map(|[particles, starts, list]| Input { particles, starts, list }).collect();
        self.composite(pipeline, memory, &inputs, tables, [first, last], slabs, times);
    }

    /// Has a batch of each view composited that is on the device; as [`Part::submit`].
    pub fn composite(
        &self,
        pipeline: &wgpu::ComputePipeline,
        memory: &mut Memory,
        inputs: &[Input],
        tables: &(wgpu::Buffer, u64),
        [first, last]: [bool; 2],
        slabs: [u32; 3],
        times: &mut Times,
    ) {
        let start = Instant::now();
        let Gpu { device, queue, .. } = self.gpu;
        let mut groups = Vec::with_capacity(inputs.len());
        for (v, (input, buffers)) in inputs.iter().zip(&mut memory.views).enumerate() {
            let view_size = size_of::<layout::View>() as u64;
            let view = buffers.view.room(device, view_size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
            queue.write_buffer(&view, 0, bytemuck::bytes_of(&self.view(v, first, last, slabs)));
            let film_size = self.pixels() * PIXEL;
            let (film, tally) = buffers.outputs(device, self.pixels());
            let surfaces_size = if self.opaque[v].is_some() { film_size } else { PIXEL };
            let surfaces = buffers.surfaces(device, surfaces_size);
            let errors = self.estimates.then(|| buffers.errors(device, film_size));
            let mut resources = vec![
                bytes(&view, view_size),
                input.particles.binding(),
                input.starts.binding(),
                input.list.binding(),
                bytes(&tables.0, tables.1),
                bytes(&surfaces, surfaces_size),
                bytes(&film, film_size),
                bytes(&tally, TALLY),
            ];
            resources.extend(errors.as_ref().map(|errors| bytes(errors, film_size)));
            groups.push(self.gpu.bind(&pipeline.get_bind_group_layout(0), &resources));
        }
        let mut encoder = device.create_command_encoder(&Default::default());
        let timestamp_writes =
            memory.clock(self.gpu).filter(|_| first || last).map(|query_set| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: first.then_some(0),
                end_of_pass_write_index: last.then_some(1),
            });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        pass.set_pipeline(pipeline);
        for group in &groups {
            pass.set_bind_group(0, group, &[]);
            let [across, down] = self.grid();
            pass.dispatch_workgroups(across, down, 1);
        }
        drop(pass);
        queue.submit([encoder.finish()]);
        times.upload += start.elapsed();
    }
}
