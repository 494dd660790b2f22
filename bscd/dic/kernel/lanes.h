/* IC-GN with ZNSSD on vectors of LANES floats; icgn.c includes this once per instruction set, with SUFFIX.
 *
 * A row of the subset is a row of vectors. Its pixels' positions in the current image are one apart but for the
 * deformation, so the spline's coefficients of all lanes are taken by plain loads at one base; a lane that has crossed
 * a pixel's border has its weights moved on by one (7 weights for 6 taps) instead of its coefficients gathered.
 * One pass an iteration: ZNSSD's mean and norm follow from sums of g, g^2 and steepest descent x g. */

#define CAT_(a, b) a##_##b
#define CAT(a, b) CAT_(a, b)
#define NAME(x) CAT(x, SUFFIX)
#define INLINE static inline __attribute__((always_inline))

typedef float NAME(vf) __attribute__((vector_size(4 * LANES)));
typedef float NAME(vfu) __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t NAME(vi) __attribute__((vector_size(4 * LANES)));
#define vf NAME(vf)
#define vfu NAME(vfu)
#define vi NAME(vi)

/* One point's subset of the reference. Rows are padded to whole vectors; m is 0 there. */
typedef struct {
    int radius, size, vectors, degree; /* degree 1 affine, 2 second order */
    float offset;                      /* taken off all grey levels, so that sums keep their digits */
    float *f, *gx, *gy, *g;            /* (size, vectors * LANES): values less offset, gradients, current values */
    const float *full, *m, *whole;     /* the same: 1 in the subset, 0 in the padding; use now; use by the reference */
    float *own, *both;                 /* room for the masks of a subset that is not whole */
    float *dx;                         /* (vectors * LANES) */
    float *value, *slope;              /* (size + 6, vectors * LANES): rows filtered along x */
} NAME(subset);
#define subset NAME(subset)

/* What the current weights m make of the reference subset. */
typedef struct {
    int n;                                         /* parameters */
    double pixels, mean, norm2;                    /* of f: count, mean, sum of squares about the mean */
    double sd[BSCD_MOST], sdf[BSCD_MOST];          /* sums of the steepest-descent images, and of them x (f - mean) */
    double hessian[BSCD_MOST][BSCD_MOST], factor[BSCD_MOST][BSCD_MOST];
} NAME(statistics);
#define statistics NAME(statistics)

INLINE vf NAME(spread)(float a)
{
    return a - (vf){0};
}
#define spread NAME(spread)

INLINE double NAME(total)(vf v)
{
    float s[LANES];
    memcpy(s, &v, sizeof s);
    for (int width = LANES / 2; width; width /= 2)
        for (int i = 0; i < width; i++) s[i] += s[i + width];
    return s[0];
}
#define total NAME(total)

INLINE vf NAME(where)(vi mask, vf a, vf b) { return (vf)(((vi)a & mask) | ((vi)b & ~mask)); }
#define where NAME(where)

INLINE vf NAME(load)(const float *p) { return *(const vfu *)p; }
#define load NAME(load)

/* Weights of the B-spline's taps at a fraction t of a pixel. Taps k and taps - 1 - k are mirror images about t = 1/2:
 * with s = t - 1/2 they are even(s^2) +- s odd(s^2). */
INLINE void NAME(weights)(const int taps, vf t, vf *w)
{
    const vf s = t - spread(0.5f), q = s * s;
#pragma GCC unroll 3
    for (int k = 0; k < taps / 2; k++) {
        const float *c = taps == 4 ? cubic_halves[k] : quintic_halves[k];
        vf even, odd;
        if (taps == 4) {
            even = spread(c[0]) + spread(c[1]) * q;
            odd = spread(c[3]) + spread(c[4]) * q;
        } else {
            even = spread(c[0]) + q * (spread(c[1]) + q * spread(c[2]));
            odd = spread(c[3]) + q * (spread(c[4]) + q * spread(c[5]));
        }
        w[k] = even + s * odd;
        w[taps - 1 - k] = even - s * odd;
    }
}

