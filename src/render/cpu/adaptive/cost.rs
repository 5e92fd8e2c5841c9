//! How long a frame takes, told by a sample of the particles, by what the survey found of the tiles, and by which grids are left out.
//!
//! Costs are nanoseconds of a core, fitted to random scenes with one to five colours, walls and none, of 1 to 2000 particles
//! (`analysis/auto` shows how it holds). What tiles will ask for beyond their first grid is a mean of those scenes.

use super::{Part, SPACINGS};
use crate::render::cpu::forecast::{DEEP, Sample};
use crate::render::cpu::simd::Level;
use crate::render::cpu::tempo::tempo;
use crate::render::cpu::tile::TILE;
use std::time::Duration;

/// Costs of gas on grids.
struct Costs {
    /// A particle of a view, looked at and prepared.
    particle: f64,
    /// A ball's node of the first grid, for one colour.
    added: f64,
    /// A ball's node of other grids.
    node: f64,
    /// A node of a tile whatever is before it.
    bare_node: f64,
    /// A ball's pixel, where tiles are drawn by pixels, and a pixel there whatever is before it.
    pixel: f64,
    bare_pixel: f64,
    /// A pixel made of nodes, and any pixel: of a film, or of 8 bits.
    enlarged: f64,
    film: f64,
    code: f64,
}

const ONE: Costs = Costs {
    particle: 41.0,
    added: 0.8,
    node: 0.29,
    bare_node: 33.0,
    pixel: 0.86,
    bare_pixel: 27.0,
    enlarged: 0.08,
    film: 1.6,
    code: 0.4,
};

const SEVERAL: Costs = Costs {
    particle: 565.0,
    added: 0.0,
    node: 0.34,
    bare_node: 219.0,
    pixel: 9.0,
    bare_pixel: 6.1,
    enlarged: 2.3,
    film: 1.4,
    code: 0.2,
};

/// Costs of billboards: what any view takes, a particle that is looked at, one that is prepared, a fragment and a pixel.
const VIEW: f64 = 2e4;
const LOOK: f64 = 9.0;
const BILLBOARD: f64 = 60.0;
const FRAGMENT: f64 = 0.85;
/// What affine footprints spare of a fragment.
const SPARED: f64 = 0.3;
const PIXEL: f64 = 2.2;

/// Wall time of core time.
fn wall(nanoseconds: f64, level: Level) -> Duration {
    let threads = rayon::current_num_threads() as f64;
    Duration::try_from_secs_f64(1e-9 * nanoseconds * tempo(level) / threads).unwrap_or_default()
}

/// Of gas that is drawn as billboards into `views` views of so many pixels, a share of them by affine footprints.
pub fn billboards(sample: &Sample, particles: usize, views: usize, pixels: f64, affine: f64, level: Level) -> Duration {
    let shown = (DEEP / sample.depth).min(1.0);
    let of_view = VIEW
        + LOOK * particles as f64
        + shown * (BILLBOARD * sample.seen + FRAGMENT * (1.0 - SPARED * affine) * sample.area)
        + PIXEL * pixels;
    wall(views as f64 * of_view, level)
}

/// Of gas on grids, as the survey found it; `first` is the grid that gas of one colour was added to on the way, `encoded`: frames of
/// 8 bits are drawn.
pub fn grids(
    sample: &Sample,
    particles: usize,
    parts: &[Part],
    first: Option<usize>,
    encoded: bool,
    level: Level,
) -> Duration {
    let costs = if first.is_some() { ONE } else { SEVERAL };
    let views = parts.len() as f64;
    let shown = (DEEP / sample.depth).min(1.0);
    let tile = (TILE * TILE) as f64;
    // Tiles with gas, by the grid that they begin with, which is not one that is left out; the last are the pixels.
    let mut counts = [0.0; SPACINGS.len() + 1];
    for part in parts {
        for tile in part.tiles.iter().filter(|tile| !tile.is_empty) {
            // Of one colour all grids are drawn.
            let left_out = part.grids.iter().skip(tile.coarsest).take_while(|grid| grid.is_none());
            let left_out = if first.is_some() { 0 } else { left_out.count() };
            counts[tile.coarsest + left_out] += 1.0;
        }
    }
    let full: f64 = counts.iter().sum();
    // Balls before a pixel.
    let layers = shown * views * sample.area / (full * tile).max(1.0);
    let pixels = tile * counts[SPACINGS.len()];
    let films: f64 = parts.iter().map(|part| part.view.size.map(f64::from).iter().product::<f64>()).sum();
    let mut sum = costs.particle * views * particles as f64
        + costs.added * views * sample.added
        + (costs.pixel * layers + costs.bare_pixel) * pixels
        + costs.enlarged * (full * tile - pixels)
        + if encoded { costs.code } else { costs.film } * films;
    for (number, (&count, spacing)) in counts.iter().zip(SPACINGS).enumerate() {
        // With those beyond its edges that have a say in it.
        let nodes = ((TILE / spacing + 6) as f64).powi(2) * count;
        let added = first.is_some_and(|first| number <= first);
        sum += (costs.bare_node + if added { 0.0 } else { costs.node * layers }) * nodes;
    }
    wall(sum, level)
}
