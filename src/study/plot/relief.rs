//! The 3D surface: a mesh over its floor, seen from the front right and from above in parallel projection.

use std::f64::consts::FRAC_PI_3;

use super::Surface;
use super::canvas::{Anchor, Canvas, Color, INK, PALE, Stroke, Text};
use super::color_scale::ColorScale;
use super::grid::Grid;
use super::text;
use super::ticks::Ticks;

/// Font size of numbers, pixels.
const SIZE: f64 = 13.0;
/// Cells of the mesh along each axis at most; a finer grid is thinned.
const MOST_CELLS: usize = 40;
/// And about so many at least.
const LEAST_CELLS: usize = 24;
/// Colours of the faces are this many steps apart: none that can be seen, but files that are smaller.
const SHADES: f64 = 64.0;
/// Direction of the viewer about the vertical, from the x axis against the y axis: x runs to the right, y to the back.
const AZIMUTH: f64 = FRAC_PI_3;
/// And above the floor, radians.
const ELEVATION: f64 = 0.46;
/// Height of the box over the length of its sides.
const HEIGHT: f64 = 0.72;

/// Parallel projection of the unit cube: x to the right, y to the back, z up.
#[derive(Clone, Copy, Debug)]
struct View {
    center: [f64; 2],
    scale: f64,
}

impl View {
    /// That which fits the cube into the area left, top, width, height.
    fn fit([x, y, w, h]: [f64; 4]) -> Self {
        let unit = Self { center: [0.0; 2], scale: 1.0 };
        let mut min = [f64::INFINITY; 2];
        let mut max = [f64::NEG_INFINITY; 2];
        for corner in 0..8 {
            let p = unit.project([0, 1, 2].map(|axis| f64::from(corner >> axis & 1)));
            for k in 0..2 {
                (min[k], max[k]) = (min[k].min(p[k]), max[k].max(p[k]));
            }
        }
        let scale = (w / (max[0] - min[0])).min(h / (max[1] - min[1]));
        let center = [x + 0.5 * w - scale * 0.5 * (min[0] + max[0]), y + 0.5 * h - scale * 0.5 * (min[1] + max[1])];
        Self { center, scale }
    }

    fn project(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let (sin, cos) = AZIMUTH.sin_cos();
        let (u, v) = (x - 0.5, y - 0.5);
        let toward = u * cos - v * sin;
        let up = HEIGHT * z * ELEVATION.cos() - toward * ELEVATION.sin();
        [self.center[0] + self.scale * (u * sin + v * cos), self.center[1] - self.scale * up]
    }
}

/// Draws it, with its numbers and labels, in the area left, top, width, height.
pub fn draw(canvas: &mut Canvas, area: [f64; 4], surface: &Surface, grid: &Grid, scale: &ColorScale) {
    let [x, y, w, h] = area;
    let view = View::fit([x + 100.0, y + 14.0, w - 150.0, h - 84.0]);
    let axes = Axes::new(&view, surface, scale);
    axes.back(canvas, &view);
    let edge = Stroke { color: [0; 3], width: 0.5, opacity: 0.4 };
    canvas.mesh(faces(grid, scale).map(|(face, color)| (face.iter().map(|&p| view.project(p)).collect(), color)), edge);
    axes.front(canvas, &view);
}

/// One axis of the box: along it from 0 to 1.
struct Edge<'a> {
    ticks: Ticks,
    /// Ticks' places from 0 to 1.
    parts: Vec<f64>,
    label: &'a str,
    start: [f64; 3],
    axis: usize,
}

struct Axes<'a> {
    x: Edge<'a>,
    y: Edge<'a>,
    z: Edge<'a>,
}

impl<'a> Edge<'a> {
    fn new(view: &View, start: [f64; 3], axis: usize, (lo, hi): (f64, f64), label: &'a str) -> Self {
        let mut end = start;
        end[axis] = 1.0;
        let (from, to) = (view.project(start), view.project(end));
        let step = [to[0] - from[0], to[1] - from[1]];
        let length = step[0].hypot(step[1]);
        // Two numbers are apart if they are so in width or in height.
        let extent = |label: &str| {
            let across = (text::width(label, SIZE) + 10.0) * length / step[0].abs();
            let down = 1.7 * SIZE * length / step[1].abs();
            across.min(down)
        };
        let ticks = Ticks::along(lo, hi, length, extent);
        let parts = ticks.values.iter().map(|v| (v - lo) / (hi - lo)).collect();
        Self { ticks, parts, label, start, axis }
    }

