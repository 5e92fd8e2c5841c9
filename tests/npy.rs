//! NumPy particle files: every type, order and kind of array, wrong headers, wrong bytes.

use crate::files::{assert_says, data, read_bytes, values};
use half::f16;
use proptest::prelude::*;
use stereomist::input::{Columns, Selection, npy};

/// A file of that format version with that dictionary, padded as NumPy does.
fn file(version: u8, dictionary: &str, data: &[u8]) -> Vec<u8> {
    let length_bytes = if version == 1 { 2 } else { 4 };
    let mut text = dictionary.as_bytes().to_vec();
    while !(8 + length_bytes + text.len() + 1).is_multiple_of(64) {
        text.push(b' ');
    }
    text.push(b'\n');
    let mut out = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
    out.extend_from_slice(&(text.len() as u32).to_le_bytes()[..length_bytes]);
    out.extend_from_slice(&text);
    out.extend_from_slice(data);
    out
}

/// A file of an array; `descr` is as in the header, quotes included.
fn array(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    file(1, &format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}"), data)
}

/// The numbers as bytes of a type such as `<f4`.
fn bytes_of(kind: &str, numbers: &[f64]) -> Vec<u8> {
    let mut out = Vec::new();
    for &v in numbers {
        let mut bytes = match &kind[1..] {
            "f2" => f16::from_f64(v).to_le_bytes().to_vec(),
            "f4" => (v as f32).to_le_bytes().to_vec(),
            "f8" => v.to_le_bytes().to_vec(),
            "i1" => (v as i8).to_le_bytes().to_vec(),
            "i2" => (v as i16).to_le_bytes().to_vec(),
            "i4" => (v as i32).to_le_bytes().to_vec(),
            "i8" => (v as i64).to_le_bytes().to_vec(),
            "u1" | "b1" => vec![v as u8],
            "u2" => (v as u16).to_le_bytes().to_vec(),
            "u4" => (v as u32).to_le_bytes().to_vec(),
            "u8" => (v as u64).to_le_bytes().to_vec(),
            other => panic!("no type {other}"),
        };
        if kind.starts_with('>') {
            bytes.reverse();
        }
        out.extend_from_slice(&bytes);
    }
    out
}

fn read(bytes: &[u8]) -> Result<Columns, String> {
    read_bytes(npy::read, bytes, &Selection::All)
}

fn error(bytes: &[u8]) -> String {
    read(bytes).expect_err("the file is wrong")
}

fn real(name: &str) -> Columns {
    read(&std::fs::read(data("npy").join(name)).unwrap()).unwrap()
}

fn names(columns: &Columns) -> Vec<&str> {
    columns.names().iter().map(String::as_str).collect()
}

/// Files that between them use everything the reader knows.
fn samples() -> Vec<Vec<u8>> {
    let mut samples: Vec<Vec<u8>> = ["plain", "fortran", "records", "unicode", "version_2"]
        .iter()
        .map(|name| std::fs::read(data("npy").join(name).with_extension("npy")).unwrap())
        .collect();
    samples.push(array("'>i2'", true, "(2, 4)", &bytes_of(">i2", &[1.0; 8])));
    samples.push(array("[(('t', 'a'), 'U1'), ('b', [('c', 'f4')], (2,))]", false, "(1,)", &[0; 12]));
    samples
}

// ---- what NumPy wrote ----

