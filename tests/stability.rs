//! Where renderers of gas fail: what every method makes of it, held by bounds on the scenes of `scenes/stability/`. A bound
//! from below holds that a method does fail, which a README says; what is not bounded so may get better.

use crate::methods::bits;
use glam::DVec3;
use std::path::Path;
use stereomist::Error;
use stereomist::input::{load_scene, scene_file};
use stereomist::picture::Film;
use stereomist::render::method::{sheet, slab};
use stereomist::render::reference::{self, Reference};
use stereomist::render::{Method, Settings, draw, opaque};
use stereomist::scene::{Attribute, Rgb, Scene};

const VIEWPLANE: Method = Method::Viewplane;
const VIEWPOINT: Method = Method::Viewpoint;
const PERSPECTIVE: Method = Method::Perspective;
const SPHERICAL: Method = Method::Spherical(stereomist::render::method::spherical::Parameters::DEFAULT);
const SHEET: Method = Method::Sheet(sheet::Parameters::DEFAULT);
const SLAB: Method = Method::Slab(slab::Parameters::DEFAULT);
const TRUTH: Method = Method::Reference(reference::Parameters::DEFAULT);
const ALL: [Method; 6] = [VIEWPLANE, VIEWPOINT, PERSPECTIVE, SPHERICAL, SHEET, SLAB];

/// A scene of the repository with settings applied.
fn try_load(path: &str, sets: &[&str]) -> Result<Scene, Error> {
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let file = scene_file::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(path), &sets)?;
    Ok(load_scene(file, &())?.scene)
}

/// A scene of this study.
fn load(name: &str) -> Scene {
    try_load(&format!("stability/{name}.toml"), &[]).unwrap()
}

fn films(scene: &Scene, method: Method) -> Vec<Film> {
    draw(scene, &Settings { method, tolerance: 0.0, ..Settings::default() }, &()).unwrap().films
}

fn film(scene: &Scene, method: Method) -> Film {
    films(scene, method).remove(0)
}

/// Red, green and blue of every pixel, plane after plane.
fn light(film: &Film) -> Vec<f64> {
    film.color.iter().flatten().map(|&value| f64::from(value)).collect()
}

