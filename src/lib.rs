//! Offscreen stereo images of gas.
//!
//! stereomist renders left and right views of particle clouds (fog, cloud, smoke) with billboards parallel to the view
//! plane or facing the viewpoint and with better methods, and packs the two views into red/cyan anaglyphs and
//! side-by-side pictures.
//!
//! # Spaces and units
//! - *World space*: the scene file's axes, right-handed, scene units, f64.
//! - *Eye space*: eye at the origin, looking down -z, x right, y up. Depth is `-z`.
//! - *Picture coordinates*: pixels, x right, y down, pixel centres at half-integers; row 0 is the top row.
//! - Angles are radians; names that end in `_deg` are degrees. Colour is linear-light RGB with sRGB primaries.
//!
//! # The rooms, each named by the question it answers
//! | room | question | may import |
//! |---|---|---|
//! | [`scene`] | what is rendered | nobody |
//! | [`picture`] | to what | `error` |
//! | [`render`] | how | `scene`, `picture`, `error` |
//! | [`input`] | from where | `render`, `scene`, `picture`, `error` |
//! | [`study`] | how good | `input`, `render`, `scene`, `picture`, `error` |
//! | [`cli`] | who asks | `study`, `input`, `render`, `scene`, `picture`, `error` |
//! | [`error`] | what went wrong | nobody |
//!
//! Some things have fewer places still:
//!
//! | what | where |
//! |---|---|
//! | `render::method`, `render::Method`, `render::gpu` | not in `render::cpu` |
//! | `render::method`, `render::Method` | not in `render::gpu` |
//! | `render::cpu`, `render::gpu`, `render::method`, `render::Method` | not in `render::reference` |
//! | `rayon` | only in `render`, `picture::film`, `picture::output`, `input`, `study`, `cli` |
//! | `wgpu`, `pollster` | only in `render::gpu` |
//! | `bytemuck` | only in `render::gpu`, `picture::plane` |
//! | `clap`, `indicatif`, `etcetera` | only in `cli` |
//! | `toml` | only in `input::scene_file` |
//! | `resvg`, `dejavu` | only in `study::plot` |
//! | `unsafe` | only in `render::cpu::simd` |
//!
//! A test (`tests/layers.rs`) reads these tables and every path in `src/`, and holds them.
//!
//! # Adding a thing
//! - a kernel: `scene/kernel/x.rs`, a variant and its arms in `scene/kernel/mod.rs`;
//! - a method: `render/method/x.rs`, a variant and its arms in `render/method/mod.rs`; on the GPU: `shaders/method/x.wgsl` and
//!   `shaders/project/x.wgsl`, their rows in `render/gpu/shader.rs` and an implementation of `render::gpu::splat::Shaded`;
//!   parameters: its struct in the same file, a reader in `input/scene_file/method.rs`;
//! - a particle format: `input/x.rs`, a row of `input::READERS`;
//! - a mesh format: `input/x.rs`, a row of `input::MESH_READERS`;
//! - a packing: `picture/packing/x.rs`, a row of `picture::packing::PACKINGS`;
//! - an image format: `picture/output/x.rs`, a row of `picture::output::WRITERS`;
//! - a point of the chart of time against error: a row of `study::chart::CANDIDATES`.

pub mod cli;
pub mod error;
pub mod input;
pub mod picture;
pub mod render;
pub mod scene;
pub mod study;

pub use error::{Error, Result};
