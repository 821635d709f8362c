//! Tiles and the windows that they are computed from.
//!
//! Every window of a picture has one size, because tract runs a graph of fixed size eight to ten
//! times as fast as one of free size: a tile and a halo of the network's radius on each side, or the
//! whole picture where it is smaller. A window that would leave the picture is moved inside. So each
//! edge of a window is either the picture's edge, where the network's zero padding is right, or lies
//! at least the halo away from the tile, where the padding does not reach.

use sspc_core::gc::Region;
use sspc_core::image::Image;

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

    /// The tile's planes out of its window's planes.
    pub fn of_window(&self, window: &[f32]) -> Vec<f32> {
        let rows = self.top - self.window_top..self.top - self.window_top + self.height;
        let first = self.left - self.window_left;
        let mut values = Vec::with_capacity(window.len());
        for plane in window.chunks_exact(self.window_height * self.window_width) {
            for row in rows.clone() {
                let start = row * self.window_width + first;
                values.extend_from_slice(&plane[start..start + self.width]);
            }
        }
        values
    }

    /// Puts the tile's planes into the picture.
    pub fn place(&self, values: &[f32], picture: &mut Image) {
        let picture_width = picture.width();
        for (c, plane) in values.chunks_exact(self.height * self.width).enumerate() {
            let target = picture.plane_mut(c);
            for (y, row) in plane.chunks_exact(self.width).enumerate() {
                let start = (self.top + y) * picture_width + self.left;
                target[start..start + self.width].copy_from_slice(row);
            }
        }
    }
}
