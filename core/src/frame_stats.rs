//! What is decided once for a whole frame, however it is cut afterwards: exposure, the features in use, and what is
//! unusual. A frame may come whole or in bands of rows; both give the same bits.

use crate::exposure::{self, NoisyPixel};
use crate::independence::{Independence, IndependenceCollector};
use crate::trust::{SAMPLES_DIFFER, Trust};
use rayon::prelude::*;
use sspc_image::{Frame, Image, Role};
use sspc_kernels::features::FeatureSet;

/// Rows that one thread looks at, at a time.
const ROWS_PER_JOB: usize = 8;
/// The same of values.
const VALUES_PER_JOB: usize = 1 << 14;

/// Whether radiance is brought to the method's scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Exposure {
    /// As in the paper: values as they are.
    AsIs,
    /// One factor for both halves, from all finite pixels of the denoised images.
    Normalised,
    /// The same, from the pixels that have noise to mend.
    OfNoise,
}

/// Unusual pixels and features.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Findings {
    /// Features that are there, but at no pixel finite in both halves: they count as absent.
    pub unusable: FeatureSet,
    /// Pixels with NaN or Inf in a colour.
    pub missing_pixels: usize,
    /// Pixels with NaN or Inf in a feature that is usable elsewhere: it is missing there, and only there.
    pub pixels_without_feature: usize,
    /// Negative colour values: noisy ones count as they are, the denoiser's are 0 to the method and stay in the picture.
    pub negative_values: usize,
}

impl Findings {
    /// What a person should know, a line each.
    pub fn notes(&self) -> Vec<String> {
        let Findings { pixels_without_feature, negative_values, .. } = self;
        let mut notes = Vec::new();
        if *pixels_without_feature > 0 {
            notes.push(format!(
                "{pixels_without_feature} pixels have no finite albedo, normal or visibility: colour alone guides there"
            ));
        }
        if *negative_values > 0 {
            notes.push(format!(
                "{negative_values} colour values are negative: where the denoiser's is, the picture keeps it"
            ));
        }
        notes
    }
}

/// The decisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameStats {
    /// Radiance in the file's units times this is radiance in the method's units.
    pub exposure: f32,
    /// Features that are there and not constant.
    pub set: FeatureSet,
    /// Whether some pixel's radiance is not the same in both halves, so that there is anything to correct.
    pub noisy: bool,
    /// Unusual pixels and features.
    pub found: Findings,
    /// What the halves say of each other.
    pub independence: Independence,
}

impl FrameStats {
    /// Statistics of a whole frame.
    pub fn of(frame: &Frame, exposure: Exposure) -> Self {
        let mut collector = Collector::new(frame.height() * frame.width(), exposure, unusable_features(frame));
        collector.look(frame);
        collector.finish()
    }

    /// Statistics of a frame delivered in bands: `bands` hands each row once to its argument. It is called a second time
    /// for frames with features that are nowhere finite.
    ///
    /// # Errors
    /// What `bands` fails with.
    pub fn of_bands<E>(
        pixels: usize,
        exposure: Exposure,
        mut bands: impl FnMut(&mut dyn FnMut(&Frame)) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut collector = Collector::new(pixels, exposure, FeatureSet::NONE);
        let (mut there, mut usable) = (FeatureSet::NONE, FeatureSet::NONE);
        bands(&mut |band| {
            there = there.union(present_features(band));
            usable = usable.union(usable_features(band));
            collector.look(band);
        })?;
        let unusable = there.without(usable);
        if unusable != FeatureSet::NONE {
            collector = Collector::new(pixels, exposure, unusable);
            bands(&mut |band| collector.look(band))?;
        }
        Ok(collector.finish())
    }

    /// What to do where the noise of halves whose samples nobody names differs as if they had not equally many.
    pub fn note_on_samples(&self, are_known: bool) -> Option<String> {
        let ratio = 1.0 / self.independence.noise_ratio;
        let differs = ratio.max(1.0 / ratio) >= SAMPLES_DIFFER && self.trust() == Trust::Independent;
        (differs && !are_known).then(|| {
            format!(
                "by their noise half a has about {ratio:.1} times the samples of half b, and they are taken as equal: name them with \
                 --samples-a and --samples-b"
            )
        })
    }

    /// The same with only those features that a model was `fitted` with: weights of others were
    /// never trained.
    pub fn with_features_of(self, fitted: FeatureSet) -> Self {
        Self { set: self.set.intersection(fitted), ..self }
    }
}

