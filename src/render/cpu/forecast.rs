//! Which is cheaper for gas that nothing cuts: nodes of a grid, or billboards of all balls in order of depth, where both are exact
//! enough; a sample of the particles tells.

use super::footprint::GAUSSIAN_MEAN;
use super::order::Index;
use super::slab;
use super::splat::Lens;
use super::tile::TILE;
use crate::scene::{Scene, View};
use glam::DVec3;
use rayon::prelude::*;

/// Nanoseconds of a core: a billboard's fragment, for one colour and for several, a tile that it touches, and a billboard, drawn or
/// not; a ball that is marked and added to a grid, one that is prepared for a grid of slabs, and a ball's node, added and by slabs.
/// Measured with AVX-512 on Zen 4 and, but for that of the machine, as they are on an Intel Xeon; here it matters how they compare, not
/// how large they are.
const FRAGMENT: [f64; 2] = [0.27, 0.5];
const TOUCHED: f64 = 100.0;
const BILLBOARD: f64 = 10.0;
const MARK: f64 = 80.0;
const PREPARE: f64 = 300.0;
const NODE: [f64; 2] = [0.85, 2.0];

/// Nanoseconds of a core for a node of a tile whatever is before it, and how many more than its own a tile asks for along an axis.
const BARE_NODE: f64 = 25.0;
const AROUND: f64 = 6.0;

/// Nanoseconds of a core by which a pixel that is made of nodes is dearer than one that billboards are drawn over.
const ENLARGE: [f64; 2] = [0.4, 1.0];

/// Mean optical depth of a picture beyond which gas is not drawn, near enough; all kernels are taken for Gaussians.
pub const DEEP: f64 = 3.2;

/// The mean depth of a picture of billboards that are drawn all over it, near enough: it is not everywhere as deep.
const DEEP_BILLBOARDS: f64 = 4.9;

/// Share of the particles that are smaller than what decides about a tile: many share each tile.
const SMALL: f64 = 0.05;

/// What a ball holds, over the mean of all, up to which it is a speck beside them.
const SPECK: f64 = 0.01;

/// Balls that are deep by themselves need nodes nearer to each other than their least distance: from a depth on, in tolerances, that
/// grows with a power of it. Behind what hides it less of an error is seen. Fitted to which grids tiles of balls of one colour, of opacity
/// 0.1 to 0.4, came to, of a mean depth from 0.3 to 16; several colours ask for no less.
const SHALLOW: f64 = 27.0;
const FINER: f64 = 0.45;
const HIDDEN: f64 = 0.22;

/// What a view is drawn by.
#[derive(Clone, Copy, Debug, Default)]
pub struct Forecast {
    /// Whether billboards are cheaper than grids.
    pub billboards: bool,
    /// The widest grid that few particles are too small for, if there is one.
    pub spacing: Option<usize>,
    /// What it was told by.
    pub sample: Sample,
}

/// What a sample tells of a view's particles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// How many are seen.
    pub seen: f64,
    /// Pixels that they cover, each for itself.
    pub area: f64,
    /// Mean optical depth of the picture.
    pub depth: f64,
    /// The median of the balls' optical depths through their centres, where there are several colours; 0 if no grid may follow any.
    pub own: f64,
    /// The median of the widest distances of nodes, in pixels, that they are not too small for, likewise.
    pub widest: f64,
    /// Nodes of the grid that they are added to one by one, if they are, that they cover, blocks of nodes whole.
    pub added: f64,
}

/// A ball of the sample.
struct Seen {
    /// The widest distance of nodes, in pixels, that it is not too small for.
    widest: f64,
    /// Pixels that it covers.
    area: f64,
    /// Optical depth through its centre.
    own: f64,
}

