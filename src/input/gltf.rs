//! glTF 2.0: `.gltf` with buffers and pictures beside it or within it, and `.glb`.
//!
//! The `gltf` crate gives the document's structure; the bytes behind it are read here, because the crate's own readers
//! trust the document and panic where it lies (an accessor past its buffer, an index out of range). Every index into
//! the document, every byte range and every vertex index is checked before it is used, and what a file may grow to is
//! bounded, so that a damaged or hostile file ends in one error.
//!
//! What is taken: the default scene's triangles with normals, base colours, base colour textures, vertex colours and
//! `KHR_materials_unlit`. What has no counterpart in [`Mesh`] (lines, transparency, skins, ...) is noted.

use super::file::read_file;
use super::mesh::{Budget, Outcome, VERTEX_BYTES};
use super::texture::{MOST_TEXELS, decode};
use crate::error::{Error, Result};
use crate::scene::Rgb;
use crate::scene::mesh::{Material, Mesh, Texture, Wrap};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use gltf::json;
use json::accessor::{ComponentType, Type};
use json::mesh::{Mode, Semantic};
use json::texture::WrappingMode;
use json::validation::{Checked, USize64};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Extensions that a file may require.
const EXTENSIONS: &[&str] = &["KHR_materials_unlit", "KHR_texture_transform"];

/// Most bytes in all buffers of a file together: many buffers can name one file.
const BUFFER_BYTES: u64 = 1 << 30;

/// Bytes of a triangle in [`Mesh`], with its indices as they are read.
const TRIANGLE_BYTES: u64 = 12 + 4 + 12;

/// Largest JSON part, bytes. It may carry the buffers as text.
const LARGEST_JSON: usize = 1 << 28;

/// Most objects and most list entries in the JSON part. Two characters of text can become hundreds of bytes in memory.
const MOST_OBJECTS: usize = 1 << 19;
const MOST_ENTRIES: usize = 1 << 23;

/// Extensions that pack vertices so that they cannot be read without them. A file that only uses them, with plain data
/// for those who lack them, is read.
const PACKING: &[&str] =
    &["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization"];

/// Reads the default scene (else the first, else all root nodes) of a glTF file. `color` is the linear-light colour of
/// triangles that have neither a material nor vertex colours. What is left out is appended to `notes`.
///
/// # Errors
/// [`Error::Input`], naming the file and what in it cannot be read or understood.
pub fn read(path: &Path, color: Rgb, notes: &mut Vec<String>) -> Result<Mesh> {
    read_document(path, color, notes).map_err(|message| Error::input(path, message))
}

fn read_document(path: &Path, color: Rgb, notes: &mut Vec<String>) -> Outcome<Mesh> {
    let bytes = read_file(path, u64::MAX)?;
    let (text, blob) = split(&bytes)?;
    if text.len() > LARGEST_JSON {
        return Err(format!("its JSON is {} bytes long; allowed: {LARGEST_JSON}", text.len()));
    }
    // Data URIs in base64 have neither character, so that they do not count.
    for (sign, what, most) in [(b'{', "objects", MOST_OBJECTS), (b',', "entries", MOST_ENTRIES)] {
        let count = text.iter().filter(|&&byte| byte == sign).count();
        if count > most {
            return Err(format!("its JSON has about {count} {what}; allowed: {most}"));
        }
    }
    let packing = refuse_extensions(text)?;
    // Where such a file cannot be read, that is probably why.
    read_scene(path, text, blob, color, &packing, notes).map_err(|message| {
        if packing.is_empty() {
            return message;
        }
        format!("{message}. It uses {}, which is not supported. {PLAIN}", packing.join(", "))
    })
}

