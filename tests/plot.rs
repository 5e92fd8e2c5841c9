//! Plots of surfaces: ticks, range, contour lines and grid against what they must be, then the drawings: valid, the same
//! every time, small, nothing over anything else, colours where they belong.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use stereomist::study::plot::grid::{self, Grid, Place};
use stereomist::study::plot::range::Range;
use stereomist::study::plot::ticks::Ticks;
use stereomist::study::plot::{Axis, Drawing, Surface, WIDTH, contour, surfaces};

use crate::harness;

fn axis(label: &str, lo: f64, hi: f64, count: usize) -> Axis {
    let part = |i: usize| i as f64 / (count - 1) as f64;
    Axis { label: label.into(), values: (0..count).map(|i| lo * (1.0 - part(i)) + hi * part(i)).collect() }
}

fn surface(x: Axis, y: Axis, f: impl Fn(f64, f64) -> Option<f64>) -> Surface {
    let values = y.values.iter().flat_map(|&b| x.values.iter().map(move |&a| (a, b))).map(|(a, b)| f(a, b)).collect();
    Surface { title: "f".into(), x, y, value_label: "f (units)".into(), values }
}

/// On [-2, 2]^2.
fn square(count: usize, f: impl Fn(f64, f64) -> Option<f64>) -> Surface {
    surface(axis("x (units)", -2.0, 2.0, count), axis("y (units)", -2.0, 2.0, count), f)
}

fn saddle() -> Surface {
    square(81, |x, y| Some(x * y))
}

/// Projection error of a billboard with a pole where d s = r x; masked at and past it.
fn pole() -> Surface {
    let r = 0.5;
    let axes = (axis("C_x (scene units)", -2.0, 2.0, 81), axis("C_z (scene units)", -6.0, -0.3, 81));
    let error = |x: f64, z: f64| {
        let (d, s) = (-z, x.hypot(z));
        (d * s > r * x).then(|| -r * x * (s * x / (s + d) + r) / (d * (d * s - r * x)))
    };
    Surface { value_label: "e_x (scene units on the view plane)".into(), ..surface(axes.0, axes.1, error) }
}

/// Surfaces that are hard to draw.
fn odd() -> Vec<Surface> {
    let unit = |count: usize, f: &dyn Fn(f64, f64) -> Option<f64>| {
        surface(axis("x", 0.0, 1.0, count), axis("y", 0.0, 1.0, count), f)
    };
    let mut list = vec![
        unit(2, &|x, y| Some(x + y)),
        unit(2, &|x, y| (x + y < 2.0).then_some(x)),
        unit(2, &|x, y| (x + y < 0.5).then_some(7.0)),
        unit(5, &|_, _| Some(0.0)),
        unit(5, &|_, _| Some(-3e-5)),
        unit(5, &|_, _| None),
        unit(5, &|_, _| Some(f64::NAN)),
        unit(9, &|x, y| Some(if x > 0.5 { f64::INFINITY } else { y })),
        unit(9, &|x, _| Some(1e6 + 1e-9 * x)),
        unit(9, &|x, y| Some(if x == 0.5 && y == 0.5 { 1.0 } else { 0.0 })),
        unit(400, &|x, y| (x.hypot(y) > 0.3).then(|| -2.0 - (9.0 * x).sin() * (9.0 * y).cos())),
        surface(axis("x", 0.0, 1e-300, 20), axis("y", -1e300, 1e300, 20), |x, y| Some(x * 1e300 + y * 1e-300)),
        surface(axis("x", 1.0, 1.0001, 20), axis("y", 1e5, 1e5 + 1.0, 20), |x, _| Some((x - 1.0) * 1e-296)),
        surface(axis("x", -1e-7, 3e-7, 20), axis("y", -12345.0, 98765.0, 20), |x, y| Some(x * 1e307 * y)),
        surface(axis("x", 1.0, 1.0 + 1e-13, 3), axis("y", 0.0, 1e12, 2), |_, y| Some(y - 3e11)),
    ];
    let wrong = unit(3, &|x, _| Some(x));
    list.push(Surface { values: vec![Some(1.0)], ..wrong.clone() });
    list.push(Surface { x: Axis { label: "x".into(), values: vec![0.0, 0.0, 1.0] }, ..wrong.clone() });
    list.push(Surface { x: Axis { label: "x".into(), values: vec![0.0, f64::NAN, 1.0] }, ..wrong.clone() });
    list.push(Surface { x: Axis { label: String::new(), values: Vec::new() }, values: Vec::new(), ..wrong });
    list
}

