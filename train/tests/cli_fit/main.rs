//! sspc-train as a user runs it, on the repository's sample.

mod differences;
mod fits;
mod refusals;
mod reports;
mod shots;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.stdin(Stdio::null());
    command
}

/// `fit` of the sample with a few steps, and more arguments.
fn fit(out: &Path, arguments: &[&str]) -> Output {
    command()
        .arg("fit")
        .args([sample("a.exr"), sample("b.exr")])
        .args(["--steps", "4", "-o"])
        .arg(out)
        .args(arguments)
        .output()
        .expect("sspc-train starts")
}

fn report(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("report.json")).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

fn assert_success(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}
