//! The chart as a picture.

use super::candidates::methods;
use super::table::{Row, on_front};
use crate::study::plot::Drawing;
use crate::study::plot::scatter::{Point, Scatter, scatter};

/// Median time against RMSE of rows of one scene, a kind of marker for each method, the same in every chart.
pub fn draw(title: &str, subtitle: &str, rows: &[Row]) -> Drawing {
    let kinds = methods();
    let points = rows.iter().zip(on_front(rows)).filter_map(|(row, front)| {
        let kind = kinds.iter().position(|name| *name == row.method)?;
        Some(Point { kind, x: row.median_ms, y: row.rmse, label: format!("{} {}", row.method, row.value), front })
    });
    scatter(&Scatter {
        title: title.into(),
        subtitle: subtitle.into(),
        x_label: "median time of a frame of all views (ms)".into(),
        y_label: "RMSE against the reference (linear light)".into(),
        points: points.collect(),
        kinds: kinds.iter().map(|&name| name.into()).collect(),
    })
}
