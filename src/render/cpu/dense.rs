//! The dense middles of balls first, where gas of one colour becomes opaque.
//!
//! What is in front of what is of no account to gas of one colour: a pixel is done as soon as any of its fragments leave next to
//! nothing of the light, and the fewer those are the better. Through its middle a ball is two to three times as deep as in the mean of
//! its disc. So the middles of all balls of a tile are drawn first, until its blocks are done, and what is left of them only where
//! they are not: half of the fragments where gas is opaque. A fragment is drawn once or not at all, and a block is done by the same
//! bound as with whole balls.

use super::footprint::GAUSSIAN_MEAN;
use super::rim::Rim;
use super::splat::{Alignment, Bounds, Item, Lens};

/// Radius of the middle, as a share of the ball's.
const CORE: f64 = 0.6;

/// A tile is taken for opaque where the mean depth of its gas is so many times that which hides what is behind.
const DEEP: f32 = 1.7;

/// Mean of a Gaussian's footprint over the box around its disc; other kernels are near enough.
const MEAN_FOOTPRINT: f32 = (GAUSSIAN_MEAN * std::f64::consts::FRAC_PI_4) as f32;

/// Which blocks of a particle are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of them.
    Whole,
    /// Those that its core touches.
    Core,
    /// The others.
    Rest,
}

/// An outline within a tile.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    /// It.
    pub rim: Rim,
    /// First and last block of the tile that it may touch, along x and y.
    pub blocks: [[usize; 2]; 2],
}

/// The pixels of a picture that the core of a particle with such bounds may cover: those but a fifth on every side, where they do
/// not end with the picture.
#[inline(always)]
pub fn bounds(bounds: &Bounds, size: [u32; 2]) -> Bounds {
    let shrunk = |[first, last]: [u32; 2], size: u32| {
        let margin = (last - first) / 5;
        [first + if first > 0 { margin } else { 0 }, last - if last + 1 < size { margin } else { 0 }]
    };
    Bounds { x: shrunk(bounds.x, size[0]), y: shrunk(bounds.y, size[1]) }
}

/// The outline of the core of a particle with such bounds; `inner`: those of its core.
#[inline(always)]
pub fn rim<A: Alignment>(item: &Item<A::Splat>, lens: &Lens, (bounds, inner): (&Bounds, &Bounds)) -> Rim {
    let [width, height] = lens.view.size;
    let is_whole = bounds.x[0] > 0 && bounds.y[0] > 0 && bounds.x[1] + 1 < width && bounds.y[1] + 1 < height;
    // Which pixels it has is of no account, as long as they are always the same: no outline is found where it is told by bounds.
    if is_whole { Rim::inscribed(inner) } else { A::rim(&item.splat, lens, false).shrunk(CORE) }
}

/// The summed product of depth and pixels of bounds that makes so many pixels opaque by cores, if it is spread evenly; `opaque`: the
/// depth at which a pixel is.
pub fn goal(pixels: usize, opaque: f32) -> f32 {
    DEEP * opaque * pixels as f32 / MEAN_FOOTPRINT
}

/// How many of the first particles of a tile, `area` pixels large, are likely to make it opaque by their cores; `None` if all are not.
/// `amplitudes` are theirs, in powers of two, with the pixels of the tile that their bounds hold; `opaque` as in [`goal`].
#[inline(always)]
pub fn enough(mut amplitudes: impl Iterator<Item = (f32, usize)>, area: usize, opaque: f32) -> Option<usize> {
    let goal = goal(area, opaque);
    let mut sum = 0.0;
    // Nothing is, where it is infinite.
    let last = amplitudes.position(|(amplitude, pixels)| {
        sum += amplitude * pixels as f32;
        sum >= goal && goal.is_finite()
    })?;
    Some(last + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_are_enough_as_hide_what_is_behind() {
        let asked = std::cell::Cell::new(0);
        let list = |count: usize| {
            (0..count).map(|_| {
                asked.set(asked.get() + 1);
                (1.0, 512)
            })
        };
        // Half a tile each, an eighth of a power of two or so: 8 powers ask for 160 of them.
        let enough_of = |count| enough(list(count), 1024, 8.0);
        let found = enough_of(1000).unwrap();
        assert_eq!(found, (DEEP * 8.0 * 2.0 / MEAN_FOOTPRINT).ceil() as usize);
        // No more are looked at.
        assert_eq!(asked.get(), found);
        assert_eq!(enough_of(found - 1), None);
        // Nothing hides what is behind where nothing may be lost.
        assert_eq!(enough(list(1000), 1024, f32::INFINITY), None);
        assert_eq!(enough(list(1000), 1024, f32::NAN), None);
    }

    #[test]
    fn cores_end_with_the_picture() {
        let bounds = |x, y| bounds(&Bounds { x, y }, [100, 80]);
        assert_eq!(bounds([10, 60], [20, 70]), Bounds { x: [20, 50], y: [30, 60] });
        assert_eq!(bounds([0, 50], [29, 79]), Bounds { x: [0, 40], y: [39, 79] });
        assert_eq!(bounds([7, 7], [0, 79]), Bounds { x: [7, 7], y: [0, 79] });
    }
}
