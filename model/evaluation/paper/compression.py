"""Experiment 13: theta fitted to a mesh, against compressed meshes of as many bytes.

Theta is written as float32, float16 and int8. For each of these files the mesh is decimated (quadric edge collapse)
until its Draco file, or its glTF file with quantized positions (KHR_mesh_quantization, without compression), is no
larger. All are compared with the data set's points of the object. Draco and the decimation come with the extra `dev`.
"""

import importlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
import numpy.typing as npt
import trimesh
from tqdm import tqdm

from model.data.manifest import SURFACE_POINTS, Split
from model.data.rendering.surface import sample_surface
from model.data.sources.meshes import MeshRecord, load_mesh
from model.evaluation.classes import class_of
from model.evaluation.evaluate import Case, cases
from model.evaluation.fitting import MODEL, SPEC, draw
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.evaluation.references.ceiling import STEPS, fit
from model.metrics import compare, floor
from model.provenance import provenance
from service.formats.glb import glb_head
from service.formats.precision import Dtype
from service.formats.weights import Weights, dump, load
from service.mapping.box import measure

EXPERIMENT: Final = "fit"
OBJECTS: Final = 10
THETA: Final = "theta"
DRACO: Final = "Draco"
GLTF: Final = "glTF, quantized"
FLOOR: Final = "sampling floor"
DTYPES: Final[tuple[Dtype, ...]] = get_args(Dtype)
BITS: Final = (8, 11)  # of Draco's positions; the better one counts
QUANTIZED: Final = 65_535
MOST_FACES: Final = 100_000  # of the finest mesh
SHRINK: Final = 0.85  # triangles kept from one decimated mesh to the next
FEWEST_FACES: Final = 12
FIGURES: Final = ("f@1%", "f@2%", "f@5%")
BYTES: Final = "bytes"

Row = dict[str, dict[str, float]]  # method -> figure -> value


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh: vertices (v, 3) float64, object frame, and faces (f, 3)."""

    vertices: npt.NDArray[np.float64]
    faces: npt.NDArray[Any]


def measure_compression(
    data: Path, split: Split, records: Mapping[str, MeshRecord], count: int = OBJECTS, steps: int = STEPS, seed: int = 0
) -> PaperRecord:
    """Measure the first `count` objects of a split.

    Parameters
    ----------
    records : the data set's meshes, by id.

    Raises
    ------
    FileNotFoundError : no data set.
    KeyError : an object has no mesh.
    """
    objects = [case for case, _ in zip(cases(data, split), range(count), strict=False)]
    meshes = [load_mesh(records[case.entry.id]).parts for case in objects]
    clouds = np.stack([sample_surface(parts, SURFACE_POINTS, np.random.default_rng(seed))[0] for parts in meshes])
    thetas = fit(SPEC, clouds, seed, steps)
    rows = []
    for case, parts, theta in tqdm(
        list(zip(objects, meshes, thetas, strict=True)), desc="meshes", unit="object", disable=None
    ):
        files = theta_files(Weights(SPEC, theta, MODEL, frame=measure(SPEC, theta)))
        rows.append(_row(case, _joined(parts), files, seed))
    setting = {"split": split, "objects": len(objects), "steps": steps, "points": SURFACE_POINTS, "bits": BITS}
    names = [*FIGURES, BYTES]
    trials = [
        Trial(method, {name: rounded([row[method][name] for row in rows]) for name in names}) for method in rows[0]
    ]
    ids, classes = [case.entry.id for case in objects], [class_of(case.entry) for case in objects]
    return PaperRecord(EXPERIMENT, setting, {"model": SPEC.name, **provenance(seed)}, ids, classes, trials)


def theta_files(weights: Weights) -> dict[Dtype, bytes]:
    """Return the safetensors file of a function for each type of its numbers."""
    return {dtype: dump(replace(weights, dtype=dtype), "safetensors") for dtype in DTYPES}


def trial_name(method: str, dtype: Dtype) -> str:
    """Return the name of a method at the size of theta's file of a type."""
    return f"{method}, {dtype}"


