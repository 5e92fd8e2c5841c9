//! What slabs hold, and how it is composited.

use super::block::Tile;
use crate::render::cpu::simd::{Simd, exp2_neg};

/// What a slab holds of a block: per row the optical depth in powers of two and that times the colour, or the optical
/// depth of each of up to four colours.
pub type Slot<F, const R: usize> = [[F; 4]; R];

/// What composites a block so far.
pub struct Sums<F, const R: usize> {
    /// Optical depth in powers of two, and the transmittance.
    pub depth: [F; R],
    pub through: [F; R],
    /// Light of L_K, L_K/2 and L_K/4.
    pub light: [[[F; 3]; R]; 3],
    /// Transmittance where the open merged slabs begin, for L_K/2 and L_K/4.
    pub begin: [[F; R]; 2],
}

// Rows of many arrays at once.
#[allow(clippy::needless_range_loop)]
impl<F: Copy, const R: usize> Sums<F, R> {
    /// Before anything is composited.
    #[inline(always)]
    pub fn new<S: Simd<F = F>>(s: S) -> Self {
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        Self { depth: [zero; R], through: [one; R], light: [[[zero; 3]; R]; 3], begin: [[one; R]; 2] }
    }

    /// The light extrapolated from the slabs and half of them, (4 L_K - L_K/2) / 3, and the estimate of what that is off.
    #[inline(always)]
    pub fn extrapolated<S: Simd<F = F>>(&self, s: S) -> ([[F; 3]; R], [F; R]) {
        let third = s.splat(1.0 / 3.0);
        let (mut light, mut off) = (self.light[0], self.depth);
        for r in 0..R {
            off[r] = s.splat(0.0);
            for channel in 0..3 {
                let [full, half, quarter] = [0, 1, 2].map(|level| self.light[level][r][channel]);
                let fine = s.mul_add(s.sub(full, half), third, full);
                let coarse = s.mul_add(s.sub(half, quarter), third, half);
                light[r][channel] = fine;
                // Of the extrapolations from K and K/2 the second order has gone: a quarter of their difference would be left
                // if nothing were smooth, a sixteenth if everything is.
                off[r] = s.max(off[r], size(s, s.mul(s.sub(fine, coarse), s.splat(1.0 / 15.0))));
            }
        }
        (light, off)
    }

    /// By how much the extrapolation differs from the light.
    #[inline(always)]
    pub fn step<S: Simd<F = F>>(&self, s: S) -> [F; R] {
        let mut off = self.depth;
        for r in 0..R {
            off[r] = s.splat(0.0);
            for channel in 0..3 {
                let [full, half] = [0, 1].map(|level| self.light[level][r][channel]);
                off[r] = s.max(off[r], size(s, s.mul(s.sub(full, half), s.splat(1.0 / 3.0))));
            }
        }
        off
    }
}

/// Without the sign.
#[inline(always)]
pub fn size<S: Simd>(s: S, a: S::F) -> S::F {
    s.max(a, s.sub(s.splat(0.0), a))
}

/// The number of the slab, among those not yet composited, behind which nothing is seen, by what they hold so far: more can
/// only come.
#[inline(always)]
pub fn last_seen<S: Simd, const R: usize>(
    s: S,
    tile: &Tile,
    slots: &[Slot<S::F, R>],
    sums: &Sums<S::F, R>,
) -> Option<usize> {
    let colors = tile.palette.map_or(1, |(_, colors)| colors);
    let enough = -tile.stop.log2();
    let mut depth = sums.depth;
    // Not even the first, if what is before it is enough already.
    slots.iter().position(|slot| {
        let mut least = s.splat(f32::INFINITY);
        for (depth, row) in depth.iter_mut().zip(slot) {
            for &content in &row[..colors] {
                *depth = s.add(*depth, content);
            }
            least = s.min(least, *depth);
        }
        s.reduce_min(least) >= enough
    })
}

/// Composites slabs, the first of which has number `first`, front to back, and empties them. With `merge`, `first` is a
/// multiple of 4.
#[inline(always)]
pub fn composite<S: Simd, const R: usize>(
    s: S,
    tile: &Tile,
    merge: bool,
    slots: &mut [Slot<S::F, R>],
    first: usize,
    sums: &mut Sums<S::F, R>,
) {
    debug_assert!(!merge || first.is_multiple_of(4));
    let zero = s.splat(0.0);
    let count = slots.len();
    // Optical depth and colour of the open merged slabs.
    let mut open = [[[zero; 4]; R]; 2];
    for (i, slot) in slots.iter_mut().enumerate() {
        for r in 0..R {
            let mut content = slot[r];
            if let Some((palette, colors)) = &tile.palette {
                content = [zero; 4];
                for (&depth, color) in slot[r].iter().zip(&palette[..*colors]) {
                    content[0] = s.add(content[0], depth);
                    for (sum, &value) in content[1..].iter_mut().zip(color) {
                        *sum = s.mul_add(depth, s.splat(value), *sum);
                    }
                }
            }
            sums.depth[r] = s.add(sums.depth[r], content[0]);
            let before = sums.through[r];
            let after = exp2_neg(s, sums.depth[r]);
            sums.through[r] = after;
            emit(s, &content, before, after, &mut sums.light[0][r]);
            if merge {
                for (level, open) in open.iter_mut().enumerate() {
                    for (sum, &value) in open[r].iter_mut().zip(&content) {
                        *sum = s.add(*sum, value);
                    }
                    if (i + 1).is_multiple_of(2 << level) || i + 1 == count {
                        emit(s, &open[r], sums.begin[level][r], after, &mut sums.light[level + 1][r]);
                        sums.begin[level][r] = after;
                        open[r] = [zero; 4];
                    }
                }
            }
        }
        *slot = [[zero; 4]; R];
    }
}

/// What is lost of the light over an optical depth, per unit of that. Next to nothing, or a hair less than nothing where all
/// there is is rounding, has no reliable colour, but for rounding no light either.
#[inline(always)]
pub fn share<S: Simd>(s: S, before: S::F, after: S::F, depth: S::F) -> S::F {
    let least = s.splat(1e-12);
    s.keep(s.less(least, depth), s.div(s.sub(before, after), s.max(depth, least)))
}

/// Adds the light of a slab between two transmittances: their difference times the slab's mean colour. Differences of
/// transmittances add up to that of the whole, however many slabs there are.
#[inline(always)]
fn emit<S: Simd>(s: S, content: &[S::F; 4], before: S::F, after: S::F, light: &mut [S::F; 3]) {
    let share = share(s, before, after, content[0]);
    for (light, &value) in light.iter_mut().zip(&content[1..]) {
        *light = s.mul_add(share, value, *light);
    }
}
