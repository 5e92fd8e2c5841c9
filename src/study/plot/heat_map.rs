//! The heat map of a surface: colours, contour lines with labels, axes and scale bar.

use super::Surface;
use super::canvas::{Anchor, Canvas, Color, INK, Stroke, Text};
use super::color_scale::ColorScale;
use super::contour;
use super::grid::{self, Grid, Place};
use super::raster;
use super::text;
use super::ticks::Ticks;

/// Font size of numbers, pixels.
const SIZE: f64 = 13.0;
/// Colours of the picture; index 0 of its palette is a masked place.
const SHADES: u8 = 255;
/// With so few ticks on the scale there is a contour line half-way between them, too.
const SPARSE: usize = 6;
/// Number of round numbers about 0 that get lines where the range does not hold all values: a decade.
const FINER: usize = 3;
/// Cells along an axis of the grid that the contour lines are drawn from, so that a cell is about a pixel: the lines then
/// follow the same bilinear function as the colours.
const FINE: usize = 320;
/// Deviation that is allowed to save points of lines, pixels.
const WASTE: f64 = 0.12;
/// Text on colours of less luma than this, of 255, is white.
const DARK: f64 = 110.0;
/// Free space that a contour's label keeps from other lines and labels, pixels.
const CLEAR: f64 = 8.0;

/// Draws it with its plane in the area left, top, width, height, in whole pixels; the numbers stand outside of it.
pub fn draw(canvas: &mut Canvas, area: [f64; 4], surface: &Surface, grid: &Grid, scale: &ColorScale) {
    let [x, y, w, h] = area;
    if grid.holes() {
        canvas.hatch(area);
    }
    match picture(grid, scale, [w as u32, h as u32]) {
        Ok(png) => canvas.image(area, &png),
        Err(reason) => canvas.text(&Text { at: [x + 8.0, y + 20.0], ..Text::default() }, &reason),
    }
    let ticks = Ticks::along(scale.range.lo, scale.range.hi, h, |_| 32.0);
    contours(canvas, area, grid, scale, &ticks);
    canvas.frame(area);
    axes(canvas, area, surface);
    scale.bar(canvas, [x + w + 24.0, y + 20.0, 18.0, h - 40.0], &ticks, &surface.value_label);
    if grid.holes() {
        let key = [x, y + h + 48.0, 22.0, 14.0];
        canvas.hatch(key);
        canvas.frame(key);
        let at = [key[0] + 30.0, key[1] + 7.0 + 0.35 * SIZE];
        canvas.text(&Text { at, size: SIZE, ..Text::default() }, "no value: at or past a pole");
    }
}

/// One pixel for each of the plane's, an indexed PNG.
fn picture(grid: &Grid, scale: &ColorScale, [width, height]: [u32; 2]) -> Result<Vec<u8>, String> {
    let places = |axis: &[f64], count: u32| -> Vec<Place> {
        let (first, last) = (axis[0], axis[axis.len() - 1]);
        (0..count)
            .map(|k| {
                let part = (f64::from(k) + 0.5) / f64::from(count);
                grid::place(axis, first * (1.0 - part) + last * part)
            })
            .collect()
    };
    let columns = places(&grid.x, width);
    let rows = places(&grid.y, height);
    let last = f64::from(SHADES - 1);
    let index = |value: f64| 1 + (scale.range.part(value).clamp(0.0, 1.0) * last).round() as u8;
    // Row 0 of the picture is its top.
    let indices: Vec<u8> = rows
        .iter()
        .rev()
        .flat_map(|&row| columns.iter().map(move |&column| grid.between(column, row).map_or(0, index)))
        .collect();
    let mut palette: Vec<Color> = vec![[0xff; 3]];
    palette.extend((0..SHADES).map(|k| scale.color_at(f64::from(k) / last)));
    raster::indexed(&indices, [width, height], &palette)
}

