//! Opaque meshes: one layer of colour and depth per view, sampled at pixel centres in f64.
//!
//! Visibility follows Olano & Greer, "Triangle scan conversion using 2D homogeneous coordinates" (1997). A triangle with
//! eye-space corners v0, v1, v2 meets the line along `dir` where the three products e0 = (v1 x v2) . dir,
//! e1 = (v2 x v0) . dir and e2 = (v0 x v1) . dir have one sign; e_i over their sum are the barycentric coordinates of the
//! hit. Nothing is divided by a depth, so that triangles beside and behind the eye need no clipping; the depth of the hit
//! tells what lies in front.
//!
//! Two triangles that share an edge see exactly opposite products there (a x b = -(b x a) holds in floating point, and so
//! does all that follows, as long as no step is fused), and the edge itself belongs to both: no ray slips through.
//!
//! What pixels of a row cost most, depths and shading, is written as loops over as many as a vector holds, for the compiler; it fuses
//! nothing, so that pictures are the same with any instructions.

use super::cpu::simd::{Level, Simd, WithSimd, dispatch};
use crate::scene::mesh::{Mesh, Texture, Wrap};
use crate::scene::{Rgb, Scene, View};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Colour and depth of the nearest opaque surface per pixel of one view. Shared by every method, device and reference.
#[derive(Clone, Debug, Default)]
pub struct OpaqueLayer {
    /// Row-major depths in scene units, infinity where the ray meets no surface.
    pub depth: Vec<f64>,
    /// Row-major linear-light colours; meaningless where depth is infinite.
    pub color: Vec<Rgb>,
    /// Least and greatest colour that is seen, per channel; infinite, and the wrong way round, where no surface is.
    pub range: [[f32; 2]; 3],
}

/// The range of no colours.
pub const NO_RANGE: [[f32; 2]; 3] = [[f32::INFINITY, f32::NEG_INFINITY]; 3];

/// What two ranges span.
pub fn wider(a: [[f32; 2]; 3], b: [[f32; 2]; 3]) -> [[f32; 2]; 3] {
    [0, 1, 2].map(|c| [a[c][0].min(b[c][0]), a[c][1].max(b[c][1])])
}

/// Rows that one task draws. Small enough to share the work, large enough that few triangles meet many bands.
const BAND_ROWS: usize = 16;

/// No triangle, in a band's visibility.
const NOTHING: usize = usize::MAX;

/// Draws the meshes of a scene as one view sees them; nothing if there is no triangle. Surfaces count beyond the near
/// plane; the nearest wins, of equals the first in the scene. The same on any number of threads.
pub fn draw(scene: &Scene, view: &View) -> Option<OpaqueLayer> {
    draw_into(scene, view, Level::best(), OpaqueLayer::default())
}

/// As [`draw`], with the instructions of a level that the machine has, into the memory of a layer that is no longer needed. The level
/// changes nothing but the time.
pub fn draw_into(scene: &Scene, view: &View, level: Level, spare: OpaqueLayer) -> Option<OpaqueLayer> {
    if scene.meshes.iter().all(|mesh| mesh.corners.is_empty()) {
        return None;
    }
    let [width, height] = view.size.map(|n| n as usize);
    let surfaces = Surfaces::new(&scene.meshes, view);
    let columns: Vec<f64> = (0..width).map(|x| view.direction(x as f64 + 0.5, 0.5).x).collect();
    let bands = surfaces.bands(view, height);

    let (OpaqueLayer { mut depth, mut color, .. }, count) = (spare, width * height);
    // New memory comes as zeros, untouched: its pages are made by the threads that draw a band.
    if depth.len() != count || color.len() != count {
        (depth, color) = (vec![0.0; count], vec![[0.0; 3]; count]);
    }
    let size = BAND_ROWS * width;
    let bands = depth.par_chunks_mut(size).zip(color.par_chunks_mut(size)).zip(&bands).enumerate().map(
        |(band, ((depth, color), triangles))| {
            depth.fill(f64::INFINITY);
            if triangles.is_empty() {
                return NO_RANGE;
            }
            let band = Band { view, columns: &columns, first_row: band * BAND_ROWS };
            dispatch(level, Draw { band, surfaces: &surfaces, triangles, depth, color })
        },
    );
    let range = bands.reduce(|| NO_RANGE, wider);
    Some(OpaqueLayer { depth, color, range })
}

