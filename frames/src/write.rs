//! The corrected picture inside a copy of an input: every other channel, part, window and attribute is kept.
//!
//! The picture takes the place of what a viewer shows of the template: the root's R,G,B; else `*.Combined.*`; else
//! the noisy colour by its name (`Beauty`, `rgba`, `C`, ...); a template without such colour (both halves in layers)
//! gets new root R,G,B. Alpha and all other channels stay those of the template, that is of half a.
//!
//! Half floats stay half floats where they can hold the picture, else these channels become f32; other colour
//! channels are f32. Parts with lossy compression are stored with ZIP, so that nothing is lost a second time.
//!
//! Chunks are copied some at a time: memory does not grow with the number of the template's channels. The same picture
//! and provenance give the same bytes.

use crate::atomic::atomic_write;
use crate::decode::{Lines, for_blocks};
use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::layers::Layers;
use exr::block::chunk::Chunk;
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::error::Error as ExrError;
use exr::image::{AnyChannel, AnyChannels, FlatSamples};
use exr::math::Vec2;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, ChannelList, LevelMode, LineOrder, SampleType, Text, TileDescription,
};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, Headers};
use exr::prelude::{WritableImage, f16};
use rayon::prelude::*;
use sspc_image::Image;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The largest finite half float.
const HALF_MAX: f32 = 65_504.0;
/// Below this mean magnitude half floats run into their subnormals (6.1e-5) and lose relative precision.
const HALF_COARSE: f64 = 1e-3;
/// Pixels in bytes, all channels, that are copied at a time; at least one row of blocks.
const COPIED_BYTES: usize = 24 << 20;
/// Where the first header begins: after four bytes that mark the format, and version and flags.
const FIRST_ATTRIBUTE: u64 = 8;
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
    let mut headers: Headers = file.reader()?.headers().iter().cloned().map(rewritten).collect();
    let part = &mut headers[place.part];
    for (name, value) in provenance {
        let value = AttributeValue::Text(attribute_text(value, usize::MAX));
        part.own_attributes.other.insert(attribute_text(name, LONGEST_NAME), value);
    }
    let channels = channels_with_picture(&mut part.channels, &place, corrected);
    let copy = Copy { file: &file, part: place.part, channels, corrected };
    let protected: Vec<PathBuf> = inputs.iter().cloned().chain([template.to_path_buf()]).collect();
    let mut unreadable = None;
    let written = atomic_write(path, &protected, |out| {
        let mut ordered = Vec::new();
        let write = exr::block::write(&mut *out, headers, true, |meta, writer| {
            ordered = attributes_by_name(&meta.headers)?;
            (0..meta.headers.len()).try_for_each(|part| copy.part(part, &meta.headers, writer)).map_err(|error| {
                match error {
                    CopyError::Write(error) => error,
                    CopyError::Read(error) => {
                        unreadable = Some(error);
                        ExrError::Aborted
                    }
                }
            })
        });
        write.map_err(into_io)?;
        out.seek(SeekFrom::Start(FIRST_ATTRIBUTE))?;
        out.write_all(&ordered)
    });
    unreadable.map_or(written, Err)
}

/// The headers' bytes with the attributes of each in the order of their names. The library keeps most of them in hash
/// maps, and writes them in another order every time.
fn attributes_by_name(headers: &[Header]) -> Result<Vec<u8>, ExrError> {
    let mut bytes = Vec::new();
    for header in headers {
        let mut attributes: Vec<_> = header.all_named_attributes().collect();
        attributes.sort_by_key(|(name, _)| *name);
        for (name, value) in &attributes {
            exr::meta::attribute::write(name, value, &mut bytes)?;
        }
        // The end of a header.
        bytes.push(0);
    }
    Ok(bytes)
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
        |window: &crate::exr_file::Window| (window.width, window.height) == (corrected.width(), corrected.height());
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

/// The header of a copy: lossless, one level of detail, rows from top to bottom, no thumbnail, which would show the
/// wrong picture.
fn rewritten(mut header: Header) -> Header {
    use Compression::{B44, B44A, DWAA, DWAB, PXR24};
    header.own_attributes.preview = None;
    let compression = match header.compression {
        B44 | B44A | PXR24 | DWAA(_) | DWAB(_) => Compression::ZIP16,
        other => other,
    };
    let blocks = match header.blocks {
        BlockDescription::Tiles(tiles) => {
            BlockDescription::Tiles(TileDescription { level_mode: LevelMode::Singular, ..tiles })
        }
        BlockDescription::ScanLines => BlockDescription::ScanLines,
    };
    header.with_encoding(compression, blocks, LineOrder::Increasing)
}

/// What a channel of the copy holds.
#[derive(Clone, Copy)]
enum Samples {
    /// Those of this channel of the template's part.
    Kept(usize),
    /// This plane of the picture.
    Picture(usize),
}

/// Puts the picture's channels into the part's list, and says what each channel of the list then holds.
fn channels_with_picture(list: &mut ChannelList, place: &Place, corrected: &Image) -> Vec<Samples> {
    let mut all: Vec<_> = list.list.iter().cloned().enumerate().map(|(at, c)| (c, Samples::Kept(at))).collect();
    match place.channels {
        Some(indices) => {
            let were_half = indices.iter().all(|&at| all[at].0.sample_type == SampleType::F16);
            let kind = if were_half && half_can_hold(corrected) { SampleType::F16 } else { SampleType::F32 };
            for (c, at) in indices.into_iter().enumerate() {
                all[at].0.sample_type = kind;
                all[at].1 = Samples::Picture(c);
            }
        }
        None => {
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                all.push((ChannelDescription::new(name, SampleType::F32, false), Samples::Picture(c)));
            }
            all.sort_by(|x, y| x.0.name.as_slice().cmp(y.0.name.as_slice()));
        }
    }
    *list = ChannelList::new(all.iter().map(|(channel, _)| channel.clone()).collect());
    all.into_iter().map(|(_, samples)| samples).collect()
}