    fn at(&self, part: f64) -> [f64; 3] {
        let mut point = self.start;
        point[self.axis] = part;
        point
    }
}

impl<'a> Axes<'a> {
    fn new(view: &View, surface: &'a Surface, scale: &ColorScale) -> Self {
        let ends = |values: &[f64]| (values[0], values[values.len() - 1]);
        let (lo, hi) = (scale.range.lo, scale.range.hi);
        Self {
            x: Edge::new(view, [0.0, 0.0, 0.0], 0, ends(&surface.x.values), &surface.x.label),
            y: Edge::new(view, [1.0, 0.0, 0.0], 1, ends(&surface.y.values), &surface.y.label),
            z: Edge::new(view, [0.0, 0.0, 0.0], 2, (lo, hi), &surface.value_label),
        }
    }

    /// The floor and the two walls behind, with lines at the ticks.
    fn back(&self, canvas: &mut Canvas, view: &View) {
        let mut lines: Vec<Vec<[f64; 3]>> = Vec::new();
        lines.extend(self.x.parts.iter().map(|&x| vec![[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 1.0, 1.0]]));
        lines.extend(self.y.parts.iter().map(|&y| vec![[1.0, y, 0.0], [0.0, y, 0.0], [0.0, y, 1.0]]));
        lines.extend(self.z.parts.iter().map(|&z| vec![[0.0, 0.0, z], [0.0, 1.0, z], [1.0, 1.0, z]]));
        let flat: Vec<Vec<[f64; 2]>> =
            lines.iter().map(|line| line.iter().map(|&p| view.project(p)).collect()).collect();
        canvas.lines(flat.iter().map(Vec::as_slice), Stroke::new(PALE, 0.8));
        let box_edges = [
            vec![[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]],
            vec![[0.0, 1.0, 0.0], [0.0, 1.0, 1.0]],
        ];
        let flat: Vec<Vec<[f64; 2]>> =
            box_edges.iter().map(|line| line.iter().map(|&p| view.project(p)).collect()).collect();
        canvas.lines(flat.iter().map(Vec::as_slice), Stroke::new([0x99; 3], 0.9));
    }

    /// The three axes with ticks, numbers and labels, on the outline of the box.
    fn front(&self, canvas: &mut Canvas, view: &View) {
        // Away from the box, in its own directions.
        let sides = [
            (&self.x, [0.0, -1.0, 0.0], Anchor::Middle),
            (&self.y, [1.0, 0.0, 0.0], Anchor::Start),
            (&self.z, [-1.0, 0.0, 0.0], Anchor::End),
        ];
        for (edge, away, anchor) in sides {
            let (from, to) = (view.project(edge.at(0.0)), view.project(edge.at(1.0)));
            canvas.line(from, to, Stroke::new(INK, 1.0));
            let origin = view.project([0.0; 3]);
            let tip = view.project(away);
            let length = (tip[0] - origin[0]).hypot(tip[1] - origin[1]);
            // Numbers of the vertical axis stand level with their ticks.
            let out = match edge.axis {
                2 => [-1.0, 0.0],
                _ => [(tip[0] - origin[0]) / length, (tip[1] - origin[1]) / length],
            };
            let mut widest: f64 = 0.0;
            for (&part, label) in edge.parts.iter().zip(&edge.ticks.labels) {
                let p = view.project(edge.at(part));
                canvas.line(p, [p[0] + 5.0 * out[0], p[1] + 5.0 * out[1]], Stroke::new(INK, 1.0));
                let far = if edge.axis == 0 { 20.0 } else { 9.0 };
                let at = [p[0] + far * out[0], p[1] + far * out[1] + (0.35 + 0.35 * out[1]) * SIZE];
                canvas.text(&Text { at, size: SIZE, anchor, ..Text::default() }, label);
                widest = widest.max(text::width(label, SIZE));
            }
            // The label runs along its axis, clear of the widest number.
            let step = [to[0] - from[0], to[1] - from[1]];
            let run = step[0].hypot(step[1]);
            let (turn, normal) = match edge.axis {
                2 => (-90.0, [-1.0, 0.0]),
                _ => (step[1].atan2(step[0]).to_degrees(), [-step[1] / run, step[0] / run]),
            };
            let clear = match edge.axis {
                0 => 46.0,
                1 => 34.0 + (widest * normal[0].abs()).max(14.0),
                _ => 21.0 + widest,
            };
            let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
            let at = [middle[0] + clear * normal[0], middle[1] + clear * normal[1]];
            canvas
                .text(&Text { at, size: 15.0, anchor: Anchor::Middle, turn_deg: turn, ..Text::default() }, edge.label);
        }
    }
}

