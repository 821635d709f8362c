//! Progress, stopping, and what is refused, with the programs' codes.

use crate::buffers::{Laid, Layout};
use crate::files::{Files, HEIGHT, WIDTH, model};
use crate::frame::{InMemory, Loaded, correct, options, picture, said};
use sspc::model::{sspc_model_describe, sspc_model_load, sspc_model_read};
use sspc::outcome::{sspc_advice, sspc_message, sspc_report};
use sspc::types::{
    SSPC_ARGUMENTS, SSPC_INPUT, SSPC_INTERRUPTED, SSPC_MAX_SIDE, SSPC_OK, SspcDenoised, SspcFrame, SspcModelInfo,
    SspcOptions, SspcPicture,
};
use sspc_kernels::parameters::Form;
use std::ffi::{CString, c_int, c_void};
use std::mem::zeroed;
use std::ptr;
use std::thread::{self, ThreadId};

/// What a callback heard, and when it says stop.
struct Heard {
    shares: Vec<f64>,
    threads: Vec<ThreadId>,
    stop_at: usize,
}

unsafe extern "C" fn hear(user: *mut c_void, done: f64) -> c_int {
    // SAFETY: `user` is what the test gave, and the call is on its thread.
    let heard = unsafe { &mut *user.cast::<Heard>() };
    heard.shares.push(done);
    heard.threads.push(thread::current().id());
    c_int::from(heard.shares.len() == heard.stop_at)
}

fn listening(heard: &mut Heard) -> SspcOptions {
    SspcOptions { progress: Some(hear), user: ptr::from_mut(heard).cast(), threads: 2, ..options() }
}

fn heard(stop_at: usize) -> Heard {
    Heard { shares: Vec::new(), threads: Vec::new(), stop_at }
}

fn in_memory() -> InMemory {
    InMemory::read(&Files::write(), &[Layout::default()], |image| image)
}

#[test]
fn progress_is_told_to_the_caller_and_never_falls() {
    let (frame, model) = (in_memory(), Loaded::of(&model(Form::Gated, 1)));
    let (mut heard, mut room) = (heard(0), Laid::room(Layout::default(), 3, HEIGHT, WIDTH));
    let mut told = picture(room.output());
    assert_eq!(correct(&model, &frame.frame(), &listening(&mut heard), &mut told), SSPC_OK);
    assert!(heard.shares.is_sorted() && heard.shares.len() > 3, "{:?}", heard.shares);
    assert_eq!((heard.shares.first(), heard.shares.last()), (Some(&0.0), Some(&1.0)));
    assert!(heard.threads.iter().all(|thread| *thread == thread::current().id()));
}

#[test]
fn an_answer_stops_the_work_and_nothing_is_written() {
    let (frame, model) = (in_memory(), Loaded::of(&model(Form::Gated, 1)));
    // At the start, before the first window, and after the last.
    for stop_at in [1, 2, 4] {
        let (mut heard, mut room) = (heard(stop_at), Laid::room(Layout::default(), 3, HEIGHT, WIDTH));
        let mut told = picture(room.output());
        let code = correct(&model, &frame.frame(), &listening(&mut heard), &mut told);
        assert_eq!((code, said(sspc_message()).as_str()), (SSPC_INTERRUPTED, "interrupted"));
        assert!(heard.shares.len() == stop_at && room.untouched() && said(sspc_report()).is_empty());
    }
}

/// The code and message of a call with something changed.
fn refused(change: impl FnOnce(&mut SspcFrame, &mut SspcOptions, &mut SspcPicture)) -> (c_int, String) {
    let (in_memory, model) = (in_memory(), Loaded::of(&model(Form::Gated, 1)));
    let mut room = Laid::room(Layout::default(), 3, HEIGHT, WIDTH);
    let (mut frame, mut options, mut told) = (in_memory.frame(), options(), picture(room.output()));
    change(&mut frame, &mut options, &mut told);
    let code = correct(&model, &frame, &options, &mut told);
    assert!(room.untouched(), "something was written");
    (code, said(sspc_message()))
}

