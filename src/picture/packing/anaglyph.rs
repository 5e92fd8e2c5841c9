//! `anaglyph`: red-cyan, by Dubois' projection.

use std::borrow::Cow;

use super::{Options, Packed, check_pair};
use crate::error::Result;
use crate::picture::{Picture, dubois};

/// Mixes the views with the options' matrix and space. No alpha: a pixel shows two rays.
pub(super) fn pack<'a>(left: &'a Picture, right: &'a Picture, options: &Options) -> Result<Packed<'a>> {
    check_pair(left, right)?;
    let (picture, clipped) = dubois::anaglyph(left, right, options.matrix, options.space);
    Ok(Packed { picture: Cow::Owned(picture), clipped })
}
