//! The billboard methods and spherical billboards against the independent renderer of [`crate::truth`], pixel by pixel, over kernels,
//! opacity models, tolerances and vector instructions.

use crate::harness::{Difference, Gas, Random, difference, kernels, set};
use crate::truth::{self, Balls, Opaque, Pinhole, Way};
use glam::{DMat3, DVec3};
use std::sync::Mutex;
use stereomist::picture::Film;
use stereomist::render::cpu::simd::Level;
use stereomist::render::method::sheet;
use stereomist::render::method::spherical::{Falloff, Parameters, Quad, Rays};
use stereomist::render::{DEFAULT_TOLERANCE, Method, OpacityModel, Progress, Session, Settings, draw};
use stereomist::scene::mesh::Material;
use stereomist::scene::{Attribute, Camera, Kernel, Mesh, ParticleSet, Scene, Stereo, StereoMode};

pub const METHODS: [(Method, Way); 9] = [
    (Method::Viewplane, Way::Viewplane),
    (Method::Viewpoint, Way::Viewpoint),
    (Method::Perspective, Way::Perspective),
    spherical(false, false, false),
    spherical(true, false, false),
    spherical(false, false, true),
    spherical(true, false, true),
    spherical(false, true, false),
    spherical(true, true, false),
];

const fn spherical(integrated: bool, perspective: bool, centred: bool) -> (Method, Way) {
    let parameters = Parameters {
        falloff: if integrated { Falloff::Integrated } else { Falloff::Printed },
        rays: if perspective { Rays::Perspective } else { Rays::Parallel },
        quad: if centred { Quad::Centre } else { Quad::Far },
    };
    (Method::Spherical(parameters), Way::Spherical(Balls { integrated, perspective, centred }))
}

/// Whether a method would do the same again for another kernel or opacity model.
pub fn repeats(method: Method, kernel: &Kernel, opacity_model: OpacityModel) -> bool {
    !method.has_kernels() && *kernel != Kernel::default()
        || !method.has_opacity_model() && opacity_model != OpacityModel::default()
}

/// What single precision and its approximations may cost, per channel.
pub const PRECISION: f64 = 1e-3;

// ---- Scenes

pub fn camera(position: [f64; 3], look_at: [f64; 3], fov_y_deg: f64, size: [u32; 2]) -> Camera {
    Camera {
        position: position.into(),
        look_at: look_at.into(),
        up: DVec3::new(0.1, 1.0, 0.05),
        fov_y: fov_y_deg.to_radians(),
        size,
        near: 0.1,
        samples: 1,
    }
}

pub fn rig(interocular: f64, convergence: Option<f64>) -> Option<Stereo> {
    Some(Stereo { interocular, convergence, mode: StereoMode::Parallel })
}

pub fn scene(camera: Camera, stereo: Option<Stereo>, particles: Vec<ParticleSet>) -> Scene {
    Scene { camera, stereo, background: [0.25, 0.4, 0.7], particles, meshes: Vec::new() }
}

/// Around the origin, from a corner of the room.
pub fn cloud(count: usize) -> Gas {
    Gas { count, low: [-2.0, -1.5, -2.0], high: [2.0, 1.5, 2.0], radius: [0.15, 0.8], opacity: [0.0, 0.9], bright: 1.0 }
}

const CORNER: [f64; 3] = [1.0, 2.0, 6.0];
const MIDDLE: [f64; 3] = [0.0, 0.3, 0.0];

pub fn many_colours(kernel: Kernel) -> Vec<Scene> {
    let gas = cloud(150).draw(&mut Random::new(21), kernel);
    vec![scene(camera(CORNER, MIDDLE, 45.0, [96, 72]), rig(0.3, Some(5.0)), vec![gas])]
}

pub fn one_colour(kernel: Kernel) -> Vec<Scene> {
    let mut random = Random::new(22);
    let centres: Vec<_> = (0..200).map(|_| random.point([-2.0, -1.5, -2.0], [2.0, 1.5, 2.0])).collect();
    let gas = ParticleSet { color: Attribute::Uniform([0.86, 0.8, 0.7]), ..set(kernel, &centres, 0.45, 0.4) };
    vec![scene(camera(CORNER, MIDDLE, 45.0, [65, 67]), rig(0.065, None), vec![gas])]
}

/// Every kernel in one scene, with the extremes of opacity, sets of one value and sets of many.
pub fn mixed_sets(kernel: Kernel) -> Vec<Scene> {
    if kernel != Kernel::default() {
        return Vec::new();
    }
    let mut random = Random::new(23);
    let mut sets: Vec<_> = kernels().into_iter().map(|kernel| cloud(30).draw(&mut random, kernel)).collect();
    for gas in &mut sets {
        if let Attribute::Each(opacity) = &mut gas.opacity {
            opacity[3] = 0.0;
            opacity[17] = 0.999_999;
            opacity[18] = 1e-6;
        }
    }
    let centres: Vec<_> = (0..20).map(|_| random.point([-2.0; 3], [2.0; 3])).collect();
    sets.insert(2, set(Kernel::Poly, &centres, 0.3, 0.999_999));
    sets.insert(4, set(Kernel::Linear, &centres[..1], 0.7, 0.0));
    sets.push(set(Kernel::Gaussian, &[], 0.3, 0.5));
    vec![scene(camera(CORNER, MIDDLE, 45.0, [130, 97]), rig(0.1, Some(3.0)), sets)]
}

