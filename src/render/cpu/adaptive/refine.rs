//! Which grid each tile of the picture takes: its nodes are drawn, and tell whether they are near enough to each other.

use super::extent::Extent;
use super::grid::Grid;
use super::misfit::{self, Misfit};
use super::split::Outlook;
use super::{Job, Part, SPACINGS};
use crate::picture::{Film, Plane};
use crate::render::cpu::simd::dispatch;
use crate::render::cpu::slab::{Canvas, Ordered};
use std::ops::Range;

/// Nodes so many pixels apart tell what rims cost: at most this share of that by which they differ from what neighbours make of them.
const FINE: usize = 2;
const RIM: f64 = 0.9;

/// What nodes of the finest grid may lose, as a share of the tolerance, for finer grids to be tried.
const HOPELESS: f64 = 1.5;

/// Rows of nodes that a task draws.
const BAND: usize = 16;

/// What nodes tell of a tile.
struct Told {
    tile: usize,
    /// By how much they differ from what their neighbours make of them, at most.
    misfit: f32,
    /// [`misfit::share`].
    share: f64,
    /// The most that they let through.
    through: f32,
}

impl Job<'_> {
    /// Draws the nodes of a grid for the tiles that need it, and decides which of them are content.
    pub fn refine<'b>(&self, part: &mut Part, number: usize, ordered: impl FnOnce() -> &'b Ordered) {
        let wanted: Vec<usize> = (0..part.tiles.len())
            .filter(|&i| part.tiles[i].grid <= number && part.tiles[i].is_open())
            .filter(|&i| part.tiles[i].coarsest <= number)
            .collect();
        // Nodes of one colour may have been drawn on the way.
        if number == part.grids.len() {
            let drawn = self.share(part, number, &wanted).map(|share| {
                part.shares[number] = share;
                self.draw_nodes(part, number, &wanted, ordered())
            });
            part.grids.push(drawn);
        }
        // What the slabs leave; where one block needs more than its share, the others' nodes still have theirs.
        let allowed = self.left - f64::from(part.slabs[number]).min(part.shares[number] * self.tolerance);
        let told = part.grids[number].as_ref().map(|(grid, film)| self.ask(part, (grid, film), &wanted));
        for told in told.unwrap_or_default() {
            let tile = &part.tiles[told.tile];
            // Where a wider grid was asked too, it tells how fast nodes come nearer to each other.
            let (ago, to_come) = (number + 1 - tile.grid, SPACINGS.len() - 1 - number);
            let gain = if tile.misfit > 0.0 { (told.misfit / tile.misfit).min(1.0) } else { 0.0 };
            let least = told.misfit * gain.powf(to_come as f32 / ago as f32);
            let now = self.loss(part, &told, told.misfit, SPACINGS[number]);
            let decided = now <= allowed;
            let finest = SPACINGS[SPACINGS.len() - 1];
            let hopeless = !decided && self.loss(part, &told, least, finest) > HOPELESS * self.tolerance;
            let tile = &mut part.tiles[told.tile];
            tile.misfit = told.misfit;
            tile.loss = now;
            tile.decided = decided;
            tile.grid = match (decided, hopeless) {
                (true, _) => number,
                (false, true) => SPACINGS.len(),
                (false, false) => number + 1,
            };
        }
    }

    /// What the slabs of a grid may lose, as a share of the tolerance, by what its nodes are likely to lose of some tiles; nothing if most
    /// of those are likely to ask for a finer one all the same.
    fn share(&self, part: &Part, number: usize, tiles: &[usize]) -> Option<f64> {
        if tiles.is_empty() {
            return None;
        }
        if self.one.is_some() {
            // There are no slabs.
            return Some(0.0);
        }
        let of_tile = |&i: &usize| {
            let tile = &part.tiles[i];
            (tile.loss > 0.0).then(|| (tile.loss, number + 1 - tile.grid))
        };
        let (left, tolerance) = (self.left / self.tolerance, self.tolerance);
        let outlook = Outlook { sample: self.sample, trust: self.loss, left, tolerance };
        outlook.slabs(number, &tiles.iter().map(of_tile).collect::<Vec<_>>())
    }

    /// Draws the nodes of a grid for some tiles.
    fn draw_nodes(&self, part: &mut Part, number: usize, tiles: &[usize], ordered: &Ordered) -> (Grid, Film) {
        let grid = Grid::new(part.view, SPACINGS[number]);
        let fine = grid.view(part.view);
        let mask = part.mask(&grid, tiles);
        let prepared = self.gas.prepare(&fine, ordered);
        let spans = part.spans(&grid, tiles.iter().copied());
        let plane = || self.spare.plane(grid.size[0], &spans);
        let color = [plane(), plane(), plane()];
        let mut film = Film { size: fine.size, color, transmittance: plane(), ..Film::new([0, 0]) };
        let error = (part.shares[number] * self.tolerance) as f32;
        let canvas = Canvas { film: &mut film, opaque: None, band: BAND, mask: Some(&mask), bare: true, error };
        let work = self.gas.draw(&fine, &prepared, canvas, self.level);
        part.slabs[number] = work.error;
        part.work.add(&work);
        (grid, film)
    }

    /// What nodes tell of some tiles.
    fn ask(&self, part: &Part, (grid, film): (&Grid, &Film), tiles: &[usize]) -> Vec<Told> {
        let misfit = self.misfit(part, grid, film, &part.spans(grid, tiles.iter().copied()));
        let told = tiles.iter().map(|&tile| {
            let [x, y] = part.pixels(tile);
            // First and last node that pixels lie between, along both axes.
            let [columns, rows] = [0, 1].map(|axis| {
                let [first, last] = [x, y][axis];
                [grid.cell(axis, first), grid.cell(axis, last) + 1]
            });
            let extent = |plane: &[f32], around: usize| {
                let mut extent = Extent::NOTHING;
                for row in rows[0] - around..=rows[1] + around {
                    extent.hold(&plane[row * grid.size[0]..][columns[0] - around..=columns[1] + around]);
                }
                extent.ends()
            };
            let [[_, misfit], [_, through]] = [extent(&misfit, 0), extent(&film.transmittance, 0)];
            let [least, _] = extent(&film.transmittance, 1);
            Told { tile, misfit, share: misfit::share(self.loss, least, self.one.is_some()), through }
        });
        let told = told.collect();
        self.spare.give([misfit]);
        told
    }

    /// What may be lost from nodes of a distance to pixels of a tile, if that is by how much they differ from what neighbours make of
    /// them.
    fn loss(&self, part: &Part, told: &Told, misfit: f32, spacing: usize) -> f64 {
        let (own, misfit) = (told.share * f64::from(misfit), f64::from(misfit));
        // Nodes tell of rims too, but not of each; on fine grids a rim passes so many that they tell of the worst.
        let rims = part.rims.loss(told.tile, spacing, told.through, self.spreads);
        if spacing <= FINE { own.max(rims.min(RIM * misfit)) } else { (own * own + rims * rims).sqrt() }
    }

    /// By how much each node differs from what its neighbours of twice the distance would make of it: the largest over
    /// the channels in front of what is behind, and the transmittance.
    fn misfit(&self, part: &Part, grid: &Grid, film: &Film, spans: &[Range<usize>]) -> Plane<f32> {
        let background = self.scene.background;
        let width = grid.size[0];
        // Only what is asked is touched.
        let places = || spans.iter().enumerate().map(|(y, span)| y * width + span.start..y * width + span.end);
        let mut planes: Vec<Plane<f32>> = Vec::new();
        let plane = || self.spare.plane(width, spans);
        if let Some(color) = self.one {
            // Everything follows from the transmittance.
            let behind = self
                .range
                .iter()
                .zip(&background)
                .flat_map(|(&[low, high], &at)| if part.opaque.is_some() { [low, high] } else { [at; 2] });
            let colors = color.iter().flat_map(|&color| [color; 2]);
            let spread = colors.zip(behind).map(|(a, b)| (a - b).abs()).fold(1.0, f32::max);
            let mut plane = plane();
            for place in places() {
                let seen = plane[place.clone()].iter_mut().zip(&film.transmittance[place]);
                seen.for_each(|(out, &through)| *out = spread * through);
            }
            planes.push(plane);
        } else {
            for ((light, [low, high]), behind) in film.color.iter().zip(self.range).zip(background) {
                for behind in if part.opaque.is_some() { vec![low, high] } else { vec![behind] } {
                    let mut plane = plane();
                    for place in places() {
                        let seen = light[place.clone()].iter().zip(&film.transmittance[place.clone()]);
                        let out = plane[place].iter_mut().zip(seen);
                        out.for_each(|(out, (&light, &through))| *out = light + through * behind);
                    }
                    planes.push(plane);
                }
            }
        }
        let through = self.one.is_none().then_some(&film.transmittance);
        let seen: Vec<&[f32]> = planes.iter().chain(through).map(|plane| &plane[..]).collect();
        let mut misfit = plane();
        dispatch(self.level, Misfit { planes: &seen, width, spans, out: &mut misfit });
        self.spare.give(planes);
        misfit
    }
}
