//! What a part's attributes say of its pixels: the few that are needed, and only where they have the type that the
//! format gives them.

use super::attributes::{DEEP, Header, MULTI_PART, TILED};
use super::channels::{ChannelEntry, parse_channels};
use super::fault::Fault;
use super::limits::check_window;
use crate::window::Window;
use exr::compression::Compression;
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{ChannelDescription, ChannelList, LevelMode, LineOrder, Text, TileDescription};
use exr::meta::{BlockDescription, compute_chunk_count};

/// How the chunks of a part are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    pub tiled: bool,
    pub deep: bool,
}

/// One part.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its attributes as they are in the file.
    pub header: Header,
    pub shape: Shape,
    pub channels: Vec<ChannelEntry>,
    /// The method's number in the format.
    pub compression: u8,
    /// Where the pixels lie.
    pub window: Window,
    /// The frame that they are a part of.
    pub display: Window,
    pub tiles: Option<TileDescription>,
    /// Chunks lie in the file from the last row to the first.
    pub decreasing: bool,
    /// Number of chunks, of all levels of detail.
    pub chunks: usize,
}

impl Part {
    /// Reads the attributes of a part of a file with these `version` flags.
    ///
    /// # Errors
    /// [`Fault`]: required attributes that are missing or wrong.
    pub fn of(header: Header, version: u32) -> Result<Self, Fault> {
        let shape = shape_of(&header, version)?;
        let window = required(&header, "dataWindow", "box2i").and_then(window_of)?;
        check_window(window)?;
        let display = required(&header, "displayWindow", "box2i").and_then(window_of)?;
        let channels = parse_channels(required(&header, "channels", "chlist")?)?;
        let &[compression] = required(&header, "compression", "compression")? else {
            return Err(Fault::damaged("a compression of more than one byte"));
        };
        let &[order] = required(&header, "lineOrder", "lineOrder")? else {
            return Err(Fault::damaged("a line order of more than one byte"));
        };
        let tiles = match shape.tiled {
            true => Some(tiles_of(required(&header, "tiles", "tiledesc")?)?),
            false => None,
        };
        let mut part =
            Self { shape, channels, compression, window, display, tiles, decreasing: order == 1, chunks: 0, header };
        part.chunks = part.count_chunks()?;
        if version & (MULTI_PART | DEEP) != 0 {
            part.check_count()?;
        }
        Ok(part)
    }

    /// A text attribute, as UTF-8 where it is, else as Latin-1.
    pub fn text(&self, name: &str) -> Option<String> {
        self.header.get(name, "string").map(text_of)
    }

    /// The library's word for the compression; `None` for methods that it does not know.
    pub fn method(&self) -> Option<Compression> {
        method_of(self.compression)
    }

    /// The method's name, for messages.
    pub fn method_name(&self) -> String {
        match self.compression {
            5 => "PXR24".into(),
            6 => "B44".into(),
            7 => "B44A".into(),
            8 => "DWAA".into(),
            9 => "DWAB".into(),
            10 | 11 => "HTJ2K".into(),
            12 => "LJ2K".into(),
            13 => "ZSTD".into(),
            other => match method_of(other) {
                Some(method) => method.to_string(),
                None => format!("the unknown compression {other}"),
            },
        }
    }

    /// Whether pixels may change when they are stored.
    pub fn is_lossy(&self) -> bool {
        self.method().is_some_and(Compression::may_loose_data)
    }

    /// Why nobody here can decode the pixels; `None` where somebody can.
    pub fn undecodable(&self) -> Option<Fault> {
        let unsupported = |expected, found| Some(Fault::Unsupported { expected, found });
        if self.shape.deep {
            return unsupported("flat data", "deep data".into());
        }
        if matches!(self.method(), None | Some(Compression::HTJ2K32 | Compression::HTJ2K256)) {
            return unsupported("none, RLE, ZIP, PIZ, PXR24, B44 or DWA compression", self.method_name());
        }
        let sampled = self.channels.iter().find(|channel| channel.sampling != (1, 1))?;
        let (x, y) = sampled.sampling;
        unsupported("every pixel sampled", format!("channel {} sampled {x}x{y}", sampled.shown_name()))
    }

    /// The header as the library's codecs want it: what they need and nothing else.
    pub fn codec_header(&self) -> exr::meta::header::Header {
        let list = self.channels.iter().map(|channel| ChannelDescription {
            name: Text::from_slice_unchecked(&channel.name),
            sample_type: channel.kind,
            quantize_linearly: channel.is_linear(),
            sampling: Vec2(1, 1),
        });
        let size = Vec2(self.window.width, self.window.height);
        let name = Text::from_slice_unchecked(b"part");
        let list: Vec<ChannelDescription> = list.collect();
        let bytes = list.iter().map(|channel| channel.sample_type.bytes_per_sample()).sum();
        let mut header = exr::meta::header::Header::new(name, size, Default::default());
        header.channels = ChannelList { bytes_per_pixel: bytes, ..ChannelList::new(list.into_iter().collect()) };
        header.with_encoding(self.method().unwrap_or(Compression::Uncompressed), self.blocks(), LineOrder::Increasing)
    }

    fn blocks(&self) -> BlockDescription {
        self.tiles.map_or(BlockDescription::ScanLines, BlockDescription::Tiles)
    }

    /// Pixels of a block, of the largest level.
    pub fn block_size(&self) -> (usize, usize) {
        match (self.tiles, self.method()) {
            (Some(tiles), _) => (tiles.tile_size.0, tiles.tile_size.1),
            (None, method) => (self.window.width, method.map_or(1, Compression::scan_lines_per_block)),
        }
    }

