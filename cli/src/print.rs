//! Lines that never end the work.

use std::io::{Write, stderr};

/// A line on standard error. Where nobody reads it any more (a closed pipe, a full disk), the work goes on:
/// `eprintln!` would end it with a panic.
pub fn print_line(line: &str) {
    let _ = stderr().write_all(format!("{line}\n").as_bytes());
}
