//! The values of a node: how many a file holds of them, compressed how, in which number type.

use super::super::columns::ReadError;
use super::super::scalar::Scalar;
use super::blosc;
use super::bytes::Input;
use super::header::NODE_MASK_COMPRESSION;
use flate2::{Decompress, FlushDecompress, Status};
use half::f16;

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

/// Reads the values of nodes.
pub struct Values {
    version: u32,
    flags: u32,
    /// Type of single values: background, tiles of the root, inactive values.
    scalar: Scalar,
    /// Whether the values of nodes are stored with 16 bits.
    half: bool,
    zlib: Decompress,
    packed: Vec<u8>,
    shuffled: Vec<u8>,
    plain: Vec<u8>,
    /// Room for the values that a caller asked for, kept from one leaf to the next.
    pub out: Vec<f64>,
    /// The values as the file has them.
    stored: Vec<f64>,
}

impl Values {
    /// For a file of that version and a grid of that compression, whose numbers are of that type, or of 16 bits.
    pub fn new(version: u32, flags: u32, scalar: Scalar, half: bool) -> Self {
        let (packed, shuffled, plain, out, stored) = Default::default();
        Self { version, flags, scalar, half, zlib: Decompress::new(true), packed, shuffled, plain, out, stored }
    }

    /// Bytes of a value that stands alone.
    pub fn single_size(&self) -> u64 {
        self.scalar.size() as u64
    }

    /// Whether the file is of a time when leaves had more about themselves and nodes left out the places of children.
    pub fn is_old(&self) -> bool {
        self.version < NODE_MASK_COMPRESSION
    }

    /// Fewest bytes in which a node's active values can be stored.
    pub fn smallest(&self, active: u64) -> u64 {
        if self.flags & (ZIP | BLOSC) != 0 { 0 } else { active * self.value_size() as u64 }
    }

    fn value_size(&self) -> usize {
        if self.half { size_of::<f16>() } else { self.scalar.size() }
    }

    /// Reads a value that stands alone.
    pub fn single(&mut self, input: &mut Input, what: &str) -> Result<f64, ReadError> {
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..self.scalar.size()];
        input.fill(bytes, what)?;
        self.stored.clear();
        self.scalar.decode::<false>(bytes, self.scalar.size(), 0, &mut self.stored);
        Ok(self.stored.first().copied().unwrap_or_default())
    }

    /// Reads the values of a node and returns those of its `active` items that are no children, in their order.
    ///
    /// Both masks have the same length; `children` is absent in leaves.
    pub fn read(
        &mut self,
        input: &mut Input,
        active: &[u64],
        children: Option<&[u64]>,
        out: &mut Vec<f64>,
        what: &str,
    ) -> Result<(), ReadError> {
        let items = 64 * active.len();
        let mut is_packed = false;
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
            is_packed = self.flags & ACTIVE_MASK != 0 && code != ALL_VALUES;
        }
        let count = match children {
            _ if is_packed => ones(active),
            Some(children) if self.is_old() => items - ones(children),
            _ => items,
        };
        self.read_stored(input, count, what)?;
        out.clear();
        match children {
            None if is_packed || ones(active) == items => std::mem::swap(out, &mut self.stored),
            None => out.extend(bits(active).filter_map(|item| self.stored.get(item))),
            Some(children) if is_packed => {
                let stored = bits(active).zip(&self.stored);
                out.extend(stored.filter(|&(item, _)| !is_on(children, item)).map(|(_, value)| value));
            }
            Some(children) if self.is_old() => {
                let stored = (0..items).filter(|&item| !is_on(children, item)).zip(&self.stored);
                out.extend(stored.filter(|&(item, _)| is_on(active, item)).map(|(_, value)| value));
            }
            Some(children) => {
                let tiles = bits(active).filter(|&item| !is_on(children, item));
                out.extend(tiles.filter_map(|item| self.stored.get(item)));
            }
        }
        Ok(())
    }

    /// Reads values that are not returned, of old leaves.
    pub fn pass_over(&mut self, input: &mut Input, count: usize, what: &str) -> Result<(), ReadError> {
        self.read_stored(input, count, what)
    }

    /// Reads `count` values, at most those of the largest node, into `stored`.
    fn read_stored(&mut self, input: &mut Input, count: usize, what: &str) -> Result<(), ReadError> {
        self.stored.clear();
        if self.half && count == 0 {
            // Not even a length is written then.
            return Ok(());
        }
        let bytes = count * self.value_size();
        self.plain.resize(bytes, 0);
        if self.flags & (ZIP | BLOSC) == 0 {
            input.fill(&mut self.plain, what)?;
        } else {
            self.read_packed(input, bytes, what)?;
        }
        if self.half {
            let halves = self.plain.chunks_exact(size_of::<f16>()).map(|pair| f16::from_le_bytes([pair[0], pair[1]]));
            self.stored.extend(halves.map(|half| f64::from(half.to_f32())));
        } else {
            self.scalar.decode::<false>(&self.plain, self.scalar.size(), 0, &mut self.stored);
        }
        Ok(())
    }

    /// Reads values of so many bytes in a length and what is compressed, or not if the length is negative.
    fn read_packed(&mut self, input: &mut Input, bytes: usize, what: &str) -> Result<(), ReadError> {
        let place = input.position();
        let wrong = |message: String| ReadError::content(format!("byte {place}: {message}, in {what}"));
        let length = input.i64(what)?;
        if length <= 0 {
            if length.unsigned_abs() != bytes as u64 {
                return Err(wrong(format!("{} uncompressed bytes; allowed here: {bytes}", length.unsigned_abs())));
            }
            return input.fill(&mut self.plain, what);
        }
        let most = 2 * bytes + OVERHEAD;
        let length = usize::try_from(length).ok().filter(|&length| length <= most).ok_or_else(|| {
            wrong(format!("{length} compressed bytes for {bytes} uncompressed ones; allowed: at most {most}"))
        })?;
        self.packed.resize(length, 0);
        input.fill(&mut self.packed, what)?;
        let result = if self.flags & BLOSC != 0 {
            blosc::decompress(&self.packed, &mut self.plain, &mut self.shuffled, &mut self.zlib)
        } else {
            inflate(&mut self.zlib, &self.packed, &mut self.plain)
        };
        result.map_err(wrong)
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
