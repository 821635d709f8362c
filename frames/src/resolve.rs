//! Roles to channels of files: the user's overrides first, then files given for one role, then recognised names.

use crate::align::{Aligned, align};
use crate::checks::{drop_lonely_features, refuse_one_half};
use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::files::{DenoisedFile, FrameFiles};
use crate::layers::{Layers, Reading};
use crate::names::{candidates, component_counts, noisy};
use crate::overrides::{Choice, RoleOverrides, Selection};
use crate::search::{Anchor, Found, Hit};
use crate::window::Window;
use sspc_image::{Buffer, Role, RoleSource, shown};
use std::path::{Path, PathBuf};

/// Channels chosen for one role of one buffer.
#[derive(Clone, Debug)]
pub struct Filled {
    /// The role.
    pub role: Role,
    /// Of which samples.
    pub buffer: Buffer,
    /// 0, or from 1 on for further denoised pictures.
    pub variant: usize,
    /// Index into [`Resolution::files`].
    pub file: usize,
    /// Indices into the file's channels, in component order.
    pub channels: Vec<usize>,
    /// Where the frame's pixels lie in the file, in the file's coordinates.
    pub window: Window,
}

/// Every role that could be filled, and from where.
pub struct Resolution {
    /// The files that were opened.
    pub files: Vec<ExrFile>,
    /// The roles that were filled.
    pub filled: Vec<Filled>,
    /// The pixels that all roles have, in half a's coordinates.
    pub window: Window,
    /// What is wrong with a frame without denoised halves, unless they come from elsewhere.
    pub undenoised: Option<Error>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

impl Resolution {
    /// The channels chosen for a role, if any.
    pub fn get(&self, role: Role, buffer: Buffer) -> Option<&Filled> {
        self.filled.iter().find(|filled| (filled.role, filled.buffer, filled.variant) == (role, buffer, 0))
    }

    /// The noisy colour of half a, which every frame has.
    pub fn radiance(&self) -> &Filled {
        match self.get(Role::Radiance, Buffer::A) {
            Some(radiance) => radiance,
            None => unreachable!("resolve() has refused frames without colour"),
        }
    }

