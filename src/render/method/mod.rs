//! The methods, one file each.

pub mod auto;
pub mod perspective;
pub mod sheet;
pub mod slab;
pub mod spherical;
pub mod viewplane;
pub mod viewpoint;

use super::cpu::engine;
use super::gpu::raster::Precision;
use super::gpu::splat::Shaded;
use super::gpu::{self, Gpu};
use super::{Frame, GpuPath, GpuRenderer, Progress, Renderer, Statistics, reference};
use crate::error::{Error, Result};
use crate::scene::Scene;
use serde_json::{Value, json};

/// How gas is rendered. Methods that can be tuned carry their parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// The least work that stays within the tolerance.
    #[default]
    Auto,
    /// Billboards parallel to the view plane (Johnson & McAllister 2005).
    Viewplane,
    /// Billboards through the centre facing their own eye (Johnson & McAllister 2005).
    Viewpoint,
    /// The exact projection of each ball: footprint at the perpendicular distance from ray to centre.
    Perspective,
    /// Spherical billboards (Umenhoffer, Szirmay-Kalos & Szijarto).
    Spherical(spherical::Parameters),
    /// The image-aligned sheet buffer (Beliaev & Zaytseva, after Mueller & Crawfis).
    Sheet(sheet::Parameters),
    /// Slabs of depth that hold optical depth: exact transmittance, colour of second order.
    Slab(slab::Parameters),
    /// The truth by adaptive quadrature, with a bound of its error.
    Reference(reference::Parameters),
}

/// How gas of particles that overlap mixes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mixing {
    /// Particles stand one behind the other.
    Never,
    /// What lies in a slice mixes; slices stand one behind the other.
    WithinSlices,
    /// As gas does.
    Everywhere,
}

impl Method {
    /// Every method that is built, with default parameters, in the order of the documentation.
    pub const ALL: &[Self] = &[
        Self::Viewplane,
        Self::Viewpoint,
        Self::Perspective,
        Self::Spherical(spherical::Parameters::DEFAULT),
        Self::Sheet(sheet::Parameters::DEFAULT),
        Self::Slab(slab::Parameters::DEFAULT),
        Self::Reference(reference::Parameters::DEFAULT),
        Self::Auto,
    ];

