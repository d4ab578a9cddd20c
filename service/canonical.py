"""Canonical points: uniform samples of the canonical domain X, drawn by counter.

Point i of a seed is the same whether it is drawn alone, as one of a million or from an offset. Points
are made in blocks of `BLOCK` that start at multiples of it, so every NumPy call sees the same shapes and
a point's bits never depend on what is drawn with it.

Each point starts as four numbers in [0, 1): independent ones (NumPy's Philox, keyed by the seed), or a
Sobol sequence, which covers the domain more evenly.
"""

import math
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from service.errors import InvalidParameter
from service.mapping import DOMAIN_DIMS, Array, Domain

Sampling = Literal["uniform", "sobol"]

BLOCK: Final = 4096  # points; a power of two
MAX_SEED: Final = 2**64 - 1
MAX_INDEX: Final[dict[Sampling, int]] = {"uniform": 2**63, "sobol": 2**32}  # of a point
_LANES: Final = 4
_BITS: Final = 32
# Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections" (2008), table
# new-joe-kuo-6, dimensions 2 to 4: coefficients of the primitive polynomial, first direction numbers.
_POLYNOMIALS: Final = ((0, (1,)), (1, (1, 3)), (1, (1, 3, 1)))


def canonical_points(domain: Domain, n: int, seed: int = 0, offset: int = 0, sampling: Sampling = "uniform") -> Array:
    """Points `offset` to `offset + n` of the seed's uniform sample of a canonical domain.

    Parameters
    ----------
    domain : the canonical set X (paper, section 3.1 and the comparison of canonical sets in its appendix).
    n : how many points, at least 1.
    seed : 0 to 2**64 - 1.
    offset : index of the first point.
    sampling : `uniform`, independent points; `sobol`, a Sobol sequence with a random digital shift.

    Returns
    -------
    (n, d) float32, d = `DOMAIN_DIMS[domain]`; ball, sphere and ball4 of radius 1, the cube [-1, 1]^3.

    Raises
    ------
    InvalidParameter : n, seed or offset is out of range.
    """
    check_range(n, seed, offset, sampling)
    stop = offset + n
    points = np.empty((n, DOMAIN_DIMS[domain]), np.float32)
    for first in range(offset // BLOCK * BLOCK, stop, BLOCK):
        begin, end = max(first, offset), min(first + BLOCK, stop)
        points[begin - offset : end - offset] = block(domain, seed, first, sampling)[:, begin - first : end - first].T
    return points


def check_range(n: int, seed: int, offset: int, sampling: Sampling = "uniform") -> None:
    """Refuse what `canonical_points` cannot draw, with InvalidParameter."""
    if n < 1:
        raise InvalidParameter(f"n must be at least 1, not {n}", field="n")
    if not 0 <= seed <= MAX_SEED:
        raise InvalidParameter("seed must lie in 0 to 2**64 - 1", field="seed")
    if not 0 <= offset <= MAX_INDEX[sampling] - n:
        limit = MAX_INDEX[sampling].bit_length() - 1
        raise InvalidParameter(f"offset must lie in 0 to 2**{limit} - n with {sampling} sampling", field="offset")


def block(domain: Domain, seed: int, first: int, sampling: Sampling = "uniform") -> Array:
    """Canonical points [first, first + BLOCK), `first` a multiple of BLOCK: (d, BLOCK) float32."""
    u = _uniform(seed, first) if sampling == "uniform" else _sobol(seed, first)
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
    words: npt.NDArray[np.uint32] = raw.astype("<u8", copy=False).view("<u4").reshape(BLOCK, _LANES)
    return _unit(words.T)


def _sobol(seed: int, first: int) -> Array:
    """Numbers [first, first + BLOCK) of the four-dimensional Sobol sequence, (4, BLOCK) float32 in [0, 1).

    The sequence in Gray code order: index i is the exclusive or of the direction numbers of the bits of
    i ^ (i >> 1). Within a block only the low bits differ, so the rest is one shift of them all; the
    seed's random digital shift (which leaves the evenness as it is) is another.
    """
    directions = _directions()
    low = np.zeros((_LANES, 1), np.uint32)
    for bit in range(BLOCK.bit_length() - 1):  # i = 0 .. 2 ** bit - 1, then the same from the end with this bit
        low = np.concatenate([low, low[:, ::-1] ^ directions[:, bit, None]], axis=1)
    gray = first ^ (first >> 1)
    shift = np.random.Philox(key=seed).random_raw(_LANES).astype(np.uint32)  # the low 32 bits of each
    for bit in range(_BITS):
        if gray >> bit & 1:
            shift = shift ^ directions[:, bit]
    return _unit(low ^ shift[:, None])


def _directions() -> npt.NDArray[np.uint32]:
    """Sobol's direction numbers, (dimensions, bits)."""
    table = [[1] * _BITS]  # the first dimension: van der Corput's
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
    """The upper 24 bits, which float32 holds, as numbers in [0, 1); contiguous."""
    return np.ascontiguousarray((words >> np.uint32(8)).astype(np.float32) * np.float32(2**-24))


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
