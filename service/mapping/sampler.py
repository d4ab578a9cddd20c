"""Points of an object: canonical points, tile by tile, through the mapping function.

Networks with one hidden layer of ReLUs are folded (`service.mapping.folding`). The others run in the compiled kernel,
where a point's value depends on nothing but the point. Without the kernel they run in tiles whose activations fit the
L2 cache, which is several times faster than `mapping.apply` on whole arrays. There, every matrix product has the same
shape in every call, and tiles start at multiples of their size. So outputs are bitwise equal in any chunking, on one
machine and build of NumPy.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np

from service.errors import CorruptWeights, InvalidParameter
from service.mapping import compiled
from service.mapping.canonical import Sampling, check_range, span
from service.mapping.compiled import Kernel
from service.mapping.folding import CompiledNetwork, FoldedWord, aligned, pack_distinct, zeros
from service.mapping.frame import Frame
from service.mapping.spec import Array, MappingSpec, layers

TILES: Final = ((64, 512), (512, 256))  # hidden units up to which a tile has so many points; few points cost calls
WIDE_TILE: Final = 128  # points, for wider layers: the values of more would leave the cache, at half the speed
CHUNK: Final = 65_536  # points
SCALES: Final = (1e-9, 1e9)  # smallest and largest

Canonical = tuple[Array, int, slice]  # points (input_dim, m) in whole tiles, index of the first, the selected ones


class Sampler:
    """The points of one object. Packed once; any number of threads may use it at the same time.

    Parameters
    ----------
    spec : the mapping functions' common shape.
    word : spec.k thetas of (spec.size,) float32; ``[theta] * spec.k`` for an encoded object.
    frame : the object's box, which is centered and scaled to length 1; None for the function's own numbers.

    Attributes
    ----------
    domain : the canonical domain.

    Raises
    ------
    InvalidParameter : the word does not have k functions.
    InvalidSpec : a theta does not fit the spec.
    """

    def __init__(self, spec: MappingSpec, word: Sequence[Array], frame: Frame | None = None) -> None:
        if len(word) != spec.k:
            raise InvalidParameter(f"the word has {len(word)} functions, {spec.name} needs k = {spec.k}", field="word")
        self.domain: Final = spec.domain
        self._frame = frame
        self._function = _function(spec, word)

    def points(
        self, n: int, *, seed: int = 0, offset: int = 0, scale: float = 1.0, sampling: Sampling = "uniform"
    ) -> Array:
        """Compute points of the object: ``word[0](word[1](... word[-1](x)))`` (paper, eq. 4 and 5), framed and scaled.

        Parameters
        ----------
        n, seed, offset, sampling : as in `canonical_points`.
        scale : length of the longest side of the object's box, in any unit; without a frame, a factor.

        Returns
        -------
        (n, 3) float32, object frame; without a frame, the function's own numbers times `scale`.

        Raises
        ------
        InvalidParameter : an argument is out of range.
        CorruptWeights : the function's values exceed float32.
        """
        _check_arguments(n, seed, offset, scale, sampling)
        return self.at(self.canonical(n, seed, offset, sampling), scale)

    def canonical(self, n: int, seed: int, offset: int, sampling: Sampling) -> Canonical:
        """Draw canonical points as `points` does, padded to whole tiles: input for `at` of any sampler of the spec."""
        align = self._function.align
        first = offset // align * align
        x = span(self.domain, seed, first, -(-(offset + n) // align) * align, sampling)
        return x, first, slice(offset - first, offset - first + n)

    def map(self, x: Array, scale: float = 1.0) -> Array:
        """Compute the object's points for any canonical points: (n, input_dim) float32 -> (n, 3).

        Raises
        ------
        CorruptWeights : the function's values exceed float32.
        """
        return self.at(self.pad(x), scale)

    def pad(self, x: Array) -> Canonical:
        """Pad any canonical points, (n, input_dim), to whole tiles: input for `at` of any sampler of the spec."""
        n, align = len(x), self._function.align
        whole = np.zeros((x.shape[1], -(-n // align) * align), np.float32)
        whole[:, :n] = x.T
        return whole, 0, slice(n)

    def at(self, canonical: Canonical, scale: float = 1.0) -> Array:
        """Compute the object's points at the selected canonical points, (n, 3). Raises CorruptWeights."""
        x, first, selected = canonical
        with np.errstate(over="ignore", invalid="ignore"):  # checked below, once
            mapped = self._function.map(x, first)[:, selected]
            if self._frame:
                mapped -= self._frame.center[:, None]
            factor = self._frame.factor(scale) if self._frame else np.float32(scale)
            points: Array = np.multiply(mapped.T, factor, order="C")
        if not np.isfinite(points).all():
            raise CorruptWeights("the mapping function's values exceed float32", field="theta")
        return points


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
    """Return the points of `Sampler.points` in order, in chunks of at most `chunk` points, (m, 3) float32.

    Raises
    ------
    InvalidParameter, InvalidSpec : at once, as `Sampler` and `Sampler.points`.
    CorruptWeights : while iterating.
    """
    if chunk < 1:
        raise InvalidParameter(f"chunk is {chunk}, it must be at least 1", field="chunk")
    _check_arguments(n, seed, offset, scale, sampling)
    sampler, stop = Sampler(spec, word), offset + n
    return (
        sampler.points(min(chunk, stop - start), seed=seed, offset=start, scale=scale, sampling=sampling)
        for start in range(offset, stop, chunk)
    )