fn number(label: &str) -> f64 {
    label.replace('\u{2212}', "-").parse().unwrap()
}

#[test]
fn ticks_are_those_a_person_would_choose() {
    for (lo, hi, most, labels) in [
        (-2.0, 2.0, 5, "-2 -1 0 1 2"),
        (-2.0, 2.0, 9, "-2.0 -1.5 -1.0 -0.5 0 0.5 1.0 1.5 2.0"),
        (-6.0, -0.3, 6, "-6 -5 -4 -3 -2 -1"),
        (0.0, 1.0, 6, "0 0.2 0.4 0.6 0.8 1.0"),
        (0.1, 0.9, 2, "0.5"),
        (0.0, 6e-5, 4, "0 2e-5 4e-5 6e-5"),
        (0.0, 3e-5, 4, "0 1e-5 2e-5 3e-5"),
        (-1.5e-5, 1.5e-5, 8, "-1.5e-5 -1e-5 -5e-6 0 5e-6 1e-5 1.5e-5"),
        (0.0, 0.03, 4, "0 0.01 0.02 0.03"),
        (0.0, 4e6, 5, "0 1e6 2e6 3e6 4e6"),
        (0.0, 40000.0, 5, "0 10000 20000 30000 40000"),
        (1e5, 1e5 + 1.0, 3, "100000.0 100000.5 100001.0"),
        (-1e300, 1e300, 3, "-1e300 0 1e300"),
        (1e-300, 3e-300, 3, "1e-300 2e-300 3e-300"),
    ] {
        let ticks = Ticks::new(lo, hi, most);
        assert_eq!(ticks.labels.join(" "), labels.replace('-', "\u{2212}"), "{lo} {hi}");
        let values: Vec<f64> = ticks.labels.iter().map(|label| number(label)).collect();
        assert_eq!(ticks.values, values);
    }
    assert_eq!(Ticks::new(-0.2, 0.2, 3).values[1].to_bits(), 0);
    // Too narrow for short numbers: no loop without end, one label.
    assert_eq!(Ticks::new(1.0, 1.0 + 1e-13, 5).labels, ["1e0"]);
    assert_eq!(Ticks::new(5.0, 5.0, 5).labels.len(), 1);
}

#[test]
fn ticks_of_any_axis_are_round_within_it_and_as_fine_as_asked() {
    let mut random = harness::Random::new(5);
    for _ in 0..2000 {
        let width = 10f64.powf(random.uniform(-250.0, 250.0));
        let lo = random.uniform(-3.0, 3.0) * width;
        let (hi, most) = (lo + width, random.uniform(2.0, 12.0) as usize);
        let ticks = Ticks::new(lo, hi, most);
        assert!(!ticks.values.is_empty() && ticks.values.len() <= most, "{lo} {hi} {most}: {ticks:?}");
        let mantissa = ticks.step / 10f64.powf(ticks.step.log10().floor());
        assert!([1.0, 2.0, 5.0, 10.0].iter().any(|m| (mantissa - m).abs() < 1e-6), "{ticks:?}");
        for (value, label) in ticks.values.iter().zip(&ticks.labels) {
            let slack = 1e-8 * width;
            assert!((lo - slack..=hi + slack).contains(value), "{lo} {hi}: {ticks:?}");
            assert_eq!(number(label), *value);
            let count = value / ticks.step;
            assert!((count - count.round()).abs() < 1e-6, "{ticks:?}");
        }
        // The next finer step would have given too many.
        let finer = &ticks.finer(1)[0].0;
        assert!((finer / ticks.step - 0.5).abs() < 1e-6 || (finer / ticks.step - 0.4).abs() < 1e-6);
        let count = ((hi + 1e-9 * width) / finer).floor() - ((lo - 1e-9 * width) / finer).ceil() + 1.0;
        assert!(count > most as f64, "{lo} {hi} {most}: {ticks:?}");
    }
}