    /// What the report says about one role.
    pub fn source(&self, filled: &Filled) -> RoleSource {
        let file = &self.files[filled.file];
        let channels = filled.channels.iter().map(|&at| file.channels[at].name.clone()).collect();
        let Filled { role, buffer, variant, .. } = *filled;
        RoleSource { role, buffer, variant, path: file.path.clone(), channels }
    }
}

/// The views of a frame's half a: more than one in stereo files, none in others.
///
/// # Errors
/// What opening the file can raise.
pub fn views(files: &FrameFiles) -> Result<Vec<String>, Error> {
    Ok(ExrFile::open(&files.a, Purpose::Role(Role::Radiance, Buffer::A))?.views)
}

/// Finds the channels of every role, reading headers only.
///
/// # Errors
/// Files that cannot be read, a missing required role (of denoised halves one alone), an override that names no channel, and windows without anything in
/// common.
pub fn resolve(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Resolution, Error> {
    let mut search = Search {
        given: files,
        overrides,
        opened: Vec::new(),
        anchors: [None, None],
        colours: Default::default(),
        undenoised: None,
        warnings: Vec::new(),
    };
    let mut filled: Vec<Filled> = Vec::new();
    for role in Role::ALL.into_iter().filter(|role| overrides.wants(*role)) {
        for buffer in [Buffer::A, Buffer::B, Buffer::Full] {
            if buffer != Buffer::Full || role == Role::Denoised {
                let half_a = filled.iter().find(|known| (known.role, known.buffer) == (role, Buffer::A)).cloned();
                filled.extend(search.fill(role, buffer, half_a.as_ref())?);
            }
        }
    }
    let mut undenoised = search.undenoised.take();
    if undenoised.is_some() {
        refuse_one_half(&filled, |file| search.opened[file].0.path.clone())?;
    }
    if filled.iter().any(|known| known.role == Role::Denoised && known.buffer != Buffer::Full) {
        // One half alone.
        undenoised.take().map_or(Ok(()), Err)?;
    }
    for (at, more) in files.more_denoised.iter().enumerate() {
        let pictures =
            more.halves.iter().zip([Buffer::A, Buffer::B]).chain(more.full.iter().map(|z| (z, Buffer::Full)));
        for (file, buffer) in pictures {
            filled.push(search.further(file, buffer, at + 1)?);
        }
    }
    search.warnings.extend(drop_lonely_features(&mut filled, |file| search.opened[file].0.path.clone()));
    search.name_other_views();
    let Search { opened, mut warnings, .. } = search;
    let files: Vec<ExrFile> = opened.into_iter().map(|(file, _)| file).collect();
    warnings.extend(drop_unaligned_position(&files, &mut filled));
    let Aligned { window, said } = align(&files, &mut filled)?;
    warnings.extend(said);
    Ok(Resolution { files, filled, window, undenoised, warnings })
}

/// Takes out world positions that lie elsewhere than the frame, and says so: nobody needs them.
fn drop_unaligned_position(files: &[ExrFile], filled: &mut Vec<Filled>) -> Option<String> {
    let is_position = |known: &Filled| known.role == Role::Position;
    filled.iter().find(|known| is_position(known))?;
    let error = align(files, &mut filled.clone()).err()?;
    filled.retain(|known| !is_position(known));
    Some(format!("{} is not used: {error}", Role::Position))
}

struct Search<'a> {
    given: &'a FrameFiles,
    overrides: &'a RoleOverrides,
    opened: Vec<(ExrFile, Layers)>,
    /// Where the noisy colour of half a and of half b is.
    anchors: [Option<Anchor>; 2],
    /// The channels of both, by their names.
    colours: [Vec<String>; 2],
    /// Why a denoised half is not there.
    undenoised: Option<Error>,
    warnings: Vec<String>,
}

impl Search<'_> {
    fn fill(&mut self, role: Role, buffer: Buffer, half_a: Option<&Filled>) -> Result<Option<Filled>, Error> {
        let purpose = Purpose::Role(role, buffer);
        let (file, hit) = match self.overrides.get(role, buffer).cloned() {
            Some(Choice::Absent) => (self.open(&self.home(role, buffer), purpose)?, None),
            Some(Choice::From { file: path, selection }) => {
                let path = path.unwrap_or_else(|| self.home(role, buffer));
                let file = self.open(&path, purpose)?;
                (file, Some(self.chosen(file, role, buffer, &selection)?))
            }
            None => match self.given.roles.get(&(role, buffer)).cloned() {
                Some(path) => {
                    let file = self.open(&path, purpose)?;
                    (file, Some(self.chosen(file, role, buffer, &Selection::Recognised)?))
                }
                None => self.recognise(role, buffer, half_a)?,
            },
        };
        let Some(hit) = hit else {
            return match role {
                Role::Radiance => Err(self.missing(file, role, buffer)),
                Role::Denoised if buffer != Buffer::Full => {
                    let missing = self.missing(file, role, buffer);
                    self.undenoised.get_or_insert(missing);
                    Ok(None)
                }
                _ => Ok(None),
            };
        };
        if buffer == Buffer::A {
            self.tell_of(&hit, file, purpose);
        }
        if role == Role::Radiance {
            let anchor = self.opened[file].1.anchor(&hit.channels, self.reading(buffer));
            self.anchors[usize::from(buffer == Buffer::B)] = anchor;
            self.colours[usize::from(buffer == Buffer::B)] = self.names(file, &hit.channels);
        }
        let window = self.opened[file].0.channels[hit.channels[0]].window;
        Ok(Some(Filled { role, buffer, variant: 0, file, channels: hit.channels, window }))
    }

    /// A further denoised picture.
    fn further(&mut self, from: &DenoisedFile, buffer: Buffer, variant: usize) -> Result<Filled, Error> {
        let role = Role::Denoised;
        let file = self.open(&from.path, Purpose::Role(role, buffer))?;
        let selection = from.layer.clone().map_or(Selection::Recognised, Selection::Layer);
        let channels = self.chosen(file, role, buffer, &selection)?.channels;
        let window = self.opened[file].0.channels[channels[0]].window;
        Ok(Filled { role, buffer, variant, file, channels, window })
    }

    fn tell_of(&mut self, hit: &Hit, file: usize, purpose: Purpose) {
        let taken = &self.opened[file].0.channels[hit.channels[0]].name;
        if let Some(other) = hit.passed_over.first() {
            self.warnings.push(format!("{purpose}: took {}, passed over {}", shown(taken), shown(other)));
        } else if hit.is_elsewhere {
            self.warnings.push(format!("{purpose}: took {}, which is not in the noisy colour's layer", shown(taken)));
        }
    }

    /// How names are read: with two files, marks of halves mean nothing.
    fn reading(&self, buffer: Buffer) -> Reading {
        match (self.given.b.is_some(), buffer) {
            (true, _) => Reading::Plain,
            (false, Buffer::Full) => Reading::Unmarked,
            (false, half) => Reading::Marked(half),
        }
    }

    fn anchor(&self, buffer: Buffer) -> Option<&Anchor> {
        self.anchors[usize::from(buffer == Buffer::B)].as_ref()
    }

