//! The errors from their definitions: both billboards are built with vectors, their points projected and subtracted.
//! Nothing here is simplified; what cancels, cancels.

use super::{Component, Quantity, Setting};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// The error at a billboard with its centre at `c`, camera space of the cyclopean eye, in units of the view plane; `None`
/// where the centre or the point of the viewpoint billboard is not in front of an eye.
pub fn error(setting: &Setting, c: DVec3) -> Option<f64> {
    let e = match setting.quantity {
        Quantity::Projection => projection(setting, c)?,
        Quantity::Parallax => {
            let half = DVec3::X * (0.5 * setting.interocular);
            // The right eye stands at +I/2: it sees the centre farther to the left.
            projection(setting, c - half)? - projection(setting, c + half)?
        }
    };
    Some(match setting.component {
        Component::X => e.x,
        Component::Y => e.y,
    })
}

/// The projection error as a vector.
fn projection(setting: &Setting, c: DVec3) -> Option<DVec2> {
    let (a, b) = (setting.point.a * setting.radius, setting.point.b * setting.radius);
    let viewplane = c + a * DVec3::X + b * DVec3::Y;
    let to_eye = -c;
    let across = DVec3::Y.cross(to_eye);
    // The eye on the y axis through the centre: camera x, as everywhere.
    let u = if across == DVec3::ZERO { DVec3::X } else { across.normalize() };
    let v = to_eye.normalize().cross(u);
    let viewpoint = c + a * u + b * v;
    if !(c.z < 0.0 && viewpoint.z < 0.0) {
        return None;
    }
    let project = |p: DVec3| DVec2::new(setting.near * p.x / -p.z, setting.near * p.y / -p.z);
    Some(project(viewplane) - project(viewpoint))
}

/// [`error`] in single precision throughout.
pub fn error_f32(setting: &Setting, c: Vec3) -> Option<f32> {
    let e = match setting.quantity {
        Quantity::Projection => projection_f32(setting, c)?,
        Quantity::Parallax => {
            let half = Vec3::X * (0.5 * setting.interocular as f32);
            projection_f32(setting, c - half)? - projection_f32(setting, c + half)?
        }
    };
    Some(match setting.component {
        Component::X => e.x,
        Component::Y => e.y,
    })
}

fn projection_f32(setting: &Setting, c: Vec3) -> Option<Vec2> {
    let (radius, near) = (setting.radius as f32, setting.near as f32);
    let (a, b) = (setting.point.a as f32 * radius, setting.point.b as f32 * radius);
    let viewplane = c + a * Vec3::X + b * Vec3::Y;
    let to_eye = -c;
    let across = Vec3::Y.cross(to_eye);
    let u = if across == Vec3::ZERO { Vec3::X } else { across.normalize() };
    let v = to_eye.normalize().cross(u);
    let viewpoint = c + a * u + b * v;
    if !(c.z < 0.0 && viewpoint.z < 0.0) {
        return None;
    }
    let project = |p: Vec3| Vec2::new(near * p.x / -p.z, near * p.y / -p.z);
    Some(project(viewplane) - project(viewpoint))
}
