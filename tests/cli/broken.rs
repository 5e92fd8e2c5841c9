//! Wrong use and broken input: exit 2 (3 for a missing device), one message, nothing half-written.

use super::{Place, Run, SCENE, repository};
use std::fs;

/// The words are refused with exit code 2, and no file appears, changes or vanishes.
fn refused(place: &Place, words: &str, says: &[&str]) -> Run {
    let before = place.files();
    let run = place.run(words).refused(2, says);
    assert_eq!(place.files(), before, "{words}");
    run
}

/// [`SCENE`] with the particles of a file.
fn scene_with_file(file: &str) -> String {
    format!("{}file = \"{file}\"\n", SCENE.split("[particles.box]").next().unwrap())
}

fn scene_with_mesh(file: &str) -> String {
    format!("{SCENE}\n[[mesh]]\nfile = \"{file}\"\n")
}

#[test]
fn unknown_commands_and_options() {
    let place = Place::new();
    for command in ["chart", "comfort", "experiment", "dubois", "rendr", "--nonsense"] {
        refused(&place, command, &[command]);
    }
    for words in [
        "render",
        "render scene.toml other.toml",
        "render scene.toml --nonsense",
        "render scene.toml --size",
        "compose scene.toml -o x.png",
        "compose a.png b.png",
        "compare scene.toml",
        "compare a b c d e",
        "bench",
        "devices now",
        "render scene.toml --error-map",
    ] {
        refused(&place, words, &[]);
    }
    refused(&place, "compare a.png b.png c.png", &["two"]);
}

#[test]
fn option_values() {
    let place = Place::new();
    for size in
        ["0x5", "5x0", "40000x40000", "32769x1", "32768x32768", "1024", "x", "3x", "-3x4", "3x4x5", "1e3x4", "٣x4"]
    {
        refused(&place, &format!("render scene.toml --size={size}"), &["--size", size]);
    }
    // Width and height are fine, samples make it too many.
    refused(&place, "render scene.toml --size 20000x10000 --set camera.samples=4", &["--size"]);
    for tolerance in ["-1", "nan", "inf", "1/0", "a", "/", "1/", ""] {
        refused(&place, &format!("render scene.toml --tolerance={tolerance}"), &["--tolerance"]);
    }
    refused(&place, "render scene.toml --tolerance -1", &["--tolerance -1", "1/255"]);
    for threads in ["0", "-1", "2.5", "many", "1000000"] {
        refused(&place, &format!("render scene.toml --threads={threads}"), &["--threads"]);
    }
    refused(&place, "render scene.toml --method ViewPlan", &["--method ViewPlan", "viewplane, viewpoint, perspective"]);
    refused(&place, "render scene.toml --simd mmx", &["--simd mmx", "avx2"]);
    refused(&place, "render scene.toml --device abacus", &["--device abacus", "gpu:NAME"]);
    for command in ["render", "bench", "scene"] {
        refused(&place, &format!("{command} scene.toml --gpu-path laser"), &["--gpu-path laser", "raster-f16"]);
    }
    refused(&place, "render scene.toml --format tv", &["`tv`", "anaglyph"]);
    refused(&place, "render scene.toml --format left,", &["there is no stereo format", "anaglyph"]);
    refused(&place, "render scene.toml --image tiff", &["`tiff`", "png16"]);
    refused(&place, "compare a.png b.png --max -1", &["--max"]);
    refused(&place, "compare a.png b.png --max nan", &["--max"]);
    refused(&place, "bench scene.toml --repeat=-1", &["--repeat"]);
    for command in ["bench", "scene"] {
        refused(&place, &format!("{command} scene.toml --method march"), &["--method march", "viewplane"]);
        refused(&place, &format!("{command} scene.toml --size 0x0"), &["--size 0x0"]);
    }
}

/// The program here, on a machine without any driver for a GPU.
fn without_drivers(place: &Place, words: &str) -> Run {
    let mut command = place.command(words.split_whitespace());
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "__EGL_VENDOR_LIBRARY_FILENAMES"] {
        command.env(name, "/nonexistent");
    }
    Run::of(command.output().unwrap())
}

