//! Whether a frame's halves can be what they claim to be: identical, correlated, lossy, incomplete.

use crate::error::{Error, Purpose};
use crate::frame::{Buffer, Frame, Role};
use crate::image::Image;
use crate::io::resolve::Resolution;
use crate::prepare::unusable_features;
use std::f64::consts::FRAC_PI_2;

/// Correlation of the halves' noise above which the user is warned. Independent halves of the renders at hand
/// stay below half of it; where a denoiser blurs texture, both residuals share that texture.
pub const HALVES_CORRELATED: f64 = 0.4;
/// Correlation of neighbouring pixels' noise above which the user is warned. Filters that splat give 0.25 (a tent of
/// radius 1) or 0.37 (a Gaussian of 0.5 pixels); renders without splatting were seen to reach 0.18 on fur and glass.
pub const NEIGHBOURS_CORRELATED: f64 = 0.22;
/// Rows are skipped evenly so that about this many pixels are looked at: correlations to a hundredth need no more.
const MOST_PIXELS: usize = 1 << 17;
/// Pixels with noise that a correlation needs to mean anything.
const FEWEST_SAMPLES: u64 = 256;

/// Refuses halves that cannot be used and adds warnings for the rest.
pub(crate) fn check_frame(frame: &mut Frame, resolution: &Resolution) -> Result<(), Error> {
    check_finite(frame, resolution)?;
    check_identical(frame, resolution)?;
    let mut warnings = lossy_inputs(resolution);
    warnings.extend(absent_roles(frame));
    warnings.extend(unusable_roles(frame));
    warnings.extend(correlated(frame));
    frame.warnings.extend(warnings);
    Ok(())
}

/// Colour without one finite value leaves nothing to correct, or to start from.
fn check_finite(frame: &Frame, resolution: &Resolution) -> Result<(), Error> {
    let colours = [
        (Some(&frame.a.radiance), Role::Radiance, Buffer::A),
        (Some(&frame.b.radiance), Role::Radiance, Buffer::B),
        (Some(&frame.a.denoised), Role::Denoised, Buffer::A),
        (Some(&frame.b.denoised), Role::Denoised, Buffer::B),
        (frame.denoised.as_ref(), Role::Denoised, Buffer::Full),
    ];
    for (image, role, buffer) in colours {
        let nothing = |c: &usize| image.is_some_and(|i| !i.plane(*c).iter().any(|value| value.is_finite()));
        if let Some(c) = (0..3).find(nothing) {
            let source = frame.sources.iter().find(|source| (source.role, source.buffer) == (role, buffer));
            let channel = source.and_then(|source| source.channels.get(c)).cloned().unwrap_or_default();
            let path = path_of(resolution, role, buffer);
            return Err(Error::NothingFinite { path, purpose: Purpose::Role(role, buffer), channel });
        }
    }
    Ok(())
}

/// Optional features that count as absent because they are nowhere finite.
fn unusable_roles(frame: &Frame) -> Vec<String> {
    let unusable = unusable_features(frame);
    [(Role::Albedo, unusable.albedo), (Role::Normal, unusable.normal), (Role::Visibility, unusable.visibility)]
        .iter()
        .filter(|(_, is_unusable)| *is_unusable)
        .map(|(role, _)| format!("no pixel of the {role} is finite in both halves: it counts as absent"))
        .collect()
}

/// Equal halves carry no information about the noise. A wholly black frame is left alone: it is equal because
/// there is no light, and sequences fade to black.
fn check_identical(frame: &Frame, resolution: &Resolution) -> Result<(), Error> {
    let radiance = (&frame.a.radiance, &frame.b.radiance, Role::Radiance);
    let denoised = (&frame.a.denoised, &frame.b.denoised, Role::Denoised);
    for (a, b, role) in [radiance, denoised] {
        let equal = a.data().iter().zip(b.data()).all(|(a, b)| a.to_bits() == b.to_bits());
        let black = a.data().iter().all(|&value| value == 0.0);
        if equal && !black {
            let (a, b) = (path_of(resolution, role, Buffer::A), path_of(resolution, role, Buffer::B));
            return Err(Error::IdenticalHalves { a, b, purpose: Purpose::Role(role, Buffer::B) });
        }
    }
    Ok(())
}

fn path_of(resolution: &Resolution, role: Role, buffer: Buffer) -> std::path::PathBuf {
    let filled = resolution.get(role, buffer);
    filled.map(|filled| resolution.files[filled.file].path.clone()).unwrap_or_default()
}

