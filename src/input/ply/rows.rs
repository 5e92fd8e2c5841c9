//! The scalar properties of a PLY file's element, decoded block by block.

use super::header::{Element, Format, Kind, Property};
use crate::input::columns::{Column, ReadError, number_or_nan, quote, reserve};
use crate::input::scalar::Scalar;
use crate::input::source::Source;

/// Bytes read at once: small enough for the cache, large enough for the calls not to count.
const BLOCK: usize = 1 << 18;
/// Elements handed on at once where they are read one by one.
const ROWS: u64 = 1 << 12;
/// Values of all columns to reserve at once where the size of the file is unknown and a count cannot be checked.
const CAUTIOUS: u64 = 1 << 20;

/// What is done with a block of rows, the last of each column: their numbers are those of the range. Columns that are
/// emptied then need no memory but for a block.
pub(super) type Block<'a> = &'a mut dyn FnMut(&mut [Column], std::ops::Range<u64>) -> Result<(), ReadError>;

/// Reserves memory for all elements if their count was `checked` against the size of the file, else for some.
pub(super) fn make_room(element: &Element, column: &mut Column, checked: bool) -> Result<(), ReadError> {
    let cautious = CAUTIOUS / element.properties.len().max(1) as u64;
    let room = if checked { element.count } else { element.count.min(cautious) };
    let room = usize::try_from(room).map_err(|_| ReadError::content(format!("{room} elements are too many")))?;
    reserve(&mut column.values, room)
}

/// Appends the properties of the columns' names to the columns, which stand in the order of the properties. Values that
/// are not finite are errors, or NaN where `lenient`.
pub(super) fn read_rows(
    element: &Element,
    format: Format,
    source: &mut Source,
    columns: &mut [Column],
    lenient: bool,
    block: Block,
) -> Result<(), ReadError> {
    match format {
        Format::Ascii => read_text(element, source, columns, lenient, block),
        Format::Little => read_binary::<false>(element, source, columns, lenient, block),
        Format::Big => read_binary::<true>(element, source, columns, lenient, block),
    }
}

fn read_binary<const BIG: bool>(
    element: &Element,
    source: &mut Source,
    columns: &mut [Column],
    lenient: bool,
    block: Block,
) -> Result<(), ReadError> {
    let count = element.count;
    let Some(stride) = element.stride() else {
        return one_by_one(count, columns, block, |index, columns| {
            let mut next = 0;
            element.row::<BIG>(source, index, |property, value, byte| {
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
    for (name, scalar) in element.scalars() {
        if columns.get(wanted.len()).is_some_and(|column| column.name == name) {
            wanted.push((scalar, offset));
        }
        offset += scalar.size();
    }
    let rows_per_block = (BLOCK / stride).max(1);
    let mut bytes = vec![0; stride * rows_per_block.min(count as usize)];
    let mut done: u64 = 0;
    while done < count {
        let rows = (count - done).min(rows_per_block as u64);
        let bytes = &mut bytes[..stride * rows as usize];
        let start = source.byte;
        source.fill(bytes, || format!("element {done} of {count} `{}` or one soon after", element.name))?;
        for (&(scalar, offset), column) in wanted.iter().zip(&mut *columns) {
            let before = column.values.len();
            scalar.decode::<BIG>(bytes, stride, offset, &mut column.values);
            for (row, value) in column.values[before..].iter_mut().enumerate().filter(|(_, v)| !v.is_finite()) {
                let byte = start + (row * stride + offset) as u64;
                *value = finite(&column.name, *value, done + row as u64, byte, lenient)?;
            }
        }
        block(columns, done..done + rows)?;
        done += rows;
    }
    Ok(())
}

fn read_text(
    element: &Element,
    source: &mut Source,
    columns: &mut [Column],
    lenient: bool,
    block: Block,
) -> Result<(), ReadError> {
    if element.properties.is_empty() {
        return Ok(());
    }
    one_by_one(element.count, columns, block, |index, columns| {
        let line = source.data_line(element, index)?;
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
        for property in &element.properties {
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
        Ok(())
    })
}

/// Reads `count` rows with `row` and hands them on in blocks.
fn one_by_one(
    count: u64,
    columns: &mut [Column],
    block: Block,
    mut row: impl FnMut(u64, &mut [Column]) -> Result<(), ReadError>,
) -> Result<(), ReadError> {
    let mut done = 0;
    while done < count {
        let end = count.min(done + ROWS);
        (done..end).try_for_each(|index| row(index, columns))?;
        block(columns, done..end)?;
        done = end;
    }
    Ok(())
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
