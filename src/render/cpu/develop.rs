//! From the states of tiles to pixels: those of the film in linear light, or codes of 8 bits.
//!
//! The codes that a tile shows without opaque surfaces are often few, and polynomials follow them ([`Tones`]): of one colour over the
//! transmittance, else over each channel.

use super::composite::Composite;
use super::encode::{Tones, code};
use super::simd::{Simd, WithSimd};
use super::tile::{Band, RUN, TILE, place_of};
use crate::render::opaque::OpaqueLayer;
use crate::scene::Rgb;
use std::marker::PhantomData;

/// What is told of a tile that is done.
#[derive(Clone, Copy)]
pub struct Done {
    /// Whether there are opaque surfaces in it.
    pub walls: bool,
}

/// A tile's pixels.
#[derive(Clone, Copy)]
struct Picture<'a, const R: usize> {
    /// Opaque surfaces, if there are any in it.
    layer: Option<&'a OpaqueLayer>,
    state: &'a [f32],
    /// Its first pixel.
    at: [usize; 2],
    /// Its columns within the picture.
    columns: usize,
}

/// What is the same for all tiles of a view.
#[derive(Clone, Copy)]
pub struct Backdrop<'a> {
    /// Columns of the picture.
    pub width: usize,
    /// Opaque surfaces of the view.
    pub opaque: Option<&'a OpaqueLayer>,
    /// Colour behind everything.
    pub background: Rgb,
    /// The particles' one colour, where they have one.
    pub color: Rgb,
}

/// The job of writing the pixels of tiles side by side that are done, row by row through all of them; `R` rows per register block.
/// It does not depend on the method.
pub struct Develop<'a, 'b, C, const R: usize> {
    /// What is behind them.
    pub backdrop: Backdrop<'a>,
    /// Their band.
    pub band: &'a mut Band<'b>,
    /// The number of the first of them in the band.
    pub first: usize,
    /// Those that are done.
    pub done: &'a [Option<Done>; RUN],
    /// Their states, where the band does not hold them.
    pub own: &'a [f32],
    /// The variant of compositing.
    pub composite: PhantomData<C>,
}

impl<C: Composite, const R: usize> WithSimd for Develop<'_, '_, C, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let Self { backdrop, band, first, done, own, .. } = self;
        let width = backdrop.width;
        let Band { film, bytes, state: states, y: top, .. } = band;
        let rows = film[0].len() / width;
        let mut pictures = [None; RUN];
        let mut tones = [None; RUN];
        for (i, done) in done.iter().enumerate() {
            let Some(done) = done else { continue };
            let left = (first + i) * TILE;
            let picture = Picture::<R> {
                layer: backdrop.opaque.filter(|_| done.walls),
                state: if states.is_empty() { &own[place_of::<C>(i)] } else { &states[place_of::<C>(first + i)] },
                at: [left, *top as usize],
                columns: TILE.min(width - left),
            };
            if !bytes.is_empty() && picture.layer.is_none() {
                tones[i] = picture.tones::<S, C>(s, &backdrop, rows);
            }
            pictures[i] = Some(picture);
        }
        for y in 0..rows {
            for (picture, tones) in pictures.iter().zip(&tones) {
                let Some(picture) = picture else { continue };
                let start = y * width + picture.at[0];
                if bytes.is_empty() {
                    let row = film.each_mut().map(|plane| &mut plane[start..start + picture.columns]);
                    picture.film_row::<S, C>(s, &backdrop, row, y);
                } else {
                    let row = &mut bytes[start..start + picture.columns];
                    match tones {
                        Some(tones) if tones.degree == 2 => picture.toned_row::<S, C, 2>(s, &backdrop, tones, row, y),
                        Some(tones) if tones.degree == 3 => picture.toned_row::<S, C, 3>(s, &backdrop, tones, row, y),
                        Some(tones) => picture.toned_row::<S, C, 4>(s, &backdrop, tones, row, y),
                        None => picture.coded_row::<S, C>(s, &backdrop, row, y),
                    }
                }
            }
        }
    }
}

