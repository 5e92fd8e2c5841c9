//! The reference against closed forms and against a brute-force quadrature of the density alone, and its bounds against
//! what it is really off by.

use crate::harness::{Gas, Random, kernels, set};
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering};
use stereomist::picture::{Film, Picture, Side, output};
use stereomist::render::opaque::{self, OpaqueLayer};
use stereomist::render::reference::{Parameters, Radiance, Reference, TARGET};
use stereomist::render::{Method, Progress, Session, Settings, draw};
use stereomist::scene::mesh::Material;
use stereomist::scene::{Attribute, Camera, Kernel, Mesh, ParticleSet, Rgb, Scene, Stereo, StereoMode, View};

// ---- Scenes

const BACKGROUND: Rgb = [0.25, 0.5, 0.75];

/// From the origin down -z, `fov_y_deg` tall, 64 x 48 pixels.
fn scene(fov_y_deg: f64, near: f64, particles: Vec<ParticleSet>) -> Scene {
    let camera = Camera {
        position: DVec3::ZERO,
        look_at: DVec3::NEG_Z,
        up: DVec3::Y,
        fov_y: fov_y_deg.to_radians(),
        size: [64, 48],
        near,
        samples: 1,
    };
    Scene { camera, stereo: None, background: BACKGROUND, particles, meshes: Vec::new() }
}

fn colored(particles: ParticleSet, color: Rgb) -> ParticleSet {
    ParticleSet { color: Attribute::Uniform(color), ..particles }
}

/// The same opaque depth and colour at every sample.
fn wall(view: &View, depth: f64, color: Rgb) -> OpaqueLayer {
    let n = view.size[0] as usize * view.size[1] as usize;
    OpaqueLayer { depth: vec![depth; n], color: vec![color; n], range: color.map(|value| [value; 2]) }
}

fn off(a: &Radiance, color: [f64; 3], transmittance: f64) -> f64 {
    let colors = a.color.iter().zip(color).map(|(a, b)| (a - b).abs());
    colors.fold((a.transmittance - transmittance).abs(), f64::max)
}

// ---- Brute force

/// Positive nodes and weights of Gauss-Legendre quadrature with 16 points, Abramowitz & Stegun, table 25.4.
const GAUSS_16: [(f64, f64); 8] = [
    (0.095_012_509_837_637_44, 0.189_450_610_455_068_5),
    (0.281_603_550_779_258_9, 0.182_603_415_044_923_58),
    (0.458_016_777_657_227_37, 0.169_156_519_395_002_54),
    (0.617_876_244_402_643_8, 0.149_595_988_816_576_74),
    (0.755_404_408_355_003, 0.124_628_971_255_533_88),
    (0.865_631_202_387_831_8, 0.095_158_511_682_492_79),
    (0.944_575_023_073_232_6, 0.062_253_523_938_647_894),
    (0.989_400_934_991_649_9, 0.027_152_459_411_754_096),
];

fn nodes(a: f64, b: f64) -> impl Iterator<Item = (f64, f64)> {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    GAUSS_16.into_iter().flat_map(move |(x, w)| [(middle - half * x, half * w), (middle + half * x, half * w)])
}

/// A particle as a ray meets it.
struct Lump<'a> {
    kernel: &'a Kernel,
    radius: f64,
    /// Optical depth through the centre over the kernel's integral there.
    strength: f64,
    color: [f64; 3],
    /// Depths between which the ray is inside.
    inside: [f64; 2],
    /// Depth of the closest point, and the distance from the centre there, in radii.
    closest: (f64, f64),
}

/// What a ray of `view` sees, from [`Kernel::density`] alone: 16-point quadrature of the light with 16-point quadrature of
/// the optical depth up to each of the points, on pieces that are cut wherever the integrand may have a kink, and small.
struct Brute {
    color: [f64; 3],
    transmittance: f64,
    mean_depth: f64,
}

