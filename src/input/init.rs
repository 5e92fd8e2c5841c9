//! A ready scene for somebody's data: the text of a scene file that shows all of a file of particles, a volume or a mesh
//! in stereo.
//!
//! What is decided, and how:
//! - *Where the camera stands*: in front, to the right and above, as near as it can be with every particle's ball (every
//!   vertex of a mesh) in both views, and a margin. A cloud that is far flatter along z than along x and y has its z
//!   up, as maps, radars and discs do, and is turned over.
//! - *Stereo*: convergence at the middle of the cloud, the interocular distance a thirtieth of it.
//! - *Places*: `x`, `y`, `z`, or what programs call them: `X`, `Points:0`, `position_x` and the like.
//! - *Radius*, where the file has none: 4/3 of the mean distance to the eighth neighbour, the nearest and the farthest
//!   twentieth left out, since a few particles far away say nothing of the others. That is 1.65 times the mean
//!   spacing (V/N)^(1/3) of particles at random, 1.9 times that of a lattice, and it bridges the gaps of data that are
//!   denser along one direction, as those of a radar. A volume's own rule is [`super::particles::CELL_RADIUS`].
//! - *Opacity*, where the file has none, or none from 0 to 1: such that the mean optical depth through what the cloud covers of the picture is
//!   [`MEAN_OPTICAL_DEPTH`]: thick enough to be seen, thin enough to see into.
//! - *Colour*, where the file has none: the first column that varies, a scalar rather than part of a vector, through a
//!   colour map. Colours from 0 to 255 are brought to 0 to 1; what is no colour at all is mapped like any other column.

use super::columns::{Column, Columns, Selection};
use super::mesh::{MeshEntry, load_mesh};
use super::particles::{CELL_RADIUS, DEFAULT_RADIUS, world_from_set};
use super::{Kind, VolumeOptions, kind, read_columns};
use crate::error::{Error, Result};
use crate::render::Progress;
use crate::scene::Kernel;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashSet;
use std::fmt::Write;
use std::path::Path;

/// Mean optical depth of a cloud whose opacity nothing gives: e^-1.5, or 22 %, of what is behind is seen.
pub const MEAN_OPTICAL_DEPTH: f64 = 1.5;
/// Opacities that are chosen, at the least and at the most: less is nothing, more is a ball.
const OPACITIES: [f64; 2] = [1e-4, 0.95];
/// Which neighbour's distance is the spacing, and the radius over that.
const NEIGHBOUR: usize = 8;
const RADIUS_IN_SPACINGS: f64 = 4.0 / 3.0;
/// Convergence distance over interocular distance: the rule of thumb of stereo photography.
const CONVERGENCE_IN_INTEROCULARS: f64 = 30.0;
/// The cloud fills this much less of the picture than it could.
const MARGIN: f64 = 1.04;
/// Direction from the middle of the cloud to the camera: so far to the right and so far above, of a flat cloud farther.
const AZIMUTH_DEG: f64 = 25.0;
const ELEVATION_DEG: f64 = 20.0;
const ELEVATION_OF_FLAT_DEG: f64 = 40.0;
/// Vertical field of view, degrees.
const FOV_Y_DEG: f64 = 40.0;
/// Below this ratio of the standard deviation of z to the smaller of those of x and y, z is up.
const FLAT: f64 = 0.4;
/// Distances that are measured for the mean spacing: points asked times points compared with.
const DISTANCES: usize = 1 << 29;
/// Columns that number things or say where they face rather than measure them, lower case.
const NO_MEASURES: &[&str] = &[
    "id",
    "ids",
    "gid",
    "index",
    "idx",
    "pid",
    "origid",
    "objectid",
    "particle_id",
    "particleid",
    "particleids",
    "globalids",
    "globalnodeid",
    "pedigreeids",
    "vtkoriginalpointids",
    "vtkoriginalcellids",
    "vtkghosttype",
    "nx",
    "ny",
    "nz",
];
/// What the names of the parts of a vector end with.
const PARTS: &[&str] = &["_x", "_y", "_z", "_X", "_Y", "_Z", "_0", "_1", "_2", ":0", ":1", ":2"];
/// Ends of the names of three coordinates, and what may stand before them.
const AXES: &[[&str; 3]] = &[
    ["X", "Y", "Z"],
    [":0", ":1", ":2"],
    ["_0", "_1", "_2"],
    ["_x", "_y", "_z"],
    ["_X", "_Y", "_Z"],
    [".x", ".y", ".z"],
];
const AXIS_PREFIXES: &[&str] = &[
    "",
    "Points",
    "points",
    "Position",
    "Positions",
    "position",
    "positions",
    "pos",
    "Pos",
    "coord",
    "coords",
    "Coordinates",
    "coordinates",
    "Center",
    "center",
    "centre",
    "P",
];
/// Columns of 3D Gaussian splats, whose makers have y down, as cameras do.
const SPLAT: [&str; 2] = ["f_dc_0", "scale_0"];

