//! `chart`: what it writes, what it measures again and what not, and everything that can be wrong.

use super::{Place, SCENE};
use std::fs;
use stereomist::study::chart::{CANDIDATES, Row, table};

/// Small, and with five frames for each point.
const CHART: &str = "chart scene.toml --size 24x18 --threads 1 --budget 0 -o out";

fn rows(place: &Place, name: &str) -> Vec<Row> {
    table::from_csv(&String::from_utf8(place.bytes(name)).unwrap()).unwrap()
}

/// The file that keeps the reference of a scene.
fn references(place: &Place) -> Vec<String> {
    place.files().into_iter().filter(|name| name.contains(".reference-")).collect()
}

#[test]
fn a_scene_becomes_a_table_and_a_picture() {
    let place = Place::new();
    let report = place.run(&format!("{CHART} --json")).json();
    let scene = &report["scenes"][0];
    assert_eq!(report["scenes"].as_array().unwrap().len(), 1);
    assert_eq!((&scene["pixels"], &scene["pixels_of"], &scene["views"]), (&432.into(), &432.into(), &2.into()));
    assert_eq!(scene["measured"], CANDIDATES.len());
    assert!(scene["reference_error"].as_f64().is_some_and(|error| error > 0.0 && error < 1e-8), "{scene}");
    let rows = rows(&place, "out/scene.csv");
    let points = scene["points"].as_array().unwrap();
    assert_eq!((rows.len(), points.len()), (CANDIDATES.len(), CANDIDATES.len()));
    for ((row, point), candidate) in rows.iter().zip(points).zip(CANDIDATES) {
        assert_eq!((&*row.method, &*row.value), (candidate.method, candidate.value));
        // Read back from JSON, numbers may be off by the last digit.
        for (key, value) in [("rmse", row.rmse), ("median_ms", row.median_ms), ("max", row.max), ("q99", row.q99)] {
            assert!((point[key].as_f64().unwrap() - value).abs() <= 1e-14 * value, "{key}: {point}");
        }
        assert_eq!(point["stages"].as_object().unwrap().len(), row.stages.len());
        assert_eq!(row.rmse_se, 0.0);
    }
    let [reference] = &references(&place)[..] else { panic!("{:?}", place.files()) };
    let expected = ["out/scene.csv", "out/scene.png", reference, "out/scene.svg", "scene.toml"];
    assert_eq!(place.files(), expected);
    let svg = String::from_utf8(place.bytes("out/scene.svg")).unwrap();
    for row in &rows {
        assert!(
            svg.contains(&format!("<title>{} {}: {}, {}<", row.method, row.value, row.median_ms, row.rmse)),
            "{row:?}"
        );
    }
    assert_eq!(place.picture("out/scene.png").size, [1000, 680]);
    // In words: the files, and each point of the front.
    let text = place.run(CHART).ok().stdout;
    assert!(text.starts_with("out/scene.csv\nout/scene.svg\nout/scene.png\n"), "{text}");
    for (row, front) in rows.iter().zip(table::on_front(&rows)) {
        let line = format!("  {:<20}{:>10.3} ms", format!("{} {}", row.method, row.value), row.median_ms);
        assert_eq!(text.contains(&line), front, "{line}\n{text}");
    }
}

