//! What the integrator must know of a kernel beyond its density and its segment integral: where it has kinks, how short a
//! stretch the rule integrates exactly, and what the rounding of a position can do to an optical depth.

use crate::scene::Kernel;

/// The kernel of a particle set. Lengths are in radii, densities in the kernel's own scale.
pub(super) struct Medium<'a> {
    /// The kernel.
    pub kernel: &'a Kernel,
    /// K(0).
    pub centre: f64,
    /// sup |dk/dq|; of a table, which may be as good as vertical, its shells are looked at one by one instead.
    slope: f64,
    /// k just inside the rim.
    rim: f64,
    /// sup k.
    most: f64,
}

/// The largest q inside the ball: a node computed to lie on the rim still lies inside.
const INSIDE: f64 = 1.0 - f64::EPSILON / 2.0;

impl<'a> Medium<'a> {
    pub(super) fn new(kernel: &'a Kernel) -> Self {
        let densities = |rim: bool| match kernel {
            Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Constant | Kernel::Poly => {
                kernel.density(if rim { INSIDE } else { 0.0 })
            }
            Kernel::Table(profile) if rim => profile.densities().last().copied().unwrap_or_default(),
            Kernel::Table(profile) => profile.densities().iter().copied().fold(0.0, f64::max),
        };
        let slope = match kernel {
            // 2 a q exp(-a q^2) is sqrt(2a/e) at most: rates of 4.5 and 8.
            Kernel::Gaussian => 1.82,
            Kernel::Beliaev => 2.43,
            Kernel::Linear => 1.0,
            Kernel::Constant | Kernel::Table(_) => 0.0,
            // 4 q (1 - q^2) at q = 1/sqrt 3.
            Kernel::Poly => 1.54,
        };
        Self { kernel, centre: kernel.chord(0.0), slope, rim: densities(true), most: densities(false) }
    }

    /// Density at distance `u` along a line at distance `b` from the centre, within the ball.
    #[inline]
    pub(super) fn density(&self, b: f64, u: f64) -> f64 {
        self.kernel.density((b * b + u * u).sqrt().min(INSIDE))
    }

    /// The longest stretch of a line at distance `b`, no point of it nearer than `u` >= 0 to the closest one, whose integral
    /// the rule gives as exactly as the kernel's own closed form, which on these stretches is such a rule with fewer nodes.
    #[inline]
    pub(super) fn exact_stretch(&self, b: f64, u: f64) -> f64 {
        match self.kernel {
            // 0.75 standard lengths 1/sqrt a.
            Kernel::Gaussian => 0.353,
            Kernel::Beliaev => 0.265,
            Kernel::Constant | Kernel::Poly => f64::INFINITY,
            // Far from the branch points of q, u = +-ib.
            Kernel::Linear | Kernel::Table(_) => 0.4 * (b * b + u * u).sqrt(),
        }
    }

    /// Calls `knot` with every distance from the closest point at which the density along a line at distance `b` has a kink,
    /// or may have one within rounding.
    pub(super) fn knots(&self, b: f64, mut knot: impl FnMut(f64)) {
        match self.kernel {
            Kernel::Gaussian | Kernel::Beliaev | Kernel::Constant | Kernel::Poly => {}
            Kernel::Linear => knot(0.0),
            Kernel::Table(profile) => {
                knot(0.0);
                for &q in profile.q().iter().filter(|&&q| q > b && q < 1.0) {
                    let u = ((q - b) * (q + b)).sqrt();
                    knot(-u);
                    knot(u);
                }
            }
        }
    }

    /// Bound of what a displacement of the ball by `delta` can change of the integral along a line at distance `b`, of any
    /// stretch of it, to first order but for edges that the line grazes.
    ///
    /// The shift across the line changes it by |dK/db| <= 2 times the integral of |k'| along half the chord, plus at the rim
    /// 2 k(1) b / sqrt(1 - b^2); of a step of height h at distance q <= b + delta never more than 2 h sqrt(2 delta). The
    /// shift along the line changes it by k at both ends.
    pub(super) fn uncertainty(&self, b: f64, delta: f64) -> f64 {
        let inner = (b - delta).max(0.0);
        let leg = |q: f64| ((q - inner) * (q + inner)).max(0.0).sqrt();
        let grazed = 2.0 * (2.0 * delta * (1.0 + delta)).sqrt();
        let gentle = match self.kernel {
            Kernel::Gaussian | Kernel::Beliaev | Kernel::Linear | Kernel::Constant | Kernel::Poly => {
                2.0 * self.slope * leg(1.0) * delta
            }
            Kernel::Table(profile) => {
                let rows = profile.q().windows(2).zip(profile.densities().windows(2));
                rows.map(|(q, k)| {
                    let rise = (k[1] - k[0]).abs();
                    let path = leg(q[1]) - leg(q[0]);
                    if path > 0.0 { (2.0 * rise / (q[1] - q[0]) * path * delta).min(rise * grazed) } else { 0.0 }
                })
                .sum()
            }
        };
        let edge = (2.0 * delta / leg(1.0)).min(grazed);
        gentle + 2.0 * self.most * delta + self.rim * edge
    }
}
