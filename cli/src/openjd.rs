//! Messages of Open Job Description: lines on standard output that a farm's worker reads as progress, status and failure.
//!
//! [How Jobs Are Run](https://github.com/OpenJobDescription/openjd-specifications/wiki/How-Jobs-Are-Run), "Stdout/Stderr
//! Messages". Where nobody reads them any more, the work goes on.

use std::io::{Write, stdout};

/// Percentage of the work that is done; outside 0..100 it is taken as the nearer end.
pub fn progress(percent: f64) {
    print("progress", &format!("{:.1}", percent.clamp(0.0, 100.0)));
}

/// What is being done.
pub fn status(text: &str) {
    print("status", text);
}

/// Why the command fails.
pub fn fail(text: &str) {
    print("fail", text);
}

/// A message is one line, whatever a file's name holds.
fn print(kind: &str, text: &str) {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut out = stdout().lock();
    let _ = out.write_all(format!("openjd_{kind}: {text}\n").as_bytes()).and_then(|()| out.flush());
}
