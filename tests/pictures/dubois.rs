use std::process::Command;

use stereomist::picture::color::{encode_u8, interleave_u8};
use stereomist::picture::dubois::*;
use stereomist::picture::packing::{Options, PACKINGS, packing};
use stereomist::picture::read::{Samples, read};

use super::{data, from_codes, gradient};
use crate::harness::skipped;

#[test]
fn rows_sum_to_one_within_their_printed_precision() {
    for m in MATRICES {
        // Six numbers rounded at the last printed place.
        let slack = match m.name {
            // Blue of the right view, 1.2264, is printed to four places.
            "dubois-2001" => 6e-5,
            "dubois-2009" => 6.0 * 0.0005,
            _ => 6.0 * 0.0005 + 6.0 / 65536.0,
        };
        for row in 0..3 {
            let sum: f64 = m.left[row].iter().chain(&m.right[row]).sum();
            assert!((sum - 1.0).abs() <= slack, "{}: row {row} sums to {sum}", m.name);
        }
    }
}

#[test]
fn ffmpeg_is_2001_to_three_decimals() {
    let (full, ints) = (matrix("dubois-2001").expect("known"), matrix("ffmpeg").expect("known"));
    for row in 0..3 {
        for column in 0..3 {
            for (a, b) in [(&full.left, &ints.left), (&full.right, &ints.right)] {
                assert!((a[row][column] - b[row][column]).abs() < 0.0006, "{row} {column}");
            }
        }
    }
}

/// Colours and what Dubois 2001 makes of them, in encoded and in linear space, computed apart from the code.
#[test]
fn golden_colours() {
    // Left, right, mixed encoded, mixed in linear light.
    let rows: [[[u8; 3]; 4]; 6] = [
        [[255, 0, 0], [255, 0, 0], [105, 86, 0], [172, 157, 0]],
        [[0, 255, 0], [0, 255, 0], [105, 177, 0], [172, 217, 0]],
        [[255, 140, 0], [255, 140, 0], [163, 184, 0], [191, 191, 0]],
        [[135, 206, 235], [135, 206, 235], [182, 181, 248], [187, 185, 245]],
        [[128, 128, 128], [0, 0, 0], [145, 0, 0], [136, 0, 0]],
        [[200, 200, 200], [60, 60, 60], [219, 47, 54], [211, 0, 42]],
    ];
    let matrix = &MATRICES[0];
    for [left, right, encoded, linear] in rows {
        let (l, r) = (from_codes([1, 1], &[left]), from_codes([1, 1], &[right]));
        for (space, expected) in [(Space::Encoded, encoded), (Space::Linear, linear)] {
            let (picture, _) = anaglyph(&l, &r, matrix, space);
            for (plane, wanted) in picture.color.iter().zip(expected) {
                let code = encode_u8(plane[0]);
                assert!(code.abs_diff(wanted) <= 1, "{left:?} {right:?} {space:?}: {code} not {wanted}");
            }
        }
    }
}

