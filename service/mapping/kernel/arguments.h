/* Arguments of a function in C: arrays that are checked, and held until release(). */

#define MOST_BUFFERS 8

typedef struct {
    Py_buffer views[MOST_BUFFERS];
    int count;
} Buffers;

typedef enum { READ = 0, WRITE = PyBUF_WRITABLE } Access;

static void release(Buffers *buffers)
{
    while (buffers->count)
        PyBuffer_Release(&buffers->views[--buffers->count]);
}

static int is_of_type(const Py_buffer *view, const char *type)
{
    const char *format = view->format ? view->format : "B";
    if (strcmp(type, "int64") == 0)
        return view->itemsize == 8 && (strcmp(format, "l") == 0 || strcmp(format, "q") == 0);
    if (strcmp(type, "int32") == 0)
        return view->itemsize == 4 && (strcmp(format, "i") == 0 || strcmp(format, "l") == 0);
    if (strcmp(type, "bool") == 0)
        return strcmp(format, "?") == 0;
    if (strcmp(type, "uint8") == 0)
        return strcmp(format, "B") == 0;
    return strcmp(format, "f") == 0; /* float32 */
}

/* Return an array's memory, or NULL with ValueError. `shape` has a pointer for each dimension: to the length that it
 * must have, or to -1, which becomes the length that it has. */
static void *take(Buffers *buffers, PyObject *array, const char *name, const char *type, Access access, int dimensions,
                  Py_ssize_t *const *shape)
{
    Py_buffer *view = &buffers->views[buffers->count];
    if (PyObject_GetBuffer(array, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | access) < 0) {
        PyErr_Clear();
        PyErr_Format(PyExc_ValueError, "%s is not a C-contiguous%s array", name, access == WRITE ? ", writable" : "");
        return NULL;
    }
    buffers->count++;
    if (!is_of_type(view, type) || view->ndim != dimensions) {
        PyErr_Format(PyExc_ValueError, "%s has %d dimensions of format '%s'; %d of %s are needed", name, view->ndim,
                     view->format ? view->format : "B", dimensions, type);
        return NULL;
    }
    for (int i = 0; i < dimensions; i++) {
        if (*shape[i] < 0)
            *shape[i] = view->shape[i];
        if (*shape[i] != view->shape[i]) {
            PyErr_Format(PyExc_ValueError, "%s has length %zd in dimension %d; %zd is needed", name, view->shape[i], i,
                         *shape[i]);
            return NULL;
        }
    }
    return view->buf;
}

#define SHAPE(...) (Py_ssize_t *const[]){__VA_ARGS__}
#define LENGTHS(...) (sizeof(SHAPE(__VA_ARGS__)) / sizeof(Py_ssize_t *))
#define TAKE(array, type, access, ...) \
    take(&buffers, array##_object, #array, type, access, (int)LENGTHS(__VA_ARGS__), SHAPE(__VA_ARGS__))
