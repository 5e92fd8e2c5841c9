//! The shipped scenes, and what their pictures must show: that the eyes are where they should be.

use super::{Place, Run, repository};
use std::path::PathBuf;
use std::process::Command;
use stereomist::picture::{Picture, Plane};

/// The shipped scene files.
fn shipped() -> Vec<PathBuf> {
    let mut scenes: Vec<PathBuf> = std::fs::read_dir(repository("scenes"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    scenes.sort();
    scenes
}

/// Largest spread of a channel over the picture.
fn contrast(picture: &Picture) -> f32 {
    let spread = |plane: &Plane<f32>| {
        let (low, high) = plane.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
        high - low
    };
    picture.color.iter().map(spread).fold(0.0, f32::max)
}

#[test]
fn every_shipped_scene_renders() {
    let scenes = shipped();
    assert!(scenes.len() >= 8, "{scenes:?}");
    for scene in &scenes {
        let place = Place::empty();
        let stem = scene.file_stem().unwrap().to_str().unwrap();
        let mut command = Command::new(super::PROGRAM);
        // Floats: the performance scenes are so dense that eight bits hold one grey for all of a picture.
        command.arg("render").arg(scene).args(["--size", "160x120", "--image", "exr", "-o"]).arg(place.path("out"));
        if stem.starts_with("walk-") {
            // As the paper drew them: by the truth's model of opacity they are denser still.
            command.args(["--method", "viewplane"]);
        }
        let run = Run::of(command.output().unwrap()).ok();
        assert_eq!(run.stderr, "", "{stem}");
        let picture = |format: &str| place.picture(&format!("out/{stem}.{format}.exr"));
        let least = if stem.starts_with("walk-") { 5e-4 } else { 0.1 };
        for format in ["left", "right", "anaglyph", "sbs"] {
            let contrast = contrast(&picture(format));
            assert!(contrast > least, "{stem}.{format} is uniform: {contrast}");
        }
        assert!(picture("left").color != picture("right").color, "{stem}: the eyes see the same");
    }
}

/// Columns that the weight of a plane lies at, in pixels from the left edge.
fn centre(plane: &[f32], width: usize) -> f64 {
    let weights = plane.iter().enumerate().map(|(i, &v)| ((i % width) as f64 + 0.5, f64::from(v.max(0.0))));
    let (sum, total) = weights.fold((0.0, 0.0), |(sum, total), (x, w)| (sum + x * w, total + w));
    assert!(total > 0.0, "the picture is black");
    sum / total
}

/// A white ball before a black background, `depth` in front of the eyes; the screen is 4 in front.
fn ball(depth: f64) -> Place {
    let place = Place::empty();
    place.write(
        "ball.toml",
        format!(
            "[camera]\nposition = [0, 0, 0]\nlook_at = [0, 0, -1]\nsize = [160, 80]\nfov_y_deg = 40\n\
             [stereo]\ninterocular = 0.2\nconvergence = 4\n[[particles]]\nradius = 0.2\nopacity = 0.95\n\
             color = [1, 1, 1]\n[particles.box]\nmin = [0, 0, {0}]\nmax = [0, 0, {0}]\ncount = 1\n",
            -depth
        ),
    );
    place
}

/// What is nearer than the screen has crossed parallax: the left eye sees it further right. Not so if the eyes are swapped.
#[test]
fn the_eyes_are_not_swapped() {
    for method in ["viewplane", "viewpoint", "perspective"] {
        for (depth, sign) in [(2.0, -1.0), (8.0, 1.0), (4.0, 0.0)] {
            let place = ball(depth);
            place.run(&format!("render ball.toml -o . --method {method}")).ok();
            let plane =
                |format: &str, channel: usize| place.picture(&format!("ball.{format}.png")).color[channel].clone();
            let (left, right) = (centre(&plane("left", 1), 160), centre(&plane("right", 1), 160));
            // p = I (1 - D/d) in the screen plane, whose width is 2 D tan(fov/2) times the aspect.
            let parallax = 0.2 * (1.0 - 4.0 / depth) * 160.0 / (2.0 * 4.0 * 20.0_f64.to_radians().tan() * 2.0);
            // A billboard that faces its eye is not the ball's exact projection, and its square edge, a step of 3 %, is
            // taken in whole pixels.
            let most = 0.1 + 0.02 * parallax.abs();
            assert!((right - left - parallax).abs() < most, "{method}, depth {depth}: {left} {right} {parallax}");
            assert_eq!(parallax.partial_cmp(&0.0), sign.partial_cmp(&0.0));
            // Vertical parallax is none.
            let rows = |format: &str| {
                let plane = plane(format, 1);
                let transposed: Vec<f32> = (0..160 * 80).map(|i| plane[(i % 80) * 160 + i / 80]).collect();
                centre(&transposed, 80)
            };
            assert!((rows("left") - rows("right")).abs() < 1e-6 && (rows("left") - 40.0).abs() < 0.01);

            // The red ghost of the anaglyph lies where the left eye sees the ball, the cyan one where the right does.
            let (red, cyan) = (centre(&plane("anaglyph", 0), 160), centre(&plane("anaglyph", 2), 160));
            let slack = 0.3 * parallax.abs() + 0.05;
            assert!(
                (red - left).abs() < slack && (cyan - right).abs() < slack,
                "{method}, depth {depth}: {red} {cyan}"
            );
            // Side by side: the left eye's picture on the left.
            let sbs = plane("sbs", 1);
            let half = |from: usize| -> Vec<f32> {
                sbs.chunks_exact(320).flat_map(|row| row[from..from + 160].to_vec()).collect()
            };
            assert_eq!(half(0), plane("left", 1)[..]);
            assert_eq!(half(160), plane("right", 1)[..]);
        }
    }
}

/// Where world and picture agree: right is right, up is up.
#[test]
fn right_is_right_and_up_is_up() {
    let place = ball(4.0);
    for (position, vertical) in [("[0.5,0,0]", false), ("[0,0.5,0]", true)] {
        let shift = format!("--set particles.0.position={position}");
        place.run_with(["render", "ball.toml", "-o", ".", "--format", "left"].into_iter().chain(shift.split(' '))).ok();
        let plane = &place.picture("ball.left.png").color[0];
        let [mut x, mut y, mut total] = [0.0; 3];
        for (i, &v) in plane.iter().enumerate() {
            (x, y, total) = (x + (i % 160) as f32 * v, y + (i / 160) as f32 * v, total + v);
        }
        let (x, y) = (x / total, y / total);
        if vertical {
            assert!(y < 35.0 && (x - 79.5).abs() < 0.1, "{x} {y}");
        } else {
            assert!(x > 84.0 && (y - 39.5).abs() < 0.1, "{x} {y}");
        }
    }
}
