//! The self-supervised loss (Eqs. 8, 9) as an upstream gradient of g_c, so that a tile needs one pass.

use crate::gc::{Upstream, load_lanes};
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
    unsafe fn gradient<S: Simd>(&mut self, y: usize, x: usize, lanes: usize, corrected: [S::F; 3]) -> [S::F; 3] {
        let at = (self.region.top + y) * self.target.width() + self.region.left + x;
        // SAFETY: `at .. at + lanes` lies in every plane of the picture; `squares` has MAX_LANES.
        unsafe {
            let weight = load_lanes::<S>(self.weight.plane(0), at, lanes);
            let error: [S::F; 3] =
                std::array::from_fn(|k| S::sub(corrected[k], load_lanes::<S>(self.target.plane(k), at, lanes)));
            let squared = S::fma(error[2], error[2], S::fma(error[1], error[1], S::mul(error[0], error[0])));
            let relative = S::mul(weight, squared);
            let mut squares = [0.0; MAX_LANES];
            S::store(squares.as_mut_ptr(), relative);
            self.sum += squares[..lanes].iter().map(|&v| f64::from(v)).sum::<f64>();
            let one = S::splat(1.0);
            let excess = S::mul(relative, S::splat(1.0 / (self.influence * self.influence)));
            let factor = S::div(S::mul(weight, S::splat(2.0 * self.scale)), S::sqrt(S::add(one, excess)));
            error.map(|e| S::mul(e, factor))
        }
    }
}
