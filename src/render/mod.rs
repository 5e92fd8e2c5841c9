//! HOW: renderers, from a scene and its views to films.

pub mod cpu;
pub mod method;

pub use method::Method;

/// How a particle's opacity follows from its footprint F in the three billboard methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OpacityModel {
    /// alpha = 1 - (1 - rho)^F: the optical depth is proportional to the footprint.
    #[default]
    Exponential,
    /// alpha = rho F, as Johnson & McAllister (2005) print it.
    Linear,
}

/// The default tolerance: one step of an 8-bit channel.
pub const DEFAULT_TOLERANCE: f64 = 1.0 / 255.0;

/// How to render, independent of what.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The method.
    pub method: Method,
    /// Opacity model of the billboard methods.
    pub opacity_model: OpacityModel,
    /// Absolute error allowed per channel in linear light at every pixel, >= 0; 0 turns every saving off.
    pub tolerance: f64,
    /// Number of threads; absent: one per core. The picture does not depend on it.
    pub threads: Option<usize>,
    /// Vector instructions of the CPU path; absent: the widest that the machine has.
    pub simd: Option<cpu::simd::Level>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            opacity_model: OpacityModel::default(),
            tolerance: DEFAULT_TOLERANCE,
            threads: None,
            simd: None,
        }
    }
}

/// Told how far the work is; called from any thread.
pub trait Progress: Sync {
    /// `done` of `total` units of work are done. The total may grow.
    fn update(&self, done: u64, total: u64);
}

/// Nobody wants to know.
impl Progress for () {
    fn update(&self, _: u64, _: u64) {}
}
