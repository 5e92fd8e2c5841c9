//! FROM WHERE: scene files, particle files, mesh files.
//!
//! A particle format is one file with a `read` function and one row of [`READERS`].

pub mod color_map;
pub mod columns;
pub mod csv;
mod file;
pub mod gltf;
pub mod init;
mod load;
pub mod mesh;
pub mod npy;
pub mod obj;
pub mod particles;
pub mod ply;
mod polygon;
pub mod population;
pub mod profile;
mod scalar;
pub mod scene_file;
mod source;
pub mod survey;
mod texture;
pub mod vdb;
pub mod vtk;
pub mod vtp;

pub use color_map::{COLOR_MAPS, ColorMap};
pub use columns::{Cells, Column, Columns, ReadError, Selection};
pub use load::{SceneInput, load_scene};
pub use mesh::{MESH_READERS, MeshReader};
pub use particles::{ColumnMap, ParticleEntry, Source, Target, particle_set};
pub use profile::read_profile;

use crate::error::{Error, Result};
use crate::render::Progress;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
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
    /// What it holds, and the function that reads it.
    pub content: Content,
}

impl Reader {
    /// Reads the selected columns from the beginning of a file whose size in bytes is given if known.
    pub fn read(
        &self,
        input: &mut dyn BufRead,
        size: Option<u64>,
        selection: &Selection,
        volume: &VolumeOptions,
    ) -> Result<Columns, ReadError> {
        match self.content {
            Content::Table(_) if *volume != VolumeOptions::default() => {
                let volumes = READERS.iter().filter(|reader| matches!(reader.content, Content::Volume(_)));
                let extensions: Vec<String> =
                    volumes.flat_map(|reader| reader.extensions).map(|name| format!(".{name}")).collect();
                Err(ReadError::content(format!(
                    "`grid` and `downsample` are for volumes ({}); this is a file of particles ({})",
                    extensions.join(", "),
                    self.name
                )))
            }
            Content::Table(read) => read(input, size, selection),
            Content::Volume(read) => read(input, size, selection, volume),
        }
    }
}

/// Reads the selected columns of a file of particles.
pub type ReadTable = fn(&mut dyn BufRead, Option<u64>, &Selection) -> Result<Columns, ReadError>;
/// Reads a volume as particles, with the selected columns.
pub type ReadVolume = fn(&mut dyn BufRead, Option<u64>, &Selection, &VolumeOptions) -> Result<Columns, ReadError>;

/// The two kinds of particle formats.
#[derive(Clone, Copy, Debug)]
pub enum Content {
    /// A row for every particle.
    Table(ReadTable),
    /// A grid of densities, of which every active voxel, or block of them, becomes a particle.
    Volume(ReadVolume),
}

/// What is read of a volume, and how finely. Ignored for files of particles but that they may not be set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VolumeOptions {
    /// Name of the grid; absent: the only one, or the one called `density`.
    pub grid: Option<String>,
    /// Voxels along each side of the block that becomes one particle, at least 1.
    pub downsample: u32,
}

impl Default for VolumeOptions {
    fn default() -> Self {
        Self { grid: None, downsample: 1 }
    }
}

/// The formats that particles are read from.
pub const READERS: &[Reader] = &[
    Reader {
        name: "csv",
        extensions: &["csv"],
        help: "comma-separated text with a header line: x,y,z and, if present, radius,opacity,r,g,b (linear light)",
        detect: |_| false,
        colors: csv::COLORS,
        content: Content::Table(csv::read),
    },
    Reader {
        name: "ply",
        extensions: &["ply"],
        help: "PLY, ascii or binary: x, y, z of the element vertex and, if present, radius, opacity, red, green, blue; or \
               3D Gaussian splats, which become round particles",
        detect: ply::detect,
        colors: ply::COLORS,
        content: Content::Table(ply::read),
    },
    Reader {
        name: "vtk",
        extensions: &["vtk"],
        help: "legacy VTK, ASCII or BINARY, POLYDATA or UNSTRUCTURED_GRID: the points as x, y, z and their data",
        detect: vtk::detect,
        colors: vtk::COLORS,
        content: Content::Table(vtk::read),
    },
    Reader {
        name: "vtp",
        extensions: &["vtp", "vtu"],
        help: "XML VTK, PolyData or UnstructuredGrid: the points as x, y, z and their data",
        detect: vtp::detect,
        colors: vtp::COLORS,
        content: Content::Table(vtp::read),
    },
    Reader {
        name: "npy",
        extensions: &["npy"],
        help: "NumPy array of shape (N, 3), x, y, z, or up to (N, 8) with radius, opacity, r, g, b (linear light), or \
               structured with named fields",
        detect: npy::detect,
        colors: npy::COLORS,
        content: Content::Table(npy::read),
    },
    Reader {
        name: "vdb",
        extensions: &["vdb"],
        help: "OpenVDB fog volume: every active voxel of a grid of float or double numbers, or every block of voxels",
        detect: vdb::detect,
        colors: &[],
        content: Content::Volume(vdb::read),
    },
];

