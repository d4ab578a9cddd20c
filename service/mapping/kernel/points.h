/* Values of functions at many points, for one instruction set. kernel.c includes this file once for each set, with
 *
 *   NAME(f)   f's name for this set
 *   TARGET    the attribute that lets the compiler use the set
 *   LANES     floats of a vector
 *   VECTORS   vectors of a tile: as many as the registers hold
 *   MAX(a, b), MIN(a, b)   of vectors; b where one of the two is NaN
 *
 * Points are the lanes: every point sums its units in the same order, whatever tile and lane it is in. So its value
 * depends on nothing but the point.
 */

#define Vector NAME(vector)
#define TILE (VECTORS * LANES)

typedef float Vector __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* Return tanh of a vector, with an absolute error below 5e-7: a quotient of polynomials that was fitted for |u| <= 8.5. */
TARGET INLINE Vector NAME(tanh)(Vector u)
{
    u = MAX((Vector){0} - 8.5f, MIN((Vector){0} + 8.5f, u));
    const Vector s = u * u;
    const Vector p = u * (0.99999994f + s * (0.134062037f + s * (0.00352581707f + s * (2.11215392e-05f + s * 1.40992107e-08f))));
    const Vector q = 1 + s * (0.467395157f + s * (0.0259911269f + s * (0.000333568692f + s * 8.07360323e-07f)));
    return p / q;
}

TARGET INLINE Vector NAME(activate)(Vector u, const Activation activation)
{
    if (activation == TANH)
        return NAME(tanh)(u);
    if (activation == RELU)
        return MAX((Vector){0}, u);
    return u;
}

/* Return an axis of a cell's affine map. That of tanh is constant: zero times infinity would be NaN. */
TARGET INLINE Vector NAME(affine)(const float t[4], Vector x, Vector y, Vector z, const Activation activation)
{
    const Vector constant = (Vector){0} + t[3];
    if (activation == TANH)
        return constant;
    return t[0] * x + (t[1] * y + (t[2] * z + constant));
}

/* Compute one tile of `vectors` vectors, of which `count` points are read and written. */
TARGET INLINE void NAME(fold_tile)(const int vectors, const Activation activation, const Cell *cell,
                                   const float *const in[3], float *const out[3], int64_t at, int64_t count)
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
                u = NAME(activate)(u, activation);
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
            *(Vector *)(to + v * LANES) = total[axis][v] + NAME(affine)(t, x[0][v], x[1][v], x[2][v], activation);
        if (!whole)
            memcpy(out[axis] + at, spare[axis], (size_t)count * sizeof(float));
    }
}

TARGET INLINE void NAME(fold_tiles)(const Activation activation, const Cell *cell, const float *const in[3],
                                    float *const out[3], int64_t n)
{
    int64_t at = 0;
    for (; at + TILE <= n; at += TILE)
        NAME(fold_tile)(VECTORS, activation, cell, in, out, at, TILE);
    for (; at < n; at += LANES)
        NAME(fold_tile)(1, activation, cell, in, out, at, n - at < LANES ? n - at : LANES);
}

/* Compute the values of one cell's function at `n` points; `in` and `out` may be the same. */
TARGET static void NAME(fold_cell)(const Cell *cell, const float *const in[3], float *const out[3], int64_t n)
{
    if (cell->activation == TANH)
        NAME(fold_tiles)(TANH, cell, in, out, n);
    else
        NAME(fold_tiles)(RELU, cell, in, out, n);
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
