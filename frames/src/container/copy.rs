//! A copy of a file with pictures in some of its channels.
//!
//! Parts without a picture are copied chunk by chunk, as they are. Of the others, the largest level is decoded and
//! encoded again, some rows at a time: memory does not grow with the number of channels.

use super::Container;
use super::attributes::{Header, Preamble};
use super::channels::{ChannelEntry, channel_bytes};
use super::chunks::{Block, ChunkReader, block, blocks_of_rows, chunk_bytes, compress, decompress};
use super::fault::Fault;
use super::part::Part;
use super::pixels::{Lines, convert_line, store_line};
use crate::window::Window;
use exr::meta::attribute::{LevelMode, SampleType};
use exr::meta::header::Header as CodecHeader;
use rayon::prelude::*;
use sspc_image::Image;
use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;

/// Pixels in bytes, all channels, that are copied at a time; at least one row of blocks.
pub const COPIED_BYTES: usize = 24 << 20;
/// ZIP of 16 rows, by its number in the format: what lossy parts become when they are encoded again.
const ZIP: u8 = 3;

/// A channel of the copy that holds a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    pub part: usize,
    /// As in the file.
    pub name: Vec<u8>,
    pub kind: SampleType,
    /// Which of the pictures.
    pub picture: usize,
    /// The planes of the picture whose mean the channel holds: one, or all of a grey picture.
    pub planes: Vec<usize>,
    /// The channel of the same part that it takes around the picture, where that does not fill the part; itself without.
    pub around: Option<Vec<u8>>,
}

/// A picture and where its pixels lie.
#[derive(Clone, Copy)]
pub struct Placed<'a> {
    pub image: &'a Image,
    pub window: Window,
}

/// Why a copy failed.
#[derive(Debug)]
pub enum CopyError {
    Read(Fault),
    Write(io::Error),
}

impl From<Fault> for CopyError {
    fn from(fault: Fault) -> Self {
        CopyError::Read(fault)
    }
}

/// Headers of a copy, and what its channels hold.
pub struct Copy<'a> {
    source: &'a Container,
    /// Parts as they will be.
    pub parts: Vec<Part>,
    targets: Vec<Target>,
}

impl<'a> Copy<'a> {
    /// The copy of `source` with these channels replaced or added, and attributes of type `string` set in the parts that
    /// hold them.
    ///
    /// # Errors
    /// [`Fault`]: parts that cannot be decoded, chunks that are not there, channels that occur twice.
    pub fn new(source: &'a Container, targets: Vec<Target>, texts: &[(String, String)]) -> Result<Self, Fault> {
        let mut parts = Vec::new();
        for (number, part) in source.parts.iter().enumerate() {
            let own: Vec<&Target> = targets.iter().filter(|target| target.part == number).collect();
            parts.push(if own.is_empty() { part.clone() } else { changed(part, &own, texts)? });
        }
        Ok(Self { source, parts, targets })
    }

    /// Whether the template's chunks are all there, those that are copied as they are and those that are decoded.
    ///
    /// # Errors
    /// [`Fault`].
    pub fn check_chunks(&self) -> Result<(), Fault> {
        let mut reader = ChunkReader::open(self.source)?;
        for (number, part) in self.source.parts.iter().enumerate() {
            let count = if self.holds_picture(number) { blocks_of(part) } else { part.chunks };
            (0..count).try_for_each(|index| reader.check(number, index))?;
        }
        Ok(())
    }

    /// The bytes of the copy before its tables.
    pub fn preamble(&self) -> Vec<u8> {
        let headers: Vec<Header> = self.parts.iter().map(|part| part.header.clone()).collect();
        Preamble { version: self.source.version, headers }.to_bytes()
    }

    /// Writes the copy.
    ///
    /// # Errors
    /// [`CopyError`].
    pub fn write(&self, out: &mut (impl Write + Seek), pictures: &[Placed]) -> Result<(), CopyError> {
        let preamble = self.preamble();
        let chunks: usize = self.parts.iter().map(|part| part.chunks).sum();
        let mut out = Counted { out, position: 0 };
        out.put(&preamble)?;
        out.put(&vec![0; 8 * chunks])?;
        let mut tables = Vec::with_capacity(8 * chunks);
        for part in 0..self.parts.len() {
            let table = match self.holds_picture(part) {
                true => self.encode_part(part, pictures, &mut out)?,
                false => self.copy_part(part, &mut out)?,
            };
            tables.extend(table.iter().flat_map(|offset: &u64| offset.to_le_bytes()));
        }
        let Counted { out, .. } = out;
        let put = out.seek(SeekFrom::Start(preamble.len() as u64)).and_then(|_| out.write_all(&tables));
        put.map_err(CopyError::Write)
    }

