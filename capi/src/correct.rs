//! A frame corrected.

use crate::buffers::{Given, Size, Wanted};
use crate::model::{SspcModel, present};
use crate::outcome::{nonsense, outcome};
use crate::sized;
use crate::threads::Threads;
use crate::types::{SspcDenoised, SspcFrame, SspcInput, SspcMean, SspcOptions, SspcPicture};
use sspc_arrays::correct::{CorrectedFrame, correct_frame};
use sspc_arrays::frame::{GivenFrame, PICTURES, name};
use sspc_arrays::watch::{Watch, watched};
use sspc_cli::{Code, Failure};
use sspc_core::correct::Corrected;
use sspc_core::estimate::Mean;
use sspc_image::{Buffer, DenoisedVariant, Role};
use sspc_onnx::{MAX_NETWORKS, Model};
use std::ffi::c_int;
use std::slice;

/// Corrects a frame, as `sspc-infer run` does: the same pixels, bit for bit. `options` may be NULL: strength 1, all cores.
/// Where it does not return SSPC_OK, nothing was written to the buffers.
///
/// Memory while it works: 4 bytes for every value given, 12 for each pixel (28 with `share`), and 440 for each pixel of the
/// rows at hand, at most some 800 MiB; all of it is given back. Its threads begin and end within the call. A process whose
/// memory runs out is ended by the system, or by the library; sizes that cannot be had at all are refused first.
///
/// # Safety
/// `model` is one that is not freed meanwhile. `frame`, `options` and `picture` were made by `sspc_frame`, `sspc_options`
/// and `sspc_picture`; their buffers hold all values, nobody else writes to them meanwhile, and nobody reads the outputs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sspc_correct(
    model: *const SspcModel,
    frame: *const SspcFrame,
    options: *const SspcOptions,
    picture: *mut SspcPicture,
) -> c_int {
    outcome(|| {
        // SAFETY: the caller's promises; what is read first is not there where it is NULL.
        let (model, frame) = unsafe { (present(model)?, sized::read("frame", frame)?) };
        let options = match options.is_null() {
            true => SspcOptions::DEFAULT,
            // SAFETY: the caller's promise.
            false => unsafe { sized::read("options", options)? },
        };
        // SAFETY: the caller's promise.
        let (given, job) = unsafe {
            let given = sized::read("picture", picture)?;
            (given, Job::new(&frame, &given)?)
        };
        job.check_memory()?;
        // SAFETY: the callback is a function of the caller's, which it may be called with.
        let tell = |done| options.progress.is_some_and(|progress| unsafe { progress(options.user, done) } != 0);
        let threads = Threads::start(options.threads)?;
        // SAFETY: the caller's promise.
        let work = |watch: &Watch| unsafe { job.run(model, options.strength, watch) };
        let CorrectedFrame { corrected, report } = watched(threads.pool(), tell, work)?;
        drop(threads);
        let said = told(given, &corrected, report.warnings().len());
        let text = serde_json::to_string(&report)
            .map_err(|error| Failure::new(Code::Run, format!("cannot write the report: {error}"), ""))?;
        // SAFETY: it was read.
        unsafe { sized::write(&said, picture) };
        Ok(text)
    })
}

/// The checked pictures of a call.
struct Job {
    size: Size,
    given: Vec<(Role, Buffer, Given)>,
    further: Vec<Further>,
    samples: Option<[f64; 2]>,
    picture: Wanted,
    share: Option<Wanted>,
}

struct Further {
    halves: [Given; 2],
    full: Option<Given>,
}

impl Job {
    /// # Safety
    /// The frame's further pictures are as many as it says.
    unsafe fn new(frame: &SspcFrame, picture: &SspcPicture) -> Result<Self, Failure> {
        let size = Size::of(frame)?;
        let mut given = Vec::new();
        for (role, buffer) in PICTURES {
            let of_role = Given::of(&name(role, buffer), role.channels(), size, input(frame, role, buffer))?;
            given.extend(of_role.map(|picture| (role, buffer, picture)));
        }
        // SAFETY: the caller's promise.
        let further = unsafe { further(frame)? };
        let further = further.iter().enumerate().map(|(at, pictures)| Further::new(at, size, pictures));
        let picture_wanted = Wanted::of("picture", 3, size, &picture.picture)?;
        let missing = || nonsense("picture.picture.data", "where the picture goes", "NULL", "give a buffer");
        Ok(Self {
            size,
            given,
            further: further.collect::<Result<_, _>>()?,
            samples: (frame.samples_a != 0.0 || frame.samples_b != 0.0).then_some([frame.samples_a, frame.samples_b]),
            picture: picture_wanted.ok_or_else(missing)?,
            share: Wanted::of("share", 1, size, &picture.share)?,
        })
    }

