//! The methods, one file each.

pub mod perspective;
pub mod viewplane;
pub mod viewpoint;

use super::cpu::engine;
use super::cpu::splat::Alignment;
use super::{Frame, Progress, Renderer, Statistics, reference};
use crate::error::Result;
use crate::scene::Scene;

/// How gas is rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The cheapest method predicted to stay within the tolerance; until the planner exists: [`Method::Perspective`].
    #[default]
    Auto,
    /// Billboards parallel to the view plane (Johnson & McAllister 2005).
    Viewplane,
    /// Billboards through the centre facing their own eye (Johnson & McAllister 2005).
    Viewpoint,
    /// The exact projection of each ball: footprint at the perpendicular distance from ray to centre.
    Perspective,
    /// The truth by adaptive quadrature, with a bound of its error.
    Reference,
}

impl Method {
    /// Every method that is built, in the order of the documentation.
    pub const ALL: &[Self] = &[Self::Viewplane, Self::Viewpoint, Self::Perspective, Self::Reference, Self::Auto];

    /// Methods that have a name but are not built yet; asking for one is an error that says so.
    pub const PLANNED: &[&str] = &["spherical", "sheet", "slab"];

    /// The name that scene files and `--method` use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Viewplane => "viewplane",
            Self::Viewpoint => "viewpoint",
            Self::Perspective => "perspective",
            Self::Reference => "reference",
        }
    }

    /// What it is, in a line.
    pub fn help(self) -> &'static str {
        match self {
            Self::Auto => "the cheapest method within the tolerance; until the planner is built: perspective",
            Self::Viewplane => "billboards parallel to the view plane (Johnson & McAllister 2005)",
            Self::Viewpoint => "billboards facing their own eye (Johnson & McAllister 2005)",
            Self::Perspective => "exact projection of each ball",
            Self::Reference => "the truth by adaptive quadrature in f64, with a bound of the error of every pixel",
        }
    }

    /// The method of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|method| method.name() == name)
    }

    /// The method that really draws: [`Method::Auto`] becomes its choice.
    pub fn resolve(self) -> Self {
        match self {
            Self::Auto => Self::Perspective,
            Self::Viewplane | Self::Viewpoint | Self::Perspective | Self::Reference => self,
        }
    }

    /// The renderer of the method.
    pub fn renderer(self) -> &'static dyn Renderer {
        match self {
            Self::Viewplane => &Tiled(viewplane::Viewplane),
            Self::Viewpoint => &Tiled(viewpoint::Viewpoint),
            Self::Auto | Self::Perspective => &Tiled(perspective::Perspective),
            Self::Reference => &reference::Quadrature,
        }
    }
}

/// A method of the CPU tile engine.
struct Tiled<A>(A);

impl<A: Alignment> Renderer for Tiled<A> {
    fn supports(&self, _: &Scene) -> Result<()> {
        // Particles of every kernel, opaque meshes and a background are all that a scene can hold so far.
        Ok(())
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        engine::draw(self.0, frame, progress)
    }
}
