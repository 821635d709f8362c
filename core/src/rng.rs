//! A small deterministic generator (SplitMix64, Steele et al. 2014): the same numbers for a seed on
//! every machine, for any number of threads.

/// The generator.
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
}

impl Rng {
    /// One that gives the numbers of this seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// A generator with numbers of its own for every `stream`, given the seed of this one: itself for stream 0.
    pub fn stream(self, stream: u64) -> Self {
        if stream == 0 {
            return self;
        }
        // A state that another stream reaches by counting on would lie on the same sequence: so it is mixed.
        Self::new(Self::new(self.state ^ stream.rotate_left(32)).next_u64())
    }

    /// The next 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in 0..n.
    ///
    /// # Panics
    /// When `n` is zero.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }

    /// Samples an index by weight, given inclusive prefix sums of positive weights.
    ///
    /// # Panics
    /// When there are none.
    pub fn index(&mut self, cumulative: &[f64]) -> usize {
        let last = cumulative.len() - 1;
        let uniform = (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        cumulative.partition_point(|sum| *sum <= uniform * cumulative[last]).min(last)
    }

    /// Standard normal (Box and Muller 1958).
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * (1.0 - f64::from(self.uniform())).ln()).sqrt();
        (radius * (std::f64::consts::TAU * f64::from(self.uniform())).cos()) as f32
    }

    /// The items in random order (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_of_a_seed_have_numbers_of_their_own() {
        let first = |stream: u64| {
            let mut rng = Rng::new(7).stream(stream);
            [0; 64].map(|_| rng.next_u64())
        };
        let mut plain = Rng::new(7);
        assert_eq!(first(0), [0; 64].map(|_| plain.next_u64()));
        let mut all: Vec<u64> = (0..100).flat_map(first).collect();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 6400, "streams that meet");
    }

    #[test]
    fn an_index_is_drawn_by_its_weight() {
        let mut rng = Rng::new(1);
        let mut counts = [0; 3];
        (0..40_000).for_each(|_| counts[rng.index(&[1.0, 1.5, 4.0])] += 1);
        for (count, expected) in counts.iter().zip([10_000, 5_000, 25_000]) {
            // Five standard deviations.
            assert!(i32::abs(count - expected) < 500, "{counts:?}");
        }
        assert_eq!(rng.index(&[0.5]), 0);
    }
}