    /// Refuses a size whose memory cannot be had at all: later, the process would end.
    fn check_memory(&self) -> Result<(), Failure> {
        let further = self.further.iter().flat_map(|further| further.halves.iter().chain(&further.full));
        let given: usize = self.given.iter().map(|(.., given)| given).chain(further).map(Given::channels).sum();
        let bytes = self.size.pixels().saturating_mul(size_of::<f32>() * (given + 3));
        Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| {
            let message = format!("memory for {} pixels cannot be had: {bytes} bytes at least", self.size.pixels());
            Failure::new(Code::Run, message, "correct the picture in parts, or on a larger machine")
        })
    }

    /// Reads the pictures, corrects the frame, and writes what is wanted.
    ///
    /// # Safety
    /// The caller's buffers hold all values of the pictures.
    unsafe fn run(&self, model: &Model, strength: f32, watch: &Watch) -> Result<CorrectedFrame, Failure> {
        // SAFETY: the caller's promise.
        let read = |given: &Given| unsafe { given.read() };
        let mut frame = GivenFrame::default();
        self.samples.map_or(Ok(()), |samples| frame.weigh(samples))?;
        for (role, buffer, given) in &self.given {
            frame.put(*role, *buffer, read(given));
        }
        for Further { halves, full } in &self.further {
            frame.put_denoised(DenoisedVariant { halves: halves.each_ref().map(read), full: full.as_ref().map(read) });
        }
        let done = correct_frame(frame, model, strength, self.share.is_some(), watch)?;
        // SAFETY: the caller's promise.
        unsafe {
            self.picture.write(&done.corrected.picture);
            if let (Some(wanted), Some(maps)) = (&self.share, &done.corrected.maps) {
                wanted.write(&maps.share);
            }
        }
        Ok(done)
    }
}

impl Further {
    fn new(at: usize, size: Size, pictures: &SspcDenoised) -> Result<Self, Failure> {
        let of = |part: &str, input: &SspcInput| Given::of(&format!("denoised_more[{at}].{part}"), 3, size, input);
        let half = |part: &str, input: &SspcInput| {
            let missing = || {
                let message =
                    format!("denoised_more[{at}].{part}: expected a denoised picture of the half, found NULL");
                Failure::new(Code::Input, message, "give both halves of each")
            };
            of(part, input)?.ok_or_else(missing)
        };
        let halves = [half("a", &pictures.a)?, half("b", &pictures.b)?];
        Ok(Self { halves, full: of("full", &pictures.full)? })
    }
}

/// # Safety
/// The frame's further pictures are as many as it says.
unsafe fn further(frame: &SspcFrame) -> Result<&[SspcDenoised], Failure> {
    let (pictures, count) = (frame.denoised_more, frame.denoised_more_count);
    if count == 0 {
        return Ok(&[]);
    }
    if pictures.is_null() {
        return Err(nonsense("denoised_more", &format!("{count} pictures"), "NULL", "set denoised_more_count to 0"));
    }
    if count >= MAX_NETWORKS {
        let expected = format!("at most {}", MAX_NETWORKS - 1);
        return Err(nonsense("denoised_more_count", &expected, count, "give those that the model was fitted with"));
    }
    // SAFETY: the caller's promise.
    Ok(unsafe { slice::from_raw_parts(pictures, count) })
}

fn input(frame: &SspcFrame, role: Role, buffer: Buffer) -> &SspcInput {
    let of_half = |a, b| if buffer == Buffer::A { a } else { b };
    match role {
        Role::Radiance => of_half(&frame.a, &frame.b),
        Role::Denoised if buffer == Buffer::Full => &frame.denoised,
        Role::Denoised => of_half(&frame.denoised_a, &frame.denoised_b),
        Role::Albedo => of_half(&frame.albedo_a, &frame.albedo_b),
        Role::Normal => of_half(&frame.normal_a, &frame.normal_b),
        Role::Visibility => of_half(&frame.visibility_a, &frame.visibility_b),
        Role::Motion | Role::Position => unreachable!("motion is of shots"),
        Role::Dx | Role::Dy => unreachable!("differences are of training"),
    }
}

/// The caller's structure with what is told of the picture.
fn told(given: SspcPicture, corrected: &Corrected, warnings: usize) -> SspcPicture {
    let mean = |mean: &Mean| SspcMean { value: mean.value, standard_error: mean.standard_error.unwrap_or(f64::NAN) };
    let estimate = &corrected.verdict.estimate;
    SspcPicture {
        error_denoised: mean(&estimate.denoised),
        error_corrected: mean(&estimate.corrected),
        gain: mean(&estimate.gain),
        mean_share: corrected.mean_share,
        is_denoised: corrected.verdict.fallback.is_some().into(),
        warnings: u32::try_from(warnings).unwrap_or(u32::MAX),
        ..given
    }
}
