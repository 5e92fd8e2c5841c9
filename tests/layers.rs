//! Who may import whom: the tables in the crate's documentation against every path in `src/`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// A module's or an item's place in the crate, such as `render::cpu`.
type Place = Vec<String>;

fn place(text: &str) -> Place {
    text.split("::").map(str::to_owned).collect()
}

/// What the tables in `lib.rs` say.
struct Rules {
    /// Each room with the rooms that it may import.
    rooms: Vec<(String, Vec<String>)>,
    /// Things with the places that they are confined to.
    only: Vec<(Place, Vec<Place>)>,
    /// Things with the places that they are kept out of.
    never: Vec<(Place, Vec<Place>)>,
}

impl Rules {
    /// Reads the tables of a crate's documentation.
    fn read(text: &str) -> Self {
        let mut rules = Self { rooms: Vec::new(), only: Vec::new(), never: Vec::new() };
        for line in text.lines() {
            let Some(row) = line.strip_prefix("//! | ") else { continue };
            let cells: Vec<&str> = row.trim_end_matches('|').split('|').map(str::trim).collect();
            match cells[..] {
                [room, _, allowed] if room.starts_with("[`") => {
                    let room = room.trim_matches(['[', '`', ']']).to_owned();
                    assert!(allowed == "nobody" || allowed.contains('`'), "`{allowed}` names no room");
                    rules.rooms.push((room, quoted(allowed)));
                }
                [things, places] if things.starts_with('`') => {
                    let list = match places.split_once(" in ") {
                        Some(("only", _)) => &mut rules.only,
                        Some(("not", _)) => &mut rules.never,
                        _ => panic!("`{places}`: neither `only in` nor `not in`"),
                    };
                    let places: Vec<Place> = quoted(places).iter().map(|text| place(text)).collect();
                    assert!(!places.is_empty(), "{row}");
                    list.extend(quoted(things).iter().map(|thing| (place(thing), places.clone())));
                }
                _ => {}
            }
        }
        rules
    }

    /// What in a file's text breaks the rules.
    fn violations(&self, file: &str, text: &str) -> Vec<String> {
        let module = module_of(file);
        // The crate's root and the program only join the rooms.
        let Some(room) = module.first() else { return Vec::new() };
        let mut found = Vec::new();
        let mut report = |line: usize, message: String| found.push(format!("{file}:{line}: {message}"));
        let Some((_, allowed)) = self.rooms.iter().find(|(name, _)| name == room) else {
            return vec![format!("{file}: `{room}` is no room of the table")];
        };
        for (line, path) in paths(text, &module) {
            let target = match &path {
                Mention::Own(path) => match path.first().map(String::as_str) {
                    None | Some("*") => {
                        report(line, "everything of the crate is imported".to_owned());
                        continue;
                    }
                    // The root gives these two their short names.
                    Some("Error" | "Result") => Some("error"),
                    first => first,
                },
                Mention::Other(_) => None,
            };
            if let Some(target) = target
                && target != room
                && !allowed.iter().any(|name| name == target)
            {
                report(line, format!("`{room}` imports `{target}`"));
            }
            let (Mention::Own(path) | Mention::Other(path)) = &path;
            for (thing, places) in &self.only {
                if path.starts_with(thing) && !places.iter().any(|place| module.starts_with(place)) {
                    report(line, format!("`{}` in `{}`", thing.join("::"), module.join("::")));
                }
            }
            for (thing, places) in &self.never {
                if path.starts_with(thing) && places.iter().any(|place| module.starts_with(place)) {
                    report(line, format!("`{}` in `{}`", thing.join("::"), module.join("::")));
                }
            }
        }
        found
    }
}

/// The parts of a text between backticks.
fn quoted(text: &str) -> Vec<String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The module of a file in `src/`, named with slashes.
fn module_of(file: &str) -> Place {
    let mut module: Place = file.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        module.pop();
    }
    module
}

/// A path in a source text.
#[derive(Debug, PartialEq)]
enum Mention {
    /// Of this crate, from its root.
    Own(Place),
    /// Of another crate (or a module next door by its bare name), or the word `unsafe`.
    Other(Place),
}

