"""Observe a finished encoder on known objects: what its heads learn from.

Each object is seen in several views, half of them mirrored, some rolled. Half of the images are as the service frames a
cut-out photo; the others get the backgrounds, lights and faults of training. A share of the images shows no object, or
two at once, and counts as a fit of 0.
"""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image
from scipy.spatial import cKDTree
from tqdm import tqdm

from model.data.augment import augment
from model.data.dataset import MIRROR, VISIBLE
from model.data.manifest import Entry, variant_file
from model.data.rendering.cameras import RING_DISTANCE
from model.data.sources.photographs import photograph_files
from model.evaluation.estimates.strange import side_by_side, strange_images
from model.evaluation.evaluate import draw
from model.metrics import compare
from model.networks.inner import InnerEncoder
from model.networks.observations import TURNS_DEG, Observations
from service.encoding.encoder import Encoder
from service.encoding.framing import frame
from service.encoding.pixels import over_white

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
Tensors = dict[str, Floats]

SCORE: Final = "f@2%"
ROLLED_SHARE: Final = 0.4
ROLL_DEG: Final = 8.0  # standard deviation of the rolled views
STRANGE_SHARE: Final = 0.04  # images without an object, and as many of two objects, of all
STRANGE_BATCH: Final = 16
TURNED_POINTS: Final = 2_000


@dataclass(frozen=True)
class KnownObject:
    """An object of a data set.

    folder : of the data set.
    has_front : whether its front is known to be at +Z; otherwise the azimuth of its cameras is unknown.
    """

    folder: Path
    entry: Entry
    has_front: bool

    def points(self) -> Floats:
        """Read the true points, (10000, 3), object frame."""
        with np.load(self.folder / self.entry.file) as arrays:
            points: Floats = arrays["points"]
        return points


class View(NamedTuple):
    """A view of an object: (S, S, 4) uint8 RGBA, its camera (4,), and whether it is mirrored left to right."""

    rgba: Bytes
    camera: Floats
    mirrored: bool


class _Seen(NamedTuple):
    """Results of one object's images: inner tensors, scores (v,), cameras (v, 4)."""

    inner: Tensors
    scores: Floats
    cameras: Floats


def observe(model: Path, objects: Sequence[KnownObject], views: int, seed: int) -> Observations:
    """Observe an exported encoder on `views` views of each object.

    Objects of a training split get no score: the encoder knows them too well.

    Raises
    ------
    ValueError : there are no objects, or the model was not written by `hof-model export`.
    """
    if not objects:
        raise ValueError("there are no objects to observe: name data sets with validation objects or other sources")
    observer = _Observer(model, objects[0].folder, views, seed)
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        work = threads.map(observer.of_object, objects)
        results = list(tqdm(work, total=len(objects), desc="observe", unit="object", disable=None))
        turned = list(threads.map(lambda each: turned_distances(each.points()), objects))
    numbers = [np.full(len(each.scores), number) for number, each in enumerate(results)]
    strange = observer.strange([each for each in objects if each.entry.split != "train"], sum(map(len, numbers)))
    numbers.append(np.full(len(strange.scores), -1))
    results = [each for each in [*results, strange] if len(each.scores)]
    return Observations(
        {name: np.concatenate([each.inner[name].astype(np.float16) for each in results]) for name in results[0].inner},
        np.concatenate([each.scores for each in results]),
        np.concatenate([each.cameras for each in results]),
        np.concatenate(numbers),
        np.array([each.entry.id for each in objects]),
        np.array([each.entry.source for each in objects]),
        np.stack(turned),
    )


