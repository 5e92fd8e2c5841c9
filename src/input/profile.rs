//! Radial kernel profiles from two-column CSV files.

use crate::{Error, Result};
use std::path::Path;

/// Reads q and density.
pub fn read_profile(path: &Path) -> Result<(Vec<f64>, Vec<f64>)> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::input(path, error.to_string()))?;
    let mut profile = (Vec::new(), Vec::new());
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').filter_map(|field| field.trim().parse().ok()).collect();
        let [q, density] = numbers[..] else {
            return Err(Error::input(path, "allowed: two numbers in a row"));
        };
        profile.0.push(q);
        profile.1.push(density);
    }
    Ok(profile)
}
