//! Optical depth on the nodes of a grid, ball by ball: for gas that nothing but the near plane cuts and whose order is of no account,
//! as that of one colour is.
//!
//! A ball covers few nodes of a coarse grid, a dozen in a row: rows would fill vectors badly. So a plane of nodes is kept in blocks of
//! 4 x 4, each a line of the cache, and a ball goes through the blocks that its rectangle touches.

use super::footprint::{GAUSSIAN_CENTRE, gaussian_quick};
use super::primitive::{BELIAEV, Constant, GAUSSIAN, Leg, Poly, Primitive, Shape, Shell, Shells};
use super::simd::{Level, Simd, WithSimd, dispatch, exp2_neg};
use crate::scene::View;
use glam::DVec3;

/// Nodes along a side of a block; every vector is a few of its rows.
const SIDE: usize = 4;

/// Columns and rows of a block's nodes.
const COLUMNS: [f32; SIDE * SIDE] = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const ROWS: [f32; SIDE * SIDE] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// A block of nodes, row by row.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Block([f32; SIDE * SIDE]);

/// Numbers on the nodes of a grid, block by block.
#[derive(Clone, Debug, Default)]
pub struct Plane(Vec<Block>);

/// A ball on a grid.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    /// Eye-space centre over the radius.
    pub center: DVec3,
    /// Optical depth in powers of two per unit of the kernel's integral (`primitive::centre`).
    pub amplitude: f32,
    /// Its kernel.
    pub shape: Shape,
    /// Depth of the near plane beyond the centre, in radii: above -1 that cuts the ball.
    pub near: f32,
    /// First and last column and row of nodes that it may cover, within the grid.
    pub nodes: [[usize; 2]; 2],
}

impl Ball {
    /// Whether the near plane cuts it.
    #[inline(always)]
    fn is_cut(&self) -> bool {
        self.near > -1.0
    }

    /// Its rectangle in blocks: the first and the last column and row.
    #[inline(always)]
    fn blocks(&self) -> [[usize; 2]; 2] {
        self.nodes.map(|ends| ends.map(|node| node / SIDE))
    }
}

/// A grid of nodes, the pixels of a view; blocks may reach beyond its right and lower edge.
pub struct Nodes {
    size: [usize; 2],
    /// Blocks in a row.
    across: usize,
    /// Tangents of the first node's ray, and from node to node.
    corner: [f64; 2],
    step: [f64; 2],
    /// 1 / |dir|^2 of the nodes' rays with dir.z = -1.
    weight: Plane,
}

impl Nodes {
    /// The pixels of a view.
    pub fn new(view: &View) -> Self {
        let size = view.size.map(|n| n as usize);
        let [across, down] = size.map(|n| n.div_ceil(SIDE));
        let first = view.direction(0.5, 0.5);
        let focal = view.focal_px();
        let (corner, step) = ([first.x, first.y], [1.0 / focal.x, -1.0 / focal.y]);
        let mut nodes = Self { size, across, corner, step, weight: Plane::default() };
        let mut weight = Vec::with_capacity(across * down);
        for row in 0..down {
            let y = ROWS.map(|y| nodes.tangent(1, row) + f64::from(y) * step[1]);
            weight.extend((0..across).map(|column| {
                let x = nodes.tangent(0, column);
                let mut block = Block([0.0; SIDE * SIDE]);
                for ((weight, y), column) in block.0.iter_mut().zip(y).zip(COLUMNS) {
                    let x = x + f64::from(column) * step[0];
                    *weight = (1.0 / (1.0 + x * x + y * y)) as f32;
                }
                block
            }));
        }
        nodes.weight = Plane(weight);
        nodes
    }

    /// The tangent of a block's first node along an axis.
    #[inline(always)]
    fn tangent(&self, axis: usize, block: usize) -> f64 {
        self.corner[axis] + (SIDE * block) as f64 * self.step[axis]
    }

    /// A plane of zeros.
    pub fn plane(&self) -> Plane {
        Plane(vec![Block([0.0; SIDE * SIDE]); self.weight.0.len()])
    }