fn brute(scene: &Scene, view: &View, x: f64, y: f64, stop: Option<(f64, Rgb)>) -> Brute {
    let direction = view.eye_from_world.transpose() * view.direction(x, y);
    let length = direction.length();
    let far = stop.map_or(f64::INFINITY, |(depth, _)| depth);
    let mut lumps = Vec::new();
    let mut cuts = Vec::new();
    // Where the density of a cone turns, sharply if the ray passes close by.
    let mut turns = Vec::new();
    for set in &scene.particles {
        // Integral of the density through the centre, by quadrature too.
        let rows: Vec<f64> = match &set.kernel {
            Kernel::Table(profile) => profile.q().to_vec(),
            _ => vec![0.0, 0.25, 0.5, 0.75, 1.0],
        };
        let half: f64 = rows.windows(2).flat_map(|q| nodes(q[0], q[1])).map(|(q, w)| w * set.kernel.density(q)).sum();
        for i in 0..set.len() {
            let centre = DVec3::new(set.x[i], set.y[i], set.z[i]) - view.position;
            let radius = set.radius.get(i);
            let b = centre.cross(direction).length() / length / radius;
            if b >= 1.0 {
                continue;
            }
            let closest = centre.dot(direction) / (length * length);
            let reach = |q: f64| ((q - b) * (q + b)).max(0.0).sqrt() * radius / length;
            let inside = [(closest - reach(1.0)).max(view.near), (closest + reach(1.0)).min(far)];
            if inside[0] >= inside[1] {
                continue;
            }
            cuts.extend(inside);
            if !matches!(set.kernel, Kernel::Gaussian | Kernel::Beliaev | Kernel::Constant | Kernel::Poly) {
                turns.push((closest, b * radius / length));
                for &q in rows.iter().filter(|&&q| q > b) {
                    cuts.extend([closest - reach(q), closest + reach(q)]);
                }
            }
            let opacity: f64 = set.opacity.get(i);
            lumps.push(Lump {
                kernel: &set.kernel,
                radius,
                strength: -(-opacity).ln_1p() / (2.0 * half) * length / radius,
                color: set.color.get(i).map(f64::from),
                inside,
                closest: (closest, b),
            });
        }
    }
    for &(at, width) in &turns {
        cuts.push(at);
        let mut step = lumps.iter().map(|lump| lump.radius).fold(0.0, f64::max);
        while step > 0.3 * width && step > 1e-13 * at.abs() {
            cuts.extend([at - step, at + step]);
            step *= 0.5;
        }
    }
    let ends = lumps.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |ends, lump| {
        [ends[0].min(lump.inside[0]), ends[1].max(lump.inside[1])]
    });
    cuts.retain(|&cut| cut >= ends[0] && cut <= ends[1]);
    cuts.sort_by(f64::total_cmp);
    let (mut color, mut optical, mut depth) = ([0.0; 3], 0.0, 0.0);
    for cut in cuts.windows(2) {
        let middle = 0.5 * (cut[0] + cut[1]);
        let around: Vec<&Lump> = lumps.iter().filter(|l| l.inside[0] <= middle && middle <= l.inside[1]).collect();
        if around.is_empty() || cut[0] >= cut[1] {
            continue;
        }
        let extinction = |lump: &Lump, t: f64| {
            let u = (t - lump.closest.0) * length / lump.radius;
            lump.strength * lump.kernel.density((u * u + lump.closest.1 * lump.closest.1).sqrt().min(1.0 - 1e-16))
        };
        let integral = |a: f64, b: f64| -> f64 {
            nodes(a, b).map(|(t, w)| w * around.iter().map(|lump| extinction(lump, t)).sum::<f64>()).sum()
        };
        let small = around.iter().map(|lump| lump.radius / length).fold(f64::INFINITY, f64::min);
        let whole = integral(cut[0], cut[1]);
        let pieces = ((cut[1] - cut[0]) / (0.3 * small)).max(whole).ceil().clamp(1.0, 100_000.0);
        for piece in 0..pieces as usize {
            if optical > 60.0 {
                break;
            }
            let at = |k: usize| cut[0] + (cut[1] - cut[0]) * (k as f64 / pieces);
            let (a, b) = (at(piece), at(piece + 1));
            for (t, w) in nodes(a, b) {
                let through = (-optical - integral(a, t)).exp();
                for lump in &around {
                    let light = w * extinction(lump, t) * through;
                    depth += light * t;
                    for (sum, color) in color.iter_mut().zip(lump.color) {
                        *sum += light * color;
                    }
                }
            }
            optical += integral(a, b);
        }
        if optical > 60.0 {
            break;
        }
    }
    let through = (-optical).exp();
    let end = stop.map_or(scene.background, |(_, color)| color).map(f64::from);
    let transmittance = if stop.is_some() { 0.0 } else { through };
    if let Some((wall, _)) = stop {
        depth += wall * through;
    }
    Brute {
        color: std::array::from_fn(|c| color[c] + through * end[c]),
        transmittance,
        mean_depth: depth / (1.0 - transmittance),
    }
}

// ---- One particle