#[test]
fn labels_along_an_axis_do_not_collide() {
    for (lo, hi) in [(0.0, 1.0), (-1.5e-5, 1.5e-5), (1e5, 1e5 + 1.0), (-6.0, -0.3), (0.0, 123_456.0)] {
        for length in [40.0, 100.0, 360.0] {
            let ticks = Ticks::along(lo, hi, length, |label| 9.0 * label.chars().count() as f64);
            let widest = ticks.labels.iter().map(|label| 9 * label.chars().count()).max().unwrap() as f64;
            let apart = ticks.step / (hi - lo) * length;
            assert!(apart >= widest || ticks.values.len() <= 2, "{lo} {hi} {length}: {ticks:?}");
        }
    }
    let finer = Ticks::new(-0.8, 0.7, 9).finer(3);
    let expected = [(0.1, "0.1"), (0.05, "0.05"), (0.02, "0.02")].map(|(value, label)| (value, label.to_owned()));
    assert_eq!(finer, expected);
}

#[test]
fn the_range_holds_all_values_but_those_near_a_pole() {
    let of = |values: &[f64]| Range::of(values.iter().copied()).unwrap();
    let shown = |lo, hi| Range { lo, hi, below: false, above: false };
    assert_eq!(Range::of([].into_iter()), None);
    assert_eq!(of(&[-4.0, 0.5, 4.0]), shown(-4.0, 4.0));
    assert_eq!(of(&[0.0, 0.31, 0.97]), shown(0.0, 1.0));
    // Constant, zero, constant but for roundings.
    assert_eq!(of(&[3.0, 3.0]), shown(0.0, 6.0));
    assert_eq!(of(&[-3.0]), shown(-6.0, 0.0));
    assert_eq!(of(&[0.0, 0.0]), shown(-1.0, 1.0));
    let nearly = of(&[1.0, 1.0 + 1e-15]);
    assert!((nearly.hi - 2.0).abs() < 1e-12 && nearly.lo == 0.0 && !nearly.above);
    // A sign that is a rounding gets no side.
    assert_eq!(of(&[-1e-17, 0.4, 1.0]), shown(0.0, 1.0));
    assert_eq!(of(&[1e-17, -0.4, -1.0]), shown(-1.0, 0.0));
    assert!(of(&[-1.0, 2.0]).signed() && !of(&[1.0, 2.0]).signed());

    // 1000 values, 100 apart from 0.01 to 1.00 in steps of 0.01; then growing ones in the place of the last.
    let mut values: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i / 10 + 1)).collect();
    assert_eq!(of(&values), shown(0.0, 1.0));
    // Up to 4 times the 98th percentile (0.98) all is shown.
    values[999] = 3.9;
    assert!(!of(&values).above && of(&values).hi >= 3.9);
    // Past that the range ends at the 95th (0.95), widened to half a tick.
    values[999] = 4.0;
    assert_eq!(of(&values), Range { above: true, ..shown(0.0, 1.0) });
    values[999] = -1e9;
    let range = of(&values);
    assert!(range.below && range.lo >= -1.0 && range.hi <= 1.0 && range.hi >= 0.95, "{range:?}");
    // Spikes on zeros: no percentile to go by, so all is shown, or the 98th where the 95th is 0.
    let mut spike = vec![0.0; 1000];
    spike[7] = 5.0;
    assert_eq!(of(&spike), shown(0.0, 5.0));
    spike[..40].fill(1.0);
    spike[7] = 5.0;
    assert_eq!(of(&spike), Range { above: true, ..shown(0.0, 1.0) });
    // The whole span of numbers.
    for v in [1e-300, 1e-20, 1e300] {
        let range = of(&[-v, v]);
        assert!(range.lo <= -v && range.hi >= v && range.hi <= 1.2 * v, "{range:?}");
    }
}

