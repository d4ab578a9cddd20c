"""Read a mesh file of any format."""

from pathlib import Path
from typing import Final

import trimesh

from model.data.sources.formats.assets import Assets
from model.data.sources.formats.gltf import read_gltf
from model.data.sources.formats.obj import read_obj
from model.data.sources.formats.off import read_off
from model.data.sources.formats.ply import read_ply

MESH_SUFFIXES: Final = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off")


def read_parts(path: Path, root: Path) -> tuple[list[trimesh.Trimesh], tuple[str, ...]]:
    """Return the file's parts, of one material each, and a sentence for each texture or material that is lost.

    Parameters
    ----------
    root : folder below which textures are searched.

    Raises
    ------
    ValueError : the file is broken, or needs an extension that is not read.
    """
    data, assets = path.read_bytes(), Assets(path, root)
    match path.suffix.lower():
        case ".glb" | ".gltf":
            parts, losses = read_gltf(data, assets)
            return parts, tuple(losses)
        case ".obj":
            parts = read_obj(data, assets)
        case ".ply":
            parts = read_ply(data, assets)
        case ".off":
            parts = read_off(data)
        case _:
            scene = trimesh.load_scene(path, process=False)
            parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    return parts, tuple(assets.losses)
