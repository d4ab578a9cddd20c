/* The linear units of each cell, added up, for one instruction set (points.h): the units are the lanes. */

#define Flags NAME(flags)

typedef int32_t Flags __attribute__((vector_size(4 * LANES)));

/* Cut one cell. `flags` becomes 0 for each unit whose plane crosses it. */
TARGET static void NAME(cut_cell)(const Cut *cut, const float center[3], float affine[OUTER], int32_t *flags)
{
    const int64_t n = cut->apart;
    Vector sums[OUTER] = {{0}};
    for (int64_t unit = 0; unit < cut->padded; unit += LANES) {
        const float *column = cut->columns + unit;
        const Vector x = *(const Vector *)column, y = *(const Vector *)(column + n);
        const Vector z = *(const Vector *)(column + 2 * n);
        const Vector bias = *(const Vector *)(column + 3 * n), reach = *(const Vector *)(column + 4 * n);
        const Vector at = x * center[0] + (y * center[1] + (z * center[2] + bias));
        const Flags linear = at > reach, off = at < -reach; /* neither for NaN */
        const Flags flag = linear | off;
        memcpy(flags + unit, &flag, sizeof(flag));
        for (int t = 0; t < OUTER; t++) {
            const Flags product = *(const Flags *)(column + (5 + t) * n);
            sums[t] += (Vector)(product & linear);
        }
    }
    for (int t = 0; t < OUTER; t++) {
        affine[t] = 0;
        for (int lane = 0; lane < LANES; lane++)
            affine[t] += sums[t][lane];
    }
}

#undef Flags
