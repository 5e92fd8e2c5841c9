//! Planes of nodes that are kept from frame to frame: new memory costs more than most of what is done to it.

use crate::picture::Plane;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Planes that wait for their next use.
#[derive(Default)]
pub struct Spare {
    /// Those of the frames before, and those that this frame has given back.
    planes: Mutex<[Vec<Plane<f32>>; 2]>,
}

impl Spare {
    /// A plane of any numbers, but for zeros in the spans of its rows.
    pub fn plane(&self, width: usize, spans: &[Range<usize>]) -> Plane<f32> {
        let len = width * spans.len();
        let mut planes = self.planes.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |planes: &Vec<Plane<f32>>| planes.iter().position(|plane| plane.len() == len);
        let known = planes.iter_mut().rev().find_map(|planes| fits(planes).map(|place| planes.swap_remove(place)));
        drop(planes);
        // New memory is zeros, and stays untouched where nothing is written.
        known.map_or_else(
            || Plane::new(len),
            |mut plane| {
                let rows = plane.chunks_exact_mut(width).zip(spans);
                rows.for_each(|(row, span)| row[span.clone()].fill(0.0));
                plane
            },
        )
    }

    /// Takes planes back.
    pub fn give(&self, planes: impl IntoIterator<Item = Plane<f32>>) {
        self.planes.lock().unwrap_or_else(PoisonError::into_inner)[1].extend(planes);
    }

    /// Ends a frame: what it had no use for is given up.
    pub fn finish(&mut self) {
        let [before, now] = self.planes.get_mut().unwrap_or_else(PoisonError::into_inner);
        *before = std::mem::take(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_come_back_with_zeros_where_they_are_asked_for() {
        let mut spare = Spare::default();
        let spans = [0..0, 1..3, 2..4];
        let mut plane = spare.plane(4, &spans);
        assert_eq!(plane[..], [0.0; 12]);
        plane.fill(7.0);
        let memory = plane.as_ptr();
        spare.give([plane, Plane::new(5)]);
        spare.finish();
        let plane = spare.plane(4, &spans);
        assert_eq!(plane.as_ptr(), memory);
        assert_eq!(plane[..], [7.0, 7.0, 7.0, 7.0, 7.0, 0.0, 0.0, 7.0, 7.0, 7.0, 0.0, 0.0]);
        // The other one was not asked for; a frame later it is gone, and what is given back in a frame may be asked for in it.
        spare.give([plane]);
        spare.finish();
        assert_eq!(spare.planes.get_mut().unwrap().each_ref().map(Vec::len), [1, 0]);
        let plane = spare.plane(4, &spans);
        spare.give([plane]);
        assert_eq!(spare.plane(4, &spans).as_ptr(), memory);
    }
}
