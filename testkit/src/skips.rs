//! What a test cannot do here, said aloud.

use std::io::Write;
use std::path::PathBuf;

/// Says on standard error that something is left out. The test harness keeps what `eprintln!` prints of a test that
/// passes to itself, so this writes past it.
pub fn skipped(what: &str, why: &str) {
    let test = std::thread::current();
    let line = format!("\nSKIPPED in {}: {what}: {why}\n", test.name().unwrap_or("a test"));
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// The interpreter of the PyTorch reference's virtual environment, which has onnx and onnxruntime; `None`, said aloud,
/// where `SSPC_PYTHON_VENV` names none.
pub fn python(what: &str) -> Option<PathBuf> {
    let python = std::env::var_os("SSPC_PYTHON_VENV").map(PathBuf::from);
    if python.is_none() {
        skipped(what, "SSPC_PYTHON_VENV names no interpreter; .ci/setup-python makes one and prints it");
    }
    python
}
