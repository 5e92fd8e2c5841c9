//! Containers of Blosc 1, in which OpenVDB compresses the values of nodes
//! (Blosc Development Team, *Blosc Header Format* and `blosc.c`, <https://github.com/Blosc/c-blosc>).
//!
//! A container is a header of 16 bytes, the offsets of its blocks, and the blocks. A block may be split into one part
//! for each byte of its numbers; parts are compressed each by itself. Numbers may be shuffled: first the first bytes of
//! all of them, then the second bytes, and so on.

use super::values::inflate;
use flate2::Decompress;

/// Bytes of the header.
const HEADER: usize = 16;
/// Format versions of the container that are known: those of Blosc 1.
const VERSIONS: std::ops::RangeInclusive<u8> = 1..=2;
/// Flag: the bytes of numbers are shuffled.
const SHUFFLE: u8 = 0x1;
/// Flag: nothing is compressed.
const STORED: u8 = 0x2;
/// Flag: the bits of numbers are shuffled.
const BIT_SHUFFLE: u8 = 0x4;
/// Flag: blocks are not split.
const WHOLE_BLOCKS: u8 = 0x10;
/// The position of the codec's number in the flags.
const CODEC_SHIFT: u32 = 5;
/// The codecs by number; the first column is what is read.
const CODECS: [(Option<Codec>, &str); 5] =
    [(None, "blosclz"), (Some(Codec::Lz4), "lz4"), (None, "snappy"), (Some(Codec::Zlib), "zlib"), (None, "zstd")];
/// The longest numbers, bytes, whose blocks are split.
const MAX_SPLITS: usize = 16;
/// The fewest numbers in a block that is split.
const MIN_SPLIT: usize = 128;

#[derive(Clone, Copy)]
enum Codec {
    Lz4,
    Zlib,
}

/// Unpacks a container that must hold exactly as many bytes as `out`. `shuffled` is for this function alone.
///
/// The message of an error says what is wrong without a place.
pub fn decompress(
    container: &[u8],
    out: &mut [u8],
    shuffled: &mut Vec<u8>,
    zlib: &mut Decompress,
) -> Result<(), String> {
    let number = |start: usize| -> Option<u32> {
        Some(u32::from_le_bytes(container.get(start..start.checked_add(4)?)?.try_into().ok()?))
    };
    let (Some(&[version, _, flags, type_size]), Some(bytes), Some(block_size), Some(length)) =
        (container.first_chunk::<4>(), number(4), number(8), number(12))
    else {
        return Err(format!("a Blosc container of {} bytes; allowed: at least {HEADER}", container.len()));
    };
    if !VERSIONS.contains(&version) {
        return Err(format!("version {version} of the Blosc format; allowed: 1 and 2"));
    }
    if bytes as usize != out.len() {
        return Err(format!("a Blosc container of {bytes} bytes uncompressed; allowed here: {}", out.len()));
    }
    if length as usize != container.len() {
        return Err(format!("a Blosc container of {} bytes says that it has {length}", container.len()));
    }
    if out.is_empty() {
        return Ok(());
    }
    if flags & STORED != 0 {
        let stored = container.get(HEADER..).filter(|stored| stored.len() == out.len());
        out.copy_from_slice(stored.ok_or("an uncompressed Blosc container has another length than its content")?);
        return Ok(());
    }
    if flags & BIT_SHUFFLE != 0 {
        return Err("Blosc's bit shuffle is not supported; allowed: byte shuffle or none".to_owned());
    }
    let codec = match CODECS.get(usize::from(flags >> CODEC_SHIFT)) {
        Some((Some(codec), _)) => *codec,
        Some((None, name)) => return Err(format!("Blosc's codec {name} is not supported; allowed: lz4, zlib")),
        None => return Err(format!("Blosc's codec {} is unknown; allowed: lz4, zlib", flags >> CODEC_SHIFT)),
    };
    let block_size = block_size as usize;
    if block_size == 0 {
        return Err("a Blosc container with blocks of 0 bytes".to_owned());
    }
    let type_size = usize::from(type_size).max(1);
    let shuffle = flags & SHUFFLE != 0 && type_size > 1;
    for (index, block) in out.chunks_mut(block_size).enumerate() {
        // At most as many blocks as bytes in `out`.
        let mut start = number(HEADER + 4 * index).ok_or("a Blosc container ends before its blocks")? as usize;
        let is_last_rest = block.len() < block_size;
        let splits = flags & WHOLE_BLOCKS == 0
            && type_size <= MAX_SPLITS
            && block_size / type_size >= MIN_SPLIT
            && block_size.is_multiple_of(type_size)
            && !is_last_rest;
        let part_size = if splits { block_size / type_size } else { block.len() };
        let plain: &mut [u8] = if shuffle {
            shuffled.resize(block.len(), 0);
            shuffled
        } else {
            &mut *block
        };
        for part in plain.chunks_mut(part_size) {
            let length = number(start).ok_or("a Blosc block begins outside its container")? as usize;
            start += 4;
            let packed = start.checked_add(length).and_then(|end| container.get(start..end));
            let packed = packed.ok_or("a Blosc block ends outside its container")?;
            start += length;
            if length == part.len() {
                part.copy_from_slice(packed);
                continue;
            }
            match codec {
                Codec::Lz4 => {
                    let expected = part.len();
                    match lz4_flex::block::decompress_into(packed, part) {
                        Ok(found) if found == expected => {}
                        Ok(found) => return Err(format!("an lz4 block holds {found} bytes instead of {expected}")),
                        Err(error) => return Err(format!("an lz4 block is damaged: {error}")),
                    }
                }
                Codec::Zlib => inflate(zlib, packed, part)?,
            }
        }
        if shuffle {
            unshuffle(shuffled, block, type_size);
        }
    }
    Ok(())
}

/// Puts the bytes of each number of `size` bytes together again; what is no whole number at the end stays.
fn unshuffle(from: &[u8], to: &mut [u8], size: usize) {
    let count = to.len() / size;
    let whole = count * size;
    if let (4, [a, b, c, d]) = (size, quarters(&from[..whole])) {
        // The case of OpenVDB, fast.
        let numbers = a.iter().zip(b).zip(c.iter().zip(d));
        for (number, ((a, b), (c, d))) in to.chunks_exact_mut(4).zip(numbers) {
            number.copy_from_slice(&[*a, *b, *c, *d]);
        }
    } else {
        for byte in 0..size {
            for (number, &value) in from[byte * count..(byte + 1) * count].iter().enumerate() {
                to[number * size + byte] = value;
            }
        }
    }
    for (to, from) in to.iter_mut().zip(from).skip(whole) {
        *to = *from;
    }
}

/// Four slices of the same length; what is left over is not among them.
fn quarters(bytes: &[u8]) -> [&[u8]; 4] {
    let length = bytes.len() / 4;
    std::array::from_fn(|i| &bytes[i * length..(i + 1) * length])
}
