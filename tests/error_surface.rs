//! Projection and parallax errors: the closed forms against the definitions, their symmetries and limits, and the forms
//! as printed.

use glam::{DVec3, Vec3};
use stereomist::study::error_surface::solve::{Demand, solve};
use stereomist::study::error_surface::unit::Frame;
use stereomist::study::error_surface::{Alignment, Component, Point, Quantity, Setting, closed, numeric, printed};

const COMPONENTS: [Component; 2] = [Component::X, Component::Y];

fn setting(quantity: Quantity, component: Component, point: Point, radius: f64) -> Setting {
    Setting { quantity, component, point, radius, ..Setting::default() }
}

const PAIRS: [[Alignment; 2]; 4] = [
    [Alignment::Viewplane, Alignment::Viewpoint],
    [Alignment::Viewplane, Alignment::Perspective],
    [Alignment::Viewpoint, Alignment::Perspective],
    [Alignment::Perspective, Alignment::Viewplane],
];

/// Numbers in [0, 1) that look random.
fn random() -> impl FnMut() -> f64 {
    let mut state = 99u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// 10,000 billboards in front of the eye, of all sizes and directions, not close to a pole.
fn cases() -> Vec<(Setting, DVec3)> {
    let mut next = random();
    let mut cases = Vec::new();
    while cases.len() < 10_000 {
        let d = 10f64.powf(4.0 * next() - 2.0);
        let c = DVec3::new((4.0 * next() - 2.0) * d, (4.0 * next() - 2.0) * d, -d);
        let point = Point { a: 2.0 * next() - 1.0, b: 2.0 * next() - 1.0 };
        let radius = 0.8 * next() * d + 1e-3 * d;
        let quantity = if next() < 0.5 { Quantity::Projection } else { Quantity::Parallax };
        let component = if next() < 0.5 { Component::X } else { Component::Y };
        let interocular = 0.5 * next() * d;
        let alignments = PAIRS[(next() * PAIRS.len() as f64) as usize];
        let setting = Setting { quantity, component, alignments, point, radius, near: 0.1 + next(), interocular };
        // The depth of the point that `perspective` shows, which is nearer than that of the viewpoint billboard's, for
        // either eye.
        let depth = |x: f64| {
            let (s, length) = (x.hypot(d), DVec3::new(x, c.y, d).length());
            let sine = radius * point.a.hypot(point.b) / length;
            let stretch = if sine < 0.95 { 1.0 / (1.0 - sine * sine).sqrt() } else { f64::INFINITY };
            d - stretch * radius * (point.a * x / s + point.b * c.y * d / (s * length)).max(0.0)
        };
        if [c.x - 0.5 * interocular, c.x, c.x + 0.5 * interocular].iter().all(|&x| depth(x) > 0.05 * d) {
            cases.push((setting, c));
        }
    }
    cases
}

/// How far numeric f64 may be off: rounding of projected points, which are at most so far out.
fn rounding(setting: &Setting, c: DVec3) -> f64 {
    let out = setting.near * (c.length() + setting.interocular + 2.0 * setting.radius) / (0.05 * -c.z);
    16.0 * f64::EPSILON * out
}

#[test]
fn the_closed_forms_follow_from_the_definitions() {
    let mut differing = 0;
    for (setting, c) in cases() {
        let (exact, found) = (numeric::error(&setting, c).unwrap(), closed::error(&setting, c).unwrap());
        let allowed = 1e-12 * exact.abs() + rounding(&setting, c);
        assert!((exact - found).abs() <= allowed, "{setting:?} {c}: {exact} {found}, allowed {allowed}");
        differing += usize::from(exact.abs() > 1e6 * rounding(&setting, c));
    }
    // Most errors are a million times what rounding can do, so that the comparison means something.
    assert!(differing > 8000, "{differing}");
}

#[test]
fn the_check_value_of_both_forms() {
    let c = DVec3::new(0.7, 0.3, -2.0);
    let value = |form: fn(&Setting, DVec3) -> Option<f64>, component| {
        form(&setting(Quantity::Projection, component, Point::RIGHT_EDGE, 0.4), c).unwrap()
    };
    for form in [numeric::error, closed::error] {
        assert!((value(form, Component::X) - -0.026_886_619_2).abs() < 5e-11);
        assert!((value(form, Component::Y) - -0.010_611_623_6).abs() < 5e-11);
    }
    assert!((value(printed::error, Component::X) - 0.044_618_900_9).abs() < 5e-11);
    assert!((value(printed::error, Component::Y) - 0.019_698_517_3).abs() < 5e-11);
}

#[test]
fn single_precision_says_nearly_the_same() {
    for (mut setting, c) in cases() {
        setting.quantity = Quantity::Projection;
        let single = Vec3::new(c.x as f32, c.y as f32, c.z as f32);
        // What both are asked is the rounded question.
        setting.radius = f64::from(setting.radius as f32);
        setting.near = f64::from(setting.near as f32);
        let point = Point { a: f64::from(setting.point.a as f32), b: f64::from(setting.point.b as f32) };
        setting.point = point;
        let exact = closed::error(&setting, single.as_dvec3()).unwrap();
        let scale = rounding(&setting, c) / f64::EPSILON * f64::from(f32::EPSILON);
        let numeric = f64::from(numeric::error_f32(&setting, single).unwrap());
        assert!((numeric - exact).abs() < scale, "{setting:?} {c}: {exact} {numeric}");
        // The closed form has no such term: it is off by a part of the error, or of its largest summand.
        let closed = f64::from(closed::error_f32(&setting, single).unwrap());
        let summand = setting.near * setting.radius * (c.length() + 5.0 * setting.radius) / (c.z * 0.05 * c.z);
        assert!((closed - exact).abs() < 1e-5 * summand.abs(), "{setting:?} {c}: {exact} {closed}");
    }
}

#[test]
fn symmetries() {
    for (mut setting, c) in cases() {
        setting.quantity = Quantity::Projection;
        setting.alignments = PAIRS[0];
        let error = |point, component, c| closed::error(&Setting { point, component, ..setting }, c);
        let close = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() <= 1e-13 * a.abs().max(b.abs()),
            (a, b) => a == b,
        };
        let mirrored = DVec3::new(-c.x, c.y, c.z);
        let right = error(Point::RIGHT_EDGE, Component::X, mirrored);
        let left = error(Point::LEFT_EDGE, Component::X, c).map(|e| -e);
        assert!(close(right, left), "{c}: {right:?} {left:?}");
        let below = DVec3::new(c.x, -c.y, c.z);
        let y = |c| error(Point::RIGHT_EDGE, Component::Y, c);
        assert!(close(y(below), y(c).map(|e| -e)), "e_y is odd in C_y");
        let x = |c| error(Point::RIGHT_EDGE, Component::X, c);
        assert!(close(x(below), x(c)) && close(x(DVec3::new(c.x, 0.0, c.z)), x(c)), "e_x does not depend on C_y");
    }
}

