//! Scene files: what is read from them, and what is said about wrong ones, where.

use proptest::prelude::*;
use std::path::Path;
use stereomist::Error;
use stereomist::error::Diagnostic;
use stereomist::input::particles::{Source, Target};
use stereomist::input::scene_file::{MAX_FILE_SIZE, SceneFile, check_size, load, parse};
use stereomist::render::method::{sheet, slab, spherical};
use stereomist::render::{Method, OpacityModel, Settings, reference};
use stereomist::scene::{Kernel, StereoMode};

/// The shortest camera that is right, on three lines.
const CAMERA: &str = "[camera]\nposition = [0, 0, 9]\nlook_at = [0, 0, 0]\n";

/// The scene file of the documentation, with every section.
const FULL: &str = r#"[camera]
position = [0.0, 1.5, 9.0]   # cyclopean eye
look_at = [0.0, 1.5, 0.0]
up = [0.0, 1.0, 0.0]
fov_y_deg = 40.0
size = [1024, 768]
near = 0.1
samples = 1

[stereo]
interocular = 0.065
convergence = 8.0

[background]
color = [0.25, 0.40, 0.70]

[[particles]]
radius = 0.45
opacity = 0.4
color = [0.7, 0.7, 0.7]
kernel = "gaussian"
position = [0.0, 0.0, 0.0]
[particles.box]
min = [-3.0, 0.0, -3.0]
max = [3.0, 3.0, 3.0]
count = 1200
seed = 17

[[particles]]
file = "cloud.ply"
kernel = { table = "profile.csv" }
rotation_deg = [0, 90, 0]
fit = 10.0
[particles.columns]
radius = "h"
opacity = { from = "dbz", scale = 0.01, offset = 0.0, min = 0.0, max = 0.6 }
color = { from = "dbz", map = "viridis", min = 5.0, max = 55.0 }

[[mesh]]
file = "watertower.gltf"
position = [0.0, 0.0, 0.0]
scale = 2
color = [0.6, 0.6, 0.6]

[render]
method = "auto"
opacity_model = "exponential"
"#;

/// A fresh folder with the files that [`FULL`] names.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("cloud.ply", ""), ("watertower.gltf", ""), ("profile.csv", "q,density\n0,1\n0.5,0.4\n1,0\n")]
    {
        std::fs::write(folder.path().join(name), text).expect("a file in it");
    }
    folder
}

fn sets(sets: &[&str]) -> Vec<String> {
    sets.iter().map(ToString::to_string).collect()
}

fn read(text: &str, changes: &[&str]) -> SceneFile {
    match parse("scene.toml", text, Path::new("/nowhere"), &sets(changes)) {
        Ok(scene) => scene,
        Err(problems) => panic!("{}", Error::Scene(problems)),
    }
}

fn problems_in(base: &Path, text: &str, changes: &[&str]) -> Vec<Diagnostic> {
    match parse("scene.toml", text, base, &sets(changes)) {
        Ok(scene) => panic!("no problem in {text} with {changes:?}: {scene:?}"),
        Err(problems) => problems,
    }
}

fn problems(text: &str, changes: &[&str]) -> Vec<Diagnostic> {
    problems_in(Path::new("/nowhere"), text, changes)
}

/// The part of its line that a problem marks.
fn marked(problem: &Diagnostic) -> String {
    let span = problem.span.as_ref().expect("a place");
    span.text.chars().skip(span.column - 1).take(span.length).collect()
}

/// File, line, column, marked text and message of every problem.
fn summary(problems: &[Diagnostic]) -> Vec<String> {
    let line = |problem: &Diagnostic| match &problem.span {
        Some(span) => {
            format!("{}:{}:{} <{}> {}", problem.file, span.line, span.column, marked(problem), problem.message)
        }
        None => format!("{} {}", problem.file, problem.message),
    };
    problems.iter().map(line).collect()
}

/// Checks one wrong text. The text that the problem must mark stands between « and », which are taken out; message and
/// help must contain what is given.
fn expect(wrong: &str, message: &str, help: &str) {
    let start = wrong.find('«').expect("a mark");
    let before = &wrong[..start];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    let text = wrong.replace(['«', '»'], "");
    let mark: String = wrong[start..].trim_start_matches('«').chars().take_while(|c| *c != '»').collect();
    let found = problems(&text, &[]);
    assert_eq!(found.len(), 1, "{text}\n{:#?}", summary(&found));
    let problem = &found[0];
    let span = problem.span.as_ref().expect("a place");
    assert_eq!((span.line, span.column, marked(problem)), (line, column, mark), "{text}\n{problem}");
    assert_eq!(Some(span.text.as_str()), text.lines().nth(line - 1));
    assert_eq!(problem.file, "scene.toml");
    assert!(problem.message.contains(message), "{message:?} is not in\n{problem}");
    assert!(problem.help.contains(help), "{help:?} is not in\n{problem}");
}

/// [`expect`] for lines that belong into `[camera]`.
fn expect_in_camera(wrong: &str, message: &str, help: &str) {
    expect(&format!("{CAMERA}{wrong}\n"), message, help);
}

/// [`expect`] for what follows a right camera and a box of particles.
fn expect_below(wrong: &str, message: &str, help: &str) {
    expect(&format!("{CAMERA}\n{wrong}\n"), message, help);
}

const BOX: &str = "[particles.box]\nmin = [0, 0, 0]\nmax = [1, 1, 1]\ncount = 5\n";

fn expect_in_particles(wrong: &str, message: &str, help: &str) {
    expect(&format!("{CAMERA}\n[[particles]]\n{wrong}\n{BOX}"), message, help);
}

