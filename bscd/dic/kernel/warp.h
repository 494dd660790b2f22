/* Where the vectors of a warped subset lie in the current image. Included by lanes.h.
 *
 * All vectors of the subset are placed first, LANES at a time, so that the interpolation that follows finds its
 * addresses ready. Places count from where the vector would lie if the whole subset moved by whole pixels: small
 * numbers, which keep their digits in single precision. */

/* One coordinate of all vectors. A vector's lane i lies at pixel + 1/2 + s + slope i + bend i^2 from its own place. */
typedef struct {
    int origin;     /* the pixel of the current image that the point lies in */
    float bend;
    float *s, *slope; /* a vector each */
    int32_t *pixel;
} NAME(course);
#define course NAME(course)

typedef struct {
    int vectors;          /* of the subset, in whole vectors of them */
    float *dx, *dy;       /* of the vectors' first lanes from the point */
    course x, y;
    int32_t *offset;      /* of the vectors' pixels from the origins in the image's coefficients */
    int32_t *kind;        /* NONE_CROSSES, ... */
} NAME(warp);
#define warp_t NAME(warp)

INLINE vi NAME(floor)(vf v)
{
    const vi whole = __builtin_convertvector(v, vi);
    return whole + (__builtin_convertvector(whole, vf) > v); /* truth is -1 */
}

/* Place the vectors i to i + LANES - 1 along one coordinate, of the point at `middle` with the shape parameters p; how
 * many pixel borders lie between a vector's lanes. */
INLINE vi NAME(place)(const int degree, course *c, int i, double middle, const double *p, vf dx, vf dy)
{
    const float length = LANES - 1;
    vf at = spread((float)(middle - c->origin)) + dy * spread((float)p[2]), slope = spread((float)p[1]), high, low;
    if (degree == 2) {
        const vf bend = spread(c->bend);
        at += dy * dy * spread((float)p[5] / 2);
        slope += dy * spread((float)p[4]);
        at += dx * (slope + dx * bend);
        slope += 2 * dx * bend;
        *(vf *)(c->slope + i) = slope;
    } else
        at += dx * slope;
    const vf end = at + slope * length + spread(c->bend * length * length);
    low = where(end < at, end, at);
    high = where(end < at, at, end);
    if (degree == 2) {
        /* between its ends a parabola leads beyond them by no more than this */
        const vf beyond = spread(fabsf(c->bend) * length * length / 4);
        low -= beyond;
        high += beyond;
    }
    const vi pixel = NAME(floor)(low);
    *(vi *)(c->pixel + i) = pixel;
    *(vf *)(c->s + i) = at - __builtin_convertvector(pixel, vf) - spread(0.5f);
    return NAME(floor)(high) - pixel;
}

/* Place the subset about x, y, on the image, with the shape parameters u and v. */
INLINE void NAME(warp_subset)(const int degree, warp_t *w, int64_t stride, double x, double y, const double *u,
                              const double *v)
{
    w->x.origin = (int)x;
    w->y.origin = (int)y;
    w->x.bend = degree == 1 ? 0 : (float)u[3] / 2;
    w->y.bend = degree == 1 ? 0 : (float)v[3] / 2;
    for (int i = 0; i < w->vectors; i += LANES) {
        const vf dx = *(vf *)(w->dx + i), dy = *(vf *)(w->dy + i);
        const vi x_borders = NAME(place)(degree, &w->x, i, x, u, dx, dy);
        const vi y_borders = NAME(place)(degree, &w->y, i, y, v, dx, dy);
        const vi columns = *(vi *)(w->x.pixel + i) + __builtin_convertvector(dx, vi);
        const vi rows = *(vi *)(w->y.pixel + i) + __builtin_convertvector(dy, vi);
        *(vi *)(w->offset + i) = rows * (int32_t)stride + columns;
        const vi steep = (x_borders | y_borders) > 1;
        *(vi *)(w->kind + i) = (steep & STEEP) | (~steep & (x_borders * X_CROSSES + y_borders * Y_CROSSES));
    }
}

/* A coordinate of vector i's lanes, less the pixel and 1/2. `slope`: that of all vectors, where they share it. */
INLINE vf NAME(along)(const int degree, const course *c, int i, vf slope)
{
    const vf s = spread(c->s[i]);
    if (degree == 1) return s + slope;
    return s + lanes() * (spread(c->slope[i]) + spread(c->bend) * lanes());
}
