//! Particle files and boxes: every reader, every format, wrong input, transforms.

use glam::DVec3;
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use stereomist::Error;
use stereomist::input::color_map::{COLOR_MAPS, ColorMap, look_up};
use stereomist::input::particles::{MAX_BOX_COUNT, box_positions, from_columns, selection, world_from_set};
use stereomist::input::population::populate;
use stereomist::input::{
    ColumnMap, Columns, Content, ParticleEntry, READERS, ReadError, Reader, Selection, Source, Target, VolumeOptions,
    csv, particle_set, ply, read_columns, read_profile,
};
use stereomist::scene::{Attribute, Kernel, ParticleSet};

pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// An entry with nothing set.
pub fn entry(source: Source) -> ParticleEntry {
    ParticleEntry {
        source,
        radius: None,
        opacity: 0.5,
        color: [1.0, 1.0, 1.0],
        kernel: Kernel::default(),
        position: DVec3::ZERO,
        rotation_deg: DVec3::ZERO,
        scale: 1.0,
        fit: None,
        columns: Vec::new(),
        volume: VolumeOptions::default(),
    }
}

fn file_entry(path: &Path) -> ParticleEntry {
    entry(Source::File(path.to_owned()))
}

/// A reader's result on bytes in memory, with the size known and unknown: both must agree.
pub fn read_bytes(
    read: impl Fn(&mut dyn std::io::BufRead, Option<u64>, &Selection) -> Result<Columns, ReadError>,
    bytes: &[u8],
    selection: &Selection,
) -> Result<Columns, String> {
    let sized = read(&mut &bytes[..], Some(bytes.len() as u64), selection).map_err(|error| error.to_string());
    let streamed = read(&mut std::io::BufReader::with_capacity(7, bytes), None, selection);
    match (&sized, streamed) {
        (Ok(sized), Ok(streamed)) => assert_eq!(*sized, streamed),
        (Err(_), Err(_)) => {}
        // Elements behind the particles are not read, but their size is checked if it can be.
        (Err(message), Ok(_)) => assert!(message.contains("truncated"), "{message}"),
        (Ok(_), Err(error)) => panic!("only without the size: {error}"),
    }
    sized
}

/// A reader's result on bytes in memory.
pub fn read_with(reader: &Reader, bytes: &[u8], selection: &Selection) -> Result<Columns, String> {
    read_bytes(
        |input, size, selection| reader.read(input, size, selection, &VolumeOptions::default()),
        bytes,
        selection,
    )
}

/// All columns of a file.
fn columns_of(path: &Path) -> stereomist::Result<Columns> {
    read_columns(path, &Selection::All, &VolumeOptions::default(), &())
}

fn csv_text(text: &str) -> Result<Columns, String> {
    read_bytes(csv::read, text.as_bytes(), &Selection::All)
}

fn csv_error(text: &str) -> String {
    csv_text(text).expect_err("the text is wrong")
}

fn ply_error(bytes: impl AsRef<[u8]>) -> String {
    read_bytes(ply::read, bytes.as_ref(), &Selection::All).expect_err("the file is wrong")
}

pub fn values<'a>(columns: &'a Columns, name: &str) -> &'a [f64] {
    &columns.get(name).unwrap_or_else(|| panic!("no column {name} in {:?}", columns.names())).values
}

pub fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing in: {message}");
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ascii,
    Little,
    Big,
}

const FORMATS: [Format; 3] = [Format::Ascii, Format::Little, Format::Big];

/// One value in the order of the file: its PLY type and itself.
fn put(out: &mut Vec<u8>, format: Format, kind: &str, value: f64) {
    if format == Format::Ascii {
        out.extend_from_slice(format!("{value} ").as_bytes());
        return;
    }
    let mut bytes = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        "double" | "float64" => value.to_le_bytes().to_vec(),
        _ => panic!("no PLY type: {kind}"),
    };
    if format == Format::Big {
        bytes.reverse();
    }
    out.extend_from_slice(&bytes);
}

fn ply_header(format: Format) -> Vec<u8> {
    let name = match format {
        Format::Ascii => "ascii",
        Format::Little => "binary_little_endian",
        Format::Big => "binary_big_endian",
    };
    format!("ply\nformat {name} 1.0\n").into_bytes()
}

/// A PLY file of vertices with scalar properties alone.
fn plain_ply(format: Format, properties: &[(&str, &str)], rows: &[&[f64]]) -> Vec<u8> {
    let mut out = ply_header(format);
    out.extend_from_slice(format!("element vertex {}\n", rows.len()).as_bytes());
    for (kind, name) in properties {
        out.extend_from_slice(format!("property {kind} {name}\n").as_bytes());
    }
    out.extend_from_slice(b"end_header\n");
    for row in rows {
        for ((kind, _), value) in properties.iter().zip(*row) {
            put(&mut out, format, kind, *value);
        }
        if format == Format::Ascii {
            out.push(b'\n');
        }
    }
    out
}

/// A PLY file with everything that has to be passed over: comments, lists within the vertex, elements before and after.
fn rich_ply(format: Format) -> Vec<u8> {
    let mut out = ply_header(format);
    out.extend_from_slice(
        b"comment a comment\nobj_info some info\nelement camera 2\nproperty double view_x\nelement face 3\n\
          property list uchar int vertex_indices\nproperty short flag\nelement empty 5\nelement vertex 2\n\
          property float32 x\nproperty list uint8 float64 weights\nproperty int16 y\nproperty float64 z\n\
          property list int uchar tags\nelement edge 1\nproperty list ushort float lengths\nend_header\n",
    );
    let mut row = |items: &[(&str, f64)]| {
        for (kind, value) in items {
            put(&mut out, format, kind, *value);
        }
        if format == Format::Ascii {
            out.push(b'\n');
        }
    };
    row(&[("double", 7.0)]);
    row(&[("double", 8.0)]);
    row(&[("uchar", 3.0), ("int", 0.0), ("int", 1.0), ("int", 2.0), ("short", -1.0)]);
    row(&[("uchar", 0.0), ("short", -2.0)]);
    row(&[("uchar", 1.0), ("int", 9.0), ("short", -3.0)]);
    row(&[
        ("float", 1.5),
        ("uchar", 2.0),
        ("double", 0.1),
        ("double", 0.2),
        ("short", -300.0),
        ("double", 2.5),
        ("int", 0.0),
    ]);
    row(&[("float", -0.25), ("uchar", 0.0), ("short", 12.0), ("double", 1e9), ("int", 1.0), ("uchar", 200.0)]);
    row(&[("ushort", 1.0), ("float", 3.0)]);
    out
}

