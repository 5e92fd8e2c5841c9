//! `table`: a radial profile, linear between rows (q, density).
//!
//! On a row's shell k = d + m (q - q_j), and the integral of q = sqrt(u^2 + b^2) over u is closed
//! ([u sqrt(u^2 + b^2) + b^2 asinh(u/b)] / 2), so every integral here is exact; no resampling takes place.

use super::{distance_integral, half_chord, linear};

/// A radial profile. Invariants: at least two rows; q ascends strictly from 0 to 1; densities are finite and >= 0, and
/// not all zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    q: Vec<f64>,
    density: Vec<f64>,
    centre: f64,
}

impl Profile {
    /// Checks the invariants; the error names the first offending row (from 0) and what is allowed.
    pub fn new(q: Vec<f64>, density: Vec<f64>) -> Result<Self, String> {
        if q.len() != density.len() {
            return Err(format!(
                "{} distances but {} densities; allowed: one density per distance",
                q.len(),
                density.len()
            ));
        }
        let (Some(&first), Some(&last)) = (q.first(), q.last()) else {
            return Err("the profile has no rows; allowed: at least two, q from 0 to 1".to_owned());
        };
        if first != 0.0 {
            return Err(format!("row 0: q is {first}; allowed: the first q is 0"));
        }
        if let Some(i) = (1..q.len()).find(|&i| !(q[i] > q[i - 1] && q[i] <= 1.0)) {
            let rule = "q ascends strictly from 0 to 1";
            return Err(format!("row {i}: q is {} after {}; allowed: {rule}", q[i], q[i - 1]));
        }
        if last != 1.0 {
            return Err(format!("row {}: q is {last}; allowed: the last q is 1", q.len() - 1));
        }
        if let Some(i) = density.iter().position(|d| !(d.is_finite() && *d >= 0.0)) {
            return Err(format!("row {i}: density is {}; allowed: finite numbers >= 0", density[i]));
        }
        let mut profile = Self { q, density, centre: 0.0 };
        // From the same sum as every chord, so that F(0) is exactly 1.
        let centre = profile.chord(0.0);
        if !(centre > 0.0 && centre.is_finite()) {
            return Err(format!("the density integrates to {centre} through the centre; allowed: greater than 0"));
        }
        profile.centre = centre;
        Ok(profile)
    }

    /// The rows' distances, ascending strictly from 0 to 1.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// The rows' densities, one per distance.
    pub fn densities(&self) -> &[f64] {
        &self.density
    }

    /// K(0), > 0.
    pub fn centre(&self) -> f64 {
        self.centre
    }

    /// A bound of K(u) / K(0) over all u. The least density that nowhere grows and is nowhere less than this one has its
    /// greatest integral through the centre.
    pub fn excess(&self) -> f64 {
        let (mut half, mut later) = (0.0, self.density[self.q.len() - 1]);
        for i in (0..self.q.len() - 1).rev() {
            let (length, here) = (self.q[i + 1] - self.q[i], self.density[i]);
            half += length * later;
            if here > later {
                // The triangle above what comes later: here the density falls from `here` to the next, which is no more.
                let rise = here - later;
                half += 0.5 * rise * length * (rise / (here - self.density[i + 1]));
                later = here;
            }
        }
        (2.0 * half / self.centre).max(1.0)
    }

    /// Density at distance `q` in [0, 1).
    pub fn density(&self, q: f64) -> f64 {
        let shell = self.shell(q);
        self.density[shell] + self.slope(shell) * (q - self.q[shell])
    }

    /// K(u), for u in [0, 1).
    pub fn chord(&self, u: f64) -> f64 {
        2.0 * self.one_side(u, 0.0, half_chord(u))
    }

    /// Integral from `u0` to `u1` at distance `b`, within the ball, u0 < u1.
    pub fn segment(&self, b: f64, u0: f64, u1: f64) -> f64 {
        if u0 >= 0.0 {
            self.one_side(b, u0, u1)
        } else if u1 <= 0.0 {
            self.one_side(b, -u1, -u0)
        } else {
            self.one_side(b, 0.0, -u0) + self.one_side(b, 0.0, u1)
        }
    }

    /// An upper bound of |dF/du|. With k(1) = 0, dK/du = 2 u times the integral of k'(q)/sqrt(q^2 - u^2) over q, at most
    /// max |k'| times the slope of the linear kernel; with k(1) > 0 the tangent at the rim is vertical.
    pub fn slope_bound(&self) -> f64 {
        if self.density.last().is_some_and(|&d| d > 0.0) {
            return f64::INFINITY;
        }
        let steepest = (0..self.q.len() - 1).map(|shell| self.slope(shell).abs()).fold(0.0, f64::max);
        steepest * linear::SLOPE / self.centre
    }

    /// Integral over the ball, shell by shell: 4 pi q^2 times a linear density.
    pub fn content(&self) -> f64 {
        let shells = 0..self.q.len() - 1;
        let sum: f64 = shells
            .map(|shell| {
                let (q0, q1) = (self.q[shell], self.q[shell + 1]);
                // k = base + slope q, with base the value that the line would have at the centre.
                let slope = self.slope(shell);
                let base = self.density[shell] - slope * q0;
                base * (q1.powi(3) - q0.powi(3)) / 3.0 + slope * (q1.powi(4) - q0.powi(4)) / 4.0
            })
            .sum();
        4.0 * std::f64::consts::PI * sum
    }

    /// The shell that holds `q` in [0, 1]: rows `shell` and `shell + 1` are around it.
    fn shell(&self, q: f64) -> usize {
        self.q.partition_point(|&row| row <= q).clamp(1, self.q.len() - 1) - 1
    }

    /// dk/dq within a shell.
    fn slope(&self, shell: usize) -> f64 {
        (self.density[shell + 1] - self.density[shell]) / (self.q[shell + 1] - self.q[shell])
    }

    /// Integral from `u0` to `u1`, both >= 0, shell by shell outwards.
    fn one_side(&self, b: f64, u0: f64, u1: f64) -> f64 {
        let mut sum = 0.0;
        let mut from = u0;
        let mut shell = self.shell((b * b + u0 * u0).sqrt());
        while from < u1 {
            let outer = self.q[shell + 1];
            let last = shell + 2 == self.q.len();
            // Where the line leaves the shell; the last shell takes all that is left, so that rounding loses nothing.
            let to = if last { u1 } else { u1.min(((outer - b) * (outer + b)).max(0.0).sqrt()) };
            if to > from {
                let length = to - from;
                // Clamped to what the shell allows, so that a nearly vertical step does not amplify rounding.
                let rise = distance_integral(b, from, to) - length * self.q[shell];
                let rise = rise.clamp(0.0, length * (outer - self.q[shell]));
                sum += length * self.density[shell] + self.slope(shell) * rise;
                from = to;
            }
            if last {
                break;
            }
            shell += 1;
        }
        sum
    }
}