#[test]
fn what_is_known_is_not_measured_again() {
    let place = Place::new();
    let measured = |words: &str| place.run(&format!("{CHART} --json {words}")).json()["scenes"][0]["measured"].clone();
    assert_eq!(measured("--methods viewplane,sheet"), 6);
    assert_eq!(rows(&place, "out/scene.csv").len(), 6);
    // A time that no frame takes shows which rows are left alone.
    let mut planted = rows(&place, "out/scene.csv");
    planted.iter_mut().for_each(|row| row.median_ms = 98_765.25);
    place.write("out/scene.csv", table::to_csv(&planted));
    let before = place.bytes("out/scene.csv");
    assert_eq!(measured("--methods viewplane"), 0);
    assert!(place.bytes("out/scene.csv") == before);
    assert_eq!(measured("--methods viewplane,slab"), 7);
    let untouched = |method: &str| {
        let rows = rows(&place, "out/scene.csv");
        let of: Vec<bool> =
            rows.iter().filter(|row| row.method == method).map(|row| row.median_ms == 98_765.25).collect();
        assert!(of.iter().all(|same| *same == of[0]), "{rows:?}");
        of[0]
    };
    assert!(untouched("viewplane") && untouched("sheet") && !untouched("slab"));
    // All of the table's order, whenever they came.
    let methods: Vec<String> = rows(&place, "out/scene.csv").into_iter().map(|row| row.method).collect();
    assert_eq!(methods[..3], ["viewplane"; 3]);
    assert_eq!(methods[3..], [["sheet"; 3].as_slice(), &["slab"; 7]].concat());
    assert_eq!(measured("--methods sheet --fresh"), 3);
    assert!(untouched("viewplane") && !untouched("sheet"));
    // Another question: nothing of what is there answers it.
    let report = place.run(&format!("{CHART} --json --methods viewplane --set particles.0.opacity=0.5")).json();
    let scene = &report["scenes"][0];
    assert_eq!((&scene["measured"], scene["points"].as_array().unwrap().len()), (&3.into(), 3));
    assert!(scene["notes"].to_string().contains("13 points in out/scene.csv"), "{scene}");
    assert_eq!(references(&place).len(), 2);
}

#[test]
fn an_interrupted_chart_goes_on() {
    let place = Place::new();
    place.run(CHART).ok();
    let text = String::from_utf8(place.bytes("out/scene.csv")).unwrap();
    let half: Vec<&str> = text.split_inclusive('\n').take(11).collect();
    let mut planted = table::from_csv(&half.concat()).unwrap();
    planted[2].median_ms = 98_765.25;
    let mut left = table::to_csv(&planted);
    // And a part of a row, as a crash of the machine may leave it.
    left += &text.lines().nth(11).unwrap()[..60];
    place.write("out/scene.csv", left);
    fs::remove_file(place.path("out/scene.svg")).unwrap();
    let report = place.run(&format!("{CHART} --json")).json();
    assert_eq!(report["scenes"][0]["measured"], CANDIDATES.len() - 10);
    let rows = rows(&place, "out/scene.csv");
    assert_eq!((&rows[..10], rows.len()), (&planted[..], CANDIDATES.len()));
    assert!(place.path("out/scene.svg").exists());
}

#[test]
fn the_reference_is_kept_and_a_damaged_one_is_not_believed() {
    let place = Place::new();
    let words = format!("{CHART} --fresh --methods viewplane");
    place.run(&words).ok();
    let sound: Vec<f64> = rows(&place, "out/scene.csv").iter().map(|row| row.max).collect();
    let [name] = &references(&place)[..] else { panic!("{:?}", place.files()) };
    let text = String::from_utf8(place.bytes(name)).unwrap();
    // Whole, but wrong: errors show that it is what they are measured by.
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[200].split(',').collect();
    cells[2] = "1e2";
    lines[200] = cells.join(",");
    place.write(name, lines.join("\n") + "\n");
    place.run(&words).ok();
    assert!(rows(&place, "out/scene.csv").iter().all(|row| row.max > 90.0));
    for damaged in [&text[..text.len() / 2], "", "\u{0}\u{1}", &text.replacen("0,5,", "0,4,", 1)] {
        place.write(name, damaged);
        place.run(&words).ok();
        assert_eq!(rows(&place, "out/scene.csv").iter().map(|row| row.max).collect::<Vec<_>>(), sound);
        assert!(place.bytes(name) == text.as_bytes());
    }
}

