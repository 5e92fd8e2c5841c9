//! `viewpoint`: billboards through the centre that face their own eye (Johnson & McAllister 2005, section 2).
//!
//! With the eye V at the origin and C the centre, the billboard's axes are u = (0, 1, 0) x (V - C), normalised, and
//! v = n x u with n = (V - C)/|V - C|. A ray `dir` (z = -1) meets its plane at depth t = |C|^2 / (C . dir), at the offsets
//! a = t (dir . u)/r, b = t (dir . v)/r. (The paper prints -C_x for the third component of u, which is not orthogonal to
//! V - C; its own cross product gives +C_x.)
//!
//! Error: the footprint is looked up at |C| tan(theta) where the ball's is at |C| sin(theta). Order: by distance from its
//! own eye. Opaque surfaces cut it at the depth of the billboard's plane, per pixel.

use crate::render::cpu::footprint::{gaussian_card, tabulated};
use crate::render::cpu::order::Key;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::simd::Simd;
use crate::render::cpu::splat::{Alignment, Bounds, Constants, Fragment, Frame, Item, Lens, Pixel, Prepared};
use crate::render::gpu::shader::{self, Part};
use crate::render::gpu::splat::{Anchor, Forms, Shaded};
use glam::DVec3;

/// The method.
#[derive(Clone, Copy)]
pub struct Viewpoint;

/// A prepared billboard. `a`, `b` and `front` are linear forms of a ray's direction, x, y and constant term, over |C|: so that their squares
/// are about 1 in any unit.
#[derive(Clone, Copy, Default)]
pub struct Splat {
    /// |C| (dir . u)/r; u has no y component.
    a: [f64; 2],
    /// |C| (dir . v)/r.
    b: [f64; 3],
    /// (C . dir)/|C|.
    front: [f64; 3],
    /// |C|.
    distance: f64,
}

impl Alignment for Viewpoint {
    type Splat = Splat;
    type Gauss = Card<true>;
    type Radial = Card<false>;
    type Affine = Card<true>;
    const WEIGHTED: bool = false;
    const KEY: Key = Key::Distance;

    #[inline]
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, square: bool) -> Option<Prepared<Splat>> {
        let size = lens.view.size;
        let depth = -center.z;
        let toward = -center;
        let u = DVec3::Y.cross(toward).normalize();
        let normal = toward.normalize();
        let v = normal.cross(u);
        let distance = center.length();
        let scale = distance / radius;
        let (du, dv) = (u * scale, v * scale);
        let front = [-normal.x, -normal.y, normal.z];
        let splat = Splat { a: [du.x, -du.z], b: [dv.x, dv.y, -dv.z], front, distance };
        // Nothing of the card is farther from the centre than its corner (the disc: its edge), and nothing of it is
        // nearer in depth than that allows.
        let reach = radius * if square { std::f64::consts::SQRT_2 } else { 1.0 };
        let tilt = reach * (1.0 - normal.z * normal.z).max(0.0).sqrt();
        let depths = [depth - tilt, depth + tilt];
        let corners =
            [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].map(|[a, b]| center + (u * a + v * b) * radius);
        // A card that reaches behind the eye may cover any pixel, and its plane may be met behind the eye.
        let behind = corners.iter().any(|corner| -corner.z < 1e-3 * depth);
        let bounds = if behind {
            Bounds { x: [0, size[0] - 1], y: [0, size[1] - 1] }
        } else {
            let (mut low, mut high) = (glam::DVec2::INFINITY, glam::DVec2::NEG_INFINITY);
            for corner in corners {
                let at = lens.picture(corner.x / -corner.z, corner.y / -corner.z);
                (low, high) = (low.min(at), high.max(at));
            }
            Bounds::from_intervals([low.x, high.x], [low.y, high.y], size)
        };
        Some(Prepared { splat, bounds, depths, front: if behind { 0.0 } else { f32::NEG_INFINITY } })
    }

    fn opaque_limit(depth: f64, _: f64) -> f64 {
        depth
    }

    #[inline(always)]
    fn constants(splat: &Splat) -> [f32; 2] {
        [splat.distance as f32, 0.0]
    }

    fn rim(splat: &Splat, lens: &Lens, square: bool) -> Rim {
        if square {
            return Rim::NONE;
        }
        let [x, y, depth] = splat.front.map(|part| part * splat.distance);
        // |C|/r is the length of `a`.
        let radius = splat.distance / (splat.a[0] * splat.a[0] + splat.a[1] * splat.a[1]).sqrt();
        Rim::facing(lens, DVec3::new(x, y, -depth), radius * radius)
    }
}

