//! The GPU path: compute shaders through wgpu, without a window.
//!
//! | file | does |
//! |---|---|
//! | `adapter.rs` | which adapters there are, which is used, and why none |
//! | `device.rs` | an open device: buffers, submissions, read-back, and what goes wrong with them |
//! | `layout.rs` | what shaders read, in Rust |
//! | `shader.rs` | WGSL joined from the parts in `shaders/` |
//! | `splat.rs` | what the path asks of a method beside what the CPU asks |
//! | `bin.rs` | the particles of each tile |
//! | `compute.rs` | a frame of billboards |
//! | `slab.rs` | a frame of slabs |
//!
//! Of the billboard methods and `spherical`, order, preparation and the lists of particles per tile are made on the CPU, by the code of the CPU path and in f64; the
//! GPU composites: one workgroup per tile, front to back, colour and transmittance in f32 registers. `slab` needs no order;
//! its particles are listed by tile and eight slabs. Nothing is left out
//! because it is faint, and no value is kept in fewer than 32 bits. What is different from the CPU's picture is rounding and
//! where early termination ends: a tile ends when none of its 256 pixels lets more through than the tolerance allows.
//!
//! Particles go to the GPU in batches, and pictures in stretches of rows, so that no buffer exceeds what the adapter can
//! bind. Pictures are the same from run to run on the same device: no order depends on time.
//!
//! Errors: wgpu reports what goes wrong when it likes. Every frame ends with a count, made by the shader itself, of the tiles
//! that went through all of their particles; a frame that is short of a tile, or during which any error was reported, is an
//! [`crate::Error::Device`] and never a picture.

pub mod adapter;
mod bin;
pub mod compute;
pub mod device;
pub mod layout;
pub mod shader;
pub mod slab;
pub mod splat;

pub use device::Gpu;
