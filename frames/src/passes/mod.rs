//! Additive passes of a frame: lights or lobes that add up to the noisy colour, found by their names, checked by looking.
//!
//! | module | job |
//! |---|---|
//! | `names` | the names that renderers give to lobes and light groups |
//! | `find` | layers that may be passes, by their names or the user's word |
//! | `sums` | whether they add up, and what is missing or double |
//!
//! Passes lie in the files of the noisy halves, in layers beside the noisy colour, which have the marks of the halves where one file
//! holds both. Rows are read when they are asked for.

mod find;
pub mod names;
mod sums;

use crate::align::Placing;
use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::layers::{Layer, Layers, Reading};
use crate::output::OutputPlan;
use crate::place::{Place, place, place_of_whole};
use crate::resolve::{Filled, Resolution};
use crate::window::Window;
use exr::meta::attribute::SampleType;
use find::{FoundSet, find, others};
use rayon::join;
use sspc_image::{Buffer, HalfWeights, Image, Role, Storage, shown};
use std::ops::Range;
use sums::{Difference, Explanation, Explanations, Part};

/// Rows that are looked at together.
const LOOKED_AT: usize = 64;
/// Layers that may explain a difference, at most.
const MOST_EXPLANATIONS: usize = 48;

/// Which layers are passes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PassSelection {
    /// Those that renderers name so, if they add up.
    Recognised,
    /// One set: the layers of these names, in which `*` stands for any text.
    Named(Vec<String>),
}

/// One pass of a frame.
#[derive(Clone, Debug)]
pub struct OpenPass {
    /// Its layer.
    pub name: String,
    /// R, G, B in half a's and in half b's file.
    channels: [Vec<usize>; 2],
    /// Which of the colours it is multiplied by.
    pub colour: Option<usize>,
    /// How half a's file keeps it.
    given: Storage,
    /// How the output keeps it.
    pub storage: Storage,
}

/// Passes that add up to the noisy colour.
#[derive(Clone, Debug)]
pub struct OpenSet {
    /// What they are, for messages.
    pub what: String,
    /// Which of the passes.
    pub passes: Range<usize>,
    /// What of the colour they lack or have too much of beyond rounding, as a share of it, in the worse half.
    pub difference: f64,
}

/// The additive passes of a frame.
pub struct OpenPasses {
    files: [ExrFile; 2],
    /// How names of half a's layers and of half b's are read.
    readings: [Reading; 2],
    /// What each half weighs.
    weights: HalfWeights,
    /// The noisy colour of half a and of half b.
    noisy: [Filled; 2],
    /// Passes of all sets.
    pub passes: Vec<OpenPass>,
    /// Layers that passes are multiplied by.
    pub colours: Vec<OpenPass>,
    /// The sets.
    pub sets: Vec<OpenSet>,
    /// Alpha of half a and of half b, where it is corrected too, and how it is kept.
    alpha: Option<([usize; 2], Storage)>,
}

/// Some rows of all passes.
pub struct PassImages {
    /// Of half a and of half b, `[3, rows, W]` each, in the order of the passes.
    pub passes: Vec<[Image; 2]>,
    /// What passes are multiplied by, as it will be written: the mean of both halves.
    pub colours: Vec<Image>,
    /// Of half a and of half b, `[1, rows, W]`.
    pub alpha: Option<[Image; 2]>,
}

