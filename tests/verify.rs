//! Verification against errors planted at known places, and the sample of pixels that it measures.

use crate::harness::{Gas, Random, set};
use glam::DVec3;
use std::collections::BTreeSet;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use stereomist::picture::{Film, Plane};
use stereomist::render::method::slab;
use stereomist::render::{DEFAULT_TOLERANCE, Method, Progress, Session, Settings, draw, reference};
use stereomist::scene::mesh::Material;
use stereomist::scene::{Attribute, Camera, Kernel, Mesh, Scene, Stereo, StereoMode};
use stereomist::study::verify::{Deviation, Places, Sample, Verification, places, verify};

const REFERENCE: Method = Method::Reference(reference::Parameters::DEFAULT);
const SLAB: Method = Method::Slab(slab::Parameters::DEFAULT);

const SIZE: [u32; 2] = [41, 30];
const WIDTH: usize = SIZE[0] as usize;
const PIXELS: usize = WIDTH * SIZE[1] as usize;

/// Gas of many colours around a triangle, in stereo.
fn scene(samples: u32) -> Scene {
    let gas = Gas {
        count: 50,
        low: [-1.5, -1.0, -5.0],
        high: [1.5, 1.0, -1.0],
        radius: [0.2, 0.9],
        opacity: [0.1, 0.8],
        bright: 1.0,
    };
    let corner = |x: f64, y: f64| DVec3::new(x, y, -3.0 + 0.5 * x);
    Scene {
        camera: Camera {
            position: DVec3::ZERO,
            look_at: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y: 50f64.to_radians(),
            size: SIZE,
            near: 0.3,
            samples,
        },
        stereo: Some(Stereo { interocular: 0.2, convergence: Some(3.0), mode: StereoMode::Parallel }),
        background: [0.25, 0.5, 0.75],
        particles: vec![gas.draw(&mut Random::new(54), Kernel::Gaussian)],
        meshes: vec![Mesh {
            positions: vec![corner(-1.0, -1.0), corner(1.0, -0.8), corner(0.2, 1.0)],
            corners: vec![[0, 1, 2]],
            triangle_materials: vec![0],
            materials: vec![Material { color: [0.9, 0.4, 0.2], texture: None, unlit: false }],
            ..Mesh::default()
        }],
    }
}

fn films(scene: &Scene, method: Method) -> Vec<Film> {
    draw(scene, &Settings { method, ..Settings::default() }, &()).unwrap().films
}

fn some(count: u64) -> Sample {
    Sample::Pixels(NonZeroU64::new(count).unwrap())
}

fn measure(scene: &Scene, films: &[Film], sample: Sample) -> Verification {
    verify(scene, &scene.views(), films, sample, DEFAULT_TOLERANCE, &()).unwrap()
}

/// No more than f32 makes of the truth.
const ROUNDING: f64 = 2e-7;

// ---- What is measured

#[test]
fn a_single_wrong_pixel_is_found_at_its_place() {
    let scene = scene(1);
    let right = films(&scene, REFERENCE);
    let found = measure(&scene, &right, Sample::All);
    assert!(found.held() && found.all && found.pixels == PIXELS as u64, "{found:?}");
    assert!(found.largest.error < ROUNDING && found.transmittance.error < ROUNDING, "{found:?}");
    assert!(found.reference_bound > 0.0 && found.reference_bound < 1e-9, "{found:?}");
    assert_eq!((found.tolerance, found.predicted_error), (DEFAULT_TOLERANCE, None));
    for (view, channel, column, row, sign) in
        [(0, 0, 0, 0, 1.0), (1, 1, 40, 29, -1.0), (1, 2, 17, 3, 1.0), (0, 1, 20, 15, -1.0)]
    {
        let mut wrong = right.clone();
        let value = &mut wrong[view].color[channel][row * WIDTH + column];
        *value += sign * 2.0 * DEFAULT_TOLERANCE as f32;
        let drawn = f64::from(*value);
        let found = measure(&scene, &wrong, Sample::All);
        let Deviation { error, truth, .. } = found.largest;
        assert!(!found.held() && (error - 2.0 * DEFAULT_TOLERANCE).abs() < ROUNDING, "{found:?}");
        let place = Deviation { error, view, pixel: [column as u32, row as u32], channel, drawn, truth };
        assert!(found.largest == place && ((truth - drawn).abs() - error).abs() < 1e-12, "{found:?}");
        // A sample looks there too: nothing else of the picture is as steep, unless it is an edge.
        assert_eq!(measure(&scene, &wrong, some(PIXELS as u64 - 1)).largest, place);
    }
    // Just within the tolerance is within it.
    let mut near = right.clone();
    near[1].color[0][99] += 0.99 * DEFAULT_TOLERANCE as f32;
    let found = measure(&scene, &near, Sample::All);
    assert!(found.held() && found.largest.error > 0.98 * DEFAULT_TOLERANCE, "{found:?}");
}

