"""Training examples in memory, and the batches drawn from them, reproducible at any step."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from PIL import Image
from torch import Tensor

from model.config import TrainConfig
from model.data.augment import ANY_LIGHT, Light, augment, oversize
from model.data.manifest import Entry, Manifest, Split, made_files, variant_files
from model.data.sources.photographs import photograph_files
from service.encoding.framing import Framing, frame
from service.mapping.canonical import canonical_points

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

VISIBLE: Final = 0.005  # of a view's pixels: a flat object seen from its edge shows nothing, and is left out
MADE_A_DRAW: Final = 20  # pieces that share an object's turn: 9,000 of them are four tenths of the batches
OWN: Final = 2  # an object's first shapes: as the data set was built, and under free cameras
MIRROR: Final = np.array([-1, 1, 1], np.float32)  # left and right exchanged, object frame


@dataclass(frozen=True)
class Shape:
    """A shape and its views.

    crops : (views, S, S, 4) uint8 RGBA, framed by the service's code, S = oversize(size) * size.
    points : (10000, 3) float32, object frame.
    colours : (10000, 3) uint8, sRGB of each point as its material has it; None for variants.
    """

    crops: Bytes
    points: Floats
    colours: Bytes | None = None


@dataclass(frozen=True)
class Examples:
    """A split in memory.

    entries : one per object.
    shapes : per object the object itself; with variants then the same under free cameras, and in the
        training split its stretched and warped copies.
    photographs : files of what may stand behind them.
    made : made furniture, MADE_A_DRAW pieces each, drawn as often as an object.
    """

    entries: list[Entry]
    shapes: list[list[Shape]]
    photographs: tuple[Path, ...]
    made: list[list[Shape]] = field(default_factory=list)

    def built(self, view: int) -> tuple[Bytes, Floats]:
        """View `view`, of those that show something, of every object as the data set was built: crops
        (objects, S, S, 4), points (objects, 10000, 3)."""
        chosen = [own for own, *_ in self.shapes]
        return np.stack([one.crops[view] for one in chosen]), np.stack([one.points for one in chosen])


def load_examples(folder: Path, split: Split, framing: Framing, variants: bool = False, made: bool = False) -> Examples:
    """Read a split and frame its views once; with `variants` also what `hof-model data vary` wrote, with `made`
    what `make` did.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set, no variants, stretched ones of the training split
        among them, or no made furniture where asked for.
    """
    entries = list(Manifest.read(folder).of(split))
    large = Framing(framing.size * oversize(framing.size), framing.foreground_ratio)
    files = [[folder / entry.file, *(variant_files(folder, entry) if variants else [])] for entry in entries]
    if variants and split == "train" and not any(len(of_object) > OWN for of_object in files):
        raise FileNotFoundError(f"{folder} holds no stretched shapes: run `hof-model data vary --data {folder}` first")
    pieces = made_files(folder) if made else []
    files += [pieces[start : start + MADE_A_DRAW] for start in range(0, len(pieces), MADE_A_DRAW)]
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        shapes = list(threads.map(lambda paths: [_load_shape(path, large) for path in paths], files))
    return Examples(entries, shapes[: len(entries)], photograph_files(folder), shapes[len(entries) :])


def _load_shape(path: Path, framing: Framing) -> Shape:
    with np.load(path) as arrays:
        shown = [view for view in arrays["views"] if (view[..., 3] > 0).mean() > VISIBLE]
        crops = np.stack([np.asarray(frame(Image.fromarray(view), framing)[0]) for view in shown])
        return Shape(crops, arrays["points"], arrays.get("colours"))


@dataclass(frozen=True)
class Batch:
    """images (b, 3, size, size) in [0, 1]; canonical (b, n, d); true points (b, m, 3), and their colours
    (b, m, 3) uint8 where every shape has them."""

    images: Tensor
    canonical: Tensor
    points: Tensor
    colours: Tensor | None


def draw_batch(examples: Examples, config: TrainConfig, step: int, light: Light = ANY_LIGHT) -> Batch:
    """The batch of a step: a function of (seed, step) alone, so that a resumed run sees the same data.

    Each object, and each group of made pieces, comes as one of all its views, those of its variants included, and
    half of them mirrored: an image flipped left to right shows the shape with x negated. Of an object's draws
    `config.own_share` are set aside for the object itself.
    """
    rng = np.random.default_rng([config.seed, step])
    mirrored = rng.random(config.batch) < 0.5
    crops, points, colours = [], [], []
    drawn_from = [*examples.shapes, *examples.made]
    for number, turned in zip(_epoch_slice(len(drawn_from), config, step), mirrored, strict=True):
        shapes = drawn_from[number]
        if number < len(examples.shapes) and rng.random() < config.own_share:
            shapes = shapes[:OWN]
        shape, view = _any_view(shapes, rng)
        drawn = rng.permutation(len(shape.points))[: config.target_points]
        chosen = shape.points[drawn]
        crops.append(shape.crops[view])
        points.append(chosen * MIRROR if turned else chosen)
        if shape.colours is not None:
            colours.append(shape.colours[drawn])
    views = torch.from_numpy(np.stack(crops)).permute(0, 3, 1, 2)
    images = augment(views, config.framing.size, rng, examples.photographs, light)
    images[mirrored] = images[mirrored].flip(3)  # augmentation knows no left and right: last is cheapest
    canonical = torch.from_numpy(uniform_points(config, rng))
    coloured = torch.from_numpy(np.stack(colours)) if len(colours) == config.batch else None
    return Batch(images, canonical, torch.from_numpy(np.stack(points)), coloured)


def _any_view(shapes: list[Shape], rng: np.random.Generator) -> tuple[Shape, int]:
    """One view of all views that an object's shapes have."""
    view = int(rng.integers(sum(len(shape.crops) for shape in shapes)))
    for shape in shapes[:-1]:
        if view < len(shape.crops):
            return shape, view
        view -= len(shape.crops)
    return shapes[-1], view


def uniform_points(config: TrainConfig, rng: np.random.Generator) -> Floats:
    """(batch, points, d) uniform in the spec's canonical domain."""
    n = config.batch * config.points
    seed = int(rng.integers(2**62))
    return canonical_points(config.spec.domain, n, seed).reshape(config.batch, config.points, -1)


def _epoch_slice(objects: int, config: TrainConfig, step: int) -> npt.NDArray[np.int64]:
    """Objects of a step: every object once per epoch, in an order seeded by (seed, epoch)."""
    positions = np.arange(step * config.batch, (step + 1) * config.batch)
    epochs = positions // objects
    orders = {epoch: np.random.default_rng([config.seed, 1, epoch]).permutation(objects) for epoch in np.unique(epochs)}
    return np.array([orders[epoch][position % objects] for epoch, position in zip(epochs, positions, strict=True)])


def plain_images(crops: Bytes, size: int) -> Tensor:
    """Stored crops over white, as the service shows them: (b, S, S, 4) uint8 -> (b, 3, size, size)."""
    pixels = torch.from_numpy(crops).permute(0, 3, 1, 2).float() / 255
    alpha = pixels[:, 3:]
    return nnf.avg_pool2d(pixels[:, :3] * alpha + (1 - alpha), oversize(size))
