//! The outlines of particles: ellipses.

use super::simd::Simd;
use super::splat::{Bounds, Card, Lens};
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
        let roots = squares.map(f64::sqrt);
        let half = [lens.focal.x * radius * roots[0], lens.focal.y * radius * roots[1]];
        // Rows count downwards.
        Self::new(lens, middle.to_array(), half, -x * y / (roots[0] * roots[1]))
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

    /// That around pixels, without slack: the ellipse in the middle of their box.
    #[inline(always)]
    pub fn inscribed(bounds: &Bounds) -> Self {
        let [x, y] = [bounds.x, bounds.y].map(|pixels| pixels.map(f64::from));
        let center = [x, y].map(|[first, last]| 0.5 * (first + last + 1.0));
        Self { center, half: [x, y].map(|[first, last]| 0.5 * (last + 1.0 - first)), turn: 0.0, slack: 0.0 }
    }

    /// The same, so many times as large, around its centre.
    #[inline(always)]
    pub fn shrunk(&self, share: f64) -> Self {
        Self { half: self.half.map(|half| half * share), ..*self }
    }

    /// Whether it leaves nothing out.
    pub fn is_none(&self) -> bool {
        self.half[0].is_infinite()
    }

    /// As [`Rim::columns`], each lane between a height of its own and one `height` below, in the coordinates of a corner of pixels: the
    /// ends, and where there is anything within. Not of [`Rim::NONE`].
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
        // In f64: near 1 what is left of it is less than f32 tells apart.
        let root = s.splat((1.0 - self.turn * self.turn).max(0.0).sqrt() as f32);
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
    use crate::scene::{Camera, Stereo, StereoMode, View, stereo};

    /// The ends at the heights of a tile's rows of blocks of so many pixels each.
    struct Spans<'a>(&'a Rim, [f64; 2], u32);

    impl WithSimd for Spans<'_> {
        type Output = Vec<Option<[f32; 2]>>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Self::Output {
            let Self(rim, corner, rows) = self;
            let mut out = Vec::new();
            for first in (0..(64 / rows) as usize).step_by(S::LANES) {
                let tops = s.mul_add(s.add(s.ramp(), s.splat(first as f32)), s.splat(rows as f32), s.splat(0.5));
                let ([low, high], is_met) = rim.spans(s, corner, tops, (rows - 1) as f32);
                let mut lanes = [[0.0; 16]; 3];
                for (lanes, vector) in lanes.iter_mut().zip([low, high, s.keep(is_met, s.splat(1.0))]) {
                    s.store(vector, lanes);
                }
                out.extend((0..S::LANES).map(|i| (lanes[2][i] > 0.0).then_some([lanes[0][i], lanes[1][i]])));
            }
            out
        }
    }

    /// Views of a picture: from far, wide, close by, and of an eye beside the axis.
    fn views(size: [u32; 2]) -> Vec<View> {
        let mut views = Vec::new();
        for fov_y in [1e-3, 40.0, 170.0f64] {
            let camera = Camera { fov_y: fov_y.to_radians(), ..Camera::for_tests(size) };
            let rig = Stereo { interocular: 0.3, convergence: Some(2.0), mode: StereoMode::Parallel };
            views.extend(stereo::views(&camera, None));
            views.extend(stereo::views(&camera, Some(&rig)));
        }
        views
    }

    /// Balls anywhere: every pixel that sees one lies within the span of its rows, and spans are little wider than that asks for.
    #[test]
    fn spans_hold_what_is_seen_of_a_ball() {
        for view in views([320, 240]) {
            let lens = Lens::new(&view);
            // Half of the picture's height, around its middle.
            let (tangent, middle) = (120.0 / lens.focal.y, view.direction(160.0, 120.0));
            for level in Level::available() {
                let (mut seen, mut spanned) = (0, 0);
                for (i, rows) in (0..60).zip([2, 4].into_iter().cycle()) {
                    let turn = f64::from(i);
                    let depth = 1.5 + (0.7 * turn).cos();
                    let center = depth * (middle + tangent * DVec3::new(turn.sin(), (1.3 * turn).cos(), 0.0));
                    let square = ((0.02 + 0.012 * turn) * tangent.min(1.0) * depth).powi(2);
                    let rim = Rim::ball(&lens, center, square);
                    assert!(!rim.is_none());
                    for tile in 0..20 {
                        let corner = [f64::from(tile % 5 * 64), f64::from(tile / 5 * 64)];
                        for (row, span) in (0..).zip(dispatch(level, Spans(&rim, corner, rows))) {
                            for pixel in 0..rows * 64 {
                                let at = [pixel % 64, row * rows + pixel / 64].map(|at| f64::from(at) + 0.5);
                                let direction = view.direction(corner[0] + at[0], corner[1] + at[1]);
                                let is_within =
                                    span.is_some_and(|[low, high]| low <= at[0] as f32 && at[0] as f32 <= high);
                                spanned += usize::from(is_within);
                                if center.cross(direction).length_squared() < square * direction.length_squared() {
                                    assert!(is_within, "{level}: ball {i}, {corner:?} {at:?}, {span:?}");
                                    seen += 1;
                                }
                            }
                        }
                    }
                }
                // The slack grows with the way from the axis to the picture.
                if middle.x.abs() < tangent {
                    assert!(spanned < seen + seen / 4, "{level}: {spanned} for {seen}");
                }
            }
        }
    }

    /// Outlines of all kinds, of up to a thousand times the picture: the vectors' ends are those of the definition.
    #[test]
    fn spans_are_the_columns() {
        for view in views([16_384, 9_000]) {
            let lens = Lens::new(&view);
            let mut met = 0;
            for i in 0..400 {
                let turn = f64::from(i);
                let (tangent, middle) = (4_500.0 / lens.focal.y, view.direction(8_192.0, 4_500.0));
                let depth = 1.5 + (0.7 * turn).cos();
                let center = depth * (middle + tangent * DVec3::new(2.0 * turn.sin(), (1.3 * turn).cos(), 0.0));
                let radius = tangent.min(0.3) * depth * 10f64.powf(3.0 * (0.3 * turn).sin() - 2.0).min(3.0);
                let rim = match i % 3 {
                    0 => Rim::ball(&lens, center, radius * radius),
                    1 => Rim::facing(&lens, center, radius * radius),
                    _ => Rim::card(&lens, &Card::new(&lens, center, 1e3 * radius, depth).0),
                };
                if rim.is_none() {
                    continue;
                }
                let corner = [16_000.0 * (0.5 + 0.5 * (1.1 * turn).sin()), 8_900.0 * (0.5 + 0.5 * turn.cos())];
                for level in Level::available() {
                    for (row, span) in (0..).zip(dispatch(level, Spans(&rim, corner, 4))) {
                        let rows = [0.0, 3.0].map(|y| corner[1] + f64::from(4 * row) + 0.5 + y);
                        // Rounding is a fraction of the slack.
                        let least = 0.2 * rim.slack;
                        let (Some(span), Some(want)) = (span, rim.columns(rows)) else {
                            let inner = rim.columns([rows[0] + least, rows[1] - least]);
                            assert!(inner.is_none() || rows[1] - rows[0] <= 2.0 * least, "{level}: {rim:?}, {rows:?}");
                            continue;
                        };
                        met += 1;
                        for (side, (got, want)) in [-1.0, 1.0].into_iter().zip(span.into_iter().zip(want)) {
                            let off = side * (f64::from(got) + corner[0] - want);
                            assert!(off > -least, "{level}: {rim:?}, {rows:?}: {span:?}, {want}");
                        }
                    }
                }
            }
            assert!(met > 300, "{met}");
        }
    }
}
