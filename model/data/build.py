"""Build a data set: render every mesh, drop duplicates, split, write the manifest."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from tqdm import tqdm

from model.data.dedupe import duplicates
from model.data.manifest import COLORS, Entry, Manifest, Split, assign_splits
from model.data.rendering.render import render
from model.data.sources.meshes import MeshRecord
from model.data.workers import run_with_progress
from service.files import whole_file

OBJECTS: Final = "objects"


@dataclass(frozen=True)
class RenderJob:
    """One mesh to render into `target`, an .npz with the fields of `render.Rendered`."""

    record: MeshRecord
    target: Path
    seed: int


def build(
    records: Iterable[MeshRecord], out: Path, seed: int, processes: int, frozen: Mapping[str, Split] | None = None
) -> Manifest:
    """Render missing meshes, then write `out/manifest.json` and return it.

    A mesh that cannot be read or crashes its worker is reported in `failures` and left out. A second run resumes.
    Objects keep the split of an earlier build or of `frozen` (id -> split), since models may have been trained on them.

    Raises
    ------
    ValueError : two meshes have the same name, or `out` was built with another seed.
    """
    (out / OBJECTS).mkdir(parents=True, exist_ok=True)
    fixed = {**_earlier_splits(out, seed), **(frozen or {})}
    jobs = [RenderJob(record, out / object_file(record.id), seed) for record in records]
    _check_names(jobs)
    missing = [job for job in jobs if not job.target.exists()]
    failures = run_with_progress(render_to_file, missing, lambda job: job.record.id, processes, "render", "mesh")
    rendered = {job.record.id: job for job in jobs if job.target.exists()}
    clouds = {id_: np.load(job.target)["points"] for id_, job in tqdm(rendered.items(), desc="read", unit="object")}
    repeats = duplicates(clouds)
    splits = assign_splits([id_ for id_ in rendered if id_ not in repeats], seed, fixed)
    entries = tuple(
        Entry(
            id=id_,
            name=record.name,
            source=record.source,
            category=record.category,
            creator=record.creator,
            license=record.license,
            mesh_sha256=hashlib.sha256(record.path.read_bytes()).hexdigest(),
            file=object_file(id_),
            split=splits[id_],
        )
        for id_, record in sorted((id_, rendered[id_].record) for id_ in splits)
    )
    manifest = Manifest(seed, entries, repeats, failures)
    manifest.write(out / "manifest.json")
    return manifest


def _earlier_splits(out: Path, seed: int) -> dict[str, Split]:
    """Return the splits of an earlier build in the same folder."""
    if not (out / "manifest.json").exists():
        return {}
    manifest = Manifest.read(out)
    if manifest.seed != seed:
        raise ValueError(f"{out} was built with seed {manifest.seed}: build with seed {seed} in another folder")
    return {entry.id: entry.split for entry in manifest.entries}


def _check_names(jobs: list[RenderJob]) -> None:
    meshes: dict[Path, Path] = {}
    for job in jobs:
        other = meshes.setdefault(job.target, job.record.path)
        if other != job.record.path:
            raise ValueError(f"{other} and {job.record.path} have one name, {job.target.stem}: rename one of them")


def object_file(id_: str) -> str:
    """Return the path of an object's arrays, relative to the data set's folder."""
    return f"{OBJECTS}/{id_.replace('/', '__')}.npz"


def render_to_file(job: RenderJob) -> None:
    """Render one mesh and write its file, whole or not at all (runs in a worker process)."""
    rendered = render(job.record, job.seed)
    with whole_file(job.target) as file:
        arrays = {COLORS if name == "colors" else name: array for name, array in vars(rendered).items()}
        np.savez_compressed(file, **arrays)
