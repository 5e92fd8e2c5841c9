//! Particles from PLY files: the scalar properties of the element `vertex`, in ascii, binary_little_endian and
//! binary_big_endian (G. Turk, *The PLY Polygon File Format*, 1994).
//!
//! Comments, `obj_info`, list properties and other elements are skipped. Text is read strictly, one element on one
//! line. Colours of type uchar are sRGB-encoded, of other types linear light.
//!
//! Why an own reader: a file of 10^7 particles has to be read column by column into bounded memory, with the columns
//! chosen at run time. `serde-ply` has a fast path only for fields named at compile time and otherwise hands over every
//! value with its property's name; `ply-rs-bw` hands over every value by name too, into one object per element.
//! Neither compares the counts that a header claims with the size of the file, and neither says at which byte the
//! binary data are wrong. Here a block of elements is read at once and each wanted property is decoded by its stride.

use super::columns::{Column, Columns, MAX_ROWS, ReadError, Selection, number_or_nan, quote, reserve};
use super::scalar::Scalar;
use super::source::Source;
use std::io::BufRead;

/// Names that mean colour in a PLY file.
pub const COLORS: &[[&str; 3]] = &[["red", "green", "blue"], ["r", "g", "b"]];

/// Longest header that is accepted, bytes.
const LONGEST_HEADER: u64 = 1 << 20;
/// Longest line of a text file that is accepted, bytes.
const LONGEST_LINE: u64 = 1 << 24;
/// Bytes read at once: small enough for the cache, large enough for the calls not to count.
const BLOCK: usize = 1 << 18;
/// Values of all columns to reserve at once where the size of the file is unknown and a count cannot be checked.
const CAUTIOUS: u64 = 1 << 20;
/// Most elements that are accepted: the reader compares each with those before it.
const MOST_ELEMENTS: usize = 1000;

/// Whether a file that begins like this is a PLY file.
pub fn detect(head: &[u8]) -> bool {
    head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
}

/// Reads the wanted scalar properties of the element `vertex`.
///
/// `size` is the number of bytes of the whole file, if known: counts that cannot fit are then refused before anything
/// is allocated. Errors name the line of header and text, the byte offset of binary data.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut source = Source::new(reader);
    let header = Header::read(&mut source)?;
    header.check_size(source.byte, size)?;
    let vertex = header.vertex()?;
    let mut columns = Vec::new();
    for property in &header.elements[vertex].properties {
        if let Kind::Scalar(scalar) = property.kind
            && selection.wants(&property.name)
        {
            let byte = scalar == Scalar::U8;
            columns.push(Column { name: property.name.clone(), values: Vec::new(), byte });
        }
    }
    for element in &header.elements[..vertex] {
        match header.format {
            Format::Ascii => element.skip_text(&mut source)?,
            Format::Little => element.skip_binary::<false>(&mut source)?,
            Format::Big => element.skip_binary::<true>(&mut source)?,
        }
    }
    let vertex = &header.elements[vertex];
    let lenient = selection.is_lenient();
    match header.format {
        Format::Ascii => vertex.read_text(&mut source, &mut columns, size.is_some(), lenient)?,
        Format::Little => vertex.read_binary::<false>(&mut source, &mut columns, size.is_some(), lenient)?,
        Format::Big => vertex.read_binary::<true>(&mut source, &mut columns, size.is_some(), lenient)?,
    }
    let scalars = vertex.properties.iter().filter(|property| matches!(property.kind, Kind::Scalar(_)));
    let names = scalars.map(|property| property.name.clone()).collect();
    Columns::new(columns, names, vertex.count as usize, COLORS)
}

/// How the data after the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
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
enum Kind {
    Scalar(Scalar),
    /// Types of the count, which is an integer, and of the items.
    List(Scalar, Scalar),
}

/// A line `property` of the header.
#[derive(Debug)]
struct Property {
    name: String,
    kind: Kind,
}