/// Particles around the eyes, across the near plane and larger than their distance, seen with a wide angle.
pub fn inside(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-2.0; 3], high: [2.0; 3], radius: [0.1, 0.9], opacity: [0.0, 0.6], ..cloud(130) }
        .draw(&mut Random::new(24), kernel);
    let camera = Camera { near: 0.05, ..camera([0.0; 3], [1.0, 0.2, -1.0], 120.0, [96, 72]) };
    vec![scene(camera, rig(0.065, Some(1.0)), vec![gas])]
}

/// All within reach of the eye, each ball holding it.
pub fn surrounded(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-0.5; 3], high: [0.5; 3], radius: [0.9, 3.0], opacity: [0.0, 0.5], ..cloud(40) }
        .draw(&mut Random::new(25), kernel);
    let camera = Camera { near: 0.01, ..camera([0.0; 3], [0.0, 0.0, -1.0], 60.0, [65, 49]) };
    vec![scene(camera, rig(0.065, Some(2.0)), vec![gas])]
}

pub fn looking_away(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-3.0, -3.0, 2.0], high: [3.0, 3.0, 6.6], radius: [0.2, 1.5], ..cloud(60) }
        .draw(&mut Random::new(26), kernel);
    vec![
        scene(camera([0.0, 0.0, 6.0], [0.0, 0.0, 12.0], 50.0, [64, 48]), rig(0.2, Some(4.0)), vec![gas.clone()]),
        scene(camera([0.0, 0.0, 9.0], [0.0, 0.0, 12.0], 50.0, [64, 48]), None, vec![gas]),
    ]
}

/// Large interocular distance and particles far off the optical axis.
pub fn wide_angle(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-9.0, -6.0, -5.0], high: [9.0, 6.0, 0.0], radius: [0.3, 1.6], ..cloud(140) }
        .draw(&mut Random::new(27), kernel);
    vec![scene(camera([0.0, 0.0, 2.5], [0.3, 0.0, 0.0], 120.0, [97, 71]), rig(0.8, Some(2.0)), vec![gas])]
}

pub fn at_the_near_plane(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-2.0, -2.0, -2.0], high: [2.0, 2.0, 1.0], radius: [0.2, 1.5], ..cloud(90) }
        .draw(&mut Random::new(28), kernel);
    let camera = Camera { near: 1.0, ..camera([0.0, 0.0, 1.0], [0.0, 0.2, -3.0], 80.0, [80, 60]) };
    vec![scene(camera, rig(0.1, None), vec![gas])]
}

/// Radii from a thirtieth of a pixel to one pixel.
pub fn subpixel(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { radius: [0.003, 0.09], opacity: [0.2, 0.99], ..cloud(600) }.draw(&mut Random::new(29), kernel);
    vec![scene(camera([0.0, 0.0, 8.0], [0.0; 3], 40.0, [65, 67]), rig(0.1, Some(8.0)), vec![gas])]
}

/// Particles with the same centre and others mirrored about the axis: exactly equal depths and distances, in two sets.
pub fn ties(kernel: Kernel) -> Vec<Scene> {
    let mut random = Random::new(30);
    let mut paint = |centres: &[[f64; 3]], radius, opacity| {
        let color = centres.iter().map(|_| random.color(1.0)).collect();
        ParticleSet { color: Attribute::Each(color), ..set(kernel.clone(), centres, radius, opacity) }
    };
    // Few bits, so that squares and differences are exact.
    let mut grid = Random::new(31);
    let mut step = |low: f64, high: f64| (grid.uniform(low, high) * 64.0).round() / 64.0;
    let mut centres = Vec::new();
    for _ in 0..12 {
        let (x, y, z) = (step(0.1, 0.9), step(0.1, 0.9), step(-2.0, 2.0));
        centres.extend([[x, y, z], [-x, y, z], [x, -y, z], [-x, -y, z], [x, y, z], [x, y, z]]);
    }
    let (one, two) = (paint(&centres, 0.75, 0.7), paint(&centres, 0.75, 0.6));
    let camera = Camera { up: DVec3::Y, ..camera([0.0, 0.0, 5.0], [0.0; 3], 40.0, [64, 48]) };
    vec![scene(camera, None, vec![one, two])]
}