/// Reads the JSON text and the binary chunk; `packing` are the extensions of [`PACKING`] that are used.
fn read_scene(
    path: &Path,
    text: &[u8],
    blob: Option<&[u8]>,
    color: Rgb,
    packing: &[String],
    notes: &mut Vec<String>,
) -> Outcome<Mesh> {
    let root: json::Root = json::deserialize::from_slice(text).map_err(|e| format!("not valid glTF JSON: {e}"))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let buffers = load_buffers(&root, blob, folder)?;
    let buffer_bytes: u64 = buffers.iter().map(|b| b.len() as u64).sum();
    let mut loader = Loader {
        data: Data { root: &root, buffers, packed: !packing.is_empty() },
        folder,
        color,
        notes,
        mesh: Mesh { name: path.display().to_string(), ..Mesh::default() },
        budget: Budget::new(buffer_bytes),
        texels: MOST_TEXELS,
        materials: HashMap::new(),
        textures: HashMap::new(),
        has: Has::default(),
    };
    loader.scene()?;
    loader.finish()
}

/// What to do about extensions.
const PLAIN: &str = "Export it without compression or extensions";

/// The first problem of a document that says of itself what it needs. Looked for before all else, because what an
/// extension adds makes other parts unreadable. Returns the extensions of [`PACKING`] that are used.
fn refuse_extensions(text: &[u8]) -> Outcome<Vec<String>> {
    #[derive(serde::Deserialize)]
    struct Asset {
        version: String,
    }
    #[derive(serde::Deserialize)]
    #[serde(rename_all = "camelCase")]
    struct Head {
        asset: Asset,
        #[serde(default)]
        extensions_required: Vec<String>,
        #[serde(default)]
        extensions_used: Vec<String>,
    }
    let head: Head = json::deserialize::from_slice(text).map_err(|e| format!("not valid glTF JSON: {e}"))?;
    if head.asset.version.split('.').next() != Some("2") {
        return Err(format!("is glTF {}; allowed: 2.0", head.asset.version));
    }
    let refused: Vec<&str> =
        head.extensions_required.iter().map(String::as_str).filter(|name| !EXTENSIONS.contains(name)).collect();
    if refused.is_empty() {
        return Ok(head.extensions_used.into_iter().filter(|name| PACKING.contains(&name.as_str())).collect());
    }
    Err(format!(
        "requires {}, which is not supported; supported: {}. {PLAIN}",
        refused.join(", "),
        EXTENSIONS.join(", ")
    ))
}

/// The JSON text and the binary chunk of a `.glb`, or all of a `.gltf` (whatever the extension says).
fn split(bytes: &[u8]) -> Outcome<(&[u8], Option<&[u8]>)> {
    let Some(header) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes, None));
    };
    let (Some(version), Some(length)) = (word(header, 0), word(header, 4)) else {
        return Err("is cut short within the header of the .glb".to_owned());
    };
    if version != 2 {
        return Err(format!("is a .glb of version {version}; allowed: 2"));
    }
    let Some(mut rest) = bytes.get(12..length as usize) else {
        return Err(format!("is cut short: the .glb says that it has {length} bytes, and there are {}", bytes.len()));
    };
    let mut text = None;
    let mut blob = None;
    while !rest.is_empty() {
        let (Some(size), Some(kind)) = (word(rest, 0), word(rest, 4)) else {
            return Err("ends within the header of a chunk".to_owned());
        };
        let Some((chunk, after)) = rest.get(8..).and_then(|chunk| chunk.split_at_checked(size as usize)) else {
            return Err(format!("has a chunk of {size} bytes that ends behind the file"));
        };
        match &kind.to_le_bytes() {
            b"JSON" if text.is_none() => text = Some(chunk),
            b"BIN\0" if blob.is_none() => blob = Some(chunk),
            // Other chunks are for others, says the specification.
            _ => {}
        }
        rest = after;
    }
    text.map(|text| (text, blob)).ok_or_else(|| "has no JSON chunk".to_owned())
}

