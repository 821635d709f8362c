//! The arguments that name a frame, or the frames of a shot.

use crate::denoising::DenoiseArgs;
use crate::failure::{Code, Failure};
use crate::passes::PassArgs;
use clap::Args;
use sspc_frames::resolve::views;
use sspc_frames::samples::{MOST_SAMPLES, implausible};
use sspc_frames::sequence::{Frames, Pattern};
use sspc_frames::{DenoisedFile, FrameFiles, MoreDenoised, RoleOverrides};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Which files make the frame, and which of their channels play which role.
#[derive(Args, Clone, Debug, Default)]
#[command(group = clap::ArgGroup::new("frame").required(true).args(["a_file", "a", "paper_layout"]))]
pub struct FrameArgs {
    /// Half buffer a, or one file whose layers hold both halves
    #[arg(value_name = "A.exr")]
    pub a_file: Option<PathBuf>,

    /// Half buffer b
    #[arg(value_name = "B.exr", requires = "a_file")]
    pub b_file: Option<PathBuf>,

    /// A shot instead of one frame: half buffers a, e.g. 'shot/a.####.exr', or files that hold both halves
    #[arg(long, value_name = "PATTERN", requires = "frames", conflicts_with = "a_file")]
    pub a: Option<OsString>,

    /// Half buffers b of the shot
    #[arg(long, value_name = "PATTERN", requires = "a")]
    pub b: Option<OsString>,

    /// Frames of the shot, e.g. 1001-1040, 1-100x5 (or 1-100:5), -5-10 or 1001,1005-1010
    #[arg(long, value_name = "RANGE", requires = "a", allow_hyphen_values = true)]
    pub frames: Option<String>,

    /// Neighbouring frames of a shot that are read on each side of a frame, where their files exist; 0 takes each frame by
    /// itself [default: 1 for a fit, the model's for a run]
    #[arg(long, value_name = "N", requires = "a", value_parser = extra_frames)]
    pub extra_frames: Option<usize>,

    /// Root of a folder laid out as the paper's published data
    #[arg(long, value_name = "ROOT", requires_all = ["scene", "spp", "denoiser"], conflicts_with_all = ["a_file", "a"])]
    pub paper_layout: Option<PathBuf>,

    /// Scene in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub scene: Option<String>,

    /// Samples per pixel in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub spp: Option<u32>,

    /// Denoiser in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub denoiser: Option<String>,

    /// The denoiser's output on half a, when it is not in A.exr (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised_a: Option<PathBuf>,

    /// The denoiser's output on half b, when it is not in B.exr (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised_b: Option<PathBuf>,

    /// The denoiser's output on the full buffer: what the correction is added to (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised: Option<PathBuf>,

    /// Samples per pixel of half a, which weigh it in means of both [default: what the files say, else as many as half b]
    #[arg(long, value_name = "N", requires = "samples_b", value_parser = samples())]
    pub samples_a: Option<u32>,

    /// Samples per pixel of half b
    #[arg(long, value_name = "N", requires = "samples_a", value_parser = samples())]
    pub samples_b: Option<u32>,

    /// A further denoiser's output on half a, half b and the full buffer: one more picture to correct from. Each is
    /// FILE.exr or FILE.exr:LAYER (patterns for a shot). Repeatable
    #[arg(long, value_name = "ZA,ZB[,Z]")]
    pub denoised_more: Vec<MoreDenoised>,

    /// What makes denoised pictures that the files do not hold.
    #[command(flatten)]
    pub denoise: DenoiseArgs,

    /// Which layers are corrected beside the picture.
    #[command(flatten)]
    pub passes: PassArgs,

    /// Which channels fill a role, e.g. albedo=LAYER, normal-a=FILE.exr:N, visibility=none
    #[arg(long = "role", value_name = "ROLE=SOURCE")]
    pub roles: Vec<String>,

    /// View of a stereo file to correct, by its name, or all of them [default: the first]
    #[arg(long, value_name = "NAME")]
    pub view: Option<String>,
}

/// One frame that the arguments name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameJob {
    /// The number of a frame of a shot.
    pub number: Option<i32>,
    /// Its files.
    pub files: FrameFiles,
}

