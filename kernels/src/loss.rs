//! The self-supervised loss (Eqs. 8, 9) as an upstream gradient of g_c, so that a tile needs one pass.

use crate::gc::Upstream;
use crate::region::Region;
use crate::simd::{MAX_LANES, Simd};
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
    /// Σ of weighted squared errors so far, without `scale`.
    pub sum: f64,
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
        let mut squares = [0.0; MAX_LANES];
        s.store(&mut squares, relative);
        self.sum += squares[..lanes].iter().map(|&v| f64::from(v)).sum::<f64>();
        let excess = s.mul(relative, s.splat(1.0 / (self.influence * self.influence)));
        let factor = s.div(s.mul(weight, s.splat(2.0 * self.scale)), s.sqrt(s.add(s.splat(1.0), excess)));
        error.map(|e| s.mul(e, factor))
    }
}
