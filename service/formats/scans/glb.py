"""Binary glTF 2.0: the triangles of its scene, in the scene's frame. Required extensions are refused by name."""

import json
import struct
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from service.errors import CorruptPoints, TooLarge, UnsupportedMedia
from service.formats.scans.limits import MAX_NODES, MAX_TRIANGLES, Doubles

INDICES: Final = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
FLOAT: Final = 5126
TRIANGLES: Final = 4
HEAD: Final = 20  # bytes before the JSON


def read(data: bytes) -> Doubles:
    """Return the triangles of the scene, (t, 3, 3). Raises CorruptPoints, UnsupportedMedia or TooLarge."""
    try:
        document, binary = _chunks(data)
        if required := document.get("extensionsRequired"):
            raise UnsupportedMedia(f"the GLB file needs {', '.join(required)[:100]}, which is not read", field="points")
        meshes: dict[int, Doubles] = {}
        parts, count = [], 0
        for number, matrix in _instances(document):
            if number not in meshes:
                meshes[number] = _triangles(document, binary, document["meshes"][number])
            count += len(meshes[number])
            _check_count(count)
            parts.append(meshes[number] @ matrix[:3, :3].T + matrix[:3, 3])
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError, struct.error) as error:
        raise CorruptPoints(
            f"the GLB file is malformed: {type(error).__name__}: {str(error)[:100]}", field="points"
        ) from error
    return np.concatenate([np.empty((0, 3, 3)), *parts])


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    version, _, length = struct.unpack_from("<III", data, 4)
    if version != 2 or data[16:20] != b"JSON":
        raise ValueError("it is no glTF 2.0")
    document = json.loads(data[HEAD : HEAD + length])
    at = HEAD + length
    binary = b""
    if len(data) >= at + 8:
        size = int.from_bytes(data[at : at + 4], "little")
        binary = data[at + 8 : at + 8 + size]
    return document, binary


def _instances(document: dict[str, Any]) -> Iterator[tuple[int, Doubles]]:
    """Yield the mesh and the matrix (4, 4) of each node of the scene that has a mesh."""
    nodes = document["nodes"]
    scene = document["scenes"][document.get("scene", 0)]
    waiting = [(number, np.eye(4)) for number in scene.get("nodes", [])]
    visits = 0
    while waiting:
        number, above = waiting.pop()
        visits += 1
        if visits > MAX_NODES or len(waiting) > MAX_NODES:
            raise TooLarge(f"the scene has more than {MAX_NODES} nodes, the limit", field="points")
        node = nodes[number]
        matrix = above @ _matrix(node)
        if "mesh" in node:
            yield node["mesh"], matrix
        waiting += [(child, matrix) for child in node.get("children", [])]


def _matrix(node: dict[str, Any]) -> Doubles:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # column by column
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return matrix


def _triangles(document: dict[str, Any], binary: bytes, mesh: dict[str, Any]) -> Doubles:
    parts, count = [], 0
    for primitive in mesh["primitives"]:
        if primitive.get("mode", TRIANGLES) != TRIANGLES:
            continue  # lines and points have no surface
        positions = _numbers(document, binary, primitive["attributes"]["POSITION"], 3)
        indices = _numbers(document, binary, primitive["indices"], 1)[:, 0] if "indices" in primitive else None
        count += len(positions if indices is None else indices) // 3
        _check_count(count)  # primitives may share numbers, so the file's size bounds nothing
        if indices is not None:
            positions = positions[indices]
        parts.append(positions[: len(positions) // 3 * 3].reshape(-1, 3, 3).astype(np.float64))
    return np.concatenate([np.empty((0, 3, 3)), *parts])


def _check_count(triangles: int) -> None:
    if triangles > MAX_TRIANGLES:
        raise TooLarge(f"the scene has more than {MAX_TRIANGLES} triangles, the limit", field="points")


def _numbers(document: dict[str, Any], binary: bytes, number: int, width: int) -> Doubles:
    """Return the numbers of an accessor, (count, width); no more than the file has bytes for."""
    accessor = document["accessors"][number]
    code = "<f4" if width == 3 and accessor["componentType"] == FLOAT else INDICES[accessor["componentType"]]
    view = document["bufferViews"][accessor["bufferView"]]
    if "sparse" in accessor or view.get("buffer", 0) != 0 or "uri" in document["buffers"][0]:
        raise UnsupportedMedia("a GLB file with sparse accessors or other files is not read", field="points")
    item = np.dtype((code, (width,)))
    stride = view.get("byteStride") or item.itemsize
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count = accessor["count"]
    is_inside = start >= 0 and count > 0 and stride >= item.itemsize
    if not is_inside or start + stride * (count - 1) + item.itemsize > len(binary):
        raise ValueError("an accessor lies beyond the file's numbers")
    return np.ndarray((count, width), code, binary, start, (stride, np.dtype(code).itemsize))
