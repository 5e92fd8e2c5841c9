//! SVG to PNG.

use std::collections::HashMap;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

/// The sans-serif letters of the pictures.
const FAMILY: &str = "DejaVu Sans";

/// A colour that a picture has less often than this is a mixture at an edge.
const RARE: u32 = 16;
/// Channels of mixtures are rounded to multiples of this, which black and white are: nobody sees it, and files are smaller
/// by a quarter.
const STEP: u8 = 15;

/// Draws an SVG on a sheet of its own size, one pixel for each of its units, as 8-bit RGB PNG. What it leaves open is white.
pub fn png(svg: &str) -> Result<Vec<u8>, String> {
    let mut options = Options { font_family: FAMILY.to_owned(), ..Options::default() };
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.set_sans_serif_family(FAMILY);
    let tree = Tree::from_str(svg, &options).map_err(|e| e.to_string())?;
    let size = tree.size().to_int_size();
    let mut pixels = Pixmap::new(size.width(), size.height()).ok_or("the drawing is too large")?;
    pixels.fill(resvg::tiny_skia::Color::WHITE);
    resvg::render(&tree, Transform::identity(), &mut pixels.as_mut());
    let colors: Vec<[u8; 3]> = pixels.data().as_chunks::<4>().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    let mut counts: HashMap<[u8; 3], u32> = HashMap::new();
    for &color in &colors {
        *counts.entry(color).or_default() += 1;
    }
    let rgb: Vec<u8> =
        colors.into_iter().flat_map(|color| if counts[&color] < RARE { color.map(coarse) } else { color }).collect();
    encode(&rgb, [size.width(), size.height()], None)
}

/// The nearest multiple of [`STEP`].
fn coarse(value: u8) -> u8 {
    value.saturating_add(STEP / 2) / STEP * STEP
}

/// A PNG of one byte per pixel, an index into a palette of sRGB colours. Index 0 is transparent.
pub fn indexed(indices: &[u8], size: [u32; 2], palette: &[[u8; 3]]) -> Result<Vec<u8>, String> {
    encode(indices, size, Some(palette))
}

fn encode(bytes: &[u8], [width, height]: [u32; 2], palette: Option<&[[u8; 3]]>) -> Result<Vec<u8>, String> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    match palette {
        Some(palette) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(palette.as_flattened().to_vec());
            encoder.set_trns(&[0][..]);
            // Neighbours are neighbours in the palette: a third to three quarters smaller than without.
            encoder.set_filter(png::Filter::Sub);
        }
        None => {
            encoder.set_color(png::ColorType::Rgb);
            // Edges and text: 15 % smaller than with any other.
            encoder.set_filter(png::Filter::NoFilter);
        }
    }
    let mut writer = encoder.write_header().map_err(|e| e.to_string())?;
    writer.write_image_data(bytes).map_err(|e| e.to_string())?;
    writer.finish().map_err(|e| e.to_string())?;
    Ok(file)
}
