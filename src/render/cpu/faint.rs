//! Which particles are too faint to matter, all together: a bound.
//!
//! Gas of an optical depth d, taken away, changes what a ray sees by at most d times what channels can differ. What the faintest
//! particles hold along a ray is bounded by the sum over those that touch its tile of the picture.

use super::cover::Cover;
use super::order::Index;
use super::slab;
use super::splat::{Bounds, Lens};
use super::tile::TILE;
use crate::scene::{Attribute, ParticleSet, Scene, View};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Steps of opacity that are tried, each a quarter of the one before.
const STEPS: usize = 6;

/// Share of the particles for which it is worth a look.
const WORTH: f64 = 0.02;

/// The mean depth of a picture, told by a sample, is less than that of its worst tile: if even that is so many times too much, nothing
/// is summed.
const CROWDED: f64 = 1.5;

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
    if most <= 0.0 {
        return Faint::default();
    }
    // One alone is no more than that.
    let limits: [f64; STEPS] = std::array::from_fn(|step| -(-most * 0.25f64.powi(step as i32)).exp_m1());
    let below = below(scene, &limits);
    let worth = |count: usize| count as f64 > WORTH * scene.particle_count() as f64;
    let means = means(scene, &views[0], &limits);
    if !(0..STEPS).any(|step| worth(below[step]) && means[step] <= CROWDED * most) {
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
    let count = below[step];
    if worth(count) { Faint { opacity: limits[step], count, depth: worst[step] } } else { Faint::default() }
}

/// How many particles there are up to each limit of the opacity.
fn below(scene: &Scene, limits: &[f64; STEPS]) -> [usize; STEPS] {
    let within = |opacity: f64| limits.map(|limit| usize::from(opacity > 0.0 && opacity <= limit));
    let sum = |a: [usize; STEPS], b: [usize; STEPS]| std::array::from_fn(|step| a[step] + b[step]);
    let of_set = |set: &ParticleSet| match &set.opacity {
        Attribute::Uniform(opacity) => within(*opacity).map(|is_within| is_within * set.len()),
        Attribute::Each(opacities) => opacities.par_iter().map(|&opacity| within(opacity)).reduce(|| [0; STEPS], sum),
    };
    scene.particles.iter().map(of_set).fold([0; STEPS], sum)
}

/// What is up to each limit of the opacity, from what is between it and the next: what is below a limit is below all greater ones.
fn up_to(mut sums: [f64; STEPS]) -> [f64; STEPS] {
    for step in (1..STEPS).rev() {
        sums[step - 1] += sums[step];
    }
    sums
}

/// For each limit of the opacity the mean over a view's pixels of the optical depth that [`deepest`] is about, but for what tiles hold
/// beside their balls; a sample tells.
fn means(scene: &Scene, view: &View, limits: &[f64; STEPS]) -> [f64; STEPS] {
    let (index, lens) = (Index::new(scene), Lens::new(view));
    let (stride, sample) = index.sample();
    let mut sums = [0.0; STEPS];
    for (number, i) in sample {
        let set = &scene.particles[number];
        if let Some(Touched { bounds, step, depth }) = touched_by(set, i, &lens, limits) {
            sums[step] += set.kernel.excess() * depth * bounds.pixels() as f64;
        }
    }
    let pixels: f64 = view.size.map(f64::from).iter().product();
    up_to(sums).map(|sum| sum * stride as f64 / pixels)
}

/// For each limit of the opacity the greatest optical depth, over the tiles of a view, of the particles that are not above it.
fn deepest(scene: &Scene, view: &View, limits: &[f64; STEPS]) -> [f64; STEPS] {
    let mut cover = Cover::<STEPS>::new(view.size.map(|n| (n as usize).div_ceil(TILE)));
    // In an order that does not depend on the threads.
    for piece in pieces(scene) {
        let own: Vec<Vec<Touched>> =
            piece.into_par_iter().map(|(set, range)| touched(set, range, view, limits)).collect();
        for Touched { bounds, step, depth } in own.into_iter().flatten() {
            cover.add(bounds.cells([TILE; 2]), step, depth);
        }
    }
    let mut worst = [0.0f64; STEPS];
    cover.sums(|sums| worst.iter_mut().zip(up_to(sums)).for_each(|(worst, sum)| *worst = worst.max(sum)));
    // Up to a limit all that is below it counts.
    let rounding: f64 = cover.rounding().iter().sum();
    worst.map(|depth| depth + rounding)
}

/// A faint particle as a view sees it.
struct Touched {
    /// The pixels that it may cover.
    bounds: Bounds,
    /// The least limit that its opacity is not above.
    step: usize,
    /// Optical depth.
    depth: f64,
}

