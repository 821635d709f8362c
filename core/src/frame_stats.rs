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
    let is_finite = |image: &&Image| image.data().par_iter().all(|value| value.is_finite());
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
            Exposure::Normalised => add_pixels(band, &valid, mean_of_pixel, &mut self.means),
            Exposure::OfNoise => add_pixels(band, &valid, noise_of_pixel, &mut self.noisy_pixels),
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
            let negative: usize =
                planes.map(|row| row.iter().zip(valid).filter(|(v, ok)| **v < 0.0 && **ok != 0.0).count()).sum();
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
        let exposure = match self.exposure {
            Exposure::AsIs => 1.0,
            Exposure::Normalised => exposure::of_all(self.means),
            Exposure::OfNoise => exposure::of_noisy(&self.noisy_pixels),
        };
        let independence = self.independence.finish();
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

/// Three channels of a row of each half.
type RowPair<'a> = [(&'a [f32], &'a [f32]); 3];

/// Adds what `of_pixel` says of each valid pixel's z and y, row after row.
fn add_pixels<T: Copy + Send>(
    band: &Frame,
    valid: &Image,
    of_pixel: fn(&RowPair, &RowPair, usize) -> Option<T>,
    out: &mut Vec<T>,
) {
    let of_row = |y: usize| -> Vec<T> {
        let z: RowPair = std::array::from_fn(|c| (band.a.denoised.row(c, y), band.b.denoised.row(c, y)));
        let radiance: RowPair = std::array::from_fn(|c| (band.a.radiance.row(c, y), band.b.radiance.row(c, y)));
        let valid = valid.row(0, y);
        (0..valid.len()).filter(|&x| valid[x] != 0.0).filter_map(|x| of_pixel(&z, &radiance, x)).collect()
    };
    // In turns, so that few rows are held twice.
    for top in (0..band.height()).step_by(64) {
        let rows: Vec<Vec<T>> = (top..(top + 64).min(band.height())).into_par_iter().map(of_row).collect();
        rows.iter().for_each(|row| out.extend_from_slice(row));
    }
}

/// z̄ of a pixel, both halves' mean, where it is positive.
fn mean_of_pixel(z: &RowPair, _: &RowPair, x: usize) -> Option<f64> {
    let mean = z.iter().map(|(a, b)| f64::from(a[x].max(0.0)) + f64::from(b[x].max(0.0))).sum::<f64>() / 6.0;
    (mean > 0.0).then_some(mean)
}

/// The same with the pixel's noise.
fn noise_of_pixel(z: &RowPair, radiance: &RowPair, x: usize) -> Option<NoisyPixel> {
    let mean = mean_of_pixel(z, radiance, x)? as f32;
    let apart = radiance.iter().map(|(a, b)| (a[x].max(0.0) - b[x].max(0.0)).abs()).sum::<f32>() / 3.0;
    Some(NoisyPixel { mean, noise: apart.min(mean) })
}
