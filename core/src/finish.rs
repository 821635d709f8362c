//! From parameters to the finished picture: both halves corrected, judged against each other, and
//! the correction added to the denoiser's picture where it helps ([`crate::judge`]).
//!
//! **Full buffer.** The correction that is applied is that of g_c with each half's parameters and
//! y, but z and features of the full buffer: parameters and y^a never saw y^b, so the reasoning that
//! trained them holds, and the picture starts from the better z.

use crate::corrector::correct;
use crate::estimate::{self, Blocks, Errors, Estimate, Losses};
use crate::judge::{Evidence, JUDGE_RADIUS};
use crate::objective::triple;
use crate::plan::{BLOCK_ROWS, Plan};
use crate::prepare::{Buffer, Prepared, baseline};
use sspc_image::{Frame, Image};
use sspc_kernels::features::DENOISED;
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use std::borrow::Cow;
use std::ops::Range;

/// Rows that are corrected, and rows that are judged, at a time: what is held for them beside the
/// picture does not grow with it. A multiple of the network's windows, of blocks and of
/// [`estimate::BLOCK`]: no block is cut, and sums are the same.
const ROWS_AT_ONCE: usize = 128;
const _: () = assert!(ROWS_AT_ONCE.is_multiple_of(estimate::BLOCK) && ROWS_AT_ONCE.is_multiple_of(BLOCK_ROWS));

/// A finished picture and what the frame itself says of it.
#[derive(Clone, Debug)]
pub struct Finished {
    /// What is added to the denoiser's picture, in the method's units, `[3, H, W]`.
    pub correction: Image,
    /// Share of the correction that was used, strength included, 0..1, `[1, H, W]`.
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

impl Composition {
    /// Whether blocks without noise are left as the denoiser made them: not by the paper.
    pub fn skips_still_blocks(self) -> bool {
        self == Composition::JudgedFullBuffer
    }
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
    /// Share of the correction that was used, strength included, 0..1, `[1, rows, W]`.
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
    error_denoised: Errors,
    error_corrected: Errors,
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
            _ => "nothing is added to the denoiser's picture".to_string(),
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

/// How a picture is finished.
#[derive(Clone, Copy, Debug)]
pub struct Finish<'a> {
    pub isa: Isa,
    pub form: Form,
    pub taps: &'a Taps,
    pub composition: Composition,
    /// Share of the judged correction that is used, 0..1: an artist's choice. At 0 the picture is the
    /// denoiser's.
    pub strength: f32,
}

impl Finish<'_> {
    /// Corrects both halves and finishes the picture, with parameters that are computed when they are
    /// needed and forgotten again: `parameters(h, rows)` gives some rows of half `h`'s, activated,
    /// `[P, rows, W]`.
    pub fn picture(&self, prepared: &Prepared, parameters: impl Fn(usize, Range<usize>) -> Image) -> Finished {
        let work = Work { how: *self, prepared, step: ROWS_AT_ONCE };
        let part = work.finish(&|h, rows| Cow::Owned(parameters(h, rows)), 0..prepared.height());
        finished(part, self.composition, prepared)
    }

    /// The same for some rows of a picture, or of a band of it that has [`margin`] rows above and below
    /// them wherever the picture has, with all parameters `[P, H, W]` given. Rows and band start at
    /// multiples of [`estimate::BLOCK`], so that a band's blocks are the picture's.
    pub fn rows(&self, prepared: &Prepared, parameters: [&Image; 2], rows: Range<usize>) -> Part {
        let work = Work { how: *self, prepared, step: prepared.height() };
        // All rows are asked for at once.
        work.finish(&|h, _| Cow::Borrowed(parameters[h]), rows)
    }
}

/// Finishes a picture whose activated parameters `[P, H, W]` are all there, at full strength; the same
/// bits as [`Finish::picture`].
pub fn finish(
    isa: Isa,
    form: Form,
    taps: &Taps,
    composition: Composition,
    prepared: &Prepared,
    parameters: [&Image; 2],
) -> Finished {
    let how = Finish { isa, form, taps, composition, strength: 1.0 };
    finished(how.rows(prepared, parameters, 0..prepared.height()), composition, prepared)
}

fn finished(part: Part, composition: Composition, prepared: &Prepared) -> Finished {
    let Part { mut correction, mut share, mut halves, tally } = part;
    let Verdict { loss, estimate, fallback, .. } = tally.verdict(composition);
    if fallback.is_some() {
        correction.data_mut().fill(0.0);
        share.data_mut().fill(0.0);
        halves = Image::mean_of(&triple(&prepared.halves[0], DENOISED), &triple(&prepared.halves[1], DENOISED));
    }
    Finished { correction, share, halves, loss, estimate, fallback }
}

/// A picture being finished.
struct Work<'a> {
    how: Finish<'a>,
    prepared: &'a Prepared,
    /// Rows that g_c takes at a time.
    step: usize,
}

/// A picture's corrections before they are judged, `[3, H, W]` each; z where nothing was computed.
struct Corrections {
    halves: [Image; 2],
    /// What the picture is made of.
    picture: Image,
}

