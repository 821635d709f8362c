//! Arguments: `cargo +nightly fuzz run text fuzz/corpus/text fuzz/seeds/text`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = sspc_fuzz::text::read(bytes);
});
