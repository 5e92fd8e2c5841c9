//! Files of particles, volumes and meshes given where a scene file is expected: what is in them, the scene made for
//! them, their pictures.

use super::{Place, repository};
use glam::DVec3;
use std::path::Path;
use stereomist::input::scene_file::parse;
use stereomist::input::{SceneInput, load_scene};
use stereomist::scene::{Scene, View};

/// Numbers in [0, 1) that look random.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A cloud as CSV text: `columns` are the heads after x, y and z, `row` gives the numbers.
fn cloud(columns: &str, count: usize, mut row: impl FnMut() -> Vec<f64>) -> String {
    let mut text = format!("x,y,z{columns}\n");
    for _ in 0..count {
        let fields: Vec<String> = row().iter().map(f64::to_string).collect();
        text += &format!("{}\n", fields.join(","));
    }
    text
}

/// The scene that `scene FILE --init` prints, loaded; the file must be named by its absolute path.
fn made_scene(place: &Place, name: &str, more: &[&str]) -> (String, SceneInput) {
    let path = place.path(name);
    let arguments = [&["scene", path.to_str().unwrap(), "--init"], more].concat();
    let text = place.run_with(arguments).ok().stdout;
    let file = parse("made", &text, Path::new(""), &[]).unwrap_or_else(|problems| panic!("{problems:?}\n{text}"));
    let scene = load_scene(file, &()).unwrap();
    (text, scene)
}

/// How far a ball is inside the frustum of a view, at the least over its four sides, over the depth of its centre.
fn inside(view: &View, centre: DVec3, radius: f64) -> f64 {
    let p = view.eye_from_point(centre);
    let depth = -p.z;
    let sides = [
        DVec3::new(-1.0, 0.0, -(view.half_extent.x + view.shear)),
        DVec3::new(1.0, 0.0, -(view.half_extent.x - view.shear)),
        DVec3::new(0.0, -1.0, -view.half_extent.y),
        DVec3::new(0.0, 1.0, -view.half_extent.y),
    ];
    let least = sides.map(|side| (side.normalize().dot(p) - radius) / depth).into_iter().fold(f64::INFINITY, f64::min);
    least.min((depth - radius - view.near) / depth)
}

/// How far every ball of a scene is inside both frusta, at the least.
fn room(scene: &Scene) -> f64 {
    let mut least = f64::INFINITY;
    for view in scene.views() {
        for set in &scene.particles {
            for i in 0..set.len() {
                least = least.min(inside(&view, DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i)));
            }
        }
        for point in scene.meshes.iter().flat_map(|mesh| &mesh.positions) {
            least = least.min(inside(&view, *point, 0.0));
        }
    }
    least
}

#[test]
fn the_contents_of_a_table_are_told() {
    let place = Place::empty();
    place.write("gas.csv", "x,y,z,name,t\n0,-1,5,a,1\n2,1,5,b,2\n1,0,5,c,nan\n1,0,5,d,2\n");
    let text = place.run("scene gas.csv").ok().stdout;
    for part in
        ["gas.csv: csv, 4 particles, extent 2 x 2 x 0", "no numbers (4 values)", "1 values are no finite number"]
    {
        assert!(text.contains(part), "`{part}` is missing in: {text}");
    }
    let lines: Vec<&str> = text.lines().collect();
    let x: Vec<&str> = lines.iter().find(|line| line.trim_start().starts_with("x ")).unwrap().split('|').collect();
    // One at each end and two in the middle, of 48 bars.
    let bars: Vec<char> = x[1].chars().collect();
    assert_eq!((bars.len(), bars[0], bars[24], bars[47]), (48, '▄', '█', '▄'), "{text}");
    assert_eq!(bars.iter().filter(|&&bar| bar != ' ').count(), 3);

    let found = place.run("scene gas.csv --json").json();
    assert_eq!((&found["particles"], &found["format"]), (&4.into(), &"csv".into()));
    assert_eq!(found["extent"], serde_json::json!([2.0, 2.0, 0.0]));
    let t = &found["columns"][4];
    assert_eq!((&t["count"], &t["missing"], &t["min"], &t["max"]), (&3.into(), &1.into(), &1.0.into(), &2.0.into()));
    assert!((t["mean"].as_f64().unwrap() - 5.0 / 3.0).abs() < 1e-15);
    assert!(found["columns"][3]["min"].is_null(), "{found}");
}

