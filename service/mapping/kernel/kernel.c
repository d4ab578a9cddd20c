/* service.mapping._kernel: what the sampler computes for each point, without Python's lock.
 *
 * Arrays are C-contiguous buffers of the types and shapes that `Kernel` in compiled.py names; others are a ValueError. Each
 * call takes the best instruction set that the processor has, or another one that it is told.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments.h"
#include "kernel.h"

#define INLINE static inline __attribute__((always_inline))
#define MOST_CELLS_A_SIDE 256
#define WIDEST 65536
#define VERSION 4 /* of this source, as in compiled.py: raise both with each change of what it computes */

#include "sets.h"
#include "network.h"
#include "philox.h"

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

static Cell cell_of(const Fold *fold, int64_t index)
{
    const int64_t start = fold->starts[index];
    return (Cell){fold->activation, fold->packed + ROW * start, fold->starts[index + 1] - start,
                  fold->affine + 12 * index};
}

/* Copy the points to `sorted`, cell by cell. `place` has the cell of each point, which becomes its place in `sorted`.
 * `ends` is zero at first, and becomes the end of each cell's points. */
static void sort_points(const float *x, int64_t n, int64_t cells, int32_t *place, int64_t *ends, float *sorted)
{
    int64_t begin = 0;
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
    int32_t *place = malloc((size_t)(n + 1) * sizeof(int32_t));
    int64_t *ends = calloc((size_t)cells, sizeof(int64_t)), begin = 0;
    const int enough = sorted && place && ends;
    if (enough) {
        set->find_cells(fold, x, n, place);
        sort_points(x, n, cells, place, ends, sorted);
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

#include "cut.h"
#include "search.h"

static PyObject *map(PyObject *module, PyObject *arguments)
{
    PyObject *x_object, *origin_object, *per_unit_object, *starts_object, *packed_object, *affine_object, *y_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, four = 4, n = -1, row = ROW, units = -1, cells, ends;
    int index = best_set(), enough = 1;
    Fold fold = {.grid = 0, .activation = RELU};
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

/* Return the numbers of a network's theta, or -1 with ValueError. */
static Py_ssize_t size_of(const int64_t *widths, Py_ssize_t count)
{
    Py_ssize_t size = 0;
    int are_right = count >= 2;
    for (Py_ssize_t i = 0; i < count; i++)
        are_right &= widths[i] >= 1 && widths[i] <= WIDEST;
    if (!are_right) {
        PyErr_Format(PyExc_ValueError, "widths are not two or more of 1 to %d", WIDEST);
        return -1;
    }
    for (Py_ssize_t i = 1; i < count && size <= INT32_MAX; i++)
        size += (widths[i - 1] + 1) * widths[i];
    if (size <= INT32_MAX)
        return size;
    PyErr_Format(PyExc_ValueError, "widths make a network of more than %d numbers", INT32_MAX);
    return -1;
}

static PyObject *network(PyObject *module, PyObject *arguments)
{
    PyObject *x_object, *theta_object, *widths_object, *y_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t n = -1, size, ends = -1, inputs, outputs;
    int index = best_set(), enough = 1, is_tanh;
    const float *x;
    const int64_t *widths;
    Network network;
    float *y;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOpO|i:network", &x_object, &theta_object, &widths_object, &is_tanh, &y_object,
                          &index) ||
        !is_set(index))
        return NULL;
    if ((widths = TAKE(widths, "int64", READ, &ends)) && (size = size_of(widths, ends)) >= 0) {
        inputs = widths[0];
        outputs = widths[ends - 1];
        if ((x = TAKE(x, "float32", READ, &inputs, &n)) && (network.theta = TAKE(theta, "float32", READ, &size)) &&
            (y = TAKE(y, "float32", WRITE, &outputs, &n))) {
            network.widths = widths;
            network.layers = ends - 1;
            network.activation = is_tanh ? TANH : RELU;
            Py_BEGIN_ALLOW_THREADS
            enough = map_network(&sets[index], &network, x, n, y);
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
    {"cut", cut, METH_VARARGS, NULL},
    {"pack", pack, METH_VARARGS, NULL},
    {"outermost", outermost, METH_VARARGS, NULL},
    {"spread", spread, METH_VARARGS, NULL},
    {"climb", climb, METH_VARARGS, NULL},
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
