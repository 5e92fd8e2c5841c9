//! One ray: chords, the sweep along them, adaptive quadrature where colours mix, and what is known of the error.

use super::medium::Medium;
use super::rule::{NODES, RULE, Rule, Values};
use super::tree::Ball;
use super::{Radiance, TARGET};
use crate::scene::Rgb;
use glam::DVec3;

/// A ray from the eye, in eye space; a point on it is its depth times `direction`.
pub(super) struct Ray {
    /// Direction with z = -1.
    pub direction: DVec3,
    /// Depths between which the gas counts: the near plane, and the opaque surface or infinity.
    pub depths: [f64; 2],
    /// What the ray sees at its end, linear light.
    pub end: Rgb,
    /// Range of all colours of the scene, which the error is measured against.
    pub range: f64,
}

/// Units in the last place that a position in eye space may be off by, relative to its distance from the eye: rotation,
/// ray and cross product.
const POSITION_ULPS: f64 = 16.0;

/// The same of an optical depth: segment integral, strength, sum.
const DEPTH_ULPS: f64 = 16.0;

/// Optical depth that one panel may span. Beyond, exp(-s) could fall between the nodes unseen.
const THICKEST_PANEL: f64 = 3.0;

/// Halvings of an interval: no depth in f64 is halved more often.
const DEEPEST: u32 = 50;

/// Panels per ray beside a few for every interval, so that no scene takes for ever; the bound then says what is missing.
const PANELS: usize = 20_000;

/// The target of a mean depth, relative to the gas' extent.
const DEPTH_TARGET: f64 = 1e-8;

/// A chord: the part of a ball that the ray passes through between its ends.
struct Chord<'a> {
    medium: &'a Medium<'a>,
    color: Rgb,
    strength: f64,
    /// Distance of the ray from the centre, in radii.
    b: f64,
    /// Depth of the ray's point nearest the centre.
    closest: f64,
    /// Radii per unit of depth.
    scale: f64,
    /// First and last depth.
    ends: [f64; 2],
    /// Where it starts, in radii from the closest point; exactly the rim unless the near plane cuts it off.
    from: f64,
    /// Optical depth of all of it, from the closed form.
    whole: f64,
    /// Optical depth from its start to the depth `at`.
    part: f64,
    at: f64,
    /// Bound of the error of `whole` and `part`.
    doubt: f64,
}

impl<'a> Chord<'a> {
    /// The chord of a ball, or none where the ray misses it; and the bound of the error of its optical depth.
    fn new(ball: &Ball, media: &'a [Medium<'a>], ray: &Ray, length: f64) -> (Option<Self>, f64) {
        let b = ball.center.cross(ray.direction).length() / (length * ball.radius);
        let delta = POSITION_ULPS * f64::EPSILON * (ball.center.length() / ball.radius + 1.0);
        if b >= 1.0 + delta {
            return (None, 0.0);
        }
        let medium = &media[ball.set as usize];
        let closest = ball.center.dot(ray.direction) / (length * length);
        let scale = length / ball.radius;
        let half = ((1.0 - b) * (1.0 + b)).max(0.0).sqrt();
        let rim = [closest - half / scale, closest + half / scale];
        let [near, far] = ray.depths;
        // A chord that ends where the ray begins may reach a little farther.
        let slack = delta / scale;
        if rim[1] + slack <= near || rim[0] - slack >= far {
            return (None, 0.0);
        }
        let from = if rim[0] < near { (near - closest) * scale } else { -half };
        let to = if rim[1] > far { (far - closest) * scale } else { half };
        let ends = [rim[0].max(near), rim[1].min(far)];
        let whole = ball.strength * medium.kernel.segment(b, from, to);
        let doubt = ball.strength * medium.uncertainty(b, delta) + DEPTH_ULPS * f64::EPSILON * whole;
        let chord = Self {
            medium,
            color: ball.color,
            strength: ball.strength,
            b,
            closest,
            scale,
            ends,
            from,
            whole,
            part: 0.0,
            at: ends[0],
            doubt,
        };
        ((whole > 0.0 && ends[0] < ends[1]).then_some(chord), doubt)
    }

    /// Brings `part` to the depth `at`.
    fn reach(&mut self, at: f64) {
        if self.at != at {
            self.part = self.strength * self.medium.kernel.segment(self.b, self.from, (at - self.closest) * self.scale);
            self.at = at;
        }
    }
}

/// From the size of the highest Legendre coefficients to a bound of the error of the integral. The rule is exact to twice
/// their degree, so that where coefficients fall by a factor from degree to degree the error falls as their square; the
/// power of 3/2 with a factor leaves room. What falls differently (an edge that escaped the cuts) shows in the
/// difference to closed forms, which is always added in full.
fn sharpened(estimate: f64, size: f64) -> f64 {
    if size > 0.0 { estimate * (10.0 * (estimate / size).sqrt()).min(1.0) } else { estimate }
}

