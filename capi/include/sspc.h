/* sspc: corrects denoised Monte Carlo renders with a fitted model; see capi/README.md.
 *
 * Calls that do something return a code, SSPC_OK or the programs' exit codes; sspc_message() and sspc_advice() say what
 * went wrong. Any number of threads may call at the same time. Nothing is kept between calls but models and each
 * thread's texts; no call prints, except that a fault of the library says where it happened on standard error.
 *
 * Written from capi/src by `cargo run --manifest-path capi/header/Cargo.toml`. */

#ifndef SSPC_H
#define SSPC_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

// Version of the interface that this header describes. `sspc_abi_version` tells the library's: a program that was compiled
// against one version works with every library of the same version. New functions, and new fields at the ends of
// structures, do not raise it.
#define SSPC_ABI_VERSION 1

// Done.
#define SSPC_OK 0

// The arguments make no sense.
#define SSPC_ARGUMENTS 2

// An input is missing, damaged or not what it should be.
#define SSPC_INPUT 3

// The run failed: memory ran out, threads could not be started, or a fault of the library.
#define SSPC_RUN 4

// The progress callback asked to stop.
#define SSPC_INTERRUPTED 130

// Values are `float`.
#define SSPC_FLOAT32 0

// Values are IEEE 754 half floats.
#define SSPC_FLOAT16 1

// Longest side of a picture, pixels.
#define SSPC_MAX_SIDE 65536

// Most pixels of a picture.
#define SSPC_MAX_PIXELS 268435456

// A fitted model. Any number of threads may use one at the same time.
typedef struct SspcModel SspcModel;

// What a model is. Made by `sspc_model_info`, filled by `sspc_model_describe`.
typedef struct SspcModelInfo {
    // `sizeof(SspcModelInfo)`.
    size_t struct_size;
    // Version of the model's contract: 1, or 2 with several networks, or 3 of a shot.
    uint32_t contract_version;
    // How many denoised pictures of each half it wants: one beside `denoised_more_count`.
    uint32_t networks;
    // Neighbouring frames on each side that it was fitted with. `sspc_correct` takes every frame by itself, as
    // `sspc-infer run` does without neighbours: the picture is corrected less well, and a warning says so.
    uint32_t extra_frames;
    // Whether it was fitted with albedo, 0 or 1; what it was fitted without is not used.
    uint32_t albedo;
    // Whether it was fitted with normals, 0 or 1.
    uint32_t normal;
    // Whether it was fitted with visibility, 0 or 1.
    uint32_t visibility;
} SspcModelInfo;

// How a picture lies in memory. Channel c of the pixel in column x of row y, counted from the top, lies at
// `data + y * row_stride + x * pixel_stride + c * channel_stride`; values need no alignment. Strides are bytes and may be
// negative. 0 stands for packed: a `channel_stride` of one value, a `pixel_stride` of as many values as the picture has
// channels, a `row_stride` of as many pixels as a row has. So packed RGB floats are all zero, RGBA has a `pixel_stride` of 4
// values, and planes have a `pixel_stride` of one value and a `channel_stride` of `width * height` values.
typedef struct SspcLayout {
    // Bytes from a pixel to the next of its row; 0 for packed.
    ptrdiff_t pixel_stride;
    // Bytes from a row to the one below; 0 for packed.
    ptrdiff_t row_stride;
    // Bytes from a channel of a pixel to the next; 0 for packed.
    ptrdiff_t channel_stride;
    // SSPC_FLOAT32 or SSPC_FLOAT16.
    uint32_t value_type;
    // 0.
    uint32_t reserved;
} SspcLayout;

// A picture of the caller's that is read.
typedef struct SspcInput {
    // The first row's first pixel; NULL where there is no such picture.
    const void *data;
    // How it lies.
    struct SspcLayout layout;
} SspcInput;

// A further denoised picture of the same samples, e.g. by another denoiser; 3 channels each.
typedef struct SspcDenoised {
    // Of half a.
    struct SspcInput a;
    // Of half b.
    struct SspcInput b;
    // Of the full buffer; without it, the mean of both is taken.
    struct SspcInput full;
} SspcDenoised;

