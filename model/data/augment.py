"""What a photo does to a rendered view: framing, light, background, shadow, blur, noise. Cheap enough per step."""

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

PLAIN_SHARE: Final = 0.45  # of the images stand on white, as the service's masked ones do
ZOOM: Final = (0.88, 1.1)
LOOSE_ZOOM: Final = (0.6, 1.15)  # before a background: no mask tells where the object ends
CUT_SHARE: Final = 0.04
CUT_ZOOM: Final = 1.3  # times: the object then sticks out of the frame
SHIFT: Final = 0.06  # of the half frame, either way
SHADOW_SHARE: Final = 0.4
NOISE: Final = 0.03  # largest standard deviation
PHOTOGRAPH_SCALES: Final = (1.2, 2.0, 4.0)  # of the shorter side, in sides of the frame
GROUND_SHARES: Final = (0.15, 0.15, 0.2, 0.5)  # flat colour, gradient, texture, photographs
COLLAGE_SHARE: Final = 0.5  # of the grounds of photographs: two that meet at a line, as wall and floor do
TEXTURES: Final = 32
TEXTURE_CONTRAST: Final = (0.03, 0.2)  # standard deviation


@dataclass(frozen=True)
class Light:
    """How far an image's colours may be from the view's: ranges of factors on the object's brightness, on each
    of its channels and on the image's saturation, the share of grey images, the strength of the tone curve, and the
    share of objects with a texture over them."""

    brightness: tuple[float, float]
    tint: tuple[float, float]
    saturation: tuple[float, float]
    grey_share: float
    curve: float
    textured_share: float


ANY_LIGHT: Final = Light((0.5, 1.4), (0.85, 1.15), (0.4, 1.4), 0.1, 0.8, 0.15)  # geometry is the same in all of them
WHITE_LIGHT: Final = Light((0.9, 1.1), (0.97, 1.03), (0.9, 1.1), 0.0, 0.15, 0.0)  # which leaves colours to be told


def oversize(size: int) -> int:
    """How many pixels a stored crop has per pixel of an encoder's input of `size`: 2 where the renders hold so many."""
    return 2 if 2 * size <= SIZE else 1


def augment(
    crops: Tensor, size: int, rng: np.random.Generator, photographs: tuple[Path, ...], light: Light = ANY_LIGHT
) -> Tensor:
    """Views as if photographed: (b, 4, S, S) uint8 RGBA, S = oversize(size) * size -> (b, 3, size, size) in [0, 1].

    `photographs` are files whose pieces stand behind some of the objects.
    """
    b = len(crops)
    plain = torch.from_numpy(rng.random(b) < PLAIN_SHARE).view(b, 1, 1, 1)
    moved = _blurred(_framed(crops, size, plain, rng), rng)
    rgb, alpha = moved[:, :3], moved[:, 3:]
    strength = _uniform(rng, *light.brightness, (b, 1, 1, 1)) * _uniform(rng, *light.tint, (b, 3, 1, 1))
    lit = torch.minimum(_textured(rgb * strength, light.textured_share, rng), alpha)
    ground = torch.ones_like(lit)
    busy = ~plain.flatten()
    ground[busy] = _backgrounds(int(busy.sum()), lit.shape[-1], rng, photographs)
    ground *= _shadows(alpha, rng)
    image = _toned(lit + (1 - alpha) * ground, light, rng)
    noise = _noise(b, lit.shape[-1], rng) * _uniform(rng, 0, NOISE, (b, 1, 1, 1))
    return (image + noise * torch.where(plain, alpha, 1.0)).clamp_(0, 1)


def _framed(crops: Tensor, size: int, plain: Tensor, rng: np.random.Generator) -> Tensor:
    """Premultiplied RGBA in [0, 1] at the encoder's size, the object zoomed and shifted."""
    b = len(crops)
    pixels = torch.empty(crops.shape).copy_(crops)
    pixels[:, :3] *= pixels[:, 3:] / 255
    zoom = torch.where(plain.flatten(), _uniform(rng, *ZOOM, b), _uniform(rng, *LOOSE_ZOOM, b))
    zoom = zoom * torch.from_numpy(np.where(rng.random(b) < CUT_SHARE, CUT_ZOOM, 1).astype(np.float32))
    matrix = torch.zeros(b, 2, 3)
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1 / zoom
    matrix[:, :, 2] = _uniform(rng, -SHIFT, SHIFT, (b, 2))
    # at zoom 1 and twice the size an output pixel lies between four stored ones: sampling there is their mean
    grid = nnf.affine_grid(matrix, [b, 4, size, size], align_corners=False)
    return nnf.grid_sample(pixels, grid, align_corners=False) / 255


