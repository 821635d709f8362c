//! How many samples each half has: the user's word, else a pass that counts them, else what renderers stamp into headers.

use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::resolve::{Filled, Resolution};
use sspc_image::{Buffer, HalfWeights, Role};

/// Most samples per pixel that are believed.
pub const MOST_SAMPLES: u32 = 1 << 24;
/// Largest ratio of the halves' samples: y of fewer says nothing about the other half.
pub const LARGEST_RATIO: f64 = 256.0;
/// Layer in which Cycles counts the samples of each pixel, as a share of those that were asked for.
const COUNT_LAYER: &str = "Debug Sample Count";
/// Rows that are read at a time.
const ROWS: usize = 256;

/// Attributes that hold the samples per pixel. Mitsuba and V-Ray (of whose files `vrayInfo/...` was seen) write none, and
/// nothing is known of others.
const ATTRIBUTES: [Stamp; 3] = [
    // Blender, intern/cycles/blender/session.cpp, `stamp_view_layer_metadata`; text. LAYER is the view layer.
    Stamp { before: "cycles.", after: Some(".samples") },
    // pbrt-v4, src/pbrt/util/image.cpp, `ImageMetadata::samplesPerPixel`; int.
    Stamp { before: "samplesPerPixel", after: None },
    // Iray for Maya, as seen in headers of its files; int.
    Stamp { before: "IFM_iterations", after: None },
];

/// Names of an attribute: `before`, or `before`LAYER`after`.
struct Stamp {
    before: &'static str,
    after: Option<&'static str>,
}

/// Who says how many samples the halves have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SamplesSource {
    /// The user.
    User,
    /// A pass that counts them: its mean over the frame.
    Pass,
    /// The attribute of this name in the header of half a, and one like it in that of half b.
    Metadata(String),
    /// Nobody.
    Nobody,
}

/// Samples per pixel of half a and of half b.
#[derive(Clone, Debug, PartialEq)]
pub struct HalfSamples {
    /// `None` where nobody says.
    pub counts: Option<[f64; 2]>,
    /// Who says so.
    pub source: SamplesSource,
}

/// What a header says.
struct Found {
    stamp: usize,
    name: String,
    count: f64,
}

impl HalfSamples {
    /// Halves of which nobody says anything.
    pub const UNKNOWN: Self = Self { counts: None, source: SamplesSource::Nobody };

    /// What is known of a frame's halves, and notes on what is not believed.
    ///
    /// # Errors
    /// A pass of sample counts that cannot be decoded.
    pub(crate) fn of(user: Option<[u32; 2]>, resolution: &Resolution) -> Result<(Self, Vec<String>), Error> {
        if let Some(samples) = user {
            let known = Self { counts: Some(samples.map(f64::from)), source: SamplesSource::User };
            return Ok((known, Vec::new()));
        }
        let noisy = [Buffer::A, Buffer::B].map(|buffer| resolution.get(Role::Radiance, buffer));
        let [Some(a), Some(b)] = noisy else { return Ok((Self::UNKNOWN, Vec::new())) };
        let halves = [a, b].map(|noisy| (&resolution.files[noisy.file], noisy));
        let stamped = halves.map(|(file, noisy)| stamped(file, noisy));
        let asked_for = both(stamped.each_ref().map(|found| found.as_ref().map(|found| found.count)));
        let [counted_a, counted_b] = halves.map(|(file, noisy)| counted(file, noisy));
        let mut notes = Vec::new();
        if let Some(counts) = both([counted_a?, counted_b?]).and_then(|counted| in_samples(counted, asked_for)) {
            match implausible(counts) {
                None => return Ok((Self { counts: Some(counts), source: SamplesSource::Pass }, notes)),
                Some(why) => notes.push(format!("the pass {COUNT_LAYER} is not believed: {why}")),
            }
        }
        let [Some(a), Some(b)] = stamped else { return Ok((Self::UNKNOWN, notes)) };
        let counts = [a.count, b.count];
        match implausible(counts) {
            _ if a.stamp != b.stamp => Ok((Self::UNKNOWN, notes)),
            None => Ok((Self { counts: Some(counts), source: SamplesSource::Metadata(a.name) }, notes)),
            Some(why) => {
                notes.push(format!("the attribute {} is not believed: {why}", sspc_image::shown(&a.name)));
                Ok((Self::UNKNOWN, notes))
            }
        }
    }

    /// What each half weighs in means of both.
    pub fn weights(&self) -> HalfWeights {
        self.counts.map_or(HalfWeights::EQUAL, HalfWeights::of_samples)
    }
}

fn both([a, b]: [Option<f64>; 2]) -> Option<[f64; 2]> {
    a.zip(b).map(|(a, b)| [a, b])
}

/// Why counts are no samples per pixel of two halves, if so.
pub fn implausible(counts: [f64; 2]) -> Option<String> {
    let most = f64::from(MOST_SAMPLES);
    for (count, half) in counts.into_iter().zip(["a", "b"]) {
        if !(1.0..=most).contains(&count) {
            return Some(format!("half {half} has {count} samples (expected 1 to {MOST_SAMPLES})"));
        }
    }
    let [a, b] = counts;
    let ratio = (a / b).max(b / a);
    (ratio > LARGEST_RATIO)
        .then(|| format!("halves of {a} and {b} samples (expected at most {LARGEST_RATIO} times as many in one)"))
}

