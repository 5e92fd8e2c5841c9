//! Vectors of f32 over `core::arch`, with the instruction set chosen at run time.
//!
//! One portable binary carries every level; [`dispatch`] runs a [`WithSimd`] job compiled for the level asked. Everything
//! a job calls must be `#[inline(always)]`, so that it is compiled inside the function that enables the instructions. A
//! closure that is called more than once may not be inlined: then each of its instructions becomes a call.
//!
//! This folder is the only place of the CPU path with `unsafe`: intrinsics and the jump into functions compiled for
//! instructions that a check at run time has found.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;

/// A level of vector instructions, narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// No intrinsics, 4 lanes; every architecture.
    Portable,
    /// SSE2, 4 lanes; every x86-64.
    Sse2,
    /// AVX2 with FMA, 8 lanes.
    Avx2,
    /// AVX-512 F, VL, DQ and BW, 16 lanes.
    Avx512,
}

impl Level {
    /// Every level, narrowest first.
    pub const ALL: &[Self] = &[Self::Portable, Self::Sse2, Self::Avx2, Self::Avx512];

    /// The name that `--simd` uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Sse2 => "sse2",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// The level of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|level| level.name() == name)
    }

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Sse2 | Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// The levels this machine can run, narrowest first.
    pub fn available() -> Vec<Self> {
        Self::ALL.iter().copied().filter(|level| level.is_available()).collect()
    }

    /// The widest level this machine can run.
    pub fn best() -> Self {
        Self::ALL.iter().copied().rev().find(|level| level.is_available()).unwrap_or(Self::Portable)
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Vectors of [`Simd::LANES`] f32 and masks of as many lanes. The value itself is proof that the instructions exist.
pub trait Simd: Copy + Send + Sync + 'static {
    /// Lanes in a vector: 4, 8 or 16.
    const LANES: usize;
    /// A vector.
    type F: Copy + Send + Sync;
    /// A mask, one truth value per lane.
    type M: Copy;
    /// A vector of 2 x [`Simd::LANES`] whole numbers of 16 bits with a sign.
    type W: Copy + Send + Sync;

    /// All lanes `v`.
    fn splat(self, v: f32) -> Self::F;
    /// The first lanes of a slice; panics if it is shorter than a vector.
    fn load(self, from: &[f32]) -> Self::F;
    /// Writes the first lanes of a slice; panics if it is shorter than a vector.
    fn store(self, v: Self::F, to: &mut [f32]);
    /// a + b.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// a - b.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a / b.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b + c, fused where the level has it.
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// c - a b, fused where the level has it.
    fn neg_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The smaller one; b where a is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger one; b where a is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// Square root of a >= [`TINY`] with a relative error of at most 2^-13, as fast as the level can.
    fn sqrt_fast(self, a: Self::F) -> Self::F;
    /// Square root of a >= 0 with a relative error of at most 2^-22, as fast as the level can; at most 2e-15 for 0.
    fn sqrt_near(self, a: Self::F) -> Self::F;
    /// The nearest integer, ties to even; for |a| < 2^22.
    fn round(self, a: Self::F) -> Self::F;
    /// 2^n for integral n in [-126, 127].
    fn power_of_two(self, n: Self::F) -> Self::F;
    /// The whole n with 2^n <= a < 2^(n + 1), for normal a > 0.
    fn exponent(self, a: Self::F) -> Self::F;
    /// Lanes where a < b; false for NaN.
    fn less(self, a: Self::F, b: Self::F) -> Self::M;
    /// Lanes where both are true.
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    /// Whether any lane is true.
    fn any(self, mask: Self::M) -> bool;
    /// v where the mask is true, else 0.
    fn keep(self, mask: Self::M, v: Self::F) -> Self::F;
    /// The largest lane.
    fn reduce_max(self, a: Self::F) -> f32;
    /// The smallest lane.
    fn reduce_min(self, a: Self::F) -> f32;
    /// `table[index]` per lane, the index truncated to an integer; lanes out of range panic or read an entry of the
    /// table, never memory beyond it.
    fn lookup(self, table: &[f32], index: Self::F) -> Self::F;
    /// Writes red, green and blue, each in [0, 255.4], as the nearest whole numbers with an alpha of 255 to the first pixels of a
    /// slice; panics if it is shorter than a vector. What lies outside gives any colours.
    fn store_rgba8(self, rgb: [Self::F; 3], to: &mut [[u8; 4]]);
    /// The lane numbers 0, 1, 2, ...
    fn ramp(self) -> Self::F;
    /// The nearest whole numbers to the lanes of a and of b, whose sizes are below 2^31; those beyond 16 bits become the last
    /// within. Their order is the level's own, and undone by [`Simd::store_words`].
    fn words(self, a: Self::F, b: Self::F) -> Self::W;
    /// All numbers `v`.
    fn splat_word(self, v: i16) -> Self::W;
    /// a + b modulo 2^16.
    fn add_words(self, a: Self::W, b: Self::W) -> Self::W;
    /// a - b modulo 2^16.
    fn sub_words(self, a: Self::W, b: Self::W) -> Self::W;
    /// a b / 2^15, off by at most 1; not where both are -2^15.
    fn mul_words(self, a: Self::W, b: Self::W) -> Self::W;
    /// Writes the upper bytes of red, green and blue with an alpha of 255 to as many pixels: those of the first vector that was
    /// given to [`Simd::words`] and then those of the second. Panics if the slice is shorter.
    fn store_words(self, rgb: [Self::W; 3], to: &mut [[u8; 4]]);
}

