"""Make objects with Infinigen: a program of its own, which runs in the environment that has bpy and infinigen.

It reads one request per line from standard input and answers each with one line on standard output, both JSON:

    {"factory": "seating.ChairFactory", "seed": 7, "file": "chair.glb", "limit_s": 60}
    {"triangles": 24310}  or  {"error": "RuntimeError: no mesh"}

`limit_s` bounds the processor time: after it the kernel ends the process, whatever hangs. The first line written is
`{"ready": true}`. What Blender prints goes to standard error. Files are glTF, Y up, with
Infinigen's own front; base colors are baked to vertex colors. Only this file may import bpy (GPL-3.0-or-later), and
nothing imports this file.
"""

import importlib
import json
import math
import os
import random
import resource
import signal
import sys
import warnings
from pathlib import Path
from typing import IO, Any, Final

import bpy
import numpy as np
import numpy.typing as npt
import trimesh
from infinigen.core.util.math import FixedSeed

OBJECTS: Final = "infinigen.assets.objects."
MOST_TRIANGLES: Final = 40_000
LEAST_TRIANGLES: Final = 10_000  # coarser meshes are subdivided: vertex colors have to carry the pattern
DIVISIONS: Final = 4  # at most; each makes four triangles of one
SHARP: Final = math.radians(35)  # between faces: such edges are not shaded smooth
BLACK: Final = 0.02  # least share of light that a real surface reflects
LONGEST_M: Final = 20.0  # longer objects have vertices gone astray
DARK: Final = 1e-3  # base colors all below it were not baked
UNBAKED: Final = {"Metallic": 0.0, "Transmission Weight": 0.0}  # metal and glass have no diffuse color to bake
SHINING: Final = (  # nodes without a diffuse color
    "BSDF_GLASS",
    "BSDF_GLOSSY",
    "BSDF_REFRACTION",
    "BSDF_TRANSLUCENT",
    "BSDF_TRANSPARENT",
    "EMISSION",
)


def make(factory: str, seed: int, file: Path) -> int:
    """Write the object of a factory and seed as GLB, whole or not at all, and return its triangles.

    Raises
    ------
    RuntimeError : the factory made no mesh, one without color, or a broken one.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    random.seed(seed)
    mesh = _join(_spawn(factory, seed))
    _divide(mesh)
    _bake(mesh)
    vertices, triangles, colors = _arrays(mesh)
    if colors.max() <= DARK:
        raise RuntimeError("the object has no base color")
    longest_m = float(np.ptp(vertices, axis=0).max())
    if not longest_m <= LONGEST_M:  # NaN included
        raise RuntimeError(f"the object is {longest_m:.0f} m long")
    colors = (colors.clip(BLACK, 1) * 255).round().astype(np.uint8)
    painted = trimesh.Trimesh(vertices, triangles, vertex_colors=colors, process=False)
    part = file.with_suffix(".part")
    part.write_bytes(painted.export(file_type="glb"))
    part.replace(file)
    return len(triangles)


def _spawn(factory: str, seed: int) -> list[Any]:
    """Return the mesh objects that the factory makes."""
    module, name = factory.rsplit(".", 1)
    with FixedSeed(seed):
        maker = getattr(importlib.import_module(OBJECTS + module), name)(seed)
        root = maker.spawn_asset(0)
        maker.finalize_assets([root])
    tree = [root, *root.children_recursive]
    meshes = [each for each in tree if each.type == "MESH" and len(each.data.polygons)]
    if not meshes:
        raise RuntimeError("the factory made no mesh")
    return meshes


def _join(meshes: list[Any]) -> Any:  # noqa: ANN401 - a Blender object
    """Apply all modifiers, join the objects and reduce the result to MOST_TRIANGLES or so."""
    bpy.ops.object.select_all(action="DESELECT")
    for each in meshes:
        each.hide_set(False)
        each.hide_render = False
        each.select_set(True)
    bpy.context.view_layer.objects.active = meshes[0]
    bpy.ops.object.convert(target="MESH")
    if len(meshes) > 1:
        bpy.ops.object.join()
    mesh = bpy.context.view_layer.objects.active
    for other in bpy.context.scene.objects:
        other.hide_render = other is not mesh
    count = _triangles(mesh)
    if count > MOST_TRIANGLES:
        _modify(mesh, "DECIMATE", ratio=MOST_TRIANGLES / count)
    return mesh


def _triangles(mesh: Any) -> int:  # noqa: ANN401
    """Return the number of a mesh's triangles."""
    mesh.data.calc_loop_triangles()
    return len(mesh.data.loop_triangles)