pub fn odd_sizes(kernel: Kernel) -> Vec<Scene> {
    let gas = cloud(60).draw(&mut Random::new(32), kernel);
    [[1, 1], [7, 5], [2, 65], [33, 1], [16, 16], [31, 33], [129, 3]]
        .map(|size| scene(camera(CORNER, MIDDLE, 45.0, size), rig(0.3, Some(5.0)), vec![gas.clone()]))
        .to_vec()
}

pub fn toe_in(kernel: Kernel) -> Vec<Scene> {
    let gas = cloud(120).draw(&mut Random::new(33), kernel);
    let stereo = Stereo { interocular: 0.8, convergence: Some(5.0), mode: StereoMode::ToeIn };
    vec![scene(camera(CORNER, MIDDLE, 50.0, [96, 72]), Some(stereo), vec![gas])]
}

/// Opaque enough that rays end early; colours above 1.
pub fn dense(kernel: Kernel) -> Vec<Scene> {
    let gas =
        Gas { radius: [0.3, 0.9], opacity: [0.5, 0.999], bright: 2.0, ..cloud(400) }.draw(&mut Random::new(34), kernel);
    let dense = scene(camera(CORNER, MIDDLE, 45.0, [80, 60]), rig(0.2, Some(6.0)), vec![gas]);
    vec![Scene { background: [1.5, 0.0, 0.7], ..dense }]
}

/// Coordinates a hundred thousand times the size of the cloud.
pub fn far_from_the_origin(kernel: Kernel) -> Vec<Scene> {
    let shift = [3.0e5, -1.0e5, 2.0e5];
    let add = |p: [f64; 3]| [p[0] + shift[0], p[1] + shift[1], p[2] + shift[2]];
    let base = cloud(100);
    let gas = Gas { low: add(base.low), high: add(base.high), ..base }.draw(&mut Random::new(35), kernel);
    vec![scene(camera(add(CORNER), add(MIDDLE), 45.0, [64, 48]), rig(0.3, Some(5.0)), vec![gas])]
}

/// A profile that is densest away from its centre: its footprint exceeds 1, and an opacity stops at 1.
pub fn hollow(kernel: Kernel) -> Vec<Scene> {
    if kernel != Kernel::default() {
        return Vec::new();
    }
    let shell = Kernel::table(vec![0.0, 0.6, 0.8, 1.0], vec![0.1, 0.1, 1.0, 0.0]).unwrap();
    let gas = Gas { opacity: [0.0, 0.999], ..cloud(90) }.draw(&mut Random::new(36), shell);
    vec![scene(camera(CORNER, MIDDLE, 45.0, [96, 72]), rig(0.3, Some(5.0)), vec![gas])]
}

/// A profile with a jump, below which the footprint has a vertical tangent.
pub fn stepped_profile(kernel: Kernel) -> Vec<Scene> {
    if kernel != Kernel::default() {
        return Vec::new();
    }
    let step = Kernel::table(vec![0.0, 0.5, 0.500_001, 1.0], vec![1.0, 1.0, 0.2, 0.2]).unwrap();
    let gas = Gas { opacity: [0.0, 0.999], ..cloud(90) }.draw(&mut Random::new(39), step);
    vec![scene(camera(CORNER, MIDDLE, 45.0, [96, 72]), rig(0.3, Some(5.0)), vec![gas])]
}

/// Half a degree wide, from far away.
pub fn telescope(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-1.5, -1.0, -50.0], high: [1.5, 1.0, 50.0], radius: [0.02, 0.3], ..cloud(150) }
        .draw(&mut Random::new(40), kernel);
    vec![scene(camera([60.0, 40.0, 200.0], [0.0; 3], 0.5, [64, 48]), rig(2.0, Some(200.0)), vec![gas])]
}

/// Almost half the world in one picture.
pub fn widest_angle(kernel: Kernel) -> Vec<Scene> {
    let gas = Gas { low: [-6.0, -6.0, -3.0], high: [6.0, 6.0, 0.0], radius: [0.1, 1.0], ..cloud(150) }
        .draw(&mut Random::new(41), kernel);
    vec![scene(camera([0.0, 0.0, 0.5], [0.0, 0.1, -1.0], 165.0, [64, 48]), rig(0.2, Some(1.0)), vec![gas])]
}

/// More particles than are prepared at once, so that pictures are kept half done; thin and thick, one colour and many.
pub fn thousands(kernel: Kernel) -> Vec<Scene> {
    if !matches!(kernel, Kernel::Gaussian | Kernel::Linear) {
        return Vec::new();
    }
    let mut random = Random::new(42);
    let mut scenes = Vec::new();
    for (count, radius, opacity) in [(45_000, [0.005, 0.03], [0.0, 0.3]), (20_000, [0.1, 0.5], [0.5, 0.99])] {
        let many = Gas { radius, opacity, ..cloud(count) }.draw(&mut random, kernel.clone());
        let one = ParticleSet { color: Attribute::Uniform([0.9, 0.8, 0.3]), ..many.clone() };
        scenes.extend([many, one].map(|gas| scene(camera(CORNER, MIDDLE, 45.0, [67, 5]), None, vec![gas])));
    }
    scenes
}