// ---- every reader ----

/// A small file of each format: x, y, z of two particles and what else the format's help promises.
pub fn sample(reader: &str) -> Vec<u8> {
    match reader {
        "csv" => b"x,y,z,radius,opacity,r,g,b\n1,2,3,0.5,0.25,1,0.5,0\n-1,-2,-3,0.25,0.75,0,0,1\n".to_vec(),
        "ply" => {
            let names = ["x", "y", "z", "radius", "opacity", "red", "green", "blue"];
            let properties: Vec<(&str, &str)> = names.iter().map(|&name| ("float", name)).collect();
            let rows: [&[f64]; 2] =
                [&[1.0, 2.0, 3.0, 0.5, 0.25, 1.0, 0.5, 0.0], &[-1.0, -2.0, -3.0, 0.25, 0.75, 0.0, 0.0, 1.0]];
            plain_ply(Format::Little, &properties, &rows)
        }
        "npy" => {
            let rows = [1.0, 2.0, 3.0, 0.5, 0.25, 1.0, 0.5, 0.0, -1.0, -2.0, -3.0, 0.25, 0.75, 0.0, 0.0, 1.0_f32];
            let mut out =
                b"\x93NUMPY\x01\x00\x39\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 8)}".to_vec();
            out.extend(rows.iter().flat_map(|value| value.to_le_bytes()));
            out
        }
        "vtk" => b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n1 2 3 -1 -2 -3\n\
                  POINT_DATA 2\nSCALARS radius float\nLOOKUP_TABLE default\n0.5 0.25\n\
                  FIELD f 2\nopacity 1 2 double\n0.25 0.75\nrgb 3 2 float\n1 0.5 0 0 0 1\n"
            .to_vec(),
        "vtp" => b"<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"2\"><PointData>\
                  <DataArray type=\"Float32\" Name=\"radius\" format=\"ascii\">0.5 0.25</DataArray>\
                  <DataArray type=\"Float32\" Name=\"opacity\" format=\"ascii\">0.25 0.75</DataArray>\
                  <DataArray type=\"Float64\" Name=\"RGB\" NumberOfComponents=\"3\" format=\"ascii\">1 0.5 0 0 0 1\
                  </DataArray></PointData><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\
                  1 2 3 -1 -2 -3</DataArray></Points></Piece></PolyData></VTKFile>"
            .to_vec(),
        "vdb" => crate::vdb::sample(),
        other => panic!("no sample for the reader {other}: add one here"),
    }
}

#[test]
fn every_reader_reads_its_sample_by_every_extension() {
    let folder = tempfile::tempdir().unwrap();
    for reader in READERS {
        assert!(!reader.help.is_empty());
        // Volumes have no radii and colours; their modules test them.
        if matches!(reader.content, Content::Volume(_)) {
            continue;
        }
        for extension in reader.extensions {
            let path = folder.path().join(format!("cloud.{}", extension.to_uppercase()));
            std::fs::write(&path, sample(reader.name)).unwrap();
            let set = particle_set(&file_entry(&path), "[[particles]] 1", &(), &mut Vec::new()).unwrap();
            assert_eq!((set.x.as_slice(), set.z.as_slice()), ([1.0, -1.0].as_slice(), [3.0, -3.0].as_slice()));
            assert_eq!(set.radius, Attribute::Each(vec![0.5, 0.25]));
            assert_eq!(set.opacity, Attribute::Each(vec![0.25, 0.75]));
            assert_eq!(set.color, Attribute::Each(vec![[1.0, 0.5, 0.0], [0.0, 0.0, 1.0]]), "{}", reader.name);
        }
    }
}

#[test]
fn content_goes_before_the_extension() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["cloud.csv", "cloud.dat", "cloud"] {
        let path = folder.path().join(name);
        std::fs::write(&path, sample("ply")).unwrap();
        assert_eq!(columns_of(&path).unwrap().len(), 2, "{name}");
    }
}

#[test]
fn an_unknown_format_lists_the_known_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.xyz");
    std::fs::write(&path, "1 2 3\n").unwrap();
    let message = columns_of(&path).unwrap_err().to_string();
    assert_says(&message, &["cloud.xyz", "unknown particle format", ".csv", ".ply", ".npy"]);
    let missing = columns_of(&folder.path().join("none.ply")).unwrap_err();
    assert!(matches!(missing, Error::Input { .. }));
    assert_says(&missing.to_string(), &["none.ply", "cannot open"]);
    assert_says(&columns_of(folder.path()).unwrap_err().to_string(), &["cannot read"]);
}

