//! Damaged files: every reader survives thousands of mutations of valid ones, without a panic, a hang or a greedy
//! allocation.
//!
//! The mutations are the same every time. `STEREOMIST_MUTATIONS=10000000` asks for that many inputs per format instead
//! of a few thousand. Each format is read in a process of its own, this test binary once more, so that an overflow of
//! the stack or an abort is an error like any other and all memory of the process is the reader's.
//!
//! Valid files are those of `tests/data/` and `scenes/` with the format's extension, the seeds in `tests/fuzz/corpus/`,
//! and for particles the sample in `tests/files.rs`: a reader that is new is tested without a line here.

use crate::allocation::peak_of;
use crate::files;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use stereomist::input::mesh::MESH_READERS;
use stereomist::input::{Columns, Content, READERS, Selection, VolumeOptions, read_profile, scene_file};

/// Inputs per format unless the environment says otherwise.
const INPUTS: u64 = 3000;
/// Longest that one input may take.
const LONGEST: Duration = Duration::from_secs(10);
/// Bytes that may be in use whatever the size of the input, and for each of its bytes.
const ALLOWANCE: u64 = 64 << 20;
const GROWTH: u64 = 4;
/// Valid files that are longer are not used: nearly all of their bytes would be numbers.
const LONGEST_SAMPLE: u64 = 32 << 10;
/// Longest input, and longest of the few that repeat a piece again and again.
const LONGEST_INPUT: usize = 64 << 10;
const LONGEST_REPETITION: usize = 1 << 20;
/// How many inputs per format.
const COUNT: &str = "STEREOMIST_MUTATIONS";
/// What the process of a format has to do: name, first and last input, and the file that it writes its progress to.
const TASK: &str = "STEREOMIST_MUTATIONS_TASK";

// ---- formats ----

/// Something that reads bytes; the generator decides what is asked for besides.
type ReadBytes = Box<dyn Fn(&[u8], &mut Random)>;

struct Format {
    name: String,
    /// Valid files.
    samples: Vec<Vec<u8>>,
    read: ReadBytes,
}

/// Every format, and the folder in which files are written for the readers that take a path.
fn formats(folder: &Path) -> Vec<Format> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (data, corpus) = (root.join("tests/data"), root.join("tests/fuzz/corpus"));
    let mut formats = Vec::new();
    for reader in READERS {
        let mut samples = vec![files::sample(reader.name)];
        found(&data, reader.extensions, &mut samples, None);
        found(&corpus.join(reader.name), reader.extensions, &mut samples, None);
        let read = move |bytes: &[u8], random: &mut Random| {
            let mut options = VolumeOptions::default();
            if matches!(reader.content, Content::Volume(_)) {
                options.downsample = 1 + random.below(3) as u32;
            }
            let names = ["x", "y", "z", "radius", "opacity", "r", "g", "b", "red", "green", "blue"].map(str::to_owned);
            let selection = match random.below(3) {
                0 => Selection::All,
                1 => Selection::named(names),
                _ => Selection::Survey(names.to_vec()),
            };
            let sized = reader.read(&mut &*bytes, Some(bytes.len() as u64), &selection, &options);
            let sized = sized.map_err(|error| error.to_string());
            let streamed = reader.read(&mut BufReader::with_capacity(61, bytes), None, &selection, &options);
            match (sized, streamed) {
                (Ok(sized), Ok(streamed)) => assert!(same(&sized, &streamed), "{sized:?}\n{streamed:?}"),
                (Err(_), Err(_)) => {}
                // What stands behind the particles is not read, but its size is checked if it can be.
                (Err(message), Ok(_)) => assert!(message.contains("truncated"), "only with the size: {message}"),
                (Ok(_), Err(error)) => panic!("only without the size: {error}"),
            }
        };
        formats.push(Format { name: reader.name.to_owned(), samples, read: Box::new(read) });
    }
    for reader in MESH_READERS {
        let mut samples = Vec::new();
        // Buffers and pictures that the files name lie beside them here too.
        found(&data, reader.extensions, &mut samples, Some(folder));
        found(&corpus.join(reader.name.to_lowercase()), reader.extensions, &mut samples, None);
        let path = folder.join(format!("input.{}", reader.extensions[0]));
        let read = move |bytes: &[u8], _: &mut Random| {
            std::fs::write(&path, bytes).unwrap();
            if let Ok(mesh) = (reader.read)(&path, [0.5; 3], &mut Vec::new()) {
                assert!(mesh.corners.iter().flatten().all(|&corner| (corner as usize) < mesh.positions.len()));
                assert!(mesh.triangle_materials.iter().all(|&index| (index as usize) < mesh.materials.len()));
                assert!(mesh.materials.iter().flat_map(|m| m.texture).all(|i| (i as usize) < mesh.textures.len()));
            }
        };
        formats.push(Format { name: reader.name.to_owned(), samples, read: Box::new(read) });
    }
    let mut samples = Vec::new();
    found(&root.join("scenes"), &["toml"], &mut samples, None);
    found(&corpus.join("scene_file"), &["toml"], &mut samples, None);
    let read = |bytes: &[u8], _: &mut Random| {
        if bytes.len() as u64 > scene_file::MAX_FILE_SIZE {
            return; // Refused before it is parsed.
        }
        let mut parts = bytes.split(|&byte| byte == 0).map(|part| String::from_utf8_lossy(part).into_owned());
        let text = parts.next().unwrap_or_default();
        let sets: Vec<String> = parts.collect();
        let _ = scene_file::parse("scene.toml", &text, Path::new("/nowhere"), &sets);
    };
    formats.push(Format { name: "scene file".to_owned(), samples, read: Box::new(read) });
    let mut samples = Vec::new();
    found(&corpus.join("profile"), &["csv"], &mut samples, None);
    let path = folder.join("profile.csv");
    let read = move |bytes: &[u8], _: &mut Random| {
        std::fs::write(&path, bytes).unwrap();
        let _ = read_profile(&path);
    };
    formats.push(Format { name: "profile".to_owned(), samples, read: Box::new(read) });
    formats
}

