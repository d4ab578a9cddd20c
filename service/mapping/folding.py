"""Networks with one hidden layer of ReLUs, folded: exact, and several times less work for many points.

A hidden unit bends the network along one plane. In a cell of space that the plane does not cross, the unit is either
linear or zero. All such units of a cell add up to one affine map, and only the units whose planes cross the cell are
left to compute: about 38% of HOF-1's on a grid of 4 x 4 x 4 cells, 20% on 8 x 8 x 8. Outside the grid the network is
whole. A point's result depends on its cell alone, never on the points that are computed with it.
"""

from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import Final, Self, TypeVar

import numpy as np
import numpy.typing as npt

from service.mapping import compiled
from service.mapping.canonical import canonical_points
from service.mapping.compiled import ROW, Kernel
from service.mapping.spec import Array, MappingSpec, layers

TILES: Final = (256, 128)  # points of one product, for up to `WIDE` units and for more: 512 KiB fit the L2 cache
WIDE: Final = 512  # units
FROM: Final = 16_384  # index of the first point that is folded: folding pays off for many points only
SHARED: Final = TILES[1] * 1_024  # zeros: those of a tile of HOF-1
PROBE: Final = 1_024  # points that are sampled to bound a function's values
MARGIN: Final = 1e-4  # of a cell: rounding may put a point near a border on either side

Cells = npt.NDArray[np.int32]
Corner = npt.NDArray[np.float64]
Packed = TypeVar("Packed")


class Fold:
    """One function x -> V relu(W x + b) + c over a box, cut into cells.

    Parameters
    ----------
    spec, theta : the function; `spec.is_one_relu_layer`.
    low, high : (3,) corners of the box.
    grid : cells per side; 0 leaves the network whole everywhere.
    kernel : cuts the cells in place of NumPy.

    Attributes
    ----------
    first : (h, 4) float32, [W b]; second : (3, h) float32, V.
    origin, per_unit : (3,) float32, the box's low corner, and cells per unit of length.
    affine : (grid ** 3 + 1, 3, 4) float32, [A a] of each cell; the last cell is everything outside the box.
    crossing : (grid ** 3 + 1, h) bool, the units whose planes cross each cell.
    """

    @np.errstate(over="ignore", invalid="ignore")  # the sampler checks the points
    def __init__(
        self, spec: MappingSpec, theta: Array, low: Corner, high: Corner, grid: int, kernel: Kernel | None = None
    ) -> None:
        (w, b), (self.second, c) = layers(spec, theta)
        self.first = np.concatenate([w, b[:, None]], axis=1)
        self.grid = grid
        step = (high - low) / max(grid, 1)
        self.origin, self.per_unit = low.astype(np.float32), (1 / step).astype(np.float32)
        self.affine = np.zeros((grid**3 + 1, 3, 4), np.float32)
        self.crossing = np.ones((grid**3 + 1, len(b)), np.bool_)
        if grid:
            self._cut(low, step, kernel)
        self.affine[:, :, 3] += c

    def _cut(self, low: Corner, step: Corner, kernel: Kernel | None) -> None:
        """Find the linear units of each cell, and add them up."""
        if kernel:
            second, side, half = np.ascontiguousarray(self.second), step.astype(np.float32), (0.5 + MARGIN) * step
            sides = self.origin, side, half.astype(np.float32)
            kernel.cut(self.first, second, self.grid, *sides, self.affine, self.crossing)
            return
        w, b = self.first[:, :3], self.first[:, 3]
        centers = low + step * (np.indices((self.grid,) * 3).reshape(3, -1).T + 0.5)
        at = centers.astype(np.float32) @ w.T + b  # value of each unit in the middle of each cell
        reach = (0.5 + MARGIN) * np.abs(w) @ step.astype(np.float32)  # the most that it changes within the cell
        linear = at > reach
        # A unit that is linear adds the product of its column of V and its row of [W b].
        outer = (self.second.T[:, :, None] * self.first[:, None]).reshape(-1, 12)
        self.affine[:-1] = (linear.astype(np.float32) @ outer).reshape(-1, 3, 4)
        self.crossing[:-1] = ~(linear | (at < -reach))  # NaN too

    def cells(self, x: Array) -> Cells:
        """Return the cell of each point: (3, n) -> (n,)."""
        cell, outside = np.zeros(x.shape[1], np.int32), np.zeros(x.shape[1], np.bool_)
        for row, origin, per_unit in zip(x, self.origin, self.per_unit, strict=True):
            steps = (row - origin) * per_unit
            outside |= ~((steps >= 0) & (steps < self.grid))  # NaN too
            cell *= self.grid
            cell += steps.astype(np.int32)
        cell[outside] = self.grid**3
        return cell


