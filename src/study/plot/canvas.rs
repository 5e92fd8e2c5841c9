//! Shapes written as SVG. Pixels, x to the right, y down; colours are sRGB bytes.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::text;

/// An sRGB colour.
pub type Color = [u8; 3];

/// Text and axes.
pub const INK: Color = [0x22, 0x22, 0x22];
/// Lines of a grid.
pub const PALE: Color = [0xd4, 0xd4, 0xd4];

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    /// Its colour.
    pub color: Color,
    /// Pixels.
    pub width: f64,
    /// 0 to 1.
    pub opacity: f64,
}

impl Stroke {
    /// An opaque line.
    pub const fn new(color: Color, width: f64) -> Self {
        Self { color, width, opacity: 1.0 }
    }
}

/// Which point of a text stands at its place.
#[derive(Clone, Copy, Debug, Default)]
pub enum Anchor {
    /// Its left end.
    #[default]
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// How a text is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Text {
    /// Left, middle or right end of the base line.
    pub at: [f64; 2],
    /// Font size in pixels.
    pub size: f64,
    /// Which.
    pub anchor: Anchor,
    /// Turned about `at`, clockwise.
    pub turn_deg: f64,
    /// Its colour.
    pub color: Color,
}

impl Default for Text {
    fn default() -> Self {
        Self { at: [0.0; 2], size: 13.0, anchor: Anchor::Start, turn_deg: 0.0, color: INK }
    }
}

/// A drawing under way. What is drawn later covers what was drawn before.
pub struct Canvas {
    svg: String,
    gradients: usize,
}

