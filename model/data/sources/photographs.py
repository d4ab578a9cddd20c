"""Free photographs for training backgrounds: those bundled with scikit-image, and Debian's wallpapers."""

from importlib.resources import files
from pathlib import Path
from typing import Final

from PIL import Image

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
SHORTER_SIDE: Final = 512  # pixels: four times the largest input of an encoder


def photograph_files(folder: Path) -> tuple[Path, ...]:
    """Return scikit-image's photographs, and those that `fetch_photographs` wrote below a data set's folder."""
    bundled = (Path(str(files("skimage.data") / name)) for name in BUNDLED)
    return (*bundled, *sorted((folder / FOLDER).glob("*.jpg")))


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
