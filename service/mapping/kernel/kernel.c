/* service.mapping._kernel: what the sampler computes for each point, without Python's lock.
 *
 * Arrays are C-contiguous buffers of the types and shapes that `Kernel` in compiled.py names; others are a ValueError. Each
 * call takes the best instruction set that the processor has, or another one that it is told.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdlib.h>
#include <string.h>

#include "arguments.h"
#include "kernel.h"

#define INLINE static inline __attribute__((always_inline))
#define MOST_CELLS_A_SIDE 256
#define VERSION 1 /* of this source, as in compiled.py: raise both with each change of what it computes */

#if defined(__x86_64__)
#include <immintrin.h>

/* maxps returns its second operand if one of the two is NaN. */
#define NAME(f) f##_avx512
#define TARGET __attribute__((target("avx512f,avx512vl,avx512dq,avx512bw,fma")))
#define LANES 16
#define VECTORS 2
#define RELU(u) _mm512_max_ps(_mm512_setzero_ps(), u)
#include "points.h"

#define NAME(f) f##_avx2
#define TARGET __attribute__((target("avx2,fma")))
#define LANES 8
#define RELU(u) _mm256_max_ps(_mm256_setzero_ps(), u)
#include "points.h"

#define NAME(f) f##_sse2
#define TARGET
#define LANES 4
#define RELU(u) _mm_max_ps(_mm_setzero_ps(), u)
#include "points.h"

#define SETS 3
#else

typedef int32_t Bits __attribute__((vector_size(16)));

#define NAME(f) f##_plain
#define TARGET
#define LANES 4
#define VECTORS 4
#define RELU(u) (vector_plain)((Bits)(u) & ~(Bits)((u) < 0))
#include "points.h"

#define SETS 1
#endif

typedef struct {
    const char *name;
    void (*fold_cell)(const Cell *, const float *const[3], float *const[3], int64_t);
    void (*find_cells)(const Fold *, const float *, int64_t, int32_t *);
    void (*restore)(const int32_t *, const float *, int64_t, float *);
} Set;

#define SET(text, suffix) {text, fold_cell_##suffix, find_cells_##suffix, restore_##suffix}

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

/* Philox 4x64-10: Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011). */
static void philox(const uint64_t key, const uint64_t counter, uint64_t word[4])
{
    const uint64_t a = 0xD2E7470EE14C6C93, b = 0xCA5A826395121157;
    uint64_t k0 = key, k1 = 0;
    word[0] = counter;
    word[1] = word[2] = word[3] = 0;
    for (int round = 0; round < 10; round++) {
        const unsigned __int128 ax = (unsigned __int128)a * word[0], by = (unsigned __int128)b * word[2];
        const uint64_t first = (uint64_t)(by >> 64) ^ word[1] ^ k0, third = (uint64_t)(ax >> 64) ^ word[3] ^ k1;
        word[0] = first;
        word[1] = (uint64_t)by;
        word[2] = third;
        word[3] = (uint64_t)ax;
        k0 += 0x9E3779B97F4A7C15;
        k1 += 0xBB67AE8584CAA73B;
    }
}

/* Two of a step's four words give a point, a number per half: its upper 24 bits, which float32 represents exactly. */
static void draw(uint64_t key, uint64_t counter, Py_ssize_t n, float *u)
{
    for (Py_ssize_t step = 0; step < n / 2; step++) {
        uint64_t word[4];
        philox(key, counter + (uint64_t)step + 1, word);
        for (int i = 0; i < 4; i++) {
            float *to = u + 2 * (i % 2) * n + 2 * step + i / 2;
            to[0] = (float)(int32_t)((uint32_t)word[i] >> 8) * 0x1p-24f;
            to[n] = (float)(int32_t)(word[i] >> 40) * 0x1p-24f;
        }
    }
}

static PyObject *uniform(PyObject *module, PyObject *arguments)
{
    unsigned long long key, counter;
    PyObject *u_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t rows = 4, n = -1;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "KKO:uniform", &key, &counter, &u_object))
        return NULL;
    float *u = TAKE(u, "float32", WRITE, &rows, &n);
    if (u && n % 2)
        u = (PyErr_Format(PyExc_ValueError, "u has %zd columns; an even number is needed", n), NULL);
    if (u) {
        Py_BEGIN_ALLOW_THREADS
        draw(key, counter, n, u);
        Py_END_ALLOW_THREADS
    }
    release(&buffers);
    return u ? Py_NewRef(Py_None) : NULL;
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

