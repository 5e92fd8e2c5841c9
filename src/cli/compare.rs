//! `compare`: how much two pictures, or two stereo pairs, differ.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::{print, print_json};
use crate::error::{Error, Result};
use crate::picture::read::Image;
use crate::picture::{output, read};
use crate::study::inconsistency::{self, Answer, Inconsistency};
use crate::study::metrics::{self, Difference, Scale};
use crate::study::plot::difference_map;

/// Measure the difference of two pictures, or of two stereo pairs.
///
/// Maximum, RMSE, PSNR and SSIM (of the luminance, 11 x 11 Gaussian window). Pictures of 8 and 16 bits are compared
/// encoded, 0..1; OpenEXR in linear light. Alpha is measured, but counts for nothing.
///
/// Of two pairs, left picture and left truth, right picture and right truth, also the left-right inconsistency: the right
/// eye's error minus the left eye's error at the same place in space, in linear light. Where that is, the right truth
/// must say: an OpenEXR file of `render --method reference --set render.method.reference.disparity=true`.
#[derive(Args, Debug)]
pub struct CompareArgs {
    /// A and B, compared with each other; for stereo pairs the left eye's, then A2 and B2, the right eye's
    #[arg(value_names = ["A", "B", "A2", "B2"], num_args = 2..=4, required = true)]
    pub pictures: Vec<PathBuf>,
    /// Exit with 1 if any sample differs by more than this (1 = full scale)
    #[arg(long, value_name = "X", value_parser = limit, allow_hyphen_values = true)]
    pub max: Option<f64>,
    /// Write where the pictures differ, with a colour bar: black = equal, pale yellow = the largest difference
    #[arg(long, value_name = "OUT.png")]
    pub heatmap: Option<PathBuf>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

fn limit(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "a number is needed".to_string())?;
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err("a number from 0 up is needed".into()) }
}

impl CompareArgs {
    /// Reads, compares, reports; 0, or 1 above the limit.
    pub fn run(&self) -> Result<u8> {
        let pairs: Vec<[&Path; 2]> = match &self.pictures[..] {
            [a, b] => vec![[a, b]],
            [a, b, a2, b2] => vec![[a, b], [a2, b2]],
            _ => return Err(Error::Usage("compare takes two pictures, A B, or two stereo pairs, A B A2 B2".into())),
        };
        let writer = self.heatmap.as_deref().map(output::writer_for).transpose()?;
        if self.json && self.heatmap.as_deref() == Some(Path::new("-")) {
            return Err(Error::Usage("`--json` and the heat map cannot both go to standard output".into()));
        }
        let images: Vec<[Image; 2]> =
            pairs.iter().map(|&[a, b]| Ok([read::read(a)?, read::read(b)?])).collect::<Result<_>>()?;
        let parts = pairs
            .iter()
            .zip(&images)
            .map(|([a, b], [first, second])| {
                metrics::compare(first, second).map_err(|e| match e {
                    // Four names may have been given: say which two.
                    Error::Usage(message) => Error::Usage(format!("{}, {}: {message}", a.display(), b.display())),
                    other => other,
                })
            })
            .collect::<Result<Vec<_>>>()?;
        let inconsistency = match &images[..] {
            [left, right] => inconsistency::inconsistency(
                [&left[0].picture, &left[1].picture],
                [&right[0].picture, &right[1].picture],
            )?,
            _ => Err("it needs two pairs: left picture, left truth, right picture, right truth".into()),
        };
        let (max, rmse, psnr, ssim) = metrics::pooled(&parts);
        if let (Some(path), Some(writer)) = (&self.heatmap, writer) {
            // The largest finite difference is the top of the scale: a single NaN must not turn the rest dark.
            let top = parts.iter().flat_map(|d| &d.map).filter(|v| v.is_finite()).fold(0.0_f32, |a, &v| a.max(v));
            // Where every difference is infinite any scale will do.
            let top = if top == 0.0 && max > 0.0 { 1.0 } else { f64::from(top) };
            output::write_picture(path, &difference_map::picture(&parts, top, unit(&parts))?, writer)?;
        }
        let exceeded = self.max.is_some_and(|limit| max > limit);
        if self.json {
            let views: Vec<Value> = parts.iter().zip(&pairs).map(|(d, pair)| view(d, pair)).collect();
            // Infinities and NaN become null.
            let report = json!({
                "max": max, "rmse": rmse, "psnr": psnr, "ssim": ssim,
                "equal": max == 0.0, "limit": self.max, "exceeded": exceeded, "views": views,
                "inconsistency": inconsistency.as_ref().ok().map(object), "inconsistency_why": inconsistency.err(),
            });
            print_json(&report)?;
        } else {
            let mut lines: Vec<String> = Vec::new();
            for (d, [a, b]) in parts.iter().zip(&pairs) {
                if parts.len() > 1 {
                    lines.push(format!("{} - {}", a.display(), b.display()));
                }
                lines.push(words(d));
            }
            if parts.len() > 1 {
                lines.push(format!("both\n  max {max:.6}  RMSE {rmse:.6}  PSNR {}  SSIM {ssim:.6}", decibels(psnr)));
                lines.push(sentence(&inconsistency));
            }
            if exceeded {
                lines.push(format!("the largest difference exceeds the limit {}", self.max.unwrap_or_default()));
            }
            let text = lines.join("\n") + "\n";
            if self.heatmap.as_deref() == Some(Path::new("-")) {
                // The verdict is the exit code's; a closed stderr does not change it.
                let _ = std::io::stderr().write_all(text.as_bytes());
            } else {
                print(&text)?;
            }
        }
        Ok(u8::from(exceeded))
    }
}

