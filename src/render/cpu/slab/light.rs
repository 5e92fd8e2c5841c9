//! What a block's own slabs shine: composited unit by unit, extrapolated on the way.
//!
//! Four slabs, the first begun with the transmittance T0 and each left with Ti, hold the optical depths Di and Di times the
//! colours, Ci. Taken one by one, by two and all together they shine sum (T(i-1) - Ti) Ci / Di, and so on. The extrapolation
//! (4 L_K - L_K/2) / 3 and what it differs from that of half as many slabs are sums of Ci too, with weights that do not depend
//! on the colour.

use super::composite::{Slot, share, size};
use crate::render::cpu::simd::{Simd, exp2_neg};
use crate::scene::Rgb;

/// Most colours that are kept apart.
pub const FEW: usize = 4;

/// What is composited so far.
pub struct Light<F, const R: usize> {
    /// Optical depth in powers of two, and the transmittance.
    depth: [F; R],
    pub through: [F; R],
    /// Of the tile's few colours how much is seen, or else channels in the last three.
    seen: [[F; 4]; R],
    /// By how much `seen` differs from what half as many slabs would give.
    off: [[F; 4]; R],
    /// By how much half as many slabs differ from a quarter, without extrapolation.
    rough: [[F; 4]; R],
}

// Rows of many arrays at once.
#[allow(clippy::needless_range_loop)]
impl<F: Copy, const R: usize> Light<F, R> {
    /// Before anything is composited.
    #[inline(always)]
    pub fn new<S: Simd<F = F>>(s: S) -> Self {
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let none = [[zero; 4]; R];
        Self { depth: [zero; R], through: [one; R], seen: none, off: none, rough: none }
    }

    /// Composites a slab of one colour, which has number `plane` if the tile has few, and empties it.
    #[inline(always)]
    pub fn alone<S: Simd<F = F>>(&mut self, s: S, slot: &mut Slot<F, R>, few: bool, plane: usize, color: &Rgb) {
        for r in 0..R {
            let plane = if few { plane & (FEW - 1) } else { 0 };
            self.depth[r] = s.add(self.depth[r], slot[r][plane]);
            let after = exp2_neg(s, self.depth[r]);
            let gone = s.sub(self.through[r], after);
            self.through[r] = after;
            if few {
                self.seen[r][plane] = s.add(self.seen[r][plane], gone);
            } else {
                for (seen, &value) in self.seen[r][1..].iter_mut().zip(color) {
                    *seen = s.mul_add(gone, s.splat(value), *seen);
                }
            }
        }
        *slot = [[s.splat(0.0); 4]; R];
    }

    /// Composites a slab in which all mixes, and empties it.
    #[inline(always)]
    pub fn whole<S: Simd<F = F>>(&mut self, s: S, slot: &mut Slot<F, R>, few: bool) {
        for r in 0..R {
            let depth = total(s, &slot[r], few);
            self.depth[r] = s.add(self.depth[r], depth);
            let after = exp2_neg(s, self.depth[r]);
            let share = share(s, self.through[r], after, depth);
            self.through[r] = after;
            for (seen, &content) in self.seen[r].iter_mut().zip(&slot[r]) {
                *seen = s.mul_add(share, content, *seen);
            }
        }
        *slot = [[s.splat(0.0); 4]; R];
    }

