//! `left`: the left view alone.

use super::{Options, Packed, check_pair};
use crate::error::Result;
use crate::picture::Picture;

/// The left picture as it is. The right one must still belong to it: one that differs in size is a mistake.
pub(super) fn pack(left: &Picture, right: &Picture, _: &Options) -> Result<Packed> {
    check_pair(left, right)?;
    Ok(Packed { picture: left.clone(), clipped: 0 })
}
