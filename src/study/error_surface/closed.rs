//! The closed forms that follow from the definitions.
//!
//! With q = a C_x/s + b C_y d/(s L), W = d - r q the depth of the viewpoint billboard's point, and the differences of
//! nearly equal lengths rewritten, s - d = C_x^2/(s + d) and L - s = C_y^2/(L + s):
//! - e_x = -N r a [C_x^2/(s + d) + r q] / (d W);
//! - e_y = -N r [a C_x C_y/s + b d C_y^2/(s (L + s)) + r b q] / (d W).
//!
//! Proof of the first: e_x d W / N = (C_x + r a)(d - r q) - (C_x + r a d/s - r b C_x C_y/(s L)) d. The terms with b cancel
//! but for those in q, and what is left is r [a d (1 - d/s) - a C_x^2/s - r a q], where d (s - d)/s = d C_x^2/(s (s + d)).
//! The second goes alike. For E (a = 1, b = 0): e_x = -N r C_x [s C_x/(s + d) + r] / (d (d s - r C_x)) and
//! e_y = -N r C_x C_y / (d (d s - r C_x)).
//!
//! The parallax error is a divided difference of these (`slope`), so that it does not cancel for a small interocular
//! distance.

use super::slope::Slope;
use super::{Component, Quantity, Setting};
use glam::{DVec3, Vec3};

/// The error at a billboard with its centre at `c`, camera space of the cyclopean eye, in units of the view plane; `None`
/// at and past the pole: where the centre or the point of the viewpoint billboard is not in front of an eye.
pub fn error(setting: &Setting, c: DVec3) -> Option<f64> {
    match setting.quantity {
        Quantity::Projection => projection(setting, c),
        Quantity::Parallax => parallax(setting, c),
    }
}

fn projection(setting: &Setting, c: DVec3) -> Option<f64> {
    let Setting { point, radius: r, near, .. } = *setting;
    let (a, b) = (point.a, point.b);
    let d = -c.z;
    let s = c.x.hypot(d);
    let length = s.hypot(c.y);
    let q = a * c.x / s + b * c.y * d / (s * length);
    let depth = d - r * q;
    if !(d > 0.0 && depth > 0.0) {
        return None;
    }
    let sum = match setting.component {
        Component::X => a * (c.x * (c.x / (s + d)) + r * q),
        Component::Y => a * c.y * (c.x / s) + b * d * (c.y / s) * (c.y / (length + s)) + r * b * q,
    };
    Some(-near * r * (sum / (d * depth)))
}

fn parallax(setting: &Setting, c: DVec3) -> Option<f64> {
    let Setting { point, radius, near, interocular, .. } = *setting;
    let half = 0.5 * interocular;
    // The centre as the left eye and as the right eye see it.
    let x = Slope::variable(c.x + half, c.x - half);
    let [a, b, r, d, y] = [point.a, point.b, radius, -c.z, c.y].map(Slope::constant);
    let s = (x * x + d * d).sqrt();
    let length = (s * s + y * y).sqrt();
    let q = a * x / s + b * y * d / (s * length);
    let depth = d - r * q;
    if !(-c.z > 0.0 && depth.at0 > 0.0 && depth.at1 > 0.0) {
        return None;
    }
    let sum = match setting.component {
        Component::X => a * (x * x / (s + d) + r * q),
        Component::Y => a * x * y / s + b * d * y * y / (s * (length + s)) + r * b * q,
    };
    let error = Slope::constant(-near) * r * sum / (d * depth);
    Some(-interocular * error.slope)
}

/// [`error`] of the projection in single precision throughout.
pub fn projection_f32(setting: &Setting, c: Vec3) -> Option<f32> {
    let (a, b) = (setting.point.a as f32, setting.point.b as f32);
    let (r, near) = (setting.radius as f32, setting.near as f32);
    let d = -c.z;
    let s = c.x.hypot(d);
    let length = s.hypot(c.y);
    let q = a * (c.x / s) + b * (c.y / length) * (d / s);
    let depth = d - r * q;
    if !(d > 0.0 && depth > 0.0) {
        return None;
    }
    let sum = match setting.component {
        Component::X => a * (c.x * (c.x / (s + d)) + r * q),
        Component::Y => a * c.y * (c.x / s) + b * d * (c.y / s) * (c.y / (length + s)) + r * b * q,
    };
    Some(-near * r * (sum / d / depth))
}