#[test]
fn files_by_numpy() {
    let plain = real("plain.npy");
    assert_eq!((names(&plain), plain.len()), (vec!["x", "y", "z"], 2));
    assert_eq!([values(&plain, "x"), values(&plain, "z")], [[1.5, 4.0], [3.0, -6.25]]);
    let fortran = real("fortran.npy");
    assert_eq!(names(&fortran), ["x", "y", "z", "radius", "opacity"]);
    assert_eq!(values(&fortran, "x"), [0.0, 1.25, 2.5, 3.75]);
    assert_eq!(values(&fortran, "opacity"), [1.0, 2.25, 3.5, 4.75]);
    let unicode = real("unicode.npy");
    assert_eq!((names(&unicode), values(&unicode, "Dichte ρ")), (vec!["x", "y", "z", "Dichte ρ"], &[1.0, 2.0][..]));
    let version_2 = real("version_2.npy");
    assert_eq!((names(&version_2), values(&version_2, "b")), (vec!["x", "y", "z", "r", "g", "b"], &[5.0][..]));
}

#[test]
fn records_by_numpy() {
    let records = real("records.npy");
    let tensor = ["tensor_0", "tensor_1", "tensor_2", "tensor_3"];
    let expected = ["id", "x", "y", "z", "h", "flag", "r", "g", "b"].into_iter().chain(tensor).collect::<Vec<_>>();
    assert_eq!(names(&records), expected, "the text in `name` is passed over");
    assert_eq!(values(&records, "id"), [7.0, 8.0, 9.0]);
    assert_eq!(values(&records, "z"), [3.0, 6.0, 9.5]);
    assert_eq!(values(&records, "h"), [0.5, 0.25, f16::from_f64(0.1).to_f64()]);
    assert_eq!(values(&records, "flag"), [1.0, 0.0, 1.0]);
    assert_eq!(values(&records, "r"), [255.0, 1.0, 4.0]);
    assert_eq!(values(&records, "tensor_2"), [-3.0, 1.0, 5.0]);
    let bytes: Vec<&str> = records.iter().filter(|column| column.byte).map(|column| column.name.as_str()).collect();
    assert_eq!(bytes, ["r", "g", "b"]);
    assert_eq!(records.color_names(), Some(["r", "g", "b"]));
    let bytes = std::fs::read(data("npy/records.npy")).unwrap();
    let some = read_bytes(npy::read, &bytes, &Selection::named(["z", "tensor_3", "none"])).unwrap();
    assert_eq!(some.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(), ["z", "tensor_3"]);
    assert_eq!(values(&some, "tensor_3"), [-2.0, 2.0, 6.0]);
    let text = read_bytes(npy::read, &bytes, &Selection::named(["name"])).unwrap_err();
    assert_says(&text, &["column `name`", "`|S5` (strings of bytes)", "not supported", "f4"]);
}

// ---- types ----

#[test]
fn number_types_of_both_byte_orders() {
    let kinds: [(&str, [f64; 2]); 12] = [
        ("f2", [-65504.0, 0.5]),
        ("f4", [f64::from(-0.1_f32), f64::from(f32::MAX)]),
        ("f8", [0.1, -f64::MAX]),
        ("i1", [-128.0, 127.0]),
        ("i2", [-32768.0, 32767.0]),
        ("i4", [-2147483648.0, 2147483647.0]),
        ("i8", [i64::MIN as f64, 9_007_199_254_740_992.0]),
        ("u1", [0.0, 255.0]),
        ("u2", [0.0, 65535.0]),
        ("u4", [0.0, 4294967295.0]),
        ("u8", [0.0, 18_446_744_073_709_549_568.0]),
        ("b1", [0.0, 1.0]),
    ];
    for (kind, [a, b]) in kinds {
        // Without an order the machine's own.
        for order in ["<", ">", "|", "=", ""] {
            let written = match order {
                "<" | ">" => order,
                _ if cfg!(target_endian = "big") => ">",
                _ => "<",
            };
            let kind = |order: &str| format!("{order}{kind}");
            let rows = bytes_of(&kind(written), &[a, b, a, b, b, a]);
            for (fortran, x, z) in [(false, [a, b], [a, a]), (true, [a, b], [b, a])] {
                let columns = read(&array(&format!("'{}'", kind(order)), fortran, "(2, 3)", &rows)).unwrap();
                assert_eq!((values(&columns, "x"), values(&columns, "z")), (&x[..], &z[..]), "{}", kind(order));
                assert!(columns.iter().all(|column| !column.byte), "a plain array has no sRGB bytes");
            }
            let descr = format!("[('pad', '|V3'), ('a', '{0}'), ('', '|V2'), ('b', '{0}')]", kind(order));
            let [a_bytes, b_bytes] = [a, b].map(|value| bytes_of(&kind(written), &[value]));
            let rows = [[1, 2, 3].as_slice(), &a_bytes, &[4, 5], &b_bytes].concat().repeat(3);
            let columns = read(&array(&descr, false, "(3,)", &rows)).unwrap();
            assert_eq!((values(&columns, "a"), values(&columns, "b")), (&[a; 3][..], &[b; 3][..]), "{descr}");
            assert_eq!(names(&columns), ["a", "b"]);
        }
    }
}

