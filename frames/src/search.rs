//! The search for a role among the layers of a file. Once the noisy colour is chosen, all other roles are looked for
//! beside it: in its own view, of its own view layer, named after it.

use crate::layers::{Layer, Layers, Name, Reading};
use crate::names::{self, NamePattern, is_colour, noisy_stem};
use sspc_image::{Buffer, Role, shown};

/// The channels found for a role, in component order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hit {
    pub channels: Vec<usize>,
    /// Paths of further layers that go by the same name, not taken.
    pub passed_over: Vec<String>,
    /// Taken from beside the noisy colour's own layer.
    pub is_elsewhere: bool,
}

impl Hit {
    /// Channels that somebody named.
    pub fn of(channels: Vec<usize>) -> Self {
        Self { channels, passed_over: Vec::new(), is_elsewhere: false }
    }
}

/// What a search ended with.
#[derive(Clone, Debug, Default)]
pub struct Found {
    pub hit: Option<Hit>,
    /// Paths of layers that would do but belong to another layer.
    pub foreign: Vec<String>,
}

/// Where the noisy colour is: what other roles are looked for beside.
#[derive(Clone, Debug)]
pub struct Anchor {
    pub view: usize,
    pub name: Name,
    pub part: usize,
    pub reading: Reading,
    /// It is the picture of its view layer, not one light of it.
    is_main: bool,
    /// One channel stands for all three.
    pub is_grey: bool,
}

/// How far a layer is from the anchor; the derived order is the order of preference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Distance {
    /// Named after it, or below it.
    Own,
    /// In its view layer.
    Beside,
    /// Below its view layer.
    Below,
    /// Outside of view layers, while the anchor is in one.
    Outside,
    /// In the only view layer, while the anchor is in none.
    OnlyOne,
    /// Of another layer.
    Foreign,
}

impl Layers {
    /// The noisy colour of a view.
    pub fn noisy_colour(&self, reading: Reading, view: usize) -> Option<Hit> {
        let by_name = |channels: fn(&Layer) -> Option<Vec<usize>>| {
            let noisy = names::noisy().iter().map(|known| known.pattern);
            let colour = names::candidates(Role::Radiance).iter().map(|known| known.pattern);
            noisy.chain(colour).find_map(|pattern| self.first(reading, view, pattern, channels))
        };
        let first_part = || {
            let mut plain = self.list.iter().filter(|layer| layer.first_part && layer.view == view);
            let layer = plain.find(|layer| layer.name(reading).is_some())?;
            layer.channels_for(Role::Radiance).map(Hit::of)
        };
        by_name(|layer| layer.channels_for(Role::Radiance))
            .or_else(first_part)
            .or_else(|| by_name(Layer::grey_channels))
    }

    /// The colour that a viewer shows: the root's, Cycles' `Combined`, or what colour goes by.
    pub fn shown_colour(&self) -> Option<Hit> {
        let by_name = |reading: Reading, channels: fn(&Layer) -> Option<Vec<usize>>| {
            let colour = names::candidates(Role::Radiance).iter().chain(names::noisy());
            colour.map(|known| known.pattern).find_map(|pattern| self.first(reading, 0, pattern, channels))
        };
        let first_part = || self.list.iter().find(|layer| layer.first_part)?.channels_for(Role::Radiance).map(Hit::of);
        by_name(Reading::Unmarked, |layer| layer.channels_for(Role::Radiance))
            .or_else(first_part)
            .or_else(|| by_name(Reading::Unmarked, Layer::grey_channels))
            .or_else(|| {
                by_name(Reading::Plain, |layer| layer.channels_for(Role::Radiance)).filter(|_| !self.is_halved())
            })
    }

    /// The only noisy colour of a file; `None` where it has one of each half.
    pub fn whole_colour(&self) -> Option<Hit> {
        let plain = || self.noisy_colour(Reading::Plain, 0).filter(|_| !self.is_halved());
        self.noisy_colour(Reading::Unmarked, 0).or_else(plain)
    }

    /// Whether names are marked as those of both halves. One mark alone is a part of a name.
    fn is_halved(&self) -> bool {
        [Buffer::A, Buffer::B].iter().all(|half| self.noisy_colour(Reading::Marked(*half), 0).is_some())
    }

