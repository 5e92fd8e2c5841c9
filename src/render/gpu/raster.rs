//! A frame of billboards drawn as such, as Johnson & McAllister (2005) drew them: one instanced draw for each eye, nearest
//! first, blended in the target. Footprints and opacities are those of the compute path, by the same shader functions.
//!
//! The target holds the light of the gas in red, green and blue and its transmittance T in alpha. A fragment of opacity a and
//! colour c adds T a c to the light and takes T to T (1 - a): blend factors alone, so that the depth order does the rest. What
//! is behind the gas is added at the end, by a compute shader that copies the target into the film of the compute path.
//!
//! Both eyes stand side by side in one target; where that is wider than the adapter's textures, each eye has targets of its
//! own, as many as it takes. Below the picture every target has a row more, in which each draw's last billboard adds 1 to
//! every pixel: a draw that was dropped or ended early shows there, and is an error. Fragments have no loop over particles that a
//! driver could leave; what stops within a draw is the device as a whole, which wgpu reports.
//!
//! With 32 bits per channel nothing is lost that the compute path keeps. With 16 T has 11 significant bits: where blending
//! rounds to the nearest, a fragment of opacity below 2^-12 leaves it as it is; where it truncates (llvmpipe), each takes up to
//! 2^-10 of it more than it should. A thousand particles of optical depth 0.003 then come out with a transmittance that is
//! off by 0.36; with 32 bits, by 2e-6. See [`LOSS`].

use super::Gpu;
use super::bin::TILE;
use super::device::{Growing, READ, TEXTURE, UNIFORM, WRITE, bytes};
use super::layout::{self, Window};
use super::part::{Memory as Buffers, PIXEL, Part, TALLY, Times, stretches};
use super::shader;
use super::source::{Orders, Source};
use super::splat::Shaded;
use crate::error::Result;
use crate::render::cpu::engine::Job;
use crate::render::cpu::splat::Bounds;
use crate::render::{Frame, Progress, Statistics};
use std::time::Instant;
use wgpu::{BindingType, BufferUsages, TextureFormat, TextureUsages};

/// Those of `shaders/raster.wgsl`.
const BINDINGS: [BindingType; 5] = [UNIFORM, UNIFORM, READ, READ, READ];
/// Those of `shaders/resolve.wgsl`.
const RESOLVE: [BindingType; 6] = [UNIFORM, UNIFORM, READ, WRITE, WRITE, TEXTURE];

/// What [`Precision::Half`] loses, for people.
pub const LOSS: &str = "--gpu-path raster-f16 keeps 11 significant bits of light and transmittance: gas of an opacity below about \
                        1/2000 per particle may vanish or come out denser than it is, and the rounding of many layers adds up";

/// How many bits a channel of the target has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32: nothing is lost.
    Single,
    /// 16: thin gas is.
    Half,
}

impl Precision {
    fn format(self) -> TextureFormat {
        match self {
            Self::Single => TextureFormat::Rgba32Float,
            Self::Half => TextureFormat::Rgba16Float,
        }
    }
}

/// Buffers and targets that are kept from frame to frame.
#[derive(Default)]
pub struct Memory {
    targets: Vec<wgpu::Texture>,
    /// One per window.
    windows: Vec<Growing>,
    /// One per view.
    outlines: Vec<Growing>,
}

/// Some columns of a view, and where they are in their target.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    view: usize,
    at: u32,
    first: u32,
    columns: u32,
}

/// The places of all views by target, no target wider than `longest`: one for all views if they fit side by side.
fn places(views: usize, width: u32, longest: u32) -> Vec<Vec<Place>> {
    if width.checked_mul(views as u32).is_some_and(|all| all <= longest) {
        return vec![
            (0..views).map(|view| Place { view, at: view as u32 * width, first: 0, columns: width }).collect(),
        ];
    }
    // Whole tiles, so that each is copied once.
    let most = (longest / TILE).max(1) * TILE;
    let of_one = |view| {
        (0..width).step_by(most as usize).map(move |first| {
            let columns = most.min(width - first);
            vec![Place { view, at: 0, first, columns }]
        })
    };
    (0..views).flat_map(of_one).collect()
}

