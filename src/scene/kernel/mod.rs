//! Reconstruction kernels: radially symmetric densities k(q) on the ball q < 1, one file each.
//!
//! All lengths are in units of the particle's radius: q is the distance from the centre, u the perpendicular distance
//! of a line from it, in [0, 1]. Everything here is the f64 truth that the f32 texts of the renderers are tested
//! against.

use std::sync::Arc;

pub mod beliaev;
pub mod constant;
pub mod gaussian;
pub mod linear;
pub mod poly;
pub mod table;

/// A kernel.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Kernel {
    /// exp(-4.5 q^2): a Gaussian over [-3, 3] sigma (Johnson & McAllister 2005).
    #[default]
    Gaussian,
    /// exp(-8 q^2) (Beliaev & Zaytseva, eq. 6, over a support that is our assumption).
    Beliaev,
    /// 1 - q.
    Linear,
    /// 1.
    Constant,
    /// (1 - q^2)^2.
    Poly,
    /// A radial profile, linear between its rows.
    Table(Arc<table::Profile>),
}

impl Kernel {
    /// The names of the kernels that need no data, in the order of the documentation.
    pub const NAMES: &[&str] = &["gaussian", "beliaev", "linear", "constant", "poly"];

    /// The kernel of one of the [`Kernel::NAMES`].
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Gaussian, Self::Beliaev, Self::Linear, Self::Constant, Self::Poly]
            .into_iter()
            .find(|kernel| kernel.name() == name)
    }

    /// The name that scene files use; `table` for every profile.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Beliaev => "beliaev",
            Self::Linear => "linear",
            Self::Constant => "constant",
            Self::Poly => "poly",
            Self::Table(_) => "table",
        }
    }

    /// The kernel of a radial profile: distances `q` that ascend strictly from 0 to 1 and a density >= 0 for each, not
    /// all zero. The error names the first offending row (from 0) and what is allowed.
    pub fn table(q: Vec<f64>, density: Vec<f64>) -> Result<Self, String> {
        table::Profile::new(q, density).map(|profile| Self::Table(Arc::new(profile)))
    }

    /// A bound, at least 1, of the optical depth that any ray sees of a particle over that of the ray through its centre; 1 where
    /// the density nowhere grows with the distance from the centre. A whole chord of the share s of the diameter holds at
    /// most s times the bound.
    pub fn excess(&self) -> f64 {
        match self {
            Self::Gaussian | Self::Beliaev | Self::Linear | Self::Constant | Self::Poly => 1.0,
            Self::Table(profile) => profile.excess(),
        }
    }

    /// Density k at distance `q` >= 0 from the centre; 0 for q >= 1. In the unit of the kernel's own scale: the
    /// extinction of a particle is T0 k(q) / (r K(0)).
    pub fn density(&self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Self::Gaussian => gaussian::density(q),
            Self::Beliaev => beliaev::density(q),
            Self::Linear => linear::density(q),
            Self::Constant => constant::density(q),
            Self::Poly => poly::density(q),
            Self::Table(profile) => profile.density(q),
        }
    }

    /// Chord integral K(u): the integral of the density along the whole line at perpendicular distance `u` >= 0; 0 for
    /// u >= 1.
    pub fn chord(&self, u: f64) -> f64 {
        if u >= 1.0 {
            return 0.0;
        }
        match self {
            Self::Gaussian => gaussian::chord(u),
            Self::Beliaev => beliaev::chord(u),
            Self::Linear => linear::chord(u),
            Self::Constant => constant::chord(u),
            Self::Poly => poly::chord(u),
            Self::Table(profile) => profile.chord(u),
        }
    }

    /// Footprint F(u) = K(u) / K(0): 1 at the centre, 0 for u >= 1. Falls monotonically for every kernel but `table`,
    /// whose profile may rise away from its centre; F then exceeds 1.
    pub fn footprint(&self, u: f64) -> f64 {
        let centre = match self {
            Self::Gaussian => gaussian::CENTRE,
            Self::Beliaev => beliaev::CENTRE,
            Self::Linear => linear::CENTRE,
            Self::Constant => constant::CENTRE,
            Self::Poly => poly::CENTRE,
            Self::Table(profile) => profile.centre(),
        };
        self.chord(u) / centre
    }

    /// Integral of the density from `u0` to `u1`, signed distances along a line from the point that is closest to the
    /// centre, at perpendicular distance `b` >= 0. Clipped to the ball, |u| <= sqrt(1 - b^2); the ends may be infinite.
    /// 0 for u1 <= u0.
    ///
    /// Accurate to a few ulp however short the segment: no difference of primitives is taken where it would cancel.
    pub fn segment(&self, b: f64, u0: f64, u1: f64) -> f64 {
        if b >= 1.0 {
            return 0.0;
        }
        let half = half_chord(b);
        let (u0, u1) = (u0.max(-half), u1.min(half));
        if u1 <= u0 {
            return 0.0;
        }
        match self {
            Self::Gaussian => gaussian::segment(b, u0, u1),
            Self::Beliaev => beliaev::segment(b, u0, u1),
            Self::Linear => linear::segment(b, u0, u1),
            Self::Constant => constant::segment(u0, u1),
            Self::Poly => poly::segment(b, u0, u1),
            Self::Table(profile) => profile.segment(b, u0, u1),
        }
    }

    /// Integral of the density over the whole ball: with it, a particle's extinction integrates over space to
    /// T0 r^2 content / K(0).
    pub fn content(&self) -> f64 {
        match self {
            Self::Gaussian => gaussian::content(),
            Self::Beliaev => beliaev::content(),
            Self::Linear => linear::CONTENT,
            Self::Constant => constant::CONTENT,
            Self::Poly => poly::CONTENT,
            Self::Table(profile) => profile.content(),
        }
    }

    /// What a billboard shows at the in-plane offset (`a`, `b`) from its centre: for the Gaussian
    /// exp(-4.5 (a^2 + b^2)) on the open square |a|, |b| < 1, as the table of Johnson & McAllister (2005), eq. 4, which
    /// integrates over [-3, 3] sigma everywhere; for the others the footprint F(sqrt(a^2 + b^2)) on the disc.
    pub fn billboard(&self, a: f64, b: f64) -> f64 {
        match self {
            Self::Gaussian => gaussian::billboard(a, b),
            Self::Beliaev | Self::Linear | Self::Constant | Self::Poly | Self::Table(_) => {
                self.footprint((a * a + b * b).sqrt())
            }
        }
    }

    /// An upper bound of |dF/du| over [0, 1], exact but for `table`.
    ///
    /// It is infinite for every kernel whose density does not fall to zero at the rim (`constant`, but also `gaussian`
    /// and `beliaev`): there F ends like k(1) sqrt(1 - u^2), with a vertical tangent.
    pub fn slope_bound(&self) -> f64 {
        match self {
            Self::Gaussian | Self::Beliaev | Self::Constant => f64::INFINITY,
            Self::Linear => linear::SLOPE,
            Self::Poly => poly::SLOPE,
            Self::Table(profile) => profile.slope_bound(),
        }
    }
}