#[test]
fn a_missing_gpu_is_exit_3() {
    let place = Place::new();
    for command in ["render", "bench", "scene"] {
        place.run(&format!("{command} scene.toml --device gpu:nonsense")).refused(3, &["no GPU", "--device cpu"]);
        for device in ["gpu", "gpu:llvmpipe", "gpu:", "GPU"] {
            let run = without_drivers(&place, &format!("{command} scene.toml --device {device}"));
            run.refused(3, &["no GPU", "libvulkan1", "Fedora", "--device cpu"]);
        }
    }
    assert_eq!(place.files(), ["scene.toml"]);
    // Nothing is promised by auto: no word of it.
    for device in ["auto", "cpu", "CPU"] {
        let run = without_drivers(&place, &format!("render scene.toml --device {device}")).ok();
        assert_eq!(run.stderr, "", "{device}");
    }
    assert!(place.json("out/scene.json")["device"].as_str().unwrap().starts_with("CPU"));
    let report = without_drivers(&place, "devices --json").json();
    assert_eq!(report["gpus"].as_array().unwrap().len(), 0, "{report}");
    assert!(report["why_no_gpu"].as_str().unwrap().contains("libvulkan1"), "{report}");
}

#[test]
fn scene_files() {
    let place = Place::empty();
    refused(&place, "render none.toml", &["none.toml"]);
    refused(&place, "render .", &["."]);
    refused(&place, "render none/none.toml", &["none/none.toml"]);
    for (text, says) in [
        ("", &["camera"][..]),
        ("[camera", &["s.toml:1:"]),
        ("[camera]\nposition = [0, 0, 4\nlook_at = 3", &["s.toml:"]),
        ("\u{0}", &["s.toml:1:1"]),
        ("[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 4]\n", &["s.toml:3:"]),
    ] {
        place.write("s.toml", text);
        for command in ["render", "bench", "scene"] {
            refused(&place, &format!("{command} s.toml"), says);
        }
    }
    place.write("s.toml", b"[camera]\xff\xfe");
    refused(&place, "render s.toml", &["s.toml", "UTF-8"]);
}

/// One `error:`, and below it every problem with line, column and the offending text.
#[test]
fn all_problems_of_a_scene_at_once() {
    let place = Place::empty();
    let scene = SCENE
        .replace("size = [48, 36]", "sise = [48, 36]")
        .replace("interocular = 0.3", "interocular = \"wide\"")
        .replace("opacity = 0.6", "opacity = 1.5")
        .replace("count = 24", "count = -3");
    place.write("s.toml", scene);
    let run = refused(&place, "render s.toml --set camera.near=0", &["sise", "\"wide\"", "1.5", "-3", "camera.near=0"]);
    for start in ["s.toml:5:1: ", "s.toml:8:15: ", "s.toml:16:11: ", "s.toml:21:9: ", "--set:1:13: "] {
        assert!(run.stderr.contains(start), "{start} is missing: {}", run.stderr);
    }
    assert!(run.stderr.contains('^'), "{}", run.stderr);
}

#[test]
fn files_that_a_scene_names() {
    let place = Place::empty();
    place.write("s.toml", scene_with_file("none.ply"));
    refused(&place, "render s.toml", &["none.ply"]);
    place.write("s.toml", scene_with_mesh("none.gltf"));
    refused(&place, "render s.toml", &["none.gltf"]);
    place.write("s.toml", SCENE.replace("radius = 0.5", "radius = 0.5\nkernel = { table = \"none.csv\" }"));
    refused(&place, "render s.toml", &["none.csv", "s.toml:"]);
    place.write("profile.csv", "q,density\n0,1\n0.5,x\n");
    place.write("s.toml", SCENE.replace("radius = 0.5", "radius = 0.5\nkernel = { table = \"profile.csv\" }"));
    refused(&place, "render s.toml", &["profile.csv", "s.toml:"]);
}

