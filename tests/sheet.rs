//! The sheet buffer against slices summed ray by ray in f64, and its laws: the error falls with the first power of a
//! slice's width, sums end at 1, nothing pops.

use crate::harness::{Difference, kernels, set};
use crate::methods::{self, bits, camera, films, rig, scene};
use crate::spherical::{ball, middle, near_sweep, wall, wall_sweep};
use crate::truth::{Opaque, Picture, Pinhole, linear_primitive};
use glam::DVec3;
use libm::erf;
use std::collections::BTreeMap;
use stereomist::render::cpu::simd::Level;
use stereomist::render::method::sheet::{Lookup, Parameters};
use stereomist::render::{DEFAULT_TOLERANCE, Method, OpacityModel, Settings, draw};
use stereomist::scene::{Attribute, Camera, Kernel, Scene};

/// A primitive of the density along a line at distance `b` from the centre, for |u| <= sqrt(1 - b^2), from the formulas.
fn primitive(kernel: &Kernel, b: f64, u: f64) -> f64 {
    match kernel {
        Kernel::Gaussian => (-4.5 * b * b).exp() * erf(4.5f64.sqrt() * u),
        Kernel::Beliaev => (-8.0 * b * b).exp() * erf(8f64.sqrt() * u),
        Kernel::Linear => linear_primitive(u, b, 1.0),
        Kernel::Constant => u,
        Kernel::Poly => {
            let l2 = 1.0 - b * b;
            l2 * l2 * u - 2.0 * l2 * u.powi(3) / 3.0 + u.powi(5) / 5.0
        }
        Kernel::Table(profile) => {
            // By parts: k u less the integral of t k'(q) dq, shell by shell, with q^2 = t^2 + b^2.
            let (q, k) = (profile.q(), profile.densities());
            let part = |t: f64| 0.5 * (t * t.hypot(b) - if b > 0.0 { b * b * (t / b).asinh() } else { 0.0 });
            let end = u.abs().hypot(b).min(1.0);
            let mut sum = 0.0;
            for i in 1..q.len() {
                let (low, high) = (q[i - 1].max(b), q[i].min(end));
                let slope = (k[i] - k[i - 1]) / (q[i] - q[i - 1]);
                if high > low {
                    let at = |q: f64| (q * q - b * b).max(0.0).sqrt();
                    sum -= slope * (part(at(high)) - part(at(low)));
                }
                if (q[i - 1]..=q[i]).contains(&end) {
                    sum += (k[i - 1] + slope * (end - q[i - 1])) * u.abs();
                    break;
                }
            }
            sum.copysign(u)
        }
    }
}

/// The share of the integral through the centre that lies between two distances from the middle, at distance `b`.
pub fn share(kernel: &Kernel, b: f64, from: f64, to: f64) -> f64 {
    let half = (1.0 - b * b).max(0.0).sqrt();
    let at = |u: f64| primitive(kernel, b, u.clamp(-half, half));
    (at(to) - at(from)) / (primitive(kernel, 0.0, 1.0) - primitive(kernel, 0.0, -1.0))
}