/// First column and row, and those after the last, of the pixels that a billboard covers: a row of the instance buffer.
fn outline(bounds: &Bounds) -> [u32; 4] {
    [bounds.x[0], bounds.y[0], bounds.x[1] + 1, bounds.y[1] + 1]
}

/// What a submission reads: billboards and their outlines, by view.
struct Batch {
    splats: (wgpu::Buffer, u64),
    outlines: wgpu::Buffer,
    count: u32,
}

/// Draws the particles of a scene over its background and opaque layers into the films, one per view.
///
/// # Errors
/// [`crate::Error::Device`], as every path of a GPU; also where the adapter cannot blend what `precision` asks for.
pub fn draw<A: Shaded>(
    alignment: A,
    precision: Precision,
    gpu: &mut Gpu,
    frame: Frame,
    progress: &dyn Progress,
) -> Result<Statistics> {
    gpu.with_memory(|gpu, buffers| draw_in(alignment, precision, gpu, buffers, frame, progress))
}

fn draw_in<A: Shaded>(
    alignment: A,
    precision: Precision,
    gpu: &mut Gpu,
    buffers: &mut Buffers,
    frame: Frame,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let start = Instant::now();
    gpu.check()?;
    gpu.check_blending(precision)?;
    let Frame { scene, views, opaque, options, films, memory, .. } = frame;
    let job = Job::new::<A>(scene, options, memory);
    let format = precision.format();
    let pipeline = gpu.raster_pipeline(&shader::billboards(A::SHADER, job.model), &BINDINGS, format)?;
    let resolve = gpu.pipeline(&shader::RESOLVED, &RESOLVE)?;
    buffers.views.resize_with(views.len(), Default::default);
    let tables = buffers.upload_tables(gpu, bytemuck::cast_slice(job.tables.values()))?;
    let mut times = Times { prepare: start.elapsed(), ..Times::default() };
    let mut statistics = Statistics::default();

    let start = Instant::now();
    let orders = Orders::new::<A>(&job, views, memory);
    times.order = start.elapsed();

    let [width, height] = views[0].size;
    let most = gpu.most_bytes();
    let places = places(views.len(), width, gpu.longest_side());
    // A row of the target is for the marks.
    for rows in stretches(most, [width, height], gpu.longest_side() - 1) {
        let mut sources = Source::of_all(alignment, views, &orders, &rows);
        let part = Part::new(gpu, (scene, views, opaque), options.tolerance, job.colors.range, rows.clone());
        part.start(buffers, A::opaque_limit, &mut times);
        let targets = Targets::new(&part, &places, format, buffers, &mut times);
        let mut submissions = 0;
        loop {
            let mut batches = Vec::with_capacity(views.len());
            for (v, source) in sources.iter_mut().enumerate() {
                let range = source.next(&job, [most, u64::MAX], &mut times, &mut statistics);
                let start = Instant::now();
                let mut outlines: Vec<[u32; 4]> =
                    source.covered[range.clone()].iter().map(|(bounds, _)| outline(bounds)).collect();
                let area = |[left, top, right, bottom]: &[u32; 4]| u64::from(right - left) * u64::from(bottom - top);
                statistics.fragments += outlines.iter().map(area).sum::<u64>();
                // The mark that the draw was gone through.
                outlines.push([0, rows.len() as u32, width, rows.len() as u32 + 1]);
                batches.push(targets.upload(v, &source.splats[range], &outlines, buffers));
                times.upload += start.elapsed();
            }
            let last = sources.iter().all(Source::is_exhausted);
            let start = Instant::now();
            targets.submit(&pipeline, &batches, &tables, submissions == 0, buffers);
            times.upload += start.elapsed();
            submissions += 1;
            progress.update(u64::from(rows.start), u64::from(height));
            if last {
                break;
            }
        }
        targets.resolve(&resolve, buffers);
        let (finished, marks) = part.finish(buffers, films, &mut times)?;
        part.check(finished, 1)?;
        let expected = submissions * u64::from(width) * views.len() as u64;
        if marks != expected {
            return Err(gpu.error(&format!("went through {marks} columns of {expected}: it stops long work, or fails")));
        }
    }
    progress.update(1, 1);
    job.recycle(memory);
    statistics.stages = times.stages("raster");
    Ok(statistics)
}

