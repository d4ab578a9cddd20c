"""Build a data set: render every mesh, drop duplicates, split, write the manifest."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from model.data.dedupe import duplicates
from model.data.manifest import COLORS, OBJECTS, Entry, Manifest, Split, assign_splits, object_file
from model.data.rendering.render import render_parts
from model.data.sources.meshes import IDENTITY, MeshRecord, load_mesh
from model.data.workers import run_with_report
from service.files import whole_file
from service.mapping.spec import Array


@dataclass(frozen=True)
class RenderJob:
    """One mesh to render into `target`, an .npz with the fields of `render.Rendered`."""

    record: MeshRecord
    target: Path
    seed: int


def build(
    records: Iterable[MeshRecord],
    out: Path,
    seed: int,
    processes: int,
    frozen: Mapping[str, Split] | None = None,
    split: Split | None = None,
) -> Manifest:
    """Render missing meshes, then write `out/manifest.json` and return it.

    A mesh that cannot be read or crashes its worker is left out and in `failures`; one that lacks textures is in
    `losses`. A second run resumes. Objects keep the split of an earlier build or of `frozen` (id -> split), since
    models may have been trained on them; new ones are all in `split`, or drawn. Objects of other sources stay.

    Raises
    ------
    ValueError : two meshes have the same name, no mesh can be used, or `out` was built with another seed.
    """
    (out / OBJECTS).mkdir(parents=True, exist_ok=True)
    jobs = [RenderJob(record, out / object_file(record.id), seed) for record in records]
    _check_names(jobs)
    earlier = _earlier(out, seed)
    ids, sources = {job.record.id for job in jobs}, {job.record.source for job in jobs}
    kept = [entry for entry in earlier.entries if entry.source not in sources and entry.id not in ids]
    missing = [job for job in jobs if not job.target.exists()]
    report = run_with_report(render_to_file, missing, lambda job: job.record.id, processes, "render", "mesh")
    rendered = {job.record.id: job for job in jobs if job.target.exists()}
    if not rendered:
        raise ValueError(_no_mesh(report.failures))
    files = {entry.id: out / entry.file for entry in kept} | {id_: job.target for id_, job in rendered.items()}
    repeats = duplicates(_read_clouds(files), first={entry.id for entry in kept})
    unique = [id_ for id_ in rendered if id_ not in repeats]
    splits = assign_splits(unique, seed, _fixed_splits(unique, split, earlier, frozen or {}))
    new = (entry_of(rendered[id_].record, split_) for id_, split_ in splits.items())
    entries = tuple(sorted([*kept, *new], key=lambda entry: entry.id))
    remarks = {**earlier.losses, **report.remarks}
    losses = {entry.id: remarks[entry.id] for entry in entries if entry.id in remarks}
    manifest = Manifest(seed, entries, repeats, report.failures, losses)
    manifest.write(out / "manifest.json")
    return manifest


def _read_clouds(files: Mapping[str, Path]) -> dict[str, Array]:
    """Return the points of objects, by id."""
    return {id_: np.load(file)["points"] for id_, file in tqdm(files.items(), desc="read", unit="object", disable=None)}


def _fixed_splits(
    ids: Iterable[str], split: Split | None, earlier: Manifest, frozen: Mapping[str, Split]
) -> dict[str, Split]:
    """Return the splits that are not drawn: of `frozen`, else of an earlier build, else `split`."""
    fixed = {id_: split for id_ in ids if split}
    return fixed | {entry.id: entry.split for entry in earlier.entries} | dict(frozen)


def _no_mesh(failures: Mapping[str, str]) -> str:
    """Return a sentence that says that, and why, there is nothing to build from."""
    if not failures:
        return "there is no mesh to build from: pass a folder with meshes, or a --limit above 0"
    id_, failure = next(iter(failures.items()))
    return f"none of {len(failures)} meshes can be used; {id_}: {failure}"


def entry_of(record: MeshRecord, split: Split) -> Entry:
    """Return the manifest's entry of a rendered mesh."""
    return Entry(
        id=record.id,
        name=record.name,
        source=record.source,
        category=record.category,
        creator=record.creator,
        license=record.license,
        mesh_sha256=hashlib.sha256(record.path.read_bytes()).hexdigest(),
        file=object_file(record.id),
        split=split,
        page=record.page,
        rotation=None if record.rotation == IDENTITY else record.rotation,
    )


def _earlier(out: Path, seed: int) -> Manifest:
    """Return the manifest of an earlier build in the same folder, or an empty one."""
    if not (out / "manifest.json").exists():
        return Manifest(seed, (), {}, {})
    manifest = Manifest.read(out)
    if manifest.seed != seed:
        raise ValueError(f"{out} was built with seed {manifest.seed}: build with seed {seed} in another folder")
    return manifest


def _check_names(jobs: list[RenderJob]) -> None:
    meshes: dict[Path, Path] = {}
    for job in jobs:
        other = meshes.setdefault(job.target, job.record.path)
        if other != job.record.path:
            raise ValueError(f"{other} and {job.record.path} have one name, {job.target.stem}: rename one of them")


def render_to_file(job: RenderJob) -> str | None:
    """Render one mesh and write its file, whole or not at all; return what it lacks (runs in a worker process)."""
    mesh = load_mesh(job.record)
    rendered = render_parts(mesh.parts, job.record.id, job.seed)
    with whole_file(job.target) as file:
        arrays = {COLORS if name == "colors" else name: array for name, array in vars(rendered).items()}
        np.savez_compressed(file, **arrays)
    return "; ".join(mesh.losses) or None
