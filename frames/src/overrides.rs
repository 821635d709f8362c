//! The user's word on which channel is what.
//!
//! ```text
//! override := ROLE [ "-a" | "-b" | "-full" ] "=" source
//! ROLE     := "radiance" | "denoised" | "albedo" | "normal" | "visibility" | "motion" | "dx" | "dy"   (also "color", "noisy")
//! source   := "none" | FILE.exr | FILE.exr ":" channels | channels
//! channels := LAYER | CHANNEL "," CHANNEL "," CHANNEL | CHANNEL   (one channel for visibility, 2 to 4 for motion)
//! ```
//! Without `-a` or `-b` both halves are meant. Examples: `albedo=diffuse_color`, `normal=N.x,N.y,N.z`,
//! `radiance-b=odd`, `denoised-full=full.exr`, `albedo-a=features_a.exr:albedo`, `visibility=none`.
//!
//! Further denoised pictures are `more := ZA,ZB | ZA,ZB,Z`, each of them `FILE.exr` or `FILE.exr:LAYER`.

use crate::error::Error;
use crate::files::{DenoisedFile, MoreDenoised};
use crate::names::component_counts;
use sspc_image::{Buffer, Role, shown};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;

/// Which channels of a file were asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// The layer of this name; its components are found by their endings.
    Layer(String),
    /// These channels in component order.
    Channels(Vec<String>),
    /// By recognised names.
    Recognised,
}

/// Where the user wants a role to come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The role is to be absent (features only).
    Absent,
    /// From this file, or from the half's own file when `None`.
    From {
        /// The file.
        file: Option<PathBuf>,
        /// Which of its channels.
        selection: Selection,
    },
}

/// Overrides by role and buffer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RoleOverrides {
    choices: BTreeMap<(Role, Buffer), Choice>,
    view: Option<String>,
    /// All views are corrected, each in turn.
    all_views: bool,
    /// Motion and position are looked for.
    with_motion: bool,
    /// Differences of y are looked for.
    with_differences: bool,
}

impl RoleOverrides {
    /// No overrides: recognised names decide.
    pub fn none() -> Self {
        Self::default()
    }

    /// Parses overrides in the order given; a later one replaces an earlier one.
    ///
    /// # Errors
    /// [`Error::Override`] with the offending text.
    pub fn parse<S: AsRef<str>>(texts: impl IntoIterator<Item = S>) -> Result<Self, Error> {
        let mut overrides = Self::none();
        for text in texts {
            overrides.add(text.as_ref())?;
        }
        Ok(overrides)
    }

    /// Adds one override in the textual form of this module.
    ///
    /// # Errors
    /// [`Error::Override`] with the text, what was expected and what was found.
    pub fn add(&mut self, text: &str) -> Result<(), Error> {
        let (role, buffers, source) = split_target(text)?;
        let choice = parse_source(text, role, source)?;
        for &buffer in buffers {
            self.set(role, buffer, choice.clone());
        }
        Ok(())
    }

    /// Sets one choice.
    pub fn set(&mut self, role: Role, buffer: Buffer, choice: Choice) {
        self.choices.insert((role, buffer), choice);
    }

    /// The choice for a role of a buffer, if the user made one.
    pub fn get(&self, role: Role, buffer: Buffer) -> Option<&Choice> {
        self.choices.get(&(role, buffer))
    }

    /// The same for a view of a stereo file, by its name; without one, the default view is meant.
    pub fn of_view(mut self, view: Option<String>) -> Self {
        self.view = view;
        self
    }

    /// The same, where every other view has its turn as well.
    pub fn of_each_view(self, view: String) -> Self {
        Self { all_views: true, ..self.of_view(Some(view)) }
    }

    /// The same, with motion and position looked for as well: frames of a shot, which have neighbours to move to.
    pub fn with_motion(self) -> Self {
        Self { with_motion: true, ..self }
    }

    /// The same, with differences of y looked for as well: frames that are fitted or corrected with them.
    pub fn with_differences(self) -> Self {
        Self { with_differences: true, ..self }
    }