/// c (1 - exp(-T0 F)) + T background, F by quadrature of the density from `u0` to `u1`.
fn alone(kernel: &Kernel, b: f64, ends: [f64; 2], opacity: f64) -> f64 {
    let half = (1.0 - b * b).sqrt();
    let rows = match kernel {
        Kernel::Table(profile) => profile.q().to_vec(),
        _ => vec![0.0, 0.02, 0.2, 0.5, 1.0],
    };
    // In the angle about the centre u = b tan(angle) there is no kink; in u itself none for lines through the centre.
    let integral = |b: f64, ends: [f64; 2]| -> f64 {
        let mut cuts: Vec<f64> = rows
            .iter()
            .filter(|&&q| q > b)
            .flat_map(|q| [-(q * q - b * b).sqrt(), (q * q - b * b).sqrt()])
            .chain((0..40).flat_map(|k| [0.5f64.powi(k), -(0.5f64.powi(k))]))
            .chain([0.0, ends[0], ends[1]])
            .filter(|u| (ends[0]..=ends[1]).contains(u))
            .collect();
        cuts.sort_by(f64::total_cmp);
        cuts.windows(2)
            .flat_map(|cut| nodes(cut[0], cut[1]))
            .map(|(u, w)| w * kernel.density((u * u + b * b).sqrt().min(1.0 - 1e-16)))
            .sum()
    };
    let share = integral(b, [ends[0].max(-half), ends[1].min(half)]) / integral(0.0, [-1.0, 1.0]);
    (1.0 - opacity).powf(share)
}

#[test]
fn one_particle_is_the_closed_form_also_when_clipped() {
    let color = [0.9f32, 0.1, 0.5];
    for kernel in kernels() {
        for opacity in [0.0, 0.3, 0.999_999] {
            // The ball of radius 2 around (0, 0, -5); the ray along -z passes at b radii.
            for b in [0.0, 1e-9, 1e-3, 0.1, 0.33, 0.5, 0.77, 0.999, 0.999_999, 1.0, 1.2] {
                let gas = colored(set(kernel.clone(), &[[-2.0 * b, 0.0, -5.0]], 2.0, opacity), color);
                for (near, far) in [(0.5, f64::INFINITY), (4.0, f64::INFINITY), (6.0, 1e9), (0.5, 5.5), (4.5, 5.25)] {
                    let scene = scene(40.0, near, vec![gas.clone()]);
                    let view = &scene.views()[0];
                    let layer = far.is_finite().then(|| wall(view, far, [0.2, 0.7, 0.3]));
                    let seen = Reference::new(&scene, view, layer.as_ref()).radiance(32.0, 24.0);
                    let ends = [(near - 5.0) / 2.0, (far - 5.0) / 2.0];
                    let half = (1.0f64 - b * b).max(0.0).sqrt();
                    let through = if b >= 1.0 || ends[0] >= half { 1.0 } else { alone(&kernel, b, ends, opacity) };
                    let end = layer.map_or(scene.background, |layer| layer.color[0]);
                    let law = |c: usize| f64::from(color[c]) * (1.0 - through) + through * f64::from(end[c]);
                    let transmittance = if far.is_finite() { 0.0 } else { through };
                    let off = off(&seen, std::array::from_fn(law), transmittance);
                    assert!(off < 1e-9, "{kernel:?} {opacity} {b} {near} {far}: off by {off}, {seen:?}");
                    // Where a ray touches a rim, rounding decides whether it meets the ball at all, and the bound says so.
                    assert!(off <= seen.error + 1e-14, "{kernel:?} {opacity} {b}: off by {off}, {seen:?}");
                }
            }
        }
    }
}

// ---- Many particles

#[test]
fn overlapping_particles_are_the_brute_quadrature() {
    let mut random = Random::new(51);
    let mut mixed = 0;
    for kernel in kernels() {
        for (count, radius, opacity) in
            [(2, [0.5, 2.0], [0.2, 0.9]), (12, [0.3, 2.5], [0.0, 0.95]), (60, [0.2, 1.5], [0.0, 0.5])]
        {
            let gas = Gas { count, low: [-1.5, -1.5, -6.0], high: [1.5, 1.5, 0.5], radius, opacity, bright: 1.0 };
            let scene = scene(70.0, 0.2, vec![gas.draw(&mut random, kernel.clone())]);
            let view = &scene.views()[0];
            for stop in [None, Some((3.0, [0.9, 0.2, 0.1]))] {
                let layer = stop.map(|(depth, color)| wall(view, depth, color));
                let reference = Reference::new(&scene, view, layer.as_ref());
                for _ in 0..10 {
                    let [x, y, _] = random.point([0.0; 3], [64.0, 48.0, 1.0]);
                    let truth = brute(&scene, view, x, y, stop);
                    let seen = reference.radiance(x, y);
                    let off = off(&seen, truth.color, truth.transmittance);
                    assert!(off < 1e-10, "{kernel:?}, {count}: off by {off} at {x}, {y}: {seen:?}");
                    assert!(off <= seen.error, "{kernel:?}, {count}: off by {off} at {x}, {y}: {seen:?}");
                    assert!(seen.error < 2.0 * TARGET, "{kernel:?}, {count}: {seen:?}");
                    let depth = reference.mean_depth(x, y);
                    if truth.transmittance < 0.999 {
                        mixed += 1;
                        assert!((depth - truth.mean_depth).abs() < 1e-6, "{depth} is not {}", truth.mean_depth);
                    }
                }
            }
        }
    }
    assert!(mixed > 200, "only {mixed} rays met gas");
}

