//! Particles from OpenVDB files: the active voxels of one grid of floating-point numbers, or blocks of them
//! (K. Museth, *VDB: High-Resolution Sparse Volumes with Dynamic Topology*, 2013; the format is that of OpenVDB's
//! `io/Archive.cc`, `io/Compression.h` and `tree/*Node.h`, <https://github.com/AcademySoftwareFoundation/openvdb>).
//!
//! Versions 220 to 224, with any of OpenVDB's compressions (zip, Blosc with lz4 or zlib, active mask), grids of `float`
//! and `double` in the usual tree, also stored with 16 bits, all linear transforms. Voxel centres have integer index
//! coordinates. Inactive voxels are empty space, whatever their value; active ones count, zeros included, and active
//! tiles are all of their voxels.
//!
//! The order is that of the file: tiles, which stand in the topology, then the voxels of leaves; blocks in the order in
//! which these come upon them.
//!
//! Why an own reader: `vdb-rs` panics and reserves gigabytes on damaged files, gives an active tile only once whatever
//! its size, needs a file that it can seek in, and does not read old versions, nor zlib in Blosc. OpenVDB itself is a
//! C++ library. Here the topology, whose size the file proves, is read and counted before anything is reserved for
//! voxels.

mod blocks;
mod blosc;
mod bytes;
mod header;
mod limits;
mod transform;
mod tree;
mod values;
mod voxels;

use super::VolumeOptions;
use super::columns::{Cells, Column, Columns, ReadError, Selection};
use super::scalar::Scalar;
use blocks::{BLOCK_BYTES, Blocks};
use bytes::Input;
use header::{Descriptor, GridHead, Header, MAGIC};
use limits::Limits;
use std::io::BufRead;
use tree::{Census, LEAF_WORDS, Reader, Sink, Tiles};
use values::Values;
use voxels::{Rows, Voxels};

/// The grid that is read if a file has several and none is asked for; also the column's name of a grid without one.
const DENSITY: &str = "density";
/// Names of the coordinates, which no other column may have.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Types of grids that are read.
const KINDS: [(&str, Scalar); 2] = [("Tree_float_5_4_3", Scalar::F32), ("Tree_double_5_4_3", Scalar::F64)];
/// Names of the longest list of grids in a message.
const LONGEST_LIST: usize = 20;

/// Whether a file that begins like this is a VDB file.
pub fn detect(head: &[u8]) -> bool {
    head.starts_with(&MAGIC)
}

/// Reads the active voxels of a grid, or blocks of them.
///
/// The columns are x, y and z, voxel centres or centroids of blocks in the units of the file, and the values under the
/// name of the grid, `density` where that is empty or taken. The latter is read whether or not it is selected.
/// [`Columns::cells`] is set.
///
/// `size` is the number of bytes of the whole file, if known: counts that cannot fit are then refused before anything
/// is allocated. Errors name the byte offset, those of values the voxel.
pub fn read(
    reader: &mut dyn BufRead,
    size: Option<u64>,
    selection: &Selection,
    volume: &VolumeOptions,
) -> Result<Columns, ReadError> {
    if volume.downsample == 0 {
        return Err(ReadError::content("`downsample` is 0; allowed: a whole number from 1"));
    }
    let mut input = Input::new(reader, 0, size);
    let header = Header::read(&mut input)?;
    File { header, selection, volume, kept: Vec::new(), seen: Vec::new() }.read(&mut input)
}

/// A file while its grids are gone through.
struct File<'a> {
    header: Header,
    selection: &'a Selection,
    volume: &'a VolumeOptions,
    /// Grids that may turn out to be the one that is wanted, or to share their tree with it, as the file has them.
    kept: Vec<(Descriptor, Vec<u8>)>,
    /// What the file has.
    seen: Vec<Descriptor>,
}

/// The number type of a grid that can be read.
fn scalar(descriptor: &Descriptor) -> Option<Scalar> {
    KINDS.iter().find(|(kind, _)| *kind == descriptor.kind).map(|&(_, scalar)| scalar)
}

/// Grids with their types, for messages.
fn list<'a>(grids: impl IntoIterator<Item = &'a Descriptor>) -> String {
    let names: Vec<String> =
        grids.into_iter().map(|grid| format!("{} ({})", grid.display(), grid.short_kind())).collect();
    let more = names.len().saturating_sub(LONGEST_LIST);
    let shown = names[..names.len() - more].join(", ");
    match (names.len(), more) {
        (0, _) => "none".to_owned(),
        (_, 0) => shown,
        _ => format!("{shown} and {more} more"),
    }
}

