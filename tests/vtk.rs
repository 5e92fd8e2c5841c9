//! VTK files, legacy and XML: every encoding, the names of the columns, what is refused and how, damage.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::{Compression, write::ZlibEncoder};
use proptest::prelude::*;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use stereomist::input::{Columns, ReadError, Selection, vtk, vtp};

// ---- reading ----

type Read = fn(&mut dyn BufRead, Option<u64>, &Selection) -> Result<Columns, ReadError>;

/// A reader's result on bytes in memory, which does not depend on how they arrive.
fn read_by(read: Read, bytes: &[u8], selection: &Selection) -> Result<Columns, String> {
    let sized = read(&mut &bytes[..], Some(bytes.len() as u64), selection).map_err(|error| error.to_string());
    let streamed = read(&mut BufReader::with_capacity(7, bytes), None, selection).map_err(|error| error.to_string());
    match (&sized, streamed) {
        // Compared as text, in which NaN is equal to itself.
        (Ok(sized), Ok(streamed)) => assert_eq!(format!("{sized:?}"), format!("{streamed:?}")),
        (Err(_), Err(_)) => {}
        (Err(message), Ok(_)) => assert!(message.contains("truncated"), "{message}"),
        (Ok(_), Err(error)) => panic!("only without the size: {error}"),
    }
    sized
}

fn read_all(bytes: &[u8]) -> Result<Columns, String> {
    let read: Read = if vtp::detect(bytes) { vtp::read } else { vtk::read };
    read_by(read, bytes, &Selection::All)
}

fn legacy(text: impl AsRef<[u8]>) -> Result<Columns, String> {
    read_by(vtk::read, text.as_ref(), &Selection::All)
}

fn xml(text: impl AsRef<[u8]>) -> Result<Columns, String> {
    read_by(vtp::read, text.as_ref(), &Selection::All)
}

fn values<'a>(columns: &'a Columns, name: &str) -> &'a [f64] {
    &columns.get(name).unwrap_or_else(|| panic!("no column {name} in {:?}", columns.names())).values
}

#[track_caller]
fn assert_says(result: Result<Columns, String>, parts: &[&str]) {
    let message = result.expect_err("the file is wrong");
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing in: {message}");
    }
}

/// The files that VTK wrote, with their names.
fn vtk_files() -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/vtk");
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension != "py"))
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(path).unwrap()))
        .collect();
    files.sort();
    assert_eq!(files.len(), 16);
    files
}

