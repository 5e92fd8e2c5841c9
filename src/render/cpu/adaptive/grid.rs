//! Grids of nodes over a picture.

use super::MARGIN;
use crate::scene::View;
use glam::DVec2;

/// A grid of nodes over the picture of a view.
#[derive(Clone, Copy)]
pub struct Grid {
    /// Pixels from node to node.
    pub spacing: usize,
    /// Columns and rows of nodes.
    pub size: [usize; 2],
    /// 1 / spacing: exact, since distances are powers of two.
    pub inverse: f64,
    /// Picture coordinates of the node (MARGIN, MARGIN); at most 0.
    pub origin: [f64; 2],
}

impl Grid {
    /// Over the picture of a view.
    pub fn new(view: &View, spacing: usize) -> Self {
        let picture = view.size.map(|n| n as usize);
        let cells = picture.map(|n| n.div_ceil(spacing));
        Self {
            spacing,
            inverse: 1.0 / spacing as f64,
            size: cells.map(|n| n + 2 * MARGIN + 1),
            // Centred, so that the nodes are the pixels of a view with the same axis.
            origin: [0, 1].map(|axis| (picture[axis] as f64 - (cells[axis] * spacing) as f64) / 2.0),
        }
    }

    /// The view whose pixels are the nodes.
    pub fn view(&self, view: &View) -> View {
        let [x, y] = [0, 1].map(|axis| (self.size[axis] * self.spacing) as f64 / f64::from(view.size[axis]));
        View { half_extent: view.half_extent * DVec2::new(x, y), size: self.size.map(|n| n as u32), ..view.clone() }
    }

    /// The node before a pixel's centre along an axis.
    pub fn cell(&self, axis: usize, pixel: usize) -> usize {
        ((pixel as f64 + 0.5 - self.origin[axis]) * self.inverse) as usize + MARGIN
    }

    /// The nodes within an interval of picture coordinates along an axis, grown by a hair; none without one.
    pub fn covered(&self, axis: usize, interval: [f64; 2]) -> Option<[usize; 2]> {
        let count = self.size[axis];
        let (inverse, origin) = (self.inverse, self.origin[axis]);
        // Conversions truncate, and make 0 of what is negative.
        let first = ((interval[0] - origin) * inverse + (MARGIN as f64 + 1.0 - 1e-3)) as usize;
        let end = (((interval[1] - origin) * inverse + (MARGIN as f64 + 1.0 + 1e-3)) as usize).min(count);
        (first < end).then(|| [first, end - 1])
    }

    /// The first pixel whose centre is not before a node.
    pub fn first_pixel(&self, axis: usize, node: usize) -> isize {
        (node as isize - MARGIN as isize) * self.spacing as isize + (self.origin[axis] - 0.5).ceil() as isize
    }

    /// The nodes that the pixels from `first` to `last` are compared by or made of, along an axis.
    pub fn nodes(&self, axis: usize, first: usize, last: usize) -> [usize; 2] {
        [self.cell(axis, first).saturating_sub(3), (self.cell(axis, last) + 4).min(self.size[axis] - 1)]
    }
}