/// Gas at its worst: rims and centres on the ray, balls in balls, next to nothing and next to opaque.
fn nasty(random: &mut Random, kinds: &[Kernel]) -> Scene {
    let pick = |random: &mut Random, n: usize| random.uniform(0.0, n as f64) as usize;
    let far = if pick(random, 5) == 0 { 1e6 } else { 0.0 };
    let mut particles = Vec::new();
    for _ in 0..1 + pick(random, 3) {
        let opacity = match pick(random, 5) {
            0 => [0.0, 1e-9],
            1 => [0.999_999, 0.999_999_999_999],
            2 => [0.5, 0.5],
            _ => [0.0, 0.9],
        };
        let radius = match pick(random, 4) {
            0 => [1e-3, 1.0],
            1 => [3.0, 30.0],
            _ => [0.2, 1.5],
        };
        let gas = Gas {
            count: 1 + pick(random, 20),
            low: [-1.5, -1.5, -6.0],
            high: [1.5, 1.5, 1.0],
            radius,
            opacity,
            bright: [1.0, 1.0, 1000.0][pick(random, 3)],
        };
        let kernel = kinds[pick(random, kinds.len())].clone();
        let mut set = gas.draw(random, kernel);
        if pick(random, 3) == 0 {
            // All of them around one point.
            (set.x, set.y, set.z) = (vec![0.1; set.len()], vec![-0.2; set.len()], vec![-2.5; set.len()]);
        }
        if pick(random, 4) == 0
            && let Attribute::Each(colors) = &mut set.color
        {
            colors.iter_mut().for_each(|color| color[0] = -color[0]);
        }
        set.x.iter_mut().for_each(|x| *x += far);
        particles.push(set);
    }
    let mut scene = scene([20.0, 70.0, 150.0][pick(random, 3)], [0.01, 0.5, 2.0][pick(random, 3)], particles);
    scene.camera.position.x += far;
    scene.camera.look_at.x += far;
    if pick(random, 2) == 0 {
        let mode = if pick(random, 2) == 0 { StereoMode::Parallel } else { StereoMode::ToeIn };
        scene.stereo = Some(Stereo { interocular: 0.2, convergence: Some(3.0), mode });
    }
    scene
}

/// Through the picture at random, or through a particle's centre, or along its rim.
fn aim(random: &mut Random, scene: &Scene, view: &View) -> [f64; 2] {
    let kind = random.uniform(0.0, 3.0) as usize;
    let set = &scene.particles[random.uniform(0.0, scene.particles.len() as f64) as usize];
    let i = random.uniform(0.0, set.len() as f64) as usize;
    let centre = view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
    let beside = centre.cross(DVec3::from(random.point([-1.0; 3], [1.0; 3]))).normalize();
    // Perpendicular to the tangent, at that many radii.
    let sine = (set.radius.get(i) / centre.length()).min(0.9);
    let toward = (1.0 - sine * sine) * centre + beside * (sine * (1.0 - sine * sine).sqrt() * centre.length());
    let slip = [1.0, 0.999_999_999, 0.99][random.uniform(0.0, 3.0) as usize];
    let point = match kind {
        0 => centre,
        _ => centre + (toward - centre) * slip,
    };
    if kind == 2 || point.z >= -0.1 {
        let [x, y, _] = random.point([0.0; 3], [64.0, 48.0, 1.0]);
        return [x, y];
    }
    view.project(point).to_array()
}

#[test]
fn what_it_is_off_by_is_within_its_bound() {
    let mut random = Random::new(52);
    let mut kinds = kernels();
    // A shell, and a step that is as good as vertical.
    kinds.push(Kernel::table(vec![0.0, 0.7, 0.8, 0.9, 1.0], vec![0.0, 0.0, 1.0, 0.1, 0.2]).unwrap());
    kinds.push(Kernel::table(vec![0.0, 0.5, 0.500_000_000_001, 1.0], vec![1.0, 0.9, 0.1, 0.1]).unwrap());
    let (mut rays, mut hits, mut loose, mut worst) = (0, 0, 0, 0.0f64);
    while rays < 10_000 {
        let scene = nasty(&mut random, &kinds);
        let views = scene.views();
        let view = &views[random.uniform(0.0, views.len() as f64) as usize];
        let stop = [None, None, Some((2.5, [0.3, 0.6, 0.9]))][random.uniform(0.0, 3.0) as usize];
        let layer = stop.map(|(depth, color)| wall(view, depth, color));
        let reference = Reference::new(&scene, view, layer.as_ref());
        let colors = scene.particles.iter().flat_map(|set| set.color.values()).flatten();
        let range = colors.fold(1.0, |a, &b| f64::max(a, b.abs().into()));
        for _ in 0..10 {
            let [x, y] = aim(&mut random, &scene, view);
            let truth = brute(&scene, view, x, y, stop);
            let seen = reference.radiance(x, y);
            let off = off(&seen, truth.color, truth.transmittance);
            // The brute force is itself rounded, a few hundred times.
            let allowed = seen.error + 1e-13 * range;
            assert!(off <= allowed, "off by {off}: {seen:?} for {:?} at {x}, {y}, {stop:?}", truth.color);
            rays += 1;
            hits += usize::from(seen.color != truth.color);
            loose += usize::from(seen.error > 3.0 * TARGET * range);
            worst = worst.max(if off > 1e-12 * range { off / seen.error } else { 0.0 });
        }
    }
    eprintln!("rays {rays} hits {hits} loose {loose} worst {worst}");
    // A bound that is never near is none; nor one that is never small, but for rims that are grazed and scenes far away.
    assert!(hits > 5_000 && worst > 0.005, "{hits} rays met gas, {worst} of the bound at most");
    assert!(loose < rays / 4, "{loose} of {rays} bounds miss the target");
}