fn word(bytes: &[u8], offset: usize) -> Option<u32> {
    bytes.get(offset..offset + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

fn load_buffers(root: &json::Root, blob: Option<&[u8]>, folder: &Path) -> Outcome<Vec<Vec<u8>>> {
    let mut buffers = Vec::with_capacity(root.buffers.len());
    let mut left = BUFFER_BYTES;
    for (i, buffer) in root.buffers.iter().enumerate() {
        let USize64(length) = buffer.byte_length;
        left = left
            .checked_sub(length)
            .ok_or_else(|| format!("buffer {i}: the buffers are too large; allowed: {BUFFER_BYTES} bytes in all"))?;
        let mut bytes = match (&buffer.uri, blob) {
            (Some(uri), _) => resolve(uri, folder, length).map_err(|e| format!("buffer {i}: {e}"))?,
            (None, Some(blob)) if i == 0 => blob.to_vec(),
            (None, _) => return Err(format!("buffer {i} has neither a URI nor a binary chunk")),
        };
        if (bytes.len() as u64) < length {
            let name = buffer.uri.as_deref().filter(|uri| !uri.starts_with("data:")).unwrap_or("its data");
            return Err(format!("buffer {i} should have {length} bytes; {name} has {}", bytes.len()));
        }
        bytes.truncate(length as usize);
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The bytes of a data URI or of a file next to the document.
fn resolve(uri: &str, folder: &Path, limit: u64) -> Outcome<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (head, body) = data.split_once(',').ok_or("its data URI has no comma")?;
        return if head.ends_with(";base64") {
            base64(body).ok_or_else(|| "its data URI is not valid base64".to_owned())
        } else {
            Ok(percent_decoded(body))
        };
    }
    if uri.contains("://") {
        return Err(format!("`{uri}` is not a file; only files are read"));
    }
    let name = String::from_utf8(percent_decoded(uri)).map_err(|_| format!("`{uri}` is not UTF-8"))?;
    let file: PathBuf = folder.join(name);
    read_file(&file, limit).map_err(|e| format!("{}: {e}", file.display()))
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let digit = |at: usize| bytes.get(at).and_then(|&b| char::from(b).to_digit(16));
        match (bytes[i], digit(i + 1), digit(i + 2)) {
            (b'%', Some(high), Some(low)) => {
                decoded.push((high * 16 + low) as u8);
                i += 3;
            }
            (byte, ..) => {
                decoded.push(byte);
                i += 1;
            }
        }
    }
    decoded
}

/// RFC 4648 base64, of either alphabet, with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    // One letter alone holds six bits: no byte.
    if text.len() % 4 == 1 {
        return None;
    }
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut count) = (0_u32, 0);
    for &letter in text {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    Some(bytes)
}

/// The document with its bytes.
struct Data<'a> {
    root: &'a json::Root,
    buffers: Vec<Vec<u8>>,
    /// Whether an accessor without data may have them in an extension.
    packed: bool,
}

/// Elements of an accessor or of a part of it: checked to lie within their buffer.
struct Elements<'a> {
    /// From the first byte of the first element to the last byte of the last.
    bytes: &'a [u8],
    /// Bytes from one element to the next.
    stride: usize,
    count: usize,
}

impl<'a> Elements<'a> {
    fn get(&self, i: usize) -> &'a [u8] {
        &self.bytes[i * self.stride..]
    }
}

fn item<'a, T>(items: &'a [T], index: usize, what: &str) -> Outcome<&'a T> {
    items.get(index).ok_or_else(|| format!("{what} {index} is asked for, and there are {}", items.len()))
}

