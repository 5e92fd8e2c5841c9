//! Numbers and texts of a VDB file, all little-endian, from a stream that knows where it stands.

use super::super::columns::ReadError;
use super::super::source::Source;
use std::io::BufRead;

/// Longest name or type name that is accepted, bytes.
const LONGEST_TEXT: u32 = 1 << 16;
/// Bytes to reserve at once where nothing proves that the file has so many.
const CAUTIOUS: u64 = 1 << 18;

/// A VDB file, or a part of one, read forward.
pub struct Input<'a> {
    source: Source<'a>,
    size: Option<u64>,
}

impl<'a> Input<'a> {
    /// A stream that stands at byte `position` of a file of `size` bytes, if that is known.
    pub fn new(reader: &'a mut dyn BufRead, position: u64, size: Option<u64>) -> Self {
        let mut source = Source::new(reader);
        source.byte = position;
        Self { source, size }
    }

    /// Bytes of the file before the next one.
    pub fn position(&self) -> u64 {
        self.source.byte
    }

    /// Bytes of the file, if known.
    pub fn size(&self) -> Option<u64> {
        self.size
    }

    /// An error at the place where the stream stands.
    pub fn wrong(&self, message: impl std::fmt::Display) -> ReadError {
        ReadError::content(format!("byte {}: {message}", self.position()))
    }

    /// Refuses what cannot follow because the file is too small, if its size is known.
    pub fn need(&self, bytes: u64, what: &str) -> Result<(), ReadError> {
        let left = self.size.map_or(u64::MAX, |size| size.saturating_sub(self.position()));
        if bytes > left {
            return Err(self.wrong(format_args!(
                "{what} of at least {bytes} bytes, but {left} are left: the file is truncated, or a number is wrong"
            )));
        }
        Ok(())
    }

    /// Fills `block`.
    pub fn fill(&mut self, block: &mut [u8], what: &str) -> Result<(), ReadError> {
        self.source.fill(block, || what.to_owned())
    }

    /// Passes over `count` bytes.
    pub fn skip(&mut self, count: u64, what: &str) -> Result<(), ReadError> {
        self.need(count, what)?;
        self.source.skip(count, || what.to_owned())
    }

    /// The next `count` bytes.
    pub fn take(&mut self, count: u64, what: &str) -> Result<Vec<u8>, ReadError> {
        self.need(count, what)?;
        let mut bytes = Vec::new();
        while (bytes.len() as u64) < count {
            let done = bytes.len();
            let left = count - done as u64;
            // Nothing but the bytes read so far proves a count where the size of the file is unknown.
            let more = if self.size.is_some() { left } else { left.min(CAUTIOUS.max(done as u64)) } as usize;
            bytes.try_reserve_exact(more).map_err(|_| self.wrong(format_args!("not enough memory for {what}")))?;
            bytes.resize(done + more, 0);
            self.fill(&mut bytes[done..], what)?;
        }
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut bytes = [0; N];
        self.fill(&mut bytes, what)?;
        Ok(bytes)
    }

    /// One byte.
    pub fn u8(&mut self, what: &str) -> Result<u8, ReadError> {
        Ok(u8::from_le_bytes(self.array(what)?))
    }

    /// A 32-bit integer.
    pub fn u32(&mut self, what: &str) -> Result<u32, ReadError> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    /// A signed 32-bit integer.
    pub fn i32(&mut self, what: &str) -> Result<i32, ReadError> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    /// A signed 64-bit integer.
    pub fn i64(&mut self, what: &str) -> Result<i64, ReadError> {
        Ok(i64::from_le_bytes(self.array(what)?))
    }

    /// A number of 64 bits.
    pub fn f64(&mut self, what: &str) -> Result<f64, ReadError> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    /// Three signed 32-bit integers.
    pub fn coordinates(&mut self, what: &str) -> Result<[i32; 3], ReadError> {
        Ok([self.i32(what)?, self.i32(what)?, self.i32(what)?])
    }

    /// A bit mask, bit i of word w is item 64 w + i.
    pub fn mask(&mut self, words: &mut [u64], what: &str) -> Result<(), ReadError> {
        let mut bytes = [0; 512];
        for words in words.chunks_mut(bytes.len() / 8) {
            let bytes = &mut bytes[..8 * words.len()];
            self.fill(bytes, what)?;
            for (word, bytes) in words.iter_mut().zip(bytes.as_chunks::<8>().0) {
                *word = u64::from_le_bytes(*bytes);
            }
        }
        Ok(())
    }

    /// A text with its length before it; what is no UTF-8 is replaced.
    pub fn text(&mut self, what: &str) -> Result<String, ReadError> {
        let length = self.u32(what)?;
        if length > LONGEST_TEXT {
            return Err(self.wrong(format_args!("{what} has {length} bytes; allowed: at most {LONGEST_TEXT}")));
        }
        let bytes = self.take(length.into(), what)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}
