//! Scattered points on logarithmic axes, with the front of those that no other beats.

use super::canvas::{Anchor, Canvas, Color, INK, PALE, Stroke, Text};
use super::decades::Decades;
use super::{Drawing, TITLE, labels, text};

/// Points of several kinds.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Written above.
    pub title: String,
    /// Written below the title, smaller.
    pub subtitle: String,
    /// What x is and its unit.
    pub x_label: String,
    /// What y is and its unit.
    pub y_label: String,
    /// Names of the kinds, for the legend, which shows those that have a point. Each has a shape and a colour by its place
    /// here; after [`STYLES`] they come again.
    pub kinds: Vec<String>,
    /// The points. One that is not finite or whose x is not above 0 is not drawn.
    pub points: Vec<Point>,
}

/// A point.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Index of its kind.
    pub kind: usize,
    /// Above 0.
    pub x: f64,
    /// At least 0; what is 0 stands at the lower edge.
    pub y: f64,
    /// Its name.
    pub label: String,
    /// Whether it is on the front: named, and joined with the others by a staircase.
    pub front: bool,
}

/// A marker: regular polygon or star.
#[derive(Clone, Copy, Debug)]
struct Shape {
    corners: usize,
    /// Clockwise, from straight up.
    turn_deg: f64,
    /// Radius of the inner corners as a part of the outer ones', 1: a polygon.
    inner: f64,
}

const fn polygon(corners: usize, turn_deg: f64) -> Shape {
    Shape { corners, turn_deg, inner: 1.0 }
}

const fn star(corners: usize, turn_deg: f64, inner: f64) -> Shape {
    Shape { corners, turn_deg, inner }
}

/// Number of different markers.
pub const STYLES: usize = LOOKS.len();

/// Shapes and colours of the kinds. The colours are those of Okabe & Ito (2008), which colour-blind readers can tell apart;
/// where one comes twice the shapes differ much.
const LOOKS: [(Shape, Color); 10] = [
    (polygon(24, 0.0), [0x00, 0x72, 0xb2]),
    (polygon(4, 45.0), [0x56, 0xb4, 0xe9]),
    (polygon(3, 0.0), [0xe6, 0x9f, 0x00]),
    (polygon(4, 0.0), [0x00, 0x9e, 0x73]),
    (polygon(3, 180.0), [0xf0, 0xe4, 0x42]),
    (star(5, 0.0, 0.45), [0xd5, 0x5e, 0x00]),
    (polygon(3, 90.0), [0xcc, 0x79, 0xa7]),
    (polygon(3, -90.0), [0xcc, 0x79, 0xa7]),
    (polygon(6, 0.0), [0xcc, 0x79, 0xa7]),
    (star(4, 0.0, 0.35), [0x22, 0x22, 0x22]),
];

/// Size of the drawing, pixels.
const SIZE: [f64; 2] = [1000.0, 680.0];
/// The axes: left, top, width, height.
const AXES: [f64; 4] = [92.0, 74.0, 700.0, 540.0];
/// Height of the strip at the lower edge for what is 0.
const STRIP: f64 = 34.0;
/// Font sizes of numbers and of names.
const NUMBER: f64 = 13.0;
const NAME: f64 = 12.0;
/// Height of a line of the legend.
const LINE: f64 = 24.0;
/// Half the height of a marker.
const RADIUS: f64 = 6.5;
/// Most powers of ten with a label, and with lines between them.
const POWERS: usize = 10;