#[test]
fn between_nodes_the_function_is_bilinear_and_masked_where_the_nearest_node_is() {
    let full = Grid::new(&surface(axis("", 0.0, 3.0, 4), axis("", 0.0, 2.0, 3), |x, y| Some(x * y - y))).unwrap();
    for (x, y) in [(0.0, 0.0), (3.0, 2.0), (1.25, 0.5), (2.999, 1.001), (0.5, 1.5)] {
        let value = full.between(grid::place(&full.x, x), grid::place(&full.y, y)).unwrap();
        assert!((value - (x * y - y)).abs() < 1e-12, "{x} {y}: {value}");
    }
    assert_eq!(grid::place(&full.x, -7.0), Place { i: 0, t: 0.0 });
    assert_eq!(grid::place(&full.x, 7.0), Place { i: 2, t: 1.0 });
    let holed = |x: f64, y: f64| (x != 1.0 || y != 1.0).then_some(2.0 * x - y);
    let holed = Grid::new(&surface(axis("", 0.0, 3.0, 4), axis("", 0.0, 2.0, 3), holed)).unwrap();
    for k in 0..=60 {
        for l in 0..=40 {
            let (x, y) = (f64::from(k) * 0.05 + 1e-6, f64::from(l) * 0.05 + 1e-6);
            let value = holed.between(grid::place(&holed.x, x), grid::place(&holed.y, y));
            assert_eq!(value.is_none(), (x - 1.0).abs() < 0.5 && (y - 1.0).abs() < 0.5, "{x} {y}");
            // Planes go on to the edge of the hole.
            let (x, y) = (x.min(3.0), y.min(2.0));
            assert!(value.is_none_or(|v| (v - (2.0 * x - y)).abs() < 1e-9), "{x} {y} {value:?}");
        }
    }
    let fine = full.refined(12);
    assert_eq!((fine.x.len(), fine.y.len()), (13, 13));
    assert_eq!((fine.at(4, 6), fine.at(12, 12)), (full.at(1, 1), full.at(3, 2)));
    // Constants stay exactly so, whatever the weights.
    let flat =
        Grid::new(&surface(axis("", 0.0, 3.0, 4), axis("", 0.0, 2.0, 3), |x, _| (x != 1.0).then_some(0.3))).unwrap();
    assert!(flat.refined(77).values().all(|v| v == 0.3));
}

#[test]
fn the_contour_of_a_cone_is_a_circle() {
    let cell = 4.0 / 80.0;
    let grid = Grid::new(&square(81, |x, y| Some(x.hypot(y)))).unwrap();
    for radius in [0.9, 1.3, 1.73] {
        let lines = contour::lines(&grid, radius);
        assert_eq!(lines.len(), 1);
        let line = &lines[0];
        assert_eq!(line.first(), line.last());
        for pair in line.windows(2) {
            // A chord of the circle lies a little within it.
            for (part, limit) in [(0.0, 0.01), (0.5, 0.03)] {
                let at = [0, 1].map(|k| pair[0][k] + part * (pair[1][k] - pair[0][k]));
                assert!((at[0].hypot(at[1]) - radius).abs() < limit * cell, "{radius} {at:?}");
            }
            assert!((pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]) < 1.5 * cell);
        }
        // Round once, with no way back.
        let turned: f64 = line
            .windows(2)
            .map(|p| (p[0][0] * p[1][1] - p[0][1] * p[1][0]).atan2(p[0][0] * p[1][0] + p[0][1] * p[1][1]))
            .sum();
        assert!((turned.abs() - std::f64::consts::TAU).abs() < 1e-9);
    }
}