#[test]
fn greys_stay_and_are_not_clipped() {
    let codes: Vec<[u8; 3]> = (0..=255).map(|v| [v; 3]).collect();
    let grey = from_codes([256, 1], &codes);
    for m in MATRICES {
        for &space in Space::ALL {
            let (picture, clipped) = anaglyph(&grey, &grey, m, space);
            let worst =
                interleave_u8(&picture.color).iter().zip(codes.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
            // 2009 is printed to three decimals: its green row sums to 0.999.
            assert!(worst <= Some(1), "{} {space:?}: {worst:?}", m.name);
            assert_eq!(clipped, 0, "{} {space:?}", m.name);
        }
    }
}

#[test]
fn out_of_gamut_samples_are_kept_and_counted() {
    let red = from_codes([2, 1], &[[255, 0, 0], [0, 0, 0]]);
    let (picture, clipped) = anaglyph(&red, &red, &MATRICES[0], Space::Linear);
    // Blue: -0.0152161 - 0.0721527.
    assert!((picture.color[2][0] + 0.087_368_8).abs() < 1e-7);
    assert_eq!(clipped, 1);
    assert!(picture.alpha.is_none());
}

#[test]
fn matches_ffmpeg_to_the_byte() {
    let (left, right) =
        (read(&data("motorcycle_left.png")).expect("left"), read(&data("motorcycle_right.png")).expect("right"));
    let (picture, clipped) = anaglyph(&left.picture, &right.picture, matrix("ffmpeg").expect("known"), Space::Encoded);
    let Samples::U8(expected) = read(&data("motorcycle_arcd.png")).expect("expected").samples else {
        panic!("8-bit data");
    };
    assert!(interleave_u8(&picture.color) == expected, "differs from the picture that ffmpeg made");
    assert!(clipped > 0, "the crop should hold out-of-gamut samples, or clipping is not tested");
    // The comparison must be able to fail.
    let (other, _) = anaglyph(&left.picture, &right.picture, &MATRICES[0], Space::Encoded);
    assert!(interleave_u8(&other.color) != expected);
}

/// As above with ffmpeg itself, where there is one: random pictures, which reach every sum.
#[test]
fn matches_ffmpeg_as_installed() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        // Where the check must not be missing, its absence is a failure.
        let required = std::env::var("STEREOMIST_FFMPEG").is_ok_and(|value| value == "require");
        assert!(!required, "STEREOMIST_FFMPEG=require, and there is no ffmpeg on PATH");
        skipped("the comparison with ffmpeg itself (none on PATH); compared with a picture of ffmpeg's alone");
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut state = 12345_u32;
    let mut random = || -> Vec<[u8; 3]> {
        let mut byte = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..128 * 64).map(|_| [byte(), byte(), byte()]).collect()
    };
    let pictures = [random(), random()].map(|codes| from_codes([128, 64], &codes));
    let paths = ["l.png", "r.png", "out.png"].map(|name| folder.path().join(name));
    for (picture, path) in pictures.iter().zip(&paths) {
        stereomist::picture::output::write_picture(path, picture, &stereomist::picture::output::WRITERS[0])
            .expect("written");
    }
    let done = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-i"])
        .arg(&paths[0])
        .arg("-i")
        .arg(&paths[1])
        .args(["-filter_complex", "[0][1]hstack,format=rgb24,stereo3d=sbsl:arcd"])
        .arg(&paths[2])
        .status()
        .expect("ffmpeg runs");
    assert!(done.success());
    let (ours, _) = anaglyph(&pictures[0], &pictures[1], matrix("ffmpeg").expect("known"), Space::Encoded);
    assert!(read(&paths[2]).expect("ffmpeg's picture").samples == Samples::U8(interleave_u8(&ours.color)));
}

#[test]
fn packings_put_each_view_where_it_belongs() {
    let (left, right) = (from_codes([2, 1], &[[1, 2, 3], [4, 5, 6]]), from_codes([2, 1], &[[7, 8, 9], [10, 11, 12]]));
    let pack = |name: &str| {
        let packed = (packing(name).expect("known").pack)(&left, &right, &Options::default()).expect("packed");
        (packed.picture.size, interleave_u8(&packed.picture.color))
    };
    assert_eq!(pack("left"), ([2, 1], vec![1, 2, 3, 4, 5, 6]));
    assert_eq!(pack("right"), ([2, 1], vec![7, 8, 9, 10, 11, 12]));
    assert_eq!(pack("sbs"), ([4, 1], (1..=12).collect()));
    assert_eq!(pack("anaglyph").0, [2, 1]);
    assert!(packing("mono").is_err());
}

#[test]
fn every_packing_refuses_views_of_different_sizes() {
    for p in PACKINGS {
        let error = (p.pack)(&gradient([4, 3]), &gradient([3, 4]), &Options::default()).expect_err(p.name);
        assert_eq!(error.exit_code(), 2);
        let text = error.to_string();
        assert!(text.contains("4 x 3") && text.contains("3 x 4"), "{text}");
    }
}

#[test]
fn sbs_keeps_alpha_where_both_have_it() {
    let (a, mut b) = (gradient([3, 2]), gradient([3, 2]));
    let sbs = packing("sbs").expect("known").pack;
    let both = sbs(&a, &b, &Options::default()).expect("packed").picture;
    assert_eq!(both.alpha.as_ref().map(|plane| plane.len()), Some(12));
    both.check().expect("whole");
    b.alpha = None;
    assert!(sbs(&a, &b, &Options::default()).expect("packed").picture.alpha.is_none());
}