/// What is cheaper in a view, if grids may have nodes `spacings` pixels apart, widest first, each for balls of a radius of at
/// least so many distances of nodes as `least` says for their set.
pub fn forecast(scene: &Scene, view: &View, one: bool, tolerance: f64, spacings: &[usize], least: &[f64]) -> Forecast {
    let fragment = FRAGMENT[usize::from(!one)];
    let lens = Lens::new(view);
    let [width, height] = view.size.map(f64::from);
    let index = Index::new(scene);
    let (stride, sample) = index.sample();
    let mut seen: Vec<Seen> = Vec::new();
    let mut depth = 0.0;
    for (number, i) in sample {
        let (set, least) = (&scene.particles[number], least[number]);
        let (point, radius, opacity) =
            (DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i), set.opacity.get(i));
        if opacity <= 0.0 || slab::reach(view, point, radius).is_none() {
            continue;
        }
        let center = view.eye_from_point(point);
        let [x, y] = lens.ball_intervals(center, radius);
        let area = (x[1].min(width) - x[0].max(0.0)).max(0.0) * (y[1].min(height) - y[0].max(0.0)).max(0.0);
        if area > 0.0 {
            let area = area * std::f64::consts::FRAC_PI_4;
            let own = -(-opacity).ln_1p();
            seen.push(Seen { widest: lens.least_radius(center, radius) / least, area, own });
            depth += own * GAUSSIAN_MEAN * area * stride as f64 / (width * height);
        }
    }
    let fragments: f64 = seen.iter().map(|ball| ball.area).sum();
    let shown = (DEEP / depth).min(1.0);
    let side = |area: f64| (area / std::f64::consts::FRAC_PI_4).sqrt();
    // Blocks of pixels that a ball touches are computed whole. Of large ones those in the corners are spared, of which finding them
    // costs a third.
    let drawn = |ball: &Seen| {
        let (side, tile) = (side(ball.area), TILE as f64);
        let spared = 0.15 * side * (side - 40.0).max(0.0);
        fragment * ((side + 15.0) * (side + 3.0) - spared) + TOUCHED * (side / tile + 1.0).powi(2)
    };
    let billboards =
        seen.len() as f64 * BILLBOARD + (DEEP_BILLBOARDS / depth).min(1.0) * seen.iter().map(drawn).sum::<f64>();
    // What a share of some values is below; 0 of none.
    let quantile = |mut values: Vec<f64>, share: f64| {
        let place = (values.len() as f64 * share) as usize;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(place, f64::total_cmp).1 }
    };
    // The widest distance of nodes that few of the balls are too small for.
    let widest = |of: &dyn Fn(&Seen) -> f64| {
        let small = quantile(seen.iter().map(of).collect(), SMALL);
        spacings.iter().copied().find(|&spacing| small >= spacing as f64)
    };
    if seen.is_empty() {
        return Forecast::default();
    }
    let unit = SHALLOW * tolerance / (-HIDDEN * depth).exp();
    let finer = |ball: &Seen| ball.widest * if ball.own > unit { (unit / ball.own).powf(FINER) } else { 1.0 };
    let (spacing, last) = (widest(&|ball| ball.widest), widest(&finer));
    // Blocks of nodes that a ball touches are computed whole.
    let nodes = |spacing: Option<usize>, [across, down]: [f64; 2]| -> f64 {
        let side = |area: f64| side(area) / spacing.unwrap_or(1) as f64;
        seen.iter().map(|ball| (side(ball.area) + across) * (side(ball.area) + down)).sum::<f64>()
    };
    let count = seen.len() as f64;
    let pixels = fragments.min(width * height / stride as f64);
    let bare = |spacing: Option<usize>| {
        spacing.map_or(0.0, |spacing| pixels * (1.0 / spacing as f64 + AROUND / TILE as f64).powi(2) * BARE_NODE)
    };
    // Of one colour the balls are added one by one, but to the finest grid, whose planes would be as large as films.
    let is_added = one && spacing.is_some() && spacing != spacings.last().copied();
    let added = if is_added { nodes(spacing, [4.0, 4.0]) } else { 0.0 };
    let first = if is_added { added * NODE[0] + bare(spacing) } else { 0.0 };
    let others = if is_added && last == spacing {
        0.0
    } else {
        count * PREPARE + nodes(last, [16.0, 8.0]) * NODE[1] * last.map_or(shown, |_| 1.0) + bare(last)
    };
    let enlarge = last.map_or(0.0, |_| pixels * ENLARGE[usize::from(!one)]);
    let grids = count * MARK + first + others + enlarge;
    // Of balls that some grid may follow, if they are no specks beside the others.
    let mean = seen.iter().map(|ball| ball.own * ball.area).sum::<f64>() / count;
    let is_shown = |ball: &&Seen| ball.widest > 0.0 && ball.own * ball.area > SPECK * mean;
    let of_shown = |of: &dyn Fn(&Seen) -> f64| {
        if one { 0.0 } else { quantile(seen.iter().filter(is_shown).map(of).collect(), 0.5) }
    };
    let all = stride as f64;
    let sample = Sample {
        seen: count * all,
        area: fragments * all,
        depth,
        own: of_shown(&|ball| ball.own),
        widest: of_shown(&|ball| ball.widest),
        added: added * all,
    };
    Forecast { billboards: billboards < grids, spacing, sample }
}

