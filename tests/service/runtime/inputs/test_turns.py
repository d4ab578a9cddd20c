"""Points whose front is on an unknown side: turned inputs, and the choice among their objects."""

import numpy as np
import pytest

from service.encoding.clouds import PointInput, normalize, rotation
from service.encoding.completion import TURNS, best_fit
from service.encoding.encoder import Encoded
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, word_of
from tests.support.small.data import box
from tests.support.small.model import SPEC

CLOUD = 3 * box(1)[:1_000] + np.array([1, 2, 3], np.float32)


def random_theta(seed: int) -> Array:
    return np.random.default_rng(seed).normal(0, 0.6, SPEC.size).astype(np.float32)


@pytest.mark.parametrize("turn", TURNS)
def test_place_of_a_turned_input_gives_the_points_that_were_sent(turn: float) -> None:
    sent = normalize(CLOUD, len(CLOUD), turn)
    assert (sent.turn, sent.count) == (turn, 1_000)
    away = np.linalg.norm(sent.place(sent.tensor[0])[:, None] - CLOUD, axis=2)
    assert max(away.min(axis=0).max(), away.min(axis=1).max()) < 1e-5  # in another order
    np.testing.assert_allclose(np.abs(sent.tensor).max(), 0.5, atol=1e-6)


def test_rotation_turns_from_the_front_to_the_right() -> None:
    np.testing.assert_allclose(rotation(90) @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def objects_at(number: int) -> tuple[list[PointInput], list[Encoded]]:
    """Return an object for each turn, and points of the object `number` as what was sent."""
    encoded = [Encoded(random_theta(seed), None) for seed in range(len(TURNS))]
    points = Sampler(SPEC, word_of(SPEC, encoded[number].theta)).points(300, seed=1)
    return [PointInput(points[None], (0, 0, 0), 1, 300, turn) for turn in TURNS], encoded


@pytest.mark.parametrize("number", range(len(TURNS)))
def test_best_fit_is_the_object_that_lies_at_the_points(number: int) -> None:
    assert best_fit(SPEC, *objects_at(number)) == number


def test_best_fit_is_the_object_as_sent_unless_another_is_clearly_nearer() -> None:
    inputs, encoded = objects_at(3)
    encoded[0] = Encoded(encoded[3].theta * np.float32(1.0001), None)
    assert best_fit(SPEC, inputs, encoded) == 0
