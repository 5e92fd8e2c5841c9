//! The document as a tree of values that each know their place, from TOML text.
//!
//! A tree of our own, and not the parser's: its places are addresses among all texts, so that the value of a `--set`
//! keeps its position inside a document that came from a file.

use super::text::{Place, Problems};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

/// Deepest nesting of values. A scene needs five levels; the bound keeps recursion off the end of the stack.
pub(super) const MAX_DEPTH: usize = 32;

/// Size up to which every syntax error of a text is reported, bytes. In a larger one, which is a data file given by
/// mistake rather than a scene, each line may be wrong, and the parser's list of errors would take gigabytes.
const MAX_RECOVERED: usize = 1 << 18;

/// A value.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Where it stands; of a table, its header or the key that opens it.
    pub place: Place,
    /// What it is.
    pub value: Value,
}

/// What a value is.
#[derive(Clone, Debug)]
pub(super) enum Value {
    /// A string, unescaped.
    String(String),
    /// An integer; absent where it needs more than 128 bits.
    Integer(Option<i128>),
    /// A float, which may be infinite or not a number.
    Float(f64),
    /// `true` or `false`.
    Boolean(bool),
    /// A date or time, which no key wants.
    Datetime,
    /// An array, or the tables of `[[name]]` headers.
    Array(Vec<Node>),
    /// A table.
    Table(Table),
}

impl Value {
    /// What it is, with its article, in the words of the TOML specification.
    pub fn description(&self) -> &'static str {
        match self {
            Self::String(_) => "the string",
            Self::Integer(_) => "the integer",
            Self::Float(_) => "the float",
            Self::Boolean(_) => "the boolean",
            Self::Datetime => "the date or time",
            Self::Array(_) => "the array",
            Self::Table(_) => "the table",
        }
    }
}

/// A table: its entries in the order of their places.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    /// The entries; keys differ.
    pub entries: Vec<Entry>,
}

impl Table {
    /// The entry of a key.
    pub fn get(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }
}

/// A key and its value.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// The key, unescaped.
    pub key: String,
    /// Where the key stands.
    pub key_place: Place,
    /// The value.
    pub node: Node,
}

/// Parses a document whose first byte has address `base`. Syntax errors are reported and yield `None`: what the parser
/// could make of the rest would only raise problems that are not there.
pub(super) fn parse_document(text: &str, base: usize, problems: &Problems<'_>) -> Option<Node> {
    let parsed = if text.len() > MAX_RECOVERED {
        DeTable::parse(text).map_err(|error| vec![error])
    } else {
        match DeTable::parse_recoverable(text) {
            (document, errors) if errors.is_empty() => Ok(document),
            (_, errors) => Err(errors),
        }
    };
    match parsed {
        Ok(document) => {
            let place = Place { start: base, end: base };
            Some(Node { place, value: Builder { base, problems }.table(document.get_ref(), 0) })
        }
        Err(errors) => {
            report(&errors, base, problems);
            None
        }
    }
}

/// Parses the value of a `--set`, without white space around it, whose first byte has address `base`. A text that is no
/// TOML and does not begin like a quoted string, an array or a table is a string as it stands.
pub(super) fn parse_value(text: &str, base: usize, problems: &Problems<'_>) -> Option<Node> {
    let (value, errors) = DeValue::parse_recoverable(text);
    let end = base + text.len();
    if errors.is_empty() {
        Some(Builder { base, problems }.node(&value, 0))
    } else if text.starts_with(['"', '\'', '[', '{']) {
        report(&errors, base, problems);
        None
    } else {
        Some(Node { place: Place { start: base, end }, value: Value::String(text.to_owned()) })
    }
}

/// Reports what the parser found, the first on each line: one slip often raises several errors.
fn report(errors: &[toml::de::Error], base: usize, problems: &Problems<'_>) {
    let mut errors: Vec<_> =
        errors.iter().map(|error| (error.span().map(|span| shift(base, &span)), error.message())).collect();
    errors.sort();
    errors.dedup_by_key(|(place, _)| place.map(|place| problems.texts.line(place)));
    for (place, message) in errors {
        let snippet = place.map(|place| problems.texts.snippet(place)).filter(|snippet| !snippet.trim().is_empty());
        let at = snippet.map_or_else(String::new, |snippet| format!(" at `{snippet}`"));
        // The parser takes any bare word that begins with t or f for a mistyped boolean.
        let message =
            if message.starts_with("invalid boolean") { "neither a boolean nor a string in quotes" } else { message };
        let help = match message {
            "duplicate key" => {
                "a key or table may stand only once; entries of a list are headed [[particles]], [[mesh]]"
            }
            _ => "allowed: TOML, `key = value` lines below `[table]` headers; strings in quotes",
        };
        problems.report(place, format!("invalid TOML{at}: {message}"), help);
    }
}

fn shift(base: usize, span: &Range<usize>) -> Place {
    Place { start: base + span.start, end: base + span.end }
}

/// Turns the parser's tree into ours.
struct Builder<'a> {
    base: usize,
    problems: &'a Problems<'a>,
}

impl Builder<'_> {
    fn node(&self, value: &Spanned<DeValue<'_>>, depth: usize) -> Node {
        let place = shift(self.base, &value.span());
        let value = match value.get_ref() {
            DeValue::String(text) => Value::String(text.to_string()),
            DeValue::Integer(integer) => Value::Integer(integer_value(integer)),
            // The parser has checked the form, so this fails for no text; an overflow is infinite and refused later.
            DeValue::Float(float) => Value::Float(float.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Boolean(value) => Value::Boolean(*value),
            DeValue::Datetime(_) => Value::Datetime,
            DeValue::Array(_) | DeValue::Table(_) if depth == MAX_DEPTH => {
                self.problems.report(place, "nested too deeply", format!("allowed: {MAX_DEPTH} levels"));
                Value::Table(Table::default())
            }
            DeValue::Array(items) => Value::Array(items.iter().map(|item| self.node(item, depth + 1)).collect()),
            DeValue::Table(table) => self.table(table, depth),
        };
        Node { place, value }
    }

    fn table(&self, table: &DeTable<'_>, depth: usize) -> Value {
        let mut entries: Vec<Entry> = table
            .iter()
            .map(|(key, value)| Entry {
                key: key.get_ref().to_string(),
                key_place: shift(self.base, &key.span()),
                node: self.node(value, depth + 1),
            })
            .collect();
        entries.sort_by_key(|entry| entry.key_place);
        Value::Table(Table { entries })
    }
}

fn integer_value(integer: &DeInteger<'_>) -> Option<i128> {
    i128::from_str_radix(integer.as_str(), integer.radix()).ok()
}