/// Gas of one colour that hides what is behind it in the middle of the picture alone, and surfaces within it.
pub fn opaque_in_the_middle(kernel: Kernel) -> Vec<Scene> {
    let mut random = Random::new(43);
    let thick =
        Gas { low: [-0.7, -0.6, -2.0], high: [0.7, 0.6, 2.0], radius: [0.3, 0.9], opacity: [0.3, 0.9], ..cloud(500) };
    let thin = Gas { radius: [0.2, 0.9], opacity: [0.0, 0.2], ..cloud(60) };
    let gas = [thick, thin]
        .map(|gas| ParticleSet { color: Attribute::Uniform([0.9, 0.6, 0.3]), ..gas.draw(&mut random, kernel.clone()) });
    let base = scene(camera(CORNER, MIDDLE, 45.0, [96, 72]), rig(0.3, Some(5.0)), gas.to_vec());
    vec![Scene { meshes: vec![crate_mesh([0.3, 0.2, 1.4], 0.7)], ..base.clone() }, base]
}

/// A box turned about two axes, each side in its own colour.
pub fn crate_mesh(centre: [f64; 3], half: f64) -> Mesh {
    let turn = DMat3::from_rotation_y(0.5) * DMat3::from_rotation_x(0.3);
    let at = |bit: u32, axis: u32| if bit >> axis & 1 == 1 { half } else { -half };
    let positions =
        (0..8).map(|bit| DVec3::from(centre) + turn * DVec3::new(at(bit, 0), at(bit, 1), at(bit, 2))).collect();
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let paint = |i: usize| [0.9 - 0.1 * i as f32, 0.2 + 0.1 * i as f32, 0.5];
    Mesh {
        name: "crate".to_owned(),
        positions,
        corners: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        triangle_materials: (0..12).map(|i| i / 2).collect(),
        materials: (0..6).map(|i| Material { color: paint(i), texture: None, unlit: i == 5 }).collect(),
        ..Mesh::default()
    }
}

/// A large triangle with vertex normals and vertex colours, part of it behind the near plane.
fn sail_mesh() -> Mesh {
    let corners = [[-2.5, -1.2, 5.95], [1.5, -1.6, -3.0], [-0.5, 2.2, -1.0]];
    Mesh {
        name: "sail".to_owned(),
        positions: corners.map(DVec3::from).to_vec(),
        normals: [[0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0]].map(DVec3::from).to_vec(),
        colors: vec![[1.0, 0.2, 0.1], [0.1, 1.0, 0.3], [0.2, 0.3, 1.0]],
        corners: vec![[0, 2, 1]],
        triangle_materials: vec![0],
        materials: vec![Material { color: [0.9, 0.8, 1.0], texture: None, unlit: false }],
        ..Mesh::default()
    }
}

/// Opaque surfaces that cut through the gas, for each eye.
pub fn meshes_in_gas(kernel: Kernel) -> Vec<Scene> {
    let gas = cloud(110).draw(&mut Random::new(37), kernel);
    let base = scene(camera(CORNER, MIDDLE, 45.0, [96, 72]), rig(0.3, Some(5.0)), vec![gas]);
    vec![Scene { meshes: vec![crate_mesh([0.3, 0.2, 0.4], 0.7), sail_mesh()], ..base }]
}

pub fn meshes_seen_toed_in_and_supersampled(kernel: Kernel) -> Vec<Scene> {
    let gas = cloud(60).draw(&mut Random::new(38), kernel);
    let mut scene = scene(camera(CORNER, MIDDLE, 45.0, [35, 27]), rig(0.4, Some(5.0)), vec![gas]);
    scene.meshes = vec![crate_mesh([0.3, 0.2, 0.4], 0.7)];
    scene.camera.samples = 3;
    let mut toed = scene.clone();
    toed.camera.samples = 2;
    if let Some(stereo) = &mut toed.stereo {
        stereo.mode = StereoMode::ToeIn;
    }
    vec![scene, toed]
}

/// Nothing at all, and surfaces without gas.
pub fn without_gas(kernel: Kernel) -> Vec<Scene> {
    let empty = scene(camera(CORNER, MIDDLE, 45.0, [20, 15]), rig(0.3, None), Vec::new());
    let solid = Scene { meshes: vec![crate_mesh([0.0; 3], 1.0)], ..empty.clone() };
    let none = Scene { particles: vec![set(kernel, &[], 1.0, 0.5)], stereo: None, ..solid.clone() };
    vec![empty, solid, none]
}

// ---- Agreement

/// The true pictures of every view of a scene, for one method and opacity model.
pub fn truths(scene: &Scene, way: Way, linear: bool, eyes: &[(Pinhole, Option<Opaque>)]) -> Vec<truth::Picture> {
    eyes.iter().map(|(eye, opaque)| truth::render(scene, way, linear, eye, opaque.as_ref())).collect()
}

