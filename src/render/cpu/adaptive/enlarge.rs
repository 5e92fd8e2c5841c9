//! From nodes to pixels: a cubic B-spline, row by row.

use super::codes::codes;
use super::grid::Grid;
use super::stretch::Stretch;
use super::{Hue, Job, MARGIN, Part, SPACINGS};
use crate::picture::{Film, Plane, Rgba8};
use crate::render::cpu::encode::{self, Tones};
use crate::render::cpu::simd::{Simd, WithSimd, dispatch};
use crate::render::cpu::tile::{self, TILE};
use crate::render::opaque::OpaqueLayer;
use crate::scene::Rgb;
use rayon::prelude::*;
use std::ops::Range;

impl Job<'_> {
    /// Takes the nodes of the tiles that are content with a grid to their pixels: those of the film or, with a frame of 8 bits,
    /// that frame's, to which the other tiles of the film go too.
    pub fn enlarge(&self, part: &Part, film: &mut Film, encoded: Option<&mut Rgba8>) {
        // What is seen is as smooth as light and transmittance, and spares the one plane more, where nothing else is asked.
        let seen = encoded.is_some() && part.opaque.is_none();
        let mut coefficients: Vec<Option<[Plane<f32>; 4]>> = part
            .grids
            .iter()
            .enumerate()
            .map(|(number, nodes)| {
                let used = |&i: &usize| part.tiles[i].decided && part.tiles[i].grid == number;
                let used = || (0..part.tiles.len()).filter(used);
                let (grid, film) = nodes.as_ref().filter(|_| used().next().is_some())?;
                let spans = part.spans(grid, used());
                let [red, green, blue] = &film.color;
                let planes = [red, green, blue, &film.transmittance];
                let count = if self.one.is_some() { 3..4 } else { 0..4 };
                let mut out = [0; 4].map(Plane::new);
                out[count.clone()].par_iter_mut().zip(&planes[count]).for_each(|(out, plane)| {
                    *out = self.coefficients(plane, grid.size[0], &spans);
                });
                if let ([light @ .., through], true) = (&mut out, seen && self.one.is_none()) {
                    for (light, behind) in light.iter_mut().zip(self.scene.background) {
                        for (y, span) in spans.iter().enumerate() {
                            let row = y * grid.size[0] + span.start..y * grid.size[0] + span.end;
                            let pairs = light[row.clone()].iter_mut().zip(&through[row]);
                            pairs.for_each(|(light, &through)| *light += through * behind);
                        }
                    }
                }
                Some(out)
            })
            .collect();
        let weights: Vec<[Vec<f32>; 4]> = part
            .grids
            .iter()
            .map(|nodes| nodes.as_ref().map_or_else(Default::default, |(grid, _)| weights(grid)))
            .collect();
        let rows: Vec<Option<Rows>> =
            part.grids.iter().map(|nodes| nodes.as_ref().map(|(grid, _)| Rows::new(grid))).collect();
        let width = film.size[0];
        let bands: Vec<_> = tile::bands(width, TILE, &mut film.color, &mut film.transmittance).collect();
        let mut encoded: Vec<&mut [[u8; 4]]> =
            encoded.map_or_else(Vec::new, |frame| frame.pixels.chunks_mut(width as usize * TILE).collect());
        encoded.resize_with(bands.len(), Default::default);
        bands.into_par_iter().zip(encoded).enumerate().for_each(|(row, (planes, bytes))| {
            let band = Enlarge {
                job: self,
                part,
                coefficients: &coefficients,
                weights: &weights,
                rows: &rows,
                row,
                planes,
                bytes,
                seen,
            };
            dispatch(self.level, band);
        });
        self.spare.give(coefficients.drain(..).flatten().flatten());
    }

    /// The coefficients of a spline through nodes, in the spans of their rows.
    fn coefficients(&self, nodes: &[f32], width: usize, spans: &[Range<usize>]) -> Plane<f32> {
        let [mut across, mut out] = [(); 2].map(|()| self.spare.plane(width, spans));
        spline_coefficients(nodes, width, spans, &mut across, &mut out);
        self.spare.give([across]);
        out
    }
}

