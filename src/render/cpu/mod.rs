//! The CPU path: a tile engine that is generic over the method, and a sheet buffer.
//!
//! | file | does |
//! |---|---|
//! | `simd/` | vectors of f32, the instruction set chosen at run time |
//! | `order.rs` | front-to-back order, in batches |
//! | `splat.rs` | what the engine asks of a method |
//! | `sight.rs` | where a view sees balls, many at once |
//! | `rim.rs` | outlines of particles |
//! | `primitive.rs` | kernels' optical depth along a ray, in vectors |
//! | `slab/` | slabs of depth, without order |
//! | `nearby.rs` | which balls a block's rays may meet |
//! | `footprint.rs` | kernels' footprints in vectors |
//! | `composite.rs` | compositing in registers |
//! | `lists.rs` | which particles touch which tiles |
//! | `tile.rs` | one band of tiles |
//! | `develop.rs` | from states of tiles to pixels |
//! | `engine.rs` | the loop over batches and bands |
//! | `segments.rs` | pre-integrated kernel segments |
//! | `adaptive/` | gas on grids of nodes, as coarse as a tolerance allows |
//! | `cover.rs` | sums over the particles that touch each cell of a picture |
//! | `faint.rs` | which particles are too faint to matter, all together |
//! | `forecast.rs` | whether grids or billboards are cheaper |
//! | `laps.rs` | wall time of stages that tasks go through side by side |
//! | `tempo.rs` | how fast this machine is, for predicted times |
//! | `mixing.rs` | by how much balls one behind the other differ from gas that mixes |
//! | `thin.rs` | where gas is so thin that affine footprints are exact enough |
//! | `additive.rs` | optical depth on a grid, ball by ball: gas of one colour |
//! | `encode.rs` | 8-bit sRGB codes in vectors |
//! | `random.rs` | random numbers of unit tests |
//! | `sheet.rs` | the sheet buffer: slices of segments, tile by tile |

pub mod adaptive;
pub mod additive;
pub mod composite;
pub mod cover;
pub mod dense;
pub mod develop;
pub mod encode;
pub mod engine;
pub mod faint;
pub mod footprint;
pub mod forecast;
pub mod laps;
pub mod lists;
pub mod mixing;
pub mod nearby;
pub mod order;
pub mod primitive;
#[cfg(test)]
pub mod random;
pub mod rim;
pub mod segments;
pub mod sheet;
pub mod sight;
pub mod simd;
pub mod slab;
pub mod splat;
pub mod tempo;
pub mod thin;
pub mod tile;
