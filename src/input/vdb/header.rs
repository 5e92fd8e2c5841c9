//! What precedes the grids of a VDB file, and what precedes the tree of a grid.

use super::super::columns::{ReadError, quote};
use super::bytes::Input;
use super::transform::Transform;
use super::values::{ZIP, check_flags};

/// The first eight bytes: "VDB ", as the 64-bit integer that OpenVDB writes.
pub const MAGIC: [u8; 8] = *b" BDV\0\0\0\0";
/// Versions of the format that are read: the first that marks its compression in the header, the latest.
pub const VERSIONS: [u32; 2] = [220, 224];
/// The version from which every grid says how it is compressed, and nodes need not hold their inactive values.
pub const NODE_MASK_COMPRESSION: u32 = 222;

/// Bytes of the UUID, which is text.
const UUID: u64 = 36;
/// Bytes of the smallest grid descriptor: three empty texts and three offsets.
const SMALLEST_DESCRIPTOR: u64 = 3 * 4 + 3 * 8;
/// Bytes of the smallest entry of metadata: two empty texts and a length.
const SMALLEST_METADATA: u64 = 3 * 4;
/// Marks a grid whose floating-point numbers are stored with 16 bits; at the end of its type.
const HALF_SUFFIX: &str = "_HalfFloat";
/// Stands before the number that keeps grids of the same name apart.
const SEPARATOR: char = '\x1e';
/// Longest metadata that is looked at, bytes.
const LONGEST_VALUE: u32 = 1 << 10;

/// The beginning of a file.
#[derive(Clone, Copy, Debug)]
pub struct Header {
    /// Version of the format.
    pub version: u32,
    /// Whether each grid says where it ends.
    pub has_offsets: bool,
    /// How grids are compressed in versions in which they do not say it.
    compression: u32,
    /// Number of grids.
    pub grids: u32,
}

impl Header {
    /// Reads everything before the first grid.
    pub fn read(input: &mut Input) -> Result<Self, ReadError> {
        const WHAT: &str = "the header";
        let mut magic = [0; MAGIC.len()];
        input.fill(&mut magic, WHAT)?;
        if magic != MAGIC {
            let message = format!("byte 0: {}; a VDB file begins with ` BDV` and four zeros", quote(&magic));
            return Err(ReadError::content(message));
        }
        let version = input.u32(WHAT)?;
        let [first, last] = VERSIONS;
        if !(first..=last).contains(&version) {
            return Err(ReadError::content(format!(
                "byte {}: version {version} of the VDB format; allowed: {first} to {last}, which OpenVDB has written \
                 since 2012",
                MAGIC.len()
            )));
        }
        // Major and minor version of the library that wrote the file.
        input.skip(2 * 4, WHAT)?;
        let has_offsets = input.u8(WHAT)? != 0;
        let compression = if version < NODE_MASK_COMPRESSION && input.u8(WHAT)? != 0 { ZIP } else { 0 };
        input.skip(UUID, WHAT)?;
        read_metadata(input, |_, _| ())?;
        let grids = input.u32("the number of grids")?;
        input.need(u64::from(grids) * SMALLEST_DESCRIPTOR, "grids")?;
        Ok(Self { version, has_offsets, compression, grids })
    }
}

/// Reads metadata, names with values; `look` is handed every short value with its name.
fn read_metadata(input: &mut Input, mut look: impl FnMut(&str, &[u8])) -> Result<(), ReadError> {
    const WHAT: &str = "metadata";
    let count = input.u32(WHAT)?;
    input.need(u64::from(count) * SMALLEST_METADATA, WHAT)?;
    for _ in 0..count {
        let name = input.text("the name of metadata")?;
        // The type: the length that follows it is enough to pass over a value of any.
        input.text("the type of metadata")?;
        let length = input.u32(WHAT)?;
        if length <= LONGEST_VALUE {
            look(&name, &input.take(length.into(), WHAT)?);
        } else {
            input.skip(length.into(), WHAT)?;
        }
    }
    Ok(())
}

/// What stands before each grid.
#[derive(Clone, Debug)]
pub struct Descriptor {
    /// Name with what keeps it apart from others.
    unique: String,
    /// Type of the tree, such as `Tree_float_5_4_3`.
    pub kind: String,
    /// Whether the type says that numbers are stored with 16 bits.
    half: bool,
    /// Unique name of the grid whose tree this one shares; empty: it has its own.
    parent: String,
    /// First byte of the grid.
    pub start: u64,
    /// First byte after the grid; 0 in a file without offsets.
    pub end: u64,
}

