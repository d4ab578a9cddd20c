"""Surfaces as files: what formats there are. Each is a pure function from a surface to the file's bytes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from service.formats.mesh import gltf, obj, ply, stl
from service.mapping.surface import Surface


@dataclass(frozen=True)
class MeshFormat:
    """A file format for surfaces; `dump` gives the whole file, in the object frame whatever others use by habit.

    name : as in the query's `format`.
    media_type : as in Content-Type and Accept.
    extension : of a file's name, with its dot.
    holds_color : it writes the vertices' colours.
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
    )
}
