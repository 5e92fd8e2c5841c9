//! The inverse question: from which distance on, or up to which radius, does an alignment stay within a tolerance of
//! another at every point of every billboard whose centre is in the frame?
//!
//! With everything over d, a centre is (x, y) with |x| <= X, |y| <= Y (the tangents of half the field of view), the radius
//! is rho = r/d, and |e|/N depends on these alone. What makes it solvable:
//! - By symmetry x, y >= 0. At a given centre, |e_x| and |e_y| are largest where the offsets a, b and q are all positive and
//!   as large as they can be: with signs against each other the sums in the numerators shrink and the depth in the
//!   denominator grows. So the worst point is the *outer corner*, a = b = 1.
//! - There both grow with rho (every term of the numerator does, the depths in the denominator fall). The largest error of
//!   the frame therefore meets the tolerance at one rho*, and stays within it below: at distances from r/rho* on, for radii
//!   up to rho* d.
//! - rho* = min over the frame of the rho at which that centre meets the tolerance. The terms of the numerators each grow or
//!   fall with x and with y, so over a rectangle of centres the error has a simple upper bound, and branch and bound finds
//!   the minimum with both sides known: no centre is left out, as it could be between the samples of a scan.

use super::unit::Frame;
use super::{Alignment, Component};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What must stay within the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// The two alignments; different.
    pub alignments: [Alignment; 2],
    /// One component, or the length of the error.
    pub component: Option<Component>,
    /// Where the centres are.
    pub frame: Frame,
    /// Largest error allowed over N, > 0.
    pub tolerance: f64,
}

/// Up to which size billboards stay within the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Radius over depth of the centre: every billboard of the frame stays within the tolerance up to it.
    pub ratio: f64,
    /// A billboard of the frame exceeds the tolerance at `ratio` times one plus this: [`PRECISION`] or, where the error is
    /// flat about the worst centre, some more.
    pub precision: f64,
    /// The centre of a billboard that reaches it first, over its depth, x and y >= 0. Its worst point is the corner away
    /// from the axis; by symmetry there are others.
    pub worst: [f64; 2],
}

/// Relative precision at which the search ends.
pub const PRECISION: f64 = 1e-9;

/// Rectangles after which it ends too: where the worst centre is inside the frame, a bound of first order would go on
/// halving many that are nearly as bad.
const MOST: usize = 20_000;

/// Solves for the largest ratio of radius to depth.
pub fn solve(demand: &Demand) -> Solution {
    let [width, height] = demand.frame.half_extent();
    let first = Rectangle { x: [0.0, width], y: [0.0, height] };
    let mut best = Solution { ratio: f64::INFINITY, precision: 0.0, worst: [width, height] };
    let mut open = BinaryHeap::from([Candidate { ratio: demand.ratio(&first), rectangle: first }]);
    let mut looked_at = 0;
    while let Some(Candidate { ratio, rectangle }) = open.pop() {
        looked_at += 1;
        // The far corner and the middle: rectangles of no size, for which the bound is the error.
        let Rectangle { x, y } = rectangle;
        let middle = [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])];
        for worst in [[x[1], y[1]], middle] {
            let ratio = demand.ratio(&Rectangle { x: [worst[0]; 2], y: [worst[1]; 2] });
            if ratio < best.ratio {
                best = Solution { ratio, worst, ..best };
            }
        }
        if ratio >= best.ratio * (1.0 - PRECISION) || looked_at >= MOST {
            let ratio = ratio.min(best.ratio);
            return Solution { ratio, precision: best.ratio / ratio - 1.0, worst: best.worst };
        }
        let halves = if x[1] - x[0] > y[1] - y[0] {
            [Rectangle { x: [x[0], middle[0]], y }, Rectangle { x: [middle[0], x[1]], y }]
        } else {
            [Rectangle { x, y: [y[0], middle[1]] }, Rectangle { x, y: [middle[1], y[1]] }]
        };
        // A half is no worse than the whole, whatever rounding says.
        open.extend(halves.map(|half| Candidate { ratio: demand.ratio(&half).max(ratio), rectangle: half }));
    }
    best
}

/// Centres over their depth, 0 <= x[0] <= x[1], 0 <= y[0] <= y[1].
#[derive(Clone, Copy)]
struct Rectangle {
    x: [f64; 2],
    y: [f64; 2],
}

/// A rectangle whose every centre stays within the tolerance up to a ratio.
struct Candidate {
    ratio: f64,
    rectangle: Rectangle,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// The smallest ratio comes out of the heap first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.ratio.total_cmp(&self.ratio)
    }
}

impl Demand {
    /// The largest ratio at which the bound of a rectangle is within the tolerance: the bound grows with the ratio, so that
    /// bisection finds it to the last digit.
    fn ratio(&self, rectangle: &Rectangle) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        // There is always a pole, near or far: where the outer corner reaches the eye's plane, or the ball the eye.
        while self.bound(rectangle, high) <= self.tolerance && high < f64::MAX / 2.0 {
            (low, high) = (high, 2.0 * high);
        }
        loop {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                return low;
            }
            if self.bound(rectangle, middle) <= self.tolerance { low = middle } else { high = middle }
        }
    }

    /// An upper bound of the error at the outer corner of any billboard of the rectangle, over N; infinite where one may be
    /// at a pole. For a rectangle of no size it is the error. Notation of the module of closed forms, with d = 1 and r the
    /// ratio.
    fn bound(&self, &Rectangle { x: [x0, x1], y: [y0, y1] }: &Rectangle, r: f64) -> f64 {
        // What grows with x or y is taken at the far end, what falls at the near end.
        let (s0, s1) = (x0.hypot(1.0), x1.hypot(1.0));
        let sine = x1 / s1;
        let length = s0.hypot(y1);
        let ratio = length / s0;
        let g = x1 * (x1 / (s1 + 1.0));
        let ratio_less_1 = y1 / s0 * (y1 / (length + s0));
        let q = sine + y1 / (s0 * length);
        let (k, h) = if self.alignments.contains(&Alignment::Perspective) {
            let rho = r * std::f64::consts::SQRT_2;
            let nearest = s0.hypot(y0);
            if rho >= nearest {
                return f64::INFINITY;
            }
            let m = ((nearest - rho) * (nearest + rho)).sqrt();
            (nearest / m, rho / m * (rho / (nearest + m)))
        } else {
            (1.0, 0.0)
        };
        let depth = 1.0 - k * r * q;
        if depth <= 0.0 {
            return f64::INFINITY;
        }
        let (e_x, e_y) = if self.alignments.contains(&Alignment::Viewplane) {
            let e_x = g + s1 * h + k * r * q;
            let e_y = k * y1 * sine + ratio_less_1 + ratio * h + k * r * q;
            (r * e_x / depth, r * e_y / depth)
        } else {
            // k >= 1: the depth without it is the greater one, and positive.
            let scale = r * h / (depth * (1.0 - r * q));
            (scale * s1, scale * (y1 * sine + ratio))
        };
        match self.component {
            Some(Component::X) => e_x,
            Some(Component::Y) => e_y,
            None => e_x.hypot(e_y),
        }
    }
}