/// What `--view` calls all views of a file.
const ALL_VIEWS: &str = "all";

impl FrameJob {
    /// What messages call the frame.
    pub fn name(&self) -> String {
        match self.number {
            Some(number) => format!("frame {number}"),
            None => self.files.a.display().to_string(),
        }
    }
}

impl FrameArgs {
    /// The roles that the user named.
    ///
    /// # Errors
    /// An override that makes no sense.
    pub fn overrides(&self) -> Result<RoleOverrides, Failure> {
        Ok(RoleOverrides::parse(&self.roles)?)
    }

    /// The roles of each view of a frame that is to be corrected: one, or with `--view all` as many as its half a has.
    ///
    /// # Errors
    /// An override that makes no sense, a file that cannot be read.
    pub fn overrides_of_views(&self, files: &FrameFiles) -> Result<Vec<RoleOverrides>, Failure> {
        let overrides = self.overrides()?;
        match self.view.as_deref() {
            Some(all) if all.eq_ignore_ascii_case(ALL_VIEWS) => {
                let views = views(files)?;
                let each = views.into_iter().map(|view| overrides.clone().of_each_view(view));
                let each: Vec<RoleOverrides> = each.collect();
                Ok(if each.is_empty() { vec![overrides] } else { each })
            }
            view => Ok(vec![overrides.of_view(view.map(str::to_string))]),
        }
    }

    /// The frames that the arguments name, in their order, each with the reference of its number.
    ///
    /// # Errors
    /// Arguments that make no sense together, patterns without a place for the frame number.
    pub fn jobs(&self, reference: Option<&Path>) -> Result<Vec<FrameJob>, Failure> {
        let samples = self.samples()?;
        match (&self.a, &self.frames) {
            (Some(a), Some(frames)) => self.shot(Path::new(a), frames, reference),
            // clap lets these pass where another way to name the frame was taken.
            (None, Some(_)) => Err(nonsense("--frames belongs to a shot", "name the shot's files with --a and --b")),
            (None, None) if self.b.is_some() => Err(nonsense("--b belongs to a shot", "add --a and --frames")),
            _ => {
                let files = self.single()?.with_samples(samples).with_reference(reference.map(Path::to_path_buf));
                Ok(vec![FrameJob { number: None, files }])
            }
        }
    }

    /// The samples of both halves, where they are named.
    fn samples(&self) -> Result<Option<[u32; 2]>, Failure> {
        let Some(samples) = self.samples_a.zip(self.samples_b).map(|(a, b)| [a, b]) else { return Ok(None) };
        let advice = "give the samples per pixel that each half was rendered with";
        match implausible(samples.map(f64::from)) {
            None => Ok(Some(samples)),
            Some(why) => Err(nonsense(&format!("--samples-a and --samples-b: {why}"), advice)),
        }
    }

    fn single(&self) -> Result<FrameFiles, Failure> {
        let files = match (&self.a_file, &self.b_file, &self.paper_layout) {
            (Some(a), Some(b), _) => FrameFiles::halves(a, b),
            (Some(both), None, _) => FrameFiles::both_in_one(both),
            (None, _, Some(root)) => self.paper(root)?,
            (None, _, None) => {
                return Err(nonsense("no frame was named", "give A.exr and B.exr, --a and --b, or --paper-layout"));
            }
        };
        let files = files.with_denoised(self.denoised_a.clone(), self.denoised_b.clone(), self.denoised.clone());
        Ok(files.with_more_denoised(self.denoised_more.clone()))
    }

    fn paper(&self, root: &Path) -> Result<FrameFiles, Failure> {
        match (&self.scene, self.spp, &self.denoiser) {
            (Some(scene), Some(spp), Some(denoiser)) => Ok(FrameFiles::paper_layout(root, scene, spp, denoiser)?),
            _ => Err(nonsense("--paper-layout alone names no frame", "add --scene, --spp and --denoiser")),
        }
    }

    fn shot(&self, a: &Path, frames: &str, reference: Option<&Path>) -> Result<Vec<FrameJob>, Failure> {
        let frames: Frames = frames.parse()?;
        let files = self.shot_files(a, reference)?;
        Ok(frames.into_iter().map(|number| FrameJob { number: Some(number), files: files.of(number) }).collect())
    }

