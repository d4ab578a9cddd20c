"""Free photographs for training backgrounds: those bundled with scikit-image, and Debian's wallpapers."""

from importlib.resources import files
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from model.data.manifest import texture_files
from model.data.small import store_small
from model.data.sources.debian import download, unpack

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
SCENERY: Final = (  # of both: those in which nothing stands out as an object
    "Blinds.jpg",
    "Bridge_by_Sander_Klootwijk.jpg",
    "Dragonfly_by_Bolly.jpg",
    "Dune.jpg",
    "GreenMeadow.jpg",
    "RainDrops.jpg",
    "Storm.jpg",
    "Wood.jpg",
    "aitzgorri_by_Aitzol_Berasategi.jpg",
    "analogpattern_by_Peter_Nerlich.jpg",
    "brick.png",
    "grass.png",
    "gravel.png",
    "hubble_deep_field.jpg",
    "ihc.png",
    "life_by_Aitzol_Berasategi.jpg",
    "page.png",
    "picosdeeuropa_by_Aitzol_Berasategi.jpg",
    "sunset_by_Aitzol_Berasategi.jpg",
    "umang_by_Abhishek_Mudgal.jpg",
)
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
    return tuple(path for path in photograph_files(folder) if path.name in SCENERY)


def surface_files(folder: Path) -> tuple[Path, ...]:
    """Return those textures of a data set's objects that are alike all over, as floors and walls are."""
    return tuple(path for path in texture_files(folder) if _is_even(path))


def _is_even(path: Path) -> bool:
    """Return whether the means of a texture's parts differ little. Small textures are not."""
    with Image.open(path) as texture:
        if min(texture.size) < SURFACE_SIDE:
            return False
        parts = np.asarray(texture.convert("RGB").resize((PARTS, PARTS), Image.Resampling.BOX)) / 255
    return bool(parts.std(axis=(0, 1)).max() < EVEN)


def fetch_photographs(folder: Path, work: Path) -> list[Path]:
    """Download the wallpapers that are photographs, and store small copies below a data set's folder.

    Raises
    ------
    FileNotFoundError : Debian's package tools are missing, or there is no network.
    """
    target = folder / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    for package in PACKAGES:
        unpack(download(package, work), work / package)
        for path in sorted((work / package).rglob("*.jpg")):
            if path.parent.name not in ("abstract", "desktop"):  # folders of mate-backgrounds without photographs
                with Image.open(path) as photograph:
                    store_small(photograph, SHORTER_SIDE, target / path.name)
    return sorted(target.glob("*.jpg"))
