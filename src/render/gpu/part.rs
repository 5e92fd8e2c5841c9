//! A stretch of rows of all views: what every path uploads for it, waits for and reads back.

use super::Gpu;
use super::bin::TILE;
use super::device::Growing;
use super::layout::{self, finite};
use crate::error::Result;
use crate::render::cpu::tile::{stop_transmittance, survey};
use crate::render::opaque::OpaqueLayer;
use crate::scene::{Rgb, Scene, View};
use rayon::prelude::*;
use std::ops::Range;
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// Bytes of a pixel of the film or of the opaque layer.
pub(super) const PIXEL: u64 = 16;
/// Bytes of what a view gives back beside its film: two counts.
pub(super) const TALLY: u64 = 8;

/// Buffers that are kept from frame to frame.
#[derive(Default)]
pub struct Memory {
    pub(super) views: Vec<Buffers>,
    tables: Growing,
    pub(super) raster: super::raster::Memory,
    pub(super) lists: super::lists::Memory,
    times: Option<(wgpu::QuerySet, wgpu::Buffer)>,
}

impl Memory {
    /// Uploads what shaders look up; returns the buffer and its bytes in use.
    pub fn upload_tables(&mut self, gpu: &Gpu, bytes: &[u8]) -> Result<(wgpu::Buffer, u64)> {
        if bytes.len() as u64 > gpu.most_bytes() {
            return Err(gpu.error("cannot hold the tables of so many kernels"));
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let buffer = self.tables.room(&gpu.device, bytes.len() as u64, usage);
        gpu.queue.write_buffer(&buffer, 0, bytes);
        Ok((buffer, (bytes.len() as u64).max(PIXEL)))
    }

    /// The device's two times, of the beginning and the end of what it draws, where it has a clock.
    pub fn clock(&mut self, gpu: &Gpu) -> Option<&wgpu::QuerySet> {
        gpu.clock?;
        let (queries, _) = self.times.get_or_insert_with(|| {
            let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
            let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
            (gpu.device.create_query_set(&descriptor), gpu.buffer(16, usage))
        });
        Some(queries)
    }
}

/// The buffers of one view.
#[derive(Default)]
pub(super) struct Buffers {
    pub view: Growing,
    pub splats: Growing,
    pub starts: Growing,
    pub list: Growing,
    surfaces: Growing,
    film: Growing,
    tally: Growing,
    errors: Growing,
    back: Growing,
    errors_back: Growing,
}

impl Buffers {
    /// Surfaces of `size` bytes.
    pub fn surfaces(&mut self, device: &wgpu::Device, size: u64) -> wgpu::Buffer {
        self.surfaces.room(device, size, OUTPUT)
    }

    /// Estimates of the error, of `size` bytes.
    pub fn errors(&mut self, device: &wgpu::Device, size: u64) -> wgpu::Buffer {
        self.errors.room(device, size, OUTPUT)
    }

    /// Film of so many pixels, and tally.
    pub fn outputs(&mut self, device: &wgpu::Device, pixels: u64) -> (wgpu::Buffer, wgpu::Buffer) {
        (self.film.room(device, pixels * PIXEL, OUTPUT), self.tally.room(device, TALLY, OUTPUT))
    }
}

/// What is done with films, tallies and surfaces.
const OUTPUT: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_DST).union(BufferUsages::COPY_SRC);

/// Wall times of the stages; that of drawing is the device's own where it has a clock.
#[derive(Default)]
pub(super) struct Times {
    pub prepare: Duration,
    pub order: Duration,
    pub transform: Duration,
    pub bin: Duration,
    pub upload: Duration,
    pub draw: Duration,
    pub back: Duration,
}

impl Times {
    /// As statistics have them; `drawing`: what the device does is called.
    pub fn stages(&self, drawing: &'static str) -> Vec<(&'static str, Duration)> {
        vec![
            ("prepare", self.prepare),
            ("order", self.order),
            ("transform", self.transform),
            ("bin", self.bin),
            ("upload", self.upload),
            (drawing, self.draw),
            ("read back", self.back),
        ]
    }
}

/// Stretches of whole rows of tiles, at most `longest` rows each, whose films fit into `most` bytes; or of one row of tiles.
pub(super) fn stretches(most: u64, [width, height]: [u32; 2], longest: u32) -> Vec<Range<u32>> {
    let rows = (most / PIXEL / u64::from(width)).min(longest.into()) as u32;
    let rows = (rows / TILE * TILE).max(TILE);
    (0..height).step_by(rows as usize).map(|first| first..height.min(first + rows)).collect()
}