impl OpenPasses {
    /// Finds the passes of a frame and looks whether they add up; `selection` is `None` where alpha alone is corrected.
    ///
    /// # Errors
    /// [`Error::Passes`]: none found, layers in one half only, of another size, or that do not add up; what reading can raise.
    pub fn open(
        resolution: &Resolution,
        weights: HalfWeights,
        selection: Option<&PassSelection>,
        alpha: bool,
    ) -> Result<Self, Error> {
        let noisy = [Buffer::A, Buffer::B].map(|buffer| resolution.get(Role::Radiance, buffer));
        let [Some(a), Some(b)] = noisy else { unreachable!("resolve() has refused frames without colour") };
        let files = [a, b].map(|filled| resolution.files[filled.file].clone());
        let readings = match a.file == b.file {
            false => [Reading::Plain; 2],
            true => [Reading::Marked(Buffer::A), Reading::Marked(Buffer::B)],
        };
        let mut open = Self {
            files,
            readings,
            weights,
            noisy: [a.clone(), b.clone()],
            passes: Vec::new(),
            colours: Vec::new(),
            sets: Vec::new(),
            alpha: None,
        };
        if let Some(selection) = selection {
            let of_a = |filled: &&Filled| filled.file == a.file && filled.role != Role::Radiance;
            let roles: Vec<usize> =
                resolution.filled.iter().filter(of_a).flat_map(|filled| filled.channels.clone()).collect();
            open.find_sets(selection, &roles)?;
        }
        if alpha && open.is_one_file() {
            return Err(refused(&open.files[0], "a file for each half, for --alpha", "both halves in one file"));
        }
        if alpha {
            open.alpha = Some(open.find_alpha()?);
        }
        Ok(open)
    }

    fn find_sets(&mut self, selection: &PassSelection, roles: &[usize]) -> Result<(), Error> {
        let file = &self.files[0];
        let layers = Layers::of(file);
        let Some(own) = layers.layer_of(self.noisy[0].channels[0]) else { unreachable!("colour is in a layer") };
        if own.name(self.readings[0]).is_none() {
            let expected = "marks of the halves, as in 'beauty_a' and 'beauty_b', where one file holds both";
            return Err(refused(file, expected, &layers.summary()));
        }
        let found = find(file, &layers, own, self.readings[0], roles, selection)?;
        if found.is_empty() {
            let expected = "light groups or lobes beside the noisy colour, by names that are known";
            return Err(refused(file, expected, &layers.summary()));
        }
        let mut sets: Vec<(FoundSet, Vec<OpenPass>, Vec<OpenPass>, f64)> = Vec::new();
        let mut last = None;
        for set in found {
            let (passes, colours) = self.in_both(&set)?;
            let difference = self.difference(&passes, &colours)?;
            let is_known = sets.iter().any(|(known, ..)| known.what == set.what);
            match difference.is_none() {
                true if !is_known => sets.push((set, passes, colours, difference.share())),
                true => {}
                false => {
                    let least = last.as_ref().is_none_or(|(.., least): &(_, _, _, f64)| difference.share() < *least);
                    last = if least { Some((set, passes, colours, difference.share())) } else { last };
                }
            }
        }
        if sets.is_empty() {
            let Some((set, passes, colours, share)) = last else { unreachable!("a set was looked at") };
            return Err(self.does_not_add_up(&set, &passes, &colours, share)?);
        }
        for (set, passes, colours, difference) in sets {
            let (first, first_colour) = (self.passes.len(), self.colours.len());
            // Sets of one frame may share colours, never passes.
            self.passes
                .extend(passes.into_iter().map(|p| OpenPass { colour: p.colour.map(|c| c + first_colour), ..p }));
            self.colours.extend(colours);
            self.sets.push(OpenSet { what: set.what, passes: first..self.passes.len(), difference });
        }
        Ok(())
    }

    /// The passes of a set and their colours in both halves' files.
    fn in_both(&self, set: &FoundSet) -> Result<(Vec<OpenPass>, Vec<OpenPass>), Error> {
        let (mut passes, mut colours): (Vec<OpenPass>, Vec<OpenPass>) = (Vec::new(), Vec::new());
        for pass in &set.passes {
            let colour = match &pass.colour {
                None => None,
                Some((name, channels)) => match colours.iter().position(|colour| colour.name == *name) {
                    Some(known) => Some(known),
                    None => {
                        colours.push(self.both(name, channels, None)?);
                        Some(colours.len() - 1)
                    }
                },
            };
            passes.push(self.both(&pass.name, &pass.channels, colour)?);
        }
        Ok((passes, colours))
    }

