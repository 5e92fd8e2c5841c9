//! JPEG: sRGB-encoded RGB, colour not subsampled (4:4:4), which red-cyan anaglyphs depend on.

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::picture::{Picture, color};

/// Of 100: differences to the eye vanish, files stay a fifth of PNG's.
const QUALITY: u8 = 95;
/// The format holds no wider or higher picture.
pub(super) const LONGEST: u32 = 65535;

/// JPEG. More than 65535 pixels in width or height is an error.
pub(super) fn encode(picture: &Picture) -> Result<Vec<u8>, String> {
    picture.check()?;
    let [width, height] = picture.size;
    if width.max(height) > LONGEST {
        return Err(format!("{width} x {height} pixels; JPEG holds at most {LONGEST} in width and height"));
    }
    let samples = color::interleave_u8(&picture.color);
    let mut file = Vec::with_capacity(samples.len() / 4);
    JpegEncoder::new_with_quality(&mut file, QUALITY)
        .encode(&samples, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| e.to_string())?;
    Ok(file)
}
