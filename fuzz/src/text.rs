//! Arguments: lists of frames, file patterns, overrides of roles.

use super::assert_one_line;
use sspc_frames::RoleOverrides;
use sspc_frames::error::ErrorKind;
use sspc_frames::sequence::{Frames, MAX_FRAME, MAX_FRAMES, Pattern};
use std::fmt::{Debug, Display};
use std::str::FromStr;

/// Frame numbers that have caused trouble somewhere: the ends, and one more digit than before.
const FRAMES: [i32; 9] = [-MAX_FRAME, -5, 0, 9, 10, 999, 1001, 10_000, MAX_FRAME];

/// Lists longer than this are not shown and read again.
const LONG_LIST: usize = 10_000;

/// Reads the bytes as text in every way; whether any of them accepts it.
pub fn read(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let frames = parsed::<Frames>(text);
    if let Some(frames) = &frames {
        let list = frames.as_slice();
        assert!((1..=MAX_FRAMES).contains(&list.len()) && list.iter().all(|frame| frame.abs() <= MAX_FRAME));
        // Half a million numbers are told in milliseconds, but a fuzzer has better uses for them.
        if list.len() <= LONG_LIST {
            assert_same_when_shown(frames);
        }
    }
    let pattern = parsed::<Pattern>(text);
    if let Some(pattern) = &pattern {
        assert_same_when_shown(pattern);
        assert!(Pattern::is_pattern(text), "{text:?} is read as a pattern");
        for frame in FRAMES {
            assert!(pattern.path(frame).to_string_lossy().contains(&frame.abs().to_string()), "{text:?} {frame}");
        }
    }
    let overrides = parsed::<RoleOverrides>(text);
    overrides.iter().for_each(|overrides| assert!(overrides.files().len() <= 2, "one source for one or both halves"));
    frames.is_some() || pattern.is_some() || overrides.is_some()
}

fn parsed<T: FromStr<Err = sspc_frames::error::Error>>(text: &str) -> Option<T> {
    text.parse()
        .inspect_err(|error: &sspc_frames::error::Error| {
            assert_one_line(error);
            assert_eq!(error.kind(), ErrorKind::Arguments);
        })
        .ok()
}

fn assert_same_when_shown<T: FromStr + Display + PartialEq + Debug>(value: &T) {
    let shown = value.to_string();
    assert!(shown.parse::<T>().is_ok_and(|again| again == *value), "{shown:?}");
}
