//! Optical depth along a ray up to a point, in vectors: the f32 twins of [`Kernel::segment`].
//!
//! A *primitive* P(u) is the integral of a kernel along a line from the point nearest the centre to the signed distance u,
//! in radii; that of a segment is the difference of two. Sums of neighbouring segments telescope: however a ray is cut, its
//! pieces add up to the whole within rounding.

use super::simd::{Simd, exp2_neg, log2};
use crate::scene::Kernel;
use std::f32::consts::LN_2;

/// A kernel's primitive. Several rows at a time, so that coefficients are loaded once for all. `square` is b^2, the square
/// of the line's distance from the centre, in [0, 1]; `u` lies within the chord.
pub trait Primitive: Copy {
    /// Writes what the kernel needs to know of the lines beside `square` into `legs`.
    #[inline(always)]
    fn prepare<S: Simd, const R: usize>(self, _: S, _: &[S::F; R], _: &mut Vec<Leg<S::F, R>>) {}

    /// Factor of the primitives: what depends on the line alone.
    #[inline(always)]
    fn factor<S: Simd>(self, s: S, _: S::F) -> S::F {
        s.splat(1.0)
    }

    /// As [`Primitive::factor`], for points between slabs.
    #[inline(always)]
    fn factor_between<S: Simd>(self, s: S, square: S::F) -> S::F {
        self.factor(s, square)
    }

    /// P(u) but for the factor; odd in u.
    fn at<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], legs: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R];

    /// As [`Primitive::at`], for points between slabs: its error moves optical depth between neighbours, no more.
    #[inline(always)]
    fn between<S: Simd, const R: usize>(
        self,
        s: S,
        square: &[S::F; R],
        legs: &[Leg<S::F, R>],
        u: &[S::F; R],
    ) -> [S::F; R] {
        self.at(s, square, legs, u)
    }

    /// P at the end of the chord, `half` from its middle, with the factor.
    #[inline(always)]
    fn end<S: Simd, const R: usize>(
        self,
        s: S,
        square: &[S::F; R],
        legs: &[Leg<S::F, R>],
        half: &[S::F; R],
    ) -> [S::F; R] {
        self.at(s, square, legs, half)
    }
}

/// exp(-a q^2): P(u) = exp(-a b^2) times the integral of exp(-a u^2), which is u times a polynomial of u^2 - 1/2 (centred,
/// so that its terms do not cancel). At the end of the chord, where u^2 = 1 - b^2, it is u times another.
#[derive(Clone, Copy, Debug)]
pub struct Bell<const N: usize, const M: usize, const L: usize> {
    /// a log2(e).
    rate: f32,
    /// For any u.
    full: [f32; N],
    /// For any u, less exact.
    short: [f32; M],
    /// For the end of the chord, with the factor.
    end: [f32; L],
}

/// Minimax on [0, 1], as evaluated in f32: 1.1e-7 of the integral, 4.3e-6 between slabs, 9.3e-8 at the end.
pub const GAUSSIAN: Bell<9, 7, 10> = Bell {
    rate: (4.5 * std::f64::consts::LOG2_E) as f32,
    full: [0.5707922, -0.46539173, 0.46094787, -0.41259372, 0.3215717, -0.2175916, 0.1319628, -0.07780638, 0.03376358],
    short: [0.5707954, -0.46547383, 0.46067366, -0.4094239, 0.324351, -0.24729101, 0.13150473],
    end: [
        0.060161084,
        0.2216734,
        0.43697366,
        0.59214276,
        0.61330116,
        0.5149746,
        0.35983142,
        0.21520309,
        0.13254069,
        0.07104186,
    ],
};

