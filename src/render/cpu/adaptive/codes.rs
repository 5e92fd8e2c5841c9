//! Pixels of 8 bits from the lines of a grid.
//!
//! What is seen in a tile spans few of the codes, and a polynomial follows them ([`Tones`]): of one colour over the
//! transmittance, else over what is seen of each channel. Where none does, pixels are made in linear light and then encoded.

use super::enlarge::{Behind, Column, Row, across, pixels};
use super::extent::Extent;
use super::stretch::Stretch;
use crate::render::cpu::encode::{self, Tones};
use crate::render::cpu::simd::Simd;
use crate::render::cpu::tile::TILE;
use crate::scene::Rgb;

impl Column<'_> {
    /// Finds how to encode the pixels, from bounds of what the planes can be: a B-spline stays within its coefficients. The
    /// rows of the grid that count go from the next to `last`.
    #[inline(always)]
    pub fn tune<S: Simd>(&mut self, s: S, last: usize, background: Rgb) {
        let mut hulls = [[0.0f32, 1.0]; 3];
        for (hull, plane) in hulls.iter_mut().zip(&self.coefficients[self.planes()]) {
            let mut extent = Extent::NOTHING;
            for row in self.next..=last {
                extent.hold(&plane[row * self.grid.size[0] + self.cell - 1..][..self.nodes]);
            }
            *hull = extent.ends();
        }
        self.tones = match self.one {
            Some(color) => {
                let lines = [0, 1, 2].map(|c| [color[c], background[c] - color[c]]);
                Tones::new(s, [hulls[0]; 3], lines)
            }
            None => Tones::new(s, hulls, [[0.0, 1.0]; 3]),
        };
    }
}

/// Encodes rows of a tile's pixels with nothing but background behind them, those of a stretch or the first of them, each `stride`
/// pixels after the other.
#[inline(always)]
pub fn codes<S: Simd>(
    s: S,
    column: &Column,
    rows: &[Row],
    stretch: &Stretch,
    behind: &Behind<S::F>,
    out: &mut [[u8; 4]],
    stride: usize,
) {
    match (&column.tones, column.one) {
        (Some(tones), Some(_)) => match tones.degree {
            2 => toned::<S, 1, 2>(s, column, rows, stretch, tones, out, stride),
            3 => toned::<S, 1, 3>(s, column, rows, stretch, tones, out, stride),
            _ => toned::<S, 1, 4>(s, column, rows, stretch, tones, out, stride),
        },
        (Some(tones), None) => match tones.degree {
            2 => toned::<S, 3, 2>(s, column, rows, stretch, tones, out, stride),
            3 => toned::<S, 3, 3>(s, column, rows, stretch, tones, out, stride),
            _ => toned::<S, 3, 4>(s, column, rows, stretch, tones, out, stride),
        },
        (None, _) => {
            for (row, out) in rows.iter().zip(out.chunks_mut(stride)) {
                let mut lanes = [[0.0; TILE]; 4];
                if column.one.is_some() {
                    pixels(s, column, row, behind, lanes.each_mut());
                } else {
                    seen(s, column, row, &mut lanes);
                }
                encode::row(s, [&lanes[0], &lanes[1], &lanes[2]], &mut out[..TILE]);
            }
        }
    }
}

/// A row of what is seen, in linear light.
#[inline(always)]
fn seen<S: Simd>(s: S, column: &Column, row: &Row, lanes: &mut [[f32; TILE]; 4]) {
    let weights = row.weights();
    let weights = [s.splat(weights[0]), s.splat(weights[1]), s.splat(weights[2]), s.splat(weights[3])];
    for (channel, lanes) in lanes.iter_mut().enumerate().take(3) {
        let lines = column.around(channel, row);
        for (at, lanes) in lanes.as_chunks_mut::<16>().0.iter_mut().enumerate() {
            for first in (0..16).step_by(S::LANES) {
                s.store(across(s, &lines, &weights, [at, first]), &mut lanes[first..]);
            }
        }
    }
}

/// The same by polynomials of a degree, from so many planes: one for all channels, or one for each.
#[inline(always)]
fn toned<S: Simd, const PLANES: usize, const DEGREE: usize>(
    s: S,
    column: &Column,
    rows: &[Row],
    stretch: &Stretch,
    tones: &Tones,
    out: &mut [[u8; 4]],
    stride: usize,
) {
    // Of one colour, all from the last plane.
    let first = if PLANES == 1 { 3 } else { 0 };
    let mut lines = [column.around(first, &rows[0]); PLANES];
    for (channel, lines) in lines.iter_mut().enumerate() {
        *lines = column.around(first + channel, &rows[0]);
    }
    // Copies: what is stored to pixels might change what is behind a reference, for all that is known.
    let [red, green, blue] = tones.channels;
    for from in (0..TILE).step_by(2 * S::LANES) {
        // Down the stretch the places are cubic in the row.
        let mut terms = [[s.splat_word(0); 4]; PLANES];
        for (terms, lines) in terms.iter_mut().zip(&lines) {
            for (term, weights) in terms.iter_mut().zip(&stretch.terms) {
                let mut halves = [s.splat(0.0); 2];
                for (half, from) in halves.iter_mut().zip([from, from + S::LANES]) {
                    *half = s.mul(s.splat(weights[0]), s.load(&lines[0][from / 16][from % 16..]));
                    for (&weight, line) in weights[1..].iter().zip(&lines[1..]) {
                        *half = s.mul_add(s.splat(weight), s.load(&line[from / 16][from % 16..]), *half);
                    }
                }
                *term = s.words(halves[0], halves[1]);
            }
        }
        // Two rows at once, as far above the middle as below: the even terms are the same, the odd ones have the other sign.
        for (row, &[distance, square]) in stretch.distances.iter().enumerate() {
            let (distance, square) = (s.splat_word(distance), s.splat_word(square));
            let mut places = [[s.splat_word(0); PLANES]; 2];
            for (channel, [a, b, c, d]) in terms.iter().enumerate() {
                let even = s.add_words(*a, s.mul_words(*c, square));
                let odd = s.mul_words(s.add_words(*b, s.mul_words(*d, square)), distance);
                places[0][channel] = s.sub_words(even, odd);
                places[1][channel] = s.add_words(even, odd);
            }
            for (row, places) in [row, stretch.count - 1 - row].into_iter().zip(&places) {
                if row < rows.len() {
                    // One for all is the last as well as the first.
                    let codes = [
                        red.at::<S, DEGREE>(s, places[0]),
                        green.at::<S, DEGREE>(s, places[PLANES / 2]),
                        blue.at::<S, DEGREE>(s, places[PLANES - 1]),
                    ];
                    s.store_words(codes, &mut out[row * stride + from..]);
                }
            }
        }
    }
}
