//! Meshes from OBJ and PLY files, and triangles from polygons.

use glam::{DVec2, DVec3};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use stereomist::input::mesh::{MeshEntry, load_mesh_noting};
use stereomist::input::ply::has_faces;
use stereomist::render::opaque::draw;
use stereomist::scene::mesh::Wrap;
use stereomist::scene::{Camera, Mesh, Scene};

// -------------------------------------------------------------------------------------------------------------- shared

const GREY: [f32; 3] = [0.6; 3];

/// A folder with files in it.
fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder
}

/// The first of the files as a mesh, and the notes, without the folder's name.
fn load(files: &[(&str, &[u8])]) -> Result<(Mesh, Vec<String>), String> {
    let folder = folder(files);
    let mut notes = Vec::new();
    let clean = |text: String| text.replace(&folder.path().display().to_string(), "");
    match load_mesh_noting(&MeshEntry::new(folder.path().join(files[0].0)), &mut notes) {
        Ok(mesh) => {
            check(&mesh);
            Ok((mesh, notes.into_iter().map(clean).collect()))
        }
        Err(error) => Err(clean(error.to_string())),
    }
}

fn obj(text: &str) -> (Mesh, Vec<String>) {
    load(&[("a.obj", text.as_bytes())]).unwrap()
}

fn obj_error(text: &str) -> String {
    load(&[("a.obj", text.as_bytes())]).expect_err("the text is wrong")
}

/// What every mesh promises.
fn check(mesh: &Mesh) {
    let count = mesh.positions.len();
    assert!(mesh.corners.iter().flatten().all(|&corner| (corner as usize) < count));
    assert_eq!(mesh.triangle_materials.len(), mesh.corners.len());
    assert!(mesh.triangle_materials.iter().all(|&m| (m as usize) < mesh.materials.len()));
    assert!(mesh.materials.iter().all(|m| m.texture.is_none_or(|t| (t as usize) < mesh.textures.len())));
    for length in [mesh.normals.len(), mesh.texture_coordinates.len(), mesh.colors.len()] {
        assert!(length == 0 || length == count);
    }
    assert!(mesh.positions.iter().chain(&mesh.normals).all(|v| v.is_finite()));
    assert!(mesh.texture_coordinates.iter().all(|v| v.is_finite()));
    assert!(mesh.colors.iter().flatten().all(|v| v.is_finite()));
}

fn assert_says(message: &str, parts: &[&str]) {
    assert!(!message.contains('\n'), "one line: {message}");
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing in: {message}");
    }
}

/// The points of each triangle.
fn triangles(mesh: &Mesh) -> Vec<[DVec3; 3]> {
    mesh.corners.iter().map(|corners| corners.map(|corner| mesh.positions[corner as usize])).collect()
}

fn png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let (color, format) = (image::ExtendedColorType::Rgb8, image::ImageFormat::Png);
    image::write_buffer_with_format(&mut bytes, rgb, width, height, color, format).unwrap();
    bytes.into_inner()
}

fn white() -> Vec<u8> {
    png(1, 1, &[255; 3])
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

// ----------------------------------------------------------------------------------------------------------------- OBJ

#[test]
fn obj_corners_of_every_form() {
    let start = format!("{TRIANGLE}vt 0.25 0.75\nvn 0 0 2\n");
    for face in [
        "1 2 3",
        "1/1 2/1 3/1",
        "1//1 2//1 3//1",
        "1/1/1 2/1/1 3/1/1",
        "-3 -2 -1",
        "-3/-1/-1 2/1/1 -1/1/-1",
        "1/ 2// 3",
    ] {
        let (mesh, notes) = obj(&format!("{start}f {face}\n"));
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::Y], "{face}");
        assert_eq!(mesh.corners, [[0, 1, 2]]);
        assert_eq!(mesh.materials[0].color, GREY);
        // Without a texture its coordinates are of no use.
        assert!(mesh.texture_coordinates.is_empty() && mesh.colors.is_empty());
        let has_normal = face.contains("/1/1") || face.contains("//1");
        assert_eq!(mesh.normals, if has_normal { vec![DVec3::Z; 3] } else { vec![] }, "{face}");
    }
    // A face without normals beside one with them has its own.
    let (mesh, _) = obj(&format!("{start}f 1 2 3\nf 1//1 2//1 3//1\n"));
    assert_eq!(mesh.normals[..3], [DVec3::ZERO; 3]);
    assert_eq!(mesh.normals[3..], [DVec3::Z; 3]);
}

#[test]
fn obj_vertices_are_shared_where_all_is_the_same() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\nf 1//2 3//1 4//1\n";
    let (mesh, _) = obj(text);
    assert_eq!(mesh.positions.len(), 5);
    assert_eq!(mesh.corners, [[0, 1, 2], [0, 2, 3], [4, 2, 3]]);
}

#[test]
fn obj_text_is_read_as_others_write_it() {
    let (expected, _) = obj(&format!("{TRIANGLE}f 1 2 3\n"));
    for text in [
        "\u{feff}# made by \\\nv 0 0 0\r\nv 1 0 0 1.0\r\n\r\n  v 0 1 0 # the third\r\no a b\ng x\ns off\nf 1 2 3",
        "v 0 \\\n0 0\nv 1.0 0e0 \\\r\n +0\nv 0 1 0\nf 1 \\\n 2 \\\n 3 \\\n",
        "v\t0\t0\t0\nv 1 0 0\nv 0 1 0\nvp 1 2\nlod 3\nf  1   2\t3  #comment\nusemtl",
    ] {
        let (mesh, notes) = obj(text);
        assert_eq!((&mesh.positions, &mesh.corners), (&expected.positions, &expected.corners), "{text}");
        assert!(notes.is_empty(), "{notes:?}");
    }
}