#[test]
fn contours_end_at_masked_nodes_and_nowhere_else() {
    // The line x = 0.33 through a hole about the origin.
    let hole = |x: f64, y: f64| (x.abs() > 0.55 || y.abs() > 0.55).then_some(x);
    let grid = Grid::new(&square(41, hole)).unwrap();
    let lines = contour::lines(&grid, 0.33);
    assert_eq!(lines.len(), 2);
    for line in &lines {
        let ys: Vec<f64> = line.iter().map(|p| p[1]).collect();
        let (lo, hi) = (ys.iter().copied().fold(f64::INFINITY, f64::min), ys.iter().copied().fold(-2.0, f64::max));
        let (inner, outer) = if lo > 0.0 { (lo, hi) } else { (hi, lo) };
        assert!((inner.abs() - 0.6).abs() < 1e-9 && (outer.abs() - 2.0).abs() < 1e-9, "{lo} {hi}");
        assert!(line.iter().all(|p| (p[0] - 0.33).abs() < 1e-9));
    }
    // A single masked corner cuts its own corner off, no more.
    let corner =
        Grid::new(&surface(axis("", 0.0, 1.0, 2), axis("", 0.0, 1.0, 2), |x, y| (x + y < 2.0).then_some(x + 2.0 * y)));
    let lines = contour::lines(&corner.unwrap(), 0.5);
    assert_eq!(lines, [[[0.5, 0.0], [0.0, 0.25]]].map(|line| line.to_vec()));
    // Nodes at the level, everywhere and on a line.
    let flat = Grid::new(&square(5, |_, _| Some(1.0))).unwrap();
    assert!(contour::lines(&flat, 1.0).is_empty());
    let half = Grid::new(&square(5, |x, _| Some(x.max(0.0)))).unwrap();
    assert!(contour::lines(&half, 0.0).is_empty());
    // A saddle in one cell: two lines, joined as the mean of the corners says.
    let cell = |values: [f64; 4]| {
        let at = move |x: f64, y: f64| Some(values[(x + 2.0 * y) as usize]);
        Grid::new(&surface(axis("", 0.0, 1.0, 2), axis("", 0.0, 1.0, 2), at)).unwrap()
    };
    for (values, ends) in
        [([3.0, 0.0, 0.0, 3.0], [[0.0, 1.0], [1.0, 0.0]]), ([1.2, 0.0, 0.0, 1.2], [[0.0, 0.0], [1.0, 1.0]])]
    {
        let lines = contour::lines(&cell(values), 1.0);
        assert_eq!(lines.len(), 2);
        // Each line goes round one corner: its middle is near that.
        for corner in ends {
            let middle = |line: &[[f64; 2]]| [0, 1].map(|k| 0.5 * (line[0][k] + line[1][k]));
            let near = |m: [f64; 2]| (m[0] - corner[0]).hypot(m[1] - corner[1]) < 0.5;
            assert_eq!(lines.iter().filter(|line| near(middle(line))).count(), 1, "{values:?} {lines:?}");
        }
    }
}

/// What a test wants to know of a drawing.
struct Parsed {
    /// Attributes of the root.
    root: BTreeMap<String, String>,
    texts: Vec<Words>,
    /// Left, top, width, height and PNG of the heat maps.
    images: Vec<([f64; 4], Vec<u8>)>,
    /// Faces of each mesh, each with the number of its corners.
    meshes: Vec<Vec<usize>>,
    hatches: usize,
}

struct Words {
    at: [f64; 2],
    size: f64,
    anchor: String,
    turned: bool,
    text: String,
}

impl Words {
    /// Left, top, right, bottom, the width from above.
    fn bounds(&self) -> [f64; 4] {
        let width = 0.64 * self.size * self.text.chars().count() as f64;
        let left = match self.anchor.as_str() {
            "middle" => self.at[0] - 0.5 * width,
            "end" => self.at[0] - width,
            _ => self.at[0],
        };
        [left, self.at[1] - 0.75 * self.size, left + width, self.at[1] + 0.05 * self.size]
    }
}

fn attributes(tag: &BytesStart) -> BTreeMap<String, String> {
    let pair = |attribute: quick_xml::events::attributes::Attribute| {
        (attribute.key.as_ref().to_owned(), attribute.value.clone().into_owned())
    };
    // With the checks for quotes and names that stand twice.
    tag.attributes().map(|attribute| pair(attribute.unwrap())).collect()
}

