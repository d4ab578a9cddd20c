"""Observations of a small encoder, and the images they are made of."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model.data.manifest import Manifest
from model.evaluation.estimates.observe import KnownObject, observe, roll_view, turned_distances
from model.evaluation.estimates.strange import motorcycle, side_by_side, strange_images
from model.export import export
from model.networks.encoder import ImageEncoder
from model.networks.inner import InnerEncoder
from model.networks.observations import TURNS_DEG
from service.encoding.encoder import Encoder
from tests.support.small import data as small_data
from tests.support.small.network import CONFIG


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("observed") / "small.onnx"
    export(ImageEncoder(CONFIG.spec, CONFIG.encoder, CONFIG.framing.size).eval(), CONFIG, {"name": "small"}, path)
    return path


@pytest.mark.slow
def test_observe_scores_the_objects_that_the_encoder_was_not_trained_on(model: Path, tmp_path: Path) -> None:
    folder = small_data.write(tmp_path / "data", train=2, test=3)
    entries = Manifest.read(folder).entries
    objects = [KnownObject(folder, entry, has_front=entry.id != "object02") for entry in entries]
    observations, again = (observe(model, objects, views=4, seed=0) for _ in range(2))
    np.testing.assert_array_equal(observations.inner["code"], again.inner["code"])
    trained = np.isin(observations.objects, [0, 1])
    assert np.isnan(observations.scores[trained]).all()
    assert ((observations.scores[~trained] >= 0) & (observations.scores[~trained] <= 1)).all()
    assert (np.bincount(observations.objects[observations.objects >= 0]) == 4).all()
    assert np.isnan(observations.cameras[observations.objects == 2, 0]).all()
    assert np.isfinite(observations.cameras[observations.objects == 3]).all()
    strange = observations.objects == -1
    assert strange.sum() == 2 * round(0.04 * 20)
    assert (observations.scores[strange] == 0).all()
    assert np.isnan(observations.cameras[strange]).all()


def test_inner_encoder_gives_the_theta_of_the_file(model: Path) -> None:
    images = np.random.default_rng(0).random((3, 3, CONFIG.framing.size, CONFIG.framing.size), np.float32)
    inner = InnerEncoder(model, threads=1)
    theta, tensors = inner.look(images)
    assert (inner.names, inner.size) == (("code", "maps"), CONFIG.framing.size)
    assert tensors["code"].shape == (3, CONFIG.encoder.rank)
    expected = [functions.theta for functions in Encoder.open(model, 1).encode(images)]
    np.testing.assert_allclose(theta, expected, atol=1e-6)


def test_rolled_turns_the_picture_against_the_camera() -> None:
    view = np.zeros((64, 64, 4), np.uint8)
    view[4:24, 30:34] = 255  # a bar above the center
    turned = roll_view(view, 30)
    rows, columns = np.nonzero(turned[..., 3])
    assert columns.mean() < turned.shape[1] / 2 - 5  # the camera turns clockwise, the bar to the left
    assert rows.mean() < turned.shape[0] / 2


def test_turned_distances_of_a_box_are_small_after_half_a_turn_alone() -> None:
    box = small_data.box(3) * np.array([1, 1, 0.4], np.float32)
    distances = dict(zip(TURNS_DEG, turned_distances(box), strict=True))
    assert distances[180] < 0.02 < min(distances[90], distances[270], distances[45])


def test_strange_images_are_of_every_kind_and_in_range() -> None:
    photograph = np.asarray(Image.effect_noise((80, 60), 90).convert("RGB"))
    images = strange_images(8, 32, [photograph], np.random.default_rng(0))
    assert images.shape == (8, 3, 32, 32)
    assert images.dtype == np.float32
    assert ((images >= 0) & (images <= 1)).all()
    assert len(np.unique(images.reshape(8, -1), axis=0)) == 8
    assert strange_images(0, 32, [photograph], np.random.default_rng(0)).shape == (0, 3, 32, 32)


def test_side_by_side_keeps_both_views_apart() -> None:
    left, right = np.full((8, 8, 4), 50, np.uint8), np.full((8, 8, 4), 99, np.uint8)
    both = side_by_side(left, right)
    assert (both[:, :8] == left).all()
    assert (both[:, -8:] == right).all()
    assert (both[:, 8:-8] == 0).all()


def test_motorcycle_is_in_the_object_frame() -> None:
    corners = np.concatenate([part.bounds for part in motorcycle()])
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert high - low == pytest.approx(np.abs(high - low))
    assert (high - low).max() == pytest.approx(1)
    assert low + high == pytest.approx(0, abs=1e-6)
    assert np.argmax(high - low) == 2  # it is longest from back to front
