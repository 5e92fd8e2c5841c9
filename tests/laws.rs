//! Laws that hold whatever the picture: of kernels, of the footprint table, of the stereo rig.

use crate::harness::{Random, kernels};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};
use stereomist::scene::stereo::{self, share_depth};
use stereomist::scene::{Camera, Kernel, Stereo, StereoMode, View};

// ---- Kernels

/// Quadrature of `f` from `u0` to `u1` by the double exponential rule, which takes the square roots at a ball's rim.
fn integrate(u0: f64, u1: f64, f: impl Fn(f64) -> f64) -> f64 {
    const STEP: f64 = 0.02;
    let half = 0.5 * (u1 - u0);
    let term = |j: i32| {
        let t = f64::from(j) * STEP;
        let s = FRAC_PI_2 * t.sinh();
        let weight = FRAC_PI_2 * t.cosh() / s.cosh().powi(2);
        weight * f(0.5 * (u0 + u1) + half * s.tanh())
    };
    half * STEP * (-170..=170).map(term).sum::<f64>()
}

/// Integral of a kernel's density along a line, cut where the density has a kink.
fn along(kernel: &Kernel, b: f64, u0: f64, u1: f64) -> f64 {
    let half = ((1.0 - b) * (1.0 + b)).sqrt();
    let (u0, u1) = (u0.max(-half), u1.min(half));
    if u1 <= u0 {
        return 0.0;
    }
    let mut cuts = vec![u0, u1, 0.0];
    if let Kernel::Table(profile) = kernel {
        cuts.extend(
            profile.q().iter().flat_map(|q| [1.0, -1.0].map(|side| side * ((q - b) * (q + b)).max(0.0).sqrt())),
        );
    }
    cuts.iter_mut().for_each(|cut| *cut = cut.clamp(u0, u1));
    cuts.sort_by(f64::total_cmp);
    // Just below 1 at the rim: rounding must not fall off the edge of a density that jumps there.
    let density = |u: f64| kernel.density((u * u + b * b).sqrt().min(1.0 - f64::EPSILON));
    cuts.windows(2).map(|w| if w[1] > w[0] { integrate(w[0], w[1], density) } else { 0.0 }).sum()
}

fn awkward_tables() -> Vec<Kernel> {
    [
        (vec![0.0, 1.0], vec![1.0, 1.0]),
        (vec![0.0, 1.0], vec![0.0, 3.0]),
        (vec![0.0, 0.7, 0.700_001, 1.0], vec![0.0, 0.0, 5.0, 4.0]),
        (vec![0.0, 0.3, 0.6, 1.0], vec![1.0, 0.0, 0.0, 0.0]),
    ]
    .into_iter()
    .map(|(q, density)| Kernel::table(q, density).unwrap())
    .collect()
}

#[test]
fn chords_and_segments_are_the_integrals_of_the_density() {
    let mut random = Random::new(2);
    for kernel in kernels().into_iter().chain(awkward_tables()) {
        for i in 0..=50 {
            let b = if i < 45 { f64::from(i) / 45.0 } else { 1.0 - 10f64.powi(43 - i) };
            let whole = along(&kernel, b, -1.0, 1.0);
            let chord = kernel.chord(b);
            assert!((chord - whole).abs() < 1e-12, "{} chord at {b}: {chord} for {whole}", kernel.name());
            assert!((kernel.segment(b, f64::NEG_INFINITY, f64::INFINITY) - chord).abs() < 1e-14);
            for _ in 0..20 {
                let u0 = random.uniform(-1.1, 1.1);
                let u1 = u0 + random.uniform(0.0, 2.2) * 10f64.powf(random.uniform(-6.0, 0.0));
                let (segment, truth) = (kernel.segment(b, u0, u1), along(&kernel, b, u0, u1));
                let off = (segment - truth).abs();
                assert!(off < 1e-12, "{} at {b} from {u0} to {u1}: {segment} for {truth}", kernel.name());
            }
        }
    }
}

