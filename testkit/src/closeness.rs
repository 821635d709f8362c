//! Compares planes with the reference and says how many values differ, the first and the worst, and
//! leaves an error map; measures the smallest perturbation that a comparison catches.

use crate::case::Array;
use sspc_frames::preview::{Rgb8, write_png};
use sspc_image::Image;
use std::fmt;
use std::path::PathBuf;

/// What a difference is measured against.
#[derive(Clone, Copy, Debug)]
pub enum Relative<'a> {
    /// Each value's own magnitude, with a floor for values that are zero for all purposes.
    ToEach { floor: f64 },
    /// Each value's own magnitude, or a tenth of that of the terms it is the sum of where these are
    /// more than ten times larger: a sum with condition number k cannot be better in f32 than k
    /// roundings, 6e-8 each.
    ToTerms { magnitude: &'a [f64] },
    /// One magnitude for the whole array: gradients are sums of terms of both signs, and a small one
    /// next to large ones keeps the rounding of those.
    ToScale(f64),
    /// Each value's own magnitude, or the mean magnitude of its plane `[H, W]` where that is larger.
    ToPlanes,
}

/// The largest magnitude of an array.
pub fn largest(array: &Array) -> f64 {
    array.values.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// The worst value of a comparison that passed, in units of its measure.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst(pub f64);

/// A comparison that failed.
#[derive(Debug)]
pub struct Mismatch {
    pub stage: String,
    pub count: usize,
    pub of: usize,
    pub first: (Vec<usize>, f64, f64),
    pub worst: (Vec<usize>, f64, f64, f64),
    pub tolerance: f64,
    pub image: Option<PathBuf>,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (at, expected, found) = &self.first;
        let (worst_at, worst_expected, worst_found, error) = &self.worst;
        write!(
            f,
            "{}: {} of {} values differ by more than {:.1e}; first at {at:?}: expected {expected:.9e}, found {found:.9e}; \
             worst {error:.2e} at {worst_at:?}: expected {worst_expected:.9e}, found {worst_found:.9e}",
            self.stage, self.count, self.of, self.tolerance
        )?;
        match &self.image {
            Some(path) => write!(f, "; error map: {}", path.display()),
            None => Ok(()),
        }
    }
}

/// Compares `found` with `expected`; a value that is not finite is a difference.
pub fn compare(
    stage: &str,
    expected: &Array,
    found: &[f32],
    relative: Relative,
    tolerance: f64,
) -> Result<Worst, Box<Mismatch>> {
    assert_eq!(found.len(), expected.values.len(), "{stage}: values found against expected {:?}", expected.shape);
    let errors = relative_errors(expected, found, relative);
    let bad: Vec<usize> = (0..errors.len()).filter(|&i| errors[i] > tolerance || errors[i].is_nan()).collect();
    let rank = |i: usize| if errors[i].is_nan() { f64::INFINITY } else { errors[i] };
    let worst = (0..errors.len()).max_by(|&a, &b| rank(a).total_cmp(&rank(b))).unwrap_or(0);
    let Some(&first) = bad.first() else { return Ok(Worst(errors[worst])) };
    Err(Box::new(Mismatch {
        stage: stage.into(),
        count: bad.len(),
        of: errors.len(),
        first: (index(expected, first), expected.values[first], f64::from(found[first])),
        worst: (index(expected, worst), expected.values[worst], f64::from(found[worst]), errors[worst]),
        tolerance,
        image: error_map(stage, expected, &errors, tolerance),
    }))
}

/// As [`compare`], for tests: a mismatch is the panic's text.
pub fn assert_close(stage: &str, expected: &Array, found: &[f32], relative: Relative, tolerance: f64) -> Worst {
    compare(stage, expected, found, relative, tolerance).unwrap_or_else(|mismatch| panic!("{mismatch}"))
}

/// Compares flat values, relative to the largest expected one.
pub fn assert_values_close(stage: &str, expected: &[f32], found: &[f32], tolerance: f64) {
    let expected = Array::flat(expected);
    assert_close(stage, &expected, found, Relative::ToScale(largest(&expected)), tolerance);
}

