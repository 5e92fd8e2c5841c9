//! Method `slab` against ray-by-ray truth in f64: closed forms of the transmittance, Gauss-Legendre quadrature of the light,
//! and the method's own sums written out again from [`Kernel::segment`].

use crate::harness::{Gas, Random, kernels, set};
use glam::{DMat3, DVec3};
use std::sync::Mutex;
use stereomist::picture::Film;
use stereomist::render::cpu::simd::Level;
use stereomist::render::method::slab::Parameters;
use stereomist::render::opaque::{self, OpaqueLayer};
use stereomist::render::{Method, Settings, draw};
use stereomist::scene::mesh::Material;
use stereomist::scene::{Attribute, Camera, Kernel, Mesh, ParticleSet, Rgb, Scene, Stereo, StereoMode, View};

// ---- Truth

/// The gas of a particle on a ray: distances are along the ray, from the eye.
struct Chord<'a> {
    kernel: &'a Kernel,
    color: Rgb,
    radius: f64,
    /// Distance of the ray from the centre, in radii.
    b: f64,
    middle: f64,
    /// Optical depth per integral of the kernel over u.
    amplitude: f64,
    /// Where it begins and ends, clipped by the near plane and the wall.
    ends: [f64; 2],
}

/// A ray: what it meets, between which distances, and what is behind.
struct Ray<'a> {
    chords: Vec<Chord<'a>>,
    /// Distance per depth.
    length: f64,
    behind: [f64; 3],
    /// Whether it passes a ball so close to the rim that the root of a chord is no better than single precision's root.
    grazing: bool,
    solid: bool,
}

impl Chord<'_> {
    /// Optical depth between two distances.
    fn depth(&self, from: f64, to: f64) -> f64 {
        let (from, to) = (from.max(self.ends[0]), to.min(self.ends[1]));
        if from >= to {
            return 0.0;
        }
        let u = |t: f64| (t - self.middle) / self.radius;
        self.amplitude * self.kernel.segment(self.b, u(from), u(to))
    }

    /// Extinction at a distance.
    fn extinction(&self, t: f64) -> f64 {
        if t < self.ends[0] || t > self.ends[1] {
            return 0.0;
        }
        self.amplitude / self.radius * self.kernel.density(self.b.hypot((t - self.middle) / self.radius))
    }
}

