//! Roles to channels of files: the user's overrides first, then files given for one role, then recognised names.

use crate::error::{Error, Purpose};
use crate::exr_file::{ExrFile, Window};
use crate::files::FrameFiles;
use crate::layers::{Hit, Layers};
use crate::names::{candidates, component_count};
use crate::overrides::{Choice, RoleOverrides, Selection};
use sspc_image::{Buffer, Role, RoleSource, shown};
use std::path::{Path, PathBuf};

/// Channels chosen for one role of one buffer.
#[derive(Clone, Debug)]
pub struct Filled {
    pub role: Role,
    pub buffer: Buffer,
    /// Index into [`Resolution::files`].
    pub file: usize,
    /// Indices into the file's channels, in component order.
    pub channels: Vec<usize>,
}

/// Every role that could be filled, and from where.
pub struct Resolution {
    pub files: Vec<ExrFile>,
    pub filled: Vec<Filled>,
    pub warnings: Vec<String>,
}

impl Resolution {
    /// The channels chosen for a role, if any.
    pub fn get(&self, role: Role, buffer: Buffer) -> Option<&Filled> {
        self.filled.iter().find(|filled| (filled.role, filled.buffer) == (role, buffer))
    }

    /// What the report says about one role.
    pub fn source(&self, filled: &Filled) -> RoleSource {
        let file = &self.files[filled.file];
        let channels = filled.channels.iter().map(|&at| file.channels[at].name.clone()).collect();
        RoleSource { role: filled.role, buffer: filled.buffer, path: file.path.clone(), channels }
    }
}

/// Finds the channels of every role, reading headers only.
///
/// # Errors
/// Files that cannot be read, a missing required role, an override that names no channel, and sizes that differ.
pub fn resolve(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Resolution, Error> {
    let mut search = Search { given: files, overrides, opened: Vec::new(), warnings: Vec::new() };
    let mut filled = Vec::new();
    for role in Role::ALL {
        for buffer in [Buffer::A, Buffer::B, Buffer::Full] {
            if buffer != Buffer::Full || role == Role::Denoised {
                filled.extend(search.fill(role, buffer)?);
            }
        }
    }
    drop_lonely_features(&mut filled, &search.opened, &mut search.warnings);
    let files: Vec<ExrFile> = search.opened.into_iter().map(|(file, _)| file).collect();
    let resolution = Resolution { files, filled, warnings: search.warnings };
    check_sizes(&resolution)?;
    Ok(resolution)
}

struct Search<'a> {
    given: &'a FrameFiles,
    overrides: &'a RoleOverrides,
    opened: Vec<(ExrFile, Layers)>,
    warnings: Vec<String>,
}