def hold_blas_to_one_thread() -> None:
    """Limit BLAS to one thread in the whole process; a service calls this once.

    Tiles are too small to share between threads, and each request runs on a thread of its own.
    """
    from threadpoolctl import threadpool_limits  # training machines read specs and lack it

    threadpool_limits(1, user_api="blas")


def _check_arguments(n: int, seed: int, offset: int, scale: float, sampling: Sampling) -> None:
    check_range(n, seed, offset, sampling)
    if not SCALES[0] <= scale <= SCALES[1]:
        raise InvalidParameter(f"scale is {scale:g}, it must lie in {SCALES[0]:g} to {SCALES[1]:g}", field="scale")


def _function(spec: MappingSpec, word: Sequence[Array]) -> "FoldedWord | _Compiled | _Tiles":
    """Return the fastest way to compute a word's values on this machine."""
    if spec.is_one_relu_layer:
        return FoldedWord(spec, word)
    kernel = compiled.load()
    return _Compiled(spec, word, kernel) if kernel else _Tiles(spec, word)


class _Compiled:
    """Word of any networks, evaluated by the compiled kernel."""

    align: Final = 1

    def __init__(self, spec: MappingSpec, word: Sequence[Array], kernel: Kernel) -> None:
        self._functions = pack_distinct(partial(CompiledNetwork, spec, kernel=kernel), word[::-1])

    def map(self, x: Array, _: int) -> Array:
        """Map canonical points, (input_dim, n), to the object's points, (3, n)."""
        for function in self._functions:
            x = function.map(x)
        return x


class _Tiles:
    """Word of any networks, packed once, evaluated by NumPy.

    [W b] is one matrix, and every array it multiplies ends in a row of ones, so that a layer is one product.
    """

    def __init__(self, spec: MappingSpec, word: Sequence[Array]) -> None:
        self._spec = spec
        self.align: Final = next((tile for width, tile in TILES if max(spec.hidden) <= width), WIDE_TILE)
        self._functions = pack_distinct(partial(_pack, spec), word[::-1])

    def map(self, x: Array, _: int) -> Array:
        """Map canonical points, (input_dim, n) with n a multiple of `align`, to the object's points, (3, n)."""
        tile = self.align
        inputs, output = _above_ones(self._spec.input_dim, tile), _above_ones(self._spec.output_dim, tile)
        hidden = [_above_ones(width, tile) for width in self._spec.hidden]
        floor = zeros(max(self._spec.hidden) * tile).reshape(-1, tile)
        y = np.empty((self._spec.output_dim, x.shape[1]), np.float32)
        for at in range(0, x.shape[1], tile):
            inputs[:-1] = x[:, at : at + tile]
            source = inputs
            for matrices in self._functions:
                for matrix, result in zip(matrices, [*hidden, output], strict=True):
                    np.matmul(matrix, source, out=result[:-1])
                    if result is not output and self._spec.activation == "relu":
                        np.maximum(result[:-1], floor[: len(result) - 1], out=result[:-1])
                    elif result is not output:
                        np.tanh(result[:-1], out=result[:-1])
                    source = result
            y[:, at : at + tile] = output[:-1]
        return y


def _above_ones(rows: int, tile: int) -> Array:
    """Return memory for the values of a tile, with a row of ones below them: (rows + 1, tile)."""
    array = aligned((rows + 1) * tile).reshape(rows + 1, tile)
    array[-1] = 1
    return array


def _pack(spec: MappingSpec, theta: Array) -> list[Array]:
    """Return [W b] of each layer, (out, in + 1) float32."""
    return [np.concatenate([w, b[:, None]], axis=1, dtype=np.float32) for w, b in layers(spec, theta)]
