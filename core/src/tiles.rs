//! From features to the parameters of g_c: the network over a picture, tile by tile on all threads.
//!
//! Every window of a picture has one size, because an engine runs a graph of fixed size eight to ten times as fast as
//! one of free size: a tile and a halo of the network's radius on each side, or the whole picture where it is smaller.
//! A window that would leave the picture is moved inside. So each edge of a window is either the picture's edge, where
//! the network's zero padding is right, or lies at least the halo away from the tile, where the padding does not reach:
//! the tiling does not show.

use crate::plan::Plan;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::{Shape, WindowNetwork};
use sspc_kernels::region::Region;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::Mutex;

/// Side of a tile when nobody asks for another, pixels: large enough that the halo costs little, small enough that a
/// window's planes stay in a core's cache.
pub const DEFAULT_TILE: usize = 128;

/// Something that runs the networks over windows: our kernels, or an inference engine.
pub trait ParameterSource: Sync {
    /// Why a window could not be computed.
    type Error: Send;

    /// Layers and channels of every network.
    fn shape(&self) -> Shape;

    /// How many networks there are, one for each variant of z.
    fn networks(&self) -> usize;

    /// Side of the tiles that it likes best, pixels.
    fn tile(&self) -> usize {
        DEFAULT_TILE
    }

    /// Activated parameters `[P, wanted.height, wanted.width]`, by network `k`, of the pixels `wanted` of a window of
    /// features `[13, h, w]`, around which there are zeros.
    ///
    /// # Errors
    /// What the engine fails with.
    fn window(&self, k: usize, features: Image, wanted: Region) -> Result<Image, Self::Error>;
}

/// A network by itself.
impl ParameterSource for WindowNetwork {
    type Error = Infallible;

    fn shape(&self) -> Shape {
        WindowNetwork::shape(self)
    }

    fn networks(&self) -> usize {
        1
    }

    fn window(&self, _: usize, features: Image, wanted: Region) -> Result<Image, Infallible> {
        let mut out = Image::zeros(WindowNetwork::shape(self).outputs, wanted.height, wanted.width);
        self.run_inner(features.data(), features.height(), features.width(), wanted, out.data_mut());
        Ok(out)
    }
}

/// Networks of one shape, at least one.
impl ParameterSource for [WindowNetwork] {
    type Error = Infallible;

    fn shape(&self) -> Shape {
        self[0].shape()
    }

    fn networks(&self) -> usize {
        self.len()
    }

    fn window(&self, k: usize, features: Image, wanted: Region) -> Result<Image, Infallible> {
        self[k].window(0, features, wanted)
    }
}

/// Activated parameters `[P, rows, W]`, by network `k`, of some rows of a picture's features `[13, H, W]`, zero in tiles
/// that the plan of the picture skips.
///
/// # Errors
/// The first that the source fails with.
///
/// # Panics
/// When the features have other channels.
pub fn parameters<S: ParameterSource + ?Sized>(
    source: &S,
    k: usize,
    features: &Image,
    plan: &Plan,
    rows: Range<usize>,
) -> Result<Image, S::Error> {
    assert_eq!(features.channels(), FEATURE_CHANNELS, "feature channels");
    let shape = source.shape();
    let grid = TileGrid::new(features.height(), features.width(), source.tile(), shape.radius());
    // One tile is put in place while the others are computed.
    let parameters = Mutex::new(Image::zeros(shape.outputs, rows.len(), features.width()));
    let tiles = grid.tiles_of_rows(rows.clone()).into_par_iter().filter(|tile| plan.touches(&tile.region));
    tiles.try_for_each(|tile| {
        let computed = tile.parameters(source, k, features)?;
        let mut parameters = parameters.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        parameters.put(tile.region.top - rows.start, tile.region.left, &computed);
        Ok(())
    })?;
    Ok(parameters.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// How a picture is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    height: usize,
    width: usize,
    tile: usize,
    halo: usize,
}

/// Pixels that one window gives, and the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureTile {
    /// The pixels, in the picture.
    pub region: Region,
    /// The window, in the picture.
    pub window: Region,
}

impl TileGrid {
    /// Tiles of `tile` x `tile` pixels, at least 1, for a network of radius `halo`.
    pub fn new(height: usize, width: usize, tile: usize, halo: usize) -> Self {
        Self { height, width, tile: tile.max(1), halo }
    }

    /// Rows of every window.
    pub fn window_height(&self) -> usize {
        self.height.min(self.tile + 2 * self.halo)
    }

    /// Columns of every window.
    pub fn window_width(&self) -> usize {
        self.width.min(self.tile + 2 * self.halo)
    }

    /// Tiles that cover every pixel of the rows once, row by row.
    pub fn tiles_of_rows(&self, rows: Range<usize>) -> Vec<PictureTile> {
        let tops = rows.clone().step_by(self.tile);
        let lefts = || (0..self.width).step_by(self.tile);
        tops.flat_map(|top| lefts().map(move |left| (top, left)))
            .map(|(top, left)| {
                let height = self.tile.min(rows.end - top);
                self.tile_at(Region { top, left, height, width: self.tile.min(self.width - left) })
            })
            .collect()
    }

    fn tile_at(&self, region: Region) -> PictureTile {
        let begin = |start: usize, size: usize, window: usize| start.saturating_sub(self.halo).min(size - window);
        let window = Region {
            top: begin(region.top, self.height, self.window_height()),
            left: begin(region.left, self.width, self.window_width()),
            height: self.window_height(),
            width: self.window_width(),
        };
        PictureTile { region, window }
    }
}

impl PictureTile {
    /// The tile's pixels in its window.
    pub fn in_window(&self) -> Region {
        let (top, left) = (self.region.top - self.window.top, self.region.left - self.window.left);
        Region { top, left, ..self.region }
    }

    /// Activated parameters of its pixels `[P, rows, columns]`, by network `k`, of a picture's features `[13, H, W]`.
    ///
    /// # Errors
    /// What the source fails with.
    pub fn parameters<S: ParameterSource + ?Sized>(
        &self,
        source: &S,
        k: usize,
        features: &Image,
    ) -> Result<Image, S::Error> {
        let Region { top, left, height, width } = self.window;
        source.window(k, features.crop(top, left, height, width), self.in_window())
    }
}