/// The triangles of all meshes as one view sees them; a triangle's index counts through the meshes.
struct Surfaces<'a> {
    meshes: &'a [Mesh],
    /// Eye-space vertices of each mesh.
    points: Vec<Vec<DVec3>>,
    /// Index of the first triangle of each mesh.
    first: Vec<usize>,
    /// Eye-space position of the light.
    light: DVec3,
    view: &'a View,
}

impl<'a> Surfaces<'a> {
    fn new(meshes: &'a [Mesh], view: &'a View) -> Self {
        let eye = |mesh: &Mesh| mesh.positions.par_iter().map(|&point| view.eye_from_point(point)).collect();
        let mut count = 0;
        let first = meshes
            .iter()
            .map(|mesh| {
                let first = count;
                count += mesh.corners.len();
                first
            })
            .collect();
        Self { meshes, points: meshes.iter().map(eye).collect(), first, light: view.eye_from_point(view.light), view }
    }

    /// The mesh that a triangle belongs to, and its index there.
    fn locate(&self, index: usize) -> (usize, usize) {
        // An empty mesh starts where the next one does: the last mesh that starts at or before the triangle has it.
        let mesh = self.first.partition_point(|&first| first <= index) - 1;
        (mesh, index - self.first[mesh])
    }

    fn triangle(&self, index: usize) -> Triangle {
        let (mesh, triangle) = self.locate(index);
        Triangle::new(self.meshes[mesh].corners[triangle].map(|corner| self.points[mesh][corner as usize]))
    }

    /// The triangles that may show in each band of rows, in ascending order.
    fn bands(&self, view: &View, height: usize) -> Vec<Vec<usize>> {
        let mut bands = vec![Vec::new(); height.div_ceil(BAND_ROWS)];
        for (mesh, points) in self.points.iter().enumerate() {
            let rows: Vec<Option<[usize; 2]>> = self.meshes[mesh]
                .corners
                .par_iter()
                .map(|corners| {
                    bounds(corners.map(|corner| points[corner as usize]), view).map(|[_, _, top, bottom]| [top, bottom])
                })
                .collect();
            for (triangle, [top, bottom]) in rows.into_iter().enumerate().filter_map(|(i, rows)| Some((i, rows?))) {
                for band in &mut bands[top / BAND_ROWS..(bottom - 1) / BAND_ROWS + 1] {
                    band.push(self.first[mesh] + triangle);
                }
            }
        }
        bands
    }
}

/// What visibility needs of a triangle.
struct Triangle {
    corners: [DVec3; 3],
    /// v1 x v2, v2 x v0, v0 x v1.
    edges: [DVec3; 3],
    /// Normal N, not normalised.
    normal: DVec3,
    /// v . N for any v in the plane.
    offset: f64,
    /// Smallest and largest depth of a corner.
    depths: [f64; 2],
}

