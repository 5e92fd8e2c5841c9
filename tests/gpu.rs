//! The GPU path: on the software Vulkan driver `llvmpipe`, unless `STEREOMIST_GPU` names another adapter. Without one the
//! tests are skipped and say so; with `STEREOMIST_GPU=require` that is a failure.

use crate::harness::{Difference, Gas, Random, kernels, set, skipped};
use crate::methods::{
    self, METHODS, PRECISION, bits, camera, cloud, compare, crate_mesh, eyes, films, repeats, rig, scene, truths,
};
use crate::sheet as slices;
use crate::spherical::ball;
use glam::DVec3;
use std::mem::offset_of;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use stereomist::Error;
use stereomist::picture::Film;
use stereomist::render::cpu::footprint::Tables;
use stereomist::render::cpu::primitive::{self, Shape, Shell};
use stereomist::render::cpu::rim::Rim;
use stereomist::render::cpu::segments::{Lookup, Segments};
use stereomist::render::cpu::splat::{Bounds, Card, Lens};
use stereomist::render::gpu::adapter::{self, Class};
use stereomist::render::gpu::bin::{self, Stairs};
use stereomist::render::gpu::shader::{self, Part};
use stereomist::render::gpu::{Gpu, Grade, Lists, layout};
use stereomist::render::method::{sheet, slab};
use stereomist::render::{
    DEFAULT_TOLERANCE, Device, GpuPath, Method, OpacityModel, Progress, Session, Settings, reference,
};
use stereomist::scene::{Attribute, Camera, Kernel, ParticleSet, Scene};

/// The adapter's name.
fn name() -> String {
    match std::env::var("STEREOMIST_GPU") {
        Ok(name) if name != "require" && !name.is_empty() => name,
        _ => "llvmpipe".to_owned(),
    }
}

/// Whether there is a device; says so where there is none.
pub fn present() -> bool {
    gpu_or_skip().is_some()
}

/// A device of one's own.
fn open(grade: Grade) -> Option<Gpu> {
    match adapter::choose(Some(&name())).and_then(|candidate| Gpu::open(candidate, grade)) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("STEREOMIST_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            skipped(&format!("{error}"));
            None
        }
    }
}

/// The device that the tests share, one test at a time.
type Shared = MutexGuard<'static, Option<Gpu>>;

fn gpu_or_skip() -> Option<Shared> {
    static SHARED: OnceLock<Mutex<Option<Gpu>>> = OnceLock::new();
    let shared = SHARED.get_or_init(|| Mutex::new(open(Grade::Full)));
    // A test that fails leaves the device as good as it was, or the next ones say what is wrong.
    let mut guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
    if guard.is_none() {
        *guard = open(Grade::Full);
    }
    guard.is_some().then_some(guard)
}

/// Draws as [`draw_on`] does, with particles listed on the device; tells whether they were.
fn draw_listed(gpu: &mut Shared, scene: &Scene, settings: &Settings) -> (Vec<Film>, bool) {
    if let Some(gpu) = gpu.as_mut() {
        gpu.set_lists(Lists::Gpu);
    }
    let mut session = Session::on(settings, gpu.take().unwrap()).unwrap();
    let rendering = session.draw(scene, &()).unwrap();
    let mut own = session.into_gpu().unwrap();
    own.set_lists(Lists::Cpu);
    **gpu = Some(own);
    let told = rendering.statistics.plan.iter().any(|line| line.starts_with("Particles listed on the CPU"));
    assert!(
        rendering.statistics.stages.iter().any(|(name, _)| *name == "project") || told || scene.particle_count() == 0
    );
    (rendering.films, !told)
}

/// The ways that lose nothing.
const PATHS: [GpuPath; 2] = [GpuPath::Compute, GpuPath::Raster];

fn draw_on(gpu: &mut Shared, scene: &Scene, settings: &Settings) -> Vec<Film> {
    let mut session = Session::on(settings, gpu.take().unwrap()).unwrap();
    let rendering = session.draw(scene, &()).unwrap();
    assert!(rendering.device.starts_with("GPU, ") && rendering.warning.is_none(), "{}", rendering.device);
    assert!(rendering.gpu_path.is_some() && settings.gpu_path.is_none_or(|path| rendering.gpu_path == Some(path)));
    **gpu = session.into_gpu();
    rendering.films
}

// ---- Pictures

/// Scenes for a kernel, and their name.
type Family = (&'static str, fn(Kernel) -> Vec<Scene>);

/// What the CPU's picture and the GPU's may differ by, beside the tolerance: rays end early at other places.
const TWIN: f64 = 2e-3;

/// Every method and opacity model against the truth and the CPU's picture, for each tolerance.
fn agree(families: &[Family], kernels: &[Kernel], tolerances: &[f64]) {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let mut failures = Vec::new();
    for (name, family) in families {
        let (mut worst, mut twins, mut pixels) = (0.0f64, 0.0f64, 0);
        // Frames whose particles were listed on the device, and how far off their pictures were from those of the CPU's lists.
        let mut lists = (0, 0.0f64);
        for kernel in kernels {
            for (number, scene) in family(kernel.clone()).iter().enumerate() {
                let eyes = eyes(scene);
                for (method, way) in METHODS {
                    for opacity_model in [OpacityModel::Exponential, OpacityModel::Linear] {
                        if repeats(method, kernel, opacity_model) {
                            continue;
                        }
                        let truths = truths(scene, way, opacity_model == OpacityModel::Linear, &eyes);
                        for (&tolerance, path) in tolerances.iter().flat_map(|t| PATHS.map(|path| (t, path))) {
                            let gpu_path = Some(path);
                            let settings =
                                Settings { method, opacity_model, tolerance, gpu_path, ..Settings::default() };
                            let drawn = draw_on(&mut gpu, scene, &settings);
                            let found = compare(&drawn, &truths, PRECISION + tolerance);
                            let verdict = found.verdict(if tolerance == 0.0 { 10_000 } else { usize::MAX });
                            let others = films(scene, &Settings { device: Device::Cpu, ..settings.clone() });
                            let twin = difference(&drawn, &others, &truths);
                            let verdict = verdict.and_then(|()| {
                                if twin.max <= TWIN + tolerance {
                                    Ok(())
                                } else {
                                    Err(format!("the CPU's picture: {twin:?}"))
                                }
                            });
                            if let Err(what) = verdict {
                                failures.push(format!("{name} {} scene {number} {settings:?}: {what}", kernel.name()));
                            }
                            if path == GpuPath::Compute {
                                let (listed, on_device) = draw_listed(&mut gpu, scene, &settings);
                                let found = compare(&listed, &truths, PRECISION + tolerance);
                                let twin = difference(&listed, &drawn, &truths);
                                (lists.0, lists.1) = (lists.0 + usize::from(on_device), lists.1.max(twin.max));
                                let verdict = found.verdict(if tolerance == 0.0 { 10_000 } else { usize::MAX });
                                if let Err(what) = verdict {
                                    failures.push(format!(
                                        "{name} {} scene {number} listed on the device: {what}",
                                        kernel.name()
                                    ));
                                }
                                if twin.max > TWIN {
                                    failures.push(format!(
                                        "{name} {} scene {number} {method:?} lists: {twin:?}",
                                        kernel.name()
                                    ));
                                }
                            }
                            if tolerance == 0.0 {
                                worst = worst.max(found.max);
                            }
                            twins = twins.max(twin.max);
                            pixels += found.pixels;
                        }
                    }
                }
            }
        }
        println!(
            "{name}: from the truth {worst:.2e}, from the CPU {twins:.2e}, {pixels} pixels; {} listed on the device, {:.2e} from \
             lists of the CPU",
            lists.0, lists.1
        );
        assert!(lists.0 > 0, "{name}: nothing was listed on the device");
        assert!(pixels > 0, "{name} has no pictures");
    }
    let count = failures.len();
    failures.truncate(4);
    assert!(failures.is_empty(), "{count} failures, of which\n{}", failures.join("\n"));
}

/// Two renderings, where the truth does not jump.
fn difference(a: &[Film], b: &[Film], truths: &[crate::truth::Picture]) -> Difference {
    let mut difference = Difference::default();
    assert_eq!(a.len(), b.len());
    for (i, ((a, b), truth)) in a.iter().zip(b).zip(truths).enumerate() {
        assert_eq!(a.depth, b.depth);
        let [red, green, blue] = &b.color;
        let planes = [red, green, blue, &b.transmittance].map(|p| p.iter().map(|&v| f64::from(v)).collect());
        difference.add(i, a, &planes, &truth.fragile, TWIN);
    }
    difference
}

#[test]
fn every_kernel_agrees_with_the_truth_and_the_cpu() {
    agree(&[("many_colours", methods::many_colours)], &kernels(), &[0.0]);
}

#[test]
fn surfaces_in_gas_and_early_ends_agree_with_the_truth_and_the_cpu() {
    let families: &[Family] = &[
        ("meshes_in_gas", methods::meshes_in_gas),
        ("dense", methods::dense),
        ("surrounded", methods::surrounded),
        ("without_gas", methods::without_gas),
    ];
    agree(families, &[Kernel::Gaussian, Kernel::Linear], &[0.0, DEFAULT_TOLERANCE]);
}

#[test]
fn hard_scenes_agree_with_the_truth_and_the_cpu() {
    let families: &[Family] = &[
        ("one_colour", methods::one_colour),
        ("mixed_sets", methods::mixed_sets),
        ("inside", methods::inside),
        ("looking_away", methods::looking_away),
        ("wide_angle", methods::wide_angle),
        ("at_the_near_plane", methods::at_the_near_plane),
        ("subpixel", methods::subpixel),
        ("ties", methods::ties),
        ("odd_sizes", methods::odd_sizes),
        ("toe_in", methods::toe_in),
        ("far_from_the_origin", methods::far_from_the_origin),
        ("hollow", methods::hollow),
        ("stepped_profile", methods::stepped_profile),
        ("telescope", methods::telescope),
        ("widest_angle", methods::widest_angle),
        ("meshes_seen_toed_in_and_supersampled", methods::meshes_seen_toed_in_and_supersampled),
    ];
    agree(families, &[Kernel::Gaussian], &[0.0]);
}

/// Raster in targets of 16 bits, of gas that is no thinner than they can hold: roughly the CPU's picture.
#[test]
fn half_precision_is_roughly_the_cpu_s_picture() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    for method in [Method::Viewplane, Method::Viewpoint, Method::Perspective] {
        for scene in methods::many_colours(Kernel::Gaussian).iter().chain(&methods::meshes_in_gas(Kernel::Linear)) {
            let settings = Settings { method, tolerance: 0.0, ..Settings::default() };
            let half = Settings { gpu_path: Some(GpuPath::RasterF16), ..settings.clone() };
            let drawn = draw_on(&mut gpu, scene, &half);
            let cpu = films(scene, &Settings { device: Device::Cpu, ..settings });
            let pairs = drawn.iter().zip(&cpu).flat_map(|(a, b)| planes(a).zip(planes(b)));
            let worst = pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
            println!("{method:?} in 16 bits: {worst:.2e}");
            assert!((1e-5..0.1).contains(&worst), "{method:?}: {worst}");
        }
    }
}