#[test]
fn the_parallax_error_becomes_a_derivative() {
    for (setting, c) in cases().into_iter().take(1000) {
        for component in COMPONENTS {
            let at = |interocular: f64| {
                let quantity = Quantity::Parallax;
                closed::error(&Setting { quantity, component, interocular, ..setting }, c).map(|e| e / interocular)
            };
            let Some(limit) = at(1e-200) else { continue };
            // A central difference of the projection error.
            let h = 1e-4 * -c.z;
            let e = |x: f64| {
                let setting = Setting { quantity: Quantity::Projection, component, ..setting };
                closed::error(&setting, DVec3::new(x, c.y, c.z))
            };
            let (Some(before), Some(after)) = (e(c.x - h), e(c.x + h)) else { continue };
            let difference = -(after - before) / (2.0 * h);
            let scale = setting.near * setting.radius / (c.z * c.z) * (1.0 + setting.radius / -c.z);
            assert!((limit - difference).abs() < 1e-2 * scale + 1e-4 * limit.abs(), "{setting:?} {c}");
            // And nothing is lost on the way: from a millionth of d to 1e-200 the quotient changes by order I^2 alone.
            let near = at(1e-6 * -c.z).unwrap();
            assert!((near - limit).abs() <= 1e-9 * (limit.abs() + scale), "{setting:?} {c}: {near} {limit}");
        }
    }
}

#[test]
fn far_away_the_errors_vanish_as_predicted() {
    // Along a ray (x, y, -1) d: e_x -> -N r a (x^2/(sigma + 1)) / d with sigma = sqrt(x^2 + 1), first order in 1/d.
    let (x, y) = (0.6, 0.4);
    let sigma = f64::hypot(x, 1.0);
    for (component, limit) in [(Component::X, x * x / (sigma + 1.0)), (Component::Y, x * y / sigma)] {
        let setting = setting(Quantity::Projection, component, Point::RIGHT_EDGE, 0.5);
        let mut last = f64::INFINITY;
        for d in [1e2, 1e3, 1e4, 1e5, 1e6] {
            let e = closed::error(&setting, d * DVec3::new(x, y, -1.0)).unwrap();
            let off = (e * d / (-0.5 * limit) - 1.0).abs();
            assert!(off < 3.0 / d && off < last, "{component:?} {d}: {off}");
            last = off;
        }
    }
}

