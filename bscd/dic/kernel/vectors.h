/* Vectors of LANES floats: loads, choices, sums. Included by lanes.h. */

typedef float NAME(vf) __attribute__((vector_size(4 * LANES)));
typedef float NAME(vfu) __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t NAME(vi) __attribute__((vector_size(4 * LANES)));
#define vf NAME(vf)
#define vfu NAME(vfu)
#define vi NAME(vi)

INLINE vf NAME(spread)(float a)
{
    return a - (vf){0};
}
#define spread NAME(spread)

INLINE vf NAME(load)(const float *p) { return *(const vfu *)p; }
#define load NAME(load)

INLINE vf NAME(where)(vi mask, vf a, vf b) { return (vf)(((vi)a & mask) | ((vi)b & ~mask)); }
#define where NAME(where)

/* The numbers of the lanes. */
INLINE vf NAME(lanes)(void)
{
    vf lane;
    for (int i = 0; i < LANES; i++) lane[i] = (float)i;
    return lane;
}
#define lanes NAME(lanes)

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

/* A vector's sum in four parts. */
INLINE v4 NAME(quarters)(vf v)
{
    v4 part[LANES / 4], sum;
    memcpy(part, &v, sizeof part);
    sum = part[0];
    for (int i = 1; i < LANES / 4; i++) sum += part[i];
    return sum;
}

/* out[i] = the sum of all lanes of v[i]. Four vectors at a time, added as they are transposed. */
INLINE void NAME(totals)(const int count, const vf *v, double *out)
{
#pragma GCC unroll 16
    for (int i = 0; i < count; i += 4) {
        v4 part[4];
#pragma GCC unroll 4
        for (int k = 0; k < 4; k++) part[k] = i + k < count ? NAME(quarters)(v[i + k]) : (v4){0};
        const v4 ab = __builtin_shuffle(part[0], part[1], (v4i){0, 4, 1, 5})
                      + __builtin_shuffle(part[0], part[1], (v4i){2, 6, 3, 7});
        const v4 cd = __builtin_shuffle(part[2], part[3], (v4i){0, 4, 1, 5})
                      + __builtin_shuffle(part[2], part[3], (v4i){2, 6, 3, 7});
        const v4 abcd = __builtin_shuffle(ab, cd, (v4i){0, 1, 4, 5}) + __builtin_shuffle(ab, cd, (v4i){2, 3, 6, 7});
#pragma GCC unroll 4
        for (int k = 0; k < 4; k++)
            if (i + k < count) out[i + k] = abcd[k];
    }
}
#define totals NAME(totals)
