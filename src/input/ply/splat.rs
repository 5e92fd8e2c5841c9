//! 3D Gaussian splats as particles (Kerbl, Kopanas, Leimkuehler & Drettakis, *3D Gaussian Splatting for Real-Time
//! Radiance Field Rendering*, 2023), as its training program writes them into PLY files.
//!
//! The file holds what was optimised, not what is seen: logarithms of the standard deviations along three axes
//! (`scale_0` to `scale_2`), a quaternion (`rot_0` to `rot_3`), the logit of the opacity (`opacity`), and spherical
//! harmonics of the colour (`f_dc_0` to `f_dc_2`, `f_rest_0` and on). A particle is round and looks the same from
//! everywhere, so what is kept is
//!
//! - radius = 3 sigma, where sigma is the geometric mean of the three deviations: the ball has the ellipsoid's volume;
//! - opacity = 1 / (1 + exp(-o)), but at most [`MAX_OPACITY`];
//! - colour = 1/2 + Y0 f_dc, the harmonic of degree 0. The pictures that it was trained with are sRGB-encoded, so that
//!   it is too: clamped to [0, 1] and decoded to linear light.
//!
//! A splat's opacity falls off as rho exp(-d^2 / 2 sigma^2), which is the Gaussian kernel with the linear model of
//! opacity.
//!
//! These columns stand beside those of the file, in place of any that have the same name; they are derived block by
//! block, so that the file's own need no memory.

use super::header::Element;
use super::rows::make_room;
use crate::input::columns::{Column, ReadError, Selection};
use crate::input::particles::MAX_OPACITY;
use crate::picture::color::decode;
use std::ops::Range;

/// The spherical harmonic of degree 0, 1 / (2 sqrt(pi)).
const Y0: f64 = 0.282_094_791_773_878_14;

/// Standard deviations in the radius of the Gaussian kernel.
const DEVIATIONS: f64 = 3.0;

/// The largest radius that is accepted: the training program computes in 32 bits, where larger ones are infinite.
const LARGEST_RADIUS: f64 = f32::MAX as f64;

/// The columns that are derived, in this order.
const DERIVED: [&str; 5] = ["radius", "opacity", "r", "g", "b"];
const SCALE: [&str; 3] = ["scale_0", "scale_1", "scale_2"];
const OPACITY: &str = "opacity";
const COLOR: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
const ROTATION: [&str; 4] = ["rot_0", "rot_1", "rot_2", "rot_3"];
/// What the names of the higher harmonics begin with.
const REST: &str = "f_rest_";

/// Names that mean colour in a file of splats: the derived one first.
pub(super) const COLORS: &[[&str; 3]] = &[["r", "g", "b"], ["red", "green", "blue"]];

/// Whether the element holds splats.
pub(super) fn is_splat(vertex: &Element) -> bool {
    vertex.has_scalars(&SCALE) && vertex.has_scalars(&[OPACITY]) && vertex.has_scalars(&COLOR)
}

/// An error if the element holds splats in the packed form of PlayCanvas, which has other columns.
pub(super) fn refuse_packed(vertex: &Element) -> Result<(), ReadError> {
    if vertex.has_scalars(&["packed_position", "packed_scale", "packed_color"]) {
        let message = "has compressed Gaussian splats (`packed_position`, ...), which are not supported; allowed: an \
                       uncompressed PLY with f_dc_0, opacity, scale_0, ...";
        return Err(ReadError::content(message));
    }
    Ok(())
}

/// An error if the element holds splats that are flat: they have two scales, and an opacity that is a logit all the same.
pub(super) fn refuse_flat(vertex: &Element) -> Result<(), ReadError> {
    if !is_splat(vertex)
        && vertex.has_scalars(&SCALE[..2])
        && vertex.has_scalars(&[OPACITY])
        && vertex.has_scalars(&COLOR)
    {
        let message = "has 2D Gaussian splats (no `scale_2`), which are not supported; allowed: 3D Gaussian splats";
        return Err(ReadError::content(message));
    }
    Ok(())
}

