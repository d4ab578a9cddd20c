"""Training examples in memory, and batches drawn from them, reproducible at any step."""

import os
from collections.abc import Iterator
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

from model.config import Frame, TrainConfig
from model.data.augment import ANY_LIGHT, Light, augment, oversize
from model.data.manifest import COLORS, Entry, Manifest, Split, piece_entries, piece_files, variant_files
from model.data.packed.shards import OWN
from model.data.rendering.camera_frame import to_camera
from model.data.rendering.partial import SURFACE, draw_counts, draw_parts, stretched, turned
from model.data.sources.photographs import photograph_files
from service.encoding.clouds import MOST_POINTS
from service.encoding.framing import Framing, frame
from service.mapping.canonical import canonical_points

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

VISIBLE: Final = 0.005  # least share of a view's pixels: a flat object seen from its edge is left out
PIECES_PER_DRAW: Final = 20  # pieces by rule that share one object's turn: 9,000 fill four tenths of the batches
MESHES_PER_DRAW: Final = 4  # pieces of meshes that do: each is a design of its own
MIRROR: Final = np.array([-1, 1, 1], np.float32)  # left and right exchanged, object frame


@dataclass(frozen=True)
class Shape:
    """A shape and its views.

    crops : (views, S, S, 4) uint8 RGBA, framed by the service's code, S = oversize(size) * size.
    points : (10000, 3) float32, object frame.
    colors : (10000, 3) uint8, sRGB of the material at each point; None for variants.
    cameras : (views, 2) float32, azimuth and elevation in degrees; None if the file does not tell them.
    """

    crops: Bytes
    points: Floats
    colors: Bytes | None = None
    cameras: Floats | None = None

    def points_in(self, frame: Frame, view: int) -> Floats:
        """Return the points in a frame, that of a view's camera or the object's.

        Raises
        ------
        ValueError : the camera's frame, and the shape has no cameras.
        """
        if frame == "object":
            return self.points
        if self.cameras is None:
            raise ValueError("a shape has no cameras: --frame camera needs a data set that tells them for each view")
        return to_camera(torch.from_numpy(self.points)[None], torch.from_numpy(self.cameras[view])[None])[0].numpy()


@dataclass(frozen=True)
class Examples:
    """A split in memory.

    entries : one per object.
    shapes : per object the object itself; with variants also the object under free cameras and, in the training
        split, its stretched and warped copies.
    photographs : files for backgrounds.
    pieces : procedural pieces in groups; a group is drawn as often as an object.
    """

    entries: list[Entry]
    shapes: list[list[Shape]]
    photographs: tuple[Path, ...]
    pieces: list[list[Shape]] = field(default_factory=list)

    def built(self, view: int, frame: Frame = "object") -> tuple[Bytes, Floats]:
        """Return a visible view of every object as built, the last one of those that have fewer.

        Returns crops (objects, S, S, 4) and points (objects, 10000, 3).
        """
        own = [first for first, *_ in self.shapes]
        views = [min(view, len(shape.crops) - 1) for shape in own]
        crops = np.stack([shape.crops[each] for shape, each in zip(own, views, strict=True)])
        return crops, np.stack([shape.points_in(frame, each) for shape, each in zip(own, views, strict=True)])


def load_examples(
    folder: Path, split: Split, framing: Framing, variants: bool = False, pieces: bool = False
) -> Examples:
    """Read a split and frame its views once.

    With `variants`, read the output of `hof-model data vary` too, with `pieces` that of `hof-model data make`.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set, or lacks the requested variants (for the training split
        also stretched ones) or pieces.
    """
    entries = list(Manifest.read(folder).of(split))
    large = Framing(framing.size * oversize(framing.size), framing.foreground_ratio)
    files = [[folder / entry.file, *(variant_files(folder, entry) if variants else [])] for entry in entries]
    if variants and split == "train" and not any(len(of_object) > OWN for of_object in files):
        raise FileNotFoundError(f"{folder} holds no stretched shapes: run `hof-model data vary --data {folder}` first")
    files += piece_groups(folder) if pieces else []
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        shapes = list(threads.map(lambda paths: [_load_shape(path, large) for path in paths], files))
    return Examples(entries, shapes[: len(entries)], photograph_files(folder), shapes[len(entries) :])


def piece_groups(folder: Path) -> list[list[Path]]:
    """Return the pieces that are drawn as one object: PIECES_PER_DRAW made by rule, or MESHES_PER_DRAW of meshes.

    Raises
    ------
    FileNotFoundError : the data set has no pieces.
    """
    of_meshes = {folder / entry.file for entry in piece_entries(folder)}
    files = piece_files(folder)
    groups = []
    for paths, size in (
        ([path for path in files if path not in of_meshes], PIECES_PER_DRAW),
        ([path for path in files if path in of_meshes], MESHES_PER_DRAW),
    ):
        groups += [paths[start : start + size] for start in range(0, len(paths), size)]
    return groups


def _load_shape(path: Path, framing: Framing) -> Shape:
    with np.load(path) as arrays:
        views, cameras = arrays["views"], arrays.get("cameras")
        visible = [number for number, view in enumerate(views) if (view[..., 3] > 0).mean() > VISIBLE]
        crops = np.stack([np.asarray(frame(Image.fromarray(views[number]), framing)[0]) for number in visible])
        kept = None if cameras is None or len(cameras) != len(views) else cameras[visible, :2].astype(np.float32)
        return Shape(crops, arrays["points"], arrays.get(COLORS), kept)