impl<'a> Ray<'a> {
    fn new(scene: &'a Scene, view: &View, layer: Option<&OpaqueLayer>, [x, y]: [usize; 2]) -> Self {
        let direction = view.direction(x as f64 + 0.5, y as f64 + 0.5);
        let length = direction.length();
        let toward = direction / length;
        let pixel = y * view.size[0] as usize + x;
        let wall = layer.map_or(f64::INFINITY, |layer| layer.depth[pixel]);
        let solid = wall.is_finite();
        let behind = if solid { layer.unwrap().color[pixel] } else { scene.background }.map(f64::from);
        let mut ray = Ray { chords: Vec::new(), length, behind, grazing: false, solid };
        for set in &scene.particles {
            for i in 0..set.len() {
                let centre = view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i]));
                let radius = set.radius.get(i);
                let b = centre.cross(toward).length() / radius;
                ray.grazing |= (b - 1.0).abs() < 1e-3;
                if b >= 1.0 {
                    continue;
                }
                let (middle, half) = (centre.dot(toward), radius * (1.0 - b * b).sqrt());
                let ends = [(middle - half).max(view.near * length), (middle + half).min(wall * length)];
                let amplitude = -(-set.opacity.get(i)).ln_1p() / set.kernel.chord(0.0);
                if ends[0] < ends[1] && amplitude > 0.0 {
                    let color = set.color.get(i);
                    ray.chords.push(Chord { kernel: &set.kernel, color, radius, b, middle, amplitude, ends });
                }
            }
        }
        ray
    }

    fn depth(&self, from: f64, to: f64) -> f64 {
        self.chords.iter().map(|chord| chord.depth(from, to)).sum()
    }

    fn transmittance(&self) -> f64 {
        (-self.depth(0.0, f64::INFINITY)).exp()
    }

    /// Transmittance as a film holds it.
    fn clear(&self) -> f64 {
        if self.solid { 0.0 } else { self.transmittance() }
    }

    /// The light as slabs between planes of depth give it.
    fn slabs(&self, planes: &[f64]) -> [f64; 3] {
        let mut light = [0.0; 3];
        let mut through = 1.0;
        for plane in planes.windows(2) {
            let (mut depth, mut weighted) = (0.0, [0.0; 3]);
            for chord in &self.chords {
                let own = chord.depth(plane[0] * self.length, plane[1] * self.length);
                depth += own;
                for (sum, value) in weighted.iter_mut().zip(chord.color) {
                    *sum += own * f64::from(value);
                }
            }
            if depth > 0.0 {
                let share = through * -(-depth).exp_m1() / depth;
                for (sum, value) in light.iter_mut().zip(weighted) {
                    *sum += share * value;
                }
                through *= (-depth).exp();
            }
        }
        [0, 1, 2].map(|i| light[i] + through * self.behind[i])
    }

    /// The light by the rule of 8 points between all ends of balls, on pieces no longer than a sixth of a radius.
    fn light(&self) -> [f64; 3] {
        const RULE: [(f64, f64); 4] = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
            (0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
        ];
        let mut breaks: Vec<f64> = self.chords.iter().flat_map(|chord| chord.ends).collect();
        // The kink of a cone seen close by.
        breaks.extend(self.chords.iter().map(|chord| chord.middle));
        breaks.sort_by(f64::total_cmp);
        let finest = self.chords.iter().map(|chord| chord.radius).fold(f64::INFINITY, f64::min) / 6.0;
        let mut light = [0.0; 3];
        let mut before = 0.0;
        for pair in breaks.windows(2) {
            let count = ((pair[1] - pair[0]) / finest).ceil().max(1.0);
            let half = 0.5 * (pair[1] - pair[0]) / count;
            for piece in 0..count as usize {
                let from = pair[0] + 2.0 * half * piece as f64;
                for (node, weight) in RULE.iter().flat_map(|&(node, weight)| [(-node, weight), (node, weight)]) {
                    let t = from + half * (1.0 + node);
                    let through = (-before - self.depth(from, t)).exp();
                    for chord in &self.chords {
                        let emitted = half * weight * chord.extinction(t) * through;
                        for (sum, value) in light.iter_mut().zip(chord.color) {
                            *sum += emitted * f64::from(value);
                        }
                    }
                }
                before += self.depth(from, from + 2.0 * half);
            }
        }
        let through = self.transmittance();
        [0, 1, 2].map(|i| light[i] + through * self.behind[i])
    }
}

/// The rays of every `stride`-th pixel of every view: picture, pixel, ray.
fn each_ray(scene: &Scene, stride: usize, mut visit: impl FnMut(usize, usize, &Ray)) {
    for (number, view) in scene.views().iter().enumerate() {
        let layer = opaque::draw(scene, view);
        let [width, height] = view.size.map(|n| n as usize);
        for pixel in (0..width * height).step_by(stride) {
            visit(number, pixel, &Ray::new(scene, view, layer.as_ref(), [pixel % width, pixel / width]));
        }
    }
}

/// The method's planes for K slabs: all gas behind the near plane, in equal parts.
fn planes(scene: &Scene, view: &View, count: u32) -> Vec<f64> {
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    for set in &scene.particles {
        for i in (0..set.len()).filter(|&i| set.opacity.get(i) > 0.0) {
            let depth = -view.eye_from_point(DVec3::new(set.x[i], set.y[i], set.z[i])).z;
            let radius = set.radius.get(i);
            if depth + radius > view.near {
                first = first.min((depth - radius).max(view.near));
                last = last.max(depth + radius);
            }
        }
    }
    (0..=count).map(|k| first + (last - first) * f64::from(k) / f64::from(count)).collect()
}

// ---- Pictures

/// K slabs and no early end.
fn settings(slabs: u32, richardson: bool) -> Settings {
    let method = Method::Slab(Parameters { slabs: Some(slabs), richardson });
    Settings { method, tolerance: 0.0, ..Settings::default() }
}

fn films(scene: &Scene, settings: &Settings) -> Vec<Film> {
    draw(scene, settings, &()).unwrap().films
}