/// The coefficients of a cubic B-spline through nodes, from two neighbours on each side alone, so that nodes that were not drawn
/// are not asked: the inverse of the spline's own smoothing but for terms of the sixth order. `across`: room for those along x.
fn spline_coefficients(nodes: &[f32], width: usize, spans: &[Range<usize>], across: &mut [f32], out: &mut [f32]) {
    // c = v - d2/6 + d4/36 with the second and fourth differences of v, along x and then along y; at the edges of what is asked,
    // which no pixel needs, the nodes themselves.
    let coefficient = |[far, near, here]: [f32; 3]| (54.0 * here - 10.0 * near + far) / 36.0;
    for (y, span) in spans.iter().enumerate().filter(|(_, span)| !span.is_empty()) {
        let row = y * width + span.start..y * width + span.end;
        let (out, row) = (&mut across[row.clone()], &nodes[row]);
        out.copy_from_slice(row);
        for (out, five) in out[2..].iter_mut().zip(row.windows(5)) {
            *out = coefficient([five[0] + five[4], five[1] + five[3], five[2]]);
        }
    }
    for (y, span) in spans.iter().enumerate().skip(2).take(spans.len().saturating_sub(4)) {
        let row = |y: usize| &across[y * width..][span.clone()];
        let (far, near) = (row(y - 2).iter().zip(row(y + 2)), row(y - 1).iter().zip(row(y + 1)));
        for (out, (((a, e), (b, d)), &c)) in out[y * width..][span.clone()].iter_mut().zip(far.zip(near).zip(row(y))) {
            *out = coefficient([a + e, b + d, c]);
        }
    }
}

/// Weights of the four nodes around a point at a share `t` of the way from the second to the third.
pub(super) fn spline(t: f64) -> [f64; 4] {
    let u = 1.0 - t;
    [
        u * u * u / 6.0,
        (3.0 * t - 6.0) * t * t / 6.0 + 4.0 / 6.0,
        (3.0 * u - 6.0) * u * u / 6.0 + 4.0 / 6.0,
        t * t * t / 6.0,
    ]
}

/// The weights along x of the pixels from the first of a cell on, as many as a tile and a cell have.
fn weights(grid: &Grid) -> [Vec<f32>; 4] {
    let first = (grid.origin[0] - 0.5).ceil() + 0.5 - grid.origin[0];
    let mut out: [Vec<f32>; 4] = Default::default();
    for pixel in 0..TILE + grid.spacing + 16 {
        let weights = spline((first + (pixel % grid.spacing) as f64) / grid.spacing as f64);
        for (out, weight) in out.iter_mut().zip(weights) {
            out.push(weight as f32);
        }
    }
    out
}

/// Pixels of the cells that a tile may touch, and a vector more.
const SPREAD: usize = 2 * TILE + 4 * SPACINGS[0] + 16;

/// A tile of a row that takes its pixels from a grid.
pub struct Column<'a> {
    pub grid: &'a Grid,
    /// Place of the grid in [`SPACINGS`].
    pub number: usize,
    pub coefficients: &'a [Plane<f32>; 4],
    pub weights: &'a [Vec<f32>; 4],
    /// First pixel, and how many.
    pub x: usize,
    pub count: usize,
    /// The node before the first pixel, and how many pixels that is from the first of its cell.
    pub cell: usize,
    pub skipped: usize,
    /// Nodes around the pixels.
    pub nodes: usize,
    /// The row of the grid before the first row of pixels.
    pub first: usize,
    /// The next row of the grid that the lines do not hold.
    pub next: usize,
    /// Of each plane the four rows of the grid around a row of pixels, taken along x to the pixels; by their numbers modulo 4.
    pub lines: &'a mut [[Line; 4]],
    /// The gas's colour, if it has one: then all follows from the transmittance.
    pub one: Option<Rgb>,
    /// Whether the first three planes are what is seen, the background included: then the fourth is not asked.
    pub seen: bool,
    /// Codes of 8 bits where nothing but background is behind the gas, if polynomials follow them; then the lines hold the places
    /// at which those are taken.
    pub tones: Option<Tones>,
}

/// A row of a tile's pixels, by so many that every vector divides them.
pub type Line = [[f32; 16]; TILE / 16];

