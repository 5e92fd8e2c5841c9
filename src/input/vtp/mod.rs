//! Particles from XML VTK files, `.vtp` (PolyData) and `.vtu` (UnstructuredGrid): the points as columns x, y, z, and
//! every array of numbers in PointData (*VTK XML Formats*, in VTK's documentation; what it leaves open is decided as
//! vtkXMLDataReader of VTK 9 does).
//!
//! All pieces are read, one behind the other. Data may be text, base64 or appended, raw or in base64, in either byte
//! order, and compressed with zlib or LZ4. Of several time steps the first is read. Cells, their data, field data and
//! arrays of text are passed over. Columns are named as of legacy files, see [`super::vtk`].
//!
//! The stream is read once: arrays at the end of the file are read in the order of their offsets, and no array is held
//! in memory but as the columns it becomes. What compressed data may grow to is bounded, see `Allowance`.

mod data;
mod tags;

use super::columns::{Columns, MAX_ROWS, ReadError, Selection, quote};
use super::scalar::Scalar;
use super::source::Source;
use super::vtk::table::{FREE_MEMORY, Group, Table};
use super::vtk::values::{Kind, Sink};
use data::{Bytes, Compressor, Encoding, expect_end, read_text};
use std::io::BufRead;
use tags::{Role, Tag, Tags, count_lines};

pub use super::vtk::COLORS;

/// What begins the first tag.
const ROOT: &str = "VTKFile";
/// Where in a file the first tag begins at the latest, bytes.
const PROLOGUE: usize = 1 << 12;
/// UTF-8's byte order mark.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";
/// How an HDF5 file begins, as VTKHDF files do.
const HDF5: &[u8] = b"\x89HDF";
/// The datasets that are read.
const DATASETS: [&str; 2] = ["PolyData", "UnstructuredGrid"];
/// Compressed data may be so many times as large as the file, besides [`FREE_MEMORY`].
const LARGEST_RATIO: u64 = 4;

/// The types of numbers.
const TYPES: &[(&str, Kind)] = &[
    ("Int8", Kind::Number(Scalar::I8)),
    ("UInt8", Kind::Number(Scalar::U8)),
    ("Int16", Kind::Number(Scalar::I16)),
    ("UInt16", Kind::Number(Scalar::U16)),
    ("Int32", Kind::Number(Scalar::I32)),
    ("UInt32", Kind::Number(Scalar::U32)),
    ("Int64", Kind::Number(Scalar::I64)),
    ("UInt64", Kind::Number(Scalar::U64)),
    ("Float32", Kind::Number(Scalar::F32)),
    ("Float64", Kind::Number(Scalar::F64)),
    ("Bit", Kind::Bit),
];

/// Whether a file that begins like this is an XML VTK file.
pub fn detect(head: &[u8]) -> bool {
    let head = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head).trim_ascii_start();
    let head = head.get(..head.len().min(PROLOGUE)).unwrap_or_default();
    let root = [b"<".as_slice(), ROOT.as_bytes()].concat();
    let prologue = [b"<?".as_slice(), b"<!"].iter().any(|start| head.starts_with(start));
    head.starts_with(&root) || prologue && head.windows(root.len()).any(|part| part == root)
}

