"""Sample points on a mesh's surface, with the colors of its materials."""

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

from model.data.sources.formats.gltf import TINT

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


def sample_surface(parts: list[trimesh.Trimesh], n: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """Sample n points uniformly over the area of all parts: (n, 3) float32, object frame, and (n, 3) uint8 RGB.

    Raises
    ------
    ValueError : the surface has no area.
    """
    areas = np.concatenate([part.area_faces for part in parts])
    total = float(areas.sum())
    if not np.isfinite(total) or total <= 0:
        raise ValueError("the surface has no area")
    owner = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    local = np.concatenate([np.arange(len(part.faces)) for part in parts])
    chosen = rng.choice(len(areas), size=n, p=areas / total)
    weights = _barycentric(n, rng)
    points, colors = np.empty((n, 3), np.float32), np.empty((n, 3), np.uint8)
    for index, part in enumerate(parts):
        rows = np.flatnonzero(owner[chosen] == index)
        faces = local[chosen[rows]]
        points[rows] = np.einsum("mc,mcd->md", weights[rows], part.vertices[part.faces[faces]])  # (m, 3, 3) corners
        colors[rows] = _colors(part, faces, weights[rows])
    return points, colors


def material_color(part: trimesh.Trimesh) -> tuple[Bytes, float]:
    """Return the part's plain color, (3,) uint8, and its opacity in [0, 1]."""
    material = getattr(part.visual, "material", None)
    if material is None:
        return np.asarray(part.visual.main_color, dtype=np.uint8)[:3], 1.0
    rgba = np.asarray(material.main_color, dtype=np.uint8)
    opacity = getattr(material, "kwargs", {}).get("d", [rgba[3] / 255])
    return rgba[:3], float(np.clip(float(np.ravel(opacity)[0]), 0, 1))


def material_image(part: trimesh.Trimesh) -> Image.Image | None:
    """Return the part's texture as RGB, or None without a texture or texture coordinates."""
    material = getattr(part.visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    uv = getattr(part.visual, "uv", None)
    if image is None or uv is None or len(uv) != len(part.vertices):
        return None
    rgb: Image.Image = image.convert("RGB")
    return rgb


def vertex_colors(part: trimesh.Trimesh) -> Bytes | None:
    """Return the colors of the part's vertices, (n, 3), which multiply its texture; None if it has none or one."""
    if part.visual.kind == "vertex":
        return _unless_uniform(part.visual.vertex_colors)
    return _unless_uniform(getattr(getattr(part.visual, "material", None), "kwargs", {}).get(TINT))


def face_colors(part: trimesh.Trimesh) -> Bytes | None:
    """Return the colors of the part's faces, (n, 3), or None if it has none or one."""
    return _unless_uniform(part.visual.face_colors) if part.visual.kind == "face" else None


def _unless_uniform(colors: Bytes | None) -> Bytes | None:
    """Return RGB colors, or None if all are the same: `material_color` returns that one."""
    if colors is None:
        return None
    rgb: Bytes = np.asarray(colors, np.uint8)[:, :3]
    return None if (rgb == rgb[:1]).all() else rgb


def _barycentric(n: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return n uniform positions in a triangle, (n, 3), rows sum to 1."""
    u, v = rng.random((2, n))
    root = np.sqrt(u)
    return np.stack([1 - root, root * (1 - v), root * v], axis=1)


def _colors(part: trimesh.Trimesh, faces: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]) -> Bytes:
    """Return the color of a point in each of the faces, from texture, vertices, faces or material: (m, 3) uint8."""
    by_face, by_vertex, image = face_colors(part), vertex_colors(part), material_image(part)
    if by_face is not None:
        return by_face[faces]
    corners = part.faces[faces]  # (m, 3) vertex numbers
    colors = np.broadcast_to(material_color(part)[0], (len(faces), 3))
    if image is not None:
        colors = _texels(image, np.einsum("mc,mcd->md", weights, np.asarray(part.visual.uv)[corners]) % 1.0)
    if by_vertex is None:
        return colors
    tint = np.einsum("mc,mcd->md", weights, by_vertex[corners].astype(np.float64))
    tinted: Bytes = (tint if image is None else colors * tint / 255).round().astype(np.uint8)
    return tinted


def _texels(image: Image.Image, uv: npt.NDArray[np.float64]) -> Bytes:
    """Return the nearest pixels at coordinates in [0, 1), V upward: (m, 3) uint8."""
    pixels = np.asarray(image)
    height, width = pixels.shape[:2]
    rows = ((1 - uv[:, 1]) * (height - 1)).round().astype(int)
    columns = (uv[:, 0] * (width - 1)).round().astype(int)
    texels: Bytes = pixels[rows, columns]
    return texels
