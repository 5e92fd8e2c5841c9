//! SSE2, AVX2 + FMA and AVX-512 by intrinsics.
//!
//! Why `unsafe` is sound here: a value of `Sse2`, `Avx2` or `Avx512` exists only inside [`super::dispatch`]'s functions,
//! behind a check that the machine has the instructions (SSE2 is part of x86-64). Loads and stores go through slices that
//! are cut to the vector's length first; gathers clamp their indices into the table.
#![allow(unsafe_code)]

use super::{Simd, TINY, WithSimd};
use std::arch::x86_64::*;

/// Proof of SSE2. The field keeps others from making one.
#[derive(Clone, Copy)]
pub struct Sse2(());
/// Proof of AVX2 and FMA.
#[derive(Clone, Copy)]
pub struct Avx2(());
/// Proof of AVX-512 F, VL, DQ and BW, and of AVX2 and FMA.
#[derive(Clone, Copy)]
pub struct Avx512(());

/// SSE2 needs no proof on x86-64.
pub fn sse2() -> Sse2 {
    Sse2(())
}

/// Runs a job compiled with AVX2 and FMA.
///
/// # Safety
/// The machine must have them.
pub unsafe fn run_avx2<W: WithSimd>(job: W) -> W::Output {
    #[target_feature(enable = "avx2,fma")]
    unsafe fn inner<W: WithSimd>(job: W) -> W::Output {
        job.with_simd(Avx2(()))
    }
    // SAFETY: the caller vouches for the instructions.
    unsafe { inner(job) }
}

/// Runs a job compiled with AVX-512.
///
/// # Safety
/// The machine must have F, VL, DQ and BW of it, and AVX2 and FMA.
pub unsafe fn run_avx512<W: WithSimd>(job: W) -> W::Output {
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
    unsafe fn inner<W: WithSimd>(job: W) -> W::Output {
        job.with_simd(Avx512(()))
    }
    // SAFETY: the caller vouches for the instructions.
    unsafe { inner(job) }
}

/// Methods that are one intrinsic each.
macro_rules! plain {
    ($($name:ident($($arg:ident),*) = $intrinsic:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, $($arg: Self::F),*) -> Self::F {
            // SAFETY: `self` proves the instruction.
            unsafe { $intrinsic($($arg),*) }
        }
    )*};
}

impl Simd for Sse2 {
    const LANES: usize = 4;
    type F = __m128;
    type M = __m128;
    type W = __m128i;

