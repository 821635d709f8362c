//! Flicker: the error of the change from one frame to the next.

use crate::relative::{Measured, assert_same_shape, channel_mean, mean_of_finite, value};
use sspc_image::{Image, REL_L2_EPSILON, Reference};

/// A picture `[3, H, W]` of a frame, and that of the frame before, brought to its place along the motion of what is seen;
/// NaN where it has no place.
#[derive(Clone, Copy)]
pub struct Change<'a> {
    /// Of the frame.
    pub now: &'a Image,
    /// Of the frame before.
    pub before: &'a Image,
}

/// The temporal error: the mean over pixels and channels of ((Δx - Δr)² - n²) / (r̄² + 0.01), with Δx = x_t - W x_{t-1} of
/// the picture, Δr that of the reference and r̄ the channel mean of r_t. With reference halves, n = (Δr^a - Δr^b)/2 removes
/// the references' own noise. Pixels that are not finite in both frames are left out.
///
/// # Panics
/// When the images do not have one shape.
pub fn temporal_error(picture: Change, now: &Reference, before: &Reference) -> Measured {
    let halves = now.halves.as_ref().zip(before.halves.as_ref());
    let others = halves.iter().flat_map(|(now, before)| now.iter().chain(before.iter()));
    let all = [picture.before, &now.mean, &before.mean].into_iter().chain(others);
    all.for_each(|other| assert_same_shape(picture.now, other));
    let channels = picture.now.channels();
    let change = |now: &Image, before: &Image, c: usize, i: usize| value(now, c, i) - value(before, c, i);
    mean_of_finite(picture.now.pixels(), |i| {
        let mean = channel_mean(&now.mean, i);
        let of_channel = |c: usize| {
            let error = change(picture.now, picture.before, c, i) - change(&now.mean, &before.mean, c, i);
            let noise = halves.map_or(0.0, |([a, b], [a_before, b_before])| {
                0.5 * (change(a, a_before, c, i) - change(b, b_before, c, i))
            });
            error * error - noise * noise
        };
        (0..channels).map(of_channel).sum::<f64>() / channels as f64 / (mean * mean + REL_L2_EPSILON)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f32) -> Image {
        Image::filled(3, 2, 3, value)
    }

    fn reference(a: f32, b: f32) -> Reference {
        Reference { mean: flat(0.5 * (a + b)), halves: Some([flat(a), flat(b)]) }
    }

    #[test]
    fn a_constant_error_does_not_flicker_and_a_changing_one_does() {
        let (now, before) = (reference(1.0, 1.0), reference(2.0, 2.0));
        let of = |x: f32, y: f32| temporal_error(Change { now: &flat(x), before: &flat(y) }, &now, &before).value;
        assert_eq!(of(1.5, 2.5), 0.0);
        // (0.25 - 0)² / (1 + 0.01)
        assert!((of(1.25, 2.0) - 0.0625 / 1.01).abs() < 1e-9);
    }

    /// Halves 0.9 and 1.1 of a truth 1, and 2.2 and 1.8 of 2: n = ((0.9 - 2.2) - (1.1 - 1.8)) / 2 = -0.3.
    #[test]
    fn the_references_noise_is_taken_out() {
        let (now, before) = (reference(0.9, 1.1), reference(2.2, 1.8));
        let found = temporal_error(Change { now: &flat(1.0), before: &flat(2.0) }, &now, &before).value;
        assert!((found + 0.09 / 1.01).abs() < 1e-6, "{found}");
    }

    #[test]
    fn pixels_without_a_place_in_the_frame_before_are_left_out() {
        let (now, before) = (reference(1.0, 1.0), reference(1.0, 1.0));
        let mut warped = flat(1.5);
        warped.set(1, 0, 2, f32::NAN);
        let found = temporal_error(Change { now: &flat(1.0), before: &warped }, &now, &before);
        assert_eq!((found.pixels, found.excluded), (5, 1));
    }
}
