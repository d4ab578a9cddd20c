/* Values of whole networks, with the code of an instruction set. */

/* Compute a network of three inputs, one hidden layer and three outputs, whose values are never stored; false without
 * memory. */
static int map_one_layer(const Set *set, const Network *network, const float *x, int64_t n, float *y)
{
    const int64_t h = network->widths[1];
    const float *b = network->theta + 3 * h, *v = b + h, *c = v + 3 * h;
    const float affine[12] = {0, 0, 0, c[0], 0, 0, 0, c[1], 0, 0, 0, c[2]};
    float *packed = malloc((size_t)(ROW * h + 1) * sizeof(float));
    if (packed) {
        for (int64_t i = 0; i < h; i++) {
            float *unit = packed + ROW * i;
            memcpy(unit, network->theta + 3 * i, 3 * sizeof(float));
            unit[3] = b[i];
            for (int axis = 0; axis < 3; axis++)
                unit[4 + axis] = v[axis * h + i];
        }
        const Cell cell = {network->activation, packed, h, affine};
        set->fold_cell(&cell, (const float *const[]){x, x + n, x + 2 * n}, (float *const[]){y, y + n, y + 2 * n}, n);
    }
    free(packed);
    return packed != NULL;
}

/* Compute a network of any layers; false without memory. */
static int map_network(const Set *set, const Network *network, const float *x, int64_t n, float *y)
{
    const int64_t *widths = network->widths, line = 64 / sizeof(float);
    int64_t widest = 0;
    if (network->layers == 2 && widths[0] == 3 && widths[2] == 3)
        return map_one_layer(set, network, x, n, y);
    for (int64_t i = 0; i <= network->layers; i++)
        widest = widths[i] > widest ? widths[i] : widest;
    const int64_t size = widest * LARGEST_TILE; /* of the values of a tile */
    float *memory = calloc((size_t)(2 * size + line), sizeof(float));
    if (memory) {
        float *from = memory + (line - (int64_t)((uintptr_t)memory / sizeof(float)) % line) % line;
        set->map_layers(network, x, n, y, from, from + size);
    }
    free(memory);
    return memory != NULL;
}
