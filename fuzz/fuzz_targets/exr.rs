//! OpenEXR files: `cargo +nightly fuzz run exr fuzz/corpus/exr fuzz/seeds/exr`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::sync::OnceLock;

static DESK: OnceLock<sspc_fuzz::exr::Desk> = OnceLock::new();

fuzz_target!(|bytes: &[u8]| {
    let desk = DESK.get_or_init(|| {
        let folder = std::env::temp_dir().join(format!("sspc-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder for the files that are read");
        sspc_fuzz::exr::Desk::new(&folder)
    });
    let _ = desk.read(bytes);
});
