"""Warp a shape: change proportions along an axis, taper sides, lean backs."""

from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

STRETCH: Final = 0.3  # largest natural logarithm of a factor along an axis
SHIFT: Final = 0.6  # largest change of density from the middle to the ends of an axis; below 1 nothing folds
TAPER: Final = 0.4  # largest change of width and depth from the middle to top or bottom
LEAN: Final = 0.2  # largest slope of the depth over the height
PHASES: Final = np.array([0, 2 * np.pi, 2 * np.pi])  # x stays odd, so symmetric objects stay symmetric

Doubles = npt.NDArray[np.float64]


def warp(parts: list[trimesh.Trimesh], rng: np.random.Generator) -> list[trimesh.Trimesh]:
    """Return the parts with their vertices moved by one random smooth map, materials kept.

    Input and output are in the object frame: box centered, longest side 1.
    """
    corners = np.concatenate([part.vertices[np.unique(part.faces)] for part in parts])
    half = np.maximum(corners.max(axis=0), 1e-9)
    shift, phase = rng.uniform(-SHIFT, SHIFT, 3), PHASES * rng.random(3)
    factors = half * np.exp(rng.uniform(-STRETCH, STRETCH, 3))
    taper, lean = rng.uniform(-TAPER, TAPER, 2), rng.uniform(-LEAN, LEAN)

    def move(points: Doubles) -> Doubles:
        unit = points / half
        moved: Doubles = (unit + shift * np.sin(np.pi * unit + phase) / np.pi) * factors
        moved[:, [0, 2]] *= 1 + taper * unit[:, 1:2]
        moved[:, 2] += lean * moved[:, 1]
        return moved

    moved = move(corners)
    low, high = moved.min(axis=0), moved.max(axis=0)
    copies = []
    for part in parts:
        copy = part.copy()
        copy.vertices = (move(np.asarray(part.vertices)) - (low + high) / 2) / (high - low).max()
        copies.append(copy)
    return copies