/// The number at the start of `bytes`; integers are mapped to [0, 1] or [-1, 1] when `normalized`.
fn number(bytes: &[u8], component: ComponentType, normalized: bool) -> f32 {
    let unit = |value: f32, largest: f32| if normalized { (value / largest).max(-1.0) } else { value };
    match component {
        ComponentType::I8 => unit(f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => unit(f32::from(bytes[0]), 255.0),
        ComponentType::I16 => unit(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
        ComponentType::U16 => unit(f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
        ComponentType::U32 => index(bytes, component) as f32,
        ComponentType::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

/// The unsigned integer at the start of `bytes`.
fn index(bytes: &[u8], component: ComponentType) -> u32 {
    match component {
        ComponentType::I8 | ComponentType::U8 => u32::from(bytes[0]),
        ComponentType::I16 | ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        ComponentType::U32 | ComponentType::F32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

impl Data<'_> {
    /// The bytes of a buffer view and its stride.
    fn view(&self, view: usize) -> Outcome<(&[u8], Option<usize>)> {
        let what = view;
        let view = item(&self.root.buffer_views, view, "buffer view")?;
        let buffer = item(&self.buffers, view.buffer.value(), "buffer")?;
        let start = view.byte_offset.map_or(0, |USize64(offset)| offset);
        let USize64(length) = view.byte_length;
        let bytes = start
            .checked_add(length)
            .and_then(|end| buffer.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?))
            .ok_or_else(|| {
                format!(
                    "buffer view {what} (offset {start}, {length} bytes) ends behind its buffer of {}",
                    buffer.len()
                )
            })?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }

    /// `count` elements of `size` bytes each, from `offset` in a buffer view.
    fn elements(&self, view: usize, offset: u64, count: u64, size: usize, strided: bool) -> Outcome<Elements<'_>> {
        let (bytes, stride) = self.view(view)?;
        let stride = stride.filter(|_| strided).unwrap_or(size);
        if stride < size {
            return Err(format!("buffer view {view} has a stride of {stride} bytes for elements of {size}"));
        }
        let end = match count.checked_sub(1) {
            None => Some(offset),
            Some(last) => last
                .checked_mul(stride as u64)
                .and_then(|length| length.checked_add(size as u64))
                .and_then(|length| length.checked_add(offset)),
        };
        end.and_then(|end| bytes.get(usize::try_from(offset).ok()?..usize::try_from(end).ok()?))
            .map(|bytes| Elements { bytes, stride, count: count as usize })
            .ok_or_else(|| {
                format!(
                    "asks for {count} elements of {size} bytes, {stride} apart, from byte {offset} of buffer view \
                     {view}, which has {} bytes",
                    bytes.len()
                )
            })
    }

    /// Number of elements of an accessor, as it says.
    fn count(&self, accessor: usize) -> Outcome<u64> {
        Ok(item(&self.root.accessors, accessor, "accessor")?.count.0)
    }

    /// `accessor`, if it has as many elements as there are vertices.
    fn same(&self, accessor: usize, vertices: u64) -> Outcome<usize> {
        match self.count(accessor)? {
            count if count == vertices => Ok(accessor),
            count => Err(format!("accessor {accessor} has {count} elements for {vertices} vertices")),
        }
    }

    /// Every element of an accessor, decoded. The caller has checked that `count` of them fit into memory.
    fn read<T: Clone>(
        &self,
        accessor: usize,
        allowed: &str,
        fits: impl Fn(Type, ComponentType, bool) -> bool,
        zero: T,
        decode: impl Fn(&[u8], ComponentType, bool) -> T,
    ) -> Outcome<Vec<T>> {
        let what = accessor;
        let accessor = item(&self.root.accessors, accessor, "accessor")?;
        let fail = |e: String| format!("accessor {what} {e}");
        let (Checked::Valid(kind), Checked::Valid(component)) = (accessor.type_, accessor.component_type) else {
            return Err(fail("has an unknown type".to_owned()));
        };
        let component = component.0;
        if !fits(kind, component, accessor.normalized) {
            let normalized = if accessor.normalized { "normalised " } else { "" };
            return Err(fail(format!("is {normalized}{kind:?} of {component:?}; allowed: {allowed}")));
        }
        let size = kind.multiplicity() * component.size();
        let mut values = match accessor.buffer_view {
            None if self.packed && accessor.sparse.is_none() => return Err(fail("has no data".to_owned())),
            None => vec![zero; usize::try_from(accessor.count.0).map_err(|_| fail("is too long".to_owned()))?],
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |USize64(offset)| offset);
                let elements = self.elements(view.value(), offset, accessor.count.0, size, true).map_err(fail)?;
                (0..elements.count).map(|i| decode(elements.get(i), component, accessor.normalized)).collect()
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(index_component) = sparse.indices.component_type else {
                return Err(fail("has sparse indices of an unknown type".to_owned()));
            };
            let index_component = index_component.0;
            if sparse.count.0 > accessor.count.0 {
                return Err(fail(format!("has {} sparse values for {} elements", sparse.count.0, accessor.count.0)));
            }
            let at = &sparse.indices;
            let indices = self
                .elements(at.buffer_view.value(), at.byte_offset.0, sparse.count.0, index_component.size(), false)
                .map_err(fail)?;
            let at = &sparse.values;
            let replacements =
                self.elements(at.buffer_view.value(), at.byte_offset.0, sparse.count.0, size, false).map_err(fail)?;
            for i in 0..indices.count {
                let target = index(indices.get(i), index_component);
                let count = values.len();
                let Some(value) = values.get_mut(target as usize) else {
                    return Err(fail(format!("has a sparse value for element {target} of {count}")));
                };
                *value = decode(replacements.get(i), component, accessor.normalized);
            }
        }
        Ok(values)
    }

    /// An accessor of N floating-point numbers per element: floats, and normalised bytes or shorts where `integers`.
    /// Elements may have one number more than N where `alpha` (the fourth of a colour).
    fn floats<const N: usize>(&self, accessor: usize, integers: bool, alpha: bool) -> Outcome<Vec<[f32; N]>> {
        let allowed = format!(
            "{}{} of {}",
            if N == 2 { "Vec2" } else { "Vec3" },
            if alpha { " or Vec4" } else { "" },
            if integers { "F32, normalised U8 or normalised U16" } else { "F32" }
        );
        let fits = |kind: Type, component, normalized| {
            let shape = match kind {
                Type::Vec2 => N == 2,
                Type::Vec3 => N == 3,
                Type::Vec4 => N == 3 && alpha,
                Type::Scalar | Type::Mat2 | Type::Mat3 | Type::Mat4 => false,
            };
            shape
                && match component {
                    ComponentType::F32 => true,
                    ComponentType::U8 | ComponentType::U16 => integers && normalized,
                    ComponentType::I8 | ComponentType::I16 | ComponentType::U32 => false,
                }
        };
        self.read(accessor, &allowed, fits, [0.0; N], |bytes, component, normalized| {
            std::array::from_fn(|k| number(&bytes[k * component.size()..], component, normalized))
        })
    }

    /// An accessor of vertex indices.
    fn indices(&self, accessor: usize) -> Outcome<Vec<u32>> {
        let fits = |kind, component, _| {
            kind == Type::Scalar && matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
        };
        self.read(accessor, "Scalar of U8, U16 or U32", fits, 0, |bytes, component, _| index(bytes, component))
    }
}

/// Which attributes any primitive has had so far; the arrays of the others stay empty.
#[derive(Default)]
struct Has {
    normals: bool,
    coordinates: bool,
    colors: bool,
}

/// A material of the mesh: the document's (none: the default one), and what the primitive makes of it.
#[derive(PartialEq, Eq, Hash)]
struct MaterialKey {
    material: Option<usize>,
    /// A primitive without texture coordinates shows no texture.
    textured: bool,
    /// A primitive with vertex colours and no material is not given the entry's colour.
    colored: bool,
}

struct Loader<'a> {
    data: Data<'a>,
    folder: &'a Path,
    /// For what has no colour in the file.
    color: Rgb,
    notes: &'a mut Vec<String>,
    mesh: Mesh,
    /// What the mesh may still take.
    budget: Budget,
    /// Texels that the mesh may still have.
    texels: u64,
    materials: HashMap<MaterialKey, u32>,
    /// By picture and wrapping.
    textures: HashMap<(usize, [u8; 2]), u32>,
    has: Has,
}

impl Loader<'_> {
    /// Walks the nodes of the scene.
    fn scene(&mut self) -> Outcome<()> {
        let root = self.data.root;
        let scene = match root.scene {
            Some(scene) => Some(item(&root.scenes, scene.value(), "scene")?),
            None => root.scenes.first(),
        };
        let mut stack: Vec<(usize, DMat4)> = Vec::new();
        match scene {
            Some(scene) => stack.extend(scene.nodes.iter().map(|node| (node.value(), DMat4::IDENTITY))),
            None => {
                let mut is_child = vec![false; root.nodes.len()];
                for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
                    if let Some(is_child) = is_child.get_mut(child.value()) {
                        *is_child = true;
                    }
                }
                stack.extend((0..root.nodes.len()).filter(|&node| !is_child[node]).map(|node| (node, DMat4::IDENTITY)));
            }
        }
        // Popped from the end: reversed, so that triangles keep the document's order.
        stack.reverse();
        // A node has one parent, so that meeting one twice means a cycle, or growth without bounds.
        let mut met = vec![false; root.nodes.len()];
        while let Some((index, parent)) = stack.pop() {
            let node = item(&root.nodes, index, "node")?;
            if std::mem::replace(&mut met[index], true) {
                return Err(format!("node {index} is met twice in the scene; the nodes must form a tree"));
            }
            let world = parent * local_transform(node);
            if let Some(mesh) = node.mesh {
                if node.skin.is_some() {
                    self.note("a skin is left out: the mesh is shown in its rest pose");
                }
                self.instance(mesh.value(), world)?;
            }
            stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), world)));
        }
        Ok(())
    }

    fn note(&mut self, what: &str) {
        let note = format!("{}: {what}", self.mesh.name);
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Adds a mesh of the document under a transform.
    fn instance(&mut self, mesh: usize, world: DMat4) -> Outcome<()> {
        let what = mesh;
        let mesh = item(&self.data.root.meshes, mesh, "mesh")?;
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            self.primitive(primitive, world).map_err(|e| format!("mesh {what}, primitive {i}: {e}"))?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &json::mesh::Primitive, world: DMat4) -> Outcome<()> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err("has an unknown mode".to_owned());
        };
        match mode {
            Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => {
                self.note("points and lines are left out");
                return Ok(());
            }
            Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => {}
        }
        if primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
            self.note("morph targets are left out");
        }
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(json::Index::value);
        let Some(positions) = attribute(Semantic::Positions) else {
            self.note("a primitive without positions is left out");
            return Ok(());
        };
        let count = self.data.count(positions)?;
        self.budget.spend(count, VERTEX_BYTES)?;

        let corners = match primitive.indices.map(|accessor| accessor.value()) {
            Some(accessor) => {
                let indices = self.data.count(accessor)?;
                // A strip has about as many triangles as indices.
                self.budget.spend(
                    indices,
                    if mode == Mode::Triangles { TRIANGLE_BYTES.div_ceil(3) } else { TRIANGLE_BYTES },
                )?;
                corners(mode, self.data.indices(accessor)?.into_iter())
            }
            None => {
                let count = u32::try_from(count).map_err(|_| format!("has {count} vertices"))?;
                self.budget.spend(u64::from(count), TRIANGLE_BYTES)?;
                corners(mode, 0..count)
            }
        };
        if corners.is_empty() {
            return Ok(());
        }
        if let Some(corner) = corners.iter().flatten().find(|&&corner| u64::from(corner) >= count) {
            return Err(format!("vertex {corner} is asked for, and there are {count}"));
        }
        let first = u32::try_from(self.mesh.positions.len()).map_err(|_| "has too many vertices".to_owned())?;
        if u64::from(first) + count > u64::from(u32::MAX) {
            return Err("has too many vertices".to_owned());
        }

        let data = &self.data;
        let points = data.floats::<3>(positions, false, false)?;
        let normals = match attribute(Semantic::Normals) {
            Some(accessor) => Some(data.floats::<3>(data.same(accessor, count)?, false, false)?),
            None => None,
        };
        let colors = match attribute(Semantic::Colors(0)) {
            Some(accessor) => Some(data.floats::<3>(data.same(accessor, count)?, true, true)?),
            None => None,
        };
        let material = match primitive.material {
            Some(material) => Some(item(&self.data.root.materials, material.value(), "material")?),
            None => None,
        };
        let info = material.and_then(|material| material.pbr_metallic_roughness.base_color_texture.as_ref());
        let coordinates = match info {
            Some(info) => {
                let transform = info.extensions.as_ref().and_then(|extensions| extensions.texture_transform.as_ref());
                let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
                match attribute(Semantic::TexCoords(set)) {
                    Some(accessor) => Some((data.floats::<2>(data.same(accessor, count)?, true, false)?, transform)),
                    None => {
                        self.note("a texture is left out where its texture coordinates are missing");
                        None
                    }
                }
            }
            None => None,
        };
        let key = MaterialKey {
            material: primitive.material.map(|material| material.value()),
            textured: coordinates.is_some(),
            colored: colors.is_some(),
        };
        let material = self.material(key)?;

        let linear = DMat3::from_mat4(world);
        let normal_from_local = cofactors(linear);
        let old = self.mesh.positions.len();
        let mesh = &mut self.mesh;
        for point in &points {
            let point = world.transform_point3(DVec3::from(point.map(f64::from)));
            if !point.is_finite() {
                return Err(format!("vertex {} is not finite", mesh.positions.len() - old));
            }
            mesh.positions.push(point);
        }
        let new = mesh.positions.len();
        if let Some(normals) = normals {
            self.has.normals = true;
            mesh.normals.resize(old, DVec3::ZERO);
            // The zero vector, which stands for the triangle's own normal, where there is no direction.
            let transformed = |n: [f32; 3]| (normal_from_local * DVec3::from(n.map(f64::from))).normalize_or_zero();
            mesh.normals.extend(normals.into_iter().map(transformed));
        }
        if let Some((coordinates, transform)) = coordinates {
            self.has.coordinates = true;
            mesh.texture_coordinates.resize(old, DVec2::ZERO);
            for coordinate in coordinates {
                let coordinate = texture_transformed(DVec2::from(coordinate.map(f64::from)), transform);
                if !coordinate.is_finite() {
                    return Err("a texture coordinate is not finite".to_owned());
                }
                mesh.texture_coordinates.push(coordinate);
            }
        }
        if let Some(colors) = colors {
            if colors.iter().flatten().any(|channel| !channel.is_finite()) {
                return Err("a vertex colour is not finite".to_owned());
            }
            self.has.colors = true;
            mesh.colors.resize(old, [1.0; 3]);
            mesh.colors.extend(colors);
        }
        // What this primitive lacks and an earlier one has.
        if self.has.normals {
            mesh.normals.resize(new, DVec3::ZERO);
        }
        if self.has.coordinates {
            mesh.texture_coordinates.resize(new, DVec2::ZERO);
        }
        if self.has.colors {
            mesh.colors.resize(new, [1.0; 3]);
        }
        mesh.triangle_materials.resize(mesh.triangle_materials.len() + corners.len(), material);
        mesh.corners.extend(corners.into_iter().map(|corners| corners.map(|corner| corner + first)));
        Ok(())
    }

    fn material(&mut self, key: MaterialKey) -> Outcome<u32> {
        if let Some(&material) = self.materials.get(&key) {
            return Ok(material);
        }
        let material = match key.material {
            None => Material { color: if key.colored { [1.0; 3] } else { self.color }, texture: None, unlit: false },
            Some(index) => {
                let source = item(&self.data.root.materials, index, "material")?;
                match source.alpha_mode {
                    Checked::Valid(json::material::AlphaMode::Opaque) => {}
                    Checked::Valid(json::material::AlphaMode::Mask | json::material::AlphaMode::Blend) => {
                        self.note("transparency is left out: the mesh is drawn opaque");
                    }
                    Checked::Invalid => return Err(format!("material {index} has an unknown alpha mode")),
                }
                let base = &source.pbr_metallic_roughness;
                let [r, g, b, _] = base.base_color_factor.0;
                if ![r, g, b].iter().all(|channel| channel.is_finite()) {
                    return Err(format!("material {index} has a colour that is not finite"));
                }
                let texture = match &base.base_color_texture {
                    Some(info) if key.textured => Some(self.texture(info.index.value())?),
                    _ => None,
                };
                let unlit = source.extensions.as_ref().is_some_and(|extensions| extensions.unlit.is_some());
                Material { color: [r, g, b], texture, unlit }
            }
        };
        let index = self.mesh.materials.len() as u32;
        self.mesh.materials.push(material);
        self.materials.insert(key, index);
        Ok(index)
    }

    fn texture(&mut self, index: usize) -> Outcome<u32> {
        let root = self.data.root;
        let texture = item(&root.textures, index, "texture")?;
        let wrap = match texture.sampler {
            None => [Wrap::Repeat; 2],
            Some(sampler) => {
                let sampler = item(&root.samplers, sampler.value(), "sampler")?;
                let (Checked::Valid(s), Checked::Valid(t)) = (sampler.wrap_s, sampler.wrap_t) else {
                    return Err(format!("texture {index} has an unknown wrapping mode"));
                };
                [s, t].map(|mode| match mode {
                    WrappingMode::Repeat => Wrap::Repeat,
                    WrappingMode::MirroredRepeat => Wrap::Mirror,
                    WrappingMode::ClampToEdge => Wrap::Clamp,
                })
            }
        };
        let source = texture.source.value();
        let key = (source, wrap.map(|wrap| wrap as u8));
        if let Some(&texture) = self.textures.get(&key) {
            return Ok(texture);
        }
        let texture = self.image(source, wrap).map_err(|e| format!("image {source}: {e}"))?;
        let index = self.mesh.textures.len() as u32;
        self.mesh.textures.push(texture);
        self.textures.insert(key, index);
        Ok(index)
    }

    fn image(&mut self, index: usize, wrap: [Wrap; 2]) -> Outcome<Texture> {
        let root = self.data.root;
        let Some(source) = root.images.get(index) else {
            return Err(format!("is asked for, and there are {}", root.images.len()));
        };
        let file;
        let bytes = match (&source.uri, source.buffer_view) {
            (Some(uri), _) => {
                file = resolve(uri, self.folder, u64::MAX)?;
                file.as_slice()
            }
            (None, Some(view)) => self.data.view(view.value())?.0,
            (None, None) => return Err("has neither a URI nor a buffer view".to_owned()),
        };
        let texture = decode(bytes, wrap, self.texels)?;
        self.texels -= texture.texels.len() as u64;
        Ok(texture)
    }

    fn finish(self) -> Outcome<Mesh> {
        if self.mesh.corners.is_empty() {
            return Err("holds no triangles in its scene".to_owned());
        }
        Ok(self.mesh)
    }
}

