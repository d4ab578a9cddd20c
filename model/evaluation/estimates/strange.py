"""Images that show no object the encoder could know: noise, blank and patterned pictures, photographs, two objects."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

GRAINS: Final = (1, 2, 4, 32)  # pixels of a cell of noise
GAP: Final = 8  # pixels between two objects
WHEEL: Final = 0.3  # radius of a motorcycle's wheels, meters; its axles are 1.4 m apart


def strange_images(count: int, size: int, photographs: Sequence[Bytes], rng: np.random.Generator) -> Floats:
    """Return images without an object, (count, 3, size, size) in [0, 1]: noise, ramps, stripes, photographs in turn."""
    kinds: tuple[Callable[[], Bytes], ...] = (
        lambda: noise(size, rng),
        lambda: _ramp(size, rng),
        lambda: _stripes(size, rng),
        lambda: part_of(photographs[int(rng.integers(len(photographs)))], size, rng),
    )
    images = [kinds[number % len(kinds)]() for number in range(count)]
    pixels = np.stack(images) if images else np.empty((0, size, size, 3), np.uint8)
    return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), dtype=np.float32) / np.float32(255)


def noise(size: int, rng: np.random.Generator) -> Bytes:
    """Return colored noise of a random grain, (size, size, 3)."""
    cells = max(2, size // int(rng.choice(GRAINS)))
    small = rng.integers(256, size=(cells, cells, 3), dtype=np.uint8)
    return np.asarray(Image.fromarray(small).resize((size, size), Image.Resampling.BILINEAR))


def part_of(photograph: Bytes, size: int, rng: np.random.Generator) -> Bytes:
    """Return a random square of a photograph, (size, size, 3)."""
    height, width = photograph.shape[:2]
    side = int(rng.integers(min(size, height, width), min(height, width) + 1))
    top, left = int(rng.integers(height - side + 1)), int(rng.integers(width - side + 1))
    crop = Image.fromarray(photograph[top : top + side, left : left + side])
    return np.asarray(crop.resize((size, size), Image.Resampling.BOX))


def side_by_side(left: Bytes, right: Bytes) -> Bytes:
    """Return two views (S, S, 4) as one picture of two objects, RGBA."""
    gap = np.zeros((left.shape[0], GAP, 4), np.uint8)
    return np.concatenate([left, gap, right], axis=1)


def motorcycle() -> list[trimesh.Trimesh]:
    """Return a motorcycle made of simple bodies: two wheels, a frame, engine, tank, seat and handlebars. Y is up."""
    dark, red, gray = (30, 30, 30, 255), (170, 30, 30, 255), (140, 140, 145, 255)
    rear, front, steering = np.array([0, WHEEL, -0.7]), np.array([0, WHEEL, 0.7]), np.array([0, 0.95, 0.4])
    parts = []
    for axle in (rear, front):
        wheel = trimesh.creation.torus(WHEEL - 0.05, 0.06)
        wheel.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0], [0, 0, 0]))
        parts.append(_paint(wheel.apply_translation(axle), dark))
    for start, end in ((front, steering), (rear, steering), (rear, np.array([0, 0.75, -0.4]))):
        parts.append(_paint(trimesh.creation.cylinder(0.03, segment=[start, end]), gray))
    bars = [np.array([x, 1.02, 0.35]) for x in (-0.4, 0.4)]
    parts.append(_paint(trimesh.creation.cylinder(0.02, segment=bars), dark))
    for size, place, color in (
        ((0.28, 0.32, 0.4), (0, 0.45, 0.05), gray),
        ((0.26, 0.2, 0.45), (0, 0.82, 0.1), red),
        ((0.24, 0.08, 0.6), (0, 0.8, -0.45), dark),
    ):
        parts.append(_paint(trimesh.creation.box(size).apply_translation(place), color))
    return _in_object_frame(parts)


def _in_object_frame(parts: list[trimesh.Trimesh]) -> list[trimesh.Trimesh]:
    """Center the parts' box at the origin and make its longest side 1."""
    bounds = np.array([part.bounds for part in parts])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    for part in parts:
        part.apply_translation(-(low + high) / 2)
        part.apply_scale(1 / (high - low).max())
    return parts


def _paint(mesh: trimesh.Trimesh, color: tuple[int, int, int, int]) -> trimesh.Trimesh:
    mesh.visual.face_colors = color
    return mesh


def _ramp(size: int, rng: np.random.Generator) -> Bytes:
    """Return one color that fades into another, which is often the same."""
    ends = rng.integers(256, size=(2, 3))
    ends[1] = ends[0] + (ends[1] - ends[0]) * rng.choice([0, 0.2, 1])
    share = np.linspace(0, 1, size)[:, None]
    row = np.rint(ends[0] * share + ends[1] * (1 - share)).astype(np.uint8)  # (size, 3)
    image = np.tile(row, (size, 1, 1))
    return image if rng.random() < 0.5 else image.transpose(1, 0, 2)


def _stripes(size: int, rng: np.random.Generator) -> Bytes:
    """Return two colors in stripes or checks."""
    colors, period = rng.integers(256, size=(2, 3), dtype=np.uint8), int(rng.integers(2, size // 2))
    rows, columns = np.indices((size, size)) // period
    pattern: Bytes = colors[(rows + columns * int(rng.integers(2))) % 2]
    return pattern
