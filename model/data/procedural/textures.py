"""Textures of the training split's materials, for procedural pieces and for training objects with another look."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from PIL import Image, ImageStat

from model.data.manifest import TEXTURES, Manifest, texture_files
from model.data.procedural.primitives import Rng, Triple, paint
from model.data.rendering.surface import material_color
from model.data.small import store_small
from model.data.sources.meshes import MeshRecord

SUFFIXES: Final = (".jpg", ".jpeg", ".png")
SIDES: Final = (32, 192)  # pixels: smaller images are swatches of one color, larger ones are scaled down
UNEVEN: Final = 4.0  # least standard deviation of the gray levels, of 255: less looks like one color
REPEATS: Final = (0.6, 4.0)  # of a texture over the longest side, uniform in the logarithm
TINTED_SHARE: Final = 0.4  # of the textures are tinted in another color
PRINT_SHARE: Final = 0.2  # of the drawn textures are checks or stripes
PRINT_SIDE: Final = 96  # pixels


def gather_textures(records: Iterable[MeshRecord], folder: Path) -> list[Path]:
    """Store small copies of the images beside the training split's meshes below the data set's folder, each once.

    Folders that also hold a mesh of another split are skipped: the images may belong to that mesh.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    train = {entry.id for entry in Manifest.read(folder).of("train")}
    folders: dict[bool, set[Path]] = {True: set(), False: set()}
    for record in records:
        folders[record.id in train].add(record.path.parent)
    beside = folders[True] - folders[False]
    (folder / TEXTURES).mkdir(exist_ok=True)
    for path in sorted(path for place in beside for path in place.iterdir() if path.suffix.lower() in SUFFIXES):
        target = folder / TEXTURES / f"{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}.jpg"
        if not target.exists():
            _store_texture(path, target)
    return texture_files(folder)


def _store_texture(path: Path, target: Path) -> None:
    """Store a small copy of an image, unless it is broken, tiny or of one color."""
    try:
        with Image.open(path) as file:
            image = file.convert("RGB")
    except OSError:
        return  # skip a model's broken image
    smallest, largest = SIDES
    if min(image.size) < smallest or ImageStat.Stat(image.convert("L")).stddev[0] < UNEVEN:
        return
    store_small(image, largest, target)


def draw_texture(paths: list[Path], color: Triple, rng: Rng) -> Image.Image:
    """Draw a random texture in its own colors or in shades of `color` (RGB in [0, 1]), or a print on `color`."""
    if rng.random() < PRINT_SHARE:
        return _draw_print(color, rng)
    with Image.open(paths[rng.integers(len(paths))]) as file:
        pixels = np.asarray(file.convert("RGB"), np.float32) / 255
    if rng.random() < TINTED_SHARE:
        gray = pixels.mean(axis=2, keepdims=True)
        pixels = gray / max(float(gray.mean()), 0.1) * np.array(color, np.float32)
    return Image.fromarray((255 * pixels.clip(0, 1)).astype(np.uint8))


def _draw_print(color: Triple, rng: Rng) -> Image.Image:
    """Draw checks or stripes of another color on `color`."""
    waves = np.sin(2 * np.pi * rng.integers(2, 9) * np.arange(PRINT_SIDE) / PRINT_SIDE)
    stripes = 1 / (1 + np.exp(rng.uniform(2, 12) * (rng.uniform(-0.7, 0.7) - waves)))
    covered = np.add.outer(stripes, stripes * rng.integers(2)) / 2
    other = rng.uniform(0, 1, 3) if rng.random() < 0.5 else np.full(3, rng.choice([0.05, 0.95]))
    pixels = np.array(color) + covered[..., None] * (other - np.array(color))
    return Image.fromarray((255 * pixels.clip(0, 1)).astype(np.uint8))


def redress(parts: list[trimesh.Trimesh], paths: list[Path], rng: Rng) -> None:
    """Change the look of an object's parts: half of them get a texture, a quarter a plain color. Glass stays."""
    for part in parts:
        kind = rng.random()
        color: Triple = tuple(rng.uniform(0.05, 0.95, 3).tolist())
        if kind < 0.25 or material_color(part)[1] < 1:
            continue
        if kind < 0.5:
            paint(part, color)
        else:
            wrap(part, draw_texture(paths, color, rng), *random_placement(rng))


def random_placement(rng: Rng) -> tuple[float, tuple[float, float]]:
    """Choose `repeats` and `start` of `wrap`."""
    return float(np.exp(rng.uniform(*np.log(REPEATS)))), (rng.random(), rng.random())


def wrap(part: trimesh.Trimesh, image: Image.Image, repeats: float, start: tuple[float, float]) -> None:
    """Lay a texture over a part along three axes, each vertex along the axis nearest to its normal.

    repeats : repetitions over a length of 1.
    start : texture coordinates at the origin.
    """
    side = np.abs(part.vertex_normals).argmax(axis=1)
    across = np.array([[2, 1], [0, 2], [0, 1]])[side]  # the two axes across that one
    uv = np.take_along_axis(np.asarray(part.vertices), across, axis=1) * repeats + np.array(start)
    part.visual = trimesh.visual.TextureVisuals(uv=uv, image=image)
