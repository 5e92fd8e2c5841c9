//! Where a view sees balls, many at once: what is asked of a ball before it is drawn is a chain of quotients and roots, and a vector of
//! them takes hardly longer than one.

use super::simd::{Level, Simd, WithSimd, dispatch};
use super::splat::Lens;
use crate::scene::{Attribute, ParticleSet};
use glam::DVec3;
use std::ops::Range;

/// Balls that are looked at together.
pub const BATCH: usize = 16;

/// Some balls of a set, as a view sees them.
#[derive(Default)]
pub struct Sight {
    /// Eye-space centres, by axes.
    center: [[f64; BATCH]; 3],
    radius: [f64; BATCH],
    /// Ends of [`Lens::ball_intervals`], by axes.
    intervals: [[[f64; BATCH]; 2]; 2],
    apparent: [f64; BATCH],
}

/// A ball as a view sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Eye-space centre.
    pub center: DVec3,
    /// Radius in scene units.
    pub radius: f64,
    /// [`Lens::ball_intervals`].
    pub intervals: [[f64; 2]; 2],
    /// [`Lens::least_radius`].
    pub apparent: f64,
}

impl Sight {
    /// Looks at a few balls of a set, at most [`BATCH`].
    #[inline]
    pub fn look(&mut self, set: &ParticleSet, numbers: Range<usize>, lens: &Lens, level: Level) {
        for (to, from) in self.center.iter_mut().zip([&set.x, &set.y, &set.z]) {
            take(&from[numbers.clone()], to);
        }
        match &set.radius {
            Attribute::Uniform(radius) => self.radius = [*radius; BATCH],
            Attribute::Each(radii) => take(&radii[numbers], &mut self.radius),
        }
        dispatch(level, Look { lens, sight: self });
    }

    /// One of them.
    #[inline]
    pub fn ball(&self, number: usize, lens: &Lens) -> Seen {
        let center = DVec3::from_array(self.center.map(|axis| axis[number]));
        let radius = self.radius[number];
        let intervals = if -center.z > radius {
            self.intervals.map(|ends| ends.map(|end| end[number]))
        } else {
            lens.ball_intervals(center, radius)
        };
        Seen { center, radius, intervals, apparent: self.apparent[number] }
    }
}

/// Copies values, most often a batch of them: that many take no call.
#[inline]
fn take(from: &[f64], to: &mut [f64; BATCH]) {
    match from.first_chunk() {
        Some(batch) => *to = *batch,
        None => to[..from.len()].copy_from_slice(from),
    }
}

/// Takes centres from world to eye space, and what follows from them.
struct Look<'a> {
    lens: &'a Lens<'a>,
    sight: &'a mut Sight,
}

impl WithSimd for Look<'_> {
    type Output = ();

    /// Loops that the compiler makes vectors of, with the instructions of the level.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { lens, sight } = self;
        let [x, y, z] = &mut sight.center;
        let [[left, right], [top, bottom]] = &mut sight.intervals;
        for i in 0..BATCH {
            let (center, radius) = (lens.view.eye_from_point(DVec3::new(x[i], y[i], z[i])), sight.radius[i]);
            [x[i], y[i], z[i]] = center.to_array();
            [[left[i], right[i]], [top[i], bottom[i]]] = lens.whole_ball_intervals(center, radius);
            sight.apparent[i] = lens.least_radius(center, radius);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Kernel, Scene};

    /// Before the eye, beside it, around it and behind it; as many as a batch holds and fewer: the same as one by one.
    #[test]
    fn many_are_seen_as_one_is() {
        let turn = |i: usize, step: f64| (i as f64 * step).fract() - 0.5;
        let count = 3 * BATCH + 5;
        let mut set = ParticleSet {
            kernel: Kernel::Gaussian,
            x: (0..count).map(|i| 6.0 * turn(i, 0.618_034)).collect(),
            y: (0..count).map(|i| 6.0 * turn(i, 0.414_214)).collect(),
            z: (0..count).map(|i| 6.0 * turn(i, 0.732_051)).collect(),
            radius: Attribute::Uniform(0.7),
            opacity: Attribute::Uniform(0.5),
            color: Attribute::Uniform([1.0; 3]),
        };
        let camera = Camera {
            position: DVec3::new(0.1, 0.2, 1.0),
            look_at: DVec3::new(0.4, 0.1, -2.0),
            ..Camera::for_tests([90, 70])
        };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let views = scene.views();
        let lens = Lens::new(&views[0]);
        let each = (0..count).map(|i| 0.05 + 2.0 * (turn(i, 0.236_068) + 0.5).powi(3)).collect();
        for radius in [set.radius.clone(), Attribute::Each(each)] {
            set.radius = radius;
            let (mut around, mut before) = (0, 0);
            let mut sight = Sight::default();
            for level in Level::available() {
                for first in (0..count).step_by(BATCH) {
                    let numbers = first..count.min(first + BATCH);
                    sight.look(&set, numbers.clone(), &lens, level);
                    for (number, i) in numbers.enumerate() {
                        let center = lens.view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
                        let radius = set.radius.get(i);
                        let (intervals, apparent) =
                            (lens.ball_intervals(center, radius), lens.least_radius(center, radius));
                        let want = Seen { center, radius, intervals, apparent };
                        assert_eq!(sight.ball(number, &lens), want, "{level}: ball {i}");
                        *(if -center.z > radius { &mut before } else { &mut around }) += 1;
                    }
                }
            }
            assert!(around > 20 && before > 20, "{around} {before}");
        }
    }
}