/// What may be chosen of a scene that is made.
#[derive(Clone, Debug, Default)]
pub struct InitOptions {
    /// Width and height of a view in pixels; absent: the scene file's default, which is then not written.
    pub size: Option<[u32; 2]>,
    /// What to read of a volume.
    pub volume: VolumeOptions,
}

/// The text of a scene file that shows a file of particles, a volume or a mesh. The path stands in it as given here.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read, that holds nothing to see, or that is none of these.
pub fn scene_text(path: &Path, options: &InitOptions, progress: &dyn Progress) -> Result<String> {
    let name = path.to_str().ok_or_else(|| {
        Error::input(path, "the file's name is not UTF-8, as a scene file must be; rename it or make a link to it")
    })?;
    match kind(path)? {
        Kind::Particles(_) => particles_text(path, name, options, progress),
        Kind::Mesh(_) => mesh_text(path, name, options),
        Kind::Scene => Err(Error::input(path, "this is no file of particles, volume or mesh to make a scene of")),
    }
}

fn mesh_text(path: &Path, name: &str, options: &InitOptions) -> Result<String> {
    let mesh = load_mesh(&MeshEntry::new(path))?;
    let vertices = || mesh.positions.iter().map(|&point| (point, 0.0));
    let cloud = Cloud::new(vertices, ELEVATION_DEG, options.size)
        .filter(|cloud| cloud.extent > 0.0)
        .ok_or_else(|| Error::input(path, "the mesh has no extent: there is nothing to see"))?;
    let mut text = format!("# Made for {}: change what you like.\n\n", comment(name));
    text += &cloud.camera(options.size);
    let _ = write!(text, "[[mesh]]\n{}", file_line(path, name));
    Ok(text)
}

