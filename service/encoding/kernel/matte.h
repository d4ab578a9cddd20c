/* The matte of what differs from a uniform border, and sums over mattes. */

#define LEVELS 256

/* Return how often a pixel counts: once for each side that it lies within `edge` of. */
static inline int times_in_ring(const Picture *picture, Py_ssize_t edge, Py_ssize_t y, Py_ssize_t x)
{
    return (y < edge) + (y >= picture->height - edge) + (x < edge) + (x >= picture->width - edge);
}

/* Return the column after `x` that may lie in the ring, in row `y`. */
static inline Py_ssize_t next_in_ring(const Picture *picture, Py_ssize_t edge, Py_ssize_t y, Py_ssize_t x)
{
    const int is_inner_row = y >= edge && y < picture->height - edge;
    const Py_ssize_t right = picture->width - edge;
    return is_inner_row && x + 1 >= edge && x + 1 < right ? right : x + 1;
}

/* Return the largest difference of a band to the border's. */
static inline uint8_t difference(const uint8_t *pixel, const uint8_t *border)
{
    uint8_t largest = 0;
    for (int band = 0; band < BANDS; band++) {
        const uint8_t a = pixel[band], b = border[band], distance = (uint8_t)(a > b ? a - b : b - a);
        largest = distance > largest ? distance : largest;
    }
    return largest;
}

/* Find the median of each band in the ring, rounded down, and the share of the ring within `tolerance` of it. */
static double border_of(const Picture *picture, Py_ssize_t edge, int tolerance, uint8_t border[BANDS])
{
    int64_t counts[BANDS][LEVELS] = {{0}}, total = 0, alike = 0;
    for (Py_ssize_t y = 0; y < picture->height; y++)
        for (Py_ssize_t x = 0; x < picture->width; x = next_in_ring(picture, edge, y, x)) {
            const int times = times_in_ring(picture, edge, y, x);
            total += times;
            for (int band = 0; band < BANDS; band++)
                counts[band][picture->pixels[PIXEL * (y * picture->width + x) + band]] += times;
        }
    for (int band = 0; band < BANDS; band++) {
        int64_t below = 0; /* the number is even: the median is the mean of two levels */
        int level = 0, low;
        while ((below += counts[band][level]) < total / 2)
            level++;
        low = level;
        while (below <= total / 2)
            below += counts[band][++level];
        border[band] = (uint8_t)((low + level) / 2);
    }
    for (Py_ssize_t y = 0; y < picture->height; y++)
        for (Py_ssize_t x = 0; x < picture->width; x = next_in_ring(picture, edge, y, x))
            if (difference(picture->pixels + PIXEL * (y * picture->width + x), border) <= tolerance)
                alike += times_in_ring(picture, edge, y, x);
    return (double)alike / (double)total;
}

/* Write the matte of `n` pixels: (difference - tolerance) * 255 / softness, rounded down, from 0 to 255. */
CLONED static void ramp(const uint8_t *restrict pixels, Py_ssize_t n, const uint8_t border[BANDS], int tolerance,
                        int softness, uint8_t *restrict matte)
{
    const uint8_t bands[PIXEL] = {255, 255, 255, 0}, common[PIXEL] = {border[0], border[1], border[2], 0};
    const int32_t step = LEVELS / softness;
    uint32_t mask, ground;
    memcpy(&mask, bands, PIXEL); /* pixels are whole words here, which vectors load fast, in any order of the bytes */
    memcpy(&ground, common, PIXEL);
    for (Py_ssize_t i = 0; i < n; i++) {
        uint32_t pixel;
        int32_t steps = 0;
        memcpy(&pixel, pixels + PIXEL * i, PIXEL);
        pixel &= mask;
        for (int shift = 0; shift < 32; shift += 8) {
            const int32_t distance = abs((int32_t)(pixel >> shift & 255) - (int32_t)(ground >> shift & 255));
            steps = distance > steps ? distance : steps;
        }
        steps = steps > tolerance ? steps - tolerance : 0;
        steps = steps < softness ? steps : softness;
        matte[i] = (uint8_t)(steps * step - (steps > 0)); /* 255 / softness is just below 256 / softness */
    }
}

typedef struct {
    uint32_t count, sum, squares;
} Sums;

/* Sum one row, and add its pixels above the floor to the counts of the columns. */
CLONED static Sums sums_of(const uint8_t *restrict matte, Py_ssize_t width, uint8_t floor, int32_t *restrict columns)
{
    uint32_t count = 0, sum = 0, squares = 0; /* those of 65,535 pixels fit */
    for (Py_ssize_t x = 0; x < width; x++) {
        const uint32_t value = matte[x], is_above = value > floor;
        count += is_above;
        sum += value;
        squares += value * value;
        columns[x] += (int32_t)is_above;
    }
    return (Sums){count, sum, squares};
}
