//! WHO ASKS: one file per command.

pub mod compare;
pub mod compose;

use std::process::ExitCode;

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    ExitCode::SUCCESS
}
