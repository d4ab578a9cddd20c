"""Render views of a mesh off screen, as RGBA with textures and lights, one renderer per process."""

import math
from contextlib import closing
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pyvista
import trimesh
from PIL import Image

from model.data.manifest import SIZE, SURFACE_POINTS
from model.data.rendering.cameras import ring_cameras
from model.data.rendering.surface import face_colors, material_color, material_image, sample_surface, vertex_colors
from service.drawing.cloud import camera_axes

SUPERSAMPLING: Final = 2
FILL: Final = 0.94  # of the frame, by the object's larger half-extent
MIN_OPACITY: Final = 0.35  # glass stays visible
RGB: Final = "rgb"  # name of the colors of faces or vertices on the stage

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Rendered:
    """Views, cameras and surface points of a mesh.

    views : (RING_VIEWS, SIZE, SIZE, 4) uint8 RGBA, alpha is the mask.
    cameras : (RING_VIEWS, 2) float32, azimuth and elevation in degrees; azimuth 0 looks at the front.
    points : (SURFACE_POINTS, 3) float32, object frame.
    colors : (SURFACE_POINTS, 3) uint8 RGB.
    """

    views: Bytes
    cameras: Floats
    points: Floats
    colors: Bytes


def render_parts(parts: list[trimesh.Trimesh], id_: str, seed: int) -> Rendered:
    """Render views and sample surface points of parts in the object frame; cameras depend on seed and id only.

    Raises
    ------
    ValueError : the surface has no area.
    """
    rng = np.random.default_rng([seed, *id_.encode()])
    points, colors = sample_surface(parts, SURFACE_POINTS, rng)
    cameras = ring_cameras(rng)
    with closing(stage(parts)) as plotter:
        views = shoot(plotter, cameras, points, rng)
    return Rendered(views, cameras[:, :2].astype(np.float32), points, colors)


def stage(parts: list[trimesh.Trimesh], multisampling: bool = True) -> pyvista.Plotter:
    """Put the parts, with their materials, before an off-screen camera; the caller closes the plotter.

    Without `multisampling` views take a third of the time, and edges are a little harder (under 1% of the range,
    averaged over an image); supersampling smooths them in any case.
    """
    side = SIZE * SUPERSAMPLING
    plotter = pyvista.Plotter(off_screen=True, window_size=[side, side], lighting="none")
    if not multisampling:
        plotter.disable_anti_aliasing()
    plotter.set_background("black")  # the screenshot is then color times alpha
    for part in parts:
        _add_part(plotter, part)
    return plotter


def _add_part(plotter: pyvista.Plotter, part: trimesh.Trimesh) -> None:
    """Put a part on the stage, colored by its faces, its vertices times its texture, or its material."""
    color, opacity = material_color(part)
    surface = pyvista.PolyData.from_regular_faces(np.asarray(part.vertices), np.asarray(part.faces))
    surface.point_data.active_normals = np.asarray(part.vertex_normals)
    image, by_vertex, by_face = material_image(part), vertex_colors(part), face_colors(part)
    if image is not None:
        surface.active_texture_coordinates = np.asarray(part.visual.uv)
    if by_face is not None:
        surface.cell_data[RGB] = by_face
    elif by_vertex is not None:
        surface.point_data[RGB] = by_vertex
    painted = by_face is not None or by_vertex is not None
    plotter.add_mesh(
        surface,
        scalars=RGB if painted else None,
        rgb=painted,
        color=None if painted or image is not None else color.tolist(),
        texture=None if image is None else pyvista.Texture(np.asarray(image)),
        opacity=max(opacity, MIN_OPACITY),
        ambient=0.3,
        diffuse=0.75,
        specular=0.1,
        interpolation="Phong",
    )


def stretch(plotter: pyvista.Plotter, scale: npt.NDArray[np.float64]) -> None:
    """Scale the parts on the stage along the object frame's axes by factors (3,) of their original size."""
    for actor in plotter.actors.values():
        actor.scale = tuple(scale)


def shoot(
    plotter: pyvista.Plotter, cameras: npt.NDArray[np.float64], points: Floats, rng: np.random.Generator
) -> Bytes:
    """Render one view per camera, each under its own random lights: (n, SIZE, SIZE, 4) uint8 RGBA.

    Parameters
    ----------
    cameras : (n, 4) azimuth and elevation in degrees, distance from the object's center in longest sides,
        roll in degrees. The angle of view is set so that the object fills the frame.
    points : (m, 3) float32 on the surface, object frame.
    """
    return np.stack([_shoot(plotter, camera, points, rng) for camera in cameras])


def _shoot(
    plotter: pyvista.Plotter, camera: npt.NDArray[np.float64], points: Floats, rng: np.random.Generator
) -> Bytes:
    """Render one view, (SIZE, SIZE, 4) uint8, unpremultiplied."""
    azimuth, elevation, distance, roll = camera.tolist()
    toward, right, up = camera_axes(azimuth, elevation)
    cos, sin = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    depth = distance - points @ toward
    across, along = points @ (cos * right - sin * up) / depth, points @ (cos * up + sin * right) / depth
    half = max(np.abs(across).max(), np.abs(along).max()) / FILL
    plotter.camera_position = [tuple(distance * toward), (0, 0, 0), (0, 1, 0)]
    plotter.camera.Roll(roll)  # the camera turns clockwise, so its image turns the other way
    plotter.camera.view_angle = 2 * math.degrees(math.atan(half))
    plotter.reset_camera_clipping_range()
    _light(plotter, toward, right, up, rng)
    plotter.render()  # screenshot() alone returns the previous frame
    shot = plotter.screenshot(transparent_background=True, return_img=True)
    premultiplied = Image.frombytes("RGBa", shot.shape[1::-1], np.ascontiguousarray(shot).tobytes())
    small = premultiplied.resize((SIZE, SIZE), Image.Resampling.BOX)
    return np.asarray(small.convert("RGBA"))


def _light(plotter: pyvista.Plotter, toward: Floats, right: Floats, up: Floats, rng: np.random.Generator) -> None:
    """Set a dim light at the camera, and a key light at a random position above and beside it."""
    plotter.remove_all_lights()
    key = toward + rng.uniform(-1.2, 1.2) * right + rng.uniform(0.2, 1.5) * up
    for direction, intensity in ((toward, 0.4), (key, rng.uniform(0.5, 0.8))):
        plotter.add_light(pyvista.Light(position=tuple(10 * direction), focal_point=(0, 0, 0), intensity=intensity))
