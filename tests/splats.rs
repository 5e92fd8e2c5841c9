//! 3D Gaussian splats from PLY files as particles.

use proptest::prelude::*;
use std::path::Path;
use stereomist::input::particles::{MAX_OPACITY, from_columns, selection};
use stereomist::input::{Columns, ParticleEntry, Selection, Source, ply};
use stereomist::scene::Attribute;

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];
const PLAIN: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

/// A file of floats.
fn file(format: &str, names: &[&str], rows: &[Vec<f32>]) -> Vec<u8> {
    let mut out = format!("ply\nformat {format} 1.0\nelement vertex {}\n", rows.len());
    names.iter().for_each(|name| out += &format!("property float {name}\n"));
    let mut out = (out + "end_header\n").into_bytes();
    for row in rows {
        assert_eq!(row.len(), names.len());
        for value in row {
            match format {
                "ascii" => out.extend_from_slice(format!("{} ", f64::from(*value)).as_bytes()),
                "binary_little_endian" => out.extend_from_slice(&value.to_le_bytes()),
                _ => out.extend_from_slice(&value.to_be_bytes()),
            }
        }
        if format == "ascii" {
            out.push(b'\n');
        }
    }
    out
}

/// A row of [`PLAIN`].
fn splat(color: [f32; 3], opacity: f32, scale: [f32; 3]) -> Vec<f32> {
    let [r, g, b] = color;
    let [s, t, u] = scale;
    vec![1.0, 2.0, 3.0, r, g, b, opacity, s, t, u, 1.0, 0.0, 0.0, 0.0]
}

/// With the size known and unknown, which must agree.
fn read(bytes: &[u8], selection: &Selection) -> Result<Columns, String> {
    let sized = ply::read(&mut &bytes[..], Some(bytes.len() as u64), selection).map_err(|error| error.to_string());
    let streamed = ply::read(&mut std::io::BufReader::with_capacity(7, bytes), None, selection);
    assert_eq!(sized.is_ok(), streamed.is_ok());
    if let (Ok(sized), Ok(streamed)) = (&sized, &streamed) {
        // Unlike ==, NaN equals NaN.
        assert_eq!(format!("{sized:?}"), format!("{streamed:?}"));
    }
    sized
}

fn values<'a>(columns: &'a Columns, name: &str) -> &'a [f64] {
    &columns.get(name).unwrap_or_else(|| panic!("no column {name} in {:?}", columns.names())).values
}

fn entry() -> ParticleEntry {
    crate::files::entry(Source::File("splats.ply".into()))
}

#[test]
fn what_a_splat_becomes() {
    // Axes of 1, 1/8 and 1/64: the ball of their volume has 1/8. Logit 0 is an opacity of 1/2.
    let scale = [0.0, -(8.0_f32.ln()), -(64.0_f32.ln())];
    let rows = [splat([0.0, 100.0, -100.0], 0.0, scale), splat([0.5, -1.0, 1.0], -2.0, [0.25; 3])];
    let mut first = None;
    for format in FORMATS {
        let columns = read(&file(format, &PLAIN, &rows), &Selection::All).unwrap();
        assert!((values(&columns, "radius")[0] - 3.0 / 8.0).abs() < 1e-7);
        assert!((values(&columns, "radius")[1] - 3.0 * 0.25_f64.exp()).abs() < 1e-12);
        assert_eq!(values(&columns, "opacity")[0], 0.5);
        assert!((values(&columns, "opacity")[1] - 1.0 / (1.0 + 2.0_f64.exp())).abs() < 1e-15);
        // sRGB's decoding of 0.5, and of 0.5 -+ 0.28209479177387814.
        let decoded = |v: f64| ((v + 0.055) / 1.055).powf(2.4);
        let close = |name: &str, row: usize, value: f64| {
            assert!((values(&columns, name)[row] - value).abs() < 1e-12, "{name} {row}");
        };
        close("r", 0, decoded(0.5));
        close("g", 0, 1.0);
        close("b", 0, 0.0);
        close("r", 1, decoded(0.5 + 0.5 * 0.282_094_791_773_878_14));
        close("g", 1, decoded(0.5 - 0.282_094_791_773_878_14));
        close("b", 1, decoded(0.5 + 0.282_094_791_773_878_14));
        // The file's own stay within reach, but for what is hidden.
        assert_eq!(values(&columns, "scale_1"), [f64::from(scale[1]), 0.25]);
        assert_eq!(values(&columns, "f_dc_1"), [100.0, -1.0]);
        let expected = [
            "x", "y", "z", "radius", "opacity", "r", "g", "b", "f_dc_0", "f_dc_1", "f_dc_2", "scale_0", "scale_1",
            "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
        ];
        assert_eq!(columns.names(), expected);
        assert_eq!(columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(), expected);
        assert!(columns.iter().all(|column| !column.byte));
        assert_eq!(columns.color_names(), Some(["r", "g", "b"]));
        let first = first.get_or_insert_with(|| columns.clone());
        assert_eq!(&columns, first, "{format}");
    }
}