pub fn eyes(scene: &Scene) -> Vec<(Pinhole, Option<Opaque>)> {
    let pinholes = truth::eye_offsets(scene).into_iter().map(|offset| Pinhole::new(scene, offset));
    pinholes.map(|eye| (eye.clone(), truth::cast(scene, &eye))).collect()
}

pub fn films(scene: &Scene, settings: &Settings) -> Vec<Film> {
    draw(scene, settings, &()).unwrap().films
}

pub fn compare(films: &[Film], truths: &[truth::Picture], limit: f64) -> Difference {
    assert_eq!(films.len(), truths.len(), "one film per view");
    let mut difference = Difference::default();
    for (index, (film, truth)) in films.iter().zip(truths).enumerate() {
        assert_eq!(film.size.map(|n| n as usize), truth.size);
        difference.add(index, film, &truth.planes, &truth.fragile, limit);
    }
    difference
}

/// Depths of opaque surfaces: present with meshes alone, and right to single precision.
fn check_depths(films: &[Film], truths: &[truth::Picture]) -> Result<(), String> {
    for (film, truth) in films.iter().zip(truths) {
        match (&film.depth, &truth.depth) {
            (None, None) => {}
            (Some(film), Some(depth)) => {
                for (i, (a, b)) in film.iter().zip(depth).enumerate() {
                    let close = f64::from(*a) == *b || (f64::from(*a) - b).abs() <= 2e-7 * b;
                    if !close && !truth.fragile[i] {
                        return Err(format!("depth {a} for {b} at pixel {i}"));
                    }
                }
            }
            (film, _) => return Err(format!("depth is present: {}", film.is_some())),
        }
    }
    Ok(())
}

/// Renders the scenes with every method, kernel, opacity model, tolerance and level, and holds them against the truth.
fn agree(name: &str, build: fn(Kernel) -> Vec<Scene>) {
    let mut failures = Vec::new();
    let (mut worst, mut over, mut fragile, mut pixels) = (0.0f64, 0, 0, 0);
    for (kernel, (number, scene)) in kernels().into_iter().flat_map(|kernel| {
        let scenes = build(kernel.clone()).into_iter().enumerate();
        scenes.map(move |scene| (kernel.clone(), scene))
    }) {
        let eyes = eyes(&scene);
        for (method, way) in METHODS {
            for opacity_model in [OpacityModel::Exponential, OpacityModel::Linear] {
                if repeats(method, &kernel, opacity_model) {
                    continue;
                }
                let truths = truths(&scene, way, opacity_model == OpacityModel::Linear, &eyes);
                for level in Level::available() {
                    for tolerance in [0.0, DEFAULT_TOLERANCE] {
                        let settings = Settings {
                            method,
                            opacity_model,
                            tolerance,
                            threads: Some(1),
                            simd: Some(level),
                            ..Settings::default()
                        };
                        let films = films(&scene, &settings);
                        let difference = compare(&films, &truths, PRECISION + tolerance);
                        // Without savings 1 sound pixel in 10 000 may be over the limit; the tolerance is a promise for all.
                        let verdict = difference.verdict(if tolerance == 0.0 { 10_000 } else { usize::MAX });
                        let verdict = verdict.and_then(|()| check_depths(&films, &truths));
                        if let Err(what) = verdict {
                            let kernel = kernel.name();
                            failures.push(format!("{kernel} scene {number} {settings:?}: {what}"));
                        }
                        if tolerance == 0.0 {
                            worst = worst.max(difference.max);
                            over += difference.over - difference.over_fragile;
                            fragile += difference.over_fragile;
                            pixels += difference.pixels;
                        }
                    }
                }
            }
        }
    }
    println!("{name}: max {worst:.2e}, over the limit {over} and {fragile} fragile, of {pixels} pixels");
    let count = failures.len();
    failures.truncate(4);
    assert!(failures.is_empty(), "{name}: {count} failures, of which\n{}", failures.join("\n"));
}

macro_rules! agree {
    ($($scene:ident)*) => {
        /// One test per family of scenes.
        mod agrees {
            $(#[test]
            fn $scene() {
                super::agree(stringify!($scene), super::$scene);
            })*
        }
    };
}

agree! {
    many_colours one_colour mixed_sets inside surrounded looking_away wide_angle at_the_near_plane subpixel ties odd_sizes
    toe_in dense opaque_in_the_middle far_from_the_origin hollow stepped_profile telescope widest_angle thousands meshes_in_gas
    meshes_seen_toed_in_and_supersampled without_gas
}

// ---- Beyond agreement

