//! Planes of depth for one block of rays, where balls of different colours overlap and nowhere else.
//!
//! Along the rays of a block balls follow each other in groups that share depths. A ball that shares none is exact in a slab
//! of its own, and so are any number of one colour. Of a group, how much its order can matter is bounded: to sort what is
//! mixed takes swaps of neighbours, each of which changes a channel by at most a a' |c - c'| (Beliaev & Zaytseva, equation 4,
//! and [`super::super::mixing`]). Groups for which that fits into what may be lost are one slab; in the others planes part
//! what has one colour from what mixes, and cut that in fours, as thick as the smallest ball among them allows.

use super::Ball;
use crate::render::cpu::nearby::Hit;
use crate::render::cpu::primitive::Shape;
use std::f32::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// Slabs of a block, at the most.
pub const MOST_SLABS: usize = 1024;

/// What of the tolerance the groups may lose that are not cut, as a share of what all slabs may.
const UNCUT: f32 = 0.4;

/// Optical depth up to which half the product of two is less than that of the opacities.
const THIN: f32 = 0.75;

/// Thickness of a slab in radii of the smallest ball in it, if that has an optical depth of a tenth: first, least and most.
pub const FINENESS: [f32; 3] = [0.45, 0.004, 0.6];

/// What the extrapolation is not trusted to take away of the difference that half as many slabs make from a quarter, for slabs 1.5
/// standard deviations thick; it falls with the square of that. Single rays through clumps of two colours, 0.1 to 12 deep and slabs
/// anywhere, are off by up to twice what this and the doubt give, and by 30 times what the doubt alone does.
const DISTRUST: f32 = 0.12;

/// A ball that rays of the block may meet.
#[derive(Clone, Copy, Debug)]
pub struct Met {
    pub ball: u32,
    /// Which of the tile's colours it has, if they are few.
    pub color: u8,
    /// Depths between which rays may be in it.
    pub depths: [f32; 2],
    /// The most that rays may see of it: optical depth and opacity.
    pub depth: f32,
    opacity: f32,
    /// Thickness of its slabs, but for the fineness.
    thickness: f32,
    /// One over its standard deviation, taken for a Gaussian; and whether its density has kinks or steps.
    sharpness: f32,
    kinks: bool,
    /// First and last slab.
    pub slabs: [u32; 2],
}

/// Balls that share depths.
struct Group {
    /// One after the last, among those met.
    end: usize,
    /// Depths of its begin and end.
    depths: [f32; 2],
    /// Whether it is one slab.
    whole: bool,
    /// Whether it has one colour.
    alone: bool,
}

/// Slabs that are composited at once: one, or four of the same thickness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// One after its last slab.
    pub end: usize,
    pub count: usize,
    /// A ball met that has the colour of all in it, if that is one.
    pub alone: Option<u32>,
}

/// The planes of a block. Kept from block to block for its memory and its fineness.
#[derive(Default)]
pub struct Local {
    /// In order of the least depth.
    pub met: Vec<Met>,
    groups: Vec<Group>,
    /// Depth of the plane behind each slab.
    pub planes: Vec<f32>,
    pub units: Vec<Unit>,
    /// How much larger the error may be than slabs estimate.
    pub doubt: f32,
    /// What the error may be at least, as a share of what half as many slabs differ from a quarter.
    pub distrust: f32,
    /// What the groups lose that are not cut.
    pub lost: f32,
    /// What groups may lose more for which there are not slabs enough.
    pub spilled: f32,
    /// The first of their slabs that are not cut.
    pub spills: usize,
    /// Balls that have begun and not yet ended.
    open: Vec<u32>,
}

impl Local {
    /// Forgets the balls.
    pub fn clear(&mut self) {
        self.met.clear();
    }

