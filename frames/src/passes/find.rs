//! Layers of half a that may be additive passes of the picture, by their names: sets of which each may add up to it.

use super::PassSelection;
use super::names::{CONVENTIONS, Convention, Lobe, is_light_group};
use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::layers::{Layer, Layers};
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

/// The layers of a file that are pictures of the view of the noisy colour, whose layer is `own`, itself left out.
pub fn others<'a>(layers: &'a Layers, own: &Layer) -> Vec<&'a Layer> {
    let is_other = |layer: &&Layer| {
        let is_own = layer.path == own.path && layer.part == own.part;
        layer.view == own.view && !is_own && layer.channels_for(Role::Radiance).is_some()
    };
    layers.list.iter().filter(is_other).collect()
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
    roles: &[usize],
    selection: &PassSelection,
) -> Result<Vec<FoundSet>, Error> {
    let others = others(layers, own);
    let is_beside = |layer: &&&Layer| layer.plain().group == own.plain().group;
    match selection {
        PassSelection::Recognised => Ok(recognised(&others.iter().filter(is_beside).copied().collect::<Vec<_>>())),
        PassSelection::Named(patterns) => named(file, layers, &others, roles, patterns).map(|set| vec![set]),
    }
}

fn recognised(beside: &[&Layer]) -> Vec<FoundSet> {
    let groups: Vec<FoundPass> =
        beside.iter().filter(|layer| is_light_group(&layer.plain().last)).map(|layer| pass(layer, beside)).collect();
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

fn layers_of(lobe: &Lobe, parts_first: bool, beside: &[&Layer]) -> Vec<FoundPass> {
    let whole = lobe.names.iter().find_map(|name| beside.iter().find(|layer| layer.plain().last == *name));
    let whole: Vec<FoundPass> = whole.into_iter().map(|layer| pass(layer, beside)).collect();
    let is_part = |layer: &&&Layer| lobe.parts.contains(&layer.plain().last.as_str());
    let parts: Vec<FoundPass> = beside.iter().filter(is_part).map(|layer| pass(layer, beside)).collect();
    match parts_first {
        _ if parts.is_empty() => whole,
        _ if whole.is_empty() => parts,
        true => parts,
        false => whole,
    }
}

/// A layer as a pass, with its colour where its name says that it has one.
fn pass(layer: &Layer, beside: &[&Layer]) -> FoundPass {
    let last = layer.plain().last.as_str();
    let lobe = CONVENTIONS.iter().flat_map(|convention| convention.lobes).find(|lobe| lobe.names.contains(&last));
    let colour = lobe.and_then(|lobe| {
        let layer = lobe.colour.iter().find_map(|name| beside.iter().find(|layer| layer.plain().last == *name))?;
        Some((layer.path.clone(), layer.channels_for(Role::Radiance)?))
    });
    FoundPass { name: layer.path.clone(), channels: layer.channels_for(Role::Radiance).unwrap_or_default(), colour }
}

fn named(
    file: &ExrFile,
    layers: &Layers,
    others: &[&Layer],
    roles: &[usize],
    patterns: &[String],
) -> Result<FoundSet, Error> {
    let mut passes: Vec<FoundPass> = Vec::new();
    for pattern in patterns {
        let wanted = pattern.trim().to_lowercase();
        let names = |layer: &Layer| [layer.path.to_lowercase(), layer.plain().whole(), layer.plain().last.clone()];
        let is_free = |layer: &&&Layer| !wanted.contains('*') || !roles.iter().any(|&channel| layer.holds(channel));
        let is_hit = |layer: &&&Layer| names(layer).iter().any(|name| matches(&wanted, name));
        let mut hits = others.iter().filter(is_free).filter(is_hit).peekable();
        if hits.peek().is_none() {
            return Err(Error::Passes {
                path: file.path.clone(),
                expected: format!("a layer '{}' of the noisy colour's view", shown(pattern)),
                found: layers.summary(),
            });
        }
        for hit in hits.map(|layer| pass(layer, others)) {
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