def _divide(mesh: Any) -> None:  # noqa: ANN401
    """Subdivide a coarse mesh and give each side of a sharp edge its own vertices: its shape stays."""
    _modify(mesh, "TRIANGULATE")  # else the subdivision covers the holes of concave faces
    for _ in range(DIVISIONS):
        if _triangles(mesh) < LEAST_TRIANGLES:
            _modify(mesh, "SUBSURF", subdivision_type="SIMPLE", levels=1)
    _modify(mesh, "EDGE_SPLIT", split_angle=SHARP)


def _modify(mesh: Any, kind: str, **settings: Any) -> None:  # noqa: ANN401
    """Apply a modifier."""
    modifier = mesh.modifiers.new("step", kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    bpy.ops.object.modifier_apply(modifier=modifier.name)


def _bake(mesh: Any) -> None:  # noqa: ANN401
    """Bake the base color of all materials to a color attribute of the vertices."""
    for attribute in list(mesh.data.color_attributes):
        mesh.data.color_attributes.remove(attribute)
    attribute = mesh.data.color_attributes.new("base", "FLOAT_COLOR", "POINT")
    mesh.data.color_attributes.active_color = attribute
    for material in bpy.data.materials:
        if material.use_nodes:
            _make_opaque(material.node_tree)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 1
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 1
    scene.render.bake.target = "VERTEX_COLORS"
    scene.render.bake.use_pass_direct = False
    scene.render.bake.use_pass_indirect = False
    scene.render.bake.use_pass_color = True
    bpy.ops.object.bake(type="DIFFUSE")


def _make_opaque(tree: Any) -> None:  # noqa: ANN401
    """Give the tree's surfaces the diffuse color that their metal, glass or light has."""
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree:
            _make_opaque(node.node_tree)
        elif node.type == "BSDF_PRINCIPLED":
            for name, value in UNBAKED.items():
                entry = node.inputs.get(name)
                if entry is not None:
                    for link in list(entry.links):
                        tree.links.remove(link)
                    entry.default_value = value
        elif node.type in SHINING:
            _make_diffuse(tree, node)


def _make_diffuse(tree: Any, node: Any) -> None:  # noqa: ANN401
    """Put a diffuse shader of the node's color in its place."""
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    color = node.inputs["Color"]
    diffuse.inputs["Color"].default_value = color.default_value
    for link in list(color.links):
        tree.links.new(link.from_socket, diffuse.inputs["Color"])
    for link in list(node.outputs[0].links):
        tree.links.new(diffuse.outputs[0], link.to_socket)


def _arrays(mesh: Any) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32], npt.NDArray[np.float32]]:  # noqa: ANN401
    """Return vertices (n, 3), Y up, triangles (m, 3), and linear vertex colors (n, 3)."""
    data = mesh.data
    vertices = np.zeros((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", vertices.ravel())
    matrix = np.array(mesh.matrix_world, np.float32)
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    data.calc_loop_triangles()
    triangles = np.zeros((len(data.loop_triangles), 3), np.int32)
    data.loop_triangles.foreach_get("vertices", triangles.ravel())
    colors = np.zeros((len(data.vertices), 4), np.float32)
    data.color_attributes["base"].data.foreach_get("color", colors.ravel())
    return placed[:, [0, 2, 1]] * np.array([1, 1, -1], np.float32), triangles, colors[:, :3]


def serve(requests: IO[str], answers: IO[str]) -> None:
    """Answer requests until there are no more."""
    print(json.dumps({"ready": True}), file=answers, flush=True)
    for line in requests:
        request = json.loads(line)
        _limit(request["limit_s"])
        try:
            answer: dict[str, Any] = {"triangles": make(request["factory"], request["seed"], Path(request["file"]))}
        except Exception as error:  # a factory may raise anything
            answer = {"error": f"{type(error).__name__}: {error}"[:200]}
        print(json.dumps(answer), file=answers, flush=True)


def _limit(seconds: int) -> None:
    """Bound the processor time of what follows. It counts neither pauses nor the waiting on a busy machine."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    used = round(usage.ru_utime + usage.ru_stime)
    resource.setrlimit(resource.RLIMIT_CPU, (used + seconds, resource.RLIM_INFINITY))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on Ctrl-C the object under way is finished
    warnings.filterwarnings("ignore")
    pipe = os.fdopen(os.dup(1), "w")  # Blender prints to descriptor 1
    os.dup2(2, 1)
    serve(sys.stdin, pipe)
