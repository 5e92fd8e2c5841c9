//! The errors from their definitions: both points are built with vectors, projected and subtracted. Nothing here is
//! simplified; what cancels, cancels.

use super::{Alignment, Component, Quantity, Setting};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// The error at a billboard with its centre at `c`, camera space of the cyclopean eye, in units of the view plane; `None`
/// where the centre or a point is not in front of an eye, or an eye is inside the ball on whose surface `perspective` has
/// its point.
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
    let project = |p: DVec3| DVec2::new(setting.near * p.x / -p.z, setting.near * p.y / -p.z);
    let [first, second] = setting.alignments;
    Some(project(point(setting, first, c)?) - project(point(setting, second, c)?))
}

/// Where an alignment shows the point, or a place on its ray.
fn point(setting: &Setting, alignment: Alignment, c: DVec3) -> Option<DVec3> {
    let (a, b) = (setting.point.a * setting.radius, setting.point.b * setting.radius);
    let to_eye = -c;
    let across = DVec3::Y.cross(to_eye);
    // The eye on the y axis through the centre: camera x, as everywhere.
    let u = if across == DVec3::ZERO { DVec3::X } else { across.normalize() };
    let v = to_eye.normalize().cross(u);
    let offset = a * u + b * v;
    let point = match alignment {
        Alignment::Viewplane => c + a * DVec3::X + b * DVec3::Y,
        Alignment::Viewpoint => c + offset,
        Alignment::Perspective if offset == DVec3::ZERO => c,
        Alignment::Perspective => {
            // The ray that passes the centre at the offset's length: its angle has that sine.
            let sine = offset.length() / c.length();
            if sine >= 1.0 {
                return None;
            }
            let angle = sine.asin();
            angle.cos() * c.normalize() + angle.sin() * offset.normalize()
        }
    };
    (c.z < 0.0 && point.z < 0.0).then_some(point)
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
    let near = setting.near as f32;
    let project = |p: Vec3| Vec2::new(near * p.x / -p.z, near * p.y / -p.z);
    let [first, second] = setting.alignments;
    Some(project(point_f32(setting, first, c)?) - project(point_f32(setting, second, c)?))
}

fn point_f32(setting: &Setting, alignment: Alignment, c: Vec3) -> Option<Vec3> {
    let radius = setting.radius as f32;
    let (a, b) = (setting.point.a as f32 * radius, setting.point.b as f32 * radius);
    let to_eye = -c;
    let across = Vec3::Y.cross(to_eye);
    let u = if across == Vec3::ZERO { Vec3::X } else { across.normalize() };
    let v = to_eye.normalize().cross(u);
    let offset = a * u + b * v;
    let point = match alignment {
        Alignment::Viewplane => c + a * Vec3::X + b * Vec3::Y,
        Alignment::Viewpoint => c + offset,
        Alignment::Perspective if offset == Vec3::ZERO => c,
        Alignment::Perspective => {
            let sine = offset.length() / c.length();
            if sine >= 1.0 {
                return None;
            }
            let angle = sine.asin();
            angle.cos() * c.normalize() + angle.sin() * offset.normalize()
        }
    };
    (c.z < 0.0 && point.z < 0.0).then_some(point)
}