#[test]
fn the_formats_agree() {
    let names = ["x", "y", "z", "radius", "opacity", "r", "g", "b"];
    let rows: Vec<Vec<f64>> = (0..50)
        .map(|i| {
            let t = f64::from(i);
            vec![t * 0.37 - 3.0, 1.0 / (t + 1.0), t.sin(), 0.1 + t, t / 50.0, t / 49.0, 0.125, 2.0 - t]
        })
        .collect();
    let text: Vec<String> =
        rows.iter().map(|row| row.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")).collect();
    let text = format!("{}\n{}\n", names.join(","), text.join("\n"));
    let properties: Vec<(&str, &str)> = names.iter().map(|&name| ("double", name)).collect();
    let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
    let mut entry = file_entry(Path::new("cloud"));
    entry.rotation_deg = DVec3::new(10.0, 20.0, 30.0);
    entry.scale = 1.7;
    let set = |columns: Columns| from_columns(&entry, columns, Path::new("cloud"), &mut Vec::new()).unwrap();
    let expected = set(read_bytes(csv::read, text.as_bytes(), &selection(&entry)).unwrap());
    assert_eq!(expected.len(), 50);
    for format in FORMATS {
        let bytes = plain_ply(format, &properties, &rows);
        let found = set(read_bytes(ply::read, &bytes, &selection(&entry)).unwrap());
        assert_eq!((&found.x, &found.y, &found.z), (&expected.x, &expected.y, &expected.z), "{format:?}");
        assert_eq!((&found.radius, &found.opacity), (&expected.radius, &expected.opacity), "{format:?}");
        assert_eq!(found.color, expected.color, "{format:?}");
    }
}

// ---- real files ----

#[test]
fn a_weather_radar_file() {
    let mut entry = file_entry(&data("katrina.ply"));
    entry.columns = vec![
        ColumnMap { scale: 0.01, min: Some(0.0), max: Some(0.3), ..ColumnMap::plain(Target::Opacity, "dbz") },
        ColumnMap {
            min: Some(5.0),
            max: Some(55.0),
            map: ColorMap::from_name("viridis"),
            ..ColumnMap::plain(Target::Color, "dbz")
        },
    ];
    entry.fit = Some(10.0);
    let set = particle_set(&entry, "[[particles]] 1", &(), &mut Vec::new()).unwrap();
    assert_eq!(set.len(), 309);
    assert_eq!(set.radius, Attribute::Uniform(0.1), "the entry's radius is in scene units with fit");
    assert_eq!([set.opacity.get(0), set.opacity.get(1)], [0.3, 0.11], "34 dBZ is clamped, 11 dBZ is not");
    let extent = |values: &[f64]| {
        let high = values.iter().copied().fold(f64::MIN, f64::max);
        let low = values.iter().copied().fold(f64::MAX, f64::min);
        (high - low, high + low)
    };
    let extents = [extent(&set.x), extent(&set.y), extent(&set.z)];
    let longest = extents.iter().map(|extent| extent.0).fold(0.0, f64::max);
    assert!((longest - 10.0).abs() < 1e-12, "{extents:?}");
    assert!(extents.iter().all(|extent| extent.1.abs() < 1e-12), "{extents:?}");
}

#[test]
fn a_hydrodynamics_file() {
    let mut entry = file_entry(&data("dust_disc.csv"));
    entry.columns = vec![ColumnMap { scale: 2.0, ..ColumnMap::plain(Target::Radius, "h") }];
    entry.scale = 0.5;
    let set = particle_set(&entry, "[[particles]] 1", &(), &mut Vec::new()).unwrap();
    assert_eq!((set.len(), set.x[0], set.z[199]), (200, -34.98332 * 0.5, -0.09410365 * 0.5));
    assert_eq!(set.radius.get(0), 13.59666 * 2.0 * 0.5, "radii of a file are lengths of the file");
}

// ---- CSV ----

#[test]
fn csv_dialects() {
    let expected = csv_text("x,y,z\n1,-2.5,3e2\n4,5,6\n").unwrap();
    assert_eq!(values(&expected, "z"), [300.0, 6.0]);
    for text in [
        "x,y,z\r\n1,-2.5,3e2\r\n4,5,6\r\n",
        "x,y,z\r1,-2.5,3e2\r4,5,6",
        "\u{feff}x,y,z\n1,-2.5,3e2\n4,5,6",
        " x , y ,z\n 1 ,\t-2.5, 3E+2 \n4,5,6\n\n\n",
        "# made by hand\n\nx,y,z\n# \"unbalanced\n1,-2.5,+300.\n   \n4,5,6\n#end",
        "\"x\",\"y\",\"z\"\n\"1\",\"-2.5\",\"300\"\n4,5,6\n",
    ] {
        assert_eq!(csv_text(text), Ok(expected.clone()), "{text:?}");
    }
}

#[test]
fn csv_ignores_what_is_not_wanted() {
    let text = "name,x,X,y,z,,\nfog,1,nan,2,3,abc,\n";
    let columns = read_bytes(csv::read, text.as_bytes(), &Selection::named(["x", "y", "z", "radius"])).unwrap();
    assert_eq!(columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(), ["x", "y", "z"]);
    assert_eq!(columns.names().len(), 7);
}

#[test]
fn csv_errors_say_where_and_what() {
    let mut long = String::from("x,y,z,opacity\n");
    long.push_str(&"0,0,0,0.5\n".repeat(15));
    assert_says(
        &csv_error(&format!("{long}0,0,0,abc\n")),
        &["line 17, column `opacity`: `abc` is not a number", "allowed"],
    );
    // Whatever the line ends and whatever stands before, the line is the one an editor shows.
    for end in ["\n", "\r\n", "\r"] {
        let text = ["# note", "", "x,y", "", "# note", "1,2", "", "3,four", ""].join(end);
        assert_says(&csv_error(&text), &["line 8, column `y`: `four`"]);
        assert_says(&csv_error(text.trim_end_matches(end)), &["line 8, column `y`: `four`"]);
    }
    assert_says(&csv_error("x,y\n1,2\n1\n"), &["line 3: 1 field where the header has 2"]);
    assert_says(&csv_error("x,y\n1,2,3\n"), &["line 2: 3 fields where the header has 2"]);
    assert_says(&csv_error("x,y\n1,\n"), &["line 2, column `y`: the field is empty"]);
    assert_says(&csv_error("x,y\n1,NaN\n"), &["line 2, column `y`: `NaN` is not finite"]);
    assert_says(&csv_error("x,y\n1,-inf\n"), &["line 2", "`-inf` is not finite"]);
    assert_says(&csv_error("x,y\n1,1e999\n"), &["line 2", "`1e999` is not finite"]);
    assert_says(&csv_error("x,y\n1,2\n3,\"4\n5,6\n7,8\n"), &["line 3, column `y`", "closing quote"]);
    assert_says(&csv_error(""), &["empty"]);
    assert_says(&csv_error("# only a comment\n\n"), &["empty"]);
    assert_says(&csv_error("x,y,x\n1,2,3\n"), &["line 1", "`x` stands twice"]);
    assert_says(&csv_error("x,y\n1,2\n3,\"4\n5\"\n6,7\n"), &["line 3, column `y`", "closing quote"]);
    assert_says(&csv_error("x,y\n1,2\n\"3,4\n5,6\n"), &["line 3: 1 field", "closing quote"]);
    let noted = "note,x\n\"two\nlines\n\",1\n\"\n\",bad";
    let noted = read_bytes(csv::read, noted.as_bytes(), &Selection::named(["x"])).unwrap_err();
    assert_says(&noted, &["line 5, column `x`: `bad`"]);
    let endless = format!("x\n\"{}", "1\n".repeat(20 << 20));
    assert_says(&csv_error(&endless), &["line 2", "4 MiB"]);
    let wide: Vec<String> = (0..=1 << 16).map(|i| format!("c{i}")).collect();
    assert_says(&csv_error(&format!("# note\n{}\n", wide.join(","))), &["line 2: 65537 columns", "at most 65536"]);
    assert_eq!(csv_text(&wide[1..].join(",")).unwrap().names().len(), 1 << 16);
    assert_says(&csv_error("1,2,3\n4,5,6\n"), &["line 1", "numbers where the names"]);
    let bytes = read_bytes(csv::read, b"x\n\xff\xfe\n", &Selection::All).unwrap_err();
    assert_says(&bytes, &["line 2, column `x`", "not a number"]);
}

#[test]
fn csv_with_a_header_alone_is_an_empty_set() {
    assert!(csv_text("x,y,z\n").unwrap().is_empty());
}

// ---- PLY ----

#[test]
fn ply_scalar_types_in_both_spellings() {
    let kinds: [(&str, &str, f64); 8] = [
        ("char", "int8", -128.0),
        ("uchar", "uint8", 255.0),
        ("short", "int16", -32768.0),
        ("ushort", "uint16", 65535.0),
        ("int", "int32", -2147483648.0),
        ("uint", "uint32", 4294967295.0),
        ("float", "float32", f64::from(-0.1f32)),
        ("double", "float64", 0.1),
    ];
    for format in FORMATS {
        for new in [false, true] {
            let properties: Vec<(&str, &str)> = kinds.iter().map(|k| (if new { k.1 } else { k.0 }, k.1)).collect();
            let row: Vec<f64> = kinds.iter().map(|k| k.2).collect();
            let bytes = plain_ply(format, &properties, &[&row, &row, &row]);
            let columns = read_bytes(ply::read, &bytes, &Selection::All).unwrap();
            for (kind, column) in kinds.iter().zip(columns.iter()) {
                assert_eq!(column.values, [kind.2; 3], "{format:?} {}", kind.0);
                assert_eq!(column.byte, kind.1 == "uint8");
            }
            let some = read_bytes(ply::read, &bytes, &Selection::named(["float64", "int16", "vertex"])).unwrap();
            assert_eq!(some.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(), ["int16", "float64"]);
            assert_eq!(values(&some, "float64"), [0.1; 3]);
            assert_eq!(some.names().len(), 8);
        }
    }
}

#[test]
fn ply_passes_over_lists_and_other_elements() {
    for format in FORMATS {
        let columns = read_bytes(ply::read, &rich_ply(format), &Selection::All).unwrap();
        assert_eq!(columns.names(), ["x", "y", "z"], "{format:?}");
        assert_eq!(values(&columns, "x"), [1.5, -0.25]);
        assert_eq!(values(&columns, "y"), [-300.0, 12.0]);
        assert_eq!(values(&columns, "z"), [2.5, 1e9]);
        let some = read_bytes(ply::read, &rich_ply(format), &Selection::named(["z"])).unwrap();
        assert_eq!(values(&some, "z"), [2.5, 1e9]);
    }
}

#[test]
fn ply_larger_than_a_block() {
    let rows: Vec<[f64; 3]> = (0..100_000).map(|i| [f64::from(i), 0.5, -f64::from(i)]).collect();
    let rows: Vec<&[f64]> = rows.iter().map(<[f64; 3]>::as_slice).collect();
    for format in FORMATS {
        let bytes = plain_ply(format, &[("int", "x"), ("double", "y"), ("float", "z")], &rows);
        let columns = ply::read(&mut bytes.as_slice(), Some(bytes.len() as u64), &Selection::named(["z"])).unwrap();
        assert!(values(&columns, "z").iter().enumerate().all(|(i, &z)| z == -(i as f64)));
        assert_eq!(values(&columns, "z").len(), 100_000);
    }
}

#[test]
fn ply_with_crlf_and_an_odd_number_of_spaces() {
    let text = "ply\r\nformat ascii 1.0\r\nelement vertex 1\r\nproperty float  x\r\nend_header\r\n\r\n  4.5\t\r\n";
    assert_eq!(values(&read_bytes(ply::read, text.as_bytes(), &Selection::All).unwrap(), "x"), [4.5]);
    let mut bytes =
        b"ply\r\nformat binary_little_endian 1.0\r\nelement vertex 1\r\nproperty float x\r\nend_header\r\n".to_vec();
    bytes.extend_from_slice(&4.5f32.to_le_bytes());
    assert_eq!(values(&read_bytes(ply::read, &bytes, &Selection::All).unwrap(), "x"), [4.5]);
}

#[test]
fn ply_header_errors_say_the_line() {
    let header = |lines: &str| ply_error(format!("ply\nformat ascii 1.0\n{lines}\nend_header\n"));
    assert_says(&ply_error("plyx\n"), &["line 1", "`plyx`", "begins with a line `ply`"]);
    assert_says(&ply_error("ply\nformat ascii 2.0\n"), &["line 2", "ascii 2.0", "binary_little_endian 1.0"]);
    assert_says(&ply_error("ply\nformat binary_middle_endian 1.0\n"), &["line 2", "middle", "allowed"]);
    assert_says(&ply_error("ply\nelement vertex 0\nend_header\n"), &["line 3", "no format"]);
    assert_says(&header("element vertex -1"), &["line 3", "`element vertex -1`", "integer count"]);
    assert_says(&header("element vertex 99999999999999999999"), &["line 3", "integer count"]);
    assert_says(&header("element vertex 4294967296"), &["line 3", "at most 4294967295"]);
    assert_says(&header("element vertex 1\nproperty half x"), &["line 4", "`property half x`", "double (float64)"]);
    assert_says(&header("element vertex 1\nproperty list float int x"), &["line 4", "integer type"]);
    assert_says(&header("element vertex 1\nproperty list uchar x"), &["line 4", "property list TYPE TYPE NAME"]);
    assert_says(&header("property float x"), &["line 3", "after its element"]);
    assert_says(&header("element vertex 0\nproperty float x\nproperty float x"), &["line 3", "two properties `x`"]);
    assert_says(&header("element vertex 0\nelement vertex 0"), &["line 4", "each element once"]);
    let elements: String = (0..1001).map(|i| format!("element {i} 0\n")).collect();
    assert_says(&header(&elements), &["line 1003", "at most 1000 elements"]);
    assert_says(&header("elephant vertex 0"), &["line 3", "`elephant vertex 0`", "end_header"]);
    assert_says(&header("element points 0\nelement face 0"), &["no element `vertex`", "`points`, `face`"]);
    assert_says(&ply_error("ply\nformat ascii 1.0\nelement vertex 1\n"), &["line 4", "before end_header"]);
    assert_says(&ply_error(format!("ply\n{}", "comment x\n".repeat(200_000))), &["longer than"]);
}

#[test]
fn ply_text_errors_say_line_and_property() {
    let text = |rows: &str| {
        ply_error(format!(
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty uchar red\nproperty list uchar int l\nend_header\n{rows}"
        ))
    };
    assert_says(&text("1 2 0\n1 abc 0\n"), &["line 9, property `red`: `abc` is not a number"]);
    assert_says(&text("1 2 0\n1 256 0\n"), &["line 9, property `red`: `256` is out of range", "from 0 to 255"]);
    assert_says(&text("1 2 0\n1 2.5 0\n"), &["line 9, property `red`: `2.5`", "integer"]);
    assert_says(&text("1 2 0\nnan 2 0\n"), &["line 9, property `x`: `nan` is not finite"]);
    assert_says(&text("1 2 0\n1                  \n"), &["line 9, property `red`", "ends before"]);
    assert_says(&text("1 2 0\n1 2 3 1 1         \n"), &["line 9, property `l`", "ends before"]);
    assert_says(&text("1 2 0\n1 2 0 7\n"), &["line 9: `7` follows"]);
    assert_says(&text("1 2 0           \n\n"), &["line 10", "element 1 of 2 `vertex`"]);
}

#[test]
fn ply_binary_errors_say_the_byte() {
    for format in [Format::Little, Format::Big] {
        let bytes = plain_ply(format, &[("float", "x"), ("float", "y")], &[&[0.0, 0.0], &[0.0, f64::NAN]]);
        let place = bytes.len() - 4;
        assert_says(&ply_error(&bytes), &[&format!("byte {place}"), "`y` of vertex 1 is NaN", "finite"]);
        // With y not wanted its value does not matter.
        assert_eq!(read_bytes(ply::read, &bytes, &Selection::named(["x"])).unwrap().len(), 2);
    }
    let start = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty list char int l\nend_header\n";
    let mut bytes = start.as_bytes().to_vec();
    bytes.extend_from_slice(&[0, 0xff]);
    assert_says(&ply_error(&bytes), &[&format!("byte {}", start.len() + 1), "`l` of element 1 of 2 `vertex`", "-1"]);
    bytes[start.len() + 1] = 1;
    assert_says(&ply_error(&bytes), &[&format!("byte {}", start.len() + 2), "the file ends within element 1 of 2"]);
}

#[test]
fn ply_counts_that_lie_are_refused_at_once() {
    let begin = std::time::Instant::now();
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for before in [
            "",
            "element face 4000000000\nproperty list uchar int i\n",
            "element a 18446744073709551615\nproperty double a\n",
        ] {
            let head = format!(
                "ply\nformat {format} 1.0\n{before}element vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n"
            );
            let message = ply_error(&head);
            assert_says(
                &message,
                &["00000000", "truncated"].map(|part| {
                    if before.contains("1844") && part != "truncated" { "18446744073709551615" } else { part }
                }),
            );
            assert!(!message.contains("memory"), "{message}");
        }
    }
    assert!(begin.elapsed().as_secs() < 5, "{:?}", begin.elapsed());
}

