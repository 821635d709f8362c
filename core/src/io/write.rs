//! The corrected picture inside a copy of an input: every other channel, part, window and attribute is kept.
//!
//! The picture takes the place of what a viewer shows of the template: the root's R,G,B; else `*.Combined.*`; else
//! the noisy colour by its name (`Beauty`, `rgba`, `C`, ...); a template without such colour (both halves in layers)
//! gets new root R,G,B. Alpha and all other channels stay those of the template, that is of half a.
//!
//! Half floats stay half floats where they can hold the picture, else these channels become f32; other colour
//! channels are f32. Parts with lossy compression are stored with ZIP, so that nothing is lost a second time.

use crate::error::{Error, Purpose, shown};
use crate::image::Image;
use crate::io::atomic::atomic_write;
use crate::io::exr_file::ExrFile;
use crate::io::layers::Layers;
use exr::compression::Compression;
use exr::image::{AnyChannel, AnyChannels, FlatImage, FlatSamples};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, LineOrder, Text};
use exr::prelude::{ReadChannels, ReadLayers, WritableImage, f16};
use std::io;
use std::path::{Path, PathBuf};

/// The largest finite half float.
const HALF_MAX: f32 = 65_504.0;
/// Below this mean magnitude half floats run into their subnormals (6.1e-5) and lose relative precision.
const HALF_COARSE: f64 = 1e-3;
/// Longest name of an attribute in the format.
const LONGEST_NAME: usize = 255;

/// Writes `corrected` (`[3, H, W]`, scene-referred) to `path` inside a copy of `template`, with each pair of
/// `provenance` as a text attribute of the part that holds the picture.
///
/// # Errors
/// What reading the template or [`atomic_write`] can raise; the template and `inputs` are never overwritten.
pub fn write_corrected(
    path: &Path,
    template: &Path,
    inputs: &[PathBuf],
    corrected: &Image,
    provenance: &[(String, String)],
) -> Result<(), Error> {
    let file = ExrFile::open(template, Purpose::Picture)?;
    let place = place_for(&file, corrected)?;
    let mut image = read_all(template)?;
    for layer in &mut image.layer_data {
        keep_lossless(&mut layer.encoding);
        // A thumbnail of the noisy picture would show the wrong one.
        layer.attributes.preview = None;
    }
    put_picture(&mut image, &place, corrected);
    let attributes = &mut image.layer_data[place.part].attributes.other;
    for (name, value) in provenance {
        attributes.insert(attribute_text(name, LONGEST_NAME), AttributeValue::Text(attribute_text(value, usize::MAX)));
    }
    let protected: Vec<PathBuf> = inputs.iter().cloned().chain([template.to_path_buf()]).collect();
    atomic_write(path, &protected, |out| image.write().to_buffered(out).map_err(into_io))
}

/// Writes a picture of its own, `[3, H, W]` as f32 R,G,B with ZIP, with provenance as text attributes.
///
/// # Errors
/// As [`atomic_write`].
pub fn write_picture(
    path: &Path,
    inputs: &[PathBuf],
    picture: &Image,
    provenance: &[(String, String)],
) -> Result<(), Error> {
    let channels = ["R", "G", "B"].iter().enumerate();
    let list = channels.map(|(c, name)| AnyChannel::new(*name, FlatSamples::F32(picture.plane(c).to_vec())));
    let mut layer = exr::image::Layer::new(
        (picture.width(), picture.height()),
        exr::meta::header::LayerAttributes::default(),
        exr::image::Encoding { compression: Compression::ZIP16, ..exr::image::Encoding::FAST_LOSSLESS },
        AnyChannels::sort(list.collect()),
    );
    for (name, value) in provenance {
        let value = AttributeValue::Text(attribute_text(value, usize::MAX));
        layer.attributes.other.insert(attribute_text(name, LONGEST_NAME), value);
    }
    let image = exr::image::Image::from_layer(layer);
    atomic_write(path, inputs, |out| image.write().to_buffered(out).map_err(into_io))
}

/// Where the picture goes: channel indices of one part, or new root channels.
struct Place {
    part: usize,
    channels: Option<[usize; 3]>,
}

