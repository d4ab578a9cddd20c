"""A photo -> what of it is object, in front of any background: U2-Net's small model, u2netp.

Qin et al., U2-Net: Going Deeper with Nested U-Structure for Salient Object Detection, Pattern Recognition 2020;
the ONNX file is that of the rembg project, and so are the name and place at which it is looked for.

Run by onnxruntime directly, not through rembg, because rembg
- stretches every matte to the range 0 to 1: grass has a largest value of 0.27 there, and becomes an object;
- imports pymatting, which compiles for about a minute at a first start, and adds 180 MiB to the process;
- fetches the model where it is missing, which a service should never do.
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

SIDE: Final = 320  # of U2-Net's input and output, pixels
MEAN: Final = np.array([0.485, 0.456, 0.406], np.float32)  # ImageNet's, RGB
DEVIATION: Final = np.array([0.229, 0.224, 0.225], np.float32)
KEPT: Final = 32  # mattes of the last photos, 0.4 MB each: a repeat costs no inference


class Matting:
    """One onnxruntime session of U2-Net.

    Attributes
    ----------
    digest : sha256 of the model file, hexadecimal.
    """

    def __init__(self, data: bytes, threads: int) -> None:
        # With an arena the process would keep the 275 MiB that a call takes, for 20% less time.
        self._session = open_session(data, threads, arena=False)
        self._lock = threading.Lock()  # one call at a time has all threads; two would take the memory twice
        self._matte_of = lru_cache(KEPT)(self._run)
        self.digest: Final = hashlib.sha256(data).hexdigest()
        shapes = [tensors[0].shape[1:] for tensors in (self._session.get_inputs(), self._session.get_outputs())]
        if shapes != [[3, SIDE, SIDE], [1, SIDE, SIDE]]:
            raise InvalidModel(f"it is no U2-Net: its input and output have shapes {shapes}")

    @classmethod
    def of(cls, path: Path | None, threads: int) -> "Matting | None":
        """Load a model file to run on so many threads; None for no file.

        Raises
        ------
        InvalidModel : the file is missing, corrupt, or no U2-Net.
        """
        if path is None:
            return None
        try:
            return cls(path.read_bytes(), threads)
        except OSError as error:
            raise InvalidModel(
                f"cannot read the matting model {path}: {error.strerror}; the README tells how to get it, and without "
                "HOF_MATTING_MODEL and U2NET_HOME the service does without"
            ) from error
        except InvalidModel as error:
            raise InvalidModel(f"the matting model {path} is unusable: {error.detail}") from error

    def __call__(self, image: Image.Image) -> npt.NDArray[np.uint8]:
        """RGB photo of any size -> its matte (H, W), 255 where the object surely is."""
        pixels = image.resize((SIDE, SIDE), Image.Resampling.LANCZOS).tobytes()
        matte = Image.fromarray(self._matte_of(pixels))
        return np.asarray(matte.resize(image.size, Image.Resampling.BILINEAR))

    def _run(self, pixels: bytes) -> npt.NDArray[np.uint8]:
        """RGB bytes of (SIDE, SIDE) -> matte (SIDE, SIDE): the first of U2-Net's outputs, which fuses the others."""
        rgb = np.frombuffer(pixels, np.uint8).reshape(SIDE, SIDE, 3)
        scaled = (rgb / np.float32(max(int(rgb.max()), 1)) - MEAN) / DEVIATION
        tensor = np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])  # (1, 3, SIDE, SIDE)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        with self._lock:
            matte = self._session.run([outputs[0].name], {inputs[0].name: tensor})[0][0, 0]
        return np.asarray(np.rint(255 * matte).clip(0, 255), np.uint8)
