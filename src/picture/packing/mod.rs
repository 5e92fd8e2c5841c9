//! Packings: from the two views' pictures to one picture that a file or a screen takes.
//!
//! Adding one is a file with its function and a row of [`PACKINGS`]. A single view (`mono`) needs no packing.

mod anaglyph;
mod left;
mod right;
mod sbs;

use std::borrow::Cow;

use crate::error::{Error, Result};
use crate::picture::Picture;
use crate::picture::dubois::{MATRICES, Matrix, Space};

/// One way to pack two views.
#[derive(Debug)]
pub struct Packing {
    /// Name on the command line and in file names.
    pub name: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// Packs; the pictures are of one size, else [`Error::Usage`].
    pub pack: Pack,
    /// Width and height of the packed picture, from those of a view.
    pub size: fn([u32; 2]) -> [u32; 2],
}

/// Left view, right view, options.
pub type Pack = for<'a> fn(&'a Picture, &'a Picture, &Options) -> Result<Packed<'a>>;

/// Every packing, in the order that help shows; all four are what `render` writes by default.
pub const PACKINGS: &[Packing] = &[
    Packing { name: "left", help: "the left view alone", pack: left::pack, size: |size| size },
    Packing { name: "right", help: "the right view alone", pack: right::pack, size: |size| size },
    Packing {
        name: "anaglyph",
        help: "red-cyan anaglyph, red at the left eye, by Dubois' projection",
        pack: anaglyph::pack,
        size: |size| size,
    },
    Packing {
        name: "sbs",
        help: "side by side, the left view on the left half, each at full width",
        pack: sbs::pack,
        size: |[width, height]| [2 * width, height],
    },
];

/// What packings can be told.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Weights of the anaglyph.
    pub matrix: &'static Matrix,
    /// What the weights are applied to.
    pub space: Space,
}

impl Default for Options {
    /// Dubois 2001 in linear light.
    fn default() -> Self {
        Self { matrix: &MATRICES[0], space: Space::Linear }
    }
}

/// A packed picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed<'a> {
    /// The picture, in linear light; a view itself where the packing leaves it as it is.
    pub picture: Cow<'a, Picture>,
    /// Samples (of `3 * pixels`) that mixing put outside [0, 1], where integer files clip them; 0 for packings that do
    /// not mix.
    pub clipped: u64,
}

/// The packing of that name. [`Error::Usage`] lists the names there are.
pub fn packing(name: &str) -> Result<&'static Packing> {
    PACKINGS.iter().find(|p| p.name == name).ok_or_else(|| {
        let names: Vec<_> = PACKINGS.iter().map(|p| p.name).collect();
        Error::Usage(format!("there is no stereo format `{name}`; there are {}", names.join(", ")))
    })
}

/// [`Error::Usage`] unless both pictures are whole and of one size.
fn check_pair(left: &Picture, right: &Picture) -> Result<()> {
    if left.size != right.size {
        let [[lw, lh], [rw, rh]] = [left.size, right.size];
        return Err(Error::Usage(format!(
            "the left picture is {lw} x {lh} pixels and the right one {rw} x {rh}; a stereo pair is of one size"
        )));
    }
    left.check().and_then(|()| right.check()).map_err(Error::Usage)
}
