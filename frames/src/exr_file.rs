//! Headers of one OpenEXR file, with limits on what a header may claim before anything is allocated.

use crate::decode;
use crate::error::{Error, Purpose};
use exr::block::reader::Reader;
use exr::compression::Compression;
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::header::Header;
use sspc_image::{Image, shown};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Largest width or height: four times 16K.
const MAX_SIDE: usize = 65_536;
/// Most pixels of one part: eight 8K frames.
const MAX_PIXELS: usize = 1 << 28;
/// Most channels of a file; production files with many light groups have some hundreds.
const MAX_CHANNELS: usize = 4_096;
/// Deflate cannot shrink more than 1032 times, nor can the simpler methods.
const MAX_RATIO_DEFLATE: u64 = 1_100;
/// Wavelets and DWA of a constant picture can shrink more.
const MAX_RATIO_OTHER: u64 = 65_536;
/// Small files may claim this much whatever the ratio, in bytes.
const ALWAYS_ALLOWED: u64 = 1 << 26;

/// Position and size of the pixels of a part, as in the file's data window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    pub left: i32,
    pub top: i32,
    pub width: usize,
    pub height: usize,
}

impl std::fmt::Display for Window {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}x{}", self.width, self.height)?;
        if (self.left, self.top) != (0, 0) {
            write!(out, " at ({}, {})", self.left, self.top)?;
        }
        Ok(())
    }
}

/// One channel of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Index of the part that holds it.
    pub part: usize,
    /// Index among the channels of that part.
    pub index: usize,
    /// The name; in a multi-part file led by the part's name unless it already is.
    pub name: String,
    /// The part's pixels.
    pub window: Window,
}

/// What the headers of a file say.
#[derive(Clone, Debug)]
pub struct ExrFile {
    pub path: PathBuf,
    /// What the file is read for, for messages.
    pub purpose: Purpose,
    /// All channels, parts in file order.
    pub channels: Vec<Channel>,
    /// The lossy compression method of each part that has one.
    pub lossy: Vec<Option<&'static str>>,
    /// The view of each part, where it says so.
    pub part_views: Vec<Option<String>>,
    /// All views of a stereo file; the first is the default one.
    pub views: Vec<String>,
}

impl ExrFile {
    /// Reads and checks the headers, no pixels.
    ///
    /// # Errors
    /// A missing or unreadable file, one that is not OpenEXR, a damaged header, deep or subsampled data, and
    /// headers that claim more than the limits of this module or than the file's length can hold.
    pub fn open(path: &Path, purpose: Purpose) -> Result<Self, Error> {
        let reader = open_reader(path, purpose)?;
        let headers = reader.headers();
        let multi = headers.len() > 1;
        let mut channels = Vec::new();
        for (part, header) in headers.iter().enumerate() {
            let window = window_of(header);
            for (index, channel) in header.channels.list.iter().enumerate() {
                let name = full_name(header, &channel.name.to_string(), multi);
                channels.push(Channel { part, index, name, window });
            }
        }
        let lossy = headers.iter().map(|header| lossy_name(header.compression)).collect();
        let (part_views, views) = views_of(headers);
        Ok(Self { path: path.to_path_buf(), purpose, channels, lossy, part_views, views })
    }

    /// Decodes one image per group of channels (indices into [`Self::channels`]), `[group.len(), H, W]`.
    /// The channels of a group must share one window.
    ///
    /// # Errors
    /// [`Error::Damaged`] when pixels are missing or cannot be decoded.
    pub fn images(&self, groups: &[Vec<usize>]) -> Result<Vec<Image>, Error> {
        let height = groups.iter().map(|group| self.channels[group[0]].window.height).max().unwrap_or(0);
        self.rows(groups, 0..height)
    }

