/* Opens the library, corrects a frame, closes it and forks, several times: nothing of it lives on between calls.
 *
 *     reload LIBSSPC MODEL.onnx
 */
#define _POSIX_C_SOURCE 200809L
#include "sspc.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SIDE = 24, VALUES = SIDE * SIDE * 3 };

/* A function of the library; ISO C has no other way from an object's pointer to a function's. */
#define FIND(name)                                                                                                    \
    do {                                                                                                              \
        void *found = dlsym(library, #name);                                                                          \
        if (!found) return 10;                                                                                        \
        memcpy(&name##_, &found, sizeof found);                                                                       \
    } while (0)

/* Threads of this process, by the kernel's count. */
static int threads(void) {
    char line[256];
    int count = -1;
    FILE *file = fopen("/proc/self/status", "r");
    while (file && fgets(line, sizeof line, file)) sscanf(line, "Threads: %d", &count);
    if (file) fclose(file);
    return count;
}

static int correct(const char *path, const char *model_path) {
    int (*sspc_model_load_)(const char *, SspcModel **);
    int (*sspc_correct_)(const SspcModel *, const SspcFrame *, const SspcOptions *, SspcPicture *);
    void (*sspc_model_free_)(SspcModel *);
    static float values[5][VALUES];
    SspcModel *model;
    SspcFrame frame = sspc_frame(SIDE, SIDE);
    SspcOptions options = sspc_options();
    SspcPicture picture = sspc_picture();
    unsigned seed = 1;
    int before = threads();
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) return 11;
    FIND(sspc_model_load);
    FIND(sspc_correct);
    FIND(sspc_model_free);
    for (int i = 0; i < 4 * VALUES; ++i) {
        seed = seed * 1664525u + 1013904223u;
        values[i / VALUES][i % VALUES] = 1 + (float)(seed >> 8) / (1 << 24);
    }
    frame.a.data = values[0];
    frame.b.data = values[1];
    frame.denoised_a.data = values[2];
    frame.denoised_b.data = values[3];
    picture.picture.data = values[4];
    options.threads = 3;
    if (sspc_model_load_(model_path, &model)) return 12;
    if (sspc_correct_(model, &frame, &options, &picture)) return 13;
    sspc_model_free_(model);
    if (threads() != before) return 14;
    return dlclose(library) ? 15 : 0;
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    for (int round = 0; round < 3; ++round) {
        int code = correct(argv[1], argv[2]), status = 0;
        if (code) return code;
        pid_t child = fork();
        if (child == 0) _exit(correct(argv[1], argv[2]));
        if (child < 0 || waitpid(child, &status, 0) != child) return 3;
        if (status) return WIFEXITED(status) ? WEXITSTATUS(status) : 4;
    }
    return 0;
}
