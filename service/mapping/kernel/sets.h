/* The code of each instruction set of the processor, and which of them it has. */

#if defined(__x86_64__)
#include <immintrin.h>

/* maxps and minps return their second operand if one of the two is NaN. */
#define NAME(f) f##_avx512
#define TARGET __attribute__((target("avx512f,avx512vl,avx512dq,avx512bw,fma")))
#define LANES 16
#define VECTORS 2
#define ROWS 8
#define MAX(a, b) _mm512_max_ps(a, b)
#define MIN(a, b) _mm512_min_ps(a, b)
#include "points.h"
#include "cells.h"
#include "layers.h"

#define NAME(f) f##_avx2
#define TARGET __attribute__((target("avx2,fma")))
#define LANES 8
#define ROWS 4
#define MAX(a, b) _mm256_max_ps(a, b)
#define MIN(a, b) _mm256_min_ps(a, b)
#include "points.h"
#include "cells.h"
#include "layers.h"

#define NAME(f) f##_sse2
#define TARGET
#define LANES 4
#define ROWS 4
#define MAX(a, b) _mm_max_ps(a, b)
#define MIN(a, b) _mm_min_ps(a, b)
#include "points.h"
#include "cells.h"
#include "layers.h"

#define SETS 3
#else

typedef int32_t Bits __attribute__((vector_size(16)));

#define NAME(f) f##_plain
#define TARGET
#define LANES 4
#define VECTORS 4
#define ROWS 4
#define CHOOSE(if_true, a, b) (vector_plain)(((Bits)(a) & (if_true)) | ((Bits)(b) & ~(if_true)))
#define MAX(a, b) CHOOSE((a) > (b), a, b)
#define MIN(a, b) CHOOSE((a) < (b), a, b)
#include "points.h"
#include "cells.h"
#include "layers.h"

#define SETS 1
#endif

typedef struct {
    const char *name;
    void (*fold_cell)(const Cell *, const float *const[3], float *const[3], int64_t);
    void (*find_cells)(const Fold *, const float *, int64_t, int32_t *);
    void (*restore)(const int32_t *, const float *, int64_t, float *);
    void (*cut_cell)(const Cut *, const float[3], float[OUTER], int32_t *);
    void (*map_layers)(const Network *, const float *, int64_t, float *, float *, float *);
} Set;

#define SET(text, suffix) \
    {text, fold_cell_##suffix, find_cells_##suffix, restore_##suffix, cut_cell_##suffix, map_layers_##suffix}

/* Best first. */
static const Set sets[SETS] = {
#if defined(__x86_64__)
    SET("AVX-512", avx512), SET("AVX2", avx2), SET("SSE2", sse2),
#else
    SET("plain C", plain),
#endif
};

/* Return the index of the best set that the processor has. */
static int best_set(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("fma"))
        return 0;
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? 1 : 2;
#else
    return 0;
#endif
}
