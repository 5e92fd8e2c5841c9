//! Particles by groups of eight slabs or slices: a tile goes through them front to back, and holds what is in one in registers.

use super::Gpu;
use super::bin::{self, Stairs};
use super::compute::Upload;
use super::part::{Memory, Part, Times};
use super::source::MOST_PAIRS;
use crate::error::Result;
use crate::render::Progress;
use bytemuck::Pod;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Slabs or slices that shaders hold in registers.
pub const GROUP: usize = 8;

/// A particle as its shader reads it, the tiles of the stretch that it reaches into, and its first and last group.
pub struct Seen<T> {
    pub particle: T,
    pub stairs: Stairs,
    pub groups: [usize; 2],
}

/// The particles of some groups, with their lists one group after the other.
struct Load<T> {
    particles: Vec<T>,
    starts: Vec<u32>,
    list: Vec<u32>,
}

/// Has what each view sees composited: all groups, of which there is at least one, as many in a submission as its buffers allow.
/// `slabs` is the number of all slabs, 0 without. Returns the number of submissions.
///
/// # Errors
/// [`crate::Error::Device`] where the particles of one group do not fit into buffers.
pub fn submit<T: Pod + Send + Sync>(
    part: &Part,
    pipeline: &wgpu::ComputePipeline,
    buffers: &mut Memory,
    tables: &(wgpu::Buffer, u64),
    seen: &[Vec<Seen<T>>],
    [groups, slabs]: [u32; 2],
    times: &mut Times,
    progress: &dyn Progress,
) -> Result<u64> {
    let start = Instant::now();
    let ranges = cut(seen, groups as usize, part.tiles(), part.gpu)?;
    times.bin += start.elapsed();
    let [rows, height] = [part.rows.len() as u64, u64::from(part.views[0].size[1])];
    for (number, range) in (0..).zip(&ranges) {
        progress.update(u64::from(part.rows.start) + rows * number / ranges.len() as u64, height);
        let start = Instant::now();
        let loads: Vec<Load<T>> = seen.iter().map(|seen| load(seen, range, part.grid())).collect();
        times.bin += start.elapsed();
        let uploads: Vec<Upload> = loads
            .iter()
            .map(|load| Upload {
                particles: bytemuck::cast_slice(&load.particles),
                starts: &load.starts,
                list: &load.list,
            })
            .collect();
        let ends = [range.start == 0, range.end == groups as usize];
        let numbers = [range.start as u32, range.len() as u32, slabs];
        part.submit(pipeline, buffers, &uploads, tables, ends, numbers, times);
    }
    Ok(ranges.len() as u64)
}

/// Cuts the groups into stretches whose particles and lists fit into buffers, and whose loops a driver goes through, as far as
/// one group does.
fn cut<T>(seen: &[Vec<Seen<T>>], groups: usize, tiles: u64, gpu: &Gpu) -> Result<Vec<Range<usize>>> {
    // Of the view that has more; particles that go through several groups count in each.
    let mut particles = vec![0u64; groups];
    let mut pairs = vec![0u64; groups];
    for view in seen {
        let (mut own_particles, mut own_pairs) = (vec![0u64; groups], vec![0u64; groups]);
        for one in view {
            let tiles = one.stairs.tiles();
            for group in one.groups[0]..=one.groups[1] {
                own_particles[group] += 1;
                own_pairs[group] += tiles;
            }
        }
        for (most, own) in particles.iter_mut().zip(own_particles).chain(pairs.iter_mut().zip(own_pairs)) {
            *most = (*most).max(own);
        }
    }
    let most = gpu.most_bytes();
    // Rounds of loops, particles, pairs of particle and tile, groups with a list for each tile.
    let limits = [gpu.longest_list(), most / size_of::<T>() as u64, MOST_PAIRS.min(most / 4), most / 4 / (tiles + 1)];
    let mut stretches = Vec::new();
    let mut start = 0;
    let mut sums = [0; 4];
    for group in 0..groups {
        // Empty or not, a group's registers are cleared and composited.
        let own = [particles[group] + 2 * GROUP as u64, particles[group], pairs[group], 1];
        // Before lists are made: they may be longer than any memory.
        if particles[group] > limits[1] || pairs[group] > most / 4 || limits[3] == 0 {
            return Err(gpu.error(
                "cannot hold the particles of eight slabs or slices: thinner ones, or a smaller --size, would help",
            ));
        }
        let next = [0, 1, 2, 3].map(|i| sums[i] + own[i]);
        if group > start && next.iter().zip(limits).any(|(next, limit)| *next > limit) {
            stretches.push(start..group);
            start = group;
            sums = own;
        } else {
            sums = next;
        }
    }
    stretches.push(start..groups);
    Ok(stretches)
}

/// The particles and lists of some groups.
fn load<T: Pod + Send + Sync>(seen: &[Seen<T>], groups: &Range<usize>, size: [u32; 2]) -> Load<T> {
    let inside: Vec<&Seen<T>> =
        seen.iter().filter(|one| one.groups[0] < groups.end && one.groups[1] >= groups.start).collect();
    let mut ids = vec![Vec::new(); groups.len()];
    for (id, one) in (0u32..).zip(&inside) {
        let [first, last] = [one.groups[0].max(groups.start), one.groups[1].min(groups.end - 1)];
        for ids in &mut ids[first - groups.start..=last - groups.start] {
            ids.push(id);
        }
    }
    let lists: Vec<(Vec<u32>, bin::Lists)> = ids
        .into_par_iter()
        .map(|ids| {
            let stairs: Vec<Stairs> = ids.iter().map(|&id| inside[id as usize].stairs).collect();
            (ids, bin::lists(&stairs, size))
        })
        .collect();
    let particles = inside.iter().map(|one| one.particle).collect();
    let mut load = Load { particles, starts: Vec::new(), list: Vec::new() };
    for (ids, lists) in lists {
        let base = load.list.len() as u32;
        load.starts.extend(lists.starts.iter().map(|start| base + start));
        load.list.extend(lists.list.iter().map(|&i| ids[i as usize]));
    }
    load
}
