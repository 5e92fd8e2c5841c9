//! Cursors over the document: a [`Reader`] for a table, a [`Field`] for a value.
//!
//! Every question that is answered with `None` has been reported, so that whoever reads a scene goes on with a default
//! and all problems come out in one go. A reader remembers the keys that it was asked for; the others are unknown.

use super::text::{Place, Problems};
use super::tree::{Entry, Node, Table, Value};
use crate::scene::Rgb;
use glam::DVec3;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// What every cursor carries.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    /// Where problems go.
    pub problems: &'a Problems<'a>,
    /// The folder that paths are relative to.
    pub base: &'a Path,
}

/// Which numbers a key takes, beside finite ones only.
pub(super) struct Rule {
    /// In words.
    pub allowed: &'static str,
    /// As a test.
    pub test: fn(f64) -> bool,
}

/// Any finite number.
pub(super) const FINITE: Rule = Rule { allowed: "a finite number", test: |_| true };
/// A number above zero.
pub(super) const POSITIVE: Rule = Rule { allowed: "a finite number greater than 0", test: |v| v > 0.0 };
/// A number from zero.
pub(super) const NOT_NEGATIVE: Rule = Rule { allowed: "a finite number, 0 or more", test: |v| v >= 0.0 };

/// A table that is being read.
pub(super) struct Reader<'a> {
    context: Context<'a>,
    table: &'a Table,
    /// Header or opening key; absent for the document itself.
    place: Option<Place>,
    path: String,
    known: Vec<&'static str>,
}

impl<'a> Reader<'a> {
    /// A reader of the document itself, which is always a table.
    pub fn document(context: Context<'a>, table: &'a Table) -> Self {
        Self { context, table, place: None, path: String::new(), known: Vec::new() }
    }

    /// The value of a key, if it is there.
    pub fn get(&mut self, key: &'static str) -> Option<Field<'a>> {
        self.known.push(key);
        let entry = self.table.get(key)?;
        Some(Field { context: self.context, path: self.path_of(key), node: &entry.node, key_place: entry.key_place })
    }

    /// The value of a key that must be there; `example` shows how it is written.
    pub fn require(&mut self, key: &'static str, example: &str) -> Option<Field<'a>> {
        let field = self.get(key);
        if field.is_none() {
            self.context.problems.report(
                self.place,
                format!("`{}` is missing", self.path_of(key)),
                format!("required, as in {example}"),
            );
        }
        field
    }

    /// Where the table stands.
    pub fn place(&self) -> Option<Place> {
        self.place
    }

    /// The path of a key, in the form that `--set` takes.
    pub fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Reports the keys that nobody asked for.
    pub fn finish(self) {
        for entry in self.table.entries.iter().filter(|entry| !self.known.contains(&entry.key.as_str())) {
            let help = suggest(&entry.key, &self.known);
            self.context.problems.report(entry.key_place, format!("unknown key `{}`", self.path_of(&entry.key)), help);
        }
    }
}

/// A value that is being read.
pub(super) struct Field<'a> {
    context: Context<'a>,
    path: String,
    node: &'a Node,
    key_place: Place,
}

impl<'a> Field<'a> {
    /// Where the value stands.
    pub fn place(&self) -> Place {
        self.node.place
    }

    /// Where the key of the value stands.
    pub fn key_place(&self) -> Place {
        self.key_place
    }

    /// The path of the value, in the form that `--set` takes.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The value itself.
    pub fn value(&self) -> &'a Value {
        &self.node.value
    }

    /// The one of two values that was written later, so that a setting is blamed before the file that it changes.
    pub fn later<'f>(&'f self, other: &'f Self) -> &'f Self {
        if self.place() > other.place() { self } else { other }
    }

    /// Reports a problem at the value.
    pub fn report(&self, message: impl Into<String>, help: impl Into<String>) {
        self.report_at(self.node.place, message, help);
    }

    /// Reports a problem at a place within the value.
    pub fn report_at(&self, place: Place, message: impl Into<String>, help: impl Into<String>) {
        self.context.problems.report(place, message, help);
    }

