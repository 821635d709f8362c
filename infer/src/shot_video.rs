//! The frames of a shot as videos: how visible their errors are in motion.

use crate::evaluate::Read;
use serde::Serialize;
use sspc_cli::{Code, Failure};
use sspc_metrics::Video;
use sspc_metrics::displayed::Displayed;
use sspc_metrics::video::{NotPredicted, SMALLEST, jod};

/// The quality of a frame within its video, JOD.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Jod {
    /// Of the picture.
    pub picture: f64,
    /// Of the denoiser's.
    pub denoised: Option<f64>,
}

/// The visible differences of a frame: of the picture, and of the denoiser's where it is given. None for a frame that stands
/// alone or is too small.
pub type Visible = Option<Vec<f64>>;

/// Frames that follow each other are a video; where one does not, another begins.
pub struct Videos {
    frames_per_second: f32,
    exposure: f32,
    /// The video that goes on, and its frames so far.
    current: Option<(Video, usize)>,
    visible: Vec<Visible>,
}

impl Videos {
    /// Shown at this rate and exposure.
    pub fn new(frames_per_second: f32, exposure: f32) -> Self {
        Self { frames_per_second, exposure, current: None, visible: Vec::new() }
    }

    /// The next frame, and whether it goes on where the last one was.
    pub(crate) fn push(&mut self, read: &Read, follows: bool) -> Result<(), Failure> {
        if !follows {
            self.end()?;
        }
        if read.picture.height().min(read.picture.width()) < SMALLEST {
            self.visible.push(None);
            return Ok(());
        }
        let pictures = [&read.picture].into_iter().chain(&read.denoised);
        let shown: Vec<_> =
            pictures.map(|picture| Displayed::new(picture, &read.reference.mean, self.exposure)).collect();
        let (video, frames) = self.current.get_or_insert_with(|| (Video::new(shown.len(), self.frames_per_second), 0));
        *frames += 1;
        video.push(&shown).map_err(failed)
    }

    /// Of every frame.
    ///
    /// # Errors
    /// A [`Failure`] where memory ran out.
    pub fn finish(mut self) -> Result<Vec<Visible>, Failure> {
        self.end()?;
        Ok(self.visible)
    }

    fn end(&mut self) -> Result<(), Failure> {
        if let Some((video, frames)) = self.current.take() {
            let videos = video.finish().map_err(failed)?;
            let of_frame = |frame: usize| videos.iter().map(|video| video.get(frame).copied()).collect();
            self.visible.extend((0..frames).map(of_frame));
        }
        Ok(())
    }
}

/// The quality of one frame.
pub fn of_frame(visible: &Visible) -> Option<Jod> {
    let visible = visible.as_ref()?;
    Some(Jod { picture: jod(&visible[..1]), denoised: visible.get(1).map(|one| jod(&[*one])) })
}

/// The quality of the shot's pictures (0) or the denoiser's (1); NaN where no frame has one.
pub fn of_shot(visible: &[Visible], which: usize) -> f64 {
    let all: Vec<f64> = visible.iter().flatten().filter_map(|frame| frame.get(which).copied()).collect();
    jod(&all)
}

fn failed(error: NotPredicted) -> Failure {
    Failure::new(Code::Run, error.to_string(), "measure fewer pixels, or on a machine with more memory")
}
