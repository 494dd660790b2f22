/* What does not depend on the vectors' width: which pixels count, the spline's weights, noise in the Hessian. */
#ifndef BSCD_PIXELS_H
#define BSCD_PIXELS_H

#include <math.h>
#include <string.h>

#include "icgn.h"
#include "linear.h"

/* Whether a position lies on the image and its nearest pixel may be used. NaN lies nowhere. */
static int pixel_usable(const bscd_image *image, double x, double y)
{
    if (!(x >= 0 && y >= 0 && x <= image->width - 1 && y <= image->height - 1)) return 0;
    return !image->mask || image->mask[(int64_t)(y + 0.5) * image->width + (int64_t)(x + 0.5)];
}

/* Whether all pixels may be used whose position is this far from a middle; most subsets are nowhere near a mask's border,
 * and a row of it is looked through at once. */
static int all_usable(const bscd_image *image, double x, double y, double reach_x, double reach_y)
{
    const double left = x - reach_x, right = x + reach_x, top = y - reach_y, bottom = y + reach_y;
    if (!(left >= 0 && top >= 0 && right <= image->width - 1 && bottom <= image->height - 1)) return 0;
    if (!image->mask) return 1;
    const int64_t first = (int64_t)left, last = (int64_t)fmin(right + 1, image->width - 1);
    const int64_t lowest = (int64_t)fmin(bottom + 1, image->height - 1);
    for (int64_t row = (int64_t)top; row <= lowest; row++)
        if (memchr(image->mask + row * image->width + first, 0, last - first + 1)) return 0;
    return 1;
}

/* use = 1 for the pixels of the subset about a point that count, 0 for others and for the rows' padding; how many. */
static int usable_pixels(const bscd_image *image, double column, double row, int radius, int width, float *use)
{
    int count = 0;
    const int size = 2 * radius + 1;
    for (int j = 0; j < size; j++, use += width)
        for (int i = 0; i < width; i++) {
            const int usable = i < size && pixel_usable(image, column + i - radius, row + j - radius);
            use[i] = (float)usable;
            count += usable;
        }
    return count;
}

/* Half of the B-spline's weights as polynomials about the middle of a pixel, s = t - 1/2: coefficients of 1, s^2, s^4 and
 * of s, s^3, s^5. */
static const float cubic_halves[2][6] = {
    {1.f / 48, 1.f / 4, 0.f, -1.f / 8, -1.f / 6, 0.f},
    {23.f / 48, -1.f / 4, 0.f, -5.f / 8, 1.f / 2, 0.f},
};
static const float quintic_halves[3][6] = {
    {1.f / 3840, 1.f / 96, 1.f / 48, -1.f / 384, -1.f / 48, -1.f / 120},
    {79.f / 1280, 7.f / 32, -1.f / 16, -25.f / 128, -1.f / 16, 1.f / 24},
    {841.f / 1920, -11.f / 48, 1.f / 24, -77.f / 192, 7.f / 24, -1.f / 12},
};

/* Weights of the taps 0, 1, 2 pixels from a whole pixel, and their derivatives behind it (minus those before it). */
static const float cubic_whole[2] = {2.f / 3, 1.f / 6}, cubic_slopes[2] = {0.f, 1.f / 2};
static const float quintic_whole[3] = {11.f / 20, 13.f / 60, 1.f / 120}, quintic_slopes[3] = {0.f, 5.f / 12, 1.f / 24};

/* Weights of the spline's taps at a fraction t of a pixel, and their derivatives. */
static void spline_weights(int taps, double t, float *w, float *slope)
{
    const double u = 1 - t;
    if (taps == 4) {
        const double v[4] = {u * u * u / 6, 2.0 / 3 - t * t * (2 - t) / 2, 2.0 / 3 - u * u * (2 - u) / 2, t * t * t / 6};
        const double d[4] = {-u * u / 2, t * (3 * t - 4) / 2, u * (4 - 3 * u) / 2, t * t / 2};
        for (int k = 0; k < 4; k++) w[k] = (float)v[k], slope[k] = (float)d[k];
        return;
    }
    for (int k = 0; k < 6; k++) {
        /* the quintic's piece by distance: (3-x)^5 - 6 (2-x)^5+ + 15 (1-x)^5+, over 120 */
        const double signed_x = t + 2 - k, x = fabs(signed_x), a = 3 - x, b = 2 - x, c = 1 - x;
        double value = a * a * a * a * a, d = -5 * a * a * a * a;
        if (b > 0) value -= 6 * b * b * b * b * b, d += 30 * b * b * b * b;
        if (c > 0) value += 15 * c * c * c * c * c, d -= 75 * c * c * c * c;
        w[k] = (float)(value / 120);
        slope[k] = (float)((signed_x < 0 ? -d : d) / 120);
    }
}

