//! A file's channels as layers: names up to the last dot, taken apart.

use crate::exr_file::{Channel, ExrFile};
use crate::halves::split_half;
use crate::names;
use sspc_image::{Buffer, Role, shown};

/// Channels that share one name up to the last dot.
#[derive(Clone, Debug)]
pub struct Layer {
    /// As in the file, without leading dots.
    pub path: String,
    /// The part that holds it.
    pub part: usize,
    /// Which of the file's views; 0 is the default, and that of files without views.
    pub view: usize,
    /// What the name says.
    plain: Name,
    /// What it says apart from a mark of a half, and the mark.
    unmarked: Name,
    half: Option<Buffer>,
    /// The first part's own channels, unnamed but for the part.
    pub first_part: bool,
    /// Lower-case endings and the channel each stands for.
    components: Vec<(String, usize)>,
}

/// A layer's name in lower case, without the view.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Name {
    /// Everything before the last segment: the view layer, or the layer that it was made of.
    pub group: String,
    /// The last segment; empty for channels at the root.
    pub last: String,
}

/// How names are read, with regard to marks of halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Marks mean nothing: each half has a file.
    Plain,
    /// Layers without a mark.
    Unmarked,
    /// Layers with the mark of this half, by their names without it.
    Marked(Buffer),
}

impl Name {
    fn of(path: &str) -> Self {
        let path = path.to_lowercase();
        let (group, last) = path.rsplit_once('.').unwrap_or(("", &path));
        Self { group: group.into(), last: last.into() }
    }

    /// Group and last segment.
    pub fn whole(&self) -> String {
        if self.group.is_empty() { self.last.clone() } else { format!("{}.{}", self.group, self.last) }
    }
}

impl Layer {
    /// The name under this reading; `None` where the reading passes the layer over.
    pub fn name(&self, reading: Reading) -> Option<&Name> {
        match (reading, self.half) {
            (Reading::Plain, _) | (Reading::Unmarked, None) => Some(&self.plain),
            (Reading::Marked(wanted), Some(half)) if wanted == half => Some(&self.unmarked),
            _ => None,
        }
    }

    /// The name as it is.
    pub fn plain(&self) -> &Name {
        &self.plain
    }

    /// The name without a mark.
    pub fn unmarked(&self) -> &Name {
        &self.unmarked
    }

    /// The channels that make up a role, by their endings.
    pub fn channels_for(&self, role: Role) -> Option<Vec<usize>> {
        let find = |ending: &&str| self.components.iter().find(|(known, _)| known == ending).map(|&(_, at)| at);
        let by_ending = names::component_sets(role).iter().find_map(|set| set.iter().map(find).collect());
        let only = || match (role, self.components.as_slice()) {
            (Role::Visibility, [(_, at)]) => Some(vec![*at]),
            _ => None,
        };
        by_ending.or_else(only)
    }

    /// The only channel of a grey layer, three times.
    pub fn grey_channels(&self) -> Option<Vec<usize>> {
        let is_colour = |(ending, _): &&(String, usize)| ending != "a" && ending != "alpha";
        let mut colours = self.components.iter().filter(is_colour);
        match (colours.next(), colours.next()) {
            (Some((ending, at)), None) if names::GREY.contains(&ending.as_str()) => Some(vec![*at; 3]),
            _ => None,
        }
    }

    /// Its channel, if it has but one, of this ending.
    pub fn only_channel(&self, ending: Option<&str>) -> Option<usize> {
        match self.components.as_slice() {
            [(known, at)] if ending.is_none_or(|ending| ending == known) => Some(*at),
            _ => None,
        }
    }

    /// Whether one of its components is this channel.
    pub fn holds(&self, channel: usize) -> bool {
        self.components.iter().any(|(_, at)| *at == channel)
    }

    /// Path and components, for messages.
    pub fn summary(&self) -> String {
        let endings: Vec<&str> = self.components.iter().map(|(ending, _)| ending.as_str()).collect();
        match self.path.is_empty() {
            true => shown(&endings.join(",").to_uppercase()),
            false => format!("{} ({})", shown(&self.path), shown(&endings.join(","))),
        }
    }
}

/// The layers of a file, in file order.
pub struct Layers {
    /// All of them.
    pub list: Vec<Layer>,
    /// Names of the file's views.
    pub views: Vec<String>,
    /// What else is there and cannot be decoded.
    undecodable: Vec<String>,
}

impl Layers {
    /// Groups the channels of a file.
    pub fn of(file: &ExrFile) -> Self {
        let mut list: Vec<Layer> = Vec::new();
        for (at, channel) in file.channels.iter().enumerate() {
            let (path, ending) = split_channel(&channel.name);
            let component = (ending.to_lowercase(), at);
            match list.iter_mut().find(|layer| layer.path == path && layer.part == channel.part) {
                Some(layer) => layer.components.push(component),
                None => list.push(new_layer(file, channel, path, component)),
            }
        }
        Self { list, views: file.views.clone(), undecodable: file.undecodable.clone() }
    }

    /// The layer that a channel is of.
    pub fn layer_of(&self, channel: usize) -> Option<&Layer> {
        self.list.iter().find(|layer| layer.holds(channel))
    }

    /// What is there, for messages.
    pub fn summary(&self) -> String {
        const MOST: usize = 16;
        let mut words: Vec<String> = self.list.iter().take(MOST).map(Layer::summary).collect();
        if self.list.len() > MOST {
            words.push(format!("and {} more", self.list.len() - MOST));
        }
        words.extend(self.undecodable.iter().take(MOST).cloned());
        if words.is_empty() { "no channels".to_string() } else { words.join("; ") }
    }
}

/// Splits at the last dot; names without one may still carry a layer: `Nsx`, `visibilityA`.
fn split_channel(name: &str) -> (String, String) {
    let name = name.trim_start_matches('.');
    if let Some((path, ending)) = name.rsplit_once('.') {
        return (path.to_string(), ending.to_string());
    }
    let goes_by = |text: &str, role: Role| {
        names::candidates(role).iter().any(|known| known.pattern.stem(&text.to_lowercase()).is_some())
    };
    if goes_by(&split_half(name).0, Role::Visibility) {
        return (name.to_string(), "Y".to_string());
    }
    let split = name.char_indices().last().filter(|(at, c)| *at > 0 && "xyzXYZ".contains(*c));
    match split {
        Some((at, _)) if goes_by(&name[..at], Role::Normal) => (name[..at].to_string(), name[at..].to_string()),
        _ => (String::new(), name.to_string()),
    }
}

fn new_layer(file: &ExrFile, channel: &Channel, path: String, component: (String, usize)) -> Layer {
    let part = channel.part;
    let view_of = |text: &str| file.views.iter().position(|view| view.eq_ignore_ascii_case(text));
    let mut view = file.part_views[part].as_deref().and_then(view_of);
    let mut kept = Vec::new();
    for segment in path.split('.').filter(|segment| !segment.is_empty()) {
        match view_of(segment) {
            Some(named) => view = view.or(Some(named)),
            None => kept.push(segment),
        }
    }
    let path_without_view = kept.join(".");
    let (unmarked, half) = split_half(&path_without_view);
    let multi = file.part_views.len() > 1;
    // The dots of a part's name make no layer.
    let is_unnamed = !file.container.parts[part].channels[channel.index].text().contains('.');
    Layer {
        first_part: multi && part == 0 && (is_unnamed || !path.contains('.')),
        part,
        view: view.unwrap_or(0),
        plain: Name::of(&path_without_view),
        unmarked: Name::of(&unmarked),
        half,
        path,
        components: vec![component],
    }
}