/// Slices summed as defined; `nearest`: segments end at the nearest of so many planes.
pub fn sheet(scene: &Scene, width: f64, nearest: Option<u32>, pinhole: &Pinhole, opaque: Option<&Opaque>) -> Picture {
    let [columns, rows] = [pinhole.columns(), pinhole.rows()];
    let samples = columns / pinhole.size[0];
    let pixels = pinhole.size[0] * pinhole.size[1];
    let mut picture = Picture {
        size: pinhole.size,
        planes: [0; 4].map(|_| vec![0.0; pixels]),
        depth: None,
        fragile: vec![false; pixels],
    };
    for sample in 0..columns * rows {
        let (column, row) = (sample % columns, sample / columns);
        let pixel = row / samples * pinhole.size[0] + column / samples;
        let ray = pinhole.ray(column, row);
        let wall = opaque.map_or(f64::INFINITY, |opaque| opaque.depth[sample]);
        let mut fragile = opaque.is_some_and(|opaque| opaque.fragile[sample]);
        let mut slices: BTreeMap<i64, [f64; 4]> = BTreeMap::new();
        for set in &scene.particles {
            for i in 0..set.x.len() {
                let c = pinhole.enter([set.x[i], set.y[i], set.z[i]]);
                let (depth, r) = (-c[2], set.radius.get(i));
                let card = f64::max(depth, pinhole.near);
                let b = (ray[0] * card - c[0]).hypot(ray[1] * card - c[1]) / r;
                if depth + r <= pinhole.near || b > 1.0 + 1e-5 {
                    continue;
                }
                fragile |= (b - 1.0).abs() < 1e-5;
                let slice = |depth: f64| ((depth - pinhole.near) / width).floor() as i64;
                let thickness = -(1.0 - set.opacity.get(i)).ln();
                for k in slice(f64::max(depth - r, pinhole.near))..=slice(depth + r) {
                    let ends = [k, k + 1].map(|k| f64::min(pinhole.near + k as f64 * width, wall));
                    let [from, to] = ends.map(|end| {
                        let t = ((end - depth) / r).clamp(-1.0, 1.0);
                        let Some(count) = nearest.map(f64::from) else { return t };
                        let at = 0.5 * (t + 1.0) * count;
                        fragile |= (at - at.floor() - 0.5).abs() < 1e-3;
                        2.0 * at.round_ties_even() / count - 1.0
                    });
                    let alpha = thickness * share(&set.kernel, b.min(1.0), from, to);
                    let sum = slices.entry(k).or_default();
                    for (sum, color) in sum.iter_mut().zip(set.color.get(i)) {
                        *sum += alpha * f64::from(color);
                    }
                    sum[3] += alpha;
                }
            }
        }
        let (mut light, mut through) = ([0.0; 3], 1.0);
        for [red, green, blue, alpha] in slices.into_values() {
            for (light, sum) in light.iter_mut().zip([red, green, blue]) {
                *light += through * sum / alpha.max(1.0);
            }
            through *= 1.0 - alpha.min(1.0);
        }
        let behind = match opaque {
            Some(opaque) if wall.is_finite() => opaque.color[sample],
            _ => scene.background.map(f64::from),
        };
        let share = 1.0 / (samples * samples) as f64;
        for (channel, light) in light.into_iter().enumerate() {
            picture.planes[channel][pixel] += share * (light + through * behind[channel]);
        }
        picture.planes[3][pixel] += if wall.is_finite() { 0.0 } else { share * through };
        picture.fragile[pixel] |= fragile;
    }
    picture
}

fn settings(parameters: Parameters, tolerance: f64) -> Settings {
    Settings { method: Method::Sheet(parameters), tolerance, ..Settings::default() }
}

/// Scenes of all kinds, for a kernel.
fn scenes(kernel: &Kernel) -> Vec<Scene> {
    let build: [fn(Kernel) -> Vec<Scene>; 13] = [
        methods::many_colours,
        methods::inside,
        methods::surrounded,
        methods::looking_away,
        methods::at_the_near_plane,
        methods::subpixel,
        methods::odd_sizes,
        methods::toe_in,
        methods::dense,
        methods::meshes_in_gas,
        methods::meshes_seen_toed_in_and_supersampled,
        methods::mixed_sets,
        methods::without_gas,
    ];
    build.into_iter().flat_map(|build| build(kernel.clone())).collect()
}

/// Renders with a kernel of many scenes, both lookups and every level, against the definition.
fn agree(kernel: &Kernel, limit: f64) {
    for (number, scene) in scenes(kernel).iter().enumerate() {
        let eyes = methods::eyes(scene);
        for (width, lookup) in [(0.21, Lookup::Interpolated), (0.9, Lookup::Interpolated), (0.21, Lookup::Nearest)] {
            let segments = 256;
            let nearest = (lookup == Lookup::Nearest).then_some(segments);
            let truths: Vec<_> =
                eyes.iter().map(|(eye, opaque)| sheet(scene, width, nearest, eye, opaque.as_ref())).collect();
            let parameters = Parameters { slice_width: Some(width), segments, lookup };
            let levels = if *kernel == Kernel::default() { Level::available() } else { vec![Level::best()] };
            for level in levels {
                for tolerance in [0.0, DEFAULT_TOLERANCE] {
                    let settings = Settings { simd: Some(level), ..settings(parameters, tolerance) };
                    let difference: Difference = methods::compare(&films(scene, &settings), &truths, limit + tolerance);
                    let name = kernel.name();
                    hold(&difference, lookup, &format!("{name} scene {number} {settings:?}"));
                    if tolerance == 0.0 {
                        println!("{name} scene {number} {width} {lookup:?}: {:.2e}", difference.max);
                    }
                }
            }
        }
    }
}

