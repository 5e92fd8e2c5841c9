//! What each command does when all is well.

use super::{Place, Run, SCENE, repository};
use serde_json::json;
use std::ffi::OsStr;
use std::fs;
use std::process::Stdio;
use stereomist::picture::color::interleave_u8;
use stereomist::picture::packing::PACKINGS;
use stereomist::picture::read::{Samples, read};
use stereomist::render::Method;

const DEFAULTS: [&str; 5] = ["scene.anaglyph.png", "scene.json", "scene.left.png", "scene.right.png", "scene.sbs.png"];

fn in_folder(folder: &str, names: &[&str]) -> Vec<String> {
    names.iter().map(|name| format!("{folder}/{name}")).collect()
}

#[test]
fn render_writes_four_pictures_and_a_record() {
    let place = Place::new();
    let run = place.run("render scene.toml").ok();
    assert_eq!(run.stderr, "");
    let mut expected = in_folder("out", &DEFAULTS);
    expected.push("scene.toml".into());
    assert_eq!(place.files(), expected);
    for format in ["left", "right", "anaglyph", "sbs"] {
        assert!(run.stdout.contains(&format!("scene.{format}.png\n")), "{}", run.stdout);
        let width = if format == "sbs" { 96 } else { 48 };
        assert_eq!(place.picture(&format!("out/scene.{format}.png")).size, [width, 36]);
    }
    let record = place.json("out/scene.json");
    for key in ["versions", "settings", "device", "plan", "views", "timings_ms", "pictures", "verification", "notes"] {
        assert!(record.get(key).is_some(), "{key}: {record}");
    }
    assert_eq!(record["versions"]["stereomist"], env!("CARGO_PKG_VERSION"));
    let settings = &record["settings"];
    assert_eq!((&settings["method"], &settings["method_asked"]), (&"auto".into(), &"auto".into()));
    assert_eq!(settings["tolerance"], 1.0 / 255.0);
    assert_eq!(settings["background"], serde_json::json!([0.1, 0.2, 0.4]));
    assert_eq!(settings["stereo"]["convergence"], 4.0);
    assert_eq!(settings["particles"], 24);
    assert!(record["plan"][0].as_str().unwrap().contains("auto"), "{}", record["plan"]);
    // The left eye stands at -I/2.
    assert_eq!(record["views"][0]["name"], "left");
    assert_eq!(record["views"][0]["eye"], serde_json::json!([-0.15, 0.0, 4.0]));
    let files: Vec<&str> = record["pictures"].as_array().unwrap().iter().map(|p| p["file"].as_str().unwrap()).collect();
    assert_eq!(files.len(), 4);
    assert!(files.iter().all(|file| place.path(file).is_file()), "{files:?}");
}

#[test]
fn the_packed_pictures_hold_the_views() {
    let place = Place::new();
    place.run("render scene.toml -o .").ok();
    let [left, right, sbs] = ["left", "right", "sbs"].map(|format| place.picture(&format!("scene.{format}.png")));
    for (plane, (l, r)) in sbs.color.iter().zip(left.color.iter().zip(&right.color)) {
        for y in 0..36 {
            assert_eq!(plane[96 * y..96 * y + 48], l[48 * y..48 * y + 48]);
            assert_eq!(plane[96 * y + 48..96 * y + 96], r[48 * y..48 * y + 48]);
        }
    }
    // Mixed from 8 bits again, the anaglyph is the same but for what rounding did.
    place.run("compose scene.left.png scene.right.png -o again.png").ok();
    let run = place.run("compare again.png scene.anaglyph.png --max 0.02");
    assert_eq!(run.code, Some(0), "{run:?}");
}

#[test]
fn formats_are_those_asked_for() {
    let place = Place::new();
    for (asked, written) in [
        ("left", vec!["left"]),
        ("right,left", vec!["left", "right"]),
        ("left,left", vec!["left"]),
        ("sbs,anaglyph", vec!["anaglyph", "sbs"]),
    ] {
        let folder = format!("of-{asked}");
        place.run(&format!("render scene.toml --format {asked} -o {folder}")).ok();
        let mut expected: Vec<String> = written.iter().map(|f| format!("{folder}/scene.{f}.png")).collect();
        expected.push(format!("{folder}/scene.json"));
        expected.sort();
        let found: Vec<String> = place.files().into_iter().filter(|name| name.starts_with(&folder)).collect();
        assert_eq!(found, expected);
    }
    // Given twice, the option adds up.
    place.run("render scene.toml --format left --format sbs -o twice").ok();
    assert!(place.path("twice/scene.left.png").exists() && place.path("twice/scene.sbs.png").exists());
}

