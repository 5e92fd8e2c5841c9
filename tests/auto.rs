//! Method `auto` against the reference: the tolerance is kept, and work is saved where it can be.

use crate::harness::{Gas, Random, difference, kernels, set};
use crate::methods::bits;
use glam::DVec3;
use stereomist::picture::{Film, Rgba8};
use stereomist::render::cpu::simd::Level;
use stereomist::render::method::{sheet, slab};
use stereomist::render::reference::{Parameters, Reference};
use stereomist::render::{Method, OpacityModel, Pixels, Rendering, Session, Settings, draw};
use stereomist::scene::mesh::Material;
use stereomist::scene::{Attribute, Camera, Kernel, Mesh, ParticleSet, Scene, Stereo, StereoMode};

const TOLERANCES: [f64; 3] = [1.0 / 255.0, 1.0 / 1023.0, 0.02];

fn scene(particles: Vec<ParticleSet>, distance: f64, size: [u32; 2]) -> Scene {
    Scene {
        camera: Camera {
            position: DVec3::new(0.0, 0.0, distance),
            look_at: DVec3::new(0.1, -0.05, distance - 10.0),
            up: DVec3::Y,
            fov_y: 55f64.to_radians(),
            size,
            near: 0.1,
            samples: 1,
        },
        stereo: Some(Stereo { interocular: 0.065, convergence: Some(3.0), mode: StereoMode::Parallel }),
        background: [0.1, 0.5, 0.9],
        particles,
        meshes: Vec::new(),
    }
}

/// A wall across the left half of what the camera sees, at a place along z.
fn wall(z: f64) -> Mesh {
    let corners = [[-3.0, -3.0], [-0.1, -3.0], [-0.1, 3.0], [-3.0, 3.0]];
    Mesh {
        name: "wall".to_owned(),
        positions: corners.iter().map(|c| DVec3::new(c[0], c[1], z)).collect(),
        corners: vec![[0, 1, 2], [0, 2, 3]],
        triangle_materials: vec![0, 0],
        materials: vec![Material { color: [0.8, 0.3, 0.2], texture: None, unlit: true }],
        ..Mesh::default()
    }
}

/// One to four sets of any kernel, thin to opaque, of one colour or of several.
fn random_scene(number: u64) -> Scene {
    let mut random = Random::new(900 + number);
    let one = number.is_multiple_of(3);
    let sets = 1 + number as usize % 4;
    let kernels = kernels();
    let particles = (0..sets)
        .map(|i| {
            let count = random.uniform(0.0, 5.5).exp() as usize + 1;
            let radius = random.uniform(-2.6, 0.1).exp();
            let opacity = random.uniform(0.01, 0.7);
            let gas = Gas {
                count,
                low: [-1.5; 3],
                high: [1.5; 3],
                radius: [radius, 1.3 * radius],
                opacity: [0.5 * opacity, opacity],
                bright: 1.0,
            };
            let kernel = kernels[(number as usize + 2 * i) % kernels.len()].clone();
            let color = if one { [0.3, 0.6, 0.2] } else { random.color(1.0) };
            ParticleSet { color: Attribute::Uniform(color), ..gas.draw(&mut random, kernel) }
        })
        .collect();
    let mut scene = scene(particles, if number % 4 == 1 { 0.2 } else { 4.0 }, [48, 36]);
    if number % 5 == 2 {
        scene.meshes.push(wall(0.3));
    }
    scene
}

fn with(method: Method, tolerance: f64) -> Settings {
    Settings { method, tolerance, ..Settings::default() }
}

fn rendering(scene: &Scene, settings: &Settings) -> Rendering {
    draw(scene, settings, &()).unwrap()
}

#[test]
fn the_tolerance_is_kept_at_every_pixel() {
    let mut worst: Vec<(u64, f64, f64)> = Vec::new();
    for number in 0..12 {
        let scene = random_scene(number);
        let truth = rendering(&scene, &with(Method::Reference(Parameters::DEFAULT), 0.0));
        for tolerance in TOLERANCES {
            let drawn = rendering(&scene, &with(Method::Auto, tolerance));
            let off = drawn.films.iter().zip(&truth.films).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
            worst.push((number, tolerance, off));
            // What nodes may lose is what the slabs and all else leave of the tolerance.
            let predicted = drawn.statistics.predicted_error.unwrap();
            assert!(predicted <= tolerance, "scene {number}: {predicted:e} predicted for {tolerance:e}");
        }
    }
    for (number, tolerance, off) in &worst {
        println!("scene {number}: {off:.2e} of {tolerance:.2e}");
    }
    for (number, tolerance, off) in worst {
        assert!(off <= tolerance, "scene {number}: {off:e} is more than {tolerance:e}");
    }
}

/// Large soft particles, some far beyond the picture, of as many colours as are given.
fn large(colors: &[[f32; 3]]) -> Scene {
    let mut random = Random::new(77);
    let particles = colors
        .iter()
        .map(|&color| {
            let gas = Gas {
                count: 60,
                low: [-2.0, -1.5, -1.5],
                high: [2.0, 1.5, 1.5],
                radius: [0.8, 1.2],
                opacity: [0.02, 0.2],
                bright: 1.0,
            };
            ParticleSet { color: Attribute::Uniform(color), ..gas.draw(&mut random, Kernel::Gaussian) }
        })
        .collect();
    scene(particles, 4.5, [403, 301])
}