fn less(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// The largest size; infinite where a value is none.
fn largest(values: &[f64]) -> f64 {
    values.iter().map(|value| if value.is_nan() { f64::INFINITY } else { value.abs() }).fold(0.0, f64::max)
}

fn change(a: &Film, b: &Film) -> f64 {
    largest(&less(&light(a), &light(b)))
}

/// Light and opacity of the pixel in the middle.
fn middle(film: &Film) -> [f64; 4] {
    let [width, height] = film.size.map(|n| n as usize);
    let at = height / 2 * width + width / 2;
    let [red, green, blue] = [0, 1, 2].map(|channel| f64::from(film.color[channel][at]));
    [red, green, blue, 1.0 - f64::from(film.transmittance[at])]
}

fn set_place(scene: &mut Scene, particle: usize, place: DVec3) {
    let set = &mut scene.particles[particle];
    (set.x, set.y, set.z) = (vec![place.x], vec![place.y], vec![place.z]);
}

fn set_opacity(scene: &mut Scene, set: usize, opacity: f64) {
    scene.particles[set].opacity = Attribute::Uniform(opacity);
}

fn color(scene: &Scene, set: usize) -> Rgb {
    scene.particles[set].color.get(0)
}

/// Holds a measure within what is said of the method.
fn hold(what: &str, method: Method, value: f64, [low, high]: [f64; 2]) {
    println!("{what}, {}: {value:.2e}", method.name());
    assert!(value >= low && value <= high, "{what}, {}: {value} is not within {low} to {high}", method.name());
}

// ---- 1 to 3: order

/// Rotates the camera of `orbit` round the particles, that of `turn` in place.
fn moved(name: &str, degrees: f64) -> Scene {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let mut scene = load(name);
    match name {
        "orbit" => scene.camera.position = DVec3::new(4.0 * sine, 0.0, 4.0 * cosine),
        _ => scene.camera.look_at = DVec3::new(sine, 0.0, -cosine),
    }
    scene
}

/// Beliaev & Zaytseva, eq. (4), at every channel of every pixel, from the opacity of each particle alone; and whether both
/// are well inside there.
fn equation_4(name: &str, method: Method) -> Vec<(f64, bool)> {
    let scene = moved(name, 0.0);
    let alone = [1, 0].map(|hidden| {
        let mut scene = scene.clone();
        set_opacity(&mut scene, hidden, 0.0);
        film(&scene, method).transmittance.iter().map(|through| 1.0 - f64::from(*through)).collect::<Vec<_>>()
    });
    let [first, second] = [0, 1].map(|set| color(&scene, set));
    let pixels = || alone[0].iter().zip(&alone[1]);
    first
        .iter()
        .zip(second)
        .flat_map(|(a, b)| {
            let contrast = f64::from((a - b).abs());
            pixels().map(move |(one, other)| (one * other * contrast, one.min(*other) > 0.02))
        })
        .collect()
}

/// Steps of 0.02 degrees before, over and after the flip.
fn steps(name: &str, method: Method) -> [Vec<f64>; 3] {
    let frames = [-0.03, -0.01, 0.01, 0.03].map(|angle| light(&film(&moved(name, angle), method)));
    [0, 1, 2].map(|step| less(&frames[step + 1], &frames[step]))
}

#[test]
fn what_sorts_pops_by_equation_4_and_what_mixes_does_not() {
    for (name, popping) in [
        ("orbit", &[VIEWPLANE, VIEWPOINT, PERSPECTIVE, SPHERICAL][..]),
        // Turning in place keeps every distance.
        ("turn", &[VIEWPLANE, SPHERICAL][..]),
    ] {
        let truth = steps(name, TRUTH);
        for method in ALL.into_iter().chain([TRUTH]) {
            let [before, over, after] = steps(name, method);
            let law = equation_4(name, method);
            let strongest = law.iter().map(|(jump, _)| *jump).fold(0.0, f64::max);
            assert!(strongest > 0.29, "{name}, {method:?}: {strongest}");
            for (i, &(law, inside)) in law.iter().enumerate().filter(|(_, (_, inside))| *inside) {
                // The camera's own motion is that of the steps beside.
                let jump = over[i] - 0.5 * (before[i] + after[i]);
                let expected = if popping.contains(&method) { law } else { 0.0 };
                let limit = if popping.contains(&method) { 1e-3 } else { 1e-4 };
                assert!(
                    (jump.abs() - expected).abs() < limit && inside,
                    "{name}, {method:?}, {i}: {jump} for {expected}"
                );
            }
            if method == SLAB {
                hold(name, method, largest(&less(&over, &truth[1])), [0.0, 1e-4]);
            }
        }
    }
}

#[test]
fn of_equal_depths_the_lower_index_is_drawn_first() {
    let scene = load("ties");
    let mut swapped = scene.clone();
    swapped.particles.swap(0, 1);
    let [first, second] = [0, 1].map(|set| color(&scene, set).map(f64::from));
    let (a, b) = (0.6f64, 0.8f64);
    // Both have the same kernel at the same place: everywhere the gas has their mean colour.
    let (weight, through) = ((-a).ln_1p() / ((-a).ln_1p() + (-b).ln_1p()), (1.0 - a) * (1.0 - b));
    for channel in 0..3 {
        let sorted = b * second[channel] + (1.0 - b) * a * first[channel];
        let other = a * first[channel] + (1.0 - a) * b * second[channel];
        let mixed = (weight * first[channel] + (1.0 - weight) * second[channel]) * (1.0 - through);
        for method in [VIEWPLANE, VIEWPOINT, PERSPECTIVE, SPHERICAL] {
            let shown = [&scene, &swapped].map(|scene| middle(&film(scene, method))[channel]);
            let error = (shown[0] - sorted).abs().max((shown[1] - other).abs());
            hold("drawn in order", method, error, [0.0, 1e-5]);
        }
        for method in [SLAB, TRUTH] {
            hold("mixed", method, (middle(&film(&scene, method))[channel] - mixed).abs(), [0.0, 1e-5]);
        }
    }
    for method in [SHEET, SLAB, TRUTH] {
        hold("another order", method, change(&film(&scene, method), &film(&swapped, method)), [0.0, 1e-6]);
    }
    let truth = middle(&film(&scene, TRUTH));
    for (method, cost) in ALL.into_iter().zip([0.2, 0.2, 0.2, 0.2, 0.04, 0.0]) {
        hold("cost", method, largest(&less(&middle(&film(&scene, method)), &truth)[..3]), [cost, 1.3 * cost + 1e-5]);
    }
}

#[test]
fn an_order_of_its_own_for_each_eye_is_rivalry() {
    let scene = load("rivalry");
    let between = |method| {
        let films = films(&scene, method);
        less(&light(&films[1]), &light(&films[0]))
    };
    let truth = between(TRUTH);
    for (method, range) in ALL.into_iter().zip([
        // One order for both eyes: what is left is the same flat picture for both.
        [1e-3, 0.01],
        // Equation 4 between the eyes.
        [0.35, 0.45],
        [0.35, 0.45],
        // Shown at the depth of its farthest point.
        [1e-3, 0.08],
        [1e-3, 0.01],
        [0.0, 1e-3],
    ]) {
        hold("between the eyes", method, largest(&less(&between(method), &truth)), range);
    }
}

// ---- 4 and 5: from frame to frame

/// The most by which a method's change from frame to frame exceeds the reference's.
fn beyond(scenes: &[Scene], method: Method) -> f64 {
    let changes = |method| {
        let films: Vec<_> = scenes.iter().map(|scene| film(scene, method)).collect();
        films.windows(2).map(|pair| change(&pair[0], &pair[1])).collect::<Vec<_>>()
    };
    less(&changes(method), &changes(TRUTH)).into_iter().fold(0.0, f64::max)
}

#[test]
fn walking_through_a_particle_pops_billboards_alone() {
    let base = load("walk");
    let at = |z| {
        let mut scene = base.clone();
        scene.camera.position.z = z;
        scene
    };
    let scenes: Vec<_> = (0..=140).map(|frame| at(3.0 - 0.04 * f64::from(frame))).collect();
    for (method, range) in
        ALL.into_iter().zip([[0.5, 0.75], [0.5, 0.75], [0.5, 0.75], [0.0, 0.05], [0.0, 0.1], [0.0, 1e-3]])
    {
        hold("walk", method, beyond(&scenes, method), range);
    }
}

#[test]
fn crossing_a_wall_pops_billboards_alone() {
    let base = load("wall");
    let at = |z| {
        let mut scene = base.clone();
        set_place(&mut scene, 0, DVec3::new(0.0, 0.0, z));
        set_place(&mut scene, 1, DVec3::new(0.2, 0.1, z - 0.6));
        scene
    };
    let scenes: Vec<_> = (0..=150).map(|frame| at(-3.0 - 0.02 * f64::from(frame))).collect();
    for (method, range) in
        ALL.into_iter().zip([[0.2, 0.4], [0.2, 0.4], [0.2, 0.4], [0.0, 0.01], [0.0, 0.01], [0.0, 1e-3]])
    {
        hold("wall", method, beyond(&scenes, method), range);
    }
}

// ---- 6 to 8: many

#[test]
fn thin_gas_is_not_lost() {
    let scene = load("thin");
    let truth = -(-3.0f64).exp_m1();
    for method in ALL.into_iter().chain([TRUTH]) {
        // Within a slice of `sheet` opacities are added, which is more than they are together.
        let range = if method == SHEET { [1e-3, 4e-3] } else { [0.0, 1e-5] };
        hold("thin gas", method, (middle(&film(&scene, method))[3] - truth).abs(), range);
    }
}

#[test]
fn sheets_clamp_what_adds_past_one() {
    let mut scene = load("past-one");
    for total in [0.25f64, 1.5, 3.0, 8.0] {
        set_opacity(&mut scene, 0, -(-total / 4.0).exp_m1());
        for method in ALL.into_iter().filter(|method| *method != SHEET) {
            hold("opacity", method, (middle(&film(&scene, method))[3] + (-total).exp_m1()).abs(), [0.0, 1e-5]);
        }
    }
    set_opacity(&mut scene, 0, -(-1.5f64 / 4.0).exp_m1());
    let cost = |width| {
        let method = Method::Sheet(sheet::Parameters { slice_width: Some(width), ..sheet::Parameters::DEFAULT });
        middle(&film(&scene, method))[3] + (-1.5f64).exp_m1()
    };
    let costs = [0.25, 0.125, 0.0625, 0.03125].map(cost);
    hold("half the radius", SHEET, costs[0], [0.1, 0.14]);
    // Of first order.
    for pair in costs.windows(2) {
        hold("slices half as wide", SHEET, pair[1] / pair[0], [0.42, 0.58]);
    }
    // The clamp itself: transmittance 0 where gas of optical depth 2.5 lets 8 % through.
    set_opacity(&mut scene, 0, -(-2.5f64 / 4.0).exp_m1());
    hold("clamped", SHEET, middle(&film(&scene, SHEET))[3] + (-2.5f64).exp_m1(), [0.08, 0.0825]);
}

#[test]
fn a_hundred_thousand_layers_are_summed_without_loss() {
    let scene = load("layers");
    let opacity = -(-3.0f64).exp_m1();
    let truth = film(&scene, TRUTH);
    for method in ALL {
        let film = film(&scene, method);
        hold("opacity", method, (middle(&film)[3] - opacity).abs(), [0.0, if method == SHEET { 1e-4 } else { 2e-6 }]);
        hold("colour", method, change(&film, &truth), [0.0, 1e-4]);
    }
}

// ---- 9 to 12: extremes

#[test]
fn a_million_units_from_the_origin_the_picture_is_the_same() {
    let near = load("far");
    let mut away = near.clone();
    let shift = DVec3::new(1e6, -1e6, 1e6);
    away.camera.position += shift;
    away.camera.look_at += shift;
    for set in &mut away.particles {
        set.x.iter_mut().for_each(|x| *x += shift.x);
        set.y.iter_mut().for_each(|y| *y += shift.y);
        set.z.iter_mut().for_each(|z| *z += shift.z);
    }
    away.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions).for_each(|position| *position += shift);
    for method in ALL.into_iter().chain([TRUTH]) {
        for (a, b) in films(&near, method).iter().zip(&films(&away, method)) {
            hold("far away", method, change(a, b), [0.0, 1e-6]);
        }
    }
}

