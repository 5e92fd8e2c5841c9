//! Colour maps: from a number in [0, 1] to a colour.

/// A colour map, one of [`COLOR_MAPS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColorMap {
    /// The name that scene files use.
    pub name: &'static str,
}

/// The colour maps, all of them.
pub const COLOR_MAPS: &[ColorMap] = &[ColorMap { name: "viridis" }, ColorMap { name: "magma" }];

impl ColorMap {
    /// The colour map of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        COLOR_MAPS.iter().copied().find(|map| map.name == name)
    }
}
