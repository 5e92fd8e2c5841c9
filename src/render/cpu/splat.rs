//! What the tile engine asks of a method: how a particle becomes a splat on the picture, and what one fragment costs.
//!
//! A *fragment* is one particle at one pixel. Its value is a product `a * b`: the footprint times the particle's amplitude
//! (optical depth in powers of two, or opacity). Everything that depends on the column or on the row alone is computed
//! once per column and row of a tile.

use super::footprint::Table;
use super::rim::Rim;
use super::simd::Simd;
use crate::scene::View;
use glam::{DVec2, DVec3};

/// Columns and rows of the picture that a splat may cover, inclusive; empty where `first > last`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// First and last column.
    pub x: [u32; 2],
    /// First and last row.
    pub y: [u32; 2],
}

impl Bounds {
    /// Covers nothing.
    pub const EMPTY: Self = Self { x: [1, 0], y: [1, 0] };

    /// Pixels whose centres lie in the intervals of picture coordinates; empty outside the picture. Grown by a hair, so
    /// that rounding never cuts a pixel off: fragments decide for themselves whether they are covered.
    #[inline]
    pub fn from_intervals(x: [f64; 2], y: [f64; 2], size: [u32; 2]) -> Self {
        // The conversions truncate; f64::ceil and f64::floor would be calls where the baseline has no instruction.
        let range = |[low, high]: [f64; 2], size: u32| {
            let slack = 1e-3;
            let edge = f64::from(size);
            let first = (low + (0.5 - slack)).clamp(0.0, edge) as u32;
            let end = (high + (0.5 + slack)).clamp(0.0, edge) as u32;
            // False for NaN, which converts to 0.
            (first < end).then(|| [first, end - 1])
        };
        match (range(x, size[0]), range(y, size[1])) {
            (Some(x), Some(y)) => Self { x, y },
            _ => Self::EMPTY,
        }
    }

    /// How many pixels it covers; not of one that covers nothing.
    #[inline]
    pub fn pixels(&self) -> usize {
        [self.x, self.y].map(|[first, last]| (last + 1 - first) as usize).into_iter().product()
    }

    /// First and last column and row of the cells that it touches, so many pixels wide and high; not of one that covers nothing.
    #[inline]
    pub fn cells(&self, sides: [usize; 2]) -> [[usize; 2]; 2] {
        let along = |range: [u32; 2], side: usize| range.map(|at| at as usize / side);
        [along(self.x, sides[0]), along(self.y, sides[1])]
    }

    /// Whether it covers nothing.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.x[0] > self.x[1]
    }
}

/// Which fragments draw a particle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Those of Gaussians: by a formula.
    #[default]
    Gauss,
    /// Those of every other kernel: by a table.
    Radial,
    /// Those of small Gaussians by rays that are taken for parallel.
    Affine,
}

/// A prepared particle of one view.
#[derive(Clone, Copy, Default)]
pub struct Item<T> {
    /// The method's own numbers.
    pub splat: T,
    /// Factor of the footprint: -log2(1 - rho), or rho itself in the linear opacity model.
    pub amplitude: f32,
    /// Linear-light colour.
    pub color: [f32; 3],
    /// Which fragments draw it.
    pub kind: Kind,
    /// The kernel's footprint table.
    pub table: Table,
    /// Greatest footprint: the linear opacity model ends at opacity 1 where a kernel is denser off its centre.
    pub most: f32,
    /// Least and greatest depth at which the splat may be cut by opaque surfaces.
    pub depths: [f32; 2],
    /// Where the method's fragments begin, in its own measure: beyond the eye, or beyond the near plane; -infinity: always.
    pub front: f32,
}

/// A view as the preparation of splats needs it: from tangents to picture coordinates by a product and a sum.
#[derive(Clone, Copy, Debug)]
pub struct Lens<'a> {
    /// The view.
    pub view: &'a View,
    /// Pixels per unit of tangent.
    pub focal: DVec2,
    /// Picture coordinates of tangent (0, 0).
    pub center: DVec2,
}

impl<'a> Lens<'a> {
    /// The lens of a view.
    pub fn new(view: &'a View) -> Self {
        Self { view, focal: view.focal_px(), center: view.picture_from_tangent(DVec2::ZERO) }
    }

    /// Picture coordinates of a tangent.
    #[inline(always)]
    pub fn picture(&self, x: f64, y: f64) -> DVec2 {
        DVec2::new(self.center.x + x * self.focal.x, self.center.y - y * self.focal.y)
    }

    /// Pixels that show the part of a ball behind the near plane; `center` is in eye space. The farthest point of the ball is
    /// behind the near plane.
    #[inline]
    pub fn ball_bounds(&self, center: DVec3, radius: f64) -> Bounds {
        let [x, y] = self.ball_intervals(center, radius);
        Bounds::from_intervals(x, y, self.view.size)
    }

    /// Least apparent radius of a ball in pixels; the eye in or beside a ball sees it large.
    #[inline(always)]
    pub fn least_radius(&self, center: DVec3, radius: f64) -> f64 {
        let (focal, depth) = (self.focal.min_element(), -center.z);
        if depth > radius { focal * radius / depth } else { focal }
    }

