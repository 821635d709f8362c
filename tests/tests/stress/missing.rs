//! NaN and Inf make a pixel missing and go no further than the windows that hold it.

use crate::frames::{changed, corrected, synthetic};
use sspc_core::compose::Composer;
use sspc_core::composition::Composition;
use sspc_core::corrector::PictureCorrection;
use sspc_core::independence::Independence;
use sspc_core::prepare::{Exposure, FrameStats, Prepared};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::{Frame, HalfBuffer, Image};
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::Network;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_onnx::{Contract, Model};
use sspc_testkit::method::{self, correct, planned, window_network};
use sspc_train::preset::{Preset, Settings};

const SIDE: usize = 116;
const VALUES: [f32; 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
/// One pixel, a row, a tile: small and in a corner, so that most of the picture is out of reach.
const PLACES: [Region; 3] = [
    Region { top: 20, left: 20, height: 1, width: 1 },
    Region { top: 10, left: 0, height: 1, width: SIDE },
    Region { top: 8, left: 16, height: 8, width: 16 },
];

type Role = (&'static str, fn(&mut Frame) -> Option<&mut Image>);
const ROLES: [Role; 11] = [
    ("y of a", |f| Some(&mut f.a.radiance)),
    ("y of b", |f| Some(&mut f.b.radiance)),
    ("z of a", |f| Some(&mut f.a.denoised)),
    ("z of b", |f| Some(&mut f.b.denoised)),
    ("z of the full buffer", |f| f.denoised.as_mut()),
    ("albedo of a", |f| f.a.albedo.as_mut()),
    ("albedo of b", |f| f.b.albedo.as_mut()),
    ("normal of a", |f| f.a.normal.as_mut()),
    ("normal of b", |f| f.b.normal.as_mut()),
    ("visibility of a", |f| f.a.visibility.as_mut()),
    ("visibility of b", |f| f.b.visibility.as_mut()),
];

fn settings() -> Settings {
    Settings::of(Preset::Balanced, 3)
}

fn network() -> Network {
    start::analytic(settings().shape, 0.7, &mut Rng::new(3))
}

/// The frame with `value` in the last channel of a role, at a place.
fn damaged(frame: &Frame, role: &Role, place: &Region, value: f32) -> Frame {
    let mut frame = frame.clone();
    let image = role.1(&mut frame).expect("the frame has every role");
    for y in place.top..place.top + place.height {
        for x in place.left..place.left + place.width {
            image.set(image.channels() - 1, y, x, value);
        }
    }
    frame
}

/// Whether a pixel's square window of `reach` holds any pixel of `place`.
fn holds(place: &Region, reach: usize, y: usize, x: usize) -> bool {
    let near = |i: usize, first: usize, count: usize| i + reach >= first && i < first + count + reach;
    near(y, place.top, place.height) && near(x, place.left, place.width)
}

/// The same bits wherever a window of `reach` does not hold the place.
fn assert_unreached(found: &Image, clean: &Image, place: &Region, reach: usize, what: &str) {
    let mut unreached = 0;
    for y in 0..found.height() {
        for x in (0..found.width()).filter(|&x| !holds(place, reach, y, x)) {
            unreached += 1;
            for c in 0..found.channels() {
                let (f, e) = (found.at(c, y, x), clean.at(c, y, x));
                assert!(f.to_bits() == e.to_bits(), "{what}: channel {c} at ({y}, {x}) is {f}, not {e}");
            }
        }
    }
    assert!(unreached > SIDE * SIDE / 4, "{what}: {unreached} pixels are too few to tell");
}

/// The same without what the halves say of each other: those of the made-up frame share texture that its denoised
/// pictures lack, for which it would fall back.
fn trusted(stats: FrameStats) -> FrameStats {
    FrameStats { independence: Independence::default(), ..stats }
}

/// What is made of a frame, stage by stage: parameters and corrections of both halves, weighed halves, picture.
struct Stages {
    parameters: [Image; 2],
    halves: [Image; 2],
    weighed: Image,
    picture: Image,
}

fn stages(frame: &Frame, stats: FrameStats) -> Stages {
    let (settings, network) = (settings(), network());
    let (taps, prepared) = (Taps::square(settings.radius), Prepared::by_stats(frame, &trusted(stats)));
    let window_network = window_network(settings.form, &network);
    let planes = [0, 1].map(|h| planned(&window_network, &prepared.halves[h], &prepared.plan));
    let halves = [0, 1].map(|h| {
        let windows = Windows::new(&prepared.halves[h], prepared.valid.as_ref(), prepared.set, settings.radius);
        let runs = prepared.plan.runs();
        let of = PictureCorrection::of_one(Isa::best(), settings.form, &windows, &taps, &planes[h], &runs);
        of.corrected().remove(0)
    });
    let done = corrected(frame, trusted(stats), &settings, &network);
    assert_eq!(done.verdict.fallback, None, "a fallback would leave nothing to compare");
    let weighed = done.maps.expect("maps were asked for").halves;
    Stages { parameters: planes, halves, weighed, picture: done.picture }
}

/// Pixels that a pixel of the picture depends on to every side.
fn reach(network: usize, window_radius: usize, composition: Composition) -> usize {
    let taps = Taps::square(window_radius);
    let composer = Composer {
        isa: Isa::best(),
        form: settings().form,
        taps: &taps,
        composition,
        strength: 1.0,
        judged_by_held_out: false,
        has_composite: false,
        with_differences: false,
    };
    network + composer.margin()
}

#[test]
fn nothing_spreads_beyond_the_windows_that_hold_a_missing_pixel() {
    let frame = synthetic(SIDE, SIDE);
    let stats = FrameStats::of(&frame, Exposure::Normalised);
    let clean = stages(&frame, stats);
    let (network, g_c) = (network().shape.radius(), settings().radius);
    let whole = reach(network, g_c, Composition::JudgedFullBuffer);
    for (i, (role, place)) in ROLES.iter().flat_map(|role| PLACES.iter().map(move |p| (role, p))).enumerate() {
        let value = VALUES[(i + i / 3) % 3];
        let what = format!("{value} in {}, {} x {} pixels", role.0, place.height, place.width);
        let bad = damaged(&frame, role, place, value);
        // The exposure is a mean over the picture: what is asked here is what windows do.
        let found = FrameStats::of(&bad, Exposure::Normalised).found;
        // A feature that is missing somewhere is missing there, and colour is corrected.
        let is_colour = role.0.starts_with(['y', 'z']);
        let counts = if is_colour { (place.pixels(), 0) } else { (0, place.pixels()) };
        assert_eq!((found.missing_pixels, found.pixels_without_feature), counts, "{what}: count");
        let stages = stages(&bad, FrameStats { found, ..stats });
        for h in 0..2 {
            assert_unreached(
                &stages.parameters[h],
                &clean.parameters[h],
                place,
                network,
                &format!("{what}: parameters"),
            );
            assert_unreached(&stages.halves[h], &clean.halves[h], place, network + g_c, &format!("{what}: g_c"));
            // A single pixel in shadow has visibility 0, which is what a missing one counts as.
            let is_shadow = role.0.starts_with("visibility") && place.pixels() == 1;
            assert!(is_shadow || stages.parameters[h] != clean.parameters[h], "{what}: the place was not seen");
        }
        assert_unreached(&stages.weighed, &clean.weighed, place, whole, &format!("{what}: weighed halves"));
        assert_unreached(&stages.picture, &clean.picture, place, whole, &format!("{what}: picture"));
        let images = stages.parameters.iter().chain(&stages.halves).chain([&stages.weighed, &stages.picture]);
        assert!(images.flat_map(Image::data).all(|v| v.is_finite()), "{what}: not finite");
        if !is_colour {
            continue;
        }
        // A missing pixel is the denoiser's, or where that is missing, a half's.
        let (y, x) = (place.top, place.left);
        let full = bad.denoised.as_ref().expect("a full buffer");
        let whole_pixel = (0..3).all(|c| full.at(c, y, x).is_finite());
        let source = if whole_pixel { full } else { &bad.a.denoised };
        assert!((0..3).all(|c| stages.picture.at(c, y, x) == source.at(c, y, x)), "{what}: the hole's filling");
    }
}

#[test]
fn missing_pixels_hardly_move_the_exposure() {
    let frame = synthetic(SIDE, SIDE);
    let clean = FrameStats::of(&frame, Exposure::Normalised);
    let found = FrameStats::of(&damaged(&frame, &ROLES[0], &PLACES[0], f32::NAN), Exposure::Normalised);
    // One of 13 456 pixels, at most a few times as bright as the mean.
    assert!((found.exposure / clean.exposure - 1.0).abs() < 1e-3);
}

#[test]
fn nothing_spreads_in_the_inference_engine_either() {
    let frame = synthetic(SIDE, SIDE);
    let mut contract = Contract::new(settings().form);
    contract.shape = network().shape;
    contract.exposure = Exposure::AsIs;
    let whole = reach(contract.shape.radius(), contract.window_radius, contract.composition);
    for kernels in [Kernels::Fused(Isa::best()), Kernels::Tract] {
        let engine = Engine::new(Model::new(contract.clone(), network().weights).expect("a model"), kernels, 50);
        let run = |frame: &Frame| {
            let stats = trusted(FrameStats::of(frame, contract.exposure));
            let done = correct(frame, stats, &engine, &method::settings(&contract));
            assert_eq!(done.verdict.fallback, None, "a fallback would leave nothing to compare");
            done
        };
        let clean = run(&frame);
        for (i, role) in ROLES.iter().enumerate().step_by(3) {
            let (place, what) = (&PLACES[i % 3], format!("{kernels:?}: {}", role.0));
            let found = run(&damaged(&frame, role, place, VALUES[(i + 1) % 3]));
            assert_unreached(&found.picture, &clean.picture, place, whole, &what);
            assert!(found.picture.data().iter().all(|v| v.is_finite()), "{what}: not finite");
        }
    }
}

#[test]
fn a_feature_that_is_nowhere_finite_counts_as_absent() {
    let frame = synthetic(40, 48);
    let remove: [(&str, fn(&mut HalfBuffer) -> &mut Option<Image>); 3] =
        [("albedo", |h| &mut h.albedo), ("normal", |h| &mut h.normal), ("visibility", |h| &mut h.visibility)];
    for (name, feature) in remove {
        let mut without = frame.clone();
        *feature(&mut without.a) = None;
        *feature(&mut without.b) = None;
        let absent = FrameStats::of(&without, Exposure::Normalised);
        for value in VALUES {
            // One channel of one half is enough: no pixel of the feature is whole.
            let mut bad = frame.clone();
            let image = feature(&mut bad.b).as_mut().expect("the frame has every role");
            image.plane_mut(0).fill(value);
            let stats = FrameStats::of(&bad, Exposure::Normalised);
            assert_eq!((stats.found.missing_pixels, stats.set), (0, absent.set), "{value} in all of {name}");
            let unusable = stats.found.unusable;
            assert_eq!(
                (unusable.albedo, unusable.normal, unusable.visibility),
                (name == "albedo", name == "normal", name == "visibility")
            );
            assert_eq!(stages(&bad, stats).picture, stages(&without, absent).picture, "{value} in all of {name}");
        }
    }
}

#[test]
fn colour_that_is_nowhere_finite_leaves_the_denoisers_picture() {
    // Reading refuses such files; a frame made in memory still gives no garbage.
    let frame = synthetic(40, 48);
    for role in &ROLES[..5] {
        let mut bad = frame.clone();
        role.1(&mut bad).expect("the frame has every role").plane_mut(1).fill(f32::NAN);
        let stats = FrameStats::of(&bad, Exposure::Normalised);
        assert_eq!(stats.found.missing_pixels, 40 * 48, "{}", role.0);
        let done = corrected(&bad, stats, &settings(), &network());
        assert!(done.verdict.fallback.is_some(), "{}", role.0);
        let full = bad.denoised.as_ref().expect("a full buffer");
        let expected = if role.0 == "z of the full buffer" { &bad.a.denoised } else { full };
        assert_eq!(&done.picture, expected, "{}", role.0);
    }
    let nothing = changed(&frame, |image| Image::filled(image.channels(), 40, 48, f32::NAN));
    let stats = FrameStats::of(&nothing, Exposure::Normalised);
    let picture = corrected(&nothing, stats, &settings(), &network()).picture;
    assert!(picture.data().iter().all(|v| *v == 0.0));
}
