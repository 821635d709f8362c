//! How files keep a value.

use half::f16;

/// The sample type of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// Half floats; what is too large for them keeps their 11 bits, in a channel of single floats.
    Half,
    /// Single floats.
    Float,
}

impl Storage {
    /// The nearest value that is kept.
    pub fn round(self, value: f64) -> f32 {
        match self {
            Storage::Float => value as f32,
            Storage::Half if value.abs() < f64::from(f16::MAX) => f16::from_f64(value).to_f32(),
            // 2^13: the lowest 13 of f32's 23 stored bits are beyond a half float's precision.
            Storage::Half => f32::from_bits((value as f32).to_bits().saturating_add(1 << 12) & !((1 << 13) - 1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_keep_eleven_bits_even_beyond_half_floats() {
        assert_eq!(Storage::Half.round(1.0 + 0.4 / 1024.0), 1.0);
        assert_eq!(Storage::Half.round(-1e-9), -0.0);
        assert_eq!(Storage::Half.round(65504.0), 65504.0);
        assert_eq!(Storage::Half.round(1e6), 999_936.0);
        assert_eq!(Storage::Float.round(0.1), 0.1f32);
    }
}
