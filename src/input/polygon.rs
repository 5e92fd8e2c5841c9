//! Polygons to triangles.
//!
//! Convex polygons become fans; others are clipped ear by ear (G. H. Meisters, *Polygons have ears*, 1975) in their
//! plane, whose normal is Newell's. A polygon without a plane, or that crosses itself so that it has no inside, becomes
//! a fan for what is left of it: something is seen where the file has something.

use glam::{DVec2, DVec3};

/// Most corners looked at while ears are searched for in one file, some seconds' work: ear clipping takes the third
/// power of the number of corners at worst.
const MOST_WORK: u64 = 1 << 31;

/// Triangulates polygons, one after the other.
pub(super) struct Triangulator {
    /// Corners that may still be looked at.
    work: u64,
    /// Corners of the polygon in its plane.
    flat: Vec<DVec2>,
    /// The corner before and after each corner that is left.
    neighbours: Vec<[usize; 2]>,
    /// Corners that may be reflex; others cannot lie within an ear.
    reflex: Vec<usize>,
    /// How many polygons became fans because too much had been spent already.
    pub(super) given_up: u64,
}

impl Triangulator {
    pub(super) fn new() -> Self {
        Self { work: MOST_WORK, flat: Vec::new(), neighbours: Vec::new(), reflex: Vec::new(), given_up: 0 }
    }

    /// Calls `triangle` with the numbers of three corners, n - 2 times for n >= 3 corners. The triangles face the way
    /// the polygon does.
    pub(super) fn triangulate(&mut self, points: &[DVec3], mut triangle: impl FnMut([usize; 3])) {
        let count = points.len();
        if count > 3 && self.project(points) && !self.is_convex() {
            self.clip(&mut triangle);
        } else {
            (2..count).for_each(|i| triangle([0, i - 1, i]));
        }
    }

    /// Fills `flat`, so that the polygon is counter-clockwise; false if it has no plane.
    fn project(&mut self, points: &[DVec3]) -> bool {
        let Some((&origin, &last)) = points.first().zip(points.last()) else { return false };
        let mut normal = DVec3::ZERO;
        let mut before = last - origin;
        for &point in points {
            let point = point - origin;
            normal += before.cross(point);
            before = point;
        }
        // Infinite where coordinates are too large to be multiplied.
        if !normal.is_finite() || normal == DVec3::ZERO {
            return false;
        }
        // Leaving out the axis that the normal is closest to keeps which corners lie within which triangle.
        let size = normal.abs();
        let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (u, v) = if normal[axis] > 0.0 { (u, v) } else { (v, u) };
        self.flat.clear();
        self.flat.extend(points.iter().map(|&point| DVec2::new((point - origin)[u], (point - origin)[v])));
        true
    }

    fn is_convex(&self) -> bool {
        let count = self.flat.len();
        (0..count).all(|i| area(self.flat[i], self.flat[(i + 1) % count], self.flat[(i + 2) % count]) >= 0.0)
    }

    fn clip(&mut self, triangle: &mut impl FnMut([usize; 3])) {
        let count = self.flat.len();
        self.neighbours.clear();
        self.neighbours.extend((0..count).map(|i| [(i + count - 1) % count, (i + 1) % count]));
        self.reflex.clear();
        for i in 0..count {
            if self.turn(i) < 0.0 {
                self.reflex.push(i);
            }
        }
        let (mut left, mut corner, mut misses) = (count, 0, 0);
        while left > 3 && misses < left {
            let [before, after] = self.neighbours[corner];
            if self.is_ear(corner) {
                triangle([before, corner, after]);
                self.neighbours[before][1] = after;
                self.neighbours[after][0] = before;
                left -= 1;
                misses = 0;
                // Its neighbour's turn has changed, and a fan of slivers around one corner is avoided.
                corner = self.neighbours[after][1];
            } else if self.work == 0 {
                self.given_up += 1;
                break;
            } else {
                misses += 1;
                corner = after;
            }
        }
        let [hub, mut b] = [corner, self.neighbours[corner][1]];
        for _ in 2..left {
            let c = self.neighbours[b][1];
            triangle([hub, b, c]);
            b = c;
        }
    }

    /// Twice the signed area of the triangle of a corner and its neighbours.
    fn turn(&self, corner: usize) -> f64 {
        let [before, after] = self.neighbours[corner];
        area(self.flat[before], self.flat[corner], self.flat[after])
    }

    fn is_ear(&mut self, corner: usize) -> bool {
        self.work = self.work.saturating_sub(1);
        let turn = self.turn(corner);
        if turn <= 0.0 {
            // A corner on a straight line, or where the outline turns back on itself, encloses nothing.
            return turn == 0.0;
        }
        if self.work == 0 {
            return false;
        }
        let [before, after] = self.neighbours[corner];
        let [a, b, c] = [before, corner, after].map(|i| self.flat[i]);
        let mut k = 0;
        while let Some(&i) = self.reflex.get(k) {
            // Clipped, or convex by now: never looked at again.
            let [i_before, i_after] = self.neighbours[i];
            if self.neighbours[i_before][1] != i || self.neighbours[i_after][0] != i || self.turn(i) >= 0.0 {
                self.reflex.swap_remove(k);
                continue;
            }
            k += 1;
            let p = self.flat[i];
            // Outlines of polygons with holes touch themselves: a point on a corner of the ear is not in it.
            if p == a || p == b || p == c {
                continue;
            }
            if area(a, b, p) >= 0.0 && area(b, c, p) >= 0.0 && area(c, a, p) >= 0.0 {
                self.work = self.work.saturating_sub(k as u64);
                return false;
            }
        }
        self.work = self.work.saturating_sub(k as u64);
        true
    }
}

/// Twice the signed area of a triangle, > 0 if it is counter-clockwise.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}