    /// Where these channels are.
    pub fn anchor(&self, channels: &[usize], reading: Reading) -> Option<Anchor> {
        let layer = self.layer_of(*channels.first()?)?;
        let name = layer.name(reading).unwrap_or_else(|| match reading {
            Reading::Marked(_) => layer.unmarked(),
            _ => layer.plain(),
        });
        let is_named = is_colour(&name.last) || noisy_stem(&name.last).is_some();
        let is_rival = |other: &&Layer| {
            let colour = other.name(reading).is_some_and(|n| n.group == name.group && is_colour(&n.last));
            colour
                && other.view == layer.view
                && other.path != layer.path
                && other.channels_for(Role::Radiance).is_some()
        };
        let is_main = is_named || !self.list.iter().any(|other| is_rival(&other));
        let is_grey = channels.len() > 1 && channels.iter().all(|channel| *channel == channels[0]);
        Some(Anchor { view: layer.view, name: name.clone(), part: layer.part, reading, is_main, is_grey })
    }

    /// The channels of `role` that belong to the noisy colour at `anchor`, among layers of this reading.
    pub fn beside(&self, role: Role, reading: Reading, anchor: &Anchor) -> Found {
        let mut all: Vec<(Distance, usize, bool, &Layer, Vec<usize>)> = Vec::new();
        for layer in self.list.iter().filter(|layer| layer.view == anchor.view) {
            let Some(name) = layer.name(reading) else { continue };
            let is_anchor = *name == anchor.name && layer.part == anchor.part && reading == anchor.reading;
            let channels = layer
                .channels_for(role)
                .or_else(|| layer.grey_channels().filter(|_| role == Role::Denoised && anchor.is_grey));
            let (Some(channels), false) = (channels, is_anchor) else { continue };
            if let Some((rank, distance)) = self.standing(role, name, anchor, reading) {
                all.push((distance, rank, layer.part != anchor.part, layer, channels));
            }
        }
        let groups: std::collections::BTreeSet<&str> = all
            .iter()
            .filter(|found| found.0 == Distance::OnlyOne)
            .filter_map(|found| found.3.name(reading).map(|name| name.group.as_str()))
            .collect();
        let is_foreign =
            |distance: Distance| distance == Distance::Foreign || (distance == Distance::OnlyOne && groups.len() > 1);
        let path = |layer: &Layer| layer.path.clone();
        let foreign = all.iter().filter(|found| is_foreign(found.0)).map(|found| path(found.3)).collect();
        let mut own: Vec<_> = all.into_iter().filter(|found| !is_foreign(found.0)).collect();
        own.sort_by_key(|found| (found.0, found.1, found.2));
        let mut own = own.into_iter();
        let hit = own.next().map(|(distance, rank, _, _, channels)| Hit {
            channels,
            passed_over: own.filter(|o| (o.0, o.1) == (distance, rank)).map(|o| path(o.3)).collect(),
            is_elsewhere: distance >= Distance::Outside,
        });
        Found { hit, foreign }
    }

    /// Rank among the names of a role and distance of a layer; `None` when it does not go by such a name.
    fn standing(&self, role: Role, name: &Name, anchor: &Anchor, reading: Reading) -> Option<(usize, Distance)> {
        let of_noisy = noisy_stem(&anchor.name.last);
        if role == Role::Denoised
            && let Some(stem) = of_noisy
        {
            // Where something says that it is noisy, the layer without that word is the denoised one.
            let shown = is_colour(&name.last) && (stem.is_empty() || stem == name.last);
            if shown {
                return Some((0, distance(name, anchor)));
            }
        }
        let known = names::candidates(role);
        let rank = known.iter().position(|known| known.pattern.stem(&name.last).is_some())?;
        let stem = known[rank].pattern.stem(&name.last)?;
        let at = 1 + rank;
        if role != Role::Denoised || matches!(known[rank].pattern, NamePattern::Starts(_)) {
            return Some((at, distance(name, anchor)));
        }
        let own = stem == anchor.name.last || of_noisy == Some(stem);
        let distance = match stem {
            _ if own && !stem.is_empty() && name.group == anchor.name.group => Distance::Own,
            // A name without another layer's: the picture's.
            "" if anchor.is_main || name.group == anchor.name.whole() => distance(name, anchor),
            "" => Distance::Foreign,
            _ if own => distance(name, anchor),
            _ if is_colour(stem) && anchor.is_main && is_colour(&anchor.name.last) => distance(name, anchor),
            _ => self.named_after_another(stem, name, anchor, reading),
        };
        Some((at, distance))
    }

