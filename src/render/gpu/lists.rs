//! Particles projected, put in order and listed by tile on the device, from particles that stay there.
//!
//! An *element* is a particle as one view sees it; all views go together. Projection makes of each the splat that the tile shader
//! reads, the tiles that it reaches into, and a key of 48 bits: its depth or distance. A stable sort puts elements in order, nearest
//! first, of equals the higher index first; where views share depth, particles alone, by the first view's key. Sums of their tiles
//! give each pair of tile and element its place in that order; a stable sort of the pairs by tile leaves the lists. The number of
//! pairs is read back in between, for the size of what holds them.
//!
//! Where the CPU computes in f64, positions, depths and whatever cancels have 48 bits here, about the middle of the scene. Bounds
//! are grown by what is rounded, so that no pixel is cut off. What is beyond that, or beyond what buffers hold, is not listed:
//! the frame then takes the CPU's lists.

use super::Gpu;
use super::bin::{self, Stairs};
use super::device::{Growing, READ, WRITE};
use super::layout::{self, Work, parts};
use super::part::{Part, elapsed};
use super::particles::{Kept, Range};
use super::shader;
use super::sort::{BLOCK, Pairs, Scratch, Sorter, groups};
use super::splat::Shaded;
use super::steps::{Slice, Steps, filled, kernel, words};
use crate::error::Result;
use crate::render::OpacityModel;
use crate::render::cpu::engine::Job;
use crate::render::cpu::order::Key;
use crate::scene::{View, stereo};
use glam::{DVec2, DVec3};
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// Most pairs of tile and element: short enough that no system takes the device for stuck.
const MOST_PAIRS: u64 = 1 << 25;
/// Storage buffers of the shader that has most, and bytes that a workgroup shares; every WebGPU device has them.
const BUFFERS: u32 = 8;
const SHARED_BYTES: u32 = 9216;
/// Bits of a key's low word.
const LOW_BITS: u32 = 16;
/// Lengths that single precision has room for above and below, with their squares and quotients.
const LENGTHS: [f64; 2] = [1e-9, 1e9];
/// Times of the device: beginning and end of three stages.
const TIMES: u32 = 6;

/// Buffers that are kept from frame to frame.
#[derive(Default)]
pub(super) struct Memory {
    particles: Kept,
    splats: Growing,
    stairs: Growing,
    high: Growing,
    found: Growing,
    /// Keys and values of elements, then of pairs, each twice.
    elements: [[Growing; 2]; 2],
    pairs: [[Growing; 2]; 2],
    ends: Growing,
    starts: Growing,
    scratch: Scratch,
    told: Growing,
    back: Growing,
    times: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    /// Keys that the last lists put in order.
    sorted: u64,
}

/// Wall times of the stages; the device's own where it has a clock, else the first has all that is waited for.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times {
    pub project: Duration,
    pub order: Duration,
    pub bin: Duration,
}

/// What makes the lists of a frame.
pub(super) struct Lister {
    project: wgpu::ComputePipeline,
    gather: wgpu::ComputePipeline,
    binner: Binner,
    particles: Slice,
    kinds: Slice,
    count: u32,
    /// Orders: one for each view, or one for all.
    orders: u32,
    sets: u32,
    eyes: [layout::Eye; 2],
    near: [f32; 2],
    hair: f32,
    linear: bool,
}

/// What the tile shader reads of a view.
pub(super) struct Listed {
    pub splats: Slice,
    pub starts: Vec<Slice>,
    pub list: Slice,
    /// Elements that may be seen.
    pub seen: u64,
}

/// From elements in order to lists.
struct Binner {
    sorter: Sorter,
    measure: wgpu::ComputePipeline,
    emit: wgpu::ComputePipeline,
    starts: wgpu::ComputePipeline,
}

/// The tiles of all views.
#[derive(Clone, Copy)]
struct Grid {
    views: u32,
    across: u32,
    tiles: u32,
    /// Particles of the scene.
    particles: u32,
    /// Views that share an order.
    together: u32,
}

impl Grid {
    /// Keys from view to view: one for each tile and one for the end, so that each view's starts can be bound alone.
    fn stride(self) -> u32 {
        (self.tiles + 1).next_multiple_of(64)
    }

    fn keys(self) -> u32 {
        self.stride() * self.views
    }
}

