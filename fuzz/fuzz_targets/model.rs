//! Model files: `cargo +nightly fuzz run model fuzz/corpus/model fuzz/seeds/model`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = sspc_fuzz::model::read(bytes);
});
