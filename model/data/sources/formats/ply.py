"""PLY: concave polygons, and colors that trimesh drops."""

import io
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh

from model.data.sources.formats.assets import Assets
from model.data.sources.formats.polygons import Doubles, concave, split_polygon

COLOR_NAMES: Final = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
UV_NAMES: Final = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))

Ints = npt.NDArray[np.int64]
Lists = npt.NDArray[Any]  # (n, k), or (n,) arrays of different lengths


def read_ply(data: bytes, assets: Assets) -> list[trimesh.Trimesh]:
    """Return the file's mesh, if it has one."""
    scene = trimesh.load_scene(io.BytesIO(data), file_type="ply", resolver=assets, process=False)
    parts = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh)]
    return [_complete(part) for part in parts if len(part.faces)]


def _complete(part: trimesh.Trimesh) -> trimesh.Trimesh:
    """Build the mesh from the file's own elements where trimesh divides polygons wrongly or drops colors."""
    elements: dict[str, Any] = part.metadata.pop("_ply_raw")
    vertex, face = (elements.get(name, {}).get("data") for name in ("vertex", "face"))
    polygons = _lists(face, ("vertex_indices", "vertex_index"))
    if polygons is None:
        return part
    positions = np.stack([_column(vertex, name) for name in "xyz"], axis=1).astype(np.float64)
    vertex_colors, face_colors = (_columns(data, COLOR_NAMES) for data in (vertex, face))
    triangles, owners, changed = _triangles(positions, polygons)
    image = getattr(getattr(part.visual, "material", None), "image", None)
    image = image if getattr(image, "format", None) else None  # without a file trimesh makes up a gray one
    colored = vertex_colors is not None or face_colors is not None
    if not changed and not (colored and image is None and part.visual.kind not in ("vertex", "face")):
        return part
    if image is not None:
        return _textured(positions, triangles, owners, _uv(vertex, face, polygons), image)
    mesh = trimesh.Trimesh(positions, triangles, process=False)
    if face_colors is not None:
        mesh.visual.face_colors = _to_bytes(face_colors)[owners]
    elif vertex_colors is not None:
        mesh.visual.vertex_colors = _to_bytes(vertex_colors)
    return mesh


def _triangles(positions: Doubles, polygons: Lists) -> tuple[Ints, Ints, bool]:
    """Return triangles (m, 3), the polygon of each (m,), and whether a polygon is concave."""
    if polygons.ndim == 2 and polygons.shape[1] == 3:
        return polygons.astype(np.int64), np.arange(len(polygons)), False
    by_size: dict[int, list[int]] = {}
    for number, polygon in enumerate(polygons):
        by_size.setdefault(len(polygon), []).append(number)
    reflex = {
        number
        for size, numbers in by_size.items()
        if size > 3
        for number, flag in zip(numbers, concave(positions[np.stack([polygons[n] for n in numbers])]), strict=True)
        if flag
    }
    triangles, owners = [], []
    for number, polygon in enumerate(polygons):
        if number in reflex:
            corners = split_polygon(positions[polygon])
        else:
            corners = [(0, second, second + 1) for second in range(1, len(polygon) - 1)]
        triangles += [polygon[list(three)] for three in corners]
        owners += [number] * len(corners)
    return np.array(triangles, np.int64).reshape(-1, 3), np.array(owners, np.int64), bool(reflex)


def _textured(
    positions: Doubles, triangles: Ints, owners: Ints, uv: Doubles | list[dict[int, Doubles]] | None, image: object
) -> trimesh.Trimesh:
    """Return a mesh with texture coordinates of its vertices (n, 2), or of each face's vertices."""
    if isinstance(uv, list):
        flat = triangles.reshape(-1)
        places = zip(owners.repeat(3).tolist(), flat.tolist(), strict=True)
        corners = np.array([uv[owner][vertex] for owner, vertex in places])
        positions, triangles, uv = positions[flat], np.arange(len(flat)).reshape(-1, 3), corners
    mesh = trimesh.Trimesh(positions, triangles, process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, image=image)
    return mesh


def _uv(vertex: Any, face: Any, polygons: Lists) -> Doubles | list[dict[int, Doubles]] | None:  # noqa: ANN401
    """Return texture coordinates of the vertices, or per face vertex -> coordinates, or None."""
    if (lists := _lists(face, ("texcoord",))) is not None:
        return [
            dict(zip(polygon.tolist(), numbers.reshape(-1, 2), strict=True))
            for polygon, numbers in zip(polygons, lists, strict=True)
        ]
    return _columns(vertex, UV_NAMES)


def _names(data: Any) -> tuple[str, ...]:  # noqa: ANN401 - a dict of columns, or a structured array
    return tuple(data) if isinstance(data, dict) else tuple(getattr(getattr(data, "dtype", None), "names", None) or ())


def _column(data: Any, name: str) -> npt.NDArray[Any]:  # noqa: ANN401
    return np.asarray(data[name]).reshape(-1)


def _columns(data: Any, choices: tuple[tuple[str, ...], ...]) -> Doubles | None:  # noqa: ANN401
    """Return the first choice of columns that is there, (n, columns), with the type of the file."""
    for names in choices:
        if set(names) <= set(_names(data)):
            return np.stack([_column(data, name) for name in names], axis=1)
    return None


def _lists(data: Any, choices: tuple[str, ...]) -> Lists | None:  # noqa: ANN401
    """Return the first list property that is there: one row an element, or an array of arrays."""
    for name in choices:
        if name in _names(data):
            lists: Lists = data[name]
            return lists["f1"] if lists.dtype.names else lists  # f0 is the length
    return None


def _to_bytes(colors: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Return colors as bytes; those of floats are in [0, 1]."""
    top = 1.0 if colors.dtype.kind == "f" else float(np.iinfo(colors.dtype).max)
    return (colors / top * 255).clip(0, 255).round().astype(np.uint8)
