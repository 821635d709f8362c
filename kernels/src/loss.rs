//! The self-supervised loss (Eqs. 8, 9) as an upstream gradient of g_c, so that a tile needs one pass.

use crate::gc::Upstream;
use crate::region::Region;
use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};
use sspc_image::Image;

/// The loss of one tile against the other half.
pub struct SelfSupervised<'a> {
    /// y of the other half, `[3, H, W]`.
    pub target: &'a Image,
    /// Weight of a pixel's squared error, `[1, H, W]`.
    pub weight: &'a Image,
    /// Where the tile lies in them.
    pub region: Region,
    /// Factor of the loss.
    pub scale: f32,
    /// The weighted error norm m from which a pixel's gradient is limited.
    pub influence: f32,
    /// Weighted squared errors so far, without `scale`, of each vector of pixels: their sum does not depend on how the
    /// tile was divided.
    pub squares: Vec<f64>,
}

impl Upstream for SelfSupervised<'_> {
    const NEEDED: bool = true;

    #[inline(always)]
    fn gradient<S: Simd>(&mut self, s: S, y: usize, x: usize, lanes: usize, corrected: [S::F; 3]) -> [S::F; 3] {
        let at = (self.region.top + y) * self.target.width() + self.region.left + x;
        let weight = s.load_part(&self.weight.plane(0)[at..at + lanes]);
        let target = |k: usize| s.load_part(&self.target.plane(k)[at..at + lanes]);
        let error: [S::F; 3] = std::array::from_fn(|k| s.sub(corrected[k], target(k)));
        let squared = s.fma(error[2], error[2], s.fma(error[1], error[1], s.mul(error[0], error[0])));
        let relative = s.mul(weight, squared);
        let factor = self.factor(s, weight, relative, lanes);
        error.map(|e| s.mul(e, factor))
    }
}

/// What differences of a tile's μ̂ are compared with: those that the renderer estimated in the other half.
#[derive(Clone, Copy)]
pub struct Differences<'a> {
    /// dx, towards the pixel on the right, and dy, towards the one below, `[6, H, W]`.
    pub target: &'a Image,
    /// Weights of both differences' squared errors, `[2, H, W]`.
    pub weight: &'a Image,
}

impl SelfSupervised<'_> {
    /// The gradient by μ̂ of the loss of a whole tile, differences between its pixels included, `[3, h, w]`; the
    /// differences' weighted squared errors are added to `squares` too. `corrected` is μ̂, `[3, h, w]`.
    ///
    /// # Panics
    /// When a slice has another length.
    pub fn of_tile(&mut self, isa: Isa, differences: Differences, corrected: &[f32], upstream: &mut [f32]) {
        assert_eq!(corrected.len(), 3 * self.region.pixels(), "corrected radiance of the tile");
        assert_eq!(upstream.len(), corrected.len(), "gradient of the tile");
        dispatch(isa, OfTile { judge: self, differences, corrected, upstream });
    }

    /// Factor of the error of a gradient, from the weight and the weighted squared error; keeps the latter.
    #[inline(always)]
    fn factor<S: Simd>(&mut self, s: S, weight: S::F, relative: S::F, lanes: usize) -> S::F {
        let mut squares = [0.0; MAX_LANES];
        s.store(&mut squares, relative);
        self.squares.push(squares[..lanes].iter().map(|&v| f64::from(v)).sum::<f64>());
        let excess = s.mul(relative, s.splat(1.0 / (self.influence * self.influence)));
        s.div(s.mul(weight, s.splat(2.0 * self.scale)), s.sqrt(s.add(s.splat(1.0), excess)))
    }
}

struct OfTile<'a, 'b> {
    judge: &'a mut SelfSupervised<'b>,
    differences: Differences<'a>,
    corrected: &'a [f32],
    upstream: &'a mut [f32],
}

impl Kernel for OfTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { judge, differences: Differences { target, weight }, corrected, upstream } = self;
        let Region { top, left, height, width } = judge.region;
        let plane = height * width;
        for y in 0..height {
            for x in (0..width).step_by(S::LANES) {
                let (lanes, at) = (S::LANES.min(width - x), y * width + x);
                let mu: [S::F; 3] = std::array::from_fn(|k| s.load_part(&corrected[k * plane + at..][..lanes]));
                let gradient = judge.gradient(s, y, x, lanes, mu);
                (0..3).for_each(|k| s.store_part(&mut upstream[k * plane + at..][..lanes], gradient[k]));
            }
        }
        // To the right, then below: pixels of the tile that have this neighbour in it, and where it lies.
        let neighbours = [(height, width.saturating_sub(1), 1), (height.saturating_sub(1), width, width)];
        for (axis, (rows, columns, step)) in neighbours.into_iter().enumerate() {
            for y in 0..rows {
                for x in (0..columns).step_by(S::LANES) {
                    let (lanes, at) = (S::LANES.min(columns - x), y * width + x);
                    let place = (top + y) * target.width() + left + x;
                    let error: [S::F; 3] = std::array::from_fn(|k| {
                        let mu = |at: usize| s.load_part(&corrected[k * plane + at..][..lanes]);
                        let estimate = s.load_part(&target.plane(3 * axis + k)[place..][..lanes]);
                        s.sub(s.sub(mu(at + step), mu(at)), estimate)
                    });
                    let squared = s.fma(error[2], error[2], s.fma(error[1], error[1], s.mul(error[0], error[0])));
                    let weight = s.load_part(&weight.plane(axis)[place..][..lanes]);
                    let factor = judge.factor(s, weight, s.mul(weight, squared), lanes);
                    for (k, error) in error.into_iter().enumerate() {
                        let part = s.mul(error, factor);
                        let own = &mut upstream[k * plane + at..][..lanes];
                        s.store_part(own, s.sub(s.load_part(own), part));
                        let other = &mut upstream[k * plane + at + step..][..lanes];
                        s.store_part(other, s.add(s.load_part(other), part));
                    }
                }
            }
        }
    }
}