    /// Adds the optical depths of balls, in powers of two, to a plane of these nodes; returns the fragments. `quick`: those of
    /// Gaussians may be off by as much as [`super::footprint::QUICK`] of what rays hold.
    pub fn add(&self, balls: &[Ball], shells: &[Shell], quick: bool, level: Level, plane: &mut Plane) -> u64 {
        dispatch(level, Add { nodes: self, balls, shells, quick, plane })
    }

    /// Transmittances of optical depths in powers of two, added up over planes, row by row.
    pub fn transmittances<'a>(&self, planes: impl Iterator<Item = &'a Plane>, level: Level) -> Vec<f32> {
        let mut sums = self.plane();
        for plane in planes {
            sums.add(plane);
        }
        dispatch(level, Transmittance { depths: &mut sums });
        self.rows(&sums)
    }

    /// The nodes of a plane, row by row.
    fn rows(&self, plane: &Plane) -> Vec<f32> {
        let [width, height] = self.size;
        let mut out = vec![0.0; width * height];
        for (rows, blocks) in out.chunks_mut(SIDE * width).zip(plane.0.chunks_exact(self.across)) {
            for (y, row) in rows.chunks_exact_mut(width).enumerate() {
                for (out, block) in row.chunks_mut(SIDE).zip(blocks) {
                    out.copy_from_slice(&block.0[SIDE * y..][..out.len()]);
                }
            }
        }
        out
    }
}

impl Plane {
    /// Adds another's numbers.
    fn add(&mut self, other: &Self) {
        for (block, other) in self.0.iter_mut().zip(&other.0) {
            for (sum, value) in block.0.iter_mut().zip(other.0) {
                *sum += value;
            }
        }
    }
}

/// Makes transmittances of optical depths in powers of two.
struct Transmittance<'a> {
    depths: &'a mut Plane,
}

impl WithSimd for Transmittance<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        for block in &mut self.depths.0 {
            for depths in block.0.chunks_exact_mut(S::LANES) {
                s.store(exp2_neg(s, s.load(depths)), depths);
            }
        }
    }
}

struct Add<'a> {
    nodes: &'a Nodes,
    balls: &'a [Ball],
    shells: &'a [Shell],
    quick: bool,
    plane: &'a mut Plane,
}

impl WithSimd for Add<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> u64 {
        let Self { nodes, balls, shells, quick, plane } = self;
        let mut room = Room::<S> { columns: Vec::new(), legs: Vec::new() };
        let mut blocks = 0;
        for ball in balls {
            blocks += match ball.shape {
                Shape::Gaussian if quick && !ball.is_cut() => nodes.ball(s, ball, Quick, &mut room, plane),
                Shape::Gaussian => nodes.exact(s, ball, GAUSSIAN, &mut room, plane),
                Shape::Beliaev => nodes.exact(s, ball, BELIAEV, &mut room, plane),
                Shape::Constant => nodes.exact(s, ball, Constant, &mut room, plane),
                Shape::Poly => nodes.exact(s, ball, Poly, &mut room, plane),
                Shape::Shells(first, count) => {
                    nodes.exact(s, ball, Shells::new(shells, first, count), &mut room, plane)
                }
            };
        }
        (blocks * SIDE * SIDE) as u64
    }
}

/// What a kernel's optical depth along a whole ray is, by how near that passes.
trait Whole: Copy {
    /// What it is multiplied with.
    const FACTOR: f32;

    /// It from 1 - b^2, which is negative for rays that miss the ball.
    fn at<S: Simd>(self, s: S, within: S::F, legs: &mut Vec<Leg<S::F, 1>>) -> S::F;
}

/// A Gaussian's within [`super::footprint::QUICK`].
#[derive(Clone, Copy)]
struct Quick;

impl Whole for Quick {
    const FACTOR: f32 = GAUSSIAN_CENTRE;

    #[inline(always)]
    fn at<S: Simd>(self, s: S, within: S::F, _: &mut Vec<Leg<S::F, 1>>) -> S::F {
        let [whole] = gaussian_quick(s, [within]);
        whole
    }
}

/// A kernel's.
#[derive(Clone, Copy)]
struct Exact<P>(P);