#[test]
fn obj_vertex_colours_are_those_of_a_screen() {
    let (mesh, _) = obj("v 0 0 0 1 0.5 0\nv 1 0 0 0 0 0.25\nv 0 1 0\nv 5 5 5\nv 6 5 5\nv 5 6 5\nf 1 2 3\nf 4 5 6\n");
    let [half, quarter] = [0.5, 0.25].map(|value| stereomist::picture::color::decode(value) as f32);
    assert_eq!(mesh.colors[..3], [[1.0, half, 0.0], [0.0, 0.0, quarter], [1.0; 3]]);
    let (bytes, _) = obj("v 0 0 0 255 127.5 0\nv 1 0 0 0 0 63.75\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(bytes.colors[..3], mesh.colors[..3]);
    // What has no colour at all has the entry's.
    let color = |i: usize| mesh.materials[mesh.triangle_materials[i] as usize].color;
    assert_eq!((color(0), color(1), mesh.colors[4]), ([1.0; 3], GREY, [1.0; 3]));
}

#[test]
fn what_obj_has_beside_faces_is_noted_once() {
    let (_, notes) = obj(&format!(
        "{TRIANGLE}p 1\nl 1 2\nl 2 3\ncstype bezier\ndeg 3\ncurv 0 1 1 2 3\nend\nf 1 2\nf 1 2 3\nwhat ever\nwhat now\n"
    ));
    let expected = [
        "/a.obj: 3 statements of points or lines are left out, the first in line 4",
        "/a.obj: one free-form curve or surface is left out, in line 9",
        "/a.obj: one face of less than three corners is left out, in line 11",
        "/a.obj: 2 unknown statements are left out, the first: `what` in line 13",
    ];
    assert_eq!(notes, expected);
}

#[test]
fn obj_errors_say_the_line() {
    let face = |face: &str| obj_error(&format!("{TRIANGLE}{face}\n"));
    assert_says(&face("f 1 2 4"), &["a.obj: line 4", "`4` asks for position 4", "3", "1 to 3, or -3 to -1"]);
    assert_says(&face("f 1 2 -4"), &["line 4", "position -4"]);
    assert_says(&face("f 0 1 2"), &["line 4", "position 0"]);
    assert_says(&face("f 1/1 2 3"), &["line 4", "`1/1`", "texture coordinate 1", "allowed: none"]);
    assert_says(&face("f 1//2 2 3"), &["line 4", "normal 2"]);
    assert_says(&face("f 1 2 x"), &["line 4", "`x` is no corner", "v/vt/vn"]);
    assert_says(&face("f 1 2 /3"), &["line 4", "`/3` is no corner"]);
    assert_says(&face("f 1 2 3/1/1/1"), &["line 4"]);
    assert_says(&face("f 1 2 3///"), &["line 4", "too many parts"]);
    assert_says(&face("f 1 2 99999999999999999999"), &["line 4", "no corner"]);
    assert_says(&face("f 1 2 \\\n  7"), &["line 4", "`7`"]);
    assert_says(&obj_error("v 1 2\n"), &["line 1", "`v` with 2 numbers", "v x y z"]);
    assert_says(&obj_error("\nv 1 2 3 4 5\n"), &["line 2", "`v` with 5 numbers"]);
    assert_says(&obj_error("v 1 2 3 4 5 6 7\n"), &["line 1", "more than 6"]);
    assert_says(&obj_error("v 1 nan 3\n"), &["line 1", "`nan` is not finite"]);
    assert_says(&obj_error("v 1 1,5 3\n"), &["line 1", "`1,5` is not a number"]);
    assert_says(&obj_error("v 1 1 3 1e300 0 0\n"), &["line 1", "colour"]);
    assert_says(&obj_error("vt\n"), &["line 1", "vt u [v [w]]"]);
    assert_says(&obj_error("vn 1 2\n"), &["line 1", "vn x y z"]);
    assert_says(&obj_error("mtllib\n"), &["line 1", "mtllib FILE.mtl"]);
    assert_says(&obj_error(TRIANGLE), &["holds no faces"]);
    assert_says(&obj_error(&format!("{TRIANGLE}l 1 2\n")), &["holds no faces", "points, lines"]);
    assert_says(&obj_error("\x7fELF\x02 a\n"), &["holds no faces", "in line 1"]);
    assert_says(&obj_error(&format!("v {}1e80 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "")), &["coordinates within"]);
    let long = format!("v {}0 0 0\n", " ".repeat(1 << 24));
    assert_says(&obj_error(&long), &["line 1", "longer than"]);
    let long = format!("v{} 0 0 0\n", " \\\n".repeat(1 << 10));
    assert_says(&obj_error(&long), &["no faces"]);
}

// ----------------------------------------------------------------------------------------------------------- materials

/// A quad with texture coordinates in the corners of the texture, its material's library in a file.
fn with_library(library: &str, files: &[(&str, &[u8])]) -> Result<(Mesh, Vec<String>), String> {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\n\
                f 1/1 2/2 3/3 4/4\n";
    let mut all: Vec<(&str, &[u8])> = vec![("a.obj", text.as_bytes()), ("a.mtl", library.as_bytes())];
    all.extend(files);
    load(&all)
}

#[test]
fn mtl_colours_and_textures() {
    let picture = png(2, 1, &[255, 255, 255, 188, 0, 0]);
    let (mesh, notes) =
        with_library("newmtl n\nKd 1 1 1\n\nnewmtl m\nKa 1 1 1\nKd 0.5 0.25 0\nillum 2\n", &[]).unwrap();
    assert_eq!((mesh.materials[0].color, notes.len()), ([0.5, 0.25, 0.0], 0));
    let (mesh, _) = with_library("newmtl m\nkd 0.5 # grey\n", &[]).unwrap();
    assert_eq!(mesh.materials[0].color, [0.5; 3]);
    let (mesh, _) = with_library("newmtl m\nNs 3\n", &[]).unwrap();
    assert_eq!(mesh.materials[0].color, GREY);

    for (library, file) in [
        ("newmtl m\nKd 1 1 1\nmap_Kd a.png\n", "a.png"),
        ("newmtl m\r\nmap_Kd my pictures/a b.png\r\n", "my pictures/a b.png"),
        ("newmtl m\nmap_Kd my pictures\\a b.png # the picture\n", "my pictures/a b.png"),
        ("newmtl m\nmap_Kd C:\\Users\\me\\a.png\n", "a.png"),
        ("newmtl m\nmap_Kd -blendu on -bm 1.5 -texres 512 -type sphere 3.png\n", "3.png"),
        ("newmtl m\nmap_Kd -o 0 -s 1 1 1 7\n", "7"),
    ] {
        let (mesh, notes) = with_library(library, &[(file, &picture)]).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!((mesh.textures[0].width, mesh.textures[0].wrap), (2, [Wrap::Repeat; 2]), "{library}");
        assert_eq!(mesh.textures[0].texels[0], [1.0; 3]);
        assert!((mesh.textures[0].texels[1][0] - 0.502_886_5).abs() < 1e-6, "decoded from sRGB");
        assert_eq!((mesh.materials[0].color, mesh.materials[0].texture), ([1.0; 3], Some(0)));
        // v points up in the file, down in the mesh.
        assert_eq!(mesh.texture_coordinates, [DVec2::Y, DVec2::ONE, DVec2::X, DVec2::ZERO]);
    }
    let (mesh, notes) =
        with_library("newmtl m\nmap_Kd -clamp on -s 2 3 -o 0.5 0.25 0 -mm 0 1 a.png", &[("a.png", &picture)]).unwrap();
    assert_eq!(notes, ["/a.obj: the option -mm of map_Kd is left out"]);
    assert_eq!(mesh.textures[0].wrap, [Wrap::Clamp; 2]);
    assert_eq!(mesh.texture_coordinates[2], DVec2::new(2.5, 1.0 - 3.25));
    let (_, notes) = with_library("newmtl m\nKd 0 0 0\nmap_Kd a.png", &[("a.png", &picture)]).unwrap();
    assert_says(&notes[0], &["black Kd", "`m`"]);
}

#[test]
fn mtl_one_vertex_with_two_mappings() {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 2/1 3/1\n\
                usemtl c\nf 1/1 2/1 3/1\nusemtl a\nf 1/1 2/1 3/1\nf 1 2 3\n";
    let library = "newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd -o 1 1 a.png\nnewmtl c\nmap_Kd -clamp on a.png\n";
    let files: [(&str, &[u8]); 3] = [("a.obj", text.as_bytes()), ("a.mtl", library.as_bytes()), ("a.png", &white())];
    let (mesh, notes) = load(&files).unwrap();
    assert_eq!(notes, ["/a.obj: a texture is left out where its texture coordinates are missing"]);
    assert_eq!(mesh.corners, [[0, 1, 2], [3, 4, 5], [0, 1, 2], [0, 1, 2], [6, 7, 8]]);
    assert_eq!(mesh.triangle_materials, [0, 1, 2, 0, 3]);
    let textures: Vec<_> = mesh.materials.iter().map(|material| material.texture).collect();
    assert_eq!(textures, [Some(0), Some(0), Some(1), None]);
}

#[test]
fn mtl_names_and_libraries() {
    let text = "mtllib first.mtl second one.mtl sub\\third.mtl gone.mtl\nmtllib the fourth.mtl\nmtllib first.mtl\n\
                v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl Material #25\nf 1 2 3\nusemtl b # comment\nf 1 2 3\n\
                usemtl c\nf 1/1 2/1 3/1\nusemtl d d\nf 1 2 3\nusemtl none\nf 1 2 3\n";
    let (mesh, notes) = load(&[
        ("a.obj", text.as_bytes()),
        ("first.mtl", b"newmtl Material #25\nKd 0.1 0 0\n"),
        ("second one.mtl", b"newmtl b\nKd 0.2 0 0\nnewmtl Material #25\nKd 0.9 0 0\n"),
        // Its picture is beside it.
        ("sub/third.mtl", b"newmtl c\nmap_Kd c.png\n"),
        ("sub/c.png", &white()),
        ("the fourth.mtl", b"newmtl d d\nKd 0.4 0 0\n"),
    ])
    .unwrap();
    let colors: Vec<f32> =
        mesh.triangle_materials.iter().map(|&material| mesh.materials[material as usize].color[0]).collect();
    assert_eq!(colors, [0.1, 0.2, 1.0, 0.4, 0.6]);
    let expected = [
        "/a.obj: of several materials of one name the first is used",
        "/a.obj: there is no material library `gone.mtl`: the entry's colour is used",
        "/a.obj: there is no material `none`: the entry's colour is used",
    ];
    assert_eq!(notes, expected);
}

#[test]
fn mtl_what_is_missing_is_noted_and_what_is_broken_is_an_error() {
    let (mesh, notes) = with_library("newmtl m\nKd 1 0 0\nmap_Kd no.png\n", &[]).unwrap();
    assert_eq!(notes, ["/a.obj: there is no texture `no.png` of material `m`: the entry's colour is used"]);
    assert_eq!((mesh.materials[0].color, mesh.textures.len()), (GREY, 0));
    let text = format!("mtllib b.mtl\nmtllib c.mtl\nusemtl m\n{TRIANGLE}f 1 2 3\n");
    let (mesh, notes) = obj(&text);
    assert_eq!(notes, ["/a.obj: 2 material libraries are not there, the first: `b.mtl`: the entry's colour is used"]);
    assert_eq!(mesh.materials[0].color, GREY);
    let (_, notes) = with_library("newmtl m\nd 0.5\nTr 0.5\nmap_d a.png\nmap_Bump b.png\nnorm c.png\n", &[]).unwrap();
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert_says(&notes[0], &["transparency"]);
    assert_says(&notes[1], &["maps other than map_Kd"]);

    let wrong = |library: &str, files: &[(&str, &[u8])]| with_library(library, files).unwrap_err();
    assert_says(&wrong("newmtl m\n\nKd 1 x 0\n", &[]), &["a.obj: line 1", "a.mtl: line 3", "`Kd 1 x 0`", "`x` is not"]);
    assert_says(&wrong("newmtl m\nKd 1 2\n", &[]), &["a.mtl: line 2", "allowed: Kd r g b"]);
    assert_says(&wrong("newmtl m\nKd 1e300 2 3\n", &[]), &["a.mtl: line 2", "too large"]);
    assert_says(&wrong("newmtl\n", &[]), &["a.mtl: line 1", "newmtl NAME"]);
    assert_says(&wrong("newmtl m\nmap_Kd -s x a.png\n", &[]), &["a.mtl: line 2", "`x` is not a number"]);
    assert_says(&wrong("newmtl m\nd x\n", &[]), &["a.mtl: line 2", "`x` is not a number"]);
    assert_says(&wrong("newmtl m\nd\n", &[]), &["a.mtl: line 2", "missing"]);
    let broken: &[u8] = &png(2, 2, &[0; 12])[..50];
    assert_says(&wrong("newmtl m\nmap_Kd a.png\n", &[("a.png", broken)]), &["line 10", "texture", "a.png"]);
    assert_says(&wrong("newmtl m\nmap_Kd a.tga\n", &[("a.tga", b"x")]), &["a.tga", "neither PNG nor JPEG"]);
    assert_says(&wrong("newmtl m\nmap_Kd sub\n", &[("sub/a", b"x")]), &["not a regular file"]);
    assert_says(&wrong(&"# long\n".repeat(3 << 20), &[]), &["a.mtl", "too large"]);
}

#[test]
fn obj_a_colour_of_the_vertices_and_one_of_the_material_are_multiplied() {
    let text = "mtllib a.mtl\nusemtl m\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n";
    let (mesh, _) = load(&[("a.obj", text.as_bytes()), ("a.mtl", b"newmtl m\nKd 0.5 0.5 0.5\n")]).unwrap();
    assert_eq!((mesh.materials[0].color, mesh.colors[2]), ([0.5; 3], [0.0, 0.0, 1.0]));
}

// -------------------------------------------------------------------------------------------------------- the two towers

fn tower(name: &str) -> Mesh {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/watertower").join(name);
    let mut notes = Vec::new();
    let mesh = load_mesh_noting(&MeshEntry::new(path), &mut notes).unwrap();
    assert!(notes.is_empty(), "{notes:?}");
    mesh
}

fn scene(mesh: Mesh, size: [u32; 2]) -> Scene {
    Scene {
        camera: Camera {
            position: DVec3::new(0.3, 0.8, 2.0),
            look_at: DVec3::new(0.0, 0.35, 0.0),
            up: DVec3::Y,
            fov_y: 0.5,
            size,
            near: 0.01,
            samples: 1,
        },
        stereo: None,
        background: [0.0; 3],
        particles: Vec::new(),
        meshes: vec![mesh],
    }
}

#[test]
fn the_tower_is_the_same_as_obj_and_as_gltf() {
    let layers = ["watertower.obj", "watertower.gltf"].map(|name| {
        let scene = scene(tower(name), [160, 160]);
        draw(&scene, &scene.views()[0]).unwrap()
    });
    let [obj, gltf] = &layers;
    let mut covered = 0;
    let mut differing = 0;
    for (i, (a, b)) in obj.depth.iter().zip(&gltf.depth).enumerate() {
        let close = obj.color[i].iter().zip(gltf.color[i]).all(|(a, b)| (a - b).abs() < 2e-3);
        covered += usize::from(a.is_finite());
        // The six digits of the OBJ file move outlines by as much.
        differing += usize::from(a.is_finite() != b.is_finite() || a.is_finite() && (a - b).abs() > 1e-4 || !close);
    }
    assert!(covered > 4000 && differing <= 8, "{differing} of {covered} differ");
}

// ------------------------------------------------------------------------------------------------------------- polygons

/// The triangles of a polygon in a plane, through an OBJ file.
fn cut(outline: &[DVec3]) -> Vec<[DVec3; 3]> {
    let mut text = String::new();
    for p in outline {
        text += &format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z);
    }
    let face: Vec<String> = (1..=outline.len()).map(|i| i.to_string()).collect();
    triangles(&obj(&format!("{text}f {}\n", face.join(" "))).0)
}

fn twice_area(triangle: &[DVec3; 3]) -> DVec3 {
    (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0])
}

/// n - 2 triangles that face as the polygon does, none over another: their sizes add up to the polygon's.
fn assert_proper(outline: &[DVec3]) {
    let found = cut(outline);
    assert_eq!(found.len(), outline.len() - 2);
    let newell: DVec3 = (0..outline.len())
        .map(|i| (outline[i] - outline[0]).cross(outline[(i + 1) % outline.len()] - outline[0]))
        .sum();
    let normal = newell.normalize();
    let sum: f64 = found.iter().map(|triangle| twice_area(triangle).length()).sum();
    assert!((sum - newell.length()).abs() < 1e-9 * sum, "{sum} for {}", newell.length());
    assert!(found.iter().all(|triangle| twice_area(triangle).dot(normal) >= -1e-12 * sum));
}

#[test]
fn polygons_are_cut_properly() {
    let flat = |points: &[[f64; 2]]| points.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect::<Vec<_>>();
    let outlines = [
        // Convex ones, a dart, an L, a comb, one with points on its straight sides.
        vec![[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]],
        vec![[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [2.0, 2.0], [0.0, 2.0]],
        vec![[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]],
        vec![[0.5, 0.0], [2.0, 1.0], [0.0, 0.0], [2.0, -1.0]],
        vec![[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]],
        vec![
            [0.0, 0.0],
            [7.0, 0.0],
            [7.0, 3.0],
            [6.0, 3.0],
            [6.0, 1.0],
            [5.0, 1.0],
            [5.0, 3.0],
            [4.0, 3.0],
            [4.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ],
        vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 1.5], [1.0, 2.0], [0.0, 2.0]],
        // A square with a square hole, joined to it by a slit that is walked twice.
        vec![
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
            [1.0, 1.0],
        ],
    ];
    for outline in &outlines {
        let outline = flat(outline);
        // In every plane, either way round, and beginning anywhere.
        for turn in 0..12 {
            let angle = f64::from(turn);
            let rotation = glam::DMat3::from_axis_angle(DVec3::new(angle.sin(), 0.7, angle.cos()).normalize(), angle);
            let mut turned: Vec<DVec3> = outline.iter().map(|&p| rotation * p + DVec3::splat(3.0)).collect();
            if turn % 2 == 1 {
                turned.reverse();
            }
            let by = turn as usize % turned.len();
            turned.rotate_left(by);
            assert_proper(&turned);
        }
    }
    // A spiral.
    let arm = |r: f64| (0..200).map(move |i| (f64::from(i) * 0.1, r));
    let at = |(angle, r): (f64, f64)| DVec3::new((r + angle) * angle.cos(), (r + angle) * angle.sin(), 0.0);
    let spiral: Vec<DVec3> = arm(3.0).chain(arm(1.0).collect::<Vec<_>>().into_iter().rev()).map(at).collect();
    assert_proper(&spiral);
}

#[test]
fn odd_polygons_are_survived() {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    for outline in [
        vec![DVec3::ZERO; 5],
        vec![p(0.0, 0.0), p(1.0, 0.0), p(2.0, 0.0), p(3.0, 0.0)],
        vec![p(0.0, 0.0), p(1.0, 1.0), p(1.0, 0.0), p(0.0, 1.0)],
        (0..5).map(|i| f64::from(2 * i) * 1.256_637).map(|a| p(a.cos(), a.sin())).collect(),
        vec![p(0.0, 0.0), p(1e74, 0.0), p(1e73, 1e73), p(0.0, 1e74)],
        vec![p(0.0, 0.0), p(1e-200, 0.0), p(1e-201, 1e-201), p(0.0, 1e-200)],
    ] {
        assert_eq!(cut(&outline).len(), outline.len() - 2);
    }
    // Thirty thousand corners of a comb: seconds at most.
    let begin = std::time::Instant::now();
    let comb: Vec<DVec3> = (0..15_000)
        .flat_map(|i| [p(f64::from(2 * i), 0.0), p(f64::from(2 * i + 1), 1.0)])
        .chain([p(3e4, 2.0), p(0.0, 2.0)])
        .collect();
    assert_proper(&comb);
    assert!(begin.elapsed().as_secs() < 30, "{:?}", begin.elapsed());
}

// ----------------------------------------------------------------------------------------------------------------- PLY

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

/// One value in the order of the file.
fn put(out: &mut Vec<u8>, format: &str, kind: &str, value: f64) {
    if format == "ascii" {
        out.extend_from_slice(format!("{value} ").as_bytes());
        return;
    }
    let mut bytes = match kind {
        "char" => (value as i8).to_le_bytes().to_vec(),
        "uchar" => (value as u8).to_le_bytes().to_vec(),
        "short" => (value as i16).to_le_bytes().to_vec(),
        "ushort" => (value as u16).to_le_bytes().to_vec(),
        "int" => (value as i32).to_le_bytes().to_vec(),
        "uint" => (value as u32).to_le_bytes().to_vec(),
        "float" => (value as f32).to_le_bytes().to_vec(),
        "double" => value.to_le_bytes().to_vec(),
        _ => panic!("no PLY type: {kind}"),
    };
    if format == "binary_big_endian" {
        bytes.reverse();
    }
    out.extend_from_slice(&bytes);
}

/// A PLY file: the header below the format's line, and the rows of type and value.
fn ply(format: &str, header: &str, rows: &[Vec<(&str, f64)>]) -> Vec<u8> {
    let mut out = format!("ply\nformat {format} 1.0\n{header}end_header\n").into_bytes();
    for row in rows {
        row.iter().for_each(|&(kind, value)| put(&mut out, format, kind, value));
        if format == "ascii" {
            out.push(b'\n');
        }
    }
    out
}

fn load_ply(bytes: &[u8]) -> Result<(Mesh, Vec<String>), String> {
    load(&[("a.ply", bytes)])
}

fn row<'a>(kind: &'a str, values: &[f64]) -> Vec<(&'a str, f64)> {
    values.iter().map(|&value| (kind, value)).collect()
}

/// A list of vertex indices.
fn face<'a>(count: &'a str, item: &'a str, corners: &[u32]) -> Vec<(&'a str, f64)> {
    let mut row = vec![(count, corners.len() as f64)];
    row.extend(corners.iter().map(|&corner| (item, f64::from(corner))));
    row
}

