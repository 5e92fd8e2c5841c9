//! By how much balls drawn one behind the other can differ from gas that mixes: a bound.
//!
//! Cut all gas along a ray into pieces. Sorting them truly takes swaps of neighbours, each of which changes the light by
//! T a a' |c - c'| (Beliaev & Zaytseva, equation 4), T being the transmittance in front. For two balls of opacities a1 and a2 that
//! adds up to at most a1 a2 |c1 - c2|, and to nothing where one lies wholly behind the other. The sum over all pairs that a ray
//! may meet is bounded by that over the pairs that touch a tile of the picture.

use super::slab;
use super::splat::Lens;
use super::tile::TILE;
use crate::scene::{Rgb, Scene, View};
use glam::DVec3;

/// Particles up to which pairs are looked at, and pairs of a view: a millisecond or so.
const PARTICLES: usize = 20_000;
const PAIRS: usize = 500_000;

/// A ball of a tile.
#[derive(Clone, Copy)]
struct Layer {
    /// Least and greatest distance from the eye.
    distances: [f64; 2],
    opacity: f64,
    color: Rgb,
}

/// The largest difference of a channel in a view, for balls in order of their centres' distance; `None` if it may be more than
/// `most`, or if there are too many to say.
pub fn bound(scene: &Scene, view: &View, most: f64) -> Option<f64> {
    if scene.particle_count() > PARTICLES {
        return None;
    }
    let lens = Lens::new(view);
    let [across, down] = view.size.map(|n| (n as usize).div_ceil(TILE));
    let mut tiles: Vec<Vec<Layer>> = vec![Vec::new(); across * down];
    for set in &scene.particles {
        let excess = set.kernel.excess();
        for i in 0..set.len() {
            let (point, radius) = (DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i));
            // The most that a ray may see.
            let opacity = -(excess * (-set.opacity.get(i)).ln_1p()).exp_m1();
            if opacity <= 0.0 || slab::reach(view, point, radius).is_none() {
                continue;
            }
            let center = view.eye_from_point(point);
            let bounds = lens.ball_bounds(center, radius);
            if bounds.is_empty() {
                continue;
            }
            let distance = center.length();
            let layer = Layer { distances: [distance - radius, distance + radius], opacity, color: set.color.get(i) };
            for y in bounds.y[0] as usize / TILE..=bounds.y[1] as usize / TILE {
                for tile in
                    &mut tiles[y * across + bounds.x[0] as usize / TILE..=y * across + bounds.x[1] as usize / TILE]
                {
                    tile.push(layer);
                }
            }
        }
    }
    let (mut worst, mut pairs) = (0.0f64, 0);
    for layers in &mut tiles {
        layers.sort_unstable_by(|a, b| a.distances[0].total_cmp(&b.distances[0]));
        let mut sum = 0.0;
        for (i, a) in layers.iter().enumerate() {
            for b in layers[i + 1..].iter().take_while(|b| b.distances[0] < a.distances[1]) {
                let apart = a.color.iter().zip(b.color).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                sum += a.opacity * b.opacity * f64::from(apart);
                pairs += 1;
            }
            if sum > most || pairs > PAIRS {
                return None;
            }
        }
        worst = worst.max(sum);
    }
    Some(worst)
}