#[test]
fn transmittance_is_measured_and_counts_for_nothing() {
    let scene = scene(1);
    let mut wrong = films(&scene, REFERENCE);
    wrong[1].transmittance[5 * WIDTH + 7] += 0.3;
    let found = measure(&scene, &wrong, Sample::All);
    assert!(found.held() && found.largest.error < ROUNDING && found.rmse < ROUNDING, "{found:?}");
    let Deviation { error, view, pixel, channel, .. } = found.transmittance;
    assert!((error - 0.3).abs() < ROUNDING && (view, pixel, channel) == (1, [7, 5], 3), "{found:?}");
}

#[test]
fn what_is_no_number_is_never_within_the_tolerance() {
    let scene = scene(1);
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut wrong = films(&scene, REFERENCE);
        wrong[0].color[2][4 * WIDTH + 30] = value;
        for sample in [Sample::All, some(16)] {
            let found = verify(&scene, &scene.views(), &wrong, sample, f64::MAX, &()).unwrap();
            assert!(!found.held() && found.largest.error == f64::INFINITY, "{value}: {found:?}");
            assert_eq!((found.largest.pixel, found.largest.channel), ([30, 4], 2));
        }
        wrong[0].color[2] = films(&scene, REFERENCE)[0].color[2].clone();
        wrong[0].transmittance[9] = value;
        let found = measure(&scene, &wrong, Sample::All);
        assert!(found.held() && found.transmittance.error == f64::INFINITY, "{value}: {found:?}");
    }
}

#[test]
fn gas_that_mixes_is_beyond_perspective_and_not_beyond_slab() {
    // Red and green in one place: what stands one behind the other shows but the nearer of the two.
    let mut scene = scene(1);
    scene.meshes.clear();
    let ball = |z: f64, color: [f32; 3]| {
        let ball = set(Kernel::Gaussian, &[[0.0, 0.0, z]], 0.8, 0.9);
        stereomist::scene::ParticleSet { color: Attribute::Uniform(color), ..ball }
    };
    scene.particles = vec![ball(-3.0, [1.0, 0.0, 0.0]), ball(-3.001, [0.0, 1.0, 0.0])];
    for sample in [Sample::All, some(64)] {
        let found = measure(&scene, &films(&scene, Method::Perspective), sample);
        assert!(!found.held() && found.largest.error > 0.2, "{found:?}");
        assert!(found.rmse > 0.02 && found.quantile_99 > 0.1 && found.quantile_99 <= found.largest.error, "{found:?}");
    }
    // Of one colour slabs are exact.
    scene.particles = vec![ball(-3.0, [0.3, 0.6, 0.2]), ball(-3.001, [0.3, 0.6, 0.2]), ball(-2.5, [0.3, 0.6, 0.2])];
    let found = measure(&scene, &films(&scene, SLAB), Sample::All);
    assert!(found.held() && found.largest.error < 2e-6 && found.transmittance.error < 2e-6, "{found:?}");
}

#[test]
fn with_supersampling_the_truth_is_the_mean_of_all_samples() {
    let (coarse, fine) = (scene(1), scene(3));
    let found = measure(&fine, &films(&fine, REFERENCE), Sample::All);
    assert!(found.held() && found.largest.error < 2.0 * ROUNDING && found.transmittance.error < ROUNDING, "{found:?}");
    assert!(found.pixels == PIXELS as u64 && found.reference_bound < 1e-9, "{found:?}");
    // One sample at the centre is not that, least of all at the triangle's edge.
    let found = measure(&fine, &films(&coarse, REFERENCE), Sample::All);
    assert!(!found.held() && found.largest.error > 0.1, "{found:?}");
}

#[test]
fn the_figures_are_those_of_the_planted_errors() {
    let scene = scene(1);
    let right = films(&scene, REFERENCE);
    // At every 50th pixel of both views 0.1, at every other one 0.001, in one channel.
    let mut wrong = right.clone();
    for film in &mut wrong {
        film.color[1].iter_mut().enumerate().for_each(|(i, value)| *value += if i % 50 == 0 { 0.1 } else { 0.001 });
    }
    let found = measure(&scene, &wrong, Sample::All);
    let large = PIXELS.div_ceil(50) as f64 / PIXELS as f64;
    let rmse = ((large * 1e-2 + (1.0 - large) * 1e-6) / 3.0).sqrt();
    assert!((found.rmse - rmse).abs() < ROUNDING && (found.quantile_99 - 0.1).abs() < ROUNDING, "{found:?}");
    // At fewer than one in a hundred the quantile does not see them.
    let mut wrong = right.clone();
    for film in &mut wrong {
        film.color[1].iter_mut().step_by(101).for_each(|value| *value += 0.1);
    }
    // 13 of 1230 pixels are more than one in a hundred; in one view alone they are not.
    assert!((measure(&scene, &wrong, Sample::All).quantile_99 - 0.1).abs() < ROUNDING);
    wrong[0] = right[0].clone();
    let found = measure(&scene, &wrong, Sample::All);
    assert!(found.quantile_99 < ROUNDING && found.largest.error > 0.09, "{found:?}");
}

