//! Tiles and the windows that they are computed from.
//!
//! Every window of a picture has one size, because tract runs a graph of fixed size eight to ten
//! times as fast as one of free size: a tile and a halo of the network's radius on each side, or the
//! whole picture where it is smaller. A window that would leave the picture is moved inside. So each
//! edge of a window is either the picture's edge, where the network's zero padding is right, or lies
//! at least the halo away from the tile, where the padding does not reach.

use sspc_image::Image;
use sspc_kernels::region::Region;

/// How a picture is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    height: usize,
    width: usize,
    tile: usize,
    halo: usize,
}

/// Pixels that one window gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    pub top: usize,
    pub left: usize,
    pub height: usize,
    pub width: usize,
    /// Where the window begins in the picture.
    pub window_top: usize,
    pub window_left: usize,
    /// Size of the window.
    pub window_height: usize,
    pub window_width: usize,
}

impl TileGrid {
    /// Tiles of `tile` x `tile` pixels, at least 1, for a network of radius `halo`.
    pub fn new(height: usize, width: usize, tile: usize, halo: usize) -> Self {
        Self { height, width, tile: tile.max(1), halo }
    }

    pub fn window_height(&self) -> usize {
        self.height.min(self.tile + 2 * self.halo)
    }

    pub fn window_width(&self) -> usize {
        self.width.min(self.tile + 2 * self.halo)
    }

    /// All tiles, row by row; together they cover every pixel once.
    pub fn tiles(&self) -> Vec<Tile> {
        let rows = (0..self.height).step_by(self.tile);
        rows.flat_map(|top| (0..self.width).step_by(self.tile).map(move |left| self.tile_at(top, left))).collect()
    }

    fn tile_at(&self, top: usize, left: usize) -> Tile {
        let begin = |start: usize, size: usize, window: usize| start.saturating_sub(self.halo).min(size - window);
        Tile {
            top,
            left,
            height: self.tile.min(self.height - top),
            width: self.tile.min(self.width - left),
            window_top: begin(top, self.height, self.window_height()),
            window_left: begin(left, self.width, self.window_width()),
            window_height: self.window_height(),
            window_width: self.window_width(),
        }
    }
}

impl Tile {
    /// The tile's pixels.
    pub fn region(&self) -> Region {
        Region { top: self.top, left: self.left, height: self.height, width: self.width }
    }

    /// The tile's pixels in its window.
    pub fn in_window(&self) -> Region {
        Region { top: self.top - self.window_top, left: self.left - self.window_left, ..self.region() }
    }

    /// Copies the tile out of its window's planes into the picture's.
    pub fn place(&self, window: &[f32], picture: &mut Image) {
        let inner = self.in_window();
        let picture_width = picture.width();
        for (c, plane) in window.chunks_exact(self.window_height * self.window_width).enumerate() {
            let target = picture.plane_mut(c);
            for y in 0..self.height {
                let from = (inner.top + y) * self.window_width + inner.left;
                let to = (self.top + y) * picture_width + self.left;
                target[to..to + self.width].copy_from_slice(&plane[from..from + self.width]);
            }
        }
    }
}
