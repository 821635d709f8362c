//! g_c over pictures and tiles of them, on all threads.

use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use sspc_kernels::gc::{Correction, JointCorrection, ParameterPlanes, Taps, View};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::{PaddedPlanes, Windows};

/// g_c over a picture, or over a tile of one, by several views at once.
#[derive(Clone)]
pub struct PictureCorrection<'a> {
    /// Instruction set of g_c.
    pub isa: Isa,
    /// Windows of all pixels, and their parameters.
    pub views: Vec<View<'a>>,
    /// Window of g_c.
    pub taps: &'a Taps,
    /// What is computed, as a plan says.
    pub runs: &'a [Region],
    /// In how many tasks at least it is divided, which does not show.
    pub parts: usize,
}

impl<'a> PictureCorrection<'a> {
    /// By one view: windows and activated parameters `[P, H, W]` of all pixels.
    pub fn of_one(
        isa: Isa,
        form: Form,
        windows: &'a Windows,
        taps: &'a Taps,
        parameters: &'a Image,
        runs: &'a [Region],
    ) -> Self {
        Self { isa, views: vec![view(form, windows, windows, parameters)], taps, runs, parts: 1 }
    }

    /// μ̂ `[3, H, W]` by every view; z where nothing is computed, and where a correction is not finite: parameters from outside
    /// this program may be anything.
    pub fn corrected(&self) -> Vec<Image> {
        let z = |view: &View| {
            let guides = view.guides;
            Image::from_rows(3, guides.height(), guides.width(), |k, y, row| {
                let from = (DENOISED + k) * guides.plane() + guides.offset(y, 0);
                row.copy_from_slice(&guides.data()[from..from + row.len()]);
            })
        };
        let mut pictures: Vec<Image> = self.views.iter().map(z).collect();
        for (region, corrected) in self.each(3 * self.views.len(), |job, out| job.forward(self.isa, out)) {
            for (picture, corrected) in pictures.iter_mut().zip(corrected.chunks_exact(3 * region.pixels())) {
                put(&region, corrected, picture);
            }
        }
        pictures
    }

    /// Means of further planes by the weights of the only view, region by region of what is computed: the region and its means,
    /// `[planes, region.height, region.width]`.
    ///
    /// # Panics
    /// When there are several views.
    pub fn means(&self, planes: &PaddedPlanes) -> Vec<(Region, Vec<f32>)> {
        self.each(planes.count(), |JointCorrection { views, taps, region }, out| {
            let [View { guides: windows, parameters, .. }] = views[..] else { panic!("means by several views") };
            Correction { windows, taps, region, parameters }.means(self.isa, planes, out);
        })
    }

    /// What `compute` makes of every task, so many planes each.
    fn each(&self, planes: usize, compute: impl Fn(JointCorrection, &mut [f32]) + Sync) -> Vec<(Region, Vec<f32>)> {
        let whole = |windows: &Windows| Region::whole(windows.height(), windows.width());
        let Some(region) = self.views.first().map(|view| whole(view.guides)) else { return Vec::new() };
        let whole = JointCorrection { views: self.views.clone(), taps: self.taps, region };
        let regions = stacked(self.runs);
        // Strips share nothing, so that they cost nothing as tasks of their own.
        let parts = self.parts.div_ceil(regions.len().max(1));
        let jobs = regions.into_iter().flat_map(|region| whole.clone().within(region).in_parts(parts));
        let of_job = |job: JointCorrection| {
            let (region, mut out) = (job.region, vec![0.0; planes * job.region.pixels()]);
            compute(job, &mut out);
            (region, out)
        };
        jobs.collect::<Vec<_>>().into_par_iter().map(of_job).collect()
    }
}

/// What a view is made of: windows of radiance and of the guides, and activated parameters `[P, H, W]` of all pixels.
pub fn view<'a>(form: Form, radiance: &'a Windows, guides: &'a Windows, parameters: &'a Image) -> View<'a> {
    let whole = Region::whole(parameters.height(), parameters.width());
    View { radiance, guides, parameters: ParameterPlanes::of_region(form, parameters.data(), &whole) }
}

/// Runs of blocks, in row order, as regions: those that lie exactly below one another as one.
fn stacked(runs: &[Region]) -> Vec<Region> {
    let mut regions: Vec<Region> = Vec::new();
    // Regions that end where this row of blocks begins, and those that go on in it.
    let (mut above, mut here, mut top) = (Vec::new(), Vec::new(), 0);
    for run in runs {
        if run.top != top {
            (above, here, top) = (here, Vec::new(), run.top);
        }
        let fits = |at: &&usize| {
            let region: &Region = &regions[**at];
            (region.left, region.width, region.top + region.height) == (run.left, run.width, run.top)
        };
        let at = above.iter().find(fits).copied().unwrap_or(regions.len());
        match regions.get_mut(at) {
            Some(region) => region.height += run.height,
            None => regions.push(*run),
        }
        here.push(at);
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