/// A dart, which is not convex, and a triangle, with everything there may be.
fn rich(format: &str) -> Vec<u8> {
    let header = "comment made for a test\ncomment TextureFile my tex.png\nelement camera 1\nproperty float f\n\
                  element vertex 5\nproperty float x\nproperty double y\nproperty short z\nproperty float nx\n\
                  property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                  property uchar alpha\nproperty float s\nproperty float t\nelement edge 1\nproperty int v1\n\
                  element face 3\nproperty uchar flags\nproperty list uchar int vertex_indices\n\
                  property list short float weights\nelement behind 1\nproperty list int int l\n";
    let vertex = |x: f64, y: f64, s: f64, t: f64| {
        let mut row =
            vec![("float", x), ("double", y), ("short", -2.0), ("float", 0.0), ("float", 0.0), ("float", 2.0)];
        row.extend([("uchar", 255.0), ("uchar", 188.0), ("uchar", 0.0), ("uchar", 9.0), ("float", s), ("float", t)]);
        row
    };
    let corners = |indices: &[u32], weights: &[f64]| {
        let mut row = vec![("uchar", 7.0)];
        row.extend(face("uchar", "int", indices));
        row.push(("short", weights.len() as f64));
        row.extend(weights.iter().map(|&weight| ("float", weight)));
        row
    };
    let rows = [
        row("float", &[1.5]),
        vertex(0.0, 0.0, 0.0, 0.0),
        vertex(2.0, -1.0, 1.0, 0.0),
        vertex(0.5, 0.0, 1.0, 1.0),
        vertex(2.0, 1.0, 0.0, 1.0),
        vertex(-5.0, 0.25, 0.5, 0.25),
        row("int", &[3.0]),
        corners(&[0, 1, 2, 3], &[]),
        corners(&[0, 1], &[0.5, 0.25]),
        corners(&[4, 0, 3], &[1.0]),
        face("int", "int", &[1, 2]),
    ];
    ply(format, header, &rows)
}

