//! Charts: the front on planted points, the drawing read back, the table read back, the sample, the truth and the errors
//! against whole pictures of the reference, enlargement against rays, and the loop that measures time.

use std::collections::BTreeSet;
use std::time::Duration;

use glam::DVec3;
use quick_xml::events::Event;
use quick_xml::reader::Reader;
use stereomist::Error;
use stereomist::picture::{Film, Picture};
use stereomist::render::{Method, Settings, Statistics, draw, reference};
use stereomist::scene::{Camera, Kernel, Scene, Stereo, StereoMode};
use stereomist::study::chart::front::front;
use stereomist::study::chart::{CANDIDATES, Candidate, Errors, Row, Sample, Subject, Truth, enlarge, table};
use stereomist::study::inconsistency;
use stereomist::study::plot::scatter::{Point, Scatter, scatter};
use stereomist::study::timing::{self, Timing};

use crate::harness::{Gas, Random};

const INF: f64 = f64::INFINITY;

#[test]
fn the_front_holds_what_no_other_point_beats() {
    for (points, expected) in [
        (&[][..], &[][..]),
        (&[[1.0, 1.0]], &[true]),
        // A staircase with one point behind it, one beside a step and one on a step's end.
        (
            &[[1.0, 8.0], [2.0, 4.0], [3.0, 2.0], [2.5, 5.0], [2.0, 6.0], [4.0, 2.0]],
            &[true, true, true, false, false, false],
        ),
        // Points alike stand together; alike in one, the better in the other.
        (&[[1.0, 1.0], [1.0, 1.0], [1.0, 2.0], [2.0, 1.0]], &[true, true, false, false]),
        // Several without error: the fastest.
        (&[[5.0, 0.0], [3.0, 0.0], [1.0, 0.5], [4.0, 1e-300]], &[false, true, true, false]),
        (&[[1.0, INF], [2.0, f64::NAN], [INF, 0.0], [9.0, 9.0]], &[false, false, false, true]),
    ] {
        assert_eq!(front(points), expected, "{points:?}");
    }
    // Against the definition, on points with many ties.
    let mut random = Random::new(3);
    for _ in 0..200 {
        let points: Vec<[f64; 2]> = (0..20).map(|_| [0, 1].map(|_| random.uniform(0.0, 6.0).floor())).collect();
        for (point, on) in points.iter().zip(front(&points)) {
            let beaten =
                points.iter().any(|p| p[0] <= point[0] && p[1] < point[1] || p[0] < point[0] && p[1] <= point[1]);
            assert_eq!(on, !beaten, "{point:?} of {points:?}");
        }
    }
}

/// A text of a drawing and the rectangle that it covers at most.
#[derive(Debug)]
struct Word {
    text: String,
    size: f64,
    at: [f64; 2],
    area: [f64; 4],
}

/// What was drawn: texts, and markers with their names and the middles of their boxes.
#[derive(Debug, Default)]
struct Read {
    words: Vec<Word>,
    markers: Vec<(String, [f64; 2])>,
    /// Lines of the front's width, as points.
    front: Vec<[f64; 2]>,
}

/// The points of a path of relative lines.
fn points(d: &str) -> Vec<[f64; 2]> {
    let mut spaced = String::new();
    for c in d.chars() {
        match c {
            'M' | 'l' | 'z' => spaced.push(' '),
            '-' => spaced += " -",
            c => spaced.push(c),
        }
    }
    let numbers: Vec<f64> = spaced.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let mut pen = [0.0, 0.0];
    numbers
        .chunks_exact(2)
        .map(|step| {
            pen = [pen[0] + step[0], pen[1] + step[1]];
            pen
        })
        .collect()
}