/// a x b, in a form that is exactly -(b x a). Fusing the products (`mul_add`) would break that.
fn cross(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

impl Triangle {
    fn new(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let edges = [cross(b, c), cross(c, a), cross(a, b)];
        // From the corner nearest to the eye, where the plane's distance cancels least.
        let squares = corners.map(DVec3::length_squared);
        let nearest = if squares[0] <= squares[1] && squares[0] <= squares[2] {
            0
        } else if squares[1] <= squares[2] {
            1
        } else {
            2
        };
        let [p, q, r] = [corners[nearest], corners[(nearest + 1) % 3], corners[(nearest + 2) % 3]];
        let normal = (q - p).cross(r - p);
        let depths = [-(a.z.max(b.z).max(c.z)), -(a.z.min(b.z).min(c.z))];
        Self { corners, edges, normal, offset: p.dot(normal), depths }
    }

    /// The parts of the edge products that do not depend on the column.
    fn row(&self, y: f64) -> [f64; 3] {
        self.edges.map(|n| n.y * y - n.z)
    }

    /// The edge products at a column.
    #[inline(always)]
    fn products(&self, row: [f64; 3], x: f64) -> [f64; 3] {
        [self.edges[0].x * x + row[0], self.edges[1].x * x + row[1], self.edges[2].x * x + row[2]]
    }

    /// The part of the product dir . N that does not depend on the column.
    fn slope(&self, y: f64) -> f64 {
        self.normal.y * y - self.normal.z
    }

    /// Depth of the hit along the direction (x, y, -1), which the edge products have found to meet the triangle.
    #[inline(always)]
    fn depth(&self, slope: f64, row: [f64; 3], x: f64) -> f64 {
        let t = self.quotient(slope, x);
        self.clamp(if t.is_finite() { t } else { self.depth_from_products(self.products(row, x)) })
    }

    /// The depth where the direction meets the plane; no finite number along it.
    #[inline(always)]
    fn quotient(&self, slope: f64, x: f64) -> f64 {
        self.offset / (self.normal.x * x + slope)
    }

    /// Seen edge-on the quotient is noise; the triangle is still between its corners.
    #[inline(always)]
    fn clamp(&self, t: f64) -> f64 {
        let [nearest, farthest] = self.depths;
        let t = if t > nearest { t } else { nearest };
        if t < farthest { t } else { farthest }
    }

    /// The depth from the barycentric coordinates.
    #[cold]
    fn depth_from_products(&self, e: [f64; 3]) -> f64 {
        let [a, b, c] = self.corners;
        -(e[0] * a.z + e[1] * b.z + e[2] * c.z) / (e[0] + e[1] + e[2])
    }
}

/// Whether the line meets the triangle; an edge belongs to it. Three zeros are a triangle without extent.
#[inline(always)]
fn covers([a, b, c]: [f64; 3]) -> bool {
    // Without branches, for vectors. Where one is no number neither is their sum.
    let (less, more) = (if a < b { a } else { b }, if a > b { a } else { b });
    let (least, most) = (if less < c { less } else { c }, if more > c { more } else { c });
    let sum = a + b + c;
    ((least >= 0.0) & (sum > 0.0)) | ((most <= 0.0) & (sum < 0.0))
}

/// Pixels that a triangle may show in beyond the near plane: first and past-the-last column, first and past-the-last
/// row. Nothing if none.
fn bounds(corners: [DVec3; 3], view: &View) -> Option<[usize; 4]> {
    let [width, height] = view.size.map(f64::from);
    let everything = [0, view.size[0] as usize, 0, view.size[1] as usize];
    let depths = corners.map(|corner| -corner.z);
    if depths.iter().all(|&depth| depth <= view.near) {
        return None;
    }
    let mut box_ = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    let mut include = |point: DVec3| {
        let p = view.project(point);
        box_ = [box_[0].min(p.x), box_[1].max(p.x), box_[2].min(p.y), box_[3].max(p.y)];
    };
    if depths.iter().all(|&depth| depth > view.near) {
        corners.iter().for_each(|&corner| include(corner));
    } else {
        // The part beyond a plane a little before the near plane. Its new corners carry the rounding of the old ones,
        // which far away exceeds all pixels.
        let largest = corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
        if largest >= 1e8 * view.near {
            return Some(everything);
        }
        let plane = 0.999 * view.near;
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            let (depth_a, depth_b) = (depths[i], depths[(i + 1) % 3]);
            if depth_a >= plane {
                include(a);
            }
            if (depth_a >= plane) != (depth_b >= plane) {
                let cut = a + (b - a) * ((plane - depth_a) / (depth_b - depth_a));
                include(DVec3::new(cut.x, cut.y, -plane));
            }
        }
    }
    // A pixel of margin for rounding. Casts saturate; what is no number (infinite coordinates) is no bound.
    let low = |value: f64, most: f64| if value.is_nan() { 0.0 } else { (value - 1.0).floor().clamp(0.0, most) };
    let high = |value: f64, most: f64| if value.is_nan() { most } else { (value + 1.0).ceil().clamp(0.0, most) };
    let pixels = [low(box_[0], width), high(box_[1], width), low(box_[2], height), high(box_[3], height)];
    let pixels = pixels.map(|value| value as usize);
    (pixels[0] < pixels[1] && pixels[2] < pixels[3]).then_some(pixels)
}