#[test]
fn ply_with_everything() {
    let picture = png(1, 2, &[255, 0, 0, 0, 255, 0]);
    for format in FORMATS {
        let bytes = rich(format);
        assert!(has_faces(&bytes));
        let (mesh, notes) = load(&[("a.ply", &bytes), ("my tex.png", &picture)]).unwrap();
        assert_eq!(notes, ["/a.ply: 1 faces of less than three corners are left out"]);
        assert_eq!(mesh.positions[1], DVec3::new(2.0, -1.0, -2.0));
        assert_eq!(mesh.normals, [DVec3::Z; 5]);
        assert_eq!(mesh.texture_coordinates[4], DVec2::new(0.5, 0.75), "v points up in the file");
        assert_eq!(mesh.colors[0][0], 1.0);
        assert!((mesh.colors[0][1] - 0.502_886_5).abs() < 1e-6, "bytes are sRGB-encoded");
        assert_eq!(mesh.corners.len(), 3);
        assert!(mesh.corners.contains(&[4, 0, 3]));
        let sizes: Vec<DVec3> = triangles(&mesh).iter().map(twice_area).collect();
        assert!((sizes[0].z + sizes[1].z - 1.0).abs() < 1e-12 && sizes[0].z > 0.0 && sizes[1].z > 0.0, "{sizes:?}");
        assert_eq!((mesh.materials[0].color, mesh.materials[0].texture), ([1.0; 3], Some(0)));
        // The texture has gone.
        let (mesh, notes) = load_ply(&bytes).unwrap();
        assert_says(&notes[0], &["no texture `my tex.png`"]);
        assert!(mesh.texture_coordinates.is_empty() && mesh.textures.is_empty());
        assert_says(&load(&[("a.ply", &bytes), ("my tex.png", b"x")]).unwrap_err(), &["my tex.png", "neither"]);
    }
}

