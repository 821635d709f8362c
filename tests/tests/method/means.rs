//! Means of further planes by g_c's weights against their naive f64 twin, on odd sizes, for every instruction set; and what
//! they are for: means of planes that add up add up.

use sspc_core::rng::Rng;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet, RADIANCE};
use sspc_kernels::gc::{Correction, ParameterPlanes, Taps, oracle};
use sspc_kernels::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, CENTRE, Form};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};

/// f32 sums of up to 361 terms whose exponents carry the rounding of γ·d; relative to the sum of the terms' sizes.
const TOLERANCE: f64 = 1e-5;

struct Case {
    size: (usize, usize),
    radius: usize,
    planes: usize,
    region: Region,
    missing: bool,
}

/// Bandwidths and τ over their range; slopes and gate, which have no part in this, are NaN.
fn parameters(rng: &mut Rng, pixels: usize) -> Vec<f32> {
    let value = |c: usize, rng: &mut Rng| match c {
        BANDWIDTHS.. if c < BANDWIDTHS + BANDWIDTH_COUNT => 10f32.powf(4.0 * rng.uniform() - 2.5),
        CENTRE => 3.0 * rng.uniform(),
        _ => f32::NAN,
    };
    (0..Form::Gated.parameters() * pixels).map(|i| value(i / pixels, rng)).collect()
}

fn features(rng: &mut Rng, (height, width): (usize, usize)) -> Image {
    Image::from_fn(FEATURE_CHANNELS, height, width, |c, _, _| match c {
        0..3 | 10..13 => 10f32.powf(3.0 * rng.uniform() - 2.0),
        7..10 => 2.0 * rng.uniform() - 1.0,
        _ => rng.uniform(),
    })
}

fn padded(image: &Image, radius: usize) -> PaddedPlanes {
    let fill = |c: usize, y: usize, row: &mut [f32]| row.copy_from_slice(image.row(c, y));
    let size = (image.height(), image.width());
    PaddedPlanes::of_rows(size, 0..size.0, image.channels(), fill, radius)
}

fn check(case: &Case, seed: u64) {
    let rng = &mut Rng::new(seed);
    let image = features(rng, case.size);
    let valid = Image::from_fn(1, case.size.0, case.size.1, |_, _, _| f32::from(rng.uniform() > 0.2));
    let windows = Windows::new(&image, case.missing.then_some(&valid), FeatureSet::ALL, case.radius);
    // Of both signs: light may be subtracted.
    let values = Image::from_fn(case.planes, case.size.0, case.size.1, |_, _, _| rng.normal());
    let planes = padded(&values, case.radius + 1);
    let (taps, region) = (Taps::square(case.radius), case.region);
    let p = parameters(rng, region.pixels());
    for isa in Isa::available() {
        let of = ParameterPlanes::of_region(Form::Gated, &p, &region);
        let mut out = vec![f32::NAN; case.planes * region.pixels()];
        Correction { windows: &windows, taps: &taps, region, parameters: of }.means(isa, &planes, &mut out);
        for i in 0..region.pixels() {
            let at: Vec<f64> = p.chunks_exact(region.pixels()).map(|plane| f64::from(plane[i])).collect();
            let (y, x) = (region.top + i / region.width, region.left + i % region.width);
            for c in 0..case.planes {
                let plane = |(dy, dx): (i32, i32)| {
                    f64::from(planes.row(c, y as isize + dy as isize, x as isize + dx as isize)[0])
                };
                let (truth, size) = oracle::mean(&windows, &taps, &at, (y, x), plane);
                let found = f64::from(out[c * region.pixels() + i]);
                let error = (found - truth).abs() / size.max(1e-30);
                let name = isa.name();
                assert!(error <= TOLERANCE, "{name}: {found} for {truth} at ({y}, {x}), plane {c} of {}", case.planes);
            }
        }
    }
}

#[test]
fn means_match_f64() {
    let whole = |height, width| Region { top: 0, left: 0, height, width };
    for (seed, (size, radius, planes, region, missing)) in [
        ((1, 1), 9, 3, whole(1, 1), false),
        ((9, 11), 2, 6, whole(9, 11), true),
        ((7, 70), 9, 7, whole(7, 70), false),
        ((21, 37), 6, 24, Region { top: 3, left: 5, height: 11, width: 31 }, true),
        ((33, 5), 4, 13, Region { top: 32, left: 4, height: 1, width: 1 }, false),
    ]
    .into_iter()
    .enumerate()
    {
        check(&Case { size, radius, planes, region, missing }, seed as u64);
    }
}

/// Fails when weights differ from plane to plane, or from those of g_c.
#[test]
fn means_of_parts_add_up_to_g_c_without_slopes() {
    let (rng, size, radius) = (&mut Rng::new(3), (19, 40), 9);
    let image = features(rng, size);
    let windows = Windows::new(&image, None, FeatureSet::ALL, radius);
    let parts = 4;
    let shares: Vec<f32> = (0..parts * size.0 * size.1).map(|_| rng.normal()).collect();
    let share = |k: usize, i: usize| {
        let of = |k: usize| shares[k * size.0 * size.1 + i];
        if k + 1 < parts { of(k) } else { 1.0 - (0..k).map(of).sum::<f32>() }
    };
    let of_part = |c: usize, y: usize, x: usize| share(c / 3, y * size.1 + x) * image.at(RADIANCE + c % 3, y, x);
    let planes = padded(&Image::from_fn(3 * parts, size.0, size.1, of_part), radius);
    let region = Region::whole(size.0, size.1);
    let mut p = parameters(rng, region.pixels());
    p.iter_mut().filter(|p| p.is_nan()).for_each(|p| *p = 0.0);
    let taps = Taps::square(radius);
    for isa in Isa::available() {
        let correction = |form| {
            let of = ParameterPlanes::of_region(form, &p, &region);
            Correction { windows: &windows, taps: &taps, region, parameters: of }
        };
        let (mut g, mut means) = (vec![0.0; 3 * region.pixels()], vec![0.0; 3 * parts * region.pixels()]);
        correction(Form::Paper).forward(isa, &mut g);
        correction(Form::Gated).means(isa, &planes, &mut means);
        for (i, g) in g.iter().enumerate() {
            let of = |k: usize| means[3 * k * region.pixels() + i];
            let (sum, sizes): (f32, f32) =
                (0..parts).map(|k| (of(k), of(k).abs())).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            assert!((sum - g).abs() <= 2e-5 * sizes.max(*g), "{}: {sum} for {g}", isa.name());
        }
    }
}
