//! Disparity: where each pixel's point stands in the other eye's picture.

use super::Plane;

/// The eye that a disparity belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The left eye's picture, pointing into the right eye's.
    Left,
    /// The right eye's picture, pointing into the left eye's.
    Right,
}

impl Side {
    /// Both, the left one first.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];

    /// The name of its EXR channel: Nuke's layers `disparityL`, from the left view to the right, and `disparityR`, from the
    /// right view to the left. There is no `.y`: parallel axes have no vertical parallax.
    pub fn channel(self) -> &'static str {
        match self {
            Self::Left => "disparityL.x",
            Self::Right => "disparityR.x",
        }
    }

    /// `left` or `right`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// The disparity of one view of a pair with parallel axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Disparity {
    /// Whose picture this is.
    pub side: Side,
    /// How many pixels to add to a pixel's x to find the point at its mean depth in the other eye's picture, which may be
    /// beside it; NaN where nothing but the background is seen. Row-major, row 0 on top.
    pub x: Plane<f32>,
}
