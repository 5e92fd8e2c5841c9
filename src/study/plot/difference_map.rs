//! Where pictures differ, pixel by pixel, with the colour bar that says by how much.

use super::Drawing;
use super::canvas::{Canvas, Color, Text};
use super::color_scale::ColorScale;
use super::text;
use super::ticks::Ticks;
use crate::error::{Error, Result};
use crate::picture::{Picture, color, read};
use crate::study::metrics::Difference;

/// The colour of pixels that are equal.
pub const EQUAL: Color = [0, 0, 0];
/// The colour of pixels whose difference is no number (NaN or infinite): no part of the scale.
pub const NOT_FINITE: Color = [0, 255, 255];

/// Heights of the bar's panel, pixels: room for the label at least, no more than is needed to read the bar.
const HEIGHT: [u32; 2] = [260, 1024];
/// Free space around, width of the bar, its distance from the labels and width of the label's line, pixels.
const MARGIN: f64 = 16.0;
const BAR: f64 = 18.0;
const GAP: f64 = 9.0;
const LABEL: f64 = 36.0;
/// Font size of numbers, as the bar's, and height of a line of the key, pixels.
const SIZE: f64 = 13.0;
const LINE: f64 = 24.0;

/// The differences' maps side by side, one pixel for each of the pictures', at the top left of a white sheet; to their right
/// a bar of the scale, 0 to `top` (finite, 0 for none), with numbers, `label` (what the values are, and their unit) and the
/// colours of [`EQUAL`] and, where there is one, of [`NOT_FINITE`]. Values above `top` have the colour of `top`.
///
/// [`Error::Usage`] unless the maps are of one height.
pub fn picture(parts: &[Difference], top: f64, label: &str) -> Result<Picture> {
    let height = parts.first().map_or(0, |d| d.size[1]);
    if height == 0 || parts.iter().any(|d| d.size[1] != height) {
        return Err(Error::Usage("heat maps of pictures of different heights cannot stand side by side".into()));
    }
    let scale = (top > 0.0).then(|| ColorScale::glow(top));
    let not_finite = parts.iter().flat_map(|d| &d.map).any(|value| !value.is_finite());
    let panel = panel(scale.as_ref(), label, not_finite, height.clamp(HEIGHT[0], HEIGHT[1]));
    // What the drawing is made of is all ours: where it fails, that is a defect and no matter of the file's name.
    let panel = panel.png().and_then(|png| read::read_bytes(&png)).map_err(Error::Usage)?.picture;
    let maps: u32 = parts.iter().map(|d| d.size[0]).sum();
    let size = [maps + panel.size[0], height.max(panel.size[1])];
    let mut out = Picture::new(size);
    let [width, panel_width] = [size[0] as usize, panel.size[0] as usize];
    for (plane, panel) in out.color.iter_mut().zip(&panel.color) {
        plane.fill(1.0);
        for (row, pixels) in plane.chunks_exact_mut(width).zip(panel.chunks_exact(panel_width)) {
            row[maps as usize..].copy_from_slice(pixels);
        }
    }
    let mut left = 0;
    for part in parts {
        let columns = part.size[0] as usize;
        for (row, values) in part.map.chunks_exact(columns).enumerate() {
            for (column, &value) in values.iter().enumerate() {
                let code = match &scale {
                    _ if !value.is_finite() => NOT_FINITE,
                    Some(scale) if value > 0.0 => scale.color(value.into()),
                    Some(_) | None => EQUAL,
                };
                let i = row * width + left + column;
                for (plane, code) in out.color.iter_mut().zip(code) {
                    plane[i] = color::decode_u8(code);
                }
            }
        }
        left += columns;
    }
    Ok(out)
}

/// The bar with its numbers and label, below it the colours that are no part of it.
fn panel(scale: Option<&ColorScale>, label: &str, not_finite: bool, height: u32) -> Drawing {
    let height = f64::from(height);
    let key: Vec<(Color, &str)> =
        [(EQUAL, "equal"), (NOT_FINITE, "no number")].into_iter().take(1 + usize::from(not_finite)).collect();
    let bottom = height - MARGIN - LINE * key.len() as f64;
    let bar = [MARGIN, MARGIN, BAR, bottom - 2.0 * MARGIN];
    let ticks = scale.map(|scale| Ticks::along(scale.range.lo, scale.range.hi, bar[3], |_| 32.0));
    let widest = |labels: &mut dyn Iterator<Item = &str>| -> f64 {
        labels.map(|label| text::width(label, SIZE)).fold(0.0, f64::max)
    };
    let numbers = ticks.iter().flat_map(|ticks| ticks.labels.iter().map(String::as_str));
    let bar_width = widest(&mut numbers.into_iter()) + LABEL;
    let key_width = widest(&mut key.iter().map(|(_, word)| *word));
    let mut canvas = Canvas::new((2.0 * MARGIN + BAR + GAP + bar_width.max(key_width)).ceil(), height, "");
    if let (Some(scale), Some(ticks)) = (scale, &ticks) {
        scale.bar(&mut canvas, bar, ticks, label);
    }
    for (line, (fill, word)) in key.into_iter().enumerate() {
        let y = bottom + LINE * line as f64;
        let area = [MARGIN, y, BAR, SIZE + 1.0];
        let [x, y, w, h] = area;
        canvas.polygon(&[[x, y], [x + w, y], [x + w, y + h], [x, y + h]], fill);
        canvas.frame(area);
        let at = [x + w + GAP, y + 0.5 * h + 0.35 * SIZE];
        canvas.text(&Text { at, size: SIZE, ..Text::default() }, word);
    }
    Drawing { svg: canvas.finish() }
}
