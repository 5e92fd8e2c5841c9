//! Anaglyphs by Dubois' projection: each output channel is a weighted sum of the six channels of the two views.
//!
//! E. Dubois, "A projection method to generate anaglyph stereo images", ICASSP 2001, derives the weights by least
//! squares in linear light, so linear light is the default here. Many programs apply them to sRGB-encoded values;
//! [`Space::Encoded`] does what they do. Each row of weights sums to 1 within its printed precision, so that equal greys
//! in both views stay as they are.

use crate::error::{Error, Result};
use crate::picture::{Picture, color};

/// One set of weights: output channel i is `sum_j left[i][j] L_j + right[i][j] R_j`, channels in the order R, G, B.
#[derive(Debug)]
pub struct Matrix {
    /// Name on the command line.
    pub name: &'static str,
    /// One line of help, with the source.
    pub help: &'static str,
    /// Weights of the left view.
    pub left: [[f64; 3]; 3],
    /// Weights of the right view.
    pub right: [[f64; 3]; 3],
    /// Weights times 65536, left then right, where the source computes in integers: with [`Space::Encoded`] the sum over
    /// 8-bit values is cut, not rounded, as there.
    pub integers: Option<[[i32; 6]; 3]>,
}

/// The matrices that `--matrix` offers; the first is the default. All are for red-cyan glasses, red at the left eye.
pub const MATRICES: &[Matrix] = &[
    Matrix {
        name: "dubois-2001",
        help: "Dubois, ICASSP 2001, full precision",
        left: [
            [0.456_1, 0.500_484, 0.176_381],
            [-0.040_082_2, -0.037_824_6, -0.015_758_9],
            [-0.015_216_1, -0.020_597_1, -0.005_468_56],
        ],
        right: [
            [-0.043_470_6, -0.087_938_8, -0.001_555_29],
            [0.378_476, 0.733_64, -0.018_450_3],
            [-0.072_152_7, -0.112_961, 1.226_4],
        ],
        integers: None,
    },
    Matrix {
        name: "dubois-2009",
        help: "Dubois' note on making anaglyphs in Photoshop, 2009, three decimals",
        left: [[0.437, 0.449, 0.164], [-0.062, -0.062, -0.024], [-0.048, -0.050, -0.017]],
        right: [[-0.011, -0.032, -0.007], [0.377, 0.761, 0.009], [-0.026, -0.093, 1.234]],
        integers: None,
    },
    Matrix {
        name: "ffmpeg",
        help: "ffmpeg's stereo3d=arcd: 2001 to three decimals, in 1/65536; with --space encoded its 8-bit bytes, truncated",
        left: over_65536(FFMPEG, 0),
        right: over_65536(FFMPEG, 3),
        integers: Some(FFMPEG),
    },
];

/// Weights of ffmpeg's filter `stereo3d`, output `arcd`, times 65536 (libavfilter/vf_stereo3d.c).
const FFMPEG: [[i32; 6]; 3] = [
    [29884, 32768, 11534, -2818, -5767, -131],
    [-2621, -2490, -1049, 24773, 48103, -1180],
    [-983, -1376, -328, -4719, -7406, 80347],
];

const fn over_65536(integers: [[i32; 6]; 3], first: usize) -> [[f64; 3]; 3] {
    let mut out = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        out[i / 3][i % 3] = integers[i / 3][first + i % 3] as f64 / 65536.0;
        i += 1;
    }
    out
}

/// The matrix of that name. [`Error::Usage`] lists the names there are.
pub fn matrix(name: &str) -> Result<&'static Matrix> {
    MATRICES.iter().find(|m| m.name == name).ok_or_else(|| {
        let names: Vec<_> = MATRICES.iter().map(|m| m.name).collect();
        Error::Usage(format!("there is no matrix `{name}`; there are {}", names.join(", ")))
    })
}

/// What the weights are applied to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Space {
    /// Linear light, as the weights were derived.
    #[default]
    Linear,
    /// sRGB-encoded values, as most programs do.
    Encoded,
}

