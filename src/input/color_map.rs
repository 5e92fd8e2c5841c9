//! Colour maps: from a number in [0, 1] to a colour.

use crate::picture::color::decode_u8;
use crate::scene::Rgb;
use colorous::Gradient;

/// Colours of the table that a map is sampled into.
const ENTRIES: usize = 256;

/// A colour map, one of [`COLOR_MAPS`].
#[derive(Clone, Copy, Debug)]
pub struct ColorMap {
    /// The name that scene files use.
    pub name: &'static str,
    /// One line for help texts.
    pub help: &'static str,
    /// The colours, from the crate `colorous`; absent: grey.
    gradient: Option<Gradient>,
}

impl PartialEq for ColorMap {
    /// Names are unique, see [`COLOR_MAPS`].
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// The colour maps, all of them.
pub const COLOR_MAPS: &[ColorMap] = &[
    map("viridis", "perceptually uniform, dark blue over green to yellow", colorous::VIRIDIS),
    map("magma", "perceptually uniform, black over purple to pale yellow", colorous::MAGMA),
    map("inferno", "perceptually uniform, black over red to pale yellow", colorous::INFERNO),
    map("plasma", "perceptually uniform, blue over red to yellow", colorous::PLASMA),
    map("cividis", "perceptually uniform also with colour deficiency, blue to yellow", colorous::CIVIDIS),
    map("turbo", "rainbow with even lightness changes, dark blue to dark red", colorous::TURBO),
    ColorMap { name: "grey", help: "black to white, even steps of the sRGB-encoded value", gradient: None },
    map("cubehelix", "black over a helix of hues to white, lightness rising evenly", colorous::CUBEHELIX),
    map("warm", "half a rainbow of even lightness, purple over red to green", colorous::WARM),
    map("cool", "half a rainbow of even lightness, purple over blue to green", colorous::COOL),
    map("blues", "pale to dark blue", colorous::BLUES),
    map("spectral", "diverging, red over pale yellow to blue", colorous::SPECTRAL),
    map("red-blue", "diverging, red over white to blue", colorous::RED_BLUE),
    map("sinebow", "cyclical rainbow, for angles", colorous::SINEBOW),
];

const fn map(name: &'static str, help: &'static str, gradient: Gradient) -> ColorMap {
    ColorMap { name, help, gradient: Some(gradient) }
}

impl ColorMap {
    /// The colour map of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        COLOR_MAPS.iter().copied().find(|map| map.name == name)
    }

    /// The names of all colour maps, in the order that help shows.
    pub fn names() -> Vec<&'static str> {
        COLOR_MAPS.iter().map(|map| map.name).collect()
    }

    /// The map as 256 linear-light colours, the first for 0, the last for 1.
    pub fn table(&self) -> Vec<Rgb> {
        (0..ENTRIES)
            .map(|i| {
                let encoded = match self.gradient {
                    Some(gradient) => gradient.eval_rational(i, ENTRIES).as_array(),
                    None => [i as u8; 3],
                };
                encoded.map(decode_u8)
            })
            .collect()
    }
}

/// The colour of `t` in a [`ColorMap::table`], linear in linear light between entries; `t` outside [0, 1] is clamped,
/// NaN is 0.
pub fn look_up(table: &[Rgb], t: f64) -> Rgb {
    let Some(last) = table.len().checked_sub(1) else { return [0.0; 3] };
    let position = t.clamp(0.0, 1.0) * last as f64;
    // The conversion takes NaN to 0.
    let below = (position as usize).min(last);
    let above = (below + 1).min(last);
    let share = if position.is_nan() { 0.0 } else { (position - below as f64) as f32 };
    std::array::from_fn(|c| table[below][c] + share * (table[above][c] - table[below][c]))
}
