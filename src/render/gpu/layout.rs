//! What shaders read, in Rust: twins of `shaders/types.wgsl`, where the fields are described.

use bytemuck::{Pod, Zeroable};

/// A particle of one view.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Splat {
    /// Form of the column: value at the anchor, change per column.
    pub x: [f32; 2],
    /// Form of the row: value at the anchor, change per row.
    pub y: [f32; 2],
    /// Form of both: value at the anchor, change per column, change per row.
    pub both: [f32; 3],
    /// The method's own.
    pub own: f32,
    /// How far the ray has come: value at the anchor, change per column, change per row.
    pub ahead: [f32; 3],
    /// Where fragments begin in that measure.
    pub front: f32,
    /// Linear-light colour.
    pub color: [f32; 3],
    /// Factor of the footprint.
    pub amplitude: f32,
    /// Column and row of the anchor.
    pub anchor: [f32; 2],
    /// Greatest footprint.
    pub most: f32,
    /// Intervals of the footprint table; 0 for the Gaussian.
    pub intervals: f32,
    /// First entry of the table.
    pub table: u32,
    /// The method's own.
    pub inverse: f32,
    /// Up to the alignment of the shader's.
    pub padding: [u32; 2],
}

/// A particle of one view that slabs cut. All lengths are in radii but `depth`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Ball {
    /// As in [`Splat`].
    pub x: [f32; 2],
    /// As in [`Splat`].
    pub y: [f32; 2],
    /// As in [`Splat`].
    pub both: [f32; 3],
    /// Depth of the first plane of all from the centre.
    pub plane: f32,
    /// Linear-light colour.
    pub color: [f32; 3],
    /// Optical depth in powers of two per unit of the kernel's integral.
    pub amplitude: f32,
    /// As in [`Splat`].
    pub anchor: [f32; 2],
    /// Distance of the planes.
    pub step: f32,
    /// Depth of the near plane from the centre.
    pub near: f32,
    /// Of the centre, in scene units.
    pub depth: f32,
    /// 1 / radius.
    pub inverse: f32,
    /// The kernel's kind: 0 Gaussian, 1 Beliaev, 2 constant, 3 poly, 4 shells.
    pub shape: u32,
    /// First shell.
    pub shell: u32,
    /// Number of shells.
    pub shells: u32,
    /// Up to the alignment of the shader's.
    pub padding: [u32; 3],
}

/// A particle of one view that slices cut: a disc parallel to the image. All lengths are in radii but `depth`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Disc {
    /// As in [`Splat`].
    pub x: [f32; 2],
    /// As in [`Splat`].
    pub y: [f32; 2],
    /// Linear-light colour.
    pub color: [f32; 3],
    /// Optical depth through the centre.
    pub thickness: f32,
    /// As in [`Splat`].
    pub anchor: [f32; 2],
    /// Depth of the plane behind its first slice from the centre.
    pub plane: f32,
    /// Distance of the planes.
    pub step: f32,
    /// Depth from the centre where it begins: -1, or that of the near plane.
    pub start: f32,
    /// Of the centre, in scene units.
    pub depth: f32,
    /// 1 / radius.
    pub inverse: f32,
    /// Number of the table's segments.
    pub segments: f32,
    /// First entry of the table.
    pub table: u32,
    /// First slice, counted from the first of all groups.
    pub first: u32,
    /// Up to the alignment of the shader's.
    pub padding: [u32; 2],
}

/// A view, or some rows of it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct View {
    /// Columns of the picture and rows of this part.
    pub size: [u32; 2],
    /// First row of the part.
    pub first_row: u32,
    /// Tiles in a row of tiles.
    pub across: u32,
    /// Tangents of the ray through the centre of pixel (0, 0).
    pub tangent: [f32; 2],
    /// Their change per pixel.
    pub step: [f32; 2],
    /// What is behind everything.
    pub background: [f32; 3],
    /// Transmittance below which a tile ends.
    pub stop: f32,
    /// [`View::FIRST`], [`View::LAST`], [`View::SURFACES`].
    pub flags: u32,
    /// First group of eight slabs or slices of this submission; 0 without them.
    pub first_group: u32,
    /// Number of groups; 0 without them.
    pub groups: u32,
    /// Number of all slabs; 0 without slabs.
    pub slabs: u32,
}