fn particles_text(path: &Path, name: &str, options: &InitOptions, progress: &dyn Progress) -> Result<String> {
    let fail = |message: &str| Error::input(path, message);
    let read = |names: &[&str], strict: bool| {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let selection = if strict { Selection::Named(names) } else { Selection::Survey(names) };
        read_columns(path, &selection, &options.volume, progress)
    };
    let mut axes = ["x", "y", "z"].map(str::to_owned);
    let mut columns = read(&["x", "y", "z", "radius"], true)?;
    if columns.is_empty() {
        return Err(fail("no particles: there is nothing to see"));
    }
    if !axes.iter().all(|axis| columns.has(axis))
        && let Some(found) = axis_names(columns.names())
    {
        columns = read(&[&found[0], &found[1], &found[2], "radius"], true)?;
        axes = found;
    }
    let [Some(x), Some(y), Some(z)] = axes.each_ref().map(|axis| columns.take(axis)) else {
        let known: Vec<String> = columns.names().iter().map(|name| format!("`{name}`")).collect();
        return Err(fail(&format!(
            "no columns `x`, `y` and `z`; the file's columns: {}; write a scene file that maps them: \
             [particles.columns] x = {{ from = \"...\" }}",
            known.join(", ")
        )));
    };
    let points = Points { x: x.values, y: y.values, z: z.values };
    let names = columns.names().to_vec();
    let cells = columns.cells.clone();
    // A grid may be called `radius`.
    let own_radius = names.iter().any(|name| name == "radius") && cells.as_ref().is_none_or(|c| c.density != "radius");
    let radii = if own_radius { columns.take("radius").map(|column| column.values) } else { None };

    // Columns that are neither places nor what particles have by themselves.
    let colors = columns.color_names();
    let used = |name: &str| {
        let color = colors.is_some_and(|triple| triple.contains(&name));
        let density = cells.as_ref().is_some_and(|cells| cells.density == name);
        ["radius", "opacity"].contains(&name) || axes.iter().any(|axis| axis == name) || color || density
    };
    let splats = SPLAT.iter().all(|name| columns.has(name));
    let (uniform, radius_line) = match (&cells, &radii) {
        (Some(cells), _) => (CELL_RADIUS * cells.volume.cbrt(), String::new()),
        // Every particle has its own: the spacing, which takes time, is not asked for.
        (None, Some(_)) => (DEFAULT_RADIUS, String::new()),
        (None, None) => uniform_radius(&points),
    };
    let radius = |i: usize| radii.as_ref().map_or(uniform, |radii| radii[i]);
    if let Some(i) = (0..points.len()).find(|&i| !(radius(i) > 0.0 && radius(i).is_finite())) {
        return Err(fail(&format!("particle {i}: radius is {}; allowed: greater than 0", radius(i))));
    }

    let spread = points.spread();
    let flat = cells.is_none() && !splats && spread.z < FLAT * spread.x.min(spread.y);
    let (turn_deg, why) = match (flat, splats) {
        (true, _) => (-90.0, "z of the file is up: the cloud is flat along it"),
        (false, true) => (180.0, "y of such files points down"),
        (false, false) => (0.0, ""),
    };
    let rotation = world_from_set(DVec3::new(turn_deg, 0.0, 0.0));
    let balls = || (0..points.len()).map(|i| (rotation * points.get(i), radius(i)));
    let elevation = if flat { ELEVATION_OF_FLAT_DEG } else { ELEVATION_DEG };
    let cloud = Cloud::new(balls, elevation, options.size)
        .ok_or_else(|| fail("the coordinates are too large to be rendered"))?;

    let mut text = format!("# Made for {}: {} {}. Change what you like.\n\n", comment(name), points.len(), {
        if cells.is_some() { "cells of a volume" } else { "particles" }
    });
    text += &cloud.camera(options.size);
    let _ = write!(text, "[[particles]]\n{}", file_line(path, name));
    if let Some(grid) = &options.volume.grid {
        let _ = writeln!(text, "grid = {}", quoted(grid));
    }
    if options.volume.downsample != 1 {
        let _ = writeln!(text, "downsample = {}", options.volume.downsample);
    }
    if turn_deg != 0.0 {
        let _ = writeln!(text, "rotation_deg = [{turn_deg:?}, 0.0, 0.0]   # {why}");
    }
    let mut maps = String::new();
    for (target, axis) in ["x", "y", "z"].iter().zip(&axes).filter(|(target, axis)| target != axis) {
        let _ = writeln!(maps, "{target} = {}", quoted(axis));
    }
    text += &radius_line;
    // A Gaussian of optical depth T0 through its centre covers T0 r^2 content / K(0).
    let kernel = Kernel::default();
    let coverage = kernel.content() / kernel.chord(0.0);
    if let Some(cells) = &cells {
        let density = columns.take(&cells.density).map(|column| column.values).unwrap_or_default();
        let total: f64 = density.iter().map(|value| value.max(0.0)).sum::<f64>() * cells.volume;
        let scale = if total > 0.0 { MEAN_OPTICAL_DEPTH * cloud.area(balls) / total } else { 1.0 };
        let _ = writeln!(
            maps,
            "extinction = {{ from = {}, scale = {} }}   # optical depth {MEAN_OPTICAL_DEPTH} on the average",
            quoted(&cells.density),
            round_up(scale, 3)
        );
    } else {
        let has_opacity = columns.has("opacity");
        if let Some(line) = own_opacity(has_opacity, &read)? {
            maps += &line;
        } else {
            let total: f64 = (0..points.len()).map(|i| radius(i) * radius(i) * coverage).sum();
            let opacity = -(-MEAN_OPTICAL_DEPTH * cloud.area(balls) / total).exp_m1();
            let opacity = round_up(opacity.clamp(OPACITIES[0], OPACITIES[1]), 2).min(OPACITIES[1]);
            let _ = writeln!(text, "opacity = {opacity}   # optical depth {MEAN_OPTICAL_DEPTH} on the average");
            if has_opacity {
                let _ = writeln!(
                    maps,
                    "opacity = {{ from = \"opacity\", scale = 0.0, offset = {opacity:?} }}   # none from 0 to 1"
                );
            }
        }
    }
    drop(columns);
    let own_color = match colors {
        Some(triple) => own_color(triple, &read)?,
        None => OwnColor::None,
    };
    if let OwnColor::Bytes(line) = &own_color {
        maps += line;
    }
    if matches!(own_color, OwnColor::None) && cells.is_none() {
        // A triple that is no colour is data like any other.
        let is_free = |name: &str| !used(name) || colors.is_some_and(|triple| triple.contains(&name));
        maps += &color_line(names.iter().filter(|name| is_free(name)), &read)?;
    }
    if !maps.is_empty() {
        text += "\n[particles.columns]\n";
        text += &maps;
    }
    if splats {
        text += "\n[render]\nopacity_model = \"linear\"   # as splats fall off\n";
    }
    Ok(text)
}