const PLAIN: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";

#[test]
fn ply_indices_of_every_type() {
    let vertices = [row("float", &[0.0; 3]), row("float", &[1.0, 0.0, 0.0]), row("float", &[0.0, 1.0, 0.0])];
    for format in FORMATS {
        for count in ["char", "uchar", "short", "ushort", "int", "uint"] {
            for item in ["char", "uchar", "short", "ushort", "int", "uint"] {
                for name in ["vertex_indices", "vertex_index"] {
                    let header = format!("{PLAIN}element face 1\nproperty list {count} {item} {name}\n");
                    let mut rows = vertices.to_vec();
                    rows.push(face(count, item, &[2, 0, 1]));
                    let (mesh, notes) = load_ply(&ply(format, &header, &rows)).unwrap();
                    assert_eq!((mesh.corners.as_slice(), notes.len()), ([[2, 0, 1]].as_slice(), 0));
                    assert_eq!((mesh.materials[0].color, mesh.colors.len(), mesh.normals.len()), (GREY, 0, 0));
                }
            }
        }
    }
}

#[test]
fn ply_colours_of_floats_are_linear() {
    for names in [["red", "green", "blue"], ["r", "g", "b"]] {
        let mut header = PLAIN.to_owned();
        names.iter().for_each(|name| header += &format!("property float {name}\n"));
        header += "element face 1\nproperty list uchar uchar vertex_index\n";
        let mut rows = vec![row("float", &[1.0, 2.0, 3.0, 0.5, 0.25, 2.0]); 3];
        rows.push(face("uchar", "uchar", &[0, 1, 2]));
        let (mesh, _) = load_ply(&ply("binary_little_endian", &header, &rows)).unwrap();
        assert_eq!(mesh.colors, [[0.5, 0.25, 2.0]; 3]);
        assert_eq!(mesh.materials[0].color, [1.0; 3]);
    }
    let (mesh, notes) = load_ply(&ply(
        "ascii",
        "comment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n",
        &[
            row("float", &[0.0; 3]),
            row("float", &[1.0; 3]),
            row("float", &[2.0; 3]),
            row("int", &[3.0, 0.0, 1.0, 2.0, 2.0, 0.5, 0.5, 1.0, 2.0, 3.0]),
        ],
    ))
    .unwrap();
    assert_eq!((mesh.corners.len(), notes.len()), (1, 3));
    assert_says(&notes.join("; "), &["`texcoord`", "colours of faces", "texture coordinates are missing"]);
}

