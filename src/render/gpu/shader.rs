//! WGSL joined from the parts in `shaders/`.

use crate::render::OpacityModel;
use crate::render::cpu::segments::Lookup;

/// A file of `shaders/` and its text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// The file's name below `shaders/`.
    pub file: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! part {
    ($name:ident, $file:literal) => {
        #[doc = concat!("`shaders/", $file, "`.")]
        pub const $name: Part = Part { file: $file, text: include_str!(concat!("../../../shaders/", $file)) };
    };
}

part!(TYPES, "types.wgsl");
part!(FOOTPRINT, "footprint.wgsl");
part!(BINDINGS, "bindings.wgsl");
part!(FILM, "film.wgsl");
part!(TILE, "tile.wgsl");
part!(RASTER, "raster.wgsl");
part!(RESOLVE, "resolve.wgsl");
part!(EXPONENTIAL, "opacity/exponential.wgsl");
part!(LINEAR, "opacity/linear.wgsl");
part!(VIEWPLANE, "method/viewplane.wgsl");
part!(VIEWPOINT, "method/viewpoint.wgsl");
part!(PERSPECTIVE, "method/perspective.wgsl");
part!(SPHERICAL_PARALLEL, "method/spherical_parallel.wgsl");
part!(SPHERICAL_SLANTED, "method/spherical_slanted.wgsl");
part!(PRINTED, "falloff/printed.wgsl");
part!(BELL, "kernel/bell.wgsl");
part!(POLYNOMIAL, "kernel/polynomial.wgsl");
part!(SHELLS, "kernel/shells.wgsl");
part!(SLAB, "slab.wgsl");
part!(NO_EXTRAPOLATION, "extrapolation/none.wgsl");
part!(RICHARDSON, "extrapolation/richardson.wgsl");
part!(NO_ESTIMATE, "estimate/none.wgsl");
part!(ERROR_MAP, "estimate/map.wgsl");
part!(INTEGRATED, "falloff/integrated.wgsl");
part!(SEGMENTS, "segments.wgsl");
part!(NEAREST, "lookup/nearest.wgsl");
part!(INTERPOLATED, "lookup/interpolated.wgsl");
part!(SHEET, "sheet.wgsl");
part!(DOUBLE, "project/double.wgsl");
part!(PROJECT, "project/project.wgsl");
part!(PROJECT_VIEWPLANE, "project/viewplane.wgsl");
part!(PROJECT_VIEWPOINT, "project/viewpoint.wgsl");
part!(PROJECT_PERSPECTIVE, "project/perspective.wgsl");
part!(PROJECT_SPHERICAL_PARALLEL, "project/spherical_parallel.wgsl");
part!(PROJECT_SPHERICAL_SLANTED, "project/spherical_slanted.wgsl");
part!(QUAD_FAR, "project/quad_far.wgsl");
part!(QUAD_CENTRE, "project/quad_centre.wgsl");
part!(WORK, "lists/work.wgsl");
part!(STAIRS, "lists/stairs.wgsl");
part!(COUNT_DIGITS, "lists/count.wgsl");
part!(SCATTER_PAIRS, "lists/scatter.wgsl");
part!(SCAN_BLOCKS, "lists/scan.wgsl");
part!(SPREAD_SUMS, "lists/spread.wgsl");
part!(GATHER_KEYS, "lists/gather.wgsl");
part!(MEASURE_STAIRS, "lists/measure.wgsl");
part!(EMIT_PAIRS, "lists/emit.wgsl");
part!(TILE_STARTS, "lists/starts.wgsl");

fn opacity(model: OpacityModel) -> Part {
    match model {
        OpacityModel::Exponential => EXPONENTIAL,
        OpacityModel::Linear => LINEAR,
    }
}

/// The parts of the tile shader for a method's parts and an opacity model.
pub fn tile(method: &[Part], model: OpacityModel) -> Vec<Part> {
    let mut parts = vec![TYPES, BINDINGS, FILM, FOOTPRINT, opacity(model), TILE];
    parts.extend(method);
    parts
}

/// The parts of the raster shader for a method's parts and an opacity model.
pub fn billboards(method: &[Part], model: OpacityModel) -> Vec<Part> {
    let mut parts = vec![TYPES, FOOTPRINT, opacity(model), RASTER];
    parts.extend(method);
    parts
}

/// The parts of the shader that copies what was rastered.
pub const RESOLVED: [Part; 2] = [TYPES, RESOLVE];

/// The parts of the slab shader; `richardson`: whether the light is extrapolated; `estimate`: whether its error is estimated.
pub fn slabs(richardson: bool, estimate: bool) -> [Part; 10] {
    let extrapolation = if richardson { RICHARDSON } else { NO_EXTRAPOLATION };
    let estimate = if estimate { ERROR_MAP } else { NO_ESTIMATE };
    [TYPES, BINDINGS, FILM, EXPONENTIAL, BELL, POLYNOMIAL, SHELLS, extrapolation, estimate, SLAB]
}

/// The part that looks segments up.
pub fn lookup(lookup: Lookup) -> Part {
    match lookup {
        Lookup::Nearest => NEAREST,
        Lookup::Interpolated => INTERPOLATED,
    }
}

/// The parts of the sheet shader.
pub fn slices(way: Lookup) -> [Part; 6] {
    [TYPES, BINDINGS, FILM, SEGMENTS, lookup(way), SHEET]
}

/// The shader that counts digits.
pub const COUNT: [Part; 2] = [WORK, COUNT_DIGITS];
/// The shader that moves pairs to their places.
pub const SCATTER: [Part; 2] = [WORK, SCATTER_PAIRS];
/// The shader that sums within blocks.
pub const SCAN: [Part; 2] = [WORK, SCAN_BLOCKS];
/// The shader that adds what is before a block.
pub const SPREAD: [Part; 2] = [WORK, SPREAD_SUMS];
/// The shader that takes the keys' high words in an order.
pub const GATHER: [Part; 2] = [WORK, GATHER_KEYS];
/// The shader that counts the tiles of each particle.
pub const MEASURE: [Part; 3] = [WORK, STAIRS, MEASURE_STAIRS];
/// The shader that makes pairs of tile and particle.
pub const EMIT: [Part; 3] = [WORK, STAIRS, EMIT_PAIRS];
/// The shader that finds the tiles' lists.
pub const STARTS: [Part; 2] = [WORK, TILE_STARTS];

/// The parts of the shader that projects particles, for a method's parts.
pub fn project(method: &[Part]) -> Vec<Part> {
    let mut parts = vec![TYPES, DOUBLE, STAIRS, PROJECT];
    parts.extend(method);
    parts
}

/// One text of all parts; WGSL asks for no order.
pub fn join(parts: &[Part]) -> String {
    parts.iter().map(|part| part.text).collect::<Vec<_>>().join("\n")
}