/// Draws the points, 1000 x 680 pixels.
pub fn scatter(scatter: &Scatter) -> Drawing {
    let mut canvas = Canvas::new(SIZE[0], SIZE[1], &scatter.title);
    let middle = Text { anchor: Anchor::Middle, ..Text::default() };
    for (line, size, y) in [(&scatter.title, TITLE, 30.0), (&scatter.subtitle, 14.0, 54.0)] {
        let fits = (size * (SIZE[0] - 40.0) / text::width(line, size).max(1.0)).min(size);
        canvas.text(&Text { at: [SIZE[0] / 2.0, y], size: fits, ..middle }, line);
    }
    let points: Vec<&Point> =
        scatter.points.iter().filter(|point| point.x.is_finite() && point.x > 0.0 && point.y.is_finite()).collect();
    let [x, y, w, h] = AXES;
    let strip = if points.iter().any(|point| point.y <= 0.0) { STRIP } else { 0.0 };
    let across = Decades::new(points.iter().map(|point| point.x));
    let up = Decades::new(points.iter().map(|point| point.y).filter(|y| *y > 0.0));
    let column = |value: f64| x + w * across.part(value);
    let row = |value: f64| {
        if value > 0.0 { y + (h - strip) * (1.0 - up.part(value)) } else { y + h - 0.5 * strip }
    };
    let axes = Axes { across: &across, up: &up, strip, column: &column, row: &row };
    axes.draw(&mut canvas);
    canvas.text(&Text { at: [x + w / 2.0, y + h + 46.0], size: 15.0, ..middle }, &scatter.x_label);
    let at = [24.0, y + h / 2.0];
    canvas.text(&Text { at, size: 15.0, turn_deg: -90.0, ..middle }, &scatter.y_label);
    if points.is_empty() {
        canvas.text(&Text { at: [x + w / 2.0, y + h / 2.0], size: 15.0, ..middle }, "no point to draw");
    }

    let places: Vec<[f64; 2]> = points.iter().map(|point| [column(point.x), row(point.y)]).collect();
    let mut front: Vec<usize> = (0..points.len()).filter(|&i| points[i].front).collect();
    // Of points alike in x, the higher one first.
    front.sort_by(|&a, &b| points[a].x.total_cmp(&points[b].x).then(points[b].y.total_cmp(&points[a].y)));
    let path = staircase(&front.iter().map(|&i| places[i]).collect::<Vec<_>>());
    canvas.lines([&path[..]], Stroke { color: INK, width: 1.4, opacity: 0.65 });
    let sizes: Vec<(usize, [f64; 2])> =
        front.iter().map(|&i| (i, [text::width(&points[i].label, NAME), 1.1 * NAME])).collect();
    let labels = labels::place(&sizes, &places, &path, [x, y, x + w, y + h]);
    for leader in labels.iter().flatten().filter_map(|label| label.leader) {
        canvas.line(leader[0], leader[1], Stroke { color: INK, width: 0.7, opacity: 0.6 });
    }
    for (point, &place) in points.iter().zip(&places) {
        let name = format!("{}: {}, {}", point.label, point.x, point.y);
        marker(&mut canvas, point.kind, place, &name);
    }
    for (&i, label) in front.iter().zip(&labels) {
        if let Some(label) = label {
            let [l, t, r, _] = label.area;
            // A text is narrower than its area: it stands at the side of its point.
            let (at, anchor) = if l + r < 2.0 * places[i][0] { (r, Anchor::End) } else { (l, Anchor::Start) };
            canvas.text(&Text { at: [at, t + 0.85 * NAME], size: NAME, anchor, ..Text::default() }, &points[i].label);
        }
    }
    legend(&mut canvas, scatter, &points, !front.is_empty());
    Drawing { svg: canvas.finish() }
}

/// The axes of a drawing and where values stand on them.
struct Axes<'a> {
    across: &'a Decades,
    up: &'a Decades,
    strip: f64,
    column: &'a dyn Fn(f64) -> f64,
    row: &'a dyn Fn(f64) -> f64,
}