/// The mean is that of the pictures, the largest that of the sample: a wrong pixel that was looked for is no estimate.
#[test]
fn the_mean_is_over_evenly_spread_pixels_alone() {
    let scene = scene(1);
    let mut wrong = films(&scene, REFERENCE);
    let sample = some(100);
    let Places { drawn, .. } = places(&wrong, sample);
    wrong[0].color[0][drawn[drawn.len() / 2]] += 0.01;
    // The error may not move the places.
    assert_eq!(places(&wrong, sample).drawn, drawn);
    let found = measure(&scene, &wrong, sample);
    assert!((found.largest.error - 0.01).abs() < ROUNDING && found.pixels == 100 && !found.all, "{found:?}");
    assert!(found.rmse < ROUNDING && found.quantile_99 < ROUNDING, "{found:?}");
}

#[test]
fn it_is_the_same_on_any_number_of_threads_and_tells_how_far_it_is() {
    struct Last(AtomicU64);
    impl Progress for Last {
        fn update(&self, done: u64, total: u64) {
            assert!(done <= total && total == 2 * 500);
            self.0.fetch_max(done, Ordering::Relaxed);
        }
    }
    let scene = scene(2);
    let films = films(&scene, Method::Perspective);
    let on = |threads: usize| {
        let session = Session::new(&Settings { threads: Some(threads), ..Settings::default() }).unwrap();
        let last = Last(AtomicU64::new(0));
        let views = scene.views();
        let found = session.install(|| verify(&scene, &views, &films, some(500), 0.1, &last)).unwrap();
        assert_eq!(last.0.into_inner(), 1000);
        assert!(found.time > Duration::ZERO);
        Verification { time: Duration::ZERO, ..found }
    };
    let one = on(1);
    assert!(one.largest.error > 1e-3 && one.tolerance == 0.1);
    assert!(on(2) == one && on(3) == one);
}

#[test]
fn films_of_another_scene_are_refused() {
    let scene = scene(1);
    let films = films(&scene, Method::Perspective);
    let views = scene.views();
    let refused = |scene: &Scene, films: &[Film], word: &str| {
        let error = verify(scene, &views, films, Sample::All, 0.1, &()).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains(word), "{error}");
    };
    refused(&scene, &films[..1], "1 films");
    refused(&scene, &[films[0].clone(), Film::new([30, 41])], "30 x 41");
    let mut short = films.clone();
    short[1].color[2] = Plane::new(41 * 30 - 1);
    refused(&scene, &short, "41 x 30");
    let mut fine = scene.clone();
    fine.camera.samples = 2;
    refused(&fine, &films, "views");
}

// ---- Where

/// Two black films without surfaces.
fn black([width, height]: [u32; 2]) -> [Film; 2] {
    [Film::new([width, height]), Film::new([width, height])]
}

fn all(places: &Places) -> BTreeSet<usize> {
    places.even.iter().chain(&places.drawn).copied().collect()
}

#[test]
fn as_many_pixels_as_asked_for_none_twice() {
    for size in [[41, 30], [1, 1], [1, 50], [50, 1], [2, 300], [7, 5], [64, 64]] {
        let pixels = u64::from(size[0] * size[1]);
        for count in [1, 2, 3, 5, 17, 34, 35, 100, 599, 1229, 4095, 4096, u64::MAX] {
            let places = places(&black(size), some(count));
            let found = all(&places);
            assert_eq!(found.len(), places.even.len() + places.drawn.len(), "{size:?} {count}");
            assert_eq!(found.len() as u64, count.min(pixels), "{size:?} {count}");
            assert!(found.iter().all(|&i| (i as u64) < pixels) && places.even.is_sorted() && places.drawn.is_sorted());
            assert_eq!(places.drawn.is_empty(), count == 1 || count >= pixels, "{size:?} {count}");
        }
        assert_eq!(places(&black(size), Sample::All).even.len() as u64, pixels);
    }
}

