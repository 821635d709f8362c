//! The correlation of the halves' noise, apart from the texture that both halves share.
//!
//! r = y - z of either half holds its noise and the texture that the denoiser took away. Texture is the same in both, so
//! ⟨r^a r^b⟩ alone can't tell it from noise that is shared. Three things can:
//!
//! 1. Texture is often that of **albedo or normal**. In a block the part that they explain is taken away, by a regression
//!    of r on them in which every product is one of both halves (⟨r^a f^b⟩, ⟨f^a f^b⟩): noise of a feature that goes
//!    with the noise of its own half's colour then explains nothing.
//! 2. Noise is shared at every **frequency** (or at none), texture is of some.
//! 3. Noise is shared at every **place**, texture is in some.
//!
//! So the residuals of blocks of [`BLOCK`] x [`BLOCK`] pixels go through a cosine transform, and the correlation is read
//! off the half of the frequencies and the quarter of the blocks where it is lowest. What is lowest is found in the other
//! half of the blocks and of the frequencies, so that choosing takes nothing off.
//!
//! Of a frequency and a block ρ = s / (s + d), with s = ⟨r^a r^b⟩ and d = ½ ⟨(r^a - r^b)²⟩, in which no texture is.
//!
//! Measured with OIDN on 16 frames of three renderers: independent halves -0.02 to 0.02, an injected 0.2 gives 0.18 to
//! 0.21; with a mean of 5x5 pixels for a denoiser, on patterns that albedo shows or that repeat, -0.05 to 0.05. What is
//! left: texture of all frequencies at all places that no feature shows, as of fine leaves (0.08 at 16 samples a pixel,
//! 0.36 at 64).

use crate::block_sample::{AREA, Block, FEATURES, RESIDUALS};
use crate::estimate::BLOCK;
use crate::lanes::widest;
use rayon::prelude::*;
use sspc_kernels::simd::{Kernel, Simd};
use std::f64::consts::PI;

/// Blocks that a statement needs.
const FEWEST_BLOCKS: usize = 40;
/// u + v of the lowest frequency that counts: below, the denoiser follows the noise.
const LOWEST: usize = 4;
/// Part of the strongest frequency's noise below which one says nothing: a wide pixel filter leaves rounding errors there.
const LEAST_NOISE: f64 = 0.02;
/// Frequencies and blocks that the correlation is read off.
const FREQUENCIES: f64 = 0.5;
const BLOCKS: f64 = 0.25;
/// Correlation of a feature of both halves from which it may explain colour.
const CLEAN: f64 = 0.95;
/// Features by which colour is explained, one after the other.
const ROUNDS: usize = 2;

/// A correlation with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SharedNoise {
    pub(crate) correlation: f64,
    pub(crate) standard_error: f64,
}

impl SharedNoise {
    /// What blocks with noise say; `None` of too few.
    pub(crate) fn of(blocks: &[&Block]) -> Option<Self> {
        let cosines = cosines();
        let of_block = |block: &&Block| widest(ToSpectrum { block, cosines: &cosines });
        let spectra: Vec<Spectrum> = blocks.par_iter().filter_map(of_block).collect();
        (spectra.len() >= FEWEST_BLOCKS).then(|| lowest(&spectra))
    }
}

/// A block, to be looked at by frequencies.
struct ToSpectrum<'a> {
    block: &'a Block,
    cosines: &'a [[f32; BLOCK]; BLOCK],
}

impl Kernel for ToSpectrum<'_> {
    type Output = Option<Spectrum>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Option<Spectrum> {
        spectrum(self.block, self.cosines)
    }
}

