//! The names that renderers give to the roles, compared without regard to case.

use sspc_image::{Buffer, Role};
use std::fmt;

/// How a layer's name is recognised. Names are lower-case and match whole segments from the end:
/// `Whole("combined")` matches `Combined` and `ViewLayer.Combined`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    Whole(&'static str),
    /// The last segment starts with this.
    Starts(&'static str),
    /// The last segment ends with this.
    Ends(&'static str),
}

use Pattern::{Ends, Starts, Whole};

/// Cycles' noisy picture; where it is present, `Combined` is the denoised one.
pub const NOISY_IMAGE: Pattern = Whole("noisy image");
/// Cycles' picture.
pub const COMBINED: Pattern = Whole("combined");

/// First hit wins, so the order is from the surest to the vaguest. The empty name is the root layer.
const RADIANCE: &[Pattern] = &[
    NOISY_IMAGE,
    Whole(""),
    COMBINED,
    Whole("beauty"),
    Whole("rgba"),
    Whole("rgb"),
    Whole("c"),
    Whole("ci"),
    Whole("default"),
    Whole("color"),
    Whole("colour"),
    Whole("radiance"),
    Whole("randimg"),
];
const DENOISED: &[Pattern] = &[
    Whole("denoised"),
    Whole("vraydenoiser"),
    Whole("denoiser"),
    Whole("effectsresult"),
    Ends("_denoised"),
    Ends("_filtered"),
    Starts("denoimg"),
];
const ALBEDO: &[Pattern] = &[
    Whole("denoising albedo"),
    Whole("albedo"),
    Whole("denoise_albedo_noice"),
    Whole("denoise_albedo"),
    Whole("diffuse_albedo"),
    Whole("diffcol"),
    Whole("visiblediffuse"),
];
const NORMAL: &[Pattern] = &[
    Whole("denoising normal"),
    Whole("normal"),
    Whole("ns"),
    Whole("n"),
    Whole("nn"),
    Whole("n_noice"),
    Whole("sh_normal"),
    Whole("avg_shading_normal"),
    Whole("normals"),
    Whole("visiblenormals"),
    Whole("optixnormals"),
];
const VISIBILITY: &[Pattern] = &[Whole("visibility")];

/// The names a role goes by, first hit wins.
///
/// For [`Role::Denoised`], [`COMBINED`] comes first where the file has [`NOISY_IMAGE`].
pub fn candidates(role: Role) -> &'static [Pattern] {
    match role {
        Role::Radiance => RADIANCE,
        Role::Denoised => DENOISED,
        Role::Albedo => ALBEDO,
        Role::Normal => NORMAL,
        Role::Visibility => VISIBILITY,
    }
}

/// The component endings of a role, best first; each is a full set.
pub fn component_sets(role: Role) -> &'static [&'static [&'static str]] {
    match role {
        Role::Visibility => &[&["y"], &["v"], &["r"], &["x"], &["red"], &["l"]],
        _ => &[&["r", "g", "b"], &["red", "green", "blue"], &["x", "y", "z"]],
    }
}

/// Channels of a role: 3, or 1 for visibility.
pub fn component_count(role: Role) -> usize {
    if role == Role::Visibility { 1 } else { 3 }
}

impl Pattern {
    /// Whether the lower-case layer path `base` goes by this name.
    pub fn matches(self, base: &str) -> bool {
        let last = base.rsplit('.').next().unwrap_or("");
        match self {
            Whole("") => base.is_empty(),
            Whole(name) => base == name || base.strip_suffix(name).is_some_and(|rest| rest.ends_with('.')),
            Starts(start) => last.starts_with(start),
            Ends(end) => last.ends_with(end),
        }
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Whole("") => out.write_str("R,G,B"),
            Whole(name) => out.write_str(name),
            Starts(start) => write!(out, "{start}*"),
            Ends(end) => write!(out, "*{end}"),
        }
    }
}

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

    #[test]
    fn names_match_whole_segments_from_the_end() {
        assert!(COMBINED.matches("viewlayer.combined"));
        assert!(!COMBINED.matches("recombined"));
        assert!(Whole("").matches(""));
        assert!(!Whole("").matches("albedo"));
        assert!(Ends("_denoised").matches("x.beauty_denoised"));
    }
}
