//! Lengths on the view plane as pixels of a picture and as angles at a viewer's eye.

/// A picture on the view plane: symmetric frustum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Vertical field of view, radians, in (0, pi).
    pub fov_y: f64,
    /// Width and height in pixels, > 0.
    pub size: [u32; 2],
}

impl Frame {
    /// Tangents of half the field of view, horizontal and vertical: the frame's half extent on a view plane at distance 1.
    pub fn half_extent(&self) -> [f64; 2] {
        let y = (0.5 * self.fov_y).tan();
        [y * f64::from(self.size[0]) / f64::from(self.size[1]), y]
    }
}

/// Somebody who looks at the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewer {
    /// Distance from the screen in metres, > 0.
    pub distance_m: f64,
    /// Width of the picture on the screen in metres, > 0.
    pub screen_width_m: f64,
}

/// What an error is measured in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// Lengths on the view plane, scene units.
    Length,
    /// Pixels of the frame.
    Pixels(Frame),
    /// Arc minutes at the viewer's eye: the largest angle that the length subtends anywhere on the screen, which it does in
    /// front of the eye, 2 atan(length / (2 distance)).
    ArcMinutes(Frame, Viewer),
}

impl Unit {
    /// The unit in words, as axes show it.
    pub fn label(&self) -> &'static str {
        match self {
            Self::Length => "scene units",
            Self::Pixels(_) => "pixels",
            Self::ArcMinutes(..) => "arc minutes",
        }
    }

    /// A length on the view plane at distance `near` in this unit; the sign stays.
    pub fn from_length(&self, length: f64, near: f64) -> f64 {
        match self {
            Self::Length => length,
            Self::Pixels(frame) => length * (f64::from(frame.size[1]) / (2.0 * near * frame.half_extent()[1])),
            Self::ArcMinutes(frame, viewer) => {
                let on_screen = length * (viewer.screen_width_m / (2.0 * near * frame.half_extent()[0]));
                2.0 * (on_screen / (2.0 * viewer.distance_m)).atan() * ARC_MINUTES
            }
        }
    }

    /// The length on the view plane at distance `near` that this many units are; infinite for half a turn and more.
    pub fn to_length(&self, value: f64, near: f64) -> f64 {
        match self {
            Self::Length => value,
            Self::Pixels(frame) => value * (2.0 * near * frame.half_extent()[1] / f64::from(frame.size[1])),
            Self::ArcMinutes(frame, viewer) => {
                let half_angle = 0.5 * value / ARC_MINUTES;
                if half_angle >= std::f64::consts::FRAC_PI_2 {
                    return f64::INFINITY;
                }
                let on_screen = 2.0 * viewer.distance_m * half_angle.tan();
                on_screen * (2.0 * near * frame.half_extent()[0] / viewer.screen_width_m)
            }
        }
    }
}

/// Arc minutes in a radian.
const ARC_MINUTES: f64 = 180.0 * 60.0 / std::f64::consts::PI;
