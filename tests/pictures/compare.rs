use std::fs;
use std::path::PathBuf;

use clap::Parser;
use stereomist::cli::compare::CompareArgs;
use stereomist::cli::compose::ComposeArgs;
use stereomist::picture::output::{WRITERS, write_picture, writer};
use stereomist::picture::read::{Samples, read, read_bytes};
use stereomist::picture::{Picture, color};
use stereomist::study::metrics::{self, Difference, Scale};
use stereomist::study::plot::difference_map::{self, EQUAL, NOT_FINITE};
use stereomist::study::plot::ticks::Ticks;
use tempfile::{TempDir, tempdir};

use super::{data, from_codes, gradient};

#[derive(Parser)]
struct Compare {
    #[command(flatten)]
    args: CompareArgs,
}

#[derive(Parser)]
struct Compose {
    #[command(flatten)]
    args: ComposeArgs,
}

fn compare(words: &[&str]) -> stereomist::Result<u8> {
    Compare::try_parse_from([&["compare"], words].concat()).expect("parses").args.run()
}

fn compose(words: &[&str]) -> stereomist::Result<u8> {
    Compose::try_parse_from([&["compose"], words].concat()).expect("parses").args.run()
}

/// Writes pictures into a fresh folder; gives their paths.
fn files(pictures: &[(&str, &str, &Picture)]) -> (TempDir, Vec<String>) {
    let folder = tempdir().expect("a temporary folder");
    let paths = pictures
        .iter()
        .map(|(name, format, picture)| {
            let path = folder.path().join(name);
            write_picture(&path, picture, writer(format).expect("known")).expect("written");
            path.to_string_lossy().into_owned()
        })
        .collect();
    (folder, paths)
}

fn difference(format: &str, a: &Picture, b: &Picture) -> Difference {
    let encode = writer(format).expect("known").encode;
    let [a, b] = [a, b].map(|p| read_bytes(&encode(p).expect("encodes")).expect("reads"));
    metrics::compare(&a, &b).expect("one size")
}

#[test]
fn equal_pictures_are_equal() {
    let picture = gradient([40, 30]);
    for w in WRITERS {
        let d = difference(w.name, &picture, &picture);
        assert_eq!((d.max, d.rmse, d.psnr, d.differing), (0.0, 0.0, f64::INFINITY, 0), "{}", w.name);
        assert!((d.ssim - 1.0).abs() < 1e-12);
        assert_eq!(d.scale, if w.name == "exr" { Scale::Linear } else { Scale::Encoded });
    }
}

/// The comparer must fail on a difference that is known to be there: one step of one sample.
#[test]
fn one_planted_step_is_found() {
    let a = gradient([40, 30]);
    let codes = color::interleave_u8(&a.color);
    let mut b = a.clone();
    let i = 17 * 40 + 5;
    b.color[1][i] = color::decode_u8(codes[3 * i + 1].wrapping_add(1));
    let d = difference("png", &a, &b);
    assert_eq!((d.max, d.max_at, d.max_channel, d.differing), (1.0 / 255.0, [5, 17], 1, 1));
    assert!((d.rmse - (1.0 / 255.0) / (3.0 * 1200.0_f64).sqrt()).abs() < 1e-12);
    assert!((d.psnr + 20.0 * d.rmse.log10()).abs() < 1e-9);
    assert!(d.ssim < 1.0);
    assert_eq!(d.map.iter().filter(|v| **v > 0.0).count(), 1);

    let (_folder, paths) = files(&[("a.png", "png", &a), ("b.png", "png", &b)]);
    let [a, b] = [paths[0].as_str(), paths[1].as_str()];
    assert_eq!(compare(&[a, a, "--max", "0"]).expect("runs"), 0);
    assert_eq!(compare(&[a, b, "--max", "0"]).expect("runs"), 1);
    assert_eq!(compare(&[a, b, "--max", "0.0039"]).expect("runs"), 1);
    // One step is exactly 1/255, so a limit of 1/255 lets it pass.
    assert_eq!(compare(&[a, b, "--max", "0.00392156862745098"]).expect("runs"), 0);
    assert_eq!(compare(&[a, b]).expect("runs"), 0);
    // In the second pair, too.
    assert_eq!(compare(&[a, a, a, a, "--max", "0"]).expect("runs"), 0);
    assert_eq!(compare(&[a, a, a, b, "--max", "0"]).expect("runs"), 1);
    assert_eq!(compare(&[a, b, a, a, "--max", "0", "--json"]).expect("runs"), 1);
}

