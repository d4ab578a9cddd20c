/* The matte of what differs from a uniform border, and sums over mattes. */

#define LEVELS 256

/* Counts and levels of the pixels in the ring: those near the sides of a picture. */
typedef struct {
    int64_t counts[BANDS][LEVELS], total, alike;
    uint8_t border[BANDS]; /* median of each band, rounded down */
    int tolerance;
} Ring;

/* Count the levels of `n` pixels. */
static inline void count_levels(Ring *ring, const uint8_t *pixels, Py_ssize_t n)
{
    ring->total += n;
    for (Py_ssize_t i = 0; i < n; i++)
        for (int band = 0; band < BANDS; band++)
            ring->counts[band][pixels[PIXEL * i + band]]++;
}

/* Count those of `n` pixels that differ from the border by the tolerance at most. */
static inline void count_alike(Ring *ring, const uint8_t *pixels, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        int is_alike = 1;
        for (int band = 0; band < BANDS; band++)
            is_alike &= abs(pixels[PIXEL * i + band] - ring->border[band]) <= ring->tolerance;
        ring->alike += is_alike;
    }
}

/* Visit the pixels within `edge` of a side, those in the corners twice. */
static inline void visit(Ring *ring, const Picture *picture, Py_ssize_t edge,
                         void (*count)(Ring *, const uint8_t *, Py_ssize_t))
{
    const Py_ssize_t row = PIXEL * picture->width, right = PIXEL * (picture->width - edge);
    for (Py_ssize_t y = 0; y < picture->height; y++) {
        const uint8_t *pixels = picture->pixels + y * row;
        if (y < edge)
            count(ring, pixels, picture->width);
        if (y >= picture->height - edge)
            count(ring, pixels, picture->width);
        count(ring, pixels, edge);
        count(ring, pixels + right, edge);
    }
}

/* Return the median of an even number of counted levels, rounded down: the mean of the two in the middle. */
static uint8_t median(const int64_t counts[LEVELS], int64_t total)
{
    int64_t below = counts[0];
    int level = 0;
    while (below < total / 2)
        below += counts[++level];
    const int low = level;
    while (below <= total / 2)
        below += counts[++level];
    return (uint8_t)((low + level) / 2);
}

/* Find the median of each band in the ring, and the share of its pixels within the tolerance of that. */
static double border_of(Ring *ring, const Picture *picture, Py_ssize_t edge)
{
    visit(ring, picture, edge, count_levels);
    for (int band = 0; band < BANDS; band++)
        ring->border[band] = median(ring->counts[band], ring->total);
    visit(ring, picture, edge, count_alike);
    return (double)ring->alike / (double)ring->total;
}

#define STRETCH 1024 /* pixels */

/* Write the matte of `n` pixels: (difference - tolerance) * 255 / softness, rounded down, from 0 to 255. */
CLONED static void ramp(const uint8_t *restrict pixels, Py_ssize_t n, const uint8_t border[BANDS], int tolerance,
                        int softness, uint8_t *restrict matte)
{
    const uint8_t bands[PIXEL] = {255, 255, 255, 0}, common[PIXEL] = {border[0], border[1], border[2], 0};
    const uint8_t least = (uint8_t)tolerance, most = (uint8_t)softness, step = (uint8_t)(LEVELS / softness);
    uint8_t ground[PIXEL * STRETCH], steps[PIXEL * STRETCH];
    uint32_t mask;
    memcpy(&mask, bands, PIXEL);
    for (Py_ssize_t i = 0; i < STRETCH; i++)
        memcpy(ground + PIXEL * i, common, PIXEL);
    for (Py_ssize_t at = 0; at < n; at += STRETCH) {
        const Py_ssize_t count = n - at < STRETCH ? n - at : STRETCH;
        const uint8_t *from = pixels + PIXEL * at;
        for (Py_ssize_t i = 0; i < PIXEL * count; i++) { /* bytes alone: most of them in a vector */
            const uint8_t high = from[i] > ground[i] ? from[i] : ground[i];
            const uint8_t low = from[i] < ground[i] ? from[i] : ground[i];
            const uint8_t distance = (uint8_t)(high - low), above = distance > least ? distance : least;
            const uint8_t ascent = (uint8_t)(above - least);
            steps[i] = ascent < most ? ascent : most;
        }
        for (Py_ssize_t i = 0; i < count; i++) { /* a pixel is a word here, whose bytes may come in any order */
            uint32_t word;
            memcpy(&word, steps + PIXEL * i, PIXEL);
            word &= mask;
            const uint32_t a = word & 255, b = word >> 8 & 255, c = word >> 16 & 255, d = word >> 24;
            const uint32_t ab = a > b ? a : b, cd = c > d ? c : d, largest = ab > cd ? ab : cd;
            matte[at + i] = (uint8_t)(largest * step - (largest > 0)); /* 255 / softness is just below 256 / softness */
        }
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
