//! A file's channels as layers, and the search for a role among them.

use crate::exr_file::ExrFile;
use crate::names::{self, COMBINED, NOISY_IMAGE, Pattern, split_half};
use sspc_image::{Buffer, Role, shown};

/// Channels that share one name up to the last dot.
#[derive(Clone, Debug)]
pub struct Layer {
    /// As in the file, without leading dots.
    pub path: String,
    /// Lower-case path without the mark of a half and without the default view.
    pub base: String,
    /// Which half the name says it belongs to.
    pub half: Option<Buffer>,
    /// A view of a stereo file that is not the default one.
    pub other_view: bool,
    /// The first part's own channels, unnamed but for the part.
    pub first_part: bool,
    /// Lower-case endings and the channel each stands for.
    components: Vec<(String, usize)>,
}

/// The channels found for a role, in component order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hit {
    pub channels: Vec<usize>,
    /// Paths of further layers of the same name (another view layer), not taken.
    pub passed_over: Vec<String>,
}

/// The layers of a file, in file order.
pub struct Layers {
    list: Vec<Layer>,
}

impl Layers {
    /// Groups the channels of a file.
    pub fn of(file: &ExrFile) -> Self {
        let mut list: Vec<Layer> = Vec::new();
        let mut parts: Vec<usize> = Vec::new();
        for (at, channel) in file.channels.iter().enumerate() {
            let (path, ending) = split_channel(&channel.name);
            let known = list.iter().zip(&parts).position(|(layer, &part)| layer.path == path && part == channel.part);
            let component = (ending.to_ascii_lowercase(), at);
            match known {
                Some(layer) => list[layer].components.push(component),
                None => {
                    list.push(new_layer(file, channel.part, path, component));
                    parts.push(channel.part);
                }
            }
        }
        Self { list }
    }

    /// The channels of `role` among the layers marked with `half` (unmarked ones for `None`).
    pub fn find(&self, role: Role, half: Option<Buffer>) -> Option<Hit> {
        let has_noisy = self.matching(NOISY_IMAGE, half, role).next().is_some();
        let first = (role == Role::Denoised && has_noisy).then_some(COMBINED);
        self.first_hit(first.into_iter().chain(names::candidates(role).iter().copied()), half, role)
            .or_else(|| self.first_part(role, half))
    }

    /// The colour that a viewer shows: the root's, Cycles' `Combined`, or what radiance goes by.
    pub fn find_picture(&self) -> Option<Hit> {
        let patterns =
            [Pattern::Whole(""), COMBINED].into_iter().chain(names::candidates(Role::Radiance).iter().copied());
        self.first_hit(patterns, None, Role::Radiance).or_else(|| self.first_part(Role::Radiance, None))
    }

    /// The channels of a file that holds nothing but `role`: by its names, as plain colour, or the only layer.
    pub fn find_dedicated(&self, role: Role, half: Option<Buffer>) -> Option<Hit> {
        let marked = half.and_then(|half| self.find(role, Some(half)));
        let by_name = self.find(role, None).or(marked);
        by_name.or_else(|| self.first_hit(names::candidates(Role::Radiance).iter().copied(), None, role)).or_else(
            || {
                let mut usable = self.list.iter().filter_map(|layer| layer.channels_for(role));
                let only = usable.next().filter(|_| usable.next().is_none())?;
                Some(Hit { channels: only, passed_over: Vec::new() })
            },
        )
    }

    /// The components of `role` in the layer that the user named: the whole path first, then its ending.
    pub fn find_named(&self, name: &str, role: Role) -> Option<Hit> {
        let name = name.trim_start_matches('.').to_ascii_lowercase();
        let ending = format!(".{name}");
        let whole = self.list.iter().find(|layer| layer.path.to_ascii_lowercase() == name);
        let layer =
            whole.or_else(|| self.list.iter().find(|layer| layer.path.to_ascii_lowercase().ends_with(&ending)))?;
        Some(Hit { channels: layer.channels_for(role)?, passed_over: Vec::new() })
    }

