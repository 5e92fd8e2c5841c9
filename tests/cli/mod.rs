//! The command line, through the real program: what it writes, what it says, and how it ends.

mod broken;
mod chart;
mod commands;
mod contents;
mod errors;
mod formats;
mod hostile;
mod pairs;
mod readme;
mod scenes;
mod verify;

use crate::harness::folder;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use stereomist::picture::Picture;
use stereomist::picture::read::read;
use tempfile::TempDir;

/// The program that is tested.
const PROGRAM: &str = env!("CARGO_BIN_EXE_stereomist");

/// A small scene: two dozen particles in a box, stereo.
const SCENE: &str = r#"
[camera]
position = [0.0, 0.0, 4.0]
look_at = [0.0, 0.0, 0.0]
size = [48, 36]

[stereo]
interocular = 0.3
convergence = 4.0

[background]
color = [0.1, 0.2, 0.4]

[[particles]]
radius = 0.5
opacity = 0.6

[particles.box]
min = [-1.0, -1.0, -1.0]
max = [1.0, 1.0, 1.0]
count = 24
seed = 3
"#;

/// A file of the repository.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// What a run of the program left behind.
#[derive(Debug)]
struct Run {
    /// Exit code; none after a signal.
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Run {
    fn of(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Self { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// Exit code 0 and no word of complaint.
    fn ok(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        assert!(!self.stderr.contains("error") && !self.stderr.contains("panicked"), "{self:?}");
        self
    }

    /// That exit code, nothing on stdout, and one message that holds all of these words.
    fn refused(self, code: i32, words: &[&str]) -> Self {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert_eq!(self.stdout, "", "{self:?}");
        let messages = self.stderr.lines().filter(|line| line.starts_with("error:")).count();
        assert!(self.stderr.starts_with("error: ") && messages == 1, "{self:?}");
        assert!(!self.stderr.contains("panicked") && !self.stderr.contains("RUST_BACKTRACE"), "{self:?}");
        for word in words {
            assert!(self.stderr.contains(word), "`{word}` is missing: {self:?}");
        }
        self
    }

    /// The one JSON object that is all of stdout.
    fn json(self) -> serde_json::Value {
        let run = self.ok();
        assert_eq!(run.stderr, "", "{run:?}");
        let value: serde_json::Value = serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"));
        assert!(value.is_object(), "{run:?}");
        value
    }
}

/// A fresh folder that the program runs in.
struct Place(TempDir);

impl Place {
    /// An empty one.
    fn empty() -> Self {
        Self(folder())
    }

    /// One with [`SCENE`] as `scene.toml`.
    fn new() -> Self {
        let place = Self::empty();
        place.write("scene.toml", SCENE);
        place
    }

    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file, with its folders.
    fn write(&self, name: impl AsRef<Path>, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// The program with these arguments, to be run here. Standard input is closed: nothing may wait for it.
    fn command<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null()).env_remove("RUST_BACKTRACE");
        // Mesa's layer that chooses between GPUs complains on stderr where there is no desktop.
        command.env("NODEVICE_SELECT", "1");
        // Nothing is kept in the user's own folder.
        command.env("XDG_CACHE_HOME", concat!(env!("CARGO_TARGET_TMPDIR"), "/cache"));
        command
    }

    /// Runs the program here with these words as arguments.
    fn run(&self, words: &str) -> Run {
        self.run_with(words.split_whitespace())
    }

    /// Runs the program here.
    fn run_with<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Run {
        Run::of(self.command(arguments).output().unwrap())
    }

    /// All files below here, hidden ones too, sorted, with slashes.
    fn files(&self) -> Vec<String> {
        fn list(folder: &Path, prefix: &str, found: &mut Vec<String>) {
            for entry in fs::read_dir(folder).unwrap() {
                let entry = entry.unwrap();
                let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
                if entry.file_type().unwrap().is_dir() {
                    list(&entry.path(), &format!("{name}/"), found);
                } else {
                    found.push(name);
                }
            }
        }
        let mut found = Vec::new();
        list(self.0.path(), "", &mut found);
        found.sort();
        found
    }

    fn picture(&self, name: &str) -> Picture {
        read(&self.path(name)).unwrap().picture
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.bytes(name)).unwrap()
    }
}
