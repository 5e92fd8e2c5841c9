//! Particles from NumPy's `.npy` files, format versions 1.0, 2.0 and 3.0 (NumPy Enhancement Proposal 1, *A Simple File
//! Format for NumPy Arrays*, and the documentation of `numpy.lib.format`).
//!
//! Two kinds of arrays are particles: a plain array of shape (N, columns), whose number of columns says what they
//! mean (see [`PLAIN`]), in C or in Fortran order; and a structured array of shape (N,) or (N, 1), whose fields name
//! the columns. A field of three items called `pos`, `position`, ... becomes x, y, z, one called `rgb`, `color`, ...
//! becomes r, g, b, unless the array has columns of these names; every other sub-array `NAME` becomes `NAME_0`,
//! `NAME_1`, .... Fields that hold no numbers are passed over unless they are asked for. Unsigned bytes called r, g, b
//! or red, green, blue in a structured array are sRGB-encoded colour; all other colour is linear light.
//!
//! Why an own reader: `npyz` gives every number of a plain array by a call of its own, and records only as a type known
//! at compile time, while here columns are chosen at run time and decoded by their stride from blocks of rows. It
//! allocates as many bytes for the header as the file says, up to 4 GiB, and does not compare the shape with the size
//! of the file.

mod header;

use super::columns::{Column, Columns, MAX_ROWS, ReadError, Selection, quote, reserve};
use super::scalar::Scalar;
use super::source::Source;
use header::{Elements, Field, Header, Type, unsupported};
use std::io::BufRead;

/// Names that mean colour in a NumPy file.
pub const COLORS: &[[&str; 3]] = &[["r", "g", "b"], ["red", "green", "blue"]];

/// What the columns of a plain array mean, by their number. Of any other number the first three are x, y, z and the
/// others `c3`, `c4`, ....
pub const PLAIN: &[&[&str]] = &[
    &["x", "y", "z"],
    &["x", "y", "z", "radius"],
    &["x", "y", "z", "radius", "opacity"],
    &["x", "y", "z", "r", "g", "b"],
    &["x", "y", "z", "radius", "opacity", "r", "g", "b"],
];

/// Fields of three items that mean x, y, z, in lower case.
const POSITIONS: &[&str] =
    &["pos", "position", "positions", "xyz", "coord", "coordinates", "points", "centre", "center"];
/// Fields of three items that mean r, g, b, in lower case.
const RGB: &[&str] = &["rgb", "color", "colors", "colour", "colours"];

/// What every NumPy file begins with.
const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// What every zip archive that is not empty begins with.
const ZIP: &[u8; 4] = b"PK\x03\x04";

/// Longest header that is accepted, bytes: enough for [`MOST_COLUMNS`] fields of long names.
const LONGEST_HEADER: u64 = 1 << 18;
/// Most columns that are accepted, used or not: a header can claim any number of them without a row of data.
const MOST_COLUMNS: u64 = 4096;
/// Largest record that is accepted, bytes, because one is held in memory.
const LARGEST_RECORD: u64 = 1 << 20;
/// Bytes read at once: small enough for the cache, large enough for the calls not to count.
const BLOCK: usize = 1 << 18;
/// Values of all columns to reserve at once where the size of the file is unknown and the shape cannot be checked.
const CAUTIOUS: u64 = 1 << 20;

/// Whether a file that begins like this is a NumPy file, or an archive that may hold some, for which the reader says
/// what to do.
pub fn detect(head: &[u8]) -> bool {
    head.starts_with(MAGIC) || head.starts_with(ZIP)
}

