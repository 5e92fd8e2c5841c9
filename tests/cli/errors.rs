//! `errors`: surfaces as CSV and plots, the inverse question, and everything that can be typed wrong.

use super::Place;
use std::fs;
use stereomist::study::error_surface::{Form, Setting};

/// The CSV's rows: three coordinates and a value or none for each form.
fn rows(text: &str) -> Vec<([f64; 3], Vec<Option<f64>>)> {
    text.lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            let values =
                cells[3..].iter().map(|cell| Some(*cell).filter(|c| !c.is_empty()).map(|c| c.parse().unwrap()));
            ([0, 1, 2].map(|i| cells[i].parse().unwrap()), values.collect())
        })
        .collect()
}

#[test]
fn a_surface_in_all_three_forms() {
    let place = Place::empty();
    let words = "errors --of projection --component x --vary xz --x=-2:2:81 --y 0.3 --z=-6:-1:81 --radius 0.4 --near 1 \
                 --form numeric,closed,printed -o deep/e.csv";
    let run = place.run(words).ok();
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
    assert_eq!(place.files(), ["deep/e.csv"]);
    let text = String::from_utf8(place.bytes("deep/e.csv")).unwrap();
    assert!(text.starts_with("cx,cy,cz,numeric,closed,printed\n-2,0.3,-6,"), "{}", &text[..80]);
    let rows = rows(&text);
    assert_eq!(rows.len(), 6561);
    // Both ends, C_x fastest, and coordinates as one would type them.
    assert_eq!((rows[1].0, rows[81].0, rows[6560].0), ([-1.95, 0.3, -6.0], [-2.0, 0.3, -5.9375], [2.0, 0.3, -1.0]));
    let setting = Setting { radius: 0.4, ..Setting::default() };
    for (c, values) in rows {
        let [numeric, closed, printed] = [0, 1, 2].map(|i| values[i].unwrap());
        assert!((numeric - closed).abs() <= 1e-12 * numeric.abs() + 1e-15, "{c:?}: {numeric} {closed}");
        // Digits read back to the very number.
        for (form, value) in [(Form::Numeric, numeric), (Form::Closed, closed), (Form::Printed, printed)] {
            assert_eq!(form.error(&setting, c.into()), Some(value), "{c:?}");
        }
    }
}

#[test]
fn empty_cells_are_counted() {
    let place = Place::empty();
    // The pole runs through the grid, on one side of it for each form.
    let run = place.run("errors --x=-2:2:9 --z=-1:0:5 --form closed,printed");
    assert_eq!(run.code, Some(0));
    let rows = rows(&run.stdout);
    assert_eq!(rows.len(), 45);
    for (n, name) in ["closed", "printed"].into_iter().enumerate() {
        let empty = rows.iter().filter(|(_, values)| values[n].is_none()).count();
        assert!((10..40).contains(&empty));
        assert!(run.stderr.contains(&format!("{name}: {empty} of 45 cells are empty")), "{run:?}");
    }
    // C_z = 0 unless given: everything beside the eye, and a word about what to do.
    let run = place.run("errors --vary xy --x=-1:1:3 --y=-1:1:3");
    assert_eq!(run.code, Some(0));
    assert!(run.stderr.contains("9 of 9") && run.stderr.contains("--z"), "{run:?}");
}

#[test]
fn single_precision_is_printed_as_such() {
    let place = Place::empty();
    let run = place.run("errors --x=0.1:0.7:7 --z=-2:-2:1 --precision f32 --form numeric,closed").ok();
    let last = run.stdout.lines().last().unwrap();
    assert!(last.starts_with("0.7,0,-2,"), "{last}");
    for cell in last.split(',').skip(3) {
        assert!(cell.len() <= 14, "{cell}: digits of a single-precision number");
        assert!((cell.parse::<f64>().unwrap() - -0.038_714_5).abs() < 1e-6, "{cell}");
    }
}

#[test]
fn figures_show_both_forms() {
    let place = Place::empty();
    for (number, first) in [(4, "-2,1,-6"), (9, "-2,-2,-2"), (10, "-2,1,-6"), (13, "-2,-2,-2")] {
        let run = place.run(&format!("errors --figure {number}")).ok();
        assert!(run.stdout.starts_with("cx,cy,cz,closed,printed\n"), "{run:?}");
        assert!(run.stdout.lines().nth(1).unwrap().starts_with(first), "{number}");
        assert_eq!(run.stdout.lines().count(), 6562);
    }
    // What is set besides holds; what contradicts is refused.
    let run = place.run("errors --figure 5 --radius 0.25 --x=0:1:2 --y=0:1:2 --z=-4 --form closed").ok();
    assert_eq!(run.stdout.lines().count(), 5);
    place.run("errors --figure 4 --vary xz --of projection").ok();
    place.run("errors --figure 4 --vary xy").refused(2, &["--vary xy", "figure 4", "xz"]);
    place.run("errors --figure 12 --component x").refused(2, &["--component x", "figure 12"]);
    place.run("errors --figure 6").refused(2, &["--figure 6", "4, 5, 8, 9, 10, 11, 12, 13"]);
}