    /// A layer of half a with the same channels in half b.
    fn both(&self, name: &str, channels: &[usize], colour: Option<usize>) -> Result<OpenPass, Error> {
        let [a, b] = &self.files;
        let names: Vec<&str> = channels.iter().map(|&at| a.channels[at].name.as_str()).collect();
        let same: Option<Vec<usize>> = match self.is_one_file() {
            true => self.other_mark(channels[0]),
            false => names.iter().map(|name| b.channel_named(name)).collect(),
        };
        let Some(same) = same else {
            let expected = format!("{}, as in half a", shown(&names.join(",")));
            return Err(refused(b, &expected, &Layers::of(b).summary()));
        };
        let channels = [channels.to_vec(), same];
        for ((file, channels), noisy) in self.files.iter().zip(&channels).zip(&self.noisy) {
            let like = file.channels[noisy.channels[0]].window;
            if let Some(other) = channels.iter().map(|&at| file.channels[at].window).find(|window| *window != like) {
                return Err(refused(
                    file,
                    &format!("{like} in {}, as the noisy colour", shown(name)),
                    &other.to_string(),
                ));
            }
        }
        let given = self.storage(&channels[0]);
        let storage = if self.place(&channels[0])?.were_half { Storage::Half } else { Storage::Float };
        Ok(OpenPass { name: name.to_string(), channels, colour, given, storage })
    }

    /// R, G, B of the layer that is named as that of a channel of half a, but for the mark, in a file of both halves.
    fn other_mark(&self, channel: usize) -> Option<Vec<usize>> {
        let layers = Layers::of(&self.files[0]);
        let [of_a, of_b] = self.readings;
        let name = layers.layer_of(channel)?.name(of_a)?;
        let view = layers.layer_of(self.noisy[1].channels[0])?.view;
        let is_same = |layer: &&Layer| layer.view == view && layer.name(of_b) == Some(name);
        layers.list.iter().filter(is_same).find_map(|layer| layer.channels_for(Role::Radiance))
    }

    /// Half floats where all of these channels are.
    fn storage(&self, channels: &[usize]) -> Storage {
        let file = &self.files[0];
        let is_half = |&at: &usize| {
            let channel = &file.channels[at];
            file.container.parts[channel.part].channels[channel.index].kind == SampleType::F16
        };
        if channels.iter().all(is_half) { Storage::Half } else { Storage::Float }
    }

    fn find_alpha(&self) -> Result<([usize; 2], Storage), Error> {
        let alpha = |h: usize| {
            let file = &self.files[h];
            let own = file.channels[self.noisy[h].channels[0]].clone();
            let (layer, _) = own.name.rsplit_once('.').unwrap_or(("", &own.name));
            let named = |end: &str| if layer.is_empty() { end.to_string() } else { format!("{layer}.{end}") };
            let hit = ["A", "alpha"].into_iter().find_map(|end| file.channel_named(&named(end)));
            let hit = hit.filter(|&at| file.channels[at].window == own.window);
            hit.ok_or_else(|| refused(file, &format!("{} for --alpha", named("A")), &Layers::of(file).summary()))
        };
        let channels = [alpha(0)?, alpha(1)?];
        Ok((channels, self.storage(&channels[..1])))
    }

    /// Rows of the frame.
    pub fn height(&self) -> usize {
        self.noisy[0].window.height
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.noisy[0].window.width
    }

    /// How alpha is kept, where it is corrected.
    pub fn alpha_storage(&self) -> Option<Storage> {
        self.alpha.map(|(_, storage)| storage)
    }