/// What happens at a depth, in the order in which it does.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    End,
    Kink,
    Start,
}

/// A sum with what rounding took from it (Neumaier 1974): 10^5 terms without drift.
#[derive(Clone, Copy, Default)]
struct Sum {
    sum: f64,
    rest: f64,
}

impl Sum {
    fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.rest += if self.sum.abs() >= term.abs() { (self.sum - sum) + term } else { (term - sum) + self.sum };
        self.sum = sum;
    }

    fn value(self) -> f64 {
        self.sum + self.rest
    }
}

/// The state of a ray; kept from ray to ray for its memory.
pub(super) struct Integrator<'a> {
    media: &'a [Medium<'a>],
    rule: &'static Rule,
    chords: Vec<Chord<'a>>,
    events: Vec<(f64, Event, u32)>,
    /// Chords around the current depth.
    active: Vec<u32>,
    /// Optical depth of each of them over a panel.
    shares: Vec<f64>,
    /// Optical depth of all chords that have ended.
    ended: Sum,
    light: [Sum; 3],
    /// A stretch of gas of one colour that is not yet in `light`: its colour and the transmittance at its start.
    pending: Option<(Rgb, f64)>,
    /// The last transmittance computed, which no later one exceeds.
    through: f64,
    /// Bound of the error of quadrature, and of rounding.
    quadrature: f64,
    rounding: f64,
    /// Absolute error allowed to the ray, and what the whole of its gas extends over.
    target: f64,
    extent: f64,
    /// Panels that may still be computed.
    panels: usize,
    /// Integral of depth over -dT, where it is wanted.
    depth: Option<Sum>,
}

