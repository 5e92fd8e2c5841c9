//! Divided differences of formulas (R. Krawczyk & A. Neumaier, *Interval slopes for rational functions and associated
//! centered forms*, 1985): a number at two places together with its difference over that of the places, carried through
//! every operation. The difference of two nearly equal values is then as exact as the values.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A quantity at two places x0 and x1, and (f(x1) - f(x0)) / (x1 - x0), which for x1 = x0 is the derivative.
#[derive(Clone, Copy, Debug)]
pub struct Slope {
    /// f(x0).
    pub at0: f64,
    /// f(x1).
    pub at1: f64,
    /// The divided difference.
    pub slope: f64,
}

impl Slope {
    /// The same everywhere.
    pub fn constant(value: f64) -> Self {
        Self { at0: value, at1: value, slope: 0.0 }
    }

    /// The place itself.
    pub fn variable(x0: f64, x1: f64) -> Self {
        Self { at0: x0, at1: x1, slope: 1.0 }
    }

    /// The square root of what is >= 0: (sqrt f1 - sqrt f0) = (f1 - f0) / (sqrt f1 + sqrt f0).
    pub fn sqrt(self) -> Self {
        let (at0, at1) = (self.at0.sqrt(), self.at1.sqrt());
        Self { at0, at1, slope: self.slope / (at0 + at1) }
    }
}

impl Add for Slope {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { at0: self.at0 + other.at0, at1: self.at1 + other.at1, slope: self.slope + other.slope }
    }
}

impl Sub for Slope {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Slope {
    type Output = Self;

    fn neg(self) -> Self {
        Self { at0: -self.at0, at1: -self.at1, slope: -self.slope }
    }
}

impl Mul for Slope {
    type Output = Self;

    /// f1 g1 - f0 g0 = (f1 - f0) (g0 + g1) / 2 + (f0 + f1) / 2 (g1 - g0): symmetric, so that halves do not lean to a side.
    fn mul(self, other: Self) -> Self {
        let middle = |s: Self| 0.5 * s.at0 + 0.5 * s.at1;
        Self {
            at0: self.at0 * other.at0,
            at1: self.at1 * other.at1,
            slope: self.slope * middle(other) + middle(self) * other.slope,
        }
    }
}

impl Div for Slope {
    type Output = Self;

    /// f1/g1 - f0/g0 = [(f1 - f0) - (f0/g0) (g1 - g0)] / g1.
    fn div(self, other: Self) -> Self {
        let (at0, at1) = (self.at0 / other.at0, self.at1 / other.at1);
        Self { at0, at1, slope: (self.slope - at0 * other.slope) / other.at1 }
    }
}
