/* Values of networks with any layers at many points, for one instruction set. kernel.c includes this file after points.h,
 * with the same macros and
 *
 *   ROWS      outputs of a layer that are summed at a time: their sums stay in registers
 *
 * The values of a tile's points are (width, TILE), and go from layer to layer within the core's cache. Weights are read
 * as theta has them. A point's value depends on nothing but the point, as in points.h.
 */

/* Compute `rows` outputs of a layer, whose rows of W and elements of b begin at `w` and `b`. */
TARGET INLINE void NAME(add_rows)(const int rows, const float *w, const float *b, int64_t inputs, const float *x,
                                  float *y, Activation activation)
{
    for (int64_t start = 0; start < inputs; start += LONG_BLOCK) {
        const int64_t stop = start + LONG_BLOCK < inputs ? start + LONG_BLOCK : inputs;
        Vector sum[ROWS][VECTORS] = {{{0}}};
        for (int64_t i = start; i < stop; i++)
            for (int row = 0; row < rows; row++)
                for (int v = 0; v < VECTORS; v++)
                    sum[row][v] += w[row * inputs + i] * *(const Vector *)(x + i * TILE + v * LANES);
        for (int row = 0; row < rows; row++)
            for (int v = 0; v < VECTORS; v++) {
                Vector *to = (Vector *)(y + row * TILE + v * LANES);
                const Vector total = start ? *to + sum[row][v] : b[row] + sum[row][v];
                *to = stop < inputs ? total : NAME(activate)(total, activation);
            }
    }
}

/* Compute one layer for one tile: x (inputs, TILE) -> y (outputs, TILE). */
TARGET static void NAME(map_layer)(const float *w, int64_t inputs, int64_t outputs, const float *x, float *y,
                                   Activation activation)
{
    const float *b = w + inputs * outputs;
    int64_t row = 0;
    for (; row + ROWS <= outputs; row += ROWS)
        NAME(add_rows)(ROWS, w + row * inputs, b + row, inputs, x, y + row * TILE, activation);
    for (; row + 3 <= outputs; row += 3)
        NAME(add_rows)(3, w + row * inputs, b + row, inputs, x, y + row * TILE, activation);
    for (; row < outputs; row++)
        NAME(add_rows)(1, w + row * inputs, b + row, inputs, x, y + row * TILE, activation);
}

/* Compute the values of a network at `n` points; `from` and `to` have room for a tile of its widest layer. */
TARGET static void NAME(map_layers)(const Network *network, const float *x, int64_t n, float *y, float *from, float *to)
{
    for (int64_t at = 0; at < n; at += TILE) {
        const size_t bytes = (size_t)(n - at < TILE ? n - at : TILE) * sizeof(float);
        const float *w = network->theta;
        for (int64_t i = 0; i < network->widths[0]; i++)
            memcpy(from + i * TILE, x + i * n + at, bytes);
        for (int64_t layer = 0; layer < network->layers; layer++) {
            const int64_t inputs = network->widths[layer], outputs = network->widths[layer + 1];
            NAME(map_layer)(w, inputs, outputs, from, to, layer + 1 < network->layers ? network->activation : NONE);
            w += (inputs + 1) * outputs;
            float *next = from;
            from = to;
            to = next;
        }
        for (int64_t i = 0; i < network->widths[network->layers]; i++)
            memcpy(y + i * n + at, from + i * TILE, bytes);
    }
}

#undef Vector
#undef TILE
#undef NAME
#undef TARGET
#undef LANES
#undef MAX
#undef MIN
#undef ROWS
