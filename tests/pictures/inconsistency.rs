//! The left-right inconsistency against errors planted at known places.

use stereomist::picture::{Disparity, Picture, Plane, Side};
use stereomist::study::inconsistency::{Inconsistency, inconsistency};

const SIZE: [u32; 2] = [64, 8];
const WIDTH: usize = SIZE[0] as usize;
const PIXELS: usize = WIDTH * SIZE[1] as usize;

/// Pictures and truths of both eyes: left picture, left truth, right picture, right truth.
type Pair = [Picture; 4];

/// Truths of a smooth colour, pictures with these errors added: a function of channel, column (a real number in the left
/// eye's pixels) and row each; the disparity of each pixel of the right eye.
fn pair(
    left: impl Fn(usize, f64, usize) -> f64,
    right: impl Fn(usize, f64, usize) -> f64,
    disparity: impl Fn(usize, usize) -> f32,
) -> Pair {
    let x: Vec<f32> = (0..PIXELS).map(|i| disparity(i % WIDTH, i / WIDTH)).collect();
    let mut truth = Picture::new(SIZE);
    for (c, plane) in truth.color.iter_mut().enumerate() {
        for (i, value) in plane.iter_mut().enumerate() {
            *value = 0.25 + 0.125 * c as f32 + 1e-3 * (i % 50) as f32;
        }
    }
    let erring = |error: &dyn Fn(usize, f64, usize) -> f64| {
        let mut picture = truth.clone();
        for (c, plane) in picture.color.iter_mut().enumerate() {
            for (i, value) in plane.iter_mut().enumerate() {
                *value += error(c, (i % WIDTH) as f64, i / WIDTH) as f32;
            }
        }
        picture
    };
    let pictures = [erring(&left), erring(&right)];
    let [mut left_truth, mut right_truth] = [truth.clone(), truth.clone()];
    left_truth.disparity = Some(Disparity { side: Side::Left, x: x.iter().map(|d| -d).collect() });
    right_truth.disparity = Some(Disparity { side: Side::Right, x: x.into() });
    let [left, right] = pictures;
    [left, left_truth, right, right_truth]
}

fn measure([left, left_truth, right, right_truth]: &Pair) -> Inconsistency {
    inconsistency([left, left_truth], [right, right_truth]).expect("eyes in order").expect("a disparity")
}

/// A smooth error: no interpolation between pixels errs by more than 0.2 (2 pi/40)^2 / 8.
fn wave(c: usize, x: f64, y: usize) -> f64 {
    0.2 * (x * std::f64::consts::TAU / 40.0 + c as f64 + 0.3 * y as f64).sin()
}
const BENT: f64 = 0.2 * 0.0247 / 8.0;
/// Rounding of colours near 1 to f32, twice.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

#[test]
fn an_error_at_one_place_in_space_is_consistent() {
    for d in [0.0_f32, 3.0, -5.0, 2.25, -0.5] {
        let found = measure(&pair(wave, |c, x, y| wave(c, x + f64::from(d), y), |_, _| d));
        let bent = if d.fract() == 0.0 { 0.0 } else { BENT };
        assert!(found.max_of_all() <= bent + ROUNDING, "{d}: {found:?}");
        assert!(found.own_rmse > 0.1);
        // What would lead beside the picture is left out.
        let columns = WIDTH as u64 - f64::from(d.abs()).ceil() as u64;
        assert_eq!((found.pixels, found.not_finite), (columns * 8, 0), "{d}");
        assert!((found.share - found.pixels as f64 / PIXELS as f64).abs() < 1e-15);
        assert_eq!(found.left_out_max > 0.0, d != 0.0);
    }
    // A disparity of its own at each pixel; a linear error is interpolated exactly.
    let ramp = |c: usize, x: f64, y: usize| 1e-2 * (c as f64 + 1.0) * x - 1e-3 * y as f64;
    let slope = |column: usize, row: usize| 0.37 * row as f32 - 0.11 * column as f32;
    let right = |c: usize, x: f64, y: usize| ramp(c, x + f64::from(slope(x as usize, y)), y);
    let found = measure(&pair(ramp, right, slope));
    assert!(found.max_of_all() <= 1e-6 && found.pixels > 400, "{found:?}");
}

#[test]
fn an_error_of_one_eye_has_its_own_size() {
    let planted = |c: usize, x: f64, y: usize| if (c, x, y) == (1, 30.0, 5) { -0.1 } else { 0.0 };
    // To the left eye's picture, the same place is column 26.
    let left = |c: usize, x: f64, y: usize| planted(c, x + 4.0, y);
    for (which, pair) in
        [pair(|_, _, _| 0.0, planted, |_, _| -4.0), pair(left, |_, _, _| 0.0, |_, _| -4.0)].iter().enumerate()
    {
        let found = measure(pair);
        assert!((found.max_of_all() - 0.1).abs() < 1e-6, "{found:?}");
        assert_eq!((found.max_at, found.max_channel), ([30, 5], 1));
        assert_eq!((found.max[0], found.max[2], found.rmse[0], found.rmse[2]), (0.0, 0.0, 0.0, 0.0));
        let rmse = 0.1 / (60.0 * 8.0_f64).sqrt();
        assert!((found.rmse[1] - rmse).abs() < 1e-7 && (found.rmse_of_all() - rmse / 3.0_f64.sqrt()).abs() < 1e-7);
        let own = if which == 0 { found.rmse_of_all() } else { 0.0 };
        assert!((found.own_rmse - own).abs() < 1e-12);
    }
    // Errors of opposite sign add up: they are signed.
    let found = measure(&pair(|c, x, y| -left(c, x, y), planted, |_, _| -4.0));
    assert!((found.max_of_all() - 0.2).abs() < 1e-6, "{found:?}");
    // Half of it reaches a place half-way between two pixels.
    let found = measure(&pair(left, |_, _, _| 0.0, |_, _| -4.5));
    assert!((found.max_of_all() - 0.05).abs() < 1e-6, "{found:?}");
}

