"""Folders of meshes with a list, `manifest.jsonl`: one JSON object a line, with source, license and author."""

import json
from pathlib import Path, PurePosixPath
from typing import Any, Final

from model.data.sources.axes import Axis
from model.data.sources.formats.read import MESH_SUFFIXES
from model.data.sources.meshes import MeshRecord, check_folder, folder_records, readable, turn

LIST: Final = "manifest.jsonl"


def mesh_records(root: Path, license_: str = "unknown", up: Axis = "y", front: Axis | None = None) -> list[MeshRecord]:
    """Return the meshes that `root/manifest.jsonl` lists, in its order; without that file, all below `root`.

    Parameters
    ----------
    license_, up, front : for meshes whose line does not tell.

    Raises
    ------
    NotADirectoryError : `root` is not a folder.
    FileNotFoundError : there is no mesh.
    ValueError : a line of the list is no object, or has a wrong value; or the axes do not fit.
    """
    check_folder(root)
    path = root / LIST
    if not path.is_file():
        return folder_records(root, license_, turn(up, front))
    records = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.strip():
            try:
                records.append(_record(root, json.loads(line), license_, up, front))
            except ValueError as error:
                raise ValueError(f"{path}, line {number}: {error}") from error
    if not records:
        raise FileNotFoundError(f"{path} is empty: list the meshes there, or remove it to use all meshes in {root}")
    return records


def _record(root: Path, row: Any, license_: str, up: Axis, front: Axis | None) -> MeshRecord:  # noqa: ANN401 - JSON
    """Return the record of a line.

    Raises
    ------
    ValueError : the line is no object, has no usable `file`, or wrong axes.
    """
    if not isinstance(row, dict):
        raise ValueError('an object is expected, as {"file": "chair.glb"}')  # noqa: TRY004 - of the file, not the code
    file = row.get("file")
    if not isinstance(file, str) or not file.lower().endswith(MESH_SUFFIXES):
        raise ValueError(f"file {file!r} is not the name of a mesh: {', '.join(MESH_SUFFIXES)} are read")
    relative = PurePosixPath(file)
    if relative.is_absolute() or ".." in relative.parts:
        raise ValueError(f"file {file!r} is not below {root}: move it there")
    base = readable(root.absolute().name)
    return MeshRecord(
        id=f"{base}/{readable(relative.with_suffix('').as_posix())}",
        path=root / relative,
        source=_text(row, "source", default=base),
        name=_text(row, "title", "name", default=readable(relative.stem)),
        category=_text(row, "category", default=readable(relative.parent.name) or base),
        creator=_text(row, "author", default="unknown"),
        license=_text(row, "license", "licence", default=license_),
        rotation=_rotation(row, up, front),
        root=root,
        page=_text(row, "page", default=""),
    )


def _rotation(row: dict[str, Any], up: Axis, front: Axis | None) -> tuple[float, ...]:
    """Return the rotation of a line; the folder's front counts where the line has no other `up`."""
    own_up = row.get("up") or up
    return turn(own_up, row.get("front") or (front if own_up == up else None))


def _text(row: dict[str, Any], *keys: str, default: str) -> str:
    """Return the first of the keys that has text.

    Raises
    ------
    ValueError : a value is not text.
    """
    for key in keys:
        value = row.get(key)
        if value is not None and not isinstance(value, str):
            raise ValueError(f"{key} {value!r} is not text")
        if value:
            return value
    return default
