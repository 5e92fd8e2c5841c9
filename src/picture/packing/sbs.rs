//! `sbs`: side by side.

use std::borrow::Cow;

use super::{Options, Packed, check_pair};
use crate::error::Result;
use crate::picture::{Picture, Plane};

/// The left picture on the left half, the right one on the right, each at full width. Alpha and error are kept where
/// both views have them; disparity is not.
pub(super) fn pack<'a>(left: &'a Picture, right: &'a Picture, _: &Options) -> Result<Packed<'a>> {
    check_pair(left, right)?;
    let [width, height] = left.size;
    let join = |l: &[f32], r: &[f32]| -> Plane<f32> {
        let width = width as usize;
        let mut out = Plane::new(2 * l.len());
        let rows = l.chunks_exact(width).zip(r.chunks_exact(width));
        for (out, (l, r)) in out.chunks_exact_mut(2 * width).zip(rows) {
            out[..width].copy_from_slice(l);
            out[width..].copy_from_slice(r);
        }
        out
    };
    let join_both = |l: &Option<Plane<f32>>, r: &Option<Plane<f32>>| Some(join(l.as_ref()?, r.as_ref()?));
    let picture = Picture {
        size: [2 * width, height],
        color: [0, 1, 2].map(|c| join(&left.color[c], &right.color[c])),
        alpha: join_both(&left.alpha, &right.alpha),
        error: join_both(&left.error, &right.error),
        // It points from picture to picture, not within one.
        disparity: None,
    };
    Ok(Packed { picture: Cow::Owned(picture), clipped: 0 })
}