    plain! {
        add(a, b) = _mm_add_ps; sub(a, b) = _mm_sub_ps; mul(a, b) = _mm_mul_ps; div(a, b) = _mm_div_ps;
        min(a, b) = _mm_min_ps; max(a, b) = _mm_max_ps; sqrt(a) = _mm_sqrt_ps;
    }

    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        // SAFETY: `self` proves SSE2, here and below.
        unsafe { _mm_set1_ps(v) }
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> Self::F {
        // SAFETY: the slice is cut to 4 values; unaligned load.
        unsafe { _mm_loadu_ps(from[..4].as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32]) {
        // SAFETY: the slice is cut to 4 values; unaligned store.
        unsafe { _mm_storeu_ps(to[..4].as_mut_ptr(), v) }
    }
    #[inline(always)]
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        self.add(self.mul(a, b), c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        self.sub(c, self.mul(a, b))
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
        // SAFETY: as above. The default rounding mode is nearest, ties to even.
        unsafe { _mm_cvtepi32_ps(_mm_cvtps_epi32(a)) }
    }
    #[inline(always)]
    fn power_of_two(self, n: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm_castsi128_ps(_mm_slli_epi32::<23>(_mm_add_epi32(_mm_cvtps_epi32(n), _mm_set1_epi32(127)))) }
    }
    #[inline(always)]
    fn exponent(self, a: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm_cvtepi32_ps(_mm_sub_epi32(_mm_srli_epi32::<23>(_mm_castps_si128(a)), _mm_set1_epi32(127))) }
    }
    #[inline(always)]
    fn less(self, a: Self::F, b: Self::F) -> Self::M {
        // SAFETY: as above.
        unsafe { _mm_cmplt_ps(a, b) }
    }
    #[inline(always)]
    fn and(self, a: Self::M, b: Self::M) -> Self::M {
        // SAFETY: as above.
        unsafe { _mm_and_ps(a, b) }
    }
    #[inline(always)]
    fn any(self, mask: Self::M) -> bool {
        // SAFETY: as above.
        unsafe { _mm_movemask_ps(mask) != 0 }
    }
    #[inline(always)]
    fn keep(self, mask: Self::M, v: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm_and_ps(mask, v) }
    }
    #[inline(always)]
    fn reduce_max(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe {
            let b = _mm_max_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_max_ss(b, _mm_shuffle_ps::<1>(b, b)))
        }
    }
    #[inline(always)]
    fn reduce_min(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe {
            let b = _mm_min_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_min_ss(b, _mm_shuffle_ps::<1>(b, b)))
        }
    }
    #[inline(always)]
    fn lookup(self, table: &[f32], index: Self::F) -> Self::F {
        let mut lanes = [0.0f32; 4];
        self.store(index, &mut lanes);
        let [a, b, c, d] = lanes.map(|i| table[i as usize]);
        // SAFETY: as above.
        unsafe { _mm_setr_ps(a, b, c, d) }
    }
    #[inline(always)]
    fn store_rgba8(self, [r, g, b]: [Self::F; 3], to: &mut [[u8; 4]]) {
        // SAFETY: the slice is cut to 4 pixels of 4 bytes; unaligned store.
        unsafe {
            let green = _mm_slli_epi32::<8>(_mm_cvtps_epi32(g));
            let blue = _mm_slli_epi32::<16>(_mm_cvtps_epi32(b));
            let red = _mm_or_si128(_mm_cvtps_epi32(r), _mm_set1_epi32(0xff << 24));
            _mm_storeu_si128(to[..4].as_mut_ptr().cast(), _mm_or_si128(red, _mm_or_si128(green, blue)));
        }
    }
    #[inline(always)]
    fn ramp(self) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm_setr_ps(0.0, 1.0, 2.0, 3.0) }
    }
    #[inline(always)]
    fn words(self, a: Self::F, b: Self::F) -> Self::W {
        // SAFETY: as above. Four of a and four of b in turns: as they are unpacked below.
        unsafe { _mm_packs_epi32(_mm_cvtps_epi32(a), _mm_cvtps_epi32(b)) }
    }
    #[inline(always)]
    fn splat_word(self, v: i16) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm_set1_epi16(v) }
    }
    #[inline(always)]
    fn add_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm_add_epi16(a, b) }
    }
    #[inline(always)]
    fn sub_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm_sub_epi16(a, b) }
    }
    #[inline(always)]
    fn mul_words(self, a: Self::W, b: Self::W) -> Self::W {
        // A product over 2^16, rounded down, twice, and half of what is lost. The sum does not saturate; of a shift the compiler would
        // make six instructions.
        // SAFETY: as above.
        unsafe {
            let half = _mm_mulhi_epi16(a, b);
            _mm_or_si128(_mm_adds_epi16(half, half), _mm_set1_epi16(1))
        }
    }
    #[inline(always)]
    fn store_words(self, [r, g, b]: [Self::W; 3], to: &mut [[u8; 4]]) {
        // SAFETY: the slice is cut to 8 pixels of 4 bytes; unaligned stores.
        unsafe {
            let green = _mm_and_si128(g, _mm_set1_epi16(0xff00_u16 as i16));
            let low = _mm_or_si128(_mm_srli_epi16::<8>(r), green);
            let high = _mm_or_si128(_mm_srli_epi16::<8>(b), _mm_set1_epi16(0xff00_u16 as i16));
            let (first, second) = to[..8].split_at_mut(4);
            _mm_storeu_si128(first.as_mut_ptr().cast(), _mm_unpacklo_epi16(low, high));
            _mm_storeu_si128(second.as_mut_ptr().cast(), _mm_unpackhi_epi16(low, high));
        }
    }
}