/// The largest difference from the reference, of a channel or the transmittance, over every `stride`th pixel of both eyes.
fn off(scene: &Scene, drawn: &Rendering, stride: usize) -> f64 {
    let mut most = 0.0f64;
    for (view, film) in scene.views().iter().zip(&drawn.films) {
        let layer = stereomist::render::opaque::draw(scene, view);
        let reference = Reference::new(scene, view, layer.as_ref());
        let width = view.size[0] as usize;
        for pixel in (0..film.transmittance.len()).step_by(stride) {
            let seen = reference.radiance((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            for channel in 0..3 {
                most = most.max((f64::from(film.color[channel][pixel]) - seen.color[channel]).abs());
            }
            most = most.max((f64::from(film.transmittance[pixel]) - seen.transmittance).abs());
        }
    }
    most
}

#[test]
fn smooth_gas_is_drawn_from_few_rays() {
    for colors in [vec![[0.7, 0.6, 0.5]], vec![[0.9, 0.2, 0.1], [0.1, 0.8, 0.2], [0.2, 0.3, 0.9]]] {
        let scene = large(&colors);
        let full = rendering(&scene, &with(Method::Slab(Default::default()), 0.0)).statistics.fragments;
        for tolerance in TOLERANCES {
            let drawn = rendering(&scene, &with(Method::Auto, tolerance));
            let plan = drawn.statistics.plan.join(" ");
            // At the strictest, finer grids are tried until most tiles are content; of one colour billboards may be as cheap.
            assert!(plan.contains("from every") || tolerance < 0.003 && colors.len() == 1, "{plan}");
            let fragments = drawn.statistics.fragments;
            let least = if tolerance > 0.003 { 4 } else { 1 };
            assert!(fragments * least < full, "{fragments} fragments, {full} without savings: {plan}");
            let off = off(&scene, &drawn, 307);
            println!("{} colours, {tolerance:.2e}: {off:.2e}, {fragments} of {full} fragments: {plan}", colors.len());
            assert!(off <= tolerance, "{off:e}: {plan}");
            assert!(off <= drawn.statistics.predicted_error.unwrap(), "{off:e}: {plan}");
        }
    }
}

/// Thin Gaussians of about the least size that nodes 16 pixels apart follow, a standard deviation little more than a node.
#[test]
fn narrow_gaussians_need_no_finer_nodes() {
    let mut random = Random::new(41);
    let focal = 0.5 * 301.0 / (0.5 * 55f64.to_radians()).tan();
    let gas = Gas {
        count: 100,
        low: [-2.2, -1.7, -0.2],
        high: [2.2, 1.7, 0.2],
        // 3.8 nodes at the greatest depth.
        radius: [3.8 * 16.0 * 4.8 / focal; 2],
        opacity: [0.02, 0.02],
        bright: 1.0,
    };
    let set = ParticleSet { color: Attribute::Uniform([0.7, 0.6, 0.5]), ..gas.draw(&mut random, Kernel::Gaussian) };
    let drawn = holds(&scene(vec![set], 4.5, [403, 301]), "narrow");
    let plan = drawn.statistics.plan.join(" ");
    assert!(plan.contains("from every 16th") && !plan.contains("from every 8th"), "{plan}");
}

/// Sixty dense Gaussians about four nodes wide: the transmittance is steeper than any footprint. With the share of the misfit that is
/// enough for thin gas the picture is 1.3 tolerances off.
#[test]
fn dense_gas_is_steeper_than_its_footprints() {
    let rows = include_str!("data/dense_gaussians.csv").lines().skip(1);
    let column =
        |i: usize| -> Vec<f64> { rows.clone().map(|row| row.split(',').nth(i).unwrap().parse().unwrap()).collect() };
    let set = ParticleSet {
        kernel: Kernel::Gaussian,
        x: column(0),
        y: column(1),
        z: column(2),
        radius: Attribute::Each(column(3)),
        opacity: Attribute::Each(column(4)),
        color: Attribute::Uniform([1.0; 3]),
    };
    let mut scene = scene(vec![set], 0.0, [64, 64]);
    scene.camera.look_at = DVec3::NEG_Z;
    scene.camera.fov_y = 10f64.to_radians();
    (scene.stereo, scene.background) = (None, [0.0; 3]);
    let drawn = rendering(&scene, &with(Method::Auto, 0.02));
    let off = off(&scene, &drawn, 1);
    assert!(off <= 0.02, "{off:e}: {:?}", drawn.statistics.plan);
}

#[test]
fn frames_on_the_threads_of_a_session_are_the_same() {
    let scene = large(&[[0.7, 0.6, 0.5]]);
    let mut session = Session::new(&with(Method::Auto, 1.0 / 255.0)).unwrap();
    let outside = session.draw(&scene, &()).unwrap();
    let inside = session.on_threads(|session| session.draw(&scene, &())).unwrap();
    assert!(outside.films == inside.films && outside.films.len() == 2);
}

/// Whatever slabs need of the tolerance, nodes may lose no more than what that leaves.
#[test]
fn slabs_and_nodes_share_the_tolerance() {
    // Before every tile, so that all of it that may be left out is, nearly.
    let haze = balls(Kernel::Gaussian, &[[0.0; 3]; 100], 3.0, 0.0, [0.5; 3]);
    for hazy in [false, true] {
        let mut scene = large(&[[0.9, 0.2, 0.1], [0.1, 0.8, 0.2], [0.2, 0.3, 0.9]]);
        let mut most = 0.0f64;
        for step in 0..16 {
            let tolerance = 0.001 * 1.25f64.powi(step);
            for opacity in [0.05, 0.3] {
                scene.particles.truncate(3);
                for set in &mut scene.particles {
                    set.opacity = Attribute::Uniform(opacity);
                }
                if hazy {
                    scene.particles.push(ParticleSet { opacity: Attribute::Uniform(9e-4 * tolerance), ..haze.clone() });
                }
                let drawn = rendering(&scene, &with(Method::Auto, tolerance)).statistics;
                assert_eq!(drawn.plan[0].starts_with("100 particles are left out"), hazy, "{:?}", drawn.plan);
                let share = drawn.predicted_error.unwrap() / tolerance;
                assert!(share <= 1.0, "{share} of {tolerance:e} with {opacity}, haze: {hazy}");
                most = most.max(share);
            }
        }
        // They use it.
        assert!(most > 0.8, "{most}");
    }
}

#[test]
fn small_particles_and_walls_are_drawn_pixel_by_pixel() {
    let tolerance = 1.0 / 255.0;
    // One small particle in a corner of a smooth picture of the same colour; it must not slip through between nodes.
    let mut small = large(&[[0.7, 0.6, 0.5]]);
    let mut speck = set(Kernel::Gaussian, &[[-1.8, 1.3, 1.0]], 0.02, 0.99);
    speck.color = Attribute::Uniform([0.7, 0.6, 0.5]);
    small.particles.push(speck);
    let mut walled = large(&[[0.7, 0.6, 0.5], [0.1, 0.2, 0.8]]);
    walled.meshes.push(wall(0.0));
    for scene in [small, walled] {
        let drawn = rendering(&scene, &with(Method::Auto, tolerance));
        let plan = drawn.statistics.plan.join(" ");
        assert!(plan.contains("pixel by pixel") && plan.contains("from every"), "{plan}");
        let exact = rendering(&scene, &with(Method::Slab(Default::default()), 0.0));
        let off = drawn.films.iter().zip(&exact.films).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
        assert!(off <= 1.5 * tolerance, "{off:e}: {plan}");
    }
}

/// Balls of two colours that overlap in pairs, one pair behind the other, with a tiny one far away, some cut by a wall.
#[test]
fn colours_that_overlap_keep_the_tolerance() {
    let pairs = |offset: f64| -> Vec<[f64; 3]> {
        (0..8).map(|i| [0.4 * f64::from(i) - 1.4, 0.2 * f64::from(i % 3) - 0.2, offset - 0.9 * f64::from(i)]).collect()
    };
    let red = balls(Kernel::Gaussian, &pairs(0.0), 0.3, 0.5, [0.9, 0.1, 0.1]);
    let blue = balls(Kernel::Poly, &pairs(0.25), 0.3, 0.4, [0.1, 0.2, 0.9]);
    let speck = balls(Kernel::Linear, &[[1.9, 1.2, -4.0]], 0.004, 0.9, [0.0, 1.0, 0.0]);
    let mut scene = scene(vec![red, blue, speck], 3.0, [320, 240]);
    for walls in [vec![], vec![wall(-2.2)], vec![wall(-0.1)]] {
        scene.meshes = walls;
        holds(&scene, "pairs");
    }
}

/// Draws at 1/255 and asserts that neither that nor the prediction is exceeded at some of the pixels.
fn holds(scene: &Scene, what: &str) -> Rendering {
    let drawn = rendering(scene, &with(Method::Auto, 1.0 / 255.0));
    let (off, predicted) = (off(scene, &drawn, 211), drawn.statistics.predicted_error.unwrap());
    println!("{what}: {off:.2e}, predicted {predicted:.2e}: {}", drawn.statistics.plan.join(" "));
    assert!(off <= 1.0 / 255.0 && off <= predicted, "{what}: {off:e}, predicted {predicted:e}");
    drawn
}

/// Slabs get the more the less of a tolerance nodes are expected to lose; grids that they would miss are not drawn at all.
#[test]
fn the_tolerance_is_split_by_what_nodes_need() {
    let scene = large(&[[0.9, 0.2, 0.1], [0.1, 0.8, 0.2], [0.2, 0.3, 0.9]]);
    let mut shares = Vec::new();
    for (tolerance, is_coarse) in [(0.02, true), (1.0 / 255.0, true), (1e-4, false)] {
        let drawn = rendering(&scene, &with(Method::Auto, tolerance));
        let plan = drawn.statistics.plan.join(" ");
        assert_eq!(plan.contains("of every 8th row"), is_coarse, "{tolerance:.2e}: {plan}");
        let (_, words) = plan.split_once("goes to rays that end early, up to ").unwrap();
        shares.push(words.split(' ').next().unwrap().parse::<f64>().unwrap());
        let (off, predicted) = (off(&scene, &drawn, 997), drawn.statistics.predicted_error.unwrap());
        println!("{tolerance:.2e}: {off:.2e}, predicted {predicted:.2e}: {plan}");
        assert!(off <= predicted && predicted <= tolerance, "{off:e}, predicted {predicted:e}: {plan}");
    }
    assert!(shares[0] > shares[1] && shares[2] == 0.4, "{shares:?}");
}

/// Balls of one colour, at places.
fn balls(kernel: Kernel, places: &[[f64; 3]], radius: f64, opacity: f64, color: [f32; 3]) -> ParticleSet {
    ParticleSet { color: Attribute::Uniform(color), ..set(kernel, places, radius, opacity) }
}

/// Tiles that see one colour take their pixels from the transmittance alone; colours meet at, before and behind their seams.
#[test]
fn neighbours_of_other_colours_keep_their_own() {
    for gap in [0.0, 0.3, 0.9] {
        let places = |side: f64| -> Vec<[f64; 3]> {
            (0..12).map(|i| [side * (1.0 + gap), 0.25 * f64::from(i) - 1.4, 0.3 * f64::from(i % 4)]).collect()
        };
        let red = balls(Kernel::Gaussian, &places(-1.0), 1.0, 0.2, [0.9, 0.0, 0.1]);
        let blue = balls(Kernel::Poly, &places(1.0), 1.0, 0.3, [0.0, 0.2, 1.0]);
        // Where it overlaps, billboards are not enough.
        let green = balls(Kernel::Gaussian, &[[-1.2 - gap, 0.2, 0.5]], 0.9, 0.5, [0.1, 0.8, 0.0]);
        let mut wide = scene(vec![red, blue, green], 4.5, [403, 301]);
        wide.background = [0.1, 0.9, 0.3];
        let drawn = holds(&wide, &format!("gap {gap}"));
        assert!(drawn.statistics.plan.join(" ").contains("from every"), "{:?}", drawn.statistics.plan);
    }
}

/// What slabs cannot see by themselves: hollow balls, faint ones that clump, dense ones, rays far from the axis.
#[test]
fn gas_that_is_hard_to_cut_keeps_the_tolerance() {
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let hollow = Kernel::table(vec![0.0, 0.88, 0.9, 0.98, 1.0], vec![0.0, 0.0, 1.0, 1.0, 0.0]).unwrap();
    let clump = |at: f64| -> Vec<[f64; 3]> { (0..250).map(|i| [0.0, 0.0, at - 1e-4 * f64::from(i)]).collect() };
    let chain: Vec<[f64; 3]> = (0..40).map(|i| [0.0, 0.0, 1.0 - 0.1 * f64::from(i)]).collect();
    let pair = |kernel: Kernel, step: f64, opacity: f64| {
        vec![
            balls(kernel.clone(), &[[0.0, 0.0, 0.0]], 0.8, opacity, red),
            balls(kernel, &[[0.0, 0.0, -0.8 * step]], 0.8, opacity, blue),
        ]
    };
    let clumps = vec![
        balls(Kernel::Gaussian, &chain, 0.5, 0.002, [0.5; 3]),
        balls(Kernel::Gaussian, &clump(0.0), 0.5, 0.002, red),
        balls(Kernel::Gaussian, &clump(-0.25), 0.5, 0.002, blue),
    ];
    let cases = [
        ("hollow, thin", pair(hollow.clone(), 0.06, 0.3)),
        ("hollow, dense", pair(hollow, 0.06, 0.75)),
        ("clumps", clumps),
        ("half a pair", pair(Kernel::Gaussian, 0.2, 0.5)),
        ("dense", pair(Kernel::Gaussian, 0.2, 0.9999)),
        ("nearly opaque", pair(Kernel::Gaussian, 0.1, 0.999_999)),
    ];
    for (what, particles) in cases {
        let mut scene = scene(particles, 3.0, [120, 90]);
        holds(&scene, what);
        // In a corner of a wide picture.
        scene.camera.fov_y = 100f64.to_radians();
        scene.camera.look_at = DVec3::new(-4.0, -2.5, -0.5);
        holds(&scene, &format!("{what}, in a corner"));
        scene.background = [60.0, 0.0, 1.0];
        holds(&scene, &format!("{what}, before a bright sky"));
    }
}

/// A small picture straight ahead, all of whose rays see the same: what slabs hide from one ray they hide from all.
fn ahead(particles: Vec<ParticleSet>) -> Scene {
    let mut scene = scene(particles, 3.0, [40, 30]);
    scene.camera.look_at = DVec3::ZERO;
    scene.camera.fov_y = 0.5f64.to_radians();
    scene.stereo = None;
    scene
}

/// Clumps of balls each of which is faint, but dense together. Extrapolations of thick slabs agree in some of them by chance:
/// without distrust they are off by up to 12 tolerances.
#[test]
fn dense_clumps_of_faint_balls_keep_the_tolerance() {
    for (count, depth, apart, gas) in [
        (40, 1.5, 0.25, true),
        (40, 2.5, 0.15, false),
        (10, 1.0, 0.25, true),
        (5, 0.5, 0.3, true),
        (10, 4.0, 0.4, false),
    ] {
        let opacity = -(-depth / f64::from(count)).exp_m1();
        let clump = |z: f64, color| balls(Kernel::Gaussian, &vec![[0.0, 0.0, z]; count as usize], 0.5, opacity, color);
        let mut particles = vec![clump(0.0, [1.0, 0.0, 0.0]), clump(-0.5 * apart, [0.0, 0.0, 1.0])];
        if gas {
            particles.push(balls(Kernel::Gaussian, &[[0.0; 3]], 20.0, 0.02, [0.5, 0.0, 0.5]));
        }
        for fov in [0.5f64, 20.0] {
            let mut scene = ahead(particles.clone());
            scene.camera.fov_y = fov.to_radians();
            holds(&scene, &format!("{count} balls, {depth} deep, {apart} apart"));
        }
    }
}

/// A truncated Gaussian ends in a step: its footprint has a vertical tangent at the rim, which nodes hardly see. Large dense balls
/// whose rims run through a small picture, here along the nodes and there across them: without a bound for rims of their own they
/// are off by up to two tolerances.
#[test]
fn rims_of_large_balls_keep_the_tolerance() {
    let (mut worst, mut least) = (0.0f64, usize::MAX);
    let mut random = Random::new(5);
    for number in 0..80 {
        let mut picture = scene(Vec::new(), 0.0, [64, 64]);
        picture.camera.look_at = DVec3::new(0.0, 0.0, -1.0);
        picture.camera.fov_y = 30f64.to_radians();
        picture.stereo = None;
        picture.background = [0.0; 3];
        // Pixels per unit of length at distance 4.
        let pixels = 32.0 / 15f64.to_radians().tan() / 4.0;
        let count = [1, 1, 2, 5][number % 4];
        for i in 0..count {
            let radius = random.uniform(4.0, 6.0).exp();
            let (angle, x, y) = match number % 3 {
                0 => (0.0, random.uniform(-32.0, 32.0), 0.0),
                _ => (random.uniform(0.0, 6.3), random.uniform(-32.0, 32.0), random.uniform(-32.0, 32.0)),
            };
            let (x, y) = (x + radius * angle.cos(), y + radius * angle.sin());
            let color = if number % 8 < 5 { [1.0; 3] } else { [[0.9, 0.2, 0.1], [0.1, 0.8, 0.2]][i % 2] };
            let place = [x / pixels, y / pixels, -4.0];
            picture.particles.push(balls(
                Kernel::Gaussian,
                &[place],
                radius / pixels,
                random.uniform(0.3, 0.95),
                color,
            ));
        }
        for tolerance in TOLERANCES {
            let drawn = rendering(&picture, &with(Method::Auto, tolerance));
            let (off, predicted) = (off(&picture, &drawn, 7), drawn.statistics.predicted_error.unwrap());
            worst = worst.max(off / tolerance);
            least = least.min(drawn.statistics.fragments as usize);
            assert!(
                off <= tolerance && off <= predicted,
                "{number}: {off:e} of {tolerance:e}, predicted {predicted:e}"
            );
        }
    }
    println!("at most {worst:.2} of the tolerance; {least} fragments at least");
    // Not because all was drawn pixel by pixel.
    assert!(least < 64 * 64 / 4);
}

/// Thin shells of two colours, one close behind the other. Slabs that held both in front, nothing, and both again would be
/// the same by one, by two and by four.
#[test]
fn shells_that_almost_touch_keep_the_tolerance() {
    let shell = Kernel::table(vec![0.0, 0.98, 0.982, 0.998, 1.0], vec![0.0, 0.0, 1.0, 1.0, 0.0]).unwrap();
    for step in [0.02, 0.025] {
        for opacity in [0.3, 0.75] {
            let red = balls(shell.clone(), &[[0.0; 3]], 0.8, opacity, [1.0, 0.0, 0.0]);
            let blue = balls(shell.clone(), &[[0.0, 0.0, -0.8 * step]], 0.8, opacity, [0.0, 0.0, 1.0]);
            holds(&ahead(vec![red, blue]), &format!("shells of {opacity}, {step} apart"));
        }
    }
}

/// Faint balls of two colours, clumped, in fainter gas of their mean colour. Slabs with room for a clump would hold nothing
/// but that colour.
#[test]
fn clumps_in_gas_of_their_mean_colour_keep_the_tolerance() {
    for count in [500, 20] {
        for step in [0.4, 0.6] {
            let opacity = -(-0.25 / count as f64).exp_m1();
            let clump = |z: f64, color| balls(Kernel::Gaussian, &vec![[0.0, 0.0, z]; count], 0.5, opacity, color);
            let (red, blue) = (clump(0.0, [1.0, 0.0, 0.0]), clump(-0.5 * step, [0.0, 0.0, 1.0]));
            let gas = balls(Kernel::Gaussian, &[[0.0; 3]], 20.0, 0.02, [0.5, 0.0, 0.5]);
            holds(&ahead(vec![red, blue, gas]), &format!("{count} faint balls, {step} apart"));
        }
    }
}

/// Faint balls one behind the other along rays that span little depth for their length, as those of eyes do that are far apart:
/// by their depths alone they would hold too little for their order to matter.
#[test]
fn slanted_rays_through_faint_gas_keep_the_tolerance() {
    for (tangent, depth) in [(8.0f64, 0.12f64), (8.0, 0.16), (12.0, 0.2), (12.0, 0.25)] {
        let (opacity, step) = (-(-depth).exp_m1(), 1.8 / tangent.hypot(1.0));
        let red = balls(Kernel::Gaussian, &[[0.0; 3]], 1.0, opacity, [1.0, 0.0, 0.0]);
        let blue = balls(Kernel::Gaussian, &[[step * tangent, 0.0, -step]], 1.0, opacity, [0.0, 0.0, 1.0]);
        let mut slanted = ahead(vec![red, blue]);
        // The axes of the views are parallel, and 3 before them they see the middle.
        slanted.stereo =
            Some(Stereo { interocular: 6.0 * tangent, convergence: Some(3.0), mode: StereoMode::Parallel });
        holds(&slanted, &format!("tangent {tangent}, depth {depth}"));
    }
}

/// More gas of many colours than there are slabs for: the prediction says so.
#[test]
fn what_is_too_deep_for_slabs_is_predicted() {
    for (opacity, seen) in [(0.0005, true), (0.05, false)] {
        let mut random = Random::new(3);
        let particles = (0..4)
            .map(|_| {
                let places: Vec<[f64; 3]> = (0..1500)
                    .map(|_| [random.uniform(-0.01, 0.01), random.uniform(-0.01, 0.01), random.uniform(-60.0, 1.0)])
                    .collect();
                balls(Kernel::Constant, &places, 0.05, opacity, random.color(1.0))
            })
            .collect();
        let mut deep = scene(particles, 3.0, [40, 30]);
        // Rays along the gas.
        deep.camera.fov_y = 0.5f64.to_radians();
        deep.camera.look_at = DVec3::ZERO;
        deep.stereo = None;
        let drawn = rendering(&deep, &with(Method::Auto, 1e-5));
        let (off, predicted) = (off(&deep, &drawn, 7), drawn.statistics.predicted_error.unwrap());
        println!("{off:.2e}, predicted {predicted:.2e}");
        assert!(off <= predicted, "{off:e}, predicted {predicted:e}");
        // Where nothing is seen of it, nothing is lost.
        assert_eq!(predicted > 0.01, seen, "opacity {opacity}: predicted {predicted:e}");
    }
}

#[test]
fn small_particles_of_one_colour_are_balls_one_by_one() {
    let gas =
        Gas { count: 300, low: [-1.5; 3], high: [1.5; 3], radius: [0.01, 0.03], opacity: [0.1, 0.9], bright: 1.0 };
    let particles = gas.draw(&mut Random::new(5), Kernel::Poly);
    let scene = scene(vec![ParticleSet { color: Attribute::Uniform([0.9, 0.8, 0.1]), ..particles }], 4.0, [160, 120]);
    let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 255.0));
    assert!(drawn.statistics.plan[0].contains("projected exactly"), "{:?}", drawn.statistics.plan);
    let truth = rendering(&scene, &with(Method::Reference(Parameters::DEFAULT), 0.0));
    for (a, b) in drawn.films.iter().zip(&truth.films) {
        assert!(difference(a, b) <= 1.0 / 255.0);
    }
}

