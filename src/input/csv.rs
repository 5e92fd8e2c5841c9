//! Particles from comma-separated text.
//!
//! The first line that is neither blank nor a comment names the columns; names are trimmed of spaces and compared with
//! their case. Fields may be quoted; lines end with LF, CRLF or CR; a byte order mark is skipped; lines that start with
//! `#` are comments. Columns that are not wanted may hold anything. Colours are linear light.
//!
//! The crate `csv` splits records. Its line numbers are those of the place where it began to look for a record, before
//! comments and blank lines, and depend on the kind of line end; `Rows` therefore feeds it LF alone and counts from
//! the record's end, so that an error names the line that an editor shows.

use super::columns::{Column, Columns, MAX_ROWS, ReadError, Selection, number, number_or_nan, quote};
use csv::{ByteRecord, ReaderBuilder};
use std::collections::HashSet;
use std::io::{self, BufRead, Read};

/// Names that mean colour in a CSV file.
pub const COLORS: &[[&str; 3]] = &[["r", "g", "b"]];

/// Longest record that is accepted, bytes: what is longer is no table, and may be a missing quote.
/// A field takes a byte of the file and eight of memory at least.
const LONGEST_RECORD: u64 = 1 << 22;

/// Most columns that are accepted, wanted or not: the name of each takes memory, however short it is.
const MOST_COLUMNS: usize = 1 << 16;

/// Rows after which the number of all rows is estimated.
const SAMPLE: u64 = 1000;

/// Reads the wanted columns. `size`, the number of bytes of the whole file if known, only serves to reserve memory.
///
/// Errors name the line, the column and the offending text.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut rows = Rows::new(reader);
    if !rows.advance()? {
        return Err(ReadError::content("the file is empty; expected a header line such as x,y,z"));
    }
    let header_line = rows.line();
    let count = rows.fields().count();
    if count > MOST_COLUMNS {
        let message = format!("line {header_line}: {count} columns; allowed: at most {MOST_COLUMNS}");
        return Err(ReadError::content(message));
    }
    let names: Vec<String> = rows.fields().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
    refuse_header(&names, header_line)?;
    let mut wanted = Vec::new();
    let mut seen = HashSet::new();
    let mut columns: Vec<Column> = Vec::new();
    for (index, name) in names.iter().enumerate().filter(|(_, name)| selection.wants(name)) {
        if !seen.insert(name) {
            return Err(ReadError::content(format!("line {header_line}: column `{name}` stands twice in the header")));
        }
        wanted.push(index);
        columns.push(Column { name: name.clone(), values: Vec::new(), byte: false });
    }
    let mut count: u64 = 0;
    while rows.advance()? {
        rows.expect_fields(names.len(), "the header has")?;
        if count == MAX_ROWS {
            return Err(ReadError::content(format!("line {}: more than {MAX_ROWS} rows", rows.line())));
        }
        for (&index, column) in wanted.iter().zip(&mut columns) {
            column.values.push(if selection.is_lenient() {
                number_or_nan(rows.field(index))
            } else {
                rows.number(index, &column.name)?
            });
        }
        count += 1;
        if let (SAMPLE, Some(size)) = (count, size) {
            // Arrays that grow by doubling would need more memory than they keep. Too much room is given back below
            // and was never touched; where there is none, growing may still do.
            let rows = (size as f64 / rows.bytes().max(1) as f64 * SAMPLE as f64 * 1.01).min(MAX_ROWS as f64) as usize;
            for column in &mut columns {
                let _ = column.values.try_reserve_exact(rows.saturating_sub(column.values.len()));
            }
        }
    }
    for column in &mut columns {
        column.values.shrink_to_fit();
    }
    Columns::new(columns, names, count as usize, COLORS)
}

/// Refuses a header that is none: numbers, or names with something else than commas between them.
fn refuse_header(names: &[String], line: u64) -> Result<(), ReadError> {
    const ALLOWED: &str = "allowed: a line with the names of the columns, such as x,y,z";
    if names.iter().all(|name| number(name.as_bytes()).is_ok()) {
        return Err(ReadError::content(format!(
            "line {line}: numbers where the names of the columns are expected (a line that begins with # is a comment); \
             {ALLOWED}"
        )));
    }
    let separators = [(';', "semicolons"), ('\t', "tabs"), (' ', "spaces")];
    match names {
        [name] if let Some((_, what)) = separators.iter().find(|(separator, _)| name.contains(*separator)) => {
            let name = quote(name.as_bytes());
            Err(ReadError::content(format!("line {line}: {name}: {what} where commas are expected; {ALLOWED}")))
        }
        _ => Ok(()),
    }
}

/// The records of a comma-separated text, with the lines they stand on.
pub(super) struct Rows<'a> {
    reader: csv::Reader<PlainLines<'a>>,
    record: ByteRecord,
}

