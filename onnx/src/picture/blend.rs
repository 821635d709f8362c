//! How much of the correction is kept at each pixel, and the outlier limit: what `sspc_core::blend_weight` and
//! `sspc_core::outlier_limit` do.

use super::ops::Ops;
use super::prepare::Named;
use sspc_core::blend_weight::{LARGEST_RESIDUAL, LARGEST_SHARE, WEIGHT_RADIUS};
use sspc_core::first_or_mean::MEAN_COUNTS;
use sspc_core::objective::RELATIVE_FLOOR;
use sspc_core::outlier_limit::{
    CLOSE_RADIUS, LEAST_APART, LEAST_SHARE, LIMIT_RADIUS, RING, TIMES_APART, TIMES_AROUND, TIMES_CLOSE,
};

/// y of the other half, `[2, 3, H, W]`.
pub(super) fn targets(g: &mut Ops) -> String {
    let order = g.ints(&[1, 0]);
    g.gather(Named::Y, &order, 0)
}

/// 1 / (x̄² + 0.01) of pictures `[N, 3, H, W]`.
pub(super) fn relative_weight(g: &mut Ops, picture: &str) -> String {
    let mean = g.reduce("ReduceMean", picture, &[1]);
    let squared = g.square(&mean);
    let floored = g.add_to(&squared, RELATIVE_FLOOR);
    g.op("Reciprocal", &[&floored])
}

/// The share of the correction that both halves' judgement of each other keeps, `[1, 1, H, W]` (13).
pub(super) fn share(g: &mut Ops, halves: &str, targets: &str) -> String {
    let judge = Judge::new(g, targets);
    let d = g.sub(halves, Named::Z);
    let [agreement, size] = [&judge.residual, &d].map(|by| judge.around(g, &d, by));
    best_share(g, &agreement, &size)
}

/// Weight of the mean over several networks against the first one's correction, and the share of what is made of both
/// (`sspc_core::first_or_mean`).
pub(super) fn choice(g: &mut Ops, first: &str, mean: &str, targets: &str) -> [String; 2] {
    let judge = Judge::new(g, targets);
    let [first, mean] = [first, mean].map(|halves| g.sub(halves, Named::Z));
    let both = judge.around(g, &first, &mean);
    let [of_first, of_mean] = [&first, &mean].map(|d| {
        let [agreement, size] = [&judge.residual, d].map(|by| judge.around(g, d, by));
        let share = best_share(g, &agreement, &size);
        let (lost, twice) = (g.mul(&share, &size), g.times(&agreement, 2.0));
        let left = g.sub(&twice, &lost);
        (agreement, size, g.mul(&share, &left))
    });
    let (none, whole) = MEAN_COUNTS;
    let ratio = g.div(&of_mean.2, &of_first.2);
    let above = g.add_to(&ratio, -none);
    let part = g.times(&above, 1.0 / (whole - none));
    let part = g.clip(&part, 0.0, 1.0);
    let enough = g.times(&of_first.2, whole);
    let (less, one) = (g.greater(&enough, &of_mean.2), g.float(1.0));
    let t = g.choose(&less, &part, &one);
    let agreement = g.mix(&of_first.0, &of_mean.0, &t);
    // (1 - t)² d² of the first + 2 t (1 - t) of both + t² of the mean, nested.
    let (to_both, to_mean) = (g.mix(&of_first.1, &both, &t), g.mix(&both, &of_mean.1, &t));
    let size = g.mix(&to_both, &to_mean, &t);
    [best_share(g, &agreement, &size), t]
}

/// What corrections are judged by: the loss's weight and the other half's residual, limited.
struct Judge {
    weight: String,
    residual: String,
}

impl Judge {
    fn new(g: &mut Ops, targets: &str) -> Self {
        let of_all = relative_weight(g, Named::Z);
        let weight = g.mul(&of_all, Named::VALID);
        let r = g.sub(targets, Named::Z);
        let squared = g.reduce("ReduceSumSquare", &r, &[1]);
        let squared = g.mul(&squared, &weight);
        let (length, most) = (g.sqrt(&squared), g.float(LARGEST_RESIDUAL));
        let length = g.max(&length, &most);
        let limit = g.div(&most, &length);
        let residual = g.mul(&r, &limit);
        Self { weight, residual }
    }

