//! The optical depth of one particle in the slabs before a block of rays.

use super::Ball;
use super::block::Rays;
use super::composite::Slot;
use crate::render::cpu::footprint::{GAUSSIAN_CENTRE, gaussian_quick};
use crate::render::cpu::primitive::{BELIAEV, Constant, GAUSSIAN, Leg, Poly, Primitive, Shape, Shell, Shells, Thick};
use crate::render::cpu::simd::Simd;
use crate::scene::Rgb;

/// A particle before a block.
pub struct Fragment<'a, F, const R: usize> {
    pub ball: &'a Ball,
    pub rays: &'a Rays<F, R>,
    /// Tangents of the first pixel's ray, and from pixel to pixel.
    pub corner: [f64; 2],
    pub step: [f64; 2],
    /// Depth of the plane behind each slab.
    pub planes: &'a [f32],
    /// How many planes are before the particle, and how many before or in it.
    pub span: [usize; 2],
    /// Whether opaque surfaces may cut it.
    pub wall: bool,
    /// Whether its shares of the slabs may be less exact.
    pub thick: bool,
}

/// Thickness of a slab, in radii, from which a Gaussian's shares of the slabs may be less exact ([`Thick`]): the error of the
/// slabs is a hundred times as large.
pub const THICK: f32 = 0.25;