#[test]
fn nan_never_passes() {
    let a = gradient([12, 12]);
    let mut b = a.clone();
    b.color[2][7] = f32::NAN;
    for (x, y) in [(&a, &b), (&b, &a), (&b, &b)] {
        let d = difference("exr", x, y);
        assert_eq!((d.max, d.not_finite, d.max_at), (f64::INFINITY, 1, [7, 0]));
    }
}

#[test]
fn floats_are_compared_in_linear_light_and_alpha_apart() {
    let a = gradient([12, 12]);
    let mut b = a.clone();
    b.color[0][3] += 0.25;
    b.alpha.as_mut().expect("alpha")[9] += 0.5;
    let d = difference("exr", &a, &b);
    assert!((d.max - 0.25).abs() < 1e-6);
    assert!((d.alpha_max.expect("both") - 0.5).abs() < 1e-6);
}

#[test]
fn depths_are_mixed_exactly() {
    let codes: Vec<[u8; 3]> = (0..=255).map(|v| [v, 255 - v, v / 2]).collect();
    let picture = from_codes([16, 16], &codes);
    let [eight, sixteen] = ["png", "png16"]
        .map(|f| read_bytes(&(writer(f).expect("known").encode)(&picture).expect("encodes")).expect("reads"));
    assert!(matches!((&eight.samples, &sixteen.samples), (Samples::U8(_), Samples::U16(_))));
    assert_eq!(metrics::compare(&eight, &sixteen).expect("one size").max, 0.0);
}

/// SSIM of a plane against itself shifted in mean: variance terms cancel, the mean term has a closed form.
#[test]
fn ssim_has_its_closed_forms() {
    let (a, b) = (vec![0.5; 400], vec![0.6; 400]);
    let expected = (2.0 * 0.5 * 0.6 + 1e-4) / (0.25 + 0.36 + 1e-4);
    assert!((metrics::ssim(&a, &b, 20) - expected).abs() < 1e-9);
    // Pictures smaller than the window have one.
    for width in [1, 2, 7] {
        assert!((metrics::ssim(&a[..14], &b[..14], width) - expected).abs() < 1e-9, "{width}");
    }
    // Against its negative about the mean, structure is opposite.
    let wave: Vec<f64> = (0..900).map(|i| 0.5 + 0.4 * f64::from(i % 30).sin()).collect();
    let against: Vec<f64> = wave.iter().map(|v| 1.0 - v).collect();
    assert!(metrics::ssim(&wave, &against, 30) < -0.8);
}

/// Figures of the two views of a photograph, computed apart from the code (numpy, same definitions).
#[test]
fn ssim_of_a_photograph() {
    let [left, right] = ["motorcycle_left.png", "motorcycle_right.png"].map(|n| read(&data(n)).expect("reads"));
    let d = metrics::compare(&left, &right).expect("one size");
    assert!((d.ssim - SSIM).abs() < 1e-9, "{}", d.ssim);
    assert!((d.rmse - RMSE).abs() < 1e-12, "{}", d.rmse);
}
const SSIM: f64 = 0.099_632_909_617_689_84;
const RMSE: f64 = 0.321_306_174_531_201_5;

/// The pixels of a map of `size` at the top left of a picture, as sRGB codes.
fn corner(picture: &Picture, [width, height]: [usize; 2]) -> Vec<[u8; 3]> {
    (0..width * height).map(|i| code(picture, i % width, i / width)).collect()
}

fn code(picture: &Picture, column: usize, row: usize) -> [u8; 3] {
    [0, 1, 2].map(|c| color::encode_u8(picture.color[c][row * picture.size[0] as usize + column]))
}