/// Reads a drawing, every tag and every attribute of it.
fn parse(svg: &str) -> Parsed {
    let mut reader = Reader::from_str(svg);
    let mut parsed =
        Parsed { root: BTreeMap::new(), texts: Vec::new(), images: Vec::new(), meshes: Vec::new(), hatches: 0 };
    let mut open: Vec<String> = Vec::new();
    loop {
        let event = reader.read_event().unwrap_or_else(|e| panic!("byte {}: {e}", reader.error_position()));
        match &event {
            Event::Start(tag) | Event::Empty(tag) => {
                let (name, attributes) = (tag.name().as_ref().to_owned(), attributes(tag));
                let number = |key: &str| attributes[key].parse::<f64>().unwrap();
                assert!(open.is_empty() == (name == "svg"), "one root");
                for (key, value) in attributes.iter().filter(|(key, _)| *key != "xlink:href") {
                    assert!(!value.contains("NaN") && !value.contains("inf"), "{key}: {value}");
                }
                match name.as_str() {
                    "svg" => parsed.root = attributes.clone(),
                    "text" => parsed.texts.push(Words {
                        at: [number("x"), number("y")],
                        size: number("font-size"),
                        anchor: attributes.get("text-anchor").cloned().unwrap_or_default(),
                        turned: attributes.contains_key("transform"),
                        text: String::new(),
                    }),
                    "tspan" => assert!(attributes.get("font-size").is_none_or(|s| s.parse::<f64>().unwrap() >= 12.0)),
                    "image" => {
                        let data = attributes["xlink:href"].strip_prefix("data:image/png;base64,").unwrap();
                        let area = ["x", "y", "width", "height"].map(number);
                        parsed.images.push((area, STANDARD.decode(data).unwrap()));
                    }
                    "g" => parsed.meshes.push(Vec::new()),
                    "path" if open.last().is_some_and(|parent| parent == "g") => {
                        let d = &attributes["d"];
                        assert!(d.starts_with('M') && d.ends_with('z'), "{d}");
                        // Every number but the first of each pair is led by a sign or a space; two for the move.
                        let numbers = d.replace(['M', 'l', 'z'], " ").replace('-', " -");
                        let numbers: Vec<i64> = numbers.split_whitespace().map(|n| n.parse().unwrap()).collect();
                        assert_eq!(numbers.len() % 2, 0, "{d}");
                        parsed.meshes.last_mut().unwrap().push(numbers.len() / 2);
                    }
                    "rect" if attributes.get("fill").is_some_and(|fill| fill == "url(#hatch)") => parsed.hatches += 1,
                    _ => {}
                }
                if matches!(event, Event::Start(_)) {
                    open.push(name);
                }
            }
            Event::End(_) => {
                open.pop();
            }
            Event::Text(text) if open.iter().any(|name| name == "text") => {
                parsed.texts.last_mut().unwrap().text.push_str(&text.xml10_content());
            }
            Event::GeneralRef(name) if open.iter().any(|name| name == "text") => {
                assert!(["amp", "lt", "gt", "quot", "#39"].contains(&&*name.xml10_content()), "{name:?}");
                parsed.texts.last_mut().unwrap().text.push('?');
            }
            Event::Eof => break,
            _ => {}
        }
    }
    assert!(open.is_empty());
    parsed
}

/// Width, height and pixels of a PNG.
fn decode(png: &[u8]) -> image::RgbImage {
    image::load_from_memory_with_format(png, image::ImageFormat::Png).unwrap().into_rgb8()
}

fn drawn(list: &[Surface]) -> (Drawing, Parsed) {
    let drawing = surfaces("Title: C_y = 0", list);
    let parsed = parse(drawing.svg());
    (drawing, parsed)
}

/// What holds of every drawing.
fn check(drawing: &Drawing, parsed: &Parsed, rows: usize) {
    assert!(drawing.svg().ends_with("</svg>\n"));
    let height: f64 = parsed.root["height"].parse().unwrap();
    assert_eq!(parsed.root["width"], "1200");
    assert_eq!(parsed.root["viewBox"], format!("0 0 1200 {height}"));
    assert_eq!(parsed.root["font-family"], "sans-serif");
    assert_eq!(height, 44.0 + 480.0 * rows as f64);
    for text in &parsed.texts {
        assert!(text.size >= 12.0, "{}", text.text);
        assert!((0.0..=1200.0).contains(&text.at[0]) && (0.0..=height).contains(&text.at[1]), "{}", text.text);
    }
    // Texts that stand upright are within the sheet and apart from each other.
    let upright: Vec<&Words> = parsed.texts.iter().filter(|text| !text.turned).collect();
    for (k, a) in upright.iter().enumerate() {
        let [left, top, right, bottom] = a.bounds();
        assert!(left >= 0.0 && right <= 1200.0 && top >= 0.0 && bottom <= height, "`{}` is cut off", a.text);
        for b in &upright[..k] {
            let [l, t, r, o] = b.bounds();
            let over = left < r && l < right && top < o && t < bottom;
            assert!(!over, "`{}` at {:?} over `{}` at {:?}", a.text, a.at, b.text, b.at);
        }
    }
}

