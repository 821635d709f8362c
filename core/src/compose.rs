//! From parameters to the finished rows of a picture: both halves corrected, weighed against each other, and the
//! correction added to the denoiser's picture where it helps (`blend_weight`).
//!
//! **Full buffer.** The correction that is applied is that of g_c with each half's parameters and y, but z and features
//! of the full buffer: the picture starts from the better z.

use crate::blend_weight::{Evidence, WEIGHT_RADIUS};
use crate::composite::{MIX_RADIUS, mix};
use crate::composition::Composition;
use crate::corrector::{PictureCorrection, view};
use crate::estimate;
use crate::first_or_mean::{Choice, choose};
use crate::frame_sums::FrameSums;
use crate::outlier_limit::{LIMIT_RADIUS, limit_outliers};
use crate::plan::Plan;
use crate::prepare::{Guides, Prepared};
use crate::threads::at_once;
use crate::tiles::{ParameterSource, PictureTile, TileGrid};
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use std::ops::Range;
use std::sync::Mutex;

/// A band of rows, corrected and weighed.
#[derive(Clone, Debug)]
pub struct Band {
    /// Share times correction of the band's rows, in the method's units, `[3, rows, W]`.
    pub correction: Image,
    /// Share of the correction that was used, strength included, 0..1, `[1, rows, W]`.
    pub share: Image,
    /// Mean of both halves by their weights, corrected as far as they judge each other, in the method's units,
    /// `[3, rows, W]`: the picture that the estimate is of.
    pub halves: Image,
    /// Σ over the band's pixels of the weight of the mean over several networks; the first has the rest.
    pub weight_of_mean: f64,
    /// Σ over the band's pixels of the composite's share, where there is one.
    pub weight_of_composite: Option<f64>,
    /// The band's part of what the whole picture is judged by.
    pub sums: FrameSums,
}

/// How a picture is composed.
#[derive(Clone, Copy, Debug)]
pub struct Composer<'a> {
    /// Instruction set of g_c.
    pub isa: Isa,
    /// Form of the parameters.
    pub form: Form,
    /// Window of g_c.
    pub taps: &'a Taps,
    /// What the picture is made of.
    pub composition: Composition,
    /// Share of the weighed correction that is used, 0..1: an artist's choice. At 0 the picture is the denoiser's.
    pub strength: f32,
    /// Whether the parameters are those of a training that left out what [`crate::held_out`] says, of a whole picture:
    /// those pixels judge it then.
    pub judged_by_held_out: bool,
    /// Whether frames bring a composite of their passes.
    pub has_composite: bool,
    /// Whether the rows come with differences of y, which reach into the next row.
    pub with_differences: bool,
}

/// Rows that judging by differences adds to what a row depends on: the next one, and the neighbours (two rows, and the one
/// beyond that a difference leads to) that the weight of a difference is measured of.
pub(crate) const DIFFERENCES_REACH: usize = 4;