/// A shipped scene, smaller: the default tolerance, as the command line has it.
#[test]
fn a_shipped_scene_agrees_with_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fog.toml");
    let mut file = stereomist::input::scene_file::load(&path, &[]).unwrap();
    file.camera.size = [160, 120];
    let fog = stereomist::input::load_scene(file, &()).unwrap().scene;
    let computed = [slabs(64), richardson(64), Method::Sheet(sheet::Parameters::DEFAULT)];
    let computed = computed.map(|method| (method, GpuPath::Compute));
    for (method, path) in METHODS.iter().flat_map(|(method, _)| PATHS.map(|path| (*method, path))).chain(computed) {
        let settings = Settings { method, gpu_path: Some(path), ..Settings::default() };
        let drawn = draw_on(&mut gpu, &fog, &settings);
        for (a, b) in drawn.iter().zip(&films(&fog, &Settings { device: Device::Cpu, ..settings })) {
            let worst = planes(a).zip(planes(b)).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
            println!("fog, {method:?} by {}: {worst:.2e}", path.name());
            assert!(worst <= 2e-3, "{method:?}: {worst}");
        }
    }
}

fn slabs(slabs: u32) -> Method {
    Method::Slab(slab::Parameters { slabs: Some(slabs), richardson: false })
}

/// The extrapolation from that many slabs.
fn richardson(slabs: u32) -> Method {
    Method::Slab(slab::Parameters { slabs: Some(slabs), richardson: true })
}

fn sheet(slice_width: f64, lookup: Lookup) -> Method {
    Method::Sheet(sheet::Parameters { slice_width: Some(slice_width), segments: 256, lookup })
}

/// The largest difference of any plane.
fn worst(a: &[Film], b: &[Film]) -> f32 {
    assert_eq!(a.len(), b.len());
    let pairs = a.iter().zip(b).flat_map(|(a, b)| planes(a).zip(planes(b)));
    pairs.fold(0.0, |worst, (a, b)| if a.is_finite() { f32::max(worst, (a - b).abs()) } else { f32::INFINITY })
}

/// Optical depth in slabs: whatever the number, the CPU's picture. (The CPU's is held against the truth elsewhere.)
#[test]
fn slabs_are_those_of_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let families: &[Family] = &[
        ("many_colours", methods::many_colours),
        ("one_colour", methods::one_colour),
        ("mixed_sets", methods::mixed_sets),
        ("inside", methods::inside),
        ("surrounded", methods::surrounded),
        ("at_the_near_plane", methods::at_the_near_plane),
        ("odd_sizes", methods::odd_sizes),
        ("toe_in", methods::toe_in),
        ("dense", methods::dense),
        ("far_from_the_origin", methods::far_from_the_origin),
        ("meshes_in_gas", methods::meshes_in_gas),
        ("telescope", methods::telescope),
        ("without_gas", methods::without_gas),
    ];
    for (name, family) in families {
        // As it is, and extrapolated.
        let mut most = [0.0f32; 2];
        for kernel in kernels() {
            if kernel != Kernel::Gaussian && !["many_colours", "meshes_in_gas"].contains(name) {
                continue;
            }
            for scene in family(kernel.clone()) {
                for (count, tolerance) in [(1, 0.0), (5, 0.0), (50, 0.0), (50, DEFAULT_TOLERANCE)] {
                    for (most, method) in most.iter_mut().zip([slabs(count), richardson(count)]) {
                        let settings = Settings { method, tolerance, ..Settings::default() };
                        let drawn = draw_on(&mut gpu, &scene, &settings);
                        let off = worst(&drawn, &films(&scene, &Settings { device: Device::Cpu, ..settings }));
                        let what = kernel.name();
                        assert!(off <= 2e-3 + tolerance as f32, "{name} {what} {method:?} {tolerance}: {off}");
                        *most = if tolerance == 0.0 { most.max(off) } else { *most };
                    }
                }
            }
        }
        println!("{name}: {:.2e}, extrapolated {:.2e}", most[0], most[1]);
    }
}

/// What slabs estimate of their error is what the CPU does, whatever the number of slabs, in one piece and in many.
#[test]
fn estimates_of_the_error_are_those_of_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let Some(mut small) = open(Grade::LeastLimits) else { return };
    small.lower_most_bytes(0);
    let mut small = Some(small);
    let estimated = |settings: &Settings| Settings { error_map: true, tolerance: 0.0, ..settings.clone() };
    let families: &[Family] = &[
        ("many_colours", methods::many_colours),
        ("mixed_sets", methods::mixed_sets),
        ("one_colour", methods::one_colour),
        ("inside", methods::inside),
        ("odd_sizes", methods::odd_sizes),
        ("meshes_in_gas", methods::meshes_in_gas),
        ("without_gas", methods::without_gas),
    ];
    for (name, family) in families {
        let (mut most, mut largest) = (0.0f32, 0.0f32);
        for scene in family(Kernel::Gaussian) {
            for method in [1, 2, 3, 6, 13, 50].into_iter().flat_map(|count| [slabs(count), richardson(count)]) {
                let settings = estimated(&Settings { method, ..Settings::default() });
                let cpu = films(&scene, &Settings { device: Device::Cpu, ..settings.clone() });
                let drawn = draw_on(&mut gpu, &scene, &settings);
                // With buffers for few rows and few groups of slabs.
                let mut session = Session::on(&settings, small.take().unwrap()).unwrap();
                let pieces = session.draw(&scene, &()).unwrap();
                assert!(pieces.device.starts_with("GPU, ") && pieces.warning.is_none());
                small = session.into_gpu();
                for (found, cpu) in drawn.iter().zip(&cpu).chain(pieces.films.iter().zip(&cpu)) {
                    let (found, cpu) = (found.error.as_ref().unwrap(), cpu.error.as_ref().unwrap());
                    assert_eq!(found.len(), cpu.len());
                    for (&found, &cpu) in found.iter().zip(cpu) {
                        assert!((found - cpu).abs() <= 1e-4 + 2e-3 * cpu, "{name} {method:?}: {found} for {cpu}");
                        most = most.max((found - cpu).abs());
                        largest = largest.max(cpu);
                    }
                }
                // The picture is the same with and without.
                let plain = draw_on(&mut gpu, &scene, &Settings { error_map: false, ..settings });
                assert!(plain.iter().all(|film| film.error.is_none()));
                assert!(worst(&plain, &drawn) <= 1e-6);
            }
        }
        println!("{name}: estimates up to {largest:.2e}, off by {most:.2e}");
        assert!(largest > 1e-3 || ["one_colour", "without_gas"].contains(name), "{name}: {largest}");
    }
    // Methods without estimates have none, on any device.
    let settings = estimated(&Settings { method: Method::Viewplane, ..Settings::default() });
    let drawn = draw_on(&mut gpu, &methods::one_colour(Kernel::Gaussian)[0], &settings);
    assert!(drawn.iter().all(|film| film.error.is_none()));
}

/// Tells how far it is as often as it submits something, and never goes back.
#[test]
fn progress_is_told_within_a_stretch_of_rows() {
    #[derive(Default)]
    struct Told(Mutex<Vec<[u64; 2]>>);
    impl Progress for Told {
        fn update(&self, done: u64, total: u64) {
            self.0.lock().unwrap().push([done, total]);
        }
    }
    let Some(mut small) = open(Grade::LeastLimits) else { return };
    small.lower_most_bytes(0);
    let mut small = Some(small);
    // One stretch.
    let gas = cloud(400).draw(&mut Random::new(76), Kernel::Gaussian);
    let scene = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [64, 48]), None, vec![gas]);
    for method in [slabs(200), sheet(0.02, Lookup::Nearest)] {
        let method = match method {
            Method::Sheet(parameters) => Method::Sheet(sheet::Parameters { segments: 32, ..parameters }),
            other => other,
        };
        let settings = Settings { method, device: Device::Gpu(None), ..Settings::default() };
        let mut session = Session::on(&settings, small.take().unwrap()).unwrap();
        let told = Told::default();
        session.draw(&scene, &told).unwrap();
        small = session.into_gpu();
        let told = told.0.into_inner().unwrap();
        println!("{method:?}: {told:?}");
        assert!(told.len() > 4, "{told:?}");
        assert!(told.windows(2).all(|pair| pair[0][0] * pair[1][1] <= pair[1][0] * pair[0][1]), "{told:?}");
        assert!(told.last().is_some_and(|[done, total]| done == total), "{told:?}");
    }
}

/// A frame that is refused leaves what is on the device as it is.
#[test]
fn a_refused_frame_leaves_the_next_ones_alone() {
    let settings = by_compute(slabs(1));
    let Some(mut small) = open(Grade::LeastLimits) else { return };
    small.lower_most_bytes(0);
    let settings = Settings { device: Device::Gpu(None), ..settings };
    let mut session = Session::on(&settings, small).unwrap();
    let few = methods::many_colours(Kernel::Gaussian).remove(0);
    let first = session.draw(&few, &()).unwrap().films;
    let many = cloud(3000).draw(&mut Random::new(77), Kernel::Gaussian);
    let many = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [64, 48]), None, vec![many]);
    assert!(session.draw(&many, &()).unwrap_err().to_string().contains("eight slabs"));
    assert_eq!(bits(&session.draw(&few, &()).unwrap().films), bits(&first));
}

/// Thin slabs of smooth gas: the extrapolation is far nearer the truth than what it is made of, on the GPU too.
#[test]
fn the_extrapolation_gains_an_order() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gas = Gas { radius: [0.5, 0.9], opacity: [0.1, 0.5], ..cloud(30) }.draw(&mut Random::new(54), Kernel::Gaussian);
    let smooth = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 40.0, [31, 23]), rig(0.2, Some(6.0)), vec![gas]);
    let settings = |method| Settings { method, tolerance: 0.0, ..Settings::default() };
    let truth = films(&smooth, &settings(Method::Reference(reference::Parameters::DEFAULT)));
    let [plain, fine] = [slabs, richardson].map(|cut| worst(&draw_on(&mut gpu, &smooth, &settings(cut(64))), &truth));
    println!("64 slabs: {plain:.2e}, extrapolated {fine:.2e}");
    assert!(fine < 0.2 * plain, "{plain} {fine}");
}