#[test]
fn ply_with_more_faces_than_a_block() {
    let side = 150_u32;
    let mut rows: Vec<Vec<(&str, f64)>> = Vec::new();
    for i in 0..side * side {
        rows.push(row("float", &[f64::from(i % side), f64::from(i / side), 0.0]));
    }
    let mut faces = 0;
    for i in 0..side * side {
        let [a, b, c, d] = [i, (i + 1) % (side * side), (i + side + 1) % (side * side), (i + side) % (side * side)];
        rows.push(face("uchar", "int", &[a, b, c, d][..3 + (i % 2) as usize]));
        faces += 1;
    }
    // One face that is longer than a block.
    let long: Vec<u32> = (0..100_000).map(|i| i % 7).collect();
    rows.push(face("int", "int", &long));
    let header = format!(
        "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {faces}\n\
         property list uchar int vertex_indices\nelement tail 1\nproperty list int int vertex_indices\n",
        side * side
    );
    let mut found = Vec::new();
    for format in FORMATS {
        let (mesh, _) = load_ply(&ply(format, &header, &rows)).unwrap();
        assert_eq!(mesh.corners.len(), (side * side / 2 * 3) as usize);
        found.push(mesh.corners);
    }
    assert!(found[0] == found[1] && found[1] == found[2]);
    let one = format!("{PLAIN}element face 1\nproperty list int int vertex_indices\n");
    let long: Vec<u32> = (0..100_000).map(|i| i % 3).collect();
    for format in FORMATS {
        let rows =
            [row("float", &[0.0; 3]), row("float", &[1.0; 3]), row("float", &[2.0; 3]), face("int", "int", &long)];
        assert_eq!(load_ply(&ply(format, &one, &rows)).unwrap().0.corners.len(), 99_998);
    }
}

