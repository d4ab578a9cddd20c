"""glTF 2.0: one mesh of POINTS, unlit; binary (GLB), or JSON with the points in base64.

glTF's frame is ours: right-handed, +Y up, front +Z. Its JSON stands before the points and holds their
bounds, so it is padded with spaces to a fixed size: the length is known before any point is.

A point's colour stands beside it, as glTF wants it: linear, not sRGB. It is three float32: programs that read uint16
wrongly are in use (trimesh 4 keeps the low byte), and one byte is too coarse for what is dark.
"""

import base64
import json
import struct
from typing import Any, Final

import numpy as np

from service.formats import raw
from service.mapping.spec import Array, Colors

JSON_BYTES: Final = 1024
PLAIN: Final = 12  # bytes a point: three float32
COLORED: Final = 24  # six; like `PLAIN` a multiple of 3, so that pieces of base64 join without padding
_FLOAT, _ARRAY_BUFFER, _POINTS = 5126, 34962, 0
_URI: Final = "data:application/octet-stream;base64,"
_JSON_TAIL: Final = b'"}]}'
_GREY = [0.18, 0.18, 0.2, 1.0]  # linear RGBA: visible on white and on black
WHITE: Final = [1.0, 1.0, 1.0, 1.0]  # leaves colours of their own as they are


def head(n: int, bounds: tuple[Array, Array] | None, *, stride: int = PLAIN) -> bytes:
    """File header, JSON chunk and the binary chunk's header.

    Parameters
    ----------
    n : points in the file.
    bounds : the points' smallest and largest coordinates, (3,) and (3,) float32.
    stride : bytes a point, `PLAIN` without colours.

    Raises
    ------
    ValueError : bounds is None; glTF requires them.
    """
    if bounds is None:
        raise ValueError("a GLB needs the points' bounds")
    text = json.dumps(_document(n, *bounds, stride), separators=(",", ":")).encode("ascii").ljust(JSON_BYTES)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, length(n, stride=stride)),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", stride * n, b"BIN\0"),
        ]
    )


def colored_body(points: Array, colors: Colors) -> bytes:
    """Points (m, 3) and their colours (m, 3) -> 24 m bytes."""
    return raw.float32(np.concatenate([points, linear(colors)], axis=1))


def length(n: int, *, stride: int = PLAIN) -> int:
    """Bytes of the whole GLB."""
    return 12 + 8 + JSON_BYTES + 8 + stride * n


def max_points(stride: int = PLAIN) -> int:
    """How many points a GLB holds: its length is a uint32."""
    return (2**32 - 1 - length(0)) // stride


def json_head(n: int, bounds: tuple[Array, Array] | None, *, stride: int = PLAIN) -> bytes:
    """A .gltf up to where its points begin. Raises ValueError without bounds."""
    if bounds is None:
        raise ValueError("a glTF needs the points' bounds")
    document = _document(n, *bounds, stride)
    document["buffers"][0]["uri"] = _URI
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text = text.removesuffix(_JSON_TAIL)  # the URI is the last value of the document
    before, key, after = text.partition(b'"buffers"')
    return before.ljust(JSON_BYTES - len(key) - len(after)) + key + after


def json_body(points: Array) -> bytes:
    """Points (m, 3) -> 16 m bytes of base64."""
    return base64.b64encode(raw.float32(points))


def colored_json_body(points: Array, colors: Colors) -> bytes:
    """Points (m, 3) and their colours (m, 3) -> 32 m bytes of base64."""
    return base64.b64encode(colored_body(points, colors))


def json_tail(n: int) -> bytes:
    """What follows the points."""
    return _JSON_TAIL


def json_length(n: int, *, stride: int = PLAIN) -> int:
    """Bytes of the whole .gltf."""
    return JSON_BYTES + stride // 3 * 4 * n + len(_JSON_TAIL)


def linear(colors: Colors) -> Array:
    """sRGB levels as linear light in [0, 1], float32."""
    return _LINEAR[colors]


def _levels() -> Array:
    """Each of the 256 levels as linear light (IEC 61966-2-1)."""
    level = np.arange(256) / 255
    light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)


_LINEAR: Final = _levels()


def _document(n: int, low: Array, high: Array, stride: int) -> dict[str, Any]:
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
    base = {"baseColorFactor": WHITE if colored else _GREY, "metallicFactor": 0, "roughnessFactor": 1}
    view = {"buffer": 0, "byteLength": stride * n, "target": _ARRAY_BUFFER}
    return {
        "asset": {"version": "2.0", "generator": "hof"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0, "mode": _POINTS}]}],
        "materials": [{"pbrMetallicRoughness": base, "extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [position, color] if colored else [position],
        "bufferViews": [view | {"byteStride": stride} if colored else view],
        "buffers": [{"byteLength": stride * n}],
    }
