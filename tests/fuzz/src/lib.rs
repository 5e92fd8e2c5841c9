//! What the fuzz targets do: read bytes with one reader, and hold it to its promises.
//!
//! The promises: no panic, no hang (libFuzzer's `-timeout`), never more memory than the size of the input allows, and
//! the same result whether or not the size of the file is known.
//!
//! A target is a file of two lines in `src/bin/`, with one of the macros below and a reader's name.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicIsize, Ordering};
use stereomist::input::mesh::MESH_READERS;
use stereomist::input::{Columns, Content, READERS, Selection, VolumeOptions, read_profile, scene_file};

#[doc(hidden)]
pub use libfuzzer_sys;

/// Bytes that reading may take whatever the size of the input.
const ALLOWANCE: usize = 64 << 20;

/// Bytes that reading may take for each byte of the input.
const GROWTH: usize = 4;

// ---- memory ----

static LIVE: AtomicIsize = AtomicIsize::new(0);
static PEAK: AtomicIsize = AtomicIsize::new(0);

/// The system's allocator, counting bytes that are in use.
struct Counting;

fn count(change: isize) {
    let live = LIVE.fetch_add(change, Ordering::Relaxed) + change;
    PEAK.fetch_max(live, Ordering::Relaxed);
}

// SAFETY: every call is passed on to the system's allocator as it is; counting neither allocates nor fails. An allocator
// cannot be written without `unsafe`, and nothing else sees what is allocated and freed again within a call.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Does `work` on an input of `length` bytes.
///
/// Panics if more than [`GROWTH`] times `length` and [`ALLOWANCE`] bytes were in use at a time.
fn bounded<T>(length: usize, work: impl FnOnce() -> T) -> T {
    let before = LIVE.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let result = work();
    let peak = PEAK.load(Ordering::Relaxed) - before;
    let allowed = GROWTH * length + ALLOWANCE;
    assert!(peak <= allowed as isize, "{peak} bytes in use for an input of {length}; allowed: {allowed}");
    result
}

// ---- particles ----

/// A fuzz target for the particle reader of that name.
#[macro_export]
macro_rules! particles {
    ($name:literal) => {
        $crate::libfuzzer_sys::fuzz_target!(|bytes: &[u8]| $crate::fuzz_reader($name, bytes));
    };
}

/// The columns that a scene asks for.
const NAMES: [&str; 11] = ["x", "y", "z", "radius", "opacity", "r", "g", "b", "red", "green", "blue"];

/// Reads with the row of `READERS` of that name: every selection, size known and unknown, volumes fine and coarse.
pub fn fuzz_reader(name: &str, bytes: &[u8]) {
    let reader = READERS.iter().find(|reader| reader.name == name).expect("a target is named as its reader");
    let _ = (reader.detect)(bytes);
    let mut options = vec![VolumeOptions::default()];
    if matches!(reader.content, Content::Volume(_)) {
        options.push(VolumeOptions { grid: Some("density".to_owned()), downsample: 3 });
    }
    let selections =
        [Selection::All, Selection::named(NAMES), Selection::Survey(NAMES.map(str::to_owned).to_vec())];
    for options in &options {
        for selection in &selections {
            let sized = bounded(bytes.len(), || {
                reader.read(&mut &*bytes, Some(bytes.len() as u64), selection, options).map_err(|e| e.to_string())
            });
            let streamed = bounded(bytes.len(), || {
                reader.read(&mut BufReader::with_capacity(61, bytes), None, selection, options)
            });
            match (sized, streamed) {
                (Ok(sized), Ok(streamed)) => same(&sized, &streamed),
                (Err(_), Err(_)) => {}
                // What stands behind the particles is not read, but its size is checked if it can be.
                (Err(message), Ok(_)) => assert!(message.contains("truncated"), "only with the size: {message}"),
                (Ok(_), Err(error)) => panic!("only without the size: {error}"),
            }
        }
    }
}

/// Panics unless both hold the same, NaN being as good as NaN.
fn same(a: &Columns, b: &Columns) {
    assert_eq!((a.len(), a.names(), &a.notes), (b.len(), b.names(), &b.notes));
    assert_eq!(a.iter().count(), b.iter().count());
    for (a, b) in a.iter().zip(b.iter()) {
        assert_eq!((&a.name, a.byte), (&b.name, b.byte));
        assert!(a.values.iter().zip(&b.values).all(|(a, b)| a == b || (a.is_nan() && b.is_nan())), "{}", a.name);
    }
}

