//! Which pixels are measured: half of them spread evenly, half drawn to where errors hide.
//!
//! Evenly: one pixel at a random place of every cell of a grid. Where errors hide: at the edges of opaque surfaces, and
//! where the picture changes most from pixel to pixel, in every part of it and overall. The random numbers have a fixed seed.

use crate::picture::Film;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use std::num::NonZeroU64;
use std::ops::Range;

/// How many pixels to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    /// All of them.
    All,
    /// So many of each view; all where a view has no more.
    Pixels(NonZeroU64),
}

/// Pixels by their row-major index, the same for every view; no pixel twice, each list in ascending order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Places {
    /// Spread evenly over the picture: what they say of it on average is true of the whole.
    pub even: Vec<usize>,
    /// Drawn to where errors hide.
    pub drawn: Vec<usize>,
}

const SEED: u64 = 4096;

/// A surface has an edge where 1/depth, which is linear over the picture of a plane, bends by more than this share of itself.
const EDGE: f32 = 0.02;

/// The pixels to measure in films of one size, one for each view: as many as asked for, or all there are.
pub fn places(films: &[Film], sample: Sample) -> Places {
    let size = films.first().map_or([0, 0], |film| film.size.map(|n| n as usize));
    let pixels = size[0] * size[1];
    let count = match sample {
        Sample::Pixels(count) if count.get() < pixels as u64 => count.get() as usize,
        Sample::Pixels(_) | Sample::All => return Places { even: (0..pixels).collect(), drawn: Vec::new() },
    };
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut taken = vec![false; pixels];
    let mut even = Vec::with_capacity(count);
    for [columns, rows] in cells(size, count - count / 2) {
        let pixel = within(&mut random, rows) * size[0] + within(&mut random, columns);
        taken[pixel] = true;
        even.push(pixel);
    }
    even.sort_unstable();

    let wanted = count - even.len();
    let mut drawn = Vec::with_capacity(wanted);
    let edges: Vec<usize> = (0..pixels).into_par_iter().filter(|&i| !taken[i] && is_edge(films, i)).collect();
    let share = edges.len().min(wanted / 2);
    for part in 0..share {
        let range = part * edges.len() / share..(part + 1) * edges.len() / share;
        let pixel = edges[within(&mut random, range)];
        taken[pixel] = true;
        drawn.push(pixel);
    }
    let steep: Vec<f32> = (0..pixels).into_par_iter().map(|i| steepness(films, i)).collect();
    // Steepest first; equals in an order that favours no side of the picture.
    let rank = |&a: &usize, &b: &usize| {
        let scattered = |i: usize| (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        steep[b].total_cmp(&steep[a]).then(scattered(a).cmp(&scattered(b)))
    };
    for [columns, rows] in cells(size, (wanted - drawn.len()) / 2) {
        let inside = rows.flat_map(|row| columns.clone().map(move |column| row * size[0] + column));
        if let Some(pixel) = inside.filter(|&i| !taken[i] && steep[i] > 0.0).min_by(rank) {
            taken[pixel] = true;
            drawn.push(pixel);
        }
    }
    let mut others: Vec<usize> = (0..pixels).filter(|&i| !taken[i]).collect();
    let missing = wanted - drawn.len();
    // Fewer than all pixels are asked for: there are more others than are missing.
    others.select_nth_unstable_by(missing, rank);
    drawn.extend_from_slice(&others[..missing]);
    drawn.sort_unstable();
    Places { even, drawn }
}

/// At most `most` cells of about equal sides that cover a picture, as columns and rows; none is empty. None for no cell.
fn cells([width, height]: [usize; 2], most: usize) -> impl Iterator<Item = [Range<usize>; 2]> {
    let across = (most as f64 * width as f64 / height as f64).sqrt() as usize;
    let across = across.clamp(1, width.min(most).max(1));
    let down = (most / across).min(height);
    let part = |i: usize, parts: usize, whole: usize| i * whole / parts..(i + 1) * whole / parts;
    (0..across * down).map(move |i| [part(i % across, across, width), part(i / across, down, height)])
}

/// A number of a range that is not empty.
fn within(random: &mut ChaCha8Rng, range: Range<usize>) -> usize {
    // The high half of a product: even to 2^-64 times the range's length.
    let offset = (u128::from(random.next_u64()) * range.len() as u128) >> 64;
    range.start + offset as usize
}

/// The pixels on the left and right, where both are there, and those above and below.
fn pairs([width, height]: [usize; 2], i: usize) -> [Option<[usize; 2]>; 2] {
    let (column, row) = (i % width, i / width);
    let inner = |at: usize, count: usize| at > 0 && at + 1 < count;
    [inner(column, width).then(|| [i - 1, i + 1]), inner(row, height).then(|| [i - width, i + width])]
}

/// Whether an opaque surface begins, ends or has a crease here in any view.
fn is_edge(films: &[Film], i: usize) -> bool {
    films.iter().any(|film| {
        let Some(depth) = &film.depth else { return false };
        let size = film.size.map(|n| n as usize);
        pairs(size, i).into_iter().flatten().any(|[before, after]| {
            let [a, b, c] = [before, i, after].map(|i| 1.0 / depth[i]);
            (a - 2.0 * b + c).abs() > EDGE * a.max(b).max(c)
        })
    })
}

/// By how much a pixel differs from its neighbours on average, in the channel and view where that is most; infinite where
/// it has no finite value.
fn steepness(films: &[Film], i: usize) -> f32 {
    let mut most = 0.0f32;
    for film in films {
        let [width, height] = film.size.map(|n| n as usize);
        let (column, row) = (i % width, i / width);
        let neighbours = [
            (column > 0).then(|| i - 1),
            (column + 1 < width).then(|| i + 1),
            (row > 0).then(|| i - width),
            (row + 1 < height).then(|| i + width),
        ];
        for plane in film.color.iter().chain([&film.transmittance]) {
            if !plane[i].is_finite() {
                return f32::INFINITY;
            }
            let (mut sum, mut count) = (0.0, 0.0);
            // A neighbour without a finite value is steep itself.
            for neighbour in neighbours.into_iter().flatten().filter(|&n| plane[n].is_finite()) {
                sum += (plane[neighbour] - plane[i]).abs();
                count += 1.0;
            }
            // Without neighbours 0 / 0, which is no maximum.
            most = most.max(sum / count);
        }
    }
    most
}