/// Holds what was found against the definition: sound pixels within the limit. Of the others the nearest plane may be another.
pub fn hold(difference: &Difference, lookup: Lookup, what: &str) {
    let sound = difference.over - difference.over_fragile;
    assert!(sound <= difference.pixels / 10_000, "{what}: {difference:?}");
    assert_eq!(difference.gross, 0, "{what}: {difference:?}");
    let most = match lookup {
        Lookup::Nearest => difference.pixels,
        Lookup::Interpolated => 1 + difference.pixels / 1000,
    };
    assert!(difference.over_fragile <= most, "{what}: {difference:?}");
}

/// What the table's interpolation costs: most where a kernel ends with a step, whose rim crosses its cells.
pub const LIMIT: f64 = 2e-3;

#[test]
fn agrees_with_its_definition() {
    for kernel in kernels() {
        agree(&kernel, LIMIT);
    }
}

#[test]
fn shares_are_integrals() {
    for kernel in kernels() {
        for b in [0.0, 0.2, 0.41, 0.7, 0.97] {
            for (from, to) in [(-1.0, 1.0), (-0.3, 0.4), (0.1, 0.7), (-0.8, -0.2)] {
                let count = 400_000;
                let step = (to - from) / f64::from(count);
                let density = |i: i32| kernel.density((from + (f64::from(i) + 0.5) * step).hypot(b));
                let sum = (0..count).map(density).sum::<f64>() * step / kernel.chord(0.0);
                let got = share(&kernel, b, from, to);
                assert!((got - sum).abs() < 5e-6, "{} {b} {from} {to}: {got} for {sum}", kernel.name());
            }
        }
    }
}

/// Two coloured particles, one partly behind the other.
fn pair(kernel: Kernel) -> Scene {
    let camera = Camera { up: DVec3::Y, ..camera([0.0; 3], [0.0, 0.0, -1.0], 14.0, [24, 20]) };
    let mut gas = set(kernel, &[[0.1, 0.0, -9.2], [-0.15, 0.1, -9.7]], 0.9, 0.0);
    gas.radius = Attribute::Each(vec![0.9, 0.7]);
    gas.opacity = Attribute::Each(vec![0.8, 0.9]);
    gas.color = Attribute::Each(vec![[1.0, 0.2, 0.0], [0.1, 0.4, 1.0]]);
    scene(camera, rig(0.2, Some(9.0)), vec![gas])
}

/// Absorption and emission summed finely along z, each particle seen on its card: what slices of no width would show.
fn integral(scene: &Scene, pinhole: &Pinhole) -> [Vec<f64>; 4] {
    let set = &scene.particles[0];
    let (near, far, count) = (8.0, 11.0, 6000);
    let step = (far - near) / f64::from(count);
    let mut planes = [0; 4].map(|_| Vec::new());
    for sample in 0..pinhole.columns() * pinhole.rows() {
        let ray = pinhole.ray(sample % pinhole.columns(), sample / pinhole.columns());
        let (mut light, mut through) = ([0.0; 3], 1.0);
        for at in 0..count {
            let z = near + (f64::from(at) + 0.5) * step;
            let (mut tau, mut emitted) = (0.0, [0.0; 3]);
            for i in 0..set.x.len() {
                let c = pinhole.enter([set.x[i], set.y[i], set.z[i]]);
                let r = set.radius.get(i);
                let offset = [-ray[0] * c[2] - c[0], -ray[1] * c[2] - c[1], z + c[2]];
                let q = offset.iter().map(|v| v * v).sum::<f64>().sqrt() / r;
                let density = -(1.0 - set.opacity.get(i)).ln() * set.kernel.density(q) / (r * set.kernel.chord(0.0));
                tau += density;
                for (emitted, color) in emitted.iter_mut().zip(set.color.get(i)) {
                    *emitted += density * f64::from(color);
                }
            }
            let alpha = 1.0 - (-tau * step).exp();
            if tau > 0.0 {
                for (light, emitted) in light.iter_mut().zip(emitted) {
                    *light += through * alpha * emitted / tau;
                }
            }
            through *= 1.0 - alpha;
        }
        for (plane, (light, background)) in planes.iter_mut().zip(light.into_iter().zip(scene.background)) {
            plane.push(light + through * f64::from(background));
        }
        planes[3].push(through);
    }
    planes
}

