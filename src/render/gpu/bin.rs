//! The particles of each tile.

use crate::render::cpu::splat::Bounds;
use crate::render::cpu::tile::bin_bands;
use rayon::prelude::*;

/// Side of a tile in pixels, that of the workgroup in `shaders/tile.wgsl`.
pub const TILE: u32 = 16;

/// Lists of particles, tile by tile.
#[derive(Debug, Default, PartialEq)]
pub struct Lists {
    /// Where each tile's list begins in `list`; one entry more than tiles.
    pub starts: Vec<u32>,
    /// Indices of particles, in the order of `bounds`.
    pub list: Vec<u32>,
}

/// Number of tiles that bounds, which are not empty, reach into.
pub fn tiles_of(bounds: &Bounds) -> u64 {
    let count = |[first, last]: [u32; 2]| u64::from(last / TILE - first / TILE + 1);
    count(bounds.x) * count(bounds.y)
}

/// Lists the particles whose bounds, which are within the picture, touch each of `across` x `down` tiles. The number of
/// pairs is below 2^32. The same on any number of threads.
pub fn lists(bounds: &[Bounds], [across, down]: [u32; 2]) -> Lists {
    let mut bands = vec![Vec::new(); down as usize];
    bin_bands(bounds, TILE as usize, &mut bands);
    let rows: Vec<(Vec<u32>, Vec<u32>)> = bands
        .par_iter()
        .map(|band| {
            let tiles = |&i: &u32| {
                let [first, last] = bounds[i as usize].x.map(|x| (x / TILE) as usize);
                first..last + 1
            };
            let mut counts = vec![0u32; across as usize];
            for i in band {
                counts[tiles(i)].iter_mut().for_each(|count| *count += 1);
            }
            let mut next = Vec::with_capacity(counts.len());
            let mut total = 0;
            for &count in &counts {
                next.push(total);
                total += count;
            }
            let mut list = vec![0; total as usize];
            for i in band {
                for place in &mut next[tiles(i)] {
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