/// Draws a band; returns the range of its colours.
struct Draw<'a> {
    band: Band<'a>,
    surfaces: &'a Surfaces<'a>,
    triangles: &'a [usize],
    depth: &'a mut [f64],
    color: &'a mut [Rgb],
}

impl WithSimd for Draw<'_> {
    type Output = [[f32; 2]; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [[f32; 2]; 3] {
        let Self { band, surfaces, triangles, depth, color } = self;
        let mut nearest = vec![NOTHING; depth.len()];
        for &index in triangles {
            band.cover(&surfaces.triangle(index), index, depth, &mut nearest);
        }
        band.shade(surfaces, &nearest, depth, color)
    }
}

/// A band of rows.
struct Band<'a> {
    view: &'a View,
    /// x of the ray direction of each column.
    columns: &'a [f64],
    first_row: usize,
}

impl Band<'_> {
    /// y of the ray direction of a row.
    fn row_direction(&self, row: usize) -> f64 {
        self.view.direction(0.5, row as f64 + 0.5).y
    }

    /// Notes where the triangle is the nearest so far.
    #[inline(always)]
    fn cover(&self, triangle: &Triangle, index: usize, depth: &mut [f64], nearest: &mut [usize]) {
        let width = self.columns.len();
        let Some([left, right, top, bottom]) = bounds(triangle.corners, self.view) else {
            return;
        };
        let rows = depth.len() / width;
        let columns = &self.columns[left..right];
        for row in top.max(self.first_row)..bottom.min(self.first_row + rows) {
            let y = self.row_direction(row);
            let (constant, slope) = (triangle.row(y), triangle.slope(y));
            let Some(Span { from, to, exact }) = span(triangle, constant, columns) else {
                continue;
            };
            let start = (row - self.first_row) * width;
            let hit = Hit { triangle, index, constant, slope, near: self.view.near };
            let (depth, nearest) = (&mut depth[start..start + width], &mut nearest[start..start + width]);
            let span = left + from..left + to;
            if exact {
                hit.all(&self.columns[span.clone()], &mut depth[span.clone()], &mut nearest[span]);
            } else if width < LANES {
                hit.each(&self.columns[span.clone()], &mut depth[span.clone()], &mut nearest[span]);
            } else {
                for first in span.clone().step_by(LANES) {
                    let first = first.min(width - LANES);
                    let block = first..;
                    let columns = self.columns[block.clone()].first_chunk();
                    let (depth, nearest) = (depth[block.clone()].first_chunk_mut(), nearest[block].first_chunk_mut());
                    if let (Some(columns), Some(depth), Some(nearest)) = (columns, depth, nearest) {
                        hit.block(columns, depth, nearest, span.start.saturating_sub(first)..span.end - first);
                    }
                }
            }
        }
    }

    /// Colours every pixel that shows something; returns the range of the colours.
    #[inline(always)]
    fn shade(&self, surfaces: &Surfaces, nearest: &[usize], depth: &[f64], color: &mut [Rgb]) -> [[f32; 2]; 3] {
        let width = self.columns.len();
        // Neighbours mostly show the same triangle, and so do rows.
        let mut last: Option<(usize, Triangle, Appearance)> = None;
        // The range of each lane.
        let mut ranges = NO_RANGE.map(|ends| ends.map(|end| [end; LANES]));
        let rows = nearest.chunks(width).zip(depth.chunks(width)).zip(color.chunks_mut(width));
        for (row, ((nearest, depth), color)) in rows.enumerate() {
            let y = self.row_direction(self.first_row + row);
            let mut end = 0;
            while let Some(&index) = nearest.get(end) {
                let first = end;
                while nearest.get(end) == Some(&index) {
                    end += 1;
                }
                if index == NOTHING {
                    continue;
                }
                let (_, triangle, appearance) = match &last {
                    Some(last) if last.0 == index => last,
                    _ => {
                        let triangle = surfaces.triangle(index);
                        let appearance = surfaces.appearance(index, &triangle);
                        last.insert((index, triangle, appearance))
                    }
                };
                let constant = triangle.row(y);
                let blocks = (first..end).step_by(LANES).map(|at| at..end.min(at + LANES));
                for block in blocks {
                    let (mut x, mut far) = ([self.columns[first]; LANES], [depth[first]; LANES]);
                    x[..block.len()].copy_from_slice(&self.columns[block.clone()]);
                    far[..block.len()].copy_from_slice(&depth[block.clone()]);
                    let seen = appearance.colors(triangle, constant, [&x, &far], y, surfaces.light);
                    for (lane, out) in color[block].iter_mut().enumerate() {
                        *out = seen.map(|channel| channel[lane]);
                    }
                    // Lanes beyond the block show the run's first pixel again.
                    for ([low, high], channel) in ranges.iter_mut().zip(&seen) {
                        for i in 0..LANES {
                            low[i] = if channel[i] < low[i] { channel[i] } else { low[i] };
                            high[i] = if channel[i] > high[i] { channel[i] } else { high[i] };
                        }
                    }
                }
            }
        }
        let least = |values: [f32; LANES]| values.into_iter().fold(f32::INFINITY, f32::min);
        let most = |values: [f32; LANES]| values.into_iter().fold(f32::NEG_INFINITY, f32::max);
        ranges.map(|[low, high]| [least(low), most(high)])
    }
}