/// Minimax on [0, 1], as evaluated in f32: 1.2e-7 of the integral, 2.5e-6 between slabs, 1.3e-7 at the end.
pub const BELIAEV: Bell<11, 9, 12> = Bell {
    rate: (8.0 * std::f64::consts::LOG2_E) as f32,
    full: [
        0.44104075,
        -0.42272702,
        0.5608152,
        -0.73916453,
        0.90342283,
        -1.004799,
        0.99779695,
        -0.86241466,
        0.7475231,
        -0.74145794,
        0.44493905,
    ],
    short: [0.4410392, -0.42266375, 0.5610295, -0.7430535, 0.899633, -0.9413989, 1.0058517, -1.2400147, 0.86809635],
    end: [
        0.008077906,
        0.056879442,
        0.20683889,
        0.5103486,
        0.9541523,
        1.4373986,
        1.8391421,
        2.0388331,
        1.7909871,
        1.3867233,
        1.7066113,
        1.4303362,
    ],
};

/// u times a polynomial of w, at least linear.
#[inline(always)]
fn polynomial<S: Simd, const R: usize>(s: S, coefficients: &[f32], u: &[S::F; R], w: &[S::F; R]) -> [S::F; R] {
    let [others @ .., highest] = coefficients else {
        return *u;
    };
    let mut p = [s.splat(*highest); R];
    for &coefficient in others.iter().rev() {
        let coefficient = s.splat(coefficient);
        for (p, &w) in p.iter_mut().zip(w) {
            *p = s.mul_add(*p, w, coefficient);
        }
    }
    for (p, &u) in p.iter_mut().zip(u) {
        *p = s.mul(*p, u);
    }
    p
}

/// u^2 - 1/2.
#[inline(always)]
fn centred<S: Simd, const R: usize>(s: S, u: &[S::F; R]) -> [S::F; R] {
    let mut w = *u;
    for w in &mut w {
        *w = s.mul_add(*w, *w, s.splat(-0.5));
    }
    w
}

impl<const N: usize, const M: usize, const L: usize> Primitive for Bell<N, M, L> {
    #[inline(always)]
    fn factor<S: Simd>(self, s: S, square: S::F) -> S::F {
        exp2_neg(s, s.mul(square, s.splat(self.rate)))
    }

    #[inline(always)]
    fn at<S: Simd, const R: usize>(self, s: S, _: &[S::F; R], _: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        polynomial(s, &self.full, u, &centred(s, u))
    }

    #[inline(always)]
    fn between<S: Simd, const R: usize>(self, s: S, _: &[S::F; R], _: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        polynomial(s, &self.short, u, &centred(s, u))
    }

    #[inline(always)]
    fn end<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], _: &[Leg<S::F, R>], half: &[S::F; R]) -> [S::F; R] {
        // 1 - b^2 from 1/2.
        let mut w = *square;
        for w in &mut w {
            *w = s.sub(s.splat(0.5), *w);
        }
        polynomial(s, &self.end, half, &w)
    }
}

/// [`GAUSSIAN`] where slabs are thick: its shares of the slabs are good to 3e-4 of the whole, for two thirds of the work. The
/// whole is as exact.
#[derive(Clone, Copy, Debug)]
pub struct Thick;

impl Primitive for Thick {
    #[inline(always)]
    fn factor<S: Simd>(self, s: S, square: S::F) -> S::F {
        GAUSSIAN.factor(s, square)
    }

    /// The fourth power of a minimax polynomial for exp(-9/8 b^2): 1.2e-4 of the value.
    #[inline(always)]
    fn factor_between<S: Simd>(self, s: S, square: S::F) -> S::F {
        const ROOT: [f32; 5] = [0.999971, -1.1237744, 0.6238321, -0.2128969, 0.037530042];
        let mut p = s.splat(ROOT[4]);
        for i in (0..4).rev() {
            p = s.mul_add(p, square, s.splat(ROOT[i]));
        }
        let p = s.mul(p, p);
        s.mul(p, p)
    }

    #[inline(always)]
    fn at<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], legs: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        GAUSSIAN.at(s, square, legs, u)
    }

    /// Minimax on [0, 1]: 2.6e-4 of the whole.
    #[inline(always)]
    fn between<S: Simd, const R: usize>(self, s: S, _: &[S::F; R], _: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        const SHORT: [f32; 5] = [0.5706509, -0.46232283, 0.46608925, -0.4732696, 0.320074];
        polynomial(s, &SHORT, u, &centred(s, u))
    }

    #[inline(always)]
    fn end<S: Simd, const R: usize>(
        self,
        s: S,
        square: &[S::F; R],
        legs: &[Leg<S::F, R>],
        half: &[S::F; R],
    ) -> [S::F; R] {
        GAUSSIAN.end(s, square, legs, half)
    }
}