    /// A denoised layer that is named after something that is not the anchor.
    fn named_after_another(&self, stem: &str, name: &Name, anchor: &Anchor, reading: Reading) -> Distance {
        let is_stem = |layer: &Layer| layer.name(reading).is_some_and(|n| n.last == stem && n.group == name.group);
        // `RGBA_key` is the light group key of RGBA.
        let of_light = names::candidates(Role::Radiance).iter().any(|known| match known.pattern {
            NamePattern::Whole(colour) if !colour.is_empty() => {
                stem.strip_prefix(colour).is_some_and(|rest| rest.starts_with(['_', '-', ' ']))
            }
            _ => false,
        });
        match anchor.is_main && !of_light && !self.list.iter().any(is_stem) {
            true => distance(name, anchor).max(Distance::Outside),
            false => Distance::Foreign,
        }
    }

    /// The channels of a file that holds nothing but `role`: by its names, as the noisy colour is named, as plain colour,
    /// or the only layer.
    pub fn dedicated(&self, role: Role, reading: Reading, like: Option<&Name>, view: usize) -> Option<Hit> {
        let channels = |layer: &Layer| layer.channels_for(role);
        let by_names = |reading: Reading, of: Role| {
            let known = names::candidates(of).iter().map(|known| known.pattern);
            known.into_iter().find_map(|pattern| self.first(reading, view, pattern, channels))
        };
        let beside = || {
            let anchor = self.noisy_colour(Reading::Plain, view)?;
            self.beside(role, Reading::Plain, &self.anchor(&anchor.channels, Reading::Plain)?).hit
        };
        let like = || {
            let same = |layer: &&Layer| like.is_some() && layer.name(Reading::Plain) == like && layer.view == view;
            self.list.iter().find(same).and_then(channels).map(Hit::of)
        };
        let only = || {
            let mut usable = self.list.iter().filter_map(|layer| channels(layer).or_else(|| layer.grey_channels()));
            usable.next().filter(|_| usable.next().is_none()).map(Hit::of)
        };
        beside()
            .or_else(|| by_names(Reading::Plain, role))
            .or_else(|| by_names(reading, role))
            .or_else(like)
            .or_else(|| by_names(Reading::Unmarked, Role::Radiance))
            .or_else(|| by_names(Reading::Plain, Role::Radiance).filter(|_| !self.is_halved()))
            .or_else(only)
    }

    /// The components of `role` in the layer that the user named: the whole path first, then its ending.
    /// One component does where `may_be_grey`.
    pub fn named(&self, name: &str, role: Role, view: usize, may_be_grey: bool) -> Option<Hit> {
        let name = name.trim_start_matches('.').to_lowercase();
        let ending = format!(".{name}");
        let matches = |layer: &Layer, test: &dyn Fn(&str) -> bool| {
            test(&layer.path.to_lowercase()) || (layer.view == view && test(&layer.plain().whole()))
        };
        let whole = self.list.iter().find(|layer| matches(layer, &|path| path == name));
        let layer = whole.or_else(|| self.list.iter().find(|layer| matches(layer, &|path| path.ends_with(&ending))))?;
        layer.channels_for(role).or_else(|| layer.grey_channels().filter(|_| may_be_grey)).map(Hit::of)
    }

    /// A motion layer's channels, with those of the layer beside it that leads to the other neighbour.
    pub fn with_motion_partner(&self, mut hit: Hit, reading: Reading) -> Hit {
        let partner = || {
            let layer = self.layer_of(*hit.channels.first()?)?;
            let name = layer.name(reading).or_else(|| layer.name(Reading::Plain))?;
            let wanted = Name { group: name.group.clone(), last: names::motion_partner(&name.last)?.to_string() };
            let is_it = |other: &&Layer| other.view == layer.view && other.name(reading) == Some(&wanted);
            self.list.iter().find(is_it)?.channels_for(Role::Motion)
        };
        let partner = partner();
        if hit.channels.len() == 2 {
            hit.channels.extend(partner.filter(|channels| channels.len() == 2).unwrap_or_default());
        }
        hit
    }

