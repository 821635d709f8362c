//! The structures and constants of the interface. Their documentation is the header's.

use std::ffi::{c_int, c_void};
use std::ptr;

/// Version of the interface that this header describes. `sspc_abi_version` tells the library's: a program that was compiled
/// against one version works with every library of the same version. New functions, and new fields at the ends of
/// structures, do not raise it.
pub const SSPC_ABI_VERSION: u32 = 1;

/// Done.
pub const SSPC_OK: c_int = 0;
/// The arguments make no sense.
pub const SSPC_ARGUMENTS: c_int = 2;
/// An input is missing, damaged or not what it should be.
pub const SSPC_INPUT: c_int = 3;
/// The run failed: memory ran out, threads could not be started, or a fault of the library.
pub const SSPC_RUN: c_int = 4;
/// The progress callback asked to stop.
pub const SSPC_INTERRUPTED: c_int = 130;

/// Values are `float`.
pub const SSPC_FLOAT32: u32 = 0;
/// Values are IEEE 754 half floats.
pub const SSPC_FLOAT16: u32 = 1;

/// Longest side of a picture, pixels.
pub const SSPC_MAX_SIDE: u32 = 65536;
/// Most pixels of a picture.
pub const SSPC_MAX_PIXELS: u64 = 268435456;

/// How a picture lies in memory. Channel c of the pixel in column x of row y, counted from the top, lies at
/// `data + y * row_stride + x * pixel_stride + c * channel_stride`; values need no alignment. Strides are bytes and may be
/// negative. 0 stands for packed: a `channel_stride` of one value, a `pixel_stride` of as many values as the picture has
/// channels, a `row_stride` of as many pixels as a row has. So packed RGB floats are all zero, RGBA has a `pixel_stride` of 4
/// values, and planes have a `pixel_stride` of one value and a `channel_stride` of `width * height` values.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcLayout {
    /// Bytes from a pixel to the next of its row; 0 for packed.
    pub pixel_stride: isize,
    /// Bytes from a row to the one below; 0 for packed.
    pub row_stride: isize,
    /// Bytes from a channel of a pixel to the next; 0 for packed.
    pub channel_stride: isize,
    /// SSPC_FLOAT32 or SSPC_FLOAT16.
    pub value_type: u32,
    /// 0.
    pub reserved: u32,
}

/// A picture of the caller's that is read.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcInput {
    /// The first row's first pixel; NULL where there is no such picture.
    pub data: *const c_void,
    /// How it lies.
    pub layout: SspcLayout,
}

/// A picture of the caller's that is written. Bytes between its values are left alone. It may be one of the inputs: all of
/// them are read before anything is written.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcOutput {
    /// The first row's first pixel; NULL where it is not wanted.
    pub data: *mut c_void,
    /// How it lies.
    pub layout: SspcLayout,
}

/// A further denoised picture of the same samples, e.g. by another denoiser; 3 channels each.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcDenoised {
    /// Of half a.
    pub a: SspcInput,
    /// Of half b.
    pub b: SspcInput,
    /// Of the full buffer; without it, the mean of both is taken.
    pub full: SspcInput,
}

/// A frame: two half buffers of one picture, rendered with different seeds, and what a denoiser made of each half and of
/// both together. Made by `sspc_frame`. Radiance is linear, scene-referred RGB; pixels with NaN or infinity count as missing.
/// A feature that only one half has is not used.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcFrame {
    /// `sizeof(SspcFrame)`.
    pub struct_size: usize,
    /// Columns of every picture, 1 to SSPC_MAX_SIDE.
    pub width: u32,
    /// Rows of every picture, 1 to SSPC_MAX_SIDE.
    pub height: u32,
    /// Noisy radiance of half a, 3 channels.
    pub a: SspcInput,
    /// Noisy radiance of half b, 3 channels.
    pub b: SspcInput,
    /// The denoiser's picture of half a alone, 3 channels.
    pub denoised_a: SspcInput,
    /// The denoiser's picture of half b alone, 3 channels.
    pub denoised_b: SspcInput,
    /// The denoiser's picture of both halves together, 3 channels, which is corrected. Optional: without it the mean of both
    /// denoised halves is, which is noisier.
    pub denoised: SspcInput,
    /// Albedo of half a, 3 channels, 0..1. Optional, as the features below.
    pub albedo_a: SspcInput,
    /// Albedo of half b.
    pub albedo_b: SspcInput,
    /// Shading normal of half a, 3 channels, -1..1.
    pub normal_a: SspcInput,
    /// Shading normal of half b.
    pub normal_b: SspcInput,
    /// Visibility of the lights at the first hit of half a, 1 channel, 0..1.
    pub visibility_a: SspcInput,
    /// Visibility of half b.
    pub visibility_b: SspcInput,
    /// Further denoised pictures, for models that were fitted with them, in the same order; NULL without.
    pub denoised_more: *const SspcDenoised,
    /// How many there are.
    pub denoised_more_count: usize,
    /// Samples per pixel of half a, which say what it weighs in means of both halves; 0 where they are not known: halves
    /// weigh alike then.
    pub samples_a: f64,
    /// Samples per pixel of half b; known where those of half a are.
    pub samples_b: f64,
}