impl<'a> Work<'a> {
    fn finish(&self, parameters: &dyn Fn(usize, Range<usize>) -> Cow<'a, Image>, rows: Range<usize>) -> Part {
        let Corrections { mut halves, mut picture } = self.correct(parameters, &rows);
        let mut share = match self.how.composition {
            Composition::MeanOfHalves => Image::filled(1, picture.height(), picture.width(), 1.0),
            Composition::JudgedFullBuffer => Evidence::of(self.prepared, &halves).share(),
        };
        share.for_each_row(|_, _, row| row.iter_mut().for_each(|s| *s *= self.how.strength));
        let mut tally = Tally::default();
        // The results take the place of what they are made of.
        for top in rows.clone().step_by(ROWS_AT_ONCE) {
            let band = top..(top + ROWS_AT_ONCE).min(rows.end);
            let cut = |image: &Image| image.crop(top, 0, band.len(), image.width());
            let [a, b] = &halves;
            let part = settle(&self.prepared.rows(band.clone()), &[cut(a), cut(b)], cut(&picture), cut(&share));
            picture.put_rows(top, &part.correction);
            halves[0].put_rows(top, &part.halves);
            tally.append(part.tally);
        }
        let [halves, _] = halves;
        let only = |image: Image| match rows.len() == image.height() {
            true => image,
            false => image.crop(rows.start, 0, rows.len(), image.width()),
        };
        Part { correction: only(picture), share: only(share), halves: only(halves), tally }
    }

    /// Corrects what `rows` depend on.
    fn correct(&self, parameters: &dyn Fn(usize, Range<usize>) -> Cow<'a, Image>, rows: &Range<usize>) -> Corrections {
        let (prepared, composition) = (self.prepared, self.how.composition);
        let height = prepared.height();
        let judged = prepared.plan.within_rows(judged_rows(composition, rows, height));
        let finished = prepared.plan.within_rows(rows.clone());
        let mut halves = [0, 1].map(|h| triple(&prepared.halves[h], DENOISED));
        let mut full = (composition == Composition::JudgedFullBuffer).then(|| prepared.denoised.clone());
        for top in (0..height).step_by(self.step) {
            let band = top..(top + self.step).min(height);
            let (judged, finished) = (judged.of_rows(band.clone()), finished.of_rows(band.clone()));
            if judged.is_idle() {
                continue;
            }
            let parameters = [0, 1].map(|h| parameters(h, band.clone()));
            let corrected = |h: usize, buffer: Buffer, plan: &Plan| self.band(h, buffer, &parameters[h], plan, &band);
            for (h, half) in halves.iter_mut().enumerate() {
                half.put_rows(top, &corrected(h, Buffer::Half, &judged));
            }
            if let Some(full) = full.as_mut().filter(|_| !finished.is_idle()) {
                let [a, b] = [0, 1].map(|h| corrected(h, Buffer::Full, &finished));
                full.put_rows(top, &Image::mean_of(&a, &b));
            }
        }
        let picture = full.unwrap_or_else(|| Image::mean_of(&halves[0], &halves[1]));
        Corrections { halves, picture }
    }

    /// g_c of some rows of half `h`, `[3, rows, W]`.
    fn band(&self, h: usize, buffer: Buffer, parameters: &Image, plan: &Plan, rows: &Range<usize>) -> Image {
        let Self { how: Finish { isa, form, taps, .. }, prepared, .. } = *self;
        let size = (prepared.height(), prepared.width());
        let fill = |c: usize, y: usize, row: &mut [f32]| prepared.feature_row(h, buffer, c, y, row);
        let valid = prepared.valid.as_ref();
        let windows = Windows::of_rows(size, rows.clone(), fill, valid, prepared.set, taps.radius());
        correct(isa, form, &windows, taps, parameters, plan)
    }
}

/// Judged corrections of some rows by themselves, and what they say of the picture; `picture` is what
/// it is made of.
fn settle(prepared: &Prepared, halves: &[Image; 2], picture: Image, share: Image) -> Part {
    let mut correction = picture;
    correction.for_each_row(|c, y, row| {
        let (share, z) = (share.row(0, y), prepared.denoised.row(c, y));
        for (x, v) in row.iter_mut().enumerate() {
            let kept = if prepared.is_valid(y * share.len() + x) { share[x] } else { 0.0 };
            *v = kept * (*v - z[x]);
        }
    });
    let rows = 0..prepared.height();
    let blended = [0, 1].map(|h| blend(prepared, &halves[h], &share, h));
    let denoised = [0, 1].map(|h| triple(&prepared.halves[h], DENOISED));
    let tally = Tally {
        loss_denoised: estimate::loss(prepared, &denoised, rows.clone()),
        loss_corrected: estimate::loss(prepared, &blended, rows.clone()),
        loss_unjudged: estimate::loss(prepared, halves, rows.clone()),
        gain: estimate::gain(prepared, &denoised, &blended, rows.clone()),
        error_denoised: estimate::estimate(prepared, &denoised, &correction, rows.clone()),
        error_corrected: estimate::estimate(prepared, &blended, &correction, rows),
    };
    Part { correction, share, halves: Image::mean_of(&blended[0], &blended[1]), tally }
}

/// The finished picture in the frame's own units: the denoiser's picture, bit for bit, wherever
/// nothing is added; missing pixels are filled from what is valid.
pub fn picture(frame: &Frame, prepared: &Prepared, finished: &Finished) -> Image {
    let mut out = unfilled_picture(&baseline(frame), prepared.exposure, &finished.correction);
    if prepared.valid.is_some() {
        crate::fill::fill_missing(&mut out, frame);
    }
    out
}

/// A [`baseline`] with a correction `[3, H, W]` added that is in units of `exposure` times its own;
/// missing pixels stay as they are.
pub fn unfilled_picture(baseline: &Image, exposure: f32, correction: &Image) -> Image {
    let inverse = 1.0 / exposure;
    Image::from_rows(3, baseline.height(), baseline.width(), |k, y, row| {
        for ((x, z), c) in row.iter_mut().zip(baseline.row(k, y)).zip(correction.row(k, y)) {
            *x = if *c != 0.0 { (z.max(0.0) + c * inverse).max(0.0) } else { *z };
        }
    })
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