impl Column<'_> {
    /// The planes that its pixels are made of.
    pub fn planes(&self) -> Range<usize> {
        match (self.one, self.seen) {
            (Some(_), _) => 3..4,
            (None, true) => 0..3,
            (None, false) => 0..4,
        }
    }

    /// Takes the grid's rows before `end` along x to the pixels. `spread` is room for a row of coefficients, each as often as a
    /// cell has pixels.
    #[inline(always)]
    fn advance<S: Simd>(&mut self, s: S, end: usize, spread: &mut [f32; SPREAD]) {
        let spacing = self.grid.spacing;
        let planes = self.planes();
        while self.next < end {
            let source = self.lines.iter_mut().zip(&self.coefficients[planes.clone()]);
            for (channel, (lines, plane)) in source.enumerate() {
                // The weights add up to 1: what is linear in the sum is so in its terms.
                let tone = self.tones.as_ref().map(|tones| &tones.channels[channel]);
                let (scale, offset) = tone.map_or((1.0, 0.0), |tone| (tone.scale, tone.offset));
                let (scale, offset) = (s.splat(scale), s.splat(offset));
                let row = &plane[self.next * self.grid.size[0] + self.cell - 1..][..self.nodes];
                let line = lines[self.next % 4].as_flattened_mut();
                if self.skipped == 0 && spacing.is_multiple_of(S::LANES) {
                    // A vector lies within a cell, and is the same part of it in each.
                    for at in (0..spacing).step_by(S::LANES) {
                        let [a, b, c, d] = self.weights.each_ref();
                        let weights = [s.load(&a[at..]), s.load(&b[at..]), s.load(&c[at..]), s.load(&d[at..])];
                        for (cell, nodes) in line.chunks_exact_mut(spacing).zip(row.windows(4)) {
                            let mut sum = s.mul(weights[0], s.splat(nodes[0]));
                            for (&weight, &node) in weights[1..].iter().zip(&nodes[1..]) {
                                sum = s.mul_add(weight, s.splat(node), sum);
                            }
                            s.store(s.mul_add(sum, scale, offset), &mut cell[at..]);
                        }
                    }
                    continue;
                }
                for (cell, &value) in spread.chunks_exact_mut(spacing).zip(row) {
                    cell.fill(value);
                }
                for first in (0..self.count).step_by(S::LANES) {
                    let from = self.skipped + first;
                    let mut sum = s.mul(s.load(&self.weights[0][from..]), s.load(&spread[from..]));
                    for i in 1..4 {
                        let weight = s.load(&self.weights[i][from..]);
                        sum = s.mul_add(weight, s.load(&spread[from + i * spacing..]), sum);
                    }
                    s.store(s.mul_add(sum, scale, offset), &mut line[first..]);
                }
            }
            self.next += 1;
        }
    }

    /// The lines of one of [`Column::planes`], of the four rows of the grid around a row of pixels.
    #[inline(always)]
    pub fn around(&self, plane: usize, row: &Row) -> [&Line; 4] {
        let (lines, row) = (&self.lines[plane - self.planes().start], self.first + row.beyond);
        [&lines[(row + 3) % 4], &lines[row % 4], &lines[(row + 1) % 4], &lines[(row + 2) % 4]]
    }
}

/// A vector of pixels, number `first` of the sixteen with number `at`, by the weights of the four rows around it.
#[inline(always)]
pub fn across<S: Simd>(s: S, rows: &[&Line; 4], weights: &[S::F; 4], [at, first]: [usize; 2]) -> S::F {
    let mut sum = s.mul(weights[0], s.load(&rows[0][at][first..]));
    for i in 1..4 {
        sum = s.mul_add(weights[i], s.load(&rows[i][at][first..]), sum);
    }
    sum
}

/// Rows of pixels of a tile that are drawn into 8 bits before those of the tile beside it.
const BLOCK: usize = 16;

/// The same where they are drawn to the planes of a film, four of them and as many bytes a pixel each: memory is written fastest in
/// long runs.
const FILM_BLOCK: usize = 2;

/// A row of a tile's pixels over a grid.
#[derive(Clone, Copy)]
pub struct Row {
    /// How many rows of the grid the one before it is below that of the tile's first row.
    pub beyond: usize,
    /// The share of the way to the next row of the grid that it has gone.
    pub share: f64,
}