impl Composer<'_> {
    /// Rows around a band that its finished pixels depend on beyond their parameters: g_c's window, the two box means of
    /// the blend weight (two more of the composite's share) and that of the outlier limit.
    pub fn margin(&self) -> usize {
        let of_differences = if self.with_differences { DIFFERENCES_REACH } else { 0 };
        match self.composition {
            Composition::MeanOfHalves => self.taps.radius() + of_differences,
            Composition::JudgedFullBuffer => {
                let of_mix = if self.has_composite { 2 * MIX_RADIUS } else { 0 };
                self.taps.radius() + of_mix + 2 * WEIGHT_RADIUS + LIMIT_RADIUS + of_differences
            }
        }
    }

    /// Corrects both halves and finishes some rows of a picture, or of a band of it that has [`Self::margin`] rows and
    /// the network's radius above and below them wherever the picture has. Rows and band start at multiples of
    /// [`estimate::BLOCK`], so that a band's blocks are the picture's. Parameters are computed when they are needed and
    /// forgotten again.
    ///
    /// # Errors
    /// What the source of the parameters fails with.
    pub fn rows<S: ParameterSource + ?Sized>(
        &self,
        prepared: &Prepared,
        source: &S,
        rows: Range<usize>,
    ) -> Result<Band, S::Error> {
        let Corrections { halves, mut picture, choice, mixed } = self.corrections(prepared, source, &rows)?;
        let mut sums = FrameSums::default();
        let sum = |of: &Image| rows.clone().flat_map(|y| of.row(0, y)).map(|&t| f64::from(t)).sum::<f64>();
        let weight_of_composite = mixed.as_ref().map(sum);
        let weight_of_mean = choice.as_ref().map_or((rows.len() * prepared.width()) as f64, |choice| sum(&choice.mean));
        let mut share = match self.composition {
            Composition::MeanOfHalves => Image::filled(1, picture.height(), picture.width(), 1.0),
            Composition::JudgedFullBuffer => {
                let evidence = || Evidence::of(prepared, &halves);
                if self.judged_by_held_out {
                    let share = self.weaken(evidence().without_held_out().share());
                    sums.held_out_gain = Some(estimate::held_out_gain(prepared, &halves, &share));
                }
                // A choice among networks knows nothing of the composite.
                let chosen = choice.filter(|_| prepared.composite.is_none());
                chosen.map_or_else(|| evidence().share(), |choice| choice.share)
            }
        };
        if self.composition == Composition::JudgedFullBuffer {
            limit_outliers(prepared, &halves, &mut share, &mut picture);
        }
        share = self.weaken(share);
        keep_shares(prepared, &mut picture, &share);
        sums = FrameSums {
            held_out_gain: sums.held_out_gain,
            ..FrameSums::of(prepared, &halves, &share, &picture, rows.clone())
        };
        let [mut halves, b] = halves;
        blend(prepared, &mut halves, &b, &share);
        let only = |image: Image| match rows.len() == image.height() {
            true => image,
            false => image.crop(rows.start, 0, rows.len(), image.width()),
        };
        let [correction, share, halves] = [picture, share, halves].map(only);
        Ok(Band { correction, share, halves, weight_of_mean, weight_of_composite, sums })
    }

    /// A share of the whole correction, strength included.
    fn weaken(&self, mut share: Image) -> Image {
        share.for_each_row(|_, _, row| row.iter_mut().for_each(|s| *s *= self.strength));
        share
    }

    /// Corrects what `rows` depend on: the mean over the networks, each on its own variant of z, or the first's; mixed with the
    /// composite of passes where there is one.
    fn corrections<S: ParameterSource + ?Sized>(
        &self,
        prepared: &Prepared,
        source: &S,
        rows: &Range<usize>,
    ) -> Result<Corrections, S::Error> {
        let networks = prepared.networks();
        assert_eq!(networks, source.networks(), "a network for each variant of z");
        let weighed = prepared.plan.within_rows(self.weighed_rows(rows, prepared.height()));
        let first = self.corrections_of(0, prepared, source, rows, &weighed)?;
        let mut corrections = match prepared.variants.is_empty() {
            true => first,
            false => self.mean_over_networks(first, prepared, source, rows, &weighed)?,
        };
        if let (Some(composite), Composition::JudgedFullBuffer) = (&prepared.composite, self.composition) {
            let Corrections { halves, picture, mixed, .. } = &mut corrections;
            *mixed = Some(mix(prepared, composite, halves, picture));
            corrections.keep_denoised(prepared, &weighed);
        }
        Ok(corrections)
    }

    /// The mean over the networks, of which the `first` was computed, or that one where the halves say so.
    fn mean_over_networks<S: ParameterSource + ?Sized>(
        &self,
        first: Corrections,
        prepared: &Prepared,
        source: &S,
        rows: &Range<usize>,
        weighed: &Plan,
    ) -> Result<Corrections, S::Error> {
        let networks = prepared.networks();
        let mut mean = first.clone();
        for k in 1..networks {
            let of_variant = self.corrections_of(k, prepared, source, rows, weighed)?;
            mean.add(&of_variant);
        }
        mean.divide(networks);
        mean.keep_denoised(prepared, weighed);
        if self.composition == Composition::JudgedFullBuffer {
            let choice = choose(prepared, &first.halves, &mean.halves);
            mean.mix(&first, &choice.mean);
            mean.choice = Some(choice);
        }
        Ok(mean)
    }

    /// The same by network `k` alone.
    fn corrections_of<S: ParameterSource + ?Sized>(
        &self,
        k: usize,
        prepared: &Prepared,
        source: &S,
        rows: &Range<usize>,
        weighed: &Plan,
    ) -> Result<Corrections, S::Error> {
        let prepared = &*prepared.of_variant(k);
        let height = prepared.height();
        let finished = prepared.plan.within_rows(self.limited_rows(rows, height));
        let grid = TileGrid::new(height, prepared.width(), source.tile(), source.shape().radius());
        let tiles = grid.tiles_of_rows(0..height);
        let parts = parts_of_gc(tiles.len(), at_once());
        let is_full = self.composition == Composition::JudgedFullBuffer;
        let pictures = TiledPictures::new(height, prepared.width(), if is_full { 3 } else { 2 });
        tiles.into_par_iter().try_for_each(|tile| {
            let runs = [weighed, &finished].map(|plan| plan.runs_in(&tile.region));
            let ([a, b], of_full) = match weighed.touches(&tile.region) {
                true => self.tile(prepared, source, k, &tile, &runs, parts)?,
                false => ([0, 1].map(|h| colours_of(&prepared.halves[h], DENOISED, &tile.region)), None),
            };
            let of_full = is_full.then(|| {
                let mut picture = colours_of(&prepared.denoised, 0, &tile.region);
                of_full.iter().for_each(|of_full| put_runs(&mut picture, of_full, &runs[1]));
                picture
            });
            pictures.put(&tile.region, &[a, b].into_iter().chain(of_full).collect::<Vec<_>>());
            Ok(())
        })?;
        let mut pictures = pictures.into_images().into_iter();
        let mut next = || pictures.next().expect("a picture of each half");
        let halves = [next(), next()];
        let picture = pictures.next().unwrap_or_else(|| prepared.weights.mean_of(&halves[0], &halves[1]));
        Ok(Corrections { halves, picture, choice: None, mixed: None })
    }

    /// The pixels of a tile by network `k`, `[3, rows, columns]`: both halves by their own guides, and where the picture is made of
    /// it, the mean of both by those of the full buffer. `runs` are what is computed of either.
    fn tile<S: ParameterSource + ?Sized>(
        &self,
        prepared: &Prepared,
        source: &S,
        k: usize,
        tile: &PictureTile,
        runs: &[Vec<Region>; 2],
        parts: usize,
    ) -> Result<([Image; 2], Option<Image>), S::Error> {
        let Self { isa, form, taps, .. } = *self;
        let of_half = |h: usize| {
            let windows = prepared.windows(h, Guides::Half, tile.region, taps.radius());
            tile.parameters(source, k, &prepared.halves[h]).map(|parameters| (windows, parameters))
        };
        let (a, b) = rayon::join(|| of_half(0), || of_half(1));
        let ((windows_a, of_a), (windows_b, of_b)) = (a?, b?);
        let corrected = |views, runs: &[Region]| PictureCorrection { isa, views, taps, runs, parts }.corrected();
        let [own, full] = runs;
        let own_views = [view(form, &windows_a, &windows_a, &of_a), view(form, &windows_b, &windows_b, &of_b)];
        let of_own = |at: usize| corrected(vec![own_views[at]], own).remove(0);
        if self.composition != Composition::JudgedFullBuffer || full.is_empty() {
            let (a, b) = rayon::join(|| of_own(0), || of_own(1));
            return Ok(([a, b], None));
        }
        let guides = prepared.windows(0, Guides::Full, tile.region, taps.radius());
        let full_views = [view(form, &windows_a, &guides, &of_a), view(form, &windows_b, &guides, &of_b)];
        let mean = |a, b| Some(prepared.weights.mean_of(a, b));
        if own == full {
            // Neighbours share radiance or guides.
            let views = vec![own_views[0], full_views[0], full_views[1], own_views[1]];
            let mut pictures = corrected(views, own).into_iter();
            let mut next = || pictures.next().expect("a picture of every view");
            let (a, full_a, full_b, b) = (next(), next(), next(), next());
            return Ok(([a, b], mean(&full_a, &full_b)));
        }
        let halves = || rayon::join(|| of_own(0), || of_own(1));
        let ((a, b), of_full) = rayon::join(halves, || corrected(full_views.to_vec(), full));
        Ok(([a, b], mean(&of_full[0], &of_full[1])))
    }

    /// The rows of the picture that `rows` of it depend on.
    fn limited_rows(&self, rows: &Range<usize>, height: usize) -> Range<usize> {
        match self.composition {
            Composition::MeanOfHalves => rows.clone(),
            Composition::JudgedFullBuffer => {
                rows.start.saturating_sub(LIMIT_RADIUS)..(rows.end + LIMIT_RADIUS).min(height)
            }
        }
    }

    /// The rows whose corrected halves `rows` of a picture of `height` rows depend on.
    fn weighed_rows(&self, rows: &Range<usize>, height: usize) -> Range<usize> {
        let reach = self.margin() - self.taps.radius();
        rows.start.saturating_sub(reach)..(rows.end + reach).min(height)
    }
}