fn light(film: &Film, pixel: usize) -> [f64; 3] {
    [0, 1, 2].map(|channel| f64::from(film.color[channel][pixel]))
}

fn furthest(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}

/// Root of the mean square difference from the truth, over channels.
fn rms(film: &[Film], truth: &[(usize, usize, [f64; 3])]) -> f64 {
    let square = |&(view, pixel, truth): &(usize, usize, [f64; 3])| {
        let own = light(&film[view], pixel);
        (0..3).map(|i| (own[i] - truth[i]).powi(2)).sum::<f64>()
    };
    (truth.iter().map(square).sum::<f64>() / (3 * truth.len()) as f64).sqrt()
}

// ---- Scenes

fn camera(position: [f64; 3], look_at: [f64; 3], fov_y_deg: f64, near: f64) -> Camera {
    Camera {
        position: position.into(),
        look_at: look_at.into(),
        up: DVec3::new(0.1, 1.0, 0.05),
        fov_y: fov_y_deg.to_radians(),
        size: [67, 50],
        near,
        samples: 1,
    }
}

fn rig(interocular: f64, convergence: Option<f64>) -> Option<Stereo> {
    Some(Stereo { interocular, convergence, mode: StereoMode::Parallel })
}

fn scene(camera: Camera, stereo: Option<Stereo>, particles: Vec<ParticleSet>) -> Scene {
    Scene { camera, stereo, background: [0.25, 0.4, 0.7], particles, meshes: Vec::new() }
}

/// A turned square, each half in its own colour.
fn wall(centre: [f64; 3], half: f64) -> Mesh {
    let turn = DMat3::from_rotation_y(0.5) * DMat3::from_rotation_x(0.3);
    let corner = |x, y| DVec3::from(centre) + turn * DVec3::new(x, y, 0.0) * half;
    let paint = |color| Material { color, texture: None, unlit: true };
    Mesh {
        name: "wall".to_owned(),
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        corners: vec![[0, 1, 2], [0, 2, 3]],
        triangle_materials: vec![0, 1],
        materials: vec![paint([0.9, 0.2, 0.5]), paint([0.1, 0.6, 0.3])],
        ..Mesh::default()
    }
}

const GAS: Gas = Gas {
    count: 110,
    low: [-2.0, -1.5, -2.0],
    high: [2.0, 1.5, 2.0],
    radius: [0.15, 0.8],
    opacity: [0.0, 0.9],
    bright: 1.0,
};

/// Gas around walls, around the eyes, at the near plane, toed in.
fn places(kernel: &Kernel) -> Vec<Scene> {
    let mut random = Random::new(61);
    let mut gas = |gas: Gas| vec![gas.draw(&mut random, kernel.clone())];
    let mut walls = scene(camera([1.0, 2.0, 6.0], [0.0, 0.3, 0.0], 45.0, 0.1), rig(0.3, Some(5.0)), gas(Gas { ..GAS }));
    walls.meshes = vec![wall([0.3, 0.2, 0.4], 0.8), wall([-0.5, 0.0, -0.6], 1.6)];
    let around = Gas { low: [-2.0; 3], high: [2.0; 3], opacity: [0.0, 0.5], ..GAS };
    let inside = scene(camera([0.0; 3], [1.0, 0.2, -1.0], 110.0, 0.05), rig(0.065, Some(1.0)), gas(around));
    let before = Gas { high: [2.0, 1.5, 1.0], ..GAS };
    let near = scene(camera([0.0, 0.0, 1.0], [0.0, 0.2, -3.0], 80.0, 1.0), None, gas(before));
    let mut toed = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, 0.1), rig(0.8, Some(5.0)), gas(Gas { ..GAS }));
    if let Some(stereo) = &mut toed.stereo {
        stereo.mode = StereoMode::ToeIn;
    }
    vec![walls, inside, near, toed]
}

/// Pictures in which particles are a few pixels wide, and in which they fill many blocks; and how many pixels lie between
/// those that are looked at.
const SIZES: [([u32; 2], usize); 2] = [([67, 50], 7), ([537, 400], 401)];

