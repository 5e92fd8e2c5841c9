//! The data of one array: text, or bytes, raw or in base64, as they are or in compressed blocks.
//!
//! Bytes begin with a header of unsigned integers. Without compression it is the number of bytes of data. With it: the
//! number of blocks, bytes of a block before compression, bytes of the last block (0: as the others), and bytes of each
//! block after compression. In base64 the header may be padded, which ends a unit of four characters early.

use crate::input::columns::quote;
use crate::input::source::Source;
use crate::input::vtk::table::Table;
use crate::input::vtk::values::{Kind, Sink};
use crate::input::vtk::words::for_each_word;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::{Decompress, FlushDecompress, Status};

/// Bytes decoded at once.
const BLOCK: usize = 1 << 18;
/// Bytes of compressed data read at once.
const PIECE: usize = 1 << 16;
/// Base64: characters of a unit, and the bytes they hold.
const UNIT: [usize; 2] = [4, 3];
/// No LZ4 data become larger by more than this factor.
const LARGEST_LZ4_RATIO: u64 = 255;

/// How blocks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compressor {
    Zlib,
    Lz4,
}

/// What the first tag of a file says of its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoding {
    /// Whether bytes are in big-endian order.
    pub big: bool,
    /// Bytes of an integer of the headers.
    pub header: usize,
    /// Absent: not compressed.
    pub compressor: Option<Compressor>,
}

/// Reads words into `sink` up to a `<`: `values` of them, else it fails.
pub fn read_text(source: &mut Source, sink: &mut Sink, values: u64) -> Result<(), String> {
    let found = for_each_word(source, values, Some(b'<'), |_, word| sink.word(word)).map_err(|e| e.to_string())?;
    if found < values {
        return Err(format!("{found} values; expected {values}"));
    }
    Ok(())
}

/// Fails unless nothing but white space comes before a `<`.
pub fn expect_end(source: &mut Source, what: &str) -> Result<(), String> {
    let mut extra = Vec::new();
    for_each_word(source, 1, Some(b'<'), |_, word| {
        extra = word.to_vec();
        Ok(())
    })
    .map_err(|error| error.to_string())?;
    if extra.is_empty() { Ok(()) } else { Err(format!("{} follows {what}", quote(&extra))) }
}

/// A stream of the bytes of an array.
pub struct Bytes<'s, 'a> {
    source: &'s mut Source<'a>,
    base64: bool,
    /// Bytes of the file, if known.
    size: Option<u64>,
    /// Bytes that were decoded with those before.
    decoded: Vec<u8>,
    characters: Vec<u8>,
    block: Vec<u8>,
}

impl<'s, 'a> Bytes<'s, 'a> {
    pub fn new(source: &'s mut Source<'a>, base64: bool, size: Option<u64>) -> Self {
        Self { source, base64, size, decoded: Vec::new(), characters: Vec::new(), block: Vec::new() }
    }

