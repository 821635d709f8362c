//! Pictures bit for bit as they were: hashes of pixels, for every instruction set, made by an earlier program.
//!
//! `tests/golden/README.md` says how they are made anew.

use crate::skips::skipped;
use sspc_frames::read_picture;
use sspc_kernels::simd::{ISA_VARIABLE, Isa};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// `write` makes hashes anew instead of comparing with them.
const MODE_VARIABLE: &str = "SSPC_GOLDEN";
/// Another program than the one under test, to make hashes with.
const PROGRAM_VARIABLE: &str = "SSPC_GOLDEN_PROGRAM";
/// Every instruction set that hashes are kept for.
const ISAS: [&str; 3] = ["portable", "avx2", "avx512"];

/// What a run leaves and is judged by: hashes by name.
pub type Hashes = BTreeMap<String, String>;
/// Hashes by case, then by instruction set, then by what was hashed.
type Record = BTreeMap<String, BTreeMap<String, Hashes>>;

/// A run of a program.
pub struct Case {
    pub name: &'static str,
    /// Arguments; the folder that it may write to is the working directory.
    pub arguments: Vec<OsString>,
    /// What to hash of the folder.
    pub hashes: fn(&Path) -> Hashes,
    /// Whether a library chooses instructions by the machine, whatever we ask for: only the machine's widest set is checked.
    pub by_machine: bool,
}

/// Where golden files lie.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden")
}

/// Whether hashes are to be made anew.
pub fn is_writing() -> bool {
    std::env::var_os(MODE_VARIABLE).is_some_and(|mode| mode == "write")
}

/// Runs every case under every instruction set of this machine and compares with `file`; the others are said aloud.
///
/// # Panics
/// When a run fails, or a hash is another one.
pub fn check(file: &str, program: &str, cases: &[Case]) {
    let path = folder().join(file);
    let mut record: Record = match std::fs::read(&path) {
        Ok(bytes) => serde_json::from_slice(&bytes).expect("the record of hashes"),
        Err(_) => Record::new(),
    };
    let program = std::env::var_os(PROGRAM_VARIABLE).filter(|_| is_writing()).unwrap_or_else(|| program.into());
    let mut others = Vec::new();
    for name in ISAS {
        let Ok(isa) = Isa::named(name) else {
            skipped(&format!("{} pictures under {name}", cases.len()), "this machine lacks the instruction set");
            continue;
        };
        for case in cases.iter().filter(|case| !case.by_machine || isa == Isa::best()) {
            let folder = tempfile::tempdir().expect("a temporary folder");
            run(&program, case, isa, folder.path());
            let found = (case.hashes)(folder.path());
            let expected = record.entry(case.name.into()).or_default();
            if is_writing() {
                expected.insert(name.into(), found);
                continue;
            }
            match expected.get(name) {
                Some(kept) if kept.is_empty() => {
                    skipped(&format!("{} under {name}", case.name), "its hash was made on a machine without it");
                }
                Some(kept) if *kept == found => (),
                other => others.push(format!("{}, {name}: expected {other:?}, found {found:?}", case.name)),
            }
        }
    }
    if is_writing() {
        record.retain(|name, _| cases.iter().any(|case| case.name == name));
        let text = serde_json::to_string_pretty(&record).expect("JSON");
        std::fs::write(&path, text + "\n").expect("the record can be written");
    }
    assert!(others.is_empty(), "{} runs give another picture:\n{}", others.len(), others.join("\n"));
}

fn run(program: &OsString, case: &Case, isa: Isa, folder: &Path) {
    let mut command = Command::new(program);
    command.args(&case.arguments).current_dir(folder).stdin(Stdio::null()).env(ISA_VARIABLE, isa.name());
    let output = command.output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}, {}: {said}", case.name, isa.name());
}

/// Hash of a picture's size and pixels.
///
/// # Panics
/// When it cannot be read.
pub fn hash_of_picture(path: &Path) -> String {
    let picture = read_picture(path, None).unwrap_or_else(|error| panic!("{error}"));
    let size = [picture.height() as u32, picture.width() as u32];
    hash(size.into_iter().chain(picture.data().iter().map(|v| v.to_bits())))
}

/// Hash of a model's weights.
///
/// # Panics
/// When it cannot be read.
pub fn hash_of_weights(path: &Path) -> String {
    let model = sspc_onnx::load_model(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    hash(model.weights.iter().map(|w| w.to_bits()))
}

/// 64 bits of FNV-1a (Fowler, Noll, Vo) over the words' bytes, the lowest first.
fn hash(words: impl Iterator<Item = u32>) -> String {
    let add = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
    format!("{:016x}", words.flat_map(u32::to_le_bytes).fold(0xCBF2_9CE4_8422_2325, add))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_counts() {
        assert_eq!(hash(std::iter::empty()), "cbf29ce484222325");
        assert_ne!(hash([0].into_iter()), hash([0, 0].into_iter()));
        assert_ne!(hash([0x8000_0000].into_iter()), hash([0].into_iter()), "the sign of zero counts");
    }
}