/// Three colours in a box, all of one radius.
fn three_colours(kernel: &Kernel, size: [u32; 2]) -> Scene {
    let mut random = Random::new(62);
    let paint = [[0.9, 0.2, 0.1], [0.2, 0.8, 0.3], [0.1, 0.3, 0.9]];
    let sets = paint.map(|color| {
        let centres: Vec<_> = (0..25).map(|_| random.point([-1.2, -0.9, -1.5], [1.2, 0.9, 1.5])).collect();
        let opacity = Attribute::Each((0..25).map(|_| random.uniform(0.03, 0.4)).collect());
        ParticleSet { color: Attribute::Uniform(color), opacity, ..set(kernel.clone(), &centres, 0.6, 0.0) }
    });
    scene(Camera { size, ..camera([0.0, 0.0, 4.0], [0.0; 3], 50.0, 0.1) }, None, sets.to_vec())
}

// ---- Agreement

#[test]
fn transmittance_is_the_closed_form_and_light_the_slabs_whatever_their_number() {
    let mut worst = Vec::new();
    for kernel in kernels() {
        let limit = if kernel == Kernel::Constant { 5e-6 } else { 2e-6 };
        for (number, scene) in places(&kernel).iter().enumerate() {
            for slabs in [1, 4, 64] {
                let films = films(scene, &settings(slabs, false));
                let views = scene.views();
                let (mut clear_off, mut light_off) = (0.0f64, 0.0f64);
                each_ray(scene, 1, |view, pixel, ray| {
                    if ray.grazing && kernel == Kernel::Constant {
                        return;
                    }
                    let off = (f64::from(films[view].transmittance[pixel]) - ray.clear()).abs();
                    clear_off = clear_off.max(if off.is_nan() { f64::INFINITY } else { off });
                    if pixel % 13 == 0 {
                        let planes = planes(scene, &views[view], slabs);
                        let off = furthest(light(&films[view], pixel), ray.slabs(&planes));
                        light_off = light_off.max(if off.is_nan() { f64::INFINITY } else { off });
                    }
                });
                worst.push((kernel.name(), number, slabs, clear_off, light_off, limit));
            }
        }
    }
    for (name, scene, slabs, clear, light, limit) in &worst {
        println!("{name} scene {scene} K={slabs}: transmittance {clear:.1e}, light {light:.1e} (limit {limit:.0e})");
    }
    for (name, scene, slabs, clear, light, limit) in worst {
        assert!(clear <= limit, "{name}, scene {scene}, {slabs} slabs: transmittance is off by {clear:e}");
        let shares = shares(name);
        assert!(light <= shares, "{name}, scene {scene}, {slabs} slabs: light is off by {light:e}");
    }
}

/// What planes between slabs, which are computed with fewer digits, may cost.
const SHARES: f64 = 1e-5;

/// The same where slabs may be thick: a Gaussian's shares are less exact then.
fn shares(kernel: &str) -> f64 {
    if kernel == Kernel::Gaussian.name() { 4e-4 } else { SHARES }
}

#[test]
fn large_particles_have_the_closed_form_too() {
    for kernel in kernels() {
        let (size, stride) = SIZES[1];
        let mut scene = three_colours(&kernel, size);
        for many in [false, true] {
            if many {
                let mut random = Random::new(64);
                scene.particles[1].color = Attribute::Each((0..25).map(|_| random.color(1.0)).collect());
            }
            for slabs in [4, 32, 128] {
                let films = films(&scene, &settings(slabs, false));
                let views = scene.views();
                let (mut clear_off, mut light_off) = (0.0f64, 0.0f64);
                each_ray(&scene, stride, |view, pixel, ray| {
                    if !ray.grazing {
                        clear_off = clear_off.max((f64::from(films[view].transmittance[pixel]) - ray.clear()).abs());
                    }
                    let want = ray.slabs(&planes(&scene, &views[view], slabs));
                    light_off = light_off.max(furthest(light(&films[view], pixel), want));
                });
                println!("{} K={slabs}: transmittance {clear_off:.1e}, light {light_off:.1e}", kernel.name());
                assert!(clear_off <= 2e-6, "{}, {slabs} slabs: {clear_off:e}", kernel.name());
                let shares = if slabs < 64 { shares(kernel.name()) } else { SHARES };
                assert!(light_off <= shares, "{}, {slabs} slabs: {light_off:e}", kernel.name());
            }
        }
    }
}

