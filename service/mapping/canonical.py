"""Canonical points: uniform samples of the canonical domain X, drawn by counter.

Point i of a seed is the same whether it is drawn alone, as one of a million or from an offset. NumPy is
always called with whole vectors that start at multiples of `ALIGN`, so a point's bits never depend on the
points drawn with it.

Each point starts as four numbers in [0, 1): either independent (NumPy's Philox, keyed by the seed), or from
a Sobol sequence, which covers the domain more evenly.
"""

import functools
import math
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from service.errors import InvalidParameter
from service.mapping import compiled
from service.mapping.spec import DOMAIN_DIMS, Array, Domain

Sampling = Literal["uniform", "sobol"]

BLOCK: Final = 4096  # points drawn at a time: they fit the L2 cache; a power of two
ALIGN: Final = 64  # points; a multiple of the vector width of every processor
MAX_SEED: Final = 2**64 - 1
MAX_INDEX: Final[dict[Sampling, int]] = {"uniform": 2**63, "sobol": 2**32}  # end of the index range
_LANES: Final = 4
_BITS: Final = 32
# Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections" (2008), table
# new-joe-kuo-6, dimensions 2 to 4: coefficients of the primitive polynomial, first direction numbers.
_POLYNOMIALS: Final = ((0, (1,)), (1, (1, 3)), (1, (1, 3, 1)))


def canonical_points(domain: Domain, n: int, seed: int = 0, offset: int = 0, sampling: Sampling = "uniform") -> Array:
    """Draw points `offset` to `offset + n` of the seed's uniform sample of a canonical domain.

    Parameters
    ----------
    domain : the canonical set X (paper, section 3.1; its appendix compares canonical sets).
    n : number of points, at least 1.
    seed : 0 to 2**64 - 1.
    offset : index of the first point.
    sampling : `uniform` for independent points; `sobol` for a Sobol sequence with a random digital shift.

    Returns
    -------
    (n, d) float32 with d = `DOMAIN_DIMS[domain]`. Ball, sphere and ball4 have radius 1; the cube is [-1, 1]^3.

    Raises
    ------
    InvalidParameter : n, seed or offset is out of range.
    """
    check_range(n, seed, offset, sampling)
    return np.ascontiguousarray(span(domain, seed, offset, offset + n, sampling).T)


def check_range(n: int, seed: int, offset: int, sampling: Sampling = "uniform") -> None:
    """Raise InvalidParameter if n, seed or offset is outside the range of `canonical_points`."""
    if n < 1:
        raise InvalidParameter(f"n is {n}, it must be at least 1", field="n")
    if not 0 <= seed <= MAX_SEED:
        raise InvalidParameter(f"seed is {seed}, it must lie in 0 to 2**64 - 1", field="seed")
    if not 0 <= offset <= MAX_INDEX[sampling] - n:
        limit = MAX_INDEX[sampling].bit_length() - 1
        detail = f"offset is {offset}, it must lie in 0 to 2**{limit} - n with {sampling} sampling"
        raise InvalidParameter(detail, field="offset")