/// Node to parent.
fn local_transform(node: &json::Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let scale = DVec3::from(node.scale.unwrap_or([1.0; 3]).map(f64::from));
    let translation = DVec3::from(node.translation.unwrap_or_default().map(f64::from));
    // Files round their quaternions; a zero one turns nothing.
    let rotation = node.rotation.unwrap_or_default().0.map(f64::from);
    let length = rotation.iter().map(|v| v * v).sum::<f64>().sqrt();
    let rotation = if length.is_finite() && length > 0.0 {
        DQuat::from_array(rotation.map(|v| v / length))
    } else {
        DQuat::IDENTITY
    };
    DMat4::from_scale_rotation_translation(scale, rotation, translation)
}

/// The inverse transpose up to a factor, which exists for singular matrices too: normals of what a node flattens.
fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// `KHR_texture_transform`: scale, then rotation, then offset.
fn texture_transformed(uv: DVec2, transform: Option<&json::extensions::texture::TextureTransform>) -> DVec2 {
    let Some(transform) = transform else {
        return uv;
    };
    let offset = DVec2::from(transform.offset.0.map(f64::from));
    let scale = DVec2::from(transform.scale.0.map(f64::from));
    let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
    let scaled = uv * scale;
    // v points down in the picture, so that a counter-clockwise turn of the picture has the sines swapped.
    offset + DVec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x)
}

/// Triangles from a sequence of vertices. The winding of a strip alternates; it is undone so that all face one way.
fn corners(mode: Mode, mut vertices: impl Iterator<Item = u32>) -> Vec<[u32; 3]> {
    let mut corners = Vec::new();
    match mode {
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => {}
        Mode::Triangles => {
            while let (Some(a), Some(b), Some(c)) = (vertices.next(), vertices.next(), vertices.next()) {
                corners.push([a, b, c]);
            }
        }
        Mode::TriangleStrip => {
            if let (Some(mut a), Some(mut b)) = (vertices.next(), vertices.next()) {
                for (i, c) in vertices.enumerate() {
                    corners.push(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
                    (a, b) = (b, c);
                }
            }
        }
        Mode::TriangleFan => {
            if let (Some(hub), Some(mut b)) = (vertices.next(), vertices.next()) {
                for c in vertices {
                    corners.push([hub, b, c]);
                    b = c;
                }
            }
        }
    }
    corners
}
