//! The values of a node: how many a file holds of them, compressed how, in which number type.

use super::super::columns::ReadError;
use super::super::scalar::Scalar;
use super::blosc;
use super::bytes::Input;
use super::header::NODE_MASK_COMPRESSION;
use flate2::{Decompress, FlushDecompress, Status};
use half::f16;
use std::ops::Range;

/// Flag: values are compressed with zlib.
pub const ZIP: u32 = 0x1;
/// Flag: inactive values are left out where that is possible.
const ACTIVE_MASK: u32 = 0x2;
/// Flag: values are compressed with Blosc.
const BLOSC: u32 = 0x4;

/// What stands before a node's values for its inactive ones: nothing; one value; a mask that chooses between two known
/// values, with none, one or two of them; nothing, and the inactive values stand among the others.
const ONE_VALUE: u8 = 2;
const MASK: u8 = 3;
const MASK_AND_ONE_VALUE: u8 = 4;
const MASK_AND_TWO_VALUES: u8 = 5;
const ALL_VALUES: u8 = 6;

/// Compressed values may be longer than the values, by what a container adds.
const OVERHEAD: usize = 1 << 10;

/// Refuses flags of no known compression.
pub fn check_flags(flags: u32) -> Result<(), String> {
    if flags & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
        return Err(format!("compression {flags:#x}; allowed: sums of 1 (zip), 2 (active mask) and 4 (blosc)"));
    }
    Ok(())
}

/// How the values of nodes are stored.
#[derive(Clone, Copy, Debug)]
pub struct Values {
    version: u32,
    flags: u32,
    /// Type of single values: background, tiles of the root, inactive values.
    scalar: Scalar,
    /// Whether the values of nodes are stored with 16 bits.
    half: bool,
}

/// The values of a node as the file has them.
#[derive(Debug)]
pub struct Stored {
    /// Where they are in the buffer of [`Values::fetch`].
    range: Range<usize>,
    /// Number of values.
    count: usize,
    /// Whether they are those of active items alone.
    active_alone: bool,
    /// Whether they are compressed.
    compressed: bool,
    /// Byte of the file where they begin.
    place: u64,
}

/// Memory of [`Values::decode`], kept from one node to the next.
pub struct Scratch {
    zlib: Decompress,
    shuffled: Vec<u8>,
    plain: Vec<u8>,
    /// The values in the file's order.
    values: Vec<f64>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self { zlib: Decompress::new(true), shuffled: Vec::new(), plain: Vec::new(), values: Vec::new() }
    }
}

impl Values {
    /// For a file of that version and a grid of that compression, whose numbers are of that type, or of 16 bits.
    pub fn new(version: u32, flags: u32, scalar: Scalar, half: bool) -> Self {
        Self { version, flags, scalar, half }
    }

    /// Bytes of a value that stands alone.
    pub fn single_size(&self) -> u64 {
        self.scalar.size() as u64
    }

    /// Whether the file is of a time when leaves had more about themselves and nodes left out the places of children.
    pub fn is_old(&self) -> bool {
        self.version < NODE_MASK_COMPRESSION
    }

    /// Whether decoding is work for more than one thread.
    pub fn is_compressed(&self) -> bool {
        self.flags & (ZIP | BLOSC) != 0
    }

    /// Fewest bytes in which a node's active values can be stored.
    pub fn smallest(&self, active: u64) -> u64 {
        if self.is_compressed() { 0 } else { active * self.value_size() as u64 }
    }

    fn value_size(&self) -> usize {
        if self.half { size_of::<f16>() } else { self.scalar.size() }
    }