class NumpyFold:
    """A fold, evaluated by NumPy: one cell after another, in tiles of one width."""

    GRID: Final = 4

    def __init__(self, fold: Fold) -> None:
        self._fold = fold
        self._packed: dict[int, tuple[Array, Array]] = {}

    @classmethod
    def whole(cls, spec: MappingSpec, theta: Array) -> Self:
        """Return a network that is not cut."""
        box = np.ones(3)
        return cls(Fold(spec, theta, -box, box, 0))

    def map(self, x: Array) -> Array:
        """Compute the fold's values at points: (3, n) float32 -> (3, n)."""
        scratch = _Scratch(self._fold.second.shape[1])
        if not self._fold.grid:  # one cell: nothing to sort
            y = x.copy()
            scratch.map(*self._matrices(0), y)
            return y
        cells = self._fold.cells(x)
        order = np.argsort(cells.astype(np.uint8), kind="stable")  # by radix
        points = np.take(x, order, axis=1)
        ends = np.cumsum(np.bincount(cells, minlength=self._fold.grid**3 + 1))
        begin = 0
        for cell, end in enumerate(ends):
            if end > begin:
                scratch.map(*self._matrices(cell), points[:, begin:end])
                begin = end
        y = np.empty_like(x)
        for row, ordered in zip(y, points, strict=True):
            row[order] = ordered
        return y

    def _matrices(self, cell: int) -> tuple[Array, Array]:
        """Return [W b] and [V A a] of the units that cross a cell: (m, 4) and (3, m + 4)."""
        if cell not in self._packed:
            first, second = self._fold.first, self._fold.second
            if self._fold.grid:  # else all units cross the only cell
                units = self._fold.crossing[cell]
                first, second = first[units], second[:, units]
            self._packed[cell] = first, np.concatenate([second, self._fold.affine[cell]], axis=1)
        return self._packed[cell]


class _Scratch:
    """Memory for one tile, reused by all tiles."""

    def __init__(self, units: int) -> None:
        size = max(TILES[1] * units, TILES[0] * min(units, WIDE))
        self._joined = aligned(size + 4 * TILES[0])
        self._zeros = zeros(size)
        self._output = aligned(3 * TILES[0])

    def map(self, first: Array, second: Array, x: Array) -> None:
        """Overwrite points of one cell, (3, n), with the function's values there."""
        units = len(first)
        tile = TILES[units > WIDE]
        joined = self._joined[: (units + 4) * tile].reshape(-1, tile)  # hidden units, then (x, y, z, 1) for [A a]
        hidden, inputs = joined[:units], joined[units:]
        zeros, output = self._zeros[: units * tile].reshape(-1, tile), self._output[: 3 * tile].reshape(3, tile)
        inputs[3] = 1
        for at in range(0, x.shape[1], tile):
            part = x[:, at : at + tile]
            inputs[:3, : part.shape[1]] = part
            inputs[:3, part.shape[1] :] = 0
            np.matmul(first, inputs, out=hidden)
            np.maximum(hidden, zeros, out=hidden)
            np.matmul(second, joined, out=output)
            part[:] = output[:, : part.shape[1]]


class CompiledNetwork:
    """A whole network, evaluated by the compiled kernel from theta as it is: nothing is packed for a few points."""

    def __init__(self, spec: MappingSpec, theta: Array, kernel: Kernel) -> None:
        layers(spec, theta)  # checks theta
        self._theta, self._kernel = np.ascontiguousarray(theta, np.float32), kernel
        self._widths = np.array([spec.input_dim, *spec.hidden, spec.output_dim])
        self._is_tanh = spec.activation == "tanh"

    def map(self, x: Array) -> Array:
        """Compute the network's values at points: (input_dim, n) float32 -> (3, n)."""
        y = np.empty((3, x.shape[1]), np.float32)
        self._kernel.network(np.ascontiguousarray(x), self._theta, self._widths, self._is_tanh, y)
        return y