#[test]
fn the_documented_scene_is_read_whole() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, FULL).unwrap();
    let scene = load(&path, &[]).unwrap();

    assert_eq!(scene.camera.position.to_array(), [0.0, 1.5, 9.0]);
    assert_eq!(scene.camera.look_at.to_array(), [0.0, 1.5, 0.0]);
    assert_eq!(scene.camera.up.to_array(), [0.0, 1.0, 0.0]);
    assert_eq!(scene.camera.fov_y, 40f64.to_radians());
    assert_eq!((scene.camera.size, scene.camera.near, scene.camera.samples), ([1024, 768], 0.1, 1));
    let stereo = scene.stereo.unwrap();
    assert_eq!((stereo.interocular, stereo.convergence, stereo.mode), (0.065, Some(8.0), StereoMode::Parallel));
    assert_eq!(scene.background, [0.25, 0.40, 0.70]);

    assert_eq!(scene.particles.len(), 2);
    let gas = &scene.particles[0];
    assert_eq!((gas.radius, gas.opacity, gas.color), (Some(0.45), 0.4, [0.7; 3]));
    assert!(gas.kernel == Kernel::Gaussian && gas.columns.is_empty() && gas.fit.is_none());
    let Source::Box { min, max, count, seed } = &gas.source else { panic!("{:?}", gas.source) };
    assert_eq!((min.to_array(), max.to_array(), *count, *seed), ([-3.0, 0.0, -3.0], [3.0; 3], 1200, 17));

    let cloud = &scene.particles[1];
    let Source::File(file) = &cloud.source else { panic!("{:?}", cloud.source) };
    assert_eq!(*file, folder.path().join("cloud.ply"));
    assert_eq!((cloud.rotation_deg.to_array(), cloud.scale, cloud.fit), ([0.0, 90.0, 0.0], 1.0, Some(10.0)));
    assert_eq!((cloud.radius, cloud.opacity, cloud.color), (None, 0.5, [1.0; 3]));
    let [radius, opacity, color] = &cloud.columns[..] else { panic!("{:?}", cloud.columns) };
    assert!(matches!(radius.target, Target::Radius) && radius.from == "h");
    assert_eq!((radius.scale, radius.offset, radius.min, radius.max), (1.0, 0.0, None, None));
    assert!(matches!(opacity.target, Target::Opacity) && opacity.from == "dbz" && opacity.map.is_none());
    assert_eq!((opacity.scale, opacity.offset, opacity.min, opacity.max), (0.01, 0.0, Some(0.0), Some(0.6)));
    assert!(matches!(color.target, Target::Color) && color.map.is_some());
    assert_eq!((color.min, color.max), (Some(5.0), Some(55.0)));

    let [mesh] = &scene.meshes[..] else { panic!("{:?}", scene.meshes) };
    assert_eq!(mesh.file, folder.path().join("watertower.gltf"));
    assert_eq!((mesh.scale, mesh.color), (2.0, [0.6; 3]));
    assert_eq!(scene.settings, Settings::default());
    assert!(scene.notes.is_empty(), "{:?}", scene.notes);
}

#[test]
fn what_is_left_out_has_its_default() {
    let scene = read(CAMERA, &[]);
    assert_eq!(scene.camera.up.to_array(), [0.0, 1.0, 0.0]);
    assert_eq!(scene.camera.fov_y, 40f64.to_radians());
    assert_eq!((scene.camera.size, scene.camera.near, scene.camera.samples), ([1024, 768], 0.01, 1));
    assert!(scene.stereo.is_none() && scene.particles.is_empty() && scene.meshes.is_empty());
    assert_eq!(scene.background, [0.0; 3]);
    assert_eq!(scene.settings, Settings::default());
    assert_eq!(scene.notes.len(), 1, "{:?}", scene.notes);

    let stereo = read(&format!("{CAMERA}[stereo]\n"), &[]).stereo.unwrap();
    assert_eq!((stereo.interocular, stereo.convergence), (0.065, None));
    let gas = read(&format!("{CAMERA}[[particles]]\n{BOX}"), &[]).particles.remove(0);
    assert_eq!((gas.radius, gas.opacity, gas.color, gas.scale, gas.fit), (None, 0.5, [1.0; 3], 1.0, None));
    assert!(gas.kernel == Kernel::Gaussian && matches!(gas.source, Source::Box { seed: 0, .. }));
}

#[test]
fn other_ways_to_write_the_same() {
    let scene = read(
        "camera = { position = [1_0, 0x10, 1e1], look_at = [\n 0, # comment\n 0,\n 0,\n] }\nstereo.mode = \"toe-in\"\nstereo.convergence = 3\n\
         particles = [{ box = { min = [0,0,0], max = [0,0,0], count = 0, seed = 18446744073709551615 } }]\n\
         render.method.viewplane = {}\nrender.opacity_model = 'linear'",
        &[],
    );
    assert_eq!(scene.camera.position.to_array(), [10.0, 16.0, 10.0]);
    assert_eq!(scene.stereo.unwrap().mode, StereoMode::ToeIn);
    assert_eq!(scene.notes.len(), 1, "{:?}", scene.notes);
    assert!(matches!(scene.particles[0].source, Source::Box { count: 0, seed: u64::MAX, .. }));
    assert_eq!((scene.settings.method, scene.settings.opacity_model), (Method::Viewplane, OpacityModel::Linear));
}

#[test]
fn missing_keys() {
    let found = problems("", &[]);
    assert_eq!(summary(&found), ["scene.toml `camera` is missing"]);
    assert!(found[0].help.contains("position"), "{}", found[0]);
    expect("«[camera]»\nlook_at = [0, 0, 0]\n", "`camera.position` is missing", "position = [0.0, 1.5, 9.0]");
    expect("«[camera]»\nposition = [0, 0, 0]\n", "`camera.look_at` is missing", "required");
    let found = problems("stereo = {}\n[camera] # none\n", &[]);
    assert_eq!(
        summary(&found),
        [
            "scene.toml:2:1 <[camera]> `camera.position` is missing",
            "scene.toml:2:1 <[camera]> `camera.look_at` is missing"
        ]
    );
    expect_below("«[[particles]]»", "neither `particles.0.box` nor `particles.0.file`", "file = \"cloud.ply\"");
    expect_below("«[[mesh]]»", "`mesh.0.file` is missing", "file = \"watertower.gltf\"");
    expect_below(
        "[[particles]]\n«[particles.box]»\nmin = [0, 0, 0]\nmax = [1, 1, 1]",
        "`particles.0.box.count` is missing",
        "count = 1200",
    );
}

#[test]
fn unknown_keys() {
    expect_in_camera("«fov_deg» = 3", "unknown key `camera.fov_deg`", "did you mean `fov_y_deg`? allowed: position,");
    expect_in_camera("«colour» = 3", "unknown key `camera.colour`", "allowed: position, look_at, up, fov_y_deg, size");
    expect_below("[«sterio»]", "unknown key `sterio`", "did you mean `stereo`?");
    expect_below("[stereo]\n«Interocular» = 1", "unknown key `stereo.Interocular`", "did you mean `interocular`?");
    expect_below("[background]\n«colour» = [0, 0, 0]", "unknown key `background.colour`", "did you mean `color`?");
    expect_below("[render]\n«mehtod» = \"auto\"", "unknown key `render.mehtod`", "did you mean `method`?");
    expect_below("[[«partciles»]]", "unknown key `partciles`", "did you mean `particles`?");
    expect_in_particles("«raduis» = 1", "unknown key `particles.0.raduis`", "did you mean `radius`?");
    expect_below("[render.method.viewplane]\n«slabs» = 3", "method `viewplane` has no parameter `slabs`", "none");
}