/// The names of the three coordinates where they are not x, y and z.
fn axis_names(names: &[String]) -> Option<[String; 3]> {
    let prefixes = AXIS_PREFIXES.iter();
    let triples = prefixes.flat_map(|prefix| AXES.iter().map(move |ends| ends.map(|end| format!("{prefix}{end}"))));
    triples.into_iter().find(|triple| triple.iter().all(|name| names.contains(name)))
}

/// Reads the columns of these names, strictly or not.
type ReadNamed<'a> = dyn Fn(&[&str], bool) -> Result<Columns> + 'a;

/// The line for a file's own opacity, empty where it can stay as it is; `None` where there is none that can be used.
fn own_opacity(has_opacity: bool, read: &ReadNamed) -> Result<Option<String>> {
    if !has_opacity {
        return Ok(None);
    }
    let values = read(&["opacity"], false)?.take("opacity").map(|column| column.values).unwrap_or_default();
    if values.iter().all(|value| (0.0..1.0).contains(value)) {
        return Ok(Some(String::new()));
    }
    let in_range = values.iter().all(|value| (0.0..=1.0).contains(value));
    Ok(in_range.then(|| "opacity = { from = \"opacity\", max = 0.999 }   # 1 is opaque, which gas is not\n".to_owned()))
}

/// What a file's own colour is.
enum OwnColor {
    /// There is none, or its numbers are none of a colour.
    None,
    /// As a scene takes it.
    Good,
    /// From 0 to 255, with the lines that mend it.
    Bytes(String),
}

fn own_color(triple: [&str; 3], read: &ReadNamed) -> Result<OwnColor> {
    let columns = read(&triple, false)?;
    let within = |most: f64| {
        columns.iter().all(|column| column.byte || column.values.iter().all(|value| (0.0..=most).contains(value)))
    };
    // A little more than 1 is a bright colour.
    if within(4.0) {
        return Ok(OwnColor::Good);
    }
    if !within(255.0) {
        return Ok(OwnColor::None);
    }
    let line = |(target, name): (&str, &&str)| {
        format!(
            "{target} = {{ from = {}, scale = 0.00392156862745098 }}   # 0 to 255, taken as linear light\n",
            quoted(name)
        )
    };
    Ok(OwnColor::Bytes(["r", "g", "b"].into_iter().zip(&triple).map(line).collect()))
}

/// The line that names the file.
fn file_line(path: &Path, name: &str) -> String {
    let comment = if path.is_absolute() { "" } else { "   # relative to this file" };
    format!("file = {}{comment}\n", quoted(name))
}

/// The radius of particles that have none, and its line in the scene.
fn uniform_radius(points: &Points) -> (f64, String) {
    let spacing = points.mean_spacing();
    let (radius, why) = if spacing > 0.0 {
        (round_up(RADIUS_IN_SPACINGS * spacing, 2), "4/3 of the mean distance to the eighth neighbour")
    } else {
        (DEFAULT_RADIUS, "all in one place")
    };
    (radius, format!("radius = {radius:?}   # {why}\n"))
}

/// The line that maps the first of these columns that measures something to colour; empty if none does.
fn color_line<'a>(names: impl Iterator<Item = &'a String>, read: &ReadNamed) -> Result<String> {
    let mut candidates: Vec<&String> =
        names.filter(|name| !NO_MEASURES.contains(&name.to_lowercase().as_str())).collect();
    // Stable: scalars first, each kind in file order.
    candidates.sort_by_key(|name| PARTS.iter().any(|part| name.ends_with(part)));
    for candidate in candidates {
        if let Some([min, max]) = read(&[candidate], false)?.get(candidate).and_then(ends) {
            let from = quoted(candidate);
            return Ok(format!("color = {{ from = {from}, map = \"viridis\", min = {min}, max = {max} }}\n"));
        }
    }
    Ok(String::new())
}