fn read(svg: &str) -> Read {
    let mut reader = Reader::from_str(svg);
    let (mut found, mut stack) = (Read::default(), Vec::new());
    loop {
        match reader.read_event().unwrap() {
            event @ (Event::Start(_) | Event::Empty(_)) => {
                let (tag, open) = match &event {
                    Event::Start(tag) => (tag, true),
                    Event::Empty(tag) => (tag, false),
                    _ => unreachable!(),
                };
                let get = |key: &str| {
                    tag.attributes().map(Result::unwrap).find(|a| a.key.as_ref() == key).map(|a| a.value.into_owned())
                };
                let number = |key: &str| get(key).unwrap().parse::<f64>().unwrap();
                match tag.name().as_ref() {
                    "text" => found.words.push(Word {
                        text: String::new(),
                        size: number("font-size"),
                        at: [number("x"), number("y")],
                        area: [
                            match get("text-anchor").as_deref() {
                                None => 0.0,
                                Some("middle") => 0.5,
                                Some("end") => 1.0,
                                Some(other) => panic!("{other}"),
                            },
                            f64::from(u8::from(get("transform").is_some())),
                            0.0,
                            0.0,
                        ],
                    }),
                    "path" if open => {
                        let corners = points(&get("d").unwrap());
                        let middle = [0, 1].map(|axis| {
                            let values = corners.iter().map(|corner| corner[axis]);
                            let (lo, hi) = values.fold((INF, -INF), |(lo, hi), v| (lo.min(v), hi.max(v)));
                            0.5 * (lo + hi)
                        });
                        found.markers.push((String::new(), middle));
                    }
                    "path" if get("stroke-width").as_deref() == Some("1.4") => {
                        let line = points(&get("d").unwrap());
                        if line.len() > found.front.len() {
                            found.front = line;
                        }
                    }
                    _ => {}
                }
                if open {
                    stack.push(tag.name().as_ref().to_owned());
                }
            }
            Event::End(_) => {
                stack.pop();
            }
            Event::Text(text) => {
                let text = text.xml10_content().into_owned();
                match stack.iter().map(String::as_str).collect::<Vec<_>>()[..] {
                    [.., "text"] => found.words.last_mut().unwrap().text += &text,
                    [.., "path", "title"] => found.markers.last_mut().unwrap().0 += &text,
                    _ => {}
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    for word in &mut found.words {
        let [anchor, turned, ..] = word.area;
        let width = 0.64 * word.size * word.text.chars().count() as f64;
        let [x, y] = word.at;
        let (before, after) = (anchor * width, (1.0 - anchor) * width);
        let (above, below) = (0.8 * word.size, 0.22 * word.size);
        word.area = if turned == 1.0 {
            [x - above, y - after, x + below, y + before]
        } else {
            [x - before, y - above, x + after, y + below]
        };
    }
    found
}

/// Value at a place of an axis, from two of its labels: (place, value).
fn value_at(place: f64, labels: &[(f64, f64)]) -> f64 {
    let (&(a, first), &(b, last)) = (labels.first().unwrap(), labels.last().unwrap());
    assert!(a != b && first != last, "an axis needs two labels: {labels:?}");
    10f64.powf(first.log10() + (place - a) / (b - a) * (last.log10() - first.log10()))
}

fn number(label: &str) -> f64 {
    label.replace('\u{2212}', "-").parse().unwrap()
}

/// The labels of the axis below and of the axis to the left, "0" left out: (place, value).
fn axes(read: &Read) -> [Vec<(f64, f64)>; 2] {
    let below = read.words.iter().filter(|word| word.at[1] == 635.0).map(|word| (word.at[0], number(&word.text)));
    let left = read.words.iter().filter(|word| word.at[0] == 82.0 && word.text != "0");
    [below.collect(), left.map(|word| (word.at[1] - 0.35 * 13.0, number(&word.text))).collect()]
}

fn chart(points: Vec<Point>) -> Scatter {
    Scatter {
        title: "title & <signs>".into(),
        subtitle: "about it".into(),
        x_label: "time (ms)".into(),
        y_label: "error (linear light)".into(),
        kinds: (0..12).map(|kind| format!("kind {kind}")).collect(),
        points,
    }
}

fn planted(values: &[[f64; 2]]) -> Vec<Point> {
    let point = |(i, (&[x, y], front)): (usize, (&[f64; 2], bool))| Point {
        kind: i % 12,
        x,
        y,
        label: format!("name {i}"),
        front,
    };
    values.iter().zip(front(values)).enumerate().map(point).collect()
}

#[test]
fn every_point_lies_where_its_numbers_say() {
    let mut random = Random::new(11);
    for (decades, count, zeros) in [(0.0, 1, 0), (0.1, 4, 0), (1.0, 9, 0), (3.0, 27, 2), (9.0, 27, 1), (40.0, 8, 0)] {
        let low = random.uniform(-6.0, 2.0);
        let mut values: Vec<[f64; 2]> =
            (0..count).map(|_| [0, 1].map(|_| 10f64.powf(random.uniform(low, low + decades)))).collect();
        values.iter_mut().take(zeros).for_each(|value| value[1] = 0.0);
        let points = planted(&values);
        let drawing = scatter(&chart(points.clone()));
        let read = read(drawing.svg());
        let [below, left] = axes(&read);
        for labels in [&below, &left] {
            assert!(labels.len() >= 2 && labels.iter().any(|(_, value)| value.log10().fract() == 0.0), "{labels:?}");
        }
        for point in &points {
            let name = format!("{}: ", point.label);
            let (_, [x, y]) = read.markers.iter().find(|marker| marker.0.starts_with(&name)).unwrap();
            // A tenth of a pixel of rounding on either side.
            let (near, far) = (value_at(x - 0.3, &below), value_at(x + 0.3, &below));
            assert!(near <= point.x && point.x <= far, "{point:?}: {near} to {far}");
            if point.y == 0.0 {
                let zero = read.words.iter().find(|word| word.at[0] == 82.0 && word.text == "0").unwrap();
                assert!((zero.at[1] - 0.35 * 13.0 - y).abs() < 0.3 && *y < 614.0, "{y}");
                assert!(left.iter().all(|(place, _)| place < y), "0 is not the lowest: {left:?}");
            } else {
                let (low, high) = (value_at(y + 0.3, &left), value_at(y - 0.3, &left));
                assert!(low <= point.y && point.y <= high, "{point:?}: {low} to {high}");
            }
            // The front's line goes through its points and past no other's better side.
            let on_line = read.front.iter().any(|p| (p[0] - x).abs() < 0.3 && (p[1] - y).abs() < 0.3);
            assert_eq!(on_line, point.front, "{point:?}");
        }
        assert!(read.words.iter().any(|word| word.text == "0") == (zeros > 0));
        for pair in read.front.windows(2) {
            assert!(pair[1][0] >= pair[0][0] && pair[1][1] >= pair[0][1], "the staircase goes back: {:?}", read.front);
        }
    }
}

#[test]
fn names_cover_nothing_and_stay_inside() {
    let mut random = Random::new(12);
    for round in 0..60 {
        // The later the round the denser.
        let spread = 3.0 / f64::from(1 + round % 12);
        // Two thirds along a falling line, so that most are on the front; and ties.
        let mut values: Vec<[f64; 2]> = (0..27)
            .map(|i| {
                let t = random.uniform(0.0, spread);
                let off = if i % 3 == 0 { random.uniform(0.0, 1.0) } else { 0.0 };
                [10f64.powf(t + off), 10f64.powf(-t + off)]
            })
            .collect();
        values[5] = values[4];
        values[6][1] = 0.0;
        let points = planted(&values);
        let named = points.iter().filter(|point| point.front).count();
        let read = read(scatter(&chart(points)).svg());
        let names: Vec<&Word> = read.words.iter().filter(|word| word.text.starts_with("name ")).collect();
        assert_eq!(names.len(), named, "round {round}");
        for (i, word) in read.words.iter().enumerate() {
            let [l, t, r, b] = word.area;
            assert!(l >= 0.0 && t >= 0.0 && r <= 1000.0 && b <= 680.0, "{word:?} leaves the sheet");
            for other in &read.words[..i] {
                let [ol, ot, or, ob] = other.area;
                assert!(r <= ol || or <= l || b <= ot || ob <= t, "{word:?} covers {other:?}");
            }
        }
        for word in names {
            let [l, t, r, b] = word.area;
            assert!(l >= 92.0 && t >= 74.0 && r <= 792.0 && b <= 614.0, "{word:?} leaves the frame");
            for (name, [x, y]) in &read.markers {
                let inside = *x > l - 4.0 && *x < r + 4.0 && *y > t - 4.0 && *y < b + 4.0;
                assert!(!inside, "round {round}: {word:?} covers {name}");
            }
        }
    }
}

#[test]
fn odd_drawings_are_drawings() {
    let odd = [
        vec![],
        planted(&[[1.0, 0.0]]),
        planted(&[[1.0, 1.0], [1.0, 1.0]]),
        planted(&[[1e-300, 1e300], [1e300, 1e-300]]),
        planted(&[[INF, 1.0], [1.0, INF], [f64::NAN, 1.0], [0.0, 1.0], [-1.0, 1.0], [2.0, f64::NAN]]),
    ];
    for points in odd {
        let drawn = points.iter().filter(|p| p.x.is_finite() && p.x > 0.0 && p.y.is_finite()).count();
        let drawing = scatter(&chart(points.clone()));
        assert!(!drawing.svg().contains("NaN") && !drawing.svg().contains("inf"), "{points:?}");
        let read = read(drawing.svg());
        assert_eq!(read.markers.iter().filter(|marker| marker.0.starts_with("name ")).count(), drawn);
        assert_eq!(read.words.iter().any(|word| word.text == "no point to draw"), drawn == 0);
        let png = drawing.png().unwrap();
        assert_eq!(&png[16..24], &[0, 0, 3, 0xe8, 0, 0, 2, 0xa8], "1000 x 680");
        assert_eq!(drawing, scatter(&chart(points)));
    }
    // Every kind has a marker of its own.
    let points: Vec<Point> = (0..stereomist::study::plot::scatter::STYLES)
        .map(|kind| Point { kind, x: 1.0, y: 1.0, label: format!("{kind}"), front: false })
        .collect();
    let svg = scatter(&chart(points)).svg().to_owned();
    let markers: BTreeSet<&str> =
        svg.lines().filter(|line| line.contains(": 1, 1<")).map(|line| line.split("<title>").next().unwrap()).collect();
    assert_eq!(markers.len(), stereomist::study::plot::scatter::STYLES);
}

fn rows() -> Vec<Row> {
    let mut random = Random::new(21);
    let mut value = |large: f64| random.uniform(0.0, large) * 10f64.powf(random.uniform(-12.0, 0.0));
    CANDIDATES
        .iter()
        .enumerate()
        .map(|(i, candidate)| Row {
            key: format!("{i:016x}"),
            method: candidate.method.into(),
            parameter: candidate.parameter.into(),
            value: candidate.value.into(),
            tolerance: candidate.tolerance,
            drawn: "viewplane".into(),
            frames: 5 + i as u32,
            median_ms: value(1e3),
            min_ms: value(1e3),
            spread_ms: value(1.0),
            fragments: u64::MAX - i as u64,
            rmse: if i == 3 { 0.0 } else { value(1.0) },
            rmse_se: value(1.0),
            max: if i == 4 { INF } else { value(1.0) },
            q99: value(1.0),
            transmittance_max: value(1.0),
            inconsistency_rmse: (i % 2 == 0).then(|| value(1.0)),
            inconsistency_max: (i % 2 == 0).then(|| value(1.0)),
            stages: vec![("plan".into(), value(1.0)), ("raster".into(), value(1e2))],
        })
        .collect()
}

#[test]
fn the_table_reads_back_whole_and_in_part() {
    let rows = rows();
    let text = table::to_csv(&rows);
    assert_eq!(table::from_csv(&text).unwrap(), rows);
    let on_front = table::on_front(&rows);
    assert!(on_front.contains(&true) && on_front.contains(&false));
    let column = table::HEADER.split(',').position(|name| name == "front").unwrap();
    for (line, front) in text.lines().skip(1).zip(on_front) {
        assert_eq!(line.split(',').nth(column), Some(if front { "yes" } else { "no" }));
        assert_eq!(line.split(',').count(), table::HEADER.split(',').count());
    }
    // Cut anywhere, it holds the rows before the cut, none of them changed.
    for end in 0..text.len() {
        let ends = text[..end].matches('\n').count();
        let expected = ends.checked_sub(1).map(|whole| rows[..whole].to_vec());
        assert_eq!(table::from_csv(&text[..end]), expected, "cut at {end}");
    }
    // What is no row is no row.
    let line = text.lines().nth(1).unwrap();
    for wrong in [
        line.replace(",no,", ",maybe,").replace(",yes,", ",maybe,"),
        format!("{line},1"),
        line.replacen(',', ",,", 1),
        "x".into(),
    ] {
        assert_eq!(table::from_csv(&format!("{}\n{wrong}\n{line}\n", table::HEADER)).unwrap(), rows[..1], "{wrong}");
    }
    assert_eq!(table::from_csv("x,y,z\n1,2,3\n"), None);
}

#[test]
fn a_sample_is_every_pixel_or_one_of_each_cell() {
    for (size, most) in [
        ([24, 18], 432),
        ([24, 18], 431),
        ([24, 18], 100),
        ([24, 18], 1),
        ([1, 500], 40),
        ([500, 1], 40),
        ([640, 480], 20_000),
    ] {
        let sample = Sample::new(size, most);
        let all = u64::from(size[0]) * u64::from(size[1]);
        assert_eq!((sample.all(), sample.is_whole()), (all, all <= most as u64), "{size:?} {most}");
        assert!(sample.pixels.len() <= most && 2 * sample.pixels.len() > most.min(all as usize), "{size:?} {most}");
        assert!(sample.pixels.windows(2).all(|pair| pair[0] < pair[1]), "not ascending");
        assert!(sample.pixels.iter().all(|&pixel| u64::from(pixel) < all));
        assert_eq!(sample.weights.iter().sum::<f64>(), all as f64, "{size:?} {most}");
        assert_eq!(sample, Sample::new(size, most));
    }
    // Spread over the picture: as many in each quarter, but for cells that a border cuts.
    let sample = Sample::new([640, 480], 20_000);
    for quarter in 0..4 {
        let inside =
            |pixel: &&u32| (**pixel % 640 >= 320, **pixel / 640 >= 240) == (quarter % 2 == 1, quarter / 2 == 1);
        let count = sample.pixels.iter().filter(inside).count();
        assert!((4800..5200).contains(&count), "{count}");
    }
}

/// Gas of many colours before two eyes.
fn gas(size: [u32; 2]) -> Scene {
    let gas = Gas { count: 30, low: [-1.0; 3], high: [1.0; 3], radius: [0.3, 0.6], opacity: [0.2, 0.9], bright: 1.0 };
    Scene {
        camera: Camera {
            position: DVec3::new(0.0, 0.5, 4.0),
            look_at: DVec3::ZERO,
            up: DVec3::Y,
            fov_y: 0.7,
            size,
            near: 0.01,
            samples: 1,
        },
        stereo: Some(Stereo { interocular: 0.3, convergence: Some(4.0), mode: StereoMode::Parallel }),
        background: [0.1, 0.2, 0.4],
        particles: vec![gas.draw(&mut Random::new(4), Kernel::Gaussian)],
        meshes: Vec::new(),
    }
}

#[test]
fn the_truth_is_the_reference_and_its_file_keeps_it() {
    let scene = gas([24, 18]);
    let settings = Settings {
        method: Method::Reference(reference::Parameters { disparity: true }),
        threads: Some(1),
        ..Settings::default()
    };
    let films = draw(&scene, &settings, &()).unwrap().films;
    for most in [10_000, 60] {
        let sample = Sample::new([24, 18], most);
        let truth = Truth::new(&scene, &sample, &());
        for (view, film) in films.iter().enumerate() {
            for &pixel in &sample.pixels {
                let ray = truth.ray(view, pixel).unwrap();
                for channel in 0..3 {
                    let film = f64::from(film.color[channel][pixel as usize]);
                    assert!((film - ray.color[channel]).abs() < 1e-6, "{view} {pixel} {channel}");
                }
                assert!((f64::from(film.transmittance[pixel as usize]) - ray.transmittance).abs() < 1e-6);
            }
        }
        let kept = films[1].disparity.as_ref().unwrap();
        for (&pixel, d) in sample.pixels.iter().zip(truth.disparity().unwrap()) {
            let film = kept.x[pixel as usize];
            assert!((f64::from(film) - d).abs() < 1e-5 || film.is_nan() && d.is_nan(), "{pixel}: {film} {d}");
        }
        assert!(truth.error() > 0.0 && truth.error() < 1e-8);
        // The file gives back every digit, for this sample alone, and nothing if anything of it is missing.
        let text = truth.to_csv();
        let again = Truth::from_csv(&text, &sample, 2).unwrap();
        assert_eq!(again.to_csv(), text);
        assert_eq!(Truth::from_csv(&text, &Sample::new([24, 18], 50), 2), None);
        assert_eq!(Truth::from_csv(&text, &sample, 1), None);
        let lines: Vec<&str> = text.lines().collect();
        for gone in [0, 1, lines.len() / 2, lines.len() - 1] {
            let less: Vec<&str> = lines.iter().enumerate().filter(|(i, _)| *i != gone).map(|(_, line)| *line).collect();
            assert_eq!(Truth::from_csv(&(less.join("\n") + "\n"), &sample, 2), None, "without line {gone}");
        }
        assert_eq!(Truth::from_csv(&text[..text.len() - 1], &sample, 2), None);
    }
    // One view has neither disparity nor inconsistency.
    let mono = Scene { stereo: None, ..scene };
    let sample = Sample::new([24, 18], 10_000);
    let truth = Truth::new(&mono, &sample, &());
    assert_eq!(truth.disparity(), None);
    let films = draw(&mono, &Settings { threads: Some(1), ..Settings::default() }, &()).unwrap().films;
    assert_eq!(Errors::new(&films, &truth, &sample).inconsistency, None);
    assert_eq!(Truth::from_csv(&truth.to_csv(), &sample, 1).unwrap(), truth);
}

#[test]
fn errors_are_those_of_whole_pictures() {
    let scene = gas([40, 30]);
    let with = |method| Settings { method, threads: Some(1), ..Settings::default() };
    let truths = draw(&scene, &with(Method::Reference(reference::Parameters { disparity: true })), &()).unwrap().films;
    let films = draw(&scene, &with(Method::Viewplane), &()).unwrap().films;
    let sample = Sample::new([40, 30], 1200);
    let truth = Truth::new(&scene, &sample, &());
    let errors = Errors::new(&films, &truth, &sample);

    let (mut squares, mut max, mut transmittance, mut each) = (0.0, 0.0_f64, 0.0_f64, Vec::new());
    for (film, truth) in films.iter().zip(&truths) {
        for pixel in 0..1200 {
            let off = [0, 1, 2].map(|c| f64::from((film.color[c][pixel] - truth.color[c][pixel]).abs()));
            squares += off.iter().map(|off| off * off).sum::<f64>();
            each.push(off.into_iter().fold(0.0, f64::max));
            transmittance =
                transmittance.max(f64::from((film.transmittance[pixel] - truth.transmittance[pixel]).abs()));
        }
    }
    each.sort_by(f64::total_cmp);
    max = each.iter().fold(max, |a, &b| a.max(b));
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} {b}");
    close(errors.rmse, (squares / 7200.0_f64).sqrt());
    close(errors.max, max);
    close(errors.q99, each[2375]);
    close(errors.transmittance_max, transmittance);
    assert!(errors.rmse > 1e-3 && errors.q99 < errors.max && errors.rmse_se == 0.0, "{errors:?}");
    let pictures = |films: &[Film]| films.iter().cloned().map(Picture::from_film).collect::<Vec<_>>();
    let (films_of, truths_of) = (pictures(&films), pictures(&truths));
    let pair = |eye: usize| [&films_of[eye], &truths_of[eye]];
    let whole = inconsistency::inconsistency(pair(0), pair(1)).unwrap().unwrap();
    let ours = errors.inconsistency.unwrap();
    close(ours.rmse, whole.rmse_of_all());
    close(ours.max, whole.max_of_all());
    assert!(ours.rmse > 1e-4);

    // A part of the pixels is near, by its own account, and no exact picture has an error.
    let mut near = 0;
    for most in [60, 150, 300, 600] {
        let sample = Sample::new([40, 30], most);
        let part = Errors::new(&films, &Truth::new(&scene, &sample, &()), &sample);
        assert!(part.rmse_se > 0.0 && part.max <= errors.max && part.rmse_se < part.rmse);
        assert!((part.rmse - errors.rmse).abs() < 4.0 * part.rmse_se, "{most}: {part:?} {errors:?}");
        near += usize::from((part.rmse - errors.rmse).abs() < 2.0 * part.rmse_se);
    }
    assert!(near >= 3, "{near} of 4 within two standard errors");
    let exact = Errors::new(&truths, &truth, &sample);
    assert!(exact.max < 1e-6 && exact.rmse < 1e-6);
    let mut broken = films;
    broken[1].color[2][700] = f32::NAN;
    let broken = Errors::new(&broken, &truth, &sample);
    assert_eq!((broken.rmse, broken.max, broken.inconsistency.unwrap().max), (INF, INF, INF));
    assert!(broken.q99.is_finite());
}

#[test]
fn enlarged_pictures_lie_where_the_full_ones_do() {
    for size in [[24, 18], [25, 17], [7, 3], [64, 64], [1, 1]] {
        for n in [2, 4, 8] {
            let full = gas(size);
            let mut small = full.clone();
            small.camera = enlarge::smaller(&full.camera, n);
            assert_eq!(small.camera.size, size.map(|length| length.div_ceil(n)));
            let margin = [0, 1].map(|axis| 0.5 * f64::from(n * small.camera.size[axis] - size[axis]));
            for (view, low) in full.views().iter().zip(small.views()) {
                for [x, y] in [[0.0, 0.0], [1.5, 0.5], [f64::from(size[0]), f64::from(size[1])]] {
                    let [u, v] = [(x + margin[0]) / f64::from(n), (y + margin[1]) / f64::from(n)];
                    assert!((view.direction(x, y) - low.direction(u, v)).length() < 1e-12, "{size:?} {n}");
                }
                // A picture that is linear across stays so between the outermost centres; beyond them it goes on as there.
                let mut film = Film::new(small.camera.size);
                let width = film.size[0] as usize;
                for i in 0..film.transmittance.len() {
                    let at = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
                    let [u, v] = [0, 1].map(|axis| f64::from(n) * at[axis] - margin[axis]);
                    (film.color[0][i], film.color[1][i], film.color[2][i]) = (u as f32, v as f32, 0.25);
                    film.transmittance[i] = (u + 2.0 * v) as f32;
                }
                let mut out = Film::new(size);
                enlarge::enlarge(&film, n, &mut out);
                for i in 0..out.transmittance.len() {
                    let at = [i % size[0] as usize, i / size[0] as usize].map(|k| k as f64 + 0.5);
                    let expected = [0, 1].map(|axis| {
                        let centre = |k: u32| f64::from(n) * (f64::from(k) + 0.5) - margin[axis];
                        at[axis].clamp(centre(0), centre(film.size[axis] - 1))
                    });
                    for (plane, value) in [
                        (&out.color[0], expected[0]),
                        (&out.color[1], expected[1]),
                        (&out.color[2], 0.25),
                        (&out.transmittance, expected[0] + 2.0 * expected[1]),
                    ] {
                        assert!((f64::from(plane[i]) - value).abs() < 1e-4, "{size:?} {n} {i}: {} {value}", plane[i]);
                    }
                }
            }
        }
    }
}

#[test]
fn frames_are_timed_by_the_median_and_the_camera_comes_back() {
    let mut scene = gas([8, 6]);
    let before = scene.camera.clone();
    let mut places = Vec::new();
    let times = [900, 800, 5, 1, 4, 2, 3, 7];
    let frames = timing::frames(
        &mut scene,
        2,
        |frames, spent| frames >= 3 && spent >= Duration::from_millis(15),
        |scene| {
            let total = Duration::from_millis(times[places.len()]);
            places.push(scene.camera.position);
            let stages = vec![("one", total / 2), ("two", total)];
            Ok(Statistics { stages, total, fragments: places.len() as u64, prepared: 0, ..Statistics::default() })
        },
    )
    .unwrap();
    let timing = Timing::new(&frames);
    let ms = Duration::from_millis;
    // 5, 1, 4, 2 and 3 ms; the two before them only warm up.
    assert_eq!((timing.frames, timing.median, timing.min, timing.spread), (5, ms(3), ms(1), ms(2)));
    assert_eq!(timing.stages, [("one", ms(3) / 2), ("two", ms(3))]);
    assert_eq!((timing.fragments, places.len()), (7, 7));
    for (i, place) in places.iter().enumerate() {
        assert!(((*place - before.position).length() - timing::STEP * (i + 1) as f64).abs() < 1e-12);
    }
    assert_eq!(scene.camera, before);
    // Short frames warm up until they took long enough, if any are to warm up.
    for (warmup, drawn) in [(0, 3), (1, 6), (5, 8)] {
        let mut count = 0;
        let frame = |_: &mut Scene| {
            count += 1;
            Ok(Statistics { total: timing::SETTLE / 3 + Duration::from_micros(1), ..Statistics::default() })
        };
        assert_eq!(timing::frames(&mut scene, warmup, |frames, _| frames == 3, frame).unwrap().len(), 3);
        assert_eq!(count, drawn, "{warmup}");
    }
    let failed = timing::frames(&mut scene, 0, |_, _| true, |_| Err(Error::Usage("no".into())));
    assert!(failed.is_err() && scene.camera == before);
}

#[test]
fn candidates_have_names_and_keys_of_their_own() {
    let settings = Settings { threads: Some(1), ..Settings::default() };
    let subject = |scene: Scene, settings: &Settings, pixels| Subject::new(scene, settings, pixels).unwrap();
    let keys = |subject: &Subject| CANDIDATES.iter().map(|candidate| subject.key(candidate)).collect::<BTreeSet<_>>();
    let labels: BTreeSet<String> = CANDIDATES.iter().map(Candidate::label).collect();
    assert_eq!(labels.len(), CANDIDATES.len());
    let base = subject(gas([24, 18]), &settings, 1000);
    let all = keys(&base);
    assert_eq!(all.len(), CANDIDATES.len());
    assert_eq!(all, keys(&subject(gas([24, 18]), &settings, 1000)));
    // Whatever a measure depends on is in its key.
    let mut moved = gas([24, 18]);
    moved.particles[0].x[7] += 1e-12;
    let mut colored = gas([24, 18]);
    colored.background[2] += 1e-6;
    for (what, other) in [
        ("a particle", subject(moved, &settings, 1000)),
        ("the background", subject(colored, &settings, 1000)),
        ("the size", subject(gas([24, 19]), &settings, 1000)),
        ("the sample", subject(gas([24, 18]), &settings, 100)),
        ("the threads", subject(gas([24, 18]), &Settings { threads: Some(2), ..settings.clone() }, 1000)),
    ] {
        assert!(all.is_disjoint(&keys(&other)), "{what} counts for nothing");
        assert_eq!(other.truth_key() == base.truth_key(), what == "the threads", "{what}");
    }
    // The scene's own method, tolerance and supersampling count for nothing.
    let mut fine = gas([24, 18]);
    fine.camera.samples = 3;
    let other = Settings { method: Method::Viewpoint, tolerance: 0.5, ..settings.clone() };
    assert_eq!(all, keys(&subject(fine, &other, 1000)));
}

#[test]
fn every_candidate_is_measured() {
    let settings = Settings { threads: Some(1), ..Settings::default() };
    let mut subject = Subject::new(gas([24, 18]), &settings, 1000).unwrap();
    let truth = subject.truth(&()).unwrap();
    let rows: Vec<Row> =
        CANDIDATES.iter().map(|candidate| subject.measure(candidate, &truth, Duration::ZERO).unwrap()).collect();
    let row = |label: &str| rows.iter().find(|row| format!("{} {}", row.method, row.value) == label).unwrap();
    for row in &rows {
        assert!(row.frames == 5 && row.median_ms > 0.0 && row.min_ms <= row.median_ms, "{row:?}");
        assert!(row.rmse > 0.0 && row.rmse <= row.max && row.q99 <= row.max && row.max < 1.0, "{row:?}");
        assert!(row.inconsistency_rmse.is_some() && row.stages.iter().any(|stage| stage.0 == "plan"), "{row:?}");
    }
    assert!(row("slab 64").rmse < row("slab 4").rmse && row("slab 4").rmse < row("slab 1").rmse);
    assert!(row("sheet 0.25").rmse < row("sheet 1").rmse);
    assert!(row("perspective 1/255").rmse < row("half 1/2").rmse && row("half 1/2").rmse < row("eighth 1/8").rmse);
    assert!(row("half 1/2").stages.iter().any(|stage| stage.0 == "enlarge"));
    assert!(row("slab 16").fragments > row("viewplane 0").fragments);
    // The same errors again, whatever the time.
    let again = subject.measure(&CANDIDATES[0], &truth, Duration::ZERO).unwrap();
    assert_eq!((again.rmse, again.max, &again.key), (rows[0].rmse, rows[0].max, &rows[0].key));
}