@dataclass(frozen=True)
class Batch:
    """One training batch.

    images : (b, 3, size, size) in [0, 1]; of a point encoder, the parts of the surfaces, (b, p, 3).
    canonical : (b, n, d) canonical points.
    points : (b, m, 3) true points; of a point encoder, from the center of the part's box.
    colors : (b, m, 3) uint8, of the true points; None unless every shape has colors.
    scale : (b, 1, 1), what predicted points are multiplied with; None for 1.
    """

    images: Tensor
    canonical: Tensor
    points: Tensor
    colors: Tensor | None
    scale: Tensor | None = None


def draw_batch(examples: Examples, config: TrainConfig, step: int, light: Light = ANY_LIGHT) -> Batch:
    """Draw the batch of a step, which depends on (seed, step) only, so that a resumed run sees the same data.

    Each object, and each group of pieces, appears in one of all its views, variants included. Half of the views are
    mirrored: an image flipped left to right shows the shape with x negated. A share `config.own_share` of an object's
    draws uses the object itself. Without `config.augmented` views are as rendered, over white.
    """
    rng = np.random.default_rng([config.seed, step])
    mirrored = (rng.random(config.batch) < 0.5) & config.augmented
    crops, points, colors = [], [], []
    surface = SURFACE if config.encoder.takes_points else 0
    for (shape, view), is_mirrored in zip(draw_views(examples, config, step, rng), mirrored, strict=True):
        order = rng.permutation(len(shape.points))[: max(config.target_points, surface)]
        targets = shape.points_in(config.frame, view)[order]
        crops.append(shape.crops[view])
        points.append(targets * MIRROR if is_mirrored else targets)
        if shape.colors is not None:
            colors.append(shape.colors[order])
    if config.encoder.takes_points:
        return _parts_batch(torch.from_numpy(np.stack(points)), config, rng)
    views = torch.from_numpy(np.stack(crops))
    if config.augmented:
        images = augment(views.permute(0, 3, 1, 2), config.framing.size, rng, examples.photographs, light)
    else:
        images = plain_images(views, config.framing.size)
    images[mirrored] = images[mirrored].flip(3)  # augmentation is symmetric left to right; flipping last is cheapest
    canonical = torch.from_numpy(uniform_points(config, rng))
    batch_colors = torch.from_numpy(np.stack(colors)) if len(colors) == config.batch else None
    return Batch(images, canonical, torch.from_numpy(np.stack(points)), batch_colors)


def draw_views(
    examples: Examples, config: TrainConfig, step: int, rng: np.random.Generator
) -> Iterator[tuple[Shape, int]]:
    """Yield the shapes of a step, each with the index of one of its views."""
    groups = [*examples.shapes, *examples.pieces]
    for number in _epoch_slice(len(groups), config, step):
        shapes = groups[number]
        if number < len(examples.shapes) and rng.random() < config.own_share:
            shapes = shapes[:OWN]
        yield _any_view(shapes, rng)


def _parts_batch(points: Tensor, config: TrainConfig, rng: np.random.Generator) -> Batch:
    """Return the batch of a point encoder: parts of objects (b, m, 3), all with the same random number of points."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    b, cpu = len(points), torch.device("cpu")
    width = int(draw_counts(1, MOST_POINTS, cpu, generator))
    canonical = torch.from_numpy(uniform_points(config, rng))
    return parts_batch(points, canonical, config, torch.full((b,), width), width, generator)


def parts_batch(
    points: Tensor,
    canonical: Tensor,
    config: TrainConfig,
    counts: Tensor,
    width: int,
    generator: torch.Generator | None = None,
) -> Batch:
    """Return the batch of a point encoder. Parameters as of `draw_parts`, `points` being (b, m, 3)."""
    if config.turn:
        turns = 2 * torch.rand(len(points), device=points.device, generator=generator) - 1
        points = turned(points, config.turn * turns)
    if config.stretch > 1:
        points = stretched(points, config.stretch, generator)
    parts = draw_parts(points[:, :SURFACE], counts, width, generator)
    return Batch(parts.clouds, canonical, points[:, : config.target_points] - parts.center, None, parts.scale)


def _any_view(shapes: list[Shape], rng: np.random.Generator) -> tuple[Shape, int]:
    """Choose one of all views of an object's shapes; return its shape and its index there."""
    view = int(rng.integers(sum(len(shape.crops) for shape in shapes)))
    for shape in shapes[:-1]:
        if view < len(shape.crops):
            return shape, view
        view -= len(shape.crops)
    return shapes[-1], view


def uniform_points(config: TrainConfig, rng: np.random.Generator) -> Floats:
    """Return points uniform in the spec's canonical domain, (batch, points, d)."""
    n = config.batch * config.points
    seed = int(rng.integers(2**62))
    return canonical_points(config.spec.domain, n, seed).reshape(config.batch, config.points, -1)


def _epoch_slice(objects: int, config: TrainConfig, step: int) -> npt.NDArray[np.int64]:
    """Return the objects of a step: every object once per epoch, in an order seeded by (seed, epoch)."""
    positions = np.arange(step * config.batch, (step + 1) * config.batch)
    epochs = positions // objects
    orders = {epoch: np.random.default_rng([config.seed, 1, epoch]).permutation(objects) for epoch in np.unique(epochs)}
    return np.array([orders[epoch][position % objects] for epoch, position in zip(epochs, positions, strict=True)])


def plain_images(crops: Tensor, size: int) -> Tensor:
    """Put stored crops over white, as the service does: (b, S, S, 4) uint8 -> (b, 3, size, size)."""
    pixels = crops.permute(0, 3, 1, 2).float() / 255
    alpha = pixels[:, 3:]
    return nnf.avg_pool2d(pixels[:, :3] * alpha + (1 - alpha), oversize(size))
