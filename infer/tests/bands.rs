//! A frame corrected in bands is the frame corrected whole, with the network's tiles and the rows
//! around a band as `run` cuts them.

use sspc_core::bands::FrameBands;
use sspc_core::composition::Composition;
use sspc_core::correct::{CorrectError, Corrected, CorrectionSettings};
use sspc_core::prepare::FrameStats;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::{DenoisedVariant, Frame, HalfWeights, Image};
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::network::Network;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, Model};
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::sample;
use sspc_testkit::method::{correct, settings, window_network};

/// The judge's box means add f32 values in another order.
const TOLERANCE: f64 = 1e-5;

fn run(frame: &Frame, engine: &Engine, rows: usize, strength: f32) -> Corrected {
    let contract = &engine.model().contract;
    let stats = FrameStats::of(frame, contract.exposure).with_features_of(contract.features);
    correct(frame, stats, engine, &CorrectionSettings { rows: Some(rows), strength, ..settings(contract) })
}

fn engine() -> Engine {
    engine_in_tiles_of(50)
}

fn engine_in_tiles_of(tile: usize) -> Engine {
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    Engine::new(Model::new(contract, weights).unwrap(), Kernels::Fused(Isa::best()), tile)
}

/// A frame of which the top and the left are still.
fn half_still() -> Frame {
    let mut frame = sample();
    for c in 0..3 {
        for (y, x) in (0..frame.height()).flat_map(|y| (0..90).map(move |x| (y, x))) {
            if y < 70 || x < 30 {
                frame.b.radiance.set(c, y, x, frame.a.radiance.at(c, y, x));
            }
        }
    }
    frame
}

/// Tiles that are still, that are still in part, that end inside a block; and halves that weigh differently, whose mean of one
/// value need not be that value.
#[test]
fn tiles_of_any_size_give_the_same_picture() {
    let mut frame = half_still();
    frame.a.radiance.set(1, 50, 60, f32::NAN);
    for samples in [[32.0, 8.0], [2.0, 1.0]] {
        frame.weights = HalfWeights::of_samples(samples);
        let run = |tile, rows| run(&frame, &engine_in_tiles_of(tile), rows, 1.0);
        for rows in [48, 1000] {
            let whole = run(1000, rows);
            assert!(whole.verdict.fallback.is_none() && whole.active_share < 0.9, "{}", whole.active_share);
            for tile in [16, 37, 50, 128] {
                let tiled = run(tile, rows);
                assert!(tiled.picture == whole.picture, "tiles of {tile}, bands of {rows}");
                assert!(tiled.maps.map(|maps| maps.halves) == whole.maps.as_ref().map(|maps| maps.halves.clone()));
            }
        }
    }
}

#[test]
fn bands_do_not_show() {
    let (mut frame, engine) = (sample(), engine());
    frame.a.radiance.set(1, 50, 60, f32::NAN);
    let run = |rows| run(&frame, &engine, rows, 1.0);
    let whole = run(1000);
    assert!(whole.verdict.fallback.is_none(), "a fallback would leave nothing to compare");
    for rows in [16, 48, 100] {
        let banded = run(rows);
        assert_images_close(&banded.picture, &whole.picture, TOLERANCE, &format!("bands of {rows}"));
        assert!((banded.mean_share - whole.mean_share).abs() < TOLERANCE);
        assert!((banded.active_share - whole.active_share).abs() < TOLERANCE);
        let [found, expected] = [&banded, &whole].map(|run| run.verdict.estimate.corrected.value);
        assert!((found / expected - 1.0).abs() < 1e-4);
    }
}

