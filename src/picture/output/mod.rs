//! Image files: what encodes a picture, and how a file comes to stand under its name.
//!
//! Adding an image format is a file with its function and a row of [`WRITERS`].
//!
//! Files are written to a temporary name in their folder and renamed, so nothing half-written ever has the final name.
//! What is no regular file (`-` for standard output, a pipe, /dev/null) is written straight.

mod exr;
mod jpeg;
mod png;

use std::fs::{self, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::picture::Picture;

/// One image format.
#[derive(Debug)]
pub struct Writer {
    /// Name on the command line.
    pub name: &'static str,
    /// Extension of its files, without the dot.
    pub extension: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// The largest width and height that the format holds.
    pub longest: u32,
    /// The whole file's bytes; the same for the same picture, always. The error is one line without the file's name.
    pub encode: fn(&Picture) -> Result<Vec<u8>, String>,
}

/// Every image format, in the order that help shows; the first is the default.
pub const WRITERS: &[Writer] = &[
    Writer { name: "png", extension: "png", help: "8-bit sRGB PNG", longest: i32::MAX as u32, encode: png::encode_8 },
    Writer {
        name: "png16",
        extension: "png",
        help: "16-bit sRGB PNG",
        longest: i32::MAX as u32,
        encode: png::encode_16,
    },
    Writer {
        name: "exr",
        extension: "exr",
        help: "32-bit float linear OpenEXR, not clamped, with alpha",
        longest: i32::MAX as u32,
        encode: exr::encode,
    },
    Writer {
        name: "jpg",
        extension: "jpg",
        help: "JPEG, quality 95, colour at full resolution",
        longest: jpeg::LONGEST,
        encode: jpeg::encode,
    },
];

/// The writer of that name. [`Error::Usage`] lists the names there are.
pub fn writer(name: &str) -> Result<&'static Writer> {
    WRITERS.iter().find(|w| w.name == name).ok_or_else(|| {
        let names: Vec<_> = WRITERS.iter().map(|w| w.name).collect();
        Error::Usage(format!("there is no image format `{name}`; there are {}", names.join(", ")))
    })
}

/// The writer that a path's extension asks for, in any case; 8-bit PNG for what is no regular file and has none.
///
/// [`Error::Output`] for any other extension, with those there are.
pub fn writer_for(path: &Path) -> Result<&'static Writer> {
    let Some(extension) = path.extension() else {
        return match place(path) {
            Place::Stdout | Place::Straight => Ok(&WRITERS[0]),
            Place::Regular | Place::Folder => {
                Err(Error::output(path, format!("the name has no extension ({}); name an image format", extensions())))
            }
        };
    };
    let extension = extension.to_string_lossy().to_lowercase();
    // The one extension that people write in two ways.
    let extension = if extension == "jpeg" { "jpg" } else { &extension };
    WRITERS.iter().find(|w| w.extension == extension).ok_or_else(|| {
        Error::output(path, format!("no image format has the extension `.{extension}` ({})", extensions()))
    })
}

/// The table's extensions, for messages.
fn extensions() -> String {
    let mut list: Vec<String> = WRITERS.iter().map(|w| format!(".{}", w.extension)).collect();
    list.dedup();
    list.join(", ")
}

/// One file to write with [`write_all`].
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The file; `-` is standard output.
    pub path: &'a Path,
    /// What it holds.
    pub content: Content<'a>,
}

/// What a [`Job`] writes.
#[derive(Clone, Copy, Debug)]
pub enum Content<'a> {
    /// A picture in an image format.
    Picture(&'a Picture, &'a Writer),
    /// These bytes.
    Bytes(&'a [u8]),
}

/// Encodes and writes several files in parallel, all or nothing: no file gets its name before every one of them lies
/// complete under a temporary name.
///
/// The error is that of the first job, in their order, that failed, however the threads ran.
pub fn write_all(jobs: &[Job]) -> Result<()> {
    let staged: Vec<Result<Staged>> = jobs
        .par_iter()
        .map(|job| match job.content {
            Content::Picture(picture, writer) => {
                let bytes = (writer.encode)(picture).map_err(|message| Error::output(job.path, message))?;
                stage_bytes(job.path, bytes)
            }
            Content::Bytes(bytes) => stage_bytes(job.path, bytes.to_vec()),
        })
        .collect();
    // Collected first: were it stopped at an error, which of several came first would be up to the threads.
    let staged = staged.into_iter().collect::<Result<Vec<_>>>()?;
    staged.into_iter().zip(jobs).try_for_each(|(staged, job)| staged.commit(job.path))
}

/// Encodes and writes one picture. [`Error::Output`] if it cannot be.
pub fn write_picture(path: &Path, picture: &Picture, writer: &Writer) -> Result<()> {
    write_all(&[Job { path, content: Content::Picture(picture, writer) }])
}

/// Writes these bytes. [`Error::Output`] if they cannot be.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, |file| file.write_all(bytes))
}