/// A triangle on a row of pixels, which notes where it is the nearest so far.
struct Hit<'a> {
    triangle: &'a Triangle,
    index: usize,
    /// Of the edge products and of the product with the normal, what does not depend on the column.
    constant: [f64; 3],
    slope: f64,
    /// Depth of the near plane.
    near: f64,
}

impl Hit<'_> {
    /// The depth at a column, clamped to what the triangle has, and whether it is a number.
    #[inline(always)]
    fn depth(&self, x: f64) -> (f64, bool) {
        let t = self.triangle.quotient(self.slope, x);
        (self.triangle.clamp(t), t.is_finite())
    }

    /// At columns that all lie in the triangle.
    #[inline(always)]
    fn all(&self, columns: &[f64], depth: &mut [f64], nearest: &mut [usize]) {
        let mut are_finite = true;
        for ((&x, depth), nearest) in columns.iter().zip(&mut *depth).zip(&mut *nearest) {
            let (t, is_finite) = self.depth(x);
            are_finite &= is_finite;
            let is_seen = is_finite & (t > self.near) & (t < *depth);
            *depth = if is_seen { t } else { *depth };
            *nearest = if is_seen { self.index } else { *nearest };
        }
        if !are_finite {
            self.each(columns, depth, nearest);
        }
    }

    /// At neighbours, if they are among these lanes, of which some may lie in it. What is written is written for all, so that nothing depends on a branch.
    #[inline(always)]
    fn block(&self, columns: &Lanes, depth: &mut Lanes, nearest: &mut [usize; LANES], lanes: Range<usize>) {
        // By masks: of a choice the compiler makes one between places, and a gather.
        let index = self.index as u64;
        let (mut depths, mut indices, mut odd) = (*depth, nearest.map(|index| index as u64), [0u64; LANES]);
        for i in 0..LANES {
            let is_asked = (lanes.start <= i) & (i < lanes.end);
            let is_within = is_asked & covers(self.triangle.products(self.constant, columns[i]));
            let (t, is_finite) = self.depth(columns[i]);
            let is_seen = is_within & is_finite & (t > self.near) & (t < depth[i]);
            depths[i] = if is_seen { t } else { depth[i] };
            let mask = u64::from(is_seen).wrapping_neg();
            indices[i] = (indices[i] & !mask) | (index & mask);
            odd[i] = u64::from(is_within & !is_finite);
        }
        (*depth, *nearest) = (depths, indices.map(|index| index as usize));
        if odd.iter().fold(0, |any, odd| any | odd) != 0 {
            let lanes = lanes.start..lanes.end.min(LANES);
            self.each(&columns[lanes.clone()], &mut depth[lanes.clone()], &mut nearest[lanes]);
        }
    }

    /// One by one: where quotients are no numbers, as on edges.
    #[cold]
    fn each(&self, columns: &[f64], depth: &mut [f64], nearest: &mut [usize]) {
        for ((&x, depth), nearest) in columns.iter().zip(depth).zip(nearest) {
            if covers(self.triangle.products(self.constant, x)) {
                let t = self.triangle.depth(self.slope, self.constant, x);
                if t > self.near && t < *depth {
                    (*depth, *nearest) = (t, self.index);
                }
            }
        }
    }
}

