//! `perspective`: the exact projection of each ball.
//!
//! A fragment is the kernel's footprint F at the perpendicular distance b from the pixel's ray to the particle's centre,
//! which is what a full line through the kernel integrates to: right for every direction, off axis and close by, where
//! both kinds of billboard are not. With c the centre and `dir` (z = -1) the ray from the eye at the origin,
//! b^2 = |c x dir|^2 / |dir|^2, formed from the cross product because the difference |c|^2 - (c . dir)^2 / |dir|^2 loses
//! digits. A ray shows the ball where it meets it: b < r, and c . dir > 0 unless the eye is inside the ball.
//!
//! Error: overlapping particles are composited one behind the other though they mix, and balls are not clipped by the near
//! plane. Order: by distance from its own eye. Opaque surfaces cut a fragment at the middle of its chord, the ray's point
//! nearest the centre.

use crate::render::cpu::footprint::{gaussian_ball, tabulated};
use crate::render::cpu::order::Key;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::simd::Simd;
use crate::render::cpu::splat::{Alignment, Constants, Fragment, Frame, Item, Lens, Pixel, Prepared};
use crate::render::gpu::shader::{self, Part};
use crate::render::gpu::splat::{Anchor, Forms, Shaded};
use glam::DVec3;

/// The method.
#[derive(Clone, Copy)]
pub struct Perspective;

/// A prepared ball.
#[derive(Clone, Copy, Default)]
pub struct Splat {
    /// Centre over radius, eye space.
    center: DVec3,
    radius: f64,
}

impl Alignment for Perspective {
    type Splat = Splat;
    type Gauss = Ball<true>;
    type Radial = Ball<false>;
    const WEIGHTED: bool = true;
    const KEY: Key = Key::Distance;

    #[inline]
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, _: bool) -> Option<Prepared<Splat>> {
        let depth = -center.z;
        let bounds = lens.ball_bounds(center, radius);
        let splat = Splat::new(center, radius);
        // While the whole ball is in front of the eye plane, no ray of the picture meets its mirror image behind.
        let front = if depth > radius || center.length_squared() <= radius * radius { f32::NEG_INFINITY } else { 0.0 };
        Some(Prepared { splat, bounds, depths: [depth - radius, depth + radius], front })
    }

    fn opaque_limit(depth: f64, length_squared: f64) -> f64 {
        depth * length_squared
    }

    #[inline(always)]
    fn constants(splat: &Splat) -> [f32; 2] {
        [splat.radius as f32, 0.0]
    }

    fn rim(splat: &Splat, lens: &Lens, _: bool) -> Rim {
        splat.rim(lens)
    }
}

impl Shaded for Perspective {
    const SHADER: &'static [Part] = &[shader::PERSPECTIVE];

    fn projection(&self) -> &'static [Part] {
        &[shader::PROJECT_PERSPECTIVE]
    }

    fn forms(splat: &Splat, anchor: &Anchor) -> Forms {
        Forms { own: splat.radius, ..splat.forms(anchor) }
    }
}

impl Splat {
    /// The ball of an eye-space centre.
    #[inline]
    pub(super) fn new(center: DVec3, radius: f64) -> Self {
        Self { center: center / radius, radius }
    }

    /// The components of c x dir over the radius: of the column, of the row and of both; ahead: c . dir over the radius.
    pub(super) fn forms(&self, anchor: &Anchor) -> Forms {
        let c = self.center;
        let [across, x_step, _] = anchor.form([c.z, 0.0], c.x);
        let [along, _, y_step] = anchor.form([0.0, -c.z], -c.y);
        Forms {
            x: [across, x_step],
            y: [along, y_step],
            both: anchor.form([-c.y, c.x], 0.0),
            ahead: anchor.form([c.x, c.y], -c.z),
            ..Forms::default()
        }
    }

    /// Its outline.
    pub(super) fn rim(&self, lens: &Lens) -> Rim {
        Rim::ball(lens, self.center, 1.0)
    }

    /// Its radius.
    #[inline]
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }
}

/// Fragments: `GAUSSIAN` by a polynomial, else by table.
#[derive(Clone, Copy)]
pub struct Ball<const GAUSSIAN: bool>;

impl<const GAUSSIAN: bool> Fragment<Splat> for Ball<GAUSSIAN> {
    const PLANES: usize = 3;

    // With c over r and d = -c_z: c x dir = (d Y - c_y, c_x - d X, c_x Y - c_y X). The first depends on the row alone, the
    // second on the column alone, the third is a difference of the two; its constant term at the tile's corner is kept in
    // the row's part, so that both parts stay small.
    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let (c, at, step) = (item.splat.center, frame.tangent[0], frame.step[0]);
        let across = s.mul_add(x, s.splat((c.z * step) as f32), s.splat((c.x + c.z * at) as f32));
        let twist = s.mul(x, s.splat((c.y * step) as f32));
        let front = s.mul_add(x, s.splat((c.x * step) as f32), s.splat((c.x * at - c.z) as f32));
        [s.mul(across, across), twist, front]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let (c, at, step) = (item.splat.center, frame.tangent, frame.step[1]);
        let along = s.mul_add(y, s.splat((-c.z * step) as f32), s.splat((-c.z * at[1] - c.y) as f32));
        let twist = s.mul_add(y, s.splat((c.x * step) as f32), s.splat((c.x * at[1] - c.y * at[0]) as f32));
        let front = s.mul_add(y, s.splat((c.y * step) as f32), s.splat((c.y * at[1]) as f32));
        [s.mul(along, along), twist, front]
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
        let mut footprints = [s.splat(0.0); R];
        for (r, (footprint, pixel)) in footprints.iter_mut().zip(pixels).enumerate() {
            let twist = s.sub(s.splat(rows[1][r]), column[1]);
            let cross = s.mul_add(twist, twist, s.add(column[0], s.splat(rows[0][r])));
            *footprint = if GAUSSIAN {
                s.neg_mul_add(cross, pixel.weight, s.splat(1.0))
            } else {
                tabulated(s, s.mul(cross, pixel.weight), constants.table, constants.most, tables)
            };
        }
        if GAUSSIAN {
            footprints = gaussian_ball(s, footprints);
        }
        if CUT {
            for (r, (footprint, pixel)) in footprints.iter_mut().zip(pixels).enumerate() {
                // c . dir in units of the radius; the depth of the point nearest the centre is that over |dir|^2.
                let front = s.add(column[2], s.splat(rows[2][r]));
                let middle = s.mul(front, s.splat(constants.own[0]));
                let seen = s.and(s.less(s.splat(constants.front), front), s.less(middle, pixel.limit));
                *footprint = s.keep(seen, *footprint);
            }
        }
        let mut values = [(s.splat(constants.amplitude), footprints[0]); R];
        for (value, &footprint) in values.iter_mut().zip(&footprints) {
            value.1 = footprint;
        }
        values
    }
}