#[test]
fn half_is_spread_evenly_at_random_places_of_cells() {
    // 800 cells of 3 x 3 pixels.
    let [width, height] = [96, 75];
    let places = places(&black([width, height]), some(1600));
    assert_eq!((places.even.len(), places.drawn.len()), (800, 800));
    let width = width as usize;
    let cells: BTreeSet<usize> = places.even.iter().map(|i| i / width / 3 * 32 + i % width / 3).collect();
    assert_eq!(cells.len(), 800);
    let mut within = [0; 9];
    places.even.iter().for_each(|i| within[i / width % 3 * 3 + i % width % 3] += 1);
    assert!(within.iter().all(|&count| count > 60 && count < 120), "{within:?}");
    // Where nothing draws it the other half favours no part of the picture.
    let mut quarters = [0; 4];
    places.drawn.iter().for_each(|i| quarters[i / width / 38 * 2 + i % width / 48] += 1);
    assert!(quarters.iter().all(|&count| count > 150 && count < 250), "{quarters:?}");
}

#[test]
fn the_steepest_pixels_of_either_eye_are_measured() {
    let mut random = Random::new(6);
    for channel in 0..4 {
        for view in 0..2 {
            let mut films = black([96, 75]);
            // A gentle slope everywhere, and few pixels that stick out.
            for film in &mut films {
                film.color[0].iter_mut().enumerate().for_each(|(i, value)| *value = 1e-3 * (i % 96) as f32);
            }
            let steep: BTreeSet<usize> = (0..12).map(|_| random.uniform(0.0, 7200.0) as usize).collect();
            let plane = match channel {
                3 => &mut films[view].transmittance,
                _ => &mut films[view].color[channel],
            };
            steep.iter().for_each(|&i| plane[i] += 0.1);
            let found = places(&films, some(100));
            assert!(steep.is_subset(&all(&found)), "channel {channel}, view {view}");
            assert_eq!(found.even, places(&black([96, 75]), some(100)).even);
        }
    }
}

#[test]
fn every_part_of_the_picture_has_its_steepest_pixel_measured() {
    // The left half is far steeper than the right one, where one pixel in each 12 x 15 sticks out a little.
    let [width, height] = [96usize, 75];
    let mut films = black([96, 75]);
    let mut random = Random::new(7);
    for i in 0..width * height {
        films[1].color[1][i] = if i % width < 48 { random.uniform(0.0, 1.0) as f32 } else { 0.5 };
    }
    let small: Vec<usize> = (0..20)
        .map(|k| (k / 4 * 15 + 7) * width + 48 + k % 4 * 12 + 6)
        .inspect(|&i| films[1].color[1][i] += 1e-3)
        .collect();
    let found = all(&places(&films, some(800)));
    let seen = small.iter().filter(|i| found.contains(i)).count();
    assert_eq!(seen, small.len());
    let left = places(&films, some(800)).drawn.iter().filter(|&&i| i % width < 48).count();
    assert!(left > 250, "{left}");
}

#[test]
fn edges_of_opaque_surfaces_are_measured() {
    let [width, height] = [96usize, 75];
    // A slanted floor, of which 1/depth is linear, with a ball's silhouette in one eye. Colours say nothing.
    let floor = |i: usize| 1.0 / (0.05 + 0.002 * (i / width) as f32 + 0.0003 * (i % width) as f32);
    let mut films = black([96, 75]);
    films[1].depth = Some((0..width * height).map(floor).collect());
    let plain = places(&films, some(600));
    assert_eq!(plain, places(&black([96, 75]), some(600)), "a plane has no edge");
    let inside = |i: usize| (i % width).abs_diff(60).pow(2) + (i / width).abs_diff(40).pow(2) < 400;
    let other = if let Some(depth) = &mut films[1].depth {
        depth.iter_mut().enumerate().filter(|(i, _)| inside(*i)).for_each(|(_, depth)| *depth = 1.0);
        // Elsewhere the floor ends and the ray goes on for ever.
        depth.iter_mut().enumerate().filter(|(i, _)| i % width < 10).for_each(|(_, depth)| *depth = f32::INFINITY);
        places(&films, some(600))
    } else {
        plain
    };
    let near_edge = |i: usize| {
        let differs = |other: usize| inside(i) != inside(other);
        differs(i - 1) || differs(i + 1) || differs(i - width) || differs(i + width) || [9, 10].contains(&(i % width))
    };
    let inner = |i: usize| (1..95).contains(&(i % width)) && (1..74).contains(&(i / width));
    let edge: Vec<usize> = (0..width * height).filter(|&i| inner(i) && near_edge(i)).collect();
    let measured = all(&other);
    let seen = edge.iter().filter(|i| measured.contains(i)).count();
    // Half of what is drawn, and all round the ball.
    assert!(seen > 140 && edge.len() < 400, "{seen} of {}", edge.len());
    let mut sides = [0; 4];
    for i in edge.iter().filter(|i| measured.contains(i) && *i % width > 10) {
        sides[usize::from(i % width > 60) + 2 * usize::from(i / width > 40)] += 1;
    }
    assert!(sides.iter().all(|&count| count > 10), "{sides:?}");
}