fn place_for(file: &ExrFile, corrected: &Image) -> Result<Place, Error> {
    let fits =
        |window: &crate::io::exr_file::Window| (window.width, window.height) == (corrected.width(), corrected.height());
    let hit = Layers::of(file).find_picture().map(|hit| hit.channels);
    let found = hit.as_deref().unwrap_or(&[]);
    if let &[r, g, b] = found
        && [r, g, b].iter().all(|&at| fits(&file.channels[at].window))
        && [r, g, b].iter().all(|&at| file.channels[at].part == file.channels[r].part)
    {
        let indices = [r, g, b].map(|at| file.channels[at].index);
        return Ok(Place { part: file.channels[r].part, channels: Some(indices) });
    }
    match file.channels.iter().find(|channel| hit.is_none() && fits(&channel.window)) {
        Some(channel) => Ok(Place { part: channel.part, channels: None }),
        None => Err(Error::SizeMismatch {
            path: file.path.clone(),
            purpose: file.purpose,
            expected: format!("{}x{}", corrected.width(), corrected.height()),
            found: file.channels.first().map(|channel| channel.window.to_string()).unwrap_or_default(),
            like: PathBuf::from("the corrected picture"),
        }),
    }
}

fn read_all(template: &Path) -> Result<FlatImage, Error> {
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    reader.all_attributes().from_file(template).map_err(|error| Error::Damaged {
        path: template.to_path_buf(),
        purpose: Purpose::Picture,
        expected: "a complete OpenEXR file".to_string(),
        found: shown(&error.to_string()),
    })
}

fn keep_lossless(encoding: &mut exr::image::Encoding) {
    use Compression::{B44, B44A, DWAA, DWAB, PXR24};
    if matches!(encoding.compression, B44 | B44A | PXR24 | DWAA(_) | DWAB(_)) {
        encoding.compression = Compression::ZIP16;
    }
    if encoding.blocks == exr::image::Blocks::ScanLines && encoding.line_order == LineOrder::Unspecified {
        encoding.line_order = LineOrder::Increasing;
    }
}

fn put_picture(image: &mut FlatImage, place: &Place, corrected: &Image) {
    let layer = &mut image.layer_data[place.part];
    debug_assert_eq!(layer.size, Vec2(corrected.width(), corrected.height()));
    let list = &mut layer.channel_data.list;
    match place.channels {
        Some(indices) => {
            let were_half = indices.iter().all(|&at| matches!(list[at].sample_data, FlatSamples::F16(_)));
            let as_half = were_half && half_can_hold(corrected);
            for (c, at) in indices.into_iter().enumerate() {
                list[at].sample_data = samples(corrected.plane(c), as_half);
            }
        }
        None => {
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                list.push(AnyChannel::new(name, samples(corrected.plane(c), false)));
            }
            list.sort_by(|x, y| x.name.as_slice().cmp(y.name.as_slice()));
        }
    }
}

/// Whether half floats hold every value without overflow and the picture as a whole without losing precision.
fn half_can_hold(picture: &Image) -> bool {
    let finite = picture.data().iter().filter(|value| value.is_finite());
    let (mut sum, mut count, mut largest) = (0.0f64, 0u64, 0.0f32);
    for value in finite {
        sum += f64::from(value.abs());
        count += 1;
        largest = largest.max(value.abs());
    }
    largest <= HALF_MAX && (sum == 0.0 || sum >= HALF_COARSE * count as f64)
}

fn samples(plane: &[f32], as_half: bool) -> FlatSamples {
    match as_half {
        true => FlatSamples::F16(plane.iter().map(|&value| f16::from_f32(value)).collect()),
        false => FlatSamples::F32(plane.to_vec()),
    }
}

/// UTF-8 bytes, as other tools write them; cut at a character when too long, never empty.
fn attribute_text(text: &str, longest: usize) -> Text {
    let mut end = text.len().min(longest);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let bytes = if end == 0 { b"-".as_slice() } else { &text.as_bytes()[..end] };
    Text::from_slice_unchecked(bytes)
}

fn into_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
