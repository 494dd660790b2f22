/* A point's subset of the reference: its values and gradients, and the sums that the iterations need of them. Included
 * by lanes.h. */

/* One point's subset. Rows are padded to whole vectors; m is 0 there. */
typedef struct {
    int radius, size, vectors;
    float offset;                      /* taken off all grey levels, so that sums keep their digits */
    float *f, *gx, *gy, *g;            /* (size, vectors * LANES): values less offset, gradients, current values */
    const float *full, *m, *whole;     /* the same: 1 in the subset, 0 in the padding; use now; use by the reference */
    float *own, *both;                 /* room for the masks of a subset that is not whole */
    float *bright;                     /* room for the values with their offset */
    float *dx;                         /* (vectors * LANES) */
    float *value, *slope;              /* (size + 5, vectors * LANES): rows filtered along x */
    NAME(warp) warp;                   /* where it lies in the current image */
} NAME(subset);
#define subset NAME(subset)

/* What the current weights m make of the reference subset. Parameters are in the order of `slot`. */
typedef struct {
    double pixels, mean, norm2;           /* of f: count, mean, sum of squares about the mean */
    double sd[BSCD_MOST], sdf[BSCD_MOST]; /* sums of the steepest-descent images, and of them x (f - mean) */
    double hessian[BSCD_MOST][BSCD_MOST]; /* its lower half */
    double factor[BSCD_MOST][BSCD_MOST];
    light light;                          /* where it may change linearly */
} NAME(statistics);
#define statistics NAME(statistics)

/* Filter the coefficients about a point into values and gradients. The fraction of a pixel is the same for all pixels,
 * so rows come first, then columns. */
INLINE void NAME(filter_subset)(const int taps, subset *s, const float *base, int64_t stride, const float *wx,
                                const float *sx, const float *wy, const float *sy)
{
    const int width = s->vectors * LANES;
    for (int j = 0; j < s->size + taps - 1; j++, base += stride)
        for (int v = 0; v < width; v += LANES) {
            vf value = spread(0), slope = spread(0);
#pragma GCC unroll 6
            for (int k = 0; k < taps; k++) {
                const vf c = load(base + v + k);
                value += spread(wx[k]) * c;
                slope += spread(sx[k]) * c;
            }
            *(vf *)(s->value + j * width + v) = value;
            *(vf *)(s->slope + j * width + v) = slope;
        }
    const vf start = spread(-s->offset);
    for (int j = 0; j < s->size; j++)
        for (int v = 0; v < width; v += LANES) {
            vf f = start, gx = spread(0), gy = spread(0);
#pragma GCC unroll 6
            for (int k = 0; k < taps; k++) {
                const vf value = *(vf *)(s->value + (j + k) * width + v);
                f += spread(wy[k]) * value;
                gy += spread(sy[k]) * value;
                gx += spread(wy[k]) * *(vf *)(s->slope + (j + k) * width + v);
            }
            *(vf *)(s->f + j * width + v) = f;
            *(vf *)(s->gx + j * width + v) = gx;
            *(vf *)(s->gy + j * width + v) = gy;
        }
}

/* The same about a whole pixel. Of the taps - 1 that have weight there, values weigh those before and behind alike,
 * slopes weigh them with opposite signs. */
INLINE void NAME(filter_whole)(const int taps, subset *s, const float *base, int64_t stride)
{
    const int width = s->vectors * LANES, middle = taps / 2 - 1;
    const float *w = taps == 4 ? cubic_whole : quintic_whole, *d = taps == 4 ? cubic_slopes : quintic_slopes;
    for (int j = 0; j < s->size + taps - 2; j++, base += stride)
        for (int v = 0; v < width; v += LANES) {
            vf value = spread(w[0]) * load(base + v + middle), slope = spread(0);
#pragma GCC unroll 2
            for (int k = 1; k <= middle; k++) {
                const vf before = load(base + v + middle - k), behind = load(base + v + middle + k);
                value += spread(w[k]) * (behind + before);
                slope += spread(d[k]) * (behind - before);
            }
            *(vf *)(s->value + j * width + v) = value;
            *(vf *)(s->slope + j * width + v) = slope;
        }
    const vf start = spread(-s->offset);
    for (int at = 0; at < s->size * width; at += LANES) {
        const vf *value = (vf *)(s->value + at + middle * width), *slope = (vf *)(s->slope + at + middle * width);
        const int down = s->vectors;
        vf f = start + spread(w[0]) * *value, gx = spread(w[0]) * *slope, gy = spread(0);
#pragma GCC unroll 2
        for (int k = 1; k <= middle; k++) {
            f += spread(w[k]) * (value[k * down] + value[-k * down]);
            gx += spread(w[k]) * (slope[k * down] + slope[-k * down]);
            gy += spread(d[k]) * (value[k * down] - value[-k * down]);
        }
        *(vf *)(s->f + at) = f;
        *(vf *)(s->gx + at) = gx;
        *(vf *)(s->gy + at) = gy;
    }
}

