//! Which adapters there are, which of them is used, and why none.
//!
//! They are reached by Vulkan, Metal or Direct3D 12. OpenGL is left out: its contexts belong to one thread at a time, and what
//! has no other interface is slower than the CPU.

use crate::error::{Error, Result};
use std::sync::OnceLock;
use wgpu::{Backend, DeviceType, DownlevelFlags, Features, Limits};

/// What kind of machine stands behind an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the memory of the CPU.
    Integrated,
    /// A GPU lent by a virtual machine's host.
    Virtual,
    /// The driver does not say.
    Unknown,
    /// A driver that computes on the CPU (llvmpipe, SwiftShader, WARP). Used only by name.
    Software,
}

impl Class {
    /// A word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Unknown => "unknown",
            Self::Software => "software",
        }
    }
}

/// An adapter and whether it can be used.
pub struct Candidate {
    /// The name that the driver gives.
    pub name: String,
    /// Its kind.
    pub class: Class,
    /// The interface it is reached by: vulkan, metal or dx12.
    pub backend: &'static str,
    /// Driver and its version, as far as it says.
    pub driver: String,
    /// What it lacks, where it lacks something that is needed.
    pub lacks: Option<String>,
    /// Whether it can blend targets of 32 bits per channel.
    pub blends: bool,
    pub(super) adapter: wgpu::Adapter,
}

impl Candidate {
    /// Name, class, interface and driver, for people.
    pub fn describe(&self) -> String {
        let driver = if self.driver.is_empty() { String::new() } else { format!(", {}", self.driver) };
        format!("{} ({}, {}{driver})", self.name, self.class.name(), self.backend)
    }
}

/// The instance is made when the first adapter is asked for, and once: its drivers are loaded then, which takes longer than
/// everything else. What never asks for an adapter never waits for that.
fn instance() -> &'static wgpu::Instance {
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    INSTANCE.get_or_init(|| wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle()))
}

/// What the shaders need: storage buffers in one stage, invocations per workgroup, bytes that they share.
const BUFFERS: u32 = 7;
const INVOCATIONS: u32 = 256;
const SHARED_BYTES: u32 = 64 * size_of::<super::layout::Splat>() as u32 + 16;

/// Every adapter, the most wanted first: by class, then by interface.
pub fn adapters() -> Vec<Candidate> {
    let found = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::all()));
    let mut candidates: Vec<(u8, Candidate)> = found
        .into_iter()
        .map(|adapter| {
            let info = adapter.get_info();
            let class = match info.device_type {
                DeviceType::DiscreteGpu => Class::Discrete,
                DeviceType::IntegratedGpu => Class::Integrated,
                DeviceType::VirtualGpu => Class::Virtual,
                DeviceType::Cpu => Class::Software,
                DeviceType::Other => Class::Unknown,
            };
            // Of one GPU reached by several interfaces, the one with the better driver.
            let (backend, rank) = match info.backend {
                Backend::Vulkan => ("vulkan", 0),
                Backend::Metal => ("metal", 0),
                Backend::Dx12 => ("dx12", 1),
                Backend::Gl => ("gl", 2),
                Backend::BrowserWebGpu => ("webgpu", 3),
                Backend::Noop => ("noop", 4),
            };
            let driver = [info.driver.as_str(), info.driver_info.as_str()];
            let driver = driver.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ");
            let flags = adapter.get_downlevel_capabilities().flags;
            let lacks = lacks(&adapter.limits(), flags.contains(DownlevelFlags::COMPUTE_SHADERS));
            let blends = adapter.features().contains(Features::FLOAT32_BLENDABLE);
            (rank, Candidate { name: info.name, class, backend, driver, lacks, blends, adapter })
        })
        .collect();
    candidates.sort_by_key(|(rank, candidate)| (candidate.class, *rank));
    candidates.into_iter().map(|(_, candidate)| candidate).collect()
}

/// What limits lack of what the shaders need.
fn lacks(limits: &Limits, computes: bool) -> Option<String> {
    if !computes {
        return Some("compute shaders".into());
    }
    let needs = [
        ("storage buffers in a shader", limits.max_storage_buffers_per_shader_stage, BUFFERS),
        ("invocations in a workgroup", limits.max_compute_invocations_per_workgroup, INVOCATIONS),
        ("bytes of workgroup memory", limits.max_compute_workgroup_storage_size, SHARED_BYTES),
    ];
    let (what, has, needed) = needs.into_iter().find(|(_, has, needed)| has < needed)?;
    Some(format!("{what}: {has} of the {needed} that are needed"))
}

/// The adapter that `--device gpu` means, or `--device gpu:NAME` with a part of its name in any case. Software drivers are
/// used only by name.
///
/// # Errors
/// [`Error::Device`] with the reason and what to do.
pub fn choose(name: Option<&str>) -> Result<Candidate> {
    let all = adapters();
    let wanted = name.map(str::to_lowercase);
    let fits = |candidate: &Candidate| match &wanted {
        Some(name) => candidate.name.to_lowercase().contains(name.as_str()),
        None => candidate.class != Class::Software,
    };
    let list: Vec<String> = all.iter().map(Candidate::describe).collect();
    let mut lack = None;
    for candidate in all.into_iter().filter(fits) {
        match &candidate.lacks {
            None => return Ok(candidate),
            Some(what) => {
                lack.get_or_insert_with(|| format!("{} lacks {what}", candidate.describe()));
            }
        }
    }
    let reason = match (lack, name) {
        (Some(lack), _) => lack,
        (None, _) if list.is_empty() => why_none(),
        (None, Some(name)) => format!("no adapter's name has `{name}` in it; there are: {}", list.join(", ")),
        (None, None) => {
            format!("there are software drivers alone, which are used only by name (gpu:NAME): {}", list.join(", "))
        }
    };
    Err(Error::Device(format!("no GPU can be used: {reason}; use --device cpu or auto")))
}

/// Why there is no adapter at all, and what to install.
pub fn why_none() -> String {
    // wgpu tells which of its interfaces are there only when it is asked for an adapter and has none.
    let options = wgpu::RequestAdapterOptions::default();
    let cause = match pollster::block_on(instance().request_adapter(&options)) {
        Ok(_) => "no adapter is offered".to_owned(),
        Err(error) => {
            let text = error.to_string();
            if text.contains("vulkan drivers/libraries could not be loaded") {
                "the Vulkan loader (libvulkan) or a driver for it is missing".to_owned()
            } else {
                text
            }
        }
    };
    format!("{cause}. {INSTALL}")
}

/// What makes a GPU usable, by system.
pub const INSTALL: &str = "To install: Debian, Ubuntu: libvulkan1 and mesa-vulkan-drivers (NVIDIA: its own driver, in a \
                           container with NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility); Fedora: vulkan-loader and \
                           mesa-vulkan-drivers; macOS: nothing, Metal is part of it; Windows: the GPU maker's driver";