/* start + the sum over rows j and columns k of wy[j] wx[k] p[j * stride + k], for all lanes. */
INLINE vf NAME(taps_sum)(const int columns, const int rows, const float *p, int64_t stride, const vf *wx, const vf *wy,
                         vf start)
{
    vf sum = start;
#pragma GCC unroll 7
    for (int j = 0; j < rows; j++, p += stride) {
        vf s = wx[0] * load(p);
#pragma GCC unroll 7
        for (int k = 1; k < columns; k++) s += wx[k] * load(p + k);
        sum += wy[j] * s;
    }
    return sum;
}

/* The weights of lanes that are one pixel on (mask) moved on by one: taps + 1 of them. */
INLINE void NAME(move_on)(const int taps, vi mask, const vf *w, vf *moved)
{
    moved[0] = where(mask, spread(0), w[0]);
    for (int k = 1; k < taps; k++) moved[k] = where(mask, w[k - 1], w[k]);
    moved[taps] = where(mask, w[taps - 1], spread(0));
}

/* Lanes anywhere: one after the other. Slow; steep deformation and clamped borders come here. */
static __attribute__((noinline)) vf NAME(gather)(const int taps, const float *base, int64_t stride, vi xi, vi yi,
                                                 const vf *wx, const vf *wy)
{
    vf sum = spread(0);
    for (int i = 0; i < LANES; i++) {
        const float *p = base + yi[i] * stride + xi[i];
        float s = 0;
        for (int j = 0; j < taps; j++, p += stride) {
            float row = 0;
            for (int k = 0; k < taps; k++) row += wx[k][i] * p[k];
            s += wy[j][i] * row;
        }
        sum[i] = s;
    }
    return sum;
}

INLINE int NAME(all)(vi truth)
{
#if LANES == 16 && defined(__AVX512F__)
    return _mm512_test_epi32_mask((__m512i)truth, (__m512i)truth) == 0xffff;
#elif LANES == 8 && defined(__AVX2__)
    return _mm256_movemask_ps((__m256)truth) == 0xff;
#elif LANES == 4 && defined(__SSE2__)
    return _mm_movemask_ps((__m128)truth) == 0xf;
#else
    int32_t every = -1;
    for (int i = 0; i < LANES; i++) every &= truth[i];
    return every;
#endif
}

/* The current image less `offset` at x, y >= 0, counted from base (already moved to the first tap). */
INLINE vf NAME(interpolate)(const int taps, const float *base, int64_t stride, vf x, vf y, vi lane, float offset)
{
    const vi xi = __builtin_convertvector(x, vi), yi = __builtin_convertvector(y, vi), shift = xi - lane;
    vf wx[7], wy[7], moved_x[7], moved_y[7];
    NAME(weights)(taps, x - __builtin_convertvector(xi, vf), wx);
    NAME(weights)(taps, y - __builtin_convertvector(yi, vf), wy);
    const int x0 = shift[0], y0 = yi[0];
    const vf start = spread(-offset);
    const vi along = shift - x0, across = yi - y0;
    if (NAME(all)((along | across) == 0))
        return NAME(taps_sum)(taps, taps, base + y0 * stride + x0, stride, wx, wy, start);
    /* lanes differ by one pixel: the end lane tells whether on or back */
    const int x_back = along[LANES - 1] < 0, y_back = across[LANES - 1] < 0;
    const vi x_moved = along + x_back, y_moved = across + y_back;
    if (!NAME(all)(((x_moved | y_moved) & ~1) == 0)) return NAME(gather)(taps, base, stride, xi, yi, wx, wy) + start;
    const float *p = base + (y0 - y_back) * stride + x0 - x_back;
    NAME(move_on)(taps, -x_moved, wx, moved_x);
    if (NAME(all)(across == 0)) return NAME(taps_sum)(taps + 1, taps, p, stride, moved_x, wy, start);
    NAME(move_on)(taps, -y_moved, wy, moved_y);
    if (NAME(all)(along == 0)) return NAME(taps_sum)(taps, taps + 1, p, stride, wx, moved_y, start);
    return NAME(taps_sum)(taps + 1, taps + 1, p, stride, moved_x, moved_y, start);
}

/* ---- the reference ---- */

/* Filter the coefficients about a point into values and gradients; `used` taps have weight (the last one of a whole
 * pixel has none). The fraction of a pixel is the same for all pixels, so rows come first, then columns. */
