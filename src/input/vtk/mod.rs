//! Particles from legacy VTK files (`# vtk DataFile Version x.y`), ASCII and BINARY, of the datasets POLYDATA and
//! UNSTRUCTURED_GRID: the points as columns x, y, z, and every array of numbers in POINT_DATA (*VTK File Formats*, in
//! the VTK User's Guide; what it leaves open is decided as vtkDataReader of VTK 9 does).
//!
//! An array of one component becomes a column of its name; with 2 or 3 components columns NAME_x, NAME_y, NAME_z, with
//! more NAME_0, NAME_1 and so on. An array of 3 or 4 components called rgb, rgba, color, colors, colour or colours, in
//! any case, and COLOR_SCALARS of 3 or 4, become columns r, g, b (and a). A name that is taken gets _2, _3 and so on
//! behind it, the same for all columns of an array. Component names of the file are ignored.
//!
//! Colours of type unsigned char are sRGB-encoded, of other types linear light. COLOR_SCALARS are unsigned char: text
//! spells them as numbers from 0 to 1, which are multiplied by 255 and rounded, so that ASCII and BINARY give the same
//! columns. Numbers of type float in text are rounded to that type for the same reason.
//!
//! Cells, their data, lookup tables, metadata, fields of the dataset and arrays of text are passed over. Binary data are
//! big-endian, `vtkIdType` takes 4 bytes as VTK writes it, and `long` 8, as on Linux and macOS.
//!
//! Why an own reader: the crate `vtkio` reads a whole file into memory as it is, cells included. Here the stream is read
//! once, the wanted arrays are decoded by their stride, and counts are compared with the size of the file.

pub(super) mod table;
pub(super) mod values;
pub(super) mod words;

use super::columns::{Columns, MAX_ROWS, ReadError, Selection, quote};
use super::scalar::Scalar;
use super::source::Source;
use std::io::BufRead;
use table::{Group, Table};
use values::{Kind, Sink};
use words::{for_each_word, next_word};

pub use table::COLORS;

/// What every file begins with.
const SIGNATURE: &[u8] = b"# vtk DataFile Version";
/// Longest line of header and metadata that is accepted, bytes: VTK itself reads at most 255.
const LONGEST_LINE: u64 = 1 << 16;
/// Longest string of an array of text, bytes.
const LONGEST_STRING: u64 = 1 << 24;
/// Bytes read at once.
const BLOCK: usize = 1 << 18;
/// Major version since which cells are two arrays, offsets and connectivity.
const OFFSETS_VERSION: u32 = 5;
/// Components of a row of a lookup table: red, green, blue, alpha.
const TABLE_COMPONENTS: u64 = 4;

/// The types of numbers: name in lower case, kind in text, kind in binary data.
const TYPES: &[(&str, Kind, Kind)] = &[
    ("bit", Kind::Bit, Kind::Bit),
    ("char", Kind::Number(Scalar::I8), Kind::Number(Scalar::I8)),
    ("signed_char", Kind::Number(Scalar::I8), Kind::Number(Scalar::I8)),
    ("unsigned_char", Kind::Number(Scalar::U8), Kind::Number(Scalar::U8)),
    ("short", Kind::Number(Scalar::I16), Kind::Number(Scalar::I16)),
    ("unsigned_short", Kind::Number(Scalar::U16), Kind::Number(Scalar::U16)),
    ("int", Kind::Number(Scalar::I32), Kind::Number(Scalar::I32)),
    ("unsigned_int", Kind::Number(Scalar::U32), Kind::Number(Scalar::U32)),
    ("long", Kind::Number(Scalar::I64), Kind::Number(Scalar::I64)),
    ("unsigned_long", Kind::Number(Scalar::U64), Kind::Number(Scalar::U64)),
    ("long_long", Kind::Number(Scalar::I64), Kind::Number(Scalar::I64)),
    ("unsigned_long_long", Kind::Number(Scalar::U64), Kind::Number(Scalar::U64)),
    // VTK writes these as int, whatever the size in memory.
    ("vtkidtype", Kind::Number(Scalar::I64), Kind::Number(Scalar::I32)),
    ("vtktypeint8", Kind::Number(Scalar::I8), Kind::Number(Scalar::I8)),
    ("vtktypeuint8", Kind::Number(Scalar::U8), Kind::Number(Scalar::U8)),
    ("vtktypeint16", Kind::Number(Scalar::I16), Kind::Number(Scalar::I16)),
    ("vtktypeuint16", Kind::Number(Scalar::U16), Kind::Number(Scalar::U16)),
    ("vtktypeint32", Kind::Number(Scalar::I32), Kind::Number(Scalar::I32)),
    ("vtktypeuint32", Kind::Number(Scalar::U32), Kind::Number(Scalar::U32)),
    ("vtktypeint64", Kind::Number(Scalar::I64), Kind::Number(Scalar::I64)),
    ("vtktypeuint64", Kind::Number(Scalar::U64), Kind::Number(Scalar::U64)),
    ("float", Kind::Number(Scalar::F32), Kind::Number(Scalar::F32)),
    ("double", Kind::Number(Scalar::F64), Kind::Number(Scalar::F64)),
];

