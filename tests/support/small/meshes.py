"""Small mesh files with one difficulty each. Box `number` has its own proportions, so that none repeats another."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

BROWN = (150, 90, 40)
L_SHAPE = ((0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2))
L_SIDES = [[2, 3, 4, 5, 6, 1], [7, 12, 11, 10, 9, 8], *([n, n % 6 + 1, n % 6 + 7, n + 6] for n in range(1, 7))]

Doubles = npt.NDArray[np.float64]


def box(number: int) -> trimesh.Trimesh:
    """Return a box of many faces; its height tells it from other boxes."""
    solid = trimesh.creation.box(extents=(1, 0.15 + 0.04 * number, 0.4))
    return solid.subdivide().subdivide().subdivide()


def halves(points: Doubles) -> npt.NDArray[np.uint8]:
    """Return red where x is negative, blue elsewhere, (n, 4)."""
    colors: npt.NDArray[np.uint8] = np.where(points[:, :1] < 0, (255, 0, 0, 255), (0, 0, 255, 255)).astype(np.uint8)
    return colors


def corner_shape(height: float) -> list[tuple[float, float, float]]:
    """Return the corners of a prism over L_SHAPE, bottom first."""
    return [(x, y, z) for y in (0.0, height) for x, z in L_SHAPE]


def write_textured(path: Path, number: int, texture: str, library: str | None = None) -> None:
    """Write an OBJ box whose material names `texture`."""
    solid = trimesh.creation.box(extents=(1, 0.15 + 0.04 * number, 0.4))
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"mtllib {library or path.with_suffix('.mtl').name}", "usemtl wood", "vt 0.5 0.5"]
    lines += [f"v {x} {y} {z}" for x, y, z in solid.vertices]
    lines += ["f " + " ".join(f"{corner + 1}/1" for corner in face) for face in solid.faces]
    path.write_text("\n".join(lines) + "\n")
    if library is None:
        path.with_suffix(".mtl").write_text(f"newmtl wood\nKd 1 1 1\nmap_Kd {texture}\n", encoding="latin-1")


def write_image(path: Path, color: tuple[int, int, int] = BROWN) -> None:
    """Write an image of one color."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (8, 8), color).save(path)


def write_gltf(path: Path, number: int, **changes: Any) -> None:  # noqa: ANN401 - JSON
    """Write a box as glTF, its buffer in the file.

    changes : members of the top object; `material` is its only material, `colors` are COLOR_0 and `uv` TEXCOORD_0.
    """
    solid = box(number)
    arrays: list[npt.NDArray[Any]] = [
        np.asarray(solid.vertices, np.float32),
        np.asarray(solid.faces, np.uint16).reshape(-1),
    ]
    attributes = {"POSITION": 0}
    if (colors := changes.pop("colors", None)) is not None:
        attributes["COLOR_0"] = 2
        arrays.append(np.asarray(colors, np.float32))
    if (uv := changes.pop("uv", None)) is not None:
        attributes["TEXCOORD_0"] = len(arrays)
        arrays.append(np.asarray(uv, np.float32))
    data = b"".join(array.tobytes() for array in arrays)
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    primitive: dict[str, Any] = {"attributes": attributes, "indices": 1}
    if (material := changes.pop("material", None)) is not None:
        primitive["material"] = 0
        changes["materials"] = [material]
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [_accessor(view, array) for view, array in enumerate(arrays)],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes}
            for start, array in zip(starts, arrays, strict=False)
        ],
        "buffers": [{"byteLength": len(data), "uri": data_uri(data)}],
        **changes,
    }
    path.write_text(json.dumps(header))


def data_uri(data: bytes) -> str:
    """Return data as an address that contains it."""
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def _accessor(view: int, array: npt.NDArray[Any]) -> dict[str, Any]:
    kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[array.shape[-1] if array.ndim > 1 else 1]
    component = 5126 if array.dtype == np.float32 else 5123
    return {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