#[test]
fn vtk_wrote_the_same_cloud_in_every_encoding() {
    for (name, bytes) in vtk_files() {
        assert!(bytes.len() < 3000, "{name}");
        let columns = read_all(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        let expected: [(&str, [f64; 4]); 12] = [
            ("x", [-0.5, -0.125, 0.25, 0.625]),
            ("y", [-0.375, 0.0, 0.375, 0.75]),
            ("z", [-0.25, 0.125, 0.5, 0.875]),
            ("r", [0.0, 69.0, 138.0, 207.0]),
            ("g", [23.0, 92.0, 161.0, 230.0]),
            ("b", [46.0, 115.0, 184.0, 253.0]),
            ("my velocity_x", [-2.96484375, -2.9765625, -2.98828125, -3.0]),
            ("my velocity_y", [-2.9609375, -2.97265625, -2.984375, -2.99609375]),
            ("my velocity_z", [-2.95703125, -2.96875, -2.98046875, -2.9921875]),
            ("ids", [7.0, 1007.0, 2007.0, 3007.0]),
            ("big", [-(2f64.powi(63)), 2f64.powi(62), 0.0, -1.0]),
            ("flag", [0.0, 1.0, 0.0, 0.0]),
        ];
        assert_eq!(columns.names(), expected.map(|(name, _)| name), "{name}");
        assert_eq!(columns.len(), 4, "{name}");
        for (column, values) in columns.iter().zip(expected) {
            assert_eq!((column.name.as_str(), column.values.as_slice()), (values.0, values.1.as_slice()), "{name}");
            assert_eq!(column.byte, ["r", "g", "b"].contains(&values.0), "{name}: {}", values.0);
        }
        assert_eq!(columns.color_names(), Some(["r", "g", "b"]), "{name}");
        assert!(columns.notes.iter().all(|note| note.contains("data of cells")), "{name}: {:?}", columns.notes);
    }
}

#[test]
fn only_selected_columns_are_kept() {
    for (name, bytes) in vtk_files() {
        let read: Read = if vtp::detect(&bytes) { vtp::read } else { vtk::read };
        let columns = read_by(read, &bytes, &Selection::named(["g", "z", "my velocity_y", "none"])).unwrap();
        let kept: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(kept, ["z", "g", "my velocity_y"], "{name}");
        assert_eq!(values(&columns, "g"), [23.0, 92.0, 161.0, 230.0], "{name}");
        assert_eq!(columns.names().len(), 12, "{name}");
        let none = read_by(read, &bytes, &Selection::named(["none"])).unwrap();
        assert_eq!((none.len(), none.iter().count()), (4, 0), "{name}");
    }
}

#[test]
fn content_is_detected() {
    for (name, bytes) in vtk_files() {
        assert_eq!(vtk::detect(&bytes), name.ends_with(".vtk"), "{name}");
        assert_eq!(vtp::detect(&bytes), !name.ends_with(".vtk"), "{name}");
    }
    assert!(vtp::detect(b"\xEF\xBB\xBF<?xml version=\"1.0\"?>\n<!-- a -->\n<VTKFile type=\"PolyData\">"));
    assert!(!vtp::detect(b"<?xml version=\"1.0\"?><svg/>"));
    assert!(!vtp::detect(b"x,y,z\n<VTKFile"));
    assert!(!vtp::detect(b""));
}

// ---- legacy ----

/// A legacy file in text with two points and what follows them.
fn text_file(rest: &str) -> String {
    format!("# vtk DataFile Version 3.0\ntitle\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n1 2 3\n4 5 6\n{rest}")
}

/// The same in binary, with pieces of text and of data.
fn binary_file(version: &str, rest: &[&[u8]]) -> Vec<u8> {
    let mut bytes = format!("# vtk DataFile Version {version}\ntitle\nBINARY\nDATASET POLYDATA\nPOINTS 2 double\n");
    let mut bytes = std::mem::take(&mut bytes).into_bytes();
    for value in [1.0f64, 2.0, 3.0, 4.0, 5.0, 6.0] {
        bytes.extend(value.to_be_bytes());
    }
    bytes.push(b'\n');
    bytes.extend(rest.concat());
    bytes
}

#[test]
fn every_attribute_becomes_columns() {
    let columns = legacy(text_file(
        "POINT_DATA 2\nscalars one float\nlookup_table default\n1 2\nSCALARS two double 2\nLOOKUP_TABLE t\n1 2 3 4\n\
         LOOKUP_TABLE t 2\n0 0 0 1 1 1 1 1\nVectors v int\n1 2 3 4 5 6\nNORMALS n float\n0 0 1 0 1 0\n\
         TENSORS t double\n1 2 3\n4 5 6\n7 8 9\n\n9 8 7\n6 5 4\n3 2 1\nTENSORS6 t6 double\n1 2 3 4 5 6 7 8 9 10 11 12\n\
         TEXTURE_COORDINATES uv 2 float\n0 1 2 3\nGLOBAL_IDS g vtkIdType\n3000000000 1\nPEDIGREE_IDS p int\n5 6\n\
         EDGE_FLAGS e unsigned_char\n0 1\nCOLOR_SCALARS shade 1\n0 1\nCOLOR_SCALARS shade2 4\n0 0.2 0.4 1  1 1 1 0.5\n\
         FIELD more 3\nNULL_ARRAY\na%20b 1 2 short\n-1 2\nc 5 2 float\n1 2 3 4 5 6 7 8 9 10\n",
    ))
    .unwrap();
    let expected: Vec<String> = "x y z one two_x two_y v_x v_y v_z n_x n_y n_z t_0 t_1 t_2 t_3 t_4 t_5 t_6 t_7 t_8 \
                                 t6_0 t6_1 t6_2 t6_3 t6_4 t6_5 uv_x uv_y g p e shade r g_2 b a a_b c_0 c_1 c_2 c_3 c_4"
        .split_whitespace()
        .map(|name| name.replace("a_b", "a b"))
        .collect();
    // The colour's green meets the identifiers' name: all of its columns get the number.
    let expected: Vec<String> = expected
        .into_iter()
        .map(|name| match name.as_str() {
            "r" | "b" | "a" => format!("{name}_2"),
            _ => name,
        })
        .collect();
    assert_eq!(columns.names(), expected);
    assert_eq!(columns.color_names(), None);
    assert_eq!(values(&columns, "x"), [1.0, 4.0]);
    assert_eq!(values(&columns, "two_y"), [2.0, 4.0]);
    assert_eq!(values(&columns, "t_5"), [6.0, 4.0]);
    assert_eq!(values(&columns, "t6_5"), [6.0, 12.0]);
    assert_eq!(values(&columns, "g"), [3e9, 1.0]);
    assert_eq!(values(&columns, "shade"), [0.0, 255.0]);
    assert_eq!(values(&columns, "g_2"), [51.0, 255.0]);
    assert_eq!(values(&columns, "a_2"), [255.0, 128.0]);
    assert_eq!(values(&columns, "a b"), [-1.0, 2.0]);
    assert_eq!(values(&columns, "c_4"), [5.0, 10.0]);
    for (name, byte) in [("shade", true), ("r_2", true), ("e", true), ("one", false), ("x", false)] {
        assert_eq!(columns.get(name).unwrap().byte, byte, "{name}");
    }
}

#[test]
fn text_is_rounded_as_binary_data_are() {
    let columns = legacy(text_file(
        "POINT_DATA 2\nSCALARS a float\nLOOKUP_TABLE default\n0.1 1e-50\nSCALARS b double\nLOOKUP_TABLE default\n\
         0.1 1e-50\nSCALARS c long\nLOOKUP_TABLE default\n9223372036854775807 -9223372036854775808\n\
         SCALARS d unsigned_long\nLOOKUP_TABLE default\n18446744073709551615 9007199254740993\n",
    ))
    .unwrap();
    assert_eq!(values(&columns, "a"), [f64::from(0.1f32), 0.0]);
    assert_eq!(values(&columns, "b"), [0.1, 1e-50]);
    assert_eq!(values(&columns, "c"), [i64::MAX as f64, i64::MIN as f64]);
    assert_eq!(values(&columns, "d"), [u64::MAX as f64, 9007199254740993u64 as f64]);
}

#[test]
fn every_type_is_read_in_text_and_binary() {
    type Bytes = fn(f64) -> Vec<u8>;
    let kinds: [(&str, Bytes); 22] = [
        ("char", |v| (v as i8).to_be_bytes().to_vec()),
        ("signed_char", |v| (v as i8).to_be_bytes().to_vec()),
        ("unsigned_char", |v| (v as u8).to_be_bytes().to_vec()),
        ("short", |v| (v as i16).to_be_bytes().to_vec()),
        ("unsigned_short", |v| (v as u16).to_be_bytes().to_vec()),
        ("int", |v| (v as i32).to_be_bytes().to_vec()),
        ("unsigned_int", |v| (v as u32).to_be_bytes().to_vec()),
        ("long", |v| (v as i64).to_be_bytes().to_vec()),
        ("unsigned_long", |v| (v as u64).to_be_bytes().to_vec()),
        ("long_long", |v| (v as i64).to_be_bytes().to_vec()),
        ("unsigned_long_long", |v| (v as u64).to_be_bytes().to_vec()),
        ("vtkIdType", |v| (v as i32).to_be_bytes().to_vec()),
        ("vtktypeint8", |v| (v as i8).to_be_bytes().to_vec()),
        ("vtktypeuint8", |v| (v as u8).to_be_bytes().to_vec()),
        ("vtktypeint16", |v| (v as i16).to_be_bytes().to_vec()),
        ("vtktypeuint16", |v| (v as u16).to_be_bytes().to_vec()),
        ("vtktypeint32", |v| (v as i32).to_be_bytes().to_vec()),
        ("vtktypeuint32", |v| (v as u32).to_be_bytes().to_vec()),
        ("vtktypeint64", |v| (v as i64).to_be_bytes().to_vec()),
        ("VTKTYPEUINT64", |v| (v as u64).to_be_bytes().to_vec()),
        ("float", |v| (v as f32).to_be_bytes().to_vec()),
        ("DOUBLE", |v| v.to_be_bytes().to_vec()),
    ];
    for (kind, encode) in kinds {
        let small = if kind.to_lowercase().contains('u') && kind != "double" && kind != "DOUBLE" { 3.0 } else { -3.0 };
        let text = legacy(text_file(&format!("POINT_DATA 2\nFIELD f 1\na 1 2 {kind}\n{small} 101\n"))).unwrap();
        let header = format!("POINT_DATA 2\nFIELD f 1\na 1 2 {kind}\n");
        let data = [encode(small), encode(101.0)].concat();
        let binary = legacy(binary_file("3.0", &[header.as_bytes(), &data, b"\n"])).unwrap();
        assert_eq!(values(&text, "a"), [small, 101.0], "{kind}");
        assert_eq!(text, binary, "{kind}");
    }
    // 12 bits: the order of the bits, and that tuples do not begin with a byte.
    let bits = legacy(binary_file("3.0", &[b"POINT_DATA 2\nFIELD f 1\na 5 2 bit\n", &[0b1010_0110, 0b0100_0000]]));
    let text = legacy(text_file("POINT_DATA 2\nFIELD f 1\na 5 2 bit\n1 0 1 0 0 1 1 0 0 1"));
    assert_eq!(bits, text);
    assert_eq!(values(&text.unwrap(), "a_0"), [1.0, 1.0]);
    assert_says(legacy(text_file("POINT_DATA 2\nFIELD f 1\na 1 2 half\n1 2")), &["line 10", "`half`", "unsigned_char"]);
    assert_says(
        legacy(text_file("POINT_DATA 2\nFIELD f 1\na 1 2 unsigned_char\n1 256")),
        &["line 11", "component 0 of point 1 in array `a`", "`256`", "0 to 255"],
    );
    assert_says(legacy(text_file("POINT_DATA 2\nFIELD f 1\na 1 2 bit\n1 2")), &["`2` is no bit", "0 or 1"]);
    assert_says(legacy(text_file("POINT_DATA 2\nFIELD f 1\na 1 2 float\n1 1e39")), &["1e39", "does not fit a float"]);
}

#[test]
fn what_is_no_point_data_is_passed_over() {
    let old = "VERTICES 1 2\n1 0\nLINES 1 3\n2 0 1\nPOLYGONS 0 0\nTRIANGLE_STRIPS 0 0\nCELL_DATA 2\nSCALARS s float\n\
               LOOKUP_TABLE default\n1 2\nCOLOR_SCALARS c 3\n0 0 0 1 1 1\nPOINT_DATA 2\nSCALARS a int 1\n\
               LOOKUP_TABLE default\n7 8\nCELL_DATA 2\nFIELD f 1\nb 1 2 string\n\n\n";
    let legacy = |file: &dyn AsRef<[u8]>| {
        let mut columns = legacy(file.as_ref()).unwrap();
        let notes = std::mem::take(&mut columns.notes);
        (columns, notes)
    };
    let (expected, notes) = legacy(&text_file(old));
    assert!(notes.len() == 1 && notes[0].contains("data of cells"), "{notes:?}");
    assert_eq!(expected.names(), ["x", "y", "z", "a"]);
    assert_eq!(values(&expected, "a"), [7.0, 8.0]);
    let new = "METADATA\nCOMPONENT_NAMES\nx\n\nz\nINFORMATION 1\n\nNAME L2 LOCATION vtkDataArray\nDATA 2 0 1\n\n\
               VERTICES 2 1\nOFFSETS vtktypeint64\n0 1\nMETADATA\nINFORMATION 0\n\nCONNECTIVITY vtktypeint64\n0\n\
               CELL_TYPES 1\n1\nPOINT_DATA 2\nMETADATA\n\nSCALARS a int\nLOOKUP_TABLE default\n7 8\nMETADATA\n\n\
               FIELD f 2\ns 2 2 string\nPOINTS%20\n\nFIELD\nlast\nv 1 2 variant\n6 1.5 13 word\n";
    let text = text_file(new).replace("Version 3.0", "Version 5.1").replace("POLYDATA", "unstructured_grid");
    assert_eq!(legacy(&text), (expected.clone(), Vec::new()));
    let field = "FIELD FieldData 2\nTIME 1 1 double\n0.5\nnote 1 2 string\nPOINTS 3 float\n\n\n\nPOINTS 2";
    assert_eq!(legacy(&text_file(old).replace("POINTS 2", field)).0, expected);
    let windows = text_file(old).replace('\n', "\r\n");
    assert_eq!(legacy(&windows).0, expected);

    let long = vec![b'x'; 300];
    let longer = vec![b'y'; 70_000];
    let strings = [
        b"FIELD f 1\ns 1 4 string\n\xC3abc".as_slice(),
        &[0x80 | 1, 44],
        &long,
        &[0x40, 1, 0x11, 0x70],
        &longer,
        &[0, 0, 0, 0, 0, 0, 0, 2],
        b"zz\n",
    ]
    .concat();
    let cells = [b"VERTICES 1 2\n".as_slice(), &[0, 0, 0, 1, 0, 0, 0, 0], b"\nLINES 0 0\n"].concat();
    let scalars = b"POINT_DATA 2\nSCALARS a int 1\nLOOKUP_TABLE default\n\0\0\0\x07\0\0\0\x08\n\
                    LOOKUP_TABLE t 1\n\x01\x02\x03\x04\nCELL_DATA 1\nCOLOR_SCALARS q 2\n\xFE\xFF";
    let bytes = binary_file("4.2", &[&strings, &cells, scalars, b""]);
    let (columns, _) = legacy(&bytes);
    assert_eq!(values(&columns, "a"), [7.0, 8.0]);
    assert_eq!(columns.names(), ["x", "y", "z", "a"]);
}

#[test]
fn binary_line_ends_may_be_of_two_characters() {
    let bytes =
        binary_file("3.0", &[b"POINT_DATA 2\r\nSCALARS a int 1\r\nLOOKUP_TABLE default\r\n\0\0\0\x0A\0\0\0\x0D\r\n"]);
    assert_eq!(values(&legacy(bytes).unwrap(), "a"), [10.0, 13.0]);
}

#[test]
fn names_are_made_unique_and_colours_found() {
    let names = |arrays: &[(&str, u32, &str)]| {
        let arrays = arrays.iter().map(|(name, components, kind)| {
            let values = vec!["1"; 2 * *components as usize].join(" ");
            format!("{name} {components} 2 {kind}\n{values}\n")
        });
        let arrays: Vec<String> = arrays.collect();
        let columns =
            legacy(text_file(&format!("POINT_DATA 2\nFIELD f {}\n{}", arrays.len(), arrays.concat()))).unwrap();
        (columns.names()[3..].join(" "), columns.color_names().map(|names| names.join(" ")))
    };
    let rgb = Some("r g b".to_owned());
    assert_eq!(names(&[("x", 1, "int"), ("x", 1, "int"), ("x_2", 1, "int")]).0, "x_2 x_3 x_2_2");
    assert_eq!(names(&[("Colours", 3, "unsigned_char"), ("r", 1, "float")]), ("r g b r_2".into(), rgb.clone()));
    assert_eq!(names(&[("r", 1, "float"), ("RGBA", 4, "float")]), ("r r_2 g_2 b_2 a_2".into(), None));
    for name in ["rgb", "rgba", "color", "Colors", "colour", "colours"] {
        assert_eq!(names(&[(name, 3, "float")]), ("r g b".into(), rgb.clone()), "{name}");
    }
    assert_eq!(names(&[("rgb", 2, "float"), ("rgb", 1, "float")]), ("rgb_x rgb_y rgb".into(), None));
    let own = [("red", 1, "float"), ("green", 1, "float"), ("blue", 1, "float")];
    assert_eq!(names(&own), ("red green blue".into(), Some("red green blue".into())));
    assert_eq!(names(&[("v", 4, "int"), ("v", 2, "int"), ("v", 2, "int")]).0, "v_0 v_1 v_2 v_3 v_x v_y v_x_2 v_y_2");
}

#[test]
fn wrong_legacy_files_are_refused() {
    let cases: &[(&str, &str, &[&str])] = &[
        ("# vtk DataFile Version 3.0", "solid", &["line 1", "`solid`", "# vtk DataFile Version"]),
        ("ASCII", "ASCI", &["line 3", "`ASCI`", "`ASCII` or `BINARY`"]),
        ("DATASET", "FIELD", &["line 4", "`FIELD`", "DATASET POLYDATA"]),
        (
            "POLYDATA",
            "STRUCTURED_POINTS",
            &["line 4", "`STRUCTURED_POINTS`", "POLYDATA, UNSTRUCTURED_GRID", "ParaView"],
        ),
        ("POLYDATA", "rectilinear_grid", &["`rectilinear_grid`", "POLYDATA"]),
        ("POINTS 2", "POINTS two", &["line 5", "`two`", "number of points", "integer from 0"]),
        ("POINTS 2", "POINTS 4294967296", &["4294967296 points", "at most 4294967295"]),
        ("POINTS 2", "POINTS 2000000", &["line 5", "6000000 values", "truncated"]),
        ("2 float", "2 string", &["`string`", "a type of numbers"]),
        ("1 2 3", "1 2 nan", &["line 6", "component 2 of point 0 in array `points`", "`nan`", "finite"]),
        ("1 2 3", "1 2 3d0", &["line 6", "`3d0`", "not a number"]),
        ("4 5 6", "4 5", &["line 8", "`POINT_DATA`", "not a number"]),
        ("POINT_DATA 2", "POINT_DATA 3", &["line 8", "POINT_DATA of 3 points", "POINTS has 2"]),
        ("POINT_DATA 2", "POINTS 2 float 1 2 3 4 5 6", &["POINTS stands twice"]),
        ("POINT_DATA 2", "ROW_DATA 2", &["line 8", "`ROW_DATA`", "POINT_DATA, CELL_DATA"]),
        ("SCALARS", "SCALAR", &["line 9", "`SCALAR`", "SCALARS, COLOR_SCALARS"]),
        ("LOOKUP_TABLE default", "7 8", &["`8`", "SCALARS a", "LOOKUP_TABLE default"]),
        ("SCALARS a float\nLOOKUP_TABLE default", "FIELD f 1\na 1 3 float", &["array `a` has 3 tuples for 2 points"]),
        ("SCALARS a float\nLOOKUP_TABLE default", "COLOR_SCALARS c 1", &["`7`", "from 0 to 1"]),
        ("SCALARS a float", "SCALARS a float 2000", &["array `a` has 2000 components", "at most 1024"]),
        ("7 8", "7", &["line 10", "2 values of `a` need at least 3 bytes", "2 are left", "truncated"]),
        ("7 8", "7 \n", &["line 12", "ends after 1 of the 2 values of `a`"]),
        ("SCALARS a", &format!("SCALARS {}", "n".repeat(300)), &["300 bytes", "at most 256"]),
        ("SCALARS a", &format!("SCALARS {}", "n".repeat(5000)), &["longer than 4096 bytes"]),
    ];
    let good = text_file("POINT_DATA 2\nSCALARS a float\nLOOKUP_TABLE default\n7 8");
    assert!(legacy(&good).is_ok());
    for (from, to, says) in cases {
        assert!(good.contains(from));
        assert_says(legacy(good.replacen(from, to, 1)), says);
    }
    let new = text_file("VERTICES 1 2\n1 0").replace("3.0", "5.1");
    assert_says(legacy(new), &["`1` where OFFSETS is expected", "version 5"]);
    assert_says(legacy(text_file("").replace("POINTS", "POINT_DATA")), &["POINT_DATA before POINTS"]);
    assert_says(legacy("# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n"), &["without POINTS"]);
    assert_says(legacy(""), &["line 1"]);

    let mut bytes = binary_file("3.0", &[]);
    let data = bytes.len() - 49;
    bytes[data + 8 * 4..data + 8 * 5].copy_from_slice(&f64::INFINITY.to_be_bytes());
    let place = format!("byte {}", data + 8 * 4);
    assert_says(legacy(&bytes), &[&place, "component 1 of point 1 in array `points` is inf", "finite"]);
    let lenient = read_by(vtk::read, &bytes, &Selection::Survey(vec!["x".into(), "y".into()])).unwrap();
    assert!(values(&lenient, "y")[0] == 2.0 && values(&lenient, "y")[1].is_nan());
    let other = read_by(vtk::read, &bytes, &Selection::named(["x"])).unwrap();
    assert_eq!(values(&other, "x"), [1.0, 4.0]);
    let long = binary_file("3.0", &[b"POINT_DATA 2\nFIELD f 1\na 1 2 long\n\0\0\0\x01\0\0\0\x02\nVECTORS v float\n"]);
    assert_says(legacy(long), &["8 bytes"]);
    let extra = binary_file("3.0", &[b"POINT_DATA 2\nFIELD f 1\na 1 2 int 3\n\0\0\0\x01\0\0\0\x02"]);
    assert_says(legacy(extra), &["` 3` where the line ends"]);
}

#[test]
fn text_that_is_no_number_is_nan_for_a_survey() {
    let text = text_file("POINT_DATA 2\nSCALARS a float\nLOOKUP_TABLE default\ninf -\n");
    let columns = read_by(vtk::read, text.as_bytes(), &Selection::Survey(vec!["a".into(), "x".into()])).unwrap();
    assert!(values(&columns, "a").iter().all(|value| value.is_nan()));
    assert_eq!(values(&columns, "x"), [1.0, 4.0]);
    // What nobody asked for may be anything.
    assert!(read_by(vtk::read, text.as_bytes(), &Selection::named(["x"])).is_ok());
}

// ---- XML ----

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Ascii,
    Inline,
    Raw,
    Base64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Packing {
    None,
    Zlib,
    Lz4,
}

/// How a file of a test is written.
#[derive(Clone, Copy, Debug)]
struct Style {
    mode: Mode,
    packing: Packing,
    wide: bool,
    big: bool,
    block: usize,
    /// Whether the appended data stand in the reverse order of the tags.
    reversed: bool,
}

const PLAIN: Style =
    Style { mode: Mode::Ascii, packing: Packing::None, wide: false, big: false, block: 16, reversed: false };

const KINDS: [&str; 10] =
    ["Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64"];

/// One array: type, name, components, values.
type Array<'a> = (&'a str, &'a str, usize, Vec<f64>);

fn number_bytes(kind: &str, value: f64, big: bool) -> Vec<u8> {
    let mut bytes = match kind {
        "Int8" => (value as i8).to_le_bytes().to_vec(),
        "UInt8" => (value as u8).to_le_bytes().to_vec(),
        "Int16" => (value as i16).to_le_bytes().to_vec(),
        "UInt16" => (value as u16).to_le_bytes().to_vec(),
        "Int32" => (value as i32).to_le_bytes().to_vec(),
        "UInt32" => (value as u32).to_le_bytes().to_vec(),
        "Int64" => (value as i64).to_le_bytes().to_vec(),
        "UInt64" => (value as u64).to_le_bytes().to_vec(),
        "Float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    if big {
        bytes.reverse();
    }
    bytes
}

impl Style {
    fn header(self, numbers: &[usize]) -> Vec<u8> {
        let kind = if self.wide { "UInt64" } else { "UInt32" };
        numbers.iter().flat_map(|&number| number_bytes(kind, number as f64, self.big)).collect()
    }

    /// Header and data of an array.
    fn pack(self, data: &[u8]) -> [Vec<u8>; 2] {
        if self.packing == Packing::None {
            return [self.header(&[data.len()]), data.to_vec()];
        }
        let blocks: Vec<Vec<u8>> = data
            .chunks(self.block)
            .map(|block| match self.packing {
                Packing::Lz4 => lz4_flex::block::compress(block),
                _ => {
                    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
                    encoder.write_all(block).unwrap();
                    encoder.finish().unwrap()
                }
            })
            .collect();
        let mut numbers = vec![blocks.len(), self.block, data.len() % self.block];
        numbers.extend(blocks.iter().map(Vec::len));
        [self.header(&numbers), blocks.concat()]
    }

    /// As it stands in the file.
    fn encode(self, data: &[u8]) -> Vec<u8> {
        let [header, data] = self.pack(data);
        match (self.mode, self.packing) {
            (Mode::Raw, _) => [header, data].concat(),
            // As VTK does: one unit without compression, two with it.
            (_, Packing::None) => STANDARD.encode([header, data].concat()).into_bytes(),
            _ => [STANDARD.encode(header), STANDARD.encode(data)].concat().into_bytes(),
        }
    }

    fn root(self, dataset: &str) -> String {
        let compressor = match self.packing {
            Packing::None => "",
            Packing::Zlib => " compressor=\"vtkZLibDataCompressor\"",
            Packing::Lz4 => " compressor='vtkLZ4DataCompressor'",
        };
        let order = if self.big { "BigEndian" } else { "LittleEndian" };
        let header = if self.wide { " header_type=\"UInt64\"" } else { "" };
        format!("<?xml version=\"1.0\"?>\n<VTKFile type=\"{dataset}\" byte_order=\"{order}\"{header}{compressor}>\n")
    }

    /// A file of pieces, each the points and the arrays of the points.
    fn write(self, dataset: &str, pieces: &[(Array, Vec<Array>)]) -> Vec<u8> {
        let mut appended: Vec<Vec<u8>> = Vec::new();
        let mut sizes = Vec::new();
        for (points, arrays) in pieces {
            for array in arrays.iter().chain([points]) {
                let data: Vec<u8> = array.3.iter().flat_map(|&value| number_bytes(array.0, value, self.big)).collect();
                appended.push(self.encode(&data));
                sizes.push(appended.last().unwrap().len());
            }
        }
        // Something else stands between the arrays.
        let gap = 8;
        let mut offsets = vec![0; sizes.len()];
        let mut order: Vec<usize> = (0..sizes.len()).collect();
        if self.reversed {
            order.reverse();
        }
        let mut end = gap;
        for &index in &order {
            offsets[index] = end;
            end += sizes[index] + gap;
        }
        let mut next = 0;
        let mut tag = |array: &Array| {
            let (kind, name, components, values) = array;
            let index = next;
            next += 1;
            let begin =
                format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=");
            let information = "<InformationKey name=\"a\"><Value index=\"0\">1</Value></InformationKey>";
            match self.mode {
                Mode::Ascii => {
                    let words: Vec<String> = values.iter().map(ToString::to_string).collect();
                    format!("{begin}\"ascii\">\n{}\n{information}</DataArray>\n", words.join("\n "))
                }
                Mode::Inline => {
                    let text = String::from_utf8(appended[index].clone()).unwrap();
                    format!("{begin}\"binary\">{information}\n {text}\n</DataArray>\n")
                }
                _ => format!("{begin}\"appended\" offset=\"{}\"/>\n", offsets[index]),
            }
        };
        let mut text = format!("{}<{dataset}>\n", self.root(dataset));
        text += "<FieldData><DataArray type=\"Float64\" Name=\"TIME\" format=\"ascii\"> 0.5 </DataArray></FieldData>";
        for (points, arrays) in pieces {
            text += &format!("<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\">\n<PointData>\n", points.3.len() / 3);
            for array in arrays {
                text += &tag(array);
            }
            text += "<Array type=\"String\" Name=\"s\" format=\"ascii\"> 65 0 </Array></PointData>\n<CellData>\
                     <DataArray type=\"Int8\" Name=\"c\" format=\"ascii\"/></CellData><!-- < > --><Points>\n";
            text += &tag(points);
            text += "</Points><Verts/></Piece>\n";
        }
        text += &format!("</{dataset}>\n");
        let mut bytes = text.into_bytes();
        if matches!(self.mode, Mode::Raw | Mode::Base64) {
            let encoding = if self.mode == Mode::Raw { "raw" } else { "base64" };
            bytes.extend(format!("<AppendedData encoding=\"{encoding}\">\n  _").bytes());
            for &index in &order {
                bytes.extend(vec![b'A'; gap]);
                bytes.extend(&appended[index]);
            }
            bytes.extend(b"\n</AppendedData>\n");
        }
        bytes.extend(b"</VTKFile>\n");
        bytes
    }
}

fn points(count: usize) -> Array<'static> {
    ("Float32", "Points", 3, (0..3 * count).map(|i| i as f64 / 8.0 - 1.0).collect())
}

