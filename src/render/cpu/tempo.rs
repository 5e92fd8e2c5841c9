//! How fast this machine is: predicted times are those of the machine that costs were measured on, times this.

use super::additive::{Ball, Nodes};
use super::primitive::Shape;
use super::simd::Level;
use crate::scene::{Camera, stereo};
use glam::DVec3;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Nanoseconds of the job where costs were measured: virtual cores with AVX-512, an AMD Zen 4's and an Intel Xeon's with AMX, whose
/// predictions err to different sides by a sixth.
const MEASURED: f64 = 36_000.0;

/// Nodes along a side of the job's grid, and its balls.
const SIDE: u32 = 128;
const BALLS: usize = 8;

/// Time of a core of this machine over that of the one that costs were measured on, with that level of instructions. The first call for
/// a level takes half a millisecond.
pub fn tempo(level: Level) -> f64 {
    static KNOWN: Mutex<[Option<f64>; Level::ALL.len()]> = Mutex::new([None; Level::ALL.len()]);
    let place = Level::ALL.iter().position(|&other| other == level).unwrap_or_default();
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    *known[place].get_or_insert_with(|| measure(level))
}

/// The least time of a few runs, which is the least disturbed.
fn measure(level: Level) -> f64 {
    let (position, look_at) = (DVec3::ZERO, DVec3::NEG_Z);
    let camera = Camera { position, look_at, up: DVec3::Y, fov_y: 1.0, size: [SIDE; 2], near: 0.1, samples: 1 };
    let views = stereo::views(&camera, None);
    let nodes = Nodes::new(&views[0]);
    let all = [[0, SIDE as usize - 1]; 2];
    let ball = |i: usize| Ball {
        center: DVec3::new(0.0, 0.0, -2.0 - i as f64),
        amplitude: 0.1,
        shape: Shape::Gaussian,
        near: -1.0,
        nodes: all,
    };
    let balls: Vec<Ball> = (0..BALLS).map(ball).collect();
    let mut plane = nodes.plane();
    let runs = (0..4).map(|_| {
        let start = Instant::now();
        nodes.add(&balls, &[], true, level, &mut plane);
        start.elapsed().as_nanos() as f64
    });
    let least = runs.fold(f64::INFINITY, f64::min);
    // The sums are used, so that they are made.
    std::hint::black_box(&plane);
    least / MEASURED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_has_a_tempo_that_stays() {
        for level in Level::available() {
            let first = tempo(level);
            assert!(first.is_finite() && first > 0.0, "{level}: {first}");
            assert_eq!(first, tempo(level));
        }
    }
}
