use std::fs;
use std::io;
use std::path::Path;

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, ReadChannels, ReadLayers, WritableImage};

use stereomist::picture::color::{interleave_u8, interleave_u16};
use stereomist::picture::output::{
    Content, Job, WRITERS, write_all, write_bytes, write_file, write_picture, writer, writer_for,
};
use stereomist::picture::provenance::Provenance;
use stereomist::picture::read::{Samples, read, read_bytes};
use stereomist::picture::{Disparity, Film, Picture, Plane, Side};
use tempfile::tempdir;

use super::gradient;

fn encode(name: &str, picture: &Picture) -> Vec<u8> {
    (writer(name).expect("known").encode)(picture).expect("encodes")
}

#[test]
fn integers_round_trip_exactly() {
    for size in [[1, 1], [1, 7], [33, 1], [61, 47]] {
        let picture = gradient(size);
        let eight = read_bytes(&encode("png", &picture)).expect("reads");
        assert!(eight.samples == Samples::U8(interleave_u8(&picture.color)), "{size:?}");
        let sixteen = read_bytes(&encode("png16", &picture)).expect("reads");
        assert!(sixteen.samples == Samples::U16(interleave_u16(&picture.color)), "{size:?}");
        assert_eq!((eight.picture.size, &eight.picture.alpha), (size, &None));
        // What was read is written again as the same bytes.
        assert_eq!(encode("png", &eight.picture), encode("png", &picture));
        assert_eq!(encode("png16", &sixteen.picture), encode("png16", &picture));
    }
}

#[test]
fn floats_round_trip_to_the_bit() {
    for size in [[1, 1], [17, 40], [64, 3]] {
        let mut picture = gradient(size);
        picture.color[0][0] = 1e30;
        picture.color[1][0] = -0.0;
        let back = read_bytes(&encode("exr", &picture)).expect("reads");
        assert_eq!((back.samples, &back.picture), (Samples::Float, &picture));
        picture.alpha = None;
        assert_eq!(read_bytes(&encode("exr", &picture)).expect("reads").picture, picture);
    }
}

#[test]
fn exr_carries_the_error_bound_as_channel_e() {
    let mut picture = gradient([5, 4]);
    picture.error = Some(Plane::filled(1e-5, 20));
    let bytes = encode("exr", &picture);
    let file = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(io::Cursor::new(&bytes))
        .expect("exr reads it");
    let names: Vec<String> = file.layer_data.channel_data.list.iter().map(|c| c.name.to_string()).collect();
    assert_eq!(names, ["A", "B", "E", "G", "R"]);
    // Files of the reference are read for their colours.
    picture.error = None;
    assert_eq!(read_bytes(&bytes).expect("reads").picture, picture);
}

#[test]
fn exr_carries_the_disparity_by_nukes_names() {
    for side in Side::ALL {
        let mut picture = gradient([5, 4]);
        let x = (0..20).map(|i| if i % 7 == 0 { f32::NAN } else { 0.3 * i as f32 - 2.0 }).collect();
        picture.disparity = Some(Disparity { side, x });
        for alpha in [picture.alpha.take(), None] {
            picture.alpha = alpha;
            let bytes = encode("exr", &picture);
            let name = [b"\0", side.channel().as_bytes(), b"\0"].concat();
            assert!(bytes.windows(name.len()).any(|window| window == name), "{side:?}");
            let back = read_bytes(&bytes).expect("reads").picture;
            assert_eq!((&back.color, &back.alpha, back.size), (&picture.color, &picture.alpha, picture.size));
            let (back, sent) = (back.disparity.expect("kept"), picture.disparity.as_ref().expect("set"));
            assert_eq!(back.side, side);
            assert!(back.x.iter().zip(&sent.x).all(|(a, b)| a.to_bits() == b.to_bits()), "{:?}", back.x);
        }
        // Formats of integers have no place for it, and a plane of another length is refused.
        assert_eq!(read_bytes(&encode("png", &picture)).expect("reads").picture.disparity, None);
        picture.disparity.as_mut().expect("set").x = Plane::new(1);
        assert!((writer("exr").expect("known").encode)(&picture).is_err());
    }
    let names = Side::ALL.map(Side::channel);
    assert_eq!(names, ["disparityL.x", "disparityR.x"]);
    // A file with both says not whose it is.
    let both = ["B", "G", "R", "disparityL.x", "disparityR.x"];
    let channels = both.map(|name| AnyChannel::new(name, FlatSamples::F32(vec![1.0; 20])));
    let mut file = io::Cursor::new(Vec::new());
    let image = Image::from_channels((5, 4), AnyChannels::sort(channels.into_iter().collect()));
    image.write().to_buffered(&mut file).expect("writes");
    assert_eq!(read_bytes(file.get_ref()).expect("reads").picture.disparity, None);
}

