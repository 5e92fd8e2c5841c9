//! From a scene's entry and the columns of a file, or a box, to a [`ParticleSet`] in world space.
//!
//! The arrays are changed in place: a column that was read becomes the set's array.

use super::color_map::{ColorMap, look_up};
use super::columns::{Cells, Column, Columns, MAX_ROWS, Selection};
use super::{READERS, VolumeOptions, read_columns};
use crate::error::{Error, Result};
use crate::picture::color::decode;
use crate::render::Progress;
use crate::scene::{Attribute, Kernel, ParticleSet, Rgb};
use glam::{DMat3, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The most particles a box may hold: 2.4 GB of coordinates.
pub const MAX_BOX_COUNT: u64 = 100_000_000;

/// One set of particles as a scene describes it: where they come from, what they lack, where they go.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleEntry {
    /// Where the centres come from.
    pub source: Source,
    /// Radius, > 0, where the file gives none; absent: [`DEFAULT_RADIUS`], for a volume [`CELL_RADIUS`] sides of a
    /// cell. In the set's own units, multiplied by `scale`; with `fit`, in scene units.
    pub radius: Option<f64>,
    /// Opacity in [0, 1) where the file gives none; a volume gives it, through its extinction.
    pub opacity: f64,
    /// Linear-light colour where the file gives none.
    pub color: Rgb,
    /// Kernel of all particles.
    pub kernel: Kernel,
    /// World-space position of the set's origin, or of its middle with `fit`.
    pub position: DVec3,
    /// Rotation about the world's axes, degrees: about x first, then y, then z.
    pub rotation_deg: DVec3,
    /// Factor of all lengths, > 0, applied before the rotation. Ignored with `fit`.
    pub scale: f64,
    /// Instead of `scale`: centre the set on the bounding box of its centres and scale it so that the longest side of
    /// that box is this long, > 0, scene units.
    pub fit: Option<f64>,
    /// Attributes that come from a column other than their own, or changed. At most one for each target; ignored for
    /// a box.
    pub columns: Vec<ColumnMap>,
    /// What to read of a volume.
    pub volume: VolumeOptions,
}

/// Radius of particles for which nothing gives one.
pub const DEFAULT_RADIUS: f64 = 0.1;

/// Radius of the particle that stands for a cell of a volume, in sides of the cell (cube root of its volume). For the
/// Gaussian kernel this is a standard deviation of 2/3: particles on a grid then add up to a constant within 1.4 %,
/// nearly all of it from the cut at three standard deviations.
pub const CELL_RADIUS: f64 = 2.0;

/// The largest opacity that an extinction becomes: denser cells show the same, since nothing of what is behind them is
/// seen at any depth of colour.
pub const MAX_OPACITY: f64 = 0.999_999;

/// Where particles come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Evenly distributed random centres in a box, [`box_positions`].
    Box {
        /// Corner with the smallest coordinates.
        min: DVec3,
        /// Corner with the largest coordinates.
        max: DVec3,
        /// Number of particles, at most [`MAX_BOX_COUNT`].
        count: u64,
        /// Seed of the random numbers.
        seed: u64,
    },
    /// A particle file of one of the [`READERS`].
    File(PathBuf),
}

/// What a column of a file may give.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Centre, x.
    X,
    /// Centre, y.
    Y,
    /// Centre, z.
    Z,
    /// Radius.
    Radius,
    /// Opacity.
    Opacity,
    /// Linear-light red.
    R,
    /// Linear-light green.
    G,
    /// Linear-light blue.
    B,
    /// All of the colour, through a colour map.
    Color,
    /// Extinction, the mean over a cell of a volume, per unit of the file's length. Decides the opacity, so that the
    /// particle's extinction integrates over space to that of the cell.
    Extinction,
}

impl Target {
    /// All targets.
    pub const ALL: &[Self] = &[
        Self::X,
        Self::Y,
        Self::Z,
        Self::Radius,
        Self::Opacity,
        Self::R,
        Self::G,
        Self::B,
        Self::Color,
        Self::Extinction,
    ];

    /// The name that scene files use. All but `r`, `g`, `b`, `color` and `extinction` are also the names of the columns that are
    /// used without a [`ColumnMap`].
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::Radius => "radius",
            Self::Opacity => "opacity",
            Self::R => "r",
            Self::G => "g",
            Self::B => "b",
            Self::Color => "color",
            Self::Extinction => "extinction",
        }
    }

    /// The target of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|target| target.name() == name)
    }
}