/// Reads the wanted columns: the points and their data.
///
/// `size` is the number of bytes of the whole file, if known: counts that cannot fit are then refused before anything
/// is allocated. Errors name the byte and the tag or array.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut source = Source::new(reader);
    if source.available()?.starts_with(HDF5) {
        return Err(ReadError::content("this is an HDF5 file; VTKHDF cannot be read; allowed: .vtp or .vtu in XML"));
    }
    let mut tags = Tags::new(source);
    let root = match tags.try_next()? {
        Some(tag) if tag.name == ROOT => tag,
        Some(tag) => return Err(tag.wrong(format_args!("an XML VTK file begins with <{ROOT}>"))),
        None => return Err(ReadError::content(format!("no tag; an XML VTK file begins with <{ROOT}>"))),
    };
    let dataset = root.get("type").unwrap_or_default().to_owned();
    if !DATASETS.contains(&dataset.as_str()) {
        return Err(wrong_dataset(&root, &dataset));
    }
    let encoding = read_encoding(&root)?;
    let table = Table::new(selection, size);
    let allowance = Allowance { size, used: 0 };
    let mut file = File {
        tags,
        size,
        encoding,
        table,
        allowance,
        arrays: Vec::new(),
        jobs: Vec::new(),
        rows: 0,
        pieces: 0,
        later_steps: false,
        has_cell_data: false,
    };
    let mut found = false;
    if root.role == Role::Open {
        while let Some(tag) = file.tags.child(ROOT)? {
            if tag.name == dataset {
                found = true;
                file.read_dataset(&tag)?;
            } else if tag.name == "AppendedData" && tag.role == Role::Open {
                file.read_appended(&tag)?;
                break;
            } else {
                file.tags.skip(&tag)?;
            }
        }
    }
    if !found {
        return Err(root.wrong(format_args!("no <{dataset}> within it")));
    }
    if let Some(job) = file.jobs.first() {
        let name = &file.group(job.array).name;
        return Err(ReadError::content(format!("no <AppendedData> with the data of array `{name}`: is it truncated?")));
    }
    let has_cell_data = file.has_cell_data;
    let mut columns = file.table.finish(file.rows as usize)?;
    if file.later_steps {
        columns.notes.push("the file has several time steps, of which the first was read".to_owned());
    }
    columns.notes.extend(has_cell_data.then(|| super::vtk::CELL_DATA_NOTE.to_owned()));
    Ok(columns)
}

fn wrong_dataset(root: &Tag, dataset: &str) -> ReadError {
    let found = quote(dataset.as_bytes());
    let allowed = DATASETS.join(", ");
    match dataset.strip_prefix('P').filter(|rest| DATASETS.contains(rest)) {
        Some(piece) => root.wrong(format_args!(
            "type {found}, a parallel file that only names others; allowed: {allowed} (one of its pieces, of type \
             {piece}, or all in one as ParaView saves them)"
        )),
        None => root.wrong(format_args!(
            "type {found}; allowed: {allowed} (other grids can be converted, in ParaView with the filter Append Datasets \
             or Extract Surface, or in VTK with vtkAppendFilter)"
        )),
    }
}

fn read_encoding(root: &Tag) -> Result<Encoding, ReadError> {
    let wrong = |name: &str, found: &str, allowed: &str| {
        root.wrong(format_args!("{name} is {}; allowed: {allowed}", quote(found.as_bytes())))
    };
    let big = match root.get("byte_order") {
        None | Some("LittleEndian") => false,
        Some("BigEndian") => true,
        Some(other) => return Err(wrong("byte_order", other, "LittleEndian, BigEndian")),
    };
    let header = match root.get("header_type") {
        None | Some("UInt32") => 4,
        Some("UInt64") => 8,
        Some(other) => return Err(wrong("header_type", other, "UInt32, UInt64")),
    };
    let compressor = match root.get("compressor") {
        None | Some("") => None,
        Some("vtkZLibDataCompressor") => Some(Compressor::Zlib),
        Some("vtkLZ4DataCompressor") => Some(Compressor::Lz4),
        Some(other) => {
            return Err(wrong("compressor", other, "none, vtkZLibDataCompressor, vtkLZ4DataCompressor"));
        }
    };
    Ok(Encoding { big, header, compressor })
}

/// How many bytes may come out of decompression, of all wanted arrays: 4 for each of the file and 64 MB besides, so
/// that a small file cannot fill the memory.
struct Allowance {
    size: Option<u64>,
    used: u64,
}

impl Allowance {
    /// Fails if `bytes` more are too many; `read` bytes were read, which count where the size is unknown.
    fn claim(&mut self, bytes: u64, read: u64) -> Result<(), String> {
        let size = self.size.unwrap_or(read);
        let allowed = size.saturating_mul(LARGEST_RATIO).saturating_add(FREE_MEMORY);
        self.used = self.used.saturating_add(bytes);
        if self.used > allowed {
            return Err(format!(
                "the wanted arrays have {} bytes, of which a file of {size} bytes is trusted with {allowed} (is it a \
                 decompression bomb?)",
                self.used
            ));
        }
        Ok(())
    }
}

/// Where the data of an array are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Ascii,
    Binary,
    /// So many bytes or characters into the appended data.
    Appended(u64),
}