impl Lister {
    /// What makes the lists of a scene's particles for a method, or why the device cannot.
    pub fn new<A: Shaded>(
        alignment: A,
        gpu: &mut Gpu,
        job: &Job,
        views: &[View],
        memory: &mut Memory,
    ) -> Result<std::result::Result<Self, &'static str>> {
        let count = job.scene.particle_count() as u64;
        let elements = count * views.len() as u64;
        let limits = gpu.device.limits();
        let (buffers, shared) =
            (limits.max_storage_buffers_per_shader_stage, limits.max_compute_workgroup_storage_size);
        if views.len() > 2 || buffers < BUFFERS || shared < SHARED_BYTES {
            return Ok(Err("its shaders bind or share too little at once"));
        }
        let sets = job.scene.particles.len() as u64;
        let bytes = (elements * size_of::<layout::Splat>() as u64).max(sets * size_of::<layout::Kind>() as u64);
        if bytes > gpu.most_bytes() {
            return Ok(Err("its buffers do not hold them"));
        }
        let look = memory.particles.look(job);
        let Some(scale) = scale(&look.range, views) else {
            return Ok(Err("single precision has no room for their lengths"));
        };
        let project = kernel(
            gpu,
            &shader::project(alignment.projection()),
            &[READ, READ, WRITE, WRITE, WRITE, WRITE, WRITE, WRITE],
        )?;
        let gather = kernel(gpu, &shader::GATHER, &[READ, READ, WRITE])?;
        let binner = Binner::new(gpu)?;
        let (particles, kinds) = memory.particles.upload(gpu, job, look);
        let mut eyes = [layout::Eye::default(); 2];
        for (eye, view) in eyes.iter_mut().zip(views) {
            *eye = eye_of(view, look.range.middle());
        }
        Ok(Ok(Self {
            project,
            gather,
            binner,
            particles,
            kinds,
            count: count as u32,
            // Depths are then the same but for rounding, and those of the first view are everybody's, as on the CPU.
            orders: if A::KEY == Key::Depth && stereo::share_depth(views) { 1 } else { views.len() as u32 },
            sets: sets as u32,
            eyes,
            near: parts(views[0].near),
            hair: (scale * f64::powi(2.0, -42)) as f32,
            linear: job.model == OpacityModel::Linear,
        }))
    }

    /// The lists of a stretch of rows, computed or on their way, or why there are none.
    pub fn list(
        &self,
        part: &Part,
        memory: &mut Memory,
        times: &mut Times,
    ) -> Result<std::result::Result<Listed, &'static str>> {
        let start = Instant::now();
        let gpu = part.gpu;
        let [across, down] = part.grid();
        let views = part.views.len() as u32;
        let together = views / self.orders;
        let grid = Grid { views, across, tiles: across * down, particles: self.count, together };
        let elements = u64::from(self.count) * u64::from(views);
        // Those that are put in order.
        let sorted = u64::from(self.count) * u64::from(self.orders);
        let splats = words(&mut memory.splats, gpu, elements * size_of::<layout::Splat>() as u64 / 4);
        let stairs = words(&mut memory.stairs, gpu, elements * size_of::<Stairs>() as u64 / 4);
        let high = words(&mut memory.high, gpu, sorted);
        let found = words(&mut memory.found, gpu, 2);
        gpu.queue.write_buffer(&found.buffer, 0, &[0; 8]);
        let both = pairs(&mut memory.elements, gpu, sorted);
        memory.sorted = sorted;

        let mut steps = Steps::default();
        steps.stage();
        let projection = layout::Projection {
            eyes: self.eyes,
            near: self.near,
            hair: self.hair,
            nothing: 0,
            size: part.views[0].size,
            rows: [part.rows.start, part.rows.end],
            particles: self.count,
            views: grid.views,
            kinds: self.sets,
            linear: self.linear.into(),
            orders: self.orders,
            padding: [0; 3],
        };
        let buffers = [&self.particles, &self.kinds, &splats, &stairs, &high, &both[0].keys, &both[0].values, &found];
        let [workgroups, _] = groups(self.count.into());
        steps.add(&self.project, bytemuck::bytes_of(&projection), &buffers, [workgroups, grid.views]);

        steps.stage();
        let sorter = &self.binner.sorter;
        let scratch = &mut memory.scratch;
        let mut ordered = sorter.sort(gpu, &mut steps, scratch, both.clone(), sorted, 0..LOW_BITS);
        let work = Work { count: sorted as u32, ..Work::default() };
        let buffers = [&ordered.values, &high, &ordered.keys];
        steps.add(&self.gather, bytemuck::bytes_of(&work), &buffers, groups(sorted));
        // Two passes before: the pairs are where they began.
        ordered = sorter.sort(gpu, &mut steps, scratch, [ordered, both[1].clone()], sorted, 0..32);
        let ends = self.binner.ends(gpu, &mut steps, memory, [&ordered.values, &stairs], sorted, grid);

        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let clock = clock(gpu, &mut memory.times);
        steps.encode(gpu, &mut memory.told, clock.map(|(queries, _)| (queries, 0)), &mut encoder);
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let back = memory.back.room(&gpu.device, 16 + 8 * u64::from(TIMES), usage);
        encoder.copy_buffer_to_buffer(&found.buffer, 0, &back, 0, 8);
        encoder.copy_buffer_to_buffer(&ends.buffer, 4 * sorted, &back, 8, 4);
        if let Some((queries, resolved)) = clock {
            encoder.resolve_query_set(queries, 0..4, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, &back, 16, 32);
        }
        gpu.queue.submit([encoder.finish()]);
        let (counts, ticks) = gpu.read(&back, 48, |bytes| {
            let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes[..12]);
            (counts, bytemuck::pod_collect_to_vec::<u8, u64>(&bytes[16..48]))
        })?;
        match gpu.clock {
            Some(period) => {
                times.project += elapsed(&ticks[..2], period);
                times.order += elapsed(&ticks[2..], period);
            }
            None => times.project += start.elapsed(),
        }
        let [seen, unclear, total] = [counts[0], counts[1], counts[2]].map(u64::from);
        if unclear > 0 {
            return Ok(Err("one is too near the near plane to tell its side"));
        }
        if total > MOST_PAIRS.min(gpu.most_bytes() / 4) {
            return Ok(Err("they reach into too many tiles"));
        }
        // A list is no longer than that.
        if seen > gpu.longest_list() {
            return Ok(Err("its driver does not go through lists so long"));
        }

        let mut steps = Steps::default();
        steps.stage();
        let (starts, list) =
            self.binner.lists(gpu, &mut steps, memory, [&ordered.values, &stairs, &ends], [sorted, total], grid);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let clock = memory.times.as_ref().filter(|_| gpu.clock.is_some());
        steps.encode(gpu, &mut memory.told, clock.map(|(queries, _)| (queries, 4)), &mut encoder);
        if let Some((queries, resolved)) = clock {
            encoder.resolve_query_set(queries, 4..TIMES, resolved, 0);
        }
        gpu.queue.submit([encoder.finish()]);
        let size = 4 * u64::from(grid.tiles + 1);
        let of_view = |v: u32| Slice {
            buffer: starts.buffer.clone(),
            offset: 4 * u64::from(v * grid.stride()),
            size: size.max(256),
        };
        Ok(Ok(Listed { splats, starts: (0..grid.views).map(of_view).collect(), list, seen }))
    }

    /// Adds the time of the last stage of the last lists; the device has done everything that was submitted.
    pub fn finish(&self, gpu: &Gpu, memory: &mut Memory, times: &mut Times) -> Result<()> {
        let (Some(period), Some((_, resolved))) = (gpu.clock, &memory.times) else { return Ok(()) };
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let back = memory.back.room(&gpu.device, 16, usage);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(resolved, 0, &back, 0, 16);
        gpu.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = gpu.read(&back, 16, bytemuck::pod_collect_to_vec)?;
        times.bin += elapsed(&ticks, period);
        Ok(())
    }
}

