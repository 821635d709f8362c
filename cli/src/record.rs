//! What reports and pictures record of how they came about.

use crate::output::role_name;
use serde::Serialize;
use sspc_image::RoleSource;
use std::path::Path;

/// Which channels filled which role.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FilledRole {
    /// As messages call it.
    pub role: String,
    /// Of which samples.
    pub buffer: String,
    /// Their file.
    pub file: String,
    /// Full channel names, in component order.
    pub channels: Vec<String>,
}

impl From<&RoleSource> for FilledRole {
    fn from(source: &RoleSource) -> Self {
        FilledRole {
            role: role_name(source),
            buffer: source.buffer.to_string(),
            file: shown_path(&source.path),
            channels: source.channels.clone(),
        }
    }
}

/// A path as text, for JSON and attributes: what is not UTF-8 in it is replaced.
pub fn shown_path(path: &Path) -> String {
    path.display().to_string()
}

/// How a picture was made, for its attributes: the program, what it says of itself, strength and fallback.
pub fn provenance(tool: &str, own: &[(&str, String)], strength: f32, fallback: Option<&str>) -> Vec<(String, String)> {
    let tool = [("sspc.tool", format!("{tool} {}", env!("CARGO_PKG_VERSION")))];
    let rest = [("sspc.strength", strength.to_string()), ("sspc.fallback", fallback.unwrap_or("none").to_string())];
    let all = tool.iter().chain(own).chain(&rest);
    all.map(|(key, value)| (key.to_string(), value.clone())).collect()
}

/// Most memory this process has held, where the system tells (Linux).
pub fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}