    /// The files of the shot that the arguments name; `None` of a single frame.
    ///
    /// # Errors
    /// Patterns without a place for the frame number.
    pub fn shot_patterns(&self) -> Result<Option<ShotFiles>, Failure> {
        self.a.as_ref().map(|a| self.shot_files(Path::new(a), None)).transpose()
    }

    fn shot_files(&self, a: &Path, reference: Option<&Path>) -> Result<ShotFiles, Failure> {
        let a = pattern(a)?;
        let optional = |path: Option<&Path>| path.map(pattern).transpose();
        let b = optional(self.b.as_deref().map(Path::new))?;
        let [denoised_a, denoised_b, denoised, reference] = [
            optional(self.denoised_a.as_deref())?,
            optional(self.denoised_b.as_deref())?,
            optional(self.denoised.as_deref())?,
            optional(reference)?,
        ];
        let more = self.denoised_more.iter().map(MorePatterns::of).collect::<Result<Vec<_>, _>>()?;
        Ok(ShotFiles { a, b, denoised_a, denoised_b, denoised, more, reference, samples: self.samples()? })
    }
}

/// The files of a shot by patterns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShotFiles {
    a: Pattern,
    b: Option<Pattern>,
    denoised_a: Option<Pattern>,
    denoised_b: Option<Pattern>,
    denoised: Option<Pattern>,
    more: Vec<MorePatterns>,
    reference: Option<Pattern>,
    samples: Option<[u32; 2]>,
}

impl ShotFiles {
    /// The files of one frame, whether they exist or not.
    pub fn of(&self, number: i32) -> FrameFiles {
        let at = |pattern: &Option<Pattern>| pattern.as_ref().map(|pattern| pattern.path(number));
        let halves = match &self.b {
            Some(b) => FrameFiles::halves(self.a.path(number), b.path(number)),
            None => FrameFiles::both_in_one(self.a.path(number)),
        };
        let files = halves.with_denoised(at(&self.denoised_a), at(&self.denoised_b), at(&self.denoised));
        let files = files.with_more_denoised(self.more.iter().map(|more| more.at(number)).collect());
        files.with_samples(self.samples).with_reference(at(&self.reference))
    }
}

/// Most neighbours on each side, as in the model contract: beyond two the gain is below the noise of its measurement.
const MOST_EXTRA_FRAMES: usize = 4;

fn extra_frames(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(number) if number <= MOST_EXTRA_FRAMES => Ok(number),
        _ => Err(format!("expected a whole number from 0 to {MOST_EXTRA_FRAMES}")),
    }
}

fn samples() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=i64::from(MOST_SAMPLES))
}

/// Further denoised pictures of a shot.
#[derive(Clone, Debug, PartialEq, Eq)]
struct MorePatterns {
    named: MoreDenoised,
    halves: [Pattern; 2],
    full: Option<Pattern>,
}

impl MorePatterns {
    fn of(named: &MoreDenoised) -> Result<Self, Failure> {
        let [a, b] = &named.halves;
        let halves = [pattern(&a.path)?, pattern(&b.path)?];
        let full = named.full.as_ref().map(|full| pattern(&full.path)).transpose()?;
        Ok(Self { named: named.clone(), halves, full })
    }

    /// Those of one frame.
    fn at(&self, number: i32) -> MoreDenoised {
        let file = |named: &DenoisedFile, pattern: &Pattern| DenoisedFile {
            path: pattern.path(number),
            layer: named.layer.clone(),
        };
        let [a, b] = &self.named.halves;
        MoreDenoised {
            halves: [file(a, &self.halves[0]), file(b, &self.halves[1])],
            full: self.named.full.as_ref().zip(self.full.as_ref()).map(|(named, pattern)| file(named, pattern)),
        }
    }
}

/// A path with a place for the frame number.
///
/// # Errors
/// Without one, or with more.
pub fn pattern(path: &Path) -> Result<Pattern, Failure> {
    Ok(Pattern::of_path(path)?)
}

fn nonsense(message: &str, advice: &str) -> Failure {
    Failure::new(Code::Arguments, message, advice)
}
