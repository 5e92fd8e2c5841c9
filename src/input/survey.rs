//! What is in a file of particles or a volume: every column with its range and its histogram.
//!
//! A file may have a hundred columns, so they are read a few at a time: the file is read again for the next ones.

use super::columns::{Cells, Columns, Selection};
use super::{VolumeOptions, read_columns};
use crate::error::Result;
use crate::render::Progress;
use std::path::Path;

/// Bars of a histogram.
pub const BINS: usize = 48;

/// Values that are held at once: 256 MB.
const VALUES_AT_ONCE: usize = 1 << 25;

/// What is in a file.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Number of rows: particles, or the cells of a volume.
    pub rows: usize,
    /// Every column, in file order.
    pub columns: Vec<ColumnSummary>,
    /// Set for a volume.
    pub cells: Option<Cells>,
    /// What the reader leaves out or is surprising, a sentence each.
    pub notes: Vec<String>,
}

/// The values of a column in short.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnSummary {
    /// The file's name of the column.
    pub name: String,
    /// Number of finite numbers.
    pub count: usize,
    /// Number of values that are no finite number: text, not a number, infinite.
    pub missing: usize,
    /// Smallest of the finite numbers; NaN if there is none.
    pub min: f64,
    /// Largest of the finite numbers; NaN if there is none.
    pub max: f64,
    /// Mean of the finite numbers; NaN if there is none.
    pub mean: f64,
    /// How many values are in each of [`BINS`] equal parts of [min, max].
    pub histogram: [u64; BINS],
}

impl ColumnSummary {
    /// The summary of values of which those that are not finite do not count.
    pub fn new(name: &str, values: &[f64]) -> Self {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let count = finite().count();
        let [min, max] = finite().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        let mut histogram = [0; BINS];
        // Halved, so that the difference of large numbers is finite.
        let half_range = 0.5 * max - 0.5 * min;
        for value in finite() {
            let t = if half_range > 0.0 { (0.5 * value - 0.5 * min) / half_range } else { 0.5 };
            histogram[((t * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        // Each divided first: the sum of large numbers would overflow.
        let mean = finite().map(|value| value / count as f64).sum::<f64>();
        let or_nan = |value: f64| if count > 0 { value } else { f64::NAN };
        Self {
            name: name.to_owned(),
            count,
            missing: values.len() - count,
            min: or_nan(min),
            max: or_nan(max),
            mean: or_nan(mean.clamp(min.min(max), max.max(min))),
            histogram,
        }
    }
}

/// Reads a file of particles or a volume, every column of it.
///
/// # Errors
/// As [`read_columns`]; values that are no finite number are counted, not refused.
pub fn survey(path: &Path, volume: &VolumeOptions, progress: &dyn Progress) -> Result<Survey> {
    let read = |names: &[String]| read_columns(path, &Selection::Survey(names.to_vec()), volume, progress);
    // The first pass tells what there is; of a volume it brings the densities along.
    let first: Columns = read(&[])?;
    let mut columns = Vec::with_capacity(first.names().len());
    let at_once = (VALUES_AT_ONCE / first.len().max(1)).max(1);
    for names in first.names().chunks(at_once) {
        let read = read(names)?;
        for name in names {
            columns.extend(read.get(name).map(|column| ColumnSummary::new(name, &column.values)));
        }
    }
    Ok(Survey { rows: first.len(), columns, cells: first.cells, notes: first.notes })
}
