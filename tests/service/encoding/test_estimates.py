"""Estimates of an encoder: in the encoder's answer, as text, and in files of other versions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.encoding.encoder import FAVOR, Encoded, Encoder, merged
from service.encoding.estimates import Camera, Estimates
from service.encoding.framing import Framed
from service.errors import InvalidModel
from service.mapping.spec import Color
from tests.support.small import model as tiny_model


def test_encode_with_estimates_gives_the_same_theta_and_estimates_per_image(model_path: Path, tmp_path: Path) -> None:
    images = np.random.default_rng(0).random((3, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    plain = Encoder.open(model_path, threads=1)
    encoder = Encoder.open(tiny_model.build(tmp_path / "tiny-k2.onnx", estimates=True), threads=1)
    assert (plain.makes_estimates, encoder.makes_estimates) == (False, True)
    assert encoder.outputs == plain.outputs | {"shape_confidence": [1], "camera": [4]}
    for image, one, other in zip(images, plain.encode(images), encoder.encode(images), strict=True):
        np.testing.assert_array_equal(other.theta, one.theta)
        assert one.estimates is None
        assert other.estimates
        red, green, blue = image.mean(axis=(1, 2)).tolist()
        camera = other.estimates.camera
        assert other.estimates.shape_confidence == pytest.approx(red, abs=1e-5)
        assert (camera.azimuth, camera.elevation) == pytest.approx((90 * blue, 30 * green + 10), abs=1e-3)
        assert (camera.distance, camera.roll) == pytest.approx((green + 2, 5 * green - 2), abs=1e-4)


def test_estimates_as_text_are_read_back() -> None:
    estimates = Estimates(0.123456, Camera(-12.345, 5, 2.71828, 0.04)).rounded()
    assert estimates == Estimates(0.123, Camera(-12.3, 5, 2.72, 0.0))
    assert Estimates.from_json(estimates.to_json()) == estimates
    assert str(estimates).startswith("shape confidence 0.123; camera at azimuth -12.3, elevation 5, roll 0.0 degrees")


@pytest.mark.parametrize(
    ("estimates", "declared", "message"),
    [
        (True, "2", r"estimates have version 2, this version of hof reads 1: install a newer hof"),
        (False, "1", r"names the output theta, shape_confidence, camera, its graph has theta"),
        (True, None, r"names the output theta, its graph has theta, shape_confidence, camera"),
    ],
)
def test_open_of_metadata_that_disagree_with_the_estimates_is_refused(
    tmp_path: Path, estimates: bool, declared: str | None, message: str
) -> None:
    meta = tiny_model.metadata() | ({"hof.estimates": declared} if declared else {})
    path = tiny_model.build(tmp_path / "tiny-k2.onnx", estimates=estimates, meta=meta)
    with pytest.raises(InvalidModel, match=message):
        Encoder.open(path, threads=1)


# --- several looks at one photo -------------------------------------------------------------------


def _look(level: float, confidence: float | None, azimuth: float = 0.0) -> Encoded:
    color = Color(tiny_model.COLOR_SPEC, np.full(tiny_model.COLOR_SPEC.size, -level, np.float32))
    estimates = None if confidence is None else Estimates(confidence, Camera(azimuth, 0, 2, 0))
    return Encoded(np.full(tiny_model.SPEC.size, level, np.float32), color, estimates)


def test_merged_of_one_look_is_that_look() -> None:
    look = _look(1, 0.5)
    assert merged([1], [look]) is look


@pytest.mark.parametrize("confidences", [(0.4, 0.4), (None, None)])
def test_merged_of_equally_sure_looks_is_their_mean(confidences: tuple[float | None, ...]) -> None:
    mean = merged([1, 1], [_look(level, confidence) for level, confidence in zip((1, 3), confidences, strict=True)])
    assert mean.color
    np.testing.assert_allclose(mean.theta, 2)
    np.testing.assert_allclose(mean.color.weights, -2)
    assert mean.theta.dtype == mean.color.weights.dtype == np.float32
    assert (mean.estimates and mean.estimates.shape_confidence) == confidences[0]


def test_merged_counts_the_surer_look_more_and_keeps_the_camera_of_the_first() -> None:
    mean = merged([1, 1], [_look(0, 0.3, azimuth=10), _look(1, 0.5, azimuth=90)])
    share = 1 / (1 + np.exp(-FAVOR * 0.2))
    assert mean.estimates
    np.testing.assert_allclose(mean.theta, share, rtol=1e-6)
    assert mean.estimates.shape_confidence == pytest.approx(0.3 + 0.2 * share)
    assert mean.estimates.camera.azimuth == 10


def test_merged_counts_a_look_by_its_weight() -> None:
    np.testing.assert_allclose(merged([1, 0.25], [_look(0, 0.5), _look(1, 0.5)]).theta, 0.2, rtol=1e-6)
    np.testing.assert_array_equal(merged([1, 0], [_look(0, 0.1), _look(1, 0.9)]).theta, 0)


def test_encode_photo_merges_the_looks(tmp_path: Path) -> None:
    encoder = Encoder.open(tiny_model.build(tmp_path / "tiny-k2.onnx", estimates=True), threads=1)
    images = np.random.default_rng(0).random((2, 1, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    photo = Framed(images[0], "matting", (0, 0, 65, 9), 1.0, 100, 50, whole=images[1])
    alone = [encoder.encode(look[None])[0] for look in photo.looks]
    assert photo.weights == pytest.approx([1, 0.5])
    np.testing.assert_allclose(encoder.encode_photo(photo).theta, merged(photo.weights, alone).theta, atol=1e-6)
    np.testing.assert_array_equal(encoder.encode_photo(replace(photo, whole=None)).theta, alone[0].theta)