def span(domain: Domain, seed: int, start: int, stop: int, sampling: Sampling = "uniform") -> Array:
    """Draw canonical points [start, stop), (d, stop - start) float32. The arguments must have passed `check_range`."""
    points = np.empty((DOMAIN_DIMS[domain], stop - start), np.float32)
    for first in range(start // BLOCK * BLOCK, stop, BLOCK):
        low = max(first, start) // ALIGN * ALIGN
        high = -(-min(first + BLOCK, stop) // ALIGN) * ALIGN
        begin, end = max(low, start), min(high, stop)
        u = _uniform(seed, low, high) if sampling == "uniform" else _sobol(seed, low, high)
        points[:, begin - start : end - start] = _place(domain, u)[:, begin - low : end - low]
    return points


def _place(domain: Domain, u: Array) -> Array:
    """Turn four numbers in [0, 1) for each point, (4, n), into points of the domain, (d, n)."""
    if domain == "cube":
        return 2 * u[:3] - 1
    radius: Array  # u ** (1 / d): uniform in volume
    if domain == "ball4":
        radius = np.sqrt(np.sqrt(u[0]))
        return radius * _direction4(u[1], u[2], u[3])
    direction = _direction3(u[1], u[2])
    if domain == "ball":
        direction *= np.cbrt(u[0])
    return direction


def _uniform(seed: int, low: int, high: int) -> Array:
    """Draw four uniform numbers in [0, 1) for each of the points [low, high): (4, high - low) float32.

    The generator is NumPy's Philox 4x64, keyed by the seed; one step of its counter gives two points.
    """
    kernel = compiled.load()
    if kernel is not None:
        u = np.empty((_LANES, high - low), np.float32)
        kernel.uniform(seed, low // 2, u)
        return u
    raw = np.random.Philox(key=seed, counter=low // 2).random_raw(2 * (high - low))
    words: npt.NDArray[np.uint32] = raw.astype("<u8", copy=False).view("<u4").reshape(-1, _LANES)
    return _unit(words.T)


def _sobol(seed: int, low: int, high: int) -> Array:
    """Return elements [low, high), within one block, of the four-dimensional Sobol sequence: (4, high - low) float32.

    The sequence is in Gray code order: element i is the exclusive or of the direction numbers of the bits of
    i ^ (i >> 1). Within a block only the low bits differ, so the high bits are one shift of all its elements.
    The seed's random digital shift, which keeps the sequence as even as it is, is another.
    """
    first = low // BLOCK * BLOCK
    gray = first ^ (first >> 1)
    shift = np.random.Philox(key=seed).random_raw(_LANES).astype(np.uint32)  # the low 32 bits of each
    for bit in range(_BITS):
        if gray >> bit & 1:
            shift = shift ^ _directions()[:, bit]
    return _unit(_sobol_block()[:, low - first : high - first] ^ shift[:, None])


@functools.cache
def _sobol_block() -> npt.NDArray[np.uint32]:
    """Return the sequence's first BLOCK elements, (4, BLOCK), as 32-bit integers."""
    low = np.zeros((_LANES, 1), np.uint32)
    for bit in range(BLOCK.bit_length() - 1):  # elements 0 .. 2 ** bit - 1, then the same in reverse with this bit
        low = np.concatenate([low, low[:, ::-1] ^ _directions()[:, bit, None]], axis=1)
    return low


@functools.cache
def _directions() -> npt.NDArray[np.uint32]:
    """Return Sobol's direction numbers, (dimensions, bits)."""
    table = [[1] * _BITS]  # the first dimension is van der Corput's sequence
    for coefficients, first in _POLYNOMIALS:
        degree, m = len(first), list(first)
        for k in range(degree, _BITS):
            value = m[k - degree] ^ (m[k - degree] << degree)
            for j in range(1, degree):
                value ^= (coefficients >> (degree - 1 - j) & 1) * (m[k - j] << j)
            m.append(value)
        table.append(m)
    return np.array([[m << (_BITS - 1 - k) for k, m in enumerate(row)] for row in table], np.uint32)


def _unit(words: npt.NDArray[np.uint32]) -> Array:
    """Turn the upper 24 bits, which float32 represents exactly, into numbers in [0, 1), contiguous."""
    bits = np.right_shift(words, np.uint32(8), out=np.empty(words.shape, np.uint32))
    u = bits.view(np.int32).astype(np.float32)  # converting signed integers is faster
    u *= np.float32(2**-24)
    return u


def _direction3(u: Array, v: Array) -> Array:
    """Return directions uniform on the sphere S^2, (3, n): cos(polar angle) = 1 - 2u, azimuth = 2 pi v."""
    azimuth = np.float32(2 * math.pi) * v
    direction = np.empty((3, len(u)), np.float32)
    x, y, z = direction
    np.subtract(1, 2 * u, out=z)
    radius = 2 * np.sqrt(u * (1 - u))  # sine of the polar angle
    np.multiply(radius, np.cos(azimuth), out=x)
    np.multiply(radius, np.sin(azimuth), out=y)
    return direction


def _direction4(u: Array, v: Array, w: Array) -> Array:
    """Return directions uniform on the sphere S^3, (4, n) (Shoemake, "Uniform random rotations", Graphics Gems III)."""
    a, b = np.float32(2 * math.pi) * v, np.float32(2 * math.pi) * w
    near, far = np.sqrt(1 - u), np.sqrt(u)
    return np.stack([near * np.sin(a), near * np.cos(a), far * np.sin(b), far * np.cos(b)])
