"""Bare numbers: x, y, z of one point after another, little-endian float32 or float16."""

import numpy as np

from service.mapping.spec import Array, Colors

FLOAT16_MAX = 65_504.0


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """Return no bytes: nothing precedes the points."""
    return b""


def float32(points: Array) -> bytes:
    """Write points (m, 3) in 12 m bytes."""
    return points.astype("<f4", copy=False).tobytes()


def float16(points: Array) -> bytes:
    """Write points (m, 3) in 6 m bytes; values beyond float16 become its largest, +-65,504."""
    return np.clip(points, -FLOAT16_MAX, FLOAT16_MAX).astype("<f2").tobytes()


def interleave(numbers: Array, octets: Colors) -> bytes:
    """Write rows of float32, (m, a), each followed by its row of uint8, (m, b), in (4 a + b) m bytes."""
    size = 4 * numbers.shape[1]
    rows = np.empty((len(numbers), size + octets.shape[1]), np.uint8)
    rows[:, :size] = numbers.astype("<f4", order="C", copy=False).view(np.uint8)
    rows[:, size:] = octets
    return rows.tobytes()
