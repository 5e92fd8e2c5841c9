//! The README's command lines, run as they stand.

#![cfg(unix)]

use super::{PROGRAM, Place, repository};
use std::fs;
use std::process::{Command, Stdio};

/// The commands of the ```` ```sh ```` fences: lines joined where a backslash ends them.
fn commands(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut inside = false;
    let mut line = String::new();
    for raw in text.lines() {
        let fence = raw.trim_start();
        if let Some(language) = fence.strip_prefix("```") {
            inside = !inside && language.trim() == "sh";
            continue;
        }
        if !inside {
            continue;
        }
        line.push_str(raw.trim_start_matches("$ "));
        if line.ends_with('\\') {
            line.pop();
        } else {
            found.push(std::mem::take(&mut line));
        }
    }
    found.retain(|line| !line.trim().is_empty());
    found
}

/// What of a command is for the program; nothing for other commands and those that need what is not there.
fn arguments(command: &str) -> Option<&str> {
    if command.contains("# needs ") {
        return None;
    }
    let command = command.trim();
    command.strip_prefix("stereomist ").or_else(|| command.strip_prefix("cargo run --release -- "))
}

fn copy(from: &std::path::Path, to: &std::path::Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// In their order and in one folder, which holds the scenes: a later line may use what an earlier one wrote.
#[test]
fn its_commands_work() {
    let text = fs::read_to_string(repository("README.md")).unwrap();
    let commands = commands(&text);
    let lines: Vec<&str> = commands.iter().filter_map(|command| arguments(command)).collect();
    assert!(!lines.is_empty(), "the README shows no command");
    assert!(commands.iter().any(|line| line.starts_with("cargo test --release")), "it does not say how to test");
    let place = Place::empty();
    copy(&repository("scenes"), &place.path("scenes"));
    for line in lines {
        let script = format!("\"$0\" {line}");
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(&script).arg(PROGRAM).current_dir(place.path("")).stdin(Stdio::null());
        shell.env("XDG_CACHE_HOME", place.path("cache"));
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{line}: {output:?}");
    }
}

#[test]
fn its_fences_are_found() {
    let text = "# x\n```sh\ncargo run --release -- render a.toml   # a comment\nstereomist compare a \\\n  b\n\
                stereomist devices  # needs a GPU\ncargo test --release\n```\n```toml\nstereomist no\n```\n\
                ```sh\n$ stereomist scene a\n```\nstereomist text\n";
    let commands = commands(text);
    let lines: Vec<&str> = commands.iter().filter_map(|command| arguments(command)).collect();
    assert_eq!(lines, ["render a.toml   # a comment", "compare a   b", "scene a"]);
    assert_eq!(commands.len(), 5);
}
