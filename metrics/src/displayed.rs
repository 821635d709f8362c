//! Errors of what a viewer sees: PSNR and SSIM after the preview's curve ([`display`]).

use crate::filter::{Plane, gaussian, normalised};
use crate::flip::{PIXELS_PER_DEGREE, flip_map};
use sspc_image::{Image, display};

/// Rec. 709 weights; on encoded values they give luma.
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];
/// Wang et al. 2004: an 11x11 Gaussian of 1.5 pixels, K1 = 0.01, K2 = 0.03, values in 0..1.
const SSIM_RADIUS: usize = 5;
const SSIM_SIGMA: f64 = 1.5;
const SSIM_C1: f64 = 0.01 * 0.01;
const SSIM_C2: f64 = 0.03 * 0.03;

/// A picture and its reference as displayed, 0..1 sRGB-encoded, in f32 (not rounded to 8 bits).
pub struct Displayed {
    /// The picture, `[3, H, W]`.
    pub picture: Image,
    /// What it is compared with, `[3, H, W]`.
    pub reference: Image,
    /// Per pixel: both were finite. A missing pixel shows the reference's value (or black) in both, so that it
    /// disturbs no window.
    pub valid: Vec<bool>,
}

impl Displayed {
    /// Takes two `[3, H, W]` images of scene-referred RGB through the curve.
    ///
    /// # Panics
    /// When the images do not have one shape of 3 channels.
    pub fn new(picture: &Image, reference: &Image, exposure: f32) -> Self {
        assert!(picture.same_size(reference), "a picture and a reference of one size");
        assert!(picture.channels() == 3 && reference.channels() == 3, "displayed pictures have 3 channels");
        let finite = |image: &Image, i: usize| (0..3).all(|c| image.plane(c)[i].is_finite());
        let (height, width) = (picture.height(), picture.width());
        let mut shown = Image::zeros(3, height, width);
        let mut wanted = Image::zeros(3, height, width);
        let mut valid = Vec::with_capacity(picture.pixels());
        for i in 0..picture.pixels() {
            let both = finite(picture, i) && finite(reference, i);
            valid.push(both);
            if !finite(reference, i) {
                continue;
            }
            for c in 0..3 {
                let r = display(reference.plane(c)[i], exposure);
                wanted.plane_mut(c)[i] = r;
                shown.plane_mut(c)[i] = if both { display(picture.plane(c)[i], exposure) } else { r };
            }
        }
        Self { picture: shown, reference: wanted, valid }
    }

    /// Pixels that were finite in both.
    pub fn valid_pixels(&self) -> u64 {
        self.valid.iter().filter(|valid| **valid).count() as u64
    }

    /// Peak signal-to-noise ratio in dB, peak 1, over all channels; infinite for equal pictures, NaN without pixels.
    pub fn psnr(&self) -> f64 {
        let mut sum = 0.0;
        for c in 0..3 {
            for (i, valid) in self.valid.iter().enumerate() {
                if *valid {
                    sum += f64::from(self.picture.plane(c)[i] - self.reference.plane(c)[i]).powi(2);
                }
            }
        }
        -10.0 * (sum / (3 * self.valid_pixels()) as f64).log10()
    }

    /// Structural similarity of the luma (Wang et al. 2004), -1..1, mean over pixels; the edge pixels are repeated
    /// beyond the border. NaN without pixels.
    pub fn ssim(&self) -> f64 {
        let taps = normalised(gaussian(SSIM_SIGMA, SSIM_RADIUS));
        let (x, r) = (luma(&self.picture), luma(&self.reference));
        let product = |p: &Plane, q: &Plane| Plane::from_fn(p.width, p.height, |i| p.data[i] * q.data[i]);
        let smooth = |plane: &Plane| plane.filtered(&taps, &taps);
        let (mx, mr) = (smooth(&x), smooth(&r));
        let (xx, rr, xr) = (smooth(&product(&x, &x)), smooth(&product(&r, &r)), smooth(&product(&x, &r)));
        let at = |plane: &Plane, i: usize| f64::from(plane.data[i]);
        let mut sum = 0.0;
        for (i, valid) in self.valid.iter().enumerate() {
            if *valid {
                let (mx, mr) = (at(&mx, i), at(&mr, i));
                let (vx, vr, cov) = (at(&xx, i) - mx * mx, at(&rr, i) - mr * mr, at(&xr, i) - mx * mr);
                sum += (2.0 * mx * mr + SSIM_C1) * (2.0 * cov + SSIM_C2)
                    / ((mx * mx + mr * mr + SSIM_C1) * (vx + vr + SSIM_C2));
            }
        }
        sum / self.valid_pixels() as f64
    }

    /// ꟻLIP (see [`crate::flip`]), 0..1, mean over pixels. NaN without pixels.
    pub fn flip(&self) -> f64 {
        let map = flip_map(&self.picture, &self.reference, PIXELS_PER_DEGREE);
        let errors = map.data.iter().zip(&self.valid).filter(|(_, valid)| **valid);
        errors.map(|(error, _)| f64::from(*error)).sum::<f64>() / self.valid_pixels() as f64
    }
}

fn luma(image: &Image) -> Plane {
    Plane::from_fn(image.width(), image.height(), |i| (0..3).map(|c| LUMA[c] * image.plane(c)[i]).sum())
}