/// The sheet buffer against its definition and the CPU's picture.
#[test]
fn sheets_agree_with_the_definition_and_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let families: &[Family] = &[
        ("many_colours", methods::many_colours),
        ("meshes_in_gas", methods::meshes_in_gas),
        ("mixed_sets", methods::mixed_sets),
        ("inside", methods::inside),
        ("surrounded", methods::surrounded),
        ("looking_away", methods::looking_away),
        ("at_the_near_plane", methods::at_the_near_plane),
        ("subpixel", methods::subpixel),
        ("odd_sizes", methods::odd_sizes),
        ("toe_in", methods::toe_in),
        ("dense", methods::dense),
        ("far_from_the_origin", methods::far_from_the_origin),
        ("telescope", methods::telescope),
        ("meshes_seen_toed_in_and_supersampled", methods::meshes_seen_toed_in_and_supersampled),
        ("without_gas", methods::without_gas),
    ];
    for (name, family) in families {
        let (mut from_truth, mut from_cpu, mut pixels) = (0.0f64, 0.0f64, 0);
        for kernel in kernels() {
            if kernel != Kernel::Gaussian && !["many_colours", "meshes_in_gas"].contains(name) {
                continue;
            }
            for (number, scene) in family(kernel.clone()).iter().enumerate() {
                let eyes = eyes(scene);
                for (width, lookup) in [(0.21, Lookup::Interpolated), (0.9, Lookup::Nearest)] {
                    let nearest = (lookup == Lookup::Nearest).then_some(256);
                    let truths: Vec<_> = eyes
                        .iter()
                        .map(|(eye, opaque)| slices::sheet(scene, width, nearest, eye, opaque.as_ref()))
                        .collect();
                    for tolerance in [0.0, DEFAULT_TOLERANCE] {
                        let settings = Settings { method: sheet(width, lookup), tolerance, ..Settings::default() };
                        let drawn = draw_on(&mut gpu, scene, &settings);
                        let found = compare(&drawn, &truths, slices::LIMIT + tolerance);
                        let what = format!("{name} {} scene {number} {settings:?}", kernel.name());
                        slices::hold(&found, lookup, &what);
                        let twin =
                            difference(&drawn, &films(scene, &Settings { device: Device::Cpu, ..settings }), &truths);
                        assert!(twin.max <= 2e-4 + tolerance, "{what}: the CPU's picture: {twin:?}");
                        if tolerance == 0.0 {
                            from_truth = from_truth.max(found.max);
                            from_cpu = from_cpu.max(twin.max);
                        }
                        pixels += found.pixels;
                    }
                }
            }
        }
        println!("{name}: from the definition {from_truth:.2e}, from the CPU {from_cpu:.2e}, {pixels} pixels");
        assert!(pixels > 0, "{name} has no pictures");
    }
}

/// Slices so thin that a particle spans hundreds of groups, wider than everything, and thin ones far away with nothing before.
#[test]
fn slices_of_any_width_are_those_of_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let near = ball(3.0, 0.5, 0.9, 0.05);
    let mut gap = near.clone();
    gap.particles.push(set(Kernel::Constant, &[[0.0, 0.0, -1e7], [1e5, 0.0, -1.001e7]], 3e5, 0.7));
    gap.particles[1].color = Attribute::Uniform([1.0, 0.2, 0.1]);
    gap.background = [0.1, 0.2, 0.9];
    let across = ball(0.3, 0.5, 0.9, 0.25);
    let cases =
        [(&near, 1e-4), (&near, 0.003), (&near, 1e6), (&gap, 1e6), (&gap, 20.0), (&across, 0.1), (&across, 1e6)];
    for (scene, width) in cases {
        let settings = Settings { method: sheet(width, Lookup::Interpolated), tolerance: 0.0, ..Settings::default() };
        let drawn = draw_on(&mut gpu, scene, &settings);
        let off = worst(&drawn, &films(scene, &Settings { device: Device::Cpu, ..settings }));
        println!("slices {width} wide: {off:.2e}");
        assert!(off <= 1e-4, "{width}: {off}");
    }
    // More of them than can be numbered.
    let row: Vec<_> = (0..200).map(|i| [0.0, 0.0, -3.0 - 2.0 * f64::from(i)]).collect();
    let row = Scene { particles: vec![set(Kernel::Gaussian, &row, 0.5, 0.5)], ..near };
    let settings = Settings { method: sheet(2e-5, Lookup::Nearest), device: Device::Gpu(None), ..Settings::default() };
    let mut session = Session::on(&settings, gpu.take().unwrap()).unwrap();
    let error = session.draw(&row, &()).unwrap_err();
    assert!(error.exit_code() == 3 && error.to_string().contains("slice_width"), "{error}");
    *gpu = session.into_gpu();
}

/// What renderers lose that skip faint fragments or keep 16 bits of the transmittance.
#[test]
fn thin_gas_keeps_its_transmittance() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let mut random = Random::new(50);
    let centres: Vec<_> = (0..1000).map(|_| random.point([-0.3, -0.3, -2.0], [0.3, 0.3, 2.0])).collect();
    let opacity = -(-0.003f64).exp_m1();
    let color = centres.iter().map(|_| random.color(1.0)).collect();
    let gas = ParticleSet { color: Attribute::Each(color), ..set(Kernel::Gaussian, &centres, 1.5, opacity) };
    let thin = scene(camera([0.0, 0.0, 9.0], [0.0; 3], 12.0, [10, 7]), rig(0.1, Some(9.0)), vec![gas]);
    let settings = |method| Settings { method, ..Settings::default() };
    let truth = films(&thin, &settings(Method::Reference(reference::Parameters::DEFAULT)));
    let least = truth[0].transmittance.iter().copied().fold(1.0, f32::min);
    assert!((0.05..0.2).contains(&least), "{least}");
    let off = |gpu: &mut Shared, method, path, truth: &[Film]| {
        let drawn = draw_on(gpu, &thin, &Settings { gpu_path: Some(path), ..settings(method) });
        let pairs = drawn.iter().zip(truth).flat_map(|(a, b)| a.transmittance.iter().zip(&b.transmittance));
        let worst = pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
        println!("{} by {}: transmittance off by at most {worst:.2e}", method.name(), path.name());
        worst
    };
    let ways = [
        (Method::Perspective, GpuPath::Compute),
        (Method::Perspective, GpuPath::Raster),
        (slabs(64), GpuPath::Compute),
    ];
    for (method, path) in ways {
        assert!(off(&mut gpu, method, path, &truth) <= 1e-3, "{method:?}");
    }
    // The others are no projections of balls: what they show is the CPU's, whose own truth is tested elsewhere.
    for method in [Method::Viewplane, Method::Viewpoint] {
        let cpu = films(&thin, &Settings { tolerance: 0.0, device: Device::Cpu, ..settings(method) });
        for path in PATHS {
            assert!(off(&mut gpu, method, path, &cpu) <= 1e-3, "{method:?}");
            let drawn = draw_on(&mut gpu, &thin, &Settings { gpu_path: Some(path), ..settings(method) });
            for (a, b) in drawn.iter().zip(&cpu).flat_map(|(a, b)| planes(a).zip(planes(b))) {
                assert!((a - b).abs() <= 2e-3, "{method:?} by {}: {a} {b}", path.name());
            }
        }
        // What 16 bits lose depends on how the device rounds; never all of the gas.
        assert!(off(&mut gpu, method, GpuPath::RasterF16, &cpu) <= 0.5, "{method:?}");
    }
}

#[test]
fn the_bytes_are_the_same_from_run_to_run() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let ways = [
        (Method::Viewplane, GpuPath::Compute),
        (Method::Perspective, GpuPath::Compute),
        (slabs(20), GpuPath::Compute),
        (richardson(20), GpuPath::Compute),
        (sheet(0.1, Lookup::Interpolated), GpuPath::Compute),
        (sheet(0.1, Lookup::Nearest), GpuPath::Compute),
        (Method::Viewplane, GpuPath::Raster),
        (Method::Viewpoint, GpuPath::Raster),
        (Method::Perspective, GpuPath::RasterF16),
    ];
    for (method, path) in ways {
        let settings = Settings { method, gpu_path: Some(path), ..Settings::default() };
        for scene in methods::dense(Kernel::Gaussian).iter().chain(&methods::meshes_in_gas(Kernel::Linear)) {
            let first = bits(&draw_on(&mut gpu, scene, &settings));
            for threads in [1, 3] {
                let again = draw_on(&mut gpu, scene, &Settings { threads: Some(threads), ..settings.clone() });
                assert_eq!(bits(&again), first, "{method:?}");
            }
        }
    }
}

/// A session's next frame and why its particles were listed on the CPU, where they were.
fn next_listed(session: &mut Session, scene: &Scene) -> (Vec<Film>, Option<String>) {
    let rendering = session.draw(scene, &()).unwrap();
    let why = rendering.statistics.plan.into_iter().find(|line| line.starts_with("Particles listed on the CPU"));
    (rendering.films, why)
}

/// A session of one's own device that lists particles there.
fn listing(settings: &Settings, grade: Grade) -> Option<Session> {
    let mut gpu = open(grade)?;
    gpu.set_lists(Lists::Gpu);
    Some(Session::on(settings, gpu).unwrap())
}

fn by_compute(method: Method) -> Settings {
    Settings { method, tolerance: 0.0, gpu_path: Some(GpuPath::Compute), ..Settings::default() }
}

#[test]
fn lists_of_the_device_are_the_same_from_run_to_run() {
    for method in [Method::Viewplane, Method::Viewpoint, Method::Perspective, METHODS[3].0] {
        let settings = Settings { tolerance: DEFAULT_TOLERANCE, ..by_compute(method) };
        for scene in methods::dense(Kernel::Gaussian).iter().chain(&methods::meshes_in_gas(Kernel::Linear)) {
            let Some(mut session) = listing(&settings, Grade::Full) else { return };
            let (first, why) = next_listed(&mut session, scene);
            assert_eq!(why, None);
            assert_eq!(bits(&next_listed(&mut session, scene).0), bits(&first));
            let one = Settings { threads: Some(1), ..settings.clone() };
            let mut session = Session::on(&one, session.into_gpu().unwrap()).unwrap();
            assert_eq!(bits(&next_listed(&mut session, scene).0), bits(&first), "{method:?}");
            // With the limits of every device.
            let Some(mut least) = listing(&settings, Grade::LeastLimits) else { return };
            assert_eq!(bits(&next_listed(&mut least, scene).0), bits(&first), "{method:?}");
        }
    }
}