#[test]
fn arguments_that_make_no_sense_are_refused() {
    type Change = fn(&mut SspcFrame, &mut SspcOptions, &mut SspcPicture);
    let cases: [(Change, &str); 13] = [
        (|frame, _, _| frame.width = 0, "frame: expected 1 to 65536 pixels a side"),
        (|frame, _, _| frame.height = SSPC_MAX_SIDE + 1, "found 75 x 65537"),
        (|frame, _, _| frame.struct_size = 8, "frame.struct_size: expected at least 472, found 8"),
        (
            |frame, _, _| frame.albedo_b.layout.value_type = 7,
            "albedo_b.layout.value_type: expected SSPC_FLOAT32 or SSPC_FLOAT16, found 7",
        ),
        (|frame, _, _| frame.denoised.layout.reserved = 1, "denoised.layout.reserved: expected 0, found 1"),
        (
            |frame, _, _| frame.a.layout.row_stride = isize::MIN,
            "a.layout.row_stride: expected values within the memory of a process",
        ),
        (|frame, _, _| frame.denoised_more_count = 2, "denoised_more: expected 2 pictures, found NULL"),
        (|frame, _, _| frame.samples_b = 8.0, "samples: half a has 0 samples"),
        (|frame, _, _| (frame.samples_a, frame.samples_b) = (1.0, 1e3), "samples: halves of 1 and 1000 samples"),
        (|_, options, _| options.threads = 5000, "threads: expected 0 to 1024, found 5000"),
        (|_, options, _| options.strength = f32::NAN, "strength NaN: expected a number from 0 to 1"),
        (
            |_, _, picture| picture.picture.data = ptr::null_mut(),
            "picture.picture.data: expected where the picture goes",
        ),
        (|_, _, picture| picture.struct_size = 0, "picture.struct_size: expected at least 152, found 0"),
    ];
    for (change, expected) in cases {
        let with_null = |frame: &mut SspcFrame, options: &mut SspcOptions, picture: &mut SspcPicture| {
            frame.denoised_more = ptr::null();
            change(frame, options, picture);
        };
        let (code, message) = refused(with_null);
        assert!(code == SSPC_ARGUMENTS && message.contains(expected), "{expected}: {code} {message}");
    }
}

#[test]
fn frames_that_cannot_be_used_are_refused() {
    type Change = fn(&mut SspcFrame, &mut SspcOptions, &mut SspcPicture);
    let cases: [(Change, &str); 2] = [
        (
            |frame, _, _| frame.denoised_b.data = ptr::null(),
            "denoised_b: expected the denoised colour of half b, found nothing",
        ),
        (|frame, _, _| frame.b = frame.a, "b: noisy colour of half b: expected samples independent of a"),
    ];
    for (change, expected) in cases {
        let (code, message) = refused(change);
        assert!(code == SSPC_INPUT && message.contains(expected), "{expected}: {code} {message}");
        assert!(!said(sspc_advice()).is_empty());
    }
    // SAFETY: all zero are pictures that are not there.
    let more: SspcDenoised = unsafe { zeroed() };
    let (code, message) = refused(|frame, _, _| (frame.denoised_more, frame.denoised_more_count) = (&more, 1));
    let expected = "denoised_more[0].a: expected a denoised picture of the half, found NULL";
    assert_eq!((code, message.as_str()), (SSPC_INPUT, expected));

    let (frame, model) = (in_memory(), Loaded::of(&model(Form::Gated, 2)));
    let mut room = Laid::room(Layout::default(), 3, HEIGHT, WIDTH);
    assert_eq!(correct(&model, &frame.frame(), &options(), &mut picture(room.output())), SSPC_INPUT);
    assert_eq!(said(sspc_message()), "the model wants 2 denoised pictures of each half, found 1");
}

#[test]
fn a_feature_of_one_half_is_left_out_and_named() {
    let (in_memory, model) = (in_memory(), Loaded::of(&model(Form::Gated, 1)));
    let mut room = Laid::room(Layout::default(), 3, HEIGHT, WIDTH);
    let mut one_sided = in_memory.frame();
    one_sided.normal_b.data = ptr::null();
    assert_eq!(correct(&model, &one_sided, &options(), &mut picture(room.output())), SSPC_OK);
    assert!(said(sspc_report()).contains("normal: only half a has it (normal_a), so it is not used"));
}

#[test]
fn models_are_described_and_strangers_refused() {
    let loaded = Loaded::of(&model(Form::Gated, 2));
    // SAFETY: all zero is what `sspc_model_info` makes, but for the size.
    let nothing: SspcModelInfo = unsafe { zeroed() };
    let mut info = SspcModelInfo { struct_size: size_of::<SspcModelInfo>(), ..nothing };
    // SAFETY: the model lives.
    assert_eq!(unsafe { sspc_model_describe(loaded.0, &mut info) }, SSPC_OK);
    assert_eq!((info.contract_version, info.networks, info.extra_frames, info.albedo), (2, 2, 0, 1));

    let mut place = loaded.0;
    let missing = CString::new("/nowhere/model.onnx").expect("a path");
    // SAFETY: a string, and a place for a pointer.
    assert_eq!(unsafe { sspc_model_load(missing.as_ptr(), &mut place) }, SSPC_INPUT);
    assert!(place.is_null() && said(sspc_message()).starts_with("/nowhere/model.onnx: cannot be read"));
    // SAFETY: four bytes, and a place for a pointer.
    assert_eq!(unsafe { sspc_model_read(b"ONNX".as_ptr().cast(), 4, &mut place) }, SSPC_INPUT);
    // SAFETY: NULL is refused.
    let codes = unsafe {
        [
            sspc_model_load(ptr::null(), &mut place),
            sspc_model_load(missing.as_ptr(), ptr::null_mut()),
            sspc_model_read(ptr::null(), 4, &mut place),
            sspc_model_describe(ptr::null(), &mut info),
        ]
    };
    assert_eq!(codes, [SSPC_ARGUMENTS; 4]);
}