    /// Intervals of picture coordinates, along x and y, that hold what [`Lens::ball_bounds`] is about.
    #[inline]
    pub fn ball_intervals(&self, center: DVec3, radius: f64) -> [[f64; 2]; 2] {
        let (depth, near) = (-center.z, self.view.near);
        let interval = |at: f64| {
            if depth > 0.0 {
                tangent_interval(at, depth, radius)
            } else {
                // The ball lies within a box; what of that is beyond the near plane is seen the wider the nearer it is.
                let ([low, high], far) = ([at - radius, at + radius], depth + radius);
                [low / if low < 0.0 { near } else { far }, high / if high > 0.0 { near } else { far }]
            }
        };
        if depth > radius {
            return self.whole_ball_intervals(center, radius);
        }
        self.intervals(interval(center.x), interval(center.y))
    }

    /// [`Lens::ball_intervals`] of a ball that lies in front of the eye plane with all of it; any numbers for others.
    #[inline(always)]
    pub fn whole_ball_intervals(&self, center: DVec3, radius: f64) -> [[f64; 2]; 2] {
        // The edges' tangents are the roots of (at - depth t)^2 = radius^2 (1 + t^2): one division serves all four.
        let depth = -center.z;
        let inverse = 1.0 / (depth * depth - radius * radius);
        let edges = |at: f64| {
            let root = radius * (at * at + depth * depth - radius * radius).sqrt();
            [(at * depth - root) * inverse, (at * depth + root) * inverse]
        };
        self.intervals(edges(center.x), edges(center.y))
    }

    /// Intervals of picture coordinates of intervals of tangents.
    #[inline(always)]
    fn intervals(&self, x: [f64; 2], y: [f64; 2]) -> [[f64; 2]; 2] {
        let (low, high) = (self.picture(x[0], y[1]), self.picture(x[1], y[0]));
        [[low.x, high.x], [low.y, high.y]]
    }
}

/// Interval of the tangent x/d that a circle covers, seen from the origin; its centre is (x, d), d > 0. Infinite ends
/// where it reaches to the eye plane.
#[inline]
fn tangent_interval(x: f64, d: f64, radius: f64) -> [f64; 2] {
    let distance_squared = x * x + d * d;
    let tangent_squared = distance_squared - radius * radius;
    if tangent_squared <= 0.0 {
        return [f64::NEG_INFINITY, f64::INFINITY];
    }
    // Rotates (x, d) by plus and minus the angle that the circle subtends, without trigonometry.
    let root = tangent_squared.sqrt();
    let edge = |sign: f64| {
        let (along, across) = (d * root - sign * x * radius, x * root + sign * d * radius);
        // An edge that points behind the eye plane leaves the picture on its side.
        if along > 0.0 { across / along } else { sign * f64::INFINITY }
    };
    [edge(-1.0), edge(1.0)]
}

/// Maps pixels of a tile to picture coordinates and tangents.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Picture coordinates of the tile's corner.
    pub corner: [f64; 2],
    /// Ray tangents (X, Y) through that corner.
    pub tangent: [f64; 2],
    /// Change of the tangents from pixel to pixel; the second is negative.
    pub step: [f64; 2],
}

impl Frame {
    /// The frame of the tile whose first pixel is (x, y).
    pub fn new(view: &View, x: u32, y: u32) -> Self {
        let corner = [f64::from(x), f64::from(y)];
        let direction = view.direction(corner[0], corner[1]);
        let focal = view.focal_px();
        Self { corner, tangent: [direction.x, direction.y], step: [1.0 / focal.x, -1.0 / focal.y] }
    }
}

/// A disc parallel to the view plane, or the square around it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Card {
    /// Centre in picture coordinates.
    center: [f64; 2],
    /// 1 / half size in pixels.
    inverse: [f32; 2],
}

impl Card {
    /// The card of a particle with eye-space centre `center`, standing at `depth` > 0, and the pixels that it covers.
    #[inline]
    pub fn new(lens: &Lens, center: DVec3, radius: f64, depth: f64) -> (Self, Bounds) {
        let near = 1.0 / depth;
        let at = lens.picture(center.x * near, center.y * near);
        let half = lens.focal * (radius * near);
        let bounds =
            Bounds::from_intervals([at.x - half.x, at.x + half.x], [at.y - half.y, at.y + half.y], lens.view.size);
        let inverse = [(1.0 / half.x) as f32, (1.0 / half.y) as f32];
        (Self { center: at.to_array(), inverse }, bounds)
    }