/// Adds the files with these extensions in a folder and those below it, in the order of their names. What else lies
/// beside such a file is copied to `companions`.
fn found(folder: &Path, extensions: &[&str], samples: &mut Vec<Vec<u8>>, companions: Option<&Path>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let fits =
        |path: &Path| path.extension().is_some_and(|extension| extensions.iter().any(|known| extension == *known));
    let any = paths.iter().any(|path| fits(path));
    for path in paths {
        if path.is_dir() {
            found(&path, extensions, samples, companions);
        } else if fits(&path) {
            if std::fs::metadata(&path).unwrap().len() <= LONGEST_SAMPLE {
                samples.push(std::fs::read(path).unwrap());
            }
        } else if let Some(companions) = companions.filter(|_| any) {
            std::fs::copy(&path, companions.join(path.file_name().unwrap())).unwrap();
        }
    }
}

/// Whether both hold the same, NaN being as good as NaN.
fn same(a: &Columns, b: &Columns) -> bool {
    let equal = |a: &[f64], b: &[f64]| a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits()));
    (a.len(), a.names(), &a.notes) == (b.len(), b.names(), &b.notes)
        && a.iter().count() == b.iter().count()
        && a.iter().zip(b.iter()).all(|(a, b)| (&a.name, a.byte) == (&b.name, b.byte) && equal(&a.values, &b.values))
}

// ---- mutations ----

/// Steele, Lea and Flood's SplitMix64 (2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// An integer from 0 to below `end`, 0 if that is 0.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % (end.max(1) as u64)) as usize
    }

    /// A range within `length` bytes, short ones more often.
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length);
        let longest = 1 << self.below(12);
        start..length.min(start + self.below(longest) + 1)
    }

    fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }
}

/// Numbers at the edges of types.
const INTEGERS: &[u64] = &[
    0,
    1,
    2,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0x8000,
    0xffff,
    0x1_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0xffff_ffff_ffff_ffff,
    // NaN and infinity, of four and of eight bytes.
    0x7fc0_0000,
    0x7f80_0000,
    0x7ff8_0000_0000_0000,
    0x7ff0_0000_0000_0000,
];

/// The same for text.
const WORDS: &[&str] = &[
    "0",
    "-1",
    "1",
    "255",
    "256",
    "65536",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "99999999999999999999999",
    "1e308",
    "1e999",
    "-1e-999",
    "nan",
    "inf",
    "",
    "\n",
    "\r",
    "\0",
    "\"",
    "\u{fffd}",
];