/// Reads the wanted columns of an array.
///
/// `size` is the number of bytes of the whole file, if known: a shape that cannot fit is then refused before anything
/// is allocated. What stands behind the array is ignored, as NumPy does. Errors name the byte of the file.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut source = Source::new(reader);
    let header = read_header(&mut source, size)?;
    let layout = Layout::new(&header)?;
    let start = source.byte;
    if let Some(size) = size {
        let (available, needed) = (size.saturating_sub(start), layout.rows.saturating_mul(layout.stride));
        if needed > available {
            return Err(ReadError::content(format!(
                "an array of shape {} needs {needed} bytes after the header, which ends at byte {start}, but the file \
                 has {available}: it is truncated, or the shape is wrong",
                shape_text(&header.shape)
            )));
        }
    }
    let mut wanted = Vec::new();
    let mut columns = Vec::new();
    for item in layout.items.iter().filter(|item| selection.wants(&item.name)) {
        match &item.kind {
            Type::Number(scalar, big) => {
                wanted.push(Wanted { scalar: *scalar, big: *big, offset: item.offset });
                columns.push(Column { name: item.name.clone(), values: Vec::new(), byte: item.byte });
            }
            Type::Other { text, meaning, .. } if matches!(selection, Selection::Named(_)) => {
                return Err(ReadError::content(format!("column `{}`: {}", item.name, unsupported(text, meaning))));
            }
            Type::Other { .. } => {}
        }
    }
    let room = if size.is_some() { layout.rows } else { layout.rows.min(CAUTIOUS / columns.len().max(1) as u64) };
    let room = usize::try_from(room).map_err(|_| ReadError::content("more rows than this machine can address"))?;
    columns.iter_mut().try_for_each(|column| reserve(&mut column.values, room))?;
    let mut rows = Rows {
        source: &mut source,
        layout: &layout,
        checked: size.is_some(),
        lenient: selection.is_lenient(),
        block: Vec::new(),
    };
    if header.fortran_order && matches!(header.elements, Elements::Plain(_)) {
        rows.one_after_the_other(&wanted, &mut columns)?;
    } else {
        rows.side_by_side(&wanted, &mut columns)?;
    }
    let names = layout.items.iter().filter(|item| matches!(item.kind, Type::Number(..)));
    let names: Vec<String> = names.map(|item| item.name.clone()).collect();
    // What is not known by its number of columns has numbers for names.
    let guessed = matches!(header.elements, Elements::Plain(_)) && names.get(3).is_some_and(|name| name != "c3");
    let note = guessed.then(|| {
        format!(
            "the {} columns of a plain array are taken for {}; those of a structured array have names of their own",
            names.len(),
            names.join(", ")
        )
    });
    // Checked above to be one of at most MAX_ROWS.
    let mut columns = Columns::new(columns, names, layout.rows as usize, COLORS)?;
    columns.notes.extend(note);
    Ok(columns)
}

/// Reads up to where the data begin.
fn read_header(source: &mut Source, size: Option<u64>) -> Result<Header, ReadError> {
    let mut start = [0; 8];
    source.fill(&mut start[..4], || "the signature".to_owned())?;
    if start.starts_with(ZIP) {
        return Err(ReadError::content(
            "this is a zip archive, as .npz files are; save the array of particles by itself as .npy: \
             numpy.save(\"particles.npy\", array)",
        ));
    }
    source.fill(&mut start[4..], || "the signature".to_owned())?;
    if !start.starts_with(MAGIC) {
        let found = quote(&start[..6]);
        return Err(ReadError::content(format!("byte 0: {found}; a NumPy file begins with \\x93NUMPY")));
    }
    let length = || "the length of the header".to_owned();
    let length: u64 = match (start[6], start[7]) {
        (1, 0) => {
            let mut bytes = [0; 2];
            source.fill(&mut bytes, length)?;
            u16::from_le_bytes(bytes).into()
        }
        (2 | 3, 0) => {
            let mut bytes = [0; 4];
            source.fill(&mut bytes, length)?;
            u32::from_le_bytes(bytes).into()
        }
        (major, minor) => {
            let message = format!("byte 6: format version {major}.{minor}; allowed: 1.0, 2.0, 3.0");
            return Err(ReadError::content(message));
        }
    };
    let byte = source.byte;
    if length > LONGEST_HEADER {
        let message = format!("byte 8: a header of {length} bytes; allowed: at most {LONGEST_HEADER}");
        return Err(ReadError::content(message));
    }
    if size.is_some_and(|size| length > size.saturating_sub(byte)) {
        let message = format!("byte 8: a header of {length} bytes ends behind the file: it is truncated");
        return Err(ReadError::content(message));
    }
    let mut text = vec![0; length as usize];
    source.fill(&mut text, || "the header".to_owned())?;
    // Latin-1 up to version 2.0, UTF-8 since.
    let text = if start[6] < 3 {
        text.into_iter().map(char::from).collect()
    } else {
        String::from_utf8(text).map_err(|error| {
            let at = byte + error.utf8_error().valid_up_to() as u64;
            ReadError::content(format!("byte {at}: not UTF-8, in which the header of version 3.0 is written"))
        })?
    };
    Header::parse(&text, byte)
}

