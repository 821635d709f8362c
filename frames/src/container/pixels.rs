//! Channels of a file as planes of f32: some blocks at a time, decompressed on all threads, and only those that hold what
//! is asked for.

use super::Container;
use super::chunks::{Block, ChunkReader, block, blocks_of_rows, decompress};
use super::fault::Fault;
use super::part::Part;
use crate::window::Window;
use exr::block::samples::FromNativeSample;
use exr::meta::attribute::SampleType;
use exr::prelude::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use std::ops::Range;

/// Decompressed bytes that are held at once; more only where a single block is larger.
const BATCH_BYTES: usize = 96 << 20;

/// A plane that is to be filled with some pixels of a channel.
pub struct Wanted<'a> {
    pub part: usize,
    /// Index among the channels of the part.
    pub channel: usize,
    /// Pixels inside the part's window.
    pub window: Window,
    /// Row by row, `window.width * window.height` values.
    pub plane: &'a mut [f32],
}

/// Fills planes with pixels.
///
/// # Errors
/// [`Fault`]: pixels that are missing or cannot be decoded.
pub fn read_planes(container: &Container, wanted: &mut [Wanted]) -> Result<(), Fault> {
    let mut reader = ChunkReader::open(container)?;
    for (number, part) in container.parts.iter().enumerate() {
        let mut slots: Vec<Slot> = wanted.iter_mut().filter(|w| w.part == number).map(|w| Slot::of(part, w)).collect();
        let (Some(first), Some(last)) =
            (slots.iter().map(|slot| slot.rows.start).min(), slots.iter().map(|slot| slot.rows.end).max())
        else {
            continue;
        };
        if let Some(fault) = part.undecodable() {
            return Err(fault);
        }
        let header = part.codec_header();
        let (block_width, block_height) = part.block_size();
        let largest =
            block_width.min(part.window.width) * block_height.min(part.window.height) * part.bytes_per_pixel();
        let batch = (BATCH_BYTES / largest.max(1)).max(1);
        let needed = |place: &Block| slots.iter().any(|slot| slot.touches(place));
        let indices: Vec<usize> =
            blocks_of_rows(part, &(first..last)).filter(|&index| needed(&block(part, index))).collect();
        for indices in indices.chunks(batch) {
            let data = indices.iter().map(|&index| reader.data(number, index)).collect::<Result<Vec<_>, _>>()?;
            let decode = |(data, &index): (Vec<u8>, &usize)| {
                let place = block(part, index);
                decompress(&header, place, data).map(|pixels| (place, pixels))
            };
            let blocks = data.into_par_iter().zip(indices).map(decode).collect::<Result<Vec<_>, _>>()?;
            slots
                .par_iter_mut()
                .try_for_each(|slot| blocks.iter().try_for_each(|(place, pixels)| slot.take(part, *place, pixels)))?;
        }
    }
    Ok(())
}

/// Where the samples of one channel go.
struct Slot<'a> {
    channel: usize,
    /// Rows and columns of the part.
    rows: Range<usize>,
    columns: Range<usize>,
    plane: &'a mut [f32],
}

impl<'a> Slot<'a> {
    fn of(part: &Part, wanted: &'a mut Wanted) -> Self {
        let Window { left, top, width, height } = wanted.window;
        assert!(part.window.contains(&wanted.window), "pixels {} of {}", wanted.window, part.window);
        let (x, y) = ((left - part.window.left) as usize, (top - part.window.top) as usize);
        Self { channel: wanted.channel, rows: y..y + height, columns: x..x + width, plane: &mut *wanted.plane }
    }

    fn touches(&self, place: &Block) -> bool {
        place.top < self.rows.end
            && place.top + place.height > self.rows.start
            && place.left < self.columns.end
            && place.left + place.width > self.columns.start
    }

    /// Takes the channel's samples out of a block.
    fn take(&mut self, part: &Part, place: Block, pixels: &[u8]) -> Result<(), Fault> {
        let lines = Lines::of(part, place, self.channel);
        let columns = self.columns.start.max(place.left)..self.columns.end.min(place.left + place.width);
        if columns.is_empty() {
            return Ok(());
        }
        for y in self.rows.start.max(place.top)..self.rows.end.min(place.top + place.height) {
            let start = (y - self.rows.start) * self.columns.len() + columns.start - self.columns.start;
            let row = &mut self.plane[start..start + columns.len()];
            let size = lines.kind.bytes_per_sample();
            let line = pixels.get(lines.bytes(y - place.top)).ok_or_else(Fault::cut_short)?;
            convert_line(&line[(columns.start - place.left) * size..][..columns.len() * size], lines.kind, row);
        }
        Ok(())
    }
}

/// Where the lines of one channel lie in a decompressed block: line after line, in each all channels.
pub struct Lines {
    first: usize,
    /// Bytes from one line to the next.
    stride: usize,
    length: usize,
    pub kind: SampleType,
}

impl Lines {
    /// Lines of channel `index` of the part.
    pub fn of(part: &Part, place: Block, index: usize) -> Self {
        let size = |kind: SampleType| kind.bytes_per_sample() * place.width;
        let before = part.channels[..index].iter().map(|channel| size(channel.kind)).sum();
        let kind = part.channels[index].kind;
        Self { first: before, stride: part.bytes_per_pixel() * place.width, length: size(kind), kind }
    }

    /// Bytes of line `y` of the block.
    pub fn bytes(&self, y: usize) -> Range<usize> {
        let start = self.first + y * self.stride;
        start..start + self.length
    }
}

/// Samples of one line (native endian, as the decoder leaves them) to f32.
pub fn convert_line(bytes: &[u8], kind: SampleType, row: &mut [f32]) {
    match kind {
        SampleType::F16 => {
            let half: Vec<f16> = bytes.chunks_exact(2).map(|b| f16::from_ne_bytes([b[0], b[1]])).collect();
            f32::from_f16s(&half, row);
        }
        SampleType::F32 => {
            for (value, b) in row.iter_mut().zip(bytes.chunks_exact(4)) {
                *value = f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
            }
        }
        SampleType::U32 => {
            for (value, b) in row.iter_mut().zip(bytes.chunks_exact(4)) {
                *value = u32::from_ne_bytes([b[0], b[1], b[2], b[3]]) as f32;
            }
        }
    }
}

/// The inverse of [`convert_line`]; half floats are rounded.
pub fn store_line(row: &[f32], kind: SampleType, bytes: &mut Vec<u8>) {
    match kind {
        SampleType::F16 => {
            let mut half = vec![f16::ZERO; row.len()];
            half.convert_from_f32_slice(row);
            bytes.extend(half.iter().flat_map(|v| v.to_ne_bytes()));
        }
        SampleType::F32 => bytes.extend(row.iter().flat_map(|v| v.to_ne_bytes())),
        SampleType::U32 => bytes.extend(row.iter().flat_map(|&v| (v as u32).to_ne_bytes())),
    }
}
