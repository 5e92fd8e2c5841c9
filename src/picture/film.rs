//! The film: what a renderer writes for one view.

/// One view's result in linear light: colour over the background, transmittance to the background and opaque depth.
///
/// Planes are row-major f32, row 0 on top, `width * height` values each. Colour is not clamped.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Linear-light red, green and blue of everything the ray sees, background included.
    pub color: [Vec<f32>; 3],
    /// Transmittance to the background, in [0, 1]; 0 where an opaque surface stops the ray.
    pub transmittance: Vec<f32>,
    /// Depth of the opaque surface in scene units, infinity where there is none; absent without opaque surfaces.
    pub depth: Option<Vec<f32>>,
    /// Absolute error of each pixel, linear light, any channel: what the method can say of it, a bound or an estimate.
    pub error: Option<Vec<f32>>,
}

impl Film {
    /// A film of zeros without depth and error.
    pub fn new(size: [u32; 2]) -> Self {
        let n = size[0] as usize * size[1] as usize;
        let color = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        Self { size, color, transmittance: vec![0.0; n], depth: None, error: None }
    }

    /// Averages `n` x `n` samples into each pixel; depth becomes the nearest of them; errors add up at worst, so
    /// that their mean is that of the mean. The size must be divisible by `n`.
    pub fn downsample(&self, n: u32) -> Self {
        if n == 1 {
            return self.clone();
        }
        let [width, height] = self.size.map(|s| (s / n) as usize);
        let n = n as usize;
        let size = [width, height, n];
        let mean = |plane: &[f32]| {
            let mut plane = reduce(plane, size, 0.0, |a, b| a + b);
            let share = 1.0 / (n * n) as f32;
            plane.iter_mut().for_each(|value| *value *= share);
            plane
        };
        Self {
            size: [width as u32, height as u32],
            color: [mean(&self.color[0]), mean(&self.color[1]), mean(&self.color[2])],
            transmittance: mean(&self.transmittance),
            depth: self.depth.as_ref().map(|plane| reduce(plane, size, f32::INFINITY, f32::min)),
            error: self.error.as_deref().map(mean),
        }
    }
}

/// Folds each block of `n` x `n` samples, row by row and from left to right; `width` x `height` values.
fn reduce(plane: &[f32], [width, height, n]: [usize; 3], start: f32, fold: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let mut out = vec![start; width * height];
    // One row of samples at a time, as they lie in memory.
    for (y, samples) in plane.chunks_exact(width * n).enumerate() {
        let row = &mut out[y / n * width..][..width];
        for (value, block) in row.iter_mut().zip(samples.chunks_exact(n)) {
            *value = block.iter().fold(*value, |a, &b| fold(a, b));
        }
    }
    out
}
