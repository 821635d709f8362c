//! From radiance to what a viewer shows.

/// The display curve: exposure, clip to 0..1, then the sRGB transfer function of IEC 61966-2-1.
///
/// NaN gives NaN. Metrics of displayed pictures (PSNR, SSIM, FLIP) use the same curve.
pub fn display(value: f32, exposure: f32) -> f32 {
    let linear = (value * exposure).clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
