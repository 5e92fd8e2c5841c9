//! From linear light to 8-bit sRGB codes ([`crate::picture::color::encode`]), in vectors.

use super::simd::{Level, Simd, WithSimd, dispatch};
use crate::picture::color::LINEAR_PIECE;
use crate::picture::{Film, Rgba8};
use rayon::prelude::*;

/// Coefficients of 255 (1.055 q^(5/3) - 0.055) for q, the fourth root of a linear value, from that of [`LINEAR_PIECE`] to 1:
/// minimax, 3.6e-4.
const POWER_PIECE: [f32; 7] = [-15.184_374, 35.598_927, 348.310_42, -217.505_36, 167.584_44, -81.196_945, 17.393_244];

/// The fourth root of [`LINEAR_PIECE`].
const LEAST_ROOT: f32 = 0.236_546_02;

/// Pixels that a task encodes.
const PIECE: usize = 1 << 14;

/// 255 times the sRGB encoding of linear values, clamped to [0, 1]; NaN gives 0. Off by at most 5e-4.
#[inline(always)]
pub fn code<S: Simd>(s: S, linear: S::F) -> S::F {
    let (zero, slope) = (s.splat(0.0), 255.0 * 12.92);
    let v = s.min(s.max(linear, zero), s.splat(1.0));
    let q = s.max(s.sqrt_near(s.sqrt_near(v)), s.splat(LEAST_ROOT));
    let mut power = s.splat(POWER_PIECE[6]);
    for i in (0..6).rev() {
        power = s.mul_add(power, q, s.splat(POWER_PIECE[i]));
    }
    // On the straight piece the power stays what it is at its end.
    let straight = s.mul_add(v, s.splat(slope as f32), s.splat((-slope * LINEAR_PIECE) as f32));
    s.add(power, s.min(straight, zero))
}

/// Encodes the colour of a film, on many threads.
pub fn film(film: &Film, out: &mut Rgba8, level: Level) {
    let [red, green, blue] = film.color.each_ref().map(|plane| plane.par_chunks(PIECE));
    let pieces = out.pixels.par_chunks_mut(PIECE).zip(red).zip(green).zip(blue);
    pieces.for_each(|(((out, red), green), blue)| dispatch(level, Row { planes: [red, green, blue], out }));
}

struct Row<'a> {
    planes: [&'a [f32]; 3],
    out: &'a mut [[u8; 4]],
}

impl WithSimd for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        row(s, self.planes, self.out);
    }
}

/// Encodes as many values of three planes as there are pixels.
#[inline(always)]
pub fn row<S: Simd>(s: S, [red, green, blue]: [&[f32]; 3], out: &mut [[u8; 4]]) {
    let whole = out.len() - out.len() % S::LANES;
    for i in (0..whole).step_by(S::LANES) {
        let rgb = [code(s, s.load(&red[i..])), code(s, s.load(&green[i..])), code(s, s.load(&blue[i..]))];
        s.store_rgba8(rgb, &mut out[i..]);
    }
    for i in whole..out.len() {
        out[i] = Rgba8::pixel([red[i], green[i], blue[i]]);
    }
}

/// Greatest over least linear value up to which a polynomial of the fourth degree follows the power piece: by 0.011.
const FOLLOWED: f32 = 2.5;

/// What of a code's step may be lost by rounding places.
const ROUNDING: f32 = 0.005;

/// What of a code's step may be lost by a lower degree.
const LOSS: f32 = 0.01;

/// The codes of the values of an interval, as a polynomial in whole numbers of 16 bits: what [`code`] gives, within 1/40 but for
/// how values are rounded, for a fraction of the work.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tone {
    /// From the argument to a place in [-[`PLACES`], [`PLACES`]].
    pub scale: f32,
    /// The place of the argument 0.
    pub offset: f32,
    /// From degree 0 on, in [`STEPS`]: a product with a place, which is at most half of what 16 bits hold, is halved. The first has half a
    /// code for rounding added and counts modulo 2^16.
    coefficients: [i16; 5],
}

