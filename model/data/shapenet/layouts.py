"""Files of each layout, and the split of each model.

`shapenet-ptn` : Perspective Transformer Nets (Yan et al. 2016), the paper's data, with the clouds of EPCG (Lin et al.
2018); `shapenet-r2n2` : 3D-R2N2 (Choy et al. 2016); `what3d` : Tatarchenko et al. 2019, whose clouds are in the
camera's frame, one for each image.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from model.data.manifest import Split

CLASSES: Final = {  # of ShapeNet, by WordNet's number
    "02691156": "airplane",
    "02828884": "bench",
    "02933112": "cabinet",
    "02958343": "car",
    "03001627": "chair",
    "03211117": "display",
    "03636649": "lamp",
    "03691459": "loudspeaker",
    "04090263": "rifle",
    "04256520": "sofa",
    "04379243": "table",
    "04401088": "telephone",
    "04530566": "watercraft",
}
PTN: Final = "shapenet-ptn"
R2N2: Final = "shapenet-r2n2"
WHAT3D: Final = "what3d"
PTN_VIEWS: Final = 24
PTN_ELEVATION_DEG: Final = 30
R2N2_TRAIN: Final = 0.8  # share of a class's models, in order of their names
VAL_EVERY: Final = 10  # every tenth training model validates where the layout has no such list
PTN_LAYOUT: Final = """
  shapenetcore_ids/CLASS_trainids.txt, CLASS_valids.txt, CLASS_testids.txt   lines CLASS/MODEL
  shapenetcore_viewdata/CLASS/MODEL/imgs/a015_e030.jpg ... a360_e030.jpg     24 views
  CLASS_testGT/MODEL.mat or output/CLASS/MODEL.mat                           EPCG's clouds, V and Vd, or else
  shapenetcore_voxdata/CLASS/MODEL/model_32.mat                              voxels"""
R2N2_LAYOUT: Final = """
  ShapeNetRendering/CLASS/MODEL/rendering/00.png ... 23.png, rendering_metadata.txt
  ShapeNetVox32/CLASS/MODEL/model.binvox"""
WHAT3D_LAYOUT: Final = """
  classes.txt                                    the first word of each line is a class
  lists/CLASS/train.txt, test.txt (and val.txt)  lines MODEL
  renderings/CLASS/MODEL/0.png ... 4.png
  points/CLASS/MODEL/0.ply ... 4.ply             clouds in the camera's frame"""


@dataclass(frozen=True)
class Model:
    """One object, or with clouds in the camera's frame one view of it.

    views : image files; at least one must exist.
    clouds : files of its points, the first that exists counts.
    cameras : azimuth and elevation of each view in degrees, as the layout tells them; empty if it does not.
    metadata : file of the cameras, if it is one.
    """

    id: str
    category: str
    split: Split
    views: tuple[Path, ...]
    clouds: tuple[Path, ...]
    cameras: tuple[tuple[float, float], ...] = ()
    metadata: Path | None = None


def ptn_models(root: Path) -> Iterable[Model]:
    """Yield the models of the layout of nips16_PTN."""
    ids = root / "shapenetcore_ids"
    lists = sorted(ids.glob("*_trainids.txt"))
    _require(ids / "CLASS_trainids.txt", bool(lists), PTN_LAYOUT)
    _require(root / "shapenetcore_viewdata", (root / "shapenetcore_viewdata").is_dir(), PTN_LAYOUT)
    splits: tuple[tuple[Split, str], ...] = (("train", "trainids"), ("val", "valids"), ("test", "testids"))
    turn = 360 // PTN_VIEWS
    azimuths = [0, *range(turn, 360, turn)]  # the file of 0 is named 360
    for first in lists:
        synset = first.name.partition("_")[0]
        for split, name in splits:
            for line in _lines(ids / f"{synset}_{name}.txt", PTN_LAYOUT):
                name = line.rpartition("/")[2]
                images = root / "shapenetcore_viewdata" / synset / name / "imgs"
                yield Model(
                    f"{synset}/{name}",
                    CLASSES.get(synset, synset),
                    split,
                    tuple(images / f"a{each or 360:03d}_e{PTN_ELEVATION_DEG:03d}.jpg" for each in azimuths),
                    (
                        root / f"{synset}_testGT" / f"{name}.mat",
                        root / "output" / synset / f"{name}.mat",
                        root / "shapenetcore_voxdata" / synset / name / "model_32.mat",
                    ),
                    tuple((float(each), float(PTN_ELEVATION_DEG)) for each in azimuths),
                )


def r2n2_models(root: Path) -> Iterable[Model]:
    """Yield the models of the layout of 3D-R2N2, whose lists are portions of the sorted names."""
    renderings, voxels = root / "ShapeNetRendering", root / "ShapeNetVox32"
    for folder in (renderings, voxels):
        _require(folder, folder.is_dir(), R2N2_LAYOUT)
    for of_class in sorted(path for path in renderings.iterdir() if path.is_dir()):
        names = sorted(path.name for path in of_class.iterdir() if path.is_dir())
        training = int(R2N2_TRAIN * len(names))
        for name, split in [*_with_validation(names[:training]), *((each, "test") for each in names[training:])]:
            folder = of_class / name / "rendering"
            yield Model(
                f"{of_class.name}/{name}",
                CLASSES.get(of_class.name, of_class.name),
                split,
                tuple(folder / f"{number:02d}.png" for number in range(24)),
                (voxels / of_class.name / name / "model.binvox",),
                metadata=folder / "rendering_metadata.txt",
            )


def what3d_models(root: Path) -> Iterable[Model]:
    """Yield each view of the models of what3d, since each has a cloud of its own."""
    for folder in (root / "renderings", root / "points"):
        _require(folder, folder.is_dir(), WHAT3D_LAYOUT)
    for category in (line.split(" ")[0] for line in _lines(root / "classes.txt", WHAT3D_LAYOUT)):
        lists = root / "lists" / category
        training, test = (_lines(lists / f"{name}.txt", WHAT3D_LAYOUT) for name in ("train", "test"))
        named: list[tuple[str, Split]] = [(name, "test") for name in test]
        if (lists / "val.txt").is_file():
            named += [(name, "val") for name in _lines(lists / "val.txt", WHAT3D_LAYOUT)]
            named += [(name, "train") for name in training]
        else:
            named += _with_validation(training)
        for name, split in named:
            for number in range(5):
                image = root / "renderings" / category / name / f"{number}.png"
                cloud = root / "points" / category / name / f"{number}.ply"
                yield Model(f"{category}/{name}/{number}", category, split, (image,), (cloud,))


LAYOUTS: Final[dict[str, Callable[[Path], Iterable[Model]]]] = {
    PTN: ptn_models,
    R2N2: r2n2_models,
    WHAT3D: what3d_models,
}


def _with_validation(names: list[str]) -> list[tuple[str, Split]]:
    """Return training models with their split: every VAL_EVERY-th validates."""
    return [
        (name, "val" if number % VAL_EVERY == VAL_EVERY - 1 or number == len(names) - 1 > 0 else "train")
        for number, name in enumerate(names)
    ]


def _lines(path: Path, layout: str) -> list[str]:
    """Return the lines of a list that are not empty. Raises FileNotFoundError."""
    _require(path, path.is_file(), layout)
    return [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]


def _require(path: Path, is_there: bool, layout: str) -> None:
    if not is_there:
        raise FileNotFoundError(f"{path} is missing; this layout is expected:{layout}")