class CompiledFold:
    """A fold, evaluated by the compiled kernel."""

    GRID: Final = 6

    def __init__(self, fold: Fold, kernel: Kernel) -> None:
        self._fold, self._kernel = fold, kernel
        self._starts = np.empty(len(fold.crossing) + 1, np.int64)
        self._units = np.empty((np.count_nonzero(fold.crossing), ROW), np.float32)
        kernel.pack(fold.crossing, np.concatenate([fold.first, fold.second.T], axis=1), self._starts, self._units)

    def map(self, x: Array) -> Array:
        """Compute the fold's values at points: (3, n) float32 -> (3, n)."""
        fold, y = self._fold, np.empty(x.shape, np.float32)
        self._kernel.map(
            np.ascontiguousarray(x), fold.origin, fold.per_unit, fold.grid, self._starts, self._units, fold.affine, y
        )
        return y


Engine = NumpyFold | CompiledFold | CompiledNetwork


class FoldedWord:
    """A word of functions with one hidden layer of ReLUs.

    Points with an index below `FROM` are computed by the whole networks: cutting the networks costs about as much as
    these points. The choice depends on a point's index alone.
    """

    align: Final = 1

    def __init__(self, spec: MappingSpec, word: Sequence[Array]) -> None:
        self._spec = spec
        self._thetas = word[::-1]  # as applied
        kernel = compiled.load()
        self._engine: type[NumpyFold | CompiledFold] = CompiledFold if kernel else NumpyFold
        self._make = partial(CompiledFold, kernel=kernel) if kernel else NumpyFold
        make = partial(CompiledNetwork, kernel=kernel) if kernel else NumpyFold.whole
        self._whole: list[Engine] = pack_distinct(partial(make, spec), self._thetas)

    def map(self, x: Array, first: int) -> Array:
        """Map canonical points from index `first` on, (3, n) with n > 0, to the object's points, (3, n)."""
        whole = FROM - first
        if whole <= 0:
            return through(self._folded, x)
        if whole >= x.shape[1]:
            return through(self._whole, x)
        return np.concatenate([through(self._whole, x[:, :whole]), through(self._folded, x[:, whole:])], axis=1)

    @cached_property
    def _folded(self) -> list[Engine]:
        """Fold each function over the bounding box of its inputs: the domain, then the previous function's values."""
        high = np.full(3, 1 + MARGIN)
        low, folded = -high, list[Engine]()
        points = canonical_points(self._spec.domain, PROBE).T
        for theta, whole in zip(self._thetas, self._whole, strict=True):
            is_bounded = np.isfinite(high - low).all()
            folded.append(self._make(Fold(self._spec, theta, low, high, self._engine.GRID)) if is_bounded else whole)
            points = whole.map(np.ascontiguousarray(points))
            low, high = points.min(axis=1).astype(np.float64), points.max(axis=1).astype(np.float64)
            low, high = low - MARGIN - 0.02 * (high - low), high + MARGIN + 0.02 * (high - low)
        return folded


def through(functions: Sequence[Engine], x: Array) -> Array:
    """Apply functions one after the other, the first one first."""
    for function in functions:
        x = function.map(x)
    return x


def pack_distinct(pack: Callable[[Array], Packed], thetas: Sequence[Array]) -> list[Packed]:
    """Pack every theta of a word; a theta that the word repeats is packed once."""
    packed = {key: pack(theta) for key, theta in {id(theta): theta for theta in thetas}.items()}
    return [packed[id(theta)] for theta in thetas]


def zeros(size: int) -> Array:
    """Return zeros to read: NumPy's maximum is twice as fast with an array as with a scalar."""
    return _shared_zeros()[:size] if size <= SHARED else buffer(1, size, 0)[0]


@cache
def _shared_zeros() -> Array:
    """Return the zeros that all tiles of usual networks share: filling them takes as long as 300 points of HOF-1."""
    array: Array = buffer(1, SHARED, 0)[0]
    array.flags.writeable = False
    return array


def buffer(rows: int, columns: int, value: float) -> Array:
    """Return a (rows, columns) float32 array, filled, that starts on a cache line."""
    array = aligned(rows * columns).reshape(rows, columns)
    array.fill(value)
    return array


def aligned(size: int) -> Array:
    """Return a float32 array of any values that starts on a cache line.

    BLAS is a third faster on such arrays, and takes the same code path in every call.
    """
    line = 16  # float32s in 64 bytes
    memory = np.empty(size + line, np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + size]
