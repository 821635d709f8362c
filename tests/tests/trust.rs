//! Halves of a real frame that are not what they claim to be: what is made of them is never worse than the denoiser's.
//! (`bench/trust` does the same with a denoiser and training, on frames that are not in the repository.)

use sspc_core::composition::Composition;
use sspc_core::correct::Corrected;
use sspc_core::frame_stats::{Exposure, FrameStats};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_core::trust::{Distrust, Trust};
use sspc_image::{Frame, Image};
use sspc_kernels::gc::PAPER_RADIUS;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_testkit::frames::whole_sample;
use sspc_testkit::method::{correct, settings_of, window_network};

/// Texture, the denoiser's traces of noise and 192 blocks move a measured correlation by so much.
const NEAR: f64 = 0.1;

/// p + k (q - p).
fn mixed(p: &Image, q: &Image, k: f32) -> Image {
    Image::from_rows(p.channels(), p.height(), p.width(), |c, y, row| {
        for ((out, p), q) in row.iter_mut().zip(p.row(c, y)).zip(q.row(c, y)) {
            *out = p + k * (q - p);
        }
    })
}

/// The sample with halves whose noise has this correlation, and whose mean is as it was. A linear denoiser mixes its
/// pictures as the radiance is mixed.
fn correlated(rho: f32) -> Frame {
    let mut frame = whole_sample();
    // Of (1 - k) a + k b and k a + (1 - k) b: rho = 2 k (1 - k) / ((1 - k)² + k²), for k below 0 too.
    let k = 0.5 * (1.0 - (1.0 - 2.0 * rho / (1.0 + rho)).sqrt());
    let (a, b) = (frame.a.clone(), frame.b.clone());
    (frame.a.radiance, frame.b.radiance) = (mixed(&a.radiance, &b.radiance, k), mixed(&b.radiance, &a.radiance, k));
    (frame.a.denoised, frame.b.denoised) = (mixed(&a.denoised, &b.denoised, k), mixed(&b.denoised, &a.denoised, k));
    frame
}

/// The frame corrected with an untrained network.
fn corrected(frame: &Frame) -> Corrected {
    let form = Form::Gated;
    let network = start::analytic(Shape::shallow(form), 0.8, &mut Rng::new(1));
    let how = settings_of(form, PAPER_RADIUS, Composition::JudgedFullBuffer);
    let stats = FrameStats::of(frame, Exposure::Normalised);
    correct(frame, stats, &window_network(form, &network), &how)
}

fn trust(frame: &Frame) -> Trust {
    FrameStats::of(frame, Exposure::Normalised).trust()
}

fn assert_is_the_denoisers(frame: &Frame) {
    let Corrected { picture, verdict, mean_share, .. } = corrected(frame);
    assert_eq!(picture.data(), frame.denoised.as_ref().expect("denoised").data());
    assert!(verdict.fallback.is_some() && mean_share == 0.0, "{:?}", verdict.fallback);
}

#[test]
fn sound_halves_are_trusted_and_corrected() {
    let frame = whole_sample();
    assert_eq!(trust(&frame), Trust::Independent, "{:?}", FrameStats::of(&frame, Exposure::Normalised).independence);
    let Corrected { verdict, mean_share, .. } = corrected(&frame);
    assert!(verdict.fallback.is_none() && mean_share > 0.0, "{:?}", verdict.fallback);
}

#[test]
fn correlated_noise_is_measured_and_the_picture_is_the_denoisers() {
    for rho in [-0.9f32, -0.5, -0.29, 0.29, 0.5, 0.8, 0.95] {
        let frame = correlated(rho);
        let found = FrameStats::of(&frame, Exposure::Normalised).independence.correlation.expect("enough blocks");
        assert!((found - f64::from(rho)).abs() < NEAR, "{rho}: {found}");
        assert_eq!(trust(&frame), Trust::None(Distrust::Correlated(found)), "{rho}");
        assert_is_the_denoisers(&frame);
    }
}

#[test]
fn halves_of_different_pictures_are_not_mixed() {
    let scaled = |image: &Image, by: f32| {
        let mut image = image.clone();
        image.data_mut().iter_mut().for_each(|v| *v *= by);
        image
    };
    let mut brighter = whole_sample();
    brighter.b.radiance = scaled(&brighter.b.radiance, 1.5);
    brighter.b.denoised = scaled(&brighter.b.denoised, 1.5);
    assert!(matches!(trust(&brighter), Trust::None(Distrust::Brightness(_, r)) if (r - 1.0 / 1.5).abs() < 0.02));

    let mut denoised = whole_sample();
    denoised.b.radiance = mixed(&denoised.b.radiance, &denoised.b.denoised, 0.9);
    assert!(matches!(trust(&denoised), Trust::None(Distrust::Noise(r)) if r > 12.0), "{:?}", trust(&denoised));

    let (height, width) = (brighter.height(), brighter.width());
    let with_features = |of: &dyn Fn(usize, usize) -> (usize, usize)| {
        let mut frame = whole_sample();
        let changed = |image: &Image| {
            Image::from_fn(3, height, width, |c, y, x| {
                let (y, x) = of(y, x);
                image.at(c, y, x)
            })
        };
        frame.b.albedo = frame.b.albedo.as_ref().map(changed);
        frame.b.normal = frame.b.normal.as_ref().map(changed);
        frame
    };
    let moved = with_features(&|y, x| ((y + height - 1) % height, (x + 1) % width));
    assert_eq!(trust(&moved), Trust::None(Distrust::Moved([-1, 1])));
    let other = with_features(&|y, x| (y, width - 1 - x));
    let found = trust(&other);
    assert!(matches!(found, Trust::None(Distrust::Edges(_) | Distrust::Moved(_))), "{found:?}");
    [brighter, denoised, moved, other].iter().for_each(assert_is_the_denoisers);
}
