"""GLB and glTF: refuse extensions that trimesh misreads, and put colors right.

Factors and vertex colors are linear in a file; parts have all colors in sRGB, as textures have them.
"""

import importlib.util
import io
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image

from model.data.sources.formats.assets import Assets

MAGIC: Final = b"glTF"
TINT: Final = "tint"  # keyword of a SimpleMaterial: (n, 3) uint8, colors of the vertices that multiply its texture
DRACO: Final = "KHR_draco_mesh_compression"
GLOSS: Final = "KHR_materials_pbrSpecularGlossiness"
PLACEMENT: Final = "KHR_texture_transform"
READ: Final = (PLACEMENT, "EXT_texture_webp", "KHR_lights_punctual", "KHR_xmp_json_ld")  # also KHR_materials_...
COMPRESSED: Final = ("EXT_meshopt_compression", "KHR_meshopt_compression")
LOADED_MODES: Final = (0, 1, 4, 5)  # points, lines, triangles, strips: the primitives that trimesh keeps, in order
FLOAT: Final = 5126  # componentType

Doubles = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
Json = dict[str, Any]


def read_gltf(data: bytes, assets: Assets) -> tuple[list[trimesh.Trimesh], list[str]]:
    """Return the file's parts, and a sentence for each texture that could not be used.

    Raises
    ------
    ValueError : the file needs an extension that is not read.
    """
    binary = data.startswith(MAGIC)
    header: Json = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")] if binary else data)
    check_extensions(header)
    file_type = "glb" if binary else "gltf"
    scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, resolver=assets, process=False)
    dresser = _Dresser(header)
    for primitive, geometry in zip(_primitives(header), scene.geometry.values(), strict=True):
        if isinstance(geometry, trimesh.Trimesh):
            dresser.dress(geometry, primitive)
    return [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)], dresser.losses


def check_extensions(header: Json) -> None:
    """Raise ValueError that names the extensions that the file needs and that are not read."""
    needed = set(header.get("extensionsRequired", ()))
    for view in header.get("bufferViews", ()):
        needed |= set(view.get("extensions", ())) & set(COMPRESSED)
    for primitive in _primitives(header):
        position = header["accessors"][primitive["attributes"]["POSITION"]]
        if "bufferView" not in position and "sparse" not in position:
            needed |= set(primitive.get("extensions", ()))
    unread = sorted(name for name in needed if not _is_read(name))
    if unread:
        install = " or install DracoPy" if unread == [DRACO] else ""
        raise ValueError(f"the file needs {', '.join(unread)}, which is not read: export it without{install}")


def _is_read(extension: str) -> bool:
    if extension == DRACO:
        return importlib.util.find_spec("DracoPy") is not None  # trimesh decodes with it
    return extension in READ or extension.startswith("KHR_materials_")


def _primitives(header: Json) -> Iterator[Json]:
    for mesh in header.get("meshes", ()):
        for primitive in mesh["primitives"]:
            if primitive.get("mode", 4) in LOADED_MODES:
                yield primitive