/// A piece with an array of every type.
fn rich_piece(count: usize) -> (Array<'static>, Vec<Array<'static>>) {
    let numbers = |components: usize| (0..components * count).map(|i| (i * 7 % 100) as f64).collect::<Vec<f64>>();
    let mut arrays: Vec<Array> = KINDS.into_iter().map(|kind| (kind, kind, 1, numbers(1))).collect();
    arrays.push(("UInt8", "RGB", 3, numbers(3)));
    arrays.push(("Float64", "v", 2, numbers(2).into_iter().map(|value| value / 64.0 - 1.0).collect()));
    (points(count), arrays)
}

fn every_style() -> Vec<Style> {
    let mut styles = Vec::new();
    for mode in [Mode::Ascii, Mode::Inline, Mode::Raw, Mode::Base64] {
        for packing in [Packing::None, Packing::Zlib, Packing::Lz4] {
            for (wide, big, reversed) in
                [(false, false, false), (true, false, true), (false, true, true), (true, true, false)]
            {
                for block in [1, 24, 1000] {
                    styles.push(Style { mode, packing, wide, big, block, reversed });
                }
            }
        }
    }
    styles
}

#[test]
fn every_xml_encoding_gives_the_same_columns() {
    let pieces = [rich_piece(5), rich_piece(2)];
    let expected = xml(PLAIN.write("PolyData", &pieces)).unwrap();
    assert_eq!(expected.len(), 7);
    assert_eq!(
        expected.names().join(" "),
        "x y z Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Float32 Float64 r g b v_x v_y"
    );
    assert_eq!(values(&expected, "y"), [-0.875, -0.5, -0.125, 0.25, 0.625, -0.875, -0.5]);
    assert_eq!(values(&expected, "UInt16"), [0.0, 7.0, 14.0, 21.0, 28.0, 0.0, 7.0]);
    assert_eq!(values(&expected, "b"), [14.0, 35.0, 56.0, 77.0, 98.0, 14.0, 35.0]);
    assert!(expected.get("g").unwrap().byte && !expected.get("Int8").unwrap().byte);
    assert_eq!(expected.color_names(), Some(["r", "g", "b"]));
    for style in every_style() {
        for dataset in ["PolyData", "UnstructuredGrid"] {
            let columns = xml(style.write(dataset, &pieces));
            assert_eq!(columns.as_ref(), Ok(&expected), "{style:?}");
        }
        let bytes = style.write("PolyData", &pieces);
        let some = read_by(vtp::read, &bytes, &Selection::named(["g", "z", "Float64"])).unwrap();
        assert_eq!(values(&some, "g"), values(&expected, "g"), "{style:?}");
        assert_eq!(some.iter().count(), 3);
    }
}

