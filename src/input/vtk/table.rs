//! From VTK's arrays of tuples to columns with names of their own, within a bound on the memory.

use crate::input::columns::{Column, Columns, ReadError, Selection, reserve};
use std::collections::{HashMap, HashSet};

/// Names that mean colour: of an array called `rgb` or the like, or three arrays of these names.
pub const COLORS: &[[&str; 3]] = &[["r", "g", "b"], ["red", "green", "blue"]];

/// Names, in any case, of arrays of 3 or 4 components that are colours.
const COLOR_ARRAYS: &[&str] = &["rgb", "rgba", "color", "colors", "colour", "colours"];
/// Names of the columns of a colour.
const CHANNELS: [&str; 4] = ["r", "g", "b", "a"];
/// Names of the columns of the points, which no array can take.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Longest name of an array, bytes: with [`MOST_COLUMNS`] it bounds the memory for names.
const LONGEST_NAME: usize = 256;
/// The most components an array can have and still be split into columns.
const MOST_COMPONENTS: u64 = 1024;
/// The most columns of a file.
const MOST_COLUMNS: usize = 1 << 14;

/// Memory that a file may ask for whatever its size, bytes.
pub const FREE_MEMORY: u64 = 64 << 20;
/// Bytes of memory for each byte of a file, on top: a byte may be a value, which takes 8 as an f64.
const MEMORY_PER_BYTE: u64 = 8;

/// An array that becomes columns.
#[derive(Clone, Debug)]
pub struct Group {
    /// Name of the array, for messages.
    pub name: String,
    /// Values of each tuple.
    pub components: usize,
    /// The components that are kept, ascending, with the indices of their columns.
    pub wanted: Vec<(usize, usize)>,
}

/// The columns of a file while it is read.
pub struct Table<'a> {
    selection: &'a Selection,
    columns: Vec<Column>,
    names: Vec<String>,
    seen: HashSet<String>,
    /// The number last put behind the names of an array of this name.
    numbers: HashMap<String, u32>,
    size: Option<u64>,
    /// Values that came before those they follow: column, row of the first, values.
    late: Vec<(usize, usize, Vec<f64>)>,
    /// Bytes of values held.
    held: u64,
    /// The points: columns x, y and z.
    pub points: Group,
}

impl<'a> Table<'a> {
    /// Only the columns of the points, for a file of `size` bytes if known.
    pub fn new(selection: &'a Selection, size: Option<u64>) -> Self {
        let points = Group { name: "points".to_owned(), components: AXES.len(), wanted: Vec::new() };
        let mut table = Self {
            selection,
            columns: Vec::new(),
            names: Vec::new(),
            seen: HashSet::new(),
            numbers: HashMap::new(),
            size,
            late: Vec::new(),
            held: 0,
            points,
        };
        table.points.wanted = table.add(AXES.map(str::to_owned).into(), false);
        table
    }

    /// Whether what is no finite number is read as NaN.
    pub fn is_lenient(&self) -> bool {
        self.selection.is_lenient()
    }

    /// Adds the columns of an array of `components` values per point. `byte`: they are unsigned 8-bit integers;
    /// `is_color`: three or four of them are a colour whatever the name. Fails if there is too much of anything.
    pub fn array(&mut self, name: &str, components: u64, byte: bool, is_color: bool) -> Result<Group, String> {
        if name.len() > LONGEST_NAME {
            return Err(format!("the name of an array has {} bytes; allowed: at most {LONGEST_NAME}", name.len()));
        }
        let mut group = Group { name: name.to_owned(), components: 0, wanted: Vec::new() };
        group.components = match usize::try_from(components) {
            Ok(count) if components <= MOST_COMPONENTS => count,
            _ => return Err(format!("array `{name}` has {components} components; allowed: at most {MOST_COMPONENTS}")),
        };
        if self.names.len() + group.components > MOST_COLUMNS {
            return Err(format!("more than {MOST_COLUMNS} columns with array `{name}`"));
        }
        let is_color = is_color || COLOR_ARRAYS.iter().any(|color| color.eq_ignore_ascii_case(name));
        let bare: Vec<String> = match group.components {
            1 => vec![name.to_owned()],
            count @ (3 | 4) if is_color => CHANNELS.iter().take(count).map(|&channel| channel.to_owned()).collect(),
            count @ (2 | 3) => AXES.iter().take(count).map(|axis| format!("{name}_{axis}")).collect(),
            count => (0..count).map(|component| format!("{name}_{component}")).collect(),
        };
        let mut names = bare.clone();
        // One number for all of them, so that what belongs together stays so.
        while names.iter().any(|name| self.seen.contains(name)) {
            let number = self.numbers.entry(name.to_owned()).or_insert(1);
            *number += 1;
            names = bare.iter().map(|name| format!("{name}_{number}")).collect();
        }
        group.wanted = self.add(names, byte);
        Ok(group)
    }

    fn add(&mut self, names: Vec<String>, byte: bool) -> Vec<(usize, usize)> {
        let mut wanted = Vec::new();
        for (component, name) in names.into_iter().enumerate() {
            if self.selection.wants(&name) {
                wanted.push((component, self.columns.len()));
                self.columns.push(Column { name: name.clone(), values: Vec::new(), byte });
            }
            self.seen.insert(name.clone());
            self.names.push(name);
        }
        wanted
    }

    /// Number of values of a column.
    pub fn rows(&self, column: usize) -> usize {
        self.columns.get(column).map_or(0, |column| column.values.len())
    }

    /// Takes the values of a column out, to be given back with more.
    pub fn take(&mut self, column: usize) -> Vec<f64> {
        let values = self.columns.get_mut(column).map(|column| std::mem::take(&mut column.values)).unwrap_or_default();
        self.held -= bytes(&values);
        values
    }

    /// Gives a column its values.
    pub fn put(&mut self, column: usize, values: Vec<f64>) {
        if let Some(column) = self.columns.get_mut(column) {
            self.held += bytes(&values);
            column.values = values;
        }
    }

    /// Values of a column from some row on, before which others are missing as yet.
    pub fn put_late(&mut self, column: usize, row: usize, values: Vec<f64>) {
        self.held += bytes(&values);
        self.late.push((column, row, values));
    }

    /// Fails if memory for this many more numbers, and `other` bytes meanwhile, is more than a file of this size can
    /// ask for; `read` is how much of it was read, which counts where the size is unknown.
    pub fn check_memory(&self, numbers: u64, other: u64, read: u64) -> Result<(), String> {
        let size = self.size.unwrap_or(read);
        let allowed = size.saturating_mul(MEMORY_PER_BYTE).saturating_add(FREE_MEMORY);
        let needed = self.held.saturating_add(numbers.saturating_mul(8)).saturating_add(other);
        if needed > allowed {
            return Err(format!(
                "the wanted columns take {needed} bytes of memory, more than a file of {size} bytes is trusted to need;                  allowed: at most {allowed}"
            ));
        }
        Ok(())
    }

    /// The columns, of `len` rows.
    pub fn finish(mut self, len: usize) -> Result<Columns, ReadError> {
        self.late.sort_by_key(|(column, row, _)| (*column, *row));
        for (column, row, values) in self.late {
            let Some(column) = self.columns.get_mut(column).filter(|column| column.values.len() == row) else {
                continue;
            };
            reserve(&mut column.values, len.saturating_sub(row))?;
            column.values.extend(values);
        }
        Columns::new(self.columns, self.names, len, COLORS)
    }
}

fn bytes(values: &[f64]) -> u64 {
    size_of_val(values) as u64
}
