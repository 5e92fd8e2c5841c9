//! What displays and video encoders take: 8-bit sRGB.

use super::{Film, Plane, color};

/// One view's result as 8-bit sRGB codes, red, green, blue and an opaque alpha of 255, row-major with row 0 on top.
///
/// A quarter of a [`Film`]'s memory. What lies outside [0, 1] is clamped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgba8 {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// `width * height` pixels.
    pub pixels: Plane<[u8; 4]>,
}

impl Rgba8 {
    /// A black frame.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, pixels: Plane::filled([0, 0, 0, u8::MAX], size[0] as usize * size[1] as usize) }
    }

    /// The colour of a film by [`color::encode_u8`]: what frames of 8 bits are, but for values within 1/40 of a code's step
    /// from where it rounds, which may go either way, and for what `auto`'s splines overshoot within its tolerance, which films
    /// clamp to the range of the scene's colours.
    pub fn of(film: &Film) -> Self {
        let [red, green, blue] = &film.color;
        let rows = red.iter().zip(green).zip(blue);
        Self { size: film.size, pixels: rows.map(|((&r, &g), &b)| Self::pixel([r, g, b])).collect() }
    }

    /// The pixel of a linear colour.
    pub fn pixel([red, green, blue]: [f32; 3]) -> [u8; 4] {
        [color::encode_u8(red), color::encode_u8(green), color::encode_u8(blue), u8::MAX]
    }
}