    /// The name that scene files and `--method` use, whatever the parameters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Viewplane => "viewplane",
            Self::Viewpoint => "viewpoint",
            Self::Perspective => "perspective",
            Self::Spherical(_) => "spherical",
            Self::Sheet(_) => "sheet",
            Self::Slab(_) => "slab",
            Self::Reference(_) => "reference",
        }
    }

    /// What it is, in a line.
    pub fn help(self) -> &'static str {
        match self {
            Self::Auto => "the least work within the tolerance: as few rays and slabs as the gas needs",
            Self::Viewplane => "billboards parallel to the view plane (Johnson & McAllister 2005)",
            Self::Viewpoint => "billboards facing their own eye (Johnson & McAllister 2005)",
            Self::Perspective => "exact projection of each ball",
            Self::Spherical(_) => "spherical billboards (Umenhoffer, Szirmay-Kalos & Szijarto)",
            Self::Sheet(_) => "image-aligned sheet buffer (Beliaev & Zaytseva, after Mueller & Crawfis)",
            Self::Slab(_) => "slabs of optical depth: transmittance exact, overlapping particles mix, nothing pops",
            Self::Reference(_) => "the truth by adaptive quadrature in f64, with a bound of the error of every pixel",
        }
    }

    /// The method of that name, with default parameters.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|method| method.name() == name)
    }

    /// The parameters in force for a scene, by the names that scene files use; what is left to the method is decided.
    /// Empty for methods that take none.
    pub fn parameters(self, scene: &Scene) -> Vec<(&'static str, Value)> {
        match self {
            Self::Auto | Self::Viewplane | Self::Viewpoint | Self::Perspective => Vec::new(),
            Self::Spherical(spherical::Parameters { falloff, rays, quad }) => {
                let mut parameters = vec![("falloff", json!(falloff.name())), ("rays", json!(rays.name()))];
                match rays {
                    spherical::Rays::Parallel => parameters.push(("quad", json!(quad.name()))),
                    // Rays through the eye meet the ball where it is, wherever the quad stands.
                    spherical::Rays::Perspective => {}
                }
                parameters
            }
            Self::Sheet(parameters) => vec![
                ("slice_width", json!(parameters.width(scene))),
                ("segments", json!(parameters.segments)),
                ("lookup", json!(parameters.lookup.name())),
            ],
            Self::Slab(parameters) => {
                vec![("slabs", json!(parameters.count(scene))), ("richardson", json!(parameters.richardson))]
            }
            Self::Reference(reference::Parameters { disparity }) => vec![("disparity", json!(disparity))],
        }
    }

    /// Whether [`super::OpacityModel`] applies; the other methods always mean optical depth.
    pub fn has_opacity_model(self) -> bool {
        match self {
            Self::Viewplane | Self::Viewpoint | Self::Perspective => true,
            Self::Auto | Self::Spherical(_) | Self::Sheet(_) | Self::Slab(_) | Self::Reference(_) => false,
        }
    }

    /// Whether the particles' kernels apply.
    pub fn has_kernels(self) -> bool {
        match self {
            Self::Auto
            | Self::Viewplane
            | Self::Viewpoint
            | Self::Perspective
            | Self::Sheet(_)
            | Self::Slab(_)
            | Self::Reference(_) => true,
            Self::Spherical(_) => false,
        }
    }

    /// Whether particles that overlap mix.
    pub fn mixing(self) -> Mixing {
        match self {
            Self::Viewplane | Self::Viewpoint | Self::Perspective | Self::Spherical(_) => Mixing::Never,
            Self::Sheet(_) => Mixing::WithinSlices,
            Self::Auto | Self::Slab(_) | Self::Reference(_) => Mixing::Everywhere,
        }
    }

    /// Whether it can estimate its own error at every pixel.
    pub fn estimates_error(self) -> bool {
        match self {
            Self::Auto
            | Self::Viewplane
            | Self::Viewpoint
            | Self::Perspective
            | Self::Spherical(_)
            | Self::Sheet(_)
            | Self::Reference(_) => false,
            Self::Slab(_) => true,
        }
    }

    /// Whether a GPU draws it, that way if one is given.
    ///
    /// # Errors
    /// [`Error::Device`] that names the methods that a GPU draws so.
    pub fn check_gpu(self, path: Option<GpuPath>) -> Result<()> {
        let drawn = |method: Self, path: Option<GpuPath>| {
            method.renderer().on_gpu().is_some_and(|it| path.is_none_or(|path| it.paths().contains(&path)))
        };
        if drawn(self, path) {
            return Ok(());
        }
        // What no GPU draws at all is told of first.
        let path = path.filter(|_| drawn(self, None));
        let able: Vec<_> =
            Self::ALL.iter().filter(|method| drawn(**method, path)).map(|method| method.name()).collect();
        if let Some(path) = path {
            let (name, path, able) = (self.name(), path.name(), able.join(", "));
            return Err(Error::Device(format!(
                "no GPU can be used: method `{name}` has no path `{path}`; methods that have it: {able}; use --gpu-path auto"
            )));
        }
        let (name, able) = (self.name(), able.join(", "));
        Err(Error::Device(format!(
            "no GPU can be used: method `{name}` is drawn on the CPU alone; methods that a GPU draws: {able}; use --device \
             cpu or auto, or another --method"
        )))
    }

    /// The renderer of the method.
    pub fn renderer(self) -> Box<dyn Renderer> {
        match self {
            Self::Viewplane => Box::new(Tiled(viewplane::Viewplane)),
            Self::Viewpoint => Box::new(Tiled(viewpoint::Viewpoint)),
            Self::Auto => Box::new(auto::Auto),
            Self::Perspective => Box::new(Tiled(perspective::Perspective)),
            Self::Spherical(spherical::Parameters { falloff, rays, quad }) => {
                use spherical::{Falloff, Parallel, Rays, Slanted};
                match (rays, falloff) {
                    (Rays::Parallel, Falloff::Printed) => Box::new(Tiled(Parallel::<false> { quad })),
                    (Rays::Parallel, Falloff::Integrated) => Box::new(Tiled(Parallel::<true> { quad })),
                    (Rays::Perspective, Falloff::Printed) => Box::new(Tiled(Slanted::<false>)),
                    (Rays::Perspective, Falloff::Integrated) => Box::new(Tiled(Slanted::<true>)),
                }
            }
            Self::Sheet(parameters) => Box::new(sheet::Sheet(parameters)),
            Self::Slab(parameters) => Box::new(parameters),
            Self::Reference(parameters) => Box::new(reference::Quadrature(parameters)),
        }
    }
}

/// A method of the tile engine and of its twin on the GPU.
struct Tiled<A>(A);

impl<A: Shaded> Renderer for Tiled<A> {
    fn supports(&self, _: &Scene) -> Result<()> {
        // Particles of every kernel, opaque meshes and a background are all that a scene can hold so far.
        Ok(())
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        engine::draw(self.0, frame, progress)
    }

    fn on_gpu(&self) -> Option<&dyn GpuRenderer> {
        Some(self)
    }
}

impl<A: Shaded> GpuRenderer for Tiled<A> {
    fn paths(&self) -> &'static [GpuPath] {
        GpuPath::ALL
    }

    fn draw(&self, gpu: &mut Gpu, path: GpuPath, frame: Frame, progress: &dyn Progress) -> Result<Statistics> {
        match path {
            GpuPath::Compute => gpu::compute::draw(self.0, gpu, frame, progress),
            GpuPath::Raster => gpu::raster::draw(self.0, Precision::Single, gpu, frame, progress),
            GpuPath::RasterF16 => gpu::raster::draw(self.0, Precision::Half, gpu, frame, progress),
        }
    }
}

/// The median radius of a scene's particles, of an even number the upper of the two in the middle; none without particles.
fn median_radius(scene: &Scene) -> Option<f64> {
    let mut radii: Vec<f64> = Vec::with_capacity(scene.particle_count());
    for set in &scene.particles {
        radii.extend((0..set.len()).map(|i| set.radius.get(i)));
    }
    let middle = radii.len() / 2;
    (!radii.is_empty()).then(|| *radii.select_nth_unstable_by(middle, f64::total_cmp).1)
}