/// Whether the near plane of a view cuts gas.
pub fn cuts(scene: &Scene, view: &View) -> bool {
    let axis = view.eye_from_world.row(2);
    scene.particles.iter().any(|set| {
        (0..set.len()).into_par_iter().with_min_len(1 << 12).any(|i| {
            let depth = -axis.dot(DVec3::new(set.x[i], set.y[i], set.z[i]) - view.position);
            let radius = set.radius.get(i);
            depth - radius < view.near && depth + radius > view.near && set.opacity.get(i) > 0.0
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Attribute, Camera, Kernel, ParticleSet};

    /// Balls of one size in front of the eye, of a radius in pixels at the middle depth; whether billboards are forecast, and the grid.
    fn ask(count: usize, pixels: f64, opacity: f64, one: bool) -> (bool, Option<usize>) {
        let camera = Camera { position: DVec3::ZERO, ..Camera::for_tests([1024, 768]) };
        let share = |i: usize, step: f64| (i as f64 * step).fract();
        let focal = 768.0 / 2.0 / (0.5 * camera.fov_y).tan();
        let set = ParticleSet {
            kernel: Kernel::Gaussian,
            x: (0..count).map(|i| 3.0 * share(i, 0.618_034) - 1.5).collect(),
            y: (0..count).map(|i| 2.0 * share(i, 0.754_878) - 1.0).collect(),
            z: (0..count).map(|i| -1.5 - 2.0 * share(i, 0.569_840)).collect(),
            radius: Attribute::Uniform(pixels * 2.5 / focal),
            opacity: Attribute::Uniform(opacity),
            color: Attribute::Uniform([0.7; 3]),
        };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: vec![set], meshes: Vec::new() };
        let forecast = forecast(&scene, &scene.views()[0], one, 1.0 / 255.0, &[16, 8, 4, 2], &[3.5]);
        (forecast.billboards, forecast.spacing)
    }

    /// Measured cases, each won by a factor of 1.5 or more.
    #[test]
    fn what_is_cheaper_by_far_is_forecast() {
        for (count, pixels, opacity) in
            [(2_000, 100.0, 0.4), (2_000, 60.0, 0.4), (10_000, 60.0, 0.4), (30_000, 40.0, 0.4), (300_000, 20.0, 0.005)]
        {
            let (billboards, spacing) = ask(count, pixels, opacity, true);
            assert!(!billboards && spacing >= Some(4), "{count} balls of {pixels} pixels: {spacing:?}");
        }
        for (count, pixels, opacity) in [
            (2_000, 18.0, 0.4),
            (10_000, 10.0, 0.05),
            (300_000, 18.0, 0.4),
            (1_000_000, 13.0, 0.005),
            (2_000, 40.0, 0.4),
            (10_000, 20.0, 0.4),
            (2_000, 30.0, 0.4),
        ] {
            assert!(ask(count, pixels, opacity, true).0, "{count} balls of {pixels} pixels");
        }
        // Too small for any grid; and of several colours, which nodes take slabs for.
        assert_eq!(ask(30_000, 6.0, 0.4, true), (true, None));
        assert_eq!(ask(20, 250.0, 0.05, false), (false, Some(16)));
        assert_eq!(ask(5_000, 15.0, 0.4, false), (true, Some(2)));
        // Nothing is seen, or of nothing.
        assert_eq!(ask(0, 10.0, 0.5, true), (false, None));
        assert_eq!(ask(10, 10.0, 0.0, true), (false, None));
    }
}
