"""Batches drawn on the device, with the distribution of `model.data.dataset.draw_batch`."""

from dataclasses import replace
from typing import Final

import numpy as np
import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.config import Frame, TrainConfig
from model.data.augment import ANY_LIGHT, Light
from model.data.dataset import Batch, parts_batch, plain_images
from model.data.packed.tensors import Tensors, dequantize
from model.data.rendering.camera_frame import to_camera
from model.data.rendering.partial import SURFACE, draw_counts
from model.training.device.augment import Grounds, augment
from service.encoding.clouds import MOST_POINTS
from service.mapping.spec import DOMAIN_DIMS, Domain

STREAM: Final = 2  # of random numbers from a seed; 1 is for the orders of objects


class Draws:
    """A split on the device and the order in which its objects come.

    Each object, and each group of made pieces, comes once per epoch as one of all its views, half of them mirrored;
    of an object's draws `config.own_share` are set aside for its own shape.
    """

    def __init__(self, tensors: Tensors, grounds: Grounds, config: TrainConfig, compiled: bool = False) -> None:
        self.tensors = tensors
        self.grounds = grounds
        self.config = config
        self._augment = torch.compile(augment) if compiled else augment
        self._orders: dict[int, Tensor] = {}

    def units(self, step: int) -> Tensor:
        """Return the objects of a step, (batch,) int64: every object once per epoch, in an order of its own."""
        count, batch = len(self.tensors.units), self.config.batch
        first, last = step * batch // count, ((step + 1) * batch - 1) // count
        self._orders = {epoch: self._order(epoch) for epoch in range(first, last + 1)}
        start = step * batch - first * count
        return torch.cat(list(self._orders.values()))[start : start + batch]

    def _order(self, epoch: int) -> Tensor:
        if epoch in self._orders:
            return self._orders[epoch]
        rng = np.random.default_rng([self.config.seed, 1, epoch])
        return torch.from_numpy(rng.permutation(len(self.tensors.units))).to(self.tensors.units.device)

    def batch(self, units: Tensor, points: int, target_points: int, light: Light = ANY_LIGHT) -> Batch:
        """Draw a view of each unit, or a part of it, and what belongs to it, from torch's default generator."""
        device, b = units.device, len(units)
        view = self._views(units)
        mirrored = (torch.rand(b, device=device) < 0.5) & self.config.augmented
        images = None if self.config.encoder.takes_points else self._images(view, mirrored, light)
        number = max(target_points, SURFACE) if images is None else target_points
        shape = self.tensors.shape_of[view]
        count, start = self.tensors.counts[shape].view(b, 1), self.tensors.starts[shape].view(b, 1)
        offset = (torch.rand(b, 1, device=device) * count).long()
        index = start + (offset + torch.arange(number, device=device)) % count  # (b, number)
        side = torch.where(mirrored, -1.0, 1.0).view(b, 1, 1)  # left and right exchanged: x negated
        true = in_frame(self.config.frame, dequantize(self.tensors.points[index]), self.tensors, view)
        true = torch.cat([true[..., :1] * side, true[..., 1:]], dim=2)
        canonical = uniform_points(self.config.spec.domain, b, points, device)
        if images is None:
            config = replace(self.config, target_points=target_points)
            return parts_batch(true, canonical, config, draw_counts(b, MOST_POINTS, device), MOST_POINTS)
        colors = None if self.tensors.colors is None else self.tensors.colors[index]
        return Batch(images, canonical, true, colors)

    def _images(self, view: Tensor, mirrored: Tensor, light: Light) -> Tensor:
        size, crops = self.config.framing.size, self.tensors.images[view]
        is_augmented = self.config.augmented
        images = self._augment(crops, size, self.grounds, light) if is_augmented else plain_images(crops, size)
        # augmentation knows no left and right
        return torch.where(mirrored.view(-1, 1, 1, 1), images.flip(3), images)

    def _views(self, units: Tensor) -> Tensor:
        """Return a random view of each unit, (b,) -> (b,) int64."""
        first, own_end, end = self.tensors.units[units].unbind(1)
        device = units.device
        is_own = (torch.rand(len(units), device=device) < self.config.own_share) & (own_end > first)
        count = torch.where(is_own, own_end, end) - first
        drawn = (torch.rand(len(units), device=device, dtype=torch.float64) * count).long()
        return first + torch.minimum(drawn, count - 1)


def in_frame(frame: Frame, points: Tensor, tensors: Tensors, views: Tensor) -> Tensor:
    """Return points (b, m, 3) of the object frame in a frame, that of the views' (b,) cameras or the object's.

    Raises
    ------
    ValueError : the camera's frame, and the data set has no cameras.
    """
    if frame == "object":
        return points
    if tensors.cameras is None:
        raise ValueError("--frame camera needs a data set that tells the cameras of all its views")
    return to_camera(points, tensors.cameras[views])


def seed_step(seed: int, step: int) -> None:
    """Seed torch's default generators for a step, so that its batch is a function of (seed, step) alone."""
    torch.manual_seed(int(np.random.SeedSequence([seed, STREAM, step]).generate_state(1)[0]))


def uniform_points(domain: Domain, b: int, n: int, device: torch.device) -> Tensor:
    """Draw points uniform in the canonical domain: (b, n, d) float32."""
    d = DOMAIN_DIMS[domain]
    if domain == "cube":
        return 2 * torch.rand(b, n, d, device=device) - 1
    direction = torch.randn(b, n, d, device=device)
    direction = nnf.normalize(direction, dim=2)
    if domain == "sphere":
        return direction
    return direction * torch.rand(b, n, 1, device=device).pow(1 / d)