    /// Bytes of a pixel, all channels.
    pub fn bytes_per_pixel(&self) -> usize {
        self.channels.iter().map(|channel| channel.kind.bytes_per_sample()).sum()
    }

    /// What the part's pixels, compression and tiles make of it.
    pub(super) fn count_chunks(&self) -> Result<usize, Fault> {
        match (self.method(), self.tiles) {
            // The rows of a block are not known.
            (None, None) => Ok(claimed_chunks(&self.header).unwrap_or(0)),
            _ => {
                let size = Vec2(self.window.width, self.window.height);
                Ok(compute_chunk_count(self.method().unwrap_or(Compression::Uncompressed), size, self.blocks()))
            }
        }
    }

    fn check_count(&self) -> Result<(), Fault> {
        match claimed_chunks(&self.header) {
            Some(claimed) if claimed == self.chunks => Ok(()),
            Some(claimed) => Err(Fault::damaged(format!("{claimed} chunks for a part of {}", self.chunks))),
            None => Err(missing("chunkCount", "int")),
        }
    }
}

/// UTF-8 where the bytes are UTF-8, else Latin-1.
pub fn text_of(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_string(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Texts of an attribute of type `stringvector`; nothing where it is malformed.
pub fn texts_of(mut bytes: &[u8]) -> Vec<String> {
    let mut texts = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let Ok(length) = usize::try_from(i32::from_le_bytes(*length)) else { return Vec::new() };
        let Some((text, rest)) = rest.split_at_checked(length) else { return Vec::new() };
        texts.push(text_of(text));
        bytes = rest;
    }
    texts
}

fn missing(name: &str, kind: &str) -> Fault {
    Fault::damaged(format!("no attribute {name} of type {kind}"))
}

fn required<'a>(header: &'a Header, name: &str, kind: &str) -> Result<&'a [u8], Fault> {
    header.get(name, kind).ok_or_else(|| missing(name, kind))
}

fn shape_of(header: &Header, version: u32) -> Result<Shape, Fault> {
    let kind = header.get("type", "string");
    let is_told = version & (MULTI_PART | DEEP) != 0;
    let of_type = |kind: &[u8]| match kind {
        b"scanlineimage" => Ok(Shape { tiled: false, deep: false }),
        b"tiledimage" => Ok(Shape { tiled: true, deep: false }),
        b"deepscanline" => Ok(Shape { tiled: false, deep: true }),
        b"deeptile" => Ok(Shape { tiled: true, deep: true }),
        other => Err(Fault::Unsupported { expected: "a known type of part", found: shown_bytes(other) }),
    };
    match kind {
        Some(kind) if is_told => of_type(kind),
        None if is_told => Err(missing("type", "string")),
        _ => Ok(Shape { tiled: version & TILED != 0, deep: false }),
    }
}

fn shown_bytes(bytes: &[u8]) -> String {
    format!("'{}'", text_of(bytes))
}

fn integer(bytes: &[u8], at: usize) -> Option<i32> {
    bytes.get(at..at + 4)?.try_into().ok().map(i32::from_le_bytes)
}

fn window_of(bytes: &[u8]) -> Result<Window, Fault> {
    let corners: Option<Vec<i32>> = (0..4).map(|i| integer(bytes, 4 * i)).collect();
    let Some(&[left, top, right, bottom]) = corners.as_deref() else {
        return Err(Fault::damaged("a window of less than four numbers"));
    };
    let side = |first: i32, last: i32| usize::try_from(i64::from(last) - i64::from(first) + 1).ok();
    match (side(left, right), side(top, bottom)) {
        (Some(width), Some(height)) => Ok(Window { left, top, width, height }),
        _ => Err(Fault::damaged(format!("a window from ({left}, {top}) to ({right}, {bottom})"))),
    }
}

fn tiles_of(bytes: &[u8]) -> Result<TileDescription, Fault> {
    let wrong = || Fault::damaged("an unknown description of tiles");
    let [width, height] = [integer(bytes, 0), integer(bytes, 4)].map(|v| v.and_then(|v| usize::try_from(v).ok()));
    let (Some(width @ 1..), Some(height @ 1..), [.., mode]) = (width, height, bytes) else { return Err(wrong()) };
    if bytes.len() != 9 {
        return Err(wrong());
    }
    let level_mode = match mode & 0xf {
        0 => LevelMode::Singular,
        1 => LevelMode::MipMap,
        2 => LevelMode::RipMap,
        _ => return Err(wrong()),
    };
    let rounding_mode = match mode >> 4 {
        0 => RoundingMode::Down,
        1 => RoundingMode::Up,
        _ => return Err(wrong()),
    };
    Ok(TileDescription { tile_size: Vec2(width, height), level_mode, rounding_mode })
}

fn claimed_chunks(header: &Header) -> Option<usize> {
    header.get("chunkCount", "int").and_then(|bytes| integer(bytes, 0)).and_then(|count| usize::try_from(count).ok())
}

fn method_of(number: u8) -> Option<Compression> {
    use Compression::*;
    Some(match number {
        0 => Uncompressed,
        1 => RLE,
        2 => ZIP1,
        3 => ZIP16,
        4 => PIZ,
        5 => PXR24,
        6 => B44,
        7 => B44A,
        8 => DWAA(None),
        9 => DWAB(None),
        10 => HTJ2K256,
        11 => HTJ2K32,
        _ => return None,
    })
}
