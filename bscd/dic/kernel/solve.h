/* One point, and all points. Included by lanes.h. */

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

/* Covariance of (u, v) for a noise variance of 1, without what the noise of the reference's gradients adds to the
 * Hessian on average; 0 when they are not placed well enough then. Where noise seems to be nearly all there is, a
 * likeness this high shows that it is not: then less is taken off. u and v are the last of the Hessian's order, so that
 * its factor's last corner is that of their own part. */
static __attribute__((noinline)) int NAME(covariance)(const int degree, const bscd_options *options,
                                                      const double *point, int radius, statistics *about,
                                                      double *found)
{
    const int n = 2 * (MOMENT(0, degree) + 1), noisy = options->noise_variance > 0;
    const double shares[4] = {1, -0.5, -0.25, -0.25};
    const int tries = noisy && found[BSCD_ZNCC] > 0.5 ? 4 : 1;
    for (int i = 0; i < tries; i++) {
        if (noisy) {
            take_noise_off(options, shares[i], point, radius, degree, about->pixels, about->hessian);
            if (!cholesky(n, about->hessian, about->factor)) continue;
        }
        const double var_v = about->factor[n - 1][n - 1], coupling = about->factor[n - 1][n - 2];
        found[BSCD_VAR_V] = var_v;
        found[BSCD_COV_UV] = -coupling * var_v;
        found[BSCD_VAR_U] = about->factor[n - 2][n - 2] + coupling * coupling * var_v;
        if (found[BSCD_VAR_U] < options->variance_max && var_v < options->variance_max) return 1;
    }
    return 0;
}

/* Solve one point; its status. The warp is of this degree; of its parameters those up to the degree `solved` are solved
 * for, the others keep what the guess gave them. */
INLINE int NAME(solve)(const int taps, const int degree, const int solved, subset *s, const bscd_image *reference,
                       const bscd_image *current, const bscd_options *options, const double *point, double *p,
                       double *found, int32_t *iterations, double *row)
{
    const int half = MOMENT(0, degree) + 1, parts = MOMENT(0, solved) + 1;
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
        const int whole = all_usable(current, x, y, reach_x, reach_y);
        const int clamped = x - lanes_x < -room || x + lanes_x > current->width - 1 + room || y - lanes_y < -room
                            || y + lanes_y > current->height - 1 + room;
        NAME(warp_subset)(degree, &s->warp, current->stride, x, y, p, p + half);
        /* which pixels take part is settled in the first iterations, so that it can not keep the rest from converging */
        if ((!whole || partial) && *iterations < 4) {
            partial = 1;
            described = 0;
            if (NAME(usable_now)(degree, s, current, p, p + half) < options->min_pixels) return BSCD_OUTSIDE;
        }
        if (!described) {
            if (row && !partial && *row)
                NAME(remember)(2 * parts, options->lit, 0, &about, row);
            else {
                if (!NAME(describe)(solved, options->lit, s, &about)) return BSCD_LOW_TEXTURE;
                if (row && !partial) {
                    NAME(remember)(2 * parts, options->lit, 1, &about, row);
                    *row = 1;
                }
            }
            described = 1;
        }
        sums_t now;
        if (clamped)
            NAME(take_current)(taps, degree, 1, s, current, p, p + half);
        else
            NAME(take_current)(taps, degree, 0, s, current, p, p + half);
        if (options->lit)
            NAME(compare)(solved, 1, s, &now);
        else
            NAME(compare)(solved, 0, s, &now);
        ++*iterations;
        const double mean = now.g / about.pixels, norm2 = now.gg - now.g * mean;
        if (!(norm2 > 1e-6 * about.pixels)) return BSCD_LOW_TEXTURE;
        const double gain = sqrt(norm2 / about.norm2), per_gain = 1 / gain;
        double b[BSCD_MOST], step[BSCD_MOST], d[BSCD_MOST] = {0};
        found[BSCD_ZNCC] = (now.fg - now.g * about.mean) / (about.norm2 * gain);
        if (options->lit) {
            const double in[LIGHT] = {now.g, now.fg, now.ramps[0], now.ramps[1]};
            found[BSCD_ZNCC] = lit_likeness(&about.light, in, norm2, now.g * mean);
            for (int i = 0; i < 2 * parts; i++) {
                b[i] = now.sdg[i];
                for (int n = 0; n < LIGHT; n++) b[i] -= about.light.share[i][n] * in[n];
                b[i] *= per_gain;
            }
        } else
            for (int i = 0; i < 2 * parts; i++) b[i] = (now.sdg[i] - mean * about.sd[i]) * per_gain - about.sdf[i];
        cholesky_solve(2 * parts, about.factor, b, step);
        for (int i = 0; i < 2 * parts; i++) d[i / parts * half + i % parts] = step[slot(parts, i / parts, i % parts)];
        found[BSCD_GAIN] = gain;
        found[BSCD_NORM] = NAME(displacement_norm)(degree, d, r);
        if (!(found[BSCD_NORM] < 4 * r + 4)) return BSCD_DIVERGED;
        if (!(degree == 1 ? compose_affine(p, d) : solved == 1 ? compose_held(p, d) : compose_quadratic(p, d)))
            return BSCD_DIVERGED;
        const double off_x = p[0] - start[0], off_y = p[half] - start[1];
        if (!(off_x * off_x + off_y * off_y < options->reach_px * options->reach_px)) return BSCD_DIVERGED;
        if (found[BSCD_NORM] < options->tolerance_px) {
            status = BSCD_VALID;
            break;
        }
    }
    if (!described) return BSCD_NOT_CONVERGED; /* no iteration was allowed */
    found[BSCD_PIXELS] = about.pixels;
    const double spare = about.pixels - 2 * parts - (options->lit ? LIGHT : 2);
    found[BSCD_RESIDUAL] = 2 * about.norm2 * (1 - found[BSCD_ZNCC]) / (spare > 1 ? spare : 1);
    if (!NAME(covariance)(solved, options, point, s->radius, &about, found)) return BSCD_LOW_TEXTURE;
    if (status == BSCD_VALID && !(found[BSCD_ZNCC] >= options->zncc_min)) return BSCD_LOW_ZNCC;
    return status;
}