// A frame: two half buffers of one picture, rendered with different seeds, and what a denoiser made of each half and of
// both together. Made by `sspc_frame`. Radiance is linear, scene-referred RGB; pixels with NaN or infinity count as missing.
// A feature that only one half has is not used.
typedef struct SspcFrame {
    // `sizeof(SspcFrame)`.
    size_t struct_size;
    // Columns of every picture, 1 to SSPC_MAX_SIDE.
    uint32_t width;
    // Rows of every picture, 1 to SSPC_MAX_SIDE.
    uint32_t height;
    // Noisy radiance of half a, 3 channels.
    struct SspcInput a;
    // Noisy radiance of half b, 3 channels.
    struct SspcInput b;
    // The denoiser's picture of half a alone, 3 channels.
    struct SspcInput denoised_a;
    // The denoiser's picture of half b alone, 3 channels.
    struct SspcInput denoised_b;
    // The denoiser's picture of both halves together, 3 channels, which is corrected. Optional: without it the mean of both
    // denoised halves is, which is noisier.
    struct SspcInput denoised;
    // Albedo of half a, 3 channels, 0..1. Optional, as the features below.
    struct SspcInput albedo_a;
    // Albedo of half b.
    struct SspcInput albedo_b;
    // Shading normal of half a, 3 channels, -1..1.
    struct SspcInput normal_a;
    // Shading normal of half b.
    struct SspcInput normal_b;
    // Visibility of the lights at the first hit of half a, 1 channel, 0..1.
    struct SspcInput visibility_a;
    // Visibility of half b.
    struct SspcInput visibility_b;
    // Further denoised pictures, for models that were fitted with them, in the same order; NULL without.
    const struct SspcDenoised *denoised_more;
    // How many there are.
    size_t denoised_more_count;
    // Samples per pixel of half a, which say what it weighs in means of both halves; 0 where they are not known: halves
    // weigh alike then.
    double samples_a;
    // Samples per pixel of half b; known where those of half a are.
    double samples_b;
} SspcFrame;

// Told how far the work is: `done` from 0 to 1 never falls. Called on the thread that called `sspc_correct`, some hundred
// times for a large picture, and the work waits for it. It must not call `sspc_correct`, and must return (no longjmp, no
// exception). An answer other than 0 ends the work with SSPC_INTERRUPTED, after a tile or two of the network, in the last
// quarter at the end, and nothing is written; from 0.99 on it may come too late.
typedef int (*SspcProgress)(void *user, double done);

// How a frame is corrected. Made by `sspc_options`.
typedef struct SspcOptions {
    // `sizeof(SspcOptions)`.
    size_t struct_size;
    // Share of the correction that is added to the denoiser's picture, 0..1.
    float strength;
    // Threads; 0 for one on each core. The picture is the same, bit for bit, for any number.
    uint32_t threads;
    // Told how far the work is; NULL for nothing.
    SspcProgress progress;
    // Handed to `progress`.
    void *user;
} SspcOptions;

// A picture of the caller's that is written. Bytes between its values are left alone. It may be one of the inputs: all of
// them are read before anything is written.
typedef struct SspcOutput {
    // The first row's first pixel; NULL where it is not wanted.
    void *data;
    // How it lies.
    struct SspcLayout layout;
} SspcOutput;

// A mean over the picture.
typedef struct SspcMean {
    // The mean.
    double value;
    // Its standard error; NaN where there are too few pixels to tell.
    double standard_error;
} SspcMean;

