"""Training examples in memory, and the batches drawn from them, reproducible at any step."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from PIL import Image
from torch import Tensor

from model.config import TrainConfig
from model.data.manifest import Entry, Manifest, Split
from service.canonical import canonical_points
from service.images import Framing, frame

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

OVERSIZE: Final = 2  # stored crops have this many pixels per pixel of the encoder's input
ZOOM: Final = (0.85, 1.1)
SHIFT: Final = 0.06  # of the frame, either way
PLAIN_SHARE: Final = 0.5  # of training images stand on white, as the service's masked ones do


@dataclass(frozen=True)
class Examples:
    """A split in memory.

    entries : one per object.
    crops : (objects, views, S, S, 4) uint8 RGBA, framed by the service's code, S = OVERSIZE * size.
    points : (objects, 10000, 3) float32, object frame.
    """

    entries: list[Entry]
    crops: Bytes
    points: Floats


def load_examples(folder: Path, split: Split, framing: Framing) -> Examples:
    """Read a split and frame its views once. Raises FileNotFoundError without a finished data set."""
    entries = list(Manifest.read(folder).of(split))
    large = Framing(framing.size * OVERSIZE, framing.foreground_ratio)
    crops, points = [], []
    for entry in entries:
        with np.load(folder / entry.file) as arrays:
            crops.append(np.stack([np.asarray(frame(Image.fromarray(view), large)[0]) for view in arrays["views"]]))
            points.append(arrays["points"])
    return Examples(entries, np.stack(crops), np.stack(points))


@dataclass(frozen=True)
class Batch:
    """images (b, 3, size, size) in [0, 1]; canonical (b, n, d); true points (b, m, 3)."""

    images: Tensor
    canonical: Tensor
    points: Tensor


def draw_batch(examples: Examples, config: TrainConfig, step: int) -> Batch:
    """The batch of a step: a function of (seed, step) alone, so that a resumed run sees the same data."""
    rng = np.random.default_rng([config.seed, step])
    objects = _epoch_slice(len(examples.entries), config, step)
    views = rng.integers(examples.crops.shape[1], size=config.batch)
    crops = torch.from_numpy(examples.crops[objects, views]).permute(0, 3, 1, 2).float() / 255
    chosen = rng.integers(examples.points.shape[1], size=(config.batch, config.target_points))
    points = torch.from_numpy(examples.points[objects[:, None], chosen])
    canonical = torch.from_numpy(uniform_points(config, rng))
    return Batch(augment(crops, rng), canonical, points)


def uniform_points(config: TrainConfig, rng: np.random.Generator) -> Floats:
    """(batch, points, d) uniform in the spec's canonical domain."""
    n = config.batch * config.points
    seed = int(rng.integers(2**62))
    return canonical_points(config.spec.domain, n, seed).reshape(config.batch, config.points, -1)


def augment(crops: Tensor, rng: np.random.Generator) -> Tensor:
    """Random framing, light and background: (b, 4, S, S) RGBA in [0, 1] -> (b, 3, S/2, S/2) RGB."""
    b = len(crops)
    rgb, alpha = crops[:, :3], crops[:, 3:]
    premultiplied = torch.cat([rgb * alpha, alpha], dim=1)
    zoom = torch.from_numpy(rng.uniform(*ZOOM, b).astype(np.float32))
    matrix = torch.zeros(b, 2, 3)
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1 / zoom
    matrix[:, :, 2] = torch.from_numpy(rng.uniform(-SHIFT, SHIFT, (b, 2)).astype(np.float32))
    grid = nnf.affine_grid(matrix, list(crops.shape), align_corners=False)
    moved = nnf.grid_sample(premultiplied, grid, align_corners=False)
    small = nnf.avg_pool2d(moved, OVERSIZE)
    colour, alpha = _relight(small[:, :3], rng), small[:, 3:]
    return (colour * alpha.sign() + (1 - alpha) * _backgrounds(small.shape, rng)).clamp(0, 1)


def _relight(premultiplied: Tensor, rng: np.random.Generator) -> Tensor:
    """Exposure and a tint per image; some images become grey."""
    b = len(premultiplied)
    gain = rng.uniform(0.6, 1.4, (b, 1, 1, 1)) * rng.uniform(0.88, 1.12, (b, 3, 1, 1))
    lit = premultiplied * torch.from_numpy(gain.astype(np.float32))
    grey = torch.from_numpy(rng.random(b) < 0.1).view(b, 1, 1, 1)
    return torch.where(grey, lit.mean(dim=1, keepdim=True), lit)


def _backgrounds(shape: torch.Size, rng: np.random.Generator) -> Tensor:
    """White for PLAIN_SHARE of the images, else a gradient between two colours with noise."""
    b, _, height, width = shape
    first, second = torch.from_numpy(rng.random((2, b, 3, 1, 1)).astype(np.float32))
    angle = torch.from_numpy(rng.uniform(0, 2 * np.pi, (b, 1, 1, 1)).astype(np.float32))
    y, x = torch.meshgrid(torch.linspace(-1, 1, height), torch.linspace(-1, 1, width), indexing="ij")
    ramp = (x * angle.cos() + y * angle.sin()) / 2.83 + 0.5
    noise = torch.from_numpy(rng.standard_normal((b, 3, height, width)).astype(np.float32)) * 0.05
    ground = (first * ramp + second * (1 - ramp) + noise).clamp(0, 1)
    plain = torch.from_numpy(rng.random(b) < PLAIN_SHARE).view(b, 1, 1, 1)
    return torch.where(plain, torch.ones(()), ground)


def _epoch_slice(objects: int, config: TrainConfig, step: int) -> npt.NDArray[np.int64]:
    """Objects of a step: every object once per epoch, in an order seeded by (seed, epoch)."""
    positions = np.arange(step * config.batch, (step + 1) * config.batch)
    epochs = positions // objects
    orders = {epoch: np.random.default_rng([config.seed, 1, epoch]).permutation(objects) for epoch in np.unique(epochs)}
    return np.array([orders[epoch][position % objects] for epoch, position in zip(epochs, positions, strict=True)])


def plain_images(crops: Bytes) -> Tensor:
    """Stored crops over white, as the service shows them: (b, S, S, 4) uint8 -> (b, 3, S/2, S/2)."""
    pixels = torch.from_numpy(crops).permute(0, 3, 1, 2).float() / 255
    alpha = pixels[:, 3:]
    return nnf.avg_pool2d(pixels[:, :3] * alpha + (1 - alpha), OVERSIZE)