impl<P: Primitive> Whole for Exact<P> {
    /// Both halves of the chord.
    const FACTOR: f32 = 2.0;

    #[inline(always)]
    fn at<S: Simd>(self, s: S, within: S::F, legs: &mut Vec<Leg<S::F, 1>>) -> S::F {
        let within = s.max(within, s.splat(0.0));
        let (square, half) = ([s.sub(s.splat(1.0), within)], [s.sqrt_near(within)]);
        self.0.prepare(s, &square, legs);
        let [whole] = self.0.end(s, &square, legs, &half);
        whole
    }
}

/// Room for what a ball needs, kept from ball to ball.
struct Room<S: Simd> {
    /// Of each column of blocks, as [`Cross`] has it.
    columns: Vec<[S::F; 2]>,
    legs: Vec<Leg<S::F, 1>>,
}

/// What the nodes of a ball have in common. With c its centre over the radius, b is the distance of the ray dir = (X, Y, -1) from it:
/// b^2 = |c x dir|^2 / |dir|^2, c x dir = (A, B, A X + B Y) with A = -c_z Y - c_y and B = c_x + c_z X. About the centre's own
/// tangent, X = -c_x/c_z + t, that is |c x dir|^2 = A^2 (1 + (c_x/c_z)^2) + 2 A t c_x c_y/c_z + t^2 (c_y^2 + c_z^2), of which nothing
/// cancels; c_z < -1, since nothing cuts the ball.
struct Cross {
    center: DVec3,
    at_centre: f64,
    a_square: f32,
    a_scale: f32,
    t_square: f32,
}

impl Cross {
    fn new(c: DVec3) -> Self {
        let at_centre = -c.x / c.z;
        Self {
            center: c,
            at_centre,
            a_square: (1.0 + at_centre * at_centre) as f32,
            a_scale: (-2.0 * at_centre * c.y) as f32,
            t_square: (c.y * c.y + c.z * c.z) as f32,
        }
    }

    /// Of a column of blocks: the factors of A and of 1.
    #[inline(always)]
    fn column<S: Simd>(&self, s: S, nodes: &Nodes, block: usize) -> [S::F; 2] {
        let left = (nodes.tangent(0, block) - self.at_centre) as f32;
        let t = s.mul_add(s.load(&COLUMNS), s.splat(nodes.step[0] as f32), s.splat(left));
        [s.mul(t, s.splat(self.a_scale)), s.mul(s.mul(t, t), s.splat(self.t_square))]
    }

    /// Of the vectors of a row of blocks, as many as there are: A and (1 + (c_x/c_z)^2) A^2.
    #[inline(always)]
    fn row<S: Simd>(&self, s: S, nodes: &Nodes, block: usize) -> [[S::F; 2]; SIDE] {
        let first = s.splat((-self.center.z * nodes.tangent(1, block) - self.center.y) as f32);
        let step = s.splat((-self.center.z * nodes.step[1]) as f32);
        let mut row = [[first; 2]; SIDE];
        for ([a, a_square], rows) in row.iter_mut().zip(ROWS.chunks_exact(S::LANES)) {
            *a = s.mul_add(s.load(rows), step, first);
            *a_square = s.mul(s.mul(*a, *a), s.splat(self.a_square));
        }
        row
    }
}