INLINE void NAME(filter_subset)(const int used, subset *s, const float *base, int64_t stride, const float *wx,
                                const float *sx, const float *wy, const float *sy)
{
    const int width = s->vectors * LANES;
    for (int j = 0; j < s->size + used - 1; j++, base += stride)
        for (int v = 0; v < width; v += LANES) {
            vf value = spread(0), slope = spread(0);
#pragma GCC unroll 6
            for (int k = 0; k < used; k++) {
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
            for (int k = 0; k < used; k++) {
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

/* The reference's subset about a point; how many of its pixels may be used. */
INLINE int NAME(take_subset)(const int taps, subset *s, const bscd_image *image, double column, double row)
{
    const int r = s->radius, before = taps / 2 - 1, column0 = (int)floor(column), row0 = (int)floor(row);
    float wx[6], wy[6], sx[6], sy[6];
    spline_weights(taps, column - column0, wx, sx);
    spline_weights(taps, row - row0, wy, sy);
    const float *middle = image->coefficients + (image->pad + row0) * image->stride + image->pad + column0;
    const float *base = middle - (r + before) * (image->stride + 1);
    s->offset = *middle;
    if (column == column0 && row == row0)
        NAME(filter_subset)(taps - 1, s, base, image->stride, wx, sx, wy, sy);
    else
        NAME(filter_subset)(taps, s, base, image->stride, wx, sx, wy, sy);
    if (subset_inside(image, column, row, r)) {
        s->m = s->whole = s->full;
        return s->size * s->size;
    }
    s->m = s->whole = s->own;
    return usable_pixels(image, column, row, r, s->vectors * LANES, s->own);
}

#define ADD_MOMENTS(most, q, dx, sums)                                                                                 \
    do {                                                                                                               \
        vf power_ = (q);                                                                                               \
        _Pragma("GCC unroll 5") for (int a_ = 0; a_ <= (most); a_++, power_ *= (dx)) (sums)[a_] += power_;             \
    } while (0)

INLINE void NAME(clear)(const int most, vf moments[5][5])
{
    for (int b = 0; b <= most; b++)
        for (int a = 0; a <= most - b; a++) moments[b][a] = spread(0);
}

/* moments[b][a] += row[a] dy^b for a + b <= most */
INLINE void NAME(add_row)(const int most, const vf *row, float dy, vf moments[5][5])
{
    float power = 1;
#pragma GCC unroll 5
    for (int b = 0; b <= most; b++, power *= dy) {
#pragma GCC unroll 5
        for (int a = 0; a <= most - b; a++) moments[b][a] += spread(power) * row[a];
    }
}

/* The shape function's terms: factor x dx^a dy^b. */
static const struct {
    int a, b;
    double factor;
} NAME(terms)[6] = {{0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {2, 0, 0.5}, {1, 1, 1}, {0, 2, 0.5}};
#define terms NAME(terms)

/* Sums over the reference with the weights m; 0 when there is no texture to match. */
INLINE int NAME(describe)(const int degree, subset *s, statistics *out)
{
    const int width = s->vectors * LANES, r = s->radius, half = degree == 1 ? 3 : 6;
    vf count = spread(0), sum = spread(0);
    for (int a = 0; a < s->size * width; a += LANES) {
        const vf m = *(vf *)(s->m + a);
        count += m;
        sum += m * *(vf *)(s->f + a);
    }
    out->n = 2 * half;
    out->pixels = total(count);
    out->mean = total(sum) / out->pixels;
    vf squares[3][5][5], plain[4][5][5], norm2 = spread(0); /* xx, xy, yy; x, y, x f, y f */
    for (int q = 0; q < 3; q++) NAME(clear)(2 * degree, squares[q]);
    for (int q = 0; q < 4; q++) NAME(clear)(degree, plain[q]);
    const vf mean = spread((float)out->mean);
    for (int j = 0; j < s->size; j++) {
        vf row_squares[3][5], row_plain[4][5];
        for (int q = 0; q < 3; q++)
            for (int a = 0; a <= 2 * degree; a++) row_squares[q][a] = spread(0);
        for (int q = 0; q < 4; q++)
            for (int a = 0; a <= degree; a++) row_plain[q][a] = spread(0);
        for (int v = 0; v < width; v += LANES) {
            const int at = j * width + v;
            const vf m = *(vf *)(s->m + at), dx = *(vf *)(s->dx + v), f = (*(vf *)(s->f + at) - mean) * m;
            const vf x = *(vf *)(s->gx + at) * m, y = *(vf *)(s->gy + at) * m;
            norm2 += f * f;
            ADD_MOMENTS(2 * degree, x * x, dx, row_squares[0]);
            ADD_MOMENTS(2 * degree, x * y, dx, row_squares[1]);
            ADD_MOMENTS(2 * degree, y * y, dx, row_squares[2]);
            ADD_MOMENTS(degree, x, dx, row_plain[0]);
            ADD_MOMENTS(degree, y, dx, row_plain[1]);
            ADD_MOMENTS(degree, x * f, dx, row_plain[2]);
            ADD_MOMENTS(degree, y * f, dx, row_plain[3]);
        }
        for (int q = 0; q < 3; q++) NAME(add_row)(2 * degree, row_squares[q], (float)(j - r), squares[q]);
        for (int q = 0; q < 4; q++) NAME(add_row)(degree, row_plain[q], (float)(j - r), plain[q]);
    }
    out->norm2 = total(norm2);
    double sums[3][5][5];
    for (int q = 0; q < 3; q++)
        for (int b = 0; b <= 2 * degree; b++)
            for (int a = 0; a <= 2 * degree - b; a++) sums[q][b][a] = total(squares[q][b][a]);
    for (int i = 0; i < half; i++) {
        const int a = terms[i].a, b = terms[i].b;
        for (int side = 0; side < 2; side++) {
            out->sd[side * half + i] = terms[i].factor * total(plain[side][b][a]);
            out->sdf[side * half + i] = terms[i].factor * total(plain[2 + side][b][a]);
        }
        for (int k = 0; k < half; k++) {
            const double factor = terms[i].factor * terms[k].factor;
            const int a2 = a + terms[k].a, b2 = b + terms[k].b;
            out->hessian[i][k] = factor * sums[0][b2][a2];
            out->hessian[i][half + k] = out->hessian[half + k][i] = factor * sums[1][b2][a2];
            out->hessian[half + i][half + k] = factor * sums[2][b2][a2];
        }
    }
    if (!(out->norm2 > 1e-6 * out->pixels)) return 0;
    /* offset and gain are free in ZNSSD: what they explain is no information on the displacement */
    for (int i = 0; i < out->n; i++)
        for (int k = 0; k < out->n; k++)
            out->hessian[i][k] -= out->sd[i] * out->sd[k] / out->pixels + out->sdf[i] * out->sdf[k] / out->norm2;
    return cholesky(out->n, out->hessian, out->factor);
}

/* ---- the current image ---- */

typedef struct {
    double g, gg, fg, sdg[BSCD_MOST];
} NAME(sums);
#define sums_t NAME(sums)

/* A warp about a point: where the subset lies in the current image. */
typedef struct {
    int column, row; /* of the image, from which the local positions below count */
    float x, y, x_low, x_high, y_low, y_high;
    float s[BSCD_MOST]; /* the shape parameters */
} NAME(place);
#define place_t NAME(place)

INLINE void NAME(warp_row)(const int degree, const place_t *w, float dy, vf dx, vf *x, vf *y)
{
    const float *s = w->s;
    if (degree == 1) {
        *x = spread(w->x + s[2] * dy) + spread(1 + s[1]) * dx;
        *y = spread(w->y + (1 + s[5]) * dy) + spread(s[4]) * dx;
    } else {
        *x = spread(w->x + dy * (s[2] + s[5] / 2 * dy)) + dx * (spread(1 + s[1] + s[4] * dy) + spread(s[3] / 2) * dx);
        *y = spread(w->y + dy * (1 + s[8] + s[11] / 2 * dy)) + dx * (spread(s[7] + s[10] * dy) + spread(s[9] / 2) * dx);
    }
}

/* The current image's pixels of the warped subset into g, less the subset's offset; 0 where m is. */
INLINE void NAME(take_current)(const int taps, const int degree, const int clamped, const subset *s,
                               const bscd_image *image, const place_t *w)
{
    const int width = s->vectors * LANES, before = taps / 2 - 1;
    const int64_t stride = image->stride;
    const float *base = image->coefficients + (image->pad + w->row - before) * stride + image->pad + w->column - before;
    vi lane;
    for (int i = 0; i < LANES; i++) lane[i] = i;
    for (int j = 0; j < s->size; j++)
        for (int v = 0; v < width; v += LANES) {
            const int at = j * width + v;
            vf x, y;
            NAME(warp_row)(degree, w, (float)(j - s->radius), *(vf *)(s->dx + v), &x, &y);
            if (clamped) {
                x = where(x < w->x_low, spread(w->x_low), x);
                x = where(x > w->x_high, spread(w->x_high), x);
                y = where(y < w->y_low, spread(w->y_low), y);
                y = where(y > w->y_high, spread(w->y_high), y);
            }
            *(vf *)(s->g + at) = NAME(interpolate)(taps, base, stride, x, y, lane, s->offset) * *(vf *)(s->m + at);
        }
}

/* Sums over g, the current pixels. */
INLINE void NAME(compare)(const int degree, const subset *s, sums_t *out)
{
    const int width = s->vectors * LANES, half = degree == 1 ? 3 : 6;
    vf g1 = spread(0), gg = spread(0), fg = spread(0), x_sums[5][5], y_sums[5][5];
    NAME(clear)(degree, x_sums);
    NAME(clear)(degree, y_sums);
    for (int j = 0; j < s->size; j++) {
        vf x_row[3], y_row[3];
        for (int a = 0; a <= degree; a++) x_row[a] = y_row[a] = spread(0);
        for (int v = 0; v < width; v += LANES) {
            const int at = j * width + v;
            const vf dx = *(vf *)(s->dx + v), g = *(vf *)(s->g + at);
            g1 += g;
            gg += g * g;
            fg += g * *(vf *)(s->f + at);
            ADD_MOMENTS(degree, g * *(vf *)(s->gx + at), dx, x_row);
            ADD_MOMENTS(degree, g * *(vf *)(s->gy + at), dx, y_row);
        }
        NAME(add_row)(degree, x_row, (float)(j - s->radius), x_sums);
        NAME(add_row)(degree, y_row, (float)(j - s->radius), y_sums);
    }
    out->g = total(g1);
    out->gg = total(gg);
    out->fg = total(fg);
    for (int i = 0; i < half; i++) {
        out->sdg[i] = terms[i].factor * total(x_sums[terms[i].b][terms[i].a]);
        out->sdg[half + i] = terms[i].factor * total(y_sums[terms[i].b][terms[i].a]);
    }
}

/* How far the warped subset reaches from its middle, px. */
INLINE void NAME(extent)(const int degree, const double *p, double right, double r, double *x, double *y)
{
    const double *q = p + (degree == 1 ? 3 : 6);
    *x = fabs(1 + p[1]) * right + fabs(p[2]) * r;
    *y = fabs(q[1]) * right + fabs(1 + q[2]) * r;
    if (degree == 2) {
        *x += fabs(p[3]) / 2 * right * right + fabs(p[4]) * right * r + fabs(p[5]) / 2 * r * r;
        *y += fabs(q[3]) / 2 * right * right + fabs(q[4]) * right * r + fabs(q[5]) / 2 * r * r;
    }
}

/* m = what reference and current image both allow; the number of pixels. Positions count from the place. */
INLINE int NAME(usable_now)(const int degree, subset *s, const bscd_image *image, const place_t *w)
{
    const int width = s->vectors * LANES, r = s->radius;
    int count = 0;
    for (int j = 0; j < s->size; j++)
        for (int v = 0; v < width; v += LANES) {
            vf x, y, m = *(vf *)(s->whole + j * width + v);
            NAME(warp_row)(degree, w, (float)(j - r), *(vf *)(s->dx + v), &x, &y);
            for (int i = 0; i < LANES; i++)
                if (m[i] != 0 && !pixel_usable(image, x[i] + w->column, y[i] + w->row)) m[i] = 0;
            *(vf *)(s->both + j * width + v) = m;
            count += (int)total(m);
        }
    s->m = s->both;
    return count;
}

INLINE double NAME(displacement_norm)(const int degree, const double *d, double r)
{
    const double *q = d + (degree == 1 ? 3 : 6);
    double n = d[0] * d[0] + q[0] * q[0] + r * r * (d[1] * d[1] + d[2] * d[2] + q[1] * q[1] + q[2] * q[2]);
    if (degree == 2) {
        const double r4 = r * r * r * r;
        n += r4 * (d[3] * d[3] / 4 + d[4] * d[4] + d[5] * d[5] / 4 + q[3] * q[3] / 4 + q[4] * q[4] + q[5] * q[5] / 4);
    }
    return sqrt(n);
}

/* Solve one point; its status. */
INLINE int NAME(solve)(const int taps, const int degree, subset *s, const bscd_image *reference,
                       const bscd_image *current, const bscd_options *options, const double *point, double *p,
                       double *found, int32_t *iterations)
{
    const int half = degree == 1 ? 3 : 6;
    const double r = s->radius, right = s->vectors * LANES - 1 - s->radius, start[2] = {p[0], p[half]};
    statistics about;
    for (int i = 0; i < BSCD_FOUND; i++) found[i] = NAN;
    *iterations = 0;
    if (!pixel_usable(reference, point[0], point[1])) return BSCD_OUTSIDE;
    const int allowed = NAME(take_subset)(taps, s, reference, point[0], point[1]);
    if (allowed < options->min_pixels) return BSCD_OUTSIDE;
    int described = 0, partial = 0, status = BSCD_NOT_CONVERGED;
    while (*iterations < options->max_iterations) {
        const double x = point[0] + p[0], y = point[1] + p[half];
        if (!pixel_usable(current, x, y)) return BSCD_OUTSIDE;
        double reach_x, reach_y, lanes_x, lanes_y;
        NAME(extent)(degree, p, r, r, &reach_x, &reach_y);
        NAME(extent)(degree, p, right, r, &lanes_x, &lanes_y);
        if (!(reach_x < 8 * r + 8 && reach_y < 8 * r + 8)) return BSCD_DIVERGED;
        const double room = current->pad - taps;
        const int whole = !current->mask && x - reach_x >= 0 && x + reach_x <= current->width - 1 && y - reach_y >= 0
                          && y + reach_y <= current->height - 1;
        const int clamped = x - lanes_x < -room || x + lanes_x > current->width - 1 + room || y - lanes_y < -room
                            || y + lanes_y > current->height - 1 + room;
        place_t w;
        w.column = (int)floor(x) - (int)ceil(lanes_x) - 1;
        w.row = (int)floor(y) - (int)ceil(lanes_y) - 1;
        w.x = (float)(x - w.column);
        w.y = (float)(y - w.row);
        w.x_low = (float)(-1 - w.column);
        w.y_low = (float)(-1 - w.row);
        w.x_high = (float)(current->width - w.column);
        w.y_high = (float)(current->height - w.row);
        for (int i = 0; i < 2 * half; i++) w.s[i] = (float)p[i];
        /* which pixels take part is settled in the first iterations, so that it can not keep the rest from converging */
        if ((!whole || partial) && *iterations < 4) {
            partial = 1;
            described = 0;
            if (NAME(usable_now)(degree, s, current, &w) < options->min_pixels) return BSCD_OUTSIDE;
        }
        if (!described) {
            if (!NAME(describe)(degree, s, &about)) return BSCD_LOW_TEXTURE;
            described = 1;
        }
        sums_t now;
        if (clamped)
            NAME(take_current)(taps, degree, 1, s, current, &w);
        else
            NAME(take_current)(taps, degree, 0, s, current, &w);
        NAME(compare)(degree, s, &now);
        ++*iterations;
        const double mean = now.g / about.pixels, norm2 = now.gg - now.g * mean;
        if (!(norm2 > 1e-6 * about.pixels)) return BSCD_LOW_TEXTURE;
        const double gain = sqrt(norm2 / about.norm2);
        double b[BSCD_MOST], d[BSCD_MOST];
        for (int i = 0; i < 2 * half; i++) b[i] = (now.sdg[i] - mean * about.sd[i]) / gain - about.sdf[i];
        cholesky_solve(2 * half, about.factor, b, d);
        found[BSCD_ZNCC] = (now.fg - now.g * about.mean) / (about.norm2 * gain);
        found[BSCD_GAIN] = gain;
        found[BSCD_NORM] = NAME(displacement_norm)(degree, d, r);
        if (!(found[BSCD_NORM] < 4 * r + 4)) return BSCD_DIVERGED;
        if (!(degree == 1 ? compose_affine(p, d) : compose_quadratic(p, d))) return BSCD_DIVERGED;
        if (!(hypot(p[0] - start[0], p[half] - start[1]) < options->reach_px)) return BSCD_DIVERGED;
        if (found[BSCD_NORM] < options->tolerance_px) {
            status = BSCD_VALID;
            break;
        }
    }
    if (!described) return BSCD_NOT_CONVERGED; /* no iteration was allowed */
    found[BSCD_PIXELS] = about.pixels;
    found[BSCD_RESIDUAL] = 2 * about.norm2 * (1 - found[BSCD_ZNCC]) / fmax(about.pixels - 2 * half - 2, 1);
    double clean[BSCD_MOST][BSCD_MOST], factor[BSCD_MOST][BSCD_MOST], unit[BSCD_MOST] = {1}, column[BSCD_MOST];
    without_noise(options, point, s->radius, degree, about.pixels, about.hessian, clean);
    if (!cholesky(2 * half, clean, factor)) return BSCD_LOW_TEXTURE;
    cholesky_solve(2 * half, factor, unit, column);
    found[BSCD_VAR_U] = column[0];
    found[BSCD_COV_UV] = column[half];
    unit[0] = 0;
    unit[half] = 1;
    cholesky_solve(2 * half, factor, unit, column);
    found[BSCD_VAR_V] = column[half];
    if (!(fmax(found[BSCD_VAR_U], found[BSCD_VAR_V]) < options->variance_max)) return BSCD_LOW_TEXTURE;
    if (status == BSCD_VALID && !(found[BSCD_ZNCC] >= options->zncc_min)) return BSCD_LOW_ZNCC;
    return status;
}

static void NAME(solve_all)(const int taps, const int degree, subset *s, const bscd_image *reference,
                            const bscd_image *current, const bscd_options *options, int64_t count, const double *points,
                            double *shape, double *found, int32_t *status, int32_t *iterations)
{
    const int n = options->parameters;
#define EACH(taps_, degree_)                                                                                           \
    for (int64_t i = 0; i < count; i++)                                                                                \
        status[i] = NAME(solve)(taps_, degree_, s, reference, current, options, points + 2 * i, shape + n * i,         \
                                found + BSCD_FOUND * i, iterations + i)
    if (taps == 4 && degree == 1)
        EACH(4, 1);
    else if (taps == 4)
        EACH(4, 2);
    else if (degree == 1)
        EACH(6, 1);
    else
        EACH(6, 2);
#undef EACH
}

int NAME(bscd_icgn)(const bscd_image *reference, const bscd_image *current, const bscd_options *options, int64_t count,
                    const double *points, double *shape, double *found, int32_t *status, int32_t *iterations)
{
    subset s;
    s.radius = options->radius;
    s.size = 2 * s.radius + 1;
    s.vectors = (s.size + LANES - 1) / LANES;
    s.degree = options->parameters == 6 ? 1 : 2;
    const size_t width = (size_t)s.vectors * LANES, cells = s.size * width, rows = (s.size + 6) * width;
    float *memory = NULL;
    if (posix_memalign((void **)&memory, 64, sizeof(float) * (7 * cells + 2 * rows + width))) return 1;
    s.f = memory;
    s.gx = s.f + cells;
    s.gy = s.gx + cells;
    s.g = s.gy + cells;
    s.own = s.g + cells;
    s.both = s.own + cells;
    float *full = s.both + cells;
    for (size_t i = 0; i < cells; i++) full[i] = i % width < (size_t)s.size;
    s.full = full;
    s.value = full + cells;
    s.slope = s.value + rows;
    s.dx = s.slope + rows;
    for (size_t i = 0; i < width; i++) s.dx[i] = (float)i - s.radius;
    NAME(solve_all)(reference->taps, s.degree, &s, reference, current, options, count, points, shape, found, status,
                    iterations);
    free(memory);
    return 0;
}

#undef vf
#undef vfu
#undef vi
#undef subset
#undef statistics
#undef spread
#undef total
#undef where
#undef load
#undef terms
#undef sums_t
#undef place_t
#undef ADD_MOMENTS
#undef INLINE
#undef NAME
#undef CAT
#undef CAT_
