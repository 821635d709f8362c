//! Rectangles of a picture.

/// A rectangle of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First row.
    pub top: usize,
    /// First column.
    pub left: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Region {
    /// The whole of a picture.
    pub fn whole(height: usize, width: usize) -> Self {
        Self { top: 0, left: 0, height, width }
    }

    /// Pixels in it.
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// As large, at the first pixel: a region in windows that are its own.
    pub fn at_origin(self) -> Self {
        Self { top: 0, left: 0, ..self }
    }
}
