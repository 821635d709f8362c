//! What each half weighs in a mean of both: its share of the samples.

use crate::Image;

/// Weights of half a and of half b, which add up to 1.
///
/// The variance of a half is inversely proportional to its samples, so the mean by samples has the least noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfWeights([f32; 2]);

impl HalfWeights {
    /// Halves of equally many samples.
    pub const EQUAL: Self = Self([0.5; 2]);

    /// By the samples of half a and of half b, both finite and above 0; equal where they are not.
    pub fn of_samples([a, b]: [f64; 2]) -> Self {
        let is_count = |n: f64| n.is_finite() && n > 0.0;
        if !is_count(a) || !is_count(b) {
            return Self::EQUAL;
        }
        let a = (a / (a + b)) as f32;
        Self([a, 1.0 - a])
    }

    /// Weight of half `h`, 0 or 1.
    ///
    /// # Panics
    /// When there is no such half.
    pub fn of(self, h: usize) -> f32 {
        self.0[h]
    }

    /// The mean of a value of each half; finite ones do not overflow.
    #[inline(always)]
    pub fn mean(self, a: f32, b: f32) -> f32 {
        self.0[0] * a + self.0[1] * b
    }

    /// The mean of an image of each half.
    ///
    /// # Panics
    /// When they differ in shape.
    pub fn mean_of(self, a: &Image, b: &Image) -> Image {
        assert!(a.same_size(b) && a.channels() == b.channels(), "mean of images of one shape");
        Image::from_rows(a.channels(), a.height(), a.width(), |c, y, row| {
            for ((v, a), b) in row.iter_mut().zip(a.row(c, y)).zip(b.row(c, y)) {
                *v = self.mean(*a, *b);
            }
        })
    }

    /// w_a w_b: with independent errors ‖p - q‖² of a picture of each half times this is the squared error of their mean.
    pub fn product(self) -> f32 {
        self.0[0] * self.0[1]
    }
}

impl Default for HalfWeights {
    fn default() -> Self {
        Self::EQUAL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_shares_of_the_samples() {
        let HalfWeights([a, b]) = HalfWeights::of_samples([32.0, 8.0]);
        assert_eq!((a, a + b), (0.8, 1.0));
        assert_eq!(HalfWeights::of_samples([17.0, 17.0]), HalfWeights::EQUAL);
        for nonsense in [[0.0, 1.0], [1.0, f64::NAN], [f64::INFINITY, 1.0], [-1.0, 3.0]] {
            assert_eq!(HalfWeights::of_samples(nonsense), HalfWeights::EQUAL);
        }
    }

    #[test]
    fn equal_weights_give_the_mean_bit_for_bit() {
        let image = |factor: f32| Image::from_fn(2, 3, 5, |c, y, x| factor * (c * 15 + y * 5 + x) as f32 / 7.0);
        let (a, b) = (image(0.1), image(f32::MAX / 5.0));
        assert_eq!(HalfWeights::EQUAL.mean_of(&a, &b).data(), Image::mean_of(&a, &b).data());
    }
}