    /// The number of the view that was asked for.
    fn view(&self, file: usize) -> Result<usize, Error> {
        let (file, layers) = &self.opened[file];
        let Some(wanted) = self.overrides.view() else { return Ok(0) };
        let found = layers.views.iter().position(|view| view.eq_ignore_ascii_case(wanted));
        // Files of one role need not say which view they are of, unless they would serve several.
        let needs_none = layers.views.is_empty() && !self.overrides.all_views();
        match found.or(needs_none.then_some(0)) {
            Some(view) => Ok(view),
            None => Err(Error::MissingView {
                path: file.path.clone(),
                wanted: shown(wanted),
                found: match layers.views.is_empty() {
                    true => "a file without views".to_string(),
                    false => format!("the views {}", shown(&layers.views.join(", "))),
                },
            }),
        }
    }

    /// The file a role comes from when nothing else is said.
    fn home(&self, role: Role, buffer: Buffer) -> PathBuf {
        let own = self.given.roles.get(&(role, buffer));
        let half = if buffer == Buffer::B { self.given.b.as_ref() } else { None };
        own.or(half).unwrap_or(&self.given.a).clone()
    }

    fn recognise(
        &mut self,
        role: Role,
        buffer: Buffer,
        half_a: Option<&Filled>,
    ) -> Result<(usize, Option<Hit>), Error> {
        let path = self.home(role, buffer);
        let file = self.open(&path, Purpose::Role(role, buffer))?;
        let view = self.view(file)?;
        if self.given.b.is_some() && buffer == Buffer::Full {
            // A file of one half does not hold the full buffer.
            return Ok((file, None));
        }
        if let Some(half) = half_a.filter(|half| buffer == Buffer::B && self.is_own(half)) {
            let names = self.names(half.file, &half.channels);
            return Ok((file, self.same_names(file, role, &names)?));
        }
        let layers = &self.opened[file].1;
        if role == Role::Radiance {
            return Ok((file, layers.noisy_colour(self.reading(buffer), view)));
        }
        // Features of a frame whose noisy colour is in another file are looked for beside what is noisy in this one.
        let anchor = self.anchor(buffer).cloned().or_else(|| {
            let reading = self.reading(buffer);
            layers.noisy_colour(reading, view).and_then(|hit| layers.anchor(&hit.channels, reading))
        });
        let Some(anchor) = anchor else { return Ok((file, None)) };
        let Found { hit, foreign } = layers.beside(role, self.reading(buffer), &anchor);
        let is_feature = !matches!(role, Role::Radiance | Role::Denoised);
        let may_share = is_feature && hit.is_none() && self.given.b.is_none();
        let shared = if may_share { layers.beside(role, Reading::Unmarked, &anchor).hit } else { None };
        let paired =
            |hit: Hit, reading| if role == Role::Motion { layers.with_motion_partner(hit, reading) } else { hit };
        let hit = hit.map(|hit| paired(hit, self.reading(buffer)));
        let shared = shared.map(|hit| paired(hit, Reading::Unmarked));
        if buffer == Buffer::A {
            if shared.is_some() {
                self.warnings.push(format!("{role}: one layer serves both halves, so its noise is not independent"));
            } else if let (None, Some(other)) = (&hit, foreign.first()) {
                let belongs = "belongs to another layer than the noisy colour and is not used";
                self.warnings.push(format!("{role}: {} {belongs}", shown(other)));
            }
        }
        Ok((file, hit.or(shared)))
    }

    /// Whether a role of half a was recognised in half a's own file.
    fn is_own(&self, half: &Filled) -> bool {
        let (role, buffer) = (half.role, Buffer::A);
        let is_told = self.overrides.get(role, buffer).is_some() || self.given.roles.contains_key(&(role, buffer));
        self.given.b.is_some() && !is_told
    }

    fn names(&self, file: usize, channels: &[usize]) -> Vec<String> {
        channels.iter().map(|&at| self.opened[file].0.channels[at].name.clone()).collect()
    }

    /// The channels by which half a names a role, in half b: two files of a frame are made alike.
    fn same_names(&self, file: usize, role: Role, names: &[String]) -> Result<Option<Hit>, Error> {
        let (exr, layers) = &self.opened[file];
        let same = exr.channels_named(names);
        let is_feature = !matches!(role, Role::Radiance | Role::Denoised);
        match same {
            Some(channels) => Ok(Some(Hit::of(channels))),
            None if is_feature => Ok(None),
            None => Err(Error::MissingRole {
                path: exr.path.clone(),
                purpose: Purpose::Role(role, Buffer::B),
                expected: format!("{}, as in half a{}", shown(&names.join(",")), own_file(role)),
                found: layers.summary(),
            }),
        }
    }