/// The 2nd and the 98th percentile of a column that can be a colour: all numbers, and not all of them the same.
fn ends(column: &Column) -> Option<[f64; 2]> {
    let mut values = column.values.clone();
    if values.is_empty() || values.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let last = values.len() - 1;
    let mut at = |share: f64| *values.select_nth_unstable_by((last as f64 * share).round() as usize, f64::total_cmp).1;
    let [low, high] = [at(0.02), at(0.98)];
    if low < high {
        return Some([low, high]);
    }
    let [low, high] = [at(0.0), at(1.0)];
    (low < high).then_some([low, high])
}

/// Centres in the file's own space.
struct Points {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Points {
    fn len(&self) -> usize {
        self.x.len()
    }

    fn get(&self, i: usize) -> DVec3 {
        DVec3::new(self.x[i], self.y[i], self.z[i])
    }

    /// Standard deviations along x, y and z.
    fn spread(&self) -> DVec3 {
        let deviation = |values: &[f64]| {
            let count = values.len() as f64;
            let mean: f64 = values.iter().map(|value| value / count).sum();
            values.iter().map(|value| (value - mean) * (value - mean) / count).sum::<f64>().sqrt()
        };
        DVec3::new(deviation(&self.x), deviation(&self.y), deviation(&self.z))
    }

    /// Mean distance to the eighth nearest neighbour in another place (the last, if there are fewer), of a sample of the
    /// points without its nearest and farthest twentieth; 0 if there is none.
    fn mean_spacing(&self) -> f64 {
        let count = self.len();
        let asked = (DISTANCES / count.max(1)).clamp(32, 1024).min(count);
        let nearest = |i: usize| {
            // Spread over the file: its order often is one of space or time.
            let i = (i as u128 * count as u128 / asked as u128) as usize;
            let (x, y, z) = (self.x[i], self.y[i], self.z[i]);
            let mut least = [f64::INFINITY; NEIGHBOUR];
            for ((px, py), pz) in self.x.iter().zip(&self.y).zip(&self.z) {
                let (dx, dy, dz) = (px - x, py - y, pz - z);
                let squared = dx * dx + dy * dy + dz * dz;
                if squared < least[NEIGHBOUR - 1] && squared > 0.0 {
                    let place = least.partition_point(|&known| known <= squared);
                    least[place..].rotate_right(1);
                    least[place] = squared;
                }
            }
            least.into_iter().rev().find(|squared| squared.is_finite()).map(f64::sqrt)
        };
        let mut distances: Vec<f64> = (0..asked).into_par_iter().filter_map(nearest).collect();
        distances.sort_unstable_by(f64::total_cmp);
        let left_out = distances.len() / 20;
        let distances = &distances[left_out..distances.len() - left_out];
        if distances.is_empty() { 0.0 } else { distances.iter().sum::<f64>() / distances.len() as f64 }
    }
}

/// Where a cloud is and where it is looked at from.
struct Cloud {
    /// The point that is looked at, as deep as the middle of the box around the balls.
    centre: DVec3,
    /// Distance of the camera from it.
    distance: f64,
    /// Longest side of the box.
    extent: f64,
    /// Unit vectors: to the right in the picture, up in it, and towards the camera.
    right: DVec3,
    up: DVec3,
    back: DVec3,
}

impl Cloud {
    /// The cloud of these balls, seen from above by so many degrees, from as near as possible with all of every ball in
    /// both views, and a margin; `None` if there are none, or their numbers are too large.
    ///
    /// Let the axis go through (a, b) to the right of and above the middle of the box, x and y be a ball's place measured
    /// from there, z how much nearer it is than the middle. With the zero-parallax plane in the middle, at distance D, a
    /// side of the frustum of the eye at e is the plane x = d t + e (1 - d/D) with d = D - z and e = +-D/60. The ball is
    /// inside both frusta where x - a + r sqrt(1 + t^2) + |z|/60 <= (D - z) t, which is linear in a and D; the same to
    /// the left, above and below gives a, b and the least D. (The eye's own side leans by 1/60 more or less, which the
    /// root allows for.)
    fn new<I: Iterator<Item = (DVec3, f64)>>(
        balls: impl Fn() -> I,
        elevation_deg: f64,
        size: Option<[u32; 2]>,
    ) -> Option<Self> {
        const SHEAR: f64 = 0.5 / CONVERGENCE_IN_INTEROCULARS;
        let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = balls().fold(start, |(low, high), (p, r)| (low.min(p - r), high.max(p + r)));
        let (middle, extent) = (0.5 * low + 0.5 * high, (high - low).max_element());
        // The squares of distances must stay finite.
        if !(middle.is_finite() && extent < 1e100 && middle.abs().max_element() < 1e100) {
            return None;
        }
        let (azimuth, elevation) = (AZIMUTH_DEG.to_radians(), elevation_deg.to_radians());
        let back = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right);

