"""Pictures of objects: the surface that they show."""

import numpy as np

from service.mapping.box import measure
from service.mapping.spec import Functions, MappingSpec
from service.runtime.options import PictureOptions
from service.runtime.pictures import scene_of


def test_scene_of_a_torn_function_shows_the_gap() -> None:
    spec = MappingSpec("torn", 3, (8,), 3)
    axes, step = np.eye(3), np.array([[0, 0], [0, 0], [5, -5]])  # the ball, pulled apart along z where |z| < 0.1
    weights = np.vstack([axes, -axes, axes[[2, 2]]]), [0] * 6 + [0.1, -0.1], np.hstack([axes, -axes, step]), [0] * 3
    functions = Functions(np.concatenate([np.ravel(each) for each in weights]).astype(np.float32))
    frame = measure(spec, functions.theta)
    scene = scene_of(spec, functions, frame, PictureOptions())
    heights = scene.vertices[scene.triangles][:, :, 2]
    assert len(heights)
    assert (np.sign(heights) == np.sign(heights[:, :1])).all()  # no triangle has corners on both sides