    /// Reads a value that stands alone.
    pub fn single(&self, input: &mut Input, what: &str) -> Result<f64, ReadError> {
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..self.scalar.size()];
        input.fill(bytes, what)?;
        let mut value = Vec::with_capacity(1);
        self.scalar.decode::<false>(bytes, self.scalar.size(), 0, &mut value);
        Ok(value.first().copied().unwrap_or_default())
    }

    /// Reads the values of a node as the file has them and appends their bytes to `data`. Both masks have the same
    /// length; `children` is absent in leaves.
    pub fn fetch(
        &self,
        input: &mut Input,
        active: &[u64],
        children: Option<&[u64]>,
        data: &mut Vec<u8>,
        what: &str,
    ) -> Result<Stored, ReadError> {
        let items = 64 * active.len();
        let mut active_alone = false;
        if !self.is_old() {
            let code = input.u8(what)?;
            let skipped = match code {
                0 | 1 | ALL_VALUES => 0,
                ONE_VALUE => self.scalar.size(),
                MASK => items / 8,
                MASK_AND_ONE_VALUE => self.scalar.size() + items / 8,
                MASK_AND_TWO_VALUES => 2 * self.scalar.size() + items / 8,
                _ => {
                    return Err(
                        input.wrong(format_args!("code {code} for the inactive values of {what}; allowed: 0 to 6"))
                    );
                }
            };
            input.skip(skipped as u64, what)?;
            active_alone = self.flags & ACTIVE_MASK != 0 && code != ALL_VALUES;
        }
        let count = match children {
            _ if active_alone => ones(active),
            Some(children) if self.is_old() => items - ones(children),
            _ => items,
        };
        Ok(Stored { active_alone, ..self.fetch_count(input, count, data, what)? })
    }

    /// Reads `count` values, at most those of the largest node.
    pub fn fetch_count(
        &self,
        input: &mut Input,
        count: usize,
        data: &mut Vec<u8>,
        what: &str,
    ) -> Result<Stored, ReadError> {
        let place = input.position();
        let start = data.len();
        let mut length = count * self.value_size();
        let mut compressed = false;
        // Of no halves not even a length is written.
        if self.is_compressed() && !(self.half && count == 0) {
            let wrong = |message: String| ReadError::content(format!("byte {place}: {message}, in {what}"));
            let stated = input.i64(what)?;
            compressed = stated > 0;
            if !compressed && stated.unsigned_abs() != length as u64 {
                return Err(wrong(format!("{} uncompressed bytes; allowed here: {length}", stated.unsigned_abs())));
            }
            if compressed {
                let most = 2 * length + OVERHEAD;
                length = usize::try_from(stated).ok().filter(|&stated| stated <= most).ok_or_else(|| {
                    wrong(format!("{stated} compressed bytes for {length} uncompressed ones; allowed: at most {most}"))
                })?;
            }
        }
        data.resize(start + length, 0);
        input.fill(&mut data[start..], what)?;
        Ok(Stored { range: start..data.len(), count, active_alone: false, compressed, place })
    }

    /// From what [`Values::fetch`] read with the same masks to the values of the `active` items that are no children, in
    /// their order.
    pub fn decode(
        &self,
        stored: &Stored,
        data: &[u8],
        active: &[u64],
        children: Option<&[u64]>,
        scratch: &mut Scratch,
        out: &mut Vec<f64>,
        what: &str,
    ) -> Result<(), ReadError> {
        let items = 64 * active.len();
        let bytes = data.get(stored.range.clone()).unwrap_or_default();
        let Scratch { zlib, shuffled, plain, values } = scratch;
        let plain = if stored.compressed {
            plain.resize(stored.count * self.value_size(), 0);
            let result = if self.flags & BLOSC != 0 {
                blosc::decompress(bytes, plain, shuffled, zlib)
            } else {
                inflate(zlib, bytes, plain)
            };
            result.map_err(|message| ReadError::content(format!("byte {}: {message}, in {what}", stored.place)))?;
            plain.as_slice()
        } else {
            bytes
        };
        values.clear();
        if self.half {
            let halves = plain.chunks_exact(size_of::<f16>()).map(|pair| f16::from_le_bytes([pair[0], pair[1]]));
            values.extend(halves.map(|half| f64::from(half.to_f32())));
        } else {
            self.scalar.decode::<false>(plain, self.scalar.size(), 0, values);
        }
        out.clear();
        match children {
            None if stored.active_alone || ones(active) == items => std::mem::swap(out, values),
            None => out.extend(bits(active).filter_map(|item| values.get(item))),
            Some(children) if stored.active_alone => {
                let pairs = bits(active).zip(&*values);
                out.extend(pairs.filter(|&(item, _)| !is_on(children, item)).map(|(_, value)| value));
            }
            Some(children) if self.is_old() => {
                let pairs = (0..items).filter(|&item| !is_on(children, item)).zip(&*values);
                out.extend(pairs.filter(|&(item, _)| is_on(active, item)).map(|(_, value)| value));
            }
            Some(children) => {
                let tiles = bits(active).filter(|&item| !is_on(children, item));
                out.extend(tiles.filter_map(|item| values.get(item)));
            }
        }
        Ok(())
    }
}

/// Unpacks zlib data that must hold exactly as many bytes as `out`.
pub fn inflate(zlib: &mut Decompress, packed: &[u8], out: &mut [u8]) -> Result<(), String> {
    zlib.reset(true);
    let expected = out.len() as u64;
    match zlib.decompress(packed, out, FlushDecompress::Finish) {
        Ok(Status::StreamEnd) if zlib.total_out() == expected => Ok(()),
        Ok(Status::StreamEnd) => Err(format!("zlib data hold {} bytes instead of {expected}", zlib.total_out())),
        Ok(_) => Err(format!("zlib data do not end with the {expected} bytes that they should hold")),
        Err(error) => Err(format!("zlib data are damaged: {error}")),
    }
}

/// How many bits are set.
pub fn ones(mask: &[u64]) -> usize {
    mask.iter().map(|word| word.count_ones() as usize).sum()
}

/// Whether a bit is set.
pub fn is_on(mask: &[u64], bit: usize) -> bool {
    mask.get(bit / 64).is_some_and(|word| word >> (bit % 64) & 1 != 0)
}

/// The bits that are set, in order.
pub fn bits(mask: &[u64]) -> impl Iterator<Item = usize> {
    mask.iter().enumerate().flat_map(|(index, &word)| {
        let mut left = word;
        std::iter::from_fn(move || {
            let bit = left.trailing_zeros() as usize;
            // Clears the lowest bit; of 0 nothing is left.
            (left != 0).then(|| {
                left &= left - 1;
                64 * index + bit
            })
        })
    })
}