    /// Fails if the file is too short for so many bytes.
    fn check(&self, bytes: u64) -> Result<(), String> {
        let Some(size) = self.size else { return Ok(()) };
        let available = size.saturating_sub(self.source.byte) + self.decoded.len() as u64;
        if bytes > available {
            return Err(format!(
                "{bytes} bytes of data, but the file has {available} more: it is truncated, or the number is wrong"
            ));
        }
        Ok(())
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<(), String> {
        if !self.base64 {
            return self.source.fill(out, || "the data of an array".to_owned()).map_err(|error| error.to_string());
        }
        let mut filled = 0;
        while filled < out.len() {
            let rest = out.get_mut(filled..).unwrap_or_default();
            if self.decoded.is_empty() {
                self.decode(rest.len())?;
            }
            let count = rest.len().min(self.decoded.len());
            let (head, _) = rest.split_at_mut(count);
            head.copy_from_slice(self.decoded.get(..count).unwrap_or_default());
            self.decoded.drain(..count);
            filled += count;
        }
        Ok(())
    }

    /// Decodes at least one byte, and at most what `wish` bytes take and the rest of their last unit.
    fn decode(&mut self, wish: usize) -> Result<(), String> {
        let units = wish.min(BLOCK).div_ceil(UNIT[1]);
        let wanted = units * UNIT[0];
        self.characters.clear();
        while self.characters.len() < wanted {
            let missing = wanted - self.characters.len();
            let available = self.source.available().map_err(|error| error.to_string())?;
            let part = available.get(..missing.min(available.len())).unwrap_or_default();
            let end = part.iter().position(|&byte| byte.is_ascii_whitespace() || byte == b'<');
            self.characters.extend_from_slice(part.get(..end.unwrap_or(part.len())).unwrap_or_default());
            let blank = end.and_then(|end| part.get(end)).is_some_and(u8::is_ascii_whitespace);
            let line = end.and_then(|end| part.get(end)) == Some(&b'\n');
            let stop = end.is_some() && !blank || part.is_empty();
            let used = end.unwrap_or(part.len()) + usize::from(blank);
            self.source.consume(used);
            self.source.line += u64::from(line);
            if stop {
                break;
            }
        }
        if self.characters.is_empty() {
            return Err(format!("byte {}: base64 data end too early", self.source.byte));
        }
        self.block.resize(units * UNIT[1], 0);
        let decoded = match STANDARD.decode_slice(&self.characters, &mut self.block) {
            Ok(count) => count,
            // Padding may stand before the end, where a header ends.
            Err(_) => {
                let mut count = 0;
                for unit in self.characters.chunks(UNIT[0]) {
                    let out = self.block.get_mut(count..).unwrap_or_default();
                    count += STANDARD.decode_slice(unit, out).map_err(|error| {
                        let byte = self.source.byte;
                        format!("before byte {byte}: {} in base64 data: {error}", quote(unit))
                    })?;
                }
                count
            }
        };
        self.decoded.extend_from_slice(self.block.get(..decoded).unwrap_or_default());
        if decoded == 0 { Err(format!("byte {}: base64 data end too early", self.source.byte)) } else { Ok(()) }
    }

    /// One integer of a header.
    fn integer(&mut self, encoding: Encoding) -> Result<u64, String> {
        let mut bytes = [0; 8];
        let (head, _) = bytes.split_at_mut(encoding.header.min(8));
        self.fill(head)?;
        if encoding.big {
            head.reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }

    /// Reads an array whose `values` values are of a kind, into `sink`. The memory meanwhile is checked by `table`.
    pub fn read(
        &mut self,
        sink: &mut Sink,
        kind: Kind,
        values: u64,
        encoding: Encoding,
        table: &Table,
    ) -> Result<(), String> {
        let expected = kind.bytes(values);
        let Some(compressor) = encoding.compressor else {
            let length = self.integer(encoding)?;
            if length != expected {
                return Err(format!("{length} bytes of data; {values} values of this type take {expected}"));
            }
            self.check(length)?;
            let mut block = vec![0; usize::try_from(length).unwrap_or(usize::MAX).min(sink.block(BLOCK))];
            let mut left = length;
            while left > 0 {
                let count = left.min(block.len() as u64);
                let part = block.get_mut(..count as usize).unwrap_or_default();
                self.fill(part)?;
                sink.push(part)?;
                left -= count;
                table.check_memory(sink.held(), 0, self.source.byte)?;
            }
            return Ok(());
        };
        let [count, block, last] = [self.integer(encoding)?, self.integer(encoding)?, self.integer(encoding)?];
        let last = if last == 0 { block } else { last };
        let total = count.checked_sub(1).map(|whole| u128::from(whole) * u128::from(block) + u128::from(last));
        if total != Some(expected.into()) || last > block || block == 0 {
            return Err(format!(
                "{count} blocks of {block} bytes, the last of {last}; {values} values of this type take {expected} bytes"
            ));
        }
        self.check(count.saturating_mul(encoding.header as u64))?;
        // Grows with what is there, as a count without a file behind it is not believed.
        let mut sizes = Vec::new();
        for _ in 0..count {
            sizes.push(self.integer(encoding)?);
        }
        let mut unpack = Unpack { inflate: Decompress::new(true), packed: Vec::new(), block: Vec::new() };
        for (index, &packed) in sizes.iter().enumerate() {
            let length = if index as u64 + 1 == count { last } else { block };
            self.check(packed)?;
            let result = match compressor {
                Compressor::Zlib => unpack.zlib(self, packed, length, sink, table),
                Compressor::Lz4 => unpack.lz4(self, packed, length, sink, table),
            };
            result.map_err(|problem| format!("block {index} of {count}: {problem}"))?;
        }
        Ok(())
    }
}

/// Decompression of one block after the other.
struct Unpack {
    inflate: Decompress,
    packed: Vec<u8>,
    block: Vec<u8>,
}

impl Unpack {
    /// Decompresses `packed` bytes, `length` of them afterwards, in bounded memory.
    fn zlib(
        &mut self,
        bytes: &mut Bytes,
        packed: u64,
        length: u64,
        sink: &mut Sink,
        table: &Table,
    ) -> Result<(), String> {
        self.inflate.reset(true);
        self.block.resize(usize::try_from(length).unwrap_or(usize::MAX).min(BLOCK), 0);
        self.packed.resize(usize::try_from(packed).unwrap_or(usize::MAX).min(PIECE), 0);
        let (mut left, mut done) = (packed, 0);
        let mut ended = false;
        while left > 0 {
            let count = left.min(self.packed.len() as u64);
            let input = self.packed.get_mut(..count as usize).unwrap_or_default();
            bytes.fill(input)?;
            left -= count;
            let mut used = 0;
            while !ended {
                let input = input.get(used..).unwrap_or_default();
                let before = [self.inflate.total_in(), self.inflate.total_out()];
                let status = self.inflate.decompress(input, &mut self.block, FlushDecompress::None);
                let status = status.map_err(|error| format!("zlib data: {error}"))?;
                let read = (self.inflate.total_in() - before[0]) as usize;
                let written = (self.inflate.total_out() - before[1]) as usize;
                used += read;
                done += written as u64;
                if done > length {
                    return Err(format!("zlib data of more than the {length} bytes that the header says"));
                }
                sink.push(self.block.get(..written).unwrap_or_default())?;
                ended = status == Status::StreamEnd;
                // The rest of the output comes without more input.
                if read == 0 && written == 0 || (used == count as usize && written < self.block.len()) {
                    break;
                }
            }
            table.check_memory(sink.held(), 0, bytes.source.byte)?;
        }
        if done == length && ended {
            return Ok(());
        }
        Err(format!("zlib data of {done} bytes where the header says {length}"))
    }

    /// Decompresses `packed` bytes, `length` of them afterwards; LZ4 refers back to all of them.
    fn lz4(
        &mut self,
        bytes: &mut Bytes,
        packed: u64,
        length: u64,
        sink: &mut Sink,
        table: &Table,
    ) -> Result<(), String> {
        if length / LARGEST_LZ4_RATIO > packed {
            return Err(format!("{length} bytes from {packed} of LZ4 data, which cannot be"));
        }
        table.check_memory(sink.held(), length.saturating_add(packed), bytes.source.byte)?;
        self.packed.clear();
        let mut left = packed;
        while left > 0 {
            let count = left.min(PIECE as u64) as usize;
            let start = self.packed.len();
            self.packed.resize(start + count, 0);
            bytes.fill(self.packed.get_mut(start..).unwrap_or_default())?;
            left -= count as u64;
        }
        let wanted = usize::try_from(length).map_err(|error| error.to_string())?;
        self.block.clear();
        self.block.try_reserve_exact(wanted).map_err(|_| format!("not enough memory for {length} bytes"))?;
        self.block.resize(wanted, 0);
        let written = lz4_flex::block::decompress_into(&self.packed, &mut self.block)
            .map_err(|error| format!("LZ4 data: {error}"))?;
        if written != wanted {
            return Err(format!("LZ4 data of {written} bytes where the header says {length}"));
        }
        for part in self.block.chunks(BLOCK) {
            sink.push(part)?;
        }
        Ok(())
    }
}