/// How an attribute comes from a column.
///
/// The value is `from * scale + offset`, then not below `min` and not above `max`. For [`Target::Color`] with a map,
/// `min` and `max` are instead the ends of the map, by default the smallest and the largest value of the column;
/// `min > max` turns the map round. Without a map the value is a grey in linear light. For a colour channel an 8-bit
/// column is first decoded from sRGB to linear light in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnMap {
    /// The attribute.
    pub target: Target,
    /// The column's name in the file.
    pub from: String,
    /// Factor, usually 1.
    pub scale: f64,
    /// Summand after the factor, usually 0.
    pub offset: f64,
    /// Lower bound; absent: none.
    pub min: Option<f64>,
    /// Upper bound; absent: none.
    pub max: Option<f64>,
    /// Colour map, for [`Target::Color`] alone.
    pub map: Option<ColorMap>,
}

impl ColumnMap {
    /// The column as it is.
    pub fn plain(target: Target, from: &str) -> Self {
        Self { target, from: from.to_owned(), scale: 1.0, offset: 0.0, min: None, max: None, map: None }
    }

    /// `value * scale + offset`.
    fn line(&self, value: f64) -> f64 {
        value * self.scale + self.offset
    }

    /// The number for a value of the column. Unlike `f64::clamp` this does not panic when `min > max`.
    fn number(&self, value: f64) -> f64 {
        let value = self.line(value);
        let value = self.min.map_or(value, |min| if value < min { min } else { value });
        self.max.map_or(value, |max| if value > max { max } else { value })
    }

    fn is_plain(&self) -> bool {
        self.scale == 1.0 && self.offset == 0.0 && self.min.is_none() && self.max.is_none()
    }
}

