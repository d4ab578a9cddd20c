"""Duplicates among the objects of a data set."""

import numpy as np
import trimesh

from model.data.dedupe import duplicates
from model.data.rendering.surface import sample_surface


def test_duplicates_turned_and_mirrored_copies_are_mapped_but_not_look_alikes() -> None:
    rng = np.random.default_rng(0)
    shape = trimesh.util.concatenate(
        [
            trimesh.creation.box(extents=(1, 0.2, 0.6)),
            trimesh.creation.box(
                extents=(0.2, 0.5, 0.1), transform=trimesh.transformations.translation_matrix([0.3, 0.3, 0.1])
            ),
        ]
    )
    other = trimesh.creation.box(extents=(1, 0.2, 0.6))

    def cloud(mesh: trimesh.Trimesh) -> np.ndarray:
        return sample_surface([mesh], 10_000, rng)[0]

    turned = cloud(shape)[:, [2, 1, 0]] * np.array([1, 1, -1], np.float32)
    mirrored = cloud(shape) * np.array([-1, 1, 1], np.float32)
    clouds = {"a": cloud(shape), "b": turned, "c": mirrored, "d": cloud(other), "e": cloud(shape)}
    assert duplicates(clouds) == {"b": "a", "c": "a", "e": "a"}
