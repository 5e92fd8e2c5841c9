//! Reading pictures, for `compose` and `compare`: PNG, JPEG and OpenEXR, told apart by content, not by name.
//!
//! Files are not trusted. Sizes are checked in the header before anything of that size is allocated, and a header that
//! promises more pixels than the file's bytes could hold is refused.

use std::cell::Cell;
use std::fs::File;
use std::io::{Cursor, Read};
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Once;

use exr::meta::MetaData;
use exr::prelude::{Compression, ReadChannels, ReadLayers, ReadSpecificChannel, Vec2};
use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::PngDecoder;
use image::{DynamicImage, ImageDecoder, Limits};

use crate::error::{Error, Result};
use crate::picture::{Disparity, MAX_PIXELS, MAX_SIDE, Picture, Plane, Side, color};

/// A picture from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// In linear light; what a file of integers holds is decoded as sRGB. Alpha where the file has it.
    pub picture: Picture,
    /// The colour as it stands in the file.
    pub samples: Samples,
}

/// Colour samples of a file, interleaved R, G, B (grey three times), without alpha.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// sRGB-encoded, 8 bits or fewer, scaled to 0..255.
    U8(Vec<u8>),
    /// sRGB-encoded, 16 bits.
    U16(Vec<u16>),
    /// Linear light, float: the picture's own planes.
    Float,
}

/// No picture within the limits needs more bytes (six 32-bit channels), nor do its headers.
const MAX_FILE: u64 = MAX_PIXELS * 24 + (1 << 24);

/// Samples that one byte of a file can stand for. Deflate reaches 1032 (PNG, EXR), a JPEG of large empty blocks 1230, and
/// the run lengths of EXR's other schemes stay near those. What promises more is a lie.
const MAX_EXPANSION: u64 = 4096;
/// Memory that metadata of a file may take while it is read.
const METADATA_MEMORY: u64 = 64 << 20;

/// Reads a PNG, JPEG (8 or 16 bit, grey, RGB, with or without alpha, palette) or OpenEXR file (channels R, G, B and
/// perhaps A, any number type; and `disparityL.x` or `disparityR.x`, unless it has both and nobody knows whose it is). A JPEG's or PNG's EXIF orientation is applied. Sizes up to [`MAX_SIDE`] a side and
/// [`MAX_PIXELS`] in all.
///
/// [`Error::Input`] for everything that cannot be read so.
pub fn read(path: &Path) -> Result<Image> {
    let fail = |e: std::io::Error| Error::input(path, e.to_string());
    let mut file = File::open(path).map_err(fail)?;
    // The first bytes alone decide whether it is worth reading: devices never end.
    let mut bytes = Vec::new();
    file.by_ref().take(SIGNATURE as u64).read_to_end(&mut bytes).map_err(fail)?;
    Kind::of(&bytes).map_err(|message| Error::input(path, message))?;
    file.take(MAX_FILE).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() as u64 >= MAX_FILE {
        return Err(Error::input(path, format!("the file is larger than {MAX_FILE} bytes")));
    }
    read_bytes(&bytes).map_err(|message| Error::input(path, message))
}

/// Reads a picture from a file's bytes; as [`read`]. The error is one line without a file name.
pub fn read_bytes(bytes: &[u8]) -> Result<Image, String> {
    let kind = Kind::of(bytes)?;
    let decode = || match kind {
        Kind::Png => read_png(bytes),
        Kind::Jpeg => read_jpeg(bytes),
        Kind::Exr => read_exr(bytes),
    };
    // The decoders are other people's and files are anyone's: a decoder that panics on a damaged file (exr does so in
    // places) is one more way to say that the file is damaged. Nothing of the decoder outlives the call.
    without_panic(decode).unwrap_or_else(|| Err("the file is damaged".into()))
}

/// Bytes that tell the formats apart.
const SIGNATURE: usize = 8;

enum Kind {
    Png,
    Jpeg,
    Exr,
}

