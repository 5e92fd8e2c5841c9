//! Material libraries of OBJ files (`.mtl`): diffuse colours and textures (P. Bourke's copy of the Alias|Wavefront
//! Advanced Visualizer manual, *MTL material format*).
//!
//! Taken are `newmtl`, `Kd r [g b]` (linear light) and `map_Kd` with `-s`, `-o` and `-clamp`. Transparency and all
//! other maps have no counterpart in [`Mesh`](crate::scene::Mesh) and are noted; lighting (`Ka`, `Ks`, `Ke`, `Ns`,
//! `Ni`, `illum`, ...) is the scene's own.

use super::Outcome;
use super::statements::{Statement, Statements, fields, uncommented, word};
use crate::input::columns::{number, quote};
use crate::scene::Rgb;
use glam::DVec2;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::BufRead;

/// A material of a library.
#[derive(Debug, Default)]
pub(super) struct Material {
    /// Linear-light diffuse colour, if it is given.
    pub(super) color: Option<Rgb>,
    /// Diffuse texture.
    pub(super) map: Option<Box<Map>>,
}

/// A line `map_Kd`.
#[derive(Debug)]
pub(super) struct Map {
    /// The file's name as it is written.
    pub(super) file: String,
    /// Factor of the texture coordinates (-s), before the offset.
    pub(super) scale: DVec2,
    /// Summand of the texture coordinates (-o).
    pub(super) offset: DVec2,
    /// Whether the texture's edge goes on outside of it (-clamp on) instead of the texture.
    pub(super) clamp: bool,
}

/// Options of a map that decide what it looks like and are left out, with the number of their arguments; then those
/// that do not matter here.
const OPTIONS: &[(&[u8], usize, bool)] = &[
    (b"-mm", 2, true),
    (b"-cc", 1, true),
    (b"-imfchan", 1, true),
    (b"-boost", 1, false),
    (b"-blendu", 1, false),
    (b"-blendv", 1, false),
    (b"-bm", 1, false),
    (b"-texres", 1, false),
    (b"-type", 1, false),
];

/// Reads a library and adds its materials to those known, of which the first of a name stays. What is left out is
/// handed to `note`.
pub(super) fn read(
    reader: &mut dyn BufRead,
    materials: &mut HashMap<Vec<u8>, Material>,
    mut note: impl FnMut(&str),
) -> Outcome<()> {
    let mut statements = Statements::new(reader);
    // Of a name that is known already the lines are checked and forgotten.
    let mut spare = Material::default();
    let mut current: Option<Vec<u8>> = None;
    while let Some(Statement { line, keyword, rest }) = statements.next()? {
        let wrong = |problem: String| format!("line {line}: {}: {problem}", quote(&[keyword, b" ", rest].concat()));
        let keyword = keyword.to_ascii_lowercase();
        if keyword == b"newmtl" {
            if rest.is_empty() {
                return Err(wrong("allowed: newmtl NAME".to_owned()));
            }
            spare = Material::default();
            current = match materials.entry(rest.to_vec()) {
                Entry::Occupied(_) => {
                    note("of several materials of one name the first is used");
                    None
                }
                Entry::Vacant(entry) => {
                    entry.insert(Material::default());
                    Some(rest.to_vec())
                }
            };
            continue;
        }
        let material = match &current {
            Some(name) => materials.get_mut(name).unwrap_or(&mut spare),
            None => &mut spare,
        };
        match keyword.as_slice() {
            b"kd" => match word(rest).0 {
                b"spectral" | b"xyz" => note("colours in `Kd spectral` and `Kd xyz` are left out"),
                _ => material.color = Some(color(rest).map_err(wrong)?),
            },
            b"map_kd" => {
                material.map = map(rest, &mut note).map_err(wrong)?.map(Box::new);
            }
            b"d" | b"tr" => {
                let opaque = if keyword == b"d" { 1.0 } else { 0.0 };
                // `d -halo factor` has the factor last too.
                let factor = fields(rest).last().ok_or_else(|| wrong("the factor is missing".to_owned()))?;
                if number(factor).map_err(wrong)? != opaque {
                    note(TRANSPARENT);
                }
            }
            b"map_d" => note(TRANSPARENT),
            b"disp" | b"decal" | b"bump" | b"refl" | b"norm" => note(OTHER_MAPS),
            other if other.starts_with(b"map_") => note(OTHER_MAPS),
            // Lighting, and what other programs have invented.
            _ => {}
        }
    }
    Ok(())
}

const TRANSPARENT: &str = "transparency (d, Tr, map_d) is left out: the mesh is drawn opaque";
const OTHER_MAPS: &str = "maps other than map_Kd are left out";

/// One number is a grey.
fn color(rest: &[u8]) -> Outcome<Rgb> {
    let values = fields(rest).map(number).collect::<Outcome<Vec<f64>>>()?;
    let color = match values[..] {
        [grey] => [grey; 3],
        [r, g, b] => [r, g, b],
        _ => return Err("allowed: Kd r g b".to_owned()),
    }
    .map(|value| value as f32);
    if color.iter().all(|value| value.is_finite()) { Ok(color) } else { Err("is too large".to_owned()) }
}

/// The options and the file's name; none if there is no name.
fn map(rest: &[u8], note: &mut impl FnMut(&str)) -> Outcome<Option<Map>> {
    let mut map = Map { file: String::new(), scale: DVec2::ONE, offset: DVec2::ZERO, clamp: false };
    let mut rest = rest;
    loop {
        let (option, after) = word(rest);
        match option.to_ascii_lowercase().as_slice() {
            b"-clamp" => {
                let (value, after) = word(after);
                map.clamp = value == b"on";
                rest = after;
            }
            b"-s" => (map.scale, rest) = vector(after, DVec2::ONE)?,
            b"-o" => (map.offset, rest) = vector(after, DVec2::ZERO)?,
            b"-t" => {
                note("the option -t of map_Kd is left out");
                rest = vector(after, DVec2::ZERO)?.1;
            }
            name => match OPTIONS.iter().find(|(known, ..)| *known == name) {
                Some(&(_, arguments, matters)) => {
                    if matters {
                        note(&format!("the option {} of map_Kd is left out", String::from_utf8_lossy(name)));
                    }
                    rest = (0..arguments).fold(after, |rest, _| word(rest).1);
                }
                // The name is all that is left, with its spaces.
                None => break,
            },
        }
    }
    map.file = String::from_utf8_lossy(uncommented(rest)).into_owned();
    Ok((!map.file.is_empty()).then_some(map))
}

/// One to three numbers, of which the third, for solid textures, does not matter; and what follows them. A last word
/// is the file's name, even if it looks like a number.
fn vector(mut rest: &[u8], default: DVec2) -> Outcome<(DVec2, &[u8])> {
    let mut values = default.to_array();
    for i in 0..3 {
        let (field, after) = word(rest);
        match number(field) {
            Ok(value) if i == 0 || !after.is_empty() => {
                if let Some(slot) = values.get_mut(i) {
                    *slot = value;
                }
                rest = after;
            }
            Err(problem) if i == 0 => return Err(problem),
            _ => break,
        }
    }
    Ok((DVec2::from_array(values), rest))
}