static Cell cell_of(const Fold *fold, int64_t index)
{
    const int64_t start = fold->starts[index];
    return (Cell){fold->packed + ROW * start, fold->starts[index + 1] - start, fold->affine + 12 * index};
}

/* Sort the points by their cells, compute cell by cell, and bring the values back; false without memory. */
static int map_points(const Set *set, const Fold *fold, const float *x, int64_t n, float *y)
{
    const int64_t cells = (int64_t)fold->grid * fold->grid * fold->grid + 1;
    if (cells == 1) {
        const Cell cell = cell_of(fold, 0);
        set->fold_cell(&cell, (const float *const[]){x, x + n, x + 2 * n}, (float *const[]){y, y + n, y + 2 * n}, n);
        return 1;
    }
    float *sorted = malloc((size_t)(3 * n + 1) * sizeof(float));
    int32_t *place = malloc((size_t)(n + 1) * sizeof(int32_t)); /* cell of each point, then its place in `sorted` */
    int64_t *ends = calloc((size_t)cells, sizeof(int64_t)), begin = 0;
    const int enough = sorted && place && ends;
    if (enough) {
        set->find_cells(fold, x, n, place);
        for (int64_t i = 0; i < n; i++)
            ends[place[i]]++;
        for (int64_t cell = 0; cell < cells; cell++) {
            const int64_t count = ends[cell];
            ends[cell] = begin;
            begin += count;
        }
        for (int64_t i = 0; i < n; i++) {
            const int64_t to = ends[place[i]]++;
            place[i] = (int32_t)to;
            sorted[to] = x[i];
            sorted[n + to] = x[n + i];
            sorted[2 * n + to] = x[2 * n + i];
        }
        begin = 0;
        for (int64_t index = 0; index < cells; begin = ends[index++]) {
            const Cell cell = cell_of(fold, index);
            float *const points[3] = {sorted + begin, sorted + n + begin, sorted + 2 * n + begin};
            set->fold_cell(&cell, (const float *const *)points, points, ends[index] - begin);
        }
        for (int axis = 0; axis < 3; axis++)
            set->restore(place, sorted + axis * n, n, y + axis * n);
    }
    free(sorted);
    free(place);
    free(ends);
    return enough;
}

/* Return whether the processor has an instruction set; if not, with ValueError. */
static int is_set(int index)
{
    if (index >= best_set() && index < SETS)
        return 1;
    PyErr_Format(PyExc_ValueError, "there is no instruction set %d on this processor", index);
    return 0;
}

/* Return whether each cell's units lie within the packed ones. */
static int are_starts(const int64_t *starts, Py_ssize_t cells, Py_ssize_t units)
{
    for (Py_ssize_t cell = 0; cell < cells; cell++)
        if (starts[cell] < 0 || starts[cell] > starts[cell + 1])
            return 0;
    return starts[cells] <= units;
}

static PyObject *map(PyObject *module, PyObject *arguments)
{
    PyObject *x_object, *origin_object, *per_unit_object, *starts_object, *packed_object, *affine_object, *y_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, four = 4, n = -1, row = ROW, units = -1, cells, ends;
    int index = best_set(), enough = 1;
    Fold fold = {.grid = 0};
    const float *x;
    float *y;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOiOOOO|i:map", &x_object, &origin_object, &per_unit_object, &fold.grid,
                          &starts_object, &packed_object, &affine_object, &y_object, &index) ||
        !is_set(index))
        return NULL;
    if (fold.grid < 0 || fold.grid > MOST_CELLS_A_SIDE)
        return PyErr_Format(PyExc_ValueError, "grid is %d; 0 to %d is needed", (int)fold.grid, MOST_CELLS_A_SIDE);
    cells = (Py_ssize_t)fold.grid * fold.grid * fold.grid + 1;
    ends = cells + 1;
    if ((x = TAKE(x, "float32", READ, &three, &n)) && (fold.origin = TAKE(origin, "float32", READ, &three)) &&
        (fold.per_unit = TAKE(per_unit, "float32", READ, &three)) &&
        (fold.starts = TAKE(starts, "int64", READ, &ends)) &&
        (fold.packed = TAKE(packed, "float32", READ, &units, &row)) &&
        (fold.affine = TAKE(affine, "float32", READ, &cells, &three, &four)) &&
        (y = TAKE(y, "float32", WRITE, &three, &n))) {
        if (n > INT32_MAX)
            PyErr_Format(PyExc_ValueError, "x has %zd points; at most %d are allowed", n, INT32_MAX);
        else if (!are_starts(fold.starts, cells, units))
            PyErr_Format(PyExc_ValueError, "starts do not ascend from 0 to the %zd units", units);
        else {
            Py_BEGIN_ALLOW_THREADS
            enough = map_points(&sets[index], &fold, x, n, y);
            Py_END_ALLOW_THREADS
        }
    }
    release(&buffers);
    if (!enough)
        return PyErr_NoMemory();
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

