//! TO WHAT: films, colour, stereo packings and image files. Knows no scene.

pub mod color;
pub mod disparity;
pub mod dubois;
pub mod film;
pub mod output;
pub mod packing;
pub mod plane;
pub mod provenance;
pub mod read;
pub mod rgba8;

pub use disparity::{Disparity, Side};
pub use film::Film;
pub use plane::Plane;
pub use rgba8::Rgba8;

/// The largest width and height that is read or rendered, in pixels.
pub const MAX_SIDE: u32 = 32768;
/// The largest number of pixels in one picture that is read or rendered.
pub const MAX_PIXELS: u64 = 1 << 28;

/// A picture in linear light, sRGB primaries: what packings take and make, what writers encode and the reader returns.
///
/// Planes are row-major f32, row 0 on top, `width * height` values each. Colour is not clamped.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height in pixels, at least 1 each.
    pub size: [u32; 2],
    /// Linear-light red, green and blue, background included.
    pub color: [Plane<f32>; 3],
    /// 1 - transmittance to the background, in [0, 1]; absent where a pixel is not one ray's result.
    pub alpha: Option<Plane<f32>>,
    /// Bound of the absolute error of each pixel, linear light, any channel; EXR channel `E`. An estimate where the method has no bound.
    pub error: Option<Plane<f32>>,
    /// Where each pixel's point stands in the other eye's picture; EXR channel `disparityL.x` or `disparityR.x`. Only the
    /// reference knows it, if asked.
    pub disparity: Option<Disparity>,
}

impl Picture {
    /// A black picture without alpha.
    pub fn new(size: [u32; 2]) -> Self {
        let n = size[0] as usize * size[1] as usize;
        Self { size, color: [Plane::new(n), Plane::new(n), Plane::new(n)], alpha: None, error: None, disparity: None }
    }

    /// The picture of one view: the film's colour, error and disparity, alpha = 1 - transmittance. Depth is left
    /// behind.
    pub fn from_film(film: Film) -> Self {
        let mut alpha = film.transmittance;
        for value in &mut alpha {
            *value = 1.0 - *value;
        }
        Self { size: film.size, color: film.color, alpha: Some(alpha), error: film.error, disparity: film.disparity }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Whether every plane holds as many values as the size says. The error is one line.
    pub fn check(&self) -> Result<(), String> {
        let n = self.pixels();
        let planes = self.color.iter().chain(&self.alpha).chain(&self.error);
        let planes = planes.chain(self.disparity.as_ref().map(|disparity| &disparity.x));
        if n == 0 || planes.into_iter().any(|plane| plane.len() != n) {
            return Err(format!(
                "the planes of a {} x {} picture do not hold {n} values each",
                self.size[0], self.size[1]
            ));
        }
        Ok(())
    }
}