#[test]
fn other_types_are_named() {
    for (kind, parts) in [
        ("<c8", ["`<c8`", "complex"]),
        ("<c16", ["`<c16`", "complex"]),
        ("<f16", ["`<f16`", "extended precision"]),
        ("|S8", ["`|S8`", "strings"]),
        ("<U8", ["`<U8`", "strings"]),
        ("|V8", ["`|V8`", "raw bytes"]),
        ("<M8[ns]", ["`<M8[ns]`", "dates"]),
        ("<m8[ns]", ["`<m8[ns]`", "dates"]),
        ("<f3", ["byte 20", "`'<f3'"]),
        ("<i16", ["byte 20", "`'<i16'"]),
        ("<x4", ["byte 20", "`'<x4'"]),
        ("<f4[ns]", ["byte 20", "`'<f4[ns]'"]),
        ("float32", ["byte 20", "`'float32'"]),
        ("", ["byte 20", "`''"]),
        ("<f99999999999999999999", ["byte 20", "`'<f9999999"]),
    ] {
        let message = error(&array(&format!("'{kind}'"), false, "(0, 3)", &[]));
        assert_says(&message, &parts);
        assert_says(&message, &["allowed: f2, f4, f8, i1"].map(|part| part.trim_start_matches("allowed: ")));
    }
    for descr in ["'|O'", "'O'", "'|O8'", "[('x', '<f4'), ('who', '|O')]", "[('a', [('b', 'O')])]"] {
        let message = error(&array(descr, false, "(2, 3)", &[0; 100]));
        assert_says(&message, &["Python objects", "any code", "array.astype(numpy.float32)"]);
    }
}

#[test]
fn fields_without_numbers_are_passed_over() {
    let descr = "[('x', '<f4'), ('c', '<c8'), ('s', '<U2', (2,)), ('r', [('a', '<f4'), ('b', '|V3', 2)], (2,)), \
                 ('t', '<M8[us]'), (('a title', 'y'), '<f4'), ('none', '<f4', (0,)), ('one', '|u1', (1,))]";
    let row =
        [&1.5_f32.to_le_bytes()[..], &[0xff; 8], &[0xff; 16], &[0xff; 20], &[0xff; 8], &2.5_f32.to_le_bytes(), &[9]];
    let bytes = array(descr, false, "(2, 1)", &row.concat().repeat(2));
    let columns = read(&bytes).unwrap();
    assert_eq!(names(&columns), ["x", "y", "one_0"]);
    assert_eq!((values(&columns, "y"), values(&columns, "one_0")), (&[2.5; 2][..], &[9.0; 2][..]));
    for (name, part) in [("c", "complex"), ("s_1", "`s_1`"), ("r_0", "a record within the record"), ("t", "dates")] {
        let message = read_bytes(npy::read, &bytes, &Selection::named([name])).unwrap_err();
        assert_says(&message, &["column", part, "not supported"]);
        let survey = read_bytes(npy::read, &bytes, &Selection::Survey(vec![name.to_owned()])).unwrap();
        assert_eq!(survey.iter().count(), 0);
    }
}

