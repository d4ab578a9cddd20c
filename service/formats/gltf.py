"""glTF 2.0: one mesh of POINTS, unlit; binary (GLB), or JSON with the points in base64.

glTF's frame is ours: right-handed, +Y up, front +Z. Its JSON stands before the points and holds their
bounds, so it is padded with spaces to a fixed size: the length is known before any point is.
"""

import base64
import json
import struct
from typing import Any, Final

from service.formats.raw import float32
from service.mapping import Array

JSON_BYTES: Final = 1024
MAX_POINTS: Final = (2**32 - 1 - JSON_BYTES - 28) // 12  # the file's length is a uint32
_FLOAT, _ARRAY_BUFFER, _POINTS = 5126, 34962, 0
_URI: Final = "data:application/octet-stream;base64,"
_JSON_TAIL: Final = b'"}]}'
_GREY = [0.18, 0.18, 0.2, 1.0]  # linear RGBA: visible on white and on black


def head(n: int, bounds: tuple[Array, Array] | None) -> bytes:
    """File header, JSON chunk and the binary chunk's header.

    Parameters
    ----------
    n : points in the file.
    bounds : the points' smallest and largest coordinates, (3,) and (3,) float32.

    Raises
    ------
    ValueError : bounds is None; glTF requires them.
    """
    if bounds is None:
        raise ValueError("a GLB needs the points' bounds")
    text = json.dumps(_document(n, *bounds), separators=(",", ":")).encode("ascii").ljust(JSON_BYTES)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, length(n)),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", 12 * n, b"BIN\0"),
        ]
    )


def length(n: int) -> int:
    """Bytes of the whole GLB."""
    return 12 + 8 + JSON_BYTES + 8 + 12 * n


def json_head(n: int, bounds: tuple[Array, Array] | None) -> bytes:
    """A .gltf up to where its points begin. Raises ValueError without bounds."""
    if bounds is None:
        raise ValueError("a glTF needs the points' bounds")
    document = _document(n, *bounds)
    document["buffers"][0]["uri"] = _URI
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text = text.removesuffix(_JSON_TAIL)  # the URI is the last value of the document
    before, key, after = text.partition(b'"buffers"')
    return before.ljust(JSON_BYTES - len(key) - len(after)) + key + after


def json_body(points: Array) -> bytes:
    """Points (m, 3) -> 16 m bytes of base64: 12 bytes a point, so that pieces join without padding."""
    return base64.b64encode(float32(points))


def json_tail(n: int) -> bytes:
    """What follows the points."""
    return _JSON_TAIL


def json_length(n: int) -> int:
    """Bytes of the whole .gltf."""
    return JSON_BYTES + 16 * n + len(_JSON_TAIL)


def _document(n: int, low: Array, high: Array) -> dict[str, Any]:
    return {
        "asset": {"version": "2.0", "generator": "hof"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0, "mode": _POINTS}]}],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": _GREY, "metallicFactor": 0, "roughnessFactor": 1},
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": n,
                "type": "VEC3",
                "min": low.tolist(),
                "max": high.tolist(),
            }
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 12 * n, "target": _ARRAY_BUFFER}],
        "buffers": [{"byteLength": 12 * n}],
    }