impl Row {
    /// The weights of the four rows around it.
    pub fn weights(&self) -> [f32; 4] {
        spline(self.share).map(|weight| weight as f32)
    }
}

/// The rows of pixels of a tile: the same for all, since distances of nodes divide its side.
struct Rows {
    rows: Vec<Row>,
    /// The stretches that begin in each [`BLOCK`] of them and end there too.
    blocks: Vec<Vec<Stretch>>,
}

impl Rows {
    fn new(grid: &Grid) -> Self {
        let row = |row| {
            let cell = grid.cell(1, row);
            let share = (row as f64 + 0.5 - grid.origin[1]) * grid.inverse - (cell - MARGIN) as f64;
            Row { beyond: cell - grid.cell(1, 0), share }
        };
        let rows: Vec<Row> = (0..TILE).map(row).collect();
        let mut first = 0;
        let mut stretch = |rows: &[Row]| {
            first += rows.len();
            Stretch::new(first - rows.len(), rows.len(), rows[0].share, grid.inverse)
        };
        let stretches = |block: &[Row]| block.chunk_by(|a, b| a.beyond == b.beyond).map(&mut stretch).collect();
        let blocks = rows.chunks(BLOCK).map(stretches).collect();
        Self { rows, blocks }
    }
}

/// What light is put over.
#[derive(Clone, Copy)]
pub struct Behind<F> {
    color: [F; 3],
    /// Least and greatest of what a channel can be.
    range: [[F; 2]; 3],
}

/// Writes the pixels of a row of tiles from their grids.
struct Enlarge<'a, 'b> {
    job: &'a Job<'a>,
    part: &'a Part<'a>,
    coefficients: &'a [Option<[Plane<f32>; 4]>],
    weights: &'a [[Vec<f32>; 4]],
    /// Of each grid the rows of a whole tile; the last tiles of a picture may have fewer.
    rows: &'a [Option<Rows>],
    row: usize,
    planes: [&'b mut [f32]; 4],
    /// The pixels of 8 bits, if they are wanted: then the planes hold tiles drawn by pixels alone.
    bytes: &'b mut [[u8; 4]],
    seen: bool,
}

impl WithSimd for Enlarge<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, s: S) {
        let first = self.row * self.part.across;
        // Neighbours at once.
        let tiles = &self.part.tiles[first..first + self.part.across];
        let mut next = first;
        for run in tiles.chunk_by(|a, b| a.is_empty == b.is_empty) {
            if run[0].is_empty {
                self.empty(next..next + run.len());
            }
            next += run.len();
        }
        let planes = if self.job.one.is_some() { 1 } else { 4 };
        let mut lines = vec![[[[0.0; 16]; TILE / 16]; 4]; planes * self.part.across];
        let mut columns: Vec<Column> = (first..first + self.part.across)
            .zip(lines.chunks_exact_mut(planes))
            .filter_map(|(tile, lines)| self.column(tile, lines))
            .collect();
        let [_, y] = self.part.pixels(first);
        if !self.bytes.is_empty() {
            for column in columns.iter_mut().filter(|_| self.part.opaque.is_none()) {
                column.tune(s, column.grid.cell(1, y[1]) + 2, self.job.scene.background);
            }
            for tile in (first..first + self.part.across).filter(|&tile| self.part.tiles[tile].is_open()) {
                self.encode(s, tile);
            }
        }
        let mut spread = [0.0; SPREAD];
        let splat = |color: Rgb| [s.splat(color[0]), s.splat(color[1]), s.splat(color[2])];
        let [r, g, b] = self.job.range.map(|[low, high]| [s.splat(low), s.splat(high)]);
        let behind = Behind { color: splat(self.job.scene.background), range: [r, g, b] };
        // Rows of many tiles, one after the other: the rows of one are the width of the picture apart, and caches do not like
        // that; as many as keep their lines in the first of them.
        for columns in columns.chunks_mut(if self.job.one.is_some() { 16 } else { 4 }) {
            let is_coded = !self.bytes.is_empty() && self.part.opaque.is_none();
            let height = if is_coded { BLOCK } else { FILM_BLOCK };
            let end = y[1] - y[0] + 1;
            for block in (0..end).step_by(height) {
                for column in columns.iter_mut() {
                    let Some(rows) = &self.rows[column.number] else { continue };
                    if is_coded {
                        for stretch in &rows.blocks[block / BLOCK] {
                            let end = end.min(stretch.first + stretch.count);
                            if stretch.first >= end {
                                break;
                            }
                            let rows = &rows.rows[stretch.first..end];
                            column.advance(s, column.first + rows[0].beyond + 3, &mut spread);
                            self.encode_rows(s, column, rows, stretch, &behind);
                        }
                    } else {
                        for (i, row) in rows.rows.iter().enumerate().take(end).skip(block).take(height) {
                            column.advance(s, column.first + row.beyond + 3, &mut spread);
                            self.line(s, column, row, &behind, [y[0] + i, i]);
                        }
                    }
                }
            }
        }
    }
}

