//! The GPU paths: compute and raster through wgpu, without a window.
//!
//! | file | does |
//! |---|---|
//! | `adapter.rs` | which adapters there are, which is used, and why none |
//! | `device.rs` | an open device: buffers, submissions, read-back, and what goes wrong with them |
//! | `layout.rs` | what shaders read, in Rust |
//! | `shader.rs` | WGSL joined from the parts in `shaders/` |
//! | `splat.rs` | what the path asks of a method beside what the CPU asks |
//! | `bin.rs` | the tiles that a particle reaches into, and the particles of each tile, on the CPU |
//! | `particles.rs` | the particles of a scene, kept on the device |
//! | `lists.rs` | particles projected, put in order and listed by tile on the device |
//! | `sort.rs` | sorting and summing on the device |
//! | `steps.rs` | small kernels, one after the other |
//! | `source.rs` | the particles of a view in their order, prepared in batches |
//! | `part.rs` | what every path uploads for a stretch of rows, waits for and reads back |
//! | `compute.rs` | a frame of billboards, composited tile by tile |
//! | `raster.rs` | a frame of billboards, drawn as such |
//! | `groups.rs` | particles by groups of slabs or slices, submitted as many as fit |
//! | `slab.rs` | a frame of slabs |
//! | `sheet.rs` | a frame of slices |
//!
//! The billboard methods and `spherical` are composited front to back, one of two ways. *Compute*: particles are listed by tile,
//! and one workgroup per tile keeps colour and transmittance in f32 registers. Lists are made on the device, from particles that
//! stay there, or as everything else is prepared: on the CPU, by the code of the CPU path and in f64 ([`Lists`]). *Raster*: the
//! billboards of an eye are one draw, blended in a target of f32. `slab` and `sheet` need no order; their particles are listed by
//! tile and eight slabs or slices on the CPU, and computed. A particle is listed in the tiles that its outline may touch: those of
//! an ellipse, or of a square billboard's bounds. Nothing is left out because it is faint, and no value is kept in fewer than 32
//! bits, unless targets of 16 are asked for. What is different from the CPU's picture is rounding and where early termination ends:
//! a tile of the compute path ends when none of its 256 pixels lets more through than the tolerance allows; raster never ends early.
//!
//! Particles go to the GPU in batches, and pictures in stretches of rows, so that no buffer and no texture exceeds what the
//! adapter can bind. Pictures are the same from run to run on the same device by the same path: no order depends on time.
//!
//! Errors: wgpu reports what goes wrong when it likes. Every frame ends with counts, made by the shaders themselves, of the
//! tiles that went through all of their particles, or of the draws that came to their last billboard; a frame that is short of
//! one, or during which any error was reported, is an [`crate::Error::Device`] and never a picture.

pub mod adapter;
pub mod bin;
pub mod compute;
pub mod device;
mod groups;
pub mod layout;
mod lists;
mod part;
mod particles;
pub mod raster;
pub mod shader;
pub mod sheet;
pub mod slab;
mod sort;
mod source;
pub mod splat;
mod steps;

pub use device::{Gpu, Grade, Lists, NO_BLENDING};
