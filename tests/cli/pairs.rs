//! Two stereo pairs through the real program: from a scene to its left-right inconsistency.

use super::{Place, SCENE};
use serde_json::Value;
use stereomist::picture::Side;

/// One particle off the axis, near the eyes.
const NEAR: &str = r#"
[camera]
position = [0.0, 0.0, 0.0]
look_at = [0.0, 0.0, -1.0]
fov_y_deg = 70.0
size = [48, 36]

[stereo]
interocular = 0.1
convergence = 2.0

[background]
color = [0.1, 0.2, 0.4]

[[particles]]
file = "one.csv"
"#;

/// The scene by the reference with disparity, in `t`, and by these methods, in folders of their names.
fn rendered(scene: &str, methods: &[&str]) -> Place {
    let place = Place::empty();
    place.write("s.toml", scene);
    place.write("one.csv", "x,y,z,radius,opacity,r,g,b\n0.8,0.3,-1.6,0.4,0.8,0.9,0.7,0.3\n");
    let render = |more: &str| {
        place.run(&format!("render s.toml --image exr --format left,right --quiet {more}")).ok();
    };
    render("-o t --method reference --set render.method.reference.disparity=true");
    methods.iter().for_each(|method| render(&format!("-o {method} --method {method}")));
    place
}

/// What `compare` says of a method's pair.
fn compared(place: &Place, method: &str) -> Value {
    let words = format!("compare {method}/s.left.exr t/s.left.exr {method}/s.right.exr t/s.right.exr --json");
    place.run(&words).json()
}

#[test]
fn errors_that_the_eyes_share_are_less_inconsistent_than_they_are_large() {
    let place = rendered(SCENE, &["viewplane"]);
    let report = compared(&place, "viewplane");
    let found = &report["inconsistency"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}: {report}"));
    let rmse = number(&found["rmse"]);
    assert!(rmse > 1e-4 && rmse < number(&report["rmse"]) && rmse < number(&found["own_rmse"]), "{report}");
    assert!(number(&found["max"]) >= rmse && number(&found["share"]) > 0.4 && number(&found["share"]) < 1.0);
    assert_eq!(number(&found["pixels"]) / (48.0 * 36.0), number(&found["share"]));
    assert_eq!((&found["scale"], &found["not_finite"]), (&"linear".into(), &0.into()));
    for key in ["max_of_channels", "rmse_of_channels", "max_at"] {
        assert!(found[key].as_array().is_some_and(|list| list.iter().all(Value::is_number)), "{key}: {report}");
    }
    assert!(found["max_channel"].is_string() && report["inconsistency_why"].is_null(), "{report}");
    let words = place.run("compare viewplane/s.left.exr t/s.left.exr viewplane/s.right.exr t/s.right.exr").ok().stdout;
    assert!(words.contains("left-right inconsistency") && words.contains(&format!("RMSE {rmse:.6}")), "{words}");

    // The truth against itself, through the file and back.
    let itself = compared(&place, "t");
    assert_eq!((&itself["inconsistency"]["max"], &itself["max"]), (&0.0.into(), &0.0.into()));
    // Eyes in the wrong order, and pictures alone in it.
    let swapped = "compare viewplane/s.right.exr t/s.right.exr viewplane/s.left.exr t/s.left.exr --json";
    place.run(swapped).refused(2, &["swapped", "disparityR.x"]);
    let crossed = "compare viewplane/s.right.exr t/s.left.exr viewplane/s.left.exr t/s.right.exr --json";
    let crossed = place.run(crossed).json();
    assert!(number(&crossed["inconsistency"]["rmse"]) > 5.0 * rmse, "{crossed}");
}

#[test]
fn perspective_is_more_consistent_than_viewplane() {
    let place = rendered(NEAR, &["viewplane", "perspective"]);
    let [viewplane, perspective] = ["viewplane", "perspective"].map(|method| {
        let report = compared(&place, method);
        report["inconsistency"]["rmse"].as_f64().unwrap_or_else(|| panic!("{report}"))
    });
    assert!(perspective < 1e-4 && viewplane > 1e-3, "{perspective} {viewplane}");
}

#[test]
fn disparity_stands_in_exr_files_of_single_views_alone() {
    let place = rendered(SCENE, &[]);
    let record = place.json("t/s.json");
    assert_eq!(record["settings"]["parameters"]["disparity"], true);
    for (name, side) in [("left", Side::Left), ("right", Side::Right)] {
        let disparity = place.picture(&format!("t/s.{name}.exr")).disparity.unwrap();
        assert!(disparity.side == side && disparity.x.iter().any(|x| x.is_nan()));
        // The screen plane is in the middle of the gas: some of it is before, some behind.
        assert!(disparity.x.iter().any(|x| *x > 0.2) && disparity.x.iter().any(|x| *x < -0.2));
    }
    let words = "render s.toml --method reference --set render.method.reference.disparity=true";
    place.run(&format!("{words} --image exr --format sbs,anaglyph -o other")).ok();
    for name in ["sbs", "anaglyph"] {
        assert_eq!(place.picture(&format!("other/s.{name}.exr")).disparity, None);
    }
    assert!(!place.json("other/s.json")["notes"].to_string().contains("disparity"));
    place.run(&format!("{words} --format left -o other")).ok();
    assert!(place.json("other/s.json")["notes"].to_string().contains("exr alone"));
    place.run(&format!("{words} --set stereo.mode=toe-in")).refused(2, &["toe-in", "parallel"]);
}

#[test]
fn two_pairs_have_one_bar() {
    let place = rendered(SCENE, &["viewplane"]);
    place.run("compare viewplane/s.left.exr t/s.left.exr --heatmap one.png").ok();
    place.run("compare viewplane/s.left.exr t/s.left.exr viewplane/s.right.exr t/s.right.exr --heatmap two.png").ok();
    let [one, two] = ["one.png", "two.png"].map(|name| place.picture(name).size);
    assert!(two[1] == one[1] && two[0] >= one[0] + 40 && two[0] <= one[0] + 60, "{one:?} {two:?}");
}
