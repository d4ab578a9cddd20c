"""Sample points on a mesh's surface, with the colors of its materials."""

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

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
        corners = part.faces[local[chosen[rows]]]  # (m, 3) vertex numbers
        points[rows] = np.einsum("mc,mcd->md", weights[rows], part.vertices[corners])
        colors[rows] = _colors(part, corners, weights[rows])
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


def _barycentric(n: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return n uniform positions in a triangle, (n, 3), rows sum to 1."""
    u, v = rng.random((2, n))
    root = np.sqrt(u)
    return np.stack([1 - root, root * (1 - v), root * v], axis=1)


def _colors(part: trimesh.Trimesh, corners: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]) -> Bytes:
    """Return the texture at each point, or the plain color: (m, 3) uint8."""
    image = material_image(part)
    if image is None:
        return np.broadcast_to(material_color(part)[0], (len(corners), 3))
    pixels = np.asarray(image)
    uv = np.einsum("mc,mcd->md", weights, np.asarray(part.visual.uv)[corners]) % 1.0
    height, width = pixels.shape[:2]
    rows = ((1 - uv[:, 1]) * (height - 1)).round().astype(int)
    columns = (uv[:, 0] * (width - 1)).round().astype(int)
    colors: Bytes = pixels[rows, columns]
    return colors
