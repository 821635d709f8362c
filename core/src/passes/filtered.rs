//! The halves of passes averaged by the weights of g_c, which were fitted to the picture that they are parts of.

use super::PassRows;
use crate::corrector::means;
use crate::plan::Plan;
use crate::prepare::{Guides, Prepared};
use crate::tiles::{ParameterSource, parameters};
use sspc_image::Image;
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};

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

impl Filter<'_> {
    /// The candidates of every pass of a band.
    pub fn run<S: ParameterSource + ?Sized>(
        &self,
        prepared: &Prepared,
        source: &S,
        computed: &Plan,
        passes: &[PassRows],
    ) -> Result<Vec<Candidates>, S::Error> {
        let valid = validity(prepared, passes);
        let is_missing = valid.plane(0).contains(&0.0);
        let noisy = [0, 1].map(|h| -> Vec<Image> {
            let of = |pass: &PassRows| in_units(&pass.halves[h], prepared.exposure, &valid);
            passes.iter().map(of).collect()
        });
        let mut averaged = [noisy.clone(), noisy.clone()];
        let networks = prepared.networks();
        for k in 0..networks {
            let of_network = prepared.of_variant(k);
            for top in (0..prepared.height()).step_by(ROWS_AT_ONCE) {
                let rows = top..(top + ROWS_AT_ONCE).min(prepared.height());
                let plan = computed.of_rows(rows.clone());
                if plan.is_idle() {
                    continue;
                }
                for h in 0..2 {
                    let p = parameters(source, k, &of_network.halves[h], computed, rows.clone())?;
                    let size = (prepared.height(), prepared.width());
                    let radius = self.taps.radius();
                    let features =
                        |c: usize, y: usize, row: &mut [f32]| of_network.feature_row(h, Guides::Full, c, y, row);
                    let mask = is_missing.then_some(&valid);
                    let windows = Windows::of_rows(size, rows.clone(), features, mask, prepared.set, radius);
                    let channels: Vec<(usize, usize)> =
                        noisy[h].iter().enumerate().flat_map(|(k, i)| (0..i.channels()).map(move |c| (k, c))).collect();
                    let fill = |c: usize, y: usize, row: &mut [f32]| {
                        let (pass, c) = channels[c];
                        row.copy_from_slice(noisy[h][pass].row(c, y));
                    };
                    let planes = PaddedPlanes::of_rows(size, rows.clone(), channels.len(), fill, radius);
                    let small = Taps::square(SMALL_RADIUS.min(radius));
                    for (taps, averaged) in [self.taps, &small].into_iter().zip(&mut averaged) {
                        let found = means(self.isa, self.form, &windows, &planes, taps, &p, &plan);
                        for (region, values) in found {
                            for (values, (pass, c)) in values.chunks_exact(region.pixels()).zip(&channels) {
                                let plane = averaged[h][*pass].plane_mut(*c);
                                for (y, values) in values.chunks_exact(region.width).enumerate() {
                                    let at = (rows.start + region.top + y) * prepared.width() + region.left;
                                    let row = &mut plane[at..at + region.width];
                                    // The first network's take the place of the noisy values.
                                    for (sum, value) in row.iter_mut().zip(values) {
                                        let value = value / networks as f32;
                                        *sum = if k == 0 { value } else { *sum + value };
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
        let [whole, small] = averaged;
        let both = |[a, b]: [Vec<Image>; 2]| a.into_iter().zip(b).map(|(a, b)| [a, b]);
        let all = both(noisy).zip(both(whole)).zip(both(small));
        Ok(all
            .map(|((mut noisy, whole), small)| {
                for (noisy, whole) in noisy.iter_mut().zip(&whole).filter(|_| is_missing) {
                    noisy.for_each_row(|c, y, row| {
                        let (valid, whole) = (valid.row(0, y), whole.row(c, y));
                        for (x, value) in row.iter_mut().enumerate().filter(|(x, _)| valid[*x] == 0.0) {
                            *value = whole[x];
                        }
                    });
                }
                Candidates { noisy, whole, small, valid: valid.clone() }
            })
            .collect())
    }
}

/// Where the picture's pixels and those of all passes are there.
fn validity(prepared: &Prepared, passes: &[PassRows]) -> Image {
    Image::from_rows(1, prepared.height(), prepared.width(), |_, y, row| {
        match &prepared.valid {
            Some(valid) => row.copy_from_slice(valid.row(0, y)),
            None => row.fill(1.0),
        }
        for half in passes.iter().flat_map(|pass| &pass.halves) {
            for c in 0..half.channels() {
                for (valid, value) in row.iter_mut().zip(half.row(c, y)) {
                    *valid = if value.is_finite() { *valid } else { 0.0 };
                }
            }
        }
    })
}

/// A pass in the method's units, of either sign; 0 where it is missing.
fn in_units(pass: &Image, exposure: f32, valid: &Image) -> Image {
    Image::from_rows(pass.channels(), pass.height(), pass.width(), |c, y, row| {
        for ((out, value), valid) in row.iter_mut().zip(pass.row(c, y)).zip(valid.row(0, y)) {
            *out = if *valid != 0.0 { (value * exposure).clamp(-LARGEST, LARGEST) } else { 0.0 };
        }
    })
}