#[test]
fn ply_errors_say_what_is_needed() {
    let wrong = |header: &str, data: &str| {
        load_ply(format!("ply\nformat ascii 1.0\n{header}end_header\n{data}").as_bytes()).unwrap_err()
    };
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    assert_says(&wrong(PLAIN, points), &["a.ply", "holds no faces", "[[particles]]"]);
    let none = format!("{PLAIN}element face 0\nproperty list uchar int vertex_indices\n");
    assert_says(&wrong(&none, points), &["holds no faces"]);
    assert!(!has_faces(format!("ply\nformat ascii 1.0\n{none}end_header\n").as_bytes()));
    let strips = format!("{PLAIN}element tristrips 1\nproperty list int int vertex_indices\n");
    assert_says(&wrong(&strips, &format!("{points}3 0 1 2\n")), &["tristrips", "allowed: an element `face`"]);
    assert!(!has_faces(format!("ply\nformat ascii 1.0\n{strips}end_header\n").as_bytes()));
    let faces = |list: &str| format!("{PLAIN}element face 1\n{list}");
    assert_says(&wrong(&faces("property int a\n"), &format!("{points}3\n")), &["no list `vertex_indices`", "`a`"]);
    assert_says(
        &wrong(&faces("property list uchar float vertex_indices\n"), &format!("{points}3 0 1 2\n")),
        &["integer"],
    );
    let list = "property list uchar int vertex_indices\n";
    let face = |data: &str| wrong(&faces(list), &format!("{points}{data}"));
    assert_says(&face("3 0 1 3\n"), &["line 13: face 0 asks for vertex 3, and there are 3"]);
    assert_says(&face("3 0 1 -1\n"), &["line 13", "vertex -1"]);
    assert_says(&face("3 0 1    \n"), &["line 13, property `vertex_indices`", "ends before"]);
    assert_says(&face("3 0 1 2 2\n"), &["line 13", "`2` follows"]);
    assert_says(&face("2 0 1    \n"), &["three corners"]);
    assert_says(&face(""), &["truncated"]);
    let first = format!("element face 1\n{list}{PLAIN}");
    assert_says(&wrong(&first, &format!("3 0 1 2\n{points}")), &["before the element `vertex`"]);
    let flat =
        "element vertex 1\nproperty float x\nproperty float y\nelement face 1\nproperty list uchar int vertex_index\n";
    assert_says(&wrong(flat, "1 2\n3 0 0 0\n"), &["no x, y and z", "`x`, `y`"]);
    assert_says(&wrong(&faces(list), "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n"), &["line 11, property `y`"]);

    let rows =
        [row("float", &[0.0; 3]), row("float", &[1.0; 3]), row("float", &[2.0; 3]), row("int", &[3.0, 0.0, 1.0, 3.0])];
    let header = faces("property list int int vertex_indices\n");
    for format in &FORMATS[1..] {
        let bytes = ply(format, &header, &rows);
        let place = format!("byte {}: face 0 asks for vertex 3", bytes.len() - 4);
        assert_says(&load_ply(&bytes).unwrap_err(), &[&place]);
    }
    // Counts that lie.
    let header = faces("property list char int vertex_indices\n").replace("face 1", "face 4000000000");
    let begin = std::time::Instant::now();
    assert_says(&load_ply(&ply(FORMATS[1], &header, &rows[..3])).unwrap_err(), &["truncated"]);
    let mut bytes = ply(FORMATS[1], &faces("property list uint int vertex_indices\n"), &rows[..3]);
    bytes.extend_from_slice(&u32::MAX.to_le_bytes());
    assert_says(&load_ply(&bytes).unwrap_err(), &["ends within property `vertex_indices` of face 0"]);
    let mut bytes = ply(FORMATS[1], &faces("property list char int vertex_indices\n"), &rows[..3]);
    bytes.push(0xff);
    assert_says(&load_ply(&bytes).unwrap_err(), &["has length -1"]);
    assert!(begin.elapsed().as_secs() < 5);
}

#[test]
fn faces_are_told_from_the_header() {
    assert!(has_faces(&rich("ascii")));
    let header = rich("binary_big_endian");
    let end = header.windows(10).position(|window| window == b"end_header").unwrap();
    assert!(has_faces(&header[..end + 11]), "the header is enough");
    assert!(!has_faces(&header[..end]), "and needed");
    assert!(!has_faces(b"") && !has_faces(b"solid") && !has_faces(b"ply\n"));
}

// --------------------------------------------------------------------------------------------------------- wrong bytes