/// Pixels that are asked or shaded at once.
const LANES: usize = 8;

/// A number of each of them.
type Lanes = [f64; LANES];

/// Rows of a triangle's box shorter than this are asked as they are.
const TINY_SPAN: usize = 2 * LANES;

/// Columns of a row, `from` to before `to`.
struct Span {
    from: usize,
    to: usize,
    /// All of them lie in the triangle: they need no test.
    exact: bool,
}

/// The first column for which `within` holds, which from there on holds for all; found from a guess, mostly at once.
#[inline]
fn first_within(columns: &[f64], guess: usize, within: impl Fn(f64) -> bool) -> usize {
    let mut first = guess;
    while first < columns.len() && !within(columns[first]) {
        first += 1;
    }
    while first > 0 && within(columns[first - 1]) {
        first -= 1;
    }
    first
}

/// The columns of a row that may lie in the triangle, first and past the last. The products are linear in x and their
/// rounding is monotonic, so that signs at the ends of the row tell of all between, and a search around the
/// estimate finds exactly where a sign changes: nothing is cut off that the test of a single column would accept.
fn span(triangle: &Triangle, row: [f64; 3], columns: &[f64]) -> Option<Span> {
    let count = columns.len();
    let whole = Span { from: 0, to: count, exact: false };
    if count < TINY_SPAN {
        return Some(whole);
    }
    let (first, last) = (*columns.first()?, *columns.last()?);
    let (a, b) = (triangle.products(row, first), triangle.products(row, last));
    let negative = (0..3).any(|i| a[i] < 0.0 && b[i] < 0.0);
    let positive = (0..3).any(|i| a[i] > 0.0 && b[i] > 0.0);
    if negative && positive {
        return None;
    }
    if negative == positive {
        return Some(whole);
    }
    // One product keeps its sign; the others must not have the opposite one.
    let sign = if negative { -1.0 } else { 1.0 };
    let (mut from, mut to) = (0, count);
    for i in 0..3 {
        let product = |x: f64| (triangle.edges[i].x * x + row[i]) * sign;
        let (a, b) = (a[i] * sign, b[i] * sign);
        // Where the line through the end values vanishes; the cast takes care of what is no number.
        let guess = || ((a / (a - b) * (count - 1) as f64) as usize + 1).min(count);
        match (a < 0.0, b < 0.0) {
            (true, false) => from = from.max(first_within(columns, guess(), |x| product(x) >= 0.0)),
            (false, true) => to = to.min(first_within(columns, guess(), |x| product(x) < 0.0)),
            (true, true) => return None,
            (false, false) => {}
        }
    }
    (from < to).then_some(Span { from, to, exact: true })
}