impl Binner {
    fn new(gpu: &mut Gpu) -> Result<Self> {
        Ok(Self {
            sorter: Sorter::new(gpu)?,
            measure: kernel(gpu, &shader::MEASURE, &[READ, READ, WRITE])?,
            emit: kernel(gpu, &shader::EMIT, &[READ, READ, READ, WRITE, WRITE])?,
            starts: kernel(gpu, &shader::STARTS, &[READ, WRITE])?,
        })
    }

    /// Pairs before each element in order, and all of them; as [`Binner::lists`].
    fn ends(
        &self,
        gpu: &Gpu,
        steps: &mut Steps,
        memory: &mut Memory,
        [order, stairs]: [&Slice; 2],
        count: u64,
        grid: Grid,
    ) -> Slice {
        let ends = words(&mut memory.ends, gpu, count + 1);
        let Grid { particles, together, .. } = grid;
        let work = Work { count: count as u32, particles, together, ..Work::default() };
        steps.add(&self.measure, bytemuck::bytes_of(&work), &[order, stairs, &ends], groups(count + 1));
        self.sorter.scan(gpu, steps, &mut memory.scratch, &ends, count + 1);
        ends
    }

    /// Where each tile's list begins, and the lists, of `total` pairs; from the order of `count` elements, each of which stands for
    /// those of all views that share the order, the tiles that each reaches into, and [`Binner::ends`].
    fn lists(
        &self,
        gpu: &Gpu,
        steps: &mut Steps,
        memory: &mut Memory,
        [order, stairs, ends]: [&Slice; 3],
        [count, total]: [u64; 2],
        grid: Grid,
    ) -> (Slice, Slice) {
        let both = pairs(&mut memory.pairs, gpu, total);
        let work = Work {
            count: count as u32,
            particles: grid.particles,
            stride: grid.stride(),
            across: grid.across,
            together: grid.together,
            ..Work::default()
        };
        let buffers = [order, stairs, ends, &both[0].keys, &both[0].values];
        steps.add(&self.emit, bytemuck::bytes_of(&work), &buffers, [total.div_ceil(BLOCK) as u32, 1]);
        let bits = (grid.keys() - 1).ilog2() + 1;
        let sorted = self.sorter.sort(gpu, steps, &mut memory.scratch, both, total, 0..bits);
        let starts = words(&mut memory.starts, gpu, grid.keys().into());
        let work = Work { count: total as u32, blocks: grid.keys(), ..Work::default() };
        let buffers = [&sorted.keys, &starts];
        steps.add(&self.starts, bytemuck::bytes_of(&work), &buffers, groups(grid.keys().into()));
        (starts, sorted.values)
    }
}