impl<F: Copy, const R: usize> Fragment<'_, F, R> {
    /// Whether opaque surfaces or the near plane may cut it.
    #[inline(always)]
    pub fn is_clipped(&self) -> bool {
        self.wall || self.ball.near > -1.0
    }

    /// Adds all of a Gaussian to the optical depth of colour `number` in one slab, within [`QUICK`] of it.
    ///
    /// [`QUICK`]: crate::render::cpu::footprint::QUICK
    #[inline(always)]
    pub fn gaussian<S: Simd<F = F>>(&self, s: S, number: u8, slot: &mut Slot<F, R>) {
        let mut within = self.square(s);
        for within in &mut within {
            *within = s.sub(s.splat(1.0), *within);
        }
        let amplitude = s.splat(self.ball.amplitude * GAUSSIAN_CENTRE);
        for (row, whole) in slot.iter_mut().zip(gaussian_quick(s, within)) {
            let sum = &mut row[usize::from(number & 3)];
            *sum = s.mul_add(whole, amplitude, *sum);
        }
    }

    /// Adds the particle, whatever its kernel.
    #[inline(always)]
    pub fn shape<S: Simd<F = F>, const FEW: bool>(
        &self,
        s: S,
        number: u8,
        shells: &[Shell],
        slots: &mut [Slot<F, R>],
        legs: &mut Vec<Leg<F, GROUP>>,
    ) {
        match self.ball.shape {
            Shape::Gaussian if self.thick => self.add::<S, _, FEW>(s, Thick, number, slots, legs),
            Shape::Gaussian => self.add::<S, _, FEW>(s, GAUSSIAN, number, slots, legs),
            Shape::Beliaev => self.add::<S, _, FEW>(s, BELIAEV, number, slots, legs),
            Shape::Constant => self.add::<S, _, FEW>(s, Constant, number, slots, legs),
            Shape::Poly => self.add::<S, _, FEW>(s, Poly, number, slots, legs),
            Shape::Shells(first, count) => {
                self.add::<S, _, FEW>(s, Shells::new(shells, first, count), number, slots, legs);
            }
        }
    }

    /// B, by columns; see [`Fragment::add`].
    #[inline(always)]
    fn across<S: Simd<F = F>>(&self, s: S) -> F {
        let Self { rays, corner, step, .. } = self;
        let c = self.ball.center;
        s.mul_add(rays.ramp, s.splat((c.z * step[0]) as f32), s.splat((c.x + c.z * corner[0]) as f32))
    }

    /// A of the first row, and from row to row.
    #[inline(always)]
    fn down(&self) -> (f32, f32) {
        let Self { corner, step, .. } = self;
        let c = self.ball.center;
        ((-c.z * corner[1] - c.y) as f32, (-c.z * step[1]) as f32)
    }

    /// b^2, row by row.
    #[inline(always)]
    fn square<S: Simd<F = F>>(&self, s: S) -> [F; R] {
        let rays = self.rays;
        let b = self.across(s);
        let b_square = s.mul(b, b);
        let (a_first, a_step) = self.down();
        let mut square = rays.weight;
        for (r, square) in square.iter_mut().enumerate() {
            let a = a_first + r as f32 * a_step;
            let twist = s.mul_add(b, s.splat(rays.y[r]), s.mul(rays.x, s.splat(a)));
            let cross = s.mul_add(twist, twist, s.add(b_square, s.splat(a * a)));
            *square = s.mul(cross, *square);
        }
        square
    }

    /// Adds the optical depths of the particle's slabs: with `FEW` to that of colour `number`, else with the colour.
    ///
    /// With c the centre over the radius, d its depth and dir = (X, Y, -1), the offsets of the ray from the centre at the
    /// centre's depth are A = d Y - c_y, B = c_x - d X, both small where the ray meets the ball, and
    /// c x dir = (A, B, A X + B Y): b^2 = |c x dir|^2 / |dir|^2. The point nearest the centre is o = (X B - Y A)/|dir|
    /// beyond the ray's point at the centre's depth, so that a plane z farther than the centre is met at u = z |dir| - o.
    #[inline(always)]
    fn add<S: Simd<F = F>, P: Primitive, const FEW: bool>(
        &self,
        s: S,
        kernel: P,
        number: u8,
        slots: &mut [Slot<F, R>],
        legs: &mut Vec<Leg<F, GROUP>>,
    ) {
        const { assert!(R.is_multiple_of(GROUP)) };
        let Self { rays, span: [skipped, end], .. } = self;
        if *skipped == slots.len() {
            return;
        }
        // Within one slab a ball costs too little for questions.
        let ask = skipped < end || self.is_clipped();
        let one = s.splat(1.0);
        let mut square = self.square(s);
        let mut reached = 0u32;
        for (r, square) in square.iter_mut().enumerate() {
            *square = s.min(*square, one);
            reached |= u32::from(!ask || s.any(s.less(*square, one))) << (r / GROUP);
        }
        let b = self.across(s);
        let (a_first, a_step) = self.down();
        let along_x = s.mul(rays.x, b);
        while reached != 0 {
            let group = reached.trailing_zeros() as usize;
            reached &= reached - 1;
            let first = group * GROUP;
            let mut rows = Rows { group, square: square.as_chunks::<GROUP>().0[group], along: [along_x; GROUP] };
            for (r, along) in (first..).zip(&mut rows.along) {
                let a = a_first + r as f32 * a_step;
                *along = s.sub(along_x, s.splat(rays.y[r] * a));
            }
            self.rows::<S, P, FEW>(s, kernel, number, &rows, slots, legs);
        }
    }

    /// Adds a group of rows, some of whose rays meet the particle.
    #[inline(always)]
    // Rows of many arrays at once.
    #[allow(clippy::needless_range_loop)]
    fn rows<S: Simd<F = F>, P: Primitive, const FEW: bool>(
        &self,
        s: S,
        kernel: P,
        number: u8,
        rows: &Rows<F>,
        slots: &mut [Slot<F, R>],
        legs: &mut Vec<Leg<F, GROUP>>,
    ) {
        let Self { ball, rays, planes, span: [skipped, end], wall, .. } = self;
        let (skipped, end) = (*skipped, *end);
        let Rows { group, square, along } = rows;
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let length = &rays.length.as_chunks::<GROUP>().0[*group];
        let inverse = &rays.inverse.as_chunks::<GROUP>().0[*group];
        let mut half = *square;
        for half in &mut half {
            *half = s.sqrt_near(s.sub(one, *half));
        }
        kernel.prepare(s, square, legs);
        let amplitude = s.splat(ball.amplitude);
        let clipped = self.is_clipped();
        let whole = kernel.end(s, square, legs, &half);
        if !clipped && skipped == end {
            let twice = s.add(amplitude, amplitude);
            let slot = &mut slots[end].as_chunks_mut::<GROUP>().0[*group];
            for r in 0..GROUP {
                put::<S, FEW>(s, &mut slot[r], s.mul(whole[r], twice), number, &ball.color);
            }
            return;
        }
        let [mut offset, mut from] = [half; 2];
        let mut to = half;
        for r in 0..GROUP {
            offset[r] = s.mul(along[r], inverse[r]);
            from[r] = s.sub(zero, half[r]);
        }
        if clipped {
            let walls = &rays.wall.as_chunks::<GROUP>().0[*group];
            for r in 0..GROUP {
                let near = s.mul_add(s.splat(ball.near), length[r], s.sub(zero, offset[r]));
                if *wall {
                    let [high, low] = walls[r];
                    let depth = s.add(s.sub(high, s.splat(ball.depth[0])), s.sub(low, s.splat(ball.depth[1])));
                    let limit = s.mul(s.mul(depth, s.splat(ball.inverse_radius)), length[r]);
                    to[r] = s.min(to[r], s.sub(limit, offset[r]));
                }
                from[r] = s.min(s.max(from[r], near), half[r]);
                to[r] = s.max(to[r], from[r]);
            }
        }
        let mut factor = *square;
        if clipped {
            // Where something cuts the chord, the whole depends on the factor too.
            for factor in &mut factor {
                *factor = s.mul(kernel.factor(s, *factor), amplitude);
            }
        } else {
            for factor in &mut factor {
                *factor = s.mul(kernel.factor_between(s, *factor), amplitude);
            }
        }
        // Where the ray enters and leaves the gas.
        let [mut enter, mut leave] = [whole; 2];
        if clipped {
            enter = kernel.at(s, square, legs, &from);
            leave = kernel.at(s, square, legs, &to);
            for r in 0..GROUP {
                enter[r] = s.mul(enter[r], factor[r]);
                leave[r] = s.mul(leave[r], factor[r]);
            }
        } else {
            for r in 0..GROUP {
                leave[r] = s.mul(whole[r], amplitude);
                enter[r] = s.sub(zero, leave[r]);
            }
        }
        let mut before = enter;
        for (slot, behind) in slots[skipped..end].iter_mut().zip(&planes[skipped..end]) {
            let slot = &mut slot.as_chunks_mut::<GROUP>().0[*group];
            let z = s.splat(((behind - ball.depth[0]) - ball.depth[1]) * ball.inverse_radius);
            let mut u = to;
            for r in 0..GROUP {
                let plane = s.mul_add(z, length[r], s.sub(zero, offset[r]));
                u[r] = s.min(s.max(plane, from[r]), to[r]);
            }
            let after = kernel.between(s, square, legs, &u);
            for r in 0..GROUP {
                let after = s.mul(after[r], factor[r]);
                put::<S, FEW>(s, &mut slot[r], s.sub(after, before[r]), number, &ball.color);
                before[r] = after;
            }
        }
        if let Some(slot) = slots.get_mut(end) {
            let slot = &mut slot.as_chunks_mut::<GROUP>().0[*group];
            for r in 0..GROUP {
                put::<S, FEW>(s, &mut slot[r], s.sub(leave[r], before[r]), number, &ball.color);
            }
        }
    }
}

/// Rows of a block that are computed together: those that a particle does not reach are spared, and a group's numbers stay in
/// registers.
pub const GROUP: usize = 2;

/// A group of rows before a particle.
struct Rows<F> {
    /// Its number in the block.
    group: usize,
    /// b^2, at most 1.
    square: [F; GROUP],
    /// X B - Y A.
    along: [F; GROUP],
}

/// Adds optical depth to a row of a slab: with `FEW` to that of colour `number`, else with the colour.
#[inline(always)]
fn put<S: Simd, const FEW: bool>(s: S, row: &mut [S::F; 4], depth: S::F, number: u8, color: &Rgb) {
    if FEW {
        let number = usize::from(number & 3);
        row[number] = s.add(row[number], depth);
    } else {
        row[0] = s.add(row[0], depth);
        for (sum, &value) in row[1..].iter_mut().zip(color) {
            *sum = s.mul_add(depth, s.splat(value), *sum);
        }
    }
}
