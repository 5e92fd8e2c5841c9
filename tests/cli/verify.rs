//! `render --verify`: what it says, in words and in the record, and the exit code.

use super::{Place, SCENE};
use serde_json::Value;

/// Two kinds of gas of different colours that overlap: far off where particles do not mix.
fn two_colours() -> Place {
    let place = Place::new();
    let set = SCENE.split("[[particles]]").nth(1).unwrap().replace("seed = 3", "seed = 4");
    place.write("scene.toml", format!("{SCENE}\n[[particles]]\ncolor = [0.9, 0.1, 0.0]\n{set}"));
    place
}

/// The line with the verdict.
fn verdict(text: &str) -> &str {
    let lines: Vec<&str> =
        text.lines().filter(|line| line.starts_with("verified:") || line.starts_with("not held:")).collect();
    assert_eq!(lines.len(), 1, "{text}");
    lines[0]
}

#[test]
fn a_promise_that_holds() {
    let place = two_colours();
    let run = place.run("render scene.toml --method reference --verify").ok();
    let line = verdict(&run.stdout);
    assert!(line.starts_with("verified: largest error ") && line.contains("e-8 of all 1728 pixels per eye"), "{line}");
    assert!(line.contains("within the tolerance 0.00392") && line.contains("the truth is known to "), "{line}");
    assert_eq!(run.stderr, "");
    // So many pixels of each eye; a scene without stereo has but one.
    let run = place.run("render scene.toml --method reference --verify 100").ok();
    assert!(verdict(&run.stdout).contains(" of 100 pixels per eye,"), "{}", run.stdout);
    place.write("one.toml", SCENE.replace("[stereo]\ninterocular = 0.3\nconvergence = 4.0\n", ""));
    let run = place.run("render one.toml --method reference --verify 100").ok();
    assert!(verdict(&run.stdout).contains(" of 100 pixels, within"), "{}", run.stdout);
    // Methods that promise nothing may hold all the same.
    let run = place.run("render scene.toml --method slab --verify all --tolerance 0.01").ok();
    let line = verdict(&run.stdout);
    assert!(
        line.starts_with("verified: method slab promises no error; its largest of all 1728 pixels per eye"),
        "{line}"
    );
    assert!(line.contains("within the tolerance 0.0100"), "{line}");
    // Unasked, nothing is measured.
    let run = place.run("render scene.toml").ok();
    assert!(!run.stdout.contains("verified") && !run.stdout.contains("held"));
    assert_eq!(place.json("out/scene.json")["verification"], Value::Null);
}

#[test]
fn a_promise_that_does_not_hold() {
    let place = two_colours();
    let run = place.run("render scene.toml --method perspective --verify 500");
    assert_eq!((run.code, run.stderr.as_str()), (Some(1), ""), "{run:?}");
    let line = verdict(&run.stdout);
    assert!(line.starts_with("not held: method perspective promises no error; it is 0."), "{line}");
    for word in ["beyond the tolerance 0.00392: error 0.", " eye, column ", ", row ", " instead of ", "500 pixels"] {
        assert!(line.contains(word), "{word}: {line}");
    }
    // The pictures are there, as without it.
    let pictures = ["left", "right", "anaglyph", "sbs"].map(|format| place.bytes(&format!("out/scene.{format}.png")));
    place.run("render scene.toml --method perspective -o plain").ok();
    for (format, bytes) in ["left", "right", "anaglyph", "sbs"].iter().zip(&pictures) {
        assert_eq!(&place.bytes(&format!("plain/scene.{format}.png")), bytes, "{format}");
    }
    // A tolerance that no f32 can keep: what is promised is not.
    let run = place.run("render scene.toml --method reference --tolerance 0 --verify");
    assert_eq!(run.code, Some(1), "{run:?}");
    let line = verdict(&run.stdout);
    assert!(line.starts_with("not held: error ") && line.contains("beyond the tolerance 0; all 1728"), "{line}");
}

