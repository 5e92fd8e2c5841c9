//! A surface as a plot.

use crate::error::{Error, Result};
use crate::study::error_surface::grid::{Grid, Plane, Range, Request};
use crate::study::error_surface::{Point, Quantity, Setting};
use crate::study::plot::{self, Axis, Surface};
use std::path::Path;

/// Most samples along an axis of a plot: more than the picture shows.
const PLOT_SAMPLES: u32 = 201;

/// The plot in the format of its file's extension.
pub fn encode(path: &Path, request: &Request, grid: &Grid) -> Result<Vec<u8>> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !plot::FORMATS.contains(&extension.as_str()) {
        let formats = plot::FORMATS.join(", .");
        return Err(Error::Usage(format!("--plot {}: the name must end in .{formats}", path.display())));
    }
    let grid = Grid { x: grid.x.at_most(PLOT_SAMPLES), second: grid.second.at_most(PLOT_SAMPLES), ..*grid };
    if grid.x.count < 2 || grid.second.count < 2 {
        return Err(Error::Usage("--plot: both coordinates that vary need at least two values".into()));
    }
    let Setting { quantity, component, alignments: [first, second], point, radius, near, interocular } =
        request.setting;
    let (second_axis, third) = match grid.plane {
        Plane::Xz { y } => ("C_z", format!("C_y = {y}")),
        Plane::Xy { z } => ("C_y", format!("C_z = {z}")),
    };
    let axis = |name: &str, range: Range| Axis { label: format!("{name} (scene units)"), values: range.values() };
    let value_label = match quantity {
        Quantity::Projection => format!("e_{} ({})", component.name(), request.unit.label()),
        Quantity::Parallax => format!("parallax error in {} ({})", component.name(), request.unit.label()),
    };
    let place = match Point::NAMED.iter().find(|(_, named)| *named == point) {
        Some((name, _)) => (*name).to_string(),
        None => format!("point ({}, {})", point.a, point.b),
    };
    let eyes = match quantity {
        Quantity::Projection => String::new(),
        Quantity::Parallax => format!(", I = {interocular}"),
    };
    let title = format!(
        "{} error in {}, {} against {}: {place}, {third}, r = {radius}, N = {near}{eyes}",
        match quantity {
            Quantity::Projection => "Projection",
            Quantity::Parallax => "Parallax",
        },
        component.name(),
        first.name(),
        second.name(),
    );
    let surfaces: Vec<Surface> = request
        .forms
        .iter()
        .map(|&form| Surface {
            title: form.name().to_string(),
            x: axis("C_x", grid.x),
            y: axis(second_axis, grid.second),
            value_label: value_label.clone(),
            values: request.surface(form, &grid),
        })
        .collect();
    plot::surfaces(&title, &surfaces).encode(&extension).map_err(|message| Error::output(path, message))
}
