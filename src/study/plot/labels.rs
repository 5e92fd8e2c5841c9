//! Places for names of points, so that none covers another, a point or a line.

/// A rectangle: left, top, right, bottom.
pub type Area = [f64; 4];

/// A name's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// What it covers.
    pub area: Area,
    /// A line from the point to the label, where it stands away from it.
    pub leader: Option<[[f64; 2]; 2]>,
}

/// Distances from the point's middle, pixels.
const DISTANCES: [f64; 14] = [9.0, 12.0, 17.0, 24.0, 33.0, 45.0, 60.0, 80.0, 105.0, 135.0, 170.0, 220.0, 280.0, 350.0];
/// From which of them on a line leads to the label.
const LED: f64 = 15.0;
/// Directions that are tried, from the right upwards first.
const DIRECTIONS: usize = 16;
/// Free space around a label and around a point's middle.
const CLEAR: f64 = 2.0;
const POINT: f64 = 7.0;

/// What a label keeps clear of beside the frame, points and other labels.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Care {
    /// Of leaders (none over another's label) and of the path.
    Path,
    /// Of leaders.
    Leaders,
    /// Of nothing else.
    Labels,
}

/// A place within `frame` for a label of each size (width and height), beside its point: one of `points`, by index, all of
/// which stay uncovered. The nearest place that is free, the first label first; where that can be, none covers a line of
/// `path` or a leader. `None` for a label that finds no place.
pub fn place(labels: &[(usize, [f64; 2])], points: &[[f64; 2]], path: &[[f64; 2]], frame: Area) -> Vec<Option<Label>> {
    let mut placed: Vec<Option<Label>> = Vec::new();
    for &(point, size) in labels {
        let at = points[point];
        let free = |label: &Label, care: Care| {
            let [l, t, r, b] = label.area;
            let inside =
                l >= frame[0] + CLEAR && t >= frame[1] + CLEAR && r <= frame[2] - CLEAR && b <= frame[3] - CLEAR;
            let wide = [l - CLEAR, t - CLEAR, r + CLEAR, b + CLEAR];
            let covers = |p: &[f64; 2]| distance(*p, label.area) < POINT;
            let crosses = |line: &[[f64; 2]; 2], area: Area| meets(*line, area);
            inside
                && !points.iter().any(covers)
                && placed.iter().flatten().all(|other| {
                    !overlap(wide, other.area)
                        && (care == Care::Labels
                            || !other.leader.is_some_and(|line| crosses(&line, wide))
                                && !label.leader.is_some_and(|line| crosses(&line, other.area)))
                })
                && !(care == Care::Path && path.windows(2).any(|pair| crosses(&[pair[0], pair[1]], wide)))
        };
        let candidates = || {
            DISTANCES.into_iter().flat_map(|away| (0..DIRECTIONS).map(move |k| (away, k))).map(|(away, k)| {
                // Up to the right, down to the right, and so on to the left.
                let turn = k.div_ceil(2) as f64 * if k % 2 == 1 { 1.0 } else { -1.0 };
                let angle = (turn / DIRECTIONS as f64 - 0.125) * std::f64::consts::TAU;
                let middle = [0, 1].map(|axis| {
                    let way = [angle.cos(), angle.sin()][axis];
                    at[axis] + way * (away + 0.5 * size[axis])
                });
                let area = [
                    middle[0] - 0.5 * size[0],
                    middle[1] - 0.5 * size[1],
                    middle[0] + 0.5 * size[0],
                    middle[1] + 0.5 * size[1],
                ];
                let edge = [at[0].clamp(area[0], area[2]), at[1].clamp(area[1], area[3])];
                Label { area, leader: (away >= LED).then_some([at, edge]) }
            })
        };
        let best = |care| candidates().find(|label| free(label, care));
        let found = [Care::Path, Care::Leaders, Care::Labels].into_iter().find_map(best);
        placed.push(found);
    }
    placed
}

fn overlap(a: Area, b: Area) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Distance of a point from a rectangle; 0 within it.
fn distance(p: [f64; 2], [l, t, r, b]: Area) -> f64 {
    (p[0] - p[0].clamp(l, r)).hypot(p[1] - p[1].clamp(t, b))
}

/// Whether a line has a point within a rectangle (Liang & Barsky 1984).
fn meets([a, b]: [[f64; 2]; 2], area: Area) -> bool {
    let mut span = [0.0_f64, 1.0_f64];
    for axis in 0..2 {
        let (way, lo, hi) = (b[axis] - a[axis], area[axis] - a[axis], area[axis + 2] - a[axis]);
        if way == 0.0 {
            if lo > 0.0 || hi < 0.0 {
                return false;
            }
            continue;
        }
        let (enter, leave) = if way > 0.0 { (lo / way, hi / way) } else { (hi / way, lo / way) };
        span = [span[0].max(enter), span[1].min(leave)];
    }
    span[0] <= span[1]
}