#[test]
fn equal_colours_are_the_identity_to_the_last_digits() {
    let mut random = Random::new(53);
    let gas = |count| Gas {
        count,
        low: [-2.0, -2.0, -8.0],
        high: [2.0, 2.0, 0.0],
        radius: [0.2, 1.5],
        opacity: [0.0, 0.99],
        bright: 1.0,
    };
    let color = [0.7f32, 0.2, 0.9];
    for kernel in kernels() {
        let mut sets = vec![gas(100).draw(&mut random, kernel.clone()), gas(100).draw(&mut random, Kernel::Poly)];
        sets = sets.into_iter().map(|set| colored(set, color)).collect();
        // And gas that differs in one channel alone: the others still know nothing of it.
        let mut other = sets.clone();
        other[1].color = Attribute::Each((0..100).map(|i| [color[0], i as f32 / 100.0, color[2]]).collect());
        for (sets, channels) in [(sets, [0, 1, 2]), (other, [0, 2, 0])] {
            let scene = scene(60.0, 0.1, sets);
            let view = &scene.views()[0];
            let reference = Reference::new(&scene, view, None);
            for _ in 0..100 {
                let [x, y, _] = random.point([0.0; 3], [64.0, 48.0, 1.0]);
                let Radiance { color: seen, transmittance, error } = reference.radiance(x, y);
                for c in channels {
                    let law = f64::from(color[c]) * (1.0 - transmittance) + transmittance * f64::from(BACKGROUND[c]);
                    assert!((seen[c] - law).abs() < 1e-12, "{kernel:?}: {} for {law}", seen[c]);
                }
                assert!(error < 2.0 * TARGET);
            }
        }
    }
}

#[test]
fn a_hundred_thousand_layers_do_not_drift() {
    // Balls one behind the other, red and green by turns, each of transmittance t through its middle.
    let count = 100_000u32;
    let opacity = 3e-5;
    let centres: Vec<_> = (0..count).map(|i| [0.0, 0.0, -10.0 - 2.5 * f64::from(i)]).collect();
    let gas = ParticleSet {
        color: Attribute::Each((0..count).map(|i| [(1 - i % 2) as f32, (i % 2) as f32, 0.0]).collect()),
        ..set(Kernel::Gaussian, &centres, 1.0, opacity)
    };
    let scene = scene(1.0, 0.1, vec![gas]);
    let view = &scene.views()[0];
    let seen = Reference::new(&scene, view, None).radiance(32.0, 24.0);
    let through = (f64::from(count) * (-opacity).ln_1p()).exp();
    // Geometric series: (1 - t) (1 + t^2 + t^4 + ...), of every second layer.
    let red = (1.0 - through) / (2.0 - opacity);
    let law = [red, red * (1.0 - opacity), 0.0];
    let off = off(&seen, std::array::from_fn(|c| law[c] + through * f64::from(BACKGROUND[c])), through);
    assert!(off < 1e-12 && off <= seen.error && seen.error < 1e-8, "off by {off}: {seen:?}");
}

#[test]
fn two_balls_in_one_place_show_their_mean_colour_and_lie_where_they_are() {
    let gas = |color| colored(set(Kernel::Constant, &[[0.0, 0.0, -5.0]], 2.0, 0.75), color);
    let scene = scene(40.0, 0.1, vec![gas([1.0, 0.0, 0.5]), gas([0.0, 0.0, 1.0])]);
    let view = &scene.views()[0];
    let reference = Reference::new(&scene, view, None);
    let seen = reference.radiance(32.0, 24.0);
    let end = BACKGROUND.map(|value| f64::from(value) / 16.0);
    let law = [0.5 * 15.0 / 16.0 + end[0], end[1], 0.75 * 15.0 / 16.0 + end[2]];
    assert!(off(&seen, law, 1.0 / 16.0) < 1e-14, "{seen:?}");
    // The mean of an exponential that ends: optical depth ln 16 over a length of 4.
    let rate = 16f64.ln() / 4.0;
    let mean = 3.0 + 1.0 / rate - 4.0 * (1.0 / 16.0) / (15.0 / 16.0);
    let depth = reference.mean_depth(32.0, 24.0);
    assert!((depth - mean).abs() < 1e-7, "{depth} is not {mean}");
    assert_eq!(reference.mean_depth(0.5, 0.5), f64::INFINITY);
}

