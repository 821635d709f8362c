//! The list of channels of a part, as it is in the file.

use super::fault::Fault;
use super::part::text_of;
use exr::meta::attribute::SampleType;
use sspc_image::shown;

/// One channel of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelEntry {
    /// The name as in the file.
    pub name: Vec<u8>,
    pub kind: SampleType,
    /// A hint for lossy methods, whether to quantise linearly, and three unused bytes, as in the file.
    hint: [u8; 4],
    /// Pixels per sample, in x and y.
    pub sampling: (i32, i32),
}

impl ChannelEntry {
    /// A new channel of floats in every pixel.
    pub fn new(name: &[u8], kind: SampleType) -> Self {
        Self { name: name.to_vec(), kind, hint: [0; 4], sampling: (1, 1) }
    }

    /// Whether lossy methods should quantise linearly.
    pub fn is_linear(&self) -> bool {
        self.hint[0] != 0
    }

    /// The name, for comparisons and messages.
    pub fn text(&self) -> String {
        text_of(&self.name)
    }

    pub fn shown_name(&self) -> String {
        shown(&self.text())
    }
}

/// Reads the value of an attribute of type `chlist`.
///
/// # Errors
/// [`Fault`]: a list that ends too soon, unknown types of samples, names that occur twice.
pub fn parse_channels(bytes: &[u8]) -> Result<Vec<ChannelEntry>, Fault> {
    let wrong = || Fault::damaged("a broken list of channels");
    let mut channels: Vec<ChannelEntry> = Vec::new();
    let mut rest = bytes;
    loop {
        let end = rest.iter().position(|&byte| byte == 0).ok_or_else(wrong)?;
        let (name, after) = (&rest[..end], &rest[end + 1..]);
        if name.is_empty() {
            break;
        }
        let (fields, after) = after.split_first_chunk::<16>().ok_or_else(wrong)?;
        let number = |at: usize| i32::from_le_bytes([fields[at], fields[at + 1], fields[at + 2], fields[at + 3]]);
        let kind = match number(0) {
            0 => SampleType::U32,
            1 => SampleType::F16,
            2 => SampleType::F32,
            _ => return Err(wrong()),
        };
        let (hint, sampling) = ([fields[4], fields[5], fields[6], fields[7]], (number(8), number(12)));
        if sampling.0 < 1 || sampling.1 < 1 {
            return Err(wrong());
        }
        channels.push(ChannelEntry { name: name.to_vec(), kind, hint, sampling });
        rest = after;
    }
    let mut names: Vec<&[u8]> = channels.iter().map(|channel| channel.name.as_slice()).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(Fault::damaged(format!("two channels {}", shown(&text_of(pair[0]))))),
        None => Ok(channels),
    }
}

/// The value of an attribute of type `chlist`.
pub fn channel_bytes(channels: &[ChannelEntry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for channel in channels {
        let kind: i32 = match channel.kind {
            SampleType::U32 => 0,
            SampleType::F16 => 1,
            SampleType::F32 => 2,
        };
        bytes.extend_from_slice(&channel.name);
        bytes.push(0);
        bytes.extend_from_slice(&kind.to_le_bytes());
        bytes.extend_from_slice(&channel.hint);
        bytes.extend_from_slice(&channel.sampling.0.to_le_bytes());
        bytes.extend_from_slice(&channel.sampling.1.to_le_bytes());
    }
    bytes.push(0);
    bytes
}
