//! Which of many balls the rays of a block of pixels may meet, and between which depths: a vector of balls at once, by interval
//! arithmetic.
//!
//! With c a ball's centre over its radius, d = -c_z its depth and a ray's direction dir = (X, Y, -1), the offsets of the ray
//! from the centre at the centre's depth are A = d Y - c_y and B = c_x - d X. Then c x dir = (A, B, A X + B Y), the ray's
//! distance from the centre is b = |c x dir| / |dir|, and the ray's point nearest the centre is (X B - Y A) / |dir| beyond its
//! point at the centre's depth.

use super::simd::Simd;
use glam::DVec3;

/// The particles of a tile in order of the first slab, ready to be asked many at once. Padded with balls that no ray meets, so
/// that the last vector is whole.
#[derive(Default)]
pub struct Nearby {
    ball: Vec<u32>,
    /// Which of the tile's colours it has, if they are few.
    color: Vec<u8>,
    /// A and B of the tile's first ray, and d.
    a: Vec<f32>,
    b: Vec<f32>,
    depth: Vec<f32>,
}

impl Nearby {
    /// Forgets all.
    pub fn clear(&mut self) {
        let Self { ball, color, a, b, depth } = self;
        ball.clear();
        color.clear();
        [a, b, depth].into_iter().for_each(Vec::clear);
    }

    /// Adds a ball that has `center` over its radius; the tile's first ray has the tangents `corner`.
    pub fn push(&mut self, ball: u32, color: u8, center: DVec3, corner: [f64; 2]) {
        self.ball.push(ball);
        self.color.push(color);
        self.a.push((-center.z * corner[1] - center.y) as f32);
        self.b.push((center.x + center.z * corner[0]) as f32);
        self.depth.push(-center.z as f32);
    }

    /// Number of balls.
    pub fn count(&self) -> usize {
        self.ball.len()
    }

    /// Which of a vector's worth of balls from number `start` on rays of a beam may meet; returns how many.
    #[inline(always)]
    pub fn meet<S: Simd>(&self, s: S, start: usize, beam: &Beam, hits: &mut [Hit; 16]) -> usize {
        let depth = s.load(&self.depth[start..]);
        let [x, y] = beam.ways;
        let a = along(s, s.load(&self.a[start..]), depth, y);
        let b = along(s, s.load(&self.b[start..]), depth, [-x[0], -x[1]]);
        let (meet, depths) = beam.depths(s, a, b);
        let [mut low, mut high, mut met] = [[0.0; 16]; 3];
        s.store(depths[0], &mut low);
        s.store(depths[1], &mut high);
        s.store(s.keep(meet, s.splat(1.0)), &mut met);
        let mut count = 0;
        // Without branches: which are met is beyond prediction.
        for lane in 0..S::LANES.min(self.ball.len() - start) {
            let (ball, color) = (self.ball[start + lane], self.color[start + lane]);
            hits[count] = Hit { ball, color, depths: [low[lane], high[lane]] };
            count += usize::from(met[lane] != 0.0);
        }
        count
    }

    /// Fills the last vector with balls far from every ray.
    pub fn pad(&mut self) {
        let count = self.ball.len().next_multiple_of(16);
        self.a.resize(count, 1e18);
        self.b.resize(count, 1e18);
        self.depth.resize(count, 0.0);
    }
}

/// A particle that rays of a block may meet.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hit {
    /// Its number.
    pub ball: u32,
    /// Which of the tile's colours it has.
    pub color: u8,
    /// Between which depths from its centre, in radii.
    pub depths: [f32; 2],
}

/// Least and greatest of what the rays of a block have.
#[derive(Clone, Copy)]
pub struct Beam {
    /// Tangents.
    x: [f32; 2],
    y: [f32; 2],
    /// 1 / |dir|.
    inverse: [f32; 2],
    /// Tangents of the first and the last column and row, from the tile's first ray.
    ways: [[f32; 2]; 2],
}