/// An OBJ file with everything, and its library.
const RICH_OBJ: &str = "mtllib a.mtl b c.mtl\nv 0 0 0\nv 2 -1 0 1 0 1\nv 0.5 0 0\nv 2 1 0 1\nvt 0 0\nvt 1 0.5 0\n\
    vn 0 0 1\nusemtl m\nf 1/1/1 2/2/1 3/1 -1/-1/-1\ns 1\nl 1 2\nusemtl n\nf 1//1 2 \\\n 3\n";
const RICH_MTL: &str = "newmtl m\nKd 1 0.5 0\nmap_Kd -s 2 2 -clamp on a.png\nd 0.5\nnewmtl n\nKd 1 1 1\nmap_Ks b.png\n";

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self {
            folder: folder(&[
                ("a.obj", b""),
                ("a.mtl", RICH_MTL.as_bytes()),
                ("a.png", &white()),
                ("my tex.png", &white()),
            ]),
        }
    }

    /// Whatever comes of it: no panic, and a mesh that keeps its promises.
    fn survive(&self, name: &str, bytes: &[u8], read: &str) -> bool {
        let path: PathBuf = self.folder.path().join(read);
        let written = self.folder.path().join(name);
        // Some file systems wait for the disk where a file is overwritten.
        std::fs::remove_file(&written).ok();
        std::fs::write(&written, bytes).unwrap();
        match load_mesh_noting(&MeshEntry::new(path), &mut Vec::new()) {
            Err(error) => {
                assert!(!error.to_string().is_empty());
                false
            }
            Ok(mesh) => {
                check(&mesh);
                true
            }
        }
    }
}

#[test]
fn truncation_and_bit_flips_are_survived() {
    let bench = Bench::new();
    let samples: [(&str, Vec<u8>, &str); 5] = [
        ("a.obj", RICH_OBJ.into(), "a.obj"),
        ("a.ply", rich(FORMATS[0]), "a.ply"),
        ("a.ply", rich(FORMATS[1]), "a.ply"),
        ("a.ply", rich(FORMATS[2]), "a.ply"),
        ("a.mtl", RICH_MTL.into(), "a.obj"),
    ];
    for (name, bytes, read) in samples {
        std::fs::write(bench.folder.path().join("a.obj"), RICH_OBJ).unwrap();
        assert!(bench.survive(name, &bytes, read), "{name}");
        for end in 0..bytes.len() {
            let read = bench.survive(name, &bytes[..end], read);
            // All but the last element is needed.
            assert!(!(read && name == "a.ply" && end + 16 < bytes.len()), "{end} of {}", bytes.len());
        }
        for bit in 0..bytes.len() * 8 {
            let mut bytes = bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            bench.survive(name, &bytes, read);
        }
    }
}

#[test]
fn small_files_stay_small_and_quick() {
    let bench = Bench::new();
    let begin = std::time::Instant::now();
    // Every statement its own: material, library, texture, unknown word.
    for (statement, times) in [("usemtl", 30_000), ("mtllib", 10_000), ("x", 30_000), ("g", 30_000)] {
        let mut text = format!("mtllib a.mtl\n{TRIANGLE}f 1 2 3\n");
        (0..times).for_each(|i| text += &format!("{statement} {i}{statement}\n"));
        assert!(bench.survive("a.obj", text.as_bytes(), "a.obj"));
    }
    let mut library = String::new();
    let mut text = "mtllib a.mtl\n".to_owned();
    for i in 0..10_000 {
        library += &format!("newmtl {i}\nmap_Kd {i}.png\n");
        text += &format!("usemtl {i}\n");
    }
    std::fs::write(bench.folder.path().join("a.mtl"), library).unwrap();
    assert!(bench.survive("a.obj", format!("{text}{TRIANGLE}f 1 2 3\n").as_bytes(), "a.obj"));
    let mut notes = Vec::new();
    load_mesh_noting(&MeshEntry::new(bench.folder.path().join("a.obj")), &mut notes).unwrap();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert_says(&notes[0], &["10000 textures", "`0.png` of material `0`"]);
    assert!(begin.elapsed().as_secs() < 20, "{:?}", begin.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let bench = Bench::new();
        bench.survive("a.obj", &bytes, "a.obj");
        bench.survive("a.ply", &bytes, "a.ply");
    }

    #[test]
    fn random_words_do_no_harm(
        words in proptest::collection::vec(prop::sample::select(vec![
            "\nv", "\nvt", "\nvn", "\nf", "\nf", "\nl", "\nusemtl", "\nmtllib", "0", "1", "-1", "2", "0.5", "1e300", "1/1/1",
            "2//1", "-1/-1", "a.mtl", "m", "nan", "#", "\\\n", "/", "3", "1", "2",
        ]), 0..60),
        head in any::<bool>(),
    ) {
        let head = if head { RICH_OBJ } else { "" };
        Bench::new().survive("a.obj", format!("{head}{}", words.join(" ")).as_bytes(), "a.obj");
    }

    #[test]
    fn random_polygons_are_covered(values in proptest::collection::vec((-9..9i32, -9..9i32, -1..2i32), 3..24)) {
        let outline: Vec<DVec3> =
            values.iter().map(|&(x, y, z)| DVec3::new(x.into(), y.into(), f64::from(z) * 0.01)).collect();
        prop_assert_eq!(cut(&outline).len(), outline.len() - 2);
    }

    #[test]
    fn random_star_shaped_polygons_are_cut_properly(radii in proptest::collection::vec(0.1..9.0f64, 3..40)) {
        let step = std::f64::consts::TAU / radii.len() as f64;
        let at = |(i, r): (usize, &f64)| DVec3::new(r * (i as f64 * step).cos(), 0.3, -r * (i as f64 * step).sin());
        assert_proper(&radii.iter().enumerate().map(at).collect::<Vec<_>>());
    }
}