/// A segment so short that the density hardly varies is density times length, to many digits: nothing cancels.
#[test]
fn short_segments_keep_their_digits() {
    let mut random = Random::new(3);
    for kernel in kernels() {
        for _ in 0..2000 {
            let b = random.uniform(0.0, 0.9);
            let middle = random.uniform(-0.8, 0.8) * ((1.0 - b) * (1.0 + b)).sqrt();
            // Ends that are exact in binary, so that the length is.
            let u0 = (middle * 2f64.powi(40)).round() * 2f64.powi(-40);
            let length = 2f64.powi(-28);
            let expected = length * kernel.density((b * b + (u0 + 0.5 * length).powi(2)).sqrt());
            let segment = kernel.segment(b, u0, u0 + length);
            let off = (segment / expected - 1.0).abs();
            assert!(off < 1e-9, "{} at {b} from {u0}: {segment} for {expected}", kernel.name());
        }
    }
}

#[test]
fn segments_telescope_mirror_and_add_up_to_the_chord() {
    let mut random = Random::new(4);
    for kernel in kernels() {
        for _ in 0..300 {
            let b = random.uniform(0.0, 1.0);
            let mut cuts: Vec<f64> = (0..8).map(|_| random.uniform(-1.0, 1.0)).collect();
            cuts.extend([-1.0, 1.0]);
            cuts.sort_by(f64::total_cmp);
            let sum: f64 = cuts.windows(2).map(|w| kernel.segment(b, w[0], w[1])).sum();
            assert!((sum - kernel.chord(b)).abs() < 1e-14, "{} at {b}", kernel.name());
            let (a, c) = (cuts[2], cuts[5]);
            assert!((kernel.segment(b, a, c) - kernel.segment(b, -c, -a)).abs() < 1e-15);
            assert_eq!(kernel.segment(b, c, a), 0.0);
        }
        for b in [1.0, 1.5] {
            assert_eq!((kernel.segment(b, -1.0, 1.0), kernel.chord(b), kernel.footprint(b)), (0.0, 0.0, 0.0));
        }
        assert_eq!(kernel.segment(0.3, 0.99, 2.0), 0.0);
    }
}

#[test]
fn footprints_fall_from_one_to_zero() {
    for kernel in kernels() {
        assert_eq!(kernel.footprint(0.0), 1.0, "{}", kernel.name());
        assert_eq!(kernel.footprint(1.0), 0.0);
        // The steepest end is that of the ball: sqrt(1 - u^2).
        assert!(kernel.footprint(1.0 - 1e-14) < 1.5e-7, "{}", kernel.name());
        let mut last = 1.0;
        for i in 1..=10_000 {
            let f = kernel.footprint(f64::from(i) / 10_000.0);
            assert!(f <= last && f >= 0.0, "{} rises at {i}", kernel.name());
            last = f;
        }
    }
}

#[test]
fn slope_bounds_are_honest_and_exact_for_the_named_kernels() {
    const STEPS: i32 = 100_000;
    for kernel in kernels().into_iter().chain(awkward_tables()) {
        let slope = |u: f64, v: f64| (kernel.footprint(v) - kernel.footprint(u)).abs() / (v - u);
        let at = |i: i32| f64::from(i) / f64::from(STEPS);
        let steepest = (0..STEPS).map(|i| slope(at(i), at(i + 1))).fold(0.0, f64::max);
        let bound = kernel.slope_bound();
        assert!(steepest <= bound * (1.0 + 1e-9), "{}: {steepest} above {bound}", kernel.name());
        if bound.is_infinite() {
            assert!(slope(1.0 - 1e-12, 1.0) > 1e3, "{}: {steepest}", kernel.name());
        } else if !matches!(kernel, Kernel::Table(_)) {
            assert!(steepest > bound * (1.0 - 1e-6), "{}: {steepest} far below {bound}", kernel.name());
        }
    }
}

