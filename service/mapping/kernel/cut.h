/* Cutting a network with one hidden layer of ReLUs into cells, and packing their units (service/mapping/folding.py). */

#define COLUMNS (5 + OUTER)
#define LINE 16 /* floats of a cache line */

/* Write each unit's numbers as columns: W (3), b, the most that its value changes within half a cell, and the products
 * of its column of V and its row of [W b] (OUTER). */
static void write_columns(const float *restrict first, const float *restrict second, const float half[3], int64_t h,
                          int64_t apart, float *columns)
{
    const float *x = columns, *y = columns + apart, *z = columns + 2 * apart;
    float *reach = columns + 4 * apart;
    for (int axis = 0; axis < 4; axis++)
        for (int64_t unit = 0; unit < h; unit++)
            columns[axis * apart + unit] = first[4 * unit + axis];
    for (int64_t unit = 0; unit < h; unit++)
        reach[unit] = fabsf(x[unit]) * half[0] + fabsf(y[unit]) * half[1] + fabsf(z[unit]) * half[2];
    for (int t = 0; t < OUTER; t++)
        for (int64_t unit = 0; unit < h; unit++)
            columns[(5 + t) * apart + unit] = second[t / 4 * h + unit] * columns[t % 4 * apart + unit];
}

/* Cut all cells; false without memory. */
static int cut_cells(const Set *set, int32_t grid, const float *first, const float *second, const float low[3],
                     const float step[3], const float half[3], int64_t h, float *affine, uint8_t *crossing)
{
    const int64_t padded = (h + LARGEST_TILE - 1) / LARGEST_TILE * LARGEST_TILE;
    const int64_t apart = padded + LINE; /* a power of two would put all columns into the same few lines of the cache */
    float *columns = aligned_alloc(64, (size_t)(COLUMNS * apart) * sizeof(float));
    int32_t *flags = aligned_alloc(64, (size_t)padded * sizeof(int32_t));
    if (columns && flags) {
        memset(columns, 0, (size_t)(COLUMNS * apart) * sizeof(float));
        write_columns(first, second, half, h, apart, columns);
        const Cut cut = {padded, apart, columns};
        for (int32_t i = 0; i < grid * grid * grid; i++) {
            const int32_t place[3] = {i / (grid * grid), i / grid % grid, i % grid};
            float center[3];
            for (int axis = 0; axis < 3; axis++)
                center[axis] = low[axis] + step[axis] * ((float)place[axis] + 0.5f);
            set->cut_cell(&cut, center, affine + OUTER * i, flags);
            for (int64_t unit = 0; unit < h; unit++)
                crossing[h * i + unit] = flags[unit] == 0;
        }
    }
    const int enough = columns && flags;
    free(columns);
    free(flags);
    return enough;
}

static PyObject *cut(PyObject *module, PyObject *arguments)
{
    PyObject *first_object, *second_object, *low_object, *step_object, *half_object, *affine_object, *crossing_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, four = 4, h = -1, cells;
    int grid, index = best_set(), enough = 1;
    const float *first, *second, *low, *step, *half;
    float *affine;
    uint8_t *crossing;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOiOOOOO|i:cut", &first_object, &second_object, &grid, &low_object, &step_object,
                          &half_object, &affine_object, &crossing_object, &index) ||
        !is_set(index))
        return NULL;
    if (grid < 0 || grid > MOST_CELLS_A_SIDE)
        return PyErr_Format(PyExc_ValueError, "grid is %d; 0 to %d is needed", grid, MOST_CELLS_A_SIDE);
    cells = (Py_ssize_t)grid * grid * grid + 1;
    if ((first = TAKE(first, "float32", READ, &h, &four)) && (second = TAKE(second, "float32", READ, &three, &h)) &&
        (low = TAKE(low, "float32", READ, &three)) && (step = TAKE(step, "float32", READ, &three)) &&
        (half = TAKE(half, "float32", READ, &three)) &&
        (affine = TAKE(affine, "float32", WRITE, &cells, &three, &four)) &&
        (crossing = TAKE(crossing, "bool", WRITE, &cells, &h))) {
        Py_BEGIN_ALLOW_THREADS
        enough = cut_cells(&sets[index], grid, first, second, low, step, half, h, affine, crossing);
        Py_END_ALLOW_THREADS
    }
    release(&buffers);
    if (!enough)
        return PyErr_NoMemory();
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

/* Write each cell's units one after another, and where each cell's begin; return the units in all. */
static int64_t pack_units(const uint8_t *crossing, Py_ssize_t cells, Py_ssize_t h, const float *units, int64_t *starts,
                          float *packed, Py_ssize_t room)
{
    int64_t count = 0;
    for (Py_ssize_t cell = 0; cell < cells; cell++) {
        starts[cell] = count;
        for (Py_ssize_t unit = 0; unit < h; unit++) {
            if (count < room) /* overwritten next if the unit does not cross the cell */
                memcpy(packed + ROW * count, units + ROW * unit, ROW * sizeof(float));
            count += crossing[cell * h + unit] != 0;
        }
    }
    starts[cells] = count;
    return count;
}

static PyObject *pack(PyObject *module, PyObject *arguments)
{
    PyObject *crossing_object, *units_object, *starts_object, *packed_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t cells = -1, h = -1, row = ROW, ends, room = -1;
    const uint8_t *crossing;
    const float *units;
    int64_t *starts, count = -1;
    float *packed;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOO:pack", &crossing_object, &units_object, &starts_object, &packed_object))
        return NULL;
    if ((crossing = TAKE(crossing, "bool", READ, &cells, &h)) && (ends = cells + 1) &&
        (units = TAKE(units, "float32", READ, &h, &row)) && (starts = TAKE(starts, "int64", WRITE, &ends)) &&
        (packed = TAKE(packed, "float32", WRITE, &room, &row))) {
        Py_BEGIN_ALLOW_THREADS
        count = pack_units(crossing, cells, h, units, starts, packed, room);
        Py_END_ALLOW_THREADS
        if (count != room)
            PyErr_Format(PyExc_ValueError, "packed has %zd rows; %lld are needed", room, (long long)count);
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}
