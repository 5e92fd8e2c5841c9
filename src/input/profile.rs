//! Radial profiles of table kernels from two-column text.

use super::columns::ReadError;
use super::csv::Rows;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Reads a radial profile: q (distance over radius, strictly ascending from 0 to 1) and density (finite, >= 0, not
/// all zero, any unit) of each row, at least two rows.
///
/// Comma-separated, with or without a header line; `#` comments and blank lines are skipped. Errors name the line.
pub fn read_profile(path: &Path) -> Result<(Vec<f64>, Vec<f64>)> {
    let file = File::open(path).map_err(|error| Error::input(path, format!("cannot open: {error}")))?;
    parse(&mut BufReader::new(file)).map_err(|error| Error::input(path, error.to_string()))
}

fn parse(reader: &mut dyn BufRead) -> Result<(Vec<f64>, Vec<f64>), ReadError> {
    const NAMES: [&str; 2] = ["q", "density"];
    let (mut q, mut density) = (Vec::new(), Vec::new());
    let mut rows = Rows::new(reader);
    let (mut first, mut line) = (true, 0);
    while rows.advance()? {
        rows.expect_fields(2, "a profile has")?;
        let (radius, value) = (rows.number(0, NAMES[0]), rows.number(1, NAMES[1]));
        // A header has no number at all; one number beside a word is a mistake.
        let header = std::mem::take(&mut first) && radius.is_err() && value.is_err();
        if header {
            continue;
        }
        let (radius, value) = (radius?, value?);
        line = rows.line();
        let problem = |message: String| Err(ReadError::content(format!("line {line}, column {message}")));
        match q.last() {
            None if radius != 0.0 => return problem(format!("`q`: the first q is {radius}; allowed: 0")),
            Some(&last) if radius <= last => {
                return problem(format!("`q`: {radius} after {last}; allowed: strictly ascending"));
            }
            _ if radius > 1.0 => return problem(format!("`q`: {radius}; allowed: 0 to 1")),
            _ => {}
        }
        if value < 0.0 {
            return problem(format!("`density`: {value}; allowed: 0 or more"));
        }
        q.push(radius);
        density.push(value);
    }
    if q.len() < 2 {
        return Err(ReadError::content(format!("{} rows of numbers; a profile has at least 2", q.len())));
    }
    match q.last() {
        Some(&last) if last != 1.0 => {
            Err(ReadError::content(format!("line {line}, column `q`: the last q is {last}; allowed: 1")))
        }
        _ if density.iter().all(|&value| value == 0.0) => Err(ReadError::content("every density is 0")),
        _ => Ok((q, density)),
    }
}
