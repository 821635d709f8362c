/* Calls as hosts should not make them, and some that they should, under the address and undefined-behaviour sanitizers:
 *
 *     misuse MODEL.onnx
 */
#include "sspc.h"

#include <stdio.h>
#include <stdlib.h>

#define EXPECT(condition)                                                                                             \
    do {                                                                                                              \
        if (!(condition)) {                                                                                           \
            fprintf(stderr, "line %d: %s: %s\n", __LINE__, #condition, sspc_message());                               \
            exit(1);                                                                                                  \
        }                                                                                                             \
    } while (0)

enum { WIDTH = 40, HEIGHT = 30, VALUES = WIDTH * HEIGHT * 3 };

static SspcInput input(const float *values) {
    SspcInput input = {0};
    input.data = values;
    return input;
}

static float *noise(unsigned seed, float strength) {
    float *values = malloc(VALUES * sizeof(float));
    EXPECT(values);
    for (int i = 0; i < VALUES; ++i) {
        seed = seed * 1664525u + 1013904223u;
        values[i] = 1 + strength * ((float)(seed >> 8) / (1 << 24) - 0.5f);
    }
    return values;
}

/* Stops at the second call. */
static int stop(void *user, double done) {
    EXPECT(done >= 0 && done <= 1);
    return ++*(int *)user == 2;
}

int main(int argc, char **argv) {
    SspcModel *model = (SspcModel *)argv;
    EXPECT(argc == 2);
    EXPECT(sspc_abi_version() == SSPC_ABI_VERSION && *sspc_version());
    EXPECT(!*sspc_message() && !*sspc_advice() && !*sspc_report());
    sspc_model_free(NULL);
    EXPECT(sspc_model_load("nowhere.onnx", &model) == SSPC_INPUT && !model && *sspc_message() && *sspc_advice());
    EXPECT(sspc_model_load(NULL, &model) == SSPC_ARGUMENTS);
    EXPECT(sspc_model_read("no model", 8, &model) == SSPC_INPUT && !model);
    EXPECT(sspc_model_load(argv[1], &model) == SSPC_OK && model && !*sspc_message());

    SspcModelInfo info = sspc_model_info();
    EXPECT(sspc_model_describe(model, &info) == SSPC_OK && info.contract_version == 1 && info.networks == 1);

    float *pictures[4] = {noise(1, 1.0f), noise(2, 1.0f), noise(3, 0.1f), noise(4, 0.1f)};
    float *out = calloc(VALUES, sizeof(float)), *share = calloc(VALUES / 3, sizeof(float));
    SspcFrame frame = sspc_frame(WIDTH, HEIGHT);
    SspcPicture picture = sspc_picture();
    SspcOptions options = sspc_options();
    EXPECT(out && share);
    EXPECT(sspc_correct(NULL, &frame, &options, &picture) == SSPC_ARGUMENTS);
    EXPECT(sspc_correct(model, NULL, &options, &picture) == SSPC_ARGUMENTS);
    EXPECT(sspc_correct(model, &frame, &options, NULL) == SSPC_ARGUMENTS);
    EXPECT(sspc_correct(model, &frame, &options, &picture) == SSPC_ARGUMENTS);
    picture.picture.data = out;
    picture.share.data = share;
    EXPECT(sspc_correct(model, &frame, NULL, &picture) == SSPC_INPUT);
    frame.a = input(pictures[0]);
    frame.b = input(pictures[1]);
    frame.denoised_a = input(pictures[2]);
    frame.denoised_b = input(pictures[3]);

    int calls = 0;
    options.progress = stop;
    options.user = &calls;
    EXPECT(sspc_correct(model, &frame, &options, &picture) == SSPC_INTERRUPTED && calls == 2 && out[0] == 0);
    options.progress = NULL;
    EXPECT(sspc_correct(model, &frame, &options, &picture) == SSPC_OK && out[0] > 0 && *sspc_report());
    /* In place, and again on one thread. */
    float first = out[VALUES - 1];
    picture.picture.data = pictures[0];
    options.threads = 1;
    EXPECT(sspc_correct(model, &frame, &options, &picture) == SSPC_OK && pictures[0][VALUES - 1] == first);

    for (int i = 0; i < 4; ++i) free(pictures[i]);
    free(out);
    free(share);
    sspc_model_free(model);
    return 0;
}
