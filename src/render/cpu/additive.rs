//! Optical depth on the nodes of a grid, ball by ball: for gas that nothing cuts and whose order is of no account, as that of
//! one colour is.
//!
//! A ball covers few nodes of a coarse grid, so that blocks of nodes would hold mostly what it does not cover: each ball goes
//! through the nodes of its own rectangle instead.

use super::footprint::{GAUSSIAN_CENTRE, gaussian_quick};
use super::primitive::{BELIAEV, Constant, GAUSSIAN, Leg, Poly, Primitive, Shape, Shell, Shells};
use super::simd::{Level, Simd, WithSimd, dispatch};
use crate::scene::View;
use glam::DVec3;

/// Rows of nodes at once.
const ROWS: usize = 4;

/// A ball on a grid.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    /// Eye-space centre over the radius.
    pub center: DVec3,
    /// Optical depth in powers of two per unit of the kernel's integral (`primitive::centre`).
    pub amplitude: f32,
    /// Its kernel.
    pub shape: Shape,
    /// First and last column and row of nodes that it may cover, within the grid.
    pub nodes: [[usize; 2]; 2],
}

/// A grid of nodes, the pixels of a view; with room at its right and lower edge for whole vectors and blocks of rows.
pub struct Nodes {
    size: [usize; 2],
    stride: usize,
    /// Tangents of the first node's ray, and from node to node.
    corner: [f64; 2],
    step: [f64; 2],
    /// 1 / |dir|^2 of the nodes' rays with dir.z = -1.
    weight: Vec<f32>,
}

impl Nodes {
    /// The pixels of a view.
    pub fn new(view: &View) -> Self {
        let size = view.size.map(|n| n as usize);
        let stride = size[0] + 16;
        let first = view.direction(0.5, 0.5);
        let focal = view.focal_px();
        let (corner, step) = ([first.x, first.y], [1.0 / focal.x, -1.0 / focal.y]);
        let mut weight = Vec::with_capacity(stride * (size[1] + ROWS));
        for row in 0..size[1] + ROWS {
            let y = corner[1] + row as f64 * step[1];
            weight.extend((0..stride).map(|column| {
                let x = corner[0] + column as f64 * step[0];
                (1.0 / (1.0 + x * x + y * y)) as f32
            }));
        }
        Self { size, stride, corner, step, weight }
    }

    /// Adds the optical depths of balls, in powers of two, to a plane of [`Nodes::room`] numbers; returns the fragments. `quick`: those
    /// of Gaussians may be off by as much as [`super::footprint::QUICK`] of what rays hold.
    pub fn add(&self, balls: &[Ball], shells: &[Shell], quick: bool, level: Level, plane: &mut [f32]) -> u64 {
        dispatch(level, Add { nodes: self, balls, shells, quick, plane })
    }

    /// Numbers of a plane of nodes, the room at its edges included.
    pub fn room(&self) -> usize {
        self.weight.len()
    }

    /// The nodes of a plane, row by row, without the room.
    pub fn trimmed(&self, plane: &[f32]) -> Vec<f32> {
        let rows = plane.chunks_exact(self.stride).take(self.size[1]);
        rows.flat_map(|row| &row[..self.size[0]]).copied().collect()
    }
}

struct Add<'a> {
    nodes: &'a Nodes,
    balls: &'a [Ball],
    shells: &'a [Shell],
    quick: bool,
    plane: &'a mut [f32],
}

impl WithSimd for Add<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> u64 {
        let Self { nodes, balls, shells, quick, plane } = self;
        let mut legs = Vec::new();
        let mut fragments = 0;
        for ball in balls {
            if quick && matches!(ball.shape, Shape::Gaussian) {
                fragments += nodes.gaussian(s, ball, plane);
                continue;
            }
            let [[left, right], [top, bottom]] = ball.nodes;
            fragments += (right + 1 - left).next_multiple_of(S::LANES) * (bottom + 1 - top).next_multiple_of(ROWS);
            match ball.shape {
                Shape::Gaussian => nodes.ball(s, ball, GAUSSIAN, &mut legs, plane),
                Shape::Beliaev => nodes.ball(s, ball, BELIAEV, &mut legs, plane),
                Shape::Constant => nodes.ball(s, ball, Constant, &mut legs, plane),
                Shape::Poly => nodes.ball(s, ball, Poly, &mut legs, plane),
                Shape::Shells(first, count) => {
                    nodes.ball(s, ball, Shells::new(shells, first, count), &mut legs, plane);
                }
            }
        }
        fragments as u64
    }
}

