//! Vectors of f32 over `core::arch`, chosen at run time.

/// A level of vector instructions, narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// No intrinsics; every architecture.
    Portable,
    /// SSE2, 4 lanes.
    Sse2,
    /// AVX2 with FMA, 8 lanes.
    Avx2,
    /// AVX-512 F/VL/DQ/BW, 16 lanes.
    Avx512,
}
