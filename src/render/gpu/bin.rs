//! The particles of each tile.

use crate::render::cpu::rim::Rim;
use crate::render::cpu::splat::Bounds;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile in pixels, that of the workgroup in `shaders/tile.wgsl`.
pub const TILE: u32 = 16;
/// Steps of [`Stairs`], as in `shaders/lists/stairs.wgsl`.
const STEPS: usize = 16;

/// The tiles that a particle reaches into: rows of them in up to 16 steps of the same height, the last of what is left, with
/// the columns of each. First and last 16 bits each, the last before the first for none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Stairs {
    /// Rows of tiles.
    pub rows: u32,
    /// Columns of tiles, by step; those beyond the rows mean nothing.
    pub columns: [u32; STEPS],
}

const fn span(first: u32, last: u32) -> u32 {
    first | last << 16
}

const fn range(span: u32) -> Range<u32> {
    (span & 0xffff)..(span >> 16) + 1
}

impl Stairs {
    /// No tiles.
    pub const NONE: Self = Self { rows: span(1, 0), columns: [span(1, 0); STEPS] };

    /// The tiles of the pixels that are within bounds, which count from row `first_row` of the picture, and within a rim.
    pub fn new(bounds: &Bounds, rim: &Rim, first_row: u32) -> Self {
        if bounds.is_empty() {
            return Self::NONE;
        }
        let [left, right] = bounds.x.map(|x| x / TILE);
        let [top, bottom] = bounds.y.map(|y| y / TILE);
        let mut stairs = Self { rows: span(top, bottom), ..Self::NONE };
        let height = stairs.height();
        for (columns, first) in stairs.columns.iter_mut().zip((top..=bottom).step_by(height as usize)) {
            let last = bottom.min(first + height - 1);
            // The centres of the first and last row of pixels.
            let rows = [first * TILE, (last + 1) * TILE - 1].map(|row| f64::from(row + first_row) + 0.5);
            if let Some([low, high]) = rim.columns(rows) {
                // Conversions take care of what is beyond any picture.
                let (start, end) = ((low - 0.5).ceil() as u32, (high + 0.5).floor() as u32);
                let (start, last) = ((start / TILE).max(left), (end.saturating_sub(1) / TILE).min(right));
                if end > 0 && start <= last {
                    *columns = span(start, last);
                }
            }
        }
        stairs
    }

    /// Rows of tiles of a step.
    fn height(&self) -> u32 {
        range(self.rows).len().div_ceil(STEPS) as u32
    }

    /// Rows and columns of each step.
    fn steps(&self) -> impl Iterator<Item = [Range<u32>; 2]> {
        let rows = range(self.rows);
        let height = self.height().max(1);
        let starts = rows.clone().step_by(height as usize);
        starts.zip(self.columns).map(move |(start, columns)| [start..rows.end.min(start + height), range(columns)])
    }

    /// Number of tiles.
    pub fn tiles(&self) -> u64 {
        self.steps().map(|[rows, columns]| rows.len() as u64 * columns.len() as u64).sum()
    }
}

/// Lists of particles, tile by tile.
#[derive(Debug, Default, PartialEq)]
pub struct Lists {
    /// Where each tile's list begins in `list`; one entry more than tiles.
    pub starts: Vec<u32>,
    /// Indices of particles, in the order of `stairs`.
    pub list: Vec<u32>,
}

/// Lists the particles that reach into each of `across` x `down` tiles, none beyond them. The number of pairs is below 2^32. The
/// same on any number of threads.
pub fn lists(stairs: &[Stairs], [across, down]: [u32; 2]) -> Lists {
    let mut bands: Vec<Vec<(u32, Range<u32>)>> = vec![Vec::new(); down as usize];
    for (i, stairs) in (0..).zip(stairs) {
        for [rows, columns] in stairs.steps().filter(|[_, columns]| !columns.is_empty()) {
            for band in &mut bands[rows.start as usize..rows.end as usize] {
                band.push((i, columns.clone()));
            }
        }
    }
    let rows: Vec<(Vec<u32>, Vec<u32>)> = bands
        .par_iter()
        .map(|band| {
            let tiles = |columns: &Range<u32>| columns.start as usize..columns.end as usize;
            let mut counts = vec![0u32; across as usize];
            for (_, columns) in band {
                counts[tiles(columns)].iter_mut().for_each(|count| *count += 1);
            }
            let mut next = Vec::with_capacity(counts.len());
            let mut total = 0;
            for &count in &counts {
                next.push(total);
                total += count;
            }
            let mut list = vec![0; total as usize];
            for (i, columns) in band {
                for place in &mut next[tiles(columns)] {
                    list[*place as usize] = *i;
                    *place += 1;
                }
            }
            (counts, list)
        })
        .collect();
    let mut lists = Lists { starts: vec![0], list: Vec::new() };
    let mut total = 0;
    for (counts, list) in rows {
        for count in counts {
            total += count;
            lists.starts.push(total);
        }
        lists.list.extend(list);
    }
    lists
}
