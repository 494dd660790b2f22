/* The spline at a vector's lanes. Included by lanes.h.
 *
 * Lanes lie one pixel apart but for the deformation, so the coefficients of all lanes are taken by plain loads at one
 * base. Lanes that have crossed a pixel's border have their weights moved on by one (one weight more than taps) instead
 * of their coefficients gathered. */

/* Weights of the B-spline's taps at s = t - 1/2, t the fraction of a pixel. Taps k and taps - 1 - k are mirror images
 * about the middle: even(s) + odd(s) and even(s) - odd(s). All weights add up to 1, which gives the last even part.
 * Sums end in an addition where they can: it has ports of its own beside those of the multiplications. */
INLINE void NAME(weights)(const int taps, vf s, vf *w)
{
    const vf s2 = s * s, s3 = s2 * s, s5 = s3 * s2;
    vf last = spread(0.5f);
#pragma GCC unroll 3
    for (int k = 0; k < taps / 2; k++) {
        const float *c = taps == 4 ? cubic_halves[k] : quintic_halves[k];
        vf even = last, odd = spread(c[3]) * s + spread(c[4]) * s3;
        if (taps == 6) odd += spread(c[5]) * s5;
        if (k < taps / 2 - 1) {
            even = spread(c[0]) + s2 * (taps == 4 ? spread(c[1]) : spread(c[1]) + s2 * spread(c[2]));
            last -= even;
        }
        w[k] = even + odd;
        w[taps - 1 - k] = even - odd;
    }
}

/* start + the sum over rows j and columns k of wy[j] wx[k] p[j * stride + k], for all lanes. Every other tap and every
 * other row has a sum of its own: one chain of additions would take longer than the next vector's work can hide. */
INLINE vf NAME(taps_sum)(const int columns, const int rows, const float *p, int64_t stride, const vf *wx, const vf *wy,
                         vf start)
{
    vf sum[2] = {start, spread(0)};
#pragma GCC unroll 7
    for (int j = 0; j < rows; j++, p += stride) {
        vf s[2] = {wx[0] * load(p), wx[1] * load(p + 1)};
#pragma GCC unroll 7
        for (int k = 2; k < columns; k++) s[k % 2] += wx[k] * load(p + k);
        sum[j % 2] = j == 1 ? wy[j] * (s[0] + s[1]) : sum[j % 2] + wy[j] * (s[0] + s[1]);
    }
    return sum[0] + sum[1];
}

/* Weights where some lanes are one pixel on, s in [-1/2, 3/2): taps + 1 of them. */
INLINE void NAME(weights_across)(const int taps, vf s, vf *moved)
{
    const vi on = s >= spread(0.5f);
    vf w[6];
    NAME(weights)(taps, s - where(on, spread(1), spread(0)), w);
    moved[0] = where(on, spread(0), w[0]);
    for (int k = 1; k < taps; k++) moved[k] = where(on, w[k - 1], w[k]);
    moved[taps] = where(on, w[taps - 1], spread(0));
}

#if LANES == 16 && defined(__AVX512F__)
/* The sum of `gather` for lanes that no more than a vector's reach lies between: a row's taps are picked from two vectors
 * of it; what is not in a lane's rows weighs nothing there. To the last bit what lane after lane gives. Lane i
 * takes its taps from at[i] on, in rows from down[i] on, of `tall` at most. */
INLINE vf NAME(pick)(const int taps, const float *p, int64_t stride, vi at, vi down, int tall, const vf *wx, const vf *wy)
{
    vf sum = spread(0);
    for (int j = 0; j < taps + tall; j++, p += stride) {
        const vf near = load(p), far = load(p + LANES);
        vf row = spread(0), weight = spread(0);
#pragma GCC unroll 6
        for (int k = 0; k < taps; k++) row += wx[k] * __builtin_shuffle(near, far, at + k);
        for (int d = j < taps ? 0 : j - taps + 1; d <= tall && d <= j; d++) weight = where(down == d, wy[j - d], weight);
        sum += weight * row;
    }
    return sum;
}
#endif

/* start + the spline at lane i + x[i], y[i], any finite numbers, counted from base, which is moved to the first
 * tap: lane after lane. Slow; steep deformation and clamped borders come here. */
static __attribute__((noinline)) vf NAME(gather)(const int taps, const float *base, int64_t stride, vf x, vf y,
                                                 vf start)
{
    vi xi = __builtin_convertvector(x, vi), yi = __builtin_convertvector(y, vi);
    xi += __builtin_convertvector(xi, vf) > x; /* floor */
    yi += __builtin_convertvector(yi, vf) > y;
    vf wx[6], wy[6], sum = start;
    NAME(weights)(taps, x - __builtin_convertvector(xi, vf) - spread(0.5f), wx);
    NAME(weights)(taps, y - __builtin_convertvector(yi, vf) - spread(0.5f), wy);
#if LANES == 16 && defined(__AVX512F__)
    const int left = _mm512_reduce_min_epi32((__m512i)xi), wide = _mm512_reduce_max_epi32((__m512i)xi) - left;
    const int top = _mm512_reduce_min_epi32((__m512i)yi), tall = _mm512_reduce_max_epi32((__m512i)yi) - top;
    if (wide <= LANES + 1 - taps && tall <= LANES) {
        const vi at = __builtin_convertvector(lanes(), vi) + xi - left;
        return start + NAME(pick)(taps, base + top * stride + left, stride, at, yi - top, tall, wx, wy);
    }
#endif
    for (int i = 0; i < LANES; i++) {
        const float *p = base + yi[i] * stride + xi[i] + i;
        float s = 0;
        for (int j = 0; j < taps; j++, p += stride) {
            float row = 0;
            for (int k = 0; k < taps; k++) row += wx[k][i] * p[k];
            s += wy[j][i] * row;
        }
        sum[i] += s;
    }
    return sum;
}

/* start + the spline along a vector; p is where its first lane takes its first tap. sx, sy: the fractions of a
 * pixel less 1/2. `kind`: which of them cross a pixel's border. */
INLINE vf NAME(interpolate)(const int taps, const float *p, int64_t stride, int kind, vf sx, vf sy, vf start)
{
    vf wx[7], wy[7];
    if (__builtin_expect(kind == NONE_CROSSES, 1)) {
        NAME(weights)(taps, sx, wx);
        NAME(weights)(taps, sy, wy);
        return NAME(taps_sum)(taps, taps, p, stride, wx, wy, start);
    }
    switch (kind) {
    case X_CROSSES:
        NAME(weights_across)(taps, sx, wx);
        NAME(weights)(taps, sy, wy);
        return NAME(taps_sum)(taps + 1, taps, p, stride, wx, wy, start);
    case Y_CROSSES:
        NAME(weights)(taps, sx, wx);
        NAME(weights_across)(taps, sy, wy);
        return NAME(taps_sum)(taps, taps + 1, p, stride, wx, wy, start);
    case X_CROSSES | Y_CROSSES:
        NAME(weights_across)(taps, sx, wx);
        NAME(weights_across)(taps, sy, wy);
        return NAME(taps_sum)(taps + 1, taps + 1, p, stride, wx, wy, start);
    default: return NAME(gather)(taps, p, stride, sx + spread(0.5f), sy + spread(0.5f), start);
    }
}
