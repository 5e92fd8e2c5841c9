//! Every active voxel as a particle.

use super::super::columns::{ReadError, reserve};
use super::bytes::Input;
use super::limits::{Limits, MAX_PARTICLES};
use super::transform::Transform;
use super::tree::{Census, LEAF_WORDS, Sink, Tile, Tiles};

/// Particles to reserve at once where the size of the file is unknown and a count cannot be checked.
const CAUTIOUS: u64 = 1 << 16;

/// Coordinates and values of particles, of the coordinates only those that are wanted.
#[derive(Debug)]
pub struct Rows {
    /// From index space to coordinates.
    pub transform: Transform,
    /// x, y and z.
    pub axes: [Option<Vec<f64>>; 3],
    /// The value of each.
    pub values: Vec<f64>,
    /// The sum of the values of all active voxels.
    pub sum: f64,
}

impl Rows {
    /// Reserves memory for so many more particles.
    pub fn reserve(&mut self, count: u64) -> Result<(), ReadError> {
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        self.axes.iter_mut().flatten().try_for_each(|axis| reserve(axis, count))?;
        reserve(&mut self.values, count)
    }

    /// Appends the wanted coordinates of a particle at an index.
    pub fn push_place(&mut self, index: [f64; 3]) {
        for (axis, values) in self.axes.iter_mut().enumerate() {
            if let Some(values) = values {
                values.push(self.transform.coordinate(axis, index));
            }
        }
    }
}

/// Makes every active voxel a particle.
pub struct Voxels {
    /// The particles.
    pub rows: Rows,
    limits: Limits,
    /// Tiles wait until the number of all particles is known.
    tiles: Vec<Tile>,
    /// Whether not even they found room.
    is_over: bool,
}

impl Voxels {
    /// Into these columns, empty so far.
    pub fn new(rows: Rows, limits: Limits) -> Self {
        Self { rows, limits, tiles: Vec::new(), is_over: false }
    }
}

impl Sink for Voxels {
    fn tiles(&mut self, node: &Tiles, input: &Input) -> Result<(), ReadError> {
        let bytes = (self.tiles.len() + node.tiles.len()) * size_of::<Tile>();
        self.is_over |= bytes as u64 > Limits::tile_budget(input);
        if !self.is_over {
            self.tiles.extend_from_slice(node.tiles);
        }
        Ok(())
    }

    fn begin(&mut self, census: &Census, input: &Input) -> Result<(), ReadError> {
        if self.is_over || !self.limits.allow_tiles(census.tile_voxels(), input) {
            return Err(self.limits.too_many_in_tiles(census, input));
        }
        let count = u64::try_from(census.voxels()).ok().filter(|&count| count <= MAX_PARTICLES);
        let Some(count) = count else { return Err(self.limits.too_many(census, input)) };
        self.rows.reserve(if input.size().is_some() { count } else { count.min(CAUTIOUS) })?;
        for Tile { origin, side, value } in std::mem::take(&mut self.tiles) {
            for x in 0..side {
                for y in 0..side {
                    for z in 0..side {
                        self.rows.push_place([origin[0] + x, origin[1] + y, origin[2] + z].map(f64::from));
                    }
                }
            }
            let voxels = (side as usize).pow(3);
            self.rows.values.resize(self.rows.values.len() + voxels, value);
            add(&mut self.rows.sum, value * voxels as f64);
        }
        Ok(())
    }

    fn leaf(&mut self, origin: [i32; 3], mask: &[u64; LEAF_WORDS], values: &[f64]) -> Result<(), ReadError> {
        let transform = &self.rows.transform;
        for (axis, column) in self.rows.axes.iter_mut().enumerate() {
            let Some(column) = column else { continue };
            // Each word holds the voxels of one x: 8 by 8 of y and z.
            for (x, &word) in (0..).zip(mask) {
                let coordinate = |bit: i32| {
                    let index = [origin[0] + x, origin[1] + (bit >> 3), origin[2] + (bit & 7)];
                    transform.coordinate(axis, index.map(f64::from))
                };
                if word == u64::MAX {
                    column.extend((0..64).map(coordinate));
                    continue;
                }
                // To the column in one piece: the bits are found faster than a length is kept up to date.
                let mut found = [0.0; 64];
                let mut left = word;
                let mut count = 0;
                for place in &mut found {
                    if left == 0 {
                        break;
                    }
                    *place = coordinate(left.trailing_zeros() as i32);
                    left &= left - 1;
                    count += 1;
                }
                column.extend_from_slice(&found[..count]);
            }
        }
        self.rows.values.extend_from_slice(values);
        // Leaf by leaf, which rounds less than voxel by voxel.
        add(&mut self.rows.sum, values.iter().filter(|value| !value.is_nan()).sum());
        Ok(())
    }
}

/// Adds what is a number.
pub fn add(sum: &mut f64, value: f64) {
    if !value.is_nan() {
        *sum += value;
    }
}