#[test]
fn scenes_with_more_samples_one_eye_or_many_pixels() {
    let place = Place::new();
    place.write("other/mono.toml", SCENE.replace("[stereo]\ninterocular = 0.3\nconvergence = 4.0\n", ""));
    let words = "chart scene.toml other/mono.toml -o out --methods viewplane --budget 0 --threads 1 --sample 300 \
                 --set camera.samples=2 --set render.opacity_model=linear --json";
    let report = place.run(words).json();
    let [scene, mono] = &report["scenes"].as_array().unwrap()[..] else { panic!("{report}") };
    for scene in [scene, mono] {
        let pixels = scene["pixels"].as_u64().unwrap();
        assert!((200..=300).contains(&pixels) && scene["pixels_of"] == 1728, "{scene}");
        let notes = scene["notes"].to_string();
        for word in ["camera.samples = 2 is charted as 1", "pixels of each view", "opacity_model"] {
            assert!(notes.contains(word), "{word}: {notes}");
        }
        for point in scene["points"].as_array().unwrap() {
            assert!(point["rmse_se"].as_f64().is_some_and(|error| error > 0.0), "{point}");
            assert_eq!(point["inconsistency_rmse"].is_null(), scene["views"] == 1, "{point}");
        }
    }
    assert_eq!((&scene["views"], &mono["views"]), (&2.into(), &1.into()));
    assert!(place.path("out/mono.png").exists() && place.path("out/scene.png").exists());
}

#[test]
fn wrong_use_is_refused_before_any_work() {
    let place = Place::new();
    place.write("sub/scene.toml", SCENE);
    place.write("bad.toml", "[camera]\nposition = 3\n");
    place.write("file", "");
    place.write("data/scene.csv", "x,y,z\n0,0,0\n");
    place.write("data/cloud.csv", "x,y,z\n0,0,0\n0.5,0,0\n");
    let before = place.files();
    for (words, says) in [
        ("chart -o out", &["<SCENE>"][..]),
        ("chart scene.toml", &["--output <DIR>"]),
        ("chart scene.toml sub/scene.toml -o out", &["scene.toml", "sub/scene.toml", "scene.csv"]),
        ("chart scene.toml scene.toml -o out", &["scene.csv"]),
        ("chart scene.toml none.toml -o out", &["none.toml"]),
        ("chart scene.toml bad.toml -o out", &["bad.toml:2:"]),
        ("chart scene.toml -o file", &["file", "-o names the folder"]),
        ("chart scene.toml -o file/deep", &["file/deep"]),
        ("chart scene.toml -o data", &["data/scene.csv", "no table of `chart`", "-o"]),
        ("chart data/cloud.csv -o data", &["data/cloud.csv", "-o"]),
        ("chart scene.toml -o out --methods viewplan", &["--methods viewplan", "viewplane", "half"]),
        ("chart scene.toml -o out --methods slab,", &["--methods", "slab"]),
        ("chart scene.toml -o out --budget -1", &["--budget -1"]),
        ("chart scene.toml -o out --budget nan", &["--budget nan"]),
        ("chart scene.toml -o out --budget long", &["--budget long"]),
        ("chart scene.toml -o out --sample 0", &["--sample"]),
        ("chart scene.toml -o out --size 0x5", &["--size 0x5"]),
        ("chart scene.toml -o out --set camera.nothing=1", &["nothing"]),
        ("chart scene.toml -o out --simd mmx", &["--simd mmx"]),
        ("chart scene.toml -o out --tolerance 0.1", &["--tolerance"]),
        ("chart scene.toml -o out --method slab", &["--method"]),
    ] {
        let run = place.run(words);
        assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""), "{words}: {run:?}");
        assert!(run.stderr.starts_with("error: ") && !run.stderr.contains("panicked"), "{words}: {run:?}");
        for word in says {
            assert!(run.stderr.contains(word), "{words}: `{word}` is missing: {run:?}");
        }
        assert_eq!(place.files(), before, "{words}");
    }
    place.run("chart scene.toml -o out --device gpu").refused(3, &["no GPU"]);
    assert_eq!(place.files(), before);
    // Particles without a scene are charted too, in a folder of their own.
    place.run("chart data/cloud.csv -o out --size 24x18 --methods viewplane --budget 0").ok();
    assert_eq!(rows(&place, "out/cloud.csv").len(), 3);
}
