//! Chunks of a file to planes: some chunks at a time, decompressed on all threads, and only those that hold what is
//! asked for.

use crate::exr_file::{Channel, ExrFile, FileReader};
use exr::block::chunk::Chunk;
use exr::block::reader::ChunksReader;
use exr::block::samples::FromNativeSample;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;
use sspc_image::Image;
use std::collections::BTreeSet;
use std::ops::Range;

/// Decompressed bytes that are held at once; more only where a single chunk is larger.
const BATCH_BYTES: usize = 96 << 20;

/// Hands the decompressed blocks that `wanted` accepts to `take`, some at a time, in the file's order, each once: what a
/// block says of its own place need not be what the file's table says of it, and where one comes twice, another is
/// missing.
pub(super) fn for_blocks<E: From<ExrError>>(
    reader: FileReader,
    wanted: impl Fn(&BlockIndex) -> bool,
    mut take: impl FnMut(&[Header], Vec<UncompressedBlock>) -> Result<(), E>,
) -> Result<(), E> {
    let mut chunks = reader.filter_chunks(true, |_, tile, block| tile.level_index == Vec2(0, 0) && wanted(&block))?;
    let meta = chunks.meta_data().clone();
    let largest = meta.headers.iter().map(Header::max_block_byte_size).max().unwrap_or(0);
    let batch = (BATCH_BYTES / largest.max(1)).max(1);
    let mut seen = BTreeSet::new();
    loop {
        let compressed = chunks.by_ref().take(batch).collect::<Result<Vec<Chunk>, _>>()?;
        if compressed.is_empty() {
            return Ok(());
        }
        let decompress = |chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false);
        let blocks = compressed.into_par_iter().map(decompress).collect::<Result<Vec<_>, _>>()?;
        for BlockIndex { layer, pixel_position: Vec2(x, y), level, .. } in blocks.iter().map(|block| block.index) {
            if level != Vec2(0, 0) || !seen.insert((layer, x, y)) {
                return Err(ExrError::Invalid("a block out of its place".into()).into());
            }
        }
        take(&meta.headers, blocks)?;
    }
}

/// Rows of one image per group of channels, `[group.len(), rows.len(), W]`.
pub(super) fn images(
    reader: FileReader,
    file: &ExrFile,
    groups: &[Vec<usize>],
    rows: &Range<usize>,
) -> Result<Vec<Image>, ExrError> {
    let size = |group: &Vec<usize>| (group.len(), rows.len(), file.channels[group[0]].window.width);
    let mut images: Vec<Image> = groups.iter().map(size).map(|(c, h, w)| Image::zeros(c, h, w)).collect();
    let mut slots: Vec<Slot> = Vec::new();
    for (image, group) in images.iter_mut().zip(groups) {
        let planes = image.all_planes_mut().zip(group);
        slots.extend(planes.map(|(plane, &at)| Slot { channel: &file.channels[at], missing: plane.len(), plane }));
    }
    let mut needed = vec![false; file.lossy.len()];
    slots.iter().for_each(|slot| needed[slot.channel.part] = true);
    let wanted = |block: &BlockIndex| {
        let (top, height) = (block.pixel_position.1, block.pixel_size.1);
        needed[block.layer] && top < rows.end && top + height > rows.start
    };
    for_blocks(reader, wanted, |headers, blocks| {
        slots.par_iter_mut().try_for_each(|slot| blocks.iter().try_for_each(|block| slot.take(block, headers, rows)))
    })?;
    match slots.iter().all(|slot| slot.missing == 0) {
        true => Ok(images),
        false => Err(ExrError::Invalid("missing bytes".into())),
    }
}

/// Where the samples of one channel go.
struct Slot<'a> {
    channel: &'a Channel,
    plane: &'a mut [f32],
    /// Samples that have not come yet.
    missing: usize,
}

impl Slot<'_> {
    /// Takes the channel's part of the rows out of a block.
    fn take(&mut self, block: &UncompressedBlock, headers: &[Header], rows: &Range<usize>) -> Result<(), ExrError> {
        if block.index.layer != self.channel.part {
            return Ok(());
        }
        let lines = Lines::of(&headers[self.channel.part], block, self.channel.index);
        let BlockIndex { pixel_position: Vec2(left, top), pixel_size: Vec2(width, height), .. } = block.index;
        let outside = || ExrError::Invalid("pixels outside the data window".into());
        for y in rows.start.max(top)..rows.end.min(top + height) {
            let start = (y - rows.start) * self.channel.window.width + left;
            let row = self.plane.get_mut(start..start + width).ok_or_else(outside)?;
            convert_line(block.data.get(lines.bytes(y - top)).ok_or_else(outside)?, lines.kind, row);
            self.missing = self.missing.saturating_sub(width);
        }
        Ok(())
    }
}

/// Where the lines of one channel lie in a decompressed block: line after line, in each all channels.
pub(super) struct Lines {
    first: usize,
    /// Bytes from one line to the next.
    stride: usize,
    length: usize,
    pub kind: SampleType,
}

impl Lines {
    /// Lines of channel `index` of the part.
    pub fn of(header: &Header, block: &UncompressedBlock, index: usize) -> Self {
        let width = block.index.pixel_size.0;
        let list = &header.channels.list;
        let before: usize = list[..index].iter().map(|channel| channel.sample_type.bytes_per_sample()).sum();
        let kind = list[index].sample_type;
        Self {
            first: before * width,
            stride: header.channels.bytes_per_pixel * width,
            length: kind.bytes_per_sample() * width,
            kind,
        }
    }

    /// Bytes of line `y` of the block.
    pub fn bytes(&self, y: usize) -> Range<usize> {
        let start = self.first + y * self.stride;
        start..start + self.length
    }
}

/// Samples of one line (native endian, as the decoder leaves them) to f32.
fn convert_line(bytes: &[u8], kind: SampleType, row: &mut [f32]) {
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
