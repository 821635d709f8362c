//! Errors relative to the reference's own brightness, on radiance.

use sspc_image::{Image, REL_L2_EPSILON, Reference};

/// Below this sum of magnitudes SMAPE counts two values as equal.
const SMAPE_TINY: f64 = 1e-12;

/// A mean over pixels, its standard error, and how many pixels were left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The mean; NaN without valid pixels.
    pub value: f64,
    /// Standard error of the mean, taking pixels as independent; NaN below two pixels.
    pub standard_error: f64,
    /// Pixels averaged.
    pub pixels: u64,
    /// Pixels left out because a value of the picture or the reference is NaN or infinite.
    pub excluded: u64,
}

/// relL2 = mean over pixels and channels of ((x − r)² − n²) / (r̄² + 0.01), r̄ the channel mean of the
/// reference (Rousselle et al. 2011). With reference halves r^a, r^b, n = (r^a − r^b)/2 removes the reference's own
/// noise: the expected relL2 of a perfect picture is 0, and a measured one may be negative. Otherwise n = 0.
///
/// # Panics
/// When the images do not have one shape.
pub fn rel_l2(image: &Image, reference: &Reference) -> Measured {
    measure(image, reference, |x, r, noise, mean| ((x - r) * (x - r) - noise * noise) / (mean * mean + REL_L2_EPSILON))
}

/// The gain in relL2 of `image` (x) over `other` (z), unbiased by noise of the reference: the mean of
/// ½ Σ ((z − r^a)² − (x − r^a)²) / (r̄^b² + 0.01) over both orders of the reference's halves; None without halves.
///
/// [`rel_l2`] has the reference's noise in both numerator and denominator. A pixel whose reference is dark by chance
/// counts more and favours a dark picture, the more so the noisier the reference. Here r^a is independent of the
/// denominator, and its square cancels in the difference of two pictures: the expectation is that of
/// ((z − μ)² − (x − μ)²) / (r̄^b² + 0.01).
///
/// # Panics
/// When the images do not have one shape.
pub fn rel_l2_gain(image: &Image, other: &Image, reference: &Reference) -> Option<Measured> {
    let [a, b] = reference.halves.as_ref()?;
    [other, a, b].into_iter().for_each(|one| assert_same_shape(image, one));
    let channels = image.channels();
    let gain = |i: usize, half: &Image, crossed: &Image| {
        let product = |c: usize| {
            let (x, z, r) = (value(image, c, i), value(other, c, i), value(half, c, i));
            // (z − r)² − (x − r)²
            (z - x) * (z + x - 2.0 * r)
        };
        let mean = channel_mean(crossed, i);
        (0..channels).map(product).sum::<f64>() / channels as f64 / (mean * mean + REL_L2_EPSILON)
    };
    Some(mean_of_finite(image.pixels(), |i| 0.5 * (gain(i, a, b) + gain(i, b, a))))
}

/// Symmetric mean absolute percentage error as a fraction: mean of |x − r| / ((|x| + |r|)/2), 0 where both are 0;
/// 0..2.
///
/// # Panics
/// When the images do not have one shape.
pub fn smape(image: &Image, reference: &Reference) -> Measured {
    measure(image, reference, |x, r, _, _| {
        let sum = x.abs() + r.abs();
        if sum < SMAPE_TINY { 0.0 } else { 2.0 * (x - r).abs() / sum }
    })
}

/// Mean radiance of the picture over that of the reference, Σx / Σr over the pixels finite in both and all channels: 1 if
/// no energy is lost or added; NaN if the reference is black.
///
/// # Panics
/// When the images do not have one shape.
pub fn brightness(image: &Image, reference: &Image) -> f64 {
    assert_same_shape(image, reference);
    let (mut own, mut truth) = (0.0, 0.0);
    for i in 0..image.pixels() {
        let of_pixel = |image: &Image| channel_mean(image, i);
        let (x, r) = (of_pixel(image), of_pixel(reference));
        if x.is_finite() && r.is_finite() {
            own += x;
            truth += r;
        }
    }
    if truth > 0.0 { own / truth } else { f64::NAN }
}

/// (x − r)² / (r̄² + 0.01) averaged over the channels of each pixel, `[1, H, W]`; NaN where a value is missing. The
/// reference's noise is left in: of one pixel it cannot be told.
///
/// # Panics
/// When the images do not have one shape.
pub fn rel_l2_map(image: &Image, reference: &Image) -> Image {
    assert_same_shape(image, reference);
    let channels = image.channels();
    let mut map = Image::zeros(1, image.height(), image.width());
    for i in 0..image.pixels() {
        let mean = channel_mean(reference, i);
        let squares: f64 = (0..channels).map(|c| (value(image, c, i) - value(reference, c, i)).powi(2)).sum();
        let error = squares / channels as f64 / (mean * mean + REL_L2_EPSILON);
        map.data_mut()[i] = if error.is_finite() { error as f32 } else { f32::NAN };
    }
    map
}

/// Mean of `error(x, r, n, r̄)`.
fn measure(image: &Image, reference: &Reference, error: impl Fn(f64, f64, f64, f64) -> f64) -> Measured {
    assert_same_shape(image, &reference.mean);
    if let Some(halves) = &reference.halves {
        halves.iter().for_each(|half| assert_same_shape(image, half));
    }
    let channels = image.channels();
    mean_of_finite(image.pixels(), |i| {
        let mean = channel_mean(&reference.mean, i);
        let of_channel = |c: usize| {
            let noise = reference.halves.as_ref().map_or(0.0, |[a, b]| 0.5 * (value(a, c, i) - value(b, c, i)));
            error(value(image, c, i), value(&reference.mean, c, i), noise, mean)
        };
        let finite = (0..channels).all(|c| image.plane(c)[i].is_finite());
        if finite { (0..channels).map(of_channel).sum::<f64>() / channels as f64 } else { f64::NAN }
    })
}

/// Mean over those pixels 0..`pixels` whose `value` is finite.
pub(crate) fn mean_of_finite(pixels: usize, value: impl Fn(usize) -> f64) -> Measured {
    let (mut sum, mut squares, mut finite) = (0.0, 0.0, 0u64);
    for value in (0..pixels).map(value).filter(|value| value.is_finite()) {
        sum += value;
        squares += value * value;
        finite += 1;
    }
    let count = finite as f64;
    let mean = sum / count;
    let variance = (squares / count - mean * mean).max(0.0) * count / (count - 1.0);
    Measured {
        value: mean,
        standard_error: (variance / count).sqrt(),
        pixels: finite,
        excluded: pixels as u64 - finite,
    }
}

pub(crate) fn assert_same_shape(image: &Image, reference: &Image) {
    assert!(
        image.same_size(reference) && image.channels() == reference.channels(),
        "a picture of {}x{}x{} against a reference of {}x{}x{}",
        image.channels(),
        image.height(),
        image.width(),
        reference.channels(),
        reference.height(),
        reference.width()
    );
}

pub(crate) fn value(image: &Image, c: usize, i: usize) -> f64 {
    f64::from(image.plane(c)[i])
}

pub(crate) fn channel_mean(image: &Image, i: usize) -> f64 {
    (0..image.channels()).map(|c| value(image, c, i)).sum::<f64>() / image.channels() as f64
}