/// The faces of the mesh in the unit cube with their colours, the farthest first: rows from the back to the front, in each
/// from the left to the right, which is away from the viewer to towards him. Open where a node is masked; cut off at the
/// top and the bottom of the box.
fn faces(grid: &Grid, scale: &ColorScale) -> impl Iterator<Item = (Vec<[f64; 3]>, Color)> {
    // Coarse grids show their bilinear surface, as the heat map does.
    let grid = &grid.refined(LEAST_CELLS);
    let columns = thinned(grid.x.len());
    let rows = thinned(grid.y.len());
    let mut faces = Vec::new();
    for row in rows.windows(2).rev() {
        for column in columns.windows(2) {
            let corners = cell(grid, [column[0], column[1]], [row[0], row[1]]);
            let points: Vec<[f64; 3]> = corners.into_iter().filter_map(|(i, j)| point(grid, scale, i, j)).collect();
            let face = below(&below(&points, 1.0, 1.0), -1.0, 0.0);
            if face.len() > 2 {
                let mean = face.iter().map(|p| p[2]).sum::<f64>() / face.len() as f64;
                faces.push((face, scale.color_at((mean * SHADES).round() / SHADES)));
            }
        }
    }
    faces.into_iter()
}

/// Nodes of an axis with so many, the first and the last among them, evenly chosen.
fn thinned(nodes: usize) -> Vec<usize> {
    let cells = (nodes - 1).min(MOST_CELLS);
    (0..=cells).map(|k| (k * (nodes - 1) + cells / 2) / cells).collect()
}

/// The corners of a cell of the thinned mesh that can be drawn: all four where no node of it is masked, three where none is
/// in their triangle, else none.
fn cell(grid: &Grid, [i0, i1]: [usize; 2], [j0, j1]: [usize; 2]) -> Vec<(usize, usize)> {
    let corners = [(i0, j0), (i1, j0), (i1, j1), (i0, j1)];
    let mut masked = Vec::new();
    for j in j0..=j1 {
        for i in i0..=i1 {
            if grid.at(i, j).is_none() {
                masked.push([(i - i0) as f64 / (i1 - i0) as f64, (j - j0) as f64 / (j1 - j0) as f64]);
            }
        }
    }
    if masked.is_empty() {
        return corners.to_vec();
    }
    // A triangle holds what is nearer to its own right angle than to the corner left out.
    let free = |left_out: usize| {
        let [a, b] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]][left_out];
        masked.iter().all(|[s, t]| (s - a).abs() + (t - b).abs() < 1.0)
    };
    match (0..4).find(|&left_out| free(left_out)) {
        Some(left_out) => (1..4).map(|k| corners[(left_out + k) % 4]).collect(),
        None => Vec::new(),
    }
}

/// A node in the unit cube, above or below it where its value is beyond the range.
fn point(grid: &Grid, scale: &ColorScale, i: usize, j: usize) -> Option<[f64; 3]> {
    let part = |axis: &[f64], v: f64| (v - axis[0]) / (axis[axis.len() - 1] - axis[0]);
    grid.at(i, j).map(|v| [part(&grid.x, grid.x[i]), part(&grid.y, grid.y[j]), scale.range.part(v)])
}

/// The part of a convex polygon where sign z <= limit (Sutherland and Hodgman 1974).
fn below(polygon: &[[f64; 3]], sign: f64, limit: f64) -> Vec<[f64; 3]> {
    let mut kept = Vec::new();
    for (k, &b) in polygon.iter().enumerate() {
        let a = polygon[(k + polygon.len() - 1) % polygon.len()];
        let (over_a, over_b) = (sign * a[2] - limit, sign * b[2] - limit);
        if (over_a > 0.0) != (over_b > 0.0) {
            let t = over_a / (over_a - over_b);
            kept.push([0, 1, 2].map(|n| a[n] + t * (b[n] - a[n])));
        }
        if over_b <= 0.0 {
            kept.push(b);
        }
    }
    kept
}
