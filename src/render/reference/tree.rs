//! Which balls a ray or a bundle of rays may meet: a hierarchy of bounding spheres around the particles of one view.

use crate::scene::Rgb;
use glam::DVec3;

/// A particle as one view sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ball {
    /// Eye-space centre.
    pub center: DVec3,
    /// Radius, > 0.
    pub radius: f64,
    /// T0 / K(0): optical depth per density integrated over a length in radii.
    pub strength: f64,
    /// Linear-light colour.
    pub color: Rgb,
    /// Index of its set.
    pub set: u32,
}

/// Rays from the eye within an angle of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// Unit vector.
    pub axis: DVec3,
    /// Cosine of the half angle, which is below 90 degrees.
    pub cosine: f64,
    /// Sine of the half angle.
    pub sine: f64,
}

impl Cone {
    /// The narrowest cone around the middle of these directions of any length.
    pub(super) fn around(directions: &[DVec3]) -> Self {
        let axis = directions.iter().map(|d| d.normalize()).sum::<DVec3>().normalize();
        // The sine from the cross product keeps its digits for narrow cones.
        let sine = directions.iter().map(|d| axis.cross(*d).length() / d.length()).fold(0.0, f64::max);
        let cosine = directions.iter().map(|d| axis.dot(*d) / d.length()).fold(1.0, f64::min).max(0.0);
        Self { axis, cosine, sine }
    }

    /// Whether a ball may reach into the cone. Never no where it does: the distance to the line that the cone's surface
    /// makes beside the centre is no longer than that to the cone, and a margin covers rounding.
    #[inline]
    fn meets(&self, center: DVec3, radius: f64) -> bool {
        let along = center.dot(self.axis);
        let beside = center.cross(self.axis).length();
        let reach = radius + 1e-12 * (along.abs() + beside + radius);
        // Said by what is surely outside, so that what is no number (of infinite coordinates) is not.
        let outside = along < -reach || beside * self.cosine - along * self.sine > reach;
        !outside
    }
}

/// Balls of a leaf.
const LEAF: usize = 8;

/// A sphere around balls `first` to before `end`, and where the second of its two halves stands; the first one follows it.
struct Node {
    center: DVec3,
    radius: f64,
    first: u32,
    end: u32,
    second: u32,
}

/// The hierarchy.
pub(super) struct Tree {
    balls: Vec<Ball>,
    nodes: Vec<Node>,
}

impl Tree {
    /// Builds it, by halving at the median along the longest side. Fewer than 2^32 balls.
    pub(super) fn new(mut balls: Vec<Ball>) -> Self {
        let mut nodes = Vec::with_capacity(balls.len() / LEAF * 4 + 1);
        let count = balls.len();
        if count > 0 {
            build(&mut balls, 0, count, &mut nodes);
        }
        Self { balls, nodes }
    }

    /// Number of balls.
    pub(super) fn len(&self) -> usize {
        self.balls.len()
    }

    /// Puts the balls that may reach into the cone into `found`, in an order that does not depend on the cone.
    pub(super) fn collect(&self, cone: &Cone, found: &mut Vec<Ball>) {
        found.clear();
        let mut waiting = vec![0];
        while let Some(index) = waiting.pop() {
            let Some(node) = self.nodes.get(index as usize) else { continue };
            if !cone.meets(node.center, node.radius) {
                continue;
            }
            if node.second == 0 {
                let balls = &self.balls[node.first as usize..node.end as usize];
                found.extend(balls.iter().filter(|ball| cone.meets(ball.center, ball.radius)));
            } else {
                waiting.extend([node.second, index + 1]);
            }
        }
    }
}

fn build(balls: &mut [Ball], first: usize, end: usize, nodes: &mut Vec<Node>) {
    let own = &mut balls[first..end];
    let low = own.iter().map(|ball| ball.center - ball.radius).fold(DVec3::INFINITY, DVec3::min);
    let high = own.iter().map(|ball| ball.center + ball.radius).fold(DVec3::NEG_INFINITY, DVec3::max);
    let center = low.midpoint(high);
    let radius = own.iter().map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f64::max);
    let index = nodes.len();
    nodes.push(Node { center, radius, first: first as u32, end: end as u32, second: 0 });
    if own.len() <= LEAF {
        return;
    }
    let size = (high - low).to_array();
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
    let middle = own.len() / 2;
    own.select_nth_unstable_by(middle, |a, b| a.center[axis].total_cmp(&b.center[axis]));
    build(balls, first, first + middle, nodes);
    nodes[index].second = nodes.len() as u32;
    build(balls, first + middle, end, nodes);
}