#[test]
fn closed_forms_are_the_documented_ones() {
    for i in 0..=1000 {
        let u = f64::from(i) / 1000.0;
        let l = (1.0 - u * u).sqrt();
        let gaussian =
            (-4.5 * u * u).exp() * libm::erf(3.0 * ((1.0 - u * u) / 2.0).sqrt()) / libm::erf(3.0 / 2f64.sqrt());
        let linear = if u > 0.0 { l - u * u * (l / u).asinh() } else { 1.0 };
        for (name, f) in [("gaussian", gaussian), ("linear", linear), ("constant", l), ("poly", l.powi(5))] {
            let kernel = Kernel::from_name(name).unwrap();
            assert!((kernel.footprint(u) - f).abs() < 1e-14, "{name} at {u}: {} for {f}", kernel.footprint(u));
        }
    }
    let bell = Kernel::Gaussian;
    assert!((bell.chord(0.0) - (2.0 * PI).sqrt() / 3.0 * libm::erf(3.0 / 2f64.sqrt())).abs() < 1e-15);
    assert!((Kernel::Beliaev.chord(0.0) - (PI / 8.0).sqrt() * libm::erf(8f64.sqrt())).abs() < 1e-15);
    // tau s sqrt(pi/2) exp(-b^2/2s^2) [erf(u1/(s sqrt2)) - erf(u0/(s sqrt2))], s = 1/3.
    let root = 3.0 / 2f64.sqrt();
    let printed = (PI / 2.0).sqrt() / 3.0 * (-4.5f64 * 0.04).exp() * (libm::erf(0.5 * root) - libm::erf(-0.3 * root));
    assert!((bell.segment(0.2, -0.3, 0.5) - printed).abs() < 1e-15);
}

#[test]
fn billboards_are_square_for_the_gaussian_and_round_for_the_others() {
    for kernel in kernels() {
        let square = kernel == Kernel::Gaussian;
        assert_eq!(kernel.billboard(0.0, 0.0), 1.0);
        assert_eq!(kernel.billboard(1.0, 0.0), 0.0);
        assert_eq!(kernel.billboard(0.0, -1.0), 0.0);
        assert_eq!(kernel.billboard(0.8, -0.8) > 0.0, square, "{}", kernel.name());
        let expected = if square { (-4.5f64 * 0.25).exp() } else { kernel.footprint(0.5) };
        assert!((kernel.billboard(-0.3, 0.4) - expected).abs() < 1e-15);
    }
    // Separable, and a step of exp(-4.5) at the edge of the square.
    let bell = Kernel::Gaussian;
    assert!((bell.billboard(0.3, 0.7) - bell.billboard(0.3, 0.0) * bell.billboard(0.0, 0.7)).abs() < 1e-16);
    assert!((bell.billboard(1.0 - 1e-12, 0.0) - (-4.5f64).exp()).abs() < 1e-9);
}

#[test]
fn names_and_profiles_are_checked() {
    for name in Kernel::NAMES {
        assert_eq!(Kernel::from_name(name).unwrap().name(), *name);
    }
    assert_eq!((Kernel::from_name("table"), Kernel::from_name("Gaussian")), (None, None));
    assert_eq!(Kernel::default(), Kernel::Gaussian);
    for (q, density, says) in [
        (vec![], vec![], "no rows"),
        (vec![0.0], vec![1.0], "last q is 1"),
        (vec![0.0, 1.0], vec![1.0], "2 distances but 1"),
        (vec![0.1, 1.0], vec![1.0, 1.0], "row 0"),
        (vec![0.0, 0.5, 0.5, 1.0], vec![1.0; 4], "row 2"),
        (vec![0.0, f64::NAN, 1.0], vec![1.0; 3], "row 1"),
        (vec![0.0, 0.5, 1.5], vec![1.0; 3], "row 2"),
        (vec![0.0, 0.5], vec![1.0; 2], "row 1"),
        (vec![0.0, 1.0], vec![1.0, -1.0], "row 1"),
        (vec![0.0, 1.0], vec![f64::INFINITY, 1.0], "row 0"),
        (vec![0.0, 1.0], vec![0.0, 0.0], "integrates to 0"),
    ] {
        let message = Kernel::table(q, density).unwrap_err();
        assert!(message.contains(says) && message.contains("allowed"), "{message}");
    }
}