// ---- shapes and names ----

#[test]
fn columns_of_a_plain_array_by_their_number() {
    for (count, expected) in [
        (3, "x y z"),
        (4, "x y z radius"),
        (5, "x y z radius opacity"),
        (6, "x y z r g b"),
        (7, "x y z c3 c4 c5 c6"),
        (8, "x y z radius opacity r g b"),
        (9, "x y z c3 c4 c5 c6 c7 c8"),
    ] {
        for fortran in [false, true] {
            let numbers: Vec<f64> = (0..2 * count).map(f64::from).collect();
            let bytes = array("'<f8'", fortran, &format!("(2, {count})"), &bytes_of("<f8", &numbers));
            let columns = read(&bytes).unwrap();
            assert_eq!(names(&columns).join(" "), expected);
            // A meaning that only the number of columns suggests is said.
            let guessed = [4, 5, 6, 8].contains(&count);
            let said = columns.notes.iter().filter(|note| note.contains(&names(&columns).join(", "))).count();
            assert_eq!((columns.notes.len(), said), (usize::from(guessed), usize::from(guessed)), "{count}");
            for (index, column) in columns.iter().enumerate() {
                let (i, n) = (index as f64, f64::from(count));
                let expected = if fortran { [2.0 * i, 2.0 * i + 1.0] } else { [i, n + i] };
                assert_eq!(column.values, expected, "{} of {count}", column.name);
            }
            let some = read_bytes(npy::read, &bytes, &Selection::named(["y"])).unwrap();
            assert_eq!(values(&some, "y"), values(&columns, "y"));
        }
    }
    let empty = read(&array("'<f4'", false, "(0, 3)", &[])).unwrap();
    assert!(empty.is_empty() && empty.has("z"));
}

#[test]
fn other_shapes_are_refused() {
    for shape in ["()", "(9,)", "(9, 0)", "(9, 1)", "(9, 2)", "(9, 5000)", "(2, 3, 1)", "(1, 9, 3)"] {
        for fortran in [false, true] {
            let message = error(&array("'<f4'", fortran, shape, &[0; 200]));
            assert_says(&message, &[&format!("shape {shape}; "), "(N, 3) for x, y, z", "structured"]);
            assert!(!message.contains("transpose"), "{message}");
        }
    }
    for shape in ["(3, 1)", "(3, 2)", "(3, 9)", "(3, 1000000)", "(4, 100)", "(6, 100)", "(8, 9)"] {
        let message = error(&array("'<f4'", false, shape, &[0; 200]));
        assert_says(&message, &[&format!("shape {shape}; "), "(N, 3)", "transpose", "array.T"]);
    }
    for shape in ["()", "(2, 2)", "(1, 2)", "(2, 1, 1)"] {
        let message = error(&array("[('x', '<f4')]", false, shape, &[0; 200]));
        assert_says(&message, &["structured array of shape", shape, "allowed: (N,) or (N, 1)"]);
    }
}

