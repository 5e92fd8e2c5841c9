//! Plots of surfaces e(x, y): each as a 3D surface and as a heat map with contour lines, side by side; maps of where
//! pictures differ, in the pictures' own pixels with a colour bar beside them; and scattered points on logarithmic axes.
//!
//! The SVG is written here, shape by shape, and the PNG is that same SVG rasterised by `resvg`, so that one drawing code
//! serves both; `plotters` knows no masked cells, no contour lines and no heat map with a scale, and its SVG names every cell
//! in full. The letters of the PNG are DejaVu Sans from the crate `dejavu` (Bitstream Vera licence), so that no system font
//! is needed; the SVG asks for `sans-serif`.
//!
//! One file per thing that can be drawn ([`surfaces`]: `relief`, `heat_map`; [`difference_map`]; [`scatter`]) and one per thing that every chart shares:
//! `canvas` (shapes), `text`, [`ticks`], [`range`], `color_scale`, `raster` (SVG to PNG); [`grid`] and [`contour`] belong to
//! functions of two variables, `decades` and `labels` to scattered points.

mod canvas;
mod color_scale;
pub mod contour;
mod decades;
pub mod difference_map;
pub mod grid;
mod heat_map;
mod labels;
pub mod range;
mod raster;
mod relief;
pub mod scatter;
mod text;
pub mod ticks;

use canvas::{Anchor, Canvas, INK, Text};
use color_scale::ColorScale;
use grid::Grid;
use range::Range;

/// One axis of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it is and its unit, as `C_x (scene units)`; a letter's `_` lowers what follows it.
    pub label: String,
    /// Where the surface is known: at least 2 values, ascending, magnitudes up to 1e300.
    pub values: Vec<f64>,
}

/// A function on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Written above its two panels.
    pub title: String,
    /// To the right.
    pub x: Axis,
    /// Up in the heat map, to the back in the 3D surface.
    pub y: Axis,
    /// What the values are and their unit.
    pub value_label: String,
    /// Row by row, `values[j * x.values.len() + i]`; `None`, and any value that is not finite, is masked.
    pub values: Vec<Option<f64>>,
}

/// A finished drawing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawing {
    svg: String,
}

/// The formats of [`Drawing::encode`].
pub const FORMATS: &[&str] = &["svg", "png"];

/// Width of every drawing of surfaces, pixels.
pub const WIDTH: u32 = 1200;
/// Height of the panels of one surface, pixels.
const ROW: f64 = 480.0;
/// Height of the title of the drawing, pixels.
const HEAD: f64 = 44.0;
/// Size of its letters, pixels, where it fits.
const TITLE: f64 = 20.0;

/// Draws the surfaces one below the other. A surface that is no grid (too few values, an axis that does not ascend) or has
/// no value at all gets empty panels that say so.
pub fn surfaces(title: &str, surfaces: &[Surface]) -> Drawing {
    let head = if title.is_empty() { 0.0 } else { HEAD };
    let width = f64::from(WIDTH);
    let mut canvas = Canvas::new(width, head + ROW * surfaces.len().max(1) as f64, title);
    // A long title is set smaller.
    let size = (TITLE * (width - 40.0) / text::width(title, TITLE).max(1.0)).min(TITLE);
    canvas.text(&Text { at: [width / 2.0, 30.0], size, anchor: Anchor::Middle, ..Text::default() }, title);
    if surfaces.is_empty() {
        empty(&mut canvas, [0.0, head, width, ROW], "nothing to draw");
    }
    for (row, surface) in surfaces.iter().enumerate() {
        draw(&mut canvas, head + ROW * row as f64, surface);
    }
    Drawing { svg: canvas.finish() }
}

fn draw(canvas: &mut Canvas, top: f64, surface: &Surface) {
    canvas.text(&Text { at: [40.0, top + 22.0], size: 17.0, ..Text::default() }, &surface.title);
    let relief = [0.0, top + 30.0, 560.0, ROW - 30.0];
    let map = [662.0, top + 40.0, 360.0, 360.0];
    let grid = Grid::new(surface).and_then(|grid| match Range::of(grid.values()) {
        Some(range) => Ok((grid, ColorScale::new(range))),
        None => Err("no value anywhere: at or past a pole"),
    });
    match grid {
        Ok((grid, scale)) => {
            relief::draw(canvas, relief, surface, &grid, &scale);
            heat_map::draw(canvas, map, surface, &grid, &scale);
        }
        Err(reason) => {
            empty(canvas, [80.0, map[1], 430.0, map[3]], reason);
            empty(canvas, map, reason);
        }
    }
}

fn empty(canvas: &mut Canvas, area: [f64; 4], reason: &str) {
    let [x, y, w, h] = area;
    canvas.frame(area);
    let place =
        Text { at: [x + w / 2.0, y + h / 2.0], size: 15.0, anchor: Anchor::Middle, color: INK, ..Text::default() };
    canvas.text(&place, reason);
}

impl Drawing {
    /// SVG 1.1, UTF-8, of [`surfaces`] [`WIDTH`] wide; the same text from run to run.
    pub fn svg(&self) -> &str {
        &self.svg
    }

    /// 8-bit RGB PNG, sRGB, as wide as the SVG; the same bytes from run to run. Fails where an encoder does, which is a defect.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        raster::png(&self.svg)
    }

    /// The bytes of a file with this extension, `svg` or `png` in any case; another is an error that names these two.
    pub fn encode(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension.to_ascii_lowercase().as_str() {
            "svg" => Ok(self.svg.clone().into_bytes()),
            "png" => self.png(),
            _ => Err(format!("`{extension}` is no format of plots; there are {}", FORMATS.join(", "))),
        }
    }
}