#[test]
fn a_table_sampled_from_poly_approaches_it_with_second_order() {
    let error = |rows: usize| {
        let q: Vec<f64> = (0..=rows).map(|i| i as f64 / rows as f64).collect();
        let density = q.iter().map(|&q| Kernel::Poly.density(q)).collect();
        let table = Kernel::table(q, density).unwrap();
        (0..=997)
            .map(|i| f64::from(i) / 997.0)
            .map(|u| (table.chord(u) - Kernel::Poly.chord(u)).abs())
            .fold(0.0, f64::max)
    };
    let errors = [8, 16, 32, 64, 128].map(error);
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((3.7..4.3).contains(&ratio), "{errors:?}");
    }
    assert!(errors[4] < 1e-4);
}

// ---- The footprint table of Johnson & McAllister (2005), eq. 4

/// Entries of the n x n table over [-3, 3]^2, row-major: the Gaussian integrated over w in [-3, 3] by the composite
/// trapezoid rule with `intervals` equal intervals.
fn footprint_table(n: usize, intervals: usize) -> Vec<f64> {
    let at = |i: usize, n: usize| -3.0 + 6.0 * i as f64 / n as f64;
    let width = 6.0 / intervals as f64;
    let ends = |j: usize| if j == 0 || j == intervals { 0.5 } else { 1.0 };
    let depth = |x: f64, y: f64| {
        let r2 = x * x + y * y;
        let value = |j: usize| ends(j) * (-0.5 * (r2 + at(j, intervals).powi(2))).exp();
        width * (0..=intervals).map(value).sum::<f64>()
    };
    (0..n * n).map(|k| depth(at(k % n, n - 1), at(k / n, n - 1))).collect()
}

/// exp(-(x^2 + y^2)/2) sqrt(2 pi) erf(3/sqrt 2) at the entries' centres.
fn exact_table(n: usize) -> Vec<f64> {
    let at = |i: usize| -3.0 + 6.0 * i as f64 / (n - 1) as f64;
    let depth = (2.0 * PI).sqrt() * libm::erf(3.0 / 2f64.sqrt());
    (0..n * n).map(|k| depth * (-0.5 * (at(k % n).powi(2) + at(k / n).powi(2))).exp()).collect()
}

#[test]
fn the_rule_of_100_intervals_is_2e_5_too_low_at_the_centre() {
    for n in [2, 9, 64, 65] {
        let (table, exact) = (footprint_table(n, 100), exact_table(n));
        for (entry, truth) in table.iter().zip(&exact) {
            // The integrand separates, so that the relative error is the same everywhere. Euler-Maclaurin: the error at
            // the centre is -(h^2/12) 6 exp(-4.5) = -2.0e-5 of 2.4999.
            assert!((entry / truth - 1.0 + 7.998e-6).abs() < 1e-8, "{}", entry / truth - 1.0);
        }
        if n % 2 == 1 {
            let centre = table[n * n / 2] - exact[n * n / 2];
            assert!((centre + 2.0e-5).abs() < 2e-8, "{centre}");
        }
    }
    // Twice the intervals, a quarter of the error: the table converges to the closed form.
    let off = |intervals| footprint_table(9, intervals)[40] / exact_table(9)[40] - 1.0;
    assert!((off(100) / off(200) - 4.0).abs() < 0.01);
}