#[test]
fn jpeg_is_close_and_not_subsampled() {
    // One-pixel columns of strong colours: subsampled chroma would smear them by half the range.
    let codes: Vec<[u8; 3]> = (0..64 * 16).map(|i| if i % 2 == 0 { [200, 60, 60] } else { [60, 160, 200] }).collect();
    let picture = super::from_codes([64, 16], &codes);
    let Samples::U8(back) = read_bytes(&encode("jpg", &picture)).expect("reads").samples else { panic!("8 bit") };
    let worst = back.iter().zip(codes.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(12), "{worst:?}");
}

#[test]
fn png_says_that_it_is_srgb() {
    let bytes = encode("png", &gradient([4, 4]));
    assert_eq!(&bytes[37..42], b"sRGB\0");
    assert_eq!(bytes.windows(4).filter(|w| w == b"sRGB").count(), 1);
}

#[test]
fn writers_refuse_broken_pictures_without_panic() {
    let mut picture = gradient([4, 4]);
    picture.color[1] = Plane::new(15);
    for w in WRITERS {
        assert!((w.encode)(&picture).is_err(), "{}", w.name);
        assert!((w.encode)(&Picture::new([0, 4])).is_err(), "{}", w.name);
    }
}

#[test]
fn a_film_becomes_a_picture_with_alpha() {
    let mut film = Film::new([2, 1]);
    film.transmittance = [0.25, 1.0].into();
    film.color[0] = [3.0, 4.0].into();
    let picture = Picture::from_film(film);
    assert_eq!(picture.alpha, Some([0.75, 0.0].into()));
    assert_eq!(picture.color[0][..], [3.0, 4.0]);
}

#[test]
fn writers_are_found_by_extension() {
    for (path, name) in [("a.png", "png"), ("b/c.EXR", "exr"), ("d.jpeg", "jpg"), ("e.x.JPG", "jpg"), ("-", "png")] {
        assert_eq!(writer_for(Path::new(path)).expect(path).name, name);
    }
    for path in ["a.tiff", "a", "png"] {
        let error = writer_for(Path::new(path)).expect_err(path);
        assert!(error.exit_code() == 2 && error.to_string().contains(".exr"), "{error}");
    }
    assert!(writer("gif").expect_err("unknown").to_string().contains("png16"));
}

