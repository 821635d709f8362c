//! From parameters to the finished picture: both halves corrected, judged against each other, and
//! the correction added to the denoiser's picture where it helps.
//!
//! **Judging.** With d = μ̂^a - z^a and r = y^b - z^a, E\[r·d\] is the part of the true error that the
//! correction takes away (y^b is unbiased and independent of d), so s = Σ r·d / Σ d², summed with the
//! loss's weights over a neighbourhood and both halves, is the best share of the correction there.
//! Noise of y^b makes the first sum uncertain; the correction is cut back only as far as its sum
//! says by more than one standard error, since the network was already trained not to overdo it.
//!
//! **Full buffer.** The correction that is applied is that of g_c with each half's parameters and
//! y, but z and features of the full buffer: parameters and y^a never saw y^b, so the reasoning that
//! trained them holds, and the picture starts from the better z.

use crate::corrector::correct;
use crate::estimate::{self, Blocks, Estimate, Losses};
use crate::features::{DENOISED, RADIANCE, Windows};
use crate::frame::Frame;
use crate::gc::Taps;
use crate::image::Image;
use crate::objective::{shared_weight, triple};
use crate::parameters::Form;
use crate::plan::Plan;
use crate::prepare::{Buffer, Prepared};
use crate::simd::Isa;
use crate::smooth::box_mean;
use std::ops::Range;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
const JUDGE_RADIUS: usize = 15;
/// Standard errors by which a share must be below 1 before it counts.
const JUDGE_DOUBT: f64 = 1.0;
/// Pixels that two box means of radius R weigh together: their kernel's 1 / Σk².
const JUDGE_SAMPLES: f64 = 2.25 * ((2 * JUDGE_RADIUS + 1) * (2 * JUDGE_RADIUS + 1)) as f64;

/// A finished picture and what the frame itself says of it.
#[derive(Clone, Debug)]
pub struct Finished {
    /// What is added to the denoiser's picture, in the method's units, `[3, H, W]`.
    pub correction: Image,
    /// Share of the correction that was kept, 0..1, `[1, H, W]`.
    pub share: Image,
    /// Mean of both halves, corrected as far as they judge each other, in the method's units,
    /// `[3, H, W]`: the picture that `estimate` is of.
    pub halves: Image,
    /// Self-supervised loss, both halves, whole picture.
    pub loss: Losses,
    /// Estimated relL2, variance term included.
    pub estimate: Estimate,
    /// Why the output is the denoiser's everywhere, if it is.
    pub fallback: Option<String>,
}

/// What the picture is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Composition {
    /// ½ (μ̂^a + μ̂^b), as it is (the paper).
    MeanOfHalves,
    /// The correction of the full buffer's z, as far as the halves' judgement of each other goes.
    JudgedFullBuffer,
}

/// Rows around a band that its finished pixels depend on beyond their parameters: g_c's window and
/// the judge's two box means.
pub fn margin(taps: &Taps, composition: Composition) -> usize {
    match composition {
        Composition::MeanOfHalves => taps.radius(),
        Composition::JudgedFullBuffer => taps.radius() + 2 * JUDGE_RADIUS,
    }
}

/// The rows whose corrected halves, and so whose parameters, `rows` of a picture of `height` rows
/// depend on.
pub fn judged_rows(composition: Composition, rows: &Range<usize>, height: usize) -> Range<usize> {
    match composition {
        Composition::MeanOfHalves => rows.clone(),
        Composition::JudgedFullBuffer => {
            rows.start.saturating_sub(2 * JUDGE_RADIUS)..(rows.end + 2 * JUDGE_RADIUS).min(height)
        }
    }
}

/// A band of rows, corrected and judged.
#[derive(Clone, Debug)]
pub struct Part {
    /// Share times correction of the band's rows, in the method's units, `[3, rows, W]`.
    pub correction: Image,
    /// Share of the correction that was kept, 0..1, `[1, rows, W]`.
    pub share: Image,
    /// As [`Finished::halves`], the band's rows.
    pub halves: Image,
    pub tally: Tally,
}

/// What the whole picture is judged by, summed over bands from top to bottom.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    loss_denoised: Blocks,
    loss_corrected: Blocks,
    loss_unjudged: Blocks,
    gain: Blocks,
    error_denoised: Blocks,
    error_corrected: Blocks,
}

/// The judgement of a whole picture.
#[derive(Clone, Debug)]
pub struct Verdict {
    pub loss: Losses,
    /// Loss of the correction as the model gives it, before any judgement.
    pub model_loss: f64,
    pub estimate: Estimate,
    pub fallback: Option<String>,
}

impl Tally {
    /// Adds the next band below.
    pub fn append(&mut self, next: Tally) {
        self.loss_denoised.append(next.loss_denoised);
        self.loss_corrected.append(next.loss_corrected);
        self.loss_unjudged.append(next.loss_unjudged);
        self.gain.append(next.gain);
        self.error_denoised.append(next.error_denoised);
        self.error_corrected.append(next.error_corrected);
    }

