//! The grammar of frame patterns and lists: examples, and properties over many random texts.

use sspc_frames::error::ErrorKind;
use sspc_frames::sequence::{Frames, MAX_FRAME, MAX_FRAMES, Pattern};
use std::path::{Path, PathBuf};

/// Random texts per property; each is a few microseconds.
const CASES: u64 = 20_000;

/// A small generator, so that a failing case can be run again by its number.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % bound
    }

    fn text(&mut self, alphabet: &[u8], longest: u64) -> String {
        let length = self.below(longest + 1);
        (0..length).map(|_| alphabet[self.below(alphabet.len() as u64) as usize] as char).collect()
    }
}

fn for_random_cases(check: impl Fn(&mut Random)) {
    for case in 1..=CASES {
        check(&mut Random(case.wrapping_mul(0x9E37_79B9_7F4A_7C15)));
    }
}

fn frames(text: &str) -> Vec<i32> {
    text.parse::<Frames>().unwrap_or_else(|error| panic!("{text}: {error}")).as_slice().to_vec()
}

#[test]
fn patterns_by_example() {
    for (text, frame, path) in [
        ("shot.####.exr", 7, "shot.0007.exr"),
        ("shot.%04d.exr", 1001, "shot.1001.exr"),
        ("shot.#.exr", 12345, "shot.12345.exr"),
        ("v%d/shot", 3, "v3/shot"),
        ("100%.##.exr", 5, "100%.05.exr"),
        ("##", 123, "123"),
    ] {
        let pattern: Pattern = text.parse().expect(text);
        assert_eq!(pattern.path(frame), PathBuf::from(path), "{text}");
    }
}

#[test]
fn lists_by_example() {
    assert_eq!(frames("1001-1004"), [1001, 1002, 1003, 1004]);
    assert_eq!(frames("1-12x5"), [1, 6, 11]);
    assert_eq!(frames("1001, 1005-1007"), [1001, 1005, 1006, 1007]);
    assert_eq!(frames("5,1-6,5"), [5, 1, 2, 3, 4, 6]);
    assert_eq!(frames("0"), [0]);
    assert_eq!(frames("7-7x100"), [7]);
    assert_eq!(frames("1001-1010:3"), [1001, 1004, 1007, 1010]);
    assert_eq!(frames("-5"), [-5]);
    assert_eq!(frames("-5--1x2,-2-1"), [-5, -3, -1, -2, 0, 1]);
}

#[test]
fn senseless_texts_are_refused_in_one_line() {
    let patterns = [
        "shot.exr",
        "",
        "%",
        "%4d",
        "a.##.b.##",
        "#%d",
        "%00000000000000000000099d",
        "#################",
        "%0d",
        "%d%d",
    ];
    for text in patterns {
        let error = text.parse::<Pattern>().expect_err(text);
        assert_eq!(error.kind(), ErrorKind::Arguments);
        assert!(!error.to_string().contains('\n'));
    }
    let lists = [
        "",
        ",",
        "1,",
        "a",
        "--5",
        "-",
        "1-5:0",
        "1-5:-1",
        "5-",
        "5-1",
        "1-5x0",
        "1-5x",
        "1x5",
        "1--5",
        "+1",
        "1 2",
        "1-2-3",
        "4294967296",
        "1000000000",
    ];
    for text in lists {
        assert!(text.parse::<Frames>().is_err(), "'{text}'");
    }
}

#[test]
fn absurd_ranges_are_refused_at_once() {
    let start = std::time::Instant::now();
    for text in [format!("0-{MAX_FRAME}"), format!("0-{}", MAX_FRAMES), format!("{},0", vec!["1-1000"; 1001].join(","))]
    {
        let error = text.parse::<Frames>().expect_err("too many");
        assert!(error.to_string().len() < 600, "{}", error.to_string().len());
    }
    assert!(start.elapsed().as_secs() < 1);
    assert_eq!(frames(&format!("0-{}", MAX_FRAMES - 1)).len(), MAX_FRAMES);
    assert_eq!(frames(&format!("0-{MAX_FRAME}x{MAX_FRAME}")), [0, MAX_FRAME]);
}

#[test]
fn a_path_is_its_pattern_around_the_number() {
    for_random_cases(|random| {
        let before = random.text(b"ab./_-%0d", 6);
        let after = random.text(b"ab./_-exr", 6);
        let width = random.below(9) as usize;
        let place = match (random.below(2), width) {
            (0, 0) => "%d".to_string(),
            (0, width) => format!("%0{width}d"),
            (_, width) => "#".repeat(width.max(1)),
        };
        let text = format!("{before}{place}{after}");
        let Ok(pattern) = text.parse::<Pattern>() else {
            // Only a text that holds a second place by chance may be refused.
            assert!(Pattern::is_pattern(&before) || Pattern::is_pattern(&after), "{text}");
            return;
        };
        let frame = random.below(2 * MAX_FRAME as u64 + 1) as i32 - MAX_FRAME;
        let number = format!("{frame:0width$}", width = if place == "%d" { 0 } else { width.max(1) });
        assert_eq!(pattern.path(frame), PathBuf::from(format!("{before}{number}{after}")), "{text} {frame}");
        assert_eq!(pattern.to_string().parse::<Pattern>().expect("shown"), pattern, "{text}");
    });
}

