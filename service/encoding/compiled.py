"""The compiled loops over pixels: mattes, sums over them, reduced squares, in C (service/encoding/kernel).

setup.py builds them where it finds a C compiler. Elsewhere NumPy and Pillow compute the same, more slowly.
"""

import functools
from typing import Final, Protocol, cast

import numpy as np
import numpy.typing as npt
from PIL import Image

from service.mapping.compiled import extension

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Counts = npt.NDArray[np.int32]
Picture = tuple[object, object]  # Arrow capsules of an image with four bytes a pixel

NAME: Final = "service.encoding._pixels"
NOT_BUILT: Final = (
    "no compiled loops over pixels of this version, so NumPy and Pillow find the objects in photos, more slowly: "
    "install a C compiler with Python's headers, then this package anew"
)
MOST_SUMMED: Final = 257  # pixels in a row, that one pixel of a reduced square is the mean of
VERSION: Final = 2  # of the source, as in pixels.c: raise both with each change of what it computes


class Pixels(Protocol):
    """The functions of `service.encoding._pixels`.

    They take C-contiguous arrays, run without Python's lock and write results to their last arguments. Other types and
    shapes raise ValueError.
    """

    def border_matte(
        self, picture: Picture, edge: int, tolerance: int, softness: int, share: float, matte: Bytes, /
    ) -> bool:
        """Write the matte (H, W) of what differs from a uniform border; return False if the border is not uniform.

        Parameters
        ----------
        edge : width of the border, pixels.
        tolerance : largest difference of a band that is background; at `tolerance + softness`, all is object.
        share : of the border's pixels, that must be background for a uniform border.
        """

    def summary(self, matte: Bytes, floor: int, rows: Counts, columns: Counts, /) -> tuple[int, int]:
        """Return the sum of a matte (H, W), and of its squares; count each row's and column's pixels above a floor."""

    def square(self, picture: Picture, matte: Bytes, left: int, top: int, side: int, rgba: Bytes, /) -> None:
        """Cut out a square of an RGB image with a matte, and reduce it by Pillow's box filter: rgba (size, size, 4).

        The size is below `side`, and `side` at most `MOST_SUMMED` times as long. Outside the image all is transparent.
        """

    def over_white(self, rgba: Bytes, planes: Floats, /) -> None:
        """Composite a picture (size, size, 4) over white: planes (3, size, size), from 0 to 1."""


@functools.cache
def load() -> Pixels | None:
    """Return the compiled functions, or None if there are none of this version."""
    return cast(Pixels | None, extension(NAME, VERSION))


def picture_of(image: Image.Image) -> Picture | None:
    """Return the memory of an RGB or RGBA image for the compiled functions; None if it is not in one piece."""
    if image.mode != "RGB":
        image = image.copy()  # older versions of Pillow crash on images that share the memory of a decoder
    try:
        return image.__arrow_c_array__()
    except ValueError:  # larger than a block of Pillow's memory
        return None