def decimated(mesh: Triangles) -> Iterator[Triangles]:
    """Yield the mesh, if it has at most MOST_FACES triangles, and ever coarser ones."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=mesh.vertices, face_matrix=mesh.faces))
    meshes.meshing_remove_duplicate_vertices()
    meshes.meshing_remove_null_faces()
    target, count = MOST_FACES, meshes.current_mesh().face_number()
    while target >= FEWEST_FACES:
        if count > target:
            meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=target, preserveboundary=False)
            count = meshes.current_mesh().face_number()
        if 0 < count <= target:
            meshes.meshing_remove_unreferenced_vertices()
            current = meshes.current_mesh()
            yield Triangles(current.vertex_matrix(), current.face_matrix())
        target = int(min(target, max(count, 1)) * SHRINK)


def draco_file(mesh: Triangles, bits: int) -> tuple[bytes, Triangles]:
    """Return the Draco file of a mesh, positions in `bits` bits, and the mesh that it holds."""
    draco: Any = importlib.import_module("DracoPy")
    points, faces = mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32)
    data: bytes = draco.encode(points, faces, quantization_bits=bits, compression_level=10)
    held = draco.decode(data)
    return data, Triangles(np.asarray(held.points, np.float64), np.asarray(held.faces))


def gltf_file(mesh: Triangles) -> tuple[bytes, Triangles]:
    """Return the GLB file of a mesh with positions of 16 bits, and the mesh that it holds."""
    low = mesh.vertices.min(axis=0)
    side = float((mesh.vertices.max(axis=0) - low).max()) or 1.0
    levels = np.rint((mesh.vertices - low) / side * QUANTIZED).astype("<u2")
    small = len(levels) <= QUANTIZED
    indices = mesh.faces.astype("<u2" if small else "<u4").tobytes()
    positions = np.pad(levels, ((0, 0), (0, 1))).tobytes()  # 8 bytes each: rows begin at multiples of 4
    data = positions + indices + bytes(-len(indices) % 4)
    views = [
        {"buffer": 0, "byteLength": len(positions), "byteStride": 8},
        {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)},
    ]
    corners = {"componentType": 5123 if small else 5125, "count": mesh.faces.size, "type": "SCALAR"}
    bounds = {"min": levels.min(axis=0).tolist(), "max": levels.max(axis=0).tolist()}
    places = {"componentType": 5123, "normalized": True, "count": len(levels), "type": "VEC3", **bounds}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": low.tolist(), "scale": [side] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, **places}, {"bufferView": 1, **corners}],
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    held = Triangles(levels / QUANTIZED * side + low, mesh.faces)
    return glb_head(text, len(data)) + data, held


def fitting(mesh: Triangles, limits: Mapping[Dtype, int]) -> dict[str, list[tuple[int, Triangles]]]:
    """Return the finest mesh whose file has at most so many bytes, with its bytes, by method and type.

    There is one for each variant of the method, none if no mesh is small enough.
    """
    kept: dict[str, dict[int, tuple[int, Triangles]]] = {
        trial_name(method, dtype): {} for method in (DRACO, GLTF) for dtype in limits
    }
    for coarse in decimated(mesh):
        files = [(DRACO, bits, *draco_file(coarse, bits)) for bits in BITS]
        for method, variant, data, held in [*files, (GLTF, 0, *gltf_file(coarse))]:
            for dtype, limit in limits.items():
                if len(data) <= limit:
                    kept[trial_name(method, dtype)].setdefault(variant, (len(data), held))
        if sum(map(len, kept.values())) == len(limits) * (len(BITS) + 1):
            break
    return {name: list(variants.values()) for name, variants in kept.items()}


def _row(case: Case, mesh: Triangles, files: Mapping[Dtype, bytes], seed: int) -> Row:
    row: Row = {FLOOR: {**_chosen(floor(case.points)), BYTES: np.nan}}
    for dtype, file in files.items():
        row[trial_name(THETA, dtype)] = {**_chosen(compare(draw(load(file)), case.points)), BYTES: len(file)}
    missing = {**dict.fromkeys(FIGURES, np.nan), BYTES: np.nan}
    for name, variants in fitting(mesh, {dtype: len(file) for dtype, file in files.items()}).items():
        figures = [{**_figures(held, case, seed), BYTES: size} for size, held in variants]
        row[name] = max(figures, key=lambda each: each[FIGURES[0]], default=missing)
    return row


def _figures(mesh: Triangles, case: Case, seed: int) -> dict[str, float]:
    part = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, _ = sample_surface([part], SURFACE_POINTS, np.random.default_rng(seed))
    return _chosen(compare(points, case.points))


def _chosen(figures: Mapping[str, float]) -> dict[str, float]:
    return {name: figures[name] for name in FIGURES}


def _joined(parts: list[trimesh.Trimesh]) -> Triangles:
    """Join the parts of a mesh."""
    whole = trimesh.util.concatenate([trimesh.Trimesh(each.vertices, each.faces, process=False) for each in parts])
    return Triangles(np.asarray(whole.vertices, np.float64), np.asarray(whole.faces))