impl Beam {
    /// Of a block of `counts` pixels from pixel `at` of a tile whose first ray has the tangents `corner`; `step` from pixel to
    /// pixel.
    pub fn new(corner: [f64; 2], step: [f64; 2], at: [usize; 2], counts: [usize; 2]) -> Self {
        let ways = [0, 1].map(|axis| [at[axis], at[axis] + counts[axis] - 1].map(|count| step[axis] * count as f64));
        let ranges = [0, 1].map(|axis| {
            let [first, last] = ways[axis].map(|way| corner[axis] + way);
            [first.min(last), first.max(last)]
        });
        let squares = ranges.map(|[low, high]| {
            let near = low.max(-high).max(0.0);
            let far = high.max(-low);
            [near * near, far * far]
        });
        let inverse = [1, 0].map(|end| (1.0 / (1.0 + squares[0][end] + squares[1][end]).sqrt()) as f32);
        let [x, y] = ranges.map(|range| range.map(|tangent| tangent as f32));
        let ways = ways.map(|ways| ways.map(|way| way as f32));
        Self { x, y, inverse, ways }
    }

    /// The most by which a ray is longer than the depth that it spans.
    pub fn longest(&self) -> f32 {
        1.0 / self.inverse[0]
    }

    /// Whether rays may meet balls, and the depths from their centres, in radii, between which rays may be in them, by the
    /// ranges of A and B; with room for the errors of single precision.
    #[inline(always)]
    fn depths<S: Simd>(&self, s: S, a: [S::F; 2], b: [S::F; 2]) -> (S::M, [S::F; 2]) {
        let slack = s.splat(1e-4);
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let (near_a, near_b) = (nearest(s, a), nearest(s, b));
        // The third component of c x dir makes b^2 only greater.
        let inverse = [s.splat(self.inverse[0]), s.splat(self.inverse[1])];
        let square = s.mul(s.mul_add(near_a, near_a, s.mul(near_b, near_b)), s.mul(inverse[0], inverse[0]));
        let meet = s.less(square, s.add(one, slack));
        let half = s.add(s.sqrt_near(s.max(s.sub(one, square), zero)), slack);
        let [x_low, x_high] = products(s, self.x, b);
        let [y_low, y_high] = products(s, self.y, a);
        let [low, high] = shrink(s, inverse, [s.sub(x_low, y_high), s.sub(x_high, y_low)]);
        let [low, high] = shrink(s, inverse, [s.sub(low, half), s.add(high, half)]);
        // Rays that miss the ball widen the range.
        (meet, [s.max(low, s.splat(-1.0)), s.min(high, one)])
    }
}

/// The least size of what is in ranges.
#[inline(always)]
fn nearest<S: Simd>(s: S, [low, high]: [S::F; 2]) -> S::F {
    let zero = s.splat(0.0);
    s.max(s.max(low, s.sub(zero, high)), zero)
}

/// Least and greatest product of what is in a range with what is in ranges.
#[inline(always)]
fn products<S: Simd>(s: S, range: [f32; 2], [low, high]: [S::F; 2]) -> [S::F; 2] {
    let (x0, x1) = (s.splat(range[0]), s.splat(range[1]));
    let (p, q) = (s.mul(x0, low), s.mul(x0, high));
    let (r, t) = (s.mul(x1, low), s.mul(x1, high));
    [s.min(s.min(p, q), s.min(r, t)), s.max(s.max(p, q), s.max(r, t))]
}

/// Least and greatest product with what is between two positive factors.
#[inline(always)]
fn shrink<S: Simd>(s: S, [least, most]: [S::F; 2], [low, high]: [S::F; 2]) -> [S::F; 2] {
    [s.min(s.mul(low, least), s.mul(low, most)), s.max(s.mul(high, least), s.mul(high, most))]
}

