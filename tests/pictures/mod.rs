//! The picture room: colour, anaglyphs, files, and the comparer with its left-right inconsistency.

mod color;
mod compare;
mod dubois;
mod files;
mod hostile;
mod inconsistency;

use std::path::PathBuf;

use stereomist::picture::Picture;
use stereomist::picture::color::decode_u8;

/// A file of `tests/data`.
fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A picture of 8-bit sRGB pixels.
fn from_codes(size: [u32; 2], codes: &[[u8; 3]]) -> Picture {
    let mut picture = Picture::new(size);
    assert_eq!(codes.len(), picture.pixels());
    for (i, code) in codes.iter().enumerate() {
        for (plane, &value) in picture.color.iter_mut().zip(code) {
            plane[i] = decode_u8(value);
        }
    }
    picture
}

/// A picture with every kind of value: a gradient, values out of [0, 1], alpha.
fn gradient(size: [u32; 2]) -> Picture {
    let mut picture = Picture::new(size);
    let n = picture.pixels();
    for i in 0..n {
        let t = i as f32 / n as f32;
        picture.color[0][i] = 1.4 * t - 0.2;
        picture.color[1][i] = (7.0 * t).sin().abs();
        picture.color[2][i] = (1.0 - t).powi(5);
    }
    picture.alpha = Some((0..n).map(|i| i as f32 / n as f32).collect());
    picture
}