/// The samples that a header names for the layer of the noisy colour.
fn stamped(file: &ExrFile, noisy: &Filled) -> Option<Found> {
    let channel = &file.channels[noisy.channels[0]];
    let parts = &file.container.parts;
    // Some writers stamp the first part only.
    let of_parts = || std::iter::once(&parts[channel.part]).chain(parts);
    ATTRIBUTES.iter().enumerate().find_map(|(stamp, Stamp { before, after })| {
        of_parts().find_map(|part| {
            let attributes = || {
                part.header.attributes.iter().filter_map(|attribute| {
                    let name = std::str::from_utf8(&attribute.name).ok()?;
                    let layer = match after {
                        Some(after) => name.strip_prefix(before)?.strip_suffix(after)?,
                        None => (name == *before).then_some("")?,
                    };
                    let count = number(&attribute.kind, &attribute.value)?;
                    Some((layer, Found { stamp, name: name.to_string(), count }))
                })
            };
            let own = |layer: &str| channel.name.strip_prefix(layer).is_some_and(|rest| rest.starts_with('.'));
            let of_layer = attributes().find(|(layer, _)| !layer.is_empty() && own(layer));
            // A file of one layer need not name it.
            let found = of_layer.or_else(|| if attributes().count() == 1 { attributes().next() } else { None });
            found.map(|(_, found)| found)
        })
    })
}

/// An attribute's value as a number, where its type has one.
fn number(kind: &[u8], value: &[u8]) -> Option<f64> {
    match kind {
        b"string" => std::str::from_utf8(value).ok()?.trim().parse().ok(),
        b"int" => Some(f64::from(i32::from_le_bytes(value.try_into().ok()?))),
        b"float" => Some(f64::from(f32::from_le_bytes(value.try_into().ok()?))),
        b"double" => Some(f64::from_le_bytes(value.try_into().ok()?)),
        _ => None,
    }
}

/// Mean of a half's pass of sample counts over its pixels.
fn counted(file: &ExrFile, noisy: &Filled) -> Result<Option<f64>, Error> {
    let colour = &file.channels[noisy.channels[0]].name;
    let is_count = |name: &str| {
        name.rsplit_once('.').is_some_and(|(layer, _)| {
            layer.strip_suffix(COUNT_LAYER).is_some_and(|before| before.is_empty() || before.ends_with('.'))
        })
    };
    let counts = || file.channels.iter().enumerate().filter(|(_, channel)| is_count(&channel.name));
    let shared = |name: &str| name.bytes().zip(colour.bytes()).take_while(|(p, q)| p == q).count();
    // Of several view layers, the one whose name begins as the colour's.
    let Some((at, channel)) = counts().max_by_key(|(_, channel)| shared(&channel.name)) else { return Ok(None) };
    let (mut sum, mut pixels) = (0.0, 0.0);
    for top in (0..channel.window.height).step_by(ROWS) {
        let rows = channel.window.rows(top..(top + ROWS).min(channel.window.height));
        for image in file.windows(&[(vec![at], rows)])? {
            for value in image.data().iter().filter(|value| value.is_finite()) {
                sum += f64::from(*value);
                pixels += 1.0;
            }
        }
    }
    Ok((sum > 0.0).then(|| sum / pixels))
}

/// Counts of a pass in samples: as a share of what was `asked_for`, or as they are where they are more than one.
fn in_samples(counted: [f64; 2], asked_for: Option<[f64; 2]>) -> Option<[f64; 2]> {
    if counted.iter().all(|count| *count > 1.0) {
        return Some(counted);
    }
    let asked_for = asked_for.filter(|_| counted.iter().all(|count| *count <= 1.0))?;
    Some([0, 1].map(|h| counted[h] * asked_for[h]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_read_as_its_type_says() {
        assert_eq!(number(b"string", b" 128 "), Some(128.0));
        assert_eq!(number(b"int", &64i32.to_le_bytes()), Some(64.0));
        assert_eq!(number(b"float", &1.5f32.to_le_bytes()), Some(1.5));
        assert_eq!(number(b"double", &2.5f64.to_le_bytes()), Some(2.5));
        for (kind, value) in [(&b"string"[..], &b"many"[..]), (b"int", b"\x01"), (b"box2i", b"\x01\0\0\0")] {
            assert_eq!(number(kind, value), None);
        }
    }

    #[test]
    fn what_no_half_can_have_is_not_believed() {
        assert_eq!(implausible([32.0, 8.0]), None);
        for counts in [[0.0, 8.0], [8.0, -1.0], [f64::NAN, 8.0], [1e9, 1e9], [4096.0, 8.0]] {
            assert!(implausible(counts).is_some(), "{counts:?}");
        }
    }

    #[test]
    fn a_pass_of_shares_needs_to_know_of_what() {
        assert_eq!(in_samples([0.5, 1.0], Some([64.0, 8.0])), Some([32.0, 8.0]));
        assert_eq!(in_samples([0.5, 1.0], None), None);
        assert_eq!(in_samples([33.5, 8.0], None), Some([33.5, 8.0]));
        assert_eq!(in_samples([33.5, 0.5], Some([64.0, 8.0])), None);
    }
}