/// The bits of all planes.
pub fn bits(films: &[Film]) -> Vec<u32> {
    let planes = |film: &Film| {
        let planes = film.color.iter().chain([&film.transmittance]).chain(&film.depth);
        planes.flat_map(|plane| plane.iter().map(|value| value.to_bits())).collect::<Vec<_>>()
    };
    films.iter().flat_map(planes).collect()
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let mut scenes = mixed_sets(Kernel::default());
    scenes.extend(meshes_in_gas(Kernel::Poly));
    scenes.extend(dense(Kernel::Gaussian));
    scenes.extend(odd_sizes(Kernel::Constant));
    for scene in &scenes {
        for (method, _) in METHODS {
            for level in Level::available() {
                for tolerance in [0.0, DEFAULT_TOLERANCE] {
                    let settings = Settings { method, tolerance, simd: Some(level), ..Settings::default() };
                    let with = |threads| bits(&films(scene, &Settings { threads, ..settings.clone() }));
                    let one = with(Some(1));
                    for threads in [Some(1), Some(2), Some(3), Some(8), None] {
                        assert!(with(threads) == one, "{settings:?} with {threads:?} threads");
                    }
                }
            }
        }
    }
}

/// What a tolerance saves may never cost more than the tolerance, at any pixel, in colour and in transmittance.
#[test]
fn tolerances_are_kept_at_every_pixel() {
    let mut scenes = dense(Kernel::Gaussian);
    scenes.extend(dense(Kernel::Constant));
    let mut one = scenes[0].clone();
    one.particles[0].color = Attribute::Uniform([1.8, 0.1, 0.9]);
    let mut walled = scenes[0].clone();
    walled.meshes = vec![crate_mesh([0.3, 0.2, 0.4], 0.7), sail_mesh()];
    scenes.extend([one, walled]);
    for scene in &scenes {
        let eyes = eyes(scene);
        for (method, way) in METHODS {
            for opacity_model in [OpacityModel::Exponential, OpacityModel::Linear] {
                let truths = truths(scene, way, opacity_model == OpacityModel::Linear, &eyes);
                for level in Level::available() {
                    for tolerance in [1e-4, 0.01, 0.1, 0.5] {
                        let simd = Some(level);
                        let settings = Settings { method, opacity_model, tolerance, simd, ..Settings::default() };
                        let limit = PRECISION + tolerance;
                        let difference = compare(&films(scene, &settings), &truths, limit);
                        assert_eq!(difference.over - difference.over_fragile, 0, "{settings:?}: {difference:?}");
                    }
                }
            }
        }
    }
}

/// Progress grows to the whole and never beyond, and does not change the picture.
#[test]
fn progress_is_told() {
    struct Heard(Mutex<Vec<f64>>);
    impl Progress for Heard {
        fn update(&self, done: u64, total: u64) {
            assert!(done <= total && total > 0, "{done} of {total}");
            self.0.lock().unwrap().push(done as f64 / total as f64);
        }
    }
    let mut scenes = thousands(Kernel::Gaussian);
    scenes.extend(many_colours(Kernel::Poly));
    let sheet = Method::Sheet(sheet::Parameters::default());
    for scene in &scenes {
        for method in METHODS.map(|(method, _)| method).into_iter().chain([sheet]) {
            let settings = Settings { method, ..Settings::default() };
            let heard = Heard(Mutex::default());
            let rendering = draw(scene, &settings, &heard).unwrap();
            assert!(bits(&rendering.films) == bits(&films(scene, &settings)));
            let heard = heard.0.into_inner().unwrap();
            assert!(heard.is_sorted() && heard.last() == Some(&1.0), "{heard:?}");
        }
    }
}

/// The comparison would notice if the eyes were swapped, the method another, or the opacity model the other.
#[test]
fn the_comparison_tells_eyes_methods_and_models_apart() {
    let scene = many_colours(Kernel::Gaussian).remove(0);
    let eyes = eyes(&scene);
    for (method, way) in METHODS {
        let settings = Settings { method, tolerance: 0.0, ..Settings::default() };
        let mut films = films(&scene, &settings);
        for (other, other_way) in METHODS {
            let verdict = compare(&films, &truths(&scene, other_way, false, &eyes), PRECISION).verdict(10_000);
            assert_eq!(verdict.is_ok(), method == other, "{method:?} against {other:?}: {verdict:?}");
        }
        let linear = compare(&films, &truths(&scene, way, true, &eyes), PRECISION).verdict(10_000);
        assert_eq!(linear.is_err(), method.has_opacity_model(), "{method:?}");
        films.swap(0, 1);
        let swapped = compare(&films, &truths(&scene, way, false, &eyes), PRECISION);
        assert!(swapped.gross > 1000, "{swapped:?}");
    }
}

/// Identity: gas of one colour over a background shows colour (1 - T) + T background.
#[test]
fn one_colour_gives_the_colour_times_one_minus_the_transmittance() {
    let scene = one_colour(Kernel::Gaussian).remove(0);
    let Attribute::Uniform(color) = scene.particles[0].color else { unreachable!() };
    for (method, _) in METHODS {
        for film in films(&scene, &Settings { method, tolerance: 0.0, ..Settings::default() }) {
            for (channel, plane) in film.color.iter().enumerate() {
                for (light, through) in plane.iter().zip(&film.transmittance) {
                    let law = color[channel] * (1.0 - through) + through * scene.background[channel];
                    assert!((light - law).abs() < 1e-4, "{method:?}: {light} for {law}");
                }
            }
        }
    }
}

