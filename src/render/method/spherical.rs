//! `spherical`: spherical billboards (Umenhoffer, Szirmay-Kalos & Szijarto, Spherical billboards for rendering volumetric
//! data, ShaderX 5).
//!
//! A particle is a ball of gas that a ray crosses from F to B; what a fragment shows is the piece between the near plane and
//! the opaque surface. Thus neither a surface nor the near plane cuts a visible edge into the gas, and a ball that the near
//! plane passes fades instead of popping. In the paper's letters: with Q the ray's point on the quad's plane, P the centre,
//! d = |(P - Q)_xy|, w = sqrt(r^2 - d^2), F, B = z_P -+ w (z grows into the scene), f the depth of the near plane,
//! ds = min(Z_scene, B) - max(f, F), nothing where negative, alpha = 1 - exp(-tau (1 - d/r) ds).
//!
//! - `falloff = "printed"`: as above. A ball has one density along a ray, its falloff at the closest point; through the
//!   centre the optical depth is 2 r tau, so that tau = T0/(2r) gives the particle's opacity there.
//! - `falloff = "integrated"`: the falloff 1 - q at every point of the ray. With u the signed distance from the closest point
//!   and b the perpendicular distance, tau [G(u1) - G(u0)], G(u) = u - [u sqrt(u^2 + b^2) + b^2 asinh(u/b)]/(2r); through
//!   the centre r tau, so that tau = T0/r.
//! - `rays = "parallel"`: inside the ball a ray is taken to run along z from Q.
//! - `rays = "perspective"`: the ray through the eye; d is its perpendicular distance from the centre, F, B its entry and exit,
//!   and the near plane and the surface cut along it. The quad then has no influence.
//! - `quad = "far"`: the quad stands at depth z_P + r, so that no part of the ball is nearer to the eye than to the quad.
//! - `quad = "centre"`: at the centre's depth, or at the near plane where that is farther.
//!
//! Error: with parallel rays and the far quad a ball is shown at P_x/(z_P + r) and r/(z_P + r) large, with the parallax of
//! depth z_P + r: too small and too far for the eyes by a factor of 1 + r/z_P, which for a ball close by is much. The centre
//! quad is right at the centre and errs as `viewplane` does. Overlapping particles are composited one behind the other though
//! they mix. Order: by depth, shared by eyes with parallel axes. The particle's kernel is ignored.

use super::perspective;
use crate::render::cpu::order::Key;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::simd::{Simd, log2};
use crate::render::cpu::splat::{Alignment, Card, Constants, Fragment, Frame, Item, Lens, Pixel, Prepared};
use crate::render::gpu::shader::{self, Part};
use crate::render::gpu::splat::{Anchor, Forms, Shaded};
use glam::DVec3;
use std::f32::consts::LN_2;

/// What the paper leaves open or what later work does otherwise; the default is the paper as printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parameters {
    /// How opacity falls off from the centre.
    pub falloff: Falloff,
    /// The way of a ray through a ball.
    pub rays: Rays,
    /// Where the quad stands.
    pub quad: Quad,
}

impl Parameters {
    /// The paper as printed.
    pub const DEFAULT: Self = Self { falloff: Falloff::Printed, rays: Rays::Parallel, quad: Quad::Far };
}

/// How opacity falls off from the centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Falloff {
    /// (1 - d/r) times the length of the segment.
    #[default]
    Printed,
    /// The integral of the linear falloff along the segment.
    Integrated,
}

/// The way of a ray through a ball.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rays {
    /// Parallel to the optical axis.
    #[default]
    Parallel,
    /// Through the eye.
    Perspective,
}

/// Where the quad stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quad {
    /// At the farthest point of the ball.
    #[default]
    Far,
    /// At the centre's depth.
    Centre,
}

impl Falloff {
    /// Every falloff.
    pub const ALL: &[Self] = &[Self::Printed, Self::Integrated];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Printed => "printed",
            Self::Integrated => "integrated",
        }
    }
}

impl Rays {
    /// Both ways.
    pub const ALL: &[Self] = &[Self::Parallel, Self::Perspective];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parallel => "parallel",
            Self::Perspective => "perspective",
        }
    }
}

impl Quad {
    /// Both places.
    pub const ALL: &[Self] = &[Self::Far, Self::Centre];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Far => "far",
            Self::Centre => "centre",
        }
    }
}

/// Parallel rays; `INTEGRATED` is the falloff.
#[derive(Clone, Copy)]
pub struct Parallel<const INTEGRATED: bool> {
    /// Where the quad stands.
    pub quad: Quad,
}

/// A prepared ball on its quad.
#[derive(Clone, Copy, Default)]
pub struct Splat {
    quad: Card,
    /// Of the centre.
    depth: f32,
    /// 1 / radius.
    inverse: f32,
}

/// Rays through the eye; `INTEGRATED` is the falloff.
#[derive(Clone, Copy)]
pub struct Slanted<const INTEGRATED: bool>;

