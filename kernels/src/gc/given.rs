//! The plain form of a backward pass: the upstream gradient is there before g_c is computed.
//!
//! Training fuses the loss into the pass ([`crate::loss`]); this is how kernels are judged against
//! [`oracle`](super::oracle), and timed.

use super::Upstream;
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
    fn gradient<S: Simd>(&mut self, s: S, y: usize, x: usize, lanes: usize, _: [S::F; 3]) -> [S::F; 3] {
        let at = y * self.region.width + x;
        let part = |k: usize| s.load_part(&self.upstream[k * self.region.pixels() + at..][..lanes]);
        [part(0), part(1), part(2)]
    }
}
