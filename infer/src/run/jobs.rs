//! Which files make which frame, and where its picture goes.

use super::arguments::RunArguments;
use crate::failure::{Code, Failure};
use sspc_frames::FrameFiles;
use sspc_frames::sequence::{Frames, Pattern};
use std::path::{Path, PathBuf};

/// One frame to correct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// The number of a frame of a shot.
    pub number: Option<u32>,
    pub files: FrameFiles,
    pub output: PathBuf,
}

impl Job {
    /// What messages call the frame.
    pub fn name(&self) -> String {
        match self.number {
            Some(number) => format!("frame {number}"),
            None => self.files.a.display().to_string(),
        }
    }

    /// The file of the figures.
    pub fn sidecar(&self) -> PathBuf {
        self.output.with_extension("json")
    }
}

/// The frames that the arguments name, in their order.
///
/// # Errors
/// Arguments that make no sense together, patterns without a place for the frame number.
pub fn list(arguments: &RunArguments) -> Result<Vec<Job>, Failure> {
    match (&arguments.a, &arguments.frames) {
        (Some(a), Some(frames)) => shot(arguments, a, frames),
        // clap lets these pass where another way to name the frame was taken.
        (None, Some(_)) => Err(nonsense("--frames belongs to a shot", "name the shot's files with --a and --b")),
        (None, None) if arguments.b.is_some() => Err(nonsense("--b belongs to a shot", "add --a and --frames")),
        _ => Ok(vec![Job { number: None, files: single(arguments)?, output: arguments.output.clone() }]),
    }
}

fn single(arguments: &RunArguments) -> Result<FrameFiles, Failure> {
    let files = match (&arguments.a_file, &arguments.b_file, &arguments.paper_layout) {
        (Some(a), Some(b), _) => FrameFiles::halves(a, b),
        (Some(both), None, _) => FrameFiles::both_in_one(both),
        (None, _, Some(root)) => paper(arguments, root)?,
        (None, _, None) => {
            return Err(nonsense("no frame was named", "give A.exr and B.exr, --a and --b, or --paper-layout"));
        }
    };
    let DenoisedFiles { a, b, full } = DenoisedFiles::of(arguments);
    Ok(files.with_denoised(a, b, full))
}

fn paper(arguments: &RunArguments, root: &Path) -> Result<FrameFiles, Failure> {
    match (&arguments.scene, arguments.spp, &arguments.denoiser) {
        (Some(scene), Some(spp), Some(denoiser)) => Ok(FrameFiles::paper_layout(root, scene, spp, denoiser)?),
        _ => Err(nonsense("--paper-layout alone names no frame", "add --scene, --spp and --denoiser")),
    }
}

/// The denoiser's three files.
struct DenoisedFiles {
    a: Option<PathBuf>,
    b: Option<PathBuf>,
    full: Option<PathBuf>,
}

impl DenoisedFiles {
    fn of(arguments: &RunArguments) -> Self {
        Self { a: arguments.denoised_a.clone(), b: arguments.denoised_b.clone(), full: arguments.denoised.clone() }
    }
}

fn shot(arguments: &RunArguments, a: &str, frames: &str) -> Result<Vec<Job>, Failure> {
    let frames: Frames = frames.parse()?;
    let a: Pattern = a.parse()?;
    let b: Option<Pattern> = arguments.b.as_deref().map(str::parse).transpose()?;
    let output = pattern(&arguments.output)?;
    let files = DenoisedFiles::of(arguments);
    let optional = |path: &Option<PathBuf>| path.as_deref().map(pattern).transpose();
    let (denoised_a, denoised_b, full) = (optional(&files.a)?, optional(&files.b)?, optional(&files.full)?);
    let at = |pattern: &Option<Pattern>, number| pattern.as_ref().map(|p| p.path(number));
    let job = |number| {
        let halves = match &b {
            Some(b) => FrameFiles::halves(a.path(number), b.path(number)),
            None => FrameFiles::both_in_one(a.path(number)),
        };
        let files = halves.with_denoised(at(&denoised_a, number), at(&denoised_b, number), at(&full, number));
        Job { number: Some(number), files, output: output.path(number) }
    };
    Ok(frames.into_iter().map(job).collect())
}

fn pattern(path: &Path) -> Result<Pattern, Failure> {
    let text = path.to_str().ok_or_else(|| {
        nonsense(&format!("{}: a pattern must be UTF-8", path.display()), "rename the folder or the files")
    })?;
    Ok(text.parse::<Pattern>()?)
}

fn nonsense(message: &str, advice: &str) -> Failure {
    Failure::new(Code::Arguments, message, advice)
}