/// Particles stay on the device while they are the same; whatever changes is seen in the next frame.
#[test]
fn what_is_kept_on_the_device_is_never_old() {
    let settings = by_compute(Method::Perspective);
    let base = methods::many_colours(Kernel::Linear).remove(0);
    let Some(mut session) = listing(&settings, Grade::Full) else { return };
    next_listed(&mut session, &base);
    let changes: [fn(&mut Scene); 9] = [
        |scene| scene.camera.position.x += 0.25,
        |scene| scene.particles[0].x[77] += 1e-3,
        |scene| scene.particles[0].z[3] -= 0.5,
        |scene| scene.particles[0].radius = Attribute::Uniform(0.4),
        |scene| scene.particles[0].opacity = Attribute::Uniform(0.3),
        |scene| scene.particles[0].color = Attribute::Uniform([0.9, 0.3, 0.1]),
        |scene| scene.particles[0].kernel = Kernel::Constant,
        |scene| scene.particles.push(scene.particles[0].clone()),
        |scene| scene.particles.clear(),
    ];
    let mut scene = base;
    let mut before = Vec::new();
    for change in changes {
        change(&mut scene);
        let (found, why) = next_listed(&mut session, &scene);
        assert_eq!(why, None);
        let mut fresh = listing(&settings, Grade::Full).unwrap();
        assert_eq!(bits(&found), bits(&next_listed(&mut fresh, &scene).0));
        assert_ne!(bits(&found), before, "the change is not seen");
        before = bits(&found);
    }
    // The opacity model is part of what is uploaded.
    let scene = methods::many_colours(Kernel::Linear).remove(0);
    next_listed(&mut session, &scene);
    let linear = Settings { opacity_model: OpacityModel::Linear, ..settings };
    let mut session = Session::on(&linear, session.into_gpu().unwrap()).unwrap();
    let mut fresh = listing(&linear, Grade::Full).unwrap();
    assert_eq!(bits(&next_listed(&mut session, &scene).0), bits(&next_listed(&mut fresh, &scene).0));
}

/// What the device cannot list is listed on the CPU, with the same picture, and told.
#[test]
fn what_the_device_cannot_list_is_listed_on_the_cpu() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let settings = by_compute(Method::Viewplane);
    let mut falls_back = |session: &mut Session, scene: &Scene, words: &str| {
        let (found, why) = next_listed(session, scene);
        assert!(why.as_ref().is_some_and(|why| why.contains(words)), "{words}: {why:?}");
        let others = draw_on(&mut gpu, scene, &settings);
        let pairs = found.iter().zip(&others).flat_map(|(a, b)| planes(a).zip(planes(b)));
        let worst = pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst < 1e-6, "{words}: {worst}");
    };
    let Some(mut session) = listing(&settings, Grade::Full) else { return };
    // At the near plane itself: on which side, rounding decides.
    let ahead = Camera { near: 1.0, up: DVec3::Y, ..camera([0.0, 0.0, 1.0], [0.0, 0.0, -3.0], 60.0, [32, 24]) };
    let gas = set(Kernel::Gaussian, &[[0.1, 0.0, 0.0], [0.0, 0.2, -2.0]], 0.5, 0.5);
    falls_back(&mut session, &scene(ahead.clone(), None, vec![gas.clone()]), "near plane");
    // Volumetric methods cut there, whatever the side.
    let volumetric = by_compute(METHODS[3].0);
    let mut other = listing(&volumetric, Grade::Full).unwrap();
    assert_eq!(next_listed(&mut other, &scene(ahead, None, vec![gas])).1, None);
    // Lengths that single precision has no room for.
    for size in [1e-30, 1e30] {
        let centres = [[0.0; 3], [size, 0.0, 0.0], [0.0, 0.5 * size, size]];
        let gas = set(Kernel::Gaussian, &centres, 0.4 * size, 0.5);
        let far = Camera { near: 0.01 * size, ..camera([0.0, 0.0, 4.0 * size], [0.0; 3], 50.0, [24, 18]) };
        falls_back(&mut session, &scene(far, None, vec![gas]), "no room");
    }
    // Too many tiles in all for the buffers, though the particles fit.
    let mut small = open(Grade::LeastLimits).unwrap();
    small.lower_most_bytes(1 << 18);
    small.set_lists(Lists::Gpu);
    let mut session = Session::on(&settings, small).unwrap();
    let gas = set(Kernel::Gaussian, &vec![[0.0; 3]; 1200], 5.0, 1e-3);
    let full = camera([0.0, 0.0, 3.0], [0.0; 3], 10.0, [128, 128]);
    falls_back(&mut session, &scene(full, None, vec![gas]), "tiles");
    // Buffers too small for the particles.
    let mut small = open(Grade::LeastLimits).unwrap();
    small.lower_most_bytes(0);
    small.set_lists(Lists::Gpu);
    let mut session = Session::on(&settings, small).unwrap();
    let gas = cloud(800).draw(&mut Random::new(71), Kernel::Gaussian);
    let gas = ParticleSet { opacity: Attribute::Uniform(0.01), ..gas };
    let many = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [67, 50]), None, vec![gas]);
    falls_back(&mut session, &many, "buffers");
    // Too many kinds, most of them without particles.
    let mut sets = vec![set(Kernel::Gaussian, &[], 0.5, 0.5); 6000];
    sets.push(cloud(20).draw(&mut Random::new(75), Kernel::Gaussian));
    let kinds = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [32, 24]), None, sets);
    falls_back(&mut session, &kinds, "CPU: its buffers");
    // Too many tiles in the upper of two stretches of rows.
    let mut small = open(Grade::LeastLimits).unwrap();
    small.lower_most_bytes(1 << 18);
    small.set_lists(Lists::Gpu);
    let mut upper = Session::on(&settings, small).unwrap();
    let gas = set(Kernel::Gaussian, &vec![[0.0, 0.51, 0.0]; 1200], 0.5, 1e-3);
    let high = scene(camera([0.0, 0.0, 3.0], [0.0; 3], 10.0, [128, 256]), None, vec![gas]);
    falls_back(&mut upper, &high, "CPU for 1 of 2 stretches of rows: they reach into too many tiles");
    // Fewer particles fit, in stretches of rows with lists of their own.
    let gas = cloud(150).draw(&mut Random::new(72), Kernel::Gaussian);
    let tall = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [67, 150]), rig(0.3, Some(5.0)), vec![gas]);
    let (found, why) = next_listed(&mut session, &tall);
    assert_eq!(why, None);
    for (a, b) in found.iter().zip(&draw_on(&mut gpu, &tall, &settings)) {
        assert!(planes(a).zip(planes(b)).all(|(a, b)| (a - b).abs() < 1e-5));
    }
}

/// Clouds far from the origin, far from each other, and with many particles.
#[test]
fn lists_of_the_device_hold_in_large_scenes() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let mut random = Random::new(73);
    let shift = [3.0e8, -1.0e8, 2.0e8];
    let there = |p: [f64; 3]| [p[0] + shift[0], p[1] + shift[1], p[2] + shift[2]];
    let base = cloud(200);
    let far = Gas { low: there(base.low), high: there(base.high), ..base }.draw(&mut random, Kernel::Gaussian);
    let camera_there = camera(there([1.0, 2.0, 6.0]), there([0.0, 0.3, 0.0]), 45.0, [64, 48]);
    // A second cloud a million times as far away as it is large, which moves the middle.
    let mut two = cloud(200).draw(&mut random, Kernel::Gaussian);
    two.x[0] += 1e6;
    two.y[1] -= 3e6;
    let many = Gas { radius: [0.005, 0.03], opacity: [0.0, 0.3], ..cloud(20_000) }.draw(&mut random, Kernel::Gaussian);
    let here = camera([1.0, 2.0, 6.0], [0.0, 0.3, 0.0], 45.0, [64, 48]);
    for (name, scene) in [
        ("far", scene(camera_there, rig(0.3, Some(5.0)), vec![far])),
        ("two", scene(here.clone(), rig(0.3, Some(5.0)), vec![two])),
        ("many", scene(here, rig(0.3, Some(5.0)), vec![many])),
    ] {
        for (method, _) in METHODS.iter().take(4) {
            let settings = by_compute(*method);
            let (found, on_device) = draw_listed(&mut gpu, &scene, &settings);
            assert!(on_device, "{name}");
            let others = draw_on(&mut gpu, &scene, &settings);
            let pairs = found.iter().zip(&others).flat_map(|(a, b)| planes(a).zip(planes(b)));
            let worst = pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
            println!("{name}, {}: {worst:.2e} from lists of the CPU", method.name());
            assert!(worst < 1e-4, "{name} {method:?}: {worst}");
        }
    }
}

/// More particles and more rows than fit into a buffer.
#[test]
fn small_buffers_give_the_same_picture() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let Some(mut small) = open(Grade::LeastLimits) else { return };
    small.lower_most_bytes(0);
    assert_eq!(small.most_bytes(), 1 << 16);
    let gas = Gas { radius: [0.05, 0.3], ..cloud(3000) }.draw(&mut Random::new(51), Kernel::Gaussian);
    let gas = ParticleSet { opacity: Attribute::Uniform(0.01), ..gas };
    let mut tall = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 45.0, [67, 150]), rig(0.3, Some(5.0)), vec![gas]);
    tall.meshes = vec![crate_mesh([0.3, 0.2, 0.4], 0.7)];
    let mut small = Some(small);
    let ways = [Method::Viewplane, Method::Viewpoint, Method::Perspective].map(|m| PATHS.map(|path| (m, path)));
    // A table that fits into the buffers, and so do the particles of eight slabs or slices.
    let parameters = sheet::Parameters { slice_width: Some(0.02), segments: 32, ..sheet::Parameters::DEFAULT };
    let computed = [slabs(300), richardson(300), Method::Sheet(parameters)].map(|method| (method, GpuPath::Compute));
    for (method, path) in ways.into_iter().flatten().chain(computed) {
        // What fails is an error, and not the CPU's picture.
        let device = Device::Gpu(None);
        let settings = Settings { method, tolerance: 0.0, device, gpu_path: Some(path), ..Settings::default() };
        let whole = draw_on(&mut gpu, &tall, &settings);
        let mut session = Session::on(&settings, small.take().unwrap()).unwrap();
        let pieces = session.draw(&tall, &()).unwrap().films;
        small = session.into_gpu();
        // Thin slabs divide small differences of transmittances, which round differently in pieces.
        let room = if let Method::Slab(_) = method { 5e-5 } else { 1e-6 };
        for (a, b) in whole.iter().zip(&pieces) {
            for (a, b) in planes(a).zip(planes(b)) {
                assert!((a - b).abs() < room, "{method:?}: {a} {b}");
            }
        }
    }
    // What does not fit is an error: a table, the particles of eight slabs.
    let long = Method::Sheet(sheet::Parameters { segments: 4096, ..sheet::Parameters::DEFAULT });
    for (method, what) in [(long, "tables"), (slabs(1), "eight slabs")] {
        let settings = Settings { method, device: Device::Gpu(None), ..Settings::default() };
        let mut session = Session::on(&settings, small.take().unwrap()).unwrap();
        let error = session.draw(&tall, &()).unwrap_err();
        assert!(error.exit_code() == 3 && error.to_string().contains(what), "{error}");
        small = session.into_gpu();
    }
}

