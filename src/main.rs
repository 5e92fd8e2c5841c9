//! The `stereomist` command: parses what was typed, calls the library, maps the outcome to an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    stereomist::cli::main()
}