    /// The same for some rows of the groups, which must share one height, `[group.len(), rows.len(), W]`. Chunks that
    /// hold none of these rows are not read.
    ///
    /// # Errors
    /// As [`Self::images`].
    pub fn rows(&self, groups: &[Vec<usize>], rows: Range<usize>) -> Result<Vec<Image>, Error> {
        decode::images(self.reader()?, self, groups, &rows).map_err(|error| self.damaged(&error))
    }

    /// The file opened once more, headers checked again.
    pub(super) fn reader(&self) -> Result<FileReader, Error> {
        open_reader(&self.path, self.purpose)
    }

    /// What a failure of the decoder means.
    pub(super) fn damaged(&self, error: &ExrError) -> Error {
        damaged(&self.path, self.purpose, error)
    }
}

pub(super) type FileReader = Reader<BufReader<File>>;

fn open_reader(path: &Path, purpose: Purpose) -> Result<FileReader, Error> {
    let unreadable = |source| unreadable(path, purpose, source);
    // A pipe or device would block or never end.
    let meta = std::fs::metadata(path).map_err(unreadable)?;
    if !meta.is_file() {
        let found = if meta.is_dir() { "a folder" } else { "something that is no regular file" };
        return Err(Error::NotExr { path: path.into(), purpose, found: found.into() });
    }
    let mut file = File::open(path).map_err(unreadable)?;
    check_magic(&mut file, path, purpose)?;
    let reader = Reader::read_from_buffered(BufReader::new(file), false).map_err(|e| damaged(path, purpose, &e))?;
    check_claims(reader.headers(), meta.len(), path, purpose)?;
    Ok(reader)
}

fn unreadable(path: &Path, purpose: Purpose, source: std::io::Error) -> Error {
    match source.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Error::MissingFile { path: path.into(), purpose },
        _ => Error::Unreadable { path: path.into(), purpose, source },
    }
}

fn check_magic(file: &mut File, path: &Path, purpose: Purpose) -> Result<(), Error> {
    let mut start = Vec::new();
    let read = file.by_ref().take(16).read_to_end(&mut start).and_then(|_| file.rewind());
    read.map_err(|source| unreadable(path, purpose, source))?;
    if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return Ok(());
    }
    let printable = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let found = if start.is_empty() {
        "an empty file".to_string()
    } else if start.iter().all(printable) {
        format!("text starting with \"{}\"", shown(&String::from_utf8_lossy(&start)))
    } else {
        let bytes: Vec<String> = start.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        format!("a file starting with the bytes {}", bytes.join(" "))
    };
    Err(Error::NotExr { path: path.into(), purpose, found })
}

/// Refuses what cannot be or should not be decoded, before anything of its size is allocated.
fn check_claims(headers: &[Header], file_bytes: u64, path: &Path, purpose: Purpose) -> Result<(), Error> {
    let too_large = |expected: String, found: String| Error::TooLarge { path: path.into(), purpose, expected, found };
    let mut possible = ALWAYS_ALLOWED;
    let mut claimed = 0u64;
    let mut chunks = 0u64;
    for header in headers {
        let Vec2(width, height) = header.layer_size;
        if width == 0 || height == 0 {
            let expected = "at least one pixel".to_string();
            return Err(Error::Unsupported {
                path: path.into(),
                purpose,
                expected,
                found: format!("{width}x{height}"),
            });
        }
        if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_PIXELS {
            return Err(too_large(
                format!("at most {MAX_SIDE} pixels a side and {MAX_PIXELS} in all"),
                format!("{width}x{height}"),
            ));
        }
        check_channels(header, path, purpose)?;
        claimed = claimed.saturating_add((width * height) as u64 * header.channels.bytes_per_pixel as u64);
        chunks = chunks.saturating_add(header.chunk_count as u64);
        let ratio = match header.compression {
            Compression::PIZ | Compression::DWAA(_) | Compression::DWAB(_) => MAX_RATIO_OTHER,
            _ => MAX_RATIO_DEFLATE,
        };
        possible = possible.max(file_bytes.saturating_mul(ratio));
    }
    let channels: usize = headers.iter().map(|header| header.channels.list.len()).sum();
    if channels > MAX_CHANNELS {
        return Err(too_large(format!("at most {MAX_CHANNELS} channels"), format!("{channels}")));
    }
    if claimed > possible || chunks.saturating_mul(8) > file_bytes {
        return Err(too_large(
            format!("what a file of {file_bytes} bytes can hold"),
            format!("{claimed} bytes of pixels in {chunks} chunks"),
        ));
    }
    Ok(())
}

