//! What the passes of a set lack of the picture, or have too much of, shared out among them; and rounding.
//!
//! Where the passes' pictures do not add up to the picture, each takes a part of the difference, in proportion to its value and
//! to how wrong it may be; none that is positive becomes negative before all others are used up. What is written is rounded,
//! and the largest pass is rounded last, so that it takes up the rounding of the others.

use super::choice::Chosen;
use rayon::prelude::*;
use sspc_image::{Image, Storage};

/// Part of a pass's own value in its doubt: passes that nothing is known against still share.
const LEAST_DOUBT: f64 = 1e-3;
/// Picture values below this share of the largest do not count for the report's relative error.
const DARK: f64 = 1e-4;

/// Passes of some rows as they are written.
pub struct Stored {
    /// Divided by their colours, `[3, rows, W]` each.
    pub passes: Vec<Image>,
    /// As [`super::SumReport::largest_error`].
    pub largest_error: f64,
    /// As [`super::SumReport::unplaced`].
    pub unplaced: usize,
}

/// The passes of a set in some rows, so that times their colours they add up to `picture` `[3, rows, W]`. `largest` is the
/// whole picture's largest value.
pub(super) fn share_out(
    picture: &Image,
    chosen: &[Chosen],
    colours: &[Option<Image>],
    storage: &[Storage],
    largest: f32,
) -> Stored {
    let (height, width, count) = (picture.height(), picture.width(), chosen.len());
    let of_row = |c: usize, y: usize| {
        let mut out = vec![0.0f32; count * width];
        let (mut error, mut unplaced) = (0.0f64, 0);
        let [mut parts, mut doubts, mut factors, mut weights] = [(); 4].map(|()| vec![0.0; count]);
        let mut values = vec![0.0f32; count];
        for x in 0..width {
            let target = f64::from(picture.at(c, y, x));
            for k in 0..count {
                let colour = colours[k].as_ref().map_or(1.0, |colour| f64::from(colour.at(c, y, x)));
                factors[k] = if colour.is_finite() { colour } else { 0.0 };
                parts[k] = factors[k] * f64::from(chosen[k].pass.at(c, y, x));
                doubts[k] = factors[k].abs() * f64::from(chosen[k].doubt.at(0, y, x));
            }
            share(target, &mut parts, &doubts, &factors, &mut weights);
            settle(target, &parts, &factors, storage, &mut values);
            let sum: f64 = values.iter().zip(&factors).map(|(v, f)| f64::from(*v) * f).sum();
            if factors.iter().all(|f| *f == 0.0) {
                // Times nothing, any value does: the pass keeps its own.
                unplaced += usize::from(target != 0.0);
            } else if target.abs() >= DARK * f64::from(largest) {
                error = error.max((sum - target).abs() / target.abs().max(f64::MIN_POSITIVE));
            }
            for (k, &value) in values.iter().enumerate() {
                let value =
                    if factors[k] == 0.0 { storage[k].round(f64::from(chosen[k].pass.at(c, y, x))) } else { value };
                out[k * width + x] = value;
            }
        }
        (out, error, unplaced)
    };
    let rows: Vec<(Vec<f32>, f64, usize)> =
        (0..3 * height).into_par_iter().map(|at| of_row(at / height, at % height)).collect();
    let passes = (0..count)
        .map(|k| {
            Image::from_rows(3, height, width, |c, y, row| {
                row.copy_from_slice(&rows[c * height + y].0[k * width..][..width]);
            })
        })
        .collect();
    Stored {
        passes,
        largest_error: rows.iter().fold(0.0, |largest, row| largest.max(row.1)),
        unplaced: rows.iter().map(|row| row.2).sum(),
    }
}

/// Changes `parts` so that they add up to `target`; only those with a factor that is not 0 change. `weights` is room for as
/// many values.
fn share(target: f64, parts: &mut [f64], doubts: &[f64], factors: &[f64], weights: &mut [f64]) {
    let mut lacking = target - parts.iter().sum::<f64>();
    for ((weight, part), (doubt, factor)) in weights.iter_mut().zip(&*parts).zip(doubts.iter().zip(factors)) {
        *weight = if *factor == 0.0 { 0.0 } else { part.abs() * (doubt + LEAST_DOUBT * part.abs()) };
    }
    // Every round but the last empties a pass.
    while lacking != 0.0 {
        let total: f64 = weights.iter().sum();
        if !total.is_normal() {
            break;
        }
        // Passes that would become negative give all they have, and the others go on.
        let ratio = lacking / total;
        let mut taken = 0.0;
        for (part, weight) in parts.iter_mut().zip(weights.iter_mut()) {
            if *part > 0.0 && *weight > 0.0 && *part + ratio * *weight < 0.0 {
                taken += *part;
                (*part, *weight) = (0.0, 0.0);
            }
        }
        if taken == 0.0 {
            parts.iter_mut().zip(weights).for_each(|(part, weight)| *part += ratio * *weight);
            return;
        }
        lacking += taken;
    }
    // Nothing says whose it is: passes without a colour first, evenly.
    let total: f64 = factors.iter().map(|f| f.abs()).sum();
    for (part, factor) in parts.iter_mut().zip(factors).filter(|_| total > 0.0) {
        *part += lacking * factor.abs() / total;
    }
}

