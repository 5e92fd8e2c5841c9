//! A stream of bytes that knows where it stands, for readers of text and binary formats.

use super::columns::ReadError;
use std::io::{BufRead, ErrorKind};

/// A stream that knows where it stands.
pub struct Source<'a> {
    reader: &'a mut dyn BufRead,
    /// Bytes consumed.
    pub byte: u64,
    /// Lines consumed: after a line was read, its number from 1.
    pub line: u64,
    /// The last line read, without its end.
    pub text: Vec<u8>,
}

impl<'a> Source<'a> {
    /// The stream from its beginning.
    pub fn new(reader: &'a mut dyn BufRead) -> Self {
        Self { reader, byte: 0, line: 0, text: Vec::new() }
    }

    /// Reads a line of at most `limit` bytes into `text`; false at the end of the stream.
    pub fn read_line(&mut self, limit: u64) -> Result<bool, ReadError> {
        self.text.clear();
        let mut ended = false;
        while !ended {
            let input = match self.reader.fill_buf() {
                Ok(input) => input,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(error.into()),
            };
            if input.is_empty() {
                if self.text.is_empty() {
                    return Ok(false);
                }
                break;
            }
            let end = input.iter().position(|&byte| byte == b'\n');
            ended = end.is_some();
            let used = end.map_or(input.len(), |end| end + 1);
            self.text.extend_from_slice(&input[..used]);
            self.reader.consume(used);
            self.byte += used as u64;
            if self.text.len() as u64 > limit {
                let message = format!("line {}: longer than {limit} bytes", self.line + 1);
                return Err(ReadError::content(message));
            }
        }
        self.line += 1;
        while self.text.last().is_some_and(|&byte| byte == b'\n' || byte == b'\r') {
            self.text.pop();
        }
        Ok(true)
    }

    /// The fields of the last line read.
    pub fn fields(&self) -> impl Iterator<Item = &[u8]> {
        self.text.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty())
    }

    /// Fills `block`; `place` names what it is part of should the stream end.
    pub fn fill(&mut self, block: &mut [u8], place: impl Fn() -> String) -> Result<(), ReadError> {
        let mut filled = 0;
        while filled < block.len() {
            match self.reader.read(&mut block[filled..]) {
                Ok(0) => {
                    let byte = self.byte + filled as u64;
                    return Err(ReadError::content(format!("byte {byte}: the file ends within {}", place())));
                }
                Ok(n) => filled += n,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        self.byte += filled as u64;
        Ok(())
    }

    /// Reads what comes next into the beginning of `bytes` and returns how much, 0 only at the end of the stream.
    pub fn read_some(&mut self, bytes: &mut [u8]) -> Result<usize, ReadError> {
        loop {
            match self.reader.read(bytes) {
                Ok(count) => {
                    self.byte += count as u64;
                    return Ok(count);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Passes over `count` bytes; `place` names what they are part of should the stream end.
    pub fn skip(&mut self, mut count: u64, place: impl Fn() -> String) -> Result<(), ReadError> {
        while count > 0 {
            let available = match self.reader.fill_buf() {
                Ok(input) => input.len() as u64,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(error.into()),
            };
            if available == 0 {
                return Err(ReadError::content(format!("byte {}: the file ends within {}", self.byte, place())));
            }
            let used = available.min(count);
            self.reader.consume(used as usize);
            self.byte += used;
            count -= used;
        }
        Ok(())
    }

    /// What can be looked at without another read; empty at the end of the stream.
    pub fn available(&mut self) -> Result<&[u8], ReadError> {
        loop {
            match self.reader.fill_buf() {
                Ok(_) => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        // A second call gives what is there: a borrow cannot leave a loop that goes on in another arm.
        Ok(self.reader.fill_buf()?)
    }

    /// Passes over `count` of the [`Source::available`] bytes. Lines are not counted.
    pub fn consume(&mut self, count: usize) {
        self.reader.consume(count);
        self.byte += count as u64;
    }
}
