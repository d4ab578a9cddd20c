"""Bare numbers, x y z of each point after another: little-endian float32 or float16."""

import numpy as np

from service.mapping.spec import Array, Colors

FLOAT16_MAX = 65_504.0


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """Nothing precedes the points."""
    return b""


def float32(points: Array) -> bytes:
    """Points (m, 3) -> 12 m bytes."""
    return points.astype("<f4", copy=False).tobytes()


def float16(points: Array) -> bytes:
    """Points (m, 3) -> 6 m bytes; what float16 cannot hold becomes its largest value, +-65,504."""
    return np.clip(points, -FLOAT16_MAX, FLOAT16_MAX).astype("<f2").tobytes()


def beside(numbers: Array, more: Colors) -> bytes:
    """Rows of float32 (m, a), each followed by its row of more, (m, b) uint8 -> (4 a + b) m bytes."""
    size = 4 * numbers.shape[1]
    rows = np.empty((len(numbers), size + more.shape[1]), np.uint8)
    rows[:, :size] = numbers.astype("<f4", order="C", copy=False).view(np.uint8)
    rows[:, size:] = more
    return rows.tobytes()
