//! Rows in runs of pixels, as arrays: what is computed of arrays alone, the compiler turns into vectors, as wide as the
//! machine's under [`widest`]. Plain arithmetic gives the same bits with any.

use sspc_kernels::simd::{Isa, Kernel, dispatch};
use std::sync::OnceLock;

/// Pixels of a run, as many as a [block](crate::plan::BLOCK_COLUMNS) has.
pub(crate) const LANES: usize = crate::plan::BLOCK_COLUMNS;

/// Runs a kernel with the widest vectors that the machine has, or those that `SSPC_ISA` asks for.
pub(crate) fn widest<K: Kernel>(kernel: K) -> K::Output {
    static ISA: OnceLock<Isa> = OnceLock::new();
    dispatch(*ISA.get_or_init(|| Isa::from_env().unwrap_or_else(|_| Isa::best())), kernel)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use sspc_kernels::simd::Simd;

    /// Everything of this module on a row.
    struct All<'a> {
        rows: [&'a [f32]; 3],
        share: &'a [f32],
    }

    impl Kernel for All<'_> {
        type Output = Vec<f32>;

        #[inline(always)]
        fn run<S: Simd>(self, _: S) -> Vec<f32> {
            let mut out = vec![0.0; self.share.len()];
            for x in (0..out.len()).step_by(LANES) {
                let [r, g, b] = lanes_of_colour(&self.rows, x);
                let mixed = mixed(&r, &g, &lanes(self.share, x));
                put(&mut out, x, &squared(&[mixed, less(&g, &b), b]));
            }
            out
        }
    }

    /// A compiler that fused multiplications and additions would be found here.
    #[test]
    fn every_instruction_set_gives_the_bits_of_one_pixel_after_the_other() {
        let rng = &mut Rng::new(4);
        for width in [1, 15, 16, 17, 40] {
            let mut row = || -> Vec<f32> { (0..width).map(|_| (3.0 * rng.normal()).exp()).collect() };
            let (rows, share) = ([row(), row(), row()], row());
            let expected = |x: usize| {
                let [r, g, b] = rows.each_ref().map(|row| row[x]);
                let mixed = r + share[x] * (g - r);
                mixed * mixed + (g - b) * (g - b) + b * b
            };
            let expected: Vec<f32> = (0..width).map(expected).collect();
            for isa in Isa::available() {
                let all = All { rows: rows.each_ref().map(|row| &row[..]), share: &share };
                assert_eq!(dispatch(isa, all), expected, "{} of {width}", isa.name());
            }
        }
    }
}
