//! The halves of passes averaged by the weights of g_c, which were fitted to the picture that they are parts of.

use crate::corrector::PictureCorrection;
use crate::plan::Plan;
use crate::prepare::{Guides, Prepared};
use crate::threads::at_once;
use crate::tiles::{ParameterSource, parameters};
use sspc_image::Image;
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};
use std::ops::Range;

/// Radius of the small window: details that the passes of both halves agree on.
const SMALL_RADIUS: usize = 3;
/// Rows that are averaged at a time: parameters and planes of more are not held.
const ROWS_AT_ONCE: usize = 128;
/// Radiance is kept from leaving f32 when it is squared.
const LARGEST: f32 = 1e15;

/// Pictures of one pass, of half a and of half b, in the method's units.
pub(super) struct Candidates {
    /// Noisy; where it is missing, as the whole window.
    pub noisy: [Image; 2],
    /// Averaged over g_c's window; noisy where nothing is computed.
    pub whole: [Image; 2],
    /// Averaged over the small window.
    pub small: [Image; 2],
    /// 1 where the pass counts in both halves, 0 where it is missing, `[1, H, W]`.
    pub valid: Image,
}

pub(super) struct Filter<'a> {
    pub isa: Isa,
    pub form: Form,
    pub taps: &'a Taps,
}

/// The passes of one half, averaged over the whole window and over the small one, `[window][pass]`.
type Averaged = [Vec<Image>; 2];

impl Filter<'_> {
    /// The candidates of every pass of a band, by its halves: the mean over the networks, each with weights of its own.
    pub fn run<S: ParameterSource + ?Sized>(
        &self,
        prepared: &Prepared,
        source: &S,
        computed: &Plan,
        passes: Vec<[Image; 2]>,
    ) -> Result<Vec<Candidates>, S::Error> {
        let valid = validity(prepared, &passes);
        let mut noisy = [Vec::new(), Vec::new()];
        for halves in passes {
            for (noisy, half) in noisy.iter_mut().zip(halves) {
                noisy.push(in_units(half, prepared.exposure, &valid));
            }
        }
        let mut averaged: [Averaged; 2] = noisy.each_ref().map(|noisy| [noisy.clone(), noisy.clone()]);
        for k in 0..prepared.networks() {
            let of_network = prepared.of_variant(k);
            for top in (0..prepared.height()).step_by(ROWS_AT_ONCE) {
                let rows = top..(top + ROWS_AT_ONCE).min(prepared.height());
                let plan = computed.of_rows(rows.clone());
                for h in (0..2).filter(|_| !plan.is_idle()) {
                    let parameters = parameters(source, k, &of_network.halves[h], computed, rows.clone())?;
                    let strip =
                        Strip { prepared: &of_network, h, rows: rows.clone(), plan: &plan, parameters: &parameters };
                    self.average(&strip, &valid, &noisy[h], (k, prepared.networks()), &mut averaged[h]);
                }
            }
        }
        let [a, b] = averaged;
        let [[whole_a, small_a], [whole_b, small_b]] = [a, b];
        let [noisy_a, noisy_b] = noisy;
        let both = |a: Vec<Image>, b: Vec<Image>| a.into_iter().zip(b).map(|(a, b)| [a, b]);
        let all = both(noisy_a, noisy_b).zip(both(whole_a, whole_b)).zip(both(small_a, small_b));
        let candidates = |((mut noisy, whole), small): (([Image; 2], [Image; 2]), [Image; 2])| {
            noisy.iter_mut().zip(&whole).for_each(|(noisy, whole)| fill_missing(noisy, whole, &valid));
            Candidates { noisy, whole, small, valid: valid.clone() }
        };
        Ok(all.map(candidates).collect())
    }

    /// Puts the means of a strip in their place, as the part of network `k` of `networks`.
    fn average(
        &self,
        strip: &Strip,
        valid: &Image,
        noisy: &[Image],
        (k, networks): (usize, usize),
        averaged: &mut Averaged,
    ) {
        let Strip { prepared, h, rows, plan, parameters } = strip;
        let (size, radius) = ((prepared.height(), prepared.width()), self.taps.radius());
        let whole = 0..prepared.width();
        let features =
            |c: usize, y: usize, row: &mut [f32]| prepared.features(*h, Guides::Full, c, y, whole.clone(), row);
        let mask = valid.plane(0).contains(&0.0).then_some(valid);
        let windows = Windows::of_rows(size, rows.clone(), features, mask, prepared.set, radius);
        let planes_of = |(pass, image): (usize, &Image)| (0..image.channels()).map(move |c| (pass, c));
        let planes: Vec<(usize, usize)> = noisy.iter().enumerate().flat_map(planes_of).collect();
        let fill = |plane: usize, y: usize, row: &mut [f32]| {
            let (pass, c) = planes[plane];
            row.copy_from_slice(noisy[pass].row(c, y));
        };
        let padded = PaddedPlanes::of_rows(size, rows.clone(), planes.len(), fill, radius);
        let small = Taps::square(SMALL_RADIUS.min(radius));
        for (taps, averaged) in [self.taps, &small].into_iter().zip(averaged) {
            let runs = plan.runs();
            let of = PictureCorrection::of_one(self.isa, self.form, &windows, taps, parameters, &runs);
            let of = PictureCorrection { parts: at_once(), ..of };
            for (region, values) in of.means(&padded) {
                for (values, (pass, c)) in values.chunks_exact(region.pixels()).zip(&planes) {
                    let plane = averaged[*pass].plane_mut(*c);
                    for (y, values) in values.chunks_exact(region.width).enumerate() {
                        let at = (rows.start + region.top + y) * prepared.width() + region.left;
                        for (sum, value) in plane[at..at + region.width].iter_mut().zip(values) {
                            let value = value / networks as f32;
                            // The first network's take the place of the noisy values.
                            *sum = if k == 0 { value } else { *sum + value };
                        }
                    }
                }
            }
        }
    }
}

/// Rows of a half that are averaged at a time.
struct Strip<'a> {
    prepared: &'a Prepared,
    h: usize,
    rows: Range<usize>,
    /// Of the rows alone.
    plan: &'a Plan,
    parameters: &'a Image,
}

/// Gives missing pixels the values of the whole window.
fn fill_missing(noisy: &mut Image, whole: &Image, valid: &Image) {
    noisy.for_each_row(|c, y, row| {
        for ((value, whole), valid) in row.iter_mut().zip(whole.row(c, y)).zip(valid.row(0, y)) {
            *value = if *valid == 0.0 { *whole } else { *value };
        }
    });
}

/// Where the picture's pixels and those of all passes are there.
fn validity(prepared: &Prepared, passes: &[[Image; 2]]) -> Image {
    Image::from_rows(1, prepared.height(), prepared.width(), |_, y, row| {
        match &prepared.valid {
            Some(valid) => row.copy_from_slice(valid.row(0, y)),
            None => row.fill(1.0),
        }
        for half in passes.iter().flatten() {
            for c in 0..half.channels() {
                for (valid, value) in row.iter_mut().zip(half.row(c, y)) {
                    *valid = if value.is_finite() { *valid } else { 0.0 };
                }
            }
        }
    })
}

/// A pass in the method's units, of either sign; 0 where it is missing.
fn in_units(mut pass: Image, exposure: f32, valid: &Image) -> Image {
    pass.for_each_row(|_, y, row| {
        for (value, valid) in row.iter_mut().zip(valid.row(0, y)) {
            *value = if *valid != 0.0 { (*value * exposure).clamp(-LARGEST, LARGEST) } else { 0.0 };
        }
    });
    pass
}