fn pairs(memory: &mut [[Growing; 2]; 2], gpu: &Gpu, count: u64) -> [Pairs; 2] {
    let [first, second] = memory;
    [first, second].map(|[keys, values]| Pairs { keys: words(keys, gpu, count), values: words(values, gpu, count) })
}

/// Queries, and what they are resolved into.
type Clock = (wgpu::QuerySet, wgpu::Buffer);

/// Where the device's times go, where it has a clock.
fn clock<'a>(gpu: &Gpu, times: &'a mut Option<Clock>) -> Option<&'a Clock> {
    gpu.clock?;
    Some(times.get_or_insert_with(|| {
        let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: TIMES };
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        (gpu.device.create_query_set(&descriptor), gpu.buffer(8 * u64::from(TIMES), usage))
    }))
}

/// The largest of all lengths but radii, where single precision has room for them.
fn scale(range: &Range, views: &[View]) -> Option<f64> {
    let [least, most] = LENGTHS;
    let middle = range.middle();
    let far = views.iter().map(|view| (view.position - middle).abs().max_element()).fold(range.reach(), f64::max);
    let lengths = [range.radii[0], range.radii[1], views[0].near];
    let focal = views[0].focal_px();
    let room = far <= most
        && lengths.iter().all(|length| (least..=most).contains(length))
        && [focal.x, focal.y].iter().all(|focal| (least..=most).contains(focal));
    room.then_some(far)
}

fn eye_of(view: &View, middle: DVec3) -> layout::Eye {
    let vector = |v: DVec3| {
        let [x, y, z] = v.to_array().map(parts);
        [[x[0], y[0], z[0], 0.0], [x[1], y[1], z[1], 0.0]]
    };
    let [right, up, back] = [0, 1, 2].map(|axis| view.eye_from_world.row(axis));
    let first = view.direction(0.5, 0.5);
    let focal = view.focal_px();
    let pair = |x: f64, y: f64| {
        let [x, y] = [parts(x), parts(y)];
        [x[0], x[1], y[0], y[1]]
    };
    layout::Eye {
        position: vector(view.position - middle),
        right: vector(right),
        up: vector(up),
        forward: vector(-back),
        tangent: pair(first.x, first.y),
        step: pair(1.0 / focal.x, -1.0 / focal.y),
        focal: focal.as_vec2().to_array(),
        center: view.picture_from_tangent(DVec2::ZERO).as_vec2().to_array(),
    }
}

/// For tests of the lists alone.
impl Gpu {
    /// The particles that reach into each of `across` x `down` tiles, none beyond them, as [`super::bin::lists`] has them; fewer
    /// than 2^25 pairs.
    pub fn tile_lists(&mut self, stairs: &[Stairs], [across, down]: [u32; 2]) -> Result<bin::Lists> {
        let binner = Binner::new(self)?;
        let mut memory = Memory::default();
        let count = stairs.len() as u64;
        let order: Vec<u32> = (0..stairs.len() as u32).collect();
        let order = filled(&mut Growing::new(), self, bytemuck::cast_slice(&order));
        let tiles = across * down;
        let grid = Grid { views: 1, across, tiles, particles: stairs.len().max(1) as u32, together: 1 };
        let stairs = filled(&mut Growing::new(), self, bytemuck::cast_slice(stairs));
        let mut steps = Steps::default();
        let ends = binner.ends(self, &mut steps, &mut memory, [&order, &stairs], count, grid);
        self.run(steps)?;
        let total = self.fetch(&ends, count + 1)?.last().copied().unwrap_or_default();
        let mut steps = Steps::default();
        let inputs = [&order, &stairs, &ends];
        let (starts, list) = binner.lists(self, &mut steps, &mut memory, inputs, [count, total.into()], grid);
        self.run(steps)?;
        let starts = self.fetch(&starts, u64::from(tiles) + 1)?;
        Ok(bin::Lists { starts, list: self.fetch(&list, total.into())? })
    }

    /// How many keys the last lists put in order.
    pub fn keys_sorted(&self) -> u64 {
        self.memory.lists.sorted
    }
}