impl Surfaces<'_> {
    /// All that the colour of a triangle depends on, gathered once for all its pixels.
    fn appearance(&self, index: usize, triangle: &Triangle) -> Appearance<'_> {
        let (mesh, index) = self.locate(index);
        let mesh = &self.meshes[mesh];
        let corners = mesh.corners[index].map(|corner| corner as usize);
        let material = mesh.triangle_materials.get(index).and_then(|&material| mesh.materials.get(material as usize));
        let base = DVec3::from(material.map_or([1.0; 3], |material| material.color).map(f64::from));
        let colors = if mesh.colors.is_empty() {
            [base; 3]
        } else {
            corners.map(|corner| base * DVec3::from(mesh.colors[corner].map(f64::from)))
        };
        let texture = material
            .and_then(|material| mesh.textures.get(material.texture? as usize))
            .filter(|_| !mesh.texture_coordinates.is_empty())
            .map(|texture| (texture, corners.map(|corner| mesh.texture_coordinates[corner])));
        let flat = triangle.normal.normalize_or_zero();
        let shading = if material.is_some_and(|material| material.unlit) {
            Shading::Unlit
        } else if mesh.normals.is_empty() || corners.iter().any(|&corner| mesh.normals[corner] == DVec3::ZERO) {
            Shading::Flat(flat)
        } else {
            Shading::Smooth(corners.map(|corner| self.view.eye_from_world * mesh.normals[corner]), flat)
        };
        Appearance { colors, texture, shading }
    }
}

/// How a triangle looks; see [`Surfaces::appearance`].
struct Appearance<'a> {
    /// Base colour times vertex colour, per corner.
    colors: [DVec3; 3],
    texture: Option<(&'a Texture, [DVec2; 3])>,
    shading: Shading,
}

/// Where the cosine comes from; normals are in eye space.
enum Shading {
    Unlit,
    /// The triangle's own unit normal.
    Flat(DVec3),
    /// Normals of the corners, and the triangle's own for where they cancel.
    Smooth([DVec3; 3], DVec3),
}

impl Appearance<'_> {
    /// Linear-light colours, by channels, of hits of the triangle along directions (x, y, -1) at these depths, with the edge products'
    /// constant part and the eye-space position of the light.
    #[inline(always)]
    // Lanes of many arrays at once.
    #[allow(clippy::needless_range_loop)]
    fn colors(
        &self,
        triangle: &Triangle,
        constant: [f64; 3],
        [x, depth]: [&Lanes; 2],
        y: f64,
        light: DVec3,
    ) -> [[f32; LANES]; 3] {
        // Barycentric coordinates, colour and normal.
        let [mut b, mut color, mut normal] = [[[0.0; LANES]; 3]; 3];
        for i in 0..LANES {
            let e = triangle.products(constant, x[i]);
            let scale = 1.0 / (e[0] + e[1] + e[2]);
            let [b0, b1, b2] = [e[0] * scale, e[1] * scale, e[2] * scale];
            (b[0][i], b[1][i], b[2][i]) = (b0, b1, b2);
            let seen = self.colors[0] * b0 + self.colors[1] * b1 + self.colors[2] * b2;
            (color[0][i], color[1][i], color[2][i]) = (seen.x, seen.y, seen.z);
        }
        if let Some((texture, uv)) = &self.texture {
            let (mut across, mut down) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let at = uv[0] * b[0][i] + uv[1] * b[1][i] + uv[2] * b[2][i];
                (across[i], down[i]) = (at.x, at.y);
            }
            for (color, texel) in color.iter_mut().zip(sample(texture, &across, &down)) {
                for i in 0..LANES {
                    color[i] *= texel[i];
                }
            }
        }
        match self.shading {
            Shading::Unlit => return color.map(|channel| channel.map(|value| value as f32)),
            Shading::Flat(flat) => normal = flat.to_array().map(|axis| [axis; LANES]),
            Shading::Smooth([n0, n1, n2], flat) => {
                for i in 0..LANES {
                    let smooth = n0 * b[0][i] + n1 * b[1][i] + n2 * b[2][i];
                    let is_smooth = smooth.length_squared() > 1e-12;
                    normal[0][i] = if is_smooth { smooth.x } else { flat.x };
                    normal[1][i] = if is_smooth { smooth.y } else { flat.y };
                    normal[2][i] = if is_smooth { smooth.z } else { flat.z };
                }
            }
        }
        let mut out = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let to_light = light - DVec3::new(x[i], y, -1.0) * depth[i];
            let normal = DVec3::new(normal[0][i], normal[1][i], normal[2][i]);
            // One root for both lengths. In the light itself there is no direction to it.
            let lengths = (normal.length_squared() * to_light.length_squared()).sqrt();
            let cosine = (normal.dot(to_light) / lengths).abs();
            let cosine = if lengths > 0.0 { cosine } else { 0.0 };
            out[0][i] = (color[0][i] * cosine) as f32;
            out[1][i] = (color[1][i] * cosine) as f32;
            out[2][i] = (color[2][i] * cosine) as f32;
        }
        out
    }
}