/// The particles of an entry, in world space.
///
/// `name` is what messages call the entry where no file is to blame, such as `[[particles]] 2`. Errors are
/// [`Error::Input`] and name file or entry and, where it is one particle's fault, that particle (from 0). What the file's
/// reader left out, and what else may surprise, is added to the notes.
pub fn particle_set(
    entry: &ParticleEntry,
    name: &str,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<ParticleSet> {
    match &entry.source {
        Source::Box { min, max, count, seed } => {
            let place = Path::new(name);
            let [x, y, z] = box_positions(*min, *max, *count, *seed).map_err(|message| Error::input(place, message))?;
            let set = ParticleSet {
                kernel: entry.kernel.clone(),
                x,
                y,
                z,
                radius: Attribute::Uniform(entry.radius.unwrap_or(DEFAULT_RADIUS)),
                opacity: Attribute::Uniform(entry.opacity),
                color: Attribute::Uniform(entry.color),
            };
            finish(set, entry, None, place, notes)
        }
        Source::File(path) => {
            let mut columns = read_columns(path, &selection(entry), &entry.volume, progress)?;
            let place = path.display();
            notes.extend(columns.notes.drain(..).map(|note| format!("{place}: {note}")));
            from_columns(entry, columns, path, notes)
        }
    }
}

/// The columns that an entry with a file needs.
pub fn selection(entry: &ParticleEntry) -> Selection {
    let mut names: Vec<String> = entry.columns.iter().map(|map| map.from.clone()).collect();
    let mapped = |target: Target| entry.columns.iter().any(|map| map.target == target);
    let own = |target: &Target| *target != Target::Extinction && !mapped(*target);
    names.extend(NUMBERS.into_iter().filter(own).map(|target| target.name().to_owned()));
    if !mapped(Target::Color) {
        for triple in READERS.iter().flat_map(|reader| reader.colors) {
            for (target, name) in CHANNELS.into_iter().zip(triple) {
                if !mapped(target) {
                    names.push((*name).to_owned());
                }
            }
        }
    }
    Selection::Named(names)
}

/// Targets that become arrays of f64.
const NUMBERS: [Target; 6] = [Target::X, Target::Y, Target::Z, Target::Radius, Target::Opacity, Target::Extinction];
/// Targets that are a part of the colour.
const CHANNELS: [Target; 3] = [Target::R, Target::G, Target::B];

/// The particles of an entry whose file's columns, at least those of [`selection`], have been read. What may surprise
/// is added to the notes.
pub fn from_columns(
    entry: &ParticleEntry,
    mut columns: Columns,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<ParticleSet> {
    let fail = |message: String| Error::input(path, message);
    let mapped = |target: Target| entry.columns.iter().find(|map| map.target == target);
    if columns.len() as u64 > MAX_ROWS {
        return Err(fail(format!("{} particles; allowed: at most {MAX_ROWS}", columns.len())));
    }
    let cells = columns.cells.take();
    let missing = |map: &ColumnMap| {
        let known: Vec<String> = columns.names().iter().map(|name| format!("`{name}`")).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        fail(format!("no column `{}` for {}; the file's columns: {known}", map.from, map.target.name()))
    };
    match (mapped(Target::Extinction), mapped(Target::Opacity), &cells) {
        (Some(_), _, None) => {
            return Err(fail(
                "`extinction` needs the cells of a volume, and this is a file of particles; allowed: \
                             `opacity`"
                    .to_owned(),
            ));
        }
        (Some(_), Some(_), _) => return Err(fail("`extinction` and `opacity` contradict".to_owned())),
        _ => {}
    }
    let mut numbers: Vec<ColumnMap> = Vec::with_capacity(NUMBERS.len());
    for target in NUMBERS {
        match (mapped(target), &cells) {
            (Some(map), _) => numbers.push(map.clone()),
            (None, Some(cells)) if target == Target::Extinction && mapped(Target::Opacity).is_none() => {
                numbers.push(ColumnMap::plain(target, &cells.density));
            }
            (None, _) if target == Target::Extinction => {}
            (None, cells) => {
                let own = ColumnMap::plain(target, target.name());
                let required = matches!(target, Target::X | Target::Y | Target::Z);
                // A grid may be called `radius`: it is a density all the same.
                let density = cells.as_ref().is_some_and(|cells| cells.density == own.from);
                if required || columns.has(&own.from) && !density {
                    numbers.push(own);
                }
            }
        }
    }
    if let Some(map) = numbers.iter().chain(&entry.columns).find(|map| columns.get(&map.from).is_none()) {
        return Err(missing(map));
    }
    let color = color(entry, &columns).map_err(fail)?;
    // What only the colour needed is freed before the next arrays are made.
    columns.retain(|name| numbers.iter().any(|map| map.from == name));

    let mut arrays: [Option<Vec<f64>>; NUMBERS.len()] = Default::default();
    for (i, map) in numbers.iter().enumerate() {
        let needed_again = numbers[i + 1..].iter().any(|later| later.from == map.from);
        let column = if needed_again { columns.get(&map.from).cloned() } else { columns.take(&map.from) };
        let Some(Column { mut values, .. }) = column else {
            return Err(fail(format!("no column `{}`", map.from)));
        };
        if !map.is_plain() {
            values.iter_mut().for_each(|value| *value = map.number(*value));
        }
        if let Some(slot) = NUMBERS.iter().position(|&target| target == map.target) {
            arrays[slot] = Some(values);
        }
    }
    let [x, y, z, radius, opacity, extinction] = arrays;
    let default_radius = match &cells {
        // With `fit` the entry's radius is in scene units, which this one is not: it follows the data.
        Some(cells) => CELL_RADIUS * cells.volume.cbrt(),
        None => DEFAULT_RADIUS,
    };
    let set = ParticleSet {
        kernel: entry.kernel.clone(),
        x: x.unwrap_or_default(),
        y: y.unwrap_or_default(),
        z: z.unwrap_or_default(),
        radius: radius.map_or(Attribute::Uniform(entry.radius.unwrap_or(default_radius)), Attribute::Each),
        opacity: opacity.map_or(Attribute::Uniform(entry.opacity), Attribute::Each),
        color,
    };
    finish(set, entry, cells.zip(extinction), path, notes)
}

/// The colour of the particles: through a map, from channels, the file's own, or the entry's.
fn color(entry: &ParticleEntry, columns: &Columns) -> Result<Attribute<Rgb>, String> {
    let mapped = |target: Target| entry.columns.iter().find(|map| map.target == target);
    let own = columns.color_names();
    let channels: [Option<ColumnMap>; 3] = std::array::from_fn(|c| {
        mapped(CHANNELS[c]).cloned().or_else(|| own.map(|names| ColumnMap::plain(CHANNELS[c], names[c])))
    });
    if let Some(map) = mapped(Target::Color) {
        if let Some(channel) = CHANNELS.into_iter().find(|&channel| mapped(channel).is_some()) {
            return Err(format!("the colour comes from `color` or from r, g, b, not from `{}` too", channel.name()));
        }
        let Some(column) = columns.get(&map.from) else { return Ok(Attribute::Uniform(entry.color)) };
        let Some(color_map) = map.map else {
            let decode = Decode::of(column);
            return Ok(Attribute::Each(
                column.values.iter().map(|&v| [map.number(decode.value(v)) as f32; 3]).collect(),
            ));
        };
        let ends = || {
            column.values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &value| {
                let value = map.line(value);
                [low.min(value), high.max(value)]
            })
        };
        let [low, high] = match (map.min, map.max) {
            (Some(min), Some(max)) => [min, max],
            (min, max) => {
                let [low, high] = ends();
                [min.unwrap_or(low), max.unwrap_or(high)]
            }
        };
        let table = color_map.table();
        // With low = high the quotient is NaN or infinite, which look_up takes to an end of the map.
        let look_up = |&value: &f64| look_up(&table, (map.line(value) - low) / (high - low));
        return Ok(Attribute::Each(column.values.iter().map(look_up).collect()));
    }
    if channels.iter().all(Option::is_none) {
        return Ok(Attribute::Uniform(entry.color));
    }
    let mut colors = vec![entry.color; columns.len()];
    for (c, map) in channels.iter().enumerate() {
        let Some((map, column)) = map.as_ref().and_then(|map| Some((map, columns.get(&map.from)?))) else { continue };
        let decode = Decode::of(column);
        for (color, &value) in colors.iter_mut().zip(&column.values) {
            color[c] = map.number(decode.value(value)) as f32;
        }
    }
    Ok(Attribute::Each(colors))
}

/// From a colour column's value to linear light.
enum Decode {
    /// The column is linear.
    Linear,
    /// The column holds sRGB bytes: linear light of each of them.
    Bytes(Vec<f64>),
}

impl Decode {
    fn of(column: &Column) -> Self {
        if column.byte {
            Self::Bytes((0..=255u8).map(|byte| decode(f64::from(byte) / 255.0)).collect())
        } else {
            Self::Linear
        }
    }

    fn value(&self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Bytes(table) => table.get(value as usize).copied().unwrap_or(value),
        }
    }
}

