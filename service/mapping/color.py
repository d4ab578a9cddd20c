"""Colors of an object's points: functions of the same canonical points, and prefix-stable like them."""

from typing import Final

import numpy as np

from service.errors import CorruptWeights
from service.mapping.canonical import Sampling, check_range
from service.mapping.sampler import Canonical, Sampler
from service.mapping.spec import Array, Color, Colors

WHITE: Final = 255


def linear(colors: Colors) -> Array:
    """Convert sRGB levels to linear light in [0, 1], float32."""
    return _LINEAR[colors]


def _levels() -> Array:
    """Return the linear light of each of the 256 sRGB levels (IEC 61966-2-1)."""
    level = np.arange(256) / 255
    light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)


_LINEAR: Final = _levels()


class ColorSampler:
    """The colors of one object. Packed once; any number of threads may use it at the same time.

    Raises
    ------
    InvalidSpec : the weights do not fit their spec.
    """

    def __init__(self, color: Color) -> None:
        rows, self._counts = np.unique(np.atleast_2d(color.weights), axis=0, return_counts=True)  # AAB: two of A
        self._samplers = [Sampler(color.spec, (row,)) for row in rows]

    def colors(self, n: int, *, seed: int = 0, offset: int = 0, sampling: Sampling = "uniform") -> Colors:
        """Compute the colors of the points that `Sampler.points` gives for the same arguments: (n, 3) uint8, sRGB.

        Raises
        ------
        InvalidParameter : an argument is out of range.
        CorruptWeights : the functions' values exceed float32.
        """
        check_range(n, seed, offset, sampling)
        return self._at(self._samplers[0].canonical(n, seed, offset, sampling), n)

    def map(self, x: Array) -> Colors:
        """Compute the colors at any canonical points: (n, input_dim) float32 -> (n, 3) uint8, sRGB.

        Raises
        ------
        CorruptWeights : the functions' values exceed float32.
        """
        return self._at(self._samplers[0].pad(x), len(x))

    def _at(self, canonical: Canonical, n: int) -> Colors:
        """Average the functions at the n selected canonical points. Raises CorruptWeights."""
        total = np.zeros((n, 3), np.float32)
        for sampler, count in zip(self._samplers, self._counts, strict=True):
            try:
                values = sampler.at(canonical)
            except CorruptWeights as error:
                raise CorruptWeights("the color function's values exceed float32", field="color") from error
            total += np.float32(count) * np.clip(values, 0, 1, out=values)
        total *= np.float32(WHITE / self._counts.sum())
        return np.rint(total, out=total).astype(np.uint8)