/// What the nodes of a ball have in common. With c its centre over the radius, b is the distance of the ray dir = (X, Y, -1) from it:
/// b^2 = |c x dir|^2 / |dir|^2, c x dir = (A, B, A X + B Y) with A = -c_z Y - c_y and B = c_x + c_z X. About the centre's own
/// tangent, X = -c_x/c_z + t, that is |c x dir|^2 = A^2 (1 + (c_x/c_z)^2) + 2 A t c_x c_y/c_z + t^2 (c_y^2 + c_z^2), of which nothing
/// cancels; c_z < -1, since nothing cuts the ball.
struct Cross {
    center: DVec3,
    at_centre: f64,
    a_square: f32,
    a_step: f32,
    a_scale: f32,
    t_square: f32,
}

impl Cross {
    fn new(nodes: &Nodes, c: DVec3) -> Self {
        let at_centre = -c.x / c.z;
        Self {
            center: c,
            at_centre,
            a_square: (1.0 + at_centre * at_centre) as f32,
            a_step: (-c.z * nodes.step[1]) as f32,
            a_scale: (-2.0 * at_centre * c.y) as f32,
            t_square: (c.y * c.y + c.z * c.z) as f32,
        }
    }

    /// Of the columns from `first` on, at places `ramp`: the factors of A and of 1.
    #[inline(always)]
    fn columns<S: Simd>(&self, s: S, nodes: &Nodes, first: usize, ramp: S::F) -> [S::F; 2] {
        let left = nodes.corner[0] + first as f64 * nodes.step[0] - self.at_centre;
        let t = s.mul_add(ramp, s.splat(nodes.step[0] as f32), s.splat(left as f32));
        [s.mul(t, s.splat(self.a_scale)), s.mul(s.mul(t, t), s.splat(self.t_square))]
    }

    /// A and (1 + (c_x/c_z)^2) A^2 of [`ROWS`] rows from `row` on.
    #[inline(always)]
    fn rows(&self, nodes: &Nodes, row: usize) -> [[f32; 2]; ROWS] {
        let top = nodes.corner[1] + row as f64 * nodes.step[1];
        let first = (-self.center.z * top - self.center.y) as f32;
        let mut rows = [[0.0; 2]; ROWS];
        for (r, row) in rows.iter_mut().enumerate() {
            let a = first + r as f32 * self.a_step;
            *row = [a, a * a * self.a_square];
        }
        rows
    }
}

/// Adds a factor times what `whole` makes of 1 - b^2, of which there are [`ROWS`] vectors, at the nodes of some columns of a ball's
/// rectangle, block by block.
// No function: a closure may become a call.
macro_rules! for_blocks {
    ($nodes:expr, $s:expr, $cross:expr, [$columns:expr, $rows:expr], $plane:expr, $factor:expr, |$within:ident| $whole:expr) => {
        let (nodes, s, plane, factor) = ($nodes, $s, &mut *$plane, $factor);
        let (one, cross): (_, &Cross) = (s.splat(1.0), $cross);
        for first in $columns.step_by(S::LANES) {
            let [linear, square] = cross.columns(s, nodes, first, s.ramp());
            for row in $rows.step_by(ROWS) {
                let at = row * nodes.stride + first;
                let mut $within = [one; ROWS];
                for (r, (within, [a, a_square])) in $within.iter_mut().zip(cross.rows(nodes, row)).enumerate() {
                    let cross = s.mul_add(linear, s.splat(a), s.add(square, s.splat(a_square)));
                    *within = s.neg_mul_add(cross, s.load(&nodes.weight[at + r * nodes.stride..]), one);
                }
                for (r, whole) in $whole.into_iter().enumerate() {
                    let nodes = &mut plane[at + r * nodes.stride..];
                    let sum = s.mul_add(whole, factor, s.load(nodes));
                    s.store(sum, nodes);
                }
            }
        }
    };
}

impl Nodes {
    /// Adds a ball, whatever its kernel.
    #[inline(always)]
    fn ball<S: Simd, P: Primitive>(
        &self,
        s: S,
        ball: &Ball,
        kernel: P,
        legs: &mut Vec<Leg<S::F, ROWS>>,
        plane: &mut [f32],
    ) {
        let (one, [[left, right], [top, bottom]]) = (s.splat(1.0), ball.nodes);
        let cross = Cross::new(self, ball.center);
        let factor = s.splat(2.0 * ball.amplitude);
        for_blocks!(self, s, &cross, [left..=right, top..=bottom], plane, factor, |within| {
            let [mut square, mut half] = [[one; ROWS]; 2];
            for r in 0..ROWS {
                let within = s.max(within[r], s.splat(0.0));
                square[r] = s.sub(one, within);
                half[r] = s.sqrt_near(within);
            }
            kernel.prepare(s, &square, legs);
            kernel.end(s, &square, legs, &half)
        });
    }

