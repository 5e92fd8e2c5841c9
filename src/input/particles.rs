//! Particle sets as a scene file describes them.

use super::color_map::ColorMap;
use crate::scene::{Kernel, Rgb};
use glam::DVec3;
use std::path::PathBuf;

/// The most particles a box may hold: 2.4 GB of coordinates.
pub const MAX_BOX_COUNT: u64 = 100_000_000;

/// One `[[particles]]` entry.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleEntry {
    /// Where the particles come from.
    pub source: Source,
    /// Radius of particles that have none of their own, > 0.
    pub radius: f64,
    /// Opacity of particles that have none of their own, in [0, 1).
    pub opacity: f64,
    /// Linear-light colour of particles that have none of their own.
    pub color: Rgb,
    /// Kernel of every particle of the set.
    pub kernel: Kernel,
    /// Translation of the set, applied last.
    pub position: DVec3,
    /// Rotation about x, y and z, degrees.
    pub rotation_deg: DVec3,
    /// Scale factor, > 0.
    pub scale: f64,
    /// Extent to scale the set to instead, > 0.
    pub fit: Option<f64>,
    /// Attributes that come from columns of the file.
    pub columns: Vec<ColumnMap>,
}

/// Where particles come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Uniformly random in a box.
    Box {
        /// Lower corner.
        min: DVec3,
        /// Upper corner.
        max: DVec3,
        /// Number of particles.
        count: u64,
        /// Seed of the generator.
        seed: u64,
    },
    /// Read from a file.
    File(PathBuf),
}

/// An attribute taken from a column: `value * scale + offset`, clamped to `min..=max`.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnMap {
    /// The attribute.
    pub target: Target,
    /// Name of the column.
    pub from: String,
    /// Factor.
    pub scale: f64,
    /// Added after the factor.
    pub offset: f64,
    /// Lower bound, or the lower end of the colour map.
    pub min: Option<f64>,
    /// Upper bound, or the upper end of the colour map.
    pub max: Option<f64>,
    /// Colour map, for [`Target::Color`].
    pub map: Option<ColorMap>,
}

impl ColumnMap {
    /// The column as it is.
    pub fn plain(target: Target, from: &str) -> Self {
        Self { target, from: from.to_owned(), scale: 1.0, offset: 0.0, min: None, max: None, map: None }
    }
}

/// An attribute of a particle that a column can give.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Position, x.
    X,
    /// Position, y.
    Y,
    /// Position, z.
    Z,
    /// Radius.
    Radius,
    /// Opacity.
    Opacity,
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Colour through a colour map.
    Color,
}

impl Target {
    /// All targets.
    pub const ALL: &[Self] =
        &[Self::X, Self::Y, Self::Z, Self::Radius, Self::Opacity, Self::R, Self::G, Self::B, Self::Color];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::Radius => "radius",
            Self::Opacity => "opacity",
            Self::R => "r",
            Self::G => "g",
            Self::B => "b",
            Self::Color => "color",
        }
    }
}
