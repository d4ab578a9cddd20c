"""Variants of a built data set's objects: free cameras, stretched and warped shapes. The manifest is unchanged."""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyvista
import trimesh

from model.data.manifest import SURFACE_POINTS, VARIANTS, Manifest, texture_files, variant_file
from model.data.procedural.textures import redress
from model.data.rendering.cameras import Doubles, free_cameras
from model.data.rendering.render import shoot, stage, stretch
from model.data.rendering.surface import sample_surface
from model.data.sources.meshes import MeshRecord, load_parts
from model.data.warp import STRETCH, warp
from model.data.workers import run_with_report
from service.files import whole_file

STRETCHED: Final = 4  # variants 1 to this one are stretched, those after it are warped
WARPED: Final = 9  # variants after this one are warped, in other colors and textures

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Variant:
    """One variant of an object.

    views : (views, SIZE, SIZE, 4) uint8 RGBA, alpha is the mask.
    cameras : (views, 4) float32, azimuth and elevation in degrees, distance in longest sides, roll in degrees.
    points : (SURFACE_POINTS, 3) float32, object frame; those of the object itself for variant 0.
    stretch : (3,) float32, scale of the object's frame along x, y, z; 1 if it was warped instead.
    """

    views: npt.NDArray[np.uint8]
    cameras: Floats
    points: Floats
    stretch: Floats


@dataclass(frozen=True)
class VariantsJob:
    """The missing variants of one object. `targets` maps number -> file."""

    record: MeshRecord
    base: Path
    targets: dict[int, Path]
    train: bool
    textures: list[Path]
    views: int
    seed: int


def vary(records: Iterable[MeshRecord], folder: Path, variants: int, views: int, processes: int) -> dict[str, str]:
    """Write the missing variants of the objects in `folder`'s manifest that are of the records' sources.

    Return id -> failure.

    Variant 0 is the object itself under free cameras. In the training split, variants 1 to STRETCHED are stretched,
    those up to WARPED are warped, and those up to `variants` are warped with textures of other training objects. Each
    depends on (the manifest's seed, id, number) only. A second run resumes.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set, or lacks the textures for variants above WARPED.
    ValueError : the records lack an object of their sources, or all are of other sources.
    """
    manifest = Manifest.read(folder)
    by_id = {record.id: record for record in records}
    sources = {record.source for record in by_id.values()}
    entries = [entry for entry in manifest.entries if entry.source in sources] or manifest.entries
    if missing_ids := [entry.id for entry in entries if entry.id not in by_id]:
        raise ValueError(
            f"the source lacks {len(missing_ids)} objects of the manifest, {missing_ids[0]} among them: "
            "pass the meshes that the data set was built from"
        )
    (folder / VARIANTS).mkdir(exist_ok=True)
    textures = texture_files(folder)
    if variants > WARPED and not textures:
        raise FileNotFoundError(
            f"{folder} holds no textures: run `hof-model data textures` first, or pass --variants {WARPED}"
        )
    jobs = []
    for entry in entries:
        train = entry.split == "train"
        files = {number: variant_file(folder, entry, number) for number in range(1 + variants * train)}
        missing = {number: file for number, file in files.items() if not file.exists()}
        if missing:
            base = folder / entry.file
            record = replace(by_id[entry.id], rotation=entry.rotation or by_id[entry.id].rotation)
            jobs.append(VariantsJob(record, base, missing, train, textures, views, manifest.seed))
    return run_with_report(render_variants, jobs, lambda job: job.record.id, processes, "vary", "object").failures


def render_variants(job: VariantsJob) -> None:
    """Render a job's variants from one loaded mesh; each file is written whole or not at all (a worker process)."""
    parts = load_parts(job.record)
    with np.load(job.base) as arrays:
        base: Floats = arrays["points"]
    with closing(stage(parts, multisampling=False)) as plotter:
        for number, target in job.targets.items():
            rng = np.random.default_rng([job.seed, number, *job.record.id.encode()])
            if number > STRETCHED:
                variant = _render_warped(parts, job, number, rng)
            else:
                scale = stretch_factors(parts, rng) if number else np.ones(3)
                points = scaled_points(parts, scale, rng) if number else base
                stretch(plotter, scale)
                variant = _render_free(plotter, scale, points, job, rng)
            with whole_file(target) as file:
                np.savez_compressed(file, **vars(variant))


def _render_warped(parts: list[trimesh.Trimesh], job: VariantsJob, number: int, rng: np.random.Generator) -> Variant:
    warped, scale = warp(parts, rng), np.ones(3)
    points = scaled_points(warped, scale, rng)
    if number > WARPED:
        redress(warped, job.textures, rng.spawn(1)[0])  # keeps the cameras of the plain variant
    with closing(stage(warped, multisampling=False)) as plotter:
        return _render_free(plotter, scale, points, job, rng)


def _render_free(
    plotter: pyvista.Plotter, scale: Doubles, points: Floats, job: VariantsJob, rng: np.random.Generator
) -> Variant:
    cameras = free_cameras(job.views, job.train, rng)
    views = shoot(plotter, cameras, points, rng)
    return Variant(views, cameras.astype(np.float32), points, scale.astype(np.float32))


def stretch_factors(parts: list[trimesh.Trimesh], rng: np.random.Generator) -> Doubles:
    """Return random factors along the axes, (3,), that keep the longest side of the bounding box at 1.

    `parts` are in the object frame, so the box stays centered. Symmetric objects stay symmetric.
    """
    corners = np.concatenate([part.vertices[np.unique(part.faces)] for part in parts])
    scale = np.exp(rng.uniform(-STRETCH, STRETCH, 3))
    factors: Doubles = scale / (np.ptp(corners, axis=0) * scale).max()
    return factors


def scaled_points(parts: list[trimesh.Trimesh], scale: Doubles, rng: np.random.Generator) -> Floats:
    """Sample the scaled surface uniformly by area: (SURFACE_POINTS, 3) float32."""
    scaled = [trimesh.Trimesh(part.vertices * scale, part.faces, process=False) for part in parts]
    return sample_surface(scaled, SURFACE_POINTS, rng)[0]