/// Some columns of a view in a target.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Window {
    /// Columns and rows of the target.
    pub extent: [u32; 2],
    /// First column of the target.
    pub at: u32,
    /// First column of the view.
    pub first: u32,
    /// Number of columns.
    pub columns: u32,
    /// Up to the alignment of the shader's.
    pub padding: u32,
}

/// A particle of the scene, about the scene's middle: high and low parts. Twin of the one in `shaders/project/project.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Particle {
    /// High parts of the centre.
    pub high: [f32; 3],
    /// High part of the radius.
    pub radius: f32,
    /// Low parts of the centre.
    pub low: [f32; 3],
    /// Low part of the radius.
    pub radius_low: f32,
    /// Linear-light colour.
    pub color: [f32; 3],
    /// As in [`Splat`]; 0: not shown.
    pub amplitude: f32,
}

/// Particles that share a kernel. Twin of the one in `shaders/project/project.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Kind {
    /// First particle.
    pub start: u32,
    /// As in [`Splat`].
    pub table: u32,
    /// As in [`Splat`].
    pub intervals: f32,
}

/// A view that particles are projected to; vectors have high and low parts. Twin of the one in `shaders/project/project.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Eye {
    /// About the scene's middle.
    pub position: [[f32; 4]; 2],
    /// World-space direction of eye-space x.
    pub right: [[f32; 4]; 2],
    /// World-space direction of eye-space y.
    pub up: [[f32; 4]; 2],
    /// World-space direction of depth.
    pub forward: [[f32; 4]; 2],
    /// Tangents of the ray through the centre of pixel (0, 0): x high, x low, y high, y low.
    pub tangent: [f32; 4],
    /// Their change per pixel.
    pub step: [f32; 4],
    /// Pixels per unit of tangent.
    pub focal: [f32; 2],
    /// Picture coordinates of tangent (0, 0).
    pub center: [f32; 2],
}

/// What projection knows. Twin of the one in `shaders/project/project.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Projection {
    /// One or two views.
    pub eyes: [Eye; 2],
    /// Distance of the near plane: high and low part.
    pub near: [f32; 2],
    /// A depth so close to that of the near plane is not told from it.
    pub hair: f32,
    /// 0, which compilers do not know.
    pub nothing: u32,
    /// Of the picture.
    pub size: [u32; 2],
    /// First row, and that after the last.
    pub rows: [u32; 2],
    /// Number of particles.
    pub particles: u32,
    /// Number of views.
    pub views: u32,
    /// Number of kinds.
    pub kinds: u32,
    /// 1 in the linear opacity model.
    pub linear: u32,
    /// Number of views with keys of their own: 1 where all share those of the first.
    pub orders: u32,
    /// Up to the alignment of the shader's.
    pub padding: [u32; 3],
}

/// What a kernel of the lists is told. Twin of the one in `shaders/lists/work.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Work {
    /// Elements, or those that stand for all views that share their order.
    pub count: u32,
    /// Lowest bit of the digit.
    pub shift: u32,
    /// Blocks of 1024 elements.
    pub blocks: u32,
    /// Particles of the scene.
    pub particles: u32,
    /// Keys of tiles from view to view.
    pub stride: u32,
    /// Tiles in a row of tiles.
    pub across: u32,
    /// Views that share the order.
    pub together: u32,
    /// Up to the alignment of every device's.
    pub padding: u32,
}

impl View {
    /// The first batch of particles: nothing is drawn yet.
    pub const FIRST: u32 = 1;
    /// The last batch: what is behind the gas is added.
    pub const LAST: u32 = 2;
    /// There are opaque surfaces.
    pub const SURFACES: u32 = 4;
}

/// A number as the sum of two of single precision, high part first.
#[inline]
pub fn parts(value: f64) -> [f32; 2] {
    let high = value as f32;
    [high, (value - f64::from(high)) as f32]
}

/// The largest finite value with the sign of an infinite one: shaders need not know infinity.
#[inline]
pub fn finite(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}
