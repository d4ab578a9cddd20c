"""Solids that furniture is assembled from: +Y up, front +Z, the floor at y = 0, lengths in meters."""

from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from model.data.sources.meshes import to_object_frame

SECTIONS: Final = 24  # around a lathed solid
EDGE_RAD: Final = 0.7  # faces that meet at a sharper angle are shaded separately

MATERIALS: Final = ("wood", "leg", "top", "front", "cloth", "cushion", "sheet", "cover", "shade")

Rng = np.random.Generator
Solid = tuple[trimesh.Trimesh, str]  # mesh and material, one of MATERIALS
Triple = tuple[float, float, float]
Doubles = npt.NDArray[np.float64]


def signed_power(numbers: Doubles, exponent: float) -> Doubles:
    """Raise the numbers' sizes to a power and keep their signs; turns a circle into a superellipse."""
    powers: Doubles = np.sign(numbers) * np.abs(numbers) ** exponent
    return powers


def box(low: Triple, high: Triple, material: str) -> Solid:
    """Make a box from corner to corner."""
    return trimesh.creation.box(bounds=np.array([low, high])), material


def cushion(low: Triple, high: Triple, material: str, roundness: float = 0.35) -> Solid:
    """Make a superellipsoid in the box from corner to corner: `roundness` 1 is an ellipsoid, 0 the box."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    directions = np.asarray(mesh.vertices)
    rounded = signed_power(directions, roundness)
    mesh.vertices = np.mean([low, high], axis=0) + rounded / np.abs(rounded).max(axis=0) * np.subtract(high, low) / 2
    return mesh, material


def rod(start: Triple, end: Triple, radii: float | tuple[float, float], material: str, sides: int = 12) -> Solid:
    """Make a bar from point to point, round or with few sides; a pair of `radii` makes it taper."""
    first, last = radii if isinstance(radii, tuple) else (radii, radii)
    length = float(np.linalg.norm(np.subtract(end, start)))
    profile = [(0, 0), (first, 0), (last, length), (0, length)]
    mesh = trimesh.creation.revolve(profile, sections=sides)
    if sides == 4:  # a square bar stands with its sides along the axes
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (0, 0, 1)))
    toward = trimesh.geometry.align_vectors((0, 0, 1), np.subtract(end, start))
    mesh.apply_transform(toward)
    mesh.apply_translation(start)
    return mesh, material


def lathe(profile: list[tuple[float, float]], material: str, center: Triple = (0, 0, 0)) -> Solid:
    """Revolve (radius, height) pairs about the vertical through `center`."""
    mesh = trimesh.creation.revolve(profile, sections=SECTIONS)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    mesh.apply_translation(center)
    return mesh, material


def ring(radius: float, thickness: float, center: Triple, scale: Triple, material: str) -> Solid:
    """Make a torus in the plane of x and y, scaled along the axes: a handle."""
    mesh = trimesh.creation.torus(radius, thickness, major_sections=SECTIONS, minor_sections=10)
    mesh.apply_scale(scale)
    mesh.apply_translation(center)
    return mesh, material


def between(front: Doubles, back: Doubles, material: str) -> Solid:
    """Make a wall between two grids of points, each (rows, columns, 3): a curved panel, a shell, a cloth."""
    rows, columns, _ = front.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    cells = (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    corners = [cell.ravel() for cell in cells]
    behind = [corner + index.size for corner in reversed(corners)]
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    ahead = np.roll(rim, -1)
    quads = np.hstack([corners, behind, (ahead, rim, rim + index.size, ahead + index.size)])
    faces = np.concatenate([quads[[0, 1, 2]].T, quads[[0, 2, 3]].T])
    mesh = trimesh.Trimesh(np.concatenate([front.reshape(-1, 3), back.reshape(-1, 3)]), faces)
    if mesh.volume < 0:
        mesh.invert()
    return mesh, material


def lean(solids: list[Solid], slope: float, height: float) -> list[Solid]:
    """Return the solids with vertices above `height` moved back by `slope` times their height above it."""
    for mesh, _ in solids:
        vertices = np.array(mesh.vertices)
        vertices[:, 2] -= slope * np.maximum(vertices[:, 1] - height, 0)
        mesh.vertices = vertices
    return solids


def assemble(solids: list[Solid], colors: dict[str, Triple]) -> list[trimesh.Trimesh]:
    """Return the solids in the object frame (box centered, longest side 1), colored by material (RGB in [0, 1])."""
    transform = to_object_frame([mesh for mesh, _ in solids], np.eye(3))
    parts = []
    for mesh, material in solids:
        mesh.apply_transform(transform)
        part = trimesh.graph.smooth_shade(mesh, angle=EDGE_RAD)
        paint(part, colors[material])
        parts.append(part)
    return parts


def paint(part: trimesh.Trimesh, color: Triple) -> None:
    """Replace a part's look by one color, RGB in [0, 1]."""
    part.visual = trimesh.visual.ColorVisuals(part, face_colors=[*(round(255 * each) for each in color), 255])
