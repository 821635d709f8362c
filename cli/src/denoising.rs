//! Denoised pictures that the files do not hold: made by the user's Open Image Denoise, once for a frame, before anything
//! else is computed.

use crate::failure::{Code, Failure};
use crate::frame_args::FrameJob;
use crate::interrupt;
use crate::output::{Output, role_line};
use crate::record::samples_line;
use clap::Args;
use serde::Serialize;
use sspc_frames::open::NoisyHalf;
use sspc_frames::{Made, MadeVariant, OpenFrame, RoleOverrides};
use sspc_image::{Buffer, CompactImage, HalfWeights, Image, Role};
use sspc_oidn::buffers::mean_of_finite;
use sspc_oidn::{Mode, Oidn, OidnError, Picture, Quality, Rows, Run};
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

/// Most memory for the library's own work, MiB; its pictures come on top: 48 bytes a pixel.
const MAX_MEMORY: u32 = 1024;
/// Rows that are read at a time.
pub(crate) const ROWS: usize = 256;
/// The mode that makes z where nobody names one.
const PLAIN: &[Mode] = &[Mode::Aux];
/// What is denoised.
pub(crate) const BUFFERS: [Buffer; 3] = [Buffer::A, Buffer::B, Buffer::Full];

/// Which denoiser makes what the files do not hold.
#[derive(Args, Clone, Debug, Default)]
pub struct DenoiseArgs {
    /// The library of Open Image Denoise, or its folder, for frames without denoised pictures [default: OIDN_DIR, or where
    /// the system, Python, Blender and distributions keep it]
    #[arg(long, value_name = "PATH")]
    pub oidn: Option<PathBuf>,

    /// What it is guided by: albedo and normal as rendered (aux), denoised first (clean-aux), nothing (colour). With several,
    /// or beside denoised pictures from files, each is one more picture to correct from [default, where the files have no
    /// denoised pictures: the preset's or the model's]
    #[arg(long, value_name = "MODE,...", value_delimiter = ',')]
    pub oidn_modes: Option<Vec<Mode>>,

    /// Time against quality of its pictures: fast, balanced or high [default: the preset's or the model's]
    #[arg(long, value_name = "QUALITY")]
    pub oidn_quality: Option<Quality>,
}

/// What was made, for reports.
#[derive(Clone, Debug, Serialize)]
pub struct DenoiserReport {
    /// The program that made it.
    pub name: &'static str,
    /// Its version.
    pub version: String,
    /// Its library.
    pub library: String,
    /// Its quality.
    pub quality: Quality,
    /// Whether the first mode made z, because the files have none.
    pub makes_first: bool,
    /// Modes, in the order of [`sspc_image::Frame::variants`].
    pub modes: Vec<Mode>,
    /// Each picture.
    pub pictures: Vec<MadePicture>,
    /// Wall-clock seconds, reading included.
    pub seconds: f64,
}

/// One picture that was made.
#[derive(Clone, Debug, Serialize)]
pub struct MadePicture {
    /// Of which samples.
    pub buffer: &'static str,
    /// Which features guided it.
    pub mode: Mode,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// Modes and quality where the arguments name none: a preset's, or those that a model keeps, so that frames that it
/// corrects are denoised as those that it was fitted on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnaskedModes {
    /// The first makes z; else z is in the files, and all are further pictures.
    makes_first: bool,
    modes: Vec<Mode>,
    quality: Quality,
}

impl UnaskedModes {
    /// The key in a model's metadata.
    pub const KEY: &str = "denoised_by_oidn";

    /// For frames without denoised pictures: the first makes z, the others are further pictures.
    pub fn to_make_z(modes: &[Mode], quality: Quality) -> Self {
        Self { makes_first: true, modes: modes.to_vec(), quality }
    }

    /// Of a model's metadata; `None` where they say nothing that is understood.
    pub fn of_model(metadata: &BTreeMap<String, String>) -> Option<Self> {
        metadata.get(Self::KEY).and_then(|text| Self::of(text))
    }

    fn of(text: &str) -> Option<Self> {
        let mut words = text.split(' ');
        let makes_first = match words.next()? {
            "z" => true,
            "beside-z" => false,
            _ => return None,
        };
        let modes = words.next()?.split(',').map(str::parse).collect::<Result<Vec<Mode>, _>>().ok()?;
        Some(Self { makes_first, modes, quality: words.next()?.parse().ok()? })
    }
}

impl fmt::Display for UnaskedModes {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = if self.makes_first { "z" } else { "beside-z" };
        write!(out, "{what} {} {}", names(&self.modes), self.quality)
    }
}

/// The denoiser of a command, opened when the first frame needs it.
pub struct Denoising<'a> {
    args: &'a DenoiseArgs,
    unasked: UnaskedModes,
    library: OnceCell<Oidn>,
}

