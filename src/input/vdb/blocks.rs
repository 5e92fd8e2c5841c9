//! Blocks of n^3 voxels as particles.
//!
//! A block's value is the sum of its active voxels over n^3: times the block's volume that is the integral over the
//! voxels. Its place is the centroid of the values, so that the first moments are conserved, too.

use super::super::columns::ReadError;
use super::bytes::Input;
use super::limits::{Limits, MAX_PARTICLES};
use super::tree::{Census, LEAF, LEAF_WORDS, Sink, Tile, Tiles};
use super::values::bits;
use super::voxels::{Rows, add};
use std::collections::HashMap;

/// Bytes that a block needs while it is gathered, with what the growth of a list and of a table reserve.
pub const BLOCK_BYTES: u64 = 2 * (size_of::<Block>() + size_of::<([i32; 3], u32)>() + 8) as u64;
/// The most blocks along an axis that a leaf touches: 8 voxels in blocks of 2, or in blocks of 3 not aligned with it.
const PER_AXIS: usize = 4;

/// What is summed up over the active voxels of a block. Places are index coordinates from the block's first voxel.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Number of voxels.
    count: f64,
    /// Sum of the places.
    places: [f64; 3],
    /// Sum of the values.
    value: f64,
    /// Sum of the values greater than 0, which are the weights of the centroid.
    weight: f64,
    /// Sum of the places times their weights.
    weighted: [f64; 3],
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.value += other.value;
        self.weight += other.weight;
        for axis in 0..3 {
            self.places[axis] += other.places[axis];
            self.weighted[axis] += other.weighted[axis];
        }
    }

    /// Adds voxels of one value: their number and the sum of their places.
    fn add_voxels(&mut self, value: f64, count: f64, places: [f64; 3]) {
        let weight = value.max(0.0);
        self.count += count;
        self.value += value * count;
        self.weight += weight * count;
        for (axis, place) in places.into_iter().enumerate() {
            self.places[axis] += place;
            self.weighted[axis] += weight * place;
        }
    }

    /// The centroid of the values, or that of the voxels where no value is greater than 0.
    fn centroid(&self) -> [f64; 3] {
        let weighted = self.weighted.map(|sum| sum / self.weight);
        // Not finite if the weight is 0, or the sums are too large.
        if weighted.iter().all(|place| place.is_finite()) { weighted } else { self.places.map(|sum| sum / self.count) }
    }
}

/// A block: its place, in blocks, and the sums over its voxels.
#[derive(Clone, Copy, Debug)]
struct Block {
    place: [i32; 3],
    sums: Sums,
}

/// Voxels of a line that lie in one block: the block's place, their number and the sum of their places in the block.
#[derive(Clone, Copy, Debug)]
struct Span {
    block: i32,
    count: f64,
    places: f64,
}

/// Gathers active voxels in blocks.
pub struct Blocks {
    rows: Rows,
    limits: Limits,
    /// The blocks in the order in which the tree comes upon them.
    blocks: Vec<Block>,
    /// The index of the block at a place.
    index: HashMap<[i32; 3], u32>,
    /// Blocks that tiles have touched so far, at most.
    touched: u128,
    /// Whether those are too many.
    is_over: bool,
    census: Census,
    /// The size of the file, for messages; what was read of it if unknown.
    size: u64,
}

impl Blocks {
    /// Into these columns, empty so far.
    pub fn new(rows: Rows, limits: Limits) -> Self {
        let (blocks, index, census) = Default::default();
        Self { rows, limits, blocks, index, touched: 0, is_over: false, census, size: 0 }
    }

    fn side(&self) -> i64 {
        self.limits.downsample.into()
    }

    /// The place of the block that holds a voxel along an axis, and the voxel's place in the block.
    fn split(&self, coordinate: i32) -> (i32, i64) {
        let coordinate = i64::from(coordinate);
        // With a side of 2 or more the quotient is smaller than the coordinate.
        (coordinate.div_euclid(self.side()) as i32, coordinate.rem_euclid(self.side()))
    }

    /// The blocks along an axis that `side` voxels from `start` touch.
    fn count(&self, start: i32, side: i32) -> u128 {
        let [first, last] = [start, start + (side - 1)].map(|coordinate| self.split(coordinate).0);
        u128::from(last.abs_diff(first)) + 1
    }

    /// The blocks that a cube touches.
    fn count_cube(&self, origin: [i32; 3], side: i32) -> u128 {
        origin.iter().map(|&start| self.count(start, side)).product()
    }

    /// A line of voxels, cut where blocks end.
    fn spans(&self, start: i32, side: i32) -> Vec<Span> {
        let mut spans = Vec::new();
        let mut done = 0;
        while done < side {
            let (block, place) = self.split(start + done);
            let count = (self.side() - place).min(i64::from(side - done));
            // place + (place + 1) + ...: `count` of them.
            let places = count as f64 * (place as f64 + (count - 1) as f64 / 2.0);
            spans.push(Span { block, count: count as f64, places });
            done += count as i32;
        }
        spans
    }