/// The largest error of a method's picture against the reference's.
fn error(scene: &Scene, method: Method) -> f64 {
    change(&film(scene, method), &film(scene, TRUTH))
}

fn errors(name: &str, ranges: [[f64; 2]; 6]) {
    let scene = load(name);
    for (method, range) in ALL.into_iter().zip(ranges) {
        hold(name, method, error(&scene, method), range);
    }
}

#[test]
fn an_eye_inside_a_particle_needs_the_near_plane_along_the_ray() {
    errors("inside", [[0.05, 0.15], [0.15, 0.35], [0.04, 0.1], [0.4, 0.8], [0.08, 0.16], [0.0, 1e-5]]);
}

#[test]
fn a_field_of_150_degrees_needs_rays() {
    errors("wide", [[0.5, 0.8], [5e-3, 0.03], [0.0, 1e-4], [0.6, 1.0], [0.5, 0.8], [0.0, 1e-5]]);
}

#[test]
fn opacity_from_nothing_to_almost_one() {
    errors("extremes", [[0.05, 0.1], [0.05, 0.1], [0.0, 1e-4], [0.1, 0.25], [0.05, 0.12], [0.0, 1e-5]]);
    let scene = load("extremes");
    let mut empty = scene.clone();
    empty.particles.clear();
    let mut nothing = scene.clone();
    set_opacity(&mut nothing, 1, 0.0);
    let mut alone = scene.clone();
    alone.particles.remove(0);
    for method in ALL.into_iter().chain([TRUTH]) {
        // Opacity 0 leaves the background's own bytes.
        assert!(bits(&films(&nothing, method)) == bits(&films(&empty, method)), "{method:?}");
        // Among others it may choose another way to composite: one for many colours.
        hold("opacity 0", method, change(&film(&scene, method), &film(&alone, method)), [0.0, 1e-6]);
        let through = 1.0 - middle(&film(&scene, method))[3];
        // The slices of `sheet` are opaque already.
        hold("transmittance", method, through, if method == SHEET { [0.0, 0.0] } else { [9e-7, 1.1e-6] });
    }
    for refused in ["1.0", "-0.1", "nan"] {
        let message =
            try_load("stability/extremes.toml", &[&format!("particles.1.opacity={refused}")]).unwrap_err().to_string();
        assert!(message.contains("allowed: a number, 0 or more and less than 1"), "{message}");
    }
}