#[test]
fn the_eye_may_be_inside_and_the_gas_behind_it() {
    for kernel in kernels() {
        let inside = set(kernel.clone(), &[[0.1, 0.2, 0.3], [-0.2, 0.1, -0.4]], 2.0, 0.9);
        let behind = set(kernel.clone(), &[[0.0, 0.0, 3.0], [0.0, 0.3, 1e6]], 1.0, 0.999);
        let gas = vec![colored(inside, [1.0, 0.5, 0.0]), colored(behind.clone(), [0.0, 1.0, 1.0])];
        let scene = scene(150.0, 0.01, gas);
        let view = &scene.views()[0];
        let reference = Reference::new(&scene, view, None);
        for [x, y] in [[32.0, 24.0], [0.5, 0.5], [63.5, 20.0], [10.0, 47.5]] {
            let truth = brute(&scene, view, x, y, None);
            let seen = reference.radiance(x, y);
            assert!(off(&seen, truth.color, truth.transmittance) <= seen.error && seen.error < TARGET, "{seen:?}");
            assert!(seen.transmittance < 0.9);
        }
    }
}

// ---- Pictures

/// Three sets, a mesh, stereo.
fn room(samples: u32, mode: StereoMode) -> Scene {
    let mut random = Random::new(54);
    let gas = Gas {
        count: 60,
        low: [-1.5, -1.0, -5.0],
        high: [1.5, 1.0, 0.0],
        radius: [0.2, 0.9],
        opacity: [0.0, 0.9],
        bright: 1.0,
    };
    let particles = [Kernel::Gaussian, Kernel::Linear, kernels().remove(5)].map(|kernel| gas.draw(&mut random, kernel));
    let mut scene = scene(50.0, 0.3, particles.to_vec());
    scene.camera.size = [37, 29];
    scene.camera.samples = samples;
    scene.stereo = Some(Stereo { interocular: 0.2, convergence: Some(3.0), mode });
    let corner = |x: f64, y: f64| DVec3::new(x, y, -3.0 + 0.5 * x);
    scene.meshes = vec![Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -0.8), corner(0.2, 1.0)],
        corners: vec![[0, 1, 2]],
        triangle_materials: vec![0],
        materials: vec![Material { color: [0.9, 0.4, 0.2], texture: None, unlit: false }],
        ..Mesh::default()
    }];
    scene
}

const REFERENCE: Method = Method::Reference(Parameters::DEFAULT);
const WITH_DISPARITY: Method = Method::Reference(Parameters { disparity: true });

fn bits(films: &[Film]) -> Vec<u32> {
    let planes = films.iter().flat_map(|film| film.color.iter().chain([&film.transmittance]).chain(&film.error));
    planes.flatten().map(|value| value.to_bits()).collect()
}

#[test]
fn a_film_holds_the_rays_and_their_bounds_on_any_number_of_threads() {
    let settings = Settings { method: REFERENCE, ..Settings::default() };
    for (samples, mode) in [(1, StereoMode::Parallel), (2, StereoMode::ToeIn)] {
        let scene = room(samples, mode);
        let films = draw(&scene, &settings, &()).unwrap().films;
        for threads in 1..=3 {
            let other = draw(&scene, &Settings { threads: Some(threads), ..settings.clone() }, &()).unwrap().films;
            assert!(bits(&films) == bits(&other), "{threads} threads");
        }
        let n = samples as usize;
        let (mut walls, mut clear) = (0, 0);
        for (film, view) in films.iter().zip(&scene.views()) {
            let layer = opaque::draw(&scene, view).unwrap();
            let reference = Reference::new(&scene, view, Some(&layer));
            let errors = film.error.as_ref().unwrap();
            for i in 0..37 * 29 {
                let (mut color, mut transmittance) = ([0.0; 3], 0.0);
                let share = 1.0 / (n * n) as f64;
                for k in 0..n * n {
                    let (column, row) = (i % 37 * n + k % n, i / 37 * n + k / n);
                    let seen = reference.radiance(column as f64 + 0.5, row as f64 + 0.5);
                    (0..3).for_each(|c| color[c] += share * seen.color[c]);
                    transmittance += share * seen.transmittance;
                    let depth = layer.depth[row * 37 * n + column];
                    assert!(depth.is_infinite() || seen.transmittance == 0.0);
                    (walls, clear) = (walls + usize::from(depth.is_finite()), clear + usize::from(depth.is_infinite()));
                    if i % 17 == 0 && k == 0 {
                        let stop = depth.is_finite().then(|| (depth, layer.color[row * 37 * n + column]));
                        let truth = brute(&scene, view, column as f64 + 0.5, row as f64 + 0.5, stop);
                        assert!(off(&seen, truth.color, truth.transmittance) <= seen.error);
                    }
                }
                let values = [color[0], color[1], color[2], transmittance];
                let planes = [&film.color[0], &film.color[1], &film.color[2], &film.transmittance];
                for (plane, value) in planes.iter().zip(values) {
                    let off = (f64::from(plane[i]) - value).abs();
                    assert!(off <= f64::from(errors[i]) && errors[i] < 1e-6, "{off}, bound {}", errors[i]);
                }
            }
        }
        assert!(walls > 100 && clear > 100);
    }
}

