//! `spherical`: spherical billboards (Umenhoffer, Szirmay-Kalos & Szijarto, Spherical billboards for rendering volumetric
//! data, ShaderX 5).

/// What the paper leaves open or what later work does otherwise; the default is the paper as printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parameters {
    /// How opacity falls off from the centre.
    pub falloff: Falloff,
    /// The way of a ray through a ball.
    pub rays: Rays,
    /// Where the quad stands.
    pub quad: Quad,
}

impl Parameters {
    /// The paper as printed.
    pub const DEFAULT: Self = Self { falloff: Falloff::Printed, rays: Rays::Parallel, quad: Quad::Far };
}

/// How opacity falls off from the centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Falloff {
    /// (1 - d/r) times the length of the segment.
    #[default]
    Printed,
    /// The integral of the linear falloff along the segment.
    Integrated,
}

/// The way of a ray through a ball.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rays {
    /// Parallel to the optical axis.
    #[default]
    Parallel,
    /// Through the eye.
    Perspective,
}

/// Where the quad stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quad {
    /// At the farthest point of the ball.
    #[default]
    Far,
    /// At the centre's depth.
    Centre,
}

impl Falloff {
    /// Every falloff.
    pub const ALL: &[Self] = &[Self::Printed, Self::Integrated];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Printed => "printed",
            Self::Integrated => "integrated",
        }
    }
}

impl Rays {
    /// Both ways.
    pub const ALL: &[Self] = &[Self::Parallel, Self::Perspective];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parallel => "parallel",
            Self::Perspective => "perspective",
        }
    }
}

impl Quad {
    /// Both places.
    pub const ALL: &[Self] = &[Self::Far, Self::Centre];

    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Far => "far",
            Self::Centre => "centre",
        }
    }
}
