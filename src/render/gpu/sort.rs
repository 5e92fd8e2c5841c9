//! Stable sorting of pairs by digits of 8 bits, and sums: Blelloch's counting sort by blocks (Zagha & Blelloch, Radix sort for vector
//! multiprocessors, 1991), with what every WebGPU device has: no subgroups, and no order that depends on which invocation comes
//! first.

use super::Gpu;
use super::device::{Growing, READ, WRITE};
use super::layout::Work;
use super::shader;
use super::steps::{Slice, Steps, kernel, words};
use crate::error::Result;
use std::ops::Range;

/// Elements that a workgroup takes, as in `shaders/lists/`.
pub(super) const BLOCK: u64 = 1024;
/// Bits of a digit.
const DIGIT: u32 = 8;

/// The kernels.
pub(super) struct Sorter {
    count: wgpu::ComputePipeline,
    scatter: wgpu::ComputePipeline,
    scan: wgpu::ComputePipeline,
    spread: wgpu::ComputePipeline,
}

/// Memory between the kernels of a pass.
#[derive(Default)]
pub(super) struct Scratch {
    counts: Growing,
    /// By level of the sums.
    sums: Vec<Growing>,
}

/// Keys and values, as many of one as of the other.
#[derive(Clone)]
pub(super) struct Pairs {
    pub keys: Slice,
    pub values: Slice,
}

/// Workgroups of 256 invocations for so many of them.
pub(super) fn groups(invocations: u64) -> [u32; 2] {
    [invocations.div_ceil(256) as u32, 1]
}

impl Sorter {
    pub fn new(gpu: &mut Gpu) -> Result<Self> {
        Ok(Self {
            count: kernel(gpu, &shader::COUNT, &[READ, WRITE])?,
            scatter: kernel(gpu, &shader::SCATTER, &[READ, READ, READ, WRITE, WRITE])?,
            scan: kernel(gpu, &shader::SCAN, &[WRITE, WRITE])?,
            spread: kernel(gpu, &shader::SPREAD, &[WRITE, READ])?,
        })
    }

    /// Sorts `count` pairs, at most 2^25, by a range of their keys' bits; those with equal bits keep their order. They go to and fro
    /// between the two buffers and end in the one that is returned.
    pub fn sort(
        &self,
        gpu: &Gpu,
        steps: &mut Steps,
        memory: &mut Scratch,
        [mut from, mut to]: [Pairs; 2],
        count: u64,
        bits: Range<u32>,
    ) -> Pairs {
        let blocks = count.div_ceil(BLOCK);
        let counts = words(&mut memory.counts, gpu, blocks << DIGIT);
        for shift in bits.step_by(DIGIT as usize) {
            let work = Work { count: count as u32, shift, blocks: blocks as u32, ..Work::default() };
            let told = bytemuck::bytes_of(&work);
            steps.add(&self.count, told, &[&from.keys, &counts], [blocks as u32, 1]);
            self.scan(gpu, steps, memory, &counts, blocks << DIGIT);
            let buffers = [&from.keys, &from.values, &counts, &to.keys, &to.values];
            steps.add(&self.scatter, told, &buffers, [blocks as u32, 1]);
            std::mem::swap(&mut from, &mut to);
        }
        from
    }

    /// Replaces each of `count` words by the sum of those before it, at most 2^31 - 1, which none of them exceeds. At most 2^25.
    pub fn scan(&self, gpu: &Gpu, steps: &mut Steps, memory: &mut Scratch, values: &Slice, count: u64) {
        self.scan_level(gpu, steps, &mut memory.sums, 0, values, count);
    }

    fn scan_level(
        &self,
        gpu: &Gpu,
        steps: &mut Steps,
        memory: &mut Vec<Growing>,
        level: usize,
        values: &Slice,
        count: u64,
    ) {
        if memory.len() <= level {
            memory.push(Growing::default());
        }
        let blocks = count.div_ceil(BLOCK);
        let sums = words(&mut memory[level], gpu, blocks);
        let work = Work { count: count as u32, ..Work::default() };
        let told = bytemuck::bytes_of(&work);
        steps.add(&self.scan, told, &[values, &sums], [blocks as u32, 1]);
        if blocks > 1 {
            self.scan_level(gpu, steps, memory, level + 1, &sums, blocks);
            steps.add(&self.spread, told, &[values, &sums], groups(count));
        }
    }
}

/// For tests of the kernels alone.
impl Gpu {
    /// Indices of keys, at most 2^25, in the order of a range of their bits; those of equal bits ascend.
    pub fn sorted(&mut self, keys: &[u32], bits: Range<u32>) -> Result<Vec<u32>> {
        let sorter = Sorter::new(self)?;
        let [mut a, mut b, mut c, mut d] = [const { Growing::new() }; 4];
        let count = keys.len() as u64;
        let pairs = |keys, values| Pairs { keys: words(keys, self, count), values: words(values, self, count) };
        let both = [pairs(&mut a, &mut b), pairs(&mut c, &mut d)];
        let indices: Vec<u32> = (0..keys.len() as u32).collect();
        self.queue.write_buffer(&both[0].keys.buffer, 0, bytemuck::cast_slice(keys));
        self.queue.write_buffer(&both[0].values.buffer, 0, bytemuck::cast_slice(&indices));
        let mut steps = Steps::default();
        let sorted = sorter.sort(self, &mut steps, &mut Scratch::default(), both, count, bits);
        self.run(steps)?;
        self.fetch(&sorted.values, count)
    }

    /// The sum of the words before each of them, at most 2^25 words, each less than 2^31; sums stop at 2^31 - 1.
    pub fn sums(&mut self, values: &[u32]) -> Result<Vec<u32>> {
        let sorter = Sorter::new(self)?;
        let count = values.len() as u64;
        let slice = words(&mut Growing::new(), self, count);
        self.queue.write_buffer(&slice.buffer, 0, bytemuck::cast_slice(values));
        let mut steps = Steps::default();
        sorter.scan(self, &mut steps, &mut Scratch::default(), &slice, count);
        self.run(steps)?;
        self.fetch(&slice, count)
    }

    pub(super) fn run(&self, steps: Steps) -> Result<()> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        steps.encode(self, &mut Growing::new(), None, &mut encoder);
        self.queue.submit([encoder.finish()]);
        self.wait()
    }

    /// The first words of a slice.
    pub(super) fn fetch(&self, slice: &Slice, count: u64) -> Result<Vec<u32>> {
        let size = (4 * count).max(4);
        let back = self.buffer(size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&slice.buffer, slice.offset, &back, 0, size);
        self.queue.submit([encoder.finish()]);
        self.read(&back, size, |bytes| bytemuck::pod_collect_to_vec(&bytes[..4 * count as usize]))
    }
}