    /// Adds a ball that the rays of the block may meet; `stretch`: the most by which they are longer than the depths they span.
    #[inline]
    pub fn push(&mut self, ball: &Ball, hit: &Hit, stretch: f32) {
        let radius = 1.0 / ball.inverse_radius;
        let near = ball.depth[0] + hit.depths[0].max(ball.near) * radius;
        let far = ball.depth[0] + hit.depths[1] * radius;
        if near > far {
            return;
        }
        // Single precision may not tell a tiny ball's ends apart.
        let far = far.max(near.next_up());
        // A chord that is half as long holds at most half of the bound (`Kernel::excess`).
        let half = (0.5 * (hit.depths[1] - hit.depths[0]) * stretch).min(1.0);
        // At least 1 - exp(-depth); where the peak is infinite the quotient is no number, and the minimum 1.
        let depth = ball.peak * half;
        let opacity = (depth / (1.0 + 0.5 * depth)).min(1.0);
        // The fourth root: what is left of the extrapolation is of the fourth order. Not more than for a tenth: many faint ones
        // may clump.
        let width = radius * ball.width;
        let thickness = width * (0.1 / depth.max(0.1)).sqrt().sqrt().max(0.2);
        let (deviations, kinks) = match ball.shape {
            Shape::Constant | Shape::Shells(..) => (3.0, true),
            Shape::Gaussian | Shape::Poly => (3.0, false),
            Shape::Beliaev => (4.0, false),
        };
        let sharpness = deviations / width;
        let depths = [near, far];
        self.met.push(Met {
            ball: hit.ball,
            color: hit.color,
            depths,
            depth,
            opacity,
            thickness,
            sharpness,
            kinks,
            slabs: [0; 2],
        });
    }

    /// Forgets what lies behind a depth.
    pub fn end(&mut self, farthest: f32) {
        self.met.retain_mut(|met| {
            met.depths[1] = met.depths[1].min(farthest);
            met.depths[0] < met.depths[1]
        });
    }

    /// Sorts the balls by their least depth. They are almost sorted, but for how far rays pass from their centres.
    pub fn sort(&mut self) {
        let met = &mut self.met;
        let mut moves = 0;
        for i in 1..met.len() {
            let own = met[i];
            let mut at = i;
            while at > 0 && met[at - 1].depths[0] > own.depths[0] {
                met[at] = met[at - 1];
                at -= 1;
            }
            met[at] = own;
            moves += i - at;
            if moves > 32 * met.len() {
                met.sort_unstable_by(|a, b| a.depths[0].total_cmp(&b.depths[0]));
                return;
            }
        }
    }

    /// Finds the groups, and those of them that need no planes if `most` may be lost.
    pub fn group(&mut self, balls: &[Ball], most: f32) {
        self.groups.clear();
        let mut left = UNCUT * most;
        self.lost = 0.0;
        let mut next = 0;
        while let Some(first) = self.met.get(next) {
            let start = next;
            let [near, mut far] = first.depths;
            let color = balls[first.ball as usize].color;
            let (mut thin, mut alone) = (true, true);
            while let Some(met) = self.met.get(next).filter(|met| next == start || met.depths[0] < far) {
                far = far.max(met.depths[1]);
                thin &= met.depth <= THIN;
                alone &= balls[met.ball as usize].color == color;
                next += 1;
            }
            let bound = if alone { 0.0 } else { self.bound(balls, start..next, thin) };
            let whole = bound <= 0.5 * left;
            if whole {
                left -= bound;
                self.lost += bound;
            }
            self.groups.push(Group { end: next, depths: [near, far], whole, alone });
        }
    }

    /// The sum over all pairs of w w' (|c - m| + |c' - m|), m being a mean: at least that of w w' |c - c'|. Pieces of two balls
    /// that mix are in the wrong order half of the time, at the most: w w' is half the product of the depths, or, where they are
    /// not thin, that of the opacities.
    fn bound(&self, balls: &[Ball], range: Range<usize>, thin: bool) -> f32 {
        let weight = |met: &Met| if thin { met.depth * FRAC_1_SQRT_2 } else { met.opacity };
        let (mut sum, mut mean) = (0.0, [0.0; 3]);
        for met in &self.met[range.clone()] {
            let weight = weight(met);
            sum += weight;
            let color = balls[met.ball as usize].color;
            for (mean, color) in mean.iter_mut().zip(color) {
                *mean += weight * color;
            }
        }
        let mean = mean.map(|mean| mean / sum.max(f32::MIN_POSITIVE));
        let mut bound = [0.0f32; 3];
        for met in &self.met[range] {
            let color = balls[met.ball as usize].color;
            let weight = weight(met);
            let pairs = weight * (sum - weight);
            for ((bound, color), mean) in bound.iter_mut().zip(color).zip(mean) {
                *bound += pairs * (color - mean).abs();
            }
        }
        bound.into_iter().fold(0.0, f32::max)
    }

