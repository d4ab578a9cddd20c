"""References: each must return the object that its name says."""

from pathlib import Path

import numpy as np
import pytest

from model.data.manifest import Manifest
from model.evaluation.conditions import png
from model.evaluation.references.features import WIDTH, Features, training_bank
from model.evaluation.references.methods import Retrieval, Training, matched_ellipsoid
from model.metrics import compare
from tests.support.small import data as small_data

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("reference") / "data", train=5, test=1)


@pytest.fixture(scope="module")
def training(data: Path) -> Training:
    return Training.read(data)


def test_oracle_shifted_object_returns_that_object(training: Training) -> None:
    true = small_data.box(3) + np.float32(0.004)
    points = training.oracle(true)
    assert (points == training.points[3]).all()
    sums = [sum(compare(points, true)[name] for name in ("cd_forward", "cd_backward")) for points in training.points]
    assert int(np.argmin(sums)) == 3


def test_mean_shape_points_come_from_all_objects(training: Training) -> None:
    pool = training.mean_shape(2_000, seed=0)
    every = {tuple(point): index for index, points in enumerate(training.points) for point in points.tolist()}
    owners = np.bincount([every[tuple(point)] for point in pool.tolist()], minlength=5)
    assert owners.sum() == 2_000
    assert owners.min() > 300


def test_random_shape_equal_id_and_seed_returns_equal_points(training: Training) -> None:
    shapes = {id_: training.random_shape(id_, 0) for id_ in "abcdefgh"}
    assert all((training.random_shape(id_, 0) == shape).all() for id_, shape in shapes.items())
    assert len({shape.tobytes() for shape in shapes.values()}) > 1


def test_matched_ellipsoid_has_the_mean_and_covariance_of_the_points() -> None:
    true = (small_data.box(3) @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0] + 0.1).astype(np.float32)
    points = matched_ellipsoid(true, seed=0)
    assert points.shape == true.shape
    assert points.dtype == np.float32
    assert points.mean(axis=0) == pytest.approx(true.mean(axis=0), abs=0.02)
    assert np.cov(points.T) == pytest.approx(np.cov(true.T), abs=0.01)
    whitened = (points - true.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(true.T))).T
    assert np.linalg.norm(whitened, axis=1) == pytest.approx(np.sqrt(3), rel=1e-3)  # a surface, nothing inside


def test_matched_ellipsoid_flat_points_is_flat() -> None:
    true = small_data.box(3) * np.array([1, 0, 1], np.float32)
    assert np.abs(matched_ellipsoid(true, seed=0)[:, 1]).max() < 1e-6


def test_retrieval_training_image_returns_its_object(data: Path, training: Training) -> None:
    retrieval = Retrieval(data, training)
    for number in (1, 4):
        entry = training.entries[number]
        with np.load(data / entry.file) as arrays:
            photo = png(np.roll(arrays["views"][5], 2, axis=1))  # framing undoes the shift
        assert (retrieval(photo, 500) == training.points[number, :500]).all()


def test_training_bank_is_cached_and_rebuilt_for_other_objects(data: Path) -> None:
    entries = list(Manifest.read(data).of("train"))
    features = Features()
    bank = training_bank(data, entries, features)
    assert bank.features.shape == (5, 24, WIDTH)
    assert np.linalg.norm(bank.features, axis=2) == pytest.approx(1, abs=1e-2)
    kept = (data / "features.npz").stat().st_mtime_ns
    again = training_bank(data, entries, features)
    assert again.features == pytest.approx(bank.features, abs=1e-3)  # kept as float16
    assert (data / "features.npz").stat().st_mtime_ns == kept
    assert training_bank(data, entries[:2], features).ids == bank.ids[:2]
    assert (data / "features.npz").stat().st_mtime_ns > kept
