//! Vectors of pixels, several at a time.

use super::strip::PITCH;
use crate::simd::Simd;

/// `N` vectors, the first of them `first` vectors after the start of `from`.
#[inline(always)]
pub(super) fn load_vectors<S: Simd, const N: usize>(s: S, from: &[f32], first: usize) -> [S::F; N] {
    let from = &from[first * S::LANES..][..N * S::LANES];
    let mut values = [s.zero(); N];
    for (i, v) in values.iter_mut().enumerate() {
        *v = s.load(&from[i * S::LANES..]);
    }
    values
}

/// Writes vectors, the first of them `first` vectors after the start of `to`.
#[inline(always)]
pub(super) fn store_vectors<S: Simd, const N: usize>(s: S, to: &mut [f32], first: usize, values: [S::F; N]) {
    let to = &mut to[first * S::LANES..][..N * S::LANES];
    for (i, v) in values.into_iter().enumerate() {
        s.store(&mut to[i * S::LANES..], v);
    }
}

/// Adds vectors to those that stand there, the first of them `first` vectors after the start of `to`.
#[inline(always)]
pub(super) fn add_vectors<S: Simd, const N: usize>(s: S, to: &mut [f32], first: usize, values: [S::F; N]) {
    let to = &mut to[first * S::LANES..][..N * S::LANES];
    for (i, v) in values.into_iter().enumerate() {
        let slot = &mut to[i * S::LANES..];
        s.store(slot, s.add(s.load(slot), v));
    }
}

/// The planes `channel..channel + 3` of a copied row, which begins at the pixels.
#[inline(always)]
pub(super) fn load3<S: Simd>(s: S, row: &[f32], channel: usize) -> [S::F; 3] {
    let plane = |c: usize| s.load(&row[(channel + c) * PITCH..]);
    [plane(0), plane(1), plane(2)]
}

/// a - b
#[inline(always)]
pub(super) fn difference<S: Simd>(s: S, a: &[S::F; 3], b: &[S::F; 3]) -> [S::F; 3] {
    [s.sub(a[0], b[0]), s.sub(a[1], b[1]), s.sub(a[2], b[2])]
}

/// a · b
#[inline(always)]
pub(super) fn dot<S: Simd>(s: S, a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    s.fma(a[2], b[2], s.fma(a[1], b[1], s.mul(a[0], b[0])))
}

/// ‖d‖²
#[inline(always)]
pub(super) fn squared<S: Simd>(s: S, d: &[S::F; 3]) -> S::F {
    dot(s, d, d)
}

/// `factor` a
#[inline(always)]
pub(super) fn scaled<S: Simd>(s: S, a: &[S::F; 3], factor: S::F) -> [S::F; 3] {
    [s.mul(a[0], factor), s.mul(a[1], factor), s.mul(a[2], factor)]
}