#[test]
fn behind_a_pole_there_is_no_error() {
    let setting = setting(Quantity::Projection, Component::X, Point::RIGHT_EDGE, 0.5);
    for form in [numeric::error, closed::error, printed::error] {
        assert_eq!(form(&setting, DVec3::new(0.3, 0.2, 0.0)), None);
        assert_eq!(form(&setting, DVec3::new(0.3, 0.2, 1.0)), None);
    }
    // d s = r C_x: the right edge of the viewpoint billboard is beside the eye.
    let c = DVec3::new(2.0, 0.0, -0.4);
    assert!(0.4 * c.x.hypot(c.z) < 0.5 * c.x);
    assert_eq!((numeric::error(&setting, c), closed::error(&setting, c)), (None, None));
    assert!(printed::error(&setting, c).is_some());
    assert_eq!(printed::error(&setting, DVec3::new(-2.0, 0.0, -0.4)), None);
}

/// A row of the stability table: a question in numbers of single precision, and its 50-digit answer.
struct Row {
    /// What is hard about it.
    case: String,
    name: String,
    setting: Setting,
    c: DVec3,
    /// By definition; none where a point is not in front of an eye.
    exact: Option<f64>,
    condition: f64,
    /// The printed formula, which has its own poles.
    printed: Option<f64>,
}

/// `tests/data/error_surface/stability.csv`, which the script beside it makes.
fn stability() -> Vec<Row> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/error_surface/stability.csv");
    let mut reader = csv::Reader::from_path(path).unwrap();
    let columns: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let place = |name: &str| columns.iter().position(|column| column == name).unwrap();
    reader
        .records()
        .map(|record| {
            let record = record.unwrap();
            let text = |name| record.get(place(name)).unwrap();
            let number = |name| text(name).parse::<f64>().unwrap();
            let maybe = |name| Some(text(name)).filter(|text| !text.is_empty()).map(|text| text.parse().unwrap());
            let alignment = |name| *Alignment::ALL.iter().find(|alignment| alignment.name() == text(name)).unwrap();
            let setting = Setting {
                quantity: *Quantity::ALL.iter().find(|quantity| quantity.name() == text("of")).unwrap(),
                component: *COMPONENTS.iter().find(|component| component.name() == text("component")).unwrap(),
                alignments: [alignment("first"), alignment("second")],
                point: Point { a: number("a"), b: number("b") },
                radius: number("radius"),
                near: number("near"),
                interocular: number("interocular"),
            };
            Row {
                case: text("case").to_string(),
                name: text("name").to_string(),
                setting,
                c: DVec3::new(number("cx"), number("cy"), number("cz")),
                exact: maybe("exact"),
                condition: maybe("condition").unwrap_or(f64::INFINITY),
                printed: maybe("printed"),
            }
        })
        .collect()
}

/// Relative error of a value; that of no value is 1: all is lost.
fn relative(value: Option<f64>, exact: f64) -> f64 {
    match value {
        Some(value) if value == exact => 0.0,
        Some(value) => ((value - exact) / exact).abs(),
        None => 1.0,
    }
}

#[test]
fn the_closed_forms_lose_no_more_than_the_question_does() {
    let rows = stability();
    assert!(rows.len() > 400, "{}", rows.len());
    let mut worst = [0.0_f64; 2];
    for Row { case, name, setting, c, exact, condition, .. } in &rows {
        let single = closed::error_f32(setting, c.as_vec3()).map(f64::from);
        let double = closed::error(setting, *c);
        let Some(exact) = *exact else {
            assert_eq!((double, single), (None, None), "{case}: {name}: there is no such point");
            continue;
        };
        if exact == 0.0 {
            assert_eq!((double, single), (Some(0.0), Some(0.0)), "{case}: {name}");
            continue;
        }
        for (n, (value, unit)) in [(single, 1e-6), (double, 2e-15)].into_iter().enumerate() {
            let error = relative(value, exact) / (unit * condition);
            assert!(
                error <= 1.0,
                "{case}: {name}: {setting:?} {c}: {value:?}, not {exact}: {error} of what is allowed"
            );
            worst[n] = worst[n].max(error);
        }
    }
    // The bound is no empty one: what rounding alone does is a good part of it.
    assert!(worst.iter().all(|&part| part > 0.05), "{worst:?}");
}