#[test]
fn a_small_ball_beside_a_tile_is_not_taken_into_its_pixels() {
    // Opaque, with a step at its rim, and where it is on nodes, only nodes across the corner of a tile hold it.
    for step in 0..8 {
        let (x, y) = (0.02 * f64::from(step), 0.015 * f64::from(step % 3));
        let small = set(Kernel::Constant, &[[0.62 + x, 0.55 + y, 0.0]], 0.11, 0.99);
        let large = set(Kernel::Gaussian, &[[0.0, 0.0, 0.0]], 2.5, 0.05);
        let particles = vec![
            ParticleSet { color: Attribute::Uniform([0.1, 0.9, 0.2]), ..small },
            ParticleSet { color: Attribute::Uniform([0.9, 0.1, 0.9]), ..large },
        ];
        let scene = scene(particles, 5.0, [256, 192]);
        let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 1023.0));
        let truth = rendering(&scene, &with(Method::Reference(Parameters::DEFAULT), 0.0));
        for (a, b) in drawn.films.iter().zip(&truth.films) {
            let off = difference(a, b);
            assert!(off <= 1.0 / 1023.0, "step {step}: {off:e} {:?}", drawn.statistics.plan);
        }
    }
}

/// Balls of a radius of 10 pixels all over a picture, thinner by a factor to the right of its middle.
fn dust(count: usize, opacity: f64, thinner: f64) -> Scene {
    let gas = Gas {
        count,
        low: [-2.2, -1.6, -0.8],
        high: [2.2, 1.6, 0.5],
        radius: [0.1, 0.12],
        opacity: [0.8 * opacity, opacity],
        bright: 1.0,
    };
    let mut particles = gas.draw(&mut Random::new(15), Kernel::Gaussian);
    let own: Vec<f64> = (0..gas.count).map(|i| particles.opacity.get(i)).collect();
    let own = own.iter().zip(&particles.x).map(|(own, &x)| if x > 0.0 { own / thinner } else { *own });
    particles.opacity = Attribute::Each(own.collect());
    scene(vec![ParticleSet { color: Attribute::Uniform([0.9, 0.8, 0.1]), ..particles }], 4.0, [480, 360])
}

