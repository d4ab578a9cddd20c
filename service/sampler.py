"""Canonical points and the fast forward pass: f^k(X), chunk by chunk, in memory that does not grow.

Points are counter-based: point i of a seed is the same whether it is drawn alone, as one of a million
or from an offset. They are made in blocks of `BLOCK` points and mapped in tiles of `tile_size` points
that both start at absolute multiples of their size, the last one in full; so every NumPy call sees the
same shapes and the outputs are bitwise equal in any chunking, on one machine and NumPy build.

A tile's activations fit the L2 cache: that is what makes this several times faster than `mapping.apply`
on whole arrays. OpenBLAS keeps products of about `MAX_PRODUCT` multiply-adds in the calling thread;
tiles are chosen to stay below. Networks too wide for that use its threads unless OPENBLAS_NUM_THREADS
is 1.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from service.errors import CorruptWeights, InvalidParameter
from service.mapping import DOMAIN_DIMS, Array, Domain, MappingSpec, layers

TILE: Final = 128  # points; HOF-1's hidden layer is then 512 KiB
SMALL_TILES: Final = (64, 32)  # for wider products
MAX_PRODUCT: Final = 1_000_000  # multiply-adds of one matmul
BLOCK: Final = 4096  # points; a multiple of every tile
CHUNK: Final = 65_536  # points
MAX_SEED: Final = 2**64 - 1
MAX_INDEX: Final = 2**63  # of a point
SCALES: Final = (1e-9, 1e9)


def canonical_points(domain: Domain, n: int, seed: int = 0, offset: int = 0) -> Array:
    """Points `offset` to `offset + n` of the seed's uniform sample of a canonical domain.

    Parameters
    ----------
    domain : the canonical set X (paper, section 3.1 and the comparison of canonical sets in its appendix).
    n : how many points, at least 1.
    seed : 0 to 2**64 - 1.
    offset : index of the first point.

    Returns
    -------
    (n, d) float32, d = `DOMAIN_DIMS[domain]`; ball, sphere and ball4 of radius 1, the cube [-1, 1]^3.

    Raises
    ------
    InvalidParameter : n, seed or offset is out of range.
    """
    _check_range(n, seed, offset)
    stop = offset + n
    points = np.empty((n, DOMAIN_DIMS[domain]), np.float32)
    for first in range(offset // BLOCK * BLOCK, stop, BLOCK):
        begin, end = max(first, offset), min(first + BLOCK, stop)
        points[begin - offset : end - offset] = _block(domain, seed, first)[:, begin - first : end - first].T
    return points


def sample(
    spec: MappingSpec,
    word: Sequence[Array],
    n: int,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    chunk: int = CHUNK,
) -> Iterator[Array]:
    """Points of the object: ``scale * word[0](word[1](... word[-1](x)))`` (paper, eq. 4 and 5).

    Parameters
    ----------
    spec : the mapping functions' common shape.
    word : spec.k thetas of (spec.size,) float32; ``[theta] * spec.k`` for an encoded object.
    n, seed, offset : as in `canonical_points`.
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
    _check_range(n, seed, offset)
    if chunk < 1:
        raise InvalidParameter(f"chunk must be at least 1, not {chunk}", field="chunk")
    if not SCALES[0] <= scale <= SCALES[1]:
        raise InvalidParameter(f"scale must lie in {SCALES[0]:g} to {SCALES[1]:g}", field="scale")
    if len(word) != spec.k:
        raise InvalidParameter(f"the word has {len(word)} functions, {spec.name} needs {spec.k}", field="word")
    return _chunks(_Tile(spec, word), seed, offset, offset + n, np.float32(scale), chunk)


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
    """The buffers of one tile and the weights of a word, packed once: `run` maps `points` to `output`.

    Arrays are (features, size), and every one that a matrix multiplies ends in a row of ones, so that
    [W b] is one matrix and a layer one product. `run` allocates nothing.
    """

    def __init__(self, spec: MappingSpec, word: Sequence[Array]) -> None:
        self.spec = spec
        self.size = tile_size(spec)
        self.points = _buffer(spec.input_dim + 1, self.size, 1)
        self.output = _buffer(spec.output_dim + 1, self.size, 1)
        hidden = [_buffer(width + 1, self.size, 1) for width in spec.hidden]
        # An array of zeros, not a scalar: NumPy's maximum is twice as fast with one.
        self._zeros = _buffer(max(spec.hidden), self.size, 0)
        packed = {id(theta): _pack(spec, theta) for theta in word}
        self._steps: list[tuple[Array, Array, Array]] = []  # (matrix, input, output)
        x = self.points
        for theta in reversed(word):
            for matrix, result in zip(packed[id(theta)], [*hidden, self.output], strict=True):
                self._steps.append((matrix, x, result[:-1]))
                x = result

    def run(self) -> None:
        """Map `points` (input_dim, size) to `output` (3, size); both have a last row of ones besides."""
        last = len(self.spec.hidden)
        for index, (matrix, x, result) in enumerate(self._steps):
            np.matmul(matrix, x, out=result)
            if index % (last + 1) == last:
                continue
            if self.spec.activation == "relu":
                np.maximum(result, self._zeros[: len(result)], out=result)
            else:
                np.tanh(result, out=result)


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


