"""Convert ShapeNet's layouts into a data set's folder, so that training and evaluation read them like any other.

Clouds keep their scale, as the paper's: only the center of their bounding box moves to the origin. ShapeNet's front is
-Z, this project's +Z, so clouds in ShapeNet's frame are turned by half a turn about +Y, which no distance notices.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from model.data.manifest import OBJECTS, SIZE, SURFACE_POINTS, Entry, Manifest, object_file
from model.data.shapenet.clouds import read_cloud
from model.data.shapenet.layouts import LAYOUTS, WHAT3D, Model
from model.data.workers import run_with_report
from service.files import whole_file

FOLDER: Final = "hof-model"  # in the layout's own folder
DENSE: Final = "dense"  # array of all points of a test object, for EPCG's protocol
LICENSE: Final = "ShapeNet's terms of use"
HALF_TURN: Final = np.array([-1, 1, -1], np.float32)

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class _Job:
    """One model to convert into `target`."""

    model: Model
    target: Path
    factors: tuple[float, ...]


def convert(kind: str, root: Path) -> Path:
    """Convert the models of a layout that are not converted yet, and return the data set's folder, `root / FOLDER`.

    Raises
    ------
    FileNotFoundError : `root` lacks a folder or list of the layout.
    ValueError : no model can be read.
    """
    out = root / FOLDER
    if (out / "manifest.json").is_file():
        return out
    models = list(LAYOUTS[kind](root))
    (out / OBJECTS).mkdir(parents=True, exist_ok=True)
    factors = (1.0, 1.0, 1.0) if kind == WHAT3D else tuple(HALF_TURN.tolist())
    jobs = [_Job(model, out / object_file(model.id), factors) for model in models]
    missing = [job for job in jobs if not job.target.exists()]
    report = run_with_report(
        convert_model, missing, lambda job: job.model.id, os.cpu_count() or 1, f"convert {kind}", "model"
    )
    entries = tuple(_entry(job.model, kind) for job in jobs if job.target.exists())
    if not entries:
        id_, failure = next(iter(report.failures.items()), ("no model", "the lists are empty"))
        raise ValueError(f"none of {len(models)} models of {root} can be read; {id_}: {failure}")
    Manifest(0, tuple(sorted(entries, key=lambda entry: entry.id)), {}, report.failures).write(out / "manifest.json")
    print(f"{len(entries)} models, {len(report.failures)} failures: {out}")
    return out


def convert_model(job: _Job) -> None:
    """Convert one model and write its file, whole or not at all (a worker process)."""
    model = job.model
    cloud = next((path for path in model.clouds if path.is_file()), None)
    files = [path for path in model.views if path.is_file()]
    if cloud is None or not files:
        raise FileNotFoundError(f"{model.clouds[-1] if cloud is None else model.views[0]} is missing")
    points = read_cloud(cloud)
    points = (points - (points.max(axis=0) + points.min(axis=0)) / 2) * np.array(job.factors, np.float32)
    rng = np.random.default_rng([*model.id.encode()])
    chosen = rng.choice(len(points), SURFACE_POINTS, replace=len(points) < SURFACE_POINTS)
    arrays = {"views": np.stack([_view(path) for path in files]), "points": points[chosen]}
    cameras = _cameras(model)
    if len(cameras) == len(model.views):
        kept = [number for number, path in enumerate(model.views) if path.is_file()]
        arrays["cameras"] = np.array(cameras, np.float32)[kept]
    if model.split == "test" and len(points) > SURFACE_POINTS:
        arrays[DENSE] = points
    with whole_file(job.target) as file:
        np.savez_compressed(file, **arrays)


def _view(path: Path) -> npt.NDArray[np.uint8]:
    """Return an image as RGBA, at most SIZE pixels wide; its own transparency is the mask."""
    with Image.open(path) as image:
        rgba = image.convert("RGBA")
    if max(rgba.size) > SIZE:
        rgba = rgba.resize((SIZE, SIZE), Image.Resampling.BOX)
    return np.asarray(rgba)


def _cameras(model: Model) -> list[tuple[float, float]]:
    """Return azimuth and elevation of each view; the lines of 3D-R2N2 go on with roll, distance and field of view."""
    if model.metadata is None or not model.metadata.is_file():
        return list(model.cameras)
    rows = [line.split() for line in model.metadata.read_text(encoding="ascii").splitlines() if line.strip()]
    return [(float(row[0]) % 360, float(row[1])) for row in rows]


def _entry(model: Model, kind: str) -> Entry:
    return Entry(
        model.id, model.category, kind, model.category, "ShapeNet", LICENSE, "", object_file(model.id), model.split
    )
