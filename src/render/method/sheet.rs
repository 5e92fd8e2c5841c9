//! `sheet`: the image-aligned sheet buffer (Beliaev & Zaytseva, Modeling of fuzzy natural phenomena with particle system,
//! after Mueller & Crawfis, Eliminating popping artifacts in sheet buffer-based splatting, IEEE Visualization 1998).

use crate::scene::Scene;

/// How the gas is sliced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Width of a slice in scene units, > 0; absent: half the median radius, as in Beliaev & Zaytseva.
    pub slice_width: Option<f64>,
    /// Number of pre-integrated kernel segments, 2 to [`Parameters::MAX_SEGMENTS`].
    pub segments: u32,
    /// How a segment is looked up.
    pub lookup: Lookup,
}

impl Parameters {
    /// Beliaev & Zaytseva's.
    pub const DEFAULT: Self = Self { slice_width: None, segments: 128, lookup: Lookup::Interpolated };

    /// Most segments of the table.
    pub const MAX_SEGMENTS: u32 = 4096;

    /// The width of a slice in scene units, > 0: as given, or half the median radius of the scene's particles (of an even
    /// number the upper of the two in the middle); 1 without particles.
    pub fn width(&self, scene: &Scene) -> f64 {
        self.slice_width.unwrap_or_else(|| {
            let mut radii: Vec<f64> = Vec::with_capacity(scene.particle_count());
            for set in &scene.particles {
                radii.extend((0..set.len()).map(|i| set.radius.get(i)));
            }
            let middle = radii.len() / 2;
            if radii.is_empty() { 1.0 } else { 0.5 * *radii.select_nth_unstable_by(middle, f64::total_cmp).1 }
        })
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// How a kernel segment is looked up in the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lookup {
    /// The nearest of the pre-integrated segments (Mueller & Crawfis).
    Nearest,
    /// Interpolated between neighbours (Beliaev & Zaytseva).
    #[default]
    Interpolated,
}

impl Lookup {
    /// Both ways.
    pub const ALL: &[Self] = &[Self::Nearest, Self::Interpolated];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Interpolated => "interpolated",
        }
    }
}
