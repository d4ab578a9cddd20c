"""Augmentation of a whole batch on any device, as `model.data.augment` does it view by view.

The same families of changes with the same distributions. Every image is computed each way and the result selected,
so that shapes are fixed and no step waits for the host. Random numbers come from torch's default generator.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.data import augment as cpu
from model.data.augment import ANY_LIGHT, Light
from model.training.device.pictures import Pictures


@dataclass(frozen=True)
class Grounds:
    """Pictures that stand behind objects, at one frame size; without photographs textures take their place."""

    textures: Pictures
    photographs: Pictures | None


def augment(crops: Tensor, size: int, grounds: Grounds, light: Light = ANY_LIGHT) -> Tensor:
    """Turn views into photographs: (b, S, S, 4) uint8 RGBA -> (b, 3, size, size) float32 in [0, 1]."""
    b, device = len(crops), crops.device
    plain = _chance(cpu.PLAIN_SHARE, b, device)
    moved = _blurred(_framed(crops, size, plain))
    rgb, alpha = moved[:, :3], moved[:, 3:]
    strength = _uniform(light.brightness, (b, 1, 1, 1), device) * _uniform(light.tint, (b, 3, 1, 1), device)
    lit = rgb * strength
    if light.textured_share:
        lit = _textured(lit, light.textured_share, grounds.textures)
    lit = torch.minimum(lit, alpha)
    ground = torch.where(plain, 1.0, _backgrounds(b, size, grounds)) * _shadows(alpha)
    image = _toned(lit + (1 - alpha) * ground, light)
    noise = torch.randn(image.shape, device=device) * _uniform((0, cpu.NOISE), (b, 1, 1, 1), device)
    return (image + noise * torch.where(plain, alpha, 1.0)).clamp(0, 1)


def _framed(crops: Tensor, size: int, plain: Tensor) -> Tensor:
    """Return premultiplied RGBA in [0, 1], (b, 4, size, size), with the object zoomed and shifted."""
    b, device = len(crops), crops.device
    pixels = crops.permute(0, 3, 1, 2).float() / 255
    pixels = torch.cat([pixels[:, :3] * pixels[:, 3:], pixels[:, 3:]], dim=1)
    shape = (b, 1, 1, 1)
    zoom = torch.where(plain, _uniform(cpu.ZOOM, shape, device), _uniform(cpu.LOOSE_ZOOM, shape, device))
    zoom = zoom * torch.where(_chance(cpu.CUT_SHARE, b, device), cpu.CUT_ZOOM, 1.0)
    shift = _uniform((-cpu.SHIFT, cpu.SHIFT), (b, 2), device)
    axis = (torch.arange(size, device=device) + 0.5) * (2 / size) - 1  # pixel centers, as in affine_grid
    across = axis.view(1, 1, -1) / zoom.view(b, 1, 1) + shift[:, 0].view(b, 1, 1)
    down = axis.view(1, -1, 1) / zoom.view(b, 1, 1) + shift[:, 1].view(b, 1, 1)
    grid = torch.stack([across.expand(b, size, size), down.expand(b, size, size)], dim=3)
    return nnf.grid_sample(pixels, grid, align_corners=False)


def _blurred(image: Tensor) -> Tensor:
    """Blur about half of the images: in rows and columns, each pixel gives random w, at most 1/4, to both neighbors."""
    b, device = len(image), image.device
    share = _uniform((0, 0.25), (b, 1, 1, 1), device) * _chance(0.5, b, device)
    for axis in (2, 3):
        last = image.shape[axis] - 1
        inner = image.narrow(axis, 1, last - 1)
        beside = image.narrow(axis, 0, last - 1) + image.narrow(axis, 2, last - 1)
        inner = inner + share * (beside - 2 * inner)
        image = torch.cat([image.narrow(axis, 0, 1), inner, image.narrow(axis, last, 1)], dim=axis)
    return image


def _textured(rgb: Tensor, share: float, textures: Pictures) -> Tensor:
    """Darken and lighten a share of the images by a texture."""
    b, device = len(rgb), rgb.device
    contrast = _uniform(cpu.TEXTURE_CONTRAST, (b, 1, 1, 1), device) * _chance(share, b, device)
    return rgb * (1 + contrast * textures.pieces(b, rgb.shape[-1])).clamp(min=0)


def _toned(image: Tensor, light: Light) -> Tensor:
    """Change saturation (to none in the share of gray images) and apply a tone curve that keeps black and white."""
    b, device = len(image), image.device
    saturation = _uniform(light.saturation, (b, 1, 1, 1), device) * ~_chance(light.gray_share, b, device)
    toned = torch.lerp(image.mean(dim=1, keepdim=True), image, saturation).clamp(0, 1)
    return toned + _uniform((-light.curve, light.curve), (b, 1, 1, 1), device) * toned * (1 - toned)


def _shadows(alpha: Tensor) -> Tensor:
    """Return the light that shadows leave, (b, 1, h, w): a soft ellipse below the object, for a share of the images."""
    b, _, height, width = alpha.shape
    device, shape = alpha.device, (len(alpha), 1, 1, 1)
    y = torch.linspace(-1, 1, height, device=device).view(1, 1, -1, 1)
    x = torch.linspace(-1, 1, width, device=device).view(1, 1, 1, -1)
    rows, columns = alpha.amax(dim=3, keepdim=True) > 0.5, alpha.amax(dim=2, keepdim=True) > 0.5
    bottom = torch.where(rows, y, -1.0).amax(dim=2, keepdim=True)
    left = torch.where(columns, x, 1.0).amin(dim=3, keepdim=True)
    right = torch.where(columns, x, -1.0).amax(dim=3, keepdim=True)
    half = (right - left).clamp(min=0.1) / 2 * _uniform((0.7, 1.3), shape, device)
    flat = half * _uniform((0.15, 0.4), shape, device)
    middle = (left + right) / 2 + half * _uniform((-0.3, 0.3), shape, device)
    depth = _uniform((0.15, 0.7), shape, device) * _chance(cpu.SHADOW_SHARE, b, device)
    across, along = torch.exp(-(((x - middle) / half) ** 2)), torch.exp(-(((y - bottom) / flat + 0.5) ** 2))
    return 1 - depth * across * along


def _backgrounds(count: int, side: int, grounds: Grounds) -> Tensor:
    """Draw backgrounds, (count, 3, side, side): flat colors, gradients, colored noise, pieces of photographs."""
    device, shape = grounds.textures.pixels.device, (count, 1, 1, 1)
    drawn = torch.rand(shape, device=device)
    flat, gradient, texture, _ = (sum(cpu.GROUND_SHARES[: index + 1]) for index in range(4))
    first, second = torch.rand(2, count, 3, 1, 1, device=device)
    angle = _uniform((0, 2 * torch.pi), shape, device)
    axis = torch.linspace(-0.5, 0.5, side, device=device)
    ramp = (axis.view(1, 1, 1, -1) * angle.cos() + axis.view(1, 1, -1, 1) * angle.sin()) / 1.42 + 0.5
    ground = torch.lerp(first, second, ramp * (drawn >= flat))
    contrast = _uniform(cpu.TEXTURE_CONTRAST, shape, device) * (drawn >= gradient)
    ground = ground + contrast * grounds.textures.pieces(count, side)
    if grounds.photographs is not None:
        ground = torch.where(drawn < texture, ground, _photographed(grounds.photographs, count, side))
    return ground.clamp(0, 1)


def _photographed(photographs: Pictures, count: int, side: int) -> Tensor:
    """Draw backgrounds, (count, 3, side, side), of one piece of a photograph, or of two that meet at a line."""
    device, shape = photographs.pixels.device, (count, 1, 1, 1)
    piece, other = (_recolored(photographs.pieces(count, side)) for _ in range(2))
    along = torch.arange(side, device=device)
    is_row = _chance(0.5, count, device)
    place = torch.where(is_row, along.view(1, 1, -1, 1), along.view(1, 1, 1, -1))
    line = torch.rand(shape, device=device) * side * _chance(cpu.COLLAGE_SHARE, count, device)
    return torch.where(place < line.floor(), other, piece)


def _recolored(pieces: Tensor) -> Tensor:
    """Scale bytes to about [0, 1]; swap the channels of half of the pieces, and light each by a random color."""
    count, device = len(pieces), pieces.device
    shuffled = torch.rand(count, 3, device=device).argsort(dim=1)
    order = torch.where(_chance(0.5, count, device).view(-1, 1), shuffled, torch.arange(3, device=device))
    channels = order.view(count, 3, 1, 1).expand_as(pieces)
    return pieces.gather(1, channels) * (_uniform((0.5, 1.3), (count, 3, 1, 1), device) / 255)


def _chance(share: float, count: int, device: torch.device) -> Tensor:
    """Return (count, 1, 1, 1) bool, each True with probability `share`."""
    return torch.rand(count, 1, 1, 1, device=device) < share


def _uniform(bounds: tuple[float, float], shape: tuple[int, ...], device: torch.device) -> Tensor:
    low, high = bounds
    return torch.rand(shape, device=device) * (high - low) + low
