//! Rows in runs of pixels, as arrays: what is computed of arrays alone, the compiler turns into vectors, as wide as the
//! machine's under [`widest`]. Plain arithmetic gives the same bits with any.

use sspc_kernels::simd::{Isa, Kernel, dispatch};

/// Pixels of a run, as many as a [block](crate::plan::BLOCK_COLUMNS) has.
pub(crate) const LANES: usize = crate::plan::BLOCK_COLUMNS;

/// Runs a kernel with the widest vectors that the machine has.
pub(crate) fn widest<K: Kernel>(kernel: K) -> K::Output {
    dispatch(Isa::best(), kernel)
}

/// The pixels of a row from column `x` on; 0 beyond its end.
#[inline(always)]
pub(crate) fn lanes(row: &[f32], x: usize) -> [f32; LANES] {
    match row[x..].first_chunk() {
        Some(values) => *values,
        None => {
            let mut values = [0.0; LANES];
            values.iter_mut().zip(&row[x..]).for_each(|(to, value)| *to = *value);
            values
        }
    }
}

/// The same of three rows.
#[inline(always)]
pub(crate) fn lanes_of_colour(rows: &[&[f32]; 3], x: usize) -> [[f32; LANES]; 3] {
    [lanes(rows[0], x), lanes(rows[1], x), lanes(rows[2], x)]
}

/// Puts a run into a row, as far as that goes.
#[inline(always)]
pub(crate) fn put(row: &mut [f32], x: usize, values: &[f32; LANES]) {
    match row[x..].first_chunk_mut() {
        Some(to) => *to = *values,
        None => row[x..].iter_mut().zip(values).for_each(|(to, value)| *to = *value),
    }
}

/// p - q
#[inline(always)]
pub(crate) fn less(p: &[f32; LANES], q: &[f32; LANES]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = p[i] - q[i];
    }
    out
}

/// p + share (q - p)
#[inline(always)]
pub(crate) fn mixed(p: &[f32; LANES], q: &[f32; LANES], share: &[f32; LANES]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = p[i] + share[i] * (q[i] - p[i]);
    }
    out
}

/// ‖p‖² by pixel.
#[inline(always)]
pub(crate) fn squared(p: &[[f32; LANES]; 3]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = p[0][i] * p[0][i] + p[1][i] * p[1][i] + p[2][i] * p[2][i];
    }
    out
}