class _Observer:
    """An encoder, and the ways its images are made."""

    def __init__(self, model: Path, folder: Path, views: int, seed: int) -> None:
        self._encoder = Encoder.open(model, threads=1)
        self._inner = InnerEncoder(model, threads=1)
        self._photographs = photograph_files(folder)
        self._views = views
        self._seed = seed

    def of_object(self, known: KnownObject) -> _Seen:
        """Observe one object."""
        rng = np.random.default_rng([self._seed, *known.entry.id.encode()])
        views = list(random_views(known, self._views, rng))
        if not views:
            return _Seen({}, np.empty(0, np.float32), np.empty((0, 4), np.float32))
        theta, inner = self._inner.look(self._images([view.rgba for view in views], rng))
        cameras = np.stack([view.camera for view in views])
        if known.entry.split == "train":
            return _Seen(inner, np.full(len(views), np.nan, np.float32), cameras)
        points, spec = known.points(), self._encoder.spec
        truths = [points * MIRROR if view.mirrored else points for view in views]
        scores = [compare(draw(spec, row), truth)[SCORE] for row, truth in zip(theta, truths, strict=True)]
        return _Seen(inner, np.array(scores, np.float32), cameras)

    def strange(self, objects: Sequence[KnownObject], count: int) -> _Seen:
        """Observe a share of `count` images without an object, and as many of two objects."""
        rng, size = np.random.default_rng([self._seed, count]), self._encoder.framing.size
        number = round(STRANGE_SHARE * count)
        photographs = [np.asarray(Image.open(path).convert("RGB")) for path in self._photographs]
        images = strange_images(number, size, photographs, rng)
        pairs = [pair_of(objects, rng) for _ in range(number if len(objects) > 1 else 0)]
        images = np.concatenate([images, *(self._images([pair], rng) for pair in pairs)])
        starts = range(0, len(images), STRANGE_BATCH)
        parts = [self._inner.look(images[start : start + STRANGE_BATCH])[1] for start in starts]
        inner = {name: np.concatenate([part[name] for part in parts]) for name in self._inner.names} if parts else {}
        return _Seen(inner, np.zeros(len(images), np.float32), np.full((len(images), 4), np.nan, np.float32))

    def _images(self, views: Sequence[Bytes], rng: np.random.Generator) -> Floats:
        """Frame views as the service does; change every other one as in training: (b, 3, size, size) in [0, 1]."""
        framing = self._encoder.framing
        crops = [frame(Image.fromarray(view), framing).rgba for view in views]
        images = np.concatenate([over_white(crop) for crop in crops])
        if len(crops) > 1:
            pixels = torch.from_numpy(np.stack([np.asarray(crop) for crop in crops[1::2]])).permute(0, 3, 1, 2)
            images[1::2] = augment(pixels, framing.size, rng, self._photographs).numpy()
        return images


def random_views(known: KnownObject, views: int, rng: np.random.Generator) -> Iterator[View]:
    """Yield random views of an object: ring and free ones in equal numbers, where free ones are rendered."""
    files = [known.folder / known.entry.file, variant_file(known.folder, known.entry, 0)]
    files = [file for file in files if file.exists()]
    for file in files:
        with np.load(file) as arrays:
            pictures: Bytes = arrays["views"]
            cameras: Floats = arrays["cameras"]
        if cameras.shape[1] == 2:  # the ring's: all at one distance, without roll
            cameras = np.pad(cameras, ((0, 0), (0, 2)))
            cameras[:, 2] = RING_DISTANCE
        visible = [index for index, picture in enumerate(pictures) if (picture[..., 3] > 0).mean() > VISIBLE]
        for index in rng.permutation(visible)[: views // len(files)].tolist():
            view = _change(pictures[index], cameras[index], rng)
            if not known.has_front:
                view.camera[0] = np.nan
            yield view


def _change(rgba: Bytes, camera: Floats, rng: np.random.Generator) -> View:
    """Return a view, mirrored or rolled at random."""
    azimuth, elevation, distance, roll = camera.tolist()
    if rng.random() < ROLLED_SHARE:
        by = float(rng.normal(0, ROLL_DEG))
        rgba, roll = roll_view(rgba, by), roll + by
    mirrored = bool(rng.random() < 0.5)
    if mirrored:
        rgba, azimuth, roll = rgba[:, ::-1], -azimuth, -roll
    return View(rgba, np.array([azimuth, elevation, distance, roll], np.float32), mirrored)


def roll_view(rgba: Bytes, degrees: float) -> Bytes:
    """Return the view of a camera that is rolled clockwise by so many degrees: its image turns the other way."""
    premultiplied = Image.fromarray(rgba).convert("RGBa")
    turned = premultiplied.rotate(degrees, Image.Resampling.BILINEAR, expand=True)
    return np.asarray(turned.convert("RGBA"))


def pair_of(objects: Sequence[KnownObject], rng: np.random.Generator) -> Bytes:
    """Return one picture of two random objects side by side, RGBA."""
    views = []
    for index in rng.choice(len(objects), 2, replace=False).tolist():
        with np.load(objects[index].folder / objects[index].entry.file) as arrays:
            views.append(arrays["views"][int(rng.integers(len(arrays["views"])))])
    return side_by_side(*views)


def turned_distances(points: Floats) -> Floats:
    """Return the mean distance from a cloud (n, 3) turned about +Y to the cloud itself: (TURNS_DEG,), longest sides."""
    tree, sample = cKDTree(points), points[:TURNED_POINTS]
    return np.array([tree.query(sample @ _turn(degrees))[0].mean() for degrees in TURNS_DEG], np.float32)


def _turn(degrees: float) -> Floats:
    """Return the matrix that turns rows (n, 3) about +Y."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]], np.float32)
