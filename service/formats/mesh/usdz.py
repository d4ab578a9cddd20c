"""USDZ of a surface: for Apple's Quick Look and its augmented reality, in meters, +Y up.

A USDZ file is a ZIP file without compression, each file of which starts at a multiple of 64 bytes. Ours has one:
the scene as binary USD, which is what Quick Look asks for. A vertex's color is linear, three float32, as in glTF.
"""

import io
import struct
import zipfile
from typing import Final

import numpy as np

from service.formats.mesh.gltf import GRAY
from service.formats.usd_crate import Attribute, Prim, Relationship
from service.formats.usd_crate import dump as dump_crate
from service.mapping.color import linear
from service.mapping.surface import Surface

ALIGNMENT: Final = 64
NAME: Final = "object.usdc"
_PADDING: Final = 0x1986  # id of the extra field that OpenUSD pads with
_LOCAL_HEAD, _EXTRA_HEAD = 30, 4  # bytes
_GRAY: Final = tuple(GRAY[:3])


def dump(surface: Surface) -> bytes:
    """Write the whole file."""
    file = io.BytesIO()
    entry = zipfile.ZipInfo(NAME)  # of 1980: equal surfaces give equal bytes
    entry.create_system = 3  # wherever it is written
    padding = -(_LOCAL_HEAD + len(NAME) + _EXTRA_HEAD) % ALIGNMENT
    entry.extra = struct.pack("<HH", _PADDING, padding) + bytes(padding)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(entry, dump_crate(_scene(surface), surface.axes))
    return file.getvalue()


def _scene(surface: Surface) -> Prim:
    return Prim("Object", "Xform", children=[_mesh(surface), _material(is_colored=surface.colors is not None)])


def _mesh(surface: Surface) -> Prim:
    vertices, corners = surface.vertices, surface.triangles
    extent = np.array([vertices.min(axis=0), vertices.max(axis=0)])
    if surface.colors is None:
        color = Attribute("primvars:displayColor", "color3f[]", [_GRAY], interpolation="constant")
    else:
        color = Attribute("primvars:displayColor", "color3f[]", linear(surface.colors), interpolation="vertex")
    properties: list[Attribute | Relationship] = [
        Attribute("doubleSided", "bool", True, is_uniform=True),
        Attribute("extent", "float3[]", extent),
        Attribute("faceVertexCounts", "int[]", np.full(len(corners), 3)),
        Attribute("faceVertexIndices", "int[]", corners.ravel()),
        Relationship("material:binding", "/Object/Material"),
        Attribute("normals", "normal3f[]", surface.normals, interpolation="vertex"),
        Attribute("points", "point3f[]", vertices),
        color,
        Attribute("subdivisionScheme", "token", "none", is_uniform=True),  # else it would be made rounder
    ]
    return Prim("Surface", "Mesh", properties, apis=["MaterialBindingAPI"])


def _material(*, is_colored: bool) -> Prim:
    material, result = "/Object/Material", "/Object/Material/Color.outputs:result"
    diffuse = Attribute("inputs:diffuseColor", "color3f", _GRAY, source=result if is_colored else None)
    shaded = [
        Attribute("info:id", "token", "UsdPreviewSurface", is_uniform=True),
        diffuse,
        Attribute("inputs:metallic", "float", 0),
        Attribute("inputs:roughness", "float", 1),
        Attribute("outputs:surface", "token"),
    ]
    color = [
        Attribute("info:id", "token", "UsdPrimvarReader_float3", is_uniform=True),
        Attribute("inputs:varname", "string", "displayColor"),
        Attribute("outputs:result", "float3"),
    ]
    shaders = [Prim("Shading", "Shader", shaded)] + ([Prim("Color", "Shader", color)] if is_colored else [])
    surface = Attribute("outputs:surface", "token", source=f"{material}/Shading.outputs:surface")
    return Prim("Material", "Material", [surface], shaders)