#[test]
fn the_error_falls_with_the_first_power_of_the_width() {
    for kernel in [Kernel::Gaussian, Kernel::Linear, Kernel::Poly] {
        let scene = pair(kernel.clone());
        let truths: Vec<_> = methods::eyes(&scene).iter().map(|(eye, _)| integral(&scene, eye)).collect();
        let error = |width: f64| {
            let parameters = Parameters { slice_width: Some(width), segments: 2048, lookup: Lookup::Interpolated };
            let mut difference = Difference::default();
            for (index, (film, truth)) in films(&scene, &settings(parameters, 0.0)).iter().zip(&truths).enumerate() {
                difference.add(index, film, truth, &vec![false; 480], 1.0);
            }
            difference.rmse()
        };
        // The slope of log error over log width by least squares.
        let points: Vec<[f64; 2]> = (0..6)
            .map(|i| {
                let width = 0.3 * 0.5f64.powi(i);
                [width.ln(), error(width).ln()]
            })
            .collect();
        let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64;
        let [x, y] = [mean(0), mean(1)];
        let slope = points.iter().map(|[a, b]| (a - x) * (b - y)).sum::<f64>()
            / points.iter().map(|[a, _]| (a - x).powi(2)).sum::<f64>();
        let errors: Vec<_> = points.iter().map(|[_, error]| error.exp()).collect();
        println!("{}: order {slope:.3}, errors {errors:.6?}", kernel.name());
        assert!((slope - 1.0).abs() < 0.1, "{}: order {slope}, errors {errors:?}", kernel.name());
        assert!(errors[5] < 2e-3, "{errors:?}");
    }
}

#[test]
fn the_centre_shows_the_opacity_as_slices_get_narrow() {
    for kernel in kernels() {
        let mut scene = ball(3.0, 0.5, 0.6, 0.05);
        scene.particles[0].kernel = kernel;
        let shown = |width: f64| {
            let parameters = Parameters { slice_width: Some(width), ..Parameters::default() };
            middle(&scene, &settings(parameters, 0.0))
        };
        assert!((shown(0.001) - 0.6).abs() < 2e-3, "{}", shown(0.001));
        // Of a whole ball in one slice the optical depth itself is shown.
        assert!((shown(10.0) + 0.4f64.ln()).abs() < 1e-5, "{}", shown(10.0));
    }
}

#[test]
fn sums_end_at_one_and_their_colours_are_scaled_with_them() {
    let mut scene = ball(3.0, 0.5, 0.99, 0.05);
    let first = scene.particles[0].clone();
    scene.particles[0].color = Attribute::Uniform([1.0, 0.0, 0.0]);
    let mut second = first;
    second.color = Attribute::Uniform([0.0, 1.0, 0.0]);
    second.opacity = Attribute::Uniform(1.0 - 0.01f64.powi(3));
    scene.particles.push(second);
    scene.background = [0.0, 0.0, 1.0];
    let parameters = Parameters { slice_width: Some(10.0), ..Parameters::default() };
    let film = films(&scene, &settings(parameters, 0.0)).remove(0);
    let centre = 16 * 33 + 16;
    let shown = [film.color[0][centre], film.color[1][centre], film.color[2][centre], film.transmittance[centre]];
    for (shown, expected) in shown.into_iter().zip([0.25, 0.75, 0.0, 0.0]) {
        assert!((shown - expected).abs() < 1e-5, "{shown} for {expected}");
    }
}