/// The place of the upper end of an interval.
pub const PLACES: f32 = 16_384.0;

/// How to encode three channels.
#[derive(Clone, Copy, Debug)]
pub struct Tones {
    /// Red, green and blue.
    pub channels: [Tone; 3],
    /// The degree of the polynomials: 2, 3 or 4.
    pub degree: usize,
}

impl Tones {
    /// The codes of the linear values `start + slope * x` of three channels, each for the x of an interval; `None` where no
    /// polynomial of the fourth degree is near enough, or the x is too close to its neighbours in single precision, as where colours
    /// are bright and there is next to no gas.
    #[inline(always)]
    pub fn new<S: Simd>(s: S, intervals: [[f32; 2]; 3], lines: [[f32; 2]; 3]) -> Option<Self> {
        let mut values = [0.0; 16];
        let mut channels = [Tone::default(); 3];
        let mut rounding = [0.0; 3];
        for (channel, (tone, ([low, high], [start, slope]))) in
            channels.iter_mut().zip(intervals.into_iter().zip(lines)).enumerate()
        {
            let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(1e-6));
            // Of the interval as it is taken: a bright colour changes much with little.
            let (a, b) = (start + slope * (middle - half), start + slope * (middle + half));
            let (least, most) = (a.min(b).min(start + slope * low), a.max(b).max(start + slope * high));
            // Not so for what is no number either.
            if !(least >= LINEAR_PIECE as f32 && most <= 1.0 && most <= FOLLOWED * least) {
                return None;
            }
            (tone.scale, tone.offset) = (PLACES / half, -middle / half * PLACES);
            rounding[channel] = middle.abs() / half * f32::EPSILON;
            for (value, at) in values[5 * channel..].iter_mut().zip(ZEROS) {
                *value = start + slope * (middle + half * at);
            }
        }
        let mut codes = [0.0; 16];
        for (codes, values) in codes.chunks_exact_mut(S::LANES).zip(values.chunks_exact(S::LANES)) {
            s.store(code(s, s.load(values)), codes);
        }
        for (codes, rounding) in codes.chunks_exact(5).zip(rounding) {
            // What a place is rounded by, in codes.
            if (codes[0] - codes[4]).abs() * rounding > ROUNDING {
                return None;
            }
        }
        let mut series = [[0.0f32; 8]; 3];
        for (series, codes) in series.iter_mut().zip(codes.chunks_exact(5)) {
            for (&code, factors) in codes.iter().zip(&SERIES) {
                for (c, factor) in series.iter_mut().zip(factors) {
                    *c += factor * code;
                }
            }
        }
        // What a series of Chebyshev's polynomials is cut by is no more than the sizes of its last terms.
        let mut degree = 4;
        let mut lost = 0.0;
        while degree > 2 {
            lost += series.iter().fold(0.0f32, |most, c| most.max(c[degree].abs()));
            if lost > LOSS {
                break;
            }
            series.iter_mut().for_each(|c| c[degree] = 0.0);
            degree -= 1;
        }
        for (tone, c) in channels.iter_mut().zip(series) {
            // In powers. No sum but the first exceeds what 16 bits hold: values of which the greatest is `FOLLOWED` times the least
            // span a third of the codes at the most.
            let powers = [c[0] - c[2] + c[4] + 0.5, c[1] - 3.0 * c[3], 2.0 * c[2] - 8.0 * c[4], 4.0 * c[3], 8.0 * c[4]];
            for ((coefficient, power), step) in tone.coefficients.iter_mut().zip(powers).zip(STEPS) {
                *coefficient = (power * step).round() as i32 as i16;
            }
        }
        Some(Self { channels, degree })
    }
}

impl Tone {
    /// The codes at places, as [`Simd::store_words`] takes them, with as many coefficients as the degree asks for.
    #[inline(always)]
    pub fn at<S: Simd, const DEGREE: usize>(&self, s: S, place: S::W) -> S::W {
        let mut sum = s.splat_word(self.coefficients[DEGREE]);
        for i in (0..DEGREE).rev() {
            sum = s.add_words(s.mul_words(sum, place), s.splat_word(self.coefficients[i]));
        }
        sum
    }
}