impl<'a> Rows<'a> {
    pub(super) fn new(reader: &'a mut dyn BufRead) -> Self {
        let lines = PlainLines { reader, after_return: false, at_line_start: true, since_record: 0, ended: false };
        let reader = ReaderBuilder::new()
            .has_headers(false)
            // Wrong lengths are reported here, with the line.
            .flexible(true)
            .comment(Some(b'#'))
            .buffer_capacity(1 << 16)
            .from_reader(lines);
        Self { reader, record: ByteRecord::new() }
    }

    /// Goes to the next record that is not blank; false at the end.
    pub(super) fn advance(&mut self) -> Result<bool, ReadError> {
        loop {
            self.reader.get_mut().since_record = 0;
            let line = self.reader.position().line();
            match self.reader.read_byte_record(&mut self.record) {
                Ok(false) => return Ok(false),
                Ok(true) => {}
                Err(error) => {
                    return Err(match error.into_kind() {
                        csv::ErrorKind::Io(error) if error.kind() == io::ErrorKind::InvalidData => {
                            ReadError::content(format!("line {line}: {error}"))
                        }
                        csv::ErrorKind::Io(error) => ReadError::Io(error),
                        other => ReadError::content(format!("line {line}: {other:?}")),
                    });
                }
            }
            let blank = self.record.len() <= 1 && self.record.as_slice().trim_ascii().is_empty();
            if !blank {
                return Ok(true);
            }
        }
    }

    /// The line the record begins on, from 1.
    pub(super) fn line(&self) -> u64 {
        let inside = self.record.as_slice().iter().filter(|&&byte| byte == b'\n').count() as u64;
        // Every line ends with LF (see PlainLines), so the reader stands on the line after the record; within a quote
        // that was never closed that LF is a part of the record.
        let end = u64::from(!self.reader.get_ref().ended);
        self.reader.position().line().saturating_sub(end + inside).max(1)
    }

    /// Bytes read up to the end of the record.
    fn bytes(&self) -> u64 {
        self.reader.position().byte()
    }

    pub(super) fn fields(&self) -> impl Iterator<Item = &[u8]> {
        self.record.iter()
    }

    /// Fails unless the record has `count` fields; `whose` says where that number comes from.
    pub(super) fn expect_fields(&self, count: usize, whose: &str) -> Result<(), ReadError> {
        let found = self.record.len();
        if found == count {
            return Ok(());
        }
        let plural = if found == 1 { "" } else { "s" };
        let line = self.line();
        let hint = quote_hint(self.record.as_slice());
        Err(ReadError::content(format!("line {line}: {found} field{plural} where {whose} {count}{hint}")))
    }

    fn field(&self, index: usize) -> &[u8] {
        self.record.get(index).unwrap_or_default()
    }

    /// The number in field `index`, counted from 0, of the column called `name`.
    pub(super) fn number(&self, index: usize, name: &str) -> Result<f64, ReadError> {
        let field = self.field(index);
        number(field).map_err(|problem| {
            let (name, hint) = (quote(name.as_bytes()), quote_hint(field));
            ReadError::content(format!("line {}, column {name}: {problem}{hint}", self.line()))
        })
    }
}

/// What a line end within a field suggests.
fn quote_hint(text: &[u8]) -> &'static str {
    if text.contains(&b'\n') { " (is a closing quote missing?)" } else { "" }
}

/// The same text with every line, the last included, ended by LF alone, and a bound on the length of a record.
struct PlainLines<'a> {
    reader: &'a mut dyn BufRead,
    /// The byte before was a CR, already passed on as LF.
    after_return: bool,
    /// The byte before was an LF, or there was none.
    at_line_start: bool,
    /// Bytes passed on since the caller last got a record.
    since_record: u64,
    /// The end was asked for and reported.
    ended: bool,
}

impl Read for PlainLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.since_record > LONGEST_RECORD {
            let limit = LONGEST_RECORD >> 20;
            let message = format!("a record of more than {limit} MiB (is a closing quote missing?)");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        let mut written = 0;
        while written == 0 && !buffer.is_empty() {
            let input = match self.reader.fill_buf() {
                Ok(input) => input,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            if input.is_empty() {
                if self.at_line_start {
                    self.ended = true;
                    return Ok(0);
                }
                buffer[0] = b'\n';
                self.at_line_start = true;
                return Ok(1);
            }
            let used = input.len().min(buffer.len());
            for &byte in &input[..used] {
                let pair = self.after_return && byte == b'\n';
                self.after_return = byte == b'\r';
                if !pair {
                    buffer[written] = if byte == b'\r' { b'\n' } else { byte };
                    written += 1;
                }
            }
            self.reader.consume(used);
        }
        if written > 0 {
            self.at_line_start = buffer[written - 1] == b'\n';
        }
        self.since_record += written as u64;
        Ok(written)
    }
}
