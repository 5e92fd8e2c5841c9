//! Whether nodes are near enough to each other.

use super::rims;
use crate::render::cpu::simd::{Simd, WithSimd};
use crate::render::cpu::slab;
use crate::scene::{Kernel, Scene};
use std::ops::Range;

/// Density at the rim or at another step, as a share of the greatest, from which no grid follows a kernel.
const STEP: f64 = 0.05;

/// How far nodes are trusted with the particles of a set. Pictures of random balls (`analysis/auto/nodes.py`) tell what the spline of
/// [`super::enlarge`] is off, rims of densities that end by a step apart, as they are here ([`rims`]); tables are taken for as hard as
/// the hardest of the named kernels.
#[derive(Clone, Copy, Debug)]
pub struct Trust {
    /// Least radius of a particle in distances of nodes: less might slip through between them. Infinite if no grid will do.
    pub least_radius: f64,
    /// What may be lost from node to pixel, as a share of that by which nodes differ from what their neighbours make of them.
    pub loss: f64,
}

impl Trust {
    /// [`Trust::loss`] in Gaussians.
    pub const GAUSSIAN: f64 = 0.2;

    /// In a kernel.
    fn new(kernel: &Kernel) -> Self {
        // A smooth footprint as wide as 3.5 nodes comes nearer by the fourth power of the distance; kinks by its square root and more.
        let (least_radius, loss) = match kernel {
            Kernel::Gaussian => (3.5, Self::GAUSSIAN),
            Kernel::Beliaev => (4.0, 0.35),
            Kernel::Poly => (3.0, 0.55),
            Kernel::Linear | Kernel::Constant | Kernel::Table(_) => (3.0, 0.7),
        };
        let steep = rims::step(kernel) > STEP * rims::peak(kernel);
        // What matters of a profile is how wide it is.
        let least_radius = if steep { f64::INFINITY } else { least_radius / f64::from(slab::width(kernel)) };
        Self { least_radius, loss }
    }

    /// In the sets of a scene.
    pub fn of_sets(scene: &Scene) -> Vec<Self> {
        scene.particles.iter().map(|set| Self::new(&set.kernel)).collect()
    }
}

/// [`Trust::loss`] per unit of optical depth: what is steep about a footprint is steeper in the transmittance of dense gas.
const DENSE: f64 = 0.06;

/// Optical depth of which anything is seen where light has several colours.
const SEEN: f64 = 10.0;

/// [`Trust::loss`] where the nodes that have a say let so much through at the least.
pub fn share(loss: f64, through: f32, one: bool) -> f64 {
    let depth = -f64::from(through.clamp(f32::MIN_POSITIVE, 1.0)).ln();
    loss.max(DENSE * if one { depth } else { depth.min(SEEN) })
}

/// Compares nodes with what their neighbours of twice the distance make of them, by a cubic along both axes.
pub struct Misfit<'a> {
    /// Planes of nodes, row by row.
    pub planes: &'a [&'a [f32]],
    /// Nodes in a row.
    pub width: usize,
    /// Which of each row are asked.
    pub spans: &'a [Range<usize>],
    /// The largest difference over the planes is taken into this.
    pub out: &'a mut [f32],
}

impl WithSimd for Misfit<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let width = self.width;
        let rows = self.out.len() / width;
        let (near, far) = (s.splat(9.0 / 16.0), s.splat(1.0 / 16.0));
        for plane in self.planes {
            // Along x, then along y: distances in memory of one node.
            for (step, across, down) in [(1, 3..width.max(6) - 3, 0..rows), (width, 0..width, 3..rows.max(6) - 3)] {
                for y in down.clone() {
                    let span = &self.spans[y];
                    let across = across.start.max(span.start)..across.end.min(span.end);
                    if across.is_empty() {
                        continue;
                    }
                    let mut x = across.start;
                    while x < across.end {
                        // The last vector overlaps the one before it; short rows are filled up.
                        let at = if across.len() >= S::LANES { x.min(across.end - S::LANES) } else { x };
                        let first = y * width + at;
                        let load = |offset: isize| {
                            let from = first.wrapping_add_signed(offset * step as isize);
                            let mut lanes = [0.0f32; 16];
                            let count = S::LANES.min(across.end - at);
                            if count == S::LANES {
                                return s.load(&plane[from..]);
                            }
                            lanes[..count].copy_from_slice(&plane[from..from + count]);
                            s.load(&lanes)
                        };
                        let inner = s.mul(s.add(load(-1), load(1)), near);
                        let expected = s.neg_mul_add(s.add(load(-3), load(3)), far, inner);
                        let off = s.sub(load(0), expected);
                        let mut lanes = [0.0f32; 16];
                        s.store(s.max(off, s.sub(s.splat(0.0), off)), &mut lanes);
                        for (out, &lane) in self.out[first..].iter_mut().zip(&lanes[..S::LANES.min(across.end - at)]) {
                            *out = out.max(lane);
                        }
                        x += S::LANES;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dense_gas_is_trusted_less() {
        let thin = (-1.0f32).exp();
        assert_eq!([share(0.2, 1.0, true), share(0.2, thin, true), share(0.5, thin, false)], [0.2, 0.2, 0.5]);
        assert!((share(0.2, (-20.0f32).exp(), true) - 20.0 * DENSE).abs() < 1e-6);
        assert!((share(0.2, (-20.0f32).exp(), false) - SEEN * DENSE).abs() < 1e-6);
        // Nothing is let through, and what is no transmittance.
        assert!(share(0.2, 0.0, true).is_finite() && share(0.2, -1.0, true).is_finite());
    }

    #[test]
    fn steps_are_followed_by_no_grid() {
        let wall = Kernel::table(vec![0.0, 0.9, 1.0], vec![1.0, 1.0, 0.5]).unwrap();
        for (kernel, followed) in
            [(Kernel::Gaussian, true), (Kernel::Poly, true), (Kernel::Constant, false), (wall, false)]
        {
            assert_eq!(Trust::new(&kernel).least_radius.is_finite(), followed, "{}", kernel.name());
        }
    }

    #[test]
    fn narrow_profiles_need_larger_balls() {
        let core = Kernel::table(vec![0.0, 0.1, 1.0], vec![1.0, 0.0, 0.0]).unwrap();
        let wide = Kernel::table(vec![0.0, 1.0], vec![1.0, 0.0]).unwrap();
        assert!(Trust::new(&core).least_radius > 20.0);
        assert!((Trust::new(&wide).least_radius - Trust::new(&Kernel::Linear).least_radius).abs() < 1e-9);
    }
}