/// 1: P(u) = u.
#[derive(Clone, Copy, Debug)]
pub struct Constant;

impl Primitive for Constant {
    #[inline(always)]
    fn at<S: Simd, const R: usize>(self, _: S, _: &[S::F; R], _: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        *u
    }
}

/// (1 - q^2)^2: P(u) = u [L^4 - 2 L^2 u^2/3 + u^4/5] with L^2 = 1 - b^2.
#[derive(Clone, Copy, Debug)]
pub struct Poly;

impl Primitive for Poly {
    #[inline(always)]
    fn at<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], _: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        let mut p = *u;
        for (p, &square) in p.iter_mut().zip(square) {
            let (u, half2) = (*p, s.sub(s.splat(1.0), square));
            let u2 = s.mul(u, u);
            let inner = s.mul_add(u2, s.splat(0.2), s.mul(half2, s.splat(-2.0 / 3.0)));
            *p = s.mul(u, s.mul_add(inner, u2, s.mul(half2, half2)));
        }
        p
    }
}

/// A stretch of a radial profile on which the density is linear.
#[derive(Clone, Copy, Debug)]
pub struct Shell {
    /// q at its ends.
    q: [f32; 2],
    /// Density at the first.
    density: f32,
    /// Change of the density with q.
    slope: f32,
}

impl Shell {
    /// q at its ends, the density at the first, and the change of the density with q.
    pub fn numbers(&self) -> [f32; 4] {
        [self.q[0], self.q[1], self.density, self.slope]
    }
}

/// Where lines leave a shell: distance from the middle of the chord, and the integral of q up to there.
pub type Leg<F, const R: usize> = [[F; R]; 2];

/// Densities that are linear on shells, `linear` and `table`. On a shell k = d + m (q - q0), and the integral of
/// q = sqrt(u^2 + b^2) is D(u) = [u sqrt(u^2 + b^2) + b^2 asinh(u/b)] / 2.
#[derive(Clone, Copy, Debug)]
pub struct Shells<'a>(&'a [Shell]);

/// Least b^2 whose logarithm is taken: its product with the logarithm is nothing.
const TINY: f32 = 1e-30;

/// D(u) for u >= 0, with q = sqrt(u^2 + b^2).
#[inline(always)]
fn distance_integral<S: Simd>(s: S, square: S::F, u: S::F, q: S::F) -> S::F {
    let square = s.max(square, s.splat(TINY));
    // asinh(u/b) = ln((u + q)/b), as half of ln(((u + q)/b)^2).
    let sum = s.add(u, q);
    let ratio = s.div(s.mul(sum, sum), square);
    // Rounding may leave u + q a hair below b.
    let asinh = s.mul(log2(s, s.max(ratio, s.splat(1.0))), s.splat(0.5 * LN_2));
    s.mul(s.mul_add(u, q, s.mul(square, asinh)), s.splat(0.5))
}