#[test]
fn image_formats_have_their_depth_and_extension() {
    let place = Place::new();
    let mut linear = None;
    for (name, extension) in [("exr", "exr"), ("png16", "png"), ("png", "png"), ("jpg", "jpg")] {
        place.run(&format!("render scene.toml --image {name} -o {name} --format left,sbs")).ok();
        assert_eq!(place.json(&format!("{name}/scene.json"))["pictures"][0]["image"], name);
        let image = read(&place.path(format!("{name}/scene.left.{extension}"))).unwrap();
        let kind = match &image.samples {
            Samples::U8(_) => 8,
            Samples::U16(_) => 16,
            Samples::Float => 32,
        };
        assert_eq!(
            kind,
            match name {
                "exr" => 32,
                "png16" => 16,
                _ => 8,
            }
        );
        let truth = linear.get_or_insert_with(|| image.picture.clone());
        let worst = truth.color.iter().flatten().zip(image.picture.color.iter().flatten());
        let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let most = match name {
            "exr" => 0.0,
            "png16" => 2e-5,
            "png" => 5e-3,
            _ => 0.06,
        };
        assert!(worst <= most, "{name}: {worst}");
        if name == "exr" {
            let alpha = image.picture.alpha.expect("alpha is 1 - transmittance");
            assert!(alpha.contains(&0.0) && alpha.iter().any(|&a| a > 0.5 && a < 1.0));
        }
    }
}

#[test]
fn a_scene_without_stereo_has_one_picture() {
    let place = Place::empty();
    place.write("one.toml", SCENE.replace("[stereo]\ninterocular = 0.3\nconvergence = 4.0\n", ""));
    place.run("render one.toml").ok();
    assert_eq!(place.files(), ["one.toml", "out/one.json", "out/one.mono.png"]);
    assert_eq!(place.json("out/one.json")["views"][0]["name"], "mono");
    place.run("render one.toml --format mono -o again").ok();
    assert_eq!(place.bytes("again/one.mono.png"), place.bytes("out/one.mono.png"));
    place.run("render one.toml --format sbs").refused(2, &["sbs", "[stereo]", "mono"]);
    let place = Place::new();
    place.run("render scene.toml --format mono").refused(2, &["mono", "[stereo]", "anaglyph"]);
}

#[test]
fn json_is_one_object_and_the_record() {
    let place = Place::new();
    let run = place.run("render scene.toml --json");
    assert_eq!(run.stdout.as_bytes(), place.bytes("out/scene.json"));
    assert_eq!(run.json()["settings"]["particles"], 24);
    // Quiet goes without saying; both together still give the object.
    place.run("render scene.toml --json --quiet").json();
    let run = place.run("render scene.toml --quiet").ok();
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
}

#[test]
fn settings_of_the_command_line() {
    let place = Place::new();
    let settings = |words: &str| {
        let mut record = place.run(&format!("render scene.toml --json --format left {words}")).json();
        record["settings"].take()
    };
    assert_eq!(settings("--set stereo.interocular=0.1")["stereo"]["interocular"], 0.1);
    assert_eq!(settings("--set camera.size=[20,10]")["camera"]["size"], serde_json::json!([20, 10]));
    // The option goes before the setting.
    assert_eq!(settings("--size 7x5 --set camera.size=[20,10]")["camera"]["size"], serde_json::json!([7, 5]));
    assert_eq!(place.picture("out/scene.left.png").size, [7, 5]);
    assert_eq!(settings("--set particles.0.box.count=5 --set render.method=viewplane")["particles"], 5);
    assert_eq!(settings("--set render.method=viewplane")["method"], "viewplane");
    assert_eq!(settings("--set render.method=viewplane --method viewpoint")["method"], "viewpoint");
    assert_eq!(settings("--method perspective --set render.opacity_model=linear")["opacity_model"], "linear");
    assert_eq!(settings("--tolerance 0")["tolerance"], 0.0);
    assert_eq!(settings("--tolerance 1/100")["tolerance"], 0.01);
    assert_eq!(settings("--threads 3")["threads"], 3);
    assert_eq!(settings("--simd portable")["simd"], "portable");
    for device in ["auto", "cpu"] {
        settings(&format!("--device {device}"));
    }
    // A part of the scene that is not there yet.
    place.write("mono.toml", SCENE.replace("[stereo]\ninterocular = 0.3\nconvergence = 4.0\n", ""));
    place.run("render mono.toml -o s --set stereo.interocular=0.2").ok();
    assert!(place.path("s/mono.sbs.png").exists());
}

#[test]
fn every_method_draws_and_they_differ() {
    let place = Place::new();
    let pictures: Vec<_> = Method::ALL
        .iter()
        .map(|method| {
            let name = method.name();
            place.run(&format!("render scene.toml --method {name} -o {name}")).ok();
            (method.name(), place.bytes(&format!("{name}/scene.left.png")))
        })
        .collect();
    for (i, (name, picture)) in pictures.iter().enumerate() {
        for (other_name, other) in &pictures[..i] {
            // With one colour `slab` is exact: in 8 bits it shows what the reference shows, and `auto` nearly so, with the balls of
            // `perspective` where they are small.
            if *name == "auto" && ["reference", "slab", "perspective"].contains(other_name) {
                continue;
            }
            let same = name == other_name || [*name, *other_name] == ["reference", "slab"];
            assert_eq!(picture == other, same, "{name} and {other_name}");
        }
    }
}