fn planes(film: &Film) -> impl Iterator<Item = f32> {
    film.color.iter().chain([&film.transmittance]).flatten().copied()
}

/// More particles in a tile than a software driver goes through at once.
#[test]
fn long_lists_are_gone_through() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gas = Gas { low: [-0.2; 3], high: [0.2; 3], radius: [0.02, 0.06], opacity: [0.0, 1e-3], ..cloud(70_000) }
        .draw(&mut Random::new(53), Kernel::Gaussian);
    let long = scene(camera([0.0, 0.0, 6.0], [0.0; 3], 5.0, [3, 2]), None, vec![gas]);
    let settings = Settings { method: Method::Perspective, tolerance: 0.0, ..Settings::default() };
    let cpu = films(&long, &Settings { device: Device::Cpu, ..settings.clone() });
    for path in PATHS {
        let drawn = draw_on(&mut gpu, &long, &Settings { gpu_path: Some(path), ..settings.clone() });
        for (a, b) in planes(&drawn[0]).zip(planes(&cpu[0])) {
            assert!((a - b).abs() < 1e-3, "{}: {a} {b}", path.name());
        }
    }
    // Slabs of too many particles may be more than the driver goes through: then it is an error.
    let method = slabs(1);
    let settings = Settings { method, device: Device::Gpu(None), ..settings };
    let mut session = Session::on(&settings, gpu.take().unwrap()).unwrap();
    if let Err(error) = session.draw(&long, &()) {
        assert_eq!(error.exit_code(), 3, "{error}");
    }
    *gpu = session.into_gpu();
}

/// With what every WebGPU device has, as wide as every one of them can.
#[test]
fn the_least_limits_are_enough() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let Some(least) = open(Grade::LeastLimits) else { return };
    assert_eq!(least.most_bytes(), 128 << 20);
    let gas = Gas { radius: [0.05, 0.2], ..cloud(40) }.draw(&mut Random::new(52), Kernel::Linear);
    let wide = scene(camera([0.0, 0.0, 6.0], [0.0; 3], 0.05, [16384, 3]), None, vec![gas]);
    // In stereo, beside each other or each eye alone, and wider than a texture.
    let pair = Scene { stereo: rig(0.01, Some(6.0)), ..wide.clone() };
    let narrow = Scene { camera: camera([0.0, 0.0, 6.0], [0.0; 3], 0.05, [6000, 5]), ..pair.clone() };
    let mut least = Some(least);
    let ways =
        [&wide, &pair, &narrow].into_iter().flat_map(|scene| PATHS.map(|path| (scene, path, Method::Perspective)));
    let computed = [sheet(0.05, Lookup::Interpolated), richardson(40)].map(|method| (&pair, GpuPath::Compute, method));
    for (scene, path, method) in ways.chain(computed) {
        let settings = Settings { method, gpu_path: Some(path), ..Settings::default() };
        let mut session = Session::on(&settings, least.take().unwrap()).unwrap();
        let drawn = session.draw(scene, &()).unwrap();
        least = session.into_gpu();
        assert!(drawn.statistics.stages.iter().any(|(name, _)| *name == "read back"));
        assert!(drawn.statistics.fragments > 0);
        assert_eq!(bits(&drawn.films), bits(&draw_on(&mut gpu, scene, &settings)));
        let cpu = films(scene, &Settings { device: Device::Cpu, ..settings });
        for (a, b) in drawn.films.iter().zip(&cpu) {
            assert!(planes(a).zip(planes(b)).all(|(a, b)| (a - b).abs() < 2e-3), "{}", path.name());
        }
    }
}

/// Without 32-bit blending there is no raster, unless 16 bits are asked for.
#[test]
fn a_gpu_that_cannot_blend_says_so_and_computes() {
    let scene = &methods::many_colours(Kernel::Gaussian)[0];
    let Some(gpu) = open(Grade::Least) else { return };
    let settings = Settings { method: Method::Viewplane, device: Device::Gpu(None), ..Settings::default() };
    let mut session = Session::on(&settings, gpu).unwrap();
    let drawn = session.draw(scene, &()).unwrap();
    assert_eq!(drawn.gpu_path, Some(GpuPath::Compute));
    let plan = drawn.statistics.plan.join(" ");
    assert!(plan.contains("compute") && plan.contains("32 bits"), "{plan}");
    let half = Settings { gpu_path: Some(GpuPath::RasterF16), ..settings.clone() };
    let mut session = Session::on(&half, session.into_gpu().unwrap()).unwrap();
    assert_eq!(session.draw(scene, &()).unwrap().gpu_path, Some(GpuPath::RasterF16));
    let whole = Settings { gpu_path: Some(GpuPath::Raster), ..settings };
    let Err(error) = Session::on(&whole, session.into_gpu().unwrap()) else { panic!("it blends") };
    assert_eq!(error.exit_code(), 3);
    assert!(error.to_string().contains("--gpu-path compute"), "{error}");
}

/// The paths' speeds in a file: made, used, and made anew where it says nothing.
#[test]
fn the_faster_path_is_kept_in_a_file() {
    let Some(_gpu) = gpu_or_skip() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("made/on/the/way.json");
    let scene = &methods::many_colours(Kernel::Gaussian)[0];
    let drawn = |file: &std::path::Path, method| {
        let calibration = Some(file.to_path_buf());
        let settings = Settings { method, device: Device::Gpu(None), calibration, ..Settings::default() };
        let mut session = Session::on(&settings, open(Grade::Full).unwrap()).unwrap();
        let rendering = session.draw(scene, &()).unwrap();
        (rendering.gpu_path.unwrap(), rendering.statistics.plan.join(" "))
    };
    // Methods with one path ask nothing.
    assert_eq!(drawn(&file, slabs(4)), (GpuPath::Compute, String::new()));
    assert!(!file.exists());
    let (path, words) = drawn(&file, Method::Viewpoint);
    let kept = std::fs::read_to_string(&file).unwrap();
    let value: serde_json::Value = serde_json::from_str(&kept).unwrap();
    let [(key, speeds)] = value.as_object().unwrap().iter().collect::<Vec<_>>()[..] else { panic!("{kept}") };
    assert!(key.to_lowercase().contains(&name().to_lowercase()) && key.ends_with(env!("CARGO_PKG_VERSION")), "{key}");
    let ms = |name: &str| speeds[name].as_f64().unwrap();
    assert!(ms("compute_ms") > 0.0 && ms("raster_ms") > 0.0, "{kept}");
    assert_eq!(path == GpuPath::Raster, ms("raster_ms") < ms("compute_ms"), "{kept}");
    assert!(words.contains(&format!("Drawn by {}: ", path.name())), "{words}");
    // What is there is taken at its word.
    for (numbers, path) in [([1.5, 2.5], GpuPath::Compute), ([2.5, 1.5], GpuPath::Raster)] {
        let known = serde_json::json!({ key: { "compute_ms": numbers[0], "raster_ms": numbers[1] }, "other": speeds });
        std::fs::write(&file, known.to_string()).unwrap();
        let (found, words) = drawn(&file, Method::Viewplane);
        assert_eq!(found, path);
        assert!(words.contains("1.5 ms") && words.contains("2.5 ms"), "{words}");
        assert_eq!(std::fs::read_to_string(&file).unwrap(), known.to_string(), "read alone");
    }
    // What says nothing is measured anew.
    let wrong = serde_json::json!({ key: { "compute_ms": -1.0, "raster_ms": 0.0 } }).to_string();
    for text in ["", "{", "[]", "\u{0}\u{1}", &kept[..kept.len() / 2], &wrong, &wrong.replace("-1.0", "null")] {
        std::fs::write(&file, text).unwrap();
        drawn(&file, Method::Viewplane);
        let again: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        assert!(again[key]["compute_ms"].as_f64().unwrap() > 0.0, "{text}: {again}");
    }
    // Where nothing can be written, nothing is: a folder, and a place below a file.
    drawn(folder.path(), Method::Viewplane);
    drawn(&file.join("below"), Method::Viewplane);
    let one: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(one.len(), 1);
}

// ---- What goes wrong

#[test]
fn a_lost_device_is_an_error_and_never_a_picture() {
    let scene = &methods::many_colours(Kernel::Gaussian)[0];
    let devices = [Device::Gpu(Some(name())), Device::Auto];
    for (device, path) in devices.iter().flat_map(|device| PATHS.map(|path| (device.clone(), path))) {
        let Some(gpu) = open(Grade::Full) else { return };
        let gpu_path = Some(path);
        let settings = Settings { method: Method::Viewplane, device: device.clone(), gpu_path, ..Settings::default() };
        let mut session = Session::on(&settings, gpu).unwrap();
        session.draw(scene, &()).unwrap();
        session.gpu().unwrap().destroy();
        let outcome = session.draw(scene, &());
        match device {
            Device::Gpu(_) => {
                let error = outcome.unwrap_err();
                assert_eq!(error.exit_code(), 3);
                assert!(error.to_string().contains("--device cpu"), "{error}");
                assert!(session.draw(scene, &()).is_err(), "it comes back");
            }
            Device::Auto | Device::Cpu => {
                let rendering = outcome.unwrap();
                assert!(rendering.warning.is_some_and(|text| text.contains("drawn on the CPU")));
                assert!(rendering.device.starts_with("CPU"));
                let cpu = films(scene, &Settings { device: Device::Cpu, ..settings });
                assert_eq!(bits(&rendering.films), bits(&cpu));
            }
        }
    }
}

