//! Colour: the sRGB transfer function, quantisation by rounding, and tables that do both for whole pictures.
//!
//! Linear light with sRGB (BT.709) primaries everywhere; encoded once, when an 8- or 16-bit file is written. The slow
//! functions ([`encode`], [`decode`], [`quantise_u8`], [`quantise_u16`]) are the definitions; the fast ones
//! ([`encode_u8`], [`encode_u16`], [`decode_u8`], [`decode_u16`]) equal them for every f32.

use std::sync::LazyLock;

/// Weights of linear red, green and blue in the luminance Y, summing to 1 (ITU-R BT.709-6, item 3.2).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Linear values up to this are encoded by the straight piece (IEC 61966-2-1).
const LINEAR_PIECE: f64 = 0.003_130_8;
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
    // The quantiser's codes run to 255.
    QUANTISER_U8.code(linear) as u8
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
pub fn interleave_u8(planes: &[Vec<f32>; 3]) -> Vec<u8> {
    let quantiser: &Quantiser = &QUANTISER_U8;
    let mut out = Vec::with_capacity(3 * planes[0].len());
    for ((&r, &g), &b) in planes[0].iter().zip(&planes[1]).zip(&planes[2]) {
        out.extend_from_slice(&[quantiser.code(r) as u8, quantiser.code(g) as u8, quantiser.code(b) as u8]);
    }
    out
}

/// Three linear planes of equal length as interleaved 16-bit sRGB samples, red first.
pub fn interleave_u16(planes: &[Vec<f32>; 3]) -> Vec<u16> {
    let quantiser: &Quantiser = &QUANTISER_U16;
    let mut out = Vec::with_capacity(3 * planes[0].len());
    for ((&r, &g), &b) in planes[0].iter().zip(&planes[1]).zip(&planes[2]) {
        out.extend_from_slice(&[quantiser.code(r), quantiser.code(g), quantiser.code(b)]);
    }
    out
}

static QUANTISER_U8: LazyLock<Quantiser> = LazyLock::new(|| Quantiser::new(255));
// 65535 powers: some milliseconds, spent only by those who write 16-bit files.
static QUANTISER_U16: LazyLock<Quantiser> = LazyLock::new(|| Quantiser::new(65535));

static DECODED_U8: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..=255).map(|code| decode(f64::from(code) / 255.0) as f32).collect());
static DECODED_U16: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..=65535).map(|code| decode(f64::from(code) / 65535.0) as f32).collect());

/// Encodes and rounds without a power per sample.
///
/// The code of x is the number of thresholds `decode((k - 1/2) / levels)` that x reaches, which is exact rounding. A
/// guess by linear interpolation in short intervals of x is right or one off; the thresholds decide.
struct Quantiser {
    /// `thresholds[k]`: the smallest f32 with a code of at least k; minus infinity for 0, plus infinity behind the last.
    thresholds: Vec<f32>,
    /// The real-valued code (plus a half, for rounding) at the start of each interval, and its growth over the interval.
    intervals: Vec<[f32; 2]>,
    /// Bits of the float that the first interval starts at.
    start: u32,
    levels: u16,
}

/// An interval is what the upper 16 bits of a float tell apart: 128 per octave. The interpolation is then off by at
/// most 1.9e-6 of full scale, an eighth of a 16-bit step.
const INTERVAL_BITS: u32 = 16;

impl Quantiser {
    fn new(levels: u16) -> Self {
        let scale = f64::from(levels);
        let mut thresholds = Vec::with_capacity(usize::from(levels) + 2);
        thresholds.push(f32::NEG_INFINITY);
        for k in 1..=levels {
            let exact = decode((f64::from(k) - 0.5) / scale);
            let near = exact as f32;
            thresholds.push(if f64::from(near) < exact { near.next_up() } else { near });
        }
        thresholds.push(f32::INFINITY);
        let start = thresholds[1].to_bits() >> INTERVAL_BITS << INTERVAL_BITS;
        let end = 1.0_f32.to_bits();
        let code_at = |bits: u32| encode(f64::from(f32::from_bits(bits))) * scale + 0.5;
        let intervals = (start..end)
            .step_by(1 << INTERVAL_BITS)
            .map(|bits| {
                let (first, next) = (code_at(bits), code_at(bits + (1 << INTERVAL_BITS)));
                [first as f32, ((next - first) / f64::from(1_u32 << INTERVAL_BITS)) as f32]
            })
            .collect();
        Self { thresholds, intervals, start, levels }
    }

    #[inline]
    fn code(&self, x: f32) -> u16 {
        if x >= 1.0 {
            return self.levels;
        }
        // Below the first threshold, negative, or NaN, which compares false.
        if !matches!(x.partial_cmp(&self.thresholds[1]), Some(std::cmp::Ordering::Greater | std::cmp::Ordering::Equal))
        {
            return 0;
        }
        let offset = x.to_bits() - self.start;
        let [first, slope] = self.intervals[(offset >> INTERVAL_BITS) as usize];
        let within = offset & ((1 << INTERVAL_BITS) - 1);
        let mut code = (first + slope * within as f32) as usize;
        while x < self.thresholds[code] {
            code -= 1;
        }
        while x >= self.thresholds[code + 1] {
            code += 1;
        }
        code as u16
    }
}