#[test]
fn long_arrays_pass_in_blocks() {
    let count = 70_001;
    let pieces = [(points(count), vec![("Float64", "f", 3, (0..3 * count).map(|i| i as f64).collect())])];
    let expected = Style { mode: Mode::Raw, ..PLAIN }.write("PolyData", &pieces);
    let read = |bytes: &[u8]| vtp::read(&mut &bytes[..], Some(bytes.len() as u64), &Selection::All).unwrap();
    let expected = read(&expected);
    assert_eq!(values(&expected, "f_z")[count - 1], (3 * count - 1) as f64);
    for mode in [Mode::Inline, Mode::Raw, Mode::Base64] {
        for packing in [Packing::None, Packing::Zlib, Packing::Lz4] {
            // The last: all in one block, as some writers do.
            for block in [32_768, 5001, 10_000_000] {
                let style = Style { mode, packing, block, ..PLAIN };
                assert!(read(&style.write("PolyData", &pieces)) == expected, "{style:?}");
            }
        }
    }
}

#[test]
fn base64_may_be_broken_into_lines() {
    let style = Style { mode: Mode::Inline, packing: Packing::Zlib, ..PLAIN };
    let pieces = [rich_piece(9)];
    let text = String::from_utf8(style.write("PolyData", &pieces)).unwrap();
    let mut broken = String::new();
    for line in text.lines() {
        if line.starts_with(' ') {
            for (index, character) in line.chars().enumerate() {
                broken.push(character);
                if index % 5 == 4 {
                    broken.push('\n');
                }
            }
        } else {
            broken += line;
        }
        broken.push('\n');
    }
    assert!(broken.len() > text.len() + 100);
    assert_eq!(xml(broken), xml(text));
}

