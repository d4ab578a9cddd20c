"""A data set in a device's memory, from shards or from a data set's folder."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from model.config import DeviceOptions, TrainConfig
from model.data.augment import oversize
from model.data.dataset import Examples, Shape, load_examples
from model.data.packed.photographs import read_photographs
from model.data.packed.shards import MADE_SOURCE, OWN, Row, quantize
from model.data.packed.tensors import Tensors, arrange, read_packed
from model.training.device.augment import Grounds
from model.training.device.pictures import photograph_pictures, texture_pictures
from model.training.device.placement import torch_device


@dataclass(frozen=True)
class DeviceData:
    """The training split, and what stands behind its objects, on one device."""

    train: Tensors
    grounds: Grounds


def load_data(data: Path, config: TrainConfig, options: DeviceOptions) -> DeviceData:
    """Load the training split from `options.packed`, or from the folder `data`.

    Raises
    ------
    FileNotFoundError : there is no such data set, or no variants or made pieces where the config asks for them.
    ValueError : a shard cannot be read.
    """
    device, size = torch_device(options), config.framing.size
    if options.packed:
        train = _read(options, config, "train", config.variants, config.made)
        photographs = read_photographs(Path(options.packed))
    else:
        examples = load_examples(data, "train", config.framing, config.variants, config.made)
        train, photographs = tensors_of(examples), [_open(path) for path in examples.photographs]
    grounds = Grounds(texture_pictures(size, device), photograph_pictures(photographs, size, device))
    return DeviceData(train.to(device), grounds)


def load_validation(data: Path, config: TrainConfig, options: DeviceOptions) -> Tensors:
    """Load the validation objects as built. Raises as `load_data`."""
    if options.packed:
        validation = _read(options, config, "val", variants=False, made=False)
    else:
        validation = tensors_of(load_examples(data, "val", config.framing))
    return validation.to(torch_device(options))


def _read(options: DeviceOptions, config: TrainConfig, split: str, variants: bool, made: bool) -> Tensors:
    side = config.framing.size * oversize(config.framing.size)
    workers = options.workers or os.cpu_count() or 1
    folder = Path(options.packed or "")
    return read_packed(folder, split, side, workers, variants, made, config.frame == "camera")


def tensors_of(examples: Examples) -> Tensors:
    """Arrange a split that was loaded from a data set's folder."""
    named = [(entry.id, entry.source, shapes) for entry, shapes in zip(examples.entries, examples.shapes, strict=True)]
    pieces = [(f"{MADE_SOURCE}/{number}", MADE_SOURCE, shapes) for number, shapes in enumerate(examples.pieces)]
    shapes = [shape for _, _, of_unit in named + pieces for shape in of_unit]
    is_colored = all(shape.colors is not None for shape in shapes)
    rng = np.random.default_rng(0)
    orders = [rng.permutation(len(shape.points)) for shape in shapes]  # draws take points that follow each other
    cameras = [shape.cameras for shape in shapes if shape.cameras is not None]
    colors = [shape.colors[order] for shape, order in zip(shapes, orders, strict=True) if shape.colors is not None]
    return arrange(
        list(_rows(named + pieces)),
        np.concatenate([shape.crops for shape in shapes]),
        np.concatenate([quantize(shape.points[order]) for shape, order in zip(shapes, orders, strict=True)]),
        np.concatenate(colors) if is_colored else None,
        np.concatenate(cameras) if len(cameras) == len(shapes) else None,
    )


def _rows(units: list[tuple[str, str, list[Shape]]]) -> Iterable[Row]:
    for unit, source, shapes in units:
        for number, shape in enumerate(shapes):
            place = number if source != MADE_SOURCE else OWN
            views = tuple(range(len(shape.crops)))
            yield Row(unit, unit, source, "", place, views, len(shape.points), shape.colors is not None)


def _open(path: Path) -> Image.Image:
    with Image.open(path) as file:
        return file.convert("RGB")
