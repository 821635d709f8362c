//! Frames in a file's units, and the whole way from frame to picture.

use sspc_core::correct::Corrected;
use sspc_core::prepare::{FrameStats, Prepared};
use sspc_image::{Frame, HalfBuffer, Image};
use sspc_kernels::network::Network;
use sspc_kernels::simd::Isa;
use sspc_testkit::frames::{frame_of, whole_sample};
use sspc_testkit::method::{correct, settings_of, window_network};
use sspc_train::backend::Backend;
use sspc_train::fit::{Control, Fitted, Limits, fit, starting_network};
use sspc_train::preset::Settings;

/// The textured scene of the kernels' cases as a frame with every role.
pub fn synthetic(height: usize, width: usize) -> Frame {
    let frame = frame_of(&crate::cases::usual(height, width).halves);
    Frame { denoised: Some(Image::mean_of(&frame.a.denoised, &frame.b.denoised)), ..frame }
}

/// A part of the repository's sample frame with every role.
pub fn sample(top: usize, left: usize, height: usize, width: usize) -> Frame {
    changed(&whole_sample(), |image| image.crop(top, left, height, width))
}

/// The frame with every image changed.
pub fn changed(frame: &Frame, change: impl Fn(&Image) -> Image) -> Frame {
    let half = |h: &HalfBuffer| HalfBuffer {
        radiance: change(&h.radiance),
        denoised: change(&h.denoised),
        albedo: h.albedo.as_ref().map(&change),
        normal: h.normal.as_ref().map(&change),
        visibility: h.visibility.as_ref().map(&change),
    };
    let denoised = frame.denoised.as_ref().map(&change);
    Frame { denoised, weights: frame.weights, ..Frame::of_halves(half(&frame.a), half(&frame.b)) }
}

/// The frame with all radiance times `factor`.
pub fn scaled(frame: &Frame, factor: f32) -> Frame {
    let mut frame = frame.clone();
    let Frame { a, b, denoised, .. } = &mut frame;
    let images = [&mut a.radiance, &mut a.denoised, &mut b.radiance, &mut b.denoised];
    for image in images.into_iter().chain(denoised) {
        image.data_mut().iter_mut().for_each(|v| *v *= factor);
    }
    frame
}

/// Fits a frame for `steps`.
pub fn fitted(prepared: &Prepared, settings: &Settings, steps: Option<usize>) -> Fitted {
    let limits = Limits { steps, time: None };
    let start = starting_network(settings);
    fit(&[prepared], settings, start, &limits, Backend::Flex, Isa::best(), |_| Control::Continue)
}

/// Corrects a frame as the command line does.
pub fn corrected(frame: &Frame, stats: FrameStats, settings: &Settings, network: &Network) -> Corrected {
    let how = settings_of(settings.form, settings.radius, settings.composition);
    correct(frame, stats, &window_network(settings.form, network), &how)
}