fn view(d: &Difference, [a, b]: &[&Path; 2]) -> Value {
    json!({
        "a": a.display().to_string(), "b": b.display().to_string(), "size": d.size, "scale": d.scale.name(),
        "max": d.max, "max_at": d.max_at, "max_channel": CHANNELS[d.max_channel],
        "rmse": d.rmse, "psnr": d.psnr, "ssim": d.ssim,
        "differing": d.differing, "not_finite": d.not_finite, "alpha_max": d.alpha_max,
    })
}

/// The inconsistency in JSON; `max_at` is a pixel of the right eye.
fn object(i: &Inconsistency) -> Value {
    json!({
        "scale": Scale::Linear.name(), "max": i.max_of_all(), "max_at": i.max_at, "max_channel": CHANNELS[i.max_channel],
        "rmse": i.rmse_of_all(), "max_of_channels": i.max, "rmse_of_channels": i.rmse,
        "pixels": i.pixels, "share": i.share, "not_finite": i.not_finite,
        "own_rmse": i.own_rmse, "left_out_max": i.left_out_max,
    })
}

/// The inconsistency in words, or why there is none.
fn sentence(answer: &Answer) -> String {
    let i = match answer {
        Ok(i) => i,
        Err(why) => return format!("left-right inconsistency\n  none: {why}"),
    };
    let ([x, y], [r, g, b]) = (i.max_at, i.rmse);
    let mut text = format!(
        "left-right inconsistency\n  linear light, {} pixels of the right eye ({:.1} %)\n  max {:.6} ({}, column {x}, \
         row {y})  RMSE {:.6} (red {r:.6}, green {g:.6}, blue {b:.6})\n  \
         the right eye's own RMSE there {:.6}; its largest error elsewhere {:.6}",
        i.pixels,
        100.0 * i.share,
        i.max_of_all(),
        CHANNELS[i.max_channel],
        i.rmse_of_all(),
        i.own_rmse,
        i.left_out_max
    );
    if i.not_finite > 0 {
        text += &format!("\n  {} samples beyond measure (NaN or infinite)", i.not_finite);
    }
    text
}

/// What the heat map's scale counts.
fn unit(parts: &[Difference]) -> &'static str {
    let all = |scale: Scale| parts.iter().all(|part| part.scale == scale);
    match (all(Scale::Encoded), all(Scale::Linear)) {
        (true, _) => "difference, encoded 0..1",
        (false, true) => "difference, linear light",
        (false, false) => "difference",
    }
}

const CHANNELS: [&str; 3] = ["red", "green", "blue"];

fn words(d: &Difference) -> String {
    let scale = match d.scale {
        Scale::Encoded => "encoded values, 0..1",
        Scale::Linear => "linear light",
    };
    let mut text = format!("  {} x {} pixels, {scale}\n", d.size[0], d.size[1]);
    if d.max == 0.0 {
        text += "  equal";
    } else {
        let ([x, y], channel) = (d.max_at, CHANNELS[d.max_channel]);
        text += &format!("  max {:.6} ({channel}, column {x}, row {y})", d.max);
    }
    text += &format!("  RMSE {:.6}  PSNR {}  SSIM {:.6}", d.rmse, decibels(d.psnr), d.ssim);
    text += &format!("\n  {} of {} samples differ", d.differing, 3 * d.map.len());
    if d.not_finite > 0 {
        text += &format!(", {} of them beyond measure (NaN or infinite)", d.not_finite);
    }
    if let Some(alpha) = d.alpha_max {
        text += &format!("; alpha by up to {alpha:.6}");
    }
    text
}

fn decibels(psnr: f64) -> String {
    if psnr == f64::INFINITY { "infinite".into() } else { format!("{psnr:.2} dB") }
}
