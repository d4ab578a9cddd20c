"""The photographs that stand behind objects in training, in one file beside the shards."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from service.files import whole_file

FILE: Final = "photographs.npz"
SHORTER_SIDE: Final = 512  # pixels kept
QUALITY: Final = 90  # of WebP


def pack_photographs(folders: Sequence[Path], output: Path) -> Path:
    """Write the photographs of the data sets, each once, to `output` and return the file's path."""
    from model.data.sources.photographs import photograph_files

    files = dict.fromkeys(path for folder in folders for path in photograph_files(folder))
    images = [_encoded(path) for path in files]
    target = output / FILE
    with whole_file(target) as file:
        np.savez(
            file,
            images=np.frombuffer(b"".join(images), np.uint8),
            lengths=np.array([len(image) for image in images], np.int64),
        )
    return target


def read_photographs(folder: Path) -> list[Image.Image]:
    """Read the photographs of a packed data set, RGB; none where it has no such file."""
    path = folder / FILE
    if not path.exists():
        return []
    with np.load(path) as arrays:
        data, ends = arrays["images"].tobytes(), np.cumsum(arrays["lengths"])
    starts = [0, *ends[:-1].tolist()]
    return [
        Image.open(io.BytesIO(data[start:end])).convert("RGB") for start, end in zip(starts, ends.tolist(), strict=True)
    ]


def _encoded(path: Path) -> bytes:
    """Return a photograph as WebP, its shorter side at most SHORTER_SIDE."""
    with Image.open(path) as file:
        photograph = file.convert("RGB")
    factor = min(1.0, SHORTER_SIDE / min(photograph.size))
    target = io.BytesIO()
    photograph.resize([round(length * factor) for length in photograph.size]).save(target, "WEBP", quality=QUALITY)
    return target.getvalue()
