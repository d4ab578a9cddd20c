"""Matting: separate the object of a photo from any background, with U2-Net's small model, u2netp.

Qin et al., U2-Net: Going Deeper with Nested U-Structure for Salient Object Detection, Pattern Recognition 2020.
The ONNX file, its name and its default folder are those of the rembg project.

It is run by onnxruntime directly, not through rembg, because rembg
- stretches every matte to the range 0 to 1: grass, whose largest value is 0.27, becomes an object;
- imports pymatting, which compiles for about a minute at the first start and adds 180 MiB to the process;
- downloads the model if it is missing, which a service should never do.
"""

import hashlib
import threading
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from service.encoding.encoder import open_session
from service.errors import InvalidModel

SIDE: Final = 320  # pixels, of U2-Net's input and output
MEAN: Final = np.array([0.485, 0.456, 0.406], np.float32)  # ImageNet's, RGB
DEVIATION: Final = np.array([0.229, 0.224, 0.225], np.float32)
CACHED_MATTES: Final = 32  # 0.4 MB each; a repeated photo costs no inference


class Matting:
    """One onnxruntime session of U2-Net.

    Attributes
    ----------
    digest : sha256 of the model file, hexadecimal.
    """

    def __init__(self, data: bytes, threads: int) -> None:
        # An arena would keep the 275 MiB of a call in the process, and make calls only 20% faster.
        self._session = open_session(data, threads, arena=False)
        self._lock = threading.Lock()  # one call uses all threads; two at a time would double the memory
        self._matte_of = lru_cache(CACHED_MATTES)(self._run)
        self.digest: Final = hashlib.sha256(data).hexdigest()
        shapes = [tensors[0].shape[1:] for tensors in (self._session.get_inputs(), self._session.get_outputs())]
        if shapes != [[3, SIDE, SIDE], [1, SIDE, SIDE]]:
            raise InvalidModel(f"it is not U2-Net: its input and output have shapes {shapes}")

    @classmethod
    def of(cls, path: Path | None, threads: int) -> "Matting | None":
        """Load a model file to run on `threads` threads; return None if there is no path.

        Raises
        ------
        InvalidModel : the file is missing, corrupt, or not U2-Net.
        """
        if path is None:
            return None
        try:
            return cls(path.read_bytes(), threads)
        except OSError as error:
            raise InvalidModel(
                f"cannot read the matting model {path}: {error.strerror}; install it as "
                "docs/operations.md#background-removal says, or unset HOF_MATTING_MODEL and U2NET_HOME "
                "to run without matting"
            ) from error
        except InvalidModel as error:
            raise InvalidModel(f"the matting model {path} is unusable: {error.detail}") from error

    def __call__(self, image: Image.Image) -> npt.NDArray[np.uint8]:
        """Return the matte (H, W) of an RGB photo of any size: 0 for background to 255 for the object."""
        pixels = image.resize((SIDE, SIDE), Image.Resampling.LANCZOS).tobytes()
        matte = Image.fromarray(self._matte_of(pixels))
        return np.asarray(matte.resize(image.size, Image.Resampling.BILINEAR))

    def _run(self, pixels: bytes) -> npt.NDArray[np.uint8]:
        """Compute the matte (SIDE, SIDE) of RGB bytes of that size: U2-Net's first output, which fuses the others."""
        rgb = np.frombuffer(pixels, np.uint8).reshape(SIDE, SIDE, 3)
        scaled = (rgb / np.float32(max(int(rgb.max()), 1)) - MEAN) / DEVIATION
        tensor = np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])  # (1, 3, SIDE, SIDE)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        with self._lock:
            matte = self._session.run([outputs[0].name], {inputs[0].name: tensor})[0][0, 0]
        return np.asarray(np.rint(255 * matte).clip(0, 255), np.uint8)