/// Bilinear look-ups, by channels; (0, 0) is the top left corner of the texture, texel centres are at half-integers.
#[inline(always)]
// Lanes of many arrays at once.
#[allow(clippy::needless_range_loop)]
fn sample(texture: &Texture, u: &Lanes, v: &Lanes) -> [Lanes; 3] {
    let (left, right, x) = texels(u, texture.width, texture.wrap[0]);
    let (top, bottom, y) = texels(v, texture.height, texture.wrap[1]);
    // The four texels around, by channels.
    let mut around = [[[0.0; LANES]; 3]; 4];
    for i in 0..LANES {
        let [top, bottom] = [top[i], bottom[i]].map(|row| row as usize * texture.width as usize);
        let [left, right] = [left[i], right[i]].map(|column| column as usize);
        for (texel, at) in around.iter_mut().zip([top + left, top + right, bottom + left, bottom + right]) {
            let [red, green, blue] = texture.texels[at];
            (texel[0][i], texel[1][i], texel[2][i]) = (f64::from(red), f64::from(green), f64::from(blue));
        }
    }
    let mut out = [[0.0; LANES]; 3];
    for (channel, out) in out.iter_mut().enumerate() {
        let [a, b, c, d] = around.each_ref().map(|texel| &texel[channel]);
        for i in 0..LANES {
            let (above, below) = (a[i] * (1.0 - x[i]) + b[i] * x[i], c[i] * (1.0 - x[i]) + d[i] * x[i]);
            out[i] = above * (1.0 - y[i]) + below * y[i];
        }
    }
    out
}

/// The two texels beside texture coordinates along one axis, whole numbers, and the weight of the second.
#[inline(always)]
// Lanes of many arrays at once.
#[allow(clippy::needless_range_loop)]
fn texels(coordinates: &Lanes, count: u32, wrap: Wrap) -> (Lanes, Lanes, Lanes) {
    // Brought into one period first: far away, the texels would drown in rounding. (A remainder would be slower.)
    let mut reduced = *coordinates;
    match wrap {
        Wrap::Repeat => {
            for at in &mut reduced {
                *at -= at.floor();
            }
        }
        Wrap::Mirror => {
            for at in &mut reduced {
                let half = *at * 0.5;
                let folded = 2.0 * (half - half.floor());
                *at = folded.min(2.0 - folded);
            }
        }
        Wrap::Clamp => {
            for at in &mut reduced {
                *at = at.clamp(0.0, 1.0);
            }
        }
    }
    // Both neighbours of the edge are the edge itself unless the texture repeats.
    let last = f64::from(count) - 1.0;
    let (before, after) = match wrap {
        Wrap::Repeat => (last, 0.0),
        Wrap::Mirror | Wrap::Clamp => (0.0, last),
    };
    let (mut first, mut second, mut weight) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let position = reduced[i] * f64::from(count) - 0.5;
        // -1 to count - 1.
        let low = position.floor();
        weight[i] = position - low;
        let within = if low < last { low } else { last };
        first[i] = if low < 0.0 { before } else { within };
        second[i] = if low < last { low + 1.0 } else { after };
    }
    (first, second, weight)
}