    /// Adds a Gaussian within [`super::footprint::QUICK`]; returns the fragments.
    #[inline(always)]
    fn gaussian<S: Simd>(&self, s: S, ball: &Ball, plane: &mut [f32]) -> usize {
        let factor = s.splat(GAUSSIAN_CENTRE * ball.amplitude);
        let [[left, right], [top, bottom]] = ball.nodes;
        let (half, width) = (S::LANES / 2, right + 1 - left);
        // Columns that would fill half a vector at the most are added two rows at a time.
        let rest = (1..=half).contains(&(width % S::LANES));
        let end = if rest { left + width / S::LANES * S::LANES } else { right + 1 };
        let cross = Cross::new(self, ball.center);
        for_blocks!(self, s, &cross, [left..end, top..=bottom], plane, factor, |within| gaussian_quick(s, within));
        let rows = (bottom + 1 - top).next_multiple_of(ROWS);
        let columns = (end - left).next_multiple_of(S::LANES);
        if !rest {
            return columns * rows;
        }
        let (one, stride) = (s.splat(1.0), self.stride);
        let mut places = [0.0; 16];
        s.store(s.ramp(), &mut places);
        let [linear, square] = cross.columns(s, self, end, s.load_halves(&places, &places));
        for row in (top..=bottom).step_by(ROWS) {
            let at = row * stride + end;
            let mut within = [one; ROWS / 2];
            for (r, (within, [[a, a_square], [b, b_square]])) in
                within.iter_mut().zip(cross.rows(self, row).as_chunks().0).enumerate()
            {
                let at = at + 2 * r * stride;
                let cross = s.mul_add(linear, s.halves(*a, *b), s.add(square, s.halves(*a_square, *b_square)));
                let weight = s.load_halves(&self.weight[at..], &self.weight[at + stride..]);
                *within = s.neg_mul_add(cross, weight, one);
            }
            for (r, whole) in gaussian_quick(s, within).into_iter().enumerate() {
                let (low, high) = plane[at + 2 * r * stride..].split_at_mut(stride);
                let sum = s.mul_add(whole, factor, s.load_halves(low, high));
                s.store_halves(sum, low, high);
            }
        }
        (columns + half) * rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::footprint::QUICK;
    use crate::render::cpu::splat::Lens;
    use crate::scene::{Camera, Kernel, Scene};

    /// Gaussians of all widths in nodes, so that each way of cutting their columns into vectors is taken, at every node.
    #[test]
    fn quick_sums_are_those_of_the_footprint() {
        let camera = Camera { position: DVec3::ZERO, ..Camera::for_tests([90, 70]) };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let view = &scene.views()[0];
        let (nodes, lens) = (Nodes::new(view), Lens::new(view));
        for level in Level::available() {
            let mut widths = [false; 64];
            for i in 0..80 {
                let turn = f64::from(i);
                let center = DVec3::new(0.4 * turn.sin(), 0.3 * (1.7 * turn).cos(), -5.0 - (0.9 * turn).sin());
                let radius = 0.02 + 0.02 * turn;
                let [x, y] = lens.ball_intervals(center, radius);
                let inside = |[low, high]: [f64; 2], size: f64| {
                    [(low - 0.5).ceil().max(0.0) as usize, (high - 0.5).floor().min(size - 1.0) as usize]
                };
                let rectangle = [inside(x, 90.0), inside(y, 70.0)];
                if rectangle.iter().any(|[first, last]| first > last) {
                    continue;
                }
                let (center, amplitude) = (center / radius, 0.7f32);
                let ball = Ball { center, amplitude, shape: Shape::Gaussian, nodes: rectangle };
                let mut plane = vec![0.25; nodes.room()];
                let fragments = nodes.add(&[ball], &[], true, level, &mut plane);
                let [width, height] = rectangle.map(|[first, last]| last + 1 - first);
                widths[width.min(63)] = true;
                let lanes = match level {
                    Level::Portable | Level::Sse2 => 4,
                    Level::Avx2 => 8,
                    Level::Avx512 => 16,
                };
                let whole = width.next_multiple_of(lanes / 2) * height.next_multiple_of(ROWS);
                assert_eq!(fragments as usize, whole, "{level}: {width} nodes");
                for (at, &got) in nodes.trimmed(&plane).iter().enumerate() {
                    let (column, row) = (at % 90, at / 90);
                    let direction = view.direction(column as f64 + 0.5, row as f64 + 0.5);
                    let b = center.cross(direction).length() / direction.length();
                    let want = f64::from(amplitude * GAUSSIAN_CENTRE) * Kernel::Gaussian.footprint(b.min(1.0));
                    let off = (f64::from(got) - 0.25 - want).abs();
                    assert!(off < QUICK * want + 2e-6, "{level}: ball {i}, node {column}, {row}: {got} for {want}");
                }
            }
            assert!(widths[1..40].iter().filter(|&&seen| seen).count() > 25, "{widths:?}");
        }
    }
}