    /// Reports that the value is none of those allowed.
    pub fn refuse(&self, allowed: &str) {
        let snippet = self.context.problems.texts.snippet(self.node.place);
        self.report(format!("`{}` cannot be `{snippet}`", self.path), format!("allowed: {allowed}"));
    }

    /// Reports that the value is of a type that the key does not take.
    pub fn refuse_type(&self, allowed: &str) {
        let snippet = self.context.problems.texts.snippet(self.node.place);
        let kind = self.node.value.description();
        self.report(format!("`{}` cannot be {kind} `{snippet}`", self.path), format!("allowed: {allowed}"));
    }

    /// A finite number; integers count.
    pub fn number(&self, rule: &Rule) -> Option<f64> {
        let number = match &self.node.value {
            // Rounded to the nearest f64, as a float of the same digits would be.
            Value::Integer(Some(integer)) => *integer as f64,
            Value::Float(float) => *float,
            Value::Integer(None) => f64::INFINITY,
            Value::String(text) if text.trim().parse::<f64>().is_ok() => {
                self.refuse_type(&format!("{}, without quotes and with digits around its point", rule.allowed));
                return None;
            }
            Value::String(_) | Value::Boolean(_) | Value::Datetime | Value::Array(_) | Value::Table(_) => {
                self.refuse_type(rule.allowed);
                return None;
            }
        };
        if number.is_finite() && (rule.test)(number) {
            Some(number)
        } else {
            self.refuse(rule.allowed);
            None
        }
    }

    /// An integer within a range.
    pub fn integer(&self, range: RangeInclusive<u64>) -> Option<u64> {
        let allowed = format!("an integer from {} to {}", range.start(), range.end());
        let Value::Integer(integer) = self.node.value else {
            self.refuse_type(&allowed);
            return None;
        };
        let integer = integer.and_then(|integer| u64::try_from(integer).ok()).filter(|integer| range.contains(integer));
        if integer.is_none() {
            self.refuse(&allowed);
        }
        integer
    }

    /// A boolean.
    pub fn boolean(&self) -> Option<bool> {
        let Value::Boolean(value) = self.node.value else {
            self.refuse_type("true, false");
            return None;
        };
        Some(value)
    }

    /// The entries of an array of exactly `N`.
    fn exactly<const N: usize>(&self, allowed: &str) -> Option<[Field<'a>; N]> {
        let Value::Array(items) = &self.node.value else {
            self.refuse_type(allowed);
            return None;
        };
        let fields: Vec<_> = items.iter().enumerate().map(|(i, node)| self.entry(i, node)).collect();
        let fields = fields.try_into().ok();
        if fields.is_none() {
            self.refuse(allowed);
        }
        fields
    }

    fn entry(&self, index: usize, node: &'a Node) -> Self {
        let path = format!("{}.{index}", self.path);
        Self { context: self.context, path, node, key_place: node.place }
    }

    /// Three finite numbers.
    pub fn vector(&self) -> Option<DVec3> {
        // Each is asked before any is required, so that every wrong one is reported.
        let [x, y, z] = self.exactly("three finite numbers, [x, y, z]")?.map(|field| field.number(&FINITE));
        Some(DVec3::new(x?, y?, z?))
    }

    /// A linear-light colour: three numbers that an f32 holds.
    pub fn color(&self) -> Option<Rgb> {
        const COMPONENT: Rule = Rule {
            allowed: "a finite number, linear light, where 1 is full intensity",
            test: |v| (v as f32).is_finite(),
        };
        let rgb = self.exactly("three finite numbers, [red, green, blue], linear light, where 1 is full intensity")?;
        let [r, g, b] = rgb.map(|field| field.number(&COMPONENT));
        Some([r? as f32, g? as f32, b? as f32])
    }

    /// Two integers.
    pub fn pair(&self, range: RangeInclusive<u64>, allowed: &str) -> Option<[u64; 2]> {
        let [a, b] = self.exactly(allowed)?.map(|field| field.integer(range.clone()));
        Some([a?, b?])
    }

