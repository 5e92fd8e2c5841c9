//! FROM WHERE: scene files, particle files, mesh files.
//!
//! A particle format is one file with a `read` function and one row of [`READERS`].

pub mod color_map;
pub mod columns;
pub mod csv;
pub mod gltf;
mod load;
pub mod mesh;
pub mod particles;
pub mod ply;
pub mod profile;
pub mod scene_file;

pub use color_map::{COLOR_MAPS, ColorMap};
pub use columns::{Column, Columns, ReadError, Selection};
pub use load::{SceneInput, load_scene};
pub use particles::{ColumnMap, ParticleEntry, Source, Target, particle_set};
pub use profile::read_profile;

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// A format that particles are read from.
#[derive(Debug)]
pub struct Reader {
    /// Name of the format.
    pub name: &'static str,
    /// File name extensions, lower case, without the dot.
    pub extensions: &'static [&'static str],
    /// One line for help texts.
    pub help: &'static str,
    /// Whether a file that begins with these bytes is of this format, whatever its name; never true for a format
    /// without a signature.
    pub detect: fn(&[u8]) -> bool,
    /// Triples of column names that mean colour in this format, best first.
    pub colors: &'static [[&'static str; 3]],
    /// Reads the selected columns from the beginning of a file whose size in bytes is given if known.
    pub read: fn(&mut dyn BufRead, Option<u64>, &Selection) -> Result<Columns, ReadError>,
}

/// The formats that particles are read from.
pub const READERS: &[Reader] = &[
    Reader {
        name: "csv",
        extensions: &["csv"],
        help: "comma-separated text with a header line: x,y,z and, if present, radius,opacity,r,g,b (linear light)",
        detect: |_| false,
        colors: csv::COLORS,
        read: csv::read,
    },
    Reader {
        name: "ply",
        extensions: &["ply"],
        help: "PLY, ascii or binary: x, y, z of the element vertex and, if present, radius, opacity, red, green, blue",
        detect: ply::detect,
        colors: ply::COLORS,
        read: ply::read,
    },
];

/// Reads the selected columns of a particle file. The format is told by the content, failing that by the extension.
///
/// Every error is an [`Error::Input`] that names the file.
pub fn read_columns(path: &Path, selection: &Selection) -> Result<Columns> {
    let fail = |message: String| Error::input(path, message);
    let file = File::open(path).map_err(|error| fail(format!("cannot open: {error}")))?;
    // The size of what is no regular file (a pipe) says nothing about its content.
    let metadata = file.metadata().map_err(|error| fail(format!("cannot open: {error}")))?;
    let size = metadata.is_file().then_some(metadata.len());
    let mut input = BufReader::with_capacity(1 << 16, file);
    let head = input.fill_buf().map_err(|error| fail(format!("cannot read: {error}")))?;
    let reader = find_reader(head, path).ok_or_else(|| {
        let known: Vec<String> =
            READERS.iter().map(|reader| format!("  .{}: {}", reader.extensions.join(", ."), reader.help)).collect();
        fail(format!("unknown particle format; allowed:\n{}", known.join("\n")))
    })?;
    (reader.read)(&mut input, size, selection).map_err(|error| fail(error.to_string()))
}

/// The reader for a file of this name that begins with these bytes.
fn find_reader(head: &[u8], path: &Path) -> Option<&'static Reader> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let named = |reader: &&Reader| reader.extensions.iter().any(|known| known.eq_ignore_ascii_case(extension));
    READERS.iter().find(|reader| (reader.detect)(head)).or_else(|| READERS.iter().find(named))
}