/// Whether a file that begins like this is a legacy VTK file.
pub fn detect(head: &[u8]) -> bool {
    head.starts_with(SIGNATURE)
}

/// Reads the wanted columns: the points and their data.
///
/// `size` is the number of bytes of the whole file, if known: counts that cannot fit are then refused before anything
/// is allocated. Errors name the line of what is text, the byte of what is not.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut source = Source::new(reader);
    let (major, binary) = read_header(&mut source)?;
    let mut file = File {
        source,
        size,
        major,
        binary,
        table: Table::new(selection, size),
        points: None,
        section: Section::Dataset,
        pending: None,
        long: false,
        has_cell_data: false,
    };
    file.read_dataset_line()?;
    file.read_blocks()?;
    let Some(points) = file.points else {
        return Err(ReadError::content("the file ends without POINTS; expected `POINTS COUNT TYPE` and coordinates"));
    };
    let has_cell_data = file.has_cell_data;
    let mut columns = file.table.finish(points as usize)?;
    columns.notes.extend(has_cell_data.then(|| CELL_DATA_NOTE.to_owned()));
    Ok(columns)
}

/// What is said of data that belong to cells.
pub const CELL_DATA_NOTE: &str =
    "data of cells are not read, only those of points; ParaView's filter Cell Data to Point Data makes them such";

/// The first three lines: the major version of the format, 0 if it is not told, and whether data are binary.
fn read_header(source: &mut Source) -> Result<(u32, bool), ReadError> {
    let fail = |message: String| Err(ReadError::content(message));
    source.read_line(LONGEST_LINE)?;
    let Some(version) = source.text.strip_prefix(SIGNATURE) else {
        let found = quote(&source.text);
        return fail(format!("line 1: {found}; a legacy VTK file begins with a line `# vtk DataFile Version x.y`"));
    };
    let version = String::from_utf8_lossy(version);
    let major = version.trim().split('.').next().and_then(|major| major.parse().ok()).unwrap_or(0);
    // Any title.
    source.read_line(LONGEST_LINE)?;
    let word = next_word(source)?.unwrap_or_default();
    match word.to_ascii_uppercase().as_slice() {
        b"ASCII" => Ok((major, false)),
        b"BINARY" => Ok((major, true)),
        _ => fail(format!("line {}: {} where a line `ASCII` or `BINARY` is expected", source.line + 1, quote(&word))),
    }
}

/// Which part of the file the next block belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    /// Points and cells.
    Dataset,
    /// Data of so many points.
    Points(u64),
    /// Data of so many cells.
    Cells(u64),
}

struct File<'a> {
    source: Source<'a>,
    size: Option<u64>,
    major: u32,
    binary: bool,
    table: Table<'a>,
    /// Number of points, once they were read.
    points: Option<u64>,
    section: Section,
    /// A word that was read to see whether it is METADATA.
    pending: Option<Vec<u8>>,
    /// Whether binary data of a type of uncertain size was met.
    long: bool,
    has_cell_data: bool,
}