impl Axes<'_> {
    /// Lines at the powers of ten and between, their labels, and the frame.
    fn draw(&self, canvas: &mut Canvas) {
        let [x, y, w, h] = AXES;
        let grid = |power: bool| Stroke { color: PALE, width: 1.0, opacity: if power { 1.0 } else { 0.45 } };
        for (value, power) in self.across.lines(POWERS) {
            let at = (self.column)(value);
            canvas.line([at, y], [at, y + h], grid(power));
            canvas.line([at, y + h], [at, y + h + if power { 6.0 } else { 3.0 }], Stroke::new(INK, 1.0));
        }
        for (value, label) in self.across.labels(POWERS) {
            let at = [(self.column)(value), y + h + 21.0];
            canvas.text(&Text { at, size: NUMBER, anchor: Anchor::Middle, ..Text::default() }, &label);
        }
        for (value, power) in self.up.lines(POWERS) {
            let at = (self.row)(value);
            canvas.line([x, at], [x + w, at], grid(power));
            canvas.line([x - if power { 6.0 } else { 3.0 }, at], [x, at], Stroke::new(INK, 1.0));
        }
        let mut labels = self.up.labels(POWERS);
        if self.strip > 0.0 {
            labels.push((0.0, "0".into()));
            let at = y + h - self.strip;
            canvas.line([x, at], [x + w, at], Stroke { color: INK, width: 0.7, opacity: 0.6 });
        }
        for (value, label) in labels {
            let at = [x - 10.0, (self.row)(value) + 0.35 * NUMBER];
            canvas.text(&Text { at, size: NUMBER, anchor: Anchor::End, ..Text::default() }, &label);
        }
        canvas.frame(AXES);
    }
}

/// Down from the upper edge, through points that go to the right and downwards, and on to the right edge.
fn staircase(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let [x, y, w, _] = AXES;
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Vec::new() };
    let mut path = vec![[first[0], y]];
    for &point in points {
        let height = path[path.len() - 1][1];
        // To a point's x first, then to its height: what lies above and to the right of the line is beaten.
        path.extend([[point[0], height], point]);
    }
    path.push([x + w, last[1]]);
    path
}

fn marker(canvas: &mut Canvas, kind: usize, at: [f64; 2], name: &str) {
    let (shape, fill) = LOOKS[kind % STYLES];
    let count = if shape.inner == 1.0 { shape.corners } else { 2 * shape.corners };
    let corners = (0..count).map(|k| {
        let angle = shape.turn_deg.to_radians() + k as f64 / count as f64 * std::f64::consts::TAU;
        let radius = if k % 2 == 1 { shape.inner } else { 1.0 };
        [radius * angle.sin(), -radius * angle.cos()]
    });
    let corners: Vec<[f64; 2]> = corners.collect();
    // As high or wide as all others, with the middle of its box at its place.
    let ends = [0, 1].map(|axis| {
        corners.iter().fold([f64::INFINITY, -f64::INFINITY], |[lo, hi], c| [lo.min(c[axis]), hi.max(c[axis])])
    });
    let scale = 2.0 * RADIUS / (ends[0][1] - ends[0][0]).max(ends[1][1] - ends[1][0]);
    let corners: Vec<[f64; 2]> = corners
        .into_iter()
        .map(|c| [0, 1].map(|axis| at[axis] + scale * (c[axis] - 0.5 * (ends[axis][0] + ends[axis][1]))))
        .collect();
    canvas.marker(&corners, fill, Stroke::new(INK, 0.8), name);
}

/// The kinds that have points, and the front.
fn legend(canvas: &mut Canvas, scatter: &Scatter, points: &[&Point], front: bool) {
    let [x, y, w, _] = AXES;
    let (left, mut at) = (x + w + 30.0, y + 14.0);
    for (kind, name) in scatter.kinds.iter().enumerate() {
        if points.iter().any(|point| point.kind == kind) {
            marker(canvas, kind, [left, at], name);
            let place = [left + 18.0, at + 0.35 * NUMBER];
            canvas.text(&Text { at: place, size: NUMBER, ..Text::default() }, name);
            at += LINE;
        }
    }
    if front {
        canvas.line([left - 9.0, at], [left + 9.0, at], Stroke { color: INK, width: 1.4, opacity: 0.65 });
        let place = [left + 18.0, at + 0.35 * NUMBER];
        canvas.text(&Text { at: place, size: NUMBER, ..Text::default() }, "Pareto front");
    }
}
