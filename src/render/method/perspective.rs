//! `perspective`: the exact projection of each ball.
//!
//! A fragment is the kernel's footprint F at the perpendicular distance b from the pixel's ray to the particle's centre,
//! which is what a full line through the kernel integrates to: right for every direction, off axis and close by, where
//! both kinds of billboard are not. With c the centre and `dir` (z = -1) the ray from the eye at the origin,
//! b^2 = |c x dir|^2 / |dir|^2, formed as a sum of two squares because the difference |c|^2 - (c . dir)^2 / |dir|^2 loses
//! digits. A ray shows the ball where it meets it: b < r, and c . dir > 0 unless the eye is inside the ball.
//!
//! Where that is exact enough, `auto` has small balls drawn by products of columns and rows instead ([`Affine`]).
//!
//! Error: overlapping particles are composited one behind the other though they mix, and balls are not clipped by the near
//! plane. Order: by distance from its own eye. Opaque surfaces cut a fragment at the middle of its chord, the ray's point
//! nearest the centre.

use crate::render::cpu::footprint::{GAUSSIAN_LOG2, gaussian_ball, tabulated};
use crate::render::cpu::order::Key;
use crate::render::cpu::rim::Rim;
use crate::render::cpu::simd::{Simd, exp2_neg};
use crate::render::cpu::splat::{Alignment, Constants, Fragment, Frame, Item, Lens, Pixel, Prepared};
use crate::render::gpu::shader::{self, Part};
use crate::render::gpu::splat::{Anchor, Forms, Shaded};
use glam::{DVec2, DVec3, swizzles::Vec3Swizzles};

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
    type Affine = Affine;
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

    #[inline]
    fn affine_error(splat: &Splat) -> f64 {
        affine_error(splat.center)
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
    const PLANES: [usize; 2] = [2, 3];

    // With c over r, (c_y, c_z) = m u and |u| = 1: (-m, c_x u_y, c_x u_z) and (0, u_z, -u_y) |c| are as long as c and, with it,
    // orthogonal to each other, so that |c x dir|^2 is the sum of the squares of their products with dir. The second depends on the row
    // alone. The constant term of the first at the tile's corner is kept in the row's part, so that both parts stay small.
    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let (c, at, step) = (item.splat.center, frame.tangent[0], frame.step[0]);
        let across = s.mul(x, s.splat((-c.yz().length() * step) as f32));
        let front = s.mul_add(x, s.splat((c.x * step) as f32), s.splat((c.x * at - c.z) as f32));
        [across, front, s.splat(0.0)]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let (c, at, step) = (item.splat.center, frame.tangent, frame.step[1]);
        let [m, length] = [c.yz().length(), c.length()];
        // Any direction serves the ball's own axis.
        let [u_y, u_z] = c.yz().normalize_or(DVec2::NEG_Y).to_array();
        let constant = c.x * (u_y * at[1] - u_z) - m * at[0];
        let across = s.mul_add(y, s.splat((c.x * u_y * step) as f32), s.splat(constant as f32));
        let along = s.mul_add(y, s.splat((length * u_z * step) as f32), s.splat((length * (u_z * at[1] + u_y)) as f32));
        let front = s.mul_add(y, s.splat((c.y * step) as f32), s.splat((c.y * at[1]) as f32));
        [across, s.mul(along, along), front]
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
            let cross = cross(s, column, rows, r);
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
                let front = ahead(s, column, rows, r);
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

/// |c x dir|^2 of a pixel, c over the radius.
#[inline(always)]
pub(super) fn cross<S: Simd, const R: usize>(s: S, column: &[S::F; 3], rows: &[[f32; R]; 3], row: usize) -> S::F {
    let across = s.add(column[0], s.splat(rows[0][row]));
    s.mul_add(across, across, s.splat(rows[1][row]))
}

/// c . dir of a pixel, c over the radius.
#[inline(always)]
pub(super) fn ahead<S: Simd, const R: usize>(s: S, column: &[S::F; 3], rows: &[[f32; R]; 3], row: usize) -> S::F {
    s.add(column[1], s.splat(rows[2][row]))
}

/// Fragments of small Gaussians, taken for affine: as if all rays through the ball had the length of the one through its centre.
///
/// With c over the radius and t the tangents from that ray's, u^2 = |c x (t, 0)|^2 (c_z / |c|)^2 is a quadratic form then, and
/// exp(-4.5 u^2) a product of a column's and a row's factor and of exp(z t_x t_y), of whose series three terms are taken. F itself is
/// that Gaussian less what the ball's end takes from it, for which a constant stands: max(0, `SCALE` g - `FLOOR`).
#[derive(Clone, Copy)]
pub struct Affine;

/// Minimax on the ball for F: off by 0.003396.
const SCALE: f32 = 1.011_19;
const FLOOR: f32 = 0.007_837;

/// The most that [`Affine`] is off, as a share of the optical depth through the centre: `center` is over the radius, in eye space. The
/// terms are of the constant, of the series' next term, and, two, of rays of other lengths than the one through the centre, by which
/// the ball's outline is no ellipse around it. Factors are those of the worst directions, rounded up. Infinite where rays are too slanted
/// or the ball is too near for that to be small.
#[inline]
fn affine_error(center: DVec3) -> f64 {
    let [x, y, depth] = [center.x * center.x, center.y * center.y, center.z * center.z];
    // Tangents of the angle from the axis and, but for a cube, of half the one that the ball subtends.
    let slant = (x + y) / depth;
    let angle = 1.0 / (x + y + depth);
    let turn = (x * y / ((depth + x) * (depth + y))).sqrt();
    // Such balls would be off by more than anyone allows.
    if !(center.z < 0.0 && slant <= 2.0 && angle <= 0.02 && turn <= 0.3) {
        return f64::INFINITY;
    }
    let bend = turn / (1.0 - turn);
    0.003_45 + 0.25 * bend * bend * bend + 0.42 * (angle * slant).sqrt() + 0.2 * angle * (1.0 + slant)
}

impl Affine {
    /// Tangents from the ray through the centre, along an axis, and the Gaussian's factor there.
    #[inline(always)]
    fn factor<S: Simd>(s: S, center: DVec3, frame: &Frame, axis: usize, at: S::F) -> [S::F; 2] {
        let (c, depth) = (center.to_array(), center.z * center.z);
        let (middle, other) = (c[axis] / -center.z, c[1 - axis]);
        let t = s.mul_add(at, s.splat(frame.step[axis] as f32), s.splat((frame.tangent[axis] - middle) as f32));
        let rate = f64::from(GAUSSIAN_LOG2) * (depth + other * other) * depth / center.length_squared();
        // Next to nothing in place of what is too small for products with it to be normal numbers, which are slow.
        let exponent = s.min(s.mul(s.mul(t, t), s.splat(rate as f32)), s.splat(40.0));
        [t, exp2_neg(s, exponent)]
    }
}

impl Fragment<Splat> for Affine {
    const PLANES: [usize; 2] = [3, 3];

    #[inline(always)]
    fn column<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, x: S::F) -> [S::F; 3] {
        let c = item.splat.center;
        let [t, factor] = Self::factor(s, c, frame, 0, x);
        let peak = s.mul(factor, s.splat(SCALE));
        // 9 c_x c_y (c_z / c)^2 t_x t_y is left of -4.5 u^2.
        let turn = s.mul(t, s.splat((9.0 * c.x * c.y * c.z * c.z / c.length_squared()) as f32));
        let first = s.mul(peak, turn);
        [peak, first, s.mul(s.mul(first, turn), s.splat(0.5))]
    }

    #[inline(always)]
    fn row<S: Simd>(s: S, item: &Item<Splat>, frame: &Frame, y: S::F) -> [S::F; 3] {
        let [t, peak] = Self::factor(s, item.splat.center, frame, 1, y);
        let first = s.mul(peak, t);
        [peak, first, s.mul(first, t)]
    }

    #[inline(always)]
    fn values<S: Simd, const R: usize, const CUT: bool>(
        s: S,
        column: &[S::F; 3],
        rows: &[[f32; R]; 3],
        constants: &Constants,
        _: &[Pixel<S::F>; R],
        _: &[f32],
    ) -> [(S::F, S::F); R] {
        let mut values = [(s.splat(constants.amplitude), s.splat(0.0)); R];
        for (r, value) in values.iter_mut().enumerate() {
            let mut footprint = s.mul_add(column[0], s.splat(rows[0][r]), s.splat(-FLOOR));
            footprint = s.mul_add(column[1], s.splat(rows[1][r]), footprint);
            footprint = s.mul_add(column[2], s.splat(rows[2][r]), footprint);
            value.1 = s.max(footprint, s.splat(0.0));
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::random::Random;
    use crate::render::cpu::simd::{Level, WithSimd, dispatch};
    use crate::scene::Kernel;

    const SIZE: usize = 64;

    /// Affine footprints of a ball in a tile.
    struct Draw<'a>(&'a Item<Splat>, &'a Frame);

    impl WithSimd for Draw<'_> {
        type Output = Vec<f32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Vec<f32> {
            let Self(item, frame) = self;
            let pixel = Pixel { weight: s.splat(f32::NAN), limit: s.splat(f32::NAN) };
            let constants = Constants { amplitude: 0.5, ..Constants::default() };
            let mut values = vec![0.0; SIZE * SIZE];
            for block in 0..SIZE / S::LANES {
                let at = |i: usize| s.add(s.ramp(), s.splat((i * S::LANES) as f32 + 0.5));
                let column = Affine::column(s, item, frame, at(block));
                for group in 0..SIZE / S::LANES {
                    let mut lanes = [[0.0; 16]; 3];
                    for (lanes, plane) in lanes.iter_mut().zip(Affine::row(s, item, frame, at(group))) {
                        s.store(plane, lanes);
                    }
                    for lane in 0..S::LANES {
                        let rows = lanes.map(|lanes| [lanes[lane]]);
                        let [(a, b)] = Affine::values::<S, 1, false>(s, &column, &rows, &constants, &[pixel], &[]);
                        s.store(s.mul(a, b), &mut values[(group * S::LANES + lane) * SIZE + block * S::LANES..]);
                    }
                }
            }
            values
        }
    }

    /// Balls in all directions, tiny to large: no pixel is off by more than is said, in the ball or around it, and most balls by not
    /// much less.
    #[test]
    fn affine_footprints_are_off_by_no_more_than_is_said() {
        let mut random = Random(11);
        let mut random = |low: f64, high: f64| random.uniform(low, high);
        let mut tight = 0;
        let mut asked = 0;
        for _ in 0..400 {
            let (slant, turn) = (random(0.0, 1.3), random(0.0, std::f64::consts::TAU));
            let angle = 10f64.powf(random(-4.0, -0.9));
            let direction = DVec3::new(slant * turn.cos(), slant * turn.sin(), -1.0);
            // The sine of half the angle that it subtends is 1 over the distance in radii.
            let center = direction.normalize() / angle;
            let said = affine_error(center);
            if said > 0.1 {
                continue;
            }
            asked += 1;
            let step = angle * (1.0 + slant * slant) / 24.0;
            let corner = [
                direction.x - step * (SIZE as f64 / 2.0 + random(-0.5, 0.5)),
                direction.y + step * (SIZE as f64 / 2.0 + random(-0.5, 0.5)),
            ];
            let frame = Frame { corner: [0.0; 2], tangent: corner, step: [step, -step] };
            let item = Item { splat: Splat { center, radius: 1.0 }, ..Item::default() };
            for level in Level::available() {
                let drawn = dispatch(level, Draw(&item, &frame));
                let mut worst = 0.0f64;
                for (i, &value) in drawn.iter().enumerate() {
                    let [x, y] = [i % SIZE, i / SIZE].map(|at| at as f64 + 0.5);
                    let ray = DVec3::new(corner[0] + x * step, corner[1] - y * step, -1.0);
                    let u = center.cross(ray).length() / ray.length();
                    let want = if u < 1.0 { Kernel::Gaussian.footprint(u) } else { 0.0 };
                    worst = worst.max((f64::from(value) / 0.5 - want).abs());
                }
                // Sums in single precision.
                assert!(worst <= said + 2e-6, "{level}: {worst} of {said}, {center}");
                tight += usize::from(worst > 0.7 * said);
            }
        }
        assert!(asked > 150, "{asked}");
        assert!(2 * tight > asked * Level::available().len(), "{tight} of {asked}");
    }

    #[test]
    fn balls_that_are_near_or_beside_the_eye_are_not_affine() {
        for center in
            [DVec3::new(0.0, 0.0, -3.0), DVec3::new(0.0, 0.0, 50.0), DVec3::new(90.0, 0.0, -20.0), DVec3::ZERO]
        {
            assert_eq!(affine_error(center), f64::INFINITY, "{center}");
        }
        assert!(affine_error(DVec3::new(0.0, 0.0, -1e4)) < 0.003_5);
    }
}
