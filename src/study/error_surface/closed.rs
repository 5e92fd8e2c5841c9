//! The closed forms that follow from the definitions, in f64 and in f32.
//!
//! With X = C_x/s, l = L/s, q = a X + b C_y d/(s L), and the differences of nearly equal lengths rewritten, g = s - d =
//! C_x^2/(s + d) and l - 1 = C_y^2/(s (L + s)), the error of *viewplane* against *viewpoint* is, with W = d - r q the depth
//! of the viewpoint billboard's point,
//! - e_x = -N r a [g + r q] / (d W);
//! - e_y = -N r [a C_y X + b d (l - 1) + r b q] / (d W).
//!
//! Proof of the first: e_x d W / N = (C_x + r a)(d - r q) - (C_x + r a d/s - r b C_x C_y/(s L)) d, in which C_x q + (a d/s -
//! b C_x C_y/(s L)) d = a s; what is left is r a [d - s - r q]. The second goes alike with C_y q + (b s/L) d = a C_y X + b d l.
//! For E (a = 1, b = 0): e_x = -N r C_x [s C_x/(s + d) + r] / (d (d s - r C_x)), e_y = -N r C_x C_y / (d (d s - r C_x)).
//!
//! *perspective* shows what a viewpoint billboard shows at k times the offset, k = L/m, m = sqrt(L^2 - rho^2), rho = r
//! sqrt(a^2 + b^2) (sin against tan). With h = k - 1 = rho^2/(m (L + m)) and W' = d - k r q:
//! - viewplane against it: e_x = -N r a [g + s h + k r q] / (d W'), e_y = -N r [k a C_y X + b d (l - 1 + l h) + k r b q] /
//!   (d W');
//! - viewpoint against it: e_x = -N r h a s / (W W'), e_y = -N r h [a C_y X + b d l] / (W W').
//!
//! The *parallax* error is e(x1) - e(x0) = -I times the divided difference of e between where the eyes see the centre, x0 =
//! C_x + I/2 and x1 = C_x - I/2, so that nothing cancels for a small interocular distance. For viewplane, where e is -N r/d
//! times a quotient u/W', (u/W')' = [u' + (u0/W'0) (k r q)'] / W'1, in which what would cancel is taken together; with M =
//! 1/(s L) that leaves for e' over -N r / (W'0 W'1)
//! - x: a [(k s)' W'0 + r (k q)' k0 s0] / d;
//! - y: a (k X)' [C_y + r b k0 s0/L0] + b (k l)' W'0 + r b C_y (k M)' k0 [a C_y X0 + b d l0].

use super::slope::Slope;
use super::{Alignment, Component, Quantity, Setting};
use glam::{DVec3, Vec3};
use num_traits::Float;

/// The error at a billboard with its centre at `c`, camera space of the cyclopean eye, in units of the view plane; `None`
/// at and past a pole: where the centre or a projected point is not in front of an eye, or an eye is inside the ball on
/// whose surface `perspective` has its point.
pub fn error(setting: &Setting, c: DVec3) -> Option<f64> {
    evaluate(setting, c.to_array())
}

/// [`error`] in single precision throughout.
pub fn error_f32(setting: &Setting, c: Vec3) -> Option<f32> {
    evaluate(setting, c.to_array())
}

/// The formulas stand once for both precisions: what they are for is that no step of them loses more than rounding.
fn evaluate<T: Float>(setting: &Setting, c: [T; 3]) -> Option<T> {
    let [first, second] = setting.alignments;
    let case = Case::new(setting, c, first.max(second) == Alignment::Perspective);
    let error = match (first.min(second), first == second) {
        (Alignment::Viewplane, false) => match setting.quantity {
            Quantity::Projection => case.projection_of_viewplane(setting.component),
            Quantity::Parallax => case.parallax_of_viewplane(setting.component),
        },
        (Alignment::Viewpoint, false) => match setting.quantity {
            Quantity::Projection => case.projection_of_viewpoint(setting.component),
            Quantity::Parallax => case.parallax_of_viewpoint(setting.component),
        },
        (Alignment::Viewplane | Alignment::Viewpoint, true) | (Alignment::Perspective, _) => {
            (case.d > T::zero()).then(T::zero)
        }
    };
    error.map(|e| if first > second { -e } else { e })
}