#[test]
fn an_error_at_the_wrong_disparity_is_found() {
    let right = |c: usize, x: f64, y: usize| wave(c, x - 3.0, y);
    assert!(measure(&pair(wave, right, |_, _| -3.0)).max_of_all() < ROUNDING);
    for wrong in [-2.0, -4.0, 3.0, 0.0, -2.5] {
        let found = measure(&pair(wave, right, move |_, _| wrong));
        let away = f64::from(wrong + 3.0).abs();
        // The wave's largest change over so many pixels.
        let expected = 0.4 * (0.5 * away * std::f64::consts::TAU / 40.0).sin();
        assert!((found.max_of_all() - expected).abs() < 0.05 * expected + BENT, "{wrong}: {found:?}");
    }
}

#[test]
fn swapped_eyes_are_found() {
    let right = |c: usize, x: f64, y: usize| wave(c, x - 3.0, y);
    let [left, left_truth, right, mut right_truth] = pair(wave, right, |_, _| -3.0);
    let error = inconsistency([&right, &right_truth], [&left, &left_truth]).expect_err("swapped");
    assert!(error.exit_code() == 2 && error.to_string().contains("swapped"), "{error}");
    // One of the truths is enough, and each is looked at.
    let bare = Picture { disparity: None, ..right_truth.clone() };
    for (b, b2, what) in
        [(&right_truth, &right_truth, "B "), (&bare, &left_truth, "B2"), (&left_truth, &left_truth, "B2")]
    {
        let error = inconsistency([&left, b], [&right, b2]).expect_err("swapped").to_string();
        assert!(error.contains(what), "{error}");
    }
    // Where pictures alone are swapped, or truths have lost their names, the figure says it.
    let swapped = measure(&[right.clone(), left_truth.clone(), left.clone(), right_truth.clone()]);
    assert!(swapped.max_of_all() > 0.1, "{swapped:?}");
    if let Some(disparity) = &mut right_truth.disparity {
        disparity.x.iter_mut().for_each(|d| *d = -*d);
    }
    assert!(measure(&[left, left_truth, right, right_truth]).max_of_all() > 0.1);
}

#[test]
fn without_a_disparity_there_is_none_and_it_says_why() {
    let mut four = pair(wave, wave, |_, _| 0.0);
    let why = |[left, left_truth, right, right_truth]: &Pair| {
        inconsistency([left, left_truth], [right, right_truth]).expect("eyes in order").expect_err("none")
    };
    let Some(disparity) = four[3].disparity.take() else { panic!("it has one") };
    assert!(why(&four).contains("disparityR.x"), "{}", why(&four));
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 64.0, -63.5] {
        four[3].disparity = Some(Disparity { side: disparity.side, x: Plane::filled(value, PIXELS) });
        assert!(why(&four).contains("no pixel"), "{value}: {}", why(&four));
    }
    four[3].disparity = Some(disparity);
    // The left eye's disparity is not needed, but its size is.
    four[1].disparity = None;
    assert!(measure(&four).max_of_all() < ROUNDING);
    let (small, truth) = (Picture::new([63, 8]), Picture::new([63, 8]));
    let why = inconsistency([&small, &truth], [&four[2], &four[3]]).expect("no names").expect_err("sizes");
    assert!(why.contains("63 x 8") && why.contains("64 x 8"), "{why}");
}

#[test]
fn what_is_no_number_never_passes() {
    let still = |_: usize, _: f64, _: usize| 0.0;
    let count = |which: usize, at: usize, value: f32, d: f32| {
        let mut four = pair(still, still, |_, _| d);
        four[which].color[2][at] = value;
        let found = measure(&four);
        assert_eq!(
            (found.max[2], found.rmse[2], found.max[0]),
            (f64::INFINITY, f64::INFINITY, 0.0),
            "{which} {found:?}"
        );
        found.not_finite
    };
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for which in 0..4 {
            assert_eq!(count(which, 20, value, 0.0), 1);
            // Two of the right eye's pixels lie between the left one and its neighbours.
            assert_eq!(count(which, 20, value, -0.5), if which < 2 { 2 } else { 1 });
        }
    }
    // The same infinity in picture and truth is no error; a pixel without disparity is not asked.
    let mut four = pair(still, still, |column, _| if column == 9 { f32::NAN } else { 0.0 });
    four[2].color[0][30] = f32::INFINITY;
    four[3].color[0][30] = f32::INFINITY;
    four[2].color[1][9] = f32::NAN;
    let found = measure(&four);
    assert_eq!((found.max_of_all(), found.not_finite, found.pixels), (0.0, 0, 63 * 8));
    assert_eq!(found.left_out_max, f64::INFINITY);
}