/// Least and greatest of a first value and steps from it, with room for the rounding of all three: much where rays are many
/// radii of a small ball apart.
#[inline(always)]
fn along<S: Simd>(s: S, first: S::F, slope: S::F, steps: [f32; 2]) -> [S::F; 2] {
    let zero = s.splat(0.0);
    let (p, q) = (s.mul_add(slope, s.splat(steps[0]), first), s.mul_add(slope, s.splat(steps[1]), first));
    let (low, high) = (s.min(p, q), s.max(p, q));
    let size = s.add(s.max(first, s.sub(zero, first)), s.max(high, s.sub(zero, low)));
    let room = s.splat(4e-7);
    [s.neg_mul_add(size, room, low), s.mul_add(size, room, high)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::random::Random;
    use crate::render::cpu::simd::{Level, WithSimd, dispatch};

    struct Meet<'a>(&'a Nearby, Beam);

    impl WithSimd for Meet<'_> {
        type Output = Vec<Hit>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> Vec<Hit> {
            let mut found = Vec::new();
            let mut hits = [Hit::default(); 16];
            for start in (0..self.0.count()).step_by(S::LANES) {
                let count = self.0.meet(s, start, &self.1, &mut hits);
                found.extend_from_slice(&hits[..count]);
            }
            found
        }
    }

    /// Balls of a hundred-thousandth of a pixel to hundreds of pixels: whatever a ray meets is found, with the depths where it
    /// is in the ball, and what is found is not much more than that.
    #[test]
    fn nothing_that_a_ray_meets_is_missed() {
        let mut random = Random(7);
        let mut random = |low: f64, high: f64| random.uniform(low, high);
        let (step, corner, at, counts) = ([0.002, -0.002], [-0.9, 0.7], [16, 40], [16, 8]);
        let mut nearby = Nearby::default();
        let centers: Vec<DVec3> = (0..5000)
            .map(|_| {
                let radius = 10f64.powf(random(-8.0, 0.5));
                // Half of the small ones are as good as on a ray.
                let on = random(0.0, 1.0) < 0.5;
                let place = |i: f64| if on { i.floor() } else { i };
                let x = corner[0] + step[0] * place(random(0.0, 64.0));
                let y = corner[1] + step[1] * place(random(0.0, 64.0));
                let off = random(-1.1, 1.1) * radius;
                let depth = random(0.5, 2.0);
                DVec3::new(x * depth + off, y * depth, -depth) / radius
            })
            .collect();
        for (number, &center) in centers.iter().enumerate() {
            nearby.push(number as u32, (number % 5) as u8, center, corner);
        }
        nearby.pad();
        for level in Level::available() {
            let found = dispatch(level, Meet(&nearby, Beam::new(corner, step, at, counts)));
            let (mut met, mut next) = (0, found.iter().peekable());
            for (number, center) in centers.iter().enumerate() {
                let hit = next.next_if(|hit| hit.ball as usize == number);
                assert!(hit.is_none_or(|hit| hit.color == (number % 5) as u8));
                let mut meets = false;
                for (i, j) in (0..counts[1]).flat_map(|j| (0..counts[0]).map(move |i| (i, j))) {
                    let x = corner[0] + step[0] * (at[0] + i) as f64;
                    let y = corner[1] + step[1] * (at[1] + j) as f64;
                    let dir = DVec3::new(x, y, -1.0);
                    let square = center.cross(dir).length_squared() / dir.length_squared();
                    if square < 1.0 {
                        meets = true;
                        let hit = hit.unwrap_or_else(|| panic!("{level}: ball {number} of {center} is missed"));
                        // Depth of the points where the ray is 1 from the centre.
                        let middle = center.dot(dir) / dir.length_squared();
                        let half = (1.0 - square).sqrt() / dir.length();
                        let [enter, leave] = [middle - half, middle + half].map(|depth| depth + center.z);
                        // Doubles round too, and most where balls are small.
                        let room = 1e-12 * center.length();
                        assert!(f64::from(hit.depths[0]) <= enter + room, "{level}: {number}: {hit:?} {enter}");
                        assert!(f64::from(hit.depths[1]) >= leave - room, "{level}: {number}: {hit:?} {leave}");
                    }
                }
                met += usize::from(meets);
            }
            assert!(next.next().is_none(), "numbers ascend");
            assert!(met > 500, "{met}");
            // Small balls beside every ray, within the block's rectangle, are found too.
            assert!(found.len() < met + centers.len() / 30, "{level}: {} found, {met} met", found.len());
        }
    }
}