impl<const R: usize> Picture<'_, R> {
    /// Colour of the gas and transmittance of a vector of pixels, number `over` of row `y`.
    #[inline(always)]
    fn gas<S: Simd, C: Composite>(&self, s: S, backdrop: &Backdrop, over: usize, y: usize) -> ([S::F; 3], S::F) {
        let across = TILE / S::LANES;
        let block_size = C::PLANES * R * S::LANES;
        let place = (y / R * across + over) * block_size + y % R * C::PLANES * S::LANES;
        let memory = &self.state[place..][..C::PLANES * S::LANES];
        let mut registers = [s.splat(0.0); 4];
        for (value, memory) in registers.iter_mut().zip(memory.chunks_exact(S::LANES)) {
            *value = s.load(memory);
        }
        C::finish(s, &registers, &backdrop.color)
    }

    /// What is seen of a vector of pixels, and the transmittance to the background.
    #[inline(always)]
    fn seen<S: Simd, C: Composite>(&self, s: S, backdrop: &Backdrop, over: usize, y: usize) -> ([S::F; 3], S::F) {
        let (color, transmittance) = self.gas::<S, C>(s, backdrop, over, y);
        let [red, green, blue] = backdrop.background;
        let mut behind = [s.splat(red), s.splat(green), s.splat(blue)];
        let mut through = transmittance;
        if let Some(layer) = self.layer {
            let left = over * S::LANES;
            let lanes = S::LANES.min(self.columns - left);
            let row = (self.at[1] + y) * backdrop.width + self.at[0] + left;
            let mut colors = [[0.0f32; 16]; 3];
            let mut clear = [1.0f32; 16];
            for lane in 0..S::LANES {
                let hit = lane < lanes && layer.depth[row + lane] < f64::INFINITY;
                let color = if hit { layer.color[row + lane] } else { backdrop.background };
                for (plane, value) in colors.iter_mut().zip(color) {
                    plane[lane] = value;
                }
                clear[lane] = if hit { 0.0 } else { 1.0 };
            }
            behind = [s.load(&colors[0]), s.load(&colors[1]), s.load(&colors[2])];
            through = s.mul(transmittance, s.load(&clear));
        }
        let mut seen = color;
        for (seen, behind) in seen.iter_mut().zip(behind) {
            *seen = s.mul_add(transmittance, behind, *seen);
        }
        (seen, through)
    }

    /// Writes row `y` to that of the film.
    #[inline(always)]
    fn film_row<S: Simd, C: Composite>(&self, s: S, backdrop: &Backdrop, mut film: [&mut [f32]; 4], y: usize) {
        for (over, left) in (0..self.columns).step_by(S::LANES).enumerate() {
            let ([red, green, blue], through) = self.seen::<S, C>(s, backdrop, over, y);
            for (plane, value) in film.iter_mut().zip([red, green, blue, through]) {
                let plane = &mut plane[left..];
                if plane.len() >= S::LANES {
                    s.store(value, plane);
                } else {
                    let mut last = [0.0f32; 16];
                    s.store(value, &mut last);
                    plane.copy_from_slice(&last[..plane.len()]);
                }
            }
        }
    }

    /// Writes the codes of row `y`.
    #[inline(always)]
    fn coded_row<S: Simd, C: Composite>(&self, s: S, backdrop: &Backdrop, bytes: &mut [[u8; 4]], y: usize) {
        for (over, bytes) in bytes.chunks_mut(S::LANES).enumerate() {
            let ([red, green, blue], _) = self.seen::<S, C>(s, backdrop, over, y);
            store(s, [code(s, red), code(s, green), code(s, blue)], bytes);
        }
    }

    /// The same by polynomials of a degree.
    #[inline(always)]
    fn toned_row<S: Simd, C: Composite, const DEGREE: usize>(
        &self,
        s: S,
        backdrop: &Backdrop,
        tones: &Tones,
        bytes: &mut [[u8; 4]],
        y: usize,
    ) {
        for (pair, bytes) in bytes.chunks_mut(2 * S::LANES).enumerate() {
            // Of each channel the places of two vectors.
            let mut places = [[s.splat(0.0); 2]; 3];
            for half in 0..2 {
                let over = 2 * pair + half;
                let values = if C::PLANES == 1 {
                    [self.gas::<S, C>(s, backdrop, over, y).1; 3]
                } else {
                    self.seen::<S, C>(s, backdrop, over, y).0
                };
                for ((places, value), tone) in places.iter_mut().zip(values).zip(&tones.channels) {
                    places[half] = s.mul_add(value, s.splat(tone.scale), s.splat(tone.offset));
                }
            }
            let mut codes = [s.splat_word(0); 3];
            for ((code, [a, b]), tone) in codes.iter_mut().zip(places).zip(&tones.channels) {
                *code = tone.at::<S, DEGREE>(s, s.words(a, b));
            }
            if bytes.len() == 2 * S::LANES {
                s.store_words(codes, bytes);
            } else {
                let mut last = [[0; 4]; 32];
                s.store_words(codes, &mut last);
                bytes.copy_from_slice(&last[..bytes.len()]);
            }
        }
    }

    /// How to encode its first `rows` rows, if polynomials follow the codes; there are no opaque surfaces.
    #[inline(always)]
    fn tones<S: Simd, C: Composite>(&self, s: S, backdrop: &Backdrop, rows: usize) -> Option<Tones> {
        let mut low = [s.splat(f32::INFINITY); 3];
        let mut high = [s.splat(f32::NEG_INFINITY); 3];
        // Beyond the edges of the picture there is no gas, which is seldom far from what is at them.
        for y in 0..rows.next_multiple_of(R) {
            for over in 0..self.columns.div_ceil(S::LANES) {
                let values = if C::PLANES == 1 {
                    [self.gas::<S, C>(s, backdrop, over, y).1; 3]
                } else {
                    self.seen::<S, C>(s, backdrop, over, y).0
                };
                // What is no number is passed over.
                for ((low, high), value) in low.iter_mut().zip(&mut high).zip(values) {
                    *low = s.min(value, *low);
                    *high = s.max(value, *high);
                }
            }
        }
        let mut intervals = [[0.0; 2]; 3];
        for (interval, (low, high)) in intervals.iter_mut().zip(low.into_iter().zip(high)) {
            *interval = [s.reduce_min(low), s.reduce_max(high)];
        }
        let (color, background) = (backdrop.color, backdrop.background);
        if C::PLANES == 1 {
            let lines = [0, 1, 2].map(|c| [color[c], background[c] - color[c]]);
            Tones::new(s, [intervals[0]; 3], lines)
        } else {
            Tones::new(s, intervals, [[0.0, 1.0]; 3])
        }
    }
}

/// Writes a vector of codes to at most as many pixels.
#[inline(always)]
fn store<S: Simd>(s: S, codes: [S::F; 3], bytes: &mut [[u8; 4]]) {
    if bytes.len() == S::LANES {
        s.store_rgba8(codes, bytes);
    } else {
        let mut last = [[0; 4]; 16];
        s.store_rgba8(codes, &mut last);
        bytes.copy_from_slice(&last[..bytes.len()]);
    }
}