/// Set for the process of [`task`]: the folder of its scene.
const TASK: &str = "STEREOMIST_TEST_LOST";

/// What the test below does in a process of its own, whose stderr it reads.
#[test]
#[ignore = "run by a_gpu_that_fails_under_auto_is_a_warning"]
fn task() {
    #[derive(clap::Parser)]
    struct Arguments {
        #[command(flatten)]
        render: stereomist::cli::render::RenderArgs,
    }
    let folder = std::path::PathBuf::from(std::env::var_os(TASK).unwrap());
    let arguments = ["render", "--json", "--method", "viewplane", "-o"].map(std::ffi::OsString::from);
    let arguments = arguments.into_iter().chain([folder.join("out").into(), folder.join("scene.toml").into()]);
    let render = <Arguments as clap::Parser>::parse_from(arguments).render;
    let code = render.run_on(|settings| {
        assert_eq!(settings.device, Device::Auto);
        let gpu = open(Grade::Full).unwrap();
        gpu.destroy();
        Session::on(settings, gpu)
    });
    assert_eq!(code.unwrap(), 0);
}

#[test]
fn a_gpu_that_fails_under_auto_is_a_warning() {
    if gpu_or_skip().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = "[camera]\nposition = [0.0, 0.0, 5.0]\nlook_at = [0.0, 0.0, 0.0]\nsize = [16, 12]\n\
                 [[particles]]\nradius = 1.0\nbox = { min = [-1.0, -1.0, -1.0], max = [1.0, 1.0, 1.0], count = 5 }\n";
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let run = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "gpu::task", "--ignored", "--nocapture", "--test-threads=1"])
        .env(TASK, folder.path())
        .env("NODEVICE_SELECT", "1")
        .output()
        .unwrap();
    let errors = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.success(), "{errors}");
    let [warning] = errors.lines().collect::<Vec<_>>()[..] else { panic!("{errors}") };
    assert!(warning.starts_with("warning: drawn on the CPU: the GPU "), "{warning}");
    let record = std::fs::read(folder.path().join("out/scene.json")).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    assert!(record["device"].as_str().unwrap().starts_with("CPU"), "{record}");
    assert!(record["notes"].as_array().unwrap().iter().any(|note| warning.contains(note.as_str().unwrap())));
}

#[test]
fn methods_without_a_gpu_path_say_so() {
    for method in [Method::Auto, Method::Reference(reference::Parameters::DEFAULT)] {
        let settings = Settings { method, device: Device::Gpu(None), ..Settings::default() };
        let Err(error) = Session::new(&settings) else { panic!("{method:?} has one") };
        assert!(matches!(error, Error::Device(_)));
        let text = error.to_string();
        for word in [method.name(), "viewplane, viewpoint, perspective, spherical, sheet, slab", "--device cpu"] {
            assert!(text.contains(word), "{text}");
        }
    }
    let computed = [Method::Sheet(sheet::Parameters::DEFAULT), Method::Slab(slab::Parameters::DEFAULT)];
    for (method, path) in computed.iter().flat_map(|m| [GpuPath::Raster, GpuPath::RasterF16].map(|path| (*m, path))) {
        let device = Device::Gpu(None);
        let settings = Settings { method, device, gpu_path: Some(path), ..Settings::default() };
        let error = Session::new(&settings).err().unwrap();
        assert_eq!(error.exit_code(), 3);
        for word in [method.name(), path.name(), "viewplane, viewpoint, perspective, spherical", "--gpu-path auto"] {
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}

#[test]
fn devices_have_names() {
    assert_eq!(Device::from_name("auto").unwrap(), Device::Auto);
    assert_eq!(Device::from_name("CPU").unwrap(), Device::Cpu);
    assert_eq!(Device::from_name("gpu").unwrap(), Device::Gpu(None));
    assert_eq!(Device::from_name("gpu:").unwrap(), Device::Gpu(None));
    assert_eq!(Device::from_name("Gpu:GeForce RTX").unwrap(), Device::Gpu(Some("GeForce RTX".into())));
    for wrong in ["", "cpu:", "auto:x", "vulkan", "gpux", "llvmpipe"] {
        assert_eq!(Device::from_name(wrong).unwrap_err().exit_code(), 2, "{wrong}");
    }
    let error = adapter::choose(Some("no such adapter")).err().unwrap();
    assert_eq!(error.exit_code(), 3);
}

#[test]
fn paths_have_names() {
    assert_eq!(GpuPath::from_name("auto").unwrap(), None);
    for path in GpuPath::ALL {
        assert_eq!(GpuPath::from_name(&path.name().to_uppercase()).unwrap(), Some(*path));
    }
    for wrong in ["", "raster-f32", "rasterf16", "gpu", " raster"] {
        let error = GpuPath::from_name(wrong).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{wrong}");
        assert!(error.to_string().contains("auto, compute, raster, raster-f16"), "{error}");
    }
}

#[test]
fn software_drivers_are_used_by_name_alone() {
    let Some(_gpu) = gpu_or_skip() else { return };
    let found = adapter::choose(Some(&name().to_uppercase())).unwrap();
    if found.class == Class::Software {
        assert!(
            adapter::choose(None).is_ok_and(|other| other.class != Class::Software) || adapter::choose(None).is_err()
        );
    }
    assert!(found.describe().contains(&found.name));
}

// ---- Functions against their definitions

fn check(parts: &[Part], expression: &str, tables: &[f32], cases: &[([f64; 4], f64)], limit: f64) {
    let Some(gpu) = gpu_or_skip() else { return };
    let inputs: Vec<[f32; 4]> = cases.iter().map(|(input, _)| input.map(|v| v as f32)).collect();
    let found = gpu.as_ref().unwrap().evaluate(parts, expression, tables, &inputs).unwrap();
    let mut worst = (0.0, 0);
    for (i, (value, (_, truth))) in found.iter().zip(cases).enumerate() {
        let off = (f64::from(*value) - truth).abs();
        assert!(off.is_finite(), "{expression}: {value} at {:?}", cases[i].0);
        if off > worst.0 {
            worst = (off, i);
        }
    }
    println!("{expression}: {:.2e}", worst.0);
    assert!(worst.0 <= limit, "{expression}: off by {} at {:?}", worst.0, cases[worst.1]);
}

/// Numbers from 0 to 1, both ends included.
fn unit(count: usize) -> impl Iterator<Item = f64> {
    (0..=count).map(move |i| i as f64 / count as f64)
}

#[test]
fn footprints_are_those_of_the_kernels() {
    let balls: Vec<_> = unit(500).map(|u| ([1.0 - u * u, 0.0, 0.0, 0.0], Kernel::Gaussian.footprint(u))).collect();
    check(&[shader::FOOTPRINT], "gaussian_ball(v.x)", &[], &balls, 2e-5);
    check(&[shader::FOOTPRINT], "gaussian_ball(v.x)", &[], &[([-0.5, 0.0, 0.0, 0.0], 0.0)], 0.0);
    let squares: Vec<_> = unit(30)
        .flat_map(|a| unit(30).map(move |b| (1.1 * a, 1.1 * b)))
        .filter(|(a, b)| (a - 1.0).abs() > 1e-3 && (b - 1.0).abs() > 1e-3)
        .map(|(a, b)| ([a * a, b * b, 0.0, 0.0], Kernel::Gaussian.billboard(a, b)))
        .collect();
    check(&[shader::FOOTPRINT], "gaussian_square(v.x, v.y)", &[], &squares, 1e-5);
    let mut tables = Tables::default();
    for kernel in kernels().into_iter().filter(|kernel| *kernel != Kernel::Gaussian) {
        let table = tables.table(&kernel);
        let expression = format!("tabulated(v.x, {}u, {:?}, 3.0e38)", table.start(), table.intervals());
        let mut cases: Vec<_> = unit(2000).map(|u| ([u * u, 0.0, 0.0, 0.0], kernel.footprint(u))).collect();
        // At the rim F has a vertical tangent: rounding of u^2 is worth 3e-4 there.
        cases.push(([1.7, 0.0, 0.0, 0.0], 0.0));
        check(&[shader::FOOTPRINT], &expression, tables.values(), &cases, 4e-4);
    }
}

#[test]
fn opacities_are_those_of_the_models() {
    let cases: Vec<_> = (-60..40)
        .map(|i| 1.3f64.powi(i))
        .map(|x| ([x, 0.0, 0.0, 0.0], -(-f64::from(x as f32) * std::f64::consts::LN_2).exp_m1()))
        .collect();
    check(&[shader::EXPONENTIAL], "opacity(v.x)", &[], &cases, 2e-6);
    // Thin gas, relative to itself.
    let thin: Vec<_> = cases
        .iter()
        .filter(|(input, _)| input[0] < 0.3)
        .map(|&(input, truth)| ([input[0], truth, 0.0, 0.0], 1.0))
        .collect();
    check(&[shader::EXPONENTIAL], "opacity(v.x) / v.y", &[], &thin, 1e-6);
    check(&[shader::LINEAR], "opacity(v.x)", &[], &[([0.25, 0.0, 0.0, 0.0], 0.25)], 0.0);
}

#[test]
fn pieces_of_chords_are_those_of_the_falloffs() {
    let mut printed = Vec::new();
    let mut integrated = Vec::new();
    for b in unit(20) {
        for from in [-9.0, -0.9, -0.3, 0.0, 0.4, 2.0] {
            for to in [-2.0, -0.5, 0.0, 0.2, 0.8, 9.0] {
                let input = [b * b, from, to, 0.0];
                let half = (1.0 - b * b).max(0.0).sqrt();
                let length = (f64::min(to, half) - f64::max(from, -half)).max(0.0);
                printed.push((input, (1.0 - b) * length * 0.5));
                integrated.push((input, Kernel::Linear.segment(b, from, to)));
            }
        }
    }
    check(&[shader::PRINTED], "piece(v.x, v.y, v.z)", &[], &printed, 2e-6);
    check(&[shader::INTEGRATED], "piece(v.x, v.y, v.z)", &[], &integrated, 2e-5);
}

#[test]
fn primitives_are_those_of_the_kernels() {
    let cases = |kernel: &Kernel, scale: f64| -> Vec<([f64; 4], f64)> {
        let points = unit(20).flat_map(|b| unit(20).map(move |at| (b, at)));
        points
            .map(|(b, at)| {
                let u = (2.0 * at - 1.0) * (1.0 - b * b).max(0.0).sqrt();
                let truth = kernel.segment(b, f64::min(0.0, u), f64::max(0.0, u)) * u.signum() * scale;
                ([b * b, u, 0.0, 0.0], truth)
            })
            .collect()
    };
    check(&[shader::BELL], "gaussian_primitive(v.x, v.y)", &[], &cases(&Kernel::Gaussian, 1.0), 1e-6);
    check(&[shader::BELL], "beliaev_primitive(v.x, v.y)", &[], &cases(&Kernel::Beliaev, 1.0), 1e-6);
    check(&[shader::POLYNOMIAL], "constant_primitive(v.y)", &[], &cases(&Kernel::Constant, 1.0), 1e-6);
    check(&[shader::POLYNOMIAL], "poly_primitive(v.x, v.y)", &[], &cases(&Kernel::Poly, 1.0), 1e-6);
    for kernel in kernels() {
        let mut shells = Vec::new();
        let [kind, first, count] = Shape::new(&kernel, &mut shells).numbers();
        if kind == 4 {
            // Profiles are scaled to an integral of 1 through the centre.
            let scale = primitive::centre(&kernel) / kernel.chord(0.0);
            let tables: Vec<f32> = shells.iter().flat_map(Shell::numbers).collect();
            let expression = format!("shells_primitive(v.x, v.y, {first}u, {count}u)");
            check(&[shader::SHELLS], &expression, &tables, &cases(&kernel, scale), 1e-5);
        }
    }
}

#[test]
fn segments_are_those_of_the_kernels() {
    let count = 256;
    for kernel in kernels() {
        // A table ahead of it, as of another kernel.
        let mut entries = vec![9.0; 7];
        entries.extend(Segments::new(&kernel, count, Lookup::Interpolated).entries());
        let at = |u: f64, t: f64| slices::share(&kernel, u, -1.0, t);
        let points = || unit(40).flat_map(|u| (0..=97).map(move |i| (u, f64::from(i) / 48.5 - 1.0)));
        let cases: Vec<_> = points().map(|(u, t)| ([u * u, t, 0.0, 0.0], at(u, t))).collect();
        let between = format!("values(7u, {count}.0, place(v.x), v.y)");
        let parts = |way| [shader::SEGMENTS, shader::lookup(way)];
        check(&parts(Lookup::Interpolated), &between, &entries, &cases, 2e-3);
        // The nearest plane, where none is as near.
        let cases: Vec<_> = points()
            .map(|(u, t)| (u, t, 0.5 * (t + 1.0) * f64::from(count)))
            .filter(|(_, _, at)| (at - at.floor() - 0.5).abs() > 1e-3)
            .map(|(u, t, plane)| ([u * u, t, 0.0, 0.0], at(u, 2.0 * plane.round() / f64::from(count) - 1.0)))
            .collect();
        check(&parts(Lookup::Nearest), &between, &entries, &cases, 2e-3);
        // Beyond the ball there is nothing.
        check(&parts(Lookup::Nearest), &between, &entries, &[([1.5, 1.0, 0.0, 0.0], 0.0)], 0.0);
    }
}

// ---- Sorting and listing

/// The order of keys by a range of their bits, of equals the lower index first.
fn order_of(keys: &[u32], bits: std::ops::Range<u32>) -> Vec<u32> {
    let mask = ((1u64 << (bits.end - bits.start)) - 1) as u32;
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.sort_by_key(|&i| keys[i as usize] >> bits.start & mask);
    order
}

#[test]
fn pairs_are_sorted_and_keep_their_order() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gpu = gpu.as_mut().unwrap();
    let mut random = Random::new(60);
    for count in [0usize, 1, 2, 255, 256, 257, 1023, 1024, 1025, 5000, 100_000] {
        for most in [1.0, 7.0, 300.0, 4_294_967_296.0] {
            let keys: Vec<u32> = (0..count).map(|_| random.uniform(0.0, most) as u32).collect();
            assert_eq!(gpu.sorted(&keys, 0..32).unwrap(), order_of(&keys, 0..32), "{count} below {most}");
        }
    }
    // Ends of the range, and parts of the keys: whole digits.
    let keys: Vec<u32> = (0..3000).map(|i| [0, u32::MAX, 1 << 31, 0xff00, 0x1_0000][i % 5]).collect();
    for bits in [0..32, 0..8, 8..24, 24..32, 0..16] {
        assert_eq!(gpu.sorted(&keys, bits.clone()).unwrap(), order_of(&keys, bits));
    }
    let falling: Vec<u32> = (0..70_000).rev().collect();
    let sorted = gpu.sorted(&falling, 0..24).unwrap();
    assert_eq!(sorted, falling);
    assert_eq!(gpu.sorted(&falling, 0..24).unwrap(), sorted);
}

#[test]
fn sums_are_exact_until_they_stop() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gpu = gpu.as_mut().unwrap();
    let mut random = Random::new(61);
    let large = 2_147_483_647.0;
    for (count, most) in
        [(0usize, 9.0), (1, 9.0), (1023, 99.0), (1024, 99.0), (1025, 99.0), (90_000, 999.0), (1_050_000, 2.0)]
            .into_iter()
            .chain([(3000, large), (1, large), (2, large), (1500, 3e6)])
    {
        let values: Vec<u32> = (0..count).map(|_| random.uniform(0.0, most) as u32).collect();
        let mut sum = 0u64;
        let before = values.iter().map(|&value| {
            let before = sum.min((1 << 31) - 1) as u32;
            sum += u64::from(value);
            before
        });
        assert!(before.eq(gpu.sums(&values).unwrap()), "{count} below {most}");
    }
}