fn check_channels(header: &Header, path: &Path, purpose: Purpose) -> Result<(), Error> {
    let unsupported = |expected: &str, found: String| {
        Err(Error::Unsupported { path: path.into(), purpose, expected: expected.into(), found })
    };
    if header.deep {
        return unsupported("flat data", "deep data".into());
    }
    match header.channels.list.iter().find(|channel| channel.sampling != Vec2(1, 1)) {
        Some(channel) => {
            let Vec2(x, y) = channel.sampling;
            unsupported("every pixel sampled", format!("channel {} sampled {x}x{y}", shown(&channel.name.to_string())))
        }
        None => Ok(()),
    }
}

fn damaged(path: &Path, purpose: Purpose, error: &ExrError) -> Error {
    let path = path.to_path_buf();
    let expected = "a complete OpenEXR file".to_string();
    match error {
        ExrError::NotSupported(what) if what.contains("deep") => {
            Error::Unsupported { path, purpose, expected: "flat data".into(), found: "deep data".into() }
        }
        ExrError::NotSupported(what) if what.contains("subsampl") || what.contains("sampling") => {
            Error::Unsupported { path, purpose, expected: "every pixel sampled".into(), found: shown(what) }
        }
        ExrError::NotSupported(what) => {
            Error::Unsupported { path, purpose, expected: "a known OpenEXR feature".into(), found: shown(what) }
        }
        ExrError::Invalid(what) if what.contains("integer maximum") => {
            Error::TooLarge { path, purpose, expected: format!("at most {MAX_SIDE} pixels a side"), found: shown(what) }
        }
        ExrError::Invalid(what) if what.contains("missing bytes") => {
            Error::Damaged { path, purpose, expected, found: "its end before all pixels".into() }
        }
        other => Error::Damaged { path, purpose, expected, found: shown(&other.to_string()) },
    }
}

fn window_of(header: &Header) -> Window {
    let Vec2(left, top) = header.own_attributes.layer_position;
    Window { left, top, width: header.layer_size.0, height: header.layer_size.1 }
}

/// Leads the channel's name by its part's, as a single-part file would have written it.
fn full_name(header: &Header, channel: &str, multi: bool) -> String {
    let part = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let led = channel.strip_prefix(part.as_str()).is_some_and(|rest| rest.starts_with('.'));
    if !multi || part.is_empty() || led { channel.to_string() } else { format!("{part}.{channel}") }
}

fn views_of(headers: &[Header]) -> (Vec<Option<String>>, Vec<String>) {
    let part_views: Vec<_> =
        headers.iter().map(|header| header.own_attributes.view_name.as_ref().map(ToString::to_string)).collect();
    let declared = headers.iter().find_map(|header| header.own_attributes.multi_view_names.as_ref());
    let mut views: Vec<String> = declared.into_iter().flatten().map(ToString::to_string).collect();
    for view in part_views.iter().flatten() {
        if !views.contains(view) {
            views.push(view.clone());
        }
    }
    (part_views, views)
}

fn lossy_name(compression: Compression) -> Option<&'static str> {
    match compression {
        Compression::PXR24 => Some("PXR24"),
        Compression::B44 => Some("B44"),
        Compression::B44A => Some("B44A"),
        Compression::DWAA(_) => Some("DWAA"),
        Compression::DWAB(_) => Some("DWAB"),
        _ => None,
    }
}