impl<'a> Integrator<'a> {
    pub(super) fn new(media: &'a [Medium<'a>]) -> Self {
        Self {
            media,
            rule: &RULE,
            chords: Vec::new(),
            events: Vec::new(),
            active: Vec::new(),
            shares: Vec::new(),
            ended: Sum::default(),
            light: [Sum::default(); 3],
            pending: None,
            through: 1.0,
            quadrature: 0.0,
            rounding: 0.0,
            target: 0.0,
            extent: 0.0,
            panels: 0,
            depth: None,
        }
    }

    /// Number of chords of the last ray.
    pub(super) fn chords(&self) -> usize {
        self.chords.len()
    }

    /// What the ray sees through the balls that it may meet. The transmittance is that up to the ray's end.
    pub(super) fn radiance(&mut self, balls: &[Ball], ray: &Ray) -> Radiance {
        let (optical, [doubt, missed]) = self.cut(balls, ray);
        let through = (-optical).exp();
        // What is off by so much in the optical depth is off by this much in the transmittance.
        let less = (optical - doubt - missed).max(0.0);
        let through_error = (-less).exp() * -(less - optical).exp_m1() + 4.0 * f64::EPSILON * through;
        let missed = missed.min(1.0) * ray.range;
        let end = ray.end.map(f64::from);
        let Some(first) = self.chords.first().map(|chord| chord.color) else {
            return Radiance { color: end, transmittance: through, error: missed.max(through_error) };
        };
        if self.chords.iter().all(|chord| chord.color == first) {
            let cover = -(-optical).exp_m1();
            let color = first.map(f64::from);
            let differ = |c: usize| {
                let largest = color[c].abs().max(end[c].abs());
                (color[c] - end[c]).abs() * through_error + 4.0 * f64::EPSILON * largest
            };
            let error = missed + (0..3).map(differ).fold(0.0, f64::max);
            return Radiance {
                color: std::array::from_fn(|c| color[c] * cover + end[c] * through),
                transmittance: through,
                error: error.max(through_error),
            };
        }
        self.depth = None;
        self.sweep(ray, through);
        let bright = self
            .chords
            .iter()
            .flat_map(|chord| chord.color)
            .chain(ray.end)
            .fold(0.0, |a, v| f64::max(a, v.abs().into()));
        // Sums of at most this many terms, each rounded a few times, that are compensated: what is left is the terms' own.
        let rounding = 2.0 * bright * (self.rounding + through_error + 16.0 * f64::EPSILON);
        Radiance {
            color: std::array::from_fn(|c| self.light[c].value() + end[c] * through),
            transmittance: through,
            error: ((self.quadrature + rounding).min(2.0 * bright) + missed).max(through_error),
        }
    }

    /// Mean depth of what the ray sees, each depth weighted by what comes from there; the end counts where it is a
    /// surface. Infinite where the ray sees nothing but the background.
    pub(super) fn mean_depth(&mut self, balls: &[Ball], ray: &Ray) -> f64 {
        let (optical, _) = self.cut(balls, ray);
        let through = (-optical).exp();
        self.depth = Some(Sum::default());
        self.sweep(ray, through);
        let mut sum = self.depth.take().map_or(0.0, Sum::value);
        let mut seen = -(-optical).exp_m1();
        if ray.depths[1].is_finite() {
            sum += ray.depths[1] * through;
            seen = 1.0;
        }
        if seen > 0.0 { sum / seen } else { f64::INFINITY }
    }

    /// Finds the chords; gives the optical depth of them all and bounds of its error: of what was found, and of balls that
    /// may have been missed by rounding.
    fn cut(&mut self, balls: &[Ball], ray: &Ray) -> (f64, [f64; 2]) {
        self.chords.clear();
        let length = ray.direction.length();
        let (mut optical, mut doubts) = (Sum::default(), [0.0; 2]);
        for ball in balls {
            let (chord, doubt) = Chord::new(ball, self.media, ray, length);
            if let Some(chord) = chord {
                optical.add(chord.whole);
                self.chords.push(chord);
                doubts[0] += doubt;
            } else {
                doubts[1] += doubt;
            }
        }
        (optical.value(), doubts)
    }

    /// Goes along the ray from kink to kink with the chords that are around.
    fn sweep(&mut self, ray: &Ray, through: f64) {
        self.active.clear();
        (self.ended, self.light, self.pending) = (Sum::default(), [Sum::default(); 3], None);
        (self.through, self.quadrature, self.rounding) = (1.0, 0.0, 0.0);
        self.target = TARGET * ray.range;
        self.events.clear();
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY];
        for (chord, number) in self.chords.iter().zip(0..) {
            let [start, end] = chord.ends;
            extent = [extent[0].min(start), extent[1].max(end)];
            self.events.extend([(start, Event::Start, number), (end, Event::End, number)]);
            chord.medium.knots(chord.b, |u| {
                let at = chord.closest + u / chord.scale;
                if at > start && at < end {
                    self.events.push((at, Event::Kink, number));
                }
            });
        }
        self.extent = extent[1] - extent[0];
        self.events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then_with(|| (a.1, a.2).cmp(&(b.1, b.2))));
        self.panels = PANELS + 8 * self.events.len();
        let mut here = extent[0];
        let events = std::mem::take(&mut self.events);
        for &(at, event, number) in &events {
            if at > here && !self.active.is_empty() {
                self.interval(here, at);
                // Nothing behind can add more than this.
                let most = self.through * ray.range;
                if most <= 0.01 * self.target && self.depth.is_none() {
                    self.quadrature += most;
                    break;
                }
            }
            here = here.max(at);
            let chord = &self.chords[number as usize];
            match event {
                Event::Start => {
                    self.rounding += self.through * chord.doubt.min(1.0);
                    self.active.push(number);
                }
                Event::Kink => {}
                Event::End => {
                    self.active.retain(|&other| other != number);
                    if chord.at == at {
                        // The parts should have summed to this.
                        self.rounding += self.through * (chord.part - chord.whole).abs().min(1.0);
                    }
                    self.ended.add(chord.whole);
                }
            }
        }
        self.flush(through);
        self.events = events;
    }

    /// Optical depth from the eye to a depth with these chords around it.
    fn reach(&mut self, at: f64) -> f64 {
        let mut sum = self.ended;
        for &number in &self.active {
            let chord = &mut self.chords[number as usize];
            chord.reach(at);
            sum.add(chord.part);
        }
        sum.value()
    }

    /// Adds the stretch of one colour that ends where the transmittance is this.
    fn flush(&mut self, through: f64) {
        if let Some((color, before)) = self.pending.take() {
            for (light, color) in self.light.iter_mut().zip(color) {
                light.add(f64::from(color) * (before - through));
            }
        }
    }

    /// The gas between two kinks.
    fn interval(&mut self, a: f64, b: f64) {
        let color = self.chords[self.active[0] as usize].color;
        let one = self.active.iter().all(|&number| self.chords[number as usize].color == color);
        if one && self.depth.is_none() && self.pending.is_some_and(|(pending, _)| pending == color) {
            return;
        }
        let optical = self.reach(a);
        self.through = (-optical).exp();
        self.flush(self.through);
        if one && self.depth.is_none() {
            self.pending = Some((color, self.through));
            return;
        }
        let optical = self.panel(a, b, optical, 0);
        self.through = (-optical).exp();
        for &number in &self.active {
            self.chords[number as usize].at = b;
        }
    }

    /// Integrates from `a`, which lies behind the optical depth `before`, to `b`; gives the optical depth at `b`.
    fn panel(&mut self, a: f64, b: f64, before: f64, level: u32) -> f64 {
        let rule = self.rule;
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        // Optical depth and light per unit of x in [-1, 1] at the nodes, the gas' own optical depth and light from the
        // closed forms, and the ranges of the colours.
        let mut sigma = [0.0; NODES];
        let mut glow = [[0.0; NODES]; 3];
        let (mut optical, mut total) = (0.0, [0.0; 3]);
        let mut colors = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        self.shares.clear();
        for &number in &self.active {
            let chord = &self.chords[number as usize];
            let (u, eta) = ((middle - chord.closest) * chord.scale, half * chord.scale);
            let values: Values =
                std::array::from_fn(|j| chord.strength * eta * chord.medium.density(chord.b, u + eta * rule.x[j]));
            let share = if 2.0 * eta <= chord.medium.exact_stretch(chord.b, (u.abs() - eta).max(0.0)) {
                rule.integral(&values)
            } else {
                chord.strength * chord.medium.kernel.segment(chord.b, (u - eta).max(chord.from), u + eta)
            };
            self.shares.push(share);
            optical += share;
            for j in 0..NODES {
                sigma[j] += values[j];
            }
            for c in 0..3 {
                let color = f64::from(chord.color[c]);
                colors[c] = [colors[c][0].min(color), colors[c][1].max(color)];
                total[c] += color * share;
                for j in 0..NODES {
                    glow[c][j] += color * values[j];
                }
            }
        }
        self.panels = self.panels.saturating_sub(1);
        let last = level >= DEEPEST || self.panels == 0 || middle <= a || middle >= b;
        let through = (-before).exp();
        let absorbed = -(-optical).exp_m1();
        let spread = colors.iter().map(|[low, high]| high - low).fold(0.0, f64::max);

        // s from the polynomial through sigma. It is off by no more than the integral of what the polynomial leaves out
        // (that of P_n is at most 2 / (2n + 1)), and at the end by what the closed form says.
        let s = rule.running(&sigma);
        let s_error = sharpened(2.0 * rule.tail(&sigma) / (2 * NODES - 1) as f64, optical)
            + (rule.integral(&sigma) - optical).abs();
        let fade = s.map(|s| (-s).exp());
        // Mean colour of the gas; what remains of the light is the integral of (glow - mean sigma) exp(-s). Any constant
        // may be taken from exp(-s), since the first factor integrates to 0.
        let mean = total.map(|total| if optical > 0.0 { total / optical } else { 0.0 });
        let reference = (-0.5 * optical).exp();
        let mut remainder = [0.0; 3];
        let mut error = 0.0;
        for c in 0..3 {
            let excess: Values = std::array::from_fn(|j| glow[c][j] - mean[c] * sigma[j]);
            let values: Values = std::array::from_fn(|j| excess[j] * (fade[j] - reference));
            remainder[c] = rule.integral(&values);
            let size = (0..NODES).map(|j| rule.weight[j] * excess[j].abs()).sum::<f64>();
            let whole = (0..NODES).map(|j| rule.weight[j] * values[j].abs()).sum::<f64>();
            let off = sharpened(2.0 * rule.tail(&values), whole)
                + size * s_error
                + rule.integral(&excess).abs() * (1.0 - reference);
            error = f64::max(error, off);
        }
        // Whatever the nodes say, the light lies between that of the colours there are.
        let most = spread * absorbed;
        if error.is_nan() || error >= most || optical > THICKEST_PANEL {
            error = most;
            remainder = [0.0; 3];
        }
        let allowed = 0.5 * self.target * (through * absorbed + (b - a) / self.extent);
        let mut good = through * error <= allowed;
        let mut depth = 0.0;
        if self.depth.is_some() {
            // Integral of the depth over -dT from that of the transmittance, by parts.
            let length = half * rule.integral(&fade);
            let off = if optical > THICKEST_PANEL { b - a } else { (b - a) * (rule.tail(&fade) + s_error) };
            let off = through * off.min((b - a) * absorbed);
            depth = through * (a * absorbed + length - (b - a) * (1.0 - absorbed));
            good &= off <= DEPTH_TARGET * (through * absorbed * self.extent + (b - a));
        }
        if !good && !last {
            let optical = self.panel(a, middle, before, level + 1);
            return self.panel(middle, b, optical, level + 1);
        }
        for (&number, share) in self.active.iter().zip(&self.shares) {
            self.chords[number as usize].part += share;
        }
        for c in 0..3 {
            self.light[c].add(through * (mean[c] * absorbed + remainder[c]));
        }
        self.quadrature += through * error;
        if let Some(sum) = &mut self.depth {
            sum.add(depth);
        }
        before + optical
    }
}
