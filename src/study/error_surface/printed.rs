//! Equations (9) to (12) of Johnson & McAllister (2005) as they are printed, for the middle of the right edge alone.
//!
//! They do not agree with the paper's own definition: u = (0, 1, 0) x (V - C) is (-C_z, 0, C_x), but -C_x is printed,
//! which is not orthogonal to V - C, and its sign goes on into (10), (11) and (12); (12) has besides a factor s too many
//! (its unit is that of length squared). They are here to be compared.

use super::{Component, Quantity, Setting};
use glam::DVec3;

/// The error as printed, at a billboard with its centre at `c`; `None` at and past the printed form's own pole,
/// d s = -r C_x for e_x and d s = r C_x for e_y, and behind an eye.
pub fn error(setting: &Setting, c: DVec3) -> Option<f64> {
    match setting.quantity {
        Quantity::Projection => projection(setting, c),
        Quantity::Parallax => {
            let half = DVec3::X * (0.5 * setting.interocular);
            Some(projection(setting, c - half)? - projection(setting, c + half)?)
        }
    }
}

fn projection(setting: &Setting, c: DVec3) -> Option<f64> {
    let Setting { radius: r, near, .. } = *setting;
    if c.z >= 0.0 {
        return None;
    }
    let s = c.x.hypot(c.z);
    match setting.component {
        Component::X => {
            let pole = -c.z * s + r * c.x;
            (pole > 0.0).then(|| near * r * (c.x * c.x - c.z * s + r * c.x - c.z * c.z) / (-c.z * pole))
        }
        Component::Y => {
            let pole = c.z * s - r * c.x;
            (pole < 0.0).then(|| near * r * c.x * c.y * s / (c.z * pole))
        }
    }
}