#[test]
fn normalising_makes_even_tables_too_high_and_odd_ones_exact_at_the_centre() {
    let normalised = |n: usize| {
        let table = footprint_table(n, 100);
        let largest = table.iter().copied().fold(0.0, f64::max);
        table.into_iter().map(|v| v / largest).collect::<Vec<_>>()
    };
    // What an entry should be is the billboard's footprint.
    let ratio = |n: usize| {
        let at = |i: usize| -1.0 + 2.0 * i as f64 / (n - 1) as f64;
        let inner = (n / 2) * n + n / 2;
        normalised(n)[inner] / Kernel::Gaussian.billboard(at(n / 2), at(n / 2))
    };
    assert!((ratio(64) - 1.0 - 0.00227).abs() < 1e-5, "{}", ratio(64));
    for n in [3, 63, 65] {
        assert!((ratio(n) - 1.0).abs() < 1e-15);
        assert_eq!(normalised(n)[n * n / 2], 1.0);
    }
    // Away from the centre the odd table is exact too, the rule's error having cancelled.
    let table = normalised(65);
    let expected = Kernel::Gaussian.billboard(10.0 / 32.0, -20.0 / 32.0);
    assert!((table[12 * 65 + 42] - expected).abs() < 1e-15);
}

// ---- Stereo

fn random_camera(random: &mut Random) -> Camera {
    let position = DVec3::from_array(random.point([-5.0; 3], [5.0; 3]));
    Camera {
        position,
        look_at: position + DVec3::from_array(random.point([-1.0, -1.0, 0.3], [1.0, 1.0, 2.0])),
        up: DVec3::from_array(random.point([-0.2, 0.8, -0.2], [0.2, 1.0, 0.2])),
        fov_y: random.uniform(0.3, 2.0),
        size: [random.uniform(1.0, 2000.0) as u32, random.uniform(1.0, 2000.0) as u32],
        near: 0.01,
        samples: 1,
    }
}

fn random_rig(random: &mut Random, mode: StereoMode) -> Stereo {
    Stereo { interocular: random.uniform(0.01, 0.5), convergence: Some(random.uniform(1.0, 10.0)), mode }
}

/// A world-space point before the camera.
fn random_point(random: &mut Random, camera: &Camera) -> DVec3 {
    let depth = random.uniform(0.5, 20.0);
    let lateral = camera.fov_y.tan().abs().min(1.0) * depth;
    let point = DVec3::new(random.uniform(-lateral, lateral), random.uniform(-lateral, lateral), -depth);
    camera.position + camera.camera_from_world().transpose() * point
}

/// Where a world-space point appears in the zero-parallax plane at depth D, measured from the centre of the window that
/// the two frusta share there.
fn in_window(view: &View, point: DVec3, plane: f64) -> DVec2 {
    let [width, height] = view.size.map(f64::from);
    let picture = view.project(view.eye_from_point(point));
    DVec2::new(2.0 * picture.x / width - 1.0, 1.0 - 2.0 * picture.y / height) * view.half_extent * plane
}

#[test]
fn parallax_is_the_interocular_times_one_minus_convergence_over_depth() {
    let mut random = Random::new(5);
    for _ in 0..500 {
        let camera = random_camera(&mut random);
        let rig = random_rig(&mut random, StereoMode::Parallel);
        let plane = rig.convergence.unwrap();
        let views = stereo::views(&camera, Some(&rig));
        assert!(share_depth(&views));
        for _ in 0..20 {
            let point = random_point(&mut random, &camera);
            let depth = -(camera.camera_from_world() * (point - camera.position)).z;
            let [left, right] = [&views[0], &views[1]].map(|view| in_window(view, point, plane));
            let law = rig.interocular * (1.0 - plane / depth);
            assert!(((right.x - left.x) - law).abs() < 1e-11 * (1.0 + plane), "{} for {law}", right.x - left.x);
            assert!((rig.parallax(depth).unwrap() - law).abs() < 1e-15 * (1.0 + law.abs()));
            // Vertical parallax is zero, and the near is crossed: behind the screen means to the right for the right eye.
            assert!((right.y - left.y).abs() < 1e-11 * (1.0 + plane));
            assert_eq!(right.x > left.x, depth > plane);
            // Swapped eyes break the law wherever there is any parallax.
            assert!(((left.x - right.x) - law).abs() > law.abs());
        }
    }
}

