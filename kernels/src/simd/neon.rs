//! NEON of 64-bit Arm: 8 lanes in two registers.

use super::Simd;
use core::arch::aarch64::*;

/// Part of every 64-bit Arm target.
#[derive(Clone, Copy)]
pub(super) struct Neon;

type Pair = (float32x4_t, float32x4_t);

impl Simd for Neon {
    type F = Pair;
    const LANES: usize = 8;
    // 32 registers of 4 lanes.
    const REGISTERS: usize = 16;
    const CONV_OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load_from(self, p: *const f32) -> Pair {
        // SAFETY: every 64-bit Arm has NEON; the caller vouches for 8 values, which need no alignment.
        unsafe { (vld1q_f32(p), vld1q_f32(p.add(4))) }
    }
    #[inline(always)]
    unsafe fn store_to(self, p: *mut f32, v: Pair) {
        // SAFETY: as in `load_from`.
        unsafe {
            vst1q_f32(p, v.0);
            vst1q_f32(p.add(4), v.1);
        }
    }
    #[inline(always)]
    fn splat(self, v: f32) -> Pair {
        // SAFETY: every 64-bit Arm has NEON.
        unsafe { (vdupq_n_f32(v), vdupq_n_f32(v)) }
    }
    #[inline(always)]
    fn sum(self, a: Pair) -> f32 {
        // SAFETY: every 64-bit Arm has NEON.
        unsafe { vaddvq_f32(vaddq_f32(a.0, a.1)) }
    }
    #[inline(always)]
    fn exponent(self, u: Pair) -> (Pair, Pair) {
        // SAFETY: every 64-bit Arm has NEON.
        let half = |u: float32x4_t| unsafe {
            let biased = vshrq_n_s32::<23>(vreinterpretq_s32_f32(u));
            let e = vcvtq_f32_s32(vsubq_s32(biased, vdupq_n_s32(127)));
            (e, vreinterpretq_f32_s32(vshlq_n_s32::<23>(vsubq_s32(vdupq_n_s32(254), biased))))
        };
        let ((low, low_inverse), (high, high_inverse)) = (half(u.0), half(u.1));
        ((low, high), (low_inverse, high_inverse))
    }
    operations! { Pair:
        add(a, b) (vaddq_f32(a.0, b.0), vaddq_f32(a.1, b.1));
        sub(a, b) (vsubq_f32(a.0, b.0), vsubq_f32(a.1, b.1));
        mul(a, b) (vmulq_f32(a.0, b.0), vmulq_f32(a.1, b.1));
        div(a, b) (vdivq_f32(a.0, b.0), vdivq_f32(a.1, b.1));
        fma(a, b, c) (vfmaq_f32(c.0, a.0, b.0), vfmaq_f32(c.1, a.1, b.1));
        // The number where one operand is NaN, as on the other machines when it is the first.
        max(a, b) (vmaxnmq_f32(a.0, b.0), vmaxnmq_f32(a.1, b.1));
        sqrt(a) (vsqrtq_f32(a.0), vsqrtq_f32(a.1));
        abs(a) (vabsq_f32(a.0), vabsq_f32(a.1));
        where_positive(x, a) (
            vreinterpretq_f32_u32(vandq_u32(vcgtzq_f32(x.0), vreinterpretq_u32_f32(a.0))),
            vreinterpretq_f32_u32(vandq_u32(vcgtzq_f32(x.1), vreinterpretq_u32_f32(a.1))),
        );
        copysign(a, s) {
            let sign = vdupq_n_u32(1 << 31);
            (vbslq_f32(sign, s.0, a.0), vbslq_f32(sign, s.1, a.1))
        };
        round(x) (vrndnq_f32(x.0), vrndnq_f32(x.1));
        scale(a, n) {
            let (low, high) = (vshlq_n_s32::<23>(vcvtq_s32_f32(n.0)), vshlq_n_s32::<23>(vcvtq_s32_f32(n.1)));
            (
                vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(a.0), low)),
                vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(a.1), high)),
            )
        };
    }
}
