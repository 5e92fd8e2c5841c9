//! Front-to-back compositing in registers: four variants of one equation.
//!
//! C += T alpha c, T *= 1 - alpha. Where all particles have one colour c, C = c (1 - T) needs no sum of its own; where in
//! addition the opacity model is exponential, T itself is a sum of optical depths.

use super::simd::{Simd, exp2_neg_and_rest, one_minus_exp2_neg};

/// A compositing variant. State planes are at most four; plane 0 tells what remains.
pub trait Composite: Copy + Send + Sync + 'static {
    /// Planes of state in use.
    const PLANES: usize;
    /// At least how deep a particle of amplitude 1 is through its centre, in powers of two, where it is of no account what is in front
    /// of what.
    const DEPTH: Option<f32>;
    /// Plane 0 before anything is drawn; the others start at 0.
    const START: f32;
    /// Adds a fragment to each row; its value is the product of the two factors.
    fn blend<S: Simd, const R: usize>(s: S, state: &mut [[S::F; 4]; R], values: &[(S::F, S::F); R], color: &[f32; 3]);
    /// Whether every pixel of the rows has at most transmittance `stop` left.
    fn is_done<S: Simd, const R: usize>(s: S, state: &[[S::F; 4]; R], stop: f32) -> bool;
    /// Colour so far and transmittance; `color` is the one colour, where there is one.
    fn finish<S: Simd>(s: S, state: &[S::F; 4], color: &[f32; 3]) -> ([S::F; 3], S::F);
}

/// Many colours; `EXPONENTIAL`: fragments are optical depths in powers of two, else opacities.
#[derive(Clone, Copy)]
pub struct Many<const EXPONENTIAL: bool>;

/// One colour, fragments are opacities.
#[derive(Clone, Copy)]
pub struct OneLinear;

/// One colour, fragments are optical depths in powers of two.
#[derive(Clone, Copy)]
pub struct OneExponential;

/// Whether plane 0 is at most `stop` everywhere.
#[inline(always)]
fn is_at_most<S: Simd, const R: usize>(s: S, state: &[[S::F; 4]; R], stop: f32) -> bool {
    let mut most = state[0][0];
    for row in &state[1..] {
        most = s.max(most, row[0]);
    }
    !s.any(s.less(s.splat(stop), most))
}

impl<const EXPONENTIAL: bool> Composite for Many<EXPONENTIAL> {
    const PLANES: usize = 4;
    const DEPTH: Option<f32> = None;
    const START: f32 = 1.0;

    #[inline(always)]
    fn blend<S: Simd, const R: usize>(s: S, state: &mut [[S::F; 4]; R], values: &[(S::F, S::F); R], color: &[f32; 3]) {
        let mut alphas = [s.splat(0.0); R];
        for (alpha, &(a, b)) in alphas.iter_mut().zip(values) {
            *alpha = s.mul(a, b);
        }
        if EXPONENTIAL {
            alphas = one_minus_exp2_neg(s, alphas);
        }
        let color = [s.splat(color[0]), s.splat(color[1]), s.splat(color[2])];
        for (state, &alpha) in state.iter_mut().zip(&alphas) {
            let share = s.mul(state[0], alpha);
            state[0] = s.neg_mul_add(state[0], alpha, state[0]);
            state[1] = s.mul_add(share, color[0], state[1]);
            state[2] = s.mul_add(share, color[1], state[2]);
            state[3] = s.mul_add(share, color[2], state[3]);
        }
    }

    #[inline(always)]
    fn is_done<S: Simd, const R: usize>(s: S, state: &[[S::F; 4]; R], stop: f32) -> bool {
        is_at_most(s, state, stop)
    }

    #[inline(always)]
    fn finish<S: Simd>(_: S, state: &[S::F; 4], _: &[f32; 3]) -> ([S::F; 3], S::F) {
        ([state[1], state[2], state[3]], state[0])
    }
}

impl Composite for OneLinear {
    const PLANES: usize = 1;
    // -log2(1 - a) >= a / ln 2.
    const DEPTH: Option<f32> = Some(std::f32::consts::LOG2_E);
    const START: f32 = 1.0;

    #[inline(always)]
    fn blend<S: Simd, const R: usize>(s: S, state: &mut [[S::F; 4]; R], values: &[(S::F, S::F); R], _: &[f32; 3]) {
        for (state, &(a, b)) in state.iter_mut().zip(values) {
            state[0] = s.neg_mul_add(state[0], s.mul(a, b), state[0]);
        }
    }

    #[inline(always)]
    fn is_done<S: Simd, const R: usize>(s: S, state: &[[S::F; 4]; R], stop: f32) -> bool {
        is_at_most(s, state, stop)
    }

    #[inline(always)]
    fn finish<S: Simd>(s: S, state: &[S::F; 4], color: &[f32; 3]) -> ([S::F; 3], S::F) {
        let alpha = s.sub(s.splat(1.0), state[0]);
        (color.map(|c| s.mul(alpha, s.splat(c))), state[0])
    }
}

impl Composite for OneExponential {
    const PLANES: usize = 1;
    const DEPTH: Option<f32> = Some(1.0);
    const START: f32 = 0.0;

    #[inline(always)]
    fn blend<S: Simd, const R: usize>(s: S, state: &mut [[S::F; 4]; R], values: &[(S::F, S::F); R], _: &[f32; 3]) {
        for (state, &(a, b)) in state.iter_mut().zip(values) {
            state[0] = s.mul_add(a, b, state[0]);
        }
    }

    #[inline(always)]
    fn is_done<S: Simd, const R: usize>(s: S, state: &[[S::F; 4]; R], stop: f32) -> bool {
        let mut least = state[0][0];
        for row in &state[1..] {
            least = s.min(least, row[0]);
        }
        // -log2(0) is infinity: never.
        !s.any(s.less(least, s.splat(-stop.log2())))
    }

    #[inline(always)]
    fn finish<S: Simd>(s: S, state: &[S::F; 4], color: &[f32; 3]) -> ([S::F; 3], S::F) {
        let (alpha, through) = exp2_neg_and_rest(s, state[0]);
        (color.map(|c| s.mul(alpha, s.splat(c))), through)
    }
}