/// How many balls a plan draws by rays that are taken for parallel, of how many, and what that changes at the most.
fn affine(drawn: &Rendering) -> Option<[f64; 3]> {
    let words = drawn.statistics.plan.iter().find(|words| words.contains("taken for parallel"))?;
    let numbers: Vec<f64> =
        words.split([' ', ',']).filter_map(|word| word.trim_end_matches('.').parse().ok()).collect();
    Some([numbers[0], numbers[1], numbers[2]])
}

/// Draws a scene, and checks that a share of its balls is drawn so, and that no pixel is off by more than that may change and a little
/// that is lost besides.
fn check_affine(scene: &Scene, tolerance: f64, shares: std::ops::RangeInclusive<f64>, besides: f64) {
    let drawn = rendering(scene, &with(Method::Auto, tolerance));
    let plan = &drawn.statistics.plan;
    assert!(plan[0].contains("projected exactly"), "{plan:?}");
    let [count, all, error] = affine(&drawn).unwrap_or([0.0, 1.0, 0.0]);
    assert!(shares.contains(&(count / all)), "{tolerance}: {plan:?}");
    assert!(error <= 0.72 * tolerance, "{plan:?}");
    let off = off(scene, &drawn, 7);
    // Exact balls are rounded, and by polynomials.
    assert!(off <= error + besides + 5e-6, "{tolerance}: {off:e}, {plan:?}");
    assert!(error == 0.0 || off > 0.004 * error, "{tolerance}: {off:e}, {plan:?}");
}