static void NAME(solve_all)(const int taps, subset *s, const bscd_image *reference,
                            const bscd_image *current, const bscd_options *options, int64_t count, const double *points,
                            double *shape, double *found, int32_t *status, int32_t *iterations, double *memory,
                            const int64_t *rows)
{
    const int n = options->parameters, row = MEMORY_ROW(options->solved);
#define EACH(taps_, degree_, solved_)                                                                                  \
    for (int64_t i = 0; i < count; i++)                                                                                \
        status[i] = NAME(solve)(taps_, degree_, solved_, s, reference, current, options, points + 2 * i,               \
                                shape + n * i, found + BSCD_FOUND * i, iterations + i,                                 \
                                memory ? memory + row * rows[i] : NULL)
    if (taps == 4 && n == 6 && options->solved == 2)
        EACH(4, 1, 0);
    else if (taps == 4 && n == 6)
        EACH(4, 1, 1);
    else if (taps == 4 && options->solved == 6)
        EACH(4, 2, 1);
    else if (taps == 4)
        EACH(4, 2, 2);
    else if (n == 6 && options->solved == 2)
        EACH(6, 1, 0);
    else if (n == 6)
        EACH(6, 1, 1);
    else if (options->solved == 6)
        EACH(6, 2, 1);
    else
        EACH(6, 2, 2);
#undef EACH
}

int NAME(bscd_icgn)(const bscd_image *reference, const bscd_image *current, const bscd_options *options, int64_t count,
                    const double *points, double *shape, double *found, int32_t *status, int32_t *iterations,
                    double *known, const int64_t *known_rows)
{
    subset s;
    s.radius = options->radius;
    s.size = 2 * s.radius + 1;
    s.vectors = (s.size + LANES - 1) / LANES;
    const size_t width = (size_t)s.vectors * LANES, cells = s.size * width, rows = (s.size + 5) * width;
    const size_t vectors = ((size_t)s.size * s.vectors + LANES - 1) / LANES * LANES;
    float *memory = NULL;
    if (posix_memalign((void **)&memory, 64, sizeof(float) * (8 * cells + 2 * rows + width + 10 * vectors))) return 1;
    s.f = memory;
    s.gx = s.f + cells;
    s.gy = s.gx + cells;
    s.g = s.gy + cells;
    s.own = s.g + cells;
    s.both = s.own + cells;
    s.bright = s.both + cells;
    float *full = s.bright + cells;
    for (size_t i = 0; i < cells; i++) full[i] = i % width < (size_t)s.size;
    s.full = full;
    s.value = full + cells;
    s.slope = s.value + rows;
    s.dx = s.slope + rows;
    for (size_t i = 0; i < width; i++) s.dx[i] = (float)i - s.radius;
    warp_t *w = &s.warp;
    w->vectors = (int)vectors;
    w->dx = s.dx + width;
    w->dy = w->dx + vectors;
    w->x.s = w->dy + vectors;
    w->y.s = w->x.s + vectors;
    w->x.slope = w->y.s + vectors;
    w->y.slope = w->x.slope + vectors;
    w->x.pixel = (int32_t *)(w->y.slope + vectors);
    w->y.pixel = w->x.pixel + vectors;
    w->offset = w->y.pixel + vectors;
    w->kind = w->offset + vectors;
    for (int i = 0; i < w->vectors; i++) {
        w->dx[i] = (float)(i % s.vectors * LANES - s.radius);
        w->dy[i] = (float)(i / s.vectors - s.radius);
    }
    NAME(solve_all)(reference->taps, &s, reference, current, options, count, points, shape, found, status, iterations,
                    known, known_rows);
    free(memory);
    return 0;
}
