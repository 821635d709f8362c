//! From a path to a denoised picture.

use crate::buffers::{CHANNELS, Picture};
use crate::error::OidnError;
use crate::ffi::{CallError, Device, Functions, Job, NotOpened};
use crate::mode::{Mode, Quality};
use crate::search::{Candidate, Surroundings};
use sspc_image::CompactImage;
use std::ffi::CStr;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The oldest version with the interface that is used here.
const OLDEST: Version = Version { major: 2, minor: 0, patch: 0 };

/// A version of the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[expect(missing_docs, reason = "as everywhere")]
pub struct Version {
    pub major: u32,
    pub minor: u32,
    pub patch: u32,
}

impl Version {
    /// From the library's number, 10000 major + 100 minor + patch.
    fn of(number: i32) -> Self {
        let number = u32::try_from(number).unwrap_or(0);
        Self { major: number / 10_000, minor: number / 100 % 100, patch: number % 100 }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

/// How the library is to run.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// How much time it may take.
    pub quality: Quality,
    /// Most memory for its own work, MiB: larger pictures are denoised in tiles. The picture itself comes on top.
    pub max_memory: u32,
    /// Whether to stop, asked now and then.
    pub asked_to_stop: fn() -> bool,
}

/// What a mode made of a picture.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The mode.
    pub mode: Mode,
    /// `[3, H, W]` in the units of the colour; NaN where that was missing.
    pub picture: CompactImage,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// The library, opened, with a device that has its threads.
pub struct Oidn {
    device: Device,
    version: Version,
    path: PathBuf,
}

impl Oidn {
    /// The first library that can be used: the named one, that of `OIDN_DIR`, or one that is found ([`Surroundings`]).
    ///
    /// # Errors
    /// When there is none, or when what was named cannot be used.
    pub fn find(named: Option<&Path>, threads: usize) -> Result<Self, OidnError> {
        Self::find_in(&Surroundings::of_process(named), threads)
    }

    /// The same in given surroundings.
    ///
    /// # Errors
    /// As [`Self::find`].
    pub fn find_in(surroundings: &Surroundings, threads: usize) -> Result<Self, OidnError> {
        let is_named = surroundings.named.is_some() || surroundings.oidn_dir.is_some();
        let mut passed_over = Vec::new();
        for candidate in surroundings.candidates()? {
            let (path, may_be_absent) = match &candidate {
                Candidate::Loader(name) => (Path::new(name), true),
                Candidate::File(path) => (path.as_path(), false),
            };
            match Self::open(path, threads) {
                Ok(oidn) => return Ok(oidn),
                Err(OidnError::NotLoaded { .. }) if may_be_absent => {}
                Err(error) => passed_over.push(error),
            }
        }
        match passed_over.into_iter().next_back() {
            Some(error) if is_named => Err(error),
            Some(error) => Err(OidnError::NotFound { tried: vec![error.to_string()] }),
            None => Err(OidnError::NotFound { tried: Vec::new() }),
        }
    }

    /// Opens a library by its file, or by a name that the system's loader knows, and starts `threads` threads.
    ///
    /// # Errors
    /// Something else than the library, one for another processor, an old version, a device that does not start.
    pub fn open(path: &Path, threads: usize) -> Result<Self, OidnError> {
        let owned = || path.to_path_buf();
        if let Some(found) = other_architecture(path) {
            return Err(OidnError::Architecture { path: owned(), expected: std::env::consts::ARCH, found });
        }
        let functions = Functions::open(path).map_err(|error| match error {
            NotOpened::Loader(found) => OidnError::NotLoaded { path: owned(), found },
            NotOpened::Lacks(function) => OidnError::NotOidn { path: owned(), function: function.into() },
            NotOpened::Version(version) => OidnError::TooOld {
                path: owned(),
                found: version.map_or("an earlier one".into(), |number| Version::of(number).to_string()),
            },
        })?;
        let device = Device::start(functions, threads)
            .map_err(|error| OidnError::Device { path: owned(), found: in_words(error) })?;
        let version = Version::of(device.version());
        if version < OLDEST {
            return Err(OidnError::TooOld { path: owned(), found: version.to_string() });
        }
        Ok(Self { device, version, path: owned() })
    }

    /// Its version.
    pub fn version(&self) -> Version {
        self.version
    }

