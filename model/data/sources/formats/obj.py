"""OBJ: concave polygons, colors of vertices, options of textures."""

import io
from typing import Final

import numpy as np
import trimesh

from model.data.sources.formats.assets import Assets, decode, split_options
from model.data.sources.formats.polygons import Doubles, concave, split_polygon

TRIANGLE: Final = 3


def read_obj(data: bytes, assets: Assets) -> list[trimesh.Trimesh]:
    """Return the file's parts, of one material each."""
    text = divide_concave(decode(data).replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", ""))
    scene = trimesh.load_scene(io.BytesIO(text.encode()), file_type="obj", resolver=assets, process=False)
    parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    for part in parts:
        if isinstance(part.visual, trimesh.visual.TextureVisuals):
            _show_colors(part)
            _place_texture(part)
    return parts


def divide_concave(text: str) -> str:
    """Return an OBJ file's text with its concave polygons divided into triangles."""
    lines = text.split("\n")
    polygons: dict[int, list[int]] = {}  # corners -> numbers of lines
    for number, line in enumerate(lines):
        if line.startswith("f ") and (corners := len(_references(line))) > TRIANGLE:
            polygons.setdefault(corners, []).append(number)
    if not polygons:
        return text
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], np.float64)
    for numbers in polygons.values():
        shapes = vertices[np.array([_indices(lines[number], len(vertices)) for number in numbers])]
        for index in np.flatnonzero(concave(shapes)).tolist():
            references = _references(lines[numbers[index]])
            lines[numbers[index]] = "\n".join(
                "f " + " ".join(references[corner] for corner in corners) for corners in split_polygon(shapes[index])
            )
    return "\n".join(lines)


def _references(line: str) -> list[str]:
    return line.split("#")[0].split()[1:]


def _indices(line: str, vertices: int) -> list[int]:
    """Return the numbers of a face's vertices, from 0.

    Raises
    ------
    ValueError : there is no such vertex.
    """
    numbers = [int(reference.split("/")[0]) for reference in _references(line)]
    if not all(1 <= number <= vertices or -vertices <= number < 0 for number in numbers):
        raise ValueError(f"{line!r} names a vertex that is not there: the file has {vertices}")
    return [number - 1 if number > 0 else vertices + number for number in numbers]


def _show_colors(part: trimesh.Trimesh) -> None:
    """Let the vertices' colors stand in for a material without texture, unless all are white."""
    colors = part.vertex_attributes.pop("color", None)
    if colors is None or _texture_name(part):
        return
    shares: Doubles = np.asarray(colors, np.float64)
    shares = shares / 255 if shares.max(initial=0) > 1 else shares
    if len(shares) == len(part.vertices) and (shares < 1).any():
        part.visual = trimesh.visual.ColorVisuals(mesh=part, vertex_colors=shares.copy())


def _place_texture(part: trimesh.Trimesh) -> None:
    """Apply a texture's options -s and -o to the texture coordinates."""
    options = split_options(_texture_name(part))[1]
    if part.visual.kind != "texture" or part.visual.uv is None or not options.keys() & {"s", "o"}:
        return
    scale, offset = np.ones(2), np.zeros(2)
    for target, key in ((scale, "s"), (offset, "o")):
        numbers = options.get(key, ())[:2]
        target[: len(numbers)] = numbers
    part.visual.uv = np.asarray(part.visual.uv) * scale + offset


def _texture_name(part: trimesh.Trimesh) -> str:
    """Return the texture as the material file names it, or nothing: trimesh makes up a gray image without one."""
    image = getattr(getattr(part.visual, "material", None), "image", None)
    return str(image.info.get("file_path", "")) if image is not None else ""
