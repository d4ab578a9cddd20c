/* Values of functions at many points, for one instruction set. kernel.c includes this file once for each set, with
 *
 *   NAME(f)   f's name for this set
 *   TARGET    the attribute that lets the compiler use the set
 *   LANES     floats of a vector
 *   VECTORS   vectors of a tile: as many as the registers hold
 *   RELU(u)   max(0, u) of a vector; NaN stays NaN
 *
 * Points are the lanes: every point sums its units in the same order, whatever tile and lane it is in. So its value
 * depends on nothing but the point.
 */

#define Vector NAME(vector)
#define TILE (VECTORS * LANES)

typedef float Vector __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* Compute one tile of `vectors` vectors, of which `count` points are read and written. */
TARGET INLINE void NAME(fold_tile)(const int vectors, const Cell *cell, const float *const in[3], float *const out[3],
                                   int64_t at, int64_t count)
{
    float spare[3][TILE] = {{0}};
    Vector x[3][VECTORS], total[3][VECTORS] = {{{0}}};
    const int whole = count == vectors * LANES;

    for (int axis = 0; axis < 3; axis++) {
        if (!whole)
            memcpy(spare[axis], in[axis] + at, (size_t)count * sizeof(float));
        const float *from = whole ? in[axis] + at : spare[axis];
        for (int v = 0; v < vectors; v++)
            x[axis][v] = *(const Vector *)(from + v * LANES);
    }
    for (int64_t start = 0; start < cell->units; start += BLOCK) {
        const int64_t stop = start + BLOCK < cell->units ? start + BLOCK : cell->units;
        Vector sum[3][VECTORS] = {{{0}}};
        for (const float *unit = cell->packed + ROW * start; unit < cell->packed + ROW * stop; unit += ROW) {
            for (int v = 0; v < vectors; v++) {
                Vector u = unit[0] * x[0][v] + (unit[1] * x[1][v] + (unit[2] * x[2][v] + unit[3]));
                u = RELU(u);
                for (int axis = 0; axis < 3; axis++)
                    sum[axis][v] += unit[4 + axis] * u;
            }
        }
        for (int axis = 0; axis < 3; axis++)
            for (int v = 0; v < vectors; v++)
                total[axis][v] += sum[axis][v];
    }
    for (int axis = 0; axis < 3; axis++) {
        const float *t = cell->affine + 4 * axis;
        float *to = whole ? out[axis] + at : spare[axis];
        for (int v = 0; v < vectors; v++)
            *(Vector *)(to + v * LANES) =
                total[axis][v] + (t[0] * x[0][v] + (t[1] * x[1][v] + (t[2] * x[2][v] + t[3])));
        if (!whole)
            memcpy(out[axis] + at, spare[axis], (size_t)count * sizeof(float));
    }
}

/* Compute the values of one cell's function at `n` points; `in` and `out` may be the same. */
TARGET static void NAME(fold_cell)(const Cell *cell, const float *const in[3], float *const out[3], int64_t n)
{
    int64_t at = 0;
    for (; at + TILE <= n; at += TILE)
        NAME(fold_tile)(VECTORS, cell, in, out, at, TILE);
    for (; at < n; at += LANES)
        NAME(fold_tile)(1, cell, in, out, at, n - at < LANES ? n - at : LANES);
}

/* Find the cell of each point. */
TARGET static void NAME(find_cells)(const Fold *fold, const float *restrict x, int64_t n, int32_t *restrict cell)
{
    const int32_t grid = fold->grid, outside = grid * grid * grid;
    const float edge = (float)grid;
    for (int64_t i = 0; i < n; i++) {
        const float a = (x[i] - fold->origin[0]) * fold->per_unit[0];
        const float b = (x[n + i] - fold->origin[1]) * fold->per_unit[1];
        const float c = (x[2 * n + i] - fold->origin[2]) * fold->per_unit[2];
        const int inside = (a >= 0) & (a < edge) & (b >= 0) & (b < edge) & (c >= 0) & (c < edge); /* not for NaN */
        const int32_t row = (int32_t)(inside ? a : 0) * grid + (int32_t)(inside ? b : 0);
        cell[i] = inside ? row * grid + (int32_t)(inside ? c : 0) : outside;
    }
}

/* Bring values, which are in the order of the cells, back to the order of the points. */
TARGET static void NAME(restore)(const int32_t *restrict place, const float *restrict sorted, int64_t n,
                                 float *restrict y)
{
    for (int64_t i = 0; i < n; i++)
        y[i] = sorted[place[i]];
}

#undef Vector
#undef TILE
#undef NAME
#undef TARGET
#undef LANES
#undef RELU
