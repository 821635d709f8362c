//! A picture put together from the denoised pictures of additive passes, mixed into the corrected one as far as the halves say.
//!
//! Denoised one by one, and without the colours that lobes are multiplied by, passes err otherwise than z does. With C^h their
//! composite of half h, the mix μ̂ + m (C - μ̂) takes most of the error away with m = Σ w r·d / Σ w d², d = C^h - μ̂^h and
//! r the other half's y less μ̂^h, over the neighbourhood of the blend weight.

use crate::blend_weight::Evidence;
use crate::prepare::{Prepared, Variant};
use sspc_image::Image;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
pub(crate) const MIX_RADIUS: usize = 7;

/// Mixes the composite into corrected halves and their picture, `[3, H, W]` each, in the method's units.
pub(crate) fn mix(prepared: &Prepared, composite: &Variant, halves: &mut [Image; 2], picture: &mut Image) {
    let evidence = Evidence::between(prepared, |h, k, y| halves[h].row(k, y), |h, k, y| composite.halves[h].row(k, y));
    let share = evidence.share_within(MIX_RADIUS);
    let [a, b] = halves;
    for (image, other) in [(a, &composite.halves[0]), (b, &composite.halves[1]), (picture, &composite.denoised)] {
        image.for_each_row(|k, y, row| {
            for ((v, other), share) in row.iter_mut().zip(other.row(k, y)).zip(share.row(0, y)) {
                *v += share * (other - *v);
            }
        });
    }
}
