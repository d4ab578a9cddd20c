/* A picture: pixels of four bytes, of which the fourth is not read. */

#define BANDS 3
#define PIXEL 4 /* bytes */

/* A copy of a function for each instruction set; the loader takes the best one that the processor has. */
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__clang__)
#define CLONED __attribute__((target_clones("avx2", "default")))
#else
#define CLONED
#endif

typedef struct {
    const uint8_t *pixels; /* (height, width, PIXEL) */
    Py_ssize_t height, width;
} Picture;
