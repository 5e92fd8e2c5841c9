//! Contour lines by marching squares, joined to polylines.

use std::collections::BTreeMap;

use super::grid::Grid;

/// A side of a cell where a line may cross: the lower left node of its cell (or its own first node), and which side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    /// To the right of node (i, j).
    Right(usize, usize),
    /// Above it.
    Up(usize, usize),
    /// Across cell (i, j), one corner of which is masked.
    Diagonal(usize, usize),
}

/// The lines where a grid's values cross `level`, linear between nodes: polylines in the units of the axes, a closed one
/// with its first point again at its end. Nodes at the level count as above it. A cell with one masked corner has its lines
/// in the triangle of the other three, one with more masked has none; a cell crossed on all four sides is joined as its
/// mean value asks.
pub fn lines(grid: &Grid, level: f64) -> Vec<Vec<[f64; 2]>> {
    let mut crossings: BTreeMap<Side, [f64; 2]> = BTreeMap::new();
    let mut joined: BTreeMap<Side, Vec<Side>> = BTreeMap::new();
    for j in 0..grid.y.len() - 1 {
        for i in 0..grid.x.len() - 1 {
            let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            // Most cells are wholly on one side.
            let sides_of_level = corners.map(|(i, j)| grid.at(i, j).map(|v| v >= level));
            if sides_of_level.iter().all(|&side| side != Some(true))
                || sides_of_level.iter().all(|&side| side != Some(false))
            {
                continue;
            }
            let sides = [Side::Right(i, j), Side::Up(i + 1, j), Side::Right(i, j + 1), Side::Up(i, j)];
            let known: Vec<usize> = (0..4).filter(|&k| grid.at(corners[k].0, corners[k].1).is_some()).collect();
            if known.len() < 3 {
                continue;
            }
            let mut crossed = Vec::new();
            let mut mean = 0.0;
            for (n, &k) in known.iter().enumerate() {
                let next = known[(n + 1) % known.len()];
                let (from, to) = (corners[k], corners[next]);
                let (Some(a), Some(b)) = (grid.at(from.0, from.1), grid.at(to.0, to.1)) else { continue };
                mean += a / known.len() as f64;
                if (a >= level) != (b >= level) {
                    let side = if next == (k + 1) % 4 { sides[k] } else { Side::Diagonal(i, j) };
                    // The lower end first, so that neighbours find the same point.
                    let (from, to, a, b) = if from <= to { (from, to, a, b) } else { (to, from, b, a) };
                    let t = (level - a) / (b - a);
                    let mix = |axis: &[f64], from: usize, to: usize| axis[from] + t * (axis[to] - axis[from]);
                    crossings.insert(side, [mix(&grid.x, from.0, to.0), mix(&grid.y, from.1, to.1)]);
                    crossed.push(side);
                }
            }
            let mut join = |a: Side, b: Side| {
                joined.entry(a).or_default().push(b);
                joined.entry(b).or_default().push(a);
            };
            match crossed[..] {
                [a, b] => join(a, b),
                // Sides 0 to 3 in turn. Where the mean is on the side of corner 0, that corner joins corner 2 across the
                // middle, and the lines go round corners 1 and 3.
                [a, b, c, d] => {
                    if (grid.at(i, j).is_some_and(|v| v >= level)) == (mean >= level) {
                        join(a, b);
                        join(c, d);
                    } else {
                        join(d, a);
                        join(b, c);
                    }
                }
                _ => {}
            }
        }
    }
    trace(&crossings, joined)
}

/// Open lines first, from their ends, then the closed ones.
fn trace(crossings: &BTreeMap<Side, [f64; 2]>, mut joined: BTreeMap<Side, Vec<Side>>) -> Vec<Vec<[f64; 2]>> {
    let ends: Vec<Side> = joined.iter().filter(|(_, next)| next.len() == 1).map(|(&side, _)| side).collect();
    let all: Vec<Side> = joined.keys().copied().collect();
    let mut lines = Vec::new();
    for start in ends.into_iter().chain(all) {
        let mut side = start;
        let mut line = Vec::new();
        let mut put = |side: Side| {
            let point = crossings.get(&side).copied();
            // Lines through a node cross several sides at one point.
            if let Some(point) = point.filter(|&point| line.last() != Some(&point)) {
                line.push(point);
            }
        };
        put(side);
        while let Some(next) = joined.get_mut(&side).and_then(Vec::pop) {
            if let Some(back) = joined.get_mut(&next)
                && let Some(at) = back.iter().position(|&other| other == side)
            {
                back.swap_remove(at);
            }
            side = next;
            put(side);
        }
        if line.len() > 1 {
            lines.push(line);
        }
    }
    lines
}