    fn chosen(&self, file: usize, role: Role, buffer: Buffer, selection: &Selection) -> Result<Hit, Error> {
        let (exr, layers) = &self.opened[file];
        let view = self.view(file)?;
        let most = *component_counts(role).end();
        let grey = |at: usize| Hit::of(vec![at; most]);
        let hit = match selection {
            Selection::Recognised => {
                let reading =
                    Some(buffer).filter(|&half| half != Buffer::Full).map_or(Reading::Unmarked, Reading::Marked);
                let like = self.anchor(buffer).map(|anchor| &anchor.name);
                let colour = &self.colours[usize::from(buffer == Buffer::B)];
                let is_colour = role == Role::Denoised && !colour.is_empty();
                let same = || exr.channels_named(colour).filter(|_| is_colour).map(Hit::of);
                let hit = layers.dedicated(role, reading, like, view).or_else(same);
                let paired = |hit| if role == Role::Motion { layers.with_motion_partner(hit, reading) } else { hit };
                return hit.map(paired).ok_or_else(|| self.missing(file, role, buffer));
            }
            Selection::Layer(name) => {
                // One channel by its full name is a layer of one component.
                let is_anchor_grey = self.anchor(buffer).is_some_and(|anchor| anchor.is_grey);
                let may_be_grey = role == Role::Radiance || (role != Role::Motion && is_anchor_grey);
                let only = || exr.channel_named(name).filter(|_| may_be_grey || most == 1).map(grey);
                layers.named(name, role, view, may_be_grey).or_else(only)
            }
            Selection::Channels(names) => exr.channels_named(names).map(Hit::of),
        };
        hit.ok_or_else(|| {
            let expected = match selection {
                Selection::Layer(name) => {
                    let least = component_counts(role).start().to_owned();
                    format!("{least} channel(s) in layer '{}'", shown(name))
                }
                Selection::Channels(names) => format!("channels {}", shown(&names.join(","))),
                Selection::Recognised => String::new(),
            };
            let purpose = Purpose::Role(role, buffer);
            Error::MissingRole { path: exr.path.clone(), purpose, expected, found: layers.summary() }
        })
    }

    fn open(&mut self, path: &Path, purpose: Purpose) -> Result<usize, Error> {
        if let Some(known) = self.opened.iter().position(|(file, _)| file.path == path) {
            return Ok(known);
        }
        let file = ExrFile::open(path, purpose)?;
        let layers = Layers::of(&file);
        self.opened.push((file, layers));
        Ok(self.opened.len() - 1)
    }

    fn missing(&self, file: usize, role: Role, buffer: Buffer) -> Error {
        let (file, layers) = &self.opened[file];
        let noisy = if role == Role::Radiance { noisy() } else { &[] };
        let known = noisy.iter().take(1).chain(candidates(role));
        let names: Vec<String> = known.take(6).map(|known| known.pattern.to_string()).collect();
        let marked = match self.reading(buffer) {
            Reading::Marked(Buffer::A) => " marked even, a or an ending A",
            Reading::Marked(_) => " marked odd, b or an ending B",
            _ => "",
        };
        let own = own_file(role);
        let name = |channel: usize| file.channels[channel].name.clone();
        let proposal = layers.nearest(role, self.anchor(buffer), &name);
        let proposal = proposal.map(|path| format!("; perhaps --role '{}={path}'", role.name())).unwrap_or_default();
        Error::MissingRole {
            path: file.path.clone(),
            purpose: Purpose::Role(role, buffer),
            expected: format!("a layer such as {}{marked}{own}", names.join(", ")),
            found: format!("{}{proposal}", layers.summary()),
        }
    }

    /// Says which views stay as they are.
    fn name_other_views(&mut self) {
        let Some(anchor) = self.anchors[0].as_ref().filter(|_| !self.overrides.all_views()) else { return };
        let Some((_, layers)) = self.opened.first() else { return };
        let others: Vec<&str> = layers
            .views
            .iter()
            .enumerate()
            .filter(|(at, _)| *at != anchor.view)
            .map(|(_, view)| view.as_str())
            .collect();
        if let (Some(own), false) = (layers.views.get(anchor.view), others.is_empty()) {
            let (own, others) = (shown(own), shown(&others.join(", ")));
            self.warnings
                .push(format!("view {own} is corrected, {others} stays as it is (--view names another, or all)"));
        }
    }
}

/// What else a role may be given in, for messages.
fn own_file(role: Role) -> &'static str {
    if role == Role::Denoised { " or a file of its own" } else { "" }
}