impl Canvas {
    /// A white sheet of this size with a name for those who cannot see it.
    pub fn new(width: f64, height: f64, name: &str) -> Self {
        let (w, h) = (number(width), number(height));
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" \
             width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" font-family=\"sans-serif\">\n"
        );
        if !name.is_empty() {
            let _ = writeln!(svg, "<title>{}</title>", text::escape(name));
        }
        let _ = writeln!(
            svg,
            "<defs><pattern id=\"hatch\" width=\"6\" height=\"6\" patternUnits=\"userSpaceOnUse\">\
             <rect width=\"6\" height=\"6\" fill=\"#ececec\"/>\
             <path d=\"M-1 1L1-1M-1 7L7-1M5 7L7 5\" stroke=\"#a8a8a8\" stroke-width=\"1\"/></pattern></defs>\n\
             <rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>"
        );
        Self { svg, gradients: 0 }
    }

    /// The SVG.
    pub fn finish(mut self) -> String {
        self.svg.push_str("</svg>\n");
        self.svg
    }

    /// A text; `A_b` lowers the b.
    pub fn text(&mut self, place: &Text, content: &str) {
        if content.is_empty() {
            return;
        }
        let [x, y] = place.at.map(number);
        let _ =
            write!(self.svg, "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" fill=\"{}\"", place.size, hex(place.color));
        match place.anchor {
            Anchor::Start => {}
            Anchor::Middle => self.svg.push_str(" text-anchor=\"middle\""),
            Anchor::End => self.svg.push_str(" text-anchor=\"end\""),
        }
        if place.turn_deg != 0.0 {
            let _ = write!(self.svg, " transform=\"rotate({} {x} {y})\"", number(place.turn_deg));
        }
        let _ = writeln!(self.svg, ">{}</text>", text::markup(content, place.size));
    }

    /// Lines of one kind, each through its points.
    pub fn lines<'a>(&mut self, lines: impl IntoIterator<Item = &'a [[f64; 2]]>, stroke: Stroke) {
        let mut path = String::new();
        for line in lines {
            polyline(&mut path, line, tenths);
        }
        if !path.is_empty() {
            let _ = writeln!(self.svg, "<path d=\"{path}\" fill=\"none\"{}/>", attributes(stroke));
        }
    }

    /// One straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Stroke) {
        self.lines([&[from, to][..]], stroke);
    }

    /// The edge of a rectangle, given as left, top, width, height.
    pub fn frame(&mut self, [x, y, w, h]: [f64; 4]) {
        self.lines(
            [&[[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y - 0.5]][..]],
            Stroke { color: INK, width: 1.0, opacity: 1.0 },
        );
    }

    /// A filled polygon without an edge.
    pub fn polygon(&mut self, corners: &[[f64; 2]], fill: Color) {
        let mut path = String::new();
        polyline(&mut path, corners, tenths);
        let _ = writeln!(self.svg, "<path d=\"{path}z\" fill=\"{}\"/>", hex(fill));
    }

    /// A filled polygon with an edge, and a name that is shown where the pointer rests on it.
    pub fn marker(&mut self, corners: &[[f64; 2]], fill: Color, edge: Stroke, name: &str) {
        let mut path = String::new();
        polyline(&mut path, corners, tenths);
        let _ = writeln!(
            self.svg,
            "<path d=\"{path}z\" fill=\"{}\"{}><title>{}</title></path>",
            hex(fill),
            attributes(edge),
            text::escape(name)
        );
    }

    /// Many filled polygons with the same edge, in painter's order.
    pub fn mesh(&mut self, faces: impl IntoIterator<Item = (Vec<[f64; 2]>, Color)>, edge: Stroke) {
        // Tenths of a pixel as whole numbers save a fifth of the bytes; the group scales them back.
        let edge = Stroke { width: edge.width * 10.0, ..edge };
        let _ = writeln!(self.svg, "<g transform=\"scale(.1)\"{} stroke-linejoin=\"round\">", attributes(edge));
        for (corners, fill) in faces {
            let mut path = String::new();
            polyline(&mut path, &corners, |count| count.to_string());
            let _ = writeln!(self.svg, "<path fill=\"{}\" d=\"{path}z\"/>", hex(fill));
        }
        self.svg.push_str("</g>\n");
    }

    /// A hatched rectangle: left, top, width, height.
    pub fn hatch(&mut self, area: [f64; 4]) {
        let [x, y, w, h] = area.map(number);
        let _ = writeln!(self.svg, "<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"url(#hatch)\"/>");
    }

    /// A rectangle whose colour runs from the first of `colors` at the bottom to the last at the top, evenly.
    pub fn gradient(&mut self, area: [f64; 4], colors: &[Color]) {
        let [x, y, w, h] = area.map(number);
        let id = self.gradients;
        self.gradients += 1;
        let _ = write!(self.svg, "<linearGradient id=\"scale{id}\" x1=\"0\" x2=\"0\" y1=\"1\" y2=\"0\">");
        let last = colors.len().saturating_sub(1).max(1) as f64;
        for (i, color) in colors.iter().enumerate() {
            let _ = write!(self.svg, "<stop offset=\"{:.4}\" stop-color=\"{}\"/>", i as f64 / last, hex(*color));
        }
        let _ = writeln!(
            self.svg,
            "</linearGradient>\n<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"url(#scale{id})\"/>"
        );
    }

    /// A picture, a whole PNG file, stretched over a rectangle.
    pub fn image(&mut self, area: [f64; 4], png: &[u8]) {
        let [x, y, w, h] = area.map(number);
        // SVG 1.1 spells it `xlink:href`, which every reader knows.
        let _ = writeln!(
            self.svg,
            "<image x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" preserveAspectRatio=\"none\" \
             xlink:href=\"data:image/png;base64,{}\"/>",
            STANDARD.encode(png)
        );
    }
}

fn attributes(stroke: Stroke) -> String {
    let mut text = format!(" stroke=\"{}\" stroke-width=\"{}\"", hex(stroke.color), number(stroke.width));
    if stroke.opacity < 1.0 {
        let _ = write!(text, " stroke-opacity=\"{:.2}\"", stroke.opacity);
    }
    text
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Pixels to a tenth, without a zero behind the point.
fn number(value: f64) -> String {
    tenths((value * 10.0).round() as i64)
}

fn tenths(count: i64) -> String {
    if count % 10 == 0 { (count / 10).to_string() } else { (count as f64 / 10.0).to_string() }
}

/// Path commands through points in pixels, written with `write` from whole tenths: one absolute move, then lines, each
/// relative to where the rounded ones before it ended, so that roundings do not add up. A point that rounds to the last
/// one is left out.
fn polyline(path: &mut String, points: &[[f64; 2]], write: impl Fn(i64) -> String) {
    let mut pen: Option<[i64; 2]> = None;
    let mut drawn = false;
    for point in points {
        let to = point.map(|x| (x * 10.0).round() as i64);
        let pair = match pen {
            None => {
                path.push('M');
                to
            }
            Some(from) if from == to => continue,
            Some(from) => {
                let step = [to[0] - from[0], to[1] - from[1]];
                if !drawn {
                    path.push('l');
                } else if step[0] >= 0 {
                    path.push(' ');
                }
                drawn = true;
                step
            }
        };
        path.push_str(&write(pair[0]));
        if pair[1] >= 0 {
            path.push(' ');
        }
        path.push_str(&write(pair[1]));
        pen = Some(to);
    }
}