#[test]
fn wrong_types() {
    expect_in_camera(
        "near = «\"far\"»",
        "`camera.near` cannot be the string `\"far\"`",
        "a finite number greater than 0",
    );
    expect_in_camera("near = «\"0.5\"»", "cannot be the string `\"0.5\"`", "without quotes");
    expect_in_camera("near = «true»", "`camera.near` cannot be the boolean `true`", "a finite number greater than 0");
    expect_in_camera("near = «2024-02-03»", "cannot be the date or time `2024-02-03`", "a finite number");
    expect_in_camera("near = «{ x = 1 }»", "cannot be the table `{ x = 1 }`", "a finite number");
    expect_in_camera("up = «3»", "`camera.up` cannot be the integer `3`", "three finite numbers, [x, y, z]");
    expect_in_camera("up = «[0, 1]»", "`camera.up` cannot be `[0, 1]`", "three finite numbers");
    expect_in_camera("up = [0, «\"1\"», 0]", "`camera.up.1` cannot be the string", "a finite number");
    expect_in_camera("size = [640, «480.5»]", "`camera.size.1` cannot be the float `480.5`", "from 1 to 32768");
    expect_in_camera("samples = «2.0»", "`camera.samples` cannot be the float `2.0`", "an integer from 1 to 16");
    expect("camera = «3»", "`camera` cannot be the integer `3`", "a table, headed [camera]");
    expect("«[[camera]]»\n", "`camera` cannot be the array `[[camera]]`", "a table, headed [camera]");
    expect_below("[render]\nmethod = «3»", "`render.method` cannot be the integer `3`", "a method's name");
    expect_below("[render]\nopacity_model = «1»", "cannot be the integer `1`", "exponential, linear");
    expect_below("[[mesh]]\nfile = «1»", "`mesh.0.file` cannot be the integer `1`", "the path of a file");
    expect_in_particles("kernel = «1»", "cannot be the integer `1`", "a kernel's name");
    expect_below("[render]\nmethod = { viewplane = «3» }", "parameters of `viewplane`", "{ viewplane = {} }");
    expect(&format!("particles = «3»\n{CAMERA}"), "`particles` cannot be the integer `3`", "each headed [[particles]]");
    expect(&format!("mesh = [«3»]\n{CAMERA}"), "`mesh.0` cannot be the integer `3`", "a table, headed [[mesh]]");
}

#[test]
fn impossible_values_of_the_camera() {
    expect_in_camera("fov_y_deg = «0»", "`camera.fov_y_deg` cannot be `0`", "greater than 0 and less than 180");
    expect_in_camera("fov_y_deg = «180.0»", "`camera.fov_y_deg` cannot be `180.0`", "less than 180");
    expect_in_camera("near = «0»", "`camera.near` cannot be `0`", "a finite number greater than 0");
    expect_in_camera("near = «-1.5»", "`camera.near` cannot be `-1.5`", "a finite number greater than 0");
    for number in ["nan", "-nan", "inf", "-inf", "1e999", "999999999999999999999999999999999999999999"] {
        expect_in_camera(
            &format!("near = «{number}»"),
            &format!("cannot be `{number}`"),
            "a finite number greater than 0",
        );
        expect_in_camera(&format!("up = [0, 1, «{number}»]"), &format!("`{number}`"), "a finite number");
    }
    expect_in_camera("size = [«0», 480]", "`camera.size.0` cannot be `0`", "from 1 to 32768");
    expect_in_camera("size = [640, «32769»]", "`camera.size.1` cannot be `32769`", "from 1 to 32768");
    expect_in_camera("size = «[32768, 16384]»", "536870912 in all", "at most 2^28 = 268435456");
    expect_in_camera("size = [8192, 8192]\nsamples = «3»", "8192 x 8192 pixels with 3 x 3 samples", "2^28");
    expect_in_camera("size = «[32768, 32768]»\nsamples = 2", "`camera.size`: 32768 x 32768", "at most 2^28");
    expect_in_camera("samples = «0»", "`camera.samples` cannot be `0`", "from 1 to 16");
    expect_in_camera("samples = «17»", "`camera.samples` cannot be `17`", "from 1 to 16");
    expect_in_camera("up = «[0, 0, 0]»", "`camera.up` cannot be `[0, 0, 0]`", "not zero");
    expect_in_camera("up = «[0, 0, -2]»", "looks along `camera.up`, [0, 0, -2]", "not parallel");
    expect_in_camera("up = «[1e-300, 0, 0]»", "`camera.up` cannot be", "length");
    expect(
        "[camera]\nposition = [1, 2, 3]\nlook_at = «[1.0, 2.0, 3.0]»\n",
        "`camera.look_at` gives no direction from `camera.position`",
        "two points that differ",
    );
    expect(
        "[camera]\nlook_at = [1, 2, 3]\nposition = «[1, 9, 3]»\n",
        "looks along `camera.up`, [0, 1, 0]",
        "not parallel",
    );
}

#[test]
fn impossible_values_elsewhere() {
    expect_below("[stereo]\ninterocular = «-0.1»", "`stereo.interocular` cannot be `-0.1`", "0 or more");
    expect_below("[stereo]\nconvergence = «0.0»", "`stereo.convergence` cannot be `0.0`", "greater than 0");
    expect_below("[stereo]\nmode = «\"toe-in\"»", "without `stereo.convergence`", "mode = \"parallel\"");
    expect_below("[stereo]\nmode = «\"parrallel\"»", "cannot be `parrallel`", "did you mean `parallel`? allowed:");
    expect_below("[background]\ncolor = [0, «inf», 0]", "`background.color.1` cannot be `inf`", "finite");
    expect_below("[background]\ncolor = [0, 0, «1e39»]", "`background.color.2` cannot be `1e39`", "finite");
    expect_below("[background]\ncolor = «[0, 0, 0, 1]»", "cannot be `[0, 0, 0, 1]`", "[red, green, blue]");
    expect_below("[render]\nopacity_model = «\"lineal\"»", "cannot be `lineal`", "did you mean `linear`?");
    expect_below(
        "[render]\nmethod = «\"viewpoin\"»",
        "`render.method` cannot be `viewpoin`",
        "did you mean `viewpoint`?",
    );
    expect_below("[render]\nmethod = «{}»", "`render.method` cannot be `{}`", "a table of one method");
}

