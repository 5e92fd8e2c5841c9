//! Kernels of a frame that run one after the other, each told a few numbers.

use super::Gpu;
use super::device::{Growing, UNIFORM};
use super::shader::Part;
use crate::error::Result;
use wgpu::{BindingType, BufferUsages};

/// A part of a buffer as a kernel sees it.
#[derive(Clone)]
pub(super) struct Slice {
    pub buffer: wgpu::Buffer,
    /// In bytes, a multiple of 256.
    pub offset: u64,
    /// In bytes, more than 0.
    pub size: u64,
}

impl Slice {
    /// The first bytes of a buffer; never none, since no binding may be empty.
    pub fn new(buffer: &wgpu::Buffer, size: u64) -> Self {
        Self { buffer: buffer.clone(), offset: 0, size: size.max(256).min(buffer.size()) }
    }

    /// As a bind group has it.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        let (offset, size) = (self.offset, std::num::NonZero::new(self.size));
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.buffer, offset, size })
    }
}

/// Room for so many words that kernels read and write.
pub(super) fn words(buffer: &mut Growing, gpu: &Gpu, count: u64) -> Slice {
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    Slice::new(&buffer.room(&gpu.device, 4 * count, usage), 4 * count)
}

/// Room for so many bytes that kernels read, with what they are filled with.
pub(super) fn filled(buffer: &mut Growing, gpu: &Gpu, bytes: &[u8]) -> Slice {
    let buffer = buffer.room(&gpu.device, bytes.len() as u64, BufferUsages::STORAGE | BufferUsages::COPY_DST);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    Slice::new(&buffer, bytes.len() as u64)
}

/// The kernel of a shader that binds what it is told first, then storage buffers.
pub(super) fn kernel(gpu: &mut Gpu, parts: &[Part], buffers: &[BindingType]) -> Result<wgpu::ComputePipeline> {
    let bindings: Vec<BindingType> = [UNIFORM].iter().chain(buffers).copied().collect();
    gpu.pipeline(parts, &bindings)
}

/// Bytes from what one kernel is told to the next: what every device can bind at.
const ALIGNMENT: usize = 256;

/// Kernels to run, by stage; each stage is timed where the device has a clock.
#[derive(Default)]
pub(super) struct Steps {
    told: Vec<u8>,
    stages: Vec<Vec<Step>>,
}

struct Step {
    kernel: wgpu::ComputePipeline,
    /// Where what it is told begins, and its length.
    told: [usize; 2],
    buffers: Vec<Slice>,
    groups: [u32; 2],
}

impl Steps {
    /// Begins a stage.
    pub fn stage(&mut self) {
        self.stages.push(Vec::new());
    }

    /// Adds a kernel to the last stage: what it is told, its storage buffers in the order of their bindings, and its workgroups, at
    /// most 65535 along a side.
    pub fn add(&mut self, kernel: &wgpu::ComputePipeline, told: &[u8], buffers: &[&Slice], groups: [u32; 2]) {
        let start = self.told.len();
        self.told.extend(told);
        self.told.resize(self.told.len().next_multiple_of(ALIGNMENT), 0);
        let buffers = buffers.iter().copied().cloned().collect();
        if self.stages.is_empty() {
            self.stage();
        }
        if let Some(stage) = self.stages.last_mut() {
            stage.push(Step { kernel: kernel.clone(), told: [start, told.len()], buffers, groups });
        }
    }

    /// Encodes all of them; `told` is memory for what they are told, which no other steps of the submission may use. With `times`
    /// the device's times at the beginning and end of each stage go there, from a query on.
    pub fn encode(
        self,
        gpu: &Gpu,
        told: &mut Growing,
        times: Option<(&wgpu::QuerySet, u32)>,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        let told = told.room(&gpu.device, self.told.len() as u64, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        gpu.queue.write_buffer(&told, 0, &self.told);
        for (number, stage) in (0..).zip(&self.stages) {
            let timestamp_writes = times.map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first + 2 * number),
                end_of_pass_write_index: Some(first + 2 * number + 1),
            });
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
            for step in stage {
                let own = Slice { buffer: told.clone(), offset: step.told[0] as u64, size: step.told[1] as u64 };
                let resources: Vec<_> = [&own].into_iter().chain(&step.buffers).map(Slice::binding).collect();
                let group = gpu.bind(&step.kernel.get_bind_group_layout(0), &resources);
                pass.set_pipeline(&step.kernel);
                pass.set_bind_group(0, &group, &[]);
                let [x, y] = step.groups;
                pass.dispatch_workgroups(x, y, 1);
            }
        }
    }
}