#[test]
fn splats_are_particles_without_more_ado() {
    let rows = [splat([0.0; 3], 1000.0, [-1.0; 3]), splat([0.0; 3], -1000.0, [-1.0; 3])];
    let bytes = file("binary_little_endian", &PLAIN, &rows);
    let columns = read(&bytes, &selection(&entry())).unwrap();
    // What is not wanted is not kept.
    assert!(columns.get("scale_0").is_none() && columns.get("f_dc_0").is_none() && columns.get("rot_0").is_none());
    let set = from_columns(&entry(), columns, Path::new("splats.ply"), &mut Vec::new()).unwrap();
    assert_eq!(set.opacity, Attribute::Each(vec![MAX_OPACITY, 0.0]));
    assert_eq!(set.radius, Attribute::Each(vec![3.0 * (-1.0_f64).exp(); 2]));
    assert!((set.color.get(1)[2] - 0.214_041_14).abs() < 1e-6, "{:?}", set.color.get(1));
}

#[test]
fn only_what_is_wanted_is_derived() {
    let bytes = file("binary_big_endian", &PLAIN, &[splat([0.0; 3], 0.0, [500.0; 3])]);
    let columns = read(&bytes, &Selection::named(["z", "g", "scale_2"])).unwrap();
    let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["z", "g", "scale_2"], "and no radius, which would be infinite");
    assert_eq!((values(&columns, "z"), values(&columns, "scale_2")), ([3.0].as_slice(), [500.0].as_slice()));
    assert!(read(&bytes, &Selection::named(["nothing"])).unwrap().iter().next().is_none());
}

#[test]
fn a_note_says_what_is_dropped() {
    let note = |names: &[&str], rows: &[Vec<f32>]| {
        let columns = read(&file("binary_little_endian", names, rows), &selection(&entry())).unwrap();
        columns.notes.join("\n")
    };
    let row = |ratio: f32| splat([0.0; 3], 0.0, [0.0, -ratio.ln(), -ratio.ln() * 0.5]);
    let found = note(&PLAIN, &[row(1.0), row(3.0), row(50.0)]);
    assert_eq!(
        found,
        "3 Gaussian splats become round particles, of which rotation and unequal scales (median ratio of longest to \
         shortest axis: 3.0) are dropped; the fall-off of a splat's opacity is that of the Gaussian kernel with \
         opacity_model = \"linear\""
    );
    // Round ones without view-dependent colour lose nothing.
    let round = note(&PLAIN, &[row(1.0)]);
    assert!(!round.contains("dropped") && round.contains("1 Gaussian splats"), "{round}");
    let mut names = PLAIN[..10].to_vec();
    let rest: Vec<String> = (0..45).map(|i| format!("f_rest_{i}")).collect();
    names.extend(rest.iter().map(String::as_str));
    let mut long = row(3.0)[..10].to_vec();
    long.extend([0.0; 45]);
    let found = note(&names, &[long]);
    assert!(
        found.contains("unequal scales (median ratio of longest to shortest axis: 3.0) and 45 coefficients"),
        "{found}"
    );
    assert!(!found.contains("rotation"), "{found}");
    assert_eq!(note(&PLAIN, &[]), "");
    let extreme = note(&PLAIN, &[row(1e30)]);
    assert!(extreme.contains("axis: 4"), "{extreme}");
}