        let [width, height] = size.unwrap_or([1024, 768]).map(f64::from);
        let t_y = (FOV_Y_DEG.to_radians() / 2.0).tan();
        let t_x = t_y * width / height;
        let root_x = (1.0 + (t_x + SHEAR) * (t_x + SHEAR)).sqrt();
        let root_y = (1.0 + t_y * t_y).sqrt();
        let mut sides = [f64::NEG_INFINITY; 4];
        let mut nearest = 0.0f64;
        for (point, radius) in balls() {
            let p = point - middle;
            let (x, y, z) = (p.dot(right), p.dot(up), p.dot(back));
            let (x_out, y_out) = (radius * root_x + z.abs() * SHEAR + z * t_x, radius * root_y + z * t_y);
            for (side, reach) in sides.iter_mut().zip([x + x_out, x_out - x, y + y_out, y_out - y]) {
                *side = side.max(reach);
            }
            nearest = nearest.max(z + 2.0 * radius);
        }
        let [to_right, to_left, above, below] = sides;
        let least = ((to_right + to_left) / (2.0 * t_x)).max((above + below) / (2.0 * t_y)).max(nearest);
        let fallback = if extent > 0.0 { extent } else { 1.0 };
        let distance = if least > 0.0 { least * MARGIN } else { fallback };
        let centre = middle + right * ((to_right - to_left) / 2.0) + up * ((above - below) / 2.0);
        Some(Self { centre, distance, extent, right, up, back })
    }

    /// Area that the centres cover in a picture without perspective, counted on a grid as coarse as the balls.
    fn area<I: Iterator<Item = (DVec3, f64)>>(&self, balls: impl Fn() -> I) -> f64 {
        const FINEST: f64 = 512.0;
        let (count, sum) = balls().fold((0.0, 0.0), |(count, sum), (_, radius)| (count + 1.0, sum + radius));
        let side = (sum / count).max(self.extent / FINEST);
        let mut covered = HashSet::new();
        for (point, _) in balls() {
            let p = point - self.centre;
            covered.insert([(p.dot(self.right) / side).floor() as i64, (p.dot(self.up) / side).floor() as i64]);
        }
        covered.len() as f64 * side * side
    }

    /// The scene file's text for the camera, the stereo rig and the background.
    fn camera(&self, size: Option<[u32; 2]>) -> String {
        let distance = self.distance;
        // As many digits as leave everything in view, relative to the distance and not to the place in the world.
        let digits = (6 - distance.log10().floor() as i32).clamp(0, 15) as usize;
        let vector = |v: DVec3| {
            let [x, y, z] = v.to_array().map(|c| number(c, digits));
            format!("[{x}, {y}, {z}]")
        };
        let mut text = format!(
            "[camera]\nposition = {}\nlook_at = {}\nfov_y_deg = {FOV_Y_DEG:?}\n",
            vector(self.centre + self.back * distance),
            vector(self.centre)
        );
        if let Some([width, height]) = size {
            let _ = writeln!(text, "size = [{width}, {height}]");
        }
        let _ = write!(
            text,
            "near = {}\n\n[stereo]\ninterocular = {}   # a thirtieth of the distance\nconvergence = {}   # the middle of the cloud\n\n\
             [background]\ncolor = [0.005, 0.01, 0.03]\n\n",
            float(round_up(distance / 1000.0, 2)),
            float(round_up(distance / CONVERGENCE_IN_INTEROCULARS, 4)),
            number(distance, digits),
        );
        text
    }
}

/// A number with so many digits after the point, and a point.
fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    if text.contains('.') { text } else { format!("{text}.0") }
}

/// The shortest text of a number that TOML reads as a float.
fn float(value: f64) -> String {
    format!("{value:?}")
}

/// The value rounded to so many significant digits, away from zero.
fn round_up(value: f64, digits: i32) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let unit = 10f64.powi(digits - 1 - value.abs().log10().floor() as i32);
    let rounded = (value * unit).ceil() / unit;
    if rounded.is_finite() { rounded } else { value }
}

/// A TOML string.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

/// Text that can stand in a TOML comment.
fn comment(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}
