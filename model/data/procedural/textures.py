"""Textures of the training split's own materials, for pieces made by rule, so that not every made thing is of one
colour, and for training objects that are to look otherwise: wood, cloth, prints, with what is drawn on them."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from PIL import Image, ImageStat

from model.data.manifest import Manifest
from model.data.procedural.primitives import Rng, Triple, paint
from model.data.rendering.surface import material_colour
from model.data.sources.meshes import MeshRecord
from service.files import whole_file

FOLDER: Final = "textures"  # in the data set's folder
SUFFIXES: Final = (".jpg", ".jpeg", ".png")
SIDES: Final = (32, 192)  # pixels: smaller ones are swatches of one colour, larger ones are made smaller
UNEVEN: Final = 4.0  # standard deviation of the grey levels, of 255: what has less shows nothing
REPEATS: Final = (0.6, 4.0)  # of a texture over the longest side, uniform in the logarithm
TINTED_SHARE: Final = 0.4  # of the textures lose their own colour to another
PRINT_SHARE: Final = 0.2  # of what is drawn are checks or stripes
PRINT_SIDE: Final = 96  # pixels


def gather_textures(records: Iterable[MeshRecord], folder: Path) -> list[Path]:
    """Keep the images beside the training split's meshes small, below the data set's folder; each once.

    Where a mesh of another split lies in the same folder, none of that folder's: they may be its own.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    train = {entry.id for entry in Manifest.read(folder).of("train")}
    folders: dict[bool, set[Path]] = {True: set(), False: set()}
    for record in records:
        folders[record.id in train].add(record.path.parent)
    beside = folders[True] - folders[False]
    (folder / FOLDER).mkdir(exist_ok=True)
    for path in sorted(path for place in beside for path in place.iterdir() if path.suffix.lower() in SUFFIXES):
        target = folder / FOLDER / f"{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}.jpg"
        if not target.exists():
            _keep_small(path, target)
    return texture_files(folder)


def texture_files(folder: Path) -> list[Path]:
    """What `gather_textures` kept, in order of their names."""
    return sorted((folder / FOLDER).glob("*.jpg"))


def _keep_small(path: Path, target: Path) -> None:
    try:
        with Image.open(path) as file:
            image = file.convert("RGB")
    except OSError:
        return  # a model's broken image is no reason to stop
    smallest, largest = SIDES
    if min(image.size) < smallest or ImageStat.Stat(image.convert("L")).stddev[0] < UNEVEN:
        return
    factor = min(1, largest / min(image.size))
    image = image.resize([max(1, round(length * factor)) for length in image.size])
    with whole_file(target) as kept:
        image.save(kept, format="JPEG", quality=90)


def drawn(paths: list[Path], colour: Triple, rng: Rng) -> Image.Image:
    """A texture at random, in its own colours or as shades of `colour` (RGB in [0, 1]), or a print on `colour`."""
    if rng.random() < PRINT_SHARE:
        return _printed(colour, rng)
    with Image.open(paths[rng.integers(len(paths))]) as file:
        pixels = np.asarray(file.convert("RGB"), np.float32) / 255
    if rng.random() < TINTED_SHARE:
        grey = pixels.mean(axis=2, keepdims=True)
        pixels = grey / max(float(grey.mean()), 0.1) * np.array(colour, np.float32)
    return Image.fromarray((255 * pixels.clip(0, 1)).astype(np.uint8))


def _printed(colour: Triple, rng: Rng) -> Image.Image:
    """Checks or stripes of another colour on `colour`."""
    waves = np.sin(2 * np.pi * rng.integers(2, 9) * np.arange(PRINT_SIDE) / PRINT_SIDE)
    stripes = 1 / (1 + np.exp(rng.uniform(2, 12) * (rng.uniform(-0.7, 0.7) - waves)))
    covered = np.add.outer(stripes, stripes * rng.integers(2)) / 2
    other = rng.uniform(0, 1, 3) if rng.random() < 0.5 else np.full(3, rng.choice([0.05, 0.95]))
    pixels = np.array(colour) + covered[..., None] * (other - np.array(colour))
    return Image.fromarray((255 * pixels.clip(0, 1)).astype(np.uint8))


def redress(parts: list[trimesh.Trimesh], paths: list[Path], rng: Rng) -> None:
    """Give some parts of an object another look: half of them a texture, a quarter a plain colour. Glass stays."""
    for part in parts:
        kind = rng.random()
        colour: Triple = tuple(rng.uniform(0.05, 0.95, 3).tolist())
        if kind < 0.25 or material_colour(part)[1] < 1:
            continue
        if kind < 0.5:
            paint(part, colour)
        else:
            wrap(part, drawn(paths, colour, rng), *any_place(rng))


def any_place(rng: Rng) -> tuple[float, tuple[float, float]]:
    """How a texture may lie: `repeats` and `start` of `wrap`."""
    return float(np.exp(rng.uniform(*np.log(REPEATS)))), (rng.random(), rng.random())


def wrap(part: trimesh.Trimesh, image: Image.Image, repeats: float, start: tuple[float, float]) -> None:
    """Lay a texture over a part from three sides, each face from the one that it looks to most.

    repeats : over a length of 1. start : texture coordinates at the origin.
    """
    side = np.abs(part.vertex_normals).argmax(axis=1)
    across = np.array([[2, 1], [0, 2], [0, 1]])[side]  # the two axes that a vertex's side shows
    uv = np.take_along_axis(np.asarray(part.vertices), across, axis=1) * repeats + np.array(start)
    part.visual = trimesh.visual.TextureVisuals(uv=uv, image=image)
