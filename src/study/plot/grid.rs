//! A function of two variables between the nodes where it is known.

use super::Surface;

/// Values at the nodes of a grid, some of them masked.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Ascending, at least 2.
    pub x: Vec<f64>,
    /// Ascending, at least 2.
    pub y: Vec<f64>,
    values: Vec<Option<f64>>,
}

/// Magnitudes beyond this are cut to it, so that sums and differences of two stay finite; axes may not pass it.
const LARGEST: f64 = 1e300;
/// Magnitudes below this are zero, so that quotients of two keep their digits.
const LEAST: f64 = 1e-300;

/// A place between nodes: in the cell from node i to node i + 1, at the part t in [0, 1] of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The node before.
    pub i: usize,
    /// The part of the way to the next.
    pub t: f64,
}

impl Grid {
    /// The grid of a surface; values that are not finite are masked. Says what is wrong with one that is no grid.
    pub fn new(surface: &Surface) -> Result<Self, &'static str> {
        let (x, y) = (&surface.x.values, &surface.y.values);
        if x.len() < 2 || y.len() < 2 {
            return Err("no grid: an axis has fewer than two values");
        }
        for axis in [x, y] {
            if !axis.iter().all(|v| v.abs() <= LARGEST) || !axis.windows(2).all(|pair| pair[0] < pair[1]) {
                return Err("no grid: the values of an axis do not ascend");
            }
        }
        if surface.values.len() != x.len() * y.len() {
            return Err("no grid: not one value for each node");
        }
        let clean = |v: &Option<f64>| {
            v.filter(|v| v.is_finite()).map(|v| if v.abs() < LEAST { 0.0 } else { v.clamp(-LARGEST, LARGEST) })
        };
        Ok(Self { x: x.clone(), y: y.clone(), values: surface.values.iter().map(clean).collect() })
    }

    /// The value at a node, column i of row j, both within the grid.
    pub fn at(&self, i: usize, j: usize) -> Option<f64> {
        self.values[j * self.x.len() + i]
    }

    /// The values that are not masked.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        self.values.iter().flatten().copied()
    }

    /// Whether any node is masked.
    pub fn holes(&self) -> bool {
        self.values.iter().any(Option::is_none)
    }

    /// The same function on a finer grid: every cell in equal parts, as many as keep the cells along an axis to `most`.
    pub fn refined(&self, most: usize) -> Self {
        let places = |axis: &[f64]| -> Vec<Place> {
            let parts = (most / (axis.len() - 1)).max(1);
            let inner =
                (0..axis.len() - 1).flat_map(|i| (0..parts).map(move |k| Place { i, t: k as f64 / parts as f64 }));
            inner.chain([Place { i: axis.len() - 2, t: 1.0 }]).collect()
        };
        let (columns, rows) = (places(&self.x), places(&self.y));
        let values =
            rows.iter().flat_map(|&row| columns.iter().map(move |&column| self.between(column, row))).collect();
        let axis = |axis: &[f64], places: &[Place]| {
            places.iter().map(|&Place { i, t }| axis[i] * (1.0 - t) + axis[i + 1] * t).collect()
        };
        Self { x: axis(&self.x, &columns), y: axis(&self.y, &rows), values }
    }

    /// The value between nodes; `None` where the nearest node is masked. Bilinear, exact at nodes and where all corners are
    /// equal; a masked corner is replaced by the plane through the other three, where more are masked by the mean of those
    /// known next to it.
    pub fn between(&self, x: Place, y: Place) -> Option<f64> {
        self.at(x.i + usize::from(x.t >= 0.5), y.i + usize::from(y.t >= 0.5))?;
        // Round the cell.
        let known = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(right, up)| self.at(x.i + right, y.i + up));
        let filled = |k: usize| -> f64 {
            let [here, next, across, before] = [0, 1, 2, 3].map(|n| known[(k + n) % 4]);
            match (here, next, across, before) {
                (Some(v), ..) => v,
                (None, Some(a), Some(b), Some(c)) => a + c - b,
                (None, Some(a), None, Some(c)) => 0.5 * (a + c),
                (None, Some(v), _, None) | (None, None, _, Some(v)) | (None, None, Some(v), None) => v,
                (None, None, None, None) => f64::NAN,
            }
        };
        let lerp = |a: f64, b: f64, t: f64| if t == 1.0 { b } else { a + t * (b - a) };
        Some(lerp(lerp(filled(0), filled(1), x.t), lerp(filled(3), filled(2), x.t), y.t))
    }
}

/// Where on an ascending axis a value stands; beyond its ends, at the end.
pub fn place(axis: &[f64], value: f64) -> Place {
    let i = axis.partition_point(|&v| v <= value).clamp(1, axis.len() - 1) - 1;
    Place { i, t: ((value - axis[i]) / (axis[i + 1] - axis[i])).clamp(0.0, 1.0) }
}