/// A block by frequencies; `None` without noise.
#[inline(always)]
fn spectrum(block: &Block, cosines: &[[f32; BLOCK]; BLOCK]) -> Option<Spectrum> {
    let largest = block.residuals().iter().fold(0.0f32, |most, r| most.max(r.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let mut residuals = [[0.0; AREA]; 2 * RESIDUALS];
    for (out, plane) in residuals.iter_mut().zip(block.residuals().chunks_exact(AREA)) {
        transform(plane, 1.0 / largest, cosines, out);
    }
    let mut features = [[0.0; AREA]; 2 * FEATURES];
    for (out, plane) in features.iter_mut().zip(block.features().chunks_exact(AREA)) {
        transform(plane, 1.0, cosines, out);
    }
    let (a, b) = residuals.split_at_mut(RESIDUALS);
    let (features_a, features_b) = features.split_at(FEATURES);
    for c in 0..RESIDUALS {
        for _ in 0..ROUNDS {
            explain([&mut a[c], &mut b[c]], [features_a, features_b], [c, 3, 4, 5]);
        }
    }
    Spectrum::of(a, b)
}

/// cos(π (2 x + 1) u / 2 BLOCK), orthonormal: rows u, columns x.
fn cosines() -> [[f32; BLOCK]; BLOCK] {
    std::array::from_fn(|u| {
        let scale = if u == 0 { 1.0 } else { 2.0 } / BLOCK as f64;
        std::array::from_fn(|x| (scale.sqrt() * (PI * (2 * x + 1) as f64 * u as f64 / (2 * BLOCK) as f64).cos()) as f32)
    })
}

/// The cosine transform of a block, its lowest frequencies 0.
#[inline(always)]
fn transform(block: &[f32], scale: f32, cosines: &[[f32; BLOCK]; BLOCK], out: &mut [f32; AREA]) {
    let mut columns = [[0.0f32; BLOCK]; BLOCK];
    for (out, cosines) in columns.iter_mut().zip(cosines) {
        for (row, cosine) in block.chunks_exact(BLOCK).zip(cosines) {
            for (out, value) in out.iter_mut().zip(row) {
                *out += cosine * scale * value;
            }
        }
    }
    let mut by_column = [[0.0f32; BLOCK]; BLOCK];
    for (v, cosines) in cosines.iter().enumerate() {
        for (x, cosine) in cosines.iter().enumerate() {
            by_column[x][v] = *cosine;
        }
    }
    for (u, (out, column)) in out.chunks_exact_mut(BLOCK).zip(&columns).enumerate() {
        let mut row = [0.0f32; BLOCK];
        for (value, cosines) in column.iter().zip(&by_column) {
            for (out, cosine) in row.iter_mut().zip(cosines) {
                *out += value * cosine;
            }
        }
        for (v, (out, value)) in out.iter_mut().zip(row).enumerate() {
            *out = if u + v >= LOWEST { value } else { 0.0 };
        }
    }
}

/// Σ p q, in eight sums, which do not wait for one another.
#[inline(always)]
fn dot(p: &[f32; AREA], q: &[f32; AREA]) -> f64 {
    let mut sums = [0.0; 8];
    for (p, q) in p.as_chunks::<8>().0.iter().zip(q.as_chunks::<8>().0) {
        for i in 0..8 {
            sums[i] += f64::from(p[i] * q[i]);
        }
    }
    sums.iter().sum()
}

/// Takes away from the residuals of both halves what one of the features explains best.
#[inline(always)]
fn explain(residuals: [&mut [f32; AREA]; 2], features: [&[[f32; AREA]]; 2], candidates: [usize; 4]) {
    let (mut most, mut best) = (0.0, None);
    for j in candidates {
        let (a, b) = (&features[0][j], &features[1][j]);
        let shared = dot(a, b);
        // Not a number where a feature is not finite.
        if !(shared > 0.0 && shared >= CLEAN * (dot(a, a) * dot(b, b)).sqrt()) {
            continue;
        }
        let both = 0.5 * (dot(residuals[0], b) + dot(residuals[1], a));
        if both * both / shared > most {
            (most, best) = (both * both / shared, Some((j, (both / shared) as f32)));
        }
    }
    if let Some((j, slope)) = best {
        for (residual, features) in residuals.into_iter().zip(features) {
            residual.iter_mut().zip(&features[j]).for_each(|(r, f)| *r -= slope * f);
        }
    }
}

/// What a block's halves share and what not, by frequency; the latter's sum is 1.
struct Spectrum {
    shared: [f64; AREA],
    apart: [f64; AREA],
}

impl Spectrum {
    #[inline(always)]
    fn of(a: &[[f32; AREA]], b: &[[f32; AREA]]) -> Option<Self> {
        let mut spectrum = Self { shared: [0.0; AREA], apart: [0.0; AREA] };
        for (a, b) in a.iter().zip(b) {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                spectrum.shared[i] += f64::from(a * b);
                spectrum.apart[i] += 0.5 * f64::from((a - b) * (a - b));
            }
        }
        let noise: f64 = spectrum.apart.iter().sum();
        if !(noise > 0.0 && noise.is_finite()) {
            return None;
        }
        let values = spectrum.shared.iter_mut().chain(&mut spectrum.apart);
        values.for_each(|value| *value /= noise);
        Some(spectrum)
    }

    /// What is shared and what is not, over some frequencies.
    fn sums(&self, frequencies: &[usize]) -> [f64; 2] {
        [&self.shared, &self.apart].map(|of| frequencies.iter().map(|&i| of[i]).sum())
    }
}

/// s / (s + d).
fn correlation([shared, apart]: [f64; 2]) -> f64 {
    let energy = shared + apart;
    if energy > 0.0 { shared / energy } else { 0.0 }
}

/// The correlation where it is lowest.
fn lowest(spectra: &[Spectrum]) -> SharedNoise {
    let noise: Vec<f64> = (0..AREA).map(|i| spectra.iter().map(|spectrum| spectrum.apart[i]).sum()).collect();
    let strongest = noise.iter().copied().fold(0.0, f64::max);
    let of_parity = |odd: usize| -> Vec<usize> {
        (0..AREA).filter(|i| (i / BLOCK + i % BLOCK) % 2 == odd && noise[*i] >= LEAST_NOISE * strongest).collect()
    };
    let frequencies = [of_parity(0), of_parity(1)];
    let blocks = [0, 1].map(|odd| spectra.iter().skip(odd).step_by(2).collect::<Vec<_>>());
    let mut chosen: Vec<[f64; 2]> = Vec::new();
    for (own, others) in [(&blocks[0], &blocks[1]), (&blocks[1], &blocks[0])] {
        for (these, those) in [(&frequencies[0], &frequencies[1]), (&frequencies[1], &frequencies[0])] {
            let over_others = |i: &usize| {
                let of = |spectrum: &&Spectrum| spectrum.sums(&[*i]);
                correlation(others.iter().map(of).fold([0.0; 2], |[s, d], [shared, apart]| [s + shared, d + apart]))
            };
            let these = lowest_of(these, FREQUENCIES, over_others);
            let own = lowest_of(own, BLOCKS, |block| correlation(block.sums(those)));
            chosen.extend(own.iter().map(|block| block.sums(&these)));
        }
    }
    let total = chosen.iter().fold([0.0; 2], |[s, d], [shared, apart]| [s + shared, d + apart]);
    let correlation = correlation(total);
    let off = |[shared, apart]: &[f64; 2]| (shared * (1.0 - correlation) - apart * correlation).powi(2);
    let standard_error = chosen.iter().map(off).sum::<f64>().sqrt() / (total[0] + total[1]);
    SharedNoise { correlation, standard_error }
}

/// That share of some things, at least one, that has the lowest values.
fn lowest_of<T: Copy>(things: &[T], share: f64, value: impl Fn(&T) -> f64) -> Vec<T> {
    let mut ranked: Vec<(f64, T)> = things.iter().map(|thing| (value(thing), *thing)).collect();
    ranked.sort_by(|p, q| p.0.total_cmp(&q.0));
    ranked.truncate(((share * things.len() as f64).ceil() as usize).max(1));
    ranked.into_iter().map(|(_, thing)| thing).collect()
}

#[cfg(test)]
mod tests {
    use crate::independence::tests::{frame, measured};
    use crate::rng::Rng;
    use sspc_image::{Frame, Image, box_mean};

    /// Five standard errors of 192 blocks.
    const NEAR: f64 = 0.06;

    fn found(frame: &Frame) -> f64 {
        measured(frame).correlation.expect("enough blocks")
    }

    /// As of leaves: another value at every pixel, so all frequencies at all places.
    fn leaves() -> Image {
        let rng = &mut Rng::new(3);
        let values: Vec<f32> = (0..192 * 256).map(|_| 0.1 * rng.normal()).collect();
        Image::from_fn(3, 192, 256, |_, y, x| values[256 * y + x])
    }

    #[test]
    fn texture_of_some_frequencies_is_no_noise() {
        for rho in [-0.29f32, 0.0, 0.2] {
            let frame = frame(rho, |y, x| if (y / 4 + x / 4).is_multiple_of(2) { 0.15 } else { -0.15 });
            assert!(measured(&frame).median > 0.5, "{:?}", measured(&frame));
            assert!((found(&frame) - f64::from(rho)).abs() < NEAR, "{rho}: {:?}", measured(&frame));
        }
    }

    #[test]
    fn texture_that_albedo_shows_is_no_noise() {
        let texture = leaves();
        for rho in [-0.29f32, 0.0, 0.2] {
            let mut frame = frame(rho, |y, x| texture.at(0, y, x));
            assert!(found(&frame) > f64::from(rho) + 0.2, "without albedo: {:?}", measured(&frame));
            for half in [&mut frame.a, &mut frame.b] {
                half.albedo = Some(Image::from_fn(3, 192, 256, |c, y, x| 0.5 + 2.0 * texture.at(c, y, x)));
            }
            assert!((found(&frame) - f64::from(rho)).abs() < NEAR, "{rho}: {:?}", measured(&frame));
        }
    }

    /// A depth of field gives albedo noise that goes with the colour's: it explains noise, but not what halves share.
    #[test]
    fn a_feature_with_the_noise_of_its_half_hides_nothing() {
        for rho in [0.0f32, 0.29] {
            let mut frame = frame(rho, |_, _| 0.0);
            for half in [&mut frame.a, &mut frame.b] {
                half.albedo = Some(half.radiance.clone());
            }
            assert!((found(&frame) - f64::from(rho)).abs() < NEAR, "{rho}: {:?}", measured(&frame));
        }
    }

    /// Rounding errors are independent, and all that a wide pixel filter leaves at high frequencies.
    #[test]
    fn rounding_errors_hide_nothing() {
        let mut frame = frame(0.5, |_, _| 0.0);
        for half in [&mut frame.a, &mut frame.b] {
            let wide = box_mean(&box_mean(&half.radiance, 2), 2);
            let rounding = &mut Rng::new(half.radiance.at(0, 0, 0).to_bits().into());
            half.radiance = Image::from_fn(3, 192, 256, |c, y, x| wide.at(c, y, x) + 1e-3 * rounding.normal());
        }
        assert!(found(&frame) > 0.3, "{:?}", measured(&frame));
    }
}
