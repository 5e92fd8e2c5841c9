//! One cloud in every format gives the same bytes of picture.

use super::Place;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

const NAMES: [&str; 8] = ["x", "y", "z", "radius", "opacity", "r", "g", "b"];
const COUNT: usize = 200;

/// The cloud: eight numbers a particle, none of them round.
fn cloud() -> Vec<[f64; 8]> {
    let mut state = 5u64;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let particle = |_| {
        let [x, y, z] = std::array::from_fn(|_| 4.0 * next() - 2.0);
        [x, y, z, 0.1 + next(), 0.9 * next(), next(), next(), next()]
    };
    (0..COUNT).map(particle).collect()
}

/// All numbers as text, a line for each particle.
fn lines(columns: std::ops::Range<usize>, separator: &str) -> String {
    let line =
        |row: &[f64; 8]| row[columns.clone()].iter().map(f64::to_string).collect::<Vec<_>>().join(separator) + "\n";
    cloud().iter().map(line).collect()
}

/// All numbers as bytes, particle by particle.
fn bytes(columns: std::ops::Range<usize>, big: bool) -> Vec<u8> {
    let number = |value: &f64| if big { value.to_be_bytes() } else { value.to_le_bytes() };
    cloud().iter().flat_map(|row| row[columns.clone()].iter().flat_map(number).collect::<Vec<_>>()).collect()
}

fn csv() -> Vec<u8> {
    (NAMES.join(",") + "\n" + &lines(0..8, ",")).into_bytes()
}

fn ply(format: &str) -> Vec<u8> {
    let properties: String = NAMES.iter().map(|name| format!("property double {name}\n")).collect();
    let head = format!("ply\nformat {format} 1.0\nelement vertex {COUNT}\n{properties}end_header\n");
    let data = match format {
        "ascii" => lines(0..8, " ").into_bytes(),
        other => bytes(0..8, other == "binary_big_endian"),
    };
    [head.into_bytes(), data].concat()
}

fn vtk(binary: bool, unstructured: bool) -> Vec<u8> {
    let data = |columns: std::ops::Range<usize>| {
        let mut data = if binary { bytes(columns, true) } else { lines(columns, " ").into_bytes() };
        data.push(b'\n');
        data
    };
    let mut file = format!(
        "# vtk DataFile Version 3.0\na cloud\n{}\nDATASET {}\nPOINTS {COUNT} double\n",
        if binary { "BINARY" } else { "ASCII" },
        if unstructured { "UNSTRUCTURED_GRID" } else { "POLYDATA" }
    )
    .into_bytes();
    file.extend(data(0..3));
    file.extend(format!("POINT_DATA {COUNT}\n").into_bytes());
    for (column, name) in NAMES.iter().enumerate().skip(3).take(2) {
        file.extend(format!("SCALARS {name} double 1\nLOOKUP_TABLE default\n").into_bytes());
        file.extend(data(column..column + 1));
    }
    file.extend(format!("FIELD FieldData 1\nrgb 3 {COUNT} double\n").into_bytes());
    file.extend(data(5..8));
    file
}

fn vtp(format: &str) -> Vec<u8> {
    let mut appended: Vec<u8> = Vec::new();
    let mut array = |name: &str, columns: std::ops::Range<usize>| {
        let count = columns.len();
        let head = format!("<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{count}\" format=");
        let block = || {
            let data = bytes(columns.clone(), false);
            [&(data.len() as u32).to_le_bytes()[..], &data].concat()
        };
        match format {
            "ascii" => format!("{head}\"ascii\">\n{}</DataArray>\n", lines(columns.clone(), " ")),
            "binary" => format!("{head}\"binary\">\n{}\n</DataArray>\n", STANDARD.encode(block())),
            _ => {
                let text = format!("{head}\"appended\" offset=\"{}\"/>\n", appended.len());
                appended.extend(block());
                text
            }
        }
    };
    let arrays =
        array("radius", 3..4) + &array("opacity", 4..5) + &array("r", 5..6) + &array("g", 6..7) + &array("b", 7..8);
    let points = array("Points", 0..3);
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n<PolyData>\n\
         <Piece NumberOfPoints=\"{COUNT}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n\
         <PointData>\n{arrays}</PointData>\n<Points>\n{points}</Points>\n</Piece>\n</PolyData>\n"
    )
    .into_bytes();
    if !appended.is_empty() {
        file.extend(b"<AppendedData encoding=\"raw\">\n_");
        file.extend(&appended);
        file.extend(b"\n</AppendedData>\n");
    }
    file.extend(b"</VTKFile>\n");
    file
}

fn npy(structured: bool, fortran: bool) -> Vec<u8> {
    let fields: Vec<String> = NAMES.iter().map(|name| format!("('{name}', '<f8')")).collect();
    let (kind, shape) = match structured {
        true => (format!("[{}]", fields.join(", ")), format!("({COUNT},)")),
        false => ("'<f8'".to_owned(), format!("({COUNT}, 8)")),
    };
    let order = if fortran { "True" } else { "False" };
    let mut head = format!("{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}");
    while (10 + head.len() + 1) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((head.len() as u16).to_le_bytes());
    file.extend(head.into_bytes());
    match fortran {
        true => (0..8).for_each(|column| file.extend(bytes(column..column + 1, false))),
        false => file.extend(bytes(0..8, false)),
    }
    file
}

#[test]
fn the_same_cloud_gives_the_same_picture_in_every_format() {
    let files: [(&str, Vec<u8>); 16] = [
        ("a.csv", csv()),
        ("text.ply", ply("ascii")),
        ("little.ply", ply("binary_little_endian")),
        ("big.ply", ply("binary_big_endian")),
        ("text.vtk", vtk(false, false)),
        ("binary.vtk", vtk(true, false)),
        ("text_grid.vtk", vtk(false, true)),
        ("binary_grid.vtk", vtk(true, true)),
        ("text.vtp", vtp("ascii")),
        ("base64.vtp", vtp("binary")),
        ("raw.vtp", vtp("appended")),
        ("rows.npy", npy(false, false)),
        ("columns.npy", npy(false, true)),
        ("fields.npy", npy(true, false)),
        // A name that says nothing, or the wrong thing: the content decides.
        ("cloud", ply("ascii")),
        ("wrong.csv", vtk(true, false)),
    ];
    let place = Place::empty();
    let mut first: Option<Vec<Vec<u8>>> = None;
    for (name, content) in files {
        place.write(name, content);
        let scene = format!(
            "[camera]\nposition = [0, 0, 6]\nlook_at = [0, 0, 0]\nsize = [64, 48]\n[stereo]\nconvergence = 6\n\
             [[particles]]\nfile = \"{name}\"\n"
        );
        place.write("scene.toml", scene);
        place.run("render scene.toml -o . --image exr").ok();
        place.run("render scene.toml -o .").ok();
        let pictures = ["left.exr", "right.exr", "anaglyph.png", "sbs.png"];
        let pictures = pictures.map(|picture| place.bytes(&format!("scene.{picture}"))).to_vec();
        assert!(pictures[0].len() > 1000);
        match &first {
            None => first = Some(pictures),
            Some(first) => assert!(*first == pictures, "{name} gives another picture than CSV"),
        }
    }
}
