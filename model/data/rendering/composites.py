"""Pictures to learn mattes from: rendered objects in front of photographs, and which pixels are object."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.data.augment import (
    ANY_LIGHT,
    backgrounds,
    blur,
    load_photographs,
    noise,
    photograph_ground,
    shadows,
    tone,
    uniform,
)

NEAR_SHARE: Final = 0.5  # of the objects fill most of the picture, as in a crop around them
NEAR_ZOOM: Final = (0.65, 1.05)
FAR_ZOOM: Final = (0.2, 0.7)  # of the side, by the object's frame
SQUEEZE: Final = 1.5  # largest ratio of the scales across and along: photos are resized to a square
TURN_DEG: Final = 12.0
PAINTED_SHARE: Final = 0.3  # of the objects have a photograph as their material
EMPTY_SHARE: Final = 0.1  # of the pictures show no object
BESIDE_SHARE: Final = 0.2  # have another object in part, at their edge, which does not count
SURFACE_SHARE: Final = 0.5  # of the grounds
FAINT_SHARE: Final = 0.3  # have a blurred ground
GROUNDS: Final = (0.1, 0.1, 0.15, 0.65)  # flat color, gradient, texture, photographs
NOISE: Final = 0.04

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Composites:
    """Views of objects to make pictures of.

    views : (n, S, S, 4) uint8 RGBA.
    photographs : files for materials, and for half of the grounds of large objects.
    scenery : files for half of the grounds of small objects: nothing in them stands out.
    surfaces : files for the other half: wood, stone, cloth; without them all grounds are photographs.
    """

    views: Bytes
    photographs: tuple[Path, ...]
    scenery: tuple[Path, ...]
    surfaces: tuple[Path, ...] = ()

    def draw(self, count: int, side: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Return pictures (count, 3, side, side) in [0, 1] and their mattes (count, 1, side, side) in [0, 1]."""
        near = torch.from_numpy(rng.random(count) < NEAR_SHARE)
        objects = self._placed(near, side, rng)
        objects[torch.from_numpy(rng.random(count) < EMPTY_SHARE)] = 0
        objects = blur(objects, rng)
        alpha = objects[:, 3:]
        rgb = self._lit(objects, rng)
        ground = self._beside(self._grounds(near, side, rng), side, rng) * shadows(alpha, rng)
        faint = torch.from_numpy(rng.random(count) < FAINT_SHARE)
        ground[faint] = nnf.avg_pool2d(ground[faint], 5, 1, 2, count_include_pad=False)
        picture = tone(rgb + (1 - alpha) * ground, ANY_LIGHT, rng)
        picture += noise(count, side, rng) * uniform(rng, 0, NOISE, (count, 1, 1, 1))
        return picture.clamp_(0, 1), alpha

    def _grounds(self, near: Tensor, side: int, rng: np.random.Generator) -> Tensor:
        """Return grounds (n, 3, side, side) for large objects, where `near` (n,), and small ones."""
        ground = torch.empty(len(near), 3, side, side)
        is_surface = torch.from_numpy(rng.random(len(near)) < (SURFACE_SHARE if self.surfaces else 0))
        for chosen, files in (
            (near & ~is_surface, self.photographs),
            (~near & ~is_surface, self.scenery),
            (is_surface, self.surfaces),
        ):
            ground[chosen] = backgrounds(int(chosen.sum()), side, rng, files, GROUNDS)
        return ground

    def _lit(self, objects: Tensor, rng: np.random.Generator) -> Tensor:
        """Return premultiplied colors of the objects, (b, 3, s, s), under another light, some with other materials."""
        rgb, alpha = objects[:, :3], objects[:, 3:]
        b, side = len(rgb), rgb.shape[-1]
        light = uniform(rng, *ANY_LIGHT.brightness, (b, 1, 1, 1)) * uniform(rng, *ANY_LIGHT.tint, (b, 3, 1, 1))
        rgb = rgb * light
        for index in np.flatnonzero(rng.random(b) < PAINTED_SHARE):
            material = photograph_ground(load_photographs(self.photographs, side), side, rng) * alpha[index]
            shade = rgb[index].mean(dim=0, keepdim=True)
            rgb[index] = torch.lerp(material * (0.5 + shade), rgb[index], float(rng.uniform(0, 0.6)))
        return torch.minimum(rgb, alpha)

    def _beside(self, ground: Tensor, side: int, rng: np.random.Generator) -> Tensor:
        """Return the grounds (b, 3, s, s), some with an object that the edge cuts."""
        chosen = torch.from_numpy(rng.random(len(ground)) < BESIDE_SHARE)
        count = int(chosen.sum())
        if count:
            angle = uniform(rng, 0, 2 * np.pi, count)
            shift = torch.stack([angle.cos(), angle.sin()], dim=1)
            shift = shift / shift.abs().amax(dim=1, keepdim=True) * uniform(rng, 0.95, 1.15, (count, 1))
            others = self._sampled(uniform(rng, 0.2, 0.5, count), shift, side, rng)
            ground[chosen] = others[:, :3] + (1 - others[:, 3:]) * ground[chosen]
        return ground

    def _placed(self, near: Tensor, side: int, rng: np.random.Generator) -> Tensor:
        """Return objects in the pictures, (n, 4, side, side), premultiplied: large ones where `near` (n,), or small."""
        count = len(near)
        low, high = np.log(FAR_ZOOM)
        zoom = torch.where(near, uniform(rng, *NEAR_ZOOM, count), uniform(rng, low, high, count).exp())
        room = torch.where(near, 0.08, (1.05 - zoom).clamp(min=0.08))[:, None]
        return self._sampled(zoom, uniform(rng, -1, 1, (count, 2)) * room, side, rng)

    def _sampled(self, zoom: Tensor, shift: Tensor, side: int, rng: np.random.Generator) -> Tensor:
        """Return random views, scaled to `zoom` (n,) of the side and moved by `shift` (n, 2) of half the side."""
        views = self.views[rng.integers(len(self.views), size=len(zoom))]
        pixels = torch.from_numpy(views).permute(0, 3, 1, 2).float().div_(255)
        pixels[:, :3] *= pixels[:, 3:]
        squeeze = (uniform(rng, -1, 1, len(zoom)) * float(np.log(SQUEEZE)) / 2).exp()
        turn = torch.deg2rad(uniform(rng, -TURN_DEG, TURN_DEG, len(zoom)))
        across, along = zoom * squeeze.clamp(max=1), zoom / squeeze.clamp(min=1)
        mirror = torch.from_numpy(np.where(rng.random(len(zoom)) < 0.5, -1.0, 1.0).astype(np.float32))
        cos, sin, zero = turn.cos(), turn.sin(), torch.zeros_like(turn)
        rotation = torch.stack([torch.stack([cos, sin], 1), torch.stack([-sin, cos], 1)], 1)
        scale = torch.stack([torch.stack([mirror / across, zero], 1), torch.stack([zero, 1 / along], 1)], 1)
        linear = scale @ rotation
        matrix = torch.cat([linear, -linear @ shift[:, :, None]], dim=2)
        half = nnf.avg_pool2d(pixels, 2)
        small = torch.minimum(across, along) * side < 0.6 * pixels.shape[-1]
        placed = torch.empty(len(zoom), 4, side, side)
        for source, chosen in ((pixels, ~small), (half, small)):
            count = int(chosen.sum())
            if count:
                grid = nnf.affine_grid(matrix[chosen], [count, 4, side, side], align_corners=False)
                placed[chosen] = nnf.grid_sample(source[chosen], grid, align_corners=False)
        return placed