impl File<'_> {
    /// An error at the current line, or at the byte in a binary file, whose lines nobody can count.
    fn wrong(&self, message: impl std::fmt::Display) -> ReadError {
        if self.binary {
            ReadError::content(format!("byte {}: {message}", self.source.byte))
        } else {
            ReadError::content(format!("line {}: {message}", self.source.line + 1))
        }
    }

    fn next_word(&mut self) -> Result<Option<Vec<u8>>, ReadError> {
        match self.pending.take() {
            Some(word) => Ok(Some(word)),
            None => next_word(&mut self.source),
        }
    }

    /// The next word; `what` it is, should the file end.
    fn word(&mut self, what: &str) -> Result<Vec<u8>, ReadError> {
        match self.next_word()? {
            Some(word) => Ok(word),
            None => Err(self.wrong(format_args!("the file ends before {what}"))),
        }
    }

    fn count(&mut self, what: &str) -> Result<u64, ReadError> {
        let word = self.word(what)?;
        let count = std::str::from_utf8(&word).ok().and_then(|word| word.parse().ok());
        count.ok_or_else(|| self.wrong(format_args!("{} is not {what}; allowed: an integer from 0", quote(&word))))
    }

    /// The name of an array, which VTK writes with %XX for what is not one word.
    fn name(&mut self) -> Result<String, ReadError> {
        let word = self.word("the name of an array")?;
        let mut bytes = Vec::with_capacity(word.len());
        let mut rest = word.as_slice();
        while let Some((&byte, tail)) = rest.split_first() {
            let code = tail.get(..2).and_then(|code| std::str::from_utf8(code).ok());
            match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
                Some(code) if byte == b'%' => {
                    bytes.push(code);
                    rest = tail.get(2..).unwrap_or_default();
                }
                _ => {
                    bytes.push(byte);
                    rest = tail;
                }
            }
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Passes over the rest of a line, behind which binary data or strings begin.
    fn end_line(&mut self) -> Result<(), ReadError> {
        self.source.read_line(LONGEST_LINE)?;
        if self.source.text.trim_ascii().is_empty() {
            return Ok(());
        }
        let found = quote(&self.source.text);
        Err(self.wrong(format_args!("{found} where the line ends, before data")))
    }

    fn read_dataset_line(&mut self) -> Result<(), ReadError> {
        const EXPECTED: &str = "a line `DATASET POLYDATA` or `DATASET UNSTRUCTURED_GRID`";
        let word = self.word(EXPECTED)?;
        if !word.eq_ignore_ascii_case(b"DATASET") {
            return Err(self.wrong(format_args!("{} where {EXPECTED} is expected", quote(&word))));
        }
        let kind = self.word(EXPECTED)?;
        match kind.to_ascii_uppercase().as_slice() {
            b"POLYDATA" | b"UNSTRUCTURED_GRID" => Ok(()),
            _ => Err(self.wrong(format_args!(
                "dataset {}; allowed: POLYDATA, UNSTRUCTURED_GRID (other grids can be converted, in ParaView with the \
                 filter Append Datasets or Extract Surface, or in VTK with vtkAppendFilter)",
                quote(&kind)
            ))),
        }
    }

    fn read_blocks(&mut self) -> Result<(), ReadError> {
        while let Some(word) = self.next_word()? {
            let keyword = word.to_ascii_uppercase();
            match (keyword.as_slice(), self.section) {
                (b"POINTS", Section::Dataset) => self.read_points()?,
                (b"VERTICES" | b"LINES" | b"POLYGONS" | b"TRIANGLE_STRIPS" | b"CELLS", Section::Dataset) => {
                    self.skip_cells()?;
                }
                (b"CELL_TYPES", Section::Dataset) => {
                    let count = self.count("the number of cells")?;
                    self.data(None, Kind::Number(Scalar::I32), count, 1, "CELL_TYPES")?;
                }
                (b"POINT_DATA", _) => {
                    let count = self.count("the number of points")?;
                    match self.points {
                        Some(points) if points == count => self.section = Section::Points(count),
                        Some(points) => {
                            return Err(self.wrong(format_args!("POINT_DATA of {count} points; POINTS has {points}")));
                        }
                        None => return Err(self.wrong("POINT_DATA before POINTS; allowed: behind it")),
                    }
                }
                (b"CELL_DATA", _) => {
                    self.section = Section::Cells(self.count("the number of cells")?);
                    self.has_cell_data = true;
                }
                (b"FIELD", _) => self.read_field()?,
                (b"METADATA", _) => self.skip_metadata(0)?,
                (_, Section::Points(count) | Section::Cells(count)) => self.read_attribute(&word, &keyword, count)?,
                (_, Section::Dataset) => return Err(self.unknown(&word)),
            }
        }
        Ok(())
    }

    /// The error for a word that begins no block.
    fn unknown(&self, word: &[u8]) -> ReadError {
        let allowed = match self.section {
            Section::Dataset => {
                "POINTS, VERTICES, LINES, POLYGONS, TRIANGLE_STRIPS, CELLS, CELL_TYPES, FIELD, METADATA, POINT_DATA, \
                 CELL_DATA"
            }
            _ => {
                "SCALARS, COLOR_SCALARS, LOOKUP_TABLE, VECTORS, NORMALS, TENSORS, TENSORS6, TEXTURE_COORDINATES, \
                 GLOBAL_IDS, PEDIGREE_IDS, EDGE_FLAGS, FIELD, METADATA, POINT_DATA, CELL_DATA"
            }
        };
        let long = if self.long { " (arrays of type long are read with 8 bytes for each value)" } else { "" };
        self.wrong(format_args!("{}; allowed here: {allowed}{long}", quote(word)))
    }

    fn read_points(&mut self) -> Result<(), ReadError> {
        if self.points.is_some() {
            return Err(self.wrong("POINTS stands twice"));
        }
        let count = self.count("the number of points")?;
        if count > MAX_ROWS {
            return Err(self.wrong(format_args!("{count} points; allowed: at most {MAX_ROWS}")));
        }
        let kind = self.word("the type of the points")?;
        let group = self.table.points.clone();
        let Some(kind) = self.kind(&kind)? else {
            return Err(self.wrong(format_args!("POINTS of type {}; allowed: a type of numbers", quote(&kind))));
        };
        self.data(Some(&group), kind, count, group.components as u64, "POINTS")?;
        self.points = Some(count);
        self.after_array(group.components as u64)
    }

    /// Passes over cells, in either form.
    fn skip_cells(&mut self) -> Result<(), ReadError> {
        let first = self.count("a number of cells")?;
        let second = self.count("a size of cells")?;
        if self.major < OFFSETS_VERSION {
            // Number of cells, and of the integers that follow.
            return self.data(None, Kind::Number(Scalar::I32), second, 1, "cells");
        }
        if first == 0 {
            return Ok(());
        }
        for (keyword, count) in [("OFFSETS", first), ("CONNECTIVITY", second)] {
            let word = self.word(keyword)?;
            if !word.eq_ignore_ascii_case(keyword.as_bytes()) {
                return Err(self.wrong(format_args!(
                    "{} where {keyword} is expected, as in every file of version {OFFSETS_VERSION} or later",
                    quote(&word)
                )));
            }
            let kind = self.word("the type of the cells")?;
            self.array(None, &kind, count, 1, keyword)?;
        }
        Ok(())
    }

    /// Reads one attribute of points or cells.
    fn read_attribute(&mut self, word: &[u8], keyword: &[u8], count: u64) -> Result<(), ReadError> {
        const COMPONENTS: &str = "a number of components";
        if keyword == b"LOOKUP_TABLE" {
            let _name = self.word("the name of a lookup table")?;
            let size = self.count("the size of a lookup table")?;
            let kind = if self.binary { Kind::Number(Scalar::U8) } else { Kind::Number(Scalar::F32) };
            return self.data(None, kind, size, TABLE_COMPONENTS, "LOOKUP_TABLE");
        }
        let components = match keyword {
            b"SCALARS" | b"COLOR_SCALARS" | b"TEXTURE_COORDINATES" => None,
            b"VECTORS" | b"NORMALS" => Some(3),
            b"TENSORS" => Some(9),
            b"TENSORS6" => Some(6),
            b"GLOBAL_IDS" | b"PEDIGREE_IDS" | b"EDGE_FLAGS" => Some(1),
            _ => return Err(self.unknown(word)),
        };
        let name = self.name()?;
        if keyword == b"COLOR_SCALARS" {
            let components = self.count(COMPONENTS)?;
            let kind = if self.binary { Kind::Number(Scalar::U8) } else { Kind::Share };
            return self.named(&name, kind, count, components, true);
        }
        let components = match components {
            Some(components) => components,
            None if keyword == b"TEXTURE_COORDINATES" => self.count(COMPONENTS)?,
            None => 1,
        };
        let kind = self.word("the type of an array")?;
        if keyword != b"SCALARS" {
            return self.attribute(&name, &kind, count, components);
        }
        const LOOKUP: &str = "LOOKUP_TABLE";
        let mut components = components;
        let mut word = self.word(LOOKUP)?;
        if !word.eq_ignore_ascii_case(LOOKUP.as_bytes()) {
            self.pending = Some(word);
            components = self.count("the number of components, or LOOKUP_TABLE")?;
            word = self.word(LOOKUP)?;
        }
        if !word.eq_ignore_ascii_case(LOOKUP.as_bytes()) {
            return Err(self.wrong(format_args!(
                "{} behind SCALARS {name}; expected a line such as `LOOKUP_TABLE default`",
                quote(&word)
            )));
        }
        let _table = self.word("the name of a lookup table")?;
        self.attribute(&name, &kind, count, components)
    }

    /// Reads FIELD: arrays that each tell their own shape.
    fn read_field(&mut self) -> Result<(), ReadError> {
        let _name = self.word("the name of a field")?;
        let arrays = self.count("the number of arrays")?;
        for _ in 0..arrays {
            let name = self.name()?;
            // So VTK marks an array that was none.
            if name == "NULL_ARRAY" {
                continue;
            }
            let components = self.count("the number of components")?;
            let tuples = self.count("the number of tuples")?;
            let kind = self.word("the type of an array")?;
            match self.section {
                Section::Points(count) if count != tuples => {
                    return Err(self.wrong(format_args!("array `{name}` has {tuples} tuples for {count} points")));
                }
                Section::Points(_) => self.attribute(&name, &kind, tuples, components)?,
                _ => self.array(None, &kind, tuples, components, &name)?,
            }
        }
        Ok(())
    }

    /// Reads an array of the current section, whatever its type.
    fn attribute(&mut self, name: &str, kind: &[u8], tuples: u64, components: u64) -> Result<(), ReadError> {
        match self.kind(kind)? {
            Some(kind) => self.named(name, kind, tuples, components, false),
            None => self.array(None, kind, tuples, components, name),
        }
    }

    /// Reads an array of numbers of the current section.
    fn named(&mut self, name: &str, kind: Kind, tuples: u64, components: u64, is_color: bool) -> Result<(), ReadError> {
        let group = match self.section {
            Section::Points(_) => {
                let group = self.table.array(name, components, kind.is_byte(), is_color);
                Some(group.map_err(|problem| self.wrong(problem))?)
            }
            _ => None,
        };
        self.data(group.as_ref(), kind, tuples, components, name)?;
        self.after_array(components)
    }

    /// The kind of that name; none if it is one of text.
    fn kind(&mut self, word: &[u8]) -> Result<Option<Kind>, ReadError> {
        let name = word.to_ascii_lowercase();
        if [b"string".as_slice(), b"utf8_string", b"unicode_string", b"variant"].contains(&name.as_slice()) {
            return Ok(None);
        }
        let Some((_, text, binary)) = TYPES.iter().find(|entry| entry.0.as_bytes() == name) else {
            let known: Vec<&str> = TYPES.iter().map(|entry| entry.0).collect();
            return Err(self.wrong(format_args!("type {}; allowed: {}, string", quote(word), known.join(", "))));
        };
        self.long |= self.binary && name.ends_with(b"long");
        Ok(Some(if self.binary { *binary } else { *text }))
    }

    /// Reads an array of any type, and what may follow it.
    fn array(
        &mut self,
        group: Option<&Group>,
        kind: &[u8],
        tuples: u64,
        components: u64,
        name: &str,
    ) -> Result<(), ReadError> {
        match self.kind(kind)? {
            Some(kind) => self.data(group, kind, tuples, components, name)?,
            None if kind.eq_ignore_ascii_case(b"variant") => {
                // A type and a word, in binary files too.
                let words = tuples.saturating_mul(components).saturating_mul(2);
                let found = for_each_word(&mut self.source, words, None, |_, _| Ok(()))?;
                self.expect_all(found, words, name)?;
            }
            None => self.skip_strings(tuples.saturating_mul(components), name)?,
        }
        self.after_array(components)
    }

    /// Reads the data of an array of numbers into the columns of a group, or passes over them.
    fn data(
        &mut self,
        group: Option<&Group>,
        kind: Kind,
        tuples: u64,
        components: u64,
        name: &str,
    ) -> Result<(), ReadError> {
        let values = tuples.saturating_mul(components);
        if values == 0 {
            return Ok(());
        }
        if self.binary {
            self.end_line()?;
        }
        let bytes = if self.binary { kind.bytes(values) } else { values.saturating_mul(2) - 1 };
        if let Some(size) = self.size {
            let available = size.saturating_sub(self.source.byte);
            if bytes > available {
                return Err(self.wrong(format_args!(
                    "the {values} values of `{name}` need at least {bytes} bytes, but {available} are left: the file is \
                     truncated, or a count is wrong"
                )));
            }
        }
        let wanted = group.filter(|group| !group.wanted.is_empty());
        let Some(group) = wanted else {
            if self.binary {
                return self.source.skip(bytes, || format!("the {values} values of `{name}`"));
            }
            let found = for_each_word(&mut self.source, values, None, |_, _| Ok(()))?;
            return self.expect_all(found, values, name);
        };
        if self.size.is_some() {
            let numbers = tuples.saturating_mul(group.wanted.len() as u64);
            self.table.check_memory(numbers, 0, self.source.byte).map_err(|problem| self.wrong(problem))?;
        }
        let (lenient, checked) = (self.table.is_lenient(), self.size.is_some());
        let mut sink = Sink::new(group, kind, true, tuples, lenient, checked, |column| self.table.take(column))?
            .starting_at(self.source.byte);
        if self.binary {
            let mut left = bytes;
            let mut block = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX).min(sink.block(BLOCK))];
            while left > 0 {
                let length = left.min(block.len() as u64);
                let block = block.get_mut(..length as usize).unwrap_or_default();
                self.source.fill(block, || format!("the {values} values of `{name}`"))?;
                sink.push(block).map_err(ReadError::Content)?;
                left -= length;
                // Where the size is unknown it grows with what was read.
                self.table.check_memory(sink.held(), 0, self.source.byte).map_err(|problem| self.wrong(problem))?;
            }
        } else {
            let found = for_each_word(&mut self.source, values, None, |_, word| sink.word(word))?;
            self.expect_all(found, values, name)?;
        }
        sink.give_back(&mut self.table);
        Ok(())
    }

    fn expect_all(&self, found: u64, values: u64, name: &str) -> Result<(), ReadError> {
        if found == values {
            return Ok(());
        }
        Err(self.wrong(format_args!("the file ends after {found} of the {values} values of `{name}`")))
    }

    /// Passes over strings: lines of text, or each behind its length.
    fn skip_strings(&mut self, count: u64, name: &str) -> Result<(), ReadError> {
        self.end_line()?;
        for index in 0..count {
            let place = || format!("string {index} of {count} of `{name}`");
            if !self.binary {
                if !self.source.read_line(LONGEST_STRING)? {
                    return Err(self.wrong(format_args!("the file ends before {}", place())));
                }
                continue;
            }
            // The two highest bits of the first byte tell how many more hold the length.
            let mut bytes = [0; 8];
            let (first, rest) = bytes.split_at_mut(1);
            self.source.fill(first, place)?;
            let more = match first.first().map_or(0, |byte| byte >> 6) {
                3 => 0,
                2 => 1,
                1 => 3,
                _ => 7,
            };
            self.source.fill(rest.get_mut(..more).unwrap_or_default(), place)?;
            let length = (u64::from_be_bytes(bytes) << 2 >> 2) >> (8 * (7 - more));
            self.source.skip(length, place)?;
        }
        Ok(())
    }

    /// Passes over the metadata that an array of so many components may have.
    fn after_array(&mut self, components: u64) -> Result<(), ReadError> {
        match self.next_word()? {
            Some(word) if word.eq_ignore_ascii_case(b"METADATA") => self.skip_metadata(components),
            word => {
                self.pending = word;
                Ok(())
            }
        }
    }

    /// Passes over the lines behind METADATA, which end with an empty one.
    fn skip_metadata(&mut self, components: u64) -> Result<(), ReadError> {
        self.end_line()?;
        let mut keys: u64 = 0;
        while self.source.read_line(LONGEST_LINE)? {
            let text = self.source.text.to_ascii_uppercase();
            if text.is_empty() {
                // Before the last key an empty line ends nothing.
                if keys == 0 {
                    break;
                }
            } else if text.starts_with(b"COMPONENT_NAMES") {
                // A name may be an empty line.
                for _ in 0..components {
                    if !self.source.read_line(LONGEST_LINE)? {
                        break;
                    }
                }
            } else if let Some(count) = text.strip_prefix(b"INFORMATION ") {
                keys = std::str::from_utf8(count.trim_ascii()).ok().and_then(|count| count.parse().ok()).unwrap_or(0);
            } else if text.starts_with(b"NAME ") {
                keys = keys.saturating_sub(1);
            }
        }
        Ok(())
    }
}