/// How data are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Words between the tags of the array.
    Text,
    /// Base64 between the tags of the array.
    Inline,
    /// Bytes in the appended data.
    Raw,
    /// Base64 in the appended data.
    Base64,
}

/// An array of the appended data, to be read later.
struct Job {
    offset: u64,
    /// Index in the file's arrays; absent: the points.
    array: Option<usize>,
    kind: Kind,
    tuples: u64,
    /// Row of its first tuple.
    row: usize,
}

struct File<'a> {
    tags: Tags<'a>,
    size: Option<u64>,
    encoding: Encoding,
    table: Table<'a>,
    allowance: Allowance,
    /// The arrays of numbers of the first piece that is not empty.
    arrays: Vec<Group>,
    jobs: Vec<Job>,
    /// Rows of the pieces so far.
    rows: u64,
    /// Pieces so far that are not empty.
    pieces: u64,
    /// Whether data of a time step after the first were met.
    later_steps: bool,
    has_cell_data: bool,
}

impl File<'_> {
    fn group(&self, array: Option<usize>) -> &Group {
        array.and_then(|array| self.arrays.get(array)).unwrap_or(&self.table.points)
    }

    fn read_dataset(&mut self, dataset: &Tag) -> Result<(), ReadError> {
        if dataset.role == Role::Empty {
            return Ok(());
        }
        while let Some(tag) = self.tags.child(&dataset.name)? {
            if tag.name == "Piece" { self.read_piece(&tag)? } else { self.tags.skip(&tag)? }
        }
        Ok(())
    }

    fn read_piece(&mut self, piece: &Tag) -> Result<(), ReadError> {
        let Some(count) = piece.integer("NumberOfPoints")? else {
            return Err(piece.wrong("no NumberOfPoints; expected the number of points"));
        };
        if count == 0 || piece.role == Role::Empty {
            // An empty piece may lack the arrays that the others have.
            if count > 0 {
                return Err(piece.wrong(format_args!("{count} points, but nothing within it")));
            }
            return self.tags.skip(piece);
        }
        let row = self.rows;
        self.rows = row.saturating_add(count);
        if self.rows > MAX_ROWS {
            return Err(piece.wrong(format_args!("{} points; allowed: at most {MAX_ROWS}", self.rows)));
        }
        self.pieces += 1;
        let mut points = false;
        let mut read = vec![false; self.arrays.len()];
        while let Some(part) = self.tags.child("Piece")? {
            match part.name.as_str() {
                "Points" | "PointData" if part.role == Role::Open => {
                    while let Some(tag) = self.tags.child(&part.name)? {
                        if tag.name != "DataArray" && tag.name != "Array" {
                            self.tags.skip(&tag)?;
                        } else if part.name == "PointData" {
                            self.read_point_data(&tag, count, row as usize, &mut read)?;
                        } else if self.is_later_step(&tag) {
                            self.tags.skip(&tag)?;
                        } else if points {
                            return Err(tag.wrong("a second array of points; allowed: one"));
                        } else {
                            points = true;
                            self.read_points(&tag, count, row as usize)?;
                        }
                    }
                }
                "CellData" if part.role == Role::Open => {
                    // VTK writes the tag even with nothing in it.
                    while let Some(tag) = self.tags.child(&part.name)? {
                        self.has_cell_data |= tag.name == "DataArray";
                        self.tags.skip(&tag)?;
                    }
                }
                _ => self.tags.skip(&part)?,
            }
        }
        if !points {
            return Err(piece.wrong(format_args!("{count} points, but no <Points> with their coordinates")));
        }
        if let Some(missing) = read.iter().position(|read| !read) {
            let name = &self.group(Some(missing)).name;
            return Err(piece.wrong(format_args!("no array `{name}`, which the pieces before it have")));
        }
        Ok(())
    }

    fn is_later_step(&mut self, tag: &Tag) -> bool {
        let later = tag.get("TimeStep").is_some_and(|steps| !steps.split_ascii_whitespace().any(|step| step == "0"));
        self.later_steps |= later;
        later
    }

    fn read_points(&mut self, tag: &Tag, count: u64, row: usize) -> Result<(), ReadError> {
        let components = tag.integer("NumberOfComponents")?.unwrap_or(1);
        let expected = self.table.points.components as u64;
        if components != expected {
            return Err(tag.wrong(format_args!("points of {components} coordinates; allowed: {expected}")));
        }
        let Some(kind) = kind(tag)? else {
            return Err(tag.wrong(format_args!("points of text; allowed: {}", type_names())));
        };
        self.read_array(tag, None, kind, count, row)
    }

    /// Reads or notes an array of a piece; `read` tells which were already met in it.
    fn read_point_data(&mut self, tag: &Tag, count: u64, row: usize, read: &mut Vec<bool>) -> Result<(), ReadError> {
        if self.is_later_step(tag) {
            return self.tags.skip(tag);
        }
        let Some(kind) = kind(tag)? else { return self.tags.skip(tag) };
        let name = tag.get("Name").filter(|name| !name.is_empty()).unwrap_or("unnamed");
        let components = tag.integer("NumberOfComponents")?.unwrap_or(1);
        if let Some(tuples) = tag.integer("NumberOfTuples")?
            && tuples != count
        {
            return Err(tag.wrong(format_args!("array `{name}` has {tuples} tuples for {count} points")));
        }
        let array = if self.pieces == 1 {
            let group = self.table.array(name, components, kind.is_byte(), false);
            self.arrays.push(group.map_err(|problem| tag.wrong(problem))?);
            read.push(false);
            self.arrays.len() - 1
        } else {
            let same =
                |(group, read): (&Group, &bool)| !read && group.name == name && group.components as u64 == components;
            let found = self.arrays.iter().zip(read.iter()).position(same);
            found.ok_or_else(|| {
                tag.wrong(format_args!(
                    "array `{name}` of {components} components, which the pieces before this one do not have"
                ))
            })?
        };
        if let Some(read) = read.get_mut(array) {
            *read = true;
        }
        self.read_array(tag, Some(array), kind, count, row)
    }

    /// Reads the data of an array, or notes them for later, and passes its end.
    fn read_array(
        &mut self,
        tag: &Tag,
        array: Option<usize>,
        kind: Kind,
        tuples: u64,
        row: usize,
    ) -> Result<(), ReadError> {
        let format = match tag.get("format") {
            None | Some("ascii") => Format::Ascii,
            Some("binary") => Format::Binary,
            Some("appended") => match tag.integer("offset")? {
                Some(offset) => Format::Appended(offset),
                None => return Err(tag.wrong("appended data without an offset")),
            },
            Some(other) => {
                let found = quote(other.as_bytes());
                return Err(tag.wrong(format_args!("format is {found}; allowed: ascii, binary, appended")));
            }
        };
        let group = self.group(array);
        if group.wanted.is_empty() || group.components == 0 {
            return self.tags.skip(tag);
        }
        if let Format::Appended(offset) = format {
            self.jobs.push(Job { offset, array, kind, tuples, row });
            return self.tags.skip(tag);
        }
        if tag.role == Role::Empty || !self.find_data(tag)? {
            return Err(tag.wrong(format_args!("no data; expected those of {tuples} points")));
        }
        let place = if format == Format::Ascii { Place::Text } else { Place::Inline };
        self.read_data(array, kind, tuples, row, place).map_err(|problem| tag.wrong(problem))?;
        self.tags.skip(tag)
    }

    /// Goes to the data of an array, past what may describe them; false if there are none.
    fn find_data(&mut self, parent: &Tag) -> Result<bool, ReadError> {
        loop {
            let source = self.tags.source();
            let available = source.available()?;
            let Some(&first) = available.first() else { return Ok(false) };
            if first.is_ascii_whitespace() {
                let blank = available.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
                let lines = count_lines(available.get(..blank).unwrap_or_default());
                source.consume(blank);
                source.line += lines;
            } else if first != b'<' {
                return Ok(true);
            } else {
                match self.tags.child(&parent.name)? {
                    Some(tag) => self.tags.skip(&tag)?,
                    None => return Ok(false),
                }
            }
        }
    }

    /// Reads the data at which the stream stands.
    fn read_data(
        &mut self,
        array: Option<usize>,
        kind: Kind,
        tuples: u64,
        row: usize,
        place: Place,
    ) -> Result<(), String> {
        let group = array.and_then(|array| self.arrays.get(array)).unwrap_or(&self.table.points).clone();
        let values = tuples.saturating_mul(group.components as u64);
        let source = self.tags.source();
        let byte = source.byte;
        let (ascii, inline) = (place == Place::Text, matches!(place, Place::Text | Place::Inline));
        let compressed = self.encoding.compressor.is_some() && !ascii;
        if let Some(size) = self.size {
            let available = size.saturating_sub(byte);
            let needed = if ascii { values.saturating_mul(2) - 1 } else { kind.bytes(values) };
            if needed > available && !compressed {
                return Err(format!(
                    "the data of array `{}` need at least {needed} bytes, but the file has {available} more: it is \
                     truncated, or a count is wrong",
                    group.name
                ));
            }
            self.table.check_memory(tuples.saturating_mul(group.wanted.len() as u64), 0, byte)?;
        }
        if compressed && self.size.is_some() {
            self.allowance.claim(kind.bytes(values), byte)?;
        }
        let table = &mut self.table;
        let late = group.wanted.first().is_some_and(|&(_, column)| table.rows(column) != row);
        let (lenient, checked, big) = (table.is_lenient(), self.size.is_some(), self.encoding.big);
        let take = |column| if late { Vec::new() } else { table.take(column) };
        let mut sink = Sink::new(&group, kind, big, tuples, lenient, checked, take).map_err(|e| e.to_string())?;
        let wrong = |problem| format!("array `{}`: {problem}", group.name);
        let read = if ascii {
            read_text(source, &mut sink, values)
        } else {
            Bytes::new(source, place != Place::Raw, self.size).read(&mut sink, kind, values, self.encoding, table)
        };
        read.map_err(wrong)?;
        if inline {
            expect_end(source, &format!("the {values} values")).map_err(wrong)?;
        }
        if compressed && self.size.is_none() {
            self.allowance.claim(kind.bytes(values), source.byte)?;
        }
        for (column, values) in sink.finish() {
            if late {
                table.put_late(column, row, values);
            } else {
                table.put(column, values);
            }
        }
        Ok(())
    }

    /// Reads the arrays that were noted, in the order of their offsets.
    fn read_appended(&mut self, tag: &Tag) -> Result<(), ReadError> {
        let place = match tag.get("encoding") {
            Some("raw") => Place::Raw,
            None | Some("base64") => Place::Base64,
            Some(other) => {
                let found = quote(other.as_bytes());
                return Err(tag.wrong(format_args!("encoding is {found}; allowed: raw, base64")));
            }
        };
        if !self.find_data(tag)? || self.tags.source().available()?.first() != Some(&b'_') {
            return Err(tag.wrong("no `_`, behind which the data begin"));
        }
        self.tags.source().consume(1);
        let start = self.tags.source().byte;
        let mut jobs = std::mem::take(&mut self.jobs);
        jobs.sort_by_key(|job| job.offset);
        for job in jobs {
            let name = self.group(job.array).name.clone();
            let wrong = |problem: String| ReadError::content(format!("array `{name}`: {problem}"));
            let source = self.tags.source();
            let here = source.byte - start;
            let Some(gap) = job.offset.checked_sub(here) else {
                return Err(wrong(format!(
                    "its offset is {}, before the end of another array at {here}; allowed: arrays that do not overlap",
                    job.offset
                )));
            };
            source.skip(gap, || format!("the appended data, before array `{name}`"))?;
            self.read_data(job.array, job.kind, job.tuples, job.row, place).map_err(|problem| {
                ReadError::content(format!("byte {}: {problem}", start.saturating_add(job.offset)))
            })?;
        }
        Ok(())
    }
}

/// The kind of an array's values; none if it is one of text.
fn kind(tag: &Tag) -> Result<Option<Kind>, ReadError> {
    let name = tag.get("type").unwrap_or_default();
    if name == "String" {
        return Ok(None);
    }
    match TYPES.iter().find(|entry| entry.0 == name) {
        Some((_, kind)) => Ok(Some(*kind)),
        None => Err(tag.wrong(format_args!("type is {}; allowed: {}", quote(name.as_bytes()), type_names()))),
    }
}

fn type_names() -> String {
    TYPES.iter().map(|entry| entry.0).collect::<Vec<_>>().join(", ")
}
