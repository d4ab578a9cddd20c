"""Make rendered views look like photos: framing, light, background, shadow, blur, noise. Cheap enough per step."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
import torch.nn.functional as nnf
from PIL import Image
from torch import Tensor

from model.data.manifest import SIZE

PLAIN_SHARE: Final = 0.45  # of the images: on white, like the masked images of the service
ZOOM: Final = (0.88, 1.1)
LOOSE_ZOOM: Final = (0.6, 1.15)  # in front of a background, where no mask shows the object's edge
CUT_SHARE: Final = 0.04
CUT_ZOOM: Final = 1.3  # factor that pushes the object out of the frame
SHIFT: Final = 0.06  # of the half frame, either way
SHADOW_SHARE: Final = 0.4
NOISE: Final = 0.03  # largest standard deviation
PHOTOGRAPH_SCALES: Final = (1.2, 2.0, 4.0)  # of the shorter side, in sides of the frame
GROUND_SHARES: Final = (0.15, 0.15, 0.2, 0.5)  # flat color, gradient, texture, photographs
COLLAGE_SHARE: Final = 0.5  # of the photograph grounds: two photographs that meet at a line, as wall and floor do
TEXTURES: Final = 32
TEXTURE_CONTRAST: Final = (0.03, 0.2)  # standard deviation


@dataclass(frozen=True)
class Light:
    """Limits of the changes to a view's colors.

    brightness, tint, saturation : ranges of factors on the object's brightness, on each of its channels and on the
        image's saturation.
    gray_share, textured_share : shares of gray images, and of objects with a texture over them.
    curve : strength of the tone curve.
    """

    brightness: tuple[float, float]
    tint: tuple[float, float]
    saturation: tuple[float, float]
    gray_share: float
    curve: float
    textured_share: float


ANY_LIGHT: Final = Light((0.5, 1.4), (0.85, 1.15), (0.4, 1.4), 0.1, 0.8, 0.15)  # geometry stays the same
WHITE_LIGHT: Final = Light((0.9, 1.1), (0.97, 1.03), (0.9, 1.1), 0.0, 0.15, 0.0)  # colors stay recognizable


def oversize(size: int) -> int:
    """Return the pixels of a stored crop per pixel of an encoder's input of `size`: 2 if the renders have that many."""
    return 2 if 2 * size <= SIZE else 1


def augment(
    crops: Tensor,
    size: int,
    rng: np.random.Generator,
    photographs: tuple[Path, ...],
    light: Light = ANY_LIGHT,
    shares: tuple[float, ...] = (PLAIN_SHARE, *GROUND_SHARES),
) -> Tensor:
    """Augment views: (b, 4, S, S) uint8 RGBA, S = oversize(size) * size -> (b, 3, size, size) in [0, 1].

    Parameters
    ----------
    photographs : files; crops of them are the backgrounds of some objects.
    shares : of images on white; and of the others, as `backgrounds` takes them.
    """
    b = len(crops)
    plain = torch.from_numpy(rng.random(b) < shares[0]).view(b, 1, 1, 1)
    views = blur(_frame(crops, size, plain, rng), rng)
    rgb, alpha = views[:, :3], views[:, 3:]
    strength = uniform(rng, *light.brightness, (b, 1, 1, 1)) * uniform(rng, *light.tint, (b, 3, 1, 1))
    lit = torch.minimum(_add_texture(rgb * strength, light.textured_share, rng), alpha)
    ground = torch.ones_like(lit)
    busy = ~plain.flatten()
    ground[busy] = backgrounds(int(busy.sum()), lit.shape[-1], rng, photographs, shares[1:])
    ground *= shadows(alpha, rng)
    image = tone(lit + (1 - alpha) * ground, light, rng)
    grain = noise(b, lit.shape[-1], rng) * uniform(rng, 0, NOISE, (b, 1, 1, 1))
    return (image + grain * torch.where(plain, alpha, 1.0)).clamp_(0, 1)