#[test]
fn empty_pieces_and_time_steps() {
    let text = PLAIN.write("PolyData", &[rich_piece(3)]);
    let expected = xml(&text).unwrap();
    let text = String::from_utf8(text).unwrap();
    let pieces = text.replace(
        "<Piece",
        "<Piece NumberOfPoints=\"0\"/><Piece NumberOfPoints=\"0\"><PointData/><Points><DataArray type=\"Float32\"/>\
         </Points></Piece><Piece",
    );
    assert_eq!(xml(pieces).unwrap(), expected);
    let later = "<DataArray TimeStep=\"1 2\" type=\"Int8\" Name=\"Int8\" format=\"ascii\">9 9 9</DataArray>";
    let steps =
        text.replacen("<DataArray type=\"Int8\"", &format!("{later}<DataArray TimeStep=\"0\" type=\"Int8\""), 1);
    let mut columns = xml(steps).unwrap();
    let notes = std::mem::take(&mut columns.notes);
    assert_eq!(notes[0], "the file has several time steps, of which the first was read");
    assert_eq!(notes[1..], expected.notes);
    columns.notes.clone_from(&expected.notes);
    assert_eq!(columns, expected);
    let empty = xml("<VTKFile type=\"PolyData\"><PolyData/></VTKFile>").unwrap();
    assert_eq!((empty.len(), empty.names().len()), (0, 3));
    let marked = [b"\xEF\xBB\xBF".as_slice(), text.as_bytes()].concat();
    assert_eq!(xml(marked).unwrap(), expected);
}