/* Compute a whole network from theta, which is W (h, 3), b (h), V (3, h) and c (3); false without memory. */
static int map_network(const Set *set, const float *theta, int64_t h, const float *x, int64_t n, float *y)
{
    const float *b = theta + 3 * h, *v = b + h, *c = v + 3 * h;
    const float affine[12] = {0, 0, 0, c[0], 0, 0, 0, c[1], 0, 0, 0, c[2]};
    float *packed = malloc((size_t)(ROW * h + 1) * sizeof(float));
    if (packed) {
        for (int64_t i = 0; i < h; i++) {
            float *unit = packed + ROW * i;
            memcpy(unit, theta + 3 * i, 3 * sizeof(float));
            unit[3] = b[i];
            for (int axis = 0; axis < 3; axis++)
                unit[4 + axis] = v[axis * h + i];
        }
        const int64_t starts[2] = {0, h};
        const Fold fold = {.grid = 0, .starts = starts, .packed = packed, .affine = affine};
        map_points(set, &fold, x, n, y); /* one cell takes no memory */
    }
    free(packed);
    return packed != NULL;
}

static PyObject *network(PyObject *module, PyObject *arguments)
{
    PyObject *x_object, *theta_object, *y_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, n = -1, size = -1;
    int index = best_set(), enough = 1;
    const float *x, *theta;
    float *y;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOO|i:network", &x_object, &theta_object, &y_object, &index) || !is_set(index))
        return NULL;
    if ((x = TAKE(x, "float32", READ, &three, &n)) && (theta = TAKE(theta, "float32", READ, &size)) &&
        (y = TAKE(y, "float32", WRITE, &three, &n))) {
        if (size < 3 || (size - 3) % ROW)
            PyErr_Format(PyExc_ValueError, "theta has %zd numbers; a multiple of 7, and 3, is needed", size);
        else {
            Py_BEGIN_ALLOW_THREADS
            enough = map_network(&sets[index], theta, (size - 3) / ROW, x, n, y);
            Py_END_ALLOW_THREADS
        }
    }
    release(&buffers);
    if (!enough)
        return PyErr_NoMemory();
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {
    {"uniform", uniform, METH_VARARGS, NULL},
    {"pack", pack, METH_VARARGS, NULL},
    {"network", network, METH_VARARGS, NULL},
    {"map", map, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

/* Add VERSION, and SETS: the names of the processor's instruction sets by their index, best first. */
static int add_constants(PyObject *module)
{
    PyObject *names = PyDict_New();
    int failed = !names;
    for (int i = best_set(); !failed && i < SETS; i++) {
        PyObject *index = PyLong_FromLong(i);
        failed = !index || PyDict_SetItemString(names, sets[i].name, index) < 0;
        Py_XDECREF(index);
    }
    failed = failed || PyModule_AddObjectRef(module, "SETS", names) < 0 ||
             PyModule_AddIntConstant(module, "VERSION", VERSION) < 0;
    Py_XDECREF(names);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, add_constants}, {0, NULL}};

static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, .m_name = "_kernel", .m_methods = methods, .m_slots = slots,
};

PyMODINIT_FUNC PyInit__kernel(void)
{
    return PyModuleDef_Init(&definition);
}
