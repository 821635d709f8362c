//! What a header may claim, before anything of that size is allocated.

use super::fault::Fault;
use super::part::Part;
use crate::window::Window;
use exr::compression::Compression;

/// Largest width or height: four times 16K.
pub const MAX_SIDE: usize = 65_536;
/// Farthest from the origin that pixels may lie.
const MAX_POSITION: u32 = 1 << 30;
/// Most pixels of one part: eight 8K frames.
const MAX_PIXELS: usize = 1 << 28;
/// Most channels of a file; production files with many light groups have some hundreds.
const MAX_CHANNELS: usize = 4_096;
/// Deflate cannot shrink more than 1032 times, nor can the simpler methods.
const MAX_RATIO_DEFLATE: u64 = 1_100;
/// Wavelets and DWA of a constant picture can shrink more.
const MAX_RATIO_OTHER: u64 = 65_536;
/// Small files may claim this much whatever the ratio, in bytes.
const ALWAYS_ALLOWED: u64 = 1 << 26;

/// Refuses a window without pixels or with too many.
pub fn check_window(window: Window) -> Result<(), Fault> {
    let Window { left, top, width, height } = window;
    if width == 0 || height == 0 {
        return Err(Fault::Unsupported { expected: "at least one pixel", found: format!("{width}x{height}") });
    }
    if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_PIXELS {
        return Err(Fault::TooLarge {
            expected: format!("at most {MAX_SIDE} pixels a side and {MAX_PIXELS} in all"),
            found: format!("{width}x{height}"),
        });
    }
    match left.unsigned_abs().max(top.unsigned_abs()) > MAX_POSITION {
        true => Err(Fault::damaged(format!("pixels at ({left}, {top})"))),
        false => Ok(()),
    }
}

/// Refuses parts that a file of `length` bytes cannot hold.
pub fn check_claims(parts: &[Part], length: u64) -> Result<(), Fault> {
    let channels: usize = parts.iter().map(|part| part.channels.len()).sum();
    if channels > MAX_CHANNELS {
        let expected = format!("at most {MAX_CHANNELS} channels");
        return Err(Fault::TooLarge { expected, found: format!("{channels}") });
    }
    let mut possible = ALWAYS_ALLOWED;
    let (mut claimed, mut chunks) = (0u64, 0u64);
    for part in parts {
        chunks = chunks.saturating_add(part.chunks as u64);
        if part.undecodable().is_some() {
            continue;
        }
        let pixels = (part.window.width * part.window.height) as u64;
        claimed = claimed.saturating_add(pixels * part.bytes_per_pixel() as u64);
        let ratio = match part.method() {
            Some(Compression::PIZ | Compression::DWAA(_) | Compression::DWAB(_)) => MAX_RATIO_OTHER,
            _ => MAX_RATIO_DEFLATE,
        };
        possible = possible.max(length.saturating_mul(ratio));
    }
    if claimed > possible || chunks.saturating_mul(8) > length {
        return Err(Fault::TooLarge {
            expected: format!("what a file of {length} bytes can hold"),
            found: format!("{claimed} bytes of pixels in {chunks} chunks"),
        });
    }
    Ok(())
}
