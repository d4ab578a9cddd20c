"""glTF 2.0 of a surface: one mesh of TRIANGLES with normals; binary (GLB), or JSON with the numbers in base64.

glTF's frame is ours: right-handed, +Y up, front +Z.
"""

import base64
import json
import struct
from typing import Any, Final

import numpy as np

from service.surface import Surface

_FLOAT, _UINT, _ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 5126, 5125, 34962, 34963
_GREY: Final = [0.5, 0.5, 0.53, 1.0]  # linear RGBA


def glb(surface: Surface) -> bytes:
    """The binary file: header, JSON chunk, binary chunk."""
    data = _numbers(surface)
    text = json.dumps(_document(surface, {}), separators=(",", ":")).encode("ascii")
    text = text.ljust(-len(text) % 4 + len(text))  # chunks end at multiples of 4 bytes
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data)),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(data), b"BIN\0"),
            data,
        ]
    )


def gltf(surface: Surface) -> bytes:
    """The JSON file, which needs no other."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(_numbers(surface)).decode("ascii")
    return json.dumps(_document(surface, {"uri": uri}), separators=(",", ":")).encode("ascii")


def _numbers(surface: Surface) -> bytes:
    """Positions, normals, indices."""
    floats = (part.astype("<f4", copy=False).tobytes() for part in (surface.vertices, surface.normals))
    return b"".join([*floats, surface.triangles.astype("<u4", copy=False).tobytes()])


def _document(surface: Surface, source: dict[str, str]) -> dict[str, Any]:
    vertices, corners = len(surface.vertices), surface.triangles.size
    views = [(0, 12 * vertices), (12 * vertices, 12 * vertices), (24 * vertices, 4 * corners)]
    targets = (_ARRAY_BUFFER, _ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER)
    floats = {"componentType": _FLOAT, "count": vertices, "type": "VEC3"}
    low, high = (np.float32(bound).tolist() for bound in (surface.vertices.min(0), surface.vertices.max(0)))
    return {
        "asset": {"version": "2.0", "generator": "hof"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": _GREY, "metallicFactor": 0, "roughnessFactor": 1},
                "doubleSided": True,
            }
        ],
        "accessors": [
            {"bufferView": 0, **floats, "min": low, "max": high},
            {"bufferView": 1, **floats},
            {"bufferView": 2, "componentType": _UINT, "count": corners, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size, "target": target}
            for (start, size), target in zip(views, targets, strict=True)
        ],
        "buffers": [{"byteLength": 24 * vertices + 4 * corners, **source}],
    }
