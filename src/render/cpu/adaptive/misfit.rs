//! Whether nodes are near enough to each other.

use crate::render::cpu::simd::{Simd, WithSimd};
use std::ops::Range;

/// Compares nodes with what their neighbours of twice the distance make of them, by a cubic along both axes.
pub struct Misfit<'a> {
    /// Planes of nodes, row by row.
    pub planes: &'a [Vec<f32>],
    /// Nodes in a row.
    pub width: usize,
    /// Which of each row are asked.
    pub spans: &'a [Range<usize>],
    /// The largest difference over the planes is taken into this.
    pub out: &'a mut [f32],
}

impl WithSimd for Misfit<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let width = self.width;
        let rows = self.out.len() / width;
        let (near, far) = (s.splat(9.0 / 16.0), s.splat(1.0 / 16.0));
        for plane in self.planes {
            // Along x, then along y: distances in memory of one node.
            for (step, across, down) in [(1, 3..width.max(6) - 3, 0..rows), (width, 0..width, 3..rows.max(6) - 3)] {
                for y in down.clone() {
                    let span = &self.spans[y];
                    let across = across.start.max(span.start)..across.end.min(span.end);
                    if across.is_empty() {
                        continue;
                    }
                    let mut x = across.start;
                    while x < across.end {
                        // The last vector overlaps the one before it; short rows are filled up.
                        let at = if across.len() >= S::LANES { x.min(across.end - S::LANES) } else { x };
                        let first = y * width + at;
                        let load = |offset: isize| {
                            let from = first.wrapping_add_signed(offset * step as isize);
                            let mut lanes = [0.0f32; 16];
                            let count = S::LANES.min(across.end - at);
                            if count == S::LANES {
                                return s.load(&plane[from..]);
                            }
                            lanes[..count].copy_from_slice(&plane[from..from + count]);
                            s.load(&lanes)
                        };
                        let inner = s.mul(s.add(load(-1), load(1)), near);
                        let expected = s.neg_mul_add(s.add(load(-3), load(3)), far, inner);
                        let off = s.sub(load(0), expected);
                        let mut lanes = [0.0f32; 16];
                        s.store(s.max(off, s.sub(s.splat(0.0), off)), &mut lanes);
                        for (out, &lane) in self.out[first..].iter_mut().zip(&lanes[..S::LANES.min(across.end - at)]) {
                            *out = out.max(lane);
                        }
                        x += S::LANES;
                    }
                }
            }
        }
    }
}
