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
}

impl Film {
    /// A film of zeros without depth.
    pub fn new(size: [u32; 2]) -> Self {
        let n = size[0] as usize * size[1] as usize;
        Self { size, color: [vec![0.0; n], vec![0.0; n], vec![0.0; n]], transmittance: vec![0.0; n], depth: None }
    }

    /// The same, or `None` where there is no memory for it.
    pub fn try_new(size: [u32; 2]) -> Option<Self> {
        // Asking first keeps a picture that cannot fit from ending the process.
        let n = (size[0] as usize).checked_mul(size[1] as usize)?;
        Vec::<[f32; 4]>::new().try_reserve_exact(n).ok()?;
        Some(Self::new(size))
    }

    /// Averages `n` x `n` samples into each pixel; depth becomes the nearest of them. The size must be divisible by `n`.
    pub fn downsample(&self, n: u32) -> Self {
        if n == 1 {
            return self.clone();
        }
        let [width, height] = self.size.map(|s| (s / n) as usize);
        let (source_width, n) = (self.size[0] as usize, n as usize);
        let reduce = |plane: &[f32], start: f32, fold: fn(f32, f32) -> f32, scale: f32| {
            let mut out = Vec::with_capacity(width * height);
            for y in 0..height {
                for x in 0..width {
                    let mut value = start;
                    for row in 0..n {
                        let first = (y * n + row) * source_width + x * n;
                        value = plane[first..first + n].iter().copied().fold(value, fold);
                    }
                    out.push(value * scale);
                }
            }
            out
        };
        let mean = |plane: &[f32]| reduce(plane, 0.0, |a, b| a + b, 1.0 / (n * n) as f32);
        Self {
            size: [width as u32, height as u32],
            color: [mean(&self.color[0]), mean(&self.color[1]), mean(&self.color[2])],
            transmittance: mean(&self.transmittance),
            depth: self.depth.as_ref().map(|plane| reduce(plane, f32::INFINITY, f32::min, 1.0)),
        }
    }
}