    /// Some rows of all passes.
    ///
    /// # Errors
    /// [`Error::Damaged`] and what else reading a file can raise.
    pub fn rows(&self, rows: Range<usize>) -> Result<PassImages, Error> {
        let groups = |h: usize| -> Vec<Vec<usize>> {
            let layers = self.passes.iter().chain(&self.colours).map(|layer| layer.channels[h].clone());
            layers.chain(self.alpha.map(|(channels, _)| vec![channels[h]])).collect()
        };
        let [mut a, mut b] = self.both_rows([groups(0), groups(1)], &rows)?;
        let alpha = self.alpha.and_then(|_| a.pop().zip(b.pop())).map(|(a, b)| [a, b]);
        let colours = a.drain(self.passes.len()..).zip(b.drain(self.passes.len()..));
        let mean = |(at, (a, b)): (usize, (Image, Image))| {
            let mut mean = self.weights.mean_of(&a, &b);
            let storage = self.colours[at].storage;
            mean.for_each_row(|_, _, row| row.iter_mut().for_each(|v| *v = storage.round(f64::from(*v))));
            mean
        };
        let colours = colours.enumerate().map(mean).collect();
        let passes = a.into_iter().zip(b).map(|(a, b)| [a, b]).collect();
        Ok(PassImages { passes, colours, alpha })
    }

    /// Some rows of one pass, of half a and of half b.
    ///
    /// # Errors
    /// As [`Self::rows`].
    ///
    /// # Panics
    /// When there is no such pass.
    pub fn rows_of(&self, pass: usize, rows: Range<usize>) -> Result<[Image; 2], Error> {
        self.rows_of_layer(&self.passes[pass], rows)
    }

    /// Some rows of one of the colours that passes are multiplied by, of half a and of half b.
    ///
    /// # Errors
    /// As [`Self::rows`].
    ///
    /// # Panics
    /// When there is no such colour.
    pub fn rows_of_colour(&self, colour: usize, rows: Range<usize>) -> Result<[Image; 2], Error> {
        self.rows_of_layer(&self.colours[colour], rows)
    }

    fn rows_of_layer(&self, layer: &OpenPass, rows: Range<usize>) -> Result<[Image; 2], Error> {
        let groups = [0, 1].map(|h| vec![layer.channels[h].clone()]);
        let [mut a, mut b] = self.both_rows(groups, &rows)?;
        Ok([a.remove(0), b.remove(0)])
    }

    fn both_rows(&self, groups: [Vec<Vec<usize>>; 2], rows: &Range<usize>) -> Result<[Vec<Image>; 2], Error> {
        let [of_a, of_b] = groups;
        let read = |h: usize, groups: Vec<Vec<usize>>| {
            let window: Window = self.noisy[h].window.rows(rows.clone());
            self.files[h].windows(&groups.into_iter().map(|group| (group, window)).collect::<Vec<_>>())
        };
        let (a, b) = join(|| read(0, of_a), || read(1, of_b));
        Ok([a?, b?])
    }

    /// Calls `look` with rows of the noisy colour, of passes, of their colours and of other layers, half after half.
    fn look(&self, layers: [&[OpenPass]; 3], mut look: impl FnMut(usize, &Image, [&[Image]; 3])) -> Result<(), Error> {
        let [passes, colours, _] = layers;
        let groups = [0, 1].map(|h| -> Vec<Vec<usize>> {
            let of = layers.iter().flat_map(|layers| layers.iter()).map(|layer| layer.channels[h].clone());
            [self.noisy[h].channels.clone()].into_iter().chain(of).collect()
        });
        for top in (0..self.height()).step_by(LOOKED_AT) {
            let rows = top..(top + LOOKED_AT).min(self.height());
            for (h, images) in self.both_rows(groups.clone(), &rows)?.into_iter().enumerate() {
                let (noisy, rest) = images.split_at(1);
                let (of_passes, rest) = rest.split_at(passes.len());
                let (of_colours, others) = rest.split_at(colours.len());
                look(h, &noisy[0], [of_passes, of_colours, others]);
            }
        }
        Ok(())
    }