/// Pictures `[3, H, W]` that are put together from tiles: one tile is put in place while the others are computed.
struct TiledPictures(Mutex<Vec<Image>>);

impl TiledPictures {
    fn new(height: usize, width: usize, count: usize) -> Self {
        Self(Mutex::new((0..count).map(|_| Image::zeros(3, height, width)).collect()))
    }

    /// Puts the pixels of a tile into every picture. Nothing is computed behind the lock: a thread that waited for others there
    /// would take up another tile meanwhile, and wait for the lock that it holds.
    fn put(&self, &Region { top, left, .. }: &Region, tiles: &[Image]) {
        let mut pictures = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        pictures.iter_mut().zip(tiles).for_each(|(picture, tile)| picture.put(top, left, tile));
    }

    fn into_images(self) -> Vec<Image> {
        self.0.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

/// Three channels from `first` on of some pixels of an image.
fn colours_of(image: &Image, first: usize, &Region { top, left, height, width }: &Region) -> Image {
    Image::from_rows(3, height, width, |k, y, row| {
        row.copy_from_slice(&image.row(first + k, top + y)[left..left + width]);
    })
}

/// Puts some regions of another picture in their places.
fn put_runs(picture: &mut Image, other: &Image, runs: &[Region]) {
    for (k, run) in (0..3).flat_map(|k| runs.iter().map(move |run| (k, run))) {
        for y in run.top..run.top + run.height {
            let (at, end) = (y * other.width() + run.left, y * other.width() + run.left + run.width);
            picture.plane_mut(k)[at..end].copy_from_slice(&other.plane(k)[at..end]);
        }
    }
}

/// In how many parts at least g_c over one of so many tiles is divided where so many threads can run at once.
pub fn parts_of_gc(tiles: usize, threads: usize) -> usize {
    (2 * threads).div_ceil(tiles.max(1))
}

/// A picture's corrections before they are weighed, `[3, H, W]` each; z where nothing was computed.
#[derive(Clone)]
struct Corrections {
    halves: [Image; 2],
    /// What the picture is made of.
    picture: Image,
    /// How much of them is the mean over several networks.
    choice: Option<Choice>,
    /// How much of them is the composite of passes.
    mixed: Option<Image>,
}

impl Corrections {
    fn images(&mut self) -> [&mut Image; 3] {
        let [a, b] = &mut self.halves;
        [a, b, &mut self.picture]
    }

    fn add(&mut self, other: &Self) {
        let others = [&other.halves[0], &other.halves[1], &other.picture];
        for (sum, other) in self.images().into_iter().zip(others) {
            sum.for_each_row(|c, y, row| row.iter_mut().zip(other.row(c, y)).for_each(|(sum, v)| *sum += v));
        }
    }

    fn divide(&mut self, by: usize) {
        let factor = 1.0 / by as f32;
        self.images()
            .into_iter()
            .for_each(|image| image.for_each_row(|_, _, row| row.iter_mut().for_each(|v| *v *= factor)));
    }

    /// Takes from these as much as `own` says, and the rest from `other`.
    fn mix(&mut self, other: &Self, own: &Image) {
        let others = [&other.halves[0], &other.halves[1], &other.picture];
        for (image, other) in self.images().into_iter().zip(others) {
            image.for_each_row(|c, y, row| {
                for ((v, other), own) in row.iter_mut().zip(other.row(c, y)).zip(own.row(0, y)) {
                    // All of the mean is the mean, bit for bit.
                    *v = if *own == 1.0 { *v } else { other + own * (*v - other) };
                }
            });
        }
    }

    /// Puts z where nothing was computed: the variants' differ from it.
    fn keep_denoised(&mut self, prepared: &Prepared, computed: &Plan) {
        let denoised = [&*prepared.halves[0], &*prepared.halves[1], &prepared.denoised];
        let idle = computed.idle_blocks();
        for (image, z) in self.images().into_iter().zip(denoised) {
            for region in &idle {
                image.put(region.top, region.left, &colours_of(z, z.channels() - 3, region));
            }
        }
    }
}

/// Turns what the picture is made of into the share of its correction that is kept, 0 at missing pixels.
fn keep_shares(prepared: &Prepared, picture: &mut Image, share: &Image) {
    picture.for_each_row(|c, y, row| {
        for ((v, share), z) in row.iter_mut().zip(share.row(0, y)).zip(prepared.denoised.row(c, y)) {
            *v = share * (*v - z);
        }
        for (v, valid) in row.iter_mut().zip(prepared.valid.as_ref().map_or(&[][..], |valid| valid.row(0, y))) {
            *v = if *valid != 0.0 { *v } else { 0.0 };
        }
    });
}

/// Mean of both halves' z + share (μ̂ - z), in the place of the first.
fn blend(prepared: &Prepared, a: &mut Image, b: &Image, share: &Image) {
    a.for_each_row(|k, y, row| {
        let [z_a, z_b] = [0, 1].map(|h| prepared.halves[h].row(DENOISED + k, y));
        let pixels = row.iter_mut().zip(b.row(k, y)).zip(z_a).zip(z_b).zip(share.row(0, y));
        for ((((a, b), z_a), z_b), share) in pixels {
            let (of_a, of_b) = ((z_a + share * (*a - z_a)).max(0.0), (z_b + share * (b - z_b)).max(0.0));
            *a = prepared.weights.mean(of_a, of_b);
        }
    });
}