#[test]
fn extreme_values_are_errors_that_say_where() {
    let wrong = |row: Vec<f32>, selection: &Selection| {
        let rows = [splat([0.0; 3], 0.0, [0.0; 3]), row];
        let messages =
            FORMATS.map(|format| read(&file(format, &PLAIN, &rows), selection).expect_err("the file is wrong"));
        messages[2].clone()
    };
    let all = Selection::All;
    for scale in [100.0, 1000.0, -1000.0] {
        let message = wrong(splat([0.0; 3], 0.0, [scale; 3]), &all);
        for part in ["vertex 1", "scale_0, scale_1, scale_2", &scale.to_string(), "allowed: a radius > 0"] {
            assert!(message.contains(part), "`{part}` is missing in {message}");
        }
    }
    let message = wrong(splat([0.0; 3], f32::NAN, [0.0; 3]), &all);
    assert!(message.contains("`opacity` of vertex 1 is NaN"), "{message}");
    let message = wrong(splat([0.0; 3], 0.0, [f32::NEG_INFINITY, 0.0, 0.0]), &all);
    assert!(message.contains("`scale_0` of vertex 1 is -inf"), "{message}");

    // To be looked at alone, they are NaN.
    let survey = Selection::Survey(["radius", "opacity", "r", "g"].map(str::to_owned).to_vec());
    let rows =
        [splat([f32::NAN, f32::MAX, 0.0], f32::NAN, [100.0; 3]), splat([0.0; 3], 0.0, [f32::INFINITY, 0.0, 0.0])];
    for format in FORMATS {
        let columns = read(&file(format, &PLAIN, &rows), &survey).unwrap();
        assert!(values(&columns, "radius").iter().all(|radius| radius.is_nan()));
        assert!(values(&columns, "opacity")[0].is_nan() && values(&columns, "opacity")[1] == 0.5);
        assert!(values(&columns, "r")[0].is_nan() && values(&columns, "g")[0] == 1.0);
    }
}

#[test]
fn what_is_no_splat_is_left_alone() {
    // One of the columns is missing: `opacity` is as the file has it.
    let without = |missing: &str| -> Vec<&str> { PLAIN.into_iter().filter(|name| *name != missing).collect() };
    let names = without("f_dc_1");
    let columns = read(&file("ascii", &names, &[vec![0.25; 13]]), &Selection::All).unwrap();
    assert_eq!(values(&columns, "opacity"), [0.25]);
    assert_eq!(columns.names(), names);
    assert!(columns.notes.is_empty() && !columns.has("radius"));
    // Flat splats, whose opacity is a logit.
    let message = read(&file("ascii", &without("scale_2"), &[vec![0.25; 13]]), &Selection::All).unwrap_err();
    assert!(message.contains("2D Gaussian splats") && message.contains("allowed"), "{message}");
    let packed = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
    let message = read(&file("ascii", &packed, &[vec![0.0; 4]]), &Selection::All).unwrap_err();
    assert!(message.contains("compressed Gaussian splats") && message.contains("allowed"), "{message}");
}

