"""Mesh records of any source, folders of mesh files, and the object frame."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from model.data.sources.axes import AXES, Axis
from model.data.sources.formats.read import MESH_SUFFIXES, read_parts

MAX_FACES: Final = 4_000_000
ARCHIVES: Final = (".zip", ".7z", ".rar", ".gz", ".tgz", ".tar")
OTHER_SUFFIXES: Final = (".3ds", ".abc", ".blend", ".dae", ".fbx", ".max", ".step", ".stp", ".usd", ".usdz", ".x3d")
IDENTITY: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
SURROGATES: Final = range(0xDC80, 0xDD00)  # how Python shows the bytes of a file name that are no UTF-8


@dataclass(frozen=True)
class MeshRecord:
    """One mesh file and its metadata.

    id : `source/name`, unique within the data set, stable between runs.
    path : the mesh file, which refers to its materials and textures.
    rotation : row-major 3x3 matrix from the file's frame to the object frame (+Y up, front +Z).
    root : folder below which textures are searched; None for the file's folder.
    page : address of the object's page, for NOTICE.
    """

    id: str
    path: Path
    source: str
    name: str
    category: str
    creator: str
    license: str
    rotation: tuple[float, ...] = IDENTITY
    root: Path | None = None
    page: str = ""


@dataclass(frozen=True)
class Mesh:
    """A mesh in the object frame, as parts of one material each.

    losses : a sentence for each texture or material that could not be used.
    """

    parts: list[trimesh.Trimesh]
    losses: tuple[str, ...]


def folder_records(root: Path, license_: str = "unknown", rotation: tuple[float, ...] = IDENTITY) -> list[MeshRecord]:
    """Return every mesh file below `root`, sorted; the category is the name of the file's folder.

    Raises
    ------
    NotADirectoryError : `root` is not a folder.
    FileNotFoundError : there is no mesh file below `root`.
    """
    check_folder(root)
    source = readable(root.absolute().name)
    paths = sorted(path for path in root.rglob("*") if path.is_file())
    records = []
    for path in paths:
        if path.suffix.lower() in MESH_SUFFIXES:
            relative = path.relative_to(root)
            records.append(
                MeshRecord(
                    id=f"{source}/{readable(relative.with_suffix('').as_posix())}",
                    path=path,
                    source=source,
                    name=readable(path.stem),
                    category=readable(relative.parent.name) or source,
                    creator="unknown",
                    license=license_,
                    rotation=rotation,
                    root=root,
                )
            )
    if not records:
        raise FileNotFoundError(f"{root} holds no mesh: {_advice(paths)}")
    return records


def check_folder(root: Path) -> None:
    """Raise NotADirectoryError, with what to pass instead, unless `root` is a folder."""
    if root.is_dir():
        return
    if not root.exists():
        raise NotADirectoryError(f"{root} is not there: pass the folder that holds the meshes")
    advice = "unpack it and pass the folder" if root.suffix.lower() in ARCHIVES else "pass the folder that holds it"
    raise NotADirectoryError(f"{root} is a file, not a folder: {advice}")


def skipped_files(root: Path) -> str | None:
    """Return a sentence on archives and formats below `root` that are not read, or None."""
    return _describe_unread(path for path in root.rglob("*") if path.is_file())


def _advice(paths: list[Path]) -> str:
    """Return what to do about a folder without meshes."""
    return _describe_unread(iter(paths)) or f"put {', '.join(MESH_SUFFIXES)} files there, or pass another folder"


def _describe_unread(paths: Iterator[Path]) -> str | None:
    counts = Counter(path.suffix.lower() for path in paths)
    archives = {suffix: counts[suffix] for suffix in ARCHIVES if counts[suffix]}
    others = {suffix: counts[suffix] for suffix in OTHER_SUFFIXES if counts[suffix]}
    sentences = []
    if archives:
        sentences.append(f"{_list_counts(archives)} not read, unpack them there")
    if others:
        sentences.append(f"{_list_counts(others)} not read, convert them to .glb")
    return "; ".join(sentences) or None


def _list_counts(counts: dict[str, int]) -> str:
    total = sum(counts.values())
    return f"{', '.join(f'{count} {suffix}' for suffix, count in counts.items())} {'is' if total == 1 else 'are'}"


def readable(name: str) -> str:
    """Return a file name as text: bytes that are no UTF-8 become %XX, so that it can be printed and stored."""
    return "".join(f"%{ord(sign) - 0xDC00:02X}" if ord(sign) in SURROGATES else sign for sign in name)


def turn(up: Axis, front: Axis | None = None) -> tuple[float, ...]:
    """Return the rotation to the object frame of a file with these axes: row-major 3x3.

    Parameters
    ----------
    front : axis that points to the viewer; None for +Z, or for -Y where Z is up.

    Raises
    ------
    ValueError : no such axis, or both are on one line.
    """
    upward = _axis(up)
    toward = _axis(front or ("-y" if up.strip("-") == "z" else "z"))
    right = np.cross(upward, toward)
    if not right.any():
        raise ValueError(f"up {up!r} and front {front!r} lie on one line: choose another front")
    return tuple((np.concatenate([right, upward, toward]) + 0.0).tolist())  # no -0.0


def _axis(name: str) -> npt.NDArray[np.float64]:
    if name not in AXES:
        raise ValueError(f"{name!r} is no axis: use one of {', '.join(AXES)}")
    axis: npt.NDArray[np.float64] = np.eye(3)["xyz".index(name[-1])]
    return -axis if name.startswith("-") else axis


def load_mesh(record: MeshRecord) -> Mesh:
    """Load the record's mesh in the object frame.

    The bounding box is centered at the origin and its longest side is 1, whatever the file's unit.

    Raises
    ------
    ValueError : no triangles, a flat or non-finite bounding box, more than MAX_FACES triangles, or an extension that
        is not read.
    """
    parts, losses = read_parts(record.path, record.root or record.path.parent)
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        raise ValueError("the file holds no triangles")
    if sum(len(part.faces) for part in parts) > MAX_FACES:
        raise ValueError(f"more than {MAX_FACES:,} triangles")
    transform = to_object_frame(parts, np.asarray(record.rotation, dtype=np.float64).reshape(3, 3))
    for part in parts:
        part.apply_transform(transform)
    return Mesh(parts, losses)


def load_parts(record: MeshRecord) -> list[trimesh.Trimesh]:
    """Return the parts of `load_mesh`."""
    return load_mesh(record).parts


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