#[test]
fn sub_arrays_that_mean_positions_and_colours() {
    let fields = |descr: &str, row: usize| read(&array(descr, false, "(1,)", &vec![1; row]));
    for name in ["pos", "Position", "POSITIONS", "xyz", "coord", "Coordinates", "points", "centre", "center"] {
        let columns = fields(&format!("[('{name}', '<f4', (3,))]"), 12).unwrap();
        assert_eq!(names(&columns), ["x", "y", "z"], "{name}");
        for shape in ["(2,)", "(4,)", "(1,)"] {
            let columns = fields(&format!("[('{name}', '|i1', {shape})]"), 4).unwrap();
            assert_eq!(columns.names()[0], format!("{name}_0"));
        }
    }
    for name in ["rgb", "RGB", "color", "colors", "Colour", "colours"] {
        for (kind, byte) in [("|u1", true), ("<f4", false), ("<u2", false), ("|i1", false)] {
            let columns = fields(&format!("[('{name}', '{kind}', 3)]"), 12).unwrap();
            assert_eq!(names(&columns), ["r", "g", "b"], "{name}");
            assert!(columns.iter().all(|column| column.byte == byte), "{name} {kind}");
        }
    }
    // Columns that have these names already keep them; of two the first gets them.
    let columns = fields("[('pos', '|i1', (3,)), ('x', '|i1'), ('rgb', '|u1', (3,)), ('g', '|u1')]", 8).unwrap();
    assert_eq!(names(&columns), ["pos_0", "pos_1", "pos_2", "x", "rgb_0", "rgb_1", "rgb_2", "g"]);
    assert_eq!(columns.iter().filter(|column| column.byte).count(), 1, "rgb_0 is no colour, g is");
    let columns = fields("[('center', '|i1', (3,)), ('pos', '|i1', (3,))]", 6).unwrap();
    assert_eq!(names(&columns), ["x", "y", "z", "pos_0", "pos_1", "pos_2"]);
    let columns = fields("[('red', '|u1'), ('green', '|u1'), ('blue', '|u1'), ('mass', '|u1')]", 4).unwrap();
    assert_eq!(columns.color_names(), Some(["red", "green", "blue"]));
    assert_eq!(columns.iter().map(|column| column.byte).collect::<Vec<_>>(), [true, true, true, false]);
    assert_says(&fields("[('a', '|i1'), ('a', '|i1')]", 2).unwrap_err(), &["two fields", "`a`"]);
    assert_says(&fields("[('a_1', '|i1'), ('a', '|i1', (2,))]", 3).unwrap_err(), &["two fields", "`a_1`"]);
}

// ---- the header ----

#[test]
fn headers_written_differently() {
    let data = bytes_of("<f4", &[1.0, 2.0, 3.0]);
    let expected = read(&array("'<f4'", false, "(1, 3)", &data)).unwrap();
    for dictionary in [
        "{'descr':'<f4','fortran_order':False,'shape':(1,3)}",
        "{\"shape\": (1, 3), \"descr\": \"<f4\", \"fortran_order\": False}",
        " {\n 'fortran_order' : False ,\t'shape' : ( 1 , 3 , ) , 'descr' : ( '<f4' ) , }",
        "{'descr': '\\x3cf4', 'fortran_order': False, 'shape': (1L, 3L)}",
        "{'descr': '<f\\u0034', 'fortran_order': (False), 'shape': (1, 3)}",
    ] {
        for version in [1, 2, 3] {
            assert_eq!(read(&file(version, dictionary, &data)), Ok(expected.clone()), "{dictionary}");
            // Neither padding nor a line end is needed.
            let length = dictionary.len() as u32;
            let mut bytes = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
            bytes.extend_from_slice(&length.to_le_bytes()[..if version == 1 { 2 } else { 4 }]);
            bytes.extend_from_slice(dictionary.as_bytes());
            bytes.extend_from_slice(&data);
            assert_eq!(read(&bytes), Ok(expected.clone()), "{dictionary}");
        }
    }
    // What stands behind the array is no part of it.
    let mut longer = array("'<f4'", false, "(1, 3)", &data);
    longer.extend_from_slice(b"more");
    assert_eq!(read(&longer), Ok(expected));
    // Latin-1 until version 2.0.
    let mut latin = array("[('h?he', '<f4')]", false, "(1,)", &data);
    let place = latin.iter().position(|&byte| byte == b'?').unwrap();
    latin[place] = 0xf6;
    assert_eq!(names(&read(&latin).unwrap()), ["höhe"]);
    latin[6] = 3;
    latin.splice(8..10, [0x76, 0, 0, 0]);
    assert_says(&error(&latin), &["not UTF-8", "byte"]);
}