impl Shaded for Viewpoint {
    const SHADER: &'static [Part] = &[shader::VIEWPOINT];

    fn projection(&self) -> &'static [Part] {
        &[shader::PROJECT_VIEWPOINT]
    }

    fn forms(splat: &Splat, anchor: &Anchor) -> Forms {
        let Splat { a, b, front, distance } = splat;
        let [x, step, _] = anchor.form([a[0], 0.0], a[1]);
        Forms {
            x: [x, step],
            both: anchor.form([b[0], b[1]], b[2]),
            ahead: anchor.form([front[0], front[1]], front[2]),
            own: *distance,
            ..Forms::default()
        }
    }
}

/// Fragments: `SQUARE` is the Gaussian on the whole card, else a kernel's footprint on the disc.
#[derive(Clone, Copy)]
pub struct Card<const SQUARE: bool>;

/// slope (at + step p) + constant: a linear form of the tangent at pixels p of a tile.
#[inline(always)]
fn line<S: Simd>(s: S, p: S::F, at: f64, step: f64, slope: f64, constant: f64) -> S::F {
    s.mul_add(p, s.splat((slope * step) as f32), s.splat((slope * at + constant) as f32))
}

impl<const SQUARE: bool> Fragment<Splat> for Card<SQUARE> {
    const PLANES: [usize; 2] = [3, 2];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let Splat { a, b, front, .. } = &item.splat;
        let (at, step) = (frame.tangent[0], frame.step[0]);
        let a = line(s, x, at, step, a[0], a[1]);
        [s.mul(a, a), s.mul(x, s.splat((b[0] * step) as f32)), line(s, x, at, step, front[0], 0.0)]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let Splat { b, front, .. } = &item.splat;
        let (at, step) = (frame.tangent[1], frame.step[1]);
        // b is a difference of two large numbers: its constant at the tile's corner is formed here, in f64, for the
        // column's part too.
        let constant = b[2] + b[0] * frame.tangent[0];
        [line(s, y, at, step, b[1], constant), line(s, y, at, step, front[1], front[2]), s.splat(0.0)]
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
        // Offsets times `front`, and that: one division serves both squares.
        let [mut fronts, mut across] = [[s.splat(0.0); R]; 2];
        let mut footprints = [s.splat(0.0); R];
        for (r, footprint) in footprints.iter_mut().enumerate() {
            fronts[r] = s.add(column[2], s.splat(rows[1][r]));
            let b = s.add(column[1], s.splat(rows[0][r]));
            across[r] = s.mul(b, b);
            *footprint = s.div(s.add(column[0], across[r]), s.mul(fronts[r], fronts[r]));
        }
        if SQUARE {
            footprints = gaussian_card(s, footprints);
        } else {
            for footprint in &mut footprints {
                *footprint = tabulated(s, *footprint, constants.table, constants.most, tables);
            }
        }
        let mut values = [(s.splat(constants.amplitude), s.splat(0.0)); R];
        for (r, value) in values.iter_mut().enumerate() {
            let front = fronts[r];
            value.1 = footprints[r];
            if SQUARE {
                let is_inside = s.less(s.max(column[0], across[r]), s.mul(front, front));
                value.1 = s.keep(is_inside, value.1);
            }
            if CUT {
                let depth = s.div(s.splat(constants.own[0]), front);
                let seen = s.and(s.less(s.splat(constants.front), front), s.less(depth, pixels[r].limit));
                value.1 = s.keep(seen, value.1);
            }
        }
        values
    }
}
