//! Frame numbers in file names, and lists of frames.
//!
//! ```text
//! pattern := any text with one place for the frame number
//! place   := "#"+          as many digits at least as there are signs: shot.####.exr
//!          | "%0" N "d"    N digits at least: shot.%04d.exr
//!          | "%d"          no padding
//! frames  := range ("," range)*
//! range   := N | N "-" M | N "-" M ("x" | ":") S     every S-th frame from N, at most M; `:` is OpenJD's form
//! ```
//! Frame numbers are -999 999 999 to 999 999 999 (`-5--1` are five frames, `%04d` of -5 is `-005`, as in C); a list may name
//! a frame twice, it is kept once, in the order first named.

use crate::error::Error;
use sspc_image::shown;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Largest frame number; its negative is the smallest.
pub const MAX_FRAME: i32 = 999_999_999;
/// Most frames of one list: a feature film has about 200 000.
pub const MAX_FRAMES: usize = 1_000_000;
/// Widest padding.
const MAX_DIGITS: usize = 16;

/// A file name with a place for the frame number.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Pattern {
    /// A folder that is not UTF-8, which the rest of the name lies in; mostly empty.
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// Whether a text has a place for a frame number, that is, is meant as a pattern.
    pub fn is_pattern(text: &str) -> bool {
        text.contains('#') || find_percent(text).is_some()
    }

    /// The pattern of a path, which may lie in a folder whose name is not UTF-8.
    ///
    /// # Errors
    /// [`Error::Pattern`] without a place for the frame number, with more than one, or with a file name that is not UTF-8.
    pub fn of_path(path: &Path) -> Result<Self, Error> {
        if let Some(text) = path.to_str() {
            return text.parse();
        }
        let name = path.file_name().and_then(|name| name.to_str()).ok_or_else(|| Error::Pattern {
            text: shown(&path.display().to_string()),
            expected: "a file name in UTF-8".to_string(),
            found: "other bytes".to_string(),
        })?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Ok(Self { folder, ..name.parse()? })
    }

    /// The file of one frame.
    pub fn path(&self, frame: i32) -> PathBuf {
        let width = self.digits;
        self.folder.join(format!("{}{frame:0width$}{}", self.before, self.after))
    }
}

impl FromStr for Pattern {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = |found: &str| Error::Pattern {
            text: shown(text),
            expected: "one place for the frame number, #### or %04d".to_string(),
            found: found.to_string(),
        };
        let hashes = text.find('#').map(|start| {
            let digits = text[start..].bytes().take_while(|byte| *byte == b'#').count();
            (start, digits, digits)
        });
        let (start, length, digits) = match (hashes, find_percent(text)) {
            (Some(place), None) | (None, Some(place)) => place,
            (Some(_), Some(_)) => return Err(wrong("both forms")),
            (None, None) => return Err(wrong("none")),
        };
        if digits > MAX_DIGITS {
            return Err(wrong(&format!("{digits} digits")));
        }
        let (before, after) = (text[..start].to_string(), text[start + length..].to_string());
        if Self::is_pattern(&after) {
            return Err(wrong("more than one"));
        }
        Ok(Self { folder: PathBuf::new(), before, digits, after })
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.folder.as_os_str().is_empty() {
            write!(out, "{}/", self.folder.display())?;
        }
        match self.digits {
            0 => write!(out, "{}%d{}", self.before, self.after),
            digits => write!(out, "{}{}{}", self.before, "#".repeat(digits), self.after),
        }
    }
}

/// Start, length and digits of the first `%d` or `%0Nd`.
fn find_percent(text: &str) -> Option<(usize, usize, usize)> {
    text.match_indices('%').find_map(|(start, _)| {
        let rest = &text[start + 1..];
        if rest.starts_with('d') {
            return Some((start, 2, 0));
        }
        let width: String = rest.strip_prefix('0')?.chars().take_while(char::is_ascii_digit).collect();
        let ends = rest[1 + width.len()..].starts_with('d');
        // A width too long to parse is too wide, which the caller refuses.
        let digits = width.parse().unwrap_or(usize::MAX);
        (ends && !width.is_empty()).then_some((start, width.len() + 3, digits))
    })
}

