//! Made-up models and pictures that need no file.
#![allow(dead_code)]

use sspc_image::{Frame, HalfBuffer, Image};
use sspc_kernels::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, NORMAL, RADIANCE, VISIBILITY};
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model};
use std::path::PathBuf;

/// The next of a fixed sequence in 0..1 (Knuth's multiplier, the upper bits).
pub fn next(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

/// Weights of variance 2 / fan-in, so that signals neither vanish nor explode.
pub fn model(form: Form, hidden: usize, layers: usize) -> Model {
    let mut contract = Contract::new(form);
    contract.shape = Shape { hidden, layers, outputs: form.parameters() };
    let mut state = 1;
    let mut weights = Vec::new();
    for l in 0..layers {
        let (inputs, outputs) = contract.shape.channels(l);
        let scale = (24.0 / (9 * inputs) as f32).sqrt();
        weights.extend((0..outputs * inputs * 9).map(|_| (next(&mut state) - 0.5) * scale));
        weights.extend((0..outputs).map(|_| (next(&mut state) - 0.5) * 0.2));
    }
    Model::new(contract, weights).unwrap()
}

/// Features in 0..2.
pub fn features(height: usize, width: usize) -> Image {
    let mut state = (height * 10007 + width) as u64;
    Image::from_fn(FEATURE_CHANNELS, height, width, |_, _, _| 2.0 * next(&mut state))
}

/// A frame of two feature tensors.
pub fn frame_of(halves: &[Image; 2]) -> Frame {
    let half = |features: &Image| {
        let planes = |first: usize, channels: usize| {
            let data = (first..first + channels).flat_map(|c| features.plane(c).iter().copied()).collect();
            Image::from_planes(channels, features.height(), features.width(), data)
        };
        HalfBuffer {
            radiance: planes(RADIANCE, 3),
            denoised: planes(DENOISED, 3),
            albedo: Some(planes(ALBEDO, 3)),
            normal: Some(planes(NORMAL, 3)),
            visibility: Some(planes(VISIBILITY, 1)),
        }
    };
    let [a, b] = halves.each_ref().map(half);
    Frame { a, b, denoised: None, sources: Vec::new(), warnings: Vec::new() }
}

/// Fails at the first value that is off by more than `tolerance`, relative to its plane's mean
/// magnitude or its own, whichever is larger.
pub fn assert_close(found: &Image, expected: &Image, tolerance: f64, what: &str) {
    assert!(found.same_size(expected) && found.channels() == expected.channels(), "{what}: size");
    for c in 0..expected.channels() {
        let plane = expected.plane(c);
        let mean = plane.iter().map(|v| f64::from(v.abs())).sum::<f64>() / plane.len() as f64;
        for (i, (f, e)) in found.plane(c).iter().zip(plane).enumerate() {
            let error = f64::from((f - e).abs()) / mean.max(f64::from(e.abs()));
            let (y, x) = (i / expected.width(), i % expected.width());
            assert!(error < tolerance, "{what}: channel {c} at ({y}, {x}) is {f}, not {e}: {error:e}");
        }
    }
}

/// A case that the PyTorch reference made; see tests/cases/README.md.
pub struct Case(PathBuf);

pub fn case(name: &str) -> Case {
    let cases = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/cases");
    Case(cases.join(name).join("io.npz"))
}

impl Case {
    /// An array's shape and values, f32 or f64 in the file.
    fn array(&self, key: &str) -> (Vec<usize>, Vec<f64>) {
        let mut file = npyz::npz::NpzArchive::open(&self.0).unwrap();
        let array = file.by_name(key).unwrap().unwrap_or_else(|| panic!("no array {key}"));
        let shape = array.shape().iter().map(|&n| n as usize).collect();
        let wide = array.dtype().descr().contains("f8");
        let values = if wide {
            array.into_vec::<f64>().unwrap()
        } else {
            array.into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
        };
        (shape, values)
    }

    pub fn shape(&self, key: &str) -> Vec<usize> {
        self.array(key).0
    }

    pub fn doubles(&self, key: &str) -> Vec<f64> {
        self.array(key).1
    }

    pub fn floats(&self, key: &str) -> Vec<f32> {
        self.array(key).1.into_iter().map(|v| v as f32).collect()
    }

    /// Entry `index` of an array `[N, C, H, W]`.
    pub fn part(&self, key: &str, index: usize) -> Image {
        let (shape, values) = self.array(key);
        let &[_, channels, height, width] = &shape[..] else { panic!("{key} has shape {shape:?}") };
        let size = channels * height * width;
        let part = values[index * size..][..size].iter().map(|&v| v as f32).collect();
        Image::from_planes(channels, height, width, part)
    }
}