impl<'a> Enlarge<'a, '_> {
    /// A tile's column, if it takes its pixels from a grid.
    fn column<'c>(&self, tile: usize, lines: &'c mut [[Line; 4]]) -> Option<Column<'c>>
    where
        'a: 'c,
    {
        let [x, y] = self.part.pixels(tile);
        let tile = &self.part.tiles[tile];
        let (grid, _) = self.part.grids.get(tile.grid).filter(|_| tile.decided)?.as_ref()?;
        let (cell, first) = (grid.cell(0, x[0]), grid.cell(1, y[0]));
        Some(Column {
            grid,
            number: tile.grid,
            coefficients: self.coefficients[tile.grid].as_ref()?,
            weights: &self.weights[tile.grid],
            x: x[0],
            count: x[1] - x[0] + 1,
            cell,
            skipped: (x[0] as isize - grid.first_pixel(0, cell)) as usize,
            nodes: grid.cell(0, x[1]) - cell + 4,
            first,
            next: first - 1,
            lines,
            seen: self.seen,
            tones: None,
            one: match tile.hue {
                Hue::One(color) => Some(color),
                Hue::Nothing | Hue::Several => self.job.one,
            },
        })
    }

    /// Encodes a tile of the planes.
    #[inline(always)]
    fn encode<S: Simd>(&mut self, s: S, tile: usize) {
        let [x, y] = self.part.pixels(tile);
        let width = self.part.view.size[0] as usize;
        for row in 0..=y[1] - y[0] {
            let line = row * width + x[0]..row * width + x[1] + 1;
            let [red, green, blue, _] = self.planes.each_ref().map(|plane| &plane[line.clone()]);
            encode::row(s, [red, green, blue], &mut self.bytes[line]);
        }
    }

    /// What is behind tiles of the row without gas.
    fn empty(&mut self, tiles: Range<usize>) {
        let [x, y] = self.part.pixels(tiles.start);
        let x = [x[0], self.part.pixels(tiles.end - 1)[0][1]];
        let width = self.part.view.size[0] as usize;
        let background = self.job.scene.background;
        for row in y[0]..=y[1] {
            let [line, film] = [row, row - y[0]].map(|row| row * width + x[0]..row * width + x[1] + 1);
            let layer = self.part.opaque.map(|layer| (&layer.depth[line.clone()], &layer.color[line.clone()]));
            if !self.bytes.is_empty() {
                let bytes = &mut self.bytes[film];
                bytes.fill(Rgba8::pixel(background));
                for (out, (&depth, &color)) in
                    bytes.iter_mut().zip(layer.into_iter().flat_map(|(d, c)| d.iter().zip(c)))
                {
                    if depth < f64::INFINITY {
                        *out = Rgba8::pixel(color);
                    }
                }
                continue;
            }
            let hits = layer.map_or(0, |(depths, _)| depths.iter().filter(|&&depth| depth < f64::INFINITY).count());
            if hits < line.len() {
                for (plane, value) in self.planes.iter_mut().zip(background.into_iter().chain([1.0])) {
                    plane[film.clone()].fill(value);
                }
            }
            let Some((depths, colors)) = layer.filter(|_| hits > 0) else { continue };
            if hits == depths.len() {
                // Plane by plane, without a question per pixel.
                for (channel, plane) in self.planes[..3].iter_mut().enumerate() {
                    plane[film.clone()].iter_mut().zip(colors).for_each(|(out, color)| *out = color[channel]);
                }
                self.planes[3][film].fill(0.0);
            } else {
                for ((&depth, color), film) in depths.iter().zip(colors).zip(film) {
                    if depth < f64::INFINITY {
                        for (plane, &value) in self.planes.iter_mut().zip(color.iter().chain(&[0.0])) {
                            plane[film] = value;
                        }
                    }
                }
            }
        }
    }

    /// Encodes rows of a tile with nothing but background behind them, those of a stretch or the first of them.
    #[inline(always)]
    fn encode_rows<S: Simd>(&mut self, s: S, column: &Column, rows: &[Row], stretch: &Stretch, behind: &Behind<S::F>) {
        let width = self.part.view.size[0] as usize;
        let bytes = &mut self.bytes[stretch.first * width + column.x..];
        if column.count == TILE {
            codes(s, column, rows, stretch, behind, bytes, width);
            return;
        }
        let mut room = [[0; 4]; TILE * BLOCK];
        codes(s, column, rows, stretch, behind, &mut room, TILE);
        for (row, bytes) in room.chunks_exact(TILE).zip(bytes.chunks_mut(width)).take(rows.len()) {
            bytes[..column.count].copy_from_slice(&row[..column.count]);
        }
    }

    /// Writes a row of a tile; `numbers` are its own in the picture and in the band.
    #[inline(always)]
    fn line<S: Simd>(&mut self, s: S, column: &Column, row: &Row, behind: &Behind<S::F>, numbers: [usize; 2]) {
        let width = self.part.view.size[0] as usize;
        let [line, film] = numbers.map(|row| row * width + column.x..row * width + column.x + column.count);
        // The surfaces behind the pixels, if there are any.
        let layer =
            self.part.opaque.filter(|layer| layer.depth[line.clone()].iter().any(|&depth| depth < f64::INFINITY));
        self.values(s, column, row, behind, layer, [line.start, film.start]);
        if !self.bytes.is_empty() {
            let [red, green, blue, _] = self.planes.each_ref().map(|plane| &plane[film.clone()]);
            encode::row(s, [red, green, blue], &mut self.bytes[film]);
        }
    }

    /// Writes a row of a tile to the planes; `starts` are its first pixels in the picture and in the band.
    #[inline(always)]
    fn values<S: Simd>(
        &mut self,
        s: S,
        column: &Column,
        row: &Row,
        behind: &Behind<S::F>,
        layer: Option<&OpaqueLayer>,
        [line, film]: [usize; 2],
    ) {
        let planes = self.planes.each_mut().map(|plane| &mut plane[film..film + column.count]);
        let [red, green, blue, through] = planes;
        if let (None, Ok(red), Ok(green), Ok(blue), Ok(through)) = (
            layer,
            (&mut *red).try_into(),
            (&mut *green).try_into(),
            (&mut *blue).try_into(),
            (&mut *through).try_into(),
        ) {
            pixels(s, column, row, behind, [red, green, blue, through]);
            return;
        }
        let mut lanes = [[0.0; TILE]; 4];
        let infinite = [s.splat(f32::NEG_INFINITY), s.splat(f32::INFINITY)];
        let bare = Behind { color: [s.splat(0.0); 3], range: [infinite; 3] };
        pixels(s, column, row, &bare, lanes.each_mut());
        let [light @ .., transmittance] = &lanes;
        for i in 0..column.count {
            let hit = layer.filter(|layer| layer.depth[line + i] < f64::INFINITY);
            let color = hit.map_or(self.job.scene.background, |layer| layer.color[line + i]);
            for (channel, plane) in [&mut *red, &mut *green, &mut *blue].into_iter().enumerate() {
                let [low, high] = self.job.range[channel];
                plane[i] = (light[channel][i] + transmittance[i] * color[channel]).max(low).min(high);
            }
            through[i] = if hit.is_some() { 0.0 } else { transmittance[i] };
        }
    }
}

