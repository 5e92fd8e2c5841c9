//! Which particles are too faint to matter, all together: a bound.
//!
//! Gas of an optical depth d, taken away, changes what a ray sees by at most d times what channels can differ. What the faintest
//! particles hold along a ray is bounded by the sum over those that touch its tile of the picture.

use super::slab;
use super::splat::Lens;
use super::tile::TILE;
use crate::scene::{Attribute, Scene, View};
use glam::DVec3;
use rayon::prelude::*;

/// Steps of opacity that are tried, each a quarter of the one before.
const STEPS: usize = 6;

/// Share of the particles for which it is worth a look.
const WORTH: f64 = 0.02;

/// Particles that are too faint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faint {
    /// Opacity up to which they are.
    pub opacity: f64,
    /// How many.
    pub count: usize,
    /// Bound of the optical depth that they have along any ray.
    pub depth: f64,
}

/// The most particles, by their opacity, that together have at most an optical depth of `most` along any ray of the views; none
/// where that are few.
pub fn faint(scene: &Scene, views: &[View], most: f64) -> Faint {
    // One alone is no more than that.
    let limits: [f64; STEPS] = std::array::from_fn(|step| -(-most * 0.25f64.powi(step as i32)).exp_m1());
    let below = |limit: f64| -> usize {
        let sets = scene.particles.iter().map(|set| match &set.opacity {
            Attribute::Uniform(opacity) => {
                if *opacity <= limit {
                    set.len()
                } else {
                    0
                }
            }
            Attribute::Each(opacities) => opacities.par_iter().filter(|&&opacity| opacity <= limit).count(),
        });
        sets.sum()
    };
    let worth = |count: usize| count as f64 > WORTH * scene.particle_count() as f64;
    if !worth(below(limits[0])) {
        return Faint::default();
    }
    let mut worst = [0.0f64; STEPS];
    for view in views {
        for (worst, depth) in worst.iter_mut().zip(deepest(scene, view, &limits)) {
            *worst = worst.max(depth);
        }
    }
    let Some(step) = worst.iter().position(|&depth| depth <= most) else {
        return Faint::default();
    };
    let count = below(limits[step]);
    if worth(count) { Faint { opacity: limits[step], count, depth: worst[step] } } else { Faint::default() }
}

/// For each limit of the opacity the greatest optical depth, over the tiles of a view, of the particles that are not above it.
fn deepest(scene: &Scene, view: &View, limits: &[f64; STEPS]) -> [f64; STEPS] {
    let lens = Lens::new(view);
    let [across, down] = view.size.map(|n| (n as usize).div_ceil(TILE));
    let none = || vec![[0.0; STEPS]; across * down];
    let mut total = none();
    for set in &scene.particles {
        if let Attribute::Uniform(opacity) = set.opacity
            && opacity > limits[0]
        {
            continue;
        }
        let excess = set.kernel.excess();
        let add = |mut tiles: Vec<[f64; STEPS]>, i: usize| {
            let (point, radius) = (DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i));
            let opacity = set.opacity.get(i);
            if opacity <= 0.0 || opacity > limits[0] || slab::reach(view, point, radius).is_none() {
                return tiles;
            }
            let bounds = lens.ball_bounds(view.eye_from_point(point), radius);
            if bounds.is_empty() {
                return tiles;
            }
            let depth = -excess * (-opacity).ln_1p();
            let [columns, rows] =
                [bounds.x, bounds.y].map(|[first, last]| first as usize / TILE..=last as usize / TILE);
            for row in rows {
                for tile in &mut tiles[row * across..][columns.clone()] {
                    for (sum, _) in tile.iter_mut().zip(limits).take_while(|&(_, &limit)| opacity <= limit) {
                        *sum += depth;
                    }
                }
            }
            tiles
        };
        let sum = |mut a: Vec<[f64; STEPS]>, b: Vec<[f64; STEPS]>| {
            a.as_flattened_mut().iter_mut().zip(b.as_flattened()).for_each(|(a, b)| *a += b);
            a
        };
        let own = (0..set.len()).into_par_iter().with_min_len(1 << 14).fold(none, add).reduce(none, sum);
        total = sum(total, own);
    }
    total.into_iter().fold([0.0; STEPS], |worst, tile| std::array::from_fn(|i| worst[i].max(tile[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Kernel, ParticleSet};

    fn scene(opacities: Vec<f64>, kernel: Kernel) -> Scene {
        let count = opacities.len();
        Scene {
            camera: Camera {
                position: DVec3::new(0.0, 0.0, 5.0),
                look_at: DVec3::ZERO,
                up: DVec3::Y,
                fov_y: 1.0,
                size: [100, 80],
                near: 0.1,
                samples: 1,
            },
            stereo: None,
            background: [0.0; 3],
            particles: vec![ParticleSet {
                kernel,
                x: vec![0.0; count],
                y: vec![0.0; count],
                z: vec![0.0; count],
                radius: Attribute::Uniform(0.2),
                opacity: Attribute::Each(opacities),
                color: Attribute::Uniform([1.0; 3]),
            }],
            meshes: Vec::new(),
        }
    }

    #[test]
    fn as_many_are_left_out_as_the_bound_allows() {
        // A hundred of 1e-6 along one ray, ten of 1e-3.
        let mut opacities = vec![1e-6; 100];
        opacities.extend([1e-3; 10]);
        let found = |opacities: &[f64], kernel, most| {
            let scene = scene(opacities.to_vec(), kernel);
            faint(&scene, &scene.views(), most)
        };
        let all = found(&opacities, Kernel::Gaussian, 0.011);
        assert_eq!(all.count, 110);
        assert!((all.depth / (100e-6 + 10.0 * 1.0005e-3) - 1.0).abs() < 1e-5 && all.opacity >= 1e-3, "{all:?}");
        let few = found(&opacities, Kernel::Gaussian, 0.009);
        assert_eq!(few.count, 100);
        assert!((few.depth / 100e-6 - 1.0).abs() < 1e-5 && few.opacity < 1e-3, "{few:?}");
        assert_eq!(found(&opacities, Kernel::Gaussian, 9e-5), Faint::default());
        assert_eq!(found(&[1e-3; 10], Kernel::Gaussian, 9e-3), Faint::default());
        // Few of many are not worth a look.
        let mut mostly = vec![0.5; 1000];
        mostly.extend([1e-6; 10]);
        assert_eq!(found(&mostly, Kernel::Gaussian, 0.01), Faint::default());
        // A hollow one may hold more beside its centre.
        let hollow = Kernel::table(vec![0.0, 0.5, 1.0], vec![0.1, 1.0, 0.0]).unwrap();
        let bound = found(&opacities, hollow.clone(), 0.1).depth;
        assert!((bound / all.depth - hollow.excess()).abs() < 1e-6 && hollow.excess() > 1.2);
    }
}
