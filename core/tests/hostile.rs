//! Files damaged at random: whatever happens to the bytes, reading ends, in time, with a frame or a one-line error.

mod common;

use common::{HALF, Part, write_parts};
use exr::compression::Compression;
use sspc_core::io::{FrameFiles, RoleOverrides, read_frame, read_picture, write_corrected};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Damaged files per kind of file; `SSPC_HOSTILE_CASES` asks for more.
const CASES: u64 = 100;
/// Peak memory of this test process: the files hold kilobytes, and no claim of theirs may be believed beyond this.
const MOST_MEMORY_KIB: u64 = 1 << 20;
/// One read of a file of a few kilobytes takes microseconds; a second is a hang.
const LONGEST: Duration = Duration::from_secs(2);

struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % bound.max(1) as u64) as usize
    }
}

/// The process's peak resident memory where the system tells it.
fn peak_memory_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

fn cases() -> u64 {
    std::env::var("SSPC_HOSTILE_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(CASES)
}

/// One to four injuries: cut, flipped bits, overwritten or repeated bytes, extreme numbers.
fn injure(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        // Half of the injuries hit the header, where the claims are.
        let at = if random.below(2) == 0 { at.min(random.below(600)) } else { at };
        match random.below(7) {
            0 => bytes.truncate(at.max(1)),
            1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at] = random.below(256) as u8,
            3 => {
                let end = (at + 4).min(bytes.len());
                let number = [i32::MAX, i32::MIN, -1, 0, 1 << 16, 1 << 24, 65_536 * 16][random.below(7)];
                bytes[at..end].copy_from_slice(&number.to_le_bytes()[..end - at]);
            }
            4 => {
                let end = (at + random.below(40)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let target = random.below(bytes.len());
                bytes.splice(target..target, piece);
            }
            5 => {
                let end = (at + random.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            _ => {
                let end = (at + random.below(64)).min(bytes.len());
                bytes[at..end].iter_mut().for_each(|byte| *byte = 0xff);
            }
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
}

fn kinds(folder: &Path) -> Vec<(String, PathBuf)> {
    let single = |name: &str, compression, half| {
        let part = Part { channels: HALF, size: (40, 36), half, compression, ..Part::default() };
        (name.to_string(), write_parts(&folder.join(format!("{name}.exr")), 1, &[part]))
    };
    let parts: Vec<Part> = [("V.Combined", "V.Combined"), ("V.Noisy Image", "V.Noisy Image")]
        .iter()
        .map(|(name, _)| Part {
            name,
            channels: if name.ends_with("Image") {
                &["V.Noisy Image.R", "V.Noisy Image.G", "V.Noisy Image.B"]
            } else {
                &["V.Combined.R", "V.Combined.G", "V.Combined.B"]
            },
            ..Part::default()
        })
        .collect();
    let tiles = Part { channels: HALF, size: (40, 36), tiles: Some((16, 8)), ..Part::default() };
    let tiled = ("tiled".to_string(), write_parts(&folder.join("tiled.exr"), 1, &[tiles]));
    vec![
        single("none", Compression::Uncompressed, true),
        single("rle", Compression::RLE, true),
        single("zips", Compression::ZIP1, false),
        single("zip", Compression::ZIP16, true),
        single("piz", Compression::PIZ, true),
        single("pxr24", Compression::PXR24, false),
        single("b44", Compression::B44, true),
        single("b44a", Compression::B44A, true),
        tiled,
        ("parts".to_string(), write_parts(&folder.join("parts.exr"), 1, &parts)),
    ]
}

#[test]
fn damaged_files_end_in_a_frame_or_one_line() {
    let folder = tempfile::tempdir().expect("folder");
    let other = folder.path().join("b.exr");
    write_parts(&other, 2, &[Part { channels: HALF, size: (40, 36), ..Part::default() }]);
    let damaged = folder.path().join("damaged.exr");
    let out = folder.path().join("out.exr");
    let (mut refused, mut read) = (0u64, 0u64);
    for (kind, path) in kinds(folder.path()) {
        let whole = std::fs::read(&path).expect("read");
        for case in 1..=cases() {
            let mut bytes = whole.clone();
            let mut random = Random(case.wrapping_mul(0x9E37_79B9_7F4A_7C15));
            injure(&mut bytes, &mut random);
            std::fs::write(&damaged, &bytes).expect("written");
            let start = Instant::now();
            let frame = read_frame(&FrameFiles::halves(&damaged, &other), &RoleOverrides::none());
            match (read_picture(&damaged, None), frame) {
                (Ok(picture), _) => {
                    read += 1;
                    let _ = write_corrected(&out, &damaged, &[], &picture, &[]);
                }
                (Err(error), _) => {
                    refused += 1;
                    assert!(!error.to_string().contains('\n'), "{kind} {case}: {error}");
                }
            }
            assert!(start.elapsed() < LONGEST, "{kind} {case} took {:?}", start.elapsed());
        }
    }
    println!("{refused} refused, {read} read, peak {:?} KiB", peak_memory_kib());
    assert!(peak_memory_kib().is_none_or(|peak| peak < MOST_MEMORY_KIB), "peak {:?} KiB", peak_memory_kib());
    assert!(refused > 0 && read > 0, "the injuries are neither all fatal nor all harmless");
}
