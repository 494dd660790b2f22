/* What does not depend on the vectors' width: which pixels count, the spline's weights, noise in the Hessian. */
#ifndef BSCD_PIXELS_H
#define BSCD_PIXELS_H

#include "icgn.h"
#include "linear.h"

/* Whether a position lies on the image and its nearest pixel may be used. NaN lies nowhere. */
static int pixel_usable(const bscd_image *image, double x, double y)
{
    if (!(x >= 0 && y >= 0 && x <= image->width - 1 && y <= image->height - 1)) return 0;
    return !image->mask || image->mask[(int64_t)(y + 0.5) * image->width + (int64_t)(x + 0.5)];
}

/* Whether all pixels of a subset may be used. */
static int subset_inside(const bscd_image *image, double column, double row, int radius)
{
    return !image->mask && column >= radius && row >= radius && column + radius <= image->width - 1
           && row + radius <= image->height - 1;
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

/* The Hessian without what the noise of the reference's gradients adds to it on average. */
static void without_noise(const bscd_options *options, const double *point, int radius, int degree, double pixels,
                          double hessian[BSCD_MOST][BSCD_MOST], double clean[BSCD_MOST][BSCD_MOST])
{
    const int half = degree == 1 ? 3 : 6;
    const double cx = cos(2 * M_PI * (point[0] - floor(point[0]))), cy = cos(2 * M_PI * (point[1] - floor(point[1])));
    const double value_x = options->value_energy[0] + options->value_energy[1] * cx;
    const double value_y = options->value_energy[0] + options->value_energy[1] * cy;
    const double slope_x = options->derivative_energy[0] + options->derivative_energy[1] * cx;
    const double slope_y = options->derivative_energy[0] + options->derivative_energy[1] * cy;
    const double energy[2] = {options->noise_variance * slope_x * value_y, options->noise_variance * value_x * slope_y};
    /* even moments of the full subset, a pixel */
    double m2 = 0, m4 = 0;
    for (int i = -radius; i <= radius; i++) m2 += (double)i * i, m4 += (double)i * i * i * i;
    m2 /= 2 * radius + 1;
    m4 /= 2 * radius + 1;
    memcpy(clean, hessian, sizeof(double) * BSCD_MOST * BSCD_MOST);
    for (int side = 0; side < 2; side++) {
        const double e = energy[side] * pixels;
        double(*h)[BSCD_MOST] = clean;
        const int o = side * half;
        h[o][o] -= e;
        h[o + 1][o + 1] -= e * m2;
        h[o + 2][o + 2] -= e * m2;
        if (degree == 2) {
            h[o + 3][o + 3] -= e * m4 / 4;
            h[o + 5][o + 5] -= e * m4 / 4;
            h[o + 4][o + 4] -= e * m2 * m2;
            h[o][o + 3] -= e * m2 / 2, h[o + 3][o] -= e * m2 / 2;
            h[o][o + 5] -= e * m2 / 2, h[o + 5][o] -= e * m2 / 2;
            h[o + 3][o + 5] -= e * m2 * m2 / 4, h[o + 5][o + 3] -= e * m2 * m2 / 4;
        }
    }
}

#endif