/// How many steps of [`Tone`]'s coefficients make a code.
const STEPS: [f32; 5] = [256.0, 512.0, 1024.0, 2048.0, 4096.0];

/// The zeros of Chebyshev's fifth polynomial, cos((2 k + 1) pi / 10).
const ZEROS: [f32; 5] = [0.951_056_5, 0.587_785_25, 0.0, -0.587_785_25, -0.951_056_5];

/// What the value at each of [`ZEROS`] gives to the terms of a series of Chebyshev's polynomials 0 to 4: 2/5 of the polynomial there, of
/// the first 1/5; with zeros to fill a vector.
const SERIES: [[f32; 8]; 5] = [
    [0.2, 0.380_422_6, 0.323_606_8, 0.235_114_1, 0.123_606_8, 0.0, 0.0, 0.0],
    [0.2, 0.235_114_1, -0.123_606_8, -0.380_422_6, -0.323_606_8, 0.0, 0.0, 0.0],
    [0.2, 0.0, -0.4, 0.0, 0.4, 0.0, 0.0, 0.0],
    [0.2, -0.235_114_1, -0.123_606_8, 0.380_422_6, -0.323_606_8, 0.0, 0.0, 0.0],
    [0.2, -0.380_422_6, 0.323_606_8, -0.235_114_1, 0.123_606_8, 0.0, 0.0, 0.0],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::color;

    /// Every seventh f32 of [-0.1, 1.2] and around, and what is no number.
    fn values() -> Vec<f32> {
        let mut values: Vec<f32> = (0..1.2f32.to_bits()).step_by(40_000).map(f32::from_bits).collect();
        values.extend((0..20_000).map(|i| i as f32 * 6e-5));
        values.extend([-0.1, -1e-9, 1.0, 1.2, 1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 0.003_130_8]);
        values
    }

    struct Codes<'a>(&'a [f32]);

    impl WithSimd for Codes<'_> {
        type Output = Vec<f32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Vec<f32> {
            let mut lanes = [0.0; 16];
            let mut out = Vec::new();
            for &value in self.0 {
                s.store(code(s, s.splat(value)), &mut lanes);
                out.push(lanes[0]);
            }
            out
        }
    }

    #[test]
    fn codes_are_those_of_the_definition() {
        let values = values();
        for level in Level::available() {
            for (&value, code) in values.iter().zip(dispatch(level, Codes(&values))) {
                let value = if value.is_nan() { 0.0 } else { f64::from(value).clamp(0.0, 1.0) };
                let want = 255.0 * color::encode(value);
                assert!((f64::from(code) - want).abs() < 5e-4, "{level}: {value} gives {code}, not {want}");
            }
        }
    }

    /// Intervals and lines.
    type Case = ([[f32; 2]; 3], [[f32; 2]; 3]);

    struct Follow(Vec<Case>);

    impl WithSimd for Follow {
        type Output = ([usize; 3], f64);

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> ([usize; 3], f64) {
            let (mut followed, mut worst) = ([0; 3], 0.0f64);
            for (intervals, lines) in self.0 {
                let Some(tones) = Tones::new(s, intervals, lines) else { continue };
                followed[tones.degree - 2] += 1;
                for (tone, ([low, high], [start, slope])) in tones.channels.iter().zip(intervals.into_iter().zip(lines))
                {
                    for i in 0..=64 {
                        let x = low + (high - low) * i as f32 / 64.0;
                        let place = s.splat(x * tone.scale + tone.offset);
                        let place = s.words(place, place);
                        let code = match tones.degree {
                            2 => tone.at::<S, 2>(s, place),
                            3 => tone.at::<S, 3>(s, place),
                            _ => tone.at::<S, 4>(s, place),
                        };
                        // The upper byte, and the lower one taken to its place; half a code is there for rounding.
                        let lower = (0..8).fold(code, |code, _| s.add_words(code, code));
                        let mut pixels = [[0; 4]; 32];
                        s.store_words([code, lower, code], &mut pixels);
                        let got = f64::from(u16::from_be_bytes([pixels[0][0], pixels[0][1]])) / 256.0 - 0.5;
                        let want = 255.0 * color::encode(f64::from(start) + f64::from(slope) * f64::from(x));
                        worst = worst.max((got - want).abs());
                    }
                }
            }
            (followed, worst)
        }
    }

    #[test]
    fn polynomials_follow_the_codes_where_they_say_so() {
        let mut cases = Vec::new();
        for i in 0..200 {
            let at = |k: i32| ((i * 7 + k * 13) % 101) as f32 / 100.0;
            // A transmittance with light in front of a background, and values themselves.
            let through = [0.5 * at(1), 0.5 * at(1) + 0.5 * at(2) * at(8)];
            let lines = [0, 1, 2].map(|c| [at(3 + c), at(6 + c) - at(3 + c)]);
            cases.push(([through; 3], lines));
            let own = [0, 1, 2].map(|c| [0.3 * at(c) + 0.004, (0.3 * at(c) + 0.004) * (1.0 + 1.6 * at(c + 3))]);
            cases.push((own, [[0.0, 1.0]; 3]));
        }
        // Hardly any width, but bright colours.
        cases.push(([[0.999_999_9, 1.0]; 3], [[1e6, 0.3 - 1e6], [1e5, 0.02 - 1e5], [2e4, 0.01 - 2e4]]));
        // The same where codes depend on the last bits, in part followed.
        cases.push(([[0.999_997_26, 0.999_999_46]; 3], [[263_229.2, 0.281_25 - 263_229.2]; 3]));
        cases.push(([[0.999_990_9, 0.999_997_4]; 3], [[57_461.91, 0.476_6 - 57_461.91]; 3]));
        for bright in [3.0, 10.0, 30.0, 100.0, 1e3, 1e4, 1e5, 1e6] {
            for i in 0..40 {
                let wide = 0.4 * ((i + 1) as f32 / 40.0) / bright;
                cases.push(([[1.0 - wide, 1.0 - 0.1 * wide]; 3], [[bright, 0.3 - bright]; 3]));
            }
        }
        // As much as is followed, of bright values.
        cases.push(([[0.367_314_85, 0.917_051_26]; 3], [[0.0, 1.0]; 3]));
        // No width at all, what is black, and what is beyond white.
        cases.push(([[0.25; 2]; 3], [[0.1, 0.2]; 3]));
        cases.push(([[0.0, 0.002]; 3], [[0.0, 1.0]; 3]));
        cases.push(([[0.9, 1.1]; 3], [[0.0, 1.0]; 3]));
        for level in Level::available() {
            let (followed, worst) = dispatch(level, Follow(cases.clone()));
            let left = cases.len() - followed.iter().sum::<usize>();
            assert!(followed.iter().all(|&count| count > 20) && left > 20, "{followed:?} and {left}");
            assert!(worst < 1.0 / 40.0, "{level}: off by {worst}");
        }
    }

    #[test]
    fn rows_of_any_length_are_encoded() {
        for count in [0, 1, 15, 16, 17, 40] {
            let plane = |k: usize| (0..count).map(|i| ((i * 37 + k * 11) % 50) as f32 / 45.0).collect::<Vec<_>>();
            let planes = [plane(0), plane(1), plane(2)];
            let want: Vec<_> = (0..count).map(|i| Rgba8::pixel([planes[0][i], planes[1][i], planes[2][i]])).collect();
            for level in Level::available() {
                let mut out = vec![[0; 4]; count];
                dispatch(level, Row { planes: planes.each_ref().map(|plane| &plane[..]), out: &mut out });
                assert_eq!(out, want, "{level}, {count} pixels");
            }
        }
    }
}