fn axes(canvas: &mut Canvas, [x, y, w, h]: [f64; 4], surface: &Surface) {
    let ends = |values: &[f64]| (values[0], values[values.len() - 1]);
    let (lo, hi) = ends(&surface.x.values);
    let ticks = Ticks::along(lo, hi, w, |label| text::width(label, SIZE) + 12.0);
    for (value, label) in ticks.values.iter().zip(&ticks.labels) {
        let at = x + w * (value - lo) / (hi - lo);
        canvas.line([at, y + h], [at, y + h + 5.0], Stroke::new(INK, 1.0));
        let place = Text { at: [at, y + h + 19.0], size: SIZE, anchor: Anchor::Middle, ..Text::default() };
        canvas.text(&place, label);
    }
    let middle = Text { size: 15.0, anchor: Anchor::Middle, ..Text::default() };
    canvas.text(&Text { at: [x + w / 2.0, y + h + 38.0], ..middle }, &surface.x.label);
    let (lo, hi) = ends(&surface.y.values);
    let ticks = Ticks::along(lo, hi, h, |_| 28.0);
    let mut widest: f64 = 0.0;
    for (value, label) in ticks.values.iter().zip(&ticks.labels) {
        let at = y + h * (1.0 - (value - lo) / (hi - lo));
        canvas.line([x - 5.0, at], [x, at], Stroke::new(INK, 1.0));
        widest = widest.max(text::width(label, SIZE));
        let place = Text { at: [x - 9.0, at + 0.35 * SIZE], size: SIZE, anchor: Anchor::End, ..Text::default() };
        canvas.text(&place, label);
    }
    canvas.text(&Text { at: [x - 18.0 - widest.max(24.0), y + h / 2.0], turn_deg: -90.0, ..middle }, &surface.y.label);
}

/// A contour line's value.
struct Level {
    value: f64,
    label: Option<String>,
    stroke: Stroke,
    lines: Vec<Vec<[f64; 2]>>,
}

/// Lines at the scale's ticks, the one at 0 the boldest. Thin ones stand half-way where there are few ticks, or, where the
/// range does not hold all values, at the next round numbers about 0: most values are there then.
fn contours(canvas: &mut Canvas, area: [f64; 4], grid: &Grid, scale: &ColorScale, ticks: &Ticks) {
    let [x, y, w, h] = area;
    let range = &scale.range;
    let fine = grid.refined(FINE);
    let part = |axis: &[f64], v: f64| (v - axis[0]) / (axis[axis.len() - 1] - axis[0]);
    let pixel = |[a, b]: [f64; 2]| [x + w * part(&fine.x, a), y + h * (1.0 - part(&fine.y, b))];
    let level = |value: f64, label: Option<String>, width: f64, opacity: f64| Level {
        value,
        label,
        stroke: Stroke { color: [0; 3], width, opacity },
        lines: contour::lines(&fine, value).into_iter().map(|line| line.into_iter().map(pixel).collect()).collect(),
    };
    let mut levels: Vec<Level> = Vec::new();
    for (&value, label) in ticks.values.iter().zip(&ticks.labels) {
        levels.push(level(value, Some(label.clone()), if value == 0.0 { 1.6 } else { 0.9 }, 0.75));
    }
    if range.above || range.below {
        for (value, label) in ticks.finer(FINER) {
            for (value, label) in [(value, label.clone()), (-value, format!("\u{2212}{label}"))] {
                if (range.lo..=range.hi).contains(&value) {
                    levels.push(level(value, Some(label), 0.6, 0.6));
                }
            }
        }
    } else if ticks.values.len() <= SPARSE {
        let before = ticks.values.iter().map(|v| v - 0.5 * ticks.step);
        for value in before.chain(ticks.values.last().map(|v| v + 0.5 * ticks.step)) {
            levels.push(level(value, None, 0.6, 0.5));
        }
    }
    let mut labels: Vec<[f64; 3]> = Vec::new();
    let mut texts = Vec::new();
    // What is left of the lines once the labels have their gaps.
    let mut drawn: Vec<Vec<Vec<[f64; 2]>>> = Vec::new();
    for (k, level) in levels.iter().enumerate() {
        let mut rest = Vec::new();
        for (n, line) in level.lines.iter().enumerate() {
            let others = || {
                let all = levels.iter().enumerate().flat_map(|(a, l)| l.lines.iter().enumerate().map(move |l| (a, l)));
                all.filter(|&(a, (b, _))| (a, b) != (k, n)).flat_map(|(_, (_, line))| line.iter().copied())
            };
            let text = level.label.as_ref();
            let half = text.map_or(0.0, |text| 0.5 * text::width(text, SIZE));
            match text.and_then(|text| Some((text, label_place(line, half, area, &labels, others)?))) {
                Some((text, (s, at, turn))) => {
                    labels.push([at[0], at[1], half]);
                    texts.push((text, at, turn, scale.color(level.value)));
                    rest.extend(without(line, s - half - 1.0, s + half + 1.0));
                }
                None => rest.push(line.clone()),
            }
        }
        drawn.push(rest.iter().map(|line| simplified(line)).collect());
    }
    for (level, lines) in levels.iter().zip(&drawn) {
        canvas.lines(lines.iter().map(Vec::as_slice), level.stroke);
    }
    for (text, at, turn, [r, g, b]) in texts {
        let (sin, cos) = turn.sin_cos();
        let light = 0.3 * f64::from(r) + 0.6 * f64::from(g) + 0.1 * f64::from(b);
        let place = Text {
            // The base line lies 0.35 of the size below the line.
            at: [at[0] - 0.35 * SIZE * sin, at[1] + 0.35 * SIZE * cos],
            size: SIZE,
            anchor: Anchor::Middle,
            turn_deg: turn.to_degrees(),
            color: if light < DARK { [0xff; 3] } else { INK },
        };
        canvas.text(&place, text);
    }
}

