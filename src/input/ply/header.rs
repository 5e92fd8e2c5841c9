//! The header of a PLY file, and passing over elements.

use crate::input::columns::{MAX_ROWS, ReadError, quote};
use crate::input::scalar::Scalar;
use crate::input::source::Source;

/// Longest header that is accepted, bytes.
const LONGEST_HEADER: u64 = 1 << 20;
/// Longest line of a text file that is accepted, bytes.
const LONGEST_LINE: u64 = 1 << 24;
/// Most elements that are accepted: the reader compares each with those before it.
const MOST_ELEMENTS: usize = 1000;

/// How the data after the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    Little,
    Big,
}

/// Both spellings of every type of a PLY file.
const TYPES: &[(&str, &str, Scalar)] = &[
    ("char", "int8", Scalar::I8),
    ("uchar", "uint8", Scalar::U8),
    ("short", "int16", Scalar::I16),
    ("ushort", "uint16", Scalar::U16),
    ("int", "int32", Scalar::I32),
    ("uint", "uint32", Scalar::U32),
    ("float", "float32", Scalar::F32),
    ("double", "float64", Scalar::F64),
];

/// The type of that name.
fn scalar(name: &str) -> Option<Scalar> {
    TYPES.iter().find(|(old, new, _)| *old == name || *new == name).map(|entry| entry.2)
}

/// What a property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    /// Types of the count, which is an integer, and of the items.
    List(Scalar, Scalar),
}

/// A line `property` of the header.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

/// A line `element` of the header and the properties below it.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    /// Line of the header.
    line: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Fewest bytes that one element takes, with empty lists.
    fn smallest(&self, format: Format) -> u64 {
        if format == Format::Ascii {
            // A digit for every property, and what stands between them.
            return 2 * self.properties.len() as u64;
        }
        self.properties
            .iter()
            .map(|property| match property.kind {
                Kind::Scalar(scalar) | Kind::List(scalar, _) => scalar.size() as u64,
            })
            .sum()
    }

    /// Bytes of every element of a binary file, if all have the same.
    pub(super) fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|property| match property.kind {
                Kind::Scalar(scalar) => Some(scalar.size()),
                Kind::List(..) => None,
            })
            .sum()
    }

    /// Passes over all of its elements.
    pub(super) fn skip(&self, source: &mut Source, format: Format) -> Result<(), ReadError> {
        match format {
            Format::Ascii => self.skip_text(source),
            Format::Little => self.skip_binary::<false>(source),
            Format::Big => self.skip_binary::<true>(source),
        }
    }

    /// The scalar properties with their types.
    pub(super) fn scalars(&self) -> impl Iterator<Item = (&str, Scalar)> {
        self.properties.iter().filter_map(|property| match property.kind {
            Kind::Scalar(scalar) => Some((property.name.as_str(), scalar)),
            Kind::List(..) => None,
        })
    }

    /// Whether all of these are scalar properties.
    pub(super) fn has_scalars(&self, names: &[&str]) -> bool {
        names.iter().all(|wanted| self.scalars().any(|(name, _)| name == *wanted))
    }

    fn skip_text(&self, source: &mut Source) -> Result<(), ReadError> {
        if !self.properties.is_empty() {
            for index in 0..self.count {
                source.data_line(self, index)?;
            }
        }
        Ok(())
    }

    fn skip_binary<const BIG: bool>(&self, source: &mut Source) -> Result<(), ReadError> {
        if let Some(stride) = self.stride() {
            // A product too large for 64 bits is no file: the skipping ends with it.
            return source.skip(self.count.saturating_mul(stride as u64), || format!("the elements `{}`", self.name));
        }
        (0..self.count).try_for_each(|index| self.row::<BIG>(source, index, |_, _, _| Ok(())))
    }

    /// Reads one element that has lists and hands over its scalars: property, value, byte offset.
    pub(super) fn row<const BIG: bool>(
        &self,
        source: &mut Source,
        index: u64,
        mut scalar: impl FnMut(&Property, f64, u64) -> Result<(), ReadError>,
    ) -> Result<(), ReadError> {
        let place = || format!("element {index} of {} `{}`", self.count, self.name);
        let mut value = Vec::with_capacity(1);
        let mut one = |source: &mut Source, kind: Scalar| -> Result<f64, ReadError> {
            let mut bytes = [0; 8];
            let bytes = &mut bytes[..kind.size()];
            source.fill(bytes, place)?;
            value.clear();
            kind.decode::<BIG>(bytes, kind.size(), 0, &mut value);
            Ok(value.first().copied().unwrap_or_default())
        };
        for property in &self.properties {
            let start = source.byte;
            match property.kind {
                Kind::Scalar(kind) => {
                    let value = one(source, kind)?;
                    scalar(property, value, start)?;
                }
                Kind::List(count, item) => {
                    let count = one(source, count)?;
                    if count < 0.0 {
                        let name = &property.name;
                        let message = format!("byte {start}: list `{name}` of {} has length {count}", place());
                        return Err(ReadError::content(message));
                    }
                    // At most 2^32 - 1 items of 8 bytes.
                    source.skip(count as u64 * item.size() as u64, place)?;
                }
            }
        }
        Ok(())
    }
}

/// What the lines before the data say.
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// Names in the comments `TextureFile`, with which mesh programs name pictures.
    pub(super) textures: Vec<String>,
}