fn entries(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("folder")
        .map(|e| e.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn files_are_replaced_whole_or_not_at_all() {
    let folder = tempdir().expect("a temporary folder");
    let path = folder.path().join("new/deep/a.txt");
    write_bytes(&path, b"first").expect("written, folders made");
    let failed = write_file(&path, |w| {
        w.write_all(&[b'x'; 100_000])?;
        Err(io::Error::other("the writer gave up"))
    });
    assert!(failed.expect_err("fails").to_string().contains("the writer gave up"));
    assert_eq!(fs::read(&path).expect("still there"), b"first");
    assert_eq!(entries(path.parent().expect("parent")), ["a.txt"]);
    write_bytes(&path, b"second").expect("overwritten");
    assert_eq!(fs::read(&path).expect("there"), b"second");
}

#[cfg(unix)]
#[test]
fn permissions_and_links_are_as_for_any_file() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempdir().expect("a temporary folder");
    let (plain, ours, link) = (folder.path().join("plain"), folder.path().join("ours"), folder.path().join("link"));
    fs::write(&plain, "x").expect("written");
    write_bytes(&ours, b"x").expect("written");
    let mode = |p: &Path| fs::metadata(p).expect("there").permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
    symlink(&ours, &link).expect("linked");
    write_bytes(&link, b"through").expect("written");
    assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
    assert_eq!(fs::read(&ours).expect("there"), b"through");
}

#[test]
fn what_cannot_be_written_is_said_in_one_line() {
    let folder = tempdir().expect("a temporary folder");
    let file = folder.path().join("file");
    fs::write(&file, "x").expect("written");
    let mut paths = vec![file.join("below.png"), file.join("a/b.png"), folder.path().to_path_buf(), "".into()];
    if cfg!(target_os = "linux") {
        paths.push("/dev/full".into());
        paths.push("/proc/none/a.png".into());
    }
    let picture = gradient([8, 8]);
    for path in paths {
        for error in [
            write_bytes(&path, b"x").expect_err("cannot be"),
            write_picture(&path, &picture, &WRITERS[0]).expect_err("cannot be"),
        ] {
            let text = error.to_string();
            assert_eq!(error.exit_code(), 2);
            assert!(text.starts_with(&format!("cannot write {}: ", path.display())), "{text}");
            assert!(!text.contains('\n') && !text.contains("os error") && !text.contains(".stereomist-"), "{text}");
        }
    }
    assert_eq!(entries(folder.path()), ["file"]);
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_are_written_straight() {
    use std::os::unix::fs::FileTypeExt;
    write_picture(Path::new("/dev/null"), &gradient([8, 8]), &WRITERS[0]).expect("written");
    assert!(fs::metadata("/dev/null").expect("there").file_type().is_char_device());
}

#[test]
fn several_files_come_all_or_none() {
    let folder = tempdir().expect("a temporary folder");
    let picture = gradient([40, 30]);
    let (mut broken, mut odd) = (picture.clone(), picture.clone());
    broken.color[0] = Plane::new(40 * 30 - 1);
    odd.alpha = Some(Plane::new(0));
    let paths: Vec<_> = (0..4).map(|i| folder.path().join(format!("{i}.png"))).collect();
    let job = |i: usize, p| Job { path: &paths[i], content: Content::Picture(p, &WRITERS[0]) };
    for _ in 0..20 {
        let error =
            write_all(&[job(0, &picture), job(1, &broken), job(2, &odd), job(3, &picture)]).expect_err("one fails");
        assert!(error.to_string().contains("1.png"), "the first in order is reported: {error}");
        assert!(entries(folder.path()).is_empty(), "{:?}", entries(folder.path()));
    }
    let json = Job { path: &paths[3], content: Content::Bytes(b"{}") };
    write_all(&[job(0, &picture), job(1, &picture), job(2, &picture), json]).expect("written");
    assert_eq!(entries(folder.path()), ["0.png", "1.png", "2.png", "3.png"]);
    assert_eq!(read(&paths[0]).expect("reads"), read(&paths[2]).expect("reads"));
    assert_eq!(fs::read(&paths[3]).expect("there"), b"{}");
}

#[test]
fn provenance_keeps_its_order() {
    let mut record = Provenance::new();
    record.device = "CPU, 2 threads".into();
    record.timings_ms = vec![("transform".into(), 1.5), ("order".into(), f64::NAN), ("draw".into(), 2.0)];
    let text = record.to_json();
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(value["versions"]["stereomist"], env!("CARGO_PKG_VERSION"));
    assert!(value["timings_ms"]["order"].is_null() && value["timings_ms"]["draw"] == 2.0);
    let at = |key: &str| text.find(key).unwrap_or_else(|| panic!("no {key} in {text}"));
    assert!(at("versions") < at("settings") && at("transform") < at("order") && at("order") < at("draw"));
    assert!(text.ends_with("}\n"));
}
