"""glTF 2.0 of a surface: one mesh of TRIANGLES with normals; binary (GLB), or JSON with the numbers in base64.

glTF's frame is ours: right-handed, +Y up, front +Z. A vertex's color is linear, three float32, as in
`service.formats.points.gltf`.
"""

import base64
import itertools
import json
from typing import Any, Final

import numpy as np

from service.formats.glb import glb_head
from service.formats.points.gltf import WHITE
from service.mapping.color import linear
from service.mapping.spec import Array
from service.mapping.surface import Surface

_FLOAT, _UINT, _ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 5126, 5125, 34962, 34963
GRAY: Final = [0.5, 0.5, 0.53, 1.0]  # linear RGBA


def glb(surface: Surface) -> bytes:
    """Write the binary file: header, JSON chunk, binary chunk."""
    attributes = _attributes(surface)
    data = _numbers(surface, attributes)
    text = json.dumps(_document(surface, attributes, {}), separators=(",", ":")).encode("ascii")
    return glb_head(text, len(data)) + data


def gltf(surface: Surface) -> bytes:
    """Write the JSON file, which contains all numbers itself."""
    attributes = _attributes(surface)
    data = base64.b64encode(_numbers(surface, attributes)).decode("ascii")
    document = _document(surface, attributes, {"uri": "data:application/octet-stream;base64," + data})
    return json.dumps(document, separators=(",", ":")).encode("ascii")


def _attributes(surface: Surface) -> dict[str, Array]:
    """Return the per-vertex attributes in file order, each (v, 3) float32."""
    attributes = {"POSITION": surface.vertices, "NORMAL": surface.normals}
    return attributes if surface.colors is None else attributes | {"COLOR_0": linear(surface.colors)}


def _numbers(surface: Surface, attributes: dict[str, Array]) -> bytes:
    """Return the bytes of the attributes, one after another, and of the indices."""
    floats = (array.astype("<f4", copy=False).tobytes() for array in attributes.values())
    return b"".join([*floats, surface.triangles.astype("<u4", copy=False).tobytes()])


def _document(surface: Surface, attributes: dict[str, Array], source: dict[str, str]) -> dict[str, Any]:
    vertices, corners, indices = len(surface.vertices), surface.triangles.size, len(attributes)
    offsets = list(itertools.accumulate([12 * vertices] * indices + [4 * corners], initial=0))  # of the views, bytes
    floats = {"componentType": _FLOAT, "count": vertices, "type": "VEC3"}
    low, high = (np.float32(bound).tolist() for bound in (surface.vertices.min(0), surface.vertices.max(0)))
    primitive = {"attributes": {name: at for at, name in enumerate(attributes)}, "indices": indices, "material": 0}
    base = {"baseColorFactor": GRAY if surface.colors is None else WHITE, "metallicFactor": 0, "roughnessFactor": 1}
    return {
        "asset": {"version": "2.0", "generator": "hof"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": base, "doubleSided": True}],
        "accessors": [
            {"bufferView": 0, **floats, "min": low, "max": high},
            *({"bufferView": view, **floats} for view in range(1, indices)),
            {"bufferView": indices, "componentType": _UINT, "count": corners, "type": "SCALAR"},
        ],
        "bufferViews": [
            {
                "buffer": 0,
                "byteOffset": start,
                "byteLength": stop - start,
                "target": _ARRAY_BUFFER if view < indices else _ELEMENT_ARRAY_BUFFER,
            }
            for view, (start, stop) in enumerate(itertools.pairwise(offsets))
        ],
        "buffers": [{"byteLength": offsets[-1], **source}],
    }
