//! The lines of OBJ and MTL files: a keyword and what follows it.

use super::Outcome;
use crate::input::source::Source;
use std::io::BufRead;

/// Longest statement that is accepted, bytes.
const LONGEST: u64 = 1 << 24;

/// The mark that some editors put before text in UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A line, with those that continue it.
pub(super) struct Statement<'a> {
    /// Line on which it begins, from 1.
    pub(super) line: u64,
    /// The first word.
    pub(super) keyword: &'a [u8],
    /// What follows it, without white space around.
    pub(super) rest: &'a [u8],
}

/// Reads one statement after the other, past blank lines and comments.
pub(super) struct Statements<'a> {
    source: Source<'a>,
    /// The last statement.
    text: Vec<u8>,
}

impl<'a> Statements<'a> {
    pub(super) fn new(reader: &'a mut dyn BufRead) -> Self {
        Self { source: Source::new(reader), text: Vec::new() }
    }

    /// The next statement; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Outcome<Option<Statement<'_>>> {
        let line = loop {
            if !self.read_line()? {
                return Ok(None);
            }
            let line = self.source.line;
            let mut text = self.source.text.as_slice();
            if line == 1 {
                text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
            }
            let text = text.trim_ascii();
            // A comment may end with a backslash, as paths do, and goes on no further.
            if text.is_empty() || text.starts_with(b"#") {
                continue;
            }
            self.text.clear();
            self.text.extend_from_slice(text);
            break line;
        };
        while self.text.last() == Some(&b'\\') {
            self.text.pop();
            self.text.push(b' ');
            if !self.read_line()? {
                break;
            }
            self.text.extend_from_slice(self.source.text.trim_ascii_end());
            if self.text.len() as u64 > LONGEST {
                return Err(format!("line {line}: with the lines that continue it longer than {LONGEST} bytes"));
            }
        }
        let (keyword, rest) = word(&self.text);
        Ok(Some(Statement { line, keyword, rest }))
    }

    fn read_line(&mut self) -> Outcome<bool> {
        self.source.read_line(LONGEST).map_err(|e| e.to_string())
    }
}

/// The first word of a text and the rest, without white space around.
pub(super) fn word(text: &[u8]) -> (&[u8], &[u8]) {
    let text = text.trim_ascii();
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
    let (word, rest) = text.split_at(end);
    (word, rest.trim_ascii())
}

/// The words of a text up to a comment.
pub(super) fn fields(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()).take_while(|field| !field.starts_with(b"#"))
}

/// A name, which may have spaces and number signs in it, without the comment that may follow.
pub(super) fn uncommented(text: &[u8]) -> &[u8] {
    let comment = text.windows(2).position(|pair| pair[0].is_ascii_whitespace() && pair[1] == b'#');
    text[..comment.unwrap_or(text.len())].trim_ascii()
}
