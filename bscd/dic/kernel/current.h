/* The current image's pixels of a warped subset, and their sums. Included by lanes.h. */

/* A coordinate, counted from `from` and less `step`, kept on an image `size` wide and a pixel around it. */
INLINE vf NAME(clamp)(vf place, int from, int size, vf step)
{
    const vf low = spread((float)(-1 - from)) - step, high = spread((float)(size - from)) - step;
    place = where(place < low, low, place);
    return where(place > high, high, place);
}

/* The current image's pixels of the warped subset into g, less the subset's offset; 0 where m is. `clamped`: it may lie
 * beyond the image's padding. u and v are its shape parameters. */
INLINE void NAME(take_current)(const int taps, const int degree, const int clamped, const subset *s,
                               const bscd_image *image, const double *u, const double *v)
{
    const warp_t *w = &s->warp;
    const int count = s->size * s->vectors, before = taps / 2 - 1;
    const int64_t stride = image->stride;
    const int64_t first_row = image->pad - before + w->y.origin, first_column = image->pad - before + w->x.origin;
    const float *base = image->coefficients + first_row * stride + first_column;
    const vf x_slope = lanes() * (float)u[1], y_slope = lanes() * (float)v[1], start = spread(-s->offset);
    for (int i = 0; i < count; i++) {
        const float *p = base + w->offset[i];
        vf x = NAME(along)(degree, &w->x, i, x_slope), y = NAME(along)(degree, &w->y, i, y_slope), g;
        if (clamped) {
            const int column = w->x.origin + (int)w->dx[i] + w->x.pixel[i];
            const int row = w->y.origin + (int)w->dy[i] + w->y.pixel[i];
            x = NAME(clamp)(x + spread(0.5f), column, image->width, lanes());
            y = NAME(clamp)(y + spread(0.5f), row, image->height, spread(0));
            g = NAME(gather)(taps, p, stride, x, y, start);
        } else
            g = NAME(interpolate)(taps, p, stride, w->kind[i], x, y, start);
        *(vf *)(s->g + i * LANES) = g * *(vf *)(s->m + i * LANES);
    }
}

/* Sums over g, the current pixels: of g, g^2, f g, of g x the reference's lit ramps (`light`) and, in the order of
 * `slot`, of g x the steepest-descent images. */
typedef struct {
    double g, gg, fg, ramps[2], sdg[BSCD_MOST];
} NAME(sums);
#define sums_t NAME(sums)

INLINE void NAME(compare)(const int degree, const int lit, const subset *s, sums_t *out)
{
    const int width = s->vectors * LANES, half = MOMENT(0, degree) + 1, ramps = 3 + 2 * half;
    const vf offset = spread(s->offset);
    vf sums[3 + 2 * 6 + 2];
    NAME(clear)(5 + 2 * half, sums);
    for (int v = 0; v < width; v += LANES) {
        vf column[2][3], down = spread(0), all = spread(0), dy = spread((float)-s->radius);
        NAME(clear)(degree + 1, column[0]);
        NAME(clear)(degree + 1, column[1]);
        for (int j = 0, at = v; j < s->size; j++, at += width, dy += 1) {
            const vf g = *(vf *)(s->g + at), f = *(vf *)(s->f + at);
            sums[0] += g;
            sums[1] += g * g;
            sums[2] += g * f;
            if (lit) {
                const vf product = g * (f + offset);
                all += product;
                down += product * dy;
            }
            NAME(add_powers)(degree, g * *(vf *)(s->gx + at), dy, column[0]);
            NAME(add_powers)(degree, g * *(vf *)(s->gy + at), dy, column[1]);
        }
        NAME(add_column)(degree, *(vf *)(s->dx + v), column[0], sums + 3);
        NAME(add_column)(degree, *(vf *)(s->dx + v), column[1], sums + 3 + half);
        sums[ramps] += all * *(vf *)(s->dx + v);
        sums[ramps + 1] += down;
    }
    double total[3 + 2 * 6 + 2];
    totals(lit ? 5 + 2 * half : 3 + 2 * half, sums, total);
    out->g = total[0];
    out->gg = total[1];
    out->fg = total[2];
    for (int i = 0; i < 2; i++) out->ramps[i] = lit ? total[ramps + i] : 0;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < half; i++)
            out->sdg[slot(half, side, i)] = terms[i].factor * total[3 + side * half + i];
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

/* m = what reference and current image both allow; the number of pixels. */
static __attribute__((noinline)) int NAME(usable_now)(const int degree, subset *s, const bscd_image *image,
                                                      const double *u, const double *v)
{
    const warp_t *w = &s->warp;
    const vf x_slope = lanes() * (float)u[1], y_slope = lanes() * (float)v[1];
    int pixels = 0;
    for (int i = 0; i < s->size * s->vectors; i++) {
        const double column = w->x.origin + (int)w->dx[i] + w->x.pixel[i] + 0.5;
        const double row = w->y.origin + (int)w->dy[i] + w->y.pixel[i] + 0.5;
        const vf x = NAME(along)(degree, &w->x, i, x_slope) + lanes(), y = NAME(along)(degree, &w->y, i, y_slope);
        vf m = *(vf *)(s->whole + i * LANES);
        for (int k = 0; k < LANES; k++)
            if (m[k] != 0) {
                const int usable = pixel_usable(image, column + x[k], row + y[k]);
                m[k] = (float)usable;
                pixels += usable;
            }
        *(vf *)(s->both + i * LANES) = m;
    }
    s->m = s->both;
    return pixels;
}