impl File<'_> {
    fn read(mut self, input: &mut Input) -> Result<Columns, ReadError> {
        let mut result: Option<(Columns, Descriptor)> = None;
        for _ in 0..self.header.grids {
            let descriptor = Descriptor::read(input, &self.header)?;
            if result.is_none() && self.is_wanted(&descriptor) {
                result = Some((self.read_here(input, &descriptor)?, descriptor.clone()));
                self.kept = Vec::new();
                if !self.header.has_offsets {
                    // Where the other grids end is not known without reading them.
                    break;
                }
                input.skip(descriptor.end.saturating_sub(input.position()), "a grid")?;
            } else {
                self.pass(input, &descriptor, result.is_some())?;
            }
            self.seen.push(descriptor);
        }
        let (mut columns, chosen) = match result {
            Some(found) => found,
            None => self.read_only()?,
        };
        let others = self.seen.iter().filter(|grid| grid.start != chosen.start);
        if others.clone().any(|grid| grid.name() == chosen.name()) {
            let name = chosen.name();
            let message =
                format!("several grids are called `{name}`: the first was read; others are `{name}[1]` and so on");
            // Not so if the user has asked for a later one.
            if self.volume.grid.as_deref().is_none_or(|asked| asked == name) {
                columns.notes.push(message);
            }
        }
        if others.clone().next().is_some() {
            columns.notes.push(format!("grids not read: {}", list(others)));
        }
        Ok(columns)
    }

    /// Whether this is the grid to read, as far as can be said before the others are known.
    fn is_wanted(&self, descriptor: &Descriptor) -> bool {
        match &self.volume.grid {
            Some(name) => descriptor.is_called(name),
            None => scalar(descriptor).is_some() && (descriptor.name() == DENSITY || self.header.grids == 1),
        }
    }

    /// Reads the grid at whose beginning the stream stands.
    fn read_here(&mut self, input: &mut Input, descriptor: &Descriptor) -> Result<Columns, ReadError> {
        let Some(scalar) = scalar(descriptor) else {
            let allowed: Vec<&str> = KINDS.iter().map(|(kind, _)| *kind).collect();
            return Err(ReadError::content(format!(
                "grid `{}` is of type {} ({}), which is not supported; allowed: {}, also with 16 bits",
                descriptor.display(),
                descriptor.short_kind(),
                descriptor.kind.chars().filter(|c| !c.is_control()).take(80).collect::<String>(),
                allowed.join(", ")
            )));
        };
        let head = GridHead::read(input, &self.header, descriptor)?;
        if descriptor.parent().is_none() {
            return self.read_tree(input, descriptor, &head, &head, scalar);
        }
        // The tree is that of an earlier grid.
        let parent = self.kept.iter().find(|(other, _)| descriptor.shares_tree_of(other));
        let Some((parent, bytes)) = parent else {
            return Err(ReadError::content(format!(
                "grid `{}` shares the tree of a grid that is not before it in the file; allowed: one of {}",
                descriptor.display(),
                list(self.kept.iter().map(|(grid, _)| grid))
            )));
        };
        if parent.kind != descriptor.kind || parent.parent().is_some() {
            return Err(ReadError::content(format!(
                "grid `{}` shares the tree of `{}`, which has none of the same type",
                descriptor.display(),
                parent.display()
            )));
        }
        let mut bytes = &bytes[..];
        let mut input = Input::new(&mut bytes, parent.start, Some(parent.end));
        let parent_head = GridHead::read(&mut input, &self.header, parent)?;
        self.read_tree(&mut input, descriptor, &head, &parent_head, scalar)
    }

    /// Passes over a grid, or keeps it for later.
    fn pass(&mut self, input: &mut Input, descriptor: &Descriptor, is_done: bool) -> Result<(), ReadError> {
        let name = descriptor.display();
        if self.header.has_offsets {
            let bytes = descriptor.end - descriptor.start;
            if is_done || scalar(descriptor).is_none() {
                return input.skip(bytes, &format!("grid `{name}`"));
            }
            let bytes = input.take(bytes, &format!("grid `{name}`"))?;
            self.kept.push((descriptor.clone(), bytes));
            return Ok(());
        }
        // Without offsets it has to be read, if only to know where it ends.
        let Some(scalar) = scalar(descriptor) else {
            return Err(input.wrong(format_args!(
                "grid `{name}` is of type {}, and the file does not say where it ends, so that nothing behind it can be \
                 found; allowed: float and double, or a file written with offsets (openvdb::io::File, not Stream)",
                descriptor.short_kind()
            )));
        };
        let head = GridHead::read(input, &self.header, descriptor)?;
        if descriptor.parent().is_none() {
            let values = Values::new(self.header.version, head.compression, scalar, head.half);
            Reader::new(input, values, &name, true).read(&mut Nothing)?;
        }
        Ok(())
    }

    /// Reads the only grid that can be read, all having been passed.
    fn read_only(&mut self) -> Result<(Columns, Descriptor), ReadError> {
        let all = list(&self.seen);
        if let Some(name) = &self.volume.grid {
            return Err(ReadError::content(format!("no grid `{name}`; the file's grids: {all}")));
        }
        let readable = self.seen.iter().filter(|grid| scalar(grid).is_some()).count();
        match (readable, self.kept.pop()) {
            (0, _) => Err(ReadError::content(format!("no grid of float or double numbers; the file's grids: {all}"))),
            (1, Some((descriptor, bytes))) => {
                let mut bytes = &bytes[..];
                let mut input = Input::new(&mut bytes, descriptor.start, Some(descriptor.end));
                let columns = self.read_here(&mut input, &descriptor)?;
                Ok((columns, descriptor))
            }
            _ => Err(ReadError::content(format!(
                "none of the file's grids is called `{DENSITY}`; choose one with `grid`: {all}"
            ))),
        }
    }

    /// Reads the tree at which the stream stands, stored as `stored` says, as that of a grid.
    fn read_tree(
        &self,
        input: &mut Input,
        descriptor: &Descriptor,
        head: &GridHead,
        stored: &GridHead,
        scalar: Scalar,
    ) -> Result<Columns, ReadError> {
        let name = descriptor.display();
        if head.is_level_set {
            return Err(ReadError::content(format!(
                "grid `{name}` is a level set: distances to a surface, not densities; convert it to a fog volume, as \
                 openvdb::tools::sdfToFogVolume and Houdini's Convert VDB do"
            )));
        }
        let column = match descriptor.name() {
            name if name.is_empty() || AXES.contains(&name) => DENSITY,
            name => name,
        };
        let downsample = self.volume.downsample;
        let transform = head.transform.clone();
        let volume = transform.voxel_volume() * f64::from(downsample).powi(3);
        if !volume.is_finite() {
            let message = format!("`downsample` is {downsample}: a block of grid `{name}` has the volume {volume}");
            return Err(ReadError::content(message));
        }
        let voxel_size = transform.voxel_size();
        let axes = AXES.map(|axis| self.selection.wants(axis).then(Vec::new));
        let row_bytes = (8 * (1 + axes.iter().flatten().count())) as u64;
        let rows = Rows { transform, axes, values: Vec::new(), sum: 0.0 };
        let limits = Limits { name: name.clone(), row_bytes, block_bytes: BLOCK_BYTES, downsample };
        let lenient = self.selection.is_lenient();
        let values = Values::new(self.header.version, stored.compression, scalar, stored.half);
        let mut reader = Reader::new(input, values, &name, lenient);
        let (census, rows) = if downsample == 1 {
            let mut voxels = Voxels::new(rows, limits);
            (reader.read(&mut voxels)?, voxels.rows)
        } else {
            let mut blocks = Blocks::new(rows, limits);
            (reader.read(&mut blocks)?, blocks.finish(lenient)?)
        };

        let count = rows.values.len();
        let sum = rows.sum;
        let named = AXES.iter().zip(rows.axes).filter_map(|(name, values)| Some((*name, values?)));
        let columns = named.chain([(column, rows.values)]).map(|(name, values)| Column {
            name: name.to_owned(),
            values,
            byte: false,
        });
        let names = AXES.iter().copied().chain([column]).map(str::to_owned).collect();
        let mut columns = Columns::new(columns.collect(), names, count, &[])?;
        columns.cells = Some(Cells { density: column.to_owned(), volume });
        let [x, y, z] = voxel_size.map(short);
        let mut note =
            format!("grid `{name}`: {} active voxels, sum {}, voxel size {x} x {y} x {z}", census.voxels(), short(sum));
        if downsample > 1 {
            let n = downsample;
            note += &format!("; read as {count} blocks of {n} x {n} x {n} voxels");
        }
        columns.notes.push(note);
        Ok(columns)
    }
}

/// A number for a note: six digits of it.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    if rounded == 0.0 || (1e-4..1e9).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// Passes over a tree.
struct Nothing;

impl Sink for Nothing {
    fn tiles(&mut self, _: &Tiles, _: &Input) -> Result<(), ReadError> {
        Ok(())
    }

    fn begin(&mut self, _: &Census, _: &Input) -> Result<(), ReadError> {
        Ok(())
    }

    fn leaf(&mut self, _: [i32; 3], _: &[u64; LEAF_WORDS], _: &[f64]) -> Result<(), ReadError> {
        Ok(())
    }
}