def _frame(crops: Tensor, size: int, plain: Tensor, rng: np.random.Generator) -> Tensor:
    """Zoom and shift the objects; return premultiplied RGBA in [0, 1] at the encoder's size."""
    b = len(crops)
    pixels = torch.empty(crops.shape).copy_(crops)
    pixels[:, :3] *= pixels[:, 3:] / 255
    zoom = torch.where(plain.flatten(), uniform(rng, *ZOOM, b), uniform(rng, *LOOSE_ZOOM, b))
    zoom = zoom * torch.from_numpy(np.where(rng.random(b) < CUT_SHARE, CUT_ZOOM, 1).astype(np.float32))
    matrix = torch.zeros(b, 2, 3)
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1 / zoom
    matrix[:, :, 2] = uniform(rng, -SHIFT, SHIFT, (b, 2))
    # at zoom 1 and twice the size, an output pixel lies between four stored ones: sampling returns their mean
    grid = nnf.affine_grid(matrix, [b, 4, size, size], align_corners=False)
    return nnf.grid_sample(pixels, grid, align_corners=False) / 255


def _add_texture(rgb: Tensor, share: float, rng: np.random.Generator) -> Tensor:
    """Lay a texture over a share of the images: weave, grain, dirt, a print."""
    for index in np.flatnonzero(rng.random(len(rgb)) < share):
        texture = _crop(noise_textures(rgb.shape[-1]), rgb.shape[-1], rng)
        rgb[index] *= (1 + rng.uniform(*TEXTURE_CONTRAST) * texture).clamp(min=0)
    return rgb