    /// Centre and half size, in picture coordinates.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        [self.center, self.inverse.map(|inverse| 1.0 / f64::from(inverse))]
    }

    /// The offset over the radius at a point of the picture, and its change per column and row.
    pub fn offsets(&self, at: [f64; 2]) -> [[f64; 2]; 2] {
        [0, 1].map(|axis| {
            let inverse = f64::from(self.inverse[axis]);
            [(at[axis] - self.center[axis]) * inverse, inverse]
        })
    }

    /// The square of the offset over the radius along one axis, at pixel centres relative to the tile's corner.
    #[inline(always)]
    pub fn offset_squared<S: Simd>(&self, s: S, frame: &Frame, axis: usize, at: S::F) -> S::F {
        let center = (self.center[axis] - frame.corner[axis]) as f32;
        let offset = s.mul(s.sub(at, s.splat(center)), s.splat(self.inverse[axis]));
        s.mul(offset, offset)
    }
}

/// What a fragment needs of its particle beside the tables.
#[derive(Clone, Copy, Default)]
pub struct Constants {
    /// As in [`Item`].
    pub amplitude: f32,
    /// As in [`Item`].
    pub table: Table,
    /// As in [`Item`].
    pub most: f32,
    /// As in [`Item`].
    pub front: f32,
    /// The method's own; see there.
    pub own: [f32; 2],
    /// Linear-light colour.
    pub color: [f32; 3],
}

/// What a fragment needs of its pixel.
#[derive(Clone, Copy)]
pub struct Pixel<F> {
    /// 1 / |dir|^2 of the pixel's ray with dir.z = -1.
    pub weight: F,
    /// The opaque depth in the method's own measure ([`Alignment::opaque_limit`]).
    pub limit: F,
}

/// A method of the tile engine: where its billboard stands and how it is cut.
pub trait Alignment: Copy + Send + Sync + 'static {
    /// Numbers prepared per particle and view.
    type Splat: Copy + Default + Send + Sync + 'static;
    /// Fragments of Gaussian particles.
    type Gauss: Fragment<Self::Splat>;
    /// Fragments of every other kernel.
    type Radial: Fragment<Self::Splat>;
    /// Fragments of the kind [`Kind::Affine`], which are never cut; as [`Alignment::Gauss`] where there are none.
    type Affine: Fragment<Self::Splat>;

    /// Whether its fragments read [`Pixel::weight`].
    const WEIGHTED: bool;
    /// What it is ordered by.
    const KEY: super::order::Key;
    /// Whether a fragment is gas along a piece of a ray: clipped by the near plane, where billboards are dropped with
    /// their centre, and always meant as optical depth, whatever the opacity model.
    const VOLUMETRIC: bool = false;
    /// Whether the particles' kernels apply; else every particle is of the kind [`Alignment::Gauss`].
    const KERNELS: bool = true;

    /// Prepares a particle with eye-space centre `center` and radius `radius`; `square` where the footprint covers the
    /// square billboard and not just the disc. The depth of the centre exceeds that of the near plane; with
    /// [`Alignment::VOLUMETRIC`] that of the farthest point does. `None` where it covers no pixel.
    fn prepare(&self, lens: &Lens, center: DVec3, radius: f64, square: bool) -> Option<Prepared<Self::Splat>>;

    /// The opaque depth of a pixel in the measure that fragments compare; `length_squared` is |dir|^2 with dir.z = -1.
    fn opaque_limit(depth: f64, length_squared: f64) -> f64;

    /// The method's [`Constants::own`].
    fn constants(splat: &Self::Splat) -> [f32; 2];

    /// The most that an affine footprint of a Gaussian may be off, as a share of the optical depth through its centre.
    fn affine_error(_: &Self::Splat) -> f64 {
        f64::INFINITY
    }

    /// Beyond what a prepared particle shows nothing; `square` where billboards are squares: those of Gaussians.
    fn rim(splat: &Self::Splat, lens: &Lens, square: bool) -> Rim;
}

/// What [`Alignment::prepare`] finds.
pub struct Prepared<T> {
    /// The method's own numbers.
    pub splat: T,
    /// Pixels it may cover.
    pub bounds: Bounds,
    /// Least and greatest depth at which it may be cut.
    pub depths: [f64; 2],
    /// As in [`Item`].
    pub front: f32,
}

/// How one fragment is computed. Everything is `#[inline(always)]`.
pub trait Fragment<T>: Copy + Send + Sync + 'static {
    /// How many of the three values per column, and per row, are used at all.
    const PLANES: [usize; 2];
    /// Values that depend on the column; `x` are pixel centres relative to the tile's corner.
    fn column<S: Simd>(s: S, item: &Item<T>, frame: &Frame, x: S::F) -> [S::F; 3];
    /// Values that depend on the row.
    fn row<S: Simd>(s: S, item: &Item<T>, frame: &Frame, y: S::F) -> [S::F; 3];
    /// The fragments of a column of `R` pixels: their values as products of two factors. `rows` are the planes of
    /// [`Fragment::row`]. With `CUT`, 0 where a fragment is behind the opaque surface or not in front of the eye.
    fn values<S: Simd, const R: usize, const CUT: bool>(
        s: S,
        column: &[S::F; 3],
        rows: &[[f32; R]; 3],
        constants: &Constants,
        pixels: &[Pixel<S::F>; R],
        tables: &[f32],
    ) -> [(S::F, S::F); R];
}
