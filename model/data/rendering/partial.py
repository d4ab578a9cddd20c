"""Partial surfaces: what a scanner sees of an object, as the input of a point encoder. Drawn anew at each step.

Half of them are the points of an object on one side of a plane, half those that a camera sees. Each is centered and
scaled by its own box, as the service does with a user's points (`service.encoding.clouds`), and so are the true points:
the function completes the object in the frame of the part.
"""

import math
from dataclasses import dataclass
from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor

from service.encoding.clouds import LEAST_POINTS, LEAST_SIDE, MOST_POINTS

SURFACE: Final = 4_096  # points of an object that a part is cut from
LEAST_SHARE: Final = 0.25  # of the points on the kept side of a plane; a camera sees what it sees
NOISE: Final = 0.01  # largest standard deviation, longest sides
GRID: Final = 32  # cells per side of a depth image
REACH: Final = 0.9  # half of that side, longest sides: half the diagonal of the object frame's cube, rounded up
DEPTH: Final = 0.06  # tolerance behind the nearest point of the cells around: depth of a slope


@dataclass(frozen=True)
class Parts:
    """Parts of surfaces, each in the frame of its own box.

    clouds : (b, n, 3), box centered at the origin, its longest side 1.
    center : (b, 1, 3), of the box, in the object frame.
    scale : (b, 1, 1), longest side of the box, in longest sides of the object.
    """

    clouds: Tensor
    center: Tensor
    scale: Tensor


def draw_parts(surface: Tensor, counts: Tensor, width: int, generator: torch.Generator | None = None) -> Parts:
    """Draw a part of each surface.

    Parameters
    ----------
    surface : (b, m, 3), points of whole objects, in random order.
    counts : (b,) int64, number of points of each part; fewer where a part has fewer.
    width : columns of the result; a part with fewer points repeats them, which a maximum over points does not see.
    generator : of random numbers; torch's default one without.
    """
    b, m, _ = surface.shape
    uniform = torch.rand(b, 3, device=surface.device, generator=generator)
    toward = torch.randn(b, 3, device=surface.device, generator=generator)
    share = LEAST_SHARE + (1 - LEAST_SHARE) * uniform[:, :1]
    kept = torch.where(uniform[:, 1:2] < 0.5, on_one_side(surface, toward, share), seen_from(surface, toward))
    scores = torch.rand(b, m, device=surface.device, generator=generator).masked_fill(~kept, -1)
    order = scores.argsort(dim=1, descending=True)
    count = torch.minimum(counts, kept.sum(dim=1)).clamp(min=1).unsqueeze(1)
    index = order.gather(1, torch.arange(width, device=surface.device) % count)  # (b, width)
    clouds = surface.gather(1, index.unsqueeze(2).expand(-1, -1, 3))
    noise = torch.randn(b, m, 3, device=surface.device, generator=generator)  # of each point, repeated with it
    noise = noise.gather(1, index.unsqueeze(2).expand(-1, -1, 3))
    return in_own_box(clouds + NOISE * uniform[:, 2].view(b, 1, 1) * noise)


def draw_counts(b: int, most: int, device: torch.device, generator: torch.Generator | None = None) -> Tensor:
    """Draw numbers of points of parts, from LEAST_POINTS to `most`, uniform in their logarithm: (b,) int64."""
    exponents = torch.rand(b, device=device, generator=generator) * math.log(most / LEAST_POINTS)
    return (LEAST_POINTS * exponents.exp()).long().clamp(max=most)


def fixed_parts(surface: Tensor, seed: int) -> Parts:
    """Draw parts of surfaces (b, m, 3) for validation: the same for the same seed."""
    device = surface.device
    generator = torch.Generator(device).manual_seed(seed)
    chosen = torch.randperm(surface.shape[1], device=device, generator=generator)[:SURFACE]
    counts = draw_counts(len(surface), MOST_POINTS, device, generator)
    return draw_parts(surface[:, chosen], counts, MOST_POINTS, generator)


def in_own_box(clouds: Tensor) -> Parts:
    """Center and scale clouds (b, n, 3) by their own boxes."""
    low, high = clouds.amin(dim=1, keepdim=True), clouds.amax(dim=1, keepdim=True)
    center = (low + high) / 2
    scale = (high - low).amax(dim=2, keepdim=True).clamp(min=LEAST_SIDE)
    return Parts((clouds - center) / scale, center, scale)


def on_one_side(surface: Tensor, toward: Tensor, share: Tensor) -> Tensor:
    """Return which points are the `share` (b, 1) farthest along `toward` (b, 3): (b, m) bool."""
    ranks = torch.bmm(surface, toward.unsqueeze(2)).squeeze(2).argsort(dim=1, descending=True).argsort(dim=1)
    return ranks < share * surface.shape[1]


def seen_from(surface: Tensor, toward: Tensor) -> Tensor:
    """Return which points a distant camera in the direction `toward` (b, 3) sees: (b, m) bool."""
    b = len(surface)
    toward = nnf.normalize(toward, dim=1)
    shortest = toward.abs().argmin(dim=1, keepdim=True)
    least = (torch.arange(3, device=toward.device) == shortest).to(
        toward.dtype
    )  # an axis far from parallel to `toward`
    right = nnf.normalize(torch.linalg.cross(least, toward), dim=1)
    axes = torch.stack([right, torch.linalg.cross(toward, right), toward], dim=2)  # (b, 3, 3)
    across, along, depth = torch.bmm(surface, axes).unbind(2)
    column, row = (((each / (2 * REACH) + 0.5) * GRID).long().clamp(0, GRID - 1) for each in (across, along))
    cells = row * GRID + column  # (b, m)
    nearest = depth.new_full((b, GRID * GRID), -REACH).scatter_reduce(1, cells, depth, "amax")
    around = nnf.max_pool2d(nearest.view(b, 1, GRID, GRID), 3, stride=1, padding=1).view(b, -1)
    return depth > around.gather(1, cells) - DEPTH


def turned(points: Tensor, degrees: Tensor) -> Tensor:
    """Turn points (b, n, 3) about +Y by `degrees` (b,)."""
    angles = torch.deg2rad(degrees)
    zero, one = torch.zeros_like(angles), torch.ones_like(angles)
    cos, sin = angles.cos(), angles.sin()
    rows = [torch.stack(row, dim=1) for row in ((cos, zero, sin), (zero, one, zero), (-sin, zero, cos))]
    return torch.bmm(points, torch.stack(rows, dim=1).transpose(1, 2))


def stretched(points: Tensor, largest: float, generator: torch.Generator | None = None) -> Tensor:
    """Stretch points (b, n, 3) along each axis by a factor from 1 / `largest` to `largest`; longest sides become 1."""
    exponents = 2 * torch.rand(len(points), 1, 3, device=points.device, generator=generator) - 1
    points = points * largest**exponents
    sides = points.amax(dim=1, keepdim=True) - points.amin(dim=1, keepdim=True)
    return points / sides.amax(dim=2, keepdim=True)
