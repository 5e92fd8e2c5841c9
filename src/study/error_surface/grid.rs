//! Error surfaces: an error over a grid of centres, as CSV and as arrays.
//!
//! A grid is never held: cells are computed and turned into text in blocks on all threads, while the blocks before them are
//! written. Text is written with the shortest digits that read back exactly (zmij, which is Schubfach).

use super::unit::Unit;
use super::{Form, Setting};
use crate::render::Progress;
use glam::DVec3;
use rayon::prelude::*;
use std::io::{self, Write};

/// Numbers at equal steps, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The first.
    pub min: f64,
    /// The last; > `min`, or equal with a count of 1.
    pub max: f64,
    /// How many, 1 to [`Range::LONGEST`].
    pub count: u32,
}

impl Range {
    /// The largest count.
    pub const LONGEST: u32 = 100_000;

    /// The number at an index below the count. Ends and short decimals come out as they were typed, since the weights are
    /// whole numbers.
    pub fn value(&self, index: u32) -> f64 {
        if self.count <= 1 {
            return self.min;
        }
        let (i, n) = (f64::from(index), f64::from(self.count - 1));
        (self.min * (n - i) + self.max * i) / n
    }

    /// All of them.
    pub fn values(&self) -> Vec<f64> {
        (0..self.count).map(|i| self.value(i)).collect()
    }

    /// The same ends with at most so many steps.
    pub fn at_most(&self, count: u32) -> Self {
        Self { count: self.count.min(count), ..*self }
    }
}

/// Which coordinate varies besides C_x, and the value of the third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plane {
    /// C_x and C_z.
    Xz {
        /// C_y.
        y: f64,
    },
    /// C_x and C_y.
    Xy {
        /// C_z.
        z: f64,
    },
}

/// Centres on a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// C_x.
    pub x: Range,
    /// C_z or C_y.
    pub second: Range,
    /// Which of them, and the value of the third coordinate.
    pub plane: Plane,
}

impl Grid {
    /// The number of centres.
    pub fn cells(&self) -> u64 {
        u64::from(self.x.count) * u64::from(self.second.count)
    }

    /// The centre in a column (C_x) and a row.
    pub fn center(&self, column: u32, row: u32) -> DVec3 {
        let (x, second) = (self.x.value(column), self.second.value(row));
        match self.plane {
            Plane::Xz { y } => DVec3::new(x, y, second),
            Plane::Xy { z } => DVec3::new(x, second, z),
        }
    }
}

/// The precision of inputs, arithmetic and result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Double.
    F64,
    /// Single.
    F32,
}

/// What is asked of every centre.
#[derive(Clone, Debug)]
pub struct Request {
    /// The error.
    pub setting: Setting,
    /// How it is computed; a column each.
    pub forms: Vec<Form>,
    /// The precision.
    pub precision: Precision,
    /// What it is measured in.
    pub unit: Unit,
}

impl Request {
    /// The answer of one form at one centre; `None` at and past the form's own poles, and so close to one that the number
    /// cannot be held.
    pub fn value(&self, form: Form, c: DVec3) -> Option<f64> {
        let value = match self.precision {
            Precision::F64 => self.unit.from_length(form.error(&self.setting, c)?, self.setting.near),
            Precision::F32 => {
                let length = form.error_f32(&self.setting, c.as_vec3())?;
                let value = self.unit.from_length(f64::from(length), self.setting.near) as f32;
                f64::from(value)
            }
        };
        value.is_finite().then_some(value)
    }

    /// The values of a form over a grid, row by row (C_x varies fastest).
    pub fn surface(&self, form: Form, grid: &Grid) -> Vec<Option<f64>> {
        (0..grid.second.count)
            .into_par_iter()
            .flat_map_iter(|row| (0..grid.x.count).map(move |column| self.value(form, grid.center(column, row))))
            .collect()
    }
}

/// A value and where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extreme {
    /// The value.
    pub value: f64,
    /// The centre.
    pub center: DVec3,
}

/// What a column held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// The form.
    pub form: Form,
    /// Cells of the grid.
    pub cells: u64,
    /// Cells without a value.
    pub empty: u64,
    /// The least value; the first of equals. Absent where no cell has a value.
    pub least: Option<Extreme>,
    /// The greatest value.
    pub greatest: Option<Extreme>,
}

impl Summary {
    fn new(form: Form) -> Self {
        Self { form, cells: 0, empty: 0, least: None, greatest: None }
    }

    fn add(&mut self, value: Option<f64>, center: DVec3) {
        self.cells += 1;
        match value {
            Some(value) => self.reach(value, center),
            None => self.empty += 1,
        }
    }

    fn reach(&mut self, value: f64, center: DVec3) {
        // The negative zero is zero, here as in the CSV.
        let value = value + 0.0;
        if self.least.is_none_or(|least| value < least.value) {
            self.least = Some(Extreme { value, center });
        }
        if self.greatest.is_none_or(|greatest| value > greatest.value) {
            self.greatest = Some(Extreme { value, center });
        }
    }

