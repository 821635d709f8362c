//! Whether the correction of the whole picture stays: what `sspc_core::frame_sums` does, in float64.

use super::blend::relative_weight;
use super::ops::Ops;
use super::prepare::Named;
use crate::messages::data_type;
use sspc_core::estimate::BLOCK;
use sspc_core::frame_sums::BY_CHANCE;
use sspc_core::objective::RELATIVE_FLOOR;

/// What a picture is judged by, in the method's units.
pub(super) struct Judged<'a> {
    /// Corrected halves `[2, 3, H, W]` and what they are compared with.
    pub halves: &'a str,
    pub targets: &'a str,
    /// Share of the correction that is used, strength included, `[1, 1, H, W]`.
    pub share: &'a str,
    /// What is added to the full buffer's z, `[1, 3, H, W]`.
    pub correction: &'a str,
}

/// Why the denoiser's picture is the better answer, int64 `[1, 1]`: 0 where it is not, 1 where the estimated error is
/// below 0 by more than chance, 2 where the loss does not fall.
pub(super) fn fallback(g: &mut Ops, judged: &Judged) -> String {
    let blended = g.mix(Named::Z, judged.halves, judged.share);
    let blended = g.relu(&blended);
    let weight = relative_weight(g, Named::Z);
    let finished = g.add(Named::FULL_Z, judged.correction);
    let finished = g.relu(&finished);
    let [z, blended, y, targets, weight, finished, full_z, valid] =
        [Named::Z, &blended, Named::Y, judged.targets, &weight, &finished, Named::FULL_Z, Named::VALID]
            .map(|value| g.cast(value, data_type::DOUBLE));
    let half = g.double(0.5);

    // ½ Σ_h w (p - q)(p + q - 2y): the difference of two squares without their cancellation.
    let (less, sum, twice) = (g.sub(&z, &blended), g.add(&z, &blended), g.add(&targets, &targets));
    let around = g.sub(&sum, &twice);
    let product = g.mul(&less, &around);
    let of_pixel = g.sum_over(&product, &[1]);
    let weighed = g.mul(&of_pixel, &weight);
    let gain = g.sum_over(&weighed, &[0]);
    let gain = g.mul(&gain, &half);

    let variance = of_variance(g, &y);
    let [of_z, of_blended] = [&z, &blended].map(|halves| {
        let off = g.sub(halves, &targets);
        let squared = g.reduce("ReduceSumSquare", &off, &[0, 1]);
        let squared = g.mul(&squared, &half);
        let parts = g.split(halves, &[1, 1], 0);
        let apart = g.sub(&parts[0], &parts[1]);
        let apart = g.reduce("ReduceSumSquare", &apart, &[1]);
        let quarter = g.mul(&half, &half);
        let apart = g.mul(&apart, &quarter);
        let less = g.sub(&squared, &variance);
        g.sub(&less, &apart)
    });
    let floor = g.square("exposure");
    let floor = g.times(&floor, RELATIVE_FLOOR);
    let floor = g.cast(&floor, data_type::DOUBLE);
    let brightness = [&finished, &full_z].map(|picture| {
        let mean = g.reduce("ReduceMean", picture, &[1]);
        let squared = g.square(&mean);
        g.add(&squared, &floor)
    });
    let mut quantities = vec![gain];
    for error in [&of_z, &of_blended] {
        quantities.extend(brightness.each_ref().map(|brightness| g.div(error, brightness)));
    }
    let quantities: Vec<String> = quantities.iter().map(|quantity| g.mul(quantity, &valid)).collect();
    let three = g.double(3.0);
    let values = g.mul(&valid, &three);
    let parts: Vec<&str> = quantities.iter().chain([&values]).map(String::as_str).collect();
    let all = g.concat(&parts, 1);
    decide(g, &all)
}

/// σ² of one half.
fn of_variance(g: &mut Ops, y: &str) -> String {
    let parts = g.split(y, &[1, 1], 0);
    let apart = g.sub(&parts[0], &parts[1]);
    let squared = g.reduce("ReduceSumSquare", &apart, &[1]);
    let half = g.double(0.5);
    g.mul(&squared, &half)
}

/// From planes of the gain, of both pictures' errors under two denominators each, and of the number of values,
/// `[1, 6, H, W]`, to the answer.
fn decide(g: &mut Ops, planes: &str) -> String {
    let block = BLOCK as i64;
    let (height, width) = (g.size(planes, 2), g.size(planes, 3));
    let (rows, columns) = (g.round_up(&height, block), g.round_up(&width, block));
    let padded = g.pad_to(planes, &rows, &columns);
    let side = g.ints(&[block]);
    let across = g.div(&columns, &side);
    let first = g.ints(&[6, -1, block]);
    let shape = g.concat(&[&first, &across, &side], 0);
    let parted = g.reshape(&padded, &shape);
    let sums = g.sum_over(&parted, &[2, 4]);
    let blocks = g.reshape_to(&sums, &[6, -1]);
    let parts = g.split(&blocks, &[5, 1], 0);
    let (sums, counts) = (&parts[0], &parts[1]);
    let total = g.sum_over(sums, &[1]);
    let (count, one) = (g.sum_over(counts, &[1]), g.double(1.0));
    let at_least_one = g.max(&count, &one);
    let means = g.div(&total, &at_least_one);
    let expected = g.mul(&means, counts);
    let off = g.sub(sums, &expected);
    let scatter = g.reduce("ReduceSumSquare", &off, &[1]);
    let n = g.size(&blocks, 1);
    let n = g.cast(&n, data_type::DOUBLE);
    let others = g.sub(&n, &one);
    let at_least = g.max(&others, &one);
    let factor = g.div(&n, &at_least);
    let variance = g.mul(&scatter, &factor);
    let root = g.sqrt(&variance);
    let errors = g.div(&root, &at_least_one);

    let means = g.split(&means, &[1, 2, 2], 0);
    let errors = g.split(&errors, &[1, 2, 2], 0);
    let impossible = [1, 2].map(|i| {
        let of = g.split(&means[i], &[1, 1], 0);
        let scatter = g.split(&errors[i], &[1, 1], 0).swap_remove(0);
        // The standard error: scatter, and what the choice of the denominator does.
        let moved = g.sub(&of[0], &of[1]);
        let (moved, scatter) = (g.square(&moved), g.square(&scatter));
        let sum = g.add(&moved, &scatter);
        let error = g.sqrt(&sum);
        let chance = g.double(-BY_CHANCE as f32);
        let limit = g.mul(&error, &chance);
        g.less(&of[0], &limit)
    });
    let either = g.or(&impossible[0], &impossible[1]);
    let none = g.double(0.0);
    let has_error = g.greater(&others, &none);
    let has_values = g.greater(&count, &none);
    let told = g.and(&has_error, &has_values);
    let impossible = g.and(&either, &told);
    let falls = g.greater(&means[0], &none);
    let [kept, not_independent, no_gain] = [0, 1, 2].map(|answer| g.int(answer));
    let answer = g.choose(&falls, &kept, &no_gain);
    g.choose(&impossible, &not_independent, &answer)
}
