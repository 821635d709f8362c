//! The objective of a frame: its weights, and mirrored tiles.

use sspc_core::objective::{Mirror, Objective, PixelLoss, Step, Tile, Workspaces};
use sspc_core::prepare::Prepared;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::Image;
use sspc_kernels::features::{DENOISED, FEATURE_CHANNELS};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::frames::prepared;
use sspc_testkit::kernels::{features_of, loss_of_tiles};
use std::sync::Arc;

/// Noise in every channel.
fn scene(rng: &mut Rng) -> Prepared {
    prepared([0, 1].map(|_| Image::from_fn(FEATURE_CHANNELS, 21, 26, |_, _, _| rng.uniform())))
}

#[test]
fn a_weight_is_of_the_other_half_or_the_own_and_0_where_a_pixel_is_missing() {
    let mut prepared = scene(&mut Rng::new(2));
    for (h, z) in [(0, [0.1, 0.2, 0.3]), (1, [0.5, 0.6, 0.7])] {
        let half = Arc::make_mut(&mut prepared.halves[h]);
        (0..3).for_each(|k| half.set(DENOISED + k, 3, 4, z[k]));
    }
    let mut valid = Image::filled(1, prepared.height(), prepared.width(), 1.0);
    valid.set(0, 20, 25, 0.0);
    prepared.valid = Some(valid);
    let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set);
    // z̄ is 0.2 and 0.6.
    let expect = |objective: &Objective, expected: [f32; 2]| {
        for (half, expected) in objective.halves.iter().zip(expected) {
            assert!((half.weight.at(0, 3, 4) - expected).abs() < 1e-4, "{} {expected}", half.weight.at(0, 3, 4));
            assert_eq!(half.weight.at(0, 20, 25), 0.0);
        }
    };
    expect(&objective, [1.0 / 0.37, 1.0 / 0.05]);
    expect(&objective.with_own_weight(&prepared), [1.0 / 0.05, 1.0 / 0.37]);
}

#[test]
fn a_mirrored_tile_is_the_same_tile_to_g_c_and_the_loss() {
    let mut rng = Rng::new(5);
    let prepared = scene(&mut rng);
    let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set);
    let region = Region { top: 4, left: 7, height: 9, width: 9 };
    let outputs: Vec<f32> = (0..16 * region.pixels()).map(|_| rng.normal()).collect();
    let isa = Isa::best();
    let upright = [Tile::upright(1, region)];
    let measure = PixelLoss { scale: 0.1, influence: 1.0 };
    let (loss, gradient) = loss_of_tiles(&objective, isa, &upright, &outputs, measure);
    for bits in 1..8 {
        let [rows, columns, diagonal] = [1, 2, 4].map(|bit| bits & bit != 0);
        let mirror = Mirror { rows, columns, diagonal };
        let mirrored = |values: &[f32]| {
            let mut values = values.to_vec();
            mirror.apply(&mut values, region.height, region.width);
            values
        };
        let tile = [Tile { mirror, ..upright[0] }];
        let features = features_of(&objective, &tile[0]);
        assert_eq!(features, mirrored(&features_of(&objective, &upright[0])), "{mirror:?}");
        // The first pixel seen, and the second of the first row seen, by their places in the picture.
        let seen = |y: usize, x: usize| {
            let (y, x) = (if rows { 8 - y } else { y }, if columns { 8 - x } else { x });
            prepared.halves[1].at(0, 4 + y, 7 + x)
        };
        let second = if diagonal { seen(1, 0) } else { seen(0, 1) };
        assert_eq!(features[..2], [seen(0, 0), second], "{mirror:?}: the corner");
        let seen = loss_of_tiles(&objective, isa, &tile, &mirrored(&outputs), measure);
        assert_eq!((seen.0, seen.1), (loss, mirrored(&gradient)), "{mirror:?}");
    }
}

/// Machines with many cores compute a tile in parts. Tiles wider than a strip of g_c, and lower than there are parts.
#[test]
fn parts_of_tiles_do_not_show() {
    let mut rng = Rng::new(8);
    let prepared = prepared([0, 1].map(|_| Image::from_fn(FEATURE_CHANNELS, 50, 90, |_, _, _| rng.uniform())));
    let objective = Objective::new(&prepared, Form::Gated, Taps::square(4), prepared.set).with_own_weight(&prepared);
    let shape = Shape::shallow(Form::Gated);
    let weights = start::analytic(shape, 0.6, &mut Rng::new(3)).weights;
    for (height, width) in [(48, 48), (37, 83), (3, 65), (1, 1)] {
        let tiles = [0, 1].map(|half| {
            let mirror = Mirror { rows: half == 1, columns: true, diagonal: false };
            Tile { half, region: Region { top: 1, left: 3, height, width }, mirror }
        });
        for isa in Isa::available() {
            let step = Step { objective: &objective, shape, isa, influence: 0.5, frozen_outputs: 0..2 };
            let of_parts = |parts| step.run_in_parts(&weights, &tiles, &Workspaces::default(), parts);
            let (loss, gradient) = of_parts(1);
            for parts in [2, 3, 8, 20] {
                let (other, of_weights) = of_parts(parts);
                let what = format!("{height}x{width}, {}, {parts} parts", isa.name());
                assert_eq!(loss.to_bits(), other.to_bits(), "{what}: the loss");
                assert!(gradient.iter().zip(&of_weights).all(|(a, b)| a.to_bits() == b.to_bits()), "{what}");
            }
        }
    }
}
