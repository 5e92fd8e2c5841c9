//! Files that lie, end early or are noise: an error in one line, never a panic, a hang or a huge allocation.

use std::time::{Duration, Instant};

use exr::prelude::{AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, LineOrder, WritableImage};
use proptest::prelude::*;
use stereomist::picture::output::WRITERS;
use stereomist::picture::read::{Image, read, read_bytes};

use super::gradient;

fn valid() -> Vec<(&'static str, Vec<u8>)> {
    let picture = gradient([23, 19]);
    WRITERS.iter().map(|w| (w.name, (w.encode)(&picture).expect("encodes"))).collect()
}

/// Reads; checks that what comes is whole and what fails says so briefly.
fn probe(bytes: &[u8]) -> Result<Image, String> {
    let start = Instant::now();
    let result = read_bytes(bytes);
    assert!(start.elapsed() < Duration::from_secs(10), "took {:?}", start.elapsed());
    match &result {
        Ok(image) => image.picture.check().expect("whole"),
        Err(message) => assert!(!message.is_empty() && !message.contains('\n') && message.len() < 1500, "{message:?}"),
    }
    result
}

#[test]
fn every_truncation_is_refused() {
    for (name, bytes) in valid() {
        assert!(probe(&bytes).is_ok(), "{name}");
        for end in 0..bytes.len() {
            // The last chunk of a PNG says only that it was the last.
            let harmless = name.starts_with("png") && end >= bytes.len() - 16;
            assert!(probe(&bytes[..end]).is_err() || harmless, "{name} cut to {end} of {} bytes", bytes.len());
        }
    }
}

#[test]
fn header_lies_are_refused() {
    for (name, bytes) in valid() {
        let mut lies = Vec::new();
        match name {
            "png" | "png16" => {
                for (width, height) in
                    [(0, 5), (5, 0), (32769, 1), (1, 40000), (32768, 8193), (32768, 8192), (u32::MAX, u32::MAX)]
                {
                    let mut lie = bytes.clone();
                    lie[16..20].copy_from_slice(&u32::to_be_bytes(width));
                    lie[20..24].copy_from_slice(&u32::to_be_bytes(height));
                    let crc = crc(&lie[12..29]);
                    lie[29..33].copy_from_slice(&crc.to_be_bytes());
                    lies.push(lie);
                }
            }
            "jpg" => {
                let frame = bytes.windows(2).position(|w| w == [0xff, 0xc0]).expect("a frame header");
                for side in [0_u16, 32769, 65535, 16000] {
                    let mut lie = bytes.clone();
                    lie[frame + 5..frame + 7].copy_from_slice(&side.to_be_bytes());
                    lie[frame + 7..frame + 9].copy_from_slice(&side.to_be_bytes());
                    lies.push(lie);
                }
            }
            _ => {
                let window = bytes.windows(11).position(|w| w == b"dataWindow\0").expect("a data window") + 11 + 6 + 4;
                for (x, y) in [(-1, -1), (32768, 0), (32767, 8191), (i32::MAX, i32::MAX), (i32::MIN, 3), (16000, 16000)]
                {
                    let mut lie = bytes.clone();
                    lie[window + 8..window + 12].copy_from_slice(&i32::to_le_bytes(x));
                    lie[window + 12..window + 16].copy_from_slice(&i32::to_le_bytes(y));
                    lies.push(lie);
                }
            }
        }
        for lie in lies {
            assert!(probe(&lie).is_err(), "{name}");
        }
    }
}

/// The checksum of PNG chunks.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn what_is_no_picture_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = folder.path().join("notes.png");
    std::fs::write(&text, "not a picture").expect("written");
    let mut paths = vec![text, folder.path().to_path_buf(), folder.path().join("nowhere.png")];
    if cfg!(unix) {
        paths.extend(["/dev/null".into(), "/dev/zero".into()]);
    }
    for path in paths {
        let error = read(&path).expect_err("no picture");
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
    }
}

/// Its decoder can end the process on a damaged file, so whole ones are refused as well.
#[test]
fn dwa_compression_is_refused() {
    let plane = || FlatSamples::F32(vec![0.5; 64]);
    let channels = ["R", "G", "B"].into_iter().map(|name| AnyChannel::new(name, plane())).collect();
    let encoding =
        Encoding { compression: Compression::DWAA(None), blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let file = exr::prelude::Image::from_encoded_channels((8, 8), encoding, AnyChannels::sort(channels));
    let mut bytes = std::io::Cursor::new(Vec::new());
    file.write().non_parallel().to_buffered(&mut bytes).expect("encodes");
    assert!(probe(bytes.get_ref()).expect_err("refused").contains("DWA"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_after_a_signature(kind in 0..4_usize, noise in prop::collection::vec(any::<u8>(), 0..400)) {
        let signature: &[u8] = [&b"\x89PNG\r\n\x1a\n"[..], &[0xff, 0xd8, 0xff], &[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0], &[]][kind];
        let _ = probe(&[signature, &noise].concat());
    }

    #[test]
    fn flipped_bits(
        kind in 0..4_usize,
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u8), 1..8),
        early in any::<bool>(),
    ) {
        let (_, mut bytes) = valid().swap_remove(kind);
        for (index, bit) in flips {
            // Half of the cases damage the headers, which are a small part of the file.
            let length = if early { bytes.len().min(350) } else { bytes.len() };
            let at = index.index(length);
            bytes[at] ^= 1 << bit;
        }
        let _ = probe(&bytes);
    }
}
