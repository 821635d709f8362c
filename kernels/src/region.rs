//! Rectangles of a picture.

/// A rectangle of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    pub top: usize,
    pub left: usize,
    pub height: usize,
    pub width: usize,
}

impl Region {
    /// The whole of a picture.
    pub fn whole(height: usize, width: usize) -> Self {
        Self { top: 0, left: 0, height, width }
    }

    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// As large, at the first pixel: a region in windows that are its own.
    pub fn at_origin(self) -> Self {
        Self { top: 0, left: 0, ..self }
    }
}