#[test]
fn wrong_xml_files_are_refused() {
    let good = String::from_utf8(PLAIN.write("PolyData", &[rich_piece(2), rich_piece(1)])).unwrap();
    let cases: &[(&str, &str, &[&str])] = &[
        ("<VTKFile", "<svg", &["byte 22", "<VTKFile>"]),
        (
            "type=\"PolyData\"",
            "type=\"ImageData\"",
            &["byte 22", "`ImageData`", "PolyData, UnstructuredGrid", "ParaView"],
        ),
        ("type=\"PolyData\"", "type=\"PPolyData\"", &["`PPolyData`", "parallel", "pieces"]),
        ("type=\"PolyData\"", "type=\"UnstructuredGrid\"", &["no <UnstructuredGrid>"]),
        ("LittleEndian", "MiddleEndian", &["`MiddleEndian`", "LittleEndian, BigEndian"]),
        ("byte_order=", "header_type=\"UInt16\" byte_order=", &["`UInt16`", "UInt32, UInt64"]),
        (
            "byte_order=",
            "compressor=\"vtkLZMADataCompressor\" byte_order=",
            &["`vtkLZMADataCompressor`", "vtkLZ4DataCompr"],
        ),
        ("NumberOfPoints=\"2\"", "", &["tag Piece", "NumberOfPoints"]),
        ("NumberOfPoints=\"2\"", "NumberOfPoints=\"-2\"", &["NumberOfPoints is `-2`", "integer from 0"]),
        ("NumberOfPoints=\"2\"", "NumberOfPoints=\"4294967296\"", &["4294967296 points", "at most 4294967295"]),
        ("NumberOfPoints=\"2\"", "NumberOfPoints=\"3\"", &["array `Int8`", "2 values; expected 3"]),
        ("NumberOfPoints=\"2\"", "NumberOfPoints=\"1\"", &["array `Int8`", "`7` follows the 1 values"]),
        ("NumberOfPoints=\"2\"", "NumberOfPoints=\"900000\"", &["tag DataArray", "truncated"]),
        ("Name=\"Int8\"", "Name=\"Int8\" NumberOfTuples=\"3\"", &["array `Int8` has 3 tuples for 2 points"]),
        ("type=\"Int8\"", "type=\"Int9\"", &["`Int9`", "Float64"]),
        ("format=\"ascii\">\n0", "format=\"text\">\n0", &["`text`", "ascii, binary, appended"]),
        ("format=\"ascii\">\n0", "format=\"appended\">\n0", &["without an offset"]),
        ("format=\"ascii\">\n0", "format=\"appended\" offset=\"5\">\n0", &["no <AppendedData>", "array `Int8`"]),
        (
            "format=\"ascii\">\n0",
            "format=\"ascii\">\n256",
            &["component 0 of point 0 in array `Int8`", "`256`", "-128 to 127"],
        ),
        ("format=\"ascii\">\n0", "format=\"ascii\">\nnan", &["`nan`", "line 7"]),
        ("format=\"ascii\">\n0", "format=\"ascii\"></DataArray><DataArray>\n0", &["no data"]),
        ("format=\"ascii\">\n0", "format=\"binary\">\n!!!!", &["`!!!!`", "base64"]),
        (
            "\"Points\" NumberOfComponents=\"3\"",
            "\"Points\" NumberOfComponents=\"2\"",
            &["2 coordinates", "allowed: 3"],
        ),
        ("<Points>", "<Dots>", &["byte"]),
        ("<Points>", "<Points/><A>", &["byte"]),
        ("NumberOfComponents=\"3\"", "NumberOfComponents=\"1000000000\"", &["1000000000 components", "at most 1024"]),
    ];
    for (from, to, says) in cases {
        assert!(good.contains(from), "{from}");
        assert_says(xml(good.replacen(from, to, 1)), says);
    }
    let no_points = good.replace("Points>", "Dots>");
    assert_says(xml(no_points), &["2 points, but no <Points>"]);
    let (first, second) = good.split_at(good.rfind("<Piece").unwrap());
    assert_says(xml(format!("{first}{}", second.replace("\"v\"", "\"w\""))), &["array `w` of 2", "before this one"]);
    let cut = second.find("<DataArray type=\"Int8\"").unwrap();
    let end = cut + second[cut..].find("</DataArray>").unwrap() + 12;
    let missing = format!("{first}{}{}", &second[..cut], &second[end..]);
    assert_says(xml(missing), &["no array `Int8`, which the pieces before it have"]);
    assert_says(xml(""), &["<VTKFile>"]);
    assert_says(xml(b"\x89HDF\r\n\x1a\n"), &["VTKHDF", ".vtp"]);
    assert_says(xml(format!("<VTKFile type=\"PolyData\">{}", "<a>".repeat(100))), &["64 tags"]);
    let long = format!("<VTKFile type=\"PolyData\" a=\"{}\">", "b".repeat(100_000));
    assert_says(xml(long), &["byte 0", "more than 65536 bytes"]);
}