#[test]
fn parameters_of_methods() {
    use spherical::{Falloff, Quad, Rays};
    let method = |text: &str| read(&format!("{CAMERA}[render]\n{text}\n"), &[]).settings.method;
    let spherical = |falloff, rays, quad| Method::Spherical(spherical::Parameters { falloff, rays, quad });
    let printed = spherical(Falloff::Printed, Rays::Parallel, Quad::Far);
    for text in ["method = \"spherical\"", "method = { spherical = {} }", "method.spherical.quad = \"far\""] {
        assert_eq!(method(text), printed);
    }
    let other = "method = { spherical = { falloff = \"integrated\", rays = \"perspective\", quad = \"centre\" } }";
    assert_eq!(method(other), spherical(Falloff::Integrated, Rays::Perspective, Quad::Centre));
    assert_eq!(method("[render.method.spherical]\nrays = \"parallel\"\nfalloff = \"printed\""), printed);

    assert_eq!(method("method = \"sheet\""), Method::Sheet(sheet::Parameters::default()));
    let sheet = sheet::Parameters { slice_width: Some(0.2), segments: 64, lookup: sheet::Lookup::Nearest };
    let text = "method = { sheet = { slice_width = 0.2, segments = 64, lookup = \"nearest\" } }";
    assert_eq!(method(text), Method::Sheet(sheet));
    assert_eq!(method("method = \"slab\""), Method::Slab(slab::Parameters { slabs: None, richardson: false }));
    let text = "method = { slab = { slabs = 64, richardson = true } }";
    assert_eq!(method(text), Method::Slab(slab::Parameters { slabs: Some(64), richardson: true }));
    let reference = |disparity| Method::Reference(reference::Parameters { disparity });
    for text in ["method = \"reference\"", "method = { reference = {} }", "method.reference.disparity = false"] {
        assert_eq!(method(text), reference(false));
    }
    assert_eq!(method("method = { reference = { disparity = true } }"), reference(true));
    let set = "render.method.reference.disparity=true";
    for text in ["", "[render]\nmethod = \"reference\"\n", "[render.method.reference]\ndisparity = false\n"] {
        assert_eq!(read(&format!("{CAMERA}{text}"), &[set]).settings.method, reference(true));
    }
    assert_eq!((sheet::Parameters::default().segments, sheet::Parameters::default().slice_width), (128, None));
}

#[test]
fn impossible_parameters_of_methods() {
    let spherical = |wrong: &str, message: &str, help: &str| {
        expect_below(&format!("[render]\nmethod = {{ spherical = {{ {wrong} }} }}"), message, help);
    };
    let path = "render.method.spherical";
    spherical("«fallof» = \"printed\"", &format!("unknown key `{path}.fallof`"), "did you mean `falloff`? allowed:");
    spherical("falloff = «\"square\"»", &format!("`{path}.falloff` cannot be `square`"), "printed, integrated");
    spherical("rays = «3»", &format!("`{path}.rays` cannot be the integer `3`"), "parallel, perspective");
    spherical("quad = «\"center\"»", &format!("`{path}.quad` cannot be `center`"), "did you mean `centre`?");
    let sheet = |wrong: &str, message: &str, help: &str| {
        expect_below(&format!("[render.method.sheet]\n{wrong}"), message, help);
    };
    sheet("«slabs» = 3", "unknown key `render.method.sheet.slabs`", "allowed: slice_width, segments, lookup");
    for width in ["0", "-0.1", "nan", "inf"] {
        let message = format!("`render.method.sheet.slice_width` cannot be `{width}`");
        sheet(&format!("slice_width = «{width}»"), &message, "a finite number greater than 0");
    }
    sheet("slice_width = «\"0.2\"»", "cannot be the string", "without quotes");
    for segments in ["1", "-1", "4097"] {
        let message = format!("`render.method.sheet.segments` cannot be `{segments}`");
        sheet(&format!("segments = «{segments}»"), &message, "an integer from 2 to 4096");
    }
    sheet("segments = «128.0»", "cannot be the float `128.0`", "an integer from 2 to 4096");
    sheet("lookup = «\"linear\"»", "`render.method.sheet.lookup` cannot be `linear`", "nearest, interpolated");
    for slabs in ["0", "-1", "4097"] {
        let message = format!("`render.method.slab.slabs` cannot be `{slabs}`");
        expect_below(&format!("[render.method.slab]\nslabs = «{slabs}»"), &message, "an integer from 1 to 4096");
    }
    let message = "`render.method.slab.richardson` cannot be the integer `1`";
    expect_below("[render.method.slab]\nrichardson = «1»", message, "true or false");
    expect_below("[render]\nmethod = { sheet = «3» }", "the parameters of `sheet` are no table", "{ sheet = {} }");
    let reference = |wrong: &str, message: &str, help: &str| {
        expect_below(&format!("[render.method.reference]\n{wrong}"), message, help);
    };
    let path = "render.method.reference";
    reference("«disparty» = true", &format!("unknown key `{path}.disparty`"), "did you mean `disparity`?");
    reference("disparity = «1»", &format!("`{path}.disparity` cannot be the integer `1`"), "true or false");
    reference("disparity = «\"true\"»", &format!("`{path}.disparity` cannot be the string"), "true or false");
    // All at once.
    let text = format!("{CAMERA}[render.method.sheet]\nwidth = 1\nsegments = 0\nlookup = 1\nslice_width = true\n");
    assert_eq!(problems(&text, &[]).len(), 4);
}

#[test]
fn settings_of_parameters() {
    let width = |text: &str, sets: &[&str]| {
        let Method::Sheet(parameters) = read(&format!("{CAMERA}{text}\n"), sets).settings.method else {
            panic!("{text} {sets:?}: not sheet");
        };
        parameters
    };
    let set = "render.method.sheet.slice_width=0.2";
    // A name of any method gives way: the setting says which one is meant.
    for scene in [
        "",
        "[render]\nmethod = \"sheet\"",
        "[render]\nmethod = { sheet = {} }",
        "[render]\nmethod = \"viewplane\"",
        "[render]",
    ] {
        assert_eq!(width(scene, &[set]).slice_width, Some(0.2), "{scene}");
    }
    let scene = "[render]\nmethod = { sheet = { slice_width = 0.7, segments = 64 } }";
    assert_eq!((width(scene, &[set]).slice_width, width(scene, &[set]).segments), (Some(0.2), 64));
    assert_eq!(width(scene, &[set, "render.method.sheet.lookup=nearest"]).lookup, sheet::Lookup::Nearest);
    // Parameters of another method do not: one of the two must go first.
    let scene = "[render]\nmethod = { spherical = { falloff = \"integrated\" } }";
    assert_eq!(width(scene, &["render.method=sheet", set]).slice_width, Some(0.2));
    let found = problems(&format!("{CAMERA}{scene}\n"), &[set]);
    assert_eq!(summary(&found), ["--set:1:15 <sheet> `render.method` names more than one method: spherical, sheet"]);
    assert!(found[0].help.contains("--set render.method=sheet"), "{}", found[0]);
    let found = problems(CAMERA, &["render.method.sheet.slice_width=wide"]);
    assert_eq!(summary(&found).len(), 1);
    assert!(found[0].help.contains("greater than 0"), "{}", found[0]);
}

