//! Four lanes without intrinsics, for architectures that have no level of their own.

use super::Simd;

/// Proof of nothing: arrays work everywhere.
#[derive(Clone, Copy)]
pub struct Portable;

#[inline(always)]
fn map2<T: Copy, U: Copy, R>(a: [T; 4], b: [U; 4], f: impl Fn(T, U) -> R) -> [R; 4] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])]
}

impl Simd for Portable {
    const LANES: usize = 4;
    type F = [f32; 4];
    type M = [bool; 4];
    type W = [i16; 8];

    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        [v; 4]
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> Self::F {
        [from[0], from[1], from[2], from[3]]
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32]) {
        to[..4].copy_from_slice(&v);
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        // Not f32::mul_add: without an FMA instruction that is a slow library call.
        self.add(self.mul(a, b), c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        self.sub(c, self.mul(a, b))
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        a.map(f32::sqrt)
    }
    #[inline(always)]
    fn sqrt_fast(self, a: Self::F) -> Self::F {
        self.sqrt(a)
    }
    #[inline(always)]
    fn sqrt_near(self, a: Self::F) -> Self::F {
        self.sqrt(a)
    }
    #[inline(always)]
    fn round(self, a: Self::F) -> Self::F {
        // Adding and subtracting 1.5 * 2^23 leaves the nearest integer.
        const MAGIC: f32 = 12_582_912.0;
        a.map(|v| (v + MAGIC) - MAGIC)
    }
    #[inline(always)]
    fn power_of_two(self, n: Self::F) -> Self::F {
        n.map(|v| f32::from_bits(((v as i32 + 127) as u32) << 23))
    }
    #[inline(always)]
    fn exponent(self, a: Self::F) -> Self::F {
        a.map(|v| ((v.to_bits() >> 23) as i32 - 127) as f32)
    }
    #[inline(always)]
    fn less(self, a: Self::F, b: Self::F) -> Self::M {
        map2(a, b, |a, b| a < b)
    }
    #[inline(always)]
    fn and(self, a: Self::M, b: Self::M) -> Self::M {
        map2(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn any(self, mask: Self::M) -> bool {
        mask[0] | mask[1] | mask[2] | mask[3]
    }
    #[inline(always)]
    fn keep(self, mask: Self::M, v: Self::F) -> Self::F {
        map2(mask, v, |m, v| if m { v } else { 0.0 })
    }
    #[inline(always)]
    fn reduce_max(self, a: Self::F) -> f32 {
        a[0].max(a[1]).max(a[2].max(a[3]))
    }
    #[inline(always)]
    fn reduce_min(self, a: Self::F) -> f32 {
        a[0].min(a[1]).min(a[2].min(a[3]))
    }
    #[inline(always)]
    fn lookup(self, table: &[f32], index: Self::F) -> Self::F {
        index.map(|i| table[i as usize])
    }
    #[inline(always)]
    fn store_rgba8(self, [r, g, b]: [Self::F; 3], to: &mut [[u8; 4]]) {
        let [r, g, b] = [self.round(r), self.round(g), self.round(b)];
        for (i, to) in to[..4].iter_mut().enumerate() {
            *to = [r[i] as u8, g[i] as u8, b[i] as u8, u8::MAX];
        }
    }
    #[inline(always)]
    fn ramp(self) -> Self::F {
        [0.0, 1.0, 2.0, 3.0]
    }
    #[inline(always)]
    fn words(self, a: Self::F, b: Self::F) -> Self::W {
        let ([a, b, c, d], [e, f, g, h]) = (self.round(a), self.round(b));
        // `as` ends at the last number within.
        [a, b, c, d, e, f, g, h].map(|v| v as i16)
    }
    #[inline(always)]
    fn splat_word(self, v: i16) -> Self::W {
        [v; 8]
    }
    #[inline(always)]
    fn add_words(self, a: Self::W, b: Self::W) -> Self::W {
        std::array::from_fn(|i| a[i].wrapping_add(b[i]))
    }
    #[inline(always)]
    fn sub_words(self, a: Self::W, b: Self::W) -> Self::W {
        std::array::from_fn(|i| a[i].wrapping_sub(b[i]))
    }
    #[inline(always)]
    fn mul_words(self, a: Self::W, b: Self::W) -> Self::W {
        std::array::from_fn(|i| ((i32::from(a[i]) * i32::from(b[i]) + (1 << 14)) >> 15) as i16)
    }
    #[inline(always)]
    fn store_words(self, [r, g, b]: [Self::W; 3], to: &mut [[u8; 4]]) {
        for (i, to) in to[..8].iter_mut().enumerate() {
            *to = [(r[i] >> 8) as u8, (g[i] >> 8) as u8, (b[i] >> 8) as u8, u8::MAX];
        }
    }
}