#[test]
fn lists_survive_being_shown_and_read() {
    for_random_cases(|random| {
        let count = 1 + random.below(8);
        let parts: Vec<String> = (0..count)
            .map(|_| {
                let first = random.below(50);
                match random.below(3) {
                    0 => format!("{first}"),
                    1 => format!("{first}-{}", first + random.below(20)),
                    _ => format!("{first}-{}x{}", first + random.below(40), 1 + random.below(7)),
                }
            })
            .collect();
        let text = parts.join(",");
        let list: Frames = text.parse().expect(&text);
        let shown = list.to_string();
        assert_eq!(shown.parse::<Frames>().expect(&shown), list, "{text} shown as {shown}");
        assert!(!list.as_slice().is_empty());
    });
}

#[test]
fn no_text_panics_and_what_is_read_stays_in_bounds() {
    for_random_cases(|random| {
        let text = random.text(b"0123456789-x,# %d.", 24);
        if let Ok(list) = text.parse::<Frames>() {
            assert!(list.as_slice().len() <= MAX_FRAMES && list.into_iter().all(|frame| frame <= MAX_FRAME));
        }
        let _ = text.parse::<Pattern>();
    });
}

/// Ranges over all frame numbers against counting by hand.
#[test]
fn ranges_name_every_step_from_first_to_last() {
    for_random_cases(|random| {
        let bits = 1 + random.below(30);
        let first = random.below(1 << bits).min(MAX_FRAME as u64);
        let last = (first + random.below(1 << bits)).min(MAX_FRAME as u64);
        let step = (1 + random.below(1 << bits)).min(MAX_FRAME as u64);
        let text = format!("{first}-{last}x{step}");
        let count = (last - first) / step + 1;
        match text.parse::<Frames>() {
            Err(_) => assert!(count > MAX_FRAMES as u64, "{text}"),
            Ok(list) => {
                let list = list.as_slice();
                assert_eq!(list.len() as u64, count, "{text}");
                // Long lists are looked at where they could go wrong: at the ends.
                let seen = (0..count.min(50)).chain(count.saturating_sub(50)..count);
                seen.for_each(|i| assert_eq!(list[i as usize] as u64, first + i * step, "{text} {i}"));
            }
        }
    });
}

/// Any numbers in any order, runs of all steps among them.
#[test]
fn any_list_of_numbers_survives_being_shown_and_read() {
    for_random_cases(|random| {
        let mut numbers = Vec::new();
        while (numbers.len() as u64) < 1 + random.below(30) {
            let (start, step) = (random.below(MAX_FRAME as u64) as i32 - 1_000, random.below(4) as i32);
            let run = 1 + random.below(6) as i32;
            let falling = random.below(3) == 0;
            let at = |i: i32| if falling { start - i * step } else { start + i * step };
            numbers.extend((0..run).map(at).filter(|number| *number <= MAX_FRAME));
        }
        let list = Frames::from_numbers(numbers.iter().copied());
        let shown = list.to_string();
        assert_eq!(shown.parse::<Frames>().expect(&shown), list, "{numbers:?} shown as {shown}");
        let mut first_seen: Vec<i32> = Vec::new();
        numbers.iter().for_each(|n| first_seen.extend((!first_seen.contains(n)).then_some(n)));
        assert_eq!(list.as_slice(), first_seen);
    });
}

#[test]
fn patterns_may_hold_any_characters_around_the_number() {
    for text in ["Größe/é.####.exr", "日本.%03d.exr", "a b\t#", "%%0#", "\u{1F600}%d\u{1F600}"] {
        let pattern: Pattern = text.parse().expect(text);
        assert!(pattern.path(42).to_str().is_some_and(|path| path.contains("42")), "{text}");
        assert_eq!(pattern.to_string().parse::<Pattern>().expect(text), pattern);
    }
}

/// Fails when a shot in a folder whose name is not UTF-8 is refused, or its frames are looked for elsewhere.
#[cfg(target_os = "linux")]
#[test]
fn a_pattern_may_lie_in_a_folder_that_is_not_utf8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = Path::new(std::ffi::OsStr::from_bytes(b"/shots/caf\xe9"));
    let pattern = Pattern::of_path(&folder.join("a.####.exr")).expect("a pattern");
    assert_eq!(pattern.path(7), folder.join("a.0007.exr"));
    let odd = Path::new(std::ffi::OsStr::from_bytes(b"caf\xe9.####.exr"));
    assert!(Pattern::of_path(odd).is_err_and(|error| error.to_string().contains("UTF-8")));
}
