//! The paper's figures of error surfaces. It prints no values: radius, view plane and interocular distance are
//! [`Setting::default`]'s, the ranges are chosen to show what it describes, from the view plane (C_z = -N) away.

use super::grid::{Grid, Plane, Range};
use super::{Component, Quantity, Setting};

/// One of the paper's figures.
#[derive(Clone, Copy, Debug)]
pub struct Figure {
    /// Its number.
    pub number: u8,
    /// Which error.
    pub quantity: Quantity,
    /// Which component.
    pub component: Component,
    /// Which coordinates of the centre vary, and the value of the third.
    pub plane: Plane,
}

/// Height of the billboards' centres where C_x and C_z vary: off the axis, since the vertical error is odd in it.
const HEIGHT: f64 = 1.0;

/// Depth where C_x and C_y vary: twice the distance of the view plane.
const DEPTH: f64 = 2.0;

const XZ: Plane = Plane::Xz { y: HEIGHT };
const XY: Plane = Plane::Xy { z: -DEPTH };

/// The eight figures.
pub const FIGURES: &[Figure] = &[
    Figure { number: 4, quantity: Quantity::Projection, component: Component::X, plane: XZ },
    Figure { number: 5, quantity: Quantity::Projection, component: Component::X, plane: XY },
    Figure { number: 8, quantity: Quantity::Projection, component: Component::Y, plane: XZ },
    Figure { number: 9, quantity: Quantity::Projection, component: Component::Y, plane: XY },
    Figure { number: 10, quantity: Quantity::Parallax, component: Component::X, plane: XZ },
    Figure { number: 11, quantity: Quantity::Parallax, component: Component::X, plane: XY },
    Figure { number: 12, quantity: Quantity::Parallax, component: Component::Y, plane: XZ },
    Figure { number: 13, quantity: Quantity::Parallax, component: Component::Y, plane: XY },
];

impl Figure {
    /// The figure of that number.
    pub fn of(number: u8) -> Option<&'static Self> {
        FIGURES.iter().find(|figure| figure.number == number)
    }

    /// What the error is asked of.
    pub fn setting(&self) -> Setting {
        Setting { quantity: self.quantity, component: self.component, ..Setting::default() }
    }

    /// Where.
    pub fn grid(&self) -> Grid {
        Grid::default_for(self.plane)
    }
}

impl Grid {
    /// The grid of a figure with that plane: 81 x 81 centres, C_x and C_y from -2 to 2, C_z from -6 to -1.
    pub fn default_for(plane: Plane) -> Self {
        let across = Range { min: -2.0, max: 2.0, count: 81 };
        let away = Range { min: -6.0, max: -1.0, count: 81 };
        let second = match plane {
            Plane::Xz { .. } => away,
            Plane::Xy { .. } => across,
        };
        Self { x: across, second, plane }
    }
}