impl Kind {
    fn of(bytes: &[u8]) -> Result<Self, String> {
        if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            Ok(Self::Png)
        } else if bytes.starts_with(&[0xff, 0xd8, 0xff]) {
            Ok(Self::Jpeg)
        } else if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            Ok(Self::Exr)
        } else if bytes.is_empty() {
            Err("the file is empty; a PNG, JPEG or OpenEXR picture is needed".into())
        } else {
            Err("the file is neither PNG nor JPEG nor OpenEXR".into())
        }
    }
}

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// The result, or nothing if `work` panicked. The panic is not reported: its cause is the file, which the caller names.
fn without_panic<T>(work: impl FnOnce() -> T) -> Option<T> {
    // The hook is the process's: it is wrapped once, and silent only for a thread inside this function.
    static WRAP: Once = Once::new();
    WRAP.call_once(|| {
        let report = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !QUIET.get() {
                report(info);
            }
        }));
    });
    let before = QUIET.replace(true);
    let result = catch_unwind(AssertUnwindSafe(work));
    QUIET.set(before);
    result.ok()
}

/// Refuses sizes out of bounds and sizes that `bytes` of file, each standing for at most `expansion` samples, cannot fill.
fn check_size(width: u64, height: u64, channels: u64, bytes: usize, expansion: u64) -> Result<(), String> {
    let side = 1..=u64::from(MAX_SIDE);
    // The product is computed only for sides within bounds, so it cannot overflow.
    if !side.contains(&width) || !side.contains(&height) || width * height > MAX_PIXELS {
        return Err(format!(
            "{width} x {height} pixels; sizes are 1 to {MAX_SIDE} a side and at most {MAX_PIXELS} pixels in all"
        ));
    }
    if width * height * channels > (bytes as u64).saturating_mul(expansion) {
        return Err(format!("the file is damaged: {bytes} bytes cannot hold {width} x {height} pixels"));
    }
    Ok(())
}

fn read_png(bytes: &[u8]) -> Result<Image, String> {
    // Signature, then length and name of the IHDR chunk, then the size: looked at before the decoder allocates by it.
    if let Some(&[a, b, c, d, e, f, g, h]) = bytes.get(16..24) {
        let (width, height) = (u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h]));
        check_size(width.into(), height.into(), 1, bytes.len(), MAX_EXPANSION)?;
    }
    let mut limits = Limits::no_limits();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(METADATA_MEMORY);
    let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(one_line)?;
    read_integers(decoder, bytes.len())
}

fn read_jpeg(bytes: &[u8]) -> Result<Image, String> {
    // The decoder fills in what is missing at the end of a file with grey; half a picture is not what was asked for.
    if !jpeg_is_whole(bytes) {
        return Err("the file is damaged: it ends within the picture".into());
    }
    let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(one_line)?;
    read_integers(decoder, bytes.len())
}

