"""Mesh records of any source, folders of mesh files, and the object frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

MESH_SUFFIXES: Final = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off")
MAX_FACES: Final = 4_000_000


@dataclass(frozen=True)
class MeshRecord:
    """One mesh file and its metadata.

    id : `source/name`, unique within the data set, stable between runs.
    path : the mesh file, which refers to its materials and textures.
    rotation : row-major 3x3 matrix from the file's frame to the object frame (+Y up, front +Z).
    """

    id: str
    path: Path
    source: str
    name: str
    category: str
    creator: str
    license: str
    rotation: tuple[float, ...] = (1, 0, 0, 0, 1, 0, 0, 0, 1)


def folder_records(root: Path, license_: str = "unknown") -> Iterator[MeshRecord]:
    """Yield every mesh file below `root`, sorted; the category is the name of the file's folder.

    Raises
    ------
    NotADirectoryError : `root` is not a folder.
    """
    if not root.is_dir():
        raise NotADirectoryError(f"{root} is not a folder")
    for path in sorted(root.rglob("*")):
        if path.suffix.lower() in MESH_SUFFIXES:
            relative = path.relative_to(root)
            yield MeshRecord(
                id=f"{root.name}/{relative.with_suffix('').as_posix()}",
                path=path,
                source=root.name,
                name=path.stem,
                category=relative.parent.name or root.name,
                creator="unknown",
                license=license_,
            )


def load_parts(record: MeshRecord) -> list[trimesh.Trimesh]:
    """Load the record's mesh in the object frame, as parts of one material each.

    The bounding box is centered at the origin and its longest side is 1.

    Raises
    ------
    ValueError : no triangles, a flat or non-finite bounding box, or more than MAX_FACES triangles.
    """
    scene = trimesh.load_scene(record.path, process=False)
    parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not parts:
        raise ValueError("the file holds no triangles")
    if sum(len(part.faces) for part in parts) > MAX_FACES:
        raise ValueError(f"more than {MAX_FACES:,} triangles")
    transform = to_object_frame(parts, np.asarray(record.rotation, dtype=np.float64).reshape(3, 3))
    for part in parts:
        part.apply_transform(transform)
    return parts


def to_object_frame(parts: list[trimesh.Trimesh], rotation: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the 4x4 matrix that rotates the parts, centers their bounding box and scales its longest side to 1.

    Raises
    ------
    ValueError : the box is empty or not finite.
    """
    corners = np.concatenate([part.vertices[np.unique(part.faces)] for part in parts]) @ rotation.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    longest = float((high - low).max())
    if not np.isfinite(longest) or longest <= 0:
        raise ValueError("the bounding box is empty or not finite")
    transform = np.eye(4)
    transform[:3, :3] = rotation / longest
    transform[:3, 3] = -(low + high) / 2 / longest
    return transform
