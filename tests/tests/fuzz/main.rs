//! A bounded run of the fuzz targets on stable Rust: every seed, and each seed damaged in many ways, always the
//! same ones. It fails on a panic, a broken promise of `fuzz/src`, more memory than the bytes can be worth, or an
//! input that takes seconds. `SSPC_FUZZ_CASES` asks for another number of damaged copies of each seed;
//! `SSPC_FUZZ_CASE=SEED:NUMBER` runs one again.

mod damage;
mod headers;
mod seeds;
#[path = "../../../fuzz/src/lib.rs"]
mod targets;

use damage::{Alphabet, damaged};
use sspc_testkit::peak::{PeakAlloc, peak_of};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Reading a few kilobytes takes microseconds, and a millisecond where threads are started; seconds are a hang
/// (the machine may be busy).
const LONGEST: Duration = Duration::from_secs(5);

/// Memory is counted for the whole process, so one test counts at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    ONE_AT_A_TIME.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// What a header of a small file may claim is 64 MiB; as f32 that is at most twice as much, beside which the decoder
/// holds little.
const MOST_OF_A_SMALL_PICTURE: usize = 144 << 20;

fn seeds_of(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
    let mut seeds: Vec<(String, Vec<u8>)> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("entry").path())
        .map(|path| (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), path))
        .map(|(name, path)| (name, std::fs::read(path).expect("a seed")))
        .collect();
    seeds.sort();
    seeds
}

/// Which copies of a seed to read: 0 is the seed itself.
fn cases(seed: &str, usual: u64) -> std::ops::Range<u64> {
    if let Ok(one) = std::env::var("SSPC_FUZZ_CASE") {
        let number = one.strip_prefix(seed).and_then(|rest| rest.strip_prefix(':')?.parse::<u64>().ok());
        return number.map_or(0..0, |number| number..number + 1);
    }
    0..1 + std::env::var("SSPC_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// Reads every seed and `usual` damaged copies of each. `most_memory` is what reading may hold at once, in bytes.
fn run(target: &str, usual: u64, alphabet: Alphabet, most_memory: usize, read: impl Fn(&[u8]) -> bool) {
    let of = |whole: &[u8], seeds: &[(String, Vec<u8>)], case| Some(damaged(whole, seeds, case, alphabet));
    run_copies(target, usual, of, most_memory, read);
}

/// The same for copies of another kind, where a seed has such.
fn run_copies(
    target: &str,
    usual: u64,
    copy: impl Fn(&[u8], &[(String, Vec<u8>)], u64) -> Option<Vec<u8>>,
    most_memory: usize,
    read: impl Fn(&[u8]) -> bool,
) {
    let _alone = alone();
    let seeds = seeds_of(target);
    let (mut accepted, mut refused, mut most) = (0u64, 0u64, 0);
    for (name, whole) in &seeds {
        for case in cases(name, usual) {
            let bytes = if case == 0 { Some(whole.clone()) } else { copy(whole, &seeds, case) };
            let Some(bytes) = bytes else { break };
            let start = Instant::now();
            let guarded = || std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| read(&bytes)));
            let (outcome, held) = peak_of(&ALLOCATOR, guarded);
            let taken = start.elapsed();
            match outcome {
                Ok(true) => accepted += 1,
                Ok(false) => {
                    assert!(case > 0, "{target}: the seed {name} is refused");
                    refused += 1;
                }
                Err(_) => panic!("{target}: a panic with SSPC_FUZZ_CASE={name}:{case}"),
            }
            assert!(held <= most_memory, "{target}: {held} bytes held with SSPC_FUZZ_CASE={name}:{case}");
            assert!(taken < LONGEST, "{target}: {taken:?} with SSPC_FUZZ_CASE={name}:{case}");
            most = most.max(held);
        }
    }
    println!("{target}: {accepted} accepted, {refused} refused, most memory {} KiB", most >> 10);
    let all = std::env::var("SSPC_FUZZ_CASE").is_err();
    assert!(!all || (accepted > 0 && refused > 0), "the damage is neither always fatal nor always harmless");
}

#[test]
fn damaged_pictures_end_in_a_frame_or_one_line() {
    let folder = tempfile::tempdir().expect("folder");
    let desk = targets::exr::Desk::new(folder.path());
    run("exr", 200, Alphabet::Bytes, MOST_OF_A_SMALL_PICTURE, |bytes| desk.read(bytes));
}