#[test]
fn units() {
    let place = Place::empty();
    let value = |words: &str| {
        let run = place.run(&format!("errors --x=0.7:0.7:1 --y 0.3 --z=-2:-2:1 --radius 0.4 {words}")).ok();
        rows(&run.stdout)[0].1[0].unwrap()
    };
    let length = value("");
    assert!((length - -0.026_886_619_2).abs() < 1e-10);
    // 2 N tan(fov/2) of the view plane is the picture's height.
    let px = value("--unit px --fov-y-deg 90 --size 640x480");
    assert!((px / (length * 240.0) - 1.0).abs() < 1e-12, "{px}");
    // The same on the screen: 0.4 m show 640 pixels, seen from 0.6 m.
    let arcmin = value("--unit arcmin --fov-y-deg 90 --size 640x480 --viewer-distance 0.6 --screen-width 0.4");
    let expected = 2.0 * (px * 0.4 / 640.0 / 1.2).atan().to_degrees() * 60.0;
    assert!((arcmin / expected - 1.0).abs() < 1e-12, "{arcmin} {expected}");
}

#[test]
fn plots() {
    let place = Place::empty();
    place.run("errors --figure 11 --plot a/f.svg").ok();
    place.run("errors --x=-1:1:300 --z=-3:-0.2:5 --between viewpoint,perspective --plot f.PNG -o f.csv").ok();
    assert_eq!(place.files(), ["a/f.svg", "f.PNG", "f.csv"]);
    let svg = String::from_utf8(place.bytes("a/f.svg")).unwrap();
    for word in ["<svg", "Parallax error in x", "closed", "printed", "I = 0.065", "scene units"] {
        assert!(svg.contains(word), "{word}");
    }
    fs::rename(place.path("f.PNG"), place.path("f.png")).unwrap();
    assert_eq!(place.picture("f.png").size[0], 1200);
    place.run("errors --plot f.gif -o x.csv").refused(2, &["f.gif", ".svg", ".png"]);
    place.run("errors --x 1:1:1 --plot g.svg -o x.csv").refused(2, &["at least two"]);
    place.run("errors --plot f.png/g.svg -o x.csv").refused(2, &["f.png"]);
    place.run("errors --plot same.svg -o same.svg").refused(2, &["same"]);
    place.run("errors --plot ./same.svg -o same.svg").refused(2, &["same"]);
    assert_eq!(place.files(), ["a/f.svg", "f.csv", "f.png"]);
}

#[test]
fn what_each_form_held() {
    let place = Place::empty();
    let json = place.run("errors --x=-1:1:5 --z=-4:-1:4 --y 0.5 --component y --form closed,printed --json").json();
    let [closed, printed] = [0, 1].map(|i| &json["forms"][i]);
    assert_eq!((&closed["form"], &closed["cells"], &closed["empty"]), (&"closed".into(), &20.into(), &0.into()));
    assert_eq!(closed["least"]["center"], serde_json::json!([1.0, 0.5, -1.0]));
    assert!(closed["least"]["value"].as_f64().unwrap() < -0.1);
    assert!(printed["greatest"]["value"].as_f64().unwrap() > 0.1, "the printed sign is the other one");
}

#[test]
fn the_inverse_question() {
    let place = Place::empty();
    let json = place.run("errors --solve tolerance=0.5px --radius 0.3 --json").json();
    let [ratio, distance] = ["ratio", "distance"].map(|key| json["solve"][key].as_f64().unwrap());
    assert!((distance * ratio / 0.3 - 1.0).abs() < 1e-12);
    let run = place.run("errors --solve tolerance=0.5px --radius 0.3").ok();
    let said = run.stdout.split("from distance ").nth(1).unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
    assert!((said / distance - 1.0).abs() < 1e-5, "{run:?}");
    // The other way round it is the same ratio.
    let json = place.run(&format!("errors --solve tolerance=0.5px --z=-{distance} --json")).json();
    assert!((json["solve"]["radius"].as_f64().unwrap() / 0.3 - 1.0).abs() < 1e-12);
    // A pixel more is more; an arc minute is a length too.
    let run = place.run("errors --solve tolerance=1arcmin --viewer-distance 0.6 --screen-width 0.5 --component x").ok();
    assert!(run.stdout.contains("1.0 arc minutes") && run.stdout.contains(" in x "), "{run:?}");
    place.run("errors --solve tolerance=1e-3 --between viewpoint,perspective --fov-y-deg 120 --size 2000x500").ok();
}