/// A line `element` of the header and the properties below it.
#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    /// Line of the header.
    line: u64,
    properties: Vec<Property>,
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
    fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|property| match property.kind {
                Kind::Scalar(scalar) => Some(scalar.size()),
                Kind::List(..) => None,
            })
            .sum()
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
    fn row<const BIG: bool>(
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

    /// Reserves memory for all elements if their count was `checked` against the size of the file, else for some.
    fn make_room(&self, columns: &mut [Column], checked: bool) -> Result<(), ReadError> {
        let cautious = CAUTIOUS / columns.len().max(1) as u64;
        let room = if checked { self.count } else { self.count.min(cautious) } as usize;
        columns.iter_mut().try_for_each(|column| reserve(&mut column.values, room))
    }

    fn read_binary<const BIG: bool>(
        &self,
        source: &mut Source,
        columns: &mut [Column],
        checked: bool,
        lenient: bool,
    ) -> Result<(), ReadError> {
        self.make_room(columns, checked)?;
        let Some(stride) = self.stride() else {
            return (0..self.count).try_for_each(|index| {
                let mut next = 0;
                self.row::<BIG>(source, index, |property, value, byte| {
                    // The columns stand in the order of their properties.
                    if let Some(column) = columns.get_mut(next)
                        && column.name == property.name
                    {
                        next += 1;
                        column.values.push(finite(&column.name, value, index, byte, lenient)?);
                    }
                    Ok(())
                })
            });
        };
        if stride == 0 {
            return Ok(());
        }
        let mut wanted: Vec<(Scalar, usize)> = Vec::with_capacity(columns.len());
        let mut offset = 0;
        for property in &self.properties {
            if let Kind::Scalar(scalar) = property.kind {
                if columns.get(wanted.len()).is_some_and(|column| column.name == property.name) {
                    wanted.push((scalar, offset));
                }
                offset += scalar.size();
            }
        }
        let rows_per_block = (BLOCK / stride).max(1);
        let mut block = vec![0; stride * rows_per_block.min(self.count as usize)];
        let mut done: u64 = 0;
        while done < self.count {
            let rows = (self.count - done).min(rows_per_block as u64);
            let block = &mut block[..stride * rows as usize];
            let start = source.byte;
            source.fill(block, || format!("element {done} of {} `{}` or one soon after", self.count, self.name))?;
            for (&(scalar, offset), column) in wanted.iter().zip(&mut *columns) {
                let before = column.values.len();
                scalar.decode::<BIG>(block, stride, offset, &mut column.values);
                for (row, value) in column.values[before..].iter_mut().enumerate().filter(|(_, v)| !v.is_finite()) {
                    let byte = start + (row * stride + offset) as u64;
                    *value = finite(&column.name, *value, done + row as u64, byte, lenient)?;
                }
            }
            done += rows;
        }
        Ok(())
    }

    fn read_text(
        &self,
        source: &mut Source,
        columns: &mut [Column],
        checked: bool,
        lenient: bool,
    ) -> Result<(), ReadError> {
        self.make_room(columns, checked)?;
        if self.properties.is_empty() {
            return Ok(());
        }
        for index in 0..self.count {
            let line = source.data_line(self, index)?;
            let mut fields = source.fields();
            let mut field = |property: &Property| {
                fields.next().ok_or_else(|| {
                    ReadError::content(format!("line {line}, property `{}`: the line ends before it", property.name))
                })
            };
            let wrong = |property: &Property, problem: String| {
                ReadError::content(format!("line {line}, property `{}`: {problem}", property.name))
            };
            let mut next = 0;
            for property in &self.properties {
                let text = field(property)?;
                match property.kind {
                    Kind::Scalar(scalar) => {
                        if let Some(column) = columns.get_mut(next)
                            && column.name == property.name
                        {
                            next += 1;
                            column.values.push(if lenient {
                                number_or_nan(text)
                            } else {
                                scalar.parse(text).map_err(|problem| wrong(property, problem))?
                            });
                        }
                    }
                    Kind::List(count, _) => {
                        let count = count.parse(text).map_err(|problem| wrong(property, problem))?;
                        for _ in 0..count.max(0.0) as u64 {
                            field(property)?;
                        }
                    }
                }
            }
            if let Some(extra) = fields.next() {
                let extra = quote(extra);
                let message = format!("line {line}: {extra} follows the last of the properties that the header names");
                return Err(ReadError::content(message));
            }
        }
        Ok(())
    }
}

/// The value if it is finite, else NaN or an error.
fn finite(name: &str, value: f64, index: u64, byte: u64, lenient: bool) -> Result<f64, ReadError> {
    if value.is_finite() {
        return Ok(value);
    }
    if lenient {
        return Ok(f64::NAN);
    }
    let message = format!("byte {byte}: property `{name}` of vertex {index} is {value}; allowed: a finite number");
    Err(ReadError::content(message))
}

/// What the lines before the data say.
struct Header {
    format: Format,
    elements: Vec<Element>,
}

impl Header {
    fn read(source: &mut Source) -> Result<Self, ReadError> {
        const FORMATS: [(&str, Format); 3] =
            [("ascii", Format::Ascii), ("binary_little_endian", Format::Little), ("binary_big_endian", Format::Big)];
        source.header_line()?;
        if source.text != b"ply" {
            let found = quote(&source.text);
            return Err(ReadError::content(format!("line 1: {found}; a PLY file begins with a line `ply`")));
        }
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        loop {
            source.header_line()?;
            let line = source.line;
            let text = String::from_utf8_lossy(&source.text).into_owned();
            let wrong = |allowed: &str| {
                ReadError::content(format!("line {line}: {}; allowed: {allowed}", quote(text.as_bytes())))
            };
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words[..] {
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
        Ok(Self { format, elements })
    }

    const FORMAT_LINES: &str =
        "one line `format ascii 1.0`, `format binary_little_endian 1.0` or `format binary_big_endian 1.0`";

    fn property_lines() -> String {
        let types: Vec<String> = TYPES.iter().map(|(old, new, _)| format!("{old} ({new})")).collect();
        format!("property TYPE NAME or property list TYPE TYPE NAME, with a TYPE of {}", types.join(", "))
    }

    /// The index of the element `vertex`.
    fn vertex(&self) -> Result<usize, ReadError> {
        self.elements.iter().position(|element| element.name == "vertex").ok_or_else(|| {
            let names: Vec<String> = self.elements.iter().map(|element| format!("`{}`", element.name)).collect();
            let found = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            ReadError::content(format!("no element `vertex`; the file's elements: {found}"))
        })
    }

    /// Refuses counts for which the file is too small. `start` is where the data begin.
    fn check_size(&self, start: u64, size: Option<u64>) -> Result<(), ReadError> {
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
    fn data_line(&mut self, element: &Element, index: u64) -> Result<u64, ReadError> {
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
