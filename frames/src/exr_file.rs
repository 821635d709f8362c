//! One OpenEXR file: its channels by name, and their pixels.

use crate::container::Container;
use crate::container::fault::Fault;
use crate::container::part::{Part, texts_of};
use crate::container::pixels::{Wanted, read_planes};
use crate::error::{Error, Purpose};
use crate::window::Window;
use sspc_image::{Image, shown};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
    /// The file.
    pub path: PathBuf,
    /// What the file is read for, for messages.
    pub purpose: Purpose,
    /// All channels that can be decoded, parts in file order.
    pub channels: Vec<Channel>,
    /// Parts that cannot be decoded, as "deep data in part fog"; nobody minds unless they are needed.
    pub undecodable: Vec<String>,
    /// The view of each part, where it says so.
    pub part_views: Vec<Option<String>>,
    /// All views of a stereo file; the first is the default one.
    pub views: Vec<String>,
    pub(crate) container: Arc<Container>,
}

impl ExrFile {
    /// Reads and checks headers and tables, no pixels.
    ///
    /// # Errors
    /// A missing or unreadable file, one that is not OpenEXR, a damaged header, nothing but deep or subsampled data or
    /// unknown compression, and headers that claim more than the limits or than the file's length can hold.
    pub fn open(path: &Path, purpose: Purpose) -> Result<Self, Error> {
        check_file(path, purpose)?;
        let container = Container::open(path).map_err(|fault| error_of(path, purpose, fault))?;
        let (mut channels, mut undecodable) = (Vec::new(), Vec::new());
        let mut first_fault = None;
        for (part, of) in container.parts.iter().enumerate() {
            if let Some(fault) = of.undecodable() {
                undecodable.push(undecodable_part(of, part, &fault));
                first_fault.get_or_insert(fault);
                continue;
            }
            for (index, channel) in of.channels.iter().enumerate() {
                let name = full_name(of, &channel.text(), container.parts.len() > 1);
                channels.push(Channel { part, index, name, window: of.window });
            }
        }
        if let Some(fault) = first_fault.filter(|_| channels.is_empty()) {
            return Err(error_of(path, purpose, fault));
        }
        let (part_views, views) = views_of(&container.parts);
        let container = Arc::new(container);
        Ok(Self { path: path.to_path_buf(), purpose, channels, undecodable, part_views, views, container })
    }

    /// Decodes one image per group of channels (indices into [`Self::channels`]), `[group.len(), H, W]`.
    /// The channels of a group must share one window.
    ///
    /// # Errors
    /// [`Error::Damaged`] when pixels are missing or cannot be decoded.
    pub fn images(&self, groups: &[Vec<usize>]) -> Result<Vec<Image>, Error> {
        let whole = |group: &Vec<usize>| (group.clone(), self.channels[group[0]].window);
        self.windows(&groups.iter().map(whole).collect::<Vec<_>>())
    }

    /// The same for a window of each group. Pixels outside of the part's own window are NaN; blocks that hold nothing of
    /// the window are not read.
    ///
    /// # Errors
    /// As [`Self::images`].
    pub fn windows(&self, groups: &[(Vec<usize>, Window)]) -> Result<Vec<Image>, Error> {
        // Of each group, what the file has of it.
        let inside = |(group, window): &(Vec<usize>, Window)| window.overlap(&self.channels[group[0]].window);
        let size = |(group, window): &(Vec<usize>, Window), inside: Option<Window>| {
            let Window { width, height, .. } = inside.unwrap_or(Window { width: 0, height: 0, ..*window });
            Image::zeros(group.len(), height, width)
        };
        let insides: Vec<Option<Window>> = groups.iter().map(inside).collect();
        let mut images: Vec<Image> = groups.iter().zip(&insides).map(|(group, inside)| size(group, *inside)).collect();
        let mut wanted: Vec<Wanted> = Vec::new();
        for ((image, (group, _)), inside) in images.iter_mut().zip(groups).zip(&insides) {
            let Some(window) = *inside else { continue };
            for (plane, &at) in image.all_planes_mut().zip(group) {
                let Channel { part, index, .. } = self.channels[at];
                wanted.push(Wanted { part, channel: index, window, plane });
            }
        }
        read_planes(&self.container, &mut wanted).map_err(|fault| self.error(fault))?;
        let whole = images.into_iter().zip(groups).zip(insides);
        Ok(whole.map(|((image, (_, window)), inside)| within(image, inside, *window)).collect())
    }

    /// Index of a channel by its exact name, else without regard to case.
    pub fn channel_named(&self, name: &str) -> Option<usize> {
        let exact = self.channels.iter().position(|channel| channel.name == name);
        exact.or_else(|| self.channels.iter().position(|channel| channel.name.to_lowercase() == name.to_lowercase()))
    }