/// Whether a column of the file is hidden by a derived one.
pub(super) fn hides(name: &str) -> bool {
    DERIVED.contains(&name)
}

/// Derives columns while a file is read.
pub(super) struct Splats {
    /// Those wanted.
    derived: Vec<Column>,
    /// Whether each column of the file is kept, or only needed here.
    kept: Vec<bool>,
    lenient: bool,
    spread: Spread,
}

impl Splats {
    /// For a file whose vertices are splats, of which `selection` is wanted.
    pub(super) fn new(vertex: &Element, selection: &Selection, checked: bool) -> Result<Self, ReadError> {
        let mut derived = Vec::with_capacity(DERIVED.len());
        for name in DERIVED.into_iter().filter(|name| selection.wants(name)) {
            let mut column = Column { name: name.to_owned(), values: Vec::new(), byte: false };
            make_room(vertex, &mut column, checked)?;
            derived.push(column);
        }
        Ok(Self { derived, kept: Vec::new(), lenient: selection.is_lenient(), spread: Spread::default() })
    }

    /// Whether a column of the file is needed for what is wanted.
    pub(super) fn needs(&self, name: &str) -> bool {
        self.derived.iter().any(|column| sources(&column.name).contains(&name))
    }

    /// The next column of the file, of those kept or needed.
    pub(super) fn push(&mut self, kept: bool) {
        self.kept.push(kept);
    }

    /// Derives from the last rows of the file's columns, and empties those that are not kept.
    pub(super) fn block(&mut self, raw: &mut [Column], rows: Range<u64>) -> Result<(), ReadError> {
        let count = (rows.end - rows.start) as usize;
        for column in &mut self.derived {
            let slices: Vec<&[f64]> = sources(&column.name)
                .iter()
                .filter_map(|name| raw.iter().find(|column| column.name == **name))
                .map(|column| &column.values[column.values.len().saturating_sub(count)..])
                .collect();
            match (column.name.as_str(), slices.as_slice()) {
                (OPACITY, [logits]) => column.values.extend(logits.iter().map(|&logit| opacity(logit))),
                (_, [values]) => column.values.extend(values.iter().map(|&value| color(value))),
                (_, [a, b, c]) => {
                    for (row, ((&a, &b), &c)) in a.iter().zip(*b).zip(*c).enumerate() {
                        let scale = [a, b, c];
                        let mut radius = radius(scale);
                        if !(radius > 0.0 && radius <= LARGEST_RADIUS) {
                            if !self.lenient {
                                let message = format!(
                                    "vertex {}: scale_0, scale_1, scale_2 are {a}, {b}, {c}, logarithms of a radius of \
                                     {radius:e}; allowed: a radius > 0 of at most {LARGEST_RADIUS:e}",
                                    rows.start + row as u64
                                );
                                return Err(ReadError::content(message));
                            }
                            radius = f64::NAN;
                        }
                        self.spread.add(scale);
                        column.values.push(radius);
                    }
                }
                // Not all of the columns are there: never, since is_splat holds.
                _ => {}
            }
        }
        for (column, _) in raw.iter_mut().zip(&self.kept).filter(|(_, kept)| !**kept) {
            column.values.clear();
        }
        Ok(())
    }

    /// The columns, names and note of a file whose blocks have all been seen: x, y, z, the derived, the file's others.
    pub(super) fn finish(self, raw: Vec<Column>, vertex: &Element) -> (Vec<Column>, Vec<String>, Option<String>) {
        let note = self.note(vertex);
        let kept = raw.into_iter().zip(&self.kept).filter(|(_, kept)| **kept).map(|(column, _)| column);
        let (mut columns, others): (Vec<Column>, Vec<Column>) = kept.partition(|column| is_place(&column.name));
        columns.extend(self.derived);
        columns.extend(others);
        let own = vertex.scalars().map(|(name, _)| name.to_owned()).filter(|name| !hides(name));
        let (mut names, others): (Vec<String>, Vec<String>) = own.partition(|name| is_place(name));
        names.extend(DERIVED.map(str::to_owned));
        names.extend(others);
        (columns, names, note)
    }