// ---- wrong bytes ----

#[test]
fn truncation_at_every_byte_never_panics() {
    for format in FORMATS {
        // Of the rich file's last element, which is not read, nothing but its smallest size is known.
        let (tail, rich_tail) = if format == Format::Ascii { (2, 12) } else { (0, 6) };
        let plain = plain_ply(format, &[("float", "x"), ("uchar", "red")], &[&[1.0, 2.0], &[3.0, 4.0]]);
        for (bytes, tail) in [(plain, tail), (rich_ply(format), rich_tail)] {
            // The end of a text's last line may be missing.
            let whole = bytes.len() - tail;
            for end in 0..whole {
                assert!(read_bytes(ply::read, &bytes[..end], &Selection::All).is_err(), "{format:?} {end}");
            }
        }
    }
    let text = sample("csv");
    for end in 0..text.len() {
        let _ = read_bytes(csv::read, &text[..end], &Selection::All);
    }
}

#[test]
fn every_bit_flip_is_survived() {
    let mut samples: Vec<Vec<u8>> = FORMATS.into_iter().map(rich_ply).collect();
    samples.push(sample("ply"));
    samples.push(sample("csv"));
    let begin = std::time::Instant::now();
    for sample in samples {
        for bit in 0..sample.len() * 8 {
            let mut bytes = sample.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            for reader in READERS {
                let _ = read_with(reader, &bytes, &Selection::All);
            }
        }
    }
    assert!(begin.elapsed().as_secs() < 60, "{:?}", begin.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        for reader in READERS {
            let _ = read_with(reader, &bytes, &Selection::All);
        }
    }

    #[test]
    fn random_words_of_the_formats_are_survived(
        words in proptest::collection::vec(prop::sample::select(vec![
            "ply", "format", "ascii", "binary_little_endian", "binary_big_endian", "1.0", "comment", "element", "vertex",
            "face", "property", "list", "float", "uchar", "int8", "double", "x", "y", "end_header", "\n", "\n", "\n", "3",
            "4000000000", "-1", "nan", "1e400", "\"", ",", "#", "\u{0}", "\r",
        ]), 0..60),
        data in proptest::collection::vec(any::<u8>(), 0..60),
    ) {
        let mut bytes = format!("ply\nformat {}", words.join(" ").replace(" \n ", "\n")).into_bytes();
        bytes.extend_from_slice(&data);
        for start in [0, 4] {
            for reader in READERS {
                let _ = read_with(reader, &bytes[start..], &Selection::All);
            }
        }
    }

    #[test]
    fn damaged_files_are_survived(
        at in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        format in prop::sample::select(FORMATS.to_vec()),
    ) {
        let mut bytes = rich_ply(format);
        for (index, byte) in at {
            let length = bytes.len();
            bytes[index.index(length)] = byte;
        }
        let _ = read_bytes(ply::read, &bytes, &Selection::All);
    }

    #[test]
    fn numbers_survive_text(rows in proptest::collection::vec(prop::array::uniform3(-1e300..1e300f64), 0..20)) {
        let text: Vec<String> = rows.iter().map(|[x, y, z]| format!("{x},{y:e},{z:?}\n")).collect();
        let columns = csv_text(&format!("x,y,z\n{}", text.concat())).map_err(TestCaseError::fail)?;
        prop_assert_eq!(values(&columns, "x"), rows.iter().map(|row| row[0]).collect::<Vec<_>>());
        prop_assert_eq!(values(&columns, "z"), rows.iter().map(|row| row[2]).collect::<Vec<_>>());
    }
}

