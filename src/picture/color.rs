//! Colour: the sRGB transfer function, quantisation by rounding, and tables that do both for whole pictures.
//!
//! Linear light with sRGB (BT.709) primaries everywhere; encoded once, when an 8- or 16-bit file is written. The slow
//! functions ([`encode`], [`decode`], [`quantise_u8`], [`quantise_u16`]) are the definitions; the fast ones
//! ([`encode_u8`], [`encode_u16`], [`decode_u8`], [`decode_u16`]) equal them for every f32.

use super::Plane;
use std::sync::LazyLock;

/// Weights of linear red, green and blue in the luminance Y, summing to 1 (ITU-R BT.709-6, item 3.2).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Linear values up to this are encoded by the straight piece (IEC 61966-2-1).
pub const LINEAR_PIECE: f64 = 0.003_130_8;
/// Encoded values up to this are decoded by the straight piece (IEC 61966-2-1).
const ENCODED_PIECE: f64 = 0.040_45;

/// sRGB encoding of a linear value (IEC 61966-2-1); [0, 1] maps to [0, 1].
///
/// Outside [0, 1] it goes on as an odd function, `encode(-x) = -encode(x)`, so that colours out of gamut survive a
/// round trip. NaN gives NaN.
pub fn encode(linear: f64) -> f64 {
    let x = linear.abs();
    let y = if x <= LINEAR_PIECE { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    y.copysign(linear)
}

/// Linear value of an sRGB-encoded one (IEC 61966-2-1); [0, 1] maps to [0, 1], odd like [`encode`]. NaN gives NaN.
pub fn decode(encoded: f64) -> f64 {
    let y = encoded.abs();
    let x = if y <= ENCODED_PIECE { y / 12.92 } else { ((y + 0.055) / 1.055).powf(2.4) };
    x.copysign(encoded)
}

/// Nearest of 256 levels of a value in [0, 1]; what lies outside is clamped, NaN is 0.
pub fn quantise_u8(value: f64) -> u8 {
    // `as` saturates and takes NaN to 0; `round` comes first, so nothing is truncated.
    (value * 255.0).round() as u8
}

/// Nearest of 65536 levels of a value in [0, 1]; what lies outside is clamped, NaN is 0.
pub fn quantise_u16(value: f64) -> u16 {
    (value * 65535.0).round() as u16
}

/// `quantise_u8(encode(linear))` for every f32, by table.
pub fn encode_u8(linear: f32) -> u8 {
    QUANTISER_U8.code(linear)
}

/// `quantise_u16(encode(linear))` for every f32, by table.
pub fn encode_u16(linear: f32) -> u16 {
    QUANTISER_U16.code(linear)
}

/// The linear value of an 8-bit sRGB code: `decode(code / 255)` rounded to f32. [`encode_u8`] gives the code back.
pub fn decode_u8(code: u8) -> f32 {
    DECODED_U8[usize::from(code)]
}

/// The linear value of a 16-bit sRGB code: `decode(code / 65535)` rounded to f32. [`encode_u16`] gives the code back.
pub fn decode_u16(code: u16) -> f32 {
    DECODED_U16[usize::from(code)]
}

/// Three linear planes of equal length as interleaved 8-bit sRGB samples, red first.
pub fn interleave_u8(planes: &[Plane<f32>; 3]) -> Vec<u8> {
    let quantiser: &QuantiserU8 = &QUANTISER_U8;
    let mut out = Vec::with_capacity(3 * planes[0].len());
    for ((&r, &g), &b) in planes[0].iter().zip(&planes[1]).zip(&planes[2]) {
        out.extend_from_slice(&[quantiser.code(r), quantiser.code(g), quantiser.code(b)]);
    }
    out
}

/// Three linear planes of equal length as interleaved 16-bit sRGB samples, red first.
pub fn interleave_u16(planes: &[Plane<f32>; 3]) -> Vec<u16> {
    let quantiser: &QuantiserU16 = &QUANTISER_U16;
    let mut out = Vec::with_capacity(3 * planes[0].len());
    for ((&r, &g), &b) in planes[0].iter().zip(&planes[1]).zip(&planes[2]) {
        out.extend_from_slice(&[quantiser.code(r), quantiser.code(g), quantiser.code(b)]);
    }
    out
}

static QUANTISER_U8: LazyLock<QuantiserU8> = LazyLock::new(QuantiserU8::new);
// 65535 powers: some milliseconds, spent only by those who write 16-bit files.
static QUANTISER_U16: LazyLock<QuantiserU16> = LazyLock::new(QuantiserU16::new);

static DECODED_U8: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..=255).map(|code| decode(f64::from(code) / 255.0) as f32).collect());
static DECODED_U16: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..=65535).map(|code| decode(f64::from(code) / 65535.0) as f32).collect());