#[test]
fn from_the_definitions_single_precision_loses_much() {
    // Where the question itself is well conditioned, the naive form loses a thousandth and far more.
    let mut lost = 0;
    for Row { case, name, setting, c, exact, condition, .. } in &stability() {
        let Some(exact) = exact.filter(|&exact| exact != 0.0 && *condition < 100.0) else { continue };
        let naive = relative(numeric::error_f32(setting, c.as_vec3()).map(f64::from), exact);
        let closed = relative(closed::error_f32(setting, c.as_vec3()).map(f64::from), exact);
        assert!(closed < 1e-4, "{case}: {name}: {closed}");
        lost += usize::from(naive > 1e-3);
    }
    assert!(lost > 50, "{lost}");
}

#[test]
fn numeric_and_printed_agree_with_50_digits_where_nothing_cancels() {
    let mut printed_ones = 0;
    for Row { case, name, setting, c, exact, printed, .. } in &stability() {
        if case == "typical" {
            let (found, exact) = (numeric::error(setting, *c).unwrap(), exact.unwrap());
            assert!((found - exact).abs() < 1e-12 * exact.abs() + 1e-15, "{name}: {found}, not {exact}");
        }
        match printed {
            Some(printed) if case == "typical" => {
                let error = relative(printed::error(setting, *c), *printed);
                assert!(error < 1e-12, "{name}: {error}");
                assert!(relative(Some(*printed), exact.unwrap()) > 0.1, "the printed forms are other formulas");
                printed_ones += 1;
            }
            Some(_) => assert!(printed::error(setting, *c).is_some(), "{case}: {name}"),
            None => assert_eq!(printed::error(setting, *c), None, "{case}: {name}"),
        }
    }
    assert!(printed_ones >= 4, "{printed_ones}");
}

#[test]
fn with_distance_the_errors_vanish_in_the_predicted_order() {
    // Along a ray of one direction in the order of the formula's degree, 1 (projection) and 2 (parallax, at fixed I); beside
    // the axis at fixed C_x and C_y in order 3 for both: e_x -> -N r C_x (C_x/2 + r)/d^3, e_y -> -N r C_x C_y/d^3.
    let (r, x, y) = (0.5, 0.7, 0.4);
    let interocular = 0.065;
    for quantity in [Quantity::Projection, Quantity::Parallax] {
        for component in COMPONENTS {
            let setting = setting(quantity, component, Point::RIGHT_EDGE, r);
            let at = |c| closed::error(&setting, c).unwrap();
            let order = |near: f64, far: f64| (near / far).abs().log2();
            let (direction, d) = (DVec3::new(0.6, 0.4, -1.0), 1e5);
            let along = order(at(d * direction), at(2.0 * d * direction));
            let degree = if quantity == Quantity::Projection { 1.0 } else { 2.0 };
            assert!((along - degree).abs() < 1e-4, "{quantity:?} {component:?}: {along}");
            let beside = |d: f64| at(DVec3::new(x, y, -d));
            assert!((order(beside(d), beside(2.0 * d)) - 3.0).abs() < 1e-4, "{quantity:?} {component:?}");
            let limit = match (quantity, component) {
                (Quantity::Projection, Component::X) => -r * x * (0.5 * x + r),
                (Quantity::Projection, Component::Y) => -r * x * y,
                (Quantity::Parallax, Component::X) => interocular * r * (x + r),
                (Quantity::Parallax, Component::Y) => interocular * r * y,
            };
            assert!((beside(d) * d.powi(3) / limit - 1.0).abs() < 1e-4, "{quantity:?} {component:?}");
        }
    }
}

#[test]
fn the_largest_error_lies_at_a_corner() {
    // The paper's claim, for the whole billboard and both components: at the corner away from the axis.
    let mut elsewhere = 0;
    for (mut setting, c) in cases().into_iter().step_by(10) {
        setting.quantity = Quantity::Projection;
        setting.radius = setting.radius.min(-0.2 * c.z);
        let outer = Point { a: c.x.signum(), b: c.y.signum() };
        let error = |point| closed::error(&Setting { point, ..setting }, c).map(f64::abs);
        let Some(worst) = error(outer) else { continue };
        let steps = (-10..=10).map(|i| f64::from(i) / 10.0);
        let largest = steps
            .clone()
            .flat_map(|a| steps.clone().map(move |b| Point { a, b }))
            .filter_map(error)
            .fold(0.0, f64::max);
        assert!(largest <= worst * (1.0 + 1e-12), "{setting:?} {c}: {largest} > {worst}");
        // E is not the worst point, although the paper's surfaces are those of E.
        elsewhere += usize::from(error(Point::RIGHT_EDGE).is_some_and(|e| e < 0.9 * worst));
    }
    assert!(elsewhere > 500, "{elsewhere}");
}

