"""Mesh to function: theta fitted to a mesh, as a weights file that the service reads."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from model.data.manifest import SURFACE_POINTS
from model.data.rendering.surface import sample_surface
from model.data.sources.meshes import IDENTITY, MeshRecord, load_mesh
from model.evaluation.references.ceiling import STEPS, fit
from model.metrics import compare
from service.formats.weights import Weights
from service.mapping.box import measure
from service.mapping.sampler import Sampler
from service.mapping.spec import HOF_1, Array, MappingSpec, word_of

MODEL: Final = "fitted"  # stands for the encoder's name in the file
SPEC: Final = HOF_1.with_k(2)  # that of the shipped model, so that words of both can be made


@dataclass(frozen=True, eq=False)
class Fitted:
    """A mesh as a function.

    figures : metrics of 10,000 points, in the function's own numbers, against as many points of the mesh, but not those
        that it was fitted to.
    losses : a sentence for each texture or material of the mesh that was not read; theta has no colors anyway.
    """

    weights: Weights
    figures: dict[str, float]
    losses: tuple[str, ...] = ()


def fit_mesh(
    path: Path,
    rotation: tuple[float, ...] = IDENTITY,
    spec: MappingSpec = SPEC,
    steps: int = STEPS,
    seed: int = 0,
) -> Fitted:
    """Fit theta to a mesh file.

    Parameters
    ----------
    rotation : from the file's frame to the object frame, row-major 3x3.

    Raises
    ------
    ValueError : the file is no mesh, or is broken, flat or too large.
    """
    record = MeshRecord(path.stem, path, "", path.stem, "", "", "", rotation)
    mesh = load_mesh(record)
    points, _ = sample_surface(mesh.parts, 2 * SURFACE_POINTS, np.random.default_rng(seed))
    theta = fit(spec, points[None, :SURFACE_POINTS], seed, steps)[0]
    weights = Weights(spec, theta, MODEL, frame=measure(spec, theta))
    return Fitted(weights, compare(draw(weights), points[SURFACE_POINTS:]), mesh.losses)


def draw(weights: Weights) -> Array:
    """Draw as many points of a function, in its own numbers, as it is compared with: (n, 3)."""
    return Sampler(weights.spec, word_of(weights.spec, weights.theta)).points(SURFACE_POINTS)
