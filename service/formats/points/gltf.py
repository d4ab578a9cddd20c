"""glTF 2.0: one mesh of POINTS, unlit; binary (GLB), or JSON with the points in base64.

glTF's frame is ours: right-handed, +Y up, front +Z. The JSON comes before the points and contains their
bounds, so it is padded with spaces to a fixed size: the file's length is known before any point is computed.

Each point is followed by its color: linear, as glTF requires, not sRGB. A color is three float32, since some programs
misread uint16 (trimesh 4 keeps the low byte), and 8 bits are too coarse for dark colors.
"""

import base64
import json
from typing import Any, Final

import numpy as np

from service.formats import raw
from service.formats.glb import OVERHEAD, glb_head
from service.mapping.color import linear
from service.mapping.spec import Array, Colors

JSON_BYTES: Final = 1024
PLAIN: Final = 12  # bytes per point: three float32
COLORED: Final = 24  # bytes per point: six float32; a multiple of 3 like `PLAIN`, so base64 pieces join without padding
POINTS, LINES = 0, 1  # modes of a mesh
_FLOAT, _ARRAY_BUFFER = 5126, 34962
_URI: Final = "data:application/octet-stream;base64,"
_JSON_TAIL: Final = b'"}]}'
_GRAY = [0.18, 0.18, 0.2, 1.0]  # linear RGBA: visible on white and on black
WHITE: Final = [1.0, 1.0, 1.0, 1.0]  # keeps the points' own colors unchanged


def head(n: int, bounds: tuple[Array, Array] | None, *, stride: int = PLAIN, mode: int = POINTS) -> bytes:
    """Return the file header, the JSON chunk and the header of the binary chunk.

    Parameters
    ----------
    n : number of points.
    bounds : the points' smallest and largest coordinates, (3,) and (3,) float32.
    stride : bytes per point: `PLAIN` or `COLORED`.
    mode : `POINTS`, or `LINES` to join the first to the second, the third to the fourth, and so on.

    Raises
    ------
    ValueError : bounds is None; glTF requires them.
    """
    if bounds is None:
        raise ValueError("a GLB file needs the bounds of its points")
    text = json.dumps(_document(n, *bounds, stride, mode), separators=(",", ":")).encode("ascii").ljust(JSON_BYTES)
    return glb_head(text, stride * n)


def colored_body(points: Array, colors: Colors) -> bytes:
    """Write points (m, 3), each followed by its color (m, 3), in 24 m bytes."""
    return raw.float32(np.concatenate([points, linear(colors)], axis=1))


def length(n: int, *, stride: int = PLAIN) -> int:
    """Return the size of the whole GLB file in bytes."""
    return OVERHEAD + JSON_BYTES + stride * n


def max_points(stride: int = PLAIN) -> int:
    """Return the most points that a GLB file can hold: its length is a uint32."""
    return (2**32 - 1 - length(0)) // stride


def json_head(n: int, bounds: tuple[Array, Array] | None, *, stride: int = PLAIN) -> bytes:
    """Return a .gltf file up to the start of its points. Raises ValueError if bounds is None."""
    if bounds is None:
        raise ValueError("a glTF file needs the bounds of its points")
    document = _document(n, *bounds, stride, POINTS)
    document["buffers"][0]["uri"] = _URI
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text = text.removesuffix(_JSON_TAIL)  # the URI is the last value of the document
    before, key, after = text.partition(b'"buffers"')
    return before.ljust(JSON_BYTES - len(key) - len(after)) + key + after


def json_body(points: Array) -> bytes:
    """Write points (m, 3) in 16 m bytes of base64."""
    return base64.b64encode(raw.float32(points))


def colored_json_body(points: Array, colors: Colors) -> bytes:
    """Write points (m, 3), each followed by its color (m, 3), in 32 m bytes of base64."""
    return base64.b64encode(colored_body(points, colors))


def json_tail(n: int) -> bytes:
    """Return the bytes after the points."""
    return _JSON_TAIL


def json_length(n: int, *, stride: int = PLAIN) -> int:
    """Return the size of the whole .gltf file in bytes."""
    return JSON_BYTES + stride // 3 * 4 * n + len(_JSON_TAIL)


def _document(n: int, low: Array, high: Array, stride: int, mode: int) -> dict[str, Any]:
    colored = stride != PLAIN
    position = {
        "bufferView": 0,
        "componentType": _FLOAT,
        "count": n,
        "type": "VEC3",
        "min": low.tolist(),
        "max": high.tolist(),
    }
    color = {
        "bufferView": 0,
        "byteOffset": PLAIN,
        "componentType": _FLOAT,
        "count": n,
        "type": "VEC3",
    }
    attributes = {"POSITION": 0} | ({"COLOR_0": 1} if colored else {})
    base = {"baseColorFactor": WHITE if colored else _GRAY, "metallicFactor": 0, "roughnessFactor": 1}
    view = {"buffer": 0, "byteLength": stride * n, "target": _ARRAY_BUFFER}
    return {
        "asset": {"version": "2.0", "generator": "hof"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0, "mode": mode}]}],
        "materials": [{"pbrMetallicRoughness": base, "extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [position, color] if colored else [position],
        "bufferViews": [view | {"byteStride": stride} if colored else view],
        "buffers": [{"byteLength": stride * n}],
    }
