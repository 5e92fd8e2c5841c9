//! `anaglyph`: red-cyan, by Dubois' projection.

use super::{Options, Packed, check_pair};
use crate::error::Result;
use crate::picture::{Picture, dubois};

/// Mixes the views with the options' matrix and space. No alpha: a pixel shows two rays.
pub(super) fn pack(left: &Picture, right: &Picture, options: &Options) -> Result<Packed> {
    check_pair(left, right)?;
    let (picture, clipped) = dubois::anaglyph(left, right, options.matrix, options.space);
    Ok(Packed { picture, clipped })
}