#[test]
fn nothing_pops_at_the_near_plane_and_at_walls() {
    for &lookup in Lookup::ALL {
        // A step takes away 0.02 of the path, on which the optical depth per unit is at most 0.92 / 0.83; the nearest of 128
        // planes adds half a segment at each end.
        let most = 0.92 / 0.83 * (0.02 + if lookup == Lookup::Nearest { 2.0 / 128.0 } else { 0.0 }) * 1.1;
        // Slices so narrow that opacity added for optical depth costs less than that.
        let parameters = Parameters { slice_width: Some(0.02), segments: 128, lookup };
        let (jump, [first, last]) = near_sweep(&settings(parameters, 0.0));
        assert!(jump < most && first > 1.0 && last == 0.0, "{lookup:?}: {jump}, {first}, {last}");
        let (jump, [first, last]) = wall_sweep(&settings(parameters, 0.0));
        assert!(jump < most && first == 0.0 && last > 1.0, "{lookup:?}: {jump}, {first}, {last}");
    }
    let walled = Scene { meshes: vec![wall(3.0)], ..ball(3.0, 1.0, 0.6, 0.05) };
    let parameters = Parameters { slice_width: Some(0.002), ..Parameters::default() };
    for scene in [walled, ball(3.0, 1.0, 0.6, 3.0)] {
        let shown = middle(&scene, &settings(parameters, 0.0));
        assert!((shown - (1.0 - 0.4f64.sqrt())).abs() < 2e-3, "{shown}");
    }
}

#[test]
fn the_bytes_depend_on_nothing_but_the_scene() {
    let mut scenes = methods::mixed_sets(Kernel::default());
    scenes.extend(methods::meshes_in_gas(Kernel::Poly));
    scenes.extend(methods::dense(Kernel::Gaussian));
    scenes.extend(methods::odd_sizes(Kernel::Constant));
    for scene in &scenes {
        for &lookup in Lookup::ALL {
            for tolerance in [0.0, DEFAULT_TOLERANCE] {
                let settings = settings(Parameters { lookup, ..Parameters::default() }, tolerance);
                let with = |threads| bits(&films(scene, &Settings { threads: Some(threads), ..settings.clone() }));
                let one = with(1);
                assert!([1, 2, 3].into_iter().all(|threads| with(threads) == one), "{settings:?}");
                let linear = Settings { opacity_model: OpacityModel::Linear, ..settings.clone() };
                assert!(bits(&films(scene, &linear)) == one, "the opacity model");
            }
        }
    }
}

#[test]
fn the_width_is_half_the_median_radius() {
    let scene = ball(3.0, 0.5, 0.6, 0.05);
    assert_eq!(Parameters::default().width(&scene), 0.25);
    let mut scene = pair(Kernel::Gaussian);
    scene.particles[0].radius = Attribute::Each(vec![0.9, 0.7]);
    assert_eq!(Parameters::default().width(&scene), 0.45);
    scene.particles.push(set(Kernel::Linear, &[[0.0; 3]; 5], 0.2, 0.5));
    assert_eq!(Parameters::default().width(&scene), 0.1);
    assert_eq!(Parameters { slice_width: Some(3.0), ..Parameters::default() }.width(&scene), 3.0);
    // The same picture as with that width.
    let given = Parameters { slice_width: Some(0.1), ..Parameters::default() };
    let [one, two] = [Parameters::default(), given].map(|parameters| bits(&films(&scene, &settings(parameters, 0.0))));
    assert!(one == two);
}

#[test]
fn more_slices_than_can_be_drawn_are_refused() {
    let scene = ball(3.0, 0.5, 0.6, 0.05);
    let with = |width: f64| {
        draw(&scene, &settings(Parameters { slice_width: Some(width), ..Parameters::default() }, 0.0), &())
    };
    assert!(with(1e-4).is_ok());
    for width in [1e-5, 1e-300] {
        let message = with(width).unwrap_err().to_string();
        assert!(
            message.contains("particle 0 of set 1") && message.contains("slice_width of at least 1.526e-5"),
            "{message}"
        );
    }
    // Thin slices far away are no hindrance where nothing is.
    let far = ball(1e7, 0.5, 0.6, 0.05);
    assert!(draw(&far, &settings(Parameters { slice_width: Some(0.01), ..Parameters::default() }, 0.0), &()).is_ok());
}