#[test]
fn levels_are_available_narrowest_first() {
    let levels = Level::available();
    assert_eq!(levels[0], Level::Portable);
    assert!(levels.is_sorted() && levels.len() <= 4);
}

#[test]
fn what_lies_behind_opaque_gas_is_never_prepared_whatever_the_size() {
    // A wall of gas that is opaque after a few layers, and many times as many particles behind it.
    let mut random = Random::new(41);
    let centres: Vec<_> = (0..60_000).map(|_| random.point([-6.0, -3.0, -9.0], [6.0, 3.0, -3.0])).collect();
    let gas = ParticleSet { color: Attribute::Uniform([0.5; 3]), ..set(Kernel::Gaussian, &centres, 1.0, 0.9) };
    for size in [[64, 64], [70, 70], [100, 33]] {
        let camera = camera([0.0; 3], [0.0, 0.0, -1.0], 40.0, size);
        let scene = scene(camera, rig(0.06, Some(5.0)), vec![gas.clone()]);
        for (method, _) in METHODS {
            let settings = Settings { method, ..Settings::default() };
            let prepared = draw(&scene, &settings, &()).unwrap().statistics.prepared;
            assert!(prepared < 2 * 25_000, "{method:?} at {size:?} prepared {prepared}");
        }
    }
}

/// A faint ball far away has the same square with each method; where the square is all of it, nothing can be spared.
#[test]
fn the_corners_around_a_ball_are_spared() {
    let centres: Vec<_> = (0..16).map(|i| [0.02 * f64::from(i), 0.01 * f64::from(i), 0.0]).collect();
    let balls = set(Kernel::Gaussian, &centres, 0.8, 0.01);
    let scene = scene(camera([0.0, 0.0, 20.0], [0.0; 3], 8.0, [320, 240]), None, vec![balls]);
    for simd in Level::available() {
        let [square, round] = [Method::Viewplane, Method::Perspective].map(|method| {
            let settings = Settings { method, simd: Some(simd), ..Settings::default() };
            draw(&scene, &settings, &()).unwrap().statistics.fragments
        });
        assert!(10 * round < 9 * square, "{simd}: {round} fragments, {square} of squares");
    }
}

#[test]
fn a_session_draws_every_frame_as_if_it_were_the_first() {
    let mut session = Session::new(&Settings::default()).unwrap();
    let kernel = || Kernel::Gaussian;
    let mut frames =
        [one_colour(kernel()), many_colours(kernel()), thousands(kernel()), meshes_in_gas(kernel())].concat();
    frames.extend(meshes_seen_toed_in_and_supersampled(kernel()));
    frames.extend(frames.clone().into_iter().rev());
    for scene in &frames {
        let rendering = session.draw(scene, &()).unwrap();
        assert!(bits(&rendering.films) == bits(&films(scene, &Settings::default())));
        assert_eq!(rendering.films[0].depth.is_some(), !scene.meshes.is_empty());
        session.recycle(rendering);
    }
}

/// Two eyes that share what they can, lists of wide balls and those of small ones, see what each of them sees by itself: to the bit where
/// nothing is left out, within the tolerance where it is. Some balls are seen by one eye alone.
#[test]
fn a_pair_is_what_each_eye_sees_alone() {
    // So that lists are in common but for small balls.
    let distance = 0.15;
    for (radius, count) in [([0.3, 0.9], 150), ([0.02, 0.05], 900), ([0.02, 0.9], 300), ([0.2, 0.4], 20_000)] {
        for colors in [1, 3] {
            let gas = Gas { count, low: [-3.0, -2.0, -1.0], high: [3.0, 2.0, 2.0], radius, ..cloud(count) };
            let mut particles = gas.draw(&mut Random::new(31), Kernel::Gaussian);
            if colors == 1 {
                particles.color = Attribute::Uniform([0.7, 0.6, 0.2]);
            }
            let camera = Camera { up: DVec3::Y, ..camera([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], 50.0, [331, 203]) };
            let pair = scene(camera, rig(distance, None), vec![particles]);
            for (method, _) in METHODS {
                for tolerance in [0.0, DEFAULT_TOLERANCE] {
                    let settings = Settings { method, tolerance, ..Settings::default() };
                    let films_of_pair = films(&pair, &settings);
                    for (film, side) in films_of_pair.iter().zip([-0.5, 0.5]) {
                        let mut one = Scene { stereo: None, ..pair.clone() };
                        one.camera.position.x += side * distance;
                        one.camera.look_at.x += side * distance;
                        let alone = films(&one, &settings);
                        if tolerance == 0.0 {
                            assert!(
                                bits(std::slice::from_ref(film)) == bits(&alone),
                                "{method:?}, {radius:?}, {colors}"
                            );
                        } else {
                            let off = difference(film, &alone[0]);
                            assert!(off <= 2.0 * tolerance, "{method:?}, {radius:?}, {colors}: {off}");
                        }
                    }
                }
            }
        }
    }
}

