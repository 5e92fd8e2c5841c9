//! The scene file: TOML with `--set` changes, checked throughout.
//!
//! The text becomes a tree of values that know their places (`tree`), settings are put into it (`set`), and the tree is
//! walked by hand (`sections` and `method`, with the cursors of `reader`). A derived deserialiser would stop at the first problem;
//! here all of them are reported at once, each with file, line, column, the offending text and what is allowed.

mod method;
mod reader;
mod sections;
mod set;
mod text;
mod tree;

pub use sections::check_size;

use super::mesh::MeshEntry;
use super::particles::ParticleEntry;
use crate::error::{Diagnostic, Error, Result};
use crate::render::Settings;
use crate::scene::{Camera, Rgb, Stereo};
use reader::Context;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use text::{Problems, Texts};
use tree::Value;

/// The largest scene file, in bytes: room for a thousand entries; data belongs in the files that it names. What a text
/// of nothing but problems takes is a hundred times its size, because each of them is reported.
pub const MAX_FILE_SIZE: u64 = 256 << 10;

/// What messages call the text of a setting.
const SET: &str = "--set";

/// A scene file that has been read and checked. The files that it names exist, but only kernel profiles have been read.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The cyclopean camera.
    pub camera: Camera,
    /// The stereo rig; absent: one view.
    pub stereo: Option<Stereo>,
    /// What a ray sees that meets nothing else, linear light.
    pub background: Rgb,
    /// The `[[particles]]` entries, in file order.
    pub particles: Vec<ParticleEntry>,
    /// The `[[mesh]]` entries, in file order.
    pub meshes: Vec<MeshEntry>,
    /// Method, its parameters and opacity model of `[render]`; all else is the default.
    pub settings: Settings,
    /// What is right but may surprise, a sentence each.
    pub notes: Vec<String>,
}

/// Reads a scene file, with settings of the form `path.to.key=value` applied in their order. Paths in the file and in
/// the settings are relative to the file's folder.
///
/// Errors: [`Error::Input`] for a file that is missing, no file, not UTF-8 or larger than [`MAX_FILE_SIZE`];
/// [`Error::Scene`] with every problem in the file and the settings.
pub fn load(path: &Path, sets: &[String]) -> Result<SceneFile> {
    let text = read_text(path)?;
    // Without a folder the file is in the current one, which an empty path stands for.
    let base = path.parent().unwrap_or(Path::new(""));
    parse(&path.display().to_string(), &text, base, sets).map_err(Error::Scene)
}

/// Reads the text of a scene file; `name` is what messages call it, `base` the folder that paths are relative to.
/// Settings as for [`load`]. Apart from the kernel profiles that the scene names, nothing is read.
///
/// Errors: every problem, those of the whole file first, then in the order of the text, then of the settings.
pub fn parse(name: &str, text: &str, base: &Path, sets: &[String]) -> Result<SceneFile, Vec<Diagnostic>> {
    // Editors that write a byte order mark do not show it, and columns should agree with what is shown.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut texts = Texts::default();
    let text_base = texts.add(name, text);
    let set_bases: Vec<_> = sets.iter().map(|set| texts.add(SET, set)).collect();

    let problems = Problems::new(&texts);
    let settings: Vec<_> =
        sets.iter().zip(set_bases).filter_map(|(set, base)| set::parse(set, base, &problems)).collect();
    let document = tree::parse_document(text, text_base, &problems).map(|mut document| {
        for setting in settings {
            set::apply(setting, &mut document, &problems);
        }
        document
    });
    let scene = match document.as_ref().map(|document| &document.value) {
        Some(Value::Table(table)) => sections::scene(Context { problems: &problems, base }, table),
        _ => None,
    };
    match scene {
        Some(scene) if problems.is_empty() => Ok(scene),
        _ => Err(problems.into_diagnostics()),
    }
}

fn read_text(path: &Path) -> Result<String> {
    let failed = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => Error::input(path, "the scene file does not exist"),
        _ => Error::input(path, format!("the scene file cannot be read: {error}")),
    };
    if std::fs::metadata(path).map_err(failed)?.is_dir() {
        return Err(Error::input(path, "a folder, where a scene file (TOML) is expected"));
    }
    let mut bytes = Vec::new();
    // Bounded while reading, not by the size that the system states: a pipe has none.
    File::open(path).map_err(failed)?.take(MAX_FILE_SIZE + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_FILE_SIZE {
        let allowed = MAX_FILE_SIZE >> 10;
        return Err(Error::input(path, format!("the scene file is too large; allowed: at most {allowed} KiB")));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        Error::input(path, format!("line {line}: byte {at} is not UTF-8; a scene file is TOML text in UTF-8"))
    })
}
