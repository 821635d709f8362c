//! What must hold for every sequence of bytes, one module per reader.
//!
//! Two drivers call these functions: libFuzzer (`fuzz_targets`, nightly, as long as one likes) and the ordinary
//! test `tests/tests/fuzz` (stable, seconds, fixed seed), which includes this file. So nothing here may need
//! more than sspc-frames, sspc-image, sspc-onnx and exr. A function returns whether the bytes were accepted; it panics where a
//! promise is broken.

pub mod exr;
pub mod model;
pub mod text;

/// Longest message: a line that a person reads, with a path and two cut-off texts from the file.
const LONGEST_LINE: usize = 2_000;

/// Errors are one line of bounded length without control characters, whatever the file held.
fn assert_one_line(error: &dyn std::error::Error) {
    let line = error.to_string();
    assert!(!line.is_empty() && line.len() <= LONGEST_LINE, "a message of {} bytes", line.len());
    assert!(!line.chars().any(char::is_control), "control characters in {line:?}");
}