    /// Whether the correction stays, and what the frame says of the error.
    pub fn verdict(&self, composition: Composition) -> Verdict {
        let gain = self.gain.mean();
        // A gain that is not a number is no gain.
        let helps = gain.value > 0.0;
        let fallback = (composition == Composition::JudgedFullBuffer && !helps).then(|| match gain.standard_error {
            Some(error) if gain.value != 0.0 => {
                format!("the self-supervised loss does not fall: gain {:.3e} ± {error:.1e}", gain.value)
            }
            _ => "there is nothing to correct".to_string(),
        });
        let (loss, error) = match fallback {
            Some(_) => (&self.loss_denoised, &self.error_denoised),
            None => (&self.loss_corrected, &self.error_corrected),
        };
        Verdict {
            model_loss: self.loss_unjudged.mean().value,
            loss: Losses { denoised: self.loss_denoised.mean().value, corrected: loss.mean().value },
            estimate: Estimate {
                denoised: self.error_denoised.mean(),
                corrected: error.mean(),
                gain: self.error_denoised.less(error).mean(),
            },
            fallback,
        }
    }
}

/// Corrects both halves with their activated parameters `[P, H, W]` and finishes the picture.
pub fn finish(
    isa: Isa,
    form: Form,
    taps: &Taps,
    composition: Composition,
    prepared: &Prepared,
    parameters: [&Image; 2],
) -> Finished {
    let rows = 0..prepared.height();
    let Part { mut correction, mut share, mut halves, tally } =
        finish_rows(isa, form, taps, composition, prepared, parameters, rows);
    let Verdict { loss, estimate, fallback, .. } = tally.verdict(composition);
    if fallback.is_some() {
        correction.data_mut().fill(0.0);
        share.data_mut().fill(0.0);
        halves = Image::mean_of(&triple(&prepared.halves[0], DENOISED), &triple(&prepared.halves[1], DENOISED));
    }
    Finished { correction, share, halves, loss, estimate, fallback }
}

/// The same for some rows of a picture, or of a band of it that has [`margin`] rows above and below
/// them wherever the picture has. Rows and band start at multiples of [`estimate::BLOCK`], so that a
/// band's blocks are the picture's.
pub fn finish_rows(
    isa: Isa,
    form: Form,
    taps: &Taps,
    composition: Composition,
    prepared: &Prepared,
    parameters: [&Image; 2],
    rows: Range<usize>,
) -> Part {
    let corrected = |h: usize, buffer: Buffer, plan: &Plan| {
        let (height, width) = (prepared.height(), prepared.width());
        let fill = |c: usize, y: usize, row: &mut [f32]| prepared.feature_row(h, buffer, c, y, row);
        let windows = Windows::from_rows(height, width, fill, prepared.valid.as_ref(), prepared.set, taps.radius());
        correct(isa, form, &windows, taps, parameters[h], plan)
    };
    let finished = prepared.plan.within_rows(rows.clone());
    let judged = prepared.plan.within_rows(judged_rows(composition, &rows, prepared.height()));
    let halves: Vec<Image> = (0..2).map(|h| corrected(h, Buffer::Half, &judged)).collect();
    let (mut correction, share) = match composition {
        Composition::MeanOfHalves => {
            (Image::mean_of(&halves[0], &halves[1]), Image::filled(1, prepared.height(), prepared.width(), 1.0))
        }
        Composition::JudgedFullBuffer => {
            let full = [0, 1].map(|h| corrected(h, Buffer::Full, &finished));
            (Image::mean_of(&full[0], &full[1]), Evidence::of(prepared, &halves).share())
        }
    };
    correction.for_each_row(|c, y, row| {
        let (share, z) = (share.row(0, y), prepared.denoised.row(c, y));
        for (x, v) in row.iter_mut().enumerate() {
            let kept = if prepared.is_valid(y * share.len() + x) { share[x] } else { 0.0 };
            *v = kept * (*v - z[x]);
        }
    });
    let blended: Vec<Image> = (0..2).map(|h| blend(prepared, &halves[h], &share, h)).collect();
    let denoised: Vec<Image> = (0..2).map(|h| triple(&prepared.halves[h], DENOISED)).collect();
    let tally = Tally {
        loss_denoised: estimate::loss(prepared, &denoised, rows.clone()),
        loss_corrected: estimate::loss(prepared, &blended, rows.clone()),
        loss_unjudged: estimate::loss(prepared, &halves, rows.clone()),
        gain: estimate::gain(prepared, &denoised, &blended, rows.clone()),
        error_denoised: estimate::estimate(prepared, &denoised, rows.clone()),
        error_corrected: estimate::estimate(prepared, &blended, rows.clone()),
    };
    let crop = |image: &Image| image.crop(rows.start, 0, rows.len(), image.width());
    let halves = crop(&Image::mean_of(&blended[0], &blended[1]));
    Part { correction: crop(&correction), share: crop(&share), halves, tally }
}

