//! The camera and its views: pose and off-axis frustum, pixel to ray and point to pixel.

use glam::{DMat3, DVec2, DVec3};

/// The cyclopean camera: where it stands, what it looks at, its lens and its picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// World-space position of the cyclopean eye.
    pub position: DVec3,
    /// World-space point on the optical axis, different from `position`.
    pub look_at: DVec3,
    /// World-space direction that is up in the picture, not parallel to the optical axis.
    pub up: DVec3,
    /// Vertical field of view, radians, in (0, pi).
    pub fov_y: f64,
    /// Width and height of one view in pixels.
    pub size: [u32; 2],
    /// Distance of the near plane, > 0.
    pub near: f64,
    /// Supersampling: `samples` x `samples` per pixel, at least 1.
    pub samples: u32,
}

impl Camera {
    /// Rotation from world to camera space (camera looks down -z, x right, y up).
    pub fn camera_from_world(&self) -> DMat3 {
        let back = (self.position - self.look_at).normalize();
        let right = self.up.cross(back).normalize();
        DMat3::from_cols(right, back.cross(right), back).transpose()
    }

    /// One for unit tests, at the origin.
    #[cfg(test)]
    pub fn for_tests(size: [u32; 2]) -> Self {
        let (position, look_at) = (DVec3::ZERO, DVec3::NEG_Z);
        Self { position, look_at, up: DVec3::Y, fov_y: 1.0, size, near: 0.1, samples: 1 }
    }
}

/// One eye's view: pose, off-axis frustum and pixel grid (after supersampling).
///
/// *Eye space* is the camera space of this view: eye at the origin, looking down -z. With parallel axes it is camera
/// space shifted by the eye's offset along x.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// World-space position of the eye.
    pub position: DVec3,
    /// World-space position of the cyclopean eye, where the light of opaque surfaces stands.
    pub light: DVec3,
    /// Rotation from world to eye space.
    pub eye_from_world: DMat3,
    /// Tangents of half the horizontal and vertical fields of view.
    pub half_extent: DVec2,
    /// Added to the x of every ray direction: -e/D for an eye at offset e converging at depth D, 0 for parallel frusta.
    pub shear: f64,
    /// Picture width and height in samples (pixels times supersampling).
    pub size: [u32; 2],
    /// Distance of the near plane, > 0.
    pub near: f64,
}

impl View {
    /// Eye-space point of a world-space point.
    #[inline]
    pub fn eye_from_point(&self, point_in_world: DVec3) -> DVec3 {
        self.eye_from_world * (point_in_world - self.position)
    }

    /// Eye-space ray direction with z = -1 through continuous picture coordinates (pixel centres at half-integers,
    /// y down), so that a point at depth d on the ray is d times it.
    #[inline]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let [width, height] = self.size.map(f64::from);
        DVec3::new(
            (2.0 * x / width - 1.0) * self.half_extent.x + self.shear,
            (1.0 - 2.0 * y / height) * self.half_extent.y,
            -1.0,
        )
    }

    /// Continuous picture coordinates of an eye-space point with z < 0.
    #[inline]
    pub fn project(&self, point_in_eye: DVec3) -> DVec2 {
        let depth = -point_in_eye.z;
        self.picture_from_tangent(DVec2::new(point_in_eye.x / depth, point_in_eye.y / depth))
    }

    /// Continuous picture coordinates of a ray direction (x, y, -1).
    #[inline]
    pub fn picture_from_tangent(&self, tangent: DVec2) -> DVec2 {
        let [width, height] = self.size.map(f64::from);
        DVec2::new(
            ((tangent.x - self.shear) / self.half_extent.x + 1.0) * 0.5 * width,
            (1.0 - tangent.y / self.half_extent.y) * 0.5 * height,
        )
    }

    /// Pixels per unit of tangent, along x and y (the pixels are square up to rounding of the aspect ratio).
    #[inline]
    pub fn focal_px(&self) -> DVec2 {
        DVec2::new(f64::from(self.size[0]), f64::from(self.size[1])) * 0.5 / self.half_extent
    }
}
