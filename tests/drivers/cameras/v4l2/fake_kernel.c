/* A V4L2 camera in front of the C library: 32 x 24 pixels, ten frames a second, at the path in FAKE_V4L2.

   As the kernel has it (VIDIOC_S_FMT, VIDIOC_REQBUFS in the V4L2 API): any program may open it, one has its buffers,
   and meanwhile nobody sets a format. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { WIDTH = 32, HEIGHT = 24, SLOT = 65536, SLOTS = 32, FILES = 4096 };

static int ours[FILES], owner = -1, streaming;
static unsigned queued[SLOTS], waiting;
static struct v4l2_pix_format format = {WIDTH, HEIGHT, V4L2_PIX_FMT_YUYV, V4L2_FIELD_NONE, 2 * WIDTH, 2 * WIDTH * HEIGHT};

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static int fail(int number) { errno = number; return -1; }

static int is_ours(int file) { return file >= 0 && file < FILES && ours[file]; }

static int open_ours(const char *path) {
    const char *wanted = getenv("FAKE_V4L2");
    if (!wanted || strcmp(path, wanted)) return -1;
    int file = memfd_create("v4l2", 0);
    if (ftruncate(file, SLOT * SLOTS)) return -1;
    ours[file] = 1;
    return file;
}

#define OPEN(name)                                                       \
    int name(const char *path, int flags, ...) {                         \
        va_list rest;                                                    \
        va_start(rest, flags);                                           \
        int mode = va_arg(rest, int);                                    \
        va_end(rest);                                                    \
        int file = open_ours(path);                                      \
        int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, #name);   \
        return file >= 0 ? file : next(path, flags, mode);               \
    }
OPEN(open)
OPEN(open64)

int close(int file) {
    int (*next)(int) = dlsym(RTLD_NEXT, "close");
    if (is_ours(file)) {
        ours[file] = 0;
        if (owner == file) owner = -1, streaming = 0, waiting = 0;
    }
    return next(file);
}

static int set_format(struct v4l2_format *wanted) {
    if (wanted->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return fail(EINVAL);
    if (owner != -1) return fail(EBUSY);
    unsigned letters = wanted->fmt.pix.pixelformat;
    if (letters == V4L2_PIX_FMT_GREY || letters == V4L2_PIX_FMT_Y12 || letters == V4L2_PIX_FMT_YUYV)
        format.pixelformat = letters;
    format.bytesperline = WIDTH * (format.pixelformat == V4L2_PIX_FMT_GREY ? 1 : 2);
    format.sizeimage = format.bytesperline * HEIGHT;
    wanted->fmt.pix = format;
    return 0;
}

/* Pixel k (row by row) is k mod 251; of Y12 it is k. */
static int take_frame(int file, struct v4l2_buffer *buffer) {
    static double at;
    if (!streaming || !waiting) return fail(EAGAIN);
    double left = at + 0.1 - now();
    if (left > 0) usleep(1e6 * left);
    at = now();
    buffer->index = queued[0];
    memmove(queued, queued + 1, --waiting * sizeof *queued);
    unsigned char *memory = mmap(0, SLOT, PROT_READ | PROT_WRITE, MAP_SHARED, file, buffer->index * SLOT);
    for (unsigned k = 0; k < WIDTH * HEIGHT; k++) {
        unsigned char *pixel = memory + k * format.bytesperline / WIDTH;
        pixel[0] = format.pixelformat == V4L2_PIX_FMT_Y12 ? k % 256 : k % 251;
        if (format.pixelformat != V4L2_PIX_FMT_GREY) pixel[1] = format.pixelformat == V4L2_PIX_FMT_Y12 ? k / 256 : 128;
    }
    munmap(memory, SLOT);
    buffer->length = SLOT;
    buffer->bytesused = format.sizeimage;
    buffer->flags = V4L2_BUF_FLAG_DONE;
    buffer->timestamp.tv_sec = (long)at;
    buffer->timestamp.tv_usec = 1e6 * (at - (long)at);
    return 0;
}

int ioctl(int file, unsigned long request, ...) {
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    if (!is_ours(file)) {
        int (*next)(int, unsigned long, ...) = dlsym(RTLD_NEXT, "ioctl");
        return next(file, request, argument);
    }
    switch ((unsigned)request) {
    case VIDIOC_QUERYCAP: {
        struct v4l2_capability *told = argument;
        memset(told, 0, sizeof *told);
        told->device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        told->capabilities = told->device_caps | V4L2_CAP_DEVICE_CAPS;
        return 0;
    }
    case VIDIOC_G_FMT:
        ((struct v4l2_format *)argument)->fmt.pix = format;
        return 0;
    case VIDIOC_S_FMT:
        return set_format(argument);
    case VIDIOC_REQBUFS: {
        struct v4l2_requestbuffers *wanted = argument;
        if (owner != -1 && owner != file) return fail(EBUSY);
        owner = wanted->count ? file : -1;
        waiting = 0;
        return 0;
    }
    case VIDIOC_QUERYBUF: {
        struct v4l2_buffer *told = argument;
        told->length = SLOT;
        told->m.offset = told->index * SLOT;
        return 0;
    }
    case VIDIOC_QBUF:
        queued[waiting++] = ((struct v4l2_buffer *)argument)->index;
        return 0;
    case VIDIOC_DQBUF:
        return take_frame(file, argument);
    case VIDIOC_STREAMON:
        streaming = 1;
        return 0;
    case VIDIOC_STREAMOFF:
        streaming = waiting = 0;
        return 0;
    }
    return fail(ENOTTY);
}