/// Features of which no pixel is finite in both halves: they count as absent.
pub fn unusable_features(frame: &Frame) -> FeatureSet {
    present_features(frame).without(usable_features(frame))
}

/// Features that either half has.
pub(crate) fn present_features(frame: &Frame) -> FeatureSet {
    FeatureSet::of(|feature| frame.has(feature))
}

/// Features of which some pixel is finite wherever they are.
pub(crate) fn usable_features(frame: &Frame) -> FeatureSet {
    FeatureSet::of(|feature| frame.has_finite(feature))
}

/// 1 where a pixel counts, 0 where a colour holds NaN or Inf, `[1, H, W]`.
pub(crate) fn validity(frame: &Frame) -> Image {
    finite_everywhere(&colours(frame).collect::<Vec<_>>(), frame.height(), frame.width())
}

/// 1 where a feature is finite in both halves, 0 where it is missing, `[1, H, W]`; `None` where it is missing nowhere.
pub(crate) fn presence(frame: &Frame, feature: Role) -> Option<Image> {
    let images: Vec<&Image> = [&frame.a, &frame.b].into_iter().filter_map(|half| half.feature(feature)).collect();
    let of_run = |values: &[f32]| values.iter().fold(true, |finite, value| finite & value.is_finite());
    let is_finite = |image: &&Image| image.data().par_chunks(VALUES_PER_JOB).all(of_run);
    (!images.iter().all(is_finite)).then(|| finite_everywhere(&images, frame.height(), frame.width()))
}

fn finite_everywhere(deciding: &[&Image], height: usize, width: usize) -> Image {
    Image::from_rows(1, height, width, |_, y, row| {
        row.fill(1.0);
        for source in deciding.iter().flat_map(|image| (0..image.channels()).map(|c| image.row(c, y))) {
            for (v, x) in row.iter_mut().zip(source) {
                *v = if x.is_finite() { *v } else { 0.0 };
            }
        }
    })
}

/// Radiance and denoised pictures.
fn colours(frame: &Frame) -> impl Iterator<Item = &Image> {
    [&frame.a, &frame.b].into_iter().flat_map(|h| [&h.radiance, &h.denoised]).chain(&frame.denoised)
}

/// Statistics of a frame in the making.
struct Collector {
    exposure: Exposure,
    /// Positive z̄ of valid pixels, both halves' mean, row after row, for the rule that needs no more.
    means: Vec<f64>,
    /// The same with the noise.
    noisy_pixels: Vec<NoisyPixel>,
    /// Albedo, normal, visibility.
    features: [Variation; 3],
    noisy: bool,
    found: Findings,
    independence: IndependenceCollector,
}

/// Whether a feature has more than one value.
#[derive(Default)]
struct Variation {
    /// The first valid value of each channel.
    first: Vec<Option<f32>>,
    varies: bool,
}

impl Collector {
    fn new(pixels: usize, exposure: Exposure, unusable: FeatureSet) -> Self {
        let room_for = |rule| if exposure == rule { pixels } else { 0 };
        let (means, noisy_pixels) =
            (Vec::with_capacity(room_for(Exposure::Normalised)), Vec::with_capacity(room_for(Exposure::OfNoise)));
        let found = Findings { unusable, ..Findings::default() };
        let (features, independence) = (Default::default(), IndependenceCollector::new(pixels));
        Self { exposure, means, noisy_pixels, features, noisy: false, found, independence }
    }

    /// Looks at the next band below.
    fn look(&mut self, band: &Frame) {
        let valid = validity(band);
        match self.exposure {
            Exposure::AsIs => {}
            Exposure::Normalised => add_pixels(band, &valid, |mean, _| mean, &mut self.means),
            Exposure::OfNoise => {
                add_pixels(band, &valid, |mean, noise| NoisyPixel { mean: mean as f32, noise }, &mut self.noisy_pixels)
            }
        }
        self.independence.look(band, &valid);
        for (variation, feature) in self.features.iter_mut().zip(Role::FEATURES) {
            if let (Some(a), Some(b)) = (band.a.feature(feature), band.b.feature(feature)) {
                variation.look(a, b, &valid);
            }
        }
        self.noisy = self.noisy || (0..band.height()).any(|y| noisy_row(band, valid.row(0, y), y));
        let rows = (0..band.height()).into_par_iter().with_min_len(ROWS_PER_JOB);
        let counts = rows.map(|y| {
            let valid = valid.row(0, y);
            let planes = colours(band).flat_map(|image| (0..image.channels()).map(move |c| image.row(c, y)));
            let negative_in =
                |row: &[f32]| row.iter().zip(valid).map(|(v, ok)| u32::from((*v < 0.0) & (*ok != 0.0))).sum::<u32>();
            let negative = planes.map(|row| negative_in(row) as usize).sum();
            (valid.iter().filter(|v| **v == 0.0).count(), negative)
        });
        let (missing, negative) = counts.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        self.found.missing_pixels += missing;
        self.found.pixels_without_feature += without_feature(band, self.found.unusable);
        self.found.negative_values += negative;
    }