    /// The file it was opened from, or the name that the system's loader knows.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Denoises a picture in each mode, in their order. Modes that need a feature which the picture has not, or has nowhere
    /// finite, are guided by what there is. Pixels whose colour is missing are missing in the results.
    ///
    /// # Errors
    /// What the library reports, values that are not finite, and [`OidnError::Cancelled`].
    pub fn denoise(&self, mut picture: Picture, modes: &[Mode], run: &Run) -> Result<Vec<Denoised>, OidnError> {
        let (height, width) = (picture.height, picture.width);
        let all = |value: f32| {
            let picture =
                CompactImage::of_interleaved(CHANNELS, height, width, &vec![value; height * width * CHANNELS]);
            modes.iter().map(|&mode| Denoised { mode, picture: picture.clone(), seconds: 0.0 }).collect()
        };
        let Some(missing) = picture.fill() else { return Ok(all(f32::NAN)) };
        // The library's black is not quite black, and frames that fade to black would seem to have light.
        if missing.is_empty() && picture.colour.iter().all(|value| *value <= 0.0) {
            return Ok(all(0.0));
        }
        // Cleaning replaces the features, so what wants them as they are comes first.
        let mut order: Vec<usize> = (0..modes.len()).collect();
        order.sort_by_key(|&at| modes[at] == Mode::CleanAux);
        let mut output = vec![0.0; height * width * CHANNELS];
        let mut denoised: Vec<(usize, Denoised)> = Vec::new();
        let mut is_clean = false;
        for at in order {
            let (mode, begin) = (modes[at], Instant::now());
            let guided = mode.with(picture.albedo.is_some());
            if guided == Mode::CleanAux && !is_clean {
                self.clean_features(&mut picture, run)?;
                is_clean = true;
            }
            let mut inputs = vec![(c"color", &picture.colour)];
            if guided != Mode::Colour {
                inputs.extend(picture.albedo.iter().map(|albedo| (c"albedo", albedo)));
                inputs.extend(picture.normal.iter().map(|normal| (c"normal", normal)));
            }
            let on = if guided == Mode::CleanAux { vec![c"hdr", c"cleanAux"] } else { vec![c"hdr"] };
            let size = (width, height);
            self.filter(inputs, on, &mut output, size, run, mode.name())?;
            for &i in &missing {
                output[i * CHANNELS..(i + 1) * CHANNELS].fill(f32::NAN);
            }
            let picture = CompactImage::of_interleaved(CHANNELS, height, width, &output);
            denoised.push((at, Denoised { mode, picture, seconds: begin.elapsed().as_secs_f64() }));
        }
        denoised.sort_by_key(|(at, _)| *at);
        Ok(denoised.into_iter().map(|(_, denoised)| denoised).collect())
    }

    /// Denoises each feature by itself.
    fn clean_features(&self, picture: &mut Picture, run: &Run) -> Result<(), OidnError> {
        let size = (picture.width, picture.height);
        for (name, feature) in [(c"albedo", &mut picture.albedo), (c"normal", &mut picture.normal)] {
            if let Some(feature) = feature {
                let mut clean = vec![0.0; feature.len()];
                self.filter(vec![(name, feature)], Vec::new(), &mut clean, size, run, "prefilter")?;
                *feature = clean;
            }
        }
        Ok(())
    }

    fn filter(
        &self,
        inputs: Vec<(&'static CStr, &Vec<f32>)>,
        on: Vec<&'static CStr>,
        output: &mut [f32],
        (width, height): (usize, usize),
        run: &Run,
        what: &str,
    ) -> Result<(), OidnError> {
        let job = Job {
            inputs: inputs.into_iter().map(|(name, values)| (name, values.as_slice())).collect(),
            output,
            width,
            height,
            on,
            numbers: vec![
                (c"quality", run.quality.number()),
                (c"maxMemoryMB", i32::try_from(run.max_memory).unwrap_or(i32::MAX)),
            ],
            asked_to_stop: run.asked_to_stop,
        };
        let (what, version) = (format!("{what}, {}", run.quality), self.version.to_string());
        self.device.run(job).map_err(|error| match error {
            CallError::Cancelled => OidnError::Cancelled,
            CallError::Message(found) => {
                OidnError::Failed { version: version.clone(), what: what.clone(), width, height, found }
            }
        })?;
        let count = output.iter().filter(|value| !value.is_finite()).count();
        if count > 0 { Err(OidnError::NotFinite { version, what, width, height, count }) } else { Ok(()) }
    }
}

fn in_words(error: CallError) -> String {
    match error {
        CallError::Cancelled => "cancelled".into(),
        CallError::Message(message) => message,
    }
}

/// The processor that a file of ELF, the format of Linux, is made for, where that is another than this program's. The
/// loader's own words do not say it.
fn other_architecture(path: &Path) -> Option<String> {
    /// `e_machine` of the ELF header, 64 bits each.
    const MACHINES: [(u16, &str); 4] = [(0x3e, "x86_64"), (0xb7, "aarch64"), (0xf3, "riscv64"), (0x15, "powerpc64")];
    let mut header = [0u8; 20];
    let mut file = std::fs::File::open(path).ok()?;
    std::io::Read::read_exact(&mut file, &mut header).ok()?;
    if !header.starts_with(b"\x7fELF") {
        return None;
    }
    let (bits, machine) = (if header[4] == 1 { 32 } else { 64 }, u16::from_le_bytes([header[18], header[19]]));
    let known = MACHINES.iter().find(|(number, _)| bits == 64 && *number == machine).map(|(_, name)| *name);
    match known {
        Some(name) if name == std::env::consts::ARCH => None,
        Some(name) => Some(name.to_string()),
        None if MACHINES.iter().any(|(_, name)| *name == std::env::consts::ARCH) => {
            Some(format!("another processor ({bits} bits, number {machine:#x} of ELF)"))
        }
        None => None,
    }
}
