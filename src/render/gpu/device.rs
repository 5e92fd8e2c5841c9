//! An open device: buffers, submissions, read-back, and what goes wrong with them.

use super::adapter::{self, Candidate, Class};
use super::part::Memory;
use super::raster::{OUTLINE, Precision};
use super::shader::{self, Part};
use crate::error::{Error, Result};
use crate::render::calibration::Speeds;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use wgpu::{BindingType, BufferBindingType, BufferUsages, Features, ShaderStages, TextureFormat};

/// A GPU that is ready to compute, and what is kept on it from frame to frame.
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// The first thing that went wrong.
    fault: Arc<Mutex<Option<String>>>,
    description: String,
    /// Whether the driver computes on the CPU.
    software: bool,
    /// Most bytes of a buffer that shaders see.
    most: u64,
    /// Nanoseconds per tick of the device's clock, where it can be read.
    pub(super) clock: Option<f32>,
    /// Whether targets of 32 bits can be blended.
    blends: bool,
    /// Most pixels along a side of a texture.
    longest_side: u32,
    pipelines: Vec<(Vec<Part>, wgpu::ComputePipeline)>,
    raster_pipelines: Vec<(Vec<Part>, TextureFormat, wgpu::RenderPipeline)>,
    pub(super) memory: Memory,
    /// Where the compute path lists particles.
    lists: Lists,
    /// What its paths were measured to take, where they were.
    pub(in crate::render) speeds: Option<Speeds>,
}

/// How much of what an adapter has a device is opened with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grade {
    /// All that is of use.
    Full,
    /// The limits that every WebGPU device has, and the features of the adapter.
    LeastLimits,
    /// What every WebGPU device has.
    Least,
}

/// Where particles are projected, put in order and listed by tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lists {
    /// On the CPU, in f64.
    Cpu,
    /// On the device, with 48 bits where single precision would not do; on the CPU still where a frame is beyond that or beyond
    /// what buffers hold.
    Gpu,
}

const fn buffer(ty: BufferBindingType) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// A structure that shaders read.
pub(super) const UNIFORM: BindingType = buffer(BufferBindingType::Uniform);
/// A storage buffer that shaders read.
pub(super) const READ: BindingType = buffer(BufferBindingType::Storage { read_only: true });
/// A storage buffer that shaders write.
pub(super) const WRITE: BindingType = buffer(BufferBindingType::Storage { read_only: false });
/// A texture of numbers that shaders read pixel by pixel.
pub(super) const TEXTURE: BindingType = BindingType::Texture {
    sample_type: wgpu::TextureSampleType::Float { filterable: false },
    view_dimension: wgpu::TextureViewDimension::D2,
    multisampled: false,
};

/// The first bytes of a buffer as a shader sees it.
pub(super) fn bytes(buffer: &wgpu::Buffer, size: u64) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: std::num::NonZero::new(size) })
}

/// Most bytes in a buffer whatever the adapter allows: offsets and sizes stay far from 32 bits.
const MOST: u64 = 1 << 30;

impl Gpu {
    /// Opens the adapter that `--device gpu` or `--device gpu:NAME` means; see [`adapter::choose`].
    pub fn named(name: Option<&str>) -> Result<Self> {
        Self::open(adapter::choose(name)?, Grade::Full)
    }

