//! Which tiles each step trains on.

use crate::importance::importance;
use crate::preset::{Sampling, Settings};
use sspc_core::objective::{Mirror, Tile};
use sspc_core::plan::Plan;
use sspc_core::prepare::Prepared;
use sspc_core::rng::Rng;
use sspc_kernels::region::Region;

/// A pixel of either half is visited at most this often, on average: beyond, training learns the noise.
/// (relL2 over the denoiser's. The sample frame at 22, 40, 70, 105 and 190 visits: 0.59, 0.57, 0.56, 0.58, 0.60.
/// Seven frames in 600, 1000 and 2000 steps, 24, 40 and 80 visits at 640 x 360: 0.593, 0.556, 0.565.)
const MOST_VISITS: f64 = 60.0;
/// The same where some blocks are drawn three times as often as the mean. (The sample frame and four quarters of the shot,
/// at 27, 40 and their 300 steps, 60 and 115 visits: 0.59, 0.60, 0.67.)
const MOST_VISITS_BY_IMPORTANCE: f64 = 25.0;

/// Batches of tiles of one picture, in the order they are trained on.
pub struct Schedule {
    steps: usize,
    batch: usize,
    height: usize,
    width: usize,
    tile: (usize, usize),
    /// Whether tiles are also mirrored at their diagonal.
    diagonal: bool,
    grid: Option<Grid>,
    /// Blocks that random tiles lie over.
    blocks: Vec<Region>,
    /// How likely a block is, added up to it.
    cumulative: Vec<f64>,
    rng: Rng,
}

/// Places of an epoch that are still to come.
struct Grid {
    places: Vec<Region>,
    left: Vec<Region>,
}

impl Schedule {
    /// The schedule of `settings` for a frame; `steps` overrides the settings' own number, which is
    /// that of a frame without skipped blocks.
    pub fn new(settings: &Settings, plan: &Plan, height: usize, width: usize, steps: Option<usize>) -> Self {
        let tile = (settings.tile.min(height), settings.tile.min(width));
        let grid = match settings.sampling {
            Sampling::Uniform | Sampling::Important => None,
            Sampling::Grid { stride } => {
                let (tops, lefts) = (positions(height, tile.0, stride), positions(width, tile.1, stride));
                let places = tops
                    .iter()
                    .flat_map(|&top| lefts.iter().map(move |&left| Region { top, left, height: tile.0, width: tile.1 }))
                    .filter(|place| plan.touches(place))
                    .collect();
                Some(Grid { places, left: Vec::new() })
            }
        };
        let of_epochs = |g: &Grid| settings.epochs * g.places.len().div_ceil(settings.batch);
        let pixels = (height * width) as f64;
        let active = plan.active_share * pixels;
        let visits_a_step = (settings.batch * tile.0 * tile.1) as f64 / (2.0 * active.max(1.0));
        let most = if settings.sampling == Sampling::Important { MOST_VISITS_BY_IMPORTANCE } else { MOST_VISITS };
        let enough = (most / visits_a_step).ceil();
        let growth = settings.steps_grow_from.map_or(1.0, |from| (pixels / from as f64).sqrt().max(1.0));
        let scaled = (settings.steps as f64 * growth * plan.active_share).ceil().min(enough) as usize;
        let own = grid.as_ref().map_or(scaled, of_epochs);
        let blocks = plan.active_blocks();
        let idle = blocks.is_empty();
        Self {
            steps: if idle { 0 } else { steps.unwrap_or(own) },
            batch: settings.batch,
            height,
            width,
            tile,
            diagonal: settings.diagonal && tile.0 == tile.1,
            grid,
            cumulative: (1..=blocks.len()).map(|n| n as f64).collect(),
            blocks,
            rng: Rng::new(settings.seed ^ 0x7469_6C65),
        }
    }

    /// The same for frame `frame` of a shot, from 0: every frame draws its own tiles, the first as if it were alone.
    pub fn of_frame(mut self, frame: usize) -> Self {
        self.rng = self.rng.stream(frame as u64);
        self
    }

    /// The same, with random tiles over blocks in proportion to their importance to `prepared` (`importance.rs`)
    /// where the settings say so.
    pub fn by_importance(mut self, settings: &Settings, prepared: &Prepared) -> Self {
        if settings.sampling == Sampling::Important {
            let mut sum = 0.0;
            let add = |value| {
                sum += value;
                sum
            };
            self.cumulative = importance(prepared, &self.blocks).into_iter().map(add).collect();
        }
        self
    }

