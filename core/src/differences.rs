//! Differences of y between neighbouring pixels, as gradient-domain renderers estimate them by tracing correlated paths
//! through both (Lehtinen et al. 2013, Kettunen et al. 2015, the survey of Hua et al. 2019).
//!
//! Where both paths meet the same surfaces their noise cancels, and the difference is far less noisy than that of y. It is
//! dx = y(x + 1) - y(x) and dy = y(below) - y here. Renderers differ: some take the other neighbour, or subtract the
//! other way round. What a file holds is found out by its correlation with differences of the *other* half's z, whose
//! noise is independent.

use crate::objective::difference_weight;
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use std::fmt;
use std::ops::Range;

/// Differences of both halves in the method's units.
#[derive(Clone, Debug)]
pub struct Differences {
    /// Of half a and of half b: dx, then dy, `[6, H, W]`; 0 where they are not known.
    pub halves: [Image; 2],
    /// 1 where dx and dy are known in both halves and of pixels that count, else 0, `[2, H, W]`.
    pub known: Image,
    /// How much more than a colour of the same pixel a difference weighs, 0 where it is not known, `[2, H, W]`
    /// ([`crate::objective::difference_weight`]).
    pub weight: Image,
}

/// dx and dy as read, `[3, H, W]` each.
pub type AsRead = [Image; 2];

/// What a role turned out to hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// 0: along rows, 1: along columns.
    pub axis: usize,
    /// Whether it is the difference to the pixel before, which is that of the pixel before to this one.
    pub is_backward: bool,
    /// Whether the later pixel is subtracted.
    pub is_negated: bool,
    /// Its correlation with z's, 0 to 1.
    pub correlation: f64,
}

/// Below this, a correlation tells nothing: differences of noise alone, or of another frame.
const LEAST_CORRELATION: f64 = 0.05;
/// The usual reading is believed when its correlation is at least this share of the best one.
const AS_GOOD: f64 = 0.8;
/// Differences relative to z̄ count as no larger than this: fireflies and lamps do not decide.
const LARGEST: f32 = 0.5;
/// Added to z̄ in relative differences.
const FLOOR: f32 = 0.1;

const AXES: [&str; 2] = ["dx", "dy"];

impl Differences {
    /// Differences of half a and of half b as read, in the units of `prepared`, to weigh `strength` times what their noise
    /// deserves; and what a person should know. None where they are not what they claim to be.
    pub fn new(read: &[AsRead; 2], prepared: &Prepared, strength: f32) -> (Option<Self>, Vec<String>) {
        let mut search = Search::default();
        search.look(read, prepared, 0..prepared.height());
        let (found, said) = search.finish(strength);
        (found.map(|readings| readings.of(read, prepared)), said)
    }

    /// Differences in the method's units, `[6, H, W]` of each half, 0 where they are not `known` `[2, H, W]`.
    pub fn of_known(halves: [Image; 2], known: Image, prepared: &Prepared, strength: f32) -> Self {
        let weight = difference_weight(prepared, &halves, &known, strength);
        Self { halves, known, weight }
    }
}

/// What dx and dy of a frame turned out to hold, and how heavily they weigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readings {
    of_roles: [Reading; 2],
    strength: f32,
}

impl Readings {
    /// Differences of a frame, or of a band of it, of half a and of half b as read, in the units of `prepared`.
    pub fn of(&self, read: &[AsRead; 2], prepared: &Prepared) -> Differences {
        let Self { of_roles: readings, strength } = *self;
        let (height, width) = (prepared.height(), prepared.width());
        // The role that holds the differences along each axis.
        let role_of = |axis: usize| if readings[0].axis == axis { 0 } else { 1 };
        let known = Image::from_rows(2, height, width, |axis, y, row| {
            let reading = readings[role_of(axis)];
            for (x, known) in row.iter_mut().enumerate() {
                let is_known = neighbour(axis, y, x, height, width).is_some_and(|next| {
                    let (y_at, x_at) = if reading.is_backward { next } else { (y, x) };
                    let is_finite =
                        |k: usize| read.iter().all(|half| half[role_of(axis)].at(k, y_at, x_at).is_finite());
                    let counts = |(y, x): (usize, usize)| prepared.is_valid(y * width + x);
                    (0..3).all(is_finite) && counts((y, x)) && counts(next)
                });
                *known = if is_known { 1.0 } else { 0.0 };
            }
        });
        let half = |half: &AsRead| {
            Image::from_rows(6, height, width, |c, y, row| {
                let (axis, k) = (c / 3, c % 3);
                let (reading, image) = (readings[role_of(axis)], &half[role_of(axis)]);
                let factor = if reading.is_negated { -prepared.exposure } else { prepared.exposure };
                for (x, value) in row.iter_mut().enumerate() {
                    let next = neighbour(axis, y, x, height, width).filter(|_| known.at(axis, y, x) != 0.0);
                    *value = next.map_or(0.0, |next| {
                        let (y_at, x_at) = if reading.is_backward { next } else { (y, x) };
                        (factor * image.at(k, y_at, x_at)).clamp(-1e15, 1e15)
                    });
                }
            })
        };
        Differences::of_known([half(&read[0]), half(&read[1])], known, prepared, strength)
    }
}

/// The pixel on the right (axis 0) or below (axis 1), where there is one.
pub(crate) fn neighbour(axis: usize, y: usize, x: usize, height: usize, width: usize) -> Option<(usize, usize)> {
    match axis {
        0 => (x + 1 < width).then_some((y, x + 1)),
        _ => (y + 1 < height).then_some((y + 1, x)),
    }
}

/// Looks a frame's differences over, band by band, to find out what they hold.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// By role and candidate ([`CANDIDATES`]), of half a and of half b.
    sums: [[[Sums; 2]; 4]; 2],
    unusable: usize,
}

