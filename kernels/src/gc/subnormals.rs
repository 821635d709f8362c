//! No number of g_c is subnormal on pictures with edges: a vector that holds one takes Intel's processors over a hundred cycles, and
//! training took five times as long for it.

use super::{Correction, Given, ParameterPlanes, Taps};
use crate::features::{ALBEDO, FEATURE_CHANNELS, FeatureSet, NORMAL, VISIBILITY};
use crate::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, Form};
use crate::region::Region;
use crate::simd::Isa;
use crate::windows::{PaddedPlanes, Windows};
use core::arch::asm;
use fastrand::Rng;
use sspc_image::Image;

/// What the processor notes of operands that are subnormal, and of results that would be.
const DENORMAL_OR_UNDERFLOW: u32 = 1 << 1 | 1 << 4;
/// The usual modes of rounding, and nothing noted.
const NOTHING_NOTED: u32 = 0x1f80;

/// Whether `f` met a subnormal number on the way.
fn meets_subnormals(f: impl FnOnce()) -> bool {
    let mut noted = 0_u32;
    // SAFETY: the mode is what it was and what Rust demands; only what was noted is cleared.
    unsafe { asm!("ldmxcsr [{}]", in(reg) &NOTHING_NOTED, options(nostack)) };
    f();
    // SAFETY: writes 32 bits to where there are as many.
    unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut noted, options(nostack)) };
    noted & DENORMAL_OR_UNDERFLOW != 0
}

#[test]
fn a_subnormal_number_is_noticed() {
    let times = |factor: f32| _ = std::hint::black_box(std::hint::black_box(f32::MIN_POSITIVE) * factor);
    assert!(meets_subnormals(|| times(0.7)) && !meets_subnormals(|| times(1.5)));
}

#[test]
fn weights_beyond_an_edge_make_no_number_subnormal() {
    let rng = &mut Rng::with_seed(3);
    let (height, width, radius) = (24, 40, 6);
    // An edge down the middle, across which exponents are anything down to some thousands; no noise in features.
    let image = Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| match (c, x < 20 + y / 8) {
        (ALBEDO..VISIBILITY, left) => {
            if left {
                0.9
            } else {
                0.1
            }
        }
        (VISIBILITY, _) => 1.0,
        (NORMAL.., left) if c < NORMAL + 3 => {
            if left {
                0.6
            } else {
                -0.6
            }
        }
        _ => 0.1 + rng.f32(),
    });
    let windows = Windows::new(&image, None, FeatureSet::ALL, radius);
    let (taps, region) = (Taps::square(radius), Region::whole(height, width));
    let pixels = region.pixels();
    let mut parameters: Vec<f32> = (0..Form::Gated.parameters() * pixels).map(|_| 0.2 + rng.f32()).collect();
    parameters[BANDWIDTHS * pixels..][..BANDWIDTH_COUNT * pixels].fill_with(|| 1000.0 * rng.f32().powi(3) + 0.1);
    let correction = Correction {
        windows: &windows,
        taps: &taps,
        region,
        parameters: ParameterPlanes::of_region(Form::Gated, &parameters, &region),
    };
    let upstream = vec![1.0; 3 * pixels];
    let planes =
        PaddedPlanes::of_rows((height, width), 0..height, 3, |c, y, row| row.copy_from_slice(image.row(c, y)), radius);
    let (mut out, mut gradient) = (vec![0.0; 3 * pixels], vec![0.0; parameters.len()]);
    // Products of the portable set are rounded by themselves.
    for isa in Isa::available().into_iter().filter(|isa| *isa != Isa::Portable) {
        assert!(!meets_subnormals(|| correction.forward(isa, &mut out)), "{}: forward", isa.name());
        let back = || correction.backward(isa, &mut Given::new(&upstream, region), &mut out, &mut gradient);
        assert!(!meets_subnormals(back), "{}: backward", isa.name());
        assert!(!meets_subnormals(|| correction.means(isa, &planes, &mut out)), "{}: means", isa.name());
    }
}
