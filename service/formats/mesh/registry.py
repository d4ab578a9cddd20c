"""The file formats of surfaces. Each is a pure function from a surface to the bytes of the file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from service.formats.mesh import gltf, obj, ply, stl, usdz
from service.mapping.surface import Surface


@dataclass(frozen=True)
class MeshFormat:
    """A file format for surfaces.

    name : value of the query parameter `format`.
    media_type : value of Content-Type and Accept.
    extension : of the file's name, with its dot.
    dump : surface -> the whole file, in the surface's frame even where other programs expect another.
    holds_color : the file contains the vertices' colors.
    """

    name: str
    media_type: str
    extension: str
    dump: Callable[[Surface], bytes]
    holds_color: bool = True


MESH_FORMATS: Final[Mapping[str, MeshFormat]] = {
    fmt.name: fmt
    for fmt in (
        MeshFormat("glb", "model/gltf-binary", ".glb", gltf.glb),
        MeshFormat("gltf", "model/gltf+json", ".gltf", gltf.gltf),
        MeshFormat("obj", "model/obj", ".obj", obj.dump),
        MeshFormat("stl", "model/stl", ".stl", stl.dump, holds_color=False),
        MeshFormat("ply", "model/ply", ".ply", ply.dump),
        MeshFormat("usdz", "model/vnd.usdz+zip", ".usdz", usdz.dump),
    )
}
