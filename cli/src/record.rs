//! What reports and pictures record of how they came about.

use crate::output::role_name;
use serde::Serialize;
use sspc_frames::samples::{HalfSamples, SamplesSource};
use sspc_image::{RoleSource, shown};
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

/// The samples of each half, and what they weigh in means of both.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SamplesReport {
    /// Samples per pixel of half a and of half b, where they are known.
    pub counts: Option<[f64; 2]>,
    /// Who says so: arguments, pass, metadata, or none.
    pub source: &'static str,
    /// The attribute of half a's file, where metadata says so.
    pub attribute: Option<String>,
    /// What the halves weigh.
    pub weights: [f32; 2],
}

impl From<&HalfSamples> for SamplesReport {
    fn from(samples: &HalfSamples) -> Self {
        let (source, attribute) = match &samples.source {
            SamplesSource::User => ("arguments", None),
            SamplesSource::Pass => ("pass", None),
            SamplesSource::Metadata(name) => ("metadata", Some(name.clone())),
            SamplesSource::Nobody => ("none", None),
        };
        let weights = samples.weights();
        Self { counts: samples.counts, source, attribute, weights: [weights.of(0), weights.of(1)] }
    }
}

/// What the halves weigh and who says so, as a line.
pub fn samples_line(samples: &HalfSamples) -> String {
    let SamplesReport { counts, attribute, weights: [a, b], .. } = samples.into();
    let who = match &samples.source {
        SamplesSource::User => "--samples-a, --samples-b".to_string(),
        SamplesSource::Pass => "mean of the pass Debug Sample Count".to_string(),
        SamplesSource::Metadata(_) => format!("metadata {}", shown(&attribute.unwrap_or_default())),
        SamplesSource::Nobody => "not in the files: taken as equal".to_string(),
    };
    let counts = counts.map_or("unknown".to_string(), |[a, b]| format!("{} + {}", rounded(a), rounded(b)));
    format!("  samples of half a + half b: {counts} ({who}); weights {a:.3} + {b:.3}")
}

/// A count with no more digits than it needs.
fn rounded(count: f64) -> String {
    let tenths = (10.0 * count).round() / 10.0;
    tenths.to_string()
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