/// Σ g d, Σ g², Σ d².
type Sums = [f64; 3];

/// Whether differences are along the other axis than the role says, and whether they are to the pixel before: the usual
/// reading first.
const CANDIDATES: [(bool, bool); 4] = [(false, false), (false, true), (true, false), (true, true)];

impl Search {
    /// Looks at `rows` of a band, from top to bottom: `read`, of half a and of half b, and `prepared` hold them, and the row
    /// below where the picture has one.
    pub fn look(&mut self, read: &[AsRead; 2], prepared: &Prepared, rows: Range<usize>) {
        for (role, of_role) in self.sums.iter_mut().enumerate() {
            for (of_candidate, (is_across, is_backward)) in of_role.iter_mut().zip(CANDIDATES) {
                let axis = if is_across { 1 - role } else { role };
                for (h, sums) in of_candidate.iter_mut().enumerate() {
                    correlate(&read[h][role], prepared, 1 - h, (axis, is_backward), rows.clone(), sums);
                }
            }
        }
        let of_row = |image: &Image, y: usize| -> usize {
            (0..3).map(|k| image.row(k, y).iter().filter(|v| !v.is_finite()).count()).sum()
        };
        self.unusable +=
            read.iter().flatten().map(|image| rows.clone().map(|y| of_row(image, y)).sum::<usize>()).sum::<usize>();
    }

    /// What all rows together say, and what a person should know. None where differences are not what they claim to be.
    pub fn finish(&self, strength: f32) -> (Option<Readings>, Vec<String>) {
        let of_roles = [0, 1].map(|role| self.reading(role));
        let mut said = Vec::new();
        for (role, reading) in of_roles.iter().enumerate() {
            if reading.correlation < LEAST_CORRELATION {
                said.push(format!(
                    "{} does not follow the differences of the picture (correlation {:.2}): dx and dy are not used",
                    AXES[role], reading.correlation
                ));
                return (None, said);
            }
            if !reading.is_usual(role) {
                said.push(format!("{} is {reading}: taken as such", AXES[role]));
            }
        }
        if of_roles[0].axis == of_roles[1].axis {
            let along = AXES_IN_WORDS[of_roles[0].axis];
            said.push(format!("dx and dy are both differences along {along}: they are not used"));
            return (None, said);
        }
        if self.unusable > 0 {
            said.push(format!("{} values of dx and dy are NaN or infinite: the term is left out there", self.unusable));
        }
        (Some(Readings { of_roles, strength }), said)
    }

    /// What `role` (0: dx, 1: dy) holds.
    fn reading(&self, role: usize) -> Reading {
        let candidates = [0, 1, 2, 3].map(|candidate| {
            let [a, b] = self.sums[role][candidate];
            let [product, own, other] = [0, 1, 2].map(|i| a[i] + b[i]);
            let correlation = if product == 0.0 { 0.0 } else { product / (own * other).sqrt() };
            let (is_across, is_backward) = CANDIDATES[candidate];
            let axis = if is_across { 1 - role } else { role };
            Reading { axis, is_backward, is_negated: correlation < 0.0, correlation: correlation.abs() }
        });
        let [usual, others @ ..] = candidates;
        let best = others
            .into_iter()
            .fold(usual, |best, other| if other.correlation > best.correlation { other } else { best });
        if usual.correlation >= AS_GOOD * best.correlation { usual } else { best }
    }
}

impl Reading {
    fn is_usual(&self, role: usize) -> bool {
        self.axis == role && !self.is_backward && !self.is_negated
    }
}

/// Adds, over `rows`, products of differences `g` as read with those of half `h`'s z, both relative to z̄.
fn correlate(
    g: &Image,
    prepared: &Prepared,
    h: usize,
    (axis, is_backward): (usize, bool),
    rows: Range<usize>,
    sums: &mut Sums,
) {
    let (height, width) = (prepared.height(), prepared.width());
    let z = |k: usize, (y, x): (usize, usize)| prepared.halves[h].at(DENOISED + k, y, x);
    let of_row = |y: usize| -> Sums {
        let mut sums = [0.0; 3];
        for x in 0..width {
            let Some(next) = neighbour(axis, y, x, height, width) else { continue };
            let (y_at, x_at) = if is_backward { next } else { (y, x) };
            if !prepared.is_valid(y * width + x) || !prepared.is_valid(next.0 * width + next.1) {
                continue;
            }
            let mean = FLOOR + (0..3).map(|k| z(k, (y, x)) + z(k, next)).sum::<f32>() / 6.0;
            for k in 0..3 {
                let relative = |v: f32| f64::from((v / mean).clamp(-LARGEST, LARGEST));
                let own = g.at(k, y_at, x_at) * prepared.exposure;
                if own.is_finite() {
                    let (own, other) = (relative(own), relative(z(k, next) - z(k, (y, x))));
                    [own * other, own * own, other * other].iter().zip(&mut sums).for_each(|(v, sum)| *sum += v);
                }
            }
        }
        sums
    };
    let of_rows: Vec<Sums> = rows.into_par_iter().map(of_row).collect();
    *sums = of_rows.iter().fold(*sums, |sums, row| [0, 1, 2].map(|i| sums[i] + row[i]));
}

const AXES_IN_WORDS: [&str; 2] = ["rows", "columns"];

impl fmt::Display for Reading {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = [["on the right", "below"], ["on the left", "above"]][usize::from(self.is_backward)][self.axis];
        // A backward difference of the usual sign is this pixel less the one before.
        match self.is_backward != self.is_negated {
            true => write!(out, "this pixel less the one {side}"),
            false => write!(out, "the pixel {side} less this one"),
        }
    }
}