#[test]
fn particle_files() {
    let place = Place::empty();
    place.write("s.toml", scene_with_file("p.csv"));
    for (text, says) in [
        ("", &["p.csv"][..]),
        ("a,b,c\n1,2,3\n", &["p.csv", "`x`"]),
        ("x,y,z\n1,2\n", &["p.csv", "line 2"]),
        ("x,y,z\n1,2,three\n", &["p.csv", "line 2", "three"]),
        ("x,y,z\n1,2,nan\n", &["p.csv"]),
        ("x,y,z,radius\n1,2,3,-1\n", &["p.csv", "radius"]),
        ("x,y,z,opacity\n1,2,3,1\n", &["p.csv", "opacity"]),
        ("x,y,z\n\"1,2,3\n", &["p.csv"]),
    ] {
        place.write("p.csv", text);
        for command in ["render", "bench", "scene"] {
            refused(&place, &format!("{command} s.toml"), says);
        }
    }
    place.write("p.csv", b"x,y,z\n\xff\xff,1,2\n");
    refused(&place, "render s.toml", &["p.csv"]);

    place.write("s.toml", scene_with_file("p.ply"));
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let mut whole = header.as_bytes().to_vec();
    whole.extend((0..9).flat_map(|i| (i as f32 * 0.1).to_le_bytes()));
    place.write("p.ply", &whole);
    place.run("scene s.toml").ok();
    for length in [0, 3, 20, header.len() - 5, header.len(), header.len() + 1, whole.len() - 1] {
        place.write("p.ply", &whole[..length]);
        refused(&place, "render s.toml", &["p.ply"]);
    }
    for (from, to) in [
        ("vertex 3", "vertex 4000000000000"),
        ("vertex 3", "vertex -1"),
        ("vertex 3", "vortex 3"),
        ("float z", "float w"),
        ("float y", "quaternion y"),
        ("1.0", "7.0"),
    ] {
        let mut bytes = header.replace(from, to).into_bytes();
        bytes.extend(&whole[header.len()..]);
        place.write("p.ply", bytes);
        refused(&place, "render s.toml", &["p.ply"]);
    }
    place.write("s.toml", scene_with_file("p.xyz"));
    place.write("p.xyz", "1 2 3\n");
    refused(&place, "render s.toml", &["p.xyz", "unknown particle format", ".csv", ".ply"]);
}

#[test]
fn mesh_files() {
    let place = Place::empty();
    for name in ["watertower.gltf", "watertower.bin", "ground.png", "tank.png"] {
        place.write(name, fs::read(repository("scenes/data").join(name)).unwrap());
    }
    place.write("s.toml", scene_with_mesh("watertower.gltf"));
    place.run("scene s.toml").ok();
    for name in ["watertower.bin", "ground.png", "tank.png"] {
        let whole = place.bytes(name);
        fs::remove_file(place.path(name)).unwrap();
        refused(&place, "render s.toml", &["watertower.gltf", name]);
        for broken in [&b""[..], b"garbage", &whole[..whole.len() / 2]] {
            place.write(name, broken);
            refused(&place, "render s.toml", &["watertower.gltf"]);
        }
        place.write(name, whole);
    }
    let whole = place.bytes("watertower.gltf");
    for broken in [&b""[..], b"{}", b"[1, 2", b"glTF\x02\0\0\0", &whole[..whole.len() / 2]] {
        place.write("watertower.gltf", broken);
        refused(&place, "render s.toml", &["watertower.gltf"]);
    }
    place.write("m.stl", "v 0 0 0\n");
    place.write("s.toml", scene_with_mesh("m.stl"));
    refused(&place, "render s.toml", &["m.stl", ".gltf"]);
}

#[test]
fn pictures() {
    let place = Place::new();
    place.run("render scene.toml -o . --format left,sbs").ok();
    place.write("garbage.png", "garbage");
    let whole = place.bytes("scene.left.png");
    place.write("cut.png", &whole[..whole.len() / 2]);
    place.write("empty.png", "");
    refused(&place, "compose scene.left.png scene.sbs.png -o x.png", &["48 x 36", "96 x 36"]);
    refused(&place, "compare scene.left.png scene.sbs.png", &["scene.sbs.png"]);
    refused(&place, "compare scene.left.png scene.sbs.png --heatmap h.png --json", &["48 x 36", "96 x 36"]);
    for name in ["garbage.png", "cut.png", "empty.png", "none.png", ".", "scene.toml"] {
        refused(&place, &format!("compose scene.left.png {name} -o x.png"), &[name]);
        refused(&place, &format!("compose {name} scene.left.png -o x.png --json"), &[name]);
        refused(&place, &format!("compare scene.left.png {name} --heatmap h.png"), &[name]);
    }
    refused(&place, "compose scene.left.png scene.left.png -o x.tiff", &["x.tiff", ".png"]);
    refused(&place, "compose scene.left.png scene.left.png -o x", &["extension"]);
    refused(&place, "compose scene.left.png scene.left.png -o x.png --matrix none", &["none", "dubois-2001"]);
    refused(&place, "compose scene.left.png scene.left.png -o x.png --space none", &["none", "encoded"]);
    refused(&place, "compose scene.left.png scene.left.png -o x.png --format mono", &["mono", "sbs"]);
    refused(&place, "compare scene.left.png scene.left.png --heatmap x.tiff", &["x.tiff"]);
}

