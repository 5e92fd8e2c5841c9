//! What the GPU path asks of a method beside what the CPU's tile engine asks of it.

use super::shader::Part;
use crate::render::cpu::splat::{Alignment, Bounds, Lens};

/// A pixel near a particle that its linear forms are given at, so that single precision loses nothing of them.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    /// Column and row.
    pub pixel: [u32; 2],
    /// Ray tangents (X, Y) through the pixel's centre.
    pub tangent: [f64; 2],
    /// Change of the tangents per column and per row; the second is negative.
    pub step: [f64; 2],
}

impl Anchor {
    /// The pixel in the middle of what a particle covers, which is not empty.
    pub fn new(lens: &Lens, bounds: &Bounds) -> Self {
        let pixel = [bounds.x, bounds.y].map(|[first, last]| first + (last - first) / 2);
        let direction = lens.view.direction(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5);
        Self { pixel, tangent: [direction.x, direction.y], step: [1.0 / lens.focal.x, -1.0 / lens.focal.y] }
    }

    /// Picture coordinates of the pixel's centre.
    pub fn center(&self) -> [f64; 2] {
        self.pixel.map(|at| f64::from(at) + 0.5)
    }

    /// The form slope . (X, Y) + constant as its value at the anchor and its change per column and row.
    pub fn form(&self, slope: [f64; 2], constant: f64) -> [f64; 3] {
        [
            slope[0] * self.tangent[0] + slope[1] * self.tangent[1] + constant,
            slope[0] * self.step[0],
            slope[1] * self.step[1],
        ]
    }
}

/// A particle's linear forms at its anchor; see `shaders/types.wgsl`. What a method does not read is 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct Forms {
    /// Of the column: value, change.
    pub x: [f64; 2],
    /// Of the row: value, change.
    pub y: [f64; 2],
    /// Of both: value, change per column, change per row.
    pub both: [f64; 3],
    /// How far the ray has come: value, change per column, change per row.
    pub ahead: [f64; 3],
    /// The method's own.
    pub own: f64,
    /// The method's own.
    pub inverse: f64,
}

/// A method that the GPU draws.
pub trait Shaded: Alignment {
    /// The parts of WGSL that define `footprint(splat, pixel)`.
    const SHADER: &'static [Part];
    /// The parts of WGSL that define `VOLUMETRIC`, `measure(body)`, `cover(body, eye)`, `forms(body, eye, pixel)` and
    /// `rim(body, eye, square)`: twins of [`Alignment::VOLUMETRIC`], [`Alignment::KEY`], [`Alignment::prepare`],
    /// [`Shaded::forms`] and [`Alignment::rim`].
    fn projection(&self) -> &'static [Part];
    /// A prepared particle as its shader reads it.
    fn forms(splat: &Self::Splat, anchor: &Anchor) -> Forms;
}