#[test]
fn quiet_speaks_of_what_fails_alone() {
    let place = two_colours();
    let run = place.run("render scene.toml --method reference --verify --quiet");
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(0), "", ""));
    let run = place.run("render scene.toml --method perspective --verify --quiet");
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.lines().count()), (Some(1), "", 1), "{run:?}");
    assert!(verdict(&run.stderr).starts_with("not held: "), "{run:?}");
    assert!(place.path("out/scene.left.png").exists());
}

#[test]
fn the_record_holds_what_was_measured() {
    let place = two_colours();
    let run = place.run("render scene.toml --method perspective --verify 500 --json");
    assert_eq!((run.code, run.stderr.as_str()), (Some(1), ""), "{run:?}");
    assert_eq!(run.stdout.as_bytes(), place.bytes("out/scene.json"));
    let record = place.json("out/scene.json");
    let found = &record["verification"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{found}"));
    assert_eq!((&found["pixels"], &found["all"]), (&500.into(), &false.into()));
    assert_eq!((&found["held"], &found["promised"]), (&false.into(), &false.into()));
    assert_eq!((&found["tolerance"], &found["predicted_error"]), (&(1.0 / 255.0).into(), &Value::Null));
    let [largest, rmse, quantile] = ["largest", "rmse", "quantile_99"].map(|key| number(&found[key]));
    assert!(largest > 0.01 && largest < 1.0 && rmse > 0.0 && rmse < quantile && quantile <= largest, "{found}");
    let at = &found["where"];
    // But for the last digit of what was read.
    assert!(((number(&at["drawn"]) - number(&at["truth"])).abs() - largest).abs() < 1e-15, "{found}");
    assert!(["left", "right"].iter().any(|eye| at["eye"] == *eye), "{found}");
    assert!(["red", "green", "blue"].iter().any(|channel| at["channel"] == *channel), "{found}");
    assert!(number(&at["column"]) < 48.0 && number(&at["row"]) < 36.0, "{found}");
    assert!(number(&found["transmittance"]["largest"]) < 1e-3, "{found}");
    assert_eq!(found["transmittance"]["where"]["channel"], "transmittance");
    assert!(number(&found["reference_bound"]) < 1e-9 && number(&found["seconds"]) > 0.0, "{found}");
    assert!(number(&record["timings_ms"]["verify"]) > 0.0);
    // What is said of the place is what is in the picture there.
    place.run("render scene.toml --method perspective --image exr --format left,right -o exr").ok();
    let picture = place.picture(&format!("exr/scene.{}.exr", at["eye"].as_str().unwrap()));
    let channel = ["red", "green", "blue"].iter().position(|channel| at["channel"] == *channel).unwrap();
    let pixel = number(&at["row"]) as usize * 48 + number(&at["column"]) as usize;
    assert_eq!(f64::from(picture.color[channel][pixel]), number(&at["drawn"]));
    // The same whatever the threads, and held at the exit code of a larger tolerance.
    let other = place.run("render scene.toml --method perspective --verify 500 --json --threads 1 --tolerance 1");
    let other = other.json();
    assert_eq!(other["verification"]["held"], true);
    let same = place.run("render scene.toml --method perspective --verify 500 --quiet --threads 1");
    assert_eq!(same.code, Some(1));
    assert_eq!(&place.json("out/scene.json")["verification"]["where"], at);
    let promised = place.run("render scene.toml --method reference --verify --json").json();
    assert_eq!(
        (&promised["verification"]["held"], &promised["verification"]["promised"]),
        (&true.into(), &true.into())
    );
    assert_eq!((&promised["verification"]["pixels"], &promised["verification"]["all"]), (&1728.into(), &true.into()));
}

#[test]
fn numbers_of_pixels_that_cannot_be() {
    let place = Place::new();
    for count in ["0", "-1", "-4096", "1.5", "many", "All", "1e3", "99999999999999999999", "٣", "4096,all"] {
        let says = [format!("--verify {count}:"), "from 1 up".into(), "all".into(), "4096".into()];
        let run = place.run(&format!("render scene.toml --verify {count}"));
        run.refused(2, &says.each_ref().map(String::as_str));
    }
    // What stands where the number would be is no scene.
    place.run("render --verify scene.toml").refused(2, &["<SCENE>"]);
    assert_eq!(place.files(), ["scene.toml"]);
}
