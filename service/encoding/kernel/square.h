/* A square of a picture, reduced as Pillow's resize with its box filter does (Resample.c): to the last bit. */

#define MOST_SUMMED 257 /* bytes whose sum fits 16 bits */
#define PRECISION 22 /* bits of a weight's fraction */

typedef struct {
    int32_t start, count; /* of the pixels that one pixel of the result is the mean of */
    uint32_t weight;      /* 1 / count */
} Window;

static void find_windows(Py_ssize_t side, Py_ssize_t size, Window *windows)
{
    const double scale = (double)side / (double)size, support = 0.5 * scale;
    for (Py_ssize_t i = 0; i < size; i++) {
        const double center = ((double)i + 0.5) * scale;
        const int32_t low = (int32_t)(center - support + 0.5);
        int32_t high = (int32_t)(center + support + 0.5), first = 0, count = 0;
        high = high < side ? high : (int32_t)side;
        for (int32_t x = low > 0 ? low : 0; x < high; x++) {
            const double at = (x - center + 0.5) * (1.0 / scale);
            if (at > -0.5 && at <= 0.5) {
                first = count ? first : x;
                count++;
            }
        }
        windows[i] = (Window){first, count, count ? (uint32_t)(0.5 + 1.0 / count * (1 << PRECISION)) : 0};
    }
}

/* Multiply pixels by their mattes, as 16 bits for each byte; the fourth becomes the matte. */
CLONED static void premultiply(const uint8_t *restrict pixels, const uint8_t *restrict matte, Py_ssize_t n,
                               uint32_t *restrict levels, uint32_t *restrict alphas, uint16_t *restrict row)
{
    const uint8_t fourth[PIXEL] = {0, 0, 0, 255};
    const uint8_t *level = (const uint8_t *)levels, *alpha = (const uint8_t *)alphas;
    uint32_t full;
    memcpy(&full, fourth, PIXEL);
    for (Py_ssize_t i = 0; i < n; i++) {
        memcpy(&levels[i], pixels + PIXEL * i, PIXEL);
        levels[i] |= full;
        alphas[i] = matte[i] * 0x01010101u;
    }
    for (Py_ssize_t i = 0; i < PIXEL * n; i++) {
        const uint16_t product = (uint16_t)(level[i] * alpha[i] + 128);
        row[i] = (uint16_t)((uint16_t)(product + (product >> 8)) >> 8);
    }
}

/* Weight sums of 16 bits, and round them to bytes. */
CLONED static void weigh(const uint16_t *restrict sums, const uint32_t *restrict weights, Py_ssize_t n,
                         uint8_t *restrict bytes)
{
    for (Py_ssize_t i = 0; i < n; i++)
        bytes[i] = (uint8_t)((sums[i] * weights[i] + (1u << (PRECISION - 1))) >> PRECISION);
}

CLONED static void add(const uint8_t *restrict bytes, Py_ssize_t n, uint16_t *restrict sums)
{
    for (Py_ssize_t i = 0; i < n; i++)
        sums[i] = (uint16_t)(sums[i] + bytes[i]);
}

/* Divide the colors by their alpha. */
static void unpremultiply(uint8_t *pixels, Py_ssize_t n)
{
    for (uint8_t *pixel = pixels; pixel < pixels + PIXEL * n; pixel += PIXEL)
        if (pixel[3] != 0 && pixel[3] != 255)
            for (int band = 0; band < BANDS; band++) {
                const unsigned level = 255u * pixel[band] / pixel[3];
                pixel[band] = (uint8_t)(level < 255 ? level : 255);
            }
}

/* A square of a picture, and the memory that its reduction takes. */
typedef struct {
    Py_ssize_t left, top, side, size; /* of the square; the side of the result */
    Window *windows;                  /* (size,) */
    uint32_t *weights;                /* (size, PIXEL) */
    uint32_t *levels, *alphas;        /* (side,): four bytes each */
    uint64_t *row, *below;            /* (side,), (side + 1,): four times 16 bits each; a row, and sums of its start */
    uint64_t *sums;                   /* (size,) */
    uint8_t *narrow;                  /* (side, size, PIXEL): the rows, reduced */
} Square;

static int allocate(Square *square)
{
    const size_t side = (size_t)square->side, size = (size_t)square->size;
    square->windows = malloc(size * sizeof(Window));
    square->weights = malloc(size * PIXEL * sizeof(uint32_t));
    square->levels = malloc(side * sizeof(uint32_t));
    square->alphas = malloc(side * sizeof(uint32_t));
    square->row = calloc(side, sizeof(uint64_t));
    square->below = calloc(side + 1, sizeof(uint64_t));
    square->sums = malloc(size * sizeof(uint64_t));
    square->narrow = calloc(side * size, PIXEL);
    return square->windows && square->weights && square->levels && square->alphas && square->row && square->below &&
           square->sums && square->narrow;
}

static void set_free(Square *square)
{
    void *const all[] = {square->windows, square->weights, square->levels, square->alphas,
                         square->row,     square->below,   square->sums,   square->narrow};
    for (size_t i = 0; i < sizeof(all) / sizeof(all[0]); i++)
        free(all[i]);
}

