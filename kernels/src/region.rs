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

    /// Its pixels that lie in `other`, counted from the first of that.
    pub fn inside(self, other: &Self) -> Self {
        let range = |start: usize, size: usize, first: usize, all: usize| {
            let begin = start.clamp(first, first + all);
            (begin - first, (start + size).clamp(begin, first + all) - begin)
        };
        let (top, height) = range(self.top, self.height, other.top, other.height);
        let (left, width) = range(self.left, self.width, other.left, other.width);
        Self { top, left, height, width }
    }

    /// As large, at the first pixel: a region in windows that are its own.
    pub fn at_origin(self) -> Self {
        Self { top: 0, left: 0, ..self }
    }
}
