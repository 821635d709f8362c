//! The plain form of a backward pass: the upstream gradient is there before g_c is computed.
//!
//! Training fuses the loss into the pass ([`crate::loss`]); this is how kernels are judged against
//! [`oracle`](super::oracle), and timed.

use super::{Upstream, load_lanes};
use crate::region::Region;
use crate::simd::Simd;

/// The gradient of a loss by μ̂, known beforehand.
pub struct Given<'a> {
    upstream: &'a [f32],
    region: Region,
}

impl<'a> Given<'a> {
    /// `upstream` `[3, region.height, region.width]`.
    ///
    /// # Panics
    /// When it has another length.
    pub fn new(upstream: &'a [f32], region: Region) -> Self {
        assert_eq!(upstream.len(), 3 * region.pixels(), "upstream gradient of the region");
        Self { upstream, region }
    }
}

impl Upstream for Given<'_> {
    const NEEDED: bool = true;

    #[inline(always)]
    unsafe fn gradient<S: Simd>(&mut self, y: usize, x: usize, lanes: usize, _: [S::F; 3]) -> [S::F; 3] {
        let at = y * self.region.width + x;
        // SAFETY: the kernel asks for pixels of its region only, of which `upstream` has three planes.
        std::array::from_fn(|k| unsafe { load_lanes::<S>(self.upstream, k * self.region.pixels() + at, lanes) })
    }
}