    /// Whether a role is looked for.
    pub fn wants(&self, role: Role) -> bool {
        match role {
            Role::Motion | Role::Position => self.with_motion,
            Role::Dx | Role::Dy => self.with_differences,
            _ => true,
        }
    }

    /// Whether every view has its turn.
    pub fn all_views(&self) -> bool {
        self.all_views
    }

    /// The view that was asked for.
    pub fn view(&self) -> Option<&str> {
        self.view.as_deref()
    }

    /// The files that overrides name: none of them may be an output.
    pub fn files(&self) -> Vec<PathBuf> {
        let named = self.choices.values().filter_map(|choice| match choice {
            Choice::From { file, .. } => file.clone(),
            Choice::Absent => None,
        });
        named.collect()
    }
}

impl FromStr for RoleOverrides {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        Self::parse([text])
    }
}

impl FromStr for MoreDenoised {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let file = |source: &str| match split_file(source.trim()) {
            (Some(path), "") => Ok(DenoisedFile { path, layer: None }),
            (Some(path), layer) => Ok(DenoisedFile { path, layer: Some(layer.to_string()) }),
            (None, _) => Err(wrong(text, "FILE.exr or FILE.exr:LAYER for each picture", format!("'{source}'"))),
        };
        let files = text.split(',').map(file).collect::<Result<Vec<_>, Error>>()?;
        match files.as_slice() {
            [a, b] => Ok(Self { halves: [a.clone(), b.clone()], full: None }),
            [a, b, full] => Ok(Self { halves: [a.clone(), b.clone()], full: Some(full.clone()) }),
            files => Err(wrong(text, "ZA.exr,ZB.exr or ZA.exr,ZB.exr,Z.exr", format!("{} pictures", files.len()))),
        }
    }
}

fn wrong(text: &str, expected: &str, found: impl Into<String>) -> Error {
    Error::Override { text: shown(text), expected: expected.to_string(), found: shown(&found.into()) }
}

fn split_target(text: &str) -> Result<(Role, &'static [Buffer], &str), Error> {
    let Some((target, source)) = text.split_once('=') else {
        return Err(wrong(text, "ROLE=SOURCE", "no '='"));
    };
    let target = target.trim().to_ascii_lowercase();
    let (name, buffers): (&str, &'static [Buffer]) = match target.rsplit_once('-') {
        Some((name, "a")) => (name, &[Buffer::A]),
        Some((name, "b")) => (name, &[Buffer::B]),
        Some((name, "full")) => (name, &[Buffer::Full]),
        Some((_, other)) => return Err(wrong(text, "-a, -b or -full after the role", format!("-{other}"))),
        None => (&target, &[Buffer::A, Buffer::B]),
    };
    let role = match name {
        "radiance" | "color" | "colour" | "noisy" => Role::Radiance,
        "denoised" => Role::Denoised,
        "albedo" => Role::Albedo,
        "normal" => Role::Normal,
        "visibility" => Role::Visibility,
        "motion" => Role::Motion,
        "position" => Role::Position,
        "dx" => Role::Dx,
        "dy" => Role::Dy,
        other => {
            let expected = "radiance, denoised, albedo, normal, visibility, motion, position, dx or dy";
            return Err(wrong(text, expected, format!("'{other}'")));
        }
    };
    if buffers == [Buffer::Full] && role != Role::Denoised {
        return Err(wrong(text, "-full only with denoised", format!("'{target}'")));
    }
    Ok((role, buffers, source.trim()))
}

fn parse_source(text: &str, role: Role, source: &str) -> Result<Choice, Error> {
    if source.is_empty() {
        return Err(wrong(text, "a layer, channels, a file or none after '='", "nothing"));
    }
    if source.eq_ignore_ascii_case("none") {
        return if role == Role::Radiance {
            Err(wrong(text, "a source, as this role is required", "none"))
        } else {
            Ok(Choice::Absent)
        };
    }
    let (file, channels) = split_file(source);
    let selection = match channels {
        "" => Selection::Recognised,
        list if list.contains(',') => {
            let names: Vec<String> = list.split(',').map(|name| name.trim().to_string()).collect();
            let counts = component_counts(role);
            if !counts.contains(&names.len()) || names.iter().any(String::is_empty) {
                let (least, most) = (counts.start(), counts.end());
                let count = if least == most { format!("{least}") } else { format!("{least} to {most}") };
                return Err(wrong(text, &format!("{count} channel name(s)"), format!("'{list}'")));
            }
            Selection::Channels(names)
        }
        layer => Selection::Layer(layer.to_string()),
    };
    Ok(Choice::From { file, selection })
}

