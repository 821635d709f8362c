//! Marks of halves inside names. They mean something only where one file holds both halves: between two files, a letter at
//! the end of a name is a part of the name.

use sspc_image::Buffer;

/// Takes the mark of a half out of a layer path: `albedo.even` is `albedo` of half a.
///
/// Marks: a segment `even`, `odd`, `a` or `b`; an ending or beginning `even`/`odd` or an ending `a`/`b` set off
/// by `_`, `-` or a space; an ending capital `A` or `B` after a small letter or digit (`albedoA`, but not `RGBA`).
/// Returns the path without the mark, in its own case.
pub fn split_half(path: &str) -> (String, Option<Buffer>) {
    let segments: Vec<&str> = if path.is_empty() { Vec::new() } else { path.split('.').collect() };
    for (i, segment) in segments.iter().enumerate() {
        if let Some((rest, half)) = segment_half(segment) {
            let kept = segments[..i].iter().copied().chain(Some(rest).filter(|rest| !rest.is_empty()));
            let kept: Vec<&str> = kept.chain(segments[i + 1..].iter().copied()).collect();
            return (kept.join("."), Some(half));
        }
    }
    (path.to_string(), None)
}

fn segment_half(segment: &str) -> Option<(&str, Buffer)> {
    const MARKS: [(&str, Buffer); 4] = [("even", Buffer::A), ("odd", Buffer::B), ("a", Buffer::A), ("b", Buffer::B)];
    let separator = |c: char| matches!(c, '_' | '-' | ' ');
    for (mark, half) in MARKS {
        if segment.eq_ignore_ascii_case(mark) {
            return Some(("", half));
        }
        if let Some(rest) = strip_suffix_ignoring_case(segment, mark)
            && rest.ends_with(separator)
        {
            return Some((&rest[..rest.len() - 1], half));
        }
        if mark.len() > 1
            && let Some(rest) = segment.get(..mark.len()).filter(|head| head.eq_ignore_ascii_case(mark))
            && segment[rest.len()..].starts_with(separator)
        {
            return Some((&segment[rest.len() + 1..], half));
        }
    }
    let (half, rest) = match (segment.strip_suffix('A'), segment.strip_suffix('B')) {
        (Some(rest), _) => (Buffer::A, rest),
        (_, Some(rest)) => (Buffer::B, rest),
        _ => return None,
    };
    rest.ends_with(|c: char| c.is_ascii_lowercase() || c.is_ascii_digit()).then_some((rest, half))
}

fn strip_suffix_ignoring_case<'a>(text: &'a str, suffix: &str) -> Option<&'a str> {
    let at = text.len().checked_sub(suffix.len())?;
    let tail = text.get(at..)?;
    tail.eq_ignore_ascii_case(suffix).then(|| &text[..at])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_halves_are_found_and_look_alikes_are_not() {
        let a = Some(Buffer::A);
        let b = Some(Buffer::B);
        for (path, rest, half) in [
            ("albedoA", "albedo", a),
            ("randImgB", "randImg", b),
            ("albedo.even", "albedo", a),
            ("odd.albedo", "albedo", b),
            ("Ci_odd", "Ci", b),
            ("even_Ci", "Ci", a),
            ("beauty_a", "beauty", a),
            ("a", "", a),
            ("RGBA", "RGBA", None),
            ("rgba", "rgba", None),
            ("", "", None),
            ("camera", "camera", None),
            ("ViewLayer.Combined", "ViewLayer.Combined", None),
            ("evening", "evening", None),
            ("éA", "éA", None),
        ] {
            assert_eq!(split_half(path), (rest.to_string(), half), "{path}");
        }
    }
}
