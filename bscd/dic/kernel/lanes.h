/* IC-GN with ZNSSD on vectors of LANES floats; icgn.c includes this once per instruction set, with SUFFIX.
 *
 * A row of the subset is a row of vectors. One pass an iteration: ZNSSD's mean and norm follow from sums of g, g^2 and
 * steepest descent x g. */

#define CAT_(a, b) a##_##b
#define CAT(a, b) CAT_(a, b)
#define NAME(x) CAT(x, SUFFIX)
#define INLINE static inline __attribute__((always_inline))

#include "vectors.h"

#include "interpolation.h"

#include "warp.h"

#include "reference.h"

#include "current.h"

#include "solve.h"

#undef vf
#undef vfu
#undef vi
#undef spread
#undef load
#undef where
#undef lanes
#undef totals
#undef course
#undef subset
#undef statistics
#undef warp_t
#undef sums_t
#undef INLINE
#undef NAME
#undef CAT
#undef CAT_