// ---- 13: between the eyes

/// RMS over channels of the right eye's error less the left eye's, carried over by the parallax of the depth that the left
/// eye's ray sees on the mean.
fn inconsistency(scene: &Scene, errors: &[Vec<f64>]) -> f64 {
    let views = scene.views();
    let layer = opaque::draw(scene, &views[0]);
    let reference = Reference::new(scene, &views[0], layer.as_ref());
    let [width, height] = scene.camera.size.map(|n| n as usize);
    let (mut sum, mut count) = (0.0, 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let at = [x as f64 + 0.5, y as f64 + 0.5];
        let depth = reference.mean_depth(at[0], at[1]);
        if !depth.is_finite() {
            continue;
        }
        let point =
            views[0].position + views[0].eye_from_world.transpose() * (views[0].direction(at[0], at[1]) * depth);
        let place = views[1].project(views[1].eye_from_point(point));
        assert!((place.y - at[1]).abs() < 1e-6, "vertical parallax");
        let (left, part) = ((place.x - 0.5).floor(), (place.x - 0.5).rem_euclid(1.0));
        if left < 0.0 || left + 1.0 > (width - 1) as f64 {
            continue;
        }
        for channel in 0..3 {
            let row = channel * width * height + y * width;
            let other = errors[1][row + left as usize] * (1.0 - part) + errors[1][row + left as usize + 1] * part;
            sum += (other - errors[0][row + x]).powi(2);
            count += 1;
        }
    }
    assert!(count > width * height, "{count}");
    (sum / f64::from(u32::try_from(count).unwrap())).sqrt()
}