    /// The channels that hold pictures.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    fn holds_picture(&self, part: usize) -> bool {
        self.targets.iter().any(|target| target.part == part)
    }

    /// Copies the chunks of a part in the order in which they lie in the file.
    fn copy_part(&self, number: usize, out: &mut Counted<impl Write>) -> Result<Vec<u64>, CopyError> {
        let offsets = &self.source.tables[number];
        let mut reader = ChunkReader::open(self.source)?;
        let mut order: Vec<usize> = (0..offsets.len()).collect();
        order.sort_by_key(|&index| offsets[index]);
        let mut table = vec![0; offsets.len()];
        for index in order {
            table[index] = out.position;
            reader.copy(number, index, |bytes| out.put(bytes))?;
        }
        Ok(table)
    }

    /// Encodes a part with its picture, some rows of blocks at a time.
    fn encode_part(
        &self,
        number: usize,
        pictures: &[Placed],
        out: &mut Counted<impl Write>,
    ) -> Result<Vec<u64>, CopyError> {
        let (source, target) = (&self.source.parts[number], &self.parts[number]);
        let work = Encoder::new(self, number, pictures);
        let mut reader = ChunkReader::open(self.source)?;
        let bytes_of_row = source.window.width * source.bytes_per_pixel().max(target.bytes_per_pixel());
        let step = (COPIED_BYTES / bytes_of_row.max(1)).max(1).next_multiple_of(source.block_size().1);
        let height = source.window.height;
        let mut bands: Vec<Range<usize>> = (0..height).step_by(step).map(|top| top..(top + step).min(height)).collect();
        if source.decreasing {
            bands.reverse();
        }
        let mut table = vec![0; target.chunks];
        for rows in bands {
            let indices: Vec<usize> = blocks_of_rows(source, &rows).collect();
            let data = indices.iter().map(|&index| reader.data(number, index)).collect::<Result<Vec<_>, _>>()?;
            let blocks = data.into_par_iter().zip(indices).map(|(data, index)| work.encode(index, data));
            let mut chunks = blocks.collect::<Result<Vec<_>, Fault>>()?.concat();
            chunks.sort_by_key(|(index, _)| *index);
            if source.decreasing {
                chunks.reverse();
            }
            for (index, chunk) in chunks {
                table[index] = out.position;
                out.put(&chunk)?;
            }
        }
        Ok(table)
    }
}

/// Blocks of the largest level.
pub fn blocks_of(part: &Part) -> usize {
    blocks_of_rows(part, &(0..part.window.height)).end
}

/// A part with its picture: lossless, one level of detail, no thumbnail, which would show the wrong picture.
fn changed(part: &Part, targets: &[&Target], texts: &[(String, String)]) -> Result<Part, Fault> {
    if let Some(fault) = part.undecodable() {
        return Err(fault);
    }
    let mut made = part.clone();
    for Target { name, kind, .. } in targets {
        match made.channels.iter_mut().find(|channel| channel.name == *name) {
            Some(channel) => channel.kind = *kind,
            None => {
                let at = made.channels.iter().take_while(|channel| channel.name < *name).count();
                made.channels.insert(at, ChannelEntry::new(name, *kind));
            }
        }
    }
    let header = &mut made.header;
    if made.channels != part.channels {
        header.set("channels", "chlist", channel_bytes(&made.channels));
    }
    if part.is_lossy() {
        made.compression = ZIP;
        header.set("compression", "compression", vec![ZIP]);
    }
    if let Some(tiles) = made.tiles.as_mut().filter(|tiles| tiles.level_mode != LevelMode::Singular) {
        tiles.level_mode = LevelMode::Singular;
        let mut value = header.get("tiles", "tiledesc").map(<[u8]>::to_vec).unwrap_or_default();
        // The last byte has the kind of levels in its lower half.
        value.last_mut().into_iter().for_each(|mode| *mode &= 0xf0);
        header.set("tiles", "tiledesc", value);
    }
    header.remove("preview", "preview");
    for (name, value) in texts {
        header.set(name, "string", value.as_bytes().to_vec());
    }
    made.chunks = made.count_chunks()?;
    if made.header.get("chunkCount", "int").is_some() {
        made.header.set("chunkCount", "int", (made.chunks as i32).to_le_bytes().to_vec());
    }
    Ok(made)
}

/// A writer that knows how far it is.
struct Counted<'a, W> {
    out: &'a mut W,
    position: u64,
}

impl<W: Write> Counted<'_, W> {
    fn put(&mut self, bytes: &[u8]) -> Result<(), CopyError> {
        self.out.write_all(bytes).map_err(CopyError::Write)?;
        self.position += bytes.len() as u64;
        Ok(())
    }
}

/// What a channel of the copy holds.
enum Samples<'a> {
    /// Those of this channel of the template's part.
    Kept(usize),
    /// The mean of some planes of a picture where it is, and the template's around it where it has the channel.
    Picture { around: Option<usize>, picture: Placed<'a>, planes: &'a [usize] },
}

/// Encodes the blocks of a part.
struct Encoder<'a> {
    source: &'a Part,
    target: &'a Part,
    codecs: [CodecHeader; 2],
    channels: Vec<Samples<'a>>,
    /// The part's number, where the file has several.
    number: Option<usize>,
}

