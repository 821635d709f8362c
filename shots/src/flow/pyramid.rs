//! Pictures in halves of their size, with a border, so that patches need no special case at the edge.

use sspc_image::Image;

/// Pixels around a level's picture, which repeat its edge.
pub const BORDER: usize = 24;
/// A picture whose smaller side is less than twice this is not halved any more.
const SMALLEST: usize = 24;

/// One size of the pictures that are matched.
pub struct Level {
    /// With the border, `[C, H + 2 BORDER, W + 2 BORDER]`.
    padded: Image,
}

impl Level {
    fn of(image: &Image) -> Self {
        let (height, width) = (image.height() + 2 * BORDER, image.width() + 2 * BORDER);
        let padded = Image::from_rows(image.channels(), height, width, |c, y, row| {
            let source = image.row(c, y.saturating_sub(BORDER).min(image.height() - 1));
            let (left, rest) = row.split_at_mut(BORDER);
            let (middle, right) = rest.split_at_mut(source.len());
            left.fill(source[0]);
            middle.copy_from_slice(source);
            right.fill(source[source.len() - 1]);
        });
        Self { padded }
    }

    /// Rows of the picture, without the border.
    pub fn height(&self) -> usize {
        self.padded.height() - 2 * BORDER
    }

    /// Columns of the picture, without the border.
    pub fn width(&self) -> usize {
        self.padded.width() - 2 * BORDER
    }

    /// Planes.
    pub fn channels(&self) -> usize {
        self.padded.channels()
    }

    /// Whether another level has the same shape.
    pub fn is_like(&self, other: &Level) -> bool {
        self.channels() == other.channels() && self.padded.same_size(&other.padded)
    }

    /// The values of plane `c` from row `y` and column `x` on; both may lie in the border.
    #[inline(always)]
    pub fn from(&self, c: usize, y: isize, x: isize) -> &[f32] {
        let (y, x) = ((y + BORDER as isize) as usize, (x + BORDER as isize) as usize);
        &self.padded.row(c, y)[x..]
    }
}

/// The levels of a picture, from the finest on.
pub fn pyramid(image: Image) -> Vec<Level> {
    let mut levels = vec![Level::of(&image)];
    let mut image = image;
    while image.height().min(image.width()) >= 2 * SMALLEST {
        image = halved(&image);
        levels.push(Level::of(&image));
    }
    levels
}

/// Means of two by two pixels; the last row or column of an odd size stands for two.
fn halved(image: &Image) -> Image {
    let (height, width) = (image.height().div_ceil(2), image.width().div_ceil(2));
    Image::from_rows(image.channels(), height, width, |c, y, row| {
        let (upper, lower) = (image.row(c, 2 * y), image.row(c, (2 * y + 1).min(image.height() - 1)));
        for (x, out) in row.iter_mut().enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(image.width() - 1));
            *out = 0.25 * ((upper[left] + upper[right]) + (lower[left] + lower[right]));
        }
    })
}
