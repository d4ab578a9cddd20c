"""The oracle among all training shapes: copies and pieces count, objects of other splits do not."""

from pathlib import Path

import numpy as np
import pytest

from model.data.manifest import Manifest, variant_file
from model.evaluation.references.shapes import TrainingShapes
from tests.support.small import data as small_data


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three training objects, each with its free cameras and a copy, and one test object."""
    folder = small_data.write(tmp_path_factory.mktemp("shapes") / "data", train=3, test=1)
    for number, entry in enumerate(Manifest.read(folder).of("train")):
        for variant, points in enumerate((small_data.box(number), small_data.box(50 + number))):
            np.savez(variant_file(folder, entry, variant), points=points)
    return folder


def test_oracle_of_all_finds_a_stretched_copy(data: Path) -> None:
    shapes = TrainingShapes.read(data)
    assert len(shapes.files) == 3 * 2
    assert (shapes.oracle(small_data.box(51) + np.float32(0.004)) == small_data.box(51)).all()


def test_oracle_of_all_finds_a_piece_where_there_are_some(data: Path) -> None:
    (data / "made").mkdir()
    np.savez(data / "made" / "piece.npz", points=small_data.box(70))
    shapes = TrainingShapes.read(data)
    assert len(shapes.files) == 3 * 2 + 1
    assert (shapes.oracle(small_data.box(70)) == small_data.box(70)).all()


def test_training_shapes_without_copies_and_pieces_are_the_objects(tmp_path: Path) -> None:
    folder = small_data.write(tmp_path / "data", train=2, test=1)
    assert len(TrainingShapes.read(folder).files) == 2
