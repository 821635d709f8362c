//! Chunks of a file: where the tables say they are, as bytes, and as pixels.

use super::Container;
use super::fault::Fault;
use super::part::{Part, Shape};
use super::zip;
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::attribute::IntegerBounds;
use exr::meta::header::Header as CodecHeader;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;

/// Place of a block's pixels in its part, without regard to the data window's position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Block {
    fn bounds(&self) -> IntegerBounds {
        let position = Vec2(self.left as i32, self.top as i32);
        IntegerBounds { position, size: Vec2(self.width, self.height) }
    }
}

/// Blocks of the largest level of a part that hold any of these rows, as indices into its table.
pub fn blocks_of_rows(part: &Part, rows: &Range<usize>) -> Range<usize> {
    let (width, height) = part.block_size();
    let across = part.window.width.div_ceil(width);
    rows.start / height * across..rows.end.min(part.window.height).div_ceil(height) * across
}

/// The block of the largest level with this index in the part's table.
pub fn block(part: &Part, index: usize) -> Block {
    let (width, height) = part.block_size();
    let across = part.window.width.div_ceil(width);
    let (left, top) = (index % across * width, index / across * height);
    Block { left, top, width: width.min(part.window.width - left), height: height.min(part.window.height - top) }
}

/// The start of a chunk: what it says of itself before its data.
struct Start {
    /// Number of its part, in files of several.
    part: Option<i32>,
    /// Row, or column and row of a tile and its levels.
    place: Vec<i32>,
    /// Bytes of the data.
    data: u64,
    /// Bytes before the data.
    length: u64,
}

/// Reads chunks of a file.
pub struct ChunkReader<'a> {
    container: &'a Container,
    file: BufReader<File>,
}