def _textured(rgb: Tensor, share: float, rng: np.random.Generator) -> Tensor:
    """A share of the images darker and lighter by a texture: weave, grain, dirt, a print."""
    for index in np.flatnonzero(rng.random(len(rgb)) < share):
        texture = _piece(_textures(rgb.shape[-1]), rgb.shape[-1], rng)
        rgb[index] *= (1 + rng.uniform(*TEXTURE_CONTRAST) * texture).clamp(min=0)
    return rgb


def _blurred(image: Tensor, rng: np.random.Generator) -> Tensor:
    """About half of the images blurred, by a kernel of 3 x 3 pixels (1 - 2w, w, w) of random w up to 1/4 each way."""
    chosen = torch.from_numpy(rng.random(len(image)) < 0.5)
    some = image[chosen]
    share = _uniform(rng, 0, 0.25, (len(some), 1, 1, 1))
    for axis in (2, 3):
        inner = some.narrow(axis, 1, some.shape[axis] - 2)
        beside = some.narrow(axis, 0, inner.shape[axis]) + some.narrow(axis, 2, inner.shape[axis])
        some = some.clone()
        some.narrow(axis, 1, inner.shape[axis]).copy_(inner + share * (beside - 2 * inner))
    image[chosen] = some
    return image


def _toned(image: Tensor, light: Light, rng: np.random.Generator) -> Tensor:
    """Saturation (none in the share of grey images) and a tone curve; white stays white, black black."""
    b = len(image)
    saturation = _uniform(rng, *light.saturation, (b, 1, 1, 1))
    saturation[torch.from_numpy(rng.random(b) < light.grey_share)] = 0
    toned = torch.lerp(image.mean(dim=1, keepdim=True), image, saturation).clamp_(0, 1)
    curve = _uniform(rng, -light.curve, light.curve, (b, 1, 1, 1))  # at 0.8 close to gammas of 2 to 0.6
    return toned + curve * toned * (1 - toned)


def _shadows(alpha: Tensor, rng: np.random.Generator) -> Tensor:
    """(b, 1, h, w) what light is left: a soft ellipse below the object darkens SHADOW_SHARE of the grounds."""
    b, _, height, width = alpha.shape
    y, x = torch.linspace(-1, 1, height).view(1, 1, -1, 1), torch.linspace(-1, 1, width).view(1, 1, 1, -1)
    rows, columns = alpha.amax(dim=3, keepdim=True) > 0.5, alpha.amax(dim=2, keepdim=True) > 0.5
    bottom = torch.where(rows, y, -1.0).amax(dim=2, keepdim=True)
    left = torch.where(columns, x, 1.0).amin(dim=3, keepdim=True)
    right = torch.where(columns, x, -1.0).amax(dim=3, keepdim=True)
    half = (right - left).clamp(min=0.1) / 2 * _uniform(rng, 0.7, 1.3, (b, 1, 1, 1))
    flat = half * _uniform(rng, 0.15, 0.4, (b, 1, 1, 1))
    middle = (left + right) / 2 + half * _uniform(rng, -0.3, 0.3, (b, 1, 1, 1))
    depth = _uniform(rng, 0.15, 0.7, (b, 1, 1, 1))
    depth[torch.from_numpy(rng.random(b) >= SHADOW_SHARE)] = 0
    across, along = torch.exp(-(((x - middle) / half) ** 2)), torch.exp(-(((y - bottom) / flat + 0.5) ** 2))
    return 1 - depth * across * along