    /// A string that is not empty.
    pub fn text(&self, allowed: &str) -> Option<&'a str> {
        let Value::String(text) = &self.node.value else {
            self.refuse_type(allowed);
            return None;
        };
        if text.is_empty() {
            self.refuse(allowed);
            return None;
        }
        Some(text)
    }

    /// The path of a file that exists.
    pub fn file(&self) -> Option<PathBuf> {
        let text = self.text("the path of a file, in quotes, relative to the scene file")?;
        let path = self.context.base.join(text);
        let looked = format!("looked for {}; paths are relative to the scene file", path.display());
        let message = match std::fs::metadata(&path) {
            Ok(metadata) if metadata.is_dir() => format!("`{}`: `{text}` is a folder, not a file", self.path),
            Ok(_) => return Some(path),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                format!("`{}`: the file `{text}` does not exist", self.path)
            }
            Err(error) => format!("`{}`: the file `{text}` cannot be read: {error}", self.path),
        };
        self.report(message, looked);
        None
    }

    /// One of a list of names.
    pub fn choice<T: Clone>(&self, choices: &[(&'static str, T)]) -> Option<T> {
        let names: Vec<_> = choices.iter().map(|(name, _)| *name).collect();
        let Value::String(name) = &self.node.value else {
            self.refuse_type(&names.join(", "));
            return None;
        };
        let choice = choices.iter().find(|(known, _)| known == name).map(|(_, choice)| choice.clone());
        if choice.is_none() {
            self.refuse_name(name, &names);
        }
        choice
    }

    /// Reports a name that is not in a list.
    pub fn refuse_name(&self, name: &str, names: &[&str]) {
        self.report(format!("`{}` cannot be `{name}`", self.path), suggest(name, names));
    }

    /// A table; `allowed` says what may stand here.
    pub fn table(&self, allowed: &str) -> Option<Reader<'a>> {
        let Value::Table(table) = &self.node.value else {
            self.refuse_type(allowed);
            return None;
        };
        Some(Reader {
            context: self.context,
            table,
            place: Some(self.node.place),
            path: self.path.clone(),
            known: Vec::new(),
        })
    }

    /// A reader of `table`, the value of an entry of this table.
    pub fn inside(&self, entry: &'a Entry, table: &'a Table) -> Reader<'a> {
        Reader {
            context: self.context,
            table,
            place: Some(entry.node.place),
            path: format!("{}.{}", self.path, entry.key),
            known: Vec::new(),
        }
    }

    /// The tables of a list, `[[name]]`. A single `[name]` is reported and read as a list of one.
    pub fn list(&self) -> Vec<Reader<'a>> {
        let name = &self.path;
        match &self.node.value {
            Value::Array(items) => items
                .iter()
                .enumerate()
                .filter_map(|(i, node)| self.entry(i, node).table(&format!("a table, headed [[{name}]]")))
                .collect(),
            Value::Table(_) => {
                let help = format!("write [[{name}]]: there may be several; parts stay as they are, [{name}.part]");
                self.report(format!("`{name}` is a list, not one table"), help);
                self.table("").into_iter().collect()
            }
            Value::String(_) | Value::Integer(_) | Value::Float(_) | Value::Boolean(_) | Value::Datetime => {
                self.refuse_type(&format!("tables, each headed [[{name}]]"));
                Vec::new()
            }
        }
    }
}

/// "did you mean" where a name is near, and the list of what is allowed.
pub(super) fn suggest(wrong: &str, names: &[&str]) -> String {
    let wrong: Vec<char> = wrong.chars().flat_map(char::to_lowercase).take(64).collect();
    let nearest = names.iter().map(|name| (distance(&wrong, &name.chars().collect::<Vec<_>>()), name)).min();
    let allowed = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    match nearest {
        // A third of the letters may differ, and two in any but the shortest: more is no slip of the fingers.
        Some((edits, name)) if edits < name.len().min(wrong.len()) && edits <= (name.len() / 3).max(2) => {
            format!("did you mean `{name}`? allowed: {allowed}")
        }
        _ => format!("allowed: {allowed}"),
    }
}

/// Number of insertions, deletions, replacements and swaps of neighbours that turn `a` into `b`.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![(0..=b.len()).collect::<Vec<_>>()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let replaced = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = replaced.min(rows[i - 1][j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            row.push(best);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}
