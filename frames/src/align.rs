//! Pictures of one frame are laid over each other by their data windows.
//!
//! Windows count in the coordinates of the display window: where that is the same in two files, so are the coordinates.
//! Renderers crop each file by itself to what is not empty, so windows of one frame may differ; what all colours have is
//! the frame. Features that do not cover it are missing outside.

use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::resolve::Filled;
use crate::window::Window;
use sspc_image::{Buffer, Role};
use std::path::Path;

/// The pixels of a frame.
pub struct Aligned {
    /// What all colours have, in half a's coordinates.
    pub window: Window,
    /// What a person should know.
    pub said: Vec<String>,
}

/// Pixels of a part and the frame that they are of.
#[derive(Clone, Copy, Debug)]
pub struct Placing {
    /// The part's pixels.
    pub window: Window,
    /// The frame.
    pub display: Window,
}

impl Placing {
    /// Of a channel of a file.
    pub fn of(file: &ExrFile, channel: usize) -> Self {
        let channel = &file.channels[channel];
        Self { window: channel.window, display: file.display(channel.part) }
    }

    /// How far the pixels lie off their place in the frame of `like`: nothing where both agree in coordinates, and all of
    /// its position where a program that passes pixels through other formats has lost it. `None` where nobody can tell.
    fn shift(&self, like: &Placing, may_lose_origin: bool) -> Option<(i32, i32)> {
        let same_size = self.window.size() == like.window.size();
        let lost = same_size && (self.window.left, self.window.top) == (0, 0);
        if self.window == like.window {
            Some((0, 0))
        } else if may_lose_origin && lost {
            Some((like.window.left, like.window.top))
        } else {
            (self.display == like.display).then_some((0, 0))
        }
    }
}

/// Gives every role the window of its file that holds the frame's pixels.
///
/// # Errors
/// [`Error::SizeMismatch`]: windows whose coordinates do not agree, or that have nothing in common.
pub fn align(files: &[ExrFile], filled: &mut [Filled]) -> Result<Aligned, Error> {
    let Some(first) = filled.iter().find(|f| (f.role, f.buffer) == (Role::Radiance, Buffer::A)).cloned() else {
        // Frames without colour were refused.
        unreachable!("a resolved frame has colour");
    };
    let like = Placing::of(&files[first.file], first.channels[0]);
    let (mut window, mut said, mut shifts) = (like.window, Vec::new(), Vec::new());
    for role in filled.iter() {
        let file = &files[role.file];
        let purpose = Purpose::Role(role.role, role.buffer);
        let mismatch = |found: Window| size_mismatch(file, purpose, &like, found, &files[first.file].path);
        let mut shift = None;
        for placing in role.channels.iter().map(|&channel| Placing::of(file, channel)) {
            let own = placing.shift(&like, role.role != Role::Radiance).ok_or_else(|| mismatch(placing.window))?;
            if *shift.get_or_insert(own) != own {
                return Err(mismatch(placing.window));
            }
            let moved = placing.window.moved(own.0, own.1);
            match role.role {
                Role::Radiance | Role::Denoised => {
                    window = window.overlap(&moved).ok_or_else(|| mismatch(placing.window))?;
                }
                _ => {}
            }
        }
        shifts.push(shift.unwrap_or((0, 0)));
    }
    if window != like.window {
        said.push(format!(
            "the colours overlap in {window} of half a's {}: that is corrected, around it the picture is half a's own",
            like.window
        ));
    }
    // Files whose windows were told of, once each.
    let mut told = vec![first.file];
    for (role, (right, down)) in filled.iter_mut().zip(shifts) {
        let file = &files[role.file];
        let purpose = Purpose::Role(role.role, role.buffer);
        let own = file.channels[role.channels[0]].window;
        role.window = window.moved(-right, -down);
        if (right, down) != (0, 0) {
            said.push(format!(
                "{purpose}: {} says that it begins at (0, 0), half a begins at ({right}, {down}): taken for the same place",
                file.path.display()
            ));
        }
        if own.overlap(&role.window).is_none() {
            return Err(size_mismatch(file, purpose, &like, own, &files[first.file].path));
        }
        if own != role.window && own.contains(&role.window) && !told.contains(&role.file) {
            told.push(role.file);
            said.push(format!("{purpose}: {own}, of which {} is used", role.window));
        }
        if !own.contains(&role.window) {
            said.push(format!("{purpose}: covers only {own} of {}, and counts as missing elsewhere", role.window));
        }
    }
    Ok(Aligned { window, said })
}

/// The window of a file that holds `like`'s pixels, all of them, and a word where its origin was lost.
///
/// # Errors
/// [`Error::SizeMismatch`].
pub fn window_like(
    file: &ExrFile,
    channels: &[usize],
    like: &Placing,
    like_path: &Path,
) -> Result<(Window, Option<String>), Error> {
    let mut found = (like.window, None);
    for placing in channels.iter().map(|&channel| Placing::of(file, channel)) {
        let mismatch = || size_mismatch(file, file.purpose, like, placing.window, like_path);
        let (right, down) = placing.shift(like, true).ok_or_else(mismatch)?;
        let window = like.window.moved(-right, -down);
        if !placing.window.contains(&window) {
            return Err(mismatch());
        }
        let said = ((right, down) != (0, 0))
            .then(|| format!("{}: its origin was lost, taken for ({right}, {down})", file.path.display()));
        found = (window, said);
    }
    Ok(found)
}

fn size_mismatch(file: &ExrFile, purpose: Purpose, like: &Placing, found: Window, like_path: &Path) -> Error {
    Error::SizeMismatch {
        path: file.path.clone(),
        purpose,
        expected: like.window.to_string(),
        found: found.to_string(),
        like: like_path.into(),
    }
}