/// A copy of a file with a picture in one of its parts.
struct Copy<'a> {
    file: &'a ExrFile,
    part: usize,
    /// What the channels of that part hold.
    channels: Vec<Samples>,
    corrected: &'a Image,
}

/// Why a copy failed.
enum CopyError {
    Read(Error),
    Write(ExrError),
}

impl From<Error> for CopyError {
    fn from(error: Error) -> Self {
        CopyError::Read(error)
    }
}

impl Copy<'_> {
    /// Copies one part, some rows of blocks at a time.
    fn part(&self, part: usize, headers: &[Header], writer: &mut impl ChunksWriter) -> Result<(), CopyError> {
        let source = self.file.reader()?.headers()[part].clone();
        let height = source.layer_size.1;
        let rows_of_block = source.max_block_pixel_size().1;
        let bytes_of_row = source.layer_size.0 * source.channels.bytes_per_pixel;
        let step = (COPIED_BYTES / bytes_of_row.max(1)).max(1).next_multiple_of(rows_of_block);
        for top in (0..height).step_by(step) {
            let rows = top..(top + step).min(height);
            let wanted = |block: &BlockIndex| block.layer == part && rows.contains(&block.pixel_position.1);
            let mut chunks = Vec::new();
            let read = for_blocks(self.file.reader()?, wanted, |sources, blocks| {
                let encode = |block| self.encode(&sources[part], headers, block);
                chunks.extend(blocks.into_par_iter().map(encode).collect::<Result<Vec<_>, _>>()?);
                Ok(())
            });
            read.map_err(|error: ExrError| self.file.damaged(&error))?;
            let mut chunks = chunks.concat();
            chunks.sort_by_key(|(index, _)| *index);
            for (index, chunk) in chunks {
                writer.write_chunk(index, chunk).map_err(CopyError::Write)?;
            }
        }
        Ok(())
    }

    /// The chunks of the copy that a block of the template gives, each with its index in its part.
    fn encode(
        &self,
        source: &Header,
        headers: &[Header],
        block: UncompressedBlock,
    ) -> Result<Vec<(usize, Chunk)>, ExrError> {
        let part = block.index.layer;
        let target = &headers[part];
        let Vec2(block_width, block_height) = target.max_block_pixel_size();
        let blocks_across = target.layer_size.0.div_ceil(block_width);
        let BlockIndex { pixel_position: Vec2(left, top), pixel_size: Vec2(width, height), .. } = block.index;
        // A lossy block holds as many rows as a block of ZIP or a multiple of them.
        let tops = (top..top + height).step_by(block_height);
        let encode = |y: usize| {
            let size = Vec2(width, block_height.min(top + height - y));
            let data = match part == self.part {
                true => self.with_picture(source, target, &block, y, size),
                false => {
                    let line = source.channels.bytes_per_pixel * width;
                    block.data[(y - top) * line..][..size.1 * line].to_vec()
                }
            };
            let index = BlockIndex { pixel_position: Vec2(left, y), pixel_size: size, ..block.index };
            let chunk = UncompressedBlock { index, data }.compress_to_chunk(headers)?;
            Ok((y / block_height * blocks_across + left / block_width, chunk))
        };
        tops.map(encode).collect()
    }

    /// Lines from row `y` of the picture on, all channels of the part that holds it.
    fn with_picture(
        &self,
        source: &Header,
        target: &Header,
        block: &UncompressedBlock,
        y: usize,
        size: Vec2<usize>,
    ) -> Vec<u8> {
        let Vec2(left, top) = block.index.pixel_position;
        let mut data = Vec::with_capacity(size.0 * size.1 * target.channels.bytes_per_pixel);
        let lines: Vec<Option<Lines>> = self
            .channels
            .iter()
            .map(|samples| match samples {
                Samples::Kept(at) => Some(Lines::of(source, block, *at)),
                Samples::Picture(_) => None,
            })
            .collect();
        for y in y..y + size.1 {
            for ((samples, lines), channel) in self.channels.iter().zip(&lines).zip(&target.channels.list) {
                match (samples, lines) {
                    (Samples::Picture(c), _) => {
                        let row = &self.corrected.row(*c, y)[left..left + size.0];
                        match channel.sample_type {
                            SampleType::F16 => data.extend(row.iter().flat_map(|&v| f16::from_f32(v).to_ne_bytes())),
                            _ => data.extend(row.iter().flat_map(|v| v.to_ne_bytes())),
                        }
                    }
                    (_, Some(lines)) => data.extend_from_slice(&block.data[lines.bytes(y - top)]),
                    (Samples::Kept(_), None) => unreachable!("kept channels have lines"),
                }
            }
        }
        data
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
