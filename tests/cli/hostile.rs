//! Files of random bytes and damaged files, through the program: it always ends by itself, with exit code 2 (or 0 where
//! the damage does no harm) and a message.

use super::{Place, SCENE, repository};
use crate::harness::Random;

/// Runs of each kind.
const RUNS: usize = 12;

fn bytes(random: &mut Random, most: f64) -> Vec<u8> {
    (0..random.uniform(0.0, most) as usize).map(|_| random.uniform(0.0, 256.0) as u8).collect()
}

fn scene_with(entry: &str) -> String {
    format!("{}{entry}\n", SCENE.split("[particles.box]").next().unwrap())
}

#[test]
fn random_bytes() {
    let place = Place::new();
    place.run("render scene.toml -o . --format left").ok();
    place.write("particles-csv.toml", scene_with("file = \"x.csv\""));
    place.write("particles-ply.toml", scene_with("file = \"x.ply\""));
    place.write("mesh-gltf.toml", format!("{SCENE}\n[[mesh]]\nfile = \"x.gltf\""));
    place.write("mesh-glb.toml", format!("{SCENE}\n[[mesh]]\nfile = \"x.glb\""));
    let mut random = Random::new(2);
    // Each kind of file, the beginning that gets it past the first look, and who reads it.
    for (file, starts, words) in [
        ("x.toml", &["", "[camera]\n", "[[particles]]\nradius = "][..], "render x.toml"),
        ("x.csv", &["", "x,y,z\n", "x,y,z,r\n1,2,3,"], "render particles-csv.toml"),
        (
            "x.ply",
            &["", "ply\n", "ply\nformat binary_big_endian 1.0\nelement vertex 900\nproperty double x\nend_header\n"],
            "scene particles-ply.toml",
        ),
        ("x.gltf", &["", "{\"asset\": {\"version\": \"2.0\"}, ", "glTF\x02\0\0\0"], "render mesh-gltf.toml"),
        ("x.glb", &["", "glTF\x02\0\0\0\u{40}\0\0\0"], "bench mesh-glb.toml"),
        ("x.png", &["", "\u{fffd}PNG"], "compose x.png scene.left.png -o y.png"),
        ("x.exr", &["", "v/1\x01", "v/1\x01\x02\0\0\0channels\0chlist\0"], "compare scene.left.png x.exr"),
    ] {
        let mut before = place.files();
        before.push(file.to_owned());
        before.sort();
        for run in 0..RUNS {
            let mut content = starts[run % starts.len()].as_bytes().to_vec();
            content.extend(bytes(&mut random, 600.0));
            place.write(file, &content);
            let result = place.run(words);
            assert_eq!(result.code, Some(2), "{words}: {content:?}: {result:?}");
            result.refused(2, &[]);
        }
        assert_eq!(place.files(), before);
        std::fs::remove_file(place.path(file)).unwrap();
    }
}

/// Whole files with some bytes changed or the end cut off.
#[test]
fn damaged_files() {
    let place = Place::empty();
    place.write("s.toml", SCENE);
    place.run("render s.toml -o . --format left,right").ok();
    place.run("compose s.left.png s.right.png --format left -o s.jpg").ok();
    place.run("compose s.left.png s.right.png --format left -o s.exr").ok();
    for name in ["watertower.gltf", "watertower.bin", "ground.png", "tank.png"] {
        place.write(name, std::fs::read(repository("scenes/data").join(name)).unwrap());
    }
    place.write("tower.toml", format!("{SCENE}\n[[mesh]]\nfile = \"watertower.gltf\""));
    place.write("cloud.csv", "x,y,z,radius,opacity\n0,0,0,0.5,0.5\n0.1,0.2,0.3,0.4,0.5\n-0.5,0.5,0,0.2,0.1\n");
    place.write("csv.toml", scene_with("file = \"cloud.csv\""));
    let mut random = Random::new(3);
    for (file, words) in [
        ("s.toml", "render s.toml --size 16x12"),
        ("cloud.csv", "render csv.toml --size 16x12"),
        ("watertower.gltf", "render tower.toml --size 16x12"),
        ("watertower.bin", "render tower.toml --size 16x12"),
        ("tank.png", "render tower.toml --size 16x12"),
        ("s.left.png", "compose s.left.png s.right.png -o y.png"),
        ("s.jpg", "compare s.jpg s.right.png"),
        ("s.exr", "compare s.exr s.exr"),
    ] {
        let whole = place.bytes(file);
        let mut refusals = 0;
        for run in 0..RUNS {
            let mut content = whole.clone();
            if run % 2 == 0 {
                content.truncate(random.uniform(0.0, whole.len() as f64) as usize);
            } else {
                for _ in 0..=run {
                    let at = random.uniform(0.0, content.len() as f64) as usize;
                    content[at] = random.uniform(0.0, 256.0) as u8;
                }
            }
            place.write(file, &content);
            let result = place.run(words);
            match result.code {
                Some(0) => {}
                Some(2) => {
                    result.refused(2, &[]);
                    refusals += 1;
                }
                _ => panic!("{words}: {result:?}; {file} is {content:?}"),
            }
        }
        assert!(refusals > 0, "no damage to {file} was noticed");
        place.write(file, whole);
    }
    let leftovers: Vec<String> = place.files().into_iter().filter(|name| name.contains(".tmp")).collect();
    assert_eq!(leftovers, Vec::<String>::new());
}