/// Balls of 10 to 35 pixels before the left two thirds of a picture, thin ones everywhere; of one colour.
fn half_opaque(kernel: &Kernel) -> Scene {
    let share = |i: usize, step: f64| (i as f64 * step).fract();
    let gas = |count: usize, width: f64, opacity: f64| ParticleSet {
        x: (0..count).map(|i| width * share(i, 0.618_034) - 1.7).collect(),
        y: (0..count).map(|i| 2.4 * share(i, 0.754_878) - 1.2).collect(),
        z: (0..count).map(|i| -2.0 - share(i, 0.569_840)).collect(),
        radius: Attribute::Each((0..count).map(|i| 0.25 + 0.3 * share(i, 0.4142)).collect()),
        opacity: Attribute::Uniform(opacity),
        color: Attribute::Uniform([0.8, 0.9, 0.4]),
        ..set(kernel.clone(), &[], 1.0, 0.0)
    };
    let eye = Camera { up: DVec3::Y, ..camera([0.0; 3], [0.0, 0.0, -1.0], 57.3, [200, 140]) };
    scene(eye, None, vec![gas(2000, 2.2, 0.5), gas(60, 3.4, 0.05)])
}

/// The middles of balls come first where one colour is opaque. Where a pixel is not opaque every fragment is drawn once all the same;
/// where it is, the picture is off by no more than the tolerance; and that takes fewer fragments than balls in their order do.
#[test]
fn middles_and_the_rest_are_whole() {
    let tolerance = DEFAULT_TOLERANCE;
    for kernel in [Kernel::Gaussian, Kernel::Poly] {
        let scene = half_opaque(&kernel);
        let mut ordered = scene.clone();
        // The last one alone has another colour.
        let colors = (0..60).map(|i| [0.8, 0.9, if i < 59 { 0.4 } else { 0.5 }]).collect();
        ordered.particles[1].color = Attribute::Each(colors);
        for method in [Method::Viewplane, Method::Viewpoint, Method::Perspective] {
            for opacity_model in [OpacityModel::Exponential, OpacityModel::Linear] {
                for level in Level::available() {
                    let drawn = |scene: &Scene, tolerance: f64| {
                        let (simd, threads) = (Some(level), Some(1));
                        let settings =
                            Settings { method, opacity_model, tolerance, simd, threads, ..Settings::default() };
                        draw(scene, &settings, &()).unwrap()
                    };
                    let (all, saved) = (drawn(&scene, 0.0), drawn(&scene, tolerance));
                    let case = format!("{} {method:?} {opacity_model:?} {level}", kernel.name());
                    let (mut opaque, mut clear) = (0, 0);
                    let through = saved.films[0].transmittance.iter().zip(&all.films[0].transmittance);
                    for (pixel, (&got, &want)) in through.enumerate() {
                        let off = f64::from(got - want).abs();
                        let is_opaque = f64::from(want) <= tolerance;
                        *(if is_opaque { &mut opaque } else { &mut clear }) += 1;
                        let most = if is_opaque { tolerance } else { 2e-5 };
                        assert!(off <= most, "{case}: {got} for {want} at pixel {pixel}");
                    }
                    assert!(opaque > 10_000 && clear > 5_000, "{case}: {opaque} opaque, {clear} clear");
                    let [few, many] = [&saved, &drawn(&ordered, tolerance)].map(|drawn| drawn.statistics.fragments);
                    // Wide blocks spare less.
                    assert!(5 * few < 4 * many, "{case}: {few} fragments, {many} in order");
                }
            }
        }
    }
}

/// Parsecs or nanometres: a scene a thousand trillion times as large or as small looks the same.
#[test]
fn pictures_do_not_depend_on_the_unit() {
    for kernel in [Kernel::Gaussian, Kernel::Poly] {
        let one = &many_colours(kernel)[0];
        for (method, _) in &METHODS[..3] {
            let settings = Settings { method: *method, ..Settings::default() };
            let want = films(one, &settings);
            for factor in [1e-22, 1e-15, 1e15, 1e22] {
                let mut scene = one.clone();
                let ParticleSet { x, y, z, radius: Attribute::Each(radii), .. } = &mut scene.particles[0] else {
                    panic!("radii differ")
                };
                for values in [x, y, z, radii] {
                    values.iter_mut().for_each(|value| *value *= factor);
                }
                scene.camera.position *= factor;
                scene.camera.look_at *= factor;
                scene.camera.near *= factor;
                scene.stereo = rig(0.3 * factor, Some(5.0 * factor));
                for (got, want) in films(&scene, &settings).iter().zip(&want) {
                    let off = difference(got, want);
                    assert!(off < 1e-5, "{method:?}, {factor:e}: {off:e}");
                }
            }
        }
    }
}