#[test]
fn wrong_encoded_data_are_refused() {
    let pieces = [(points(3), vec![("Float64", "f", 1, vec![1.0, f64::NAN, 3.0])])];
    for style in every_style() {
        let bytes = style.write("PolyData", &pieces);
        let says: &[&str] = if style.mode == Mode::Ascii {
            &["`NaN` is not finite"]
        } else {
            &["component 0 of point 1 in array `f` is NaN"]
        };
        assert_says(xml(&bytes), says);
        let lenient = read_by(vtp::read, &bytes, &Selection::Survey(vec!["f".into()])).unwrap();
        let found = values(&lenient, "f");
        assert!(found[0] == 1.0 && found[1].is_nan() && found[2] == 3.0, "{style:?}");
    }
    let replaced = |style: Style, from: &[u8], to: &[u8]| {
        let mut bytes = style.write("PolyData", &[(points(3), Vec::new())]);
        let at = bytes.windows(from.len()).rposition(|part| part == from).unwrap();
        bytes.splice(at..at + from.len(), to.iter().copied());
        xml(bytes)
    };
    let raw = Style { mode: Mode::Raw, ..PLAIN };
    assert_says(
        replaced(raw, &[36, 0, 0, 0], &[35, 0, 0, 0]),
        &["byte", "array `points`", "35 bytes", "9 values", "36"],
    );
    assert_says(replaced(raw, b"offset=\"8\"", b"offset=\"99\""), &["points", "ends"]);
    assert_says(replaced(raw, b"  _", b"  -"), &["no `_`"]);
    assert_says(replaced(raw, b"\"raw\"", b"\"hex\""), &["`hex`", "raw, base64"]);
    let zlib = Style { packing: Packing::Zlib, block: 20, ..raw };
    assert_says(replaced(zlib, &[2, 0, 0, 0, 20], &[3, 0, 0, 0, 20]), &["3 blocks of 20 bytes", "36 bytes"]);
    assert_says(replaced(zlib, &[20, 0, 0, 0, 16], &[20, 0, 0, 0, 15]), &["the last of 15"]);
    // Two blocks of other sizes with the same sum.
    assert_says(replaced(zlib, &[20, 0, 0, 0, 16], &[19, 0, 0, 0, 17]), &["block 0 of 2", "zlib data", "19"]);
    assert_says(replaced(zlib, &[20, 0, 0, 0, 16], &[21, 0, 0, 0, 15]), &["block 0 of 2", "zlib data", "21"]);
    let lz4 = Style { packing: Packing::Lz4, ..zlib };
    assert_says(replaced(lz4, &[20, 0, 0, 0, 16], &[19, 0, 0, 0, 17]), &["block 0 of 2", "LZ4 data"]);
    assert_says(replaced(lz4, &[20, 0, 0, 0, 16], &[21, 0, 0, 0, 15]), &["block 0 of 2", "LZ4 data"]);
    let overlap = [(points(3), vec![("Int8", "a", 1, vec![1.0; 3])])];
    let mut bytes = raw.write("PolyData", &overlap);
    let at = bytes.windows(11).position(|part| part == b"offset=\"8\"/").unwrap();
    bytes[at + 8] = b'9';
    assert!(xml(bytes).is_err());
}