/// Input `index` of a format, and what the generator goes on with.
fn input(format: &Format, index: u64) -> (Vec<u8>, Random) {
    let name = format.name.bytes().fold(0_u64, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
    let mut random = Random(name.wrapping_mul(0x1_0000_0001).wrapping_add(index.wrapping_mul(0xd134_2543_de82_ef95)));
    if random.below(100) == 0 {
        let length = 1 << random.below(12);
        return ((0..random.below(length)).map(|_| random.next() as u8).collect(), random);
    }
    let mut bytes = random.pick(&format.samples).clone();
    let changes = 1 << random.below(4);
    for _ in 0..1 + random.below(changes) {
        let length = bytes.len();
        match random.below(10) {
            // Bit flips twice as often as the rest.
            0 | 1 if length > 0 => bytes[random.below(length)] ^= 1 << random.below(8),
            2 if length > 0 => bytes[random.below(length)] = random.next() as u8,
            3 => bytes.truncate(random.below(length)),
            4 => drop(bytes.drain(random.range(length))),
            5 => {
                let piece = bytes[random.range(length)].to_vec();
                let at = random.below(length + 1);
                bytes.splice(at..at, piece);
            }
            6 => {
                let other = random.pick(&format.samples);
                let from = random.below(other.len());
                bytes.truncate(random.below(length));
                bytes.extend_from_slice(&other[from..]);
            }
            7 => {
                let mut value = random.pick(INTEGERS).to_le_bytes().to_vec();
                value.truncate(1 << random.below(4));
                if random.below(2) == 0 {
                    value.reverse();
                }
                let at = random.below(length.saturating_sub(value.len()));
                let end = length.min(at + value.len());
                bytes.splice(at..end, value);
            }
            8 => {
                // The next number written in digits.
                let start = random.below(length);
                let is_digit = |byte: &u8| byte.is_ascii_digit();
                let at = start + bytes[start..].iter().position(is_digit).unwrap_or(0);
                let end = at + bytes[at..].iter().take_while(|byte| is_digit(byte)).count();
                bytes.splice(at..end, random.pick(WORDS).bytes());
            }
            _ => {
                let range = random.range(length);
                let noise: Vec<u8> = range.clone().map(|_| random.next() as u8).collect();
                bytes.splice(range, noise);
            }
        }
    }
    bytes.truncate(LONGEST_INPUT);
    if random.below(200) == 0 {
        // What takes long or much only when there is much of it.
        let start = random.below(bytes.len());
        let end = bytes.len().min(start + 1 + random.below(24));
        let piece = bytes[start..end].to_vec();
        let times = random.below(LONGEST_REPETITION) / piece.len().max(1);
        bytes.splice(end..end, piece.repeat(times));
    }
    (bytes, random)
}

// ---- the process of a format ----

/// A temporary folder, in memory where the system can.
fn temporary_folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let builder = tempfile::Builder::new();
    if memory.is_dir() { builder.tempdir_in(memory) } else { builder.tempdir() }.unwrap()
}

#[test]
#[ignore = "what `damaged_files_are_survived` starts in a process of its own"]
fn task() {
    let Ok(task) = std::env::var(TASK) else { return };
    let [name, first, end, progress] = task.split('|').collect::<Vec<_>>()[..] else { panic!("{task}") };
    let (_, peak) = peak_of(|| std::hint::black_box(vec![1_u8; 1 << 20]));
    assert!((1 << 20..2 << 20).contains(&peak), "a megabyte was counted as {peak} bytes");
    let folder = temporary_folder();
    let formats = formats(folder.path()).into_iter().chain(planted()).collect::<Vec<_>>();
    let format = formats.iter().find(|format| format.name == name).unwrap();
    let mut progress = std::fs::OpenOptions::new().write(true).open(progress).unwrap();
    for index in first.parse().unwrap()..end.parse::<u64>().unwrap() {
        let (bytes, mut random) = input(format, index);
        progress.seek(SeekFrom::Start(0)).unwrap();
        progress.write_all(&index.to_le_bytes()).unwrap();
        let ((), peak) = peak_of(|| (format.read)(&bytes, &mut random));
        let allowed = GROWTH * bytes.len() as u64 + ALLOWANCE;
        assert!(peak <= allowed, "{peak} bytes in use for an input of {}; allowed: {allowed}", bytes.len());
    }
}