// ---- meshes and what else is read by path ----

/// A fuzz target for the mesh reader of that name, by a file of that extension.
#[macro_export]
macro_rules! mesh {
    ($name:literal, $extension:literal) => {
        $crate::libfuzzer_sys::fuzz_target!(|bytes: &[u8]| $crate::fuzz_mesh($name, $extension, bytes));
    };
}

/// Reads a file of these bytes with the row of `MESH_READERS` of that name.
pub fn fuzz_mesh(name: &str, extension: &str, bytes: &[u8]) {
    let reader = MESH_READERS.iter().find(|reader| reader.name == name).expect("a target names its reader");
    let path = write(&format!("input.{extension}"), bytes);
    let mesh = bounded(bytes.len(), || (reader.read)(&path, [0.5; 3], &mut Vec::new()));
    // What is rendered later relies on this.
    if let Ok(mesh) = mesh {
        assert!(mesh.corners.iter().flatten().all(|&corner| (corner as usize) < mesh.positions.len()));
        assert!(mesh.triangle_materials.len() == mesh.corners.len());
        assert!(mesh.triangle_materials.iter().all(|&material| (material as usize) < mesh.materials.len()));
        assert!(mesh.materials.iter().flat_map(|m| m.texture).all(|index| (index as usize) < mesh.textures.len()));
        let count = mesh.positions.len();
        for length in [mesh.normals.len(), mesh.texture_coordinates.len(), mesh.colors.len()] {
            assert!(length == 0 || length == count, "{length} attributes of {count} vertices");
        }
    }
}

/// A triangle with a texture.
const TRIANGLE: &[u8] = b"mtllib input.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";

/// Reads a triangle whose materials are these bytes.
pub fn fuzz_mtl(bytes: &[u8]) {
    write("input.mtl", bytes);
    fuzz_mesh("OBJ", "obj", TRIANGLE);
}

/// Reads a triangle whose texture is these bytes. Of a picture 4 times the file is little, since it is compressed: the
/// bound is for what claims to be one.
pub fn fuzz_texture(bytes: &[u8]) {
    write("input.mtl", b"newmtl a\nmap_Kd input.png\n");
    write("input.png", bytes);
    fuzz_mesh("OBJ", "obj", TRIANGLE);
}

/// Reads a kernel's profile of these bytes.
pub fn fuzz_profile(bytes: &[u8]) {
    let path = write("profile.csv", bytes);
    if let Ok((q, density)) = bounded(bytes.len(), || read_profile(&path)) {
        assert!(q.len() >= 2 && q.len() == density.len() && q.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(density.iter().all(|value| value.is_finite() && *value >= 0.0));
    }
}

/// Writes the one file of that name of this process, in memory where the system can.
fn write(name: &str, bytes: &[u8]) -> PathBuf {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
        let memory = Path::new("/dev/shm");
        // libFuzzer ends a process without clearing up: whoever wants the folder gone names the one that it is made in.
        let parent = match std::env::var_os("TMPDIR") {
            None if memory.is_dir() => memory.to_owned(),
            _ => std::env::temp_dir(),
        };
        tempfile::Builder::new().prefix("stereomist-fuzz").tempdir_in(parent).expect("a temporary folder")
    });
    let path = FOLDER.path().join(name);
    std::fs::write(&path, bytes).expect("a temporary file can be written");
    path
}

// ---- scenes ----

/// Reads a scene file: its text up to the first NUL, then settings (`--set`) with a NUL before each.
pub fn fuzz_scene_file(bytes: &[u8]) {
    let mut parts = bytes.split(|&byte| byte == 0).map(String::from_utf8_lossy);
    let text = parts.next().unwrap_or_default();
    let sets: Vec<String> = parts.map(std::borrow::Cow::into_owned).collect();
    // Files named in the text are looked for in a folder that is not there.
    let result = bounded(bytes.len(), || scene_file::parse("scene.toml", &text, Path::new("/nowhere"), &sets));
    match result {
        Ok(scene) => assert!(scene.camera.size.iter().all(|&side| side > 0)),
        Err(problems) => {
            assert!(!problems.is_empty(), "an error without a problem");
            for problem in problems {
                assert!(!problem.to_string().is_empty());
            }
        }
    }
}