/// Reads the selected columns of a particle file or a volume. The format is told by the content, failing that by the
/// extension.
///
/// Every error is an [`Error::Input`] that names the file.
pub fn read_columns(
    path: &Path,
    selection: &Selection,
    volume: &VolumeOptions,
    progress: &dyn Progress,
) -> Result<Columns> {
    let fail = |message: String| Error::input(path, message);
    let file = File::open(path).map_err(|error| fail(format!("cannot open: {error}")))?;
    // The size of what is no regular file (a pipe) says nothing about its content.
    let metadata = file.metadata().map_err(|error| fail(format!("cannot open: {error}")))?;
    let size = metadata.is_file().then_some(metadata.len());
    let file = Watched { file, done: 0, size: size.unwrap_or(u64::MAX), progress };
    let mut input = BufReader::with_capacity(1 << 18, file);
    let head = input.fill_buf().map_err(|error| fail(format!("cannot read: {error}")))?;
    let reader = find_reader(head, path).ok_or_else(|| {
        let known: Vec<String> =
            READERS.iter().map(|reader| format!("  .{}: {}", reader.extensions.join(", ."), reader.help)).collect();
        fail(format!("unknown particle format; allowed:\n{}", known.join("\n")))
    })?;
    reader.read(&mut input, size, selection, volume).map_err(|error| fail(error.to_string()))
}

/// What a file given on the command line is.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A scene file, or something that is to be reported as a wrong one.
    Scene,
    /// A file of particles or a volume, of this format.
    Particles(&'static Reader),
    /// A mesh of this format.
    Mesh(&'static MeshReader),
}

/// What a file is, by its content, failing that by its extension. A PLY file with faces is a mesh. Only the beginning of
/// a regular file is looked at: a pipe can be read but once.
///
/// # Errors
/// [`Error::Input`] for a file of no known format, with the list of those, and for data that is no regular file.
pub fn kind(path: &Path) -> Result<Kind> {
    const HEAD: u64 = 1 << 16;
    let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
    let mut head = Vec::new();
    if is_file {
        // What cannot be read is reported by the one who needs it.
        let _ = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default();
    if extension == "toml" {
        return Ok(Kind::Scene);
    }
    let mesh = MESH_READERS.iter().find(|reader| reader.extensions.contains(&extension.as_str()));
    let reader = find_reader(&head, path);
    if (reader.is_some() || mesh.is_some()) && !is_file && path.exists() {
        return Err(Error::input(
            path,
            "not a regular file; allowed: a file, which is read more than once to make a scene for it; a scene file may \
             name what can be read but once",
        ));
    }
    // A table of a TOML file stands in brackets, at the beginning of a line.
    let is_scene = extension.is_empty() || head.starts_with(b"[") || head.windows(2).any(|pair| pair == b"\n[");
    match (reader, mesh) {
        (Some(reader), Some(_)) if !ply::has_faces(&head) => Ok(Kind::Particles(reader)),
        (_, Some(mesh)) => Ok(Kind::Mesh(mesh)),
        (Some(reader), None) => Ok(Kind::Particles(reader)),
        // No text has a NUL. What does not exist is reported by the one who needs it.
        (None, None) if is_file && (head.contains(&0) || !is_scene && !head.is_empty()) => {
            let list =
                |extensions: Vec<&str>| extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(", ");
            Err(Error::input(
                path,
                format!(
                    "unknown format; allowed: a scene file (.toml), particles or a volume ({}), a mesh ({})",
                    list(READERS.iter().flat_map(|reader| reader.extensions).copied().collect()),
                    list(MESH_READERS.iter().flat_map(|reader| reader.extensions).copied().collect())
                ),
            ))
        }
        (None, None) => Ok(Kind::Scene),
    }
}

/// A file that reports how much of it has been read.
struct Watched<'a> {
    file: File,
    done: u64,
    size: u64,
    progress: &'a dyn Progress,
}

impl Read for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        self.done += count as u64;
        self.progress.update(self.done, self.size);
        Ok(count)
    }
}

/// The reader for a file of this name that begins with these bytes.
fn find_reader(head: &[u8], path: &Path) -> Option<&'static Reader> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let named = |reader: &&Reader| reader.extensions.iter().any(|known| known.eq_ignore_ascii_case(extension));
    READERS.iter().find(|reader| (reader.detect)(head)).or_else(|| READERS.iter().find(named))
}