    fn note(&self, vertex: &Element) -> Option<String> {
        if vertex.count == 0 {
            return None;
        }
        let mut dropped = Vec::new();
        // Of round splats there is no shape to drop.
        if !self.spread.all_round() {
            let rotation = if vertex.has_scalars(&ROTATION) { "rotation and " } else { "" };
            let ratio = match self.spread.median() {
                Some(ratio) if ratio < 100.0 => format!(" (median ratio of longest to shortest axis: {ratio:.1})"),
                Some(ratio) => format!(" (median ratio of longest to shortest axis: {ratio:.0})"),
                None => String::new(),
            };
            dropped.push(format!("{rotation}unequal scales{ratio}"));
        }
        let rest = vertex.scalars().filter(|(name, _)| name.starts_with(REST)).count();
        if rest > 0 {
            dropped.push(format!("{rest} coefficients of view-dependent colour"));
        }
        let dropped = match dropped.as_slice() {
            [] => String::new(),
            all => format!(", of which {} are dropped", all.join(" and ")),
        };
        Some(format!(
            "{} Gaussian splats become round particles{dropped}; the fall-off of a splat's opacity is that of the \
             Gaussian kernel with opacity_model = \"linear\"",
            vertex.count
        ))
    }
}

fn is_place(name: &str) -> bool {
    matches!(name, "x" | "y" | "z")
}

/// The columns of the file that a derived one comes from.
fn sources(derived: &str) -> &'static [&'static str] {
    match derived {
        "radius" => &SCALE,
        "opacity" => &[OPACITY],
        "r" => &COLOR[..1],
        "g" => &COLOR[1..2],
        "b" => &COLOR[2..],
        _ => &[],
    }
}

/// Three deviations of the ball that has the ellipsoid's volume, from logarithms of the deviations along the axes.
fn radius(scale: [f64; 3]) -> f64 {
    DEVIATIONS * (scale.iter().sum::<f64>() / 3.0).exp()
}

/// The opacity in [0, [`MAX_OPACITY`]] of a logit. NaN gives NaN.
fn opacity(logit: f64) -> f64 {
    let opacity = 1.0 / (1.0 + (-logit).exp());
    // Unlike f64::min this keeps NaN.
    if opacity > MAX_OPACITY { MAX_OPACITY } else { opacity }
}

/// Linear light in [0, 1] of the harmonic of degree 0. NaN gives NaN.
fn color(harmonic: f64) -> f64 {
    decode((0.5 + Y0 * harmonic).clamp(0.0, 1.0))
}

/// How long the splats are: counts of the logarithm of longest over shortest axis.
#[derive(Default)]
struct Spread {
    /// For each step of [`Spread::STEP`]; the last has all that is larger.
    counts: Vec<u64>,
    total: u64,
    unequal: bool,
}

impl Spread {
    /// One per cent.
    const STEP: f64 = 0.01;
    /// Up to a ratio of exp(20), beyond what 32 bits resolve.
    const STEPS: usize = 2000;

    fn add(&mut self, scale: [f64; 3]) {
        let [a, b, c] = scale;
        let logarithm = a.max(b).max(c) - a.min(b).min(c);
        if !logarithm.is_finite() {
            return;
        }
        if self.counts.is_empty() {
            self.counts.resize(Self::STEPS, 0);
        }
        self.unequal |= logarithm > 0.0;
        let step = ((logarithm / Self::STEP) as usize).min(Self::STEPS - 1);
        if let Some(count) = self.counts.get_mut(step) {
            *count += 1;
            self.total += 1;
        }
    }

    /// Whether there are some, and each is a ball.
    fn all_round(&self) -> bool {
        self.total > 0 && !self.unequal
    }

    /// The median ratio; none if no axes were read.
    fn median(&self) -> Option<f64> {
        let mut seen = 0;
        let step = self.counts.iter().position(|count| {
            seen += count;
            2 * seen > self.total
        })?;
        Some(((step as f64 + 0.5) * Self::STEP).exp())
    }
}