#[test]
fn thin_gas_of_small_balls_is_drawn_by_products() {
    // All of it, the thin half alone, and nothing.
    check_affine(&dust(3000, 0.002, 1.0), 1.0 / 255.0, 0.99..=1.0, 0.0);
    check_affine(&dust(3000, 0.02, 1.0), 0.02, 0.9..=1.0, 0.0);
    check_affine(&dust(3000, 0.06, 40.0), 1.0 / 255.0, 0.35..=0.65, 0.0);
    // The same where it is many balls that are too much together, none by itself.
    check_affine(&dust(15_000, 0.015, 40.0), 1.0 / 255.0, 0.35..=0.65, 0.0);
    check_affine(&dust(3000, 0.02, 1.0), 1.0 / 1023.0, 0.0..=0.0, 0.0);
    check_affine(&dust(3000, 0.002, 1.0), 1e-5, 0.0..=0.0, 0.0);
    // Beside a half that is opaque, whose dense middles come first.
    check_affine(&dust(24_000, 0.95, 5000.0), 1.0 / 255.0, 0.2..=0.6, 0.9 / 255.0);
}

#[test]
fn products_keep_to_what_is_theirs() {
    let haze = dust(3000, 0.002, 1.0);
    // Rays that are slanted, as the eyes' pictures are.
    let mut wide = haze.clone();
    wide.camera.fov_y = 100f64.to_radians();
    wide.camera.position.z = 2.0;
    wide.stereo = Some(Stereo { interocular: 0.5, convergence: Some(0.7), mode: StereoMode::Parallel });
    check_affine(&wide, 0.02, 0.7..=1.0, 0.0);
    // Large balls, cut by the picture's edges, among small ones.
    let large = Gas { count: 25, low: [-4.0, -3.0, -2.0], high: [4.0, 3.0, 0.0], radius: [0.5, 1.5], ..thin(0.001) };
    let mut mixed = haze.clone();
    let color = haze.particles[0].color.clone();
    mixed.particles.push(ParticleSet { color: color.clone(), ..large.draw(&mut Random::new(3), Kernel::Gaussian) });
    check_affine(&mixed, 0.02, 0.9..=1.0, 0.0);
    // Other kernels have no such footprints.
    let others = Gas { count: 1500, low: [-2.2, -1.6, -0.8], high: [2.2, 1.6, 0.5], radius: [0.1; 2], ..thin(0.002) };
    mixed.particles[1] = ParticleSet { color, ..others.draw(&mut Random::new(4), Kernel::Poly) };
    check_affine(&mixed, 1.0 / 255.0, 0.6..=0.7, 0.0);
    let own = [mixed.particles.remove(1)];
    check_affine(&Scene { particles: own.into(), ..mixed }, 1.0 / 255.0, 0.0..=0.0, 0.0);
    // Of several colours in order, what overlaps counts too; tiles of both kinds are exact.
    for (opacity, thinner, shares) in [(0.001, 1.0, 0.95..=1.0), (0.16, 400.0, 0.5..=0.9)] {
        let mut colored = dust(900, opacity, thinner);
        let mut other = colored.particles[0].clone();
        other.x.iter_mut().for_each(|x| *x = 1.0 + 0.5 * x.abs());
        other.opacity = Attribute::Uniform(0.0005);
        colored.particles[0].color = Attribute::Uniform([0.1, 0.3, 0.9]);
        colored.particles.push(other);
        check_affine(&colored, 0.01, shares, 0.6 * 0.01);
    }
    // Nothing that a wall cuts is drawn so.
    let mut walled = haze;
    walled.meshes.push(wall(0.0));
    let drawn = rendering(&walled, &with(Method::Auto, 1.0 / 255.0));
    assert!(affine(&drawn).is_none() && off(&walled, &drawn, 97) <= 1.0 / 255.0);
}