#[test]
fn a_made_scene_shows_all_of_the_cloud_and_no_more() {
    let mut next = random(1);
    let clouds = [
        ("deep", cloud("", 500, || vec![next(), next(), 30.0 * next()])),
        ("wide", cloud(",radius", 300, || vec![4e5 * next(), 1e6 + 3e5 * next(), 2e4 * next(), 1e4 + 1e4 * next()])),
        ("one side", cloud(",opacity", 200, || vec![next().powi(8), next().powi(8), next().powi(8), 0.1])),
        ("one ball", "x,y,z,radius\n5,6,7,0.25\n".to_owned()),
        ("two places", "x,y,z\n1,1,1\n1,1,1.001\n".to_owned()),
    ];
    for (name, text) in clouds {
        let place = Place::empty();
        place.write("a.csv", text);
        for more in [&[][..], &["--size", "300x500"], &["--size", "900x200"]] {
            let (text, SceneInput { scene, .. }) = made_scene(&place, "a.csv", more);
            let least = room(&scene);
            assert!((0.0..0.06).contains(&least), "{name}: {least}\n{text}");
            let (camera, stereo) = (&scene.camera, scene.stereo.as_ref().unwrap());
            let distance = (camera.position - camera.look_at).length();
            let convergence = stereo.convergence.unwrap();
            assert!((distance / convergence - 1.0).abs() < 1e-5, "{name}: {distance} {convergence}");
            assert!((convergence / stereo.interocular / 30.0 - 1.0).abs() < 1e-3);
            // The zero-parallax plane goes through the middle of the box around the balls.
            let forward = (camera.look_at - camera.position) / distance;
            let set = &scene.particles[0];
            let points = (0..set.len()).map(|i| (DVec3::new(set.x[i], set.y[i], set.z[i]), set.radius.get(i)));
            let (low, high) = points
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (p, r)| (low.min(p - r), high.max(p + r)));
            let middle = forward.dot(0.5 * (low + high) - camera.position);
            assert!((middle / convergence - 1.0).abs() < 1e-4, "{name}: {middle} {convergence}");
        }
    }
}

#[test]
fn a_made_scene_of_a_mesh_shows_all_of_it() {
    let place = Place::empty();
    let path = repository("scenes/data/watertower.gltf");
    let text = place.run_with(["scene", path.to_str().unwrap(), "--init"]).ok().stdout;
    let scene = load_scene(parse("made", &text, Path::new(""), &[]).unwrap(), &()).unwrap().scene;
    let least = room(&scene);
    assert!((0.0..0.06).contains(&least), "{least}");
    let found = place.run_with(["scene", path.to_str().unwrap(), "--json"]).json();
    assert_eq!(found["triangles"], scene.meshes[0].corners.len());
}

