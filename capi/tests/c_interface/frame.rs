//! A frame in memory, as a host hands it over.

use crate::buffers::{Laid, Layout};
use crate::files::{Files, HEIGHT, WIDTH};
use sspc::correct::sspc_correct;
use sspc::model::{SspcModel, sspc_model_free, sspc_model_read};
use sspc::outcome::{sspc_message, sspc_report};
use sspc::types::{SSPC_OK, SspcDenoised, SspcFrame, SspcInput, SspcOptions, SspcOutput, SspcPicture};
use sspc_image::Image;
use sspc_onnx::{Model, write_network};
use sspc_testkit::frames::planes;
use std::ffi::{CStr, c_char, c_int};
use std::mem::zeroed;
use std::ptr;

/// Files of the frame, in the order of the fields of `SspcFrame`.
const FILES: [&str; 10] =
    ["a", "b", "za", "zb", "albedo-a", "albedo-b", "normal-a", "normal-b", "visibility-a", "visibility-b"];

/// A model of the library's.
pub struct Loaded(pub *mut SspcModel);

impl Loaded {
    pub fn of(model: &Model) -> Self {
        let bytes = write_network(model);
        let mut loaded = ptr::null_mut();
        // SAFETY: so many bytes, and a place for a pointer.
        let code = unsafe { sspc_model_read(bytes.as_ptr().cast(), bytes.len(), &mut loaded) };
        assert_eq!(code, SSPC_OK, "{}", said(sspc_message()));
        Self(loaded)
    }
}

impl Drop for Loaded {
    fn drop(&mut self) {
        // SAFETY: made by the library, and freed once.
        unsafe { sspc_model_free(self.0) }
    }
}

/// The pictures of a frame in memory.
pub struct InMemory {
    pub pictures: Vec<Laid>,
    /// Further denoised pictures.
    more: Vec<SspcDenoised>,
}

impl InMemory {
    /// As the files have them, laid out in turn as `layouts` say.
    pub fn read(files: &Files, layouts: &[Layout], change: impl Fn(Image) -> Image) -> Self {
        let pictures = FILES.iter().enumerate().map(|(at, name)| {
            let image = change(files.read(name));
            let image = if name.starts_with("visibility") { planes(&image, 0, 1) } else { image };
            Laid::of(layouts[at % layouts.len()], &image)
        });
        Self { pictures: pictures.collect(), more: Vec::new() }
    }

    /// The same with a further denoised picture: each half has the other's.
    pub fn with_more(mut self) -> Self {
        let [a, b] = [&self.pictures[3], &self.pictures[2]].map(Laid::input);
        self.more = vec![SspcDenoised { a, b, full: SspcInput { data: ptr::null(), ..a } }];
        self
    }

    /// As the interface takes it.
    pub fn frame(&self) -> SspcFrame {
        // SAFETY: all zero is a frame without pictures, which is what `sspc_frame` makes.
        let mut frame: SspcFrame = unsafe { zeroed() };
        let input = |at: usize| self.pictures[at].input();
        frame.struct_size = size_of::<SspcFrame>();
        (frame.width, frame.height) = (WIDTH as u32, HEIGHT as u32);
        (frame.a, frame.b, frame.denoised_a, frame.denoised_b) = (input(0), input(1), input(2), input(3));
        (frame.albedo_a, frame.albedo_b, frame.normal_a, frame.normal_b) = (input(4), input(5), input(6), input(7));
        (frame.visibility_a, frame.visibility_b) = (input(8), input(9));
        (frame.denoised_more, frame.denoised_more_count) = (self.more.as_ptr(), self.more.len());
        frame
    }
}

pub fn options() -> SspcOptions {
    // SAFETY: all zero are options, as `sspc_options` makes them but for the strength.
    let nothing: SspcOptions = unsafe { zeroed() };
    SspcOptions { struct_size: size_of::<SspcOptions>(), strength: 1.0, ..nothing }
}

pub fn picture(to: SspcOutput) -> SspcPicture {
    // SAFETY: all zero is a picture without a place, as `sspc_picture` makes it.
    let nothing: SspcPicture = unsafe { zeroed() };
    SspcPicture { struct_size: size_of::<SspcPicture>(), picture: to, ..nothing }
}

/// Calls `sspc_correct` with a frame whose buffers live.
pub fn correct(model: &Loaded, frame: &SspcFrame, options: &SspcOptions, picture: &mut SspcPicture) -> c_int {
    // SAFETY: the model lives, and so do the buffers.
    unsafe { sspc_correct(model.0, frame, options, picture) }
}

/// Corrects a frame into memory of its own; what is said of it, and the report.
pub fn corrected(model: &Loaded, frame: &InMemory, layout: Layout) -> (Image, SspcPicture, String) {
    let mut room = Laid::room(layout, 3, HEIGHT, WIDTH);
    let mut picture = picture(room.output());
    let code = correct(model, &frame.frame(), &options(), &mut picture);
    assert_eq!(code, SSPC_OK, "{}", said(sspc_message()));
    (room.image(), picture, said(sspc_report()))
}

/// A text of the library's.
pub fn said(text: *const c_char) -> String {
    // SAFETY: the thread's texts are strings of C, kept until its next call.
    unsafe { CStr::from_ptr(text) }.to_str().expect("UTF-8").to_string()
}