/// Gas of that opacity.
fn thin(opacity: f64) -> Gas {
    Gas { count: 0, low: [0.0; 3], high: [0.0; 3], radius: [0.1; 2], opacity: [opacity; 2], bright: 1.0 }
}

/// Two colours, many small balls of each: `apart` of them one behind the other, so that no two of different colours overlap.
fn two_colors(apart: bool, opacity: f64) -> Scene {
    let sets = [[0.9, 0.2, 0.1], [0.1, 0.3, 0.9]].into_iter().enumerate().map(|(i, color)| {
        let depth = if apart { 1.5 * i as f64 } else { 0.0 };
        let gas = Gas {
            count: 400,
            low: [-1.5, -1.5, -0.5 - depth],
            high: [1.5, 1.5, 0.2 - depth],
            radius: [0.02, 0.04],
            opacity: [0.8 * opacity, opacity],
            bright: 1.0,
        };
        let particles = gas.draw(&mut Random::new(7 + i as u64), Kernel::Gaussian);
        ParticleSet { color: Attribute::Uniform(color), ..particles }
    });
    scene(sets.collect(), 4.0, [160, 120])
}

#[test]
fn balls_of_several_colours_are_billboards_where_order_hardly_matters() {
    let truth = |scene: &Scene| rendering(scene, &with(Method::Reference(Parameters::DEFAULT), 0.0));
    for (scene, billboards) in
        [(two_colors(true, 0.9), true), (two_colors(false, 0.001), true), (two_colors(false, 0.9), false)]
    {
        let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 255.0));
        let plan = &drawn.statistics.plan;
        assert_eq!(plan.iter().any(|line| line.contains("projected exactly")), billboards, "{plan:?}");
        for (a, b) in drawn.films.iter().zip(&truth(&scene).films) {
            assert!(difference(a, b) <= 1.0 / 255.0, "{plan:?}");
        }
    }
    // What the bound keeps out is wrong indeed.
    let scene = two_colors(false, 0.9);
    let sorted = rendering(&scene, &with(Method::Perspective, 1.0 / 255.0));
    assert!(difference(&sorted.films[0], &truth(&scene).films[0]) > 1.0 / 255.0);
}

#[test]
fn without_tolerance_it_is_the_best_there_is() {
    let scene = random_scene(2);
    let truth = rendering(&scene, &with(Method::Reference(Parameters::DEFAULT), 0.0));
    let drawn = rendering(&scene, &with(Method::Auto, 0.0));
    for (a, b) in drawn.films.iter().zip(&truth.films) {
        let off = difference(a, b);
        assert!(off < 2e-4, "{off:e}");
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let mut walled = large(&[[0.9, 0.2, 0.1], [0.2, 0.3, 0.9]]);
    walled.meshes.push(wall(0.0));
    for scene in [walled, random_scene(3), random_scene(7), haze(40_000, 1e-8, 2), dust(3000, 0.06, 40.0)] {
        let films = |threads| rendering(&scene, &Settings { threads: Some(threads), ..Settings::default() }).films;
        let one = films(1);
        for threads in [2, 3] {
            assert!(films(threads) == one, "{threads} threads");
        }
    }
}

#[test]
fn pictures_of_any_size_and_scenes_without_gas_are_drawn() {
    for size in [[1, 1], [3, 2], [17, 65], [129, 64], [200, 3]] {
        let mut scene = large(&[[0.7, 0.6, 0.5], [0.1, 0.2, 0.8]]);
        scene.camera.size = size;
        let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 255.0));
        let off = off(&scene, &drawn, 29);
        assert!(off <= 1.0 / 255.0, "{size:?}: {off:e}");
        let codes = Settings { pixels: Pixels::Srgb8, ..with(Method::Auto, 1.0 / 255.0) };
        assert!(apart(&rendering(&scene, &codes).encoded, &drawn.films).0 <= 1);
        scene.particles.clear();
        let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 255.0));
        assert_eq!(apart(&rendering(&scene, &codes).encoded, &drawn.films), (0, 0));
        for film in &drawn.films {
            assert!(film.transmittance.iter().all(|&through| through == 1.0));
            assert!(film.color[1].iter().all(|&green| green == scene.background[1]));
        }
        // Gas behind the camera, and gas that is not there.
        let behind = set(Kernel::Constant, &[[0.0, 0.0, 9.0], [0.0, 0.0, 20.0]], 0.5, 0.9);
        scene.particles = vec![behind, set(Kernel::Gaussian, &[[0.0; 3]], 0.5, 0.0)];
        let drawn = rendering(&scene, &with(Method::Auto, 1.0 / 255.0));
        assert!(drawn.films.iter().all(|film| film.transmittance.iter().all(|&through| through == 1.0)));
    }
}