impl Nodes {
    /// Adds what of a ball is beyond the near plane; returns the blocks that it touches. The centre of one that is cut may be anywhere, so
    /// that c x dir is taken as it is: (A, B, A X + B Y), as [`Cross`] has it. The point nearest the centre is o = (X B - Y A) / |dir| beyond
    /// the ray's point at the centre's depth.
    #[inline(always)]
    fn exact<S: Simd, P: Primitive>(
        &self,
        s: S,
        ball: &Ball,
        kernel: P,
        room: &mut Room<S>,
        plane: &mut Plane,
    ) -> usize {
        if !ball.is_cut() {
            return self.ball(s, ball, Exact(kernel), room, plane);
        }
        let [[left, right], [top, bottom]] = ball.blocks();
        let c = ball.center;
        let (zero, one, amplitude) = (s.splat(0.0), s.splat(1.0), s.splat(ball.amplitude));
        for row in top..=bottom {
            for column in left..=right {
                let number = row * self.across + column;
                let x = self.tangents(s, 0, column, &COLUMNS);
                let b = self.offsets(s, 0, column, &COLUMNS, [c.z, c.x]);
                let rows = ROWS.chunks_exact(S::LANES).zip(self.weight.0[number].0.chunks_exact(S::LANES));
                for (out, (rows, weight)) in plane.0[number].0.chunks_exact_mut(S::LANES).zip(rows) {
                    let y = self.tangents(s, 1, row, rows);
                    let a = self.offsets(s, 1, row, rows, [-c.z, -c.y]);
                    let twist = s.mul_add(a, x, s.mul(b, y));
                    let cross = s.mul_add(twist, twist, s.mul_add(a, a, s.mul(b, b)));
                    let weight = s.load(weight);
                    let square = [s.min(s.mul(cross, weight), one)];
                    let half = s.sqrt_near(s.sub(one, square[0]));
                    let inverse = s.sqrt(weight);
                    let offset = s.mul(s.sub(s.mul(x, b), s.mul(y, a)), inverse);
                    let near = s.sub(s.div(s.splat(ball.near), inverse), offset);
                    let from = s.min(s.max(s.sub(zero, half), near), half);
                    kernel.prepare(s, &square, &mut room.legs);
                    let [enter] = kernel.at(s, &square, &room.legs, &[from]);
                    let [leave] = kernel.at(s, &square, &room.legs, &[half]);
                    let factor = s.mul(kernel.factor(s, square[0]), amplitude);
                    s.store(s.mul_add(s.sub(leave, enter), factor, s.load(out)), out);
                }
            }
        }
        (right + 1 - left) * (bottom + 1 - top)
    }

    /// The tangents along an axis of a block's nodes, `offsets` nodes from its first.
    #[inline(always)]
    fn tangents<S: Simd>(&self, s: S, axis: usize, block: usize, offsets: &[f32]) -> S::F {
        s.mul_add(s.load(offsets), s.splat(self.step[axis] as f32), s.splat(self.tangent(axis, block) as f32))
    }

    /// A tangent of theirs times a factor and a constant more, which cancel where the ball is: so the first is taken in f64.
    #[inline(always)]
    fn offsets<S: Simd>(&self, s: S, axis: usize, block: usize, offsets: &[f32], [factor, constant]: [f64; 2]) -> S::F {
        let first = (constant + factor * self.tangent(axis, block)) as f32;
        s.mul_add(s.load(offsets), s.splat((factor * self.step[axis]) as f32), s.splat(first))
    }

