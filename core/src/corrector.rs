//! From network to picture: parameters of every pixel, and g_c over the whole picture.

use crate::plan::{BLOCK_ROWS, Plan};
use crate::threads::at_once;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use sspc_kernels::gc::{Correction, ParameterPlanes, STRIP, Taps};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};

/// μ̂ of a picture, `[3, H, W]`, of activated `parameters` `[P, H, W]`; z of the windows where the plan
/// skips.
pub fn correct(isa: Isa, form: Form, windows: &Windows, taps: &Taps, parameters: &Image, plan: &Plan) -> Image {
    let (height, width) = (windows.height(), windows.width());
    let mut out = Image::zeros(3, height, width);
    if out.data().is_empty() {
        return out;
    }
    let runs = plan.runs();
    let Jobs { rows: job_rows, by_strips } = Jobs::new(height, width, at_once());
    let [r, g, b] = out.planes_mut();
    let jobs = r.par_chunks_mut(job_rows * width).zip(g.par_chunks_mut(job_rows * width));
    jobs.zip(b.par_chunks_mut(job_rows * width)).enumerate().for_each_init(Vec::new, |scratch, (job, rows)| {
        let mut rows = [rows.0.0, rows.0.1, rows.1];
        let top = job * job_rows;
        rows.iter_mut().enumerate().for_each(|(k, rows)| denoised_rows(windows, k, top, rows));
        let first = runs.partition_point(|run| run.top < top);
        let last = runs.partition_point(|run| run.top < top + job_rows);
        for region in stacked(&runs[first..last]) {
            let view = ParameterPlanes::of_picture(form, parameters.data(), windows, &region);
            let job = Correction { windows, taps, region, parameters: view };
            if by_strips {
                let of_strip = |strip: Correction| {
                    let mut corrected = vec![0.0; 3 * strip.region.pixels()];
                    strip.forward(isa, &mut corrected);
                    (strip.region, corrected)
                };
                let strips: Vec<_> = job.in_parts(1).into_par_iter().map(of_strip).collect();
                strips.iter().for_each(|(region, corrected)| put(region, top, corrected, width, &mut rows));
                continue;
            }
            scratch.resize(3 * region.pixels(), 0.0);
            job.forward(isa, scratch);
            put(&region, top, scratch, width, &mut rows);
        }
    });
    out
}

/// Means of further planes of a picture by g_c's weights, given region by region of what the plan computes: the region and its
/// means, `[planes, region.height, region.width]`.
pub fn means(
    isa: Isa,
    form: Form,
    windows: &Windows,
    planes: &PaddedPlanes,
    taps: &Taps,
    parameters: &Image,
    plan: &Plan,
) -> Vec<(Region, Vec<f32>)> {
    let job_rows = Jobs::new(windows.height(), windows.width(), at_once()).rows;
    let runs = plan.runs();
    let jobs = (0..windows.height()).step_by(job_rows).flat_map(|top| {
        let first = runs.partition_point(|run| run.top < top);
        let last = runs.partition_point(|run| run.top < top + job_rows);
        stacked(&runs[first..last])
    });
    let jobs: Vec<Region> = jobs.collect();
    let of_job = |region: Region| {
        let mut out = vec![0.0; planes.count() * region.pixels()];
        let parameters = ParameterPlanes::of_picture(form, parameters.data(), windows, &region);
        Correction { windows, taps, region, parameters }.means(isa, planes, &mut out);
        (region, out)
    };
    jobs.into_par_iter().map(of_job).collect()
}

/// How g_c over a picture is divided: rows at a time, and whether each strip of theirs is a task of its own.
pub struct Jobs {
    /// Many, because g_c shares work between the rows of a region, but not so many that a thread is left without.
    pub rows: usize,
    /// Strips share nothing, so that this costs little.
    pub by_strips: bool,
}

impl Jobs {
    /// For a picture of `height` x `width` where so many threads can run at once.
    pub fn new(height: usize, width: usize, threads: usize) -> Self {
        let wanted = 2 * threads.max(1);
        let share = height * width.div_ceil(STRIP) / wanted;
        let rows = (share / BLOCK_ROWS).clamp(1, 8) * BLOCK_ROWS;
        Self { rows, by_strips: height.div_ceil(rows) < wanted }
    }
}

/// Runs of blocks, in row order, as regions: those that lie exactly below one another as one.
fn stacked(runs: &[Region]) -> Vec<Region> {
    let mut regions: Vec<Region> = Vec::new();
    for run in runs {
        let is_above = |r: &&mut Region| (r.left, r.width, r.top + r.height) == (run.left, run.width, run.top);
        match regions.iter_mut().find(is_above) {
            Some(above) => above.height += run.height,
            None => regions.push(*run),
        }
    }
    regions
}

/// z of the windows, rows from `top` on.
fn denoised_rows(windows: &Windows, k: usize, top: usize, rows: &mut [f32]) {
    for (y, row) in rows.chunks_exact_mut(windows.width()).enumerate() {
        let from = (DENOISED + k) * windows.plane() + windows.offset(top + y, 0);
        row.copy_from_slice(&windows.data()[from..from + windows.width()]);
    }
}

/// Puts a corrected region into rows of which the first is `top`. Where a correction is not finite z
/// stays: parameters from outside this program may be anything.
fn put(region: &Region, top: usize, corrected: &[f32], width: usize, rows: &mut [&mut [f32]; 3]) {
    for i in 0..region.pixels() {
        let value: [f32; 3] = std::array::from_fn(|k| corrected[k * region.pixels() + i]);
        if value.iter().all(|v| v.is_finite()) {
            let at = (region.top - top + i / region.width) * width + region.left + i % region.width;
            (0..3).for_each(|k| rows[k][at] = value[k]);
        }
    }
}
