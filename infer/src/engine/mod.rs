//! The network over pictures of any size: one plan of one fixed window, tiles over all threads.
//!
//! | module | job |
//! |---|---|
//! | [`tiles`] | which window gives which tile |
//! | [`plan`] | a tract plan of the network graph at the window's size |
//! | [`fused`] | our kernels as tract's operator for the whole network |

mod fused;
mod plan;
pub mod tiles;

pub use plan::{Kernels, PlanError};

use plan::Plan;
use rayon::prelude::*;
use sspc_core::plan::Plan as PicturePlan;
use sspc_image::Image;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_onnx::Model;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;
use tiles::TileGrid;

/// Side of the tiles when nobody asks for another, pixels: large enough that the halo costs little,
/// small enough that a window's planes stay in a core's cache.
pub const DEFAULT_TILE: usize = 128;

/// A model ready to run.
pub struct Engine {
    model: Model,
    kernels: Kernels,
    tile: usize,
    /// Plans by window size (height, width); a picture needs one.
    plans: Mutex<HashMap<(usize, usize), Arc<Plan>>>,
    first_tile: OnceLock<Instant>,
}

impl Engine {
    /// An engine that works in tiles of `tile` x `tile` pixels, at least 1.
    pub fn new(model: Model, kernels: Kernels, tile: usize) -> Self {
        Self { model, kernels, tile: tile.max(1), plans: Mutex::default(), first_tile: OnceLock::new() }
    }

    pub fn model(&self) -> &Model {
        &self.model
    }

    /// When the first tile of all was done.
    pub fn first_tile(&self) -> Option<Instant> {
        self.first_tile.get().copied()
    }

    /// The tiles of a picture.
    pub fn grid(&self, height: usize, width: usize) -> TileGrid {
        TileGrid::new(height, width, self.tile, self.model.contract.shape.radius())
    }

    /// Activated parameters `[P, H, W]` of features `[13, H, W]`, zero in tiles that the plan skips.
    /// The tiling does not show: every other value is what one window over the whole picture would
    /// give.
    ///
    /// # Errors
    /// [`PlanError`] when tract does not take the graph or fails to run it.
    ///
    /// # Panics
    /// When the features have other channels.
    pub fn parameters(&self, features: &Image, picture: &PicturePlan) -> Result<Image, PlanError> {
        assert_eq!(features.channels(), FEATURE_CHANNELS, "feature channels");
        let (height, width) = (features.height(), features.width());
        let outputs = self.model.contract.form.parameters();
        let grid = self.grid(height, width);
        let plan = self.plan(grid.window_height(), grid.window_width())?;
        // One tile is put in place while the others are computed.
        let parameters = Mutex::new(Image::zeros(outputs, height, width));
        let tiles = grid.tiles().into_par_iter().filter(|tile| picture.touches(&tile.region()));
        tiles.try_for_each(|tile| {
            let (window_height, window_width) = (grid.window_height(), grid.window_width());
            let window = features.crop(tile.window_top, tile.window_left, window_height, window_width);
            let place = |values: &[f32]| tile.place(values, &mut lock(&parameters));
            plan.run(window, tile.in_window(), place).inspect(|()| {
                self.first_tile.get_or_init(Instant::now);
            })
        })?;
        Ok(parameters.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()))
    }

    fn plan(&self, height: usize, width: usize) -> Result<Arc<Plan>, PlanError> {
        let mut plans = lock(&self.plans);
        if let Some(plan) = plans.get(&(height, width)) {
            return Ok(Arc::clone(plan));
        }
        let plan = Arc::new(Plan::new(&self.model, self.kernels, height, width)?);
        plans.insert((height, width), Arc::clone(&plan));
        Ok(plan)
    }
}

/// What is behind a lock, also after a panic elsewhere, which rayon passes on by itself.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}
