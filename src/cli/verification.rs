//! What `render --verify` asks and says.

use crate::error::{Error, Result};
use crate::render::Method;
use crate::scene::Eye;
use crate::study::verify::{Deviation, Sample, Verification};
use serde_json::{Value, json};
use std::num::NonZeroU64;

/// The pixels that a word of the command line asks for.
pub fn parse(text: &str) -> Result<Sample> {
    match text {
        "all" => Ok(Sample::All),
        _ => text.parse::<NonZeroU64>().map(Sample::Pixels).map_err(|_| {
            Error::Usage(format!(
                "--verify {text}: allowed: a whole number of pixels per eye from 1 up, all, or nothing for 4096"
            ))
        }),
    }
}

/// Whether the method that was asked for promises to keep the tolerance; the others bound their early ends alone.
fn promises(method: Method) -> bool {
    match method {
        Method::Auto | Method::Reference(_) => true,
        Method::Viewplane
        | Method::Viewpoint
        | Method::Perspective
        | Method::Spherical(_)
        | Method::Sheet(_)
        | Method::Slab(_) => false,
    }
}

const CHANNELS: [&str; 4] = ["red", "green", "blue", "transmittance"];

/// The verdict in one line. `method` is the one that was asked for.
pub fn sentence(found: &Verification, method: Method, eyes: &[Eye]) -> String {
    let (error, tolerance) = (figure(found.largest.error), figure(found.tolerance));
    let each = if eyes.len() > 1 { " per eye" } else { "" };
    let pixels = format!("{}{} pixels{each}", if found.all { "all " } else { "" }, found.pixels);
    let held = found.held();
    let beyond = figure(found.largest.error - found.tolerance);
    let verdict = match (held, promises(method)) {
        (true, true) => format!("largest error {error} of {pixels}, within the tolerance {tolerance}"),
        (true, false) => format!(
            "method {} promises no error; its largest of {pixels} is {error}, within the tolerance {tolerance}",
            method.name()
        ),
        (false, true) => {
            format!("error {error} {}; {beyond} beyond the tolerance {tolerance}; {pixels}", place(found, eyes))
        }
        (false, false) => format!(
            "method {} promises no error; it is {beyond} beyond the tolerance {tolerance}: error {error} {}; {pixels}",
            method.name(),
            place(found, eyes)
        ),
    };
    format!(
        "{}: {verdict} (the truth is known to {}; the transmittance is off by up to {})",
        if held { "verified" } else { "not held" },
        figure(found.reference_bound),
        figure(found.transmittance.error)
    )
}

/// Where the largest error is, and what it is between.
fn place(found: &Verification, eyes: &[Eye]) -> String {
    let Deviation { view, pixel: [column, row], channel, drawn, truth, .. } = found.largest;
    let eye = match eyes.get(view) {
        Some(eye @ (Eye::Left | Eye::Right)) => format!("{} eye, ", eye.name()),
        Some(Eye::Mono) | None => String::new(),
    };
    let channel = CHANNELS.get(channel).copied().unwrap_or_default();
    format!("at {eye}column {column}, row {row}, {channel}: {drawn:.6} instead of {truth:.6}")
}

/// Three digits that count.
fn figure(value: f64) -> String {
    if value.is_infinite() {
        return "infinite".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let places = 2 - value.abs().log10().floor() as i32;
    // Of 1e-9, zeros would hide the digits.
    if places > 6 { format!("{value:.1e}") } else { format!("{value:.*}", places.max(0) as usize) }
}

/// The same for the record.
pub fn object(found: &Verification, method: Method, eyes: &[Eye]) -> Value {
    let at = |deviation: &Deviation| {
        let [column, row] = deviation.pixel;
        json!({
            "eye": eyes.get(deviation.view).map(|eye| eye.name()), "column": column, "row": row,
            "channel": CHANNELS.get(deviation.channel), "drawn": deviation.drawn, "truth": deviation.truth,
        })
    };
    json!({
        "pixels": found.pixels, "all": found.all,
        "largest": found.largest.error, "where": at(&found.largest),
        "rmse": found.rmse, "quantile_99": found.quantile_99,
        "tolerance": found.tolerance, "held": found.held(), "promised": promises(method),
        "transmittance": { "largest": found.transmittance.error, "where": at(&found.transmittance) },
        "reference_bound": found.reference_bound, "predicted_error": found.predicted_error,
        "seconds": found.time.as_secs_f64(),
    })
}