impl Descriptor {
    /// Reads a descriptor; the stream then stands at the beginning of the grid.
    pub fn read(input: &mut Input, header: &Header) -> Result<Self, ReadError> {
        const WHAT: &str = "the description of a grid";
        let unique = input.text("the name of a grid")?;
        let mut kind = input.text("the type of a grid")?;
        let half = kind.ends_with(HALF_SUFFIX);
        if half {
            kind.truncate(kind.len() - HALF_SUFFIX.len());
        }
        let parent = input.text("the name of the grid that shares a tree")?;
        let place = input.position();
        // The second offset, of the leaves, is of no use to who reads forward.
        let [start, _, end] = [input.i64(WHAT)?, input.i64(WHAT)?, input.i64(WHAT)?];
        let mut descriptor = Self { unique, kind, half, parent, start: input.position(), end: 0 };
        if header.has_offsets {
            let here = input.position();
            let (start, end) = match (u64::try_from(start), u64::try_from(end)) {
                (Ok(start), Ok(end)) if here <= start && start <= end => (start, end),
                _ => {
                    return Err(ReadError::content(format!(
                        "byte {place}: grid `{}` is said to lie from byte {start} to {end}; allowed: an order of \
                         offsets, after its description, which ends at byte {here}",
                        descriptor.display()
                    )));
                }
            };
            input.skip(start - here, WHAT)?;
            input.need(end - start, &format!("grid `{}`", descriptor.display()))?;
            (descriptor.start, descriptor.end) = (start, end);
        }
        Ok(descriptor)
    }

    /// The grid's name.
    pub fn name(&self) -> &str {
        self.unique.split(SEPARATOR).next().unwrap_or_default()
    }

    /// The name with the number that keeps grids of one name apart, as OpenVDB shows it: `density[1]`.
    pub fn display(&self) -> String {
        let text = match self.unique.split_once(SEPARATOR) {
            Some((name, number)) => format!("{name}[{number}]"),
            None => self.unique.clone(),
        };
        text.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).take(80).collect()
    }

    /// Whether a user who asks for `name` means this grid.
    pub fn is_called(&self, name: &str) -> bool {
        self.name() == name || self.display() == name
    }

    /// The type for messages: `float` for `Tree_float_5_4_3`, the whole where the tree is built otherwise.
    pub fn short_kind(&self) -> String {
        let short = self.kind.strip_prefix("Tree_").and_then(|kind| kind.strip_suffix("_5_4_3"));
        short.unwrap_or(&self.kind).chars().filter(|c| !c.is_control()).take(80).collect()
    }

    /// Whether the tree is that of the grid with this descriptor.
    pub fn shares_tree_of(&self, other: &Self) -> bool {
        self.parent == other.unique
    }

    /// The unique name of the grid whose tree this one shares.
    pub fn parent(&self) -> Option<&str> {
        (!self.parent.is_empty()).then_some(&self.parent)
    }
}

/// What precedes the tree of a grid.
pub struct GridHead {
    /// How the tree is compressed.
    pub compression: u32,
    /// Whether numbers are stored with 16 bits.
    pub half: bool,
    /// Whether the values are distances to a surface.
    pub is_level_set: bool,
    /// From index space to the space of the file.
    pub transform: Transform,
}

impl GridHead {
    /// Reads it; the stream then stands at the tree, or at the end of the grid where that shares one.
    pub fn read(input: &mut Input, header: &Header, descriptor: &Descriptor) -> Result<Self, ReadError> {
        let compression = if header.version < NODE_MASK_COMPRESSION {
            header.compression
        } else {
            let flags = input.u32("the compression of a grid")?;
            check_flags(flags).map_err(|message| input.wrong(message))?;
            flags
        };
        let mut half = descriptor.half;
        let mut is_level_set = false;
        read_metadata(input, |name, value| match name {
            "class" => is_level_set = value == b"level set",
            // OpenVDB goes by this one, where it is.
            "is_saved_as_half_float" => half = value.first().is_some_and(|&byte| byte != 0),
            _ => {}
        })?;
        let transform = Transform::read(input)?;
        Ok(Self { compression, half, is_level_set, transform })
    }
}