    /// Takes in what comes after.
    fn append(&mut self, next: &Self) {
        self.cells += next.cells;
        self.empty += next.empty;
        for extreme in [next.least, next.greatest].into_iter().flatten() {
            self.reach(extreme.value, extreme.center);
        }
    }
}

/// Cells in a block, of which each thread has a few at a time: small enough for the caches, and all of them for a few
/// megabytes.
const BLOCK: u64 = 4096;

/// Writes a surface as CSV, a header and a row for every centre, C_x varying fastest; returns what each column held.
pub fn write_csv(
    request: &Request,
    grid: &Grid,
    out: &mut dyn Write,
    progress: &dyn Progress,
) -> io::Result<Vec<Summary>> {
    let mut header = String::from("cx,cy,cz");
    for form in &request.forms {
        header.push(',');
        header.push_str(form.name());
    }
    header.push('\n');
    out.write_all(header.as_bytes())?;

    let table = Table::new(request, grid);
    let cells = grid.cells();
    let at_once = 4 * rayon::current_num_threads();
    let mut summaries: Vec<Summary> = request.forms.iter().map(|&form| Summary::new(form)).collect();
    let (mut written, mut computed) = (vec![Block::default(); at_once], vec![Block::default(); at_once]);
    let mut start = 0;
    let mut ready = 0;
    while start < cells || ready > 0 {
        let blocks = (cells - start).div_ceil(BLOCK).min(at_once as u64) as usize;
        // This thread writes while the others compute.
        let wrote = rayon::in_place_scope(|scope| {
            scope.spawn(|_| {
                computed[..blocks].par_iter_mut().enumerate().for_each(|(n, block)| {
                    let first = start + n as u64 * BLOCK;
                    table.fill(first..(first + BLOCK).min(cells), block);
                });
            });
            written[..ready].iter().try_for_each(|block| out.write_all(&block.text))
        });
        wrote?;
        for block in &computed[..blocks] {
            summaries.iter_mut().zip(&block.summaries).for_each(|(all, part)| all.append(part));
        }
        start = (start + blocks as u64 * BLOCK).min(cells);
        ready = blocks;
        std::mem::swap(&mut written, &mut computed);
        progress.update(start, cells);
    }
    Ok(summaries)
}

/// Text and summary of consecutive cells.
#[derive(Clone, Default)]
struct Block {
    text: Vec<u8>,
    summaries: Vec<Summary>,
}

/// A grid whose coordinates are text already: there are far fewer of them than cells.
struct Table<'a> {
    request: &'a Request,
    grid: &'a Grid,
    /// By column: what stands before the row's part.
    columns: Vec<String>,
    /// By row: the rest of the coordinates.
    rows: Vec<String>,
}

impl<'a> Table<'a> {
    fn new(request: &'a Request, grid: &'a Grid) -> Self {
        let text = |value: f64| {
            let mut text = Vec::new();
            push_number(&mut text, request.precision, value);
            String::from_utf8(text).unwrap_or_default()
        };
        let (before, after) = match grid.plane {
            Plane::Xz { y } => (format!(",{},", text(y)), String::new()),
            Plane::Xy { z } => (",".to_string(), format!(",{}", text(z))),
        };
        let columns = grid.x.values().into_iter().map(|x| text(x) + &before).collect();
        let rows = grid.second.values().into_iter().map(|second| text(second) + &after).collect();
        Self { request, grid, columns, rows }
    }

    /// The cells of these flat indices.
    fn fill(&self, cells: std::ops::Range<u64>, block: &mut Block) {
        let forms = &self.request.forms;
        block.text.clear();
        block.summaries.clear();
        block.summaries.extend(forms.iter().map(|&form| Summary::new(form)));
        let width = u64::from(self.grid.x.count);
        for cell in cells {
            // Both are below their counts, which are u32.
            let (column, row) = ((cell % width) as u32, (cell / width) as u32);
            let center = self.grid.center(column, row);
            block.text.extend_from_slice(self.columns[column as usize].as_bytes());
            block.text.extend_from_slice(self.rows[row as usize].as_bytes());
            for (&form, summary) in forms.iter().zip(&mut block.summaries) {
                block.text.push(b',');
                let value = self.request.value(form, center);
                if let Some(value) = value {
                    push_number(&mut block.text, self.request.precision, value);
                }
                summary.add(value, center);
            }
            block.text.push(b'\n');
        }
    }
}

/// Appends a finite number with the shortest digits that read back exactly in its precision.
fn push_number(text: &mut Vec<u8>, precision: Precision, value: f64) {
    let mut buffer = zmij::Buffer::new();
    // Adding zero turns the negative zero into zero.
    let digits = match precision {
        Precision::F64 => buffer.format_finite(value + 0.0),
        Precision::F32 => buffer.format_finite(value as f32 + 0.0),
    };
    text.extend_from_slice(digits.strip_suffix(".0").unwrap_or(digits).as_bytes());
}