    /// The same for several, if all are there.
    pub fn channels_named(&self, names: &[String]) -> Option<Vec<usize>> {
        names.iter().map(|name| self.channel_named(name)).collect()
    }

    /// What a part is stored with, if that is lossy.
    pub fn lossy(&self, part: usize) -> Option<String> {
        Some(&self.container.parts[part]).filter(|part| part.is_lossy()).map(Part::method_name)
    }

    /// The frame that the pixels of a part are a part of.
    pub fn display(&self, part: usize) -> Window {
        self.container.parts[part].display
    }

    /// The matrices of these names in the attributes of a part, else of the first part that has any.
    pub fn matrices(&self, part: usize, names: &[&str]) -> Vec<[f32; 16]> {
        let of_part = |part: &Part| {
            let found = names.iter().filter_map(|name| matrix_of(part.header.get(name, "m44f")?));
            Some(found.collect::<Vec<_>>()).filter(|found| !found.is_empty())
        };
        let parts = &self.container.parts;
        std::iter::once(&parts[part]).chain(parts).find_map(of_part).unwrap_or_default()
    }

    /// What a fault of this file means.
    pub(crate) fn error(&self, fault: Fault) -> Error {
        error_of(&self.path, self.purpose, fault)
    }
}

/// The values of an attribute of type m44f, if it has as many bytes.
fn matrix_of(bytes: &[u8]) -> Option<[f32; 16]> {
    let values = bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect::<Vec<_>>();
    values.try_into().ok().filter(|_| bytes.len() == 64)
}

/// An image of the pixels `inside` among those of `window`; the others are NaN.
fn within(image: Image, inside: Option<Window>, window: Window) -> Image {
    if inside == Some(window) {
        return image;
    }
    let mut whole = Image::filled(image.channels(), window.height, window.width, f32::NAN);
    if let Some(inside) = inside {
        let (left, top) = ((inside.left - window.left) as usize, (inside.top - window.top) as usize);
        for c in 0..image.channels() {
            for y in 0..inside.height {
                let start = (top + y) * window.width + left;
                whole.plane_mut(c)[start..start + inside.width].copy_from_slice(image.row(c, y));
            }
        }
    }
    whole
}

/// A pipe or device would block or never end; and what is no OpenEXR file is told by its start.
fn check_file(path: &Path, purpose: Purpose) -> Result<(), Error> {
    let unreadable = |source| unreadable(path, purpose, source);
    let meta = std::fs::metadata(path).map_err(unreadable)?;
    if !meta.is_file() {
        let found = if meta.is_dir() { "a folder" } else { "something that is no regular file" };
        return Err(Error::NotExr { path: path.into(), purpose, found: found.into() });
    }
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(16).read_to_end(&mut start)).map_err(unreadable)?;
    if start.starts_with(&crate::container::attributes::MAGIC) {
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

fn unreadable(path: &Path, purpose: Purpose, source: std::io::Error) -> Error {
    match source.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Error::MissingFile { path: path.into(), purpose },
        _ => Error::Unreadable { path: path.into(), purpose, source },
    }
}

pub(crate) fn error_of(path: &Path, purpose: Purpose, fault: Fault) -> Error {
    let path = path.to_path_buf();
    match fault {
        Fault::Io(source) => unreadable(&path, purpose, source),
        Fault::Damaged(found) => {
            Error::Damaged { path, purpose, expected: "a complete OpenEXR file".into(), found: shown(&found) }
        }
        Fault::Unsupported { expected, found } => {
            Error::Unsupported { path, purpose, expected: expected.into(), found: shown(&found) }
        }
        Fault::TooLarge { expected, found } => Error::TooLarge { path, purpose, expected, found },
    }
}

fn undecodable_part(part: &Part, number: usize, fault: &Fault) -> String {
    let name = part.text("name").map_or_else(|| format!("part {number}"), |name| format!("part {}", shown(&name)));
    match fault {
        Fault::Unsupported { found, .. } => format!("{found} in {name}"),
        _ => name,
    }
}

/// Leads the channel's name by its part's, as a single-part file would have written it.
fn full_name(part: &Part, channel: &str, several: bool) -> String {
    let name = part.text("name").unwrap_or_default();
    let led = channel.strip_prefix(name.as_str()).is_some_and(|rest| rest.starts_with('.'));
    if !several || name.is_empty() || led { channel.to_string() } else { format!("{name}.{channel}") }
}

fn views_of(parts: &[Part]) -> (Vec<Option<String>>, Vec<String>) {
    let part_views: Vec<_> = parts.iter().map(|part| part.text("view")).collect();
    let declared = parts.iter().find_map(|part| part.header.get("multiView", "stringvector"));
    let mut views = declared.map(texts_of).unwrap_or_default();
    for view in part_views.iter().flatten() {
        if !views.contains(view) {
            views.push(view.clone());
        }
    }
    (part_views, views)
}
