//! The tags of an XML file, between which data of any length are left in the stream.

use crate::input::columns::{ReadError, quote};
use crate::input::source::Source;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use std::io::{self, BufRead, Read};

/// Longest tag or comment that is accepted, bytes.
const LONGEST_TAG: usize = 1 << 16;
/// Deepest nesting that is accepted; VTK's own has 7 levels.
const DEEPEST: usize = 64;

/// What a tag does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// `<a>`
    Open,
    /// `</a>`
    Close,
    /// `<a/>`
    Empty,
}

/// One tag.
#[derive(Clone, Debug)]
pub struct Tag {
    pub role: Role,
    pub name: String,
    attributes: Vec<(String, String)>,
    /// Byte of the file at which it begins.
    pub byte: u64,
}

impl Tag {
    fn new(role: Role, tag: &BytesStart, byte: u64) -> Result<Self, ReadError> {
        let mut attributes = Vec::new();
        // The check for two of the same name compares each with each.
        for attribute in tag.attributes().with_checks(false) {
            let wrong = |error: String| ReadError::content(format!("byte {byte}: {error}"));
            let attribute = attribute.map_err(|error| wrong(error.to_string()))?;
            let value =
                attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|error| wrong(error.to_string()))?;
            attributes.push((attribute.key.as_ref().to_owned(), value.into_owned()));
        }
        Ok(Self { role, name: tag.name().as_ref().to_owned(), attributes, byte })
    }

    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The integer that an attribute holds, if it is there.
    pub fn integer(&self, name: &str) -> Result<Option<u64>, ReadError> {
        let Some(text) = self.get(name) else { return Ok(None) };
        match text.trim().parse() {
            Ok(value) => Ok(Some(value)),
            Err(_) => {
                let found = quote(text.as_bytes());
                Err(self.wrong(format_args!("{name} is {found}; allowed: an integer from 0")))
            }
        }
    }

    /// An error at this tag.
    pub fn wrong(&self, message: impl std::fmt::Display) -> ReadError {
        ReadError::content(format!("byte {}, tag {}: {message}", self.byte, self.name))
    }
}

/// Reads tags from a stream.
pub struct Tags<'a> {
    reader: Reader<Markup<'a>>,
    buffer: Vec<u8>,
    depth: usize,
}

impl<'a> Tags<'a> {
    /// The stream from its beginning.
    pub fn new(source: Source<'a>) -> Self {
        Self { reader: Reader::from_reader(Markup { source, left: 0 }), buffer: Vec::new(), depth: 0 }
    }

    /// The stream behind the last tag, to read data from, up to a `<`.
    pub fn source(&mut self) -> &mut Source<'a> {
        &mut self.reader.get_mut().source
    }

    /// The next tag, past text and comments; none at the end of the stream.
    pub fn try_next(&mut self) -> Result<Option<Tag>, ReadError> {
        loop {
            self.skip_text()?;
            let byte = self.source().byte;
            self.reader.get_mut().left = LONGEST_TAG;
            self.buffer.clear();
            let event = self.reader.read_event_into(&mut self.buffer);
            let event = event.map_err(|error| match error {
                quick_xml::Error::Io(error) => ReadError::content(format!("byte {byte}: {error}")),
                error => ReadError::content(format!("byte {byte}: {error}")),
            })?;
            let tag = match event {
                Event::Eof => return Ok(None),
                Event::Start(tag) => Tag::new(Role::Open, &tag, byte)?,
                Event::Empty(tag) => Tag::new(Role::Empty, &tag, byte)?,
                Event::End(tag) => {
                    let name = tag.name().as_ref().to_owned();
                    Tag { role: Role::Close, name, attributes: Vec::new(), byte }
                }
                _ => continue,
            };
            match tag.role {
                Role::Open => self.depth += 1,
                Role::Close => self.depth = self.depth.saturating_sub(1),
                Role::Empty => {}
            }
            if self.depth > DEEPEST {
                return Err(tag.wrong(format_args!("more than {DEEPEST} tags within each other")));
            }
            return Ok(Some(tag));
        }
    }

    /// The next tag, within `parent`.
    pub fn next(&mut self, parent: &str) -> Result<Tag, ReadError> {
        match self.try_next()? {
            Some(tag) => Ok(tag),
            None => {
                let byte = self.source().byte;
                Err(ReadError::content(format!("byte {byte}: the file ends within {parent}: it is truncated")))
            }
        }
    }

    /// The next child of `parent`; none at its end.
    pub fn child(&mut self, parent: &str) -> Result<Option<Tag>, ReadError> {
        let tag = self.next(parent)?;
        Ok((tag.role != Role::Close).then_some(tag))
    }

    /// Passes over what is left of an element whose tag was read last.
    pub fn skip(&mut self, tag: &Tag) -> Result<(), ReadError> {
        let mut open = usize::from(tag.role == Role::Open);
        while open > 0 {
            match self.next(&tag.name)?.role {
                Role::Open => open += 1,
                Role::Close => open -= 1,
                Role::Empty => {}
            }
        }
        Ok(())
    }

    /// Passes over everything up to a `<`.
    fn skip_text(&mut self) -> Result<(), ReadError> {
        let source = self.source();
        loop {
            let text = source.available()?;
            let length = text.iter().position(|&byte| byte == b'<').unwrap_or(text.len());
            let done = length < text.len() || text.is_empty();
            let lines = count_lines(text.get(..length).unwrap_or_default());
            source.consume(length);
            source.line += lines;
            if done {
                return Ok(());
            }
        }
    }
}

/// A stream that ends with an error before a tag is too long to be one.
struct Markup<'a> {
    source: Source<'a>,
    /// Bytes that may still be read.
    left: usize,
}

impl Read for Markup<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for Markup<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.left == 0 {
            return Err(io::Error::other(format!("a tag or comment of more than {LONGEST_TAG} bytes")));
        }
        let available = self.source.available().map_err(|error| match error {
            ReadError::Io(error) => error,
            error => io::Error::other(error),
        })?;
        Ok(available.get(..self.left.min(available.len())).unwrap_or_default())
    }

    fn consume(&mut self, count: usize) {
        self.left -= count.min(self.left);
        // What is consumed is what was just looked at, so that this reads nothing.
        let lines = self.source.available().map_or(0, |text| count_lines(text.get(..count).unwrap_or_default()));
        self.source.consume(count);
        self.source.line += lines;
    }
}

/// Number of line ends.
pub fn count_lines(text: &[u8]) -> u64 {
    text.iter().filter(|&&byte| byte == b'\n').count() as u64
}