/// Whether an end-of-image marker follows the first scan's header. Segments are walked by their lengths, because they
/// may hold a preview, a JPEG with markers of its own; in the scans' data FF D9 is that marker alone (ITU-T T.81, B.1.1.5).
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let mut at = 2;
    while let Some(&[0xff, marker]) = bytes.get(at..at + 2) {
        match marker {
            // Fill bytes before a marker.
            0xff => at += 1,
            0xda => return bytes[at + 2..].windows(2).any(|pair| pair == [0xff, 0xd9]),
            // Markers without a length.
            0x01 | 0xd0..=0xd8 => at += 2,
            _ => match bytes.get(at + 2..at + 4) {
                Some(&[high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
                _ => return false,
            },
        }
    }
    false
}

fn read_integers(mut decoder: impl ImageDecoder, bytes: usize) -> Result<Image, String> {
    let (width, height) = decoder.dimensions();
    let kind = decoder.color_type();
    check_size(width.into(), height.into(), kind.channel_count().into(), bytes, MAX_EXPANSION)?;
    let orientation = decoder.orientation().map_err(one_line)?;
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(one_line)?;
    decoded.apply_orientation(orientation);
    let size = [decoded.width(), decoded.height()];
    // Alpha is not sRGB-encoded: it is linear coverage.
    let (samples, alpha): (Samples, Option<Plane<f32>>) = match decoded {
        DynamicImage::ImageLuma8(image) => (Samples::U8(image.iter().flat_map(|&v| [v; 3]).collect()), None),
        DynamicImage::ImageLumaA8(image) => (
            Samples::U8(image.pixels().flat_map(|p| [p.0[0]; 3]).collect()),
            Some(image.pixels().map(|p| f32::from(p.0[1]) / 255.0).collect()),
        ),
        DynamicImage::ImageRgb8(image) => (Samples::U8(image.into_raw()), None),
        DynamicImage::ImageRgba8(image) => (
            Samples::U8(image.pixels().flat_map(|p| [p.0[0], p.0[1], p.0[2]]).collect()),
            Some(image.pixels().map(|p| f32::from(p.0[3]) / 255.0).collect()),
        ),
        DynamicImage::ImageLuma16(image) => (Samples::U16(image.iter().flat_map(|&v| [v; 3]).collect()), None),
        DynamicImage::ImageLumaA16(image) => (
            Samples::U16(image.pixels().flat_map(|p| [p.0[0]; 3]).collect()),
            Some(image.pixels().map(|p| f32::from(p.0[1]) / 65535.0).collect()),
        ),
        DynamicImage::ImageRgb16(image) => (Samples::U16(image.into_raw()), None),
        DynamicImage::ImageRgba16(image) => (
            Samples::U16(image.pixels().flat_map(|p| [p.0[0], p.0[1], p.0[2]]).collect()),
            Some(image.pixels().map(|p| f32::from(p.0[3]) / 65535.0).collect()),
        ),
        // image's enum is open; the two decoders above give none of its other kinds.
        other => return Err(format!("pixels of type {:?} are not read", other.color())),
    };
    let plane = |c: usize| -> Plane<f32> {
        match &samples {
            Samples::U8(v) => v.iter().skip(c).step_by(3).map(|&code| color::decode_u8(code)).collect(),
            Samples::U16(v) => v.iter().skip(c).step_by(3).map(|&code| color::decode_u16(code)).collect(),
            Samples::Float => Plane::new(0),
        }
    };
    let picture = Picture { size, color: [plane(0), plane(1), plane(2)], alpha, error: None, disparity: None };
    Ok(Image { picture, samples })
}

fn read_exr(bytes: &[u8]) -> Result<Image, String> {
    // The header alone first: its sizes decide whether the pixels are read at all.
    let headers = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(one_line)?.headers;
    for header in &headers {
        // The decoder of this one scheme allocates what the blocks' own headers claim, and a claim beyond all memory ends
        // the process.
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            return Err("OpenEXR files with DWA compression are not read; save it with ZIP, PIZ, RLE or none".into());
        }
        let Vec2(width, height) = header.layer_size;
        check_size(width as u64, height as u64, header.channels.list.len() as u64, bytes.len(), MAX_EXPANSION)?;
    }
    let names =
        |h: &exr::meta::header::Header| -> Vec<String> { h.channels.list.iter().map(|c| c.name.to_string()).collect() };
    if !headers.iter().any(|h| !h.deep && ["R", "G", "B"].iter().all(|&c| h.channels.list.iter().any(|d| d.name.eq(c))))
    {
        let found: Vec<_> = headers.iter().flat_map(names).take(16).collect();
        return Err(format!("the file has no flat layer with channels R, G and B; it has {}", found.join(", ")));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("R")
        .required("G")
        .required("B")
        .optional("A", 1.0_f32)
        .optional(Side::Left.channel(), f32::NAN)
        .optional(Side::Right.channel(), f32::NAN)
        .collect_pixels(
            |size: Vec2<usize>, (_, _, _, alpha, left, right)| {
                let mut picture = Picture::new([size.width() as u32, size.height() as u32]);
                picture.alpha = alpha.is_some().then(|| Plane::filled(1.0, size.area()));
                let side = match (left.is_some(), right.is_some()) {
                    (true, false) => Some(Side::Left),
                    (false, true) => Some(Side::Right),
                    (true, true) | (false, false) => None,
                };
                picture.disparity = side.map(|side| Disparity { side, x: Plane::filled(f32::NAN, size.area()) });
                picture
            },
            |picture: &mut Picture, Vec2(x, y), (r, g, b, a, left, right): (f32, f32, f32, f32, f32, f32)| {
                let i = y * picture.size[0] as usize + x;
                for (plane, value) in picture.color.iter_mut().zip([r, g, b]) {
                    plane[i] = value;
                }
                if let Some(alpha) = &mut picture.alpha {
                    alpha[i] = a;
                }
                if let Some(disparity) = &mut picture.disparity {
                    disparity.x[i] = match disparity.side {
                        Side::Left => left,
                        Side::Right => right,
                    };
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(one_line)?;
    Ok(Image { picture: image.layer_data.channel_data.pixels, samples: Samples::Float })
}

/// A decoder's error on one line: what it quotes of a damaged file may hold anything.
fn one_line(error: impl std::fmt::Display) -> String {
    error.to_string().chars().map(|c| if c.is_control() { ' ' } else { c }).take(300).collect()
}
