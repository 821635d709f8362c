//! Layers of half a that may be additive passes of the picture, by their names: sets of which each may add up to it.

use super::PassSelection;
use super::names::{CONVENTIONS, Convention, Lobe, is_light_group};
use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::layers::{Layer, Layers, Name, Reading};
use sspc_image::{Role, shown};

/// Layers that may add up to the picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundSet {
    /// What they are, for messages: "light groups".
    pub what: String,
    /// The passes.
    pub passes: Vec<FoundPass>,
}

/// One pass, by channels of half a's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundPass {
    /// The layer's path in the file.
    pub name: String,
    /// R, G, B.
    pub channels: Vec<usize>,
    /// R, G, B of the layer that it is multiplied by before it is added, and that layer's path.
    pub colour: Option<(String, Vec<usize>)>,
}

/// A layer of half a, and what its name says of it.
#[derive(Clone, Copy)]
pub struct OfHalf<'a> {
    /// The layer.
    pub layer: &'a Layer,
    name: &'a Name,
}

/// The layers of half a that are pictures of the view of the noisy colour, whose layer is `own`, itself left out.
pub fn others<'a>(layers: &'a Layers, own: &Layer, reading: Reading) -> Vec<OfHalf<'a>> {
    let is_other = |layer: &&Layer| {
        let is_own = layer.path == own.path && layer.part == own.part;
        layer.view == own.view && !is_own && layer.channels_for(Role::Radiance).is_some()
    };
    let of_half = |layer: &'a Layer| Some(OfHalf { layer, name: layer.name(reading)? });
    layers.list.iter().filter(is_other).filter_map(of_half).collect()
}

/// Sets of passes beside the noisy colour, as far as names tell; `roles` are channels that play other roles, which no `*`
/// stands for.
///
/// # Errors
/// A pattern that no layer matches.
pub fn find(
    file: &ExrFile,
    layers: &Layers,
    own: &Layer,
    reading: Reading,
    roles: &[usize],
    selection: &PassSelection,
) -> Result<Vec<FoundSet>, Error> {
    let others = others(layers, own, reading);
    let group = own.name(reading).map(|name| &name.group);
    let is_beside = |other: &&OfHalf| Some(&other.name.group) == group;
    match selection {
        PassSelection::Recognised => Ok(recognised(&others.iter().filter(is_beside).copied().collect::<Vec<_>>())),
        PassSelection::Named(patterns) => named(file, layers, &others, roles, patterns).map(|set| vec![set]),
    }
}

fn recognised(beside: &[OfHalf]) -> Vec<FoundSet> {
    let groups: Vec<FoundPass> =
        beside.iter().filter(|other| is_light_group(&other.name.last)).map(|other| pass(other, beside)).collect();
    let mut sets = vec![FoundSet { what: "light groups".into(), passes: groups }];
    for Convention { renderer, lobes, .. } in CONVENTIONS {
        // Where a lobe and its parts are there, either may be meant.
        for parts_first in [true, false] {
            let passes = lobes.iter().flat_map(|lobe| layers_of(lobe, parts_first, beside)).collect();
            let set = FoundSet { what: format!("lobes as {renderer} names them"), passes };
            if !sets.iter().any(|known| known.passes == set.passes) {
                sets.push(set);
            }
        }
    }
    sets.retain(|set| set.passes.len() > 1);
    sets
}

fn layers_of(lobe: &Lobe, parts_first: bool, beside: &[OfHalf]) -> Vec<FoundPass> {
    let whole = lobe.names.iter().find_map(|name| beside.iter().find(|other| other.name.last == *name));
    let whole: Vec<FoundPass> = whole.into_iter().map(|other| pass(other, beside)).collect();
    let is_part = |other: &&OfHalf| lobe.parts.contains(&other.name.last.as_str());
    let parts: Vec<FoundPass> = beside.iter().filter(is_part).map(|other| pass(other, beside)).collect();
    match parts_first {
        _ if parts.is_empty() => whole,
        _ if whole.is_empty() => parts,
        true => parts,
        false => whole,
    }
}

/// A layer as a pass, with its colour where its name says that it has one.
fn pass(&OfHalf { layer, name }: &OfHalf, beside: &[OfHalf]) -> FoundPass {
    let last = name.last.as_str();
    let lobe = CONVENTIONS.iter().flat_map(|convention| convention.lobes).find(|lobe| lobe.names.contains(&last));
    let colour = lobe.and_then(|lobe| {
        let OfHalf { layer, .. } =
            lobe.colour.iter().find_map(|name| beside.iter().find(|other| other.name.last == *name))?;
        Some((layer.path.clone(), layer.channels_for(Role::Radiance)?))
    });
    FoundPass { name: layer.path.clone(), channels: layer.channels_for(Role::Radiance).unwrap_or_default(), colour }
}

fn named(
    file: &ExrFile,
    layers: &Layers,
    others: &[OfHalf],
    roles: &[usize],
    patterns: &[String],
) -> Result<FoundSet, Error> {
    let mut passes: Vec<FoundPass> = Vec::new();
    for pattern in patterns {
        let wanted = pattern.trim().to_lowercase();
        let names = |other: &OfHalf| [other.layer.path.to_lowercase(), other.name.whole(), other.name.last.clone()];
        let is_free = |other: &&OfHalf| !wanted.contains('*') || !roles.iter().any(|&at| other.layer.holds(at));
        let is_hit = |other: &&OfHalf| names(other).iter().any(|name| matches(&wanted, name));
        let mut hits = others.iter().filter(is_free).filter(is_hit).peekable();
        if hits.peek().is_none() {
            return Err(Error::Passes {
                path: file.path.clone(),
                expected: format!("a layer '{}' of the noisy colour's view", shown(pattern)),
                found: layers.summary(),
            });
        }
        for hit in hits.map(|other| pass(other, others)) {
            if !passes.contains(&hit) {
                passes.push(hit);
            }
        }
    }
    Ok(FoundSet { what: patterns.join(","), passes })
}

/// Whether a name is of a pattern, in which `*` stands for any text.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((start, rest)) => name.strip_prefix(start).is_some_and(|name| {
            (0..=name.len()).filter(|&at| name.is_char_boundary(at)).any(|at| matches(rest, &name[at..]))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn stars_stand_for_any_text() {
        for (pattern, name) in
            [("a*", "abc"), ("*c", "abc"), ("a*c", "ac"), ("*", ""), ("light_*.x", "light_ä b.x"), ("a", "a")]
        {
            assert!(matches(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("a*", "b"), ("a", "ab"), ("a*c", "ab"), ("", "a")] {
            assert!(!matches(pattern, name), "{pattern} {name}");
        }
    }
}
