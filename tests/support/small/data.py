"""A data set without a renderer: boxes of random proportions, drawn as points, for tests of the evaluation."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from model.data.manifest import VARIANTS, Entry, Manifest, Split
from service.drawing.cloud import ELEVATION_DEG, draw

NAMES = ("Chair", "Table", "Sofa", "Bed", "Desk lamp", "Cabinet", "Vase")
VIEWS = 24
SIZE = 64


def write(folder: Path, train: int = 6, test: int = 4) -> Path:
    """Write a data set with the splits train and test; free views (variant 0) of the test objects alone."""
    (folder / "objects").mkdir(parents=True)
    (folder / VARIANTS).mkdir()
    entries = []
    for number in range(train + test):
        split: Split = "train" if number < train else "test"
        name = f"object{number:02d}"
        entry = Entry(name, NAMES[number % len(NAMES)], "s", "Living room", "", "CC0", "", f"objects/{name}.npz", split)
        points = box(number)
        ring = cameras(VIEWS)[:, :2]
        np.savez(folder / entry.file, views=views(points, VIEWS), cameras=ring, points=points, colours=colors(points))
        if split == "test":
            free = cameras(12, 7.0)
            np.savez(folder / VARIANTS / f"{name}__0.npz", views=views(points, 12, 7.0), cameras=free, points=points)
        entries.append(entry)
    Manifest(0, tuple(entries), {}, {}).write(folder / "manifest.json")
    return folder


def box(number: int, n: int = 10_000) -> npt.NDArray[np.float32]:
    """Return n points on the surface of box `number`, (n, 3), its longest side 1."""
    rng = np.random.default_rng(number)
    sides = rng.uniform(0.1, 1, 3)
    points = rng.uniform(-0.5, 0.5, (n, 3))
    axis = rng.integers(3, size=n)
    points[np.arange(n), axis] = np.sign(points[np.arange(n), axis]) / 2
    scaled: npt.NDArray[np.float32] = (points * sides / sides.max()).astype(np.float32)
    return scaled


def colors(points: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Return a color per point, (n, 3) uint8: red grows to the right, green upwards, blue to the front."""
    values: npt.NDArray[np.uint8] = np.rint(255 * (points + 0.5)).astype(np.uint8)
    return values


def cameras(count: int, azimuth: float = 0.0) -> npt.NDArray[np.float32]:
    """Return the cameras of `views`, (count, 4): azimuth, elevation, distance, roll."""
    azimuths = azimuth + np.arange(count) * 360 / count
    return np.stack([[each, ELEVATION_DEG, 3, 0] for each in azimuths]).astype(np.float32)


def views(points: npt.NDArray[np.float32], count: int, azimuth: float = 0.0) -> npt.NDArray[np.uint8]:
    """Draw views from around, (count, SIZE, SIZE, 4) uint8 RGBA, the points alone opaque."""
    pictures = [draw(points, SIZE, azimuth + index * 360 / count) for index in range(count)]
    return np.stack([np.dstack([picture, 255 * (picture < 255).any(axis=2)]) for picture in pictures]).astype(np.uint8)
