"""Pictures of objects: the surface that they show."""

import numpy as np

from service.drawing.surface import without_long
from service.mapping.box import measure
from service.mapping.spec import Functions, MappingSpec, initial_theta
from service.runtime.options import MeshOptions, PictureOptions
from service.runtime.pictures import RESOLUTION, scene_of
from service.runtime.shapes import mesh_of


def test_scene_of_a_torn_function_leaves_out_stretched_triangles() -> None:
    spec = MappingSpec("torn", 3, (64,), 3)
    theta = initial_theta(spec)
    theta += np.random.default_rng(0).normal(0, 0.5, theta.size).astype(np.float32)
    functions, frame = Functions(theta), measure(spec, theta)
    surface = mesh_of(spec, functions, frame, MeshOptions(resolution=RESOLUTION))
    kept = without_long(surface.vertices, surface.triangles)
    assert len(kept) < len(surface.triangles)
    np.testing.assert_array_equal(scene_of(spec, functions, frame, PictureOptions()).triangles, kept)
