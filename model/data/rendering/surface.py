"""Points on a mesh's surface, with the colours that its materials have there."""

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


def sample_surface(parts: list[trimesh.Trimesh], n: int, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    """n points uniform over the area of all parts: (n, 3) float32, object frame, and (n, 3) uint8 RGB.

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
    points, colours = np.empty((n, 3), np.float32), np.empty((n, 3), np.uint8)
    for index, part in enumerate(parts):
        here = np.flatnonzero(owner[chosen] == index)
        corners = part.faces[local[chosen[here]]]  # (m, 3) vertex numbers
        points[here] = np.einsum("mc,mcd->md", weights[here], part.vertices[corners])
        colours[here] = _colours(part, corners, weights[here])
    return points, colours


def material_colour(part: trimesh.Trimesh) -> tuple[Bytes, float]:
    """The part's plain colour, (3,) uint8, and its opacity in [0, 1]."""
    material = getattr(part.visual, "material", None)
    if material is None:
        return np.asarray(part.visual.main_color, dtype=np.uint8)[:3], 1.0
    rgba = np.asarray(material.main_color, dtype=np.uint8)
    opacity = getattr(material, "kwargs", {}).get("d", [rgba[3] / 255])
    return rgba[:3], float(np.clip(float(np.ravel(opacity)[0]), 0, 1))


def material_image(part: trimesh.Trimesh) -> Image.Image | None:
    """The part's texture as RGB, or None where it has none or no texture coordinates."""
    material = getattr(part.visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    uv = getattr(part.visual, "uv", None)
    if image is None or uv is None or len(uv) != len(part.vertices):
        return None
    rgb: Image.Image = image.convert("RGB")
    return rgb


def _barycentric(n: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """n uniform positions in a triangle, (n, 3), rows sum to 1."""
    u, v = rng.random((2, n))
    root = np.sqrt(u)
    return np.stack([1 - root, root * (1 - v), root * v], axis=1)


def _colours(part: trimesh.Trimesh, corners: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]) -> Bytes:
    """(m, 3) uint8: the texture at each point, else the plain colour."""
    image = material_image(part)
    if image is None:
        return np.broadcast_to(material_colour(part)[0], (len(corners), 3))
    pixels = np.asarray(image)
    uv = np.einsum("mc,mcd->md", weights, np.asarray(part.visual.uv)[corners]) % 1.0
    height, width = pixels.shape[:2]
    rows = ((1 - uv[:, 1]) * (height - 1)).round().astype(int)
    columns = (uv[:, 0] * (width - 1)).round().astype(int)
    colours: Bytes = pixels[rows, columns]
    return colours
