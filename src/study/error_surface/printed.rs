//! Equations (9) to (12) of Johnson & McAllister (2005) as they are printed: viewplane against viewpoint, for the middle of
//! the right edge alone. In f64 and in f32.
//!
//! They do not agree with the paper's own definition: u = (0, 1, 0) x (V - C) is (-C_z, 0, C_x), but -C_x is printed,
//! which is not orthogonal to V - C, and its sign goes on into (10), (11) and (12); (12) has besides a factor s too many
//! (its unit is that of length squared). They are here to be compared.

use super::{Alignment, Component, Point, Quantity, Setting};
use glam::{DVec3, Vec3};
use num_traits::Float;

/// Whether the paper prints a formula for it: viewplane against viewpoint at the middle of the right edge.
pub fn covers(setting: &Setting) -> bool {
    setting.alignments == [Alignment::Viewplane, Alignment::Viewpoint] && setting.point == Point::RIGHT_EDGE
}

/// The error as printed, at a billboard with its centre at `c`; `None` at and past the printed form's own pole,
/// d s = -r C_x, behind an eye, and where [`covers`] says no.
pub fn error(setting: &Setting, c: DVec3) -> Option<f64> {
    evaluate(setting, c.to_array())
}

/// [`error`] in single precision throughout.
pub fn error_f32(setting: &Setting, c: Vec3) -> Option<f32> {
    evaluate(setting, c.to_array())
}

fn evaluate<T: Float>(setting: &Setting, [x, y, z]: [T; 3]) -> Option<T> {
    if !covers(setting) {
        return None;
    }
    match setting.quantity {
        Quantity::Projection => projection(setting, [x, y, z]),
        Quantity::Parallax => {
            let half = T::from(0.5 * setting.interocular)?;
            Some(projection(setting, [x - half, y, z])? - projection(setting, [x + half, y, z])?)
        }
    }
}

fn projection<T: Float>(setting: &Setting, [x, y, z]: [T; 3]) -> Option<T> {
    let (r, near) = (T::from(setting.radius)?, T::from(setting.near)?);
    if z >= T::zero() {
        return None;
    }
    let s = x.hypot(z);
    match setting.component {
        Component::X => {
            let pole = -z * s + r * x;
            (pole > T::zero()).then(|| near * r * (x * x - z * s + r * x - z * z) / (-z * pole))
        }
        Component::Y => {
            let pole = z * s - r * x;
            (pole < T::zero()).then(|| near * r * x * y * s / (z * pole))
        }
    }
}