#[test]
fn tiles_have_the_cpu_s_lists() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gpu = gpu.as_mut().unwrap();
    let mut random = Random::new(62);
    for (count, size, reach) in [
        (0, [40u32, 30], 9.0),
        (1, [1, 1], 3.0),
        (300, [1, 1], 2.0),
        (257, [640, 480], 700.0),
        (5000, [333, 97], 12.0),
        (3000, [32_768, 40], 300.0),
        (2000, [130, 2000], 40.0),
    ] {
        let view = &scene(camera([0.0, 0.0, 5.0], [0.0; 3], 60.0, size), None, Vec::new()).views()[0];
        let lens = Lens::new(view);
        let stairs: Vec<Stairs> = (0..count)
            .map(|i| {
                let mut interval = |size: u32| {
                    let first = random.uniform(0.0, f64::from(size)) as u32;
                    [first, (first + random.uniform(0.0, reach) as u32).min(size - 1)]
                };
                let (x, y) = (interval(size[0]), interval(size[1]));
                let center = random.point([-6.0, -6.0, -9.0], [6.0, 6.0, -1.0]);
                let center = DVec3::new(center[0], center[1], center[2]);
                // Some cover nothing, some everything, some are round.
                let whole = Bounds { x: [0, size[0] - 1], y: [0, size[1] - 1] };
                match i % 50 {
                    3 => Stairs::NONE,
                    4 => Stairs::new(&whole, &Rim::NONE, 0),
                    5 | 6 => Stairs::new(&lens.ball_bounds(center, 1.0), &Rim::ball(&lens, center, 1.0), 0),
                    _ => Stairs::new(&Bounds { x, y }, &Rim::NONE, 0),
                }
            })
            .collect();
        let grid = size.map(|n| n.div_ceil(bin::TILE));
        let found = gpu.tile_lists(&stairs, grid).unwrap();
        assert_eq!(found, bin::lists(&stairs, grid), "{count} in {size:?}");
        assert!(count == 0 || !found.list.is_empty());
        assert_eq!(found.list.len() as u64, stairs.iter().map(Stairs::tiles).sum::<u64>());
    }
}

/// No pixel of a round footprint is without its tile, and of large ones the corners are left out.
#[test]
fn tiles_hold_round_footprints_and_little_more() {
    let mut random = Random::new(63);
    let cameras = [
        (camera([0.0; 3], [0.0, 0.0, -1.0], 40.0, [611, 407]), rig(0.4, Some(3.0))),
        (camera([0.0; 3], [0.0, 0.0, -1.0], 130.0, [407, 611]), rig(0.1, Some(0.5))),
        (camera([0.0; 3], [0.0, 0.0, -1.0], 2.0, [1203, 45]), rig(0.1, None)),
    ];
    // By footprint: tiles that were needed, listed, and within bounds.
    let mut sums = [[0u64; 3]; 3];
    for (camera, stereo) in cameras {
        let empty = scene(camera, stereo, Vec::new());
        for view in &empty.views() {
            let lens = Lens::new(view);
            let size = view.size;
            let grid = size.map(|n| n.div_ceil(bin::TILE));
            for number in 0..120 {
                let depth = random.uniform(0.3, 9.0);
                let reach = view.half_extent * depth * 1.2;
                let c = DVec3::new(random.uniform(-reach.x, reach.x), random.uniform(-reach.y, reach.y), -depth);
                let radius = reach.min_element() * random.uniform(0.02, 1.1);
                let (card, bounds) = Card::new(&lens, c, radius, depth);
                let ball = lens.ball_bounds(c, radius);
                let whole = Bounds { x: [0, size[0] - 1], y: [0, size[1] - 1] };
                let square = radius * radius;
                // First row of the stretch.
                let first = if number % 2 == 0 { 0 } else { bin::TILE * (size[1] / 40) };
                let cases = [
                    (bounds, Rim::card(&lens, &card)),
                    (ball, Rim::ball(&lens, c, square)),
                    (if depth < 1.1 * radius { whole } else { ball }, Rim::facing(&lens, c, square)),
                ];
                for (which, (bounds, rim)) in cases.into_iter().enumerate() {
                    if bounds.is_empty() || bounds.y[1] < first {
                        continue;
                    }
                    let bounds = Bounds { x: bounds.x, y: bounds.y.map(|y| y.saturating_sub(first)) };
                    let stairs = Stairs::new(&bounds, &rim, first);
                    let listed = bin::lists(&[stairs], grid);
                    let mut needed = vec![false; (grid[0] * grid[1]) as usize];
                    for y in bounds.y[0]..=bounds.y[1] {
                        for x in bounds.x[0]..=bounds.x[1] {
                            let dir = view.direction(f64::from(x) + 0.5, f64::from(y + first) + 0.5);
                            let ahead = c.dot(dir);
                            let off = match which {
                                0 => (dir * depth - c).length_squared(),
                                1 => c.cross(dir).length_squared() / dir.length_squared(),
                                _ => (dir * (c.length_squared() / ahead) - c).length_squared(),
                            };
                            let shown = off < square && ahead > 0.0;
                            needed[(y / bin::TILE * grid[0] + x / bin::TILE) as usize] |= shown;
                        }
                    }
                    for (tile, needed) in needed.iter().enumerate() {
                        let has = listed.starts[tile + 1] > listed.starts[tile];
                        assert!(has || !needed, "{which}: tile {tile} of {grid:?}, {c} {radius} {bounds:?} {rim:?}");
                    }
                    // Balls that reach to the eye plane have no ellipse.
                    if which < 2 && radius < 0.8 * depth {
                        let within = Stairs::new(&bounds, &Rim::NONE, first).tiles();
                        let needed = needed.into_iter().filter(|&needed| needed).count() as u64;
                        for (sum, tiles) in sums[which].iter_mut().zip([needed, stairs.tiles(), within]) {
                            *sum += tiles;
                        }
                    }
                }
            }
        }
    }
    for [needed, listed, within] in &sums[..2] {
        println!("{needed} tiles are needed, {listed} listed, {within} within bounds");
        assert!(*listed as f64 <= 1.06 * *needed as f64, "{listed} for {needed}");
        assert!((*needed as f64) < 0.9 * *within as f64, "the test tells nothing");
    }
}