// Where the picture goes, and what is told of it. Made by `sspc_picture`.
typedef struct SspcPicture {
    // `sizeof(SspcPicture)`.
    size_t struct_size;
    // The corrected picture, 3 channels, as large as the frame and in its units. Half floats overflow to infinity.
    struct SspcOutput picture;
    // Share of the correction that was used at each pixel, 0..1, 1 channel; optional.
    struct SspcOutput share;
    // Set by the call: relL2 of the mean of both denoised halves, estimated without a reference.
    struct SspcMean error_denoised;
    // Set by the call: the same of the mean of both corrected halves.
    struct SspcMean error_corrected;
    // Set by the call: the first less the second; what they share of their uncertainty is gone.
    struct SspcMean gain;
    // Set by the call: mean share of the correction that was used, 0..1.
    double mean_share;
    // Set by the call: 1 where the picture is the denoiser's, bit for bit, because the correction would not have helped or
    // the halves are not independent; `sspc_report` says why in `fallback`. Else 0.
    uint32_t is_denoised;
    // Set by the call: how many warnings `sspc_report` has.
    uint32_t warnings;
} SspcPicture;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// What went wrong in this thread's last call that returned a code, one line in the programs' words, UTF-8; empty after
// SSPC_OK. Kept until the thread's next such call.
const char *sspc_message(void);

// One line of advice beside `sspc_message`; may be empty.
const char *sspc_advice(void);

// After `sspc_correct` returned SSPC_OK: every figure of the picture as JSON, by the keys of `sspc-infer run --json`,
// `warnings` (what a person should know) and `fallback` among them; UTF-8, else empty. Kept as `sspc_message`.
const char *sspc_report(void);

// The interface's version that the library has; see SSPC_ABI_VERSION.
uint32_t sspc_abi_version(void);

// The version of the programs that the library belongs to, e.g. "0.1.0". Pictures may differ between versions.
const char *sspc_version(void);

// Reads a model's file, `model.onnx` as `sspc-train fit` or `export` wrote it, whose path is UTF-8; gives NULL where that
// fails.
//
// # Safety
// `path` is a string, and `model` a place for a pointer.
int sspc_model_load(const char *path,
                    struct SspcModel **model);

// The same of the bytes of such a file, which are not needed afterwards.
//
// # Safety
// `bytes` are so many, and `model` is a place for a pointer.
int sspc_model_read(const void *bytes, size_t count, struct SspcModel **model);

// Frees a model; NULL is left alone.
//
// # Safety
// It was made by this library, is freed once, and no call uses it meanwhile or later.
void sspc_model_free(struct SspcModel *model);

// Says what a model is.
//
// # Safety
// The model is none that was freed, and `info` was made by `sspc_model_info`.
int sspc_model_describe(const struct SspcModel *model, struct SspcModelInfo *info);

// Corrects a frame, as `sspc-infer run` does: the same pixels, bit for bit. `options` may be NULL: strength 1, all cores.
// Where it does not return SSPC_OK, nothing was written to the buffers.
//
// Memory while it works: 4 bytes for every value given, 12 for each pixel (28 with `share`), and 440 for each pixel of the
// rows at hand, at most some 800 MiB; all of it is given back. Its threads begin and end within the call. A process whose
// memory runs out is ended by the system, or by the library; sizes that cannot be had at all are refused first.
//
// # Safety
// `model` is one that is not freed meanwhile. `frame`, `options` and `picture` were made by `sspc_frame`, `sspc_options`
// and `sspc_picture`; their buffers hold all values, nobody else writes to them meanwhile, and nobody reads the outputs.
int sspc_correct(const struct SspcModel *model,
                 const struct SspcFrame *frame,
                 const struct SspcOptions *options,
                 struct SspcPicture *picture);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#ifdef __cplusplus
extern "C" {
#endif

/* A frame of this size without pictures. */
static inline SspcFrame sspc_frame(uint32_t width, uint32_t height) {
    SspcFrame frame;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    frame.width = width;
    frame.height = height;
    return frame;
}

/* The whole correction, on all cores, without a callback. */
static inline SspcOptions sspc_options(void) {
    SspcOptions options;
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.strength = 1.0f;
    return options;
}

/* No place for the picture yet. */
static inline SspcPicture sspc_picture(void) {
    SspcPicture picture;
    memset(&picture, 0, sizeof picture);
    picture.struct_size = sizeof picture;
    return picture;
}

/* To be filled by sspc_model_describe. */
static inline SspcModelInfo sspc_model_info(void) {
    SspcModelInfo info;
    memset(&info, 0, sizeof info);
    info.struct_size = sizeof info;
    return info;
}

#ifdef __cplusplus
}
#endif

#endif /* SSPC_H */