fn lossy_inputs(resolution: &Resolution) -> Vec<String> {
    let mut warnings: Vec<String> = Vec::new();
    for filled in &resolution.filled {
        let file = &resolution.files[filled.file];
        let method = filled.channels.iter().find_map(|&at| file.lossy[file.channels[at].part]);
        if let Some(method) = method {
            let line = format!(
                "{}: {} was stored with lossy {method}, so its noise is no longer the renderer's",
                file.path.display(),
                Purpose::Role(filled.role, filled.buffer)
            );
            warnings.push(line);
        }
    }
    warnings
}

fn absent_roles(frame: &Frame) -> Vec<String> {
    let absent = [
        (frame.a.albedo.is_none(), "no albedo: texture is told from noise by colour alone"),
        (frame.a.normal.is_none(), "no normal: edges of shape are told from noise by colour alone"),
        (frame.a.visibility.is_none(), "no visibility: shadow edges are told from noise by colour alone"),
        (
            frame.denoised.is_none(),
            "no denoised full buffer: the mean of both denoised halves is the baseline, which is noisier",
        ),
    ];
    absent.iter().filter(|(is_absent, _)| *is_absent).map(|(_, line)| line.to_string()).collect()
}

fn correlated(frame: &Frame) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some(r) = halves_correlation(frame)
        && r.abs() > HALVES_CORRELATED
    {
        warnings.push(format!(
            "the noise of the halves is correlated ({r:.2}, expected about 0): they are not independent, and error estimates will be off"
        ));
    }
    if let Some(r) = neighbour_correlation(&frame.a.radiance, &frame.b.radiance)
        && r > NEIGHBOURS_CORRELATED
    {
        warnings.push(format!(
            "the noise of neighbouring pixels is correlated ({r:.2}, expected about 0): the renderer's pixel filter spreads samples; a box filter corrects better"
        ));
    }
    warnings
}

/// Correlation of the noise of both halves, -1..1, from signs so that no firefly decides it.
///
/// The noise is what remains of `y - z` in each half after the second difference in x and y, which takes out
/// whatever is smooth, the denoiser's bias above all. `None` when too few pixels have noise.
pub fn halves_correlation(frame: &Frame) -> Option<f64> {
    let mut signs = SignCorrelation::default();
    let (height, width) = (frame.height(), frame.width());
    for c in 0..3 {
        for y in (1..height.saturating_sub(1)).step_by(row_step(height, width)) {
            for x in 1..width.saturating_sub(1) {
                let a = second_difference(&frame.a.radiance, &frame.a.denoised, c, y, x);
                let b = second_difference(&frame.b.radiance, &frame.b.denoised, c, y, x);
                signs.add(a, b);
            }
        }
    }
    signs.correlation()
}

fn row_step(height: usize, width: usize) -> usize {
    (height * width / MOST_PIXELS).max(1)
}

fn second_difference(y: &Image, z: &Image, c: usize, row: usize, column: usize) -> f32 {
    let mut sum = 0.0;
    for (dy, wy) in [(0, 1.0), (1, -2.0), (2, 1.0)] {
        for (dx, wx) in [(0, 1.0), (1, -2.0), (2, 1.0)] {
            let (row, column) = (row + dy - 1, column + dx - 1);
            sum += wy * wx * (y.at(c, row, column) - z.at(c, row, column));
        }
    }
    sum
}

/// Correlation of `a - b` between horizontally and vertically neighbouring pixels, from signs. The scene itself
/// cancels in the difference. `None` when too few pixels differ.
pub fn neighbour_correlation(a: &Image, b: &Image) -> Option<f64> {
    let difference = |c, y, x| a.at(c, y, x) - b.at(c, y, x);
    let mut signs = SignCorrelation::default();
    for c in 0..a.channels() {
        for y in (0..a.height()).step_by(row_step(a.height(), a.width())) {
            for x in 0..a.width() {
                let here = difference(c, y, x);
                if x + 1 < a.width() {
                    signs.add(here, difference(c, y, x + 1));
                }
                if y + 1 < a.height() {
                    signs.add(here, difference(c, y + 1, x));
                }
            }
        }
    }
    signs.correlation()
}

/// Quadrant correlation: for a bivariate normal, P(same sign) = 1/2 + asin(r)/π (Sheppard 1899).
#[derive(Default)]
struct SignCorrelation {
    same: u64,
    total: u64,
}

impl SignCorrelation {
    fn add(&mut self, a: f32, b: f32) {
        let product = f64::from(a) * f64::from(b);
        if product.is_finite() && product != 0.0 {
            self.total += 1;
            self.same += u64::from(product > 0.0);
        }
    }

    fn correlation(&self) -> Option<f64> {
        let enough = self.total >= FEWEST_SAMPLES;
        enough.then(|| (FRAC_PI_2 * (2.0 * self.same as f64 / self.total as f64 - 1.0)).sin())
    }
}