#[test]
fn parameters_are_kept_by_their_own_method_and_said() {
    let place = Place::new();
    place.write("sheet.toml", format!("{SCENE}\n[render]\nmethod = {{ sheet = {{ segments = 64 }} }}\n"));
    let said = |words: &str| {
        let report = place.run(&format!("scene --json {words}")).json();
        (report["method"].clone(), report["parameters"].clone())
    };
    let sheet = |width: f64, segments: u32| {
        ("sheet".into(), json!({ "slice_width": width, "segments": segments, "lookup": "interpolated" }))
    };
    // Half the radius, unless it is given.
    assert_eq!(said("sheet.toml"), sheet(0.25, 64));
    assert_eq!(said("sheet.toml --method sheet"), sheet(0.25, 64));
    assert_eq!(said("sheet.toml --method sheet --set render.method.sheet.slice_width=0.5"), sheet(0.5, 64));
    assert_eq!(said("scene.toml --method sheet"), sheet(0.25, 128));
    assert_eq!(said("scene.toml --method sheet --set render.method.sheet.slice_width=2"), sheet(2.0, 128));
    assert_eq!(said("sheet.toml --method viewplane"), ("viewplane".into(), json!({})));
    let printed = json!({ "falloff": "printed", "rays": "parallel", "quad": "far" });
    assert_eq!(said("sheet.toml --method spherical"), ("spherical".into(), printed));
    assert!(place.run("scene sheet.toml").ok().stdout.contains("segments = 64"));
    let notes = |words: &str| place.run(&format!("scene --json {words}")).json()["notes"].to_string();
    assert_eq!(notes("scene.toml --method perspective --set render.opacity_model=linear"), "[]");
    assert!(notes("scene.toml --set render.opacity_model=linear").contains("opacity_model `linear` is ignored"));
    assert!(notes("sheet.toml --set render.opacity_model=linear").contains("opacity_model `linear` is ignored"));
    assert!(notes("scene.toml --method spherical").contains("kernel `gaussian` is ignored"));
}

#[test]
fn the_reference_says_how_exact_it_is() {
    let place = Place::new();
    place.write("linear.toml", format!("{SCENE}[render]\nopacity_model = \"linear\"\n"));
    place.run("render linear.toml --method reference --image exr --format left").ok();
    let record = place.json("out/linear.json");
    for view in record["views"].as_array().unwrap() {
        let bound = view["details"]["largest_error_bound"].as_f64().unwrap();
        assert!(bound > 0.0 && bound < 1e-6, "{bound}");
    }
    let (plan, notes) = (record["plan"].to_string(), record["notes"].to_string());
    assert!(plan.contains("overlap mix") && plan.contains("nothing ends early"), "{plan}");
    assert!(notes.contains("always means optical depth"), "{notes}");
    assert!(place.bytes("out/linear.left.exr").windows(3).any(|bytes| bytes == b"\0E\0"));
    place.run("render linear.toml --image exr --format left").ok();
    assert!(place.json("out/linear.json")["views"][0]["details"]["largest_error_bound"].is_null());
    assert!(!place.bytes("out/linear.left.exr").windows(3).any(|bytes| bytes == b"\0E\0"));
}

#[test]
fn the_pictures_do_not_depend_on_the_threads() {
    let place = Place::empty();
    place.write("scene.toml", SCENE.replace("count = 24", "count = 3000").replace("[48, 36]", "[150, 110]"));
    for method in ["viewplane", "viewpoint", "perspective"] {
        for tolerance in ["0", "1/255"] {
            for threads in [1, 2, 7] {
                let to = format!("{threads}");
                place
                    .run(&format!(
                        "render scene.toml --method {method} --tolerance {tolerance} --threads {threads} -o {to} --image exr"
                    ))
                    .ok();
                for format in ["left", "right", "anaglyph", "sbs"] {
                    let name = format!("scene.{format}.exr");
                    assert!(
                        place.bytes(&format!("{to}/{name}")) == place.bytes(&format!("1/{name}")),
                        "{method} {tolerance} {threads} {format}"
                    );
                }
            }
        }
    }
}

#[test]
fn existing_files_are_replaced_and_folders_created() {
    let place = Place::new();
    place.write("a/b/scene.left.png", "old");
    place.write("a/b/scene.json", "old");
    place.write("a/b/mine.txt", "mine");
    place.run("render scene.toml -o a/b/").ok();
    place.run("render scene.toml -o a/c/d").ok();
    assert_eq!(place.bytes("a/b/scene.left.png"), place.bytes("a/c/d/scene.left.png"));
    assert_eq!(place.bytes("a/b/mine.txt"), b"mine");
    let mut expected = in_folder("a/b", &DEFAULTS);
    expected.push("a/b/mine.txt".into());
    expected.extend(in_folder("a/c/d", &DEFAULTS));
    expected.push("scene.toml".into());
    expected.sort();
    assert_eq!(place.files(), expected);
}