/// What is to be made of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Task {
    modes: Vec<Mode>,
    /// The first mode makes z, which the files do not have.
    makes_first: bool,
}

impl<'a> Denoising<'a> {
    /// As the arguments ask, and where they do not, as a preset or a model has it, else guided by features as rendered.
    pub fn new(args: &'a DenoiseArgs, unasked: Option<UnaskedModes>) -> Self {
        let unasked = unasked.unwrap_or_else(|| UnaskedModes::to_make_z(PLAIN, Quality::High));
        Self { args, unasked, library: OnceCell::new() }
    }

    /// Makes what the frame's files do not hold, and gives it to the frame.
    ///
    /// # Errors
    /// No library, one that fails, files that cannot be read, interruption.
    pub fn supply(&self, open: &mut OpenFrame) -> Result<Option<DenoiserReport>, Failure> {
        let Some(task) = self.task(open) else { return Ok(None) };
        let oidn = self.library(open)?;
        let begin = Instant::now();
        let run = Run { quality: self.quality(), max_memory: MAX_MEMORY, asked_to_stop: interrupt::asked };
        let mut by_mode: Vec<Vec<CompactImage>> = vec![Vec::new(); task.modes.len()];
        let mut pictures = Vec::new();
        for buffer in BUFFERS {
            interrupt::check()?;
            let denoised = oidn.denoise(read(open, buffer)?, &task.modes, &run).map_err(failure)?;
            for (of_mode, made) in by_mode.iter_mut().zip(denoised) {
                pictures.push(MadePicture { buffer: buffer.name(), mode: made.mode, seconds: made.seconds });
                of_mode.push(made.picture);
            }
        }
        let mut variants = by_mode.into_iter().filter_map(|of_mode| {
            let [a, b, full] = <[CompactImage; 3]>::try_from(of_mode).ok()?;
            Some(MadeVariant { halves: [a, b], full })
        });
        let first = if task.makes_first { variants.next() } else { None };
        let (halves, full) = first.map(|first| (first.halves, first.full)).unzip();
        let full = full.filter(|_| !open.has(Role::Denoised, Buffer::Full));
        open.supply(Made { halves, full, variants: variants.collect(), composite: None });
        Ok(Some(DenoiserReport {
            name: NAME,
            version: oidn.version().to_string(),
            library: oidn.path().display().to_string(),
            quality: run.quality,
            makes_first: task.makes_first,
            modes: task.modes,
            pictures,
            seconds: begin.elapsed().as_secs_f64(),
        }))
    }

    /// One picture, guided by albedo and normal as rendered, in the quality of the frame's own.
    pub(crate) fn plain(&self, open: &OpenFrame, picture: Picture) -> Result<Option<CompactImage>, Failure> {
        let run = Run { quality: self.quality(), max_memory: MAX_MEMORY, asked_to_stop: interrupt::asked };
        let mode = Mode::Aux.with(open.has(Role::Albedo, Buffer::A));
        let denoised = self.library(open)?.denoise(picture, &[mode], &run).map_err(failure)?;
        Ok(denoised.into_iter().next().map(|made| made.picture))
    }

    /// Says what [`Self::supply`] would do; `None` where that is nothing.
    ///
    /// # Errors
    /// No library.
    pub fn describe(&self, open: &OpenFrame) -> Result<Option<String>, Failure> {
        let Some(task) = self.task(open) else { return Ok(None) };
        let oidn = self.library(open)?;
        let line = made_line("would be made", &task.modes, self.quality());
        Ok(Some(format!("{line} by {NAME} {} ({})", oidn.version(), oidn.path().display())))
    }

    /// Says what [`Self::supply`] would do for a frame whose headers alone are read; whether that is anything.
    ///
    /// # Errors
    /// What opening the files can raise, no library.
    pub fn describe_frame(&self, output: &Output, job: &FrameJob, overrides: &RoleOverrides) -> Result<bool, Failure> {
        let open = OpenFrame::open_to_denoise(&job.files, overrides)?;
        let Some(line) = self.describe(&open)? else { return Ok(false) };
        output.say(&format!("{}: {} x {} pixels", job.name(), open.width(), open.height()));
        open.sources().iter().for_each(|source| output.say(&role_line(source)));
        output.say(&samples_line(open.samples()));
        output.say(&line);
        open.notes().iter().for_each(|note| output.say(&format!("  note: {note}")));
        output.say(&format!("  the picture replaces {}", open.output()?.channels().join(", ")));
        Ok(true)
    }

    fn quality(&self) -> Quality {
        self.args.oidn_quality.unwrap_or(self.unasked.quality)
    }