/* Return how many of the last pixels of a row are transparent. */
static Py_ssize_t transparent_end(const uint8_t *matte, Py_ssize_t n)
{
    Py_ssize_t end = n;
    for (uint64_t eight; end >= (Py_ssize_t)sizeof(eight); end -= (Py_ssize_t)sizeof(eight)) {
        memcpy(&eight, matte + end - sizeof(eight), sizeof(eight));
        if (eight)
            break;
    }
    while (end && !matte[end - 1])
        end--;
    return n - end;
}

/* Return how many of the first pixels of a row are transparent. */
static Py_ssize_t transparent_start(const uint8_t *matte, Py_ssize_t n)
{
    Py_ssize_t start = 0;
    for (uint64_t eight; start + (Py_ssize_t)sizeof(eight) <= n; start += (Py_ssize_t)sizeof(eight)) {
        memcpy(&eight, matte + start, sizeof(eight));
        if (eight)
            break;
    }
    while (start < n && !matte[start])
        start++;
    return start;
}

/* Reduce a row of the square: `n` pixels from `first` on lie in the picture. `narrow` is zero, and stays so for windows
 * of transparent pixels. */
static void reduce_row(const Square *square, const uint8_t *pixels, const uint8_t *matte, Py_ssize_t first,
                       Py_ssize_t n, uint8_t *narrow)
{
    n -= transparent_end(matte, n);
    const Py_ssize_t skipped = transparent_start(matte, n), from = first + skipped, to = first + n;
    Py_ssize_t begin = 0, end = square->size; /* of the windows that the others lie in */
    if (skipped == n)
        return;
    while (begin < end && square->windows[begin].start + square->windows[begin].count <= from)
        begin++;
    while (end > begin && square->windows[end - 1].start >= to)
        end--;
    if (begin == end)
        return;
    const Window *last = &square->windows[end - 1];
    const Py_ssize_t low = square->windows[begin].start, high = last->start + last->count;
    if (low < from)
        memset(square->row + low, 0, (size_t)(from - low) * sizeof(uint64_t));
    if (high > to)
        memset(square->row + to, 0, (size_t)(high - to) * sizeof(uint64_t));
    premultiply(pixels + PIXEL * skipped, matte + skipped, n - skipped, square->levels, square->alphas,
                (uint16_t *)(square->row + from));
    uint64_t sum = square->below[low] = 0;
    for (Py_ssize_t x = low; x < high; x++)
        square->below[x + 1] = sum += square->row[x];
    for (Py_ssize_t i = begin; i < end; i++) { /* a difference has four sums, none of which overflows 16 bits */
        const Window *window = &square->windows[i];
        square->sums[i] = square->below[window->start + window->count] - square->below[window->start];
    }
    weigh((const uint16_t *)(square->sums + begin), square->weights + PIXEL * begin, PIXEL * (end - begin),
          narrow + PIXEL * begin);
}

/* Composite `n` pixels over white: planes (BANDS, n), from 0 to 1. */
CLONED static void over_white(const uint8_t *restrict rgba, Py_ssize_t n, float *restrict planes)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        const float alpha = (float)rgba[PIXEL * i + 3] / 255.0f, white = 1.0f - alpha;
        planes[i] = (float)rgba[PIXEL * i] / 255.0f * alpha + white;
        planes[n + i] = (float)rgba[PIXEL * i + 1] / 255.0f * alpha + white;
        planes[2 * n + i] = (float)rgba[PIXEL * i + 2] / 255.0f * alpha + white;
    }
}

/* Reduce the rows, then the columns; outside the picture all is transparent. */
static void reduce(const Square *square, const Picture *picture, const uint8_t *matte, uint8_t *rgba)
{
    const Py_ssize_t left = square->left > 0 ? square->left : 0, right = square->left + square->side;
    const Py_ssize_t inside = (right < picture->width ? right : picture->width) - left, width = PIXEL * square->size;
    find_windows(square->side, square->size, square->windows);
    for (Py_ssize_t i = 0; i < width; i++)
        square->weights[i] = square->windows[i / PIXEL].weight;
    for (Py_ssize_t y = 0; y < square->side; y++) {
        const Py_ssize_t at = (square->top + y) * picture->width + left;
        if (square->top + y >= 0 && square->top + y < picture->height && inside > 0)
            reduce_row(square, picture->pixels + PIXEL * at, matte + at, left - square->left, inside,
                       square->narrow + y * width);
    }
    for (Py_ssize_t i = 0; i < square->size; i++) {
        const Window *window = &square->windows[i];
        memset(square->sums, 0, (size_t)square->size * sizeof(uint64_t));
        for (int32_t y = window->start; y < window->start + window->count; y++)
            add(square->narrow + y * width, width, (uint16_t *)square->sums);
        for (Py_ssize_t x = 0; x < width; x++)
            square->weights[x] = window->weight;
        weigh((const uint16_t *)square->sums, square->weights, width, rgba + i * width);
    }
    unpremultiply(rgba, square->size * square->size);
}