#[test]
fn radius_and_opacity_follow_the_spacing() {
    // In a lattice of spacing 2 the six nearest are 2 away, and the eighth, as the next twelve, sqrt(8).
    let place = Place::empty();
    let lattice = (0..4096).map(|i| [i % 16, i / 16 % 16, i / 256].map(|c| 2.0 * f64::from(c)));
    let text: String = lattice.map(|[x, y, z]| format!("{x},{y},{z}\n")).collect();
    place.write("lattice.csv", format!("x,y,z\n{text}"));
    let (_, SceneInput { scene, .. }) = made_scene(&place, "lattice.csv", &[]);
    let radius = scene.particles[0].radius.get(0);
    let exact = 4.0 / 3.0 * 8f64.sqrt();
    // At the faces of the lattice the eighth is farther; rounded up to two digits.
    assert!(radius > exact && radius < 1.12 * exact, "{radius}");

    // About a fifth of the light comes through.
    place.run("render lattice.csv --format left --image exr --size 256x192 -o .").ok();
    let picture = stereomist::picture::read::read(&place.path("lattice.left.exr")).unwrap().picture;
    let transmittance: Vec<f32> = picture.alpha.unwrap().iter().map(|alpha| 1.0 - alpha).collect();
    let inner: Vec<f32> = (60..130).flat_map(|y| transmittance[256 * y + 80..256 * y + 176].to_vec()).collect();
    let mean = inner.iter().sum::<f32>() / inner.len() as f32;
    assert!((0.05..0.4).contains(&mean), "{mean}");
}

#[test]
fn a_picture_without_a_scene_file_is_that_of_the_made_scene() {
    let place = Place::empty();
    let mut next = random(7);
    place.write("data/gas.csv", cloud(",id,heat", 400, || vec![next(), next(), next(), 3.0, 100.0 * next()]));
    let run = place.run("render data/gas.csv -o a").ok();
    assert!(run.stdout.contains("scene made for data/gas.csv"), "{}", run.stdout);
    let text = place.run("scene data/gas.csv --init").ok().stdout;
    assert!(text.contains("color = { from = \"heat\", map = \"viridis\""), "{text}");
    place.write("gas.toml", text);
    place.run("render gas.toml -o b").ok();
    for format in ["left", "right", "anaglyph", "sbs"] {
        assert_eq!(place.bytes(&format!("a/gas.{format}.png")), place.bytes(&format!("b/gas.{format}.png")));
    }
    // A setting changes the scene that is made.
    place.run("render data/gas.csv -o c --set particles.0.opacity=0.9 --size 64x48").ok();
    assert_eq!(place.picture("c/gas.left.png").size, [64, 48]);
}

#[test]
fn what_no_scene_can_be_made_of_is_refused() {
    let place = Place::new();
    place.write("empty.csv", "x,y,z\n");
    place.write("flat.csv", "u,v\n1,2\n");
    place.write("hole.csv", "x,y,z\n1,2,nan\n");
    place.write("far.csv", "x,y,z\n1e300,0,0\n-1e300,0,0\n");
    place.write("bad.csv", "x,y,z,radius\n1,2,3,0\n");
    place.run("render empty.csv").refused(2, &["empty.csv", "no particles"]);
    place.run("render flat.csv").refused(2, &["flat.csv", "`x`, `y` and `z`", "`u`, `v`", "particles.columns"]);
    place.run("render hole.csv").refused(2, &["hole.csv", "line 2", "`z`", "finite"]);
    place.run("render far.csv").refused(2, &["far.csv", "too large"]);
    place.run("render bad.csv").refused(2, &["bad.csv", "particle 0", "radius", "greater than 0"]);
    place.write("scan.las", b"LASF\0\0\0\0");
    place.run("render scan.las").refused(2, &["scan.las", "unknown format", ".toml", ".vtp", ".vdb", ".obj"]);
    place.run("scene scene.toml --init").refused(2, &["--init", "scene.toml"]);
    place.run("scene flat.csv --init --json").code.map(|code| assert_eq!(code, 2)).unwrap();
    place.run("render flat.csv --downsample 2").refused(2, &["--downsample", "flat.csv"]);
    place.run("render scene.toml --grid density").refused(2, &["--grid", "scene.toml", "[[particles]]"]);
    // The contents can be told of what cannot be rendered.
    for name in ["empty.csv", "flat.csv", "hole.csv", "far.csv"] {
        place.run(&format!("scene {name}")).ok();
    }
    assert!(!place.path("out").exists());
}