#[test]
fn the_solved_ratio_is_the_largest_that_a_scan_allows() {
    let pairs = [PAIRS[0], PAIRS[1], PAIRS[2]];
    for (alignments, fov_y) in pairs.into_iter().zip([40.0_f64, 150.0, 60.0]) {
        for component in [None, Some(Component::X), Some(Component::Y)] {
            let frame = Frame { fov_y: fov_y.to_radians(), size: [800, 600] };
            let demand = Demand { alignments, component, frame, tolerance: 1e-3 };
            let solution = solve(&demand);
            // The largest error of any centre in the frame and any of 5 x 5 points, at d = 1.
            let largest = |ratio: f64| {
                let [width, height] = frame.half_extent();
                let mut largest = 0.0_f64;
                for (i, j) in (0..=60).flat_map(|i| (0..=60).map(move |j| (i, j))) {
                    let c = DVec3::new(width * f64::from(i) / 60.0, height * f64::from(j) / 60.0, -1.0);
                    for (a, b) in (-2..=2).flat_map(|a| (-2..=2).map(move |b| (a, b))) {
                        let point = Point { a: 0.5 * f64::from(a), b: 0.5 * f64::from(b) };
                        let e = |component| {
                            let setting = Setting { alignments, component, point, radius: ratio, ..Setting::default() };
                            closed::error(&setting, c).unwrap_or(f64::INFINITY)
                        };
                        let error = match component {
                            Some(component) => e(component).abs(),
                            None => e(Component::X).hypot(e(Component::Y)),
                        };
                        largest = largest.max(error);
                    }
                }
                largest
            };
            assert!(solution.precision < 1e-3, "{solution:?}");
            let at = largest(solution.ratio);
            assert!(at <= 1e-3 * (1.0 + 1e-9) && at > 0.99e-3, "{alignments:?} {component:?} {solution:?}: {at}");
            assert!(largest(solution.ratio * 1.02) > 1e-3, "{alignments:?} {component:?}");
            let worst = DVec3::new(solution.worst[0], solution.worst[1], -1.0);
            assert!(worst.x <= frame.half_extent()[0] && worst.y <= frame.half_extent()[1]);
        }
    }
}

#[test]
fn a_narrow_frame_allows_a_large_ratio() {
    // On the axis the error of viewplane against viewpoint vanishes: what is allowed grows without bound as the field closes.
    let frame = Frame { fov_y: 1f64.to_radians(), size: [1024, 768] };
    let solution = solve(&Demand { alignments: PAIRS[0], component: None, frame, tolerance: 1.0 });
    assert!((solution.ratio / 5.5478 - 1.0).abs() < 1e-4, "{solution:?}");
    let worst = DVec3::new(solution.worst[0], solution.worst[1], -1.0);
    let setting = Setting { point: Point::CORNER, radius: solution.ratio, ..Setting::default() };
    let e = |component| closed::error(&Setting { component, ..setting }, worst).unwrap();
    assert!((e(Component::X).hypot(e(Component::Y)) - 1.0).abs() < 1e-6);
}

#[test]
fn centres_beside_the_frame_show_no_larger_error_in_it() {
    // The inverse question is about centres in the frame. A billboard whose centre is beside it reaches in with the points
    // that face the axis, and those are no worse than the outer corners of billboards inside.
    let frame = Frame { fov_y: 40f64.to_radians(), size: [1024, 768] };
    let demand = Demand { alignments: PAIRS[0], component: None, frame, tolerance: 0.01 };
    let ratio = solve(&demand).ratio;
    let [width, height] = frame.half_extent();
    let mut seen = 0;
    let mut next = random();
    for _ in 0..100_000 {
        let c = DVec3::new((width + ratio) * next(), (height + ratio) * next(), -1.0);
        let point = Point { a: 2.0 * next() - 1.0, b: 2.0 * next() - 1.0 };
        if c.x + ratio * point.a > width || c.y + ratio * point.b > height {
            continue;
        }
        let e = |component| {
            let setting = Setting { component, point, radius: ratio, ..Setting::default() };
            closed::error(&setting, c).unwrap()
        };
        assert!(e(Component::X).hypot(e(Component::Y)) <= 0.01, "{c} {point:?}");
        seen += usize::from(c.x > width || c.y > height);
    }
    assert!(seen > 1000, "{seen}");
}