    /// What is there, for messages.
    pub fn summary(&self) -> String {
        const MOST: usize = 16;
        let mut words: Vec<String> = self.list.iter().take(MOST).map(Layer::summary).collect();
        if self.list.len() > MOST {
            words.push(format!("and {} more", self.list.len() - MOST));
        }
        if words.is_empty() { "no channels".to_string() } else { words.join(", ") }
    }

    fn first_hit(&self, patterns: impl Iterator<Item = Pattern>, half: Option<Buffer>, role: Role) -> Option<Hit> {
        for pattern in patterns {
            let mut hits = self.matching(pattern, half, role);
            if let Some((_, channels)) = hits.next() {
                let passed_over = hits.map(|(layer, _)| layer.path.clone()).collect();
                return Some(Hit { channels, passed_over });
            }
        }
        None
    }

    fn matching(
        &self,
        pattern: Pattern,
        half: Option<Buffer>,
        role: Role,
    ) -> impl Iterator<Item = (&Layer, Vec<usize>)> {
        let named = self
            .list
            .iter()
            .filter(move |layer| layer.half == half && !layer.other_view && pattern.matches(&layer.base));
        named.filter_map(move |layer| Some((layer, layer.channels_for(role)?)))
    }

    /// Colour of a multi-part file whose first part has a name of its own.
    fn first_part(&self, role: Role, half: Option<Buffer>) -> Option<Hit> {
        let mut plain =
            self.list.iter().filter(|layer| layer.first_part && layer.half == half && role == Role::Radiance);
        Some(Hit { channels: plain.next()?.channels_for(role)?, passed_over: Vec::new() })
    }
}

impl Layer {
    fn channels_for(&self, role: Role) -> Option<Vec<usize>> {
        let find = |ending: &&str| self.components.iter().find(|(known, _)| known == ending).map(|&(_, at)| at);
        let by_ending = names::component_sets(role).iter().find_map(|set| set.iter().map(find).collect());
        let only = || match (role, self.components.as_slice()) {
            (Role::Visibility, [(_, at)]) => Some(vec![*at]),
            _ => None,
        };
        by_ending.or_else(only)
    }

    fn summary(&self) -> String {
        let endings: Vec<&str> = self.components.iter().map(|(ending, _)| ending.as_str()).collect();
        let endings = endings.join("");
        shown(&if self.path.is_empty() { endings.to_ascii_uppercase() } else { format!("{}.{endings}", self.path) })
    }
}

/// Splits at the last dot; names without one may still carry a layer: `Nsx`, `visibilityA`.
fn split_channel(name: &str) -> (String, String) {
    let name = name.trim_start_matches('.');
    if let Some((path, ending)) = name.rsplit_once('.') {
        return (path.to_string(), ending.to_string());
    }
    let (stem, _) = split_half(name);
    if names::candidates(Role::Visibility).iter().any(|pattern| pattern.matches(&stem.to_ascii_lowercase())) {
        return (name.to_string(), "Y".to_string());
    }
    let split = name.char_indices().last().filter(|(at, c)| *at > 0 && "xyzXYZ".contains(*c));
    if let Some((at, _)) = split
        && names::candidates(Role::Normal).iter().any(|pattern| pattern.matches(&name[..at].to_ascii_lowercase()))
    {
        return (name[..at].to_string(), name[at..].to_string());
    }
    (String::new(), name.to_string())
}

fn new_layer(file: &ExrFile, part: usize, path: String, component: (String, usize)) -> Layer {
    let default = file.views.first();
    let is_view = |segment: &str, view: &String| segment.eq_ignore_ascii_case(view);
    let mut other_view = file.part_views[part].as_ref().is_some_and(|view| Some(view) != default);
    let mut kept = Vec::new();
    for segment in path.split('.').filter(|segment| !segment.is_empty()) {
        other_view |= file.views.iter().skip(1).any(|view| is_view(segment, view));
        if !default.is_some_and(|view| is_view(segment, view)) {
            kept.push(segment);
        }
    }
    let (base, half) = split_half(&kept.join("."));
    let multi = file.part_views.len() > 1;
    let first_part = multi && part == 0 && !path.contains('.');
    Layer { path, base: base.to_ascii_lowercase(), half, other_view, first_part, components: vec![component] }
}
