//! From the command line to frames: files, roles, references.

use crate::cli::FitArgs;
use crate::error::Error;
use sspc_core::frame::{Frame, Reference};
use sspc_core::io::read::Like;
use sspc_core::io::{FrameFiles, RoleOverrides, read_frame, read_reference};
use sspc_core::sequence::{Frames, Pattern};
use std::path::PathBuf;

/// One frame of the fit, as read.
pub struct Input {
    pub name: String,
    /// Number in a shot.
    pub frame_number: Option<u32>,
    pub files: FrameFiles,
    pub frame: Frame,
    pub reference: Option<Reference>,
}

impl Input {
    /// Name of an output of this frame.
    pub fn file_name(&self, stem: &str, extension: &str) -> String {
        match self.frame_number {
            Some(number) => format!("{stem}.{number}.{extension}"),
            None => format!("{stem}.{extension}"),
        }
    }
}

/// The files of the frame that the arguments name.
pub fn frame_files(args: &FitArgs) -> Result<FrameFiles, Error> {
    let files = match (&args.a_file, &args.b_file, &args.paper_layout) {
        (Some(a), Some(b), _) => FrameFiles::halves(a, b),
        (Some(both), None, _) => FrameFiles::both_in_one(both),
        (None, _, Some(root)) => {
            let missing = || Error::Arguments("--paper-layout needs --scene, --spp and --denoiser".into());
            let scene = args.scene.as_deref().ok_or_else(missing)?;
            let denoiser = args.denoiser.as_deref().ok_or_else(missing)?;
            FrameFiles::paper_layout(root, scene, args.spp.ok_or_else(missing)?, denoiser)?
        }
        (None, _, None) => return Err(Error::Arguments("give two half buffers, --paper-layout or a shot".into())),
    };
    Ok(files
        .with_denoised(args.denoised_a.clone(), args.denoised_b.clone(), args.denoised.clone())
        .with_reference(args.reference.clone()))
}

/// Reads one frame and its reference.
pub fn read(files: FrameFiles, overrides: &RoleOverrides) -> Result<Input, Error> {
    let frame = read_frame(&files, overrides)?;
    let like = Like { image: &frame.a.radiance, path: &files.a };
    let reference = files.reference.as_ref().map(|path| read_reference(path, Some(like))).transpose()?;
    Ok(Input { frame_number: None, name: files.a.display().to_string(), files, frame, reference })
}

/// Reads the frames of a shot that the arguments name, each with its files of the same number.
pub fn read_shot(args: &FitArgs, overrides: &RoleOverrides) -> Result<Vec<Input>, Error> {
    let missing = || Error::Arguments("a shot needs --a, --b and --frames".into());
    let a: Pattern = args.a.as_deref().ok_or_else(missing)?.parse()?;
    let b: Pattern = args.b.as_deref().ok_or_else(missing)?.parse()?;
    let frames: Frames = args.frames.as_deref().ok_or_else(missing)?.parse()?;
    let of_frame = |path: &Option<PathBuf>, number: u32| match path {
        None => Ok(None),
        Some(path) => path.display().to_string().parse::<Pattern>().map(|p| Some(p.path(number))),
    };
    let mut inputs = Vec::new();
    for &number in frames.as_slice() {
        let files = FrameFiles::halves(a.path(number), b.path(number))
            .with_denoised(
                of_frame(&args.denoised_a, number)?,
                of_frame(&args.denoised_b, number)?,
                of_frame(&args.denoised, number)?,
            )
            .with_reference(of_frame(&args.reference, number)?);
        inputs.push(Input { frame_number: Some(number), ..read(files, overrides)? });
    }
    Ok(inputs)
}