impl Search<'_> {
    fn fill(&mut self, role: Role, buffer: Buffer) -> Result<Option<Filled>, Error> {
        let purpose = Purpose::Role(role, buffer);
        let (file, hit) = match self.overrides.get(role, buffer).cloned() {
            Some(Choice::Absent) => return Ok(None),
            Some(Choice::From { file: Some(path), selection }) => {
                let file = self.open(&path, purpose)?;
                (file, Some(self.chosen(file, role, buffer, &selection)?))
            }
            Some(Choice::From { file: None, selection }) => {
                let path = self.home(role, buffer);
                let file = self.open(&path, purpose)?;
                (file, Some(self.chosen(file, role, buffer, &selection)?))
            }
            None => match self.given.roles.get(&(role, buffer)).cloned() {
                Some(path) => {
                    let file = self.open(&path, purpose)?;
                    (file, Some(self.chosen(file, role, buffer, &Selection::Recognised)?))
                }
                None => self.recognise(role, buffer)?,
            },
        };
        let Some(hit) = hit else {
            let required = buffer != Buffer::Full && matches!(role, Role::Radiance | Role::Denoised);
            return if required { Err(self.missing(file, role, buffer)) } else { Ok(None) };
        };
        if let (Some(other), Buffer::A) = (hit.passed_over.first(), buffer) {
            let taken = &self.opened[file].0.channels[hit.channels[0]].name;
            self.warnings.push(format!("{purpose}: took {}, passed over {}", shown(taken), shown(other)));
        }
        Ok(Some(Filled { role, buffer, file, channels: hit.channels }))
    }

    /// The file a role comes from when nothing else is said.
    fn home(&self, role: Role, buffer: Buffer) -> PathBuf {
        let own = self.given.roles.get(&(role, buffer));
        let half = if buffer == Buffer::B { self.given.b.as_ref() } else { None };
        own.or(half).unwrap_or(&self.given.a).clone()
    }

    fn recognise(&mut self, role: Role, buffer: Buffer) -> Result<(usize, Option<Hit>), Error> {
        let path = self.home(role, buffer);
        let file = self.open(&path, Purpose::Role(role, buffer))?;
        let layers = &self.opened[file].1;
        let hit = match (self.given.b.is_some(), buffer) {
            // A file of one half does not hold the full buffer.
            (true, Buffer::Full) => None,
            (true, half) => layers.find(role, None).or_else(|| layers.find(role, Some(half))),
            (false, Buffer::Full) => layers.find(role, None),
            (false, half) => {
                let marked = layers.find(role, Some(half));
                let is_feature = !matches!(role, Role::Radiance | Role::Denoised);
                let shared = if is_feature && marked.is_none() { layers.find(role, None) } else { None };
                if shared.is_some() && buffer == Buffer::A {
                    self.warnings
                        .push(format!("{role}: one layer serves both halves, so its noise is not independent"));
                }
                marked.or(shared)
            }
        };
        Ok((file, hit))
    }

    fn chosen(&self, file: usize, role: Role, buffer: Buffer, selection: &Selection) -> Result<Hit, Error> {
        let (exr, layers) = &self.opened[file];
        let hit = match selection {
            Selection::Recognised => {
                return layers
                    .find_dedicated(role, Some(buffer).filter(|&half| half != Buffer::Full))
                    .ok_or_else(|| self.missing(file, role, buffer));
            }
            Selection::Layer(name) => layers.find_named(name, role).or_else(|| {
                // One channel by its full name is a layer of one component.
                let only = named_channel(exr, name).filter(|_| component_count(role) == 1)?;
                Some(Hit { channels: vec![only], passed_over: Vec::new() })
            }),
            Selection::Channels(names) => names
                .iter()
                .map(|name| named_channel(exr, name))
                .collect::<Option<Vec<_>>>()
                .map(|channels| Hit { channels, passed_over: Vec::new() }),
        };
        hit.ok_or_else(|| {
            let expected = match selection {
                Selection::Layer(name) => format!("{} channel(s) in layer '{}'", component_count(role), shown(name)),
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
        let names: Vec<String> = candidates(role).iter().take(6).map(ToString::to_string).collect();
        let marked = if self.given.b.is_none() && buffer != Buffer::Full {
            let mark = if buffer == Buffer::A { "even, a or an ending A" } else { "odd, b or an ending B" };
            format!(" marked {mark}")
        } else {
            String::new()
        };
        let own = if role == Role::Denoised { " or a file of its own" } else { "" };
        Error::MissingRole {
            path: file.path.clone(),
            purpose: Purpose::Role(role, buffer),
            expected: format!("a layer such as {}{marked}{own}", names.join(", ")),
            found: layers.summary(),
        }
    }
}

/// A channel by its exact name, else without regard to case.
fn named_channel(file: &ExrFile, name: &str) -> Option<usize> {
    let exact = file.channels.iter().position(|channel| channel.name == name);
    exact.or_else(|| file.channels.iter().position(|channel| channel.name.eq_ignore_ascii_case(name)))
}

/// A feature that only one half has cannot be used.
fn drop_lonely_features(filled: &mut Vec<Filled>, opened: &[(ExrFile, Layers)], warnings: &mut Vec<String>) {
    for role in [Role::Albedo, Role::Normal, Role::Visibility] {
        let of_role: Vec<&Filled> = filled.iter().filter(|filled| filled.role == role).collect();
        if let [lonely] = of_role.as_slice() {
            let path = opened[lonely.file].0.path.display();
            warnings.push(format!("{role}: only {} has it ({path}), so it is not used", lonely.buffer));
            filled.retain(|filled| filled.role != role);
        }
    }
}

fn check_sizes(resolution: &Resolution) -> Result<(), Error> {
    let Some(first) = resolution.get(Role::Radiance, Buffer::A) else { return Ok(()) };
    let like = &resolution.files[first.file];
    let window = like.channels[first.channels[0]].window;
    for filled in &resolution.filled {
        let file = &resolution.files[filled.file];
        // Denoisers that pass through other formats lose the window's position; halves may not.
        let positioned = filled.role == Role::Radiance;
        for found in filled.channels.iter().map(|&at| file.channels[at].window) {
            if !same_size(window, found) || (positioned && window != found) {
                return Err(Error::SizeMismatch {
                    path: file.path.clone(),
                    purpose: Purpose::Role(filled.role, filled.buffer),
                    expected: window.to_string(),
                    found: found.to_string(),
                    like: like.path.clone(),
                });
            }
        }
    }
    Ok(())
}

fn same_size(a: Window, b: Window) -> bool {
    (a.width, a.height) == (b.width, b.height)
}