#[test]
fn a_drawing_is_valid_small_and_the_same_every_time() {
    for list in [[saddle(), square(81, |x, y| Some((-x * x - y * y).exp()))], [pole(), pole()]] {
        let (drawing, parsed) = drawn(&list);
        check(&drawing, &parsed, 2);
        assert!(drawing.svg().len() < 250_000, "SVG of {} bytes", drawing.svg().len());
        let again = surfaces("Title: C_y = 0", &list);
        assert_eq!(drawing, again);
        let png = drawing.png().unwrap();
        assert!(png.len() < 250_000, "PNG of {} bytes", png.len());
        assert_eq!(png, again.png().unwrap());
        assert_eq!(drawing.encode("PNG").unwrap(), png);
        assert_eq!(drawing.encode("svg").unwrap(), drawing.svg().as_bytes());
        assert!(drawing.encode("gif").unwrap_err().contains("svg, png"));
        let picture = decode(&png);
        assert_eq!(picture.dimensions(), (WIDTH, 1004));
        let colors: std::collections::BTreeSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
        assert!(colors.len() > 500, "{} colours", colors.len());
        // Title and labels are there: dark pixels where letters stand.
        let dark = |x0: u32, y0: u32, x1: u32, y1: u32| {
            (y0..y1)
                .flat_map(|y| (x0..x1).map(move |x| (x, y)))
                .filter(|&(x, y)| picture.get_pixel(x, y).0[0] < 90)
                .count()
        };
        assert!(dark(400, 8, 800, 40) > 200, "the title has {} dark pixels", dark(400, 8, 800, 40));
        assert!(dark(740, 468, 940, 486) > 100, "no label below the heat map");
        // The margins are white.
        assert!((0..1004).all(|y| picture.get_pixel(2, y).0 == [0xff; 3] && picture.get_pixel(1197, y).0 == [0xff; 3]));
    }
}

#[test]
fn text_is_escaped_and_indices_are_lowered() {
    let mut list = [saddle()];
    list[0].title = "a < b & \"c\" > 'd' \u{1}".into();
    list[0].x.label = "slice_width, C_x and C_".into();
    let drawing = surfaces("<&>", &list);
    parse(drawing.svg());
    for part in [
        "<title>&lt;&amp;&gt;</title>",
        "a &lt; b &amp; &quot;c&quot; &gt; &#39;d&#39; \u{fffd}<",
        ">slice_width, C<tspan dy=\"3\" font-size=\"12\">x</tspan><tspan dy=\"-3\"> and C_</tspan></text>",
    ] {
        assert!(drawing.svg().contains(part), "{part}");
    }
}

#[test]
fn colours_stand_where_the_values_are() {
    let (drawing, parsed) = drawn(&[saddle()]);
    let picture = decode(&drawing.png().unwrap());
    let ([x, y, w, h], png) = &parsed.images[0];
    let map = decode(png);
    assert_eq!((f64::from(map.width()), f64::from(map.height())), (*w, *h));
    // At a place of the plane, from -2 to 2: in the embedded picture and in the whole one.
    let at = |a: f64, b: f64| {
        let (i, j) = (((a + 2.0) / 4.0 * w) as u32, ((2.0 - b) / 4.0 * h) as u32);
        let color = map.get_pixel(i, j).0;
        assert_eq!(picture.get_pixel(*x as u32 + i, *y as u32 + j).0, color, "{a} {b}");
        color.map(f64::from)
    };
    let [red, blue] = [at(1.9, 1.95), at(-1.9, 1.95)];
    assert!(red[0] > red[2] + 80.0 && blue[2] > blue[0] + 80.0, "{red:?} {blue:?}");
    // Symmetric, and deeper outwards; nearly grey about 0.
    assert_eq!(at(1.5, 1.8), at(-1.5, -1.8));
    assert!(at(0.3, 0.3)[1] > at(0.9, 1.4)[1] && at(0.9, 1.4)[1] > red[1]);
    let middle = at(0.1, 0.1);
    assert!(middle.iter().all(|&c| c > 225.0) && (middle[0] - middle[2]).abs() < 12.0, "{middle:?}");
    // One sign: the lightest where the magnitude is least, above and below zero.
    for sign in [1.0, -1.0] {
        let list = [square(41, move |a, b| Some(sign * (a + b + 4.0)))];
        let map = decode(&drawn(&list).1.images[0].1);
        let luma = |i: u32, j: u32| map.get_pixel(i, j).0.iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(luma(2, 357) > luma(180, 180) + 100 && luma(180, 180) > luma(357, 2) + 100);
    }
}