#[test]
fn parallel_frusta_without_convergence_put_the_plane_at_infinity() {
    let mut random = Random::new(6);
    for _ in 0..200 {
        let camera = random_camera(&mut random);
        let rig = Stereo { convergence: None, ..random_rig(&mut random, StereoMode::Parallel) };
        let views = stereo::views(&camera, Some(&rig));
        let point = random_point(&mut random, &camera);
        let depth = -(camera.camera_from_world() * (point - camera.position)).z;
        let [left, right] = [&views[0], &views[1]].map(|view| in_window(view, point, 1.0));
        assert!((right.x - left.x + rig.interocular / depth).abs() < 1e-11);
        assert_eq!(rig.parallax(depth), None);
        assert!((right.y - left.y).abs() < 1e-11);
        // Both eyes look along the camera's own axis.
        for view in &views {
            assert_eq!((view.shear, view.eye_from_world), (0.0, camera.camera_from_world()));
        }
    }
}

#[test]
fn rays_are_those_of_the_contract() {
    let mut random = Random::new(7);
    for _ in 0..200 {
        let camera = random_camera(&mut random);
        let rig = random_rig(&mut random, StereoMode::Parallel);
        let plane = rig.convergence.unwrap();
        let views = stereo::views(&camera, Some(&rig));
        let [width, height] = camera.size.map(f64::from);
        let tangent = (0.5 * camera.fov_y).tan();
        for (view, e) in views.iter().zip([-0.5 * rig.interocular, 0.5 * rig.interocular]) {
            let (x, y) = (random.uniform(0.0, width), random.uniform(0.0, height));
            let (x_ndc, y_ndc) = (2.0 * x / width - 1.0, 1.0 - 2.0 * y / height);
            let expected = DVec3::new(x_ndc * tangent * width / height - e / plane, y_ndc * tangent, -1.0);
            assert!((view.direction(x, y) - expected).length() < 1e-12 * (1.0 + expected.length()));
            // The left eye stands at -I/2 along camera x.
            let offset = camera.camera_from_world() * (view.position - camera.position);
            assert!((offset - DVec3::new(e, 0.0, 0.0)).length() < 1e-12);
        }
        // Picture rows go down: the top row looks up.
        assert!(views[0].direction(0.0, 0.0).y > 0.0 && views[0].direction(0.0, height).y < 0.0);
    }
}

#[test]
fn projecting_and_shooting_rays_are_inverse() {
    let mut random = Random::new(8);
    for mode in [StereoMode::Parallel, StereoMode::ToeIn] {
        for _ in 0..200 {
            let camera = random_camera(&mut random);
            let rig = random_rig(&mut random, mode);
            for view in stereo::views(&camera, Some(&rig)) {
                let [width, height] = view.size.map(f64::from);
                let (x, y) = (random.uniform(0.0, width), random.uniform(0.0, height));
                let back = view.project(view.direction(x, y) * random.uniform(0.1, 50.0));
                assert!((back - DVec2::new(x, y)).length() < 1e-10 * (width + height));
                let point = DVec3::new(random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), -random.uniform(0.5, 9.0));
                let picture = view.project(point);
                let again = view.direction(picture.x, picture.y) * -point.z;
                assert!((again - point).length() < 1e-10, "{again} for {point}");
                assert_eq!(picture, view.picture_from_tangent(point.truncate() / -point.z));
            }
        }
    }
}

