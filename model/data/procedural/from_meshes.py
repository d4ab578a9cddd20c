"""Pieces made from a folder of meshes, for training only; near-duplicates are left out."""

import json
from collections import defaultdict
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from tqdm import tqdm

from model.data.build import object_file
from model.data.dedupe import duplicates
from model.data.manifest import PIECES, Manifest
from model.data.procedural.pieces import visible_points
from model.data.rendering.cameras import free_cameras
from model.data.rendering.render import shoot, stage
from model.data.rendering.surface import Floats
from model.data.sources.meshes import MeshRecord, load_parts
from model.data.workers import run_with_report
from service.files import whole_file

REPEATS: Final = "duplicates.json"  # in the folder of the pieces: name left out -> name kept


@dataclass(frozen=True)
class MeshPieceJob:
    """One mesh to make a piece of; the piece depends on (seed, the record's id) and the mesh only."""

    record: MeshRecord
    target: Path
    seed: int
    views: int


def make_from_meshes(
    records: Iterable[MeshRecord], folder: Path, views: int, processes: int
) -> tuple[dict[str, str], dict[str, str]]:
    """Write the missing pieces of the records to the data set `folder`, then remove those that repeat another.

    Return id -> failure, and all repeats of the data set, name left out -> name kept. Pieces are compared within their
    category, as `model.data.dedupe` compares objects; the earlier name stays.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    seed = Manifest.read(folder).seed
    (folder / PIECES).mkdir(exist_ok=True)
    stored = folder / PIECES / REPEATS
    repeats: dict[str, str] = json.loads(stored.read_text(encoding="utf-8")) if stored.is_file() else {}
    jobs = [
        MeshPieceJob(record, folder / PIECES / Path(object_file(record.id)).name, seed, views) for record in records
    ]
    missing = [job for job in jobs if job.target.stem not in repeats and not job.target.exists()]
    report = run_with_report(render_mesh_piece, missing, lambda job: job.record.id, processes, "make", "piece")
    by_category: dict[str, list[Path]] = defaultdict(list)
    for job in jobs:
        if job.target.exists():
            by_category[job.record.category].append(job.target)
    for files in tqdm(by_category.values(), desc="compare", unit="category"):
        repeats |= duplicates({file.stem: _points(file) for file in files})
    with whole_file(stored) as file:
        file.write((json.dumps(repeats, indent=1, ensure_ascii=False) + "\n").encode())
    for name in repeats:
        (folder / PIECES / f"{name}.npz").unlink(missing_ok=True)
    return report.failures, repeats


def render_mesh_piece(job: MeshPieceJob) -> None:
    """Render one mesh under free cameras (a worker process)."""
    rng = np.random.default_rng([job.seed, 3, *job.record.id.encode()])
    parts = load_parts(job.record)
    points = visible_points(parts, rng)
    with closing(stage(parts, multisampling=False)) as plotter:
        images = shoot(plotter, free_cameras(job.views, train=True, rng=rng), points, rng)
    with whole_file(job.target) as file:
        np.savez_compressed(file, views=images, points=points)


def _points(file: Path) -> Floats:
    with np.load(file) as arrays:
        points: Floats = arrays["points"]
    return points