    fn add(&mut self, place: [i32; 3], sums: &Sums) -> Result<(), ReadError> {
        if let Some(block) = self.index.get(&place).and_then(|&index| self.blocks.get_mut(index as usize)) {
            block.sums.add(sums);
            return Ok(());
        }
        if self.blocks.len() as u64 >= MAX_PARTICLES {
            let mut empty = std::io::empty();
            let input = Input::new(&mut empty, 0, Some(self.size));
            return Err(self.limits.too_many(&self.census, &input));
        }
        let room = self.index.try_reserve(1).and_then(|()| self.blocks.try_reserve(1));
        room.map_err(|_| ReadError::content(format!("not enough memory for {} blocks", self.blocks.len())))?;
        self.index.insert(place, self.blocks.len() as u32);
        self.blocks.push(Block { place, sums: *sums });
        Ok(())
    }

    /// The particles. `lenient`: a mean that is no finite number becomes NaN.
    pub fn finish(mut self, lenient: bool) -> Result<Rows, ReadError> {
        drop(self.index);
        self.rows.reserve(self.blocks.len() as u64)?;
        let side = f64::from(self.limits.downsample);
        for Block { place, sums } in self.blocks {
            let mean = sums.value / side.powi(3);
            if !mean.is_finite() && !lenient {
                return Err(ReadError::content(format!(
                    "the values of grid `{}` from index ({}, {}, {}) on add up to {}; allowed: a finite number",
                    self.limits.name,
                    f64::from(place[0]) * side,
                    f64::from(place[1]) * side,
                    f64::from(place[2]) * side,
                    sums.value
                )));
            }
            self.rows.values.push(if mean.is_finite() { mean } else { f64::NAN });
            let centroid = sums.centroid();
            self.rows.push_place(std::array::from_fn(|axis| f64::from(place[axis]) * side + centroid[axis]));
        }
        Ok(self.rows)
    }
}

impl Sink for Blocks {
    fn tiles(&mut self, node: &Tiles, input: &Input) -> Result<(), ReadError> {
        let each: u128 = node.tiles.iter().map(|tile| self.count_cube(tile.origin, tile.side)).sum();
        self.touched = self.touched.saturating_add(each.min(self.count_cube(node.origin, node.side)));
        self.is_over |= !self.limits.allow_tiles(self.touched, input);
        if self.is_over {
            return Ok(());
        }
        for &Tile { origin, side, value } in node.tiles {
            let [along_x, along_y, along_z] = origin.map(|start| self.spans(start, side));
            for x in &along_x {
                for y in &along_y {
                    for z in &along_z {
                        let places =
                            [x.places * y.count * z.count, x.count * y.places * z.count, x.count * y.count * z.places];
                        let mut sums = Sums::default();
                        sums.add_voxels(value, x.count * y.count * z.count, places);
                        self.add([x.block, y.block, z.block], &sums)?;
                    }
                }
            }
            add(&mut self.rows.sum, value * f64::from(side).powi(3));
        }
        Ok(())
    }

    fn begin(&mut self, census: &Census, input: &Input) -> Result<(), ReadError> {
        if self.is_over {
            return Err(self.limits.too_many_in_tiles(census, input));
        }
        self.census = *census;
        self.size = input.size().unwrap_or_else(|| input.position());
        Ok(())
    }

    fn leaf(&mut self, origin: [i32; 3], mask: &[u64; LEAF_WORDS], values: &[f64]) -> Result<(), ReadError> {
        // First in few sums close by, of which each goes to its block once.
        let mut near = [Sums::default(); PER_AXIS * PER_AXIS * PER_AXIS];
        let first = origin.map(|start| self.split(start).0);
        let mut places = [[(0, 0.0); LEAF as usize]; 3];
        for (axis, places) in places.iter_mut().enumerate() {
            for (step, entry) in (0..).zip(places) {
                let (block, place) = self.split(origin[axis] + step);
                *entry = ((block - first[axis]) as usize, place as f64);
            }
        }
        let [along_x, along_y, along_z] = places;
        for (voxel, &value) in bits(mask).zip(values) {
            let ((i, x), (j, y), (k, z)) = (along_x[voxel >> 6], along_y[voxel >> 3 & 7], along_z[voxel & 7]);
            near[(i * PER_AXIS + j) * PER_AXIS + k].add_voxels(value, 1.0, [x, y, z]);
        }
        for (index, sums) in near.iter().enumerate().filter(|(_, sums)| sums.count > 0.0) {
            let steps = [index / (PER_AXIS * PER_AXIS), index / PER_AXIS % PER_AXIS, index % PER_AXIS];
            self.add(std::array::from_fn(|axis| first[axis] + steps[axis] as i32), sums)?;
        }
        add(&mut self.rows.sum, values.iter().filter(|value| !value.is_nan()).sum());
        Ok(())
    }
}
