"""The fast forward pass: f^k of canonical points, chunk by chunk, in memory that does not grow.

Points are mapped in tiles of `tile_size` that start at absolute multiples of their size, the last one in
full; so every NumPy call sees the same shapes and the outputs are bitwise equal in any chunking, on one
machine and NumPy build.

A tile's activations fit the L2 cache: that is what makes this several times faster than `mapping.apply`
on whole arrays. OpenBLAS keeps products of about `MAX_PRODUCT` multiply-adds in the calling thread;
tiles are chosen to stay below. Networks too wide for that use its threads unless OPENBLAS_NUM_THREADS
is 1. Where numba is installed (the extra `fast`), networks of one hidden layer take `service.kernel`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np

from service import kernel
from service.canonical import BLOCK, Sampling, block, check_range
from service.errors import CorruptWeights, InvalidParameter
from service.mapping import Array, MappingSpec, layers

TILE: Final = 128  # points, a divisor of BLOCK; HOF-1's hidden layer is then 512 KiB
SMALL_TILES: Final = (64, 32)  # for wider products
MAX_PRODUCT: Final = 1_000_000  # multiply-adds of one matmul
CHUNK: Final = 65_536  # points
SCALES: Final = (1e-9, 1e9)

Draw = Callable[[int], Array]  # index of a block's first point -> its points, (d, BLOCK)


def sample(
    spec: MappingSpec,
    word: Sequence[Array],
    n: int,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    sampling: Sampling = "uniform",
    chunk: int = CHUNK,
) -> Iterator[Array]:
    """Points of the object: ``scale * word[0](word[1](... word[-1](x)))`` (paper, eq. 4 and 5).

    Parameters
    ----------
    spec : the mapping functions' common shape.
    word : spec.k thetas of (spec.size,) float32; ``[theta] * spec.k`` for an encoded object.
    n, seed, offset, sampling : as in `canonical_points`.
    scale : length of the object's longest side, in any unit.
    chunk : most points in one piece.

    Returns
    -------
    iterator of (m, 3) float32, m <= chunk, object frame, in order and n points in all.

    Raises
    ------
    InvalidParameter : an argument is out of range, or the word has not k functions.
    InvalidSpec : a theta does not fit the spec.
    CorruptWeights : while iterating: the function's values exceed float32.
    """
    check_range(n, seed, offset, sampling)
    if chunk < 1:
        raise InvalidParameter(f"chunk must be at least 1, not {chunk}", field="chunk")
    if not SCALES[0] <= scale <= SCALES[1]:
        raise InvalidParameter(f"scale must lie in {SCALES[0]:g} to {SCALES[1]:g}", field="scale")
    if len(word) != spec.k:
        raise InvalidParameter(f"the word has {len(word)} functions, {spec.name} needs {spec.k}", field="word")
    draw = partial(block, spec.domain, seed, sampling=sampling)
    return _chunks(_tile(spec, word), draw, offset, offset + n, np.float32(scale), chunk)


def bounds(chunks: Iterable[Array]) -> tuple[Array, Array]:
    """Smallest and largest coordinates, (3,) and (3,) float32, of chunks of (m, 3) points.

    Raises
    ------
    ValueError : there are no points.
    """
    extremes = [(points.min(axis=0), points.max(axis=0)) for points in chunks]
    lows, highs = zip(*extremes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def tile_size(spec: MappingSpec) -> int:
    """Points per tile: the most whose matmuls OpenBLAS computes in the calling thread, else `TILE`."""
    widest = max(n_out * (n_in + 1) for n_out, n_in in spec.shapes)
    return next((size for size in (TILE, *SMALL_TILES) if size * widest <= MAX_PRODUCT), TILE)


class _Tile:
    """The buffers of one tile and the weights of a word, packed once: `map` allocates nothing.

    Arrays are (features, size), and every one that a matrix multiplies ends in a row of ones, so that
    [W b] is one matrix and a layer one product.
    """

    def __init__(self, spec: MappingSpec, word: Sequence[Array]) -> None:
        self.size = tile_size(spec)
        self._spec = spec
        self._x = _buffer(spec.input_dim + 1, self.size, 1)
        self._output = _buffer(spec.output_dim + 1, self.size, 1)
        hidden = [_buffer(width + 1, self.size, 1) for width in spec.hidden]
        # An array of zeros, not a scalar: NumPy's maximum is twice as fast with one.
        self._zeros = _buffer(max(spec.hidden), self.size, 0)
        packed = {id(theta): _pack(spec, theta) for theta in word}
        self._steps: list[tuple[Array, Array, Array]] = []  # (matrix, input, output)
        x = self._x
        for theta in reversed(word):
            for matrix, result in zip(packed[id(theta)], [*hidden, self._output], strict=True):
                self._steps.append((matrix, x, result[:-1]))
                x = result

    def map(self, x: Array) -> Array:
        """Canonical points (input_dim, size) -> the object's, (3, size): a view that the next call overwrites."""
        self._x[:-1] = x
        last = len(self._spec.hidden)
        for index, (matrix, features, result) in enumerate(self._steps):
            np.matmul(matrix, features, out=result)
            if index % (last + 1) == last:
                continue
            if self._spec.activation == "relu":
                np.maximum(result, self._zeros[: len(result)], out=result)
            else:
                np.tanh(result, out=result)
        return self._output[:-1]


