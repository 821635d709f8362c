//! Where a corrected picture goes: where its noise came from.

use crate::container::copy::Target;
use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::halves::split_half;
use crate::layers::{Layer, Layers, Reading};
use crate::names::{is_colour, noisy_stem};
use crate::resolve::Resolution;
use exr::meta::attribute::SampleType;
use sspc_image::{Buffer, Role, shown};

/// The channels that a picture takes.
#[derive(Clone, Debug)]
pub struct Place {
    pub targets: Vec<Target>,
    /// Whether all of them are half floats in the template.
    pub were_half: bool,
    /// Their names, for messages.
    pub name: String,
}

/// The place of a frame's picture in half a's file: the noisy colour that was corrected; where its name says that it is
/// noisy, the picture that it is the noisy version of; where the file holds both halves, the layer of both together, or
/// new channels at the root.
///
/// # Errors
/// [`Error::Unsupported`]: half a's file has no pixels of the frame's window, or R, G, B of something else at the root.
pub fn place_of(resolution: &Resolution) -> Result<Place, Error> {
    let radiance = resolution.radiance();
    let file = &resolution.files[radiance.file];
    let layers = Layers::of(file);
    let both_in_one = resolution
        .get(Role::Radiance, Buffer::B)
        .is_some_and(|b| b.file == radiance.file && b.channels != radiance.channels);
    if both_in_one {
        return place_of_both(file, &layers, &radiance.channels);
    }
    let denoised = resolution.get(Role::Denoised, Buffer::A).filter(|z| z.file == radiance.file);
    let is_noisy = |channels: &[usize]| {
        let layer = layers.layer_of(*channels.first()?)?;
        noisy_stem(&layer.name(Reading::Plain)?.last).map(|_| ())
    };
    let shows = |channels: &[usize]| {
        let name = layers.layer_of(*channels.first()?)?.name(Reading::Plain)?;
        is_colour(&name.last).then_some(())
    };
    match denoised {
        Some(z) if is_noisy(&radiance.channels).is_some() && shows(&z.channels).is_some() => {
            Ok(place(file, &z.channels))
        }
        Some(z) => Ok(place(file, &radiance.channels).with_around(file, &z.channels)),
        None => Ok(place(file, &radiance.channels)),
    }
}

impl Place {
    /// The same with these channels where the picture is not, as far as they are in the same part.
    fn with_around(mut self, file: &ExrFile, channels: &[usize]) -> Self {
        for target in &mut self.targets {
            let channel = &file.channels[channels[target.planes[0]]];
            let entry = &file.container.parts[channel.part].channels[channel.index];
            target.around = (channel.part == target.part).then(|| entry.name.clone());
        }
        self
    }
}

fn place_of_both(file: &ExrFile, layers: &Layers, channels: &[usize]) -> Result<Place, Error> {
    let at_root = || layers.list.iter().find(|layer| layer.path.is_empty());
    match whole_of(layers, channels).or_else(at_root).and_then(|layer| layer.channels_for(Role::Radiance)) {
        Some(channels) => Ok(place(file, &channels)),
        None => new_channels(file, file.channels[channels[0]].part, ""),
    }
}

/// The place of a layer of half a in a file that holds both halves: the layer of both together, or new channels of its name
/// without the mark.
///
/// # Errors
/// [`Error::Unsupported`]: some of R, G, B have that name already.
pub fn place_of_whole(file: &ExrFile, channels: &[usize]) -> Result<Place, Error> {
    let layers = Layers::of(file);
    if let Some(channels) = whole_of(&layers, channels).and_then(|layer| layer.channels_for(Role::Radiance)) {
        return Ok(place(file, &channels));
    }
    let path = layers.layer_of(channels[0]).map_or("", |layer| &layer.path);
    new_channels(file, file.channels[channels[0]].part, &split_half(path).0)
}

/// The layer that has the name of a half's, without its mark.
fn whole_of<'a>(layers: &'a Layers, channels: &[usize]) -> Option<&'a Layer> {
    let marked = layers.layer_of(channels[0])?;
    layers.list.iter().find(|layer| layer.name(Reading::Unmarked) == Some(marked.unmarked()))
}

/// These channels, one or three, for one picture.
pub fn place(file: &ExrFile, channels: &[usize]) -> Place {
    let mut targets: Vec<Target> = Vec::new();
    for (plane, &at) in channels.iter().enumerate() {
        let channel = &file.channels[at];
        let entry = &file.container.parts[channel.part].channels[channel.index];
        match targets.iter_mut().find(|target| (target.part, &target.name) == (channel.part, &entry.name)) {
            Some(target) => target.planes.push(plane),
            None => {
                let (part, name, kind) = (channel.part, entry.name.clone(), entry.kind);
                targets.push(Target { part, name, kind, picture: 0, planes: vec![plane], around: None });
            }
        }
    }
    let names: Vec<&str> = channels.iter().map(|&at| file.channels[at].name.as_str()).collect();
    let were_half = targets.iter().all(|target| target.kind == SampleType::F16);
    Place { targets, were_half, name: shown(&names.join(",")) }
}

/// R, G, B of a layer of a part, which has none of them; the root's where `path` is empty.
fn new_channels(file: &ExrFile, part: usize, path: &str) -> Result<Place, Error> {
    let known = &file.container.parts[part].channels;
    let names = ["R", "G", "B"].map(|end| if path.is_empty() { end.to_string() } else { format!("{path}.{end}") });
    if let Some(other) = names.iter().find(|name| known.iter().any(|c| c.name == name.as_bytes())) {
        return Err(Error::Unsupported {
            path: file.path.clone(),
            purpose: file.purpose,
            expected: format!("{}, or none of them, to put the picture at", shown(&names.join(","))),
            found: format!("{} alone", shown(other)),
        });
    }
    let target = |(plane, name): (usize, &String)| Target {
        part,
        name: name.as_bytes().to_vec(),
        kind: SampleType::F32,
        picture: 0,
        planes: vec![plane],
        around: None,
    };
    let targets = names.iter().enumerate().map(target).collect();
    Ok(Place { targets, were_half: false, name: shown(&names.join(",")) })
}