#[test]
fn one_colour_is_the_closed_form_for_one_slab_and_for_any() {
    for kernel in kernels() {
        for mut scene in places(&kernel) {
            let color = [0.86, 0.5, 0.1];
            scene.particles[0].color = Attribute::Uniform(color);
            for slabs in [1, 37] {
                let films = films(&scene, &settings(slabs, false));
                each_ray(&scene, 3, |view, pixel, ray| {
                    let through = ray.transmittance();
                    let want = [0, 1, 2].map(|i| f64::from(color[i]) * (1.0 - through) + through * ray.behind[i]);
                    let off = furthest(light(&films[view], pixel), want);
                    assert!(off <= 5e-6 || ray.grazing, "{}, {slabs} slabs: {off:e}", kernel.name());
                });
            }
        }
    }
}

/// Every so many pixels' light by quadrature.
fn truths(scene: &Scene, stride: usize) -> Vec<(usize, usize, [f64; 3])> {
    let mut truths = Vec::new();
    each_ray(scene, stride, |view, pixel, ray| truths.push((view, pixel, ray.light())));
    truths
}

#[test]
fn colours_converge_with_the_second_order() {
    for kernel in [Kernel::Gaussian, Kernel::Poly, Kernel::Beliaev] {
        for (size, stride) in SIZES {
            let scene = three_colours(&kernel, size);
            let truths = truths(&scene, stride);
            // The gas is 4.2 deep: slabs of 0.7 down to 0.18 of the narrowest standard deviation, 0.15.
            let counts = [40, 80, 160];
            let errors = counts.map(|slabs| rms(&films(&scene, &settings(slabs, false)), &truths));
            println!("{}: {errors:?}", kernel.name());
            let order = (errors[0] / errors[2]).log2() / 2.0;
            assert!((order - 2.0).abs() <= 0.2, "{}: order {order}, errors {errors:?}", kernel.name());
        }
    }
}

#[test]
fn extrapolation_improves_thin_slabs_and_errors_are_estimated() {
    for kernel in [Kernel::Gaussian, Kernel::Poly, Kernel::Beliaev] {
        for (size, stride) in SIZES {
            let scene = three_colours(&kernel, size);
            let truths = truths(&scene, stride);
            let films_of = |richardson| films(&scene, &Settings { error_map: true, ..settings(64, richardson) });
            let (plain, better) = (films_of(false), films_of(true));
            let gain = rms(&plain, &truths) / rms(&better, &truths);
            println!(
                "{}: {:.1e} becomes {:.1e}, gain {gain:.1}",
                kernel.name(),
                rms(&plain, &truths),
                rms(&better, &truths)
            );
            assert!(gain >= 5.0, "{}: {gain}", kernel.name());
            // The estimates, on average: of the mean of the largest error of the channels.
            for (films, factor) in [(&plain, 1.5), (&better, 4.0)] {
                let (mut estimate, mut error) = (0.0, 0.0);
                for &(view, pixel, truth) in &truths {
                    estimate += f64::from(films[view].error.as_ref().unwrap()[pixel]);
                    error += furthest(light(&films[view], pixel), truth);
                }
                let ratio = estimate / error;
                println!("{}: estimate over error {ratio:.2}", kernel.name());
                assert!(ratio > 1.0 / factor && ratio < factor, "{}: {ratio}", kernel.name());
            }
        }
    }
}

#[test]
fn the_extrapolation_is_that_of_the_pictures_of_k_and_half_of_k() {
    for (number, scene) in places(&Kernel::Gaussian).iter().enumerate() {
        for slabs in [1, 2, 3, 7, 10, 64] {
            let rich = films(scene, &Settings { error_map: true, ..settings(slabs, true) });
            let full = films(scene, &Settings { error_map: true, ..settings(slabs, false) });
            let views = scene.views();
            each_ray(scene, 17, |view, pixel, ray| {
                let fine = planes(scene, &views[view], slabs);
                let merged = |by: usize| {
                    let last = fine[slabs as usize];
                    let mut planes: Vec<f64> = fine[..slabs as usize].iter().copied().step_by(by).collect();
                    planes.push(last);
                    ray.slabs(&planes)
                };
                let [one, two, four] = [merged(1), merged(2), merged(4)];
                let step = [0, 1, 2].map(|i| (one[i] - two[i]) / 3.0);
                let coarse = [0, 1, 2].map(|i| two[i] + (two[i] - four[i]) / 3.0);
                let want = [0, 1, 2].map(|i| one[i] + step[i]);
                let off = furthest(light(&rich[view], pixel), want);
                assert!(off <= 2.0 * SHARES, "scene {number}, {slabs} slabs: {off:e}");
                let own = f64::from(full[view].error.as_ref().unwrap()[pixel]);
                assert!((own - furthest(step, [0.0; 3])).abs() <= SHARES, "scene {number}, {slabs} slabs: {own}");
                let own = f64::from(rich[view].error.as_ref().unwrap()[pixel]);
                assert!((own - furthest(want, coarse) / 15.0).abs() <= SHARES, "scene {number}, {slabs}: {own}");
            });
        }
    }
}