impl Header {
    pub(super) fn read(source: &mut Source) -> Result<Self, ReadError> {
        const FORMATS: [(&str, Format); 3] =
            [("ascii", Format::Ascii), ("binary_little_endian", Format::Little), ("binary_big_endian", Format::Big)];
        source.header_line()?;
        if source.text != b"ply" {
            let found = quote(&source.text);
            return Err(ReadError::content(format!("line 1: {found}; a PLY file begins with a line `ply`")));
        }
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut textures = Vec::new();
        loop {
            source.header_line()?;
            let line = source.line;
            let text = String::from_utf8_lossy(&source.text).into_owned();
            let wrong = |allowed: &str| {
                ReadError::content(format!("line {line}: {}; allowed: {allowed}", quote(text.as_bytes())))
            };
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words[..] {
                ["comment", "TextureFile", ..] => {
                    // The rest of the line, since names have spaces in them.
                    textures.extend(text.split_once("TextureFile").map(|(_, name)| name.trim().to_owned()));
                }
                [] | ["comment" | "obj_info", ..] => {}
                ["end_header"] => break,
                ["format", name, "1.0"] if format.is_none() => {
                    let known = FORMATS.iter().find(|entry| entry.0 == name).map(|entry| entry.1);
                    format = Some(known.ok_or_else(|| wrong(Self::FORMAT_LINES))?);
                }
                ["format", ..] => return Err(wrong(Self::FORMAT_LINES)),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| wrong("element NAME COUNT, with an integer count from 0"))?;
                    if name == "vertex" && count > MAX_ROWS {
                        return Err(wrong(&format!("at most {MAX_ROWS} vertices")));
                    }
                    if elements.iter().any(|element| element.name == name) {
                        return Err(wrong("each element once"));
                    }
                    if elements.len() == MOST_ELEMENTS {
                        return Err(wrong(&format!("at most {MOST_ELEMENTS} elements")));
                    }
                    elements.push(Element { name: name.to_owned(), count, line, properties: Vec::new() });
                }
                ["element", ..] => return Err(wrong("element NAME COUNT")),
                ["property", ref rest @ ..] => {
                    let known = |name: &str| scalar(name).ok_or_else(|| wrong(&Self::property_lines()));
                    let (name, kind) = match *rest {
                        ["list", count, item, name] => {
                            let count = known(count)?;
                            if count.range().is_none() {
                                return Err(wrong("an integer type for the length of a list"));
                            }
                            (name, Kind::List(count, known(item)?))
                        }
                        [kind, name] => (name, Kind::Scalar(known(kind)?)),
                        _ => return Err(wrong(&Self::property_lines())),
                    };
                    let element = elements.last_mut().ok_or_else(|| wrong("a property after its element"))?;
                    element.properties.push(Property { name: name.to_owned(), kind });
                }
                _ => return Err(wrong("format, comment, obj_info, element, property, end_header")),
            }
        }
        for element in &elements {
            let mut names: Vec<&str> = element.properties.iter().map(|property| property.name.as_str()).collect();
            names.sort_unstable();
            if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
                let message =
                    format!("line {}: element `{}` has two properties `{}`", element.line, element.name, pair[0]);
                return Err(ReadError::content(message));
            }
        }
        let format = format.ok_or_else(|| {
            ReadError::content(format!(
                "line {}: no format before the end of the header; allowed: {}",
                source.line,
                Self::FORMAT_LINES
            ))
        })?;
        Ok(Self { format, elements, textures })
    }

    const FORMAT_LINES: &str =
        "one line `format ascii 1.0`, `format binary_little_endian 1.0` or `format binary_big_endian 1.0`";

    fn property_lines() -> String {
        let types: Vec<String> = TYPES.iter().map(|(old, new, _)| format!("{old} ({new})")).collect();
        format!("property TYPE NAME or property list TYPE TYPE NAME, with a TYPE of {}", types.join(", "))
    }

    /// The elements before the element `vertex`, and itself.
    pub(super) fn vertex(&self) -> Result<(&[Element], &Element), ReadError> {
        let found = self.elements.iter().position(|element| element.name == "vertex");
        found.and_then(|index| Some((self.elements.get(..index)?, self.elements.get(index)?))).ok_or_else(|| {
            let names: Vec<String> = self.elements.iter().map(|element| format!("`{}`", element.name)).collect();
            let found = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            ReadError::content(format!("no element `vertex`; the file's elements: {found}"))
        })
    }

    /// Refuses counts for which the file is too small. `start` is where the data begin.
    pub(super) fn check_size(&self, start: u64, size: Option<u64>) -> Result<(), ReadError> {
        let Some(size) = size else { return Ok(()) };
        let available = u128::from(size.saturating_sub(start));
        let mut needed = 0;
        for element in &self.elements {
            needed += u128::from(element.count) * u128::from(element.smallest(self.format));
            // The last line of a text needs no end.
            let end = u128::from(self.format == Format::Ascii && needed > 0);
            if needed - end > available {
                let Element { name, count, line, .. } = element;
                return Err(ReadError::content(format!(
                    "line {line}: {count} elements `{name}` need at least {} bytes after the header, which ends at \
                     byte {start}, but the file has {available}: it is truncated, or the count is wrong",
                    needed - end
                )));
            }
        }
        Ok(())
    }
}

impl Source<'_> {
    fn header_line(&mut self) -> Result<(), ReadError> {
        if !self.read_line(LONGEST_HEADER.saturating_sub(self.byte))? {
            return Err(ReadError::content(format!("line {}: the file ends before end_header", self.line + 1)));
        }
        Ok(())
    }

    /// Reads the line of element `index`, past blank lines, and returns its number.
    pub(super) fn data_line(&mut self, element: &Element, index: u64) -> Result<u64, ReadError> {
        loop {
            if !self.read_line(LONGEST_LINE)? {
                let Element { name, count, .. } = element;
                let line = self.line + 1;
                let message = format!("line {line}: the file ends before element {index} of {count} `{name}`");
                return Err(ReadError::content(message));
            }
            if !self.text.trim_ascii().is_empty() {
                return Ok(self.line);
            }
        }
    }
}
