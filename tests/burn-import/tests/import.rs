//! The imported graphs in Burn's own arithmetic against our kernels.

#[path = "../src/model.rs"]
mod model;

use burn::tensor::{Device, Tensor, TensorData};
use sspc_burn_import::{image, network};
use sspc_core::corrector::PictureCorrection;
use sspc_core::plan::Plan;
use sspc_core::rng::Rng;
use sspc_core::tiles;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::WindowNetwork;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;

/// Nine layers of f32 sums in another order, then activations.
const NETWORK_TOLERANCE: f32 = 1e-4;
/// And 361 weights.
const PICTURE_TOLERANCE: f32 = 1e-3;

/// Features in 0..2, another picture for every seed.
fn features(height: usize, width: usize, seed: u64) -> Image {
    let mut rng = Rng::new(seed);
    Image::from_fn(FEATURE_CHANNELS, height, width, |_, _, _| 2.0 * rng.uniform())
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), &Device::default())
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec::<f32>().expect("f32")
}

fn our_parameters(features: &Image) -> Image {
    let everything = Plan::everything(features.height(), features.width());
    let network = WindowNetwork::new(Isa::best(), Form::Gated, &model::model().networks()[0]);
    let Ok(parameters) = tiles::parameters(&network, 0, features, &everything, 0..features.height());
    parameters
}

/// Every value, relative to the largest of its plane.
fn assert_close(found: &[f32], expected: &Image, tolerance: f32, what: &str) {
    assert_eq!(found.len(), expected.data().len(), "{what}: values");
    for c in 0..expected.channels() {
        let plane = expected.plane(c);
        let scale = plane.iter().fold(0.0f32, |most, v| most.max(v.abs()));
        for (i, (f, e)) in found[c * plane.len()..].iter().zip(plane).enumerate() {
            assert!((f - e).abs() <= tolerance * scale, "{what}, channel {c}, pixel {i}: {f}, not {e}");
        }
    }
}

/// H and W are free in the file: several sizes in one program.
#[test]
fn the_imported_network_gives_our_parameters() {
    let imported = network::Model::default();
    for (height, width) in [(1, 1), (7, 10), (13, 6)] {
        let features = features(height, width, 1);
        let found = imported.forward(tensor(features.data().to_vec(), [1, FEATURE_CHANNELS, height, width]));
        let what = format!("{height}x{width}");
        assert_close(&values(found), &our_parameters(&features), NETWORK_TOLERANCE, &what);
    }
}

#[test]
fn the_imported_image_graph_gives_our_picture() {
    let imported = image::Model::default();
    let taps = Taps::square(9);
    for (height, width) in [(5, 12), (21, 8)] {
        let halves = [features(height, width, 2), features(height, width, 3)];
        let part = |first: usize, channels: usize| {
            let planes = halves.iter().flat_map(|half| (first..first + channels).flat_map(|c| half.plane(c).to_vec()));
            tensor(planes.collect(), [2, channels, height, width])
        };
        // In the order of the contract.
        let (corrected, found) =
            imported.forward(part(0, 3), part(10, 3), part(3, 3), part(6, 1), part(7, 3), tensor(vec![1.0], [1]));
        let everything = Plan::everything(height, width);
        let ours = halves.each_ref().map(|half| {
            let windows = Windows::new(half, None, FeatureSet::ALL, taps.radius());
            let (runs, parameters) = (everything.runs(), our_parameters(half));
            let of = PictureCorrection::of_one(Isa::best(), Form::Gated, &windows, &taps, &parameters, &runs);
            of.corrected().remove(0)
        });
        let found = values(found);
        for (h, ours) in ours.iter().enumerate() {
            let half = &found[h * found.len() / 2..][..found.len() / 2];
            assert_close(half, ours, PICTURE_TOLERANCE, &format!("{height}x{width}, half {h}"));
        }
        let mean = Image::mean_of(&ours[0], &ours[1]);
        let mean = Image::from_fn(3, height, width, |c, y, x| mean.at(c, y, x).max(0.0));
        assert_close(&values(corrected), &mean, PICTURE_TOLERANCE, &format!("{height}x{width}, picture"));
    }
}