// ---- Motion

/// The largest change from frame to frame beyond what the truth changes by, and the largest that the truth does.
fn excess(frames: &[Scene], settings: &Settings) -> [f64; 2] {
    let mut last: Option<(Vec<Film>, Vec<[f64; 3]>)> = None;
    let mut worst = [0.0f64; 2];
    for scene in frames {
        let films = films(scene, settings);
        let truth: Vec<_> = truths(scene, 3).into_iter().map(|(_, _, light)| light).collect();
        if let Some((old_films, old_truth)) = &last {
            for (i, (new, old)) in truth.iter().zip(old_truth).enumerate() {
                for channel in 0..3 {
                    let own = light(&films[0], 3 * i)[channel] - light(&old_films[0], 3 * i)[channel];
                    let true_change = new[channel] - old[channel];
                    worst[0] = worst[0].max(own.abs() - true_change.abs());
                    worst[1] = worst[1].max(true_change.abs());
                }
            }
        }
        last = Some((films, truth));
    }
    worst
}

fn two_balls() -> ParticleSet {
    let color = Attribute::Each(vec![[1.0, 0.2, 0.0], [0.0, 0.3, 1.0]]);
    ParticleSet { color, ..set(Kernel::Gaussian, &[[0.15, 0.0, 0.0], [-0.15, 0.0, 0.0]], 0.8, 0.8) }
}

#[test]
fn nothing_pops_when_the_order_of_particles_flips() {
    let turned = |degrees: f64| {
        let eye = DMat3::from_rotation_y(degrees.to_radians()) * DVec3::new(0.0, 0.0, 3.0);
        let camera = Camera { up: DVec3::Y, ..camera(eye.to_array(), [0.0; 3], 40.0, 0.1) };
        scene(camera, None, vec![two_balls()])
    };
    let frames = [turned(-0.01), turned(0.01)];
    let [over, change] = excess(&frames, &settings(64, false));
    println!("{over:.1e} over a true change of {change:.1e}");
    assert!(over < 1e-4, "{over}");
    // The scene is one in which order matters: sorted particles pop.
    let sorted = Settings { method: Method::Perspective, ..settings(64, false) };
    assert!(excess(&frames, &sorted)[0] > 0.1);
}

#[test]
fn nothing_pops_when_the_camera_walks_through_a_particle_or_one_crosses_a_wall() {
    let walk: Vec<Scene> = (0..60)
        .map(|step| {
            let z = 1.4 - 0.04 * f64::from(step);
            let camera = Camera { up: DVec3::Y, ..camera([0.1, 0.0, z], [0.1, 0.0, z - 1.0], 70.0, 0.1) };
            let mut far = set(Kernel::Poly, &[[0.5, 0.2, -3.0]], 0.7, 0.5);
            far.color = Attribute::Uniform([0.1, 0.9, 0.3]);
            scene(camera, None, vec![two_balls(), far])
        })
        .collect();
    let cross: Vec<Scene> = (0..40)
        .map(|step| {
            let mut balls = two_balls();
            balls.z.iter_mut().for_each(|z| *z += 1.6 - 0.08 * f64::from(step));
            let mut scene = scene(camera([0.0, 0.0, 4.0], [0.0; 3], 40.0, 0.1), None, vec![balls]);
            scene.meshes = vec![wall([0.0; 3], 3.0)];
            scene
        })
        .collect();
    for (name, frames) in [("walk", walk), ("cross", cross)] {
        let [over, change] = excess(&frames, &settings(64, false));
        println!("{name}: {over:.1e} over a true change of {change:.1e}");
        assert!(over < 1e-3, "{name}: {over}");
    }
}