/// Writes a file through `write`, which is given a buffered stream: folders are created, an existing file is replaced,
/// and the name appears (or changes) only when all is written. An error leaves no trace but the folders.
///
/// [`Error::Output`] with the reason.
pub fn write_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let fail = |e: io::Error| Error::output(path, reason(&e));
    match place(path) {
        Place::Folder => Err(Error::output(path, FOLDER)),
        Place::Stdout => {
            let mut stream = BufWriter::new(io::stdout().lock());
            write(&mut stream).and_then(|()| stream.flush()).map_err(fail)
        }
        Place::Straight => {
            let mut stream = BufWriter::new(OpenOptions::new().write(true).open(path).map_err(fail)?);
            write(&mut stream).and_then(|()| stream.flush()).map_err(fail)
        }
        Place::Regular => {
            let (temporary, target) = create_temporary(path)?;
            let mut stream = BufWriter::new(temporary);
            write(&mut stream).map_err(fail)?;
            let temporary = stream.into_inner().map_err(|e| fail(e.into_error()))?;
            temporary.persist(&target).map_err(|e| fail(e.error))?;
            Ok(())
        }
    }
}

const FOLDER: &str = "it is a folder";

/// A file whose bytes are safe but that has not its name yet. Dropped, it leaves nothing behind.
enum Staged {
    /// Complete under a temporary name; and the name it will have.
    Temporary(NamedTempFile, PathBuf),
    /// To be written straight, which cannot be taken back, hence last.
    Straight(Vec<u8>),
}

impl Staged {
    fn commit(self, path: &Path) -> Result<()> {
        match self {
            Self::Temporary(file, target) => {
                file.persist(&target).map_err(|e| Error::output(path, reason(&e.error)))?;
                Ok(())
            }
            Self::Straight(bytes) => write_bytes(path, &bytes),
        }
    }
}

fn stage_bytes(path: &Path, bytes: Vec<u8>) -> Result<Staged> {
    match place(path) {
        Place::Folder => Err(Error::output(path, FOLDER)),
        Place::Stdout | Place::Straight => Ok(Staged::Straight(bytes)),
        Place::Regular => {
            let (mut file, target) = create_temporary(path)?;
            file.write_all(&bytes).map_err(|e| Error::output(path, reason(&e)))?;
            Ok(Staged::Temporary(file, target))
        }
    }
}

/// What stands at a path, as far as writing goes.
enum Place {
    /// `-`.
    Stdout,
    /// A pipe or a device.
    Straight,
    /// A folder.
    Folder,
    /// A regular file, or nothing yet.
    Regular,
}

fn place(path: &Path) -> Place {
    if path.as_os_str() == "-" {
        return Place::Stdout;
    }
    match fs::metadata(path) {
        Ok(data) if data.is_dir() => Place::Folder,
        Ok(data) if !data.is_file() => Place::Straight,
        // What cannot be looked at fails with its reason when the temporary is created.
        Ok(_) | Err(_) => Place::Regular,
    }
}

/// A temporary file in the folder of `path`, created with its parents where missing, and the name to rename it to.
fn create_temporary(path: &Path) -> Result<(NamedTempFile, PathBuf)> {
    // A link goes on pointing to its file: the file behind it is what is replaced.
    let target = match fs::symlink_metadata(path) {
        Ok(data) if data.file_type().is_symlink() => fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf()),
        _ => path.to_path_buf(),
    };
    if target.file_name().is_none() {
        return Err(Error::output(path, "the path names no file"));
    }
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if folder.exists() && !folder.is_dir() {
        return Err(Error::output(path, format!("{} is not a folder", folder.display())));
    }
    fs::create_dir_all(folder)
        .map_err(|e| Error::output(path, format!("cannot create the folder {}: {}", folder.display(), reason(&e))))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".stereomist-").suffix(".tmp");
    // tempfile's own 0600 would stay after the rename; results get what the umask allows, like any other file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder
        .tempfile_in(folder)
        .map_err(|e| Error::output(path, format!("cannot create a file in {}: {}", folder.display(), reason(&e))))?;
    Ok((file, target))
}

/// An input/output error in words of one line, without paths: tempfile adds that of the temporary, which nobody knows.
pub fn reason(error: &io::Error) -> String {
    match error.raw_os_error().or_else(|| nested(error)) {
        Some(code) => {
            let text = io::Error::from_raw_os_error(code).to_string();
            // The number says nothing that the words do not.
            text.split(" (os error").next().unwrap_or_default().to_string()
        }
        None => error.to_string().replace('\n', " "),
    }
}

/// The system's error code inside a wrapped error.
fn nested(error: &io::Error) -> Option<i32> {
    let mut source = error.get_ref().and_then(|e| e.source());
    while let Some(e) = source {
        if let Some(code) = e.downcast_ref::<io::Error>().and_then(io::Error::raw_os_error) {
            return Some(code);
        }
        source = e.source();
    }
    None
}
