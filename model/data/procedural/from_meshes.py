"""Pieces made from a folder of meshes, for training only; near-duplicates are left out."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from model.data.build import entry_of
from model.data.dedupe import duplicates
from model.data.manifest import PIECES, Manifest, object_file
from model.data.procedural.pieces import visible_points
from model.data.rendering.cameras import free_cameras
from model.data.rendering.render import shoot, stage
from model.data.rendering.surface import Floats
from model.data.sources.meshes import MeshRecord, load_parts
from model.data.workers import run_with_report
from service.files import whole_file


@dataclass(frozen=True)
class MeshPieceJob:
    """One mesh to make a piece of; the piece depends on (seed, the record's id) and the mesh only."""

    record: MeshRecord
    target: Path
    seed: int
    views: int


def make_from_meshes(records: Iterable[MeshRecord], folder: Path, views: int, processes: int) -> Manifest:
    """Write the missing pieces of the records to the data set `folder`, and then remove those that repeat another.

    Pieces are compared within their category, as `build` compares objects; the first id stays. Pieces that repeat an
    object of the data set's validation or test split are removed too. Return the manifest of the pieces of all meshes,
    stored beside them.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    objects, pieces = Manifest.read(folder), folder / PIECES
    seed, held_out = (
        objects.seed,
        {entry.id: folder / entry.file for entry in objects.entries if entry.split != "train"},
    )
    pieces.mkdir(exist_ok=True)
    earlier = Manifest.read(pieces) if (pieces / "manifest.json").is_file() else Manifest(seed, (), {}, {})
    jobs = [MeshPieceJob(record, pieces / Path(object_file(record.id)).name, seed, views) for record in records]
    missing = [job for job in jobs if job.record.id not in earlier.duplicates and not job.target.exists()]
    report = run_with_report(render_mesh_piece, missing, lambda job: job.record.id, processes, "make", "piece")
    jobs = [job for job in jobs if job.target.exists()]
    repeats = earlier.duplicates | _repeats(jobs, held_out)
    entries = {entry.id: entry for entry in earlier.entries}
    for job in jobs:
        if job.record.id in repeats:
            job.target.unlink()
        elif job.record.id not in entries:
            file = job.target.relative_to(folder).as_posix()
            entries[job.record.id] = replace(entry_of(job.record, "train"), file=file)
    manifest = Manifest(seed, tuple(entries[id_] for id_ in sorted(entries)), repeats, report.failures)
    manifest.write(pieces / "manifest.json")
    return manifest


def _repeats(jobs: Iterable[MeshPieceJob], held_out: Mapping[str, Path]) -> dict[str, str]:
    """Return the pieces that repeat a held-out object or another piece of their category: id left out -> id kept."""
    kept = {id_: _points(file) for id_, file in held_out.items()}
    by_category: dict[str, dict[str, Path]] = defaultdict(dict)
    for job in jobs:
        by_category[job.record.category][job.record.id] = job.target
    repeats: dict[str, str] = {}
    for targets in tqdm(by_category.values(), desc="compare", unit="category", disable=None):
        repeats |= duplicates(kept | {id_: _points(target) for id_, target in targets.items()}, first=kept)
    return repeats


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