// ---- Machines

#[test]
fn the_number_of_threads_changes_no_byte() {
    for mut scene in places(&Kernel::Gaussian) {
        scene.camera.size = [197, 150];
        for tolerance in [0.0, 1.0 / 255.0] {
            let with = |threads| {
                let settings = Settings { threads: Some(threads), tolerance, error_map: true, ..settings(24, false) };
                films(&scene, &settings)
            };
            let one = with(1);
            assert!(one == with(2) && one == with(3));
        }
    }
}

#[test]
fn vector_instructions_agree_within_rounding() {
    for kernel in kernels() {
        let worst = Mutex::new(0.0f32);
        for scene in places(&kernel).into_iter().chain(SIZES.map(|(size, _)| three_colours(&kernel, size))) {
            let with = |simd| films(&scene, &Settings { simd: Some(simd), ..settings(24, false) });
            let first = with(Level::Portable);
            for level in Level::available() {
                for (film, first) in with(level).iter().zip(&first) {
                    let planes = film.color.iter().chain([&film.transmittance]);
                    for (plane, first) in planes.zip(first.color.iter().chain([&first.transmittance])) {
                        for (a, b) in plane.iter().zip(first) {
                            let mut worst = worst.lock().unwrap();
                            *worst = worst.max((a - b).abs());
                        }
                    }
                }
            }
        }
        let worst = worst.into_inner().unwrap();
        assert!(f64::from(worst) < 2.0 * shares(kernel.name()), "{}: {worst}", kernel.name());
    }
}

#[test]
fn early_ends_cost_no_more_than_the_tolerance() {
    let dense = Gas { count: 400, radius: [0.3, 0.9], opacity: [0.5, 0.999], bright: 2.0, ..GAS };
    let mut fewer = false;
    for richardson in [false, true] {
        let gas = dense.draw(&mut Random::new(63), Kernel::Gaussian);
        let one = ParticleSet { color: Attribute::Uniform([0.9, 0.8, 0.3]), ..gas.clone() };
        for gas in [gas, one] {
            let scene = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, 0.1), rig(0.2, Some(6.0)), vec![gas]);
            let tolerance = 1.0 / 255.0;
            let exact = draw(&scene, &settings(32, richardson), &()).unwrap();
            let early = draw(&scene, &Settings { tolerance, ..settings(32, richardson) }, &()).unwrap();
            fewer |= early.statistics.fragments < exact.statistics.fragments;
            for (a, b) in early.films.iter().zip(&exact.films) {
                for pixel in 0..a.transmittance.len() {
                    let off = furthest(light(a, pixel), light(b, pixel));
                    let clear = f64::from((a.transmittance[pixel] - b.transmittance[pixel]).abs());
                    assert!(off.max(clear) <= tolerance, "{off} {clear}");
                }
            }
        }
    }
    assert!(fewer, "no ray ended early");
}

#[test]
fn slabs_are_chosen_by_the_median_radius_within_bounds() {
    let at = |z: f64, radius| {
        let particles = vec![set(Kernel::Gaussian, &[[0.0, 0.0, -2.0], [0.0, 0.0, z]], radius, 0.5)];
        let scene = scene(camera([0.0; 3], [0.0, 0.0, -1.0], 40.0, 0.1), None, particles);
        Parameters::DEFAULT.count(&scene)
    };
    // From 1.7 to 5.31 in slabs of at most 0.05; from the near plane to 3.95 in slabs of at most 0.325.
    assert_eq!(at(-5.01, 0.3), 73);
    assert_eq!(at(-2.0, 1.95), 12);
    assert_eq!(at(-2.0, 8.0), 8);
    assert_eq!(at(-500.0, 0.1), 512);
    let empty = scene(camera([0.0; 3], [0.0, 0.0, -1.0], 40.0, 0.1), None, Vec::new());
    assert_eq!(Parameters::DEFAULT.count(&empty), 8);
    assert_eq!(films(&empty, &settings(7, true))[0].transmittance[0], 1.0);
}
