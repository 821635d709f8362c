//! Frames whose rows can be asked for, held or read when they are needed.

use crate::Frame;
use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Range;

/// Something that rows of a frame can be asked of.
pub trait FrameRows {
    /// Why rows could not be had.
    type Error;

    /// Rows of the picture.
    fn height(&self) -> usize;

    /// Columns.
    fn width(&self) -> usize;

    /// Some rows of every role.
    ///
    /// # Errors
    /// What reading can raise.
    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Self::Error>;

    /// Whether rows come with a [`Frame::composite`].
    fn has_composite(&self) -> bool {
        false
    }
}

impl FrameRows for Frame {
    type Error = Infallible;

    fn height(&self) -> usize {
        Frame::height(self)
    }

    fn width(&self) -> usize {
        Frame::width(self)
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Infallible> {
        Ok(match rows.len() == Frame::height(self) {
            true => Cow::Borrowed(self),
            false => Cow::Owned(Frame::rows(self, rows.start, rows.len())),
        })
    }

    fn has_composite(&self) -> bool {
        self.composite.is_some()
    }
}