#[test]
fn the_bound_travels_into_the_file_and_other_methods_have_none() {
    let scene = room(1, StereoMode::Parallel);
    for &method in Method::ALL {
        let mut films = draw(&scene, &Settings { method, ..Settings::default() }, &()).unwrap().films;
        let film = films.remove(0);
        assert_eq!(film.error.is_some(), matches!(method, Method::Reference(_)));
        let error = film.error.clone();
        let picture = Picture::from_film(film);
        assert_eq!(picture.error, error);
        let file = (output::writer("exr").unwrap().encode)(&picture).unwrap();
        assert_eq!(file.windows(3).any(|bytes| bytes == b"\0E\0"), matches!(method, Method::Reference(_)));
    }
}

#[test]
fn progress_reaches_its_end() {
    struct Last(AtomicU64);
    impl Progress for Last {
        fn update(&self, done: u64, total: u64) {
            assert!(done <= total);
            self.0.fetch_max(done, Ordering::Relaxed);
        }
    }
    let last = Last(AtomicU64::new(0));
    let settings = Settings { method: REFERENCE, ..Settings::default() };
    draw(&room(2, StereoMode::Parallel), &settings, &last).unwrap();
    assert_eq!(last.0.swap(0, Ordering::Relaxed), 2 * 37 * 29 * 4);
    draw(&room(1, StereoMode::Parallel), &Settings { method: WITH_DISPARITY, ..settings }, &last).unwrap();
    assert_eq!(last.0.into_inner(), 2 * 2 * 37 * 29);
}

// ---- Disparity

/// The pixels that a point at depth `d` moves by from this eye's picture to the other's: the screen parallax
/// I (1 - D/d) over the width of a pixel on the screen plane, to the right eye's picture; with D absent -I/d in tangents.
fn shift(scene: &Scene, side: Side, d: f64) -> f64 {
    let rig = scene.stereo.as_ref().unwrap();
    let tangent = rig.interocular * (rig.convergence.map_or(0.0, f64::recip) - 1.0 / d);
    let pixel = 2.0 * (0.5 * scene.camera.fov_y).tan() / f64::from(scene.camera.size[1]);
    match side {
        Side::Left => tangent / pixel,
        Side::Right => -tangent / pixel,
    }
}

#[test]
fn disparity_is_the_parallax_of_the_mean_depth() {
    let settings = Settings { method: WITH_DISPARITY, ..Settings::default() };
    for (convergence, position) in
        [(Some(3.0), DVec3::ZERO), (None, DVec3::ZERO), (Some(5.0), DVec3::new(0.3, -0.2, 1.0))]
    {
        let mut scene = room(1, StereoMode::Parallel);
        scene.particles.truncate(1);
        scene.particles[0] = set(Kernel::Gaussian, &[[0.3, 0.2, -2.0], [-0.8, 0.5, -4.0], [-0.6, 0.6, -1.0]], 0.4, 0.7);
        scene.camera.look_at += position - scene.camera.position;
        scene.camera.position = position;
        scene.stereo.as_mut().unwrap().convergence = convergence;
        let films = draw(&scene, &settings, &()).unwrap().films;
        let views = scene.views();
        let (mut seen, mut empty) = (0, 0);
        for ((film, view), side) in films.iter().zip(&views).zip(Side::ALL) {
            let layer = opaque::draw(&scene, view).unwrap();
            let reference = Reference::new(&scene, view, Some(&layer));
            let disparity = film.disparity.as_ref().unwrap();
            assert_eq!((disparity.side, disparity.x.len()), (side, 37 * 29));
            for (i, &x) in disparity.x.iter().enumerate() {
                let depth = reference.mean_depth((i % 37) as f64 + 0.5, (i / 37) as f64 + 0.5);
                if depth.is_infinite() {
                    assert!(x.is_nan() && film.transmittance[i] == 1.0, "{x}");
                    empty += 1;
                } else {
                    let expected = shift(&scene, side, depth);
                    assert!((f64::from(x) - expected).abs() < 1e-5, "{side:?}, depth {depth}: {x}, not {expected}");
                    seen += 1;
                }
            }
        }
        assert!(seen > 100 && empty > 100, "{seen} {empty}");
        // The picture is the same as without.
        let without = draw(&scene, &Settings { method: REFERENCE, ..settings.clone() }, &()).unwrap().films;
        assert!(bits(&films) == bits(&without) && without.iter().all(|film| film.disparity.is_none()));
    }
}