/// Lengths along a line from its start to each of its points.
fn lengths(line: &[[f64; 2]]) -> Vec<f64> {
    let mut along = vec![0.0];
    let mut sum = 0.0;
    for pair in line.windows(2) {
        sum += (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        along.push(sum);
    }
    along
}

/// The point of a line at a length along it.
fn point(line: &[[f64; 2]], along: &[f64], s: f64) -> [f64; 2] {
    let Place { i, t } = grid::place(along, s);
    [0, 1].map(|k| line[i][k] + t * (line[i + 1][k] - line[i][k]))
}

/// A line without the stretch between two lengths along it, both within it: the two parts left.
fn without(line: &[[f64; 2]], from: f64, to: f64) -> [Vec<[f64; 2]>; 2] {
    let along = lengths(line);
    let before = line.iter().zip(&along).filter(|&(_, &s)| s < from).map(|(&p, _)| p);
    let after = line.iter().zip(&along).filter(|&(_, &s)| s > to).map(|(&p, _)| p);
    let ends = [point(line, &along, from), point(line, &along, to)];
    [before.chain([ends[0]]).collect(), [ends[1]].into_iter().chain(after).collect()]
}

/// A line without the points that are nearer than [`WASTE`] to the line through those left (Douglas and Peucker 1973).
fn simplified(line: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut kept = Vec::new();
    // Stretches still to be drawn, the next one last.
    let mut stretches = vec![(0, line.len() - 1)];
    while let Some((first, last)) = stretches.pop() {
        let (a, b) = (line[first], line[last]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length = dx.hypot(dy);
        let away = |p: [f64; 2]| {
            let (u, v) = (p[0] - a[0], p[1] - a[1]);
            if length > 0.0 { (u * dy - v * dx).abs() / length } else { u.hypot(v) }
        };
        let farthest = (first + 1..last).map(|k| (k, away(line[k]))).max_by(|a, b| a.1.total_cmp(&b.1));
        match farthest {
            Some((k, distance)) if distance > WASTE => stretches.extend([(k, last), (first, k)]),
            _ => kept.push(a),
        }
    }
    kept.push(line[line.len() - 1]);
    kept
}

/// Where a label of half width `half` can stand on a line, the length along it, the point and its turn in radians, clockwise: where the line is nearly
/// straight, as near to its middle as can be, clear of the frame, of other labels (x, y, half width) and of other lines.
fn label_place<I: Iterator<Item = [f64; 2]>>(
    line: &[[f64; 2]],
    half: f64,
    [x, y, w, h]: [f64; 4],
    labels: &[[f64; 3]],
    others: impl Fn() -> I,
) -> Option<(f64, [f64; 2], f64)> {
    let along = lengths(line);
    let length = along[along.len() - 1];
    let reach = half + 4.0;
    let point = |s: f64| point(line, &along, s);
    if length < 4.0 * reach {
        return None;
    }
    for part in [0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7, 0.25, 0.75, 0.2, 0.8, 0.15, 0.85] {
        let s = part * length;
        if s < reach || s > length - reach {
            continue;
        }
        let (a, at, b) = (point(s - reach), point(s), point(s + reach));
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let chord = dx.hypot(dy);
        let inside = |p: [f64; 2]| p[0] > x + 10.0 && p[0] < x + w - 10.0 && p[1] > y + 10.0 && p[1] < y + h - 10.0;
        let straight = chord > 0.96 * 2.0 * reach;
        let apart = labels.iter().all(|l| (l[0] - at[0]).hypot(l[1] - at[1]) > half + l[2] + 4.0 * CLEAR);
        if !(straight && inside(a) && inside(b) && apart) {
            continue;
        }
        // Distances along and across the label's own direction.
        let clear = others().all(|p| {
            let (u, v) = (p[0] - at[0], p[1] - at[1]);
            (u * dx + v * dy).abs() / chord > reach || (v * dx - u * dy).abs() / chord > CLEAR
        });
        if clear {
            // Never upside down.
            let turn = if dx < 0.0 { (-dy).atan2(-dx) } else { dy.atan2(dx) };
            return Some((s, at, turn));
        }
    }
    None
}