#[test]
fn header_errors_say_the_byte() {
    let wrong = |dictionary: &str| error(&file(1, dictionary, &[0; 12]));
    for (dictionary, parts) in [
        ("", &["byte 64", "the header ends", "allowed: a string"][..]),
        ("(1, 2)", &["byte 10", "`(1, 2)`", "a dictionary"]),
        ("{}", &["byte 10", "no 'fortran_order'"]),
        ("{'descr': '<f4', 'fortran_order': False}", &["no 'shape'"]),
        ("{'fortran_order': False, 'shape': (1, 3)}", &["no 'descr'"]),
        ("{'descr': '<f4', 'descr': '<f4'}", &["byte 27", "each key once"]),
        ("{'descr': '<f4', 'order': 1}", &["byte 27", "`'order': 1}`", "'fortran_order'"]),
        ("{'descr': '<f4', 3: 1}", &["byte 27", "the keys"]),
        ("{'descr' '<f4'}", &["byte 19", "a `:`"]),
        ("{'descr': '<f4' 'shape': ()}", &["byte 26", "`,` or `}`"]),
        ("{'descr': '<f4'", &["`,` or `}`", "the header ends"]),
        ("{,}", &["byte 11", "allowed: a string"]),
        ("{'descr: '<f4'}", &["byte 20", "`<f4'}`"]),
        ("{'descr", &["byte 11", "a string that ends"]),
        ("{'des\\cr': 1}", &["byte 15", "an escape"]),
        ("{'\\ud800': 1}", &["byte 12", "an escape"]),
        ("{'shape': __import__('os')}", &["byte 20", "`__import__('os')}`", "allowed: a string"]),
        ("{'shape': None}", &["byte 20", "`None}`"]),
        ("{'shape': Falsey}", &["byte 20", "`Falsey}`"]),
        ("{'shape': (-1, 3)}", &["byte 21", "`-1, 3)}`"]),
        ("{'shape': (1.5, 3)}", &["byte 22", "`,` or `)`"]),
        ("{'shape': (18446744073709551616, 3)}", &["byte 21", "an integer below 2^64"]),
        ("{'descr': '<f4', 'fortran_order': 0, 'shape': (1, 3)}", &["byte 44", "True or False"]),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': 3}", &["byte 60", "a shape such as"]),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (3)}", &["byte 61", "a shape such as"]),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': [1, 3]}", &["byte 60", "a shape such as"]),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (1, '3')}", &["byte 64", "an integer from 0"]),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3)} x", &["byte 68", "`x`", "nothing but spaces"]),
        ("{'descr': 4, 'fortran_order': False, 'shape': (1, 3)}", &["byte 20", "a list of fields"]),
        ("{'descr': {'names': 1}, 'fortran_order': False, 'shape': (1, 3)}", &["byte 20", "a list of fields"]),
    ] {
        assert_says(&wrong(dictionary), parts);
    }
    for (descr, parts) in [
        ("[1]", &["byte 21", "a field such as"][..]),
        ("[('x',)]", &["byte 21", "a field such as"]),
        ("[('x', '<f4', (3,), 1)]", &["byte 21", "a field such as"]),
        ("[(1, '<f4')]", &["byte 22", "a field such as"]),
        ("[(('x',), '<f4')]", &["byte 22", "a field such as"]),
        ("[('x', 4)]", &["byte 27", "a field such as"]),
        ("[('x', '<f4', 'a')]", &["byte 34", "a shape such as"]),
        ("[('', '<f4')]", &["byte 21", "with a name", "|V4"]),
        ("[]", &["no bytes"]),
        ("[('x', '<f4', (0,))]", &["no bytes"]),
        ("[('', '|V0')]", &["no bytes"]),
        ("[('x', '|V1048577')]", &["1048576 bytes"]),
        ("[('x', '<f4', (9999999, 9999999, 9999999))]", &["byte 34", "less than 2^64 items"]),
        ("[('x', '<f4', (9999999999999999999,))]", &["byte 21", "less than 2^64 bytes"]),
        ("[('a', [('x', '|V9999999999999999999'), ('y', '|V9999999999999999999')])]", &["byte 27", "2^64 bytes"]),
        ("[('x', '|u1', (4097,))]", &["`x`", "4096 columns"]),
        ("[('x', '|S0', (18446744073709551615,))]", &["`x`", "4096 columns"]),
    ] {
        assert_says(&error(&array(descr, false, "(1,)", &[0; 12])), parts);
    }
    let deep = format!("{{'descr': {}1{}}}", "[".repeat(30), "]".repeat(30));
    assert_says(&wrong(&deep), &["16 levels"]);
    let long = array(&format!("[('{}', '<f4')]", "x".repeat(300)), false, "(1,)", &[0; 4]);
    assert_says(&error(&long), &["at most 256 bytes"]);
}

