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
            let [[left, right], [top, bottom]] = ball.nodes;
            fragments += (right + 1 - left).next_multiple_of(S::LANES) * (bottom + 1 - top).next_multiple_of(ROWS);
            match ball.shape {
                Shape::Gaussian if quick => nodes.gaussian(s, ball, plane),
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

/// Adds a factor times what `whole` makes of 1 - b^2, of which there are [`ROWS`] vectors, at the nodes of a ball's rectangle, block by
/// block. With c its centre over the radius, b is the distance of the ray dir = (X, Y, -1) from it: b^2 = |c x dir|^2 / |dir|^2,
/// c x dir = (A, B, A X + B Y) with A = -c_z Y - c_y and B = c_x + c_z X. About the centre's own tangent, X = -c_x/c_z + t, that is
/// |c x dir|^2 = A^2 (1 + (c_x/c_z)^2) + 2 A t c_x c_y/c_z + t^2 (c_y^2 + c_z^2), of which nothing cancels; c_z < -1, since nothing cuts
/// the ball.
// No function: a closure may become a call.
macro_rules! for_blocks {
    ($nodes:expr, $s:expr, $ball:expr, $plane:expr, $factor:expr, |$within:ident| $whole:expr) => {
        let (nodes, s, plane, factor) = ($nodes, $s, &mut *$plane, $factor);
        let (c, [columns, rows]) = ($ball.center, $ball.nodes);
        let (one, ramp) = (s.splat(1.0), s.ramp());
        let at_centre = -c.x / c.z;
        let a_square = (1.0 + at_centre * at_centre) as f32;
        let (a_step, a_scale) = ((-c.z * nodes.step[1]) as f32, s.splat((-2.0 * at_centre * c.y) as f32));
        let t_square = s.splat((c.y * c.y + c.z * c.z) as f32);
        for first in (columns[0]..=columns[1]).step_by(S::LANES) {
            let left = nodes.corner[0] + first as f64 * nodes.step[0] - at_centre;
            let t = s.mul_add(ramp, s.splat(nodes.step[0] as f32), s.splat(left as f32));
            let (linear, square) = (s.mul(t, a_scale), s.mul(s.mul(t, t), t_square));
            for row in (rows[0]..=rows[1]).step_by(ROWS) {
                let top = nodes.corner[1] + row as f64 * nodes.step[1];
                let at = row * nodes.stride + first;
                let a_first = (-c.z * top - c.y) as f32;
                let mut $within = [one; ROWS];
                for (r, within) in $within.iter_mut().enumerate() {
                    let a = a_first + r as f32 * a_step;
                    let cross = s.mul_add(linear, s.splat(a), s.add(square, s.splat(a * a * a_square)));
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
        let one = s.splat(1.0);
        for_blocks!(self, s, ball, plane, s.splat(2.0 * ball.amplitude), |within| {
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

    /// Adds a Gaussian within [`super::footprint::QUICK`].
    #[inline(always)]
    fn gaussian<S: Simd>(&self, s: S, ball: &Ball, plane: &mut [f32]) {
        for_blocks!(self, s, ball, plane, s.splat(GAUSSIAN_CENTRE * ball.amplitude), |within| gaussian_quick(
            s, within
        ));
    }
}