class _FusedTile:
    """As `_Tile`, by the compiled kernel."""

    size = kernel.TILE

    def __init__(self, run: kernel.Kernel, spec: MappingSpec, word: Sequence[Array]) -> None:
        self._run = run
        self._x = _buffer(spec.input_dim, self.size, 0)
        self._functions = [
            (np.array(w.T, order="C"), b.copy(), v.copy(), c.copy())
            for theta in reversed(word)
            for (w, b), (v, c) in [layers(spec, theta)]
        ]

    def map(self, x: Array) -> Array:
        """As `_Tile.map`."""
        self._x[:] = x
        for w, b, v, c in self._functions:
            self._run(w, b, v, c, self._x)
        return self._x


def _tile(spec: MappingSpec, word: Sequence[Array]) -> _Tile | _FusedTile:
    """The fastest way that is installed; the spec alone decides, so that all calls agree to the bit."""
    run = kernel.load() if kernel.fits(spec) else None
    return _FusedTile(run, spec, word) if run else _Tile(spec, word)


def _buffer(rows: int, columns: int, value: float) -> Array:
    """A filled (rows, columns) float32 array that starts on a cache line: a third faster in BLAS than one
    that does not, and the same code path in every call."""
    line = 16  # float32s in 64 bytes
    memory = np.full(rows * columns + line, value, np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + rows * columns].reshape(rows, columns)


def _pack(spec: MappingSpec, theta: Array) -> list[Array]:
    """Each layer's [W b], (out, in + 1) float32."""
    return [np.concatenate([w, b[:, None]], axis=1, dtype=np.float32) for w, b in layers(spec, theta)]


def _chunks(
    tile: _Tile | _FusedTile, draw: Draw, start: int, stop: int, scale: np.float32, chunk: int
) -> Iterator[Array]:
    """Pieces of [start, stop); they end at multiples of BLOCK where `chunk` allows: no work is done twice."""
    while start < stop:
        end = min(start + chunk, stop)
        if end < stop and end // BLOCK * BLOCK > start:
            end = end // BLOCK * BLOCK
        yield _evaluate(tile, draw, start, end, scale)
        start = end


def _evaluate(tile: _Tile | _FusedTile, draw: Draw, start: int, stop: int, scale: np.float32) -> Array:
    """The points [start, stop) of the object, (stop - start, 3) float32."""
    points = np.empty((stop - start, 3), np.float32)
    size = tile.size
    with np.errstate(over="ignore", invalid="ignore"):  # checked below, once
        for first in range(start // BLOCK * BLOCK, stop, BLOCK):
            canonical = draw(first)  # (input_dim, BLOCK)
            for at in range(max(first, start // size * size), min(first + BLOCK, stop), size):
                mapped = tile.map(canonical[:, at - first : at - first + size])
                begin, end = max(at, start), min(at + size, stop)
                points[begin - start : end - start] = mapped[:, begin - at : end - at].T
        points *= scale
    if not np.isfinite(points).all():
        raise CorruptWeights("the mapping function's values exceed float32", field="theta")
    return points
