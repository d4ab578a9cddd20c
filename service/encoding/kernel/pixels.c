/* service.encoding._pixels: what masks and framing compute for each pixel, without Python's lock.
 *
 * All results are those of NumPy and Pillow, to the last bit. Arrays are C-contiguous buffers of the types and shapes
 * that `Pixels` in compiled.py names; others are a ValueError. A picture is Pillow's own memory, by the Arrow
 * interface: nothing is copied.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdlib.h>
#include <string.h>

#include "../../mapping/kernel/arguments.h"
#include "picture.h" /* before those that use it */

#include "matte.h"
#include "square.h"

#define VERSION 2 /* of this source, as in compiled.py: raise both with each change of what it computes */
#define MOST_COLUMNS 65535
#define MOST_AWAY (1 << 24) /* pixels of the square's corner from the picture's */

/* The Arrow C data interface (https://arrow.apache.org/docs/format/CDataInterface.html), as far as it is read. */
typedef struct {
    const char *format;
} ArrowSchema;

typedef struct ArrowArray {
    int64_t length, null_count, offset, n_buffers, n_children;
    const void **buffers;
    struct ArrowArray **children;
} ArrowArray;

/* Return the pixels in a result of __arrow_c_array__, (count, PIXEL); NULL with an error. */
static const uint8_t *pixels_of(PyObject *schema_object, PyObject *array_object, Py_ssize_t count)
{
    const ArrowSchema *schema = PyCapsule_GetPointer(schema_object, "arrow_schema");
    const ArrowArray *array = schema ? PyCapsule_GetPointer(array_object, "arrow_array") : NULL;
    if (!array)
        return NULL;
    if (strcmp(schema->format, "+w:4") == 0 && array->length == count && !array->offset && array->n_children == 1) {
        const ArrowArray *bytes = array->children[0];
        if (bytes->length == PIXEL * count && !bytes->offset && bytes->n_buffers == 2 && bytes->buffers[1])
            return bytes->buffers[1];
    }
    PyErr_Format(PyExc_ValueError, "the picture does not have %zd pixels of four bytes, as the matte has", count);
    return NULL;
}

static PyObject *border_matte(PyObject *module, PyObject *arguments)
{
    PyObject *schema, *array, *matte_object;
    Buffers buffers = {.count = 0};
    Picture picture = {.height = -1, .width = -1};
    Py_ssize_t edge;
    Ring ring = {.total = 0};
    int softness, is_uniform = 0;
    double share;
    uint8_t *matte;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "(OO)niidO:border_matte", &schema, &array, &edge, &ring.tolerance, &softness,
                          &share, &matte_object))
        return NULL;
    if ((matte = TAKE(matte, "uint8", WRITE, &picture.height, &picture.width)) &&
        (picture.pixels = pixels_of(schema, array, picture.height * picture.width))) {
        if (edge < 1 || edge > picture.height || edge > picture.width)
            PyErr_Format(PyExc_ValueError, "edge is %zd; 1 to the shorter side is needed", edge);
        else if (ring.tolerance < 0 || softness < 2 || ring.tolerance >= LEVELS - softness || LEVELS % softness)
            PyErr_Format(PyExc_ValueError, "tolerance %d and softness %d make no ramp", ring.tolerance, softness);
        else {
            Py_BEGIN_ALLOW_THREADS
            is_uniform = border_of(&ring, &picture, edge) >= share;
            if (is_uniform)
                ramp(picture.pixels, picture.height * picture.width, ring.border, ring.tolerance, softness, matte);
            Py_END_ALLOW_THREADS
        }
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : PyBool_FromLong(is_uniform);
}

static PyObject *summary(PyObject *module, PyObject *arguments)
{
    PyObject *matte_object, *rows_object, *columns_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t height = -1, width = -1;
    unsigned char floor;
    int32_t *rows, *columns;
    int64_t sum = 0, squares = 0;
    const uint8_t *matte;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "ObOO:summary", &matte_object, &floor, &rows_object, &columns_object))
        return NULL;
    if ((matte = TAKE(matte, "uint8", READ, &height, &width)) && (rows = TAKE(rows, "int32", WRITE, &height)) &&
        (columns = TAKE(columns, "int32", WRITE, &width))) {
        if (width > MOST_COLUMNS) {
            release(&buffers);
            return PyErr_Format(PyExc_ValueError, "matte has %zd columns; at most %d are allowed", width, MOST_COLUMNS);
        }
        Py_BEGIN_ALLOW_THREADS
        memset(columns, 0, (size_t)width * sizeof(int32_t));
        for (Py_ssize_t y = 0; y < height; y++) {
            const Sums sums = sums_of(matte + y * width, width, floor, columns);
            rows[y] = (int32_t)sums.count;
            sum += sums.sum;
            squares += sums.squares;
        }
        Py_END_ALLOW_THREADS
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_BuildValue("LL", (long long)sum, (long long)squares);
}

static PyObject *square(PyObject *module, PyObject *arguments)
{
    PyObject *schema, *array, *matte_object, *rgba_object;
    Buffers buffers = {.count = 0};
    Picture picture = {.height = -1, .width = -1};
    Square square = {.size = -1};
    Py_ssize_t four = PIXEL;
    const uint8_t *matte;
    uint8_t *rgba;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "(OO)OnnnO:square", &schema, &array, &matte_object, &square.left, &square.top,
                          &square.side, &rgba_object))
        return NULL;
    if ((matte = TAKE(matte, "uint8", READ, &picture.height, &picture.width)) &&
        (rgba = TAKE(rgba, "uint8", WRITE, &square.size, &square.size, &four)) &&
        (picture.pixels = pixels_of(schema, array, picture.height * picture.width))) {
        if (square.size < 1 || square.side <= square.size || square.side > MOST_SUMMED * square.size)
            PyErr_Format(PyExc_ValueError, "side is %zd; more than %zd to %zd is needed", square.side, square.size,
                         MOST_SUMMED * square.size);
        else if (square.left < -MOST_AWAY || square.left > MOST_AWAY || square.top < -MOST_AWAY || square.top > MOST_AWAY)
            PyErr_Format(PyExc_ValueError, "the square's corner is more than %d pixels away", MOST_AWAY);
        else if (!allocate(&square))
            PyErr_NoMemory();
        else {
            Py_BEGIN_ALLOW_THREADS
            reduce(&square, &picture, matte, rgba);
            Py_END_ALLOW_THREADS
        }
        set_free(&square);
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

static PyObject *composite(PyObject *module, PyObject *arguments)
{
    PyObject *rgba_object, *planes_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t size = -1, four = PIXEL, bands = BANDS;
    const uint8_t *rgba;
    float *planes;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OO:over_white", &rgba_object, &planes_object))
        return NULL;
    if ((rgba = TAKE(rgba, "uint8", READ, &size, &size, &four)) &&
        (planes = TAKE(planes, "float32", WRITE, &bands, &size, &size))) {
        Py_BEGIN_ALLOW_THREADS
        over_white(rgba, size * size, planes);
        Py_END_ALLOW_THREADS
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {
    {"border_matte", border_matte, METH_VARARGS, NULL},
    {"summary", summary, METH_VARARGS, NULL},
    {"square", square, METH_VARARGS, NULL},
    {"over_white", composite, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static int add_version(PyObject *module)
{
    return PyModule_AddIntConstant(module, "VERSION", VERSION);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, add_version}, {0, NULL}};

static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, .m_name = "_pixels", .m_methods = methods, .m_slots = slots,
};

PyMODINIT_FUNC PyInit__pixels(void)
{
    return PyModuleDef_Init(&definition);
}