    fn first(
        &self,
        reading: Reading,
        view: usize,
        pattern: NamePattern,
        channels: impl Fn(&Layer) -> Option<Vec<usize>>,
    ) -> Option<Hit> {
        let matches = |layer: &&Layer| {
            let stem = layer.name(reading).filter(|_| layer.view == view).and_then(|name| match pattern {
                // The root layer has no group either.
                NamePattern::Whole("") => Some("").filter(|_| name.last.is_empty()),
                pattern => pattern.stem(&name.last),
            });
            stem.is_some_and(|stem| stem.is_empty() || is_colour(stem))
        };
        let mut hits = self.list.iter().filter(matches).filter_map(|layer| Some((layer, channels(layer)?)));
        let (_, found) = hits.next()?;
        let passed_over = hits.map(|(layer, _)| layer.path.clone()).collect();
        Some(Hit { channels: found, passed_over, is_elsewhere: false })
    }

    /// A layer, or channels, by which a role that was not found could be meant, for a proposal; `name_of` a channel's
    /// number is its full name.
    pub fn nearest(&self, role: Role, anchor: Option<&Anchor>, name_of: &dyn Fn(usize) -> String) -> Option<String> {
        let words: &[&str] = match role {
            Role::Radiance => &["noisy", "beauty", "rgb", "color", "colour"],
            Role::Denoised => &["denois", "filter", "clean", "oidn", "optix"],
            Role::Albedo => &["albedo", "basecolor", "diffuse", "diffcol", "texture"],
            Role::Normal => &["normal", "norm", "nrm"],
            Role::Visibility => &["visib", "shadow"],
            Role::Motion => &["motion", "vector", "velocity"],
            Role::Position => &["position", "world"],
            Role::Dx => &["dx", "gradient"],
            Role::Dy => &["dy", "gradient"],
        };
        let usable = |layer: &&Layer| {
            anchor.is_none_or(|anchor| layer.view == anchor.view && layer.name(anchor.reading) != Some(&anchor.name))
                && !layer.path.is_empty()
                && layer.channels_for(role).is_some()
        };
        let near = |word: &&str| {
            let has = |layer: &&Layer| layer.path.to_lowercase().contains(*word);
            self.list.iter().filter(usable).find(has)
        };
        let is_colour = matches!(role, Role::Radiance | Role::Denoised);
        let colour = || self.list.iter().find(usable).filter(|_| is_colour);
        let layer = words.iter().find_map(near).or_else(colour).map(|layer| layer.path.clone());
        let by_channels = || {
            let names: Vec<String> = self.scattered_colour()?.into_iter().map(name_of).collect();
            Some(names.join(","))
        };
        layer.or_else(|| by_channels().filter(|_| role == Role::Radiance)).map(|source| shown(&source))
    }

    /// R, G and B in layers or parts of their own, or the file's only channel.
    fn scattered_colour(&self) -> Option<[usize; 3]> {
        let only = |ending: &str| self.list.iter().find_map(|layer| layer.only_channel(Some(ending)));
        match (only("r"), only("g"), only("b"), self.list.as_slice()) {
            (Some(r), Some(g), Some(b), _) => Some([r, g, b]),
            (.., [layer]) => layer.only_channel(None).map(|channel| [channel; 3]),
            _ => None,
        }
    }
}

fn distance(name: &Name, anchor: &Anchor) -> Distance {
    let Name { group, .. } = &anchor.name;
    let below = |upper: &str| name.group.strip_prefix(upper).is_some_and(|rest| rest.starts_with('.'));
    let whole = anchor.name.whole();
    if !whole.is_empty() && (name.group == whole || below(&whole)) {
        Distance::Own
    } else if name.group == *group {
        Distance::Beside
    } else if group.is_empty() {
        Distance::OnlyOne
    } else if below(group) {
        Distance::Below
    } else if name.group.is_empty() || group.strip_prefix(name.group.as_str()).is_some_and(|rest| rest.starts_with('.'))
    {
        Distance::Outside
    } else {
        Distance::Foreign
    }
}