// Both quantisers encode and round without a power per sample. The code of x is the number of thresholds
// `decode((k - 1/2) / levels)` that x reaches, which is exact rounding. Intervals of x, short enough for a good guess,
// lead to the threshold that decides.

/// An interval is what the upper 16 bits of a float tell apart: 128 per octave.
const INTERVAL_BITS: u32 = 16;
const INTERVAL: u32 = 1 << INTERVAL_BITS;

/// The smallest f32 with a code of at least k, for k from 1 to `levels`.
fn thresholds(levels: u16) -> Vec<f32> {
    let smallest = |k: u16| {
        let exact = decode((f64::from(k) - 0.5) / f64::from(levels));
        let near = exact as f32;
        if f64::from(near) < exact { near.next_up() } else { near }
    };
    (1..=levels).map(smallest).collect()
}

/// Bits of the float that starts the interval around `x`.
fn interval_start(x: f32) -> u32 {
    x.to_bits() & !(INTERVAL - 1)
}

/// Whether `x` is at least `bound`; false for NaN.
#[inline]
fn reaches(x: f32, bound: f32) -> bool {
    x >= bound
}

/// 8 bit: an interval is at most 0.88 codes wide, so no more than one threshold lies inside.
struct QuantiserU8 {
    /// The code at the start of each interval and the threshold of the next one.
    intervals: Vec<(f32, u8)>,
    /// The first threshold: below it all is 0.
    first: f32,
    /// Bits of the float that the first interval starts at.
    start: u32,
}

impl QuantiserU8 {
    fn new() -> Self {
        let thresholds = thresholds(255);
        let start = interval_start(thresholds[0]);
        let intervals = (start..1.0_f32.to_bits())
            .step_by(INTERVAL as usize)
            .map(|bits| {
                let code = thresholds.partition_point(|&t| t <= f32::from_bits(bits));
                // At most 255 thresholds can be reached.
                (thresholds.get(code).copied().unwrap_or(f32::INFINITY), code as u8)
            })
            .collect();
        Self { intervals, first: thresholds[0], start }
    }

    #[inline]
    fn code(&self, x: f32) -> u8 {
        if x >= 1.0 {
            return u8::MAX;
        }
        if !reaches(x, self.first) {
            return 0;
        }
        let (next, code) = self.intervals[((x.to_bits() - self.start) >> INTERVAL_BITS) as usize];
        code + u8::from(x >= next)
    }
}

/// 16 bit: linear interpolation within the interval is off by at most 1.9e-6 of full scale, an eighth of a step, so the
/// guess is right or one off.
struct QuantiserU16 {
    /// `thresholds[k]` is that of code k; minus infinity for 0, plus infinity behind the last.
    thresholds: Vec<f32>,
    /// The real-valued code, plus a half for rounding, at the start of each interval, and its growth per unit of the
    /// float's lower bits.
    intervals: Vec<[f32; 2]>,
    /// Bits of the float that the first interval starts at.
    start: u32,
}

impl QuantiserU16 {
    fn new() -> Self {
        let inner = thresholds(u16::MAX);
        let start = interval_start(inner[0]);
        let mut thresholds = vec![f32::NEG_INFINITY];
        thresholds.extend(inner);
        thresholds.push(f32::INFINITY);
        let code_at = |bits: u32| encode(f64::from(f32::from_bits(bits))) * f64::from(u16::MAX) + 0.5;
        let intervals = (start..1.0_f32.to_bits())
            .step_by(INTERVAL as usize)
            .map(|bits| {
                let (first, next) = (code_at(bits), code_at(bits + INTERVAL));
                [first as f32, ((next - first) / f64::from(INTERVAL)) as f32]
            })
            .collect();
        Self { thresholds, intervals, start }
    }

    #[inline]
    fn code(&self, x: f32) -> u16 {
        if x >= 1.0 {
            return u16::MAX;
        }
        if !reaches(x, self.thresholds[1]) {
            return 0;
        }
        let offset = x.to_bits() - self.start;
        let [first, slope] = self.intervals[(offset >> INTERVAL_BITS) as usize];
        let mut code = (first + slope * (offset & (INTERVAL - 1)) as f32) as usize;
        // The ends of the thresholds are infinite: neither loop leaves them.
        while x < self.thresholds[code] {
            code -= 1;
        }
        while x >= self.thresholds[code + 1] {
            code += 1;
        }
        code as u16
    }
}
