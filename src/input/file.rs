//! Regular files: what is none might block or never end.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Bytes read at once.
const BUFFER: usize = 1 << 18;

/// A regular file to be read from its beginning, and its size in bytes. The error does not name the file.
pub(super) fn open(path: &Path) -> Result<(BufReader<File>, u64), String> {
    // Asked before it is opened, since opening a pipe waits for its other end.
    let metadata = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !metadata.is_file() {
        return Err("is not a regular file".to_owned());
    }
    let file = File::open(path).map_err(|e| e.to_string())?;
    Ok((BufReader::with_capacity(BUFFER, file), metadata.len()))
}

/// All of a regular file, or its first `limit` bytes. The error does not name the file.
pub(super) fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, String> {
    let (file, _) = open(path)?;
    let mut bytes = Vec::new();
    file.take(limit).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// The file of that name in the first folder that has it: as it is written, with Windows' separators, or, of a path
/// from another machine, by its last part alone.
pub(super) fn find<'a>(name: &str, folders: impl Iterator<Item = &'a Path> + Clone) -> Option<PathBuf> {
    let slashes = name.replace('\\', "/");
    let last = slashes.rsplit('/').next().unwrap_or_default();
    [name, &slashes, last]
        .into_iter()
        .filter(|name| !name.is_empty())
        .find_map(|name| folders.clone().map(|folder| folder.join(name)).find(|path| path.exists()))
}
