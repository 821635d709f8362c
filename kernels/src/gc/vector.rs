//! Vectors of pixels: loads, stores, and three components at a time.

use super::strip::PITCH;
use crate::simd::{MAX_LANES, Simd};

/// Loads `lanes` of a row; the rest of the vector is zero.
///
/// # Safety
/// The machine must have `S`.
#[inline(always)]
pub(crate) unsafe fn load_lanes<S: Simd>(source: &[f32], at: usize, lanes: usize) -> S::F {
    unsafe {
        if lanes == S::LANES {
            S::load(source[at..at + S::LANES].as_ptr())
        } else {
            let mut rest = [0.0; MAX_LANES];
            rest[..lanes].copy_from_slice(&source[at..at + lanes]);
            S::load(rest.as_ptr())
        }
    }
}

/// `N` vectors, the first of them `first` vectors after `from`.
#[inline(always)]
pub(super) unsafe fn vectors<S: Simd, const N: usize>(from: *const f32, first: usize) -> [S::F; N] {
    unsafe {
        let mut values = [S::zero(); N];
        for (i, v) in values.iter_mut().enumerate() {
            *v = S::load(from.add((first + i) * S::LANES));
        }
        values
    }
}

#[inline(always)]
pub(super) unsafe fn store_vectors<S: Simd, const N: usize>(to: *mut f32, first: usize, values: [S::F; N]) {
    for (i, v) in values.into_iter().enumerate() {
        unsafe { S::store(to.add((first + i) * S::LANES), v) }
    }
}

/// Three planes of a copied row.
#[inline(always)]
pub(super) unsafe fn load3<S: Simd>(at: *const f32) -> [S::F; 3] {
    unsafe { [S::load(at), S::load(at.add(PITCH)), S::load(at.add(2 * PITCH))] }
}

#[inline(always)]
pub(super) unsafe fn difference<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> [S::F; 3] {
    unsafe { [S::sub(a[0], b[0]), S::sub(a[1], b[1]), S::sub(a[2], b[2])] }
}

#[inline(always)]
pub(super) unsafe fn dot<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    unsafe { S::fma(a[2], b[2], S::fma(a[1], b[1], S::mul(a[0], b[0]))) }
}

#[inline(always)]
pub(super) unsafe fn squared<S: Simd>(d: &[S::F; 3]) -> S::F {
    unsafe { dot::<S>(d, d) }
}

#[inline(always)]
pub(super) unsafe fn accumulate<S: Simd>(sums: &mut [S::F; 3], weight: S::F, values: &[S::F; 3]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum = unsafe { S::fma(weight, *value, *sum) };
    }
}
