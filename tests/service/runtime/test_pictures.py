"""Pictures of objects: the surface that they show."""

import numpy as np

from service.drawing.surface import without_long
from service.mapping.box import measure
from service.mapping.spec import Functions, MappingSpec
from service.runtime.options import MeshOptions, PictureOptions
from service.runtime.pictures import RESOLUTION, scene_of
from service.runtime.shapes import mesh_of


def test_scene_of_a_torn_function_leaves_out_stretched_triangles() -> None:
    spec = MappingSpec("torn", 3, (8,), 3)
    axes, step = np.eye(3), np.array([[0, 0], [0, 0], [5, -5]])  # the ball, pulled apart along z where |z| < 0.1
    weights = np.vstack([axes, -axes, axes[[2, 2]]]), [0] * 6 + [0.1, -0.1], np.hstack([axes, -axes, step]), [0] * 3
    functions = Functions(np.concatenate([np.ravel(each) for each in weights]).astype(np.float32))
    frame = measure(spec, functions.theta)
    surface = mesh_of(spec, functions, frame, MeshOptions(resolution=RESOLUTION))
    kept = without_long(surface.vertices, surface.triangles)
    assert 0 < len(kept) < len(surface.triangles)
    np.testing.assert_array_equal(scene_of(spec, functions, frame, PictureOptions()).triangles, kept)
