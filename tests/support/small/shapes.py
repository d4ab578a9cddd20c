"""A folder of small meshes and a data set built from it, for tests of the training side."""

from pathlib import Path

import trimesh

SHAPES = 12


def write_folder(folder: Path) -> Path:
    """Write twelve different solids as OBJ, PLY, STL, OFF and GLB, in two category folders."""
    suffixes = (".obj", ".ply", ".stl", ".off", ".glb")
    for index in range(SHAPES):
        category = folder / ("boxes" if index % 2 else "round")
        category.mkdir(parents=True, exist_ok=True)
        mesh = solid(index)
        mesh.visual.face_colors = [40 + 15 * index, 200 - 15 * index, 90, 255]
        mesh.export(category / f"shape{index:02d}{suffixes[index % len(suffixes)]}")
    return folder


def solid(index: int) -> trimesh.Trimesh:
    """Return box or cylinder number `index`, each of its own proportions."""
    if index % 2:
        return trimesh.creation.box(extents=(1, 0.1 + 0.07 * index, 1.6 - 0.11 * index))
    return trimesh.creation.cylinder(radius=0.1 + 0.05 * index, height=1, sections=24)