/// The words and signs of a source text with their lines; without comments and literals. `::` is one sign.
fn tokens(text: &str) -> Vec<(usize, String)> {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let mut tokens = Vec::new();
    let (mut i, mut line) = (0, 1);
    while i < chars.len() {
        let start = i;
        match at(i) {
            '/' if at(i + 1) == '/' => {
                while i < chars.len() && at(i) != '\n' {
                    i += 1;
                }
            }
            '/' if at(i + 1) == '*' => {
                let mut depth = 0;
                loop {
                    match (at(i), at(i + 1)) {
                        ('/', '*') => (depth, i) = (depth + 1, i + 2),
                        ('*', '/') => (depth, i) = (depth - 1, i + 2),
                        _ => i += 1,
                    }
                    if depth == 0 || i >= chars.len() {
                        break;
                    }
                }
            }
            '"' => {
                i += 1;
                while i < chars.len() && at(i) != '"' {
                    i += if at(i) == '\\' { 2 } else { 1 };
                }
                i += 1;
            }
            // A character, unless it is a lifetime.
            '\'' if at(i + 1) == '\\' || at(i + 2) == '\'' => {
                i += if at(i + 1) == '\\' { 3 } else { 2 };
                while i < chars.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            c if c.is_alphabetic() || c == '_' => {
                while at(i).is_alphanumeric() || at(i) == '_' {
                    i += 1;
                }
                let word: String = chars[start..i].iter().collect();
                let hashes = chars[i..].iter().take_while(|&&c| c == '#').count();
                if matches!(word.as_str(), "r" | "br") && at(i + hashes) == '"' {
                    i += hashes + 1;
                    while i < chars.len()
                        && !(at(i) == '"' && chars[i + 1..].iter().take_while(|&&c| c == '#').count() >= hashes)
                    {
                        i += 1;
                    }
                    i += 1 + hashes;
                } else {
                    tokens.push((line, word));
                }
            }
            ':' if at(i + 1) == ':' => {
                tokens.push((line, "::".to_owned()));
                i += 2;
            }
            c => {
                if !c.is_whitespace() {
                    tokens.push((line, c.to_string()));
                }
                i += 1;
            }
        }
        line += chars[start..i.min(chars.len())].iter().filter(|&&c| c == '\n').count();
    }
    tokens
}

fn is_word(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Every path of a source text that stands in `module`, with its line: groups taken apart, `self` and `super` resolved.
fn paths(text: &str, module: &Place) -> Vec<(usize, Mention)> {
    let tokens = tokens(text);
    let token = |i: usize| tokens.get(i).map_or("", |(_, token)| token.as_str());
    let mut found = Vec::new();
    // Modules within the file, with the depth of braces that they stand at.
    let (mut depth, mut inner): (usize, Vec<(usize, String)>) = (0, Vec::new());
    let mut i = 0;
    while i < tokens.len() {
        let line = tokens[i].0;
        match token(i) {
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                inner.retain(|&(at, _)| at < depth);
            }
            "mod" if token(i + 2) == "{" => inner.push((depth, token(i + 1).to_owned())),
            "unsafe" => found.push((line, Mention::Other(place("unsafe")))),
            word if is_word(word)
                && (token(i + 1) == "::" || (i > 0 && token(i - 1) == "use"))
                && (i == 0 || token(i - 1) != "::") =>
            {
                let mut here = module.clone();
                here.extend(inner.iter().map(|(_, name)| name.clone()));
                let mut leaves = Vec::new();
                i = tree(&token, i, &mut Vec::new(), &mut leaves);
                found.extend(leaves.into_iter().map(|path| (line, resolve(path, &here))));
                continue;
            }
            _ => {}
        }
        i += 1;
    }
    found
}

/// The paths of a `use` tree (or of a path anywhere) that begins at token `i`; returns the token behind it.
fn tree<'a>(token: &impl Fn(usize) -> &'a str, mut i: usize, prefix: &mut Place, leaves: &mut Vec<Place>) -> usize {
    let length = prefix.len();
    loop {
        match token(i) {
            "{" => {
                i += 1;
                while !matches!(token(i), "}" | "") {
                    i = if token(i) == "," { i + 1 } else { tree(token, i, prefix, leaves) };
                }
                i += 1;
                break;
            }
            "*" => {
                prefix.push("*".to_owned());
                leaves.push(prefix.clone());
                i += 1;
                break;
            }
            word if is_word(word) => {
                prefix.push(word.to_owned());
                i += 1;
                if token(i) == "::" && (is_word(token(i + 1)) || matches!(token(i + 1), "{" | "*")) {
                    i += 1;
                    continue;
                }
                leaves.push(prefix.clone());
                // `as` names it anew, which changes nothing here.
                if token(i) == "as" {
                    i += 2;
                }
                break;
            }
            // A generic argument or something else that ends the path; one token on, so that there is an end.
            _ => {
                i += 1;
                break;
            }
        }
    }
    prefix.truncate(length);
    i
}

