//! A picture put together from the denoised pictures of additive passes, mixed into the corrected one as far as the halves say.
//!
//! Denoised one by one, and without the colours that lobes are multiplied by, passes err otherwise than z does. With C^h their
//! composite of half h, the mix μ̂ + m (C - μ̂) takes most of the error away with m = Σ w r·d / Σ w d², d = C^h - μ̂^h and
//! r the other half's y less μ̂^h, summed over a neighbourhood and both halves.

use crate::blend_weight::Evidence;
use crate::prepare::{Prepared, Variant};
use sspc_image::Image;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
pub(crate) const MIX_RADIUS: usize = 7;

/// Mixes the composite into corrected halves and their picture, `[3, H, W]` each, in the method's units; returns m,
/// `[1, H, W]`.
pub(crate) fn mix(prepared: &Prepared, composite: &Variant, halves: &mut [Image; 2], picture: &mut Image) -> Image {
    let share = Evidence::beyond(prepared, halves, &composite.halves).share_within(MIX_RADIUS);
    let [a, b] = halves;
    for (image, other) in [(a, &composite.halves[0]), (b, &composite.halves[1]), (picture, &composite.denoised)] {
        image.for_each_row(|k, y, row| {
            for ((v, other), share) in row.iter_mut().zip(other.row(k, y)).zip(share.row(0, y)) {
                *v += share * (other - *v);
            }
        });
    }
    share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blend_weight::tests::{TRUTH, Z, without_noise};

    /// A correction that goes half the way to the truth, and composites that stand at the truth, a quarter beyond it, where the
    /// correction is, and further away than z.
    #[test]
    fn a_composite_counts_as_far_as_it_leads_to_the_truth() {
        let (height, width) = (5, 7);
        let prepared = without_noise(height, width);
        let at = |value: f32| Image::filled(3, height, width, value);
        let way = TRUTH - Z;
        for (stands, counts) in [(1.0, 1.0), (1.25, 0.5 / 0.75), (0.5, 0.0), (-1.0, 0.0)] {
            let composite =
                Variant { halves: [at(Z + stands * way), at(Z + stands * way)], denoised: at(Z + stands * way) };
            let (mut halves, mut picture) = ([at(Z + 0.5 * way), at(Z + 0.5 * way)], at(Z + 0.5 * way));
            let share = mix(&prepared, &composite, &mut halves, &mut picture);
            assert!(share.data().iter().all(|m| (m - counts).abs() < 1e-5), "{stands}: {:?}", share.data());
            let expected = Z + way * (0.5 + counts * (stands - 0.5));
            let made = halves.iter().chain([&picture]).flat_map(Image::data);
            assert!(made.into_iter().all(|v| (v - expected).abs() < 1e-5), "{stands}: not {expected}");
        }
    }

    /// Bands are read with so many rows around them ([`crate::compose::Composer::margin`]).
    #[test]
    fn a_row_has_a_say_over_two_box_means_and_no_further() {
        let (height, width) = (3 * MIX_RADIUS, 3);
        let prepared = without_noise(height, width);
        let share = |first_row: f32| {
            let stands = |y: usize| Z + (TRUTH - Z) * if y == 0 { first_row } else { 1.25 };
            let other = || Image::from_fn(3, height, width, |_, y, _| stands(y));
            let composite = Variant { halves: [other(), other()], denoised: other() };
            let half_way = || Image::filled(3, height, width, Z + 0.5 * (TRUTH - Z));
            mix(&prepared, &composite, &mut [half_way(), half_way()], &mut half_way())
        };
        let (one, other) = (share(1.25), share(1.5));
        let changed: Vec<usize> = (0..height).filter(|&y| one.row(0, y) != other.row(0, y)).collect();
        assert_eq!(changed, (0..=2 * MIX_RADIUS).collect::<Vec<_>>());
    }
}