// ---- from columns to particles ----

/// The particles that an entry makes of a text.
fn particles(text: &str, change: impl FnOnce(&mut ParticleEntry)) -> Result<ParticleSet, String> {
    let mut entry = file_entry(Path::new("cloud.csv"));
    change(&mut entry);
    let columns = read_bytes(csv::read, text.as_bytes(), &selection(&entry))?;
    from_columns(&entry, columns, Path::new("cloud.csv"), &mut Vec::new()).map_err(|error| error.to_string())
}

#[test]
fn what_the_file_lacks_is_uniform() {
    let set = particles("x,y,z\n1,2,3\n4,5,6\n", |entry| entry.scale = 2.0).unwrap();
    assert_eq!(set.radius, Attribute::Uniform(0.2));
    assert_eq!(set.opacity, Attribute::Uniform(0.5));
    assert_eq!(set.color, Attribute::Uniform([1.0; 3]));
    // Part of a colour is none: `r` may be a distance.
    let set = particles("x,y,z,r\n1,2,3,9\n", |_| ()).unwrap();
    assert_eq!(set.color, Attribute::Uniform([1.0; 3]));
}

#[test]
fn columns_are_moved_and_shared() {
    let set = particles("a,y,z,h\n1,2,3,4\n", |entry| {
        entry.columns = vec![
            ColumnMap::plain(Target::X, "a"),
            ColumnMap { scale: 10.0, offset: 1.0, ..ColumnMap::plain(Target::Radius, "a") },
            ColumnMap { scale: -1.0, min: Some(0.125), ..ColumnMap::plain(Target::Opacity, "h") },
            ColumnMap { max: Some(3.5), ..ColumnMap::plain(Target::G, "h") },
        ];
    })
    .unwrap();
    assert_eq!((set.x[0], set.y[0], set.z[0]), (1.0, 2.0, 3.0));
    assert_eq!((set.radius.get(0), set.opacity.get(0)), (11.0, 0.125));
    assert_eq!(set.color.get(0), [1.0, 3.5, 1.0]);
}