/// Splits `FILE.exr[:channels]` at the first `.exr` that ends the text or precedes a colon.
fn split_file(source: &str) -> (Option<PathBuf>, &str) {
    let lower = source.to_ascii_lowercase();
    for (at, _) in lower.match_indices(".exr") {
        let end = at + ".exr".len();
        match source[end..].strip_prefix(':') {
            Some(channels) => return (Some(source[..end].into()), channels.trim()),
            None if end == source.len() => return (Some(source.into()), ""),
            None => {}
        }
    }
    (None, source)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(file: Option<&str>, selection: Selection) -> Option<Choice> {
        Some(Choice::From { file: file.map(PathBuf::from), selection })
    }

    #[test]
    fn every_form_of_the_grammar_is_read() {
        let layer = |name: &str| Selection::Layer(name.to_string());
        let list = |names: &[&str]| Selection::Channels(names.iter().map(|n| n.to_string()).collect());
        for (text, role, buffer, choice) in [
            ("albedo=diffuse_color", Role::Albedo, Buffer::B, from(None, layer("diffuse_color"))),
            ("normal=N.x,N.y,N.z", Role::Normal, Buffer::A, from(None, list(&["N.x", "N.y", "N.z"]))),
            ("radiance-b=odd", Role::Radiance, Buffer::B, from(None, layer("odd"))),
            ("radiance-b=odd", Role::Radiance, Buffer::A, None),
            ("denoised-full=full.EXR", Role::Denoised, Buffer::Full, from(Some("full.EXR"), Selection::Recognised)),
            ("albedo-a=f.exr.1.exr:al", Role::Albedo, Buffer::A, from(Some("f.exr.1.exr"), layer("al"))),
            ("visibility=none", Role::Visibility, Buffer::A, Some(Choice::Absent)),
            ("dx=grad", Role::Dx, Buffer::A, from(None, layer("grad"))),
            ("motion=m.x,m.y", Role::Motion, Buffer::B, from(None, list(&["m.x", "m.y"]))),
        ] {
            let overrides: RoleOverrides = text.parse().expect(text);
            assert_eq!(overrides.get(role, buffer).cloned(), choice, "{text}");
        }
    }

    #[test]
    fn further_denoised_pictures_are_two_or_three_files() {
        let more: MoreDenoised = "za.exr,zb.exr:deno, z.1.exr".parse().expect("three pictures");
        let file =
            |path: &str, layer: Option<&str>| DenoisedFile { path: path.into(), layer: layer.map(str::to_string) };
        assert_eq!(more.halves, [file("za.exr", None), file("zb.exr", Some("deno"))]);
        assert_eq!(more.full, Some(file("z.1.exr", None)));
        assert_eq!("a.exr,b.exr".parse::<MoreDenoised>().map(|more| more.full).ok(), Some(None));
        for text in ["a.exr", "a.exr,b.exr,c.exr,d.exr", "a.exr,deno", ""] {
            assert!(text.parse::<MoreDenoised>().is_err(), "{text}");
        }
    }

    #[test]
    fn senseless_overrides_are_refused_by_name() {
        for text in [
            "albedo",
            "albedo=",
            "colour-c=x",
            "gloss=x",
            "albedo=R,G",
            "albedo-full=x",
            "radiance=none",
            "=",
            "normal=a,,b",
            "motion=a,b,c,d,e",
        ] {
            let error = text.parse::<RoleOverrides>().expect_err(text);
            assert!(error.to_string().contains(text), "{error}");
        }
    }
}