/// A stretch of rows of all views.
pub(super) struct Part<'a> {
    pub gpu: &'a Gpu,
    pub views: &'a [View],
    pub opaque: &'a [Option<OpaqueLayer>],
    pub background: Rgb,
    /// What may be lost by ending early, and the range of the gas's colours.
    pub tolerance: f64,
    pub range: [[f32; 2]; 3],
    pub rows: Range<u32>,
    /// Whether the shader estimates the film's error.
    pub estimates: bool,
}

impl<'a> Part<'a> {
    /// The stretch `rows` of a frame; `range` is that of the gas's colours.
    pub fn new(
        gpu: &'a Gpu,
        (scene, views, opaque): (&Scene, &'a [View], &'a [Option<OpaqueLayer>]),
        tolerance: f64,
        range: [[f32; 2]; 3],
        rows: Range<u32>,
    ) -> Self {
        Self { gpu, views, opaque, background: scene.background, tolerance, range, rows, estimates: false }
    }

    /// Columns and rows of tiles.
    pub fn grid(&self) -> [u32; 2] {
        [self.views[0].size[0], self.rows.len() as u32].map(|pixels| pixels.div_ceil(TILE))
    }

    /// Pixels of a view.
    pub fn pixels(&self) -> u64 {
        u64::from(self.views[0].size[0]) * self.rows.len() as u64
    }

    /// Uploads what all batches share.
    pub fn start(&self, buffers: &mut Memory, limit: fn(f64, f64) -> f64, times: &mut Times) {
        let start = Instant::now();
        let device = &self.gpu.device;
        for ((view, layer), buffers) in self.views.iter().zip(self.opaque).zip(&mut buffers.views) {
            let (_, tally) = buffers.outputs(device, self.pixels());
            self.gpu.queue.write_buffer(&tally, 0, &[0; TALLY as usize]);
            if let Some(layer) = layer {
                let surfaces = buffers.surfaces(device, self.pixels() * PIXEL);
                let values = surfaces_of(view, layer, self.background, limit, &self.rows);
                self.gpu.queue.write_buffer(&surfaces, 0, bytemuck::cast_slice(&values));
            }
        }
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
        let mut error_backs = Vec::new();
        // Film, counts, and the device's two times.
        let size = film_size + TALLY + 16;
        for buffers in &mut memory.views {
            let back = buffers.back.room(device, size, usage);
            let (film, tally) = buffers.outputs(device, self.pixels());
            encoder.copy_buffer_to_buffer(&film, 0, &back, 0, film_size);
            encoder.copy_buffer_to_buffer(&tally, 0, &back, film_size, TALLY);
            backs.push(back);
            if self.estimates {
                // Apart: both together may be more than a buffer can be.
                let back = buffers.errors_back.room(device, film_size, usage);
                encoder.copy_buffer_to_buffer(&buffers.errors(device, film_size), 0, &back, 0, film_size);
                error_backs.push(back);
            }
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
        for (film, back) in films.iter_mut().zip(&error_backs) {
            self.gpu.read(back, film_size, |bytes| {
                let values = bytes[12..].chunks(PIXEL as usize);
                for (error, bytes) in film.error.iter_mut().flat_map(|plane| &mut plane[place.clone()]).zip(values) {
                    *error = f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                }
            })?;
        }
        times.draw += match clock {
            Some(period) => elapsed(&ticks, *period),
            None => waited,
        };
        times.back += computed.elapsed();
        Ok((finished, composited))
    }

    /// Number of tiles of a view.
    pub fn tiles(&self) -> u64 {
        self.grid().map(u64::from).iter().product()
    }

    /// An error unless every tile went through its list in every submission.
    pub fn check(&self, finished: u64, submissions: u64) -> Result<()> {
        let expected = self.views.len() as u64 * self.tiles() * submissions;
        if finished == expected {
            return Ok(());
        }
        Err(self.gpu.error(&format!("went through {finished} lists of {expected}: it stops long work, or fails")))
    }

    /// What shaders know of a view.
    pub fn view(&self, v: usize, first: bool, last: bool, [first_group, groups, slabs]: [u32; 3]) -> layout::View {
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
            across: self.grid()[0],
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

/// From the first to the last of two times in ticks.
pub(super) fn elapsed(ticks: &[u64], period: f32) -> Duration {
    let count = ticks[1].saturating_sub(ticks[0]);
    Duration::from_nanos((count as f64 * f64::from(period)) as u64)
}
