//! g_c over pictures and tiles of them, on all threads.

use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use sspc_kernels::gc::{Correction, ParameterPlanes, Taps};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};

/// g_c over a picture, or over a tile of one.
#[derive(Clone, Copy)]
pub struct PictureCorrection<'a> {
    /// Instruction set of g_c.
    pub isa: Isa,
    /// Form of the parameters.
    pub form: Form,
    /// Features of all pixels.
    pub windows: &'a Windows,
    /// Window of g_c.
    pub taps: &'a Taps,
    /// Activated, `[P, H, W]`.
    pub parameters: &'a Image,
    /// What is computed, as a plan says.
    pub runs: &'a [Region],
    /// In how many tasks at least what lies together is divided, which does not show.
    pub parts: usize,
}

impl PictureCorrection<'_> {
    /// μ̂ `[3, H, W]`; z where nothing is computed, and where a correction is not finite: parameters from outside this program
    /// may be anything.
    pub fn corrected(self) -> Image {
        let windows = self.windows;
        let mut out = Image::from_rows(3, windows.height(), windows.width(), |k, y, row| {
            let from = (DENOISED + k) * windows.plane() + windows.offset(y, 0);
            row.copy_from_slice(&windows.data()[from..from + row.len()]);
        });
        let computed = self.each(3, |job, out| job.forward(self.isa, out));
        computed.iter().for_each(|(region, corrected)| put(region, corrected, &mut out));
        out
    }

    /// Means of further planes by g_c's weights, region by region of what is computed: the region and its means,
    /// `[planes, region.height, region.width]`.
    pub fn means(self, planes: &PaddedPlanes) -> Vec<(Region, Vec<f32>)> {
        self.each(planes.count(), |job, out| job.means(self.isa, planes, out))
    }

    /// What `compute` makes of every task, so many planes each.
    fn each(self, planes: usize, compute: impl Fn(Correction, &mut [f32]) + Sync) -> Vec<(Region, Vec<f32>)> {
        let Self { form, windows, taps, parameters, .. } = self;
        let jobs = stacked(self.runs).into_iter().flat_map(|region| {
            let parameters = ParameterPlanes::of_picture(form, parameters.data(), windows, &region);
            // Strips share nothing, so that they cost nothing as tasks of their own.
            Correction { windows, taps, region, parameters }.in_parts(self.parts)
        });
        let of_job = |job: Correction| {
            let mut out = vec![0.0; planes * job.region.pixels()];
            compute(job, &mut out);
            (job.region, out)
        };
        jobs.collect::<Vec<_>>().into_par_iter().map(of_job).collect()
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

/// Puts what is finite of a corrected region in its place.
fn put(region: &Region, corrected: &[f32], out: &mut Image) {
    let (pixels, of_row) = (region.pixels(), out.width());
    let [red, green, blue] = out.planes_mut();
    for y in 0..region.height {
        let at = (region.top + y) * of_row + region.left;
        for x in 0..region.width {
            let value: [f32; 3] = std::array::from_fn(|k| corrected[k * pixels + y * region.width + x]);
            if value.iter().all(|v| v.is_finite()) {
                [red[at + x], green[at + x], blue[at + x]] = value;
            }
        }
    }
}