#[test]
fn counts_are_not_believed() {
    let begin = std::time::Instant::now();
    // A zlib bomb: a million zeros for each kilobyte.
    for (packing, points) in [(Packing::Zlib, 20_000_000u64), (Packing::Lz4, 20_000_000)] {
        let style = Style { mode: Mode::Raw, packing, block: 1 << 24, ..PLAIN };
        let data = style.encode(&vec![0; 12 * points as usize]);
        let mut bytes = style.root("PolyData").into_bytes();
        bytes.extend(
            format!(
                "<PolyData><Piece NumberOfPoints=\"{points}\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" \
                 format=\"appended\" offset=\"0\"/></Points></Piece></PolyData><AppendedData encoding=\"raw\">_"
            )
            .bytes(),
        );
        bytes.extend(data);
        assert!(bytes.len() < 2_000_000);
        let sized = vtp::read(&mut &bytes[..], Some(bytes.len() as u64), &Selection::All).unwrap_err().to_string();
        let streamed = vtp::read(&mut &bytes[..], None, &Selection::All).unwrap_err().to_string();
        for message in [sized, streamed] {
            assert!(message.contains("bytes of memory") || message.contains("bomb"), "{message}");
        }
    }
    // Small enough as columns of one, but not in all.
    let zeros = "z".repeat(3);
    let arrays: String =
        (0..200).map(|i| format!("{zeros}{i} 1 100000 bit\n{}\n", "0".repeat(12_500))).collect::<Vec<_>>().concat();
    let header = "# vtk DataFile Version 3.0\n\nBINARY\nDATASET POLYDATA\nPOINTS 100000 char\n";
    let bytes =
        [header.as_bytes(), &vec![0; 300_000], b"\nPOINT_DATA 100000\nFIELD f 200\n", arrays.as_bytes()].concat();
    let sized = vtk::read(&mut &bytes[..], Some(bytes.len() as u64), &Selection::All).unwrap_err().to_string();
    assert!(sized.contains("bytes of memory"), "{sized}");
    assert!(vtk::read(&mut &bytes[..], Some(bytes.len() as u64), &Selection::named(["x", "zzz7"])).is_ok());
    let huge = u64::MAX;
    for rest in [
        format!("POINT_DATA 2\nFIELD f {huge}\n"),
        format!("POINT_DATA 2\nFIELD f 1\na {huge} 2 float\n"),
        format!("FIELD f 1\na {huge} {huge} double\n"),
        format!("FIELD f 1\na {huge} {huge} string\n"),
        format!("FIELD f 1\na {huge} {huge} variant\n"),
        format!("VERTICES {huge} {huge}\n"),
        format!("CELL_TYPES {huge}\n"),
        format!("METADATA\nINFORMATION {huge}\n\n\n\nPOINT_DATA {huge}"),
        format!("CELL_DATA {huge}\nLOOKUP_TABLE t {huge}\n"),
        format!("CELL_DATA {huge}\nSCALARS a double {huge}\nLOOKUP_TABLE t\n"),
    ] {
        // Where it is no error it is nothing.
        if let Ok(columns) = legacy(text_file(&rest)) {
            assert_eq!(columns.len(), 2);
        }
        let _ = legacy(binary_file("5.1", &[rest.as_bytes()]));
    }
    let many: String = (0..40_000).map(|i| format!("a{} 1 0 float\n", i % 7)).collect();
    let none = text_file(&format!("POINT_DATA 0\nFIELD f 40000\n{many}")).replace("2 float\n1 2 3\n4 5 6", "0 float");
    assert_says(legacy(none), &["more than 16384 columns"]);
    assert!(begin.elapsed().as_secs() < 60, "{:?}", begin.elapsed());
}

// ---- damage ----

fn damage_samples() -> Vec<(String, Vec<u8>)> {
    let mut samples = vtk_files();
    for (index, style) in every_style().into_iter().enumerate().filter(|(_, style)| style.block == 24) {
        let pieces =
            [(points(2), vec![("UInt16", "a", 1, vec![1.0, 2.0])]), (points(1), vec![("UInt16", "a", 1, vec![3.0])])];
        samples.push((format!("{index} {style:?}"), style.write("PolyData", &pieces)));
    }
    samples
}

#[test]
fn every_truncation_is_survived() {
    for (name, bytes) in damage_samples() {
        let whole = read_all(&bytes).unwrap();
        for end in 0..bytes.len() {
            let read: Read = if vtp::detect(&bytes) { vtp::read } else { vtk::read };
            let Ok(part) = read_by(read, &bytes[..end], &Selection::All) else { continue };
            // A text may end within a number and nobody can know.
            if name.ends_with("_ascii.vtk") {
                continue;
            }
            for column in part.iter() {
                assert_eq!(Some(column), whole.get(&column.name), "{name} at {end}");
            }
        }
    }
}

#[test]
fn every_bit_flip_is_survived() {
    let begin = std::time::Instant::now();
    let mut samples: Vec<Vec<u8>> =
        vtk_files().into_iter().filter(|file| file.0.ends_with(".vtk")).map(|file| file.1).collect();
    for (index, style) in every_style().into_iter().filter(|style| style.block == 24).enumerate() {
        // Each mode and packing once, and each byte order and so on in its turn.
        if index % 4 == index / 4 % 4 {
            samples.push(style.write("PolyData", &[(points(2), vec![("UInt16", "a", 1, vec![1.0, 2.0])])]));
        }
    }
    for sample in samples {
        let read: Read = if vtp::detect(&sample) { vtp::read } else { vtk::read };
        for bit in 0..sample.len() * 8 {
            let mut bytes = sample.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let _ = read_by(read, &bytes, &Selection::All);
        }
    }
    assert!(begin.elapsed().as_secs() < 60, "{:?}", begin.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..300), which in 0..4usize) {
        let starts: [&[u8]; 4] = [
            b"",
            b"# vtk DataFile Version 3.0\n\nBINARY\nDATASET POLYDATA\nPOINTS 1 char\n",
            b"<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"1\">",
            b"<VTKFile type=\"PolyData\" compressor=\"vtkZLibDataCompressor\"><PolyData><Piece NumberOfPoints=\"1\"><Points>\
              <DataArray type=\"Int8\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/></Points></Piece></PolyData>\
              <AppendedData encoding=\"raw\">_",
        ];
        let bytes = [starts[which], &bytes].concat();
        let _ = read_by(vtk::read, &bytes, &Selection::All);
        let _ = read_by(vtp::read, &bytes, &Selection::All);
    }

    #[test]
    fn random_words_of_the_formats_are_survived(
        words in proptest::collection::vec(prop::sample::select(vec![
            "POINTS", "POINT_DATA", "CELL_DATA", "VERTICES", "CELLS", "OFFSETS", "vtktypeint64", "CONNECTIVITY", "FIELD", "a",
            "SCALARS", "LOOKUP_TABLE", "COLOR_SCALARS", "VECTORS", "METADATA", "INFORMATION", "NAME", "COMPONENT_NAMES",
            "float", "bit", "char", "string", "variant", "\n", "\n", "\n\n", "0", "1", "2", "3", "18446744073709551615", "-1", "nan",
        ]), 0..60),
        binary in any::<bool>(), version in prop::sample::select(vec!["3.0", "5.1"]),
    ) {
        let kind = if binary { "BINARY" } else { "ASCII" };
        let words = words.join(" ").replace(" \n ", "\n");
        let _ = legacy(format!("# vtk DataFile Version {version}\n\n{kind}\nDATASET POLYDATA\nPOINTS 1 char\n1 2 3\n{words}"));
    }

    #[test]
    fn random_tags_are_survived(
        words in proptest::collection::vec(prop::sample::select(vec![
            "<PolyData>", "</PolyData>", "<Piece NumberOfPoints=\"2\">", "</Piece>", "<Points>", "</Points>", "<PointData>",
            "</PointData>", "<DataArray type=\"Int8\" NumberOfComponents=\"3\" format=\"ascii\">", "</DataArray>",
            "<DataArray type=\"Bit\" Name=\"a\" format=\"binary\">", "<AppendedData encoding=\"raw\">", "_", "\0", "AAAA", "1 ",
            "<DataArray type=\"UInt8\" Name=\"b\" format=\"appended\" offset=\"1\"/>", "<!--", "-->", "<![CDATA[", "]]>", "&amp;",
            "<?x", "?>", "<", ">", "\"", "<VTKFile", "</VTKFile>", "==", "1 2 3 4 5 6",
        ]), 0..40),
    ) {
        let _ = xml(format!("<VTKFile type=\"PolyData\">{}", words.concat()));
    }
}