#[test]
fn whatever_header_is_taken_the_output_opens() {
    let folder = tempfile::tempdir().expect("folder");
    let desk = targets::exr::Desk::new(folder.path());
    run_copies(
        "exr",
        100,
        |whole, _, case| headers::changed(whole, case),
        MOST_OF_A_SMALL_PICTURE,
        |bytes| desk.read(bytes),
    );
    println!("{} outputs", desk.outputs());
    let all = std::env::var("SSPC_FUZZ_CASE").is_err();
    assert!(!all || desk.outputs() > 300, "{} headers are taken and written", desk.outputs());
}

/// The claims of a header, from what no one renders down to what a small file might hold: none may cost more memory
/// than the limit, and what cannot be in the file costs nothing.
#[test]
fn claims_of_a_header_are_weighed_before_they_are_believed() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("folder");
    let desk = targets::exr::Desk::new(folder.path());
    let name = b"dataWindow\0box2i\0\x10\0\0\0";
    for (seed, whole) in seeds_of("exr") {
        let at = whole.windows(name.len()).position(|w| w == name).expect("a data window") + name.len();
        for (width, height) in [
            (1_000_000_000, 1_000_000_000),
            (65_536, 65_536),
            (i32::MAX, 1),
            (1, i32::MAX),
            (16_384, 8_192),
            (65_536, 16),
            (4_096, 1_024),
            (1_024, 1_024),
            (16, 65_536),
        ] {
            let mut bytes = whole.clone();
            let window = [0, 0, width - 1, height - 1].map(i32::to_le_bytes).concat();
            bytes[at..at + window.len()].copy_from_slice(&window);
            let start = Instant::now();
            let (read, held) = peak_of(&ALLOCATOR, || desk.read(&bytes));
            assert!(!read, "{seed} holds no {width}x{height}");
            // Refused from the header alone: the decoder's buffers and the header itself.
            let impossible = i64::from(width) * i64::from(height) > 1 << 24;
            let most = if impossible { 1 << 20 } else { MOST_OF_A_SMALL_PICTURE };
            assert!(held <= most, "{seed} as {width}x{height}: {held} bytes held");
            assert!(start.elapsed() < LONGEST, "{seed} as {width}x{height}: {:?}", start.elapsed());
        }
    }
}

#[test]
fn damaged_models_end_in_the_contract_or_one_line() {
    // A message of two bytes is a structure of some hundred; the seeds hold kilobytes.
    run("model", 1_000, Alphabet::Bytes, 16 << 20, targets::model::read);
}

#[test]
fn damaged_arguments_end_in_sense_or_one_line() {
    // A million frames, once as ranges read, once as their set, once as shown and read again.
    run("text", 500, Alphabet::Text, 256 << 20, targets::text::read);
}

/// A file may be made of the smallest messages, each of which becomes a structure.
#[test]
fn the_memory_of_a_model_is_bounded_by_its_size() {
    let _alone = alone();
    // What the limit on a file's size promises: a hundred and some times itself, twice while a vector grows.
    const MOST: usize = 320 << 20;
    // ModelProto.graph (7) with empty nodes (1), tensors (5), inputs (11); empty metadata (14).
    for (field, inside) in [(1u8, true), (5, true), (11, true), (14, false)] {
        let size = sspc_onnx::MAX_FILE_BYTES as usize - 16;
        let empty: Vec<u8> = [field << 3 | 2, 0].into_iter().cycle().take(size).collect();
        let mut bytes = Vec::new();
        if inside {
            // A length of four bytes: seven bits each, the lowest first.
            bytes = vec![
                7 << 3 | 2,
                size as u8 | 0x80,
                (size >> 7) as u8 | 0x80,
                (size >> 14) as u8 | 0x80,
                (size >> 21) as u8,
            ];
        }
        bytes.extend(&empty);
        let (read, held) = peak_of(&ALLOCATOR, || targets::model::read(&bytes));
        assert!(!read);
        println!("{} KiB held for field {field}", held >> 10);
        assert!(held <= MOST, "{held} bytes held for empty messages of field {field}");
    }
}

#[test]
fn memory_that_is_asked_for_counts_whether_or_not_it_is_touched() {
    let _alone = alone();
    let (_, held) = peak_of(&ALLOCATOR, || drop(std::hint::black_box(vec![0u8; 100 << 20])));
    assert!(held >= 100 << 20);
}