#[test]
fn toe_in_meets_at_the_convergence_point_and_shows_vertical_parallax() {
    let mut random = Random::new(9);
    for _ in 0..200 {
        let camera = random_camera(&mut random);
        let rig = random_rig(&mut random, StereoMode::ToeIn);
        let plane = rig.convergence.unwrap();
        let parallel = Stereo { mode: StereoMode::Parallel, ..rig.clone() };
        let to_world = camera.camera_from_world().transpose();
        let world = |x: f64, y: f64, depth: f64| camera.position + to_world * DVec3::new(x, y, -depth);
        let [toed, straight] = [&rig, &parallel].map(|rig| stereo::views(&camera, Some(rig)));
        let middle = DVec2::new(f64::from(camera.size[0]), f64::from(camera.size[1])) * 0.5;
        for view in toed.iter().chain(&straight) {
            let seen = view.project(view.eye_from_point(world(0.0, 0.0, plane)));
            assert!((seen - middle).length() < 1e-9 * middle.length(), "{seen} for {middle}");
        }
        assert!(!share_depth(&toed));
        assert_eq!(stereo::views(&camera, Some(&rig)).len(), stereo::eyes(Some(&rig)).len());
        // A point up and to the right, in the plane: nearer to the right eye along its turned axis, hence higher there.
        let corner = world(0.5 * plane, 0.5 * plane, plane);
        let heights = [&toed, &straight].map(|views| {
            let [left, right] = [&views[0], &views[1]].map(|view| in_window(view, corner, plane));
            right.y - left.y
        });
        assert!(heights[0].abs() > 0.1 * 0.5 * rig.interocular, "{heights:?}");
        assert!(heights[1].abs() < 1e-11 * plane, "{heights:?}");
    }
}

#[test]
fn one_eye_sees_from_the_camera_itself() {
    let mut random = Random::new(10);
    let camera = Camera { samples: 3, size: [20, 10], ..random_camera(&mut random) };
    let views = stereo::views(&camera, None);
    assert_eq!((views.len(), views[0].size, views[0].shear), (1, [60, 30], 0.0));
    assert_eq!((views[0].position, views[0].light), (camera.position, camera.position));
    let forward = camera.camera_from_world().transpose() * views[0].direction(30.0, 15.0);
    assert!((forward - (camera.look_at - camera.position).normalize()).length() < 1e-12);
}

#[test]
fn no_ray_sees_more_of_a_particle_than_the_bound() {
    let mut kernels = awkward_tables();
    kernels.extend([Kernel::Gaussian, Kernel::Beliaev, Kernel::Linear, Kernel::Constant, Kernel::Poly]);
    // Hollow, falling, with a step, and with a second rise far out.
    let tables = [
        (vec![0.0, 0.3, 0.6, 0.9, 1.0], vec![0.2, 1.0, 0.5, 0.1, 0.0]),
        (vec![0.0, 0.5, 1.0], vec![1.0, 0.5, 0.5]),
        (vec![0.0, 0.5, 0.5001, 1.0], vec![0.1, 0.1, 2.0, 0.0]),
        (vec![0.0, 0.2, 0.7, 0.8, 1.0], vec![1.0, 0.1, 0.1, 0.6, 0.0]),
    ];
    kernels.extend(tables.map(|(q, density)| Kernel::table(q, density).unwrap()));
    for kernel in &kernels {
        let (bound, centre) = (kernel.excess(), kernel.chord(0.0));
        assert!(bound >= 1.0);
        let mut most = 0.0f64;
        for i in 0..1000 {
            let u = f64::from(i) / 1000.0;
            most = most.max(kernel.chord(u) / centre);
            // A shorter chord holds no more than its share.
            let half = (1.0 - u * u).sqrt();
            assert!(kernel.chord(u) / centre <= half * bound * (1.0 + 1e-12), "{kernel:?} at {u}");
        }
        // Near enough to be of use, and exactly 1 where densities fall.
        assert!(most <= bound * (1.0 + 1e-12) && bound <= 4.0 * most, "{kernel:?}: {bound} for {most}");
    }
    assert_eq!(Kernel::Gaussian.excess(), 1.0);
    assert!((kernels[kernels.len() - 3].excess() - 1.0).abs() < 1e-12);
    // 2 (0.3 + 0.225 + 0.09 + 0.005) over 2 (0.18 + 0.225 + 0.09 + 0.005).
    assert!((kernels[kernels.len() - 4].excess() - 1.24).abs() < 1e-12);
}