impl Primitive for Shells<'_> {
    #[inline(always)]
    fn prepare<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], legs: &mut Vec<Leg<S::F, R>>) {
        legs.clear();
        for shell in self.0 {
            let q2 = s.splat(shell.q[1] * shell.q[1]);
            let mut leg = [[s.splat(0.0); R]; 2];
            for (r, &square) in square.iter().enumerate() {
                let along = s.sqrt(s.max(s.sub(q2, square), s.splat(0.0)));
                leg[0][r] = along;
                // Beneath the shell there is nothing: the integral is 0.
                let inside = s.less(square, q2);
                leg[1][r] = s.keep(inside, distance_integral(s, square, along, s.splat(shell.q[1])));
            }
            legs.push(leg);
        }
    }

    #[inline(always)]
    fn at<S: Simd, const R: usize>(self, s: S, square: &[S::F; R], legs: &[Leg<S::F, R>], u: &[S::F; R]) -> [S::F; R] {
        let zero = s.splat(0.0);
        let mut sums = [zero; R];
        for r in 0..R {
            let size = s.max(u[r], s.sub(zero, u[r]));
            let q = s.sqrt(s.mul_add(size, size, square[r]));
            let whole = distance_integral(s, square[r], size, q);
            let (mut from, mut below, mut sum) = (zero, zero, zero);
            for (shell, leg) in self.0.iter().zip(legs) {
                // D rises with u: the smaller u has the smaller D.
                let (to, above) = (s.min(size, leg[0][r]), s.min(whole, leg[1][r]));
                let length = s.max(s.sub(to, from), zero);
                let rise = s.neg_mul_add(length, s.splat(shell.q[0]), s.sub(above, below));
                // Clamped to what the shell allows, so that a nearly vertical step does not amplify rounding.
                let rise = s.min(s.max(rise, zero), s.mul(length, s.splat(shell.q[1] - shell.q[0])));
                sum = s.mul_add(length, s.splat(shell.density), sum);
                sum = s.mul_add(rise, s.splat(shell.slope), sum);
                (from, below) = (s.max(from, to), s.max(below, above));
            }
            sums[r] = s.sub(s.keep(s.less(zero, u[r]), sum), s.keep(s.less(u[r], zero), sum));
        }
        sums
    }
}

/// Which primitive a kernel has.
#[derive(Clone, Copy, Debug, Default)]
pub enum Shape {
    /// [`GAUSSIAN`].
    #[default]
    Gaussian,
    /// [`BELIAEV`].
    Beliaev,
    /// [`Constant`].
    Constant,
    /// [`Poly`].
    Poly,
    /// [`Shells`], the first and how many.
    Shells(u32, u32),
}

impl Shape {
    /// The shape of a kernel; shells are appended.
    pub fn new(kernel: &Kernel, shells: &mut Vec<Shell>) -> Self {
        let first = shells.len() as u32;
        match kernel {
            Kernel::Gaussian => Self::Gaussian,
            Kernel::Beliaev => Self::Beliaev,
            Kernel::Constant => Self::Constant,
            Kernel::Poly => Self::Poly,
            Kernel::Linear => {
                shells.push(Shell { q: [0.0, 1.0], density: 1.0, slope: -1.0 });
                Self::Shells(first, 1)
            }
            Kernel::Table(profile) => {
                let rows: Vec<_> = profile.q().iter().zip(profile.densities()).collect();
                for pair in rows.windows(2) {
                    let [(&q0, &d0), (&q1, &d1)] = [pair[0], pair[1]];
                    let q = [q0 as f32, q1 as f32];
                    // A step narrower than single precision tells apart holds nothing.
                    if q[0] < q[1] {
                        let slope = (d1 - d0) / (q1 - q0) / profile.centre();
                        shells.push(Shell { q, density: (d0 / profile.centre()) as f32, slope: slope as f32 });
                    }
                }
                Self::Shells(first, shells.len() as u32 - first)
            }
        }
    }
}

impl Shape {
    /// The kind (0 Gaussian, 1 Beliaev, 2 constant, 3 poly, 4 shells), the first shell and the number of shells.
    pub fn numbers(self) -> [u32; 3] {
        match self {
            Self::Gaussian => [0; 3],
            Self::Beliaev => [1, 0, 0],
            Self::Constant => [2, 0, 0],
            Self::Poly => [3, 0, 0],
            Self::Shells(first, count) => [4, first, count],
        }
    }
}

/// The integral of a kernel's density, in the unit of its [`Shape`], along the whole line through the centre.
pub fn centre(kernel: &Kernel) -> f64 {
    match kernel {
        // Profiles are scaled, since their densities may be of any size.
        Kernel::Table(_) => 1.0,
        Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Constant | Kernel::Poly => kernel.chord(0.0),
    }
}

impl<'a> Shells<'a> {
    /// The shells of a [`Shape::Shells`].
    pub fn new(all: &'a [Shell], first: u32, count: u32) -> Self {
        Self(&all[first as usize..][..count as usize])
    }
}
