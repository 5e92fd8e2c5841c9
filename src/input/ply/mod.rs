//! PLY files, in ascii, binary_little_endian and binary_big_endian (G. Turk, *The PLY Polygon File Format*, 1994):
//! particles from the scalar properties of the element `vertex`, and meshes from the elements `vertex` and `face`.
//!
//! Comments, `obj_info`, list properties and other elements are skipped. Text is read strictly, one element on one
//! line. Colours of type uchar are sRGB-encoded, of other types linear light.
//!
//! Why an own reader: a file of 10^7 particles has to be read column by column into bounded memory, with the columns
//! chosen at run time. `serde-ply` has a fast path only for fields named at compile time and otherwise hands over every
//! value with its property's name; `ply-rs-bw` hands over every value by name too, into one object per element.
//! Neither compares the counts that a header claims with the size of the file, and neither says at which byte the
//! binary data are wrong. Here a block of elements is read at once and each wanted property is decoded by its stride.

mod faces;
mod header;
mod mesh;
mod rows;
mod splat;

pub use mesh::read as read_mesh;

use super::columns::{Column, Columns, ReadError, Selection};
use super::scalar::Scalar;
use super::source::Source;
use header::Header;
use rows::{make_room, read_rows};
use splat::Splats;
use std::io::BufRead;

/// Names that mean colour in a PLY file.
pub const COLORS: &[[&str; 3]] = &[["red", "green", "blue"], ["r", "g", "b"]];

/// Whether a file that begins like this is a PLY file.
pub fn detect(head: &[u8]) -> bool {
    head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
}

/// Whether a file that begins like this, with all of its header, is a PLY file that holds faces and so can be a mesh.
pub fn has_faces(head: &[u8]) -> bool {
    let mut input = head;
    let is_face = |element: &header::Element| element.name == mesh::FACE && element.count > 0;
    detect(head) && Header::read(&mut Source::new(&mut input)).is_ok_and(|header| header.elements.iter().any(is_face))
}

/// Reads the wanted scalar properties of the element `vertex` as particles. Gaussian splats have the columns `radius`,
/// `opacity`, `r`, `g` and `b` as well, derived from those of the file.
///
/// `size` is the number of bytes of the whole file, if known: counts that cannot fit are then refused before anything
/// is allocated. Errors name the line of header and text, the byte offset of binary data.
pub fn read(reader: &mut dyn BufRead, size: Option<u64>, selection: &Selection) -> Result<Columns, ReadError> {
    let mut source = Source::new(reader);
    let header = Header::read(&mut source)?;
    header.check_size(source.byte, size)?;
    let (before, vertex) = header.vertex()?;
    splat::refuse_packed(vertex)?;
    splat::refuse_flat(vertex)?;
    let checked = size.is_some();
    let mut splats = if splat::is_splat(vertex) { Some(Splats::new(vertex, selection, checked)?) } else { None };
    let mut columns = Vec::new();
    for (name, scalar) in vertex.scalars() {
        let kept = selection.wants(name) && !(splats.is_some() && splat::hides(name));
        if !kept && !splats.as_ref().is_some_and(|splats| splats.needs(name)) {
            continue;
        }
        let mut column = Column { name: name.to_owned(), values: Vec::new(), byte: scalar == Scalar::U8 };
        if kept {
            make_room(vertex, &mut column, checked)?;
        }
        columns.push(column);
        if let Some(splats) = &mut splats {
            splats.push(kept);
        }
    }
    before.iter().try_for_each(|element| element.skip(&mut source, header.format))?;
    read_rows(vertex, header.format, &mut source, &mut columns, selection.is_lenient(), &mut |columns, rows| {
        splats.as_mut().map_or(Ok(()), |splats| splats.block(columns, rows))
    })?;
    let count = vertex.count as usize;
    match splats {
        None => Columns::new(columns, vertex.scalars().map(|(name, _)| name.to_owned()).collect(), count, COLORS),
        Some(splats) => {
            let (columns, names, note) = splats.finish(columns, vertex);
            let mut columns = Columns::new(columns, names, count, splat::COLORS)?;
            columns.notes.extend(note);
            Ok(columns)
        }
    }
}