/* The reference's subset about a point on the image; how many of its pixels may be used. */
INLINE int NAME(take_subset)(const int taps, subset *s, const bscd_image *image, double column, double row)
{
    const int r = s->radius, before = taps / 2 - 1, column0 = (int)column, row0 = (int)row;
    const float *middle = image->coefficients + (image->pad + row0) * image->stride + image->pad + column0;
    const float *base = middle - (r + before) * (image->stride + 1);
    s->offset = *middle;
    if (column == column0 && row == row0)
        NAME(filter_whole)(taps, s, base, image->stride);
    else {
        float wx[6], wy[6], sx[6], sy[6];
        spline_weights(taps, column - column0, wx, sx);
        spline_weights(taps, row - row0, wy, sy);
        NAME(filter_subset)(taps, s, base, image->stride, wx, sx, wy, sy);
    }
    if (all_usable(image, column, row, r, r)) {
        s->m = s->whole = s->full;
        return s->size * s->size;
    }
    s->m = s->whole = s->own;
    return usable_pixels(image, column, row, r, s->vectors * LANES, s->own);
}

/* sums[MOMENT(a, b)] += column[b] dx^a */
INLINE void NAME(add_column)(const int most, vf dx, const vf *column, vf *sums)
{
    vf power = spread(1);
#pragma GCC unroll 5
    for (int a = 0; a <= most; a++, power *= dx) {
#pragma GCC unroll 5
        for (int b = 0; b <= most - a; b++) sums[MOMENT(a, b)] += column[b] * power;
    }
}

/* column[b] += q dy^b */
INLINE void NAME(add_powers)(const int most, vf q, vf dy, vf *column)
{
    vf power = dy;
    column[0] += q;
#pragma GCC unroll 4
    for (int b = 1; b <= most; b++, power *= dy) column[b] += q * power;
}

INLINE void NAME(clear)(const int count, vf *v)
{
#pragma GCC unroll 16
    for (int i = 0; i < count; i++) v[i] = spread(0);
}

/* Sums of a b dx^i dy^k over the subset at MOMENT(i, k), i + k <= most. */
INLINE void NAME(product_moments)(const int most, const subset *s, const float *a, const float *b, double *out)
{
    const int width = s->vectors * LANES, count = MOMENT(0, most) + 1;
    vf sums[MOMENT(0, 4) + 1];
    NAME(clear)(count, sums);
    for (int v = 0; v < width; v += LANES) {
        vf column[5], dy = spread((float)-s->radius);
        NAME(clear)(most + 1, column);
        for (int j = 0, at = v; j < s->size; j++, at += width, dy += 1)
            NAME(add_powers)(most, *(vf *)(a + at) * *(vf *)(b + at) * *(vf *)(s->m + at), dy, column);
        NAME(add_column)(most, *(vf *)(s->dx + v), column, sums);
    }
    totals(count, sums, out);
}

/* Sums of f and of the steepest-descent images with the weights m: all of `out` but the Hessian. */
INLINE void NAME(describe_values)(const int degree, const subset *s, statistics *out)
{
    const int width = s->vectors * LANES, half = MOMENT(0, degree) + 1;
    vf sums[3 + 4 * 6]; /* 1, f, f^2; then the moments of gx, gy, gx f, gy f */
    NAME(clear)(3 + 4 * half, sums);
    for (int v = 0; v < width; v += LANES) {
        vf column[4][3], dy = spread((float)-s->radius);
        for (int k = 0; k < 4; k++) NAME(clear)(degree + 1, column[k]);
        for (int j = 0, at = v; j < s->size; j++, at += width, dy += 1) {
            const vf m = *(vf *)(s->m + at), f = *(vf *)(s->f + at) * m;
            const vf x = *(vf *)(s->gx + at) * m, y = *(vf *)(s->gy + at) * m;
            sums[0] += m;
            sums[1] += f;
            sums[2] += f * f;
            NAME(add_powers)(degree, x, dy, column[0]);
            NAME(add_powers)(degree, y, dy, column[1]);
            NAME(add_powers)(degree, x * f, dy, column[2]);
            NAME(add_powers)(degree, y * f, dy, column[3]);
        }
        for (int k = 0; k < 4; k++) NAME(add_column)(degree, *(vf *)(s->dx + v), column[k], sums + 3 + k * half);
    }
    double total[3 + 4 * 6];
    totals(3 + 4 * half, sums, total);
    out->pixels = total[0];
    out->mean = total[1] / total[0];
    out->norm2 = total[2] - total[1] * out->mean;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < half; i++) {
            const double sd = total[3 + side * half + i], sdf = total[3 + (2 + side) * half + i];
            out->sd[slot(half, side, i)] = terms[i].factor * sd;
            out->sdf[slot(half, side, i)] = terms[i].factor * (sdf - out->mean * sd);
        }
}

/* What a light that changes linearly across the subset may explain: its basis and its part in the steepest-descent
 * images, taken off the Hessian; 0 when it can not be told from the texture. */
