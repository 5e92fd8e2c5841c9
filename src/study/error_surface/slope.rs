//! Divided differences of formulas (R. Krawczyk & A. Neumaier, *Interval slopes for rational functions and associated
//! centered forms*, 1985): a number at two places together with its difference over that of the places, carried through
//! every operation. The difference of two nearly equal values is then as exact as the values.

use num_traits::Float;
use std::ops::{Add, Div, Mul, Sub};

/// A quantity at two places x0 and x1, and (f(x1) - f(x0)) / (x1 - x0), which for x1 = x0 is the derivative.
#[derive(Clone, Copy, Debug)]
pub struct Slope<T> {
    /// f(x0).
    pub at0: T,
    /// f(x1).
    pub at1: T,
    /// The divided difference.
    pub slope: T,
}

impl<T: Float> Slope<T> {
    /// The same everywhere.
    pub fn constant(value: T) -> Self {
        Self { at0: value, at1: value, slope: T::zero() }
    }

    /// A multiple.
    pub fn times(self, factor: T) -> Self {
        Self { at0: factor * self.at0, at1: factor * self.at1, slope: factor * self.slope }
    }
}

impl<T: Float> Add for Slope<T> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { at0: self.at0 + other.at0, at1: self.at1 + other.at1, slope: self.slope + other.slope }
    }
}

impl<T: Float> Sub for Slope<T> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { at0: self.at0 - other.at0, at1: self.at1 - other.at1, slope: self.slope - other.slope }
    }
}

impl<T: Float> Mul for Slope<T> {
    type Output = Self;

    /// f1 g1 - f0 g0 = (f1 - f0) (g0 + g1) / 2 + (f0 + f1) / 2 (g1 - g0): symmetric, so that halves do not lean to a side.
    fn mul(self, other: Self) -> Self {
        let two = T::one() + T::one();
        let middle = |s: Self| (s.at0 + s.at1) / two;
        Self {
            at0: self.at0 * other.at0,
            at1: self.at1 * other.at1,
            slope: self.slope * middle(other) + middle(self) * other.slope,
        }
    }
}

impl<T: Float> Div for Slope<T> {
    type Output = Self;

    /// f1/g1 - f0/g0 = [(f1 - f0) - (f0/g0) (g1 - g0)] / g1.
    fn div(self, other: Self) -> Self {
        let (at0, at1) = (self.at0 / other.at0, self.at1 / other.at1);
        Self { at0, at1, slope: (self.slope - at0 * other.slope) / other.at1 }
    }
}
