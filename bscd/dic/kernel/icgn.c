/* IC-GN for every instruction set that the machine may have; one is picked at run time. */
#include "icgn.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "linear.h"
#include "pixels.h"

typedef float v4 __attribute__((vector_size(16)));
typedef int32_t v4i __attribute__((vector_size(16)));

/* Which coordinates of a vector's lanes cross a pixel's border; steep: more than once. */
enum { NONE_CROSSES = 0, X_CROSSES = 1, Y_CROSSES = 2, STEEP = 4 };

#define LANES 4
#define SUFFIX baseline
#include "lanes.h"
#undef LANES
#undef SUFFIX

#define LANES 16
#define SUFFIX wide
#include "lanes.h"
#undef LANES
#undef SUFFIX

#if defined(__x86_64__)
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#define LANES 8
#define SUFFIX avx2
#include "lanes.h"
#undef LANES
#undef SUFFIX
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512bw,avx512dq,avx2,fma,prefer-vector-width=512")
#define LANES 16
#define SUFFIX avx512
#include "lanes.h"
#undef LANES
#undef SUFFIX
#pragma GCC pop_options
#endif

int bscd_can_run(int set)
{
    switch (set) {
    case BSCD_SET_BASELINE:
    case BSCD_SET_WIDE: return 1;
#if defined(__x86_64__)
    case BSCD_SET_AVX2: return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    case BSCD_SET_AVX512:
        return bscd_can_run(BSCD_SET_AVX2) && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")
               && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq");
#endif
    default: return 0;
    }
}

int bscd_best_set(void)
{
    if (bscd_can_run(BSCD_SET_AVX512)) return BSCD_SET_AVX512;
    return bscd_can_run(BSCD_SET_AVX2) ? BSCD_SET_AVX2 : BSCD_SET_BASELINE;
}

int bscd_memory_row(int solved) { return MEMORY_ROW(solved); }

int bscd_icgn(int set, const bscd_image *reference, const bscd_image *current, const bscd_options *options,
              int64_t count, const double *points, double *shape, double *found, int32_t *status,
              int32_t *iterations, double *memory, const int64_t *rows)
{
    if (set == BSCD_SET_BEST) set = bscd_best_set();
    if (!bscd_can_run(set)) return 2;
#define RUN(suffix)                                                                                                    \
    bscd_icgn_##suffix(reference, current, options, count, points, shape, found, status, iterations, memory, rows)
    switch (set) {
#if defined(__x86_64__)
    case BSCD_SET_AVX512: return RUN(avx512);
    case BSCD_SET_AVX2: return RUN(avx2);
#endif
    case BSCD_SET_WIDE: return RUN(wide);
    default: return RUN(baseline);
    }
#undef RUN
}