/// The finished picture in the frame's own units: the denoiser's picture, bit for bit, wherever
/// nothing is added; missing pixels are filled from what is valid.
pub fn picture(frame: &Frame, prepared: &Prepared, finished: &Finished) -> Image {
    picture_of(frame, prepared.exposure, prepared.valid.is_some(), &finished.correction)
}

/// The same from a correction `[3, H, W]` in units that are `exposure` times the frame's; `missing`
/// says whether there are pixels to fill.
pub fn picture_of(frame: &Frame, exposure: f32, missing: bool, correction: &Image) -> Image {
    let mut out = unfilled_picture(frame, exposure, correction);
    if missing {
        crate::fill::fill_missing(&mut out, frame);
    }
    out
}

/// The same without filling missing pixels: what bands of a picture are put together of.
pub fn unfilled_picture(frame: &Frame, exposure: f32, correction: &Image) -> Image {
    let mean;
    let base = match &frame.denoised {
        Some(full) => full,
        None => {
            mean = Image::mean_of(&frame.a.denoised, &frame.b.denoised);
            &mean
        }
    };
    let inverse = 1.0 / exposure;
    Image::from_rows(3, base.height(), base.width(), |k, y, row| {
        for ((x, z), c) in row.iter_mut().zip(base.row(k, y)).zip(correction.row(k, y)) {
            *x = if *c != 0.0 { (z.max(0.0) + c * inverse).max(0.0) } else { *z };
        }
    })
}

/// Weighted sums by which a correction is judged, per pixel, both halves and all channels.
struct Evidence {
    /// Σ w r·d
    agreement: Image,
    /// Σ w d²
    size: Image,
}

impl Evidence {
    fn of(prepared: &Prepared, halves: &[Image]) -> Self {
        let (height, width) = (prepared.height(), prepared.width());
        let weight = shared_weight(prepared);
        let sum = |of: fn(f32, f32) -> f32| {
            Image::from_rows(1, height, width, |_, y, row| {
                for (h, k) in (0..2).flat_map(|h| (0..3).map(move |k| (h, k))) {
                    let (own, other) = (&prepared.halves[h], &prepared.halves[1 - h]);
                    let (z, target, weight) = (own.row(DENOISED + k, y), other.row(RADIANCE + k, y), weight.row(0, y));
                    let corrected = halves[h].row(k, y);
                    for x in 0..width {
                        let d = corrected[x] - z[x];
                        row[x] += weight[x] * of(target[x] - z[x], d) * d;
                    }
                }
            })
        };
        Self { agreement: sum(|r, _| r), size: sum(|_, d| d) }
    }

    /// min(1, (Σ w r·d + standard error) / Σ w d²), floored at 0.
    fn share(&self) -> Image {
        // Squares of more than this would overflow f32.
        let squared = Image::from_rows(1, self.size.height(), self.size.width(), |_, y, row| {
            row.iter_mut().zip(self.agreement.row(0, y)).for_each(|(s, v)| *s = v.clamp(-1e18, 1e18).powi(2));
        });
        let pool = |image: &Image| box_mean(&box_mean(image, JUDGE_RADIUS), JUDGE_RADIUS);
        let (agreement, size, squared) = (pool(&self.agreement), pool(&self.size), pool(&squared));
        // Share of a pixel's neighbourhood that lies inside the picture, along one side.
        let inside = |i: usize, n: usize| {
            ((i + JUDGE_RADIUS + 1).min(n) - i.saturating_sub(JUDGE_RADIUS)) as f64 / (2 * JUDGE_RADIUS + 1) as f64
        };
        let share = |y: usize, x: usize| {
            let d = f64::from(size.at(0, y, x));
            if d <= 0.0 {
                return 0.0;
            }
            let samples = (JUDGE_SAMPLES * inside(y, size.height()) * inside(x, size.width())).max(1.0);
            let error = (f64::from(squared.at(0, y, x)).max(0.0) / samples).sqrt();
            ((f64::from(agreement.at(0, y, x)) + JUDGE_DOUBT * error) / d).clamp(0.0, 1.0) as f32
        };
        Image::from_rows(1, size.height(), size.width(), |_, y, row| {
            row.iter_mut().enumerate().for_each(|(x, s)| *s = share(y, x));
        })
    }
}

/// z + share (μ̂ - z) of half `h`.
fn blend(prepared: &Prepared, corrected: &Image, share: &Image, h: usize) -> Image {
    Image::from_rows(3, share.height(), share.width(), |k, y, row| {
        let (z, corrected, share) = (prepared.halves[h].row(DENOISED + k, y), corrected.row(k, y), share.row(0, y));
        for (x, out) in row.iter_mut().enumerate() {
            *out = (z[x] + share[x] * (corrected[x] - z[x])).max(0.0);
        }
    })
}
