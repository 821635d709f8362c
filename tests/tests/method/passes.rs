//! Passes of a corrected picture: they add up to it, in bands as whole, and follow it where they are parts of the noisy colour.

use sspc_core::bands::FrameBands;
use sspc_core::composition::Composition;
use sspc_core::correct::CorrectionSettings;
use sspc_core::passes::{Layout, PassRows, PassSource, split};
use sspc_core::prepare::{Exposure, FrameStats};
use sspc_image::{Frame, Image, Storage};
use sspc_kernels::parameters::Form;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::with_missing_pixel;
use sspc_testkit::method::{correct, random_network, settings_of};
use std::convert::Infallible;
use std::ops::Range;

/// Box means add rows in another order, and choices that are as good as equal may differ at single pixels.
const TOLERANCE: f64 = 1e-4;

struct Held {
    layout: Layout,
    passes: Vec<[Image; 2]>,
}

impl PassSource for Held {
    type Error = Infallible;

    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn rows(&mut self, rows: Range<usize>) -> Result<Vec<PassRows>, Infallible> {
        let cut = |image: &Image| image.crop(rows.start, 0, rows.len(), image.width());
        let of = |pass: &[Image; 2]| PassRows { halves: pass.each_ref().map(cut), colour: None, denoised: None };
        Ok(self.passes.iter().map(of).collect())
    }
}

/// Shares of the frame's noisy colour that `share(pass, x)` gives.
fn passes_of(frame: &Frame, count: usize, share: impl Fn(usize, usize) -> f32 + Sync) -> Held {
    let part =
        |k: usize, y: &Image| Image::from_fn(3, y.height(), y.width(), |c, row, x| share(k, x) * y.at(c, row, x));
    let passes = (0..count).map(|k| [part(k, &frame.a.radiance), part(k, &frame.b.radiance)]).collect();
    Held { layout: Layout { sets: vec![0..count], storage: vec![Storage::Float; count] }, passes }
}

fn settings(rows: usize, strength: f32) -> CorrectionSettings {
    let usual = settings_of(Form::Gated, 9, Composition::JudgedFullBuffer);
    CorrectionSettings { strength, rows: Some(rows), keep_maps: false, ..usual }
}

/// The picture and its passes.
fn corrected(frame: &Frame, passes: &mut Held, rows: usize, strength: f32) -> (Image, Vec<Image>) {
    let stats = FrameStats::of(frame, Exposure::Normalised);
    let network = random_network(Form::Gated, 2);
    let how = settings(rows, strength);
    let picture = correct(frame, stats, &network, &how).picture;
    let mut made: Vec<Image> =
        passes.passes.iter().map(|_| Image::zeros(3, picture.height(), picture.width())).collect();
    let mut bands = FrameBands::new(frame, stats, true);
    let put = |k: usize, top: usize, rows: &Image| made[k].put_rows(top, rows);
    let report = split(&mut bands, &network, &how, &picture, passes, &|| false, put);
    let report = report.unwrap_or_else(|_| panic!("held passes can be read"));
    assert!(report.largest_error < 1e-6 && report.unplaced == 0, "{report:?}");
    (picture, made)
}

#[test]
fn bands_give_the_same_passes() {
    let frame = with_missing_pixel(150, 21);
    let wavy = |k: usize, x: usize| {
        let share = 0.5 + 0.3 * (x as f32 * 0.7).sin();
        if k == 0 { share } else { 1.0 - share }
    };
    for strength in [0.0, 1.0] {
        let (picture, whole) = corrected(&frame, &mut passes_of(&frame, 2, wavy), 150, strength);
        let (_, banded) = corrected(&frame, &mut passes_of(&frame, 2, wavy), 48, strength);
        for (k, (whole, banded)) in whole.iter().zip(&banded).enumerate() {
            assert_images_close(banded, whole, TOLERANCE, &format!("pass {k}"));
        }
        let sum = Image::from_fn(3, 150, 21, |c, y, x| whole.iter().map(|pass| pass.at(c, y, x)).sum());
        assert_images_close(&sum, &picture, 1e-6, "the sum");
    }
}

/// Fails when a pass is averaged by other weights than another, or shared out by anything but its value.
#[test]
fn passes_in_proportion_to_the_colour_stay_in_proportion_to_the_picture() {
    let frame = with_missing_pixel(90, 33);
    let shares = [0.5, 0.3, 0.2];
    let (picture, made) = corrected(&frame, &mut passes_of(&frame, 3, |k, _| shares[k]), 90, 1.0);
    // The doubt of a pass is in proportion too, so larger ones take more of what is lacking: near the shares, not at them.
    for (pass, share) in made.iter().zip(shares) {
        let of = |image: &Image| image.data().iter().map(|v| f64::from(*v)).sum::<f64>();
        let found = of(pass) / of(&picture);
        assert!((found - f64::from(share)).abs() < 0.1 * f64::from(share), "{found} for {share}");
    }
}
