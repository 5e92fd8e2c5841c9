// What the particle shaders read. Rust's twins stand in src/render/gpu/layout.rs.

// A particle of one view. Linear forms are given by their value at the centre of the pixel `anchor` and their change per pixel,
// so that single precision loses nothing wherever in the picture the particle is.
struct Splat {
    // Form of the column alone: value, change per column.
    x: vec2<f32>,
    // Form of the row alone: value, change per row.
    y: vec2<f32>,
    // Form of both: value, change per column, change per row.
    both: vec3<f32>,
    // The method's own.
    own: f32,
    // How far the ray has come at the particle, in the method's measure: value, change per column, change per row.
    ahead: vec3<f32>,
    // Where fragments begin in that measure, or what the method makes of it.
    front: f32,
    // Linear-light colour.
    color: vec3<f32>,
    // Factor of the footprint: optical depth in powers of two, or opacity.
    amplitude: f32,
    // Column and row of a pixel.
    anchor: vec2<f32>,
    // Greatest footprint.
    most: f32,
    // Intervals of the footprint table; 0 for the Gaussian, which has a formula.
    intervals: f32,
    // First entry of the table.
    table: u32,
    // The method's own.
    inverse: f32,
}

// A particle of one view that slabs cut; forms as in Splat: B, A and the third component of c x dir, all over the radius. All
// lengths are in radii but `depth`.
struct Ball {
    x: vec2<f32>,
    y: vec2<f32>,
    both: vec3<f32>,
    // Depth of the first plane of all from the centre.
    plane: f32,
    color: vec3<f32>,
    // Optical depth in powers of two per unit of the kernel's integral.
    amplitude: f32,
    anchor: vec2<f32>,
    // Distance of the planes.
    step: f32,
    // Depth of the near plane from the centre.
    near: f32,
    // Of the centre, in scene units.
    depth: f32,
    inverse: f32,
    // The kernel's kind; its first shell and the number of shells.
    shape: u32,
    shell: u32,
    shells: u32,
}

// A particle of one view that slices cut: a disc parallel to the image; forms as in Splat: offsets over the radius. All lengths are
// in radii but `depth`.
struct Disc {
    x: vec2<f32>,
    y: vec2<f32>,
    color: vec3<f32>,
    // Optical depth through the centre.
    thickness: f32,
    anchor: vec2<f32>,
    // Depth of the plane behind its first slice from the centre.
    plane: f32,
    // Distance of the planes.
    step: f32,
    // Depth from the centre where it begins: -1, or that of the near plane.
    start: f32,
    // Of the centre, in scene units.
    depth: f32,
    inverse: f32,
    // The table of its kernel: number of segments and first entry.
    segments: f32,
    table: u32,
    // First slice, counted from the first of all groups.
    first: u32,
}

// A view, or some rows of it.
struct View {
    // Columns of the picture and rows of this part.
    size: vec2<u32>,
    // First row of the part.
    first_row: u32,
    // Tiles in a row of tiles.
    across: u32,
    // Tangents of the ray through the centre of pixel (0, 0) and their change per pixel.
    tangent: vec2<f32>,
    step: vec2<f32>,
    // What is behind everything.
    background: vec3<f32>,
    // Transmittance below which a tile ends.
    stop: f32,
    // Bits: this is the first batch of particles, it is the last, there are opaque surfaces.
    flags: u32,
    // First group of eight slabs or slices of this submission, the number of groups, and that of all slabs.
    first_group: u32,
    groups: u32,
    slabs: u32,
}

// Some columns of a view in a target.
struct Window {
    // Columns and rows of the target; the last row is for marks.
    extent: vec2<u32>,
    // First column of the target, first column of the view, and their number.
    at: u32,
    first: u32,
    columns: u32,
}

// What fragments need of their pixel.
struct Pixel {
    // Column and row.
    at: vec2<f32>,
    // 1 / |dir|^2 of the ray with dir.z = -1.
    weight: f32,
    // Depth of the opaque surface in the method's measure.
    limit: f32,
}

// A form of the column or the row at an offset from the anchor.
fn along(form: vec2<f32>, offset: f32) -> f32 {
    return fma(offset, form.y, form.x);
}

// A form of both.
fn across(form: vec3<f32>, offset: vec2<f32>) -> f32 {
    return fma(offset.x, form.y, fma(offset.y, form.z, form.x));
}