/* The shape function's terms: factor x dx^a dy^b. */
static const struct {
    int a, b;
    double factor;
} terms[6] = {{0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {2, 0, 0.5}, {1, 1, 1}, {0, 2, 0.5}};

/* Where the moment of dx^a dy^b stands in a list of moments; terms are in the same order. */
#define MOMENT(a, b) (((a) + (b)) * ((a) + (b) + 1) / 2 + (b))

/* Where the term i of u (side 0) or v (side 1) stands in the Hessian: the displacement itself, i = 0, comes last. */
static inline int slot(int half, int side, int i) { return i ? side * (half - 1) + i - 1 : 2 * (half - 1) + side; }

/* What a light that changes linearly across the subset may do to it: 1, f, f dx, f dy; sums over the reference. */
#define LIGHT 4
typedef struct {
    double basis[BSCD_MOST][BSCD_MOST], factor[BSCD_MOST][BSCD_MOST];
    double in[BSCD_MOST][LIGHT];    /* of it x the steepest-descent images, in the order of `slot` */
    double share[BSCD_MOST][LIGHT]; /* what it has of them */
} light;

/* Numbers that `remember` keeps of a subset when n parameters are solved for: whether it is known comes first. */
#define MEMORY_ROW(n) (4 + 2 * (n) + 2 * (n) * (n) + LIGHT * LIGHT + (n) * LIGHT)

/* Correlation of what light and reference together explain with the current pixels: `in` are the sums of the light's
 * basis x g, norm2 the sum of squares of g less `mean2`, its mean's part. */
static double lit_likeness(light *l, const double *in, double norm2, double mean2)
{
    double share[LIGHT], explained = -mean2;
    cholesky_solve(LIGHT, l->factor, in, share);
    for (int n = 0; n < LIGHT; n++) explained += in[n] * share[n];
    return copysign(sqrt(fmin(fmax(explained / norm2, 0), 1)), share[1]);
}

static inline double noise_energy(const double *energy, double t)
{
    return energy[0] + energy[1] * (t == 0 ? 1 : cos(2 * M_PI * t));
}

/* Take off the Hessian's lower half a share of what the noise of the reference's gradients adds to it on average. */
static void take_noise_off(const bscd_options *options, double share, const double *point, int radius, int degree, double pixels,
                           double hessian[BSCD_MOST][BSCD_MOST])
{
    const int half = MOMENT(0, degree) + 1;
    const double tx = point[0] - (int64_t)point[0], ty = point[1] - (int64_t)point[1];
    const double scale = share * options->noise_variance * pixels;
    const double energy[2] = {
        scale * noise_energy(options->derivative_energy, tx) * noise_energy(options->value_energy, ty),
        scale * noise_energy(options->value_energy, tx) * noise_energy(options->derivative_energy, ty),
    };
    /* even moments of the full subset, a pixel: sums of i^2 and i^4 over -r..r, over 2 r + 1 */
    const double r = radius, m2 = r * (r + 1) / 3, m4 = m2 * (3 * r * r + 3 * r - 1) / 5;
    const double even[3] = {1, m2, m4};
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < half; i++)
            for (int k = 0; k < half; k++) {
                const int row = slot(half, side, i), column = slot(half, side, k);
                const int a = terms[i].a + terms[k].a, b = terms[i].b + terms[k].b;
                if (column > row || a % 2 || b % 2) continue;
                hessian[row][column] -= energy[side] * terms[i].factor * terms[k].factor * even[a / 2] * even[b / 2];
            }
}

#endif
