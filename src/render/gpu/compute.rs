//! A frame of billboards: listed by tile on the CPU, composited tile by tile on the GPU.

use super::Gpu;
use super::bin::{self, TILE};
use super::device::{Growing, READ, UNIFORM, WRITE, bytes};
use super::layout;
use super::part::{Memory, PIXEL, Part, TALLY, Times, stretches};
use super::shader;
use super::source::{Orders, Source};
use super::splat::Shaded;
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
    let start = Instant::now();
    gpu.check()?;
    let Frame { scene, views, opaque, options, films, memory, .. } = frame;
    let job = Job::new::<A>(scene, options, memory);
    let pipeline = gpu.pipeline(&shader::tile(A::SHADER, job.model), &BINDINGS)?;
    let mut buffers = std::mem::take(&mut gpu.memory);
    buffers.views.resize_with(views.len(), Default::default);
    let tables = buffers.upload_tables(gpu, bytemuck::cast_slice(job.tables.values()))?;
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut statistics = Statistics::default();

    let start = Instant::now();
    let orders = Orders::new::<A>(&job, views, memory);
    times.order = start.elapsed();

    let [width, height] = views[0].size;
    let most = gpu.most_bytes();
    for rows in stretches(most, [width, height], u32::MAX) {
        let mut sources = Source::of_all(alignment, views, &orders, &rows);
        let part = Part::new(gpu, (scene, views, opaque), options.tolerance, job.colors.range, rows.clone());
        part.start(&mut buffers, A::opaque_limit, &mut times);
        let mut submissions = 0;
        loop {
            let loads: Vec<(Range<usize>, bin::Lists)> = sources
                .iter_mut()
                .map(|source| {
                    let splats = source.next(&job, [most, gpu.longest_list()], &mut times, &mut statistics);
                    let start = Instant::now();
                    let lists = bin::lists(&source.bounds[splats.clone()], part.grid());
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
            part.submit(&pipeline, &mut buffers, &uploads, &tables, [submissions == 0, last], [0; 3], &mut times);
            submissions += 1;
            progress.update(u64::from(rows.start), u64::from(height));
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
    statistics.stages = times.stages("compute");
    Ok(statistics)
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
            let (film, tally) = buffers.outputs(device, self.pixels());
            let surfaces_size = if self.opaque[v].is_some() { film_size } else { PIXEL };
            let surfaces = buffers.surfaces(device, surfaces_size);
            let group = self.gpu.bind(
                &pipeline.get_bind_group_layout(0),
                &[
                    bytes(&view.0, size_of::<layout::View>() as u64),
                    bytes(&splats.0, splats.1),
                    bytes(&starts.0, starts.1),
                    bytes(&list.0, list.1),
                    bytes(&tables.0, tables.1),
                    bytes(&surfaces, surfaces_size),
                    bytes(&film, film_size),
                    bytes(&tally, TALLY),
                ],
            );
            groups.push(group);
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