def blur(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Blur about half of the images by a 3 x 3 kernel (w, 1 - 2w, w) each way, w random up to 1/4."""
    chosen = torch.from_numpy(rng.random(len(image)) < 0.5)
    some = image[chosen]
    share = uniform(rng, 0, 0.25, (len(some), 1, 1, 1))
    for axis in (2, 3):
        inner = some.narrow(axis, 1, some.shape[axis] - 2)
        beside = some.narrow(axis, 0, inner.shape[axis]) + some.narrow(axis, 2, inner.shape[axis])
        some = some.clone()
        some.narrow(axis, 1, inner.shape[axis]).copy_(inner + share * (beside - 2 * inner))
    image[chosen] = some
    return image


def tone(image: Tensor, light: Light, rng: np.random.Generator) -> Tensor:
    """Change saturation (to none in the share of gray images) and tone; white stays white, black stays black."""
    b = len(image)
    saturation = uniform(rng, *light.saturation, (b, 1, 1, 1))
    saturation[torch.from_numpy(rng.random(b) < light.gray_share)] = 0
    toned = torch.lerp(image.mean(dim=1, keepdim=True), image, saturation).clamp_(0, 1)
    curve = uniform(rng, -light.curve, light.curve, (b, 1, 1, 1))  # at 0.8 close to gammas of 2 to 0.6
    return toned + curve * toned * (1 - toned)


def shadows(alpha: Tensor, rng: np.random.Generator) -> Tensor:
    """Return the remaining light (b, 1, h, w): a soft ellipse below the object darkens SHADOW_SHARE of the grounds."""
    b, _, height, width = alpha.shape
    y, x = torch.linspace(-1, 1, height).view(1, 1, -1, 1), torch.linspace(-1, 1, width).view(1, 1, 1, -1)
    rows, columns = alpha.amax(dim=3, keepdim=True) > 0.5, alpha.amax(dim=2, keepdim=True) > 0.5
    bottom = torch.where(rows, y, -1.0).amax(dim=2, keepdim=True)
    left = torch.where(columns, x, 1.0).amin(dim=3, keepdim=True)
    right = torch.where(columns, x, -1.0).amax(dim=3, keepdim=True)
    half = (right - left).clamp(min=0.1) / 2 * uniform(rng, 0.7, 1.3, (b, 1, 1, 1))
    flat = half * uniform(rng, 0.15, 0.4, (b, 1, 1, 1))
    middle = (left + right) / 2 + half * uniform(rng, -0.3, 0.3, (b, 1, 1, 1))
    depth = uniform(rng, 0.15, 0.7, (b, 1, 1, 1))
    depth[torch.from_numpy(rng.random(b) >= SHADOW_SHARE)] = 0
    across, along = torch.exp(-(((x - middle) / half) ** 2)), torch.exp(-(((y - bottom) / flat + 0.5) ** 2))
    return 1 - depth * across * along


def backgrounds(
    count: int,
    side: int,
    rng: np.random.Generator,
    photographs: tuple[Path, ...],
    shares: tuple[float, ...] = GROUND_SHARES,
) -> Tensor:
    """Return backgrounds (count, 3, side, side): flat colors, gradients, colored noise, crops of photographs."""
    kind = rng.choice(len(shares), size=count, p=shares)
    first, second = uniform(rng, 0, 1, (2, count, 3, 1, 1))
    angle = uniform(rng, 0, 2 * np.pi, (count, 1, 1, 1))
    y, x = torch.linspace(-0.5, 0.5, side).view(1, 1, -1, 1), torch.linspace(-0.5, 0.5, side)
    ramp = ((x * angle.cos() + y * angle.sin()) / 1.42 + 0.5) * torch.from_numpy(kind > 0).view(count, 1, 1, 1)
    ground = torch.lerp(first, second, ramp)
    for index in np.flatnonzero(kind == 2):
        ground[index] += rng.uniform(*TEXTURE_CONTRAST) * _crop(noise_textures(side), side, rng)
    for index in np.flatnonzero(kind == 3):
        ground[index] = photograph_ground(load_photographs(photographs, side), side, rng)
    return ground.clamp_(0, 1)


def photograph_ground(photographs: list[Tensor], side: int, rng: np.random.Generator) -> Tensor:
    """Return a crop of one photograph or of two, (3, side, side), possibly recolored."""
    ground = _recolor(_crop(photographs, side, rng), rng)
    if rng.random() < COLLAGE_SHARE:
        line, edge = int(rng.integers(side)), int(rng.integers(1, 3))
        other = _recolor(_crop(photographs, side, rng), rng)
        ground.narrow(edge, 0, line).copy_(other.narrow(edge, 0, line))
    return ground


def _recolor(crop: Tensor, rng: np.random.Generator) -> Tensor:
    """Shuffle the channels of half of the crops, and tint each crop."""
    order = rng.permutation(3).tolist() if rng.random() < 0.5 else [0, 1, 2]
    return crop[order] * uniform(rng, 0.5, 1.3, (3, 1, 1))


def noise(count: int, side: int, rng: np.random.Generator) -> Tensor:
    """Return noise of unit variance, (count, 3, side, side), cut from a fixed store: cheaper than fresh numbers."""
    store, numbers = _normal_numbers(), 3 * side * side
    starts = rng.integers(len(store) - numbers, size=count).tolist()
    return torch.stack([store[start : start + numbers] for start in starts]).view(count, 3, side, side)


def _crop(pictures: list[Tensor], side: int, rng: np.random.Generator) -> Tensor:
    """Return a random square of a random picture, (3, side, side), flipped half of the time."""
    picture = pictures[rng.integers(len(pictures))]
    top, left = (int(rng.integers(length - side + 1)) for length in picture.shape[1:])
    square = picture[:, top : top + side, left : left + side]
    return square.flip(2) if rng.random() < 0.5 else square


@functools.cache
def _normal_numbers() -> Tensor:
    return torch.from_numpy(np.random.default_rng(0).standard_normal(1 << 20, np.float32))


@functools.cache
def noise_textures(side: int) -> list[Tensor]:
    """Return textures of slightly colored noise around 0, (3, 3 * side, 3 * side), octaves weighted per texture."""
    rng, textures = np.random.default_rng(0), []
    for _ in range(TEXTURES):
        total = torch.zeros(1, 3, 3 * side, 3 * side)
        for cells in (side // 4, side // 2, side, 3 * side // 2, 3 * side):
            gray, colored = rng.standard_normal((1, 1, cells, cells)), rng.standard_normal((1, 3, cells, cells))
            octave = torch.from_numpy(rng.random() * (gray + 0.4 * colored)).float()
            total += nnf.interpolate(octave, total.shape[2:], mode="bilinear", align_corners=False)
        textures.append(total[0] / total.std())
    return textures


@functools.cache
def load_photographs(paths: tuple[Path, ...], side: int) -> list[Tensor]:
    """Load photographs as RGB, (3, height, width), each at several sizes."""
    photographs = []
    for path in paths:
        with Image.open(path) as file:
            photograph = file.convert("RGB")
        for scale in PHOTOGRAPH_SCALES:
            factor = scale * side / min(photograph.size)
            resized = photograph.resize([round(length * factor) for length in photograph.size])
            photographs.append(torch.from_numpy(np.array(resized)).permute(2, 0, 1).float() / 255)
    return photographs


def uniform(rng: np.random.Generator, low: float, high: float, shape: int | tuple[int, ...]) -> Tensor:
    """Return numbers uniform between two limits, float32."""
    return torch.from_numpy(rng.uniform(low, high, shape).astype(np.float32))