    /// Composites four slabs and empties them.
    #[inline(always)]
    pub fn four<S: Simd<F = F>>(&mut self, s: S, slots: &mut [Slot<F, R>; 4], few: bool) {
        let third = s.splat(1.0 / 3.0);
        for r in 0..R {
            let mut depths = [self.depth[r]; 4];
            for (depth, slot) in depths.iter_mut().zip(&*slots) {
                *depth = total(s, &slot[r], few);
            }
            let mut through = [self.through[r]; 5];
            for i in 0..4 {
                self.depth[r] = s.add(self.depth[r], depths[i]);
                through[i + 1] = exp2_neg(s, self.depth[r]);
            }
            self.through[r] = through[4];
            let pairs = [s.add(depths[0], depths[1]), s.add(depths[2], depths[3])];
            let two = [share(s, through[0], through[2], pairs[0]), share(s, through[2], through[4], pairs[1])];
            let all = share(s, through[0], through[4], s.add(pairs[0], pairs[1]));
            let (mut seen, mut off) = (self.seen[r], self.off[r]);
            let steps = [s.sub(two[0], all), s.sub(two[1], all)];
            for i in 0..4 {
                let one = share(s, through[i], through[i + 1], depths[i]);
                let two = two[i / 2];
                let fine = s.mul_add(s.sub(one, two), third, one);
                let coarse = s.mul_add(steps[i / 2], third, two);
                let step = s.sub(fine, coarse);
                for k in 0..4 {
                    seen[k] = s.mul_add(slots[i][r][k], fine, seen[k]);
                    off[k] = s.mul_add(slots[i][r][k], step, off[k]);
                }
            }
            for k in 0..4 {
                let pairs = [s.add(slots[0][r][k], slots[1][r][k]), s.add(slots[2][r][k], slots[3][r][k])];
                self.rough[r][k] = s.mul_add(pairs[0], steps[0], s.mul_add(pairs[1], steps[1], self.rough[r][k]));
            }
            self.seen[r] = seen;
            self.off[r] = off;
        }
        *slots = [[[s.splat(0.0); 4]; R]; 4];
    }

    /// The least optical depth of a ray, in powers of two, with what slabs hold; or the number of the slab with which it is
    /// `enough`, if it is.
    #[inline(always)]
    pub fn least<S: Simd<F = F>>(&self, s: S, slots: &[Slot<F, R>], few: bool, enough: f32) -> Result<usize, f32> {
        let mut depth = self.depth;
        let mut least = depth[0];
        for &depth in &depth[1..] {
            least = s.min(least, depth);
        }
        let mut most = s.reduce_min(least);
        for (number, slot) in slots.iter().enumerate() {
            let mut least = s.splat(f32::INFINITY);
            for (depth, row) in depth.iter_mut().zip(slot) {
                *depth = s.add(*depth, total(s, row, few));
                least = s.min(least, *depth);
            }
            most = s.reduce_min(least);
            if most >= enough {
                return Ok(number);
            }
        }
        Err(most)
    }

    /// The light, the estimate of what it is off, and the largest difference of half as many slabs from a quarter; `palette`: the
    /// tile's colours, if they are few.
    #[inline(always)]
    pub fn finish<S: Simd<F = F>>(&self, s: S, palette: Option<&[Rgb; FEW]>) -> ([[F; 3]; R], [f32; 2]) {
        let zero = s.splat(0.0);
        let mut light = [[zero; 3]; R];
        let (mut worst, mut roughest) = (zero, zero);
        for r in 0..R {
            let (off, rough) = (rgb(s, palette, &self.off[r]), rgb(s, palette, &self.rough[r]));
            light[r] = rgb(s, palette, &self.seen[r]);
            for (off, rough) in off.into_iter().zip(rough) {
                worst = s.max(worst, size(s, off));
                roughest = s.max(roughest, size(s, rough));
            }
        }
        // Of the extrapolations from K and K/2 the second order has gone: a quarter of their difference would be left if
        // nothing were smooth, a sixteenth if everything is.
        (light, [s.reduce_max(worst) / 15.0, s.reduce_max(roughest)])
    }
}

/// Optical depth of a row of a slab.
#[inline(always)]
fn total<S: Simd>(s: S, row: &[S::F; 4], few: bool) -> S::F {
    if few { s.add(s.add(row[0], row[1]), s.add(row[2], row[3])) } else { row[0] }
}

