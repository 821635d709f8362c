//! References and single pictures.

use crate::align::{Placing, window_like};
use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::layers::{Layers, Reading};
use sspc_image::{Buffer, Image, Reference, shown};
use std::path::Path;

/// A picture that another one must cover.
#[derive(Clone, Copy, Debug)]
pub struct Like<'a> {
    /// Its file, for messages.
    pub path: &'a Path,
    /// Where its pixels lie.
    pub placing: Placing,
}

/// Reads a reference: its colour, and its two halves when it has layers marked a and b (or even and odd).
/// Without colour of its own, the mean of the halves is the reference.
///
/// # Errors
/// A file that cannot be read, has neither colour nor halves, or does not cover `like`.
pub fn read_reference(path: &Path, like: Option<Like>) -> Result<Reference, Error> {
    let purpose = Purpose::Reference;
    let file = ExrFile::open(path, purpose)?;
    let layers = Layers::of(&file);
    let mean = layers.whole_colour();
    let half = |buffer| layers.noisy_colour(Reading::Marked(buffer), 0);
    let halves = half(Buffer::A).zip(half(Buffer::B));
    let mut groups: Vec<Vec<usize>> = mean.iter().map(|hit| hit.channels.clone()).collect();
    if let Some((a, b)) = &halves {
        groups.extend([a.channels.clone(), b.channels.clone()]);
    }
    if groups.is_empty() {
        let expected = "R,G,B, or both halves as a.R,a.G,a.B and b.R,b.G,b.B".to_string();
        return Err(Error::MissingRole { path: path.into(), purpose, expected, found: layers.summary() });
    }
    let (mut images, _) = images_like(&file, groups, like)?;
    let halves = halves.is_some().then(|| {
        let b = images.pop();
        let a = images.pop();
        a.zip(b)
    });
    let halves = halves.flatten().map(|(a, b)| [a, b]);
    let mean = match (images.pop(), &halves) {
        (Some(mean), _) => mean,
        (None, Some([a, b])) => Image::mean_of(a, b),
        (None, None) => unreachable!("groups are not empty"),
    };
    Ok(Reference { mean, halves })
}

/// Reads the colour that a viewer would show, `[3, H, W]`: the root's R,G,B, Cycles' Combined, Beauty, ...
///
/// # Errors
/// A file that cannot be read, has no colour, or does not cover `like`.
pub fn read_picture(path: &Path, like: Option<Like>) -> Result<Image, Error> {
    read_placed_picture(path, like).map(|(image, _)| image)
}

/// The same, and where its pixels lie.
///
/// # Errors
/// As [`read_picture`].
pub fn read_placed_picture(path: &Path, like: Option<Like>) -> Result<(Image, Placing), Error> {
    let purpose = Purpose::Picture;
    let file = ExrFile::open(path, purpose)?;
    let layers = Layers::of(&file);
    let Some(hit) = layers.shown_colour() else {
        let expected = "R,G,B, Combined or Beauty".to_string();
        return Err(Error::MissingRole { path: path.into(), purpose, expected, found: layers.summary() });
    };
    let (mut images, placing) = images_like(&file, vec![hit.channels], like)?;
    Ok((images.swap_remove(0), placing))
}

/// Reads R,G,B of a layer by its name, `[3, H, W]`, e.g. a pass, and where its pixels lie. A file that shows nothing but a colour
/// without a layer's name is taken as that layer.
///
/// # Errors
/// A file that cannot be read, has no such layer, or does not cover `like`.
pub fn read_placed_layer(path: &Path, layer: &str, like: Option<Like>) -> Result<(Image, Placing), Error> {
    let purpose = Purpose::Picture;
    let file = ExrFile::open(path, purpose)?;
    let Some(channels) = channels_of(&file, layer).or_else(|| only_colour(&file)) else {
        let expected = format!("the layer {}", shown(layer));
        return Err(Error::MissingRole { path: path.into(), purpose, expected, found: Layers::of(&file).summary() });
    };
    let (mut images, placing) = images_like(&file, vec![channels], like)?;
    Ok((images.swap_remove(0), placing))
}

/// The same of a reference; layers `a.NAME` and `b.NAME` are its halves.
///
/// # Errors
/// As [`read_placed_layer`].
pub fn read_reference_layer(path: &Path, layer: &str, like: Option<Like>) -> Result<Reference, Error> {
    let file = ExrFile::open(path, Purpose::Reference)?;
    let half = |half: &str| channels_of(&file, &format!("{half}.{layer}"));
    if let Some((a, b)) = half("a").zip(half("b")) {
        let (mut images, _) = images_like(&file, vec![a, b], like)?;
        if let (Some(b), Some(a)) = (images.pop(), images.pop()) {
            return Ok(Reference { mean: Image::mean_of(&a, &b), halves: Some([a, b]) });
        }
    }
    Ok(Reference { mean: read_placed_layer(path, layer, like)?.0, halves: None })
}

/// R, G and B of a layer.
fn channels_of(file: &ExrFile, layer: &str) -> Option<Vec<usize>> {
    ["R", "G", "B"].iter().map(|end| file.channel_named(&format!("{layer}.{end}"))).collect()
}

/// R, G and B of a file that has no others than these and alpha.
fn only_colour(file: &ExrFile) -> Option<Vec<usize>> {
    let is_plain = file.channels.iter().all(|channel| ["R", "G", "B", "A"].contains(&channel.name.as_str()));
    let channels = || ["R", "G", "B"].iter().map(|end| file.channel_named(end)).collect();
    is_plain.then(channels).flatten()
}

/// Groups of channels where `like` is; without it, where the first of them is.
fn images_like(file: &ExrFile, groups: Vec<Vec<usize>>, like: Option<Like>) -> Result<(Vec<Image>, Placing), Error> {
    let own = Placing::of(file, groups[0][0]);
    let Like { path, placing } = like.unwrap_or(Like { path: &file.path, placing: own });
    let mut windows = Vec::new();
    for group in groups {
        let (window, _) = window_like(file, &group, &placing, path)?;
        windows.push((group, window));
    }
    Ok((file.windows(&windows)?, placing))
}
