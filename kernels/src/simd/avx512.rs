//! AVX-512F: 16 lanes.

use super::{Kernel, Simd};
use core::arch::x86_64::*;

/// Exists only on machines with AVX-512F: [`run`] alone makes one.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

/// # Safety
/// The machine must have AVX-512F.
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512(()))
}

impl Simd for Avx512 {
    type F = __m512;
    const LANES: usize = 16;
    const REGISTERS: usize = 32;
    const CONV_OUTPUTS: usize = 8;

    #[inline(always)]
    unsafe fn load_from(self, p: *const f32) -> __m512 {
        // SAFETY: AVX-512F by the token; the caller vouches for 16 values, and the load is an unaligned one.
        unsafe { _mm512_loadu_ps(p) }
    }
    #[inline(always)]
    unsafe fn store_to(self, p: *mut f32, v: __m512) {
        // SAFETY: as in `load_from`.
        unsafe { _mm512_storeu_ps(p, v) }
    }
    #[inline(always)]
    fn splat(self, v: f32) -> __m512 {
        // SAFETY: AVX-512F by the token.
        unsafe { _mm512_set1_ps(v) }
    }
    #[inline(always)]
    fn sum(self, a: __m512) -> f32 {
        // SAFETY: AVX-512F by the token.
        unsafe { _mm512_reduce_add_ps(a) }
    }
    #[inline(always)]
    fn exponent(self, u: __m512) -> (__m512, __m512) {
        // SAFETY: AVX-512F by the token.
        unsafe {
            let power = _mm512_and_epi32(_mm512_castps_si512(u), _mm512_set1_epi32(0x7f80_0000));
            let inverse = _mm512_sub_epi32(_mm512_set1_epi32(0x7f00_0000), power);
            (_mm512_getexp_ps(u), _mm512_castsi512_ps(inverse))
        }
    }
    operations! { __m512:
        add(a, b) _mm512_add_ps(a, b);
        sub(a, b) _mm512_sub_ps(a, b);
        mul(a, b) _mm512_mul_ps(a, b);
        div(a, b) _mm512_div_ps(a, b);
        fma(a, b, c) _mm512_fmadd_ps(a, b, c);
        max(a, b) _mm512_max_ps(a, b);
        sqrt(a) _mm512_sqrt_ps(a);
        abs(a) _mm512_abs_ps(a);
        where_positive(x, a) _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, _mm512_setzero_ps()), a);
        copysign(a, s) {
            let sign = _mm512_set1_epi32(i32::MIN);
            let bits = _mm512_ternarylogic_epi32::<0xE4>(_mm512_castps_si512(s), _mm512_castps_si512(a), sign);
            _mm512_castsi512_ps(bits)
        };
        round(x) _mm512_roundscale_ps::<0x08>(x);
        scale(a, n) _mm512_scalef_ps(a, n);
    }
}