/// Runs the inputs of a format in another process, each for `longest` at most; an error says which is not survived.
fn run(format: &Format, count: u64, longest: Duration, folder: &Path) -> Result<(), String> {
    let name = &format.name;
    let progress = folder.join("progress");
    std::fs::write(&progress, 0_u64.to_le_bytes()).unwrap();
    let reached = || u64::from_le_bytes(std::fs::read(&progress).unwrap().try_into().unwrap());
    let output = std::fs::File::create(folder.join("output")).unwrap();
    let mut process = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "mutations::task", "--ignored", "--nocapture", "--test-threads=1"])
        .env(TASK, format!("{name}|0|{count}|{}", progress.display()))
        .stdin(Stdio::null())
        .stdout(output.try_clone().unwrap())
        .stderr(output)
        .spawn()
        .unwrap();
    let (mut last, mut since) = (0, Instant::now());
    let outcome = loop {
        if let Some(status) = process.try_wait().unwrap() {
            break if status.success() { None } else { Some(status.to_string()) };
        }
        let now = reached();
        if now != last {
            (last, since) = (now, Instant::now());
        } else if since.elapsed() > longest {
            process.kill().unwrap();
            process.wait().unwrap();
            break Some(format!("no end after {longest:?}"));
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let Some(outcome) = outcome else {
        // A task that did not run is no success.
        return if count == 0 || reached() == count - 1 { Ok(()) } else { Err(format!("{name}: no input was read")) };
    };
    let index = reached();
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mutation-{}-{index}", name.replace(' ', "-")));
    std::fs::write(&kept, input(format, index).0).unwrap();
    let mut output = String::new();
    std::fs::File::open(folder.join("output")).unwrap().read_to_string(&mut output).unwrap();
    Err(format!("{name}: input {index} is not survived ({outcome}); it is in {}\n{output}", kept.display()))
}

#[test]
fn damaged_files_are_survived() {
    let count = std::env::var(COUNT).map_or(INPUTS, |count| count.parse().expect("STEREOMIST_MUTATIONS is a number"));
    let folder = temporary_folder();
    let mut problems = Vec::new();
    for format in formats(folder.path()) {
        assert!(!format.samples.is_empty(), "{} has no valid file: put one into tests/data", format.name);
        let begin = Instant::now();
        problems.extend(run(&format, count, LONGEST, folder.path()).err());
        println!("{}: {count} inputs in {:.1} s", format.name, begin.elapsed().as_secs_f64());
    }
    assert!(problems.is_empty(), "\n{}", problems.join("\n"));
}

/// Inputs that are nearly all refused at once, or never, would test nothing behind the first lines of a reader.
#[test]
fn mutations_are_neither_harmless_nor_all_fatal() {
    let folder = temporary_folder();
    for format in formats(folder.path()) {
        let count = 300;
        let inputs: Vec<Vec<u8>> = (0..count).map(|index| input(&format, index).0).collect();
        let unchanged = inputs.iter().filter(|input| format.samples.contains(input)).count();
        assert!(unchanged < 30, "{}: {unchanged} of {count} are no mutations", format.name);
        assert_eq!(inputs[7], input(&format, 7).0, "the same every time");
        if let Some(reader) = READERS.iter().find(|reader| reader.name == format.name) {
            let read = |bytes: &Vec<u8>| files::read_with(reader, bytes, &Selection::All).is_ok();
            let accepted = inputs.iter().filter(|bytes| read(bytes)).count();
            assert!((2..290).contains(&accepted), "{}: {accepted} of {count} are read", format.name);
        }
    }
}

/// Formats whose readers do not survive their tenth input or one soon after.
fn planted() -> Vec<Format> {
    let fault = |name: &str, fault: fn()| {
        let calls = std::cell::Cell::new(0);
        let read = move |_: &[u8], _: &mut Random| {
            calls.set(calls.get() + 1);
            if calls.get() == 10 {
                fault();
            }
        };
        Format { name: name.to_owned(), samples: vec![b"sample".to_vec()], read: Box::new(read) }
    };
    vec![
        fault("planted panic", || panic!("planted")),
        fault("planted abort", || std::process::abort()),
        fault("planted greed", || drop(std::hint::black_box(vec![0_u8; 65 << 20]))),
        fault("planted hang", || std::thread::sleep(Duration::from_secs(3600))),
    ]
}

/// A check that cannot fail is worth nothing.
#[test]
fn planted_faults_are_found() {
    let folder = temporary_folder();
    for format in planted() {
        // For a hang enough for the process to start on a busy machine.
        let longest = if format.name.ends_with("hang") { Duration::from_secs(3) } else { LONGEST };
        let message = run(&format, 20, longest, folder.path()).unwrap_err();
        files::assert_says(&message, &[&format.name, "input 9 is not survived"]);
    }
}