/// Compares pictures of one size, [`Relative::ToPlanes`].
pub fn assert_images_close(found: &Image, expected: &Image, tolerance: f64, stage: &str) {
    assert!(found.same_size(expected) && found.channels() == expected.channels(), "{stage}: size");
    assert_close(stage, &Array::of_image(expected), found.data(), Relative::ToPlanes, tolerance);
}

/// Mean magnitude of every plane `[H, W]`.
fn means_of_planes(array: &Array) -> Vec<f64> {
    let &[.., height, width] = &array.shape[..] else { panic!("no planes in shape {:?}", array.shape) };
    let mean = |plane: &[f64]| plane.iter().map(|v| v.abs()).sum::<f64>() / plane.len() as f64;
    array.values.chunks_exact((height * width).max(1)).map(mean).collect()
}

fn relative_errors(expected: &Array, found: &[f32], relative: Relative) -> Vec<f64> {
    let means = matches!(relative, Relative::ToPlanes).then(|| means_of_planes(expected)).unwrap_or_default();
    let pixels = expected.values.len() / means.len().max(1);
    let pairs = expected.values.iter().zip(found).enumerate();
    pairs
        .map(|(i, (e, f))| {
            let scale = match relative {
                Relative::ToEach { floor } => e.abs().max(floor),
                Relative::ToTerms { magnitude } => e.abs().max(0.1 * magnitude[i]),
                Relative::ToScale(scale) => scale,
                Relative::ToPlanes => e.abs().max(means[i / pixels]),
            };
            let error = (f64::from(*f) - e).abs();
            if error == 0.0 { 0.0 } else { error / scale }
        })
        .collect()
}

fn index(array: &Array, flat: usize) -> Vec<usize> {
    let mut rest = flat;
    let mut at = vec![0; array.shape.len()];
    for (i, n) in at.iter_mut().zip(&array.shape).rev() {
        *i = rest % n;
        rest /= n;
    }
    at
}

/// The largest error over the channels of each pixel, black 0, white the tolerance and above, red
/// where a value is not finite; arrays without height and width have none.
fn error_map(stage: &str, expected: &Array, errors: &[f64], tolerance: f64) -> Option<PathBuf> {
    let &[.., height, width] = expected.shape.as_slice() else { return None };
    let pixels = height * width;
    if expected.shape.len() < 3 || pixels == 0 {
        return None;
    }
    let colours = (0..pixels).flat_map(|i| {
        let values = errors[i..].iter().step_by(pixels);
        let worst = values.fold(0.0, |m: f64, &v| if v.is_nan() { f64::NAN } else { m.max(v) });
        if worst.is_nan() { [255, 0, 0] } else { [(255.0 * (worst / tolerance).min(1.0)) as u8; 3] }
    });
    let picture = Rgb8 { width, height, data: colours.collect() };
    let name: String = stage.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
    let path = scratch().join(format!("{name}.png"));
    write_png(&path, &[], &picture).ok()?;
    Some(path)
}

/// Where tests leave what people may look at: `tmp` of cargo's target folder, which it makes for them.
pub fn scratch() -> PathBuf {
    // target/PROFILE/deps/TEST
    let beside = std::env::current_exe().ok().and_then(|test| Some(test.ancestors().nth(3)?.join("tmp")));
    beside.filter(|folder| folder.is_dir()).unwrap_or_else(std::env::temp_dir)
}

/// A perturbation that every parity test must catch: one part in a thousand.
pub const MUST_CATCH: f64 = 1e-3;

/// Halves a perturbation from [`MUST_CATCH`] on while `caught` says that the comparison fails, and
/// prints the smallest one that it caught.
///
/// # Panics
/// When not even [`MUST_CATCH`] is caught: the tolerance cannot fail.
pub fn assert_sensitive(what: &str, caught: impl Fn(f64) -> bool) {
    assert!(caught(MUST_CATCH), "{what}: an error of {MUST_CATCH:.0e} goes unnoticed");
    let mut smallest = MUST_CATCH;
    while smallest > 1e-9 && caught(0.5 * smallest) {
        smallest *= 0.5;
    }
    println!("{what}: catches a relative error of {smallest:.1e}");
}
