//! The stereo rig: from one camera and two eyes to views, and screen parallax.

use super::camera::{Camera, View};
use glam::{DMat3, DVec2};

/// Distance between the eyes and where their frusta meet.
#[derive(Clone, Debug, PartialEq)]
pub struct Stereo {
    /// Distance between the eyes, scene units, >= 0.
    pub interocular: f64,
    /// Depth D of the zero-parallax plane, > 0; absent: symmetric frusta, the plane at infinity.
    pub convergence: Option<f64>,
    /// How the axes stand.
    pub mode: StereoMode,
}

/// How the axes of the two views stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StereoMode {
    /// Parallel axes, off-axis frusta: no vertical parallax.
    #[default]
    Parallel,
    /// Axes turned to meet on the optical axis at the convergence depth: shows the vertical parallax this causes.
    ToeIn,
}

/// Which eye a view belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    /// The left eye, at -I/2 along camera x.
    Left,
    /// The right eye, at +I/2 along camera x.
    Right,
    /// The only view of a scene without stereo.
    Mono,
}

impl StereoMode {
    /// The name that scene files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parallel => "parallel",
            Self::ToeIn => "toe-in",
        }
    }
}

impl Eye {
    /// The name that file names use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Mono => "mono",
        }
    }
}

impl Stereo {
    /// Screen parallax x_right - x_left of a point at depth `d` with parallel axes, measured in the zero-parallax plane,
    /// I (1 - D/d) in scene units; positive: uncrossed, behind the screen. `None` with the plane at infinity, where only
    /// the angle -I/d says anything.
    pub fn parallax(&self, d: f64) -> Option<f64> {
        self.convergence.map(|plane| self.interocular * (1.0 - plane / d))
    }
}

/// The eyes of a rig, in the order of [`views`].
pub fn eyes(stereo: Option<&Stereo>) -> &'static [Eye] {
    if stereo.is_some() { &[Eye::Left, Eye::Right] } else { &[Eye::Mono] }
}

/// Left and right view, or one view without a rig.
pub fn views(camera: &Camera, stereo: Option<&Stereo>) -> Vec<View> {
    let eye_from_world = camera.camera_from_world();
    let size = camera.size.map(|n| n * camera.samples);
    let tangent = (camera.fov_y * 0.5).tan();
    let mono = View {
        position: camera.position,
        light: camera.position,
        eye_from_world,
        half_extent: DVec2::new(tangent * f64::from(camera.size[0]) / f64::from(camera.size[1]), tangent),
        shear: 0.0,
        size,
        near: camera.near,
    };
    let Some(stereo) = stereo else {
        return vec![mono];
    };
    let right = eye_from_world.row(0);
    [-0.5, 0.5]
        .into_iter()
        .map(|side| {
            let offset = side * stereo.interocular;
            let mut view = View { position: camera.position + right * offset, ..mono.clone() };
            match (stereo.mode, stereo.convergence) {
                (StereoMode::Parallel, Some(plane)) => view.shear = -offset / plane,
                // Turned about the camera's y axis so that the optical axis meets the point (0, 0, -D).
                (StereoMode::ToeIn, Some(plane)) => {
                    view.eye_from_world = DMat3::from_rotation_y(-(offset / plane).atan()) * eye_from_world;
                }
                (_, None) => {}
            }
            view
        })
        .collect()
}

/// Whether all views share their depth axis, so that everything that depends on depth alone is computed once.
pub fn share_depth(views: &[View]) -> bool {
    views.windows(2).all(|pair| pair[0].eye_from_world == pair[1].eye_from_world)
}