@dataclass
class _Dresser:
    """Gives parts their base color: texture, factor and vertex colors multiplied, in sRGB."""

    header: Json
    losses: list[str] = field(default_factory=list)
    images: dict[int, Image.Image | None] = field(default_factory=dict)  # material -> texture times factor

    def dress(self, part: trimesh.Trimesh, primitive: Json) -> None:
        colors = _vertex_colors(part)
        number = primitive.get("material")
        if number is None:
            if colors is not None:
                part.visual = trimesh.visual.ColorVisuals(mesh=part, vertex_colors=to_srgb(colors))
            return
        material = self.header["materials"][number]
        factor, reference = _base_color(material, part.visual.material)
        if number not in self.images:
            self.images[number] = self._image(part.visual.material, factor, reference)
        image, uv = self.images[number], self._uv(part, primitive, reference)
        if image is not None and uv is not None:
            tint = {} if colors is None else {TINT: to_srgb(colors)}
            white = _diffuse(np.ones(3), factor, material)
            plain = trimesh.visual.material.SimpleMaterial(image=image, diffuse=white, **tint)
            part.visual = trimesh.visual.TextureVisuals(uv=uv, material=plain)
        elif colors is not None:
            part.visual = trimesh.visual.ColorVisuals(mesh=part, vertex_colors=to_srgb(colors * factor[:3]))
        else:
            plain = trimesh.visual.material.SimpleMaterial(diffuse=_diffuse(factor[:3], factor, material))
            part.visual = trimesh.visual.TextureVisuals(material=plain)

    def _image(self, material: Any, factor: Doubles, reference: Json | None) -> Image.Image | None:  # noqa: ANN401
        """Return a material's texture times its factor."""
        if reference is None:
            return None
        try:
            rgb: Image.Image = material.baseColorTexture.convert("RGB")
        except (AttributeError, OSError, SyntaxError, ValueError):
            self._lose(f"{self._name(reference)} is missing or cannot be read")
            return None
        if (factor[:3] == 1).all():
            return rgb
        levels = to_linear(np.arange(256)[:, None] / 255) * factor[:3]  # (256, 3)
        return rgb.point(to_srgb(levels).T.ravel().tolist())

    def _uv(self, part: trimesh.Trimesh, primitive: Json, reference: Json | None) -> Doubles | None:
        """Return the texture coordinates, V upward; None without a texture."""
        if reference is None or part.visual.uv is None:
            return None
        placement = reference.get("extensions", {}).get(PLACEMENT, {})
        if placement.get("texCoord", reference.get("texCoord", 0)) != 0:
            self._lose(f"{self._name(reference)} is not used: it has texture coordinates of its own")
            return None
        if self.header["accessors"][primitive["attributes"]["TEXCOORD_0"]]["componentType"] != FLOAT:
            self._lose(f"{self._name(reference)} is not used: its texture coordinates are whole numbers")
            return None
        return _place(np.asarray(part.visual.uv, np.float64), placement)

    def _name(self, reference: Json) -> str:
        texture = self.header["textures"][reference["index"]]
        extensions = texture.get("extensions", {}).values()
        source = texture.get("source", next((each["source"] for each in extensions if "source" in each), None))
        image = {} if source is None else self.header["images"][source]
        uri = image.get("uri", "")
        return str(image.get("name") or (not uri.startswith("data:") and uri) or f"texture {reference['index']}")

    def _lose(self, loss: str) -> None:
        if loss not in self.losses:
            self.losses.append(loss)


def _base_color(material: Json, loaded: Any) -> tuple[Doubles, Json | None]:  # noqa: ANN401 - trimesh's material
    """Return the linear RGBA factor, and the reference to a texture.

    trimesh turns specular-glossiness into a base color; its texture then contains the factor.
    """
    gloss = material.get("extensions", {}).get(GLOSS)
    if gloss is None:
        pbr = material.get("pbrMetallicRoughness", {})
        return np.array(pbr.get("baseColorFactor", (1, 1, 1, 1)), np.float64), pbr.get("baseColorTexture")
    if "diffuseTexture" in gloss or loaded.baseColorFactor is None:
        return np.ones(4), gloss.get("diffuseTexture")
    return np.asarray(loaded.baseColorFactor, np.float64) / 255, None


def _vertex_colors(part: trimesh.Trimesh) -> Doubles | None:
    """Return the linear colors of a part's vertices, (n, 3) in [0, 1], or None."""
    if part.visual.kind == "vertex":
        colors = np.asarray(part.visual.vertex_colors)
    elif part.visual.kind == "texture" and "color" in part.visual.vertex_attributes:
        colors = np.asarray(part.visual.vertex_attributes["color"])
    else:
        return None
    top = np.iinfo(colors.dtype).max if colors.dtype.kind == "u" else 1.0
    shares: Doubles = colors[:, :3].astype(np.float64) / top
    return shares.clip(0, 1)


def _diffuse(rgb: Doubles, factor: Doubles, material: Json) -> Bytes:
    """Return the material's sRGB color and opacity as bytes, (4,)."""
    alpha = factor[3] if material.get("alphaMode") == "BLEND" else 1.0
    return np.append(to_srgb(rgb), np.uint8(round(255 * alpha)))


def _place(uv: Doubles, placement: Json) -> Doubles:
    """Apply KHR_texture_transform, whose V points downward: (n, 2) -> (n, 2)."""
    angle = placement.get("rotation", 0.0)
    cos, sin = math.cos(angle), math.sin(angle)
    down = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * placement.get("scale", (1, 1))
    placed = down @ np.array([[cos, -sin], [sin, cos]]) + placement.get("offset", (0, 0))
    return np.stack([placed[:, 0], 1 - placed[:, 1]], axis=1)


def to_srgb(linear: Doubles) -> Bytes:
    """Encode linear shares in [0, 1] as sRGB bytes (IEC 61966-2-1)."""
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)
    return (255 * encoded.clip(0, 1)).round().astype(np.uint8)


def to_linear(encoded: Doubles) -> Doubles:
    """Decode sRGB shares in [0, 1] to linear ones."""
    linear: Doubles = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear
