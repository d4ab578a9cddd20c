"""Pack a data set: training and validation objects, their variants and made pieces, into shards."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from tqdm import tqdm

from model.data.augment import oversize
from model.data.dataset import VISIBLE, piece_groups
from model.data.manifest import COLORS, Manifest, variant_files
from model.data.packed.cameras import write_cameras
from model.data.packed.options import PackOptions
from model.data.packed.photographs import pack_photographs
from model.data.packed.shards import (
    FORMAT,
    INDEX,
    MADE_SOURCE,
    OWN,
    SHARDS,
    PackedShape,
    Row,
    quantize,
    read_table,
    write_shard,
)
from model.data.packed.strips import encode_strip
from service.encoding.framing import Framing, frame
from service.files import whole_file

AHEAD: Final = 64  # shapes encoded at most before they are needed


@dataclass(frozen=True)
class _Job:
    """One file to pack; `most_views` and `most_points` of 0 keep all."""

    path: Path
    row: Row  # its views and points are not known yet
    framing: Framing
    quality: int | None
    most_views: int
    most_points: int


def pack(folders: Sequence[Path], output: Path, options: PackOptions, processes: int) -> Path:
    """Write the data sets `folders` as shards to `output`, go on where it stopped, and return the index's path.

    The test split is left out. Equal data and options give equal files, whatever the number of processes.

    Raises
    ------
    FileNotFoundError : a folder holds no finished data set, or no variants or made pieces that are asked for.
    ValueError : `output` holds shards packed with other options, or a file cannot be packed.
    """
    jobs = [job for folder in folders for job in _jobs(folder, options, len(folders) > 1)]
    output.mkdir(parents=True, exist_ok=True)
    shards = sorted(output.glob(SHARDS))
    finished = _finished(shards, jobs, options)
    photographs = pack_photographs(folders, output)
    context = get_context("spawn")  # a fork of a process with threads may hang
    with (
        ProcessPoolExecutor(processes, mp_context=context) as pool,
        tqdm(total=len(jobs), initial=finished, unit="shape", desc="pack", disable=None) as bar,
    ):
        for shapes in _grouped(_packed(pool, jobs[finished:]), options.shard_bytes):
            path = output / f"shard-{len(shards):03d}.npz"
            with whole_file(path) as file:
                write_shard(file, shapes, asdict(options))
            shards.append(path)
            bar.update(len(shapes))
    write_cameras(output, {job.row.key: job.path for job in jobs})
    with whole_file(output / INDEX) as file:
        file.write((json.dumps(_index(shards, photographs, options), indent=1) + "\n").encode())
    return output / INDEX


def _jobs(folder: Path, options: PackOptions, prefixed: bool) -> Iterator[_Job]:
    """Yield the files of a data set in the order in which they are packed."""
    prefix = f"{folder.name}/" if prefixed else ""
    size = options.framing.size
    large = Framing(size * oversize(size), options.framing.foreground_ratio)
    quality = None if options.lossless else options.quality
    for entry in Manifest.read(folder).entries:
        if entry.split == "test":
            continue
        with_variants = options.variants and entry.split == "train"
        for number, path in enumerate([folder / entry.file, *(variant_files(folder, entry) if with_variants else [])]):
            limits = (0, 0) if number < OWN else (options.variant_views, options.variant_points)
            row = Row(prefix + entry.id, entry.id, entry.source, entry.split, number, (), 0, colored=False)
            yield _Job(path, row, large, quality, *limits)
    for number, group in enumerate(piece_groups(folder) if options.made else []):
        for path in group:
            row = Row(f"{prefix}{MADE_SOURCE}/{number}", path.stem, MADE_SOURCE, "train", OWN, (), 0, colored=False)
            yield _Job(path, row, large, quality, options.made_views, options.made_points)


def _finished(shards: list[Path], jobs: list[_Job], options: PackOptions) -> int:
    """Return how many jobs the shards hold that are there."""
    planned = [(job.row.unit, job.row.object) for job in jobs]
    count = 0
    for path in shards:
        written, rows = read_table(path)
        here = [(row.unit, row.object) for row in rows]
        if written != asdict(options) or here != planned[count : count + len(rows)]:
            raise ValueError(f"{path} was packed from other data or with other options: remove it or choose another -o")
        count += len(rows)
    return count


def _packed(pool: ProcessPoolExecutor, jobs: list[_Job]) -> Iterator[PackedShape]:
    """Yield the jobs' shapes in order, AHEAD of them in work at a time."""
    for start in range(0, len(jobs), AHEAD):
        yield from pool.map(_pack_shape, jobs[start : start + AHEAD])


def _pack_shape(job: _Job) -> PackedShape:
    """Frame, encode and quantize one file (a worker process)."""
    rng = np.random.default_rng([*job.row.object.encode()])
    with np.load(job.path) as arrays:
        views, points, colors = arrays["views"], arrays["points"], arrays.get(COLORS)
    shown = [number for number, view in enumerate(views) if (view[..., 3] > 0).mean() > VISIBLE]
    if job.most_views and len(shown) > job.most_views:
        shown = sorted(rng.choice(shown, job.most_views, replace=False).tolist())
    order = rng.permutation(len(points))[: job.most_points or None]
    crops = [np.asarray(frame(Image.fromarray(views[number]), job.framing)[0]) for number in shown]
    try:
        strip, packed = encode_strip(np.stack(crops), job.quality), quantize(points[order])
    except ValueError as error:
        raise ValueError(f"{job.path}: {error}") from error
    row = replace(job.row, views=tuple(shown), points=len(packed), colored=colors is not None)
    return PackedShape(row, strip, packed, colors[order] if colors is not None else np.zeros_like(packed, np.uint8))


def _grouped(shapes: Iterator[PackedShape], max_bytes: int) -> Iterator[list[PackedShape]]:
    """Yield runs of shapes that fit a shard."""
    group: list[PackedShape] = []
    size = 0
    for shape in shapes:
        if group and size + shape.size > max_bytes:
            yield group
            group, size = [], 0
        group.append(shape)
        size += shape.size
    if group:
        yield group


def _index(shards: list[Path], photographs: Path, options: PackOptions) -> dict[str, Any]:
    """Return what `index.json` says."""
    described = []
    for path in shards:
        rows = read_table(path)[1]
        views = Counter[str]()
        for row in rows:
            views[row.split] += len(row.views)
        described.append({**_describe(path), "shapes": len(rows), "views": dict(views)})
    return {"format": FORMAT, **asdict(options), "shards": described, "photographs": _describe(photographs)}


def _describe(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    return {"file": path.name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