#[test]
fn signatures() {
    assert!(npy::detect(b"\x93NUMPY\x01\x00") && npy::detect(b"PK\x03\x04") && !npy::detect(b"\x93NUMP"));
    assert!(!npy::detect(b"PK,x,y,z\n"));
    for bytes in [b"PK\x03\x04".to_vec(), b"PK\x03\x04and what follows".to_vec()] {
        assert_says(&error(&bytes), &["zip", ".npz", "save", ".npy", "numpy.save("]);
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.npz", "a.npy"] {
        let path = folder.path().join(name);
        std::fs::write(&path, b"PK\x03\x04\x14\x00").unwrap();
        let message = stereomist::input::read_columns(&path, &Selection::All, &Default::default(), &()).unwrap_err();
        assert_says(&message.to_string(), &[name, "zip", "numpy.save("]);
    }
    assert_says(&error(b"\x93NUMPZ\x01\x00"), &["byte 0", "begins with \\x93NUMPY"]);
    assert_says(&error(b"\x93NUMPY\x04\x00"), &["byte 6", "version 4.0", "1.0, 2.0, 3.0"]);
    assert_says(&error(b"\x93NUMPY\x01\x01"), &["byte 6", "version 1.1"]);
    assert_says(&error(b"\x93NUMPY\x01\x00\xff\xff"), &["byte 8", "65535", "truncated"]);
    assert_says(&error(b"\x93NUMPY\x02\x00\xff\xff\xff\xff"), &["byte 8", "4294967295 bytes", "at most 262144"]);
    assert_says(&error(b"\x93NUM"), &["byte 4", "the signature"]);
    assert_says(&error(b""), &["byte 0", "the signature"]);
}

// ---- data ----

#[test]
fn shapes_that_lie_are_refused_at_once() {
    let begin = std::time::Instant::now();
    for (descr, shape) in [
        ("'<f8'", "(4294967295, 3)"),
        ("'<f8'", "(4294967295, 4096)"),
        ("'|u1'", "(4294967295, 3)"),
        ("[('a', '|V1048576')]", "(4294967295,)"),
        ("[('a', '|V1000000'), ('x', '<f4')]", "(4294967295, 1)"),
    ] {
        for fortran in [false, true] {
            let message = error(&array(descr, fortran, shape, &[0; 100]));
            assert_says(&message, &["needs", "the file has 100", "truncated"]);
        }
    }
    for shape in ["(4294967296, 3)", "(18446744073709551615, 3)"] {
        assert_says(&error(&array("'<f8'", false, shape, &[])), &["at most 4294967295"]);
    }
    assert!(begin.elapsed().as_secs() < 5, "{:?}", begin.elapsed());
}

