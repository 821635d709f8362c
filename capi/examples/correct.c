/* Corrects a frame with a fitted model.
 *
 *     correct MODEL.onnx OUT.pfm                           a frame that it makes up
 *     correct MODEL.onnx OUT.pfm A B DENOISED_A DENOISED_B DENOISED     files of one size, PFM in colour
 *
 *     cc -std=c99 capi/examples/correct.c -Icapi/include -Ltarget/release -lsspc -lm -Wl,-rpath,target/release
 */
#include "sspc.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { A, B, DENOISED_A, DENOISED_B, DENOISED, PICTURES, ALBEDO = PICTURES, LAYERS };

/* What a renderer may keep of a pixel: the library reads it where it lies. */
typedef struct {
    float layer[LAYERS][3];
} Pixel;

typedef struct {
    uint32_t width, height;
    Pixel *pixels; /* From the bottom row up, as in PFM. */
} Film;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "error: %s: %s\n", what, why);
    exit(1);
}

static void resize(Film *film, uint32_t width, uint32_t height) {
    if (film->pixels && (film->width != width || film->height != height)) fail("frame", "files of different sizes");
    if (film->pixels) return;
    film->width = width;
    film->height = height;
    film->pixels = calloc((size_t)width * height, sizeof(Pixel));
    if (!film->pixels) fail("frame", "no memory");
}

/* Reads a colour PFM of this machine's byte order, little-endian: "PF", width, height, -1, values. */
static void read_pfm(Film *film, int which, const char *path) {
    unsigned width, height;
    float scale;
    FILE *file = fopen(path, "rb");
    if (!file) fail(path, "cannot be opened");
    if (fscanf(file, "PF %u %u %f", &width, &height, &scale) != 3 || fgetc(file) != '\n' || scale >= 0)
        fail(path, "no little-endian PFM in colour");
    if (width < 1 || height < 1 || width > SSPC_MAX_SIDE || height > SSPC_MAX_SIDE) fail(path, "no size");
    resize(film, width, height);
    for (size_t i = 0; i < (size_t)width * height; ++i)
        if (fread(film->pixels[i].layer[which], sizeof(float), 3, file) != 3) fail(path, "truncated");
    fclose(file);
}

static float uniform(uint32_t *state) {
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / (1 << 24);
}

/* A floor of tiles with noise; a denoiser leaves little noise, and takes a fifth of the contrast. */
static void make_up(Film *film) {
    uint32_t state = 1;
    resize(film, 256, 192);
    for (uint32_t y = 0; y < film->height; ++y)
        for (uint32_t x = 0; x < film->width; ++x)
            for (int c = 0; c < 3; ++c) {
                float(*of)[3] = film->pixels[(size_t)y * film->width + x].layer;
                float light = 1 + 0.3f * sinf(0.03f * (float)x) * cosf(0.02f * (float)y);
                of[ALBEDO][c] = (x / 5 + y / 7) % 2 ? 0.3f : 0.5f;
                for (int which = A; which < DENOISED; ++which) {
                    int denoised = which >= DENOISED_A;
                    float noise = uniform(&state) + uniform(&state) + uniform(&state) - 1.5f;
                    float albedo = 0.4f + (denoised ? 0.8f : 1) * (of[ALBEDO][c] - 0.4f);
                    of[which][c] = light * albedo * (1 + (denoised ? 0.01f : 0.3f) * noise);
                }
                of[DENOISED][c] = (of[DENOISED_A][c] + of[DENOISED_B][c]) / 2;
            }
}

/* Where a picture of the film begins: its top row is the last, and rows go down in memory. */
static SspcInput input(const Film *film, int which) {
    SspcInput input = {0};
    ptrdiff_t row = (ptrdiff_t)(film->width * sizeof(Pixel));
    input.data = film->pixels[(size_t)(film->height - 1) * film->width].layer[which];
    input.layout.pixel_stride = sizeof(Pixel);
    input.layout.row_stride = -row;
    return input;
}

static int progress(void *user, double done) {
    int percent = (int)(100 * done), *last = user;
    if (percent / 10 > *last / 10) fprintf(stderr, "%d %%\n", percent);
    *last = percent;
    return 0; /* Anything else stops it. */
}

static void check(int code) {
    if (code == SSPC_OK) return;
    fprintf(stderr, "error: %s\nadvice: %s\n", sspc_message(), sspc_advice());
    exit(code);
}

static void write_pfm(const char *path, uint32_t width, uint32_t height, const float *values) {
    FILE *file = fopen(path, "wb");
    size_t count = (size_t)width * height * 3;
    if (!file) fail(path, "cannot be opened");
    fprintf(file, "PF\n%u %u\n-1.0\n", (unsigned)width, (unsigned)height);
    if (fwrite(values, sizeof(float), count, file) != count || fclose(file)) fail(path, "cannot be written");
}

int main(int argc, char **argv) {
    Film film = {0};
    SspcModel *model;
    int shown = 0;
    if (argc != 3 && argc != 3 + PICTURES)
        fail("usage", "correct MODEL.onnx OUT.pfm [A B DENOISED_A DENOISED_B DENOISED]");
    if (sspc_abi_version() != SSPC_ABI_VERSION) fail("libsspc", "of another version than sspc.h");
    check(sspc_model_load(argv[1], &model));
    if (argc == 3) make_up(&film);
    for (int which = A; which < argc - 3; ++which) read_pfm(&film, which, argv[3 + which]);

    SspcFrame frame = sspc_frame(film.width, film.height);
    frame.a = input(&film, A);
    frame.b = input(&film, B);
    frame.denoised_a = input(&film, DENOISED_A);
    frame.denoised_b = input(&film, DENOISED_B);
    frame.denoised = input(&film, DENOISED);
    if (argc == 3) frame.albedo_a = frame.albedo_b = input(&film, ALBEDO);

    SspcOptions options = sspc_options();
    options.progress = progress;
    options.user = &shown;

    float *values = malloc((size_t)film.width * film.height * 3 * sizeof(float));
    if (!values) fail("picture", "no memory");
    SspcPicture picture = sspc_picture();
    ptrdiff_t row = (ptrdiff_t)(film.width * 3 * sizeof(float));
    picture.picture.data = values + (size_t)(film.height - 1) * film.width * 3;
    picture.picture.layout.row_stride = -row;

    check(sspc_correct(model, &frame, &options, &picture));
    printf("estimated relL2: %.5f denoised, %.5f corrected\n", picture.error_denoised.value, picture.error_corrected.value);
    if (picture.is_denoised) puts("the picture is the denoiser's");
    write_pfm(argv[2], film.width, film.height, values);
    sspc_model_free(model);
    free(values);
    free(film.pixels);
    return 0;
}
