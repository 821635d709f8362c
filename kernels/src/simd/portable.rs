//! Plain f32 arithmetic in groups of 8, which any compiler target can run.

use super::Simd;

#[derive(Clone, Copy)]
pub struct Portable;

const LANES: usize = 8;
/// Adding and taking away 1.5 * 2^23 rounds to the nearest whole number.
const ROUND: f32 = 12_582_912.0;

#[derive(Clone, Copy)]
#[repr(align(32))]
pub struct Lanes([f32; LANES]);

#[inline(always)]
fn map(a: Lanes, f: impl Fn(f32) -> f32) -> Lanes {
    Lanes(std::array::from_fn(|i| f(a.0[i])))
}

#[inline(always)]
fn zip(a: Lanes, b: Lanes, f: impl Fn(f32, f32) -> f32) -> Lanes {
    Lanes(std::array::from_fn(|i| f(a.0[i], b.0[i])))
}

// SAFETY (whole impl): only `load` and `store` touch memory, through unaligned accesses of 8
// values that the trait's contract makes valid.
impl Simd for Portable {
    type F = Lanes;
    const LANES: usize = LANES;
    const REGISTERS: usize = 16;
    const CONV_OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load(p: *const f32) -> Lanes {
        Lanes(unsafe { p.cast::<[f32; LANES]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(p: *mut f32, v: Lanes) {
        unsafe { p.cast::<[f32; LANES]>().write_unaligned(v.0) }
    }
    #[inline(always)]
    unsafe fn splat(v: f32) -> Lanes {
        Lanes([v; LANES])
    }
    #[inline(always)]
    unsafe fn add(a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn sub(a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn mul(a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn div(a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| a / b)
    }
    // Without FMA in the target `mul_add` is a library call: a rounded product is the fast way.
    #[inline(always)]
    unsafe fn fma(a: Lanes, b: Lanes, c: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| a.0[i] * b.0[i] + c.0[i]))
    }
    #[inline(always)]
    unsafe fn max(a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn sqrt(a: Lanes) -> Lanes {
        map(a, f32::sqrt)
    }
    #[inline(always)]
    unsafe fn where_positive(x: Lanes, a: Lanes) -> Lanes {
        zip(x, a, |x, a| if x > 0.0 { a } else { 0.0 })
    }
    #[inline(always)]
    unsafe fn copysign(a: Lanes, s: Lanes) -> Lanes {
        zip(a, s, f32::copysign)
    }
    #[inline(always)]
    unsafe fn abs(a: Lanes) -> Lanes {
        map(a, f32::abs)
    }
    #[inline(always)]
    unsafe fn sum(a: Lanes) -> f32 {
        a.0.iter().sum()
    }
    #[inline(always)]
    unsafe fn round(x: Lanes) -> Lanes {
        map(x, |x| (x + ROUND) - ROUND)
    }
    #[inline(always)]
    unsafe fn scale(a: Lanes, n: Lanes) -> Lanes {
        // The lowest bits of the sum are n's; a conversion to integers would go lane by lane.
        zip(a, n, |a, n| f32::from_bits(a.to_bits().wrapping_add((n + ROUND).to_bits() << 23)))
    }
    #[inline(always)]
    unsafe fn exponent(u: Lanes) -> (Lanes, Lanes) {
        let biased = |u: f32| u.to_bits() >> 23;
        let e = map(u, |u| biased(u) as i32 as f32 - 127.0);
        (e, map(u, |u| f32::from_bits((254 - biased(u)) << 23)))
    }
}