#[test]
fn masked_cells_leave_holes_and_are_named() {
    // 21 x 21 nodes, 3 x 3 of them masked: 16 cells touch them, 4 of these at one corner only.
    let (whole, full) = drawn(&[square(21, |x, y| Some(x + y))]);
    let (drawing, parsed) = drawn(&[square(21, |x, y| (x.abs() > 0.3 || y.abs() > 0.3).then_some(x + y))]);
    // The plane needs no finer mesh than its 20 x 20 cells.
    assert_eq!((full.meshes[0].len(), parsed.meshes[0].len()), (400, 400 - 12));
    assert_eq!(parsed.meshes[0].iter().filter(|&&corners| corners == 3).count(), 4);
    // The heat map is transparent there and the hatch behind it shows, once more in the legend with its words.
    let ([x, y, ..], png) = &parsed.images[0];
    let map = image::load_from_memory(png).unwrap().into_rgba8();
    assert_eq!((map.get_pixel(180, 180).0[3], map.get_pixel(120, 180).0[3]), (0, 255));
    let open = map.pixels().filter(|p| p.0[3] == 0).count() as f64;
    assert!((open / (54.0 * 54.0) - 1.0).abs() < 0.05, "{open} pixels");
    let picture = decode(&drawing.png().unwrap());
    for (i, j) in [(170, 170), (180, 180), (190, 175)] {
        let [r, g, b] = picture.get_pixel(*x as u32 + i, *y as u32 + j).0;
        assert!(r == g && g == b && (140..250).contains(&r), "{r} {g} {b}");
    }
    assert_eq!((full.hatches, parsed.hatches), (0, 2));
    let named = |parsed: &Parsed| parsed.texts.iter().any(|words| words.text == "no value: at or past a pole");
    assert!(named(&parsed) && !named(&full));
    assert!(!whole.svg().contains("beyond"));
}

#[test]
fn a_pole_is_cut_off_and_said_to_be() {
    let (drawing, parsed) = drawn(&[pole()]);
    check(&drawing, &parsed, 1);
    assert_eq!(parsed.texts.iter().filter(|words| words.text == "beyond").count(), 1);
    // No face leaves the box: its picture is that of the panel, with the labels outside of it.
    let picture = decode(&drawing.png().unwrap());
    let coloured = |x: u32, y: u32| {
        let [r, _, b] = picture.get_pixel(x, y).0;
        r.abs_diff(b) > 25
    };
    assert!((0..560).all(|x| (44..130).chain(505..524).all(|y| !coloured(x, y) || (340..380).contains(&x))));
    assert!((0..104).all(|x| (44..524).all(|y| !coloured(x, y))));
    assert!((100..510).any(|x| (130..480).any(|y| coloured(x, y))));
}

#[test]
fn anything_can_be_drawn() {
    let list = odd();
    for (k, surface) in list.iter().enumerate() {
        let (drawing, parsed) = drawn(std::slice::from_ref(surface));
        check(&drawing, &parsed, 1);
        let says = |words: &str| parsed.texts.iter().filter(|text| text.text.starts_with(words)).count();
        let empty = (says("no value anywhere"), says("no grid"));
        match k {
            5 | 6 => assert_eq!(empty, (2, 0), "{k}"),
            15.. => assert_eq!(empty, (0, 2), "{k}"),
            _ => {
                assert_eq!((empty, parsed.images.len(), parsed.meshes.len()), ((0, 0), 1, 1), "{k}");
                // Faces, but for the one node that is alone.
                assert!(!parsed.meshes[0].is_empty(), "{k}");
                assert!(parsed.meshes[0].len() <= 1600, "{k}");
            }
        }
    }
    let (drawing, parsed) = drawn(&list);
    check(&drawing, &parsed, list.len());
    assert_eq!(decode(&drawing.png().unwrap()).dimensions(), (WIDTH, 44 + 480 * list.len() as u32));
    let (drawing, parsed) = drawn(&[]);
    check(&drawing, &parsed, 1);
    assert!(parsed.texts.iter().any(|words| words.text == "nothing to draw"));
}