/// A billboard and its point, in the precision of the answer.
struct Case<T> {
    a: T,
    b: T,
    r: T,
    /// Radius of the ball on whose surface `perspective` has its point; absent where that plays no part.
    rho: Option<T>,
    near: T,
    interocular: T,
    x: T,
    y: T,
    d: T,
}

/// What the formulas are made of, for one eye.
struct Parts<T> {
    /// s, the distance of the centre seen from above.
    s: T,
    /// L, the distance of the centre.
    length: T,
    /// X.
    sine: T,
    /// q.
    q: T,
    /// k.
    k: T,
    /// h.
    h: T,
    /// m; L where `perspective` plays no part.
    m: T,
}

impl<T: Float> Case<T> {
    fn new(setting: &Setting, [x, y, z]: [T; 3], perspective: bool) -> Self {
        let of = |value: f64| T::from(value).unwrap_or_else(T::nan);
        let (a, b, r) = (of(setting.point.a), of(setting.point.b), of(setting.radius));
        let rho = perspective.then(|| r * a.hypot(b));
        Self { a, b, r, rho, near: of(setting.near), interocular: of(setting.interocular), x, y, d: -z }
    }

    /// The parts for an eye that sees the centre at `x`; `None` where it is behind the eye or the eye is inside the ball.
    fn parts(&self, x: T) -> Option<Parts<T>> {
        let s = x.hypot(self.d);
        let length = s.hypot(self.y);
        let sine = x / s;
        let q = self.a * sine + self.b * (self.y / length) * (self.d / s);
        let one = T::one();
        let (m, k, h) = match self.rho {
            None => (length, one, T::zero()),
            Some(rho) => {
                let m = ((length - rho) * (length + rho)).sqrt();
                (m, length / m, (rho / m) * (rho / (length + m)))
            }
        };
        (self.d > T::zero() && m > T::zero()).then_some(Parts { s, length, sine, q, k, h, m })
    }

    /// Depth of the point at `k` times its offset on the viewpoint billboard; `None` unless it is in front.
    fn depth(&self, k: T, q: T) -> Option<T> {
        let depth = self.d - k * self.r * q;
        (depth > T::zero()).then_some(depth)
    }

    fn projection_of_viewplane(&self, component: Component) -> Option<T> {
        let &Self { a, b, r, x, y, d, .. } = self;
        let Parts { s, length, sine, q, k, h, .. } = self.parts(x)?;
        let depth = self.depth(k, q)?;
        let sum = match component {
            Component::X => a * (x * (x / (s + d)) + s * h + k * r * q),
            Component::Y => k * a * y * sine + b * d * ((y / s) * (y / (length + s)) + length / s * h) + k * r * b * q,
        };
        Some(-self.near * r * (sum / d / depth))
    }

    fn projection_of_viewpoint(&self, component: Component) -> Option<T> {
        let &Self { a, b, r, x, y, d, .. } = self;
        let Parts { s, length, sine, q, k, h, .. } = self.parts(x)?;
        let (depth, far_depth) = (self.depth(T::one(), q)?, self.depth(k, q)?);
        let sum = match component {
            Component::X => a * s,
            Component::Y => a * y * sine + b * d * (length / s),
        };
        Some(-self.near * r * h * (sum / depth / far_depth))
    }

