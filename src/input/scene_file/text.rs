//! Texts that a person wrote and places in them: from byte offsets to lines and columns, and the list of problems.
//!
//! All texts (the scene file, then each `--set`) share one address space, laid end to end, so that a place alone says
//! which text it is in, and sorting by place is sorting in the order that the user wrote.

use crate::error::{Diagnostic, Span};
use std::cell::RefCell;

/// The most problems that are reported one by one; a file with more is no scene file.
const MAX_PROBLEMS: usize = 1000;

/// The most text that is quoted in all: every problem quotes its whole line, and a line may be megabytes long.
const MAX_QUOTED: usize = 1 << 22;

/// The most characters of an offending value that a message repeats.
const MAX_SNIPPET: usize = 60;

/// A stretch of bytes in the common address space of a [`Texts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    /// First byte.
    pub start: usize,
    /// One past the last byte.
    pub end: usize,
}

impl Place {
    /// The one that was written later: of two values that contradict, the one to complain about, since a `--set` comes
    /// after the file it changes.
    pub fn later(self, other: Self) -> Self {
        self.max(other)
    }
}

/// One text.
struct Text<'a> {
    name: &'a str,
    text: &'a str,
    /// Address of its first byte.
    start: usize,
    /// Offset of the first byte of each line.
    lines: Vec<usize>,
}

/// The texts, laid end to end.
#[derive(Default)]
pub(super) struct Texts<'a> {
    texts: Vec<Text<'a>>,
}

impl<'a> Texts<'a> {
    /// Adds a text and returns the address of its first byte.
    pub fn add(&mut self, name: &'a str, text: &'a str) -> usize {
        // One address more than the length: problems at the end of a text must not fall into the next one.
        let start = self.texts.last().map_or(0, |last| last.start + last.text.len() + 1);
        let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        self.texts.push(Text { name, text, start, lines });
        start
    }

    /// The text of a place, and the place as offsets in it, moved down to character boundaries.
    fn resolve(&self, place: Place) -> Option<(&Text<'a>, Place)> {
        let text = &self.texts[..self.texts.partition_point(|text| text.start <= place.start)].last()?;
        let boundary = |address: usize| {
            let mut at = address.saturating_sub(text.start).min(text.text.len());
            while !text.text.is_char_boundary(at) {
                at -= 1;
            }
            at
        };
        Some((text, Place { start: boundary(place.start), end: boundary(place.end.max(place.start)) }))
    }

    /// What stands at a place, for use inside a message: on one line, and cut short when it is long.
    pub fn snippet(&self, place: Place) -> String {
        let Some((text, Place { start, end })) = self.resolve(place) else {
            return String::new();
        };
        let whole = &text.text[start..end];
        let line = whole.lines().next().unwrap_or_default();
        let short: String = line.chars().take(MAX_SNIPPET).collect();
        if short.len() < whole.trim_end().len() { format!("{}...", short.trim_end()) } else { short }
    }

    /// The address at which the line of a place begins.
    pub fn line(&self, place: Place) -> usize {
        self.resolve(place).map_or(0, |(text, place)| {
            text.start + text.lines[text.lines.partition_point(|&line| line <= place.start) - 1]
        })
    }

    /// File name and position of a place.
    fn span(&self, place: Place) -> Option<(&'a str, Span)> {
        let (text, Place { start, end }) = self.resolve(place)?;
        let number = text.lines.partition_point(|&line| line <= start);
        let line_start = text.lines[number - 1];
        let line = text.text[line_start..].split('\n').next().unwrap_or_default();
        let line = line.strip_suffix('\r').unwrap_or(line);
        let within = |at: usize| at.saturating_sub(line_start).min(line.len());
        let column = line[..within(start)].chars().count() + 1;
        let length = line[within(start)..within(end)].chars().count().max(1);
        Some((text.name, Span { line: number, column, length, text: line.to_owned() }))
    }
}

/// One problem, before its place is looked up.
struct Problem {
    place: Option<Place>,
    message: String,
    help: String,
}

/// Collects problems while a scene is read, so that all of them can be shown at once.
pub(super) struct Problems<'a> {
    /// The texts that the places refer to.
    pub texts: &'a Texts<'a>,
    list: RefCell<Vec<Problem>>,
}

impl<'a> Problems<'a> {
    /// An empty list.
    pub fn new(texts: &'a Texts<'a>) -> Self {
        Self { texts, list: RefCell::default() }
    }

    /// Adds a problem; `place` is absent when the scene file as a whole is meant.
    pub fn report(&self, place: impl Into<Option<Place>>, message: impl Into<String>, help: impl Into<String>) {
        self.list.borrow_mut().push(Problem { place: place.into(), message: message.into(), help: help.into() });
    }

    /// Whether there is no problem so far.
    pub fn is_empty(&self) -> bool {
        self.list.borrow().is_empty()
    }

    /// The problems as they are shown: those of the file as a whole, then in the order of the text, then of the sets.
    pub fn into_diagnostics(self) -> Vec<Diagnostic> {
        let file = self.texts.texts.first().map_or("", |text| text.name);
        let mut problems = self.list.into_inner();
        problems.sort_by_key(|problem| problem.place);
        let count = problems.len();
        let mut diagnostics = Vec::new();
        let mut quoted = 0;
        for Problem { place, message, help } in problems {
            if diagnostics.len() == MAX_PROBLEMS || quoted > MAX_QUOTED {
                let message = format!("{} more problems", count - diagnostics.len());
                let help = "mend the first ones: the others may follow from them".to_owned();
                diagnostics.push(Diagnostic { file: file.to_owned(), span: None, message, help });
                break;
            }
            let (file, span) = match place.and_then(|place| self.texts.span(place)) {
                Some((file, span)) => (file, Some(span)),
                None => (file, None),
            };
            quoted += span.as_ref().map_or(0, |span| span.text.len());
            diagnostics.push(Diagnostic { file: file.to_owned(), span, message, help });
        }
        diagnostics
    }
}
