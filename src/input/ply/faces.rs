//! The element `face` of a PLY file: lists of vertex indices, one face after the other.

use super::header::{Element, Format, Kind};
use crate::input::columns::{ReadError, quote};
use crate::input::scalar::Scalar;
use crate::input::source::Source;

/// What a list of vertex indices is called: by Turk's programs, and by others.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Bytes of binary faces read at once.
const BLOCK: usize = 1 << 18;

/// How the faces of a file are to be read.
pub(super) struct Faces<'a> {
    element: &'a Element,
    /// Number of the property that has the indices, and its types.
    indices: (usize, Scalar, Scalar),
    /// Number of vertices.
    vertices: u64,
}

impl<'a> Faces<'a> {
    pub(super) fn new(element: &'a Element, vertices: u64) -> Result<Self, ReadError> {
        let list = element.properties.iter().enumerate().find_map(|(i, property)| match property.kind {
            Kind::List(count, item) if INDICES.contains(&property.name.as_str()) => Some((i, count, item)),
            _ => None,
        });
        let Some(indices) = list else {
            let names: Vec<String> = element.properties.iter().map(|p| format!("`{}`", p.name)).collect();
            return Err(ReadError::content(format!(
                "element `{}` has no list `{}`; its properties: {}",
                element.name,
                INDICES.join("` or `"),
                if names.is_empty() { "none".to_owned() } else { names.join(", ") }
            )));
        };
        if indices.2.range().is_none() {
            return Err(ReadError::content(format!(
                "the vertex indices of element `{}` are floating-point numbers; allowed: an integer type",
                element.name
            )));
        }
        Ok(Self { element, indices, vertices })
    }

    /// Fewest bytes of a triangle.
    pub(super) fn smallest(&self, format: Format) -> u64 {
        match format {
            // `3 0 1 2` and what separates it from the next.
            Format::Ascii => 8,
            Format::Little | Format::Big => self.indices.1.size() as u64 + 3 * self.indices.2.size() as u64,
        }
    }

    /// Hands over the vertices of each face.
    pub(super) fn read(
        &self,
        source: &mut Source,
        format: Format,
        face: impl FnMut(&[u32]) -> Result<(), ReadError>,
    ) -> Result<(), ReadError> {
        match format {
            Format::Ascii => self.read_text(source, face),
            Format::Little => self.read_binary::<false>(source, face),
            Format::Big => self.read_binary::<true>(source, face),
        }
    }

    fn vertex(&self, index: f64, place: impl Fn() -> String) -> Result<u32, ReadError> {
        // Integers up to 2^32 - 1 are exact.
        if index >= 0.0 && index < self.vertices as f64 {
            return Ok(index as u32);
        }
        Err(ReadError::content(format!("{} asks for vertex {index}, and there are {}", place(), self.vertices)))
    }

    fn read_text(
        &self,
        source: &mut Source,
        mut face: impl FnMut(&[u32]) -> Result<(), ReadError>,
    ) -> Result<(), ReadError> {
        let mut corners = Vec::new();
        for index in 0..self.element.count {
            let line = source.data_line(self.element, index)?;
            let place = || format!("line {line}: face {index}");
            let mut fields = source.fields();
            corners.clear();
            for (i, property) in self.element.properties.iter().enumerate() {
                let wrong = |problem: String| {
                    ReadError::content(format!("line {line}, property `{}`: {problem}", property.name))
                };
                let mut number = |scalar: Scalar| {
                    let field = fields.next().ok_or_else(|| wrong("the line ends before it".to_owned()))?;
                    scalar.parse(field).map_err(wrong)
                };
                match property.kind {
                    Kind::Scalar(scalar) => {
                        number(scalar)?;
                    }
                    Kind::List(count, item) => {
                        // As many as there are fields: a count that lies ends at the end of the line.
                        for _ in 0..number(count)?.max(0.0) as u64 {
                            let value = number(item)?;
                            if i == self.indices.0 {
                                corners.push(self.vertex(value, place)?);
                            }
                        }
                    }
                }
            }
            if let Some(extra) = fields.next() {
                let extra = quote(extra);
                let message = format!("line {line}: {extra} follows the last of the properties that the header names");
                return Err(ReadError::content(message));
            }
            face(&corners)?;
        }
        Ok(())
    }

    fn read_binary<const BIG: bool>(
        &self,
        source: &mut Source,
        mut face: impl FnMut(&[u32]) -> Result<(), ReadError>,
    ) -> Result<(), ReadError> {
        let mut window = Window { source, bytes: vec![0; BLOCK], start: 0, end: 0 };
        let mut values = Vec::new();
        let mut corners = Vec::new();
        for index in 0..self.element.count {
            corners.clear();
            for (i, property) in self.element.properties.iter().enumerate() {
                let place = || format!("property `{}` of face {index} of {}", property.name, self.element.count);
                match property.kind {
                    Kind::Scalar(scalar) => {
                        window.take(scalar.size(), place)?;
                    }
                    Kind::List(count, item) => {
                        values.clear();
                        let start = window.byte();
                        count.decode::<BIG>(window.take(count.size(), place)?, count.size(), 0, &mut values);
                        let count = values.first().copied().unwrap_or_default();
                        if count < 0.0 {
                            let message = format!("byte {start}: {} has length {count}", place());
                            return Err(ReadError::content(message));
                        }
                        let bytes = (count as usize).saturating_mul(item.size());
                        let start = window.byte();
                        let bytes = window.take(bytes, place)?;
                        if i != self.indices.0 {
                            continue;
                        }
                        values.clear();
                        item.decode::<BIG>(bytes, item.size(), 0, &mut values);
                        for (k, &value) in values.iter().enumerate() {
                            let place = || format!("byte {}: face {index}", start + (k * item.size()) as u64);
                            corners.push(self.vertex(value, place)?);
                        }
                    }
                }
            }
            face(&corners)?;
        }
        Ok(())
    }
}

/// A stretch of a stream in memory, so that small pieces cost little.
struct Window<'a, 'b> {
    source: &'a mut Source<'b>,
    bytes: Vec<u8>,
    /// What has been read and not been taken.
    start: usize,
    end: usize,
}

impl Window<'_, '_> {
    /// Offset in the file of what is taken next.
    fn byte(&self) -> u64 {
        self.source.byte - (self.end - self.start) as u64
    }

    /// The next `count` bytes; `place` names what they are part of should the stream end.
    fn take(&mut self, count: usize, place: impl Fn() -> String) -> Result<&[u8], ReadError> {
        while self.end - self.start < count {
            self.bytes.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
            if self.end == self.bytes.len() {
                // Only as large as what has come so far, whatever the file says of its lists.
                self.bytes.resize(2 * self.bytes.len(), 0);
            }
            let read = self.source.read_some(&mut self.bytes[self.end..])?;
            if read == 0 {
                let byte = self.source.byte;
                return Err(ReadError::content(format!("byte {byte}: the file ends within {}", place())));
            }
            self.end += read;
        }
        let taken = self.start..self.start + count;
        self.start = taken.end;
        Ok(&self.bytes[taken])
    }
}