/// A tuple as Python writes it.
fn shape_text(shape: &[u64]) -> String {
    match shape {
        [only] => format!("({only},)"),
        _ => format!("({})", shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// One column as it lies in a row.
#[derive(Debug)]
struct Item {
    name: String,
    kind: Type,
    /// Bytes from the beginning of the row; in Fortran order too, where these are the columns' sizes added up.
    offset: usize,
    byte: bool,
}

/// Where the columns are.
#[derive(Debug)]
struct Layout {
    items: Vec<Item>,
    /// At most [`MAX_ROWS`].
    rows: u64,
    /// Bytes of a row, 1 to [`LARGEST_RECORD`].
    stride: u64,
}

impl Layout {
    fn new(header: &Header) -> Result<Self, ReadError> {
        let (items, rows, stride) = match &header.elements {
            Elements::Plain(kind) => plain(kind, &header.shape)?,
            Elements::Records(fields) => {
                let rows = match header.shape[..] {
                    [rows] | [rows, 1] => rows,
                    _ => {
                        return Err(ReadError::content(format!(
                            "a structured array of shape {}; allowed: (N,) or (N, 1)",
                            shape_text(&header.shape)
                        )));
                    }
                };
                let (items, stride) = records(fields)?;
                (items, rows, stride)
            }
        };
        if rows > MAX_ROWS {
            return Err(ReadError::content(format!("{rows} rows; allowed: at most {MAX_ROWS}")));
        }
        Ok(Self { items, rows, stride })
    }
}

/// The columns of a plain array, its rows and the bytes of a row.
fn plain(kind: &Type, shape: &[u64]) -> Result<(Vec<Item>, u64, u64), ReadError> {
    let &Type::Number(scalar, _) = kind else {
        let Type::Other { text, meaning, .. } = kind else { return Err(ReadError::content("not a number")) };
        return Err(ReadError::content(unsupported(text, meaning)));
    };
    let refuse = |hint: &str| {
        Err(ReadError::content(format!(
            "an array of shape {}; allowed: (N, 3) for x, y, z, or (N, C) with 3 to {MOST_COLUMNS} columns, of which \
             four mean x, y, z, radius, five opacity too, six x, y, z, r, g, b, and eight x, y, z, radius, opacity, r, \
             g, b; or a structured array with named fields{hint}",
            shape_text(shape)
        )))
    };
    const TRANSPOSED: &str = ". Particles seem to be columns here: save the transpose, numpy.save(name, array.T)";
    let (rows, count) = match *shape {
        // Nobody has three particles of a hundred values each, but coordinates one after the other are common.
        [3..=8, count] if !(3..=8).contains(&count) => return refuse(TRANSPOSED),
        [rows, count @ 3..=MOST_COLUMNS] => (rows, count),
        _ => return refuse(""),
    };
    let size = scalar.size();
    let known = PLAIN.iter().find(|names| names.len() as u64 == count).copied().unwrap_or(PLAIN[0]);
    let items = (0..count as usize).map(|index| Item {
        name: known.get(index).map_or_else(|| format!("c{index}"), |&name| name.to_owned()),
        kind: kind.clone(),
        offset: index * size,
        // Numbers of any kind, not colours with a name, so that their range is not known to be that of sRGB.
        byte: false,
    });
    Ok((items.collect(), rows, count * size as u64))
}

/// The columns of a record and its bytes.
fn records(fields: &[Field]) -> Result<(Vec<Item>, u64), ReadError> {
    let mut items: Vec<Item> = Vec::new();
    let mut end: u64 = 0;
    let has = |names: &[&str]| fields.iter().any(|field| names.contains(&field.name.as_str()));
    // What the first field of positions or colours is called, and what its items are called.
    let triples = [(POSITIONS, ["x", "y", "z"]), (RGB, ["r", "g", "b"])].map(|(aliases, names)| {
        let field = fields
            .iter()
            .position(|field| field.items == Some(3) && aliases.contains(&field.name.to_lowercase().as_str()));
        (field.filter(|_| !has(&names)), names)
    });
    for (index, field) in fields.iter().enumerate() {
        let start = end;
        end = end.saturating_add(field.size);
        if end > LARGEST_RECORD {
            let message = format!("records of more than {LARGEST_RECORD} bytes; allowed: at most so many");
            return Err(ReadError::content(message));
        }
        if field.name.is_empty() {
            continue;
        }
        if field.items.unwrap_or(1) > MOST_COLUMNS - items.len() as u64 {
            let message = format!("field `{}`: more than {MOST_COLUMNS} columns", field.name);
            return Err(ReadError::content(message));
        }
        let triple = triples.iter().find(|(field, _)| *field == Some(index)).map(|(_, names)| *names);
        for item in 0..field.items.unwrap_or(1) as usize {
            let name = match (triple, field.items) {
                (Some(names), _) => names.get(item).copied().unwrap_or_default().to_owned(),
                (None, None) => field.name.clone(),
                (None, Some(_)) => format!("{}_{item}", field.name),
            };
            let color = COLORS.iter().flatten().any(|color| *color == name);
            let byte = color && matches!(field.kind, Type::Number(Scalar::U8, _));
            // Both below LARGEST_RECORD.
            let offset = start as usize + item * field.kind.size() as usize;
            items.push(Item { name, kind: field.kind.clone(), offset, byte });
        }
    }
    let mut names: Vec<&str> = items.iter().map(|item| item.name.as_str()).collect();
    names.sort_unstable();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(ReadError::content(format!("two fields give a column `{}`", pair[0])));
    }
    if end == 0 {
        return Err(ReadError::content("the records have no bytes; allowed: fields of numbers such as ('x', '<f4')"));
    }
    Ok((items, end))
}

/// A column to decode.
#[derive(Clone, Copy)]
struct Wanted {
    scalar: Scalar,
    big: bool,
    offset: usize,
}

/// The data.
struct Rows<'a, 'b> {
    source: &'a mut Source<'b>,
    layout: &'a Layout,
    /// Whether the size of the file says that all rows are there.
    checked: bool,
    lenient: bool,
    block: Vec<u8>,
}

impl Rows<'_, '_> {
    /// Reads rows of all columns.
    fn side_by_side(&mut self, wanted: &[Wanted], columns: &mut [Column]) -> Result<(), ReadError> {
        let (rows, stride) = (self.layout.rows, self.layout.stride as usize);
        let mut done = 0;
        while done < rows {
            let count = self.fill(stride, done, "row")?;
            let start = self.source.byte - self.block.len() as u64;
            for (wanted, column) in wanted.iter().zip(&mut *columns) {
                self.decode(*wanted, stride, start, done, column)?;
            }
            done += count;
        }
        Ok(())
    }

    /// Reads columns of all rows.
    fn one_after_the_other(&mut self, wanted: &[Wanted], columns: &mut [Column]) -> Result<(), ReadError> {
        let rows = self.layout.rows;
        let mut passed = 0;
        for (&wanted, column) in wanted.iter().zip(columns) {
            let between = (wanted.offset - passed) as u64;
            self.source.skip(between * rows, || "a column before the last wanted one".to_owned())?;
            let size = wanted.scalar.size();
            let mut done = 0;
            while done < rows {
                let count = self.fill(size, done, &column.name)?;
                let start = self.source.byte - self.block.len() as u64;
                self.decode(Wanted { offset: 0, ..wanted }, size, start, done, column)?;
                done += count;
            }
            passed = wanted.offset + size;
        }
        if self.checked {
            // What is known to be there need not be read.
            return Ok(());
        }
        let rest = self.layout.stride - passed as u64;
        self.source.skip(rest * rows, || "a column after the last wanted one".to_owned())
    }

    /// Reads the next rows of `stride` bytes into the block and returns their number; `done` are before them.
    fn fill(&mut self, stride: usize, done: u64, what: &str) -> Result<u64, ReadError> {
        let rows = self.layout.rows;
        let count = (rows - done).min((BLOCK / stride).max(1) as u64);
        self.block.resize(stride * count as usize, 0);
        self.source.fill(&mut self.block, || format!("row {done} of {rows} ({what}) or one soon after"))?;
        Ok(count)
    }

    /// Appends one column of the block, which begins at byte `start` of the file and with row `first`.
    fn decode(
        &self,
        wanted: Wanted,
        stride: usize,
        start: u64,
        first: u64,
        column: &mut Column,
    ) -> Result<(), ReadError> {
        let Wanted { scalar, big, offset } = wanted;
        let before = column.values.len();
        if big {
            scalar.decode::<true>(&self.block, stride, offset, &mut column.values);
        } else {
            scalar.decode::<false>(&self.block, stride, offset, &mut column.values);
        }
        for (row, value) in column.values[before..].iter_mut().enumerate().filter(|(_, value)| !value.is_finite()) {
            if !self.lenient {
                let byte = start + (row * stride + offset) as u64;
                let (name, row) = (&column.name, first + row as u64);
                return Err(ReadError::content(format!(
                    "byte {byte}: column `{name}` of row {row}, counted from 0, is {value}; allowed: a finite number"
                )));
            }
            *value = f64::NAN;
        }
        Ok(())
    }
}
