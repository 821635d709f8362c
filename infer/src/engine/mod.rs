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
use sspc_core::features::FEATURE_CHANNELS;
use sspc_core::image::Image;
use sspc_core::plan::Plan as PicturePlan;
use sspc_onnx::Model;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use tiles::{Tile, TileGrid};

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
}

impl Engine {
    /// An engine that works in tiles of `tile` x `tile` pixels, at least 1.
    pub fn new(model: Model, kernels: Kernels, tile: usize) -> Self {
        Self { model, kernels, tile: tile.max(1), plans: Mutex::default() }
    }

    pub fn model(&self) -> &Model {
        &self.model
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
        let tiles: Vec<(Tile, Vec<f32>)> = grid
            .tiles()
            .into_par_iter()
            .filter(|tile| picture.touches(&tile.region()))
            .map(|tile| {
                let window =
                    features.crop(tile.window_top, tile.window_left, grid.window_height(), grid.window_width());
                Ok((tile, tile.of_window(&plan.run(window, tile.in_window())?)))
            })
            .collect::<Result<_, PlanError>>()?;
        let mut parameters = Image::zeros(outputs, height, width);
        for (tile, values) in tiles {
            tile.place(&values, &mut parameters);
        }
        Ok(parameters)
    }

    fn plan(&self, height: usize, width: usize) -> Result<Arc<Plan>, PlanError> {
        let mut plans = self.plans.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(plan) = plans.get(&(height, width)) {
            return Ok(Arc::clone(plan));
        }
        let plan = Arc::new(Plan::new(&self.model, self.kernels, height, width)?);
        plans.insert((height, width), Arc::clone(&plan));
        Ok(plan)
    }
}
