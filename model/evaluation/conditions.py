"""Test objects under harder conditions: other cameras, other backgrounds, no color."""

import functools
import io
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
import numpy.typing as npt
from PIL import Image

from model.data.manifest import Entry, variant_files

Bytes = npt.NDArray[np.uint8]
Condition = Literal["plain", "other cameras", "flat color", "photograph", "gray"]

CONDITIONS: Final[tuple[Condition, ...]] = get_args(Condition)
FREE_VIEWS: Final = (0, 3, 6, 9)  # of 12 random cameras
MARGIN: Final = 8  # pixels of background added on each side: the views' own frame is nearly filled
LUMA: Final = (0.299, 0.587, 0.114)  # ITU-R BT.601


def condition_views(data: Path, entry: Entry, condition: Condition, views: Bytes, seed: int) -> list[bytes]:
    """Return the PNG files of an object under a condition, as a user would send them.

    plain : the views (v, S, S, 4) uint8 RGBA as they are.
    other cameras : FREE_VIEWS of the renders at elevations of 0 to 45 degrees, any azimuth, other focal lengths.
    flat color : each on a random color, opaque.
    photograph : each on a random crop of a photograph that training has not seen, opaque.
    gray : luma only.

    Raises
    ------
    FileNotFoundError : "other cameras" before `hof-model data vary`.
    """
    rng = np.random.default_rng([seed, *entry.id.encode()])
    if condition == "other cameras":
        return [png(view) for view in _free_views(data, entry)]
    change: Callable[[Bytes], Bytes] = {
        "plain": lambda view: view,
        "flat color": lambda view: _over(view, _flat(_shape_with_margin(view), rng)),
        "photograph": lambda view: _over(view, photograph(_shape_with_margin(view), rng)),
        "gray": _gray,
    }[condition]
    return [png(change(view)) for view in views]


def png(pixels: Bytes) -> bytes:
    """Encode (H, W, 3) or (H, W, 4) uint8 as a PNG file."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="PNG", compress_level=1)
    return file.getvalue()


@functools.cache
def photographs() -> list[Bytes]:
    """Return three photographs held out from training, (H, W, 3) uint8: a temple, a flower, a cup of coffee.

    scikit-learn's china.jpg and flower.jpg (CC-BY), scikit-image's coffee (CC0).
    """
    import skimage.data
    from sklearn.datasets import load_sample_images

    return [*map(np.asarray, load_sample_images().images), np.asarray(skimage.data.coffee())]


def _free_views(data: Path, entry: Entry) -> Bytes:
    with np.load(variant_files(data, entry)[0]) as arrays:
        views: Bytes = arrays["views"][list(FREE_VIEWS)]
    return views


def _shape_with_margin(view: Bytes) -> tuple[int, int]:
    return view.shape[0] + 2 * MARGIN, view.shape[1] + 2 * MARGIN


def _over(view: Bytes, ground: Bytes) -> Bytes:
    """Paste the view over the middle of a larger background: (h, w, 4) over (H, W, 3) -> (H, W, 3)."""
    alpha = view[..., 3:] / 255
    middle = ground[MARGIN:-MARGIN, MARGIN:-MARGIN]
    image = ground.copy()
    image[MARGIN:-MARGIN, MARGIN:-MARGIN] = np.round(view[..., :3] * alpha + middle * (1 - alpha)).astype(np.uint8)
    return image


def _flat(shape: tuple[int, int], rng: np.random.Generator) -> Bytes:
    """Return an image of one random color."""
    return np.full((*shape, 3), rng.integers(256, size=3), np.uint8)


def photograph(shape: tuple[int, int], rng: np.random.Generator) -> Bytes:
    """Return a random square of a random photograph, resized to the shape."""
    choices = photographs()
    whole = choices[int(rng.integers(len(choices)))]
    height, width = whole.shape[:2]
    side = int(rng.integers(shape[0], min(height, width)))
    top, left = (int(rng.integers(length - side + 1)) for length in (height, width))
    crop = Image.fromarray(whole[top : top + side, left : left + side])
    return np.asarray(crop.resize(shape[::-1], Image.Resampling.BOX))


def _gray(view: Bytes) -> Bytes:
    luma = np.round(view[..., :3] @ np.array(LUMA)).astype(np.uint8)
    return np.dstack([luma, luma, luma, view[..., 3]])