#[test]
fn column_errors() {
    let missing = particles("x,y,h\n1,2,3\n", |_| ()).unwrap_err();
    assert_says(&missing, &["cloud.csv", "no column `z` for z", "`x`, `y`, `h`"]);
    let missing = particles("x,y,z,h\n1,2,3,4\n", |entry| {
        entry.columns = vec![ColumnMap::plain(Target::Color, "H")];
    });
    assert_says(&missing.unwrap_err(), &["no column `H` for color", "`h`"]);
    let both = particles("x,y,z,h\n1,2,3,4\n", |entry| {
        entry.columns = vec![ColumnMap::plain(Target::Color, "h"), ColumnMap::plain(Target::G, "h")];
    });
    assert_says(&both.unwrap_err(), &["cloud.csv", "`g`"]);
    let opacity = particles("x,y,z,opacity\n1,2,3,0.5\n1,2,3,1\n", |_| ()).unwrap_err();
    assert_says(&opacity, &["cloud.csv", "particle 1", "opacity is 1", "0 <= opacity < 1"]);
    let radius = particles("x,y,z,radius\n1,2,3,0\n", |_| ()).unwrap_err();
    assert_says(&radius, &["particle 0", "radius is 0", "greater than 0"]);
}

#[test]
fn bytes_are_srgb_and_floats_are_linear() {
    let set = |kind: &str, names: [&str; 3], map: Option<ColumnMap>| {
        let properties =
            [("float", "x"), ("float", "y"), ("float", "z"), (kind, names[0]), (kind, names[1]), (kind, names[2])];
        let bytes = plain_ply(Format::Little, &properties, &[&[0.0, 0.0, 0.0, 0.0, 188.0, 255.0]]);
        let mut entry = file_entry(Path::new("cloud.ply"));
        entry.columns.extend(map);
        let columns = ply::read(&mut bytes.as_slice(), None, &selection(&entry)).unwrap();
        from_columns(&entry, columns, Path::new("cloud.ply"), &mut Vec::new()).unwrap().color.get(0)
    };
    // ((188/255 + 0.055)/1.055)^2.4
    let decoded = 0.502_886_5_f32;
    for names in [["red", "green", "blue"], ["r", "g", "b"]] {
        let color = set("uchar", names, None);
        assert_eq!((color[0], color[2]), (0.0, 1.0));
        assert!((color[1] - decoded).abs() < 1e-6, "{color:?}");
        assert_eq!(set("float", names, None), [0.0, 188.0, 255.0]);
    }
    let color =
        set("uchar", ["red", "green", "blue"], Some(ColumnMap { scale: 2.0, ..ColumnMap::plain(Target::R, "green") }));
    assert!((color[0] - 2.0 * decoded).abs() < 1e-6 && color[2] == 1.0, "{color:?}");
}

#[test]
fn colour_maps() {
    for map in COLOR_MAPS {
        assert_eq!(ColorMap::from_name(map.name), Some(*map));
        let table = map.table();
        assert_eq!(table.len(), 256);
        assert!(table.iter().flatten().all(|value| (0.0..=1.0).contains(value)), "{}", map.name);
    }
    assert_eq!(ColorMap::from_name("jet"), None);
    // viridis begins with #440154 and ends with #fde725.
    let viridis = ColorMap::from_name("viridis").unwrap().table();
    let decode = |byte: u8| ((f64::from(byte) / 255.0 + 0.055) / 1.055).powf(2.4);
    for (color, bytes) in [(viridis[0], [0x44, 0x01, 0x54]), (viridis[255], [0xfd, 0xe7, 0x25])] {
        for (value, byte) in color.iter().zip(bytes) {
            let expected = if byte < 11 { f64::from(byte) / 255.0 / 12.92 } else { decode(byte) };
            assert!((f64::from(*value) - expected).abs() < 1e-6, "{color:?}");
        }
    }
    let grey = ColorMap::from_name("grey").unwrap();
    for t in [f64::NEG_INFINITY, -1.0, 0.0, f64::NAN] {
        assert_eq!(look_up(&grey.table(), t), [0.0; 3]);
    }
    for t in [1.0, 2.0, f64::INFINITY] {
        assert_eq!(look_up(&grey.table(), t), [1.0; 3]);
    }
    assert_eq!(look_up(&[[0.0; 3], [1.0, 0.5, 0.25]], 0.5), [0.5, 0.25, 0.125]);

    let text = "x,y,z,v\n0,0,0,10\n0,0,0,20\n0,0,0,30\n";
    let colors = |min: Option<f64>, max: Option<f64>| {
        let map =
            ColumnMap { scale: 0.5, offset: 1.0, min, max, map: Some(grey), ..ColumnMap::plain(Target::Color, "v") };
        let set = particles(text, |entry| entry.columns = vec![map]).unwrap();
        [0, 1, 2].map(|i| set.color.get(i)[0])
    };
    // Scaled: 6, 11, 16. 128 of 255 is 0.2158605 in linear light, the middle of 127 and 128 is 0.21404...
    let middle = (decode(127) + decode(128)) as f32 / 2.0;
    let close = |found: [f32; 3], expected: [f32; 3]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
    };
    close(colors(Some(6.0), Some(16.0)), [0.0, middle, 1.0]);
    close(colors(Some(11.0), Some(21.0)), [0.0, 0.0, middle]);
    close(colors(None, None), [0.0, middle, 1.0]);
    close(colors(Some(16.0), Some(6.0)), [1.0, middle, 0.0]);
    close(colors(Some(11.0), Some(11.0)), [0.0, 0.0, 1.0]);
    let plain = particles(text, |entry| {
        entry.columns = vec![ColumnMap { scale: 0.01, max: Some(0.25), ..ColumnMap::plain(Target::Color, "v") }];
    });
    assert_eq!(plain.unwrap().color, Attribute::Each(vec![[0.1; 3], [0.2; 3], [0.25; 3]]));
}