#[test]
fn columns_as_other_programs_write_them() {
    let place = Place::empty();
    let mut next = random(3);
    let mut rows =
        || cloud("", 50, || vec![next(), next(), next(), 255.0 * next(), 255.0 * next(), 255.0 * next(), 1.0]);
    // ParaView's export; colours to 255; opacity 1.
    let paraview = rows().replacen("x,y,z\n", "\"Points:0\",\"Points:1\",\"Points:2\",r,g,b,opacity\n", 1);
    let capitals = rows().replacen("x,y,z\n", "X,Y,Z,vx,vy,vz,m\n", 1);
    for (name, text) in [("paraview.csv", &paraview), ("capitals.csv", &capitals)] {
        place.write(name, text);
        let made = place.run(&format!("scene {name} --init")).ok().stdout;
        assert!(made.contains("# relative to this file"), "{made}");
        place.run(&format!("render {name} --size 64x48 -o .")).ok();
    }
    let made = place.run("scene paraview.csv --init").ok().stdout;
    for part in ["x = \"Points:0\"", "z = \"Points:2\"", "r = { from = \"r\", scale = 0.0039", "max = 0.999"] {
        assert!(made.contains(part), "`{part}` is missing in: {made}");
    }
    // Velocities are no colours, and a scalar says more than a part of a vector.
    let made = place.run("scene capitals.csv --init").ok().stdout;
    assert!(made.contains("color = { from = \"vx\"") || made.contains("color = { from = \"m\""), "{made}");
    place.write("velocity.csv", "x,y,z,r,g,b\n0,0,0,-5,3,1\n1,0,0,2,-7,2\n0,1,0,2,-700,3\n");
    let made = place.run("scene velocity.csv --init").ok().stdout;
    assert!(made.contains("color = { from = \"r\", map"), "{made}");
    place.run("render velocity.csv --size 64x48 -o .").ok();

    // One particle far away changes what is seen of the others, but not how large they are.
    let mut next = random(5);
    let text = cloud("", 400, || vec![next(), next(), next()]);
    place.write("near.csv", &text);
    place.write("far.csv", text + "1e5,0,0\n");
    let radius = |name: &str| made_scene(&place, name, &[]).1.scene.particles[0].radius.get(0);
    assert!((radius("far.csv") / radius("near.csv") - 1.0).abs() < 0.1);
}

#[test]
fn tables_that_are_no_csv_are_told_what_is_wrong() {
    let place = Place::empty();
    place.write("semicolons.csv", "x;y;z\n1;2;3\n");
    place.write("tabs.csv", "x\ty\tz\n1\t2\t3\n");
    place.write("savetxt.csv", "# x,y,z\n1,2,3\n4,5,6\n");
    place.write("solid.stl", "solid a\nfacet normal 0 0 1\n");
    place.write("points.txt", "x,y,z\n1,2,3\n");
    place.run("render semicolons.csv").refused(2, &["line 1", "semicolons", "commas"]);
    place.run("render tabs.csv").refused(2, &["line 1", "tabs", "commas"]);
    place.run("scene savetxt.csv").refused(2, &["line 2", "numbers where the names", "#"]);
    place.run("render solid.stl").refused(2, &["solid.stl", "unknown format", ".csv", ".obj"]);
    place.run("scene points.txt").refused(2, &["points.txt", "unknown format", ".csv"]);
    place.write("a.csv", "x,y,z\n1,2,3\n");
    place.run("scene a.csv --init --size 0x5").refused(2, &["--size 0x5"]);
    place.run("render a.csv --size 99999x5").refused(2, &["--size 99999x5"]);
    place.run("scene a.csv --init --set camera.fov_y_deg=20").refused(2, &["--init", "--set"]);
    #[cfg(unix)]
    {
        let made = std::process::Command::new("mkfifo").arg(place.path("pipe.csv")).status();
        assert!(made.is_ok_and(|status| status.success()));
        place.run("render pipe.csv").refused(2, &["pipe.csv", "regular file", "scene file"]);
    }
}