/// Frames in the order they were named, each once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frames {
    list: Vec<i32>,
}

impl Frames {
    /// The frame numbers, at least one.
    pub fn as_slice(&self) -> &[i32] {
        &self.list
    }

    /// Frames from a list of numbers, duplicates dropped.
    pub fn from_numbers(numbers: impl IntoIterator<Item = i32>) -> Self {
        let mut seen = std::collections::HashSet::new();
        Self { list: numbers.into_iter().filter(|number| seen.insert(*number)).collect() }
    }
}

impl<'a> IntoIterator for &'a Frames {
    type Item = i32;
    type IntoIter = std::iter::Copied<std::slice::Iter<'a, i32>>;

    fn into_iter(self) -> Self::IntoIter {
        self.list.iter().copied()
    }
}

impl FromStr for Frames {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let mut ranges = Vec::new();
        let mut total = 0usize;
        for part in text.split(',') {
            let range = parse_range(text, part.trim())?;
            total = total.saturating_add(range.count());
            if total > MAX_FRAMES {
                return Err(wrong_frames(text, &format!("at most {MAX_FRAMES} frames"), "more"));
            }
            ranges.push(range);
        }
        Ok(Self::from_numbers(ranges.into_iter().flat_map(|range| (range.first..=range.last).step_by(range.step))))
    }
}

impl fmt::Display for Frames {
    /// The shortest list of single frames and runs that names the same frames in the same order.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.list.as_slice();
        let mut separator = "";
        while let [first, ..] = rest {
            let run = run_length(rest);
            let last = rest[run - 1];
            match run {
                1 => write!(out, "{separator}{first}")?,
                _ if last - first == run as i32 - 1 => write!(out, "{separator}{first}-{last}")?,
                _ => write!(out, "{separator}{first}-{last}x{}", rest[1] - first)?,
            }
            separator = ",";
            rest = &rest[run..];
        }
        Ok(())
    }
}

/// How many frames from the start have one step; two frames make a run only when they follow each other.
fn run_length(list: &[i32]) -> usize {
    let rises = |pair: &[i32]| Some(pair[1] - pair[0]).filter(|step| *step > 0);
    let Some(step) = list.get(..2).and_then(rises) else { return 1 };
    let run = 1 + list.windows(2).take_while(|pair| rises(pair) == Some(step)).count();
    if run == 2 && step > 1 { 1 } else { run }
}

struct Range {
    first: i32,
    last: i32,
    step: usize,
}

impl Range {
    fn count(&self) -> usize {
        (self.last - self.first) as usize / self.step + 1
    }
}

fn wrong_frames(text: &str, expected: &str, found: &str) -> Error {
    Error::Pattern { text: shown(text), expected: expected.to_string(), found: shown(found) }
}

/// Digits with or without a minus sign, nothing else.
fn frame_number(text: &str) -> Option<i32> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    text.parse::<i32>().ok().filter(|number| plain && number.abs() <= MAX_FRAME)
}

fn parse_range(text: &str, part: &str) -> Result<Range, Error> {
    let number = |digits: &str| {
        let expected = format!("frame numbers from -{MAX_FRAME} to {MAX_FRAME}");
        frame_number(digits).ok_or_else(|| wrong_frames(text, &expected, &format!("'{digits}'")))
    };
    // A minus sign at the start belongs to the number.
    let dash = part.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(at, _)| at);
    let Some(dash) = dash else {
        let frame = number(part)?;
        return Ok(Range { first: frame, last: frame, step: 1 });
    };
    let (first, rest) = (&part[..dash], &part[dash + 1..]);
    let (last, step) = match rest.split_once(['x', ':']) {
        Some((last, step)) => (number(last)?, number(step)?),
        None => (number(rest)?, 1),
    };
    let first = number(first)?;
    let step = match usize::try_from(step) {
        Ok(step @ 1..) => step,
        _ => return Err(wrong_frames(text, "a step of at least 1", &format!("a step of {step}"))),
    };
    if last < first {
        return Err(wrong_frames(text, "a range that rises", &format!("'{part}'")));
    }
    Ok(Range { first, last, step })
}