/// Channels of what is seen.
#[inline(always)]
fn rgb<S: Simd>(s: S, palette: Option<&[Rgb; FEW]>, seen: &[S::F; 4]) -> [S::F; 3] {
    let Some(palette) = palette else {
        return [seen[1], seen[2], seen[3]];
    };
    let mut light = [s.splat(0.0); 3];
    for (&seen, color) in seen.iter().zip(palette) {
        for (light, &value) in light.iter_mut().zip(color) {
            *light = s.mul_add(seen, s.splat(value), *light);
        }
    }
    light
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::simd::{Level, WithSimd, dispatch};

    const PALETTE: [Rgb; FEW] = [[1.0, 0.1, 0.0], [0.0, 0.7, 0.3], [0.2, 0.0, 0.9], [0.5, 0.5, 0.5]];

    /// Composites slabs in which `depth(slab, colour, lane)` is what the first row holds.
    struct Composite<'a>(&'a dyn Fn(usize, usize, usize) -> f32, usize);

    impl WithSimd for Composite<'_> {
        /// Light of every lane, what is let through, and the estimates.
        type Output = (Vec<[f32; 4]>, [f32; 2]);

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Self::Output {
            let Self(depth, fours) = self;
            let mut light = Light::<S::F, 1>::new(s);
            for four in 0..fours {
                let mut slots = [[[s.splat(0.0); 4]; 1]; 4];
                for (i, slot) in slots.iter_mut().enumerate() {
                    for (color, content) in slot[0].iter_mut().enumerate() {
                        let mut lanes = [0.0; 16];
                        for (lane, value) in lanes.iter_mut().enumerate() {
                            *value = depth(4 * four + i, color, lane);
                        }
                        *content = s.load(&lanes);
                    }
                }
                light.four(s, &mut slots, true);
                let mut empty = [1.0; 16];
                s.store(slots[0][0][0], &mut empty);
                assert_eq!(empty[0], 0.0, "slabs are emptied");
            }
            let (color, [off, rough]) = light.finish(s, Some(&PALETTE));
            let mut lanes = [[0.0; 16]; 4];
            for (lanes, value) in lanes.iter_mut().zip([color[0][0], color[0][1], color[0][2], light.through[0]]) {
                s.store(value, lanes);
            }
            ((0..S::LANES).map(|lane| [0, 1, 2, 3].map(|i| lanes[i][lane])).collect(), [off, rough])
        }
    }

    /// Light of slabs in powers of two, taken by so many at once, in f64.
    fn exact(slabs: &[[f64; FEW]], at_once: usize) -> [f64; 4] {
        let (mut sum, mut light) = (0.0f64, [0.0; 4]);
        for slabs in slabs.chunks(at_once) {
            let total: f64 = slabs.iter().flatten().sum();
            let share = ((-sum).exp2() - (-sum - total).exp2()) / total.max(1e-300);
            for (number, &color) in PALETTE.iter().enumerate() {
                let depth: f64 = slabs.iter().map(|slab| slab[number]).sum();
                for (light, value) in light.iter_mut().zip(color) {
                    *light += share * depth * f64::from(value);
                }
            }
            sum += total;
        }
        light[3] = (-sum).exp2();
        light
    }

    #[test]
    fn four_slabs_at_once_are_the_extrapolation() {
        let depth = |slab: usize, color: usize, lane: usize| {
            let x = (slab * 7 + color * 3 + lane * 5) % 11;
            // Some slabs are empty, and some hold next to nothing.
            if slab % 5 == 3 { 0.0 } else { [0.02, 1e-8, 0.3][lane % 3] * x as f32 }
        };
        for level in Level::available() {
            let (lanes, [off, rough]) = dispatch(level, Composite(&depth, 3));
            let (mut worst, mut roughest) = (0.0f64, 0.0f64);
            for (lane, found) in lanes.iter().enumerate() {
                let slabs: Vec<[f64; FEW]> =
                    (0..12).map(|slab| [0, 1, 2, 3].map(|color| f64::from(depth(slab, color, lane)))).collect();
                let [full, half, quarter] = [1, 2, 4].map(|at_once| exact(&slabs, at_once));
                for channel in 0..4 {
                    let fine = (4.0 * full[channel] - half[channel]) / 3.0;
                    let coarse = (4.0 * half[channel] - quarter[channel]) / 3.0;
                    worst = worst.max((fine - coarse).abs() / 15.0);
                    roughest = roughest.max((half[channel] - quarter[channel]).abs());
                    let error = (f64::from(found[channel]) - fine).abs();
                    assert!(error < 2e-6, "{level}: lane {lane}, channel {channel}: {} for {fine}", found[channel]);
                }
            }
            assert!((f64::from(off) - worst).abs() < 1e-6 && worst > 1e-4, "{level}: {off} for {worst}");
            assert!((f64::from(rough) - roughest).abs() < 1e-6 && roughest > 1e-4, "{level}: {rough} for {roughest}");
        }
    }
}
