//! Frames in memory.

use sspc_core::plan::Plan;
use sspc_core::prepare::{Findings, Prepared};
use sspc_core::rng::Rng;
use sspc_frames::error::Error;
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides, read_reference};
use sspc_image::{Frame, HalfBuffer, HalfWeights, Image, Reference, RoleSource};
use sspc_kernels::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, NORMAL, RADIANCE, VISIBILITY};
use std::ops::Deref;
use std::path::PathBuf;
use std::sync::Arc;

/// The folder of the repository's sample frame.
pub fn sample_folder() -> PathBuf {
    data("sample")
}

/// A folder of `tests/data`.
pub fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data").join(name)
}

/// A frame that was read, and what the reader said.
#[derive(Debug)]
pub struct ReadFrame {
    pub frame: Frame,
    pub sources: Vec<RoleSource>,
    pub warnings: Vec<String>,
}

impl Deref for ReadFrame {
    type Target = Frame;

    fn deref(&self) -> &Frame {
        &self.frame
    }
}

/// Reads all rows of a frame and looks them over, as the programs do.
///
/// # Errors
/// What the programs refuse.
pub fn read_frame(files: &FrameFiles, overrides: &RoleOverrides) -> Result<ReadFrame, Error> {
    let open = OpenFrame::open(files, overrides)?;
    let frame = open.rows(0..open.height())?;
    let mut inspection = open.inspection();
    inspection.look(&frame, 0, 0..open.height());
    let warnings = open.warnings(&inspection)?;
    Ok(ReadFrame { frame, sources: open.sources(), warnings })
}

/// The sample frame, 256 x 192, with every role but the full buffer's z.
///
/// # Panics
/// When it cannot be read.
pub fn sample() -> Frame {
    let folder = sample_folder();
    let files = FrameFiles::halves(folder.join("a.exr"), folder.join("b.exr"));
    read_frame(&files, &RoleOverrides::none()).expect("the sample frame").frame
}

/// The sample frame with every role.
///
/// # Panics
/// When it cannot be read.
pub fn whole_sample() -> Frame {
    let folder = sample_folder();
    let files = FrameFiles::halves(folder.join("a.exr"), folder.join("b.exr"));
    let files = files.with_denoised(None, None, Some(folder.join("denoised.exr")));
    read_frame(&files, &RoleOverrides::none()).expect("the sample frame").frame
}

/// The sample frame's reference.
///
/// # Panics
/// When it cannot be read.
pub fn sample_reference() -> Reference {
    read_reference(&sample_folder().join("ref.exr"), None).expect("the sample's reference")
}

/// Features `[13, H, W]` of both halves of a textured scene with edges; noisy in both, the denoised colour less so.
pub fn textured(height: usize, width: usize, rng: &mut Rng) -> [Image; 2] {
    let half = |rng: &mut Rng| {
        Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| {
            let truth = 0.3 + 0.25 * ((x / 5 + y / 4 + c) % 3) as f32;
            match c {
                RADIANCE..ALBEDO => (truth * (1.0 + 0.6 * rng.normal())).max(0.0),
                DENOISED.. => (truth * (1.0 + 0.05 * rng.normal())).max(0.0),
                ALBEDO..VISIBILITY => (0.5 * truth + 0.1 * rng.uniform()).min(1.0),
                VISIBILITY => ((x + y) % 2) as f32,
                _ => (truth - 0.5 + 0.1 * rng.normal()).clamp(-1.0, 1.0),
            }
        })
    };
    [half(rng), half(rng)]
}

/// Two feature tensors as a prepared frame: exposure 1, every feature, no pixel missing, every pixel computed, the
/// full buffer's z the mean of both.
pub fn prepared(halves: [Image; 2]) -> Prepared {
    let (height, width) = (halves[0].height(), halves[0].width());
    Prepared {
        exposure: 1.0,
        denoised: Image::mean_of(&planes(&halves[0], DENOISED, 3), &planes(&halves[1], DENOISED, 3)),
        halves: halves.map(Arc::new),
        valid: None,
        set: FeatureSet::ALL,
        plan: Plan::everything(height, width),
        variants: Vec::new(),
        composite: None,
        weights: HalfWeights::EQUAL,
        differences: None,
        found: Findings::default(),
    }
}

/// A textured frame with a denoised picture of the full buffer and one missing pixel, (1, 40, 7) of half a's radiance.
pub fn with_missing_pixel(height: usize, width: usize) -> Frame {
    let mut frame = frame_of(&textured(height, width, &mut Rng::new(5)));
    frame.denoised = Some(Image::mean_of(&frame.a.denoised, &frame.b.denoised));
    frame.a.radiance.set(1, 40, 7, f32::NAN);
    frame
}

/// Two feature tensors as a frame as read, without a denoised full buffer.
pub fn frame_of(halves: &[Image; 2]) -> Frame {
    let half = |features: &Image| HalfBuffer {
        radiance: planes(features, RADIANCE, 3),
        denoised: planes(features, DENOISED, 3),
        albedo: Some(planes(features, ALBEDO, 3)),
        normal: Some(planes(features, NORMAL, 3)),
        visibility: Some(planes(features, VISIBILITY, 1)),
    };
    let [a, b] = halves.each_ref().map(half);
    Frame::of_halves(a, b)
}

/// Planes `first..first + count`.
pub fn planes(image: &Image, first: usize, count: usize) -> Image {
    let data = (first..first + count).flat_map(|c| image.plane(c).iter().copied()).collect();
    Image::from_planes(count, image.height(), image.width(), data)
}