#[test]
fn bands_do_not_show_where_denoised_passes_are_mixed_in() {
    let (mut frame, engine) = (sample(), engine());
    let alone = run(&frame, &engine, 1000, 1.0);
    // On the left nearer to the truth than z, as far as y says; on the right z is better.
    let width = frame.width();
    let of = |z: &Image, y: &Image| {
        Image::from_fn(3, z.height(), width, |c, row, x| {
            let z = z.at(c, row, x);
            if x < width / 2 { 0.7 * z + 0.3 * y.at(c, row, x) } else { 1.5 * z }
        })
    };
    let halves = [&frame.a, &frame.b].map(|half| of(&half.denoised, &half.radiance));
    frame.composite = Some(DenoisedVariant { halves, full: None });
    let whole = run(&frame, &engine, 1000, 1.0);
    let share = whole.composite_share.expect("a share");
    assert!(share > 0.01 && share < 0.9 && whole.picture != alone.picture, "{share}");
    for rows in [16, 48] {
        let banded = run(&frame, &engine, rows, 1.0);
        assert_images_close(&banded.picture, &whole.picture, TOLERANCE, &format!("bands of {rows}"));
        assert!((banded.composite_share.expect("a share") - share).abs() < TOLERANCE);
    }
}

/// Fails when a paper model leaves out blocks that `fit --preset paper` computes, in bands with and without noise.
#[test]
fn an_unjudged_picture_is_computed_everywhere() {
    let mut frame = sample();
    let (width, still) = (frame.width(), 100);
    for c in 0..3 {
        let (a, b) = (frame.a.radiance.plane(c)[..still * width].to_vec(), &mut frame.b.radiance);
        b.plane_mut(c)[..still * width].copy_from_slice(&a);
    }
    let contract = Contract::new(Form::Paper);
    assert_eq!(contract.composition, Composition::MeanOfHalves);
    let shape = contract.shape;
    let network = Network { shape, weights: start::analytic(shape, 1.0, &mut Rng::new(1)).weights };
    let model = Model::new(contract.clone(), network.weights.clone()).unwrap();
    let engine = Engine::new(model, Kernels::Fused(Isa::best()), 50);
    let found = run(&frame, &engine, 48, 1.0);
    assert_eq!(found.active_share, 1.0);
    // The whole at once by our own network, as a fit corrects it.
    let stats = FrameStats::of(&frame, contract.exposure);
    let whole = correct(&frame, stats, &window_network(contract.form, &network), &settings(&contract));
    assert_images_close(&found.picture, &whole.picture, TOLERANCE, "the paper's picture");
    let judged = CorrectionSettings { composition: Composition::JudgedFullBuffer, ..settings(&contract) };
    let skipped = correct(&frame, stats, &engine, &judged);
    assert!(skipped.active_share < 0.6, "a frame of which half is still");

    // Nothing at all to correct.
    frame.b.radiance = frame.a.radiance.clone();
    assert_eq!(run(&frame, &engine, 48, 1.0).active_share, 0.0);
}

/// Fails when strength is applied to anything but the judged correction, or the estimate is not of the picture.
#[test]
fn strength_leads_from_the_denoisers_picture_to_the_whole_correction() {
    let (frame, engine) = (sample(), engine());
    let run = |strength| run(&frame, &engine, 1000, strength);
    let [none, half, whole] = [0.0, 0.5, 1.0].map(run);
    let denoised = Image::mean_of(&frame.a.denoised, &frame.b.denoised);
    assert!(none.picture == denoised, "at 0 another picture than the denoiser's");
    let middle = Image::mean_of(&denoised, &whole.picture);
    for ((found, expected), whole) in half.picture.data().iter().zip(middle.data()).zip(whole.picture.data()) {
        // A correction that would go below 0 ends there.
        assert!(*whole == 0.0 || f64::from(found - expected).abs() <= TOLERANCE * f64::from(expected.max(1.0)));
    }
    assert!(half.verdict.fallback.is_none() && (half.mean_share - 0.5 * whole.mean_share).abs() < TOLERANCE);
    let [none, half, whole] = [none, half, whole].map(|run| run.verdict.estimate);
    assert_eq!(none.corrected, none.denoised);
    assert!(whole.corrected.value < half.corrected.value && half.corrected.value < none.corrected.value);
}

#[test]
fn a_request_to_stop_is_heard() {
    let (frame, engine) = (sample(), engine());
    let how = settings(&engine.model().contract);
    let mut bands = FrameBands::new(&frame, FrameStats::of(&frame, engine.model().contract.exposure), true);
    let stopped = sspc_core::correct::correct(&mut bands, &engine, &how, &|| true);
    assert!(matches!(stopped, Err(CorrectError::Interrupted)));
}