/// The targets of a stretch of rows.
struct Targets<'a> {
    part: &'a Part<'a>,
    places: &'a [Vec<Place>],
    views: Vec<wgpu::TextureView>,
    /// By target and place: what shaders know of it.
    windows: Vec<Vec<wgpu::Buffer>>,
    /// By view: what shaders know of it.
    known: Vec<wgpu::Buffer>,
}

impl<'a> Targets<'a> {
    /// Makes the targets that are not there yet, and uploads what all batches share.
    fn new(
        part: &'a Part<'a>,
        places: &'a [Vec<Place>],
        format: TextureFormat,
        memory: &mut Buffers,
        times: &mut Times,
    ) -> Self {
        let start = Instant::now();
        let Gpu { device, queue, .. } = part.gpu;
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let kept = &mut memory.raster;
        let old = std::mem::take(&mut kept.targets);
        let mut old = old.into_iter();
        kept.windows.resize_with(places.iter().map(Vec::len).sum(), Growing::default);
        let mut free = kept.windows.iter_mut();
        let mut windows = Vec::with_capacity(places.len());
        let mut views = Vec::with_capacity(places.len());
        for target in places {
            let width: u32 = target.iter().map(|place| place.columns).sum();
            let extent = [width, part.rows.len() as u32 + 1];
            let fits =
                |texture: &wgpu::Texture| [texture.width(), texture.height()] == extent && texture.format() == format;
            let texture = old.next().filter(fits).unwrap_or_else(|| {
                device.create_texture(&wgpu::TextureDescriptor {
                    label: None,
                    size: wgpu::Extent3d { width: extent[0], height: extent[1], depth_or_array_layers: 1 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                })
            });
            views.push(texture.create_view(&Default::default()));
            kept.targets.push(texture);
            let buffers = target.iter().zip(&mut free).map(|(place, buffer)| {
                let Place { at, first, columns, .. } = *place;
                let buffer = buffer.room(device, size_of::<Window>() as u64, usage);
                queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&Window { extent, at, first, columns, padding: 0 }));
                buffer
            });
            windows.push(buffers.collect());
        }
        let known = memory.views.iter_mut().enumerate().map(|(v, buffers)| {
            let buffer = buffers.view.room(device, size_of::<layout::View>() as u64, usage);
            queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&part.view(v, true, true, [0; 3])));
            buffer
        });
        let known = known.collect();
        times.upload += start.elapsed();
        Self { part, places, views, windows, known }
    }

    /// Uploads a batch of a view.
    fn upload(&self, v: usize, splats: &[layout::Splat], outlines: &[[u32; 4]], memory: &mut Buffers) -> Batch {
        let Gpu { device, queue, .. } = self.part.gpu;
        let upload = |buffer: &mut Growing, bytes: &[u8], usage| {
            let buffer = buffer.room(device, bytes.len() as u64, usage | BufferUsages::COPY_DST);
            queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let bytes: &[u8] = bytemuck::cast_slice(splats);
        let buffer = upload(&mut memory.views[v].splats, bytes, BufferUsages::STORAGE);
        let kept = &mut memory.raster.outlines;
        kept.resize_with(self.part.views.len(), Growing::default);
        let outlines_buffer = upload(&mut kept[v], bytemuck::cast_slice(outlines), BufferUsages::VERTEX);
        // An array of structures has one at least.
        let size = (bytes.len() as u64).max(256);
        Batch { splats: (buffer, size), outlines: outlines_buffer, count: outlines.len() as u32 }
    }

    /// The opaque surfaces of a view, or room for none.
    fn surfaces(&self, v: usize, memory: &mut Buffers) -> (wgpu::Buffer, u64) {
        let size = if self.part.opaque[v].is_some() { self.part.pixels() * PIXEL } else { PIXEL };
        (memory.views[v].surfaces(&self.part.gpu.device, size), size)
    }

    /// Has a batch of each view blended beneath what is there.
    fn submit(
        &self,
        pipeline: &wgpu::RenderPipeline,
        batches: &[Batch],
        tables: &(wgpu::Buffer, u64),
        first: bool,
        memory: &mut Buffers,
    ) {
        let gpu = self.part.gpu;
        let surfaces: Vec<_> = (0..batches.len()).map(|v| self.surfaces(v, memory)).collect();
        let layout = pipeline.get_bind_group_layout(0);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for (t, places) in self.places.iter().enumerate() {
            let clock = if first && t == 0 { memory.clock(gpu) } else { None };
            let timestamp_writes = clock.map(|query_set| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: None,
            });
            // No light yet, and everything comes through.
            let clear = wgpu::Color { r: 0.0, g: 0.0, b: 0.0, a: 1.0 };
            let load = if first { wgpu::LoadOp::Clear(clear) } else { wgpu::LoadOp::Load };
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &self.views[t],
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                })],
                timestamp_writes,
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            for (place, window) in places.iter().zip(&self.windows[t]) {
                let v = place.view;
                let (batch, surfaces) = (&batches[v], &surfaces[v]);
                let group = gpu.bind(
                    &layout,
                    &[
                        bytes(&self.known[v], size_of::<layout::View>() as u64),
                        bytes(window, size_of::<Window>() as u64),
                        bytes(&batch.splats.0, batch.splats.1),
                        bytes(&tables.0, tables.1),
                        bytes(&surfaces.0, surfaces.1),
                    ],
                );
                pass.set_bind_group(0, &group, &[]);
                pass.set_vertex_buffer(0, batch.outlines.slice(..u64::from(batch.count) * OUTLINE));
                pass.set_scissor_rect(place.at, 0, place.columns, self.part.rows.len() as u32 + 1);
                pass.draw(0..4, 0..batch.count);
            }
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// Has the targets copied into the films, with what is behind the gas.
    fn resolve(&self, pipeline: &wgpu::ComputePipeline, memory: &mut Buffers) {
        let gpu = self.part.gpu;
        let layout = pipeline.get_bind_group_layout(0);
        let mut groups = Vec::new();
        for (t, places) in self.places.iter().enumerate() {
            for (place, window) in places.iter().zip(&self.windows[t]) {
                let v = place.view;
                let surfaces = self.surfaces(v, memory);
                let (film, tally) = memory.views[v].outputs(&gpu.device, self.part.pixels());
                let group = gpu.bind(
                    &layout,
                    &[
                        bytes(&self.known[v], size_of::<layout::View>() as u64),
                        bytes(window, size_of::<Window>() as u64),
                        bytes(&surfaces.0, surfaces.1),
                        bytes(&film, self.part.pixels() * PIXEL),
                        bytes(&tally, TALLY),
                        wgpu::BindingResource::TextureView(&self.views[t]),
                    ],
                );
                groups.push((group, place.columns.div_ceil(TILE)));
            }
        }
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let timestamp_writes = memory.clock(gpu).map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: None,
            end_of_pass_write_index: Some(1),
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        pass.set_pipeline(pipeline);
        for (group, across) in &groups {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(*across, self.part.grid()[1], 1);
        }
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }
}

/// Bytes of an outline.
pub(super) const OUTLINE: u64 = size_of::<[u32; 4]>() as u64;