/// Transforms a set to world space, gives it the opacities of its cells' extinction, and checks it.
fn finish(
    mut set: ParticleSet,
    entry: &ParticleEntry,
    cells: Option<(Cells, Vec<f64>)>,
    place: &Path,
    notes: &mut Vec<String>,
) -> Result<ParticleSet> {
    let scale = transform(&mut set, entry, cells.is_some());
    if let Some((cells, mut extinction)) = cells {
        // In units of the file's length: an optical depth has no unit, and scaling a cloud leaves it as it is.
        let [negative, clamped] = opacity_from_extinction(&mut extinction, &cells, &set, scale)
            .map_err(|message| Error::input(place, message))?;
        if negative > 0 {
            notes.push(format!(
                "{}: {negative} of {} cells have a negative density and were taken as empty",
                place.display(),
                set.len()
            ));
        }
        if clamped > 0 {
            notes.push(format!(
                "{}: {clamped} of {} cells are denser than opacity {MAX_OPACITY} shows and were cut to it",
                place.display(),
                set.len()
            ));
        }
        set.opacity = Attribute::Each(extinction);
    }
    set.check().map_err(|message| Error::input(place, message))?;
    Ok(set)
}

/// From each cell's extinction to the opacity, in place, with which the particle's extinction integrates over space to
/// that of the cell: T0 = extinction V K(0) / (r^2 content). Returns how many were negative, as simulations overshoot, and
/// are empty now, and how many were cut to [`MAX_OPACITY`]. More negative than positive ones are an error.
///
/// The set's radii are in world units, `scale` of which are one unit of the file.
fn opacity_from_extinction(
    extinction: &mut [f64],
    cells: &Cells,
    set: &ParticleSet,
    scale: f64,
) -> Result<[usize; 2], String> {
    const PIECE: usize = 1 << 14;
    let factor = cells.volume * set.kernel.chord(0.0) / set.kernel.content();
    let piece = |(number, values): (usize, &mut [f64])| {
        let [mut negative, mut clamped, mut positive] = [0; 3];
        for (i, value) in (number * PIECE..).zip(values) {
            if *value < 0.0 {
                negative += 1;
                *value = 0.0;
                continue;
            }
            positive += usize::from(*value > 0.0);
            let radius = set.radius.get(i) / scale;
            let optical_depth = *value * factor / (radius * radius);
            *value = -(-optical_depth).exp_m1();
            // Not a number where the radius is 0, which the check of the set reports.
            if *value > MAX_OPACITY {
                *value = MAX_OPACITY;
                clamped += 1;
            }
        }
        [negative, clamped, positive]
    };
    let pieces = extinction.par_chunks_mut(PIECE).enumerate().map(piece);
    let [negative, clamped, positive] = pieces.reduce(|| [0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    if negative > positive {
        return Err(format!(
            "{negative} of {} cells have a negative extinction; allowed: 0 or more (a fog volume, not distances)",
            extinction.len()
        ));
    }
    Ok([negative, clamped])
}

/// From the set's own space to world space, in place: p_world = R (scale p) + position. Returns the scale.
fn transform(set: &mut ParticleSet, entry: &ParticleEntry, is_volume: bool) -> f64 {
    let (centre, scale) = match entry.fit {
        Some(length) => {
            let [x, y, z] = [&set.x, &set.y, &set.z].map(|values| bounds(values));
            let (low, high) = (DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1]));
            let extent = (high - low).max_element();
            // One point, or several in one place, have no extent to scale.
            let scale = if extent > 0.0 { length / extent } else { 1.0 };
            // Halved first, so that the sum of large coordinates is finite.
            (low * 0.5 + high * 0.5, scale)
        }
        None => (DVec3::ZERO, entry.scale),
    };
    match (&mut set.radius, entry.fit) {
        (Attribute::Each(values), _) => values.iter_mut().for_each(|radius| *radius *= scale),
        (Attribute::Uniform(radius), None) => *radius *= scale,
        (Attribute::Uniform(radius), Some(_)) if is_volume && entry.radius.is_none() => *radius *= scale,
        // In scene units already: the file's unit, which the factor converts, is unknown.
        (Attribute::Uniform(_), Some(_)) => {}
    }
    let rotation = world_from_set(entry.rotation_deg);
    let position = entry.position;
    if rotation == DMat3::IDENTITY && scale == 1.0 && centre == DVec3::ZERO && position == DVec3::ZERO {
        return scale;
    }
    for ((x, y), z) in set.x.iter_mut().zip(&mut set.y).zip(&mut set.z) {
        let point = rotation * ((DVec3::new(*x, *y, *z) - centre) * scale) + position;
        (*x, *y, *z) = (point.x, point.y, point.z);
    }
    scale
}