    /// Adds a ball that nothing cuts; returns the blocks that it touches.
    #[inline(always)]
    fn ball<S: Simd, W: Whole>(&self, s: S, ball: &Ball, whole: W, room: &mut Room<S>, plane: &mut Plane) -> usize {
        let [[left, right], [top, bottom]] = ball.blocks();
        let (one, factor) = (s.splat(1.0), s.splat(W::FACTOR * ball.amplitude));
        let cross = Cross::new(ball.center);
        room.columns.clear();
        // No iterator to extend by: its closure would become a call.
        for block in left..=right {
            room.columns.push(cross.column(s, self, block));
        }
        for row in top..=bottom {
            let parts = cross.row(s, self, row);
            let blocks = row * self.across + left..=row * self.across + right;
            let weights = &self.weight.0[blocks.clone()];
            for ((block, weight), &[linear, square]) in plane.0[blocks].iter_mut().zip(weights).zip(&room.columns) {
                let vectors = block.0.chunks_exact_mut(S::LANES).zip(weight.0.chunks_exact(S::LANES));
                for ((out, weight), [a, a_square]) in vectors.zip(parts) {
                    let cross = s.mul_add(linear, a, s.add(square, a_square));
                    let within = s.neg_mul_add(cross, s.load(weight), one);
                    let whole = whole.at(s, within, &mut room.legs);
                    s.store(s.mul_add(whole, factor, s.load(out)), out);
                }
            }
        }
        (right + 1 - left) * (bottom + 1 - top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::footprint::QUICK;
    use crate::render::cpu::primitive;
    use crate::render::cpu::splat::Lens;
    use crate::scene::{Camera, Kernel, Scene};

    /// Balls of every kernel and of all widths in nodes, two at a time, on a plane that holds something, at every node: what the
    /// footprint says, and nothing beyond the ball.
    #[test]
    fn sums_are_those_of_the_footprint() {
        let camera = Camera { position: DVec3::ZERO, ..Camera::for_tests([90, 70]) };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let view = &scene.views()[0];
        let (nodes, lens) = (Nodes::new(view), Lens::new(view));
        let mut shells = Vec::new();
        let kernels = [
            (Kernel::Gaussian, true),
            (Kernel::Gaussian, false),
            (Kernel::Beliaev, false),
            (Kernel::Constant, false),
            (Kernel::Poly, false),
            (Kernel::Linear, false),
        ];
        for (kernel, quick) in kernels {
            let shape = Shape::new(&kernel, &mut shells);
            let mut widths = [false; 64];
            let balls: Vec<Ball> = (0..80)
                .filter_map(|i| {
                    let turn = f64::from(i);
                    let center = DVec3::new(0.4 * turn.sin(), 0.3 * (1.7 * turn).cos(), -5.0 - (0.9 * turn).sin());
                    let radius = 0.02 + 0.02 * (turn * 37.0 % 80.0);
                    let [x, y] = lens.ball_intervals(center, radius);
                    let inside = |[low, high]: [f64; 2], size: f64| {
                        [(low - 0.5).ceil().max(0.0) as usize, (high - 0.5).floor().min(size - 1.0) as usize]
                    };
                    let rectangle = [inside(x, 90.0), inside(y, 70.0)];
                    let is_seen = rectangle.iter().all(|[first, last]| first <= last);
                    let amplitude = 0.3 + 0.01 * i as f32;
                    is_seen.then_some(Ball { center: center / radius, amplitude, shape, near: -1.0, nodes: rectangle })
                })
                .collect();
            for ball in &balls {
                let [[left, right], _] = ball.nodes;
                widths[(right + 1 - left).min(63)] = true;
            }
            assert!(widths[1..40].iter().filter(|&&seen| seen).count() > 25, "{widths:?}");
            // What a ball shows at a node, and how far that may be off: near a rim the root of rounding is seen.
            let show = |ball: &Ball, [column, row]: [usize; 2]| {
                let direction = view.direction(column as f64 + 0.5, row as f64 + 0.5);
                let square = ball.center.cross(direction).length_squared() / direction.length_squared();
                let amplitude = f64::from(ball.amplitude);
                let want = amplitude * primitive::centre(&kernel) * kernel.footprint(square.sqrt().min(1.0));
                let root = |rounding: f64| (1.0 - square + rounding).max(0.0).sqrt();
                let rim = 2.0 * amplitude * kernel.density(1.0f64.next_down()) * (root(1e-6) - root(0.0));
                (want, if quick { QUICK } else { 1e-6 } * want + rim)
            };
            for level in Level::available() {
                for pair in balls.windows(2) {
                    let mut plane = nodes.plane();
                    plane.0.iter_mut().for_each(|block| block.0.fill(0.25));
                    let fragments = nodes.add(pair, &shells, quick, level, &mut plane);
                    let touched = pair.iter().map(|ball| {
                        let [across, down] = ball.nodes.map(|[first, last]| last / SIDE + 1 - first / SIDE);
                        across * down * SIDE * SIDE
                    });
                    assert_eq!(fragments as usize, touched.sum::<usize>(), "{level}: {pair:?}");
                    for (at, &got) in nodes.rows(&plane).iter().enumerate() {
                        let [(a, a_off), (b, b_off)] = [0, 1].map(|i| show(&pair[i], [at % 90, at / 90]));
                        let off = (f64::from(got) - 0.25 - a - b).abs();
                        assert!(
                            off < 2e-6 + a_off + b_off,
                            "{kernel:?}, {level}: {pair:?}, node {at}: {got}, off {off:e}"
                        );
                    }
                }
            }
        }
    }

    /// Balls that the near plane cuts before, in and behind their middles, the eye in some of them: what is beyond the plane, as the
    /// integral of the density says.
    #[test]
    fn the_near_plane_cuts_what_is_before_it() {
        let camera = Camera { position: DVec3::ZERO, near: 0.5, ..Camera::for_tests([90, 70]) };
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let view = &scene.views()[0];
        let nodes = Nodes::new(view);
        let mut shells = Vec::new();
        for kernel in [Kernel::Gaussian, Kernel::Beliaev, Kernel::Constant, Kernel::Poly, Kernel::Linear] {
            let shape = Shape::new(&kernel, &mut shells);
            let (mut inside, mut least, mut most) = (0, f64::INFINITY, f64::NEG_INFINITY);
            let balls: Vec<Ball> = (0..24)
                .map(|i| {
                    let turn = f64::from(i);
                    let (radius, near) = (0.2 + (turn * 0.618).fract(), 1.9 * (turn * 0.414).fract() - 0.95);
                    let center = DVec3::new(0.3 * turn.sin(), 0.2 * (1.7 * turn).cos(), near * radius - view.near);
                    inside += usize::from(center.length() < radius);
                    (least, most) = (least.min(near), most.max(near));
                    let center = center / radius;
                    Ball { center, amplitude: 0.7, shape, near: near as f32, nodes: [[0, 89], [0, 69]] }
                })
                .collect();
            assert!(inside > 5 && least < -0.8 && most > 0.8, "{inside}, {least} to {most}");
            for level in Level::available() {
                for ball in &balls {
                    let mut plane = nodes.plane();
                    nodes.add(std::slice::from_ref(ball), &shells, true, level, &mut plane);
                    for (at, got) in nodes.rows(&plane).into_iter().enumerate() {
                        let direction = view.direction((at % 90) as f64 + 0.5, (at / 90) as f64 + 0.5);
                        let (length, unit) = (direction.length(), direction.normalize());
                        let square = ball.center.cross(unit).length_squared();
                        let half = (1.0 - square).max(0.0).sqrt();
                        let plane = (f64::from(ball.near) - ball.center.z) * length;
                        let from = (plane - ball.center.dot(unit)).clamp(-half, half);
                        let want = 0.7 * if from < half { kernel.segment(square.sqrt(), from, half) } else { 0.0 };
                        // Near a rim the root of rounding is seen.
                        let root = |rounding: f64| (1.0 - square + rounding).max(0.0).sqrt();
                        let rim = 2.0 * kernel.density(1.0f64.next_down()) * (root(2e-6) - root(0.0));
                        let off = (f64::from(got) - want).abs();
                        assert!(off < 3e-6 + rim, "{kernel:?}, {level}: {ball:?}, node {at}: {got} for {want}");
                    }
                }
            }
        }
    }

    /// Transmittances of what several planes hold together.
    #[test]
    fn planes_add_up() {
        let camera = Camera::for_tests([18, 5]);
        let scene = Scene { camera, stereo: None, background: [0.0; 3], particles: Vec::new(), meshes: Vec::new() };
        let nodes = Nodes::new(&scene.views()[0]);
        let plane = |factor: f32| {
            let mut plane = nodes.plane();
            for (i, block) in plane.0.iter_mut().enumerate() {
                for (j, value) in block.0.iter_mut().enumerate() {
                    let (column, row) = (i % 5 * SIDE + j % SIDE, i / 5 * SIDE + j / SIDE);
                    *value = factor * (column + 18 * row) as f32;
                }
            }
            plane
        };
        for level in Level::available() {
            let through = nodes.transmittances([plane(0.01), plane(0.03)].iter(), level);
            assert_eq!(through.len(), 18 * 5);
            for (i, through) in through.into_iter().enumerate() {
                let want = (-0.04 * i as f32).exp2();
                assert!((through / want - 1.0).abs() < 1e-5, "{level}: node {i}: {through} for {want}");
            }
        }
    }
}