#[test]
fn numbers_that_are_not_finite() {
    for (kind, fortran) in [("<f8", false), (">f8", true), ("<f2", false), (">f4", true)] {
        for value in [f64::NAN, f64::INFINITY] {
            let bytes =
                array(&format!("'{kind}'"), fortran, "(2, 3)", &bytes_of(kind, &[0.0, 1.0, 2.0, 3.0, value, 5.0]));
            let size: usize = kind[2..].parse().unwrap();
            let (name, row) = if fortran { ("z", 0) } else { ("y", 1) };
            let place = bytes.len() - 2 * size;
            let says = [format!("byte {place}: column `{name}` of row {row}"), value.to_string()];
            assert_says(&error(&bytes), &[&says[0], &says[1], "finite"]);
            // Where the column is not wanted its values do not matter.
            assert!(read_bytes(npy::read, &bytes, &Selection::named(["x"])).is_ok());
            let survey = Selection::Survey(["x", "y", "z"].map(str::to_owned).to_vec());
            let columns = npy::read(&mut bytes.as_slice(), Some(bytes.len() as u64), &survey).unwrap();
            let nan = columns.iter().map(|column| column.values.iter().filter(|v| v.is_nan()).count()).sum::<usize>();
            assert_eq!((nan, values(&columns, name)[row].is_nan()), (1, true));
        }
    }
}

#[test]
fn arrays_larger_than_a_block() {
    let count = 100_000;
    let rows: Vec<f64> = (0..count).flat_map(|i| [i, i + 1, -i]).map(f64::from).collect();
    let by_column: Vec<f64> = (0..3).flat_map(|c| rows.iter().skip(c).step_by(3).copied()).collect();
    for (fortran, numbers) in [(false, &rows), (true, &by_column)] {
        let bytes = array("'<f4'", fortran, &format!("({count}, 3)"), &bytes_of("<f4", numbers));
        for size in [None, Some(bytes.len() as u64)] {
            let columns = npy::read(&mut bytes.as_slice(), size, &Selection::named(["z"])).unwrap();
            assert!(values(&columns, "z").iter().enumerate().all(|(i, &z)| z == -(i as f64)));
            assert_eq!(values(&columns, "z").len(), count as usize);
        }
    }
    let wide = array(
        "[('pad', '|V1048572'), ('x', '<f4')]",
        false,
        "(3,)",
        &[[0; 1_048_572].as_slice(), &[0, 0, 0, 64]].concat().repeat(3),
    );
    assert_eq!(values(&read(&wide).unwrap(), "x"), [2.0; 3]);
}

// ---- wrong bytes ----

#[test]
fn truncation_at_every_byte_is_an_error() {
    for bytes in samples() {
        assert!(read(&bytes).is_ok());
        for end in 0..bytes.len() {
            assert!(read(&bytes[..end]).is_err(), "{end}");
        }
    }
}

#[test]
fn every_bit_flip_is_survived() {
    for sample in samples() {
        for bit in 0..sample.len() * 8 {
            let mut bytes = sample.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let _ = read(&bytes);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_words_are_survived(
        words in proptest::collection::vec(prop::sample::select(vec![
            "{", "}", "(", ")", "[", "]", ",", ":", "'descr'", "'fortran_order'", "'shape'", "True", "False", "'<f4'",
            "'>f8'", "'|V4'", "'|O'", "'x'", "'pos'", "3", "0", "4294967295", "18446744073709551615", "\\x", "'", " ",
        ]), 0..40),
        data in proptest::collection::vec(any::<u8>(), 0..60),
        version in 1..4_u8,
    ) {
        let _ = read(&file(version, &words.concat(), &data));
        let fields = format!("{{'shape': (2,), 'fortran_order': False, 'descr': [{}]}}", words.concat());
        let _ = read(&file(version, &fields, &data));
    }

    #[test]
    fn damaged_files_are_survived(
        which in any::<prop::sample::Index>(),
        at in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = which.get(&samples()).clone();
        for (index, byte) in at {
            let length = bytes.len();
            bytes[index.index(length)] = byte;
        }
        let _ = read(&bytes);
    }
}