#[test]
fn the_errors_of_both_eyes_agree_but_for_a_little() {
    let scene = try_load("fog.toml", &["camera.size=[48, 36]", "camera.samples=1"]).unwrap();
    let truth = films(&scene, TRUTH);
    let mut found = Vec::new();
    for method in ALL {
        let films = films(&scene, method);
        let errors: Vec<_> = films.iter().zip(&truth).map(|(film, truth)| less(&light(film), &light(truth))).collect();
        found.push(inconsistency(&scene, &errors));
    }
    let ranges = [[1e-3, 5e-3], [1e-3, 5e-3], [5e-4, 5e-3], [5e-3, 0.025], [1e-3, 6e-3], [0.0, 1e-6]];
    for ((method, value), range) in ALL.into_iter().zip(found).zip(ranges) {
        hold("inconsistency", method, value, range);
    }
}

// ---- 14 to 16: what is cut by depth

#[test]
fn a_particle_that_no_ray_sees_changes_nothing_where_slabs_are_given() {
    for distance in [10.0, 1e3, 1e5] {
        let mut scene = load("outlier");
        set_place(&mut scene, 2, DVec3::new(distance, 0.0, -distance));
        let mut without = scene.clone();
        set_opacity(&mut without, 2, 0.0);
        for method in ALL.into_iter().chain([TRUTH]) {
            let found = change(&film(&scene, method), &film(&without, method));
            // Of its own accord `slab` lays at most 512 planes through all of the gas, however far it reaches.
            hold("unseen", method, found, [0.0, if method == SLAB { 0.3 } else { 0.0 }]);
        }
    }
}

#[test]
fn small_particles_need_thin_slabs() {
    let limits = [[0.0, 0.03], [0.0, 0.03], [0.0, 1e-3], [0.0, 0.15], [0.1, 0.3], [0.0, 0.2]];
    errors("mixed-radii", limits);
    let thin = Method::Slab(slab::Parameters { slabs: Some(512), richardson: false });
    hold("512 slabs", thin, error(&load("mixed-radii"), thin), [0.0, 1e-4]);
}

#[test]
fn slabs_are_thick_for_slanting_rays() {
    let base = load("oblique");
    let at = |degrees: f64| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let mut scene = base.clone();
        set_place(&mut scene, 0, 4.0 * DVec3::new(sine, 0.0, -cosine));
        set_place(&mut scene, 1, 4.3 * DVec3::new(sine, 0.0, -cosine));
        scene
    };
    hold("on the axis", SLAB, error(&at(0.0), SLAB), [0.0, 4e-3]);
    hold("at 75 degrees", SLAB, error(&at(75.0), SLAB), [0.0, 0.06]);
    // What costs nothing but slabs: a quarter of the thickness for the cosine of 75 degrees.
    let thin = Method::Slab(slab::Parameters {
        slabs: Some(4 * slab::Parameters::DEFAULT.count(&at(75.0))),
        richardson: false,
    });
    hold("at 75 degrees, four times the slabs", thin, error(&at(75.0), thin), [0.0, 4e-3]);
    // What follows the ray does not care for the angle.
    let [axis, edge] = [0.0, 75.0].map(|degrees| error(&at(degrees), PERSPECTIVE));
    hold("edge less axis", PERSPECTIVE, edge - axis, [-0.01, 0.01]);
}