/// Haze of so many particles of that opacity before a few that are seen.
fn haze(count: usize, opacity: f64, colors: usize) -> Scene {
    let mut random = Random::new(77);
    let gas = Gas { count, low: [-1.5; 3], high: [1.5; 3], radius: [0.2, 0.4], opacity: [opacity; 2], bright: 1.0 };
    let haze = gas.draw(&mut random, Kernel::Gaussian);
    let faint: Vec<f64> = (0..count).map(|i| opacity * (1.0 + (i % 7) as f64 / 10.0)).collect();
    let color = |i: usize| Attribute::Uniform([[0.9, 0.1, 0.2], [0.1, 0.3, 0.8]][i % colors]);
    let haze = ParticleSet { opacity: Attribute::Each(faint), color: color(0), ..haze };
    let few = Gas { count: 30, low: [-1.0; 3], high: [1.0; 3], radius: [0.5, 0.9], opacity: [0.1, 0.5], bright: 1.0 };
    let few = ParticleSet { color: color(1), ..few.draw(&mut random, Kernel::Poly) };
    scene(vec![haze, few], 4.0, [64, 48])
}

#[test]
fn what_is_too_faint_all_together_is_left_out() {
    for colors in [1, 2] {
        // Together they have an optical depth of about 1e-4, of 0.02.
        let mut fragments = Vec::new();
        for (opacity, out) in [(1e-7, true), (2e-5, false)] {
            let scene = haze(3000, opacity, colors);
            let drawn = holds(&scene, &format!("3000 of {opacity:e}, {colors} colours"));
            let said = drawn.statistics.plan.iter().any(|words| words.starts_with("3000 particles are left out"));
            assert_eq!(said, out, "{:?}", drawn.statistics.plan);
            fragments.push(drawn.statistics.fragments);
        }
        assert!(4 * fragments[0] < fragments[1], "{fragments:?}");
    }
    // Nothing is, where nothing may be lost.
    let drawn = rendering(&haze(3000, 1e-7, 1), &with(Method::Auto, 0.0));
    assert!(drawn.statistics.plan.iter().all(|words| !words.contains("left out")));
}

/// The largest difference of codes, and how many of them differ.
fn apart(frames: &[Rgba8], films: &[Film]) -> (u8, usize) {
    assert_eq!(frames.len(), films.len());
    let want: Vec<Rgba8> = films.iter().map(Rgba8::of).collect();
    assert!(frames.iter().zip(&want).all(|(a, b)| a.size == b.size && a.pixels.len() == b.pixels.len()));
    let codes =
        |frames: &[Rgba8]| frames.iter().flat_map(|frame| frame.pixels.as_flattened().to_vec()).collect::<Vec<_>>();
    let pairs = codes(frames).into_iter().zip(codes(&want));
    pairs.fold((0, 0), |(most, count), (a, b)| (most.max(a.abs_diff(b)), count + usize::from(a != b)))
}

#[test]
fn frames_of_8_bits_are_the_films_encoded() {
    let mut scenes: Vec<Scene> = (0..30).map(random_scene).collect();
    // Grids of every distance, tiles of every kind, and a width that no vector divides.
    for (number, size) in [(3, [403, 301]), (5, [403, 301]), (2, [320, 240]), (7, [200, 150]), (12, [131, 97])] {
        let mut large = random_scene(number);
        large.camera.size = size;
        scenes.push(large);
    }
    // Deep black, beyond white, samples that are averaged first.
    let mut dark = random_scene(3);
    dark.background = [0.0, 0.001, 0.002];
    dark.camera.size = [200, 150];
    let mut bright = random_scene(5);
    bright.background = [1.5, 0.99, 4.0];
    bright.camera.size = [200, 150];
    let mut fine = random_scene(4);
    fine.camera.samples = 2;
    scenes.extend([dark, bright, fine]);
    let mut tiles = 0;
    for (number, scene) in scenes.iter().enumerate() {
        // Those of many kinds at every level, which have other vectors and so other ends of rows.
        let is_large = number >= 30;
        for level in if is_large { Level::available() } else { vec![Level::best()] } {
            let mut settings = with(Method::Auto, TOLERANCES[number % 3]);
            settings.simd = Some(level);
            let films = rendering(scene, &settings).films;
            settings.pixels = Pixels::Srgb8;
            let drawn = rendering(scene, &settings);
            assert!(drawn.films.is_empty());
            tiles += usize::from(drawn.statistics.encoded && level == Level::best());
            let (most, count) = apart(&drawn.encoded, &films);
            // What is within a fortieth of a step of where codes change may go either way.
            let share = count as f64 / (6 * films[0].transmittance.len()) as f64;
            let off = format!("{most} apart, {count} of them ({share:.4})");
            assert!(most <= 1 && share < 0.03, "scene {number}, {level}: {off}");
        }
    }
    assert!(tiles > 20, "{tiles}");
}

#[test]
fn times_are_foretold() {
    let time = |scene: &Scene, threads| {
        let settings = Settings { threads: Some(threads), ..with(Method::Auto, 1.0 / 255.0) };
        rendering(scene, &settings).statistics.predicted_time.unwrap().as_secs_f64()
    };
    let mut walled = large(&[[0.9, 0.2, 0.1], [0.2, 0.3, 0.9]]);
    walled.meshes.push(wall(0.0));
    // Grids of one colour and of several, walls, billboards.
    for mut scene in
        [large(&[[0.7, 0.6, 0.5]]), large(&[[0.9, 0.2, 0.1], [0.2, 0.3, 0.9]]), walled, two_colors(true, 0.9)]
    {
        scene.camera.size = [160, 120];
        let small = time(&scene, 1);
        assert!((0.5..2.0).contains(&(2.0 * time(&scene, 2) / small)), "threads");
        scene.camera.size = [1280, 960];
        let large = time(&scene, 1);
        assert!(small > 0.0 && large > 8.0 * small && large < 80.0 * small, "{small:e} and {large:e}");
    }
    assert_eq!(rendering(&random_scene(1), &with(Method::Perspective, 1.0 / 255.0)).statistics.predicted_time, None);
}