/// The rotation Rz Ry Rx, angles in degrees: about x first, about z last, all about the fixed axes of the world.
pub fn world_from_set(rotation_deg: DVec3) -> DMat3 {
    let turn = DVec3::new(rotation_deg.x.to_radians(), rotation_deg.y.to_radians(), rotation_deg.z.to_radians());
    DMat3::from_rotation_z(turn.z) * DMat3::from_rotation_y(turn.y) * DMat3::from_rotation_x(turn.x)
}

/// Smallest and largest value; [0, 0] of nothing.
fn bounds(values: &[f64]) -> [f64; 2] {
    let Some(&first) = values.first() else { return [0.0; 2] };
    values.iter().fold([first; 2], |[low, high], &value| [low.min(value), high.max(value)])
}

/// Coordinates x, y and z of `count` random points, evenly distributed in a box.
///
/// The numbers are part of the scene format, so that pictures outlive library upgrades. The key of ChaCha with 8 rounds
/// is the seed in little-endian order followed by 24 zero bytes, stream and counter are 0. Every point takes 24 bytes of
/// the key stream, three little-endian 64-bit words u for x, y and z: t = (u >> 11) 2^-53 in [0, 1),
/// coordinate = min + t (max - min).
pub fn box_positions(min: DVec3, max: DVec3, count: u64, seed: u64) -> Result<[Vec<f64>; 3], String> {
    /// Bytes of the key stream for one point.
    const POINT: usize = 24;
    const POINTS_PER_BLOCK: usize = 1 << 10;
    if count > MAX_BOX_COUNT {
        return Err(format!("count is {count}; allowed: at most {MAX_BOX_COUNT}"));
    }
    let mut axes: [Vec<f64>; 3] = Default::default();
    for axis in &mut axes {
        axis.try_reserve_exact(count as usize).map_err(|_| format!("not enough memory for {count} particles"))?;
    }
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut random = ChaCha8Rng::from_seed(key);
    let [x, y, z] = &mut axes;
    let size = max - min;
    let unit = |word: u64| (word >> 11) as f64 * (1.0 / (1u64 << 53) as f64);
    // A block of the key stream at once is faster than word by word.
    let mut block = vec![0; POINT * POINTS_PER_BLOCK];
    let mut left = count as usize;
    while left > 0 {
        let points = left.min(POINTS_PER_BLOCK);
        let block = &mut block[..POINT * points];
        random.fill_bytes(block);
        for (axis, (values, (min, size))) in
            [&mut *x, &mut *y, &mut *z].into_iter().zip([(min.x, size.x), (min.y, size.y), (min.z, size.z)]).enumerate()
        {
            values.extend(block.chunks_exact(POINT).map(|point| {
                let mut word = [0; 8];
                word.copy_from_slice(&point[8 * axis..8 * axis + 8]);
                min + unit(u64::from_le_bytes(word)) * size
            }));
        }
        left -= points;
    }
    Ok(axes)
}
