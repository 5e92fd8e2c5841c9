//! `compose`: a stereo picture from two pictures that exist already.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use serde_json::json;

use super::print_json;
use crate::error::{Error, Result};
use crate::picture::dubois::{self, MATRICES, Space};
use crate::picture::output::{self, WRITERS};
use crate::picture::packing::{self, Options, PACKINGS};
use crate::picture::read;

/// Make a stereo picture from a left and a right one.
///
/// Pictures are read as PNG (8 or 16 bit), JPEG or OpenEXR, whatever their names. Integers are sRGB-encoded, OpenEXR is
/// linear light.
#[derive(Args, Debug)]
pub struct ComposeArgs {
    /// The left eye's picture
    pub left: PathBuf,
    /// The right eye's picture, of the same size
    pub right: PathBuf,
    /// The file to write; `-` is standard output
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Stereo format
    #[arg(long, default_value = "anaglyph", value_parser = names(PACKINGS.iter().map(|p| (p.name, p.help))))]
    pub format: String,
    /// Weights of the anaglyph
    #[arg(long, default_value = MATRICES[0].name, value_parser = names(MATRICES.iter().map(|m| (m.name, m.help))))]
    pub matrix: String,
    /// What the weights are applied to
    #[arg(long, default_value = Space::ALL[0].name(), value_parser = names(Space::ALL.iter().map(|s| (s.name(), s.help()))))]
    pub space: String,
    /// Image format [default: by the extension of OUT]
    #[arg(long, value_parser = names(WRITERS.iter().map(|w| (w.name, w.help))))]
    pub image: Option<String>,
    /// Print one JSON object about the result and nothing else
    #[arg(long)]
    pub json: bool,
}

/// The names of a table as an option's values, with their help.
fn names(rows: impl Iterator<Item = (&'static str, &'static str)>) -> PossibleValuesParser {
    PossibleValuesParser::new(rows.map(|(name, help)| PossibleValue::new(name).help(help)))
}

impl ComposeArgs {
    /// Reads, packs, writes; says on stderr how much an anaglyph lost to clipping. 0, or the error.
    pub fn run(&self) -> Result<u8> {
        if self.json && self.output.as_os_str() == "-" {
            return Err(Error::Usage("`--json` and the picture cannot both go to standard output".into()));
        }
        // All that can be wrong with the request is found before the pictures are read.
        let writer = match &self.image {
            Some(name) => output::writer(name)?,
            None => output::writer_for(&self.output)?,
        };
        let packing = packing::packing(&self.format)?;
        let options = Options { matrix: dubois::matrix(&self.matrix)?, space: Space::named(&self.space)? };
        let left = read::read(&self.left)?.picture;
        let right = read::read(&self.right)?.picture;
        let packed = (packing.pack)(&left, &right, &options)?;
        output::write_picture(&self.output, &packed.picture, writer)?;

        let samples = 3 * packed.picture.pixels() as u64;
        let percent = 100.0 * packed.clipped as f64 / samples as f64;
        if self.json {
            print_json(&json!({
                "file": self.output.display().to_string(),
                "format": packing.name,
                "image": writer.name,
                "size": packed.picture.size,
                "matrix": self.matrix,
                "space": self.space,
                "samples": samples,
                "clipped": packed.clipped,
            }))?;
        } else if packed.clipped > 0 {
            // Only a file of floats keeps what lies outside.
            let fate = if writer.extension == "exr" { "lie outside 0..1" } else { "were out of gamut and clipped" };
            // A closed stderr is no reason to fail: the picture is written.
            let _ = writeln!(std::io::stderr(), "{} of {samples} samples ({percent:.2} %) {fate}", packed.clipped);
        }
        Ok(0)
    }
}