    /// Lays the planes and says which slabs each ball is in.
    pub fn cut(&mut self, balls: &[Ball], few: bool, fineness: f32) {
        let Self { met, groups, planes, units, doubt, distrust, spills, open, .. } = self;
        planes.clear();
        units.clear();
        (*doubt, *distrust) = (0.0, 0.0);
        let mut start = 0;
        let mut over = Vec::new();
        for group in groups.iter() {
            let [near, far] = group.depths;
            if group.whole {
                slabs(planes, units, [near, far], 1, group.alone.then_some(start as u32));
            } else {
                let met = &met[..group.end];
                let mut cut = Cutting { balls, few, met, fineness, next: start, open, doubt, distrust };
                if !cut.group(group.depths, planes, units) {
                    if over.is_empty() {
                        *spills = planes.len() - 1;
                    }
                    over.push(start..group.end);
                }
            }
            start = group.end;
        }
        let (mut first, most) = (0, planes.len().saturating_sub(1));
        for met in met {
            while first < most && planes[first] <= met.depths[0] {
                first += 1;
            }
            let mut last = first;
            while last < most && planes[last] < met.depths[1] {
                last += 1;
            }
            met.slabs = [first as u32, last as u32];
        }
        self.spilled = over.into_iter().map(|range| self.bound(balls, range, false)).sum();
    }
}

/// Adds slabs of the same thickness between two depths.
fn slabs(planes: &mut Vec<f32>, units: &mut Vec<Unit>, [near, far]: [f32; 2], count: usize, alone: Option<u32>) {
    let step = (far - near) / count as f32;
    planes.extend((1..count).map(|i| near + i as f32 * step));
    planes.push(far);
    units.push(Unit { end: planes.len(), count, alone });
}

/// A group that is cut.
struct Cutting<'a> {
    balls: &'a [Ball],
    /// Whether the tile has few colours.
    few: bool,
    /// Up to the last of the group.
    met: &'a [Met],
    fineness: f32,
    /// The first that has not begun.
    next: usize,
    open: &'a mut Vec<u32>,
    doubt: &'a mut f32,
    distrust: &'a mut f32,
}

