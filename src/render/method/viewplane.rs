//! `viewplane`: billboards parallel to the view plane (Johnson & McAllister 2005, section 2).
//!
//! The billboard of a particle stands in the plane z = C_z with its axes along camera x and y. A Gaussian shows
//! exp(-4.5 (a^2 + b^2)) on the whole square |a|, |b| < 1 ((a, b) the offset over the radius), which is separable: one
//! table per column and one per row leave a product per fragment. Other kernels show F(sqrt(a^2 + b^2)) on the disc.
//!
//! Error: away from the optical axis the ball's true projection is an ellipse that this disc falls short of, by
//! 1 - cos(theta) in the radial direction; all fragments have the disparity of the centre. Order: by depth, shared by eyes
//! with parallel axes. Opaque surfaces cut it at the depth of the centre.

use crate::render::cpu::footprint::{GAUSSIAN_LOG2, tabulated};
use crate::render::cpu::order::Key;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::simd::{Simd, exp2_neg};
use crate::render::cpu::splat::{Alignment, Card, Constants, Fragment, Frame, Item, Lens, Pixel, Prepared};
use crate::render::gpu::shader::{self, Part};
use crate::render::gpu::splat::{Anchor, Forms, Shaded};
use glam::DVec3;

/// The method.
#[derive(Clone, Copy)]
pub struct Viewplane;

/// A prepared billboard.
#[derive(Clone, Copy, Default)]
pub struct Splat {
    card: Card,
    depth: f32,
}

impl Alignment for Viewplane {
    type Splat = Splat;
    type Gauss = Separable;
    type Radial = Disc;
    type Affine = Separable;
    const WEIGHTED: bool = false;
    const KEY: Key = Key::Depth;

    #[inline]
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, _: bool) -> Option<Prepared<Splat>> {
        let depth = -center.z;
        let (card, bounds) = Card::new(lens, center, radius, depth);
        let splat = Splat { card, depth: depth as f32 };
        Some(Prepared { splat, bounds, depths: [depth; 2], front: f32::NEG_INFINITY })
    }

    fn opaque_limit(depth: f64, _: f64) -> f64 {
        depth
    }

    #[inline(always)]
    fn constants(splat: &Splat) -> [f32; 2] {
        [splat.depth, 0.0]
    }

    fn rim(splat: &Splat, lens: &Lens, square: bool) -> Rim {
        if square { Rim::NONE } else { Rim::card(lens, &splat.card) }
    }
}

impl Shaded for Viewplane {
    const SHADER: &'static [Part] = &[shader::VIEWPLANE];

    fn projection(&self) -> &'static [Part] {
        &[shader::PROJECT_VIEWPLANE]
    }

    fn forms(splat: &Splat, anchor: &Anchor) -> Forms {
        let [x, y] = splat.card.offsets(anchor.center());
        Forms { x, y, own: splat.depth.into(), ..Forms::default() }
    }
}

#[inline(always)]
fn cut<S: Simd, const CUT: bool>(s: S, value: S::F, constants: &Constants, pixel: &Pixel<S::F>) -> S::F {
    if CUT { s.keep(s.less(s.splat(constants.own[0]), pixel.limit), value) } else { value }
}

/// Fragments of the Gaussian: a product of a column's and a row's factor.
#[derive(Clone, Copy)]
pub struct Separable;

/// exp(-4.5 a^2) where |a| < 1, else 0.
#[inline(always)]
fn factor<S: Simd>(s: S, square: S::F) -> S::F {
    s.keep(s.less(square, s.splat(1.0)), exp2_neg(s, s.mul(square, s.splat(GAUSSIAN_LOG2))))
}

impl Fragment<Splat> for Separable {
    const PLANES: [usize; 2] = [1, 1];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [s.mul(factor(s, item.splat.card.offset_squared(s, frame, 0, x)), s.splat(item.amplitude)), zero, zero]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [factor(s, item.splat.card.offset_squared(s, frame, 1, y)), zero, zero]
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
        let mut values = [(column[0], s.splat(0.0)); R];
        for (r, (value, pixel)) in values.iter_mut().zip(pixels).enumerate() {
            value.1 = cut::<S, CUT>(s, s.splat(rows[0][r]), constants, pixel);
        }
        values
    }
}

/// Fragments of every other kernel: its footprint at the distance from the centre.
#[derive(Clone, Copy)]
pub struct Disc;

impl Fragment<Splat> for Disc {
    const PLANES: [usize; 2] = [1, 1];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [item.splat.card.offset_squared(s, frame, 0, x), zero, zero]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let zero = s.splat(0.0);
        [item.splat.card.offset_squared(s, frame, 1, y), zero, zero]
    }

    #[inline(always)]
    fn values<S: Simd, const R: usize, const CUT: bool>(
        s: S,
        column: &[S::F; 3],
        rows: &[[f32; R]; 3],
        constants: &Constants,
        pixels: &[Pixel<S::F>; R],
        tables: &[f32],
    ) -> [(S::F, S::F); R] {
        let mut values = [(s.splat(constants.amplitude), s.splat(0.0)); R];
        for (r, (value, pixel)) in values.iter_mut().zip(pixels).enumerate() {
            let square = s.add(column[0], s.splat(rows[0][r]));
            let footprint = tabulated(s, square, constants.table, constants.most, tables);
            value.1 = cut::<S, CUT>(s, footprint, constants, pixel);
        }
        values
    }
}