/// Told how far the work is: `done` from 0 to 1 never falls. Called on the thread that called `sspc_correct`, some hundred
/// times for a large picture, and the work waits for it. It must not call `sspc_correct`, and must return (no longjmp, no
/// exception). An answer other than 0 ends the work with SSPC_INTERRUPTED, after a tile or two of the network, in the last
/// quarter at the end, and nothing is written; from 0.99 on it may come too late.
pub type SspcProgress = Option<unsafe extern "C" fn(user: *mut c_void, done: f64) -> c_int>;

/// How a frame is corrected. Made by `sspc_options`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcOptions {
    /// `sizeof(SspcOptions)`.
    pub struct_size: usize,
    /// Share of the correction that is added to the denoiser's picture, 0..1.
    pub strength: f32,
    /// Threads; 0 for one on each core. The picture is the same, bit for bit, for any number.
    pub threads: u32,
    /// Told how far the work is; NULL for nothing.
    pub progress: SspcProgress,
    /// Handed to `progress`.
    pub user: *mut c_void,
}

/// A mean over the picture.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcMean {
    /// The mean.
    pub value: f64,
    /// Its standard error; NaN where there are too few pixels to tell.
    pub standard_error: f64,
}

/// Where the picture goes, and what is told of it. Made by `sspc_picture`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcPicture {
    /// `sizeof(SspcPicture)`.
    pub struct_size: usize,
    /// The corrected picture, 3 channels, as large as the frame and in its units. Half floats overflow to infinity.
    pub picture: SspcOutput,
    /// Share of the correction that was used at each pixel, 0..1, 1 channel; optional.
    pub share: SspcOutput,
    /// Set by the call: relL2 of the mean of both denoised halves, estimated without a reference.
    pub error_denoised: SspcMean,
    /// Set by the call: the same of the mean of both corrected halves.
    pub error_corrected: SspcMean,
    /// Set by the call: the first less the second; what they share of their uncertainty is gone.
    pub gain: SspcMean,
    /// Set by the call: mean share of the correction that was used, 0..1.
    pub mean_share: f64,
    /// Set by the call: 1 where the picture is the denoiser's, bit for bit, because the correction would not have helped or
    /// the halves are not independent; `sspc_report` says why in `fallback`. Else 0.
    pub is_denoised: u32,
    /// Set by the call: how many warnings `sspc_report` has.
    pub warnings: u32,
}

/// What a model is. Made by `sspc_model_info`, filled by `sspc_model_describe`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SspcModelInfo {
    /// `sizeof(SspcModelInfo)`.
    pub struct_size: usize,
    /// Version of the model's contract: 1, or 2 with several networks, or 3 of a shot.
    pub contract_version: u32,
    /// How many denoised pictures of each half it wants: one beside `denoised_more_count`.
    pub networks: u32,
    /// Neighbouring frames on each side that it was fitted with. `sspc_correct` takes every frame by itself, as
    /// `sspc-infer run` does without neighbours: the picture is corrected less well, and a warning says so.
    pub extra_frames: u32,
    /// Whether it was fitted with albedo, 0 or 1; what it was fitted without is not used.
    pub albedo: u32,
    /// Whether it was fitted with normals, 0 or 1.
    pub normal: u32,
    /// Whether it was fitted with visibility, 0 or 1.
    pub visibility: u32,
}

impl SspcOptions {
    /// What `sspc_options` says.
    pub(crate) const DEFAULT: Self =
        Self { struct_size: size_of::<Self>(), strength: 1.0, threads: 0, progress: None, user: ptr::null_mut() };
}
