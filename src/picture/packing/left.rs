//! `left`: the left view alone.

use std::borrow::Cow;

use super::{Options, Packed, check_pair};
use crate::error::Result;
use crate::picture::Picture;

/// The left picture as it is. The right one must still belong to it: one that differs in size is a mistake.
pub(super) fn pack<'a>(left: &'a Picture, right: &'a Picture, _: &Options) -> Result<Packed<'a>> {
    check_pair(left, right)?;
    Ok(Packed { picture: Cow::Borrowed(left), clipped: 0 })
}