/// A row of a tile's pixels from the lines of its grid. Sizes of rows are constants, so that no index within them need be checked.
#[inline(always)]
pub fn pixels<S: Simd>(s: S, column: &Column, row: &Row, behind: &Behind<S::F>, out: [&mut [f32; TILE]; 4]) {
    let (zero, one) = (s.splat(0.0), s.splat(1.0));
    let weights = row.weights();
    let down = &[s.splat(weights[0]), s.splat(weights[1]), s.splat(weights[2]), s.splat(weights[3])];
    let [red, green, blue, transmittance] = out;
    // Written out: a closure may become a call.
    let (red, green) = (red.as_chunks_mut::<16>().0, green.as_chunks_mut::<16>().0);
    let (blue, transmittance) = (blue.as_chunks_mut::<16>().0, transmittance.as_chunks_mut::<16>().0);
    // Of one colour all follows from the last plane.
    let first = column.planes().start;
    let rows = [0, 1, 2, 3].map(|plane| column.around(first.max(plane), row));
    let own = column.one.map(|[red, green, blue]| [s.splat(red), s.splat(green), s.splat(blue)]);
    let count = TILE / 16;
    let (red, green, blue) = (&mut red[..count], &mut green[..count], &mut blue[..count]);
    let transmittance = &mut transmittance[..count];
    for at in 0..count {
        for first in (0..16).step_by(S::LANES) {
            let place = [at, first];
            let through = s.min(s.max(across(s, &rows[3], down, place), zero), one);
            let gas = s.sub(one, through);
            s.store(through, &mut transmittance[at][first..]);
            for (channel, out) in [&mut red[at], &mut green[at], &mut blue[at]].into_iter().enumerate() {
                let light = match own {
                    Some(color) => s.mul(gas, color[channel]),
                    None => across(s, &rows[channel], down, place),
                };
                let [low, high] = behind.range[channel];
                let value = s.mul_add(through, behind.color[channel], light);
                s.store(s.min(s.max(value, low), high), &mut out[first..]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Scene};

    /// All tiles have the rows of the first, wherever the grid begins.
    #[test]
    fn rows_are_the_same_in_every_tile() {
        for height in (1..200).chain([1080, 4320]) {
            let camera = Camera::for_tests([8, height]);
            let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
            for spacing in SPACINGS {
                let grid = Grid::new(&scene.views()[0], spacing);
                let rows = Rows::new(&grid).rows;
                for y in 0..height as usize {
                    let (row, first) = (&rows[y % TILE], grid.cell(1, y / TILE * TILE));
                    let share =
                        (y as f64 + 0.5 - grid.origin[1]) / spacing as f64 - (first + row.beyond - MARGIN) as f64;
                    assert_eq!(
                        (first + row.beyond, row.share),
                        (grid.cell(1, y), share),
                        "row {y} of {height}, {spacing}"
                    );
                    assert!((0.0..1.0).contains(&share));
                }
            }
        }
    }

    /// The prefilter is exact for what has no sixth differences: the spline goes through the nodes of a polynomial of the fifth degree.
    #[test]
    fn the_spline_goes_through_nodes() {
        let (width, height) = (13, 11);
        let value = |x: usize, y: usize| {
            let [u, v] = [x as f64 / 6.0 - 1.0, y as f64 / 5.0 - 1.0];
            u.powi(5) - 0.7 * u.powi(4) + 0.3 * u + v.powi(5) + 0.5 * v.powi(4) * u.powi(3)
        };
        let nodes: Vec<f32> = (0..width * height).map(|i| value(i % width, i / width) as f32).collect();
        // Columns beyond the span are not asked.
        let span = 1..width - 1;
        let mut spoiled = nodes.clone();
        spoiled.chunks_mut(width).for_each(|row| (row[0], row[width - 1]) = (f32::NAN, f32::NAN));
        let [mut across, mut out] = [(); 2].map(|()| vec![0.0; width * height]);
        spline_coefficients(&spoiled, width, &vec![span; height], &mut across, &mut out);
        let weights = spline(0.0);
        for y in 3..height - 3 {
            for x in 4..width - 4 {
                let sum: f64 = (0..9)
                    .map(|i| weights[i % 3] * weights[i / 3] * f64::from(out[(y + i / 3 - 1) * width + x + i % 3 - 1]))
                    .sum();
                assert!((sum - value(x, y)).abs() < 3e-6, "{x}, {y}: {sum} for {}", value(x, y));
            }
        }
    }
}