// ---- transforms ----

fn assert_close(found: DVec3, expected: DVec3) {
    assert!((found - expected).length() < 1e-12, "{found} is not {expected}");
}

fn point(set: &ParticleSet, i: usize) -> DVec3 {
    DVec3::new(set.x[i], set.y[i], set.z[i])
}

#[test]
fn rotations_are_about_fixed_axes_x_first() {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    assert_close(world_from_set(DVec3::new(90.0, 0.0, 0.0)) * y, z);
    assert_close(world_from_set(DVec3::new(0.0, 90.0, 0.0)) * z, x);
    assert_close(world_from_set(DVec3::new(0.0, 0.0, 90.0)) * x, y);
    // y to z by x, z to x by y, x to y by z.
    assert_close(world_from_set(DVec3::new(90.0, 90.0, 90.0)) * y, y);
    // z to -y by x, -y stays, -y to x by z.
    assert_close(world_from_set(DVec3::new(90.0, 90.0, 90.0)) * z, x);
    // x stays, x to -z by y, -z stays.
    assert_close(world_from_set(DVec3::new(90.0, 90.0, 90.0)) * x, -z);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert_close(world_from_set(DVec3::new(0.0, 0.0, 45.0)) * x, DVec3::new(half, half, 0.0));
}

#[test]
fn scale_then_rotation_then_position() {
    let set = particles("x,y,z,radius\n1,2,3,0.5\n", |entry| {
        entry.scale = 2.0;
        entry.rotation_deg = DVec3::new(90.0, 0.0, 90.0);
        entry.position = DVec3::new(10.0, 20.0, 30.0);
    })
    .unwrap();
    // (2, 4, 6), about x: (2, -6, 4), about z: (6, 2, 4).
    assert_close(point(&set, 0), DVec3::new(16.0, 22.0, 34.0));
    assert_eq!(set.radius.get(0), 1.0);
}

#[test]
fn fit_centres_and_scales() {
    // Middle (2, 4, 0), longest side 8 along y: factor 0.5.
    let text = "x,y,z,radius\n1,0,0,1\n3,8,0,2\n2,2,0,3\n";
    let set = particles(text, |entry| {
        entry.fit = Some(4.0);
        entry.scale = 100.0;
        entry.rotation_deg = DVec3::new(0.0, 0.0, 90.0);
        entry.position = DVec3::new(0.0, 0.0, 5.0);
    })
    .unwrap();
    assert_close(point(&set, 0), DVec3::new(2.0, -0.5, 5.0));
    assert_close(point(&set, 1), DVec3::new(-2.0, 0.5, 5.0));
    assert_close(point(&set, 2), DVec3::new(1.0, 0.0, 5.0));
    assert_eq!(set.radius, Attribute::Each(vec![0.5, 1.0, 1.5]), "a file's radius is a length of the file");
    let set = particles("x,y,z\n1,0,0\n3,8,0\n", |entry| entry.fit = Some(4.0)).unwrap();
    assert_eq!(set.radius, Attribute::Uniform(0.1), "the entry's radius is in scene units");
    // Columns are scaled before the extent is taken: y from 0 to 80, middle 40, factor 0.05.
    let set = particles("x,y,z\n1,0,0\n3,8,0\n", |entry| {
        entry.fit = Some(4.0);
        entry.columns = vec![ColumnMap { scale: 10.0, ..ColumnMap::plain(Target::Y, "y") }];
    })
    .unwrap();
    assert_close(point(&set, 1), DVec3::new(0.05, 2.0, 0.0));
    for text in ["x,y,z,radius\n7,8,9,0.5\n", "x,y,z,radius\n7,8,9,0.5\n7,8,9,0.5\n"] {
        let set = particles(text, |entry| entry.fit = Some(4.0)).unwrap();
        assert_close(point(&set, 0), DVec3::ZERO);
        assert_eq!(set.radius.get(0), 0.5, "no extent: scale 1");
    }
    assert!(particles("x,y,z\n", |entry| entry.fit = Some(4.0)).unwrap().is_empty());
}

// ---- boxes ----

#[test]
fn box_numbers_are_frozen() {
    // From an implementation of ChaCha8 (RFC 8439 with 8 rounds) written for this test in another language.
    let golden: &[(usize, [f64; 3])] = &[
        (0, [-0.41287139432739517, 0.6368424706400729, -2.16776436533325]),
        (1, [0.6883450082702156, 2.355813334193908, -2.3800727039744585]),
        (2, [-2.427480343006562, 2.4227361510914673, -1.642066949563586]),
        (11, [-1.7420857070847207, 2.574257206402412, 1.1399633546395025]),
    ];
    let (min, max) = (DVec3::new(-3.0, 0.0, -3.0), DVec3::new(3.0, 3.0, 3.0));
    let [x, y, z] = box_positions(min, max, 100, 17).unwrap();
    for &(i, point) in golden {
        assert_eq!([x[i], y[i], z[i]], point, "particle {i}");
    }
    // A longer box begins with a shorter one; another seed is another box.
    assert_eq!(box_positions(min, max, 10, 17).unwrap()[2], z[..10]);
    assert_ne!(box_positions(min, max, 10, 18).unwrap()[0], x[..10]);
    assert_ne!(box_positions(min, max, 10, 17 + (1 << 40)).unwrap()[0], x[..10]);
}