#[test]
fn paths_in_a_scene_are_relative_to_it() {
    let place = Place::empty();
    place.write("scenes/data/cloud.csv", "x,y,z\n0,0,0\n0.5,0,0\n");
    place.write("scenes/data/profile.csv", "q,density\n0,1\n1,0\n");
    let cloud = "file = \"data/cloud.csv\"\nkernel = { table = \"data/profile.csv\" }\n";
    place.write("scenes/scene.toml", SCENE.split("[particles.box]").next().unwrap().to_owned() + cloud);
    fs::create_dir(place.path("elsewhere")).unwrap();
    let run = place
        .command(["render", "../scenes/scene.toml", "--json"])
        .current_dir(place.path("elsewhere"))
        .output()
        .unwrap();
    assert!(run.status.success(), "{run:?}");
    assert_eq!(place.json("elsewhere/out/scene.json")["settings"]["particles"], 2);
    // Its own settings too.
    place.write("scenes/data/other.csv", "x,y,z\n0,0,0\n");
    let run = place.run("scene scenes/scene.toml --json --set particles.0.file=data/other.csv");
    assert_eq!(run.json()["particles"], 1);
}

#[test]
fn names_of_every_kind() {
    let place = Place::empty();
    for (name, stem) in [
        ("noextension", "noextension"),
        ("with space.toml", "with space"),
        ("Nebel über Köln 霧.toml", "Nebel über Köln 霧"),
        ("two.dots.toml", "two.dots"),
        (".hidden", ".hidden"),
        ("-dash.toml", "-dash"),
    ] {
        place.write(name, SCENE);
        let out = format!("out {stem}/");
        place.run_with(["render", "--output", &out, "--format", "left", "--", name]).ok();
        assert!(place.path(&out).join(format!("{stem}.left.png")).is_file(), "{name}: {:?}", place.files());
        assert!(place.path(&out).join(format!("{stem}.json")).is_file(), "{name}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn names_that_are_no_unicode() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::empty();
    let name = OsStr::from_bytes(b"f\xff.toml");
    place.write(name, SCENE);
    place.run_with([OsStr::new("render"), name]).ok();
    assert!(place.path(OsStr::from_bytes(b"out/f\xff.left.png")).is_file());
    assert!(place.path(OsStr::from_bytes(b"out/f\xff.json")).is_file());
}

/// A reader that goes away early (`| head -0`) is no error, whatever the command.
#[test]
fn a_closed_stdout_is_no_error() {
    let place = Place::new();
    place.run("render scene.toml").ok();
    for words in [
        "render scene.toml",
        "render scene.toml --json",
        "scene scene.toml",
        "scene scene.toml --json",
        "devices",
        "devices --json",
        "bench scene.toml --repeat 2",
        "bench scene.toml --repeat 2 --json",
        "chart scene.toml --size 24x18 --methods viewplane --budget 0 -o charts",
        "compare out/scene.left.png out/scene.left.png",
        "compare out/scene.left.png out/scene.left.png --json",
        "compose out/scene.left.png out/scene.right.png -o c.png --json",
        "--help",
        "--version",
    ] {
        let mut child =
            place.command(words.split_whitespace()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        // Nobody reads.
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{words}: {output:?}");
        assert!(output.stderr.is_empty(), "{words}: {output:?}");
    }
}

#[test]
fn compose_equals_ffmpeg_to_the_byte() {
    let place = Place::empty();
    let [left, right, truth] =
        ["left", "right", "arcd"].map(|name| repository(&format!("tests/data/motorcycle_{name}.png")));
    let compose = |more: &[&str]| {
        let words =
            ["compose", "-o", "out.png"].map(OsStr::new).into_iter().chain([left.as_os_str(), right.as_os_str()]);
        place.run_with(words.chain(more.iter().map(OsStr::new)))
    };
    compose(&["--matrix", "ffmpeg", "--space", "encoded"]).ok();
    let samples = |path: &std::path::Path| match read(path).unwrap().samples {
        Samples::U8(samples) => samples,
        other => panic!("8-bit samples are expected, not {other:?}"),
    };
    let truth = samples(&truth);
    assert!(samples(&place.path("out.png")) == truth, "the pictures differ");
    // The check must be able to fail.
    for more in
        [&["--space", "encoded"][..], &["--matrix", "ffmpeg"], &["--matrix", "dubois-2009", "--space", "encoded"]]
    {
        compose(more).ok();
        assert!(samples(&place.path("out.png")) != truth, "{more:?}");
    }
    let report = compose(&["--json"]).json();
    assert_eq!((&report["matrix"], &report["space"]), (&"dubois-2001".into(), &"linear".into()));
    assert!(report["clipped"].as_u64().is_some_and(|n| n > 0), "{report}");
}

#[test]
fn compose_makes_every_format_and_writes_to_stdout() {
    let place = Place::new();
    place.run("render scene.toml -o .").ok();
    for packing in PACKINGS {
        for extension in ["png", "exr", "jpg", "JPEG"] {
            let out = format!("new/{}.{extension}", packing.name);
            place.run(&format!("compose scene.left.png scene.right.png --format {} -o {out}", packing.name)).ok();
            let width = if packing.name == "sbs" { 96 } else { 48 };
            assert_eq!(place.picture(&out).size, [width, 36], "{out}");
        }
    }
    assert!(place.bytes("new/left.exr") != place.bytes("new/right.exr"));
    place.run("compose scene.left.png scene.right.png --image png16 -o deep.png").ok();
    assert!(matches!(read(&place.path("deep.png")).unwrap().samples, Samples::U16(_)));
    let words = ["compose", "scene.left.png", "scene.right.png", "--format", "sbs", "-o", "-"];
    let output = place.command(words).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(output.stdout == place.bytes("new/sbs.png"));
    let words = "compose scene.left.png scene.right.png -o - --json";
    place.run(words).refused(2, &["standard output"]);
}

#[test]
fn compare_says_how_much_by_number_and_exit_code() {
    let place = Place::new();
    place.run("render scene.toml -o .").ok();
    let equal = place.run("compare scene.left.png scene.left.png --max 0 --json").json();
    assert_eq!((&equal["max"], &equal["equal"], &equal["exceeded"]), (&0.0.into(), &true.into(), &false.into()));
    assert!(place.run("compare scene.left.png scene.left.png").ok().stdout.contains("equal"));

    let differ = place.run("compare scene.left.png scene.right.png --json").json();
    let max = differ["max"].as_f64().unwrap();
    assert!(max > 0.01 && differ["exceeded"] == false, "{differ}");
    for key in ["rmse", "psnr", "ssim"] {
        assert!(differ[key].is_number(), "{key}: {differ}");
    }
    // Without a limit any difference is 0; at the limit too; above it 1, object or not.
    assert_eq!(place.run("compare scene.left.png scene.right.png").code, Some(0));
    assert_eq!(place.run("compare scene.left.png scene.right.png --max 1").code, Some(0));
    for more in ["", " --json"] {
        let run = place.run(&format!("compare scene.left.png scene.right.png --max 0.001{more}"));
        assert_eq!((run.code, run.stderr.as_str()), (Some(1), ""), "{run:?}");
        assert!(run.stdout.contains("exceed"), "{run:?}");
    }
    let pairs = place.run("compare scene.left.png scene.left.png scene.right.png scene.right.png --max 0 --json");
    let pairs = pairs.json();
    assert_eq!(pairs["views"].as_array().map(Vec::len), Some(2));
    // Whatever cannot be said is null and has its reason.
    assert!(pairs["inconsistency"].is_null() && pairs["inconsistency_why"].as_str().unwrap().contains("disparityR.x"));
    assert!(equal["inconsistency"].is_null() && equal["inconsistency_why"].as_str().unwrap().contains("two pairs"));

    place.run("compare scene.left.png scene.right.png --heatmap deep/heat.png").ok();
    let heat = place.picture("deep/heat.png");
    // The map stands at the top left in the pictures' own size; the bar is beside it.
    assert!(heat.size[0] > 100 && heat.size[1] > 200, "{:?}", heat.size);
    let map: Vec<f32> = (0..48 * 36).map(|i| heat.color[0][i / 48 * heat.size[0] as usize + i % 48]).collect();
    let brightest = map.iter().fold(0.0_f32, |a, &b| a.max(b));
    assert!(brightest > 0.9 && map.contains(&0.0), "{brightest}");
    // The heat map is written although the limit is exceeded: it shows where.
    let run = place.run("compare scene.left.png scene.right.png --max 0 --heatmap again.png");
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(place.bytes("again.png") == place.bytes("deep/heat.png"));
}

#[test]
fn bench_measures_and_writes_nothing() {
    let place = Place::new();
    let report = place.run("bench scene.toml --json --repeat 3 --warmup 1 --method viewplane --threads 1").json();
    let number = |key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key}: {report}"));
    assert!(number("min_ms") > 0.0 && number("min_ms") <= number("median_ms"));
    assert!(number("fragments") > 0.0);
    assert_eq!((number("repeat"), number("warmup"), number("views"), number("threads")), (3.0, 1.0, 2.0, 1.0));
    let stages = report["stages"].as_object().unwrap();
    for stage in ["plan", "transform", "order", "bin", "meshes", "raster"] {
        assert!(stages[stage].is_number(), "{stage}: {report}");
    }
    assert_eq!(report["method"], "viewplane");
    let mono = place.run("bench scene.toml --json --mono --repeat 1 --warmup 0").json();
    assert_eq!(mono["views"], 1);
    assert!(mono["fragments"].as_f64().unwrap() < number("fragments"));
    let text = place.run("bench scene.toml --repeat 2 --warmup 0").ok().stdout;
    assert!(text.contains("median") && text.contains("raster"), "{text}");
    assert_eq!(place.files(), ["scene.toml"]);
    place.run("bench scene.toml --repeat 0").refused(2, &["--repeat"]);
    let codes = place.run("bench scene.toml --json --repeat 1 --warmup 0 --method viewplane --pixels srgb8").json();
    assert_eq!((report["pixels"].as_str(), codes["pixels"].as_str()), (Some("linear"), Some("srgb8")));
    // Billboards are drawn into them, slabs into films first.
    let films = place.run("bench scene.toml --json --repeat 1 --warmup 0 --method slab --pixels srgb8").json();
    assert!(films["stages"]["encode"].as_f64().unwrap() > 0.0 && codes["stages"].get("encode").is_none());
    place.run("bench scene.toml --pixels 8").refused(2, &["--pixels", "linear", "srgb8"]);
}

#[test]
fn bench_sweeps_threads_and_particles() {
    let place = Place::new();
    let words = "bench scene.toml --repeat 1 --warmup 0 --method viewplane --sweep-particles 10,80";
    let report = place.run(&format!("{words} --sweep-threads 1,2 --json")).json();
    let rows = report["rows"].as_array().unwrap();
    let which: Vec<_> = rows.iter().map(|row| (row["particles"].as_u64(), row["threads"].as_u64())).collect();
    assert_eq!(which, [(10, 1), (10, 2), (80, 1), (80, 2)].map(|(p, t)| (Some(p), Some(t))));
    for row in rows {
        for views in ["stereo", "mono"] {
            let of = &row[views];
            assert!(of["median_ms"].as_f64().is_some_and(|ms| ms > 0.0) && of["spread_ms"].is_number(), "{row}");
            assert!(of["stages"]["raster"].is_number() && of["fragments"].as_u64().is_some_and(|n| n > 0), "{row}");
        }
        assert!(row["stereo"]["fragments"].as_u64() > row["mono"]["fragments"].as_u64(), "{row}");
    }
    // The picture does not depend on threads, and so not what is done for it.
    assert_eq!(rows[0]["stereo"]["fragments"], rows[1]["stereo"]["fragments"]);
    let text = place.run(&format!("{words} --mono")).ok().stdout;
    assert_eq!(text.lines().count(), 4, "{text}");
    assert!(text.lines().all(|line| !line.contains(" 2  viewplane")) && text.contains("raster"), "{text}");
    // One number of particles or of threads is a sweep too; none is the object that it always was.
    let alone = place.run("bench scene.toml --repeat 1 --warmup 0 --sweep-threads 2 --json").json();
    assert_eq!((&alone["rows"][0]["particles"], &alone["rows"][0]["threads"]), (&24.into(), &2.into()));
    place.run("bench scene.toml --sweep-threads 0").refused(2, &["--sweep-threads"]);
    place.run("bench scene.toml --sweep-particles 0").refused(2, &["--sweep-particles"]);
    place.run("bench scene.toml --sweep-threads 1,2 --threads 2").refused(2, &["--threads"]);
    place.run("bench scene.toml --sweep-particles 1000000000").refused(2, &["--sweep-particles"]);
    place.write("cloud.csv", "x,y,z\n0,0,0\n");
    place.write(
        "file.toml",
        SCENE.split("[particles.box]").next().unwrap().replace("radius", "file = \"cloud.csv\"\nradius"),
    );
    place.run("bench file.toml --sweep-particles 10").refused(2, &["--sweep-particles", "cloud.csv", "boxes"]);
    assert_eq!(place.files(), ["cloud.csv", "file.toml", "scene.toml"]);
}

#[test]
fn scene_describes_and_writes_nothing() {
    let place = Place::new();
    let report = place.run("scene scene.toml --json").json();
    assert_eq!((&report["views"], &report["particles"]), (&2.into(), &24.into()));
    assert_eq!(report["size"], serde_json::json!([48, 36]));
    assert!(report["plan"].is_array() && report["predicted_error"].is_number() && report["notes"].is_array());
    assert!(report["predicted_ms"].as_f64().unwrap() > 0.0 && report["drawn_ms"].as_f64().unwrap() > 0.0);
    let [near, far] = [0, 1].map(|i| report["parallax"][i].as_f64().unwrap());
    assert!(near < 0.0 && far > 0.0, "the box straddles the screen: {report}");
    let text = place.run("scene scene.toml").ok().stdout;
    assert!(text.contains("24 particles") && text.contains("gaussian") && text.contains("auto"), "{text}");
    assert_eq!(place.files(), ["scene.toml"]);
    // No particles at all is a scene too.
    place.write("empty.toml", "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nsize = [8, 6]\n");
    assert_eq!(place.run("scene empty.toml --json").json()["depths"], serde_json::Value::Null);
    place.run("scene empty.toml").ok();
    place.run("render empty.toml").ok();
    assert_eq!(place.picture("out/empty.mono.png").color[1][..], [0.0; 48]);
}

#[test]
fn devices_lists_the_machine() {
    let place = Place::empty();
    let report = place.run("devices --json").json();
    assert_eq!(report["used"], "cpu");
    assert!(report["cpu"]["threads"].as_u64().is_some_and(|n| n > 0), "{report}");
    assert!(report["gpus"].is_array() && report["gpu_methods"][0] == "viewplane", "{report}");
    assert_eq!(report["gpu"].is_string(), report["why_no_gpu"].is_null(), "{report}");
    assert!(place.run("devices").ok().stdout.contains("cpu"));
}

#[test]
fn a_gpu_draws_what_the_cpu_draws() {
    if !crate::gpu::present() {
        return;
    }
    let place = Place::new();
    // A driver that computes on the CPU is there for tests alone.
    let name = std::env::var("STEREOMIST_GPU").ok().filter(|name| name != "require");
    let device = format!("gpu:{}", name.as_deref().unwrap_or("LLVMpipe"));
    for method in ["perspective", "sheet", "slab --set render.method.slab.richardson=true"] {
        for device in ["cpu", &device] {
            let words = format!("render scene.toml -o {} --image exr --method {method} --device", &device[..3]);
            place.run_with(words.split_whitespace().chain([device])).ok();
        }
        assert!(place.json("gpu/scene.json")["device"].as_str().unwrap().starts_with("GPU, "));
        assert!(place.json("cpu/scene.json")["device"].as_str().unwrap().starts_with("CPU, "));
        for eye in ["left", "right"] {
            place.run(&format!("compare cpu/scene.{eye}.exr gpu/scene.{eye}.exr --max 0.002")).ok();
        }
    }
    let words = "bench scene.toml --repeat 2 --warmup 1 --json --method viewplane --gpu-path PATH --device";
    let mut report = serde_json::Value::Null;
    for (path, drawing) in [("compute", "compute"), ("raster", "raster"), ("raster-f16", "raster")] {
        report = place.run_with(words.replace("PATH", path).split_whitespace().chain([device.as_str()])).json();
        assert_eq!(report["gpu_path"], path);
        for stage in ["upload", drawing, "read back"] {
            assert!(report["stages"][stage].as_f64().is_some(), "{report}");
        }
    }
    for path in ["raster", "raster-f16"] {
        let words = format!("render scene.toml -o {path} --image exr --method viewpoint --gpu-path {path} --device");
        place.run_with(words.split_whitespace().chain([device.as_str()])).ok();
        let record = place.json(&format!("{path}/scene.json"));
        assert_eq!([&record["settings"]["gpu_path"], &record["settings"]["gpu_path_asked"]], [path; 2]);
        let notes = record["notes"].as_array().unwrap();
        let loss = notes.iter().any(|note| note.as_str().unwrap().contains("11 significant bits"));
        assert_eq!(loss, path == "raster-f16", "{record}");
    }
    // Left to it, the tool measures and keeps what it finds; `devices` tells.
    let cache = place.path("cache");
    let mut command = place
        .command("render scene.toml -o kept --method viewplane --device".split_whitespace().chain([device.as_str()]));
    Run::of(command.env("XDG_CACHE_HOME", &cache).output().unwrap()).ok();
    let record = place.json("kept/scene.json");
    let path = record["settings"]["gpu_path"].as_str().unwrap().to_owned();
    assert!(["compute", "raster"].contains(&path.as_str()) && record["settings"]["gpu_path_asked"] == "auto");
    assert!(record["plan"].to_string().contains(&format!("Drawn by {path}: ")), "{record}");
    assert!(place.path("cache/stereomist/gpu-paths.json").is_file());
    let mut command = place.command(["devices", "--json"]);
    let known = Run::of(command.env("XDG_CACHE_HOME", &cache).output().unwrap()).json();
    let used = known["gpus"].as_array().unwrap().iter().find(|gpu| !gpu["gpu_path"].is_null());
    assert!(used.is_some_and(|gpu| gpu["gpu_path"] == path.as_str()), "{known}");
    // The CPU is asked nothing.
    place.run("render scene.toml -o cpu --device cpu --gpu-path raster").ok();
    assert!(place.json("cpu/scene.json")["settings"]["gpu_path"].is_null());
    assert!(report["device"].as_str().unwrap().starts_with("GPU, "), "{report}");
    let words = "render scene.toml --method reference --device";
    let run = place.run_with(words.split_whitespace().chain([device.as_str()]));
    run.refused(3, &["`reference`", "viewplane, viewpoint, perspective, spherical, sheet, slab"]);
    for device in ["cpu", &device] {
        let words = "render scene.toml --method slab --set render.method.slab.slabs=8 --error-map";
        let map = format!("{}.exr", &device[..3]);
        place.run_with(words.split_whitespace().chain([map.as_str(), "--device", device])).ok();
    }
    for eye in ["left", "right"] {
        place.run(&format!("compare cpu.{eye}.exr gpu.{eye}.exr --max 0.0002")).ok();
    }
}

#[test]
fn every_command_has_help() {
    let place = Place::empty();
    let all = place.run("--help").ok().stdout;
    for command in ["render", "compose", "compare", "bench", "chart", "scene", "devices"] {
        assert!(all.contains(command), "{all}");
        let help = place.run(&format!("{command} --help")).ok().stdout;
        assert!(help.contains("Usage: stereomist") && help.contains(command), "{help}");
    }
    assert!(place.run("--version").ok().stdout.starts_with("stereomist "));
    assert_eq!(place.run("").code, Some(2));
}

/// What a reader of a mesh file leaves out reaches the user: on stdout, and in the record.
#[test]
fn notes_of_files_reach_the_user() {
    let place = Place::empty();
    // A triangle and a line; lines are left out.
    let positions: Vec<u8> = [[-1.0_f32, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    place.write("m.bin", &positions);
    place.write(
        "m.gltf",
        r#"{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}, {"attributes": {"POSITION": 0}, "mode": 3}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                           "min": [-1, -1, 0], "max": [1, 1, 0]}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "m.bin", "byteLength": 36}]}"#,
    );
    place.write("scene.toml", format!("{SCENE}\n[[mesh]]\nfile = \"m.gltf\"\n"));
    let run = place.run("render scene.toml").ok();
    assert!(run.stdout.contains("note: ") && run.stdout.contains("m.gltf"), "{run:?}");
    let record = place.json("out/scene.json");
    assert!(record["notes"][0].as_str().is_some_and(|note| note.contains("m.gltf")), "{record}");
    assert_eq!(record["settings"]["triangles"], 1);
    assert!(place.run("scene scene.toml").ok().stdout.contains("note: "));
    assert!(place.run("scene scene.toml --json").json()["notes"][0].is_string());
    assert_eq!(place.run("render scene.toml --quiet").ok().stdout, "");
}

/// The views of this scene and no colour but its own: 8-bit samples survive every step.
#[test]
fn left_goes_to_the_left() {
    let place = Place::new();
    place.run("render scene.toml -o .").ok();
    place.run("compose scene.left.png scene.right.png --format left -o copy.png").ok();
    let [a, b] = ["scene.left.png", "copy.png"].map(|name| interleave_u8(&place.picture(name).color));
    assert!(a == b);
}

/// The scene with a second set of another colour, so that slabs have an error to estimate.
fn two_colours() -> Place {
    let place = Place::new();
    let set = SCENE.split("[[particles]]").nth(1).unwrap().replace("seed = 3", "seed = 4");
    place.write("scene.toml", format!("{SCENE}\n[[particles]]\ncolor = [0.9, 0.1, 0.0]\n{set}"));
    place
}

#[test]
fn render_writes_error_maps() {
    let place = two_colours();
    let run = place.run("render scene.toml --method slab --set render.method.slab.slabs=8 --error-map maps/e.exr").ok();
    assert!(run.stdout.contains("maps/e.left.exr") && run.stdout.contains("maps/e.right.exr"), "{}", run.stdout);
    let map = place.picture("maps/e.left.exr");
    let top = |name: &str| place.picture(name).color[1].iter().copied().fold(0.0f32, f32::max);
    assert!(map.color[0] == map.color[1] && map.color[0] == map.color[2]);
    let largest = top("maps/e.left.exr").max(top("maps/e.right.exr"));
    assert!(largest > 1e-5 && largest < 0.1, "{largest}");
    let estimate = &place.json("out/scene.json")["settings"]["error_estimate"];
    assert!((estimate["largest"].as_f64().unwrap() - f64::from(largest)).abs() < 1e-7, "{estimate}");
    assert!(estimate["mean"].as_f64().unwrap() > 0.0 && estimate["mean"].as_f64().unwrap() < f64::from(largest));
    // White is the largest of both views.
    place.run("render scene.toml --method slab --set render.method.slab.slabs=8 --error-map e.png").ok();
    assert_eq!(top("e.left.png").max(top("e.right.png")), 1.0);
    // Channel E of the views is a bound, which this is not; nor does the record call it one.
    place.run("render scene.toml --method slab --image exr --format left --error-map e.exr -o exr").ok();
    let bound = b"E\0\x02\0\0\0";
    assert!(!place.bytes("exr/scene.left.exr").windows(6).any(|bytes| bytes == bound));
    assert!(place.json("exr/scene.json")["views"][0]["details"]["largest_error_bound"].is_null());
}

#[test]
fn error_maps_that_cannot_be() {
    let place = two_colours();
    let methods = ["--error-map", "`viewplane`", "slab"];
    place.run("render scene.toml --method viewplane --error-map e.exr").refused(2, &methods);
    for name in ["e.jpg", "e", "-"] {
        place.run(&format!("render scene.toml --method slab --error-map {name}")).refused(2, &[".exr or .png"]);
    }
}
