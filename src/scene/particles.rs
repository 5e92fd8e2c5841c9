//! Particles as structures of arrays, in world space.

use super::{Kernel, Rgb};

/// One property of the particles of a set: the same for all, or one value each.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute<T> {
    /// The same value for every particle.
    Uniform(T),
    /// One value per particle, in particle order.
    Each(Vec<T>),
}

impl<T: Copy> Attribute<T> {
    /// The value for particle `i`. Panics if the attribute is [`Attribute::Each`] and `i` is out of range.
    #[inline]
    pub fn get(&self, i: usize) -> T {
        match self {
            Self::Uniform(value) => *value,
            Self::Each(values) => values[i],
        }
    }

    /// The distinct storage: one value when uniform, all otherwise.
    pub fn values(&self) -> &[T] {
        match self {
            Self::Uniform(value) => std::slice::from_ref(value),
            Self::Each(values) => values,
        }
    }
}

/// A cloud of particles that share a kernel.
///
/// Invariants (checked by [`ParticleSet::check`], relied on everywhere): the arrays have the same length; coordinates
/// are finite; radii are finite and > 0; opacities are in [0, 1); colours are finite.
#[derive(Clone, Debug)]
pub struct ParticleSet {
    /// Radially symmetric density of each particle.
    pub kernel: Kernel,
    /// World-space centres, x.
    pub x: Vec<f64>,
    /// World-space centres, y.
    pub y: Vec<f64>,
    /// World-space centres, z.
    pub z: Vec<f64>,
    /// Radius of the kernel's support, scene units, > 0.
    pub radius: Attribute<f64>,
    /// Opacity rho through the centre, in [0, 1).
    pub opacity: Attribute<f64>,
    /// Linear-light colour.
    pub color: Attribute<Rgb>,
}

impl ParticleSet {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is no particle.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Checks the invariants of the type; the error names the first offending particle (from 0) and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        let n = self.len();
        for (name, length) in [("y", self.y.len()), ("z", self.z.len())] {
            if length != n {
                return Err(format!("{name} has {length} values where x has {n}"));
            }
        }
        for (name, values) in [("x", &self.x), ("y", &self.y), ("z", &self.z)] {
            check_each(name, values, f64::is_finite, "a finite number", n, true)?;
        }
        let each = |a: &Attribute<f64>| matches!(a, Attribute::Each(_));
        let radius_allowed = |v: f64| v.is_finite() && v > 0.0;
        check_each("radius", self.radius.values(), radius_allowed, "greater than 0", n, each(&self.radius))?;
        let opacity_allowed = |v: f64| (0.0..1.0).contains(&v);
        check_each("opacity", self.opacity.values(), opacity_allowed, "0 <= opacity < 1", n, each(&self.opacity))?;
        let colors = self.color.values();
        if matches!(self.color, Attribute::Each(_)) && colors.len() != n {
            return Err(format!("color has {} values where x has {n}", colors.len()));
        }
        match colors.iter().position(|c| !c.iter().all(|v| v.is_finite())) {
            Some(i) => Err(format!("particle {i}: color is {:?}; allowed: finite numbers", colors[i])),
            None => Ok(()),
        }
    }
}

fn check_each(
    name: &str,
    values: &[f64],
    allowed: impl Fn(f64) -> bool,
    rule: &str,
    count: usize,
    each: bool,
) -> Result<(), String> {
    if each && values.len() != count {
        return Err(format!("{name} has {} values where x has {count}", values.len()));
    }
    match values.iter().position(|&v| !allowed(v)) {
        Some(i) => Err(format!("particle {i}: {name} is {}; allowed: {rule}", values[i])),
        None => Ok(()),
    }
}