static __attribute__((noinline)) int NAME(describe_light)(const int degree, subset *s, statistics *out)
{
    const int width = s->vectors * LANES, half = MOMENT(0, degree) + 1;
    for (int at = 0; at < s->size * width; at += LANES)
        *(vf *)(s->bright + at) = *(vf *)(s->f + at) + spread(s->offset);
    double once[MOMENT(0, 1) + 1], twice[MOMENT(0, 2) + 1], part[2][MOMENT(0, 3) + 1];
    NAME(product_moments)(1, s, s->bright, s->full, once);
    NAME(product_moments)(2, s, s->bright, s->bright, twice);
    NAME(product_moments)(degree + 1, s, s->gx, s->bright, part[0]);
    NAME(product_moments)(degree + 1, s, s->gy, s->bright, part[1]);
    light *l = &out->light;
    /* 1, f, and the bright image x dx, x dy; f is the bright image less the subset's offset */
    const double offset = s->offset, ramp[2] = {once[MOMENT(1, 0)], once[MOMENT(0, 1)]};
    l->basis[0][0] = out->pixels;
    l->basis[1][0] = out->mean * out->pixels;
    l->basis[1][1] = out->norm2 + out->mean * out->mean * out->pixels;
    for (int i = 0; i < 2; i++) {
        l->basis[2 + i][0] = ramp[i];
        l->basis[2 + i][1] = twice[MOMENT(1 - i, i)] - offset * ramp[i];
        l->basis[2 + i][2] = twice[i ? MOMENT(1, 1) : MOMENT(2, 0)];
    }
    l->basis[3][3] = twice[MOMENT(0, 2)];
    if (!cholesky(LIGHT, l->basis, l->factor)) return 0;
    for (int i = 0; i < 2 * half; i++) {
        const int row = slot(half, i / half, i % half), a = terms[i % half].a, b = terms[i % half].b;
        double *in = l->in[row];
        in[0] = out->sd[row];
        in[1] = out->sdf[row] + out->mean * out->sd[row];
        in[2] = terms[i % half].factor * part[i / half][MOMENT(a + 1, b)];
        in[3] = terms[i % half].factor * part[i / half][MOMENT(a, b + 1)];
        cholesky_solve(LIGHT, l->factor, in, l->share[row]);
    }
    return 1;
}

/* To a row of memory (`keep`) or from it what iterations with n parameters need of a subset that nothing but the
 * reference's mask cuts. */
static __attribute__((noinline)) void NAME(remember)(const int n, const int lit, const int keep, statistics *about,
                                                     double *row)
{
    row++;
#define PASS(values, count)                                                                                            \
    do {                                                                                                               \
        if (keep)                                                                                                      \
            memcpy(row, values, sizeof(double) * (count));                                                             \
        else                                                                                                           \
            memcpy(values, row, sizeof(double) * (count));                                                             \
        row += count;                                                                                                  \
    } while (0)
    PASS(&about->pixels, 1);
    PASS(&about->mean, 1);
    PASS(&about->norm2, 1);
    PASS(about->sd, n);
    PASS(about->sdf, n);
    for (int i = 0; i < n; i++) {
        PASS(about->hessian[i], i + 1);
        PASS(about->factor[i], i + 1);
        if (lit) PASS(about->light.share[i], LIGHT);
    }
    for (int i = 0; i < LIGHT && lit; i++) PASS(about->light.factor[i], LIGHT);
#undef PASS
}

/* Sums over the reference with the weights m; 0 when there is no texture to match. */
static __attribute__((noinline)) int NAME(describe)(const int degree, const int lit, subset *s, statistics *out)
{
    const int half = MOMENT(0, degree) + 1;
    NAME(describe_values)(degree, s, out);
    if (!(out->norm2 > 1e-6 * out->pixels)) return 0;
    double squares[3][MOMENT(0, 4) + 1]; /* xx, xy, yy */
    NAME(product_moments)(2 * degree, s, s->gx, s->gx, squares[0]);
    NAME(product_moments)(2 * degree, s, s->gx, s->gy, squares[1]);
    NAME(product_moments)(2 * degree, s, s->gy, s->gy, squares[2]);
    if (lit && !NAME(describe_light)(degree, s, out)) return 0;
    const double per_pixel = 1 / out->pixels, per_norm2 = 1 / out->norm2;
    for (int i = 0; i < 2 * half; i++)
        for (int k = 0; k < 2 * half; k++) {
            const int row = slot(half, i / half, i % half), column = slot(half, k / half, k % half);
            if (column > row) continue;
            const int a = terms[i % half].a + terms[k % half].a, b = terms[i % half].b + terms[k % half].b;
            const double factor = terms[i % half].factor * terms[k % half].factor;
            /* offset, gain and light are free: what they explain is no information on the displacement */
            double explained = 0;
            if (lit)
                for (int n = 0; n < LIGHT; n++) explained += out->light.in[row][n] * out->light.share[column][n];
            else
                explained = out->sd[row] * out->sd[column] * per_pixel + out->sdf[row] * out->sdf[column] * per_norm2;
            out->hessian[row][column] = factor * squares[i / half + k / half][MOMENT(a, b)] - explained;
        }
    return cholesky(2 * half, out->hessian, out->factor);
}