#[test]
fn what_is_wrong_is_said_in_a_line() {
    let place = Place::empty();
    for (words, message) in [
        ("--x=-2:2:0", &["--x", "count"][..]),
        ("--x=-2:2:1", &["--x", "count"]),
        ("--x=-2:2:1000000", &["--x", "100000"]),
        ("--x=-2:2:3.5", &["count"]),
        ("--x=2:-2:9", &["--x 2:-2:9", "MIN"]),
        ("--x=2:2:9", &["--x", "count of 1"]),
        ("--x=0.3", &["--x 0.3", "MIN:MAX:COUNT"]),
        ("--x=nan:1:3", &["finite number"]),
        ("--x=1:inf:3", &["finite number"]),
        ("--x=1:2:3:4", &["MIN:MAX:COUNT"]),
        ("--x=-1e200:1:3", &["too large"]),
        ("--x=-1e20:1:3 --precision f32", &["too large"]),
        ("--y 1:2:3", &["--y", "single number"]),
        ("--vary xy --z=-3:-1:4", &["--z", "single number"]),
        ("--vary yz", &["--vary yz", "xz, xy"]),
        ("--radius 0", &["--radius 0", "above 0"]),
        ("--radius=-1", &["--radius -1", "above 0"]),
        ("--radius NaN", &["--radius", "finite"]),
        ("--radius 1e-20 --precision f32", &["--radius", "1e-15"]),
        ("--near 0", &["--near 0"]),
        ("--near=-0.1", &["--near"]),
        ("--interocular=-1", &["--interocular"]),
        ("--form exact", &["--form exact", "numeric, closed, printed"]),
        ("--form closed,closed", &["twice"]),
        ("--form printed --point corner", &["printed", "right-edge"]),
        ("--form printed --between viewplane,perspective", &["printed", "viewpoint"]),
        ("--of shear", &["--of shear", "projection, parallax"]),
        ("--component z", &["--component z", "x, y"]),
        ("--precision f16", &["f64, f32"]),
        ("--point middle", &["--point middle", "corner"]),
        ("--point 1.5,0", &["--point 1.5,0"]),
        ("--between viewplane,viewplane", &["--between", "different"]),
        ("--unit inch", &["--unit inch", "px"]),
        ("--unit arcmin", &["--viewer-distance"]),
        ("--unit px --fov-y-deg 180", &["--fov-y-deg"]),
        ("--unit px --size 0x4", &["--size"]),
        ("--unit px --size 99999x99999", &["--size"]),
        ("--solve tolerance=5e-324", &["beyond"]),
        ("--radius 1\u{1b}[31m", &["--radius 1\\u{1b}[31m"]),
        ("--figure four", &["--figure four"]),
        ("--solve 0.5px", &["tolerance=NUMBER"]),
        ("--solve tolerance=0px", &["positive"]),
        ("--solve tolerance=px", &["positive"]),
        ("--solve tolerance=1mm", &["mm", "px, arcmin"]),
        ("--solve tolerance=0.5px --of parallax", &["projection"]),
        ("--solve tolerance=0.5px --point corner", &["every point"]),
        ("--solve tolerance=0.5px --z=-3 --radius 1", &["--radius", "--z"]),
        ("--solve tolerance=0.5px --z=3", &["behind"]),
    ] {
        // The file is not touched, whatever is wrong.
        let run = place.run(&format!("errors {words} -o e.csv")).refused(2, message);
        assert_eq!(run_lines(&run.stderr), 1, "{run:?}");
        assert_eq!(place.files(), [""; 0], "{words}");
    }
    place.run("errors --json -o -").refused(2, &["standard output"]);
    place.run("errors -o .").refused(2, &["folder"]);
}

fn run_lines(text: &str) -> usize {
    text.lines().count()
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_and_a_reader_that_leaves() {
    let place = Place::empty();
    place.run("errors --x=-2:2:2000 --z=-6:-1:100 -o /dev/full").refused(2, &["/dev/full", "No space left"]);
    // A file size limit of 64 KB stands for a full disk under a name of its own.
    let program = super::PROGRAM;
    let script = format!("ulimit -f 64; trap '' XFSZ; exec {program} errors --x=-2:2:2000 --z=-6:-1:100 -o e.csv");
    let run = std::process::Command::new("bash").args(["-c", &script]).current_dir(place.path("")).output().unwrap();
    assert_eq!(run.status.code(), Some(2), "{run:?}");
    assert_eq!(place.files(), [""; 0]);
    let script = format!("{program} errors --x=-2:2:2000 --z=-6:-1:100 | head -n 1; echo ${{PIPESTATUS[0]}}");
    let run = std::process::Command::new("bash").args(["-c", &script]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&run.stdout), "cx,cy,cz,closed\n0\n");
    assert_eq!(String::from_utf8_lossy(&run.stderr), "");
}
