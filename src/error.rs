//! What can go wrong, said so that a person can mend it: what, where, and what is allowed.

use std::fmt;
use std::path::{Path, PathBuf};

/// Every failure of the library. [`Error::exit_code`] maps it to the exit code of the command.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene file (or a `--set`) is wrong; every problem found, in file order.
    #[error("{}", join(.0))]
    Scene(Vec<Diagnostic>),
    /// An input file cannot be read or understood.
    #[error("{}: {message}", path.display())]
    Input {
        /// The file, as the user named it.
        path: PathBuf,
        /// What is wrong, where in the file (line or byte), and what is allowed.
        message: String,
    },
    /// A result cannot be written.
    #[error("cannot write {}: {message}", path.display())]
    Output {
        /// The file, as the user named it.
        path: PathBuf,
        /// The reason.
        message: String,
    },
    /// The command line, or a combination of settings, is wrong.
    #[error("{0}")]
    Usage(String),
    /// A method was asked for something it cannot render.
    #[error("method `{method}` cannot render {object}: {reason}; methods that can: {able}")]
    Unsupported {
        /// The method that was asked.
        method: &'static str,
        /// The object of the scene.
        object: String,
        /// Why not.
        reason: String,
        /// The methods that can, comma separated.
        able: String,
    },
    /// No usable device.
    #[error("{0}")]
    Device(String),
}

impl Error {
    /// An [`Error::Input`].
    pub fn input(path: &Path, message: impl Into<String>) -> Self {
        Self::Input { path: path.to_path_buf(), message: message.into() }
    }

    /// An [`Error::Output`].
    pub fn output(path: &Path, message: impl Into<String>) -> Self {
        Self::Output { path: path.to_path_buf(), message: message.into() }
    }

    /// 2 for wrong use or input, 3 for no usable device.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Device(_) => 3,
            Self::Scene(_) | Self::Input { .. } | Self::Output { .. } | Self::Usage(_) | Self::Unsupported { .. } => 2,
        }
    }
}

/// A result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// One problem in a text that a person wrote, with the place it stands at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// The file's name as the user gave it, or `--set` for a setting of the command line.
    pub file: String,
    /// Where; absent when the whole file is meant.
    pub span: Option<Span>,
    /// What is wrong.
    pub message: String,
    /// What is allowed or what to do; may be empty.
    pub help: String,
}

/// A stretch of one line of text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Length in characters, at least 1, within the line.
    pub length: usize,
    /// The whole line, for the quote below the message.
    pub text: String,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.span {
            Some(span) => {
                writeln!(f, "{}:{}:{}: {}", self.file, span.line, span.column, self.message)?;
                let number = span.line.to_string();
                let margin = " ".repeat(number.len());
                // Tabs would shift the marks: a tab is shown as one space in the quote.
                let quote: String = span.text.chars().map(|c| if c == '\t' { ' ' } else { c }).collect();
                writeln!(f, "{number} | {quote}")?;
                write!(f, "{margin} | {}{}", " ".repeat(span.column - 1), "^".repeat(span.length.max(1)))?;
                if !self.help.is_empty() {
                    write!(f, "\n{margin} = {}", self.help)?;
                }
            }
            None => {
                write!(f, "{}: {}", self.file, self.message)?;
                if !self.help.is_empty() {
                    write!(f, "\n  = {}", self.help)?;
                }
            }
        }
        Ok(())
    }
}

fn join(diagnostics: &[Diagnostic]) -> String {
    diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}