    /// How far the passes are from the noisy colour, in the worse half.
    fn difference(&self, passes: &[OpenPass], colours: &[OpenPass]) -> Result<Difference, Error> {
        let mut differences = [Difference::default(); 2];
        let storage = self.storage(&self.noisy[0].channels);
        self.look([passes, colours, &[]], |h, noisy, [images, of_colours, _]| {
            differences[h].look(noisy, storage, &parts(passes, images, of_colours));
        })?;
        let [a, b] = differences;
        Ok(if a.share() >= b.share() { a } else { b })
    }

    /// The refusal of a set, with what is missing or double where one layer explains most of the difference.
    fn does_not_add_up(
        &self,
        set: &FoundSet,
        passes: &[OpenPass],
        colours: &[OpenPass],
        share: f64,
    ) -> Result<Error, Error> {
        let file = &self.files[0];
        let layers = Layers::of(file);
        let own = layers.layer_of(self.noisy[0].channels[0]);
        let is_used = |name: &str| passes.iter().chain(colours).any(|layer| layer.name == name);
        let others = own.map(|own| others(&layers, own, self.readings[0])).unwrap_or_default();
        let others: Vec<OpenPass> = others
            .into_iter()
            .map(|other| other.layer)
            .filter(|layer| !is_used(&layer.path))
            .filter_map(|layer| self.both(&layer.path, &layer.channels_for(Role::Radiance)?, None).ok())
            .take(MOST_EXPLANATIONS)
            .collect();
        let mut explanations = Explanations::new(others.len(), passes.len());
        self.look([passes, colours, &others], |_, noisy, [images, of_colours, of_others]| {
            explanations.look(noisy, &parts(passes, images, of_colours), &parts(&others, of_others, &[]));
        })?;
        let why = match explanations.best() {
            Some(Explanation::Missing(at)) => format!("; {} is missing", shown(&others[at].name)),
            Some(Explanation::Double(at)) => format!("; {} is counted twice", shown(&passes[at].name)),
            None => String::new(),
        };
        let names: Vec<String> = passes.iter().map(|pass| shown(&pass.name)).collect();
        let expected = format!("{} that add up to the noisy colour", set.what);
        let found = format!("{:.2} % of it missing or too much in {}{why}", 100.0 * share, names.join(" + "));
        Ok(refused(file, &expected, &found))
    }

    /// Where a layer goes.
    fn place(&self, channels: &[usize]) -> Result<Place, Error> {
        match self.is_one_file() {
            true => place_of_whole(&self.files[0], channels),
            false => Ok(place(&self.files[0], channels)),
        }
    }

    /// Whether one file holds both halves.
    fn is_one_file(&self) -> bool {
        self.readings[0] != Reading::Plain
    }

    /// Where the passes, their colours and alpha go, in this order: in the place of half a's, or of both together where one
    /// file holds both.
    ///
    /// # Errors
    /// As [`OutputPlan::of_frame`].
    pub fn output(&self) -> Result<OutputPlan, Error> {
        let file = &self.files[0];
        let noisy = &self.noisy[0];
        let display = Placing::of(file, noisy.channels[0]).display;
        let placing = Placing { window: noisy.window, display };
        let layers = self.passes.iter().chain(&self.colours).map(|layer| self.place(&layer.channels[0]));
        let alpha = self.alpha.map(|(channels, _)| Ok(place(file, &channels[..1])));
        OutputPlan::of_places(file, layers.chain(alpha).collect::<Result<_, _>>()?, placing)
    }
}

fn parts<'a>(layers: &[OpenPass], images: &'a [Image], colours: &'a [Image]) -> Vec<Part<'a>> {
    let part = |(layer, pass): (&OpenPass, &'a Image)| Part {
        pass,
        colour: layer.colour.map(|at| &colours[at]),
        storage: layer.given,
    };
    layers.iter().zip(images).map(part).collect()
}

fn refused(file: &ExrFile, expected: &str, found: &str) -> Error {
    Error::Passes { path: file.path.clone(), expected: expected.into(), found: found.into() }
}