#[test]
fn boxes_are_evenly_filled() {
    let (min, max) = (DVec3::new(-1.0, 2.0, 0.0), DVec3::new(1.0, 2.0, 10.0));
    let count = 100_000;
    let [x, y, z] = box_positions(min, max, count, 3).unwrap();
    assert!(y.iter().all(|&y| y == 2.0));
    for (values, low, high) in [(x, -1.0, 1.0), (z, 0.0, 10.0)] {
        assert!(values.iter().all(|v| (low..high).contains(v)));
        // Chi-squared of 50 cells: mean 49, standard deviation 9.9; the seed is fixed.
        let mut cells = [0.0; 50];
        values.iter().for_each(|v| cells[((v - low) / (high - low) * 50.0) as usize] += 1.0);
        let expected = count as f64 / 50.0;
        let chi: f64 = cells.iter().map(|n| (n - expected) * (n - expected) / expected).sum();
        assert!(chi < 90.0, "{chi}");
    }
}

#[test]
fn box_entries() {
    let source = Source::Box { min: DVec3::ZERO, max: DVec3::ONE, count: 5, seed: 1 };
    let mut box_entry = entry(source);
    box_entry.position = DVec3::new(0.0, 100.0, 0.0);
    box_entry.scale = 2.0;
    let set = particle_set(&box_entry, "[[particles]] 2", &(), &mut Vec::new()).unwrap();
    assert!(set.y.iter().all(|y| (100.0..102.0).contains(y)));
    assert_eq!(set.radius, Attribute::Uniform(0.2));
    box_entry.opacity = 1.0;
    assert_says(
        &particle_set(&box_entry, "[[particles]] 2", &(), &mut Vec::new()).unwrap_err().to_string(),
        &["[[particles]] 2", "opacity is 1"],
    );
    let huge = Source::Box { min: DVec3::ZERO, max: DVec3::ONE, count: MAX_BOX_COUNT + 1, seed: 1 };
    let message = particle_set(&entry(huge), "[[particles]] 2", &(), &mut Vec::new()).unwrap_err().to_string();
    assert_says(&message, &["[[particles]] 2", "count is 100000001", "at most 100000000"]);
}

// ---- profiles ----

#[test]
fn profiles() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("profile.csv");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        read_profile(&path).map_err(|error| error.to_string())
    };
    let expected = Ok((vec![0.0, 0.5, 1.0], vec![2.0, 1.0, 0.0]));
    assert_eq!(read("q,density\n0,2\n0.5,1\n1,0\n"), expected);
    assert_eq!(read("# no header\r\n0,2\r\n\r\n0.5,1\r\n1,0"), expected);
    for (text, parts) in [
        ("0,1\n", &["1 rows", "at least 2"][..]),
        ("", &["at least 2"]),
        ("q,density\n", &["at least 2"]),
        ("q,density\nq,density\n0,1\n1,0\n", &["line 2, column `q`", "not a number"]),
        ("0.1,1\n1,0\n", &["line 1, column `q`", "first q is 0.1"]),
        ("q,k\n0,1\n0.9,0\n\n", &["line 3, column `q`", "last q is 0.9", "allowed: 1"]),
        ("0,1\n0.5,1\n0.5,1\n1,1\n", &["line 3", "0.5 after 0.5", "ascending"]),
        ("0,1\n1.5,1\n", &["line 2", "1.5", "0 to 1"]),
        ("0,1\n1,-1\n", &["line 2, column `density`", "-1"]),
        ("0,1\n1,inf\n", &["line 2, column `density`", "not finite"]),
        ("0,abc\n1,0\n", &["line 1, column `density`: `abc`"]),
        ("0,1,2\n1,0,2\n", &["line 1: 3 fields where a profile has 2"]),
        ("0,0\n1,0\n", &["every density is 0"]),
    ] {
        let message = read(text).unwrap_err();
        assert_says(&message, &["profile.csv"]);
        assert_says(&message, parts);
    }
    assert_says(&read_profile(&folder.path().join("none.csv")).unwrap_err().to_string(), &["none.csv", "cannot open"]);
}

#[test]
fn boxes_hold_as_many_as_asked_and_fill_as_much() {
    let of = |count: u64, radius: Option<f64>| {
        let source = Source::Box { min: DVec3::ZERO, max: DVec3::ONE, count, seed: 1 };
        ParticleEntry { radius, ..entry(source) }
    };
    let count = |entry: &ParticleEntry| match &entry.source {
        Source::Box { count, .. } => *count,
        Source::File(_) => panic!("no box"),
    };
    for total in [1, 2, 7, 60, 61, 480, 1_000_003, MAX_BOX_COUNT] {
        let before = [of(40, Some(0.2)), of(0, None), of(13, None), of(7, Some(1.5))];
        let mut after = before.clone();
        populate(&mut after, total).unwrap();
        assert_eq!(after.iter().map(count).sum::<u64>(), total);
        for (a, b) in before.iter().zip(&after) {
            let share = count(a) as f64 / 60.0 * total as f64;
            assert!((count(b) as f64 - share).abs() < 1.0, "{total}: {share}");
            // What all of them fill is as much as before.
            let ratio = b.radius.unwrap() / a.radius.unwrap_or(0.1);
            assert!((ratio.powi(3) * total as f64 / 60.0 - 1.0).abs() < 1e-12, "{total}: {ratio}");
            assert_eq!(ParticleEntry { source: a.source.clone(), radius: a.radius, ..b.clone() }, *a);
        }
    }
    let refused = |mut entries: Vec<ParticleEntry>, total: u64| populate(&mut entries, total).unwrap_err();
    assert!(refused(vec![of(4, None)], 0).contains("allowed"));
    assert!(refused(vec![of(4, None)], MAX_BOX_COUNT + 1).contains("allowed"));
    assert!(refused(vec![of(0, None)], 5).contains("no particles") && refused(vec![], 5).contains("no particles"));
    let message = refused(vec![of(4, None), file_entry(Path::new("a.csv"))], 5);
    assert!(message.contains("[[particles]] 2") && message.contains("a.csv"), "{message}");
}