/// Rounds `parts` that add up to `target`: `values` become what is kept of each, divided by its factor. The one that is largest
/// takes up what rounding changed.
fn settle(target: f64, parts: &[f64], factors: &[f64], storage: &[Storage], values: &mut [f32]) {
    let value = |k: usize, part: f64| if factors[k] == 0.0 { 0.0 } else { storage[k].round(part / factors[k]) };
    let (mut largest, mut sum) = (None, 0.0);
    for k in 0..parts.len() {
        values[k] = value(k, parts[k]);
        sum += f64::from(values[k]) * factors[k];
        if factors[k] != 0.0 && largest.is_none_or(|largest: usize| parts[k].abs() >= parts[largest].abs()) {
            largest = Some(k);
        }
    }
    if let Some(largest) = largest {
        let others = sum - f64::from(values[largest]) * factors[largest];
        values[largest] = value(largest, target - others);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shared(target: f64, parts: &[f64], doubts: &[f64], factors: &[f64]) -> Vec<f64> {
        let mut parts = parts.to_vec();
        share(target, &mut parts, doubts, factors, &mut vec![0.0; factors.len()]);
        assert!((parts.iter().sum::<f64>() - target).abs() <= 1e-12 * target.abs().max(1.0), "{parts:?}");
        parts
    }

    #[test]
    fn the_difference_goes_to_passes_that_may_be_wrong_in_proportion_to_their_value() {
        let parts = shared(4.0, &[1.0, 2.0], &[0.5, 0.5], &[1.0, 1.0]);
        assert!((parts[1] - parts[0] - 1.333).abs() < 2e-3, "{parts:?}");
        // A pass of which nothing is doubted hardly changes.
        assert!((shared(4.0, &[1.0, 2.0], &[0.0, 0.5], &[1.0, 1.0])[0] - 1.0).abs() < 2e-3);
    }

    #[test]
    fn no_light_becomes_negative_while_others_can_give() {
        let parts = shared(0.5, &[1.0, 0.1], &[0.0, 5.0], &[1.0, 1.0]);
        assert!(parts.iter().all(|part| *part >= 0.0), "{parts:?}");
        let nothing = shared(0.0, &[1.0, 0.1], &[0.1, 0.1], &[1.0, 1.0]);
        assert!(nothing.iter().all(|part| part.abs() < 1e-12), "{nothing:?}");
        // Light that is subtracted stays so.
        assert!(shared(0.5, &[1.0, -0.2], &[0.1, 0.1], &[1.0, 1.0])[1] < 0.0);
    }

    #[test]
    fn what_nobody_has_goes_where_it_can_be_written() {
        assert_eq!(shared(0.3, &[0.0, 0.0], &[0.0, 0.0], &[0.0, 1.0]), [0.0, 0.3]);
        let mut lost = vec![0.0];
        share(0.3, &mut lost, &[0.0], &[0.0], &mut [0.0]);
        assert_eq!(lost, [0.0]);
    }

    #[test]
    fn rounding_does_not_break_the_sum() {
        let parts = [0.1, 3.0, 1.234, 0.0007];
        let target = f64::from(Storage::Half.round(parts.iter().sum()));
        let factors = [1.0, 0.37, 1.0, 0.0];
        let mut values = [0.0; 4];
        settle(target, &parts, &factors, &[Storage::Half; 4], &mut values);
        let sum: f64 = values.iter().zip(&factors).map(|(v, f)| f64::from(*v) * f).sum();
        // Half an ulp of the largest pass: at most 2^-11 of it.
        assert!((sum - target).abs() <= 3.0 / 2048.0, "{sum} for {target}");
        assert!(values.iter().all(|v| Storage::Half.round(f64::from(*v)) == *v));
    }
}