fn resolve(path: Place, here: &Place) -> Mention {
    let rest = |from: usize| path[from..].iter().filter(|word| *word != "self").cloned();
    match path[0].as_str() {
        "crate" => Mention::Own(rest(1).collect()),
        "self" | "super" => {
            let ups = path.iter().take_while(|word| *word == "super").count();
            let base = &here[..here.len().saturating_sub(ups)];
            Mention::Own(base.iter().cloned().chain(rest(ups)).collect())
        }
        _ => Mention::Other(path),
    }
}

fn source() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"))
}

/// All source files, as `render/cpu/mod.rs`.
fn files(folder: &Path, prefix: &str, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = format!("{prefix}{}", entry.file_name().to_str().unwrap());
        if entry.file_type().unwrap().is_dir() {
            files(&entry.path(), &format!("{name}/"), found);
        } else if name.ends_with(".rs") {
            found.push(name);
        }
    }
    found.sort();
}

fn rules() -> Rules {
    Rules::read(&fs::read_to_string(source().join("lib.rs")).unwrap())
}

#[test]
fn imports_go_down_only() {
    let rules = rules();
    let mut names = Vec::new();
    files(source(), "", &mut names);
    assert!(names.len() > 30, "{names:?}");
    let mut found = Vec::new();
    let mut mentions = 0;
    for name in &names {
        let text = fs::read_to_string(source().join(name)).unwrap();
        mentions += paths(&text, &module_of(name)).iter().filter(|(_, path)| matches!(path, Mention::Own(_))).count();
        found.extend(rules.violations(name, &text));
    }
    // A reader that finds no paths would find no violations either.
    assert!(mentions > 150, "only {mentions} paths were found");
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn the_tables_name_every_room_once_and_have_no_cycle() {
    let rules = rules();
    let rooms: BTreeSet<String> = rules.rooms.iter().map(|(room, _)| room.clone()).collect();
    assert_eq!(rooms.len(), rules.rooms.len());
    let mut names = Vec::new();
    files(source(), "", &mut names);
    let there: BTreeSet<String> = names.iter().filter_map(|name| module_of(name).first().cloned()).collect();
    assert_eq!(rooms, there);
    assert!(rules.only.len() >= 6 && rules.never.len() == 9);
    // Taking away rooms that import none of those left must leave nothing.
    let mut left = rules.rooms.clone();
    while !left.is_empty() {
        let before = left.len();
        let names: Vec<String> = left.iter().map(|(room, _)| room.clone()).collect();
        left.retain(|(_, allowed)| allowed.iter().any(|name| names.contains(name)));
        assert!(left.len() < before, "rooms import each other: {names:?}");
    }
}

/// A check that cannot fail is worth nothing.
#[test]
fn planted_violations_are_found() {
    let rules = rules();
    for (file, text, line, words) in [
        ("scene/camera.rs", "use crate::picture::Film;", 1, "`scene` imports `picture`"),
        ("scene/camera.rs", "//! Doc.\n\nuse glam::DVec3;\nuse crate::error::Error;", 4, "`scene` imports `error`"),
        ("scene/kernel/mod.rs", "fn f() -> crate::Result<()> {}", 1, "`scene` imports `error`"),
        ("scene/kernel/table.rs", "fn f() { super::super::super::render::draw() }", 1, "`scene` imports `render`"),
        ("scene/mod.rs", "mod tests {\n fn f() { super::super::input::x() }\n}", 2, "`scene` imports `input`"),
        ("picture/mod.rs", "pub use crate::{\n    error::{Error, Result},\n    scene::Eye,\n};", 1, "imports `scene`"),
        ("picture/film.rs", "use crate::scene as picture;", 1, "`picture` imports `scene`"),
        ("render/mod.rs", "struct S(crate::input::SceneInput);", 1, "`render` imports `input`"),
        ("render/mod.rs", "use super::cli;", 1, "`render` imports `cli`"),
        ("input/ply.rs", "use crate::cli::render;", 1, "`input` imports `cli`"),
        ("input/ply.rs", "use {std::io, crate::study::metrics::{self}};", 1, "`input` imports `study`"),
        ("study/metrics.rs", "use crate::*;", 1, "everything"),
        ("error.rs", "use crate::picture::Picture;", 1, "`error` imports `picture`"),
        ("render/cpu/tile.rs", "use crate::render::{Method, cpu};", 1, "`render::Method` in `render::cpu::tile`"),
        ("render/cpu/mod.rs", "use super::method::viewplane;", 1, "`render::method` in `render::cpu`"),
        ("scene/stereo.rs", "use rayon::prelude::*;", 1, "`rayon` in `scene::stereo`"),
        ("picture/color.rs", "fn f() {\n rayon::join(a, b) }", 2, "`rayon` in `picture::color`"),
        ("render/cpu/engine.rs", "use wgpu;", 1, "`wgpu` in `render::cpu::engine`"),
        ("input/mod.rs", "#[derive(clap::Args)]", 1, "`clap` in `input`"),
        ("study/mod.rs", "use indicatif::ProgressBar;", 1, "`indicatif` in `study`"),
        ("cli/options.rs", "let x: toml::Value;", 1, "`toml` in `cli::options`"),
        ("render/cpu/tile.rs", "unsafe fn f() {}", 1, "`unsafe` in `render::cpu::tile`"),
        ("attic/mod.rs", "", 0, "no room"),
    ] {
        let found = rules.violations(file, text);
        assert_eq!(found.len(), 1, "{file}: {text}: {found:?}");
        assert!(found[0].contains(words), "{file}: {text}: {found:?}");
        assert!(line == 0 || found[0].starts_with(&format!("{file}:{line}: ")), "{found:?}");
    }
}

#[test]
fn what_is_allowed_is_not_reported() {
    let rules = rules();
    for (file, text) in [
        ("scene/camera.rs", "// use crate::cli;\n/* crate::cli /* unsafe */ */ use super::stereo::Eye;"),
        (
            "scene/camera.rs",
            "//! See [`crate::render`].\nlet s = \"crate::cli \\\" unsafe\"; let r = r#\"a\" crate::cli\"#;",
        ),
        ("scene/camera.rs", "fn f<'a>(c: &'a str) -> char { if c == '\"' { '\\'' } else { '\\u{41}' } }"),
        ("scene/kernel/table.rs", "use super::{Kernel, poly::*}; pub(crate) fn f() { self::g::<f64>() }"),
        ("scene/mod.rs", "mod tests { use super::*; }"),
        ("picture/output/mod.rs", "use rayon::prelude::*; use crate::error::{Error, Result};"),
        ("render/mod.rs", "pub use method::Method; use crate::picture::Film; use crate::scene::{Eye, Scene, stereo};"),
        ("render/method/mod.rs", "use super::cpu::engine; use crate::Error;"),
        ("render/cpu/simd/x86.rs", "unsafe fn f() {}"),
        ("render/gpu/mod.rs", "use wgpu::Device;"),
        ("cli/render.rs", "use clap::Args; use crate::{study, input, render, scene, picture, error};"),
        ("input/scene_file/tree.rs", "use toml::Spanned; use crate::render::Settings;"),
        ("lib.rs", "pub mod cli; pub use error::{Error, Result};"),
        ("main.rs", "fn main() { stereomist::cli::main() }"),
    ] {
        assert_eq!(rules.violations(file, text), Vec::<String>::new(), "{file}: {text}");
    }
}
