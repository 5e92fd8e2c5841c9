//! Pictures on meshes: PNG and JPEG, decoded to linear light within bounds.

use super::file::read_file;
use super::mesh::Outcome;
use crate::picture::color::{decode_u8, decode_u16};
use crate::scene::mesh::{Texture, Wrap};
use std::io::Cursor;
use std::path::Path;

/// Largest side of a texture, texels.
const LARGEST_SIDE: u32 = 32_768;

/// Most texels in all textures of a file.
pub(super) const MOST_TEXELS: u64 = 1 << 26;

/// Memory that decoding one picture may take besides its texels, bytes: four for each of [`MOST_TEXELS`].
const DECODER_BYTES: u64 = 4 * MOST_TEXELS;

/// Texels that a byte of a picture can stand for at the most: a byte of deflate, or the bits of an empty JPEG block, give
/// about a thousand bytes. A picture that claims more is damaged, and is refused before anything is allocated for it.
const TEXELS_PER_BYTE: u64 = 1100 * 8;

/// Reads a PNG or JPEG of at most `most` texels as [`decode`] does; the error names the file.
pub(super) fn read_texture(path: &Path, wrap: [Wrap; 2], most: u64) -> Outcome<Texture> {
    read_file(path, u64::MAX)
        .and_then(|bytes| decode(&bytes, wrap, most))
        .map_err(|e| format!("texture {}: {e}", path.display()))
}

/// Decodes a PNG or JPEG of at most `most` texels to linear light.
pub(super) fn decode(bytes: &[u8], wrap: [Wrap; 2], most: u64) -> Outcome<Texture> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (image::ImageFormat::Png | image::ImageFormat::Jpeg)) => format,
        _ => return Err("is neither PNG nor JPEG".to_owned()),
    };
    let reader = || image::ImageReader::with_format(Cursor::new(bytes), format);
    // The size stands in the header: refused before anything is decoded.
    let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
    let texels = u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || width > LARGEST_SIDE || height > LARGEST_SIDE || texels > most {
        return Err(format!(
            "is {width}x{height}; allowed: {LARGEST_SIDE} a side and {MOST_TEXELS} texels in all textures of the file"
        ));
    }
    let proven = (bytes.len() as u64).saturating_mul(TEXELS_PER_BYTE);
    if texels > proven {
        return Err(format!("claims {width}x{height} texels in {} bytes: it is damaged or truncated", bytes.len()));
    }
    let mut reader = reader();
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    limits.max_alloc = Some(DECODER_BYTES);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?;
    // Each with its own loop: converting the whole picture first would hold it twice.
    use image::DynamicImage as D;
    let texels: Vec<[f32; 3]> = match &picture {
        D::ImageRgb8(p) => p.pixels().map(|p| p.0.map(decode_u8)).collect(),
        D::ImageRgba8(p) => p.pixels().map(|p| [p.0[0], p.0[1], p.0[2]].map(decode_u8)).collect(),
        D::ImageLuma8(p) => p.pixels().map(|p| [decode_u8(p.0[0]); 3]).collect(),
        D::ImageLumaA8(p) => p.pixels().map(|p| [decode_u8(p.0[0]); 3]).collect(),
        D::ImageRgb16(p) => p.pixels().map(|p| p.0.map(decode_u16)).collect(),
        D::ImageRgba16(p) => p.pixels().map(|p| [p.0[0], p.0[1], p.0[2]].map(decode_u16)).collect(),
        D::ImageLuma16(p) => p.pixels().map(|p| [decode_u16(p.0[0]); 3]).collect(),
        D::ImageLumaA16(p) => p.pixels().map(|p| [decode_u16(p.0[0]); 3]).collect(),
        // The type may grow; PNG and JPEG give no other layouts.
        _ => return Err("has an unknown pixel layout".to_owned()),
    };
    Ok(Texture { width, height, texels, wrap })
}