/// Half the length of the chord at perpendicular distance `b` in [0, 1]: sqrt(1 - b^2), without cancellation.
#[inline]
fn half_chord(b: f64) -> f64 {
    ((1.0 - b) * (1.0 + b)).sqrt()
}

/// Positive nodes and weights of the Gauss-Legendre rule of 8 points on [-1, 1] (Abramowitz & Stegun, table 25.4).
const GAUSS_8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_29),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_47),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_26),
];

/// Integral of `f` from `u0` to `u1` by the Gauss-Legendre rule of 8 points: exact for polynomials of degree 15.
#[inline]
fn gauss_8(u0: f64, u1: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (middle, half) = (0.5 * (u0 + u1), 0.5 * (u1 - u0));
    half * GAUSS_8
        .iter()
        .map(|(node, weight)| weight * (f(middle - half * node) + f(middle + half * node)))
        .sum::<f64>()
}

/// Integral of sqrt(u^2 + b^2) from `u0` to `u1`, the primitive being [u sqrt(u^2 + b^2) + b^2 asinh(u/b)] / 2.
///
/// The differences are rewritten so that each term is proportional to u1 - u0:
/// with q = sqrt(u^2 + b^2), q1 - q0 = (u1 - u0)(u1 + u0) / (q1 + q0), and
/// asinh(x1) - asinh(x0) = asinh(x1 sqrt(1 + x0^2) - x0 sqrt(1 + x1^2)).
fn distance_integral(b: f64, u0: f64, u1: f64) -> f64 {
    let b2 = b * b;
    let (q0, q1) = ((u0 * u0 + b2).sqrt(), (u1 * u1 + b2).sqrt());
    let (length, sum) = (u1 - u0, u1 + u0);
    if q0 + q1 == 0.0 {
        return 0.0;
    }
    let product = length * q1 + u0 * length * sum / (q0 + q1);
    // b^2 asinh(u/b) -> 0 as b -> 0; below this b^2 the argument could overflow and the term is far below an ulp.
    let sinh_term = if b2 < 1e-300 {
        0.0
    } else {
        let same_side = u0 * u1 > 0.0;
        let argument = if same_side { length * sum / (u1 * q0 + u0 * q1) } else { (u1 * q0 - u0 * q1) / b2 };
        b2 * argument.asinh()
    };
    0.5 * (product + sinh_term)
}