def _chunks(tile: _Tile, seed: int, start: int, stop: int, scale: np.float32, chunk: int) -> Iterator[Array]:
    """Pieces of [start, stop); they end at multiples of BLOCK where `chunk` allows: no work is done twice."""
    while start < stop:
        end = min(start + chunk, stop)
        if end < stop and end // BLOCK * BLOCK > start:
            end = end // BLOCK * BLOCK
        yield _evaluate(tile, seed, start, end, scale)
        start = end


def _evaluate(tile: _Tile, seed: int, start: int, stop: int, scale: np.float32) -> Array:
    """The points [start, stop) of the object, (stop - start, 3) float32."""
    points = np.empty((stop - start, tile.spec.output_dim), np.float32)
    size = tile.size
    with np.errstate(over="ignore", invalid="ignore"):  # checked below, once
        for first in range(start // BLOCK * BLOCK, stop, BLOCK):
            block = _block(tile.spec.domain, seed, first)  # (d, BLOCK)
            for at in range(max(first, start // size * size), min(first + BLOCK, stop), size):
                tile.points[:-1] = block[:, at - first : at - first + size]
                tile.run()
                begin, end = max(at, start), min(at + size, stop)
                points[begin - start : end - start] = tile.output[:-1, begin - at : end - at].T
        points *= scale
    if not np.isfinite(points).all():
        raise CorruptWeights("the mapping function's values exceed float32", field="theta")
    return points


def _block(domain: Domain, seed: int, first: int) -> Array:
    """Canonical points [first, first + BLOCK), `first` a multiple of BLOCK: (d, BLOCK) float32."""
    u = _uniform(seed, first)
    if domain == "cube":
        return 2 * u[:3] - 1
    radius: Array  # u ** (1 / d): uniform in volume
    if domain == "ball4":
        radius = np.sqrt(np.sqrt(u[0]))
        return radius * _direction4(u[1], u[2], u[3])
    radius = np.ones_like(u[0]) if domain == "sphere" else np.cbrt(u[0])
    return radius * _direction3(u[1], u[2])


def _uniform(seed: int, first: int) -> Array:
    """Four uniform numbers in [0, 1) for each of BLOCK points from `first` on: (4, BLOCK) float32.

    NumPy's Philox 4x64, keyed by the seed: one step of its counter makes two points.
    """
    raw = np.random.Philox(key=seed, counter=first // 2).random_raw(2 * BLOCK)
    words: npt.NDArray[np.uint32] = raw.astype("<u8", copy=False).view("<u4").reshape(BLOCK, 4)
    u: Array = (words >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)  # 24 bits: what float32 holds
    return np.ascontiguousarray(u.T)


def _direction3(u: Array, v: Array) -> Array:
    """Uniform on the sphere S^2, (3, BLOCK): cos(polar angle) = 1 - 2u, azimuth = 2 pi v."""
    azimuth = np.float32(2 * math.pi) * v
    radius = 2 * np.sqrt(u * (1 - u))  # the polar angle's sine
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), 1 - 2 * u])


def _direction4(u: Array, v: Array, w: Array) -> Array:
    """Uniform on the sphere S^3, (4, BLOCK) (Shoemake, "Uniform random rotations", Graphics Gems III)."""
    a, b = np.float32(2 * math.pi) * v, np.float32(2 * math.pi) * w
    near, far = np.sqrt(1 - u), np.sqrt(u)
    return np.stack([near * np.sin(a), near * np.cos(a), far * np.sin(b), far * np.cos(b)])


def _check_range(n: int, seed: int, offset: int) -> None:
    if n < 1:
        raise InvalidParameter(f"n must be at least 1, not {n}", field="n")
    if not 0 <= seed <= MAX_SEED:
        raise InvalidParameter("seed must lie in 0 to 2**64 - 1", field="seed")
    if not 0 <= offset <= MAX_INDEX - n:
        raise InvalidParameter("offset must lie in 0 to 2**63 - n", field="offset")
