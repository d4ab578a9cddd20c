"""Matting: separate the object of a photo from any background, by a network.

Two kinds can be loaded: those of `hof-model matte`, one of which is shipped, and U2-Net's small model, u2netp (Qin et
al., U2-Net: Going Deeper with Nested U-Structure for Salient Object Detection, Pattern Recognition 2020).

U2-Net's file, its name and its default folder are those of the rembg project. It is run by onnxruntime directly, not
through rembg, because rembg
- stretches every matte to the range 0 to 1: grass, whose largest value is 0.27, becomes an object;
- imports pymatting, which compiles for about a minute at the first start and adds 180 MiB to the process;
- downloads the model if it is missing, which a service should never do.
"""

import threading
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from service.encoding.masks import MATTING_FLOOR, Matte
from service.encoding.network import Network
from service.errors import InvalidModel
from service.mapping.spec import Array

INPUT, OUTPUT = "image", "matte"  # names in the graph of a network of `hof-model matte`
U2NET_SIDE: Final = 320  # pixels, of U2-Net's input and output
MEAN: Final = np.array([0.485, 0.456, 0.406], np.float32)  # ImageNet's, RGB, which U2-Net subtracts
DEVIATION: Final = np.array([0.229, 0.224, 0.225], np.float32)
MARGIN: Final = 0.15  # around the object's box in the second look, of its longer side
CACHED_MATTES: Final = 64  # of 0.1 MB at most; a repeated photo costs no inference

Box = tuple[int, int, int, int]


class Matting:
    """A network that finds objects. One of `hof-model matte` looks again at a square around what it found.

    Attributes
    ----------
    digest : sha256 of the model file, hexadecimal.
    side : pixels of the network's square input and output.
    is_u2net : whether it is U2-Net.
    """

    def __init__(self, path: Path, threads: int) -> None:
        # An arena would keep the memory of a call in the process: of U2-Net 275 MiB, and calls be only 20% faster.
        self._network = Network(path, threads, arena=False)
        self._lock = threading.Lock()  # one call uses all threads; two at a time would double the memory
        self._matte_of = lru_cache(CACHED_MATTES)(self._run)
        self.digest: Final = self._network.digest
        self.is_u2net: Final = self._has_shapes(U2NET_SIDE) and OUTPUT not in self._names()
        self.side: Final = U2NET_SIDE if self.is_u2net else self._own_side()

    @classmethod
    def of(cls, path: Path | None, threads: int) -> "Matting | None":
        """Load a model file to run on `threads` threads; return None if there is no path.

        Raises
        ------
        InvalidModel : the file is missing, corrupt, or no network that finds objects.
        """
        if path is None:
            return None
        try:
            return cls(path, threads)
        except OSError as error:
            raise InvalidModel(
                f"cannot read the matting model {path}: {error.strerror}; see docs/operations.md#background-removal, "
                "or unset HOF_MATTING_MODEL and U2NET_HOME to use the shipped one; `none` runs without matting"
            ) from error
        except InvalidModel as error:
            raise InvalidModel(f"the matting model {path} is unusable: {error.detail}") from error

    def __call__(self, image: Image.Image) -> Matte:
        """Return the matte (H, W) of an RGB photo of any size: 0 for background to 255 for the object."""
        whole = self._look(image)
        box = None if self.is_u2net else _square_around(whole)
        if box is None:
            return whole
        left, top, right, bottom = box
        if (right - left) * (bottom - top) >= image.width * image.height:
            return whole
        matte = np.zeros_like(whole)
        matte[top:bottom, left:right] = self._look(image.crop(box))
        return matte

    def rest(self) -> None:
        """Free the memory of the network until the next call."""
        self._network.rest()

    def _look(self, image: Image.Image) -> Matte:
        """Return the matte (H, W) of an RGB image that the network sees as a whole."""
        own = Image.Resampling.BOX if image.width >= self.side else Image.Resampling.BILINEAR
        resampling = Image.Resampling.LANCZOS if self.is_u2net else own
        matte = Image.fromarray(self._matte_of(image.resize((self.side, self.side), resampling).tobytes()))
        return np.asarray(matte.resize(image.size, Image.Resampling.BILINEAR))

    def _run(self, pixels: bytes) -> Matte:
        """Compute the matte (side, side) of RGB bytes of that size; U2-Net's first output fuses the others."""
        rgb = np.frombuffer(pixels, np.uint8).reshape(self.side, self.side, 3).astype(np.float32)
        rgb /= np.float32(max(float(rgb.max()), 1.0) if self.is_u2net else 255)
        scaled = (rgb - MEAN) / DEVIATION if self.is_u2net else rgb
        tensor: Array = np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], np.float32)
        with self._lock:
            matte = self._network.run([self._network.outputs[0].name], {self._network.inputs[0].name: tensor})[0][0, 0]
        return np.asarray(np.rint(255 * matte).clip(0, 255), np.uint8)

    def _names(self) -> set[str]:
        return {tensor.name for tensor in (*self._network.inputs, *self._network.outputs)}

    def _has_shapes(self, side: int) -> bool:
        """Return whether input and first output are a square image and its matte."""
        shapes = [tensors[0].shape[1:] for tensors in (self._network.inputs, self._network.outputs)]
        return shapes == [[3, side, side], [1, side, side]]

    def _own_side(self) -> int:
        """Return the side of a network of `hof-model matte`. Raises InvalidModel for other networks."""
        side = self._network.inputs[0].shape[-1]
        if isinstance(side, int) and self._has_shapes(side) and {INPUT, OUTPUT} == self._names():
            return side
        own = ", ".join(f"{each.name} {each.shape}" for each in (*self._network.inputs, *self._network.outputs))
        raise InvalidModel(
            f"it is neither U2-Net nor of `hof-model matte`: that has {INPUT} [batch, 3, side, side] and {OUTPUT} "
            f"[batch, 1, side, side], it has {own}"
        )


def _square_around(matte: Matte) -> Box | None:
    """Return a square around the object of a matte (H, W), moved into the image, or cut where it is larger.

    None if there is no object.
    """
    box = Image.fromarray(matte > MATTING_FLOOR).getbbox()
    if box is None:
        return None
    left, top, right, bottom = box
    side = round((1 + 2 * MARGIN) * max(right - left, bottom - top))
    height, width = matte.shape
    (left, right), (top, bottom) = _moved_within(left, right, side, width), _moved_within(top, bottom, side, height)
    return left, top, right, bottom


def _moved_within(low: int, high: int, side: int, length: int) -> tuple[int, int]:
    """Return the range of `side` around the middle of a range, moved into 0 to `length`; all of it if that is less."""
    if side >= length:
        return 0, length
    first = min(max(0, (low + high - side) // 2), length - side)
    return first, first + side
