//! The outlines of particles: ellipses.

use super::simd::Simd;
use super::splat::{Card, Lens};
use glam::DVec3;

/// The ellipse that a particle shows nothing beyond, in picture coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Rim {
    center: [f64; 2],
    /// Half of its extent along x and y.
    half: [f64; 2],
    /// Slope, in halves of the extent, of the line through the points farthest left and right: -1 to 1.
    turn: f64,
    /// In pixels: no rounding, here or where pixels are drawn, is as large.
    slack: f64,
}

impl Rim {
    /// Beyond everything.
    pub const NONE: Self = Self { center: [0.0; 2], half: [f64::INFINITY; 2], turn: 0.0, slack: 0.0 };

    fn new(lens: &Lens, center: [f64; 2], half: [f64; 2], turn: f64) -> Self {
        let origin = lens.center.to_array();
        let far = [0, 1].map(|axis| (center[axis] - origin[axis]).abs() + half[axis] + 0.1 * origin[axis].abs());
        Self { center, half, turn, slack: 0.1 + 1e-5 * (far[0] + far[1]) }
    }

    /// That of a disc parallel to the view plane.
    pub fn card(lens: &Lens, card: &Card) -> Self {
        let [center, half] = card.extent();
        Self::new(lens, center, half, 0.0)
    }

    /// That of a ball with an eye-space centre and the square of its radius: with tangents t, c the centre and d its depth,
    /// the ellipse (|c|^2 - r^2) |(t, 1)|^2 = (c . (t, 1))^2, as long as the ball is well before the eye plane.
    pub fn ball(lens: &Lens, center: DVec3, square: f64) -> Self {
        let [x, y, depth] = [center.x, center.y, -center.z];
        let beyond = depth * depth - square;
        if !(depth > 0.0 && beyond > 0.1 * depth * depth) {
            return Self::NONE;
        }
        let squares = [x * x + beyond, y * y + beyond];
        let middle = lens.picture(x * depth / beyond, y * depth / beyond);
        let radius = square.sqrt() / beyond;
        let half = [lens.focal.x * radius * squares[0].sqrt(), lens.focal.y * radius * squares[1].sqrt()];
        // Rows count downwards.
        Self::new(lens, middle.to_array(), half, -x * y / (squares[0] * squares[1]).sqrt())
    }

    /// That of a disc that faces the eye: the cone of directions to it is that of a ball.
    pub fn facing(lens: &Lens, center: DVec3, square: f64) -> Self {
        let far = center.length_squared();
        Self::ball(lens, center, square * far / (far + square))
    }

    /// What is within it between two heights, along x; grown.
    pub fn columns(&self, [top, bottom]: [f64; 2]) -> Option<[f64; 2]> {
        let [top, bottom] = [top - self.slack, bottom + self.slack].map(|y| (y - self.center[1]) / self.half[1]);
        if top > 1.0 || bottom < -1.0 {
            return None;
        }
        let (top, bottom) = (top.max(-1.0), bottom.min(1.0));
        let root = (1.0 - self.turn * self.turn).max(0.0).sqrt();
        // Of the ellipse u = turn v -+ root sqrt(1 - v^2) the point farthest to that side, or nearest to it.
        let end = |side: f64| {
            let v = (side * self.turn).clamp(top, bottom);
            let u = self.turn * v + side * root * (1.0 - v * v).max(0.0).sqrt();
            self.center[0] + self.half[0] * u + side * self.slack
        };
        Some([end(-1.0), end(1.0)])
    }

    /// Whether it leaves nothing out.
    pub fn is_none(&self) -> bool {
        self.half[0].is_infinite()
    }

