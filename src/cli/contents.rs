//! What `scene` says of a file of particles, a volume or a mesh: columns with ranges and histograms, extent, count.

use super::progress::Bar;
use super::{print, print_json};
use crate::error::Result;
use crate::input::mesh::{MeshEntry, load_mesh_noting};
use crate::input::survey::{ColumnSummary, Survey, survey};
use crate::input::{MeshReader, Reader, VolumeOptions};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;

/// Bars of a histogram by height, nothing first.
const BARS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Prints what is in a file of particles or a volume; returns the exit code.
pub fn particles(path: &Path, reader: &Reader, volume: &VolumeOptions, as_json: bool, bar: Bar) -> Result<u8> {
    let found = survey(path, volume, &bar)?;
    drop(bar);
    if as_json {
        let columns: Vec<Value> = found
            .columns
            .iter()
            .map(|column| {
                json!({
                    "name": column.name,
                    "count": column.count,
                    "missing": column.missing,
                    "min": column.min,
                    "max": column.max,
                    "mean": column.mean,
                    "histogram": column.histogram.to_vec(),
                })
            })
            .collect();
        let cells = found.cells.as_ref().map(|cells| json!({ "density": cells.density, "volume": cells.volume }));
        print_json(&json!({
            "file": path.display().to_string(),
            "format": reader.name,
            "particles": found.rows,
            "columns": columns,
            "extent": extent(&found),
            "cells": cells,
            "notes": found.notes,
        }))?;
    } else {
        print(&text(path, reader, &found))?;
    }
    Ok(0)
}

/// Extent along x, y and z, of those that the file has.
fn extent(found: &Survey) -> Option<[f64; 3]> {
    let size = |name: &str| {
        found.columns.iter().find(|column| column.name == name).filter(|c| c.count > 0).map(|c| c.max - c.min)
    };
    Some([size("x")?, size("y")?, size("z")?])
}

fn text(path: &Path, reader: &Reader, found: &Survey) -> String {
    let what = if found.cells.is_some() { "cells" } else { "particles" };
    let mut text = format!("{}: {}, {} {what}", path.display(), reader.name, found.rows);
    if let Some(cells) = &found.cells {
        text += &format!(" of volume {} with the density in `{}`", short(cells.volume), cells.density);
    }
    if let Some([x, y, z]) = extent(found) {
        text += &format!(", extent {} x {} x {}", short(x), short(y), short(z));
    }
    text += "\n";
    let heads = ["column", "min", "mean", "max"];
    let rows: Vec<[String; 4]> = found
        .columns
        .iter()
        .map(|column| [column.name.clone(), short(column.min), short(column.mean), short(column.max)])
        .collect();
    let width =
        |i: usize| rows.iter().map(|row| row[i].chars().count()).chain([heads[i].len()]).max().unwrap_or_default();
    let [name, min, mean, max] = [0, 1, 2, 3].map(width);
    if !rows.is_empty() {
        let [h0, h1, h2, h3] = heads;
        text += &format!("  {h0:name$}  {h1:>min$}  {h2:>mean$}  {h3:>max$}  histogram from min to max\n");
    }
    for ([c0, c1, c2, c3], column) in rows.iter().zip(&found.columns) {
        let bars = histogram(column);
        let missing = match column.missing {
            0 => String::new(),
            missing if column.count == 0 => format!("  no numbers ({missing} values)"),
            missing => format!("  {missing} values are no finite number"),
        };
        text += &format!("  {c0:name$}  {c1:>min$}  {c2:>mean$}  {c3:>max$}  |{bars}|{missing}\n");
    }
    for note in &found.notes {
        text += &format!("note: {note}\n");
    }
    text + &what_next(path, found)
}

/// How to go on, where that is known to work.
fn what_next(path: &Path, found: &Survey) -> String {
    let places: Vec<&ColumnSummary> =
        found.columns.iter().filter(|column| ["x", "y", "z"].contains(&column.name.as_str())).collect();
    if found.rows == 0 {
        return "There is nothing to render.\n".into();
    }
    match places.iter().find(|column| column.missing > 0) {
        Some(column) => format!("It cannot be rendered: `{}` has values that are no finite number.\n", column.name),
        None => commands(path),
    }
}

/// The commands for a file, so that they can be pasted.
fn commands(path: &Path) -> String {
    let path = path.display().to_string();
    let plain = path.chars().all(|c| c.is_alphanumeric() || "/._-+,:@%".contains(c));
    let shown = if plain { path } else { format!("'{}'", path.replace('\'', "'\\''")) };
    format!("Render it: stereomist render {shown}; a scene to change: stereomist scene {shown} --init\n")
}

/// A bar for each bin, as high as its share of the fullest; a bin that holds anything shows something.
fn histogram(column: &ColumnSummary) -> String {
    let fullest = column.histogram.iter().copied().max().unwrap_or_default().max(1);
    let height = |&count: &u64| {
        let top = BARS.len() as u64 - 1;
        BARS[(u128::from(count) * u128::from(top)).div_ceil(u128::from(fullest)) as usize]
    };
    column.histogram.iter().map(height).collect()
}

/// A number of at most six significant digits.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    let magnitude = value.abs();
    if magnitude != 0.0 && !(1e-4..1e7).contains(&magnitude) {
        return format!("{value:.4e}");
    }
    let before = if magnitude >= 1.0 { magnitude.log10().floor() as usize + 1 } else { 1 };
    let text = format!("{value:.*}", 6usize.saturating_sub(before));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Prints what is in a mesh; returns the exit code.
pub fn mesh(path: &Path, reader: &MeshReader, as_json: bool) -> Result<u8> {
    let mut notes = Vec::new();
    let mesh = load_mesh_noting(&MeshEntry::new(path), &mut notes)?;
    let box_around = mesh
        .positions
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)));
    let (low, high) = if mesh.positions.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { box_around };
    if as_json {
        return print_json(&json!({
            "file": path.display().to_string(),
            "format": reader.name,
            "vertices": mesh.positions.len(),
            "triangles": mesh.corners.len(),
            "materials": mesh.materials.len(),
            "textures": mesh.textures.iter().map(|texture| [texture.width, texture.height]).collect::<Vec<_>>(),
            "min": low.to_array(),
            "max": high.to_array(),
            "notes": notes,
        }))
        .map(|()| 0);
    }
    let mut text = format!(
        "{}: {}, {} triangles, {} vertices, {} materials\n",
        path.display(),
        reader.name,
        mesh.corners.len(),
        mesh.positions.len(),
        mesh.materials.len()
    );
    for (axis, (low, high)) in ["x", "y", "z"].iter().zip(low.to_array().into_iter().zip(high.to_array())) {
        text += &format!("  {axis} {} to {}\n", short(low), short(high));
    }
    for texture in &mesh.textures {
        text += &format!("  texture {}x{}\n", texture.width, texture.height);
    }
    for note in &notes {
        text += &format!("note: {note}\n");
    }
    text += &commands(path);
    print(&text)?;
    Ok(0)
}
