/* The correlator's kernel: what goes in and what comes out. The Python side is bscd/dic/solver.py. */
#ifndef BSCD_ICGN_H
#define BSCD_ICGN_H

#include <stdint.h>

/* A spline image: coefficients with `pad` reflected ones around them, so that pixel (0, 0) is at
 * coefficients[pad * stride + pad]; mask is NULL or has a byte a pixel (0 = not to be used), without padding. */
typedef struct {
    const float *coefficients;
    const uint8_t *mask;
    int64_t stride;
    int32_t width, height, pad, taps; /* taps: 4 cubic, 6 quintic */
} bscd_image;

typedef struct {
    int32_t radius;         /* the subset is 2 * radius + 1 pixels wide */
    int32_t parameters;     /* 6 affine, 12 second order */
    int32_t solved;         /* those that are solved for: all; or 2 of 6, u and v; or 6 of 12, the affine ones; the
                               others stay as guessed */
    int32_t lit;            /* 1: the light may change linearly across a subset, 0: by offset and gain alone */
    int32_t max_iterations;
    int32_t min_pixels;     /* fewer usable pixels than this: outside */
    double tolerance_px;    /* stop below this subset displacement norm */
    double reach_px;        /* farther than this from its guess: diverged */
    double zncc_min;
    double noise_variance;  /* of a reference pixel, grey levels squared: what it adds to the Hessian is taken off
                               before the covariance; 0 where not known */
    double value_energy[2], derivative_energy[2]; /* of white noise through the spline, for one axis: mean and
                               amplitude over the fraction of a pixel, a + b cos(2 pi t) */
    double variance_max;    /* of a displacement for a noise variance of 1; above: low texture */
} bscd_options;

enum { BSCD_VALID, BSCD_OUTSIDE, BSCD_LOW_TEXTURE, BSCD_NOT_CONVERGED, BSCD_LOW_ZNCC, BSCD_DIVERGED };

/* What a point's row of `found` holds. */
enum {
    BSCD_ZNCC,
    BSCD_NORM,      /* of the last step, px */
    BSCD_VAR_U,     /* covariance of (u, v) for a noise variance of 1 */
    BSCD_COV_UV,
    BSCD_VAR_V,
    BSCD_RESIDUAL,  /* residual variance a pixel, grey levels squared */
    BSCD_GAIN,      /* contrast of the current subset over that of the reference */
    BSCD_PIXELS,    /* pixels that took part */
    BSCD_FOUND
};

/* Instruction sets, as bscd_icgn's first argument. */
enum { BSCD_SET_BEST = -1, BSCD_SET_BASELINE, BSCD_SET_AVX2, BSCD_SET_AVX512, BSCD_SET_WIDE };

/* The best set of this machine; 1 when it can run a set, else 0. BSCD_SET_WIDE is the 16-lane code for any machine. */
int bscd_best_set(void);
int bscd_can_run(int set);

/* How many numbers of `memory` a point takes when `solved` parameters are solved for. */
int bscd_memory_row(int solved);

/* Solve `count` points. points (count, 2): column, row in the reference. shape (count, parameters): the guess in, the
 * result out: u, ux, uy, v, vx, vy, or u, ux, uy, uxx, uxy, uyy and the same of v (derivatives, so uxx goes with dx^2/2).
 * found (count, BSCD_FOUND), status (count), iterations (count). memory, or NULL: of subsets of this reference, 0 before the first
 * call, what later calls with the same options need not find again; point i's is row rows[i]. Returns 0, or 1 without memory, 2 for a set that the
 * machine can not run. Touches nothing but its arguments, so threads may share the images. */
int bscd_icgn(int set, const bscd_image *reference, const bscd_image *current, const bscd_options *options,
              int64_t count, const double *points, double *shape, double *found, int32_t *status,
              int32_t *iterations, double *memory, const int64_t *rows);

#endif