impl<const INTEGRATED: bool> Alignment for Parallel<INTEGRATED> {
    type Splat = Splat;
    type Gauss = Self;
    type Radial = Self;
    type Affine = Self;
    const WEIGHTED: bool = false;
    const KEY: Key = Key::Depth;
    const VOLUMETRIC: bool = true;
    const KERNELS: bool = false;

    #[inline]
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, _: bool) -> Option<Prepared<Splat>> {
        let (depth, near) = (-center.z, lens.view.near);
        let quad = match self.quad {
            Quad::Far => depth + radius,
            Quad::Centre => depth.max(near),
        };
        let (quad, bounds) = Card::new(lens, center, radius, quad);
        let depths = [depth - radius, depth + radius];
        let front = if depths[0] < near { ((near - depth) / radius) as f32 } else { f32::NEG_INFINITY };
        let splat = Splat { quad, depth: depth as f32, inverse: (1.0 / radius) as f32 };
        Some(Prepared { splat, bounds, depths, front })
    }

    fn opaque_limit(depth: f64, _: f64) -> f64 {
        depth
    }

    #[inline(always)]
    fn constants(splat: &Splat) -> [f32; 2] {
        [splat.depth, splat.inverse]
    }

    fn rim(splat: &Splat, lens: &Lens, _: bool) -> Rim {
        Rim::card(lens, &splat.quad)
    }
}

impl<const INTEGRATED: bool> Fragment<Splat> for Parallel<INTEGRATED> {
    const PLANES: [usize; 2] = [1, 1];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [item.splat.quad.offset_squared(s, frame, 0, x), zero, zero]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [item.splat.quad.offset_squared(s, frame, 1, y), zero, zero]
    }

    #[inline(always)]
    fn values<S: Simd, const R: usize, const CUT: bool>(
        s: S,
        column: &[S::F; 3],
        rows: &[[f32; R]; 3],
        constants: &Constants,
        pixels: &[Pixel<S::F>; R],
        _: &[f32],
    ) -> [(S::F, S::F); R] {
        let mut values = [(s.splat(constants.amplitude), s.splat(0.0)); R];
        for (r, (value, pixel)) in values.iter_mut().zip(pixels).enumerate() {
            let square = s.add(column[0], s.splat(rows[0][r]));
            value.1 = if CUT {
                // Near plane and surface along z from the centre, in radii.
                let [depth, inverse] = constants.own;
                let limit = s.mul(s.sub(pixel.limit, s.splat(depth)), s.splat(inverse));
                piece::<S, INTEGRATED>(s, square, s.splat(constants.front), limit)
            } else {
                chord::<S, INTEGRATED>(s, square)
            };
        }
        values
    }
}

impl<const INTEGRATED: bool> Alignment for Slanted<INTEGRATED> {
    type Splat = perspective::Splat;
    type Gauss = Self;
    type Radial = Self;
    type Affine = Self;
    const WEIGHTED: bool = true;
    const KEY: Key = Key::Depth;
    const VOLUMETRIC: bool = true;
    const KERNELS: bool = false;

    #[inline]
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, _: bool) -> Option<Prepared<perspective::Splat>> {
        let (depth, near) = (-center.z, lens.view.near);
        let depths = [depth - radius, depth + radius];
        let bounds = lens.ball_bounds(center, radius);
        let front = if depths[0] < near { (near / radius) as f32 } else { f32::NEG_INFINITY };
        Some(Prepared { splat: perspective::Splat::new(center, radius), bounds, depths, front })
    }

    /// The distance of the surface along the ray.
    fn opaque_limit(depth: f64, length_squared: f64) -> f64 {
        depth * length_squared.sqrt()
    }

    #[inline(always)]
    fn constants(splat: &perspective::Splat) -> [f32; 2] {
        [(1.0 / splat.radius()) as f32, 0.0]
    }

    fn rim(splat: &perspective::Splat, lens: &Lens, _: bool) -> Rim {
        splat.rim(lens)
    }
}

impl<const INTEGRATED: bool> Fragment<perspective::Splat> for Slanted<INTEGRATED> {
    const PLANES: [usize; 2] = [2, 3];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<perspective::Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        perspective::Ball::<true>::column(s, item, frame, x)
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<perspective::Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        perspective::Ball::<true>::row(s, item, frame, y)
    }

    #[inline(always)]
    fn values<S: Simd, const R: usize, const CUT: bool>(
        s: S,
        column: &[S::F; 3],
        rows: &[[f32; R]; 3],
        constants: &Constants,
        pixels: &[Pixel<S::F>; R],
        _: &[f32],
    ) -> [(S::F, S::F); R] {
        let mut values = [(s.splat(constants.amplitude), s.splat(0.0)); R];
        for (r, (value, pixel)) in values.iter_mut().zip(pixels).enumerate() {
            let square = s.mul(perspective::cross(s, column, rows, r), pixel.weight);
            value.1 = if CUT {
                // Near plane and surface along the ray from the point nearest the centre, in radii.
                let per_length = s.sqrt(pixel.weight);
                let closest = s.mul(perspective::ahead(s, column, rows, r), per_length);
                let front = s.sub(s.div(s.splat(constants.front), per_length), closest);
                let limit = s.sub(s.mul(pixel.limit, s.splat(constants.own[0])), closest);
                piece::<S, INTEGRATED>(s, square, front, limit)
            } else {
                chord::<S, INTEGRATED>(s, square)
            };
        }
        values
    }
}