impl Cutting<'_> {
    /// Whether two have the same colour.
    #[inline]
    fn alike(&self, a: &Met, b: &Met) -> bool {
        if self.few {
            a.color == b.color
        } else {
            self.balls[a.ball as usize].color == self.balls[b.ball as usize].color
        }
    }

    /// Thickness of four slabs that a ball allows.
    fn four(&self, met: &Met) -> f32 {
        4.0 * self.fineness * met.thickness
    }

    /// Cuts the group; whether there were slabs enough.
    fn group(&mut self, [near, far]: [f32; 2], planes: &mut Vec<f32>, units: &mut Vec<Unit>) -> bool {
        self.open.clear();
        let mut at = near;
        while at < far {
            while let Some(met) = self.met.get(self.next).filter(|met| met.depths[0] <= at) {
                if met.depths[1] > at {
                    self.open.push(self.next as u32);
                }
                self.next += 1;
            }
            let met = self.met;
            self.open.retain(|&i| met[i as usize].depths[1] > at);
            if planes.len() + 4 > MOST_SLABS {
                slabs(planes, units, [at, far], 1, None);
                return false;
            }
            let Some((&first, others)) = self.open.split_first() else {
                // The next begins here, but for rounding.
                at = self.met.get(self.next).map_or(far, |met| met.depths[0]);
                continue;
            };
            let one = &self.met[first as usize];
            let least = self.open.iter().map(|&i| self.four(&self.met[i as usize])).fold(f32::INFINITY, f32::min);
            if others.iter().all(|&i| self.alike(&self.met[i as usize], one)) {
                let to = self.alone(one, at, far);
                if to == far || to - at > 0.125 * least {
                    slabs(planes, units, [at, to], 1, Some(first));
                    at = to;
                    continue;
                }
            }
            let mut to = at + least;
            for met in self.met[self.next..].iter().take_while(|met| met.depths[0] < far) {
                if met.depths[0] >= to {
                    break;
                }
                to = to.min((at + self.four(met)).max(met.depths[0]));
            }
            // Not less than single precision tells apart; and all of the last ones as thick.
            to = to.max(at * (1.0 + 1e-5));
            let left = far - at;
            to = if to - at >= left { far } else { to };
            let count = (left / (to - at)).ceil();
            if count <= 3.0 {
                to = if count <= 1.0 { far } else { at + left / count };
            }
            self.doubt(at, to);
            slabs(planes, units, [at, to], 4, None);
            at = to;
        }
        true
    }

    /// How far from `at` on gas has one colour alone.
    fn alone(&self, one: &Met, at: f32, far: f32) -> f32 {
        let ends = self.open.iter().map(|&i| self.met[i as usize].depths[1]);
        let mut to = ends.fold(at, f32::max);
        for met in &self.met[self.next..] {
            if met.depths[0] >= to {
                break;
            }
            if !self.alike(met, one) {
                return met.depths[0];
            }
            to = to.max(met.depths[1]);
        }
        to.min(far)
    }

    /// How much larger the error of four slabs may be than they say: their estimate takes them for thin, and densities for
    /// smooth. The extrapolation's estimate divides by 15, as for the fourth order; for the first to the second, which is left
    /// where a density has kinks, it would be 1 to 3: at least 8 is taken. For Gaussians measured: 3.7 at 1.8 standard
    /// deviations, 1.0 at 0.8. Where thick slabs hold much, extrapolations may agree by chance: of what half as many slabs differ
    /// from a quarter, a share is never trusted away.
    fn doubt(&mut self, at: f32, to: f32) {
        let later = self.met[self.next..].iter().take_while(|met| met.depths[0] < to);
        let open = self.open.iter().map(|&i| &self.met[i as usize]);
        let (mut sharpest, mut kinks) = (0.0f32, false);
        for met in open.chain(later) {
            sharpest = sharpest.max(met.sharpness);
            kinks |= met.kinks;
        }
        let thickness = 0.25 * (to - at) * sharpest / 1.5;
        let smooth = 1.0 + 3.0 * thickness * thickness;
        let worst = if kinks { smooth.max(4.0) * 2.0 } else { smooth };
        *self.doubt = self.doubt.max(worst);
        let square = thickness * thickness;
        *self.distrust = self.distrust.max(DISTRUST * if kinks { square.max(1.0) } else { square });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Kernel;

    struct Random(u64);

    impl Random {
        fn uniform(&mut self, low: f32, high: f32) -> f32 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * (self.0 >> 40) as f32 / (1u64 << 24) as f32
        }
    }

    /// Balls on the axis of a block, of up to three colours, sorted.
    fn block(random: &mut Random, count: usize, depths: [f32; 2], peaks: [f32; 2]) -> (Vec<Ball>, Local) {
        let mut local = Local::default();
        let balls: Vec<Ball> = (0..count)
            .map(|_| {
                let radius = random.uniform(0.02, 0.5);
                let color = [[1.0, 0.0, 0.2], [0.0, 0.9, 0.1], [0.3, 0.3, 1.0]][random.uniform(0.0, 2.999) as usize];
                Ball {
                    depth: [random.uniform(depths[0], depths[1]), 0.0],
                    inverse_radius: 1.0 / radius,
                    near: -10.0,
                    peak: random.uniform(peaks[0], peaks[1]),
                    width: 1.0,
                    color,
                    ..Ball::default()
                }
            })
            .collect();
        for (number, ball) in balls.iter().enumerate() {
            let color = ball.color.iter().position(|&value| value >= 0.9).unwrap_or_default() as u8;
            local.push(ball, &Hit { ball: number as u32, color, depths: [-1.0, 1.0] }, 1.0);
        }
        local.sort();
        (balls, local)
    }

    #[test]
    fn slabs_hold_the_balls_and_part_the_colours() {
        let mut random = Random(3);
        let mut cut = 0;
        for round in 0..300 {
            let count = 1 + round % 40;
            let (balls, mut local) = block(&mut random, count, [1.0, 9.0], [0.0, 1.5]);
            local.group(&balls, if round % 3 == 0 { 0.0 } else { 0.02 });
            local.cut(&balls, round % 2 == 0, [1.0, 0.3, 0.01][round % 3]);
            let planes = &local.planes;
            assert!(planes.windows(2).all(|pair| pair[0] < pair[1]), "{planes:?}");
            assert!(planes.len() <= MOST_SLABS + 4 + count, "{}", planes.len());
            let mut end = 0;
            for unit in &local.units {
                assert!(unit.count == 1 || unit.count == 4, "{unit:?}");
                end += unit.count;
                assert_eq!(unit.end, end);
                cut += usize::from(unit.count == 4);
                // What is in a slab of one colour has that colour.
                let Some(alone) = unit.alone else { continue };
                let color = local.met[alone as usize].color;
                for met in &local.met {
                    let [first, last] = met.slabs.map(|slab| slab as usize);
                    assert!(!(first..=last).contains(&(end - 1)) || met.color == color, "{unit:?} {met:?}");
                }
            }
            assert_eq!(end, planes.len());
            for met in &local.met {
                let [first, last] = met.slabs.map(|slab| slab as usize);
                let front = if first == 0 { f32::NEG_INFINITY } else { planes[first - 1] };
                assert!(front <= met.depths[0] && met.depths[1] <= planes[last], "{met:?} {planes:?}");
                // Nothing that mixes is thicker than what it allows.
                for unit in
                    local.units.iter().filter(|unit| unit.count == 4 && unit.end > first && unit.end - 4 <= last)
                {
                    let most = [1.0, 0.3, 0.01][round % 3] * met.thickness;
                    let thickness = planes[unit.end - 1] - planes[unit.end - 2];
                    assert!(thickness <= 1.001 * most + 2e-5 * met.depths[1], "{thickness} of {most}");
                }
            }
        }
        assert!(cut > 1000, "{cut}");
    }

    /// What a block keeps of a ball of radius 0.4 that its rays meet between two depths from the centre, in radii.
    fn pushed(peak: f32, width: f32, shape: Shape, depths: [f32; 2], stretch: f32) -> Met {
        let ball = Ball { depth: [5.0, 0.0], inverse_radius: 2.5, near: -10.0, peak, width, shape, ..Ball::default() };
        let mut local = Local::default();
        local.push(&ball, &Hit { depths, ..Hit::default() }, stretch);
        local.met[0]
    }

    /// However a ray is slanted, what it may see of a ball is at least what its chord holds; of a constant density just that.
    #[test]
    fn slanted_rays_see_whole_chords() {
        let kernels = [
            (Kernel::Constant, Shape::Constant),
            (Kernel::Gaussian, Shape::Gaussian),
            (Kernel::Beliaev, Shape::Beliaev),
            (Kernel::Poly, Shape::Poly),
            (Kernel::Linear, Shape::Shells(0, 1)),
        ];
        for (kernel, shape) in kernels {
            for (tangent, distance) in
                [0.0f64, 0.7, 2.0, 8.0].into_iter().flat_map(|t| [0.0, 0.3, 0.8, 0.99].map(|b| (t, b)))
            {
                // A ray along (tangent, 0, -1) that passes the centre at a distance across: its depths on the unit sphere.
                let length = tangent.hypot(1.0);
                let (middle, half) = (distance * tangent / length, (1.0 - distance * distance).sqrt() / length);
                let depths = [middle - half, middle + half].map(|depth| depth as f32);
                for peak in [1e-4, 0.2, 3.0] {
                    let seen = peak * kernel.chord(distance) / kernel.chord(0.0);
                    let met = pushed(peak as f32, 1.0, shape, depths, length as f32);
                    let (depth, opacity) = (f64::from(met.depth), f64::from(met.opacity));
                    let what =
                        format!("{kernel:?}, tangent {tangent}, distance {distance}: {depth} and {opacity} of {seen}");
                    assert!(depth >= 0.9999 * seen && opacity >= -0.9999 * (-seen).exp_m1(), "{what}");
                    assert!(depth <= 1.0001 * seen || kernel != Kernel::Constant, "{what}");
                }
            }
        }
    }

    /// Slabs of a ball are as thick as its radius if it has an optical depth of a tenth, thinner if it has more, and not thicker
    /// if it has less: many faint ones may clump.
    #[test]
    fn faint_balls_have_no_thicker_slabs() {
        let thickness = |peak, half: f32| pushed(peak, 1.0, Shape::Gaussian, [-half, half], 1.0).thickness;
        let tenth = thickness(0.1, 1.0);
        assert!((tenth - 0.4).abs() < 1e-6, "{tenth}");
        for peak in [0.0, 1e-9, 1e-6, 1e-4, 0.003, 0.05, 0.0999, 0.5, 4.0, 1e3, f32::INFINITY] {
            for half in [1.0, 0.5, 0.01] {
                let faint = thickness(peak, half);
                assert!(faint <= tenth && faint >= 0.2 * tenth, "{faint} of {tenth} for {peak}");
                assert!(faint < 0.99 * tenth || peak * half < 0.11, "{faint} of {tenth} for {peak}");
            }
        }
    }

    /// What is narrow in a ball makes its slabs thin and sharp in proportion.
    #[test]
    fn narrow_balls_have_thin_slabs() {
        for shape in [Shape::Shells(0, 1), Shape::Gaussian] {
            for peak in [0.0, 0.01, 0.1, 0.7, f32::INFINITY] {
                let wide = pushed(peak, 1.0, shape, [-1.0, 1.0], 1.2);
                for width in [0.02, 0.1, 0.5, 0.9] {
                    let narrow = pushed(peak, width, shape, [-1.0, 1.0], 1.2);
                    let ratios = [narrow.thickness / wide.thickness, wide.sharpness / narrow.sharpness];
                    assert!(ratios.iter().all(|ratio| (ratio / width - 1.0).abs() < 1e-5), "{ratios:?} for {width}");
                }
            }
        }
    }

    /// Light of slices of gas, nearest first, each of an optical depth and a colour.
    fn light(slices: impl Iterator<Item = (f64, [f64; 3])>) -> [f64; 3] {
        let (mut through, mut light) = (1.0, [0.0; 3]);
        for (depth, color) in slices {
            let gone = through * -(-depth).exp_m1();
            light = [0, 1, 2].map(|channel| light[channel] + gone * color[channel]);
            through -= gone;
        }
        light
    }

    /// What mixes in one slab is not farther from the truth than the bound says, whatever the densities along the ray; and the
    /// bound is not idle.
    #[test]
    fn mixing_costs_no_more_than_its_bound() {
        const SLICES: usize = 400;
        let mut random = Random(11);
        let mut nearest = f64::INFINITY;
        for round in 0..400 {
            let peaks = if round % 2 == 0 { [0.001, 0.7] } else { [0.01, 3.0] };
            let (balls, mut local) = block(&mut random, 2 + round % 5, [1.0, 1.2], peaks);
            local.group(&balls, f32::INFINITY);
            if local.groups.len() > 1 {
                continue;
            }
            let [near, far] = local.groups[0].depths.map(f64::from);
            // Half of the balls hold all that they have in a part of their chord.
            let parts: Vec<[f64; 2]> = local
                .met
                .iter()
                .map(|met| {
                    let [low, high] = met.depths.map(f64::from);
                    let at = f64::from(random.uniform(0.0, 1.0));
                    if at < 0.5 {
                        [low, high]
                    } else {
                        [low + 0.9 * (at - 0.5) * (high - low), low + at * (high - low)]
                    }
                })
                .collect();
            let step = (far - near) / SLICES as f64;
            let content = |from: f64, to: f64| {
                let (mut depth, mut color) = (0.0, [0.0; 3]);
                for (met, part) in local.met.iter().zip(&parts) {
                    let ball = &balls[met.ball as usize];
                    let share = (to.min(part[1]) - from.max(part[0])).max(0.0) / (part[1] - part[0]);
                    let own = share * f64::from(ball.peak);
                    depth += own;
                    color = [0, 1, 2].map(|c| color[c] + own * f64::from(ball.color[c]));
                }
                (depth, color.map(|sum| sum / f64::max(depth, 1e-300)))
            };
            let slices = (0..SLICES).map(|i| content(near + i as f64 * step, near + (i + 1) as f64 * step));
            let (truth, mixed) = (light(slices), light(std::iter::once(content(near, far))));
            let off = truth.iter().zip(mixed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let bound = f64::from(local.lost);
            assert!(off <= bound * 1.0001 + 1e-6, "round {round}: {off} is more than {bound}");
            if bound > 0.0 {
                nearest = nearest.min(bound / off.max(1e-9));
            }
        }
        assert!(nearest < 1.5, "the bound is {nearest} times the error at least");
    }
}