impl Simd for Avx2 {
    const LANES: usize = 8;
    type F = __m256;
    type M = __m256;
    type W = __m256i;

    plain! {
        add(a, b) = _mm256_add_ps; sub(a, b) = _mm256_sub_ps; mul(a, b) = _mm256_mul_ps; div(a, b) = _mm256_div_ps;
        min(a, b) = _mm256_min_ps; max(a, b) = _mm256_max_ps; sqrt(a) = _mm256_sqrt_ps;
        mul_add(a, b, c) = _mm256_fmadd_ps; neg_mul_add(a, b, c) = _mm256_fnmadd_ps;
    }

    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        // SAFETY: `self` proves AVX2 and FMA, here and below.
        unsafe { _mm256_set1_ps(v) }
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> Self::F {
        // SAFETY: the slice is cut to 8 values; unaligned load.
        unsafe { _mm256_loadu_ps(from[..8].as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32]) {
        // SAFETY: the slice is cut to 8 values; unaligned store.
        unsafe { _mm256_storeu_ps(to[..8].as_mut_ptr(), v) }
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
        // SAFETY: as above.
        unsafe { _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a) }
    }
    #[inline(always)]
    fn power_of_two(self, n: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe {
            let biased = _mm256_add_epi32(_mm256_cvtps_epi32(n), _mm256_set1_epi32(127));
            _mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased))
        }
    }
    #[inline(always)]
    fn exponent(self, a: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe {
            let biased = _mm256_srli_epi32::<23>(_mm256_castps_si256(a));
            _mm256_cvtepi32_ps(_mm256_sub_epi32(biased, _mm256_set1_epi32(127)))
        }
    }
    #[inline(always)]
    fn less(self, a: Self::F, b: Self::F) -> Self::M {
        // SAFETY: as above.
        unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn and(self, a: Self::M, b: Self::M) -> Self::M {
        // SAFETY: as above.
        unsafe { _mm256_and_ps(a, b) }
    }
    #[inline(always)]
    fn any(self, mask: Self::M) -> bool {
        // SAFETY: as above.
        unsafe { _mm256_movemask_ps(mask) != 0 }
    }
    #[inline(always)]
    fn keep(self, mask: Self::M, v: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm256_and_ps(mask, v) }
    }
    #[inline(always)]
    fn reduce_max(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe { Sse2(()).reduce_max(_mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a))) }
    }
    #[inline(always)]
    fn reduce_min(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe { Sse2(()).reduce_min(_mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a))) }
    }
    #[inline(always)]
    fn lookup(self, table: &[f32], index: Self::F) -> Self::F {
        assert!(!table.is_empty() && table.len() < i32::MAX as usize);
        // SAFETY: as above; indices are clamped into the table, which is not empty.
        unsafe {
            let last = _mm256_set1_epi32(table.len() as i32 - 1);
            let i = _mm256_min_epu32(_mm256_cvttps_epi32(index), last);
            _mm256_i32gather_ps::<4>(table.as_ptr(), i)
        }
    }
    #[inline(always)]
    fn store_rgba8(self, [r, g, b]: [Self::F; 3], to: &mut [[u8; 4]]) {
        // SAFETY: the slice is cut to 8 pixels of 4 bytes; unaligned store.
        unsafe {
            let green = _mm256_slli_epi32::<8>(_mm256_cvtps_epi32(g));
            let blue = _mm256_slli_epi32::<16>(_mm256_cvtps_epi32(b));
            let red = _mm256_or_si256(_mm256_cvtps_epi32(r), _mm256_set1_epi32(0xff << 24));
            _mm256_storeu_si256(to[..8].as_mut_ptr().cast(), _mm256_or_si256(red, _mm256_or_si256(green, blue)));
        }
    }
    #[inline(always)]
    fn ramp(self) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0) }
    }
    #[inline(always)]
    fn words(self, a: Self::F, b: Self::F) -> Self::W {
        // SAFETY: as above. Four of a and four of b in turns: as they are unpacked below.
        unsafe { _mm256_packs_epi32(_mm256_cvtps_epi32(a), _mm256_cvtps_epi32(b)) }
    }
    #[inline(always)]
    fn splat_word(self, v: i16) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm256_set1_epi16(v) }
    }
    #[inline(always)]
    fn add_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm256_add_epi16(a, b) }
    }
    #[inline(always)]
    fn sub_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm256_sub_epi16(a, b) }
    }
    #[inline(always)]
    fn mul_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm256_mulhrs_epi16(a, b) }
    }
    #[inline(always)]
    fn store_words(self, [r, g, b]: [Self::W; 3], to: &mut [[u8; 4]]) {
        // SAFETY: the slice is cut to 16 pixels of 4 bytes; unaligned stores.
        unsafe {
            let green = _mm256_and_si256(g, _mm256_set1_epi16(0xff00_u16 as i16));
            let low = _mm256_or_si256(_mm256_srli_epi16::<8>(r), green);
            let high = _mm256_or_si256(_mm256_srli_epi16::<8>(b), _mm256_set1_epi16(0xff00_u16 as i16));
            let (first, second) = to[..16].split_at_mut(8);
            _mm256_storeu_si256(first.as_mut_ptr().cast(), _mm256_unpacklo_epi16(low, high));
            _mm256_storeu_si256(second.as_mut_ptr().cast(), _mm256_unpackhi_epi16(low, high));
        }
    }
}

