//! AVX2 with FMA: 8 lanes.

use super::{Kernel, Simd};
use core::arch::x86_64::*;

/// Exists only on machines with AVX2 and FMA: [`run`] alone makes one.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// # Safety
/// The machine must have AVX2 and FMA.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2(()))
}

impl Simd for Avx2 {
    type F = __m256;
    const LANES: usize = 8;
    const REGISTERS: usize = 16;
    const CONV_OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load_from(self, p: *const f32) -> __m256 {
        // SAFETY: AVX2 by the token; the caller vouches for 8 values, and the load is an unaligned one.
        unsafe { _mm256_loadu_ps(p) }
    }
    #[inline(always)]
    unsafe fn store_to(self, p: *mut f32, v: __m256) {
        // SAFETY: as in `load_from`.
        unsafe { _mm256_storeu_ps(p, v) }
    }
    #[inline(always)]
    fn splat(self, v: f32) -> __m256 {
        // SAFETY: AVX2 by the token.
        unsafe { _mm256_set1_ps(v) }
    }
    #[inline(always)]
    fn sum(self, a: __m256) -> f32 {
        // SAFETY: AVX2 by the token.
        unsafe {
            let four = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }
    #[inline(always)]
    fn exponent(self, u: __m256) -> (__m256, __m256) {
        // SAFETY: AVX2 by the token.
        unsafe {
            let biased = _mm256_srli_epi32::<23>(_mm256_castps_si256(u));
            let e = _mm256_cvtepi32_ps(_mm256_sub_epi32(biased, _mm256_set1_epi32(127)));
            let inverse = _mm256_slli_epi32::<23>(_mm256_sub_epi32(_mm256_set1_epi32(254), biased));
            (e, _mm256_castsi256_ps(inverse))
        }
    }
    operations! { __m256:
        add(a, b) _mm256_add_ps(a, b);
        sub(a, b) _mm256_sub_ps(a, b);
        mul(a, b) _mm256_mul_ps(a, b);
        div(a, b) _mm256_div_ps(a, b);
        fma(a, b, c) _mm256_fmadd_ps(a, b, c);
        max(a, b) _mm256_max_ps(a, b);
        sqrt(a) _mm256_sqrt_ps(a);
        abs(a) _mm256_andnot_ps(_mm256_set1_ps(-0.0), a);
        where_positive(x, a) _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(x, _mm256_setzero_ps()), a);
        copysign(a, s) {
            let sign = _mm256_set1_ps(-0.0);
            _mm256_or_ps(_mm256_and_ps(sign, s), _mm256_andnot_ps(sign, a))
        };
        round(x) _mm256_round_ps::<0x08>(x);
        scale(a, n) {
            let shift = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
            _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(a), shift))
        };
    }
}
