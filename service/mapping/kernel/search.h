/* The search for the outermost points of an object (service/mapping/box.py), in six directions: +x, +y, +z, -x, -y, -z.
 * A value that is NaN counts as the largest, so that none is lost. */

#define DIRECTIONS 6

typedef enum { CUBE, BALL, SPHERE, DOMAINS } Domain;

static inline float height_of(const float *values, int64_t n, int64_t direction, int64_t i)
{
    const float value = values[direction % 3 * n + i];
    return direction < 3 ? value : -value;
}

/* Find the `count` outermost points of each direction, in descending order: their places and heights. */
static void find_outermost(const float *values, int64_t n, int64_t count, int64_t *places, float *heights)
{
    for (int64_t direction = 0; direction < DIRECTIONS; direction++) {
        int64_t *place = places + direction * count;
        float *height = heights + direction * count;
        for (int64_t at = 0; at < count; at++) {
            place[at] = at;
            height[at] = -INFINITY;
        }
        for (int64_t i = 0; i < n; i++) {
            const float value = height_of(values, n, direction, i);
            if (value <= height[count - 1]) /* nearly always */
                continue;
            int64_t at = count - 1;
            for (; at > 0 && !(value <= height[at - 1]) && !isnan(height[at - 1]); at--) {
                place[at] = place[at - 1];
                height[at] = height[at - 1];
            }
            if (!isnan(height[at])) {
                place[at] = i;
                height[at] = value;
            }
        }
    }
}

/* Place trials around each candidate, and those outside the domain on its border. */
static void place_trials(const float *candidates, int64_t axes, int64_t searches, const float *around, int64_t each,
                         float radius, Domain domain, float *trials)
{
    const int64_t n = searches * each;
    for (int64_t i = 0; i < n; i++) {
        float length = 0;
        for (int64_t axis = 0; axis < axes; axis++) {
            const float x = candidates[axis * searches + i / each] + radius * around[axis * each + i % each];
            trials[axis * n + i] = x;
            length += x * x;
        }
        length = sqrtf(length);
        const float limit = domain == SPHERE ? (length > 0 ? length : 1) : (length > 1 ? length : 1);
        for (int64_t axis = 0; axis < axes; axis++) {
            float *x = &trials[axis * n + i];
            *x = domain == CUBE ? fmaxf(-1, fminf(1, *x)) : *x / limit;
        }
    }
}

/* Move each candidate to its outermost trial if that is farther out. */
static void climb_to(const float *values, const float *trials, int64_t axes, int64_t searches, int64_t each,
                     float *candidates, float *reached)
{
    const int64_t n = searches * each;
    for (int64_t search = 0; search < searches; search++) {
        const int64_t direction = search / (searches / DIRECTIONS), first = search * each;
        int64_t top = first;
        for (int64_t i = first; i < first + each; i++) {
            const float height = height_of(values, n, direction, i);
            if (isnan(height))
                reached[search] = height;
            if (height > height_of(values, n, direction, top))
                top = i;
        }
        const float height = height_of(values, n, direction, top);
        if (height > reached[search]) { /* not if one is NaN */
            reached[search] = height;
            for (int64_t axis = 0; axis < axes; axis++)
                candidates[axis * searches + search] = trials[axis * n + top];
        }
    }
}

static PyObject *outermost(PyObject *module, PyObject *arguments)
{
    PyObject *values_object, *places_object, *heights_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, directions = DIRECTIONS, n = -1, count = -1;
    const float *values;
    int64_t *places;
    float *heights;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOO:outermost", &values_object, &places_object, &heights_object))
        return NULL;
    if ((values = TAKE(values, "float32", READ, &three, &n)) &&
        (places = TAKE(places, "int64", WRITE, &directions, &count)) &&
        (heights = TAKE(heights, "float32", WRITE, &directions, &count))) {
        if (count < 1 || count > n)
            PyErr_Format(PyExc_ValueError, "places for %zd points of %zd; 1 to all are needed", count, n);
        else {
            Py_BEGIN_ALLOW_THREADS
            find_outermost(values, n, count, places, heights);
            Py_END_ALLOW_THREADS
        }
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

static PyObject *spread(PyObject *module, PyObject *arguments)
{
    PyObject *candidates_object, *around_object, *trials_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t axes = -1, searches = -1, each = -1, n;
    float radius;
    int domain;
    const float *candidates, *around;
    float *trials;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOfiO:spread", &candidates_object, &around_object, &radius, &domain,
                          &trials_object))
        return NULL;
    if (domain < 0 || domain >= DOMAINS)
        return PyErr_Format(PyExc_ValueError, "domain is %d; 0 to %d is needed", domain, DOMAINS - 1);
    if ((candidates = TAKE(candidates, "float32", READ, &axes, &searches)) &&
        (around = TAKE(around, "float32", READ, &axes, &each)) && ((n = searches * each) || 1) &&
        (trials = TAKE(trials, "float32", WRITE, &axes, &n))) {
        Py_BEGIN_ALLOW_THREADS
        place_trials(candidates, axes, searches, around, each, radius, (Domain)domain, trials);
        Py_END_ALLOW_THREADS
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

static PyObject *climb(PyObject *module, PyObject *arguments)
{
    PyObject *values_object, *trials_object, *candidates_object, *reached_object;
    Buffers buffers = {.count = 0};
    Py_ssize_t three = 3, axes = -1, searches = -1, n = -1;
    const float *values, *trials;
    float *candidates, *reached;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOO:climb", &values_object, &trials_object, &candidates_object, &reached_object))
        return NULL;
    if ((values = TAKE(values, "float32", READ, &three, &n)) && (trials = TAKE(trials, "float32", READ, &axes, &n)) &&
        (candidates = TAKE(candidates, "float32", WRITE, &axes, &searches)) &&
        (reached = TAKE(reached, "float32", WRITE, &searches))) {
        if (searches < 1 || searches % DIRECTIONS || n % searches || !n)
            PyErr_Format(PyExc_ValueError, "%zd trials of %zd searches; as many for each of %d directions are needed",
                         n, searches, DIRECTIONS);
        else {
            Py_BEGIN_ALLOW_THREADS
            climb_to(values, trials, axes, searches, n / searches, candidates, reached);
            Py_END_ALLOW_THREADS
        }
    }
    release(&buffers);
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}