impl Simd for Avx512 {
    const LANES: usize = 16;
    type F = __m512;
    type M = __mmask16;
    type W = __m512i;

    plain! {
        add(a, b) = _mm512_add_ps; sub(a, b) = _mm512_sub_ps; mul(a, b) = _mm512_mul_ps; div(a, b) = _mm512_div_ps;
        min(a, b) = _mm512_min_ps; max(a, b) = _mm512_max_ps; sqrt(a) = _mm512_sqrt_ps;
        mul_add(a, b, c) = _mm512_fmadd_ps; neg_mul_add(a, b, c) = _mm512_fnmadd_ps;
    }

    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        // SAFETY: `self` proves AVX-512, here and below.
        unsafe { _mm512_set1_ps(v) }
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> Self::F {
        // SAFETY: the slice is cut to 16 values; unaligned load.
        unsafe { _mm512_loadu_ps(from[..16].as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32]) {
        // SAFETY: the slice is cut to 16 values; unaligned store.
        unsafe { _mm512_storeu_ps(to[..16].as_mut_ptr(), v) }
    }
    #[inline(always)]
    fn sqrt_fast(self, a: Self::F) -> Self::F {
        // A square root of 16 lanes keeps a pipe for 10 cycles and more; the estimate (relative error 2^-14) for 2.
        // SAFETY: as above.
        self.mul(a, unsafe { _mm512_rsqrt14_ps(a) })
    }
    #[inline(always)]
    fn sqrt_near(self, a: Self::F) -> Self::F {
        let a = self.max(a, self.splat(TINY));
        // SAFETY: as above.
        let inverse = unsafe { _mm512_rsqrt14_ps(a) };
        // Newton's step for the root, with the estimate of its inverse.
        let root = self.mul(a, inverse);
        let rest = self.neg_mul_add(root, root, a);
        self.mul_add(rest, self.mul(inverse, self.splat(0.5)), root)
    }
    #[inline(always)]
    fn round(self, a: Self::F) -> Self::F {
        // SAFETY: as above. Scale 0 in the upper bits: round to whole numbers.
        unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a) }
    }
    #[inline(always)]
    fn power_of_two(self, n: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm512_scalef_ps(_mm512_set1_ps(1.0), n) }
    }
    #[inline(always)]
    fn exponent(self, a: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm512_getexp_ps(a) }
    }
    #[inline(always)]
    fn less(self, a: Self::F, b: Self::F) -> Self::M {
        // SAFETY: as above.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn and(self, a: Self::M, b: Self::M) -> Self::M {
        a & b
    }
    #[inline(always)]
    fn any(self, mask: Self::M) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn keep(self, mask: Self::M, v: Self::F) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm512_maskz_mov_ps(mask, v) }
    }
    #[inline(always)]
    fn reduce_max(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe { _mm512_reduce_max_ps(a) }
    }
    #[inline(always)]
    fn reduce_min(self, a: Self::F) -> f32 {
        // SAFETY: as above.
        unsafe { _mm512_reduce_min_ps(a) }
    }
    #[inline(always)]
    fn lookup(self, table: &[f32], index: Self::F) -> Self::F {
        assert!(!table.is_empty() && table.len() < i32::MAX as usize);
        // SAFETY: as above; indices are clamped into the table, which is not empty.
        unsafe {
            let last = _mm512_set1_epi32(table.len() as i32 - 1);
            let i = _mm512_min_epu32(_mm512_cvttps_epi32(index), last);
            _mm512_i32gather_ps::<4>(i, table.as_ptr().cast())
        }
    }
    #[inline(always)]
    fn store_rgba8(self, [r, g, b]: [Self::F; 3], to: &mut [[u8; 4]]) {
        // SAFETY: the slice is cut to 16 pixels of 4 bytes; unaligned store.
        unsafe {
            let green = _mm512_slli_epi32::<8>(_mm512_cvtps_epi32(g));
            let blue = _mm512_slli_epi32::<16>(_mm512_cvtps_epi32(b));
            let red = _mm512_or_si512(_mm512_cvtps_epi32(r), _mm512_set1_epi32(0xff << 24));
            _mm512_storeu_si512(to[..16].as_mut_ptr().cast(), _mm512_or_si512(red, _mm512_or_si512(green, blue)));
        }
    }
    #[inline(always)]
    fn ramp(self) -> Self::F {
        // SAFETY: as above.
        unsafe { _mm512_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0) }
    }
    #[inline(always)]
    fn words(self, a: Self::F, b: Self::F) -> Self::W {
        // SAFETY: as above. Four of a and four of b in turns: as they are unpacked below.
        unsafe { _mm512_packs_epi32(_mm512_cvtps_epi32(a), _mm512_cvtps_epi32(b)) }
    }
    #[inline(always)]
    fn splat_word(self, v: i16) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm512_set1_epi16(v) }
    }
    #[inline(always)]
    fn add_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm512_add_epi16(a, b) }
    }
    #[inline(always)]
    fn sub_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm512_sub_epi16(a, b) }
    }
    #[inline(always)]
    fn mul_words(self, a: Self::W, b: Self::W) -> Self::W {
        // SAFETY: as above.
        unsafe { _mm512_mulhrs_epi16(a, b) }
    }
    #[inline(always)]
    fn store_words(self, [r, g, b]: [Self::W; 3], to: &mut [[u8; 4]]) {
        // The third operand chooses bits of the first, or else of the second.
        const CHOOSE: i32 = 0xe4;
        // SAFETY: the slice is cut to 32 pixels of 4 bytes; unaligned stores.
        unsafe {
            let upper = _mm512_set1_epi16(0xff00_u16 as i16);
            let low = _mm512_ternarylogic_epi32::<CHOOSE>(g, _mm512_srli_epi16::<8>(r), upper);
            let high = _mm512_or_si512(_mm512_srli_epi16::<8>(b), upper);
            let (first, second) = to[..32].split_at_mut(16);
            _mm512_storeu_si512(first.as_mut_ptr().cast(), _mm512_unpacklo_epi16(low, high));
            _mm512_storeu_si512(second.as_mut_ptr().cast(), _mm512_unpackhi_epi16(low, high));
        }
    }
}
