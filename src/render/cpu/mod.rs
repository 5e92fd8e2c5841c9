//! The CPU path: a tile engine that is generic over the method.
//!
//! | file | does |
//! |---|---|
//! | `simd/` | vectors of f32, the instruction set chosen at run time |
//! | `order.rs` | front-to-back order, in batches |
//! | `splat.rs` | what the engine asks of a method |
//! | `primitive.rs` | kernels' optical depth along a ray, in vectors |
//! | `slab.rs` | slabs of depth, without order |
//! | `footprint.rs` | kernels' footprints in vectors |
//! | `composite.rs` | compositing in registers |
//! | `tile.rs` | one band of tiles |
//! | `engine.rs` | the loop over batches and bands |

pub mod composite;
pub mod engine;
pub mod footprint;
pub mod order;
pub mod primitive;
pub mod simd;
pub mod slab;
pub mod splat;
pub mod tile;
