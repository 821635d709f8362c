//! Plain f32 arithmetic in groups of 8, which any compiler target can run.

use super::Simd;

/// No instruction set in particular.
#[derive(Clone, Copy)]
pub(super) struct Portable;

const LANES: usize = 8;
/// Adding and taking away 1.5 * 2^23 rounds to the nearest whole number.
const ROUND: f32 = 12_582_912.0;

#[derive(Clone, Copy)]
#[repr(align(32))]
pub(super) struct Lanes([f32; LANES]);

#[inline(always)]
fn map(a: Lanes, f: impl Fn(f32) -> f32) -> Lanes {
    Lanes(std::array::from_fn(|i| f(a.0[i])))
}

#[inline(always)]
fn zip(a: Lanes, b: Lanes, f: impl Fn(f32, f32) -> f32) -> Lanes {
    Lanes(std::array::from_fn(|i| f(a.0[i], b.0[i])))
}

impl Simd for Portable {
    type F = Lanes;
    const LANES: usize = LANES;
    const REGISTERS: usize = 16;
    const CONV_OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load_from(self, p: *const f32) -> Lanes {
        // SAFETY: the caller vouches for 8 values; they need no alignment.
        Lanes(unsafe { p.cast::<[f32; LANES]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store_to(self, p: *mut f32, v: Lanes) {
        // SAFETY: as in `load_from`.
        unsafe { p.cast::<[f32; LANES]>().write_unaligned(v.0) }
    }
    #[inline(always)]
    fn splat(self, v: f32) -> Lanes {
        Lanes([v; LANES])
    }
    #[inline(always)]
    fn add(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a / b)
    }
    // Without FMA in the target `mul_add` is a library call: a rounded product is the fast way.
    #[inline(always)]
    fn fma(self, a: Lanes, b: Lanes, c: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| a.0[i] * b.0[i] + c.0[i]))
    }
    #[inline(always)]
    fn max(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self, a: Lanes) -> Lanes {
        map(a, f32::sqrt)
    }
    #[inline(always)]
    fn where_positive(self, x: Lanes, a: Lanes) -> Lanes {
        zip(x, a, |x, a| if x > 0.0 { a } else { 0.0 })
    }
    #[inline(always)]
    fn copysign(self, a: Lanes, s: Lanes) -> Lanes {
        zip(a, s, f32::copysign)
    }
    #[inline(always)]
    fn abs(self, a: Lanes) -> Lanes {
        map(a, f32::abs)
    }
    #[inline(always)]
    fn sum(self, a: Lanes) -> f32 {
        a.0.iter().sum()
    }
    #[inline(always)]
    fn round(self, x: Lanes) -> Lanes {
        map(x, |x| (x + ROUND) - ROUND)
    }
    #[inline(always)]
    fn scale(self, a: Lanes, n: Lanes) -> Lanes {
        // The lowest bits of the sum are n's; a conversion to integers would go lane by lane.
        zip(a, n, |a, n| f32::from_bits(a.to_bits().wrapping_add((n + ROUND).to_bits() << 23)))
    }
    #[inline(always)]
    fn exponent(self, u: Lanes) -> (Lanes, Lanes) {
        let biased = |u: f32| u.to_bits() >> 23;
        let e = map(u, |u| biased(u) as i32 as f32 - 127.0);
        (e, map(u, |u| f32::from_bits((254 - biased(u)) << 23)))
    }
}