    fn finish(self) -> FrameStats {
        let unusable = self.found.unusable;
        let [albedo, normal, visibility] = self.features.map(|variation| variation.varies);
        let set = FeatureSet { albedo, normal, visibility }.without(unusable);
        let exposure = || match self.exposure {
            Exposure::AsIs => 1.0,
            Exposure::Normalised => exposure::of_all(&self.means),
            Exposure::OfNoise => exposure::of_noisy(&self.noisy_pixels),
        };
        let (exposure, independence) = rayon::join(exposure, || self.independence.finish());
        FrameStats { exposure, set, noisy: self.noisy, found: self.found, independence }
    }
}

/// Pixels at which a usable feature is missing.
fn without_feature(band: &Frame, unusable: FeatureSet) -> usize {
    let present: Vec<Image> =
        FeatureSet::ALL.without(unusable).iter().filter_map(|feature| presence(band, feature)).collect();
    let is_missing = |i: &usize| present.iter().any(|image| image.plane(0)[*i] == 0.0);
    if present.is_empty() { 0 } else { (0..band.height() * band.width()).filter(is_missing).count() }
}

/// Whether a valid pixel of row `y` has another radiance in the other half.
fn noisy_row(band: &Frame, valid: &[f32], y: usize) -> bool {
    (0..3).any(|c| {
        let pairs = band.a.radiance.row(c, y).iter().zip(band.b.radiance.row(c, y)).zip(valid);
        pairs.into_iter().any(|((a, b), ok)| *ok != 0.0 && a != b)
    })
}

impl Variation {
    fn look(&mut self, a: &Image, b: &Image, valid: &Image) {
        if self.varies {
            return;
        }
        self.first.resize(a.channels(), None);
        for (c, first) in self.first.iter_mut().enumerate() {
            let pixels = (0..a.pixels()).filter(|&i| valid.plane(0)[i] != 0.0);
            for value in pixels.flat_map(|i| [a.plane(c)[i], b.plane(c)[i]]).filter(|value| value.is_finite()) {
                if value != *first.get_or_insert(value) {
                    self.varies = true;
                    return;
                }
            }
        }
    }
}

/// Adds what `of` takes of the brightness and noise of each valid pixel that is not black, row after row.
fn add_pixels<T: Copy + Send>(band: &Frame, valid: &Image, of: impl Fn(f64, f32) -> T + Sync, out: &mut Vec<T>) {
    let of_row = |y: usize| -> Vec<T> {
        let (mean, noise) = brightness_and_noise(band, y);
        let pixels = mean.iter().zip(&noise).zip(valid.row(0, y)).filter(|((mean, _), ok)| **ok != 0.0 && **mean > 0.0);
        pixels.map(|((&mean, &noise), _)| of(mean, noise)).collect()
    };
    // In turns, so that few rows are held twice.
    for top in (0..band.height()).step_by(64) {
        let rows: Vec<Vec<T>> = (top..(top + 64).min(band.height())).into_par_iter().map(of_row).collect();
        rows.iter().for_each(|row| out.extend_from_slice(row));
    }
}

/// z̄, both halves' mean, and the noise, at most that, of every pixel of row `y`.
fn brightness_and_noise(band: &Frame, y: usize) -> (Vec<f64>, Vec<f32>) {
    let width = band.width();
    let (mut mean, mut noise) = (vec![0.0; width], vec![0.0; width]);
    for c in 0..3 {
        let pairs = band.a.denoised.row(c, y).iter().zip(band.b.denoised.row(c, y));
        for (mean, (a, b)) in mean.iter_mut().zip(pairs) {
            *mean += f64::from(a.max(0.0)) + f64::from(b.max(0.0));
        }
        let pairs = band.a.radiance.row(c, y).iter().zip(band.b.radiance.row(c, y));
        for (noise, (a, b)) in noise.iter_mut().zip(pairs) {
            *noise += (a.max(0.0) - b.max(0.0)).abs();
        }
    }
    for (noise, mean) in noise.iter_mut().zip(&mut mean) {
        *mean /= 6.0;
        *noise = (*noise / 3.0).min(*mean as f32);
    }
    (mean, noise)
}