impl<'a> Encoder<'a> {
    fn new(copy: &'a Copy, number: usize, pictures: &[Placed<'a>]) -> Self {
        let (source, target) = (&copy.source.parts[number], &copy.parts[number]);
        let samples = |channel: &ChannelEntry| {
            let named = |name: &Vec<u8>| source.channels.iter().position(|known| known.name == *name);
            let mut targets = copy.targets.iter().filter(|t| t.part == number && t.name == channel.name);
            match (targets.next_back(), named(&channel.name)) {
                (Some(t), own) => {
                    let around = t.around.as_ref().and_then(named).or(own);
                    Samples::Picture { around, picture: pictures[t.picture], planes: &t.planes }
                }
                (None, Some(at)) => Samples::Kept(at),
                (None, None) => unreachable!("new channels are targets"),
            }
        };
        Self {
            source,
            target,
            codecs: [source.codec_header(), target.codec_header()],
            channels: target.channels.iter().map(samples).collect(),
            number: copy.source.is_multi_part().then_some(number),
        }
    }

    /// The chunks of the copy that a block of the template gives, each with its index in its part.
    fn encode(&self, index: usize, data: Vec<u8>) -> Result<Vec<(usize, Vec<u8>)>, Fault> {
        let place = block(self.source, index);
        let pixels = decompress(&self.codecs[0], place, data)?;
        let height = self.target.block_size().1;
        // A lossy block holds as many rows as a block of ZIP or a multiple of them.
        let tops = (place.top..place.top + place.height).step_by(height);
        let encode = |top: usize| {
            let part = Block { top, height: height.min(place.top + place.height - top), ..place };
            let data = compress(&self.codecs[1], part, self.with_picture(place, &pixels, part))?;
            let index = if self.target.tiles.is_some() { index } else { top / height };
            Ok((index, chunk_bytes(self.target, self.number, part, &data)))
        };
        tops.map(encode).collect()
    }

    /// Some lines of a block, all channels.
    fn with_picture(&self, place: Block, pixels: &[u8], part: Block) -> Vec<u8> {
        let mut data = Vec::with_capacity(part.width * part.height * self.target.bytes_per_pixel());
        let lines: Vec<Option<Lines>> = self
            .channels
            .iter()
            .map(|samples| match samples {
                Samples::Kept(at) | Samples::Picture { around: Some(at), .. } => {
                    Some(Lines::of(self.source, place, *at))
                }
                Samples::Picture { around: None, .. } => None,
            })
            .collect();
        let mut row = vec![0.0; part.width];
        for y in part.top..part.top + part.height {
            for ((samples, lines), channel) in self.channels.iter().zip(&lines).zip(&self.target.channels) {
                let kept = lines.as_ref().map(|lines| (&pixels[lines.bytes(y - place.top)], lines.kind));
                match (samples, kept) {
                    (Samples::Kept(_), Some((bytes, _))) => data.extend_from_slice(bytes),
                    (Samples::Picture { picture, planes, .. }, kept) => {
                        match kept {
                            Some((bytes, kind)) => convert_line(bytes, kind, &mut row),
                            None => row.fill(0.0),
                        }
                        let first = self.source.window.left + part.left as i32;
                        put_picture(picture, planes, (first, self.source.window.top + y as i32), &mut row);
                        store_line(&row, channel.kind, &mut data);
                    }
                    (Samples::Kept(_), None) => unreachable!("kept channels have lines"),
                }
            }
        }
        data
    }
}

/// Puts the picture's part of a row that begins at this pixel of the frame into it.
fn put_picture(picture: &Placed, planes: &[usize], (left, top): (i32, i32), row: &mut [f32]) {
    let line = Window { left, top, width: row.len(), height: 1 };
    let Some(inside) = line.overlap(&picture.window) else { return };
    let (x, from) = ((inside.left - left) as usize, (inside.left - picture.window.left) as usize);
    let y = (top - picture.window.top) as usize;
    let rows: Vec<&[f32]> = planes.iter().map(|&c| &picture.image.row(c, y)[from..from + inside.width]).collect();
    mean_row(&rows, &mut row[x..x + inside.width]);
}

/// The mean of some rows, value by value.
pub fn mean_row(rows: &[&[f32]], out: &mut [f32]) {
    match rows {
        [row] => out.copy_from_slice(row),
        _ => out.iter_mut().enumerate().for_each(|(x, value)| *value = mean_of(rows.iter().map(|row| row[x]))),
    }
}

/// The mean of some values; of equal ones, that value bit for bit.
fn mean_of(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let mut others = values.clone();
    let Some(first) = others.next() else { return 0.0 };
    if others.all(|value| value.to_bits() == first.to_bits()) {
        return first;
    }
    let (sum, count) = values.fold((0.0f64, 0u32), |(sum, count), value| (sum + f64::from(value), count + 1));
    (sum / f64::from(count)) as f32
}