/// The eye in gas of one colour: balls that the near plane cuts, in front of their centres, through them and behind, are added to nodes
/// as whole ones are. Of every kernel that a grid follows, large and as small as nodes can follow, before a wall too.
#[test]
fn cut_balls_of_one_colour_are_added_to_nodes() {
    let mut coarse = 0;
    for (number, kernel) in kernels().into_iter().enumerate() {
        for (radius, near, has_wall) in [([0.8, 1.2], 0.1, false), ([0.8, 1.2], 0.6, true), ([0.25, 0.4], 0.4, false)] {
            let gas = Gas {
                count: if radius[0] < 0.5 { 250 } else { 60 },
                low: [-2.0, -1.5, -1.5],
                high: [2.0, 1.5, 1.5],
                radius,
                opacity: [0.02, 0.2],
                bright: 1.0,
            };
            let color = Attribute::Uniform([0.7, 0.6, 0.5]);
            let particles = gas.draw(&mut Random::new(31 + number as u64), kernel.clone());
            let mut scene = scene(vec![ParticleSet { color, ..particles }], 1.1, [403, 301]);
            scene.camera.near = near;
            if has_wall {
                scene.meshes.push(wall(-0.8));
            }
            let set = &scene.particles[0];
            for view in scene.views() {
                let cuts = (0..set.len()).map(|i| {
                    let depth = -view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i])).z;
                    (near - depth) / set.radius.get(i)
                });
                let count = |from: f64, to: f64| cuts.clone().filter(|cut| (from..to).contains(cut)).count();
                assert!(
                    count(-1.0, 0.0) > 1 && count(0.0, 1.0) > 1,
                    "{near}: {}, {}",
                    count(-1.0, 0.0),
                    count(0.0, 1.0)
                );
            }
            let drawn = holds(&scene, &format!("{}, {radius:?}, near {near}", kernel.name()));
            coarse += usize::from(drawn.statistics.plan.join(" ").contains(" from every "));
        }
    }
    assert!(coarse > 8, "{coarse}");
}

/// Nodes of other scenes and other places of the camera, left in memory, are in no later picture.
#[test]
fn a_session_of_auto_draws_every_frame_as_if_it_were_the_first() {
    let settings = with(Method::Auto, 1.0 / 255.0);
    let mut session = Session::new(&settings).unwrap();
    let mut scenes: Vec<Scene> = (0..24).map(random_scene).collect();
    // Pictures of one tile, and of many.
    scenes[..12].iter_mut().for_each(|scene| scene.camera.size = [331, 203]);
    let mut walled = large(&[[0.9, 0.2, 0.1], [0.1, 0.8, 0.2], [0.2, 0.3, 0.9]]);
    scenes.extend([walled.clone(), large(&[[0.7, 0.6, 0.5]])]);
    walled.meshes.push(wall(0.0));
    scenes.push(walled);
    // Billboards, exact ones to one side and products to the other, by turns; at the edges one eye sees what the other does not.
    let billboards = scenes.len();
    for side in [1.0, -1.0] {
        let mut dust = dust(3000, 0.06, 40.0);
        dust.stereo = Some(Stereo { interocular: 0.1, convergence: Some(4.0), mode: StereoMode::Parallel });
        dust.particles[0].x.iter_mut().for_each(|x| *x *= side);
        scenes.push(dust);
    }
    for round in 0..3 {
        for (number, scene) in scenes.iter_mut().enumerate() {
            let drawn = session.draw(scene, &()).unwrap();
            assert_eq!(affine(&drawn).is_some(), number >= billboards, "scene {number}");
            assert!(bits(&drawn.films) == bits(&rendering(scene, &settings).films), "scene {number}, round {round}");
            session.recycle(drawn);
            scene.camera.position.x += 0.3;
        }
    }
}

/// Whether a method's frames of 8 bits are its films encoded, and whether it wrote them itself.
fn is_encoded(scene: &Scene, settings: &Settings, label: &str) -> bool {
    let films = rendering(scene, settings).films;
    let settings = Settings { pixels: Pixels::Srgb8, ..settings.clone() };
    let mut session = Session::new(&settings).unwrap();
    let mut encoded = true;
    // Frames and films of the first frame are used again.
    for _ in 0..2 {
        let drawn = session.draw(scene, &()).unwrap();
        encoded &= drawn.statistics.encoded;
        let (most, count) = apart(&drawn.encoded, &films);
        // What is within a fortieth of a step of where codes change may go either way.
        let share = count as f64 / (6 * films[0].transmittance.len()) as f64;
        assert!(most <= 1 && share < 0.03, "{label}: {most} apart, {count} of them ({share:.4})");
        session.recycle(drawn);
    }
    encoded
}

#[test]
fn frames_of_8_bits_are_made_of_any_films() {
    let scene = random_scene(7);
    for method in [Method::Slab(slab::Parameters::DEFAULT), Method::Sheet(sheet::Parameters::DEFAULT)] {
        assert!(!is_encoded(&scene, &with(method, 1.0 / 255.0), method.name()));
    }
}

#[test]
fn billboards_are_drawn_into_8_bits() {
    let mut scenes: Vec<Scene> = (0..12).map(random_scene).collect();
    // Widths that no vector and no tile divides, walls, deep black and beyond white.
    for (number, size) in [(3, [403, 301]), (5, [131, 97]), (2, [1, 1])] {
        let mut large = random_scene(number);
        large.camera.size = size;
        scenes.push(large);
    }
    let mut walled = large(&[[0.9, 0.2, 0.1]]);
    walled.meshes.push(wall(0.0));
    let mut dark = random_scene(3);
    dark.background = [0.0, 0.001, 0.002];
    let mut bright = random_scene(5);
    bright.background = [1.5, 0.99, 4.0];
    // Several batches of particles; none at all.
    let mut none = random_scene(1);
    none.particles.clear();
    // Tiles that are opaque after the first batch beside such that take all.
    let batches = [1, 2].map(|colors| {
        let mut scene = haze(40_000, 1e-4, colors);
        scene.camera.size = [200, 150];
        let set = &mut scene.particles[0];
        set.opacity = Attribute::Each(set.x.iter().map(|&x| if x < 0.0 { 0.6 } else { 1e-4 }).collect());
        scene
    });
    scenes.extend([walled, dark, bright, none]);
    scenes.extend(batches);
    for (number, scene) in scenes.iter().enumerate() {
        for method in [Method::Viewplane, Method::Viewpoint, Method::Perspective] {
            for opacity_model in [OpacityModel::Linear, OpacityModel::Exponential] {
                let settings = Settings { opacity_model, ..with(method, 1.0 / 255.0) };
                let label = format!("scene {number}, {}, {}", method.name(), opacity_model.name());
                assert!(is_encoded(scene, &settings, &label), "{label}");
            }
        }
    }
    // Many small particles, which `auto` draws so: without films too.
    let (small, settings) = (two_colors(true, 0.9), with(Method::Auto, 1.0 / 255.0));
    let plan = rendering(&small, &settings).statistics.plan;
    assert!(plan.iter().any(|words| words.contains("projected exactly")), "{plan:?}");
    assert!(is_encoded(&small, &settings, "auto"));
}
