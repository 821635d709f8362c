/* A stand-in for Open Image Denoise: the functions that are used, and the fault that STAND_IN names. Its filter gives the
 * colour back, twice as bright. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define SOUND 0
#define OLD_1 1
#define OLD_VERSION 2
#define NO_DEVICE 3
#define BAD_DEVICE 4
#define NO_FILTER 5
#define BAD_COMMIT 6
#define HALF_WAY 7
#define NOT_FINITE 8
#define LACKS 9

#ifndef STAND_IN
#define STAND_IN SOUND
#endif

typedef bool (*Monitor)(void *, double);

static int code;
static const char *message;
static int filters, devices;

static void fail(int with, const char *text) {
    if (code == 0) code = with, message = text;
}

void *oidnNewDevice(int type) {
    (void)type;
    if (STAND_IN == NO_DEVICE) return fail(4, "this processor is too old"), NULL;
    ++devices;
    return &devices;
}

void oidnReleaseDevice(void *device) {
    (void)device;
    /* A device goes after its filters. */
    if (filters != 0) abort();
    --devices;
}

int oidnGetDeviceError(void *device, const char **text) {
    int found = code;
    (void)device;
    *text = message;
    code = 0;
    message = NULL;
    return found;
}

#if STAND_IN == OLD_1
int oidnGetDevice1i(void *device, const char *name) {
    (void)device;
    return strcmp(name, "version") == 0 ? 10403 : 0;
}
#else
/* Of the one filter that is alive. */
static const float *colour;
static float *output;
static size_t width, height;
static Monitor monitor;
static void *asked;

void oidnSetDeviceInt(void *device, const char *name, int value) {
    (void)device, (void)name, (void)value;
}

void oidnSetDeviceBool(void *device, const char *name, bool value) {
    (void)device, (void)name, (void)value;
}

int oidnGetDeviceInt(void *device, const char *name) {
    (void)device;
    if (strcmp(name, "version") != 0) return 0;
    return STAND_IN == OLD_VERSION ? 19901 : 20300;
}

void oidnCommitDevice(void *device) {
    (void)device;
    if (STAND_IN == BAD_DEVICE) fail(5, "no thread could be started");
}

void *oidnNewFilter(void *device, const char *type) {
    (void)device;
    if (STAND_IN == NO_FILTER || strcmp(type, "RT") != 0) return fail(2, "unknown filter"), NULL;
    ++filters;
    return &filters;
}

void oidnSetSharedFilterImage(void *filter, const char *name, void *data, int format, size_t w, size_t h, size_t offset,
                              size_t pixel, size_t row) {
    (void)filter, (void)format, (void)offset, (void)pixel, (void)row;
    if (strcmp(name, "output") == 0) output = data;
    if (strcmp(name, "color") == 0) colour = data;
    width = w;
    height = h;
}

void oidnSetFilterBool(void *filter, const char *name, bool value) {
    (void)filter, (void)name, (void)value;
}

void oidnSetFilterInt(void *filter, const char *name, int value) {
    (void)filter, (void)name, (void)value;
}

void oidnSetFilterProgressMonitorFunction(void *filter, Monitor function, void *pointer) {
    (void)filter;
    monitor = function;
    asked = pointer;
}

void oidnCommitFilter(void *filter) {
    (void)filter;
    if (STAND_IN == BAD_COMMIT) fail(4, "weights are missing");
}

void oidnExecuteFilter(void *filter) {
    size_t count = width * height * 3;
    (void)filter;
    for (size_t i = 0; i < count; ++i) {
        if (STAND_IN == HALF_WAY && i == count / 2) return fail(3, "out of memory");
        if (i % width == 0 && !monitor(asked, (double)i / count)) return fail(6, "execution was cancelled");
        output[i] = STAND_IN == NOT_FINITE && i >= count - 2 ? NAN : 2 * colour[i];
    }
}

#if STAND_IN != LACKS
void oidnReleaseFilter(void *filter) {
    (void)filter;
    --filters;
}
#endif
#endif