    /// Opens an adapter with all that it has, or with less.
    pub fn open(candidate: Candidate, grade: Grade) -> Result<Self> {
        let description = candidate.describe();
        let Candidate { adapter, class, .. } = candidate;
        let limits = match grade {
            Grade::Full => adapter.limits(),
            Grade::LeastLimits | Grade::Least => wgpu::Limits::default(),
        };
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(MOST);
        let longest_side = limits.max_texture_dimension_2d;
        let features = match grade {
            Grade::Full | Grade::LeastLimits => {
                adapter.features() & (Features::TIMESTAMP_QUERY | Features::FLOAT32_BLENDABLE)
            }
            Grade::Least => Features::empty(),
        };
        let wanted = wgpu::DeviceDescriptor {
            label: Some("stereomist"),
            required_features: features,
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wanted)).map_err(|error| {
            Error::Device(format!(
                "no GPU can be used: {description} cannot be opened: {error}; use --device cpu or auto"
            ))
        })?;
        let fault = Arc::new(Mutex::new(None));
        let first = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |error| {
            let text = match error {
                wgpu::Error::OutOfMemory { .. } => {
                    "is out of memory: fewer particles or a smaller --size would help".to_owned()
                }
                wgpu::Error::Validation { description, .. } => format!("refused a command: {description}"),
                wgpu::Error::Internal { description, .. } => format!("failed: {description}"),
            };
            lock(&first).get_or_insert(one_line(&text));
        }));
        let first = Arc::clone(&fault);
        device.set_device_lost_callback(move |reason, text| {
            lock(&first).get_or_insert(one_line(&format!("was lost ({reason:?}): {text}")));
        });
        let clock = features.contains(Features::TIMESTAMP_QUERY).then(|| queue.get_timestamp_period());
        Ok(Self {
            device,
            queue,
            fault,
            description,
            software: class == Class::Software,
            lists: if class == Class::Software { Lists::Cpu } else { Lists::Gpu },
            most,
            clock,
            blends: features.contains(Features::FLOAT32_BLENDABLE),
            longest_side,
            pipelines: Vec::new(),
            raster_pipelines: Vec::new(),
            memory: Memory::default(),
            speeds: None,
        })
    }

    /// Name, class, interface and driver of the adapter.
    pub fn describe(&self) -> &str {
        &self.description
    }

    /// Most bytes of a buffer that shaders see.
    pub fn most_bytes(&self) -> u64 {
        self.most
    }

    /// Lowers [`Gpu::most_bytes`]: pictures and particles go through smaller buffers, in more pieces. At least 64 KiB stay.
    pub fn lower_most_bytes(&mut self, bytes: u64) {
        self.most = self.most.min(bytes.max(1 << 16));
    }

    /// Where the compute path of billboards projects, orders and lists particles.
    pub fn lists(&self) -> Lists {
        self.lists
    }

    /// Changes [`Gpu::lists`], which is [`Lists::Cpu`] at first for drivers that compute on the CPU and else [`Lists::Gpu`].
    pub fn set_lists(&mut self, lists: Lists) {
        self.lists = lists;
    }

    /// Most particles that a tile may go through in one submission. llvmpipe leaves loops without a word after 2^16 rounds in
    /// all, of an invocation; other software drivers may be no better.
    pub(super) fn longest_list(&self) -> u64 {
        if self.software { 1 << 15 } else { 1 << 31 }
    }

    /// Most pixels along a side of a texture, at least 2048.
    pub(super) fn longest_side(&self) -> u32 {
        self.longest_side
    }

    /// An error where a target of this precision cannot be blended.
    pub(crate) fn check_blending(&self, precision: Precision) -> Result<()> {
        match precision {
            Precision::Single if !self.blends => Err(Error::Device(format!(
                "no GPU can be used: {} {NO_BLENDING}; use --gpu-path compute, or raster-f16, which loses thin gas",
                self.description
            ))),
            Precision::Single | Precision::Half => Ok(()),
        }
    }

    /// Gives the device up, as a driver may at any time: every frame after it is an error.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Draws with the buffers that are kept from frame to frame; they stay, whatever comes of it.
    pub(super) fn with_memory<R>(&mut self, draw: impl FnOnce(&mut Self, &mut Memory) -> Result<R>) -> Result<R> {
        let mut memory = std::mem::take(&mut self.memory);
        let outcome = draw(self, &mut memory);
        self.memory = memory;
        outcome
    }

    /// An error if anything went wrong since the device was opened.
    pub(super) fn check(&self) -> Result<()> {
        match &*lock(&self.fault) {
            None => Ok(()),
            Some(fault) => Err(self.error(fault)),
        }
    }

    /// A failure of this device. What was reported first is told, since it is the cause.
    pub(super) fn error(&self, what: &str) -> Error {
        Error::Device(format!("the GPU {} {what}; use --device cpu", self.description))
    }

    /// The pipeline of a shader's one entry point, compiled when it is new. Its bindings are `bindings`, in this order, also
    /// those that the shader's functions happen not to use.
    pub(super) fn pipeline(&mut self, parts: &[Part], bindings: &[BindingType]) -> Result<wgpu::ComputePipeline> {
        if let Some((_, pipeline)) = self.pipelines.iter().find(|(other, _)| other == parts) {
            return Ok(pipeline.clone());
        }
        let pipeline = self.compile(&shader::join(parts), bindings);
        self.check()?;
        self.pipelines.push((parts.to_vec(), pipeline.clone()));
        Ok(pipeline)
    }

    /// The pipeline of a shader with one entry point for billboards' corners and one for their fragments, compiled when it
    /// is new: rectangles from outlines, one instance each, blended beneath what is in the target.
    pub(super) fn raster_pipeline(
        &mut self,
        parts: &[Part],
        bindings: &[BindingType],
        format: TextureFormat,
    ) -> Result<wgpu::RenderPipeline> {
        let known = self.raster_pipelines.iter().find(|(other, of, _)| other == parts && *of == format);
        if let Some((.., pipeline)) = known {
            return Ok(pipeline.clone());
        }
        let layout = self.layout(bindings, ShaderStages::VERTEX_FRAGMENT);
        let module = self.module(&shader::join(parts));
        // The light gains what comes through times the fragment's own; what comes through loses what the fragment takes.
        let add = |src_factor, dst_factor| wgpu::BlendComponent {
            src_factor,
            dst_factor,
            operation: wgpu::BlendOperation::Add,
        };
        let blend = wgpu::BlendState {
            color: add(wgpu::BlendFactor::DstAlpha, wgpu::BlendFactor::One),
            alpha: add(wgpu::BlendFactor::Zero, wgpu::BlendFactor::OneMinusSrcAlpha),
        };
        let pipeline = self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("stereomist"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: OUTLINE,
                    step_mode: wgpu::VertexStepMode::Instance,
                    attributes: &wgpu::vertex_attr_array![0 => Uint32x4],
                })],
            },
            primitive: wgpu::PrimitiveState { topology: wgpu::PrimitiveTopology::TriangleStrip, ..Default::default() },
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: Some(blend),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        });
        self.check()?;
        self.raster_pipelines.push((parts.to_vec(), format, pipeline.clone()));
        Ok(pipeline)
    }

    fn layout(&self, bindings: &[BindingType], visibility: ShaderStages) -> wgpu::PipelineLayout {
        let entries: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, &ty)| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None })
            .collect();
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let group = self.device.create_bind_group_layout(&descriptor);
        self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&group)],
            immediate_size: 0,
        })
    }

    fn module(&self, text: &str) -> wgpu::ShaderModule {
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("stereomist"),
            source: wgpu::ShaderSource::Wgsl(text.into()),
        })
    }

    fn compile(&self, text: &str, bindings: &[BindingType]) -> wgpu::ComputePipeline {
        let layout = self.layout(bindings, ShaderStages::COMPUTE);
        let module = self.module(text);
        self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("stereomist"),
            layout: Some(&layout),
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        })
    }

    /// A bind group: resources in the order of their bindings.
    pub(super) fn bind(&self, layout: &wgpu::BindGroupLayout, resources: &[wgpu::BindingResource]) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    /// Waits until the device has done everything that was submitted.
    pub(super) fn wait(&self) -> Result<()> {
        let outcome = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        outcome.map(|_| ()).map_err(|error| self.error(&format!("does not answer: {error}")))
    }

    /// Maps the first `size` bytes of a buffer and reads them; the device has done everything that was submitted.
    pub(super) fn read<R>(&self, buffer: &wgpu::Buffer, size: u64, read: impl FnOnce(&[u8]) -> R) -> Result<R> {
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, 0..size, move |outcome| {
            // The receiver waits below.
            let _ = sender.send(outcome);
        });
        self.wait()?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(_)) | Err(_) => return Err(self.error("does not give its results back")),
        }
        let view = buffer.get_mapped_range(0..size);
        let view = view.map_err(|error| self.error(&format!("does not give its results back: {error}")))?;
        let result = read(&view);
        drop(view);
        buffer.unmap();
        self.check()?;
        Ok(result)
    }

    /// Computes a WGSL expression of `v: vec4<f32>` for each input. `parts` define what it calls; `tables` is the array of
    /// that name. For tests of single functions.
    pub fn evaluate(&self, parts: &[Part], expression: &str, tables: &[f32], inputs: &[[f32; 4]]) -> Result<Vec<f32>> {
        let text = format!(
            "{}\n@group(0) @binding(0) var<storage, read> inputs: array<vec4<f32>>;\n\
             @group(0) @binding(1) var<storage, read_write> outputs: array<f32>;\n\
             @group(0) @binding(2) var<storage, read> tables: array<f32>;\n\
             @compute @workgroup_size(64) fn evaluate(@builtin(global_invocation_id) id: vec3<u32>) {{\n\
             if id.x < arrayLength(&inputs) {{ let v = inputs[id.x]; outputs[id.x] = {expression} + 0.0 * tables[0]; }}\n}}",
            shader::join(parts)
        );
        let pipeline = self.compile(&text, &[READ, WRITE, READ]);
        self.check()?;
        let input = self.filled(bytemuck::cast_slice(inputs));
        let table = self.filled(bytemuck::cast_slice(if tables.is_empty() { &[0.0] } else { tables }));
        let size = 4 * inputs.len() as u64;
        let output = self.buffer(size, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let back = self.buffer(size, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
        let group = self.bind(
            &pipeline.get_bind_group_layout(0),
            &[bytes(&input, input.size()), bytes(&output, size), bytes(&table, table.size())],
        );
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(inputs.len().div_ceil(64) as u32, 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&output, 0, &back, 0, size);
        self.queue.submit([encoder.finish()]);
        self.wait()?;
        self.read(&back, size, bytemuck::pod_collect_to_vec)
    }

    pub(super) fn buffer(&self, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    }

    fn filled(&self, bytes: &[u8]) -> wgpu::Buffer {
        let buffer = self.buffer(bytes.len() as u64, BufferUsages::STORAGE | BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }
}

/// What an adapter lacks that draws by compute alone. wgpu offers it on Vulkan.
pub const NO_BLENDING: &str = "cannot blend targets of 32 bits per channel";

/// A buffer that grows with what it has to hold.
#[derive(Default)]
pub(super) struct Growing(Option<wgpu::Buffer>);

impl Growing {
    /// One that holds nothing.
    pub const fn new() -> Self {
        Self(None)
    }

    /// The buffer with room for `size` bytes; what it held may be gone.
    pub fn room(&mut self, gpu: &wgpu::Device, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        // No binding may be empty, and arrays of structures hold at least one.
        let size = size.max(256);
        match &self.0 {
            Some(buffer) if buffer.size() >= size => buffer.clone(),
            Some(_) | None => {
                let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
                self.0.insert(gpu.create_buffer(&descriptor)).clone()
            }
        }
    }
}

fn lock(fault: &Mutex<Option<String>>) -> MutexGuard<'_, Option<String>> {
    fault.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A driver's message as part of a sentence.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