impl Space {
    /// Every space, the default first.
    pub const ALL: &[Self] = &[Self::Linear, Self::Encoded];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Encoded => "encoded",
        }
    }

    /// One line of help.
    pub fn help(self) -> &'static str {
        match self {
            Self::Linear => "mix in linear light, as the weights were derived",
            Self::Encoded => "mix sRGB-encoded values, as most programs do",
        }
    }

    /// The space of that name. [`Error::Usage`] lists the names there are.
    pub fn named(name: &str) -> Result<Self> {
        Self::ALL.iter().copied().find(|space| space.name() == name).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|space| space.name()).collect();
            Error::Usage(format!("there is no space `{name}`; there are {}", names.join(", ")))
        })
    }
}

/// Samples from here to here count as in gamut: a 16-bit file rounds them to 0 or 1 at the latest (half a step, in linear
/// light). The rows' printed precision alone puts white 4.5e-6 above 1.
pub const GAMUT: std::ops::RangeInclusive<f64> = -0.5 / 65535.0 / 12.92..=1.0 + 0.5 / 65535.0 * (2.4 / 1.055);

/// The anaglyph of two pictures of equal size, in linear light without alpha, and how many of its `3 * pixels` samples
/// lie outside [`GAMUT`].
///
/// Samples out of gamut keep their values: they are clipped when a file of integers is written. The one exception is a
/// matrix of integers with [`Space::Encoded`], which repeats its source to the byte: the views are rounded to 8-bit sRGB,
/// `sum >> 16` is clipped to 0..255, and the picture holds the decoded bytes.
pub fn anaglyph(left: &Picture, right: &Picture, matrix: &Matrix, space: Space) -> (Picture, u64) {
    let mut out = Picture::new(left.size);
    let clipped = match (space, &matrix.integers) {
        (Space::Encoded, Some(weights)) => mix_integers(left, right, weights, &mut out),
        (Space::Encoded, None) => mix(left, right, matrix, color::encode, color::decode, &mut out),
        (Space::Linear, _) => mix(left, right, matrix, |x| x, |x| x, &mut out),
    };
    (out, clipped)
}

/// The colours as slices, which pixels are taken from without a question each.
fn planes(picture: &Picture) -> [&[f32]; 3] {
    picture.color.each_ref().map(|plane| &plane[..])
}

/// Mixes what `to` makes of the samples; `from` takes the sums back to linear light.
fn mix(
    left: &Picture,
    right: &Picture,
    matrix: &Matrix,
    to: impl Fn(f64) -> f64,
    from: impl Fn(f64) -> f64,
    out: &mut Picture,
) -> u64 {
    let mut clipped = 0;
    let pixels = out.pixels();
    let (left, right) = (planes(left), planes(right));
    let mut out = out.color.each_mut().map(|plane| &mut plane[..]);
    for i in 0..pixels {
        let l = left.map(|plane| to(f64::from(plane[i])));
        let r = right.map(|plane| to(f64::from(plane[i])));
        for (plane, (a, b)) in out.iter_mut().zip(matrix.left.iter().zip(&matrix.right)) {
            let sum = a[0] * l[0] + a[1] * l[1] + a[2] * l[2] + b[0] * r[0] + b[1] * r[1] + b[2] * r[2];
            let value = from(sum);
            // NaN is outside too.
            clipped += u64::from(!GAMUT.contains(&value));
            plane[i] = value as f32;
        }
    }
    clipped
}

fn mix_integers(left: &Picture, right: &Picture, weights: &[[i32; 6]; 3], out: &mut Picture) -> u64 {
    let mut clipped = 0;
    let pixels = out.pixels();
    let (left, right) = (planes(left), planes(right));
    let mut out = out.color.each_mut().map(|plane| &mut plane[..]);
    for i in 0..pixels {
        let l = left.map(|plane| i32::from(color::encode_u8(plane[i])));
        let r = right.map(|plane| i32::from(color::encode_u8(plane[i])));
        for (plane, w) in out.iter_mut().zip(weights) {
            // At most 255 * 133,000: far inside 32 bits. The shift rounds down, as in the source.
            let sum = w[0] * l[0] + w[1] * l[1] + w[2] * l[2] + w[3] * r[0] + w[4] * r[1] + w[5] * r[2];
            let value = sum >> 16;
            clipped += u64::from(!(0..=255).contains(&value));
            plane[i] = color::decode_u8(value.clamp(0, 255) as u8);
        }
    }
    clipped
}
