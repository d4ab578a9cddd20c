/* Functions with one hidden layer of ReLUs, cut into cells (service/mapping/folding.py). */

#include <stdint.h>

#define ROW 7     /* floats of a packed unit: its row of [W b], its column of V */
#define OUTER 12  /* numbers of an affine map, (3, 4) */
#define BLOCK 64  /* units of one partial sum: long sums of float32 lose digits */
#define LONG_BLOCK 256 /* the same, of layers.h */
#define LARGEST_TILE 32 /* points */

typedef enum { NONE, RELU, TANH } Activation;

/* A cell's function: V relu(W x + b) over the units that cross the cell, plus an affine map. Tanh is for whole networks. */
typedef struct {
    Activation activation;
    const float *packed; /* (units, ROW) */
    int64_t units;
    const float *affine; /* (3, 4) */
} Cell;

typedef struct {
    int32_t grid;                  /* cells per side; 0: one cell, everywhere */
    const float *origin, *per_unit; /* (3,): the low corner of the box, cells per unit of length */
    const int64_t *starts;         /* (grid ** 3 + 2,): first unit of each cell */
    const float *packed, *affine;
    Activation activation;
} Fold;

/* A network to be cut, unit after unit. */
typedef struct {
    int64_t padded, apart; /* units, with zeros behind the last one; floats from column to column */
    const float *columns;  /* (5 + OUTER, apart), as in cut.h */
} Cut;

/* A network: theta has W (outputs, inputs) and b (outputs) of each layer, first to last. */
typedef struct {
    const float *theta;
    const int64_t *widths; /* (layers + 1,): inputs, hidden layers, outputs */
    int64_t layers;
    Activation activation; /* after each hidden layer */
} Network;