    /// The parts as both eyes see them.
    fn both(&self) -> Option<Both<T>> {
        let half = self.interocular / (T::one() + T::one());
        let (x0, x1) = (self.x + half, self.x - half);
        let (p0, p1) = (self.parts(x0)?, self.parts(x1)?);
        // x1^2 - x0^2 over x1 - x0: x0 + x1, but exact.
        let sum = self.x + self.x;
        let slope = |at0, at1, slope| Slope { at0, at1, slope };
        let s = slope(p0.s, p1.s, sum / (p0.s + p1.s));
        let sine = slope(p0.sine, p1.sine, {
            if x0.min(x1) > T::zero() || x0.max(x1) < T::zero() {
                (self.d / p0.s) * (self.d / p1.s) * (sum / (x1 * p0.s + x0 * p1.s))
            } else if x0 == x1 {
                self.d / p0.s * (self.d / p1.s) / p0.s
            } else {
                // On both sides of the eye the sines add up.
                (p1.sine - p0.sine) / (x1 - x0)
            }
        });
        // 1/(s L): (s L)^2 is a polynomial of x^2, whose divided difference has no minus.
        let (sl0, sl1) = (p0.s * p0.length, p1.s * p1.length);
        let squares = p0.s * p0.s + p1.s * p1.s + self.y * self.y;
        let inverse = slope(sl0.recip(), sl1.recip(), -(sum / (sl0 + sl1)) * (squares / sl0) / sl1);
        let ratio = slope(
            p0.length / p0.s,
            p1.length / p1.s,
            -(self.y / p0.s) * (self.y / p1.s) * (sum / (p1.length * p0.s + p0.length * p1.s)),
        );
        let (k, h) = match self.rho {
            None => (Slope::constant(T::one()), Slope::constant(T::zero())),
            Some(rho) => {
                let k = -(rho / p0.m) * (rho / p1.m) * (sum / ((p0.k + p1.k) * p0.m * p1.m));
                (slope(p0.k, p1.k, k), slope(p0.h, p1.h, k))
            }
        };
        let q = slope(p0.q, p1.q, self.a * sine.slope + self.b * self.y * self.d * inverse.slope);
        let length = slope(p0.length, p1.length, sum / (p0.length + p1.length));
        Some(Both { s, length, sine, inverse, ratio, q, k, h })
    }

    fn parallax_of_viewplane(&self, component: Component) -> Option<T> {
        let &Self { a, b, r, y, d, .. } = self;
        let Both { s, length, sine, inverse, ratio, q, k, .. } = self.both()?;
        let (depth0, depth1) = (self.depth(k.at0, q.at0)?, self.depth(k.at1, q.at1)?);
        let sum = match component {
            Component::X => {
                let shift = (k * q).slope * (r / d) * k.at0 * s.at0;
                a * ((k * s).slope * (depth0 / d) + shift)
            }
            Component::Y => {
                a * (k * sine).slope * (y + b * r * (k.at0 * (s.at0 / length.at0)))
                    + b * (k * ratio).slope * depth0
                    + b * r * y * (k * inverse).slope * (k.at0 * (a * y * sine.at0 + b * d * ratio.at0))
            }
        };
        Some(self.interocular * self.near * r * (sum / depth0 / depth1))
    }

    fn parallax_of_viewpoint(&self, component: Component) -> Option<T> {
        let &Self { a, b, r, y, d, .. } = self;
        let Both { s, sine, ratio, q, k, h, .. } = self.both()?;
        self.depth(k.at0, q.at0).and(self.depth(k.at1, q.at1))?;
        self.depth(T::one(), q.at0).and(self.depth(T::one(), q.at1))?;
        let depth = Slope::constant(d) - q.times(r);
        let far_depth = Slope::constant(d) - (k * q).times(r);
        let sum = match component {
            Component::X => s.times(a),
            Component::Y => sine.times(a * y) + ratio.times(b * d),
        };
        let quotient = h * sum / depth / far_depth;
        Some(self.interocular * self.near * r * quotient.slope)
    }
}

/// [`Parts`] with their divided differences from the left eye (at0) to the right (at1).
struct Both<T> {
    s: Slope<T>,
    length: Slope<T>,
    sine: Slope<T>,
    /// 1/(s L).
    inverse: Slope<T>,
    /// l.
    ratio: Slope<T>,
    q: Slope<T>,
    k: Slope<T>,
    h: Slope<T>,
}