    fn task(&self, open: &OpenFrame) -> Option<Task> {
        let makes_first = open.undenoised().is_some();
        let unasked = (self.unasked.makes_first == makes_first).then_some(self.unasked.modes.as_slice());
        let asked = self.args.oidn_modes.as_deref().or(unasked).or(makes_first.then_some(PLAIN))?;
        let albedo = open.has(Role::Albedo, Buffer::A);
        let mut modes: Vec<Mode> = Vec::new();
        for mode in asked.iter().map(|mode| mode.with(albedo)) {
            // Without albedo all modes are one.
            if !modes.contains(&mode) {
                modes.push(mode);
            }
        }
        Some(Task { modes, makes_first })
    }

    fn library(&self, open: &OpenFrame) -> Result<&Oidn, Failure> {
        if let Some(known) = self.library.get() {
            return Ok(known);
        }
        let found = Oidn::find(self.args.oidn.as_deref(), rayon::current_num_threads()).map_err(|error| {
            let asked = self.args.oidn.is_some() || self.args.oidn_modes.is_some();
            match open.undenoised() {
                // Nobody has asked for the library: the frame is what is wrong.
                Some(undenoised) if !asked => Failure { message: format!("{undenoised}; {error}"), ..failure(error) },
                _ => failure(error),
            }
        })?;
        Ok(self.library.get_or_init(|| found))
    }
}

/// What the library is called.
const NAME: &str = "Open Image Denoise";

impl DenoiserReport {
    /// What was made, as a line.
    pub fn line(&self) -> String {
        let line = made_line("made", &self.modes, self.quality);
        let seconds: Vec<String> = self.pictures.iter().map(|made| format!("{:.2}", made.seconds)).collect();
        format!("{line} by {NAME} {} ({}) in {} s", self.version, self.library, seconds.join(" + "))
    }

    /// What was made, for a picture's attributes.
    pub fn provenance(&self) -> String {
        format!("{NAME} {} {} {}", self.version, names(&self.modes), self.quality)
    }

    /// What a model keeps.
    pub fn kept(&self) -> UnaskedModes {
        UnaskedModes { makes_first: self.makes_first, modes: self.modes.clone(), quality: self.quality }
    }
}

fn made_line(verb: &str, modes: &[Mode], quality: Quality) -> String {
    format!("  denoised colour of half a, half b and the full buffer: {verb} ({}; {quality})", names(modes))
}

fn names(modes: &[Mode]) -> String {
    modes.iter().map(|mode| mode.name()).collect::<Vec<_>>().join(",")
}

/// Reads what the denoiser is given of a buffer; the full buffer is the mean of both halves by their weights.
fn read(open: &OpenFrame, buffer: Buffer) -> Result<Picture, Failure> {
    let (height, width) = (open.height(), open.width());
    let has = |role| open.has(role, Buffer::A);
    let mut picture = Picture::new(height, width, has(Role::Albedo), has(Role::Normal));
    for top in (0..height).step_by(ROWS) {
        interrupt::check()?;
        let [a, b] = open.noisy_rows(top..(top + ROWS).min(height))?;
        let half = match buffer {
            Buffer::A => a,
            Buffer::B => b,
            Buffer::Full => mean(&a, &b, open.weights()),
        };
        let NoisyHalf { radiance, albedo, normal } = &half;
        picture.put_rows(top, &Rows { colour: radiance, albedo: albedo.as_ref(), normal: normal.as_ref() });
    }
    Ok(picture)
}

pub(crate) fn mean(a: &NoisyHalf, b: &NoisyHalf, weights: HalfWeights) -> NoisyHalf {
    let mean_of_finite = |a: &Image, b: &Image| mean_of_finite(a, b, weights);
    let of = |a: &Option<Image>, b: &Option<Image>| a.as_ref().zip(b.as_ref()).map(|(a, b)| mean_of_finite(a, b));
    NoisyHalf {
        radiance: mean_of_finite(&a.radiance, &b.radiance),
        albedo: of(&a.albedo, &b.albedo),
        normal: of(&a.normal, &b.normal),
    }
}

fn failure(error: OidnError) -> Failure {
    let code = match error {
        OidnError::Cancelled => return Failure::interrupted(),
        OidnError::Failed { .. } | OidnError::NotFinite { .. } => Code::Run,
        _ => Code::Input,
    };
    Failure::new(code, error.to_string(), error.advice())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_model_keeps_is_read_back() {
        for text in ["z aux high", "beside-z clean-aux,colour balanced"] {
            assert_eq!(UnaskedModes::of(text).map(|kept| kept.to_string()).as_deref(), Some(text));
        }
        for text in ["", "z", "z aux", "z albedo high", "files aux high"] {
            assert_eq!(UnaskedModes::of(text), None, "{text}");
        }
    }
}
