//! A thousand steps at the largest rate on every extreme frame: weights stay finite.

use crate::frames::{changed, corrected, fitted, scaled, synthetic};
use sspc_core::prepare::{FrameStats, Prepared};
use sspc_core::rng::Rng;
use sspc_image::{Frame, Image};
use sspc_train::preset::{Preset, Rate, Sampling, Settings};

const STEPS: usize = 1000;

/// The largest rate of our presets.
fn largest_peak() -> f64 {
    let peaks = [Preset::Fast, Preset::Balanced, Preset::Quality].map(|preset| match Settings::of(preset, 1).rate {
        Rate::Cosine { peak, .. } => peak,
        Rate::NoiseScaled { .. } => 0.0,
    });
    peaks.into_iter().fold(0.0, f64::max)
}

/// The presets with their own network, window and loss, at the largest rate they may ever use, on small
/// tiles.
fn settings(preset: Preset) -> Settings {
    let own = Settings::of(preset, 5);
    // A place of a grid gives a tile of either half.
    let batch = if matches!(own.sampling, Sampling::Grid { .. }) { 1 } else { 2 };
    let rate = match own.rate {
        // The paper's rule ends at the largest rate that a fit may have.
        Rate::NoiseScaled { .. } => Rate::NoiseScaled { factor: 1e30 },
        Rate::Cosine { warm_up, .. } => Rate::Cosine { peak: largest_peak(), warm_up },
    };
    Settings { rate, tile: 8, batch, ..own }
}

/// `value` at some pixels of an image.
fn spotted(image: &Image, share: f32, value: f32) -> Image {
    let rng = &mut Rng::new(8);
    let mut image = image.clone();
    image.data_mut().iter_mut().filter(|_| rng.uniform() < share).for_each(|v| *v = value);
    image
}

fn frames() -> Vec<(&'static str, Frame)> {
    let base = synthetic(20, 24);
    let with = |change: fn(&mut Frame)| {
        let mut frame = base.clone();
        change(&mut frame);
        frame
    };
    vec![
        ("as rendered", base.clone()),
        ("exposure 1e-8", scaled(&base, 1e-8)),
        ("exposure 1e8", scaled(&base, 1e8)),
        ("denormals", scaled(&base, 1e-40)),
        ("near the end of f32", scaled(&base, 1e37)),
        ("one bright pixel, 1e6", with(|f| f.a.radiance.set(0, 9, 9, 1e6))),
        ("one pixel of 1e38", with(|f| f.b.radiance.set(1, 9, 9, 1e38))),
        (
            "1e38 in y and z",
            with(|f| {
                f.a.radiance = spotted(&f.a.radiance, 0.05, 1e38);
                f.b.denoised = spotted(&f.b.denoised, 0.05, 1e38);
            }),
        ),
        (
            "features of 1e30",
            with(|f| {
                f.a.normal = f.a.normal.as_ref().map(|n| spotted(n, 0.2, 1e30));
                f.b.albedo = f.b.albedo.as_ref().map(|n| spotted(n, 0.2, -1e30));
            }),
        ),
        ("equal halves", with(|f| f.b = f.a.clone())),
        (
            "equal but for one pixel",
            with(|f| {
                f.b = f.a.clone();
                f.b.radiance.set(2, 3, 4, 0.9);
            }),
        ),
        (
            "no denoised light",
            with(|f| {
                f.a.denoised.data_mut().fill(0.0);
                f.b.denoised.data_mut().fill(0.0);
            }),
        ),
        ("NaN in a third of y", with(|f| f.a.radiance = spotted(&f.a.radiance, 0.1, f32::NAN))),
        ("NaN everywhere", changed(&base, |image| Image::filled(image.channels(), 20, 24, f32::NAN))),
        ("1 x 1", synthetic(1, 1)),
        ("1 x 24", synthetic(1, 24)),
    ]
}

fn survive(preset: Preset) {
    let settings = settings(preset);
    let mut text = format!("\n{STEPS} steps of `{preset}` at its largest rate\n");
    for (name, frame) in frames() {
        let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, settings.exposure));
        let fit = fitted(&prepared, &settings, Some(STEPS));
        let not_taken = fit.history.iter().filter(|step| !step.loss.is_finite()).count();
        let largest = fit.network.weights.iter().fold(0.0f32, |m, w| m.max(w.abs()));
        text += &format!(
            "{name:26} steps {:5}, dropped {:4}, loss not finite {not_taken:4}, largest weight {largest:.2}\n",
            fit.history.len(),
            fit.dropped
        );
        assert!(fit.network.weights.iter().all(|w| w.is_finite()), "{preset}, {name}: weights");
        assert!(fit.dropped >= not_taken, "{preset}, {name}: a step that gave no finite loss was taken");
        let stats = FrameStats::of(&frame, settings.exposure);
        let picture = corrected(&frame, stats, &settings, &fit.network).picture;
        assert!(picture.data().iter().all(|v| v.is_finite() && *v >= 0.0), "{preset}, {name}: picture");
    }
    println!("{text}");
}

#[test]
fn our_presets_survive_a_thousand_steps() {
    survive(Preset::Fast);
}

#[test]
fn the_papers_preset_survives_a_thousand_steps() {
    survive(Preset::Paper);
}

#[test]
fn equal_halves_leave_the_papers_preset_nothing_to_train() {
    let mut frame = synthetic(20, 24);
    frame.b = frame.a.clone();
    let settings = Settings::of(Preset::Paper, 1);
    let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, settings.exposure));
    let fit = fitted(&prepared, &settings, None);
    assert_eq!((fit.history.len(), fit.dropped), (0, 0));
}