#[test]
fn columns_of_the_same_name_are_hidden() {
    let mut names = PLAIN.to_vec();
    names.extend(["radius", "r", "red", "green", "blue"]);
    let mut row = splat([0.0; 3], 0.0, [0.0; 3]);
    row.extend([77.0; 5]);
    let columns = read(&file("binary_little_endian", &names, &[row]), &Selection::All).unwrap();
    assert_eq!((values(&columns, "radius"), values(&columns, "red")), ([3.0].as_slice(), [77.0].as_slice()));
    assert!((values(&columns, "r")[0] - 0.214_041_14).abs() < 1e-6);
    assert_eq!(columns.names().iter().filter(|name| *name == "radius").count(), 1);
    assert_eq!(columns.color_names(), Some(["r", "g", "b"]), "not red, green, blue");
}

#[test]
fn many_blocks_agree() {
    let rows: Vec<Vec<f32>> = (0..9000)
        .map(|i| i as f32)
        .map(|i| splat([i.sin(), 0.0, 0.0], i.cos() * 4.0, [i.sin(), -1.0, i.cos()]))
        .collect();
    let columns = FORMATS.map(|format| read(&file(format, &PLAIN, &rows), &Selection::All).unwrap());
    assert!(columns[0] == columns[1] && columns[1] == columns[2]);
    assert!(columns[0].iter().all(|column| column.values.len() == 9000));
    let expected = 3.0 * ((f64::from(8999.0_f32.sin()) - 1.0 + f64::from(8999.0_f32.cos())) / 3.0).exp();
    assert!((values(&columns[0], "radius")[8999] - expected).abs() < 1e-12);
    // With lists among the properties rows are read one by one.
    let mut listed = Vec::new();
    let plain = file("binary_little_endian", &PLAIN, &rows);
    let start = plain.windows(11).position(|window| window == b"end_header\n").unwrap();
    listed.extend_from_slice(&plain[..start]);
    listed.extend_from_slice(b"property list uchar int l\nend_header\n");
    for row in plain[start + 11..].chunks(4 * PLAIN.len()) {
        listed.extend_from_slice(row);
        listed.push(0);
    }
    assert_eq!(read(&listed, &Selection::All).unwrap(), columns[1]);
}

#[test]
fn truncation_and_bit_flips_are_survived() {
    let rows = [splat([0.0, 1.0, 2.0], 0.5, [-1.0, -2.0, -3.0]), splat([0.5; 3], -2.0, [0.25; 3])];
    for format in FORMATS {
        let bytes = file(format, &PLAIN, &rows);
        // The end of a text's last line may be missing.
        let whole = bytes.len() - if format == "ascii" { 2 } else { 0 };
        for end in 0..whole {
            assert!(read(&bytes[..end], &Selection::All).is_err(), "{format} {end}");
        }
        for bit in 0..bytes.len() * 8 {
            let mut bytes = bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            if let Ok(columns) = read(&bytes, &Selection::All) {
                assert!(columns.iter().flat_map(|column| &column.values).all(|value| value.is_finite()));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_floats_are_survived(bits in proptest::collection::vec(any::<u32>(), 14..60), lenient in any::<bool>()) {
        let rows: Vec<Vec<f32>> =
            bits.chunks_exact(14).map(|row| row.iter().map(|&bits| f32::from_bits(bits)).collect()).collect();
        let names = ["x", "radius", "opacity", "r", "g", "b"].map(str::to_owned).to_vec();
        let selection = if lenient { Selection::Survey(names) } else { Selection::Named(names) };
        let columns = read(&file("binary_little_endian", &PLAIN, &rows), &selection);
        prop_assert!(columns.is_ok() || !lenient);
        if let Ok(columns) = columns {
            let radii = values(&columns, "radius");
            prop_assert!(radii.iter().all(|&r| r > 0.0 && r.is_finite() || lenient && r.is_nan()));
            let opacities = values(&columns, "opacity");
            prop_assert!(opacities.iter().all(|&o| (0.0..=MAX_OPACITY).contains(&o) || lenient && o.is_nan()));
        }
    }
}