impl<'a> ChunkReader<'a> {
    /// Opens the file once more.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(container: &'a Container) -> Result<Self, Fault> {
        Ok(Self { container, file: BufReader::new(File::open(&container.path)?) })
    }

    /// The data of a block of the largest level, still compressed.
    ///
    /// # Errors
    /// [`Fault`]: a chunk that is not where the table says, or another one.
    pub fn data(&mut self, part: usize, index: usize) -> Result<Vec<u8>, Fault> {
        let at = self.container.tables[part][index];
        let of = &self.container.parts[part];
        let start = self.start(part, at)?;
        let place = block(of, index);
        let expected = match of.tiles {
            Some(tiles) => {
                let Vec2(width, height) = tiles.tile_size;
                vec![(place.left / width) as i32, (place.top / height) as i32, 0, 0]
            }
            None => vec![of.window.top + place.top as i32],
        };
        // What a block says of its own place need not be what the table says of it.
        if start.place != expected || start.part.is_some_and(|number| number != part as i32) {
            return Err(Fault::damaged("a block out of its place"));
        }
        let most = place.width as u64 * place.height as u64 * of.bytes_per_pixel() as u64;
        if start.data > most.max(1) {
            return Err(Fault::damaged("a block that is larger than its pixels"));
        }
        let mut data = vec![0; start.data as usize];
        self.file.read_exact(&mut data)?;
        Ok(data)
    }

    /// A chunk with its start, as it is in the file, to `take` in pieces; its length.
    ///
    /// # Errors
    /// [`Fault`], and what `take` fails with.
    pub fn copy<E: From<Fault>>(
        &mut self,
        part: usize,
        index: usize,
        mut take: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<u64, E> {
        const PIECE: u64 = 1 << 20;
        let at = self.container.tables[part][index];
        let Start { data, length, part: number, .. } = self.start(part, at)?;
        if number.is_some_and(|number| number != part as i32) {
            return Err(Fault::damaged("a block out of its place").into());
        }
        self.file.seek(SeekFrom::Start(at)).map_err(Fault::from)?;
        let mut left = length + data;
        let mut piece = vec![0; PIECE.min(left) as usize];
        while left > 0 {
            let now = &mut piece[..PIECE.min(left) as usize];
            self.file.read_exact(now).map_err(Fault::from)?;
            take(now)?;
            left -= now.len() as u64;
        }
        Ok(length + data)
    }

    /// Whether a chunk lies inside the file and belongs to the part.
    ///
    /// # Errors
    /// [`Fault`].
    pub fn check(&mut self, part: usize, index: usize) -> Result<(), Fault> {
        let start = self.start(part, self.container.tables[part][index])?;
        match start.part.is_none_or(|number| number == part as i32) {
            true => Ok(()),
            false => Err(Fault::damaged("a block out of its place")),
        }
    }

    /// The offsets of chunks as they follow each other in the file, for files whose writer did not come to its tables.
    /// Chunks of smaller levels, and those that are not there, stay at 0.
    ///
    /// # Errors
    /// What the system says.
    pub fn scan(&mut self) -> Result<Vec<Vec<u64>>, Fault> {
        let Container { parts, tables, .. } = self.container;
        let mut found: Vec<Vec<u64>> = tables.iter().map(|table| vec![0; table.len()]).collect();
        let mut at = self.container.first_chunk;
        for _ in 0..found.iter().map(Vec::len).sum() {
            let number = match self.container.is_multi_part() {
                true => self.part_at(at)?,
                false => Some(0),
            };
            let Some(number) = number.filter(|number| *number < parts.len()) else { break };
            let Ok(start) = self.start(number, at) else { break };
            if let Some(offset) = index_of(&parts[number], &start.place).and_then(|at| found[number].get_mut(at)) {
                *offset = if *offset == 0 { at } else { *offset };
            }
            at += start.length + start.data;
        }
        Ok(found)
    }

    /// The number of its part that the chunk at this offset says; `None` at the end of the file.
    fn part_at(&mut self, at: u64) -> Result<Option<usize>, Fault> {
        let mut number = [0; 4];
        self.file.seek(SeekFrom::Start(at))?;
        match self.file.read_exact(&mut number) {
            Ok(()) => Ok(usize::try_from(i32::from_le_bytes(number)).ok()),
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads the start of the chunk at this offset, after which the file stands at its data.
    fn start(&mut self, part: usize, at: u64) -> Result<Start, Fault> {
        let Container { length: file_bytes, parts, .. } = self.container;
        let Shape { tiled, deep } = parts[part].shape;
        let multi = self.container.is_multi_part();
        let places = if tiled { 4 } else { 1 };
        let length = 4 * (u64::from(multi) + places) + if deep { 24 } else { 4 };
        if at < self.container.first_chunk || at.checked_add(length).is_none_or(|end| end > *file_bytes) {
            return Err(Fault::cut_short());
        }
        // Chunks that follow each other are read without another seek of the system.
        let here = self.file.stream_position()?;
        self.file.seek_relative(at as i64 - here as i64)?;
        let mut bytes = vec![0; length as usize];
        self.file.read_exact(&mut bytes)?;
        let mut numbers = bytes.chunks_exact(4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let part = numbers.by_ref().take(usize::from(multi)).next();
        let place: Vec<i32> = numbers.by_ref().take(places as usize).collect();
        let data = match deep {
            false => numbers.next().and_then(|size| u64::try_from(size).ok()),
            true => {
                let sizes = &bytes[bytes.len() - 24..];
                let size = |at: usize| u64::from_le_bytes(sizes[at..at + 8].try_into().unwrap_or_default());
                size(0).checked_add(size(8))
            }
        };
        match data.filter(|data| at.checked_add(length + data).is_some_and(|end| end <= *file_bytes)) {
            Some(data) => Ok(Start { part, place, data, length }),
            None => Err(Fault::cut_short()),
        }
    }
}

/// The index in its part's table of the chunk at this place, if it is one of the largest level.
fn index_of(part: &Part, place: &[i32]) -> Option<usize> {
    let (width, height) = part.block_size();
    match *place {
        [y] => {
            let row = usize::try_from(i64::from(y) - i64::from(part.window.top)).ok()?;
            row.is_multiple_of(height).then_some(row / height)
        }
        [x, y, 0, 0] => {
            let (x, across) = (usize::try_from(x).ok()?, part.window.width.div_ceil(width));
            (x < across).then_some(usize::try_from(y).ok()?.checked_mul(across)? + x)
        }
        _ => None,
    }
}

/// Pixels of a block: line after line, in each all channels, native endian.
///
/// # Errors
/// [`Fault`]: data that cannot be decoded.
pub fn decompress(header: &CodecHeader, place: Block, data: Vec<u8>) -> Result<Vec<u8>, Fault> {
    let bytes = place.width * place.height * header.channels.bytes_per_pixel;
    // What would not shrink is stored as it is.
    if is_zip(header) && cfg!(target_endian = "little") && data.len() != bytes {
        return zip::decompressed(&data, bytes).ok_or_else(|| Fault::damaged("zlib-compressed data malformed"));
    }
    Ok(header.compression.decompress_image_section_from_le(header, data, place.bounds(), false)?)
}

/// The inverse of [`decompress`], for lossless methods.
///
/// # Errors
/// [`Fault`]: a method that the library does not write.
pub fn compress(header: &CodecHeader, place: Block, pixels: Vec<u8>) -> Result<Vec<u8>, Fault> {
    if is_zip(header) && cfg!(target_endian = "little") {
        return Ok(zip::compressed(&pixels).unwrap_or(pixels));
    }
    Ok(header.compression.compress_image_section_to_le(header, pixels, place.bounds())?)
}

fn is_zip(header: &CodecHeader) -> bool {
    matches!(header.compression, Compression::ZIP1 | Compression::ZIP16)
}

/// A chunk of flat data as it is written.
pub fn chunk_bytes(part: &Part, number: Option<usize>, place: Block, data: &[u8]) -> Vec<u8> {
    let number = number.map(|number| number as i32);
    let places = match part.tiles {
        Some(tiles) => {
            let Vec2(width, height) = tiles.tile_size;
            vec![(place.left / width) as i32, (place.top / height) as i32, 0, 0]
        }
        None => vec![part.window.top + place.top as i32],
    };
    let start = number.into_iter().chain(places).chain([data.len() as i32]);
    start.flat_map(i32::to_le_bytes).chain(data.iter().copied()).collect()
}