def _backgrounds(count: int, side: int, rng: np.random.Generator, photographs: tuple[Path, ...]) -> Tensor:
    """(count, 3, side, side): flat colours, gradients, textures of coloured noise, pieces of photographs."""
    kind = rng.choice(len(GROUND_SHARES), size=count, p=GROUND_SHARES)
    first, second = _uniform(rng, 0, 1, (2, count, 3, 1, 1))
    angle = _uniform(rng, 0, 2 * np.pi, (count, 1, 1, 1))
    y, x = torch.linspace(-0.5, 0.5, side).view(1, 1, -1, 1), torch.linspace(-0.5, 0.5, side)
    ramp = ((x * angle.cos() + y * angle.sin()) / 1.42 + 0.5) * torch.from_numpy(kind > 0).view(count, 1, 1, 1)
    ground = torch.lerp(first, second, ramp)
    for index in np.flatnonzero(kind == 2):
        ground[index] += rng.uniform(*TEXTURE_CONTRAST) * _piece(_textures(side), side, rng)
    for index in np.flatnonzero(kind == 3):
        ground[index] = _photographed(_photographs(photographs, side), side, rng)
    return ground.clamp_(0, 1)


def _photographed(photographs: list[Tensor], side: int, rng: np.random.Generator) -> Tensor:
    """(3, side, side): a piece of a photograph or two of them, in colours that may not be its own."""
    piece = _recoloured(_piece(photographs, side, rng), rng)
    if rng.random() < COLLAGE_SHARE:
        line, edge = int(rng.integers(side)), int(rng.integers(1, 3))
        other = _recoloured(_piece(photographs, side, rng), rng)
        piece.narrow(edge, 0, line).copy_(other.narrow(edge, 0, line))
    return piece


def _recoloured(piece: Tensor, rng: np.random.Generator) -> Tensor:
    """Half of the pieces with their channels in another order, each lit by a colour of its own."""
    order = rng.permutation(3).tolist() if rng.random() < 0.5 else [0, 1, 2]
    return piece[order] * _uniform(rng, 0.5, 1.3, (3, 1, 1))


def _noise(count: int, side: int, rng: np.random.Generator) -> Tensor:
    """(count, 3, side, side) of unit variance: pieces of a fixed store, which costs less than fresh numbers."""
    store, numbers = _normal_numbers(), 3 * side * side
    starts = rng.integers(len(store) - numbers, size=count).tolist()
    return torch.stack([store[start : start + numbers] for start in starts]).view(count, 3, side, side)


def _piece(pictures: list[Tensor], side: int, rng: np.random.Generator) -> Tensor:
    """(3, side, side) a random square of a random picture, perhaps flipped."""
    picture = pictures[rng.integers(len(pictures))]
    top, left = (int(rng.integers(length - side + 1)) for length in picture.shape[1:])
    piece = picture[:, top : top + side, left : left + side]
    return piece.flip(2) if rng.random() < 0.5 else piece


@functools.cache
def _normal_numbers() -> Tensor:
    return torch.from_numpy(np.random.default_rng(0).standard_normal(1 << 20, np.float32))


@functools.cache
def _textures(side: int) -> list[Tensor]:
    """Noise about 0, (3, 3 * side, 3 * side), of several octaves in shares that differ per texture, a little
    coloured."""
    rng, textures = np.random.default_rng(0), []
    for _ in range(TEXTURES):
        total = torch.zeros(1, 3, 3 * side, 3 * side)
        for cells in (side // 4, side // 2, side, 3 * side // 2, 3 * side):
            grey, coloured = rng.standard_normal((1, 1, cells, cells)), rng.standard_normal((1, 3, cells, cells))
            octave = torch.from_numpy(rng.random() * (grey + 0.4 * coloured)).float()
            total += nnf.interpolate(octave, total.shape[2:], mode="bilinear", align_corners=False)
        textures.append(total[0] / total.std())
    return textures


@functools.cache
def _photographs(paths: tuple[Path, ...], side: int) -> list[Tensor]:
    """RGB, (3, height, width), each in several sizes."""
    photographs = []
    for path in paths:
        with Image.open(path) as file:
            photograph = file.convert("RGB")
        for scale in PHOTOGRAPH_SCALES:
            factor = scale * side / min(photograph.size)
            resized = photograph.resize([round(length * factor) for length in photograph.size])
            photographs.append(torch.from_numpy(np.array(resized)).permute(2, 0, 1).float() / 255)
    return photographs


def _uniform(rng: np.random.Generator, low: float, high: float, shape: int | tuple[int, ...]) -> Tensor:
    return torch.from_numpy(rng.uniform(low, high, shape).astype(np.float32))