#[test]
fn impossible_particles() {
    expect_in_particles("radius = «0»", "`particles.0.radius` cannot be `0`", "greater than 0");
    expect_in_particles("opacity = «1.0»", "`particles.0.opacity` cannot be `1.0`", "less than 1");
    expect_in_particles("opacity = «-0.1»", "`particles.0.opacity` cannot be `-0.1`", "0 or more");
    expect_in_particles("scale = «0»", "`particles.0.scale` cannot be `0`", "greater than 0");
    expect_in_particles("scale = «[1, 1, 1]»", "cannot be the array `[1, 1, 1]`", "a finite number greater than 0");
    expect_in_particles("fit = «-1»", "`particles.0.fit` cannot be `-1`", "greater than 0");
    expect_in_particles("fit = 1\n«scale» = 2", "`particles.0.scale` and `particles.0.fit` contradict", "a factor");
    expect_in_particles(
        "kernel = «\"gausian\"»",
        "`particles.0.kernel` cannot be `gausian`",
        "did you mean `gaussian`?",
    );
    expect_in_particles("kernel = «{}»", "`particles.0.kernel.table` is missing", "profile.csv");
    let outside = |lines: &str| format!("[[particles]]\n[particles.box]\n{lines}");
    let corners = "min = [0, 0, 0]\nmax = [1, 1, 1]\n";
    expect_below(&outside(&format!("{corners}count = «-1»")), "box.count` cannot be `-1`", "from 0 to 100000000");
    expect_below(&outside(&format!("{corners}count = «1.5»")), "box.count` cannot be the float `1.5`", "an integer");
    expect_below(&outside(&format!("{corners}count = «100000001»")), "cannot be `100000001`", "to 100000000");
    expect_below(&outside(&format!("{corners}count = 1\nseed = «-1»")), "box.seed` cannot be `-1`", "from 0 to 184467");
    expect_below(
        &outside("count = 1\nmin = [0, 2, 0]\nmax = «[1, 1, 1]»"),
        "`particles.0.box.max` is less than `particles.0.box.min` along y: 1 < 2",
        "min <= max",
    );
    expect_in_particles("«columns» = {}", "`particles.0.columns` without a file", "together with `file`");
    let both = format!(
        "{CAMERA}[[particles]]\nfile = \"scene_file.rs\"\n[particles.«box»]\nmin = [0,0,0]\nmax = [1,1,1]\ncount = 1\n"
    );
    let found = problems_in(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests"), &both.replace(['«', '»'], ""), &[]);
    assert_eq!(summary(&found), ["scene.toml:6:12 <box> `particles.0.box` and `particles.0.file` contradict"]);
}

#[test]
fn one_table_where_a_list_is_meant() {
    let text = format!("{CAMERA}[particles]\nradius = -1\n{BOX}[mesh]\nfile = \"\"\n");
    let found = problems(&text, &[]);
    assert_eq!(
        summary(&found),
        [
            "scene.toml:4:1 <[particles]> `particles` is a list, not one table",
            "scene.toml:5:10 <-1> `particles.radius` cannot be `-1`",
            "scene.toml:10:1 <[mesh]> `mesh` is a list, not one table",
            "scene.toml:11:8 <\"\"> `mesh.file` cannot be `\"\"`",
        ]
    );
    assert!(found[0].help.starts_with("write [[particles]]"), "{}", found[0]);
    assert!(found[2].help.starts_with("write [[mesh]]"), "{}", found[2]);
}

#[test]
fn columns() {
    let folder = folder();
    let check = |line: &str, column: usize, mark: &str, message: &str, help: &str| {
        let text = format!("{CAMERA}[[particles]]\nfile = \"cloud.ply\"\n[particles.columns]\n{line}\n");
        let found = problems_in(folder.path(), &text, &[]);
        assert_eq!(summary(&found), [format!("scene.toml:7:{column} <{mark}> {message}")]);
        assert!(found[0].help.contains(help), "{}", found[0]);
    };
    let prefix = "`particles.0.columns";
    let needs_map = format!("{prefix}.color` needs a colour map");
    check("color = \"dbz\"", 9, "\"dbz\"", &needs_map, "viridis");
    check("color = { from = \"dbz\" }", 9, "{ from = \"dbz\" }", &needs_map, "viridis");
    let ends = format!("{prefix}.color` needs the values at both ends of its map");
    check(
        "color = { from = \"d\", map = \"viridis\", min = 1 }",
        9,
        "{ from = \"d\", map = \"viridis\", min = 1 }",
        &ends,
        "min < max",
    );
    let equal = format!("{prefix}.color` has min 1 and max 1");
    check("color = { from = \"d\", map = \"viridis\", min = 1, max = 1.0 }", 55, "1.0", &equal, "min < max");
    let unknown = format!("{prefix}.color.map` cannot be `virids`");
    check(
        "color = { from = \"d\", map = \"virids\", min = 1, max = 2 }",
        29,
        "\"virids\"",
        &unknown,
        "did you mean `viridis`?",
    );
    let only = format!("{prefix}.radius.map` is for color only");
    check("radius = { from = \"h\", map = \"viridis\" }", 30, "\"viridis\"", &only, "color");
    let order = format!("{prefix}.radius` has min 2 and max 1");
    check("radius = { from = \"h\", min = 2, max = 1 }", 39, "1", &order, "min <= max");
    check("radius = { min = 2 }", 10, "{ min = 2 }", &format!("{prefix}.radius.from` is missing"), "from");
    check("radius = 3", 10, "3", &format!("{prefix}.radius` cannot be the integer `3`"), "a column's name");
    check("radius = \"\"", 10, "\"\"", &format!("{prefix}.radius` cannot be `\"\"`"), "a column's name");
    check("x = { from = \"h\", scale = nan }", 27, "nan", &format!("{prefix}.x.scale` cannot be `nan`"), "finite");
    check("radios = \"h\"", 1, "radios", &format!("unknown key {prefix}.radios`"), "did you mean `radius`?");
    check(
        "x = { from = \"h\", form = 1 }",
        19,
        "form",
        &format!("unknown key {prefix}.x.form`"),
        "did you mean `from`?",
    );
    let color = "color = { from = \"d\", map = \"viridis\", min = 1, max = 2 }";
    let clash = format!("{prefix}.color` and its r, g, b contradict");
    let text = format!("{CAMERA}[[particles]]\nfile = \"cloud.ply\"\n[particles.columns]\n{color}\ng = \"green\"\n");
    assert_eq!(summary(&problems_in(folder.path(), &text, &[])), [format!("scene.toml:8:1 <g> {clash}")]);
}

#[test]
fn files_that_cannot_be_used() {
    let folder = folder();
    std::fs::write(folder.path().join("bad.csv"), "q,density\n0,x\n").unwrap();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let text = format!(
        "{CAMERA}near = 0\n[[particles]]\nfile = \"cluod.ply\"\nkernel = {{ table = \"bad.csv\" }}\n\
         [[particles]]\nfile = 'sub'\nkernel = {{ table = \"none.csv\" }}\n[[mesh]]\nfile = \"tower.gltf\"\n"
    );
    let found = problems_in(folder.path(), &text, &[]);
    let lines = summary(&found);
    assert_eq!(lines.len(), 6, "{lines:#?}");
    assert_eq!(lines[0], "scene.toml:4:8 <0> `camera.near` cannot be `0`");
    assert_eq!(lines[1], "scene.toml:6:8 <\"cluod.ply\"> `particles.0.file`: the file `cluod.ply` does not exist");
    assert!(found[1].help.contains(&folder.path().join("cluod.ply").display().to_string()), "{}", found[1]);
    assert!(
        lines[2].starts_with("scene.toml:7:20 <\"bad.csv\"> `particles.0.kernel.table`: the profile"),
        "{lines:#?}"
    );
    assert_eq!(lines[3], "scene.toml:9:8 <'sub'> `particles.1.file`: `sub` is a folder, not a file");
    let missing = "`particles.1.kernel.table`: the file `none.csv` does not exist";
    assert_eq!(lines[4], format!("scene.toml:10:20 <\"none.csv\"> {missing}"));
    assert_eq!(lines[5], "scene.toml:12:8 <\"tower.gltf\"> `mesh.0.file`: the file `tower.gltf` does not exist");
}

#[test]
fn syntax_errors_have_the_same_form() {
    expect_in_camera("near = «wide»", "invalid TOML at `wide`: string values must be quoted", "strings in quotes");
    expect_in_camera("near = «far»", "invalid TOML at `far`: neither a boolean nor a string in quotes", "in quotes");
    expect_in_camera("near = 1\n«near» = 2", "invalid TOML at `near`: duplicate key", "only once");
    expect_below("[«camera»]", "invalid TOML at `camera`: duplicate key", "only once");
    let found = problems("a = tru\nb = 1\n\u{e9} = 2\n[stereo\n", &[]);
    let places: Vec<_> =
        found.iter().map(|problem| problem.span.as_ref().map(|span| (span.line, span.column))).collect();
    assert_eq!(places, [Some((1, 5)), Some((3, 1)), Some((4, 8))], "{:#?}", summary(&found));
    let deep = format!("{CAMERA}near = {}1{}", "[".repeat(60), "]".repeat(60));
    assert_eq!(problems(&deep, &[]).len(), 2, "nested too deeply, and of a wrong type");
    assert!(!problems(&format!("x = {}", "[".repeat(100_000)), &[]).is_empty());
    let keys = vec!["a"; 79].join(".");
    assert!(!problems(&(format!("{keys} = {{").repeat(75) + &"}".repeat(75)), &[]).is_empty());
}

#[test]
fn the_message_as_it_is_shown() {
    let found = problems(&format!("{CAMERA}\tnear = -1 # metres\n"), &[]);
    assert_eq!(
        Error::Scene(found).to_string(),
        "scene.toml:4:9: `camera.near` cannot be `-1`\n\
         4 |  near = -1 # metres\n  |         ^^\n  = allowed: a finite number greater than 0"
    );
}

#[test]
fn all_at_once_in_the_order_of_the_file() {
    let text = "\
[render]
method = \"march\"
[[particles]]
radius = -1
opacity = 2
[stereo]
interocular = \"wide\"
[background]
color = [nan, 0, inf]
[[particles]]
colour = 3
box = { min = 3, max = [1, 1], seed = 1.0 }
";
    assert_eq!(
        summary(&problems(text, &["nonsense", "stereo.convergence=-8", "render.opacity_model=square"])),
        [
            "scene.toml `camera` is missing",
            "scene.toml:2:10 <\"march\"> `render.method` cannot be `march`",
            "scene.toml:3:1 <[[particles]]> neither `particles.0.box` nor `particles.0.file`",
            "scene.toml:4:10 <-1> `particles.0.radius` cannot be `-1`",
            "scene.toml:5:11 <2> `particles.0.opacity` cannot be `2`",
            "scene.toml:7:15 <\"wide\"> `stereo.interocular` cannot be the string `\"wide\"`",
            "scene.toml:9:10 <nan> `background.color.0` cannot be `nan`",
            "scene.toml:9:18 <inf> `background.color.2` cannot be `inf`",
            "scene.toml:11:1 <colour> unknown key `particles.1.colour`",
            "scene.toml:12:7 <{ min = 3, max = [1, 1], seed = 1.0 }> `particles.1.box.count` is missing",
            "scene.toml:12:15 <3> `particles.1.box.min` cannot be the integer `3`",
            "scene.toml:12:24 <[1, 1]> `particles.1.box.max` cannot be `[1, 1]`",
            "scene.toml:12:39 <1.0> `particles.1.box.seed` cannot be the float `1.0`",
            "--set:1:1 <nonsense> `nonsense` has no `=`",
            "--set:1:20 <-8> `stereo.convergence` cannot be `-8`",
            "--set:1:22 <square> `render.opacity_model` cannot be `square`",
        ]
    );
}

#[test]
fn columns_count_characters_and_lines_end_either_way() {
    let text = "[background]\r\n\"größe 🌫\" = 1\r\ncolor = [ # ☁☁☁\r\n\t0,\t-inf, 0]\r\n[camera]\r\nposition = [0, 0, 1]\r\nlook_at = \"ä\"";
    let found = problems(text, &[]);
    assert_eq!(
        summary(&found),
        [
            "scene.toml:2:1 <\"größe 🌫\"> unknown key `background.größe 🌫`",
            "scene.toml:4:5 <-inf> `background.color.1` cannot be `-inf`",
            "scene.toml:7:11 <\"ä\"> `camera.look_at` cannot be the string `\"ä\"`",
        ]
    );
    assert_eq!(found[0].span.as_ref().unwrap().text, "\"größe 🌫\" = 1");
    // A value over several lines is marked up to the end of its first.
    let found = problems(&format!("\u{feff}{CAMERA}near = [ # \u{e9}\n0\n]"), &[]);
    assert_eq!(summary(&found), ["scene.toml:4:8 <[ # é> `camera.near` cannot be the array `[ # é...`"]);
}

#[test]
fn settings_change_any_key() {
    let folder = folder();
    let change = |changes: &[&str]| match parse("scene.toml", FULL, folder.path(), &sets(changes)) {
        Ok(scene) => scene,
        Err(problems) => panic!("{}", Error::Scene(problems)),
    };
    assert_eq!(change(&["camera.near = 0.5"]).camera.near, 0.5);
    assert_eq!(change(&["camera.near=0.5", "camera.near=2"]).camera.near, 2.0);
    assert_eq!(change(&["camera.position=[1,2, 3]"]).camera.position.to_array(), [1.0, 2.0, 3.0]);
    assert_eq!(change(&["camera.position.1=7"]).camera.position.to_array(), [0.0, 7.0, 9.0]);
    assert_eq!(change(&["camera.position[ 2 ]=7"]).camera.position.to_array(), [0.0, 1.5, 7.0]);
    assert_eq!(change(&["camera={position=[0,0,1],look_at=[0,0,0]}"]).camera.size, [1024, 768]);
    assert_eq!(change(&["render.method=viewplane"]).settings.method, Method::Viewplane);
    assert_eq!(change(&["render.method=\"viewpoint\""]).settings.method, Method::Viewpoint);
    assert_eq!(change(&["render.method='viewpoint'"]).settings.method, Method::Viewpoint);
    assert_eq!(change(&["render.method.viewplane={}"]).settings.method, Method::Viewplane);
    assert_eq!(change(&["stereo.mode=toe-in"]).stereo.unwrap().mode, StereoMode::ToeIn);
    assert_eq!(change(&["particles.1.radius=0.3"]).particles[1].radius, Some(0.3));
    assert_eq!(change(&["particles[0].radius=0.3"]).particles[0].radius, Some(0.3));
    assert_eq!(change(&["particles.0.box.count=3", "particles.0.box.seed=4"]).particles.len(), 2);
    assert_eq!(change(&["particles[1].columns.opacity.scale=5"]).particles[1].columns[1].scale, 5.0);
    assert_eq!(change(&["particles.1.columns.y=a=b"]).particles[1].columns[0].from, "a=b");
    assert_eq!(change(&["particles.0.kernel.table=profile.csv"]).particles.len(), 2);
    // The only mesh is meant.
    assert_eq!(change(&["mesh.scale=5"]).meshes[0].scale, 5.0);
    assert_eq!(change(&["mesh.position.0=5"]).meshes[0].position.x, 5.0);
    std::fs::create_dir(folder.path().join("a b")).unwrap();
    std::fs::write(folder.path().join("a b/c#1.ply"), "").unwrap();
    let scene = change(&["particles.1.file=a b/c#1.ply"]);
    assert!(matches!(&scene.particles[1].source, Source::File(path) if *path == folder.path().join("a b/c#1.ply")));
}

#[test]
fn settings_create_what_is_missing() {
    assert_eq!(read(CAMERA, &["stereo.interocular=0.1"]).stereo.unwrap().interocular, 0.1);
    assert_eq!(read(CAMERA, &["stereo={}"]).stereo.unwrap().interocular, 0.065);
    assert_eq!(read("", &["camera.position=[0,0,1]", "camera.look_at=[0,0,0]"]).camera.near, 0.01);
    assert_eq!(read("camera = 3", &["camera.position=[0,0,1]", "camera.look_at=[0,0,0]"]).camera.near, 0.01);
    let list = "particles=[{ box = { min = [0,0,0], max = [1,1,1], count = 2 } }]";
    assert_eq!(read(CAMERA, &[list, "particles.radius=3"]).particles[0].radius, Some(3.0));
}

#[test]
fn settings_that_are_wrong() {
    let two = format!("{CAMERA}[[particles]]\n{BOX}[[particles]]\n{BOX}");
    let check = |set: &str, column: usize, mark: &str, message: &str, help: &str| {
        let found = problems(&two, &[set]);
        assert_eq!(summary(&found), [format!("--set:1:{column} <{mark}> {message}")], "{}", found[0]);
        assert_eq!(found[0].span.as_ref().unwrap().text, set);
        assert!(found[0].help.contains(help), "{}", found[0]);
    };
    check("camera.near", 1, "camera.near", "`camera.near` has no `=`", "path.to.key=value");
    check("", 1, "", "`` has no `=`", "path.to.key=value");
    check("=3", 1, "=", "empty key in ``", "path.to.key=value");
    check("camera..near=3", 8, ".", "empty key in `camera..near`", "path.to.key=value");
    check("camera. =3", 9, "=", "empty key in `camera.`", "path.to.key=value");
    check("camera.near=", 13, "", "`camera.near=` has no value", "\"\"");
    check("particles[x].radius=3", 1, "particles[x]", "`[x]` is no index", "particles.0.radius");
    check("particles[0.radius=3", 1, "particles[0", "`[0` is no index", "particles.0.radius");
    check("camera.near= -1", 14, "-1", "`camera.near` cannot be `-1`", "greater than 0");
    check("camera.near=inf", 13, "inf", "`camera.near` cannot be `inf`", "greater than 0");
    check("camera.near=true", 13, "true", "`camera.near` cannot be the boolean `true`", "greater than 0");
    check("camera.near=.5", 13, ".5", "`camera.near` cannot be the string `.5`", "digits around its point");
    check("camera.near=é☁", 13, "é☁", "`camera.near` cannot be the string `é☁`", "greater than 0");
    check("camera.näer=1", 8, "näer", "unknown key `camera.näer`", "did you mean `near`?");
    check("sterio.mode=3", 1, "sterio", "unknown key `sterio`", "did you mean `stereo`?");
    check("camera.near.x=1", 8, "near", "`camera.near` cannot be the table `near`", "greater than 0");
    check(
        "camera.position.3=1",
        17,
        "3",
        "`camera.position` has no entry 3: it has 3, counted from 0",
        "camera.position.2",
    );
    check(
        "camera.position.x=1",
        17,
        "x",
        "`camera.position` has 3 entries: say which one's `x`",
        "camera.position.0 to",
    );
    let which = "`particles` has 2 entries: say which one's `radius`";
    check("particles.radius=0.3", 11, "radius", which, "particles.0 to particles.1");
    check("particles.2.radius=1", 11, "2", "`particles` has no entry 2: it has 2, counted from 0", "particles.0 to");
    check("particles[1].radius=-1", 21, "-1", "`particles.1.radius` cannot be `-1`", "greater than 0");
    check("mesh.scale=1", 1, "mesh", "the scene has no [[mesh]]", "mesh = [{ file");
    check("camera.up=[0,1", 15, "", "invalid TOML: unclosed array, expected `]`", "TOML");
    check("camera.up=[0, 0, 5]", 11, "[0, 0, 5]", "the camera looks along `camera.up`, [0, 0, 5]", "not parallel");
    check("camera.position=[0,0,0]", 17, "[0,0,0]", "`camera.look_at` gives no direction from `camera.position`", "");
    check("stereo.mode=toe-in", 13, "toe-in", "`stereo.mode` cannot be `toe-in` without `stereo.convergence`", "");
    assert_eq!(
        summary(&problems(&two, &["particles.0.file=x.ply"])),
        [
            "--set:1:13 <file> `particles.0.box` and `particles.0.file` contradict",
            "--set:1:18 <x.ply> `particles.0.file`: the file `x.ply` does not exist",
        ]
    );
}

#[test]
fn problems_in_the_file_keep_their_place_under_settings() {
    let text = format!("{CAMERA}near = 0\n[[particles]]\nraduis = 1\n{BOX}");
    assert_eq!(
        summary(&problems(&text, &["particles.radius=-1", "camera.size=[1,2]", "camera.samples=x"])),
        [
            "scene.toml:4:8 <0> `camera.near` cannot be `0`",
            "scene.toml:6:1 <raduis> unknown key `particles.0.raduis`",
            "--set:1:18 <-1> `particles.0.radius` cannot be `-1`",
            "--set:1:16 <x> `camera.samples` cannot be the string `x`",
        ]
    );
    assert_eq!(read(&format!("{CAMERA}near = -1"), &["camera.near=1"]).camera.near, 1.0, "a setting mends the file");
}

#[test]
fn files_that_are_no_scene() {
    let folder = folder();
    let message = |name: &str| match load(&folder.path().join(name), &[]) {
        Err(error @ Error::Input { .. }) => {
            assert_eq!(error.exit_code(), 2);
            error.to_string()
        }
        other => panic!("{other:?}"),
    };
    assert!(message("none.toml").contains("does not exist"));
    assert!(message("").contains("a folder"));
    std::fs::write(folder.path().join("latin.toml"), b"[camera]\n# caf\xe9\n").unwrap();
    assert!(message("latin.toml").contains("line 2: byte 14 is not UTF-8"));
    std::fs::write(folder.path().join("big.toml"), vec![b'#'; MAX_FILE_SIZE as usize + 1]).unwrap();
    assert!(message("big.toml").contains("at most 256 KiB"));
    let wrong = folder.path().join("wrong.toml");
    std::fs::write(&wrong, "[camera]\n").unwrap();
    match load(&wrong, &[]) {
        Err(Error::Scene(found)) => assert!(found.iter().all(|p| p.file == wrong.display().to_string())),
        other => panic!("{other:?}"),
    }
}

#[test]
fn sizes() {
    for (size, samples) in [([1, 1], 1), ([32768, 8192], 1), ([1024, 1024], 16), ([32768, 1], 16)] {
        assert_eq!(check_size(size, samples), Ok(()));
    }
    for (size, samples) in
        [([0, 1], 1), ([1, 32769], 1), ([32768, 8193], 1), ([1024, 1025], 16), ([1, 1], 0), ([1, 1], 17)]
    {
        assert!(check_size(size, samples).unwrap_err().contains("; allowed: "));
    }
}

#[test]
fn very_many_problems_are_cut_short() {
    let many: String = (0..20_000).map(|i| format!("k{i} = {i}\n")).collect();
    let found = problems(&many, &[]);
    assert_eq!(found.len(), 1001);
    assert_eq!(found[1000].message, "19001 more problems");
    // Each would quote the whole line.
    let long = format!("x = [{}]", "a,".repeat(1 << 20));
    assert!(problems(&long, &[]).len() < 1002);
    // A data file by mistake: its first line says it all.
    let found = problems(&"1.0,2.0,3.0\n".repeat(100_000), &[]);
    assert_eq!(summary(&found).len(), 1);
    assert_eq!(found[0].span.as_ref().map(|span| span.line), Some(1), "{}", found[0]);
}

/// Whatever comes out, its places must exist.
fn check_any(text: &str, changes: &[String]) {
    if let Err(problems) = parse("scene.toml", text, Path::new("/nowhere"), changes) {
        assert!(!problems.is_empty());
        for problem in &problems {
            assert!(!problem.message.is_empty());
            if let Some(span) = &problem.span {
                assert!(span.line >= 1 && span.column >= 1 && span.length >= 1);
                assert!(span.column <= span.text.chars().count() + 1);
            }
        }
        assert!(!Error::Scene(problems).to_string().is_empty());
    }
}

proptest! {
    #[test]
    fn any_text_is_answered(text in "\\PC*", set in "\\PC*") {
        check_any(&text, &[set]);
    }

    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        check_any(&text, &[text.to_string(), format!("camera.near={text}"), format!("{text}=1")]);
    }

    #[test]
    fn any_change_of_a_scene_is_answered(
        cuts in prop::collection::vec((any::<prop::sample::Index>(), 0usize..12, "[\\[\\]{}=.,\"'#\n\r\t a0-9é🌫-]{0,6}"), 1..6),
        end in any::<prop::sample::Index>(),
    ) {
        let mut chars: Vec<char> = FULL.chars().collect();
        for (at, length, insert) in &cuts {
            let at = at.index(chars.len() + 1);
            let to = (at + length).min(chars.len());
            chars.splice(at..to, insert.chars());
        }
        let text: String = chars.iter().collect();
        check_any(&text, &[]);
        let cut: String = chars[..end.index(chars.len() + 1)].iter().collect();
        check_any(&cut, &[]);
    }

    #[test]
    fn any_setting_is_answered(
        path in prop::collection::vec(
            prop::sample::select(vec!["camera", "position", "near", "particles", "0", "1", "[0]", "box", "columns", "color",
                "mesh", "render", "method", "slab", "sheet", "spherical", "segments", "stereo", "x", "\"", ""]), 0..6),
        value in "[\\[\\]{}=.,\"'# a0-9é-]{0,8}",
    ) {
        check_any(FULL, &[format!("{}={value}", path.join("."))]);
    }
}
