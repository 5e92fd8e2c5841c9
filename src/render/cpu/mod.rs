//! The CPU tile engine.

pub mod opaque;
pub mod simd;
