//! Where pixels lie: rectangles in the coordinates that all files of a frame share.

use std::fmt;

/// Position and size of pixels, as a file's data window has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: i32,
    /// First row.
    pub top: i32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// What both windows have; `None` where that is nothing.
    pub fn overlap(&self, other: &Window) -> Option<Window> {
        let side = |a: (i32, usize), b: (i32, usize)| {
            let first = a.0.max(b.0);
            let last = (i64::from(a.0) + a.1 as i64).min(i64::from(b.0) + b.1 as i64);
            usize::try_from(last - i64::from(first)).ok().filter(|length| *length > 0).map(|length| (first, length))
        };
        let (left, width) = side((self.left, self.width), (other.left, other.width))?;
        let (top, height) = side((self.top, self.height), (other.top, other.height))?;
        Some(Window { left, top, width, height })
    }

    /// Whether the other window lies in this one.
    pub fn contains(&self, other: &Window) -> bool {
        self.overlap(other) == Some(*other)
    }

    /// The same pixels elsewhere.
    pub fn moved(&self, right: i32, down: i32) -> Window {
        Window { left: self.left + right, top: self.top + down, ..*self }
    }

    /// Some rows of it, counted from its top.
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Window {
        Window { top: self.top + rows.start as i32, height: rows.len(), ..*self }
    }
}

impl fmt::Display for Window {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}x{}", self.width, self.height)?;
        if (self.left, self.top) != (0, 0) {
            write!(out, " at ({}, {})", self.left, self.top)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_overlap_in_the_coordinates_of_the_frame() {
        let a = Window { left: 30, top: -14, width: 69, height: 69 };
        assert_eq!(a.overlap(&a.moved(4, -1)), Some(Window { left: 34, top: -14, width: 65, height: 68 }));
        assert_eq!(a.overlap(&a.moved(69, 0)), None);
        assert!(Window { left: 0, top: -20, width: 200, height: 200 }.contains(&a) && a.contains(&a));
        assert!(!a.contains(&a.moved(1, 0)));
        assert_eq!(a.rows(3..5), Window { left: 30, top: -11, width: 69, height: 2 });
    }
}