/// What is as good as 0 under a root.
pub const TINY: f32 = 1e-30;

/// Coefficients of 2^f - 1 = f Q(f) on |f| <= 1/2, minimax in relative error: 4.4e-7.
// A fitted coefficient that comes out near ln 2 is not meant to be ln 2.
#[allow(clippy::approx_constant)]
const EXP2_M1: [f32; 5] = [0.693_147_1, 0.240_223_51, 0.055_505_004, 0.009_666_245, 0.001_333_354_2];

/// 2^-x for x >= 0, as pairs (scale, g) with 2^-x = scale (1 + g), |g| < 0.42, scale a power of two: so that 1 - 2^-x can
/// be formed without losing small x. Relative error 4.4e-7 of g; exponents below -126 become -126. Several vectors at a
/// time, so that each coefficient is loaded once for all.
#[inline(always)]
fn exp2_neg_parts<S: Simd, const R: usize>(s: S, x: [S::F; R]) -> ([S::F; R], [S::F; R]) {
    let (mut scale, mut f) = (x, x);
    for (scale, f) in scale.iter_mut().zip(&mut f) {
        let t = s.max(s.sub(s.splat(0.0), *f), s.splat(-126.0));
        let n = s.round(t);
        *f = s.sub(t, n);
        *scale = s.power_of_two(n);
    }
    let mut q = [s.splat(EXP2_M1[4]); R];
    for i in (0..4).rev() {
        let coefficient = s.splat(EXP2_M1[i]);
        for (q, &f) in q.iter_mut().zip(&f) {
            *q = s.mul_add(*q, f, coefficient);
        }
    }
    for (q, &f) in q.iter_mut().zip(&f) {
        *q = s.mul(*q, f);
    }
    (scale, q)
}

/// 2^-x for x >= 0; relative error 4e-7; 2^-126 beyond x = 126.
#[inline(always)]
pub fn exp2_neg<S: Simd>(s: S, x: S::F) -> S::F {
    let ([scale], [g]) = exp2_neg_parts(s, [x]);
    s.mul_add(scale, g, scale)
}

/// 1 - 2^-x, as exact as [`one_minus_exp2_neg`], and 2^-x, for x >= 0.
#[inline(always)]
pub fn exp2_neg_and_rest<S: Simd>(s: S, x: S::F) -> (S::F, S::F) {
    let ([scale], [g]) = exp2_neg_parts(s, [x]);
    (s.neg_mul_add(scale, g, s.sub(s.splat(1.0), scale)), s.mul_add(scale, g, scale))
}

/// 1 - 2^-x for x >= 0, with relative error below 1e-6 for all x down to 0 (thin gas must not round to nothing).
#[inline(always)]
pub fn one_minus_exp2_neg<S: Simd, const R: usize>(s: S, x: [S::F; R]) -> [S::F; R] {
    let (scale, mut g) = exp2_neg_parts(s, x);
    for (g, &scale) in g.iter_mut().zip(&scale) {
        *g = s.neg_mul_add(scale, *g, s.sub(s.splat(1.0), scale));
    }
    g
}

/// log2(a) for normal a > 0 up to 2^126; absolute error 2e-7 for |log2(a)| < 2, else rounding.
#[inline(always)]
pub fn log2<S: Simd>(s: S, a: S::F) -> S::F {
    let exponent = s.exponent(a);
    let mantissa = s.mul(a, s.power_of_two(s.sub(s.splat(0.0), exponent)));
    // ln(m / sqrt 2) = 2 artanh(t) with t = (m - sqrt 2) / (m + sqrt 2), |t| < 0.172: four terms leave 4e-8.
    let root = s.splat(std::f32::consts::SQRT_2);
    let t = s.div(s.sub(mantissa, root), s.add(mantissa, root));
    let square = s.mul(t, t);
    let mut sum = s.splat(1.0 / 7.0);
    for term in [1.0 / 5.0, 1.0 / 3.0, 1.0] {
        sum = s.mul_add(sum, square, s.splat(term));
    }
    let half = s.mul_add(s.mul(sum, t), s.splat(2.0 * std::f32::consts::LOG2_E), s.splat(0.5));
    s.add(exponent, half)
}

