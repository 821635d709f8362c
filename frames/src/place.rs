//! Where a corrected picture goes: where its noise came from.

use crate::container::copy::Target;
use crate::error::Error;
use crate::exr_file::ExrFile;
use crate::layers::{Layers, Reading};
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
    let marked = layers.layer_of(channels[0]);
    let same = |name: &crate::layers::Name| marked.is_some_and(|layer| layer.unmarked() == name);
    let whole = layers.list.iter().find(|layer| layer.name(Reading::Unmarked).is_some_and(same));
    let at_root = || layers.list.iter().find(|layer| layer.path.is_empty());
    match whole.or_else(at_root).and_then(|layer| layer.channels_for(Role::Radiance)) {
        Some(channels) => Ok(place(file, &channels)),
        None => new_channels(file, file.channels[channels[0]].part),
    }
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

/// R, G, B at the root of a part, which has none of them.
fn new_channels(file: &ExrFile, part: usize) -> Result<Place, Error> {
    let known = &file.container.parts[part].channels;
    if let Some(other) = ["R", "G", "B"].iter().find(|name| known.iter().any(|c| c.name == name.as_bytes())) {
        return Err(Error::Unsupported {
            path: file.path.clone(),
            purpose: file.purpose,
            expected: "R, G and B, or none of them, to put the picture at".into(),
            found: format!("{other} alone"),
        });
    }
    let target = |(plane, name): (usize, &str)| Target {
        part,
        name: name.as_bytes().to_vec(),
        kind: SampleType::F32,
        picture: 0,
        planes: vec![plane],
        around: None,
    };
    let targets = ["R", "G", "B"].into_iter().enumerate().map(target).collect();
    Ok(Place { targets, were_half: false, name: "R,G,B".into() })
}