    /// As [`Rim::columns`], each lane for `height` pixels from a height of its own, in the coordinates of a corner of pixels: the ends,
    /// and where there is anything within.
    #[inline(always)]
    pub fn spans<S: Simd>(&self, s: S, corner: [f64; 2], tops: S::F, height: f32) -> ([S::F; 2], S::M) {
        let [x, y] = [(self.center[0] - corner[0]) as f32, (self.center[1] - corner[1]) as f32];
        let ([half, tall], turn, slack) =
            ([self.half[0] as f32, self.half[1] as f32], self.turn as f32, self.slack as f32);
        let (one, zero, scale) = (s.splat(1.0), s.splat(0.0), s.splat(1.0 / tall));
        let top = s.mul(s.sub(tops, s.splat(y + slack)), scale);
        let bottom = s.mul(s.sub(tops, s.splat(y - slack - height)), scale);
        let is_met = s.and(s.less(top, one), s.less(s.splat(-1.0), bottom));
        let (top, bottom) = (s.max(top, s.splat(-1.0)), s.min(bottom, one));
        let root = s.splat((1.0 - turn * turn).max(0.0).sqrt());
        let mut ends = [one; 2];
        for (end, side) in ends.iter_mut().zip([-1.0, 1.0]) {
            let v = s.min(s.max(s.splat(side * turn), top), bottom);
            let across = s.mul(root, s.sqrt_near(s.max(s.neg_mul_add(v, v, one), zero)));
            let u = s.mul_add(across, s.splat(side), s.mul(v, s.splat(turn)));
            *end = s.mul_add(u, s.splat(half), s.splat(x + side * slack));
        }
        (ends, is_met)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::simd::{Level, WithSimd, dispatch};
    use crate::scene::{Camera, Scene};

    /// The ends at the heights of a tile's rows of blocks, four pixels each.
    struct Spans<'a>(&'a Rim, [f64; 2]);

    impl WithSimd for Spans<'_> {
        type Output = Vec<Option<[f32; 2]>>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Self::Output {
            let mut out = Vec::new();
            for row in (0..16).step_by(S::LANES) {
                let tops = s.mul_add(s.add(s.ramp(), s.splat(row as f32)), s.splat(4.0), s.splat(0.5));
                let ([low, high], is_met) = self.0.spans(s, self.1, tops, 3.0);
                let mut lanes = [[0.0; 16]; 3];
                for (lanes, vector) in lanes.iter_mut().zip([low, high, s.keep(is_met, s.splat(1.0))]) {
                    s.store(vector, lanes);
                }
                out.extend((0..S::LANES).map(|i| (lanes[2][i] > 0.0).then_some([lanes[0][i], lanes[1][i]])));
            }
            out
        }
    }

    /// Balls anywhere: every pixel that sees one lies within the span of its rows, and spans are little wider than that asks for.
    #[test]
    fn spans_hold_what_is_seen_of_a_ball() {
        let camera = Camera { position: DVec3::ZERO, ..Camera::for_tests([320, 240]) };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let view = &scene.views()[0];
        let lens = Lens::new(view);
        for level in Level::available() {
            let (mut seen, mut spanned) = (0, 0);
            for i in 0..60 {
                let turn = f64::from(i);
                let depth = 1.5 + (0.7 * turn).cos();
                let center = DVec3::new(depth * turn.sin(), depth * 0.8 * (1.3 * turn).cos(), -depth);
                let square = (0.02 + 0.012 * turn).powi(2).min(0.8 * depth * depth);
                let rim = Rim::ball(&lens, center, square);
                assert!(!rim.is_none());
                for tile in 0..20 {
                    let corner = [f64::from(tile % 5 * 64), f64::from(tile / 5 * 64)];
                    for (row, span) in dispatch(level, Spans(&rim, corner)).into_iter().enumerate() {
                        let want =
                            rim.columns([corner[1] + 4.0 * row as f64 + 0.5, corner[1] + 4.0 * row as f64 + 3.5]);
                        if let (Some(span), Some(want)) = (span, want) {
                            for (got, want) in span.into_iter().zip(want) {
                                assert!(
                                    (f64::from(got) + corner[0] - want).abs() < 0.05,
                                    "{level}: {span:?}, {want:?}"
                                );
                            }
                        }
                        for pixel in 0..4 * 64 {
                            let at = [0.5 + f64::from(pixel % 64), 4.0 * row as f64 + 0.5 + f64::from(pixel / 64)];
                            let direction = view.direction(corner[0] + at[0], corner[1] + at[1]);
                            let is_within = span.is_some_and(|[low, high]| low <= at[0] as f32 && at[0] as f32 <= high);
                            spanned += usize::from(is_within);
                            if center.cross(direction).length_squared() < square * direction.length_squared() {
                                assert!(is_within, "{level}: ball {i}, {corner:?} {at:?}, {span:?}");
                                seen += 1;
                            }
                        }
                    }
                }
            }
            assert!(spanned < seen + seen / 8, "{level}: {spanned} for {seen}");
        }
    }
}