#[test]
fn heat_map_shows_where() {
    let a = gradient([20, 10]);
    let mut b = a.clone();
    b.color[0][25] = 0.9;
    let (folder, paths) = files(&[("a.png", "png", &a), ("b.png", "png", &b)]);
    let map = folder.path().join("map.png");
    assert_eq!(compare(&[&paths[0], &paths[1], "--heatmap", &map.to_string_lossy()]).expect("runs"), 0);
    let picture = read(&map).expect("reads").picture;
    let lit: Vec<usize> = (0..200).filter(|&i| corner(&picture, [20, 10])[i] != EQUAL).collect();
    assert_eq!(lit, [25]);
    let bar = picture.size[0] - 20;
    assert!(picture.size[1] > 200 && (100..250).contains(&bar), "{:?}", picture.size);
    // Below a low map the sheet is white.
    assert!((0..20).all(|column| code(&picture, column, 10) == [255; 3]));
    // Two pairs stand side by side; equal pictures give black.
    assert_eq!(
        compare(&[&paths[0], &paths[0], &paths[1], &paths[1], "--heatmap", &map.to_string_lossy()]).expect("runs"),
        0
    );
    let picture = read(&map).expect("reads").picture;
    assert!(corner(&picture, [40, 10]).iter().all(|code| *code == EQUAL));
    assert_eq!(code(&picture, 40, 0), [255; 3]);
}

/// Every value's colour in the map is the bar's at that value's height, and the ticks stand at their values.
#[test]
fn heat_map_and_its_bar_agree() {
    for (top, height) in [(1.0, 300), (0.037, 520), (2.5e-5, 40)] {
        let (width, size) = (64, [64, height]);
        let mut d = difference("exr", &Picture::new(size), &Picture::new(size));
        let n = d.map.len();
        for (i, value) in d.map.iter_mut().enumerate() {
            *value = (top * i as f64 / (n - 1) as f64) as f32;
        }
        let picture = difference_map::picture(std::slice::from_ref(&d), top, "difference").expect("one height");
        let map = corner(&picture, [width, height as usize]);
        assert_eq!(map[0], EQUAL);
        // Where the bar stands: 16 pixels from the map and the top, 18 wide, 56 above the lower edge.
        let column = width + 16 + 9;
        let (first, last) = (16.0, f64::from(picture.size[1]) - 56.0);
        assert!(last - first > 180.0, "{first} to {last}");
        let row_of = |value: f64| first + (last - first) * (1.0 - value / top);
        let mut seen = Vec::new();
        for (value, code_of_map) in d.map.iter().zip(&map).skip(1) {
            // Clear of the frame.
            let row = row_of(f64::from(*value)).clamp(first + 1.0, last - 2.0) as usize;
            let of_bar = code(&picture, column, row);
            let off = (0..3).map(|c| of_bar[c].abs_diff(code_of_map[c])).max().expect("three");
            // A pixel of the bar or two, and its gradient in 32 pieces.
            assert!(off <= 12, "{value}: {code_of_map:?} in the map, {of_bar:?} in row {row} of the bar");
            seen.push(*code_of_map);
        }
        seen.dedup();
        assert!(seen.len() > 150, "{} colours", seen.len());
        let ticks = Ticks::along(0.0, top, last - first, |_| 32.0);
        assert!(ticks.values.len() > 2);
        let dark =
            |row: usize| (0..3).any(|dy| code(&picture, width + 16 + 18 + 3, row + dy - 1).iter().all(|&v| v < 0xc0));
        for &value in &ticks.values {
            assert!(dark(row_of(value).round() as usize), "no tick at {value}");
            let between = value + 0.5 * ticks.step;
            assert!(between > top || !dark(row_of(between).round() as usize), "a tick at {between}");
        }
    }
}