    /// Steps of the whole training.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The tiles of the next step.
    pub fn next_batch(&mut self) -> Vec<Tile> {
        let (rng, tile, diagonal) = (&mut self.rng, self.tile, self.diagonal);
        match &mut self.grid {
            None => (0..self.batch)
                .map(|i| {
                    // A random pixel of a random active block, anywhere in the tile.
                    let block = self.blocks[rng.index(&self.cumulative)];
                    let y = block.top + rng.below(block.height);
                    let x = block.left + rng.below(block.width);
                    let top = y.saturating_sub(rng.below(tile.0)).min(self.height - tile.0);
                    let left = x.saturating_sub(rng.below(tile.1)).min(self.width - tile.1);
                    let region = Region { top, left, height: tile.0, width: tile.1 };
                    let mut toss = || rng.below(2) == 1;
                    let mirror = Mirror { rows: toss(), columns: toss(), diagonal: diagonal && toss() };
                    Tile { half: i % 2, region, mirror }
                })
                .collect(),
            Some(grid) => {
                if grid.left.is_empty() {
                    grid.left.clone_from(&grid.places);
                    rng.shuffle(&mut grid.left);
                }
                let from = grid.left.len().saturating_sub(self.batch);
                let places = grid.left.split_off(from);
                places.into_iter().flat_map(|region| (0..2).map(move |half| Tile::upright(half, region))).collect()
            }
        }
    }
}

/// Starts of tiles that cover 0..size: every `stride`, and one that ends at the border.
fn positions(size: usize, tile: usize, stride: usize) -> Vec<usize> {
    let mut starts: Vec<usize> = (0..=size - tile).step_by(stride).collect();
    if starts.last() != Some(&(size - tile)) {
        starts.push(size - tile);
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;

    #[test]
    fn an_epoch_of_the_paper_visits_every_patch_of_both_halves_once() {
        let settings = Settings::of(Preset::Paper, 1);
        let mut schedule = Schedule::new(&settings, &Plan::everything(360, 640), 360, 640, None);
        assert_eq!(schedule.steps(), 60);
        let mut seen = std::collections::HashMap::new();
        // 45 places in batches of 16.
        for _ in 0..3 {
            for tile in schedule.next_batch() {
                *seen.entry((tile.half, tile.region.top, tile.region.left)).or_insert(0) += 1;
            }
        }
        assert_eq!(seen.len(), 2 * 5 * 9);
        assert!(seen.values().all(|n| *n == 1));
    }

    #[test]
    fn small_and_half_empty_pictures_take_fewer_steps_and_large_ones_more_where_they_may() {
        let settings = Settings::of(Preset::Quality, 1);
        let steps = |plan: &Plan, height, width| Schedule::new(&settings, plan, height, width, None).steps();
        assert_eq!(steps(&Plan::everything(360, 640), 360, 640), settings.steps);
        assert_eq!(steps(&Plan::everything(720, 1280), 720, 1280), 2 * settings.steps);
        assert_eq!(steps(&Plan::everything(192, 256), 192, 256), 320);
        let mut half_empty = Plan::everything(720, 1280);
        half_empty.active_share = 0.5;
        assert_eq!(steps(&half_empty, 720, 1280), settings.steps);
        let balanced = Settings::of(Preset::Balanced, 1);
        let of_large = Schedule::new(&balanced, &Plan::everything(2160, 3840), 2160, 3840, None).steps();
        assert_eq!(of_large, balanced.steps);
        let of_small = Schedule::new(&balanced, &Plan::everything(192, 256), 192, 256, None).steps();
        assert_eq!(of_small, 134);
    }

    #[test]
    fn tiles_stay_inside_pictures_smaller_than_a_tile() {
        for preset in [Preset::Paper, Preset::Balanced, Preset::Quality] {
            let mut schedule = Schedule::new(&Settings::of(preset, 1), &Plan::everything(1, 7), 1, 7, None);
            let tiles = schedule.next_batch();
            assert!(tiles.iter().all(|t| t.region.height == 1 && t.region.width == 7 && !t.mirror.diagonal));
        }
    }

    /// Fails when frames of a shot share their random numbers, or the first frame's depend on being in a shot.
    #[test]
    fn every_frame_of_a_shot_draws_its_own_tiles() {
        for preset in [Preset::Paper, Preset::Balanced, Preset::Quality] {
            let of_frame = |schedule: fn(Schedule) -> Schedule| {
                let own = Schedule::new(&Settings::of(preset, 1), &Plan::everything(360, 640), 360, 640, None);
                let mut own = schedule(own);
                (0..3).map(|_| own.next_batch()).collect::<Vec<_>>()
            };
            let alone = of_frame(|own| own);
            assert_eq!(alone, of_frame(|own| own.of_frame(0)), "{preset}: the first frame");
            let (second, third) = (of_frame(|own| own.of_frame(1)), of_frame(|own| own.of_frame(2)));
            assert!(alone != second && alone != third && second != third, "{preset}: frames share their tiles");
        }
    }

    #[test]
    fn every_mirror_image_of_a_preset_comes_up() {
        for (preset, images) in [(Preset::Paper, 1), (Preset::Balanced, 4), (Preset::Quality, 8)] {
            let mut schedule = Schedule::new(&Settings::of(preset, 1), &Plan::everything(360, 640), 360, 640, None);
            let tiles = (0..20).flat_map(|_| schedule.next_batch());
            let seen: std::collections::HashSet<_> = tiles.map(|t| format!("{:?}", t.mirror)).collect();
            assert_eq!(seen.len(), images, "{preset}: {seen:?}");
        }
    }
}