#[test]
fn outputs_that_cannot_be() {
    let place = Place::new();
    place.run("render scene.toml -o . --format left").ok();
    place.write("file", "mine");
    refused(&place, "render scene.toml -o file", &["cannot write file", "folder"]);
    refused(&place, "render scene.toml -o file/below", &["cannot write file/below"]);
    refused(&place, "compose scene.left.png scene.left.png -o file/x.png", &["cannot write file/x.png"]);
    refused(&place, "compare scene.left.png scene.left.png --heatmap file/x.png", &["cannot write file/x.png"]);
    assert_eq!(place.bytes("file"), b"mine");

    // A folder stands where a picture belongs: none of the others is written, and an old one stays as it was.
    fs::create_dir_all(place.path("out/scene.sbs.png")).unwrap();
    place.write("out/scene.left.png", "old");
    refused(&place, "render scene.toml", &["scene.sbs.png", "folder"]);
    assert_eq!(place.bytes("out/scene.left.png"), b"old");
    fs::create_dir_all(place.path("x.png")).unwrap();
    refused(&place, "compose scene.left.png scene.left.png -o x.png", &["cannot write x.png", "folder"]);
    // The record beside the pictures would replace the scene.
    place.write("s.json", SCENE);
    refused(&place, "render s.json -o .", &["s.json", "scene file"]);
    assert_eq!(place.bytes("s.json"), SCENE.as_bytes());
    place.run("render s.json -o elsewhere").ok();
    // More than JPEG can hold is known only once it is encoded.
    refused(&place, "render scene.toml -o j --size 32768x2 --image jpg", &["--image jpg"]);
}

#[cfg(target_os = "linux")]
mod full {
    use super::super::{Place, Run, SCENE};
    use super::refused;
    use crate::harness::skipped;
    use std::path::{Path, PathBuf};
    use std::process::{Command, Stdio};

    #[test]
    fn a_full_device() {
        let place = Place::new();
        place.run("render scene.toml -o . --format left").ok();
        refused(&place, "compose scene.left.png scene.left.png -o /dev/full", &["cannot write /dev/full", "No space"]);
        refused(&place, "compose scene.left.png scene.left.png -o /dev/full --image exr --json", &["No space"]);
        // Standard output too.
        for words in ["devices", "scene scene.toml --json", "compare scene.left.png scene.left.png"] {
            let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
            let child = place.command(words.split_whitespace()).stdout(full).stderr(Stdio::piped()).spawn().unwrap();
            Run::of(child.wait_with_output().unwrap()).refused(2, &["stdout", "No space"]);
        }
    }

    /// Files may not grow beyond some size: what a full disk does to a picture, on any machine.
    #[test]
    fn a_limit_on_the_size_of_files() {
        let place = Place::empty();
        place.write("scene.toml", SCENE.replace("[48, 36]", "[200, 150]"));
        place.write("out/scene.left.exr", "old");
        let before = place.files();
        // The signal that comes with the error is ignored, as it is by programs that are to live on.
        let script = "trap '' XFSZ; ulimit -f 64; exec \"$0\" render scene.toml --image exr";
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(script).arg(super::super::PROGRAM).current_dir(place.path("")).stdin(Stdio::null());
        Run::of(shell.output().unwrap()).refused(2, &["cannot write", "scene.left.exr"]);
        assert_eq!(place.files(), before);
        assert_eq!(place.bytes("out/scene.left.exr"), b"old");
    }

    /// A file system of 64 KB, unmounted with the value.
    struct Small(PathBuf);

    impl Small {
        fn mount(at: &Path) -> Option<Self> {
            std::fs::create_dir_all(at).unwrap();
            let mut mount = Command::new("mount");
            mount.args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"]).arg(at).stderr(Stdio::null());
            mount.status().is_ok_and(|status| status.success()).then(|| Self(at.to_path_buf()))
        }
    }

    impl Drop for Small {
        fn drop(&mut self) {
            let _ = Command::new("umount").arg(&self.0).status();
        }
    }

    #[test]
    fn a_full_disk() {
        let place = Place::empty();
        place.write("scene.toml", SCENE.replace("[48, 36]", "[200, 150]"));
        let Some(disk) = Small::mount(&place.path("disk")) else {
            return skipped("writing to a full disk: no file system can be mounted here (that takes root)");
        };
        refused(&place, "render scene.toml --image exr -o disk", &["cannot write", "No space"]);
        refused(&place, "render scene.toml --image exr -o disk/deeper", &["cannot write", "No space"]);
        place.run("render scene.toml -o . --format left --image exr").ok();
        refused(
            &place,
            "compose scene.left.exr scene.left.exr -o disk/x.exr",
            &["cannot write disk/x.exr", "No space"],
        );
        // What is small enough still fits, so that nothing else was the cause.
        place.run("render scene.toml --size 8x6 -o disk").ok();
        drop(disk);
    }
}