/// What the device lists is what the CPU lists, but for tiles that rounding decides; round billboards reach into fewer tiles than
/// square ones.
#[test]
fn round_billboards_are_listed_in_few_tiles() {
    let Some(mut gpu) = gpu_or_skip() else { return };
    let gas = || Gas { radius: [0.5, 0.9], opacity: [0.0, 0.1], ..cloud(60) };
    let size = [600, 450];
    for (method, _) in METHODS {
        let count = |gpu: &mut Shared, kernel: Kernel, lists: Lists| {
            let gas = gas().draw(&mut Random::new(64), kernel);
            let scene = scene(camera([1.0, 2.0, 6.0], [0.0; 3], 60.0, size), rig(0.3, Some(5.0)), vec![gas]);
            gpu.as_mut().unwrap().set_lists(lists);
            let mut session = Session::on(&by_compute(method), gpu.take().unwrap()).unwrap();
            let statistics = session.draw(&scene, &()).unwrap().statistics;
            let mut own = session.into_gpu().unwrap();
            own.set_lists(Lists::Cpu);
            **gpu = Some(own);
            statistics.fragments as f64
        };
        let round = [Lists::Cpu, Lists::Gpu].map(|lists| count(&mut gpu, Kernel::Linear, lists));
        let bell = [Lists::Cpu, Lists::Gpu].map(|lists| count(&mut gpu, Kernel::Gaussian, lists));
        println!("{method:?}: {round:?}, Gaussian {bell:?}");
        for [cpu, device] in [round, bell] {
            assert!((device / cpu - 1.0).abs() < 2e-3, "{method:?}: {device} for {cpu}");
        }
        if matches!(method, Method::Viewplane | Method::Viewpoint) {
            assert!(round[1] < 0.88 * bell[1], "{method:?}: {round:?}, {bell:?}");
        }
    }
}

/// Eyes with parallel axes share the order: half the keys, and each eye's picture is that of the eye alone.
#[test]
fn eyes_that_share_depth_share_the_order() {
    let parallel = rig(0.5, None);
    let gas = |seed, opacity| {
        let mut gas = cloud(900).draw(&mut Random::new(seed), Kernel::Linear);
        gas.opacity = Attribute::Uniform(opacity);
        // Some at the same depth.
        for i in (0..900).step_by(3) {
            gas.z[i] = (gas.z[i] * 8.0).round() / 8.0;
        }
        gas
    };
    let straight = |x: f64| Camera { up: DVec3::Y, ..camera([x, 0.5, 6.0], [x, 0.5, 0.0], 45.0, [160, 112]) };
    for (method, orders) in [(Method::Viewplane, 1), (METHODS[3].0, 1), (Method::Perspective, 2)] {
        let settings = by_compute(method);
        let Some(mut session) = listing(&settings, Grade::Full) else { return };
        for opacity in [0.02, 0.7] {
            let gas = gas(74, opacity);
            let (both, why) = next_listed(&mut session, &scene(straight(0.0), parallel.clone(), vec![gas.clone()]));
            assert_eq!((why, session.gpu().unwrap().keys_sorted()), (None, orders * 900), "{method:?}");
            for (film, x) in both.iter().zip([-0.25, 0.25]) {
                let (alone, why) = next_listed(&mut session, &scene(straight(x), None, vec![gas.clone()]));
                assert_eq!((why, session.gpu().unwrap().keys_sorted()), (None, 900));
                assert_eq!(bits(&alone), bits(std::slice::from_ref(film)), "{method:?}, eye at {x}");
            }
        }
    }
    // Toed in, each eye has its own order.
    let Some(mut session) = listing(&by_compute(Method::Viewplane), Grade::Full) else { return };
    let toed = methods::toe_in(Kernel::Gaussian).remove(0);
    assert_eq!(next_listed(&mut session, &toed).1, None);
    assert_eq!(session.gpu().unwrap().keys_sorted(), 2 * toed.particle_count() as u64);
}

// ---- Shaders and structures, without a device

/// Every shader that a method can ask for, and its number of entry points.
fn shaders() -> Vec<(String, usize)> {
    let methods: [&[Part]; 7] = [
        &[shader::VIEWPLANE],
        &[shader::VIEWPOINT],
        &[shader::PERSPECTIVE],
        &[shader::SPHERICAL_PARALLEL, shader::PRINTED],
        &[shader::SPHERICAL_PARALLEL, shader::INTEGRATED],
        &[shader::SPHERICAL_SLANTED, shader::PRINTED],
        &[shader::SPHERICAL_SLANTED, shader::INTEGRATED],
    ];
    let models = [OpacityModel::Exponential, OpacityModel::Linear];
    let drawing = methods
        .iter()
        .flat_map(|parts| models.map(|model| [(shader::tile(parts, model), 1), (shader::billboards(parts, model), 2)]));
    let cuts = [false, true].into_iter().flat_map(|richardson| [false, true].map(|estimate| (richardson, estimate)));
    let slabs = cuts.map(|(richardson, estimate)| (shader::slabs(richardson, estimate).to_vec(), 1));
    let sheets = Lookup::ALL.iter().map(|&lookup| (shader::slices(lookup).to_vec(), 1));
    let projections: [&[Part]; 6] = [
        &[shader::PROJECT_VIEWPLANE],
        &[shader::PROJECT_VIEWPOINT],
        &[shader::PROJECT_PERSPECTIVE],
        &[shader::PROJECT_SPHERICAL_PARALLEL, shader::QUAD_FAR],
        &[shader::PROJECT_SPHERICAL_PARALLEL, shader::QUAD_CENTRE],
        &[shader::PROJECT_SPHERICAL_SLANTED],
    ];
    let lists: [&[Part]; 8] = [
        &shader::COUNT,
        &shader::SCATTER,
        &shader::SCAN,
        &shader::SPREAD,
        &shader::GATHER,
        &shader::MEASURE,
        &shader::EMIT,
        &shader::STARTS,
    ];
    let projecting = projections.map(|parts| (shader::project(parts), 1)).into_iter();
    let others = projecting.chain(lists.map(|parts| (parts.to_vec(), 1)));
    let others = others.chain(slabs).chain(sheets).chain([(shader::RESOLVED.to_vec(), 1)]);
    drawing.flatten().chain(others).map(|(parts, entries)| (shader::join(&parts), entries)).collect()
}

fn parse(text: &str) -> naga::Module {
    naga::front::wgsl::parse_str(text).unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)))
}

#[test]
fn shaders_are_valid() {
    for (text, entries) in shaders() {
        let module = parse(&text);
        let flags = naga::valid::ValidationFlags::all();
        let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
        validator.validate(&module).unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)));
        assert_eq!(module.entry_points.len(), entries);
    }
}

#[test]
fn structures_mirror_the_shaders() {
    macro_rules! fields {
        ($structure:ty: $($field:ident)*) => { [$((stringify!($field), offset_of!($structure, $field))),*] };
    }
    let splat = fields!(layout::Splat: x y both own ahead front color amplitude anchor most intervals table inverse);
    let view = fields!(layout::View: size first_row across tangent step background stop flags first_group groups slabs);
    let ball = fields!(layout::Ball: x y both plane color amplitude anchor step near depth inverse shape shell shells);
    let disc = fields!(layout::Disc: x y color thickness anchor plane step start depth inverse segments table first);
    let window = fields!(layout::Window: extent at first columns);
    let particle = fields!(layout::Particle: high radius low radius_low color amplitude);
    let kind = fields!(layout::Kind: start table intervals);
    let eye = fields!(layout::Eye: position right up forward tangent step focal center);
    let projection = fields!(layout::Projection: eyes near hair nothing size rows particles views kinds linear orders);
    let work = fields!(layout::Work: count shift blocks particles stride across together);
    let stairs = fields!(Stairs: rows columns);
    let module = parse(&shaders()[0].0);
    let projecting = parse(&shader::join(&shader::project(&[shader::PROJECT_VIEWPLANE])));
    let listing = parse(&shader::join(&shader::EMIT));
    let mut found = 0;
    let structures = [
        ("Splat", size_of::<layout::Splat>(), &splat[..]),
        ("View", size_of::<layout::View>(), &view[..]),
        ("Ball", size_of::<layout::Ball>(), &ball[..]),
        ("Disc", size_of::<layout::Disc>(), &disc[..]),
        ("Window", size_of::<layout::Window>(), &window[..]),
        ("Particle", size_of::<layout::Particle>(), &particle[..]),
        ("Kind", size_of::<layout::Kind>(), &kind[..]),
        ("Eye", size_of::<layout::Eye>(), &eye[..]),
        ("Projection", size_of::<layout::Projection>(), &projection[..]),
        ("Work", size_of::<layout::Work>(), &work[..]),
        ("Stairs", size_of::<Stairs>(), &stairs[..]),
    ];
    for (name, size, fields) in structures {
        let module = match name {
            "Particle" | "Kind" | "Eye" | "Projection" => &projecting,
            "Work" | "Stairs" => &listing,
            _ => &module,
        };
        let (_, ty) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no structure") };
        // Uniforms are padded in Rust alone.
        assert!(*span as usize == size || name == "Work" && span.next_multiple_of(16) as usize == size, "{name}");
        let theirs: Vec<_> =
            members.iter().map(|member| (member.name.as_deref().unwrap(), member.offset as usize)).collect();
        assert_eq!(theirs, fields, "{name}");
        found += members.len();
    }
    assert_eq!(found, 55 + 37);
    // The workgroup of the shader is a tile of the lists.
    assert_eq!(module.entry_points[0].workgroup_size, [16, 16, 1]);
}
