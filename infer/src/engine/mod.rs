//! The exported network in tract: one plan for each size of window, from any number of threads.
//!
//! | module | job |
//! |---|---|
//! | `plan` | a tract plan of the network graph at the window's size |
//! | `fused` | our kernels as tract's operator for the whole network |

mod fused;
mod plan;

pub use plan::{Kernels, PlanError};

use plan::WindowPlan;
use sspc_core::tiles::ParameterSource;
use sspc_image::Image;
use sspc_kernels::network::Shape;
use sspc_kernels::region::Region;
use sspc_onnx::Model;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

/// A model ready to run.
pub struct Engine {
    model: Model,
    kernels: Kernels,
    tile: usize,
    /// Plans by network and window size (height, width); a picture needs one for each network.
    plans: Mutex<HashMap<(usize, usize, usize), Arc<WindowPlan>>>,
    first_tile: OnceLock<Instant>,
}

impl Engine {
    /// An engine that works in tiles of `tile` x `tile` pixels, at least 1.
    pub fn new(model: Model, kernels: Kernels, tile: usize) -> Self {
        Self { model, kernels, tile: tile.max(1), plans: Mutex::default(), first_tile: OnceLock::new() }
    }

    /// The model that it runs.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// When the first tile of all was done.
    pub fn first_tile(&self) -> Option<Instant> {
        self.first_tile.get().copied()
    }

    fn plan(&self, k: usize, height: usize, width: usize) -> Result<Arc<WindowPlan>, PlanError> {
        let mut plans = lock(&self.plans);
        if let Some(plan) = plans.get(&(k, height, width)) {
            return Ok(Arc::clone(plan));
        }
        let plan = Arc::new(WindowPlan::new(&self.model.of_network(k), self.kernels, height, width)?);
        plans.insert((k, height, width), Arc::clone(&plan));
        Ok(plan)
    }
}

impl ParameterSource for Engine {
    type Error = PlanError;

    fn shape(&self) -> Shape {
        self.model.contract.shape
    }

    fn networks(&self) -> usize {
        self.model.contract.networks
    }

    fn tile(&self) -> usize {
        self.tile
    }

    fn window(&self, k: usize, features: Image, wanted: Region) -> Result<Image, PlanError> {
        let parameters = self.plan(k, features.height(), features.width())?.run(features, wanted)?;
        self.first_tile.get_or_init(Instant::now);
        Ok(parameters)
    }
}

/// What is behind a lock, also after a panic elsewhere, which rayon passes on by itself.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}