/// A job that is generic over the vectors. Mark the implementation `#[inline(always)]`.
pub trait WithSimd {
    /// What it returns.
    type Output;
    /// Does the job.
    fn with_simd<S: Simd>(self, s: S) -> Self::Output;
}

/// Runs a job compiled for a level. Panics if the machine does not have it.
#[allow(unsafe_code)]
pub fn dispatch<W: WithSimd>(level: Level, job: W) -> W::Output {
    assert!(level.is_available(), "this machine has no {level}");
    match level {
        Level::Portable => job.with_simd(portable::Portable),
        #[cfg(target_arch = "x86_64")]
        Level::Sse2 => job.with_simd(x86::sse2()),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the assertion above.
        Level::Avx2 => unsafe { x86::run_avx2(job) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the assertion above.
        Level::Avx512 => unsafe { x86::run_avx512(job) },
        #[cfg(not(target_arch = "x86_64"))]
        Level::Sse2 | Level::Avx2 | Level::Avx512 => unreachable!("not available on this architecture"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation on a row of inputs, lane by lane against f64.
    struct Check;

    impl WithSimd for Check {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) {
            let lanes = |v: S::F| {
                let mut out = vec![0.0f32; S::LANES];
                s.store(v, &mut out);
                out
            };
            let a: Vec<f32> = (0..S::LANES).map(|i| i as f32 * 0.73 - 2.1).collect();
            let b: Vec<f32> = (0..S::LANES).map(|i| 1.9 - i as f32 * 0.41).collect();
            let (va, vb) = (s.load(&a), s.load(&b));
            let each = |v: S::F, f: &dyn Fn(f32, f32) -> f32| {
                for (i, got) in lanes(v).into_iter().enumerate() {
                    let want = f(a[i], b[i]);
                    assert!((got - want).abs() <= 1e-6 * want.abs().max(1.0), "lane {i}: {got} for {want}");
                }
            };
            each(s.add(va, vb), &|a, b| a + b);
            each(s.sub(va, vb), &|a, b| a - b);
            each(s.mul(va, vb), &|a, b| a * b);
            each(s.div(va, vb), &|a, b| a / b);
            each(s.mul_add(va, vb, va), &|a, b| a * b + a);
            each(s.neg_mul_add(va, vb, va), &|a, b| a - a * b);
            each(s.min(va, vb), &f32::min);
            each(s.max(va, vb), &f32::max);
            each(s.sqrt(s.mul(va, va)), &|a, _| a.abs());
            each(s.mul(s.sqrt_fast(s.mul(va, va)), s.splat(1e-3)), &|a, _| a.abs() * 1e-3);
            assert!(lanes(s.sqrt_fast(s.splat(TINY)))[0] <= 2e-15);
            each(s.sqrt_near(s.mul(va, va)), &|a, _| a.abs());
            for step in -60..60 {
                let (a, got) = (1.37f32.powi(step), |a| lanes(s.sqrt_near(s.splat(a)))[0]);
                assert!((f64::from(got(a)) / f64::from(a).sqrt() - 1.0).abs() < 2.4e-7, "{a}: {}", got(a));
                assert!(got(0.0) <= 2e-15);
            }
            each(s.round(va), &|a, _| a.round_ties_even());
            each(s.power_of_two(s.round(va)), &|a, _| a.round_ties_even().exp2());
            each(s.keep(s.less(va, vb), va), &|a, b| if a < b { a } else { 0.0 });
            let positive = s.less(s.splat(0.0), va);
            for (i, &least) in a.iter().enumerate() {
                // a rises: the lanes before i are below.
                assert_eq!(s.any(s.less(va, s.splat(least))), i > 0, "lane {i}");
            }
            each(s.exponent(s.mul_add(va, va, s.splat(1e-6))), &|a, _| (a * a + 1e-6).log2().floor());
            each(s.keep(s.and(s.less(va, vb), positive), va), &|a, b| if a < b && a > 0.0 { a } else { 0.0 });
            each(s.ramp(), &|a, _| ((a + 2.1) / 0.73).round());
            assert_eq!(s.reduce_max(va), a.iter().copied().fold(f32::MIN, f32::max));
            assert_eq!(s.reduce_min(vb), b.iter().copied().fold(f32::MAX, f32::min));
            let code = |a: f32| (a - 2.0) * 14.6 + 128.0;
            let codes = |v: S::F| s.mul_add(s.sub(v, s.splat(2.0)), s.splat(14.6), s.splat(128.0));
            let mut pixels = vec![[7u8; 4]; S::LANES + 1];
            s.store_rgba8([codes(va), codes(vb), s.splat(255.4)], &mut pixels);
            for (i, &got) in pixels[..S::LANES].iter().enumerate() {
                assert_eq!(got, [code(a[i]).round() as u8, code(b[i]).round() as u8, 255, 255], "lane {i}");
            }
            assert_eq!(pixels[S::LANES], [7; 4]);
            // Whole numbers of 16 bits, rounded and held within them.
            let of = |a: &[f32], b: &[f32]| {
                a.iter().chain(b).map(|v| (v * 18_000.7).round_ties_even() as i16).collect::<Vec<_>>()
            };
            let (words, swapped) = (of(&a, &b), of(&b, &a));
            assert!(words.contains(&i16::MAX) && words.contains(&i16::MIN), "{words:?}");
            let scaled = |v| s.mul(v, s.splat(18_000.7));
            let (wa, wb) = (s.words(scaled(va), scaled(vb)), s.words(scaled(vb), scaled(va)));
            let each = |got: S::W, off: i32, f: &dyn Fn(i16, i16) -> i32| {
                // The upper byte by itself, the lower one taken there.
                let mut pixels = vec![[7u8; 4]; 2 * S::LANES + 1];
                let lower = (0..8).fold(got, |w, _| s.add_words(w, w));
                s.store_words([got, lower, got], &mut pixels);
                for (i, (&a, &b)) in words.iter().zip(&swapped).enumerate() {
                    let [high, low, again, alpha] = pixels[i];
                    assert_eq!((again, alpha), (high, 255));
                    let (got, want) = (i16::from_be_bytes([high, low]), f(a, b));
                    assert!((i32::from(got) - want).abs() <= off, "word {i} of {a}, {b}: {got} for {want}");
                }
                assert_eq!(pixels[2 * S::LANES], [7; 4]);
            };
            each(wa, 0, &|a, _| a.into());
            each(s.splat_word(-12_345), 0, &|_, _| -12_345);
            each(s.add_words(wa, wb), 0, &|a, b| a.wrapping_add(b).into());
            each(s.sub_words(wa, wb), 0, &|a, b| a.wrapping_sub(b).into());
            each(s.mul_words(wa, wb), 1, &|a, b| (f64::from(a) * f64::from(b) / 32_768.0).round() as i32);
            for a in (-32_767..=32_767i16).step_by(977) {
                for b in (-32_767..=32_767i16).step_by(1021) {
                    let product = s.mul_words(s.splat_word(a), s.splat_word(b));
                    let lower = (0..8).fold(product, |w, _| s.add_words(w, w));
                    let mut pixels = vec![[0u8; 4]; 2 * S::LANES];
                    s.store_words([product, lower, product], &mut pixels);
                    let got = f64::from(i16::from_be_bytes([pixels[0][0], pixels[0][1]]));
                    let off = got - f64::from(a) * f64::from(b) / 32_768.0;
                    assert!(off.abs() <= 1.0, "{a} x {b} is off by {off}");
                }
            }
            let table: Vec<f32> = (0..100).map(|i| (i * i) as f32).collect();
            let index = s.mul_add(s.ramp(), s.splat(3.1), s.splat(0.5));
            for (i, got) in lanes(s.lookup(&table, index)).into_iter().enumerate() {
                let j = (i as f32 * 3.1 + 0.5) as usize;
                assert_eq!(got, table[j]);
            }
            for step in 0..4000 {
                let x = f64::from(step) * 0.01 + 1e-9;
                let v = s.splat(x as f32);
                let x = f64::from(x as f32);
                let e = f64::from(lanes(exp2_neg(s, v))[0]);
                assert!((e / (-x).exp2() - 1.0).abs() < 1e-6, "2^-{x} = {e}");
                let alpha = f64::from(lanes(one_minus_exp2_neg(s, [v])[0])[0]);
                let want = -(-x * std::f64::consts::LN_2).exp_m1();
                assert!((alpha / want - 1.0).abs() < 1e-6, "1 - 2^-{x} = {alpha}, not {want}");
                let (rest, through) = exp2_neg_and_rest(s, v);
                assert_eq!((f64::from(lanes(rest)[0]), f64::from(lanes(through)[0])), (alpha, e));
            }
            assert!(lanes(exp2_neg(s, s.splat(1e30)))[0] < 1e-37);
            for step in -400..400 {
                let a = (f64::from(step) * 0.1).exp2() as f32;
                let got = f64::from(lanes(log2(s, s.splat(a)))[0]);
                let want = f64::from(a).log2();
                assert!((got - want).abs() <= 2e-7 * want.abs().max(1.0), "log2({a}) = {got}, not {want}");
            }
        }
    }

    #[test]
    fn every_level_computes_the_same_functions() {
        for level in Level::available() {
            dispatch(level, Check);
        }
    }
}