#[test]
fn what_is_no_number_has_a_colour_of_its_own() {
    let a = gradient([20, 10]);
    let mut b = a.clone();
    (b.color[0][3], b.color[1][7], b.color[2][9]) = (f32::NAN, f32::INFINITY, a.color[2][9] + 0.5);
    let d = [difference("exr", &a, &b)];
    let picture = difference_map::picture(&d, 0.5, "").expect("one height");
    let map = corner(&picture, [20, 10]);
    assert_eq!((map[3], map[7], map[8]), (NOT_FINITE, NOT_FINITE, EQUAL));
    assert!(map[9] != NOT_FINITE && map[9][0] > 200, "{:?}", map[9]);
    // Its key is there only where it is needed.
    let has = |picture: &Picture| {
        let [width, height] = picture.size.map(|n| n as usize);
        (20..width).any(|column| (0..height).any(|row| code(picture, column, row) == NOT_FINITE))
    };
    assert!(has(&picture));
    assert!(!has(&difference_map::picture(&[difference("exr", &a, &a)], 0.5, "").expect("one height")));
    // Nothing but infinities, through the command.
    let mut c = a.clone();
    c.color[0][0] = f32::NAN;
    let (folder, paths) = files(&[("a.exr", "exr", &a), ("c.exr", "exr", &c)]);
    let map = folder.path().join("map.png");
    assert_eq!(compare(&[&paths[0], &paths[1], "--heatmap", &map.to_string_lossy()]).expect("runs"), 0);
    assert_eq!(code(&read(&map).expect("reads").picture, 0, 0), NOT_FINITE);
    let tall = difference("exr", &gradient([4, 5]), &gradient([4, 5]));
    assert_eq!(difference_map::picture(&[d[0].clone(), tall], 1.0, "").expect_err("heights").exit_code(), 2);
}

#[test]
fn wrong_use_is_exit_2() {
    let (_folder, paths) = files(&[("a.png", "png", &gradient([8, 8])), ("b.png", "png", &gradient([8, 9]))]);
    let [a, b] = [paths[0].as_str(), paths[1].as_str()];
    let error = compare(&[a, b]).expect_err("sizes differ");
    assert!(error.exit_code() == 2 && error.to_string().contains("8 x 9"), "{error}");
    for words in [&[a, a, a][..], &[a, "nowhere.png"], &[a, a, "--heatmap", "map.gif"]] {
        assert_eq!(compare(words).expect_err("wrong").exit_code(), 2, "{words:?}");
    }
    for words in [&["compare", a][..], &["compare", a, a, "--max", "NaN"], &["compare", a, a, "--max=-1"]] {
        assert!(Compare::try_parse_from(words).is_err(), "{words:?}");
    }
    for words in [&[a, b, "-o", "x.png"][..], &[a, a, "-o", "x.gif"], &[a, a, "-o", "-", "--json"]] {
        assert_eq!(compose(words).expect_err("wrong").exit_code(), 2, "{words:?}");
    }
    assert!(!PathBuf::from("x.png").exists());
    assert!(Compose::try_parse_from(["compose", a, a, "-o", "x.png", "--format", "3d"]).is_err());
}

#[test]
fn compose_makes_each_format() {
    let folder = tempdir().expect("a temporary folder");
    let [left, right] = ["motorcycle_left.png", "motorcycle_right.png"].map(|n| data(n).to_string_lossy().into_owned());
    let out = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let run = |name: &str, more: &[&str]| {
        let path = out(name);
        let words = [&[left.as_str(), &right, "-o", &path], more].concat();
        assert_eq!(compose(&words).expect("runs"), 0);
        read(path.as_ref()).expect("reads")
    };
    let ffmpeg = run("f.png", &["--matrix", "ffmpeg", "--space", "encoded"]);
    assert!(ffmpeg == read(&data("motorcycle_arcd.png")).expect("reads"));
    assert!(run("l.png", &["--format", "left"]) == read(left.as_ref()).expect("reads"));
    assert!(run("r.png", &["--format", "right"]) == read(right.as_ref()).expect("reads"));
    assert_eq!(run("s.jpg", &["--format", "sbs"]).picture.size, [320, 120]);
    // Floats keep what integers clip, and agree where neither does.
    let (float, integer) = (run("a.exr", &[]), run("a.png", &[]));
    assert!(float.picture.color.iter().flatten().any(|v| *v < -0.01));
    assert!(integer.samples == Samples::U8(color::interleave_u8(&float.picture.color)));
    assert!(matches!(run("b.png", &["--image", "png16"]).samples, Samples::U16(_)));
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 7);
}