/// Stretches of the sets' particles, as many at once as threads may take.
fn pieces(scene: &Scene) -> Vec<Vec<(&ParticleSet, Range<usize>)>> {
    const PIECE: usize = 1 << 14;
    let of = |set: &ParticleSet, i: usize| i * PIECE..((i + 1) * PIECE).min(set.len());
    let all: Vec<_> =
        scene.particles.iter().flat_map(|set| (0..set.len().div_ceil(PIECE)).map(move |i| (set, of(set, i)))).collect();
    all.chunks(64).map(<[_]>::to_vec).collect()
}

/// A faint particle, if a view may show it; its optical depth is that through its centre.
#[inline]
fn touched_by(set: &ParticleSet, i: usize, lens: &Lens, limits: &[f64; STEPS]) -> Option<Touched> {
    let (point, radius) = (DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i));
    let opacity = set.opacity.get(i);
    if opacity <= 0.0 || opacity > limits[0] {
        return None;
    }
    slab::reach(lens.view, point, radius)?;
    let bounds = lens.ball_bounds(lens.view.eye_from_point(point), radius);
    let step = limits.iter().rposition(|&limit| opacity <= limit)?;
    (!bounds.is_empty()).then(|| Touched { bounds, step, depth: -(-opacity).ln_1p() })
}

/// The faint particles of a stretch that a view may show.
fn touched(set: &ParticleSet, range: Range<usize>, view: &View, limits: &[f64; STEPS]) -> Vec<Touched> {
    if let Attribute::Uniform(opacity) = set.opacity
        && opacity > limits[0]
    {
        return Vec::new();
    }
    let (lens, excess) = (Lens::new(view), set.kernel.excess());
    let deepest = |ball: Touched| Touched { depth: excess * ball.depth, ..ball };
    range.filter_map(|i| touched_by(set, i, &lens, limits)).map(deepest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Kernel};

    fn scene(opacities: Vec<f64>, kernel: Kernel) -> Scene {
        let count = opacities.len();
        Scene {
            camera: Camera { position: DVec3::new(0.0, 0.0, 5.0), ..Camera::for_tests([100, 80]) },
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
        // What has none is not left out, and nothing is where nothing may be lost.
        assert_eq!(found(&[0.0; 10], Kernel::Gaussian, 0.01), Faint::default());
        assert_eq!(found(&opacities, Kernel::Gaussian, 0.0), Faint::default());
        // Few of many are not worth a look.
        let mut mostly = vec![0.5; 1000];
        mostly.extend([1e-6; 10]);
        assert_eq!(found(&mostly, Kernel::Gaussian, 0.01), Faint::default());
        // A hollow one may hold more beside its centre.
        let hollow = Kernel::table(vec![0.0, 0.5, 1.0], vec![0.1, 1.0, 0.0]).unwrap();
        let bound = found(&opacities, hollow.clone(), 0.1).depth;
        assert!((bound / all.depth - hollow.excess()).abs() < 1e-6 && hollow.excess() > 1.2);
    }

    /// Balls all over a picture of many tiles, against sums over every one of its pixels.
    #[test]
    fn the_deepest_tile_is_found() {
        let count = 300;
        let mut scene = scene((0..count).map(|i| 1e-5 * (1.0 + f64::from(i % 9))).collect(), Kernel::Gaussian);
        scene.camera.size = [500, 300];
        let set = &mut scene.particles[0];
        for i in 0..count as usize {
            let at = |k: usize| ((i * k) % 97) as f64 / 97.0 - 0.5;
            (set.x[i], set.y[i], set.z[i]) = (8.0 * at(31), 6.0 * at(53), 9.0 * at(71));
        }
        set.radius = Attribute::Each((0..count).map(|i| 0.05 + 0.1 * f64::from(i % 13)).collect());
        let view = &scene.views()[0];
        let lens = Lens::new(view);
        let mut tiles = vec![0.0f64; 8 * 5];
        let set = &scene.particles[0];
        for i in 0..count as usize {
            let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
            let bounds = lens.ball_bounds(view.eye_from_point(point), set.radius.get(i));
            if slab::reach(view, point, set.radius.get(i)).is_none() || bounds.is_empty() {
                continue;
            }
            for y in bounds.y[0] as usize / TILE..=bounds.y[1] as usize / TILE {
                for x in bounds.x[0] as usize / TILE..=bounds.x[1] as usize / TILE {
                    tiles[y * 8 + x] -= (-set.opacity.get(i)).ln_1p();
                }
            }
        }
        let want = tiles.iter().copied().fold(0.0, f64::max);
        let found = faint(&scene, &scene.views(), 1.0);
        assert!(found.count == count as usize && (found.depth / want - 1.0).abs() < 1e-8, "{found:?} for {want}");
        assert!(tiles.iter().any(|&depth| depth < 0.5 * want));
    }
}
