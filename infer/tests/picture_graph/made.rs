//! Made-up models and frames: damaged, dim, still in places, with fireflies, with errors that are opposite.

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::{Frame, Image};
use sspc_kernels::features::DENOISED;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model};
use sspc_testkit::frames::{frame_of, textured};

/// A model that adds a smoothed residual, of our presets' size; `gate` is how much of it.
pub fn model_of(form: Form, radius: usize, gate: f64) -> Model {
    let mut contract = Contract::new(form);
    contract.window_radius = radius;
    contract.shape = Shape { hidden: 8, layers: 3, outputs: form.parameters() };
    let weights = match form {
        Form::Gated => start::analytic(contract.shape, gate, &mut Rng::new(1)).weights,
        Form::Paper => start::paper(contract.shape, &mut Rng::new(1)).weights,
    };
    Model::new(contract, weights).expect("a model")
}

pub fn gated(radius: usize) -> Model {
    model_of(Form::Gated, radius, 0.7)
}

/// What [`textured`] shows.
fn truth(k: usize, y: usize, x: usize) -> f32 {
    0.3 + 0.25 * ((x / 5 + y / 4 + k) % 3) as f32
}

/// A frame whose z is nearly right on the left and another picture on the right, so that shares of the correction differ.
pub fn frame(height: usize, width: usize, seed: u64) -> Frame {
    let mut rng = Rng::new(seed);
    let mut halves = textured(height, width, &mut rng);
    for half in &mut halves {
        for (k, y) in (0..3).flat_map(|k| (0..height).map(move |y| (k, y))) {
            let value = |x: usize, rng: &mut Rng| truth(k, y, x) * (1.0 + 0.03 * rng.normal());
            (0..2 * width / 3).for_each(|x| half.set(DENOISED + k, y, x, value(x, &mut rng)));
        }
    }
    frame_of(&halves)
}

/// A small frame whose halves' errors are opposite: few enough pixels that only the estimate shows it.
pub fn opposite() -> Frame {
    let mut frame = frame(20, 34, 9);
    let other = |c: usize, y: usize, x: usize| (2.0 * truth(c, y, x) - frame.a.radiance.at(c, y, x)).max(0.0);
    let opposite = Image::from_fn(3, 20, 34, other);
    frame.b.radiance = opposite;
    frame
}

/// The same picture in other units.
pub fn scaled(frame: Frame, by: f32) -> Frame {
    let change = |image: &mut Image| image.data_mut().iter_mut().for_each(|v| *v *= by);
    let mut frame = frame;
    for half in [&mut frame.a, &mut frame.b] {
        change(&mut half.radiance);
        change(&mut half.denoised);
    }
    frame.denoised.iter_mut().for_each(change);
    frame
}

/// NaN and Inf in every role, a hole that no picture covers, a firefly, and negative values.
pub fn damaged() -> Frame {
    let mut frame = frame(45, 61, 3);
    let mut full = Image::mean_of(&frame.a.denoised, &frame.b.denoised);
    full.set(1, 40, 50, f32::NAN);
    full.set(2, 9, 33, -0.25);
    full.set(0, 20, 20, 400.0);
    frame.denoised = Some(full);
    frame.a.radiance.set(1, 10, 7, f32::NAN);
    frame.b.radiance.set(2, 30, 12, f32::INFINITY);
    frame.b.denoised.set(0, 22, 41, f32::NEG_INFINITY);
    frame.a.radiance.set(0, 14, 44, 5e4);
    frame.a.denoised.set(0, 14, 44, 9.0);
    frame.b.radiance.set(1, 3, 3, -0.5);
    if let Some(albedo) = &mut frame.a.albedo {
        albedo.set(1, 5, 5, f32::NAN);
    }
    if let Some(normal) = &mut frame.b.normal {
        normal.set(2, 12, 50, f32::INFINITY);
    }
    // Three pixels wide: the middle takes two rings.
    for (y, x) in (33..38).flat_map(|y| (0..5).map(move |x| (y, x))) {
        for k in 0..3 {
            for half in [&mut frame.a, &mut frame.b] {
                half.radiance.set(k, y, x, f32::NAN);
                half.denoised.set(k, y, x, f32::NAN);
            }
            frame.denoised.as_mut().expect("it was set").set(k, y, x, f32::NAN);
        }
    }
    frame
}

/// Three bands of brightness, and fireflies in each: of the full buffer's z alone, small and large, and of half a's z.
pub fn fireflies() -> Frame {
    let (height, width) = (72, 90);
    let mut frame = frame(height, width, 10);
    for y in 0..height {
        let brightness = [1.0, 0.05, 0.005][y / 24];
        for (k, x) in (0..3).flat_map(|k| (0..width).map(move |x| (k, x))) {
            for half in [&mut frame.a, &mut frame.b] {
                for image in [&mut half.radiance, &mut half.denoised] {
                    image.set(k, y, x, brightness * image.at(k, y, x));
                }
            }
        }
    }
    let mut full = Image::mean_of(&frame.a.denoised, &frame.b.denoised);
    for (i, (y, x)) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))).enumerate() {
        for k in 0..3 {
            match i % 157 {
                0 => full.set(k, y, x, 1.5 * full.at(k, y, x)),
                50 => full.set(k, y, x, 30.0 * full.at(k, y, x)),
                100 => {
                    frame.a.denoised.set(k, y, x, 40.0 * frame.a.denoised.at(k, y, x));
                    full.set(k, y, x, 20.0 * full.at(k, y, x));
                }
                _ => {}
            }
        }
    }
    frame.denoised = Some(full);
    frame
}

/// Halves that are equal but for one corner.
pub fn mostly_still() -> Frame {
    let mut frame = frame(40, 70, 4);
    let noisy = frame.b.clone();
    frame.b.radiance = frame.a.radiance.clone();
    for (y, x) in (20..40).flat_map(|y| (30..70).map(move |x| (y, x))) {
        (0..3).for_each(|k| frame.b.radiance.set(k, y, x, noisy.radiance.at(k, y, x)));
    }
    frame
}