/// Where a small ball is in one eye's picture, its disparity leads to where it is in the other's.
#[test]
fn disparity_leads_from_eye_to_eye() {
    for samples in [1, 3] {
        let ball = [0.5, -0.3, -2.5];
        let mut scene = scene(50.0, 0.3, vec![set(Kernel::Constant, &[ball], 0.1, 0.9)]);
        scene.camera.size = [160, 120];
        scene.camera.samples = samples;
        scene.stereo = Some(Stereo { interocular: 0.2, convergence: Some(1.5), mode: StereoMode::Parallel });
        let views = scene.views();
        let films = draw(&scene, &Settings { method: WITH_DISPARITY, ..Settings::default() }, &()).unwrap().films;
        let places = views.iter().map(|view| view.project(view.eye_from_point(ball.into())) / f64::from(samples));
        let places: Vec<_> = places.collect();
        for (from, to) in [(0, 1), (1, 0)] {
            let pixel = places[from].y as usize * 160 + places[from].x as usize;
            let disparity = f64::from(films[from].disparity.as_ref().unwrap().x[pixel]);
            let expected = places[to].x - places[from].x;
            assert!(expected.abs() > 3.0 && (disparity - expected).abs() < 0.2, "{disparity}, not {expected}");
            assert!((places[to].y - places[from].y).abs() < 1e-9);
        }
    }
}

#[test]
fn samples_share_a_disparity_by_what_they_show() {
    let mut film = Film::new([4, 2]);
    film.transmittance = [0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0].into();
    let x = [4.0, -2.0, f32::NAN, f32::NAN, f32::NAN, 100.0, f32::NAN, 6.0].into();
    film.disparity = Some(stereomist::picture::Disparity { side: Side::Right, x });
    let half = film.downsample(2).disparity.unwrap();
    assert_eq!(half.side, Side::Right);
    // (1 x 4 - 0.5 x 2) / 1.5, in pixels of two samples; what shows nothing yet counts only where nothing else does.
    assert!((half.x[0] - 1.0).abs() < 1e-6 && half.x[1] == 3.0, "{:?}", half.x);
    film.disparity.as_mut().unwrap().x[7] = f32::NAN;
    assert!(film.downsample(2).disparity.unwrap().x[1].is_nan());
}

#[test]
fn disparity_is_the_same_on_any_threads_and_from_frame_to_frame() {
    for samples in [1, 2] {
        let scene = room(samples, StereoMode::Parallel);
        let planes = |films: &[Film]| -> Vec<(Side, Vec<u32>)> {
            let disparities = films.iter().map(|film| film.disparity.as_ref().unwrap());
            disparities.map(|d| (d.side, d.x.iter().map(|x| x.to_bits()).collect())).collect()
        };
        let settings = Settings { method: WITH_DISPARITY, ..Settings::default() };
        let first = planes(&draw(&scene, &settings, &()).unwrap().films);
        assert_eq!(first.iter().map(|(side, _)| *side).collect::<Vec<_>>(), Side::ALL);
        for threads in 1..=3 {
            let mut session = Session::new(&Settings { threads: Some(threads), ..settings.clone() }).unwrap();
            for _ in 0..2 {
                let rendering = session.draw(&scene, &()).unwrap();
                assert!(planes(&rendering.films) == first, "{threads} threads");
                session.recycle(rendering);
            }
        }
    }
}

#[test]
fn disparity_needs_another_eye_with_a_parallel_axis() {
    let settings = Settings { method: WITH_DISPARITY, ..Settings::default() };
    let toed = draw(&room(1, StereoMode::ToeIn), &settings, &()).unwrap_err();
    assert!(toed.exit_code() == 2 && toed.to_string().contains("vertical"), "{toed}");
    let mut mono = room(1, StereoMode::Parallel);
    mono.stereo = None;
    let error = draw(&mono, &settings, &()).unwrap_err();
    assert!(error.exit_code() == 2 && error.to_string().contains("[stereo]"), "{error}");
    for scene in [mono, room(1, StereoMode::ToeIn)] {
        assert!(draw(&scene, &Settings { method: REFERENCE, ..settings.clone() }, &()).is_ok());
    }
}
