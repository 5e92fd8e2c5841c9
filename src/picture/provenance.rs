//! Provenance: the JSON object that lies beside the pictures and says how they came about.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::Value;

/// The object; keys in this order, each present even when empty, so that a program can rely on them.
#[derive(Clone, Debug, Serialize)]
pub struct Provenance {
    /// Name and version of what took part, this program first.
    #[serde(serialize_with = "as_map")]
    pub versions: Vec<(String, String)>,
    /// Every setting as it was used, defaults included.
    pub settings: Value,
    /// What rendered, in words.
    pub device: String,
    /// What was done and why, in words, one sentence each.
    pub plan: Vec<String>,
    /// The views, left eye first.
    pub views: Vec<View>,
    /// Wall-clock time by stage in milliseconds, in the order of the work.
    #[serde(serialize_with = "as_map")]
    pub timings_ms: Vec<(String, f64)>,
    /// The picture files written.
    pub pictures: Vec<PictureFile>,
    /// How far the pictures were found to be off, where that was asked for; an object or null.
    pub verification: Value,
    /// What the user should know about this run, one sentence each.
    pub notes: Vec<String>,
}

/// One view.
#[derive(Clone, Debug, Serialize)]
pub struct View {
    /// `left`, `right` or `mono`.
    pub name: String,
    /// Position of the eye in world space, scene units.
    pub eye: [f64; 3],
    /// Anything more about the view; an object or null.
    pub details: Value,
}

/// One picture file.
#[derive(Clone, Debug, Serialize)]
pub struct PictureFile {
    /// The file, as the user named it.
    pub file: String,
    /// Its stereo format: a packing's name, or `mono`.
    pub format: String,
    /// Its image format: a writer's name.
    pub image: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Samples (of 3 per pixel) that mixing put outside [0, 1].
    pub clipped: u64,
}

impl Provenance {
    /// An empty record with this program's version.
    pub fn new() -> Self {
        Self {
            versions: vec![(env!("CARGO_PKG_NAME").into(), env!("CARGO_PKG_VERSION").into())],
            settings: Value::Null,
            device: String::new(),
            plan: Vec::new(),
            views: Vec::new(),
            timings_ms: Vec::new(),
            pictures: Vec::new(),
            verification: Value::Null,
            notes: Vec::new(),
        }
    }

    /// The object as indented JSON with a line feed at the end. Numbers that are not finite become null.
    pub fn to_json(&self) -> String {
        // Every key is a string and every value plain data, so serialising cannot fail; should a later field change
        // that, the file says so instead of the program falling over after the pictures are made.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_else(|e| Value::String(e.to_string()).to_string());
        text.push('\n');
        text
    }
}

impl Default for Provenance {
    fn default() -> Self {
        Self::new()
    }
}

/// Pairs as one object in their own order.
fn as_map<S: Serializer, V: Serialize>(pairs: &[(String, V)], serializer: S) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(pairs.len()))?;
    for (key, value) in pairs {
        map.serialize_entry(key, value)?;
    }
    map.end()
}