    /// Σ w p·q over both halves and the neighbourhood.
    fn around(&self, g: &mut Ops, p: &str, q: &str) -> String {
        let weighed = g.mul(p, &self.weight);
        let product = g.mul(&weighed, q);
        let sum = g.sum_over(&product, &[0, 1]);
        let once = g.box_mean(&sum, WEIGHT_RADIUS as i64);
        g.box_mean(&once, WEIGHT_RADIUS as i64)
    }
}

fn best_share(g: &mut Ops, agreement: &str, size: &str) -> String {
    let nothing = g.float(0.0);
    let (ratio, there) = (g.div(agreement, size), g.greater(size, &nothing));
    let share = g.clip(&ratio, 0.0, LARGEST_SHARE);
    g.choose(&there, &share, &nothing)
}

/// The share and the full buffer's correction after the outlier limit.
pub(super) fn limited(g: &mut Ops, halves: &str, full: &str, share: &str) -> [String; 2] {
    let blended = g.mix(Named::Z, halves, share);
    let whole = g.mix(Named::FULL_Z, full, share);
    let mean = g.reduce("ReduceMean", &blended, &[0]);
    let parts = g.split(&blended, &[1, 1], 0);
    let (lower, upper) = (g.min(&parts[0], &parts[1]), g.max(&parts[0], &parts[1]));
    let weight = relative_weight(g, &mean);
    let [far, allowed] = [&whole, &parts[0]].map(|from| {
        let apart = g.sub(from, &mean);
        let squared = g.reduce("ReduceSumSquare", &apart, &[1]);
        let weighed = g.mul(&squared, &weight);
        g.box_mean(&weighed, LIMIT_RADIUS as i64)
    });
    let allowed = g.times(&allowed, TIMES_AROUND);
    let apart = g.sub(&upper, &lower);
    let apart = g.reduce("ReduceMean", &apart, &[1]);
    let close = g.box_mean(&apart, CLOSE_RADIUS as i64);
    let margin = g.times(&close, TIMES_CLOSE);
    let around = ring_mean(g, &apart);
    let least = g.float(LEAST_APART);
    let around = g.max(&around, &least);
    let most_apart = g.times(&around, TIMES_APART);

    let (off, part) = (g.sub(&whole, &mean), g.div(&allowed, &far));
    let nearer = g.mul(&off, &part);
    let nearer = g.add(&mean, &nearer);
    let beyond = g.greater(&far, &allowed);
    let nearer = g.choose(&beyond, &nearer, &whole);
    let (above, cut) = (g.add(&upper, &margin), g.add(&lower, &most_apart));
    let outlying = g.greater(&apart, &most_apart);
    let highest = g.choose(&outlying, &cut, &above);
    let below = g.sub(&lower, &margin);
    let lowest = g.choose(&outlying, &lower, &below);
    let limited = g.max(&nearer, &lowest);
    let limited = g.min(&limited, &highest);

    let same = g.equal(&limited, &whole);
    let changed = g.not(&same);
    let changed = g.channels("ReduceMax", &changed);
    let changed = g.and(&changed, Named::ACTIVE);
    let least = g.float(LEAST_SHARE);
    let carrying = g.max(share, &least);
    let share = g.choose(&changed, &carrying, share);
    let away = g.sub(&limited, Named::FULL_Z);
    let whole = g.div(&away, &share);
    let carried = g.add(Named::FULL_Z, &whole);
    let full = g.choose(&changed, &carried, full);
    [share, full]
}

/// Mean over the ring around each pixel; at the border as if it were whole.
fn ring_mean(g: &mut Ops, plane: &str) -> String {
    let pixels = |radius: usize| ((2 * radius + 1) * (2 * radius + 1)) as f32;
    let [hole, ring] = [RING.0, RING.1].map(|radius| {
        let mean = g.box_mean(plane, radius as i64);
        g.times(&mean, pixels(radius))
    });
    let sum = g.sub(&ring, &hole);
    let mean = g.times(&sum, 1.0 / (pixels(RING.1) - pixels(RING.0)));
    g.relu(&mean)
}
