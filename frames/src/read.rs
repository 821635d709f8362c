//! The frame, the reference and single pictures, read and checked.

use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::files::FrameFiles;
use crate::layers::Layers;
use crate::open::OpenFrame;
use crate::overrides::RoleOverrides;
use sspc_image::{Buffer, Frame, Image, Reference, Role};
use std::path::Path;

/// Reads a frame: finds its roles, decodes only their channels, and checks that the halves can be what they
/// claim to be. Values are as in the files, NaN and Inf included.
///
/// # Errors
/// Every variant of [`Error`] of kind input, and [`Error::Override`] never (overrides are parsed before).
pub fn read_frame(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Frame, Error> {
    let open = OpenFrame::open(files, overrides)?;
    let rows = 0..open.height();
    let mut frame = open.rows(rows.clone())?;
    let mut inspection = open.inspection();
    inspection.look(&frame, 0, rows);
    frame.sources = open.sources();
    frame.warnings = open.warnings(&inspection)?;
    Ok(frame)
}

/// What another picture must agree with in size.
#[derive(Clone, Copy, Debug)]
pub struct Like<'a> {
    pub image: &'a Image,
    pub path: &'a Path,
}

/// Reads a reference: its colour, and its two halves when it has layers marked a and b (or even and odd).
/// Without colour of its own, the mean of the halves is the reference.
///
/// # Errors
/// A file that cannot be read, has neither colour nor halves, or differs in size from `like`.
pub fn read_reference(path: &Path, like: Option<Like>) -> Result<Reference, Error> {
    let purpose = Purpose::Reference;
    let file = ExrFile::open(path, purpose)?;
    let layers = Layers::of(&file);
    let mean = layers.find(Role::Radiance, None);
    let halves = layers.find(Role::Radiance, Some(Buffer::A)).zip(layers.find(Role::Radiance, Some(Buffer::B)));
    let mut groups: Vec<Vec<usize>> = mean.iter().map(|hit| hit.channels.clone()).collect();
    if let Some((a, b)) = &halves {
        groups.extend([a.channels.clone(), b.channels.clone()]);
    }
    if groups.is_empty() {
        let expected = "R,G,B, or both halves as a.R,a.G,a.B and b.R,b.G,b.B".to_string();
        return Err(Error::MissingRole { path: path.into(), purpose, expected, found: layers.summary() });
    }
    check_like(&file, &groups, like)?;
    let mut images = file.images(&groups)?;
    let halves = halves.is_some().then(|| {
        let b = images.pop();
        let a = images.pop();
        a.zip(b)
    });
    let halves = halves.flatten().map(|(a, b)| [a, b]);
    let mean = match (images.pop(), &halves) {
        (Some(mean), _) => mean,
        (None, Some([a, b])) => Image::mean_of(a, b),
        (None, None) => unreachable!("groups are not empty"),
    };
    Ok(Reference { mean, halves })
}

/// Reads the colour that a viewer would show, `[3, H, W]`: the root's R,G,B, Cycles' Combined, Beauty, ...
///
/// # Errors
/// A file that cannot be read, has no colour, or differs in size from `like`.
pub fn read_picture(path: &Path, like: Option<Like>) -> Result<Image, Error> {
    let purpose = Purpose::Picture;
    let file = ExrFile::open(path, purpose)?;
    let layers = Layers::of(&file);
    let Some(hit) = layers.find_picture() else {
        let expected = "R,G,B, Combined or Beauty".to_string();
        return Err(Error::MissingRole { path: path.into(), purpose, expected, found: layers.summary() });
    };
    let groups = [hit.channels];
    check_like(&file, &groups, like)?;
    let mut images = file.images(&groups)?;
    Ok(images.swap_remove(0))
}

fn check_like(file: &ExrFile, groups: &[Vec<usize>], like: Option<Like>) -> Result<(), Error> {
    let Some(first) = groups.first().and_then(|group| group.first()) else { return Ok(()) };
    let first = file.channels[*first].window;
    let (width, height, path) = match like {
        Some(like) => (like.image.width(), like.image.height(), like.path),
        None => (first.width, first.height, file.path.as_path()),
    };
    for window in groups.iter().flatten().map(|&at| file.channels[at].window) {
        if (window.width, window.height) != (width, height) {
            return Err(Error::SizeMismatch {
                path: file.path.clone(),
                purpose: file.purpose,
                expected: format!("{width}x{height}"),
                found: window.to_string(),
                like: path.into(),
            });
        }
    }
    Ok(())
}
