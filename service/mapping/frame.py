"""The frame of an object: the box that its function fills, and the map from the function's own numbers to it.

A mapping function gives points near the object frame, not exactly in it: the boxes of 40 objects were 0.87 to 1.26
long. So each object's box is measured once (`service.mapping.box`) and kept. Points are then centered on the box and
divided by its longest side. The box is of the whole function, so all clouds and surfaces of an object share it.
"""

import json
import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from service.errors import CorruptWeights
from service.mapping.spec import Array

SMALLEST: Final = 1e-20  # a box that is not longer is a point, which has no size to divide by
BYTES: Final = 24

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Frame:
    """The bounding box of an object in its function's own numbers.

    low, high : smallest and largest coordinates; float32 values.
    """

    low: Triple
    high: Triple

    @classmethod
    def of(cls, low: Array, high: Array) -> "Frame":
        """Return the frame of a box with these corners, (3,) float32 each."""
        return cls(_triple(low.tolist()), _triple(high.tolist()))

    @property
    def center(self) -> Array:
        """Middle of the box, (3,) float32."""
        center: Array = ((np.array(self.low) + np.array(self.high)) / 2).astype(np.float32)
        return center

    @property
    def sides(self) -> Triple:
        """Width, height and depth of the box, in the function's own numbers."""
        return _triple([high - low for low, high in zip(self.low, self.high, strict=True)])

    @property
    def unit(self) -> float:
        """Length that becomes 1: the box's longest side, or 1 if the box is a point."""
        longest = max(self.sides)
        return longest if longest > SMALLEST else 1.0

    @property
    def dimensions(self) -> Triple:
        """Width, height and depth in the object frame: the longest is 1."""
        unit = self.unit
        return _triple([side / unit for side in self.sides])

    def factor(self, scale: float = 1.0) -> np.float32:
        """Return what centered points are multiplied with so that the longest side is `scale`."""
        return np.float32(scale / self.unit)

    def to_bytes(self) -> bytes:
        """Return the box as `BYTES` bytes: low, then high, float32, little-endian."""
        return np.array([self.low, self.high], "<f4").tobytes()

    @classmethod
    def from_bytes(cls, data: bytes) -> "Frame":
        """Read the bytes that `to_bytes` returns."""
        numbers = struct.unpack("<6f", data)
        return cls(numbers[:3], numbers[3:])

    def to_json(self) -> str:
        """Return the box as one line of JSON; its numbers restore the same float32."""
        return json.dumps({"low": self.low, "high": self.high}, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: object) -> "Frame":
        """Read the text that `to_json` returns. Raises CorruptWeights."""
        try:
            fields = json.loads(text) if isinstance(text, str) else {}
            with np.errstate(over="ignore"):  # infinity is refused below
                low, high = (_triple([float(np.float32(each)) for each in fields[name]]) for name in ("low", "high"))
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            raise CorruptWeights('"frame" is not a JSON object with "low" and "high", three numbers each') from error
        if not all(math.isfinite(a) and math.isfinite(b) and a <= b for a, b in zip(low, high, strict=True)):
            raise CorruptWeights('"frame" is no box: its numbers must be finite, and none of "low" above "high"')
        return cls(low, high)


def _triple(numbers: list[float]) -> Triple:
    x, y, z = numbers
    return x, y, z