impl<const INTEGRATED: bool> Shaded for Parallel<INTEGRATED> {
    const SHADER: &'static [Part] = &[shader::SPHERICAL_PARALLEL, falloff_shader(INTEGRATED)];

    fn projection(&self) -> &'static [Part] {
        match self.quad {
            Quad::Far => &[shader::PROJECT_SPHERICAL_PARALLEL, shader::QUAD_FAR],
            Quad::Centre => &[shader::PROJECT_SPHERICAL_PARALLEL, shader::QUAD_CENTRE],
        }
    }

    fn forms(splat: &Splat, anchor: &Anchor) -> Forms {
        let [x, y] = splat.quad.offsets(anchor.center());
        Forms { x, y, own: splat.depth.into(), inverse: splat.inverse.into(), ..Forms::default() }
    }
}

impl<const INTEGRATED: bool> Shaded for Slanted<INTEGRATED> {
    const SHADER: &'static [Part] = &[shader::SPHERICAL_SLANTED, falloff_shader(INTEGRATED)];

    fn projection(&self) -> &'static [Part] {
        &[shader::PROJECT_SPHERICAL_SLANTED]
    }

    fn forms(splat: &perspective::Splat, anchor: &Anchor) -> Forms {
        Forms { inverse: 1.0 / splat.radius(), ..splat.forms(anchor) }
    }
}

const fn falloff_shader(integrated: bool) -> Part {
    if integrated { shader::INTEGRATED } else { shader::PRINTED }
}

/// Least square of a distance whose logarithm is taken: its product with the logarithm is nothing.
const TINY: f32 = 1e-30;

/// Optical depth over T0 of a whole chord, from the square of its distance over r; 0 beyond the ball.
#[inline(always)]
fn chord<S: Simd, const INTEGRATED: bool>(s: S, square: S::F) -> S::F {
    let one = s.splat(1.0);
    let square = s.min(square, one);
    let half = s.sqrt(s.sub(one, square));
    if INTEGRATED {
        // w - b^2 asinh(w/b), where asinh(w/b) = ln((1 + w)/b).
        let top = s.add(one, half);
        let ratio = s.div(s.mul(top, top), s.max(square, s.splat(TINY)));
        s.neg_mul_add(square, s.mul(log2(s, ratio), s.splat(0.5 * LN_2)), half)
    } else {
        s.neg_mul_add(s.sqrt(square), half, half)
    }
}

/// Optical depth over T0 of the piece of a chord between `front` and `limit`, signed distances over r from its middle.
#[inline(always)]
fn piece<S: Simd, const INTEGRATED: bool>(s: S, square: S::F, front: S::F, limit: S::F) -> S::F {
    let one = s.splat(1.0);
    let square = s.min(square, one);
    let half = s.sqrt(s.sub(one, square));
    let from = s.max(front, s.sub(s.splat(0.0), half));
    let to = s.max(s.min(limit, half), from);
    if INTEGRATED {
        let square = s.max(square, s.splat(TINY));
        let scale = s.mul(log2(s, square), s.splat(0.5));
        s.sub(primitive(s, square, scale, to), primitive(s, square, scale, from))
    } else {
        let root = s.sqrt(square);
        s.mul(s.mul(s.sub(one, root), s.sub(to, from)), s.splat(0.5))
    }
}

/// G(u) = u - [u sqrt(u^2 + b^2) + b^2 asinh(u/b)]/2 from b^2 and log2(b).
#[inline(always)]
fn primitive<S: Simd>(s: S, square: S::F, log2_b: S::F, u: S::F) -> S::F {
    let zero = s.splat(0.0);
    let size = s.max(u, s.sub(zero, u));
    let distance = s.sqrt(s.mul_add(u, u, square));
    // asinh is odd; for u >= 0 it is ln((u + sqrt(u^2 + b^2))/b), which for u < 0 would cancel.
    let asinh = s.mul(s.sub(log2(s, s.add(size, distance)), log2_b), s.splat(LN_2));
    let curved = s.mul_add(size, distance, s.mul(square, asinh));
    let value = s.neg_mul_add(curved, s.splat(0.5), size);
    s.sub(s.keep(s.less(zero, u), value), s.keep(s.less(u, zero), value))
}
